"""The few pieces of calculus everything shares: Runge-Kutta, Lie derivatives, wrapping."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

import numpy as np

if TYPE_CHECKING:
    import casadi as ca

Angle = TypeVar("Angle", float, np.ndarray)


def rk4(rate: Callable[[ca.SX], ca.SX], x: ca.SX, step: float | ca.SX) -> ca.SX:
    """Return the state after one classical Runge-Kutta step of xdot = rate(x), local error O(step^5)."""
    k1 = rate(x)
    k2 = rate(x + step / 2 * k1)
    k3 = rate(x + step / 2 * k2)
    k4 = rate(x + step * k3)
    return x + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def lie_derivative(functions: ca.SX, x: ca.SX, field: ca.SX) -> ca.SX:
    """L_v s = (ds/dx) v for a column of functions s (q, 1) along the field v (n, 1)."""
    import casadi as ca

    return ca.jtimes(functions, x, field)


def wrap(angle: Angle) -> Angle:
    """Return the angle [rad] in [-pi, pi); -wrap(-angle) is the one in (-pi, pi]."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


def yaw(x: np.ndarray, y: np.ndarray, z: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Return the angle [rad] about z, from x, of the body's x axis seen along z, of unit quaternions w + x i + y j + z k."""
    return np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def wrap_columns(values: np.ndarray, is_angle: np.ndarray) -> np.ndarray:
    """Return values (..., q) with the columns that are angles wrapped."""
    return np.where(is_angle, wrap(values), values)


def bracket(first: ca.SX, second: ca.SX, x: ca.SX) -> ca.SX:
    """[f, g] = (dg/dx) f - (df/dx) g for fields f, g (n, 1): L_[f,g] = L_f L_g - L_g L_f."""
    return lie_derivative(second, x, first) - lie_derivative(first, x, second)
