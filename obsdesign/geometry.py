"""Convex polygons and circles in the plane, and what is wrong with the corners of one."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import combinations
from math import atan2, hypot, isclose, pi
from typing import Any

from obsdesign.checks import as_pair
from obsdesign.errors import InputError
from obsdesign.signals import Point

_FLAT = 1e-9  # share of the outline's extent, or angle [rad], that counts as rounding


def convex_corners(what: str, corners: Any) -> tuple[Point, ...]:  # noqa: ANN401  # whatever a caller took for corners
    """Return the corners (m, 2) [m] of a convex polygon as a tuple of points, counter-clockwise; `what` names them in errors.

    The outline is convex where all its turns have one sign and add up to one whole turn. Corners on a straight edge are kept.
    Raises InputError for fewer than three corners, for those that are no points, repeat each other or lie on one line, for edges
    that cross and for a corner that points inwards; it names the corners.
    """
    points = _points(what, corners)
    _require_distinct(what, points)
    _require_area(what, points)
    turns = _turns(points)
    orientation = 1 if _area(points) > 0 else -1
    is_single_turn = isclose(abs(sum(turns)), 2 * pi, abs_tol=1e-6)
    if not (is_single_turn and all(turn * orientation >= -_FLAT for turn in turns)):
        raise InputError(_concavity_message(what, points, [turn * orientation for turn in turns]))
    return points if orientation > 0 else points[::-1]


def half_planes(corners: Sequence[Point]) -> tuple[tuple[Point, ...], tuple[float, ...]]:
    """Return unit normals n_i (m, 2), outwards, and offsets b_i (m,) [m] of counter-clockwise corners: inside is n_i . (x, y) <= b_i.

    Edge i runs from corner i to the next one; n_i . (x, y) - b_i is the signed distance from its line [m], positive outside.
    """
    normals = []
    for (x, y), (next_x, next_y) in _edges(corners):
        length = hypot(next_x - x, next_y - y)
        normals.append(((next_y - y) / length, (x - next_x) / length))
    offsets = (east * x + north * y for (east, north), (x, y) in zip(normals, corners, strict=True))
    return tuple(normals), tuple(offsets)


def is_inside(corners: Sequence[Point], point: Point) -> bool:
    """Return whether a point [m] lies in the convex polygon of counter-clockwise corners, its edges included."""
    return all(_cross(first, second, point) >= 0 for first, second in _edges(corners))


def polygon_size(corners: Sequence[Point]) -> float:
    """Return 2 area / perimeter [m]: the radius of the inscribed circle where one touches every edge, and not less than it elsewhere."""
    return 2 * abs(_area(corners)) / sum(hypot(bx - ax, by - ay) for (ax, ay), (bx, by) in _edges(corners))


def circle_through(points: Sequence[Point]) -> tuple[Point, float]:
    """Return centre (x, y) [m] and radius [m] of the circle through three points [m].

    The centre c solves 2 a . (c - p) = |a|^2 and 2 b . (c - p) = |b|^2, a and b the offsets of second and third point from the
    first, p. Raises InputError unless there are three, not on one line.
    """
    if len(points) != 3:
        raise InputError(f"the circle through points needs exactly 3 of them, there are {len(points)}: {list(points)}")
    (x, y), *offsets_from = points
    (ax, ay), (bx, by) = ((east - x, north - y) for east, north in offsets_from)
    aa, bb = ax * ax + ay * ay, bx * bx + by * by
    twice = 2 * (ax * by - ay * bx)
    if abs(twice) <= 2 * _FLAT * max(aa, bb, (bx - ax) ** 2 + (by - ay) ** 2):
        raise InputError(f"the points {list(points)} lie on one line: the circle through them needs three that do not")
    east, north = (by * aa - ay * bb) / twice, (ax * bb - bx * aa) / twice
    return (x + east, y + north), hypot(east, north)


def _points(what: str, corners: Any) -> tuple[Point, ...]:  # noqa: ANN401
    if not isinstance(corners, Iterable):
        raise InputError(f"{what} is {corners!r}: must be at least three points (x, y)")
    points = tuple(as_pair(f"{what}[{i}]", corner) for i, corner in enumerate(corners))
    if len(points) < 3:
        raise InputError(f"{what} is {points}: must be at least three points (x, y)")
    return points


def _extent(points: Sequence[Point]) -> tuple[float, Point]:
    """The corner that is farthest from the first one, and how far it is [m]."""
    return max((hypot(x - points[0][0], y - points[0][1]), (x, y)) for x, y in points)


def _require_distinct(what: str, points: Sequence[Point]) -> None:
    extent, _ = _extent(points)
    for (i, (ax, ay)), (j, (bx, by)) in combinations(enumerate(points), 2):
        if hypot(bx - ax, by - ay) <= _FLAT * extent:
            closing = " (the outline closes by itself)" if (i, j) == (0, len(points) - 1) else ""
            raise InputError(f"{what}[{j}] is {points[j]}: must differ from corner {i}{closing}")


def _require_area(what: str, points: Sequence[Point]) -> None:
    extent, farthest = _extent(points)
    if all(abs(_cross(points[0], farthest, point)) <= _FLAT * extent * extent for point in points):
        raise InputError(f"{what} is {tuple(points)}: all corners lie on one line, must enclose an area")


def _concavity_message(what: str, points: Sequence[Point], turns: Sequence[float]) -> str:
    """Say which edges cross or, where none do, which corner turns against the others."""
    for (i, (a, b)), (j, (c, d)) in combinations(enumerate(_edges(points)), 2):
        neighbours = j - i in (1, len(points) - 1)
        if not neighbours and _segments_intersect(a, b, c, d):
            edges = f"the edge from corner {i}, {a}, to {b} meets the edge from corner {j}, {c}, to {d}"
            return f"{what}: {edges}: must follow each other around a convex area"
    i = min(range(len(points)), key=lambda corner: turns[corner])
    return f"{what}[{i}] is {points[i]}: points inwards, must be a corner of a convex area"


def _edges(points: Sequence[Point]) -> list[tuple[Point, Point]]:
    return list(zip(points, (*points[1:], points[0]), strict=True))


def _area(points: Sequence[Point]) -> float:
    """Signed area [m^2], positive counter-clockwise; measured from the first corner, so that far-away coordinates cost no digits."""
    return sum(_cross(points[0], first, second) for first, second in _edges(points)) / 2


def _turns(points: Sequence[Point]) -> list[float]:
    """Angle in (-pi, pi] by which the outline turns at each corner, positive counter-clockwise."""
    steps = [(bx - ax, by - ay) for (ax, ay), (bx, by) in _edges(points)]
    before = (steps[-1], *steps[:-1])
    return [atan2(ax * by - ay * bx, ax * bx + ay * by) for (ax, ay), (bx, by) in zip(before, steps, strict=True)]


def _cross(origin: Point, first: Point, second: Point) -> float:
    """(first - origin) x (second - origin) [m^2], positive where second lies to the left."""
    return (first[0] - origin[0]) * (second[1] - origin[1]) - (first[1] - origin[1]) * (second[0] - origin[0])


def _segments_intersect(a: Point, b: Point, c: Point, d: Point) -> bool:
    """Whether the segments ab and cd have a point in common."""
    sides = _cross(a, b, c), _cross(a, b, d), _cross(c, d, a), _cross(c, d, b)
    if sides == (0, 0, 0, 0):
        along = 0 if a[0] != b[0] else 1
        return max(min(a[along], b[along]), min(c[along], d[along])) <= min(max(a[along], b[along]), max(c[along], d[along]))
    return sides[0] * sides[1] <= 0 and sides[2] * sides[3] <= 0
