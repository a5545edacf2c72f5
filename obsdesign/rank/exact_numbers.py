"""Numbers with an exact meaning: rationals, square roots of 2, 3 and 6, multiples of pi; sine and cosine of multiples of pi / 12."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

from flint import arb, ctx, fmpq, nmod

from obsdesign.rank.symbols import PI, PRIME

_ROOTS = tuple(nmod(pow(n, (PRIME + 1) // 4, PRIME), PRIME) for n in (2, 3, 6))


@dataclass(frozen=True)
class Irrational:
    """rational + root_2 sqrt(2) + root_3 sqrt(3) + root_6 sqrt(6) + pi_multiple pi, not all but the first 0: see `combination`."""

    rational: Fraction
    root_2: Fraction
    root_3: Fraction
    root_6: Fraction
    pi_multiple: Fraction

    @property
    def coefficients(self) -> tuple[Fraction, ...]:
        """Of 1, sqrt(2), sqrt(3), sqrt(6) and pi."""
        return self.rational, self.root_2, self.root_3, self.root_6, self.pi_multiple

    @property
    def multiple_of_pi(self) -> Fraction | None:
        """The multiple of pi that the number is, if it is one."""
        return None if any(self.coefficients[:4]) else self.pi_multiple

    def __float__(self) -> float:
        with ctx.workprec(256):
            return float(self.ball())

    def __add__(self, addend: Irrational | Fraction | int) -> Fraction | Irrational:
        return combination(*(a + b for a, b in zip(self.coefficients, _coefficients(addend), strict=True)))

    __radd__ = __add__

    def __str__(self) -> str:
        parts = zip(self.coefficients, ("", "sqrt(2)", "sqrt(3)", "sqrt(6)", "pi"), strict=True)
        return " + ".join(_term(value, symbol) for value, symbol in parts if value).replace("+ -", "- ")

    def ball(self) -> arb:
        """Return the number at the working precision."""
        roots = (arb(1), arb(2).sqrt(), arb(3).sqrt(), arb(6).sqrt(), arb.pi())
        return sum((_ball(value) * root for value, root in zip(self.coefficients, roots, strict=True) if value), arb(0))

    def residue(self) -> nmod:
        """Return the number modulo the prime, pi as the symbol it is there.

        Raises ZeroDivisionError where the prime divides a denominator.
        """
        roots = (nmod(1, PRIME), *_ROOTS, nmod(PI, PRIME))
        return sum((_residue(value) * root for value, root in zip(self.coefficients, roots, strict=True) if value), nmod(0, PRIME))


ExactNumber = Fraction | Irrational
Number = Fraction | int | arb | Irrational


def combination(*coefficients: Fraction) -> Fraction | Irrational:
    """Return the number with these coefficients of 1, sqrt(2), sqrt(3), sqrt(6) and pi; what is left out is 0."""
    all_coefficients = (*(Fraction(value) for value in coefficients), *[Fraction(0)] * (5 - len(coefficients)))
    return Irrational(*all_coefficients) if any(all_coefficients[1:]) else all_coefficients[0]


def pi_times(multiple: Fraction) -> Fraction | Irrational:
    """Return multiple pi."""
    return combination(Fraction(0), Fraction(0), Fraction(0), Fraction(0), multiple)


def as_ball(value: Number) -> arb:
    """Return the number at the working precision."""
    if isinstance(value, Irrational):
        return value.ball()
    return value if isinstance(value, arb) else _ball(value)


def as_residue(value: Number) -> nmod:
    """Return the number modulo the prime; raises ZeroDivisionError where the prime divides its denominator."""
    if isinstance(value, arb):
        raise ValueError(f"{value} is a ball: it has no residue")
    return value.residue() if isinstance(value, Irrational) else _residue(value)


def _ball(value: Fraction | int) -> arb:
    return arb(fmpq(value.numerator, value.denominator))


def _residue(value: Fraction | int) -> nmod:
    return nmod(value.numerator, PRIME) / nmod(value.denominator, PRIME)


def _coefficients(value: Irrational | Fraction | int) -> tuple[Fraction, ...]:
    return value.coefficients if isinstance(value, Irrational) else (Fraction(value), *[Fraction(0)] * 4)


def _term(value: Fraction, symbol: str) -> str:
    if not symbol:
        return str(value)
    denominator = f" / {value.denominator}" if value.denominator != 1 else ""
    numerator = {1: "", -1: "-"}.get(value.numerator, f"{value.numerator} ")
    return f"{numerator}{symbol}{denominator}"


# ---------------------------------------------------------------- sine and cosine

_SINES = (
    combination(Fraction(0)),
    combination(Fraction(0), Fraction(-1, 4), Fraction(0), Fraction(1, 4)),
    Fraction(1, 2),
    combination(Fraction(0), Fraction(1, 2)),
    combination(Fraction(0), Fraction(0), Fraction(1, 2)),
    combination(Fraction(0), Fraction(1, 4), Fraction(0), Fraction(1, 4)),
    Fraction(1),
)
"""sin(k pi / 12) for k = 0..6: 0, (sqrt(6) - sqrt(2)) / 4, 1/2, sqrt(2) / 2, sqrt(3) / 2, (sqrt(6) + sqrt(2)) / 4, 1."""


def sine(twelfths: int) -> Fraction | Irrational:
    """Return sin(twelfths pi / 12)."""
    k = twelfths % 24
    if k > 12:
        return negate(sine(k - 12))
    return _SINES[min(k, 12 - k)]


def cosine(twelfths: int) -> Fraction | Irrational:
    """Return cos(twelfths pi / 12)."""
    return sine(twelfths + 6)


def negate(value: Fraction | Irrational) -> Fraction | Irrational:
    """Return -value."""
    return combination(*(-coefficient for coefficient in _coefficients(value)))
