"""What a filter will know along the way, under the chosen schedule and under others, predicted before anything is measured."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from obsdesign.report.derived_quantities import drawing_suffix, states_of
from obsdesign.report.figures._cases import number_axis
from obsdesign.report.figures._drawing import (
    BLUE,
    FAINT,
    GREEN,
    INK,
    ORANGE,
    QUIET,
    VERMILLION,
    Picture,
    inline_svg,
    light_grid,
    styled_figure,
)
from obsdesign.report.names import path_in_words
from obsdesign.report.number_format import display_unit, signal_label
from obsdesign.signals import Signal
from obsdesign.study.rated_schedules import ALL_ON, FOR, GREEDY, ROUND_ROBIN, FilterAnswer
from obsdesign.study.record import Study

_LOOKS: dict[str, dict[str, Any]] = {
    FOR["filter"]: {"color": BLUE, "linewidth": 1.8, "zorder": 5},
    FOR["start"]: {"color": VERMILLION, "linewidth": 1.1, "zorder": 4},
    GREEDY: {"color": GREEN, "linewidth": 1.1, "linestyle": (0, (4, 2)), "zorder": 6},
    ROUND_ROBIN: {"color": ORANGE, "linewidth": 1.1, "zorder": 3},
    ALL_ON: {"color": INK, "linewidth": 1.1, "linestyle": (0, (1, 1.5)), "zorder": 3},
}


def picture(study: Study) -> Picture | None:
    """Return the predicted standard deviation of every state under each schedule; None where none was chosen for the filter."""
    answer = study.selection.filter
    if answer is None:
        return None
    figure = draw_predicted(answer, study.main.path.t[:-1], states_of(study))
    description = f"Predicted standard deviation of every state along {path_in_words(study.about)} under each schedule"
    return Picture(inline_svg(figure, f"predicted{drawing_suffix(study)}", description), _caption(answer))


def _caption(answer: FilterAnswer) -> str:
    """Say what lines and shade are."""
    shade = "; grey: nine of ten random schedules" if len(answer.random_costs) else ""
    return (
        "What a filter will know on the way: one standard deviation (1σ) of its error in each state just after the samples of an instant, "
        f"predicted from path, prior, process noise and schedule{shade}. Good: low, near all on, which no schedule is below."
    )


def draw_predicted(answer: FilterAnswer, t: np.ndarray, states: tuple[Signal, ...]) -> Figure:
    """Draw two panels to a row, one for each state, at instants t (N,) [s]."""
    rows, is_full = -(-len(states) // 2), len(states) % 2 == 0

    def paint(figure: Figure) -> None:
        """Draw on the figure."""
        panels = figure.subplots(rows, 2, sharex=True, squeeze=False).ravel()
        for i, signal in enumerate(states):
            _draw_state(answer, panels[i], t, i, signal)
        for axes in panels[max(len(states) - 2, 0) : len(states)]:
            axes.tick_params(labelbottom=True)
            axes.set_xlabel("time [s]")
        if is_full:
            figure.legend(handles=_keys(answer), loc="outside lower center", ncols=3)
        else:
            panels[-1].axis("off")
            panels[-1].legend(handles=_keys(answer), loc="upper left", borderaxespad=0.0)

    return styled_figure(0.5 + 1.6 * rows + 0.6 * is_full, paint)


def _keys(answer: FilterAnswer) -> list[Line2D | Patch]:
    """What line and colour mean."""
    lines: list[Line2D | Patch] = [Line2D([], [], label=name, **look) for name, look in _LOOKS.items() if answer.find(name) is not None]
    return [*lines, Patch(color=FAINT, label="random, 90 %")] if len(answer.random_costs) else lines


def _draw_state(answer: FilterAnswer, axes: Axes, t: np.ndarray, which: int, signal: Signal) -> None:
    factor, _ = display_unit(signal)
    light_grid(axes)
    shown = [factor * answer.band[:, :, which]] if len(answer.random_costs) else []
    for low, high in shown:
        axes.fill_between(t, low, high, color=FAINT, alpha=0.8, linewidth=0, zorder=1)
    for name, look in _LOOKS.items():
        rated = answer.find(name)
        if rated is not None:
            axes.plot(t, factor * rated.predicted[:, which], **look)
            shown.append(factor * rated.predicted[None, :, which])
    every = np.concatenate([values.ravel() for values in shown])
    every = every[np.isfinite(every) & (every > 0)]
    lowest, highest = (every.min(), every.max()) if len(every) else (0.1, 1.0)
    axes.set(yscale="log", ylim=(lowest / 1.2, 1.2 * highest), xlim=(t[0], t[-1] if len(t) > 1 else t[0] + 1))
    number_axis(axes, (1.0, 2.0, 5.0) if highest / lowest < 80 else (1.0,))
    axes.tick_params(axis="y", colors=QUIET, labelcolor=INK)
    axes.set_title(signal_label(signal))
