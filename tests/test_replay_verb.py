"""`obsdesign replay` as a newcomer would use it: a table, a short scenario, landmarks in a file; and what it refuses."""

from __future__ import annotations

import json
import re
import shlex
import tomllib
from itertools import pairwise

import jsonschema
import numpy as np
import pytest
from conftest import ROOT, obsdesign

import obsdesign as od
from obsdesign.errors import ScenarioError
from obsdesign.report.replay_document import ReplayDocument, document_of_log
from obsdesign.report.replay_page import replay_page
from obsdesign.scenario.loading import load_scenario_of_log
from obsdesign.scenario.log_defaults import read_landmarks
from obsdesign.study.log_setup import file_setup, scenario_setup
from obsdesign.study.log_study import schedule_study, study_log

LANDMARKS = {"a": (60.0, 0.0), "b": (0.0, 50.0), "c": (-40.0, -30.0)}
SCENARIO = """
[vehicle]
kind = "unicycle"
[[sensors]]
kind = "range"
sigma = 1.0
[prior]
x = 1.0
y = 1.0
heading_deg = 12
[replay]
restarts = 8
[time]
segment = 20.0
"""
TOP = (
    "position_rmse", "position_rmse_all", "spearman_plain", "spearman_posterior", "spearman_own", "calibration", "rejected",
    "hidden_windows",
)  # fmt: skip


def write_drive(folder, *, truth=True, seed=0, steps=200, change=lambda rows: rows):
    """Write drive.csv, landmarks.csv and my.toml: odometry at 2 Hz, ranges now and then, with an outlier."""
    random = np.random.default_rng(seed)
    dt, x, rows = 0.5, np.array([0.0, 0.0, 0.3]), ["t [s],signal,value"]
    for k in range(steps):
        u = np.array([2.0 + np.sin(k / 9), 0.3 * np.cos(k / 17)])
        rows += [f"{dt * k:.3f},speed,{u[0]:.6f}", f"{dt * k:.3f},turn_rate,{u[1]:.6f}"]
        if truth:
            rows += [f"{dt * k:.3f},truth.{name},{value:.6f}" for name, value in zip(("x", "y", "heading"), x, strict=True)]
        name = "abc"[random.integers(3)]
        distance = np.hypot(*(x[:2] - LANDMARKS[name])) + 0.4 * random.standard_normal() + (30 if k == 77 else 0)
        rows.append(f"{dt * k:.3f},{name},{distance:.4f}")
        middle = x[2] + 0.5 * dt * u[1]
        x = x + dt * np.array([u[0] * np.cos(middle), u[0] * np.sin(middle), u[1]]) + 0.05 * random.standard_normal(3) * [1, 1, 0.2]
    (folder / "drive.csv").write_text("\n".join(change(rows)) + "\n")
    (folder / "landmarks.csv").write_text("name,x [m],y [m]\n" + "\n".join(f"{n},{x},{y}" for n, (x, y) in LANDMARKS.items()) + "\n")
    (folder / "my.toml").write_text(SCENARIO if truth else SCENARIO + "[start]\nx = 0.0\ny = 0.0\nheading = 0.3\n")


def setup(folder):
    return scenario_setup(folder / "drive.csv", load_scenario_of_log(folder / "my.toml", read_landmarks(folder / "landmarks.csv")), None)


def test_a_log_a_scenario_and_landmarks_become_json_and_a_page(tmp_path):
    write_drive(tmp_path, steps=330)  # half of which is long enough for the truth to tell of the inputs
    done = obsdesign(
        "replay", "drive.csv", "--scenario", "my.toml", "--landmarks", "landmarks.csv", "--out", "out", "--json", folder=tmp_path
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert tuple(found)[: len(TOP)] == TOP
    jsonschema.Draft202012Validator(ReplayDocument.model_json_schema()).validate(found)
    assert json.loads((tmp_path / "out" / "replay.json").read_text()) == found
    assert 0 < found["position_rmse"] < 0.6 and found["rejected"] >= 1 and found["samples"].keys() == LANDMARKS.keys()
    growths = [window["growth"]["a"] for window in found["windows"] if sum(window["samples"].values())]
    assert found["growth_by_sensor"]["a"] == pytest.approx(np.minimum(growths, 3).mean(), rel=1e-12)
    page = (tmp_path / "out" / "report.html").read_text()
    for sentence in ("Could it be seen?", "Which sensor mattered?", "Truth is needed only for the factor", "Which state is bound when?"):
        assert sentence in page
    assert "http" not in page.replace("http://www.w3.org", "")


def test_brackets_are_shown_as_they_stand(tmp_path):
    write_drive(tmp_path, steps=40, change=lambda rows: [row for row in rows if "truth.heading" not in row])
    text = (tmp_path / "my.toml").read_text().replace("restarts = 8", "restarts = 0\ncalibrate = 0.0\nschedule = false")
    (tmp_path / "my.toml").write_text('title = "drive [/1] in [m]"\n' + text)
    done = obsdesign("replay", "drive.csv", "--scenario", "my.toml", "--landmarks", "landmarks.csv", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "drive [/1] in [m]" in done.stdout and "neither [start] nor the truth tells it" in done.stdout


def test_without_truth_windows_are_ranked_and_the_page_says_what_is_not_told(tmp_path):
    write_drive(tmp_path, truth=False, steps=80)
    text = (tmp_path / "my.toml").read_text()
    (tmp_path / "my.toml").write_text(text.replace("restarts = 8", "calibrate = 0.0\nschedule = false"))
    study = study_log(setup(tmp_path), 0)
    document = document_of_log(study)
    assert document.position_rmse is None and document.spearman_posterior is None and document.ratio is None
    assert all(window.predicted is not None for window in document.windows)
    assert "There is no truth" in replay_page(study)
    assert replay_page(study) == replay_page(study)


def test_the_arrays_of_a_ranging_run_need_no_scenario(tmp_path):
    random = np.random.default_rng(1)
    t = 0.25 * np.arange(400)
    truth = np.column_stack([t, 20 * np.cos(t / 20), 20 * np.sin(t / 20), t / 20 + np.pi / 2])
    beacons = np.array([[3.0, 40.0, 0.0], [5.0, -30.0, 25.0]])
    chosen = random.integers(0, 2, 400)
    ranges = np.hypot(*(truth[:, 1:3] - beacons[chosen, 1:]).T) + 0.3 * random.standard_normal(400)
    odom = np.column_stack([t, np.full(400, 0.25), np.full(400, 0.0125)])
    file = tmp_path / "run.npz"
    backwards = truth + np.array([0.0, 0.0, 0.0, np.pi])
    np.savez(file, odom=odom, gt=backwards, ranges=np.column_stack([t, np.zeros(400), beacons[chosen, 0], ranges]), beacons=beacons)
    study = study_log(file_setup(file), 0)
    assert study.replay.rmse_second_half < 0.5 and study.setup.landmarks == {"beacon_3": (40.0, 0.0), "beacon_5": (-30.0, 25.0)}
    assert any("turned by 180 degrees" in note for note in study.notes)  # the odometry drives forward
    assert study.calibration.number("sigma of beacon_3").value == pytest.approx(0.3, rel=0.3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda rows: [*rows, "3.0,d,12.0"], "d"),
        (lambda rows: [*rows, "3.0,a,nan"], r"drive.csv, line \d+, column 'value': 'nan' is no finite number"),
        (lambda rows: [row for row in rows if ",speed," not in row], "speed"),
        (lambda rows: rows[:1], "drive.csv"),
        (lambda rows: [row for row in rows if row.partition(",")[2][0] not in "abc"], "has no sample of any of the sensors a, b, c"),
    ],
)
def test_what_cannot_be_meant_is_named(change, message, tmp_path):
    write_drive(tmp_path, steps=40, change=change)
    with pytest.raises(od.InputError, match=message):
        study_log(setup(tmp_path), 0)


def test_nothing_is_written_where_the_log_cannot_be_meant(tmp_path):
    write_drive(tmp_path, steps=4, change=lambda rows: [*rows, "3.0,a,nan"])
    done = obsdesign("replay", "drive.csv", "--scenario", "my.toml", "--landmarks", "landmarks.csv", "--out", "out", folder=tmp_path)
    assert done.returncode == 2 and "drive.csv, line" in done.stderr and not (tmp_path / "out").exists()


def test_files_beside_the_log_that_cannot_be_meant_are_named(tmp_path):
    write_drive(tmp_path)
    (tmp_path / "bad.csv").write_text("name,x,y\na,1,2\na,3,four\n")
    with pytest.raises(od.InputError, match=r"bad.csv, line 3, column 'name': 'a' stands there twice"):
        read_landmarks(tmp_path / "bad.csv")
    (tmp_path / "bad.csv").write_text("name,x,y\na,1,2\nb,3,four\n")
    with pytest.raises(od.InputError, match=r"bad.csv, line 3, column 'y': 'four' is no finite number of metres"):
        read_landmarks(tmp_path / "bad.csv")
    (tmp_path / "bad.csv").write_text("x,y\n1,2\n")
    with pytest.raises(od.InputError, match="line 1: the columns are x, y: must be name, x, y"):
        read_landmarks(tmp_path / "bad.csv")
    with pytest.raises(od.InputError, match=r"drive.csv: needs --scenario"):
        file_setup(tmp_path / "drive.csv")
    with pytest.raises(ScenarioError, match=r"line 13: replay.about: is 'depth': must be one of x, y, heading"):
        (tmp_path / "deep.toml").write_text(SCENARIO.replace("restarts = 8", 'restarts = 8\nabout = ["depth"]'))
        load_scenario_of_log(tmp_path / "deep.toml", LANDMARKS)
    write_drive(tmp_path, truth=False)
    (tmp_path / "my.toml").write_text(SCENARIO)
    with pytest.raises(od.InputError, match="start: missing key 'x': the log holds no truth of it"):
        setup(tmp_path).prior  # noqa: B018


def test_a_scenario_for_a_log_is_accepted_by_check(tmp_path):
    write_drive(tmp_path)
    text = SCENARIO.replace('kind = "range"', 'kind = "range"\nname = "a"\nbeacon = [60.0, 0.0]')
    (tmp_path / "one.toml").write_text(text)
    assert load_scenario_of_log(tmp_path / "one.toml", {}).sensor_names == ("a",)
    assert od.load_scenario(tmp_path / "one.toml").replay.restarts == 8  # as `check` reads it


def test_the_published_schema_asks_no_more_of_a_scenario_for_a_log_than_the_program():
    schema = jsonschema.Draft202012Validator(od.Scenario.model_json_schema())
    schema.validate(tomllib.loads(SCENARIO))
    assert not schema.is_valid(tomllib.loads(SCENARIO.replace("[replay]\nrestarts = 8", "")))
    for key in ("prior", "vehicle", "sensors"):
        assert not schema.is_valid({name: value for name, value in tomllib.loads(SCENARIO).items() if name != key})


def test_check_says_where_landmarks_are_missing_and_reads_them_where_they_are_named(tmp_path):
    write_drive(tmp_path, steps=1)
    done = obsdesign("check", "my.toml", folder=tmp_path)
    assert done.returncode == 0 and "for a log" in done.stdout and "--landmarks says where they are" in done.stdout
    done = obsdesign("check", "my.toml", "--landmarks", "landmarks.csv", folder=tmp_path)
    assert done.returncode == 0 and "sensors a, b, c, for a log" in done.stdout
    (tmp_path / "my.toml").write_text(SCENARIO.replace("sigma = 1.0", "sigma = -1.0"))
    done = obsdesign("check", "my.toml", folder=tmp_path)
    assert done.returncode == 2 and "sigma is -1.0" in done.stderr and "too short" not in done.stderr and "at least 1" not in done.stderr


def test_the_documented_way_from_a_log_to_an_answer_runs(tmp_path, monkeypatch):
    page = (ROOT / "docs/logs.md").read_text()
    section = page[page.index("## From a log to an answer") :]
    blocks = {kind: re.findall(rf"```{kind}\n(.*?)```", section, flags=re.DOTALL) for kind in ("toml", "csv", "bash", "python")}
    (tmp_path / "drive.csv").write_text(re.findall(r"```csv\n(.*?)```", page, flags=re.DOTALL)[0])
    (tmp_path / "my.toml").write_text(blocks["toml"][0])
    (tmp_path / "landmarks.csv").write_text(blocks["csv"][0])
    for line in blocks["bash"][0].splitlines():
        done = obsdesign(*shlex.split(line)[1:], folder=tmp_path)
        assert done.returncode == 0, done.stderr
    assert (tmp_path / "report" / "report.html").exists() and (tmp_path / "report" / "replay.json").exists()
    monkeypatch.chdir(tmp_path)
    before = re.findall(r"```python\n(.*?)```", page, flags=re.DOTALL)[:1]
    exec("".join([*before, "psd = (0.01, 0.01, 0.001)\n", *blocks["python"]]), {})  # noqa: S102


def test_sensors_of_a_log_are_chosen_under_the_scenario_s_rules(tmp_path):
    write_drive(tmp_path, steps=81)
    text = SCENARIO.replace("restarts = 8", "restarts = 0\ncalibrate = 0.0").replace("segment = 20.0", "segment = 10.0")
    rule = '[[selection.rules]]\nkind = "minimum_dwell"\nleast = 3\n'
    found = {}
    for name, more in {"free": "[selection]\n", "dwell": f"[selection]\ngap = 1e-6\nquestion = 'start'\n{rule}"}.items():
        (tmp_path / "my.toml").write_text(text + more)
        found[name] = schedule_study(setup(tmp_path), 0)
    free, dwell = found["free"].schedule, found["dwell"].schedule
    assert has_dwell(dwell.chosen, 3) and not has_dwell(free.chosen, 3) and dwell.value >= free.bound and dwell.gap <= 1e-6
    drive = found["dwell"].replay
    again = drive.schedule(1, 10.0, rules=(od.MinimumDwell(3),), gap=1e-6)
    np.testing.assert_array_equal(again.chosen, dwell.chosen)
    assert "of [selection] not asked of a log: question; sensors are chosen for the filter" in found["dwell"].notes
    assert not any("not asked" in note for note in found["free"].notes)
    # errors on one drive of turns that begin with a, b and c: none of them is what round robin comes to
    errors, segments, rmse = {each.name: each.rmse for each in found["free"].schedule_errors}, np.arange(len(free.chosen)), []
    for first in range(3):
        turns = (segments[:, None] + first) % 3 == np.arange(3)
        active = turns[np.minimum(np.searchsorted(free.boundaries, drive.question.log.samples.t, side="right") - 1, len(turns) - 1)]
        names = [free.sensors.index(drive.question.log.samples.names[s]) for s in drive.question.log.samples.sensor]
        chosen = active[np.arange(len(names)), names]
        question = drive.question
        psds = {"disturbance_psd": question.disturbance_psd, "input_psd": question.input_psd}
        rmse.append(od.replay(question.system, question.log, question.prior, active=chosen, estimator=question.estimator, **psds).rmse)
    assert errors["round robin"] == pytest.approx(np.median(rmse), rel=1e-9)


def has_dwell(chosen, least):
    """Whether every stretch of a sensor being on that begins and ends within the log is at least so long."""
    for column in chosen.T:
        edges = np.flatnonzero(np.diff(column.astype(int)))
        runs = [(a + 1, b + 1) for a, b in pairwise(edges) if column[a + 1]]
        if any(end - begin < least for begin, end in runs):
            return False
    return True


def test_a_scale_that_nobody_tells_begins_at_one(tmp_path):
    write_drive(tmp_path, steps=20)
    (tmp_path / "my.toml").write_text(
        SCENARIO.replace("sigma = 1.0", 'sigma = 1.0\nscale = "stretch"\nbias = "clock"').replace(
            "y = 1.0\n", "y = 1.0\nstretch = 0.05\nclock = 0.3\n"
        )
    )
    found = setup(tmp_path)
    assert dict(zip(found.system.model.state_names, found.prior.mean, strict=True)) == pytest.approx(
        {"x": 0, "y": 0, "heading": 0.3, "stretch": 1, "clock": 0}
    )
    assert [note.partition(",")[0] for note in found.notes] == ["stretch begins at 1", "clock begins at 0"]


def test_truth_that_begins_later_than_the_log_begins_the_replay(tmp_path):
    def late(rows):
        return [row for row in rows if "truth" not in row or (float(row.split(",")[0]) > 12 and "heading" not in row)]

    write_drive(tmp_path, steps=60, change=late)
    found = setup(tmp_path)
    assert found.log.samples.t[0] == pytest.approx(12.5, abs=0.01) and any("where the truth begins" in note for note in found.log.notes)
    assert found.prior.mean[:2] == pytest.approx(found.log.truth.x[0])
    assert found.notes == ("heading begins at 0, as uncertain as the prior says: neither [start] nor the truth tells it",)
