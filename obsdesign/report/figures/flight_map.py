"""Where a flight went that was planned anew on the way."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from obsdesign.planning.closed_loop import Flight
from obsdesign.report.figures._drawing import BLUE, INK, QUIET, VERMILLION, WIDTH, Picture, inline_svg, light_grid, styled_figure
from obsdesign.report.figures._map import Shape, draw_landmarks, draw_shapes, shapes
from obsdesign.study.record import Study

_MAX_ENLARGEMENT = 1.4  # how much larger the map may become for a beacon


def picture(study: Study) -> Picture | None:
    """Return the true path and what the filter took for it, where it was planned anew, and the path of the inputs' middles."""
    flight = study.flight
    if flight is None or not {"x", "y"} <= set(study.scenario.state_names):
        return None
    low, high = _extent(study, flight)
    height = float(np.clip((WIDTH - 0.9) * (high - low)[1] / (high - low)[0], 1.6, 5.0)) + 1.5

    def paint(figure: Figure) -> None:
        """Draw on the figure."""
        axes = figure.add_subplot()
        light_grid(axes)
        draw_shapes(axes, _shapes(study))
        draw_landmarks(axes, [point for point in study.scenario.system.model.landmarks if np.all((low <= point) & (point <= high))])
        _draw_paths(study, flight, axes)
        axes.set(xlabel="x [m]", ylabel="y [m]")
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlim(low[0], high[0], auto=True)
        axes.set_ylim(low[1], high[1], auto=True)
        figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=2)

    svg = inline_svg(styled_figure(height, paint), "flight-map", "Map of the flight: true path, estimate and instants of planning")
    caption = (
        "One flight, its start and disturbances drawn from the scenario's prior and noise. Where it leaves the path that was designed "
        "beforehand, the filter has learnt that things are not as believed at the start. Red: the same flight, with the same noise, all "
        "inputs in the middle of their ranges."
    )
    return Picture(svg, caption)


def planning_steps(study: Study, flight: Flight) -> np.ndarray:
    """Steps at which a plan was made."""
    interval = 1 if study.scenario.flight is None else round(study.scenario.flight.every / study.scenario.time.step)
    return np.arange(0, len(flight.u), interval)


def _shapes(study: Study) -> list[Shape]:
    return shapes(study.scenario.design.constraints, study.scenario.system.model.landmarks)


def _positions(study: Study, states: np.ndarray) -> np.ndarray:
    return states[:, list(study.problem.position)]


def _extent(study: Study, flight: Flight) -> tuple[np.ndarray, np.ndarray]:
    points = [
        _positions(study, flight.truth),
        _positions(study, flight.mean),
        *(shape.points for shape in _shapes(study) if not shape.is_wide),
    ]
    low, high = np.vstack(points).min(axis=0), np.vstack(points).max(axis=0)
    for point in study.scenario.system.model.landmarks:
        lower, higher = np.minimum(low, point), np.maximum(high, point)
        if np.max(higher - lower) <= _MAX_ENLARGEMENT * np.max(high - low):
            low, high = lower, higher
    margin = 0.06 * float(np.max(high - low))
    return low - margin, high + margin


def _draw_paths(study: Study, flight: Flight, axes: Axes) -> None:
    truth, nodes = _positions(study, flight.truth), planning_steps(study, flight)
    axes.plot(*_positions(study, study.main.path.x).T, color=QUIET, linewidth=1.1, linestyle="--", label="designed beforehand", zorder=2)
    if flight.straight is not None:
        axes.plot(*_positions(study, flight.straight.truth).T, color=VERMILLION, linewidth=1.1, label="inputs mid-range", zorder=2)
    axes.plot(*truth.T, color=BLUE, linewidth=2.4, label="true path", zorder=3)
    axes.plot(*_positions(study, flight.mean).T, color=INK, linewidth=0.9, linestyle=":", label="filter's estimate", zorder=4)
    look = {"linestyle": "none", "marker": "o", "markersize": 3.5, "color": BLUE, "markerfacecolor": "white"}
    axes.plot(*truth[nodes].T, label="planned anew", zorder=5, **look)
    axes.plot(*truth[0], linestyle="none", marker="o", markersize=7, markerfacecolor="white", markeredgecolor=INK, label="start", zorder=6)
