"""Signed distances from discs, polygons and sectors: one definition for floats, NumPy arrays and SX."""

from __future__ import annotations

import math
from collections.abc import Sequence

from obsdesign.geometry import half_planes, polygon_size
from obsdesign.moment import Coordinate, Moment
from obsdesign.signals import Point

_ROUNDING_SHARE = 1e-3  # share of a disc's radius over which the tip of the distance is rounded
_BLEND_SHARE = 0.02  # share of a polygon's size over which its edges blend into each other


def smooth_excess(squared: Coordinate, radius: float) -> Coordinate:
    """Return how far outside a circle a point lies, sqrt(squared + s^2) - sqrt(radius^2 + s^2), from its squared distance to the centre.

    s = radius / 1000. The sign is exactly that of d - radius. The rounding by s gives it a derivative at the centre, where it is
    off by s; from radius / 2 outwards it is d - radius to 1e-6 radius.
    """
    soft = (_ROUNDING_SHARE * radius) ** 2
    # a power, not sqrt: floats, arrays and SX all have it
    return (squared + soft) ** 0.5 - (radius * radius + soft) ** 0.5


def outside_disc(moment: Moment, centre: Point, radius: float) -> Coordinate:
    """Return (|position - centre| - radius) / radius, rounded at the centre."""
    east, north = moment.state["x"] - centre[0], moment.state["y"] - centre[1]
    return smooth_excess(east * east + north * north, radius) / radius


def within_angle(angle: Coordinate, centre: float, half: float) -> Coordinate:
    """Return how far inside centre +- half an angle [rad] is, as a share of half in (0, pi); periodic, > 0 inside, < 0 outside.

    (c(half) - c(angle - centre)) / (half cos(half / 2)) with the chord c(a) = 2 |sin(a / 2)|, rounded at the centre: the disc of
    radius c(half) on the unit circle. Its slope at the edge is 1 / half; opposite to the centre the slope is 0.
    """
    sine = _functions_of(angle).sin((angle - centre) / 2)
    return -smooth_excess(4 * sine * sine, 2 * math.sin(half / 2)) / (half * math.cos(half / 2))


def edge_distances(moment: Moment, corners: Sequence[Point]) -> list[Coordinate]:
    """Return the signed distance [m] from the line of every edge of a convex polygon, positive outside."""
    normals, offsets = half_planes(corners)
    x, y = moment.state["x"], moment.state["y"]
    return [east * x + north * y - offset for (east, north), offset in zip(normals, offsets, strict=True)]


def polygon_margins(moment: Moment, corners: Sequence[Point]) -> list[Coordinate]:
    """Return a margin per edge: how far inside its line the position lies, as a share of the polygon's size."""
    size = polygon_size(corners)
    return [-distance / size for distance in edge_distances(moment, corners)]


def widening(corners: Sequence[Point]) -> float:
    """Return by how much `outside_polygon` widens a polygon of m edges at most [m]: 0.02 size log m."""
    return _BLEND_SHARE * polygon_size(corners) * math.log(len(corners))


def outside_polygon(moment: Moment, corners: Sequence[Point]) -> Coordinate:
    """Return e log(sum exp(s_i / e)) - e log m with the distances s_i of the m edges and e = 0.02 size, as a share of the size.

    It lies between max s_i - e log m and max s_i, so a position that it calls outside is outside; it is smooth, and grows with
    distance. The largest s_i is taken out of the exponents, which then do not overflow; its derivatives cancel.
    """
    size = polygon_size(corners)
    distances = edge_distances(moment, corners)
    functions = _functions_of(distances[0])
    largest = _largest(distances)
    total = sum(functions.exp((distance - largest) / (_BLEND_SHARE * size)) for distance in distances)
    return (largest + _BLEND_SHARE * size * functions.log(total) - widening(corners)) / size


def _largest(values: Sequence[Coordinate]) -> Coordinate:
    functions = _functions_of(values[0])
    if functions is math:
        return max(values)
    largest = values[0]
    for value in values[1:]:
        largest = functions.fmax(largest, value)
    return largest


def _functions_of(value: Coordinate) -> Coordinate:
    """The module whose sin, exp and log suit a value: math, numpy or casadi; a float loads neither of the latter."""
    if isinstance(value, (int, float)):
        return math
    import numpy as np

    if isinstance(value, (np.ndarray, np.generic)):
        return np
    import casadi as ca

    return ca
