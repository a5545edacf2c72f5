"""How finely the steps of a design are integrated."""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from obsdesign.dynamics.model import AbstractSystem
from obsdesign.dynamics.simulation import substeps_needed
from obsdesign.dynamics.substeps import substeps_from
from obsdesign.errors import InputError
from obsdesign.paths.abstract import Grid


def substeps_within_bounds(system: AbstractSystem, x0: np.ndarray, grid: Grid, tolerance: float) -> int:
    """Return how many sub-steps keep the relative error of a step within `tolerance`, from x0 (n,) with inputs within the bounds.

    Enough for all inputs within the bounds where the graph tells, else for each input held at either bound and in the middle.
    """
    lower, upper = np.array(grid.lower), np.array(grid.upper)
    with suppress(InputError):
        by_structure = substeps_from(system.model, x0[None], np.vstack([lower, upper]), None, grid.step, tolerance)
        if by_structure is not None:
            return int(by_structure[0])
    one_at_a_bound = [np.where(np.arange(len(lower)) == j, bound, grid.centre) for j in range(len(lower)) for bound in (lower[j], upper[j])]
    counts = [1]
    for u in (grid.centre, *one_at_a_bound, lower, upper):
        with suppress(InputError):  # a motion that runs away, or is not wanted: the path that is found is judged by itself
            counts += substeps_needed(system, x0[None], np.tile(u, (grid.steps, 1)), grid.step, None, tolerance).tolist()
    return max(counts)
