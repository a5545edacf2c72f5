"""How large the filter's errors are, and how large they must be."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from obsdesign.report.facts import CHOSEN, DESIGNED, states_of
from obsdesign.report.figures._drawing import BLUE, ORANGE, SKY, VERMILLION, inline_svg, light_grid
from obsdesign.report.rounding import label, readable
from obsdesign.signals import Signal
from obsdesign.study import Check, Study


def errors_figure(study: Study) -> str:
    """Draw RMSE over time and its 1-sigma bound for every state and case, and the bound's 2 sigma for the designed case."""
    states = states_of(study)
    rows = -(-len(states) // 2)

    def paint(figure: Figure) -> None:
        panels = figure.subplots(rows, 2, sharex=True, squeeze=False).ravel()
        for i, signal in enumerate(states):
            _draw_state(study, panels[i], i, signal)
        for axes in panels[len(states) :]:
            axes.remove()
        for axes in panels[max(len(states) - 2, 0) : len(states)]:
            axes.tick_params(labelbottom=True)
            axes.set_xlabel("time [s]")
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)

    return inline_svg("errors", "Root mean square error of every state over time with its Cramér-Rao bound", 1.2 + 1.55 * rows, paint)


def case_colour(check: Check) -> str:
    """Return the colour of a case: blue for the designed path, red for the straight one, dark for the chosen schedule."""
    colours = {(True, True): BLUE, (True, False): SKY, (False, True): VERMILLION, (False, False): ORANGE}
    return colours[check.path == DESIGNED, check.schedule == CHOSEN]


def _draw_state(study: Study, axes: Axes, which: int, signal: Signal) -> None:
    factor, _ = readable(signal)
    light_grid(axes)
    lowest, highest = np.inf, 0.0
    for check in study.checks:
        t, rmse, bound = check.validation.t, factor * check.validation.rmse[:, which], factor * check.validation.bound[:, which]
        colour, ours = case_colour(check), (check.path, check.schedule) == (DESIGNED, CHOSEN)
        axes.plot(t, rmse, color=colour, linewidth=1.6 if ours else 1.1, label=f"{check.path}, {check.schedule}", zorder=4 if ours else 3)
        axes.plot(t, bound, color=colour, linewidth=0.9, linestyle=(0, (3, 2)), zorder=2)
        if ours:
            axes.fill_between(t, 1e-12, 2 * bound, color=BLUE, alpha=0.12, linewidth=0, zorder=1)
        lowest, highest = min(lowest, rmse.min(), bound.min()), max(highest, rmse.max(), bound.max())
    axes.set(yscale="log", ylim=(lowest / 1.4, 1.6 * highest), xlim=(study.checks[0].validation.t[0], study.checks[0].validation.t[-1]))
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if highest / lowest < 80 else (1.0,)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.set_title(label(signal))
