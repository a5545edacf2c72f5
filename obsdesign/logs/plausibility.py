"""Numbers that cannot be meant: degrees taken for radians, millimetres for metres. Told by comparing what a log says twice."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from obsdesign.calculus import wrap
from obsdesign.dynamics.model import AbstractSystem
from obsdesign.dynamics.simulation import readings
from obsdesign.dynamics.system import System
from obsdesign.errors import InputError
from obsdesign.logs.log import Log
from obsdesign.logs.true_motion import FEWEST, is_near, motion_ratios, require_seconds, require_true_degrees, require_true_metres
from obsdesign.sensors.abstract import AbstractSensor
from obsdesign.sensors.airspeed import Airspeed
from obsdesign.sensors.peer_range import PeerRange
from obsdesign.sensors.range import Range
from obsdesign.sensors.range_bearing import RangeBearing
from obsdesign.sensors.speed_over_ground import SpeedOverGround
from obsdesign.signals import Signal

_FACTORS = {"thousandths or thousands": 1000.0, "degrees": 180 / np.pi}
_MAX_ANGLE = 7.0  # no angle that wraps is larger [rad]
_FAR = 4.0  # how many times nearer values are in the unit that is meant
_LENGTHS = (Range, RangeBearing, PeerRange, Airspeed, SpeedOverGround)  # sensors whose first output is not negative
_BELOW = 4.0  # standard deviations below 0 that noise does not reach
_USUAL, _FASTEST = 0.9, 1e4  # share of an input's readings; SI units, and as many times what is usual, that no input reaches
_NOISE = 5.0  # standard deviations within which readings are as they should be


def require_plausible(file: Path, system: AbstractSystem, log: Log) -> None:
    """Raise InputError where numbers are off by a factor that a unit explains, with the column and the unit that would fit."""
    _require_lengths(file, system, log)
    _require_speeds(file, system, log)
    require_true_degrees(file, system, log)
    motion = dict(motion_ratios(system, log))
    require_seconds(file, motion)
    require_true_metres(file, log)
    for column, ratio in (*_outputs(system, log), *motion.items()):
        for words, factor in _FACTORS.items():
            if is_near(ratio, factor) or is_near(ratio, 1 / factor):
                raise InputError(
                    f"{file}, column {column!r}: its numbers are {ratio:.3g} times what the truth and the system say: are they in"
                    f" {words}? Say so in the header, such as [deg] or [mm]"
                )
    for channel in system.model.channels:
        for place, signal in enumerate(channel.outputs):
            values = log.samples.y[log.samples.sensor == log.samples.names.index(channel.name), place]
            if signal.is_angle and len(values) >= FEWEST and np.median(np.abs(values)) > _MAX_ANGLE:
                raise InputError(
                    f"{file}, column {signal.name!r}: half of its angles are beyond {np.median(np.abs(values)):.3g} rad: are they degrees?"
                    " Say so in the header, [deg]"
                )


def _outputs(system: AbstractSystem, log: Log) -> Iterator[tuple[str, float]]:
    """Yield each output with the median of its values over that of what it would be at the truth, where the truth says so."""
    if log.truth is None:
        return
    model = system.model
    states = np.full((len(log.samples.t), len(model.states)), np.nan)
    angles = tuple(signal.name for signal in model.states if signal.is_angle)
    for i, values in enumerate(log.truth.at(log.samples.t, angles).T):
        if log.truth.names[i] in model.state_names:
            states[:, model.state_names.index(log.truth.names[i])] = values
    at_truth = readings(system, states[None], _inputs_at(system, log))
    expected, spread = at_truth.y[0], at_truth.spread[0]
    for place, name in enumerate(log.samples.names):
        outputs = model.outputs_of.get(name, ())
        for column, output in enumerate(outputs):
            chosen = (log.samples.sensor == place) & np.isfinite(expected[:, output])
            if chosen.sum() >= FEWEST:
                ratio = _ratio(model.outputs[output], log.samples.y[chosen, column], expected[chosen, output], spread[chosen, output])
                yield model.outputs[output].name, ratio


def _ratio(output: Signal, values: np.ndarray, expected: np.ndarray, spread: np.ndarray) -> float:
    """Return how many times larger values (K,) of an output are than expected, 1 where they are as they should be, nan where none tells.

    Of angles, which wrap: by how much what fits far better as degrees is larger.
    """
    off = values - expected
    if output.is_angle:
        as_read, as_degrees = (float(np.median(np.abs(wrap(each)) / spread)) for each in (off, np.radians(values) - expected))
        return _FACTORS["degrees"] if as_read > max(_NOISE, _FAR * as_degrees) else 1.0
    if np.median(np.abs(off) / spread) <= _NOISE:
        return 1.0
    true = float(np.median(np.abs(expected)))
    return float(np.median(np.abs(values))) / true if true > 0 else float("nan")


def _require_speeds(file: Path, system: AbstractSystem, log: Log) -> None:
    """Raise InputError for a reading of a speed or a turn rate that no vehicle has, beside which all others are nothing."""
    if log.inputs is None:
        return
    units = {signal.name: signal.unit for signal in system.model.inputs}
    for name, values in zip(log.inputs.names, np.abs(log.inputs.u).T, strict=True):
        if units.get(name) not in ("m/s", "rad/s"):
            continue
        largest = float(np.nanmax(values, initial=0.0))
        usual = float(np.nanquantile(values, _USUAL)) if largest > _FASTEST else largest
        if largest > _FASTEST * max(usual, 1.0):
            raise InputError(
                f"{file}, column {name!r}: {largest:g} at t = {log.inputs.t[int(np.nanargmax(values))]:.9g} s, where"
                f" {100 * _USUAL:g} % of its numbers are below {usual:.3g}"
            )


def _sensor_columns(system: AbstractSystem) -> Iterator[tuple[str, AbstractSensor, int]]:
    """Yield what each sensor's samples are called, alone or with those of its group, and the column of its first output in them."""
    for group in system.groups if isinstance(system, System) else ():
        column = 0
        for sensor in group.sensors:
            yield group.name, sensor, column
            column += len(sensor.outputs)


def _require_lengths(file: Path, system: AbstractSystem, log: Log) -> None:
    """Raise InputError for a distance or a speed far below 0, by a sensor that has no bias to be told."""
    for name, sensor, column in _sensor_columns(system):
        if not isinstance(sensor, _LENGTHS) or sensor.bias is not None or name not in log.samples.names:
            continue
        chosen = log.samples.sensor == log.samples.names.index(name)
        values = log.samples.y[chosen, column]
        if len(values) and values.min() < -_BELOW * sensor.inflation * sensor.sigma:
            row = int(np.argmin(values))
            raise InputError(
                f"{file}, column {name!r}: {values[row]:g} at t = {log.samples.t[chosen][row]:.9g} s: what it measures is not below 0;"
                " where it had no answer leave the cell empty, or the row out"
            )


def _inputs_at(system: AbstractSystem, log: Log) -> np.ndarray:
    """The inputs (K, m) at the samples, nan where the log has none."""
    model, u = system.model, np.full((len(log.samples.t), len(system.model.inputs)), np.nan)
    if log.inputs is None or not model.inputs_in_outputs:
        return u
    for column, values in zip(log.inputs.names, log.inputs.at(log.samples.t).T, strict=True):
        if column in model.input_names:
            u[:, model.input_names.index(column)] = values
    return u
