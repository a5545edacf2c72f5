"""A study answers two questions of a schedule: what all samples say of the start, and what a filter knows along the way."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from test_select_verb import FLOAT, schedules

import obsdesign as od
from obsdesign.cli import main
from obsdesign.exchange.trajectory_csv import trajectory_csv
from obsdesign.report.figures.predicted_errors import draw_predicted
from obsdesign.report.figures.sensor_prices import sensor_worth
from obsdesign.report.html import page_of
from obsdesign.report.number_format import NARROW, numeral
from obsdesign.report.sections.filter_schedule import questions_table
from obsdesign.report.to_document import document_of
from obsdesign.study.record import CHOSEN, Study, schedule_at_steps

SHORT = """[[paths]]
name = "bent"
legs = [{seconds = 15.0, inputs = {turn_rate_deg = 6.0}}, {seconds = 15.0}]
"""


def short_file(folder, selection: str = "", name: str = "float.toml"):
    """The float on its bent path alone."""
    file = folder / name
    file.write_text(FLOAT.split("[[paths]]")[0].replace("SELECTION", selection) + SHORT)
    return file


@pytest.fixture(scope="module")
def study(tmp_path_factory) -> Study:
    return od.run(od.load_scenario(short_file(tmp_path_factory.mktemp("filter"))))


@pytest.fixture(scope="module")
def for_start(tmp_path_factory) -> Study:
    return od.run(od.load_scenario(short_file(tmp_path_factory.mktemp("start"), '[selection]\nquestion = "start"')))


def cost_of(study: Study, chosen: np.ndarray) -> float:
    """Mean of the trace of S^-1 P_k S^-1, from the posterior alone."""
    scenario, path, nodes = study.scenario, study.main.path, study.main.nodes
    active = schedule_at_steps(chosen, nodes)
    J = od.posterior_information(scenario.system, path, scenario.prior_at_start, scenario.disturbance_psd, active=active)[:-1]
    scale = scenario.prior_at_start.std
    return float(np.mean([np.trace(np.linalg.inv(scale[:, None] * J_k * scale)) for J_k in J]))


def test_both_schedules_are_the_best_of_all_under_their_question(study):
    answer, every = study.selection.filter, schedules(6, 4, 1)
    blocks = study.problem.scaled(study.main.blocks)
    information = np.linalg.eigvalsh(np.einsum("pks,ksij->pij", np.array(every, dtype=float), blocks))[:, 0]
    assert study.selection.schedule.value == pytest.approx(information.max(), rel=1e-9)
    random = np.random.default_rng(0)
    assert answer.schedule.bound <= min(cost_of(study, every[i]) for i in random.choice(len(every), 300)) * (1 + 1e-9)


def test_schedules_under_both_questions_are_what_posterior_and_gramian_say(study):
    answer, blocks = study.selection.filter, study.problem.scaled(study.main.blocks)
    assert {"for the filter", "for the start", "greedy", "gps always", "round robin", "all on"} == {each.name for each in answer.rated}
    for rated in answer.rated:
        assert rated.cost == pytest.approx(cost_of(study, rated.chosen), rel=1e-9)
        information = np.linalg.eigvalsh(np.einsum("ks,ksij->ij", rated.chosen, blocks))[0]
        assert rated.information == pytest.approx(information, rel=1e-9, abs=1e-9)
    ours = answer.find("for the filter")
    assert ours.cost == pytest.approx(answer.schedule.value, rel=1e-9)
    np.testing.assert_allclose(ours.predicted, answer.schedule.predicted, rtol=1e-9)


def test_the_study_uses_the_schedule_of_the_question_that_is_asked(study, for_start):
    assert (study.selection.question, for_start.selection.question) == ("filter", "start")
    assert np.array_equal(study.selection.chosen, study.selection.filter.schedule.chosen)
    assert np.array_equal(for_start.selection.chosen, for_start.selection.schedule.chosen)
    for each, other in ((study, "for the start"), (for_start, "for the filter")):
        assert [check.schedule for check in each.checks] == [CHOSEN, "gps always", other]
        assert np.array_equal(each.check("bent", CHOSEN).chosen, each.selection.chosen)
    # the same runs of the same filter, whichever of the two is asked
    theirs = for_start.check("bent", "for the filter").validation
    np.testing.assert_array_equal(study.check("bent", CHOSEN).validation.rmse, theirs.rmse)


def test_the_document_has_both_answers(study):
    document = document_of(study).model_dump(mode="json")
    selection, schedule = document["selection"], study.selection.filter.schedule
    found = selection["filter"]
    assert (selection["question"], selection["used"]) == ("filter", schedule.chosen.astype(int).tolist())
    assert (found["value"], found["bound"], found["gap"], found["status"]) == (schedule.value, schedule.bound, schedule.gap, "OPTIMAL")
    assert np.shape(found["prices"]) == (6, 4)
    assert {name: len(values) for name, values in found["predicted"].items()} == dict.fromkeys(study.scenario.state_names, 30)
    assert found["compared"]["all on"] < found["value"] < found["compared"]["nothing on"]
    assert found["rated"]["for the start"]["information"] == pytest.approx(selection["value"], rel=1e-9)
    assert set(document["validation"]["bent"]) == {"chosen", "gps always", "for the start"}


def words_of(study: Study) -> str:
    """The page's words, without its drawings."""
    text = re.sub(r"<(style|svg)\b.*?</\1>", " ", page_of(study), flags=re.DOTALL)
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", "", text).replace("&#39;", "'"))


def test_the_page_shows_each_schedule_under_both_questions(study, for_start):
    for each in (study, for_start):
        answer = each.selection.filter
        table = questions_table(each, answer)
        rows = {row[0].text: [cell.text for cell in row[1:]] for row in table.rows}
        assert rows["no schedule is better than"][:2] == [numeral(answer.schedule.bound), numeral(each.selection.schedule.bound)]
        assert rows["for the filter"][0] == numeral(answer.schedule.value)
        assert rows["for the start"][1] == numeral(each.selection.schedule.value)
        # the errors of the runs, over all instants with samples
        check = each.check("bent", CHOSEN if each is study else "for the filter")
        rmse = float(np.sqrt(np.mean(check.validation.rmse[:-1, 0] ** 2)))
        assert rows["for the filter"][2] == numeral(rmse)
        assert f"<b>{table.title}</b>" in page_of(each)


def test_the_page_says_what_was_minimised_what_is_proven_and_for_how_long_choices_matter(study, for_start):
    words, schedule = words_of(study), study.selection.filter.schedule
    assert "What is minimised is the sum of the variances of the filter's errors, averaged over the way" in words
    assert f"No schedule is below {numeral(schedule.bound)}: this one is proven to be the best of 4⁶ schedules" in words
    half = schedule.memory * 5.0
    assert f"Half of what a choice brings is forgotten after {half:g} s" in words.replace(NARROW, " ")
    cost = numeral(for_start.selection.filter.find("for the start").cost)
    assert f"To a filter on the way it costs {cost}" in words_of(for_start)


def test_what_matters_when_is_the_rise_of_the_cost_without_a_sensor(study):
    schedule = study.selection.filter.schedule
    worth = sensor_worth(schedule, is_share=True)
    for k, s in np.argwhere(schedule.chosen):
        without = schedule.chosen.copy()
        without[k, s] = False
        assert worth[k, s] == pytest.approx(100 * (cost_of(study, without) / schedule.value - 1), rel=1e-3, abs=1e-3)


def test_a_schedule_for_the_filter_is_drawn_with_its_own_names_and_times(study):
    schedule = study.selection.filter.schedule
    (axes,) = od.figures.schedule(schedule).axes
    assert [label.get_text() for label in axes.get_yticklabels()] == list(schedule.sensors)
    assert axes.get_xlim() == (0.0, 30.0)
    assert axes.get_xlabel() == "time [s]"


def test_predicted_errors_are_drawn_for_every_state_and_schedule(study):
    answer, t, states = study.selection.filter, study.main.path.t[:-1], study.scenario.vehicle.states
    panels = draw_predicted(answer, t, states).axes[:5]
    for i, (axes, signal) in enumerate(zip(panels, states, strict=True)):
        line = max(axes.get_lines(), key=lambda each: each.get_linewidth())
        np.testing.assert_allclose(line.get_ydata(), signal.display_unit[0] * answer.schedule.predicted[:, i], rtol=1e-9)
    assert np.all(answer.band[0] <= answer.band[1])


@pytest.mark.parametrize(
    ("selection", "first"),
    [
        ("", "minimised: the sum of the variances of the filter's errors, averaged over the way"),
        ('[selection]\nover = "worst"', "minimised: the sum of the variances of the filter's errors, at the worst instant"),
        ('[selection]\nquestion = "start"', "maximised: λmin of the information about the state at the start"),
    ],
)
def test_the_verb_says_first_what_was_asked_and_needs_no_design(selection, first, study, tmp_path, capsys, monkeypatch):
    (tmp_path / "float.toml").write_text(FLOAT.split("[[manoeuvres]]")[0].replace("SELECTION", selection))
    (tmp_path / "bent.csv").write_text(trajectory_csv(study.scenario.system, study.main.path))
    monkeypatch.chdir(tmp_path)
    shown, told = (_printed(capsys, "select", "bent.csv", "--scenario", "float.toml", *options) for options in ((), ("--json",)))
    assert shown.startswith(first)
    assert "\\[" not in shown
    assert json.loads(told)["selection"]["question"] == ("start" if "start" in selection else "filter")


def _printed(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    """What a command prints that ends well, in this process."""
    with pytest.raises(SystemExit) as end:
        main(words)
    out, err = capsys.readouterr()
    assert (end.value.code, err) == (0, "")
    return out
