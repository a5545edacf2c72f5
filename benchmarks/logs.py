"""Recorded runs at their own times: the filter from event to event, and whether the posterior tells hard stretches from easy ones.

The files are no part of the project: OBSDESIGN_LOGS names their folder, as for `recorded_runs`. Nothing is resampled. Standard
deviations, biases, scales and process noise are what `od.calibrate` makes of the first half of a run, with its truth or without;
before, each sensor is stated with a standard deviation of 1 m, the tags of the trolley with 0.1 m, and the lengths of wheels by hand.
"""

from __future__ import annotations

import csv
import os
import sys
import tempfile
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from time import process_time

import numpy as np
from scipy.stats import rankdata

import obsdesign as od
from benchmarks.recorded_runs import FOLDER
from benchmarks.tables import machine, table, write
from obsdesign.dynamics.per_step import PerStepSystem
from obsdesign.dynamics.process_noise import noise_of
from obsdesign.estimation.filter_bank import Belief, FilterBank
from obsdesign.logs.events import events_of
from obsdesign.study.recorded_tags import TagRanges, Trolley

WINDOW, RESTARTS = 10.0, 32  # s, filters per window
START_STD, WINDOW_STDS = (1.0, 1.0, 0.1), ((1.0, 1.0, 0.1), (3.0, 3.0, 0.3))  # of x, y and heading
_HALF_TRACK = 0.0785  # m, of the small robot; its columns of left and right are swapped


@dataclass(frozen=True, eq=False)
class Drive:
    """A recorded run, a system as it is stated, a prior of its beginning, and how long it took to read."""

    name: str
    system: od.System
    log: od.Log
    prior: od.Prior
    read_seconds: float

    @cached_property
    def fit(self) -> od.Calibration:
        """What its first half tells."""
        return od.calibrate(self.system, self.log.first(0.5), self.prior)


def main() -> None:
    """Write logs.md."""
    folder = os.environ.get(FOLDER)
    if not folder:
        sys.stdout.write(f"logs: {FOLDER} names no folder, nothing is written\n")
        return
    path = Path(folder)
    drives = [_plaza(path, 1), _plaza(path, 2), _labyrinth(path), _trolley(path)]
    text = ["# Recorded runs at their own times", "", __doc__ or "", machine(), "", _filters(drives), "", _rankings(drives[:2])]
    write("logs", "\n".join(text))


def _filters(drives: list[Drive]) -> str:
    rows = []
    for drive in drives:
        half = drive.log.first(0.5)
        for log in (half, od.Log(half.inputs, half.samples)):
            began = process_time()
            fit = od.calibrate(drive.system, log, drive.prior)
            fitted = process_time()
            estimate = od.estimate_log(fit.system, drive.log, drive.prior, disturbance_psd=fit.disturbance_psd, input_psd=fit.input_psd)
            seconds = drive.read_seconds, fitted - began, process_time() - fitted
            by = "truth" if log.truth is not None else "innovations"
            rows.append([drive.name, by, len(drive.log.samples.t), len(estimate.t) - 1, *_errors(drive.log, estimate), *seconds])
    header = ["run", "calibrated by", "samples", "steps", "RMSE, second half [m]", "RMSE [m]", "read [s]", "calibrate [s]", "filter [s]"]
    return table(header, rows)


def _errors(log: od.Log, estimate: od.Estimate) -> list[float]:
    """Return the root mean square position error over the second half, and over all [m]."""
    error = np.hypot(*(estimate.mean[:, :2] - log.truth.at(estimate.t)[:, :2]).T)
    return [float(np.sqrt(np.nanmean(values**2))) for values in (error[estimate.t > np.mean(log.span)], error)]


def _rankings(drives: list[Drive]) -> str:
    rows = []
    for drive in drives:
        for std in WINDOW_STDS:
            actual, *predicted = _windows(drive, std)
            correlations = [_rank_correlation(actual, values) for values in predicted]
            rows.append([drive.name, f"{std[0]:g} m, {std[2]:g} rad", len(actual), *correlations, _factor(actual, predicted[0])])
    header = ["run", "prior", "windows", "posterior", "Gramian and prior", "plain Gramian", "actual over predicted (median)"]
    intro = (
        "Rank correlation (Spearman) of predicted with actual position errors over windows of"
        f" {WINDOW:g} s with samples, the filter restarted in each from {RESTARTS} draws of a prior about the truth."
    )
    return f"{intro}\n\n{table(header, rows)}"


def _windows(drive: Drive, std: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return for each window the actual error, and what the posterior, the Gramian with the prior, and the Gramian alone predict [m]."""
    first, last = drive.log.truth.t[[0, -1]]
    results = []
    for begin in np.arange(first, last - WINDOW, WINDOW):
        part = drive.log.stretch(begin, begin + WINDOW) if _has_samples(drive.log, begin) else None
        if part is not None:
            results.append(_window(drive, part, begin, std))
    return tuple(np.array(column) for column in zip(*results, strict=True))


def _has_samples(log: od.Log, begin: float) -> bool:
    return bool(((log.samples.t >= begin) & (log.samples.t < begin + WINDOW)).any())


def _window(drive: Drive, part: od.Log, begin: float, std: tuple[float, ...]) -> tuple[float, float, float, float]:
    inner = part.inputs.t[part.inputs.t > begin + 1e-3]
    times = np.concatenate([[begin], inner])
    path = od.Trajectory(times, drive.log.truth.at(times, ("heading",)), drive.log.inputs.over(times))
    prior = od.Prior(path.x[0], std=std)
    fit = drive.fit
    J = od.posterior_information(fit.system, path, prior, fit.disturbance_psd, samples=part, input_psd=fit.input_psd)
    predicted = float(np.sqrt(np.mean([np.trace(np.linalg.inv(matrix)[:2, :2]) for matrix in J])))
    W = od.variational_gramian(fit.system, path, samples=part)
    with_prior = float(np.sqrt(np.trace(np.linalg.inv(prior.information + W.total)[:2, :2])))
    return _actual(drive, part, prior), predicted, with_prior, float(np.hypot(*W.std[:2]))


def _actual(drive: Drive, part: od.Log, prior: od.Prior) -> float:
    """Return the root mean square position error of filters that begin at draws of the prior."""
    system = drive.fit.system
    events = events_of(system, part)
    random = np.random.default_rng(0)
    starts = prior.mean + random.standard_normal((RESTARTS, 3)) * prior.std
    noise = noise_of(system.model, drive.fit.disturbance_psd, drive.fit.input_psd, 1.0)
    bank = FilterBank(PerStepSystem(system, has_arrived=True), 1.0, noise)
    initial = Belief(starts, np.tile(prior.covariance, (RESTARTS, 1, 1)))
    active = events.arrived[:, list(system.model.output_owner)]
    y = np.repeat(events.y[:, None], RESTARTS, axis=1)
    belief = bank.run(initial, events.rows, y, active)
    truth = drive.log.truth.at(events.t)[:, None, :2]
    return float(np.sqrt(np.nanmean(np.sum((belief.mean[..., :2] - truth) ** 2, axis=2))))


def _rank_correlation(first: np.ndarray, second: np.ndarray) -> float:
    return float(np.corrcoef(rankdata(first), rankdata(second))[0, 1])


def _factor(actual: np.ndarray, predicted: np.ndarray) -> float:
    return float(np.median(actual / predicted))


def _plaza(folder: Path, number: int) -> Drive:
    """A mower that ranges to four beacons; in the second run it drives backwards."""
    file = folder / f"plaza{number}.npz"
    beacons = np.load(file)["beacons"]
    system = _ranging({f"beacon_{int(name)}": (float(x), float(y)) for name, x, y in beacons})
    began = process_time()
    log = od.read_log(file, system)
    seconds = process_time() - began
    turned = np.array([0.0, 0.0, np.pi if number == 2 else 0.0])
    log = od.Log(log.inputs, log.samples, od.LogTruth(log.truth.names, log.truth.t, log.truth.x + turned))
    start = log.truth.at(np.array([max(log.span[0], log.truth.t[0])]), ("heading",))[0]
    return Drive(f"Plaza {number}", system, log, od.Prior(start, START_STD), seconds)


def _ranging(places: dict[str, tuple[float, float]]) -> od.System:
    return od.System(od.Unicycle(), tuple(od.Range(place, 1.0, name=name) for name, place in places.items()))


def _labyrinth(folder: Path) -> Drive:
    """A small robot of two wheels that ranges to four anchors; by a map of its table's columns."""
    file = folder / "uwb_labyrinth.csv"
    with file.open() as lines:
        places = {f"anchor_{row['anchor_id']}": (float(row["anchor_x_m"]), float(row["anchor_y_m"])) for row in csv.DictReader(lines)}
    wheels = 'topic = "table", fields = ["v_right_mps", "v_left_mps"]'
    rows = [
        f"[inputs]\nspeed = {{ {wheels}, weights = [0.5, 0.5] }}",
        f"turn_rate = {{ {wheels}, weights = [{-0.5 / _HALF_TRACK}, {0.5 / _HALF_TRACK}] }}\n[sensors]",
        *(f'{name} = {{ topic = "table", field = "range_m", where = {{ anchor_id = {name[7:]} }} }}' for name in places),
        '[truth]\nx = { topic = "table", field = "x_true_m" }\ny = { topic = "table", field = "y_true_m" }',
    ]
    with tempfile.TemporaryDirectory() as temporary:
        topics = Path(temporary) / "topics.toml"
        topics.write_text("\n".join(rows))
        began = process_time()
        log = od.read_log(file, _ranging(places), topics)
        seconds = process_time() - began
    start = np.append(log.truth.x[0], 0.0)  # heading is not in the file
    return Drive("Labyrinth", _ranging(places), log, od.Prior(start, (0.3, 0.3, 2.0)), seconds)


def _trolley(folder: Path) -> Drive:
    """A trolley without odometry, three tags that range to eight anchors."""
    file = folder / "lias_uwb_planar_fast.npz"
    arrays = np.load(file)
    tags = tuple(tuple(map(float, tag)) for tag in arrays["tags_body"] + [0.0, 0.0, float(np.median(arrays["pose"][:, 2]))])
    anchors = [tuple(map(float, anchor)) for anchor in arrays["anchors"]]
    system = od.System(Trolley(), tuple(TagRanges(anchor=a, tags=tags, sigma=0.1, name=f"anchor_{i}") for i, a in enumerate(anchors)))
    began = process_time()
    log = od.read_log(file, system)
    seconds = process_time() - began
    return Drive("LIAS", system, log, od.Prior(np.concatenate([log.truth.x[0], [0.0, 0.0]]), (0.1, 0.1, 0.1, 0.5, 0.5)), seconds)
