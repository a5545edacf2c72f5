"""The samples of a log along a path, at their own times: where the path was then, and what each of them says."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from obsdesign.dynamics.channel import Channel
from obsdesign.dynamics.model import AbstractSystem, Model
from obsdesign.dynamics.per_step import PerStepSystem, held_columns, require_timed, require_uncorrelated
from obsdesign.dynamics.scan import Scan
from obsdesign.dynamics.simulation import inputs_along, join_inputs, readings, substeps_along
from obsdesign.dynamics.step import CACHE_SIZE, blocks_of, dense_blocks, looped_step
from obsdesign.errors import InputError
from obsdesign.logs.events import repeats, require_samples
from obsdesign.logs.log import Log
from obsdesign.trajectory import Trajectory, uneven_path_of

_SAME_TIME = 1e-9  # of a step: nearer to a node than that is at it


@dataclass(frozen=True, eq=False)
class RecordedSamples:
    """K samples of a log within a path, sorted by time: in which step (K,), how long after its beginning (K,) [s], of which sensor (K,).

    x (K, n): where the path was; F (K, n, n): dx there / dx at the beginning of the step; weight (K,): how often the sample counts, by
    its own standard deviation. system: the one given, with time counted in steps and no gates.
    """

    system: AbstractSystem
    path: Trajectory
    step: np.ndarray
    offset: np.ndarray
    sensor: np.ndarray
    x: np.ndarray
    F: np.ndarray
    weight: np.ndarray

    @property
    def local_blocks(self) -> np.ndarray:
        """What the samples from t_k to t_k+1 say about x(t_k) (N, S, n, n): F' C' R^-1 C F, summed."""
        model, n = self.system.model, self.path.x.shape[1]
        total = np.zeros((self.path.steps, len(model.channels), n, n))
        for s in np.unique(self.sensor):
            chosen = self.sensor == s
            x, F = self.x[chosen], self.F[chosen]
            u = np.zeros((len(x), len(model.inputs)))
            u[:, 1 + self.path.u.shape[1] :] = self.path.u[self.step[chosen]][:, held_columns(model)]
            blocks = _block_scan(model, int(s)).along(np.empty(0), x, u)[1].reshape(-1, n, n)
            blocks = self.weight[chosen][:, None, None] * (F.swapaxes(1, 2) @ blocks @ F)
            if not np.isfinite(blocks).all():
                j = int(np.argmax(~np.isfinite(blocks).all(axis=(1, 2))))
                t = self.path.t[self.step[chosen][j]] + self.offset[chosen][j]
                raise InputError(f"sensor {model.sensor_names[s]!r} has no derivative at t = {t:.9g} s: the path meets its landmark")
            np.add.at(total[:, s], self.step[chosen], blocks)
        return total

    @property
    def event_path(self) -> EventPath:
        """The path with instants at the samples as well."""
        return _event_path(self)


@dataclass(frozen=True, eq=False)
class EventPath:
    """A path through the nodes of another and the samples: how often each sensor's sample counts at each instant (M, S).

    step (M,): in which step of the other each instant is; nodes (N+1,): where the other's nodes are, behind all samples of their time.
    """

    path: Trajectory
    weights: np.ndarray
    step: np.ndarray
    nodes: np.ndarray


def recorded_samples(system: AbstractSystem, path: Trajectory, log: Log, *, has_timed_errors: bool = False) -> RecordedSamples:
    """Return the samples of a log from the first instant of a path to the last, that one not included.

    has_timed_errors: whether errors that are correlated in time may be so over times of any length.
    Raises InputError for sensors that are not the system's, for such errors unless they may, and where no sample is within the path.
    """
    (require_timed if has_timed_errors else require_uncorrelated)(system.model)
    samples, per_step = require_samples(system, log), PerStepSystem(system, has_arrived=True)
    lengths = np.diff(path.t)
    step = np.searchsorted(path.t, samples.t, side="right") - 1
    # what is a rounding before a node is at it
    nearest = np.clip(step + 1, 0, path.steps)
    step = np.where(np.abs(path.t[nearest] - samples.t) <= _tolerance(path, nearest), nearest, step)
    chosen = (step >= 0) & (step < path.steps)
    if not chosen.any():
        first, last = log.samples.t[[0, -1]]
        raise InputError(
            f"the log's samples are at t = {first:.9g} to {last:.9g} s, the path from {path.t[0]:.9g} to {path.t[-1]:.9g} s:"
            " none is along it; both must count time from the same instant"
        )
    step = step[chosen]
    offset = np.where(np.abs(samples.t[chosen] - path.t[step]) <= _tolerance(path, step), 0.0, samples.t[chosen] - path.t[step])
    sensor = np.array([system.model.sensor_names.index(name) for name in samples.names])[samples.sensor[chosen]]
    x, F = _states_within(per_step, path, step, offset, lengths)
    sigma = np.full(len(step), np.nan) if samples.sigma is None else samples.sigma[chosen]
    return RecordedSamples(per_step, path, step, offset, sensor, x, F, _weights(system, x, sensor, sigma))


def _tolerance(path: Trajectory, node: np.ndarray) -> np.ndarray:
    lengths = np.diff(path.t)[np.minimum(node, path.steps - 1)]
    return np.maximum(_SAME_TIME * lengths, 4 * np.finfo(float).eps * np.abs(path.t[node]))


def _states_within(
    per_step: AbstractSystem, path: Trajectory, step: np.ndarray, offset: np.ndarray, lengths: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return states (K, n) some time after the beginnings of steps, and their derivatives to these (K, n, n).

    x_k moved for that time by its inputs, with the share of what the model does not say of the whole step, x_k+1 - f(x_k, u_k).
    """
    along, n = uneven_path_of(path, path.t, path.x, path.u, path.w), path.x.shape[1]
    scan = _partial_scan(per_step.model, substeps_along(per_step, along))
    inputs = join_inputs(*inputs_along(per_step, along))
    share = offset / lengths[step]
    _, moved, F = scan.along(np.empty(0), path.x[step], inputs[step] * share[:, None])
    whole = scan.along(np.empty(0), path.x[:-1], inputs)[1]
    return moved + share[:, None] * (path.x[1:] - whole)[step], F.reshape(-1, n, n).swapaxes(1, 2)


@lru_cache(CACHE_SIZE)
def _partial_scan(model: Model, substeps: int) -> Scan:
    graph = looped_step(model, 1.0, substeps)
    return Scan(ca.SX(0, 1), [graph.x, graph.all_inputs], ca.SX(0, 1), [graph.x_next, ca.vec(ca.densify(graph.F))], loop=graph.loop)


@lru_cache(4 * CACHE_SIZE)
def _block_scan(model: Model, sensor: int) -> Scan:
    """X -> C' R^-1 C (n n,) of one sensor."""
    single = model.only([model.sensor_names[sensor]])
    return Scan(ca.SX(0, 1), [model.x, single.u], ca.SX(0, 1), [dense_blocks(blocks_of(single, ca.SX.eye(model.x.numel())))])


def _weights(system: AbstractSystem, x: np.ndarray, sensor: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Return how often each sample counts (K,): (spread / sigma)^2 where the log says how exact it is, else once."""
    weight, is_told = np.ones(len(sensor)), np.isfinite(sigma)
    if not is_told.any():
        return weight
    spread = readings(system, x[None, is_told], np.zeros((int(is_told.sum()), len(system.model.inputs)))).spread[0]
    for j, s in enumerate(sensor[is_told]):
        channel = system.model.channels[s]
        require_single_spread(system.model, channel)
        outputs = system.model.outputs_of[channel.name]
        weight[np.flatnonzero(is_told)[j]] = (spread[j, outputs[0]] / sigma[is_told][j]) ** 2
    return weight


def require_single_spread(model: Model, channel: Channel) -> None:
    """Raise InputError for a sensor whose errors are not told by one standard deviation of a sample."""
    is_joint = any(channel.name in group.sensors for group in model.joint)
    if not channel.noise.is_white or is_joint or len({signal.unit for signal in channel.outputs}) > 1:
        raise InputError(
            f"log: a sample of {channel.name!r} has a sigma of its own: that is accepted for sensors whose outputs have one unit and"
            " independent errors"
        )


def _event_path(samples: RecordedSamples) -> EventPath:
    """Put an instant after each node for each time at which something arrives, so that no sensor has two samples at one instant."""
    path, model = samples.path, samples.system.model
    # rows: nodes first, then samples; at equal times nodes come first
    order = np.lexsort((samples.sensor, samples.offset, samples.step))
    step, offset, sensor = samples.step[order], samples.offset[order], samples.sensor[order]
    rank = repeats(step, offset, sensor)
    instants, place = np.unique(np.column_stack([step, offset, rank]), axis=0, return_inverse=True)
    starts = np.column_stack([np.arange(path.steps), np.zeros((path.steps, 2))])
    every, index = np.unique(np.concatenate([starts, instants]), axis=0, return_inverse=True)
    index = index.ravel()
    at_sample = index[path.steps :][place.ravel()]
    k = every[:, 0].astype(int)
    x = path.x[k].copy()
    x[at_sample] = samples.x[order]
    t = np.append(path.t[k] + every[:, 1], path.t[-1])
    weights = np.zeros((len(k), len(model.channels)))
    weights[at_sample, sensor] = samples.weight[order]
    w = None if path.w is None else path.w[k]
    event_path = uneven_path_of(path, t, np.vstack([x, path.x[-1:]]), path.u[k], w)
    is_at_node = every[:, 1] == 0
    last = np.searchsorted(k[is_at_node], np.arange(path.steps), side="right") - 1
    nodes = np.append(np.flatnonzero(is_at_node)[last], len(k))
    return EventPath(event_path, weights, k, nodes)
