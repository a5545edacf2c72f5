"""Truths about report.html: self-contained, every number with its unit, every table with what is good, numbers of the study."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import replace
from html import escape
from html.parser import HTMLParser
from pathlib import Path

import jsonschema
import matplotlib as mpl
import numpy as np
import pytest

import obsdesign as od
import obsdesign.constraints
from obsdesign.constraints.goal import Goal
from obsdesign.design.initial_guesses import shortest_inputs
from obsdesign.design.record import Evidence, Optimum, Start
from obsdesign.design.violation import InputBound, InputRate, Violation, ViolationKind
from obsdesign.families import kinds, leaf
from obsdesign.moment import Moment
from obsdesign.paths.piecewise_constant import PiecewiseConstant
from obsdesign.report import derived_quantities as facts
from obsdesign.report.document import Result
from obsdesign.report.figures import path_map
from obsdesign.report.figures._map import shapes
from obsdesign.report.figures.clearance_histories import clearances
from obsdesign.report.html import page_of
from obsdesign.report.names import violation_in_words
from obsdesign.report.number_format import MINUS, NARROW, numeral, percent, plain, rounded_up, typeset
from obsdesign.report.sections._paths import paths_table
from obsdesign.report.sections.design import design_in_words, starts_table
from obsdesign.report.sections.filter_schedule import questions_table
from obsdesign.report.sections.flight import answer as flight_answer
from obsdesign.report.sections.flight import errors_table, final_errors, flight_violations, plans_table, smallest_margin
from obsdesign.report.sections.glossary import glossary
from obsdesign.report.sections.observability import subsets_table
from obsdesign.report.sections.schedule import losses_table, schedules_table, usage_table
from obsdesign.report.sections.validation import checks_table, consistency_notes
from obsdesign.report.table import Table
from obsdesign.report.to_document import document_of
from obsdesign.scenario.loading import load_scenario
from obsdesign.status import Status
from obsdesign.study.record import Study, schedule_at_steps
from obsdesign.study.runner import run

AEROSONDE = Path(__file__).parent.parent / "scenarios" / "aerosonde_wind.toml"
VOID = {"meta", "br", "hr", "img", "link", "input", "source", "wbr", "col", "area", "base", "embed", "track"}
ROVER = """
title = "Rover <in> a yard"
question = "Where am I?"
vehicle = {kind = "unicycle"}
sensors = [{kind = "gps", sigma = 0.5}, {kind = "magnetometer", sigma_deg = 10.0}, {kind = "gps", sigma = 0.7}]
start = {x = 0.0, y = 0.0, heading_deg = 20.0}
prior = {x = 2.0, y = 2.0, heading = 0.2}
process_noise = {heading = 0.01}
time = {duration = 12.0, step = 1.0, segment = 2.0}
selection = {per_segment = 2}
validation = {runs = 20}
[design]
criterion = "trace_inverse"
starts = 1
path = {kind = "piecewise_constant", pieces = 6}
bounds = {turn_rate = [-0.5, 0.5], speed = [0.2, 1.0]}
constraints = [{kind = "goal", point = [6.0, 2.0], tolerance = 1.5}]
[flight]
every = 2.0
duration = 12.0
horizon = "shrinking"
"""
ROBOT = """
title = "Robot among three beacons"
question = "Where am I?"
vehicle = {kind = "omnidirectional"}
sensors = [
  {kind = "bearing", name = "west", beacon = [-20.0, 0.0], sigma = 0.02},
  {kind = "bearing", name = "north", beacon = [-12.0, 16.0], sigma = 0.02},
  {kind = "bearing", name = "south", beacon = [-12.0, -16.0], sigma = 0.02},
]
start = {x = 0.0, y = -20.0, heading = 0.0}
prior = {x = 1.0, y = 1.0, heading = 0.1}
process_noise = {x = 0.01, y = 0.01, heading = 0.001}
time = {duration = 11.0, step = 1.0, segment = 4.0}
selection = {per_segment = 2}
validation = {runs = 20}
[[manoeuvres]]
name = "free"
[[baselines]]
name = "along the circle"
inputs = {forward = 0.5, turn_rate = 0.025}
[design]
criterion = "min_eigenvalue"
about = ["x", "y"]
starts = 1
shortest = 10.0
path = {kind = "piecewise_constant", pieces = 2}
bounds = {forward = [0.2, 0.6], sideways = [-0.2, 0.2], turn_rate = [-0.1, 0.1]}
constraints = [
  {kind = "circle_clearance", clearance = 0.5, time_scale = 20.0},
  {kind = "keep_in", corners = [[-25.0, -30.0], [25.0, -30.0], [25.0, 30.0], [-25.0, 30.0]]},
  {kind = "max_range", distance = 60.0},
]
prices = [{kind = "path_length", per_unit = 0.001}]
robust = {samples = 2}
"""
SVGS = {"aerosonde": 11, "rover": 13, "robot": 12}


class Document(HTMLParser):
    """The elements of a page; open ones must be closed in order."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def values(self, attribute: str) -> list[str]:
        return [str(attributes[attribute]) for _, attributes in self.elements if attribute in attributes]

    def count(self, tag: str) -> int:
        return sum(name == tag for name, _ in self.elements)


@pytest.fixture(scope="module")
def aerosonde() -> Study:
    full = load_scenario(AEROSONDE)
    time = full.time.model_copy(update={"duration": 30.0, "step": 1.0})
    near = Goal((430.0, 260.0), 120.0)
    constraints = tuple(near if isinstance(each, Goal) else each for each in full.design.constraints)
    design = full.design.model_copy(update={"starts": 1, "path": PiecewiseConstant(6), "constraints": constraints})
    validation = full.validation.model_copy(update={"runs": 20})
    return run(full.model_copy(update={"time": time, "design": design, "validation": validation}))


@pytest.fixture(scope="module")
def rover(tmp_path_factory) -> Study:
    """Two inputs, no wind, no landmark, no other suite, no weave, another criterion, two sensors at a time, a flight."""
    file = tmp_path_factory.mktemp("rover") / "rover.toml"
    file.write_text(ROVER)
    study = run(load_scenario(file))
    return replace(study, weave=None, candidates=tuple(each for each in study.candidates if each.name != "weave"))


@pytest.fixture(scope="module")
def robot(tmp_path_factory) -> Study:
    """Three inputs, no wind, bearings alone, no goal, a baseline, a duration to choose, prices, draws of the prior, two states judged."""
    file = tmp_path_factory.mktemp("robot") / "robot.toml"
    file.write_text(ROBOT)
    return run(load_scenario(file))


@pytest.fixture(scope="module")
def pages(aerosonde, rover, robot) -> dict[str, str]:
    return {"aerosonde": page_of(aerosonde), "rover": page_of(rover), "robot": page_of(robot)}


@pytest.fixture(params=list(SVGS))
def page(pages, request) -> str:
    return pages[request.param]


@pytest.fixture(params=list(SVGS))
def study(request) -> Study:
    return request.getfixturevalue(request.param)


def all_tables(study: Study) -> list[Table]:
    starts = [starts_table(study, i) for i in range(len(study.suites))]
    flown = [] if study.flight is None else [errors_table(study, study.flight), plans_table(study.flight)]
    return [
        subsets_table(study.analyses),
        paths_table(study),
        *starts,
        questions_table(study, study.selection.filter),
        schedules_table(study),
        usage_table(study),
        losses_table(study),
        checks_table(study),
        *flown,
    ]


def test_page_is_well_formed_and_small(page):
    document = Document(page)
    assert document.open == []
    assert len(page.encode()) < 1.5e6


def test_page_refers_to_nothing_outside_itself(page):
    document = Document(page)
    assert "http:" not in page
    assert "https:" not in page
    assert "@import" not in page
    assert {"script", "link", "img", "iframe", "object"}.isdisjoint(tag for tag, _ in document.elements)
    references = [value for name in ("src", "href", "xlink:href", "data", "poster") for value in document.values(name)]
    assert all(reference.startswith("#") for reference in references)
    assert all(target.startswith("#") for target in re.findall(r"url\(([^)]*)\)", page))


def test_ids_are_unique_and_every_reference_has_its_target(page):
    document = Document(page)
    ids = Counter(document.values("id"))
    assert max(ids.values()) == 1
    targets = [value[1:] for name in ("href", "xlink:href") for value in document.values(name)]
    targets += re.findall(r"url\(#([^)]*)\)", page) + document.values("aria-labelledby")
    assert set(targets) <= set(ids)


@pytest.mark.parametrize("name", SVGS)
def test_every_figure_is_a_scalable_drawing_with_a_caption(pages, name):
    page, count = pages[name], SVGS[name]
    assert len(re.findall(r'<figure class="picture">\s*<svg viewBox="[^"]+" role="img" aria-label="[^"]+">', page)) == count
    assert Document(page).count("svg") == count
    assert len(re.findall(r"</svg>\s*<figcaption>[^<]{20,}", page)) == count


def test_every_table_says_what_is_good(page):
    captions = re.findall(
        r'<figure class="table[^"]*">\s*<figcaption[^>]*><b>.+?</b> (Good\b.{10,}?)</figcaption>\s*<div[^>]*>\s*<table', page
    )
    assert len(captions) == Document(page).count("table") > 0


@pytest.mark.parametrize("name", ["rover", "robot"])
def test_a_page_speaks_of_nothing_that_its_study_does_not_have(pages, name):
    words = re.sub(r"<(style|svg)\b.*?</\1>|<[^>]+>", " ", pages[name], flags=re.DOTALL).lower()
    missing = {"rover": ["wind", "beacon", "circle"], "robot": ["wind", "gps", "goal", "magnetometer"]}[name]
    assert [word for word in [*missing, "gust", "aircraft", "dubins", "airspeed", "pilot"] if re.search(rf"\b{word}s?\b", words)] == []


def test_every_number_in_a_table_has_its_unit(study):
    for table in all_tables(study):
        for row in table.rows:
            assert len(row) == len(table.head)
            for cell, head in list(zip(row, table.head, strict=True))[1:]:
                if cell.text.lstrip(MINUS + "≥" + NARROW)[:1].isdigit():
                    assert re.search(r" \[[^\]]+\]$", head), (table.title, head)


@pytest.mark.parametrize("name", SVGS)
def test_the_questions_come_in_order_each_with_an_answer(pages, name):
    page = pages[name]
    found = re.findall(r"<h2>(\d [^<]+)</h2>\s*<p class=\"says\">(.+?)</p>", page)
    asked = ["1 Can it?", "2 How?", "3 Which?", "4 Does it hold?", "5 In flight?"]
    assert [question for question, _ in found] == asked[: 5 if name == "rover" else 4]
    assert all(answer.endswith(".") and any(letter.isdigit() for letter in answer) for _, answer in found)
    assert len(re.findall(r'<p class="answer">', page)) == 1


def test_text_from_the_scenario_is_escaped(pages):
    assert "<h1>Rover &lt;in&gt; a yard</h1>" in pages["rover"]


def test_the_same_study_gives_the_same_drawing_whatever_the_global_style(aerosonde):
    before = path_map.picture(aerosonde)
    with mpl.rc_context({"font.size": 30.0, "svg.fonttype": "none", "axes.grid": True}):
        style = dict(mpl.rcParams)
        assert path_map.picture(aerosonde) == before
        assert dict(mpl.rcParams) == style


def test_dimensions_are_those_of_brace_and_morgansen(aerosonde):
    # Brace and Morgansen: Sigma_D straight and turning
    straight = {"gps": 4, "magnetometer": 1, "range": 3, "bearing": 3, "range + bearing": 4, "gps + bearing": 5, "gps + range": 4}
    turning = {"gps": 5, "magnetometer": 1, "range": 4, "bearing": 4, "range + bearing": 4, "gps + bearing": 5, "gps + range": 5}
    rows = {row[0].text: row for row in subsets_table(aerosonde.analyses).rows}
    assert len(rows) == 15
    for column, truth in ((1, straight), (2, turning)):
        assert {name: int(rows[name][column].text[0]) for name in truth} == truth


def test_hidden_states_are_called_hidden_and_their_eigenvalue_is_zero(aerosonde):
    table = paths_table(aerosonde)
    row = next(row for row in table.rows if (row[0].text, row[1].text) == ("straight", "gps alone"))
    cells = {head.split(" [")[0]: cell.text for head, cell in zip(table.head, row, strict=True)}
    assert cells["λmin"] == "0"
    assert [name for name, text in cells.items() if text == "hidden"] == ["heading", "wind_x", "wind_y"]
    assert cells["meets the limits"].startswith("no: misses the goal by")
    assert facts.hidden_states(aerosonde, facts.baseline(aerosonde)) == ("heading", "wind_x", "wind_y")


def test_shares_of_the_segments_add_up_to_the_smallest_eigenvalue(study):
    quality = study.candidate("designed").qualities[0]
    v, problem = quality.weakest, study.designs[0].problem
    W = problem.scaled(study.candidate("designed").information.total)
    assert v @ W @ v == pytest.approx(quality.eigenvalues[0], rel=1e-9)
    shares = facts.segment_shares(study)
    assert shares.min() >= 0
    assert shares.sum() == pytest.approx(1, rel=1e-12)


def test_ellipses_agree_with_the_bound_of_the_validation(study):
    bound = study.check("designed", "chosen").validation.bound[:, :2]
    deviations = np.sqrt(np.diagonal(facts.position_covariances(study), axis1=1, axis2=2))
    np.testing.assert_allclose(deviations, bound, rtol=1e-9)


def test_a_map_asks_for_the_posterior_once(aerosonde, monkeypatch):
    calls, ask = [], facts.posterior_information
    monkeypatch.setattr(facts, "posterior_information", lambda *given, **named: calls.append(given) or ask(*given, **named))
    assert "<svg" in path_map.picture(aerosonde).svg
    assert len(calls) == 1


def test_numbers_of_the_page_are_those_of_the_study(pages, aerosonde):
    page, schedule = pages["aerosonde"], aerosonde.selection.schedule
    for text in (numeral(aerosonde.designs[0].value), numeral(schedule.value), numeral(schedule.bound), percent(schedule.gap)):
        assert escape(text) in page
    assert aerosonde.scenario.digest in page
    assert f"--seed {aerosonde.seed}" in page


@pytest.mark.parametrize("kind", ["min_eigenvalue", "log_det", "trace_inverse"])
def test_the_formula_of_the_gap_gives_the_gap(rover: Study, kind: str):
    """Minus trace inverse is negative: 1 - value / bound would be too."""
    selection = rover.scenario.selection.model_copy(update={"criterion": kind})
    study = replace(rover, scenario=rover.scenario.model_copy(update={"selection": selection}))
    parts = np.random.default_rng(1).standard_normal((5, 4, 4, 1))
    schedule = od.select_sensors(parts @ parts.swapaxes(2, 3), criterion=study.scenario.schedule_criterion, gap=0.5, method="columns")
    assert schedule.bound - schedule.value > 1e-3 * abs(schedule.bound)
    (formula,) = re.findall(r"gap = ([^.]*)\.", dict(glossary(study))["bound and gap"])
    formula = formula.replace("−", "-").replace("|bound|", "abs(bound)")
    assert eval(formula, {"value": schedule.value, "bound": schedule.bound}) == pytest.approx(schedule.gap)  # noqa: S307  # the page's own formula


def test_an_overconfident_filter_is_explained(aerosonde):
    checks = tuple(
        replace(check, validation=replace(check.validation, verdict="overconfident")) if check.path == "straight" else check
        for check in aerosonde.checks
    )
    found = consistency_notes(replace(aerosonde, checks=checks))
    why = "overconfident, because these sensors do not see a combination of heading, wind_x and wind_y on this path"
    assert sum(why in reason for reason in found) >= 1


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (28395.95, f"28{NARROW}400"),
        (0.028, "0.0280"),
        (-1.5, f"{MINUS}1.50"),
        (999.6, f"1{NARROW}000"),
        (0.0, "0"),
        (1e-7, f"1.00{NARROW}·{NARROW}10⁻⁷"),
        (np.nan, "–"),
        (-np.inf, f"{MINUS}∞"),
    ],
)
def test_three_significant_digits(value, text):
    assert numeral(value) == text


@pytest.mark.parametrize("value", [3.14159e5, 1.0, 27.182, 6.02e-3, 0.09996, 99.96])
def test_rounding_keeps_the_value_to_half_a_unit_of_its_third_digit(value):
    shown = float(numeral(value).replace(NARROW, ""))
    assert abs(shown - value) <= 0.5 * 10 ** (np.floor(np.log10(value)) - 2) * (1 + 1e-9)


@pytest.mark.parametrize("value", [3.1411e5, 1.0, 27.111, 6.0201e-3, 0.09996, 99.96, 152.3, -3.1419, -99.94, 0.0, np.inf])
def test_what_nothing_is_above_is_rounded_up(value):
    shown = rounded_up(value)
    assert shown >= value
    assert shown == value or shown - value < 10 ** (np.floor(np.log10(abs(value))) - 2) * (1 + 1e-9)
    assert rounded_up(shown) == shown


def test_percentages_and_chosen_values():
    assert percent(0.0389) == f"3.89{NARROW}%"
    assert percent(1e-9) == f"<{NARROW}0.001{NARROW}%"
    assert plain(1300.0) == f"1{NARROW}300"
    assert plain(0.25) == "0.25"
    assert typeset("pivot 5.0e-01, -0.3 m of x, 256-bit") == f"pivot 0.500, {MINUS}0.3 m of x, 256-bit"


# ---------------------------------------------------------------- segments, paths, limits

EVERY_SHAPE = {
    "circle_clearance": (od.CircleClearance(1.0, 2.0, ((0.0, 1.0), (1.0, 0.0), (-1.0, 0.0))), 1),
    "goal": (od.Goal((1.0, 2.0), 3.0), 1),
    "goal_pose": (od.GoalPose((1.0, 2.0), 0.5, 3.0, 0.1), 1),
    "goal_region": (od.GoalRegion(((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))), 1),
    "ground_speed": (od.GroundSpeed(1.0), 0),
    "heading_sector": (od.HeadingSector(0.0, 1.0), 0),
    "keep_in": (od.KeepIn(((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))), 1),
    "keep_out": (od.KeepOut((1.0, 2.0), 3.0), 1),
    "keep_out_polygon": (od.KeepOutPolygon(((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))), 1),
    "loiter": (od.Loiter((1.0, 2.0), 3.0, 4.0), 1),
    "max_range": (od.MaxRange(5.0), 2),
    "stand_off": (od.StandOff(5.0), 2),
    "via": (od.Via((1.0, 2.0), 3.0), 1),
}
LANDMARKS = ((0.0, 7.0), (7.0, 0.0))


def test_every_kind_of_constraint_has_a_place_on_the_map_or_none_and_words_for_breaking_it():
    assert set(EVERY_SHAPE) == set(kinds(obsdesign.constraints))
    for kind, (constraint, count) in EVERY_SHAPE.items():
        assert leaf(obsdesign.constraints, kind) is type(constraint)
        assert len(shapes([constraint], LANDMARKS)) == count, kind
        words = violation_in_words(Violation(constraint, ViolationKind.CONSTRAINT, 1.0, 2.5, "m", -1.0))
        assert words.endswith(f"by 2.50{NARROW}m")
        assert "exceeds" not in words


def test_the_shapes_on_the_map_are_where_the_margins_are_zero():
    for constraint, count in EVERY_SHAPE.values():
        if not count or isinstance(constraint, od.CircleClearance):
            continue
        for shape in shapes([constraint], LANDMARKS):
            edge = np.vstack([shape.corners, shape.corners[:1]]) if shape.corners else None
            middle = (edge[:-1] + edge[1:]) / 2 if edge is not None else [(shape.centre[0] + shape.radius, shape.centre[1])]
            for point in middle:
                state = {"x": point[0], "y": point[1], "heading": getattr(constraint, "heading", 0.0)}
                margins = constraint.margins(Moment(state, {}, {}, LANDMARKS))
                lowest = max(margins, key=lambda margin: -abs(margin))
                # a polygon to keep out of is widened by less than this share of its size
                assert abs(lowest) < (0.03 if isinstance(constraint, od.KeepOutPolygon) else 1e-6)


@pytest.mark.parametrize(
    ("kind", "limit", "by", "unit", "text"),
    [
        (ViolationKind.CONSTRAINT, od.Goal((0.0, 0.0), 3.0), 3.2, "m", f"misses the goal by 3.20{NARROW}m"),
        (ViolationKind.START, od.KeepOut((0.0, 0.0), 3.0), 3.2, "m", f"enters a keep-out circle by 3.20{NARROW}m"),
        (
            ViolationKind.INPUT_BOUND,
            InputBound(od.Signal("turn_rate", "rad/s"), -0.1, 0.1),
            np.pi / 180,
            "rad/s",
            f"leaves the bounds of turn rate by 1.00{NARROW}deg/s",
        ),
        (
            ViolationKind.INPUT_RATE,
            InputRate(od.Signal("speed", "m/s"), 0.1),
            0.5,
            "m/s/s",
            f"changes speed too fast by 0.500{NARROW}m/s/s",
        ),
        (ViolationKind.BUDGET, od.Budget(od.PathLength(), 30.0), 12.0, "m", f"exceeds the budget of path length by 12.0{NARROW}m"),
        (
            ViolationKind.BUDGET,
            od.Budget(od.Effort({"turn_rate": 2.0}), 3.0),
            0.5,
            "",
            "exceeds the budget of effort (2 turn_rate^2) by 0.500",
        ),
        (ViolationKind.FLOOR, od.Floor(4.0, 2.0), 0.5, "", "sees too little for a while, falling short by 0.500"),
    ],
)
def test_what_a_path_breaks_is_told_in_words_and_units(kind, limit, by, unit, text):
    assert violation_in_words(Violation(limit, kind, 1.0, by, unit, -1.0)) == text


def test_how_far_the_straight_path_misses_the_goal_is_its_distance_from_the_disc(aerosonde):
    straight = aerosonde.candidate("straight")
    (x, y), goal = straight.path.x[-1, :2], aerosonde.scenario.design.constraints[0]
    missed = np.hypot(x - goal.point[0], y - goal.point[1]) - goal.tolerance
    assert missed > 0
    assert straight.violations[0].by == pytest.approx(missed, rel=1e-6)
    assert not straight.feasible
    assert f"misses the goal by {numeral(missed)}{NARROW}m" in page_of(aerosonde)


def test_the_shortest_way_ends_where_it_is_nearest_to_the_goal(aerosonde):
    candidate, problem = aerosonde.candidate("shortest"), aerosonde.designs[0].problem
    whole = od.simulate(problem.system, problem.x0, shortest_inputs(problem), problem.step)
    distance = np.hypot(*(whole.x[:, :2] - problem.constraints[0].point).T)
    assert candidate.path.steps == distance.argmin()
    assert candidate.feasible
    assert candidate.duration < aerosonde.main.duration


def test_segments_cover_a_path_of_any_length_the_last_being_shorter(robot):
    assert robot.main.path.steps in (10, 11)
    for candidate in robot.candidates:
        nodes, steps = candidate.nodes, candidate.path.steps
        assert nodes.tolist() == [0, 4, 8, steps]
        np.testing.assert_allclose(candidate.blocks.sum(axis=0), candidate.information.blocks.sum(axis=0), rtol=1e-12)
        np.testing.assert_allclose(candidate.blocks[2], candidate.information.blocks[8:].sum(axis=0), rtol=1e-12)
        np.testing.assert_allclose(candidate.contributions.shares.sum(axis=(1, 2)), 1, rtol=1e-9)
    assert all(candidate.duration == robot.designs[0].problem.longest for candidate in robot.candidates)


def test_a_schedule_holds_within_its_segments(robot):
    chosen, nodes = np.array([[1, 0, 1], [0, 1, 1], [1, 1, 0]], dtype=bool), np.array([0, 4, 8, 10])
    steps = schedule_at_steps(chosen, nodes)
    assert [steps[k].tolist() for k in (0, 3, 4, 7, 8, 9)] == [chosen[k].tolist() for k in (0, 0, 1, 1, 2, 2)]
    assert len(steps) == 10
    on = facts.on_times(robot, robot.selection.schedule.chosen)
    assert sum(on.values()) == pytest.approx(2 * robot.main.duration)


def test_a_value_about_some_states_is_the_least_information_about_them(robot):
    quality, problem = robot.main.qualities[0], robot.designs[0].problem
    covariance = np.linalg.inv(problem.scaled(robot.main.information.total))[:2, :2]
    assert facts.value_of(robot, quality) == pytest.approx(1 / np.linalg.eigvalsh(covariance)[-1], rel=1e-6)
    assert "λmin about x, y [–]" in paths_table(robot).head


def test_clearances_are_those_of_the_circle_by_differences_along_the_path(robot):
    limit, path = robot.scenario.design.constraints[0], robot.main.path
    fine = od.simulate(robot.scenario.system, path.x[0], np.repeat(path.u, 1000, axis=0), path.step / 1000)
    off = np.hypot(*fine.x[:, :2].T) - 20.0
    speed = (off[1::1000] - off[:-1:1000]) / (path.step / 1000)
    (found,) = clearances(robot, "designed")
    np.testing.assert_allclose(found[0], np.hypot(off[:-1:1000], limit.time_scale * speed), atol=0.02)
    (naive,) = clearances(robot, robot.baseline)
    assert naive.max() < 1e-6


# ---------------------------------------------------------------- how a path was found


def test_prices_draws_and_durations_are_told(robot):
    text, design = design_in_words(robot, 0), robot.designs[0]
    assert "Of durations from 10 to 11" in text
    assert f"The objective {numeral(design.objective)} is the draws' value less" in text
    assert f"judged by the worst of 2 draws of the prior. Over 1{NARROW}000 fresh draws" in text
    assert numeral(design.robustness.worst) in text
    assert numeral(design.robustness.five_percent) in text


def test_optima_and_evidence_are_told(aerosonde):
    optima = (Optimum(220.0, ("a", "b", "c")), Optimum(100.0, ("d",)))
    starts = tuple(Start(name, Status.LOCALLY_OPTIMAL, 220.0, 5, 1e-9, refined=name != "e") for name in "abcde")
    evidence = Evidence(250.0, 0.12, np.eye(5) / 5, 40, "")
    design = replace(aerosonde.designs[0], optima=optima, starts=starts, evidence=evidence)
    text = design_in_words(replace(aerosonde, designs=(design, *aerosonde.designs[1:])), 0)
    assert "4 of 5 starts, the best in a coarser family, climbed to 2 distinct optima: 220.00 (3 starts) and 100.00 (1 start)" in text
    # 250 is better than 220 by 0.12 / 0.88
    assert "40 climbs along the dual question met no path above 250: as far as they tell" in text
    assert f"none has a λmin that is better by more than 13.6{NARROW}%" in text
    assert "evidence, not proof" in text


# ---------------------------------------------------------------- in flight


def test_a_flight_that_misses_the_goal_by_three_metres_says_so(rover):
    flight, goal = rover.flight, rover.scenario.design.constraints[0]
    for beyond, words in ((3.0, "No: "), (0.5, "Not quite: ")):
        truth = flight.truth.copy()
        truth[-1, :2] = goal.point[0], goal.point[1] + goal.tolerance + beyond
        missed = replace(flight, truth=truth)
        (short,) = flight_violations(rover, missed)
        assert short.by == pytest.approx(beyond, rel=1e-5)
        assert smallest_margin(rover, missed) == pytest.approx(-beyond / goal.tolerance, rel=1e-5)
        said = flight_answer(rover, missed, rover.scenario.flight)
        assert said.startswith(words)
        assert f"misses the goal by {numeral(beyond)}{NARROW}m" in said


def test_a_point_to_pass_is_met_if_the_flight_passes_it_once_in_its_time(rover):
    truth = rover.flight.truth.copy()
    truth[:, 0], truth[:, 1] = np.arange(len(truth)), 0.0
    flown = replace(rover.flight, truth=truth)

    def passing(via):
        design = rover.scenario.design.model_copy(update={"constraints": (via,)})
        return flight_violations(replace(rover, scenario=rover.scenario.model_copy(update={"design": design})), flown)

    assert passing(od.Via((5.0, 0.0), 0.5)) == ()
    assert passing(od.Via((5.0, 0.0), 0.5, first=4.0, last=6.0)) == ()
    (late,) = passing(od.Via((5.0, 0.0), 0.5, first=7.0))
    assert (late.time, late.by) == (7.0, pytest.approx(1.5, rel=1e-5))


def test_a_flight_that_ends_at_the_goal_arrives(rover):
    truth = rover.flight.truth.copy()
    truth[-1, :2] = rover.scenario.design.constraints[0].point
    arrived = replace(rover.flight, truth=truth)
    assert flight_violations(rover, arrived) == ()
    assert smallest_margin(rover, arrived) == pytest.approx(1, abs=2e-3)
    assert flight_answer(rover, arrived, rover.scenario.flight).startswith("Yes: with a new plan every 2")
    receding = rover.scenario.flight.model_copy(update={"horizon": "receding"})
    elsewhere = replace(rover, scenario=rover.scenario.model_copy(update={"flight": receding}))
    assert smallest_margin(elsewhere, rover.flight) == np.inf  # the goal is that of each plan, not of the flight


def test_errors_at_the_end_of_a_flight_know_no_whole_turns(rover):
    mean = rover.flight.truth + np.array([1.0, -2.0, 2 * np.pi + 0.1])
    np.testing.assert_allclose(final_errors(rover, replace(rover.flight, mean=mean)), [1.0, 2.0, 0.1], rtol=1e-9)


def test_the_document_has_the_flight_and_its_timings_apart(rover, aerosonde):
    document, flight = document_of(rover), rover.flight
    assert document.flight.t == flight.t.tolist()
    assert document.flight.flown.truth["heading"] == flight.truth[:, 2].tolist()
    assert document.flight.flown.u["speed"] == flight.u[:, 0].tolist()
    assert document.flight.middle.final_std == dict(zip(("x", "y", "heading"), flight.straight.std[-1].tolist(), strict=True))
    assert len(document.flight.plans) == len(flight.statuses) == 6
    assert document.flight.feasible_plans == sum(flight.feasible)
    assert {"fly", "first plan", "plan, median", "plan, longest"} <= set(document.timings)
    assert document_of(aerosonde).flight is None


@pytest.mark.parametrize("name", SVGS)
def test_the_document_satisfies_its_schema(name, request):
    document = document_of(request.getfixturevalue(name)).model_dump(mode="json")
    jsonschema.Draft202012Validator(Result.model_json_schema()).validate(document)
    assert document["schema_version"] == "1.8"
    study = request.getfixturevalue(name)
    for candidate in study.candidates:
        assert document["paths"][candidate.name]["feasible"] == (document["paths"][candidate.name]["shortfalls"] == [])
    for design, part in zip(study.designs, document["designs"].values(), strict=True):
        assert part["duration"] == design.trajectory.t[-1]
        assert [optimum["value"] for optimum in part["optima"]] == sorted((each.value for each in design.optima), reverse=True)


def test_studies_their_designs_and_flights_print_on_a_screen(study):
    for record in (study, *study.designs, study.selection.schedule, *(check.validation for check in study.checks), study.flight):
        if record is not None:
            lines = str(record).splitlines()
            assert 1 < len(lines) <= 15
            assert max(map(len, lines)) <= 100
    assert str(study).startswith(f"study: {study.scenario.title}")
    assert study.designs[0].status.value in str(study)
