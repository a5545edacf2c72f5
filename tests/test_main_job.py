"""The main job, in a subprocess: what the study of the Aerosonde in wind must find."""

from __future__ import annotations

import json

import numpy as np
import pytest
from conftest import AEROSONDE, obsdesign


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
