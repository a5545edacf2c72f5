"""Gramians, posterior information and priors against closed forms, identities and independent derivations."""

from __future__ import annotations

from itertools import combinations

import casadi as ca
import numpy as np
import pytest
from by_hand import ONE_STEP, numerical_rank
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

import obsdesign as od
from obsdesign.information.gramian import transition_matrices
from obsdesign.round_off import standard_deviations

few = settings(deadline=None, max_examples=8, database=None, derandomize=True)

BEACON = (40.0, 25.0)
SENSORS = (od.GPS(2.0), od.Magnetometer(0.21), od.Range(BEACON, 1.0), od.Bearing(BEACON, 0.087))
NAMES = ("gps", "magnetometer", "range", "bearing")
SPEED = 15.0
START = np.array([3.0, -1.0, 0.4, 2.0, -1.0])
ANGLE = st.floats(-3.0, 3.0)
WIND = st.floats(-4.0, 4.0)


def dubins(*sensors: object, speed: float = SPEED, wind: str | None = "constant") -> od.System:
    return od.System(od.Dubins(speed, wind=wind), sensors)


GPS_ONLY = dubins(od.GPS(1.0))
ALL_FOUR = dubins(*SENSORS)


def pendulum_system() -> od.ControlAffineSystem:
    """A driven pendulum that drives three lags: its steps dx_k+1/dx_k do not commute, those of planar vehicles do."""
    x = ca.SX.sym("x", 5)
    drift = ca.vertcat(x[1], -2 * ca.sin(x[0]) - 0.1 * x[1] + 0.2 * x[2], ca.cos(x[0]) - 0.2 * x[2], x[2] - 0.2 * x[3], ca.sin(x[3] - x[4]))
    outputs = {"angle": x[0] + 0.3 * x[2] ** 2, "rest": x[3] + x[4] * x[1]}
    return od.ControlAffineSystem(
        x, tuple("abcde"), drift, {"push": ca.vertcat(0, 1, 0, ca.cos(x[4]), 0)}, outputs=outputs, sigmas={"angle": 0.2}
    )


PENDULUM = pendulum_system()
BOTH = pytest.mark.parametrize("system", [ALL_FOUR, PENDULUM], ids=["vehicle", "pendulum"])


def turning_path(system: od.System = ALL_FOUR, steps: int = 24, step: float = 0.25, seed: int = 3) -> od.Trajectory:
    """A path under a turn rate (or push) drawn anew for each step."""
    start = START[: len(system.model.states)]
    return od.simulate(system, start, np.random.default_rng(seed).uniform(-0.6, 0.6, steps), step, tolerance=ONE_STEP)


def until(path: od.Trajectory, step: int) -> od.Trajectory:
    """The first steps of a path."""
    return od.Trajectory(path.t[: step + 1], path.x[: step + 1], path.u[:step], tolerance=path.tolerance)


def assert_close(found: np.ndarray, expected: np.ndarray, relative: float) -> None:
    """Entries agree to `relative` of sqrt(W_ii W_jj), so that no unit hides an error."""
    size = np.sqrt(np.abs(np.diagonal(expected, axis1=-2, axis2=-1)))
    scale = size[..., :, None] * size[..., None, :]
    np.testing.assert_array_less(np.abs(found - expected), relative * scale + 1e-300)


# ---------------------------------------------------------------- closed forms of the paper


def line_gramian(duration: float, speed: float, heading: float, ratio: float = 1.0) -> np.ndarray:
    """Brace and Morgansen eq. (11); ratio = sin(eps) / eps, 1 in the limit."""
    drift = ratio * speed * np.array([-np.sin(heading), np.cos(heading)])
    W = np.zeros((5, 5))
    W[:2, :2], W[3:, 3:] = duration * np.eye(2), duration**3 / 3 * np.eye(2)
    W[:2, 3:] = W[3:, :2] = duration**2 / 2 * np.eye(2)
    W[:2, 2] = W[2, :2] = duration**2 / 2 * drift
    W[3:, 2] = W[2, 3:] = duration**3 / 3 * drift
    W[2, 2] = duration**3 / 3 * drift @ drift
    return W


def circle_rows(t: float, speed: float, heading: float, turn_rate: float, ratio: float = 1.0) -> np.ndarray:
    """The paper's Y vectors on a circle, divided by 2 eps: (2, 5)."""
    angle, radius = turn_rate * t + heading, ratio * speed / turn_rate
    return np.array(
        [
            [1.0, 0.0, radius * (np.cos(angle) - np.cos(heading)), t, 0.0],
            [0.0, 1.0, radius * (np.sin(angle) - np.sin(heading)), 0.0, t],
        ]
    )


def circle_gramian(duration: float, speed: float, heading: float, turn_rate: float, ratio: float = 1.0) -> np.ndarray:
    """The integral of Y'Y on a circle, by hand: eq. (11) with additional trigonometric terms."""
    T, omega, radius = duration, turn_rate, ratio * speed / turn_rate
    end = omega * T + heading
    cosine = (np.sin(end) - np.sin(heading)) / omega  # integral of cos(omega t + heading)
    sine = (np.cos(heading) - np.cos(end)) / omega
    t_cosine = T * np.sin(end) / omega - sine / omega
    t_sine = -T * np.cos(end) / omega + cosine / omega
    W = line_gramian(T, 0.0, 0.0)
    W[:2, 2] = W[2, :2] = radius * np.array([cosine - T * np.cos(heading), sine - T * np.sin(heading)])
    W[3:, 2] = W[2, 3:] = radius * np.array([t_cosine - T**2 / 2 * np.cos(heading), t_sine - T**2 / 2 * np.sin(heading)])
    W[2, 2] = 2 * radius**2 * (T - np.sin(omega * T) / omega)
    return W


def circle_transition(duration: float, speed: float, heading: float, turn_rate: float) -> np.ndarray:
    """Phi = dx(T)/dx(0) on a circle: the Y vectors on top of an identity."""
    return np.vstack([circle_rows(duration, speed, heading, turn_rate), np.eye(5)[2:]])


def flown_circle(duration: float, steps: int, heading: float, turn_rate: float) -> od.Trajectory:
    return od.simulate(GPS_ONLY, (0.0, 0.0, heading, 2.0, -1.0), np.full(steps, turn_rate), duration / steps, tolerance=ONE_STEP)


@few
@given(heading=ANGLE, wind_x=WIND, wind_y=WIND, steps=st.sampled_from([1, 7, 20]))
def test_on_a_line_the_gramian_is_equation_11(heading: float, wind_x: float, wind_y: float, steps: int):
    """A quadratic integrand: RK4 and Simpson's rule are exact, whatever the step."""
    path = od.simulate(GPS_ONLY, (1.0, 2.0, heading, wind_x, wind_y), np.zeros(steps), 6.0 / steps)
    W = od.variational_gramian(GPS_ONLY, path, weighted=False).total
    assert_close(W, line_gramian(6.0, SPEED, heading), 1e-12)


@few
@given(heading=ANGLE, eps=st.floats(0.05, 2.0))
def test_on_a_line_the_empirical_gramian_is_equation_11_for_every_eps(heading: float, eps: float):
    path = od.simulate(GPS_ONLY, (1.0, 2.0, heading, 0.7, -0.4), np.zeros(10), 0.6)
    W = od.empirical_gramian(GPS_ONLY, path, eps=eps, weighted=False).total
    assert_close(W, line_gramian(6.0, SPEED, heading, np.sin(eps) / eps), 1e-11)


@few
@given(heading=ANGLE, eps=st.sampled_from([1e-4, 0.3, 1.5]))
def test_on_a_line_the_gramian_has_rank_4_and_hides_heading_against_wind(heading: float, eps: float):
    path = od.simulate(GPS_ONLY, (1.0, 2.0, heading, 0.7, -0.4), np.zeros(10), 0.6)
    ratio = np.sin(eps) / eps
    unit = np.array([1.0, 1.0, 1 / SPEED, 1.0, 1.0])
    for W, factor in (
        (od.variational_gramian(GPS_ONLY, path, weighted=False).total, 1.0),
        (od.empirical_gramian(GPS_ONLY, path, eps=eps, weighted=False).total, ratio),
    ):
        hidden = np.array([0.0, 0.0, 1.0, factor * SPEED * np.sin(heading), -factor * SPEED * np.cos(heading)])
        np.testing.assert_allclose(W @ hidden, 0.0, atol=1e-8 * np.abs(W).max())
        values = np.linalg.eigvalsh(W * np.outer(unit, unit))
        assert values[0] < 1e-9 * values[-1]
        assert values[1] > 1e-3 * values[-1]


@few
@given(heading=ANGLE, turn_rate=st.sampled_from([-0.8, 0.3, 1.1]), ratio=st.sampled_from([1.0, 0.6]))
def test_the_circle_by_hand_is_the_integral_of_the_y_vectors(heading: float, turn_rate: float, ratio: float):
    """Checks the formula that the next tests lean on, by numerical quadrature."""

    def integrand(t: float, i: int, j: int) -> float:
        rows = circle_rows(t, SPEED, heading, turn_rate, ratio)
        return float(rows[:, i] @ rows[:, j])

    by_quadrature = np.array([[quad(integrand, 0, 5.0, args=(i, j), epsabs=1e-11, epsrel=1e-11)[0] for j in range(5)] for i in range(5)])
    assert_close(circle_gramian(5.0, SPEED, heading, turn_rate, ratio), by_quadrature, 1e-9)


@pytest.mark.parametrize("turn_rate", [-0.8, 0.3])
def test_on_a_circle_the_gramian_converges_to_the_y_vectors_at_order_4(turn_rate: float):
    exact = circle_gramian(5.0, SPEED, 0.7, turn_rate)
    errors = []
    for steps in (10, 20, 40):
        path = flown_circle(5.0, steps, 0.7, turn_rate)
        errors.append(np.abs(od.variational_gramian(GPS_ONLY, path, weighted=False).total - exact).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 4.0, atol=0.1)


def test_on_a_circle_the_empirical_gramian_has_the_factors_sin_eps_over_eps():
    eps = 0.8
    W = od.empirical_gramian(GPS_ONLY, flown_circle(5.0, 400, 0.7, 0.5), eps=eps, weighted=False).total
    assert_close(W, circle_gramian(5.0, SPEED, 0.7, 0.5, np.sin(eps) / eps), 1e-9)


def test_a_circle_followed_by_a_line_is_the_sum_with_the_line_transported():
    """W = W_circle + Phi' W_line Phi; the plain sum that the paper prints is another matrix."""
    heading, turn_rate, circling, straight = 0.7, 0.5, 4.0, 3.0
    steps = 200
    u = np.concatenate([np.full(4 * steps, turn_rate), np.zeros(3 * steps)])
    path = od.simulate(GPS_ONLY, (0.0, 0.0, heading, 2.0, -1.0), u, 1.0 / steps)
    W = od.variational_gramian(GPS_ONLY, path, weighted=False).total
    Phi = circle_transition(circling, SPEED, heading, turn_rate)
    line = line_gramian(straight, SPEED, heading + turn_rate * circling)
    circle = circle_gramian(circling, SPEED, heading, turn_rate)
    assert_close(W, circle + Phi.T @ line @ Phi, 1e-9)
    assert np.abs(W - circle - line).max() > 0.1 * np.abs(W).max()


# the integral walks in half steps, Phi in whole ones: they agree to RK4's error (0.6 rad/s * 0.25 s)^5 / 2880 per step
@pytest.mark.parametrize(
    ("system", "weighted", "relative"),
    [(ALL_FOUR, True, 1e-11), (PENDULUM, True, 1e-11), (ALL_FOUR, False, 1e-7)],
    ids=["vehicle, weighted", "pendulum, weighted", "vehicle, integral"],
)
@few
@given(cut=st.integers(1, 23), seed=st.integers(0, 10**6))
def test_the_gramian_of_a_path_is_the_sum_of_its_parts_transported_to_the_start(
    system: od.System, weighted: bool, relative: float, cut: int, seed: int
):
    path = turning_path(system, seed=seed)
    first, second = until(path, cut), od.Trajectory(path.t[cut:], path.x[cut:], path.u[cut:], tolerance=path.tolerance)
    Phi = transition_matrices(system, path)[cut]
    W, W1, W2 = (od.variational_gramian(system, part, weighted).total for part in (path, first, second))
    assert_close(W, W1 + Phi.T @ W2 @ Phi, relative)


@few
@given(heading=ANGLE, sigma=st.floats(0.1, 10.0), steps=st.sampled_from([1, 5, 40]))
def test_weighted_gps_on_a_line_is_the_sum_of_powers_of_the_sampling_times(heading: float, sigma: float, steps: int):
    """W = sum_k Phi_k' C'C Phi_k / sigma^2 with t_k = k dt: sums of 1, t and t^2 in closed form."""
    system, step = dubins(od.GPS(sigma)), 0.3
    path = od.simulate(system, (1.0, 2.0, heading, 0.7, -0.4), np.zeros(steps), step)
    ones, times, squares = steps, step * steps * (steps - 1) / 2, step**2 * (steps - 1) * steps * (2 * steps - 1) / 6
    drift = SPEED * np.array([-np.sin(heading), np.cos(heading)])
    along = np.hstack([np.zeros((2, 2)), drift[:, None], np.eye(2)])  # d position / d x(0) = base + t along
    base = np.eye(2, 5)
    expected = (ones * base.T @ base + times * (base.T @ along + along.T @ base) + squares * along.T @ along) / sigma**2
    np.testing.assert_allclose(od.variational_gramian(system, path).total, expected, atol=1e-12 * np.abs(expected).max())


# ---------------------------------------------------------------- empirical -> variational, sensitivities


@pytest.mark.parametrize("weighted", [True, False])
def test_the_empirical_gramian_tends_to_the_variational_one_at_order_2(weighted: bool):
    path = turning_path()
    exact = od.variational_gramian(ALL_FOUR, path, weighted).blocks
    errors = [np.abs(od.empirical_gramian(ALL_FOUR, path, eps, weighted).blocks - exact).max(axis=(0, 2, 3)) for eps in (0.02, 0.01, 0.005)]
    nonlinear = np.array(errors)[:, [0, 2, 3]]  # gps, range, bearing
    np.testing.assert_allclose(np.log2(nonlinear[:-1] / nonlinear[1:]), 2.0, atol=0.02)
    # the heading is linear in the start: there the difference quotient is exact but for rounding
    assert errors[0][1] < 1e-10


def test_the_empirical_gramian_does_not_see_the_cut_of_an_angle():
    """Next to +-pi the bearing jumps by 2 pi: differences must wrap."""
    system = dubins(od.Bearing((0.0, 0.0), 0.1), od.Magnetometer(0.1))
    path = od.simulate(system, (10.0, 0.0, 0.0, 0.0, 0.0), np.zeros(4), 0.1)  # the beacon lies dead astern, at bearing pi
    emp, var = od.empirical_gramian(system, path, eps=1e-4).total, od.variational_gramian(system, path).total
    np.testing.assert_allclose(emp, var, atol=1e-6 * np.abs(var).max())


@BOTH
@few
@given(seed=st.integers(0, 10**6))
def test_transition_matrices_are_the_derivatives_of_the_simulated_states(system: od.System, seed: int):
    path = turning_path(system, steps=12, seed=seed)
    Phi, eps = transition_matrices(system, path), 1e-4
    assert Phi.shape == (13, 5, 5)
    for i, unit in enumerate(np.eye(5)):
        plus, minus = (od.simulate(system, path.x[0] + side * eps * unit, path.u, path.step, tolerance=ONE_STEP).x for side in (1, -1))
        # central differences: error eps^2/6 third derivative <= 1e-8 * distance flown (< 50 m), rounding 1e-14 / eps
        np.testing.assert_allclose(Phi[:, :, i], (plus - minus) / (2 * eps), rtol=1e-5, atol=1e-6)


def test_one_step_is_runge_kutta_of_order_4():
    """On the logistic equation x' = x (1 - x), whose solution is known; planar vehicles would not tell it from Simpson's rule."""
    x = ca.SX.sym("x")
    system = od.ControlAffineSystem(x, ("x",), x * (1 - x), outputs={"y": x})
    exact = 1 / (1 + 4 * np.exp(-3.0))
    errors = [
        abs(od.simulate(system, (0.2,), np.zeros((steps, 0)), 3.0 / steps, tolerance=ONE_STEP).x[-1, 0] - exact) for steps in (20, 40, 80)
    ]
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 4.0, atol=0.1)


# ---------------------------------------------------------------- additivity and sampling


def test_information_adds_up_over_sensors_and_steps():
    path = turning_path()
    every = od.variational_gramian(ALL_FOUR, path)
    assert every.names == NAMES
    assert every.blocks.shape == (24, 4, 5, 5)
    alone = [od.variational_gramian(dubins(sensor), path).total for sensor in SENSORS]
    assert_close(every.total, sum(alone), 1e-13)
    for name, W in zip(NAMES, alone, strict=True):
        np.testing.assert_array_equal(every.only(name).total, W)
    # block k is what the sample at t_k adds: the difference between paths with and without that step
    shorter = [od.variational_gramian(ALL_FOUR, until(path, k + 1)).total for k in range(24)]
    assert_close(np.cumsum(every.blocks.sum(axis=1), axis=0), np.array(shorter), 1e-12)


@pytest.mark.parametrize("segments", [1, 2, 3, 8, 24])
def test_segments_are_consecutive_and_lose_nothing(segments: int):
    information = od.variational_gramian(ALL_FOUR, turning_path())
    grouped = information.by_segment(segments)
    length = 24 // segments
    for k in range(segments):
        np.testing.assert_allclose(grouped[k], information.blocks[k * length : (k + 1) * length].sum(axis=0), rtol=1e-12)
    assert_close(grouped.sum(axis=(0, 1)), information.total, 1e-12)


@pytest.mark.parametrize("segments", [0, -2, 5, 48])
def test_segments_must_divide_the_steps(segments: int):
    with pytest.raises(od.InputError, match=rf"segments is {segments}: must divide the number of steps, 24"):
        od.variational_gramian(ALL_FOUR, turning_path()).by_segment(segments)


def test_two_equal_sensors_are_one_of_half_the_variance():
    path = turning_path()
    twice = od.variational_gramian(dubins(od.Range(BEACON, 2.0), od.Range(BEACON, 2.0)), path)
    assert twice.names == ("range", "range_2")
    assert_close(twice.total, od.variational_gramian(dubins(od.Range(BEACON, np.sqrt(2.0))), path).total, 1e-12)


def test_a_sensor_read_once_a_second_has_blocks_at_whole_seconds_only():
    path = turning_path(steps=12, step=0.5)
    system = dubins(od.GPS(2.0, rate=1.0), od.Range(BEACON, 1.0, rate=0.5), od.Magnetometer(0.21))
    every = dubins(od.GPS(2.0), od.Range(BEACON, 1.0), od.Magnetometer(0.21))
    found, full = od.variational_gramian(system, path).blocks, od.variational_gramian(every, path).blocks
    for sensor, period in enumerate((2, 4, 1)):
        due = np.arange(12) % period == 0
        assert not found[~due, sensor].any()
        np.testing.assert_array_equal(found[due, sensor], full[due, sensor])
        assert (np.abs(found[due, sensor]).max(axis=(1, 2)) > 0).all()
    assert not od.empirical_gramian(system, path).blocks[1::2, 0].any()


def test_the_integral_does_not_depend_on_the_rate():
    path = turning_path(steps=12, step=0.5)
    slow, fast = dubins(od.GPS(2.0, rate=1.0)), dubins(od.GPS(3.0))
    W = [od.variational_gramian(system, path, weighted=False).total for system in (slow, fast)]
    np.testing.assert_array_equal(W[0], W[1])


# ---------------------------------------------------------------- posterior information

PRIOR = od.Prior(START, std=(5.0, 4.0, 0.3, 1.0, 1.5))


def correlated_prior(n: int, seed: int = 5) -> od.Prior:
    factor = np.random.default_rng(seed).standard_normal((n, n)) + 2 * np.eye(n)
    return od.Prior(START[:n], covariance=factor @ factor.T)


@pytest.mark.parametrize("prior", [PRIOR, correlated_prior(5)], ids=["std", "covariance"])
@BOTH
@few
@given(seed=st.integers(0, 10**6))
def test_without_noise_the_posterior_is_prior_plus_gramian_transported(system: od.System, prior: od.Prior, seed: int):
    """J_k = Phi_k^-T (P0^-1 + sum_{j <= k} W_j) Phi_k^-1; at N nothing is sampled."""
    path = turning_path(system, seed=seed)
    J = od.posterior_information(system, path, prior)
    blocks = od.variational_gramian(system, path).blocks.sum(axis=1)
    gathered = np.linalg.inv(prior.covariance) + np.cumsum(np.concatenate([blocks, np.zeros((1, 5, 5))]), axis=0)
    backwards = np.linalg.inv(transition_matrices(system, path))
    assert_close(J, backwards.swapaxes(1, 2) @ gathered @ backwards, 1e-9)


def planar_transition(path: od.Trajectory, k: int) -> np.ndarray:
    """F_k by symmetry: turning the heading turns the displacement through the air. Wind, where it is a state, adds step."""
    n = path.x.shape[1]
    wind = path.x[k, 3:] if n == 5 else np.zeros(2)
    east, north = path.x[k + 1, :2] - path.x[k, :2] - wind * path.step
    F = np.eye(n)
    F[:2, 2] = -north, east
    F[:2, 3:] = path.step * np.eye(2)[:, : n - 3]
    return F


def planar_samples(x: np.ndarray) -> np.ndarray:
    """Rows dy/dx / sigma of GPS, magnetometer, range and bearing by hand (5, n)."""
    east, north = BEACON[0] - x[0], BEACON[1] - x[1]
    distance = np.hypot(east, north)
    C = np.zeros((5, len(x)))
    C[0, 0] = C[1, 1] = 1 / 2.0
    C[2, 2] = 1 / 0.21
    C[3, :2] = -np.array([east, north]) / distance
    C[4, :3] = np.array([north / distance**2, -east / distance**2, -1.0]) / 0.087
    return C


def stacked_information(path: od.Trajectory, prior: od.Prior, kicks: np.ndarray, known: int, samples: int) -> np.ndarray:
    """Information about the last state by one big least squares over (x_0, e_0, e_1, ...), x_{k+1} = F_k x_k + kicks e_k.

    The first `known` entries of each e are N(0, 1), the others unknown; the samples at t_0 .. t_(samples-1) are used.
    The e are eliminated by a Schur complement after x_0 was expressed by the last state.
    """
    n, r, N = path.x.shape[1], kicks.shape[1], path.steps
    states = [np.hstack([np.eye(n), np.zeros((n, N * r))])]  # x_k as rows in (x_0, e)
    for k in range(N):
        following = planar_transition(path, k) @ states[k]
        following[:, n + k * r : n + (k + 1) * r] += kicks
        states.append(following)
    A = np.zeros((n + N * r, n + N * r))
    A[:n, :n] = np.linalg.inv(prior.covariance)
    A[n:, n:] = np.diag(np.tile(np.arange(r) < known, N).astype(float))
    for k in range(samples):
        rows = planar_samples(path.x[k]) @ states[k]
        A += rows.T @ rows
    to_last = np.vstack([states[-1], np.eye(n + N * r)[n:]])
    back = np.linalg.inv(to_last)
    A = back.T @ A @ back
    return A[:n, :n] - A[:n, n:] @ np.linalg.solve(A[n:, n:], A[n:, :n])


@pytest.mark.parametrize("steps", [1, 2, 12])
def test_with_process_noise_the_posterior_is_the_schur_complement_of_stacked_least_squares(steps: int):
    """Predicted at t_N, where nothing is sampled, and updated one step before."""
    path = turning_path(steps=steps)
    factor = 0.3 * np.random.default_rng(1).standard_normal((5, 5))
    psd = factor @ factor.T
    J = od.posterior_information(ALL_FOUR, path, PRIOR, disturbance_psd=psd)
    kicks = np.linalg.cholesky(psd * path.step)
    assert_close(J[-1], stacked_information(path, PRIOR, kicks, known=5, samples=steps), 1e-8)
    if steps > 1:
        assert_close(J[-2], stacked_information(until(path, steps - 1), PRIOR, kicks, known=5, samples=steps), 1e-8)


def test_a_psd_of_one_number_per_state_is_the_diagonal_matrix_and_may_be_zero_for_some():
    path, psd = turning_path(steps=8), np.array([0.0, 0.0, 0.01, 0.2, 0.1])
    J = od.posterior_information(ALL_FOUR, path, PRIOR, disturbance_psd=psd)
    assert_close(J, od.posterior_information(ALL_FOUR, path, PRIOR, disturbance_psd=np.diag(psd)), 1e-12)
    kicks = np.sqrt(psd * path.step)[:, None] * np.eye(5)[:, 2:]
    assert_close(J[-1], stacked_information(path, PRIOR, kicks, known=3, samples=8), 1e-8)


UNKNOWN_WIND = dubins(*SENSORS, wind="unknown")


@pytest.mark.parametrize("psd", [None, (0.2, 0.1, 0.05)], ids=["unknown alone", "unknown and noise"])
def test_with_unknown_inputs_the_posterior_is_the_schur_complement_of_stacked_least_squares(psd: tuple[float, ...] | None):
    path, prior = turning_path(UNKNOWN_WIND, steps=10), correlated_prior(3)
    J = od.posterior_information(UNKNOWN_WIND, path, prior, psd, unknown_inputs=("wind_x", "wind_y"))
    noise = np.zeros((3, 0)) if psd is None else np.diag(np.sqrt(np.array(psd) * path.step))
    kicks = np.hstack([noise, path.step * np.eye(3)[:, :2]])
    for k in (1, 5, 9):
        assert_close(J[k], stacked_information(until(path, k), prior, kicks, noise.shape[1], samples=k + 1), 1e-8)
    # predicted: an arbitrary wind has carried the vehicle anywhere, of the position nothing is known
    np.testing.assert_allclose(J[-1][:2], 0.0, atol=1e-12 * np.abs(J[-2]).max())
    assert_close(J[-1][2:, 2:], stacked_information(path, prior, kicks, noise.shape[1], samples=10)[2:, 2:], 1e-8)


def test_an_unknown_input_is_the_limit_of_a_growing_psd():
    """The difference falls like 1/psd, and the information is the least of all."""
    path, prior = turning_path(UNKNOWN_WIND, steps=10), correlated_prior(3)
    limit = od.posterior_information(UNKNOWN_WIND, path, prior, unknown_inputs=("wind_x", "wind_y"))
    excess = []
    for psd in (1e4, 1e5, 1e6):
        J = od.posterior_information(UNKNOWN_WIND, path, prior, disturbance_psd=(psd, psd, 0.0))
        assert np.linalg.eigvalsh(J - limit).min() > -1e-9 * np.abs(limit).max()
        excess.append(np.abs(J - limit).max())
    np.testing.assert_allclose(np.array(excess[:-1]) / excess[1:], 10.0, rtol=0.01)


def test_unknown_inputs_that_no_output_tells_apart_are_refused_by_name():
    """Two names for one push: what the outputs show of w and of v is the same."""
    x = ca.SX.sym("x", 3)
    push = ca.vertcat(0, 0, 1)
    system = od.ControlAffineSystem(
        x, ("a", "b", "c"), ca.vertcat(x[1], x[2], 0), {}, {"w": push, "v": -2 * push, "gust": ca.vertcat(0, 0, x[0])}, {"y": x[0]}
    )
    path = od.simulate(system, (1.0, 2.0, 3.0), np.zeros((15, 0)), 0.5)
    assert np.isfinite(od.posterior_information(system, path, correlated_prior(3), unknown_inputs=("w", "gust"))).all()
    for function in (od.posterior_information, od.unknown_input_information):
        with pytest.raises(od.InputError, match=r"cannot be told apart from the outputs along this path: \+1 w \+0.5 v leaves no trace"):
            function(system, path, correlated_prior(3), unknown_inputs=("w", "v", "gust"))
    compass = dubins(od.Magnetometer(0.2), wind="unknown")
    with pytest.raises(od.InputError, match="'wind_x' leaves no trace in any output along this path"):
        od.posterior_information(compass, turning_path(compass), correlated_prior(3), unknown_inputs=("wind_x", "wind_y"))


def test_information_never_grows_by_noise_and_never_falls_by_samples():
    path = turning_path()
    still = od.posterior_information(ALL_FOUR, path, PRIOR)
    shaken = od.posterior_information(ALL_FOUR, path, PRIOR, disturbance_psd=(0.1, 0.1, 0.01, 0.1, 0.1))
    blind = od.posterior_information(ALL_FOUR, path, PRIOR, active=np.zeros((24, 4), dtype=bool))
    scale = 1 / np.sqrt(np.diagonal(still, axis1=1, axis2=2))
    weights = scale[:, :, None] * scale[:, None, :]
    assert np.linalg.eigvalsh((still - shaken)[1:] * weights[1:]).min() > -1e-10
    assert np.linalg.eigvalsh((still - blind) * weights).min() > -1e-10
    np.testing.assert_allclose(np.linalg.inv(blind[0]), PRIOR.covariance, rtol=1e-9, atol=1e-12)


# ---------------------------------------------------------------- standard deviations


def test_gps_on_a_straight_line_leaves_exactly_heading_and_cross_wind_without_a_standard_deviation():
    """Flying east the hidden direction is (0, 0, 1, 0, -speed); position and head wind follow from M = sum (1, t)(1, t)'."""
    path = od.simulate(GPS_ONLY, (0.0, 0.0, 0.0, 0.7, -0.4), np.zeros(20), 0.5)
    deviations = standard_deviations(od.variational_gramian(GPS_ONLY, path).total)
    assert np.isinf(deviations).tolist() == [False, False, True, False, True]
    rows = np.vstack([np.ones(20), 0.5 * np.arange(20)])
    position, wind = np.sqrt(np.diag(np.linalg.inv(rows @ rows.T)))
    np.testing.assert_allclose(deviations[[0, 1, 3]], [position, position, wind], rtol=1e-9)


@few
@given(heading=st.floats(0.1, 1.4))
def test_gps_on_a_slanted_line_leaves_heading_and_both_winds_without_a_standard_deviation(heading: float):
    path = od.simulate(GPS_ONLY, (0.0, 0.0, heading, 0.7, -0.4), np.zeros(20), 0.5)
    deviations = standard_deviations(od.variational_gramian(GPS_ONLY, path).total)
    assert np.isinf(deviations).tolist() == [False, False, True, True, True]


def test_one_beacon_leaves_every_state_without_a_standard_deviation():
    """Rotation of everything about the beacon moves all five states."""
    system = dubins(SENSORS[2], SENSORS[3])
    W = od.variational_gramian(system, turning_path(system)).total
    assert np.isinf(standard_deviations(W)).all()


@settings(few, max_examples=40)
@given(n=st.integers(1, 6), seed=st.integers(0, 10**6))
def test_standard_deviations_do_not_depend_on_units(n: int, seed: int):
    """J = D A D with units D over ten decades: deviations are sqrt(diag(A^-1)) / D, nothing is lost to rounding."""
    random = np.random.default_rng(seed)
    Q = np.linalg.qr(random.standard_normal((n, n)))[0]
    A = (Q * 10.0 ** random.uniform(-4, 0, n)) @ Q.T
    D = 10.0 ** random.uniform(-5, 5, n)
    J = np.tile((A + A.T) / 2 * np.outer(D, D), (2, 1, 1))
    expected = np.sqrt(np.diag(np.linalg.inv(A))) / D
    np.testing.assert_allclose(standard_deviations(J), [expected, expected], rtol=1e-9)


# ---------------------------------------------------------------- Lie rank = rank of the Gramian

SUBSETS = [subset for size in range(1, 5) for subset in combinations(range(4), size)]
# Brace and Morgansen, recomputed exactly (section IV and table I): unicycle, Dubins turning, Dubins straight
DIMENSIONS = {
    "gps": (5, 5, 4),
    "magnetometer": (1, 1, 1),
    "range": (4, 4, 3),
    "bearing": (4, 4, 3),
    "gps magnetometer": (5, 5, 5),
    "gps range": (5, 5, 4),
    "gps bearing": (5, 5, 5),
    "magnetometer range": (5, 5, 4),
    "magnetometer bearing": (5, 5, 4),
    "range bearing": (4, 4, 4),
    "gps magnetometer range": (5, 5, 5),
    "gps magnetometer bearing": (5, 5, 5),
    "gps range bearing": (5, 5, 5),
    "magnetometer range bearing": (5, 5, 5),
    "gps magnetometer range bearing": (5, 5, 5),
}


@pytest.mark.parametrize("subset", SUBSETS, ids=lambda subset: "+".join(NAMES[i] for i in subset))
def test_the_lie_rank_is_the_rank_of_the_gramian_under_generic_inputs(subset: tuple[int, ...]):
    sensors = tuple(SENSORS[i] for i in subset)
    unicycle, arrow = od.System(od.Unicycle(wind="constant"), sensors), dubins(*sensors)
    random = np.random.default_rng(0)
    turns = random.uniform(-0.5, 0.5, 40)
    found = []
    for system, u, held in (
        (unicycle, np.column_stack([random.uniform(5.0, 20.0, 40), turns]), None),
        (arrow, turns, None),
        (arrow, np.zeros(40), {"turn_rate": 0.0}),
    ):
        path = od.simulate(system, START, u, 0.25)
        rank = numerical_rank(od.variational_gramian(system, path).total)
        assert od.observability(system, held=held).dimension == rank
        found.append(rank)
    assert tuple(found) == DIMENSIONS[" ".join(NAMES[i] for i in subset)]


# ---------------------------------------------------------------- bad input


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"mean": (0.0, 0.0)}, "give either std or covariance"),
        ({"mean": (0.0, 0.0), "std": (1.0, 1.0), "covariance": np.eye(2)}, "give either std or covariance"),
        ({"mean": (0.0, 0.0), "std": (1.0,)}, r"std is \[1.0\]: must be 2 finite numbers above 0"),
        ({"mean": (0.0, 0.0), "std": (1.0, 0.0)}, r"std is \[1.0, 0.0\]"),
        ({"mean": (0.0, 0.0), "std": (1.0, -2.0)}, r"std is \[1.0, -2.0\]"),
        ({"mean": (0.0, 0.0), "std": (1.0, np.nan)}, r"std is \[1.0, nan\]"),
        ({"mean": (0.0, 0.0), "std": (1.0, np.inf)}, r"std is \[1.0, inf\]"),
        ({"mean": (0.0, np.nan), "std": (1.0, 1.0)}, "must be finite"),
        ({"mean": 0.0, "std": 1.0}, "prior: "),
        ({"mean": ((0.0, 0.0),), "covariance": np.eye(2)}, r"must be finite, \(n,\) and \(n, n\)"),
        ({"mean": (0.0, 0.0), "covariance": np.eye(3)}, r"covariance \(3, 3\)"),
        ({"mean": (0.0, 0.0), "covariance": np.zeros((2, 2))}, r"covariance\[0, 0\] is 0: must be above 0"),
        ({"mean": (0.0, 0.0), "covariance": [[1.0, 1.0], [1.0, 1.0]]}, "positive definite|must be symmetric"),
        ({"mean": (0.0, 0.0), "covariance": [[1.0, 2.0], [2.0, 1.0]]}, "positive definite|must be symmetric"),
        ({"mean": (0.0, 0.0), "covariance": [[1.0, 0.0], [0.0, -1.0]]}, r"covariance\[1, 1\] is -1: must be above 0"),
        ({"mean": (0.0, 0.0), "covariance": [[1.0, 0.5], [0.4, 1.0]]}, "positive definite|must be symmetric"),
        ({"mean": (0.0, 0.0), "covariance": [[1.0, 0.0], [0.0, np.nan]]}, "must be finite"),
    ],
)
def test_a_prior_must_be_a_normal_distribution(arguments: dict[str, object], message: str):
    with pytest.raises(od.InputError, match=message):
        od.Prior(**arguments)


def test_a_standard_deviation_is_the_root_of_a_variance():
    np.testing.assert_array_equal(od.Prior((1.0, 2.0), std=(3.0, 0.5)).covariance, [[9.0, 0.0], [0.0, 0.25]])


def test_a_prior_may_have_units_over_ten_decades_and_cannot_be_changed():
    D = 10.0 ** np.linspace(-5, 5, 4)
    prior = od.Prior(np.zeros(4), covariance=(0.5 * np.eye(4) + 0.5) * np.outer(D, D))
    np.testing.assert_allclose(prior.std, D, rtol=1e-12)
    np.testing.assert_allclose(prior.information @ prior.covariance / np.outer(1 / D, D), np.eye(4), atol=1e-12)
    with pytest.raises(ValueError, match="read-only"):
        prior.mean[0] = 1.0


GRAMIANS = {
    "variational": od.variational_gramian,
    "empirical": od.empirical_gramian,
    "posterior": lambda system, path: od.posterior_information(system, path, PRIOR),
}


@pytest.mark.parametrize("sensor", [od.Range((3.0, 0.0), 1.0), od.Bearing((3.0, 0.0), 0.1)], ids=["range", "bearing"])
@pytest.mark.parametrize("gramian", GRAMIANS.values(), ids=GRAMIANS.keys())
def test_a_path_through_a_landmark_is_refused_with_sensor_and_step(gramian: object, sensor: object):
    """At 1 m/s along y = 0 the landmark (3, 0) is met at step 6."""
    system = dubins(od.GPS(1.0), sensor, speed=1.0)
    path = od.simulate(system, np.zeros(5), np.zeros(10), 0.5)
    with pytest.raises(od.InputError, match=rf"'{sensor.name}' .* at step 6 "):
        gramian(system, path)


@pytest.mark.parametrize("gramian", GRAMIANS.values(), ids=GRAMIANS.keys())
def test_a_path_of_another_system_is_refused(gramian: object):
    with pytest.raises(od.InputError, match=r"path has 3 states and 1 inputs: the system has 5 \(x, y, heading, wind_x, wind_y\) and 1"):
        gramian(ALL_FOUR, turning_path(UNKNOWN_WIND))


@pytest.mark.parametrize("gramian", GRAMIANS.values(), ids=GRAMIANS.keys())
def test_a_system_without_sensors_is_refused(gramian: object):
    with pytest.raises(od.InputError, match="no sensors"):
        gramian(dubins(), turning_path())


@pytest.mark.parametrize("eps", [0.0, -1e-4, np.nan, np.inf])
def test_the_perturbation_must_be_positive(eps: float):
    with pytest.raises(od.InputError, match=rf"eps is {eps!r}: must be a finite number above 0"):
        od.empirical_gramian(ALL_FOUR, turning_path(), eps=eps)


@pytest.mark.parametrize(
    ("psd", "message"),
    [
        ((1.0, 1.0), r"disturbance_psd has shape \(2,\): must be finite, \(5,\) or symmetric \(5, 5\)"),
        (np.eye(4), r"disturbance_psd has shape \(4, 4\)"),
        (1.0, r"disturbance_psd has shape \(\)"),
        (np.eye(5) + np.eye(5, k=1), "symmetric"),
        ((1.0, 1.0, np.nan, 1.0, 1.0), "finite"),
        ((1.0, 1.0, -0.5, 1.0, 1.0), "eigenvalue -0.5: must be positive semidefinite"),
    ],
)
def test_the_process_noise_must_be_a_covariance_of_the_state(psd: object, message: str):
    with pytest.raises(od.InputError, match=message):
        od.posterior_information(ALL_FOUR, turning_path(), PRIOR, disturbance_psd=psd)


def test_unknown_inputs_and_active_sensors_are_checked():
    path = turning_path(UNKNOWN_WIND)
    with pytest.raises(od.InputError, match=r"unknown_inputs has no 'wind_z'; did you mean 'wind_\w'\?"):
        od.posterior_information(UNKNOWN_WIND, path, correlated_prior(3), unknown_inputs=("wind_z",))
    with pytest.raises(od.InputError, match=r"active has shape \(24, 3\): must be \(24, 4\)"):
        od.posterior_information(UNKNOWN_WIND, path, correlated_prior(3), active=np.ones((24, 3), dtype=bool))


def test_a_prior_of_another_state_is_refused():
    with pytest.raises(od.InputError, match="prior"):
        od.posterior_information(ALL_FOUR, turning_path(), correlated_prior(3))


@pytest.mark.parametrize("rate", [3.0, 0.7])
def test_a_rate_that_does_not_fit_the_step_is_refused(rate: float):
    with pytest.raises(od.InputError, match=rf"gps: rate {rate} Hz .* no whole multiple of the step 0.25 s"):
        od.variational_gramian(dubins(od.GPS(1.0, rate=rate)), turning_path())


@pytest.mark.parametrize(
    ("start", "u", "step", "message"),
    [
        (START, [0.0, np.nan], 0.1, r"u\[1, 0\] is nan: must be finite"),
        (START, [[0.0, 1.0]], 0.1, r"u has shape \(1, 2\): must be \(N, 1\)"),
        (START, np.zeros((0, 1)), 0.1, "at least 1"),
        (START[:3], [0.0], 0.1, r"x0 has shape \(3,\): must be \(5,\) for x, y, heading, wind_x, wind_y"),
        ((0.0, 0.0, np.inf, 0.0, 0.0), [0.0], 0.1, "x0: heading is inf: must be finite"),
        (START, [0.0], 0.0, "dt is 0.0: must be a finite number above 0"),
        (START, [0.0], np.nan, "dt is nan"),
    ],
)
def test_bad_inputs_are_refused_by_the_simulation(start: object, u: object, step: float, message: str):
    with pytest.raises(od.InputError, match=message):
        od.simulate(ALL_FOUR, start, u, step)


@pytest.mark.parametrize(
    ("t", "x", "u", "message"),
    [
        ([0.0, 1.0, 2.0], np.zeros((3, 2)), np.zeros((3, 1)), "do not fit"),
        ([0.0, 1.0, 0.5], np.zeros((3, 2)), np.zeros((2, 1)), "times must increase"),
        ([0.0, 0.0], np.zeros((2, 2)), np.zeros((1, 1)), "step is 0.0"),
        ([0.0, -1.0], np.zeros((2, 2)), np.zeros((1, 1)), "step is -1.0"),
        ([0.0, 1.0], [[0.0, 0.0], [0.0, np.nan]], np.zeros((1, 1)), r"x\[1, 1\] is nan"),
    ],
)
def test_a_trajectory_has_equal_steps_and_finite_values(t: object, x: object, u: object, message: str):
    with pytest.raises(od.InputError, match=message):
        od.Trajectory(np.array(t), np.array(x), np.array(u))


def test_information_names_its_sensors():
    with pytest.raises(od.InputError, match=r"blocks \(3, 2, 5, 5\) do not fit \(N, 1, n, n\)"):
        od.Information(np.zeros((3, 2, 5, 5)), ("gps",))
    with pytest.raises(od.InputError, match=r"no sensor 'radar' \(there are gps, magnetometer, range, bearing\)"):
        od.variational_gramian(ALL_FOUR, turning_path()).only("radar")


def test_the_integral_notices_a_landmark_between_two_samples():
    """At 0.5 Hz and a step of 0.5 s the range is read at t = 0, 2, ...; the path meets the beacon at t = 1."""
    system = od.System(od.Dubins(1.0), (od.Range((1.0, 0.0), 1.0, rate=0.5),))
    path = od.simulate(system, np.zeros(3), np.zeros(8), 0.5)
    assert np.isfinite(od.variational_gramian(system, path).total).all()
    for gramian in (od.variational_gramian, od.empirical_gramian):
        with pytest.raises(od.InputError, match="'range' has no derivative"):
            gramian(system, path, weighted=False)
