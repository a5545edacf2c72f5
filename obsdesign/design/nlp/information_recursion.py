"""What a design carries along a path beside the state, so that the matrix it is judged by is a sum over steps."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from obsdesign.criteria.abstract import Knowledge
from obsdesign.dynamics.model import Model
from obsdesign.dynamics.nuisance_states import Nuisance, nuisance_of
from obsdesign.dynamics.step import CACHED, Step, blocks_of, sensitivity_of, step_of
from obsdesign.information.correlated_noise import colour_of
from obsdesign.information.nuisance_information import Errors, sampled_with
from obsdesign.information.posterior import noise_factor
from obsdesign.information.sample_graph import instant_of
from obsdesign.packing import packed, packed_values, symmetric

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
def gramian_recursion(model: Model, step: float, substeps: int = 1, counted: bool = False) -> Recursion:
    """Carry Phi; gain = sum over sensors of due_s Phi' C_s' R_s^-1 C_s Phi.

    Where errors are not independent, carry what is remembered of them as well: gains are what samples add to those before them, due
    is (share, due) (2 S,); counted: amounts from below for stretches, due is (share, due, fresh, factor, spread), see `Instant`.
    """
    one, shape = step_of(model, step, substeps).without_disturbance(), sensitivity_of(model, step, substeps)
    if colour_of(model) is not None:
        found = instant_of(model, shape.Phi, masked=True, counted=counted)
        gain = sum(found.blocks, ca.SX(*shape.Phi.shape))
        z, z_next = ca.vertcat(one.x, shape.free, found.carry), ca.vertcat(one.x_next, shape.next, found.carry_next)
        due = ca.vertcat(found.taken[1], found.taken[0], *found.taken[2:])
        return Recursion(z, one.u, due, z_next, packed(ca.densify(gain)), np.concatenate([shape.start, found.start]))
    due = ca.SX.sym("due", len(model.channels))
    blocks = blocks_of(model, shape.Phi)
    gain = sum((due[s] * block for s, block in enumerate(blocks)), ca.SX(*shape.Phi.shape))
    z = ca.vertcat(one.x, shape.free)
    return Recursion(z, one.u, due, ca.vertcat(one.x_next, shape.next), packed(ca.densify(gain)), shape.start)


@lru_cache(CACHED)
def bare_recursion(model: Model, step: float, substeps: int = 1) -> Recursion:
    """Carry the state alone, and gain nothing."""
    one = step_of(model, step, substeps).without_disturbance()
    return Recursion(one.x, one.u, ca.SX.sym("due", len(model.channels)), one.x_next, ca.SX(0, 1), np.zeros(0))


@lru_cache(CACHED)
def posterior_recursion(model: Model, step: float, known: Knowledge, substeps: int = 1) -> Recursion:
    """Carry J, packed, before the samples of t_k: J+ = M - M B (B'M B + Q^-1)^-1 B'M with M = F^-T (J + C'R^-1 C) F^-1.

    The last gain is J + C'R^-1 C of t_N-1. In plain arithmetic, smooth, for the solver; values are recomputed with square roots.
    With errors that last, J is about the constant ones (c of them) and the state, and `Errors` are carried along.
    """
    one, nuisance = step_of(model, step, substeps).without_disturbance(), nuisance_of(model, step)
    a, c, n = len(nuisance.coloured), len(nuisance.constant), len(model.states)
    due, (J, entries) = ca.SX.sym("due", len(model.channels) + 1), symmetric("J", c + n)
    M, (V, spread) = ca.SX.sym("M", a, c + n), symmetric("V", a)
    after, errors = _after_samples(model, nuisance, (J, Errors(M, V)), due)
    moved, later = _moved(one, _columns(model, one, step, known), (after, errors.later(nuisance)))
    start = np.eye(c + n)
    start[c:, c:] = np.linalg.inv(known.prior.covariance)
    z = ca.vertcat(one.x, entries, ca.vec(M), spread)
    z_next = ca.vertcat(one.x_next, packed(moved), ca.vec(ca.densify(later.M)), packed(later.V))
    first = np.concatenate([packed_values(start.T), np.zeros(a * (c + n)), packed_values(nuisance.R)])
    return Recursion(z, one.u, due, z_next, due[-1] * packed(_about_state(after, c)), first)


_Known = tuple[ca.SX, Errors]  # J about (b, x), and the other errors given those


def _after_samples(model: Model, nuisance: Nuisance, before: _Known, due: ca.SX) -> _Known:
    J, errors = before
    if not nuisance.size:
        blocks = blocks_of(model, ca.SX.eye(len(model.states)))
        return J + sum((due[s] * block for s, block in enumerate(blocks)), ca.SX(*J.shape)), errors
    rows, counts, after = sampled_with(model, nuisance, errors, due)
    return J + rows.T @ (ca.repmat(counts, 1, rows.shape[1]) * rows), after


def _moved(one: Step, columns: list[tuple[ca.SX, float]], after: _Known) -> _Known:
    """Return what is known of x_k+1 when columns move it, each by what has so much information, and of the errors given that."""
    (J, errors), n = after, one.x.numel()
    c = J.shape[0] - n
    inverse = ca.solve(one.F, ca.SX.eye(n))
    back = ca.diagcat(ca.SX.eye(c), inverse) if c else inverse
    moved, M, V = back.T @ J @ back, errors.M @ back, errors.V
    for column, least in columns:
        b = ca.vertcat(ca.SX(c, 1), column)
        g, size = _taken(moved, b, least)
        along = M @ b
        moved, M, V = moved - g @ g.T / size, M - along @ g.T / size, V + along @ along.T / size
    return moved, Errors(M, V)


def _columns(model: Model, one: Step, step: float, known: Knowledge) -> list[tuple[ca.SX, float]]:
    """What moves the state beside its inputs, and the information that there is about it before: 0 of unknown inputs, 1 of noise."""
    names = [signal.name for signal in model.unknown_inputs]
    L = noise_factor(known.disturbance_psd, len(model.states), step)
    unknown = [(one.B_w[:, names.index(name)], 0.0) for name in known.unknown_inputs]
    return unknown + [(ca.SX(ca.DM(L[:, column])), 1.0) for column in range(L.shape[1])]


def _taken(M: ca.SX, b: ca.SX, least: float) -> tuple[ca.SX, ca.SX]:
    """M b and b'M b + least: M - M b b'M / that is left when something moves the state along b."""
    g = M @ b
    size = ca.dot(b, g) + least
    safe = size + _UNSEEN * (ca.trace(M) * ca.sumsqr(b)) * float(least == 0)
    return g, safe + 1e-300


def _about_state(J: ca.SX, c: int) -> ca.SX:
    """Schur complement of the first c: constant errors have information of their own, so that no pivot is 0."""
    for _ in range(c):
        J = J[1:, 1:] - J[1:, 0] @ J[0, 1:] / J[0, 0]
    return J
