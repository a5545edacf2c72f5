"""Quaternions (4, 1), q_t + q_x i + q_y j + q_z k, the real part first, as symbolic expressions."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import casadi as ca


def multiply(p: ca.SX, q: ca.SX) -> ca.SX:
    """Return the product p q of two quaternions (4, 1), the real part first."""
    import casadi as ca

    return ca.vertcat(
        p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3],
        p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2],
        p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1],
        p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0],
    )


def conjugate(q: ca.SX) -> ca.SX:
    """Return q* (4, 1)."""
    import casadi as ca

    return ca.vertcat(q[0], -q[1], -q[2], -q[3])


def rotate(q: ca.SX, v: ca.SX) -> ca.SX:
    """Return the imaginary part (3, 1) of q v q*: v (3, 1) in the axes of the map, |q|^2 times as long."""
    import casadi as ca

    return multiply(multiply(q, ca.vertcat(0, v)), conjugate(q))[1:]


def axis_columns(q: ca.SX) -> tuple[ca.SX, ...]:
    """Return the vehicle's three axes (3, 1) in the map."""
    import casadi as ca

    return tuple(rotate(q, ca.SX([float(row == axis) for row in range(3)])) for axis in range(3))


def turn_columns(q: ca.SX) -> tuple[ca.SX, ...]:
    """Return dq/dt (4, 1) of a unit turn rate about each of the vehicle's axes: q (0, e_i) / 2."""
    import casadi as ca

    return tuple(multiply(q, ca.SX([0.0, *(float(row == axis) for row in range(3))])) / 2 for axis in range(3))
