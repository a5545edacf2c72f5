"""Truths about report.html: self-contained, every number with its unit, every table with what is good, numbers of the study."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest

from obsdesign.constraints.goal import Goal
from obsdesign.paths.piecewise_constant import PiecewiseConstant
from obsdesign.report import facts
from obsdesign.report.figures.path import path_figure
from obsdesign.report.flying import errors_table, plans_table
from obsdesign.report.page import page_of
from obsdesign.report.rounding import MINUS, NARROW, percent, plain, polished, rounded
from obsdesign.report.tables import (
    Table,
    checks_table,
    paths_table,
    schedules_table,
    starts_table,
    subsets_table,
)
from obsdesign.report.wording import reasons
from obsdesign.scenario.loading import load_scenario
from obsdesign.study.record import Study
from obsdesign.study.running import run

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
time = {duration = 14.0, step = 1.0, segment = 4.0}
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
robust = {samples = 3}
"""
SVGS = {"aerosonde": 8, "rover": 10, "robot": 9}


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
    flown = [] if study.flight is None else [errors_table(study, study.flight), plans_table(study, study.flight)]
    return [
        subsets_table(study),
        paths_table(study),
        contributions_table(study),
        *starts,
        schedules_table(study),
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
    missing = {"rover": ["wind", "range", "beacon", "circle"], "robot": ["wind", "gps", "goal", "magnetometer"]}[name]
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
    before = path_figure(aerosonde)
    with mpl.rc_context({"font.size": 30.0, "svg.fonttype": "none", "axes.grid": True}):
        style = dict(mpl.rcParams)
        assert path_figure(aerosonde) == before
        assert dict(mpl.rcParams) == style


def test_dimensions_are_those_of_brace_and_morgansen(aerosonde):
    # Brace and Morgansen: Sigma_D straight and turning
    straight = {"gps": 4, "magnetometer": 1, "range": 3, "bearing": 3, "range + bearing": 4, "gps + bearing": 5, "gps + range": 4}
    turning = {"gps": 5, "magnetometer": 1, "range": 4, "bearing": 4, "range + bearing": 4, "gps + bearing": 5, "gps + range": 5}
    rows = {row[0].text: row for row in subsets_table(aerosonde).rows}
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
    assert facts.hidden_under(aerosonde, facts.baseline(aerosonde)) == ("heading", "wind_x", "wind_y")


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


def test_numbers_of_the_page_are_those_of_the_study(pages, aerosonde):
    page, schedule = pages["aerosonde"], aerosonde.selection.schedule
    for text in (rounded(aerosonde.designs[0].value), rounded(schedule.value), rounded(schedule.bound), percent(schedule.gap)):
        assert text in page
    assert aerosonde.scenario.digest in page
    assert f"--seed {aerosonde.seed}" in page


def test_an_overconfident_filter_is_explained(aerosonde):
    checks = tuple(
        replace(check, validation=replace(check.validation, verdict="overconfident")) if check.path == "straight" else check
        for check in aerosonde.checks
    )
    found = reasons(replace(aerosonde, checks=checks))
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
    assert rounded(value) == text


@pytest.mark.parametrize("value", [3.14159e5, 1.0, 27.182, 6.02e-3, 0.09996, 99.96])
def test_rounding_keeps_the_value_to_half_a_unit_of_its_third_digit(value):
    shown = float(rounded(value).replace(NARROW, ""))
    assert abs(shown - value) <= 0.5 * 10 ** (np.floor(np.log10(value)) - 2) * (1 + 1e-9)


def test_percentages_and_chosen_values():
    assert percent(0.0389) == f"3.89{NARROW}%"
    assert percent(1e-9) == f"<{NARROW}0.001{NARROW}%"
    assert plain(1300.0) == f"1{NARROW}300"
    assert plain(0.25) == "0.25"
    assert polished("pivot 5.0e-01, -0.3 m of x, 256-bit") == f"pivot 0.500, {MINUS}0.3 m of x, 256-bit"
