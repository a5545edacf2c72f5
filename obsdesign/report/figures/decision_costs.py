"""What it costs to decide otherwise: sensor by sensor, segment by segment."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from obsdesign.arguments import validate_arguments
from obsdesign.report.derived_quantities import drawing_suffix, segment_nodes
from obsdesign.report.figures._amounts import draw_amounts
from obsdesign.report.figures._drawing import Picture, inline_svg
from obsdesign.report.figures.schedule_raster import sensor_labels
from obsdesign.report.names import path_in_words
from obsdesign.selection.schedule import Schedule
from obsdesign.study.record import Study


@validate_arguments
def regret(schedule: Schedule, names: Sequence[str] | None = None, t: Sequence[float] | None = None) -> Figure:
    """Draw how much the bound falls for every decision that is taken otherwise, in the criterion's unit.

    Arguments:
        schedule: the schedule, of K segments and S sensors.
        names: what the S sensors are called; None = by number.
        t: where the segments begin and end (K+1,) [s]; None = segments are numbered.
    """
    return draw_regret(schedule, sensor_labels(schedule, names), t, absolute=True)


def picture(study: Study) -> Picture | None:
    """Return what deciding otherwise costs; None where there is no bound to compare with."""
    schedule = study.selection.schedule
    if not (np.isfinite(schedule.root_bound) and schedule.root_bound != 0):
        return None
    absolute = study.scenario.schedule_criterion.gap_kind == "absolute"
    figure = draw_regret(schedule, study.scenario.sensor_names, segment_nodes(study), absolute)
    description = f"What it costs to switch each sensor otherwise in each segment of {path_in_words(study.about)}"
    return Picture(inline_svg(figure, f"regret{drawing_suffix(study)}", description), _caption(schedule))


def deviation_costs(schedule: Schedule) -> np.ndarray:
    """Return (K, S): how much the bound falls when a sensor is forced off where it is on, on where it is off."""
    return np.where(schedule.chosen, schedule.forced_off, schedule.forced_on)


def count_proven_decisions(schedule: Schedule) -> tuple[int, int]:
    """How many of the decisions no better schedule takes otherwise, and how many there are."""
    cost = deviation_costs(schedule)
    return int((cost > schedule.root_bound - schedule.value).sum()), cost.size


def _caption(schedule: Schedule) -> str:
    """Say what the colours mean, and how many of the decisions are proven."""
    sure, total = count_proven_decisions(schedule)
    return (
        "What deciding otherwise costs, for the start: by how much the bound falls when a sensor that is off (a dot: on) is forced on "
        f"(off) in that segment. Dark costs much, white nothing. Where it costs more than what lies between the schedule and the bound, "
        f"here {sure} of {total} decisions, every schedule that is better decides the same."
    )


def draw_regret(schedule: Schedule, names: Sequence[str], t: Sequence[float] | np.ndarray | None, absolute: bool) -> Figure:
    """Draw what deciding otherwise costs, in the criterion's unit (absolute) or as a share of the bound."""
    cost = deviation_costs(schedule).T / (1.0 if absolute else abs(schedule.root_bound) / 100)
    label = "cost of deciding otherwise" + (" [–]" if absolute else " [% of the bound]")
    return draw_amounts(cost, schedule.chosen, names, t, label)
