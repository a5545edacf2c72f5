"""Paths that unknown inputs have moved: everything that walks along one takes its derivatives where the path really was."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import combinations
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from by_hand import (
    BEACON,
    NAMES,
    ONE_STEP,
    SCALE,
    SENSORS,
    SLOW,
    START,
    STEP,
    STEPS,
    Law,
    Swinging,
    assert_close,
    correlated_prior,
    derivative,
    numerical_rank,
    part,
    rate,
    slopes,
    stepped,
)
from hypothesis import given, settings
from hypothesis import strategies as st

import obsdesign as od
from obsdesign import native_code as native
from obsdesign.dynamics.scan import Scan
from obsdesign.exchange.trajectory_csv import trajectory_csv
from obsdesign.information.gramian import transition_matrices

few = settings(deadline=None, max_examples=5, database=None, derandomize=True)


def unknown_speed(x: np.ndarray, u: float, w: np.ndarray) -> np.ndarray:
    return np.array([w[0] * np.cos(x[2]), w[0] * np.sin(x[2]), u])


def unknown_turns(x: np.ndarray, u: float, w: np.ndarray) -> np.ndarray:
    return np.array([u * np.cos(x[2]), u * np.sin(x[2]), w[0]])


def unknown_wind(x: np.ndarray, u: float, w: np.ndarray) -> np.ndarray:
    return np.array([15.0 * np.cos(x[2]) + w[0], 15.0 * np.sin(x[2]) + w[1], u])


@dataclass(frozen=True)
class Case:
    """A vehicle, its law by hand, and ranges of its known and unknown inputs."""

    vehicle: object
    law: Law
    known: tuple[float, float]
    unknown: tuple[float, float]
    inputs: tuple[str, ...] = ()

    def system(self, sensors: tuple[object, ...] = SENSORS) -> od.System:
        return od.System(self.vehicle, sensors, self.inputs)

    def path(self, steps: int = STEPS, seed: int = 3) -> od.Trajectory:
        random, system = np.random.default_rng(seed), self.system()
        u, w = random.uniform(*self.known, (steps, 1)), random.uniform(*self.unknown, (steps, len(system.model.unknown_inputs)))
        return od.simulate(system, START[: len(system.model.states)], u, STEP, w, tolerance=ONE_STEP)


CASES = {
    "swinging": Case(Swinging(), rate, (-0.6, 0.6), (-2.0, 3.0)),
    "unknown speed": Case(od.Unicycle(), unknown_speed, (-0.6, 0.6), (5.0, 15.0), ("speed",)),
    "unknown turns": Case(od.Unicycle(), unknown_turns, (5.0, 15.0), (-0.6, 0.6), ("turn_rate",)),
    "unknown wind": Case(od.Dubins(15.0, wind="unknown"), unknown_wind, (-0.6, 0.6), (-9.0, 9.0)),
}
EACH = pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())
MOVED = pytest.mark.parametrize("case", [CASES["swinging"], CASES["unknown speed"]], ids=["swinging", "unknown speed"])


def without_w(path: od.Trajectory) -> od.Trajectory:
    return od.Trajectory(path.t, path.x, path.u, tolerance=path.tolerance)


# ---------------------------------------------------------------- the record


def test_a_simulated_path_keeps_the_unknown_inputs_it_was_given_and_no_others():
    case = CASES["swinging"]
    w = np.random.default_rng(0).uniform(-1, 1, (STEPS, 2))
    path = od.simulate(case.system(), START[:4], np.zeros(STEPS), STEP, w)
    np.testing.assert_array_equal(path.w, w)
    assert od.simulate(case.system(), START[:4], np.zeros(STEPS), STEP).w is None
    w[0] = 9.0
    assert path.w[0, 0] != 9.0
    with pytest.raises(ValueError, match="read-only"):
        path.w[0] = 1.0


@pytest.mark.parametrize(
    ("w", "message"),
    [
        (np.zeros((STEPS - 1, 2)), rf"w has shape \({STEPS - 1}, 2\): must be \({STEPS}, p\)"),
        (np.zeros((STEPS + 1, 2)), rf"w has shape \({STEPS + 1}, 2\): must be \({STEPS}, p\)"),
        (np.zeros(STEPS), rf"w has shape \({STEPS},\): must be \({STEPS}, p\)"),
        (np.where(np.arange(2 * STEPS).reshape(-1, 2) == 5, np.nan, 0.0), r"w\[2, 1\] is nan: must be finite"),
        ("wind", "trajectory: w is 'wind': must be an array of real numbers"),
    ],
)
def test_unknown_inputs_of_a_path_are_finite_and_have_a_row_for_each_step(w: object, message: str):
    path = CASES["swinging"].path()
    with pytest.raises(od.InputError, match=message):
        od.Trajectory(path.t, path.x, path.u, w)


def test_a_part_of_a_path_is_the_path_between_two_instants():
    path = CASES["swinging"].path()
    for whole in (path, without_w(path)):
        for first, last in ((0, STEPS), (0, 1), (5, 9), (STEPS - 1, STEPS)):
            found, expected = whole.part(first, last), part(whole, first, last)
            for name in ("t", "x", "u", "w"):
                np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    for first, last, name in ((-1, 3, "first"), (STEPS, STEPS + 1, "first"), (3, 3, "last"), (3, STEPS + 1, "last")):
        with pytest.raises(od.InputError, match=f"{name} is .*: must be a whole number from"):
            path.part(first, last)


# ---------------------------------------------------------------- everything that walks along a path

Walker = Callable[[od.System, od.Trajectory], object]


def prior_of(path: od.Trajectory) -> od.Prior:
    return correlated_prior(path.x.shape[1])


def named(system: od.System) -> tuple[str, ...]:
    return tuple(signal.name for signal in system.model.unknown_inputs)


WALKERS: dict[str, Walker] = {
    "variational": lambda system, path: od.variational_gramian(system, path).blocks,
    "end": lambda system, path: od.variational_gramian(system, path).transition,
    "integral": lambda system, path: od.variational_gramian(system, path, weighted=False).blocks,
    "empirical": lambda system, path: od.empirical_gramian(system, path, 1e-2).blocks,
    "empirical integral": lambda system, path: od.empirical_gramian(system, path, 1e-2, weighted=False).blocks,
    "transition": transition_matrices,
    "segments": lambda system, path: od.segment_information(system, path, 4),
    "windows": lambda system, path: od.sliding_information(system, path, 5),
    "batch": lambda system, path: od.batch_information(system, path.x[:3], path.u, STEP, path.w),
    "gradient": lambda system, path: od.information_gradient(system, path.x[0], path.u, STEP, od.MinEigenvalue(), w=path.w)[1],
    "posterior": lambda system, path: od.posterior_information(system, path, prior_of(path)),
    "posterior of unknown inputs": lambda system, path: od.posterior_information(
        system, path, prior_of(path), unknown_inputs=named(system)
    ),
    "unknown inputs": lambda system, path: od.unknown_input_information(system, path, prior_of(path), unknown_inputs=named(system)),
    "validation": lambda system, path: od.validate(system, path, prior=prior_of(path), runs=3).rmse,
}
ALONG_A_RECORD = [name for name in WALKERS if name not in ("batch", "gradient")]


@EACH
@pytest.mark.parametrize("walker", WALKERS.values(), ids=WALKERS.keys())
def test_no_unknown_inputs_and_unknown_inputs_of_0_are_the_same_bit_for_bit(walker: Walker, case: Case):
    system, moved = case.system(SLOW), case.path()
    for path in (od.simulate(system, moved.x[0], moved.u, STEP, tolerance=ONE_STEP), without_w(moved)):
        zeros = od.Trajectory(path.t, path.x, path.u, np.zeros_like(moved.w), path.tolerance)
        np.testing.assert_array_equal(walker(system, path), walker(system, zeros))


@MOVED
@pytest.mark.parametrize("walker", WALKERS.values(), ids=WALKERS.keys())
def test_unknown_inputs_that_the_path_tells_count(walker: Walker, case: Case):
    system, path = case.system(), case.path()
    told, silent = walker(system, path), walker(system, without_w(path))
    assert np.abs(told - silent).max() > 1e-4 * np.abs(silent).max()


@pytest.mark.parametrize("walker", [WALKERS[name] for name in ALONG_A_RECORD if name != "transition"])
def test_a_path_with_unknown_inputs_of_another_system_is_refused(walker: Walker):
    path, system = CASES["swinging"].path(), CASES["swinging"].system()
    with pytest.raises(od.InputError, match=r"path has 1 unknown inputs: the system has 2 \(gust, push\)"):
        walker(system, od.Trajectory(path.t, path.x, path.u, path.w[:, :1]))


def test_of_a_system_without_unknown_inputs_a_path_has_none():
    system = od.System(od.Dubins(15.0), SENSORS)
    path = od.simulate(system, START[:3], np.full(STEPS, 0.1), STEP, np.zeros((STEPS, 0)))
    np.testing.assert_array_equal(od.variational_gramian(system, path).blocks, od.variational_gramian(system, without_w(path)).blocks)
    with pytest.raises(od.InputError, match=r"path has 2 unknown inputs: the system has 0 \(none\)"):
        od.variational_gramian(system, od.Trajectory(path.t, path.x, path.u, np.zeros((STEPS, 2))))


@pytest.mark.parametrize("mode", ["0", "1"], ids=["virtual machine", "machine code"])
def test_rows_of_no_width_are_walked_along(mode: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """One for all steps, one for each, and one for each of each path."""
    monkeypatch.setenv(native.ENVIRONMENT_VARIABLE, mode)
    monkeypatch.setattr(native, "cache_folder", lambda: tmp_path)
    x, u, none = ca.SX.sym("x", 2), ca.SX.sym("u", 1), ca.SX.sym("none", 0)
    scan = Scan(x, [none, u, none, none], 0.5 * x + u, [x + u])
    rows = np.random.default_rng(0).standard_normal((40, 1))
    run = scan.run(np.ones((3, 2)), [np.empty(0), rows, np.empty((40, 0)), np.empty((3, 40, 0))], 40)
    expected = np.ones(2)
    for k in range(40):
        np.testing.assert_array_equal(run.results[0][:, k], np.tile(expected + rows[k], (3, 1)))
        expected = 0.5 * expected + rows[k]
        np.testing.assert_array_equal(run.carries[:, k], np.tile(expected, (3, 1)))


# ---------------------------------------------------------------- sensitivities and Gramians


def moves(case: Case, path: od.Trajectory) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """F_k and B_k of each step, by the complex step."""
    F, B = [], []
    for x, u, w in zip(path.x[:-1], path.u[:, 0], path.w, strict=True):
        F.append(derivative(lambda x, u=u, w=w: stepped(x, u, w, STEP, case.law), x))
        B.append(derivative(lambda w, x=x, u=u: stepped(x + 0j, u, w, STEP, case.law), w))
    return F, B


def sample_rows(path: od.Trajectory, sensors: tuple[object, ...] = SENSORS) -> list[np.ndarray]:
    """(dy/dx) / sigma (q, n) of the samples at each step."""
    law = {
        "gps": lambda x: x[:2],
        "magnetometer": lambda x: x[2:3],
        "range": lambda x: np.sqrt((BEACON[0] - x[0]) ** 2 + (BEACON[1] - x[1]) ** 2)[None],
        "bearing": lambda x: np.arctan((BEACON[1] - x[1]) / (BEACON[0] - x[0]))[None] - x[2],  # but for half turns, which are constant
    }
    rows = []
    for k, x in enumerate(path.x[:-1]):
        due = [sensor for sensor in sensors if sensor.rate is None or k % round(1 / (sensor.rate * STEP)) == 0]
        rows.append(np.vstack([np.empty((0, len(x))), *(derivative(law[sensor.name], x) / sensor.sigma for sensor in due)]))
    return rows


@EACH
def test_the_sensitivity_is_the_product_of_the_derivatives_of_the_steps_that_were_taken(case: Case):
    path = case.path()
    F = moves(case, path)[0]
    Phi = [np.eye(path.x.shape[1])]
    for step in F:
        Phi.append(step @ Phi[-1])
    found = transition_matrices(case.system(), path)
    np.testing.assert_allclose(found, Phi, rtol=1e-12, atol=1e-11)


@EACH
@pytest.mark.parametrize("sensors", [SENSORS, SLOW], ids=["every step", "slow"])
def test_the_gramian_is_that_of_the_samples_of_the_path_that_was_flown(case: Case, sensors: tuple[object, ...]):
    system, path = case.system(sensors), case.path()
    Phi, W = np.eye(path.x.shape[1]), []
    for F, rows in zip(moves(case, path)[0], sample_rows(path, sensors), strict=True):
        W.append((rows @ Phi).T @ (rows @ Phi))
        Phi = F @ Phi
    expected = np.array(W)
    total = expected.sum(axis=0)
    assert_close(od.variational_gramian(system, path).blocks.sum(axis=1), expected, 1e-11, total)
    sums = expected.reshape(4, -1, *total.shape).sum(axis=1)
    assert_close(od.segment_information(system, path, 4).sum(axis=1), sums, 1e-11, total)
    assert_close(od.batch_information(system, path.x[:1], path.u, STEP, path.w, tolerance=ONE_STEP).sum(axis=1), total[None], 1e-11)
    value = od.information_value(system, path.x[0], path.u, STEP, od.LogDet(), SCALE[: len(total)], w=path.w, tolerance=ONE_STEP)
    S = np.diag(SCALE[: len(total)])
    assert value == pytest.approx(od.LogDet().value(S @ total @ S), rel=1e-9)


@EACH
@pytest.mark.parametrize("window", [1, 5, STEPS])
def test_a_window_is_the_gramian_of_that_part_of_the_path(case: Case, window: int):
    system, path = case.system(), case.path()
    found = od.sliding_information(system, path, window).sum(axis=1)
    expected = [od.variational_gramian(system, path.part(k, k + window)).total for k in range(STEPS - window + 1)]
    assert_close(found, np.array(expected), 1e-11)


@few
@given(cut=st.integers(1, STEPS - 1), seed=st.integers(0, 10**6))
@pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())
def test_a_path_is_its_first_part_followed_by_the_rest(case: Case, cut: int, seed: int):
    system, path = case.system(), case.path(seed=seed)
    whole, first, second = (od.variational_gramian(system, each) for each in (path, path.part(0, cut), path.part(cut, STEPS)))
    joined = first.then(second)
    assert_close(joined.total, whole.total, 1e-10)
    np.testing.assert_allclose(joined.transition, whole.transition, rtol=1e-10, atol=1e-10)


def test_the_integral_along_a_line_of_unknown_speeds_is_that_of_the_distance():
    """GPS notices a turn of the start by the distance s(t) from it: integrals of s^2 and s, s linear within each step."""
    system, speeds = od.System(od.Unicycle(), (od.GPS(2.0),), ("speed",)), np.random.default_rng(0).uniform(-5.0, 15.0, STEPS)
    path = od.simulate(system, np.zeros(3), np.zeros(STEPS), STEP, speeds)
    s = np.concatenate([[0.0], np.cumsum(speeds * STEP)])
    first, second = STEP * np.sum(s[:-1] + s[1:]) / 2, STEP * np.sum(s[:-1] ** 2 + s[:-1] * s[1:] + s[1:] ** 2) / 3
    expected = np.array([[STEPS * STEP, 0.0, 0.0], [0.0, STEPS * STEP, first], [0.0, first, second]])
    assert_close(od.variational_gramian(system, path, weighted=False).total, expected, 1e-12)


def disturbed(path: od.Trajectory) -> od.Trajectory:
    """A log: neither known nor unknown inputs explain all of it."""
    return od.Trajectory(path.t, path.x + 0.05 * np.random.default_rng(1).standard_normal(path.x.shape), path.u, path.w)


@EACH
@pytest.mark.parametrize(
    ("log", "weighted"),
    [(False, True), (False, False), (True, True), pytest.param(True, False, marks=pytest.mark.slow)],
    ids=["simulated", "simulated, integral", "a log", "a log, integral"],
)
def test_the_empirical_gramian_tends_to_the_variational_one_as_eps_squared(case: Case, weighted: bool, log: bool):
    system = case.system()
    path = disturbed(case.path()) if log else case.path()
    exact = od.variational_gramian(system, path, weighted).total
    size = np.sqrt(np.outer(np.diag(exact), np.diag(exact)))
    errors = [np.abs((od.empirical_gramian(system, path, eps, weighted).total - exact) / size).max() for eps in (0.02, 0.01, 0.005)]
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 2.0, atol=0.05)
    assert od.perturbation(system, path, weighted=weighted).suitable


@EACH
@pytest.mark.parametrize("criterion", [od.LogDet(), od.MinEigenvalue()], ids=lambda criterion: type(criterion).__name__)
def test_the_gradient_is_its_central_differences(case: Case, criterion: object):
    system, path = case.system(SLOW), case.path(16)
    n = path.x.shape[1]
    value, gradient = od.information_gradient(system, path.x[0], path.u, STEP, criterion, SCALE[:n], w=path.w, tolerance=ONE_STEP)
    value_of = partial(od.information_value, system, path.x[0], w=path.w, tolerance=ONE_STEP)
    expected = slopes(lambda u: value_of(u, STEP, criterion, SCALE[:n]), path.u)
    assert np.abs(expected).max() > 0
    np.testing.assert_allclose(gradient, expected, rtol=1e-6, atol=1e-8 * np.abs(expected).max() + 1e-11 * abs(value))


@pytest.mark.parametrize("function", [od.information_value, od.information_gradient], ids=["value", "gradient"])
def test_unknown_inputs_of_a_value_or_a_gradient_have_a_row_for_each_step(function: Callable[..., object]):
    system, path = CASES["swinging"].system(), CASES["swinging"].path()
    for w, message in ((path.w[:-1], f"u has {STEPS} steps and w {STEPS - 1}"), (path.w[:, :1], r"w has shape .* must be \(N, 2\)")):
        with pytest.raises(od.InputError, match=message):
            function(system, path.x[0], path.u, STEP, od.LogDet(), w=w)


def test_a_landmark_that_only_the_unknown_speed_leads_to_is_found():
    """At 1 m/s along y = 0 the landmark (3, 0) is met at step 6."""
    system = od.System(od.Unicycle(), (od.GPS(1.0), od.Range((3.0, 0.0), 1.0)), ("speed",))
    u, w, met = np.zeros((12, 1)), np.ones((12, 1)), r"'range' has no derivative at step 6 \(t = 3 s\)"
    path = od.simulate(system, np.zeros(3), u, 0.5, w)
    for walk in (
        lambda: od.segment_information(system, path, 4),
        lambda: od.batch_information(system, path.x[:1], u, 0.5, w),
        lambda: od.information_value(system, path.x[0], u, 0.5, od.LogDet(), w=w),
        lambda: od.posterior_information(system, path, od.Prior(np.zeros(3), std=np.ones(3)), unknown_inputs=("speed",)),
    ):
        with pytest.raises(od.InputError, match=met):
            walk()


# ---------------------------------------------------------------- the posterior: one big least squares


def normal_matrix(case: Case, path: od.Trajectory, prior: od.Prior, psd: np.ndarray, base: int, samples: int) -> np.ndarray:
    """Of z = (x_base, v_0, w_0, v_1, ...): the prior of x_0, noise v_k of N(0, psd dt), and the samples at the first so many steps."""
    F, B = moves(case, path)
    n, p = len(prior.mean), path.w.shape[1]
    kicks = [np.hstack([np.eye(n), inputs]) for inputs in B]
    size = n + path.steps * (n + p)

    def kick(k: int) -> np.ndarray:
        place = np.zeros((n, size))
        place[:, n + k * (n + p) : n + (k + 1) * (n + p)] = kicks[k]
        return place

    states = {base: np.eye(n, size)}
    for k in range(base, path.steps):
        states[k + 1] = F[k] @ states[k] + kick(k)
    for k in reversed(range(base)):
        states[k] = np.linalg.solve(F[k], states[k + 1] - kick(k))
    A = np.diag(np.concatenate([np.zeros(n), np.tile(np.concatenate([1 / (psd * STEP), np.zeros(p)]), path.steps)]))
    A += states[0].T @ prior.information @ states[0]
    for k, rows in enumerate(sample_rows(path)[:samples]):
        A += (rows @ states[k]).T @ (rows @ states[k])
    return A


def left_of(A: np.ndarray, kept: np.ndarray) -> np.ndarray:
    """Information about those kept, all others being eliminated; those that nothing is known of take nothing away."""
    rest = np.setdiff1d(np.flatnonzero(np.diag(A) > 0), kept)
    return A[np.ix_(kept, kept)] - A[np.ix_(kept, rest)] @ np.linalg.solve(A[np.ix_(rest, rest)], A[np.ix_(rest, kept)])


TINY = np.full(4, 1e-3)
SHORT = 8


@EACH
def test_the_posterior_is_what_least_squares_leave_when_the_unknown_inputs_are_eliminated(case: Case):
    system, path = case.system(), case.path(SHORT)
    n = path.x.shape[1]
    prior, psd = prior_of(path), TINY[:n]
    J = od.posterior_information(system, path, prior, psd, named(system))
    size = od.posterior_information(system, path, prior, psd)
    for k in range(SHORT + 1):
        expected = left_of(normal_matrix(case, path, prior, psd, k, min(k + 1, SHORT)), np.arange(n))
        assert_close(J[k], expected, 1e-8, size[k])


@EACH
def test_what_is_known_of_an_input_is_what_least_squares_leave_of_it(case: Case):
    system, path = case.system(), case.path(SHORT)
    n, p = path.x.shape[1], path.w.shape[1]
    prior, psd = prior_of(path), TINY[:n]
    found = od.unknown_input_information(system, path, prior, psd, named(system))
    A = normal_matrix(case, path, prior, psd, 0, SHORT)
    for k in range(SHORT - 1):
        kept = n + k * (n + p) + n + np.arange(p)
        assert_close(found[k], left_of(A, kept), 1e-8, A[np.ix_(kept, kept)])
    assert not found[-1].any()


@EACH
def test_without_anything_unknown_the_posterior_is_prior_and_gramian_transported(case: Case):
    system, path = case.system(), case.path()
    prior = prior_of(path)
    W, Phi = od.variational_gramian(system, path), transition_matrices(system, path)
    back = np.linalg.inv(Phi[-1])
    expected = back.T @ (prior.information + W.total) @ back
    assert_close(od.posterior_information(system, path, prior)[-1], expected, 1e-9)


# ---------------------------------------------------------------- what is seen, and what the verdict says

SUBSETS = [subset for size in range(1, 5) for subset in combinations(range(4), size)]


@pytest.mark.parametrize("case", [CASES["unknown speed"], CASES["unknown turns"]], ids=["unknown speed", "unknown turns"])
@pytest.mark.parametrize("subset", SUBSETS, ids=lambda subset: "+".join(NAMES[i] for i in subset))
def test_for_those_who_know_the_inputs_the_rank_of_the_gramian_is_the_dimension_that_sensors_see(subset: tuple[int, ...], case: Case):
    sensors = tuple(SENSORS[i] for i in subset)
    known = od.System(case.vehicle, sensors)
    assert numerical_rank(od.variational_gramian(case.system(sensors), case.path()).total) == od.observability(known).dimension


@few
@given(speed=st.floats(0.5, 30.0), heading=st.floats(-3.0, 3.0), sigma=st.floats(0.1, 5.0))
def test_gps_shows_the_heading_of_a_unicycle_of_unknown_speed_as_far_as_it_moves(speed: float, heading: float, sigma: float):
    """Two fixes v dt apart tell a turn by their errors across the track: (v dt)^2 / (2 sigma^2). Along it they tell the speed.

    Where it does not move, or the path does not tell that it does, there is the prior and no more.
    """
    system = od.System(od.Unicycle(), (od.GPS(sigma),), ("speed",))
    assert od.observability(system).observable
    prior = od.Prior((0.0, 0.0, heading), std=(1e5, 1e5, 0.3))
    for w in (speed, 0.0, None):
        path = od.simulate(system, prior.mean, np.zeros(2), STEP, None if w is None else np.full(2, w))
        J = od.posterior_information(system, path, prior, unknown_inputs=("speed",))
        std = od.standard_deviations(J[1])[2]
        assert std**-2 == pytest.approx(0.3**-2 + ((w or 0.0) * STEP) ** 2 / (2 * sigma**2), rel=1e-6)


def test_a_unicycle_that_stands_shows_what_the_verdict_says_of_speed_0():
    """To those who know that it stands."""
    system = od.System(od.Unicycle(), (od.GPS(1.0),), ("speed",))
    held = od.observability(od.System(od.Unicycle(), (od.GPS(1.0),)), held={"speed": 0.0})
    path = od.simulate(system, START[:3], np.full(STEPS, 0.1), STEP, np.zeros((STEPS, 1)))
    W = od.variational_gramian(system, path)
    assert held.unobservable_states == ("heading",)
    assert numerical_rank(W.total) == held.dimension == 2
    assert W.std[2] == np.inf


# ---------------------------------------------------------------- filters and files


def test_the_truth_of_a_validation_follows_unknown_inputs_that_its_filters_do_not_know():
    """Filters that know their start and hardly look fly without wind: the truth is carried away from them."""
    system = od.System(od.Dubins(15.0, wind="unknown"), (od.GPS(1e6),))
    path = CASES["unknown wind"].path()
    still = od.simulate(system, path.x[0], path.u, STEP)
    check = od.validate(system, path, prior=od.Prior(path.x[0], std=(1e-5,) * 3), runs=4)
    np.testing.assert_allclose(check.rmse, np.abs(path.x - still.x), atol=1e-3)
    assert np.abs(path.x - still.x).max() > 5.0
    assert check.verdict == "overconfident"


@EACH
def test_the_bound_of_a_validation_is_that_of_the_path_with_its_unknown_inputs(case: Case):
    system, path = case.system(), case.path()
    prior, psd = prior_of(path), np.full(path.x.shape[1], 0.1)
    check = od.validate(system, path, prior=prior, runs=3, disturbance_psd=psd)
    np.testing.assert_allclose(check.bound, od.standard_deviations(od.posterior_information(system, path, prior, psd)), rtol=1e-12)


@EACH
def test_a_table_of_a_path_has_its_unknown_inputs_as_further_columns(case: Case):
    system, path = case.system(), case.path()
    header, *rows = csv.reader(io.StringIO(trajectory_csv(system, path)))
    plain_header, *plain = csv.reader(io.StringIO(trajectory_csv(system, without_w(path))))
    p = path.w.shape[1]
    assert header == [*plain_header, *(f"{signal.name} [{signal.unit or '-'}]" for signal in system.model.unknown_inputs)]
    assert [row[:-p] for row in rows] == plain
    np.testing.assert_array_equal(np.array([row[-p:] for row in rows[:-1]], dtype=float), path.w)
    assert rows[-1][-p:] == [""] * p
    assert np.array_equal(np.array([row[1 : 1 + path.x.shape[1]] for row in rows], dtype=float), path.x)
    assert plain[-1][-path.u.shape[1] :] == [""] * path.u.shape[1]
