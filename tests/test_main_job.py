"""The main job: what the study of the Aerosonde in wind must find, in a subprocess; truths of the other scenarios."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from conftest import AEROSONDE, ROOT, obsdesign

import obsdesign as od
from obsdesign.design.feasibility import violations
from obsdesign.study.candidate_paths import candidates_of
from obsdesign.study.problem import problem_of
from obsdesign.study.runner import analyse

OTHERS = sorted(file for file in (ROOT / "scenarios").glob("*.toml") if file != AEROSONDE)


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    folder = tmp_path_factory.mktemp("main_job")
    done = obsdesign("run", AEROSONDE, "--out", "out", "--json", folder=folder)
    assert (done.returncode, done.stderr) == (0, "")
    return json.loads(done.stdout)


def test_every_expected_value_is_met(result):
    assert len(result["expected"]) >= 9
    assert all(each["met"] for each in result["expected"])


def test_the_hidden_direction_of_gps_on_a_straight_leg_is_heading_against_wind(result):
    verdict = result["analyses"]["straight"]["gps"]
    expected = np.array([0, 0, 1, 20 * np.sin(np.pi / 6), -20 * np.cos(np.pi / 6)])
    (direction,) = np.array(verdict["null_space"])
    assert abs(direction @ expected) == pytest.approx(np.linalg.norm(expected), rel=1e-9)
    assert verdict["hidden"].startswith("heading cannot be told from wind_x, wind_y")
    assert verdict["unobservable_states"] == ["heading", "wind_x", "wind_y"]


def test_with_all_sensors_the_designed_path_beats_the_weave_and_ten_times_the_constant_heading(result):
    value = {name: path["quality"]["all"]["value"] for name, path in result["paths"].items()}
    assert value["designed"] > value["weave"]
    assert value["designed"] >= 10 * value["straight"]
    assert result["paths"]["designed"]["feasible"]
    assert result["paths"]["weave"]["feasible"]


def test_with_gps_alone_the_design_reaches_its_cap_in_closed_form(result):
    t = np.arange(120.0)
    rows = np.stack([np.full(120, 50.0), 5.0 * t], axis=1) / 2.0
    cap = np.linalg.eigvalsh(rows.T @ rows)[0]
    assert result["designs"]["gps"]["cap"]["value"] == pytest.approx(cap, rel=1e-12)
    assert result["designs"]["gps"]["value"] == pytest.approx(cap, rel=1e-6)
    for path in result["paths"].values():
        assert path["quality"]["gps"]["value"] <= cap * (1 + 1e-12)


def test_the_schedule_lies_below_its_bound_and_above_everything_naive(result):
    selection = result["selection"]
    naive = [*selection["naive"].values(), selection["random_best"]]
    assert max(naive) < selection["value"] <= selection["bound"] <= selection["root_bound"]
    assert selection["gap"] == pytest.approx(1 - selection["value"] / selection["bound"])
    assert np.all(np.sum(selection["chosen"], axis=1) == 1)


def test_the_filter_is_consistent_on_the_designed_path_and_knows_the_wind_better_than_straight(result):
    designed, straight = result["validation"]["designed"]["chosen"], result["validation"]["straight"]["gps always"]
    assert designed["verdict"] == "consistent"
    assert designed["in_band"] >= 0.65
    assert straight["verdict"] == "overconfident"

    def wind_error(check):
        return np.hypot(check["final_rmse"]["wind_x"], check["final_rmse"]["wind_y"])

    assert wind_error(designed) < wind_error(straight)


@pytest.mark.slow
@pytest.mark.parametrize("file", OTHERS, ids=lambda file: file.stem)
def test_every_other_scenario_meets_its_expected_values(file, tmp_path):
    done = obsdesign("run", file, "--out", "out", "--json", folder=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    expected = json.loads(done.stdout)["expected"]
    assert expected
    assert all(each["met"] for each in expected)


# ---------------------------------------------------------------- three landmarks: Belo, Salaris and Bicchi 2010, section IV-B


@pytest.fixture(scope="module")
def landmarks():
    return od.load_scenario(ROOT / "scenarios" / "three_landmarks_path.toml")


@pytest.fixture(scope="module")
def naive(landmarks):
    """The path along the circle, as the study has it; its design stands for any."""
    problem = problem_of(landmarks, landmarks.sensor_names)
    path = od.simulate(problem.system, problem.x0, np.tile(problem.grid.centre, (problem.steps, 1)), problem.step)
    design = od.Design(problem, path, None, problem.value(path), od.Status.LOCALLY_OPTIMAL, ())
    _, candidates = candidates_of(landmarks, (replace(design),))
    return problem, next(each for each in candidates if each.name == landmarks.baselines[0].name)


def test_along_the_circle_the_hidden_direction_is_that_of_a_turn_about_the_circle_s_centre(landmarks, naive):
    problem, candidate = naive
    # moved along the circle by 1 rad, at 0.49 m/s: x by the radius, heading by half an angle at the centre, side slip with the heading
    direction = np.array([20.0, 0.0, 0.5, 0.0, 0.245, 0.0]) / problem.units
    direction /= np.linalg.norm(direction)
    quality = candidate.qualities[0]
    assert abs(direction @ quality.weakest) == pytest.approx(1, abs=1e-6)
    assert abs(quality.value) < 1e-6
    assert quality.eigenvalues[1] > 1
    (verdict,) = (
        each.verdict
        for each in analyse(landmarks.model_copy(update={"manoeuvres": landmarks.manoeuvres[:1]}), 0)
        if each.sensors == landmarks.sensor_names
    )
    hidden = verdict.null_space[:, 0] / problem.units
    assert abs(hidden @ direction) / np.linalg.norm(hidden) == pytest.approx(1, rel=1e-9)


def test_the_naive_path_follows_the_circle_to_the_goal_and_keeps_every_limit_but_the_clearance(naive):
    problem, candidate = naive
    radius = np.hypot(*candidate.path.x[:, :2].T)
    np.testing.assert_allclose(radius, 20.0, rtol=1e-6)
    assert not candidate.violations
    circle = od.CircleClearance(2.0, 20.0)
    clear = replace(problem, constraints=(*problem.constraints, circle))
    assert [each.constraint for each in violations(clear, candidate.path)] == [circle]
    assert np.hypot(*(candidate.path.x[-1, :2] - [0.0, 20.0])) == pytest.approx(0.11, abs=0.01)
