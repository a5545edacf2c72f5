"""The posterior Cramer-Rao recursion: what can be known of x(t_k) with process noise and unknown inputs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from obsdesign.arguments import validate_arguments
from obsdesign.checks import as_array, require_known
from obsdesign.dynamics.model import AbstractSystem
from obsdesign.dynamics.nuisance_states import nuisance_of
from obsdesign.dynamics.per_step import system_along
from obsdesign.dynamics.process_noise import noise_of
from obsdesign.dynamics.simulation import all_inputs_along, substeps_along
from obsdesign.errors import InputError
from obsdesign.information.backward_pass import (
    backward_roots,
    backward_roots_with_nuisance,
    raise_not_finite,
    require_trace,
)
from obsdesign.information.gramian import require_fit
from obsdesign.information.information_update import Disturbance
from obsdesign.information.recorded_samples import recorded_samples
from obsdesign.information.root_recursion import error_rows_of, forward_scan, initial_carry_of, posterior_roots
from obsdesign.information.sample_information import sampling_mask
from obsdesign.logs.log import Log
from obsdesign.noise_density import DisturbancePsd, InputPsd
from obsdesign.prior import Prior
from obsdesign.trajectory import Trajectory

_ROUND_OFF_SHARE = 1e-12  # share of a row's size below which what is left of it is rounding


@validate_arguments
def posterior_information(
    system: AbstractSystem,
    path: Trajectory,
    prior: Prior,
    disturbance_psd: DisturbancePsd = None,
    unknown_inputs: Sequence[str] = (),
    active: np.ndarray | None = None,
    *,
    input_psd: InputPsd = None,
    samples: Log | None = None,
) -> np.ndarray:
    """Return J (N+1, n, n), the information about x(t_k): J[k] includes the samples at t_k for k < N, J[N] is predicted.

    J+ = M - M B (B'M B + Q^-1)^# B'M + C'R^-1 C,  M = F^-T J F^-1,  J_0 = P_0^-1 + C'R^-1 C; for an unknown input Q^-1 = 0.
    F and B are taken at the inputs that moved the path, `path.w` among them; whoever estimates knows all but those named in
    unknown_inputs. Computed with square roots of J, so that what is lost to an unknown input is lost to the last digit.
    Errors of samples that are correlated, constant or joint are nuisance states, which are eliminated: J = (P_xx)^-1 of the filter
    that knows how they come about; see `ErrorDistribution`. A sensor that is off lets them go on.

    Arguments:
        system: vehicle and sensors.
        path: the path along which samples are taken.
        prior: what is known of x(t_0).
        disturbance_psd: power spectral density (n,) or (n, n) of the process noise [unit^2/s], Q = psd * step; None = none. Or a
            PerSpeed of it.
        unknown_inputs: names of the inputs of which nothing is known.
        active (N, S): bool, which sensors are on; None = all. A sample of one that is on counts with its gate's and its detection's share,
            as nobody knows yet whether it arrives: what did arrive is said by `samples`.
        input_psd: name of a known input -> power spectral density of its white noise [unit^2 s], or a PerSpeed of it: Q is then
            B psd step B' more, B the derivative of the step to the integral of that input. None = none.
        samples: a log, whose samples count that arrived, each at its own time; at t_k those up to then. With active, those of sensors
            that are on from t_k to t_k+1. None = those that the sensors' rates promise.
    Raises InputError for shapes that do not fit, unknown names, and unknown inputs of which a combination leaves no trace in
    any output. Source: Tichavsky, Muravchik, Nehorai (1998).
    """
    if samples is not None:
        psds = disturbance_psd, input_psd
        return _posterior_of_log(system, path, prior, psds, unknown_inputs, active=active, log=samples)
    disturbance = disturbance_of(system, path, prior, disturbance_psd, unknown_inputs, input_psd)
    system = system_along(system, path, active is not None, has_timed_errors=True)
    weights = weights_of(system, path, active)
    return information_along(system, path, prior, disturbance, weights)


def _posterior_of_log(
    system: AbstractSystem,
    path: Trajectory,
    prior: Prior,
    psds: tuple[DisturbancePsd, InputPsd],
    unknown_inputs: Sequence[str],
    *,
    active: np.ndarray | None,
    log: Log,
) -> np.ndarray:
    """The same from event to event, at the nodes of the path."""
    require_fit(system, path)
    arrived = recorded_samples(system, path, log, has_timed_errors=True)
    events, per_step = arrived.event_path, arrived.system
    weights = events.weights
    if active is not None:
        weights = weights * weights_of(per_step, path, active)[events.step]
    disturbance = disturbance_of(per_step, events.path, prior, psds[0], unknown_inputs, psds[1])
    return information_along(per_step, events.path, prior, disturbance, weights)[events.nodes]


def information_along(system: AbstractSystem, path: Trajectory, prior: Prior, disturbance: Disturbance, weights: np.ndarray) -> np.ndarray:
    """Return J (N+1, n, n) of samples that count as often as weights (N, S) say; raise InputError where it is not finite."""
    if disturbance.unknown:
        require_trace(system, path, disturbance, weights)
    roots = posterior_roots(system, path, prior, disturbance, weights)
    with np.errstate(over="ignore", invalid="ignore"):
        J = roots.swapaxes(1, 2) @ roots
    if not np.isfinite(J).all():
        raise_not_finite(J, system, path, weights)
    return J


@validate_arguments
def unknown_input_information(
    system: AbstractSystem,
    path: Trajectory,
    prior: Prior,
    disturbance_psd: DisturbancePsd = None,
    unknown_inputs: Sequence[str] = (),
    active: np.ndarray | None = None,
    *,
    input_psd: InputPsd = None,
) -> np.ndarray:
    """Return (N, p, p), the information about the unknown inputs w_k, held from t_k to t_k+1, of all samples along the path.

    In the order of the names given, in 1/unit^2 per step. With J_k what is known of x(t_k) then, and L_k+1 what later samples say about
    x(t_k+1) when later inputs are unknown too, J_w = B'L B - B'L F (J_k + F'L F)^# F'L B. Zero where w_k leaves no trace: the last inputs
    always.

    Arguments:
        system: vehicle and sensors.
        path: the path along which samples are taken.
        prior: what is known of x(t_0).
        disturbance_psd: power spectral density (n,) or (n, n) of the process noise [unit^2/s], or a PerSpeed of it; None = none.
        unknown_inputs: names of the p inputs of which nothing is known, at least one.
        active (N, S): bool, which sensors are on; None = all.
        input_psd: of known inputs, as for posterior_information.
    Raises InputError as posterior_information, and without unknown inputs.
    """
    if not unknown_inputs:
        raise InputError("unknown_inputs is empty: there is no input to know anything of")
    disturbance = disturbance_of(system, path, prior, disturbance_psd, unknown_inputs, input_psd)
    system = system_along(system, path, active is not None)
    weights = weights_of(system, path, active)
    # of the integral over a step where time is counted in steps
    square = 1.0 if path.is_even else path.lengths[:, None, None] ** 2
    if nuisance_of(system.model, path.pace).size:
        require_trace(system, path, disturbance, weights)
        return square * _marginal_information(*_rows_with_nuisance(system, path, prior, disturbance, weights))
    later_roots = backward_roots(system, path, disturbance, weights)
    roots = posterior_roots(system, path, prior, disturbance, weights)[:-1]
    n = path.x.shape[1]
    about_state = np.concatenate([roots, later_roots[:, :, :n]], axis=1)
    about_input = np.concatenate([np.zeros_like(later_roots[:, :, n:]), later_roots[:, :, n:]], axis=1)
    return square * _marginal_information(about_input, about_state)


def _rows_with_nuisance(
    system: AbstractSystem, path: Trajectory, prior: Prior, disturbance: Disturbance, weights: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return rows (N, m, p) about w_k, and (N, m, .) about (b, x_k) and e, with errors z_k = M (b, x_k) + V^1/2 e."""
    nuisance, rows = nuisance_of(system.model, path.pace), [path.x[:-1], all_inputs_along(system, path), weights, prior.std]
    a, size = len(nuisance.coloured), path.x.shape[1] + len(nuisance.constant)
    scan = forward_scan(system.model, path.pace, disturbance, substeps_along(system, path), with_errors=True)
    results = scan.run(initial_carry_of(prior, nuisance, error_rows_of(disturbance))[None], rows, path.steps, carries=False).results
    shapes = ((size, size), (size, a), (a, a))
    T, M, V = (values[0].reshape(path.steps, *shape).swapaxes(1, 2) for values, shape in zip(results, shapes, strict=True))
    values, vectors = np.linalg.eigh(V)
    root = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
    later = backward_roots_with_nuisance(system, path, disturbance, weights)
    errors, unit = later[:, :, size : size + a], np.broadcast_to(np.eye(a), (path.steps, a, a))
    later_rows = np.concatenate([later[:, :, :size] + errors @ M, errors @ root], axis=2)
    earlier_rows = np.concatenate([T, np.zeros((path.steps, size, a))], axis=2)
    error_rows = np.concatenate([np.zeros((path.steps, a, size)), unit], axis=2)
    inputs = np.pad(later[:, :, size + a :], ((0, 0), (size, a), (0, 0)))
    return inputs, np.concatenate([earlier_rows, later_rows, error_rows], axis=1)


def disturbance_of(
    system: AbstractSystem,
    path: Trajectory,
    prior: Prior,
    disturbance_psd: DisturbancePsd,
    unknown_inputs: Sequence[str],
    input_psd: InputPsd = None,
) -> Disturbance:
    """Return what moves the state; raise InputError for what does not fit."""
    require_fit(system, path)
    model = system.model
    if prior.mean.shape != path.x[0].shape:
        raise InputError(f"prior has {prior.mean.size} states: the path has {path.x.shape[1]} ({', '.join(model.state_names)})")
    require_known("unknown_inputs", unknown_inputs, [signal.name for signal in model.unknown_inputs])
    names = [signal.name for signal in model.unknown_inputs]
    unknown = tuple(names.index(name) for name in dict.fromkeys(unknown_inputs))
    return Disturbance(unknown, noise_of(model, disturbance_psd, input_psd, path.pace))


def weights_of(system: AbstractSystem, path: Trajectory, active: np.ndarray | None) -> np.ndarray:
    """Return (N, S): 1 where a sensor is on and has a sample, else 0."""
    sampling = sampling_mask(system, path.steps, path.pace)
    if active is None:
        return sampling.astype(float)
    mask = as_array("active", active)
    if mask.shape != sampling.shape:
        raise InputError(f"active has shape {mask.shape}: must be {sampling.shape}")
    if not np.isin(mask, (0.0, 1.0)).all():
        raise InputError(f"active has the entry {mask[~np.isin(mask, (0.0, 1.0))][0]}: must be true or false")
    return (sampling & (mask > 0)).astype(float)


def _marginal_information(about_input: np.ndarray, about_state: np.ndarray) -> np.ndarray:
    """Information (N, p, p) of rows (N, m, p) about inputs when the state, of rows (N, m, n), has taken what it can explain."""
    size = np.linalg.norm(about_state, axis=1, keepdims=True)
    U, values, _ = np.linalg.svd(about_state / np.where(size > 0, size, 1.0), full_matrices=False)
    U = np.where((values > _ROUND_OFF_SHARE * values[:, :1])[:, None, :], U, 0.0)
    remainder = about_input - U @ (U.swapaxes(1, 2) @ about_input)
    # what is left after a cancellation to the last digits is rounding
    input_size = np.linalg.norm(about_input, axis=1, keepdims=True)
    remainder = np.where(np.linalg.norm(remainder, axis=1, keepdims=True) > _ROUND_OFF_SHARE * input_size, remainder, 0.0)
    return remainder.swapaxes(1, 2) @ remainder
