"""A path's own chords, sagittas and axes: a Gram matrix that every relaxation must admit, made from the simulated positions alone."""

from __future__ import annotations

import numpy as np

import obsdesign as od
from obsdesign.design.path_bound.relaxation import GramRelaxation


def gram_vectors(problem: od.DesignProblem, relaxation: GramRelaxation, path: od.Trajectory) -> np.ndarray:
    """Return e_x, e_y, the chords and the sagittas (2 + 2 K, 2) of a path, in the relaxation's units.

    The middle of a piece is a sample only for an even number of steps, so the sagitta is taken from the first place inside the piece,
    whose share of it is known for the piece's own turn: 1 - (sin(d x / 2) / sin(d / 2))^2; of a piece of one step from the chord's length.
    """
    motion = relaxation.motion
    wind = problem.x0[3:5] if len(problem.x0) > 3 else np.zeros(2)
    z = path.x[:, :2] - problem.x0[:2] - (path.t - path.t[0])[:, None] * wind
    chords, sagittas, k = [], [], 0
    turn_rate = path.u[:, list(problem.system.model.input_names).index("turn_rate")]
    for steps in motion.lengths:
        arc, size = motion.arcs(steps), motion.speed * motion.step * steps
        chord = (z[k + steps] - z[k]) / size
        d = turn_rate[k] * motion.step * steps / 2
        share = (1 - np.cos(d)) / (2 * np.sin(d)) if d else 0.0  # sagitta over chord of a circle's arc
        chords.append(chord)
        sagittas.append(share * np.array([-chord[1], chord[0]]) / arc.sagitta)
        k += steps
    return np.array([[1.0, 0.0], [0.0, 1.0], *chords, *sagittas])


def shortfalls(relaxation: GramRelaxation, vectors: np.ndarray) -> np.ndarray:
    """Return by how much each constraint but those on the path's end is broken, at most 0 where it is kept."""
    set_up = relaxation.constraints
    squares = ((set_up.U.T @ vectors) ** 2).sum(axis=1)
    excess = set_up.coefficients @ squares - set_up.limits
    broken = np.where(set_up.is_two_sided, np.abs(excess) - set_up.spread, excess)
    return broken[: len(broken) - len(relaxation.motion.ends)]
