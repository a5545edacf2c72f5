"""What must fit together in a design problem, field by field."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from obsdesign.checks import require_known, require_positive, whole_multiple
from obsdesign.constraints.abstract import AbstractConstraint
from obsdesign.costs.abstract import AbstractCost
from obsdesign.criteria.abstract import Knowledge
from obsdesign.design.floor import Floor
from obsdesign.design.robust import Robust
from obsdesign.dynamics.model import Model
from obsdesign.errors import InputError
from obsdesign.information.correlated_noise import colour_of
from obsdesign.moment import Moment, NoRates

_ROUNDING = 1e-9  # by how much a margin of order 1 may fall short where the start lies on an edge


@dataclass(frozen=True)
class Durations:
    """How long a path may be, shortest to longest [s], in steps of so many seconds."""

    shortest: float
    longest: float
    step: float


def require_times(durations: Durations, floor: Floor | None, constraints: Sequence[AbstractConstraint]) -> None:
    """Raise InputError for durations, stretches and times of limits that are no whole steps or not within the path."""
    shortest, longest, step = durations.shortest, durations.longest, durations.step
    require_positive("step", step)
    for duration in dict.fromkeys((shortest, longest)):
        require_positive("duration", duration)
        if whole_multiple(duration, step) is None:
            raise InputError(f"duration {duration:g} s is no whole multiple of the step {step:g} s")
    if shortest > longest:
        raise InputError(f"duration is ({shortest:g}, {longest:g}): the first must not be above the second")
    if floor is not None:
        steps = whole_multiple(floor.seconds, step)
        if steps is None or steps > round(shortest / step):
            raise InputError(
                f"floor: seconds is {floor.seconds:g}: must be a whole multiple of the step {step:g} s"
                f" and at most the duration {shortest:g} s"
            )
    for constraint in constraints:
        for time in (constraint.span.first, constraint.span.last):
            if time is not None and not 0 <= time <= shortest:
                raise InputError(f"{constraint}: the time {time:g} s is not within the path, 0 to {shortest:g} s")


def require_inputs(names: Sequence[str], bounds: Mapping[str, tuple[float, float]], rates: Mapping[str, float]) -> None:
    """Raise InputError for bounds and rates of unknown inputs, for inputs without bounds, and for values that are none."""
    require_known("bounds", tuple(bounds), names)
    require_known("rates", tuple(rates), names)
    for name in names:
        if name not in bounds:
            raise InputError(f"bounds of {name} are missing: every known input needs (low, high)")
        low, high = bounds[name]
        if low >= high:
            raise InputError(f"bounds of {name} are ({low:g}, {high:g}): low must be below high")
    for name, rate in rates.items():
        require_positive(f"rates: {name}", rate)


def require_costs(model: Model, u: np.ndarray, costs: Sequence[AbstractCost]) -> None:
    """Raise InputError for a cost of inputs that the vehicle does not have; u (m,): any inputs within the bounds."""
    state = dict.fromkeys(model.state_names, 0.0)
    moment = Moment(state, state, dict(zip(model.input_names, u.tolist(), strict=True)), model.landmarks)
    for cost in costs:
        cost.rate(moment)


def require_map(model: Model, step: float, x0: np.ndarray, u: np.ndarray, terms: Sequence[AbstractConstraint | AbstractCost]) -> None:
    """Raise InputError, for a map from one instant to the next, for steps that are no whole periods, and for what asks for a rate.

    x0 (n,), u (m,): a state and inputs.
    """
    if model.period is None:
        return
    _ = model.periods_in(step)
    names = model.state_names
    inputs = dict(zip(model.input_names, u.tolist(), strict=True))
    moment = Moment(dict(zip(names, x0.tolist(), strict=True)), NoRates(names), inputs, model.landmarks)
    for term in terms:
        try:
            _ = term.margins(moment) if isinstance(term, AbstractConstraint) else term.rate(moment)
        except InputError as error:
            raise InputError(f"{term}: {error}") from None


def require_states(names: Sequence[str], about: Sequence[str]) -> None:
    """Raise InputError for judged states that are unknown or named twice."""
    require_known("about", about, names)
    if len(set(about)) != len(about):
        raise InputError(f"about is {about}: names a state twice")


def require_one_knowledge(names: Sequence[str], knowledge: Knowledge | None, robust: Robust | None, floor: Floor | None) -> None:
    """Raise InputError for a prior of another size, and for a posterior criterion beside what does not know of it."""
    if robust is not None and robust.prior.mean.size != len(names):
        raise InputError(f"robust: the prior has {robust.prior.mean.size} states: the system has {len(names)} ({', '.join(names)})")
    if robust is not None and knowledge is not None:
        raise InputError("robust: a posterior criterion has a prior of its own; use one of the two")
    if floor is not None and knowledge is not None:
        raise InputError("floor: a posterior criterion has no windows; use another criterion")


def require_posterior(knowledge: Knowledge | None, known: np.ndarray, durations: Durations) -> None:
    """Raise InputError for what is known beside a posterior's prior, and for weights of instants that are not one for each step."""
    if knowledge is not None and known.any():
        raise InputError("known: a posterior criterion has a prior of its own, to which what is known of x(t_0) belongs")
    if knowledge is None or isinstance(knowledge.over, str):
        return
    steps, count = round(durations.longest / durations.step), len(knowledge.over)
    if durations.shortest != durations.longest:
        raise InputError(f"criterion: over has weights: they need one duration, not ({durations.shortest:g}, {durations.longest:g})")
    if count != steps:
        raise InputError(f"criterion: over has {count} weights: must be {steps}, one for each step of the path")


def require_known_information(information: np.ndarray, n: int) -> None:
    """Raise InputError for what is no information (n, n): symmetric, positive semidefinite, finite."""
    fits = information.shape == (n, n) and bool(np.isfinite(information).all())
    if not fits:
        raise InputError(f"known has shape {information.shape}: must be ({n}, {n}), finite, symmetric and positive semidefinite")
    sizes = np.sqrt(np.maximum(np.diag(information), 0.0))  # of each state in its own unit
    units = np.where(sizes > 0, sizes, 1.0)
    skew = np.abs(information - information.T) - 1e-9 * np.outer(units, units)
    excess_entries = np.abs(information) - (1 + 1e-9) * np.outer(sizes, sizes)
    for excess, what in ((skew, "symmetric"), (excess_entries, "positive semidefinite: an entry is at most the root of the two beside it")):
        if excess.max(initial=0.0) > 0:
            i, j = (int(index) for index in np.unravel_index(int(excess.argmax()), excess.shape))
            raise InputError(f"known[{i}, {j}] is {information[i, j]:g} and known[{j}, {i}] {information[j, i]:g}: must be {what}")
    lowest = float(np.linalg.eigvalsh(information / np.outer(units, units))[0])
    if lowest < -1e-9:
        raise InputError(f"known, scaled to unit diagonal, has the eigenvalue {lowest:.3g}: must be positive semidefinite")


def require_weights(
    weights: np.ndarray | None, model: Model, durations: Durations, knowledge: Knowledge | None, robust: Robust | None
) -> None:
    """Raise InputError for weights that are not (K, S), finite and >= 0, of a posterior 0 or 1, or beside what does not know of them."""
    if weights is None:
        return
    names, steps = model.sensor_names, round(durations.longest / durations.step)
    if durations.shortest != durations.longest:
        raise InputError(f"weights: the duration is ({durations.shortest:g}, {durations.longest:g}): weights need one duration")
    if weights.ndim != 2 or weights.shape[1] != len(names) or not len(weights) or steps % len(weights):
        raise InputError(
            f"weights has shape {weights.shape}: must be (K, {len(names)}) for {', '.join(names)}, K a divisor of the {steps} steps"
        )
    if not (np.isfinite(weights).all() and (weights >= 0).all()):
        raise InputError(f"weights go from {weights.min():g} to {weights.max():g}: every one must be finite and at least 0")
    coloured = colour_of(model)
    if coloured is not None and (weights[:, list(coloured.sensor_indices)] > 1).any():
        raise InputError(
            f"weights of {', '.join(coloured.sensors)} go beyond 1: errors that are not independent cannot be weighed, only left out"
        )
    if knowledge is not None and not np.isin(weights, (0.0, 1.0)).all():
        share = weights[~np.isin(weights, (0.0, 1.0))][0]
        raise InputError(f"weights has the entry {share:g}: a posterior criterion has a sample or has it not: must be 0 or 1")
    if robust is not None:
        raise InputError("weights: robust does not know of weights; use one of the two")


def position_of(names: Sequence[str]) -> tuple[int, int]:
    """Where x and y stand among the names of states; raises InputError where they do not."""
    require_known("constraints: the state", ("x", "y"), names)
    return names.index("x"), names.index("y")


def require_start(model: Model, x0: np.ndarray, constraints: Sequence[AbstractConstraint]) -> None:
    """Raise InputError for a start x0 (n,) on a landmark or beyond a limit, and for limits on states that the system does not have."""
    for constraint in constraints:
        require_known(f"{constraint}: the state", constraint.states, model.state_names)
    if model.landmarks:
        position = tuple(x0[list(position_of(model.state_names))])
        for point in model.landmarks:
            if position == tuple(point):
                raise InputError(f"start lies on the landmark {point}: range and bearing have no derivative there")
    state = dict(zip(model.state_names, x0.tolist(), strict=True))
    moment = Moment(state, {}, {}, model.landmarks)
    for constraint in constraints:
        if constraint.span.anywhere or constraint.span.first != 0.0:
            continue
        try:
            margins = constraint.margins(moment)
        except KeyError:  # needs a rate, which the start does not have
            continue
        if min(margins, default=0.0) < -_ROUNDING:
            where = ", ".join(f"{name} = {state[name]:g}" for name in constraint.states)
            raise InputError(f"start ({where}) violates {constraint}")
