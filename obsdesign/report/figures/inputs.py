"""What the pilot does: the inputs over time."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from obsdesign.report.figures._drawing import INK, inline_svg, legend_below, light_grid, path_colour
from obsdesign.report.number_format import display_unit, signal_label
from obsdesign.scenario.schema import STRAIGHT
from obsdesign.study.record import Study


def inputs_figure(study: Study) -> str:
    """Draw every known input of every path but the straight one over time, with its bounds."""
    count = len(study.scenario.system.model.inputs)

    def paint(figure: Figure) -> None:
        panels = np.atleast_1d(figure.subplots(count, 1, sharex=True))
        for i, axes in enumerate(panels):
            _draw_input(study, axes, i)
        panels[-1].set_xlabel("time [s]")
        legend_below(figure, panels[-1])

    return inline_svg("inputs", "Inputs of the paths over time with their bounds", 1.1 + 1.7 * count, paint)


def _draw_input(study: Study, axes: Axes, which: int) -> None:
    signal = study.scenario.system.model.inputs[which]
    factor, _ = display_unit(signal)
    names = tuple(candidate.name for candidate in study.candidates)
    light_grid(axes)
    axes.margins(y=0.08)
    for bound in study.scenario.design.bounds[signal.name] if study.designs else ():
        axes.axhline(bound * factor, color=INK, linewidth=1, linestyle=":")
    for candidate in study.candidates:
        if study.designs and candidate.name == STRAIGHT:
            continue
        path, wide = candidate.path, candidate.name == study.about
        colour = path_colour(candidate.name, names)
        look = {"linewidth": 2.0 if wide else 1.1, "zorder": 3 if wide else 2, "color": colour, "label": candidate.name}
        axes.stairs(path.u[:, which] * factor, path.t, baseline=None, **look)
    axes.set(ylabel=signal_label(signal).replace("_", " "), xlim=(study.candidates[0].path.t[0], study.candidates[0].path.t[-1]))
