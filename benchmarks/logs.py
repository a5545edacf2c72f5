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

import obsdesign as od
from benchmarks.recorded_runs import FOLDER
from benchmarks.tables import machine, table, write
from obsdesign.report.replay_document import document_of_log
from obsdesign.report.replay_folder import write_replay
from obsdesign.scenario.loading import load_scenario_of_log
from obsdesign.scenario.log_defaults import read_landmarks
from obsdesign.study.log_setup import LogSetup, file_setup, scenario_setup
from obsdesign.study.log_study import study_log
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
    text = [
        "# Recorded runs at their own times",
        "",
        __doc__ or "",
        machine(),
        "",
        _filters(drives),
        "",
        _rankings(drives[:2]),
        "",
        _answers(path),
    ]
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
            fit, prior = drive.fit, od.Prior(drive.prior.mean, std)
            psds = {"disturbance_psd": fit.disturbance_psd, "input_psd": fit.input_psd}
            run = od.replay(fit.system, drive.log, prior, along="truth", restarts=RESTARTS, window=WINDOW, **psds)
            best, *others = run.rank_correlation, run.rank_correlation_own, run.rank_correlation_plain
            interval = f"{best.low:.2f} to {best.high:.2f}"
            start = f"{std[0]:g} m, {std[2]:g} rad"
            values = [best.windows, best.value, interval, *(rank.value for rank in others), run.ratio]
            rows.append([drive.name, start, *values])
    header = ["run", "prior", "windows", "posterior", "its 95 %", "filter's own", "plain Gramian", "actual over predicted (median)"]
    intro = (
        "Rank correlation (Spearman) of predicted with actual position errors over windows of"
        f" {WINDOW:g} s with samples, the filter restarted in each from {RESTARTS} draws of a prior about the truth: `od.replay`."
    )
    return f"{intro}\n\n{table(header, rows)}"


def _answers(folder: Path) -> str:
    """What `obsdesign replay` makes of each file, page included; only the small robot needs a scenario."""
    rows = []
    with tempfile.TemporaryDirectory() as temporary:
        setups = [lambda name=name: file_setup(folder / name) for name in ("plaza1.npz", "plaza2.npz", "lias_uwb_planar_fast.npz")]
        for setup in (*setups, lambda: _labyrinth_setup(folder, Path(temporary))):
            began = process_time()
            study = study_log(setup(), 0)
            write_replay(Path(temporary) / "out", study, document_of_log(study))
            run, errors = study.replay, {each.name: each.rmse for each in study.schedule_errors}
            values = (
                run.rmse_second_half,
                run.rmse,
                run.rank_correlation.value,
                run.rank_correlation_own.value,
                run.rank_correlation_plain.value,
            )
            counts = run.rejections, f"{len(run.hidden_windows)} of {len(run.windows)}"
            names = ("all on", "chosen", "round robin", "random, median", "random, best")
            rows.append([study.setup.title, *values, *counts, *(errors[name] for name in names), process_time() - began])
    header = [
        *("run", "RMSE, second half [m]", "RMSE [m]", "Spearman: posterior", "filter's own", "plain Gramian", "rejected", "not all seen"),
        *("all on [m]", "chosen [m]", "round robin [m]", "random [m]", "best random [m]", "CPU [s]"),
    ]
    intro = (
        "`obsdesign replay FILE --out DIR`: calibrated on the first half, windows restarted, one sensor at a time for 10 s in the"
        " schedules, page written. An error is that of one run: where one distance at a time is known and the heading is not, as where the"
        " small robot begins, a filter follows the robot or its mirror image, and chance says which."
    )
    return f"{intro}\n\n{table(header, rows)}"


def _labyrinth_setup(folder: Path, temporary: Path) -> LogSetup:
    """The scenario that a user would write for the small robot."""
    file = folder / "uwb_labyrinth.csv"
    places = _anchors(file)
    (temporary / "topics.toml").write_text(_topics(places))
    (temporary / "landmarks.csv").write_text("name,x,y\n" + "".join(f"{name},{x},{y}\n" for name, (x, y) in places.items()))
    (temporary / "robot.toml").write_text(
        'title = "Labyrinth"\n[vehicle]\nkind = "unicycle"\n[[sensors]]\nkind = "range"\nsigma = 1.0\n'
        '[prior]\nx = 0.3\ny = 0.3\nheading = 2.0\n[replay]\ntopics = "topics.toml"\nwindow = 5.0\n[time]\nsegment = 5.0\n'
    )
    scenario = load_scenario_of_log(temporary / "robot.toml", read_landmarks(temporary / "landmarks.csv"))
    return scenario_setup(file, scenario, None)


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


def _anchors(file: Path) -> dict[str, tuple[float, float]]:
    with file.open() as lines:
        return {f"anchor_{row['anchor_id']}": (float(row["anchor_x_m"]), float(row["anchor_y_m"])) for row in csv.DictReader(lines)}


def _topics(places: dict[str, tuple[float, float]]) -> str:
    """The map of the table's columns."""
    wheels = 'topic = "table", fields = ["v_right_mps", "v_left_mps"]'
    rows = [
        f"[inputs]\nspeed = {{ {wheels}, weights = [0.5, 0.5] }}",
        f"turn_rate = {{ {wheels}, weights = [{-0.5 / _HALF_TRACK}, {0.5 / _HALF_TRACK}] }}\n[sensors]",
        *(f'{name} = {{ topic = "table", field = "range_m", where = {{ anchor_id = {name[7:]} }} }}' for name in places),
        '[truth]\nx = { topic = "table", field = "x_true_m" }\ny = { topic = "table", field = "y_true_m" }',
    ]
    return "\n".join(rows)


def _labyrinth(folder: Path) -> Drive:
    """A small robot of two wheels that ranges to four anchors; by a map of its table's columns."""
    file = folder / "uwb_labyrinth.csv"
    places = _anchors(file)
    with tempfile.TemporaryDirectory() as temporary:
        topics = Path(temporary) / "topics.toml"
        topics.write_text(_topics(places))
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
