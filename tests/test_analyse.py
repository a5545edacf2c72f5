"""Truths about `obsdesign analyse`: what papers print comes out of files, cases are those that were asked for, the page says so."""

from __future__ import annotations

import json
import re
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT

import obsdesign as od
from obsdesign.cli import main
from obsdesign.exchange.trajectory_csv import trajectory_csv
from obsdesign.report.analysis_document import AnalysisDocument, analysis_document
from obsdesign.report.analysis_page import analysis_page
from obsdesign.report.analysis_sections.sees import answer
from obsdesign.scenario.loading import load_scenario_of_log, load_scenario_to_analyse
from obsdesign.study.analysis_study import analyse_scenario, subsets_of

FILES = sorted((ROOT / "scenarios" / "verdicts").glob("*.toml"))
LANDMARKS = """
title = "Three <landmarks>"
question = "Where am I?"
vehicle = {kind = "omnidirectional", disturbance = "unknown"}
sensors = [
  {kind = "bearing", name = "a", beacon = [2.0, 0.0], sigma = 0.02},
  {kind = "bearing", name = "b", beacon = [-1.0, 3.0], sigma = 0.02},
  {kind = "bearing", name = "c", beacon = [-1.0, -3.0], sigma = 0.02},
]
"""


def study_of(folder: Path, text: str):
    file = folder / "landmarks.toml"
    file.write_text(text)
    return analyse_scenario(load_scenario_to_analyse(file))


@pytest.mark.parametrize(
    "file",
    # .ci/run asks them all; this one takes six seconds
    [pytest.param(file, marks=pytest.mark.slow) if file.stem == "toggle_switch" else file for file in FILES],
    ids=lambda file: file.stem,
)
def test_what_the_papers_print_comes_out_of_the_file(file: Path):
    document = analysis_document(analyse_scenario(load_scenario_to_analyse(file)))
    assert document.expected
    assert [(each.key, each.found) for each in document.expected if not each.met] == []
    assert all(part.decided for by in document.verdicts.values() for of in by.values() for part in of.values())


def test_the_cases_are_every_suite_in_every_manoeuvre_for_every_class_of_disturbances(tmp_path: Path):
    study = study_of(tmp_path, LANDMARKS + '[[manoeuvres]]\nname = "free"\n[analysis]\ndisturbances = ["arbitrary", 0]\n')
    suites = [subset for size in (1, 2, 3) for subset in combinations("abc", size)]
    assert [each.sensors for each in study.analyses] == 2 * suites
    assert study.disturbances == ("arbitrary", "polynomial of degree 0")
    for each in study.analyses:
        system = od.System(od.Omnidirectional(disturbance="unknown"), tuple(s for s in study.scenario.sensors if s.name in each.sensors))
        disturbance = "arbitrary" if each.verdict.disturbance == "arbitrary" else od.Polynomial(0)
        assert each.verdict.dimension == od.observability(system, disturbance=disturbance).dimension


def test_a_point_is_asked_about_where_one_is_given(tmp_path: Path):
    """Seen from the middle, the distance to a beacon does not change with the heading; position alone is at a singular point nowhere."""
    at = {"x": 0.5, "y": 0.25, "heading": 0.1}
    text = LANDMARKS + f"[analysis]\npoint = {{ {', '.join(f'{name} = {value}' for name, value in at.items())} }}\n"
    study = study_of(tmp_path, text)
    np.testing.assert_array_equal(study.at, list(at.values()))
    assert all(np.array_equal(each.verdict.at[:3], study.at) for each in study.analyses)
    assert analysis_document(study).at == at


def test_the_example_of_the_page_runs(tmp_path: Path):
    """A drift along y alone: with distance and compass nothing of the three states is hidden, by either class."""
    text = re.findall(r"```toml\n(\[system\].*?)```", (ROOT / "docs" / "verdicts.md").read_text(), flags=re.DOTALL)[0]
    study = study_of(tmp_path, text)
    assert study.disturbances == ("arbitrary", "polynomial of degree 0")
    assert all(analysis.verdict.observable for analysis in study.of_all_sensors)


def test_of_many_sensors_each_alone_all_but_one_and_all_are_looked_at(tmp_path: Path):
    sensors = "".join(f'[[sensors]]\nkind = "range"\nname = "r{i}"\nbeacon = [{i}.5, 2.0]\nsigma = 1.0\n' for i in range(7))
    (tmp_path / "many.toml").write_text('[vehicle]\nkind = "unicycle"\n' + sensors)
    assert sorted(map(len, subsets_of(load_scenario_to_analyse(tmp_path / "many.toml")))) == [1] * 7 + [6] * 7 + [7]


@pytest.mark.parametrize(
    ("subsets", "said"),
    [
        ([["a"]], "a sees 2 of 3 dimensions: "),
        ([["a", "b"]], "a + b see all 3 states."),
        ([["a", "b"], ["b", "c"]], "The largest suites see all 3 states in every case."),
        ([["a", "b", "c"]], "All sensors together see all 3 states."),
    ],
)
def test_the_answer_is_about_the_suites_that_were_asked_about(subsets, said, tmp_path: Path):
    """Bearing of one beacon: all but a rotation about it; a second one stops that."""
    study = study_of(tmp_path, LANDMARKS + f"[analysis]\nsubsets = {json.dumps(subsets)}\n")
    assert answer(study).startswith(said)


def test_inputs_that_nobody_knows_and_states_known_at_the_start_are_those_of_the_library(tmp_path: Path):
    text = LANDMARKS.replace(', disturbance = "unknown"', "").replace("title", 'unknown_inputs = ["forward", "turn_rate"]\ntitle', 1)
    study = study_of(tmp_path, text + '[analysis]\nsubsets = [["a"]]\nknown_at_start = ["x"]\n')
    system = od.System(od.Omnidirectional(), study.scenario.sensors[:1], ("forward", "turn_rate"))
    assert study.disturbances == ("arbitrary",)
    assert study.analyses[0].verdict.dimension == od.observability(system, known_at_start=("x",)).dimension


def test_known_truths_of_a_run_are_not_asked_of_verdicts(tmp_path: Path):
    text = LANDMARKS + '[[expected]]\nkey = "KEY"\nvalue = 3\nsource = "by hand"\n'
    of_a_run = analysis_document(study_of(tmp_path, text.replace("KEY", "designs.all.value")))
    misspelt = analysis_document(study_of(tmp_path, text.replace("KEY", "verdict.free.arbitrary.a.dimension")))
    assert of_a_run.expected == []
    assert [entry.met for entry in misspelt.expected] == [False]


WRONG = {
    "an unknown sensor": ('subsets = [["a", "d"]]', "analysis.subsets[0]: is 'd': must be one of a, b, c"),
    "a subset twice": ('subsets = [["a", "b"], ["b", "a"]]', "analysis.subsets[1]: stands there twice"),
    "a disturbance twice": ("disturbances = [0, 0]", "analysis.disturbances[1]: stands there twice"),
    "a degree below 0": ("disturbances = [-1]", "analysis.disturbances[0]"),
    "half a point": ("point = { x = 1.0 }", "analysis.point.y: missing key"),
    "no start": ('point = "start"', "analysis.point: is start: there is no table [start]"),
}


def test_an_unknown_input_that_the_vehicle_does_not_have_is_named(tmp_path: Path):
    (tmp_path / "wrong.toml").write_text('unknown_inputs = ["forwards"]\n' + LANDMARKS)
    with pytest.raises(od.ScenarioError, match=r"unknown_inputs: is 'forwards': must be one of .*; did you mean 'forward'"):
        load_scenario_to_analyse(tmp_path / "wrong.toml")


@pytest.mark.parametrize(("line", "message"), WRONG.values(), ids=WRONG.keys())
def test_what_cannot_be_meant_is_named(line: str, message: str, tmp_path: Path):
    (tmp_path / "wrong.toml").write_text(f"{LANDMARKS}[analysis]\n{line}\n")
    with pytest.raises(od.ScenarioError) as error:
        load_scenario_to_analyse(tmp_path / "wrong.toml")
    assert message in str(error.value)


OF_A_LOG = 'vehicle = {kind = "unicycle"}\nsensors = [{kind = "range", sigma = 1.0}]\nprior = {x = 1.0, y = 1.0, heading = 0.2}\n[replay]\n'


def test_of_a_scenario_for_a_log_verdicts_are_those_of_almost_every_state(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """A sensor stands for one at each landmark; where nobody says where the log begins, no place is asked about."""
    (tmp_path / "drive.toml").write_text(OF_A_LOG)
    (tmp_path / "landmarks.csv").write_text("name,x,y\nmast,1,2\ntower,5,-7\n")
    words = ("--landmarks", str(tmp_path / "landmarks.csv"), "--out", str(tmp_path / "out"), "--json")
    with pytest.raises(SystemExit) as end:
        main(("analyse", str(tmp_path / "drive.toml"), *words))
    told = json.loads(capsys.readouterr().out)
    assert (end.value.code, told["at"]) == (0, None)
    dimensions = {suite: part["dimension"] for suite, part in told["verdicts"]["free"]["none"].items()}
    assert dimensions == {"mast": 2, "tower": 2, "mast+tower": 3}  # of one beacon all turns with it


def test_what_is_wrong_in_a_scenario_for_a_log_is_told_beside_analysis_too(tmp_path: Path):
    (tmp_path / "drive.toml").write_text(OF_A_LOG.replace("x = 1.0, y", "x = -1.0, y") + "[analysis]\n")
    with pytest.raises(od.ScenarioError, match=r"prior\.x: is -1\.0: must be above 0"):
        load_scenario_of_log(tmp_path / "drive.toml", {"mast": (1.0, 2.0)})


def test_a_study_of_a_file_without_start_is_refused_and_check_takes_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    (tmp_path / "landmarks.toml").write_text(LANDMARKS + "[analysis]\n")
    with pytest.raises(SystemExit) as checked:
        main(("check", str(tmp_path / "landmarks.toml")))
    with pytest.raises(SystemExit) as ran:
        main(("run", str(tmp_path / "landmarks.toml"), "--out", str(tmp_path / "out")))
    assert (checked.value.code, ran.value.code) == (0, 2)
    assert "there is no [start]" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_the_verb_writes_a_page_without_network_and_says_no_where_nothing_is_seen(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    (tmp_path / "one.toml").write_text(LANDMARKS.split('  {kind = "bearing", name = "b"', maxsplit=1)[0] + "]\n")
    with pytest.raises(SystemExit) as end:
        main(("analyse", str(tmp_path / "one.toml"), "--out", str(tmp_path / "out"), "--json"))
    told = json.loads(capsys.readouterr().out)
    assert end.value.code == 1  # of one beacon all turns with it
    assert told == json.loads((tmp_path / "out" / "analysis.json").read_text())
    page = (tmp_path / "out" / "analysis.html").read_text()
    assert "Three &lt;landmarks&gt;" in page
    assert not any(word in page for word in ("<landmarks>", "http://", "https://", "<script", "<link"))


def test_the_same_study_gives_the_same_page(tmp_path: Path):
    study = study_of(tmp_path, LANDMARKS)
    assert analysis_page(study) == analysis_page(study)


def test_why_a_case_hides_something_is_said_and_what_would_mend_it(tmp_path: Path):
    """GPS on a straight leg: heading against wind. A compass, or letting go of the turn rate, tells them apart."""
    text = (
        'vehicle = {kind = "unicycle", wind = "constant"}\nsensors = [{kind = "gps", sigma = 2.0}]\n'
        '[[manoeuvres]]\nname = "straight"\nheld = {speed = 15.0, turn_rate = 0.0}\n[[manoeuvres]]\nname = "free"\n'
    )
    study = study_of(tmp_path, text)
    (case,) = study.hidden
    assert case.analysis.manoeuvre == "straight"
    words = [remedy.in_words for remedy in case.remedies.cheapest]
    assert "add magnetometer" in words
    assert "let turn_rate vary" in words
    assert all(remedy.verdict.observable for remedy in case.remedies.cheapest)
    assert any("turn_rate is held: where it varies 5 dimensions are seen" in reason.in_words for reason in case.reasons)
    assert "What would mend it" in analysis_page(study)
    part = analysis_document(study).hidden[0]
    assert (part.remedies, part.reasons) == (words, [reason.in_words for reason in case.reasons])


def test_the_largest_suites_that_were_asked_about_are_explained(tmp_path: Path):
    """A bearing hides a rotation about its beacon, which a second beacon tells: one of the others is what would mend it."""
    study = study_of(tmp_path, LANDMARKS.replace(', disturbance = "unknown"', "") + '[analysis]\nsubsets = [["a"], ["b"]]\n')
    assert [case.analysis.sensors for case in study.hidden] == [("a",), ("b",)]
    assert [[remedy.sensors for remedy in case.remedies.cheapest] for case in study.hidden] == [[("b",), ("c",)], [("a",), ("c",)]]
    assert all(case.reasons for case in study.hidden)
    page = analysis_page(study)
    assert "What a cannot see, free" in page
    assert "a, free: rotation of everything about the beacon at (2, 0) m" in page
    assert [part.sensors for part in analysis_document(study).hidden] == [["a"], ["b"]]


def test_where_states_are_known_at_the_start_the_page_says_that_nothing_was_looked_for(tmp_path: Path):
    """Of three states that move as nobody knows, x and a direction tell two."""
    text = 'unknown_inputs = ["forward", "sideways", "turn_rate"]\n' + LANDMARKS.replace(', disturbance = "unknown"', "")
    study = study_of(tmp_path, text + '[analysis]\nsubsets = [["a"]]\nknown_at_start = ["x"]\n')
    assert not study.of_all_sensors[0].verdict.observable
    assert study.hidden == ()
    assert "is not looked for where states are known at the start" in analysis_page(study)


def test_every_key_of_the_document_has_a_description():
    parts = {name: part for name, part in AnalysisDocument.model_json_schema()["$defs"].items() if name in ("AlongPart", "HiddenPart")}
    tables = [AnalysisDocument.model_json_schema(), *parts.values()]
    keys = {key: entry for table in tables for key, entry in table["properties"].items()}
    assert [key for key, entry in keys.items() if "description" not in entry and "$ref" not in entry] == []


def test_along_a_path_the_stretch_on_the_circle_is_the_one_that_hides_the_state(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """Belo, Salaris and Bicchi: hidden for as long as the vehicle stays on the circle through the landmarks."""
    file = ROOT / "scenarios" / "verdicts" / "three_landmarks.toml"
    system = load_scenario_to_analyse(file).system
    u = np.array([[1.0, 0.0, 0.05]] * 12 + [[1.0, 0.0, 0.0]] * 8)
    path = od.simulate(system, [0.0, -20.0, 0.0, 0.0, 0.0, 0.0], u, 1.0)
    (tmp_path / "path.csv").write_text(trajectory_csv(system, path))
    words = ("analyse", str(file), "--along", str(tmp_path / "path.csv"), "--out", str(tmp_path / "out"), "--json")
    with pytest.raises(SystemExit) as end:
        main(words)
    along = json.loads(capsys.readouterr().out)["along"]
    assert (end.value.code, along["rank"]) == (0, [5] * 12 + [6] * 8)
    assert [(stretch["start"], stretch["end"], stretch["rank"]) for stretch in along["hidden"]] == [(0.0, 12.0, 5)]
    assert "For 60.0\u202f% of the time, on 1 stretch" in (tmp_path / "out" / "analysis.html").read_text()


def test_along_a_log_the_motion_is_that_of_the_filter(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """Standing still, one distance tells one of three states; driving in a bend all of them."""
    rows = ["t [s],signal,value"]
    for k in range(40):
        rows += [f"{0.5 * k},speed [m/s],{float(k >= 20)}", f"{0.5 * k},turn_rate [rad/s],{0.3 * (k >= 20)}", f"{0.5 * k},range [m],30.0"]
    (tmp_path / "drive.csv").write_text("\n".join(rows))
    (tmp_path / "drive.toml").write_text(
        'vehicle = {kind = "unicycle"}\nsensors = [{kind = "gps", sigma = 1.0}, {kind = "range", beacon = [30.0, 0.0], sigma = 1.0}]\n'
        "start = {x = 0.0, y = 0.0, heading = 0.0}\nprior = {x = 1.0, y = 1.0, heading = 0.2}\n[replay]\n"
    )
    words = ("analyse", str(tmp_path / "drive.toml"), "--along", str(tmp_path / "drive.csv"), "--out", str(tmp_path / "out"), "--json")
    with pytest.raises(SystemExit):
        main(words)
    along = json.loads(capsys.readouterr().out)["along"]
    assert [(stretch["start"], stretch["end"], stretch["rank"]) for stretch in along["hidden"]] == [(0.0, 10.0, 2)]
