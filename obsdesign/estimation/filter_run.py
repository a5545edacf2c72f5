"""From samples to estimates: one run of a filter or a smoother."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.arguments import validate_arguments
from obsdesign.checks import all_finite, as_array, require_tolerance
from obsdesign.dynamics.model import AbstractSystem, Model
from obsdesign.dynamics.per_step import system_along
from obsdesign.dynamics.process_noise import noise_of
from obsdesign.dynamics.simulation import as_inputs, as_lengths, inputs_along, times_of
from obsdesign.errors import InputError
from obsdesign.estimation.abstract import AbstractEstimator
from obsdesign.estimation.estimate import Estimate
from obsdesign.estimation.extended_kalman_filter import ExtendedKalmanFilter
from obsdesign.estimation.filter_bank import Belief, FilterBank, SampleReports
from obsdesign.information.sample_information import sampling_mask
from obsdesign.noise_density import DisturbancePsd, InputPsd
from obsdesign.prior import Prior
from obsdesign.trajectory import TOLERANCE, path_of


@validate_arguments
def estimate_states(
    system: AbstractSystem,
    prior: Prior,
    u: ArrayLike,
    y: ArrayLike,
    dt: ArrayLike,
    *,
    active: ArrayLike | None = None,
    disturbance_psd: DisturbancePsd = None,
    input_psd: InputPsd = None,
    estimator: AbstractEstimator | None = None,
    tolerance: float = TOLERANCE,
) -> Estimate:
    """Run a filter or a smoother on samples: N times an update with the samples at t_k, then a step with inputs held.

    Arguments:
        system: vehicle and sensors; unknown inputs count as 0, or are states: see InputStates.
        prior: what is known of x(t_0).
        u (N, m): known inputs, in their units.
        y (N, q): outputs, in their units, in the order of the sensors; what is not there may be anything, such as NaN.
        dt: length of a step [s], or (N,) those of all steps, of which each may be another; t_0 = 0.
        active (N, S): bool, which sensors have a sample; None = all, as often as their rates say.
        disturbance_psd: power spectral density (n,) or (n, n) of the process noise [unit^2/s], Q = psd dt; None = none. Or a PerSpeed.
        input_psd: of known inputs, as for posterior_information; None = none.
        estimator: an ExtendedKalmanFilter, IteratedExtendedKalmanFilter, UnscentedKalmanFilter or FixedIntervalSmoother, with or without
            a Gate; None = the first, without one.
        tolerance: relative error of the steps, in (0, 1).
    Raises InputError for shapes that do not fit, a sample that is there and not finite, a step too coarse for the dynamics, and
    estimates that leave the finite numbers.
    """
    lengths = as_lengths(dt)
    require_tolerance(tolerance)
    model = system.model
    inputs, samples = as_inputs(u, len(model.inputs), "u"), as_array("y", y)
    require_prior(system, prior)
    if not len(inputs) or samples.shape != (len(inputs), len(model.outputs)):
        raise InputError(f"y has shape {samples.shape}: must be ({max(len(inputs), 1)}, {len(model.outputs)}), a row for each row of u")
    path = path_of(times_of(lengths, len(inputs)), np.tile(prior.mean, (len(inputs) + 1, 1)), inputs, None, tolerance)
    along = system_along(system, path, active is not None, has_timed_errors=True)
    arrived = _arrived(along, active, path.steps, path.pace)
    noise = noise_of(model, disturbance_psd, input_psd, path.pace)
    bank = FilterBank(along, path.pace, noise, tolerance=tolerance, estimator=estimator or ExtendedKalmanFilter())
    is_active = arrived[:, list(model.output_owner)]
    _require_samples(system, samples, is_active)
    start = Belief(prior.mean[None], prior.covariance[None])
    belief, reports = bank.report(start, inputs_along(along, path)[0], np.where(is_active, samples, 0.0)[:, None], is_active)
    require_estimates(system, belief, path.t)
    return estimate_of(system, path.t, belief, reports, arrived)


def _arrived(system: AbstractSystem, active: ArrayLike | None, steps: int, dt: float) -> np.ndarray:
    """Return (N, S) bool: which sensors have a sample."""
    if active is None:
        return sampling_mask(system, steps, dt)
    mask, shape = as_array("active", active), (steps, len(system.model.channels))
    if mask.shape != shape:
        raise InputError(f"active has shape {mask.shape}: must be {shape}")
    if not np.isin(mask, (0.0, 1.0)).all():
        raise InputError(f"active has the entry {mask[~np.isin(mask, (0.0, 1.0))][0]}: must be true or false")
    return mask > 0


def _require_samples(system: AbstractSystem, y: np.ndarray, is_active: np.ndarray) -> None:
    wrong = np.argwhere(is_active & ~np.isfinite(y))
    if len(wrong):
        k, j = wrong[0]
        name = system.model.outputs[j].name
        raise InputError(f"y[{k}, {j}] ({name}) is {y[k, j]}: a sample that is there must be finite; `active` says which are")


def require_prior(system: AbstractSystem, prior: Prior) -> None:
    """Raise InputError for a prior of another number of states."""
    names = system.model.state_names
    if prior.mean.size != len(names):
        raise InputError(f"prior has {prior.mean.size} states: the system has {len(names)} ({', '.join(names)})")


def require_estimates(system: AbstractSystem, belief: Belief, t: np.ndarray) -> None:
    """Raise InputError with state and time for the first estimate that is not finite."""
    if all_finite(belief.mean) and all_finite(belief.covariance):
        return
    values = np.concatenate([belief.mean[:, 0], np.diagonal(belief.covariance[:, 0], axis1=1, axis2=2)], axis=1)
    k, i = np.argwhere(~np.isfinite(values))[0] if not all_finite(values) else (0, 0)
    name = system.model.state_names[i % len(system.model.states)]
    raise InputError(f"the estimate of {name} or its variance is {values[k, i]} at t = {t[k]:g} s: the motion runs away from the samples")


def _any_output(model: Model, flags: np.ndarray) -> np.ndarray:
    """Return whether something (N, q) holds for any of the outputs of each sensor (N, S)."""
    of_sensor = [flags[:, list(outputs)].any(axis=1) for outputs in model.outputs_of.values()]
    return np.array(of_sensor, dtype=bool).reshape(-1, len(flags)).T


def estimate_of(system: AbstractSystem, t: np.ndarray, belief: Belief, reports: SampleReports, arrived: np.ndarray) -> Estimate:
    """Return the estimate at instants t (N+1,) of one run's beliefs and reports, arrived (N, S)."""
    model = system.model
    is_usable, is_taken = reports.is_usable[:, 0], reports.is_taken[:, 0]
    has_nis = _any_output(model, is_usable)
    is_active = arrived[:, list(model.output_owner)]
    return Estimate(
        t,
        belief.mean[:, 0],
        belief.covariance[:, 0],
        np.where(is_usable, reports.residual[:, 0], np.nan),
        np.where(is_usable, np.sqrt(reports.variance[:, 0]), np.nan),
        np.where(has_nis, reports.nis[:, 0], np.nan),
        arrived,
        _any_output(model, is_usable & ~is_taken),
        reports.is_alarm[:, 0],
        _any_output(model, is_active & ~is_usable),
        model.state_names,
        model.sensor_names,
    )
