"""What a program is at a point: values, slopes, and what its Lagrangian counts them for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.design.nlp.rollout import Along


@dataclass(frozen=True, eq=False)
class Choice:
    """Rows that must hold together at one instant only, any from `first` to `last` [s]: they are taken where they hold best."""

    rows: np.ndarray
    first: float
    last: float


@dataclass(frozen=True, eq=False)
class Rows:
    """Which margins must hold when, and by how much more than 0: node, margin, allowance (r,), and seconds after the node (r,)."""

    node: np.ndarray
    margin: np.ndarray
    allowance: np.ndarray
    after: np.ndarray
    choices: tuple[Choice, ...] = ()

    def of(self, chosen: np.ndarray) -> Rows:
        """Return some of the rows, all of which hold at an instant of their own."""
        return Rows(self.node[chosen], self.margin[chosen], self.allowance[chosen], self.after[chosen])

    def with_more(self, more: Rows) -> Rows:
        """Return these rows, followed by others that hold at an instant of their own."""
        node, margin = np.concatenate([self.node, more.node]), np.concatenate([self.margin, more.margin])
        allowance, after = np.concatenate([self.allowance, more.allowance]), np.concatenate([self.after, more.after])
        return Rows(node, margin, allowance, after, self.choices)


NO_ROWS = Rows(np.zeros(0, dtype=int), np.zeros(0, dtype=int), np.zeros(0), np.zeros(0))


@dataclass(frozen=True, eq=False)
class Values:
    """At parameters p: matrices (b, n, n) to be judged, floors (f, n, n) to be kept, rows (r,) >= 0 so long after node, price."""

    p: np.ndarray
    along: Along
    windows: Along | None
    matrices: np.ndarray
    floors: np.ndarray
    rows: np.ndarray
    price: float
    node: np.ndarray
    after: np.ndarray


@dataclass(frozen=True, eq=False)
class Slopes:
    """First derivatives: matrices (b, q, n, n), floors (f, q, n, n), rows (r, q), price (q,), and what second ones are made of."""

    matrices: np.ndarray
    floors: np.ndarray
    rows: np.ndarray
    price: np.ndarray
    M: np.ndarray
    G: np.ndarray
    windows: np.ndarray | None


@dataclass(frozen=True, eq=False)
class Multipliers:
    """What the Lagrangian counts the matrices (b, n, n), the floors (f, n, n), the rows (r,) and the price for, all >= 0."""

    matrices: np.ndarray
    floors: np.ndarray
    rows: np.ndarray
    price: float

    def times(self, factor: float) -> Multipliers:
        """Return all of them multiplied."""
        return Multipliers(self.matrices * factor, self.floors * factor, self.rows * factor, self.price * factor)

    def with_rows(self, before: int, after: int) -> Multipliers:
        """Return multipliers for more rows of constraints than before: nothing for those that are new."""
        more = np.concatenate([self.rows[:before], np.zeros(after - before), self.rows[before:]])
        return Multipliers(self.matrices, self.floors, more, self.price)
