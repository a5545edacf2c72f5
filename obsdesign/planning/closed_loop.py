"""Planning in the loop: a vehicle flies what is planned from what a filter believes, and the filter learns from the flight."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from logging import getLogger

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.arguments import validate_arguments
from obsdesign.calculus import wrap_columns
from obsdesign.checks import require_count, require_positive, whole_multiple
from obsdesign.constraints.abstract import ALWAYS
from obsdesign.design.feasibility import least_margins_at_nodes
from obsdesign.design.problem import DesignProblem
from obsdesign.display import AbstractDisplay, Summary, number, state_picture
from obsdesign.dynamics.measurement_noise import MeasurementNoise, detections, is_in_sight, measurement_noise
from obsdesign.dynamics.noise_draws import state_noise, with_input_noise
from obsdesign.dynamics.process_noise import ProcessNoise, noise_of
from obsdesign.dynamics.simulation import as_state, readings, states_from, substeps_needed
from obsdesign.errors import InputError
from obsdesign.estimation.filter_bank import Belief, FilterBank
from obsdesign.information.sample_information import sampling_mask
from obsdesign.noise_density import DisturbancePsd, InputPsd
from obsdesign.planning.plan import Plan
from obsdesign.planning.planner import ITERATIONS, Planner
from obsdesign.planning.shifted_path import Horizon
from obsdesign.prior import Prior
from obsdesign.progress import Progress, StageReport
from obsdesign.status import Status
from obsdesign.trajectory import even_path_of


@dataclass(frozen=True, eq=False)
class Flight(AbstractDisplay):
    """What was flown in K steps, and what the filter believed."""

    t: np.ndarray
    """Instants (K+1,) [s]."""
    truth: np.ndarray
    """True states (K+1, n), in the units of the states."""
    mean: np.ndarray
    """The filter's estimate (K+1, n), in the units of the states: after the samples at t_k for k < K, predicted at t_K."""
    std: np.ndarray
    """The filter's standard deviation (K+1, n), in the units of the states."""
    u: np.ndarray
    """Inputs flown (K, m), in their units."""
    nees: np.ndarray
    """Normalised squared errors e'P^-1 e (K+1,): n on average for an honest filter."""
    margin: float
    """The least along the truth of the limits that always hold, of order 1; inf without any."""
    statuses: tuple[Status, ...] = ()
    """How the solve of each plan ended."""
    feasible: tuple[bool, ...] = ()
    """Whether each plan broke no limit."""
    ages: tuple[int, ...] = ()
    """How many plans ago the inputs of each were found, 0 = for this one."""
    values: tuple[float, ...] = ()
    """What each plan is worth."""
    seconds: tuple[float, ...] = ()
    """Wall time of each plan [s]."""
    straight: Flight | None = None
    """The same flight, with the same noise, with all inputs in the middle of their ranges; None in that one."""

    def _summary(self) -> Summary:
        error = self.mean[-1] - self.truth[-1]
        rows = [
            (f"state {i} at the end", f"error {number(miss)}, standard deviation {number(std)}")
            for i, (miss, std) in enumerate(zip(error, self.std[-1], strict=True))
        ]
        rows.append(("limits", f"least margin {number(self.margin)} along what was flown"))
        if self.feasible:
            slowest = number(max(self.seconds), "s")
            rows.append(("plans", f"{len(self.feasible)}, {sum(self.feasible)} within all limits, slowest {slowest}"))
        return Summary(f"flight of {number(self.t[-1] - self.t[0], 's')}", tuple(rows), state_picture(self.truth))


@dataclass(frozen=True, eq=False)
class _Realisation:
    """What no pilot can change: the true start (n,), process noise, of the samples as well, who samples (K, q).

    white (K, .): N(0, 1) each, what is drawn of the columns of the states' noise and of the inputs'.
    """

    start: np.ndarray
    noise: ProcessNoise
    white: np.ndarray
    sample_noise: MeasurementNoise
    is_sampled: np.ndarray


@dataclass(frozen=True, eq=False)
class _Simulation:
    """A problem, its prior, the filter, and the world."""

    problem: DesignProblem
    prior: Prior
    estimator: FilterBank
    realisation: _Realisation


_LOGGER = getLogger(__name__)

# step, belief after its samples, covariance before them -> inputs (m,)
_Policy = Callable[[int, Belief, np.ndarray], np.ndarray]


@validate_arguments
def fly(
    problem: DesignProblem,
    prior: Prior,
    *,
    every: float,
    duration: float,
    disturbance_psd: DisturbancePsd = None,
    input_psd: InputPsd = None,
    seed: int = 0,
    deadline: float | None = None,
    truth: ArrayLike | None = None,
    horizon: Horizon = "receding",
    iterations: int = ITERATIONS,
    progress: Progress | None = None,
) -> Flight:
    """Fly in simulation with the filter in the loop: a new plan again and again, from what the filter believes.

    The mean of an EKF is the start of each plan, its information the plan's prior. The truth begins at a draw from the prior; process noise
    and the sensors' noise are as in `validate`. Each plan is flown from the instant for which it was made: the time it takes counts for its
    deadline only. The same seed, the same flight, save for seconds, without a deadline.

    Arguments:
        problem: what each plan answers.
        prior: what is known of the initial state.
        every: time from one plan to the next [s].
        duration: length of the flight [s].
        disturbance_psd: power spectral density (n,) or (n, n) of the process noise [unit^2/s], or a PerSpeed of it; None = none.
        input_psd: of known inputs, as for posterior_information, held over each step; None = none.
        seed: seed of the truth and of all noise.
        deadline: time that a plan may take [s]; None = any.
        truth (n,): true initial state, in the units of the states; None = a draw from the prior.
        horizon: "receding" or "shrinking", as in Planner.
        iterations: of a plan after the first at most, as in Planner.
        progress: is called with what is being done, as it begins; None = nobody is told.
    Raises InputError for values that do not fit, and what `Planner` raises; in flight nothing is raised.
    """
    require_positive("flight: duration", duration)
    steps = whole_multiple(duration, problem.step)
    if steps is None:
        raise InputError(f"flight: duration is {duration!r}: must be a whole multiple of the step {problem.step:g} s")
    require_count("seed", seed, minimum=0)
    if deadline is not None:
        require_positive("deadline", deadline)
    planner = Planner(problem, every, horizon, iterations, seed=seed)
    n = problem.x0.size
    if prior.mean.size != n:
        raise InputError(f"prior has {prior.mean.size} states: the system has {n}")
    noise = noise_of(problem.system.model, disturbance_psd, input_psd, problem.step)
    start = None if truth is None else as_state(problem.system, truth, "truth")
    simulation = _Simulation(
        problem,
        prior,
        FilterBank(problem.system, problem.step, noise, tolerance=problem.tolerance),
        _draw_realisation(problem, prior, start, noise, steps, seed),
    )
    plans: list[Plan] = []
    report = StageReport(_LOGGER, progress)
    report("the flight with inputs in the middle of their ranges")
    mid_range = problem.grid.centre
    straight = _simulate_flight(simulation, lambda *_: mid_range)
    period = round(every / problem.step)
    flight = _simulate_flight(simulation, _planning_policy(planner, period, deadline, plans, -(-steps // period), report))
    return replace(
        flight,
        statuses=tuple(plan.status for plan in plans),
        feasible=tuple(plan.feasible for plan in plans),
        ages=tuple(plan.age for plan in plans),
        values=tuple(plan.value for plan in plans),
        seconds=tuple(plan.seconds for plan in plans),
        straight=straight,
    )


def _draw_realisation(
    problem: DesignProblem, prior: Prior, start: np.ndarray | None, noise: ProcessNoise, steps: int, seed: int
) -> _Realisation:
    """Draw a world from the seed."""
    random, model = np.random.default_rng(seed), problem.system.model
    random_start = prior.mean + np.linalg.cholesky(prior.covariance) @ random.standard_normal(prior.mean.size)
    drawn = random.standard_normal((steps, noise.state_columns))
    white_before, white_constant, *white = random.standard_normal((steps + 2, len(model.outputs)))
    is_sampled = sampling_mask(problem.system, steps, problem.step)[:, list(model.output_owner)]
    sample_noise = measurement_noise(model, np.array(white), white_constant, is_sampled, white_before)
    is_sampled = is_sampled & detections(model, random, steps)
    drawn = np.hstack([drawn, random.standard_normal((steps, len(noise.inputs)))])
    return _Realisation(random_start if start is None else start, noise, drawn, sample_noise, is_sampled)


def _planning_policy(planner: Planner, every: int, deadline: float | None, plans: list[Plan], total: int, report: StageReport) -> _Policy:
    def inputs(k: int, belief: Belief, predicted: np.ndarray) -> np.ndarray:
        """Return the inputs of step k of the plan in force."""
        if k % every == 0:
            report(f"{len(plans)} of {total} plans made, the next at {k * planner.problem.step:g} s")
            information = np.linalg.inv(predicted)
            plans.append(planner.step(belief.mean[0], plans[-1] if plans else None, (information + information.T) / 2, deadline))
        return plans[-1].trajectory.u[min(k % every, plans[-1].trajectory.steps - 1)]

    return inputs


def _simulate_flight(simulation: _Simulation, policy: _Policy) -> Flight:
    """Fly what a pilot wants."""
    realisation = simulation.realisation
    truth, belief = realisation.start, Belief(simulation.prior.mean[None], simulation.prior.covariance[None])
    states, beliefs, inputs = [truth], [], []
    for k, white in enumerate(realisation.white):
        predicted = belief.covariance[0]
        belief = _measurement_update(simulation, belief, truth, k)
        beliefs.append(belief)
        inputs.append(policy(k, belief, predicted))
        truth = _step_with_noise(simulation, truth, inputs[-1], white)
        states.append(truth)
        belief = simulation.estimator.predict(belief, inputs[-1])
    beliefs.append(belief)
    return _summarise(simulation, np.array(states), beliefs, np.array(inputs))


def _step_with_noise(simulation: _Simulation, truth: np.ndarray, u: np.ndarray, white: np.ndarray) -> np.ndarray:
    """Return the state (n,) one step later."""
    problem, noise = simulation.problem, simulation.realisation.noise
    substeps = int(substeps_needed(problem.system, truth[None], u[None], problem.step, None, problem.tolerance)[0])
    step = even_path_of(np.array([0.0, problem.step]), np.stack([truth, truth]), u[None].copy(), None, problem.tolerance)
    added = state_noise(problem.system, step, noise, white[None, : noise.state_columns])
    system, w = with_input_noise(problem.system, step, noise, white[None, noise.state_columns :])
    return states_from(system, truth[None], u[None], problem.step, w, added[None], substeps=substeps)[0, 1]


def _measurement_update(simulation: _Simulation, belief: Belief, truth: np.ndarray, k: int) -> Belief:
    """Take in the samples at the k-th instant."""
    reading = readings(simulation.problem.system, truth[None, None])
    y = simulation.realisation.sample_noise.at(k).added_to(reading)[0]
    is_there = simulation.realisation.is_sampled[k] & is_in_sight(simulation.problem.system.model, reading.gate[0, 0])
    return simulation.estimator.update(belief, y, is_there)


def _summarise(simulation: _Simulation, truth: np.ndarray, beliefs: list[Belief], u: np.ndarray) -> Flight:
    model = simulation.problem.system.model
    mean, covariance = (np.array([getattr(belief, name)[0] for belief in beliefs]) for name in ("mean", "covariance"))
    errors = wrap_columns(mean - truth, np.array([state.is_angle for state in model.states]))
    nees = np.einsum("ki,ki->k", errors, np.linalg.solve(covariance, errors[..., None])[..., 0])
    std = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    return Flight(np.arange(len(truth)) * simulation.problem.step, truth, mean, std, u, nees, _least_margin(simulation.problem, truth, u))


def _least_margin(problem: DesignProblem, truth: np.ndarray, u: np.ndarray) -> float:
    """The least margin at the nodes of the truth, of limits that hold at all times; inf without any."""
    always = tuple(constraint for constraint in problem.constraints if constraint.span == ALWAYS)
    least_margins = least_margins_at_nodes(problem.system.model, always, truth, u, problem.step)
    return min((least.value for least in least_margins), default=float("inf"))
