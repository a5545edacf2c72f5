"""What all samples say at most, as positions and headings: weights of a matrix that no path's information exceeds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.constraints.stand_off import StandOff
from obsdesign.design.problem import DesignProblem
from obsdesign.dynamics.system import System
from obsdesign.errors import InputError
from obsdesign.information.sample_information import sampling_mask
from obsdesign.sensors.abstract import AbstractSensor
from obsdesign.sensors.bearing import Bearing
from obsdesign.sensors.gps import GPS
from obsdesign.sensors.magnetometer import Magnetometer
from obsdesign.sensors.range import Range

_UP = 1 + 1e-13  # what a few roundings make of a product at most


@dataclass(frozen=True, eq=False)
class SampleBounds:
    """W + known <= sum_k positions_k m_k m_k' (x and y alike, m_k as position and heading move with the start) + diagonal terms.

    positions (N,) [1/m^2]; heading [1/rad^2]; known_position [1/m^2], known_wind [s^2/m^2]: of both axes.
    """

    positions: np.ndarray
    heading: float
    known_position: float
    known_wind: float
    left_out: tuple[str, ...]


def sample_bounds_of(problem: DesignProblem) -> SampleBounds:
    """Return the weights; raises InputError with the reason where a sensor has no such bound."""
    system, steps = problem.system, problem.steps
    if not isinstance(system, System):
        raise InputError("the system is none of the ready-made ones")
    amounts = _amounts(problem, system)
    positions, headings, left_out = np.zeros(steps), np.zeros(steps), []
    for s, (name, sensor) in enumerate(zip(system.sensor_names, system.sensors, strict=True)):
        precision, words = _precision(system, name, sensor)
        position, heading, more_words = _outer_rows(problem, name, sensor)
        positions += amounts[:, s] * (precision * position)
        headings += amounts[:, s] * (precision * heading)
        left_out += [*words, *more_words]
    known = _diagonal_above(np.asarray(problem.known))
    wind = known[3:5].max() if len(known) > 3 else 0.0
    if np.count_nonzero(np.asarray(problem.known) - np.diag(np.diag(np.asarray(problem.known)))):
        left_out.append("what is known of one state with another")
    heading = (float(headings.sum()) + known[2]) * _UP * (1 + steps * 1e-15)
    return SampleBounds(positions * _UP, heading, float(known[:2].max()) * _UP, float(wind) * _UP, tuple(left_out))


def _amounts(problem: DesignProblem, system: System) -> np.ndarray:
    """How much each sample counts at most (N, S): errors that are not independent have no share of a sample."""
    sampling = sampling_mask(system, problem.steps, problem.step).astype(float)
    if problem.weights is None:
        return sampling
    weights = np.asarray(problem.weights)
    is_white = np.array([channel.noise.is_white for channel in system.model.channels])
    return sampling * np.repeat(np.where(is_white, weights, weights > 0), problem.steps // len(weights), axis=0)


def _precision(system: System, name: str, sensor: AbstractSensor) -> tuple[float, list[str]]:
    """What 1 / variance of a sample is at most where errors were independent, and what of the noise that leaves out.

    R >= R without the constant error >= (1 - correlation) / (1 + correlation) of the variances, and joint errors with the matrix of
    correlations C: R^-1 <= D^-2 / lambda_min(C), D the diagonal of standard deviations.
    """
    if not isinstance(sensor, GPS | Magnetometer | Range | Bearing):
        raise InputError(f"{name}: no bound is known for a {type(sensor).__name__}")
    words = [f"the constant error of {name}"] if sensor.bias_floor else []
    words += [f"how errors of {name} belong together in time"] if sensor.correlation else []
    share = (1 - sensor.correlation) / (1 + sensor.correlation)
    sigma = sensor.sigma
    for names, R in system.joint_noise.items():
        if name in names:
            sigma, least = _joint_spread(system, names, np.asarray(R), name)
            share *= least
            words.append(f"how errors of {', '.join(names)} belong together")
    return _UP / (share * (sensor.inflation * sigma) ** 2), words


def _joint_spread(system: System, names: tuple[str, ...], R: np.ndarray, name: str) -> tuple[float, float]:
    """The least standard deviation of the sensor's outputs, and the least eigenvalue of the correlations, from below."""
    sensors = dict(zip(system.sensor_names, system.sensors, strict=True))
    owner = np.array([each for each in names for _ in sensors[each].outputs])
    spreads = np.sqrt(np.diag(R))
    least = float(np.linalg.eigvalsh(R / spreads[:, None] / spreads)[0]) - 1e-12
    if least <= 0:
        raise InputError(f"{name}: its joint noise is singular")
    return float(spreads[owner == name].min()), least


def _outer_rows(problem: DesignProblem, name: str, sensor: AbstractSensor) -> tuple[float, float, list[str]]:
    """What a sample says of position and heading at most, for errors of variance 1.

    Range: r r' <= I. Bearing: with e across the line of sight and the distance r, (e / r, -1)(e / r, -1)' <= 2 diag(I / r^2, 1).
    """
    if isinstance(sensor, GPS):
        return 1.0, 0.0, []
    if isinstance(sensor, Magnetometer):
        return 0.0, 1.0, []
    words = [f"that {name} sees one direction at a time"]
    if isinstance(sensor, Range):
        return 1.0, 0.0, words
    nearest = _nearest(problem, sensor)
    return 2.0 / nearest**2, 2.0, [*words, f"that {name} is rarely as near as {nearest:g} m"]


def _nearest(problem: DesignProblem, sensor: AbstractSensor) -> float:
    """How near a path may come to what the sensor looks at [m]."""
    distances = [0.0]
    for limit in problem.constraints:
        if isinstance(limit, StandOff) and sensor.landmark in (limit.landmarks or problem.system.model.landmarks):
            distances.append(limit.distance * (1 - 1e-5))
    if max(distances) <= 0:
        raise InputError("a bearing has no bound without a StandOff: its information grows without limit near the beacon")
    return max(distances)


def _diagonal_above(J: np.ndarray) -> np.ndarray:
    """A diagonal (n,) with J <= diag of it, J >= 0: J_ii times the sum of |J_ij| / sqrt(J_ii J_jj)."""
    size = np.sqrt(np.maximum(np.diag(J), 0.0))
    units = np.where(size > 0, size, 1.0)
    return size**2 * (np.abs(J) / units[:, None] / units).sum(axis=1) * _UP
