"""What is asked of a path."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.arguments import validate_arguments
from obsdesign.checks import as_array, as_pair, require_tolerance
from obsdesign.constraints.abstract import AbstractConstraint
from obsdesign.costs._price_budget import Budget, Price
from obsdesign.criteria.abstract import AbstractCriterion
from obsdesign.criteria.min_eigenvalue import MinEigenvalue
from obsdesign.design.floor import Floor
from obsdesign.design.objective import PathObjective
from obsdesign.design.problem_checks import (
    Durations,
    position_of,
    require_costs,
    require_inputs,
    require_known_information,
    require_map,
    require_one_knowledge,
    require_posterior,
    require_start,
    require_states,
    require_times,
    require_weights,
)
from obsdesign.design.robust import Robust
from obsdesign.design.substeps import substeps_within_bounds
from obsdesign.display import AbstractDisplay, Summary, number, numbers
from obsdesign.dynamics.model import AbstractSystem
from obsdesign.dynamics.simulation import as_scale, as_state, simulate
from obsdesign.paths.abstract import AbstractPath, Grid
from obsdesign.trajectory import TOLERANCE, Trajectory


@validate_arguments
@dataclass(frozen=True, eq=False)
class DesignProblem(AbstractDisplay):
    """Which path tells the most: maximise criterion(S W S) minus prices over the paths of one family, W from all samples of all sensors.

    S = diag(scale). With `about`, W is the Schur complement W_aa - W_ab W_bb^-1 W_ba of the judged states a.
    Raises InputError for names, shapes and values that do not fit together.
    """

    system: AbstractSystem
    """Vehicle and sensors."""
    start: ArrayLike
    """Initial state (n,), in the units of the states."""
    duration: float | tuple[float, float]
    """Length of the path [s], or (shortest, longest) to choose from."""
    step: float
    """Length of a step [s]: inputs are held over it, samples fall on its ends."""
    path: AbstractPath
    """The family of inputs that is searched."""
    bounds: Mapping[str, tuple[float, float]]
    """Input -> (low, high), in its unit."""
    criterion: AbstractCriterion = field(default_factory=MinEigenvalue)
    """What is asked of S W S."""
    scale: ArrayLike | None = None
    """The diagonal of S (n,), what counts as one unit of each state; None = ones, usually the prior's standard deviations."""
    constraints: tuple[AbstractConstraint, ...] = ()
    """Limits on where the path goes and how."""
    rates: Mapping[str, float] = field(default_factory=dict)
    """Input -> largest |du/dt| [unit/s]."""
    about: tuple[str, ...] = ()
    """The states that are judged while the others are estimated as well; () = all."""
    prices: tuple[Price, ...] = ()
    """What costs take off the criterion."""
    budgets: tuple[Budget, ...] = ()
    """What costs may come to at most."""
    floor: Floor | None = None
    """Information that every stretch of the path must have."""
    robust: Robust | None = None
    """Judge the path from draws of a prior rather than from the start alone."""
    known: ArrayLike | None = None
    """Information (n, n) about x(t_0) that is already there, added to W, in 1/(unit_i unit_j); None = none."""
    weights: ArrayLike | None = None
    """How much the samples of each sensor count (K, S) in each of K equal groups of steps, such as a schedule; None = all of them, once. At
    most 1, the share of them that is there, for a sensor whose errors are not independent; 0 or 1, off or on, for `Posterior`.
    """
    tolerance: float = TOLERANCE
    """Relative error that steps may have, as in simulate, in (0, 1)."""

    def _summary(self) -> Summary:
        names = [state.name for state in self.system.model.states]
        shortest, longest = self.shortest, self.longest
        limits = [type(limit).__name__ for limit in (*self.constraints, *(budget.cost for budget in self.budgets))]
        rows = [
            ("start", numbers(names, self.x0)),
            ("duration", number(longest, "s") if shortest == longest else f"{number(shortest, 's')} to {number(longest, 's')}"),
            ("path", f"{self.path}, steps of {number(self.step, 's')}"),
            ("bounds", ", ".join(f"{name} {number(low)} to {number(high)}" for name, (low, high) in self.bounds.items())),
            ("criterion", f"{self.criterion}" + (f" of {', '.join(self.about)}" if self.about else "")),
            ("limits", ", ".join(limits) or "none"),
        ]
        return Summary("design problem", tuple(rows))

    def __post_init__(self) -> None:
        set_field = object.__setattr__
        require_tolerance(self.tolerance)
        set_field(self, "start", as_state(self.system, self.start, "start"))
        set_field(self, "scale", as_scale(self.system, self.scale))
        for name in ("constraints", "about", "prices", "budgets"):
            set_field(self, name, tuple(getattr(self, name)))
        set_field(self, "bounds", {name: as_pair(f"bounds of {name}", pair) for name, pair in self.bounds.items()})
        set_field(self, "rates", dict(self.rates))
        set_field(self, "known", np.zeros((self.x0.size,) * 2) if self.known is None else as_array("known", self.known))
        if not isinstance(self.duration, (int, float)):
            set_field(self, "duration", as_pair("duration", self.duration))
        set_field(self, "weights", self._as_weights())
        self._require_consistent()

    def _require_consistent(self) -> None:
        """Raise InputError for the first thing that does not fit."""
        model, durations, knowledge = self.system.model, Durations(self.shortest, self.longest, self.step), self.criterion.knowledge
        require_times(durations, self.floor, self.constraints)
        require_inputs(model.input_names, self.bounds, self.rates)
        costs = [term.cost for term in (*self.prices, *self.budgets)]
        require_costs(model, self.grid.centre, costs)
        require_map(model, self.step, self.x0, self.grid.centre, (*self.constraints, *costs))
        require_states(model.state_names, self.about)
        require_known_information(np.asarray(self.known), len(model.states))
        require_one_knowledge(model.state_names, knowledge, self.robust, self.floor)
        require_posterior(knowledge, np.asarray(self.known), durations)
        require_weights(None if self.weights is None else np.asarray(self.weights), model, durations, knowledge, self.robust)
        self.path.box(self.grid)
        require_start(model, self.x0, self.constraints)

    def _as_weights(self) -> np.ndarray | None:
        """Weights (K, S) as an array, None where all are 1: then nothing is weighed, not even in the order of sums."""
        weights = None if self.weights is None else as_array("weights", self.weights)
        return None if weights is None or (weights.ndim == 2 and weights.size and (weights == 1).all() and self._fits(weights)) else weights

    def _fits(self, weights: np.ndarray) -> bool:
        """Whether the columns are the sensors, and the rows equal groups of steps."""
        return weights.shape[1] == len(self.system.model.channels) and self.steps % len(weights) == 0

    @property
    def shortest(self) -> float:
        """The shortest duration [s]."""
        return self.duration[0] if isinstance(self.duration, tuple) else self.duration

    @property
    def longest(self) -> float:
        """The longest duration [s]."""
        return self.duration[1] if isinstance(self.duration, tuple) else self.duration

    def with_duration(self, duration: float) -> DesignProblem:
        """Return the problem with one duration [s]."""
        return replace(self, duration=duration)

    @property
    def steps(self) -> int:
        """N; of the longest duration where there is a choice."""
        return round(self.longest / self.step)

    @cached_property
    def substeps(self) -> int:
        """Of how many sub-steps the steps of the program are made; a path that was found is judged with as many as it needs itself."""
        return substeps_within_bounds(self.system, self.x0, self.grid, self.tolerance)

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

    @property
    def grid(self) -> Grid:
        """What the path family fills with inputs."""
        return Grid(self.system.model.input_names, tuple(self.lower.tolist()), tuple(self.upper.tolist()), self.steps, self.step)

    @property
    def about_indices(self) -> np.ndarray:
        """Indices of the states that are judged."""
        names = self.system.model.state_names
        return np.array([names.index(name) for name in self.about or names])

    # ---------------------------------------------------------------- paths

    def inputs_of(self, p: np.ndarray) -> np.ndarray:
        """Return the inputs u (N, m) of parameters p (q,) of the family."""
        u: Any = self.path.inputs(p, self.grid)  # pyright: ignore[reportArgumentType]  # serves numbers and symbols
        return np.asarray(u, dtype=float).reshape(self.steps, -1)

    def path_along(self, u: np.ndarray) -> Trajectory:
        """Return the path from the start with inputs u (N, m), of any length."""
        return simulate(self.system, self.x0, u, self.step, tolerance=self.tolerance)

    def path_of(self, p: np.ndarray) -> Trajectory:
        """Return the path of parameters p (q,) of the family."""
        return self.path_along(self.inputs_of(p))

    # ---------------------------------------------------------------- what is maximised

    @cached_property
    def _objective(self) -> PathObjective:
        weights = None if self.weights is None else np.asarray(self.weights)
        return PathObjective(
            system=self.system,
            step=self.step,
            tolerance=self.tolerance,
            criterion=self.criterion,
            units=self.units,
            known=np.asarray(self.known),
            judged=self.about_indices,
            weights=weights,
            prices=self.prices,
            robust=self.robust,
        )

    def scaled(self, W: np.ndarray) -> np.ndarray:
        """S W S (..., n, n), without unit, of information W (..., n, n)."""
        return self._objective.scaled(W)

    def criterion_matrix(self, W: np.ndarray) -> np.ndarray:
        """S (W + known) S (..., n, n), without unit: what of the samples' information W (..., n, n) and of `known` the criterion sees."""
        return self._objective.criterion_matrix(W)

    def criterion_value(self, W: np.ndarray) -> float:
        """Return the criterion of information W (n, n): of S (W + known) S, about the judged states."""
        return self._objective.criterion_value(W)

    def information_matrix(self, path: Trajectory) -> np.ndarray:
        """Return the matrix (n, n) that the criterion judges of a path: W about x(t_0), or J after the last samples."""
        return self._objective.information_matrix(path)

    def matrix(self, path: Trajectory) -> np.ndarray:
        """S (W + known) S (n, n) of a path."""
        return self._objective.matrix(path)

    def value(self, path: Trajectory) -> float:
        """criterion(S (W + known) S) of a path, recomputed by the analysis code; prices are not in it."""
        return self._objective.value(path)

    def values(self, starts: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Return the value (R,) of the path from each of the starts (R, n), with inputs u (N, m), or (R, N, m) for each its own."""
        return self._objective.values(starts, u)

    def price(self, path: Trajectory) -> float:
        """Return what the criterion loses to prices along a path."""
        return self._objective.price(path)

    def objective(self, path: Trajectory) -> float:
        """Return what is maximised, recomputed: the criterion of a path, or of the prior's draws along its inputs, minus prices."""
        return self._objective.objective(path)

    @property
    def position(self) -> tuple[int, int]:
        """Where x and y stand in the state; raises InputError for a system without them."""
        return position_of(self.system.model.state_names)

    @cached_property
    def _key(self) -> tuple[object, ...]:
        tables = tuple(sorted(self.bounds.items())), tuple(sorted(self.rates.items()))
        weights = None if self.weights is None else (np.asarray(self.weights).shape, np.asarray(self.weights).tobytes())
        arrays = (self.x0.tobytes(), self.units.tobytes(), np.asarray(self.known).tobytes(), weights)
        asked = self.criterion, self.about, self.constraints, self.prices, self.budgets, self.floor, self.robust
        return self.system, arrays, self.duration, self.step, self.tolerance, self.path, tables, asked

    def __eq__(self, other: object) -> bool:
        return isinstance(other, DesignProblem) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)
