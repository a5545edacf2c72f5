"""The recursion that makes errors of samples independent, one instant after the other: as graphs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from obsdesign.dynamics.model import Model
from obsdesign.information.correlated_noise import Colour


@dataclass(frozen=True, eq=False)
class ColouredOutputs:
    """Coloured outputs at one instant: rows dy/dx(t_0) / spread (q, n), level = 1 / spread (q, 1), gate (q, 1)."""

    rows: ca.SX
    level: ca.SX
    gate: ca.SX


@dataclass(frozen=True, eq=False)
class SampleSelection:
    """Which samples there are: sampling (q, 1), where the clock of the output's sensor has one; weights (q, 1) in [0, 1], a factor on the
    gate, 0 = off. Where amounts are counted: is_first (1, 1), whether errors before this instant are forgotten; factor (q, 1) on the
    information of each sample; bias_factor (q, 1) on the variance of its constant. decay (q, 1): what is left of z from this instant to
    the next, whoever has a sample then; None: phi from one instant of the sensor's clock to the next.
    """

    sampling: ca.SX
    weights: ca.SX
    is_first: ca.SX | None = None
    factor: ca.SX | None = None
    bias_factor: ca.SX | None = None
    decay: ca.SX | None = None


@dataclass(frozen=True, eq=False)
class Innovations:
    """One instant: independent innovations (q, n) about x(t_0) of weight (q, 1), so that W = sum of weight row'row over all instants.

    carry -> carry_next from one instant to the next, `start` before the first.
    """

    rows: ca.SX
    weight: ca.SX
    carry: ca.SX
    carry_next: ca.SX
    start: np.ndarray

    @property
    def information(self) -> list[ca.SX]:
        """What each output adds (n, n) to what is known from those before it."""
        return [self.rows[j, :].T @ (self.weight[j] * self.rows[j, :]) for j in range(self.rows.shape[0])]


@dataclass(eq=False)
class _CarryBuilder:
    """What is carried from one instant to the next, as it is found."""

    carry: list[ca.SX] = field(default_factory=list)
    later: list[ca.SX] = field(default_factory=list)
    start: list[float] = field(default_factory=list)

    def append(self, carry: Sequence[ca.SX], later: Sequence[ca.SX], start: Sequence[float]) -> None:
        """Add what is carried, what it is an instant later, and what it begins with."""
        self.carry.extend(carry)
        self.later.extend(later)
        self.start.extend(start)


def outputs_with_colour(model: Model, colour: Colour, Phi: ca.SX) -> ColouredOutputs:
    """Return what the coloured outputs of a model say at x about the state of which Phi is the derivative of x."""
    rows, level, gate = [], [], []
    for s in colour.sensor_indices:
        channel, noise = model.channels[s], model.channels[s].noise
        inverse_spread = ca.SX.ones(len(channel.outputs)) / (noise.inflation * noise.spread)
        rows.append(ca.diag(inverse_spread) @ (ca.jacobian(channel.h, model.x) @ Phi))
        level.append(inverse_spread)
        gate.append(ca.SX.ones(len(channel.outputs)) * noise.gate)
    return ColouredOutputs(ca.vertcat(*rows), ca.vertcat(*level), ca.vertcat(*gate))


def decay_between(model: Model, colour: Colour) -> ca.SX:
    """Return what a step leaves of z (q, 1), of the coloured outputs of a model whose time is counted in steps; 1 where none lasts."""
    noises = [model.channels[s].noise for s in colour.sensor_of_output]
    rates = [-np.log(noise.correlation) / noise.period if noise.correlation and noise.period else 0.0 for noise in noises]
    return ca.exp(-ca.DM(rates) * model.u[0])


def whiten(colour: Colour, outputs: ColouredOutputs, selection: SampleSelection) -> Innovations:
    """Return the rows of an instant, less what the samples before and beside them tell of their errors.

    An error is z_k + v_k + B e in units of its spread: z_k = phi z_k-1 + (1 - phi^2)^1/2 white, or drawn anew with the correlation of
    its group; v_k white of variance M (1 - g) / g, M = 1 + B^2, for samples that do not arrive; e ~ N(0, 1) the
    constant, B = bias / spread. First z is taken out, then e, by the innovations of a filter for each, whose estimates are linear
    in x(t_0): all that is carried are those rows and variances.
    """
    n, q = outputs.rows.shape[1], colour.q
    B = ca.DM(colour.bias) * outputs.level
    M = 1 + B * B
    is_arriving = ca.logic_and(selection.sampling, selection.weights > 0)
    g = ca.if_else(is_arriving, outputs.gate * selection.weights, 0)
    carry_builder = _CarryBuilder()
    innovations: dict[int, tuple[ca.SX, ca.SX]] = {}
    correlations = dict(colour.groups)
    for members in colour.error_groups:
        constants = [j for j in members if colour.bias[j]]
        rows = []
        for j in members:
            extended_row = ca.horzcat(outputs.rows[j, :], *[B[j] if i == j else ca.SX(1, 1) for i in constants])
            # not a product: where a sensor that is off has no derivative, nothing is lost
            rows.append(ca.if_else(is_arriving[j], extended_row, ca.SX(*extended_row.shape)))
        if members in correlations:
            group = _decorrelate_group(rows, g[list(members)], M[list(members)], correlations[members])
        elif colour.correlation[members[0]]:
            group = [
                _subtract_past(
                    rows[0],
                    g[members[0]],
                    M[members[0]],
                    colour.correlation[members[0]],
                    _selection_of(selection, members[0]),
                    carry_builder,
                )
            ]
        else:
            group = [(rows[0], g[members[0]] / (g[members[0]] + (1 - g[members[0]]) * M[members[0]]))]
        if selection.factor is not None:
            group = [(row, weight * selection.factor[j]) for j, (row, weight) in zip(members, group, strict=True)]
        if constants:
            group = _subtract_constants(group, n, [_selection_of(selection, j) for j in constants], carry_builder)
        innovations |= dict(zip(members, group, strict=True))
    rows, weights = zip(*[innovations[j] for j in range(q)], strict=True)
    return Innovations(
        ca.vertcat(*rows),
        ca.vertcat(*weights),
        ca.vertcat(ca.SX(0, 1), *carry_builder.carry),
        ca.vertcat(ca.SX(0, 1), *carry_builder.later),
        np.array(carry_builder.start),
    )


def _selection_of(selection: SampleSelection, j: int) -> SampleSelection:
    """What is taken of one output."""
    factor, spread, decay = (None if values is None else values[j] for values in (selection.factor, selection.bias_factor, selection.decay))
    return SampleSelection(selection.sampling[j], selection.weights[j], selection.is_first, factor, spread, decay)


def _subtract_past(
    row: ca.SX, g: ca.SX, M: ca.SX, phi: float, selection: SampleSelection, carry_builder: _CarryBuilder
) -> tuple[ca.SX, ca.SX]:
    """Take out of an output what its samples before tell of z, estimate a'x of variance p, a = 0 and p = 1 before the first.

    Innovation i = r - a of variance s = p + M (1 - g) / g, gain K = p / s; a <- phi (a + K i), p <- phi^2 p (1 - K) + 1 - phi^2 at
    each instant of the sensor's clock, or with the decay to the next instant in the place of phi at each of all. With g = 1 throughout
    the rows are c_0 and (c_k - phi c_k-1) / (1 - phi^2)^1/2.
    """
    pattern = row.sparsity()
    entries, p_symbol = ca.SX.sym("a", pattern.nnz()), ca.SX.sym("p")
    a, p = ca.SX(pattern, entries), p_symbol
    if selection.is_first is not None:
        a, p = ca.if_else(selection.is_first, ca.SX(*a.shape), a), ca.if_else(selection.is_first, 1, p)
    variance = g * p + (1 - g) * M  # g s: positive whatever arrives
    gain, innovation = g * p / variance, row - a
    if selection.decay is None:
        a_next = ca.if_else(selection.sampling, phi * (a + gain * innovation), a)
        p_next = ca.if_else(selection.sampling, phi**2 * p * (1 - gain) + (1 - phi) * (1 + phi), p)
    else:  # without a sample the gain is 0
        decay = selection.decay
        a_next, p_next = decay * (a + gain * innovation), decay**2 * p * (1 - gain) + (1 - decay) * (1 + decay)
    carry_builder.append([entries, p_symbol], [_nonzeros(a_next, pattern), p_next], [*[0.0] * pattern.nnz(), 1.0])
    return innovation, g / variance


def _decorrelate_group(rows: list[ca.SX], g: ca.SX, M: ca.SX, correlation: tuple[tuple[float, ...], ...]) -> list[tuple[ca.SX, ca.SX]]:
    """Take out of each output of a group what those before it tell of its z: Cholesky's elimination, row by row."""
    P = ca.SX(ca.sparsify(ca.DM(correlation)))
    estimates = [ca.SX(*row.shape) for row in rows]
    innovations = []
    for j, row in enumerate(rows):
        weight = g[j] / (g[j] * P[j, j] + (1 - g[j]) * M[j])
        innovation, gain = row - estimates[j], P[:, j] * weight
        innovations.append((innovation, weight))
        estimates = [estimate + gain[i] * innovation for i, estimate in enumerate(estimates)]
        P = P - gain @ P[j, :]
    return innovations


def _subtract_constants(
    group: list[tuple[ca.SX, ca.SX]], n: int, selections: list[SampleSelection], carry_builder: _CarryBuilder
) -> list[tuple[ca.SX, ca.SX]]:
    """Take out of rows (i, b) about state and constants, of weight w, what those before tell of the constants.

    Estimate A'x with covariance U U', A = 0 and U U' = spread before the first: f = U'b', t = 1 + w f'f, innovation i - b A of weight
    w / t, A <- A + U f w / t (i - b A), U <- U (I - f f' w / (t + t^1/2)) (Potter's square root: nothing cancels).
    """
    count = len(selections)
    pattern = group[0][0][0, :n].sparsity()
    for row, _ in group[1:]:
        pattern = pattern.unite(row[0, :n].sparsity())
    entries = [ca.SX.sym("A", pattern.nnz()) for _ in selections]
    U_symbol = ca.SX.sym("U", count, count) if count > 1 else ca.SX.sym("U")
    A, U = ca.vertcat(*[ca.SX(pattern, row_entries) for row_entries in entries]), U_symbol
    is_first, bias_factors = (
        selections[0].is_first,
        [selection.bias_factor for selection in selections if selection.bias_factor is not None],
    )
    if is_first is not None and bias_factors:
        root = ca.diag(ca.sqrt(ca.vertcat(*bias_factors)))
        A, U = ca.if_else(is_first, ca.SX(*A.shape), A), ca.if_else(is_first, ca.densify(root), U)
    innovations = []
    for row, weight in group:
        i, b = row[0, :n], row[0, n:]
        f = U.T @ b.T
        t = 1 + weight * ca.sumsqr(f)
        innovation = i - b @ A
        innovations.append((innovation, weight / t))
        A = A + (U @ f * (weight / t)) @ innovation
        U = U / ca.sqrt(t) if count == 1 else U - (U @ f) @ f.T * (weight / (t + ca.sqrt(t)))
    entries_next = [_nonzeros(A[i, :], pattern) for i in range(count)]
    carry_builder.append(
        [*entries, ca.vec(U_symbol)], [*entries_next, ca.vec(ca.densify(U))], [*[0.0] * (pattern.nnz() * count), *np.eye(count).ravel()]
    )
    return innovations


def _nonzeros(row: ca.SX, pattern: ca.Sparsity) -> ca.SX:
    columns = pattern.get_triplet()[1]
    return ca.vertcat(*[row[0, j] for j in columns]) if columns else ca.SX(0, 1)
