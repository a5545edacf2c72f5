"""Information of windows that slide along a path: which stretches see the state, and which do not."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from obsdesign.arguments import validate_arguments
from obsdesign.checks import all_finite, require_count
from obsdesign.dynamics.model import AbstractSystem, Model
from obsdesign.dynamics.per_step import system_along
from obsdesign.dynamics.scan import Scan
from obsdesign.dynamics.simulation import all_inputs_along, substeps_along
from obsdesign.dynamics.step import CACHE_SIZE, blocks_of, dense_blocks, looped_step
from obsdesign.errors import InputError
from obsdesign.information.accumulation import Accumulator, accumulator_along
from obsdesign.information.correlated_noise import colour_of
from obsdesign.information.gramian import require_fit
from obsdesign.information.recorded_samples import RecordedSamples, recorded_samples
from obsdesign.information.sample_information import require_derivatives, require_finite_blocks, zero_unsampled
from obsdesign.logs.log import Log
from obsdesign.trajectory import Trajectory

_MAX_ENTRIES = 1 << 20  # numbers of the rows that are walked at once: 8 MB of doubles


@validate_arguments
def sliding_information(system: AbstractSystem, path: Trajectory, window: int, samples: Log | None = None) -> np.ndarray:
    """Return (N - window + 1, S, n, n): what the samples at t_k .. t_(k + window - 1) of sensor s say about x(t_k).

    Of two stretches, one after the other, (F, W) and (F', W'), the whole is (F' F, W + F'W'F): stretches of 1, 2, 4, ...
    steps are built for all k at once, so that the work grows as N log(window), and nothing is inverted. Where errors are not
    independent, each window is walked through by itself: a window knows nothing of the errors before it.

    Arguments:
        system: vehicle and sensors.
        path: the path along which samples are taken, of N steps.
        window: number of steps in a window, 1 to N.
        samples: a log, whose samples count that arrived, each at its own time; None = those that the sensors' rates promise.
    Raises InputError as variational_gramian, and unless 1 <= window <= N.
    """
    require_fit(system, path)
    recorded = None if samples is None else recorded_samples(system, path, samples, has_timed_errors=True)
    system = system_along(system, path, is_sampling_given=recorded is not None, has_timed_errors=recorded is not None)
    require_count("window", window, minimum=1, maximum=path.steps)
    window = int(window)  # whole numbers of NumPy do not know their bits
    if colour_of(system.model) is not None:
        return _accumulate_windows(system, path, window) if recorded is None else _accumulate_windows_of_log(recorded, window)
    arrived = None if recorded is None else recorded.local_blocks
    local = local_information(system, path)
    stretches = [local if arrived is None else (local[0], arrived)]  # of 1, 2, 4, ... steps
    for bit in range(window.bit_length() - 1):
        stretches.append(_concatenate(stretches[-1], stretches[-1], 1 << bit))
    combined, length = stretches[-1], 1 << (window.bit_length() - 1)
    for bit in range(window.bit_length() - 1):
        if window >> bit & 1:
            combined, length = _concatenate(combined, stretches[bit], length), length + (1 << bit)
    return _require_finite(path, combined[1][: path.steps - window + 1].copy())


def _accumulate_windows(system: AbstractSystem, path: Trajectory, window: int) -> np.ndarray:
    """The same by a walk along each window."""
    accumulator = accumulator_along(system.model, path.pace, substeps_along(system, path))
    rows = [path.x[:-1], all_inputs_along(system, path), *accumulator.sampling_rows(system, path.steps, path.pace)]
    places = np.arange(path.steps - window + 1)[:, None] + np.arange(window)
    windows = _sums_at(accumulator, rows, places)
    if not all_finite(windows):
        local_information(system, path)  # a landmark on the path, perhaps
    return _require_finite(path, windows)


def _accumulate_windows_of_log(recorded: RecordedSamples, window: int) -> np.ndarray:
    """The same through the instants of the samples in each window; where it has fewer than others, steps of no length without a sample."""
    events, system, steps = recorded.event_path, recorded.system, recorded.path.steps
    path, sampling = events.path, (events.weights > 0).astype(float)
    accumulator = accumulator_along(system.model, path.pace, substeps_along(system, path))
    rows = [path.x[:-1], all_inputs_along(system, path), sampling, sampling]
    silent = [np.vstack([values, values[-1:] if i == 0 else np.zeros((1, values.shape[1]))]) for i, values in enumerate(rows)]
    begins, ends = (np.searchsorted(events.step, np.arange(steps - window + 1) + shift) for shift in (0, window))
    places = begins[:, None] + np.arange(int(np.max(ends - begins)))
    windows = _sums_at(accumulator, silent, np.where(places < ends[:, None], places, path.steps))
    if not all_finite(windows):
        require_derivatives(system, path, events.weights > 0)
    return _require_finite(recorded.path, windows)


def _sums_at(accumulator: Accumulator, rows: list[np.ndarray], places: np.ndarray) -> np.ndarray:
    """Return the sums (W, S, n, n) of walks through rows (N, .) at places (W, L), each from a start of its own."""
    start, totals = np.concatenate([accumulator.start, np.zeros(len(accumulator.packing.rows))]), []
    count = max(1, _MAX_ENTRIES // (places.shape[1] * sum(values.shape[1] for values in rows)))
    for first in range(0, len(places), count):
        chosen = places[first : first + count]
        parts = [values[chosen] for values in rows]
        carry = accumulator.scan.run(np.tile(start, (len(chosen), 1)), parts, places.shape[1], carries=False).carry
        totals.append(accumulator.packing.full(carry[:, len(accumulator.start) :]))
    return np.concatenate(totals)


def _require_finite(path: Trajectory, windows: np.ndarray) -> np.ndarray:
    if not all_finite(windows):
        k = int(np.argwhere(~np.isfinite(windows))[0, 0])
        raise InputError(f"the information of the window at step {k} (t = {path.t[k]:g} s) is not finite: the system is too unstable")
    return windows


def local_information(system: AbstractSystem, path: Trajectory) -> tuple[np.ndarray, np.ndarray]:
    """Return F (N, n, n) and C'R^-1 C (N, S, n, n) of each sensor, 0 where there is no sample, at each step."""
    n = path.x.shape[1]
    rows = [path.x[:-1], all_inputs_along(system, path)]
    run = _local_scan(system.model, path.pace, substeps_along(system, path)).run(np.empty((1, 0)), rows, path.steps, carries=False)
    F, blocks = (values.reshape(path.steps, -1, n, n) for values in run.results)
    return F[:, 0].swapaxes(1, 2), require_finite_blocks(zero_unsampled(blocks, system, path.pace), system, path)


@lru_cache(CACHE_SIZE)
def _local_scan(model: Model, step: float, substeps: int) -> Scan:
    step_graph = looped_step(model, step, substeps)
    blocks = dense_blocks(blocks_of(model, ca.SX.eye(step_graph.x.numel())))
    return Scan(
        ca.SX(0, 1), [step_graph.x, step_graph.all_inputs], ca.SX(0, 1), [ca.vec(ca.densify(step_graph.F)), blocks], loop=step_graph.loop
    )


def _concatenate(first: tuple[np.ndarray, np.ndarray], second: tuple[np.ndarray, np.ndarray], steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Each stretch of `first`, `steps` long, followed by the one of `second` that begins where it ends."""
    F, W = first
    F_later, W_later = second[0][steps:], second[1][steps:]
    count = min(len(F), len(F_later))
    F, W, F_later, W_later = F[:count], W[:count], F_later[:count], W_later[:count]
    F_columns = F[:, None]
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is refused when all is joined
        return F_later @ F, W + F_columns.swapaxes(2, 3) @ W_later @ F_columns
