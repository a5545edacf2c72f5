"""The hidden directions as few states at a time as can be.

A space of d directions has sparse members: those that vanish on d - 1 rows of its basis (the circuits of its matroid). Taking the
shortest first, and each that the ones before do not span, gives the basis with the fewest terms.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from obsdesign.analysis.balancing import balance_columns

ROUND_OFF = 1e-9  # relative: of the 16 digits of a double, rows as near to dependence as _DEPENDENT take 6, sums of many terms one more
_DEPENDENCE_LIMIT = 1e-6  # rows nearer to dependence than this leave a direction to less than ROUND_OFF
_MAX_SUBSETS = 4096
"""So many sets of rows are looked at: all of them where there are no more, else random ones."""


def spanning_directions(null_space: np.ndarray, given: Sequence[np.ndarray] = ()) -> list[np.ndarray]:
    """Return directions (n,) that span the space (n, d) together with those that are given, each of few terms.

    null_space: with a row of zeros for every state that is seen. Of two states with the same change, and of as many terms, those with
    first states come first.
    """
    d = null_space.shape[1]
    balanced = balance_columns(null_space) if d else null_space
    candidates = circuits_of(balanced) if d > len(given) else []
    candidates.sort(key=lambda vector: (np.count_nonzero(vector), [not value for value in vector]))
    basis: list[np.ndarray] = []
    for vector in [*candidates, *balanced.T]:
        if len(basis) + len(given) >= d:
            break
        if directions_rank([*given, *basis, vector]) > len(basis) + len(given):
            basis.append(vector)
    return basis


def directions_rank(vectors: Sequence[np.ndarray]) -> int:
    """Return how many of the directions (n,) are independent, beyond round-off."""
    rows = np.array(vectors)
    rows = rows / _row_maxima(rows.T)
    return int(np.linalg.matrix_rank(rows / np.linalg.norm(rows, axis=1, keepdims=True), tol=ROUND_OFF))


def _row_maxima(null_space: np.ndarray) -> np.ndarray:
    """Return the largest entry of each row, 1 for a row of zeros."""
    largest = np.abs(null_space).max(axis=1, initial=0.0)
    return np.where(largest > 0, largest, 1.0)


def _combine_rows(rows: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    """Return rows @ shares, of rows with largest entry 1, with what is round-off set to 0."""
    vector = rows @ coefficients
    return np.where(np.abs(vector) > ROUND_OFF * np.abs(coefficients).sum(), vector, 0.0)


def circuits_of(null_space: np.ndarray) -> list[np.ndarray]:
    """Return the directions that vanish on d - 1 independent rows, each once."""
    row_maxima = _row_maxima(null_space)
    rows = null_space / row_maxima[:, None]
    changed = np.flatnonzero(rows.any(axis=1))
    circuits: dict[tuple[int, ...], np.ndarray] = {}
    count = null_space.shape[1] - 1
    subset = np.array(list(_row_subsets(len(changed), count)), dtype=int).reshape(-1, count) if count else np.zeros((1, 0), dtype=int)
    for coefficients in _annihilators(rows[changed[subset]]):
        vector = _combine_rows(rows, coefficients)
        circuits.setdefault(tuple(int(i) for i in np.flatnonzero(vector)), vector * row_maxima)
    return list(circuits.values())


def _row_subsets(m: int, count: int) -> Iterator[tuple[int, ...]]:
    """Yield all sets of `count` of m rows, or random ones where these are too many."""
    if math.comb(m, count) <= _MAX_SUBSETS:
        yield from combinations(range(m), count)
        return
    generator = np.random.default_rng(0)
    for _ in range(_MAX_SUBSETS):
        yield tuple(generator.choice(m, count, replace=False))


def _annihilators(rows: np.ndarray) -> np.ndarray:
    """Return the directions (k, d) at right angles to d - 1 rows each (k, d - 1, d), but for rows that are all but dependent."""
    if not rows.shape[1]:
        return np.ones((len(rows), 1))
    _, sizes, directions = np.linalg.svd(rows)
    return directions[sizes[:, -1] > _DEPENDENCE_LIMIT * sizes[:, 0], -1]
