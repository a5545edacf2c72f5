"""Numbers of twice the digits, as pairs of doubles: for sums whose terms are more decades apart than one double has."""

from __future__ import annotations

import numpy as np

DoubleDouble = tuple[np.ndarray, np.ndarray]  # hi + lo, |lo| <= eps |hi| / 2
_SPLIT = 134217729.0  # 2^27 + 1: halves of 26 digits each, whose products are exact (Dekker, 1971)


def two_sum(a: np.ndarray, b: np.ndarray) -> DoubleDouble:
    """Return a + b exactly (Knuth)."""
    total = a + b
    b_rounded = total - a
    return total, (a - (total - b_rounded)) + (b - b_rounded)


def two_product(a: np.ndarray, b: np.ndarray) -> DoubleDouble:
    """Return a b exactly (Dekker)."""
    product = a * b
    (a_hi, a_lo), (b_hi, b_lo) = _split(a), _split(b)
    return product, ((a_hi * b_hi - product) + a_hi * b_lo + a_lo * b_hi) + a_lo * b_lo


def add(x: DoubleDouble, y: DoubleDouble) -> DoubleDouble:
    """Return x + y to about 2 eps^2 of |x| + |y|."""
    hi, low = two_sum(x[0], y[0])
    mid, lowest = two_sum(x[1], y[1])
    hi, low = _fast_two_sum(hi, low + mid)
    return _fast_two_sum(hi, low + lowest)


def subtract(x: DoubleDouble, y: DoubleDouble) -> DoubleDouble:
    """Return x - y."""
    return add(x, (-y[0], -y[1]))


def multiply(x: DoubleDouble, y: DoubleDouble) -> DoubleDouble:
    """Return x y to a few eps^2."""
    hi, lo = two_product(x[0], y[0])
    return _fast_two_sum(hi, lo + (x[0] * y[1] + x[1] * y[0]))


def divide(x: DoubleDouble, y: DoubleDouble) -> DoubleDouble:
    """Return x / y to a few eps^2; y must not be 0."""
    first_quotient = x[0] / y[0]
    remainder = subtract(x, multiply(y, (first_quotient, np.zeros_like(first_quotient))))
    second_quotient = remainder[0] / y[0]
    remainder = subtract(remainder, multiply(y, (second_quotient, np.zeros_like(second_quotient))))
    hi, lo = _fast_two_sum(first_quotient, second_quotient)
    return _fast_two_sum(hi, lo + remainder[0] / y[0])


def _fast_two_sum(hi: np.ndarray, lo: np.ndarray) -> DoubleDouble:
    total = hi + lo
    return total, lo - (total - hi)


def _split(a: np.ndarray) -> DoubleDouble:
    scaled = _SPLIT * a
    hi = scaled - (scaled - a)
    return hi, a - hi


def take(x: DoubleDouble, *index: object) -> DoubleDouble:
    """Return entries of a pair."""
    return x[0][index], x[1][index]  # pyright: ignore[reportArgumentType, reportCallIssue]


def put(x: DoubleDouble, index: object, y: DoubleDouble) -> None:
    """Set entries of a pair."""
    x[0][index], x[1][index] = y  # pyright: ignore[reportArgumentType, reportCallIssue]
