"""Observability Gramians along a path: variational and empirical."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from obsdesign.calculus import wrap_columns
from obsdesign.checks import require_positive
from obsdesign.compile import advanced_along, output, transported_along
from obsdesign.errors import InputError
from obsdesign.information.record import Information
from obsdesign.information.sampling import sampled, with_derivatives
from obsdesign.model import AbstractSystem
from obsdesign.trajectory import Trajectory

# (x (N, n), u (N, m), step, weighted) -> (N, S, n, n), the information of one sample of each sensor at each step
_Sampler = Callable[[np.ndarray, np.ndarray, float, bool], np.ndarray]


def variational_gramian(system: AbstractSystem, path: Trajectory, weighted: bool = True) -> Information:
    """W = sum_k sum_s Phi_k' C_sk' R_s^-1 C_sk Phi_k over the samples of each sensor, with Phi_{k+1} = F_k Phi_k, Phi_0 = I.

    This is Fisher information about x(t_0), inv(W) the Cramer-Rao bound. weighted=False: the integral of Phi'C'C Phi dt
    over each step (Simpson's rule on half steps, order 4), whatever the sensors' rates.
    Raises InputError for paths that do not fit the system and for a path through a landmark.
    """
    return _gramian(system, path, weighted, partial(_sensitivity_samples, system))


def empirical_gramian(system: AbstractSystem, path: Trajectory, eps: float = 1e-4, weighted: bool = True) -> Information:
    """W = 1/(4 eps^2) sum Y'R^-1 Y, Y = [y(x0 + eps e_i) - y(x0 - eps e_i)]_i; tends to the variational Gramian as eps^2.

    eps: in the unit of each state. weighted=False: the integral without R, Brace and Morgansen eq. (3).
    Raises InputError as variational_gramian, and for eps <= 0.
    """
    require_positive("eps", eps)
    variational_gramian(system, path, weighted)  # refuses a path through a landmark, which differences would not notice
    return _gramian(system, path, weighted, partial(_difference_samples, system, eps))


def require_fit(system: AbstractSystem, path: Trajectory) -> None:
    """Raise InputError unless the path has this system's states and inputs, and the system has sensors."""
    model = system.model
    if path.x.shape[1] != len(model.states) or path.u.shape[1] != len(model.inputs):
        raise InputError(
            f"path has {path.x.shape[1]} states and {path.u.shape[1]} inputs: the system has"
            f" {len(model.states)} ({', '.join(model.state_names)}) and {len(model.inputs)} ({', '.join(model.input_names)})"
        )
    if not model.channels:
        raise InputError("the system has no sensors: there is no information along any path")


def transition_matrices(system: AbstractSystem, path: Trajectory) -> np.ndarray:
    """Return Phi (N+1, n, n): Phi[k] = dx(t_k)/dx(t_0) along the path."""
    n = path.x.shape[1]
    products = transported_along(system, path.step, path.steps)(np.eye(n), path.x[:-1].T, path.u.T)[0]
    later = products.full().reshape(n, path.steps, n).transpose(1, 0, 2)
    return np.concatenate([np.eye(n)[None], later])


def _gramian(system: AbstractSystem, path: Trajectory, weighted: bool, sampler: _Sampler) -> Information:
    require_fit(system, path)
    if weighted:
        mask = sampled(system, path.steps, path.step)
        blocks = np.where(mask[:, :, None, None], sampler(path.x[:-1], path.u, path.step, True), 0.0)
    else:
        blocks = _integrated(system, path, sampler)
    return Information(with_derivatives(blocks, system, path), system.model.sensor_names)


def _sensitivity_samples(system: AbstractSystem, x: np.ndarray, u: np.ndarray, step: float, weighted: bool) -> np.ndarray:
    n, steps = x.shape[1], len(u)
    blocks = transported_along(system, step, steps, weighted)(np.eye(n), x.T, u.T)[1]
    return blocks.full().reshape(n, steps, -1, n).transpose(1, 2, 0, 3)


def _difference_samples(system: AbstractSystem, eps: float, x: np.ndarray, u: np.ndarray, step: float, weighted: bool) -> np.ndarray:
    model = system.model
    is_angle = np.array([signal.is_angle for signal in model.outputs])
    owner = np.array(model.output_owner)
    plus, minus = (_outputs_from(system, x[0], u, step, side * eps) for side in (1, -1))
    Y = wrap_columns(plus - minus, is_angle) / (2 * eps)  # (n, N, q)
    if weighted:
        Y = Y / np.array(model.sigmas)
    each = [np.einsum("ikq,jkq->kij", Y[..., owner == s], Y[..., owner == s]) for s in range(len(model.channels))]
    return np.stack(each, axis=1)


def _outputs_from(system: AbstractSystem, x0: np.ndarray, u: np.ndarray, step: float, eps: float) -> np.ndarray:
    """y (n, N, q) along the n paths that start at x0 + eps e_i."""
    n, steps = len(x0), len(u)
    no_disturbance = np.zeros((len(system.model.unknown_inputs), steps))
    walk, read = advanced_along(system, step, steps), output(system).map(steps)
    outputs = []
    for start in x0 + eps * np.eye(n):
        states = np.vstack([start, walk(start, u.T, no_disturbance).full().T])[:-1]
        outputs.append(read(states.T)[0].full().T)
    return np.array(outputs)


def _integrated(system: AbstractSystem, path: Trajectory, sampler: _Sampler) -> np.ndarray:
    """Simpson's rule over each step on the values at its start, middle and end."""
    half = path.step / 2
    u = np.repeat(path.u, 2, axis=0)
    no_disturbance = np.zeros((len(system.model.unknown_inputs), len(u)))
    fine = np.vstack([path.x[0], advanced_along(system, half, len(u))(path.x[0], u.T, no_disturbance).full().T])
    values = sampler(fine, np.vstack([u, u[-1:]]), half, False)
    return (values[:-2:2] + 4 * values[1::2] + values[2::2]) * half / 3
