"""Numbers of systems of any form: those of the affine system where the two are one, and the refusals of what has no meaning."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest

import obsdesign as od
from obsdesign.calculus import rk4

X, U, W = ca.SX.sym("x", 3), ca.SX.sym("u"), ca.SX.sym("w")
NAMES, STEP = ("x", "y", "heading"), 0.5
OUTPUTS = {"px": X[0], "py": X[1], "range": ca.sqrt((X[0] - 50) ** 2 + (X[1] - 20) ** 2)}
TURN, SIDE = ca.vertcat(0, 0, 1), ca.vertcat(-ca.sin(X[2]), ca.cos(X[2]), 0)
AHEAD = 5 * ca.vertcat(ca.cos(X[2]), ca.sin(X[2]), 0)
SHARED: dict[str, Any] = {"outputs": OUTPUTS, "sigmas": {"px": 2.0}, "angles": ("heading",)}
AFFINE = od.ControlAffineSystem(X, NAMES, AHEAD, {"u": TURN}, {"w": SIDE}, **SHARED)
RATES = AHEAD + TURN * U + SIDE * W
GENERAL = od.GeneralSystem(X, NAMES, rates=RATES, inputs={"u": U}, unknown={"w": W}, **SHARED)
MAP = od.DiscreteSystem(
    X, NAMES, next_state=rk4(lambda x: ca.substitute(RATES, X, x), X, STEP), period=STEP, inputs={"u": U}, unknown={"w": W}, **SHARED
)
START = (0.0, 0.0, 0.1)
TURNS = np.repeat([0.2, -0.1, 0.3, 0.0], 4)[:, None]
GUSTS = np.sin(np.arange(16.0))[:, None]
PRIOR = od.Prior(START, std=(10.0, 10.0, 0.1))
SAMPLES = od.LogSamples(("range", "px"), [0.0, 1.0, 1.3, 1.3, 4.0], [0, 0, 0, 1, 1], [53.0, 50.0, 48.0, 6.0, 19.0])
LOG = od.Log(od.LogInputs(("u",), [0.0, 1.0, 2.6], [[0.1], [0.2], [-0.2]]), SAMPLES)
PSD = (0.1, 0.1, 0.01)


def path_of(system: Any, dt: Any = STEP) -> od.Trajectory:
    # a tolerance at which one step of RK4 does: the map is that step
    return od.simulate(system, START, TURNS, dt, GUSTS, tolerance=1e-2)


def problem_of(system: Any, **limits: Any) -> od.DesignProblem:
    return od.DesignProblem(system, START, 8.0, STEP, od.PiecewiseConstant(4), {"u": (-0.3, 0.3)}, tolerance=1e-2, **limits)


def designed(system: Any, **limits: Any) -> np.ndarray:
    design = od.design_trajectory(problem_of(system, **limits), starts=2)
    return np.array([design.value, *design.trajectory.x[-1]])


ALIKE: dict[str, Callable[[Any], Any]] = {
    "states": lambda system: path_of(system).x,
    "Gramian": lambda system: od.variational_gramian(system, path_of(system)).blocks,
    "empirical Gramian": lambda system: od.empirical_gramian(system, path_of(system)).total,
    "posterior": lambda system: od.posterior_information(system, path_of(system), PRIOR, disturbance_psd=PSD),
    "posterior, unknown input": lambda system: od.posterior_information(system, path_of(system), PRIOR, unknown_inputs=("w",)),
    "posterior, noisy input": lambda system: od.posterior_information(system, path_of(system), PRIOR, input_psd={"u": 0.01}),
    "windows": lambda system: od.sliding_information(system, path_of(system), 4),
    "batch": lambda system: od.batch_information(system, np.tile(START, (2, 1)), TURNS, STEP, tolerance=1e-2),
    "gradient": lambda system: od.information_gradient(system, START, TURNS, STEP, od.LogDet(), tolerance=1e-2)[1],
    "filter": lambda system: od.estimate_states(system, PRIOR, TURNS, np.ones((16, 3)), STEP, disturbance_psd=PSD).mean,
    "smoother": lambda system: od.estimate_states(system, PRIOR, TURNS, np.ones((16, 3)), STEP, estimator=od.FixedIntervalSmoother()).mean,
    "unscented filter": lambda system: (
        od.validate(system, path_of(system), prior=PRIOR, runs=3, estimator=od.UnscentedKalmanFilter(), disturbance_psd=PSD).rmse
    ),
    "Monte Carlo": lambda system: od.validate(system, path_of(system), prior=PRIOR, runs=3, disturbance_psd=PSD).nees,
    "schedule": lambda system: od.select_for_filter(system, path_of(system), PRIOR, segment=1.0, disturbance_psd=PSD).predicted,
    "design": designed,
    "design by what it ends with": lambda system: designed(system, criterion=od.Posterior(PRIOR)),
    "wind as a state": lambda system: (
        od.variational_gramian(
            od.InputStates(system, {"w": 1}), od.simulate(od.InputStates(system, {"w": 1}), (*START, 0.3), TURNS, STEP, tolerance=1e-2)
        ).total
    ),
}
IN_CONTINUOUS_TIME: dict[str, Callable[[Any], Any]] = {
    "integral": lambda system: od.variational_gramian(system, path_of(system), weighted=False).total,
    "uneven steps": lambda system: od.variational_gramian(system, path_of(system, np.r_[np.full(8, 0.5), np.full(8, 0.25)])).total,
    "uneven steps, noisy input": lambda system: od.posterior_information(
        system, path_of(system, np.linspace(0.1, 0.7, 16)), PRIOR, input_psd={"u": 0.01}
    ),
    "log": lambda system: od.estimate_log(system, LOG, PRIOR).mean,
    "log, noisy input": lambda system: od.estimate_log(system, LOG, PRIOR, input_psd={"u": 0.01}).mean,
    "Gramian of a log": lambda system: od.variational_gramian(system, path_of(system), samples=LOG).total,
    "design with limits": lambda system: designed(system, constraints=(od.GroundSpeed(1.0), od.Goal((25.0, 20.0), tolerance=5.0))),
}


SLOW = ("windows", "batch", "gradient", "empirical Gramian", "schedule", "unscented filter", "design by what it ends with", "smoother")


@pytest.mark.parametrize("what", [pytest.param(what, marks=[pytest.mark.slow] * (what in SLOW)) for what in ALIKE])
def test_numbers_are_those_of_the_affine_system_and_of_its_steps(what: str):
    affine, general, steps = (np.asarray(ALIKE[what](system)) for system in (AFFINE, GENERAL, MAP))
    tolerance = 1e-5 if "design" in what else 1e-9
    np.testing.assert_allclose(general, affine, rtol=tolerance, atol=tolerance * abs(affine).max())
    if what != "wind as a state":  # there the map holds w over a step, as the rate does
        np.testing.assert_allclose(steps, affine, rtol=tolerance, atol=tolerance * abs(affine).max())


@pytest.mark.parametrize("what", [pytest.param(what, marks=[pytest.mark.slow] * ("limits" in what)) for what in IN_CONTINUOUS_TIME])
def test_numbers_in_continuous_time_and_a_map_is_refused(what: str):
    affine, general = (np.asarray(IN_CONTINUOUS_TIME[what](system)) for system in (AFFINE, GENERAL))
    tolerance = 1e-5 if "design" in what else 1e-9
    np.testing.assert_allclose(general, affine, rtol=tolerance, atol=tolerance * abs(affine).max())
    with pytest.raises(od.InputError, match=r"map (over 0.5 s|from one instant to the next)"):
        IN_CONTINUOUS_TIME[what](MAP)


def test_an_input_that_is_held_may_stand_inside_a_sine():
    # rates of sin(u) with u held are those of an input of that value
    bent = od.GeneralSystem(X, NAMES, rates=AHEAD + TURN * ca.sin(U), inputs={"u": U}, **SHARED)
    straight = od.ControlAffineSystem(X, NAMES, AHEAD, {"u": TURN}, **SHARED)
    for dt in (STEP, np.linspace(0.1, 0.7, 16)):
        paths = [od.simulate(system, START, u, dt) for system, u in ((bent, TURNS), (straight, np.sin(TURNS)))]
        totals = [od.variational_gramian(system, path).total for system, path in zip((bent, straight), paths, strict=True)]
        np.testing.assert_allclose(totals[0], totals[1], rtol=1e-6, atol=1e-6 * abs(totals[1]).max())  # the tolerance of steps


def test_a_map_is_followed_in_whole_periods():
    double = od.simulate(MAP, START, TURNS[::2], 2 * STEP)
    np.testing.assert_allclose(double.x, od.simulate(MAP, START, np.repeat(TURNS[::2], 2, axis=0), STEP).x[::2], rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(
        od.variational_gramian(MAP, double).total, od.empirical_gramian(MAP, double, eps=1e-5).total, rtol=1e-6, atol=1e-4
    )
    with pytest.raises(od.InputError, match=r"step is 0.25: the system is a map over 0.5 s, a step must be that or a whole multiple of it"):
        od.simulate(MAP, START, TURNS, 0.25)


def test_a_design_meets_the_limits_of_a_map_at_its_instants():
    goal = od.Goal((25.0, 20.0), tolerance=5.0)
    design = od.design_trajectory(problem_of(MAP, constraints=(goal, od.KeepOut((12.0, 6.0), radius=3.0))), starts=3)
    x, y = design.trajectory.x[:, :2].T
    assert np.hypot(x[-1] - 25, y[-1] - 20) <= 5 + 1e-9
    assert np.hypot(x - 12, y - 6).min() >= 3 - 1e-9


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        ({"constraints": (od.GroundSpeed(1.0),)}, "GroundSpeed: .*the rate of 'x' is asked for, and a map"),
        ({"budgets": (od.Budget(od.PathLength(), 50.0),)}, "path length: the rate of 'x' is asked for, and a map"),
    ],
)
def test_limits_that_ask_for_a_rate_are_refused_for_a_map(limits: dict[str, Any], message: str):
    with pytest.raises(od.InputError, match=message):
        problem_of(MAP, **limits)


@pytest.mark.slow
def test_a_log_calibrates_a_system_of_any_form():
    bent = od.GeneralSystem(X, NAMES, rates=AHEAD + TURN * ca.sin(U), inputs={"u": U}, **SHARED)
    fits = [od.calibrate(system, LOG, PRIOR) for system in (AFFINE, GENERAL, bent)]
    assert fits[0].disturbance_psd == pytest.approx(fits[1].disturbance_psd, rel=1e-4)
    assert fits[0].input_psd == pytest.approx(fits[1].input_psd, rel=1e-4)
