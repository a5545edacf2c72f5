"""A filter from event to event of a log: on a grid the same as ever, between its instants what the equations say."""

import casadi as ca
import numpy as np
import pytest
from scipy.linalg import expm

import obsdesign as od

BEACONS = ((60.0, 0.0), (0.0, 50.0), (-40.0, -30.0))
SYSTEM = od.System(od.Unicycle(), (od.GPS(1.0), *(od.Range(place, 0.5, name=f"beacon_{i}") for i, place in enumerate(BEACONS))))
NAMES = SYSTEM.model.sensor_names
PRIOR, PSD = od.Prior([0.5, -0.5, 0.1], std=(1.0, 1.0, 0.2)), (0.01, 0.01, 0.001)
x = ca.SX.sym("x", 2)
MASS = od.ControlAffineSystem(
    state=x, names=("x", "v"), drift=ca.vertcat(x[1], 0), known={"u": ca.vertcat(0, 1)}, outputs={"a": x[0], "b": x[1]},
    sigmas={"a": 0.5, "b": 0.3},
)  # fmt: skip


def test_on_a_grid_it_is_the_filter_of_equal_steps():
    random = np.random.default_rng(0)
    u = np.column_stack([2.0 + np.sin(np.arange(80) / 9), 0.3 * np.cos(np.arange(80) / 7)])
    truth = od.simulate(SYSTEM, [0.0, 0.0, 0.0], u, 0.25)
    y = np.column_stack([truth.x[:-1, :2], *(np.hypot(*(truth.x[:-1, :2] - place).T) for place in BEACONS)]) + 0.3 * random.standard_normal(
        (80, 5)
    )
    active = random.random((80, 4)) < 0.3
    k, s = np.nonzero(active)
    values = np.where((s == 0)[:, None], y[k, :2], np.column_stack([y[k, np.where(s == 0, 0, s + 1)], np.full(len(k), np.nan)]))
    order = random.permutation(len(k))
    log = od.Log(od.LogInputs(("speed", "turn_rate"), truth.t[:-1], u), od.LogSamples(NAMES, truth.t[k][order], s[order], values[order]))
    for estimator in (None, od.UnscentedKalmanFilter(), od.ExtendedKalmanFilter(gate=od.Gate(0.99)), od.FixedIntervalSmoother()):
        even = od.estimate_states(SYSTEM, PRIOR, u, y, 0.25, active=active, disturbance_psd=PSD, estimator=estimator)
        found = od.estimate_log(SYSTEM, log, PRIOR, disturbance_psd=PSD, estimator=estimator)
        assert found.t == pytest.approx(even.t, abs=1e-12)
        assert found.mean == pytest.approx(even.mean, rel=1e-10, abs=1e-10)
        assert found.covariance == pytest.approx(even.covariance, rel=1e-9, abs=1e-11)
        assert (found.arrived == even.arrived).all() and (found.rejected == even.rejected).all()
        assert found.nis == pytest.approx(even.nis, rel=1e-8, nan_ok=True)


def kalman(samples, inputs, psd, prior):
    """The textbook filter: exact transitions between all times, one scalar sample after the other."""
    (times, C, y, R), (u_times, u) = samples, inputs
    A = np.array([[0.0, 1.0], [0.0, 0.0]])
    m, P, now = prior.mean, prior.covariance, min(times.min(), u_times[0])
    for t in np.unique(np.concatenate([times, u_times])):
        if t > now:
            held = u[np.searchsorted(u_times, now, side="right") - 1]
            h = t - now
            m = expm(A * h) @ m + np.array([h**2 / 2, h]) * held
            P = expm(A * h) @ P @ expm(A * h).T + np.diag(psd) * h
            now = t
        for i in np.flatnonzero(times == t):
            S = C[i] @ P @ C[i] + R[i]
            K = P @ C[i] / S
            m, P = m + K * (y[i] - C[i] @ m), P - np.outer(K, C[i] @ P)
    return m, P


def test_between_instants_it_is_the_textbook_filter_with_several_samples_at_one_time_and_sigmas_of_their_own():
    random = np.random.default_rng(1)
    times = random.uniform(0.0, 10.0, 40)
    times[30:] = times[:10]  # at times that have samples, often of the same sensor
    sensor, y = random.integers(0, 2, 40), random.standard_normal(40)
    sigma = np.where(random.random(40) < 0.3, 1.2, np.nan)
    u_times, u = np.sort(np.append(0.0, random.uniform(0.0, 10.0, 6))), random.standard_normal(7)
    prior, psd = od.Prior([0.3, -0.2], std=(1.0, 2.0)), np.array([0.02, 0.1])
    log = od.Log(od.LogInputs(("u",), u_times, u[:, None]), od.LogSamples(("a", "b"), times, sensor, y, sigma))
    R = np.where(np.isnan(sigma), np.array([0.5, 0.3])[sensor], sigma) ** 2
    m, P = kalman((times, np.eye(2)[sensor], y, R), (u_times, u), psd, prior)
    for estimator in (od.ExtendedKalmanFilter(), od.UnscentedKalmanFilter(), od.IteratedExtendedKalmanFilter()):
        found = od.estimate_log(MASS, log, prior, disturbance_psd=psd, estimator=estimator)
        assert found.mean[-2] == pytest.approx(m, rel=1e-9, abs=1e-9)
        assert found.covariance[-2] == pytest.approx(P, rel=1e-9, abs=1e-10)
    assert int(found.arrived.sum()) == 40
    path = od.simulate(MASS, [0.3, -0.2], u[:, None], np.diff(np.append(u_times, 10.5)))
    J = od.posterior_information(MASS, path, prior, psd, samples=log)  # linear: what can be known is what the filter knows
    last = od.estimate_log(MASS, od.Log(log.inputs, log.samples.where(log.samples.t < u_times[-1])), prior, disturbance_psd=psd)
    at = int(np.searchsorted(last.t, u_times[-1], side="right")) - 1
    assert np.linalg.inv(J[-2]) == pytest.approx(last.covariance[at], rel=1e-8)


def test_samples_moved_to_a_grid_of_their_own_distance_are_not_moved_at_all():
    times = 0.5 * np.arange(20)
    log = od.Log(od.LogInputs(("u",), [0.0], [[0.1]]), od.LogSamples(("a", "b"), times, np.arange(20) % 2, np.cos(times)))
    prior = od.Prior([1.0, 0.0], std=(1.0, 1.0))
    free, grid = (od.estimate_log(MASS, log, prior, disturbance_psd=(0.01, 0.01), step=step) for step in (None, 0.5))
    assert grid.mean == pytest.approx(free.mean, abs=1e-12)


def test_information_along_the_estimate_is_what_the_filter_knows_of_a_linear_system():
    random = np.random.default_rng(3)
    times = np.repeat(np.sort(random.uniform(0.0, 10.0, 15)), 2)
    log = od.Log(
        od.LogInputs(("u",), [0.0, 5.0], [[0.1], [-0.2]]),
        od.LogSamples(("a", "b"), times, random.integers(0, 2, 30), random.standard_normal(30)),
    )
    prior, psd = od.Prior([1.0, 0.0], std=(1.0, 1.0)), (0.01, 0.02)
    estimate = od.estimate_log(MASS, log, prior, disturbance_psd=psd)
    path = od.path_of_estimate(MASS, log, estimate)
    J = od.posterior_information(MASS, path, prior, psd, samples=log)
    last = np.append(np.diff(estimate.t) > 0, True)
    assert np.linalg.inv(J) == pytest.approx(estimate.covariance[last], rel=1e-8, abs=1e-10)
    with pytest.raises(od.InputError, match="estimate is of the states x, v: the system has x, y, heading"):
        od.path_of_estimate(SYSTEM, log, estimate)


def test_validation_reads_sensors_when_the_log_did():
    random = np.random.default_rng(2)
    path = od.simulate(MASS, [0.0, 1.0], 0.1 * random.standard_normal((40, 1)), 0.25)
    every = od.Log(None, od.LogSamples(("a", "b"), np.repeat(path.t[:-1], 2), np.tile([0, 1], 40), np.zeros(80)))
    prior, psd = od.Prior(path.x[0], std=(1.0, 1.0)), (0.01, 0.02)
    by_rates = od.validate(MASS, path, prior=prior, runs=40, disturbance_psd=psd)
    assert od.validate(MASS, path, prior=prior, runs=40, disturbance_psd=psd, samples=every).bound == pytest.approx(
        by_rates.bound, rel=1e-9
    )
    some = od.Log(None, od.LogSamples(("a", "b"), np.sort(random.uniform(0.0, 9.9, 60)), random.integers(0, 2, 60), np.zeros(60)))
    check = od.validate(MASS, path, prior=prior, runs=200, disturbance_psd=psd, samples=some)
    assert check.t == pytest.approx(path.t) and check.consistent
    # of a linear filter the error is the bound: chi-square, 200 runs
    assert check.rmse == pytest.approx(check.bound, rel=0.25)
    only = od.Log(None, some.samples.only(["a"]))
    half, alone = (
        od.validate(MASS, path, schedule, prior=prior, runs=2, samples=log).bound
        for schedule, log in ((np.array([[True, False]]), some), (None, only))
    )
    assert half == pytest.approx(alone, rel=1e-9)


def test_a_log_that_does_not_fit_the_filter_is_refused_by_name():
    inputs, samples = od.LogInputs(("u",), [0.0], [[0.1]]), od.LogSamples(("a",), [0.0, 1.0], [0, 0], [1.0, 2.0])
    prior = od.Prior([0.0, 0.0], std=(1.0, 1.0))
    for log, message in (
        (od.Log(None, samples), "there is no input 'u'"),
        (od.Log(inputs, od.LogSamples(("c",), [0.0, 1.0], [0, 0], [1.0, 2.0])), "has no 'c'"),
    ):
        with pytest.raises(od.InputError, match=message):
            od.estimate_log(MASS, log, prior)
    with pytest.raises(od.InputError, match="prior has 3 states"):
        od.estimate_log(MASS, od.Log(inputs, samples), PRIOR)
    biased = od.System(od.Unicycle(), (od.Range((5.0, 5.0), 0.5, bias_floor=0.2, name="a"),))
    own = od.Log(
        od.LogInputs(("speed", "turn_rate"), [0.0], [[1.0, 0.1]]), od.LogSamples(("a",), [0.0, 1.0], [0, 0], [7.0, 6.0], [0.1, 0.1])
    )
    with pytest.raises(od.InputError, match="'a' has a sigma of its own: that is accepted for"):
        od.estimate_log(biased, own, PRIOR)
