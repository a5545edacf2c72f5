"""What a program is at a point: values, slopes, and what its Lagrangian counts them for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.design.nlp.rollout import Rollout


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
class Evaluation:
    """At parameters p: matrices (b, n, n) to be judged, floors (f, n, n) to be kept, rows (r,) >= 0 so long after node, price."""

    p: np.ndarray
    rollout: Rollout
    window_rollouts: Rollout | None
    matrices: np.ndarray
    floors: np.ndarray
    rows: np.ndarray
    price: float
    node: np.ndarray
    delay: np.ndarray


@dataclass(frozen=True, eq=False)
class Derivatives:
    """First derivatives: matrices (b, q, n, n), floors (f, q, n, n), rows (r, q), price (q,), and what second ones are made of."""

    matrices: np.ndarray
    floors: np.ndarray
    rows: np.ndarray
    price: np.ndarray
    M: np.ndarray
    G: np.ndarray
    window_sensitivity: np.ndarray | None


@dataclass(frozen=True, eq=False)
class Multipliers:
    """What the Lagrangian counts the matrices (b, n, n), the floors (f, n, n), the rows (r,) and the price for, all >= 0."""

    matrices: np.ndarray
    floors: np.ndarray
    rows: np.ndarray
    price: float

    def scale(self, factor: float) -> Multipliers:
        """Return all of them multiplied."""
        return Multipliers(self.matrices * factor, self.floors * factor, self.rows * factor, self.price * factor)

    def with_rows(self, old_count: int, new_count: int) -> Multipliers:
        """Return multipliers for more rows of constraints than before: nothing for those that are new."""
        extended = np.concatenate([self.rows[:old_count], np.zeros(new_count - old_count), self.rows[old_count:]])
        return Multipliers(self.matrices, self.floors, extended, self.price)
