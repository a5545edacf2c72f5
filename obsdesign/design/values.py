"""What a program is at a point: values, slopes, and what its Lagrangian counts them for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.design.variation import Along


@dataclass(frozen=True, eq=False)
class Choice:
    """Rows that must hold together at one node only, any of `nodes`: they are taken where they hold best."""

    rows: np.ndarray
    nodes: np.ndarray


@dataclass(frozen=True, eq=False)
class Rows:
    """Which margins must hold at which nodes, and by how much more than 0: node, margin and allowance (r,)."""

    node: np.ndarray
    margin: np.ndarray
    allowance: np.ndarray
    choices: tuple[Choice, ...] = ()

    def placed(self, margins: np.ndarray) -> np.ndarray:
        """Return the node (r,) of every row for margins (N+1, .) at all nodes."""
        if not self.choices:
            return self.node
        node = self.node.copy()
        for choice in self.choices:
            least = margins[np.ix_(choice.nodes, self.margin[choice.rows])].min(axis=1)
            node[choice.rows] = choice.nodes[int(least.argmax())]
        return node


@dataclass(frozen=True, eq=False)
class Values:
    """At parameters p: matrices (b, n, n) to be judged, floors (f, n, n) to be kept, rows (r,) >= 0 at node, price."""

    p: np.ndarray
    along: Along
    windows: Along | None
    matrices: np.ndarray
    floors: np.ndarray
    rows: np.ndarray
    price: float
    node: np.ndarray


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
