"""Scales and biases of sensors as states, and sensors that are one thing: the same everywhere as systems written by hand."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import obsdesign as od
from obsdesign.dynamics.simulation import readings

few = settings(deadline=None, max_examples=8, database=None, derandomize=True)
PLACE = (40.0, 25.0)
BEACONS = (PLACE, (-30.0, 10.0), (5.0, -45.0))
U = np.column_stack([2.0 + np.sin(np.arange(30) / 9), 0.3 * np.cos(np.arange(30) / 7)])
PRIOR = od.Prior([0.5, -0.5, 0.1, 1.05, 0.3], std=(2.0, 2.0, 0.2, 0.1, 1.0))
PSD = (0.01, 0.01, 0.001, 0.0, 1e-4)
READY = od.System(od.Unicycle(), (od.Range(PLACE, 0.5, scale="stretch", bias="offset"), od.Magnetometer(0.1)))
x = ca.SX.sym("x", 5)
BY_HAND = od.ControlAffineSystem(
    state=x,
    names=("x", "y", "heading", "stretch", "offset"),
    known={"speed": ca.vertcat(ca.cos(x[2]), ca.sin(x[2]), 0, 0, 0), "turn_rate": ca.vertcat(0, 0, 1, 0, 0)},
    outputs={"range": x[3] * ((PLACE[0] - x[0]) ** 2 + (PLACE[1] - x[1]) ** 2) ** 0.5 + x[4], "magnetometer": x[2]},
    sigmas={"range": 0.5, "magnetometer": 0.1},
    angles=("heading", "magnetometer"),
)
START = [0.0, 0.0, 0.0, 1.0, 0.0]


# ---------------------------------------------------------------- scale and bias


def test_a_range_with_scale_and_bias_is_the_system_that_one_would_write():
    assert READY.model.state_names == BY_HAND.names
    assert READY.model.states[4].unit == "m"
    seen, by_hand = od.observability(READY), od.observability(BY_HAND)
    assert seen.dimension == by_hand.dimension == 5
    path, same = od.simulate(READY, START, U, 0.25), od.simulate(BY_HAND, START, U, 0.25)
    np.testing.assert_array_equal(path.x, same.x)
    W = od.variational_gramian(READY, path)
    np.testing.assert_allclose(W.blocks, od.variational_gramian(BY_HAND, same).blocks, rtol=1e-12, atol=1e-12)
    found = od.posterior_information(READY, path, PRIOR, PSD)
    np.testing.assert_allclose(found, od.posterior_information(BY_HAND, same, PRIOR, PSD), rtol=1e-10)
    y = readings(READY, path.x[None, :-1]).y[0] + 0.1 * np.random.default_rng(0).standard_normal((30, 2))
    estimates = [od.estimate_states(system, PRIOR, U, y, 0.25, disturbance_psd=PSD) for system in (READY, BY_HAND)]
    np.testing.assert_allclose(estimates[0].mean, estimates[1].mean, rtol=1e-12, atol=1e-12)
    samples = od.LogSamples(("range", "magnetometer"), path.t[:-1].repeat(2), [0, 1] * 30, y.ravel())
    log = od.Log(od.LogInputs(("speed", "turn_rate"), path.t[:-1], U), samples)
    from_log = od.estimate_log(READY, log, PRIOR, disturbance_psd=PSD)
    np.testing.assert_allclose(from_log.mean[-1], estimates[0].mean[len(from_log.t) - 1], rtol=1e-10, atol=1e-10)


def test_a_compass_that_is_off_is_told_from_the_heading_by_moving():
    """With positions the motion shows the heading; at rest heading and bias only appear as their sum."""
    system = od.System(od.Unicycle(), (od.GPS(1.0), od.Magnetometer(0.1, bias="deviation")))
    assert od.observability(system).dimension == 4
    resting = od.observability(system, held={"speed": 0.0, "turn_rate": 0.0})
    assert resting.dimension == 3
    np.testing.assert_allclose(np.abs(resting.null_space[:, 0]), np.array([0, 0, 1, 1]) / np.sqrt(2), atol=1e-12)
    assert resting.null_space[2, 0] == pytest.approx(-resting.null_space[3, 0])


@few
@given(at=st.tuples(st.floats(-20, 20), st.floats(-5, 5)), clock=st.floats(-5, 5))
def test_distances_off_by_one_clock_are_worth_what_their_differences_are(at: tuple[float, float], clock: float):
    """Of one instant: W with the shared bias eliminated equals differences to the first, of covariance sigma^2 (I + 11')."""
    sigma, zero = 0.7, np.zeros((1, 2))
    pseudo = od.System(od.Unicycle(), tuple(od.Range(place, sigma, bias="clock") for place in BEACONS))
    W = od.variational_gramian(pseudo, od.simulate(pseudo, [*at, 0.1, clock], zero, 1.0)).total
    eliminated = W[:2, :2] - np.outer(W[:2, 3], W[:2, 3]) / W[3, 3]
    differences = tuple(od.TimeDifference(place, sigma, reference=PLACE, name=f"to_{i}") for i, place in enumerate(BEACONS[1:]))
    tdoa = od.System(od.Unicycle(), differences, joint_noise={("to_0", "to_1"): sigma**2 * (np.eye(2) + 1)})
    found = od.variational_gramian(tdoa, od.simulate(tdoa, [*at, 0.1], zero, 1.0)).total
    np.testing.assert_allclose(found[:2, :2], eliminated, rtol=1e-9, atol=1e-10)


def test_what_does_not_fit_is_refused_by_name():
    for sensors, said in (
        ((od.Range(PLACE, 1.0, bias="heading"),), r"range: the state 'heading' has the name of a state"),
        ((od.Range(PLACE, 1.0, bias="speed"),), r"range: the state 'speed' has the name of an input"),
        ((od.Range(PLACE, 1.0, scale="range"),), r"range: the state 'range' has the name of an output"),
        ((od.Range(PLACE, 1.0, bias="b"), od.Magnetometer(0.1, bias="b")), r"'b' is shared by outputs of the units 'm' and 'rad'"),
        ((od.Range(PLACE, 1.0, group="g"), od.Bearing(PLACE, 0.1, group="g", rate=2.0)), r"group 'g': rate of its sensors is None, 2\.0"),
    ):
        with pytest.raises(od.InputError, match=said):
            od.System(od.Unicycle(), sensors)
    with pytest.raises(od.InputError, match=r"bearing: scale is 's': must be None, an angle that wraps has no scale"):
        od.Bearing(PLACE, 0.1, scale="s")
    with pytest.raises(od.InputError, match=r"range: bias is '': must be a name"):
        od.Range(PLACE, 0.1, bias="")


def test_a_system_with_some_of_its_sensors_keeps_the_states_and_numbers_of_all():
    system = od.System(od.Unicycle(), (od.Range(PLACE, 0.5, bias="a"), od.Range(BEACONS[1], 0.5, bias="b"), od.GPS(1.0)))
    path = od.simulate(system, [0.0, 0.0, 0.0, 0.1, 0.2], U, 0.25)
    W = od.variational_gramian(system, path)
    some = dataclasses.replace(system, suite=("range_2", "gps"))
    assert some.sensor_names == some.model.sensor_names == ("range_2", "gps")
    assert some.model.state_names == system.model.state_names
    np.testing.assert_allclose(od.variational_gramian(some, path).total, W.only("range_2", "gps").total, rtol=1e-12, atol=1e-15)


# ---------------------------------------------------------------- groups

LIMITS = {"max_range": 45.0, "field_of_view": 2.0, "height": 1.0}
APART = od.System(
    od.Unicycle(), (od.GPS(2.0), od.Range(PLACE, 0.5, group="tree", **LIMITS), od.Bearing(PLACE, 0.05, group="tree", **LIMITS))
)
ONE = od.System(od.Unicycle(), (od.GPS(2.0), od.RangeBearing(PLACE, 0.5, bearing_sigma=0.05, name="tree", **LIMITS)))


def test_a_range_and_a_bearing_of_one_group_are_a_range_bearing():
    assert APART.sensor_names == ONE.sensor_names == ("gps", "tree")
    assert [signal.name for signal in APART.model.outputs] == ["gps_x", "gps_y", "tree_range", "tree_bearing"]
    path = od.simulate(ONE, [0.0, 0.0, 0.5], U, 0.25)
    W = [od.variational_gramian(system, path) for system in (APART, ONE)]
    np.testing.assert_allclose(W[0].blocks, W[1].blocks, rtol=1e-12, atol=1e-12)
    shares = [od.contributions(system, each) for system, each in zip((APART, ONE), W, strict=True)]
    assert shares[0].sensors == ("gps", "tree")
    np.testing.assert_allclose(shares[0].shares, shares[1].shares, atol=1e-12)
    chosen = [od.select_sensors(each.by_segment(5)).chosen for each in W]
    assert chosen[0].shape == (5, 2)
    np.testing.assert_array_equal(*chosen)
    y = readings(ONE, path.x[None, :-1]).y[0]
    prior = od.Prior([1.0, -1.0, 0.4], std=(2.0, 2.0, 0.2))
    estimates = [od.estimate_states(system, prior, U, y, 0.25, disturbance_psd=PSD[:3]) for system in (APART, ONE)]
    np.testing.assert_allclose(estimates[0].mean, estimates[1].mean, rtol=1e-12, atol=1e-12)
    samples = od.LogSamples(("tree",), path.t[:-1], [0] * 30, y[:, 2:])
    log = od.Log(od.LogInputs(("speed", "turn_rate"), path.t[:-1], U), samples)
    told = [od.variational_gramian(system, path, samples=log).total for system in (APART, ONE)]
    np.testing.assert_allclose(told[0], told[1], rtol=1e-12, atol=1e-12)


def test_constant_errors_of_a_group_are_each_of_its_own_unit():
    """As two sensors of their own: independent errors, each its own constant, in the Gramian, the posterior and the filter."""
    parts = (od.Range(PLACE, 0.5, bias_floor=0.7), od.Bearing(PLACE, 0.05, bias_floor=0.02), od.GPS(2.0))
    joined = od.System(od.Unicycle(), (*(dataclasses.replace(part, group="tree") for part in parts[:2]), parts[2]))
    apart = od.System(od.Unicycle(), parts)
    path = od.simulate(apart, [0.0, 0.0, 0.5], U, 0.25)
    W = [od.variational_gramian(system, path).total for system in (joined, apart)]
    np.testing.assert_allclose(W[0], W[1], rtol=1e-9)
    prior = od.Prior([1.0, -1.0, 0.4], std=(2.0, 2.0, 0.2))
    J = [od.posterior_information(system, path, prior, PSD[:3]) for system in (joined, apart)]
    np.testing.assert_allclose(J[0], J[1], rtol=1e-8)
    y = readings(apart, path.x[None, :-1]).y[0]
    estimates = [od.estimate_states(system, prior, U, y, 0.25, disturbance_psd=PSD[:3]) for system in (joined, apart)]
    np.testing.assert_allclose(estimates[0].covariance, estimates[1].covariance, rtol=1e-8, atol=1e-12)
    assert joined.model.output_bias == (0.7, 0.02, 0.0, 0.0)
    x = ca.SX.sym("x", 3)
    east, north = PLACE[0] - x[0], PLACE[1] - x[1]
    outputs = {"tree": ca.vertcat((east**2 + north**2) ** 0.5, ca.atan2(north, east) - x[2]), "gps": x[:2]}
    noises = {"tree": od.OutputNoise((0.5, 0.05), bias_floor=(0.7, 0.02)), "gps": od.OutputNoise(2.0)}
    known = {"speed": ca.vertcat(ca.cos(x[2]), ca.sin(x[2]), 0), "turn_rate": ca.SX([0, 0, 1])}
    own = od.ControlAffineSystem(x, ("x", "y", "heading"), None, known, {}, outputs, angles=("heading", "tree_2"), noises=noises)
    np.testing.assert_allclose(od.variational_gramian(own, path).total, W[1], rtol=1e-9)


def test_two_sensors_of_one_kind_in_a_group_are_told_apart_and_their_limits_count_each():
    """A pair of antennas ahead and astern on one thing: it comes where both see it."""
    pair = tuple(od.Range(PLACE, 0.5, max_range=45.0, lever_arm=(ahead, 0.0), group="post") for ahead in (2.0, -2.0))
    system = od.System(od.Unicycle(), pair)
    alone = [od.System(od.Unicycle(), (dataclasses.replace(sensor, group=None),)) for sensor in pair]
    assert [signal.name for signal in system.model.outputs] == ["post_range", "post_range_2"]
    states = np.array([[[1.0, 2.0, 0.3], [20.0, 5.0, -1.0]]])
    gates = [readings(each, states).gate[0, :, 0] for each in alone]
    np.testing.assert_allclose(readings(system, states).gate[0, :, 0], gates[0] * gates[1], rtol=1e-12)


def test_a_log_typed_by_hand_names_the_outputs_of_a_group(tmp_path: Path):
    file = tmp_path / "run.csv"
    file.write_text("t [s],speed,turn_rate,tree_range,tree_bearing [deg]\n0,1,0.1,,\n0.5,,,47.2,32\n1.0,1,0.1,46.7,\n1.5,,,46.3,31\n")
    with pytest.raises(od.InputError, match="tree_bearing"):
        od.read_log(file, APART)
    file.write_text(file.read_text().replace("46.7,", "46.7,31.5"))
    log = od.read_log(file, APART)
    assert log.samples.counts["tree"] == 3
    np.testing.assert_allclose(log.samples.y[0], [47.2, np.deg2rad(32)])
    file.write_text(file.read_text().replace("46.3", "-46.3"))
    with pytest.raises(od.InputError, match=r"column 'tree': -46.3 at t = 1.5 s: what it measures is not below 0"):
        od.read_log(file, APART)


SCENARIO = """
version = 1
title = "A rover with an odd compass and a clock that is off"
question = "What does it see?"
[vehicle]
kind = "second_order_unicycle"
[[sensors]]
kind = "range"
beacon = [40.0, 25.0]
sigma = 0.5
bias = "clock"
group = "mast"
[[sensors]]
kind = "bearing"
beacon = [40.0, 25.0]
sigma_deg = 3.0
group = "mast"
[[sensors]]
kind = "range"
beacon = [-30.0, 10.0]
sigma = 0.5
bias = "clock"
name = "second"
[[sensors]]
kind = "airspeed"
sigma = 0.2
scale = "wheel"
[[sensors]]
kind = "time_difference"
beacon = [40.0, 25.0]
reference = [-30.0, 10.0]
sigma = 1.0
[start]
x = 0.0
y = 0.0
heading = 0.0
speed = 2.0
clock = 0.5
wheel = 1.0
[prior]
x = 1.0
y = 1.0
heading_deg = 6.0
speed = 0.2
clock = 1.0
wheel = 0.1
[process_noise]
clock = 0.01
[time]
duration = 4.0
step = 0.5
segment = 2.0
[design]
path = { kind = "piecewise_constant", pieces = 2 }
bounds = { acceleration = [-0.1, 0.1], turn_rate_deg = [-20.0, 20.0] }
starts = 1
suites = [["mast", "second", "airspeed"]]
[selection]
question = "start"
[validation]
runs = 2
"""


@pytest.mark.slow
def test_a_scenario_has_them_as_states_and_things_all_the_way_to_its_page(tmp_path: Path):
    file = tmp_path / "rover.toml"
    file.write_text(SCENARIO)
    scenario = od.load_scenario(file)
    assert scenario.state_names == ("x", "y", "heading", "speed", "clock", "wheel") == scenario.system.model.state_names
    assert scenario.sensor_names == ("mast", "second", "airspeed", "time_difference")
    study = od.run(scenario)
    assert study.selection.schedule.chosen.shape == (2, 4)
    od.write_report(tmp_path / "out", study)
    assert "clock" in (tmp_path / "out" / "result.json").read_text()


def test_a_scenario_names_the_states_of_its_sensors(tmp_path: Path):
    file = tmp_path / "rover.toml"
    for wrong, said in (('bias = "clock"', "clock"), ('bias = "speed"', "has the name of a state")):
        file.write_text(SCENARIO.replace('bias = "clock"', wrong).replace("clock = 0.5\n", ""))
        with pytest.raises(od.ScenarioError, match=said):
            od.load_scenario(file)
