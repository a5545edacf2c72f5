"""Sensors of velocity, depth, airspeed and differences of distances: what each sees, in verdicts, information, filters and logs."""

from __future__ import annotations

import dataclasses
import math

import casadi as ca
import numpy as np
import pytest
from by_hand import slopes
from hypothesis import given, settings
from hypothesis import strategies as st

import obsdesign as od
from obsdesign.dynamics.simulation import readings

few = settings(deadline=None, max_examples=8, database=None, derandomize=True)
HERE, THERE = (40.0, -25.0), (-30.0, 60.0)
ROLLING = od.SecondOrderUnicycle(wind="constant")
DIFFERENCE = od.TimeDifference(HERE, 0.3, reference=THERE, sigma_per_metre=0.01, max_range=150.0)
ALL = od.System(
    ROLLING,
    (
        DIFFERENCE,
        od.Doppler(HERE, 0.1, height=4.0, bias_floor=0.05),
        od.Airspeed(0.5, inflation=1.3),
        od.VelocityLog(0.2, mounting_angle=0.3, rate=2.0),
    ),
)
START = np.array([3.0, -1.0, 0.4, 6.0, 2.0, -1.0])
U = np.column_stack([0.4 * np.cos(0.3 * np.arange(24)), 0.5 * np.sin(0.7 * np.arange(24))])
PATH = od.simulate(ALL, START, U, 0.25)
PRIOR, PSD = od.Prior(START, std=(5.0, 4.0, 0.3, 1.0, 1.0, 1.5)), (0.01, 0.01, 0.001, 0.02, 0.01, 0.01)
DIVER = od.System(od.Submersible(), (od.Range(HERE, 1.0, height=3.0), DIFFERENCE, od.Depth(0.1)))
DIVE = od.simulate(DIVER, [3.0, -1.0, 0.4, 12.0], np.column_stack([np.full(24, 6.0), U[:, 1], U[:, 0]]), 0.25)


def verdict(vehicle: object, *sensors: object, **held: float) -> od.Verdict:
    return od.observability(od.System(vehicle, sensors), held=held or None)  # type: ignore[arg-type]


# ---------------------------------------------------------------- what can be seen at all


def test_two_places_leave_no_motion_of_the_plane_and_one_leaves_the_turns_about_it():
    assert verdict(od.Unicycle(), od.TimeDifference(HERE, 0.3, reference=THERE)).dimension == 3
    for sensor in (od.Doppler(HERE, 0.1), od.Range(HERE, 1.0)):
        seen = verdict(od.Dubins(5.0), sensor)
        x, y, _ = seen.at
        turn = np.array([HERE[1] - y, x - HERE[0], 1.0])
        assert seen.dimension == 2
        assert abs(turn @ seen.null_space[:, 0]) == pytest.approx(np.linalg.norm(turn), rel=1e-9)


def test_speeds_see_no_position_and_a_log_of_the_body_no_direction():
    """R(-heading) wind and the speed: turning wind and heading together changes neither; and of a current the speed is not told apart."""
    log = od.VelocityLog(0.1)
    assert verdict(ROLLING, od.Airspeed(0.5)).observable_states == ("speed",)
    assert verdict(ROLLING, log).dimension == 6 - 2 - 1
    assert set(verdict(ROLLING, log, od.Magnetometer(0.1)).observable_states) == {"heading", "speed", "wind_x", "wind_y"}
    assert verdict(ROLLING, log, turn_rate=0.0, acceleration=0.0).dimension == 2
    assert verdict(ROLLING, log, od.Airspeed(0.5), turn_rate=0.0, acceleration=0.0).dimension == 3
    assert verdict(od.Dubins(8.0, wind="constant"), od.Airspeed(0.5)).dimension == 0


def test_a_vehicle_that_dives_is_at_a_distance_in_space():
    """Turns about the vertical through the beacon are hidden; depth is told by the distance alone but for above and below."""
    assert verdict(od.Submersible(), od.Range(HERE, 1.0)).dimension == 3
    assert verdict(od.Submersible(), od.Depth(0.1)).observable_states == ("depth",)
    with pytest.raises(od.InputError, match=r"sensor 'depth_sensor' needs the state 'depth', which the vehicle does not have$"):
        verdict(od.Unicycle(), od.Depth(0.1))
    with pytest.raises(od.InputError, match=r"sensor 'doppler' needs the state 'x_rate', .*nothing unknown in it"):
        verdict(od.Submersible(wind="unknown"), od.Doppler(HERE, 0.1))


# ---------------------------------------------------------------- where outputs have no derivative, or none that tells anything


@few
@given(beyond=st.floats(1.0, 500.0), heading=st.floats(-3.0, 3.0))
def test_beyond_the_two_beacons_a_difference_of_times_says_nothing_and_between_them_twice_what_a_distance_does(
    beyond: float, heading: float
):
    system = od.System(od.Unicycle(), (od.TimeDifference(HERE, 1.0, reference=THERE),))
    axis = np.subtract(HERE, THERE) / math.dist(HERE, THERE)
    outside, between = np.add(HERE, beyond * axis), np.add(HERE, -beyond / 501 * math.dist(HERE, THERE) * axis)
    of = [
        od.variational_gramian(system, od.simulate(system, [*place, heading], np.zeros((1, 2)), 1.0)).total for place in (outside, between)
    ]
    assert np.abs(of[0]).max() < 1e-20
    np.testing.assert_allclose(of[1][:2, :2], 4 * np.outer(axis, axis), atol=1e-9)


@pytest.mark.parametrize(
    ("vehicle", "sensor", "start"),
    [
        (od.Unicycle(), od.TimeDifference(HERE, 0.3, reference=THERE), (*THERE, 0.0)),
        (od.Dubins(8.0), od.Doppler(HERE, 0.1), (*HERE, 0.0)),
        (od.SecondOrderUnicycle(), od.Airspeed(0.1), (0.0, 0.0, 0.3, 0.0)),
    ],
    ids=["at the reference", "at the beacon", "standing still"],
)
def test_where_there_is_no_derivative_the_sensor_is_named(vehicle: object, sensor: object, start: tuple[float, ...]):
    system = od.System(vehicle, (sensor,))  # type: ignore[arg-type]
    path = od.simulate(system, start, np.zeros((3, len(system.model.inputs))), 1.0)
    with pytest.raises(od.InputError, match=f"sensor '{system.sensor_names[0]}' has no derivative at step 0"):
        od.variational_gramian(system, path)


def test_at_zero_speed_a_log_of_the_body_and_a_doppler_still_tell_the_speed():
    system = od.System(od.SecondOrderUnicycle(), (od.VelocityLog(0.5), od.Doppler(HERE, 0.1)))
    W = od.variational_gramian(system, od.simulate(system, [0.0, 0.0, 0.3, 0.0], np.zeros((1, 2)), 1.0))
    along = -np.array(HERE) @ [math.cos(0.3), math.sin(0.3)] / math.hypot(*HERE)
    assert W.only("velocity_log").total[3, 3] == pytest.approx(1 / 0.5**2, rel=1e-12)
    assert W.only("doppler").total[3, 3] == pytest.approx(along**2 / 0.1**2, rel=1e-12)
    np.testing.assert_array_equal(np.delete(np.delete(W.total, 3, 0), 3, 1), 0)


def test_a_doppler_beside_the_position_moves_with_the_turn():
    """h is the derivative of the distance of a sensor on a lever arm that turns and drives, by differences of the range."""
    fields = {"beacon": HERE, "sigma": 1.0, "lever_arm": (1.5, -0.7), "height": 3.0}

    def state(t: float) -> dict[str, ca.SX]:
        numbers = {"x": 3 + 5 * t, "y": -1 + 2 * t, "heading": 0.4 + 0.8 * t, "x_rate": 5.0, "y_rate": 2.0, "heading_rate": 0.8}
        return {name: ca.SX(value) for name, value in numbers.items()}

    found = float(od.Doppler(**fields).measure(state(0.0))[0])
    expected = slopes(lambda t: float(od.Range(**fields).measure(state(float(t[0])))[0]), np.zeros(1))[0]
    assert found == pytest.approx(expected, rel=1e-10)


# ---------------------------------------------------------------- the same in information, filters and logs


@pytest.mark.parametrize(("system", "path"), [(ALL, PATH), (DIVER, DIVE)], ids=["velocities", "dive"])
def test_information_is_made_of_differences_of_samples_along_shifted_paths(system: od.System, path: od.Trajectory):
    plain = od.System(system.vehicle, tuple(dataclasses.replace(sensor, bias_floor=0.0) for sensor in system.sensors))
    W = od.variational_gramian(plain, path)
    owner = list(plain.model.output_owner)

    def outputs(start: np.ndarray) -> np.ndarray:
        return readings(plain, od.simulate(plain, start, path.u, 0.25).x[None, :-1]).y[0]

    C = np.array([slopes(lambda x, k=k, i=i: float(outputs(x)[k, i]), path.x[0]) for k in range(path.steps) for i in range(len(owner))])
    there = readings(plain, path.x[None, :-1])
    arrives = np.array([[k % 2 == 0 if plain.sensors[s].rate else True for s in owner] for k in range(path.steps)])
    weight = (arrives * there.gate[0] / there.variance[0]).ravel()
    np.testing.assert_allclose(W.total, C.T @ (weight[:, None] * C), rtol=1e-6, atol=1e-9 * np.abs(W.total).max())


def test_a_filter_that_is_told_no_errors_knows_what_the_bound_says_step_by_step_and_from_a_log():
    """With noise-free samples and the true start it stays on the path, where its covariance is the inverse of the posterior information."""
    plain = [dataclasses.replace(sensor, bias_floor=0.0, rate=None) for sensor in ALL.sensors]
    plain[0] = dataclasses.replace(DIFFERENCE, max_range=None)
    system, path, prior, psd = od.System(ROLLING, tuple(plain)), PATH, PRIOR, PSD
    y = readings(system, path.x[None, :-1]).y[0]
    estimate = od.estimate_states(system, prior, path.u, y, 0.25, disturbance_psd=psd)
    J = od.posterior_information(system, path, prior, psd)
    np.testing.assert_allclose(estimate.mean, path.x, atol=1e-9)
    np.testing.assert_allclose(estimate.covariance[-1] @ J[-1], np.eye(6), atol=1e-7)
    values = np.full((path.steps, 4, 2), np.nan)
    values[:, :, 0], values[:, 3, 1] = y[:, :4], y[:, 4]
    samples = od.LogSamples(system.sensor_names, np.repeat(path.t[:-1], 4), np.tile(np.arange(4), path.steps), values.reshape(-1, 2))
    log = od.Log(od.LogInputs(("acceleration", "turn_rate"), path.t[:-1], path.u), samples)
    found = od.estimate_log(system, log, prior, disturbance_psd=psd)
    np.testing.assert_allclose(found.covariance[-1], estimate.covariance[len(found.t) - 1], rtol=1e-8, atol=1e-11)
    W = od.variational_gramian(system, path)
    np.testing.assert_allclose(od.variational_gramian(system, path, samples=log).total, W.total, rtol=1e-9, atol=1e-12 * W.total.max())


def test_a_difference_of_distances_is_of_two_places():
    with pytest.raises(od.InputError, match=r"time_difference: reference is \(40\.0, -25\.0\): must not be the beacon"):
        od.TimeDifference(HERE, 0.3, reference=HERE)
    assert od.TimeDifference(HERE, 0.3, reference=HERE, height=2.0).landmarks == (HERE, HERE)
    with pytest.raises(od.InputError, match=r"time_difference: reference is"):
        od.TimeDifference(HERE, 0.3, reference=(math.nan, 0.0))
