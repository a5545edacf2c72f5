"""What a design carries along a path beside the state, so that the matrix it is judged by is a sum over steps."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from obsdesign.criteria.abstract import Knowledge
from obsdesign.dynamics.driven_step import driven_step
from obsdesign.dynamics.model import Model
from obsdesign.dynamics.nuisance_states import NuisanceStates, nuisance_of
from obsdesign.dynamics.process_noise import noise_of
from obsdesign.dynamics.step import CACHE_SIZE, Step, blocks_of, sensitivity_of, step_of
from obsdesign.information.correlated_noise import colour_of
from obsdesign.information.information_update import in_units, inverse_step
from obsdesign.information.input_exchange import exchange_inputs
from obsdesign.information.nuisance_information import ErrorDistribution, update_with_samples
from obsdesign.information.sample_graph import instant_of
from obsdesign.packing import pack, pack_values, symmetric

_UNSEEN = 1e-12  # share of an unknown input's size below which it has not been seen


@dataclass(frozen=True, eq=False)
class InformationRecursion:
    """z_0 = (x_0, start), z_k+1 = z_next(z_k, u_k), judged matrix = sum of gain(z_k), packed; due: weights of the step's parts.

    z (c, 1), its first n entries the state; u (m, 1); due (s, 1): for a Gramian 1 for each sensor with a sample at that step, for
    a posterior the same followed by 1 at the steps at which its matrix is read, the last alone or several.
    """

    z: ca.SX
    u: ca.SX
    due: ca.SX
    z_next: ca.SX
    gain: ca.SX
    start: np.ndarray


@lru_cache(CACHE_SIZE)
def gramian_recursion(model: Model, step: float, substeps: int = 1, counted: bool = False) -> InformationRecursion:
    """Carry Phi; gain = sum over sensors of due_s Phi' C_s' R_s^-1 C_s Phi.

    Where errors are not independent, carry what is remembered of them as well: gains are what samples add to those before them, due
    is (share, due) (2 S,); counted: amounts from below for stretches, due is (share, due, fresh, factor, spread), see `Instant`.
    """
    dynamics, sensitivity = step_of(model, step, substeps).without_disturbance(), sensitivity_of(model, step, substeps)
    if colour_of(model) is not None:
        samples = instant_of(model, sensitivity.Phi, is_masked=True, is_additive=counted)
        gain = sum(samples.blocks, ca.SX(*sensitivity.Phi.shape))
        z, z_next = (
            ca.vertcat(dynamics.x, sensitivity.free, samples.carry),
            ca.vertcat(dynamics.x_next, sensitivity.free_next, samples.carry_next),
        )
        due = ca.vertcat(samples.sampling[1], samples.sampling[0], *samples.sampling[2:])
        return InformationRecursion(z, dynamics.u, due, z_next, pack(ca.densify(gain)), np.concatenate([sensitivity.start, samples.start]))
    due = ca.SX.sym("due", len(model.channels))
    blocks = blocks_of(model, sensitivity.Phi)
    gain = sum((due[s] * block for s, block in enumerate(blocks)), ca.SX(*sensitivity.Phi.shape))
    z = ca.vertcat(dynamics.x, sensitivity.free)
    return InformationRecursion(
        z, dynamics.u, due, ca.vertcat(dynamics.x_next, sensitivity.free_next), pack(ca.densify(gain)), sensitivity.start
    )


@lru_cache(CACHE_SIZE)
def state_recursion(model: Model, step: float, substeps: int = 1) -> InformationRecursion:
    """Carry the state alone, and gain nothing."""
    dynamics = step_of(model, step, substeps).without_disturbance()
    return InformationRecursion(dynamics.x, dynamics.u, ca.SX.sym("due", len(model.channels)), dynamics.x_next, ca.SX(0, 1), np.zeros(0))


@lru_cache(CACHE_SIZE)
def posterior_recursion(model: Model, step: float, knowledge: Knowledge, substeps: int = 1) -> InformationRecursion:
    """Carry J, packed, before the samples of t_k: J+ = M - M B (B'M B + Q^-1)^-1 B'M with M = F^-T (J + C'R^-1 C) F^-1.

    The gain, where it is read, is J + C'R^-1 C of t_k. In plain arithmetic, smooth, for the solver; values are recomputed with roots.
    With errors that last, J is about the constant ones (c of them) and the state, and `ErrorDistribution` are carried along.
    """
    noise = noise_of(model, knowledge.disturbance_psd, knowledge.input_psd, step)
    driven, nuisance = driven_step(model, step, substeps, noise, is_looped=False), nuisance_of(model, step)
    dynamics = driven.step.without_disturbance()
    a, c, n = len(nuisance.coloured), len(nuisance.constant), len(model.states)
    due, (J, entries) = ca.SX.sym("due", len(model.channels) + 1), symmetric("J", c + n)
    M, (V, spread) = ca.SX.sym("M", a, c + n), symmetric("V", a)
    updated, errors = _after_samples(model, nuisance, (J, ErrorDistribution(M, V)), due)
    names = [signal.name for signal in model.unknown_inputs]
    w = driven.step.w
    noise_columns = ca.substitute(driven.noise, w, ca.SX.zeros(w.numel())) if w.numel() else driven.noise
    disturbance = _Disturbance([names.index(name) for name in knowledge.unknown_inputs], noise_columns, knowledge.prior.std)
    predicted, next_errors = _predict(dynamics, disturbance, (updated, errors.predict(nuisance, model)))
    start = np.eye(c + n)
    start[c:, c:] = np.linalg.inv(knowledge.prior.covariance)
    z = ca.vertcat(dynamics.x, entries, ca.vec(M), spread)
    z_next = ca.vertcat(dynamics.x_next, pack(predicted), ca.vec(ca.densify(next_errors.M)), pack(next_errors.V))
    first = np.concatenate([pack_values(start.T), np.zeros(a * (c + n)), pack_values(nuisance.R)])
    return InformationRecursion(z, dynamics.u, due, z_next, due[-1] * pack(_eliminate_constants(updated, c)), first)


@dataclass(frozen=True, eq=False)
class _Disturbance:
    """What moves the state beside its inputs: places of unknown inputs, columns (n, r) of noise; unit (n,): a size of each state."""

    unknown: list[int]
    noise: ca.SX
    unit: np.ndarray


_JointInformation = tuple[ca.SX, ErrorDistribution]  # J about (b, x), and the other errors given those


def _after_samples(model: Model, nuisance: NuisanceStates, before: _JointInformation, due: ca.SX) -> _JointInformation:
    J, errors = before
    if not nuisance.size:
        blocks = blocks_of(model, ca.SX.eye(len(model.states)))
        return J + sum((due[s] * block for s, block in enumerate(blocks)), ca.SX(*J.shape)), errors
    rows, counts, after = update_with_samples(model, nuisance, errors, due)
    return J + rows.T @ (ca.repmat(counts, 1, rows.shape[1]) * rows), after


def _predict(dynamics: Step, disturbance: _Disturbance, updated: _JointInformation) -> _JointInformation:
    """Return what is known of x_k+1 when unknown inputs and noise move it, and of the errors given that."""
    (J, errors), n = updated, dynamics.x.numel()
    c = J.shape[0] - n
    transition = ca.diagcat(ca.SX.eye(c), dynamics.F) if c else dynamics.F
    if disturbance.unknown:
        input_columns = ca.vertcat(ca.SX(c, len(disturbance.unknown)), dynamics.B_w[:, list(disturbance.unknown)])
        J, errors = _predict_with_unknown_inputs((J, errors), transition, input_columns, np.append(np.ones(c), disturbance.unit))
    else:
        inverse = inverse_step(dynamics.F)
        transform = ca.diagcat(ca.SX.eye(c), inverse) if c else inverse
        J, errors = transform.T @ J @ transform, ErrorDistribution(errors.M @ transform, errors.V)
    for j in range(disturbance.noise.shape[1]):
        J, errors = _move_along((J, errors), ca.vertcat(ca.SX(c, 1), disturbance.noise[:, j]), 1.0)
    return J, errors


def _predict_with_unknown_inputs(known: _JointInformation, F: ca.SX, B: ca.SX, unit: np.ndarray) -> _JointInformation:
    """Return the same about F x + B w, w anything; see `exchange_inputs`. In units, so that states can be compared."""
    J, errors = known
    D = ca.SX(ca.diag(ca.DM(unit)))
    J, errors = D @ J @ D, ErrorDistribution(errors.M @ D, errors.V)
    sizes = ca.sqrt(ca.fmax(ca.diag(J), 0))  # chooses states, and is not differentiated
    exchange = exchange_inputs(*in_units(F, B, ca.SX(ca.DM(unit))), sizes)
    for j in range(B.shape[1]):
        J, errors = _move_along((J, errors), exchange.Q[:, j], 0.0)
    X = exchange.X @ ca.SX(ca.diag(ca.DM(1 / unit)))
    return X.T @ J @ X, ErrorDistribution(errors.M @ X, errors.V)


def _move_along(known: _JointInformation, b: ca.SX, information: float) -> _JointInformation:
    """Return the same about x + b e, with so much information about e before: 0 of an unknown input, 1 of noise."""
    J, errors = known
    g, size = _downdate_terms(J, b, information)
    along = errors.M @ b
    return J - g @ g.T / size, ErrorDistribution(errors.M - along @ g.T / size, errors.V + along @ along.T / size)


def _downdate_terms(M: ca.SX, b: ca.SX, information: float) -> tuple[ca.SX, ca.SX]:
    """M b and b'M b + least: M - M b b'M / that is left when something moves the state along b."""
    g = M @ b
    size = ca.dot(b, g) + information
    safe = size + _UNSEEN * (ca.trace(M) * ca.sumsqr(b)) * float(information == 0)
    return g, safe + 1e-300


def _eliminate_constants(J: ca.SX, c: int) -> ca.SX:
    """Schur complement of the first c: constant errors have information of their own, so that no pivot is 0."""
    for _ in range(c):
        J = J[1:, 1:] - J[1:, 0] @ J[0, 1:] / J[0, 0]
    return J
