"""What must fit together in a design problem."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from obsdesign.checks import require_known, require_positive, whole_multiple
from obsdesign.errors import InputError
from obsdesign.information.correlated_noise import colour_of
from obsdesign.moment import Moment

if TYPE_CHECKING:
    from obsdesign.design.problem import DesignProblem

_ROUNDING = 1e-9  # by how much a margin of order 1 may fall short where the start lies on an edge


def require_consistent(problem: DesignProblem) -> None:
    """Raise InputError for the first thing that does not fit."""
    _require_times(problem)
    _require_inputs(problem)
    _require_states(problem)
    _require_weights(problem)
    problem.path.box(problem.grid)
    _require_start(problem)


def _require_times(problem: DesignProblem) -> None:
    require_positive("step", problem.step)
    for duration in dict.fromkeys((problem.shortest, problem.longest)):
        require_positive("duration", duration)
        if whole_multiple(duration, problem.step) is None:
            raise InputError(f"duration {duration:g} s is no whole multiple of the step {problem.step:g} s")
    if problem.shortest > problem.longest:
        raise InputError(f"duration is ({problem.shortest:g}, {problem.longest:g}): the first must not be above the second")
    if problem.floor is not None:
        steps = whole_multiple(problem.floor.seconds, problem.step)
        if steps is None or steps > round(problem.shortest / problem.step):
            raise InputError(
                f"floor: seconds is {problem.floor.seconds:g}: must be a whole multiple of the step {problem.step:g} s"
                f" and at most the duration {problem.shortest:g} s"
            )
    for constraint in problem.constraints:
        for time in (constraint.span.first, constraint.span.last):
            if time is not None and not 0 <= time <= problem.shortest:
                raise InputError(f"{constraint}: the time {time:g} s is not within the path, 0 to {problem.shortest:g} s")


def _require_inputs(problem: DesignProblem) -> None:
    names = problem.system.model.input_names
    require_known("bounds", tuple(problem.bounds), names)
    require_known("rates", tuple(problem.rates), names)
    for name in names:
        if name not in problem.bounds:
            raise InputError(f"bounds of {name} are missing: every known input needs (low, high)")
        low, high = problem.bounds[name]
        if low >= high:
            raise InputError(f"bounds of {name} are ({low:g}, {high:g}): low must be below high")
    for name, rate in problem.rates.items():
        require_positive(f"rates: {name}", rate)
    state = dict.fromkeys(problem.system.model.state_names, 0.0)
    moment = Moment(state, state, dict(zip(names, problem.grid.centre.tolist(), strict=True)), problem.system.model.landmarks)
    for term in (*problem.prices, *problem.budgets):
        term.cost.rate(moment)  # raises InputError for inputs that the vehicle does not have


def _require_states(problem: DesignProblem) -> None:
    names = problem.system.model.state_names
    n = len(names)
    require_known("about", problem.about, names)
    if len(set(problem.about)) != len(problem.about):
        raise InputError(f"about is {problem.about}: names a state twice")
    _require_known_information(problem, n)
    if problem.robust is not None and problem.robust.prior.mean.size != n:
        raise InputError(f"robust: the prior has {problem.robust.prior.mean.size} states: the system has {n} ({', '.join(names)})")
    if problem.robust is not None and problem.criterion.knowledge is not None:
        raise InputError("robust: a posterior criterion has a prior of its own; use one of the two")
    if problem.floor is not None and problem.criterion.knowledge is not None:
        raise InputError("floor: a posterior criterion has no windows; use another criterion")


def _require_known_information(problem: DesignProblem, n: int) -> None:
    information = np.asarray(problem.known)
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


def _require_weights(problem: DesignProblem) -> None:
    if problem.weights is None:
        return
    weights, names, steps = np.asarray(problem.weights), problem.system.model.sensor_names, round(problem.longest / problem.step)
    if problem.shortest != problem.longest:
        raise InputError(f"weights: the duration is ({problem.shortest:g}, {problem.longest:g}): weights need one duration")
    if weights.ndim != 2 or weights.shape[1] != len(names) or not len(weights) or steps % len(weights):
        raise InputError(
            f"weights has shape {weights.shape}: must be (K, {len(names)}) for {', '.join(names)}, K a divisor of the {steps} steps"
        )
    if not (np.isfinite(weights).all() and (weights >= 0).all()):
        raise InputError(f"weights go from {weights.min():g} to {weights.max():g}: every one must be finite and at least 0")
    coloured = colour_of(problem.system.model)
    if coloured is not None and (weights[:, list(coloured.sensor_indices)] > 1).any():
        raise InputError(
            f"weights of {', '.join(coloured.sensors)} go beyond 1: errors that are not independent cannot be weighed, only left out"
        )
    for what, conflicting in (("a posterior criterion", problem.criterion.knowledge), ("robust", problem.robust)):
        if conflicting is not None:
            raise InputError(f"weights: {what} does not know of weights; use one of the two")


def _require_start(problem: DesignProblem) -> None:
    model = problem.system.model
    for constraint in problem.constraints:
        require_known(f"{constraint}: the state", constraint.states, model.state_names)
    if model.landmarks:
        position = tuple(problem.x0[list(problem.position)])
        for point in model.landmarks:
            if position == tuple(point):
                raise InputError(f"start lies on the landmark {point}: range and bearing have no derivative there")
    state = dict(zip(model.state_names, problem.x0.tolist(), strict=True))
    moment = Moment(state, {}, {}, model.landmarks)
    for constraint in problem.constraints:
        if constraint.span.anywhere or constraint.span.first != 0.0:
            continue
        try:
            margins = constraint.margins(moment)
        except KeyError:  # needs a rate, which the start does not have
            continue
        if min(margins, default=0.0) < -_ROUNDING:
            where = ", ".join(f"{name} = {state[name]:g}" for name in constraint.states)
            raise InputError(f"start ({where}) violates {constraint}")
