"""Climbing to a local optimum: convex models in a trust region, limits by an exact penalty."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from obsdesign.design.aim import AbstractAim, value_of, weights_of
from obsdesign.design.newton import Active, Face, newton
from obsdesign.design.program import Multipliers, Program, Slopes, Values
from obsdesign.design.subproblem import Cone, Model, Step, minimised
from obsdesign.status import Status

ITERATIONS = 150  # work, not seconds, decides when a start is given up
FEASIBLE = 1e-7  # by how much a margin, of order 1, may fall short
_TOLERANCE = 1e-8  # improvement that a model must promise, in units of the aim
_NEAR = 0.3  # margins below this are in every model; others when a model would break them
_RADIUS, _LARGEST, _SMALLEST = 0.3, 1.0, 1e-9  # of the trust region, in widths of the box
_PENALTY, _HIGHEST = 1.0, 1e6
_TIGHT = 10.0  # weight of active normals in what is made convex, in units of the largest curvature


@dataclass(frozen=True, eq=False)
class Warm:
    """Where a climb may begin beside its parameters: multipliers, penalty and radius of another one."""

    multipliers: Multipliers
    penalty: float = _PENALTY
    radius: float = _RADIUS


@dataclass(frozen=True, eq=False)
class Solution:
    """Where a climb stopped.

    objective: aim minus price by the program; violation: the largest shortfall of a margin; residual: largest entry of the
    projected gradient of the Lagrangian times the width of the box, in units of the aim.
    """

    p: np.ndarray
    objective: float
    violation: float
    status: Status
    iterations: int
    residual: float
    warm: Warm


def climb(
    program: Program,
    aim: AbstractAim,
    p: np.ndarray,
    warm: Warm | None = None,
    least: float = 0.0,
    iterations: int = ITERATIONS,
    deadline: float | None = None,
) -> Solution:
    """Maximise aim minus price from parameters p (q,); least: keep lambda_min of every matrix at or above this.

    deadline: of time.perf_counter; after it, the best point so far is returned as TIME_LIMIT.
    Source: sequential quadratic programming with a trust region and an exact penalty (Fletcher, 1985), its models with matrix
    inequalities where the aim is a smallest eigenvalue (Fares, Noll, Apkarian, 2002).
    """
    return _Climb(program, aim, least).run(p, warm, iterations, deadline)


@dataclass(frozen=True, eq=False)
class _Place:
    """A point with all that is known there; merit = penalised aim, less is better."""

    values: Values
    merit: float
    violation: float


@dataclass(frozen=True, eq=False)
class _Local:
    """The convex model's data at a place."""

    H: np.ndarray
    B: np.ndarray
    g: np.ndarray
    slopes: Slopes
    floors: np.ndarray
    floor_slopes: np.ndarray
    hard: np.ndarray
    hard_slopes: np.ndarray


class _Climb:
    """One climb: the program, its scale, and its penalty."""

    def __init__(self, program: Program, aim: AbstractAim, least: float) -> None:
        self.program, self.aim, self.least = program, aim, least
        self.width = program.upper - program.lower
        self.unit, self.penalty, self.radius = 1.0, _PENALTY, _RADIUS
        floor = program.problem.floor
        self.floor = np.inf if floor is None else floor.value

    def run(self, p: np.ndarray, warm: Warm | None, iterations: int, deadline: float | None) -> Solution:
        values = self.program.at(np.clip(p, self.program.lower, self.program.upper))
        self.unit = self.aim.unit(values.matrices)
        multipliers = self._first(values)
        if warm is not None:
            self.penalty, self.radius = warm.penalty, warm.radius
            multipliers = self._adopted(warm.multipliers, multipliers)
        place, status, done = self._place(values), Status.ITERATION_LIMIT, 0
        if not np.isfinite(place.merit):
            return self._solution(place, multipliers, Status.NUMERICAL_ERROR, 0)
        relaxed = 0
        while done < iterations:
            if deadline is not None and perf_counter() >= deadline:
                status = Status.TIME_LIMIT
                break
            done += 1
            local = self._local(place.values, multipliers)
            moved, step, promised = self._moved(place, local)
            if step is not None:
                multipliers = self._priced(place.values, step)
            if moved is None:
                status = self._verdict(place, step, promised)
                break
            if moved.violation <= FEASIBLE and relaxed < 6:
                enough = max(_PENALTY, 3 * float(multipliers.rows.sum()))
                if enough < self.penalty / 3:
                    self.penalty, relaxed = enough, relaxed + 1
                    moved = self._place(moved.values)
            before, place = self.unit, self._rescaled(moved)
            multipliers = multipliers.times(before / self.unit)
        return self._solution(place, multipliers, status, done)

    # ---------------------------------------------------------------- what a point is worth

    def _place(self, values: Values) -> _Place:
        violation = self._violation(values.rows, self._floors(values))
        value = value_of(self.aim, values.matrices)
        merit = (values.price - value) / self.unit + self.penalty * violation
        return _Place(values, float(merit) if np.isfinite(merit) else np.inf, violation)

    def _floors(self, values: Values) -> np.ndarray:
        """Matrices (f, n, n) that must be >= I."""
        kept = values.matrices[: len(values.matrices) if self.least else 0]
        return np.concatenate([values.floors / self.floor, kept / self.least if self.least else kept])

    def _violation(self, rows: np.ndarray, floors: np.ndarray) -> float:
        lowest = 1 - np.linalg.eigvalsh(floors)[:, 0].min() if len(floors) else 0.0
        return float(max(0.0, -rows.min(initial=0.0), lowest))

    def _rescaled(self, place: _Place) -> _Place:
        unit = self.aim.unit(place.values.matrices)
        if self.unit / 3 <= unit <= 3 * self.unit:
            return place
        self.unit = unit
        return self._place(place.values)

    # ---------------------------------------------------------------- multipliers

    def _first(self, values: Values) -> Multipliers:
        weights = weights_of(self.aim, values.matrices) / self.unit
        Z = self.aim.slopes(values.matrices) * weights[:, None, None]
        return Multipliers(np.nan_to_num(Z), np.zeros_like(values.floors), np.zeros(len(values.rows)), 1 / self.unit)

    @staticmethod
    def _adopted(other: Multipliers, own: Multipliers) -> Multipliers:
        pairs = ((other.matrices, own.matrices), (other.floors, own.floors), (other.rows, own.rows))
        return Multipliers(*(theirs if theirs.shape == mine.shape else mine for theirs, mine in pairs), own.price)

    def _priced(self, values: Values, step: Step) -> Multipliers:
        """Multipliers of a step, in units of the aim."""
        count, windows = len(values.matrices), len(values.floors)
        own = count if self.aim.is_cone else 0
        rows = np.zeros(len(values.rows))
        rows[self._working] = step.rows
        Z = np.array(step.Z) if step.Z else np.zeros((0, *values.matrices.shape[1:]))
        floors = Z[own : own + windows] / self.floor
        if self.aim.is_cone:
            matrices = Z[:own] / self.unit
        else:
            weights = step.hard if self.aim.worst and count > 1 else weights_of(self.aim, values.matrices)
            matrices = self.aim.slopes(values.matrices) * (weights / self.unit)[:, None, None]
        if self.least:
            matrices = matrices + Z[own + windows :] / self.least
        return Multipliers(matrices, floors, rows, 1 / self.unit)

    # ---------------------------------------------------------------- the model

    def _local(self, values: Values, multipliers: Multipliers) -> _Local:
        slopes = self.program.slopes(values)
        kept = slopes.matrices[: len(values.matrices) if self.least else 0]
        floor_slopes = np.concatenate([slopes.floors / self.floor, kept / self.least if self.least else kept])
        g = slopes.price / self.unit
        H = self.program.curvature(values, slopes, multipliers)
        hard, hard_slopes = np.zeros(0), np.zeros((0, self.program.q))
        if not self.aim.is_cone:
            Z = self.aim.slopes(values.matrices)
            towards = np.einsum("bij,bqij->bq", Z, slopes.matrices) / self.unit
            bent = self.aim.curvatures(values.matrices, slopes.matrices) / self.unit
            several = self.aim.worst and len(values.matrices) > 1
            weights = weights_of(self.aim, values.matrices)
            H = H + np.einsum("b,bij->ij", weights, bent)
            if several:
                hard, hard_slopes = self.aim.each(values.matrices) / self.unit, towards
            else:
                g = g - weights @ towards
        B = _convex(H * np.outer(self.width, self.width), self._normals(slopes, multipliers)) / np.outer(self.width, self.width)
        return _Local(H, B, g, slopes, self._floors(values), floor_slopes, hard, hard_slopes)

    def _normals(self, slopes: Slopes, multipliers: Multipliers) -> np.ndarray:
        """Directions (k, q), in widths of the box, along which the model is held anyway: their curvature need not be convex."""
        rows = slopes.rows[multipliers.rows > 1e-6]
        found = [rows * self.width]
        if self.aim.is_cone:
            for Z, D in zip(multipliers.matrices, slopes.matrices, strict=True):
                found.append(_equal_eigenvalues(Z, D) * self.width)
        held = np.eye(len(self.width))[self._held] if self._held is not None else np.zeros((0, len(self.width)))
        return np.vstack([*found, held])

    _held: np.ndarray | None = None
    _working: np.ndarray = np.zeros(0, dtype=int)

    def _cones(self, values: Values, local: _Local) -> Iterator[Cone]:
        n, count = values.matrices.shape[-1], len(values.matrices)
        if self.aim.is_cone:
            E = self.aim.edge(n)
            for i in range(count):
                yield Cone(values.matrices[i] / self.unit, local.slopes.matrices[i] / self.unit, E, 0 if self.aim.worst else i, 0.0)
        for F, D in zip(local.floors, local.floor_slopes, strict=True):
            yield Cone(F - np.eye(n), D, np.eye(n), None, 1.0)

    def _weights(self, count: int) -> np.ndarray:
        if self.aim.is_cone:
            return np.ones(1) if self.aim.worst else np.full(count, 1 / count)
        return np.ones(1) if self.aim.worst and count > 1 else np.zeros(0)

    # ---------------------------------------------------------------- one step

    def _moved(self, place: _Place, local: _Local) -> tuple[_Place | None, Step | None, float]:
        """Return the next place (None: nothing better is near), the step's model solution, and what it promised."""
        last, promised = None, 0.0
        while self.radius > _SMALLEST:
            step = self._solved(place.values, local, self.radius)
            if step is None:
                self.radius /= 4
                continue
            step, place = self._steered(place, local, step)
            last, promised = step, place.merit - self._promise(place.values, local, step)
            if promised <= _TOLERANCE * max(1.0, abs(place.merit)):
                return None, last, promised
            moved, gained = self._tried(place, local, step)
            sharper = self._sharpened(place, local, step)
            if sharper is not None and place.merit - sharper.merit > max(gained, 0.0):
                self.sharp += 1
                moved, gained = sharper, place.merit - sharper.merit
            length = float(np.max(np.abs(step.d) / self.width))
            if gained > 0.05 * promised:
                if gained > 0.7 * promised and length > 0.8 * self.radius:
                    self.radius = min(_LARGEST, 2.5 * self.radius)
                elif gained < 0.3 * promised:
                    self.radius = 0.5 * length
                self._held = step.bounds > 1e-6
                return moved, last, promised
            self.radius = 0.35 * min(length, self.radius)
        return None, last, promised

    def _steered(self, place: _Place, local: _Local, step: Step) -> tuple[Step, _Place]:
        """Raise the penalty for as long as that makes the model's solution less infeasible (Byrd, Nocedal, Waltz, 2008)."""
        while step.e > FEASIBLE / 10 and self.penalty < _HIGHEST:
            before, self.penalty, working = self.penalty, 10 * self.penalty, self._working
            harder = self._solved(place.values, local, self.radius)
            if harder is None or harder.e > 0.9 * step.e:
                self.penalty, self._working = before, working
                break
            step, place = harder, self._place(place.values)
        return step, place

    def _tried(self, place: _Place, local: _Local, step: Step) -> tuple[_Place, float]:
        """Return the better of the step, its second-order correction and its continuation, and the gain in merit."""
        promised = place.merit - self._promise(place.values, local, step)
        moved = self._place(self._at(place.values.p + step.d))
        gained = place.merit - moved.merit
        if gained < 0.25 * promised:
            corrected = self._corrected(place, local, step, moved)
            if corrected is not None and corrected.merit < moved.merit:
                return corrected, place.merit - corrected.merit
        factor = 2.0
        while gained > 1.3 * promised and factor <= 16:
            further = self._place(self._at(place.values.p + factor * step.d))
            if not further.merit < moved.merit:
                break
            moved, gained, factor = further, place.merit - further.merit, 2 * factor
        return moved, gained

    def _sharpened(self, place: _Place, local: _Local, step: Step) -> _Place | None:
        """Newton's step on what the model's solution holds active, cut to the trust region's largest size."""
        values, working = place.values, self._working
        kept = step.rows > 1e-6
        cones = list(self._cones(values, local))
        faces = [Face(cone.A, cone.D, cone.E, cone.j, Z) for cone, Z in zip(cones, step.Z, strict=True) if np.trace(Z) > 1e-6]
        chosen = step.hard > 1e-6
        held = step.bounds > 1e-6
        at_bound = held & (np.abs(step.d) < 0.999 * self.radius * self.width)
        active = Active(
            local.H,
            local.g,
            self._weights(len(values.matrices)),
            faces,
            values.rows[working][kept],
            local.slopes.rows[working][kept],
            local.hard[chosen],
            local.hard_slopes[chosen],
            at_bound,
            step.d,
        )
        d = newton(active)
        if d is None:
            return None
        length = float(np.max(np.abs(d) / self.width))
        if length > 2 * self.radius:
            return None
        return self._place(self._at(values.p + d))

    sharp = 0

    def _at(self, p: np.ndarray) -> Values:
        return self.program.at(np.clip(p, self.program.lower, self.program.upper))

    def _corrected(self, place: _Place, local: _Local, step: Step, moved: _Place) -> _Place | None:
        """The step again, with limits and matrices as they turned out at its end."""
        values, slopes, d = moved.values, local.slopes, step.d
        if not np.isfinite(moved.merit):
            return None
        shifted = Values(
            values.p,
            values.along,
            values.windows,
            values.matrices - np.tensordot(d, slopes.matrices, (0, 1)),
            values.floors - np.tensordot(d, slopes.floors, (0, 1)),
            values.rows - slopes.rows @ d,
            values.price,
        )
        floors = self._floors(values) - np.tensordot(d, local.floor_slopes, (0, 1))
        hard = self.aim.each(values.matrices) / self.unit - local.hard_slopes @ d if len(local.hard) else local.hard
        again = _Local(local.H, local.B, local.g, local.slopes, floors, local.floor_slopes, hard, local.hard_slopes)
        found = self._minimised(shifted, again, place.values.p, self.radius)
        return None if found is None else self._place(self._at(place.values.p + found.d))

    def _solved(self, values: Values, local: _Local, radius: float) -> Step | None:
        """Solve the model with the margins that are near; take in those that its solution would break."""
        self._working = np.flatnonzero(values.rows < _NEAR)
        while True:
            step = self._minimised(values, local, values.p, radius)
            if step is None:
                return None
            after = values.rows + local.slopes.rows @ step.d + step.e
            broken = np.setdiff1d(np.flatnonzero(after < -FEASIBLE / 10), self._working)
            if not broken.size:
                return step
            self._working = np.union1d(self._working, broken)

    def _minimised(self, values: Values, local: _Local, p: np.ndarray, radius: float) -> Step | None:
        program, working = self.program, self._working
        model = Model(
            local.B,
            local.g,
            self._weights(len(values.matrices)),
            self.penalty,
            np.maximum(program.lower - p, -radius * self.width),
            np.minimum(program.upper - p, radius * self.width),
            tuple(self._cones(values, local)),
            values.rows[working],
            local.slopes.rows[working],
            local.hard,
            local.hard_slopes,
        )
        return minimised(model, 1e-9)

    def _promise(self, values: Values, local: _Local, step: Step) -> float:
        """The model's merit at the step, recomputed: a solver's objective is a claim."""
        d = step.d
        rows = values.rows + local.slopes.rows @ d
        floors = local.floors + np.tensordot(d, local.floor_slopes, (0, 1))
        value = 0.0
        if self.aim.is_cone:
            value = value_of(self.aim, values.matrices + np.tensordot(d, local.slopes.matrices, (0, 1))) / self.unit
        elif len(local.hard):
            value = float((local.hard + local.hard_slopes @ d).min())
        else:
            value = value_of(self.aim, values.matrices) / self.unit
        rest = local.g @ d + 0.5 * d @ local.B @ d + values.price / self.unit
        return float(rest - value + self.penalty * self._violation(rows, floors))

    # ---------------------------------------------------------------- the end

    def _verdict(self, place: _Place, step: Step | None, promised: float) -> Status:
        if step is None:
            return Status.NUMERICAL_ERROR
        settled = promised <= 1e-6 * max(1.0, abs(place.merit))
        if place.violation > 1e-6:
            return Status.LOCALLY_INFEASIBLE if settled or self.penalty >= _HIGHEST else Status.NUMERICAL_ERROR
        return Status.LOCALLY_OPTIMAL if settled else Status.NUMERICAL_ERROR

    def _solution(self, place: _Place, multipliers: Multipliers, status: Status, iterations: int) -> Solution:
        values = place.values
        objective = value_of(self.aim, values.matrices) - values.price
        warm = Warm(multipliers, min(self.penalty, 100.0), max(self.radius, 1e-3))
        return Solution(values.p, objective, place.violation, status, iterations, self._residual(values, multipliers), warm)

    def _residual(self, values: Values, multipliers: Multipliers) -> float:
        slopes = self.program.slopes(values)
        g = slopes.price / self.unit - np.einsum("bij,bqij->q", multipliers.matrices, slopes.matrices)
        g -= np.einsum("bij,bqij->q", multipliers.floors, slopes.floors) + multipliers.rows @ slopes.rows
        moved = np.clip(values.p / self.width - g * self.width, self.program.lower / self.width, self.program.upper / self.width)
        found = np.abs(moved - values.p / self.width).max(initial=0.0)
        return float(found) if np.isfinite(found) else float("nan")


def _equal_eigenvalues(Z: np.ndarray, D: np.ndarray) -> np.ndarray:
    """Return the slopes (k, q) of the differences that stay 0 where eigenvalues coincide, their vectors being those of Z."""
    values, vectors = np.linalg.eigh(Z)
    U = vectors[:, values > 1e-3 * max(values[-1], 1e-300)]
    k = U.shape[1]
    if k < 2 or values[-1] <= 0:
        return np.zeros((0, len(D)))
    R = U.T @ D @ U
    upper = np.triu_indices(k, 1)
    return np.vstack([R[:, upper[0], upper[1]].T, (R[:, np.arange(1, k), np.arange(1, k)] - R[:, :1, 0]).T])


def _convex(H: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Return H with the negative curvature taken out that is not along the normals (k, q)."""
    size = np.abs(H).max(initial=0.0)
    if not size > 0:
        return 1e-8 * np.eye(len(H))
    held = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    values, vectors = np.linalg.eigh(H + _TIGHT * size * held.T @ held)
    return (vectors * np.maximum(values, 1e-7 * size)) @ vectors.T
