"""Choosing sensors: relax, bound in closed form, round, polish, prove."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from time import perf_counter

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.arguments import validate_arguments
from obsdesign.checks import require_count, require_positive
from obsdesign.criteria.abstract import AbstractCriterion
from obsdesign.criteria.min_eigenvalue import MinEigenvalue
from obsdesign.errors import InputError, SolveError
from obsdesign.rules.abstract import AbstractRule, Segments
from obsdesign.selection.build import posed
from obsdesign.selection.certificate import certified, failed, hidden_schedule, refused
from obsdesign.selection.integer.best_first_search import finished
from obsdesign.selection.integer.best_first_search import serves as serves_best_first
from obsdesign.selection.integer.eigenvector_cuts import cut, cuttable, note_of
from obsdesign.selection.integer.rounding import purified
from obsdesign.selection.integer.search import (
    Answer,
    Clock,
    Method,
    Wanted,
    few,
    incumbent,
    proven,
    searched,
    tried_all,
    worth_searching,
)
from obsdesign.selection.problem import Instance
from obsdesign.selection.relaxation.column_generation import Relaxed, closed, mixture_of, raised, relaxed, seen_through
from obsdesign.selection.relaxation.dual import Dual
from obsdesign.selection.relaxation.dual_interior_point import centred, serves
from obsdesign.selection.schedule import Schedule, require_blocks
from obsdesign.status import Status

_MANY_STATES = 9  # from here on column generation takes more rounds than Newton's method in all
_CENTRED = 1e-5  # of the value: what is left to the rounding is a hundred times as much
_SEES = 1e-9  # an eigenvalue, with all sensors' information about each state as unit, that a solver can tell from 0


@validate_arguments
def select_sensors(
    blocks: ArrayLike,
    per_segment: int = 1,
    *,
    rules: Sequence[AbstractRule] = (),
    criterion: AbstractCriterion | None = None,
    known: ArrayLike | None = None,
    about: Sequence[int] | None = None,
    method: Method = "auto",
    gap: float = 1e-9,
    time_limit: float | None = None,
    seed: int = 0,
    robust_to: int = 0,
    segments: Segments | None = None,
    throw: bool = True,
) -> Schedule:
    """Choose which sensors are on in which segment, with a proof of how good the choice is.

    max criterion(known + sum_k sum_s chosen_ks W_ks), at most per_segment sensors on in each segment, within the rules.

    Arguments:
        blocks (K, S, n, n): information W_ks of each segment and sensor, symmetric and >= 0, in any unit (scale them first: S W S).
        per_segment: how many sensors may be on at a time.
        rules: what schedules have to keep, and what switching costs.
        criterion: MinEigenvalue() (None), LogDet() or TraceInverse().
        known (n, n): information that is there without a sensor, added to every sum, in the blocks' units; None = none.
        about: indices of the states that are judged: the criterion is that of W_aa - W_ab W_bb^-1 W_ba, with the others estimated too;
            None = all.
        method: "auto": dual column generation, rounding and exchange, branch and bound, until the gap is closed or so much work is done
            (the same on every machine); "columns": without branch and bound; "direct": the relaxation by CVXPY and Clarabel in one
            piece, without branch and bound, a second opinion for small problems.
        gap: how near to the best the schedule is to be proven; Status OPTIMAL when it is reached, else GAP_OPEN.
        time_limit: stops any method with what it has [s]; None = never. Where branch and bound would not be done by then, an integer
            program (HiGHS) goes on from a sixth of that time, and notes say whose bound it is.
        seed: seed of the search.
        robust_to: how many sensors may be lost, whichever they are: the value is that of the worst loss.
        segments: the names, times and places that rules speak of.
        throw: False = return the failed Schedule instead of raising SolveError.
    Raises InputError for bad blocks and for rules that leave no choice, SolveError when no solver has an answer.
    Source: Brace and Morgansen, eq. (12), with the bounds of Lagrangian duality.
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
    instance = posed(array, per_segment, rules, criterion or MinEigenvalue(), robust_to, segments, known=known, about=about)
    return chosen_for(instance, rules, Wanted(method, gap, time_limit, seed), throw)


def without_sensors(instance: Instance, lost: tuple[int, ...]) -> Instance:
    """Return the problem in which some sensors are never available."""
    available = instance.schedules.available.copy()
    available[:, list(lost)] = False
    return replace(instance, schedules=replace(instance.schedules, available=available))


def chosen_for(instance: Instance, rules: tuple[AbstractRule, ...], wanted: Wanted, throw: bool, first: tuple[Dual, ...] = ()) -> Schedule:
    """Return the schedule of a problem; first: duals of a problem like it."""
    began = perf_counter()
    clock = Clock(began, np.inf if wanted.time_limit is None else began + wanted.time_limit)
    hidden = instance.hidden(instance.schedules.available)
    if hidden.any():
        return hidden_schedule(instance, hidden, throw)
    found, notes = _relaxation(instance, wanted, first)
    if found is None and not instance.criterion.is_smallest_eigenvalue:
        found, notes = raised(instance, 1e-8), ()
    if found is None:
        return _unanswered(instance, throw, not instance.criterion.is_smallest_eigenvalue and not _sees_everything(instance))
    whole = purified(instance, found)
    answer = incumbent(instance, found, whole, wanted, clock)
    listed = few(instance) if wanted.method == "auto" else None
    if listed is not None:
        answer = tried_all(instance, found, listed, answer, wanted)
    elif wanted.method == "auto" and worth_searching(instance):
        cuts = wanted.time_limit is not None and cuttable(instance)
        clock = replace(clock, finishes=serves_best_first(instance) or cuts)
        answer = searched(instance, found, answer, wanted, clock)
        answer = proven(instance, found, answer, wanted, clock)
        if serves_best_first(instance) and not closed(answer.value, answer.bound, wanted.gap, instance):
            answer = finished(instance, found, answer, wanted, clock)
        if cuts and not closed(answer.value, answer.bound, wanted.gap, instance):
            result = cut(instance, found, (answer.chosen, answer.value), wanted.gap, clock.left)
            notes = (*notes, note_of(result)) if result.bound < answer.bound else notes
            answer = Answer(result.chosen, result.value, min(answer.bound, result.bound), answer.nodes)
    _require_information(instance, rules, answer)
    if not np.isfinite(answer.value):
        return _unanswered(instance, throw, listed is not None or answer.bound == -np.inf or not _sees_everything(instance))
    return certified(instance, found.dual, whole.fractional, answer, wanted.gap, notes)


def _unanswered(instance: Instance, throw: bool, is_nothing: bool) -> Schedule:
    """What is said without a schedule of finite value: that every one is -inf, or that none was found."""
    if is_nothing:
        return refused(instance, throw)
    if throw:
        raise SolveError("sensor selection", Status.NUMERICAL_ERROR)
    return failed(instance)


def _relaxation(instance: Instance, wanted: Wanted, first: tuple[Dual, ...]) -> tuple[Relaxed | None, tuple[str, ...]]:
    accuracy = min(max(0.1 * wanted.gap, 1e-9), 1e-8)  # what it leaves open, no rounding makes good

    def by_columns() -> Relaxed | None:
        if instance.n >= _MANY_STATES and serves(instance):
            centre = centred(instance, max(accuracy, _CENTRED))
            return mixture_of(instance, centre.shares, centre.dual)
        return relaxed(instance, accuracy, first)

    def in_one_piece() -> Relaxed | None:
        from obsdesign.selection.relaxation.cvxpy_relaxation import relaxed_directly  # CVXPY takes a second to load

        return relaxed_directly(instance, wanted.time_limit)

    ways = ("column generation", by_columns), ("the relaxation in one piece", in_one_piece)
    (name, way), (other_name, other) = ways[::-1] if wanted.method == "direct" else ways
    found = way()
    return (found, ()) if found is not None else (other(), (f"{name} failed: {other_name} instead",))


def _require_information(instance: Instance, rules: tuple[AbstractRule, ...], answer: Answer) -> None:
    """Refuse budgets within which no schedule sees the whole state, while one does without them."""
    smallest = instance.criterion.is_smallest_eigenvalue
    if not instance.resources or not smallest or answer.value > 0 or instance.switching.any():
        return
    free = seen_through(replace(instance, resources=()))
    unit = float(instance.judge.metric.max())
    if free is not None and free.value > _SEES and answer.bound * unit <= _SEES * free.value:
        names = "; ".join(str(rule) for rule in rules)
        raise InputError(f"{names}: too small for any schedule that sees the whole state")


def _sees_everything(instance: Instance) -> bool:
    """Whether some mixture of schedules has information about every direction, as far as a solver can tell."""
    found = seen_through(instance)
    return found is None or found.value > _SEES
