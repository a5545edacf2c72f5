"""Quadratic constraints that every path's chords, sagittas and two fixed axes keep: linear in their Gram matrix."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from obsdesign.design.path_bound.arcs import Arcs
from obsdesign.design.path_bound.motion import AllowedMotion

_WIDEST_TURN = 2.331122370414423  # [rad]: where (1 - cos s) / s is largest, tan(s / 2) = s
_LEAST_RADIUS = 1e-5  # of the longest way: smaller discs are raised to it, which only adds paths; next to 0 multipliers outgrow digits
_ROOM = 1 + 1e-12  # what rounding of a limit's few products may take off


@dataclass(frozen=True, eq=False)
class GramConstraints:
    """sum_r coefficients[i, r] |G-vector of column r of U|^2 <= limits[i], or within spread[i] of it where it is two-sided.

    The vectors in the plane are e_x, e_y, the K chords D_j / (speed tau_j) and the K sagittas over what they can be at most:
    U (2 + 2 K, r) has combinations of these as columns. largest_trace: of the Gram matrix.
    """

    U: np.ndarray
    coefficients: np.ndarray
    limits: np.ndarray
    spread: np.ndarray
    is_two_sided: np.ndarray
    largest_trace: float

    def without_last(self, count: int) -> GramConstraints:
        """Return the constraints without so many of the last, which are those on where the path ends."""
        kept = slice(0, len(self.limits) - count)
        parts = self.coefficients[kept], self.limits[kept], self.spread[kept], self.is_two_sided[kept]
        return GramConstraints(self.U, *parts, self.largest_trace)

    def admissible(self, multipliers: np.ndarray) -> np.ndarray:
        """Return multipliers (m,) that are not below 0 where a constraint is one-sided."""
        return np.where(self.is_two_sided, multipliers, np.maximum(multipliers, 0.0))


@dataclass
class _Rows:
    """Constraints as they are collected."""

    size: int
    columns: list[np.ndarray] = field(default_factory=list)
    rows: list[tuple[dict[int, float], float, float, bool]] = field(default_factory=list)

    def column(self, entries: dict[int, float]) -> int:
        """Add a combination of the vectors; return where it stands."""
        vector = np.zeros(self.size)
        vector[list(entries)] = list(entries.values())
        self.columns.append(vector)
        return len(self.columns) - 1

    def add(self, terms: dict[int, float], limit: float, spread: float = 0.0, two_sided: bool = False) -> None:
        """Add sum of terms times |column|^2 <= limit, or = limit +- spread."""
        self.rows.append((terms, limit, spread, two_sided))


def gram_constraints(motion: AllowedMotion) -> GramConstraints:
    """Return the constraints of a motion's Gram matrices; see docs/design.md for why every path keeps them."""
    K = len(motion.lengths)
    arcs = [motion.arcs(steps) for steps in motion.lengths]
    rows = _Rows(2 + 2 * K)
    east, north = rows.column({0: 1.0}), rows.column({1: 1.0})
    rows.add({east: 1.0}, 1.0, two_sided=True)
    rows.add({north: 1.0}, 1.0, two_sided=True)
    rows.add({rows.column({0: 1.0, 1: 1.0}): 1.0, east: -1.0, north: -1.0}, 0.0, two_sided=True)
    trace = 2.0
    for j, arc in enumerate(arcs):
        _add_piece(rows, j, K, arc, motion.slowest == 1.0)
        trace += arc.lengths[1] + (1 + 2 * arc.shift) ** 2
    if motion.heading is not None:
        _add_start(rows, K, arcs[0], motion)
        for j in range(K - 1):
            _add_corner(rows, j, K, arcs[j], arcs[j + 1], motion.slowest)
    _add_ends(rows, motion)
    coefficients = np.zeros((len(rows.rows), len(rows.columns)))
    for i, (terms, *_) in enumerate(rows.rows):
        coefficients[i, list(terms)] = list(terms.values())
    _, limits, spread, two_sided = zip(*rows.rows, strict=True)
    return GramConstraints(np.array(rows.columns).T, coefficients, np.array(limits), np.array(spread), np.array(two_sided), trace * _ROOM)


def _add_piece(rows: _Rows, j: int, K: int, arc: Arcs, is_fixed_speed: bool) -> None:
    """|D|^2 + a |S|^2 is nearly constant, or at most that; |S| is at most that of the largest turn; D.S = 0."""
    chord, sagitta, both = rows.column({2 + j: 1.0}), rows.column({2 + K + j: 1.0}), rows.column({2 + j: 1.0, 2 + K + j: 1.0})
    low, high = arc.lengths
    terms = {chord: 1.0, sagitta: arc.ratio * arc.sagitta**2}
    if is_fixed_speed:
        rows.add(terms, (low + high) / 2, (high - low) / 2 * _ROOM + 1e-15, two_sided=True)
    else:
        rows.add(terms, high * _ROOM)
    rows.add({sagitta: 1.0}, _ROOM)
    rows.add({both: 1.0, chord: -1.0, sagitta: -1.0}, 0.0, two_sided=True)


def _add_start(rows: _Rows, K: int, arc: Arcs, motion: AllowedMotion) -> None:
    """The first piece begins with the heading of the start."""
    heading = motion.heading or 0.0
    axes = {0: -float(np.cos(heading)), 1: -float(np.sin(heading))}
    if motion.slowest == 1.0:
        limit = (arc.heading_error + 1e-15) ** 2
        rows.add({rows.column({2: arc.along, 2 + K: -arc.across * arc.sagitta, **axes}): 1.0}, limit * _ROOM)
        rows.add({rows.column({2: 1.0, **axes}): 1.0}, largest_chord_turn(arc.half_turn, arc.shift))
    else:
        limit = _widest(np.array([1.0 + arc.shift, motion.slowest * arc.shortest]), np.ones(1), arc.half_turn)
        rows.add({rows.column({2: 1.0, **axes}): 1.0}, limit)


def _add_corner(rows: _Rows, j: int, K: int, first: Arcs, second: Arcs, slowest: float) -> None:
    """A piece ends with the heading that the next one begins with; where the speed changes, chords turn by so much at most."""
    if slowest == 1.0:
        limit = (first.heading_error + second.heading_error) ** 2
        entries = {
            2 + j: first.along,
            2 + K + j: first.across * first.sagitta,
            3 + j: -second.along,
            3 + K + j: second.across * second.sagitta,
        }
        rows.add({rows.column(entries): 1.0}, limit * _ROOM)
        turn = largest_chord_turn(first.half_turn + second.half_turn, first.shift + second.shift)
        rows.add({rows.column({2 + j: 1.0, 3 + j: -1.0}): 1.0}, turn)
        return
    ranges = [np.array([1.0 + arc.shift, slowest * arc.shortest]) for arc in (first, second)]
    rows.add({rows.column({2 + j: 1.0, 3 + j: -1.0}): 1.0}, _widest(ranges[0], ranges[1], first.half_turn + second.half_turn))


def largest_chord_turn(angle: float, shift: float) -> float:
    """Return the largest square of the difference of two chords of half turns d and d', d + d' <= angle, that meet with one heading.

    With the heading measured from where they meet it is the mean over t in [0, 1] of e(2 d' t) - e(-2 d t), of length
    2 |sin (d + d') t|, so at most 2 (1 - cos s) / s, s = |d + d'|, which grows up to s = 2.331. A heading for a chord: d = 0.
    """
    s = min(angle, _WIDEST_TURN)
    return float((2 * (1 - np.cos(s)) / s * (1 + 1e-12) + shift + 1e-13) ** 2) * _ROOM


def _widest(a: np.ndarray, b: np.ndarray, angle: float) -> float:
    """The largest |p - q|^2 of vectors of lengths within a and b, no more than that angle apart: convex in each, so at its ends."""
    cosine = np.cos(min(angle, np.pi))
    return float((a[:, None] ** 2 + b**2 - 2 * a[:, None] * b * cosine).max()) * _ROOM + 1e-14


def _add_ends(rows: _Rows, motion: AllowedMotion) -> None:
    """The sum of the chords ends within a disc; in units of the longest way."""
    way = motion.speed * motion.step * motion.steps
    for end in motion.ends:
        entries = {2 + j: steps / motion.steps for j, steps in enumerate(motion.lengths)}
        entries |= {0: -float(end.point[0]) / way, 1: -float(end.point[1]) / way}
        rows.add({rows.column(entries): 1.0}, (max(end.radius / way, _LEAST_RADIUS) + 1e-13) ** 2 * _ROOM)
