"""What is asked of a schedule for the filter: checked arguments, segments, and the cost of covariances along a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.checks import as_array, require_known, require_within
from obsdesign.criteria.abstract import AbstractCriterion, Over
from obsdesign.dynamics.model import AbstractSystem
from obsdesign.dynamics.path_segments import segments_along
from obsdesign.errors import InputError
from obsdesign.information.backward_pass import require_trace
from obsdesign.information.information_update import Disturbance
from obsdesign.information.linear_model import LinearModel, linear_model_of
from obsdesign.information.posterior import disturbance_of
from obsdesign.information.root_recursion import posterior_roots
from obsdesign.logs.log import Log
from obsdesign.noise_density import DisturbancePsd, InputPsd
from obsdesign.prior import Prior
from obsdesign.rules.abstract import Segments
from obsdesign.selection.posterior.filter_path import filter_path, segment_nodes, weights_over
from obsdesign.selection.posterior.instant_costs import InstantCosts
from obsdesign.trajectory import Trajectory

UNKNOWN_SPREADS = (1e3 / 3, 1e4 / 3, 1e5 / 3, 1e6 / 3)  # no round numbers: what rounding does has to show
"""What may stand for an unknown input: the larger, the nearer to one, and the more digits are lost."""
_TRUSTED = 1e-6  # of a log det, and of 1: how far it may be from the same in another order of the states
_FAR_APART = 1e100  # times a standard deviation at first: what may count as one unit at most, and one part of it at least


@dataclass(frozen=True, eq=False)
class FilterQuestion:
    """A run, what is known and what moves the state, and which segments may have which samples.

    nodes (K+1,): where segments begin and end, counted in steps; arrivals (N, S): how often samples count where a sensor is on, 0 without
    one; path_nodes: which of the N instants are those of the path that was given;
    unknown_spread: how many of the prior's deviations an unknown input moves some state by in a step, in place of any distance; floors
    (S,): what the mean error of a sensor within a segment never falls below, 0 = nothing, which counts where schedules are chosen;
    unknown_error: the share of a cost that rounding adds to it with that spread. notes: what is said of all this in the answer.
    """

    system: AbstractSystem
    path: Trajectory
    prior: Prior
    disturbance_psd: DisturbancePsd
    unknown_inputs: tuple[str, ...]
    input_psd: InputPsd
    arrivals: np.ndarray
    nodes: np.ndarray
    costs: InstantCosts
    floors: np.ndarray
    path_nodes: np.ndarray
    unknown_spread: float = UNKNOWN_SPREADS[0]
    unknown_error: float = 0.0
    notes: tuple[str, ...] = ()

    @cached_property
    def segments(self) -> Segments:
        """What rules know of the segments."""
        return segments_along(self.system.model, self.path, self.nodes)

    @cached_property
    def disturbance(self) -> Disturbance:
        """What moves the state beside its inputs."""
        return disturbance_of(self.system, self.path, self.prior, self.disturbance_psd, self.unknown_inputs, self.input_psd)

    @cached_property
    def linear_model(self) -> LinearModel:
        """The model along the path; unknown inputs get a large variance in place of an infinite one, so that bounds stay below."""
        return self.model_with(self.unknown_spread)

    def model_with(self, unknown_spread: float) -> LinearModel:
        """Return the model along the path with so large a spread of unknown inputs."""
        model = self._known_model
        deviations = np.sqrt(np.diag(model.initial_covariance))
        size = np.abs(model.unknown_columns / deviations[:, None]).max(axis=(0, 1), initial=0.0)
        return model.with_unknown_inputs((unknown_spread / np.where(size > 0, size, 1.0)) ** 2)

    @cached_property
    def _known_model(self) -> LinearModel:
        """The model along the path in which unknown inputs are 0."""
        return self._model_without_floors.with_floors(self.floors, self.nodes)

    @cached_property
    def _model_without_floors(self) -> LinearModel:
        return linear_model_of(self.system, self.path, self.prior, self.disturbance, self.arrivals)

    @property
    def answers(self) -> np.ndarray:
        """Which sensors have a sample at all in a segment (K, S)."""
        return np.add.reduceat(self.arrivals, self.nodes[:-1], axis=0) > 0

    @property
    def is_relative(self) -> bool:
        """Whether gaps are shares of the cost."""
        return self.costs.criterion.gap_kind == "relative"

    def gap_between(self, value: float, bound: float) -> float:
        """Return how far a cost may be from the best: 1 - bound / value, or the difference of log dets."""
        if value == bound:
            return 0.0
        return 1 - bound / value if self.is_relative else value - bound

    def least_costs(self, may_be_on: np.ndarray) -> np.ndarray:
        """Return what no schedule is below in each segment (K,): the cost with all sensors on that may be (K, S)."""
        return self.costs.by_segment(self.instant_costs(may_be_on), self.nodes)

    def active(self, chosen: np.ndarray) -> np.ndarray:
        """Return which samples a schedule (K, S) has (N, S)."""
        return np.repeat(chosen, np.diff(self.nodes), axis=0) & (self.arrivals > 0)

    def roots(self, chosen: np.ndarray) -> np.ndarray:
        """Return R (N, n, n), R'R the information about x(t_k) after the samples at t_k of a schedule (K, S); 0 where numbers run away."""
        active = self.active(chosen) * self.arrivals
        try:
            return posterior_roots(self.system, self.path, self.prior, self.disturbance, active)[:-1]
        except InputError:  # what is unstable was not seen for too long: nothing is known; derivatives were asked for with the model
            n = self.path.x.shape[1]
            return np.zeros((self.path.steps, n, n))

    def deviations(self, chosen: np.ndarray) -> np.ndarray:
        """Return the standard deviations (N, n) after the samples at t_k of a schedule (K, S); inf for what is hidden."""
        return self._deviations(chosen, self.roots(chosen))

    def _deviations(self, chosen: np.ndarray, roots: np.ndarray) -> np.ndarray:
        """Return the standard deviations (N, n) of roots; of covariances where roots lost sight of what the prior knows.

        Without unknown inputs nothing is ever hidden: what has no variance in R'R is below the rounding of what is known better.
        """
        deviations = deviations_of_roots(roots)
        if self.disturbance.unknown or np.isfinite(deviations).all():
            return deviations
        of_covariances = np.linalg.norm(self._covariance_roots(chosen), axis=2)[:, : deviations.shape[1]]
        return np.where(np.isfinite(deviations), deviations, of_covariances)

    def _covariance_roots(self, chosen: np.ndarray, is_reversed: bool = False) -> np.ndarray:
        """Return roots B (N, n, n) of covariances B B' without floors; inf where they grow beyond all numbers.

        is_reversed: computed with the states in reverse order, so that rounding differs.
        """
        model = self._model_without_floors
        order = np.arange(len(model.initial_covariance))[:: -1 if is_reversed else 1]
        with np.errstate(over="ignore", invalid="ignore"):
            roots = model.in_order(order).covariance_roots(self.active(chosen))[:, order]
        return np.where(np.isfinite(roots).all(axis=(1, 2), keepdims=True), roots, np.inf)

    def schedule_cost(self, chosen: np.ndarray) -> float:
        """Return the cost of a schedule (K, S), without what switching costs; with floors of the model that has them.

        inf where a state asked about is hidden at an instant that counts.
        """
        return self.costs.together(self.instant_costs(chosen))

    def rating(self, chosen: np.ndarray) -> tuple[float, np.ndarray]:
        """Return `schedule_cost` and `deviations` of a schedule (K, S)."""
        roots = self.roots(chosen)
        costs = self._costs_with_floors(chosen) if self.floors.any() else self._costs_of_roots(chosen, roots)
        return self.costs.together(costs), self._deviations(chosen, roots)

    def instant_costs(self, chosen: np.ndarray) -> np.ndarray:
        """Return what each instant that counts adds to the cost of a schedule (k,); inf where a state asked about is hidden."""
        if self.floors.any():
            return self._costs_with_floors(chosen)
        return self._costs_of_roots(chosen, self.roots(chosen))

    def _costs_with_floors(self, chosen: np.ndarray) -> np.ndarray:  # posterior_information has none
        return self.costs.each(self.linear_model.covariances(self.active(chosen)))

    def _costs_of_roots(self, chosen: np.ndarray, roots: np.ndarray) -> np.ndarray:
        counted = roots[self.costs.counted]
        is_seen = np.isfinite(deviations_of_roots(counted)[:, self.costs.about]).all(axis=1)
        counted[~is_seen] = np.eye(counted.shape[1])
        costs = self.costs.each_from_roots(_inverse_roots(counted))
        if is_seen.all():
            return costs
        unseen = np.inf if self.disturbance.unknown else self._costs_of_covariances(chosen)
        return np.where(is_seen, costs, unseen)

    def _costs_of_covariances(self, chosen: np.ndarray) -> np.ndarray:
        costs = self._costs_of_covariance_roots(self._covariance_roots(chosen))
        if self.is_relative:
            return costs
        again = self._costs_of_covariance_roots(self._covariance_roots(chosen, is_reversed=True))
        with np.errstate(invalid="ignore"):  # a determinant that is rounding is another one in another order
            return np.where(np.abs(costs - again) <= _TRUSTED * np.maximum(1.0, np.abs(costs)), costs, np.inf)

    def _costs_of_covariance_roots(self, roots: np.ndarray) -> np.ndarray:
        counted = roots[self.costs.counted]
        is_infinite = np.isinf(counted[:, 0, 0])
        counted[is_infinite] = np.eye(counted.shape[1])
        return np.where(is_infinite, np.inf, self.costs.each_from_roots(counted))


def deviations_of_roots(R: np.ndarray) -> np.ndarray:
    """Return the standard deviations (N, n) of (R'R)^-1 from roots R (N, n, n); inf for a state moved by a direction that R is blind for.

    A direction whose singular value, with columns of size 1, is below n eps of the largest counts as hidden if with that it would be more
    than half of a state's variance. R'R keeps only half as many digits.
    """
    size, n = _column_sizes(R), R.shape[1]
    _, values, Vt = np.linalg.svd(R / size)
    threshold = n * np.finfo(float).eps * values[:, :1]
    is_hidden = values <= threshold
    smallest = np.where(is_hidden, threshold, values)
    shares = Vt.swapaxes(1, 2) ** 2 / np.where(smallest > 0, smallest, 1.0)[:, None, :] ** 2
    visible, hidden = ((shares * mask[:, None, :]).sum(axis=2) for mask in (~is_hidden, is_hidden))
    return np.where(hidden > visible, np.inf, np.sqrt(visible)) / size[:, 0]


def _column_sizes(R: np.ndarray) -> np.ndarray:
    size = np.abs(R).max(axis=1)
    return np.where(size > 0, size, 1.0)[:, None, :]


def _inverse_roots(R: np.ndarray) -> np.ndarray:
    """Return R^-1 (N, n, n) of upper triangular roots, the pseudo-inverse where nothing is known along a direction.

    Of columns of size 1: back substitution keeps what is small beside what is large.
    """
    size = _column_sizes(R)
    scaled, inverse = R / size, np.empty_like(R)
    is_singular = (np.diagonal(R, axis1=1, axis2=2) == 0).any(axis=1)
    inverse[~is_singular] = np.linalg.inv(scaled[~is_singular])
    inverse[is_singular] = np.linalg.pinv(scaled[is_singular], rcond=1e-15)
    return inverse / size.swapaxes(1, 2)


@dataclass(frozen=True, eq=False)
class FilterSettings:
    """What a user says about a question beside system, path and prior: see `select_for_filter`."""

    segment: float | Sequence[float]
    disturbance_psd: DisturbancePsd
    unknown_inputs: Sequence[str]
    about: Sequence[str] | None
    over: Over
    criterion: AbstractCriterion
    scale: ArrayLike | None
    active: np.ndarray | None
    floor: Mapping[str, float] | None
    input_psd: InputPsd = None
    samples: Log | None = None


def build_question(system: AbstractSystem, path: Trajectory, prior: Prior, settings: FilterSettings) -> FilterQuestion:
    """Return what is asked, or raise InputError for what does not fit."""
    names = system.model.state_names
    run = filter_path(system, path, settings.active, settings.samples)
    if settings.criterion.knowledge is not None:
        raise InputError(f"criterion is {type(settings.criterion).__name__}: must be TraceInverse(), MinEigenvalue() or LogDet()")
    weights, is_worst = weights_over(settings.over, run)
    places = _places(names, settings.about)
    costs = InstantCosts(settings.criterion, places, _scale(settings.scale, names, prior)[places], weights, is_worst)
    question = FilterQuestion(
        run.system,
        run.path,
        prior,
        settings.disturbance_psd,
        tuple(settings.unknown_inputs),
        settings.input_psd,
        run.arrivals,
        segment_nodes(run.path, settings.segment),
        costs,
        _floors(settings.floor, system.model.sensor_names),
        run.nodes,
    )
    if question.disturbance.unknown:
        require_trace(run.system, run.path, question.disturbance, run.arrivals)
    return question


def _places(names: tuple[str, ...], about: Sequence[str] | None) -> np.ndarray:
    """Return the indices of the states asked about (q,)."""
    if about is None:
        return np.arange(len(names))
    given = (about,) if isinstance(about, str) else tuple(about)
    require_known("about", given, names)
    if not given or len(set(given)) < len(given):
        raise InputError(f"about is {about!r}: must be different names of states, at least one ({', '.join(names)})")
    return np.array([names.index(name) for name in given])


def _floors(floor: Mapping[str, float] | None, sensors: tuple[str, ...]) -> np.ndarray:
    """Return the floor of each sensor (S,), 0 for those that have none."""
    require_known("floor", tuple(floor or ()), sensors)
    for name, value in (floor or {}).items():
        require_within(f"floor of {name}", value)
    return np.array([(floor or {}).get(name, 0.0) for name in sensors])


def _scale(scale: ArrayLike | None, names: tuple[str, ...], prior: Prior) -> np.ndarray:
    if scale is None:
        return np.ones(len(names))
    values = as_array("scale", scale)
    if values.shape != (len(names),) or not (np.isfinite(values).all() and (values > 0).all()):
        raise InputError(f"scale is {values.tolist()}: must be {len(names)} finite numbers above 0, one per state ({', '.join(names)})")
    ratio = prior.std / values
    wrong = np.flatnonzero((ratio < 1 / _FAR_APART) | (ratio > _FAR_APART)) if len(ratio) == len(names) else ()
    for i in wrong:
        limits = f"{prior.std[i] / _FAR_APART:.3g} to {prior.std[i] * _FAR_APART:.3g}"
        raise InputError(f"scale of {names[i]} is {values[i]:g}: must be from {limits}, or squares of what is known in it are no numbers")
    return values
