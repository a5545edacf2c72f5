"""From a log to estimates: a filter or a smoother from event to event."""

from __future__ import annotations

import numpy as np

from obsdesign.arguments import validate_arguments
from obsdesign.checks import require_tolerance
from obsdesign.dynamics.model import AbstractSystem
from obsdesign.dynamics.per_step import PerStepSystem, require_timed
from obsdesign.dynamics.process_noise import noise_of
from obsdesign.errors import InputError
from obsdesign.estimation.abstract import AbstractEstimator
from obsdesign.estimation.estimate import Estimate
from obsdesign.estimation.extended_kalman_filter import ExtendedKalmanFilter
from obsdesign.estimation.filter_bank import Belief, FilterBank
from obsdesign.estimation.filter_run import estimate_of, require_estimates, require_prior
from obsdesign.information.recorded_samples import require_single_spread
from obsdesign.logs.events import Events, events_of, input_integrals
from obsdesign.logs.log import Log
from obsdesign.noise_density import DisturbancePsd, InputPsd
from obsdesign.prior import Prior
from obsdesign.trajectory import TOLERANCE, Trajectory


@validate_arguments
def estimate_log(
    system: AbstractSystem,
    log: Log,
    prior: Prior,
    *,
    disturbance_psd: DisturbancePsd = None,
    input_psd: InputPsd = None,
    estimator: AbstractEstimator | None = None,
    step: float | None = None,
    tolerance: float = TOLERANCE,
) -> Estimate:
    """Run a filter or a smoother on a log, from event to event: each sample is taken in at its own time, after the inputs until then.

    Where a sensor has several samples at one time, steps of length 0 stand between them. A sample with a sigma of its own has
    that in place of its sensor's; whatever a gate of the sensor says, it has arrived.

    Arguments:
        system: vehicle and sensors; unknown inputs count as 0, or are states: see InputStates.
        log: the recorded run; its truth is not looked at.
        prior: what is known of the state at the log's beginning, `log.span[0]`.
        disturbance_psd: power spectral density (n,) or (n, n) of the process noise [unit^2/s], Q = psd dt; None = none. Or a PerSpeed.
        input_psd: of known inputs, as for posterior_information; None = none.
        estimator: as for estimate_states; None = an ExtendedKalmanFilter.
        step: length of the steps of a grid [s], to whose nearest instants samples are moved; None = no grid.
        tolerance: relative error of the steps, in (0, 1).
    Raises InputError for a log that is not of this system, sensors whose errors are correlated in time and that have no rate, and estimates
    that leave the finite numbers.
    """
    require_tolerance(tolerance)
    require_prior(system, prior)
    require_timed(system.model)
    events, noise = events_of(system, log, step), noise_of(system.model, disturbance_psd, input_psd, 1.0)
    per_step, chosen = PerStepSystem(system, has_arrived=True), estimator or ExtendedKalmanFilter()
    bank = FilterBank(per_step, 1.0, noise, tolerance=tolerance, estimator=chosen)
    start = Belief(prior.mean[None], prior.covariance[None])
    belief, reports = bank.report(start, events.rows, events.y[:, None], sample_weights(system, events))
    require_estimates(system, belief, events.t)
    return estimate_of(system, events.t, belief, reports, events.arrived)


@validate_arguments
def path_of_estimate(system: AbstractSystem, log: Log, estimate: Estimate) -> Trajectory:
    """Return the path that a filter went along a log, with the inputs of the log: what information needs where no truth is known.

    Instants are those of the estimate, once each: after all samples of that time.

    Arguments:
        system: vehicle and sensors.
        log: the recorded run.
        estimate: what estimate_log made of it.
    Raises InputError for an estimate of other states.
    """
    if estimate.states != system.model.state_names:
        raise InputError(f"estimate is of the states {', '.join(estimate.states)}: the system has {', '.join(system.model.state_names)}")
    is_last = np.append(np.diff(estimate.t) > 0, True)
    t = estimate.t[is_last]
    return Trajectory(t, estimate.mean[is_last], input_integrals(system.model, log, t) / np.diff(t)[:, None])


def sample_weights(system: AbstractSystem, events: Events) -> np.ndarray:
    """Return how often each output counts (N, q), as `sensor_weights`."""
    return sensor_weights(system, events)[:, list(system.model.output_owner)]


def sensor_weights(system: AbstractSystem, events: Events) -> np.ndarray:
    """Return how often the samples of each sensor count (N, S).

    0 where there is none, (spread / sigma)^2 where the log says how exact it is, else 1.
    """
    import casadi as ca

    model, weights = system.model, events.arrived.astype(float)
    for s, channel in enumerate(model.channels):
        is_told = np.isfinite(events.sigma[:, s])
        if not is_told.any():
            continue
        require_single_spread(model, channel)
        spread = ca.densify(channel.noise.spread)
        if not spread.is_constant():
            raise InputError(
                f"log: a sample of {channel.name!r} has a sigma of its own: filters accept that where the sensor's is a constant"
            )
        weights[is_told, s] = (float(spread) / events.sigma[is_told, s]) ** 2
    return weights
