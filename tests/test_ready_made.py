"""Truths about vehicles in space, in polar coordinates, in pairs, and targets: what papers print of them, and what is well known."""

from __future__ import annotations

import numpy as np
import pytest

import obsdesign as od

CENTRE = (0.0, 0.0)
PICTURE = (od.Camera(0.02), od.QuaternionNorm(0.01))
POLAR = {"distance": od.Range(CENTRE, 1.0), "bearing": od.Bearing(CENTRE, 0.1), "direction": od.GlobalBearing(CENTRE, 0.1)}
SIAM = {  # Martinelli, SIAM 2018, sections 4.1 to 4.6: dimensions with the speed, the turn rate, both, none of them unknown
    "distance": (2, 2, 1, 2),
    "bearing": (1, 2, 1, 2),
    "direction": (2, 3, 1, 3),
}
UNKNOWN = (("speed",), ("turn_rate",), ("speed", "turn_rate"), ())


@pytest.mark.parametrize("output", SIAM)
def test_the_unicycle_in_polar_coordinates_sees_what_the_paper_prints(output: str):
    systems = [od.System(od.PolarUnicycle(), (POLAR[output],), unknown) for unknown in UNKNOWN]
    assert tuple(od.observability(system).dimension for system in systems) == SIAM[output]
    cartesian = [od.System(od.Unicycle(), (POLAR[output],), unknown) for unknown in UNKNOWN]
    assert tuple(od.observability(system).dimension for system in cartesian) == SIAM[output]  # other names of the same states


def test_wind_of_a_known_direction_makes_roll_and_pitch_visible_and_yaw_about_it_never():
    """Martinelli, IROS 2017, section III."""
    still = od.observability(od.System(od.Aerial3D(), PICTURE))
    windy = od.observability(od.System(od.Aerial3D("unknown"), PICTURE))
    assert (still.dimension, still.ranks) == (4, (3, 4))
    assert (windy.dimension, windy.ranks) == (6, (3, 5, 6))
    x, y, _, t, i, j, k = windy.at
    yaw = np.array([-y, x, 0.0, -k / 2, -j / 2, i / 2, t / 2])
    np.testing.assert_allclose(abs(windy.null_space[:, 0] @ yaw), np.linalg.norm(yaw), rtol=1e-9)


@pytest.mark.parametrize("direction", [(1.0, 0.0, 0.0), (1.0, -2.0, 2.0)])
def test_the_direction_of_the_wind_is_the_axis_of_what_stays_hidden(direction: tuple[float, float, float]):
    """Turning everything about it: r' = d x r, q' = (0, d) q / 2."""
    verdict = od.observability(od.System(od.Aerial3D("unknown", direction), PICTURE))
    d, r, (t, *v) = np.array(direction), verdict.at[:3], verdict.at[3:]
    turn = np.concatenate([np.cross(d, r), [-d @ v / 2], (t * d + np.cross(d, v)) / 2])
    assert verdict.dimension == 6
    np.testing.assert_allclose(abs(verdict.null_space[:, 0] @ turn), np.linalg.norm(turn), rtol=1e-9)


def test_with_a_point_of_known_place_inertial_sensors_and_a_camera_miss_yaw_alone():
    """Whatever is asked of gravity and of the biases: Martinelli 2012, Jones and Soatto 2011."""
    for vehicle, n in ((od.InertialVisual(), 10), (od.InertialVisual(None), 11), (od.InertialVisual(biases=True), 16)):
        verdict = od.observability(od.System(vehicle, PICTURE))
        assert (verdict.dimension, len(verdict.null_space)) == (n - 1, n)
        x, y, _, east, north, _, t, i, j, k = verdict.at[:10]
        yaw = np.array([-y, x, 0.0, -north, east, 0.0, -k / 2, -j / 2, i / 2, t / 2, *[0.0] * (n - 10)])
        np.testing.assert_allclose(abs(verdict.null_space[:, 0] @ yaw), np.linalg.norm(yaw), rtol=1e-9)
    free_fall = od.observability(od.System(od.InertialVisual(0.0), PICTURE))
    assert free_fall.dimension == 10 - 3  # no direction is down: all three turns about the point


def test_two_robots_see_where_the_other_is_and_never_where_both_are():
    """Relative position and heading, from a distance alone or a direction alone, even of a peer that moves as nobody knows."""
    for peer in ("known", "unknown"):
        for sensors in ((od.PeerRange(1.0),), (od.PeerBearing(0.1),), (od.PeerRange(1.0), od.PeerBearing(0.1))):
            verdict = od.observability(od.System(od.TwoRobots(peer), sensors))
            x, y, _, peer_x, peer_y, _ = verdict.at
            moves = np.array([[1, 0, 0, 1, 0, 0], [0, 1, 0, 0, 1, 0], [-y, x, 1, -peer_y, peer_x, 1]], dtype=float)
            assert verdict.dimension == 3
            hidden = verdict.null_space
            np.testing.assert_allclose(hidden @ hidden.T @ moves.T, moves.T, atol=1e-9 * np.abs(moves).max())
    with_gps = od.observability(od.System(od.TwoRobots("unknown"), (od.PeerBearing(0.1), od.GPS(2.0))))
    assert with_gps.dimension == 6


REST = {"own_acceleration_x": 0.0, "own_acceleration_y": 0.0}
TARGETS = {  # at constant velocity, the observer steering or not; accelerating, likewise
    "range": (4, 3, 4, 2),
    "global_bearing": (4, 3, 4, 2),
    "doppler": (4, 3, 4, 1),
}


@pytest.mark.parametrize("kind", TARGETS)
def test_a_target_is_found_by_an_observer_that_manoeuvres(kind: str):
    """Nardone and Aidala 1981: by bearings alone, all but the scale without a manoeuvre; distances and their rates hide a rotation."""
    sensor = {"range": od.Range(CENTRE, 1.0), "global_bearing": od.GlobalBearing(CENTRE, 0.1), "doppler": od.Doppler(CENTRE, 0.1)}[kind]
    dimensions = []
    for target in ("constant velocity", "unknown acceleration"):
        system = od.System(od.TargetMotion(target), (sensor,))
        dimensions += [od.observability(system).dimension, od.observability(system, held=REST).dimension]
    assert tuple(dimensions) == TARGETS[kind]
    hidden = od.observability(od.System(od.TargetMotion(), (sensor,)), held=REST).hidden
    assert hidden.startswith("scale of everything" if kind == "global_bearing" else "rotation of everything")


def test_one_sample_of_three_bearings_is_three_samples_of_one():
    places = ((2.0, 0.0), (-1.0, 3.0), (-1.0, -3.0))
    together = od.System(od.Unicycle(), (od.RelativeBearing(0.1, beacons=places),))
    apart = od.System(od.Unicycle(), tuple(od.Bearing(place, 0.1, name=f"to_{i}") for i, place in enumerate(places)))
    u = np.tile([1.0, 0.3], (6, 1))
    blocks = [od.variational_gramian(system, od.simulate(system, [0.3, 0.2, 0.4], u, 0.5)).total for system in (together, apart)]
    np.testing.assert_allclose(*blocks, rtol=1e-12)


def test_a_gyroscope_with_a_bias_finds_it_and_an_accelerometer_the_speed():
    """omega + b with omega known; v omega and dv/dt with both known: v where the vehicle turns."""
    biased = od.System(od.Unicycle(), (od.Gyroscope(0.01, bias="gyroscope_bias"),))
    assert od.observability(biased).observable_states == ("gyroscope_bias",)
    felt = od.System(od.SecondOrderUnicycle(), (od.Accelerometer(0.1),))
    assert od.observability(felt).observable_states == ("speed",)
    assert od.observability(felt, held={"turn_rate": 0.0}).observable_states == ()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: od.Aerial3D("gusty"), "wind is 'gusty': must be None, 'constant'"),
        (lambda: od.Aerial3D(direction=(0.0, 0.0, 0.0)), r"direction is \(0, 0, 0\): must point somewhere"),
        (lambda: od.TwoRobots("absent"), "peer is 'absent': must be 'known'"),
        (lambda: od.TargetMotion("parked"), "target is 'parked': must be 'constant velocity' or 'unknown acceleration'"),
        (lambda: od.RelativeBearing(0.1, beacons=()), "relative_bearing: beacons is empty"),
        (lambda: od.RelativeBearing(0.1, beacons=((1.0, 2.0), (1.0, 2.0))), r"relative_bearing: beacons has \(1.0, 2.0\) twice"),
        (lambda: od.Camera(0.1, feature=(0.0, np.inf, 0.0)), "camera: feature is inf: must be a finite number"),
        (lambda: od.System(od.Unicycle(), (od.Camera(0.1),)).model, "sensor 'camera' needs the state 'z'"),
    ],
)
def test_what_cannot_be_meant_is_named(make, message: str):
    with pytest.raises(od.InputError, match=message):
        make()
