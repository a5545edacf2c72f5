"""What costs come to along a path, integrated within its steps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from obsdesign.costs.abstract import AbstractCost
from obsdesign.design.nlp.node_functions import node_functions_of
from obsdesign.dynamics.model import AbstractSystem
from obsdesign.dynamics.simulation import states_from, substeps_along
from obsdesign.trajectory import Trajectory

REFINEMENT = 10  # steps of a check for one step of the path


def total_costs(system: AbstractSystem, path: Trajectory, costs: Sequence[AbstractCost]) -> np.ndarray:
    """Return what costs (c,) come to along a path, each in its unit, integrated within tenths of its steps."""
    if not costs:
        return np.zeros(0)
    step, x, u = refine_path(system, path, REFINEMENT)
    return node_functions_of(system.model, (), tuple(costs), (step, 1)).values(x[:-1], u).sum(axis=0) * step


def refine_path(system: AbstractSystem, path: Trajectory, refinement: int) -> tuple[float, np.ndarray, np.ndarray]:
    """Return shorter steps [s] along a path, so many for each of its own: states (finer N + 1, n), inputs (finer N, m).

    They are made of ten times as many sub-steps as the path itself, or more: exact to a ten thousandth of what it is. The state of a map
    from one instant to the next stays between these.
    """
    if system.model.period is not None:
        x = np.vstack([np.repeat(path.x[:-1], refinement, axis=0), path.x[-1:]])
        return path.step / refinement, x, np.repeat(path.u, refinement, axis=0)
    substeps = -(-REFINEMENT * substeps_along(system, path) // refinement)
    u = np.repeat(path.u, refinement, axis=0)
    return path.step / refinement, states_from(system, path.x[:1], u, path.step / refinement, substeps=substeps)[0], u
