"""From a result to a mission: which points stay, what flying through them costs, and the verb that does it."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from conftest import obsdesign
from test_select_verb import FLOAT

import obsdesign as od
from obsdesign.cli.parser import build_parser
from obsdesign.cli.table import VERBS
from obsdesign.cli.verbs.export import export_document
from obsdesign.exchange.export_result import export, track_of
from obsdesign.exchange.formats import FORMATS, format_of, read_track
from obsdesign.exchange.words import FORMAT_WORDS, MISSION_WORDS
from obsdesign.report.folder import write_report
from obsdesign.report.html import page_of
from obsdesign.report.to_document import document_of
from obsdesign.study.runner import run
from obsdesign.study.thinned_flight import Thinning, judge_way_points
from obsdesign.study.thinned_path import points_every, polyline_distances, segment_distances, thin
from obsdesign.study.way_point_flight import GUIDANCE, fly_way_points

PLACE = "\n[place]\nlatitude = 47.4\nlongitude = 8.5\naltitude = 400.0\nheight = 60.0\nbearing_deg = 90.0\n"
AIRCRAFT = od.System(od.Dubins(20.0), (od.GPS(1.0),))


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """A float on a given path, at a place."""
    file = tmp_path_factory.mktemp("asked") / "float.toml"
    file.write_text(FLOAT.replace("SELECTION", "") + PLACE)
    scenario = od.load_scenario(file)
    return run(scenario.model_copy(update={"paths": scenario.paths[:1]}))


@pytest.fixture(scope="module")
def result(study, tmp_path_factory):
    folder = tmp_path_factory.mktemp("result") / "out"
    write_report(folder, study)
    return folder


# ---------------------------------------------------------------- which points stay


@pytest.mark.parametrize("seed", range(8))
def test_no_point_is_farther_from_the_thinned_path_than_the_tolerance(seed):
    random = np.random.default_rng(seed)
    points = np.cumsum(random.normal(0, 1, (150, 2)), axis=0)
    points[40] = points[39]  # stands still
    tolerance, always = float(random.uniform(0.1, 3)), (17, 99)
    stays = thin(points, tolerance, always)
    assert {0, 17, 99, 149} <= set(stays.tolist())
    for first, last in pairwise(stays):
        assert segment_distances(points[first : last + 1], points[first], points[last]).max() <= tolerance
    assert len(thin(points, 1e-12)) >= len(stays) >= len(thin(points, 100.0, always)) == 4


def test_a_line_needs_its_ends_and_a_way_back_its_turn():
    line = np.column_stack([np.linspace(0, 9, 50), np.linspace(0, 3, 50)])
    assert thin(line, 1e-9).tolist() == [0, 49]
    assert thin(np.vstack([line, line[::-1]]), 0.01).tolist() == [0, 49, 99]
    with pytest.raises(od.InputError, match="tolerance is 0"):
        thin(line, 0.0)


def test_points_every_so_many_seconds_are_the_first_of_each_period():
    t = np.arange(0, 10.3, 0.3)
    stays = points_every(t, 2.0, (5,))
    assert stays.tolist() == sorted({0, 5, len(t) - 1, *(int(np.argmax(t >= 2 * k - 1e-9)) for k in range(1, 6))})


def test_distances_from_a_line_of_short_steps_are_those_of_brute_force():
    random = np.random.default_rng(0)
    angle = np.linspace(0, 5, 400)
    line = np.column_stack([50 * np.cos(angle), 50 * np.sin(angle)])
    points = line[::7] + random.normal(0, 3, (len(line[::7]), 2))
    brute = np.min([segment_distances(points, start, end) for start, end in pairwise(line)], axis=0)
    np.testing.assert_allclose(polyline_distances(points, line), brute, atol=1e-3)


# ---------------------------------------------------------------- flying through them


@pytest.mark.parametrize("autopilot", GUIDANCE)
def test_a_small_error_of_course_dies_as_the_damped_oscillation_of_the_guidance(autopilot):
    """Near a leg y'' + 2 damping omega y' + omega^2 y = 0, omega = 2 pi / period: with y(0) = 0, y'(0) = V delta in closed form."""
    guidance, delta, step = GUIDANCE[autopilot], 0.01, 0.05
    ahead = od.simulate(AIRCRAFT, [0.0, 0.0, 0.0], np.zeros((400, 1)), step)
    turned = replace(ahead, x=np.vstack([[0.0, 0.0, delta], ahead.x[1:]]))
    flown, reached = fly_way_points(AIRCRAFT, turned, np.array([0, 400]), (-1.0, 1.0), autopilot)
    omega = 2 * math.pi / guidance.period
    damped = omega * math.sqrt(1 - guidance.damping**2)
    expected = 20 * delta / damped * np.exp(-guidance.damping * omega * flown.t) * np.sin(damped * flown.t)
    assert reached
    np.testing.assert_allclose(flown.x[:, 1], expected, atol=0.05 * expected.max())


def test_turns_keep_the_bounds_and_corners_are_cut():
    corner = np.vstack([np.zeros((50, 1)), np.full((1, 1), math.pi / 2), np.zeros((50, 1))])
    path = od.simulate(AIRCRAFT, [0.0, 0.0, 0.0], corner, 1.0)
    flown, reached = fly_way_points(AIRCRAFT, path, np.array([0, 50, 101]), (-0.2, 0.2), "px4")
    assert reached and np.abs(flown.u).max() <= 0.2
    radius = 20 / 0.2
    cut = np.linalg.norm(flown.x[:, :2] - path.x[50, :2], axis=1).min()
    assert 0 < cut < radius  # the turn begins before the way point, and no turn is tighter than its radius


def test_a_straight_path_costs_nothing_and_a_bent_one_through_its_ends_does(study):
    scenario, path, chosen = study.scenario, study.main.path, study.selection.chosen
    everything = judge_way_points(scenario, path, chosen, np.arange(len(path.t)), Thinning(None), "px4")
    ends = judge_way_points(scenario, path, chosen, np.array([0, path.steps]), Thinning(1e9), "px4")
    assert everything.deviation < 2.0 < ends.deviation
    assert everything.smallest_eigenvalue[0] == pytest.approx(study.main.qualities[0].eigenvalues[0], rel=1e-9)
    assert abs(math.log(everything.smallest_eigenvalue[1] / everything.smallest_eigenvalue[0])) < abs(
        math.log(ends.smallest_eigenvalue[1] / ends.smallest_eigenvalue[0])
    )
    active = np.repeat(chosen, np.diff(study.main.nodes), axis=0)
    J = od.posterior_information(scenario.system, path, scenario.prior_at_start, scenario.disturbance_psd, active=active)
    np.testing.assert_allclose(everything.std[0], np.sqrt(np.diag(np.linalg.inv(J[-1]))), rtol=1e-9)
    assert "2 of 31 points" in ends.in_words and "lambda_min" in ends.in_words


def test_a_vehicle_without_heading_has_files_but_no_flight():
    x = ca.SX.sym("x", 2)
    system = od.ControlAffineSystem(state=x, names=("x", "y"), drift=None, known={"u": ca.vertcat(1, 0)}, outputs={"z": x[0]})
    path = od.simulate(system, [0.0, 0.0], np.ones((4, 1)), 1.0)
    with pytest.raises(od.InputError, match="vehicles with heading and turn_rate"):
        fly_way_points(system, path, np.array([0, 4]), (-1, 1), "px4")


# ---------------------------------------------------------------- axes


@pytest.mark.parametrize("bearing", [0.0, 90.0, 215.0])
def test_the_x_axis_points_to_its_bearing_and_y_to_the_left_of_it(study, bearing):
    place = study.scenario.place.model_copy(update={"bearing": math.radians(bearing), "east": 30.0, "north": -7.0})
    track = track_of(study.scenario.model_copy(update={"place": place}), study.main.path, None)
    b, (x, y, heading) = math.radians(bearing), study.main.path.x[:, :3].T
    np.testing.assert_allclose(track.position[:, 0], 30 + x * math.sin(b) - y * math.cos(b), atol=1e-9)
    np.testing.assert_allclose(track.position[:, 1], -7 + x * math.cos(b) + y * math.sin(b), atol=1e-9)
    nose = np.mod(b - heading, 2 * np.pi)  # compass: clockwise, and x is at b
    np.testing.assert_allclose(np.mod(np.pi / 2 - track.heading, 2 * np.pi), nose, atol=1e-9)
    assert track.through_medium and track.cruise == pytest.approx(1.0, rel=1e-3)


# ---------------------------------------------------------------- from a result's folder


def test_the_words_are_those_of_the_formats():
    assert set(FORMAT_WORDS) == set(FORMATS) and set(MISSION_WORDS) == {word for word in FORMATS if format_of(word).is_mission}


@pytest.mark.parametrize("word", FORMATS)
def test_every_format_is_made_of_a_result(result, study, word, tmp_path):
    done = export(result, word, tmp_path / f"path{format_of(word).suffix}")
    track = read_track(done.files[0])
    assert len(track.t) == done.points
    is_mission = word in MISSION_WORDS
    assert (done.thinned is not None) == is_mission == (done.points < 31)
    if word != "wpl":
        assert (track.origin.latitude, track.origin.longitude, track.origin.altitude) == (47.4, 8.5, 400.0)
        assert np.array_equal(track.sensors.chosen, study.selection.chosen)
        np.testing.assert_allclose(track.position[[0, -1], :2], study.main.path.x[[0, -1], :2], atol=2e-3)
        assert track.position[0, 2] == pytest.approx(60.0)


def test_the_page_says_what_way_points_cost(study, result, tmp_path):
    thinned = export(result, "plan", tmp_path / "x.plan", tolerance=3.0, autopilot="ardupilot").thinned
    page = page_of(replace(study, way_points=(thinned,)))
    assert "As way points?" in page and "within 3 m, ardupilot" in page


def test_the_document_says_what_way_points_cost(study, result, tmp_path):
    done = export(result, "plan", tmp_path / "x.plan", tolerance=3.0)
    (told,) = document_of(replace(study, way_points=(done.thinned,))).way_points
    assert (told.points, told.of, told.tolerance, told.every) == (done.points, 31, 3.0, None)
    assert export_document(done)["thinned"] == told.model_dump(mode="json")
    # along the path itself it is what the study says: information with all sensors on, the filter's bound with the schedule at the end
    assert told.lambda_min[0] == pytest.approx(study.candidates[0].qualities[0].eigenvalues[0], rel=1e-9)
    chosen = next(check.validation for check in study.checks if check.schedule == "chosen")
    assert [before for before, _ in told.std.values()] == pytest.approx(chosen.bound[-1], rel=1e-9)


def verb(*arguments: str):
    """Do what a command line asks for, in this process."""
    options = build_parser(VERBS).parse_args(arguments)
    return options.verb.action(options)


def test_the_verb_writes_and_tells(result):
    done = verb("export", str(result), "--to", "plan", "--every", "4s", "--autopilot", "ardupilot", "--switches", "gps=2")
    text = "\n".join(done.shown)
    assert "one every 4 s" in text and "lambda_min" in text
    assert json.loads((result / "path.plan").read_text())["mission"]["firmwareType"] == 3
    assert (result / "path.plan.sensors.csv").is_file()
    told = verb("export", str(result), "--to", "kml").document
    assert told == {"files": [str(result / "path.kml")], "points": 31, "thinned": None, "notes": []}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--to", "plam"), "did you mean 'plan'?"),
        (("--to", "plan", "--every", "4s", "--tolerance", "2m"), "tolerance and every are both given"),
        (("--to", "plan", "--tolerance", "0m"), "'0m' must be a number above 0, in m"),
        (("--to", "plan", "--switches", "gp=1"), "there is no sensor 'gp'"),
    ],
)
def test_what_cannot_be_meant_is_bad_input(result, arguments, message):
    with pytest.raises(od.InputError, match=re.escape(message)):
        verb("export", str(result), *arguments)


def test_a_folder_that_is_no_result_is_refused(tmp_path):
    with pytest.raises(od.InputError, match=r"has no question\.toml: must be a folder that obsdesign run or select wrote"):
        export(tmp_path, "kml")


def test_formats_of_places_are_refused_before_a_run_that_has_none(tmp_path):
    file = tmp_path / "float.toml"
    for text, extra, message in (
        ("", "kml", "kml needs a place on Earth"),
        (PLACE.replace("height = 60.0\n", ""), "csv,plan", "place.height"),
    ):
        file.write_text(FLOAT.replace("SELECTION", "") + text)
        with pytest.raises(od.InputError, match=message):
            verb("run", str(file), "--export", extra, "--out", str(tmp_path / "out"))
        assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_run_exports_beside_its_page(tmp_path):
    one_path = FLOAT.replace("SELECTION", "").replace("runs = 10", "runs = 2").partition('[[paths]]\nname = "line"')[0]
    (tmp_path / "float.toml").write_text(one_path + PLACE)
    done = obsdesign("run", "float.toml", "--export", "plan,kml", "--tolerance", "1m", "--out", "out", "--jobs", "1", folder=tmp_path)
    assert done.returncode == 0 and "within 1 m of the path" in done.stdout
    names = {file.name for file in (tmp_path / "out").iterdir()}
    assert {"path.plan", "path.plan.sensors.csv", "path.kml", "report.html"} <= names
    assert "As way points?" in (tmp_path / "out" / "report.html").read_text()
