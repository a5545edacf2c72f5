"""Errors that last, noise that grows with distance, and samples out of range or view: in information and in filters."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest
from by_hand import slopes
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import toeplitz

import obsdesign as od
from obsdesign.design.nlp.program import Program
from obsdesign.dynamics.measurement_noise import detections
from obsdesign.dynamics.process_noise import ProcessNoise
from obsdesign.estimation.filter_bank import Belief, FilterBank
from obsdesign.estimation.validation import _draws, _MonteCarloTask
from obsdesign.sensors.abstract import AbstractSensor

few = settings(deadline=None, max_examples=8, database=None, derandomize=True)

BEACON = (40.0, 25.0)
Beacon = type[od.Range] | type[od.Bearing]
LOOKING = pytest.mark.parametrize("make", [od.Range, od.Bearing], ids=["range", "bearing"])
EVERY_KIND: dict[str, Callable[..., AbstractSensor]] = {
    "gps": lambda **fields: od.GPS(2.0, **fields),
    "magnetometer": lambda **fields: od.Magnetometer(0.2, **fields),
    "range": lambda **fields: od.Range(BEACON, 1.0, **fields),
    "bearing": lambda **fields: od.Bearing(BEACON, 0.1, **fields),
}
EACH = pytest.mark.parametrize("make", EVERY_KIND.values(), ids=EVERY_KIND.keys())


def one_sample(sensor: AbstractSensor, x: float = 3.0, y: float = -1.0, heading: float = 0.4) -> np.ndarray:
    """What a single sample says about (x, y, heading)."""
    system = od.System(od.Unicycle(), (sensor,))
    return od.variational_gramian(system, od.simulate(system, (x, y, heading), np.zeros((1, 2)), 1.0)).total


def resting(sensor: AbstractSensor, steps: int, start: tuple[float, float, float] = (3.0, -1.0, 0.4)) -> tuple[od.System, od.Trajectory]:
    """A vehicle that does not move: everything it measures is constant. One step is one second."""
    system = od.System(od.Unicycle(), (sensor,))
    return system, od.simulate(system, start, np.zeros((steps, 2)), 1.0)


def ar1(steps: int, correlation: float) -> np.ndarray:
    """Covariance (N, N) of a first-order sequence of variance 1."""
    return toeplitz(correlation ** np.arange(steps))


# ---------------------------------------------------------------- what one sample, and what many, are worth


@EACH
@few
@given(inflation=st.floats(0.2, 5.0))
def test_information_divides_by_the_square_of_the_inflation(make: Callable[..., AbstractSensor], inflation: float):
    np.testing.assert_allclose(one_sample(make(inflation=inflation)) * inflation**2, one_sample(make()), rtol=1e-12)


@EACH
@few
@given(bias=st.floats(0.01, 5.0))
def test_one_sample_with_a_constant_error_is_least_squares_with_the_error_as_an_unknown(make: Callable[..., AbstractSensor], bias: float):
    """Each output y = h + b + v with b ~ N(0, bias^2): b is eliminated by a Schur complement."""
    plain = one_sample(make())
    sigma = make().sigma
    outputs = plain * sigma**2  # C'C
    joint, across = 1 / sigma**2 + 1 / bias**2, 1 / sigma**2
    np.testing.assert_allclose(one_sample(make(bias_floor=bias)), outputs * (1 / sigma**2 - across**2 / joint), rtol=1e-9, atol=1e-15)


@EACH
@few
@given(bias=st.floats(0.0, 3.0), inflation=st.floats(0.5, 3.0), correlation=st.floats(0.0, 0.95), steps=st.sampled_from([1, 2, 9]))
def test_samples_at_rest_are_worth_what_the_covariance_of_their_errors_says(
    make: Callable[..., AbstractSensor], bias: float, inflation: float, correlation: float, steps: int
):
    """1'R^-1 1 with R = (inflation sigma)^2 A + bias^2 11'; each alone counts from below with R <= ((1 + c)/(1 - c) s^2 + N b^2) I."""
    system, path = resting(make(bias_floor=bias, inflation=inflation, correlation=correlation), steps)
    s2, ones = (inflation * make().sigma) ** 2, np.ones(steps)
    outputs = one_sample(make()) * make().sigma ** 2  # C'C
    found = od.variational_gramian(system, path)
    worth = ones @ np.linalg.solve(s2 * ar1(steps, correlation) + bias**2, ones)
    np.testing.assert_allclose(found.total, outputs * worth, rtol=1e-9, atol=1e-15)
    factor = {1: 1.0, 2: 1 + correlation}.get(steps, (1 + correlation) / (1 - correlation))
    counted = outputs * steps / (factor * s2 + steps * bias**2)
    np.testing.assert_allclose(found.blocks.sum(axis=(0, 1)), counted, rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize("rate", [None, 0.5], ids=["every step", "every second step"])
@pytest.mark.parametrize("correlation", [0.0, 0.3, 0.9])
def test_many_samples_of_a_constant_are_worth_what_the_exact_covariance_of_their_noise_says(correlation: float, rate: float | None):
    """1'S^-1 1 of the first-order sequence S. N blocks of single samples count N (1 - c)/(1 + c), less by 2 c / (N (1 - c))."""
    sigma, ratios = 0.2, []
    for samples in (20, 200, 2000):
        sensor = od.Magnetometer(sigma, correlation=correlation, rate=rate)
        system, path = resting(sensor, samples if rate is None else 2 * samples)
        information = od.variational_gramian(system, path)
        found = information.blocks.sum(axis=(0, 1))[2, 2]
        ones = np.ones(samples)
        exact = ones @ np.linalg.solve(sigma**2 * ar1(samples, correlation), ones)
        assert information.total[2, 2] == pytest.approx(exact, rel=1e-9)
        ratios.append(exact / found)
        assert exact / found - 1 == pytest.approx(2 * correlation / (samples * (1 - correlation)), rel=1e-6, abs=1e-9)
    assert ratios[-1] == pytest.approx(1.0, abs=0.01)


@LOOKING
@few
@given(r=st.floats(0.5, 500.0), angle=st.floats(-3.1, 3.1), growth=st.floats(0.001, 0.2))
def test_the_spread_grows_with_the_distance_as_two_errors_in_quadrature(make: Beacon, r: float, angle: float, growth: float):
    place = (BEACON[0] - r * math.cos(angle), BEACON[1] - r * math.sin(angle), 0.3)
    plain, grown = one_sample(make(BEACON, 0.5), *place), one_sample(make(BEACON, 0.5, sigma_per_metre=growth), *place)
    np.testing.assert_allclose(grown, plain * 0.5**2 / (0.5**2 + (growth * r) ** 2), rtol=1e-9, atol=1e-18)


# ---------------------------------------------------------------- range and field of view


def share(make: Beacon, x: float, y: float, heading: float, **limits: float) -> float:
    """What of the information of a sample is left by the limits: the same for each entry."""
    plain, limited = one_sample(make(BEACON, 0.5), x, y, heading), one_sample(make(BEACON, 0.5, **limits), x, y, heading)
    entry = np.unravel_index(np.abs(plain).argmax(), plain.shape)
    np.testing.assert_allclose(limited, plain * limited[entry] / plain[entry], rtol=1e-9, atol=1e-30)
    return float(limited[entry] / plain[entry])


def from_beacon(r: float, angle: float) -> tuple[float, float]:
    return BEACON[0] + r * math.cos(angle), BEACON[1] + r * math.sin(angle)


@LOOKING
@few
@given(angle=st.floats(-3.1, 3.1), heading=st.floats(-3.1, 3.1), limit=st.floats(1.0, 1e4), within=st.floats(0.01, 0.5))
def test_at_the_maximum_range_half_of_the_samples_arrive_and_as_many_more_within_as_fewer_beyond(
    make: Beacon, angle: float, heading: float, limit: float, within: float
):
    half, near, far = (share(make, *from_beacon(limit * factor, angle), heading, max_range=limit) for factor in (1, 1 - within, 1 + within))
    assert half == pytest.approx(0.5, rel=1e-9)
    assert near + far == pytest.approx(1.0, rel=1e-9)
    assert near > 0.5 > far


@LOOKING
def test_the_share_falls_all_the_way_from_one_to_nothing(make: Beacon):
    shares = [share(make, *from_beacon(factor * 50.0, 0.3), 1.0, max_range=50.0) for factor in (0.02, 0.3, 0.7, 0.9, 1.0, 1.1, 1.3, 2.0)]
    assert (np.diff(shares) < 0).all()
    assert shares[0] == pytest.approx(1.0, abs=1e-8)
    assert shares[-1] < 1e-8
    for factor in (5.0, 30.0, 1e6):
        assert 0 <= share(make, *from_beacon(factor * 50.0, 0.3), 1.0, max_range=50.0) < 1e-30


@LOOKING
@few
@given(r=st.floats(1.0, 200.0), angle=st.floats(-3.1, 3.1), view=st.floats(0.3, 6.0), off=st.floats(0.02, 0.14))
def test_at_the_edge_of_view_half_of_the_samples_arrive_on_either_side(make: Beacon, r: float, angle: float, view: float, off: float):
    """Off the nose by b: the share is even in b, 1/2 at half the field of view, and falls with |b|."""
    place, nose = from_beacon(r, angle), angle + math.pi
    for side in (1, -1):
        edge, inside, outside = (share(make, *place, nose + side * (view / 2 + more), field_of_view=view) for more in (0.0, -off, off))
        assert edge == pytest.approx(0.5, rel=1e-8)
        assert inside > 0.5 > outside
    assert share(make, *place, nose + 0.7, field_of_view=view) == pytest.approx(
        share(make, *place, nose - 0.7, field_of_view=view), rel=1e-8
    )
    shares = [share(make, *place, nose + b, field_of_view=view) for b in np.linspace(0, np.pi, 9)]
    assert (np.diff(shares) <= 0).all()


@LOOKING
def test_a_beacon_astern_is_not_seen_by_a_camera_that_looks_ahead(make: Beacon):
    ahead, astern = (share(make, 0.0, 25.0, heading, field_of_view=1.5) for heading in (0.0, math.pi))
    assert ahead > 0.99
    assert astern < 1e-14


@LOOKING
def test_limits_of_range_and_view_multiply(make: Beacon):
    at = (10.0, 0.0, 0.1)
    both = share(make, *at, max_range=38.0, field_of_view=1.0)
    assert both == pytest.approx(share(make, *at, max_range=38.0) * share(make, *at, field_of_view=1.0), rel=1e-9)
    assert 0.01 < both < 0.9


# ---------------------------------------------------------------- the same sensors in everything that is made of them

REAL = (
    od.GPS(2.0, rate=1.0, inflation=1.4, correlation=0.5),
    od.Magnetometer(0.2, bias_floor=0.1, rate=2.0),
    od.Range(BEACON, 1.0, sigma_per_metre=0.05, max_range=45.0, correlation=0.2),
    od.Bearing(BEACON, 0.1, field_of_view=2.0, max_range=60.0, bias_floor=0.05, inflation=1.2),
)
SYSTEM = od.System(od.Unicycle(wind="constant"), REAL)
START = np.array([3.0, -1.0, 0.4, 2.0, -1.0])
STEP, STEPS = 0.25, 24
INPUTS = np.column_stack([np.full(STEPS, 9.0), 0.5 * np.sin(0.7 * np.arange(STEPS))])
PATH = od.simulate(SYSTEM, START, INPUTS, STEP)


def gates(path: od.Trajectory) -> np.ndarray:
    """Shares (N, 2) of the range and the bearing, by hand."""
    to = np.array(BEACON) - path.x[:-1, :2]
    r = np.hypot(*to.T)
    cosine = (to[:, 0] * np.cos(path.x[:-1, 2]) + to[:, 1] * np.sin(path.x[:-1, 2])) / r
    within = [1 / (1 + np.exp((r / limit - 1) / 0.05)) for limit in (45.0, 60.0)]
    return np.column_stack([within[0], within[1] / (1 + np.exp((math.cos(1.0) - cosine) / 0.05))])


def test_the_path_of_these_tests_passes_through_the_limits():
    found = gates(PATH)
    assert found.max() > 0.9
    assert found.min() < 0.1
    assert ((found > 0.2) & (found < 0.8)).any(axis=0).all()


def test_blocks_are_those_of_plain_sensors_with_each_sample_weighted_from_below_by_hand():
    """Of a sensor with a constant error N b^2 in each of its N samples, and white (S^2 + b^2)(1 - g)/g for those that do not arrive."""
    plain = od.System(SYSTEM.vehicle, (od.GPS(1.0), od.Magnetometer(1.0), od.Range(BEACON, 1.0), od.Bearing(BEACON, 1.0)))
    blocks = od.variational_gramian(plain, PATH).blocks
    r = np.hypot(*(np.array(BEACON) - PATH.x[:-1, :2]).T)
    weights = np.empty((STEPS, 4))
    weights[:, 0] = (np.arange(STEPS) % 4 == 0) / ((1.4 * 2.0) ** 2 * 1.5 / 0.5)
    weights[:, 1] = (np.arange(STEPS) % 2 == 0) / (0.2**2 + 12 * 0.1**2)
    weights[:, 2] = gates(PATH)[:, 0] / ((1.0 + (0.05 * r) ** 2) * 1.2 / 0.8)
    s2, b2, g = (1.2 * 0.1) ** 2, 0.05**2, gates(PATH)[:, 1]
    weights[:, 3] = 1 / (s2 + STEPS * b2 + (s2 + b2) * (1 - g) / g)
    expected = blocks * weights[:, :, None, None]
    np.testing.assert_allclose(od.variational_gramian(SYSTEM, PATH).blocks, expected, rtol=1e-9, atol=1e-12 * np.abs(expected).max())


def test_the_empirical_gramian_tends_to_the_variational_one_at_order_2():
    exact = od.variational_gramian(SYSTEM, PATH).blocks
    errors = [np.abs(od.empirical_gramian(SYSTEM, PATH, eps).blocks - exact).max(axis=(0, 2, 3)) for eps in (0.02, 0.01, 0.005)]
    curved = np.array(errors)[:, [0, 2, 3]]  # a heading is linear in the start
    np.testing.assert_allclose(np.log2(curved[:-1] / curved[1:]), 2.0, atol=0.05)


def test_every_way_to_sum_the_information_of_such_sensors_gives_the_same():
    information = od.variational_gramian(SYSTEM, PATH)
    by_sensor = np.array([information.only(name).total for name in information.names])
    size = np.sqrt(np.diag(information.total))
    allowed = np.broadcast_to(1e-9 * np.outer(size, size), by_sensor.shape)
    np.testing.assert_array_less(np.abs(by_sensor.sum(axis=0) - information.total), allowed[0])
    np.testing.assert_array_less(np.abs(od.segment_information(SYSTEM, PATH, 6) - information.by_segment(6)).max(axis=0), allowed)
    for values in (
        od.segment_information(SYSTEM, PATH, 1)[0],
        od.sliding_information(SYSTEM, PATH, STEPS)[0],
        od.batch_information(SYSTEM, START[None], INPUTS, STEP)[0],
    ):
        np.testing.assert_array_less(np.abs(values - by_sensor), allowed)
    prior = od.Prior(START, std=(5.0, 4.0, 0.3, 1.0, 1.5))
    J, Phi = od.posterior_information(SYSTEM, PATH, prior)[-1], information.transition
    np.testing.assert_array_less(np.abs(Phi.T @ J @ Phi - prior.information - information.total), allowed[0])


@pytest.mark.parametrize("criterion", [od.LogDet(), od.MinEigenvalue(), od.TraceInverse()], ids=lambda value: type(value).__name__)
def test_a_gradient_through_limits_and_growing_noise_is_its_central_differences(criterion: object):
    scale = (5.0, 4.0, 0.3, 1.0, 1.5)
    value, gradient = od.information_gradient(SYSTEM, START, INPUTS, STEP, criterion, scale)
    expected = slopes(lambda u: od.information_value(SYSTEM, START, u, STEP, criterion, scale), INPUTS)
    assert value == od.information_value(SYSTEM, START, INPUTS, STEP, criterion, scale)
    assert np.abs(expected[:-2]).min() > 0
    np.testing.assert_allclose(gradient, expected, rtol=1e-6, atol=1e-8 * np.abs(expected).max())


def test_the_program_of_a_design_has_exact_derivatives_through_limits_and_growing_noise():
    scale, bounds = np.array([5.0, 4.0, 0.3, 1.0, 1.5]), {"speed": (5.0, 12.0), "turn_rate": (-0.6, 0.6)}
    problem = od.DesignProblem(SYSTEM, START, STEPS * STEP, STEP, od.PiecewiseConstant(4), bounds, scale=scale)
    p = np.array([[9.0, 0.3], [8.0, -0.4], [10.0, 0.5], [9.5, -0.2]])

    def judged(p: np.ndarray) -> np.ndarray:
        path = od.simulate(SYSTEM, START, np.repeat(p, STEPS // 4, axis=0), STEP)
        return od.variational_gramian(SYSTEM, path).total * np.outer(scale, scale)

    program = Program(problem)
    values = program.evaluate(p.ravel(order="F"))
    np.testing.assert_allclose(values.matrices[0], judged(p), rtol=1e-9)
    found = program.derivatives(values).matrices[0]
    for i, j in ((0, 0), (0, 2), (2, 2), (1, 4), (3, 3)):
        expected = slopes(lambda p, i=i, j=j: judged(p)[i, j], p).ravel(order="F")
        np.testing.assert_allclose(found[:, i, j], expected, rtol=1e-6, atol=1e-8 * np.abs(expected).max())


@pytest.mark.parametrize("distance", [60.0, 300.0, 1e5], ids=lambda value: f"{value:g} m")
def test_a_sensor_far_out_of_range_adds_nothing_to_the_gradient(distance: float):
    """Twelve times the maximum range of 5 m and more: what does not arrive has no slope either."""
    far = (START[0] + distance, START[1])
    alone = od.System(SYSTEM.vehicle, (od.GPS(2.0), od.Magnetometer(0.2)))
    helped = od.System(SYSTEM.vehicle, (*alone.sensors, od.Range(far, 1.0, max_range=5.0), od.Bearing(far, 0.1, max_range=5.0)))
    value, gradient = od.information_gradient(helped, START, INPUTS[:8], STEP, od.LogDet())
    expected, slope = od.information_gradient(alone, START, INPUTS[:8], STEP, od.LogDet())
    assert value == pytest.approx(expected, rel=1e-9)
    np.testing.assert_allclose(gradient, slope, rtol=1e-6, atol=1e-9)


# ---------------------------------------------------------------- filters

RUNS = 2000


def heading_errors(sensor: AbstractSensor, steps: int, samples: int, noise: np.ndarray, prior: float) -> tuple[np.ndarray, float]:
    """A filter of the heading at rest, fed by hand with noise (R, samples): errors (R,) and its variance."""
    system, path = resting(sensor, steps)
    runs, period = len(noise), steps // samples
    guess = np.random.default_rng(77).standard_normal(runs) * prior
    means = np.tile(path.x[0], (runs, 1))
    means[:, 2] += guess
    y = np.zeros((steps, runs, 1))
    y[::period, :, 0] = path.x[0, 2] + noise.T
    active = np.zeros((steps, 1), dtype=bool)
    active[::period] = True
    start = Belief(means, np.tile(np.diag([1.0, 1.0, prior**2]), (runs, 1, 1)))
    last = FilterBank(system, 1.0, np.zeros((3, 3))).run(start, path.u, y, active)
    return last.mean[-1][:, 2] - path.x[0, 2], last.covariance[-1, 0, 2, 2]


def correlated_noise(runs: int, samples: int, correlation: float, sigma: float) -> np.ndarray:
    white = np.random.default_rng(3).standard_normal((runs, samples))
    return sigma * white @ np.linalg.cholesky(ar1(samples, correlation)).T


@pytest.mark.parametrize("correlation", [0.5, 0.8, 0.99])
@pytest.mark.parametrize("period", [1, 3])
def test_a_filter_that_knows_of_the_correlation_is_consistent_and_one_that_does_not_is_not(correlation: float, period: int):
    """It is generalised least squares: variance 1/(1/P + 1'A^-1 1/s^2), A the correlations of the samples, whatever the steps between.

    Taking the samples for independent, it claims 1/(1/P + N/s^2) and has squared errors of (1/P + 1'A1/s^2) times the square of that.
    """
    sigma, prior, samples = 0.2, 0.5, 100
    noise, A = correlated_noise(RUNS, samples, correlation, sigma), ar1(samples, correlation)
    band = 5 * math.sqrt(2 / RUNS)
    rate = None if period == 1 else 1 / period
    errors, variance = heading_errors(od.Magnetometer(sigma, correlation=correlation, rate=rate), period * samples, samples, noise, prior)
    assert variance == pytest.approx(1 / (1 / prior**2 + np.linalg.inv(A).sum() / sigma**2), rel=1e-9)
    assert np.mean(errors**2) / variance == pytest.approx(1.0, rel=band)
    errors, variance = heading_errors(od.Magnetometer(sigma, rate=rate), period * samples, samples, noise, prior)
    assert variance == pytest.approx(1 / (1 / prior**2 + samples / sigma**2), rel=1e-9)
    expected = (1 / prior**2 + A.sum() / sigma**2) * variance
    assert np.mean(errors**2) / variance == pytest.approx(expected, rel=band)
    assert expected > 2.5


CASES: dict[str, dict[str, float]] = {
    "independent": {},
    "correlated": {"correlation": 0.7},
    "biased": {"bias_floor": 0.1},
    "inflated": {"inflation": 1.5},
    "growing": {"sigma_per_metre": 0.004},
    "all": {"correlation": 0.4, "bias_floor": 0.07, "inflation": 1.3, "sigma_per_metre": 0.003},
    "all, every second step": {"correlation": 0.4, "bias_floor": 0.07, "inflation": 1.3, "sigma_per_metre": 0.003, "rate": 0.5},
}


@pytest.mark.parametrize("fields", CASES.values(), ids=CASES.keys())
def test_validation_makes_the_errors_that_the_sensor_describes(fields: dict[str, float]):
    """A bearing at rest, its place known: generalised least squares over N samples y = h + b + v.

    The filter believes in R = (inflation spread)^2 A + bias^2 11', A the correlations of a first-order sequence: its variance is
    p = 1/(1/P + 1'R^-1 1). The truth is not inflated, T = spread^2 A + bias^2 11', so its errors have p^2 (1/P + 1'R^-1 T R^-1 1).
    """
    sigma, prior, steps, runs = 0.1, 0.4, 40, 500
    sensor = od.Bearing(BEACON, sigma, **fields)
    system, path = resting(sensor, steps)
    check = od.validate(system, path, prior=od.Prior(path.x[0], std=(1e-6, 1e-6, prior)), runs=runs, seed=1)
    r = math.hypot(BEACON[0] - path.x[0, 0], BEACON[1] - path.x[0, 1])
    spread = math.hypot(sigma, fields.get("sigma_per_metre", 0.0) * r)
    correlation, bias = fields.get("correlation", 0.0), fields.get("bias_floor", 0.0)
    for k in (0, 1, 7, 8, 39):
        N = k // 2 + 1 if "rate" in fields else k + 1
        T, R = ((factor * spread) ** 2 * ar1(N, correlation) + bias**2 for factor in (1.0, fields.get("inflation", 1.0)))
        weights = np.linalg.solve(R, np.ones(N))
        known = 1 / prior**2 + weights.sum()
        variance = (1 / prior**2 + weights @ T @ weights) / known**2
        assert check.bound[k, 2] == pytest.approx(known**-0.5, rel=1e-6)
        assert check.rmse[k, 2] ** 2 == pytest.approx(variance, rel=5 * math.sqrt(2 / runs))
        # two places as the prior has them, and the heading
        assert check.nees[k] == pytest.approx(2 + variance * known, abs=5 * math.sqrt(2 * (2 + (variance * known) ** 2) / runs))


def test_with_declared_correlation_the_filter_of_a_flight_is_consistent():
    system = od.System(od.Unicycle(), (od.GPS(2.0, correlation=0.6), od.Magnetometer(0.2, correlation=0.6)))
    u = np.column_stack([np.full(60, 5.0), 0.3 * np.sin(np.arange(60) / 5)])
    path = od.simulate(system, (0.0, 0.0, 0.4), u, 0.5)
    check = od.validate(system, path, prior=od.Prior(path.x[0], std=(3.0, 3.0, 0.3)), runs=100)
    assert check.nees[-1] == pytest.approx(3.0, abs=5 * math.sqrt(2 * 3 / 100))
    assert check.consistent


DRAWN = od.System(
    od.Unicycle(),
    (
        od.GPS(2.0, correlation=0.8, bias_floor=1.5, rate=1.0),
        od.Magnetometer(0.2),
        od.Range(BEACON, 1.0, correlation=0.5, bias_floor=0.3),
    ),
)


@pytest.fixture(scope="module")
def drawn() -> tuple[np.ndarray, np.ndarray]:
    """Noise (R, N, q) and constant errors (R, q) of many runs, steps of half a second."""
    path = od.simulate(DRAWN, (0.0, 0.0, 0.0), np.tile([1.0, 0.1], (60, 1)), 0.5)
    task = _MonteCarloTask(
        DRAWN,
        path,
        od.Prior(path.x[0], std=(1.0, 1.0, 1.0)),
        np.ones((60, 3), dtype=bool),
        ProcessNoise(((),) * 3),
        9,
        range(800),
        od.ExtendedKalmanFilter(),
        None,
    )
    draws = [_draws(task, run) for run in task.runs]
    return np.stack([draw[2] for draw in draws]), np.stack([draw[3] for draw in draws])


# the columns: GPS x and y, magnetometer, range
@pytest.mark.parametrize(
    ("column", "period", "correlation"), [(0, 2, 0.8), (1, 2, 0.8), (2, 1, 0.0), (3, 1, 0.5)], ids=["x", "y", "heading", "range"]
)
def test_the_noise_of_the_truth_is_a_first_order_sequence_from_sample_to_sample(
    drawn: tuple[np.ndarray, np.ndarray], column: int, period: int, correlation: float
):
    noise = drawn[0][:, ::period, column]
    runs, samples = noise.shape
    assert samples == 60 // period
    np.testing.assert_allclose(np.mean(noise**2, axis=0), 1.0, atol=5 * math.sqrt(2 / runs))  # the first sample like the last
    for lag in (1, 2, 5):
        products = noise[:, lag:] * noise[:, :-lag]
        # the mean over a run is one draw: its own spread tells how near the mean over all runs is
        each = products.mean(axis=1)
        assert abs(each.mean() - correlation**lag) < 5 * each.std() / math.sqrt(runs)
        np.testing.assert_allclose(products.mean(axis=0), correlation**lag, atol=5 * math.sqrt(2 / runs))
    fresh = noise[:, 1:] - correlation * noise[:, :-1]
    earlier = fresh[:, 1:] * fresh[:, :-1]
    assert abs(earlier.mean()) < 5 * (1 - correlation**2) / math.sqrt(earlier.size)


def test_the_constant_errors_of_the_truth_have_the_declared_spread_and_outputs_do_not_share_them(drawn: tuple[np.ndarray, np.ndarray]):
    noise, bias = drawn
    runs = len(bias)
    expected = np.array([1.5, 1.5, 0.0, 0.3])
    np.testing.assert_allclose(np.mean(bias**2, axis=0), expected**2, rtol=5 * math.sqrt(2 / runs))
    assert not bias[:, 2].any()
    np.testing.assert_allclose(np.mean(bias, axis=0), 0.0, atol=5 * 1.5 / math.sqrt(runs))
    unit = np.column_stack([bias[:, [0, 1, 3]] / expected[[0, 1, 3]], noise[:, 10]])
    correlations = unit.T @ unit / runs - np.eye(7)
    assert np.abs(correlations[~np.eye(7, dtype=bool)]).max() < 5 / math.sqrt(runs)


# ---------------------------------------------------------------- samples that do not arrive


def flown_past(**limits: float) -> tuple[od.System, od.Trajectory]:
    """Past a beacon 5 m to the left, from 30 m before it to 30 m behind."""
    sensors = (od.GPS(2.0), od.Range((30.0, 5.0), 0.5, **limits))
    system = od.System(od.Dubins(2.0), sensors)
    return system, od.simulate(system, (0.0, 0.0, 0.0), np.zeros(60), 0.5)


@pytest.mark.parametrize("limits", [{"max_range": 18.3}, {"field_of_view": 2.0}, {"max_range": 18.3, "field_of_view": 2.0}], ids=str)
def test_samples_out_of_range_or_view_do_not_reach_the_filter(limits: dict[str, float]):
    """The same truth and filter as without limits, the sensor being switched off by hand wherever it sees nothing."""
    system, path = flown_past(**limits)
    free, _ = flown_past()
    to = np.array([30.0, 5.0]) - path.x[:-1, :2]
    r, off = np.hypot(*to.T), np.abs(np.arctan2(to[:, 1], to[:, 0]))
    within = 1 / (1 + np.exp((r / limits.get("max_range", np.inf) - 1) / 0.05)) if "max_range" in limits else np.ones(60)
    view = 1 / (1 + np.exp((math.cos(limits["field_of_view"] / 2) - np.cos(off)) / 0.05)) if "field_of_view" in limits else np.ones(60)
    seen = within * view > 0.5
    assert 5 < seen.sum() < 55
    prior = od.Prior(path.x[0], std=(3.0, 3.0, 0.2))
    found = od.validate(system, path, prior=prior, runs=20)
    by_hand = od.validate(free, path, np.column_stack([np.ones(60, dtype=bool), seen]), prior=prior, runs=20)
    np.testing.assert_allclose(found.rmse, by_hand.rmse, rtol=1e-9)
    np.testing.assert_allclose(found.nees, by_hand.nees, rtol=1e-9)
    everything = od.validate(free, path, prior=prior, runs=20)
    assert np.abs(found.rmse - everything.rmse).max() > 0.01


def test_a_sensor_out_of_range_all_along_is_as_good_as_switched_off():
    system, path = flown_past(max_range=1.0)
    prior = od.Prior(path.x[0], std=(3.0, 3.0, 0.2))
    found = od.validate(system, path, prior=prior, runs=20)
    off = od.validate(system, path, [[True, False]], prior=prior, runs=20)
    np.testing.assert_array_equal(found.rmse, off.rmse)
    np.testing.assert_array_equal(found.nees, off.nees)
    np.testing.assert_allclose(found.bound, off.bound, rtol=1e-12)


# ---------------------------------------------------------------- bad input


def numbers(*values: object) -> list[object]:
    return [*values, np.nan, "2", True, None]


REFUSED = [
    *[("inflation", value, "must be a finite number above 0") for value in numbers(0.0, -1.0, np.inf)],
    *[("bias_floor", value, "must be a finite number of at least 0$") for value in numbers(-0.1, np.inf)],
    *[("correlation", value, "must be a finite number of at least 0 and below 1$") for value in numbers(-0.1, 1.0, 2.0)],
]
REFUSED_OF_BEACONS = [
    *[("sigma_per_metre", value, "must be a finite number of at least 0$") for value in numbers(-0.1, np.inf)],
    *[("max_range", value, "must be a finite number above 0") for value in numbers(0.0, -5.0, np.inf) if value is not None],
    *[("field_of_view", value, "must be a finite number above 0") for value in numbers(0.0, -1.0, np.inf) if value is not None],
    *[("field_of_view", value, r"must be below 2 pi \(None = no limit\)") for value in (2 * math.pi, 7.0)],
]


@pytest.mark.parametrize(("field", "value", "accepted"), REFUSED)
@EACH
def test_a_field_of_a_sensor_that_makes_no_sense_is_refused(make: Callable[..., AbstractSensor], field: str, value: object, accepted: str):
    with pytest.raises(od.InputError, match=rf"^{make().name}: {field} is {value!r}: {accepted}"):
        make(**{field: value})


@pytest.mark.parametrize(("field", "value", "accepted"), REFUSED_OF_BEACONS)
@LOOKING
def test_a_field_of_a_sensor_of_beacons_that_makes_no_sense_is_refused(make: Beacon, field: str, value: object, accepted: str):
    with pytest.raises(od.InputError, match=rf"^{make(BEACON, 1.0).name}: {field} is {value!r}: {accepted}"):
        make(BEACON, 1.0, **{field: value})


@LOOKING
def test_no_limits_are_the_default_and_cost_nothing(make: Beacon):
    plain = make(BEACON, 1.0)
    spelled = make(BEACON, 1.0, sigma_per_metre=0.0, max_range=None, field_of_view=None, inflation=1, bias_floor=0, correlation=0)
    assert plain == spelled
    assert hash(plain) == hash(spelled)
    assert {field.name for field in dataclasses.fields(plain)} == {
        *("beacon", "sigma", "sigma_per_metre", "max_range", "field_of_view"),
        *("rate", "inflation", "bias_floor", "correlation", "name", "height", "lever_arm", "detection", "scale", "bias", "group"),
        *(("mounting_angle",) if make is od.Bearing else ()),
    }


@pytest.mark.parametrize("share", [0.5, 1.0, 1.3, 1.7, 2.0, 2.6, 3.5, 10.0])
def test_a_sample_far_out_of_range_says_what_the_formula_of_the_gate_says(share: float) -> None:
    # one sample, beacon on the x axis: W_xx = g / sigma^2, g = 1 / (1 + exp((r / max_range - 1) / 0.05)); 4e-18 at 3 times the range
    system = od.System(od.Dubins(speed=1.0), (od.Range((100.0, 0.0), 2.0, max_range=100.0 / share),))
    path = od.simulate(system, [0.0, 0.0, 0.0], np.zeros((1, 1)), 1.0)
    found = od.variational_gramian(system, path)
    np.testing.assert_allclose(found.total[0, 0], 1 / (1 + np.exp((share - 1) / 0.05)) / 4, rtol=1e-11)
    np.testing.assert_allclose(found.std[0], 2.0 * np.sqrt(1 + np.exp((share - 1) / 0.05)), rtol=1e-11)


# ---------------------------------------------------------------- one sensor of two outputs, sensors off the middle

POSE = (od.GPS(1.0), od.Magnetometer(0.2))
NEAR: dict[str, object] = {
    "beacon": (30.0, 20.0),
    "sigma": 0.5,
    "sigma_per_metre": 0.02,
    "lever_arm": (0.8, -0.3),
    "height": 2.0,
    "max_range": 60.0,
}


@pytest.mark.parametrize("errors", [{}, {"correlation": 0.7}, {"bias_floor": 0.2}], ids=["white", "correlated", "biased"])
def test_a_range_and_bearing_sensor_says_what_the_two_say(errors: dict[str, float]):
    """Of the same place and with the same gate: Gramians, posterior and filter cannot tell one sensor of two outputs from two sensors."""
    both = od.RangeBearing(**NEAR, bearing_sigma=0.05, mounting_angle=0.4, **errors)  # type: ignore[arg-type]
    distance = od.Range(**NEAR, **errors)  # type: ignore[arg-type]
    direction = od.Bearing(**{**NEAR, "sigma": 0.05, "sigma_per_metre": 0.0}, mounting_angle=0.4, **errors)  # type: ignore[arg-type]
    joined, apart = od.System(od.Unicycle(), (*POSE, both)), od.System(od.Unicycle(), (*POSE, distance, direction))
    path = od.simulate(joined, (0.0, 0.0, 0.2), np.tile([2.0, 0.1], (20, 1)), 0.5)
    prior, psd = od.Prior(path.x[0], std=(2.0, 2.0, 0.3)), (0.01, 0.01, 0.001)
    totals = [od.variational_gramian(system, path).total for system in (joined, apart)]
    np.testing.assert_allclose(totals[0], totals[1], rtol=1e-9)
    J = [od.posterior_information(system, path, prior, psd) for system in (joined, apart)]
    np.testing.assert_allclose(J[0], J[1], rtol=1e-8)
    checks = [od.validate(system, path, prior=prior, disturbance_psd=psd, runs=5) for system in (joined, apart)]
    np.testing.assert_allclose(checks[0].rmse, checks[1].rmse, rtol=1e-7)
    if not errors:
        empirical = [od.empirical_gramian(system, path, eps=1e-4).total for system in (joined, apart)]
        np.testing.assert_allclose(empirical[0], empirical[1], rtol=1e-9)


def test_a_lever_arm_sees_the_heading_by_distances_alone():
    """A vehicle that stands still, two tags 1 m ahead and behind, three anchors: all is observable; from the middle not."""
    anchors = ((10.0, 0.0), (-4.0, 9.0), (-3.0, -8.0))
    still = {"speed": 0.0, "turn_rate": 0.0}
    tags = [od.Range(anchor, 0.1, lever_arm=(ahead, 0.0), height=2.0) for anchor in anchors for ahead in (1.0, -1.0)]
    assert od.observability(od.System(od.Unicycle(), tuple(tags)), held=still).dimension == 3
    middle = tuple(od.Range(anchor, 0.1, height=2.0) for anchor in anchors)
    assert od.observability(od.System(od.Unicycle(), middle), held=still).dimension == 2


def test_wind_is_seen_by_speed_and_course_over_ground_with_a_compass():
    """Heading, and the velocity over ground less what the airspeed makes of it: the wind, but no position."""
    system = od.System(od.Dubins(15.0, wind="constant"), (od.Magnetometer(0.1), od.SpeedOverGround(0.2), od.Course(0.05)))
    verdict = od.observability(system)
    assert verdict.dimension == 3
    assert set(verdict.observable_states) == {"heading", "wind_x", "wind_y"}


def test_a_velocity_that_nobody_knows_is_no_output():
    for vehicle, unknown in ((od.Unicycle(wind="unknown"), ()), (od.Unicycle(), ("speed",))):
        with pytest.raises(od.InputError, match=r"sensor 'course' needs the state 'y_rate', .*: a rate is one of the state and of known"):
            _ = od.System(vehicle, (od.Course(0.1),), unknown).model


def test_what_a_beacon_sensor_is_told_is_looked_at():
    for wrong, named in (({"height": np.inf}, "height"), ({"lever_arm": (1.0,)}, "lever_arm")):
        with pytest.raises(od.InputError, match=f"range: {named} is"):
            od.Range(BEACON, 1.0, **wrong)  # type: ignore[arg-type]
    with pytest.raises(od.InputError, match=r"range_bearing: bearing_sigma is 0\.0: must be a finite number above 0"):
        od.RangeBearing(BEACON, 1.0, bearing_sigma=0.0)


# ---------------------------------------------------------------- detection


def test_a_share_of_detections_is_a_share_of_the_information():
    """Of white noise, whatever else limits the samples; blocks of other sensors stay as they are."""
    near: dict[str, object] = {"beacon": (30.0, 20.0), "sigma": 0.5, "max_range": 40.0}
    systems = [od.System(od.Unicycle(), (od.GPS(1.0), od.Range(**near, detection=share))) for share in (1.0, 0.3)]  # type: ignore[arg-type]
    path = od.simulate(systems[0], (0.0, 0.0, 0.2), np.tile([2.0, 0.1], (20, 1)), 0.5)
    always, sometimes = (od.variational_gramian(system, path).blocks for system in systems)
    np.testing.assert_allclose(sometimes[:, 1], 0.3 * always[:, 1], rtol=1e-12)
    np.testing.assert_array_equal(sometimes[:, 0], always[:, 0])


def test_detections_are_drawn():
    """At t_0 a share of 0.3 of the runs has a fix of 1 cm, the others the prior's 10 m: the mean square is 70 m^2, a binomial share."""
    system = od.System(od.Unicycle(), (od.GPS(0.01, detection=0.3),))
    path = od.simulate(system, (0.0, 0.0, 0.0), np.zeros((4, 2)), 0.5)
    runs = 2000
    check = od.validate(system, path, prior=od.Prior(path.x[0], std=(10.0, 10.0, 0.1)), runs=runs)
    for k in range(4):
        missed = 0.7 ** (k + 1)
        spread = 5 * np.sqrt((3 * missed - missed**2) / runs)  # a square of fourth moment 3 with a chance of `missed`
        np.testing.assert_allclose(check.rmse[k, :2] ** 2 / 100.0, missed, atol=spread)
    np.testing.assert_allclose(check.nees, 3.0, atol=5 * np.sqrt(2 * 3 / runs))


def test_a_sensor_that_always_detects_draws_nothing():
    """The same seed gives the same flights as before there were detections."""
    random = np.random.default_rng(1)
    model = od.System(od.Unicycle(), (od.GPS(1.0),)).model
    assert detections(model, random, 5).all()
    assert random.random() == np.random.default_rng(1).random()


@pytest.mark.parametrize("value", [0.0, 1.5])
def test_a_share_of_detections_is_a_share(value: float):
    with pytest.raises(od.InputError, match=f"gps: detection is {value!r}: must be"):
        od.GPS(1.0, detection=value)
