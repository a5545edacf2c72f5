"""One step of a system as a graph: state, sensitivity, and what a sample of each sensor says. All that walks along a path is made of it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from obsdesign.calculus import rk4
from obsdesign.checks import whole_multiple
from obsdesign.common_subexpressions import without_repeats
from obsdesign.dynamics.inner_loop import InnerLoop
from obsdesign.dynamics.model import Model
from obsdesign.dynamics.scan import ExpandedColumn
from obsdesign.errors import InputError
from obsdesign.packing import packing_of

CACHE_SIZE = 64  # functions kept of each kind


@dataclass(frozen=True, eq=False)
class Step:
    """One step with inputs held: x_next (n, 1), F = dx_next/dx (n, n), B_w = dx_next/dw (n, p), sparse, of x, u and w.

    loop: None, or a loop of sub-steps. Then these are symbols of its end, which have no derivatives, and a `Scan` takes the loop along.
    """

    x: ca.SX
    u: ca.SX
    w: ca.SX
    x_next: ca.SX
    F: ca.SX
    B_w: ca.SX
    loop: InnerLoop | None = None

    @cached_property
    def sensitivity(self) -> Sensitivity:
        """Phi, and what this step makes of it."""
        return sensitivity_from(self.F)

    @property
    def all_inputs(self) -> ca.SX:
        """(u, w) (m + p, 1), the row of whoever walks along a path; u alone costs no more where nothing is unknown."""
        return ca.vertcat(self.u, self.w)

    def without_disturbance(self) -> Step:
        """Return the step at w = 0, with its derivative to w there: of whoever does not know w, a filter or a design."""
        return self._substitute(self.w, ca.SX.zeros(self.w.numel())) if self.w.numel() else self

    def split_disturbance(self, p: int) -> tuple[Step, ca.SX]:
        """Return the step with its first p unknown inputs alone, the others being 0, and dx_next/dw of those others (n, .)."""
        if p == self.w.numel():
            return self, ca.SX(self.x.numel(), 0)
        w = ca.SX.sym("w", p)
        graph = self._substitute(self.w, ca.vertcat(w, ca.SX.zeros(self.w.numel() - p)))
        return Step(self.x, self.u, w, graph.x_next, graph.F, graph.B_w[:, :p], graph.loop), graph.B_w[:, p:]

    def starting_at(self, x: ca.SX) -> Step:
        """Return the step from a state (n, 1) that is an expression."""
        return self._substitute(self.x, x)

    def _substitute(self, old: ca.SX, new: ca.SX) -> Step:
        x_next, F, B_w = (ca.substitute(value, old, new) for value in (self.x_next, self.F, self.B_w))
        return Step(self.x, self.u, self.w, x_next, F, B_w, None if self.loop is None else self.loop.substitute(old, new))


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

    A model that is a map from one instant to the next is that. How many it takes for a tolerance is what `accuracy` finds out.
    """
    if model.period is not None:
        return map_step(model, step)
    exact = exact_step(model, step) if substeps > 1 else None
    return chain_steps(model, (step / substeps,) * substeps) if exact is None else exact


@lru_cache(CACHE_SIZE)
def map_step(model: Model, step: float) -> Step:
    """Return x(t + step) of a model that is a map over its period, with inputs held; raise InputError for a step that is no multiple."""
    count = model.periods_in(step)
    (x_next,) = without_repeats([ca.densify(model.motion.at(model.u, model.w))])
    one = Step(model.x, model.u, model.w, x_next, ca.jacobian(x_next, model.x), ca.jacobian(x_next, model.w))
    return one if count == 1 else _chain(one, [_as_function(one)] * count)


@lru_cache(CACHE_SIZE)
def chain_steps(model: Model, lengths: tuple[float, ...]) -> Step:
    """Return RK4 steps of so many seconds one after the other: F = F_m ... F_1, and B_w likewise."""
    if len(lengths) == 1:
        return runge_kutta(model, lengths[0])
    graphs = {length: _as_function(chain_steps(model, (length,))) for length in dict.fromkeys(lengths)}
    return _chain(chain_steps(model, lengths[:1]), [graphs[length] for length in lengths])


def _chain(first: Step, graphs: list[ca.Function]) -> Step:
    """Steps one after the other, of the symbols of the first."""
    x, F, B_w = first.x, ca.SX.eye(first.x.numel()), ca.SX(first.x.numel(), first.w.numel())
    for graph in graphs:
        x, F_part, B_part = graph(x, first.u, first.w)
        F, B_w = F_part @ F, F_part @ B_w + B_part
    return Step(first.x, first.u, first.w, ca.densify(x), F, B_w)


@lru_cache(CACHE_SIZE)
def looped_step(model: Model, step: float, substeps: int = 1) -> Step:
    """Return the step of `step_of`, more than one sub-step of RK4 as a loop: m of them cost m times one, but have no derivatives.

    z = (x, u, w, Phi, B): Phi+ = F Phi from the identity and B+ = F B + B_w from 0, F and B_w of one sub-step.
    """
    if substeps == 1 or model.period is not None or exact_step(model, step) is not None:
        return step_of(model, step, substeps)
    one = chain_steps(model, (step / substeps,))
    Phi, B = one.sensitivity, ca.SX.sym("B", _reached_by_inputs(one))
    B_next = ca.project(one.F @ B + one.B_w, B.sparsity())
    parts = [one.x, one.u, one.w, Phi.free, _nonzeros(B)]
    start = ca.vertcat(one.x, one.u, one.w, ca.DM(Phi.start), ca.SX.zeros(B.nnz()))
    end = [ca.SX.sym("end", part.numel()) for part in parts]
    z_next = ca.vertcat(one.x_next, one.u, one.w, Phi.free_next, _nonzeros(B_next))
    loop = InnerLoop(substeps, ca.vertcat(*parts), z_next, start, ca.vertcat(*end))
    F = ca.substitute(Phi.Phi, Phi.free, end[3])
    return Step(one.x, one.u, one.w, end[0], F, ca.SX(B.sparsity(), end[4]), loop)


def _nonzeros(matrix: ca.SX) -> ca.SX:
    return ca.densify(ca.vec(matrix.nz[:])) if matrix.nnz() else ca.SX(0, 1)


def _reached_by_inputs(step_graph: Step) -> ca.Sparsity:
    """Return where dx/dw of steps one after the other is not 0: at most n of them reach all that is ever reached."""
    reached = step_graph.B_w.sparsity()
    for _ in range(step_graph.x.numel()):
        reached = reached + (step_graph.F @ ca.SX(reached, 1)).sparsity()
    return reached


def runge_kutta(model: Model, length: float | ca.SX) -> Step:
    """Return one step of RK4, of a length [s] that may be a symbol."""
    u, w = model.u, model.w
    rate = ca.Function("rate", [model.x, u, w], [model.rate])
    (x_next,) = without_repeats([ca.densify(rk4(lambda x: ca.SX(rate(x, u, w)), model.x, length))])
    return Step(model.x, u, w, x_next, ca.jacobian(x_next, model.x), ca.jacobian(x_next, w))


def _as_function(step_graph: Step) -> ca.Function:
    return ca.Function("one", [step_graph.x, step_graph.u, step_graph.w], [step_graph.x_next, step_graph.F, step_graph.B_w])


@lru_cache(CACHE_SIZE)
def exact_step(model: Model, step: float) -> Step | None:
    """Return the exact step of xdot = A x + B u + G w + b with constant A, B, G, b, None for rates of another form.

    [x+; 1] = exp([A B G b; 0 0 0 0] step) [x; u; w; 1], of any stiffness: F = exp(A step). Entries that no power of the matrix
    reaches stay without a structure. Source: Van Loan (1978), IEEE Trans. Automat. Control 23, 395-404.
    """
    variables = ca.vertcat(model.x, model.u, model.w)
    slope = ca.jacobian(model.rate, variables)
    if ca.depends_on(slope, variables):
        return None
    from scipy.linalg import expm  # half a second to load, and few systems need it

    n, size = model.x.numel(), variables.numel()
    constant = ca.substitute(model.rate, variables, ca.SX.zeros(size))
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
