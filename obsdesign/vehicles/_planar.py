"""What Dubins, Unicycle and their like share: the state (x, y, heading, ...) and the three ways in which wind enters it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from obsdesign.errors import InputError
from obsdesign.signals import Signal
from obsdesign.vehicles.abstract import HEADING, WIND, X, Y

if TYPE_CHECKING:
    import casadi as ca

Wind = Literal["constant", "unknown"]


def require_wind(wind: str | None) -> None:
    """Raise InputError unless wind is None, "constant" or "unknown"."""
    if wind not in (None, "constant", "unknown"):
        raise InputError(f"wind is {wind!r}: must be None, 'constant' (states wind_x, wind_y) or 'unknown' (unknown inputs of those names)")


def planar_states(wind: Wind | None) -> tuple[Signal, ...]:
    """(x, y, heading), followed by (wind_x, wind_y) where the wind is a constant to be estimated."""
    return (X, Y, HEADING) + (WIND if wind == "constant" else ())


def planar_disturbances(wind: Wind | None) -> tuple[Signal, ...]:
    """(wind_x, wind_y) where the wind may do anything."""
    return WIND if wind == "unknown" else ()


def forward_field(x: ca.SX) -> ca.SX:
    """Field of the speed: (cos heading, sin heading, 0, ...)."""
    import casadi as ca

    return ca.vertcat(ca.cos(x[2]), ca.sin(x[2]), ca.SX.zeros(x.numel() - 2))


def turn_field(x: ca.SX) -> ca.SX:
    """Field of the turn rate: unit vector of the heading."""
    return unit_field(x, 2)


def unit_field(x: ca.SX, index: int) -> ca.SX:
    """Unit vector e_index (n, 1)."""
    import casadi as ca

    return ca.SX([float(row == index) for row in range(x.numel())])


def wind_drift(x: ca.SX, wind: Wind | None) -> ca.SX:
    """Drift by the wind: (wind_x, wind_y, 0, ...) where the wind is a state, one of the last two, else 0."""
    import casadi as ca

    n = x.numel()
    return ca.vertcat(x[n - 2], x[n - 1], ca.SX.zeros(n - 2)) if wind == "constant" else ca.SX.zeros(n)


def wind_fields(x: ca.SX, wind: Wind | None) -> tuple[ca.SX, ...]:
    """Fields of the unknown wind components, if they are unknown inputs."""
    return (unit_field(x, 0), unit_field(x, 1)) if wind == "unknown" else ()
