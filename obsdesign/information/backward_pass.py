"""What later samples say about a state and about the inputs in between: from the last step back to the first."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from obsdesign.dynamics.model import AbstractSystem, Model
from obsdesign.dynamics.nuisance_states import nuisance_of
from obsdesign.dynamics.scan import Scan
from obsdesign.dynamics.simulation import held_along, substeps_along
from obsdesign.dynamics.step import CACHED, step_of
from obsdesign.errors import InputError
from obsdesign.information.information_update import Disturbance, Root, shaken
from obsdesign.information.nuisance_information import drawn_before
from obsdesign.information.sample_information import require_derivatives
from obsdesign.packing import packed, symmetric
from obsdesign.trajectory import Trajectory

_CLOSED = 1e-300  # so that the root of a gate has a derivative where it is closed
_TOLD_APART = 1e-12  # smallest eigenvalue, at unit diagonal, of what the outputs say about constant inputs


def sample_rows(model: Model, weights: ca.SX) -> ca.SX:
    """(g / R)^1/2 C (q, n) of those sensors whose weight (S, 1) is not 0, about the state of that instant."""
    rows = []
    for s, channel in enumerate(model.channels):
        root = ca.sqrt(channel.noise.gate / channel.noise.variance + _CLOSED)
        C = ca.jacobian(channel.h, model.x)
        # not a product: where a sensor that is off has no derivative, nothing is lost
        seen = root * C if root.numel() == 1 else ca.diag(root) @ C  # one number for all outputs but in joint noise
        rows.append(ca.if_else(weights[s], seen, ca.SX(*C.shape)))
    return ca.vertcat(*rows)


@lru_cache(CACHED)
def _backward(model: Model, step: float, disturbance: Disturbance, substeps: int) -> Scan:
    """(root of what later samples say about x_k+1, the square of it if all inputs were known) -> the same about x_k.

    Results: L [F B] (n, n + p), L the root before the noise of that step, about (x_k, w_k); and B'L'L B if all were known.
    """
    one = step_of(model, step, substeps)
    n, weights = len(model.states), ca.SX.sym("active", len(model.channels))
    L, rounding, (alone, second) = ca.SX.sym("L", n, n), ca.SX.sym("rounding", n), symmetric("alone", n)
    B, samples = one.B_w[:, list(disturbance.unknown)], sample_rows(model, weights)
    noisy = shaken(Root(L, rounding), one.B_w, Disturbance((), disturbance.noise))
    left = shaken(noisy, one.B_w, Disturbance(disturbance.unknown, ((),) * n))
    earlier = left.carried(one.F).with_rows(samples)
    square = packed(one.F.T @ alone @ one.F + samples.T @ samples)
    carry_next = ca.vertcat(ca.vec(ca.densify(earlier.T)), earlier.rounding, square)
    results = [ca.vec(ca.densify(noisy.T @ ca.horzcat(one.F, B))), ca.vec(ca.densify(B.T @ alone @ B))]
    return Scan(ca.vertcat(ca.vec(L), rounding, second), [one.x, one.held, weights], carry_next, results)


def backwards(system: AbstractSystem, path: Trajectory, disturbance: Disturbance, weights: np.ndarray) -> np.ndarray:
    """Return (N, n, n + p), roots of what later samples say about (x_k, w_k); raise InputError for inputs that leave no trace."""
    n, p = path.x.shape[1], len(disturbance.unknown)
    scan = _backward(system.model, path.step, disturbance, substeps_along(system, path))
    start = np.zeros((1, n * n + n + n * (n + 1) // 2))
    rows = [values[::-1] for values in (path.x[:-1], held_along(system, path), weights)]
    run = scan.run(start, rows, path.steps, carries=False)
    later, alone = run.results[0][0, ::-1], run.results[1][0]
    if not np.isfinite(later).all():
        refuse(later, system, path, weights)
    _require_trace(system, disturbance, alone.reshape(-1, p, p).sum(axis=0))
    return later.reshape(-1, n + p, n).swapaxes(1, 2)


@lru_cache(CACHED)
def _backward_lasting(model: Model, step: float, disturbance: Disturbance, substeps: int) -> Scan:
    """The same where errors last, about (b, x_k+1, z_k): z before it moves on, for samples are exact about the two together after.

    Result: L [F 0 B] about (b, x_k, z_k, w_k).
    """
    one, nuisance, n = step_of(model, step, substeps), nuisance_of(model, step), len(model.states)
    a, c = len(nuisance.coloured), len(nuisance.constant)
    size, weights = a + c + n, ca.SX.sym("active", len(model.channels))
    L, rounding = ca.SX.sym("L", size, size), ca.SX.sym("rounding", size)
    B = ca.vertcat(ca.SX(c, one.B_w.shape[1]), one.B_w, ca.SX(a, one.B_w.shape[1]))
    still = ((0.0,) * disturbance.L.shape[1],)
    noisy = shaken(Root(L, rounding), B, Disturbance((), still * c + disturbance.noise + still * a))
    left = shaken(noisy, B, Disturbance(disturbance.unknown, ((),) * size))
    F = ca.diagcat(ca.SX.eye(c), one.F, ca.SX.eye(a))
    rows, back, kicks = drawn_before(model, nuisance, weights)
    now = left.carried(F).blurred(kicks).carried(back).with_rows(rows)
    results = [ca.vec(ca.densify(noisy.T @ ca.horzcat(F, B[:, list(disturbance.unknown)])))]
    return Scan(ca.vertcat(ca.vec(L), rounding), [one.x, one.held, weights], ca.vertcat(ca.vec(ca.densify(now.T)), now.rounding), results)


def backwards_lasting(system: AbstractSystem, path: Trajectory, disturbance: Disturbance, weights: np.ndarray) -> np.ndarray:
    """Return roots (N, s, s + p) of what the samples after t_k say about (b, x_k, z_k, w_k), s = c + n + a, where errors last."""
    size, p = path.x.shape[1] + nuisance_of(system.model, path.step).size, len(disturbance.unknown)
    rows = [values[::-1] for values in (path.x[:-1], held_along(system, path), weights)]
    scan = _backward_lasting(system.model, path.step, disturbance, substeps_along(system, path))
    later = scan.run(np.zeros((1, size * size + size)), rows, path.steps, carries=False).results[0][0, ::-1]
    if not np.isfinite(later).all():
        refuse(later, system, path, weights)
    return later.reshape(-1, size + p, size).swapaxes(1, 2)


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


def refuse(found: np.ndarray, system: AbstractSystem, path: Trajectory, weights: np.ndarray) -> None:
    """Raise InputError with the sensor and the step that have no derivative, or else say that numbers ran away."""
    require_derivatives(system, path, weights > 0)
    k = int(np.argwhere(~np.isfinite(found))[0, 0])
    raise InputError(f"the information is not finite at step {k} (t = {path.t[k]:g} s): the system is too unstable for this step")
