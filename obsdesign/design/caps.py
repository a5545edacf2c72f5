"""How good any path could be: the part of the information that no path changes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from obsdesign.criteria.min_eigenvalue import MinEigenvalue
from obsdesign.design.problem import Cap, DesignProblem
from obsdesign.design.transcription import transcribe


def cap_of(problem: DesignProblem) -> Cap | None:
    """Return the smallest lambda_min of a principal block of S W S that does not depend on the path, or None.

    By interlacing lambda_min(S W S) <= lambda_min(S W S[I, I]) for every index set I; a block is constant where the graph of
    W has no structural dependence on the path's parameters. Only for MinEigenvalue.
    """
    if not isinstance(problem.criterion, MinEigenvalue):
        return None
    information = transcribe(problem).information
    n = len(problem.x0)
    depends = np.zeros(n * n, dtype=bool)
    depends[information.jac_sparsity(0, 0).row()] = True
    constant = ~depends.reshape(n, n)
    p = np.full((problem.path.rows(problem.steps), len(problem.lower)), (problem.lower + problem.upper) / 2)
    W = information(p).full()
    caps = [Cap(float(np.linalg.eigvalsh(W[np.ix_(block, block)])[0]), _names(problem, block)) for block in _cliques(constant)]
    return min(caps, key=lambda cap: cap.value, default=None)


def _names(problem: DesignProblem, block: list[int]) -> tuple[str, ...]:
    return tuple(problem.system.model.state_names[i] for i in block)


def _cliques(linked: np.ndarray) -> Iterator[list[int]]:
    """Yield the maximal sets of indices whose entries are all linked, diagonals included (Bron and Kerbosch)."""
    neighbours = [{j for j in range(len(linked)) if j != i and linked[i, j] and linked[j, i]} for i in range(len(linked))]

    def grow(chosen: set[int], candidates: set[int], excluded: set[int]) -> Iterator[list[int]]:
        if not candidates and not excluded and chosen:
            yield sorted(chosen)
        for i in sorted(candidates):
            yield from grow(chosen | {i}, candidates & neighbours[i], excluded & neighbours[i])
            candidates = candidates - {i}
            excluded = excluded | {i}

    yield from grow(set(), {i for i in range(len(linked)) if linked[i, i]}, set())
