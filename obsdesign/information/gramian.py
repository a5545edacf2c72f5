"""Observability Gramians along a path: variational and empirical."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache, partial
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from obsdesign.arguments import validate_arguments
from obsdesign.calculus import wrap_columns
from obsdesign.checks import all_finite, as_array
from obsdesign.dynamics.model import AbstractSystem, Model
from obsdesign.dynamics.scan import Scan
from obsdesign.dynamics.simulation import held_along, readings, states_from, substeps_along
from obsdesign.dynamics.step import CACHED, blocks_of, dense_blocks, sensitivity_along, step_of
from obsdesign.errors import InputError
from obsdesign.information.blocks import Information, with_samples
from obsdesign.information.correlated_noise import colour_of, require_coloured
from obsdesign.information.correlated_samples import Samples
from obsdesign.information.provenance import origin_of
from obsdesign.information.sample_information import sampled_only, samples_of, with_derivatives
from obsdesign.information.whitening import seen_of
from obsdesign.trajectory import Trajectory

_HALVED = 15  # change of an integral of order 4 when its pieces are halved, over what is left of its error
_PIECES = 1024  # of one step, at most


class _Pace(NamedTuple):
    """Length of a step [s], and of how many sub-steps it is made."""

    step: float
    substeps: int


# (x (N, n), (u, w) (N, m + p), pace, weighted) -> (N, S, n, n), the information of one sample of each sensor at each step
_Sampler = Callable[[np.ndarray, np.ndarray, _Pace, bool], np.ndarray]


@validate_arguments
def variational_gramian(system: AbstractSystem, path: Trajectory, weighted: bool = True) -> Information:
    """Return what the samples along a path say about its initial state, from derivatives along the path.

    W = sum_k sum_s Phi_k' C_sk' R_s^-1 C_sk Phi_k over the samples of each sensor, with Phi_{k+1} = F_k Phi_k, Phi_0 = I.
    F is taken at the inputs that moved the path, `path.w` among them, all as if known: `posterior_information` is for those
    that are not. This is Fisher information about x(t_0), inv(W) the Cramer-Rao bound.

    Arguments:
        system: vehicle and sensors.
        path: the path along which samples are taken.
        weighted: False = the integral of Phi'C'C Phi dt over each step (Simpson's rule on half steps, order 4), whatever the sensors'
            rates.
    Raises InputError for paths that do not fit the system and for a path through a landmark.
    """
    require_fit(system, path)
    if weighted:
        if colour_of(system.model) is not None:
            return _coloured_gramian(system, path)
        Phi, blocks = _sensitivities(system, path.x[:-1], held_along(system, path), _pace_of(system, path), True)
        blocks, end = sampled_only(blocks, system, path.step), Phi[-1]
    else:
        blocks, end = _integrated(system, path, partial(_sensitivity_samples, system)), transition_matrices(system, path)[-1]
    return with_samples(with_derivatives(blocks, system, path), system.model.sensor_names, end, None, origin_of(system, path, weighted))


def _coloured_gramian(system: AbstractSystem, path: Trajectory) -> Information:
    """The same with the samples of the sensors whose errors are not independent."""
    model, n = system.model, path.x.shape[1]
    pace, colour = _pace_of(system, path), require_coloured(model)
    shape = sensitivity_along(model, *pace)
    rows = [path.x[:-1], held_along(system, path)]
    run = _transported_rows(model, *pace).run(shape.start[None], rows, path.steps, carries=False)
    blocks = sampled_only(run.results[0].reshape(path.steps, -1, n, n), system, path.step)
    blocks = with_derivatives(blocks, system, path)
    seen = [values[0] for values in run.results[1:]]
    samples = samples_of(system, colour, seen[0].reshape(path.steps, colour.q, n), seen[1], seen[2], path.step)
    return with_samples(blocks, model.sensor_names, shape.full(run.carry)[-1], samples, origin_of(system, path))


@validate_arguments
def empirical_gramian(system: AbstractSystem, path: Trajectory, eps: ArrayLike = 1e-4, weighted: bool = True) -> Information:
    """Return the Gramian from simulated differences of outputs, without derivatives.

    W = 1/(4 eps^2) sum Y'R^-1 Y, Y = [y(x0 + eps e_i) - y(x0 - eps e_i)]_i; tends to the variational Gramian as eps^2.
    What moves the path beside its inputs u and w, x_k+1 - f(x_k, u_k, w_k) in logs, moves the perturbed paths too.
    `perturbation` tells whether an eps is neither so small that rounding shows nor so large that curvature does.

    Arguments:
        system: vehicle and sensors.
        path: the path about whose start W is.
        eps: perturbation in the unit of each state, > 0, one number or (n,).
        weighted: False = the integral without R, Brace and Morgansen eq. (3).
    Raises InputError as variational_gramian, and unless eps > 0.
    """
    require_fit(system, path)
    size = perturbation_of(system, eps)
    reference = variational_gramian(system, path, weighted)  # refuses a path through a landmark, which differences would not notice
    sampler = partial(_difference_samples, system, size)
    if weighted:
        blocks = sampled_only(sampler(path.x[:-1], held_along(system, path), _pace_of(system, path), True), system, path.step)
    else:
        blocks = _integrated(system, path, sampler)
    samples = None if reference.samples is None else _difference_rows(system, size, path, reference.samples)
    origin = origin_of(system, path, weighted, differences=True)
    return with_samples(with_derivatives(blocks, system, path), system.model.sensor_names, reference.transition, samples, origin)


def _pace_of(system: AbstractSystem, path: Trajectory) -> _Pace:
    return _Pace(path.step, substeps_along(system, path))


def require_fit(system: AbstractSystem, path: Trajectory) -> None:
    """Raise InputError unless the path has this system's states and inputs, known and unknown, and the system has sensors."""
    model = system.model
    if path.x.shape[1] != len(model.states) or path.u.shape[1] != len(model.inputs):
        raise InputError(
            f"path has {path.x.shape[1]} states and {path.u.shape[1]} inputs: the system has"
            f" {len(model.states)} ({', '.join(model.state_names)}) and {len(model.inputs)} ({', '.join(model.input_names)})"
        )
    if path.w is not None and path.w.shape[1] != len(model.unknown_inputs):
        names = ", ".join(signal.name for signal in model.unknown_inputs) or "none"
        raise InputError(f"path has {path.w.shape[1]} unknown inputs: the system has {len(model.unknown_inputs)} ({names})")
    require_sensors(system)


def require_sensors(system: AbstractSystem) -> None:
    """Raise InputError for a system without sensors."""
    if not system.model.channels:
        raise InputError("the system has no sensors: there is no information along any path")


def transition_matrices(system: AbstractSystem, path: Trajectory) -> np.ndarray:
    """Return Phi (N+1, n, n): Phi[k] = dx(t_k)/dx(t_0) along the path."""
    pace = _pace_of(system, path)
    shape = sensitivity_along(system.model, *pace)
    later = _transition(system.model, *pace).along(shape.start, path.x[:-1], held_along(system, path))[0]
    if not all_finite(later):
        k = int(np.argwhere(~np.isfinite(later))[0, 0])
        raise InputError(f"dx(t_k)/dx(t_0) is not finite from step {k + 1} (t = {path.t[k + 1]:g} s) on: the system is too unstable")
    return shape.full(np.vstack([shape.start, later]))


@lru_cache(CACHED)
def _transition(model: Model, step: float, substeps: int) -> Scan:
    """Phi -> F(x, u, w) Phi, without the blocks."""
    one, shape = step_of(model, step, substeps), sensitivity_along(model, step, substeps)
    return Scan(shape.free, [one.x, one.held], shape.next)


@lru_cache(CACHED)
def transported(model: Model, step: float, weighted: bool, substeps: int = 1) -> Scan:
    """Phi -> F(x, u, w) Phi, with the blocks (S n n,) of a sample at x."""
    one, shape = step_of(model, step, substeps), sensitivity_along(model, step, substeps)
    return Scan(shape.free, [one.x, one.held], shape.next, [dense_blocks(blocks_of(model, shape.Phi, weighted))])


@lru_cache(CACHED)
def _transported_rows(model: Model, step: float, substeps: int) -> Scan:
    """The same with the rows (q n), level (q,) and gate (q,) of the outputs whose errors are not independent."""
    one, shape = step_of(model, step, substeps), sensitivity_along(model, step, substeps)
    seen = seen_of(model, require_coloured(model), shape.Phi)
    results = [dense_blocks(blocks_of(model, shape.Phi)), ca.vec(ca.densify(seen.rows).T), seen.level, seen.gate]
    return Scan(shape.free, [one.x, one.held], shape.next, results)


def _sensitivities(system: AbstractSystem, x: np.ndarray, held: np.ndarray, pace: _Pace, weighted: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return Phi (1, n, n) after the last step, and blocks (N, S, n, n)."""
    shape, n = sensitivity_along(system.model, *pace), x.shape[1]
    run = transported(system.model, pace.step, weighted, pace.substeps).run(shape.start[None], [x, held], len(x), carries=False)
    return shape.full(run.carry), run.results[0].reshape(len(x), -1, n, n)


def _sensitivity_samples(system: AbstractSystem, x: np.ndarray, held: np.ndarray, pace: _Pace, weighted: bool) -> np.ndarray:
    return _sensitivities(system, x, held, pace, weighted)[1]


def perturbation_of(system: AbstractSystem, eps: ArrayLike) -> np.ndarray:
    """Return eps (n,) for each state; raise InputError unless it is one number above 0, or one for each state."""
    names = system.model.state_names
    size = as_array("eps", eps)
    if size.shape not in {(), (len(names),)}:
        raise InputError(f"eps has shape {size.shape}: must be one number or ({len(names)},) for {', '.join(names)}")
    each = np.broadcast_to(size, (len(names),))
    for name, value in zip(names, each, strict=True):
        if not (np.isfinite(value) and value > 0):
            what = "eps" if size.shape == () else f"eps of {name}"
            raise InputError(f"{what} is {float(value)!r}: must be a finite number above 0")
    return each


def _difference_samples(
    system: AbstractSystem, eps: np.ndarray, x: np.ndarray, held: np.ndarray, pace: _Pace, weighted: bool
) -> np.ndarray:
    """Central differences over 2 n paths; the weights are those of the path itself."""
    model, Y = system.model, _differences(system, eps, x, held, pace)
    if weighted:
        along = readings(system, x[None])
        Y *= np.sqrt(along.gate[0] / along.variance[0])
    owner = np.array(model.output_owner)
    each = [np.einsum("ikq,jkq->kij", Y[..., owner == s], Y[..., owner == s]) for s in range(len(model.channels))]
    return np.stack(each, axis=1)


def _differences(system: AbstractSystem, eps: np.ndarray, x: np.ndarray, held: np.ndarray, pace: _Pace) -> np.ndarray:
    """Return dy/dx(t_0) (n, N, q) as differences over 2 n paths."""
    n, (u, w) = x.shape[1], _apart(system, held)
    starts = x[0] + np.concatenate([np.diag(eps), -np.diag(eps)])
    states = states_from(system, starts, u, pace.step, w, defects(system, x, held, *pace), substeps=pace.substeps)[:, :-1]
    y = readings(system, states).y
    angles = np.array([signal.is_angle for signal in system.model.outputs])
    return wrap_columns(y[:n] - y[n:], angles) / (2 * eps[:, None, None])


def _difference_rows(system: AbstractSystem, eps: np.ndarray, path: Trajectory, exact: Samples) -> Samples:
    """The samples of coloured outputs with differences for derivatives."""
    Y = _differences(system, eps, path.x[:-1], held_along(system, path), _pace_of(system, path))
    kept = [j for s in exact.colour.places for j, owner in enumerate(system.model.output_owner) if owner == s]
    return replace(exact, rows=np.moveaxis(Y[..., kept], 0, 2) * exact.level[..., None])


def defects(system: AbstractSystem, x: np.ndarray, held: np.ndarray, step: float, substeps: int = 1) -> np.ndarray:
    """Return x_k+1 - f(x_k, u_k, w_k) (N, n) along states x (N, n), the last 0: what the model does not say of a path not simulated."""
    reached = _one_step(system, x, held, step, substeps)
    return np.vstack([x[1:] - reached[:-1], np.zeros((1, x.shape[1]))])


def _integrated(system: AbstractSystem, path: Trajectory, sampler: _Sampler) -> np.ndarray:
    """Simpson's rule over equal pieces of each step, as many as it takes for the path's tolerance: halves of them change less."""
    pieces = substeps_along(system, path)
    found = _simpson(system, path, sampler, pieces)
    while True:
        finer = _simpson(system, path, sampler, 2 * pieces)
        sums = [values.sum(axis=0) for values in (found, finer)]
        size = np.sqrt(np.maximum(np.diagonal(sums[1], axis1=1, axis2=2), 0.0))
        difference = np.abs(sums[1] - sums[0]) / _HALVED
        # what is not finite is refused by whoever asked
        if not np.any(difference > path.tolerance * size[:, :, None] * size[:, None]) or pieces >= _PIECES:
            return found
        pieces, found = 2 * pieces, finer


def _simpson(system: AbstractSystem, path: Trajectory, sampler: _Sampler, pieces: int) -> np.ndarray:
    """Return the integral over each step (N, S, n, n), on the values at start, middle and end of each piece."""
    held, half = held_along(system, path), _Pace(path.step / (2 * pieces), min(pieces, 2))
    inside = np.empty((path.steps, 2 * pieces, path.x.shape[1]))
    inside[:, 0] = path.x[:-1]
    for j in range(1, 2 * pieces):
        inside[:, j] = _one_step(system, inside[:, j - 1], held, *half)
    fine = np.vstack([inside.reshape(-1, path.x.shape[1]), path.x[-1:]])
    values = sampler(fine, np.vstack([np.repeat(held, 2 * pieces, axis=0), held[-1:]]), half, False)
    each = (values[:-2:2] + 4 * values[1::2] + values[2::2]) * half.step / 3
    return each.reshape(path.steps, pieces, *each.shape[1:]).sum(axis=1) if pieces > 1 else each


def _one_step(system: AbstractSystem, x: np.ndarray, held: np.ndarray, step: float, substeps: int) -> np.ndarray:
    """Return where each of the states x (N, n) gets to in one step under its own row of inputs."""
    u, w = _apart(system, held[:, None])
    return states_from(system, x, u, step, w, substeps=substeps)[:, 1]


def _apart(system: AbstractSystem, held: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return u (..., m) and w (..., p) of (u, w) (..., m + p)."""
    m = len(system.model.inputs)
    return held[..., :m], held[..., m:]
