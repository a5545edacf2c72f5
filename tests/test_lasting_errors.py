"""Errors that last or hang together: the posterior against all samples at once, the filter against the posterior, both against draws."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.linalg import toeplitz
from stacked import stacked

import obsdesign as od
from obsdesign.design.nlp.program import Program
from obsdesign.dynamics.measurement_noise import measurement_noise
from obsdesign.dynamics.process_noise import ProcessNoise
from obsdesign.dynamics.simulation import readings, substeps_along
from obsdesign.estimation.filter_bank import Belief, FilterBank
from obsdesign.estimation.validation import _draws, _MonteCarloTask
from obsdesign.planning import closed_loop as flying
from obsdesign.sensors.abstract import AbstractSensor

ANYTHING = 1e6  # standard deviation of what nothing is known of

# ---------------------------------------------------------------- right values, from (A' R^-1 A)^-1 in closed form


def ahead(steps: int, wind: bool, **gps: float) -> tuple[od.System, od.Trajectory, od.Prior]:
    """1 m/s along x, a step of a second, heading known; position, and wind if there is one, unknown before."""
    system = od.System(od.Dubins(speed=1.0, wind="constant" if wind else None), (od.GPS(**gps),))
    path = od.simulate(system, np.zeros(5 if wind else 3), np.zeros((steps, 1)), 1.0)
    return system, path, od.Prior(path.x[0], std=[ANYTHING, ANYTHING, 1e-9, *([ANYTHING] * 2 if wind else [])])


def deviations(system: od.System, path: od.Trajectory, prior: od.Prior) -> np.ndarray:
    """After the last sample."""
    return od.standard_deviations(od.posterior_information(system, path, prior)[-2])


@pytest.mark.parametrize(("steps", "expected"), [(1, 1.0), (20, 0.8200)], ids=["one", "twenty"])
def test_samples_of_a_first_order_sequence_about_a_constant(steps: int, expected: float):
    """1'A^-1 1 = (N - (N - 2) phi) / (1 + phi), A_ij = phi^|i-j|."""
    known = 1.0 if steps == 1 else (steps - (steps - 2) * 0.95) / 1.95
    found = deviations(*ahead(steps, False, sigma=1.0, correlation=0.95))
    assert found[0] == pytest.approx(known**-0.5, rel=1e-9)
    assert found[0] == pytest.approx(expected, abs=5e-5)


def test_a_position_and_a_constant_wind_from_a_first_order_sequence():
    """(A'R^-1 A)^-1 with rows (1, t - T) about the state at T, the time of the last sample; by symmetry the first would say the same."""
    t, R = np.arange(20.0) - 19, toeplitz(0.95 ** np.arange(20))
    A = np.column_stack([np.ones(20), t])
    expected = np.sqrt(np.diag(np.linalg.inv(A.T @ np.linalg.solve(R, A))))
    found = deviations(*ahead(20, True, sigma=1.0, correlation=0.95))
    np.testing.assert_allclose(found[[0, 3]], expected, rtol=1e-8)
    np.testing.assert_allclose(found[[0, 3]], [0.992, 0.0587], rtol=5e-4)


def test_a_constant_error_is_not_averaged_away():
    """b^2 + sigma^2 / N."""
    found = deviations(*ahead(60, False, sigma=0.1, bias_floor=3.0))
    assert found[0] == pytest.approx(math.sqrt(9 + 0.01 / 60), rel=1e-9)
    assert found[0] == pytest.approx(3.000, abs=5e-4)


@pytest.mark.parametrize("missing", [0, 1, 5])
def test_across_missing_samples_the_correlation_is_its_power(missing: int):
    """Two samples with m - 1 missing between them: 2 / (1 + phi^m), whether the sensor was off or the samples further apart."""
    phi, m = 0.9, missing + 1
    system, path, prior = ahead(m + 1, False, sigma=1.0, correlation=phi)
    active = np.zeros((m + 1, 1), dtype=bool)
    active[[0, m]] = True
    J = od.posterior_information(system, path, prior, active=active)[-2]
    assert J[0, 0] == pytest.approx(2 / (1 + phi**m), rel=1e-9)
    slow, path, prior = ahead(m + 1, False, sigma=1.0, correlation=phi, rate=1.0 / m)
    assert od.posterior_information(slow, path, prior)[-2][0, 0] == pytest.approx(2 / (1 + phi), rel=1e-9)


def test_an_inflation_multiplies_the_spread_and_nothing_else():
    for noise in ({"correlation": 0.9}, {"bias_floor": 0.5}, {}):
        one, other = (deviations(*ahead(10, True, sigma=sigma, inflation=factor, **noise)) for sigma, factor in ((3.0, 1.0), (1.5, 2.0)))
        np.testing.assert_allclose(one, other, rtol=1e-12)


def test_of_joint_noise_the_part_of_those_that_are_on_counts():
    """Two compasses whose errors share a part: 1'R^-1 1, and 1/R_ii of one alone."""
    R = np.array([[0.04, 0.035], [0.035, 0.09]])
    sensors = (od.Magnetometer(1.0, name="left"), od.Magnetometer(1.0, name="right"))
    system = od.System(od.Unicycle(), sensors, joint_noise={("left", "right"): R})
    path = od.simulate(system, np.zeros(3), np.zeros((1, 2)), 1.0)
    prior = od.Prior(np.zeros(3), std=(1.0, 1.0, ANYTHING))
    expected = {(True, True): np.linalg.inv(R).sum(), (True, False): 1 / R[0, 0], (False, True): 1 / R[1, 1]}
    for on, known in expected.items():
        J = od.posterior_information(system, path, prior, active=np.array([on]))
        assert J[0, 2, 2] == pytest.approx(known, rel=1e-9)


# ---------------------------------------------------------------- any system, any noise, any mask: all samples at once

BEACONS = ((40.0, 25.0), (-30.0, 45.0))


@dataclass(frozen=True)
class Case:
    """Something to be estimated."""

    system: od.System
    path: od.Trajectory
    prior: od.Prior
    psd: np.ndarray | None
    unknown: tuple[str, ...]
    active: np.ndarray | None


def drawn_noise(random: np.random.Generator, sigma: float) -> dict[str, float]:
    """Correlations up to 0.999, constant errors of 0.1 to 1,000 sigma, factors, rates."""
    found: dict[str, float] = {}
    if random.random() < 0.7:
        found["correlation"] = float(random.choice([0.3, 0.9, 0.99, 0.999, random.uniform(0, 0.999)]))
    if random.random() < 0.5:
        found["bias_floor"] = float(sigma * 10 ** random.uniform(-1, 3))
    if random.random() < 0.3:
        found["inflation"] = float(random.uniform(0.5, 2))
    if random.random() < 0.4:
        found["rate"] = float(random.choice([1.0, 2.0]))
    return found


def drawn_sensors(random: np.random.Generator, limits: bool) -> list[AbstractSensor]:
    found: list[AbstractSensor] = [od.GPS(2.0, **drawn_noise(random, 2.0))]
    if random.random() < 0.6:
        found.append(od.Magnetometer(0.2, **drawn_noise(random, 0.2)))
    for make, beacon, sigma in ((od.Range, BEACONS[0], 1.0), (od.Bearing, BEACONS[1], 0.05)):
        if random.random() < 0.6:
            more = {"max_range": 45.0} if limits and random.random() < 0.3 else {}
            more |= {"sigma_per_metre": 0.03 * sigma} if random.random() < 0.3 else {}
            found.append(make(beacon, sigma, **drawn_noise(random, sigma), **more))
    return found


def drawn_system(random: np.random.Generator, limits: bool) -> od.System:
    vehicles = (od.Dubins(15.0), od.Dubins(15.0, wind="constant"), od.Dubins(15.0, wind="unknown"), od.Unicycle(wind="unknown"))
    vehicle, sensors, joint = vehicles[random.integers(4)], drawn_sensors(random, limits), {}
    if len(sensors) > 1 and random.random() < 0.5:
        which = sorted(random.choice(len(sensors), int(random.integers(2, len(sensors) + 1)), replace=False))
        for i in which:
            still = {"sigma_per_metre": 0.0} if hasattr(sensors[i], "sigma_per_metre") else {}
            sensors[i] = replace(sensors[i], correlation=0.0, **still)
        sigmas = np.concatenate([[sensors[i].sigma] * len(sensors[i].outputs) for i in which])
        factor = random.standard_normal((len(sigmas), len(sigmas))) + random.choice([0.3, 1.0, 3.0]) * np.eye(len(sigmas))
        joint = {tuple(sensors[i].name for i in which): factor @ factor.T * np.outer(sigmas, sigmas)}
    return od.System(vehicle, tuple(sensors), joint_noise=joint)


def drawn_case(seed: int, limits: bool = True, known: bool = False) -> Case:
    """limits: sensors may see only so far; known: no unknown inputs, and a path without any."""
    random = np.random.default_rng(seed)
    system = drawn_system(random, limits)
    model, steps, step = system.model, int(random.integers(2, 12)), 0.5
    n = len(model.states)
    u = random.uniform(-0.6, 0.6, (steps, len(model.inputs)))
    if len(model.inputs) == 2:
        u[:, 0] = random.uniform(5, 15, steps)
    w = random.normal(0, 2, (steps, len(model.unknown_inputs)))
    path = od.simulate(system, np.array([3.0, -1.0, 0.4, 2.0, -1.0])[:n], u, step, None if known or random.random() < 0.5 else w)
    factor = (random.standard_normal((n, n)) + 2 * np.eye(n)) * 10 ** random.uniform(-1, 2, n)[:, None]
    psd = 10.0 ** random.uniform(-4, 1, n) * (random.random(n) < 0.7) if random.random() < 0.6 else None
    unknown = tuple(signal.name for signal in model.unknown_inputs) if random.random() < 0.7 and not known else ()
    active = random.random((steps, len(system.sensors))) < random.uniform(0.5, 1) if random.random() < 0.6 else None
    return Case(system, path, od.Prior(path.x[0], covariance=factor @ factor.T), psd, unknown, active)


def worst_error(case: Case) -> float:
    """Of J at some instants, of what each entry would be if nothing were unknown."""
    try:
        J = od.posterior_information(case.system, case.path, case.prior, case.psd, case.unknown, case.active)
    except od.InputError as refused:
        assert "unknown_inputs" in str(refused)
        return 0.0
    stack, due = stacked(case.system, case.path, case.prior, case.psd, case.unknown)
    plain, _ = stacked(case.system, case.path, case.prior, case.psd, ())
    on = due if case.active is None else due & case.active[:, list(case.system.model.output_owner)]
    worst = 0.0
    for k in sorted({0, 1, case.path.steps // 2, case.path.steps - 1, case.path.steps}):
        expected, size = stack.information(k, on), np.sqrt(np.diag(plain.information(k, on)))
        worst = max(worst, float(np.abs((J[k] - expected) / np.outer(size, size)).max()))
    return worst


@pytest.mark.parametrize("seed", range(16))
def test_the_posterior_is_that_of_all_samples_at_once(seed: int):
    """Covariance of all samples in full, correlation by correlation, conditioned upon with 4,000 bits."""
    assert worst_error(drawn_case(seed)) < 1e-8


def worst_input_error(case: Case) -> float:
    """Of what is known of unknown inputs, of what would be known if the state at the start were (and errors as they are)."""
    try:
        found = od.unknown_input_information(case.system, case.path, case.prior, case.psd, case.unknown, case.active)
    except od.InputError as refused:
        assert "unknown_inputs" in str(refused)
        return 0.0
    stack, due = stacked(case.system, case.path, case.prior, case.psd, case.unknown)
    sure = replace(stack, prior=1e-18 * stack.prior)
    on = due if case.active is None else due & case.active[:, list(case.system.model.output_owner)]
    worst = 0.0
    for k in sorted({0, case.path.steps // 2, case.path.steps - 1}):
        expected, size = stack.input_information(k, on), np.sqrt(np.diag(sure.input_information(k, on)))
        worst = max(worst, float((np.abs(found[k] - expected) / (np.outer(size, size) + 1e-12)).max()))
    return worst


def blown_case(seed: int) -> Case:
    """With unknown inputs in any case."""
    case = drawn_case(seed)
    vehicle = (od.Dubins(15.0, wind="unknown"), od.Unicycle(wind="unknown"))[seed % 2]
    system = od.System(vehicle, case.system.sensors, joint_noise=case.system.joint_noise)
    random, steps = np.random.default_rng(seed), case.path.steps
    u = random.uniform(-0.6, 0.6, (steps, 1 + seed % 2)) + ([10.0, 0.0] if seed % 2 else 0.0)
    path = od.simulate(system, (3.0, -1.0, 0.4), u, 0.5, random.normal(0, 2, (steps, 2)))
    prior = od.Prior(path.x[0], covariance=case.prior.covariance[:3, :3])
    return Case(system, path, prior, None if case.psd is None else case.psd[:3], ("wind_x", "wind_y"), case.active)


@pytest.mark.parametrize("seed", range(10))
def test_what_is_known_of_unknown_inputs_is_that_of_all_samples_at_once(seed: int):
    assert worst_input_error(blown_case(seed)) < 1e-7


@pytest.mark.slow
def test_what_is_known_of_unknown_inputs_is_that_of_all_samples_at_once_for_hundreds_of_systems():
    worst = {seed: worst_input_error(blown_case(seed)) for seed in range(1000, 1200)}
    assert max(worst.values()) < 1e-7, worst


@pytest.mark.slow
@pytest.mark.parametrize("hundred", range(4))
def test_the_posterior_is_that_of_all_samples_at_once_for_hundreds_of_systems(hundred: int):
    worst = {seed: worst_error(drawn_case(seed)) for seed in range(1000 + 100 * hundred, 1100 + 100 * hundred)}
    assert max(worst.values()) < 1e-8, worst


@pytest.mark.parametrize("seed", range(12))
def test_without_process_noise_the_posterior_is_the_prior_and_the_gramian_carried_to_the_end(seed: int):
    """Phi^-T (P_0^-1 + W) Phi^-1, W whitened forwards and J by nuisance states: two ways that share nothing."""
    case = drawn_case(seed, known=True)
    information = od.variational_gramian(case.system, case.path)
    J = od.posterior_information(case.system, case.path, case.prior)[-1]
    back = np.linalg.inv(information.transition)
    expected = back.T @ (case.prior.information + information.total) @ back
    size = np.sqrt(np.diag(expected))
    np.testing.assert_allclose((J - expected) / np.outer(size, size), 0.0, atol=1e-8)


# ---------------------------------------------------------------- the filter's own model


def along_the_path(case: Case) -> tuple[FilterBank, Belief, np.ndarray, np.ndarray]:
    """A filter that is fed with what it expects, and so stays on the path: y (N, 1, q), on (N, q)."""
    system, path = case.system, case.path
    n = path.x.shape[1]
    _, due = stacked(system, path, case.prior, None, ())
    on = due if case.active is None else due & case.active[:, list(system.model.output_owner)]
    y = readings(system, path.x[None, :-1]).y[0][:, None]
    noise = np.zeros((n, n)) if case.psd is None else np.diag(case.psd) * path.step
    return (
        FilterBank(system, path.step, noise, substeps_along(system, path)),
        Belief(path.x[:1], case.prior.covariance[None]),
        y,
        on,
    )


def filter_error(case: Case) -> float:
    """Of the filter's covariance, in its own standard deviations, from the inverse of the posterior information."""
    estimator, first, y, on = along_the_path(case)
    found = estimator.run(first, case.path.u, y, on)
    np.testing.assert_allclose(found.mean[:, 0], case.path.x, atol=1e-6)
    P = np.linalg.inv(od.posterior_information(case.system, case.path, case.prior, case.psd, active=case.active))
    size = np.sqrt(np.diagonal(P, axis1=1, axis2=2))
    return float(np.abs((found.covariance[:, 0] - P) / (size[:, :, None] * size[:, None, :])).max())


@pytest.mark.parametrize("seed", range(16))
def test_the_covariance_of_the_filter_is_the_inverse_of_the_posterior_information(seed: int):
    assert filter_error(drawn_case(seed, limits=False, known=True)) < 1e-7


@pytest.mark.slow
def test_the_covariance_of_the_filter_is_the_inverse_of_the_posterior_information_for_hundreds_of_systems():
    worst = {seed: filter_error(drawn_case(seed, limits=False, known=True)) for seed in range(1000, 1300)}
    assert max(worst.values()) < 1e-7, worst


@pytest.mark.parametrize("seed", range(6))
def test_step_by_step_the_filter_keeps_what_it_has_learned_of_the_errors(seed: int):
    case = drawn_case(seed, limits=False, known=True)
    estimator, belief, y, on = along_the_path(case)
    y = y + np.random.default_rng(seed).standard_normal(y.shape) * 0.1
    together = estimator.run(belief, case.path.u, y, on)
    for k in range(case.path.steps):
        belief = estimator.update(belief, y[k], on[k])
        np.testing.assert_allclose(belief.mean, together.mean[k], rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(belief.covariance, together.covariance[k], rtol=1e-6, atol=1e-9)
        belief = estimator.predict(belief, case.path.u[k])
    np.testing.assert_allclose(belief.mean, together.mean[-1], rtol=1e-9, atol=1e-9)


def test_the_program_of_a_design_for_one_sensor_of_two_outputs_has_the_information_of_its_path():
    system = od.System(od.Dubins(15.0, wind="constant"), (od.GPS(2.0, correlation=0.9, bias_floor=0.5),))
    start, bounds = (0.0, 0.0, 0.0, 1.0, 1.0), {"turn_rate": (-0.5, 0.5)}
    # sub-steps are those of the bounds there, those of the inputs here: as exact as is asked, and no more alike than that
    problem = od.DesignProblem(system, start, 10.0, 0.5, od.PiecewiseConstant(4), bounds, tolerance=1e-11)
    p = np.array([0.3, -0.2, 0.4, 0.1])
    total = od.variational_gramian(system, od.simulate(system, start, np.repeat(p, 5)[:, None], 0.5, tolerance=1e-11)).total
    assert np.linalg.eigvalsh(total)[0] > 0.1
    np.testing.assert_allclose(Program(problem).evaluate(p).matrices[0], total, rtol=1e-9, atol=1e-9 * total.max())


# ---------------------------------------------------------------- both against draws

R_JOINT = np.array([[4.0, 1.0, 0.2], [1.0, 4.0, -0.1], [0.2, -0.1, 0.04]])
NOISY = {
    "correlated": od.System(od.Dubins(15.0, wind="constant"), (od.GPS(2.0, correlation=0.9, rate=1.0), od.Magnetometer(0.05))),
    "constant": od.System(od.Dubins(15.0, wind="constant"), (od.GPS(1.0, bias_floor=4.0), od.Magnetometer(0.05, bias_floor=0.03))),
    "both": od.System(
        od.Dubins(15.0, wind="constant"), (od.GPS(1.0, correlation=0.95, bias_floor=2.0), od.Magnetometer(0.05, correlation=0.8))
    ),
    "joint": od.System(
        od.Dubins(15.0, wind="constant"), (od.GPS(2.0), od.Magnetometer(0.2)), joint_noise={("gps", "magnetometer"): R_JOINT}
    ),
}
RUNS = 400


@pytest.mark.parametrize("name", NOISY)
@pytest.mark.parametrize("scheduled", [False, True], ids=["all on", "on and off"])
def test_the_filter_reaches_the_bound_and_knows_how_well_it_does(name: str, scheduled: bool):
    """R nees is chi-square with R n degrees of freedom, R rmse^2 / bound^2 with R: within five standard deviations at every instant.

    The prior is tight enough for the system to be linear about the path as far as this can tell.
    """
    system = NOISY[name]
    path = od.simulate(system, (0.0, 0.0, 0.3, 2.0, -1.0), 0.3 * np.sin(np.arange(32) / 4), 0.5)
    prior = od.Prior(path.x[0], std=(3.0, 3.0, 0.03, 0.5, 0.5))
    schedule = np.array([[True, True], [False, True], [True, False], [True, True]]) if scheduled else None
    check = od.validate(system, path, schedule, prior=prior, runs=RUNS, seed=4, disturbance_psd=(0.01, 0.01, 1e-5, 1e-3, 1e-3))
    np.testing.assert_allclose(check.nees, 5.0, atol=5 * math.sqrt(2 * 5 / RUNS))
    np.testing.assert_allclose(np.square(check.rmse / check.bound), 1.0, atol=5 * math.sqrt(2 / RUNS))
    assert check.consistent


def test_joint_errors_of_the_truth_have_their_covariance_at_each_instant_and_none_between():
    system = NOISY["joint"]
    path = od.simulate(system, np.zeros(5), np.zeros((4, 1)), 0.5)
    task = _MonteCarloTask(
        system,
        path,
        od.Prior(path.x[0], std=np.ones(5)),
        np.ones((4, 2), dtype=bool),
        ProcessNoise(((),) * 5),
        1,
        range(4000),
        od.ExtendedKalmanFilter(),
        None,
    )
    before, constant, *white = np.random.default_rng(2).standard_normal((4002, 3))
    flown = measurement_noise(system.model, np.array(white), constant, np.ones((4000, 3), dtype=bool), before)
    spread = np.sqrt(np.diag(R_JOINT))
    for noise in (
        np.stack([_draws(task, run)[2] for run in task.runs]) * spread,
        flown.varying.reshape(1000, 4, 3) * spread,
    ):
        runs, size = len(noise), np.outer(spread, spread)
        for k in range(4):
            np.testing.assert_allclose(noise[:, k].T @ noise[:, k] / runs / size, R_JOINT / size, atol=5 * math.sqrt(2 / runs))
        assert np.abs(noise[:, 0].T @ noise[:, 1] / runs / size).max() < 5 / math.sqrt(runs)


@pytest.mark.parametrize("name", ["both", "joint"])
def test_the_filter_of_a_flight_knows_how_well_it_does(name: str):
    """Flown step by step, with what has been learned of the errors carried from one to the next: R nees is chi-square at every instant."""
    system, runs, steps = NOISY[name], 150, 12
    problem = od.DesignProblem(system, (0.0, 0.0, 0.3, 2.0, -1.0), 6.0, 0.5, od.PiecewiseConstant(2), {"turn_rate": (-0.3, 0.3)})
    prior = od.Prior(problem.x0, std=(3.0, 3.0, 0.03, 0.5, 0.5))
    noise = flying.noise_of(system.model, (0.01, 0.01, 1e-5, 1e-3, 1e-3), None, 0.5)
    estimator, nees = FilterBank(system, 0.5, noise), np.zeros((runs, steps + 1))
    for seed in range(runs):
        world = flying._draw_realisation(problem, prior, None, noise, steps, seed)
        nees[seed] = flying._simulate_flight(
            flying._Simulation(problem, prior, estimator, world), lambda k, *_: np.array([0.3 * (-1) ** k])
        ).nees
    np.testing.assert_allclose(nees.mean(axis=0), 5.0, atol=5 * math.sqrt(2 * 5 / runs))
