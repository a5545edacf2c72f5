"""How good any path could be: the part of the information that no path changes."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from obsdesign.criteria.min_eigenvalue import MinEigenvalue
from obsdesign.design.problem import DesignProblem
from obsdesign.dynamics.model import Model
from obsdesign.dynamics.step import blocks_of, sensitivity_of, step_of
from obsdesign.information.correlated_noise import Colour, colour_of
from obsdesign.information.whitening import outputs_with_colour
from obsdesign.round_off import EPS, smallest_eigenvalue


@dataclass(frozen=True)
class Cap:
    """An upper bound on lambda_min(S W S) of every path: the smallest eigenvalue of a block that no path changes."""

    value: float
    """The bound."""
    states: tuple[str, ...]
    """Names of the states of that block."""
    rounding: float
    """How far `value` may be below the block's smallest eigenvalue as rounding has it, relative."""


def cap_of(problem: DesignProblem) -> Cap | None:
    """Return lambda_min of the largest principal block of S W S that does not depend on the path, or None without one.

    By interlacing lambda_min(S W S) <= lambda_min(S W S[I, I]) for every index set I. W_ii = sum |C Phi e_i|^2 / sigma^2 is
    constant where every term is, and with W_ii and W_jj so is W_ij: the block is all of the constant diagonal. Constant means that
    no term depends on the state or the inputs, by the structure of the step. W is that of the noise that is stated: where errors are
    not independent, what is constant is the part of the rows that it is made of. Only for MinEigenvalue of all states without prices.
    """
    if not isinstance(problem.criterion, MinEigenvalue) or problem.about or problem.prices:
        return None
    block = np.flatnonzero(_path_independent_diagonal(problem))
    if not block.size:
        return None
    grid = problem.grid
    centre_path = problem.path_along(np.tile(grid.centre, (grid.steps, 1)))
    W = problem.matrix(centre_path)
    names = tuple(problem.system.model.state_names[i] for i in block)
    constant = W[np.ix_(block, block)]
    return Cap(smallest_eigenvalue(constant), names, rounding_of_sum(constant, problem.steps))


def rounding_of_sum(W: np.ndarray, terms: int) -> float:
    """Return how far eigenvalues of W (n, n) > 0, a sum of so many terms, may be from exact, relative; inf where W may be singular.

    Entries W_ij are right to 4 (terms + 20) eps sqrt(W_ii W_jj), a perturbation of D^-1 W D^-1, D^2 = diag W, that moves every
    eigenvalue of W by its norm over lambda_min(D^-1 W D^-1), relative. Source: Demmel and Veselic, Jacobi's method is more accurate
    than QR (1992).
    """
    sizes = np.sqrt(np.where(np.diag(W) > 0, np.diag(W), 1.0))
    least = float(np.linalg.eigvalsh(W / sizes[:, None] / sizes)[0])
    return 4 * (terms + 20) * EPS * len(W) / least if least > 0 else np.inf


def _path_independent_diagonal(problem: DesignProblem) -> np.ndarray:
    """Which diagonal entries (n,) of W no path changes."""
    model = problem.system.model
    n, step = len(model.states), step_of(model, problem.step, problem.substeps).without_disturbance()
    sensitivity = sensitivity_of(model, problem.step, problem.substeps)
    varies = np.zeros(sensitivity.free.numel(), dtype=bool)  # entries of Phi that depend on the path
    symbols = ca.vertsplit(sensitivity.free)
    while True:
        causes = ca.vertcat(step.x, step.u, *[symbol for symbol, is_varying in zip(symbols, varies, strict=True) if is_varying])
        next_varies = np.array([ca.depends_on(sensitivity.free_next[i], causes) for i in range(len(varies))], dtype=bool) | varies
        if (next_varies == varies).all():
            break
        varies = next_varies
    causes = ca.vertcat(step.x, *[symbol for symbol, is_varying in zip(symbols, varies, strict=True) if is_varying])
    blocks = blocks_of(model, sensitivity.Phi)
    correlated = () if (colour := colour_of(model)) is None else colour.sensor_indices
    white = [block for s, block in enumerate(blocks) if s not in correlated]
    is_constant = np.array([not any(block.has_nz(i, i) and ca.depends_on(block[i, i], causes) for block in white) for i in range(n)])
    return is_constant if colour is None else is_constant & _path_independent_rows(model, colour, sensitivity.Phi, causes)


def _path_independent_rows(model: Model, colour: Colour, Phi: ca.SX, causes: ca.SX) -> np.ndarray:
    """For which states (n,) no path changes what outputs say whose errors are not independent.

    W_ij is made of the rows' columns i and j, spreads and gates, of all outputs whose errors belong together: all constant, or 0.
    """
    rows, n = outputs_with_colour(model, colour, Phi), Phi.shape[1]
    is_constant = np.ones(n, dtype=bool)
    for members in map(list, colour.error_groups):
        noise = ca.vertcat(rows.level[members], rows.gate[members])
        for i in range(n):
            column = ca.sparsify(rows.rows[members, i])
            if column.nnz() and ca.depends_on(ca.vertcat(ca.densify(column), noise), causes):
                is_constant[i] = False
    return is_constant
