"""Hermite's polynomial of fifth degree through values, slopes and curvatures at both ends of an interval, and where it is least."""

from __future__ import annotations

import numpy as np
from numpy.polynomial.polynomial import polyder, polyval


def minimise_quintic(
    begin: np.ndarray, end: np.ndarray, h: np.ndarray, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return share (K,) of intervals of h (K,) seconds, within [low, high], at which a quintic is least, its value, and an error.

    begin, end (3, K): value and derivatives. The quintic is that of Hermite; error: by how much the cubic differs from it there.
    """
    (a, b, c), (d, e, f) = ((side[0], side[1] * h, side[2] * h * h / 2) for side in (begin, end))
    rise = d - a
    quintic = np.stack(
        [
            a,
            b,
            c,
            10 * rise - 6 * b - 4 * e - 3 * c + f,
            -15 * rise + 8 * b + 7 * e + 3 * c - 2 * f,
            6 * rise - 3 * b - 3 * e - c + f,
        ]
    )
    cubic = np.stack([a, b, 3 * rise - 2 * b - e, b + e - 2 * rise])
    shares = low + (high - low) * np.linspace(0, 1, 9)[:, None]
    values = polyval(shares, quintic, tensor=False)
    k, columns = values.argmin(axis=0), np.arange(len(h))
    share = shares[k, columns]
    for _ in range(4):
        slope, curvature = polyval(share, polyder(quintic), tensor=False), polyval(share, polyder(quintic, 2), tensor=False)
        newton_step = np.where(curvature > 0, -slope / np.where(curvature > 0, curvature, 1.0), 0.0)
        share = np.clip(share + np.clip(newton_step, -0.125, 0.125), low, high)
    value, at_first = polyval(share, quintic, tensor=False), values[k, columns]
    share, value = np.where(value <= at_first, share, shares[k, columns]), np.minimum(value, at_first)
    return share, value, np.abs(polyval(shares, cubic, tensor=False) - values).max(axis=0)
