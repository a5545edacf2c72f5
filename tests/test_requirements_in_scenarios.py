"""A scenario says what a filter has to know: the study finds the cheapest schedule that keeps it, proves it, or says why nothing does."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from conftest import obsdesign
from test_filter_question import SHORT, words_of
from test_select_verb import FLOAT, schedules

import obsdesign as od
from obsdesign.exchange.trajectory_csv import trajectory_csv
from obsdesign.report.sections import summary
from obsdesign.report.to_document import document_of
from obsdesign.study.record import Study, schedule_at_steps

COST = {"gps": 3.0, "magnetometer": 1.0, "bearing": 2.0}
REQUIRED = """
[selection]
cost = {gps = 3.0, magnetometer = 1.0, bearing = 2.0, array = 2.5}
start = {gps = 1.0}
[[selection.requirements]]
about = ["x", "y"]
at_most = AT_MOST
after = 12.0
[[selection.requirements]]
about = ["heading"]
at_most_deg = 6.0
share = 0.8
"""


def scenario_file(folder: Path, at_most: float, replace: tuple[str, str] = ("", "")) -> Path:
    """The float on its bent path alone, in three segments, with requirements."""
    text = FLOAT.split("[[paths]]")[0].replace("segment = 5.0", "segment = 10.0").replace("SELECTION", REQUIRED) + SHORT
    (folder / "float.toml").write_text(text.replace("AT_MOST", str(at_most)).replace(*replace))
    return folder / "float.toml"


@pytest.fixture(scope="module")
def study(tmp_path_factory) -> Study:
    return od.run(od.load_scenario(scenario_file(tmp_path_factory.mktemp("required"), 5.0)))


@pytest.fixture(scope="module")
def impossible(tmp_path_factory) -> Study:
    return od.run(od.load_scenario(scenario_file(tmp_path_factory.mktemp("impossible"), 0.5)))


def deviations(study: Study, chosen: np.ndarray) -> np.ndarray:
    """Standard deviations (N, n) after the samples of each instant, from the posterior alone."""
    scenario, path = study.scenario, study.main.path
    active = schedule_at_steps(chosen, study.main.nodes)
    J = od.posterior_information(scenario.system, path, scenario.prior_at_start, scenario.disturbance_psd, active=active)[:-1]
    return np.sqrt(np.diagonal(np.linalg.inv(J), axis1=1, axis2=2))


def keeps(std: np.ndarray, t: np.ndarray, at_most: float) -> bool:
    """x and y within at_most at all instants after 12 s, heading within 6 degrees at 80 % of all after the first, as the file says."""
    later = std[t > 12.0]
    heading = std[t > 0.0, 2] <= math.radians(6.0)
    return bool((np.hypot(later[:, 0], later[:, 1]) <= at_most).all() and heading.mean() >= 0.8)


def expense(chosen: np.ndarray) -> float:
    on = chosen.astype(float)
    starts = on[0, 0] + np.maximum(np.diff(on[:, 0]), 0).sum()
    return float((on @ [3.0, 1.0, 2.0, 2.5]).sum() + starts)


def test_the_cheapest_schedule_is_that_of_all(study):
    t = study.main.path.t[:-1]
    best = min(expense(chosen) for chosen in schedules(3, 4, 1) if keeps(deviations(study, chosen), t, 5.0))
    found = study.selection.cheapest.schedule
    assert (found.value, found.bound) == (pytest.approx(best), pytest.approx(best))
    assert keeps(deviations(study, found.chosen), t, 5.0) and expense(found.chosen) == pytest.approx(best)


def test_the_study_uses_the_cheapest_schedule(study):
    selection = study.selection
    assert (selection.question, selection.question_in_use) == ("cheapest", "cheapest")
    assert np.array_equal(selection.chosen, selection.cheapest.schedule.chosen)
    assert {check.schedule for check in study.checks} == {"chosen", "gps always", "for the filter", "for the start"}


def test_the_document_and_the_page_say_what_is_required_and_what_it_costs(study):
    part = document_of(study).model_dump(mode="json")["selection"]["cheapest"]
    std = deviations(study, study.selection.cheapest.schedule.chosen)
    t = study.main.path.t[:-1]
    first = part["requirements"][0]
    assert first["size"] == pytest.approx(np.hypot(std[:, 0], std[:, 1])[t > 12.0].max(), rel=1e-9) and first["failures"] == 0
    assert (first["instants"], first["may_fail"]) == (17, 0)  # 13, 14, .. 29 s
    second = part["requirements"][1]
    assert (second["instants"], second["may_fail"]) == (29, 5)  # 1, 2, .. 29 s: 0.2 of them are 5.8
    assert second["size"] == pytest.approx(np.sort(std[t > 0, 2])[::-1][5], rel=1e-9)
    assert part["value"] == part["bound"] and part["cost"] == COST | {"array": 2.5}
    words = words_of(study)
    assert "Required is x and y within 5 m later than 12 s and heading within 6 deg" in words.replace("\u202f", " ")
    assert "none that keeps it costs less, which is proven" in words


def test_what_is_impossible_is_said_and_the_schedule_for_the_filter_is_used(impossible):
    selection = impossible.selection
    assert (selection.question, selection.question_in_use) == ("cheapest", "filter")
    assert selection.cheapest.schedule.status is od.Status.INFEASIBLE
    std = deviations(impossible, np.ones((3, 4), dtype=bool))
    size = np.hypot(std[:, 0], std[:, 1])
    k = 13 + int(size[13:].argmax())
    note = f"impossible: with all on, x and y are {size[k]:.3g} m at {k} s"
    assert selection.cheapest.schedule.notes[0] == note
    assert note[1:] in words_of(impossible).replace("\u202f", " ")
    part = document_of(impossible).model_dump(mode="json")["selection"]["cheapest"]
    assert (part["value"], part["requirements"][0]["size"], part["requirements"][0]["failures"]) == (None, None, None)


def select_verb(study: Study, at_most: float, folder: Path):
    """What `obsdesign select` makes of the float's path in a file."""
    scenario_file(folder, at_most)
    (folder / "path.csv").write_text(trajectory_csv(study.scenario.system, study.main.path))
    return obsdesign("select", "path.csv", "--scenario", "float.toml", "--json", folder=folder)


def test_the_top_of_the_page_names_the_cheapest_schedule_and_what_it_costs(study, impossible):
    (number,) = [number for number in summary.headline(study) if number.part.startswith("which")]
    assert float(number.number) == study.selection.cheapest.schedule.value
    assert number.meaning.startswith("cost of the cheapest schedule that keeps what is required, to within 0")
    assert "the cheapest schedule that keeps what is required" in summary.answer(study)
    (number,) = [number for number in summary.headline(impossible) if number.part.startswith("which")]
    assert (number.number, number.meaning) == ("none", "no schedule keeps what is required")


def test_what_is_impossible_ends_with_exit_code_1(study, impossible, tmp_path):
    done = select_verb(study, 0.5, tmp_path)
    assert done.returncode == 1
    assert f"no schedule keeps what is required: {impossible.selection.cheapest.schedule.notes[0]}" in done.stderr
    assert json.loads(done.stdout)["selection"]["cheapest"]["status"] == "INFEASIBLE"


def test_select_asks_the_same_of_a_path_from_a_file(study, tmp_path):
    done = select_verb(study, 5.0, tmp_path)
    assert done.returncode == 0
    found, ours = json.loads(done.stdout)["selection"]["cheapest"], study.selection.cheapest.schedule
    assert (found["value"], found["bound"]) == (ours.value, ours.bound)


@pytest.mark.parametrize(
    ("replace", "message"),
    [
        (('["x", "y"]', '["x", "z"]'), "selection.requirements[0].about: is 'z': must be one of x, y, heading"),
        (('["x", "y"]', '["x", "heading"]'), "x in m, heading in rad: states that are summed must have one unit"),
        (('["x", "y"]', '["x", "x"]'), "names 'x' twice"),
        (("after = 12.0", "after = 29.0"), "is 29 s: must be before the last samples, at 29 s"),
        (("at_most_deg = 6.0", "at_most_deg = 0.0"), "requirements[1].at_most_deg: is 0.0: must be greater than 0"),
        (("share = 0.8", "share = 0.0"), "selection.requirements[1].share"),
        (("start = {gps", "start = {gsp"), "selection.start.gsp: unknown key; did you mean 'gps'?"),
        (("[selection]\n", "[selection]\nrobust_to = 1\n"), "must be 0 with [[selection.requirements]]"),
        (('["x", "y"]\nat_most', '["x", "y"]\nat_most_deg'), "requirements[0].at_most_deg: is given in degrees: is no angle"),
    ],
)
def test_what_is_wrong_with_requirements_is_named(tmp_path, replace, message):
    with pytest.raises(od.ScenarioError) as error:
        od.load_scenario(scenario_file(tmp_path, 5.0, replace))
    assert message in str(error.value)


def test_keys_of_the_cheapest_schedule_need_requirements(tmp_path):
    file = tmp_path / "float.toml"
    file.write_text(FLOAT.replace("SELECTION", "[selection]\ncost = {gps = 2.0}"))
    with pytest.raises(od.ScenarioError, match=r"selection.cost: needs \[\[selection.requirements\]\]"):
        od.load_scenario(file)
    file.write_text(FLOAT.replace("SELECTION", '[selection]\nquestion = "cheapest"'))
    with pytest.raises(od.ScenarioError, match=r"selection.question: is cheapest: needs \[\[selection.requirements\]\]"):
        od.load_scenario(file)
