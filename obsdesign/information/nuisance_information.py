"""What is known of a state when its samples have errors that last: information about the state, the errors given the state."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from obsdesign.dynamics.model import Model
from obsdesign.dynamics.nuisance_states import NuisanceStates
from obsdesign.information.information_update import InformationRoot, in_units, inverse_step, move_along
from obsdesign.information.input_exchange import exchange_inputs


@dataclass(frozen=True, eq=False)
class ErrorDistribution:
    """First-order errors z | x ~ N(M x, V) given the state: M (a, n), V (a, a), of what has been sampled so far.

    A sample without an independent part says all of z once x is known: V = 0 there, and no joint information would exist.
    """

    M: ca.SX
    V: ca.SX

    def predict(self, nuisance: NuisanceStates, model: Model) -> ErrorDistribution:
        """Return them one step later: z+ = decay z + w."""
        decay, root = nuisance.decay_graph(model), nuisance.driving_root(model)
        return ErrorDistribution(self.M * ca.repmat(decay, 1, self.M.shape[1]), self.V * (decay @ decay.T) + root @ root.T)


def update_with_samples(
    model: Model, nuisance: NuisanceStates, errors: ErrorDistribution, weights: ca.SX
) -> tuple[ca.SX, ca.SX, ErrorDistribution]:
    """Return rows r (q, c + n) about (b, x), what each counts w (q, 1), and z after the samples of sensors of weight (S, 1) not 0.

    Together they are worth r' diag(w) r. One output after the other: given (b, x), y_i / s_i is known to 1 / w = V_ii + missing / s_i^2
    (V_ii = 1 without a lasting z_i), and z moves by V_:i w times what it is off.
    """
    M, V, rows, information = errors.M, errors.V, [], []
    for i, sensor in enumerate(model.output_owner):
        row, bias_ratio, gate = sample_row(model, nuisance, i)
        z = nuisance.coloured.index(i) if i in nuisance.coloured else None
        w = gate / (gate * (1 if z is None else V[z, z]) + bias_ratio * (1 - gate))
        row = row if z is None else row + M[z, :]
        # not a product: where a sensor that is off has no derivative, nothing is lost
        if z is None and not nuisance.loads(i):  # nothing lasts: a sample may count more than once
            w = weights[sensor] * w
        row, w = ca.if_else(weights[sensor], row, ca.SX(*row.shape)), ca.if_else(weights[sensor], w, 0)
        if z is not None:
            M, V = M - (V[:, z] * w) @ row, V - w * (V[:, z] @ V[z, :])
        rows.append(row)
        information.append(w)
    return ca.vertcat(*rows), ca.vertcat(*information), ErrorDistribution(M, V)


def samples_given_previous(model: Model, nuisance: NuisanceStates, weights: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return what the samples of an instant say about (b, x, z before), with z = decay z before + w, and what they leave of z.

    Rows (q, s) of variance 1; back (s, s) and kicks (s, a) with (b, x, z) = back (b, x, z before) + kicks e, e ~ N(0, I). z given
    (b, x, z before) is N(M ., U U'), updated by one sample after the other as in `update_with_samples`, U by Potter's formula.
    """
    a, size = len(nuisance.coloured), len(nuisance.constant) + len(model.states)
    U, rows = nuisance.driving_root(model), []
    M = ca.horzcat(ca.SX(a, size), ca.diag(nuisance.decay_graph(model)))
    for i, sensor in enumerate(model.output_owner):
        row, bias_ratio, gate = sample_row(model, nuisance, i)
        row = ca.horzcat(row, ca.SX(1, a))
        z = nuisance.coloured.index(i) if i in nuisance.coloured else None
        f = ca.SX(a, 1) if z is None else U[z, :].T
        row = row if z is None else row + M[z, :]
        v = gate * (ca.sumsqr(f) if z is not None else 1) + bias_ratio * (1 - gate)  # gate times the variance of the sample
        is_active = weights[sensor]
        row, w = ca.if_else(is_active, row, ca.SX(*row.shape)), ca.if_else(is_active, gate / v, 0)
        rows.append(ca.sqrt(w) * row)
        if z is not None:
            gain = ca.if_else(is_active, gate / (v + ca.sqrt(bias_ratio * (1 - gate) * v)), 0)
            M, U = M - (U @ f) @ (w * row), U - gain * ((U @ f) @ f.T)
    transition = ca.vertcat(ca.horzcat(ca.SX.eye(size), ca.SX(size, a)), M)
    return ca.vertcat(*rows), transition, ca.vertcat(ca.SX(size, a), U)


def sample_row(model: Model, nuisance: NuisanceStates, output: int) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return dy_i / d(b, x) / s_i (1, c + n), 1 + bias^2 / s_i^2 and the gate: missing = s_i^2 (1 + bias^2 / s_i^2)(1 - g) / g."""
    channel, spread = model.channels[model.output_owner[output]], output_spread(model, output)
    loads = ca.SX(1, len(nuisance.constant))
    for index, bias in nuisance.loads(output):
        loads[index] = bias
    row = ca.horzcat(loads, ca.jacobian(model.h[output], model.x)) / spread
    return row, 1 + (model.output_bias[output] / spread) ** 2, channel.noise.gate


def output_spread(model: Model, output: int) -> ca.SX:
    """Return s_i (1, 1): the standard deviation of an output's first-order error, in its unit."""
    channel = model.channels[model.output_owner[output]]
    spread = channel.noise.spread * ca.SX.ones(len(channel.outputs))
    return channel.noise.inflation * spread[model.outputs_of[channel.name].index(output)]


def predict_with_errors(
    root: InformationRoot, errors: ErrorDistribution, F: ca.SX, B: ca.SX, noise: ca.SX, unit: ca.SX
) -> tuple[InformationRoot, ErrorDistribution]:
    """Return root and errors about (b, x_k+1), for x_k+1 = F x_k + B w + noise e, where these are about (b, x_k); z stays.

    An unknown input leaves x = X x' + q t with t | x' ~ N(-g'T X x' / g'g, 1 / g'g), g = T q, so M' = (M - (M q) g'T / g'g) X and
    V' = V + (M q)(M q)' / g'g. Rows of M are combinations of rows of T: what says nothing of x says nothing of z.
    """
    c = root.T.shape[1] - F.shape[0]
    noise = ca.vertcat(ca.SX(c, noise.shape[1]), noise)
    transition, all_units = ca.diagcat(ca.SX.eye(c), F), ca.vertcat(ca.SX.ones(c), unit)
    if not B.shape[1]:
        X = inverse_step(transition)
        return _add_noise_with_errors(root.transform(X), ErrorDistribution(errors.M @ X, errors.V), noise)
    input_columns = ca.vertcat(ca.SX(c, B.shape[1]), B)
    root, M, V = root.scale(all_units).without_residues(), errors.M @ ca.diag(all_units), errors.V
    exchange = exchange_inputs(*in_units(transition, input_columns, all_units), root.rounding)
    for column in range(exchange.Q.shape[1]):
        q = exchange.Q[:, column]
        precision, error_change, row = root.precision_along(q), M @ q, (root.T @ q).T @ root.T
        is_seen = precision > 0
        variance = is_seen / ca.if_else(is_seen, precision, 1)
        M, V, root = M - variance * (error_change @ row), V + variance * (error_change @ error_change.T), root.eliminate(q)
    M = M @ exchange.X @ ca.diag(1 / all_units)
    root = root.transform(exchange.X, exchange.magnitudes).add_solution_error(exchange.A, exchange.inverse).scale(1 / all_units)
    return _add_noise_with_errors(root, ErrorDistribution(M, V), noise)


def _add_noise_with_errors(root: InformationRoot, errors: ErrorDistribution, noise: ca.SX) -> tuple[InformationRoot, ErrorDistribution]:
    """Return both given the state that has been moved along columns of noise.

    x' = x + b e with root T about x: e | x' ~ N(g'T x' / (g'g + 1), 1 / (g'g + 1)), g = T b, so M' = M - (M b) g'T / (g'g + 1) and
    V' = V + (M b)(M b)' / (g'g + 1).
    """
    M, V = errors.M, errors.V
    for j in range(noise.shape[1]):
        b, error_change = noise[:, j], M @ noise[:, j]
        _, gain, deviation = move_along(root.T, b)
        M, V = M - error_change @ gain, V + (deviation * error_change) @ (deviation * error_change).T
        root = root.add_noise(b)
    return root, ErrorDistribution(M, V)
