"""Hermite's polynomial of fifth degree through values, slopes and curvatures at both ends of an interval, and where it is least."""

from __future__ import annotations

import numpy as np


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
    values = _polynomial(quintic, shares)
    k, columns = values.argmin(axis=0), np.arange(len(h))
    share = shares[k, columns]
    for _ in range(4):
        slope, curvature = _polynomial(_derivative(quintic), share), _polynomial(_derivative(_derivative(quintic)), share)
        newton_step = np.where(curvature > 0, -slope / np.where(curvature > 0, curvature, 1.0), 0.0)
        share = np.clip(share + np.clip(newton_step, -0.125, 0.125), low, high)
    value, at_first = _polynomial(quintic, share), values[k, columns]
    share, value = np.where(value <= at_first, share, shares[k, columns]), np.minimum(value, at_first)
    return share, value, np.abs(_polynomial(cubic, shares) - values).max(axis=0)


def _polynomial(coefficients: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Values of polynomials, coefficients (degree + 1, K) in rising order."""
    value = coefficients[-1] + 0 * at
    for coefficient in coefficients[-2::-1]:
        value = value * at + coefficient
    return value


def _derivative(coefficients: np.ndarray) -> np.ndarray:
    return coefficients[1:] * np.arange(1, len(coefficients))[:, None]
