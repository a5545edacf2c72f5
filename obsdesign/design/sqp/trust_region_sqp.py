"""Climbing to a local optimum: convex models in a trust region, limits by an exact penalty."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from time import perf_counter

import numpy as np

from obsdesign.design.nlp.abstract import AbstractProgram
from obsdesign.design.nlp.evaluation import Multipliers, Slopes, Values
from obsdesign.design.sqp.local_model import FEASIBLE, Local, Solved, corrected, local_at, priced, sharpened, slack_if_lighter, solved
from obsdesign.design.sqp.matrix_objective import AbstractAim, weights_of
from obsdesign.design.sqp.merit import Place, Scene, Terms
from obsdesign.status import Status

ITERATIONS = 150  # work, not seconds, decides when a climb is given up
TOLERANCE = 1e-8  # improvement that a model must promise, in units of the merit
_RADIUS, _LARGEST, _SMALLEST = 0.3, 1.0, 1e-9  # of the trust region, in widths of the box
_PENALTY, _HIGHEST, _RELAXED = 1.0, 1e6, 6
_SETTLED, _BROKEN = 1e-6, 1e-6
_COLLAPSED, _STATIONARY = 1e-4, 0.1  # radius, and residual, of a region that has shrunk


@dataclass(frozen=True, eq=False)
class Warm:
    """Where a climb may begin beside its parameters: multipliers, penalty and radius of another one."""

    multipliers: Multipliers
    penalty: float = _PENALTY
    radius: float = _RADIUS


@dataclass(frozen=True, eq=False)
class Limits:
    """When a climb ends without an answer: iterations, and a deadline of time.perf_counter; tolerance: when it has one."""

    iterations: int = ITERATIONS
    tolerance: float = TOLERANCE
    deadline: float = float("inf")


@dataclass(frozen=True, eq=False)
class Solution:
    """Where a climb stopped.

    objective: aim minus price by the program; violation: the largest shortfall of a margin.
    """

    p: np.ndarray
    objective: float
    violation: float
    status: Status
    iterations: int
    warm: Warm
    slope: Callable[[], float]

    @cached_property
    def residual(self) -> float:
        """The largest entry of the projected gradient of the Lagrangian times the width of the box, in units of the aim."""
        return self.slope()


@dataclass(frozen=True, eq=False)
class _State:
    """Everything that one iteration hands to the next.

    held (q,): parameters on their bounds; relaxed: times the penalty fell; slopes: at the place, None where they are not known yet.
    """

    place: Place
    multipliers: Multipliers
    terms: Terms
    radius: float
    held: np.ndarray
    relaxed: int = 0
    slopes: Slopes | None = None


@dataclass(frozen=True, eq=False)
class _Moved:
    """What one iteration came to: the state, whether it is a better place, and what its model promised."""

    state: _State
    better: bool
    promised: float
    solved: bool


def climb(
    program: AbstractProgram, aim: AbstractAim, p: np.ndarray, warm: Warm | None = None, least: float = 0.0, limits: Limits | None = None
) -> Solution:
    """Maximise aim minus price from parameters p (q,); least: keep lambda_min of every judged matrix at or above this.

    After the deadline the best point so far is returned as TIME_LIMIT.
    Source: sequential quadratic programming with a trust region and an exact penalty (Fletcher, 1985), its models with matrix
    inequalities where the aim is a smallest eigenvalue (Fares, Noll, Apkarian, 2002).
    """
    scene, limits = Scene(program, aim, least), Limits() if limits is None else limits
    state, status, done = _first(scene, p, warm), Status.ITERATION_LIMIT, 0
    if not np.isfinite(state.place.merit):
        return _solution(scene, state, Status.NUMERICAL_ERROR, 0)
    while done < limits.iterations:
        if perf_counter() >= limits.deadline:
            status = Status.TIME_LIMIT
            break
        done += 1
        moved = _moved(scene, state, limits.tolerance)
        state = moved.state
        if not moved.better:
            if state.place.violation > _BROKEN and state.terms.penalty < _HIGHEST:
                state = _insisting(scene, state)
                continue
            status = _verdict(scene, moved, limits.tolerance)
            break
        state = _recounted(scene, state)
    return _solution(scene, state, status, done)


def _first(scene: Scene, p: np.ndarray, warm: Warm | None) -> _State:
    values = scene.program.at(np.clip(p, scene.program.lower, scene.program.upper))
    terms = Terms(scene.aim.unit(values.matrices), _PENALTY if warm is None else warm.penalty)
    multipliers = _guessed(scene, values, terms)
    if warm is not None:
        multipliers = _adopted(warm.multipliers, multipliers)
    radius = _RADIUS if warm is None else warm.radius
    return _State(scene.place(values, terms), multipliers, terms, radius, np.zeros(len(p), dtype=bool))


def _guessed(scene: Scene, values: Values, terms: Terms) -> Multipliers:
    """Multipliers before any model was solved: the aim's slope, and nothing for limits."""
    weights = weights_of(scene.aim, values.matrices) / terms.unit
    Z = np.nan_to_num(scene.aim.slopes(values.matrices) * weights[:, None, None])
    return Multipliers(Z, np.zeros_like(values.floors), np.zeros(len(values.rows)), 1 / terms.unit)


def _adopted(other: Multipliers, own: Multipliers) -> Multipliers:
    """Another climb's multipliers, where they are as many."""
    pairs = ((other.matrices, own.matrices), (other.floors, own.floors), (other.rows, own.rows))
    matrices, floors, rows = (theirs if theirs.shape == mine.shape else mine for theirs, mine in pairs)
    return Multipliers(matrices, floors, rows, own.price)


# ---------------------------------------------------------------- one iteration


def _moved(scene: Scene, state: _State, tolerance: float) -> _Moved:
    """Make a model and solve it in ever smaller regions until a step is a gain."""
    slopes = scene.program.slopes(state.place.values) if state.slopes is None else state.slopes
    local, state = local_at(scene, state.place, slopes, state.multipliers, state.held, state.terms), replace(state, slopes=slopes)
    promised, ever = np.inf, False
    while state.radius > _SMALLEST:
        found = solved(local, state.terms, state.radius)
        if found is None:
            state = replace(state, radius=state.radius / 4)
            continue
        terms, found = _steered(local, found, state.terms, state.radius)
        place = scene.counted(state.place, terms)
        state, local = replace(state, place=place, terms=terms, multipliers=priced(local, found, terms)), replace(local, place=place)
        promised, ever = place.merit - found.promised, True
        if promised <= tolerance * max(1.0, abs(place.merit)):
            escaped = _escaped(local, terms, state.radius, tolerance)
            if escaped is None:
                break
            return _Moved(replace(state, place=escaped, held=found.step.bounds > _SETTLED, slopes=None), True, promised, True)
        reached = _best(local, found, terms, state.radius, promised)
        gained, length = place.merit - reached.merit, float(np.max(np.abs(found.d) / scene.width))
        if gained > 0.05 * promised:
            held = found.step.bounds > _SETTLED
            radius = _next_radius(state.radius, length, gained / promised)
            return _Moved(replace(state, place=reached, held=held, radius=radius, slopes=None), True, promised, True)
        state = replace(state, radius=0.35 * min(length, state.radius))
    return _Moved(state, False, promised, ever)


def _steered(local: Local, found: Solved, terms: Terms, radius: float) -> tuple[Terms, Solved]:
    """Raise the penalty where the aim is what keeps the model from being more feasible (Byrd, Nocedal, Waltz, 2008)."""
    while found.step.e > FEASIBLE / 10 and terms.penalty < _HIGHEST:
        if slack_if_lighter(local, found, terms, radius, 0.1) > 0.8 * found.step.e:
            break
        raised = replace(terms, penalty=10 * terms.penalty)
        harder = solved(local, raised, radius)
        if harder is None:
            break
        terms, found = raised, harder
    return terms, found


def _best(local: Local, found: Solved, terms: Terms, radius: float, promised: float) -> Place:
    """Return the best place of the step, its correction for curved limits, its continuation, and Newton's step near the end."""
    scene, place = local.scene, local.place
    p = place.values.p
    reached = scene.at(p + found.d, terms)
    if place.merit - reached.merit < 0.25 * promised and np.isfinite(reached.merit):
        d = corrected(local, found, reached, terms, radius)
        reached = reached if d is None else min(reached, scene.at(p + d, terms), key=_merit)
    factor = 2.0
    while place.merit - reached.merit > 1.3 * promised and factor <= 16:
        further = scene.at(p + factor * found.d, terms)
        if not further.merit < reached.merit:
            break
        reached, factor = further, 2 * factor
    if np.max(np.abs(found.d) / scene.width) < 0.5 * radius and promised < 1e-2 * max(1.0, abs(place.merit)):
        d = sharpened(local, found, terms, radius)
        reached = reached if d is None else min(reached, scene.at(p + d, terms), key=_merit)
    return reached


def _escaped(local: Local, terms: Terms, radius: float, tolerance: float) -> Place | None:
    """Return a better place along the most negative curvature, where slopes promise nothing: a saddle is no optimum."""
    if local.downhill is None:
        return None
    scene, place = local.scene, local.place
    for share in (1.0, 0.25, 0.05):
        tries = [scene.at(place.values.p + side * share * radius * local.downhill, terms) for side in (1, -1)]
        best = min(tries, key=_merit)
        if place.merit - best.merit > 10 * tolerance * max(1.0, abs(place.merit)):
            return best
    return None


def _merit(place: Place) -> float:
    return place.merit


def _next_radius(radius: float, length: float, share: float) -> float:
    if share > 0.7 and length > 0.8 * radius:
        return min(_LARGEST, 2.5 * radius)
    return 0.5 * length if share < 0.3 else radius


def _insisting(scene: Scene, state: _State) -> _State:
    """Return the state with a higher penalty: where nothing better is near for this one, limits may still be met for another."""
    terms = replace(state.terms, penalty=10 * state.terms.penalty)
    return replace(state, place=scene.counted(state.place, terms), terms=terms, radius=max(state.radius, _RADIUS))


def _recounted(scene: Scene, state: _State) -> _State:
    """Return the state in terms that suit where it is: a lower penalty once all limits hold, a unit near the aim."""
    terms, relaxed = state.terms, state.relaxed
    enough = max(_PENALTY, 3 * _slack_price(scene, state.multipliers))
    if state.place.violation <= FEASIBLE and relaxed < _RELAXED and enough < terms.penalty / 3:
        terms, relaxed = replace(terms, penalty=enough), relaxed + 1
    unit = scene.aim.unit(state.place.values.matrices)
    if not terms.unit / 3 <= unit <= 3 * terms.unit:
        terms = replace(terms, unit=unit)
    if terms is state.terms:
        return state
    multipliers = state.multipliers.times(state.terms.unit / terms.unit)
    return replace(state, place=scene.counted(state.place, terms), terms=terms, multipliers=multipliers, relaxed=relaxed)


def _slack_price(scene: Scene, multipliers: Multipliers) -> float:
    """What all limits together would pay for slack: a penalty above it is exact."""
    floor = scene.program.problem.floor
    floors = 0.0 if floor is None else floor.value * float(np.trace(multipliers.floors, axis1=1, axis2=2).sum())
    kept = scene.least * float(np.trace(multipliers.matrices, axis1=1, axis2=2).sum()) if scene.least else 0.0
    return float(multipliers.rows.sum()) + floors + kept


# ---------------------------------------------------------------- the end


def _verdict(scene: Scene, moved: _Moved, tolerance: float) -> Status:
    """Say what it means that nothing better is near."""
    place = moved.state.place
    # a promise is worth little where the region has shrunk: the slopes must say so too
    level = moved.state.radius > _COLLAPSED or _residual(scene, moved.state) <= _STATIONARY
    settled = moved.solved and level and moved.promised <= max(_SETTLED, tolerance) * max(1.0, abs(place.merit))
    if place.violation > max(_BROKEN, 10 * tolerance):
        return Status.LOCALLY_INFEASIBLE if settled or moved.state.terms.penalty >= _HIGHEST else Status.NUMERICAL_ERROR
    return Status.LOCALLY_OPTIMAL if settled else Status.NUMERICAL_ERROR


def _solution(scene: Scene, state: _State, status: Status, iterations: int) -> Solution:
    place = state.place
    warm = Warm(state.multipliers, min(state.terms.penalty, 100.0), max(state.radius, 1e-3))
    objective = place.aim - place.values.price
    return Solution(place.values.p, objective, place.violation, status, iterations, warm, partial(_residual, scene, state))


def _residual(scene: Scene, state: _State) -> float:
    if not np.isfinite(state.place.merit):
        return float("nan")
    values, multipliers, program = state.place.values, state.multipliers, scene.program
    slopes = program.slopes(values) if state.slopes is None else state.slopes
    g = multipliers.price * slopes.price - np.einsum("bij,bqij->q", multipliers.matrices, slopes.matrices)
    g -= np.einsum("bij,bqij->q", multipliers.floors, slopes.floors) + multipliers.rows @ slopes.rows
    width = scene.width
    moved = np.clip(values.p / width - g * width, program.lower / width, program.upper / width)
    return float(np.abs(moved - values.p / width).max(initial=0.0))
