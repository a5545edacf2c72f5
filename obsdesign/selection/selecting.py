"""Choosing sensors: relax, bound in closed form, round, polish, prove."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.arguments import validate_arguments
from obsdesign.checks import require_count, require_positive
from obsdesign.criteria.abstract import AbstractCriterion
from obsdesign.criteria.min_eigenvalue import MinEigenvalue
from obsdesign.errors import InputError, SolveError
from obsdesign.rules.abstract import AbstractRule, Segments
from obsdesign.selection.columns import Relaxed, bound_of, closed, mixture_of, relaxed, seen_through, size_of
from obsdesign.selection.duals import Dual
from obsdesign.selection.instance import Instance
from obsdesign.selection.interior import centred, serves
from obsdesign.selection.polish import polished
from obsdesign.selection.posing import posed
from obsdesign.selection.proof import Effort, Explored, bar, explored
from obsdesign.selection.rounding import Undecided, purified
from obsdesign.selection.schedule import Schedule, require_blocks
from obsdesign.selection.walks import nearby, walks_of
from obsdesign.status import Status

Method = Literal["auto", "columns", "direct"]

_DUALS = 24  # the best of those met bound what is undecided
_FRONTS = 1000  # of the branch and bound that get duals of their own: half a minute or so
_NEAR = (40, 100)  # undecided segments of the first searches
_MANY_STATES = 9  # from here on column generation takes more rounds than Newton's method in all
_CENTRED = 1e-5  # of the value: what is left to the rounding is a hundred times as much
_MANY_DIRECTIONS, _FEW_CHOICES = 80, 400
_LATEST = 12  # columns among which the best one is polished, too
_NODES = 4_000_000
_DRAWN = ((400, 16), (4000, 6), (40_000, 1), (1 << 62, 0))  # choices K S, and how many roundings are drawn beside the best one


@validate_arguments
def select_sensors(
    blocks: ArrayLike,
    per_segment: int = 1,
    *,
    rules: Sequence[AbstractRule] = (),
    criterion: AbstractCriterion | None = None,
    method: Method = "auto",
    gap: float = 1e-9,
    time_limit: float | None = None,
    seed: int = 0,
    robust_to: int = 0,
    segments: Segments | None = None,
    throw: bool = True,
) -> Schedule:
    """max criterion(sum_k sum_s chosen_ks W_ks) with at most per_segment sensors on in each segment, within the rules, with a proof.

    blocks (K, S, n, n), symmetric and >= 0, in any unit (scale them first: S W S). criterion: MinEigenvalue() (the default), LogDet(),
    TraceInverse(). robust_to: how many sensors may be lost, whichever they are: the value is that of the worst loss. segments: the
    names, times and places that rules speak of.

    method "auto": dual column generation, rounding and exchange, branch and bound, until the gap is closed or so much work is done
    (the same on every machine); "columns": without branch and bound; "direct": the relaxation by CVXPY and Clarabel in one piece,
    without branch and bound, a second opinion for small problems. time_limit [s] stops any of them with what it has.
    Status OPTIMAL when gap is reached, else GAP_OPEN.

    Raises InputError for bad blocks and for rules that leave no choice, SolveError when no solver has an answer (throw=False: the
    failed Schedule). Source: Brace and Morgansen, eq. (12), with the bounds of Lagrangian duality.
    """
    array = require_blocks(np.asarray(blocks), per_segment)
    if not (np.isfinite(gap) and gap >= 0):
        raise InputError(f"gap is {gap!r}: must be a finite number of at least 0")
    if time_limit is not None:
        require_positive("time_limit", time_limit)
    require_count("seed", seed, least=0)
    if method not in ("auto", "columns", "direct"):
        raise InputError(f"method is {method!r}: must be 'auto', 'columns' or 'direct'")
    rules = tuple(rules)
    instance = posed(array, per_segment, rules, criterion or MinEigenvalue(), robust_to, segments)
    return chosen_for(instance, rules, Wanted(method, gap, time_limit, seed), throw)


def without_sensors(instance: Instance, lost: tuple[int, ...]) -> Instance:
    """Return the problem in which some sensors are never available."""
    available = instance.schedules.available.copy()
    available[:, list(lost)] = False
    return replace(instance, schedules=replace(instance.schedules, available=available))


@dataclass(frozen=True)
class Wanted:
    """How good, how, for how long, from which seed, and how many fronts of the branch and bound at most."""

    method: Method
    gap: float
    time_limit: float | None
    seed: int
    fronts: int = _FRONTS


def chosen_for(instance: Instance, rules: tuple[AbstractRule, ...], wanted: Wanted, throw: bool, first: tuple[Dual, ...] = ()) -> Schedule:
    """Return the schedule of a problem; first: duals of a problem like it."""
    ends = np.inf if wanted.time_limit is None else perf_counter() + wanted.time_limit

    def out_of_time() -> bool:
        return perf_counter() > ends

    found, notes = _relaxation(instance, wanted, first)
    if found is None:
        if not instance.criterion.is_smallest_eigenvalue and not _sees_everything(instance):
            return _refused(instance, throw)
        if throw:
            raise SolveError("sensor selection", Status.NUMERICAL_ERROR)
        return _failed(instance)
    whole = purified(instance, found)
    answer = _incumbent(instance, found, whole, wanted, out_of_time)
    if wanted.method == "auto" and _worth_searching(instance):
        answer = _searched(instance, found, answer, wanted, out_of_time)
        answer = _proven(instance, found, answer, wanted, out_of_time)
    _require_information(instance, rules, answer.bound)
    if not np.isfinite(answer.value):
        return _refused(instance, throw)
    return _certified(instance, found.dual, whole.fractional, answer, wanted.gap, notes)


def _sees_everything(instance: Instance) -> bool:
    """Whether some mixture of schedules has information about every direction, as far as a solver can tell."""
    found = seen_through(instance)
    return found is None or found.value > instance.rounding


def _refused(instance: Instance, throw: bool) -> Schedule:
    if throw:
        lost = ", when the worst of them are lost" if len(instance.kept) > 1 else ""
        name = type(instance.criterion).__name__
        raise InputError(f"criterion is {name}: it is -inf for every schedule within the rules{lost}: some direction stays unseen")
    return _failed(instance)


def _worth_searching(instance: Instance) -> bool:
    """Whether branch and bound gets anywhere: hardly with many directions to balance in many segments, where a front takes a second."""
    return instance.rows.shape[2] * len(instance.kept) <= _MANY_DIRECTIONS or instance.shape[0] * instance.shape[1] <= _FEW_CHOICES


@dataclass(frozen=True, eq=False)
class _Answer:
    """A schedule, its value, what no schedule is above, and the partial schedules that the proof looked at."""

    chosen: np.ndarray
    value: float
    bound: float
    nodes: int = 0


def _relaxation(instance: Instance, wanted: Wanted, first: tuple[Dual, ...]) -> tuple[Relaxed | None, tuple[str, ...]]:
    accuracy = min(max(0.1 * wanted.gap, 1e-9), 1e-8)  # what it leaves open, no rounding makes good

    def by_columns() -> Relaxed | None:
        if instance.n >= _MANY_STATES and serves(instance):
            centre = centred(instance, max(accuracy, _CENTRED))
            return mixture_of(instance, centre.shares, centre.dual)
        return relaxed(instance, accuracy, first)

    def in_one_piece() -> Relaxed | None:
        from obsdesign.selection.relaxation import relaxed_directly  # CVXPY takes a second to load

        return relaxed_directly(instance, wanted.time_limit)

    ways = ("column generation", by_columns), ("the relaxation in one piece", in_one_piece)
    (name, way), (other_name, other) = ways[::-1] if wanted.method == "direct" else ways
    found = way()
    return (found, ()) if found is not None else (other(), (f"{name} failed: {other_name} instead",))


def _incumbent(instance: Instance, found: Relaxed, whole: Undecided, wanted: Wanted, out_of_time: Callable[[], bool]) -> _Answer:
    """The best of the columns and of roundings of the relaxation, polished."""
    random = np.random.default_rng(wanted.seed)
    drawn = next(count for most, count in _DRAWN if np.prod(instance.shape) <= most)
    rounded = [] if instance.schedules.linked else [whole.rounded(None), *(whole.rounded(random) for _ in range(drawn))]
    nothing = np.zeros(instance.shape, dtype=bool)
    best = _Answer(nothing, instance.value(nothing), found.bound)
    rounded = [each for each in rounded if instance.keeps_limits(each)]
    if drawn or not rounded:
        columns = [each.chosen for each in found.columns[-_LATEST:] if instance.keeps_limits(each.chosen)]
        rounded += sorted(columns, key=instance.value)[-1:]
    for start in rounded:
        if closed(best.value, found.bound, wanted.gap, instance) or (best.chosen.any() and out_of_time()):
            break
        chosen, value = polished(instance, start, found.dual, found.bound)
        best = _Answer(chosen, value, found.bound) if value > best.value else best
    return best


def _searched(instance: Instance, found: Relaxed, answer: _Answer, wanted: Wanted, out_of_time: Callable[[], bool]) -> _Answer:
    """Branch and bound among the schedules near the best one for the dual, which it often proves the best of these."""
    duals = [dual for dual, _ in sorted(found.met, key=lambda each: each[1])[:_DUALS]]
    for count in _NEAR:
        fronts, most = 0, min(2 * count, wanted.fronts // 4)
        while fronts < most and not out_of_time() and not closed(answer.value, answer.bound, wanted.gap, instance):
            walks = nearby(instance, found.dual, found.bound, count, bar(answer.value, wanted.gap, instance))
            if walks is None:
                break
            effort = Effort(most - fronts, _NODES, out_of_time)
            result = explored(instance, walks, duals, (answer.chosen, answer.value), wanted.gap, effort)
            fronts += max(result.fronts, 1)
            if result.value <= answer.value:
                break
            answer = _better(instance, found, result)
    return answer


def _better(instance: Instance, found: Relaxed, result: Explored) -> _Answer:
    chosen, value = polished(instance, result.chosen, found.dual, found.bound)
    return _Answer(chosen, value, found.bound) if value > result.value else _Answer(result.chosen, result.value, found.bound)


def _proven(instance: Instance, found: Relaxed, answer: _Answer, wanted: Wanted, out_of_time: Callable[[], bool]) -> _Answer:
    """Branch and bound, anew after every better schedule."""
    duals = sorted(found.met, key=lambda each: each[1])[:_DUALS]
    fronts = 0
    while not closed(answer.value, answer.bound, wanted.gap, instance):
        walks = walks_of(instance, duals, bar(answer.value, wanted.gap, instance))
        if walks is None:
            return answer
        effort = Effort(wanted.fronts - fronts, _NODES - answer.nodes, out_of_time)
        result = explored(instance, walks, [dual for dual, _ in duals], (answer.chosen, answer.value), wanted.gap, effort)
        fronts, nodes = fronts + result.fronts, answer.nodes + result.nodes
        if result.value <= answer.value:
            return _Answer(answer.chosen, answer.value, min(result.bound, found.bound), nodes)
        answer = replace(_better(instance, found, result), nodes=nodes)
    return answer


def _require_information(instance: Instance, rules: tuple[AbstractRule, ...], bound: float) -> None:
    """Refuse budgets within which no schedule sees the whole state, while one does without them."""
    tiny = 1e-9 * float(np.abs(instance.information(instance.schedules.available)).max())
    if not instance.resources or not instance.criterion.is_smallest_eigenvalue or bound > tiny or instance.switching.any():
        return
    free = seen_through(replace(instance, resources=()))
    if free is not None and free.value > tiny:
        names = "; ".join(str(rule) for rule in rules)
        raise InputError(f"{names}: too small for any schedule that sees the whole state")


def _certified(instance: Instance, dual: Dual, fractional: int, answer: _Answer, gap: float, notes: tuple[str, ...]) -> Schedule:
    """All numbers again, from the schedule and the dual alone."""
    value = instance.value(answer.chosen)
    root = max(bound_of(instance, dual)[0], value)  # they may cross by a rounding error
    bound = min(max(answer.bound, value), root)
    size = size_of(bound, instance)
    nothing = closed(value, bound, 0.0, instance)  # nothing but rounding errors, perhaps: of a direction that stays unseen
    reached = 0.0 if nothing else (bound - value) / size
    forced = instance.schedules.regrets(*instance.prices(dual))
    Z = dual.Z[0] if len(dual.Z) == 1 else dual.Z
    status = Status.OPTIMAL if reached <= gap else Status.GAP_OPEN
    return Schedule(answer.chosen, value, bound, root, reached, Z, dual.offset, dual.mu, *forced, fractional, answer.nodes, status, notes)


def _failed(instance: Instance) -> Schedule:
    K, S = instance.shape
    nothing = np.full((K, S), np.nan)
    Z = np.full((instance.n, instance.n), np.nan)
    return Schedule(
        np.zeros((K, S), dtype=bool), np.nan, np.nan, np.nan, np.nan, Z, np.nan, np.full(len(instance.resources), np.nan),
        nothing, nothing, 0, 0, Status.NUMERICAL_ERROR,
    )  # fmt: skip
