"""Which sensors would have done?"""

from __future__ import annotations

from obsdesign.report.number_format import percent, with_unit
from obsdesign.report.replay_figures import chosen_raster, schedule_bars
from obsdesign.report.section import Section
from obsdesign.selection.posterior.filter_schedule import FilterSchedule
from obsdesign.study.log_study import LogStudy


def section(study: LogStudy, schedule: FilterSchedule) -> Section:
    """Return the answer to "Which sensors would have done?"."""
    count, sensors = study.setup.choice.per_segment, len(schedule.sensors)
    errors = {item.name: item.rmse for item in study.schedule_errors}
    signal = study.replay.question.signal
    with_all = with_unit(errors.get("all on", float("nan")), signal)
    cost = ""
    if errors:
        cost = f" The filter errs by {with_unit(errors['chosen'], signal)} with {count} of {sensors} at a time, by {with_all} with all."
    what = "what a filter knows along the way, of the samples that arrived"
    answer = f"The schedule is within {percent(schedule.gap)} of the best: {what}.{cost}"
    raster = chosen_raster.picture(schedule, float(study.replay.t[0]))
    bars = schedule_bars.picture(study)
    return Section("schedule", "Which sensors would have done?", answer, (raster,) if bars is None else (bars, raster), (), schedule.notes)
