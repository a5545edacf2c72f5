"""Bad input: one message that names the key, the value and what is accepted; and a scenario is what its file says."""

from __future__ import annotations

import json
import math
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import jsonschema
import numpy as np
import pytest

import obsdesign as od
import obsdesign.constraints
import obsdesign.costs
import obsdesign.criteria
import obsdesign.paths
import obsdesign.rules
import obsdesign.sensors
import obsdesign.vehicles
from obsdesign.families import kinds
from obsdesign.scenario.design_tables import DesignTable
from obsdesign.scenario.loading import load_scenario_of_path
from obsdesign.scenario.selection_tables import SelectionTable
from obsdesign.study.problem import problem_of

SCENARIOS = sorted((Path(__file__).parent.parent / "scenarios").glob("*.toml"))
AEROSONDE = Path(__file__).parent.parent / "scenarios" / "aerosonde_wind.toml"


def design(lines: str) -> tuple[str, str]:
    """Keys of [design] to add."""
    return ("starts = 8", f"starts = 8\n{lines}")


def table(lines: str) -> tuple[str, str]:
    """A table to add, before that of the selection."""
    return ("[selection]", f"{lines}\n[selection]")


def selection(lines: str) -> tuple[str, str]:
    """Keys of [selection] to add."""
    return ('naive = "gps"', f'naive = "gps"\n{lines}')


def rules(*each: str) -> tuple[str, str]:
    """Rules to add, one table each."""
    return selection("".join(f"\n[[selection.rules]]\n{lines}\n" for lines in each))


def rule(lines: str) -> tuple[str, str]:
    """A rule to add."""
    return rules(lines)


PRICE = "[[design.prices]]\n{}\n"
VIA = '[[design.constraints]]\nkind = "via"\npoint = [400.0, 300.0]\ntolerance = 50.0\nfirst = {}\n'
FLIGHT = '[flight]\nevery = {}\nduration = {}\nhorizon = "{}"\n'

# what is replaced in the file, by what, and what the message must say
BAD_INPUT = {
    "unknown key": ("speed = 20.0", "sped = 20.0\nspeed = 20.0", ["vehicle.sped", "did you mean 'speed'"]),
    "unknown key in degrees": (
        "heading_deg = 30.0",
        "heading_deg = 30.0\nheadin_deg = 1.0",
        ["start.headin_deg", "did you mean 'heading'"],
    ),
    "unknown input": (
        "turn_rate = [",
        "turn_rte = [",
        ["design.bounds.turn_rte", "did you mean 'turn_rate'", "design.bounds.turn_rate: missing"],
    ),
    "unknown state": ("wind_y = 5.0", "wind_z = 5.0", ["prior.wind_z", "did you mean 'wind_", "prior.wind_y: missing key"]),
    "unknown kind": (
        'kind = "gps"',
        'kind = "gsp"',
        ["sensors[0].kind", "'gsp'", ", ".join(kinds(obsdesign.sensors)), "did you mean 'gps'"],
    ),
    "unknown criterion": (
        "min_eigenvalue",
        "min_eigenvalu",
        ["design.criterion", "log_det, min_eigenvalue, posterior, trace_inverse", "did you mean"],
    ),
    "unknown suite": ('[["gps"]]', '[["gpss"]]', ["design.suites[0]", "'gpss'", "did you mean 'gps'"]),
    "missing key": ("sigma = 1.0 ", "", ["sensors[2].sigma", "missing key"]),
    "missing kind": ('kind = "dubins"', "", ["vehicle.kind", "missing key"]),
    "missing table": ("[time]\nduration", "[tim]\nduration", ["time: missing key", "tim: unknown key", "did you mean 'time'"]),
    "wrong type": ("speed = 20.0", 'speed = "fast"', ["vehicle.speed", "'fast'", "valid number"]),
    "number as text": ("sigma = 2.0", 'sigma = "2.0"', ["sensors[0].sigma", "'2.0'", "valid number"]),
    "boolean as number": ("duration = 120.0", "duration = true", ["time.duration", "True", "valid number"]),
    "table as number": ("speed = 20.0", "speed = { value = 20.0 }", ["vehicle.speed", "valid number"]),
    "negative sigma": ("sigma = 2.0", "sigma = -2.0", ["sensors[0]", "sigma", "-2.0", "above 0"]),
    "negative sigma in degrees": ("sigma_deg = 12.0", "sigma_deg = -12.0", ["sensors[1]", "sigma_deg = -12.0", "above 0"]),
    "NaN sigma": ("sigma = 2.0", "sigma = nan", ["sensors[0].sigma", "nan", "finite"]),
    "infinite start": ("x = 0.0", "x = inf", ["start.x", "inf", "finite"]),
    "zero speed": ("speed = 20.0", "speed = 0.0", ["vehicle", "speed is 0.0", "above 0"]),
    "beacon on the start": ("beacon = [-1000.0, 1700.0]", "beacon = [0.0, 0.0]", ["sensors[2].beacon", "[0.0, 0.0]", "start"]),
    "beacon near the start": ("distance = 100.0", "distance = 2000.0", ["design.constraints[1]", "start"]),
    "horizon shorter than a segment": ("duration = 120.0", "duration = 3.0", ["time.duration", "3 s", "5 s"]),
    "segment no multiple of the step": ("segment = 5.0", "segment = 5.2", ["time.segment", "5.2 s", "1 s"]),
    "duration no multiple of the segment": ("duration = 120.0", "duration = 122.0", ["time.duration", "122 s", "5 s"]),
    "sensor period no multiple of the step": ("rate = 1.0 ", "rate = 3.0 ", ["sensors[0].rate", "3 Hz", "0.333333 s", "1 s"]),
    "too many per segment": ("per_segment = 1", "per_segment = 5", ["selection.per_segment", "is 5", "4"]),
    "pieces that do not fit": ("pieces = 24", "pieces = 121", ["design.path", "121", "120"]),
    "bounds upside down": ("[-0.25, 0.25]", "[0.25, -0.25]", ["design.bounds.turn_rate", "below"]),
    "prior of zero": ("heading = 0.1 ", "heading = 0.0 ", ["prior.heading", "0.0", "above 0"]),
    "negative noise": ("heading = 0.01", "heading = -0.01", ["process_noise.heading", "-0.01", "negative"]),
    "a key of the program": ("seed = 1", 'seed = 1\ndigest = "x"', ["digest", "unknown key"]),
    "unknown input in rates": (*table("[design.rates]\nturn_rte = 0.1"), ["design.rates.turn_rte", "did you mean 'turn_rate'"]),
    "rate of zero": (*table("[design.rates]\nturn_rate = 0.0"), ["design.rates.turn_rate", "0.0", "greater than 0"]),
    "about an unknown state": (*design('about = ["wind_z"]'), ["design.about", "'wind_z'", "x, y, heading, wind_x, wind_y"]),
    "about a state twice": (*design('about = ["x", "y", "x"]'), ["design.about", "names 'x' twice"]),
    "unknown cost": (
        *table(PRICE.format('kind = "path_lenght"\nper_unit = 1.0')),
        ["design.prices[0].kind", "effort, flight_time, path_length", "did you mean 'path_length'"],
    ),
    "cost without kind": (*table(PRICE.format("per_unit = 1.0")), ["design.prices[0].kind: missing key"]),
    "price of nothing": (*table(PRICE.format('kind = "path_length"')), ["design.prices[0].per_unit: missing key"]),
    "price below zero": (*table(PRICE.format('kind = "path_length"\nper_unit = -1.0')), ["design.prices[0].per_unit", "-1.0", "greater"]),
    "budget in a price": (
        *table(PRICE.format('kind = "path_length"\nper_unit = 1.0\nat_most = 2.0')),
        ["design.prices[0].at_most: unknown key", "accepted: kind, per_unit"],
    ),
    "effort without weights": (*table(PRICE.format('kind = "effort"\nper_unit = 1.0')), ["design.prices[0].weights: missing key"]),
    "effort of an unknown input": (
        *table(PRICE.format('kind = "effort"\nper_unit = 1.0\nweights = { turn_rte = 1.0 }')),
        ["design.prices[0].weights.turn_rte: unknown key", "did you mean 'turn_rate'"],
    ),
    "effort of weight zero": (
        *table(PRICE.format('kind = "effort"\nper_unit = 1.0\nweights = { turn_rate = 0.0 }')),
        ["design.prices[0]", "weight of turn_rate", "0.0", "above 0"],
    ),
    "effort per degree": (
        *table(PRICE.format('kind = "effort"\nper_unit = 1.0\nweights = { turn_rate_deg = 1.0 }')),
        ["design.prices[0].weights.turn_rate_deg", "no angle"],
    ),
    "budget too small for any path": (
        *table('[[design.budgets]]\nkind = "flight_time"\nat_most = 60.0'),
        ["design.budgets[0].at_most", "60 s", "120 s"],
    ),
    "floor longer than the path": (*table("[design.floor]\nseconds = 200.0\nvalue = 1.0"), ["design.floor.seconds", "200 s", "120 s"]),
    "floor no multiple of the step": (*table("[design.floor]\nseconds = 7.5\nvalue = 1.0"), ["design.floor.seconds", "7.5 s", "1 s"]),
    "floor without value": (*table("[design.floor]\nseconds = 20.0"), ["design.floor.value: missing key"]),
    "floor of a posterior": (
        'criterion = "min_eigenvalue"',
        'criterion = "posterior"\nfloor = { seconds = 20.0, value = 1.0 }',
        ["design.floor", "posterior"],
    ),
    "robust posterior": (
        'criterion = "min_eigenvalue"',
        'criterion = "posterior"\nrobust = { samples = 4 }',
        ["design.robust", "posterior"],
    ),
    "posterior judged by no criterion": (
        'criterion = "min_eigenvalue"',
        'criterion = "posterior"\nposterior_criterion = "trace_invers"',
        ["design.posterior_criterion", "'trace_invers'", "did you mean 'trace_inverse'"],
    ),
    "posterior of a posterior": (
        'criterion = "min_eigenvalue"',
        'criterion = "posterior"\nposterior_criterion = "posterior"',
        ["design.posterior_criterion", "log_det, min_eigenvalue, trace_inverse"],
    ),
    "instants of another criterion": (*design('over = "mean"'), ["design.over", "posterior", "min_eigenvalue"]),
    "posterior over an unknown word": (
        'criterion = "min_eigenvalue"',
        'criterion = "posterior"\nover = "median"',
        ["design.over", "'median'", "'end', 'mean' or 'worst'"],
    ),
    "too few weights of instants": (
        'criterion = "min_eigenvalue"',
        'criterion = "posterior"\nover = [1.0, 2.0]',
        ["design.over", "has 2 weights", "must be 120"],
    ),
    "a negative weight of an instant": (
        'criterion = "min_eigenvalue"',
        f'criterion = "posterior"\nover = {[-1.0] + 119 * [1.0]}',
        ["design.over[0]", "is -1", "at least 0"],
    ),
    "weights of instants that are all 0": (
        'criterion = "min_eigenvalue"',
        f'criterion = "posterior"\nover = {120 * [0.0]}',
        ["design.over", "120 weights, all 0"],
    ),
    "weights of instants of a path of any length": (
        'criterion = "min_eigenvalue"',
        f'criterion = "posterior"\nover = {120 * [1.0]}\nshortest = 110.0',
        ["design.over", "shortest"],
    ),
    "robust without samples": (*table("[design.robust]\nsamples = 0"), ["design.robust.samples", "0", "greater than or equal to 1"]),
    "unknown key of robust": (*table("[design.robust]\nsample = 3"), ["design.robust.sample: unknown key", "did you mean 'samples'"]),
    "worst as a word": (*table('[design.robust]\nworst = "yes"'), ["design.robust.worst", "'yes'", "boolean"]),
    "evidence of less than nothing": (*design("evidence = -1"), ["design.evidence", "-1", "greater than or equal to 0"]),
    "evidence for another criterion": ('criterion = "min_eigenvalue"', 'criterion = "log_det"\nevidence = 2', ["design.evidence", "is 2"]),
    "evidence of a robust design": (*design("evidence = 2\nrobust = {}"), ["design.evidence", "is 2", "robust"]),
    "shortest above the longest": (*design("shortest = 130.0"), ["design.shortest", "130 s", "120 s"]),
    "shortest no multiple of the step": (*design("shortest = 60.5"), ["design.shortest", "60.5 s", "1 s"]),
    "pieces that do not fit the shortest": (*design("shortest = 20.0"), ["design.path", "24", "20"]),
    "a time beyond the path": (*table(VIA.format(130.0)), ["design.constraints[2].first", "130 s", "120 s"]),
    "baseline of an unknown input": (
        *table('[[baselines]]\nname = "idle"\ninputs = { speed = 1.0 }'),
        ["baselines[0].inputs.speed: unknown key", "turn_rate"],
    ),
    "baseline without inputs": (*table('[[baselines]]\nname = "idle"'), ["baselines[0].inputs: missing key"]),
    "baseline twice": (
        *table('[[baselines]]\nname = "a"\ninputs = {}\n[[baselines]]\nname = "a"\ninputs = {}'),
        ["baselines[1].name", "'a'", "another baseline"],
    ),
    "baseline of a taken name": (*table('[[baselines]]\nname = "weave"\ninputs = {}'), ["baselines[0].name", "'weave'"]),
    "unknown naive sensor": ('naive = "gps"', 'naive = ["gsp"]', ["selection.naive", "'gsp'", "did you mean 'gps'"]),
    "too many naive sensors": ('naive = "gps"', 'naive = ["gps", "range"]', ["selection.naive", "gps, range", "1"]),
    "plans between the steps": (*table(FLIGHT.format(2.5, 40.0, "receding")), ["flight.every", "2.5 s", "1 s"]),
    "flight between the steps": (*table(FLIGHT.format(5.0, 40.5, "receding")), ["flight.duration", "40.5 s", "1 s"]),
    "plans after the flight": (*table(FLIGHT.format(50.0, 40.0, "receding")), ["flight.every", "50 s", "40 s"]),
    "plans after the plan": (*table(FLIGHT.format(125.0, 300.0, "receding")), ["flight.every", "125 s", "120 s"]),
    "flight beyond a shrinking horizon": (*table(FLIGHT.format(5.0, 125.0, "shrinking")), ["flight.duration", "125 s", "120 s"]),
    "unknown horizon": (*table(FLIGHT.format(5.0, 40.0, "growing")), ["flight.horizon", "'growing'", "'receding' or 'shrinking'"]),
    "speed in degrees": ("speed = 20.0", "speed_deg = 20.0", ["vehicle.speed_deg", "no angle"]),
    "position in degrees": ("x = 0.0", "x_deg = 0.0", ["start.x_deg", "no angle"]),
    "metres in degrees": ("sigma = 2.0", "sigma_deg = 2.0", ["sensors[0].sigma_deg", "no angle"]),
    "time in degrees": ("duration = 120.0", "duration_deg = 120.0", ["time.duration_deg", "no angle"]),
    "unknown criterion of a schedule": (*selection('criterion = "logdet"'), ["selection.criterion", "'logdet'", "did you mean 'log_det'"]),
    "a schedule by the posterior": (
        *selection('criterion = "posterior"'),
        ["selection.criterion", "log_det, min_eigenvalue, trace_inverse"],
    ),
    "as many lost sensors as there are": (*selection("robust_to = 4"), ["selection.robust_to", "is 4", "below", "4"]),
    "a gap below nothing": (*selection("gap = -1.0"), ["selection.gap", "-1.0", "greater than or equal to 0"]),
    "a front of one point": (*selection("pareto = 1"), ["selection.pareto", "is 1", "at least 2"]),
    "a front without energy": (*selection("pareto = 5"), ["selection.pareto", "is 5", "energy_budget"]),
    "unknown rule": (*rule('kind = "energy_budgt"'), ["selection.rules[0].kind", "'energy_budgt'", "did you mean 'energy_budget'"]),
    "unknown key of a rule": (
        *rule('kind = "max_uses"\nsensor = "gps"\nmst = 3\nmost = 3'),
        ["selection.rules[0].mst", "did you mean 'most'"],
    ),
    "missing key of a rule": (*rule('kind = "max_uses"\nsensor = "gps"'), ["selection.rules[0].most: missing key"]),
    "unknown sensor of a rule": (*rule('kind = "max_uses"\nsensor = "gsp"\nmost = 3'), ["selection.rules[0].sensor", "did you mean 'gps'"]),
    "a sensor by number": (*rule('kind = "max_uses"\nsensor = 0\nmost = 3'), ["selection.rules[0].sensor", "gps, magnetometer"]),
    "unknown sensor of a list": (
        *rule('kind = "exclusive"\nsensors = ["gps", "rnge"]'),
        ["selection.rules[0].sensors", "'rnge'", "did you mean 'range'"],
    ),
    "unknown sensor of a table": (
        *rule('kind = "energy_budget"\nlimit = 9.0\ncost = { gsp = 1.0 }'),
        ["selection.rules[0].cost.gsp: unknown key", "did you mean 'gps'"],
    ),
    "a cost as a word": (*rule('kind = "energy_budget"\nlimit = 9.0\ncost = "much"'), ["selection.rules[0].cost: is 'much'", "number"]),
    "a cost of a sensor as a word": (
        *rule('kind = "energy_budget"\nlimit = 9.0\ncost = { gps = "much" }'),
        ["selection.rules[0].cost.gps: is 'much'", "number"],
    ),
    "a cost below zero": (*rule('kind = "switching_cost"\ncost = -1.0'), ["selection.rules[0]", "cost is -1.0", "at least 0"]),
    "a budget for nothing": (
        *rule('kind = "energy_budget"\nlimit = 2.0\ncost = 3.0'),
        ["selection.rules[0].limit", "is 2", "cheapest sensor", "3"],
    ),
    "a segment beyond the path": (
        *rule('kind = "unavailable"\nsensor = "gps"\nsegments = [24]'),
        ["selection.rules[0]", "segment is 24", "0 to 23"],
    ),
    "unavailable after the path": (
        *rule('kind = "unavailable_between"\nsensor = "gps"\nfirst = 120.0\nlast = 130.0'),
        ["selection.rules[0].first", "120 s", "before the end"],
    ),
    "a sensor that is never on": (
        *rule('kind = "requires"\nsensor = "gps"\nother = "range"'),
        ["selection.rules", "gps can never be on, with 1 per segment"],
    ),
    "a segment without a sensor": (
        *rules(*(f'kind = "unavailable"\nsensor = "{name}"\nsegments = [3, 4]' for name in ("gps", "magnetometer", "range", "bearing"))),
        ["selection.rules", "no sensor that may be on in segment 3 and 1 more"],
    ),
    "paths and a design": (*table('[[paths]]\nname = "line"\nlegs = [{ seconds = 120.0 }]'), ["paths", "designed or given"]),
    "syntax error": ("[vehicle]", "[vehicle", ["not valid TOML", "line 11", "column 9"]),
}


@pytest.mark.parametrize("case", BAD_INPUT)
def test_bad_input_is_one_message_that_names_key_value_and_remedy(case, tmp_path):
    old, new, expected = BAD_INPUT[case]
    text = AEROSONDE.read_text()
    assert old in text
    file = tmp_path / "scenario.toml"
    file.write_text(text.replace(old, new, 1))
    with pytest.raises(od.ScenarioError) as refused:
        od.load_scenario(file)
    for part in (str(file), *expected):
        assert part in str(refused.value)


BAD_PAIRS = {
    "an unknown question": ([selection('question = "now"')], ["selection.question", "'now'", "'filter', 'start' or 'cheapest'"]),
    "a schedule over an unknown word": ([selection('over = "median"')], ["selection.over", "'median'", "'end', 'mean' or 'worst'"]),
    "too few weights of instants": ([selection("over = [1.0, 2.0]")], ["selection.over", "has 2 weights", "must be 120"]),
    "a negative weight of an instant": ([selection(f"over = {[-1.0] + 119 * [1.0]}")], ["selection.over[0]", "is -1", "at least 0"]),
    "weights of instants that are all 0": ([selection(f"over = {120 * [0.0]}")], ["selection.over", "120 weights, all 0"]),
    "a question without a prior": (
        [selection('question = "filter"'), ("[prior]\nx = 50.0\n", "[prior]\n")],
        ["prior.x", "missing key"],
    ),
    "a time beyond the shortest path": (
        [design("shortest = 60.0"), table(VIA.format(90.0))],
        ["design.constraints[2].first", "90 s", "60 s"],
    ),
    "a flight of no duration": ([design("shortest = 60.0"), table(FLIGHT.format(5.0, 40.0, "receding"))], ["design.shortest", "[flight]"]),
    "a floor longer than the shortest path": (
        [design("shortest = 60.0"), table("[design.floor]\nseconds = 90.0\nvalue = 1.0")],
        ["design.floor.seconds", "90 s", "60 s"],
    ),
}


@pytest.mark.parametrize("case", BAD_PAIRS)
def test_values_that_contradict_each_other_are_refused(case, tmp_path):
    changes, expected = BAD_PAIRS[case]
    file = tmp_path / "scenario.toml"
    file.write_text(changed(*changes))
    with pytest.raises(od.ScenarioError) as refused:
        od.load_scenario(file)
    for part in (str(file), *expected):
        assert part in str(refused.value)


def changed(*changes: tuple[str, str]) -> str:
    text = AEROSONDE.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    return text


@pytest.mark.parametrize("over", ["end", "mean", "worst", [0.0] * 100 + [0.5] * 20], ids=["end", "mean", "worst", "weights"])
def test_a_posterior_is_judged_when_and_by_what_the_file_says(over, tmp_path):
    """With the scenario's own prior and process noise."""
    file = tmp_path / "scenario.toml"
    keys = f'criterion = "posterior"\nposterior_criterion = "trace_inverse"\nover = {json.dumps(over)}'
    file.write_text(changed(('criterion = "min_eigenvalue"', keys)))
    scenario = od.load_scenario(file)
    criterion = problem_of(scenario, scenario.sensor_names).criterion
    assert (criterion.criterion, criterion.over) == (od.TraceInverse(), over if isinstance(over, str) else tuple(over))
    assert criterion.disturbance_psd == scenario.disturbance_psd
    np.testing.assert_allclose(criterion.prior.mean, [scenario.start[name] for name in scenario.state_names])


def test_several_mistakes_are_told_at_once(tmp_path):
    file = tmp_path / "scenario.toml"
    file.write_text(AEROSONDE.read_text().replace("sigma = 2.0", "sigma = nan").replace("speed = 20.0", "sped = 20.0"))
    with pytest.raises(od.ScenarioError, match=r"3 problems(.|\n)*vehicle.speed(.|\n)*vehicle.sped(.|\n)*sensors\[0\].sigma"):
        od.load_scenario(file)


def test_unreadable_files_are_named(tmp_path):
    with pytest.raises(od.ScenarioError, match=r"nowhere\.toml: cannot be read"):
        od.load_scenario(tmp_path / "nowhere.toml")
    with pytest.raises(od.ScenarioError, match="cannot be read"):
        od.load_scenario(tmp_path)
    (tmp_path / "latin.toml").write_bytes(b"title = \xff")
    with pytest.raises(od.ScenarioError, match="not UTF-8"):
        od.load_scenario(tmp_path / "latin.toml")


def test_a_scenario_is_what_its_file_says():
    scenario = od.load_scenario(AEROSONDE)
    assert scenario.vehicle == od.Dubins(speed=20.0, wind="constant")
    beacon = (-1000.0, 1700.0)
    assert scenario.sensors == (
        od.GPS(2.0, rate=1.0),
        od.Magnetometer(math.radians(12), rate=1.0),
        od.Range(beacon, 1.0, rate=1.0),
        od.Bearing(beacon, math.radians(5), rate=1.0),
    )
    assert scenario.start["heading"] == pytest.approx(math.pi / 6)
    assert (scenario.steps, scenario.segments) == (120, 24)
    assert scenario.design.bounds == {"turn_rate": (-0.25, 0.25)}
    assert scenario.design.constraints == (od.Goal((1400.0, 800.0), 100.0), od.StandOff(100.0))


def test_what_is_asked_of_a_path_is_what_the_file_says(tmp_path):
    keys = 'shortest = 60.0\nabout = ["wind_x", "wind_y"]\nfloor = { seconds = 20.0, value = 3.0 }\n'
    keys += "robust = { samples = 4, worst = false, seed = 7 }"
    terms = """
[design.rates]
turn_rate_deg = 10.0
[[design.prices]]
kind = "effort"
weights = { turn_rate = 2.0 }
per_unit = 3.0
[[design.budgets]]
kind = "path_length"
at_most = 2500.0
[[baselines]]
name = "circle"
inputs = { turn_rate_deg = 6.0 }
"""
    file = tmp_path / "scenario.toml"
    file.write_text(changed(design(keys), table(terms)))
    scenario = od.load_scenario(file)
    problem = problem_of(scenario, ("gps", "range"))
    assert (problem.shortest, problem.longest) == (60.0, 120.0)
    assert problem.about == ("wind_x", "wind_y")
    assert problem.rates == {"turn_rate": pytest.approx(math.radians(10))}
    assert problem.prices == (od.Price(od.Effort({"turn_rate": 2.0}), 3.0),)
    assert problem.budgets == (od.Budget(od.PathLength(), 2500.0),)
    assert problem.floor == od.Floor(20.0, 3.0)
    assert (problem.robust.samples, problem.robust.worst, problem.robust.seed) == (4, False, 7)
    np.testing.assert_allclose(problem.robust.prior.mean, problem.x0)
    np.testing.assert_allclose(np.sqrt(np.diag(problem.robust.prior.covariance)), [50, 50, 0.1, 5, 5])
    assert problem.system.sensor_names == ("gps", "range")
    assert scenario.baselines[0].inputs == {"turn_rate": pytest.approx(math.radians(6))}


def test_without_the_new_keys_nothing_is_asked():
    problem = problem_of(od.load_scenario(AEROSONDE), ("gps",))
    assert (problem.duration, problem.rates, problem.about, problem.prices, problem.budgets) == (120.0, {}, (), (), ())
    assert (problem.floor, problem.robust) == (None, None)


@pytest.mark.parametrize(("written", "sensors"), [('"range"', ("range",)), ('["range"]', ("range",)), ("[]", ("gps",))])
def test_the_naive_sensor_may_be_a_name_or_a_list(written, sensors, tmp_path):
    file = tmp_path / "scenario.toml"
    file.write_text(changed(('naive = "gps"', f"naive = {written}")))
    assert od.load_scenario(file).naive_sensors == sensors


GIVEN = AEROSONDE.parent / "dubins_sensor_selection.toml"
BAD_PATHS = {
    "unknown input": ("turn_rate = 0.08", "turn_rte = 0.08", ["paths[0].legs[0].inputs.turn_rte", "did you mean 'turn_rate'"]),
    "too short": ("{ seconds = 120.0 }", "{ seconds = 100.0 }", ["paths[1].legs", "100 s", "120 s"]),
    "between the steps": ("{ seconds = 120.0 }", "{ seconds = 119.5 }, { seconds = 0.5 }", ["paths[1].legs[0].seconds", "119.5 s", "1 s"]),
    "one name twice": ('name = "curved"', 'name = "straight"', ["paths[1].name", "'straight'", "another path"]),
    "no legs": ("[{ seconds = 120.0 }]", "[]", ["paths[1].legs", "at least 1"]),
    "a flight": ("[validation]", FLIGHT.format(5.0, 40.0, "receding") + "[validation]", ["flight", "[[paths]]"]),
    "starts": ("[validation]", "[design]\nstarts = 3\n[validation]", ["design.starts", "[[paths]]"]),
}


@pytest.mark.parametrize("case", BAD_PATHS)
def test_bad_given_paths_are_refused(case, tmp_path):
    old, new, expected = BAD_PATHS[case]
    text = GIVEN.read_text()
    assert old in text
    (tmp_path / "scenario.toml").write_text(text.replace(old, new, 1))
    with pytest.raises(od.ScenarioError) as refused:
        od.load_scenario(tmp_path / "scenario.toml")
    for part in expected:
        assert part in str(refused.value)


@pytest.mark.parametrize(
    ("change", "question"),
    [
        ((), "filter"),  # there is process noise
        (selection('question = "start"'), "start"),
        (selection("robust_to = 1"), "start"),  # its bound closes, that of a schedule for the filter seldom does
        (("heading = 0.01\nwind_x = 0.1\nwind_y = 0.1", "heading = 0.0"), "start"),
    ],
)
def test_a_schedule_serves_the_filter_where_there_is_process_noise(change, question, tmp_path):
    (tmp_path / "scenario.toml").write_text(changed(*([change] if change else [])))
    assert od.load_scenario(tmp_path / "scenario.toml").schedule_question == question


def test_process_noise_is_of_states_and_inputs_at_rest_or_per_speed(tmp_path):
    noise = "heading = 0.01\nwind_x = 0.1\nwind_y = 0.1"
    (tmp_path / "inputs.toml").write_text(changed((noise, "heading_deg = 1\nturn_rate = 0.02")))
    (tmp_path / "growing.toml").write_text(changed((noise, "x = { per_speed = 0.2, at_rest = 0.1 }\nturn_rate = { per_speed_deg = 1 }")))
    plain, growing = od.load_scenario(tmp_path / "inputs.toml"), od.load_scenario(tmp_path / "growing.toml")
    assert plain.disturbance_psd == pytest.approx((0.0, 0.0, np.radians(1) ** 2, 0.0, 0.0))
    assert plain.input_psd == {"turn_rate": pytest.approx(4e-4)}
    assert growing.disturbance_psd == od.PerSpeed((0.2**2, 0, 0, 0, 0), at_rest=(0.1**2, 0, 0, 0, 0))
    assert growing.input_psd == {"turn_rate": od.PerSpeed(np.radians(1) ** 2, at_rest=0.0)}
    assert plain.schedule_question == growing.schedule_question == "filter"
    for wrong, part in (("speed = 0.1", "process_noise.speed"), ("x = { per_speed = -1.0 }", "process_noise.x.per_speed")):
        (tmp_path / "wrong.toml").write_text(changed((noise, wrong)))
        with pytest.raises(od.ScenarioError, match=part):
            od.load_scenario(tmp_path / "wrong.toml")


def test_a_criterion_gap_and_switching_costs_belong_to_the_question_that_is_asked(tmp_path):
    (tmp_path / "plain.toml").write_text(changed(rule('kind = "switching_cost"\ncost = 0.1')))
    (tmp_path / "start.toml").write_text(changed(selection('question = "start"\ngap = 1e-5\ncriterion = "log_det"')))
    plain, start = od.load_scenario(tmp_path / "plain.toml"), od.load_scenario(tmp_path / "start.toml")
    assert (plain.filter_criterion, plain.schedule_criterion, plain.filter_gap) == (od.TraceInverse(), od.MinEigenvalue(), 1e-3)
    assert (start.filter_criterion, start.schedule_criterion, start.filter_gap) == (od.LogDet(), od.LogDet(), 1e-3)
    assert (len(plain.rules_for("filter")), len(plain.rules_for("start"))) == (1, 0)


def test_a_path_from_a_file_needs_no_design(tmp_path):
    text = GIVEN.read_text()
    (tmp_path / "scenario.toml").write_text(text[: text.index("# A Dubins path")] + text[text.index("[selection]") :])
    assert load_scenario_of_path(tmp_path / "scenario.toml").schedule_question == "start"


def test_without_a_design_or_paths_there_is_nothing_to_study(tmp_path):
    text = GIVEN.read_text()
    text = text[: text.index("# A Dubins path")] + text[text.index("[selection]") :]
    (tmp_path / "scenario.toml").write_text(text)
    with pytest.raises(od.ScenarioError, match="design: missing key"):
        od.load_scenario(tmp_path / "scenario.toml")


def test_rules_are_what_the_file_says(tmp_path):
    file = tmp_path / "scenario.toml"
    budget = 'kind = "energy_budget"\nlimit = 30\ncost = { gps = 3.0, range = 1.5 }\nstart = 2.0'
    dwell, reach = (
        'kind = "minimum_dwell"\nleast = 2\nsensors = ["gps"]',
        'kind = "unavailable_outside"\nsensor = "range"\ncentre = [0, 1]\nradius = 9.0',
    )
    file.write_text(changed(rules(budget, dwell, reach)))
    assert od.load_scenario(file).selection.rules == (
        od.EnergyBudget(30.0, {"gps": 3.0, "range": 1.5}, 2.0),
        od.MinimumDwell(2, ("gps",)),
        od.UnavailableOutside("range", (0.0, 1.0), 9.0),
    )


@pytest.mark.parametrize("file", SCENARIOS, ids=lambda file: file.stem)
def test_every_scenario_is_fine_satisfies_the_published_schema_and_cites_its_truths(file):
    scenario = od.load_scenario(file)
    assert scenario.expected
    assert all(len(each.source) > 5 for each in scenario.expected)
    jsonschema.Draft202012Validator(od.Scenario.model_json_schema()).validate(tomllib.loads(file.read_text()))


@pytest.mark.parametrize(
    "change",
    [
        ("sigma = 2.0", ""),
        ('kind = "gps"', 'kind = "gsp"'),
        ("speed = 20.0", 'speed = "fast"'),
        ("tolerance = 100.0", "tolerance = 100.0\nheading = 3"),
        table(PRICE.format('kind = "path_length"')),
        table(PRICE.format('kind = "effort"\nper_unit = 1.0\nweights = 3.0')),
    ],
)
def test_the_published_schema_refuses_what_the_program_refuses(change, tmp_path):
    data = tomllib.loads(changed(change))
    schema = json.loads(json.dumps(od.Scenario.model_json_schema()))
    assert not jsonschema.Draft202012Validator(schema).is_valid(data)
    (tmp_path / "scenario.toml").write_text(changed(change))
    with pytest.raises(od.ScenarioError):
        od.load_scenario(tmp_path / "scenario.toml")


def test_the_readme_names_every_kind_and_every_key_of_the_design():
    readme = (SCENARIOS[0].parent.parent / "README.md").read_text()
    for package in (obsdesign.paths, obsdesign.constraints, obsdesign.costs, obsdesign.criteria, obsdesign.rules):
        assert [kind for kind in kinds(package) if f"`{kind}`" not in readme] == []
    for name in (file.stem for file in SCENARIOS):
        assert f"/scenarios/{name}.toml)" in readme
    keys = set(DesignTable.model_fields) - {"path", "bounds", "rates", "constraints", "prices", "budgets", "starts", "suites"}
    assert [key for key in keys | set(SelectionTable.model_fields) - {"rules"} if f"`{key}`" not in readme] == []


def test_loading_a_scenario_loads_no_heavy_library():
    heavy = "{'casadi', 'cvxpy', 'scipy', 'matplotlib', 'flint', 'numpy'}"
    code = f"import sys, obsdesign as od; od.load_scenario({str(AEROSONDE)!r}); sys.exit(', '.join({heavy} & set(sys.modules)) or 0)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_loading_a_scenario_loads_the_kinds_that_it_names():
    code = f"import sys, obsdesign as od; od.load_scenario({str(AEROSONDE)!r}); print(*sys.modules)"
    modules = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    packages = (obsdesign.vehicles, obsdesign.sensors, obsdesign.paths, obsdesign.constraints, obsdesign.costs, obsdesign.rules)
    loaded = {kind for package in packages for kind in kinds(package) if f"{package.__name__}.{kind}" in modules}
    assert loaded == {line.split('"')[1] for line in AEROSONDE.read_text().splitlines() if line.startswith("kind = ")}


def test_two_sensors_of_one_kind_get_names_of_their_own():
    system = od.System(od.Dubins(20.0), (od.Range((1.0, 2.0), 1.0), od.Range((3.0, 4.0), 1.0), od.GPS(1.0)))
    assert system.sensor_names == ("range", "range_2", "gps")
    assert system.model.sensor_names == system.sensor_names
    assert [signal.name for signal in system.model.outputs] == ["range", "range_2", "gps_x", "gps_y"]


# ---------------------------------------------------------------- the place on Earth


def placed(folder: Path, table: str) -> Path:
    file = folder / "placed.toml"
    before, _, after = AEROSONDE.read_text().partition("[place]\n")
    file.write_text(f"{before}[place]\n{table}\n\n{after.partition(chr(10) * 2)[2]}")
    return file


def test_a_place_is_read_with_its_moment(tmp_path):
    file = placed(tmp_path, "latitude = 47.4\nlongitude = 8.5\nbearing_deg = 0.0\nheight = 50.0\nbegins = 2026-12-01T10:00:00+01:00")
    scenario = od.load_scenario(file)
    place = scenario.place
    assert (place.latitude, place.longitude, place.altitude, place.height, place.bearing) == (47.4, 8.5, 0.0, 50.0, 0.0)
    assert place.begins.timestamp() == 1796115600
    assert scenario.source == file.read_text()


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("latitude_deg = 47.4\nlongitude = 8.5", "place.latitude_deg: latitude is in degrees by itself: write latitude"),
        ("latitude = 90.5\nlongitude = 8.5", "place.latitude: is 90.5: must be less than or equal to 90"),
        ("latitude = 47.4\nlongitude = 8.5\nbegins = 2026-12-01T10:00:00", "place.begins"),
        ("latitude = 47.4\nlongitude = 8.5\nhight = 3.0", "did you mean 'height'?"),
    ],
)
def test_a_place_that_is_none_is_refused(tmp_path, table, message):
    with pytest.raises(od.ScenarioError, match=re.escape(message)):
        od.load_scenario(placed(tmp_path, table))
