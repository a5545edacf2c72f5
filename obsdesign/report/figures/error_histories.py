"""How large the filter's errors are, and how large they must be."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from obsdesign.arguments import validate_arguments
from obsdesign.estimation.validation import Validation
from obsdesign.report.derived_quantities import drawing_suffix, states_of
from obsdesign.report.figures._cases import Case, cases_of, number_axis
from obsdesign.report.figures._drawing import BLUE, INK, Picture, inline_svg, light_grid, styled_figure
from obsdesign.report.names import path_in_words
from obsdesign.report.number_format import display_unit, signal_label
from obsdesign.signals import Signal
from obsdesign.study.record import Study

_DASHED = (0, (3, 2))


@validate_arguments
def errors(validation: Validation, states: Sequence[Signal] | None = None) -> Figure:
    """Draw the root mean square error of every state over time, with 1 sigma and the shade of 2 sigma of its Cramér-Rao bound.

    Arguments:
        validation: filter runs, as validate returns them.
        states: names and units of the n states, such as vehicle.states; None = by number. Angles are drawn in degrees.
    """
    signals = [Signal(f"state {i}") for i in range(validation.rmse.shape[1])] if states is None else states
    return draw_errors([Case(validation, "filter", BLUE, True)], signals, "bound, up to 2σ")


def picture(study: Study) -> Picture:
    """Return RMSE over time and its 1-sigma bound for every state and case, and the bound's 2 sigma for the designed case."""
    figure = draw_errors(cases_of(study), states_of(study), f"bound, up to 2σ,\n{study.about}, chosen")
    description = "Root mean square error of every state over time with its Cramér-Rao bound"
    return Picture(inline_svg(figure, f"errors{drawing_suffix(study)}", description), _caption(study))


def _caption(study: Study) -> str:
    """Say what lines and shade are."""
    runs = study.checks[0].validation.runs
    return (
        f"Solid: root mean square error of {runs} filter runs; dashed: the posterior Cramér-Rao bound, one standard deviation (1σ), "
        f"below which errors fall by chance only; shaded: up to 2σ of that bound on {path_in_words(study.about)} with the chosen schedule. "
        "Good: solid on dashed, and low."
    )


def draw_errors(cases: Sequence[Case], states: Sequence[Signal], shade: str) -> Figure:
    """Draw two panels to a row, one for each state; shade: what the shaded area is called."""
    rows, full = -(-len(states) // 2), len(states) % 2 == 0

    def paint(figure: Figure) -> None:
        """Draw on the figure."""
        panels = figure.subplots(rows, 2, sharex=True, squeeze=False).ravel()
        for i, signal in enumerate(states):
            _draw_state(cases, panels[i], i, signal)
        for axes in panels[max(len(states) - 2, 0) : len(states)]:
            axes.tick_params(labelbottom=True)
            axes.set_xlabel("time [s]")
        if full:
            figure.legend(handles=_keys(cases, shade), loc="outside lower center", ncols=2)
        else:
            panels[-1].axis("off")
            panels[-1].legend(handles=_keys(cases, shade), loc="upper left", borderaxespad=0.0)

    return styled_figure(0.5 + 1.6 * rows + 0.9 * full, paint)


def _keys(cases: Sequence[Case], shade: str) -> list[Line2D | Patch]:
    """What line and colour mean."""
    lines = [Line2D([], [], color=case.colour, linewidth=2, label=case.label) for case in cases]
    solid = Line2D([], [], color=INK, linewidth=1.1, label="RMSE")
    dashed = Line2D([], [], color=INK, linewidth=0.9, linestyle=_DASHED, label="bound, 1σ")
    return [*lines, solid, dashed, Patch(color=BLUE, alpha=0.12, linewidth=0, label=shade)]


def _draw_state(cases: Sequence[Case], axes: Axes, which: int, signal: Signal) -> None:
    factor, _ = display_unit(signal)
    light_grid(axes)
    lowest, highest = np.inf, 0.0
    for case in cases:
        t, rmse, bound = case.validation.t, factor * case.validation.rmse[:, which], factor * case.validation.bound[:, which]
        axes.plot(t, rmse, color=case.colour, linewidth=1.6 if case.is_ours else 1.1, zorder=4 if case.is_ours else 3)
        axes.plot(t, bound, color=case.colour, linewidth=0.9, linestyle=_DASHED, zorder=2)
        if case.is_ours:
            axes.fill_between(t, 1e-12, 2 * bound, color=BLUE, alpha=0.12, linewidth=0, zorder=1)
        lowest, highest = min(lowest, rmse.min(), bound.min()), max(highest, rmse.max(), bound.max())
    axes.set(yscale="log", ylim=(lowest / 1.4, 1.6 * highest), xlim=(cases[0].validation.t[[0, -1]]))
    number_axis(axes, (1.0, 2.0, 5.0) if highest / lowest < 80 else (1.0,))
    axes.set_title(signal_label(signal))
