"""What is asked of a path, and what came out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.checks import as_pair, require_known, require_positive, whole_multiple
from obsdesign.constraints.abstract import AbstractConstraint, Coordinate
from obsdesign.criteria.abstract import AbstractCriterion
from obsdesign.criteria.min_eigenvalue import MinEigenvalue
from obsdesign.errors import InputError
from obsdesign.information.posterior import posterior_information
from obsdesign.information.record import Information
from obsdesign.information.totals import segment_information
from obsdesign.model import AbstractSystem
from obsdesign.paths.abstract import AbstractPath
from obsdesign.simulation import as_scale, as_state
from obsdesign.status import Status
from obsdesign.trajectory import Trajectory

FEASIBILITY = 1e-6  # by how much a constraint's margin, of order 1, may fall short


@dataclass(frozen=True, eq=False)
class DesignProblem:
    """Maximise criterion(S W S) over paths of one family, W from all samples of all sensors.

    start (n,); duration, step [s]; bounds: input -> (low, high); scale (n,): the diagonal of S, what counts as one unit of
    each state (None = ones, usually the prior's standard deviations).
    Raises InputError for names, shapes and values that do not fit together.
    """

    system: AbstractSystem
    start: ArrayLike
    duration: float
    step: float
    path: AbstractPath
    bounds: Mapping[str, tuple[float, float]]
    criterion: AbstractCriterion = field(default_factory=MinEigenvalue)
    scale: ArrayLike | None = None
    constraints: tuple[AbstractConstraint, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "start", as_state(self.system, self.start, "start"))
        object.__setattr__(self, "scale", as_scale(self.system, self.scale))
        object.__setattr__(self, "constraints", tuple(self.constraints))
        object.__setattr__(self, "bounds", {name: as_pair(f"bounds of {name}", pair) for name, pair in self.bounds.items()})
        require_positive("duration", self.duration)
        require_positive("step", self.step)
        if whole_multiple(self.duration, self.step) is None:
            raise InputError(f"duration {self.duration:g} s is no whole multiple of the step {self.step:g} s")
        self.path.rows(self.steps)
        self._check_bounds()
        self._check_start()

    @property
    def steps(self) -> int:
        """N."""
        return round(self.duration / self.step)

    @property
    def x0(self) -> np.ndarray:
        """The start as an array (n,)."""
        return np.asarray(self.start)

    @property
    def units(self) -> np.ndarray:
        """The diagonal of S (n,)."""
        return np.asarray(self.scale)

    @property
    def lower(self) -> np.ndarray:
        """Lower bound of each known input (m,)."""
        return np.array([self.bounds[name][0] for name in self.system.model.input_names], dtype=float)

    @property
    def upper(self) -> np.ndarray:
        """Upper bound of each known input (m,)."""
        return np.array([self.bounds[name][1] for name in self.system.model.input_names], dtype=float)

    def scaled(self, W: np.ndarray) -> np.ndarray:
        """S W S (..., n, n), without unit."""
        return W * self.units[:, None] * self.units

    def value(self, path: Trajectory) -> float:
        """criterion(S W S) of a path, recomputed by the analysis code."""
        return self.criterion.value(self.scaled(self.judged(path)))

    def judged(self, path: Trajectory) -> np.ndarray:
        """Return the matrix (n, n) that the criterion judges: W about x(t_0), or J after the last samples."""
        known = self.criterion.knowledge
        if known is None:
            return segment_information(self.system, path, 1)[0].sum(axis=0)
        return posterior_information(self.system, path, known.prior, known.disturbance_psd, known.unknown_inputs)[-2]

    def margins(self, x: np.ndarray) -> np.ndarray:
        """All constraint margins of the states x (N+1, n); a path is feasible where all are >= 0."""
        found = margins_of(self, *(x[:, i] for i in self.position)) if self.constraints else []
        return np.concatenate([np.ravel(margin) for margin in found]) if found else np.zeros(0)

    def is_feasible(self, x: np.ndarray) -> bool:
        """Whether the states x (N+1, n) satisfy every constraint to 1e-6 of its size."""
        return bool(self.margins(x).min(initial=0.0) >= -FEASIBILITY)

    @property
    def position(self) -> tuple[int, int]:
        """Where x and y stand in the state; raises InputError for a system without them."""
        names = self.system.model.state_names
        require_known("constraints: the state", ("x", "y"), names)
        return names.index("x"), names.index("y")

    def _check_bounds(self) -> None:
        names = self.system.model.input_names
        require_known("bounds", tuple(self.bounds), names)
        for name in names:
            if name not in self.bounds:
                raise InputError(f"bounds of {name} are missing: every known input needs (low, high)")
            low, high = self.bounds[name]
            if low >= high:
                raise InputError(f"bounds of {name} are ({low:g}, {high:g}): low must be below high")

    def _check_start(self) -> None:
        east, north = (self.x0[list(self.position)]) if self.system.model.landmarks or self.constraints else (0.0, 0.0)
        for point in self.system.model.landmarks:
            if (east, north) == tuple(point):
                raise InputError(f"start lies on the landmark {point}: range and bearing have no derivative there")
        for constraint in self.constraints:
            if min(constraint.at_nodes(east, north, self.system.model.landmarks), default=0.0) < 0:
                raise InputError(f"start ({east:g}, {north:g}) violates {constraint}")

    @cached_property
    def _key(self) -> tuple[object, ...]:
        bounds = tuple(sorted(self.bounds.items()))
        arrays = (self.x0.tobytes(), self.units.tobytes())
        return self.system, arrays, self.duration, self.step, self.path, bounds, self.criterion, self.constraints

    def __eq__(self, other: object) -> bool:
        return isinstance(other, DesignProblem) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)


def margins_of(problem: DesignProblem, x: Coordinate, y: Coordinate) -> list[Coordinate]:
    """Return the margins of all constraints for coordinates (N+1,), numerical or symbolic."""
    landmarks = problem.system.model.landmarks
    nodes = [margin for constraint in problem.constraints for margin in constraint.at_nodes(x, y, landmarks)]
    return nodes + [margin for constraint in problem.constraints for margin in constraint.at_end(x[-1], y[-1])]


@dataclass(frozen=True)
class Cap:
    """An upper bound on lambda_min(S W S) of every path: the smallest eigenvalue of a block that no path changes."""

    value: float
    states: tuple[str, ...]


@dataclass(frozen=True)
class Start:
    """One start of the solver: where it began, how it ended, the recomputed value (NaN without an answer)."""

    name: str
    status: Status
    value: float
    iterations: int
    residual: float  # scaled KKT residual that IPOPT reports at its last iterate


@dataclass(frozen=True, eq=False)
class Design:
    """The best path found. value = criterion(S W S), recomputed by the analysis code; NaN without an answer.

    trajectory and information are None when no start found an answer; `starts` tells what each did.
    """

    problem: DesignProblem
    trajectory: Trajectory | None
    information: Information | None
    value: float
    status: Status
    starts: tuple[Start, ...]
    cap: Cap | None

    @property
    def reaches_cap(self) -> bool:
        """Whether the value lies within 1e-6 of its cap, so that no path does better."""
        return self.cap is not None and self.value >= self.cap.value * (1 - 1e-6)
