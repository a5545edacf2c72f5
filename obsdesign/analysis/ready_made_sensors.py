"""Ready-made sensors that a vehicle could carry besides those that it has."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from obsdesign.dynamics.system import System
from obsdesign.errors import ObsdesignError
from obsdesign.sensors.abstract import AbstractSensor
from obsdesign.sensors.bearing import Bearing
from obsdesign.sensors.course import Course
from obsdesign.sensors.gps import GPS
from obsdesign.sensors.magnetometer import Magnetometer
from obsdesign.sensors.range import Range
from obsdesign.sensors.speed_over_ground import SpeedOverGround


def ready_made_sensors(system: System) -> tuple[AbstractSensor, ...]:
    """Return sensors of kinds that the system does not have and that its vehicle can carry: sigmas of 1 m, 0.1 rad and 1 m/s.

    GPS, magnetometer, speed and course over ground, and range and bearing of each landmark.
    """
    landmarks = system.model.landmarks
    candidates: Sequence[AbstractSensor] = (
        GPS(sigma=1.0),
        Magnetometer(sigma=0.1),
        SpeedOverGround(sigma=1.0),
        Course(sigma=0.1),
        *(Range(beacon=landmark, sigma=1.0) for landmark in landmarks),
        *(Bearing(beacon=landmark, sigma=0.1) for landmark in landmarks),
    )
    present = {(type(sensor), sensor.landmarks) for sensor in system.sensors}
    return tuple(sensor for sensor in candidates if (type(sensor), sensor.landmarks) not in present and _fits(system, sensor))


def _fits(system: System, sensor: AbstractSensor) -> bool:
    """Return whether the vehicle has what the sensor measures."""
    try:
        return bool(replace(system, sensors=(sensor,), joint_noise={}, suite=None).model.channels)
    except (ObsdesignError, KeyError):
        return False
