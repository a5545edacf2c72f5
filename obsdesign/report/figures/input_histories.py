"""What the pilot does: the inputs over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from obsdesign.arguments import validate_arguments
from obsdesign.design.record import Design
from obsdesign.errors import InputError
from obsdesign.report.figures._drawing import BLUE, INK, Picture, inline_svg, legend_below, light_grid, path_colour, styled_figure
from obsdesign.report.number_format import display_unit, signal_label
from obsdesign.scenario.path_names import STRAIGHT
from obsdesign.signals import Signal
from obsdesign.study.record import Study
from obsdesign.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class Line:
    """A path, its name and colour, and whether it stands out."""

    name: str
    path: Trajectory
    colour: str
    is_wide: bool


@validate_arguments
def inputs(design: Design) -> Figure:
    """Draw the inputs of a designed path over time with their bounds.

    Arguments:
        design: the design, with a path.
    Raises InputError for a design without a path.
    """
    if design.trajectory is None:
        raise InputError(f"design: has no path to draw: {design.status.value}")
    problem = design.problem
    return draw_inputs(problem.system.model.inputs, [Line("designed", design.trajectory, BLUE, True)], problem.bounds)


def picture(study: Study) -> Picture:
    """Return every known input of every path but the straight one over time, with its bounds."""
    names = tuple(candidate.name for candidate in study.candidates)
    shown = [candidate for candidate in study.candidates if not (study.designs and candidate.name == STRAIGHT)]
    lines = [Line(each.name, each.path, path_colour(each.name, names), each.name == study.about) for each in shown]
    bounds = study.scenario.design.bounds if study.designs else {}
    end = (study.candidates[0].path.t[0], study.candidates[0].path.t[-1])
    figure = draw_inputs(study.scenario.system.model.inputs, lines, bounds, end)
    return Picture(inline_svg(figure, "inputs", "Inputs of the paths over time with their bounds"), _caption(study))


def _caption(study: Study) -> str:
    """Say what the input histories show."""
    if not study.designs:
        return "What is asked of the vehicle along each path."
    between = "between" if len(study.scenario.design.bounds) == 1 else "each between"
    return f"What is asked of the vehicle, {between} its dotted bounds; the straight path, inputs as near 0 as they allow, is left out."


def draw_inputs(
    signals: Sequence[Signal],
    lines: Sequence[Line],
    bounds: Mapping[str, tuple[float, float]],
    span: tuple[float, float] | None = None,
) -> Figure:
    """Draw a panel for each input, a line in it for each path; span: the first and last instant shown [s], None = of the first path."""
    first, last = (lines[0].path.t[0], lines[0].path.t[-1]) if span is None else span

    def paint(figure: Figure) -> None:
        """Draw on the figure."""
        panels = np.atleast_1d(figure.subplots(len(signals), 1, sharex=True))
        for which, (signal, axes) in enumerate(zip(signals, panels, strict=True)):
            light_grid(axes)
            axes.margins(y=0.08)
            for bound in bounds.get(signal.name, ()):
                axes.axhline(bound * display_unit(signal)[0], color=INK, linewidth=1, linestyle=":")
            _draw_lines(axes, lines, which, signal)
            axes.set(ylabel=signal_label(signal).replace("_", " "), xlim=(first, last))
        panels[-1].set_xlabel("time [s]")
        legend_below(figure, panels[-1])

    return styled_figure(1.1 + 1.7 * len(signals), paint)


def _draw_lines(axes: Axes, lines: Sequence[Line], which: int, signal: Signal) -> None:
    factor, _ = display_unit(signal)
    for line in lines:
        width, order = (2.0, 3) if line.is_wide else (1.1, 2)
        look = {"linewidth": width, "zorder": order, "color": line.colour, "label": line.name}
        axes.stairs(line.path.u[:, which] * factor, line.path.t, baseline=None, **look)
