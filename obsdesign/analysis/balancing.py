"""Bases of hidden directions with columns that are comparable, whatever the sizes of the states."""

from __future__ import annotations

import numpy as np

_SWEEPS = 30  # a basis without zeros is balanced after one, with zeros each sweep brings the sizes nearer; an approximate scale does


def balance_columns(basis: np.ndarray) -> np.ndarray:
    """Return the basis (n, d) with its columns scaled so that log |N_ij| = a_i + b_j as nearly as can be, and b_j = 0.

    States of size 1e12 and 1e-12 make directions such as (1, 1e-24): relative to what is usual in its row no entry is small then.
    Least squares over the entries that are not 0, by turns.
    """
    nonzero = basis != 0
    sizes = np.log(np.where(nonzero, np.abs(basis), 1.0))
    widths = np.zeros(basis.shape[1])
    for _ in range(_SWEEPS if basis.size else 0):
        heights = _mean(sizes - widths, nonzero, axis=1)
        widths = _mean(sizes - heights[:, None], nonzero, axis=0)
    return basis * np.exp(-widths)


def _mean(values: np.ndarray, chosen: np.ndarray, axis: int) -> np.ndarray:
    return np.where(chosen, values, 0.0).sum(axis=axis) / np.maximum(chosen.sum(axis=axis), 1)
