"""Which sensors to have on when, of the samples that a log holds; and the samples that a schedule leaves of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from obsdesign.checks import as_array, require_known, require_positive
from obsdesign.criteria.abstract import AbstractCriterion, Over
from obsdesign.errors import InputError
from obsdesign.log_replay.question import ReplayQuestion
from obsdesign.logs.events import input_integrals
from obsdesign.logs.log import Log
from obsdesign.rules.abstract import AbstractRule
from obsdesign.selection.posterior.filter_schedule import FilterSchedule
from obsdesign.selection.posterior.filter_selection import select_for_filter
from obsdesign.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class ScheduleOptions:
    """How a schedule of a log is chosen, as for select_for_filter; step: of the grid [s]."""

    per_segment: int
    segment: float
    step: float
    over: Over
    criterion: AbstractCriterion | None
    rules: tuple[AbstractRule, ...]
    gap: float
    time_limit: float | None
    seed: int


def schedule_of_log(question: ReplayQuestion, path: Trajectory, options: ScheduleOptions) -> FilterSchedule:
    """Return the schedule along a path, taken at equal steps, with the samples of the log, each at its own time."""
    require_positive("segment", options.segment)
    require_positive("step", options.step)
    step, span = options.step, float(path.t[-1] - path.t[0])
    steps = int(span / step + 1e-9)
    if not steps:
        raise InputError(f"step is {step:g} s: must be at most the {span:.6g} s of the log")
    t = path.t[0] + step * np.arange(steps + 1)
    x = np.column_stack([np.interp(t, path.t, column) for column in path.x.T])
    return select_for_filter(
        question.system,
        Trajectory(t, x, input_integrals(question.system.model, question.log, t) / step),
        question.prior,
        options.per_segment,
        segment=options.segment,
        disturbance_psd=question.disturbance_psd,
        input_psd=question.input_psd,
        about=question.about,
        samples=question.log,
        over=options.over,
        criterion=options.criterion,
        rules=options.rules,
        gap=options.gap,
        time_limit=options.time_limit,
        seed=options.seed,
    )


def active_log(log: Log, active: FilterSchedule | Sequence[str] | np.ndarray) -> Log:
    """Return the log with the samples that count: of a schedule, of the sensors that are named, or those that are chosen (K,)."""
    if isinstance(active, FilterSchedule):
        return scheduled_log(log, active.chosen, active.boundaries, active.sensors)
    names = tuple(active) if isinstance(active, Sequence) else ()
    if names and all(isinstance(name, str) for name in names):
        require_known("active: the log's sensors", names, log.samples.names)
        return _log_where(log, np.isin(log.samples.sensor, [log.samples.names.index(name) for name in names]))
    chosen = as_array("active", active)
    if chosen.shape != log.samples.t.shape or not np.isin(chosen, (0.0, 1.0)).all():
        raise InputError(f"active has shape {chosen.shape}: must be {log.samples.t.shape}, true or false for each sample in order of time")
    return _log_where(log, chosen > 0)


def scheduled_log(log: Log, chosen: np.ndarray, boundaries: np.ndarray, sensors: Sequence[str]) -> Log:
    """Return the log with the samples of sensors that are on, chosen (K, S), between boundaries (K+1,) [s]; none before or after."""
    samples = log.samples
    segment = np.searchsorted(boundaries, samples.t, side="right") - 1
    inside = (segment >= 0) & (segment < len(chosen))
    column = np.array([list(sensors).index(name) if name in sensors else -1 for name in samples.names])[samples.sensor]
    is_on = inside & (column >= 0)
    is_on[is_on] = chosen[segment[is_on], column[is_on]]
    return _log_where(log, is_on)


def _log_where(log: Log, chosen: np.ndarray) -> Log:
    return Log(log.inputs, log.samples.where(chosen), log.truth, log.epoch, log.notes)
