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

from obsdesign.analysis.balancing import balance_columns
from obsdesign.sensors.abstract import Point
from obsdesign.signals import Signal

Kind = Literal["alone", "shift", "rotation", "scale", "combination"]
ROUND_OFF = 1e-9  # relative: of the 16 digits of a double, rows as near to dependence as _DEPENDENT take 6, sums of many terms one more
_DEPENDENCE_LIMIT = 1e-6  # rows nearer to dependence than this leave a direction to less than ROUND_OFF
_MAX_SUBSETS = 4096
"""So many sets of rows are looked at: all of them where there are no more, else random ones."""


@dataclass(frozen=True, eq=False)
class Direction:
    """A change of the state, vector (n,), that changes no output.

    centre: what is turned or scaled about, if not the origin; rotated_states: the states that are turned or scaled wherever they are.
    """

    kind: Kind
    vector: np.ndarray
    centre: Point | None = None
    rotated_states: tuple[int, ...] = ()

    @property
    def states_that_change(self) -> tuple[int, ...]:
        """The states that change, and those that would elsewhere."""
        return tuple(sorted({*self.rotated_states, *(int(i) for i in np.flatnonzero(self.vector))}))

    @property
    def n_terms(self) -> int:
        """Number of states that change."""
        return int(np.count_nonzero(self.vector))


@dataclass(frozen=True, eq=False)
class HiddenSpace:
    """The hidden directions null_space (n, d) at the state `at` (n,), with a row of zeros for every state that is seen."""

    null_space: np.ndarray
    states: tuple[Signal, ...]
    at: np.ndarray
    landmarks: tuple[Point, ...] = ()

    def spanning_directions(self) -> list[Direction]:
        """Return d directions that span the space, in few words each."""
        d = self.null_space.shape[1]
        basis: list[Direction] = []
        for direction in replace(self, null_space=balance_columns(self.null_space))._candidates() if d else ():
            if len(basis) == d:
                break
            if _directions_rank([*basis, direction]) > len(basis):
                basis.append(direction)
        return basis

    def _candidates(self) -> Iterator[Direction]:
        circuits = [self._classify(vector) for vector in _circuits(self.null_space)]
        circuits.sort(key=lambda circuit: (circuit.n_terms, circuit.kind != "shift", [not value for value in circuit.vector]))
        yield from (circuit for circuit in circuits if circuit.n_terms == 1)
        yield from self._landmark_directions()
        yield from (circuit for circuit in circuits if circuit.n_terms == 2 or circuit.kind == "shift")
        yield from self._group_directions([np.flatnonzero(circuit.vector) for circuit in circuits if circuit.kind == "shift"])
        yield from circuits
        yield from (Direction("combination", vector) for vector in self.null_space.T)

    def _classify(self, vector: np.ndarray) -> Direction:
        """Return a sparse vector as what it is."""
        changed = np.flatnonzero(vector)
        pivot_value = vector[min(changed, key=lambda i: (not self.states[i].is_angle, i))]
        vector = vector / pivot_value
        units = {self.states[i].unit for i in changed}
        is_common_shift = len(units) == 1 and np.allclose(vector[changed], 1.0, rtol=ROUND_OFF)
        kind = "alone" if len(changed) == 1 else "shift" if is_common_shift and len(changed) > 2 else "combination"
        return Direction(kind, np.where(vector != 0, np.round(vector), 0.0) if is_common_shift else vector)

    def _landmark_directions(self) -> Iterator[Direction]:
        """Yield the rotation and the scale about every landmark and the origin."""
        names = [signal.name for signal in self.states]
        if not {"x", "y"} <= set(names):
            return
        rows = [names.index(name) for name in ("x", "y")]
        for landmark in (*self.landmarks, None):
            offset = self.at[rows] - (landmark or (0.0, 0.0))
            if offset.any():
                yield from self._rotations(rows, np.array([-offset[1], offset[0]]), landmark)
                yield from self._dilations(rows, offset, landmark)

    def _group_directions(self, shifts: Sequence[np.ndarray]) -> Iterator[Direction]:
        """Yield rotations and the scale of points whose first, second (and third) coordinates are hidden by a common shift each."""
        groups = [shift for shift in shifts if all(len(shift) == len(second_shift) for second_shift in shifts)]
        groups = [shift for i, shift in enumerate(groups) if not any(set(shift) & set(second_shift) for second_shift in groups[:i])]
        if not 2 <= len(groups) <= 3:
            return
        rows = [int(i) for group in groups for i in group]
        values = self.at[rows].reshape(len(groups), -1)
        for first, second in pairwise((*range(len(groups)), 0)) if len(groups) == 3 else ((0, 1),):
            target = np.zeros_like(values)
            target[first], target[second] = -values[second], values[first]
            yield from self._rotations(rows, target.ravel(), None, planar=len(groups) == 2)
        yield from self._dilations(rows, values.ravel(), None)

    def _rotations(self, rows: Sequence[int], target: np.ndarray, centre: Point | None, *, planar: bool = True) -> Iterator[Direction]:
        """Yield the direction with the given rows, if there is one that turns angles by 1 and other pairs of states likewise."""
        vector = self._direction_with(rows, target, 1.0)
        if vector is None:
            return
        others = [i for i in range(len(vector)) if i not in rows]
        rotated = [i for i in others if vector[i] and not _is_close(vector[i], 1.0)]
        if not planar or all(any(self._rotates_pair(vector, i, j) for j in others if j != i) for i in rotated):
            yield Direction("rotation", vector, centre, tuple(rows))

    def _rotates_pair(self, vector: np.ndarray, i: int, j: int) -> bool:
        """Return whether two states change as the components of a vector do that is turned."""
        return any(_is_close(vector[i], -sign * self.at[j]) and _is_close(vector[j], sign * self.at[i]) for sign in (1, -1))

    def _dilations(self, rows: Sequence[int], target: np.ndarray, centre: Point | None) -> Iterator[Direction]:
        """Yield the direction with the given rows, if there is one that changes what else it changes in proportion to its value."""
        vector = self._direction_with(rows, target, 0.0)
        if vector is None:
            return
        others = [i for i in np.flatnonzero(vector) if i not in rows]
        if all(any(_is_close(vector[i], power * self.at[i]) for power in (1, -1, 2, -2)) for i in others):
            yield Direction("scale", vector, centre, tuple(rows))

    def _direction_with(self, rows: Sequence[int], target: np.ndarray, angle_rate: float) -> np.ndarray | None:
        """Return the hidden direction with the given rows, and angles changing by `angle_rate` if there is a choice, or None."""
        scale = float(np.abs(target).max(initial=0.0))
        if not scale:
            return None
        angles = [i for i, state in enumerate(self.states) if state.is_angle and i not in rows and self.null_space[i].any()]
        attempts = [(angles, np.full(len(angles), angle_rate)), ([], np.zeros(0))]
        for angle_rows, values in attempts:
            vector = self._shortest_direction([*rows, *angle_rows], np.array([*target, *values]) / scale)
            if vector is not None:
                return vector * scale
        return None

    def _shortest_direction(self, rows: Sequence[int], target: np.ndarray) -> np.ndarray | None:
        """Return the shortest hidden direction with the given rows."""
        row_maxima = _row_maxima(self.null_space)
        basis = self.null_space / row_maxima[:, None]
        target = target / row_maxima[rows]
        coefficients = np.linalg.lstsq(basis[rows], target, rcond=ROUND_OFF)[0]
        if not np.allclose(basis[rows] @ coefficients, target, rtol=0, atol=ROUND_OFF * np.abs(target).max()):
            return None
        return _combine_rows(basis, coefficients) * row_maxima


def _is_close(value: float, reference: float) -> bool:
    return math.isclose(value, reference, rel_tol=1e-7, abs_tol=ROUND_OFF)


def _directions_rank(directions: Sequence[Direction]) -> int:
    rows = np.array([direction.vector for direction in directions])
    rows = rows / _row_maxima(rows.T)
    return int(np.linalg.matrix_rank(rows / np.linalg.norm(rows, axis=1, keepdims=True), tol=ROUND_OFF))


def _row_maxima(null_space: np.ndarray) -> np.ndarray:
    """Return the largest entry of each row, 1 for a row of zeros."""
    largest = np.abs(null_space).max(axis=1, initial=0.0)
    return np.where(largest > 0, largest, 1.0)


def _combine_rows(rows: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    """Return rows @ shares, of rows with largest entry 1, with what is round-off set to 0."""
    vector = rows @ coefficients
    return np.where(np.abs(vector) > ROUND_OFF * np.abs(coefficients).sum(), vector, 0.0)


def _circuits(null_space: np.ndarray) -> list[np.ndarray]:
    """Return the directions that vanish on d - 1 independent rows, each once."""
    row_maxima = _row_maxima(null_space)
    rows = null_space / row_maxima[:, None]
    changed = np.flatnonzero(rows.any(axis=1))
    circuits: dict[tuple[int, ...], np.ndarray] = {}
    count = null_space.shape[1] - 1
    subset = np.array(list(_row_subsets(len(changed), count)), dtype=int).reshape(-1, count) if count else np.zeros((1, 0), dtype=int)
    for coefficients in _annihilators(rows[changed[subset]]):
        vector = _combine_rows(rows, coefficients)
        circuits.setdefault(tuple(int(i) for i in np.flatnonzero(vector)), vector * row_maxima)
    return list(circuits.values())


def _row_subsets(m: int, count: int) -> Iterator[tuple[int, ...]]:
    """Yield all sets of `count` of m rows, or random ones where these are too many."""
    if math.comb(m, count) <= _MAX_SUBSETS:
        yield from combinations(range(m), count)
        return
    generator = np.random.default_rng(0)
    for _ in range(_MAX_SUBSETS):
        yield tuple(generator.choice(m, count, replace=False))


def _annihilators(rows: np.ndarray) -> np.ndarray:
    """Return the directions (k, d) at right angles to d - 1 rows each (k, d - 1, d), but for rows that are all but dependent."""
    if not rows.shape[1]:
        return np.ones((len(rows), 1))
    _, sizes, directions = np.linalg.svd(rows)
    return directions[sizes[:, -1] > _DEPENDENCE_LIMIT * sizes[:, 0], -1]
