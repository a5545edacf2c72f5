"""Contracts of the families: every file of a family is tested from the moment it exists.

A new kind needs one line in its family's table of examples below; without one, its tests fail and say so.
"""

from __future__ import annotations

import cmath
import dataclasses
import math
import pickle
from collections.abc import Callable, Mapping
from types import ModuleType
from typing import Any

import casadi as ca
import cvxpy as cp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import obsdesign as od
from obsdesign import constraints, costs, criteria, paths, sensors, vehicles
from obsdesign.constraints.abstract import AbstractConstraint, Span
from obsdesign.constraints.circle_clearance import CircleClearance
from obsdesign.constraints.goal_pose import GoalPose
from obsdesign.constraints.goal_region import GoalRegion
from obsdesign.constraints.ground_speed import GroundSpeed
from obsdesign.constraints.heading_sector import HeadingSector
from obsdesign.constraints.keep_in import KeepIn
from obsdesign.constraints.keep_out_polygon import KeepOutPolygon
from obsdesign.constraints.loiter import Loiter
from obsdesign.constraints.max_range import MaxRange
from obsdesign.constraints.via import Via
from obsdesign.costs.abstract import AbstractCost
from obsdesign.costs.effort import Effort
from obsdesign.costs.flight_time import FlightTime
from obsdesign.costs.path_length import PathLength
from obsdesign.criteria.abstract import AbstractCriterion
from obsdesign.families import kinds, leaf
from obsdesign.moment import Moment
from obsdesign.paths.abstract import AbstractPath, Grid
from obsdesign.paths.b_spline import BSpline
from obsdesign.paths.dubins_path import DubinsPath
from obsdesign.sensors.abstract import AbstractSensor
from obsdesign.vehicles.abstract import AbstractVehicle
from obsdesign.vehicles.omnidirectional import Omnidirectional

few = settings(deadline=None, max_examples=10, database=None, derandomize=True)
seeds = st.integers(0, 10**6)
BEACON = (40.0, -25.0)

# ---------------------------------------------------------------- examples, one entry per kind


@dataclasses.dataclass(frozen=True)
class Flight:
    """A vehicle under constant inputs u and disturbances w, and its state after t seconds integrated by hand."""

    vehicle: AbstractVehicle
    start: tuple[float, ...]
    u: tuple[float, ...]
    w: tuple[float, ...]
    state_at: Callable[[float], np.ndarray]
    is_polynomial: bool = False


def on_a_circle(speed: float, turn_rate: float, start: tuple[float, ...], wind: tuple[float, float]) -> Callable[[float], np.ndarray]:
    """Constant speed, turn rate and wind: a circle in the moving air."""

    def state_at(t: float) -> np.ndarray:
        x, y, heading, *rest = start
        end, radius = heading + turn_rate * t, speed / turn_rate
        east = x + radius * (math.sin(end) - math.sin(heading)) + wind[0] * t
        north = y - radius * (math.cos(end) - math.cos(heading)) + wind[1] * t
        return np.array([east, north, end, *rest])

    return state_at


def slipping(start: tuple[float, ...], forward: float, sideways: float, turn_rate: float) -> Callable[[float], np.ndarray]:
    """Constant velocity along axes that turn at a constant rate: the integral of a rotating vector."""

    def state_at(t: float) -> np.ndarray:
        x, y, heading, *rest = start
        end = heading + turn_rate * t
        sine, cosine = math.sin(end) - math.sin(heading), math.cos(end) - math.cos(heading)
        east, north = (forward * sine + sideways * cosine) / turn_rate, (sideways * sine - forward * cosine) / turn_rate
        return np.array([x + east, y + north, end, *rest])

    return state_at


def speeding_up(
    start: tuple[float, ...], acceleration: float, turn_rate: float, wind: tuple[float, float]
) -> Callable[[float], np.ndarray]:
    """Constant acceleration and turn rate: integrals of (v + a t) exp(i (h + w t)) by parts."""

    def state_at(t: float) -> np.ndarray:
        x, y, heading, speed, *rest = start
        first, last = (v * cmath.exp(1j * h) for v, h in ((speed, heading), (speed + acceleration * t, heading + turn_rate * t)))
        turned = cmath.exp(1j * (heading + turn_rate * t)) - cmath.exp(1j * heading)
        moved = (last - first) / (1j * turn_rate) + acceleration * turned / turn_rate**2 + complex(*wind) * t
        return np.array([x + moved.real, y + moved.imag, heading + turn_rate * t, speed + acceleration * t, *rest])

    return state_at


def diving(start: tuple[float, ...], speed: float, turn_rate: float, dive_rate: float, wind: tuple[float, float]) -> Callable:
    """A circle, and a straight line down."""

    def state_at(t: float) -> np.ndarray:
        planar = on_a_circle(speed, turn_rate, start[:3], wind)(t)
        return np.array([*planar, start[3] + dive_rate * t, *start[4:]])

    return state_at


def turned(omega: tuple[float, ...], t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """exp(K t), its integral and that one's integral from 0 to t, K the cross product with omega: Rodrigues' formula, term by term."""
    K = np.array([[0.0, -omega[2], omega[1]], [omega[2], 0.0, -omega[0]], [-omega[1], omega[0], 0.0]])
    size, unit = math.hypot(*omega), np.eye(3)
    angle, second = size * t, K @ K / size**2
    rotation = unit + math.sin(angle) / size * K + (1 - math.cos(angle)) * second
    once = t * unit + (1 - math.cos(angle)) / size**2 * K + (t - math.sin(angle) / size) * second
    twice = t**2 / 2 * unit + (t - math.sin(angle) / size) / size**2 * K + (t**2 / 2 - (1 - math.cos(angle)) / size**2) * second
    return rotation, once, twice


def attitude(q: tuple[float, ...], omega: tuple[float, ...], t: float) -> tuple[np.ndarray, np.ndarray]:
    """The quaternion after turning at a constant rate about the vehicle's own axes, and the matrix of the first one."""
    size = math.hypot(*omega)
    turn = np.array([math.cos(size * t / 2), *(math.sin(size * t / 2) / size * np.array(omega))])
    (a, b, c, d), (p, x, y, z) = q, turn
    product = [a * p - b * x - c * y - d * z, a * x + b * p + c * z - d * y, a * y - b * z + c * p + d * x, a * z + b * y - c * x + d * p]
    v = np.array([b, c, d])
    cross = np.array([[0.0, -d, c], [d, 0.0, -b], [-c, b, 0.0]])
    return np.array(product), (a**2 - v @ v) * np.eye(3) + 2 * np.outer(v, v) + 2 * a * cross


def flying(start: tuple[float, ...], omega: tuple[float, ...], airspeed: tuple[float, ...], wind: tuple[float, ...]) -> Callable:
    """Constant turn rates, airspeed and wind: the integral of a turning velocity."""

    def state_at(t: float) -> np.ndarray:
        q, R = attitude(start[3:7], omega, t)
        place = np.array(start[:3]) + R @ turned(omega, t)[1] @ np.array(airspeed) + np.array(wind) * t
        return np.array([*place, *q, *start[7:]])

    return state_at


def feeling(start: tuple[float, ...], omega: tuple[float, ...], force: tuple[float, ...], gravity: float) -> Callable:
    """Constant turn rates and forces: the integral of a turning force, twice."""

    def state_at(t: float) -> np.ndarray:
        q, R = attitude(start[6:10], omega, t)
        down, (_, once, twice) = np.array([0.0, 0.0, -gravity]), turned(omega, t)
        velocity = np.array(start[3:6]) + R @ once @ np.array(force) + down * t
        place = np.array(start[:3]) + np.array(start[3:6]) * t + R @ twice @ np.array(force) + down * t**2 / 2
        return np.array([*place, *velocity, *q, *start[10:]])

    return state_at


def in_polar_coordinates(planar: Callable[[float], np.ndarray]) -> Callable[[float], np.ndarray]:
    def state_at(t: float) -> np.ndarray:
        x, y, heading = planar(t)
        return np.array([math.hypot(x, y), math.atan2(y, x), heading])

    return state_at


def side_by_side(one: Callable[[float], np.ndarray], other: Callable[[float], np.ndarray]) -> Callable[[float], np.ndarray]:
    return lambda t: np.array([*one(t), *other(t)])


def pushed(start: tuple[float, ...], push: complex) -> Callable[[float], np.ndarray]:
    """A constant acceleration: a parabola."""

    def state_at(t: float) -> np.ndarray:
        place, velocity = complex(*start[:2]), complex(*start[2:])
        place, velocity = place + velocity * t + push * t**2 / 2, velocity + push * t
        return np.array([place.real, place.imag, velocity.real, velocity.imag])

    return state_at


SLIPS_3D = (0.3, -0.2, 0.5)
SPIN, TILTED = (0.15, -0.1, 0.2), tuple((np.array([0.9, 0.1, -0.3, 0.2]) / math.hypot(0.9, 0.1, 0.3, 0.2)).tolist())
ALOFT, AIRSPEED = (1.0, -2.0, 3.0, *TILTED), (5.0, 1.0, -0.5)
MOVING, BIASES = (1.0, -2.0, 3.0, 0.5, 0.2, -0.1, *TILTED), (0.1, -0.05, 0.2, 0.01, -0.02, 0.03)
FORCE, BIASED_FORCE = (0.4, -0.3, 9.0), (0.5, -0.35, 9.2)
BIASED_SPIN = (0.16, -0.12, 0.23)
AROUND, POLAR = (60.0, 15.0, 0.4), (math.hypot(60.0, 15.0), math.atan2(15.0, 60.0), 0.4)
PEER, PASSING = (3.0, 4.0, -1.0), (100.0, -20.0, 3.0, 1.0)
AT_REST, IN_WIND, WIND = (1.0, -2.0, 0.4), (1.0, -2.0, 0.4, 3.0, -1.5), (3.0, -1.5)
SLIPS, ROLLING, SUNK = (0.7, -2.0, 0.1), (1.0, -2.0, 0.4, 6.0), (1.0, -2.0, 0.4, 12.0)
VEHICLES = {
    "aerial_3d": [
        Flight(od.Aerial3D(), ALOFT, (*SPIN, *AIRSPEED), (), flying(ALOFT, SPIN, AIRSPEED, (0.0, 0.0, 0.0))),
        Flight(od.Aerial3D("unknown"), ALOFT, (*SPIN, *AIRSPEED), (0.7,), flying(ALOFT, SPIN, AIRSPEED, (0.0, 0.0, 0.7))),
        Flight(
            od.Aerial3D("constant", (0.0, 3.0, 4.0)),
            (*ALOFT, 0.7),
            (*SPIN, *AIRSPEED),
            (),
            flying((*ALOFT, 0.7), SPIN, AIRSPEED, (0.0, 2.1, 2.8)),
        ),
        Flight(od.Aerial3D("unknown", None), ALOFT, (*SPIN, *AIRSPEED), SLIPS_3D, flying(ALOFT, SPIN, AIRSPEED, SLIPS_3D)),
        Flight(
            od.Aerial3D("constant", None),
            (*ALOFT, *SLIPS_3D),
            (*SPIN, *AIRSPEED),
            (),
            flying((*ALOFT, *SLIPS_3D), SPIN, AIRSPEED, SLIPS_3D),
        ),
    ],
    "inertial_visual": [
        Flight(od.InertialVisual(9.81), MOVING, (*SPIN, *FORCE), (), feeling(MOVING, SPIN, FORCE, 9.81)),
        Flight(od.InertialVisual(None), (*MOVING, 9.7), (*SPIN, *FORCE), (), feeling((*MOVING, 9.7), SPIN, FORCE, 9.7)),
        Flight(
            od.InertialVisual(9.81, biases=True),
            (*MOVING, *BIASES),
            (*BIASED_SPIN, *BIASED_FORCE),
            (),
            feeling((*MOVING, *BIASES), SPIN, FORCE, 9.81),
        ),
    ],
    "polar_unicycle": [
        Flight(od.PolarUnicycle(), POLAR, (2.0, 0.5), (), in_polar_coordinates(on_a_circle(2.0, 0.5, AROUND, (0.0, 0.0)))),
    ],
    "target_motion": [
        Flight(od.TargetMotion(), PASSING, (0.3, -0.2), (), pushed(PASSING, -(0.3 - 0.2j)), is_polynomial=True),
        Flight(od.TargetMotion("unknown acceleration"), PASSING, (0.3, -0.2), (0.1, 0.4), pushed(PASSING, -0.2 + 0.6j), is_polynomial=True),
    ],
    "two_robots": [
        Flight(
            od.TwoRobots("known"),
            (*AT_REST, *PEER),
            (2.0, 0.5, -1.0, 0.4),
            (),
            side_by_side(on_a_circle(2.0, 0.5, AT_REST, (0.0, 0.0)), on_a_circle(-1.0, 0.4, PEER, (0.0, 0.0))),
        ),
        Flight(
            od.TwoRobots(),
            (*AT_REST, *PEER),
            (2.0, 0.5),
            (-1.0, 0.4),
            side_by_side(on_a_circle(2.0, 0.5, AT_REST, (0.0, 0.0)), on_a_circle(-1.0, 0.4, PEER, (0.0, 0.0))),
        ),
    ],
    "dubins": [
        Flight(od.Dubins(8.0), AT_REST, (0.5,), (), on_a_circle(8.0, 0.5, AT_REST, (0.0, 0.0))),
        Flight(od.Dubins(8.0, wind="constant"), IN_WIND, (0.5,), (), on_a_circle(8.0, 0.5, IN_WIND, WIND)),
        Flight(od.Dubins(8.0, wind="unknown"), AT_REST, (-0.5,), WIND, on_a_circle(8.0, -0.5, AT_REST, WIND)),
    ],
    "omnidirectional": [
        Flight(Omnidirectional(), AT_REST, (5.0, -3.0, 0.5), (), slipping(AT_REST, 5.0, -3.0, 0.5)),
        Flight(Omnidirectional("constant"), (*AT_REST, *SLIPS), (5.0, -3.0, 0.4), (), slipping((*AT_REST, *SLIPS), 5.7, -5.0, 0.5)),
        Flight(Omnidirectional("unknown"), AT_REST, (-4.0, 3.0, -0.6), SLIPS, slipping(AT_REST, -3.3, 1.0, -0.5)),
    ],
    "second_order_unicycle": [
        Flight(od.SecondOrderUnicycle(), ROLLING, (0.5, 0.5), (), speeding_up(ROLLING, 0.5, 0.5, (0.0, 0.0))),
        Flight(
            od.SecondOrderUnicycle(wind="constant"), (*ROLLING, *WIND), (-1.0, 0.5), (), speeding_up((*ROLLING, *WIND), -1.0, 0.5, WIND)
        ),
        Flight(od.SecondOrderUnicycle(wind="unknown"), ROLLING, (0.5, -0.5), WIND, speeding_up(ROLLING, 0.5, -0.5, WIND)),
    ],
    "submersible": [
        Flight(od.Submersible(), SUNK, (6.0, 0.5, -0.3), (), diving(SUNK, 6.0, 0.5, -0.3, (0.0, 0.0))),
        Flight(od.Submersible(wind="constant"), (*SUNK, *WIND), (6.0, 0.5, 0.2), (), diving((*SUNK, *WIND), 6.0, 0.5, 0.2, WIND)),
        Flight(od.Submersible(wind="unknown"), SUNK, (6.0, 0.5, 0.2), WIND, diving(SUNK, 6.0, 0.5, 0.2, WIND)),
    ],
    "unicycle": [
        Flight(od.Unicycle(), AT_REST, (6.0, 0.5), (), on_a_circle(6.0, 0.5, AT_REST, (0.0, 0.0))),
        Flight(od.Unicycle(wind="constant"), IN_WIND, (-6.0, 0.5), (), on_a_circle(-6.0, 0.5, IN_WIND, WIND)),
        Flight(od.Unicycle(wind="unknown"), AT_REST, (6.0, 0.5), WIND, on_a_circle(6.0, 0.5, AT_REST, WIND)),
    ],
}


@dataclasses.dataclass(frozen=True)
class Reading:
    """A sensor, states to read it at, its outputs by hand, and where it must say that its landmark is."""

    sensor: AbstractSensor
    by_hand: Callable[[Mapping[str, float]], tuple[float, ...]]
    landmarks: tuple[tuple[float, float], ...] = ()
    vehicle: AbstractVehicle = dataclasses.field(default_factory=od.Unicycle)
    is_singular: bool = True
    u: tuple[float, ...] = ()
    states: tuple[Mapping[str, float], ...] = tuple(
        {"x": x, "y": y, "heading": heading} for x, y, heading in ((3.0, -1.0, 0.4), (90.0, 20.0, -2.5), (-5.0, -80.0, 7.0))
    )


def angle_to_beacon(state: Mapping[str, float]) -> tuple[float]:
    return (math.atan2(BEACON[1] - state["y"], BEACON[0] - state["x"]) - state["heading"],)


def from_the_mast(state: Mapping[str, float]) -> tuple[float, float]:
    """East and north of a beacon seen from a mast 1.5 m ahead and 0.5 m to the right, by complex numbers."""
    mast = complex(state["x"], state["y"]) + complex(1.5, -0.5) * cmath.exp(1j * state["heading"])
    return (complex(*BEACON) - mast).real, (complex(*BEACON) - mast).imag


def angle_from_the_mast(state: Mapping[str, float]) -> tuple[float]:
    east, north = from_the_mast(state)
    return (math.atan2(north, east) - state["heading"] - 0.7,)


def distance_from_the_mast(state: Mapping[str, float]) -> tuple[float]:
    return (math.hypot(*from_the_mast(state), 6.0),)


def ground_velocity(state: Mapping[str, float]) -> complex:
    """Of an airspeed of 8 m/s."""
    return 8.0 * cmath.exp(1j * state["heading"]) + complex(state["wind_x"], state["wind_y"])


def through_water(state: Mapping[str, float]) -> complex:
    return state["speed"] * cmath.exp(1j * state["heading"])


def receding(state: Mapping[str, float], height: float = 0.0) -> tuple[float]:
    """Derivative of the distance to the beacon along a straight line."""
    velocity = through_water(state) + complex(state["wind_x"], state["wind_y"])
    sight = complex(state["x"], state["y"]) - complex(*BEACON)
    return ((sight.conjugate() * velocity).real / math.hypot(abs(sight), height),)


def by_the_body(state: Mapping[str, float], turned: float) -> tuple[float, float]:
    seen = ground_velocity(state) * cmath.exp(-1j * (state["heading"] + turned))
    return seen.real, seen.imag


ON_MAST: Any = {"lever_arm": (1.5, -0.5)}
GLIDER = od.Dubins(8.0, wind="constant")
GLIDES = tuple(
    {"x": 3.0, "y": -1.0, "heading": heading, "wind_x": east, "wind_y": north}
    for heading, east, north in ((0.4, 3.0, -1.0), (-2.5, 0.0, 5.0), (7.0, -2.0, 2.0))
)
REFERENCE = (-30.0, 60.0)
SURGING = tuple({**state, "speed": speed} for state, speed in zip(GLIDES, (6.0, -2.0, 0.5), strict=True))
SURGES = tuple({name: state[name] for name in ("x", "y", "heading", "speed", "wind_x", "wind_y")} for state in SURGING)
DIVES = tuple(
    {"x": x, "y": y, "heading": heading, "depth": depth} for x, y, heading, depth in ((3.0, -1.0, 0.4, 5.0), (90.0, 20.0, -2.5, 30.0))
)
DYNAMIC: Any = {"vehicle": od.SecondOrderUnicycle(wind="constant"), "states": SURGES}
INERTIAL = tuple(
    {"x": x, "y": y, "z": z, **dict(zip(("q_t", "q_x", "q_y", "q_z"), q, strict=True))}
    for x, y, z, q in ((3.0, -1.0, 12.0, TILTED), (4.0, 3.0, -20.0, (0.96, 0.0, 0.28, 0.0)), (-3.0, -2.0, 12.0, (0.96, 0.28, 0.0, 0.0)))
)
PAIRS = tuple(
    {"x": x, "y": y, "heading": heading, "peer_x": -30.0, "peer_y": y + 40.0, "peer_heading": 1.0}
    for x, y, heading in ((3.0, -1.0, 0.4), (90.0, 20.0, -2.5))
)


def in_the_picture(state: Mapping[str, float], feature: tuple[float, float, float]) -> tuple[float, float]:
    """By the matrix of the attitude, whose columns are the vehicle's axes."""
    _, R = attitude(tuple(state[name] for name in ("q_t", "q_x", "q_y", "q_z")), (1.0, 0.0, 0.0), 0.0)
    seen = R.T @ (np.array([state["x"], state["y"], state["z"]]) - feature)
    return seen[0] / seen[2], seen[1] / seen[2]


def to_the_peer(state: Mapping[str, float]) -> complex:
    return complex(state["peer_x"] - state["x"], state["peer_y"] - state["y"])


TWO: Any = {"vehicle": od.TwoRobots(), "states": PAIRS}
SURGES_IN_AIR: Any = {"vehicle": od.SecondOrderUnicycle(wind="constant"), "states": SURGES, "u": (0.5, 0.3)}
SENSORS = {
    "accelerometer": [Reading(od.Accelerometer(0.1), lambda state: (0.5, 0.3 * state["speed"]), **SURGES_IN_AIR)],
    "camera": [
        Reading(od.Camera(0.02), lambda state: in_the_picture(state, (0.0, 0.0, 0.0)), vehicle=od.Aerial3D(), states=INERTIAL),
        Reading(
            od.Camera(0.02, feature=(1.0, -2.0, 3.0)),
            lambda state: in_the_picture(state, (1.0, -2.0, 3.0)),
            vehicle=od.Aerial3D(),
            states=INERTIAL[:2],
        ),
    ],
    "global_bearing": [
        Reading(od.GlobalBearing(BEACON, 0.1), lambda state: (math.atan2(BEACON[1] - state["y"], BEACON[0] - state["x"]),), (BEACON,)),
    ],
    "gyroscope": [Reading(od.Gyroscope(0.01), lambda state: (0.3,), **SURGES_IN_AIR)],
    "peer_bearing": [Reading(od.PeerBearing(0.1), lambda state: (cmath.phase(to_the_peer(state)) - state["heading"],), **TWO)],
    "peer_range": [Reading(od.PeerRange(1.0), lambda state: (abs(to_the_peer(state)),), **TWO)],
    "quaternion_norm": [
        Reading(
            od.QuaternionNorm(0.01),
            lambda state: (sum(state[name] ** 2 for name in ("q_t", "q_x", "q_y", "q_z")),),
            vehicle=od.Aerial3D(),
            states=INERTIAL,
        ),
    ],
    "relative_bearing": [
        Reading(
            od.RelativeBearing(0.1, beacons=(BEACON, REFERENCE)),
            lambda state: tuple(
                math.atan2(north - state["y"], east - state["x"]) - state["heading"] for east, north in (BEACON, REFERENCE)
            ),
            (BEACON, REFERENCE),
        ),
    ],
    "airspeed": [Reading(od.Airspeed(0.5), lambda state: (abs(state["speed"]),), **DYNAMIC)],
    "bearing": [
        Reading(od.Bearing(BEACON, 0.1), angle_to_beacon, (BEACON,)),
        Reading(od.Bearing(BEACON, 0.1, mounting_angle=0.7, **ON_MAST), angle_from_the_mast, (BEACON,), is_singular=False),
    ],
    "course": [Reading(od.Course(0.1), lambda state: (cmath.phase(ground_velocity(state)),), vehicle=GLIDER, states=GLIDES)],
    "depth": [Reading(od.Depth(0.1), lambda state: (state["depth"],), vehicle=od.Submersible(), states=DIVES)],
    "doppler": [
        Reading(od.Doppler(BEACON, 0.1), receding, (BEACON,), **DYNAMIC),
        Reading(od.Doppler(BEACON, 0.1, height=7.0), lambda state: receding(state, 7.0), (BEACON,), is_singular=False, **DYNAMIC),
    ],
    "gps": [Reading(od.GPS(2.0), lambda state: (state["x"], state["y"]))],
    "magnetometer": [Reading(od.Magnetometer(0.2), lambda state: (state["heading"],))],
    "range": [
        Reading(od.Range(BEACON, 1.0), lambda state: (math.hypot(state["x"] - BEACON[0], state["y"] - BEACON[1]),), (BEACON,)),
        Reading(od.Range(BEACON, 1.0, height=-6.0, **ON_MAST), distance_from_the_mast, (BEACON,), is_singular=False),
    ],
    "range_bearing": [
        Reading(
            od.RangeBearing(BEACON, 1.0, bearing_sigma=0.05),
            lambda state: (math.hypot(state["x"] - BEACON[0], state["y"] - BEACON[1]), *angle_to_beacon(state)),
            (BEACON,),
        ),
        Reading(
            od.RangeBearing(BEACON, 1.0, bearing_sigma=0.05, mounting_angle=0.7, height=6.0, **ON_MAST),
            lambda state: (*distance_from_the_mast(state), *angle_from_the_mast(state)),
            (BEACON,),
            is_singular=False,
        ),
    ],
    "speed_over_ground": [Reading(od.SpeedOverGround(0.2), lambda state: (abs(ground_velocity(state)),), vehicle=GLIDER, states=GLIDES)],
    "time_difference": [
        Reading(
            od.TimeDifference(BEACON, 0.3, reference=REFERENCE),
            lambda state: (math.dist((state["x"], state["y"]), BEACON) - math.dist((state["x"], state["y"]), REFERENCE),),
            (BEACON, REFERENCE),
        ),
        Reading(
            od.TimeDifference(BEACON, 0.3, reference=REFERENCE, height=-2.0, reference_height=3.0),
            lambda state: (
                math.dist((state["x"], state["y"], -state["depth"]), (*BEACON, -2.0))
                - math.dist((state["x"], state["y"], -state["depth"]), (*REFERENCE, 3.0)),
            ),
            (BEACON, REFERENCE),
            od.Submersible(),
            is_singular=False,
            states=DIVES,
        ),
    ],
    "velocity_log": [
        Reading(od.VelocityLog(0.1), lambda state: by_the_body(state, 0.0), vehicle=GLIDER, states=GLIDES),
        Reading(od.VelocityLog(0.1, mounting_angle=0.3), lambda state: by_the_body(state, 0.3), vehicle=GLIDER, states=GLIDES),
    ],
}

LOW, HIGH = np.array([-0.5, 2.0]), np.array([0.5, 9.0])


def grid_of(steps: int, names: tuple[str, str] = ("turn_rate", "speed")) -> Grid:
    return Grid(names, tuple(LOW), tuple(HIGH), steps, 0.5)


# (path, a grid that suits it, one that does not with what is said about that)
PATHS: dict[str, list[tuple[AbstractPath, Grid, tuple[Grid, str] | None]]] = {
    "b_spline": [
        (BSpline(4), grid_of(12), (grid_of(3), "points is 4: must be at most the number of steps, 3")),
        (BSpline(5, degree=2), grid_of(5), None),
        (BSpline(2, degree=1), grid_of(7), None),
    ],
    "dubins_path": [
        (DubinsPath("LSR", 0.5), grid_of(20), (grid_of(20, ("bank", "speed")), "needs an input 'turn_rate' \\(inputs: bank, speed\\)")),
        (DubinsPath("RL", 2.0), grid_of(9), None),
        (DubinsPath("S", 1.0), grid_of(3), None),
    ],
    "piecewise_constant": [
        (od.PiecewiseConstant(1), grid_of(7), None),
        (od.PiecewiseConstant(4), grid_of(10), (grid_of(3), "pieces is 4: must be at most the number of steps, 3")),
        (od.PiecewiseConstant(5), grid_of(5), None),
    ],
}


Instant = tuple[float, ...]  # x, y, heading, rates of x and y; zeros at its end left out


@dataclasses.dataclass(frozen=True)
class Region:
    """A constraint with instants at which it holds, at which it is violated, and on its edge."""

    constraint: AbstractConstraint
    inside: tuple[Instant, ...]
    outside: tuple[Instant, ...]
    edge: tuple[Instant, ...]
    landmarks: tuple[tuple[float, float], ...] = ()


POSTS = ((10.0, 0.0), (-10.0, 5.0))
ROUND = ((2.0, 0.0), (-2.0, 0.0), (0.0, -2.0))  # on the circle of radius 2 about the origin
SQUARE = ((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0))
WITHIN = ((5.0, 5.0), (9.9, 0.1)), ((-0.1, 5.0), (5.0, 40.0)), ((10.0, 3.0), (0.0, 0.0), (4.0, 10.0))
IN_DISC = ((3.0, 4.0), (4.9, 4.0)), ((5.1, 4.0), (0.0, 0.0)), ((3.0, 6.0), (1.0, 4.0))
OUT_OF_DISC = (IN_DISC[1], IN_DISC[0], IN_DISC[2])
# beside the middle of an edge a smooth maximum widens the square by 0.02 size log 4, its size being 5
WIDER = 0.1 * math.log(4.0)
ALONG = (
    ((0.0, 0.0, 0.0), (0.0, 0.0, 2 * math.pi - 0.49)),
    ((0.0, 0.0, 0.51), (0.0, 0.0, 3.0)),
    ((0.0, 0.0, 0.5), (0.0, 0.0, -0.5 - 2 * math.pi)),
)
CONSTRAINTS = {
    "circle_clearance": [
        Region(
            CircleClearance(0.5, 2.0, ROUND),
            ((2.6, 0.0), (0.0, 1.4), (0.0, 0.0), (2.0, 0.0, 0.0, 0.3, -9.0), (0.0, 2.0, 0.0, 9.0, -0.3), (2.4, 0.0, 0.0, 0.2, 0.0)),
            ((2.4, 0.0), (-2.0, 0.0), (0.0, 2.0, 0.0, -9.0, 0.0), (2.0, 0.0, 0.0, 0.2, 9.0)),
            ((2.0, 0.0, 0.0, 0.25, 9.0), (0.0, -2.0, 0.0, 0.0, 0.25)),
            POSTS,
        ),
        Region(CircleClearance(0.5, 2.0), ((2.6, 0.0),), ((2.4, 0.0),), ((0.0, 2.0, 0.0, 0.0, -0.25),), ROUND),
    ],
    "goal": [Region(od.Goal((3.0, 4.0), 2.0), *IN_DISC)],
    "goal_pose": [
        Region(
            GoalPose((3.0, 4.0), 3.0, 2.0, 0.5),
            ((3.0, 4.0, 3.0), (4.9, 4.0, 3.4), (4.0, 4.0, -3.0)),
            ((5.1, 4.0, 3.0), (3.0, 4.0, 2.4), (3.0, 4.0, -2.7), (0.0, 0.0)),
            ((3.0, 6.0, 3.1), (3.0, 4.0, 2.5), (3.0, 4.0, 3.5 - 2 * math.pi), (1.0, 4.0, 3.5)),
        )
    ],
    "goal_region": [Region(GoalRegion(SQUARE), *WITHIN)],
    "ground_speed": [
        Region(
            GroundSpeed(2.0, 10.0),
            ((0.0, 0.0, 0.0, 3.0, 4.0), (9.0, 9.0, 1.0, -2.1, 0.0)),
            ((0.0,), (0.0, 0.0, 0.0, 1.9, 0.0), (0.0, 0.0, 0.0, 8.0, -9.0)),
            ((0.0, 0.0, 0.0, 2.0, 0.0), (0.0, 0.0, 0.0, -6.0, 8.0)),
        ),
        Region(GroundSpeed(least=5.0), ((0.0, 0.0, 0.0, 9.0),), ((0.0,),), ((0.0, 0.0, 0.0, 3.0, 4.0),)),
        Region(GroundSpeed(most=5.0), ((0.0,),), ((0.0, 0.0, 0.0, 9.0),), ((0.0, 0.0, 0.0, 3.0, 4.0),)),
    ],
    "heading_sector": [
        Region(HeadingSector(-0.5, 0.5), *ALONG),
        Region(HeadingSector(2 * math.pi - 0.5, 0.5, 3.0, 8.0), *ALONG),
        Region(HeadingSector(0.5, -0.5), ALONG[1], ALONG[0], ALONG[2]),
    ],
    "keep_in": [Region(KeepIn(SQUARE), *WITHIN)],
    "keep_out": [Region(od.KeepOut((3.0, 4.0), 2.0), *OUT_OF_DISC)],
    "keep_out_polygon": [
        Region(
            KeepOutPolygon(SQUARE),
            ((-0.2, 5.0), (40.0, 40.0), (4.0, 10.2)),
            ((5.0, 5.0), (9.9, 0.1), (10.0, 10.0), (5.0, 0.0)),
            ((-WIDER, 5.0), (4.0, 10.0 + WIDER)),
        )
    ],
    "loiter": [Region(Loiter((3.0, 4.0), 2.0, 5.0, 9.0), *IN_DISC), Region(Loiter((3.0, 4.0), 2.0, 5.0), *IN_DISC)],
    "max_range": [
        Region(MaxRange(12.0), ((0.0, 0.0), (0.0, 5.0)), ((-3.0, 0.0), (40.0, 3.0)), ((-2.0, 0.0), (2.0, 5.0)), POSTS),
        Region(MaxRange(2.0, ((3.0, 4.0),)), *IN_DISC, POSTS),
    ],
    "stand_off": [
        Region(od.StandOff(3.0), ((0.0, 0.0), (13.1, 0.0)), ((10.0, 2.9), (-10.0, 5.0)), ((10.0, 3.0), (-13.0, 5.0)), POSTS),
        Region(od.StandOff(2.0, ((3.0, 4.0),)), *OUT_OF_DISC, POSTS),
    ],
    "via": [Region(Via((3.0, 4.0), 2.0), *IN_DISC), Region(Via((3.0, 4.0), 2.0, 5.0, 9.0), *IN_DISC)],
}
LENGTHS = {"point", "centre", "corners", "landmarks", "tolerance", "radius", "distance", "clearance", "least", "most"}
REAL = {"heading", "low", "high", "first", "last"}  # numbers that may be 0; first and last may not be negative


@dataclasses.dataclass(frozen=True)
class Account:
    """A cost, its unit, and what it costs by hand per second with rates (x, y) and inputs of these names."""

    cost: AbstractCost
    unit: str
    by_hand: Callable[[float, float, float, float], float]


COSTS = {
    "effort": [
        Account(Effort({"speed": 0.5}), "", lambda _, __, speed, ___: 0.5 * speed**2),
        Account(Effort((("turn_rate", 3.0), ("speed", 0.5))), "", lambda _, __, speed, turn_rate: 0.5 * speed**2 + 3 * turn_rate**2),
    ],
    "flight_time": [Account(FlightTime(), "s", lambda *_: 1.0)],
    "path_length": [Account(PathLength(), "m", lambda east, north, *_: math.hypot(east, north))],
}


@dataclasses.dataclass(frozen=True)
class Measure:
    """A criterion, what it is as a function of the eigenvalues, and what it is where one of them is 0."""

    criterion: AbstractCriterion
    of_eigenvalues: Callable[[np.ndarray], float]
    singular: float


CRITERIA = {
    "log_det": [Measure(od.LogDet(), lambda values: float(np.log(values).sum()), -np.inf)],
    "min_eigenvalue": [Measure(od.MinEigenvalue(), lambda values: float(values.min()), 0.0)],
    "posterior": [
        Measure(od.Posterior(od.Prior(np.zeros(2), std=(1.0, 2.0))), lambda values: float(values.min()), 0.0),
        Measure(od.Posterior(od.Prior([1.0], std=[1.0]), (0.1,), ("w",), od.LogDet()), lambda values: float(np.log(values).sum()), -np.inf),
    ],
    "trace_inverse": [Measure(od.TraceInverse(), lambda values: -float((1 / values).sum()), -np.inf)],
}

FAMILIES: dict[str, tuple[ModuleType, type, Mapping[str, list[Any]], Callable[[Any], object]]] = {
    "VEHICLES": (vehicles, AbstractVehicle, VEHICLES, lambda example: example.vehicle),
    "SENSORS": (sensors, AbstractSensor, SENSORS, lambda example: example.sensor),
    "PATHS": (paths, AbstractPath, PATHS, lambda example: example[0]),
    "CONSTRAINTS": (constraints, AbstractConstraint, CONSTRAINTS, lambda example: example.constraint),
    "COSTS": (costs, AbstractCost, COSTS, lambda example: example.cost),
    "CRITERIA": (criteria, AbstractCriterion, CRITERIA, lambda example: example.criterion),
}
MEMBERS = [(table, kind) for table, (package, *_) in FAMILIES.items() for kind in kinds(package)]


def examples(table: str, kind: str) -> list[Any]:
    """The examples of a kind; a failure that says where to add one where there is none."""
    package, _, known, _ = FAMILIES[table]
    found = known.get(kind, [])
    if not found:
        pytest.fail(f"{package.__name__}.{kind} has no example: add one to {table} in tests/test_families.py")
    return found


def each(table: str) -> pytest.MarkDecorator:
    """Run a test for every kind of the family."""
    return pytest.mark.parametrize("kind", kinds(FAMILIES[table][0]))


# ---------------------------------------------------------------- every member of every family


@pytest.mark.parametrize(("table", "kind"), MEMBERS)
def test_a_kind_is_one_final_frozen_class_with_an_example(table: str, kind: str):
    package, abstract, _, instance = FAMILIES[table]
    cls = leaf(package, kind)
    bases = cls.__mro__[1 : cls.__mro__.index(abstract)]
    assert len(cls.__bases__) == 1
    assert all(issubclass(base, abstract) and base.__name__.startswith("Abstract") for base in bases), "a leaf derives from abstract bases"
    assert not cls.__subclasses__(), "leaves are final"
    assert not getattr(cls, "__abstractmethods__", None)
    for base in (*bases, abstract):
        implemented = {name for name, member in vars(base).items() if callable(member) and not name.startswith("__")}
        assert not (implemented - base.__abstractmethods__) & set(vars(cls)), "nothing implemented is overridden"
    assert dataclasses.is_dataclass(cls)
    assert cls.__dataclass_params__.frozen
    assert cls.__doc__
    for example in examples(table, kind):
        assert type(instance(example)) is cls


@pytest.mark.parametrize(("table", "kind"), MEMBERS)
def test_a_member_is_a_value(table: str, kind: str):
    """It cannot be changed, equals its copy, may be a key, and travels between processes."""
    for example in examples(table, kind):
        member = FAMILIES[table][3](example)
        copy = pickle.loads(pickle.dumps(member))
        assert copy == member
        assert hash(copy) == hash(member)
        for field in dataclasses.fields(member):
            with pytest.raises(dataclasses.FrozenInstanceError):
                setattr(member, field.name, None)
            assert dataclasses.replace(member, **{field.name: getattr(member, field.name)}) == member


@pytest.mark.parametrize("table", FAMILIES)
def test_every_example_belongs_to_a_kind(table: str):
    package, _, known, _ = FAMILIES[table]
    assert set(known) <= set(kinds(package)), "an example of a file that does not exist is never run"


@pytest.mark.parametrize("values", [[500.0, 200.0], np.array([500.0, 200.0])], ids=["list", "array"])
def test_a_point_may_be_given_as_a_list_or_an_array(values: object):
    """The members stay hashable: they are keys of the compiled functions."""
    made = (od.Range(values, 1.0), od.Bearing(values, 0.1), od.Goal(values, 1.0), od.KeepOut(values, 1.0))
    meant = (od.Range((500.0, 200.0), 1.0), od.Bearing((500.0, 200.0), 0.1), od.Goal((500.0, 200.0), 1.0), od.KeepOut((500.0, 200.0), 1.0))
    assert [hash(member) for member in made] == [hash(member) for member in meant]
    assert made == meant


@pytest.mark.parametrize("values", [(1.0,), (1.0, 2.0, 3.0), (np.nan, 0.0), (0.0, np.inf)])
@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda point: od.Range(point, 1.0), "range: beacon"),
        (lambda point: od.Bearing(point, 0.1), "bearing: beacon"),
        (lambda point: od.Goal(point, 1.0), "goal: point"),
        (lambda point: od.KeepOut(point, 1.0), "keep_out: centre"),
    ],
    ids=["range", "bearing", "goal", "keep_out"],
)
def test_a_point_has_two_finite_coordinates(make: Callable[[object], object], name: str, values: tuple[float, ...]):
    with pytest.raises(od.InputError, match=rf"^{name}.*{values[0]}"):
        make(values)


# ---------------------------------------------------------------- vehicles


@each("VEHICLES")
def test_the_fields_of_a_vehicle_are_columns_of_its_state_one_per_signal(kind: str):
    for flight in examples("VEHICLES", kind):
        vehicle, n = flight.vehicle, len(flight.vehicle.states)
        x = ca.SX.sym("x", n)
        fields = vehicle.fields(x)
        assert (len(fields.inputs), len(fields.disturbances)) == (len(vehicle.inputs), len(vehicle.disturbances))
        for field in (fields.drift, *fields.inputs, *fields.disturbances):
            assert field.shape == (n, 1)
            assert all(ca.depends_on(symbol, x) for symbol in ca.symvar(field))
        names = [signal.name for signal in (*vehicle.states, *vehicle.inputs, *vehicle.disturbances)]
        assert len(set(names)) == len(names)


@each("VEHICLES")
def test_a_vehicle_moves_as_integrated_by_hand_and_rk4_has_order_4(kind: str):
    for flight in examples("VEHICLES", kind):
        system, duration = od.System(flight.vehicle), 4.0
        exact = flight.state_at(duration)
        errors = []
        for steps in (8, 16, 32):
            u, w = (np.tile(values, (steps, 1)).reshape(steps, len(values)) for values in (flight.u, flight.w))
            path = od.simulate(system, flight.start, u, duration / steps, w, tolerance=0.5)  # one Runge-Kutta step for each
            errors.append(np.abs(path.x[-1] - exact).max())
        if flight.is_polynomial:  # of degree 4 at most: no step errs but by rounding
            assert max(errors) <= 32 * np.finfo(float).eps * np.abs(exact).max()
        else:
            np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 4.0, atol=0.1)
        assert errors[-1] < 1e-5


@each("VEHICLES")
def test_the_fields_of_a_vehicle_are_the_rate_of_the_motion_by_hand(kind: str):
    """Drift, inputs and disturbances add up to the derivative at t = 0, and each column stands for its own input."""
    for flight in examples("VEHICLES", kind):
        vehicle, eps = flight.vehicle, 1e-4
        x = ca.SX.sym("x", len(flight.start))
        fields = vehicle.fields(x)
        weights = (1.0, *flight.u, *flight.w)
        rate = sum(weight * field for weight, field in zip(weights, (fields.drift, *fields.inputs, *fields.disturbances), strict=True))
        found = ca.Function("rate", [x], [rate])(flight.start).full().ravel()
        # central difference of the motion: eps^2 / 6 times a third derivative below 8 * 0.5^2
        np.testing.assert_allclose(found, (flight.state_at(eps) - flight.state_at(-eps)) / (2 * eps), atol=1e-7)


@pytest.mark.parametrize("speed", [0.0, -1.0, np.nan, np.inf])
def test_dubins_needs_a_speed(speed: float):
    with pytest.raises(od.InputError, match=rf"speed is {speed!r}: must be a finite number above 0"):
        od.Dubins(speed)


@pytest.mark.parametrize("vehicle", [od.Unicycle, lambda wind: od.Dubins(1.0, wind=wind)], ids=["unicycle", "dubins"])
def test_wind_is_none_constant_or_unknown(vehicle: Callable[..., object]):
    with pytest.raises(od.InputError, match=r"wind is 'gusty': must be None, 'constant' .* or 'unknown'"):
        vehicle(wind="gusty")


def test_slips_are_none_constant_or_unknown():
    with pytest.raises(od.InputError, match=r"disturbance is 'wind': must be None, 'constant' .*turn_slip\) or 'unknown'"):
        Omnidirectional("wind")


# ---------------------------------------------------------------- sensors


def measured(reading: Reading, state: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray]:
    """Outputs (q,) and their derivatives (q, states) as CasADi has them."""
    model = od.System(reading.vehicle, (reading.sensor,)).model
    assert model.state_names == tuple(state)
    u = reading.u or (0.0,) * len(model.inputs)
    y, C = ca.Function("h", [model.x, model.u], [model.h, ca.jacobian(model.h, model.x)])(list(state.values()), u)
    return y.full().ravel(), C.full()


@each("SENSORS")
def test_a_sensor_reads_what_the_formula_says_as_many_outputs_as_it_names(kind: str):
    for reading in examples("SENSORS", kind):
        for state in reading.states:
            y, _ = measured(reading, state)
            assert len(y) == len(reading.sensor.outputs)
            difference = y - reading.by_hand(state)
            is_angle = np.array([signal.is_angle for signal in reading.sensor.outputs])
            turns = np.where(is_angle, np.round(difference / (2 * np.pi)), 0.0)
            np.testing.assert_allclose(difference, turns * 2 * np.pi, atol=1e-12)


@each("SENSORS")
def test_the_derivatives_of_a_sensor_are_its_central_differences(kind: str):
    for reading in examples("SENSORS", kind):
        for state in reading.states:
            _, C = measured(reading, state)
            for column, name in enumerate(state):
                eps = 1e-4
                plus, minus = (np.array(reading.by_hand({**state, name: state[name] + side * eps})) for side in (1, -1))
                # third derivatives are below 1 at ten metres and more: eps^2 / 6; rounding 1e-14 / eps
                np.testing.assert_allclose(C[:, column], (plus - minus) / (2 * eps), atol=1e-8)


@each("SENSORS")
def test_the_landmark_of_a_sensor_is_where_its_outputs_have_no_derivative(kind: str):
    for reading in examples("SENSORS", kind):
        assert reading.sensor.landmarks == reading.landmarks
        for x, y in reading.landmarks if reading.is_singular else ():
            _, C = measured(reading, {**reading.states[0], "x": x, "y": y})
            assert not np.isfinite(C).all()


@pytest.mark.parametrize("field", ["sigma", "rate"])
@pytest.mark.parametrize("value", [0.0, -0.5, np.nan, np.inf, "2"])
@each("SENSORS")
def test_a_sensor_refuses_a_bad_sigma_and_a_bad_rate_by_name_and_value(kind: str, value: object, field: str):
    for reading in examples("SENSORS", kind):
        with pytest.raises(od.InputError, match=rf"^{reading.sensor.name}: {field} is {value!r}: must be a finite number above 0$"):
            dataclasses.replace(reading.sensor, **{field: value})


@pytest.mark.parametrize("value", [np.float64(2.0), np.float32(2.0), np.int64(2), 2], ids=lambda value: type(value).__name__)
@each("SENSORS")
def test_a_sensor_accepts_any_real_number(kind: str, value: float):
    for reading in examples("SENSORS", kind):
        assert dataclasses.replace(reading.sensor, sigma=value, rate=value).sigma == 2.0


@each("SENSORS")
def test_a_sensor_brings_its_name_noise_rate_and_landmark_into_a_system(kind: str):
    """And a second one of the same name is told apart."""
    for reading in examples("SENSORS", kind):
        sensor = dataclasses.replace(reading.sensor, rate=2.0)
        model = od.System(reading.vehicle, (sensor, sensor)).model
        assert model.sensor_names == (sensor.name, f"{sensor.name}_2")
        assert len({signal.name for signal in model.outputs}) == 2 * len(sensor.outputs)
        for channel in model.channels:
            variance = np.array(ca.DM(channel.noise.variance)).ravel()
            assert variance[0] == pytest.approx(sensor.sigma**2, rel=1e-14)
            assert len(variance) in {1, len(sensor.outputs)}
            assert float(channel.noise.gate) == 1.0
            assert (channel.rate, channel.landmarks) == (2.0, sensor.landmarks)
            assert channel.h.shape == (len(sensor.outputs), 1)


@each("SENSORS")
def test_the_errors_of_a_sensor_reach_the_model_with_a_spread_above_0_and_a_share_of_samples_from_0_to_1(kind: str):
    for reading in examples("SENSORS", kind):
        sensor = dataclasses.replace(reading.sensor, inflation=1.5, bias_floor=0.3, correlation=0.5)
        model = od.System(reading.vehicle, (sensor,)).model
        noise = model.channels[0].noise
        values = ca.Function("noise", [model.x], [noise.spread, noise.gate, noise.variance])
        for state in reading.states:
            spread, gate, variance = (value.full().ravel() for value in values([state[name] for name in model.state_names]))
            assert (spread > 0).all()
            assert 0 < gate[0] <= 1
            np.testing.assert_allclose(variance, 1.5**2 * spread**2 + 0.3**2, rtol=1e-12)  # of one sample alone: no other, no correlation
            assert (noise.correlation, noise.bias) == (0.5, 0.3)


@each("SENSORS")
def test_an_output_of_any_sensor_may_be_scaled_and_off_by_states_of_its_own(kind: str):
    for reading in examples("SENSORS", kind):
        sensor, n = reading.sensor, len(reading.states[0])
        is_angle = np.array([signal.is_angle for signal in sensor.outputs])
        both = dataclasses.replace(sensor, bias="off", scale=None if is_angle.all() else "times")
        model = od.System(reading.vehicle, (both,)).model
        plain = od.System(reading.vehicle, (sensor,)).model
        u = reading.u or (0.0,) * len(model.inputs)
        found, h = (ca.Function("h", [m.x, m.u], [m.h, ca.jacobian(m.h, m.x), m.drift]) for m in (model, plain))
        offsets = np.arange(1.0, len(is_angle) + 1) / 8
        for state in reading.states:
            at = np.array(list(state.values()))
            extra = offsets if is_angle.all() else np.concatenate([[1.25], offsets])
            y, J, drift = (value.full() for value in found([*at, *extra], u))
            plain_y, plain_J, _ = (value.full() for value in h(at, u))
            factor = np.where(is_angle, 1.0, 1.25)
            np.testing.assert_allclose(y.ravel(), factor * plain_y.ravel() + offsets, rtol=1e-12)
            np.testing.assert_allclose(J[:, :n], factor[:, None] * plain_J, rtol=1e-12, atol=1e-15)
            np.testing.assert_array_equal(J[:, len(J.T) - len(offsets) :], np.eye(len(offsets)))
            assert not drift[n:].any()


@pytest.mark.parametrize(("field", "value"), [("inflation", 0.0), ("bias_floor", -0.1), ("correlation", 1.0)])
@each("SENSORS")
def test_a_sensor_refuses_errors_that_make_no_sense(kind: str, field: str, value: float):
    for reading in examples("SENSORS", kind):
        with pytest.raises(od.InputError, match=rf"^{reading.sensor.name}: {field} is {value!r}: must be a finite number"):
            dataclasses.replace(reading.sensor, **{field: value})


# ---------------------------------------------------------------- paths


def parameters(path: AbstractPath, grid: Grid, seed: int) -> np.ndarray:
    """Random parameters (q,) in their box, its sides included."""
    lower, upper = path.box(grid)
    return lower + np.clip(np.random.default_rng(seed).uniform(-0.2, 1.2, len(lower)), 0, 1) * (upper - lower)


def symbolic(function: Callable[[ca.SX, Grid], ca.SX], p: np.ndarray, grid: Grid) -> tuple[np.ndarray, np.ndarray]:
    """The function of symbolic parameters at p, and its derivatives (entries, q), entries column by column."""
    symbol = ca.SX.sym("p", len(p))
    found = function(symbol, grid)
    assert isinstance(found, ca.SX)
    value, slopes = ca.Function("found", [symbol], [found, ca.jacobian(ca.vec(found), symbol)])(p)
    return value.full(), slopes.full()


@each("PATHS")
@few
@given(seed=seeds)
def test_inputs_are_within_bounds_wherever_the_parameters_are_in_their_box(kind: str, seed: int):
    for path, grid, _ in examples("PATHS", kind):
        lower, upper = path.box(grid)
        assert np.all(np.isfinite(lower) & np.isfinite(upper) & (lower < upper))
        for p in (parameters(path, grid, seed), lower, upper):
            u = path.inputs(p, grid)
            assert u.shape == (grid.steps, 2)
            assert np.all((u >= LOW - 1e-12) & (u <= HIGH + 1e-12))


@each("PATHS")
@pytest.mark.parametrize("what", ["inputs", "rates"])
def test_symbolic_and_numerical_inputs_and_rates_are_the_same(kind: str, what: str):
    for path, grid, _ in examples("PATHS", kind):
        p, function = parameters(path, grid, seed=1), getattr(path, what)
        numerical = function(p, grid)
        assert numerical.shape[1] == 2
        np.testing.assert_allclose(symbolic(function, p, grid)[0].reshape(numerical.shape), numerical, rtol=1e-12, atol=1e-12)


@each("PATHS")
def test_the_derivatives_of_inputs_are_their_central_differences(kind: str):
    for path, grid, _ in examples("PATHS", kind):
        p, eps = parameters(path, grid, seed=2), 1e-4
        _, slopes = symbolic(path.inputs, p, grid)
        for i, unit in enumerate(np.eye(len(p))):
            difference = (path.inputs(p + eps * unit, grid) - path.inputs(p - eps * unit, grid)) / (2 * eps)
            np.testing.assert_allclose(slopes[:, i], difference.ravel(order="F"), atol=1e-6)


@each("PATHS")
@few
@given(seed=seeds)
def test_fitting_a_familys_own_inputs_returns_the_inputs(kind: str, seed: int):
    """Not always the parameters: two that differ only behind the end, say, have the same inputs."""
    for path, grid, _ in examples("PATHS", kind):
        u = path.inputs(parameters(path, grid, seed), grid)
        np.testing.assert_allclose(path.inputs(path.fit(u, grid), grid), u, atol=1e-6)


@each("PATHS")
@few
@given(seed=seeds)
def test_a_fit_is_in_its_box_and_no_others_nearby_come_closer(kind: str, seed: int):
    """To any u, within bounds or not."""
    random = np.random.default_rng(seed)
    for path, grid, _ in examples("PATHS", kind):
        u = grid.centre + random.choice([0.2, 1.0]) * (HIGH - LOW) * random.standard_normal((grid.steps, 2))
        lower, upper = path.box(grid)
        best = path.fit(u, grid)
        assert np.all((best >= lower) & (best <= upper))
        misfit = np.linalg.norm(path.inputs(best, grid) - u, axis=0)
        for size in (1e-3, 0.1):
            other = np.clip(best + size * random.standard_normal(best.shape), lower, upper)
            assert np.all(np.linalg.norm(path.inputs(other, grid) - u, axis=0) >= misfit - 1e-9)


@each("PATHS")
def test_a_grid_that_does_not_suit_is_refused(kind: str):
    refused = [(path, *unsuitable) for path, _, unsuitable in examples("PATHS", kind) if unsuitable]
    assert refused
    for path, grid, message in refused:
        with pytest.raises(od.InputError, match=message):
            path.box(grid)


@pytest.mark.parametrize("pieces", [0, -1, 2.5, "4", None, True])
def test_pieces_are_counted(pieces: object):
    with pytest.raises(od.InputError, match=rf"pieces is {pieces!r}: must be a whole number of at least 1"):
        od.PiecewiseConstant(pieces)


# ---------------------------------------------------------------- constraints


def margins(region: Region, instant: Any) -> list[Any]:
    """Margins at an instant (x, y, heading, rates of x and y) of floats, arrays or symbols."""
    x, y, heading, east, north = instant
    return region.constraint.margins(Moment({"x": x, "y": y, "heading": heading}, {"x": east, "y": north}, {}, region.landmarks))


def whole(instant: Instant) -> Instant:
    return (*instant, *(0.0,) * (5 - len(instant)))


@each("CONSTRAINTS")
def test_margins_have_the_right_sign_and_vanish_on_the_edge(kind: str):
    for region in examples("CONSTRAINTS", kind):
        for instant in region.inside:
            assert min(margins(region, whole(instant))) > 0
        for instant in region.outside:
            assert min(margins(region, whole(instant))) < 0
        for instant in region.edge:
            assert abs(min(margins(region, whole(instant)))) < 1e-12


@each("CONSTRAINTS")
def test_margins_are_the_same_for_floats_arrays_and_symbols(kind: str):
    for region in examples("CONSTRAINTS", kind):
        instants = np.array([whole(instant) for instant in (*region.inside, *region.outside, *region.edge)])
        symbols = ca.SX.sym("instant", 5)
        symbolic = ca.Function("margins", [symbols], [ca.vertcat(*margins(region, ca.vertsplit(symbols)))])(instants.T).full().T
        at_once = np.stack(margins(region, instants.T), axis=1)
        one_by_one = np.array([margins(region, tuple(map(float, instant))) for instant in instants])
        np.testing.assert_allclose(symbolic, one_by_one, rtol=1e-13, atol=1e-13)
        np.testing.assert_allclose(at_once, one_by_one, rtol=1e-13, atol=1e-13)


@each("CONSTRAINTS")
def test_margins_need_the_states_that_the_constraint_names_and_no_others(kind: str):
    for region in examples("CONSTRAINTS", kind):
        state = dict.fromkeys(region.constraint.states, 0.3)
        moment = Moment(state, dict.fromkeys(state, 0.2), {}, region.landmarks)
        assert len(region.constraint.margins(moment)) == len(margins(region, whole(region.inside[0])))
        for name in state:
            others = {other: 0.3 for other in state if other != name}
            with pytest.raises(KeyError, match=name):
                region.constraint.margins(Moment(others, others, {}, region.landmarks))


@each("CONSTRAINTS")
def test_a_constraint_says_when_it_holds_how_large_it_is_and_what_it_is_called(kind: str):
    for region in examples("CONSTRAINTS", kind):
        constraint = region.constraint
        assert isinstance(constraint.span, Span)
        size, unit = constraint.size
        assert 0 < size < np.inf
        assert unit
        assert str(constraint).startswith(type(constraint).__name__)
        assert len({str(each.constraint) for each in examples("CONSTRAINTS", kind)}) == len(examples("CONSTRAINTS", kind))


def scaled_by(scale: float, value: Any) -> Any:
    """Numbers, points and tuples of points, times a number; None stays."""
    if value is None:
        return None
    return tuple(scaled_by(scale, item) for item in value) if isinstance(value, tuple) else scale * value


@each("CONSTRAINTS")
@few
@given(scale=st.floats(1e-3, 1e3), seed=seeds)
def test_margins_have_no_unit(kind: str, scale: float, seed: int):
    """Kilometres instead of metres change no margin: every length of the constraint, and the instant, is scaled."""
    for region in examples("CONSTRAINTS", kind):
        x, y, heading, east, north = np.random.default_rng(seed).uniform(-10, 10, 5)
        names = [field.name for field in dataclasses.fields(region.constraint) if field.name in LENGTHS]
        lengths = {name: scaled_by(scale, getattr(region.constraint, name)) for name in names}
        constraint = dataclasses.replace(region.constraint, **lengths)
        other = dataclasses.replace(region, constraint=constraint, landmarks=scaled_by(scale, region.landmarks))
        found = margins(other, (scale * x, scale * y, heading, scale * east, scale * north))
        np.testing.assert_allclose(found, margins(region, (x, y, heading, east, north)), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf, "3", True])
@each("CONSTRAINTS")
def test_a_number_of_a_constraint_is_finite_and_its_sizes_are_positive(kind: str, value: object):
    for region in examples("CONSTRAINTS", kind):
        fields = [field.name for field in dataclasses.fields(region.constraint)]
        numbers = [name for name in fields if isinstance(getattr(region.constraint, name), float)]
        for name in numbers:
            if name not in REAL or value not in (0.0, -1.0):
                with pytest.raises(od.InputError, match=rf"^{kind}: {name} is {value!r}: must be a finite number"):
                    dataclasses.replace(region.constraint, **{name: value})


# ---------------------------------------------------------------- costs


def rates(cost: AbstractCost, instant: Any) -> Any:
    """What a cost is per second, at rates (x, y) and inputs (speed, turn_rate) of floats, arrays or symbols."""
    east, north, speed, turn_rate = instant
    return cost.rate(Moment({"x": 0 * east, "y": 0 * north}, {"x": east, "y": north}, {"speed": speed, "turn_rate": turn_rate}))


INSTANTS = np.random.default_rng(0).uniform(-3, 3, (6, 4))


@each("COSTS")
def test_a_cost_is_what_it_is_by_hand_for_floats_arrays_and_symbols(kind: str):
    for account in examples("COSTS", kind):
        expected = [account.by_hand(*instant) for instant in INSTANTS]
        symbols = ca.SX.sym("instant", 4)
        symbolic = ca.Function("rate", [symbols], [rates(account.cost, ca.vertsplit(symbols))])(INSTANTS.T).full().ravel()
        at_once = rates(account.cost, INSTANTS.T)
        one_by_one = [rates(account.cost, tuple(map(float, instant))) for instant in INSTANTS]
        assert at_once.shape == (len(INSTANTS),)
        for found in (symbolic, at_once, one_by_one):
            np.testing.assert_allclose(found, expected, rtol=1e-7)
        assert account.cost.unit == account.unit


@each("COSTS")
def test_a_cost_is_smooth_and_at_least_zero_at_rest(kind: str):
    for account in examples("COSTS", kind):
        symbols = ca.SX.sym("instant", 4)
        hessian, gradient = ca.hessian(rates(account.cost, ca.vertsplit(symbols)), symbols)
        values = ca.Function("smooth", [symbols], [hessian, gradient])(np.zeros(4))
        assert all(np.isfinite(value.full()).all() for value in values)
        assert rates(account.cost, (0.0, 0.0, 0.0, 0.0)) >= 0


# ---------------------------------------------------------------- criteria: three faces of one number


def information(n: int, seed: int, values: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """A symmetric matrix with given or random eigenvalues, and the eigenvalues."""
    random = np.random.default_rng(seed)
    spectrum = 10.0 ** random.uniform(-1, 2, n) if values is None else values
    Q = np.linalg.qr(random.standard_normal((n, n)))[0]
    W = (Q * spectrum) @ Q.T
    return (W + W.T) / 2, spectrum


@each("CRITERIA")
@few
@given(n=st.integers(1, 6), seed=seeds)
def test_a_criterion_is_its_function_of_the_eigenvalues(kind: str, n: int, seed: int):
    for measure in examples("CRITERIA", kind):
        W, values = information(n, seed)
        assert measure.criterion.value(W) == pytest.approx(measure.of_eigenvalues(values), rel=1e-9, abs=1e-9)


@each("CRITERIA")
@few
@given(n=st.integers(1, 6), columns=st.integers(0, 3), seed=seeds)
def test_a_criterion_costs_a_root_what_it_costs_its_covariance(kind: str, n: int, columns: int, seed: int):
    """P = B B' with more columns than rows."""
    B = np.random.default_rng(seed).standard_normal((2, n, n + columns))
    P = B @ B.swapaxes(-1, -2)
    for measure in examples("CRITERIA", kind):
        costs = measure.criterion.covariance_cost(P)
        np.testing.assert_allclose(measure.criterion.covariance_cost_of_root(B), costs, rtol=1e-9, atol=1e-9 * np.linalg.cond(P).max())


@each("CRITERIA")
@few
@given(n=st.integers(1, 6), seed=seeds)
def test_the_slope_of_a_criterion_is_its_derivative(kind: str, n: int, seed: int):
    """Along a random direction, against central differences; and no value lies above the tangent: the criterion is concave."""
    for measure in examples("CRITERIA", kind):
        W, _ = information(n, seed)
        direction = np.random.default_rng(seed + 1).standard_normal((n, n))
        direction = (direction + direction.T) * np.linalg.eigvalsh(W)[0] / (4 * n)
        value, Z = measure.criterion.value, measure.criterion.slope(W)
        eps, along = 1e-5, float(np.sum(Z * direction))
        difference = (value(W + eps * direction) - value(W - eps * direction)) / (2 * eps)
        assert difference == pytest.approx(along, rel=1e-4, abs=1e-6 * np.abs(Z).max() * np.abs(direction).max())
        assert value(W + direction) <= value(W) + along + 1e-9 * abs(value(W))


def test_the_slope_where_eigenvalues_coincide_is_above_all_values():
    W = np.diag([2.0, 2.0, 5.0])
    Z = od.MinEigenvalue().slope(W)
    np.testing.assert_allclose(Z, np.diag([0.5, 0.5, 0.0]), atol=1e-15)


@each("CRITERIA")
@few
@given(n=st.integers(1, 5), seed=seeds)
def test_the_curvature_of_a_criterion_is_how_its_slope_falls(kind: str, n: int, seed: int):
    """(q, q) of q directions, against central differences; 0 where a design follows the number by a matrix inequality instead."""
    for measure in examples("CRITERIA", kind):
        criterion, (W, _) = measure.criterion, information(n, seed)
        D = np.random.default_rng(seed + 1).standard_normal((3, n, n))
        D = (D + D.swapaxes(1, 2)) * np.linalg.eigvalsh(W)[0] / (4 * n)
        found, eps = criterion.curvature(W, D), 1e-4
        assert found.shape == (3, 3)
        if criterion.is_smallest_eigenvalue:
            np.testing.assert_array_equal(found, np.zeros((3, 3)))
            assert criterion.value(W) == pytest.approx(float(np.linalg.eigvalsh(W)[0]), rel=1e-9)
        else:
            falls = [(criterion.slope(W - eps * each) - criterion.slope(W + eps * each)) / (2 * eps) for each in D]
            expected = np.einsum("iab,jab->ij", falls, D)
            np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-6 * np.abs(expected).max())
            assert np.linalg.eigvalsh((found + found.T) / 2)[0] >= -1e-12 * np.abs(found).max()


@pytest.mark.parametrize("n", [2, 3, 5])
@each("CRITERIA")
def test_the_atom_of_a_constant_is_the_value_and_the_atom_is_concave(kind: str, n: int):
    for measure in examples("CRITERIA", kind):
        W, _ = information(n, seed=n)
        atom = measure.criterion.atom(cp.Constant(W))
        assert float(np.asarray(atom.value).item()) == pytest.approx(measure.criterion.value(W), rel=1e-6)
        assert measure.criterion.atom(cp.Variable((n, n), symmetric=True)).is_concave()


@each("CRITERIA")
def test_the_atom_at_its_optimum_is_the_value(kind: str):
    """max atom(V) subject to V <= W is attained at V = W, because a criterion grows with the information."""
    for measure in examples("CRITERIA", kind):
        W, _ = information(3, seed=3, values=np.array([1.0, 2.0, 4.0]))
        V = cp.Variable((3, 3), symmetric=True)
        problem = cp.Problem(cp.Maximize(measure.criterion.atom(V)), [W - V >> 0])
        problem.solve(solver=cp.CLARABEL)
        assert problem.value == pytest.approx(measure.criterion.value(W), rel=1e-6)


@each("CRITERIA")
@few
@given(n=st.integers(1, 5), seed=seeds)
def test_ratios_of_a_criterion_mean_something_where_it_says_so(kind: str, n: int, seed: int):
    """value(4 W) is 4 value(W) or value(W) / 4; and a gap is a share where values do not differ by a constant of the units."""
    for measure in examples("CRITERIA", kind):
        criterion, (W, _) = measure.criterion, information(n, seed)
        ratio = criterion.value(4 * W) / criterion.value(W)
        assert criterion.label
        assert criterion.symbol
        if criterion.scales_with_information:
            assert min(abs(ratio - 4.0), abs(ratio - 0.25)) < 1e-9
            assert criterion.gap_kind == "relative"


def test_no_two_criteria_are_called_the_same():
    labels = [measure.criterion.label for kind in kinds(criteria) for measure in CRITERIA[kind][:1]]
    assert len(set(labels)) == len(labels)


@each("CRITERIA")
@few
@given(n=st.integers(1, 5), seed=seeds)
def test_more_information_is_never_worse(kind: str, n: int, seed: int):
    for measure in examples("CRITERIA", kind):
        W, _ = information(n, seed)
        more = np.random.default_rng(seed).standard_normal((n, 2))
        value, larger = measure.criterion.value(W), measure.criterion.value(W + more @ more.T)
        assert larger >= value - 1e-9 * abs(value)


@few
@given(n=st.integers(2, 5), seed=seeds)
def test_very_different_units_cost_no_digits(n: int, seed: int):
    """W = D A D with units D over eight decades: log det W = log det A + 2 sum log D, tr W^-1 = sum (A^-1)_ii / D_i^2."""
    A, _ = information(n, seed)
    D = np.random.default_rng(seed).permutation(np.logspace(-4, 4, n))
    W = A * np.outer(D, D)
    assert od.LogDet().value(W) == pytest.approx(od.LogDet().value(A) + 2 * np.log(D).sum(), rel=1e-9, abs=1e-9)
    assert od.TraceInverse().value(W) == pytest.approx(-float(np.sum(np.diag(np.linalg.inv(A)) / D**2)), rel=1e-9)


SINGULAR = {
    "zero": np.zeros((2, 2)),
    "rank 1": np.ones((2, 2)),
    "rank 2": np.diag([3.0, 1.0, 0.0]),
    "one eigenvalue negative by rounding": np.diag([1.0, -1e-17]),
    "two eigenvalues negative by rounding": np.diag([1.0, -1e-17, -1e-17]),
}


@pytest.mark.parametrize("W", SINGULAR.values(), ids=SINGULAR.keys())
@each("CRITERIA")
def test_a_singular_matrix_has_the_value_of_no_information_in_one_direction(kind: str, W: np.ndarray):
    for measure in examples("CRITERIA", kind):
        assert measure.criterion.value(W) == pytest.approx(measure.singular, abs=1e-12)


@each("CRITERIA")
@few
@given(heading=st.floats(-3.0, 3.0))
def test_a_matrix_that_is_singular_but_for_rounding_counts_as_singular(kind: str, heading: float):
    """GPS on a straight line has rank 4 of 5 (Brace and Morgansen eq. 11), whatever double precision leaves of the fifth eigenvalue."""
    system = od.System(od.Dubins(15.0, wind="constant"), (od.GPS(2.0),))
    W = od.variational_gramian(system, od.simulate(system, (0.0, 0.0, heading, 2.0, 1.0), np.zeros(20), 0.5)).total
    for measure in examples("CRITERIA", kind):
        assert measure.criterion.value(W) == pytest.approx(measure.singular, abs=1e-10)
