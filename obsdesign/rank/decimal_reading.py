"""What a double stands for: people type decimals, fractions, multiples of pi and roots, and software rounds their products."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache

from obsdesign.rank.exact_numbers import Irrational, combination, of_pi

NEAREST = 4
"""A multiple of pi may be so many units in the last place beside the double: degrees are converted in two operations."""
ROUNDINGS = 32
"""A number that was computed may be so many units in the last place beside the number that was meant: sin(165 deg) is 15 off."""

_TYPED = 12  # digits of a decimal that nobody doubts
_CERTAIN = 10**3  # height up to which the double next to a number is next to it by accident with a chance of 1e-12
_SHORT = 10**6  # the same, with a chance of 1e-10
_LIKELY = 2**40  # the same, with a chance of 1e-2 to 1e-4
_ROUNDED = {_TYPED: ROUNDINGS, _TYPED + 2: 3}  # digits of a decimal that a longer one may stand for: units in the last place beside it
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
_RESIDUES = tuple({abs(math.cos(k * math.pi / 2)) for k in range(1, 24, 2)} | {abs(math.sin(k * math.pi / 2)) for k in range(2, 25, 2)})


@dataclass(frozen=True)
class Reading:
    """typed: the number as it stands (a decimal, fraction or multiple of pi); meant: what it may be a rounded result of.

    The two differ where there is room for doubt: 0.30000000000000004 stands for itself, or for 3/10.
    """

    typed: Fraction | Irrational
    meant: Fraction | Irrational

    @property
    def is_doubtful(self) -> bool:
        """Whether the number may be a rounded one."""
        return self.typed != self.meant


def read(value: float) -> Reading:
    """Return what a finite double stands for.

    In this order: a decimal of at most 12 digits; within NEAREST units in the last place a multiple of pi, in degrees of at most 7
    digits or p pi/q; p sqrt(n)/q, p/q that round to it. Whatever else stands for itself, a decimal of 13 to 17 digits, or for the
    shortest of the decimals, fractions, roots and zeros that it may be a rounded result of.
    """
    return _reading(float(value))


@lru_cache(2**12)
def _reading(value: float) -> Reading:
    plain = as_typed(value)
    if plain is not None:
        return Reading(plain, plain)
    typed = Fraction(repr(value))
    return Reading(typed, min(_candidates(value), default=(0, typed), key=lambda each: each[0])[1])


def is_exact(value: float) -> bool:
    """Return whether a double cannot be the rounded result of an operation, but by an accident of 1e-9."""
    found = as_typed(value)
    return found is not None and (_digits(value) <= _TYPED or isinstance(found, Irrational) or _height(found) <= _SHORT)


def as_typed(value: float) -> Fraction | Irrational | None:
    """Return the only number that a double stands for; None where it may be a rounded one."""
    typed = Fraction(repr(value))
    if _digits(value) <= _TYPED or not value:
        return typed
    multiple = _multiple_of_pi(value)
    if multiple is not None:
        return of_pi(multiple)
    root = next((root for height, root in _surds(value, 0.5) if height <= _CERTAIN), None)
    if root is not None:
        return root
    near = _short(value, _LIKELY)
    if near is not None and float(near) == value:
        return near
    return None


def _multiple_of_pi(value: float) -> Fraction | None:
    """Return r with value = r pi, r short, if there is one."""
    if not 1e-9 < abs(value) < 1e9:
        return None
    degrees = Fraction(f"{math.degrees(value):.6e}")
    if _agree(value, degrees / 180 * _PI, NEAREST):
        return degrees / 180
    near = _short(value / math.pi, _CERTAIN)
    return near if near is not None and _agree(value, near * _PI, NEAREST) else None


def _candidates(value: float) -> Iterator[tuple[int, Fraction | Irrational]]:
    """Yield numbers that the double may be a rounded result of, each with its height: what is higher is less likely."""
    for digits, width in _ROUNDED.items():
        decimal = Fraction(f"{value:.{digits - 1}e}")
        if _agree(value, decimal, width):
            yield 10 ** _digits(float(decimal)), decimal
    near = _short(value, _LIKELY)
    if near is not None and _agree(value, near, ROUNDINGS):
        yield _height(near), near
    yield from _surds(value, ROUNDINGS)
    if is_residue(value):
        yield 1, Fraction(0)


def _surds(value: float, width: float) -> Iterator[tuple[int, Fraction | Irrational]]:
    """Yield q sqrt(2), q sqrt(3), q sqrt(6), q (sqrt(6) +- sqrt(2)) near the double, q rational, each with its height."""
    for parts, size in _SURDS.items():
        q = _short(value / float(size), _LIKELY // 2**10)
        if q is not None and _agree(value, q * size, width):
            yield _height(q), combination(*(part * q for part in parts))


def is_residue(value: float) -> bool:
    """Return whether the double may be what rounding leaves of 0: k / 2^e with a small k, or a short multiple of sin(pi)."""
    size = abs(value)
    if size < 2.0**-36 and Fraction(size).numerator < 2**8:
        return True
    return size < 1e-8 and any(_is_multiple(size, each) for each in _RESIDUES)


def _is_multiple(value: float, unit: float) -> bool:
    near = _short(value / unit, 2**16)
    return near is not None and _agree(value, near * Fraction(unit), ROUNDINGS)


def _agree(value: float, number: Fraction, width: float) -> bool:
    """Return whether the number is at most so many units in the last place beside the double."""
    return abs(number - Fraction(value)) <= Fraction(width) * Fraction(math.ulp(value))


def _digits(value: float) -> int:
    return len(repr(value).split("e")[0].replace(".", "").replace("-", "").strip("0"))


def _height(value: Fraction) -> int:
    return max(abs(value.numerator), 1) * value.denominator


def _short(value: float, height: int) -> Fraction | None:
    """Return the convergent p/q of the double's continued fraction that is nearest to it with p q <= height, if it is next to it.

    Whatever is nearer to a number than 1 / (2 q^2) is a convergent (Legendre).
    """
    if not math.isfinite(value) or not value:
        return None
    top, bottom = abs(value).as_integer_ratio()
    unit_top, unit_bottom = math.ulp(value).as_integer_ratio()
    near, per = 2 * ROUNDINGS * unit_top * bottom, unit_bottom
    above, below, p, q, p_last, q_last = top, bottom, 1, 0, 0, 1
    while below:
        whole, rest = divmod(above, below)
        p, q, p_last, q_last = whole * p + p_last, whole * q + q_last, p, q
        if max(p, 1) * q > height:
            return None
        if abs(p * bottom - q * top) * per <= near * q:
            return Fraction(p if value > 0 else -p, q)
        above, below = below, rest
    return None
