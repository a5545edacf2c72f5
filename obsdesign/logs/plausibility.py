"""Numbers that cannot be meant: degrees taken for radians, millimetres for metres. Told by comparing what a log says twice."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from obsdesign.dynamics.model import AbstractSystem
from obsdesign.dynamics.simulation import readings
from obsdesign.errors import InputError
from obsdesign.logs.log import Log

_FACTORS = {"thousandths or thousands": 1000.0, "degrees": 180 / np.pi}
_NEAR = 1.6  # how far a ratio may be from a factor to be taken for it
_MAX_ANGLE = 7.0  # no angle that wraps is larger [rad]
_FEWEST = 8  # values that a comparison needs
_NOISE = 5.0  # standard deviations within which readings are as they should be
_ALIKE = 0.5  # cosine of the angle between two histories that have something to do with each other


def require_plausible(file: Path, system: AbstractSystem, log: Log) -> None:
    """Raise InputError where numbers are off by a factor that a unit explains, with the column and the unit that would fit."""
    for column, ratio in (*_outputs(system, log), *_inputs(system, log)):
        for words, factor in _FACTORS.items():
            if _is_near(ratio, factor) or _is_near(ratio, 1 / factor):
                raise InputError(
                    f"{file}, column {column!r}: its numbers are {ratio:.3g} times what the truth and the system say: are they in"
                    f" {words}? Say so in the header, such as [deg] or [mm]"
                )
    for channel in system.model.channels:
        for place, signal in enumerate(channel.outputs):
            values = log.samples.y[log.samples.sensor == log.samples.names.index(channel.name), place]
            if signal.is_angle and len(values) >= _FEWEST and np.median(np.abs(values)) > _MAX_ANGLE:
                raise InputError(
                    f"{file}, column {signal.name!r}: half of its angles are beyond {np.median(np.abs(values)):.3g} rad: are they degrees?"
                    " Say so in the header, [deg]"
                )


def _is_near(ratio: float, factor: float) -> bool:
    return factor / _NEAR < ratio < factor * _NEAR


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
            if chosen.sum() < _FEWEST or model.outputs[output].is_angle:
                continue
            off = np.abs(log.samples.y[chosen, column] - expected[chosen, output])
            if np.median(off / spread[chosen, output]) > _NOISE:
                yield model.outputs[output].name, _ratio(log.samples.y[chosen, column], expected[chosen, output])


def _inputs_at(system: AbstractSystem, log: Log) -> np.ndarray:
    """The inputs (K, m) at the samples, nan where the log has none."""
    model, u = system.model, np.full((len(log.samples.t), len(system.model.inputs)), np.nan)
    if log.inputs is None or not model.inputs_in_outputs:
        return u
    for column, values in zip(log.inputs.names, log.inputs.at(log.samples.t).T, strict=True):
        if column in model.input_names:
            u[:, model.input_names.index(column)] = values
    return u


def _inputs(system: AbstractSystem, log: Log) -> Iterator[tuple[str, float]]:
    """Yield speed and turn rate with their integrals over what the truth says of way and heading."""
    if log.truth is None or log.inputs is None or len(log.truth.t) < _FEWEST:
        return
    truth, names = log.truth, log.truth.names
    times = np.linspace(truth.t[0], truth.t[-1], min(200, len(truth.t)))
    values = truth.at(times, ("heading",))
    for name, needed in (("speed", ("x", "y")), ("turn_rate", ("heading",))):
        if name in log.inputs.names and set(needed) <= set(names):
            changes = np.diff(values[:, [names.index(state) for state in needed]], axis=0)
            moved, size = log.inputs.integrals(times)[:, log.inputs.names.index(name)], changes[:, 0]
            if len(needed) > 1:  # of a way the length alone, of a turn the side as well
                moved, size = np.abs(moved), np.linalg.norm(changes, axis=1)
            is_known = np.isfinite(size)
            if is_known.sum() >= _FEWEST and _are_alike(moved[is_known], size[is_known]):
                yield name, _ratio(moved[is_known], size[is_known], of_sums=True)


def _are_alike(first: np.ndarray, second: np.ndarray) -> bool:
    """Whether two histories go up and down together, or against each other: noise does not."""
    return abs(float(first @ second)) > _ALIKE * float(np.linalg.norm(first) * np.linalg.norm(second))


def _ratio(values: np.ndarray, expected: np.ndarray, of_sums: bool = False) -> float:
    """Return how many times larger values are; nan where nothing is expected."""
    first, second = (float(np.sum(np.abs(v)) if of_sums else np.median(np.abs(v))) for v in (values, expected))
    return first / second if second > 0 else float("nan")
