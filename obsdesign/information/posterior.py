"""The posterior Cramer-Rao recursion: what can be known of x(t_k) with process noise and unknown inputs."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from obsdesign.checks import require_known
from obsdesign.errors import InputError
from obsdesign.information.gramian import require_fit
from obsdesign.information.recursion import Disturbance, packed, packed_values, predicted, shaken, symmetric, unpacked
from obsdesign.information.sampling import sampled, with_derivatives
from obsdesign.model import AbstractSystem, Model
from obsdesign.prior import Prior
from obsdesign.scan import Scan
from obsdesign.step import CACHED, blocks_of, dense_blocks, step_of
from obsdesign.trajectory import Trajectory

_TOLD_APART = 1e-12  # smallest eigenvalue, at unit diagonal, of what the outputs say about constant inputs


def posterior_information(
    system: AbstractSystem,
    path: Trajectory,
    prior: Prior,
    disturbance_psd: ArrayLike | None = None,
    unknown_inputs: Sequence[str] = (),
    active: np.ndarray | None = None,
) -> np.ndarray:
    """Return J (N+1, n, n), the information about x(t_k): J[k] includes the samples at t_k for k < N, J[N] is predicted.

    J+ = M - M B (B'M B + Q^-1)^# B'M + C'R^-1 C,  M = F^-T J F^-1,  J_0 = P_0^-1 + C'R^-1 C; for an unknown input Q^-1 = 0.
    disturbance_psd: None, (n,) or (n, n) in unit^2/s, Q = psd * step; active (N, S) bool: which sensors are on, None = all.
    Raises InputError for shapes that do not fit, unknown names, and unknown inputs of which a combination leaves no trace in
    any output. Source: Tichavsky, Muravchik, Nehorai (1998).
    """
    disturbance = disturbance_of(system, path, prior, disturbance_psd, unknown_inputs)
    weights = weights_of(system, path, active)
    if disturbance.unknown:
        _backwards(system, path, disturbance, weights)
    carry, J = _forward(system.model, path.step, disturbance).along(packed_values(prior.information), path.x[:-1], path.u, weights)
    n = path.x.shape[1]
    found = np.concatenate([J.reshape(-1, n, n), unpacked(carry[-1:], n)])
    return found if np.isfinite(found).all() else _refused(found, system, path, weights)


def unknown_input_information(
    system: AbstractSystem,
    path: Trajectory,
    prior: Prior,
    disturbance_psd: ArrayLike | None = None,
    unknown_inputs: Sequence[str] = (),
    active: np.ndarray | None = None,
) -> np.ndarray:
    """Return (N, p, p), the information about the unknown inputs w_k, held from t_k to t_k+1, of all samples along the path.

    With J_k what is known of x(t_k) then, and L_k+1 what later samples say about x(t_k+1) when later inputs are unknown too,
    J_w = B'L B - B'L F (J_k + F'L F)^# F'L B. Zero where w_k leaves no trace: the last inputs always. In 1/unit^2 per step.
    Raises InputError as posterior_information, and without unknown inputs.
    """
    if not unknown_inputs:
        raise InputError("unknown_inputs is empty: there is no input to know anything of")
    disturbance = disturbance_of(system, path, prior, disturbance_psd, unknown_inputs)
    weights = weights_of(system, path, active)
    J = posterior_information(system, path, prior, disturbance_psd, unknown_inputs, active)[:-1]
    joint = _backwards(system, path, disturbance, weights)
    n = path.x.shape[1]
    joint[:, :n, :n] += J
    return _schur(joint, n)


def disturbance_of(
    system: AbstractSystem, path: Trajectory, prior: Prior, disturbance_psd: ArrayLike | None, unknown_inputs: Sequence[str]
) -> Disturbance:
    """Return what moves the state; raise InputError for what does not fit."""
    require_fit(system, path)
    model = system.model
    if prior.mean.shape != path.x[0].shape:
        raise InputError(f"prior has {prior.mean.size} states: the path has {path.x.shape[1]} ({', '.join(model.state_names)})")
    require_known("unknown_inputs", unknown_inputs, [signal.name for signal in model.unknown_inputs])
    unknown = tuple(i for i, signal in enumerate(model.unknown_inputs) if signal.name in unknown_inputs)
    noise = noise_factor(disturbance_psd, path.x.shape[1], path.step)
    return Disturbance(unknown, tuple(map(tuple, noise.tolist())))


def noise_factor(disturbance_psd: ArrayLike | None, n: int, step: float) -> np.ndarray:
    """Return L (n, r) with L L' = psd * step; raise InputError unless the psd is (n,) >= 0 or (n, n) positive semidefinite."""
    if disturbance_psd is None:
        return np.zeros((n, 0))
    psd = np.array(disturbance_psd, dtype=float)
    if psd.shape == (n,):
        psd = np.diag(psd)
    if psd.shape != (n, n) or not np.isfinite(psd).all() or not np.allclose(psd, psd.T):
        raise InputError(f"disturbance_psd has shape {psd.shape}: must be finite, ({n},) or symmetric ({n}, {n})")
    values, vectors = np.linalg.eigh(psd)
    if values[0] < -1e-12 * max(values[-1], 0.0):
        raise InputError(f"disturbance_psd has the eigenvalue {values[0]:g}: must be positive semidefinite")
    kept = values > 0
    return vectors[:, kept] * np.sqrt(values[kept] * step)


def weights_of(system: AbstractSystem, path: Trajectory, active: np.ndarray | None) -> np.ndarray:
    """Return (N, S): 1 where a sensor is on and has a sample, else 0."""
    due = sampled(system, path.steps, path.step)
    if active is None:
        return due.astype(float)
    if np.shape(active) != due.shape:
        raise InputError(f"active has shape {np.shape(active)}: must be {due.shape}")
    return (due & np.asarray(active, dtype=bool)).astype(float)


def gained(model: Model, weights: ca.SX) -> ca.SX:
    """C'R^-1 C (n, n) of those sensors whose weight (S, 1) is not 0, about the state of that instant."""
    n = len(model.states)
    blocks = blocks_of(model, ca.SX.eye(n))
    # not a product: where a sensor that is off has no derivative, nothing is lost
    return sum((ca.if_else(weights[s], block, 0) for s, block in enumerate(blocks)), ca.SX.zeros(n, n))


def posterior_step(model: Model, step: float, disturbance: Disturbance) -> ca.Function:
    """Return (J before the samples of t_k, x_k, u_k, active (S,)) -> J before those of t_k+1, both as lower triangles: for a design."""
    one, weights = step_of(model, step).without_disturbance(), ca.SX.sym("active", len(model.channels))
    J, carry = symmetric("J", len(model.states))
    known = J + gained(model, weights)
    return ca.Function("posterior", [carry, one.x, one.u, weights], [packed(predicted(known, one.F, one.B_w, disturbance))])


@lru_cache(CACHED)
def _forward(model: Model, step: float, disturbance: Disturbance) -> Scan:
    one, weights = step_of(model, step).without_disturbance(), ca.SX.sym("active", len(model.channels))
    J, carry = symmetric("J", len(model.states))
    carry_next = posterior_step(model, step, disturbance)(carry, one.x, one.u, weights)
    return Scan(carry, [one.x, one.u, weights], carry_next, [dense_blocks([J + gained(model, weights)])])


@lru_cache(CACHED)
def _backward(model: Model, step: float, disturbance: Disturbance) -> Scan:
    """(what later samples say about x_k+1, the same if all later inputs were known) -> the same about x_k.

    Results: [F B]'L [F B] (n + p, n + p) about (x_k, w_k), and B'L B (p, p) if all else were known.
    """
    one = step_of(model, step).without_disturbance()
    n, weights = len(model.states), ca.SX.sym("active", len(model.channels))
    (later, first), (alone, second) = symmetric("later", n), symmetric("alone", n)
    B = one.B_w[:, list(disturbance.unknown)]
    sample = gained(model, weights)
    noisy = shaken(later, one.B_w, Disturbance((), disturbance.noise))
    both = ca.horzcat(one.F, B)
    earlier = one.F.T @ shaken(noisy, one.B_w, Disturbance(disturbance.unknown, ((),) * n)) @ one.F + sample
    carry_next = ca.vertcat(packed(earlier), packed(one.F.T @ alone @ one.F + sample))
    return Scan(
        ca.vertcat(first, second),
        [one.x, one.u, weights],
        carry_next,
        [dense_blocks([both.T @ noisy @ both]), dense_blocks([B.T @ alone @ B])],
    )


def _backwards(system: AbstractSystem, path: Trajectory, disturbance: Disturbance, weights: np.ndarray) -> np.ndarray:
    """Return (N, n + p, n + p), what later samples say about (x_k, w_k); raise InputError for inputs that leave no trace."""
    n, p = path.x.shape[1], len(disturbance.unknown)
    scan = _backward(system.model, path.step, disturbance)
    _, joint, alone = scan.along(np.zeros(n * (n + 1)), path.x[-2::-1], path.u[::-1], weights[::-1])
    if not np.isfinite(joint).all():
        _refused(joint[::-1], system, path, weights)
    _require_trace(system, disturbance, alone.reshape(-1, p, p).sum(axis=0))
    return joint[::-1].reshape(-1, n + p, n + p).copy()


def _require_trace(system: AbstractSystem, disturbance: Disturbance, seen: np.ndarray) -> None:
    """Raise InputError where `seen` (p, p), what the outputs say about constant unknown inputs, is blind to a combination."""
    names = [system.model.unknown_inputs[i].name for i in disturbance.unknown]
    size = np.sqrt(np.diag(seen))
    for name, value in zip(names, size, strict=True):
        if not value > 0:
            raise InputError(f"unknown_inputs: {name!r} leaves no trace in any output along this path")
    values, vectors = np.linalg.eigh(seen / np.outer(size, size))
    if values[0] < _TOLD_APART:
        along = vectors[:, 0] / size
        along = along / along[np.abs(along).argmax()]
        words = " ".join(f"{share:+.3g} {name}" for share, name in zip(along, names, strict=True) if abs(share) > 1e-6)
        raise InputError(f"unknown_inputs cannot be told apart from the outputs along this path: {words} leaves no trace in any of them")


def _schur(joint: np.ndarray, n: int) -> np.ndarray:
    """D - B'A^# B for joint = [A B; B' D] (N, n + p, n + p), A (n, n): balanced, then without the directions A is blind to."""
    A, B, D = joint[:, :n, :n], joint[:, :n, n:], joint[:, n:, n:]
    diagonal = np.diagonal(A, axis1=1, axis2=2)
    scale = np.where(diagonal > 0, 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0)), 0.0)
    values, vectors = np.linalg.eigh(A * scale[:, :, None] * scale[:, None, :])
    kept = values > n * np.finfo(float).eps * np.maximum(values[:, -1:], 1.0)
    rotated = np.einsum("kij,kia->kja", vectors, B * scale[:, :, None])
    weighted = np.where(kept, 1 / np.where(kept, values, 1.0), 0.0)[:, :, None] * rotated
    left = D - np.einsum("kia,kib->kab", rotated, weighted)
    # what is left of D after a cancellation to the last digit is rounding
    size = np.sqrt(np.abs(np.diagonal(D, axis1=1, axis2=2)))
    left[np.abs(left) < 1e-12 * size[:, :, None] * size[:, None, :]] = 0.0
    return (left + left.swapaxes(1, 2)) / 2


def _refused(found: np.ndarray, system: AbstractSystem, path: Trajectory, weights: np.ndarray) -> np.ndarray:
    """Raise InputError with the sensor and the step that have no derivative, or else say that numbers ran away."""
    n = path.x.shape[1]
    one = _local(system.model).along(np.empty(0), path.x[:-1])[1].reshape(path.steps, -1, n, n)
    with_derivatives(np.where(weights[:, :, None, None] > 0, one, 0.0), system, path)
    k = int(np.argwhere(~np.isfinite(found))[0, 0])
    raise InputError(f"the information is not finite at step {k} (t = {path.t[k]:g} s): the system is too unstable for this step")


@lru_cache(CACHED)
def _local(model: Model) -> Scan:
    x = model.x
    return Scan(ca.SX(0, 1), [x], ca.SX(0, 1), [dense_blocks(blocks_of(model, ca.SX.eye(x.numel())))])
