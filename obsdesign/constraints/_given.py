"""Checking what the constructors of constraints are given, and spelling it in messages."""

from __future__ import annotations

import math
from collections.abc import Iterable
from numbers import Real
from typing import Any

from obsdesign.checks import as_pair, require_positive, require_within
from obsdesign.errors import InputError
from obsdesign.signals import Point

LENGTH, ANGLE, SPEED = "m", "rad", "m/s"


def as_size(what: str, value: Any) -> float:  # noqa: ANN401  # whatever a caller gave
    """Return a finite number above 0 as a float, or raise InputError."""
    require_positive(what, value)
    return float(value)


def as_angle(what: str, value: Any) -> float:  # noqa: ANN401
    """Return a finite number as a float, or raise InputError."""
    if isinstance(value, bool) or not (isinstance(value, Real) and math.isfinite(value)):
        raise InputError(f"{what} is {value!r}: must be a finite number")
    return float(value)


def as_half_angle(what: str, value: Any) -> float:  # noqa: ANN401
    """Return a number in (0, pi) as a float, or raise InputError."""
    if as_size(what, value) >= math.pi:
        raise InputError(f"{what} is {value!r}: must be below pi rad, where any heading will do")
    return float(value)


def as_window(what: str, first: Any, last: Any) -> tuple[float, float | None]:  # noqa: ANN401
    """Return 0 <= first <= last [s], last None = the end of the path, or raise InputError."""
    require_within(f"{what}: first", first)
    if last is None:
        return float(first), None
    require_within(f"{what}: last", last)
    if last < first:
        raise InputError(f"{what}: last is {last!r}: must not be before first, {first!r} (None = the end of the path)")
    return float(first), float(last)


def as_landmarks(what: str, points: Any) -> tuple[Point, ...] | None:  # noqa: ANN401
    """Return None, or at least one point as a tuple of points [m], or raise InputError."""
    if points is None:
        return None
    if not isinstance(points, Iterable):
        raise InputError(f"{what} is {points!r}: must be points (x, y), or None for those that the sensors look at")
    landmarks = tuple(as_pair(f"{what}[{i}]", point) for i, point in enumerate(points))
    if not landmarks:
        raise InputError(f"{what} is {points!r}: must be at least one point (None = those that the sensors look at)")
    return landmarks


def format_numbers(*numbers: float) -> str:
    """Return a number as 2.5, a point as (2.5, 0), without rounding it visibly."""
    texts = [f"{number:.10g}" for number in numbers]
    return texts[0] if len(texts) == 1 else f"({', '.join(texts)})"


def format_points(points: Iterable[Point]) -> str:
    """Return points as (0, 0), (2.5, 0)."""
    return ", ".join(format_numbers(*point) for point in points)


def format_window(first: float, last: float | None) -> str:
    """Return when a constraint holds in words: "from 3 s to the end"."""
    return f"from {format_numbers(first)} s to {'the end' if last is None else f'{format_numbers(last)} s'}"
