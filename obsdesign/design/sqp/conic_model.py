"""The convex program of one step: a quadratic model under linear limits and matrix inequalities, and its minimiser."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Cone:
    """A + sum d_i D_i - t_j E + e slack I >= 0: A (n, n), D (q, n, n), E (n, n); epigraph_index: which t, None = none; slack_factor: e"""

    A: np.ndarray
    D: np.ndarray
    E: np.ndarray
    epigraph_index: int | None
    slack_factor: float


@dataclass(frozen=True, eq=False)
class ConicQP:
    """minimise d'B d / 2 + g'd - weights't + penalty e over lower <= d <= upper, e >= 0, t free.

    cones; rows + jacobian d + e >= 0 (r,), (r, q); epigraph_rows + epigraph_jacobian d - t_0 >= 0: rows that bound t_0, without slack.
    """

    B: np.ndarray
    g: np.ndarray
    weights: np.ndarray
    penalty: float
    lower: np.ndarray
    upper: np.ndarray
    cones: tuple[Cone, ...]
    rows: np.ndarray
    jacobian: np.ndarray
    epigraph_rows: np.ndarray
    epigraph_jacobian: np.ndarray


@dataclass(frozen=True, eq=False)
class ConicSolution:
    """The minimiser: d (q,), e, the multipliers of cones, rows, hard rows and of both bounds."""

    d: np.ndarray
    slack: float
    Z: tuple[np.ndarray, ...]
    row_multipliers: np.ndarray
    epigraph_multipliers: np.ndarray
    bound_multipliers: np.ndarray
