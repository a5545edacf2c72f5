"""How good any path could be: the part of the information that no path changes."""

from __future__ import annotations

import numpy as np

from obsdesign.criteria.min_eigenvalue import MinEigenvalue
from obsdesign.design.problem import Cap, DesignProblem
from obsdesign.design.transcription import transcribe


def cap_of(problem: DesignProblem) -> Cap | None:
    """Return lambda_min of the largest principal block of S W S that does not depend on the path, or None without one.

    By interlacing lambda_min(S W S) <= lambda_min(S W S[I, I]) for every index set I. W_ii = sum |C Phi e_i|^2 / sigma^2 is
    constant where every term is, and with W_ii and W_jj so is W_ij: the block is all of the constant diagonal. Constant means
    that the graph of W has no structural dependence on the path's parameters. Only for MinEigenvalue.
    """
    if not isinstance(problem.criterion, MinEigenvalue):
        return None
    information = transcribe(problem).information
    n = len(problem.x0)
    depends = np.zeros(n * n, dtype=bool)
    depends[information.jac_sparsity(0, 0).row()] = True
    constant = ~depends.reshape(n, n)
    block = np.flatnonzero(np.diag(constant))
    if not (block.size and constant[np.ix_(block, block)].all()):
        return None
    p = np.tile((problem.lower + problem.upper) / 2, (problem.path.rows(problem.steps), 1))
    W = information(p).full()
    names = tuple(problem.system.model.state_names[i] for i in block)
    return Cap(float(np.linalg.eigvalsh(W[np.ix_(block, block)])[0]), names)
