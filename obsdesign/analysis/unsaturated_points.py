"""Random states at which no function is saturated: exp(-8750 / T) at T = 1/2 is 1e-7600, and a proof would need as many digits."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from fractions import Fraction

import casadi as ca
import numpy as np

from obsdesign.analysis.equations import Equations
from obsdesign.analysis.evaluation_point import EvaluationPoint

MODERATE_SIZE = 8.0
"""Arguments of exp, tanh, erf and exponents of powers up to this size are moderate."""
_SWEEPS = 6  # over all coordinates at most: more only cost time where none helps
_UNDEFINED_PENALTY = 1e6  # above the sum over a thousand arguments, as log(1 + a) of a double is at most 710
# _SCALES: 1e-12 to 1e12, the mildest first: by how much coordinates are scaled; more of them cost time
_SCALES = 2.0 ** np.array(sorted(range(-40, 41), key=abs))
_ZOOMS = 4  # grids, one after the other, each an eighth as wide as the one before
# _GRID: spaced by 1 / 16 of the half width: the next grid, an eighth as wide, covers two spacings to either side of the best
_GRID = np.linspace(-1, 1, 33)

Excess = Callable[[np.ndarray], np.ndarray]  # states (n, k) -> (k,)


def desaturate(equations: Equations, point: EvaluationPoint) -> EvaluationPoint:
    """Return the place, moved coordinate by coordinate to where the arguments of steep functions are moderate, as far as possible.

    What is lessened is the sum over arguments a of log(1 + max(|a| - LARGEST, 0)), and _UNDEFINED more where something has no value.
    """
    if equations.is_rational or equations.symbols_used.steepness.size1_out(0) == 0:
        return point
    constants = [float(value) for value in equations.values]
    functions = (equations.symbols_used.steepness, equations.all_expressions)

    def excess(states: np.ndarray) -> np.ndarray:
        """Return how far functions are saturated at states (k, n)."""
        return _excess(functions, states, constants)

    state = np.array([float(value) for value in point.state])
    lowest = float(excess(state[:, None])[0])
    if lowest in (0.0, _UNDEFINED_PENALTY) or not math.isfinite(lowest):  # moderate, or outside a domain that has nothing to do with size
        return point
    for _ in range(_SWEEPS):
        previous = lowest
        for move in range(1 + 2 * len(state)):
            candidates = _candidates(state, move, excess)
            sizes = excess(candidates)
            best = int(np.argmin(sizes))
            if sizes[best] < lowest:
                state, lowest = candidates[:, best], float(sizes[best])
        if lowest in (0.0, previous):
            break
    return replace(point, state=tuple(Fraction(float(value)) for value in state))


def _excess(functions: Sequence[ca.Function], states: np.ndarray, constants: Sequence[float]) -> np.ndarray:
    """Return for every column of states (n, k) how far it is from moderate (k,)."""
    constant_columns = np.tile(np.array(constants).reshape(-1, 1), (1, states.shape[1]))
    steep, values = (np.array(function(states, constant_columns)) for function in functions)
    with np.errstate(invalid="ignore", over="ignore"):
        total = np.log1p(np.maximum(np.abs(steep) - MODERATE_SIZE, 0)).sum(axis=0)
    total = np.where(np.isnan(total), np.inf, total)
    return np.where(np.isnan(values).any(axis=0), total + _UNDEFINED_PENALTY, total)


def _candidates(state: np.ndarray, move: int, excess: Excess) -> np.ndarray:
    """Return candidates (n, k): all coordinates scaled; one by powers of 2 of either sign; or one on finer and finer grids."""
    if move == 0:
        return state[:, None] * _SCALES
    i = (move - 1) % len(state)
    if move > len(state):
        return _grid_zoom(state, i, excess)
    candidates = np.tile(state[:, None], (1, 2 * len(_SCALES)))
    candidates[i] = state[i] * np.concatenate([_SCALES, -_SCALES])
    return candidates


def _grid_zoom(state: np.ndarray, i: int, excess: Excess) -> np.ndarray:
    """Return candidates with coordinate i at the best of finer and finer grids about its value."""
    centre, width, grids = state[i], 4 * abs(state[i]) + 1, []
    for _ in range(_ZOOMS):
        candidates = np.tile(state[:, None], (1, len(_GRID)))
        candidates[i] = centre + width * _GRID
        centre, width = candidates[i, int(np.argmin(excess(candidates)))], width / 8
        grids.append(candidates)
    return np.hstack(grids)
