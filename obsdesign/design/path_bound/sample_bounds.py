"""What all samples say at most, as positions and headings: weights of a matrix that no path's information exceeds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from obsdesign.constraints.stand_off import StandOff
from obsdesign.design.path_bound.motion import AllowedMotion
from obsdesign.design.problem import DesignProblem
from obsdesign.dynamics.system import System
from obsdesign.errors import InputError
from obsdesign.information.sample_information import sampling_mask
from obsdesign.sensors._group import sensor_groups
from obsdesign.sensors.abstract import AbstractSensor
from obsdesign.sensors.airspeed import Airspeed
from obsdesign.sensors.bearing import Bearing
from obsdesign.sensors.course import Course
from obsdesign.sensors.gps import GPS
from obsdesign.sensors.magnetometer import Magnetometer
from obsdesign.sensors.range import Range
from obsdesign.sensors.speed_over_ground import SpeedOverGround
from obsdesign.sensors.velocity_log import VelocityLog
from obsdesign.signals import Point

_LEAST_MIX = 0.01  # of a bearing's direction and heading
_OF_VELOCITY = (Airspeed, Course, SpeedOverGround, VelocityLog)
_UP = 1 + 1e-13  # what a few roundings make of a product at most


@dataclass(frozen=True, eq=False)
class SampleBounds:
    """W + known <= sum_k positions_k m_k m_k' (x and y alike, m_k as position and heading move with the start) + diagonal terms.

    positions (N,) [1/m^2]; heading [1/rad^2]; known_position [1/m^2], known_wind [s^2/m^2]: of both axes. Where there are blocks B
    (K, n, n), of K equal stretches of n samples, sum_kl (B'B)_kl m_k m_l' stands in place of the first sum.
    """

    positions: np.ndarray
    heading: float
    known_position: float
    known_wind: float
    left_out: tuple[str, ...]
    blocks: np.ndarray | None = None

    def weigh(self, rows: np.ndarray) -> np.ndarray:
        """Return rows (N, d) of samples times the root of their weights."""
        if self.blocks is None:
            return np.sqrt(self.positions)[:, None] * rows
        return (self.blocks @ rows.reshape(*self.blocks.shape[:2], -1)).reshape(rows.shape)

    def weigh_errors(self, errors: np.ndarray) -> np.ndarray:
        """Return what errors (N,) of rows are at most after that."""
        return (self if self.blocks is None else replace(self, blocks=np.abs(self.blocks))).weigh(errors[:, None])[:, 0]


def sample_bounds_of(problem: DesignProblem, motion: AllowedMotion) -> SampleBounds:
    """Return the weights; raises InputError with the reason where a sensor has no such bound."""
    readings, left_out = readings_of(problem, motion)
    weights = outer_weights(readings)
    return bounds_with_knowledge(problem, weights.positions, (float(weights.heading.sum()), float(weights.wind.sum())), left_out)


def readings_of(problem: DesignProblem, motion: AllowedMotion) -> tuple[list[ReadingBound], tuple[str, ...]]:
    """Return what the samples of each sensor say, and what that leaves out; raises InputError as `sample_bounds_of` does."""
    system = problem.system
    if not isinstance(system, System):
        raise InputError("the system is none of the ready-made ones")
    _require_plain(system)
    amounts, readings, left_out = _amounts(problem, system), [], []
    for s, group in enumerate(system.groups):
        name, sensor = group.name, group.sensors[0]
        distances = nearest_distances(problem, motion, sensor.landmarks[0]) if sensor.landmarks else None
        precision, words = _precision(system, name, sensor, distances)
        samples = amounts[:, s] * precision
        is_of_velocity = isinstance(sensor, _OF_VELOCITY)
        reading = _velocity_reading(problem, motion, sensor, samples) if is_of_velocity else _reading(sensor, samples, distances)
        readings.append(reading)
        words += [] if distances is None else [f"that {name} sees one direction at a time, and how far the beacon is"]
        words += [f"that {name} tells of heading and wind together"] if reading.heading.any() and reading.wind.any() else []
        left_out += words
    return readings, tuple(left_out)


def bounds_with_knowledge(
    problem: DesignProblem,
    positions: np.ndarray,
    constant: tuple[float, float],
    left_out: tuple[str, ...],
    blocks: np.ndarray | None = None,
) -> SampleBounds:
    """Return weights of samples with those of what is known; constant: of the heading and of the wind, whatever the path."""
    prior_information = _diagonal_above(np.asarray(problem.known))
    if np.count_nonzero(np.asarray(problem.known) - np.diag(np.diag(np.asarray(problem.known)))):
        left_out = (*left_out, "what is known of one state with another")
    up = _UP * (1 + problem.steps * 1e-15)
    return SampleBounds(
        positions * _UP,
        (constant[0] + prior_information[2]) * up,
        float(prior_information[:2].max()) * _UP,
        (constant[1] + float(prior_information[3:5].max()) if len(prior_information) > 3 else 0.0) * up,
        left_out,
        None if blocks is None else blocks * _UP,
    )


def _require_plain(system: System) -> None:
    for group in system.groups:
        if len(group.sensors) > 1:
            raise InputError(f"{group.name}: no bound is known for several sensors of one group")
    if len(system.states) > len(system.vehicle.states):
        raise InputError("no bound is known where scales or biases of sensors are states")


@dataclass(frozen=True, eq=False)
class ReadingBound:
    """What the samples of one sensor say: of positions in every direction, along or across the line of sight (N,), of the heading (N,).

    wind (N,): of both axes of the wind. mixed: whether what is across and the heading come as one number, (e / r, -1).
    """

    landmark: Point | None
    position: np.ndarray
    along: np.ndarray
    across: np.ndarray
    heading: np.ndarray
    wind: np.ndarray
    is_mixed: bool = False


def _reading(sensor: AbstractSensor, precision: np.ndarray, distances: np.ndarray | None) -> ReadingBound:
    none = np.zeros_like(precision)
    if distances is None:
        is_position = isinstance(sensor, GPS)
        return ReadingBound(None, precision if is_position else none, none, none, none if is_position else precision, none)
    if isinstance(sensor, Range):
        return ReadingBound(sensor.landmarks[0], none, precision, none, none, none)
    if (precision[distances <= 0] > 0).any():
        raise InputError(
            "a path may come as near to the beacon as it likes, where a bearing's information has no limit: a StandOff gives it one"
        )
    across = precision / np.where(distances > 0, distances, 1.0) ** 2
    return ReadingBound(sensor.landmarks[0], none, none, across, precision, none, is_mixed=True)


def _velocity_reading(problem: DesignProblem, motion: AllowedMotion, sensor: AbstractSensor, precision: np.ndarray) -> ReadingBound:
    """What samples of the velocity V e + w over ground say of heading and wind, which do not change: no position, whatever the path.

    A gradient, or rows of gradients, of sizes a [1/rad] in the heading and b [s/m] in the wind: g g' <= diag((1 + 1 / m) a^2, (1 + m) b^2)
    for every m > 0; that of a over b in the units of the states.
    """
    none, has_wind = np.zeros_like(precision), len(problem.x0) > 3
    a, b = _velocity_slopes(problem, motion, sensor)
    if not has_wind or not (a and b):
        return ReadingBound(None, none, none, none, a**2 * precision, b**2 * precision if has_wind else none)
    S = np.asarray(problem.scale, dtype=float)
    m = float(np.clip(a * S[2] / (b * S[3:5].max()), _LEAST_MIX, 1 / _LEAST_MIX))
    return ReadingBound(None, none, none, none, (1 + 1 / m) * a**2 * precision, (1 + m) * b**2 * precision)


def _velocity_slopes(problem: DesignProblem, motion: AllowedMotion, sensor: AbstractSensor) -> tuple[float, float]:
    """Return what the slopes of the outputs in the heading and in the wind are at most, of a speed V through air and a wind w.

    R'(V e + w): (|w|, 1). |V e + w|: the height of the triangle of V e and w over its third side, (min(V, |w|), 1). The direction of
    V e + w: V e . u / |V e + w| = 1 - w . u / |V e + w|, u along V e + w, so (1 + |w| / g, 1 / g), g = least V - |w|. |V e|: neither.
    """
    if isinstance(sensor, Airspeed):
        return 0.0, 0.0
    wind = float(np.hypot(*problem.x0[3:5])) if len(problem.x0) > 3 else 0.0
    if isinstance(sensor, Course):
        ground = motion.slowest * motion.speed * (1 - 1e-9) - wind
        if ground <= 0:
            raise InputError(f"{sensor.name}: the vehicle may stand still over ground, where a course has no limit")
        return 1 + wind / ground, 1 / ground
    return (wind if isinstance(sensor, VelocityLog) else min(motion.speed, wind)), 1.0


@dataclass(frozen=True, eq=False)
class OuterWeights:
    """Weights of positions (N,), of the heading (N,) and of the wind (N,) that all readings together do not exceed."""

    positions: np.ndarray
    heading: np.ndarray
    wind: np.ndarray


def outer_weights(readings: Sequence[ReadingBound]) -> OuterWeights:
    """Return weights that all readings together do not exceed.

    a r r' + b e e' <= max(a, b) I for what is along and across the line of sight to one beacon. A bearing is
    (e / r, -1)(e / r, -1)' <= diag((1 + 1 / m) e e' / r^2, 1 + m) for every m > 0: small where others see the position better.
    """
    steps = len(readings[0].position)
    plain = sum((reading.position for reading in readings if reading.landmark is None), np.zeros(steps))
    positions, heading = plain.copy(), np.zeros(steps)
    across, along = sum(float(reading.across.sum()) for reading in readings), sum(float(reading.along.sum()) for reading in readings)
    total = float(plain.sum()) + along + across
    m = float(np.clip(np.sqrt(across / total), _LEAST_MIX, 1.0)) if total > 0 else 1.0
    for landmark in dict.fromkeys(reading.landmark for reading in readings if reading.landmark is not None):
        at_landmark = [reading for reading in readings if reading.landmark == landmark]
        radial, tangential = (sum((getattr(reading, side) for reading in at_landmark), np.zeros(steps)) for side in ("along", "across"))
        positions += np.maximum(radial, (1 + 1 / m) * tangential)
    for reading in readings:
        heading += reading.heading * (1 + m if reading.is_mixed else 1.0)
    return OuterWeights(positions, heading, sum((reading.wind for reading in readings), np.zeros(steps)))


def _amounts(problem: DesignProblem, system: System) -> np.ndarray:
    """How much each sample counts at most (N, S): errors that are not independent have no share of a sample."""
    sampling = sampling_mask(system, problem.steps, problem.step).astype(float)
    if problem.weights is None:
        return sampling
    weights = np.asarray(problem.weights)
    is_white = np.array([channel.noise.is_white for channel in system.model.channels])
    return sampling * np.repeat(np.where(is_white, weights, weights > 0), problem.steps // len(weights), axis=0)


def _precision(system: System, name: str, sensor: AbstractSensor, distances: np.ndarray | None) -> tuple[np.ndarray | float, list[str]]:
    """What 1 / variance of a sample is at most where errors were independent, and what of the noise that leaves out.

    R >= R without the constant error >= (1 - correlation) / (1 + correlation) of the variances, and joint errors with the matrix of
    correlations C: R^-1 <= D^-2 / lambda_min(C), D the diagonal of standard deviations. What grows with the distance is at its least.
    """
    if not isinstance(sensor, (GPS, Magnetometer, Range, Bearing, *_OF_VELOCITY)):
        raise InputError(f"{name}: no bound is known for a {type(sensor).__name__}")
    if isinstance(sensor, Range | Bearing) and any(sensor.lever_arm):
        raise InputError(f"{name}: no bound is known for a sensor beside the position, lever_arm {sensor.lever_arm!r}")
    words = [f"the constant error of {name}"] if sensor.bias_floor else []
    words += [f"how errors of {name} belong together in time"] if sensor.correlation else []
    share, variance = (1 - sensor.correlation) / (1 + sensor.correlation), np.asarray(sensor.sigma**2)
    if isinstance(sensor, Range | Bearing) and distances is not None:
        variance = variance + (sensor.sigma_per_metre * distances) ** 2
        words += [f"that samples of {name} may fail to arrive"] if sensor.max_range or sensor.field_of_view else []
    for names, R in system.joint_noise.items():
        if name in names:
            spread, smallest = _joint_spread(system, names, np.asarray(R), name)
            share, variance = share * smallest, np.asarray(spread**2)
            words.append(f"how errors of {', '.join(names)} belong together")
    return _UP / (share * sensor.inflation**2 * variance), words


def _joint_spread(system: System, names: tuple[str, ...], R: np.ndarray, name: str) -> tuple[float, float]:
    """The least standard deviation of the sensor's outputs, and the least eigenvalue of the correlations, from below."""
    outputs = {group.name: group.outputs for group in sensor_groups(system.sensors)}
    owner = np.array([sensor_name for sensor_name in names for _ in outputs[sensor_name]])
    spreads = np.sqrt(np.diag(R))
    smallest = float(np.linalg.eigvalsh(R / spreads[:, None] / spreads)[0]) - 1e-12
    if smallest <= 0:
        raise InputError(f"{name}: its joint noise is singular")
    return float(spreads[owner == name].min()), smallest


def nearest_distances(problem: DesignProblem, motion: AllowedMotion, landmark: Point) -> np.ndarray:
    """How near a path may be to a landmark at each of the N samples [m], from below: a StandOff, and how far it can come since the start.

    From a known start |landmark - start - wind t| - speed t, to the goal |landmark - goal + wind (T - t)| - speed (T - t) - tolerance.
    """
    t = np.arange(problem.steps) * problem.step
    wind = problem.x0[3:5] if len(problem.x0) > 3 else np.zeros(2)
    offset = np.asarray(landmark) - problem.x0[:2] - t[:, None] * wind
    nearest = np.hypot(*offset.T) - motion.speed * t
    for end in motion.ends:
        nearest = np.maximum(nearest, np.hypot(*(offset - end.point).T) - motion.speed * (motion.steps * problem.step - t) - end.radius)
    nearest -= 1e-9 * (np.abs(offset).max() + motion.speed * problem.longest)
    for limit in problem.constraints:
        if isinstance(limit, StandOff) and landmark in (limit.landmarks or problem.system.model.landmarks):
            nearest = np.maximum(nearest, limit.distance * (1 - 1e-5))
    return np.maximum(nearest, 0.0)


def _diagonal_above(J: np.ndarray) -> np.ndarray:
    """A diagonal (n,) with J <= diag of it, J >= 0: J_ii times the sum of |J_ij| / sqrt(J_ii J_jj)."""
    size = np.sqrt(np.maximum(np.diag(J), 0.0))
    units = np.where(size > 0, size, 1.0)
    return size**2 * (np.abs(J) / units[:, None] / units).sum(axis=1) * _UP
