"""Monte Carlo over a filter: does it reach the bound, and does it know how well it does?"""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass
from logging import getLogger
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import gammaincinv

from obsdesign.arguments import validate_arguments
from obsdesign.blas_threads import one_thread
from obsdesign.calculus import wrap_columns
from obsdesign.checks import as_array, require_count
from obsdesign.display import AbstractDisplay, Summary, data_frame, number
from obsdesign.dynamics.measurement_noise import MeasurementNoise, detections, is_in_sight, measurement_noise
from obsdesign.dynamics.model import AbstractSystem
from obsdesign.dynamics.noise_draws import input_noise_effect, state_noise, with_input_noise
from obsdesign.dynamics.per_step import system_along
from obsdesign.dynamics.process_noise import ProcessNoise, noise_of
from obsdesign.dynamics.simulation import inputs_along, readings, states_from, substeps_along
from obsdesign.errors import InputError
from obsdesign.estimation.abstract import AbstractEstimator
from obsdesign.estimation.extended_kalman_filter import ExtendedKalmanFilter
from obsdesign.estimation.filter_bank import Belief, FilterBank
from obsdesign.information.gramian import require_fit
from obsdesign.information.posterior import posterior_information
from obsdesign.information.recorded_samples import recorded_samples
from obsdesign.information.sample_information import sampling_mask
from obsdesign.logs.log import Log
from obsdesign.noise_density import DisturbancePsd, InputPsd
from obsdesign.prior import Prior
from obsdesign.progress import Progress, StageReport
from obsdesign.round_off import standard_deviations
from obsdesign.selection.schedule import Schedule
from obsdesign.trajectory import Trajectory

if TYPE_CHECKING:
    from pandas import DataFrame

_LOGGER = getLogger(__name__)
SETTLING_SHARE = 0.25  # share of the path after which consistency is judged
CONSISTENT_SHARE = 0.65  # share of the later instants that must lie in the band
_RUNS_PER_TASK = 50  # runs per task: fixed, so that the answer does not depend on the number of workers

Consistency = Literal["consistent", "overconfident", "underconfident"]


@dataclass(frozen=True, eq=False)
class Validation(AbstractDisplay):
    """What R filter runs did, against the posterior Cramer-Rao bound.

    Values at t_k are after that instant's update, predicted at t_N. `consistent`: at least 65 % of the later instants are in the band.
    """

    t: np.ndarray
    """Instants (N+1,) [s]."""
    rmse: np.ndarray
    """Root mean square error of each state over the runs (N+1, n), in the units of the states."""
    bound: np.ndarray
    """Posterior Cramer-Rao standard deviation (N+1, n), in the units of the states."""
    nees: np.ndarray
    """Run-averaged e'P^-1 e (N+1,): n on average for an honest filter."""
    nees_interval: tuple[float, float]
    """Its 95 % band (low, high): chi-square, R n degrees of freedom, over R."""
    in_band: float
    """Share of the instants after the first quarter inside the band."""
    verdict: Consistency
    """The same as a word: whether the filter's covariance tells the truth about its errors."""
    runs: int
    """Number R of runs."""
    seed: int
    """Seed of their noise."""

    @property
    def consistent(self) -> bool:
        """Whether the filter's covariance tells the truth about its errors."""
        return self.verdict == "consistent"

    def to_dataframe(self) -> DataFrame:
        """Return times as the index, and columns rmse0.., bound0.. for each state and nees.

        Raises MissingPackageError where pandas is not installed.
        """
        tables = {"rmse": self.rmse, "bound": self.bound}
        columns = {f"{name}{i}": column for name, values in tables.items() for i, column in enumerate(values.T)}
        return data_frame(columns | {"nees": self.nees}, {"t": self.t})

    def _summary(self) -> Summary:
        last = zip(self.rmse[-1], self.bound[-1], strict=True)
        rows = [(f"state {i} at the end", f"RMSE {number(error)}, bound {number(bound)}") for i, (error, bound) in enumerate(last)]
        low, high = self.nees_interval
        rows.append(("NEES", f"{100 * self.in_band:.0f} % of the later instants within {number(low)} to {number(high)}"))
        return Summary(f"filter over {self.runs} runs: {self.verdict}", tuple(rows))


@dataclass(frozen=True, eq=False)
class _MonteCarloTask:
    """Everything a worker needs for one chunk of runs."""

    system: AbstractSystem
    path: Trajectory
    prior: Prior
    active: np.ndarray
    noise: ProcessNoise
    seed: int
    runs: range
    estimator: AbstractEstimator
    remainder: np.ndarray | None


@validate_arguments
def validate(
    system: AbstractSystem,
    path: Trajectory,
    schedule: Schedule | ArrayLike | None = None,
    *,
    prior: Prior,
    runs: int = 200,
    seed: int = 0,
    executor: Executor | None = None,
    disturbance_psd: DisturbancePsd = None,
    input_psd: InputPsd = None,
    progress: Progress | None = None,
    estimator: AbstractEstimator | None = None,
    samples: Log | None = None,
) -> Validation:
    """Run a filter on simulated flights of a path and compare its errors with the posterior Cramer-Rao bound.

    NEES e'P^-1 e, averaged over the runs, is n for an honest filter; RMSE is compared with sqrt(diag(J^-1)).
    Truth follows the path's inputs from x(t_0), known and unknown ones, with process noise. A path that was driven does what no input
    tells of: r_k = x_k+1 - f(x_k, u_k, w_k), beyond its tolerance. There truth is the path itself, and process noise is in what filters
    are told of r_k: the same errors, to first order, without a drift that was never driven. Samples have the sensors' correlated, joint
    and constant errors, and are missing out of range and view. Each filter starts at a draw from N(x(t_0), P_0), knows the psd and
    how the errors come about, which it estimates with the state, and takes unknown inputs as 0: only the bound is that of somebody
    who knows them.

    Arguments:
        system: vehicle and sensors.
        path: the path that is flown.
        schedule: a Schedule, (K, S) bool, or None = all sensors on.
        prior: its covariance is P_0, that of the filters' starts.
        runs: number of flights, at least 1.
        seed: seed of their noise.
        executor: any concurrent.futures.Executor of processes; the answer is the same for any number of them.
        disturbance_psd: power spectral density (n,) or (n, n) of the process noise [unit^2/s], or a PerSpeed of it; None = none.
        input_psd: of known inputs, as for posterior_information, held over each step in the truth; None = none.
        progress: is called with what is being done, as it begins; None = nobody is told.
        estimator: which filter; None = an ExtendedKalmanFilter that takes all samples in. A smoother may well be better than
            the bound, which is of the samples so far.
        samples: a log; sensors are read when they were read in it, and their errors are those of the sensors. None = as often as
            their rates say.
    Raises InputError for shapes that do not fit. Source: Bar-Shalom, Li, Kirubarajan (2001), section 5.4.
    """
    require_count("runs", runs)
    require_count("seed", seed, minimum=0)
    require_fit(system, path)
    walk, report = _walk_along(system, path, schedule, samples), StageReport(_LOGGER, progress)
    report("the posterior bound")
    J = posterior_information(walk.system, walk.path, prior, disturbance_psd, active=walk.active, input_psd=input_psd)
    noise = noise_of(walk.system.model, disturbance_psd, input_psd, walk.path.pace)
    along = system_along(walk.system, walk.path, True, has_timed_errors=True)
    remainder, chosen = motion_beyond_model(along, walk.path), estimator or ExtendedKalmanFilter()
    chunks = [range(first, min(first + _RUNS_PER_TASK, runs)) for first in range(0, runs, _RUNS_PER_TASK)]
    tasks = [_MonteCarloTask(along, walk.path, prior, walk.active, noise, seed, chunk, chosen, remainder) for chunk in chunks]
    results = []
    for chunk, result in zip(chunks, map(_run_filters, tasks) if executor is None else executor.map(_run_filters, tasks), strict=True):
        results.append(result)
        report(f"{chunk.stop} of {runs} filter runs done")
    squares, nees = zip(*results, strict=True)
    rmse, at_nodes = np.sqrt(sum(squares) / runs), walk.nodes
    return _assess_consistency(path.t, rmse[at_nodes], standard_deviations(J[at_nodes]), np.concatenate(nees, axis=1)[at_nodes], seed)


@dataclass(frozen=True, eq=False)
class _Walk:
    """A system as it is along a path, which sensors are read at which of its instants (N, S), and where the nodes asked for are."""

    system: AbstractSystem
    path: Trajectory
    active: np.ndarray
    nodes: np.ndarray


def _walk_along(system: AbstractSystem, path: Trajectory, schedule: Schedule | ArrayLike | None, log: Log | None) -> _Walk:
    if log is None:
        return _Walk(system, path, active_steps(system, path, schedule), np.arange(path.steps + 1))
    arrived = recorded_samples(system, path, log, has_timed_errors=True)
    events = arrived.event_path
    active = events.weights > 0
    if schedule is not None:
        active = active & active_steps(arrived.system, path, schedule)[events.step]
    return _Walk(arrived.system, events.path, active, events.nodes)


def motion_beyond_model(system: AbstractSystem, path: Trajectory) -> np.ndarray | None:
    """Return r_k = x_k+1 - f(x_k, u_k, w_k) (N, n) along a path, None where it is within the tolerance; system as along the path."""
    u, w = (rows[:, None] for rows in inputs_along(system, path))
    steps = states_from(system, path.x[:-1], u, path.pace, w, substeps=substeps_along(system, path))
    remainder, size = path.x[1:] - steps[:, 1], np.abs(path.x).max(axis=0) + np.abs(np.diff(path.x, axis=0)).max(axis=0)
    return remainder if (np.abs(remainder) > path.tolerance * size).any() else None


def active_steps(system: AbstractSystem, path: Trajectory, schedule: Schedule | ArrayLike | None) -> np.ndarray:
    """Return (N, S) bool: where a sensor is on by the schedule and has a sample."""
    mask = sampling_mask(system_along(system, path, schedule is not None, has_timed_errors=True), path.steps, path.pace)
    if schedule is None:
        return mask
    if isinstance(schedule, Schedule) and not schedule.status.has_answer:
        raise InputError(f"schedule has no answer ({schedule.status.value}): there is nothing to validate")
    chosen = as_array("schedule", schedule.chosen if isinstance(schedule, Schedule) else schedule)
    if chosen.ndim != 2 or chosen.shape[1] != mask.shape[1] or not len(chosen) or path.steps % len(chosen):
        raise InputError(f"schedule has shape {chosen.shape}: must be (K, {mask.shape[1]}), with K a divisor of {path.steps} steps")
    if not np.isin(chosen, (0.0, 1.0)).all():
        k, s = np.argwhere(~np.isin(chosen, (0.0, 1.0)))[0]
        raise InputError(f"schedule[{k}, {s}] is {chosen[k, s]}: must be true or false")
    return mask & np.repeat(chosen > 0, path.steps // len(chosen), axis=0)


@one_thread()
def _run_filters(task: _MonteCarloTask) -> tuple[np.ndarray, np.ndarray]:
    """Return sums of squared errors (N+1, n) and NEES (N+1, R) of one chunk of runs."""
    system, path, model = task.system, task.path, task.system.model
    draws = [_draws(task, run) for run in task.runs]
    initial_errors, process_noise, varying, constant, is_detected, input_noise = (np.stack(parts) for parts in zip(*draws, strict=True))
    substeps, u = substeps_along(system, path), inputs_along(system, path)[0]
    if task.remainder is None:
        starts = np.tile(path.x[0], (len(task.runs), 1))
        noisy, w = with_input_noise(system, path, task.noise, input_noise)
        truth, told = states_from(noisy, starts, u, path.pace, w, process_noise, substeps=substeps), None
    else:
        truth, told = path.x[None], process_noise + task.remainder + input_noise_effect(system, path, task.noise, input_noise)
    path_readings = readings(system, truth[:, :-1], u)
    y = MeasurementNoise(varying, constant).added_to(path_readings)
    active = task.active[:, list(model.output_owner)] & is_in_sight(model, path_readings.gate) & is_detected
    bank = FilterBank(system, path.pace, task.noise, substeps, estimator=task.estimator)
    initial = Belief(path.x[0] + initial_errors, np.tile(task.prior.covariance, (len(task.runs), 1, 1)))
    belief = bank.run(initial, u, y.swapaxes(0, 1), active.swapaxes(0, 1), told)
    is_angle = np.array([state.is_angle for state in model.states])
    errors = wrap_columns(belief.mean - truth.swapaxes(0, 1), is_angle)
    weighted = np.linalg.solve(belief.covariance, errors[..., None])[..., 0]
    return np.sum(errors**2, axis=1), np.einsum("kri,kri->kr", errors, weighted)


def _draws(task: _MonteCarloTask, run: int) -> tuple[np.ndarray, ...]:
    """Initial error (n,), process noise (N, n), varying (N, q) and constant (q,) errors of the samples, which are detected (N, q).

    And noise of inputs (N, r), N(0, 1) each. From a stream of the run's own.
    """
    random = np.random.default_rng([task.seed, run])
    model, path = task.system.model, task.path
    initial_error = np.linalg.cholesky(task.prior.covariance) @ random.standard_normal(path.x.shape[1])
    process_noise = state_noise(task.system, path, task.noise, random.standard_normal((path.steps, task.noise.state_columns)))
    white = random.standard_normal((path.steps, len(model.outputs)))
    is_sampled = sampling_mask(task.system, path.steps, path.pace)[:, list(model.output_owner)]
    times = path.t[:-1] if model.is_per_step else None
    noise = measurement_noise(model, white, random.standard_normal(white.shape[1]), is_sampled, times=times)
    is_detected = detections(model, random, path.steps)
    input_noise = random.standard_normal((path.steps, len(task.noise.inputs)))
    return initial_error, process_noise, noise.varying, noise.constant, is_detected, input_noise


def _assess_consistency(t: np.ndarray, rmse: np.ndarray, bound: np.ndarray, nees: np.ndarray, seed: int) -> Validation:
    runs, n = nees.shape[1], rmse.shape[1]
    low, high = (_chi_square_quantile(share, runs * n) / runs for share in (0.025, 0.975))
    average = nees.mean(axis=1)
    settled = average[t >= t[0] + SETTLING_SHARE * (t[-1] - t[0])]
    in_band = float(np.mean((settled >= low) & (settled <= high)))
    verdict: Consistency = "consistent"
    if in_band < CONSISTENT_SHARE:
        verdict = "overconfident" if np.sum(settled > high) >= np.sum(settled < low) else "underconfident"
    return Validation(t, rmse, bound, average, (low, high), in_band, verdict, runs, seed)


def _chi_square_quantile(share: float, freedom: int) -> float:
    """Return what a chi-square variable of so many degrees of freedom is below with a probability: scipy.stats takes long to load."""
    return 2 * float(gammaincinv(freedom / 2, share))
