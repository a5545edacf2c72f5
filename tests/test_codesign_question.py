"""[codesign] question: path and schedule together for what a filter knows, or for what all samples say of the start."""

from __future__ import annotations

import numpy as np
import pytest
from test_filter_question import words_of

import obsdesign as od
from obsdesign.report.to_document import document_of
from obsdesign.study.record import Study, schedule_at_steps

DRIFT = """
title = "A float that steers"
question = "Where to, and with which sensor on?"
vehicle = {kind = "dubins", speed = 1.0, wind = "constant"}
sensors = [{kind = "gps", sigma = 2.0}, {kind = "bearing", beacon = [10.0, 8.0], sigma_deg = 5.0}]
start = {x = 0.0, y = 0.0, heading = 0.0, wind_x = 0.2, wind_y = 0.1}
prior = {x = 5.0, y = 5.0, heading = 0.1, wind_x = 0.3, wind_y = 0.3}
process_noise = {heading = 0.01}
time = {duration = 12.0, step = 1.0, segment = 4.0}
validation = {runs = 10}
SELECTION
[[manoeuvres]]
name = "turning"
[design]
path = {kind = "piecewise_constant", pieces = 3}
bounds = {turn_rate = [-0.3, 0.3]}
starts = 1
[codesign]
starts = 1
"""


def scenario_of(folder, selection: str = "", codesign: str = ""):
    (folder / "drift.toml").write_text(DRIFT.replace("SELECTION", selection) + codesign)
    return od.load_scenario(folder / "drift.toml")


@pytest.fixture(scope="module")
def study(tmp_path_factory) -> Study:
    return od.run(scenario_of(tmp_path_factory.mktemp("drift"), codesign='question = "filter"'))


def cost_of(study: Study, path: od.Trajectory, chosen: np.ndarray) -> float:
    """Mean of the trace of S^-1 P_k S^-1, from the posterior alone."""
    scenario, scale = study.scenario, study.scenario.prior_at_start.std
    active = schedule_at_steps(chosen, study.main.nodes)
    J = od.posterior_information(scenario.system, path, scenario.prior_at_start, scenario.disturbance_psd, active=active)[:-1]
    return float(np.mean([np.trace(np.linalg.inv(scale[:, None] * J_k * scale)) for J_k in J]))


def test_path_and_schedule_together_cost_the_filter_what_the_posterior_says(study):
    joint = study.joint
    costs = {
        name: cost_of(study, pair.design.trajectory, pair.schedule.chosen)
        for name, pair in (("path", joint.path_first), ("sensors", joint.sensors_first))
    }
    together = cost_of(study, joint.design.trajectory, joint.schedule.chosen)
    assert joint.value == pytest.approx(-together, rel=1e-9)
    assert together <= min(costs.values()) * (1 + 1e-9)
    part = document_of(study).model_dump(mode="json")["joint"]
    assert (part["question"], part["joint"]["value"]) == ("filter", joint.value)
    assert part["path_first"]["value"] == pytest.approx(-costs["path"], rel=1e-9)


def test_the_page_says_what_they_leave_of_the_filters_error(study):
    words = words_of(study)
    assert "What is made small is the sum of the variances of the filter's errors, averaged over the way." in words
    assert "Good: together is never above the others" in words


def test_the_question_is_that_of_the_selection_unless_it_is_given(tmp_path):
    questions = [scenario_of(tmp_path, each).codesign_question for each in ("", '[selection]\nquestion = "start"')]
    assert questions == ["filter", "start"]
    assert scenario_of(tmp_path, '[selection]\nquestion = "start"', 'question = "filter"').codesign_question == "filter"
    with pytest.raises(od.ScenarioError, match=r"codesign.question: is 'cheapest': must be 'filter' or 'start'"):
        scenario_of(tmp_path, codesign='question = "cheapest"')


def test_a_filter_may_be_judged_by_another_criterion_than_the_path(tmp_path):
    other = '[selection]\ncriterion = "log_det"\n'
    assert scenario_of(tmp_path, other, 'question = "filter"').codesign_criterion.criterion == od.LogDet()
    with pytest.raises(od.ScenarioError, match=r"selection.criterion: is log_det: \[codesign\] needs that of the design"):
        scenario_of(tmp_path, other, 'question = "start"')
