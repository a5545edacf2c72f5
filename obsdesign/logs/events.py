"""The instants at which something happens in a log: steps between samples and readings, as a filter walks through them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.arguments import validate_arguments
from obsdesign.checks import require_known, require_positive
from obsdesign.dynamics.model import AbstractSystem, Model
from obsdesign.errors import InputError
from obsdesign.logs.log import Log
from obsdesign.logs.samples import LogSamples

_SAME_TIME = 1e-9  # seconds that are no time at all
_MAX_LENGTHENING = 64.0  # a step is at most so many times as long as half of them are, or as long as they are on average


@dataclass(frozen=True, eq=False)
class Events:
    """N steps from event to event: a system's inputs over each, and the samples at its beginning.

    Several samples of one sensor at one time stand on instants of their own, with steps of length 0 between them.
    """

    t: np.ndarray
    """Instants (N+1,) [s], none before the other."""
    increments: np.ndarray
    """Integrals (N, m) of the known inputs over the steps."""
    held: np.ndarray
    """Known inputs (N, r) that outputs contain, as they are at the beginnings of the steps."""
    y: np.ndarray
    """Outputs (N, q), 0 where there is no sample."""
    arrived: np.ndarray
    """Which sensors have a sample (N, S), bool."""
    sigma: np.ndarray
    """Standard deviation (N, S) of the samples by the log, nan where it says none."""
    shifts: np.ndarray
    """By how much each of the K samples was moved to its instant (K,) [s]: 0 without a grid."""

    @property
    def lengths(self) -> np.ndarray:
        """Lengths (N,) of the steps [s]."""
        return np.diff(self.t)

    @property
    def u(self) -> np.ndarray:
        """Mean inputs (N, m) over the steps, 0 over steps of length 0."""
        dt = self.lengths[:, None]
        return np.where(dt > 0, self.increments / np.where(dt > 0, dt, 1.0), 0.0)

    @property
    def rows(self) -> np.ndarray:
        """(dt, dt u), and u where outputs contain it (N, 1 + m + r), the known inputs where time is counted in steps."""
        return np.column_stack([self.lengths, self.increments, self.held])


@validate_arguments
def events_of(system: AbstractSystem, log: Log, step: float | None = None) -> Events:
    """Return the steps between all samples and readings of a log, or those of a grid.

    Steps that are far longer than others are cut, so that none needs many sub-steps; at most twice as many come of it. The last step
    has no sample at its end: half of the steps are as long as that one, or longer.

    Arguments:
        system: vehicle and sensors; sensors that the log does not know have no samples.
        log: the recorded run.
        step: length of the steps of a grid [s], to which samples are moved; None = no grid, nothing is moved.
    Raises InputError for sensors and inputs of other names, and for samples of another number of outputs.
    """
    samples, model = require_samples(system, log), system.model
    first, last = log.span
    times = _event_times(log, samples) if step is None else _grid(first, last, step)
    node = np.searchsorted(times, samples.t + _tolerance(times), side="right") - 1
    if step is not None:
        node = np.clip(np.rint((samples.t - times[0]) / step).astype(int), 0, len(times) - 1)
    shifts = times[node] - samples.t
    instant, counts = _own_instants(node, samples.sensor, len(times))
    t = np.append(np.repeat(times, counts), times[-1] + _last_length(times))
    y, arrived = np.zeros((len(t) - 1, len(model.outputs))), np.zeros((len(t) - 1, len(model.channels)), dtype=bool)
    sigma = np.full(arrived.shape, np.nan)
    for place, name in enumerate(samples.names):
        chosen = samples.sensor == place
        s, outputs = model.sensor_names.index(name), list(model.outputs_of[name])
        y[instant[chosen][:, None], outputs] = samples.y[chosen, : len(outputs)]
        arrived[instant[chosen], s] = True
        sigma[instant[chosen], s] = np.nan if samples.sigma is None else samples.sigma[chosen]
    return Events(t, input_integrals(model, log, t), _held_inputs(model, log, t[:-1]), y, arrived, sigma, shifts)


def require_samples(system: AbstractSystem, log: Log) -> LogSamples:
    """Return the samples of the system's sensors, or raise InputError for names and numbers of outputs that are not the system's."""
    model = system.model
    counts = log.samples.counts
    require_known("log: samples: the system", [name for name in log.samples.names if counts[name]], model.sensor_names)
    used = tuple(name for name in log.samples.names if counts[name])
    places = np.array([used.index(name) if name in used else -1 for name in log.samples.names])
    for place, name in enumerate(log.samples.names):
        count = len(model.outputs_of[name]) if name in used else 0
        values = log.samples.y[log.samples.sensor == place]
        if len(values) and (values.shape[1] < count or np.isnan(values[:, :count]).any() or np.isfinite(values[:, count:]).any()):
            row = int(np.argmax(np.isfinite(values).sum(axis=1) != count))
            raise InputError(
                f"log: a sample of {name!r} at t = {log.samples.t[log.samples.sensor == place][row]:.9g} s has"
                f" {int(np.isfinite(values[row]).sum())} values: the sensor has {count} outputs"
            )
    return LogSamples(used, log.samples.t, places[log.samples.sensor], log.samples.y, log.samples.sigma)


def input_integrals(model: Model, log: Log, t: np.ndarray) -> np.ndarray:
    """Return the integrals (N, m) of the system's inputs over the steps between t (N+1,), or raise InputError where one is missing."""
    if not model.inputs:
        return np.zeros((len(t) - 1, 0))
    names = () if log.inputs is None else log.inputs.names
    for name in model.input_names:
        if log.inputs is None or name not in names:
            raise InputError(f"log: there is no input {name!r}: the system moves by {', '.join(model.input_names)}; the log has {names}")
    require_known("log: inputs: the system", names, model.input_names)
    integrals = log.inputs.integrals(t)  # pyright: ignore[reportOptionalMemberAccess]
    return integrals[:, [names.index(name) for name in model.input_names]]


def _held_inputs(model: Model, log: Log, t: np.ndarray) -> np.ndarray:
    """Return the inputs (N, r) that outputs contain, from the times t (N,) on."""
    if log.inputs is None or not model.inputs_in_outputs:
        return np.zeros((len(t), 0))
    return log.inputs.at(t)[:, [log.inputs.names.index(model.input_names[i]) for i in model.inputs_in_outputs]]


def _tolerance(times: np.ndarray) -> float:
    return max(_SAME_TIME, 4 * float(np.finfo(float).eps * np.abs(times[[0, -1]]).max()))


def _event_times(log: Log, samples: LogSamples) -> np.ndarray:
    """Return all times of samples and readings, once each, and between far ones some more."""
    times = np.unique(samples.t if log.inputs is None else np.concatenate([samples.t, log.inputs.t]))
    times = times[np.append(True, np.diff(times) > _tolerance(times))]
    lengths = np.diff(times)
    if not len(lengths):
        return times
    # no shorter than the mean: samples a microsecond apart would make millions of steps
    longest = max(_MAX_LENGTHENING * np.median(lengths), np.mean(lengths))
    pieces = np.ceil(lengths / longest).astype(int)
    if (pieces == 1).all():
        return times
    parts = [np.linspace(times[k], times[k + 1], pieces[k] + 1)[:-1] for k in range(len(lengths))]
    return np.append(np.concatenate(parts), times[-1])


def _last_length(times: np.ndarray) -> float:
    return float(np.median(np.diff(times))) if len(times) > 1 else 1.0


def _grid(first: float, last: float, step: float) -> np.ndarray:
    require_positive("step", step)
    return first + step * np.arange(int((last - first) / step + 0.5) + 1)


def repeats(*columns: np.ndarray) -> np.ndarray:
    """Return the how many-th of equal ones each row of sorted columns (K,) is (K,), from 0."""
    is_new = np.append(True, (np.diff(np.stack(columns), axis=1) != 0).any(axis=0))
    starts = np.flatnonzero(is_new)
    return np.arange(len(is_new)) - np.repeat(starts, np.diff(np.append(starts, len(is_new))))


def _own_instants(node: np.ndarray, sensor: np.ndarray, nodes: int) -> tuple[np.ndarray, np.ndarray]:
    """Return for each sample its instant (K,), and how many instants each node needs, so that no sensor has two samples on one."""
    order = np.lexsort((sensor, node))
    rank = repeats(node[order], sensor[order])
    counts = np.ones(nodes, dtype=int)
    np.maximum.at(counts, node[order], rank + 1)
    instant = np.empty(len(order), dtype=int)
    instant[order] = (np.cumsum(counts) - counts)[node[order]] + rank
    return instant, counts
