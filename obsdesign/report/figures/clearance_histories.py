"""How far paths keep from the circle through three beacons, and from moving along it."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from obsdesign.constraints.circle_clearance import CircleClearance
from obsdesign.design.nlp.node_functions import node_functions_of
from obsdesign.report.figures._drawing import INK, Picture, inline_svg, legend_below, light_grid, path_colour, styled_figure
from obsdesign.report.names import path_in_words
from obsdesign.report.number_format import NARROW, numeral
from obsdesign.scenario.path_names import DESIGNED
from obsdesign.study.record import Study

_ROUND_OFF = 1e-9  # [m] below which a distance is 0


def picture(study: Study) -> Picture | None:
    """Return sqrt(f^2 + (T df/dt)^2) over time for the designed path and the baseline; None without such a constraint."""
    limits = _limits(study)
    if not limits:
        return None

    def paint(figure: Figure) -> None:
        """Draw on the figure."""
        panels = np.atleast_1d(figure.subplots(len(limits), 1, sharex=True))
        for i, axes in enumerate(panels):
            _draw(study, axes, i)
        panels[-1].set_xlabel("time [s]")
        legend_below(figure, panels[-1])

    description = "Clearance of the paths from the circle through the beacons over time"
    return Picture(inline_svg(styled_figure(1.1 + 2.2 * len(limits), paint), "clearance", description), _caption(study))


def _caption(study: Study) -> str:
    """Say what keeps a path clear of the circle."""
    low, ours = (min(values[0].min() for values in clearances(study, name)) for name in (study.baseline, study.about))
    low = 0.0 if low < _ROUND_OFF else low
    least = f"{numeral(low)}{NARROW}m at least, on the designed path {numeral(ours)}{NARROW}m"
    return (
        "√(f² + (T ḟ)²) with f the distance from the circle through the beacons and T the constraint's time scale: 0 is moving along the "
        "circle, on which bearings to the three cannot tell how far along it one is; the dotted line is the least that is allowed. "
        f"On {path_in_words(study.baseline)} it is {least}."
    )


def clearances(study: Study, name: str) -> list[np.ndarray]:
    """Return sqrt(f^2 + (T df/dt)^2) (1, N) [m] along a path at the beginning of every step, for every such constraint."""
    path, limits = study.candidate(name).path, _limits(study)
    margins = node_functions_of(study.problem.system.model, limits).values(path.x[:-1], path.u)
    return [_distance(limit, margins[:, [i]].T) for i, limit in enumerate(limits)]


def _limits(study: Study) -> tuple[CircleClearance, ...]:
    return tuple(constraint for constraint in study.scenario.design.constraints if isinstance(constraint, CircleClearance))


def _distance(limit: CircleClearance, margin: np.ndarray) -> np.ndarray:
    """Undo the constraint's margin (s - clearance) / clearance, s being rounded within 0.001 clearance of 0."""
    soft = (1e-3 * limit.clearance) ** 2
    smoothed_distance = margin * limit.clearance + np.sqrt(limit.clearance**2 + soft)
    return np.sqrt(np.maximum(smoothed_distance**2 - soft, 0.0))


def _draw(study: Study, axes: Axes, which: int) -> None:
    limit, names = _limits(study)[which], tuple(candidate.name for candidate in study.candidates)
    light_grid(axes)
    axes.axhline(limit.clearance, color=INK, linewidth=1, linestyle=":")
    t = study.main.path.t
    for name in dict.fromkeys((study.baseline, DESIGNED)):
        axes.plot(t[:-1], clearances(study, name)[which][0], color=path_colour(name, names), label=name)
    axes.set(ylabel="clearance [m]", xlim=(t[0], t[-1]), ylim=(-0.03 * axes.get_ylim()[1], None))
