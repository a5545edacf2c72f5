"""Where the path goes that was chosen together with its schedule."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from obsdesign.joint.result import AnyJoint
from obsdesign.report.derived_quantities import PATH_FIRST, SENSORS_FIRST, TOGETHER, joint_answers
from obsdesign.report.figures._drawing import (
    BLUE,
    GREEN,
    INK,
    ORANGE,
    PURPLE,
    QUIET,
    SKY,
    VERMILLION,
    WIDTH,
    Picture,
    inline_svg,
    light_grid,
    styled_figure,
)
from obsdesign.report.figures._map import draw_landmarks, draw_shapes, shapes
from obsdesign.study.record import Study

_SENSORS = (BLUE, VERMILLION, GREEN, ORANGE, PURPLE, SKY, INK)


def picture(study: Study) -> Picture | None:
    """Return the joint path, each segment in the colour of what is on, and the paths of the one-sided answers."""
    joint = study.joint
    if joint is None or joint.design.trajectory is None or not {"x", "y"} <= set(study.scenario.state_names):
        return None
    tracks = _tracks(study, joint)
    map_shapes = shapes(study.scenario.design.constraints, study.scenario.system.model.landmarks)
    points = np.vstack([*tracks.values(), *(shape.points for shape in map_shapes if not shape.is_wide)])
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.06 * float(np.max(high - low))
    low, high = low - margin, high + margin
    height = float(np.clip((WIDTH - 0.9) * (high - low)[1] / (high - low)[0], 1.6, 5.0)) + 1.9

    def paint(figure: Figure) -> None:
        """Draw on the figure."""
        axes = figure.add_subplot()
        light_grid(axes)
        draw_shapes(axes, map_shapes)
        draw_landmarks(axes, [point for point in study.scenario.system.model.landmarks if np.all((low <= point) & (point <= high))])
        _draw(study, joint, tracks, axes)
        axes.set(xlabel="x [m]", ylabel="y [m]")
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlim(low[0], high[0], auto=True)
        axes.set_ylim(low[1], high[1], auto=True)
        figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=2)

    description = "Map of the path chosen together with its schedule, and of the one-sided answers"
    caption = "The path that goes with its schedule, in the colours of the sensors that are on, and the two one-sided answers."
    return Picture(inline_svg(styled_figure(height, paint), "joint-map", description), caption)


def _tracks(study: Study, joint: AnyJoint) -> dict[str, np.ndarray]:
    columns = list(study.problem.position)
    trajectories = {name: design.trajectory for name, (design, _, _) in joint_answers(joint).items()}
    return {name: path.x[:, columns] for name, path in trajectories.items() if path is not None}


def _draw(study: Study, joint: AnyJoint, tracks: dict[str, np.ndarray], axes: Axes) -> None:
    for name, dashes in ((PATH_FIRST, "--"), (SENSORS_FIRST, ":")):
        if name in tracks:
            axes.plot(*tracks[name].T, color=QUIET, linewidth=1.3, linestyle=dashes, label=name, zorder=2)
    track, chosen, names = tracks[TOGETHER], joint.schedule.chosen, study.scenario.sensor_names
    nodes = np.arange(len(chosen) + 1) * ((len(track) - 1) // len(chosen))
    drawn: dict[str, str] = {}
    for k, on in enumerate(chosen):
        label = " + ".join(name for name, is_on in zip(names, on, strict=True) if is_on) or "nothing on"
        is_new = label not in drawn
        colour = drawn.setdefault(label, _SENSORS[len(drawn) % len(_SENSORS)])
        part = track[nodes[k] : nodes[k + 1] + 1]
        axes.plot(*part.T, color=colour, linewidth=2.8, label=label if is_new else None, solid_capstyle="butt", zorder=3)
    axes.plot(*track[0], linestyle="none", marker="o", markersize=7, markerfacecolor="white", markeredgecolor=INK, label="start", zorder=6)
