"""What a double stands for: people type decimals, fractions, multiples of pi and roots, and software rounds their products."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache

from obsdesign.rank.exact_numbers import Irrational, combination, pi_times

PI_ULPS = 4
"""A multiple of pi may be so many units in the last place beside the double: degrees are converted in two operations."""
MAX_ULPS = 32
"""A number that was computed may be so many units in the last place beside the number that was meant: sin(165 deg) is 15 off."""

_SHORT_DIGITS = 12  # digits of a decimal that nobody doubts
_CERTAIN_HEIGHT = 10**3  # height up to which the double next to a number is next to it by accident with a chance of 1e-12
_SHORT_HEIGHT = 10**6  # the same, with a chance of 1e-10
_LIKELY_HEIGHT = 2**40  # the same, with a chance of 1e-2 to 1e-4
_DIGITS_TO_ULPS = {
    _SHORT_DIGITS: MAX_ULPS,
    _SHORT_DIGITS + 2: 3,
}  # digits of a decimal that a longer one may stand for: units in the last place beside it
_PI = Fraction(314159265358979323846264338327950288419716939937510582097494459, 10**62)
_ROOTS = tuple(Fraction(math.isqrt(n << 256), 2**128) for n in (2, 3, 6))
_SURDS = {
    (0, 1, 0, 0): _ROOTS[0],
    (0, 0, 1, 0): _ROOTS[1],
    (0, 0, 0, 1): _ROOTS[2],
    (0, 1, 0, 1): _ROOTS[2] + _ROOTS[0],
    (0, -1, 0, 1): _ROOTS[2] - _ROOTS[0],
}
# what doubles give for sine and cosine of whole quarters of a turn instead of 0
_TRIG_RESIDUES = tuple(
    {abs(math.cos(k * math.pi / 2)) for k in range(1, 24, 2)} | {abs(math.sin(k * math.pi / 2)) for k in range(2, 25, 2)}
)


@dataclass(frozen=True)
class Reading:
    """typed: the number as it stands (a decimal, fraction or multiple of pi); intended: what it may be a rounded result of.

    The two differ where there is room for doubt: 0.30000000000000004 stands for itself, or for 3/10.
    """

    literal: Fraction | Irrational
    intended: Fraction | Irrational

    @property
    def is_doubtful(self) -> bool:
        """Whether the number may be a rounded one."""
        return self.literal != self.intended


def read_double(value: float) -> Reading:
    """Return what a finite double stands for.

    In this order: a decimal of at most 12 digits; within NEAREST units in the last place a multiple of pi, in degrees of at most 7
    digits or p pi/q; p sqrt(n)/q, p/q that round to it. Whatever else stands for itself, a decimal of 13 to 17 digits, or for the
    shortest of the decimals, fractions, roots and zeros that it may be a rounded result of.
    """
    return _reading_of(float(value))


@lru_cache(2**12)
def _reading_of(value: float) -> Reading:
    exact = unambiguous_value(value)
    if exact is not None:
        return Reading(exact, exact)
    literal = Fraction(repr(value))
    return Reading(literal, min(_candidates(value), default=(0, literal), key=lambda candidate: candidate[0])[1])


def is_exact(value: float) -> bool:
    """Return whether a double cannot be the rounded result of an operation, but by an accident of 1e-9."""
    number = unambiguous_value(value)
    return number is not None and (_digits(value) <= _SHORT_DIGITS or isinstance(number, Irrational) or _height(number) <= _SHORT_HEIGHT)


def unambiguous_value(value: float) -> Fraction | Irrational | None:
    """Return the only number that a double stands for; None where it may be a rounded one."""
    literal = Fraction(repr(value))
    if _digits(value) <= _SHORT_DIGITS or not value:
        return literal
    multiple = _multiple_of_pi(value)
    if multiple is not None:
        return pi_times(multiple)
    root = next((root for height, root in _surds(value, 0.5) if height <= _CERTAIN_HEIGHT), None)
    if root is not None:
        return root
    fraction = _short_fraction(value, _LIKELY_HEIGHT)
    if fraction is not None and float(fraction) == value:
        return fraction
    return None


def _multiple_of_pi(value: float) -> Fraction | None:
    """Return r with value = r pi, r short, if there is one."""
    if not 1e-9 < abs(value) < 1e9:
        return None
    degrees = Fraction(f"{math.degrees(value):.6e}")
    if _is_within_ulps(value, degrees / 180 * _PI, PI_ULPS):
        return degrees / 180
    fraction = _short_fraction(value / math.pi, _CERTAIN_HEIGHT)
    return fraction if fraction is not None and _is_within_ulps(value, fraction * _PI, PI_ULPS) else None


def _candidates(value: float) -> Iterator[tuple[int, Fraction | Irrational]]:
    """Yield numbers that the double may be a rounded result of, each with its height: what is higher is less likely."""
    for digits, width in _DIGITS_TO_ULPS.items():
        decimal = Fraction(f"{value:.{digits - 1}e}")
        if _is_within_ulps(value, decimal, width):
            yield 10 ** _digits(float(decimal)), decimal
    fraction = _short_fraction(value, _LIKELY_HEIGHT)
    if fraction is not None and _is_within_ulps(value, fraction, MAX_ULPS):
        yield _height(fraction), fraction
    yield from _surds(value, MAX_ULPS)
    if is_residue(value):
        yield 1, Fraction(0)


def _surds(value: float, width: float) -> Iterator[tuple[int, Fraction | Irrational]]:
    """Yield q sqrt(2), q sqrt(3), q sqrt(6), q (sqrt(6) +- sqrt(2)) near the double, q rational, each with its height."""
    for parts, size in _SURDS.items():
        q = _short_fraction(value / float(size), _LIKELY_HEIGHT // 2**10)
        if q is not None and _is_within_ulps(value, q * size, width):
            yield _height(q), combination(*(part * q for part in parts))


def is_residue(value: float) -> bool:
    """Return whether the double may be what rounding leaves of 0: k / 2^e with a small k, or a short multiple of sin(pi)."""
    size = abs(value)
    if size < 2.0**-36 and Fraction(size).numerator < 2**8:
        return True
    return size < 1e-8 and any(_is_multiple(size, residue) for residue in _TRIG_RESIDUES)


def _is_multiple(value: float, unit: float) -> bool:
    multiple = _short_fraction(value / unit, 2**16)
    return multiple is not None and _is_within_ulps(value, multiple * Fraction(unit), MAX_ULPS)


def _is_within_ulps(value: float, number: Fraction, width: float) -> bool:
    """Return whether the number is at most so many units in the last place beside the double."""
    return abs(number - Fraction(value)) <= Fraction(width) * Fraction(math.ulp(value))


def _digits(value: float) -> int:
    return len(repr(value).split("e")[0].replace(".", "").replace("-", "").strip("0"))


def _height(value: Fraction) -> int:
    return max(abs(value.numerator), 1) * value.denominator


def _short_fraction(value: float, height: int) -> Fraction | None:
    """Return the convergent p/q of the double's continued fraction that is nearest to it with p q <= height, if it is next to it.

    Whatever is nearer to a number than 1 / (2 q^2) is a convergent (Legendre).
    """
    if not math.isfinite(value) or not value:
        return None
    top, bottom = abs(value).as_integer_ratio()
    unit_top, unit_bottom = math.ulp(value).as_integer_ratio()
    tolerance, tolerance_denominator = 2 * MAX_ULPS * unit_top * bottom, unit_bottom
    dividend, divisor, p, q, p_last, q_last = top, bottom, 1, 0, 0, 1
    while divisor:
        whole, remainder = divmod(dividend, divisor)
        p, q, p_last, q_last = whole * p + p_last, whole * q + q_last, p, q
        if max(p, 1) * q > height:
            return None
        if abs(p * bottom - q * top) * tolerance_denominator <= tolerance * q:
            return Fraction(p if value > 0 else -p, q)
        dividend, divisor = divisor, remainder
    return None
