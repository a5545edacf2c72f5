"""The case that is compared: a unicycle in constant wind with four sensors."""

from __future__ import annotations

import numpy as np

import obsdesign as od
from obsdesign.sensors.abstract import AbstractSensor

BEACON = (200.0, 150.0)
SIGMAS = {"gps": 2.0, "magnetometer": 0.21, "range": 1.0, "bearing": 0.087}
START = np.array([3.0, -1.0, 0.4, 2.0, -1.0])
STEP = 0.1


def sensors(loops: str = "") -> tuple[AbstractSensor, ...]:
    """Return the four sensors; `loops` tells systems apart that are the same but for how their loops run."""
    return (
        od.GPS(SIGMAS["gps"], name=f"gps {loops}".strip()),
        od.Magnetometer(SIGMAS["magnetometer"]),
        od.Range(BEACON, SIGMAS["range"]),
        od.Bearing(BEACON, SIGMAS["bearing"]),
    )


def unicycle(loops: str = "") -> od.System:
    """Return the system: inputs speed and turn rate."""
    return od.System(od.Unicycle(wind="constant"), sensors(loops))


def dubins(loops: str = "") -> od.System:
    """Return the same at constant speed: input turn rate."""
    return od.System(od.Dubins(speed=10.0, wind="constant"), sensors(loops))


def controls(steps: int) -> np.ndarray:
    """Speed [m/s] and turn rate [rad/s] (N, 2), different at every step."""
    t = np.arange(steps) * STEP
    return np.column_stack([10 + np.sin(t), 0.3 * np.cos(0.7 * t)])


def flown(steps: int) -> od.Trajectory:
    """The unicycle's path."""
    return od.simulate(unicycle(), START, controls(steps), STEP)
