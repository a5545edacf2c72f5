"""A sensor schedule with its certificate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.checks import require_count
from obsdesign.errors import InputError
from obsdesign.status import Status


@dataclass(frozen=True, eq=False)
class Schedule:
    """Which sensors are on in which segment: chosen (K, S) bool, and how good that is.

    value = lambda_min(sum of the chosen blocks); bound >= value of every schedule; root_bound = UB(dual) >= bound;
    gap = 1 - value / bound; dual Z (n, n) >= 0 with trace 1; fractional: segments the relaxation leaves undecided.
    All are recomputed with NumPy; NaN where the solver gave no answer.
    """

    chosen: np.ndarray
    value: float
    bound: float
    root_bound: float
    gap: float
    dual: np.ndarray
    fractional: int
    status: Status


def information_of(blocks: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """W (n, n) = sum of the blocks (K, S, n, n) that a schedule (K, S) has on."""
    return np.einsum("ks,ksij->ij", np.asarray(chosen, dtype=float), blocks)


def schedule_value(blocks: np.ndarray, chosen: np.ndarray) -> float:
    """lambda_min of a schedule's information."""
    return float(np.linalg.eigvalsh(information_of(blocks, chosen))[0])


def worth(blocks: np.ndarray, Z: np.ndarray) -> np.ndarray:
    """<W_ks, Z> (K, S): what each block adds in the direction of the dual Z."""
    return np.einsum("ksij,ij->ks", blocks, Z)


def upper_bound(blocks: np.ndarray, Z: np.ndarray, per_segment: int = 1) -> float:
    """UB(Z) = sum_k (sum of the per_segment largest max(<W_ks, Z>, 0)) >= lambda_min of every schedule, for Z >= 0, tr Z = 1."""
    largest = np.sort(np.maximum(worth(blocks, Z), 0.0), axis=1)[:, -per_segment:]
    return float(largest.sum())


def best_for(blocks: np.ndarray, Z: np.ndarray, per_segment: int = 1) -> np.ndarray:
    """Return the schedule (K, S) that is best in the direction of Z."""
    return largest_per_row(worth(blocks, Z), per_segment)


def largest_per_row(score: np.ndarray, count: int) -> np.ndarray:
    """Return (K, S) bool with the `count` largest scores of each row; the first of equals."""
    order = np.argsort(-score, axis=1, kind="stable")[:, :count]
    chosen = np.zeros(score.shape, dtype=bool)
    np.put_along_axis(chosen, order, True, axis=1)
    return chosen


def require_blocks(blocks: np.ndarray, per_segment: int) -> np.ndarray:
    """Return blocks as a symmetric float array (K, S, n, n) or raise InputError saying which block is wrong and by how much."""
    array = np.array(blocks, dtype=float)
    if array.ndim != 4 or array.shape[2] != array.shape[3] or 0 in array.shape:
        raise InputError(f"blocks has shape {array.shape}: must be (K, S, n, n)")
    require_count("per_segment", per_segment, least=1, most=array.shape[1])
    if not np.isfinite(array).all():
        k, s = np.argwhere(~np.isfinite(array))[0][:2]
        raise InputError(f"blocks[{k}, {s}] is not finite")
    size = np.abs(array).max(axis=(2, 3))
    skew = np.abs(array - array.swapaxes(2, 3)).max(axis=(2, 3))
    lowest = np.linalg.eigvalsh((array + array.swapaxes(2, 3)) / 2)[..., 0]
    for what, excess in (("symmetric: it differs from its transpose by", skew), ("positive semidefinite: its eigenvalue is", -lowest)):
        wrong = excess > 1e-9 * np.maximum(size, np.finfo(float).tiny)
        if wrong.any():
            k, s = np.argwhere(wrong)[0]
            sign = -1 if "eigenvalue" in what else 1
            raise InputError(f"blocks[{k}, {s}] is not {what} {sign * excess[k, s]:.3g} (largest entry {size[k, s]:.3g})")
    return (array + array.swapaxes(2, 3)) / 2
