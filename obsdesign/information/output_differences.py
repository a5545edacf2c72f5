"""Observability Gramians along a path, from differences of simulated outputs."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.arguments import validate_arguments
from obsdesign.calculus import wrap_columns
from obsdesign.checks import as_array
from obsdesign.dynamics.model import AbstractSystem
from obsdesign.dynamics.per_step import system_along
from obsdesign.dynamics.simulation import all_inputs_along, readings, states_from
from obsdesign.errors import InputError
from obsdesign.information.blocks import Information, with_samples
from obsdesign.information.correlated_samples import CorrelatedSamples
from obsdesign.information.gramian import require_fit, variational_gramian
from obsdesign.information.provenance import origin_of
from obsdesign.information.sample_information import require_finite_blocks, zero_unsampled
from obsdesign.information.step_integral import StepSplit, integral_over_steps, one_step, split_inputs, step_split
from obsdesign.trajectory import Trajectory


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
    system = system_along(system, path)
    size = as_perturbation(system, eps)
    reference = variational_gramian(system, path, weighted)  # refuses a path through a landmark, which differences would not notice
    sampler = partial(_difference_samples, system, size)
    if weighted:
        blocks = zero_unsampled(sampler(path.x[:-1], all_inputs_along(system, path), step_split(system, path), True), system, path.pace)
    else:
        blocks = integral_over_steps(system, path, sampler)
    samples = None if reference.samples is None else _difference_rows(system, size, path, reference.samples)
    origin = origin_of(system, path, weighted, by_differences=True)
    return with_samples(require_finite_blocks(blocks, system, path), system.model.sensor_names, reference.transition, samples, origin)


def as_perturbation(system: AbstractSystem, eps: ArrayLike) -> np.ndarray:
    """Return eps (n,) for each state; raise InputError unless it is one number above 0, or one for each state."""
    names = system.model.state_names
    size = as_array("eps", eps)
    if size.shape not in {(), (len(names),)}:
        raise InputError(f"eps has shape {size.shape}: must be one number or ({len(names)},) for {', '.join(names)}")
    perturbation = np.broadcast_to(size, (len(names),))
    for name, value in zip(names, perturbation, strict=True):
        if not (np.isfinite(value) and value > 0):
            what = "eps" if size.shape == () else f"eps of {name}"
            raise InputError(f"{what} is {float(value)!r}: must be a finite number above 0")
    return perturbation


def _difference_samples(
    system: AbstractSystem, eps: np.ndarray, x: np.ndarray, all_inputs: np.ndarray, split: StepSplit, weighted: bool
) -> np.ndarray:
    """Central differences over 2 n paths; the weights are those of the path itself."""
    model, Y = system.model, _differences(system, eps, x, all_inputs, split)
    if weighted:
        path_readings = readings(system, x[None], all_inputs[:, : len(model.inputs)])
        Y *= np.sqrt(path_readings.gate[0] / path_readings.variance[0])
    owner = np.array(model.output_owner)
    blocks = [np.einsum("ikq,jkq->kij", Y[..., owner == s], Y[..., owner == s]) for s in range(len(model.channels))]
    return np.stack(blocks, axis=1)


def _differences(system: AbstractSystem, eps: np.ndarray, x: np.ndarray, all_inputs: np.ndarray, split: StepSplit) -> np.ndarray:
    """Return dy/dx(t_0) (n, N, q) as differences over 2 n paths."""
    n, (u, w) = x.shape[1], split_inputs(system, all_inputs)
    starts = x[0] + np.concatenate([np.diag(eps), -np.diag(eps)])
    states = states_from(system, starts, u, split.step, w, _defects(system, x, all_inputs, *split), substeps=split.substeps)[:, :-1]
    y = readings(system, states, u).y
    angles = np.array([signal.is_angle for signal in system.model.outputs])
    return wrap_columns(y[:n] - y[n:], angles) / (2 * eps[:, None, None])


def _difference_rows(system: AbstractSystem, eps: np.ndarray, path: Trajectory, samples: CorrelatedSamples) -> CorrelatedSamples:
    """The samples of coloured outputs with differences for derivatives."""
    Y = _differences(system, eps, path.x[:-1], all_inputs_along(system, path), step_split(system, path))
    coloured_outputs = [j for s in samples.colour.sensor_indices for j, owner in enumerate(system.model.output_owner) if owner == s]
    return replace(samples, rows=np.moveaxis(Y[..., coloured_outputs], 0, 2) * samples.level[..., None])


def _defects(system: AbstractSystem, x: np.ndarray, all_inputs: np.ndarray, step: float, substeps: int = 1) -> np.ndarray:
    """Return x_k+1 - f(x_k, u_k, w_k) (N, n) along states x (N, n), the last 0: what the model does not say of a path not simulated."""
    simulated = one_step(system, x, all_inputs, step, substeps)
    return np.vstack([x[1:] - simulated[:-1], np.zeros((1, x.shape[1]))])
