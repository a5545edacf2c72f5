"""Filter runs side by side: one colour for each path and schedule."""

from __future__ import annotations

from dataclasses import dataclass

from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from obsdesign.estimation.validation import Validation
from obsdesign.report.figures._drawing import BLUE, GREEN, ORANGE, SKY, VERMILLION
from obsdesign.study.rated_schedules import FOR
from obsdesign.study.record import CHOSEN, FilterCheck, Study


@dataclass(frozen=True, eq=False)
class Case:
    """Filter runs, what they are called, their colour, and whether they are what the study is about."""

    validation: Validation
    label: str
    colour: str
    is_ours: bool


def cases_of(study: Study) -> list[Case]:
    """Return the filter runs of a study."""
    return [
        Case(check.validation, f"{check.path}, {check.schedule}", _colour(study, check), _is_ours(study, check)) for check in study.checks
    ]


def _colour(study: Study, check: FilterCheck) -> str:
    """Blue for the path of the study, red for the baseline, dark for the chosen schedule, green for that of the other question."""
    if check.schedule in FOR.values():
        return GREEN
    colours = {(True, True): BLUE, (True, False): SKY, (False, True): VERMILLION, (False, False): ORANGE}
    return colours[check.path == study.about, check.schedule == CHOSEN] if study.designs or _is_ours(study, check) else VERMILLION


def _is_ours(study: Study, check: FilterCheck) -> bool:
    """Whether a case is the path that the study is about with the chosen schedule."""
    return (check.path, check.schedule) == (study.about, CHOSEN)


def number_axis(axes: Axes, digits: tuple[float, ...]) -> None:
    """Label a logarithmic y axis with plain numbers, at the given digits of each decade."""
    axes.yaxis.set_major_locator(LogLocator(subs=digits))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_locator(NullLocator())
