"""Recorded runs on a grid: Plaza 1 and 2 (a mower that ranges to four beacons), LIAS (a trolley with three tags and eight anchors).

The files are not part of the project: OBSDESIGN_LOGS names the folder in which plaza1.npz, plaza2.npz and lias_uwb_planar_fast.npz stand.
Sources: Djugash, Hamner, Roth, J. Field Robotics 2009, as in gtsam (borglab); LIAS-CUHKSZ, (c) 2023 Haodong Jiang, MIT.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import obsdesign as od
from obsdesign.estimation.filter_bank import Belief, FilterBank
from obsdesign.study.recorded_tags import TagRanges, Trolley

FOLDER = "OBSDESIGN_LOGS"
RANGE_SCALE = 1.0695  # the radios of Plaza read so much long
LEAST_HEADING_PSD = 1e-6  # rad^2/s: the true heading of Plaza 1 is its gyro's own, so that no error of it can be seen
_TROLLEY_PSD = (3e-3, 3e-3, 1e-3, 0.02, 0.06)  # slip, and what changes speed and turn rate
_TROLLEY_INFLATION = 3.0  # its errors are correlated: with all anchors on the filter errs by as much as it says


@dataclass(frozen=True, eq=False)
class RecordedRun:
    """N steps of a grid: a model, the true path with the inputs that were read, and which samples arrived.

    y (N, q) the outputs, active (N, S) where they are there; psd (n,) of the process noise.
    """

    name: str
    system: od.System
    path: od.Trajectory
    prior: od.Prior
    psd: tuple[float, ...]
    y: np.ndarray
    active: np.ndarray

    def segment_of_step(self, length: float) -> np.ndarray:
        """Return the segment (N,) that each step is in, segments of `length` seconds, the last one shorter."""
        return np.floor((self.path.t[:-1] - self.path.t[0]) / length + 1e-9).astype(int)


def recorded_runs() -> list[RecordedRun]:
    """Return the runs of the folder that OBSDESIGN_LOGS names; none where it names none."""
    folder = os.environ.get(FOLDER)
    return [] if not folder else [_plaza(Path(folder), 1, 0.2), _plaza(Path(folder), 2, 0.1), _lias(Path(folder))]


def position_errors(run: RecordedRun, chosen: np.ndarray, segment: np.ndarray) -> np.ndarray:
    """Return the root mean square position error (B,) [m] of an EKF on the log with the sensors of schedules (B, K, S) alone."""
    active = run.active[:, None] & np.swapaxes(chosen, 0, 1)[segment]
    owner = list(run.system.model.output_owner)
    start = Belief(np.tile(run.prior.mean, (len(chosen), 1)), np.tile(run.prior.covariance, (len(chosen), 1, 1)))
    kalman = FilterBank(run.system, run.path.step, np.diag(run.psd) * run.path.step)
    belief = kalman.run(start, run.path.u, np.repeat(run.y[:, None], len(chosen), axis=1), active[:, :, owner])
    error = belief.mean[:-1, :, :2] - run.path.x[:-1, None, :2]
    return np.sqrt(np.sum(error**2, axis=2).mean(axis=0))


def _plaza(folder: Path, number: int, step: float) -> RecordedRun:
    """Odometry adds up to the grid, ranges go to the nearest instant; of two on one instant the second is dropped."""
    log = np.load(folder / f"plaza{number}.npz")
    t = _grid(log["gt"][:, 0], step)
    turned = np.pi if number == 2 else 0.0  # Plaza 2 drives backwards
    truth = _interpolated(t, log["gt"][:, 0], np.column_stack([log["gt"][:, 1:3], np.unwrap(log["gt"][:, 3]) + turned]))
    travelled = np.vstack([np.zeros(2), np.cumsum(log["odom"][:, 1:], axis=0)])
    u = np.diff(_interpolated(t, np.append(t[0], log["odom"][:, 0]), travelled), axis=0) / step
    y, active = _on_grid(t, log["ranges"], list(log["beacons"][:, 0]))
    beacons = [(float(x), float(y)) for x, y in log["beacons"][:, 1:]]
    sigma = _spread_of(y - _distances(truth[:-1], beacons), active)
    system = od.System(od.Unicycle(), tuple(od.Range(beacon, sigma, name=f"beacon_{i}") for i, beacon in enumerate(beacons)))
    path = od.Trajectory(t - t[0], truth, u)
    return RecordedRun(f"Plaza {number}", system, path, od.Prior(truth[0], (1.0, 1.0, 0.1)), _odometry_psd(path), y, active)


def _lias(folder: Path) -> RecordedRun:
    """A trolley without odometry; speed and turn rate of the path are those of the motion capture, over one second."""
    log, step = np.load(folder / "lias_uwb_planar_fast.npz"), 0.05
    t = _grid(log["t"], step)
    pose = _interpolated(t, log["t"], np.column_stack([log["pose"][:, :2], np.unwrap(log["pose"][:, 3])]))
    rates = _moving_average(np.gradient(pose, step, axis=0), round(1 / step))
    speed = rates[:, 0] * np.cos(pose[:, 2]) + rates[:, 1] * np.sin(pose[:, 2])
    states = np.column_stack([pose, speed, rates[:, 2]])
    ranges = log["ranges"] - log["range_bias_median"]
    y, active = np.zeros((len(t) - 1, ranges[0].size)), np.zeros((len(t) - 1, len(log["anchors"])), dtype=bool)
    for k, row in zip(_instants(t, log["t"]), ranges, strict=True):
        if k < len(y) and not active[k].any():
            y[k], active[k] = np.nan_to_num(row).ravel(), np.isfinite(row).all(axis=1)
    tags = tuple(tuple(map(float, tag)) for tag in log["tags_body"] + [0.0, 0.0, float(np.median(log["pose"][:, 2]))])
    anchors = [tuple(map(float, anchor)) for anchor in log["anchors"]]
    sensors = (TagRanges(anchor=a, tags=tags, sigma=0.065, inflation=_TROLLEY_INFLATION, name=f"anchor_{i}") for i, a in enumerate(anchors))
    path = od.Trajectory(t - t[0], states, np.zeros((len(y), 0)))
    prior = od.Prior(states[0], (0.1, 0.1, 0.1, 0.5, 0.5))
    return RecordedRun("LIAS", od.System(Trolley(), tuple(sensors)), path, prior, _TROLLEY_PSD, y, active)


def _grid(t: np.ndarray, step: float) -> np.ndarray:
    return t[0] + step * np.arange(int((t[-1] - t[0]) / step) + 1)


def _instants(grid: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Return the index of the nearest instant of an even grid for each of the times."""
    return np.rint((t - grid[0]) / (grid[1] - grid[0])).astype(int)


def _interpolated(t: np.ndarray, at: np.ndarray, values: np.ndarray) -> np.ndarray:
    return np.column_stack([np.interp(t, at, column) for column in values.T])


def _moving_average(values: np.ndarray, width: int) -> np.ndarray:
    padded = np.pad(values, ((width // 2, width - 1 - width // 2), (0, 0)), mode="edge")
    return np.lib.stride_tricks.sliding_window_view(padded, width, axis=0).mean(axis=-1)


def _on_grid(t: np.ndarray, ranges: np.ndarray, beacons: list[float]) -> tuple[np.ndarray, np.ndarray]:
    """Return ranges y (N, S) [m], and where there is one (N, S), of rows (t, antenna, beacon, range)."""
    y, active = np.zeros((len(t) - 1, len(beacons))), np.zeros((len(t) - 1, len(beacons)), dtype=bool)
    for k, row in zip(_instants(t, ranges[:, 0]), ranges, strict=True):
        s = beacons.index(row[2])
        if k < len(y) and not active[k, s]:
            y[k, s], active[k, s] = row[3] / RANGE_SCALE, True
    return y, active


def _distances(states: np.ndarray, beacons: list[tuple[float, float]]) -> np.ndarray:
    return np.hypot(*(states[:, None, i] - np.array(beacons)[:, i] for i in (0, 1)))


def _spread_of(residuals: np.ndarray, active: np.ndarray) -> float:
    """Return a standard deviation by the median absolute deviation over the first half."""
    half = len(residuals) // 2
    values = residuals[:half][active[:half]]
    return float(1.4826 * np.median(np.abs(values - np.median(values))))


def _odometry_psd(path: od.Trajectory, length: float = 10.0) -> tuple[float, float, float]:
    """Return the psd of x, y and heading: mean squares, over the first half, of how far dead reckoning is off after ten seconds."""
    width = round(length / path.step)
    errors = np.array([_dead_reckoned(path, k, k + width) - path.x[k + width] for k in range(0, path.steps // 2 - width, width)])
    mean_squares = np.mean(errors**2, axis=0) / length
    position = float(mean_squares[:2].mean())
    return position, position, max(float(mean_squares[2]), LEAST_HEADING_PSD)


def _dead_reckoned(path: od.Trajectory, first: int, last: int) -> np.ndarray:
    """Return the pose at t[last] by the inputs, from the true one at t[first]."""
    speed, turn_rate = path.u[first:last].T
    heading = path.x[first, 2] + path.step * np.concatenate([[0.0], np.cumsum(turn_rate)])
    middle = heading[:-1] + path.step / 2 * turn_rate
    moved = path.step * np.column_stack([speed * np.cos(middle), speed * np.sin(middle)]).sum(axis=0)
    return np.append(path.x[first, :2] + moved, heading[-1])


def described(runs: list[RecordedRun]) -> Iterator[str]:
    """Yield what each run is, in a line."""
    for run in runs:
        psd = ", ".join(f"{value:.2g}" for value in run.psd)
        share = int(run.active.sum())
        yield f"{run.name}: {run.path.steps} steps of {run.path.step:g} s, {run.active.shape[1]} sensors, {share} samples, psd ({psd})"
