"""Steps as exact as is asked: against closed forms, exponentials and an independent integrator of order 8."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Literal

import casadi as ca
import numpy as np
import pytest
from numpy.typing import ArrayLike
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import obsdesign as od
from obsdesign.dynamics.scan import Scan
from obsdesign.dynamics.simulation import substeps_along
from obsdesign.dynamics.step import Step, looped_step, step_of
from obsdesign.information.gramian import sensitivity_scan, transition_matrices


def free(drift: Callable[[ca.SX], ca.SX], n: int, output: int = 0) -> od.ControlAffineSystem:
    x = ca.SX.sym("x", n)
    return od.ControlAffineSystem(x, tuple(f"x{i}" for i in range(n)), drift(x), outputs={"y": x[output]})


def coasting(system: od.ControlAffineSystem, start: ArrayLike, steps: int, dt: float, tolerance: float = 1e-6) -> od.Trajectory:
    return od.simulate(system, start, np.zeros((steps, 0)), dt, tolerance=tolerance)


def reference(system: od.ControlAffineSystem, start: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """States (N+1, n) and dx(t)/dx(0) (N+1, n, n), integrated together at order 8 to 1e-13."""
    model, n = system.model, len(start)
    function = ca.Function("f", [model.x], [model.drift, ca.densify(ca.jacobian(model.drift, model.x))])

    def rate(_: float, both: np.ndarray) -> np.ndarray:
        f, J = (value.full() for value in function(both[:n]))
        return np.concatenate([f.ravel(), (J @ both[n:].reshape(n, n)).ravel()])

    first = np.concatenate([start, np.eye(n).ravel()])
    found = solve_ivp(rate, (t[0], t[-1]), first, method="DOP853", rtol=1e-13, atol=1e-14, t_eval=t).y.T
    return found[:, :n], found[:, n:].reshape(-1, n, n)


def errors(system: od.ControlAffineSystem, path: od.Trajectory) -> tuple[float, float]:
    """Largest errors of x and Phi along a path, relative to the largest value of each entry."""
    x, Phi = reference(system, path.x[0], path.t)
    off, off_Phi = np.abs(path.x - x).max(axis=0), np.abs(transition_matrices(system, path) - Phi).max(axis=0)
    return float((off / np.abs(x).max(axis=0)).max()), float((off_Phi / (np.abs(Phi).max(axis=0) + 1e-9)).max())


# ---------------------------------------------------------------- what the issue has


def test_a_state_that_decays_within_a_step():
    """v = e^(-10 t): v(5) = e^-50, and the four samples after the first say 1 part in 5e8 of what it says: sigma 1."""
    system = free(lambda x: -10 * x, 1)
    path = coasting(system, [1.0], 5, 1.0)
    assert path.x[-1, 0] == pytest.approx(np.exp(-50.0), rel=1e-6)
    assert od.variational_gramian(system, path).std == pytest.approx([1.0], rel=1e-6)


def test_an_oscillator_with_two_radians_a_step():
    """y_k = cos(10 t_k) q + sin(10 t_k) / 10 q': least squares over the 20 rows."""
    system = free(lambda x: ca.vertcat(x[1], -100 * x[0]), 2)
    found = od.variational_gramian(system, coasting(system, [1.0, 0.0], 20, 0.2)).std
    t = 0.2 * np.arange(20)
    rows = np.column_stack([np.cos(10 * t), np.sin(10 * t) / 10])
    np.testing.assert_allclose(found, np.sqrt(np.diag(np.linalg.inv(rows.T @ rows))), rtol=1e-6)
    np.testing.assert_allclose(found, [0.310, 3.23], rtol=2e-3)


# ---------------------------------------------------------------- linear systems of any stiffness


@pytest.mark.parametrize("rate", [-1e4, -1000.0, -50.0, -0.01])
@pytest.mark.parametrize("dt", [0.1, 1.0])
def test_a_stiff_linear_system_has_the_exponential_for_its_steps(rate: float, dt: float):
    A = np.array([[0.0, 1.0, 0.0], [-4.0, -0.2, 1.0], [0.0, 0.0, rate]])
    system = free(lambda x: ca.DM(A) @ x + ca.DM([0.0, 0.3, 0.1]), 3)
    path = coasting(system, [1.0, 0.5, 2.0], 12, dt)
    full = np.zeros((4, 4))
    full[:3, :3], full[:3, 3] = A, [0.0, 0.3, 0.1]
    expected = np.array([expm(full * t) for t in path.t])
    np.testing.assert_allclose(path.x, (expected @ [1.0, 0.5, 2.0, 1.0])[:, :3], rtol=2e-6, atol=1e-7)
    np.testing.assert_allclose(transition_matrices(system, path), expected[:, :3, :3], rtol=0, atol=2e-6)


@pytest.mark.parametrize("weighted", [True, False])
def test_the_integral_of_a_fast_oscillation_is_the_closed_one(weighted: bool):
    """int cos^2 = T/2 + sin(2 w T) / 4w and so on; weighted: sums over samples."""
    system, w, dt, steps = free(lambda x: ca.vertcat(x[1], -100 * x[0]), 2), 10.0, 0.3, 10
    found = od.variational_gramian(system, coasting(system, [1.0, 0.0], steps, dt), weighted).total
    if weighted:
        t = dt * np.arange(steps)
        rows = np.column_stack([np.cos(w * t), np.sin(w * t) / w])
        expected = rows.T @ rows
    else:
        T = dt * steps
        swing, cross = np.sin(2 * w * T) / (4 * w), np.sin(w * T) ** 2 / (2 * w * w)
        expected = np.array([[T / 2 + swing, cross], [cross, (T / 2 - swing) / w**2]])
    size = np.sqrt(np.diag(expected))
    np.testing.assert_array_less(np.abs(found - expected), 1e-5 * np.outer(size, size))


# ---------------------------------------------------------------- vehicles


@pytest.mark.parametrize("turn_rate", [0.5, 3.0, 20.0, -20.0, 16 * np.pi])
@pytest.mark.parametrize("dt", [0.1, 0.5])
def test_a_vehicle_that_spirals_is_where_the_circle_has_it(turn_rate: float, dt: float):
    """Also where a whole number of turns is made in each step, and in each half of it."""
    system = od.System(od.Dubins(15.0, wind="constant"), (od.GPS(1.0),))
    path = od.simulate(system, (1.0, 2.0, 0.3, 3.0, -2.0), np.full(40, turn_rate), dt)
    heading = 0.3 + turn_rate * path.t
    x = 1 + 15 * (np.sin(heading) - np.sin(0.3)) / turn_rate + 3 * path.t
    y = 2 - 15 * (np.cos(heading) - np.cos(0.3)) / turn_rate - 2 * path.t
    flown = 15.0 * path.t[-1]
    np.testing.assert_allclose(path.x[:, :2], np.column_stack([x, y]), atol=1e-6 * flown)
    Phi = transition_matrices(system, path)
    expected = np.column_stack([-(y - 2 + 2 * path.t), x - 1 - 3 * path.t])
    np.testing.assert_allclose(Phi[:, :2, 2], expected, atol=1e-6 * flown)


def test_where_one_step_is_enough_it_is_the_step_of_runge_and_kutta_bit_for_bit():
    system = od.System(od.Dubins(15.0, wind="constant"), (od.GPS(1.0),))
    u = np.random.default_rng(0).uniform(-0.5, 0.5, 50)
    path = od.simulate(system, (1.0, 2.0, 0.3, 3.0, -2.0), u, 0.25)
    assert substeps_along(system, path) == 1
    np.testing.assert_array_equal(path.x, od.simulate(system, (1.0, 2.0, 0.3, 3.0, -2.0), u, 0.25, tolerance=0.9).x)


# ---------------------------------------------------------------- nonlinear systems


@pytest.mark.parametrize("dt", [0.01, 0.05, 0.3])
@pytest.mark.parametrize(
    ("drift", "start"),
    [
        (lambda x: ca.vertcat(x[1], -9.81 * ca.sin(x[0])), (2.0, 0.0)),
        (lambda x: ca.vertcat(x[1], 5 * (1 - x[0] ** 2) * x[1] - x[0]), (2.0, 0.1)),
        (lambda x: ca.vertcat(x[0] * (1 - x[1]), x[1] * (x[0] - 1)), (0.5, 1.5)),
    ],
    ids=["pendulum", "Van der Pol", "predator and prey"],
)
def test_states_and_sensitivities_meet_the_tolerance(drift: Callable[[ca.SX], ca.SX], start: tuple[float, ...], dt: float):
    system = free(drift, 2)
    for tolerance in (1e-4, 1e-7):
        assert max(errors(system, coasting(system, start, 20, dt, tolerance))) < 5 * tolerance


def random_system(seed: int) -> tuple[od.ControlAffineSystem, np.ndarray, float]:
    random = np.random.default_rng(seed)
    n = int(random.integers(1, 4))
    A, B, C = random.normal(size=(n, n)), random.normal(size=(n, n)), random.normal(size=(n, n))
    A -= (np.linalg.eigvals(A).real.max() + 0.3) * np.eye(n)
    fast = 10.0 ** random.uniform(-1, 1)
    system = free(lambda x: fast * (ca.DM(A) @ x + ca.sin(ca.DM(B) @ x) / 2 + ca.tanh(ca.DM(C) @ x) * ca.cos(x[0]) / 3 + 0.2), n)
    return system, random.normal(size=n), float(10.0 ** random.uniform(-1.5, 0.0) / fast)


def assert_tolerances_are_met(seeds: range) -> None:
    for seed in seeds:
        system, start, dt = random_system(seed)
        tolerance = 10.0 ** np.random.default_rng([seed, 1]).uniform(-7, -4)
        off = errors(system, coasting(system, start, 15, dt, tolerance))
        assert max(off) < 10 * tolerance, f"seed {seed}: {off} at {tolerance}"


def test_random_systems_meet_the_tolerance():
    assert_tolerances_are_met(range(4))


@pytest.mark.slow
def test_two_hundred_random_systems_meet_the_tolerance():
    assert_tolerances_are_met(range(1000, 1200))


# ---------------------------------------------------------------- what is refused


def test_a_path_has_the_step_that_it_was_made_of():
    """All of its digits, which times of many of them have: information along it is that of these instants, as a proven bound is."""
    system, random = od.System(od.Dubins(1.0), (od.GPS(1.0),)), np.random.default_rng(12)
    for step in (0.05, 1 / 3, 0.1, 1e-4, 123.456, *10 ** random.uniform(-6, 6, 40)):
        path = od.simulate(system, (0.0, 0.0, 0.0), np.zeros((int(random.integers(1, 300)), 1)), float(step))
        assert path.step == pytest.approx(step, rel=1e-15, abs=0.0)
    assert od.simulate(system, (0.0, 0.0, 0.0), np.zeros((300, 1)), 0.05).step == 0.05
    t = 1.7e9 + 0.05 * np.arange(101)  # seconds since 1970 are known to 2e-7 s
    assert od.Trajectory(t, np.zeros((101, 3)), np.zeros((100, 1))).step == pytest.approx(0.05, abs=5e-9)


def test_a_step_too_coarse_is_refused_with_one_that_would_do():
    system = free(lambda x: ca.vertcat(-(10 + ca.sin(x[0])) * 1e3 * (x[0] - ca.cos(x[1])), 1 + 0 * x[0]), 2)
    with pytest.raises(od.InputError, match=r"a step of 1 s is too coarse for these dynamics: .*; a step of [0-9.]+ s would do"):
        coasting(system, [1.0, 0.0], 5, 1.0)


def robertson(x: ca.SX) -> ca.SX:
    slow, fast, twice = 0.04 * x[0], 1e4 * x[1] * x[2], 3e7 * x[1] ** 2
    return ca.vertcat(fast - slow, slow - fast - twice, twice)


STIFF: dict[str, tuple[Callable[[ca.SX], ca.SX], list[float], int, float]] = {
    "v' = -1e6 (v - cos t)": (lambda x: ca.vertcat(-1e6 * (x[0] - ca.cos(x[1])), 1), [1.0, 0.0], 5, 0.1),
    "v' = -1e6 v^3": (lambda x: -1e6 * x**3, [1.0], 20, 1e-3),
    "Robertson": (robertson, [1.0, 0.0, 0.0], 10, 4.0),
    "Van der Pol": (lambda x: ca.vertcat(x[1], 1000 * (1 - x[0] ** 2) * x[1] - x[0]), [2.0, 0.0], 20, 1.0),
}


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.slow] * (name == "Robertson")) for name in STIFF])
def test_stiff_motion_is_refused_with_a_step_that_was_tried_and_does(name: str):
    drift, start, steps, dt = STIFF[name]
    system = free(drift, len(start))
    with pytest.raises(od.InputError, match=r"; a step of [0-9.e-]+ s would do") as refusal:
        coasting(system, start, steps, dt)
    step = float(re.findall(r"a step of ([0-9.e-]+) s would do", str(refusal.value))[0])
    path = coasting(system, start, round(steps * dt / step), step)
    rate, jacobian = (
        ca.Function("f", [system.model.x], [ca.densify(each)])
        for each in (system.model.drift, ca.jacobian(drift(system.model.x), system.model.x))
    )
    found = solve_ivp(
        lambda _, x: rate(x).full().ravel(), (0.0, path.t[-1]), start, "Radau", rtol=1e-10, atol=1e-14, jac=lambda _, x: jacobian(x).full()
    )
    np.testing.assert_allclose(path.x[-1], found.y[:, -1], rtol=3e-6)


def test_a_fast_oscillation_is_not_taken_for_one_that_amplifies_rounding():
    """Steps of 1000 rad are unstable: their sensitivity grows to 1e288, that of the motion does not."""
    system = free(lambda x: ca.vertcat(x[1], -1e6 * ca.sin(x[0]), 0.01 * x[0] - 0.1 * x[2]), 3)
    with pytest.raises(od.InputError, match=r"estimated that a step of [0-9.e-]+ s would do"):
        coasting(system, [0.5, 0.0, 1.0], 10, 1.0)


def lorenz(x: ca.SX) -> ca.SX:
    return ca.vertcat(10 * (x[1] - x[0]), x[0] * (28 - x[2]) - x[1], x[0] * x[1] - 8 / 3 * x[2])


def upright(x: ca.SX) -> ca.SX:
    return ca.vertcat(x[1], -9.81 * ca.sin(x[0]))


def test_where_steps_would_do_the_refusal_names_one_and_it_does():
    """x' = 1 + x^2 gets to tan(1.57) = 1256 within the last of ten steps."""
    system = free(lambda x: 1 + x * x, 1)
    with pytest.raises(od.InputError, match=r"a step of [0-9.e-]+ s would do") as refusal:
        coasting(system, [0.0], 10, 0.157)
    step = float(re.findall(r"a step of ([0-9.e-]+) s would do", str(refusal.value))[0])
    path = coasting(system, [0.0], round(1.57 / step), step)
    assert path.x[-1, 0] == pytest.approx(np.tan(1.57), rel=3e-6)


def test_a_vehicle_that_turns_too_fast_is_refused_with_a_step_that_does():
    """5e4 rad in a step would take 11,000 sub-steps for 1e-6, by the bound of Simpson's rule."""
    system = od.System(od.Dubins(15.0, wind="constant"), (od.GPS(1.0),))
    with pytest.raises(od.InputError, match=r"a step of [0-9.e-]+ s would do") as refusal:
        od.simulate(system, (1.0, 2.0, 0.3, 3.0, -2.0), np.full(3, 1e5), 0.5)
    step = float(re.findall(r"a step of ([0-9.e-]+) s would do", str(refusal.value))[0])
    path = od.simulate(system, (1.0, 2.0, 0.3, 3.0, -2.0), np.full(round(1.5 / step), 1e5), step)
    x = 1 + 15 * (np.sin(0.3 + 1e5 * path.t) - np.sin(0.3)) / 1e5 + 3 * path.t
    np.testing.assert_allclose(path.x[:, 0], x, rtol=0, atol=1e-6 * 15 * path.t[-1])


def test_a_simulated_path_belongs_to_nobody_else():
    u = np.zeros((3, 1))
    path = od.simulate(od.System(od.Dubins(15.0), (od.GPS(1.0),)), (0.0, 0.0, 0.0), u, 0.5)
    u[:] = 7.0
    assert not path.u.any()
    assert not any(values.flags.writeable for values in (path.t, path.x, path.u))
    with pytest.raises(od.InputError, match="dt times the number of steps is inf"):
        od.simulate(od.System(od.Dubins(1e-300), (od.GPS(1.0),)), (0.0, 0.0, 0.0), u * 0, 1e308)


@pytest.mark.parametrize("end", [1.01, 2.0, 30.0])
def test_what_gets_to_infinity_in_finite_time_is_refused(end: float):
    """x' = x^2 from 1 is 1 / (1 - t)."""
    with pytest.raises(od.InputError, match="runs away"):
        coasting(free(lambda x: ca.vertcat(x[0] * x[0]), 1), [1.0], 10, end / 10)


def test_a_state_beyond_the_largest_double_is_named():
    with pytest.raises(od.InputError, match=r"x0 is inf from step 15 \(t = 7.5 s\) on: the motion runs away"):
        coasting(free(lambda x: 100 * x, 1), [1.0], 20, 0.5)


def test_what_only_rounding_moves_is_refused():
    """A pendulum upright at the double nearest to pi: e^(3.13 t) times 1e-16 is all there is of its fall. After 3 s it still stands."""
    system = free(upright, 2)
    with pytest.raises(od.InputError, match="amplifies the rounding of doubles"):
        coasting(system, [np.pi, 0.0], 150, 0.1)
    assert coasting(system, [np.pi, 0.0], 30, 0.1).x[-1, 0] == pytest.approx(np.pi, rel=1e-9)


def test_chaos_is_followed_as_far_as_doubles_do_and_refused_beyond():
    system = free(lorenz, 3)
    with pytest.raises(od.InputError, match=r"amplifies the rounding of doubles"):
        coasting(system, [1.0, 1.0, 20.0], 100, 0.5)
    assert max(errors(system, coasting(system, [1.0, 1.0, 20.0], 10, 0.1))) < 3e-6


def test_sensitivities_are_those_of_the_right_path_not_of_the_one_that_is_judged():
    """Roessler's system: Phi along a path that is off by a tolerance is off by several."""
    system = free(lambda x: ca.vertcat(-x[1] - x[2], x[0] + 0.2 * x[1], 0.2 + x[2] * (x[0] - 5.7)), 3)
    assert max(errors(system, coasting(system, [1.0, 1.0, 0.0], 100, 0.5))) < 3e-6


@pytest.mark.parametrize("structured", [True, False])
def test_the_trace_of_an_unknown_input_meets_the_tolerance(structured: bool):
    """x' = w sin(30 s), s' = 1 at w = 0: x and Phi are exact in any step, dx/dw = (1 - cos(30 h)) / 30 is not."""
    x = ca.SX.sym("x", 2)
    wave = ca.sin(30 * x[1]) if structured else ca.sin(30 * x[1]) + 0 * ca.tanh(x[1]) + 1e-300 * ca.tanh(x[1])
    system = od.ControlAffineSystem(
        x, ("x", "s"), ca.vertcat(ca.SX(0), 1), unknown={"w": ca.vertcat(wave, 0)}, outputs={"x": x[0], "s": x[1]}
    )
    path = od.simulate(system, [0.0, 0.0], np.zeros((4, 0)), 0.3)
    step = step_of(system.model, 0.3, substeps_along(system, path))
    found = ca.Function("B", [step.x, step.u, step.w], [step.B_w])([0.0, 0.0], [], [0.0]).full()
    np.testing.assert_allclose(found, [[(1 - np.cos(9.0)) / 30], [0.0]], rtol=3e-6)


@pytest.mark.parametrize("tolerance", [0.0, 1.0, -1e-6, float("nan"), "small", True])
def test_a_tolerance_is_a_number_between_0_and_1(tolerance: object):
    system = free(lambda x: -x, 1)
    with pytest.raises(od.InputError, match="tolerance is"):
        od.simulate(system, [1.0], np.zeros((5, 0)), 1.0, tolerance=tolerance)  # pyright: ignore


# ---------------------------------------------------------------- sub-steps as a loop


def windy(wind: Literal["constant", "unknown"] | None = "unknown") -> od.System:
    return od.System(od.Dubins(10.0, wind=wind), (od.GPS(2.0), od.Range((50.0, 90.0), 1.0)))


def values_scan(step: Step) -> Scan:
    """x_next, F and B_w at rows x, (u, w)."""
    results = [step.x_next, *(ca.vec(ca.densify(matrix)) for matrix in (step.F, step.B_w))]
    return Scan(ca.SX(0, 1), [step.x, step.all_inputs], ca.SX(0, 1), results, loop=step.loop)


def values_of(step: Step, seed: int = 0) -> list[np.ndarray]:
    random = np.random.default_rng(seed)
    rows = [random.normal(size=(20, symbol.numel())) for symbol in (step.x, step.all_inputs)]
    return list(values_scan(step).run(np.empty((1, 0)), rows, 20).results)


@pytest.mark.parametrize("wind", [None, "constant", "unknown"])
@pytest.mark.parametrize("substeps", [1, 2, 3, 24, 100])
def test_a_loop_of_substeps_is_the_chain_of_them(wind: Literal["constant", "unknown"] | None, substeps: int):
    """x_m = f(... f(x_0)), F = F_m ... F_1 and B_w the same, whether one graph has them all or a loop repeats one."""
    model = windy(wind).model
    for chained, looped in zip(values_of(step_of(model, 0.7, substeps)), values_of(looped_step(model, 0.7, substeps)), strict=True):
        np.testing.assert_allclose(looped, chained, rtol=1e-12, atol=1e-13)


def test_a_loop_starts_where_it_is_told_and_without_what_is_unknown():
    """f(2 x, u, 0), by a substitution in the chain and in the loop."""
    model = windy().model
    chained, looped = (step.without_disturbance().starting_at(2 * step.x) for step in (step_of(model, 0.7, 4), looped_step(model, 0.7, 4)))
    for expected, found in zip(values_of(chained), values_of(looped), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-13)


def test_machine_code_of_a_loop_gives_the_same_bits(monkeypatch: pytest.MonkeyPatch):
    step = looped_step(windy().model, 0.7, 6)
    monkeypatch.setenv("OBSDESIGN_COMPILE", "0")
    slow = values_of(step)
    monkeypatch.setenv("OBSDESIGN_COMPILE", "1")
    for machine, virtual in zip(values_of(step), slow, strict=True):
        np.testing.assert_array_equal(machine, virtual)


def test_substeps_cost_no_more_than_as_many_steps():
    """Operations are a + b m, with b no more than one step takes: its blocks are needed once."""
    model = windy("constant").model
    one, two, fifty = (sensitivity_scan(model, 0.7, True, substeps).instructions for substeps in (1, 2, 50))
    assert fifty == two + 48 * ((fifty - two) // 48)
    assert fifty <= 50 * one
    step = looped_step(model, 0.7, 50)
    states = Scan(step.x, [step.u, step.w], step.x_next, loop=step.loop)
    assert states.instructions < values_scan(step).instructions - 100  # nobody asks for Phi
