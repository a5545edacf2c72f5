"""Numbers of twice the digits, as pairs of doubles: for sums whose terms are more decades apart than one double has."""

from __future__ import annotations

import numpy as np

Pair = tuple[np.ndarray, np.ndarray]  # hi + lo, |lo| <= eps |hi| / 2
_SPLIT = 134217729.0  # 2^27 + 1: halves of 26 digits each, whose products are exact (Dekker, 1971)


def summed(a: np.ndarray, b: np.ndarray) -> Pair:
    """Return a + b exactly (Knuth)."""
    total = a + b
    part = total - a
    return total, (a - (total - part)) + (b - part)


def multiplied(a: np.ndarray, b: np.ndarray) -> Pair:
    """Return a b exactly (Dekker)."""
    product = a * b
    (a_hi, a_lo), (b_hi, b_lo) = _halves(a), _halves(b)
    return product, ((a_hi * b_hi - product) + a_hi * b_lo + a_lo * b_hi) + a_lo * b_lo


def plus(x: Pair, y: Pair) -> Pair:
    """Return x + y to about 2 eps^2 of |x| + |y|."""
    hi, low = summed(x[0], y[0])
    mid, lowest = summed(x[1], y[1])
    hi, low = _tidy(hi, low + mid)
    return _tidy(hi, low + lowest)


def minus(x: Pair, y: Pair) -> Pair:
    """Return x - y."""
    return plus(x, (-y[0], -y[1]))


def times(x: Pair, y: Pair) -> Pair:
    """Return x y to a few eps^2."""
    hi, lo = multiplied(x[0], y[0])
    return _tidy(hi, lo + (x[0] * y[1] + x[1] * y[0]))


def over(x: Pair, y: Pair) -> Pair:
    """Return x / y to a few eps^2; y must not be 0."""
    first = x[0] / y[0]
    rest = minus(x, times(y, (first, np.zeros_like(first))))
    second = rest[0] / y[0]
    rest = minus(rest, times(y, (second, np.zeros_like(second))))
    hi, lo = _tidy(first, second)
    return _tidy(hi, lo + rest[0] / y[0])


def _tidy(hi: np.ndarray, lo: np.ndarray) -> Pair:
    total = hi + lo
    return total, lo - (total - hi)


def _halves(a: np.ndarray) -> Pair:
    big = _SPLIT * a
    hi = big - (big - a)
    return hi, a - hi


def at(x: Pair, *index: object) -> Pair:
    """Return entries of a pair."""
    return x[0][index], x[1][index]  # pyright: ignore[reportArgumentType, reportCallIssue]


def put(x: Pair, index: object, y: Pair) -> None:
    """Set entries of a pair."""
    x[0][index], x[1][index] = y  # pyright: ignore[reportArgumentType, reportCallIssue]
