"""Sensor schedules as a user sees them: paths from files, the verb, rules, losses, the front, given paths; and what the page says of it."""

from __future__ import annotations

import csv
import json
import re
from itertools import combinations
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from conftest import ROOT, obsdesign

import obsdesign as od
import obsdesign.rules as rule_family
from obsdesign.dynamics.path_segments import segments_along
from obsdesign.exchange.trajectory_csv import read_trajectory_csv, trajectory_csv
from obsdesign.families import kinds
from obsdesign.report.document import Result
from obsdesign.report.figures.decision_costs import count_proven_decisions
from obsdesign.report.html import page_of
from obsdesign.report.number_format import numeral
from obsdesign.report.sections._rules import rule_in_words
from obsdesign.report.sections._segment_traits import segment_traits, usage_in_words
from obsdesign.report.sections.schedule import losses_table, usage_table
from obsdesign.report.to_document import document_of
from obsdesign.study.broken_rules import rule_violations
from obsdesign.study.rated_schedules import FOR
from obsdesign.study.runner import run, select_along

FLOAT = """
title = "Float <in> a current"
question = "Where am I, and which sensor tells?"
vehicle = {kind = "dubins", speed = 1.0, wind = "constant"}
sensors = [
  {kind = "gps", sigma = 2.0},
  {kind = "magnetometer", sigma_deg = 12.0},
  {kind = "bearing", beacon = [30.0, 40.0], sigma_deg = 5.0},
  {kind = "gps", name = "array", sigma = 3.0},
]
start = {x = 0.0, y = 0.0, heading = 0.0, wind_x = 0.2, wind_y = 0.1}
prior = {x = 5.0, y = 5.0, heading = 0.1, wind_x = 0.3, wind_y = 0.3}
process_noise = {heading = 0.005}
time = {duration = 30.0, step = 1.0, segment = 5.0}
validation = {runs = 10}
SELECTION
[[manoeuvres]]
name = "straight"
held = {turn_rate = 0.0}
[[paths]]
name = "bent"
legs = [{seconds = 15.0, inputs = {turn_rate_deg = 6.0}}, {seconds = 15.0}]
[[paths]]
name = "line"
legs = [{seconds = 30.0}]
"""
RULES = """
[selection]
per_segment = 2
naive = ["gps", "bearing"]
pareto = 4
[[selection.rules]]
kind = "energy_budget"
limit = 9.0
cost = {gps = 2.0, bearing = 1.0, magnetometer = 0.5, array = 1.5}
start = {gps = 1.0}
[[selection.rules]]
kind = "exclusive"
sensors = ["magnetometer", "bearing"]
[[selection.rules]]
kind = "unavailable_between"
sensor = "gps"
first = 6.0
last = 9.0
[[selection.rules]]
kind = "unavailable_outside"
sensor = "bearing"
centre = [0.0, 0.0]
radius = 25.0
"""


def written(folder: Path, selection: str = "") -> Path:
    file = folder / "float.toml"
    file.write_text(FLOAT.replace("SELECTION", selection))
    return file


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """Two given paths, one sensor at a time."""
    return run(od.load_scenario(written(tmp_path_factory.mktemp("plain"), "[selection]\ngap = 1e-6")))


@pytest.fixture(scope="module")
def ruled(tmp_path_factory):
    """One given path, two sensors at a time under rules, with a front."""
    scenario = od.load_scenario(written(tmp_path_factory.mktemp("ruled"), RULES))
    return run(scenario.model_copy(update={"paths": scenario.paths[:1]}))


@pytest.fixture(scope="module")
def verb(tmp_path_factory, plain):
    """The verb on the bent path, of which only the states stand in the file."""
    folder = tmp_path_factory.mktemp("verb")
    written(folder)
    rows = list(csv.reader(trajectory_csv(plain.scenario.system, plain.main.path).splitlines()))
    (folder / "bent.csv").write_text("".join(",".join(row[:6]) + "\n" for row in rows))
    return folder, obsdesign("select", "bent.csv", "--scenario", "float.toml", "--out", "out", folder=folder)


@pytest.fixture(scope="module")
def pages(plain, ruled):
    return {"plain": page_of(plain), "ruled": page_of(ruled)}


def schedules(K: int, S: int, most: int) -> list[np.ndarray]:
    """Every schedule: brute force."""
    sets = [subset for size in range(most + 1) for subset in combinations(range(S), size)]
    patterns = np.array([[s in subset for s in range(S)] for subset in sets])
    places = np.indices((len(sets),) * K).reshape(K, -1).T
    return list(patterns[places])


# ---------------------------------------------------------------- paths from files


def test_a_path_that_was_written_is_read_as_it_was(plain):
    system, path = plain.scenario.system, plain.main.path
    file = Path(plain.scenario.file).parent / "path.csv"
    file.write_text(trajectory_csv(system, path))
    found = read_trajectory_csv(system, file)
    for name in ("t", "x", "u"):
        assert np.array_equal(getattr(found.path, name), getattr(path, name))
    assert found.notes == ()


@pytest.mark.parametrize(
    "vehicle", [od.Dubins(3.0, "constant"), od.Unicycle(), od.Omnidirectional("constant")], ids=lambda each: type(each).__name__
)
def test_inputs_are_recovered_from_the_states(vehicle, tmp_path):
    system = od.System(vehicle, (od.GPS(1.0),))
    m, n = len(system.model.inputs), len(system.model.states)
    u = 0.4 + 0.3 * np.random.default_rng(1).standard_normal((20, m))
    path = od.simulate(system, 0.1 * np.arange(n), u, 0.5)
    rows = list(csv.reader(trajectory_csv(system, path).splitlines()))
    (tmp_path / "states.csv").write_text("".join(",".join(row[: n + 1]) + "\n" for row in rows))
    found = read_trajectory_csv(system, tmp_path / "states.csv")
    np.testing.assert_allclose(found.path.u, u, atol=1e-8)
    assert len(found.notes) == 1


def test_states_that_no_inputs_lead_through_are_told(plain, tmp_path):
    path = plain.main.path
    x = path.x.copy()
    x[7:, 1] += 0.5
    (tmp_path / "path.csv").write_text(
        "t,x,y,heading,wind_x,wind_y\n"
        + "".join(f"{t},{','.join(map(repr, row))}\n" for t, row in zip(path.t.tolist(), x.tolist(), strict=True))
    )
    _, note = read_trajectory_csv(plain.scenario.system, tmp_path / "path.csv").notes
    assert re.search(r"at [67] s a step misses (y|heading) by 0\.\d+ (m|rad)", note)


def test_columns_may_stand_in_any_order_and_headings_in_degrees_and_wrapped(tmp_path):
    system = od.System(od.Dubins(1.0), (od.GPS(1.0),))
    path = od.simulate(system, [0.0, 0.0, 3.0], np.full((12, 1), 0.3), 1.0)
    degrees = (np.degrees(path.x[:, 2]) + 180) % 360 - 180
    lines = [f"{y!r},{d!r},{t!r},{x!r}" for t, (x, y, _), d in zip(path.t.tolist(), path.x.tolist(), degrees.tolist(), strict=True)]
    (tmp_path / "path.csv").write_text("y [m],heading [deg], t ,x [m]\n\n" + "\n".join(lines) + "\n")
    found = read_trajectory_csv(system, tmp_path / "path.csv").path
    np.testing.assert_allclose(found.x, path.x, atol=1e-9)
    np.testing.assert_allclose(found.u, path.u, atol=1e-9)


GOOD = ["t [s],x [m],y [m],heading [rad],turn_rate [rad/s]", "0,0,0,0,0.1", "1,1,0,0.1,0.1", "2,2,0.1,0.2,0.1", "3,3,0.2,0.3,"]
BAD = {
    "a word": (2, "1,one,0,0.1,0.1", ["line 3, column 'x'", "'one' is no finite number"]),
    "not finite": (3, "2,2,nan,0.2,0.1", ["line 4, column 'y'", "'nan'"]),
    "a hole": (3, "2,2,,0.2,0.1", ["line 4, column 'y'", "''"]),
    "an input missing on the way": (2, "1,1,0,0.1,", ["line 3, column 'turn_rate'"]),
    "time that stands still": (2, "0,1,0,0.1,0.1", ["line 3, column 't'", "0 s comes after 0 s", "must increase"]),
    "an uneven step": (3, "2.5,2,0.1,0.2,0.1", ["line 4, column 't'", "1.5 s after steps of 1 s"]),
    "a short row": (2, "1,1,0,0.1", ["line 3", "4 columns", "5"]),
    "a misspelt state": (0, "t,x,y,heding,turn_rate", ["line 1, column 4", "'heding'", "did you mean 'heading'"]),
    "a state missing": (0, "t,x,turn_rate,heading,y2", ["unknown name 'y2'"]),
    "a state twice": (0, "t,x,x,heading,turn_rate", ["line 1, column 3", "'x' is there twice"]),
    "a wrong unit": (0, "t [s],x [km],y,heading,turn_rate", ["line 1, column 2", "x is in 'km'", "must be in m"]),
    "no time": (0, "turn_rate,x,y,heading,t2", ["unknown name 't2'"]),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_file_is_one_message_with_line_and_column(case, tmp_path):
    line, text, parts = BAD[case]
    file = tmp_path / "bad.csv"
    file.write_text("\n".join([*GOOD[:line], text, *GOOD[line + 1 :]]) + "\n")
    with pytest.raises(od.InputError) as refused:
        read_trajectory_csv(od.System(od.Dubins(1.0), (od.GPS(1.0),)), file)
    for part in (str(file), *parts):
        assert part in str(refused.value)


@pytest.mark.parametrize("content", [b"", b"t,x,y,heading\n", b"t,x,y,heading\n0,0,0,0\n", b"\xff\xfe\x00", b"t,x,heading\n0,0,0\n1,1,0\n"])
def test_files_without_a_path_are_refused(content, tmp_path):
    file = tmp_path / "bad.csv"
    file.write_bytes(content)
    for each in (file, tmp_path / "nowhere.csv"):
        with pytest.raises(od.InputError, match=re.escape(str(each))):
            read_trajectory_csv(od.System(od.Dubins(1.0), (od.GPS(1.0),)), each)


# ---------------------------------------------------------------- the verb


def test_the_verb_prints_the_schedule_and_writes_the_files(verb, plain):
    folder, done = verb
    assert (done.returncode, done.stderr) == (0, "")
    for part in ("optimal, proven", "no schedule is above", "gps always", "chosen anew", "bent.csv has no inputs"):
        assert part in done.stdout
    assert sorted(path.name for path in (folder / "out").iterdir()) == [
        "question.toml",
        "report.html",
        "result.json",
        "schedule.csv",
        "trajectory.csv",
    ]
    result = json.loads((folder / "out" / "result.json").read_text())
    jsonschema.Draft202012Validator(json.loads((ROOT / "docs" / "result.schema.json").read_text())).validate(result)
    found, ours = result["selection"], plain.selection.schedule
    assert found["value"] == pytest.approx(ours.value, rel=1e-6)  # inputs were recovered: the path is the same
    assert found["chosen"] == ours.chosen.astype(int).tolist()
    with (folder / "out" / "schedule.csv").open() as table:
        header, *rows = csv.reader(table)
    assert header == ["segment", "from [s]", "to [s]", "gps", "magnetometer", "bearing", "array"]
    assert [list(map(int, row[3:])) for row in rows] == found["used"] == found["filter"]["chosen"]


def test_the_verb_takes_the_folder_of_a_run_and_tells_as_json(verb):
    folder, _ = verb
    done = obsdesign("select", "out", "--scenario", "float.toml", "--json", folder=folder)
    again, first = json.loads(done.stdout), json.loads((folder / "out" / "result.json").read_text())
    assert done.returncode == 0
    assert again["selection"]["chosen"] == first["selection"]["chosen"]
    assert again["selection"]["value"] == pytest.approx(first["selection"]["value"], rel=1e-9)
    assert sorted(path.name for path in folder.iterdir()) == ["bent.csv", "float.toml", "out"]


def test_a_bad_path_is_exit_code_2_and_nothing_is_written(verb):
    folder, _ = verb
    (folder / "bad.csv").write_text("t,x,y,heading,wind_x,wind_y\n0,0,0,0,0,0\n1,a,0,0,0,0\n")
    done = obsdesign("select", "bad.csv", "--scenario", "float.toml", "--out", "other", folder=folder)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "obsdesign: bad.csv, line 3, column 'x': 'a' is no finite number\n"
    assert not (folder / "other").exists()
    (folder / "bad.csv").unlink()


def test_a_path_whose_steps_do_not_fit_the_segments_is_refused(plain):
    path = od.simulate(plain.scenario.system, plain.main.path.x[0], np.zeros((20, 1)), 0.7)
    with pytest.raises(od.InputError, match=r"steps of 0\.7 s.*5 s"):
        select_along(plain.scenario, path)
    with pytest.raises(od.InputError, match="takes 3 s: must be at least one segment, 5 s"):
        select_along(plain.scenario, plain.main.path.part(0, 3))


# ---------------------------------------------------------------- what is chosen


def test_the_schedules_of_given_paths_are_the_best_of_all(plain):
    for each in plain.each:
        blocks = plain.problem.scaled(each.main.blocks)
        best = np.linalg.eigvalsh(np.einsum("pks,ksij->pij", np.array(schedules(6, 4, 1), dtype=float), blocks))[:, 0].max()
        assert each.selection.schedule.value == pytest.approx(best, rel=1e-6)
        assert each.selection.schedule.status is od.Status.OPTIMAL


def test_the_schedules_under_rules_are_the_best_that_keep_them(ruled):
    rules = ruled.scenario.selection.rules
    for each in ruled.each:
        blocks = ruled.problem.scaled(each.main.blocks)
        segments = segments_along(ruled.scenario.system.model, each.main.path, each.main.nodes)
        schedule = each.selection.schedule
        assert rule_violations(rules, segments, schedule.chosen) == ()
        random = np.random.default_rng(0)
        for _ in range(1500):
            chosen = random.random((6, 4)) < 0.3
            if chosen.sum(axis=1).max() <= 2 and not rule_violations(rules, segments, chosen):
                value = np.linalg.eigvalsh(np.einsum("ks,ksij->ij", chosen, blocks))[0]
                assert value <= schedule.bound * (1 + 1e-9)


def test_segments_know_names_times_and_places(ruled):
    path, nodes = ruled.main.path, ruled.main.nodes
    segments = segments_along(ruled.scenario.system.model, path, nodes)
    assert (segments.names, segments.count) == (("gps", "magnetometer", "bearing", "array"), 6)
    assert segments.t.tolist() == [0, 5, 10, 15, 20, 25, 30]
    assert [len(track) for track in segments.tracks] == [6] * 6  # both ends of a segment belong to it
    assert np.array_equal(np.vstack([track[:-1] for track in segments.tracks] + [path.x[-1:, :2]]), path.x[:, :2])


def test_rules_that_a_schedule_breaks_are_named(ruled):
    segments = segments_along(ruled.scenario.system.model, ruled.main.path, ruled.main.nodes)
    nothing = np.zeros((6, 4), dtype=bool)

    def on(*places):
        chosen = nothing.copy()
        for place in places:
            chosen[place] = True
        return chosen

    budget, exclusive, between, outside = ruled.scenario.selection.rules
    assert rule_violations((budget, exclusive, between, outside), segments, nothing) == ()
    assert rule_violations((budget,), segments, on((0, 0), (1, 0), (2, 0), (3, 0))) == ()  # 4 * 2 + 1 = 9
    assert rule_violations((budget,), segments, on((0, 0), (2, 0), (4, 0))) == ()  # 3 * (2 + 1) = 9
    assert rule_violations((budget,), segments, on((0, 0), (2, 0), (4, 0), (5, 1))) == (str(budget),)
    assert rule_violations((exclusive,), segments, on((3, 1), (3, 2))) == (str(exclusive),)
    assert rule_violations((between,), segments, on((1, 0))) == (str(between),)
    assert rule_violations((between,), segments, on((0, 0), (2, 0))) == ()
    dwell = od.MinimumDwell(2, ("gps",))
    assert rule_violations((dwell,), segments, on((2, 0))) == (str(dwell),)
    assert rule_violations((dwell,), segments, on((2, 0), (3, 0), (5, 0))) == ()  # to the end of the path


def test_losses_are_ordered_and_gps_alone_sees_less_than_five_dimensions_on_a_line(plain):
    line = plain.each[1]
    value, bound = line.selection.schedule.value, line.selection.schedule.bound
    (always, _) = line.selection.rivals
    assert (always.name, always.breaks) == ("gps always", ())
    assert always.value == pytest.approx(0, abs=1e-9 * value)  # Brace and Morgansen, theorem 1
    assert [each.sensor for each in line.selection.losses] == [0, 1, 2, 3]
    for each in line.selection.losses:
        assert each.kept <= each.rechosen * (1 + 1e-9) + 1e-9
        assert each.rechosen <= each.bound * (1 + 1e-9) + 1e-9
        assert each.bound <= bound * (1 + 1e-4)
        if not line.selection.schedule.chosen[:, each.sensor].any():
            assert each.kept == pytest.approx(value, rel=1e-9)


def test_the_front_rises_and_stays_below_its_bounds(ruled):
    front = ruled.selection.pareto
    assert np.all(front.spent <= front.limits * (1 + 1e-9))
    assert np.all(np.diff(front.values) >= 0)
    assert np.all(front.values <= front.bounds * (1 + 1e-9))
    assert ruled.selection.schedule.value <= front.above(9.0) * (1 + 1e-9)


def test_criterion_and_losses_of_sensors_are_those_of_the_scenario(tmp_path):
    scenario = od.load_scenario(written(tmp_path, '[selection]\nper_segment = 2\ncriterion = "log_det"\nrobust_to = 1\ngap = 0.01'))
    study = select_along(scenario, od.simulate(scenario.system, [0.0, 0.0, 0.0, 0.2, 0.1], np.full((30, 1), 0.1), 1.0))
    blocks = study.problem.scaled(study.main.blocks)
    chosen = study.selection.schedule.chosen
    left = []
    for lost in range(4):
        kept = chosen.copy()
        kept[:, lost] = False
        sign, log = np.linalg.slogdet(np.einsum("ks,ksij->ij", kept, blocks))
        left.append(log if sign > 0 else -np.inf)
    assert study.selection.schedule.value == pytest.approx(min(left), rel=1e-6)
    page = page_of(study)
    assert "worst loss of any one sensor" in page
    assert "log det" in page


def test_lost_sensors_count_for_the_filter_too(tmp_path):
    """The cost that the study tells of its schedule, and of others, is that of the worst loss of one, by posterior_information."""
    written_file = written(tmp_path, '[selection]\nquestion = "filter"\nper_segment = 2\nrobust_to = 1\ngap = 0.5')
    scenario = od.load_scenario(written_file)
    study = select_along(scenario, od.simulate(scenario.system, [0.0, 0.0, 0.0, 0.2, 0.1], np.full((30, 1), 0.1), 1.0))
    answer, prior = study.selection.filter, scenario.prior_at_start
    for rated in answer.rated:
        worst = -np.inf
        for lost in range(4):
            active = np.repeat(rated.chosen, 30 // len(rated.chosen), axis=0)
            active[:, lost] = False
            J = od.posterior_information(scenario.system, study.main.path, prior, scenario.disturbance_psd, active=active)[:-1]
            worst = max(worst, float(np.mean([np.trace(np.linalg.inv(each) / np.outer(prior.std, prior.std)) for each in J])))
        assert rated.cost == pytest.approx(worst, rel=1e-6)
    assert answer.schedule.value == pytest.approx(answer.find(FOR["filter"]).cost, rel=1e-9)
    assert "worst loss of any one sensor" in page_of(study)


# ---------------------------------------------------------------- the page


@pytest.mark.parametrize("name", ["plain", "ruled"])
def test_the_page_of_given_paths_has_no_design_and_a_part_for_each_path(name, pages, request):
    study, page = request.getfixturevalue(name), pages[name]
    found = re.findall(r"<h2>(\d [^<]+)</h2>", page)
    several = [
        "1 Can it?",
        "2 How well?",
        "3 Which? The bent path",
        "4 Does it hold? The bent path",
        "3 Which? The line path",
        "4 Does it hold? The line path",
    ]
    assert found == (several if name == "plain" else ["1 Can it?", "2 How well?", "3 Which?", "4 Does it hold?"])
    words = re.sub(r"<(style|svg|pre)\b.*?</\1>|<[^>]+>", " ", page, flags=re.DOTALL)
    assert "designed" not in words
    assert "Float &lt;in&gt; a current" in page
    ids = re.findall(r'\sid="([^"]+)"', page)
    assert len(ids) == len(set(ids))
    assert all(numeral(each.selection.schedule.value) in words for each in study.each)


def test_the_page_of_the_verb_has_the_schedule_alone(verb):
    folder, _ = verb
    page = (folder / "out" / "report.html").read_text()
    assert re.findall(r"<h2>(\d [^<]+)</h2>", page) == ["1 How well?", "2 Which?"]
    assert "obsdesign select trajectory.csv --scenario float.toml" in page
    assert "proven to be the best of 4⁶ schedules" in page


def test_the_page_tells_rules_losses_front_and_what_deciding_otherwise_costs(pages):
    page = pages["ruled"]
    for part in (
        "at most 9 is spent",
        "of magnetometer and bearing at most one is on at a time",
        "gps is off from 6 to 9",
        "bearing is off farther than 25",
        "When a sensor is lost",
        "What deciding otherwise costs",
        "which is certified",
        "best of all schedules that keep the rules",
    ):
        assert part in page


def test_every_kind_of_rule_has_words():
    rules = {
        "energy_budget": od.EnergyBudget(5.0, {"gps": 1.0}),
        "max_uses": od.MaxUses("gps", 3),
        "switching_cost": od.SwitchingCost(0.5),
        "minimum_dwell": od.MinimumDwell(2),
        "exclusive": od.Exclusive(("gps", "range")),
        "requires": od.Requires("gps", "range"),
        "unavailable": od.Unavailable("gps", (1, 2)),
        "unavailable_between": od.UnavailableBetween("gps", 1.0, 2.0),
        "unavailable_outside": od.UnavailableOutside("gps", (0.0, 0.0), 3.0),
    }
    assert set(rules) == set(kinds(rule_family))
    for rule in rules.values():
        assert rule_in_words(rule) != str(rule)
        assert type(rule).__name__ not in rule_in_words(rule)


def test_turns_are_where_the_path_turns(plain):
    bent, line = plain.each
    found = segment_traits(bent)
    assert found.is_turning.tolist() == [True] * 3 + [False] * 3
    assert not segment_traits(line).is_turning.any()
    assert found.has_beacon == (False, False, True, False)
    assert found.share(np.array([1, 1, 0, 0, 0, 1], dtype=bool), found.is_turning) == pytest.approx(2 / 3)
    assert all(
        name in usage_in_words(bent)
        for name, on in zip(plain.scenario.sensor_names, bent.selection.schedule.chosen.T, strict=True)
        if on.any()
    )


def test_the_table_of_where_adds_up_to_the_path(plain):
    table = usage_table(plain)
    column = table.head.index("on [s]")
    *sensors, path = [float(row[column].text) for row in table.rows]
    assert sum(sensors) == pytest.approx(path) == 30


def test_a_sensor_whose_loss_leaves_nothing_is_said_to(plain):
    line = plain.each[1]
    zero = [each.sensor for each in line.selection.losses if each.kept < 1e-9 * line.selection.schedule.value]
    assert zero  # whoever tells the heading
    for row, each in zip(losses_table(line).rows, line.selection.losses, strict=True):
        assert (row[1].text == "nothing") == (each.sensor in zero)


def test_decisions_that_are_proven_are_the_same_in_every_better_schedule(plain):
    for each in plain.each:
        schedule, blocks = each.selection.schedule, plain.problem.scaled(each.main.blocks)
        cost = np.where(schedule.chosen, schedule.forced_off, schedule.forced_on)
        sure = cost > schedule.root_bound - schedule.value
        assert count_proven_decisions(each.selection.schedule) == (int(sure.sum()), 24)
        every = np.array(schedules(6, 4, 1))
        otherwise = every[(every != schedule.chosen)[:, sure].any(axis=1)].astype(float)
        values = np.linalg.eigvalsh(np.einsum("pks,ksij->pij", otherwise, blocks))[:, 0]
        assert values.max() <= schedule.value * (1 + 1e-9)


@pytest.mark.parametrize("name", ["plain", "ruled"])
def test_the_document_of_given_paths_satisfies_its_schema(name, request):
    study = request.getfixturevalue(name)
    document = document_of(study).model_dump(mode="json")
    jsonschema.Draft202012Validator(Result.model_json_schema()).validate(document)
    assert document["designs"] == {}
    paths = ["bent", "line"] if name == "plain" else ["bent"]
    assert list(document["selections"]) == paths
    assert document["selection"] == document["selections"]["bent"]
    assert set(document["selection"]["losses"]) == {"gps", "magnetometer", "bearing", "array"}
    assert (document["selection"]["pareto"] is None) == (name == "plain")
    assert list(document["validation"]) == paths
