"""What a filter will know of what is required, against the limit, under the cheapest schedule and under others."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from obsdesign.report.derived_quantities import drawing_suffix
from obsdesign.report.figures._cases import number_axis
from obsdesign.report.figures._drawing import BLUE, INK, ORANGE, QUIET, VERMILLION, Picture, inline_svg, light_grid, styled_figure
from obsdesign.report.names import path_in_words
from obsdesign.report.number_format import display_unit
from obsdesign.selection.posterior.requirement import RequiredKnowledge
from obsdesign.signals import Signal
from obsdesign.study.rated_schedules import ALL_ON, FOR, RatedSchedule
from obsdesign.study.record import Study

_LOOKS = {
    FOR["cheapest"]: {"color": BLUE, "linewidth": 1.8, "zorder": 5},
    FOR["filter"]: {"color": ORANGE, "linewidth": 1.1, "zorder": 4},
    ALL_ON: {"color": INK, "linewidth": 1.1, "linestyle": (0, (1, 1.5)), "zorder": 3},
}
_LIMIT = {"color": VERMILLION, "linewidth": 1.4, "linestyle": (0, (5, 2)), "zorder": 6}
_CAPTION = (
    "What is required: the predicted error (1σ) just after the samples of an instant, of several states the root of the summed variances, "
    "and the limit, drawn where it counts. Good: blue below the dashes; all on is the least there can be."
)


def picture(study: Study) -> Picture | None:
    """Return the predicted error of each requirement beside its limit; None where nothing is required."""
    answer, rated = study.selection.cheapest, study.selection.filter
    if answer is None or rated is None:
        return None
    shown = tuple(schedule for schedule in rated.rated if schedule.name in _LOOKS)
    figure = draw_required(answer.required, shown, study.main.path.t[:-1])
    description = f"Predicted error of what is required along {path_in_words(study.about)}, and its limit"
    return Picture(inline_svg(figure, f"required{drawing_suffix(study)}", description), _CAPTION)


def draw_required(required: tuple[RequiredKnowledge, ...], shown: tuple[RatedSchedule, ...], t: np.ndarray) -> Figure:
    """Draw a panel for each requirement, at instants t (N,) [s]."""

    def paint(figure: Figure) -> None:
        """Draw on the figure."""
        panels = figure.subplots(len(required), 1, sharex=True, squeeze=False).ravel()
        for axes, requirement in zip(panels, required, strict=True):
            _draw_one(axes, requirement, shown, t)
        panels[-1].set_xlabel("time [s]")
        keys = [Line2D([], [], label=rated.name, **_LOOKS[rated.name]) for rated in shown]
        figure.legend(handles=[*keys, Line2D([], [], label="limit", **_LIMIT)], loc="outside lower center", ncols=4)

    return styled_figure(1.1 + 1.8 * len(required), paint)


def _draw_one(axes: Axes, required: RequiredKnowledge, shown: tuple[RatedSchedule, ...], t: np.ndarray) -> None:
    signal = Signal(" and ".join(required.requirement.about), required.unit)
    factor, unit = display_unit(signal)
    light_grid(axes)
    limit = np.where(required.counted, factor * required.requirement.at_most, np.nan)
    axes.plot(t, limit, **_LIMIT)
    curves = [factor * required.deviations(rated.predicted) for rated in shown]
    for rated, curve in zip(shown, curves, strict=True):
        axes.plot(t, curve, **_LOOKS[rated.name])
    drawn = np.concatenate([limit, *curves])
    drawn = drawn[np.isfinite(drawn) & (drawn > 0)]
    axes.set(yscale="log", ylim=(drawn.min() / 1.2, 1.2 * drawn.max()), xlim=(t[0], t[-1] if len(t) > 1 else t[0] + 1))
    number_axis(axes, (1.0, 2.0, 5.0) if drawn.max() / drawn.min() < 80 else (1.0,))
    axes.tick_params(axis="y", colors=QUIET, labelcolor=INK)
    axes.set_title(f"{signal.name} [{unit or '–'}]")
