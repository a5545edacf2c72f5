"""Symmetric matrices as columns of the entries that are worth a computation."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np


def symmetric(name: str, n: int) -> tuple[ca.SX, ca.SX]:
    """Return a symmetric matrix (n, n) of symbols and the column (n (n + 1) / 2, 1) of its lower triangle."""
    lower = ca.SX.sym(name, ca.Sparsity.lower(n))
    return ca.tril2symm(lower), lower.nz[:]


def pack(J: ca.SX) -> ca.SX:
    """Return the lower triangle of a symmetric J (n, n) as a column, in the order of `symmetric`."""
    return ca.vertcat(*[J[i, j] for j in range(J.shape[0]) for i in range(j, J.shape[0])])


def pack_values(J: np.ndarray) -> np.ndarray:
    """Return the same entries of numbers (..., n, n)."""
    rows, columns = lower_indices(J.shape[-1])
    return np.ascontiguousarray(J[..., rows, columns])


def unpack(values: np.ndarray, n: int) -> np.ndarray:
    """Return symmetric matrices (..., n, n) of their lower triangles."""
    rows, columns = lower_indices(n)
    J = np.empty((*values.shape[:-1], n, n))
    J[..., rows, columns] = values
    J[..., columns, rows] = values
    return J


@lru_cache(64)
def lower_indices(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return rows and columns of the lower triangle, column by column."""
    columns, rows = np.triu_indices(n)
    for indices in (rows, columns):
        indices.flags.writeable = False  # they are shared
    return rows, columns


@dataclass(frozen=True, eq=False)
class Packing:
    """The entries of symmetric blocks that are not 0 for their structure: sensors, rows >= columns, each (b,), of (S, n, n)."""

    sensors: np.ndarray
    rows: np.ndarray
    columns: np.ndarray
    shape: tuple[int, int, int]

    def column(self, blocks: list[ca.SX]) -> ca.SX:
        """Return the entries (b, 1) of blocks (n, n)."""
        places = zip(self.sensors, self.rows, self.columns, strict=True)
        return ca.vertcat(*[blocks[int(s)][int(i), int(j)] for s, i, j in places]) if len(self.rows) else ca.SX(0, 1)

    def full(self, values: np.ndarray) -> np.ndarray:
        """Return blocks (..., S, n, n) of entries (..., b)."""
        blocks = np.zeros((*values.shape[:-1], *self.shape))
        blocks[..., self.sensors, self.rows, self.columns] = values
        blocks[..., self.sensors, self.columns, self.rows] = values
        return blocks


def packing_of(blocks: list[ca.SX]) -> Packing:
    """Return where the blocks have entries."""
    entry_list = [
        (s, i, j) for s, block in enumerate(blocks) for j in range(block.shape[0]) for i in range(j, block.shape[0]) if block.has_nz(i, j)
    ]
    entries = np.array(entry_list, dtype=int).reshape(-1, 3)
    return Packing(entries[:, 0], entries[:, 1], entries[:, 2], (len(blocks), *blocks[0].shape))
