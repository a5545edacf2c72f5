"""The hidden directions as few states at a time as can be: states alone, common shifts, rotations, scales, sparse combinations.

A space of d directions has sparse members: those that vanish on d - 1 rows of its basis (the circuits of its matroid). Taking the
shortest first, and each that the ones before do not span, gives the basis with the fewest terms.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise
from typing import Literal

import numpy as np

from obsdesign.analysis.balancing import balanced
from obsdesign.sensors.abstract import Point
from obsdesign.signals import Signal

Kind = Literal["alone", "shift", "rotation", "scale", "combination"]
ROUND_OFF = 1e-9  # relative: of the 16 digits of a double, rows as near to dependence as _DEPENDENT take 6, sums of many terms one more
_DEPENDENT = 1e-6  # rows nearer to dependence than this leave a direction to less than ROUND_OFF
_MANY = 4096
"""So many sets of rows are looked at: all of them where there are no more, else random ones."""


@dataclass(frozen=True, eq=False)
class Direction:
    """A change of the state, vector (n,), that changes no output.

    centre: what is turned or scaled about, if not the origin; about: the states that are turned or scaled wherever they are.
    """

    kind: Kind
    vector: np.ndarray
    centre: Point | None = None
    about: tuple[int, ...] = ()

    @property
    def moved(self) -> tuple[int, ...]:
        """The states that change, and those that would elsewhere."""
        return tuple(sorted({*self.about, *(int(i) for i in np.flatnonzero(self.vector))}))

    @property
    def terms(self) -> int:
        """Number of states that change."""
        return int(np.count_nonzero(self.vector))


@dataclass(frozen=True, eq=False)
class Hidden:
    """The hidden directions null_space (n, d) at the state `at` (n,), with a row of zeros for every state that is seen."""

    null_space: np.ndarray
    states: tuple[Signal, ...]
    at: np.ndarray
    landmarks: tuple[Point, ...] = ()

    def basis(self) -> list[Direction]:
        """Return d directions that span the space, in few words each."""
        d = self.null_space.shape[1]
        found: list[Direction] = []
        for direction in replace(self, null_space=balanced(self.null_space))._candidates() if d else ():
            if len(found) == d:
                break
            if _rank([*found, direction]) > len(found):
                found.append(direction)
        return found

    def _candidates(self) -> Iterator[Direction]:
        circuits = [self._named(vector) for vector in _circuits(self.null_space)]
        circuits.sort(key=lambda each: (each.terms, each.kind != "shift", [not value for value in each.vector]))
        yield from (each for each in circuits if each.terms == 1)
        yield from self._about_points()
        yield from (each for each in circuits if each.terms == 2 or each.kind == "shift")
        yield from self._of_groups([np.flatnonzero(each.vector) for each in circuits if each.kind == "shift"])
        yield from circuits
        yield from (Direction("combination", vector) for vector in self.null_space.T)

    def _named(self, vector: np.ndarray) -> Direction:
        """Return a sparse vector as what it is."""
        moved = np.flatnonzero(vector)
        first = vector[min(moved, key=lambda i: (not self.states[i].is_angle, i))]
        vector = vector / first
        units = {self.states[i].unit for i in moved}
        same = len(units) == 1 and np.allclose(vector[moved], 1.0, rtol=ROUND_OFF)
        kind = "alone" if len(moved) == 1 else "shift" if same and len(moved) > 2 else "combination"
        return Direction(kind, np.where(vector != 0, np.round(vector), 0.0) if same else vector)

    def _about_points(self) -> Iterator[Direction]:
        """Yield the rotation and the scale about every landmark and the origin."""
        names = [signal.name for signal in self.states]
        if not {"x", "y"} <= set(names):
            return
        rows = [names.index(name) for name in ("x", "y")]
        for landmark in (*self.landmarks, None):
            away = self.at[rows] - (landmark or (0.0, 0.0))
            if away.any():
                yield from self._turned(rows, np.array([-away[1], away[0]]), landmark)
                yield from self._scaled(rows, away, landmark)

    def _of_groups(self, shifts: Sequence[np.ndarray]) -> Iterator[Direction]:
        """Yield rotations and the scale of points whose first, second (and third) coordinates are hidden by a common shift each."""
        groups = [shift for shift in shifts if all(len(shift) == len(other) for other in shifts)]
        groups = [shift for i, shift in enumerate(groups) if not any(set(shift) & set(other) for other in groups[:i])]
        if not 2 <= len(groups) <= 3:
            return
        rows = [int(i) for group in groups for i in group]
        values = self.at[rows].reshape(len(groups), -1)
        for first, second in pairwise((*range(len(groups)), 0)) if len(groups) == 3 else ((0, 1),):
            target = np.zeros_like(values)
            target[first], target[second] = -values[second], values[first]
            yield from self._turned(rows, target.ravel(), None, planar=len(groups) == 2)
        yield from self._scaled(rows, values.ravel(), None)

    def _turned(self, rows: Sequence[int], target: np.ndarray, centre: Point | None, *, planar: bool = True) -> Iterator[Direction]:
        """Yield the direction with the given rows, if there is one that turns angles by 1 and other pairs of states likewise."""
        vector = self._with(rows, target, 1.0)
        if vector is None:
            return
        others = [i for i in range(len(vector)) if i not in rows]
        turned = [i for i in others if vector[i] and not _close(vector[i], 1.0)]
        if not planar or all(any(self._is_turned(vector, i, j) for j in others if j != i) for i in turned):
            yield Direction("rotation", vector, centre, tuple(rows))

    def _is_turned(self, vector: np.ndarray, i: int, j: int) -> bool:
        """Return whether two states change as the components of a vector do that is turned."""
        return any(_close(vector[i], -sign * self.at[j]) and _close(vector[j], sign * self.at[i]) for sign in (1, -1))

    def _scaled(self, rows: Sequence[int], target: np.ndarray, centre: Point | None) -> Iterator[Direction]:
        """Yield the direction with the given rows, if there is one that changes what else it changes in proportion to its value."""
        vector = self._with(rows, target, 0.0)
        if vector is None:
            return
        others = [i for i in np.flatnonzero(vector) if i not in rows]
        if all(any(_close(vector[i], power * self.at[i]) for power in (1, -1, 2, -2)) for i in others):
            yield Direction("scale", vector, centre, tuple(rows))

    def _with(self, rows: Sequence[int], target: np.ndarray, turn: float) -> np.ndarray | None:
        """Return the hidden direction with the given rows, and with angles changing by `turn` if there is a choice; None: there is none."""
        scale = float(np.abs(target).max(initial=0.0))
        if not scale:
            return None
        angles = [i for i, state in enumerate(self.states) if state.is_angle and i not in rows and self.null_space[i].any()]
        wanted = [(angles, np.full(len(angles), turn)), ([], np.zeros(0))]
        for more, values in wanted:
            vector = self._solution([*rows, *more], np.array([*target, *values]) / scale)
            if vector is not None:
                return vector * scale
        return None

    def _solution(self, rows: Sequence[int], target: np.ndarray) -> np.ndarray | None:
        """Return the shortest hidden direction with the given rows."""
        widths = _widths(self.null_space)
        basis = self.null_space / widths[:, None]
        target = target / widths[rows]
        shares = np.linalg.lstsq(basis[rows], target, rcond=ROUND_OFF)[0]
        if not np.allclose(basis[rows] @ shares, target, rtol=0, atol=ROUND_OFF * np.abs(target).max()):
            return None
        return _cleaned(basis, shares) * widths


def _close(value: float, other: float) -> bool:
    return math.isclose(value, other, rel_tol=1e-7, abs_tol=ROUND_OFF)


def _rank(directions: Sequence[Direction]) -> int:
    rows = np.array([each.vector for each in directions])
    rows = rows / _widths(rows.T)
    return int(np.linalg.matrix_rank(rows / np.linalg.norm(rows, axis=1, keepdims=True), tol=ROUND_OFF))


def _widths(null_space: np.ndarray) -> np.ndarray:
    """Return the largest entry of each row, 1 for a row of zeros."""
    largest = np.abs(null_space).max(axis=1, initial=0.0)
    return np.where(largest > 0, largest, 1.0)


def _cleaned(rows: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """Return rows @ shares, of rows with largest entry 1, with what is round-off set to 0."""
    vector = rows @ shares
    return np.where(np.abs(vector) > ROUND_OFF * np.abs(shares).sum(), vector, 0.0)


def _circuits(null_space: np.ndarray) -> list[np.ndarray]:
    """Return the directions that vanish on d - 1 independent rows, each once."""
    widths = _widths(null_space)
    rows = null_space / widths[:, None]
    moved = np.flatnonzero(rows.any(axis=1))
    found: dict[tuple[int, ...], np.ndarray] = {}
    count = null_space.shape[1] - 1
    chosen = np.array(list(_chosen(len(moved), count)), dtype=int).reshape(-1, count) if count else np.zeros((1, 0), dtype=int)
    for shares in _annihilators(rows[moved[chosen]]):
        vector = _cleaned(rows, shares)
        found.setdefault(tuple(int(i) for i in np.flatnonzero(vector)), vector * widths)
    return list(found.values())


def _chosen(m: int, count: int) -> Iterator[tuple[int, ...]]:
    """Yield all sets of `count` of m rows, or random ones where these are too many."""
    if math.comb(m, count) <= _MANY:
        yield from combinations(range(m), count)
        return
    generator = np.random.default_rng(0)
    for _ in range(_MANY):
        yield tuple(generator.choice(m, count, replace=False))


def _annihilators(rows: np.ndarray) -> np.ndarray:
    """Return the directions (k, d) at right angles to d - 1 rows each (k, d - 1, d), but for rows that are all but dependent."""
    if not rows.shape[1]:
        return np.ones((len(rows), 1))
    _, sizes, directions = np.linalg.svd(rows)
    return directions[sizes[:, -1] > _DEPENDENT * sizes[:, 0], -1]
