"""Improving a schedule by swapping sensors, singly and in pairs."""

from __future__ import annotations

import numpy as np

from obsdesign.selection.schedule import information_of, worth

_PAIRED = 96  # moves that are also tried two at a time: the ones that cost least in the direction of the dual


def improved(blocks: np.ndarray, chosen: np.ndarray, Z: np.ndarray) -> np.ndarray:
    """Return a schedule (K, S) that no single swap, and no pair of the cheapest swaps, makes better.

    A swap turns one sensor off and another on in one segment. Pairs are taken among the swaps whose loss <W, Z> is least.
    """
    chosen = chosen.copy()
    while True:
        moves = _moves(chosen)
        change = blocks[moves[:, 0], moves[:, 2]] - blocks[moves[:, 0], moves[:, 1]]
        best = _best_single(blocks, chosen, change)
        if best is None:
            best = _best_pair(blocks, chosen, change, moves, Z)
        if best is None:
            return chosen
        for k, off, on in moves[list(best)]:
            chosen[k, off], chosen[k, on] = False, True


def _moves(chosen: np.ndarray) -> np.ndarray:
    """All swaps (segment, sensor off, sensor on)."""
    K, S = chosen.shape
    k, off, on = np.meshgrid(np.arange(K), np.arange(S), np.arange(S), indexing="ij")
    allowed = chosen[k, off] & ~chosen[k, on]
    return np.stack([k[allowed], off[allowed], on[allowed]], axis=1)


def _best_single(blocks: np.ndarray, chosen: np.ndarray, change: np.ndarray) -> tuple[int, ...] | None:
    W = information_of(blocks, chosen)
    if not len(change):
        return None
    values = np.linalg.eigvalsh(W + change)[:, 0]
    return (int(values.argmax()),) if values.max() > _bar(W) else None


def _best_pair(blocks: np.ndarray, chosen: np.ndarray, change: np.ndarray, moves: np.ndarray, Z: np.ndarray) -> tuple[int, ...] | None:
    W = information_of(blocks, chosen)
    gains = worth(blocks, Z)
    loss = gains[moves[:, 0], moves[:, 1]] - gains[moves[:, 0], moves[:, 2]]
    near = np.argsort(loss, kind="stable")[:_PAIRED]
    first, second = (near[side] for side in np.triu_indices(len(near), k=1))
    apart = moves[first, 0] != moves[second, 0]
    first, second = first[apart], second[apart]
    if not len(first):
        return None
    values = np.linalg.eigvalsh(W + change[first] + change[second])[:, 0]
    best = int(values.argmax())
    return (int(first[best]), int(second[best])) if values[best] > _bar(W) else None


def _bar(W: np.ndarray) -> float:
    """What counts as better than W: more than a rounding error, so that exchanges end."""
    value = float(np.linalg.eigvalsh(W)[0])
    return value + 1e-12 * float(np.abs(W).max())
