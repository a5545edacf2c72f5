"""Filters and smoothers against least squares, exact moments and hand-made updates; gates against filters that are wrong."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from conftest import ROOT
from scipy.linalg import block_diag, expm
from scipy.optimize import least_squares
from scipy.stats import binom, chi2

import obsdesign as od


def test_the_example_of_the_page_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    example = re.findall(r"```python\n(.*?)```", (ROOT / "docs/filters.md").read_text(), flags=re.DOTALL)[0]
    (tmp_path / "example.py").write_text(example)
    runpy.run_path(str(tmp_path / "example.py"))
    assert re.match(r"\('gps: 2[0-2] of 400 samples rejected by the gate, first at t = 25 s',\)", capsys.readouterr().out)


# ---------------------------------------------------------------- linear systems: least squares of all that is known

A = np.array([[-0.3, 1.2, 0.1], [-0.9, -0.2, 0.4], [0.0, 0.1, -0.05]])
H = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, -1.0]])
STEP, STEPS, N = 0.2, 12, 3
PSD = np.array([[0.05, 0.01, 0.0], [0.01, 0.04, -0.005], [0.0, -0.005, 0.02]])
PRIOR = od.Prior((1.0, -1.0, 0.5), covariance=np.array([[2.0, 0.5, 0.1], [0.5, 1.0, -0.2], [0.1, -0.2, 0.5]]))
SIGMAS = np.array([0.3, 0.5])
FILTERS = {
    "extended": od.ExtendedKalmanFilter(),
    "iterated": od.IteratedExtendedKalmanFilter(2),
    "unscented": od.UnscentedKalmanFilter(),
    "unscented, far points": od.UnscentedKalmanFilter(4.0),
}


def linear_system() -> od.ControlAffineSystem:
    x = ca.SX.sym("x", N)
    outputs = {"first": H[:1] @ x, "second": H[1:] @ x}
    return od.ControlAffineSystem(x, ("a", "b", "c"), ca.SX(A) @ x, outputs=outputs, sigmas=dict(zip(outputs, SIGMAS, strict=True)))


def samples_of_some() -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(3)
    return random.standard_normal((STEPS, 2)), random.random((STEPS, 2)) < 0.6


def least_squares_of_all(y: np.ndarray, active: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The mean and covariance of all states x_0 .. x_N together: prior, steps and samples as rows of one linear problem."""
    F, whole = expm(A * STEP), N * (STEPS + 1)
    rows, right, weights = [np.eye(N, whole)], [PRIOR.mean], [np.linalg.inv(PRIOR.covariance)]
    for k in range(STEPS):
        rows.append(np.zeros((N, whole)))
        rows[-1][:, N * k : N * (k + 2)] = np.hstack([-F, np.eye(N)])
        right.append(np.zeros(N))
        weights.append(np.linalg.inv(PSD * STEP))
        rows.append(np.zeros((2, whole)))
        rows[-1][:, N * k : N * (k + 1)] = H
        right.append(y[k])
        weights.append(np.diag(active[k] / SIGMAS**2))
    C, W = np.vstack(rows), block_diag(*weights)
    covariance = np.linalg.inv(C.T @ W @ C)
    return (covariance @ C.T @ W @ np.concatenate(right)).reshape(-1, N), covariance


@pytest.mark.parametrize("name", FILTERS)
def test_a_smoother_is_the_least_squares_of_all_samples(name: str):
    y, active = samples_of_some()
    mean, covariance = least_squares_of_all(y, active)
    smoother = od.FixedIntervalSmoother(FILTERS[name])
    system = linear_system()
    estimate = od.estimate_states(
        system, PRIOR, np.zeros((STEPS, 0)), np.where(active, y, np.nan), STEP, active=active, disturbance_psd=PSD, estimator=smoother
    )
    np.testing.assert_allclose(estimate.mean, mean, rtol=1e-6, atol=1e-6)
    blocks = [covariance[N * k : N * (k + 1), N * k : N * (k + 1)] for k in range(STEPS + 1)]
    np.testing.assert_allclose(estimate.covariance, blocks, rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("name", FILTERS)
def test_a_filter_is_the_least_squares_of_the_samples_so_far(name: str):
    y, active = samples_of_some()
    u = np.zeros((STEPS, 0))
    estimate = od.estimate_states(linear_system(), PRIOR, u, y, STEP, active=active, disturbance_psd=PSD, estimator=FILTERS[name])
    for k in (0, 3, STEPS):
        mean, covariance = least_squares_of_all(y, active & (np.arange(STEPS)[:, None] <= k))
        np.testing.assert_allclose(estimate.mean[k], mean[k], rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(estimate.covariance[k], covariance[N * k : N * (k + 1), N * k : N * (k + 1)], rtol=1e-6, atol=1e-7)


def test_innovations_are_what_is_new():
    """e = y - H x_predicted, S = H P H' + R, of the least squares of the samples before; NaN where there is no sample."""
    y, active = samples_of_some()
    estimate = od.estimate_states(linear_system(), PRIOR, np.zeros((STEPS, 0)), y, STEP, active=active, disturbance_psd=PSD)
    k = 5
    mean, covariance = least_squares_of_all(y, active & (np.arange(STEPS)[:, None] < k))
    P = covariance[N * k : N * (k + 1), N * k : N * (k + 1)]
    e, S = y[k] - H @ mean[k], np.diag(H @ P @ H.T) + SIGMAS**2
    np.testing.assert_allclose(estimate.innovations[k], np.where(active[k], e, np.nan), rtol=1e-6)
    np.testing.assert_allclose(estimate.innovation_std[k] ** 2, np.where(active[k], S, np.nan), rtol=1e-6)
    np.testing.assert_allclose(estimate.nis[k], np.where(active[k], e**2 / S, np.nan), rtol=1e-5)
    np.testing.assert_array_equal(np.isnan(estimate.nis), ~active)
    np.testing.assert_array_equal(estimate.arrived, active)


@pytest.mark.parametrize("name", FILTERS)
def test_steps_of_any_length_between_samples_change_nothing(name: str):
    """Steps cut in unequal parts, without samples in between: where the step is exact (a place, a heading), so are filter and smoother."""
    system, random = od.System(od.Unicycle(), (od.GPS(1.0), od.Magnetometer(0.1))), np.random.default_rng(8)
    prior, psd, u = od.Prior((0.0, 0.0, 0.0), std=(3.0, 3.0, 0.5)), (0.02, 0.03, 0.01), np.tile([0.0, 0.1], (6, 1))
    y, cut = random.standard_normal((6, 3)), np.array([0.3, 0.7, 0.5, 0.2, 0.9, 0.4])
    for estimator in (FILTERS[name], od.FixedIntervalSmoother(FILTERS[name])):
        whole = od.estimate_states(system, prior, u, y, 1.0, disturbance_psd=psd, estimator=estimator)
        lengths = np.column_stack([cut, 1 - cut]).ravel()
        parts = od.estimate_states(
            system,
            prior,
            np.repeat(u, 2, axis=0),
            np.repeat(y, 2, axis=0),
            lengths,
            active=np.tile((np.arange(12) % 2 == 0)[:, None], 2),
            disturbance_psd=psd,
            estimator=estimator,
        )
        np.testing.assert_allclose(parts.t[::2], whole.t, rtol=1e-12)
        np.testing.assert_allclose(parts.mean[::2], whole.mean, rtol=1e-8, atol=1e-9)
        np.testing.assert_allclose(parts.covariance[::2], whole.covariance, rtol=1e-8, atol=1e-9)


@pytest.mark.parametrize("name", ["extended", "unscented"])
def test_a_smoother_knows_errors_that_last(name: str):
    """A place that drifts along x, seen with correlated and constant errors: generalised least squares with their full covariance."""
    steps, psd, phi, bias = 9, 0.04, 0.8, 0.7
    system = od.System(od.Unicycle(), (od.GPS(0.5, correlation=phi, bias_floor=bias), od.GPS(0.9)))
    y = np.random.default_rng(5).standard_normal((steps, 4))
    prior, smoother = od.Prior((0.3, 0.0, 0.0), std=(2.0, 1.0, 1.0)), od.FixedIntervalSmoother(FILTERS[name])
    estimate = od.estimate_states(system, prior, np.zeros((steps, 2)), y, 1.0, disturbance_psd=(psd, 0.0, 0.0), estimator=smoother)
    lags = np.abs(np.subtract.outer(np.arange(steps), np.arange(steps)))
    state = 4.0 + psd * np.minimum.outer(np.arange(steps + 1), np.arange(steps + 1))
    noise = block_diag(0.25 * phi**lags + bias**2, 0.81 * np.eye(steps))
    C = np.vstack([np.eye(steps, steps + 1)] * 2)
    gain = state @ C.T @ np.linalg.inv(C @ state @ C.T + noise)
    np.testing.assert_allclose(estimate.mean[:, 0], 0.3 + gain @ (np.concatenate([y[:, 0], y[:, 2]]) - 0.3), rtol=1e-8)
    np.testing.assert_allclose(estimate.covariance[:, 0, 0], np.diag(state - gain @ C @ state), rtol=1e-8)


# ---------------------------------------------------------------- curved samples and steps


def curved(h: ca.SX, x: ca.SX, drift: ca.SX | None = None, sigma: float = 1.0) -> od.ControlAffineSystem:
    names = tuple("abcde"[: x.numel()])
    return od.ControlAffineSystem(x, names, drift, outputs={"y": h}, sigmas={"y": sigma})


def test_the_unscented_filter_is_exact_on_a_parabola():
    """x ~ N(m, s^2), h = a x^2 + b x + c: E h = a (m^2 + s^2) + b m + c, var h = 2 a^2 s^4 + (2 a m + b)^2 s^2, cov = (2 a m + b) s^2."""
    m, s, a, b, c, sigma, reading = 0.7, 1.3, 0.8, -0.5, 2.0, 0.4, 5.0
    x = ca.SX.sym("x")
    system = curved(a * x**2 + b * x + c, x, sigma=sigma)
    estimate = od.estimate_states(
        system, od.Prior((m,), std=(s,)), np.zeros((1, 0)), [[reading]], 1.0, estimator=od.UnscentedKalmanFilter()
    )
    expected, variance = a * (m**2 + s**2) + b * m + c, 2 * a**2 * s**4 + (2 * a * m + b) ** 2 * s**2 + sigma**2
    gain = (2 * a * m + b) * s**2 / variance
    assert estimate.innovations[0, 0] == pytest.approx(reading - expected, rel=1e-12)
    assert estimate.innovation_std[0, 0] == pytest.approx(np.sqrt(variance), rel=1e-12)
    assert estimate.mean[0, 0] == pytest.approx(m + gain * (reading - expected), rel=1e-12)
    assert estimate.covariance[0, 0, 0] == pytest.approx(s**2 - gain**2 * variance, rel=1e-12)


@pytest.mark.parametrize("kappa", [None, 0.0, 2.5])
@pytest.mark.parametrize("n", [2, 3, 5])
def test_unscented_means_of_quadratic_functions_are_exact(n: int, kappa: float | None):
    """The step a' = x'M x of the others, which stay, is quadratic, and so is the output: E x'M x = m'M m + tr M P."""
    random = np.random.default_rng(n)
    M = random.standard_normal((n - 1, n - 1))
    M, root, m = M + M.T, random.standard_normal((n, n)), random.standard_normal(n)
    x = ca.SX.sym("x", n)
    rest = x[1:]
    system = curved(rest.T @ ca.SX(M) @ rest, x, ca.vertcat(rest.T @ ca.SX(M) @ rest, ca.SX.zeros(n - 1)), sigma=1e6)
    P = root @ root.T + 0.1 * np.eye(n)
    estimate = od.estimate_states(
        system, od.Prior(m, covariance=P), np.zeros((1, 0)), [[0.0]], 0.5, active=[[True]], estimator=od.UnscentedKalmanFilter(kappa)
    )
    expected = m[1:] @ M @ m[1:] + np.trace(M @ P[1:, 1:])
    assert estimate.innovations[0, 0] == pytest.approx(-expected, rel=1e-10)
    assert estimate.mean[1, 0] == pytest.approx(m[0] + 0.5 * expected, rel=1e-6)


def test_the_iterated_filter_finds_the_most_likely_state():
    """Two ranges and a bearing, a position known to 20 m: least squares of prior and samples, and the inverse of its normal matrix."""
    sensors = (od.Range((0.0, 40.0), 0.5), od.Range((60.0, 10.0), 0.5), od.Bearing((0.0, 40.0), 0.02))
    system, mean, std = od.System(od.Unicycle(), sensors), np.array([5.0, -10.0, 0.3]), np.array([20.0, 20.0, 0.2])
    y = np.array([[38.0, 45.0, 1.6]])

    def residuals(x: np.ndarray) -> np.ndarray:
        to = [np.hypot(x[0] - 0.0, x[1] - 40.0), np.hypot(x[0] - 60.0, x[1] - 10.0), np.arctan2(40.0 - x[1], 0.0 - x[0]) - x[2]]
        return np.concatenate([(x - mean) / std, (y[0] - to) / [0.5, 0.5, 0.02]])

    best = least_squares(residuals, mean, method="lm", xtol=1e-15, ftol=1e-15, gtol=1e-15)
    estimates = [
        od.estimate_states(system, od.Prior(mean, std), np.zeros((1, 2)), y, 1.0, estimator=od.IteratedExtendedKalmanFilter(count))
        for count in (1, 15)
    ]
    np.testing.assert_allclose(estimates[1].mean[0], best.x, rtol=1e-7)
    np.testing.assert_allclose(estimates[1].covariance[0], np.linalg.inv(best.jac.T @ best.jac), rtol=1e-5, atol=1e-9)
    extended = od.estimate_states(system, od.Prior(mean, std), np.zeros((1, 2)), y, 1.0)
    np.testing.assert_array_equal(estimates[0].mean, extended.mean)


@pytest.mark.parametrize("name", ["extended", "unscented"])
def test_a_bearing_near_the_cut_is_a_small_residual(name: str):
    """A beacon dead astern is at pi from the nose: readings on both sides of the cut are the same to within their noise."""
    system = od.System(od.Unicycle(), (od.Bearing((-50.0, 0.0), 0.05),))
    prior = od.Prior((0.0, 0.0, 0.0), std=(1.0, 1.0, 0.02))
    for reading in (np.pi - 0.01, 0.01 - np.pi):
        estimate = od.estimate_states(system, prior, np.zeros((1, 2)), [[reading]], 1.0, estimator=FILTERS[name])
        short_way = reading - np.copysign(np.pi, reading)
        assert estimate.innovations[0, 0] == pytest.approx(short_way, abs=1e-3)


# ---------------------------------------------------------------- the gate

STANDING = od.System(od.Unicycle(), (od.GPS(1.0, name="first"), od.GPS(1.0, name="second"), od.GPS(1.0, name="third")))
DRIFT = (0.01, 0.01, 0.0)


def standing(estimator: object, y: np.ndarray, start: float = 0.0, std: float = 1.0, sensors: int = 3) -> od.Estimate:
    """A vehicle that stays at (0, 0) but for its drift; the filter believes in `start` for x."""
    system = od.System(od.Unicycle(), STANDING.sensors[:sensors])
    prior = od.Prior((start, 0.0, 0.0), std=(std, std, 0.1))
    return od.estimate_states(system, prior, np.zeros((len(y), 2)), y, 1.0, disturbance_psd=DRIFT, estimator=estimator)  # type: ignore[arg-type]


GATED = {"extended": od.ExtendedKalmanFilter(gate=od.Gate()), "unscented": od.UnscentedKalmanFilter(gate=od.Gate())}


@pytest.mark.parametrize("name", GATED)
def test_a_gate_keeps_out_its_share_of_good_samples(name: str):
    """0.1 % of 6,000 samples, each chi-square of two degrees of freedom: within the binomial distribution's 1e-4 tails; no alarm."""
    random, steps = np.random.default_rng(0), 2000
    drift = np.cumsum(random.standard_normal((steps, 2)) * 0.1, axis=0)
    y = np.tile(drift, 3) + random.standard_normal((steps, 6))
    estimate = standing(GATED[name], y, std=0.1)
    low, high = binom.ppf([1e-4, 1 - 1e-4], 3 * steps, 0.001)
    assert low <= estimate.rejected.sum() <= high
    np.testing.assert_array_equal(estimate.rejected, estimate.nis > chi2.ppf(0.999, 2))
    assert not estimate.alarms.any()


def test_outliers_are_kept_out():
    """Every fifth sample is 50 m off: with the gate all and only these are kept out, and the estimate is that without them."""
    random, steps = np.random.default_rng(1), 200
    y = random.standard_normal((steps, 2)) * 0.5
    outlier = np.arange(steps) % 5 == 3
    y[outlier] += 50.0
    gated = standing(GATED["extended"], y, sensors=1)
    system, prior = od.System(od.Unicycle(), STANDING.sensors[:1]), od.Prior((0.0, 0.0, 0.0), std=(1.0, 1.0, 0.1))
    without = od.estimate_states(system, prior, np.zeros((steps, 2)), y, 1.0, disturbance_psd=DRIFT, active=~outlier[:, None])
    np.testing.assert_array_equal(gated.rejected[:, 0], outlier)
    np.testing.assert_allclose(gated.mean, without.mean, atol=1e-12)
    np.testing.assert_allclose(gated.covariance, without.covariance, atol=1e-12)
    assert gated.notes == ("first: 40 of 200 samples rejected by the gate, first at t = 3 s",)


def test_an_alarm_inflates_by_the_least_factor():
    """By hand, x ~ N(0, 1), sigma 1, both readings 10: P times (10^2 - 1) / 1 = 99, so that e^2 = S; the gain is 0.99."""
    system, prior = od.System(od.Unicycle(), (od.GPS(1.0),)), od.Prior((0.0, 0.0, 0.0), std=(1.0, 1.0, 0.1))
    for estimator in (od.ExtendedKalmanFilter(gate=od.Gate(alarm=1)), od.UnscentedKalmanFilter(gate=od.Gate(alarm=1))):
        estimate = od.estimate_states(system, prior, np.zeros((1, 2)), [[10.0, 10.0]], 1.0, estimator=estimator)
        assert estimate.alarms[0, 0]
        assert not estimate.rejected[0, 0]
        np.testing.assert_allclose(estimate.mean[0, :2], 9.9, rtol=1e-12)
        np.testing.assert_allclose(np.diag(estimate.covariance[0]), [0.99, 0.99, 0.99], rtol=1e-9)


@pytest.mark.parametrize("name", GATED)
def test_a_filter_that_is_wrong_and_sure_of_it_is_not_locked_out(name: str):
    """100 m off with 1 m: a gate without an alarm takes in nothing for ever; with one it notices at the tenth sample of each sensor."""
    y = np.random.default_rng(2).standard_normal((300, 6))
    deaf = standing(od.ExtendedKalmanFilter(gate=od.Gate(alarm=10**6)), y, start=100.0)
    assert deaf.rejected.mean() > 0.99
    estimate = standing(GATED[name], y, start=100.0)
    assert estimate.alarms[9].any()
    assert not estimate.alarms[:9].any()
    assert estimate.rejected[:9].all()
    assert estimate.rejected[40:].mean() < 0.02
    errors = np.abs(estimate.mean[60:, :2]) / estimate.std[60:, :2]
    assert np.sqrt(np.mean(errors**2)) < 2.0
    assert any("locked out" in note for note in estimate.notes)


def test_a_sensor_that_is_wrong_calls_fewer_and_fewer_alarms():
    """One of three is 60 m off for ever. Each alarm doubles the count that the next needs: at most log2(600 / 10) + 1 of them."""
    y = np.random.default_rng(3).standard_normal((600, 6))
    y[:, 4:] += 60.0
    estimate = standing(GATED["extended"], y)
    assert 1 <= estimate.alarms[:, 2].sum() <= 7
    assert np.median(np.abs(estimate.mean[:, 0])) < 1.0
    assert "third: more samples were rejected than taken in: it does not fit the model or the other sensors" in estimate.notes


# ---------------------------------------------------------------- numbers that are none


@pytest.mark.parametrize("name", FILTERS)
def test_a_sample_without_a_derivative_is_named_and_never_spreads(name: str):
    """At the beacon itself neither distance nor direction has a derivative; points about it have values."""
    system = od.System(od.Unicycle(), (od.GPS(1.0), od.Range((3.0, 4.0), 1.0), od.Bearing((3.0, 4.0), 0.1)))
    prior = od.Prior((3.0, 4.0, 0.0), std=(1.0, 1.0, 0.1))
    estimate = od.estimate_states(system, prior, np.zeros((3, 2)), np.ones((3, 4)), 1.0, estimator=FILTERS[name])
    assert np.isfinite(estimate.mean).all()
    assert np.isfinite(estimate.covariance).all()
    assert not estimate.rejected.any()
    is_linear = not isinstance(FILTERS[name], od.UnscentedKalmanFilter)
    assert estimate.unusable.sum(axis=0).tolist() == ([0, 1, 1] if is_linear else [0, 0, 0])
    if is_linear:
        assert "range: 1 of 3 samples could not be predicted, first at t = 0 s" in estimate.notes


def test_samples_that_are_there_are_finite_and_others_may_be_anything():
    y = np.ones((3, 2))
    y[1] = np.nan
    system, prior = od.System(od.Unicycle(), (od.GPS(1.0),)), od.Prior((0.0, 0.0, 0.0), std=(1.0, 1.0, 0.1))
    with pytest.raises(od.InputError, match=r"y\[1, 0\] \(gps_x\) is nan: a sample that is there must be finite; `active` says which are"):
        od.estimate_states(system, prior, np.zeros((3, 2)), y, 1.0)
    estimate = od.estimate_states(system, prior, np.zeros((3, 2)), y, 1.0, active=np.isfinite(y[:, :1]))
    assert np.isfinite(estimate.mean).all()
    assert np.isnan(estimate.innovations[1]).all()


WRONG: dict[str, dict[str, object]] = {
    r"^y has shape \(3, 1\)": {"y": np.ones((3, 1))},
    r"^active has shape \(2, 1\)": {"active": np.ones((2, 1))},
    r"^dt is -1\.0": {"dt": -1.0},
    "^disturbance_psd": {"disturbance_psd": (1.0,)},
}


@pytest.mark.parametrize("message", WRONG)
def test_what_does_not_fit_is_refused(message: str):
    arguments = {"u": np.zeros((3, 2)), "y": np.ones((3, 2)), "dt": 1.0, **WRONG[message]}
    with pytest.raises(od.InputError, match=message):
        od.estimate_states(od.System(od.Unicycle(), (od.GPS(1.0),)), od.Prior((0.0, 0.0, 0.0), std=(1.0, 1.0, 0.1)), **arguments)  # type: ignore[arg-type]


@pytest.mark.parametrize("make", [lambda: od.Gate(1.0), lambda: od.Gate(alarm=0), lambda: od.UnscentedKalmanFilter(-1.0)])
def test_options_outside_their_ranges_are_refused(make: object):
    with pytest.raises(od.InputError, match=r"probability|alarm|kappa"):
        make()  # type: ignore[operator]


# ---------------------------------------------------------------- unknown inputs as states

GUSTY = od.System(od.Dubins(5.0, wind="unknown"), (od.GPS(1.0), od.Magnetometer(0.1)))


def test_a_wind_that_is_a_state_without_noise_is_a_constant_wind():
    steady, walking = od.System(od.Dubins(5.0, wind="constant"), GUSTY.sensors), od.InputStates(GUSTY, {"wind_x": 1, "wind_y": 1})
    start, u = (0.0, 0.0, 0.3, 2.0, -1.0), np.full((20, 1), 0.2)
    paths = [od.simulate(system, start, u, 0.5) for system in (steady, walking)]
    assert walking.model.state_names == steady.model.state_names
    np.testing.assert_array_equal(paths[0].x, paths[1].x)
    totals = [od.variational_gramian(system, path).total for system, path in zip((steady, walking), paths, strict=True)]
    np.testing.assert_allclose(totals[0], totals[1], rtol=1e-12)


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_states_of_an_input_are_the_polynomial_class(degree: int):
    """w^(K + 1) = 0: the verdict on (x, w, ..., w^(K)) is that for disturbances that are polynomials of degree K."""
    system = od.System(od.Dubins(5.0, wind="unknown"), (od.Range((30.0, 10.0), 1.0),))
    states = od.InputStates(system, {"wind_x": degree + 1, "wind_y": degree + 1})
    verdict = od.observability(system, disturbance=od.Polynomial(degree))
    assert od.observability(states).dimension == verdict.dimension
    assert len(states.model.states) == 3 + 2 * (degree + 1)


def test_a_filter_estimates_a_wind_and_its_rate():
    """A wind that grows by 0.05 m/s^2: with (w, w') as states the filter ends within three of its standard deviations."""
    system = od.InputStates(GUSTY, {"wind_x": 2, "wind_y": 1})
    assert system.model.state_names == ("x", "y", "heading", "wind_x", "wind_x_rate", "wind_y")
    assert [signal.unit for signal in system.model.states[3:]] == ["m/s", "m/s/s", "m/s"]
    psd = system.process_psd({"wind_x": 1e-6, "wind_y": 1e-4}, (0.0, 0.0, 1e-5))
    np.testing.assert_array_equal(np.diag(psd), [0, 0, 1e-5, 0, 1e-6, 1e-4])
    truth = od.simulate(system, (0.0, 0.0, 0.0, 1.0, 0.05, -1.0), np.full((200, 1), 0.05), 0.5)
    y = truth.x[:-1, :3] + np.random.default_rng(4).standard_normal((200, 3)) * [1.0, 1.0, 0.1]
    prior = od.Prior((0.0, 0.0, 0.0, 0.0, 0.0, 0.0), std=(1.0, 1.0, 0.1, 3.0, 0.2, 3.0))
    estimate = od.estimate_states(system, prior, truth.u, y, 0.5, disturbance_psd=psd)
    assert (np.abs(estimate.mean[-1] - truth.x[-1]) < 3 * estimate.std[-1]).all()
    assert estimate.std[-1, 4] < 0.02
