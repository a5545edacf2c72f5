"""How large the filter's errors are, and how large they must be."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from obsdesign.report.derived_quantities import CHOSEN, drawing_suffix, states_of
from obsdesign.report.figures._drawing import BLUE, INK, ORANGE, SKY, VERMILLION, inline_svg, light_grid
from obsdesign.report.number_format import display_unit, signal_label
from obsdesign.signals import Signal
from obsdesign.study.record import FilterCheck, Study

_DASHED = (0, (3, 2))


def errors_figure(study: Study) -> str:
    """Draw RMSE over time and its 1-sigma bound for every state and case, and the bound's 2 sigma for the designed case."""
    states = states_of(study)
    rows = -(-len(states) // 2)
    full = len(states) % 2 == 0

    def paint(figure: Figure) -> None:
        panels = figure.subplots(rows, 2, sharex=True, squeeze=False).ravel()
        for i, signal in enumerate(states):
            _draw_state(study, panels[i], i, signal)
        for axes in panels[max(len(states) - 2, 0) : len(states)]:
            axes.tick_params(labelbottom=True)
            axes.set_xlabel("time [s]")
        if full:
            figure.legend(handles=_keys(study), loc="outside lower center", ncols=2)
        else:
            panels[-1].axis("off")
            panels[-1].legend(handles=_keys(study), loc="upper left", borderaxespad=0.0)

    description = "Root mean square error of every state over time with its Cramér-Rao bound"
    return inline_svg(f"errors{drawing_suffix(study)}", description, 0.5 + 1.6 * rows + 0.9 * full, paint)


def case_colour(study: Study, check: FilterCheck) -> str:
    """Return the colour of a case: blue for the path of the study, red for the baseline, dark for the chosen schedule."""
    colours = {(True, True): BLUE, (True, False): SKY, (False, True): VERMILLION, (False, False): ORANGE}
    return colours[check.path == study.about, check.schedule == CHOSEN] if study.designs or is_ours(study, check) else VERMILLION


def is_ours(study: Study, check: FilterCheck) -> bool:
    """Whether a case is the path that the study is about with the chosen schedule."""
    return (check.path, check.schedule) == (study.about, CHOSEN)


def _keys(study: Study) -> list[Line2D | Patch]:
    """What line and colour mean."""
    named = [(case_colour(study, check), f"{check.path}, {check.schedule}") for check in study.checks]
    cases = [Line2D([], [], color=colour, linewidth=2, label=name) for colour, name in named]
    solid = Line2D([], [], color=INK, linewidth=1.1, label="RMSE")
    dashed = Line2D([], [], color=INK, linewidth=0.9, linestyle=_DASHED, label="bound, 1σ")
    return [*cases, solid, dashed, Patch(color=BLUE, alpha=0.12, linewidth=0, label=f"bound, up to 2σ,\n{study.about}, chosen")]


def _draw_state(study: Study, axes: Axes, which: int, signal: Signal) -> None:
    factor, _ = display_unit(signal)
    light_grid(axes)
    lowest, highest = np.inf, 0.0
    for check in study.checks:
        t, rmse, bound = check.validation.t, factor * check.validation.rmse[:, which], factor * check.validation.bound[:, which]
        colour, ours = case_colour(study, check), is_ours(study, check)
        axes.plot(t, rmse, color=colour, linewidth=1.6 if ours else 1.1, zorder=4 if ours else 3)
        axes.plot(t, bound, color=colour, linewidth=0.9, linestyle=_DASHED, zorder=2)
        if ours:
            axes.fill_between(t, 1e-12, 2 * bound, color=BLUE, alpha=0.12, linewidth=0, zorder=1)
        lowest, highest = min(lowest, rmse.min(), bound.min()), max(highest, rmse.max(), bound.max())
    axes.set(yscale="log", ylim=(lowest / 1.4, 1.6 * highest), xlim=(study.checks[0].validation.t[[0, -1]]))
    number_axis(axes, (1.0, 2.0, 5.0) if highest / lowest < 80 else (1.0,))
    axes.set_title(signal_label(signal))


def number_axis(axes: Axes, digits: tuple[float, ...]) -> None:
    """Label a logarithmic y axis with plain numbers, at the given digits of each decade."""
    axes.yaxis.set_major_locator(LogLocator(subs=digits))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_locator(NullLocator())
