"""Choosing sensors: relax, bound in closed form, round, polish, prove."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from logging import getLogger
from time import perf_counter

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.arguments import validate_arguments
from obsdesign.blas_threads import one_thread
from obsdesign.checks import require_count, require_positive
from obsdesign.criteria.abstract import AbstractCriterion
from obsdesign.criteria.min_eigenvalue import MinEigenvalue
from obsdesign.errors import InputError, SolveError
from obsdesign.progress import Progress, StageReport
from obsdesign.rules.abstract import AbstractRule, Segments
from obsdesign.selection.build import build_problem
from obsdesign.selection.certificate import certify, failure_schedule, hidden_schedule, reject
from obsdesign.selection.dual import Dual
from obsdesign.selection.integer.best_first_search import continue_best_first, supports_best_first
from obsdesign.selection.integer.eigenvector_cuts import cut_note, is_integer_program, solve_by_cuts
from obsdesign.selection.integer.rounding import purify
from obsdesign.selection.integer.search import (
    Clock,
    Incumbent,
    Method,
    SelectionOptions,
    enumerable_problem,
    enumerate_all,
    find_incumbent,
    is_tractable,
    prove_optimality,
    search_neighbourhoods,
)
from obsdesign.selection.problem import SelectionProblem
from obsdesign.selection.relaxation.column_generation import (
    RelaxedSolution,
    is_gap_closed,
    observable_mixture,
    solve_regularised,
    solve_relaxation,
    uniform_mixture,
)
from obsdesign.selection.relaxation.dual_interior_point import follow_central_path, is_applicable
from obsdesign.selection.schedule import Schedule, require_blocks
from obsdesign.status import Status

_LOGGER = getLogger(__name__)
_MANY_STATES = 9  # from here on column generation takes more rounds than Newton's method in all
_CENTRAL_PATH_GAP = 1e-5  # of the value: what is left to the rounding is a hundred times as much
_OBSERVABLE_EIGENVALUE = 1e-9  # an eigenvalue, with all sensors' information about each state as unit, that a solver can tell from 0


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
    progress: Progress | None = None,
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
        progress: is called with what is being done, as it begins; None = nobody is told.
    Raises InputError for bad blocks and for rules that leave no choice, SolveError when no solver has an answer.
    Source: Brace and Morgansen, eq. (12), with the bounds of Lagrangian duality.
    """
    array = require_blocks(np.asarray(blocks), per_segment)
    if not (np.isfinite(gap) and gap >= 0):
        raise InputError(f"gap is {gap!r}: must be a finite number of at least 0")
    if time_limit is not None:
        require_positive("time_limit", time_limit)
    require_count("seed", seed, minimum=0)
    if method not in ("auto", "columns", "direct"):
        raise InputError(f"method is {method!r}: must be 'auto', 'columns' or 'direct'")
    rules = tuple(rules)
    instance = build_problem(
        array, per_segment, rules, criterion or MinEigenvalue(), robust_to, segments, known_information=known, about=about
    )
    return solve_selection(instance, rules, SelectionOptions(method, gap, time_limit, seed), throw, progress=progress)


def without_sensors(instance: SelectionProblem, lost: tuple[int, ...]) -> SelectionProblem:
    """Return the problem in which some sensors are never available."""
    available = instance.schedules.available.copy()
    available[:, list(lost)] = False
    return replace(instance, schedules=replace(instance.schedules, available=available))


@one_thread()
def solve_selection(
    instance: SelectionProblem,
    rules: tuple[AbstractRule, ...],
    options: SelectionOptions,
    throw: bool,
    initial_duals: tuple[Dual, ...] = (),
    progress: Progress | None = None,
) -> Schedule:
    """Return the schedule of a problem; initial_duals: duals of a problem like it."""
    start, report = perf_counter(), StageReport(_LOGGER, progress)
    clock = Clock(start, np.inf if options.time_limit is None else start + options.time_limit)
    hidden = instance.hidden_directions(instance.schedules.available)
    if hidden.any():
        return hidden_schedule(instance, hidden, throw)
    report("the relaxation")
    relaxation, notes = _relaxation(instance, options, initial_duals)
    if relaxation is None:
        relaxation, notes = solve_regularised(instance, 1e-8), ()
    if relaxation is None:
        return _failure(instance, throw, not instance.criterion.is_smallest_eigenvalue and not _is_observable(instance))
    report("rounding and exchange")
    vertex = purify(instance, relaxation)
    incumbent = find_incumbent(instance, relaxation, vertex, options, clock)
    all_schedules = enumerable_problem(instance) if options.method == "auto" else None
    if all_schedules is not None:
        report("all schedules that are in question")
        incumbent = enumerate_all(instance, relaxation, all_schedules, incumbent, options)
    elif options.method == "auto" and is_tractable(instance):
        cuts = options.time_limit is not None and is_integer_program(instance)
        clock = replace(clock, has_finisher=supports_best_first(instance) or cuts)
        report("branch and bound near the best schedule")
        incumbent = search_neighbourhoods(instance, relaxation, incumbent, options, clock)
        report("branch and bound")
        incumbent = prove_optimality(instance, relaxation, incumbent, options, clock)
        if supports_best_first(instance) and not is_gap_closed(incumbent.value, incumbent.bound, options.gap, instance):
            report("branch and bound, best first")
            incumbent = continue_best_first(instance, relaxation, incumbent, options, clock)
        if cuts and not is_gap_closed(incumbent.value, incumbent.bound, options.gap, instance):
            report("an integer program")
            result = solve_by_cuts(instance, relaxation, (incumbent.chosen, incumbent.value), options.gap, clock.seconds_left)
            notes = (*notes, cut_note(result)) if result.bound < incumbent.bound else notes
            incumbent = Incumbent(result.chosen, result.value, min(incumbent.bound, result.bound), incumbent.nodes)
    _LOGGER.debug("value %.9g, bound %.9g, %d partial schedules", incumbent.value, incumbent.bound, incumbent.nodes)
    _require_information(instance, rules, incumbent)
    if not np.isfinite(incumbent.value):
        return _failure(instance, throw, all_schedules is not None or incumbent.bound == -np.inf or not _is_observable(instance))
    return certify(instance, relaxation.dual, vertex.fractional_segments, incumbent, options.gap, notes)


def _failure(instance: SelectionProblem, throw: bool, is_hopeless: bool) -> Schedule:
    """What is said without a schedule of finite value: that every one is -inf, or that none was found."""
    if is_hopeless:
        return reject(instance, throw)
    if throw:
        raise SolveError("sensor selection", Status.NUMERICAL_ERROR)
    return failure_schedule(instance)


def _relaxation(
    instance: SelectionProblem, options: SelectionOptions, initial_duals: tuple[Dual, ...]
) -> tuple[RelaxedSolution | None, tuple[str, ...]]:
    accuracy = min(max(0.1 * options.gap, 1e-9), 1e-8)  # what it leaves open, no rounding makes good

    def by_columns() -> RelaxedSolution | None:
        """Solve by column generation, or along the central path where states are many."""
        if instance.n >= _MANY_STATES and is_applicable(instance):
            centre = follow_central_path(instance, max(accuracy, _CENTRAL_PATH_GAP))
            return uniform_mixture(instance, centre.shares, centre.dual)
        return solve_relaxation(instance, accuracy, initial_duals)

    def by_cvxpy() -> RelaxedSolution | None:
        """Solve in one piece."""
        from obsdesign.selection.relaxation.cvxpy_relaxation import solve_with_cvxpy  # CVXPY takes a second to load

        return solve_with_cvxpy(instance, options.time_limit)

    methods = ("column generation", by_columns), ("the relaxation in one piece", by_cvxpy)
    (name, method), (fallback_name, fallback) = methods[::-1] if options.method == "direct" else methods
    relaxation = method()
    return (relaxation, ()) if relaxation is not None else (fallback(), (f"{name} failed: {fallback_name} instead",))


def _require_information(instance: SelectionProblem, rules: tuple[AbstractRule, ...], incumbent: Incumbent) -> None:
    """Refuse budgets within which no schedule sees the whole state, while one does without them."""
    smallest = instance.criterion.is_smallest_eigenvalue
    if not instance.resources or not smallest or incumbent.value > 0 or instance.switching.any():
        return
    unlimited = observable_mixture(replace(instance, resources=()))
    unit = float(instance.scaled_criterion.metric.max())
    if (
        unlimited is not None
        and unlimited.value > _OBSERVABLE_EIGENVALUE
        and incumbent.bound * unit <= _OBSERVABLE_EIGENVALUE * unlimited.value
    ):
        names = "; ".join(str(rule) for rule in rules)
        raise InputError(f"{names}: too small for any schedule that sees the whole state")


def _is_observable(instance: SelectionProblem) -> bool:
    """Whether some mixture of schedules has information about every direction, as far as a solver can tell."""
    mixture = observable_mixture(instance)
    return mixture is None or mixture.value > _OBSERVABLE_EIGENVALUE
