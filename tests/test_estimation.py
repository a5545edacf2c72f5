"""The filter against a textbook, its promise against Monte Carlo, and Monte Carlo against its own seed."""

from __future__ import annotations

import math
import multiprocessing
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor

import casadi as ca
import numpy as np
import pytest
from distributed import LocalCluster
from scipy.integrate import solve_ivp
from scipy.stats import chi2

import obsdesign as od
from obsdesign.dynamics.measurement_noise import MeasurementNoise
from obsdesign.dynamics.process_noise import ProcessNoise
from obsdesign.dynamics.simulation import substeps_along
from obsdesign.estimation.filter_bank import Belief, FilterBank
from obsdesign.estimation.validation import CONSISTENT_SHARE, SETTLING_SHARE, _assess_consistency
from obsdesign.planning import closed_loop as flight

# ---------------------------------------------------------------- a linear system and the textbook

A = np.array([[-0.3, 1.2, 0.1], [-0.9, -0.2, 0.4], [0.0, 0.1, -0.05]])
B = np.array([[0.0], [1.0], [0.2]])
H = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, -1.0]])
SIGMAS = np.array([0.3, 0.5])
PSD = np.array([[0.05, 0.01, 0.0], [0.01, 0.04, -0.005], [0.0, -0.005, 0.02]])
COVARIANCE = np.array([[2.0, 0.5, 0.1], [0.5, 1.0, -0.2], [0.1, -0.2, 0.5]])
STEP, STEPS = 0.2, 24


def linear_system() -> od.ControlAffineSystem:
    x = ca.SX.sym("x", 3)
    outputs = {"first": H[:1] @ x, "second": H[1:] @ x}
    sigmas = dict(zip(outputs, SIGMAS, strict=True))
    return od.ControlAffineSystem(x, ("a", "b", "c"), ca.SX(A) @ x, {"push": ca.SX(B)}, outputs=outputs, sigmas=sigmas)


LINEAR = linear_system()
PRIOR = od.Prior((1.0, -1.0, 0.5), covariance=COVARIANCE)
PATH = od.simulate(LINEAR, PRIOR.mean, np.sin(np.arange(STEPS)), STEP)
PROCESS_NOISE = PSD * STEP


def exact_matrices() -> tuple[np.ndarray, np.ndarray]:
    """x+ = F x + G u of a linear system with its input held: F = sum (A h)^i / i!, G = h sum (A h)^i / (i + 1)! B."""
    powers = [np.linalg.matrix_power(STEP * A, i) for i in range(25)]
    F = sum(power / math.factorial(i) for i, power in enumerate(powers))
    G = STEP * sum(power / math.factorial(i + 1) for i, power in enumerate(powers)) @ B
    return F, G


def textbook(mean: np.ndarray, y: np.ndarray, active: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Kalman filter: after the update at t_k for k < N, predicted at t_N."""
    F, G = exact_matrices()
    P = COVARIANCE
    for k in range(STEPS):
        C, R = H[active[k]], np.diag(SIGMAS[active[k]] ** 2)
        K = P @ C.T @ np.linalg.inv(C @ P @ C.T + R)
        mean = mean + K @ (y[k, active[k]] - C @ mean)
        P = (np.eye(3) - K @ C) @ P
        yield mean, P
        mean = F @ mean + G @ PATH.u[k]
        P = F @ P @ F.T + PROCESS_NOISE
    yield mean, P


def filtered(y: np.ndarray, active: np.ndarray, means: np.ndarray) -> list[Belief]:
    """The package's filter for several runs at once."""
    runs = len(means)
    found = FilterBank(LINEAR, STEP, PROCESS_NOISE, substeps_along(LINEAR, PATH)).run(
        Belief(means, np.tile(COVARIANCE, (runs, 1, 1))), PATH.u, y, active
    )
    return [Belief(mean, covariance) for mean, covariance in zip(found.mean, found.covariance, strict=True)]


@pytest.mark.parametrize("every", [True, False], ids=["all sensors", "some sensors"])
def test_on_a_linear_system_the_filter_is_the_kalman_filter(every: bool):
    random = np.random.default_rng(0)
    active = np.ones((STEPS, 2), dtype=bool) if every else random.random((STEPS, 2)) < 0.4
    y, means = random.standard_normal((STEPS, 3, 2)), random.standard_normal((3, 3))
    beliefs = filtered(y, active, means)
    assert len(beliefs) == STEPS + 1
    for run in range(3):
        for belief, (mean, P) in zip(beliefs, textbook(means[run], y[:, run], active), strict=True):
            np.testing.assert_allclose(belief.mean[run], mean, rtol=1e-9, atol=1e-9)
            np.testing.assert_allclose(belief.covariance[run], P, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("every", [True, False], ids=["all sensors", "some sensors"])
def test_on_a_linear_system_the_covariance_is_the_inverse_of_the_posterior_information(every: bool):
    random = np.random.default_rng(1)
    active = np.ones((STEPS, 2), dtype=bool) if every else random.random((STEPS, 2)) < 0.4
    beliefs = filtered(random.standard_normal((STEPS, 1, 2)), active, np.zeros((1, 3)))
    J = od.posterior_information(LINEAR, PATH, PRIOR, disturbance_psd=PSD, active=active)
    np.testing.assert_allclose([belief.covariance[0] for belief in beliefs], np.linalg.inv(J), rtol=1e-9, atol=1e-9)


def test_filters_side_by_side_do_not_know_of_each_other():
    """Three runs at once are three runs one by one, of a system whose matrices differ from run to run."""
    system = od.System(od.Dubins(15.0, wind="constant"), (od.GPS(2.0), od.Range((40.0, 25.0), 1.0), od.Bearing((40.0, 25.0), 0.1)))
    random, noise = np.random.default_rng(2), 0.01 * np.eye(5)
    means = np.array([3.0, -1.0, 0.4, 2.0, -1.0]) + random.standard_normal((3, 5))
    covariances = np.stack([np.diag(random.uniform(0.5, 2.0, 5)) for _ in means])
    u, y, active = random.uniform(-0.5, 0.5, (4, 1)), random.standard_normal((4, 3, 4)), random.random((4, 4)) < 0.7
    estimator = FilterBank(system, 0.5, noise)
    together = estimator.run(Belief(means, covariances), u, y, active)
    for run in range(3):
        one = slice(run, run + 1)
        alone = estimator.run(Belief(means[one], covariances[one]), u, y[:, one], active)
        np.testing.assert_array_equal(together.mean[:, one], alone.mean)
        np.testing.assert_array_equal(together.covariance[:, one], alone.covariance)


def test_a_prediction_moves_the_mean_as_the_simulation_does():
    system = od.System(od.Dubins(15.0, wind="constant"), (od.GPS(2.0),))
    path = od.simulate(system, (1.0, 2.0, 0.5, 3.0, -1.0), [0.4], 0.5)
    estimator = FilterBank(system, 0.5, np.zeros((5, 5)))
    belief = estimator.predict(Belief(path.x[:1], np.eye(5)[None]), path.u[0])
    np.testing.assert_allclose(belief.mean[0], path.x[1], rtol=1e-14)


# ---------------------------------------------------------------- angles

COMPASS = od.System(od.Unicycle(), (od.Magnetometer(0.1),))


def turned(heading: float, reading: float) -> Belief:
    """One compass update of a heading known to 0.1 rad."""
    estimator = FilterBank(COMPASS, 0.1, np.zeros((3, 3)))
    first = Belief(np.array([[0.0, 0.0, heading]]), np.diag([1.0, 1.0, 0.01])[None])
    return estimator.update(first, np.array([[reading]]), np.array([True]))


@pytest.mark.parametrize(("heading", "reading"), [(3.13, -3.13), (-3.13, 3.13), (3.13, 3.13), (0.2, 0.2 + 6 * np.pi), (9.5, -3.0)])
def test_residuals_of_angles_wrap(heading: float, reading: float):
    """Equal variances: the estimate moves half of the short way to the reading."""
    short_way = math.remainder(reading - heading, 2 * np.pi)
    belief = turned(heading, reading)
    assert abs(short_way) < 0.2
    assert belief.mean[0, 2] == pytest.approx(heading + short_way / 2, abs=1e-12)
    assert belief.covariance[0, 2, 2] == pytest.approx(0.005, rel=1e-12)


def test_a_beacon_dead_astern_does_not_throw_the_filter():
    """The bearing is near pi: its noise crosses the cut, the errors must not."""
    system = od.System(od.Unicycle(), (od.GPS(1.0), od.Bearing((0.0, 0.0), 0.05)))
    path = od.simulate(system, (50.0, 0.0, 0.0), np.tile([5.0, 0.0], (20, 1)), 0.5)
    check = od.validate(system, path, prior=od.Prior(path.x[0], std=(1.0, 1.0, 0.05)), runs=100)
    assert check.rmse[:, 2].max() < 0.06
    assert check.consistent


def test_a_guess_some_whole_turns_off_is_no_error():
    """The prior knows nothing of the heading, the compass all: what is left is its noise, whatever turn the guess was on."""
    path = od.simulate(COMPASS, (0.0, 0.0, 3.0), np.zeros((4, 2)), 0.5)
    check = od.validate(COMPASS, path, prior=od.Prior(path.x[0], std=(1.0, 1.0, 20.0)), runs=400)
    expected = 0.1 / np.sqrt(np.array([1, 2, 3, 4, 4]))
    np.testing.assert_allclose(check.bound[:, 2], expected, rtol=1e-4)
    np.testing.assert_allclose(np.square(check.rmse[:, 2] / expected), 1.0, atol=5 * np.sqrt(2 / 400))


def test_headings_a_whole_turn_apart_are_the_same_heading():
    system = od.System(od.Unicycle(), (od.GPS(1.0), od.Magnetometer(0.1)))
    checks = []
    for heading in (np.pi - 0.01, -np.pi - 0.01):
        path = od.simulate(system, (0.0, 0.0, heading), np.tile([5.0, 0.0], (20, 1)), 0.5)
        checks.append(od.validate(system, path, prior=od.Prior(path.x[0], std=(1.0, 1.0, 0.3)), runs=40))
    np.testing.assert_allclose(checks[0].rmse, checks[1].rmse, rtol=1e-9)
    np.testing.assert_allclose(checks[0].nees, checks[1].nees, rtol=1e-9)


# ---------------------------------------------------------------- Monte Carlo keeps its promises

RUNS = 600


@pytest.fixture(scope="module")
def linear_check() -> od.Validation:
    return od.validate(LINEAR, PATH, prior=PRIOR, disturbance_psd=PSD, runs=RUNS, seed=3)


def test_on_a_linear_system_the_filter_is_consistent(linear_check: od.Validation):
    """R nees is chi-square with R n degrees of freedom at every instant: mean n, standard deviation sqrt(2 n / R)."""
    np.testing.assert_allclose(linear_check.nees, 3.0, atol=5 * np.sqrt(2 * 3 / RUNS))
    assert linear_check.verdict == "consistent"
    assert linear_check.consistent


def test_on_a_linear_system_the_error_is_the_bound(linear_check: od.Validation):
    """R rmse^2 / bound^2 is chi-square with R degrees of freedom."""
    ratio = np.square(linear_check.rmse / linear_check.bound)
    assert ratio.shape == (STEPS + 1, 3)
    np.testing.assert_allclose(ratio, 1.0, atol=5 * np.sqrt(2 / RUNS))


def test_the_bound_is_the_posterior_standard_deviation(linear_check: od.Validation):
    J = od.posterior_information(LINEAR, PATH, PRIOR, disturbance_psd=PSD)
    np.testing.assert_allclose(linear_check.bound, np.sqrt(np.diagonal(np.linalg.inv(J), axis1=1, axis2=2)), rtol=1e-9)


def test_the_filter_starts_at_a_draw_from_the_prior():
    """A prior far tighter than the sensors, and strongly correlated: at t_0 errors and NEES are those of its draws."""
    correlated = np.full((3, 3), 0.95) + 0.05 * np.eye(3)
    tight = od.Prior(PRIOR.mean, covariance=1e-6 * correlated * np.outer((1.0, 3.0, 0.2), (1.0, 3.0, 0.2)))
    check = od.validate(LINEAR, PATH, prior=tight, runs=RUNS)
    np.testing.assert_allclose(np.square(check.rmse[0] / tight.std), 1.0, atol=5 * np.sqrt(2 / RUNS))
    assert check.nees[0] == pytest.approx(3.0, abs=5 * np.sqrt(2 * 3 / RUNS))


def test_the_band_holds_95_per_cent_of_chi_square(linear_check: od.Validation):
    low, high = linear_check.nees_interval
    assert chi2.cdf(RUNS * low, RUNS * 3) == pytest.approx(0.025, rel=1e-9)
    assert chi2.sf(RUNS * high, RUNS * 3) == pytest.approx(0.025, rel=1e-9)


def test_gps_on_a_straight_line_makes_the_filter_overconfident():
    """Heading and wind cannot be told apart there (rank 4), but linearising at changing estimates feigns information."""
    system = od.System(od.Dubins(15.0, wind="constant"), (od.GPS(2.0),))
    path = od.simulate(system, (0.0, 0.0, 0.6, 2.0, 1.0), np.zeros(40), 0.5)
    check = od.validate(system, path, prior=od.Prior(path.x[0], std=(10.0, 10.0, 0.8, 4.0, 4.0)), runs=60)
    assert check.verdict == "overconfident"
    assert not check.consistent
    assert check.in_band < 0.1
    assert check.nees[-1] > 10 * 5


# ---------------------------------------------------------------- along the path that is given


def test_errors_on_a_linear_system_are_those_of_any_path():
    """e+ = F (I - K C) e + noise knows nothing of the path, so slips of it change nothing, however far they lead."""
    slipping = PATH.x + np.cumsum(np.random.default_rng(3).standard_normal(PATH.x.shape) * 30.0, axis=0)
    path = od.Trajectory(PATH.t, slipping, PATH.u)
    for psd in (None, PSD):
        along_inputs = od.validate(LINEAR, PATH, prior=PRIOR, disturbance_psd=psd, runs=RUNS)
        along_slips = od.validate(LINEAR, path, prior=PRIOR, disturbance_psd=psd, runs=RUNS)
        np.testing.assert_array_equal(along_slips.bound, along_inputs.bound)
        tolerance = 1e-7 if psd is None else 5 * np.sqrt(2 / RUNS)
        np.testing.assert_allclose(np.square(along_slips.rmse / along_inputs.rmse), 1.0, atol=2 * tolerance)
        np.testing.assert_allclose(along_slips.nees, 3.0, atol=5 * np.sqrt(2 * 3 / RUNS))


def test_the_truth_keeps_to_a_driven_path():
    """By its inputs the vehicle drives away from a beacon of limited range; where it really went, the beacon is in sight to the end."""
    system = od.System(od.Unicycle(), (od.Range((40.0, 60.0), 0.1, max_range=90.0), od.Range((90.0, -20.0), 0.1), od.Magnetometer(0.05)))
    u = np.tile([5.0, 0.0], (100, 1))
    straight = od.simulate(system, (0.0, 0.0, 0.0), u, 0.5)
    turned = np.column_stack([np.arange(101) * 0.5, np.linspace(0.0, 60.0, 101), np.linspace(0.0, 0.8, 101)])
    path = od.Trajectory(straight.t, turned, u)
    assert np.hypot(*(straight.x[-1, :2] - path.x[-1, :2])) > 190
    check = od.validate(system, path, prior=od.Prior(path.x[0], std=(1.0, 1.0, 0.1)), runs=100, disturbance_psd=(0.01, 0.01, 0.001))
    assert check.consistent
    np.testing.assert_allclose(np.square(check.rmse / check.bound), 1.0, atol=6 * np.sqrt(2 / 100))
    bound = od.posterior_information(system, path, od.Prior(path.x[0], std=(1.0, 1.0, 0.1)), (0.01, 0.01, 0.001))
    np.testing.assert_allclose(check.bound, od.standard_deviations(bound), rtol=1e-12)


def test_a_driven_path_of_steps_of_any_length_is_validated():
    """Unequal steps on the linear system against its textbook: NEES of n, errors at the bound."""
    lengths = np.random.default_rng(6).uniform(0.05, 0.4, STEPS)
    path = od.simulate(LINEAR, PRIOR.mean, PATH.u, lengths)
    check = od.validate(LINEAR, path, prior=PRIOR, disturbance_psd=PSD, runs=RUNS)
    np.testing.assert_allclose(np.square(check.rmse / check.bound), 1.0, atol=5 * np.sqrt(2 / RUNS))
    np.testing.assert_allclose(check.nees, 3.0, atol=5 * np.sqrt(2 * 3 / RUNS))


def test_other_estimators_are_validated_by_the_same_flights():
    """On a linear system the unscented filter errs as the extended one does, to rounding; a smoother less than both, and knows it."""
    checks = [
        od.validate(LINEAR, PATH, prior=PRIOR, disturbance_psd=PSD, runs=100, estimator=estimator)
        for estimator in (None, od.UnscentedKalmanFilter(), od.FixedIntervalSmoother())
    ]
    np.testing.assert_allclose(checks[1].rmse, checks[0].rmse, rtol=1e-7)
    np.testing.assert_allclose(checks[1].nees, checks[0].nees, rtol=1e-6)
    assert (checks[2].rmse[:-2] < checks[0].rmse[:-2]).all()
    np.testing.assert_allclose(checks[2].nees, 3.0, atol=5 * np.sqrt(2 * 3 / 100))


# ---------------------------------------------------------------- the verdict, on NEES made by hand

N_STATES, N_RUNS = 4, 100
TIMES = np.linspace(10.0, 50.0, 41)


def judged(average: np.ndarray) -> od.Validation:
    """The verdict on run-averaged NEES (N+1,), the same in every run."""
    nothing = np.ones((len(TIMES), N_STATES))
    return _assess_consistency(TIMES, nothing, nothing, np.tile(average[:, None], N_RUNS), seed=0)


@pytest.mark.parametrize(("factor", "verdict"), [(1.0, "consistent"), (3.0, "overconfident"), (0.3, "underconfident")])
def test_the_verdict_on_errors_that_are_what_the_covariance_says_or_more_or_less(factor: float, verdict: str):
    random = np.random.default_rng(0)
    nees = factor * random.chisquare(N_STATES, (len(TIMES), N_RUNS))
    nothing = np.ones((len(TIMES), N_STATES))
    check = _assess_consistency(TIMES, nothing, nothing, nees, seed=0)
    assert check.verdict == verdict
    np.testing.assert_allclose(check.nees, nees.mean(axis=1), rtol=1e-12)


def test_only_what_comes_after_the_first_quarter_is_judged():
    average = np.full(len(TIMES), float(N_STATES))
    assert SETTLING_SHARE == 0.25
    average[:10] = 1e6  # one instant per second, forty seconds
    assert judged(average).in_band == 1.0
    average[-1] = 1e6
    assert judged(average).in_band == pytest.approx(30 / 31)


@pytest.mark.parametrize(("above", "below", "verdict"), [(10, 0, "consistent"), (11, 0, "overconfident"), (0, 11, "underconfident")])
def test_at_least_65_per_cent_of_the_instants_must_lie_in_the_band(above: int, below: int, verdict: str):
    """31 instants count: 21 of them are 67 per cent, 20 are 64.5."""
    average = np.full(len(TIMES), float(N_STATES))
    average[len(TIMES) - above :] = 10.0 * N_STATES
    average[len(TIMES) - below :] = 0.1 * N_STATES
    check = judged(average)
    assert check.verdict == verdict
    assert check.consistent == (check.in_band >= CONSISTENT_SHARE)
    assert CONSISTENT_SHARE == 0.65


# ---------------------------------------------------------------- the same seed, the same bytes


class Backwards(Executor):
    """Does the last task first."""

    def map(self, function: Callable[..., object], *arguments: Iterable[object], **_: object) -> Iterator[object]:
        tasks = list(zip(*arguments, strict=True))
        return iter([function(*task) for task in reversed(tasks)][::-1])


def in_bytes(check: od.Validation) -> tuple[object, ...]:
    arrays = tuple(values.tobytes() for values in (check.t, check.rmse, check.bound, check.nees))
    return *arrays, check.nees_interval, check.in_band, check.verdict, check.runs, check.seed


def flown(executor: Executor | None, seed: int = 5, system: object = LINEAR) -> od.Validation:
    """120 runs: two whole chunks and a part of one."""
    return od.validate(system, PATH, prior=PRIOR, runs=120, seed=seed, executor=executor, disturbance_psd=PSD)


def test_any_executor_gives_the_same_bytes():
    alone = in_bytes(flown(None))
    assert in_bytes(flown(None)) == alone
    assert in_bytes(flown(Backwards())) == alone
    with ThreadPoolExecutor(1) as threads:
        assert in_bytes(flown(threads)) == alone
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as processes:
        assert in_bytes(flown(processes)) == alone


def test_another_seed_gives_other_errors_under_the_same_bound():
    first, second = flown(None, seed=5), flown(None, seed=6)
    assert not np.any(first.rmse == second.rmse)
    np.testing.assert_array_equal(first.bound, second.bound)
    assert (first.seed, second.seed) == (5, 6)


# ---------------------------------------------------------------- schedules

BEACON = (40.0, 25.0)
FLIGHT = od.System(od.Dubins(15.0, wind="constant"), (od.GPS(2.0, rate=1.0), od.Range(BEACON, 1.0)))
TURNING = od.simulate(FLIGHT, (0.0, 0.0, 0.4, 2.0, 1.0), 0.5 * np.sin(np.arange(12)), 0.5)
FLIGHT_PRIOR = od.Prior(TURNING.x[0], std=(5.0, 5.0, 0.1, 1.0, 1.0))
SEGMENTS = np.array([[True, False], [False, True], [True, True], [False, False]])


def scheduled(schedule: object, system: od.System = FLIGHT) -> od.Validation:
    return od.validate(system, TURNING, schedule, prior=FLIGHT_PRIOR, runs=20)


def test_no_schedule_is_all_sensors_on():
    everything = in_bytes(scheduled(None))
    assert in_bytes(scheduled(np.ones((4, 2), dtype=bool))) == everything
    assert in_bytes(scheduled(np.ones((1, 2), dtype=bool))) == everything
    assert in_bytes(scheduled(SEGMENTS)) != everything


def test_a_schedule_may_be_a_record_an_array_or_a_list():
    blocks = od.variational_gramian(FLIGHT, TURNING).by_segment(4)
    chosen = od.select_sensors(blocks)
    found = in_bytes(scheduled(chosen))
    assert in_bytes(scheduled(chosen.chosen)) == found
    assert in_bytes(scheduled(chosen.chosen.astype(int).tolist())) == found
    assert in_bytes(scheduled(np.repeat(chosen.chosen, 3, axis=0))) == found


def test_a_sensor_that_is_off_says_nothing_and_one_that_is_on_speaks_at_its_rate():
    """The bound is the posterior of the samples that are left, counted by hand: GPS every second step, three steps a segment."""
    check = scheduled(SEGMENTS)
    active = np.zeros((12, 2), dtype=bool)
    active[[0, 2, 6, 8], 0] = True
    active[3:9, 1] = True
    every_step = od.System(FLIGHT.vehicle, (od.GPS(2.0), od.Range(BEACON, 1.0)))
    J = od.posterior_information(every_step, TURNING, FLIGHT_PRIOR, active=active)
    np.testing.assert_allclose(check.bound, np.sqrt(np.diagonal(np.linalg.inv(J), axis1=1, axis2=2)), rtol=1e-9)


def test_a_sensor_never_switched_on_is_as_good_as_none():
    only_gps = od.System(FLIGHT.vehicle, FLIGHT.sensors[:1])
    off = scheduled(np.array([[True, False]]))
    np.testing.assert_allclose(off.bound, scheduled(None, only_gps).bound, rtol=1e-12)


@pytest.mark.parametrize("shape", [(4, 3), (4, 1), (5, 2), (24, 2), (2,), (0, 2), (2, 2, 2)])
def test_a_schedule_of_the_wrong_shape_is_refused(shape: tuple[int, ...]):
    with pytest.raises(od.InputError, match=r"schedule has shape \(.*\): must be \(K, 2\), with K a divisor of 12 steps"):
        scheduled(np.ones(shape, dtype=bool))


# ---------------------------------------------------------------- bad input


@pytest.mark.parametrize("runs", [0, -3, 2.5, "many"])
def test_runs_are_counted(runs: object):
    with pytest.raises(od.InputError, match=rf"runs is {runs!r}: must be a whole number"):
        od.validate(LINEAR, PATH, prior=PRIOR, runs=runs)


def test_a_negative_seed_is_refused():
    with pytest.raises(od.InputError, match="seed is -1: must be a whole number of at least 0"):
        od.validate(LINEAR, PATH, prior=PRIOR, runs=2, seed=-1)


def test_a_prior_of_another_state_is_refused():
    with pytest.raises(od.InputError, match="prior"):
        od.validate(LINEAR, PATH, prior=FLIGHT_PRIOR, runs=2)


def test_a_path_through_a_landmark_is_refused_with_sensor_and_step():
    system = od.System(od.Dubins(1.0), (od.GPS(1.0), od.Range((3.0, 0.0), 1.0)))
    path = od.simulate(system, np.zeros(3), np.zeros(10), 0.5)
    with pytest.raises(od.InputError, match=r"'range' .* at step 6 "):
        od.validate(system, path, prior=od.Prior(np.zeros(3), std=(1.0, 1.0, 0.1)), runs=2)


def test_a_path_of_another_system_is_refused():
    with pytest.raises(od.InputError, match="path has 3 states and 1 inputs: the system has 5"):
        od.validate(FLIGHT, PATH, prior=FLIGHT_PRIOR, runs=2)


def test_a_schedule_without_an_answer_is_refused():
    blocks = np.tile(np.diag([1.0, 1.0, 0.0]), (PATH.steps, 1, 1, 1))  # nothing is seen of the third state: log det is -inf
    failed = od.select_sensors(blocks, criterion=od.LogDet(), throw=False)
    assert not failed.status.has_answer
    with pytest.raises(od.InputError, match="schedule has no answer"):
        od.validate(LINEAR, PATH, failed, prior=PRIOR, runs=2)


def test_a_dask_cluster_gives_the_same_bytes():
    """What runs here in one process runs on a cluster through its executor."""
    with (
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
        cluster.get_client() as client,
    ):
        spread = od.validate(LINEAR, PATH, prior=PRIOR, runs=120, executor=client.get_executor())
    alone = od.validate(LINEAR, PATH, prior=PRIOR, runs=120)
    assert spread.rmse.tobytes() == alone.rmse.tobytes()
    assert spread.nees.tobytes() == alone.nees.tobytes()


# ---------------------------------------------------------------- steps as exact as is asked


def swinging() -> od.ControlAffineSystem:
    """A pendulum of 10 rad/s with a torque."""
    x = ca.SX.sym("x", 2)
    drift = ca.vertcat(x[1], -100 * ca.sin(x[0]))
    return od.ControlAffineSystem(x, ("angle", "rate"), drift, {"torque": ca.SX([0, 1])}, outputs={"y": x[0]})


def swung(start: tuple[float, float], seconds: float) -> np.ndarray:
    """The pendulum without a torque, integrated at order 8."""
    found = solve_ivp(lambda _, x: (x[1], -100 * np.sin(x[0])), (0.0, seconds), start, method="DOP853", rtol=1e-12, atol=1e-12)
    return found.y[:, -1]


@pytest.mark.parametrize("at_once", [True, False])
def test_a_filter_makes_as_many_sub_steps_as_its_tolerance_asks_for(at_once: bool):
    """A step of 2 rad: without samples the mean moves as the pendulum does; one step of Runge and Kutta is off by 0.1."""
    estimator = FilterBank(swinging(), 0.2, np.zeros((2, 2)))
    belief = Belief(np.array([[1.0, 0.0]]), 1e-4 * np.eye(2)[None])
    if at_once:
        mean = estimator.run(belief, np.zeros((5, 1)), np.zeros((5, 1, 1)), np.zeros((5, 1), dtype=bool)).mean[-1]
    else:
        for _ in range(5):
            belief = estimator.predict(belief, np.zeros(1))
        mean = belief.mean
    np.testing.assert_allclose(mean[0] / [1, 10], swung((1.0, 0.0), 1.0) / [1, 10], rtol=0, atol=5e-6)


def test_the_truth_of_a_flight_moves_as_the_pendulum_does():
    """Plans are made for rest, where nothing moves and one step is enough; the truth swings."""
    bounds = {"torque": (-1e-9, 1e-9)}
    problem = od.DesignProblem(
        system=swinging(), start=(0.0, 0.0), duration=1.0, step=0.2, path=od.PiecewiseConstant(1), bounds=bounds, scale=(1.0, 10.0)
    )
    still = MeasurementNoise(np.zeros((5, 1)), np.zeros(1))
    world = flight._Realisation(np.array([1.0, 0.0]), ProcessNoise(((), ())), np.zeros((5, 0)), still, np.zeros((5, 1), dtype=bool))
    estimator = FilterBank(problem.system, problem.step, np.zeros((2, 2)))
    scene = flight._Simulation(problem, od.Prior((1.0, 0.0), std=(0.1, 0.1)), estimator, world)
    flown = flight._simulate_flight(scene, lambda *_: np.zeros(1))
    for found in (flown.truth[-1], flown.mean[-1]):
        np.testing.assert_allclose(found / [1, 10], swung((1.0, 0.0), 1.0) / [1, 10], rtol=0, atol=5e-6)
