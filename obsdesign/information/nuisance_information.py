"""What is known of a state when its samples have errors that last: information about the state, the errors given the state."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from obsdesign.dynamics.model import Model
from obsdesign.dynamics.nuisance_states import Nuisance
from obsdesign.information.information_update import Disturbance, Root, blind, noticed


@dataclass(frozen=True, eq=False)
class Errors:
    """First-order errors z | x ~ N(M x, V) given the state: M (a, n), V (a, a), of what has been sampled so far.

    A sample without an independent part says all of z once x is known: V = 0 there, and no joint information would exist.
    """

    M: ca.SX
    V: ca.SX

    def later(self, nuisance: Nuisance) -> Errors:
        """Return them one step later: z+ = decay z + w."""
        decay = ca.SX(ca.DM(nuisance.decay))
        return Errors(self.M * ca.repmat(decay, 1, self.M.shape[1]), self.V * (decay @ decay.T) + ca.SX(ca.DM(nuisance.fresh)))


def sampled_with(model: Model, nuisance: Nuisance, errors: Errors, weights: ca.SX) -> tuple[ca.SX, ca.SX, Errors]:
    """Return rows r (q, c + n) about (b, x), what each counts w (q, 1), and z after the samples of sensors of weight (S, 1) not 0.

    Together they are worth r' diag(w) r. One output after the other: given (b, x), y_i / s_i is known to 1 / w = V_ii + missing / s_i^2
    (V_ii = 1 without a lasting z_i), and z moves by V_:i w times what it is off.
    """
    M, V, rows, counts = errors.M, errors.V, [], []
    for i, sensor in enumerate(model.output_owner):
        row, more, gate = _sample(model, nuisance, i)
        z = nuisance.coloured.index(i) if i in nuisance.coloured else None
        w = gate / (gate * (1 if z is None else V[z, z]) + more * (1 - gate))
        row = row if z is None else row + M[z, :]
        # not a product: where a sensor that is off has no derivative, nothing is lost
        row, w = ca.if_else(weights[sensor], row, ca.SX(*row.shape)), ca.if_else(weights[sensor], w, 0)
        if z is not None:
            M, V = M - (V[:, z] * w) @ row, V - w * (V[:, z] @ V[z, :])
        rows.append(row)
        counts.append(w)
    return ca.vertcat(*rows), ca.vertcat(*counts), Errors(M, V)


def drawn_before(model: Model, nuisance: Nuisance, weights: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return what the samples of an instant say about (b, x, z before), with z = decay z before + w, and what they leave of z.

    Rows (q, s) of variance 1; back (s, s) and kicks (s, a) with (b, x, z) = back (b, x, z before) + kicks e, e ~ N(0, I). z given
    (b, x, z before) is N(M ., U U'), updated by one sample after the other as in `sampled_with`, U by Potter's formula.
    """
    a, size = len(nuisance.coloured), len(nuisance.constant) + len(model.states)
    U, rows = ca.SX(ca.sparsify(ca.DM(np.linalg.cholesky(nuisance.fresh)))), []
    M = ca.horzcat(ca.SX(a, size), ca.diag(ca.SX(ca.DM(nuisance.decay))))
    for i, sensor in enumerate(model.output_owner):
        row, more, gate = _sample(model, nuisance, i)
        row = ca.horzcat(row, ca.SX(1, a))
        z = nuisance.coloured.index(i) if i in nuisance.coloured else None
        f = ca.SX(a, 1) if z is None else U[z, :].T
        row = row if z is None else row + M[z, :]
        v = gate * (ca.sumsqr(f) if z is not None else 1) + more * (1 - gate)  # gate times the variance of the sample
        on = weights[sensor]
        row, w = ca.if_else(on, row, ca.SX(*row.shape)), ca.if_else(on, gate / v, 0)
        rows.append(ca.sqrt(w) * row)
        if z is not None:
            share = ca.if_else(on, gate / (v + ca.sqrt(more * (1 - gate) * v)), 0)
            M, U = M - (U @ f) @ (w * row), U - share * ((U @ f) @ f.T)
    back = ca.vertcat(ca.horzcat(ca.SX.eye(size), ca.SX(size, a)), M)
    return ca.vertcat(*rows), back, ca.vertcat(ca.SX(size, a), U)


def _sample(model: Model, nuisance: Nuisance, output: int) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return dy_i / d(b, x) / s_i (1, c + n), 1 + bias^2 / s_i^2 and the gate: missing = s_i^2 (1 + bias^2 / s_i^2)(1 - g) / g."""
    channel = model.channels[model.output_owner[output]]
    place = model.outputs_of[channel.name].index(output)
    spread = channel.noise.inflation * (channel.noise.spread * ca.SX.ones(len(channel.outputs)))[place]
    loads = ca.SX(1, len(nuisance.constant))
    for at, bias in nuisance.loads(output):
        loads[at] = bias
    row = ca.horzcat(loads, ca.jacobian(model.h[output], model.x)) / spread
    return row, 1 + (channel.noise.bias / spread) ** 2, channel.noise.gate


def carried_with(root: Root, errors: Errors, F: ca.SX, B_w: ca.SX, disturbance: Disturbance) -> tuple[Root, Errors]:
    """Return root and errors about (b, x_k+1), for x_k+1 = F x_k + B w + L noise, where these are about (b, x_k); z stays."""
    n, c = F.shape[0], root.T.shape[1] - F.shape[0]
    back = ca.diagcat(ca.SX.eye(c), ca.solve(F, ca.SX.eye(n)))
    moves = ca.vertcat(ca.SX(c, B_w.shape[1]), B_w)
    noise = ca.vertcat(ca.SX(c, disturbance.L.shape[1]), ca.sparsify(ca.SX(ca.DM(disturbance.L))))
    return _shaken_with(root.carried(back), Errors(errors.M @ back, errors.V), moves[:, list(disturbance.unknown)], noise)


def _shaken_with(root: Root, errors: Errors, unknown: ca.SX, noise: ca.SX) -> tuple[Root, Errors]:
    """Return `shaken` of the root, and the errors given the state that has been moved along columns of unknown inputs and of noise.

    x' = x + b w with root T about x: w | x' ~ N(g'T x' / (g'g + q), 1 / (g'g + q)), g = T b, with q = 0 for an unknown input and 1 for
    noise, so M' = M - (M b) g'T / (g'g + q) and V' = V + (M b)(M b)' / (g'g + q). Rows of M are combinations of rows of T: what says
    nothing of x says nothing of z.
    """
    T, rounding, M, V = root.T, root.now, errors.M, errors.V
    columns = [unknown[:, j] for j in range(unknown.shape[1])]
    for b in columns:
        g, moved = T @ b, M @ b
        share = noticed(g, b, rounding)
        M, V, T = M - share * (moved @ (g.T @ T)), V + share * (moved @ moved.T), T - share * (g @ (g.T @ T))
    for b in 2 * columns:
        T, M = (blind(each, b, rounding) for each in (T, M))
    for j in range(noise.shape[1]):
        g, moved = T @ noise[:, j], M @ noise[:, j]
        norm = ca.sqrt(1 + ca.sumsqr(g))
        M, V = M - moved @ (g.T @ T) / norm**2, V + moved @ moved.T / norm**2
        T = T - g @ (g.T @ T) / (norm * (norm + 1))
    return Root(T, rounding), Errors(M, V)
