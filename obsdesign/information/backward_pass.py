"""What later samples say about a state and about the inputs in between: from the last step back to the first."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from obsdesign.dynamics.driven_step import driven_step
from obsdesign.dynamics.model import AbstractSystem, Model
from obsdesign.dynamics.nuisance_states import nuisance_of
from obsdesign.dynamics.scan import Scan
from obsdesign.dynamics.simulation import all_inputs_along, substeps_along
from obsdesign.dynamics.step import CACHE_SIZE, looped_step
from obsdesign.errors import InputError
from obsdesign.information.information_update import Disturbance, InformationRoot, predict_back
from obsdesign.information.nuisance_information import samples_given_previous
from obsdesign.information.sample_information import require_derivatives
from obsdesign.packing import pack, symmetric
from obsdesign.trajectory import Trajectory

_CLOSED_GATE = 1e-300  # so that the root of a gate has a derivative where it is closed
_MIN_EIGENVALUE = 1e-12  # smallest eigenvalue, at unit diagonal, of what the outputs say about constant inputs


def rows_of_samples(model: Model, weights: ca.SX) -> ca.SX:
    """(a g / R)^1/2 C (q, n) of the sensors whose weight a (S, 1), how often a sample counts, is not 0, about the state of that instant."""
    rows = []
    for s, channel in enumerate(model.channels):
        root = ca.sqrt(channel.noise.gate / channel.noise.variance + _CLOSED_GATE)
        C = ca.jacobian(channel.h, model.x)
        # not a product: where a sensor that is off has no derivative, nothing is lost
        root = root * ca.sqrt(weights[s])
        weighted_rows = root * C if root.numel() == 1 else ca.diag(root) @ C  # one number for all outputs but in joint noise
        rows.append(ca.if_else(weights[s], weighted_rows, ca.SX(*C.shape)))
    return ca.vertcat(*rows)


@lru_cache(CACHE_SIZE)
def _backward_scan(model: Model, step: float, disturbance: Disturbance, substeps: int) -> Scan:
    """Root of what later samples say about x_k+1 -> the same about x_k.

    Result: L [F B] (n, n + p), L the root before the noise of that step, about (x_k, w_k).
    """
    driven = driven_step(model, step, substeps, disturbance.noise)
    step_graph, n, weights = driven.step, len(model.states), ca.SX.sym("active", len(model.channels))
    L, rounding = ca.SX.sym("L", n, n), ca.SX.sym("rounding", n)
    B, samples = step_graph.B_w[:, list(disturbance.unknown)], rows_of_samples(model, weights)
    after_noise = InformationRoot(L, rounding, ca.SX(0, L.shape[1])).add_noise(driven.noise)
    earlier = predict_back(after_noise, step_graph.F, B).with_rows(samples)
    results = [ca.vec(ca.densify(after_noise.T @ ca.horzcat(step_graph.F, B)))]
    carry_next = ca.vertcat(ca.vec(ca.densify(earlier.T)), earlier.rounding)
    carry = ca.vertcat(ca.vec(L), rounding)
    return Scan(carry, [step_graph.x, step_graph.all_inputs, weights], carry_next, results, loop=step_graph.loop)


@lru_cache(CACHE_SIZE)
def _trace_scan(model: Model, step: float, unknown: tuple[int, ...], substeps: int) -> Scan:
    """What later samples say about x_k+1 if all inputs were known, packed -> the same about x_k; result: the same about w_k."""
    step_graph, n, weights = looped_step(model, step, substeps), len(model.states), ca.SX.sym("active", len(model.channels))
    B, samples, (W, entries) = step_graph.B_w[:, list(unknown)], rows_of_samples(model, weights), symmetric("W", n)
    earlier = pack(step_graph.F.T @ W @ step_graph.F + samples.T @ samples)
    results = [ca.vec(ca.densify(B.T @ W @ B))]
    return Scan(entries, [step_graph.x, step_graph.all_inputs, weights], earlier, results, loop=step_graph.loop)


def require_trace(system: AbstractSystem, path: Trajectory, disturbance: Disturbance, weights: np.ndarray) -> None:
    """Raise InputError where the samples do not tell of a constant combination of the unknown inputs, or are not finite."""
    n, p = path.x.shape[1], len(disturbance.unknown)
    scan = _trace_scan(system.model, path.pace, disturbance.unknown, substeps_along(system, path))
    rows = [values[::-1] for values in (path.x[:-1], all_inputs_along(system, path), weights)]
    input_information = scan.run(np.zeros((1, n * (n + 1) // 2)), rows, path.steps, carries=False).results[0][0]
    if not np.isfinite(input_information).all():
        require_derivatives(system, path, weights > 0)
        return  # so much is told that no double holds it
    _require_trace(system, disturbance, input_information.reshape(-1, p, p).sum(axis=0))


def backward_roots(system: AbstractSystem, path: Trajectory, disturbance: Disturbance, weights: np.ndarray) -> np.ndarray:
    """Return (N, n, n + p), roots of what later samples say about (x_k, w_k); raise InputError for inputs that leave no trace."""
    n, p = path.x.shape[1], len(disturbance.unknown)
    scan = _backward_scan(system.model, path.pace, disturbance, substeps_along(system, path))
    require_trace(system, path, disturbance, weights)
    rows = [values[::-1] for values in (path.x[:-1], all_inputs_along(system, path), weights)]
    run = scan.run(np.zeros((1, n * n + n)), rows, path.steps, carries=False)
    roots = run.results[0][0, ::-1]
    if not np.isfinite(roots).all():
        raise_not_finite(roots, system, path, weights)
    return roots.reshape(-1, n + p, n).swapaxes(1, 2)


@lru_cache(CACHE_SIZE)
def _backward_nuisance_scan(model: Model, step: float, disturbance: Disturbance, substeps: int) -> Scan:
    """The same where errors last, about (b, x_k+1, z_k): z before it moves on, for samples are exact about the two together after.

    Result: L [F 0 B] about (b, x_k, z_k, w_k).
    """
    driven, nuisance, n = driven_step(model, step, substeps, disturbance.noise), nuisance_of(model, step), len(model.states)
    step_graph, a, c = driven.step, len(nuisance.coloured), len(nuisance.constant)
    size, weights = a + c + n, ca.SX.sym("active", len(model.channels))
    L, rounding = ca.SX.sym("L", size, size), ca.SX.sym("rounding", size)
    B = ca.vertcat(ca.SX(c, step_graph.B_w.shape[1]), step_graph.B_w, ca.SX(a, step_graph.B_w.shape[1]))
    r = driven.noise.shape[1]
    after_noise = InformationRoot(L, rounding, ca.SX(0, L.shape[1])).add_noise(ca.vertcat(ca.SX(c, r), driven.noise, ca.SX(a, r)))
    F, B = ca.diagcat(ca.SX.eye(c), step_graph.F, ca.SX.eye(a)), B[:, list(disturbance.unknown)]
    rows, transition, error_noise = samples_given_previous(model, nuisance, weights)
    earlier = predict_back(after_noise, F, B).add_noise(error_noise).transform(transition).with_rows(rows)
    results = [ca.vec(ca.densify(after_noise.T @ ca.horzcat(F, B)))]
    return Scan(
        ca.vertcat(ca.vec(L), rounding),
        [step_graph.x, step_graph.all_inputs, weights],
        ca.vertcat(ca.vec(ca.densify(earlier.T)), earlier.rounding),
        results,
        loop=step_graph.loop,
    )


def backward_roots_with_nuisance(system: AbstractSystem, path: Trajectory, disturbance: Disturbance, weights: np.ndarray) -> np.ndarray:
    """Return roots (N, s, s + p) of what the samples after t_k say about (b, x_k, z_k, w_k), s = c + n + a, where errors last."""
    size, p = path.x.shape[1] + nuisance_of(system.model, path.pace).size, len(disturbance.unknown)
    rows = [values[::-1] for values in (path.x[:-1], all_inputs_along(system, path), weights)]
    scan = _backward_nuisance_scan(system.model, path.pace, disturbance, substeps_along(system, path))
    roots = scan.run(np.zeros((1, size * size + size)), rows, path.steps, carries=False).results[0][0, ::-1]
    if not np.isfinite(roots).all():
        raise_not_finite(roots, system, path, weights)
    return roots.reshape(-1, size + p, size).swapaxes(1, 2)


def _require_trace(system: AbstractSystem, disturbance: Disturbance, input_information: np.ndarray) -> None:
    """Raise InputError where `input_information` (p, p), what the outputs say about constant unknown inputs, is blind to a combination."""
    names = [system.model.unknown_inputs[i].name for i in disturbance.unknown]
    root_diagonal = np.sqrt(np.diag(input_information))
    for name, value in zip(names, root_diagonal, strict=True):
        if not value > 0:
            raise InputError(f"unknown_inputs: {name!r} leaves no trace in any output along this path")
    values, vectors = np.linalg.eigh(input_information / np.outer(root_diagonal, root_diagonal))
    if values[0] < _MIN_EIGENVALUE:
        combination = vectors[:, 0] / root_diagonal
        combination = combination / combination[np.abs(combination).argmax()]
        words = " ".join(
            f"{coefficient:+.3g} {name}" for coefficient, name in zip(combination, names, strict=True) if abs(coefficient) > 1e-6
        )
        raise InputError(f"unknown_inputs cannot be told apart from the outputs along this path: {words} leaves no trace in any of them")


def raise_not_finite(values: np.ndarray, system: AbstractSystem, path: Trajectory, weights: np.ndarray) -> None:
    """Raise InputError with the sensor and the step that have no derivative, or else say that numbers ran away."""
    require_derivatives(system, path, weights > 0)
    k = int(np.argwhere(~np.isfinite(values))[0, 0])
    raise InputError(f"the information is not finite at step {k} (t = {path.t[k]:g} s): the system grows or decays too fast for this step")
