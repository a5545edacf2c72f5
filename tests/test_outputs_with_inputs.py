"""Outputs that contain known inputs: a measured airspeed in a ground speed, an accelerometer, a Doppler where the speed is steered."""

from __future__ import annotations

import pickle
import re
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from by_hand import slopes

import obsdesign as od
from obsdesign import sensors
from obsdesign.dynamics.simulation import readings
from obsdesign.families import kinds

BEACON = (40.0, 25.0)
READY = od.System(
    od.Unicycle(wind="constant"),
    (od.SpeedOverGround(0.3), od.Course(0.05), od.Doppler(BEACON, 0.2, lever_arm=(1.0, 0.5)), od.GPS(2.0, bias_floor=0.5)),
)
START = np.array([1.0, -2.0, 0.3, 2.0, -1.0])
U = np.column_stack([8.0 + np.sin(np.arange(20) / 3), 0.3 * np.cos(np.arange(20) / 4)])
PATH = od.simulate(READY, START, U, 0.25)
PRIOR, PSD = od.Prior(START, std=(3.0, 3.0, 0.2, 1.0, 1.5)), (0.01, 0.01, 0.001, 0.02, 0.02)


def by_hand(x: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Outputs at one state under one row of inputs, by complex numbers."""
    heading, velocity = np.exp(1j * x[2]), u[0] * np.exp(1j * x[2]) + complex(x[3], x[4])
    sight = complex(*BEACON) - complex(x[0], x[1]) - (1.0 + 0.5j) * heading
    of_sensor = velocity + 1j * u[1] * (1.0 + 0.5j) * heading
    return np.array([abs(velocity), np.angle(velocity), -(sight.conjugate() * of_sensor).real / abs(sight), x[0], x[1]])


def along(path: od.Trajectory) -> np.ndarray:
    return np.array([by_hand(x, u) for x, u in zip(path.x[:-1], path.u, strict=True)])


def own(system: od.System) -> od.ControlAffineSystem:
    """Ground velocity of a measured airspeed, as an expression of the state and the input."""
    x, speed, turn = ca.SX.sym("x", 5), ca.SX.sym("v"), ca.SX.sym("w")
    east, north = speed * ca.cos(x[2]) + x[3], speed * ca.sin(x[2]) + x[4]
    outputs = {"speed_over_ground": (east**2 + north**2) ** 0.5, "course": ca.atan2(north, east), "gps": x[:2]}
    noises = {"speed_over_ground": od.OutputNoise(0.3), "course": od.OutputNoise(0.05), "gps": od.OutputNoise(2.0, bias_floor=0.5)}
    rate = ca.vertcat(east, north, turn, 0, 0)
    known = {"speed": speed, "turn_rate": turn}
    return od.ControlAffineSystem.from_rate(x, system.model.state_names, rate, known, {}, outputs, {}, ("heading", "course"), noises)


def test_a_sample_sees_the_inputs_that_are_held_from_then_on():
    y = readings(READY, PATH.x[None, :-1], PATH.u).y[0]
    np.testing.assert_allclose(y, along(PATH), rtol=1e-12, atol=1e-12)
    assert READY.model.inputs_in_outputs == (0, 1)
    with pytest.raises(
        od.InputError, match=r"outputs contain the input 'speed': samples apart from a path, .* need outputs without inputs"
    ):
        readings(READY, PATH.x[None])


@pytest.mark.parametrize("steps", ["even", "of any length"])
def test_information_is_made_of_differences_of_outputs_by_hand(steps: str):
    dt = 0.25 if steps == "even" else 0.15 + 0.1 * np.arange(20) / 20
    path = od.simulate(READY, START, U, dt)
    W = od.variational_gramian(READY, path)
    C = np.array(
        [[slopes(lambda x, k=k, i=i: float(along(od.simulate(READY, x, U, dt))[k, i]), START) for i in range(5)] for k in range(20)]
    )
    white = C[:, :3] / np.array([0.3, 0.05, 0.2])[:, None]
    expected = np.einsum("kia,kib->ab", white, white)
    R = 4.0 * np.eye(20) + 0.25
    expected += sum(C[:, i].T @ np.linalg.solve(R, C[:, i]) for i in (3, 4))
    np.testing.assert_allclose(W.total, expected, rtol=1e-6, atol=1e-8 * np.abs(expected).max())
    np.testing.assert_allclose(od.empirical_gramian(READY, path, 1e-3).total, expected, rtol=1e-4, atol=1e-6 * np.abs(expected).max())


def test_the_gradient_counts_that_inputs_change_outputs():
    plain = od.System(READY.vehicle, (*READY.sensors[:3], od.GPS(2.0)))
    value, gradient = od.information_gradient(plain, START, U, 0.25, od.LogDet())
    expected = slopes(lambda u: od.information_value(plain, START, u, 0.25, od.LogDet()), U, 1e-3)
    assert np.isfinite(value)
    np.testing.assert_allclose(gradient, expected, rtol=1e-5, atol=1e-7 * np.abs(expected).max())
    problem = od.DesignProblem(
        plain, START, 5.0, 0.25, od.PiecewiseConstant(2), {"speed": (5.0, 12.0), "turn_rate": (-0.6, 0.6)}, criterion=od.LogDet()
    )
    design = od.design_trajectory(problem, starts=1)
    assert design.value == pytest.approx(np.linalg.slogdet(od.variational_gramian(plain, design.trajectory).total)[1], rel=1e-9)


def test_a_filter_on_the_path_knows_what_the_bound_says_from_steps_and_from_a_log():
    """Noise-free samples and the true start: its covariance is the inverse of the posterior, on even steps, uneven ones and from a log."""
    y = along(PATH)
    plain = od.System(READY.vehicle, (*READY.sensors[:3], od.GPS(2.0)))
    estimate = od.estimate_states(plain, PRIOR, U, y, 0.25, disturbance_psd=PSD)
    J = od.posterior_information(plain, PATH, PRIOR, PSD)
    np.testing.assert_allclose(estimate.mean, PATH.x, atol=1e-9)
    np.testing.assert_allclose(estimate.covariance[-1] @ J[-1], np.eye(5), atol=1e-7)
    values = np.full((20, 4, 2), np.nan)
    values[:, :, 0], values[:, 3, 1] = y[:, :4], y[:, 4]
    samples = od.LogSamples(plain.sensor_names, np.repeat(PATH.t[:-1], 4), np.tile(np.arange(4), 20), values.reshape(-1, 2))
    log = od.Log(od.LogInputs(("speed", "turn_rate"), PATH.t[:-1], U), samples)
    found = od.estimate_log(plain, log, PRIOR, disturbance_psd=PSD)
    np.testing.assert_allclose(found.mean[-1], PATH.x[len(found.t) - 1], atol=1e-8)
    np.testing.assert_allclose(found.covariance[-1], estimate.covariance[len(found.t) - 1], rtol=1e-8, atol=1e-11)
    W = od.variational_gramian(plain, PATH)
    np.testing.assert_allclose(od.variational_gramian(plain, PATH, samples=log).total, W.total, rtol=1e-9, atol=1e-12 * W.total.max())
    J_log = od.posterior_information(plain, PATH, PRIOR, PSD, samples=log)
    np.testing.assert_allclose(J_log[-1], J[-1], rtol=1e-8, atol=1e-8)
    for estimator in (od.UnscentedKalmanFilter(), od.FixedIntervalSmoother()):
        kept = od.estimate_states(plain, PRIOR, U, y, 0.25, disturbance_psd=PSD, estimator=estimator)
        assert np.isfinite(kept.mean).all()


def test_a_run_of_a_filter_errs_as_it_says():
    check = od.validate(READY, PATH, prior=PRIOR, runs=60, seed=0, disturbance_psd=PSD)
    assert 0.8 < float((check.rmse[-1] / check.bound[-1]).mean()) < 1.25


def test_between_samples_of_a_log_the_input_of_that_time_counts():
    """A sample at t = 0.5 within a step of the path, inputs switching at its nodes: h of the state and the input of then."""
    samples = od.LogSamples(("speed_over_ground",), [0.5], [0], [9.0])
    system = od.System(READY.vehicle, READY.sensors[:1])
    path = od.simulate(system, START, np.array([[8.0, 0.2], [3.0, -0.1]]), 1.0)
    log = od.Log(od.LogInputs(("speed", "turn_rate"), [0.0, 1.0], path.u), samples)
    C = slopes(lambda x: by_hand(od.simulate(system, x, path.u[:1], 0.5).x[-1], path.u[0])[0], START)
    found = od.variational_gramian(system, path, samples=log).total
    np.testing.assert_allclose(found, np.outer(C, C) / 0.3**2, rtol=1e-6, atol=1e-9)


def test_a_system_of_ones_own_is_the_ready_made_one_and_travels():
    mine, system = own(READY), od.System(READY.vehicle, (*READY.sensors[:2], READY.sensors[3]))
    path = od.simulate(mine, START, U, 0.25)
    np.testing.assert_allclose(od.variational_gramian(mine, path).total, od.variational_gramian(system, path).total, rtol=1e-10)
    copy = pickle.loads(pickle.dumps(mine))
    assert copy == mine
    np.testing.assert_allclose(od.variational_gramian(copy, path).total, od.variational_gramian(mine, path).total, rtol=1e-12)
    assert od.observability(mine).dimension == od.observability(system).dimension == 5


def test_verdicts_are_about_the_state_alone():
    """The ground speed of a known airspeed sees the wind but for a turn of wind and heading; at one speed on one course only itself."""
    vehicle = od.Unicycle(wind="constant")
    speed_only = od.System(vehicle, (od.SpeedOverGround(0.3),))
    turning = od.observability(speed_only)
    assert turning.dimension == 2
    assert len(turning.at) == 5
    assert turning.null_space.shape == (5, 3)
    wind_x, wind_y = turning.at[3:]
    spin = np.array([0.0, 0.0, 1.0, -wind_y, wind_x])
    np.testing.assert_allclose(turning.null_space @ (turning.null_space.T @ spin), spin, atol=1e-9)
    straight = od.observability(speed_only, held={"turn_rate": 0.0})
    assert straight.dimension == 2
    assert od.observability(speed_only, held={"turn_rate": 0.0, "speed": 9.0}).dimension == 1
    assert od.observability(speed_only, at=START).dimension == 2
    both = od.System(vehicle, (od.SpeedOverGround(0.3), od.Course(0.05)))
    assert set(od.observability(both).observable_states) == {"heading", "wind_x", "wind_y"}
    assert od.observability(od.System(od.Unicycle(), (od.Airspeed(0.3),))).dimension == 0
    assert od.observability(od.System(od.Unicycle(), (od.Airspeed(0.3, scale="s", bias="b"),))).observable_states == ("s", "b")
    held = od.observability(od.System(od.Unicycle(), (od.Airspeed(0.3, scale="s", bias="b"),)), held={"speed": 4.0})
    assert held.dimension == 1
    np.testing.assert_allclose(np.abs(held.null_space[3:].T @ [1.0, -4.0]).max(), np.sqrt(17.0), rtol=1e-12)


def test_an_accelerometer_tells_its_bias_beside_a_known_acceleration():
    """y = a + b with a known: b at once, by one sample to sigma."""
    x, a = ca.SX.sym("x", 3), ca.SX.sym("a")
    system = od.ControlAffineSystem(
        x, ("place", "speed", "bias"), ca.vertcat(x[1], 0, 0), {"a": ca.vertcat(0, 1, 0)}, {},
        {"accelerometer": a + x[2], "place_seen": x[0]}, {"accelerometer": 0.1}, signals={"a": a},
    )  # fmt: skip
    assert od.observability(system).dimension == 3
    path = od.simulate(system, [0.0, 1.0, 0.0], np.ones((1, 1)), 1.0)
    np.testing.assert_allclose(od.variational_gramian(system, path).only("accelerometer").total, np.diag([0, 0, 100.0]), atol=1e-12)
    alone = od.ControlAffineSystem(x, ("p", "v", "b"), None, {}, {}, {"y": a * x[2]}, signals={"a": a})
    assert alone.model.input_names == ("a",)
    u = np.array([[3.0], [0.5]])
    W = od.variational_gramian(alone, od.simulate(alone, np.zeros(3), u, 1.0))
    assert W.total[2, 2] == pytest.approx(9.25)


def test_the_page_on_sensors_shows_what_runs(capsys: pytest.CaptureFixture[str]):
    page = (Path(__file__).parents[1] / "docs" / "sensors.md").read_text()
    names: dict[str, object] = {}
    for block in re.findall(r"```python\n(.*?)```", page, re.DOTALL):
        exec(compile(block, "docs/sensors.md", "exec"), names)  # noqa: S102  # the page's own code
    assert "('gps', 'landmark_6')" in capsys.readouterr().out
    kinds_on_page = re.findall(r"^\| `(\w+)` \| `\w+` \|", page, re.MULTILINE)
    assert set(kinds_on_page) == set(kinds(sensors)), "the table has every kind"


def test_what_is_not_possible_with_inputs_in_outputs_is_refused():
    with pytest.raises(od.InputError, match=r"needs the state '[xy]_rate'.*nothing unknown in it"):
        _ = od.System(od.Unicycle(wind="unknown"), (od.SpeedOverGround(0.3),)).model
    with pytest.raises(od.InputError, match=r"input_psd.*'speed'"):
        od.posterior_information(READY, PATH, PRIOR, PSD, input_psd={"speed": 0.1})
    x = ca.SX.sym("x", 1)
    with pytest.raises(od.InputError, match=r"signals\['a'\] is"):
        od.ControlAffineSystem(x, ("p",), outputs={"y": x[0]}, signals={"a": x[0] * 2})
