"""What a design carries along a path beside the state, so that the matrix it is judged by is a sum over steps."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from obsdesign.criteria.abstract import Knowledge
from obsdesign.information.posterior import noise_factor
from obsdesign.model import Model
from obsdesign.packing import packed, symmetric
from obsdesign.step import CACHED, blocks_of, sensitivity_of, step_of

_UNSEEN = 1e-12  # share of an unknown input's size below which it has not been seen


@dataclass(frozen=True, eq=False)
class Recursion:
    """z_0 = (x_0, start), z_k+1 = z_next(z_k, u_k), judged matrix = sum of gain(z_k), packed; due: weights of the step's parts.

    z (c, 1), its first n entries the state; u (m, 1); due (s, 1): for a Gramian 1 for each sensor with a sample at that step, for
    a posterior the same followed by 1 at the last step, where its matrix is read.
    """

    z: ca.SX
    u: ca.SX
    due: ca.SX
    z_next: ca.SX
    gain: ca.SX
    start: np.ndarray


@lru_cache(CACHED)
def gramian_recursion(model: Model, step: float) -> Recursion:
    """Carry Phi; gain = sum over sensors of due_s Phi' C_s' R_s^-1 C_s Phi."""
    one, shape = step_of(model, step).without_disturbance(), sensitivity_of(model, step)
    due = ca.SX.sym("due", len(model.channels))
    blocks = blocks_of(model, shape.Phi)
    gain = sum((due[s] * block for s, block in enumerate(blocks)), ca.SX(*shape.Phi.shape))
    z = ca.vertcat(one.x, shape.free)
    return Recursion(z, one.u, due, ca.vertcat(one.x_next, shape.next), packed(ca.densify(gain)), shape.start)


@lru_cache(CACHED)
def posterior_recursion(model: Model, step: float, known: Knowledge) -> Recursion:
    """Carry J, packed, before the samples of t_k: J+ = M - M B (B'M B + Q^-1)^-1 B'M with M = F^-T (J + C'R^-1 C) F^-1.

    The last gain is J + C'R^-1 C of t_N-1. In plain arithmetic, smooth, for the solver; values are recomputed with square roots.
    """
    one, n = step_of(model, step).without_disturbance(), len(model.states)
    due, (J, carry) = ca.SX.sym("due", len(model.channels) + 1), symmetric("J", n)
    blocks = blocks_of(model, ca.SX.eye(n))
    after = J + sum((due[s] * block for s, block in enumerate(blocks)), ca.SX(n, n))
    inverse = ca.solve(one.F, ca.SX.eye(n))
    names = [signal.name for signal in model.unknown_inputs]
    unknown = [names.index(name) for name in known.unknown_inputs]
    moved = inverse.T @ after @ inverse
    for column in unknown:
        moved = _without(moved, one.B_w[:, column], 0.0)
    L = noise_factor(known.disturbance_psd, n, step)
    for column in range(L.shape[1]):
        moved = _without(moved, ca.SX(ca.DM(L[:, column])), 1.0)
    start = np.linalg.inv(known.prior.covariance)
    rows, columns = np.triu_indices(n)
    z = ca.vertcat(one.x, carry)
    return Recursion(z, one.u, due, ca.vertcat(one.x_next, packed(moved)), due[-1] * packed(after), start[columns, rows])


def _without(M: ca.SX, b: ca.SX, least: float) -> ca.SX:
    """M - M b b' M / (b'M b + least): what is left when something moves the state along b."""
    g = M @ b
    size = ca.dot(b, g) + least
    safe = size + _UNSEEN * (ca.trace(M) * ca.sumsqr(b)) * float(least == 0)
    return M - g @ g.T / (safe + 1e-300)
