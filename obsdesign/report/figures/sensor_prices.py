"""What matters when: what each sensor is worth to the filter in each segment."""

from __future__ import annotations

import numpy as np

from obsdesign.report.derived_quantities import drawing_suffix
from obsdesign.report.figures._amounts import draw_amounts
from obsdesign.report.figures._drawing import Picture, inline_svg
from obsdesign.report.names import path_in_words
from obsdesign.selection.posterior.filter_schedule import FilterSchedule
from obsdesign.study.record import Study


def picture(study: Study) -> Picture | None:
    """Return what each sensor is worth in each segment; None where there is no schedule for the filter."""
    answer = study.selection.filter
    if answer is None or not np.isfinite(answer.schedule.value):
        return None
    is_share = study.scenario.filter_criterion.gap_kind == "relative"
    schedule = answer.schedule
    label = "worth to the filter" + (" [% of the cost]" if is_share else " [–]")
    figure = draw_amounts(sensor_worth(schedule, is_share).T, schedule.chosen, schedule.sensors, schedule.boundaries, label)
    description = f"What each sensor is worth to the filter in each segment of {path_in_words(study.about)}"
    return Picture(inline_svg(figure, f"worth{drawing_suffix(study)}", description), _caption(is_share))


def sensor_worth(schedule: FilterSchedule, is_share: bool) -> np.ndarray:
    """Return what each sensor is worth in each segment (K, S): in per cent of the schedule's cost, or in its unit."""
    return schedule.prices * (100 / abs(schedule.value) if is_share else 1.0)


def _caption(is_share: bool) -> str:
    """Say what the colours mean."""
    unit = ", as a share of the schedule's cost" if is_share else ""
    return (
        "What matters when, for the filter: by how much the cost rises where a sensor that is on (a dot) is left out in that segment "
        f"alone, or falls where one that is off is added, all else as chosen{unit}. Dark matters much, white not at all."
    )
