"""The instants of a schedule for the filter: those of a path, or those at which samples of a log came along it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from obsdesign.checks import as_array, require_positive, whole_multiple
from obsdesign.criteria.abstract import Over
from obsdesign.dynamics.model import AbstractSystem
from obsdesign.dynamics.per_step import system_along
from obsdesign.errors import InputError
from obsdesign.information.gramian import require_fit
from obsdesign.information.posterior import weights_of
from obsdesign.information.recorded_samples import recorded_samples
from obsdesign.logs.log import Log
from obsdesign.trajectory import Trajectory

_ON_A_STEP = 1e-6  # of a step: how far from one a boundary may be


@dataclass(frozen=True, eq=False)
class FilterPath:
    """A system as it is along a path, the path, how often the samples of sensors that are on count at its instants (N, S).

    nodes (M,): which of the instants are those of the path that was given, behind all samples of their time.
    """

    system: AbstractSystem
    path: Trajectory
    arrivals: np.ndarray
    nodes: np.ndarray


def filter_path(system: AbstractSystem, path: Trajectory, active: np.ndarray | None, log: Log | None) -> FilterPath:
    """Return the instants of a path, or with a log those of its samples; active: which sensors may have any, by steps of the path."""
    require_fit(system, path)
    if log is None:
        along = system_along(system, path, active is not None)
        return FilterPath(along, path, weights_of(along, path, active), np.arange(path.steps))
    arrived = recorded_samples(system, path, log)
    events = arrived.event_path
    arrivals = events.weights
    if active is not None:
        arrivals = arrivals * weights_of(arrived.system, path, active)[events.step]
    return FilterPath(arrived.system, events.path, arrivals, events.nodes[:-1])


def weights_over(over: Over, run: FilterPath) -> tuple[np.ndarray, bool]:
    """Return the weights of instants (N,), and whether the largest cost counts instead of their sum.

    The mean is over time; weights are given for the instants of the path.
    """
    steps = run.path.steps
    if isinstance(over, str):
        if over not in ("mean", "worst", "end"):
            raise InputError(f"over is {over!r}: must be 'mean', 'worst', 'end', or a weight for each of the {steps} instants with samples")
        if over == "end":
            return np.eye(steps)[-1], False
        if over == "worst":
            return np.ones(steps), True
        return np.full(steps, 1 / steps) if run.path.is_even else run.path.lengths / run.path.lengths.sum(), False
    weights, count = as_array("over", over), len(run.nodes)
    if weights.shape != (count,):
        raise InputError(f"over has shape {weights.shape}: must be ({count},), one weight for each instant with samples")
    if not (np.isfinite(weights).all() and (weights >= 0).all() and weights.any()):
        wrong = weights[~(np.isfinite(weights) & (weights >= 0))]
        shown = f"has the entry {wrong[0]:g}" if len(wrong) else "is 0 everywhere"
        raise InputError(f"over {shown}: weights must be finite numbers of at least 0, not all of them 0")
    every = np.zeros(steps)
    every[run.nodes] = weights
    return every, False


def segment_nodes(path: Trajectory, segment: float | Sequence[float]) -> np.ndarray:
    """Return where segments begin and end (K+1,), in steps: every `segment` seconds, the last may be shorter, or at given times.

    Along steps of any length a segment begins with the first instant at or after its time; one without an instant is none.
    """
    is_length = isinstance(segment, int | float) or np.ndim(segment) == 0
    if is_length:
        require_positive("segment", float(segment))  # pyright: ignore[reportArgumentType]
    if not path.is_even:
        return _uneven_nodes(path, np.arange(path.t[0], path.t[-1], float(segment)) if is_length else as_array("segment", segment))  # pyright: ignore[reportArgumentType]
    steps = path.steps
    if is_length:
        count = whole_multiple(float(segment), path.step)  # pyright: ignore[reportArgumentType]
        if count is None:
            raise InputError(f"segment is {segment!r} s: must be a whole multiple of the path's step ({path.step:g} s)")
        return np.append(np.arange(0, steps, count), steps)
    times = _require_times(as_array("segment", segment))
    nodes = (times - path.t[0]) / path.step
    whole = np.round(nodes).astype(int)
    off = np.abs(nodes - whole) > _ON_A_STEP
    if off.any():
        raise InputError(
            f"segment has the time {times[off][0]:g} s: must be at a step of the path (every {path.step:g} s from {path.t[0]:g} s)"
        )
    return _require_whole(path, times, whole)


def _uneven_nodes(path: Trajectory, times: np.ndarray) -> np.ndarray:
    """Return the first instants at or after times; the last segment ends with the path."""
    slack = _ON_A_STEP * path.lengths.mean()
    if len(times) > 1 and times[-1] >= path.t[-1] - slack:
        times = times[:-1]
    if not (times.ndim == 1 and np.isfinite(times).all() and abs(times[0] - path.t[0]) <= slack and (np.diff(times) > 0).all()):
        raise InputError(f"segment has times that do not rise from {path.t[0]:g} s, the path's first instant")
    nodes = np.searchsorted(path.t[:-1], times - slack)
    return np.append(np.unique(nodes[nodes < path.steps]), path.steps)


def _require_times(times: np.ndarray) -> np.ndarray:
    if times.ndim != 1 or len(times) < 2 or not np.isfinite(times).all():
        raise InputError(f"segment has shape {times.shape}: must be a length in seconds, or two or more times at which segments meet")
    return times


def _require_whole(path: Trajectory, times: np.ndarray, whole: np.ndarray) -> np.ndarray:
    falls = np.flatnonzero(np.diff(whole) <= 0)
    if falls.size:
        k = falls[0] + 1
        raise InputError(f"segment has the time {times[k]:g} s after {times[k - 1]:g} s: must rise")
    if whole[0] != 0 or whole[-1] != path.steps:
        raise InputError(f"segment goes from {times[0]:g} s to {times[-1]:g} s: must rise from {path.t[0]:g} s to {path.t[-1]:g} s")
    return whole
