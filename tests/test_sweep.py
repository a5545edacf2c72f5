"""Truths about sweeps: each run is what running its scenario says; nothing is repeated, nothing is lost, what fails is recorded."""

from __future__ import annotations

import csv
import io
import json
import os
import re
import runpy
import signal
import subprocess
import sys
import time
from concurrent.futures import BrokenExecutor, Executor, Future
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, obsdesign
from distributed import LocalCluster
from hypothesis import given, settings
from hypothesis import strategies as st

import obsdesign as od
from obsdesign.cli import main
from obsdesign.report.sweep_figures.small_multiples import Panel
from obsdesign.report.to_document import document_of
from obsdesign.sweeps import run_file
from obsdesign.sweeps.execution import LostWorkersError
from obsdesign.sweeps.headline import headline
from obsdesign.sweeps.page import best_of_both, competing, sweep_page, write_sweep
from obsdesign.sweeps.run_file import compute, read_answer, task_of, write_answer
from obsdesign.sweeps.variation import combinations_of, varied_data

YARD = """
title = "Rover <in> a yard"
question = "Where am I?"
vehicle = {kind = "unicycle"}
sensors = [{kind = "gps", sigma = 0.5}, {kind = "magnetometer", sigma_deg = 10.0}]
start = {x = 0.0, y = 0.0, heading_deg = 20.0}
prior = {x = 2.0, y = 2.0, heading = 0.2}
process_noise = {heading = 0.01}
time = {duration = 6.0, step = 1.0, segment = 6.0}
validation = {runs = 5}
[[paths]]
name = "bend"
legs = [{seconds = 6, inputs = {speed = 1.0, turn_rate = 0.1}}]
"""
DESIGNED = (
    YARD.split("[[paths]]", maxsplit=1)[0]
    + """
[design]
starts = 1
path = {kind = "piecewise_constant", pieces = 3}
bounds = {turn_rate = [-0.5, 0.5], speed = [0.2, 1.0]}
constraints = [{kind = "goal", point = [3.0, 1.0], tolerance = 1.5}]
"""
)
LINES = ("a\rb", 'a\nb,"c"', "a\r\nb", "")
VARY = {"sensors.gps.sigma": [0.5, 1.0], "seed": range(2)}


def scenario_of(folder: Path, text: str = YARD) -> od.Scenario:
    file = folder / "yard.toml"
    file.write_text(text)
    return od.load_scenario(file)


@pytest.fixture
def yard(tmp_path: Path) -> od.Scenario:
    return scenario_of(tmp_path)


def contents(folder: Path) -> dict[str, dict[str, object]]:
    """What the files of the runs hold, but for the seconds that they took."""
    files = {file.name: json.loads(file.read_text()) for file in sorted((folder / "runs").glob("*.json"))}
    for data in files.values():
        if data["result"] is not None:
            data["result"].pop("timings")
    return files


# ---------------------------------------------------------------- what is run


def test_each_run_is_the_study_of_the_scenario_with_these_values(yard: od.Scenario, tmp_path: Path):
    done = od.sweep(yard, VARY)
    assert [tuple(run.varied.values()) for run in done.runs] == [(0.5, 0), (0.5, 1), (1.0, 0), (1.0, 1)]
    for run in done.runs[::3]:
        sigma, seed = run.varied.values()
        written = scenario_of(tmp_path, f"seed = {seed}\n" + YARD.replace("sigma = 0.5", f"sigma = {sigma}"))
        assert run.numbers == headline(document_of(od.run(written)).model_dump(mode="json"))


def test_keys_lead_to_sensors_by_name_to_tables_that_are_left_out_and_to_degrees(yard: od.Scenario):
    values = (("sensors.magnetometer.sigma_deg", 5.0), ("sensors.0.rate", 1.0), ("selection.per_segment", 2), ("start.heading", 0.1))
    data = varied_data(yard, values)
    assert data["sensors"] == [{"kind": "gps", "sigma": 0.5, "rate": 1.0}, {"kind": "magnetometer", "sigma_deg": 5.0}]
    assert data["selection"] == {"per_segment": 2}
    assert data["start"] == {"x": 0.0, "y": 0.0, "heading": 0.1}  # in the place of that in degrees
    assert [sensor["kind"] for sensor in varied_data(yard, (("sensors", ["magnetometer"]),))["sensors"]] == ["magnetometer"]


def test_a_key_finds_its_own_sensor_whichever_of_them_stay(tmp_path: Path):
    three = YARD.replace('{kind = "magnetometer"', '{kind = "range", beacon = [9.0, 9.0], sigma = 1.0}, {kind = "magnetometer"')
    subset, value = ("sensors", ["range", "magnetometer"]), ("sensors.range.sigma", 7.0)
    for values in ((subset, value), (value, subset)):
        sensors = varied_data(scenario_of(tmp_path, three), values)["sensors"]
        assert sensors == [{"kind": "range", "beacon": [9.0, 9.0], "sigma": 7.0}, {"kind": "magnetometer", "sigma_deg": 10.0}]


def test_numbers_of_numpy_are_numbers():
    assert combinations_of({"a": np.array([1.0, 2.0]), "b": (np.int64(3),)}) == ((("a", 1.0), ("b", 3)), (("a", 2.0), ("b", 3)))


REFUSED = {
    "nothing": ({}, "vary is empty: must have at least one key"),
    "no values": ({"seed": []}, r"vary\['seed'\] has no values: must have at least one"),
    "a value twice": ({"seed": [1, 1]}, r"vary\['seed'\] has 1 twice"),
    "a number twice": ({"seed": [2, 2.0]}, r"vary\['seed'\] has 2 twice"),
    "a subset twice": ({"sensors": [["gps"], ["gps"]]}, r"vary\['sensors'\] has \['gps'\] twice"),
    "no value": ({"seed": [None]}, r"vary\['seed'\] has None: must be numbers, texts, True or False, or lists and tables of them"),
    "text for values": ({"title": "ab"}, r"vary\['title'\] is 'ab': must be a list of values"),
    "an unknown sensor": ({"sensors.gsp.sigma": [1.0]}, r"no 'gsp'; did you mean 'gps'\? \(accepted: gps, magnetometer, 0, 1\)"),
    "an unknown key": ({"sensors.gps.sigm": [1.0]}, r"with sensors.gps.sigm = 1.0: .*unknown key; did you mean 'sigma'"),
    "a value that is refused": ({"seed": [0], "sensors.gps.sigma": [1.0, -1.0]}, r"with seed = 0, sensors.gps.sigma = -1.0: .*above 0"),
    "beyond a number": ({"time.step.x": [1.0]}, r"vary\['time.step.x'\]: time.step is 1.0, which has no keys"),
    "two keys of one sensor": ({"sensors.gps.sigma": [1.0], "sensors.0.sigma": [2.0]}, "vary has .* which lead to one place"),
    "an angle twice": ({"start.heading": [0.1], "start.heading_deg": [5.0]}, "'start.heading' and 'start.heading_deg', which lead to one"),
    "a table and a key in it": ({"start.x": [1.0], "start": [{"x": 0.0}]}, "vary has 'start.x' and 'start', which lead to one place"),
    "what nothing depends on": ({"expected": [[]]}, r"vary\['expected'\]: must be a key that changes what is computed"),
    "sensors that are no names": ({"sensors": [[0]]}, r"vary\['sensors'\] has \[0\]: must be lists of the sensors that stay, of gps, magn"),
    "a sensor that is none": ({"sensors": [["gps", "sonar"]]}, r"vary\['sensors'\] has no 'sonar'"),
}


@pytest.mark.parametrize(("vary", "message"), REFUSED.values(), ids=REFUSED.keys())
def test_what_cannot_be_varied_is_refused_before_anything_is_run(vary, message, yard: od.Scenario, tmp_path: Path):
    with pytest.raises(od.InputError, match=f"(?s){message}"):
        od.sweep(yard, vary, out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


# ---------------------------------------------------------------- nothing twice, nothing lost


def test_what_has_its_file_is_not_run_again_and_what_has_none_is(yard: od.Scenario, tmp_path: Path):
    first = od.sweep(yard, VARY, out=tmp_path / "out")
    files = sorted((tmp_path / "out" / "runs").iterdir())
    assert [file.stem for file in files] == sorted(run.name for run in first.runs)
    gone, damaged, *finished = files
    gone.unlink()
    damaged.write_text(damaged.read_text()[:100])
    before, told = {file: file.stat().st_mtime_ns for file in finished}, []
    wider = {"sensors.gps.sigma": [0.5, 1.0], "seed": range(3)}
    second = od.sweep(yard, wider, out=tmp_path / "out", progress=told.append)
    assert told[0].startswith("4 of 6 runs to do")
    assert {file: file.stat().st_mtime_ns for file in finished} == before
    named = {run.name: run.numbers for run in second.runs}
    assert all(named[run.name] == run.numbers for run in first.runs)


def test_files_of_something_else_are_not_taken_for_answers(yard: od.Scenario, tmp_path: Path):
    task = task_of(varied_data(yard, (("seed", 0),)), yard.file)
    write_answer(tmp_path, task.name, compute(task))
    file = tmp_path / "runs" / f"{task.name}.json"
    good = json.loads(file.read_text())

    def is_taken(other: object) -> bool:
        file.write_text(json.dumps(other))
        return read_answer(tmp_path, task) is not None

    bad = ({"error": 5, "result": None}, {"result": None}, {"result": {}}, {"result": []}, {"scenario": {}}, {"name": "x"}, {"error": "no"})
    assert is_taken(good)
    assert is_taken({**good, "error": "no", "result": None})
    assert not any(is_taken({**good, **other}) for other in bad)
    assert not any(is_taken(other) for other in ([1], "x", None, {}))


class EndingExecutor(Executor):
    """Finishes some calls, then all others are lost, and no more are taken."""

    def __init__(self, finishes: int, takes: int) -> None:
        self.finishes, self.takes, self.calls = finishes, takes, 0

    def submit(self, fn, /, *args, **kwargs):  # as the base has it
        self.calls += 1
        if self.calls > self.takes:
            raise RuntimeError("cannot schedule new futures after shutdown")
        future = Future()
        if self.calls > self.takes - self.finishes:
            future.set_result(fn(*args, **kwargs))
        else:
            future.set_exception(BrokenExecutor("terminated abruptly"))
        return future


@pytest.mark.parametrize(("finishes", "takes"), [(2, 6), (2, 4), (0, 0)])
def test_what_is_finished_when_an_executor_ends_is_kept(finishes: int, takes: int, yard: od.Scenario, tmp_path: Path):
    with pytest.raises(LostWorkersError, match=r"the executor ended: .*; finished runs are kept where they have files"):
        od.sweep(yard, {"seed": range(6)}, executor=EndingExecutor(finishes, takes), out=tmp_path / "out")
    assert len(contents(tmp_path / "out")) == finishes


def test_a_folder_that_cannot_be_written_is_refused_before_any_run(yard: od.Scenario, tmp_path: Path):
    (tmp_path / "runs").write_text("no folder")
    told: list[str] = []
    with pytest.raises(od.InputError, match="runs: cannot be written"):
        od.sweep(yard, {"seed": range(6)}, out=tmp_path, progress=told.append)
    assert len(told) == 1


def test_a_run_that_fails_is_recorded_with_its_error_and_the_others_go_on(tmp_path: Path):
    vary = {"design.constraints.goal.point": [[3.0, 1.0], [500.0, 0.0], [3.0, 2.0]]}
    done = od.sweep(scenario_of(tmp_path, DESIGNED), vary, out=tmp_path / "out")
    assert [bool(run.error) for run in done.runs] == [False, True, False]
    assert "Goal: within 1.5 m of (500, 0)" in done.runs[1].error
    assert np.isnan(done.column("designs.all.value")).tolist() == [False, True, False]
    assert len(contents(tmp_path / "out")) == 3
    told: list[str] = []
    again = od.sweep(scenario_of(tmp_path, DESIGNED), vary, out=tmp_path / "out", progress=told.append)
    assert told[0].startswith("0 of 3 runs to do")
    assert [run.error for run in again.runs] == [run.error for run in done.runs]


def test_a_sweep_that_is_killed_goes_on_where_it_ended(tmp_path: Path):
    (tmp_path / "yard.toml").write_text(YARD + "\n[sweep.vary]\nsensors.gps.sigma = [0.5, 1.0, 2.0]\nseed = [0, 1]\n")
    command = [sys.executable, "-m", "obsdesign", "sweep", "yard.toml", "--jobs", "1", "--out"]
    runs = tmp_path / "out" / "runs"
    with subprocess.Popen([*command, "out"], cwd=tmp_path, stdout=subprocess.DEVNULL, env=os.environ) as process:
        while len(list(runs.glob("*.json"))) < 2:
            assert process.poll() is None
            time.sleep(0.005)
        process.send_signal(signal.SIGKILL)
    finished = {file: file.stat().st_mtime_ns for file in runs.glob("*.json")}
    assert 2 <= len(finished) < 6
    assert obsdesign(*command[3:], "out", folder=tmp_path).returncode == 0
    scenario = od.load_scenario(tmp_path / "yard.toml")
    write_sweep(tmp_path / "whole", scenario, od.sweep(scenario, scenario.sweep.vary, out=tmp_path / "whole"))
    assert {file: file.stat().st_mtime_ns for file in finished} == finished
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")
    assert (tmp_path / "out" / "sweep.csv").read_bytes() == (tmp_path / "whole" / "sweep.csv").read_bytes()
    assert (tmp_path / "out" / "sweep.html").read_bytes() == (tmp_path / "whole" / "sweep.html").read_bytes()


def test_a_worker_of_a_cluster_that_is_killed_half_way_loses_nothing(yard: od.Scenario, tmp_path: Path):
    vary = {"sensors.gps.sigma": [0.5, 1.0], "seed": range(4)}
    killed: list[int] = []
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster, cluster.get_client() as client:

        def kill_one(text: str) -> None:
            if "3 of 8" in text:
                killed.append(cluster.workers[0].pid)
                os.kill(killed[0], signal.SIGKILL)

        spread = od.sweep(yard, vary, executor=client.get_executor(pure=False), out=tmp_path / "spread", progress=kill_one)
    here = od.sweep(yard, vary, out=tmp_path / "here")
    assert killed
    assert not spread.failures
    assert contents(tmp_path / "spread") == contents(tmp_path / "here")
    assert spread.to_csv() == here.to_csv()


# ---------------------------------------------------------------- what a person sees


def test_the_table_has_what_was_varied_and_what_came_out(yard: od.Scenario):
    done = od.sweep(yard, VARY)
    rows = list(csv.DictReader(done.to_csv().splitlines()))
    frame = done.to_dataframe()
    for i, run in enumerate(done.runs):
        assert (rows[i]["run"], float(rows[i]["sensors.gps.sigma"]), int(rows[i]["seed"])) == (run.name, *run.varied.values())
        assert float(rows[i]["selection.value"]) == run.numbers["selection.value"] == frame["selection.value"].iloc[i]
    assert str(done).startswith("sweep of 4 runs: Rover <in> a yard\n  sensors.gps.sigma  0.5, 1.0\n")
    named = replace(done, runs=tuple(replace(run, error=text) for run, text in zip(done.runs, LINES, strict=True)))
    read = list(csv.DictReader(io.StringIO(named.to_csv(), newline="")))
    assert [row["error"] for row in read] == list(LINES)
    with pytest.raises(od.InputError, match=r"no 'selection\.valu'; did you mean 'selection\.value'"):
        done.column("selection.valu")


def test_the_page_needs_no_network_and_shows_no_tag_of_the_users(yard: od.Scenario):
    done = od.sweep(yard, VARY)
    broken = replace(done, runs=(replace(done.runs[0], error="<b>no</b>"), *done.runs[1:]))
    page = sweep_page(yard, broken)
    assert "Rover &lt;in&gt; a yard" in page
    assert "&lt;b&gt;no&lt;/b&gt;" in page
    assert not any(word in page for word in ("<in>", "<b>no", "http://", "https://", "<script", "<link"))
    assert page == sweep_page(yard, broken)


GAINS = st.lists(st.tuples(st.integers(-3, 3), st.integers(-3, 3)), min_size=1, max_size=12)


@settings(max_examples=100, deadline=None, derandomize=True, database=None)
@given(GAINS)
def test_the_runs_to_choose_from_are_those_that_none_beats(gains: list[tuple[int, int]]):
    value, cost = np.array(gains, dtype=float).T
    panels = {"selection.value": Panel("value", value), "selection.filter.value": Panel("cost", -cost)}
    beats = [[a != b and a[0] >= b[0] and a[1] >= b[1] for a in gains] for b in gains]
    assert best_of_both(panels, *panels).tolist() == [not any(row) for row in beats]
    has_best_of_both = any(a == max(g[0] for g in gains) and b == max(g[1] for g in gains) for a, b in gains)
    assert not (has_best_of_both and list(competing(panels)))


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "nothing is varied: give --vary KEY=VALUES"),
        (("--vary", "seed"), "'seed' must be KEY=VALUES, such as"),
        (("--vary", "sensors.gps.sigma=0.5,wide"), "with sensors.gps.sigma = 'wide'"),
    ],
)
def test_the_verb_says_what_is_missing(words, message, yard: od.Scenario, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    with pytest.raises(SystemExit) as end:
        main(("sweep", yard.file, "--out", str(tmp_path / "out"), *words))
    assert (end.value.code, message in capsys.readouterr().err) == (2, True)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("sensors.gsp.sigma = [1.0]", "no 'gsp'; did you mean 'gps'?"),
        ("sensors.gps.sigma = [1.0, -1.0]\nseed = [0, 1]", "with sensors.gps.sigma = -1.0, seed = 0: "),
        ("seed = [1, 1]", "vary['seed'] has 1 twice"),
    ],
)
def test_check_says_what_of_a_sweep_the_scenario_does_not_accept(line, message, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    (tmp_path / "yard.toml").write_text(f"{YARD}[sweep.vary]\n{line}\n")
    with pytest.raises(SystemExit) as end:
        main(("check", str(tmp_path / "yard.toml")))
    assert (end.value.code, message in capsys.readouterr().err) == (2, True)


def test_the_verb_takes_lists_ranges_and_subsets_and_prints_one_object(
    yard: od.Scenario, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    words = ("--jobs", "1", "--vary", "seed=3:5", "--vary", 'sensors=["gps"],["gps","magnetometer"]', "--json")
    with pytest.raises(SystemExit) as end:
        main(("sweep", yard.file, "--out", str(tmp_path / "out"), *words))
    told = json.loads(capsys.readouterr().out)
    expected = [[seed, sensors] for seed, sensors in product((3, 4), (["gps"], ["gps", "magnetometer"]))]
    assert (end.value.code, [list(run["varied"].values()) for run in told["runs"]]) == (0, expected)
    assert sorted(file.name for file in (tmp_path / "out").iterdir()) == ["runs", "sweep.csv", "sweep.html"]


def test_the_example_of_the_page_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    page = (ROOT / "docs" / "sweeps.md").read_text()
    scenario, program = (re.findall(rf"```{language}\n(.*?)```", page, re.DOTALL)[0] for language in ("toml", "python"))
    (tmp_path / "yard.toml").write_text(scenario)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "program.py").write_text(program)
    runpy.run_path("program.py")
    assert capsys.readouterr().out.startswith("sweep of 4 runs: A rover in a yard\n  sensors.gps.sigma  0.5, 1.0\n")
    assert len(list((tmp_path / "reports" / "yard" / "runs").iterdir())) == 4


def test_what_a_machine_lacks_is_told_and_not_kept(yard: od.Scenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Started again with more memory, the run is done."""

    def starve(*_: object, **__: object) -> None:
        raise MemoryError("no room for the Gramian")

    with monkeypatch.context() as patch:
        patch.setattr(run_file, "run", starve)
        starved = od.sweep(yard, {"seed": [0]}, out=tmp_path / "out")
    assert [run.error for run in starved.runs] == ["MemoryError: no room for the Gramian"]
    assert not od.sweep(yard, {"seed": [0]}, out=tmp_path / "out").failures
