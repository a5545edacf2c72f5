"""What the program of a design is at a point, and which margins are its rows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.design.nlp.rollout import Rollout
from obsdesign.design.sqp.evaluation import AbstractDerivatives, AbstractEvaluation


@dataclass(frozen=True, eq=False)
class InstantChoice:
    """Rows that must hold together at one instant only, any from `first` to `last` [s]: they are taken where they hold best."""

    rows: np.ndarray
    first: float
    last: float


@dataclass(frozen=True, eq=False)
class ConstraintRows:
    """Which margins must hold when, and by how much more than 0: node, margin, allowance (r,), and seconds after the node (r,)."""

    node: np.ndarray
    margin: np.ndarray
    allowance: np.ndarray
    delay: np.ndarray
    choices: tuple[InstantChoice, ...] = ()

    def select(self, indices: np.ndarray) -> ConstraintRows:
        """Return some of the rows, all of which hold at an instant of their own."""
        return ConstraintRows(self.node[indices], self.margin[indices], self.allowance[indices], self.delay[indices])

    def extend(self, extra: ConstraintRows) -> ConstraintRows:
        """Return these rows, followed by others that hold at an instant of their own."""
        node, margin = np.concatenate([self.node, extra.node]), np.concatenate([self.margin, extra.margin])
        allowance, delay = np.concatenate([self.allowance, extra.allowance]), np.concatenate([self.delay, extra.delay])
        return ConstraintRows(node, margin, allowance, delay, self.choices)


NO_ROWS = ConstraintRows(np.zeros(0, dtype=int), np.zeros(0, dtype=int), np.zeros(0), np.zeros(0))


@dataclass(frozen=True, eq=False)
class Evaluation(AbstractEvaluation):
    """Values with the rollouts that they were taken from, of the paths and of the floors' windows; rows hold so long after a node.

    node (r,), delay (r,) [s]: of the constraints' rows, which come first.
    """

    rollout: Rollout
    window_rollouts: Rollout | None
    node: np.ndarray
    delay: np.ndarray


@dataclass(frozen=True, eq=False)
class Derivatives(AbstractDerivatives):
    """First derivatives, and what second ones are made of: M = du/dp (N, m, q), G = dz/dp, and that of the windows."""

    M: np.ndarray
    G: np.ndarray
    window_sensitivity: np.ndarray | None
