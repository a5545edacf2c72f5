"""One step of a system as a graph: state, sensitivity, and what a sample of each sensor says. All that walks along a path is made of it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from obsdesign.calculus import rk4
from obsdesign.checks import whole_multiple
from obsdesign.common_subexpressions import without_repeats
from obsdesign.dynamics.model import Model
from obsdesign.dynamics.scan import ExpandedColumn
from obsdesign.errors import InputError
from obsdesign.packing import packing_of

CACHE_SIZE = 64  # functions kept of each kind


@dataclass(frozen=True, eq=False)
class Step:
    """One step with inputs held: x_next (n, 1), F = dx_next/dx (n, n), B_w = dx_next/dw (n, p), sparse, of x, u and w."""

    x: ca.SX
    u: ca.SX
    w: ca.SX
    x_next: ca.SX
    F: ca.SX
    B_w: ca.SX

    @property
    def all_inputs(self) -> ca.SX:
        """(u, w) (m + p, 1), the row of whoever walks along a path; u alone costs no more where nothing is unknown."""
        return ca.vertcat(self.u, self.w)

    def without_disturbance(self) -> Step:
        """Return the step at w = 0, with its derivative to w there: of whoever does not know w, a filter or a design."""
        if not self.w.numel():
            return self
        zero = ca.SX.zeros(self.w.numel())
        x_next, F, B_w = (ca.substitute(value, self.w, zero) for value in (self.x_next, self.F, self.B_w))
        return Step(self.x, self.u, self.w, x_next, F, B_w)


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """Phi = dx(t_k)/dx(t_0) (n, n) with its structure: `free` (c, 1) are the entries that no step leaves at 0 or 1.

    free_next (c, 1): the same entries one step later; index (c,): where they stand in Phi, counted by rows.
    """

    Phi: ca.SX
    free: ca.SX
    free_next: ca.SX
    index: np.ndarray

    @cached_property
    def start(self) -> np.ndarray:
        """The free entries (c,) of the identity."""
        return self._identity[self.index]

    def full(self, values: np.ndarray) -> np.ndarray:
        """Return Phi (..., n, n) for values (..., c) of the free entries."""
        n = self.Phi.shape[0]
        matrix = np.empty((*values.shape[:-1], n * n))
        matrix[...] = self._identity
        matrix[..., self.index] = values
        return matrix.reshape(*values.shape[:-1], n, n)

    @cached_property
    def _identity(self) -> np.ndarray:
        return np.eye(self.Phi.shape[0]).ravel()


@lru_cache(CACHE_SIZE)
def step_of(model: Model, step: float, substeps: int = 1) -> Step:
    """Return one step of `step` seconds: `substeps` equal ones of RK4, or the exact one for more than one where rates are linear.

    How many it takes for a tolerance is what `accuracy` finds out.
    """
    exact = exact_step(model, step) if substeps > 1 else None
    return chain_steps(model, (step / substeps,) * substeps) if exact is None else exact


@lru_cache(CACHE_SIZE)
def chain_steps(model: Model, lengths: tuple[float, ...]) -> Step:
    """Return RK4 steps of so many seconds one after the other: F = F_m ... F_1, and B_w likewise."""
    u, w = model.u, model.w
    if len(lengths) == 1:
        return runge_kutta(model, lengths[0])
    x, F, B_w = model.x, ca.SX.eye(model.x.numel()), ca.SX(model.x.numel(), w.numel())
    graphs = {length: _as_function(chain_steps(model, (length,))) for length in dict.fromkeys(lengths)}
    for length in lengths:
        x, F_part, B_part = graphs[length](x, u, w)
        F, B_w = F_part @ F, F_part @ B_w + B_part
    return Step(model.x, u, w, ca.densify(x), F, B_w)


def runge_kutta(model: Model, length: float | ca.SX) -> Step:
    """Return one step of RK4, of a length [s] that may be a symbol."""
    u, w = model.u, model.w
    rate = ca.Function("rate", [model.x, u, w], [_rate(model)])
    (x_next,) = without_repeats([ca.densify(rk4(lambda x: ca.SX(rate(x, u, w)), model.x, length))])
    return Step(model.x, u, w, x_next, ca.jacobian(x_next, model.x), ca.jacobian(x_next, w))


def _as_function(step_graph: Step) -> ca.Function:
    return ca.Function("one", [step_graph.x, step_graph.u, step_graph.w], [step_graph.x_next, step_graph.F, step_graph.B_w])


def _rate(model: Model) -> ca.SX:
    return model.drift + model.B @ model.u + model.G @ model.w


@lru_cache(CACHE_SIZE)
def exact_step(model: Model, step: float) -> Step | None:
    """Return the exact step of xdot = A x + B u + G w + b with constant A, B, G, b, None for rates of another form.

    [x+; 1] = exp([A B G b; 0 0 0 0] step) [x; u; w; 1], of any stiffness: F = exp(A step). Entries that no power of the matrix
    reaches stay without a structure. Source: Van Loan (1978), IEEE Trans. Automat. Control 23, 395-404.
    """
    variables = ca.vertcat(model.x, model.u, model.w)
    slope = ca.jacobian(_rate(model), variables)
    if ca.depends_on(slope, variables):
        return None
    from scipy.linalg import expm  # half a second to load, and few systems need it

    n, size = model.x.numel(), variables.numel()
    constant = ca.substitute(_rate(model), variables, ca.SX.zeros(size))
    M = np.zeros((size + 1, size + 1))
    M[:n] = ca.DM(ca.horzcat(slope, constant)).full()
    if not np.isfinite(M).all():
        return None
    E = np.where(_nonzero_structure(M), expm(M * step), 0.0)[:n]
    is_constant = ~M[:n].any(axis=1)  # rates that are 0: these stay, to the last digit
    E[is_constant] = np.eye(n, size + 1)[is_constant]
    solution = ca.SX(ca.sparsify(ca.DM(E)))
    x_next = ca.densify(solution @ ca.vertcat(variables, 1))
    return Step(model.x, model.u, model.w, x_next, solution[:, :n], solution[:, size - model.w.numel() : size])


def _nonzero_structure(M: np.ndarray) -> np.ndarray:
    """Return which entries of exp(M) are not 0 by the structure of M: those of (1 + M)^n."""
    is_nonzero = (M != 0) | np.eye(len(M), dtype=bool)
    for _ in range(len(M).bit_length()):
        is_nonzero = is_nonzero @ is_nonzero
    return is_nonzero


@lru_cache(CACHE_SIZE)
def sensitivity_of(model: Model, step: float, substeps: int = 1) -> Sensitivity:
    """Return Phi at w = 0: what each step of `step` seconds makes of it."""
    return sensitivity_from(step_of(model, step, substeps).without_disturbance().F)


@lru_cache(CACHE_SIZE)
def sensitivity_along(model: Model, step: float, substeps: int = 1) -> Sensitivity:
    """Return Phi along a path that unknown inputs move: `next` is of x, u and w."""
    return sensitivity_from(step_of(model, step, substeps).F) if model.unknown_inputs else sensitivity_of(model, step, substeps)


def sensitivity_from(F: ca.SX) -> Sensitivity:
    """Begin with all entries of the identity as constants and free those that F Phi does not leave as they are, until all do."""
    n = F.shape[0]
    is_identity = np.ones((n, n), dtype=bool)
    while True:
        free = ca.SX.sym("Phi", int((~is_identity).sum()))
        index = np.flatnonzero(~is_identity)
        Phi = ca.SX(ca.sparsify(ca.DM(np.eye(n) * is_identity)))
        for symbol, (i, j) in zip(ca.vertsplit(free), np.argwhere(~is_identity), strict=True):
            Phi[i, j] = symbol
        Phi_next = F @ Phi
        is_changed = np.array([[is_identity[i, j] and not _is_number(Phi_next[i, j], float(i == j)) for j in range(n)] for i in range(n)])
        if not is_changed.any():
            return Sensitivity(Phi, free, _entries(Phi_next, index), index)
        is_identity &= ~is_changed


def _is_number(expression: ca.SX, value: float) -> bool:
    return expression.is_constant() and float(expression) == value


def _entries(matrix: ca.SX, index: np.ndarray) -> ca.SX:
    n = matrix.shape[1]
    return ca.vertcat(*[matrix[int(i) // n, int(i) % n] for i in index])


def blocks_of(model: Model, Phi: ca.SX, weighted: bool = True) -> list[ca.SX]:
    """Return g Phi' C_s' R_s^-1 C_s Phi (n, n) for each sensor s, sparse, g its gate, R_s the variance of one sample alone.

    g = R = 1 if not weighted. What several samples say together whose errors are not independent: `information.instant`.
    """
    blocks = []
    for channel in model.channels:
        output_rows = ca.jacobian(channel.h, model.x) @ Phi
        # not the root of the weight on both sides: that has no derivative where a gate is closed
        weight = channel.noise.gate / channel.noise.variance if weighted else ca.SX(1)
        # one number for all outputs but in joint noise
        blocks.append(output_rows.T @ (weight * output_rows if weight.numel() == 1 else ca.diag(weight) @ output_rows))
    return blocks


def dense_blocks(blocks: list[ca.SX]) -> ExpandedColumn:
    """Return symmetric blocks for an array (S, n, n), each entry of a lower triangle computed once and zeros not at all."""
    packing = packing_of(blocks)
    position = packing.full(np.arange(1.0, len(packing.rows) + 1)) - 1  # -1 where there is nothing
    index = np.where(position < 0, len(packing.rows), position).astype(int)
    return ExpandedColumn(ca.vertcat(packing.column(blocks), 0), index.ravel())


@lru_cache(CACHE_SIZE)
def steps_per_sample(model: Model, step: float) -> tuple[int, ...]:
    """Return for each sensor the number of steps between samples; raise InputError where that is not whole."""
    counts = []
    for channel in model.channels:
        count = 1 if channel.rate is None else whole_multiple(1 / channel.rate, step)
        if count is None:
            raise InputError(
                f"{channel.name}: rate {channel.rate} Hz is a period of {1 / (channel.rate or 1):g} s,"
                f" which is no whole multiple of the step {step:g} s"
            )
        counts.append(count)
    return tuple(counts)
