"""The table of verbs and what follows from it; a scenario to start from; what is wrong with a scenario, and on which line."""

from __future__ import annotations

import importlib.util
import json
import re
import shlex
import subprocess
import sys
import textwrap
import tomllib

import numpy as np
import pytest
from conftest import ROOT, obsdesign, small_scenario
from hypothesis import given, settings
from hypothesis import strategies as st

import obsdesign as od
from obsdesign.cli.parser import build_parser
from obsdesign.cli.progress import ProgressLines
from obsdesign.cli.table import VERBS
from obsdesign.exchange.schedule_csv import read_schedule_csv, schedule_csv
from obsdesign.exchange.trajectory_csv import read_trajectory_csv
from obsdesign.scenario.key_lines import line_of
from obsdesign.scenario.starters import SCHEMA_FILE, starters, text_to_edit
from obsdesign.scenario.upgrades import upgrade_data


@pytest.mark.parametrize("verb", VERBS, ids=lambda verb: verb.name)
def test_every_verb_has_json_an_example_that_is_accepted_and_a_row_in_the_help(verb):
    parser = build_parser(VERBS)
    words = shlex.split(verb.example.partition(">")[0])
    assert parser.parse_args([*words, "--json"]).verb is verb
    assert re.search(rf"^    {verb.name} ", parser.format_help(), flags=re.MULTILINE)


def test_what_is_nearly_right_is_suggested(tmp_path):
    for words, meant in ((["chekc"], "check"), (["run", "x.toml", "--quite"], "--quiet"), (["schema", "resutl"], "result")):
        done = obsdesign(*words, "--json", folder=tmp_path)
        assert done.returncode == 2
        assert f"did you mean '{meant}'?" in done.stderr
        assert json.loads(done.stdout)["exit_code"] == 2


@pytest.mark.parametrize("shell", ["bash", "zsh"])
def test_completion_scripts_are_scripts_of_their_shell_and_know_the_verbs(shell, tmp_path):
    done = obsdesign("--print-completion", shell, folder=tmp_path)
    assert done.returncode == 0
    assert all(verb.name in done.stdout for verb in VERBS)
    if shell == "bash":
        asked = 'source /dev/stdin; COMP_WORDS=(obsdesign che); COMP_CWORD=1; _shtab_obsdesign; echo "${COMPREPLY[@]}"'
        completed = subprocess.run(["bash", "-c", asked], input=done.stdout, capture_output=True, text=True, check=True)
        assert completed.stdout.split() == ["check"]


# ---------------------------------------------------------------- a scenario to start from


@pytest.mark.parametrize("starter", starters(), ids=lambda starter: starter.name)
def test_a_template_is_a_scenario_with_comments_and_without_known_truths(starter, tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text(text_to_edit(starter))
    scenario = od.load_scenario(file)
    original = od.load_scenario(ROOT / "scenarios" / f"{starter.name}.toml")
    left_out = {"file": "", "digest": "", "source": "", "expected": ()}
    assert scenario.model_copy(update=left_out) == original.model_copy(update=left_out)
    assert scenario.expected == ()
    uncommented = file.read_text().replace("\n# [[expected]]\n# key", "\n[[expected]]\nkey").replace("\n# value", "\nvalue")
    file.write_text(uncommented.replace("\n# source", "\nsource"))
    assert len(od.load_scenario(file).expected) == 1


def test_init_writes_a_scenario_that_check_takes_without_being_told_which(tmp_path):
    done = obsdesign("init", "--json", folder=tmp_path)
    written = json.loads(done.stdout)
    assert {path.name for path in tmp_path.iterdir()} == {written["scenario"], written["schema"]} == {"aerosonde_wind.toml", SCHEMA_FILE}
    assert (tmp_path / written["scenario"]).read_text().startswith(f"#:schema ./{SCHEMA_FILE}\n")
    assert obsdesign("check", folder=tmp_path).stdout.startswith("aerosonde_wind.toml: fine")
    again = obsdesign("init", folder=tmp_path)
    assert (again.returncode, again.stdout) == (2, "")
    (tmp_path / "pyproject.toml").write_text("[project]\nname = 'other'\n")
    assert obsdesign("check", folder=tmp_path).returncode == 0
    (tmp_path / "second.toml").write_text(small_scenario())
    assert "2 scenarios in this folder: name one of aerosonde_wind.toml, second.toml" in obsdesign("check", folder=tmp_path).stderr


def test_init_writes_a_system_as_text_that_check_takes(tmp_path):
    assert json.loads(obsdesign("init", "--system", "--json", folder=tmp_path).stdout)["scenario"] == "rover_as_text.toml"
    text = (tmp_path / "rover_as_text.toml").read_text()
    assert "[system.rates]" in text and "[vehicle]" not in text
    assert obsdesign("check", folder=tmp_path).returncode == 0
    assert obsdesign("init", "codesign_glider", "--system", folder=tmp_path).returncode == 2


def test_a_template_that_is_not_there_is_bad_input_and_nothing_is_written(tmp_path):
    done = obsdesign("init", "aerosond_wind", folder=tmp_path)
    assert done.returncode == 2
    assert "did you mean 'aerosonde_wind'?" in done.stderr
    assert list(tmp_path.iterdir()) == []
    assert "`obsdesign init`" in obsdesign("run", folder=tmp_path).stderr


# ---------------------------------------------------------------- lines

TRICKY = '''
title = """
start = "no statement"
[table]
"""                         # above
"odd key" = [
  [1, 2],
  # [[list]]
  [3],
]
[table]                     # table
a.b.c = 1                   # dotted
inline = { x = 1, y = [2] } # inline
[[list]]                    # first

  x = 1
[list.inner]                # inner
  z = \'\'\'
[[list]]
\'\'\'
[[list]]                    # second
x = 2                       # x2
'''
PLACES = {
    ("title",): 2,
    ("odd key", 1, 0): 6,
    ("table", "a", "b", "c"): "dotted",
    ("table", "inline", "y", 0): "inline",
    ("table", "missing", "deeper"): "table",
    ("list", 0): "first",
    ("list", 0, "inner"): "inner",
    ("list", 1): "second",
    ("list", 1, "x"): "x2",
    ("list", 1, "y"): "second",
    ("nowhere",): None,
}


@pytest.mark.parametrize("location", PLACES, ids=str)
@pytest.mark.parametrize("end", ["\n", "\r\n"], ids=["unix", "windows"])
def test_the_line_of_a_key(location, end):
    place = PLACES[location]
    marked = {mark: number for number, line in enumerate(TRICKY.split("\n"), 1) if (mark := line.rpartition("# ")[2])}
    assert line_of(TRICKY.replace("\n", end), location) == (marked[place] if isinstance(place, str) else place)


@settings(deadline=None, max_examples=60, database=None, derandomize=True)
@given(st.data())
def test_the_line_of_a_key_is_where_the_first_beginning_that_holds_it_ends(data):
    """Brute force: the beginnings of the file, one line longer each time."""
    text = small_scenario()
    tree = tomllib.loads(text)
    location, value = (), tree
    while isinstance(value, dict | list) and value and (not location or data.draw(st.booleans())):
        keys = list(value) if isinstance(value, dict) else list(range(len(value)))
        location = (*location, data.draw(st.sampled_from(keys)))
        value = value[location[-1]]
    lines, last_without = text.split("\n"), 0
    for length in range(1, len(lines) + 1):
        try:
            part = tomllib.loads("\n".join(lines[:length]))
            for key in location:
                part = part[key]
            break
        except tomllib.TOMLDecodeError:
            continue
        except (KeyError, IndexError):
            last_without = length
    statement = next(n for n in range(last_without, length) if lines[n].partition("#")[0].strip())
    assert line_of(text, location) == statement + 1


def test_problems_are_told_with_line_key_value_what_is_accepted_and_the_nearest_key(tmp_path):
    text = small_scenario().replace("speed = 20.0", "sped = 20.0").replace("[time]\n", '[time]\ntolerance = "a"\n')
    (tmp_path / "mine.toml").write_text(text)
    lines = text.split("\n")
    done = obsdesign("check", "--json", folder=tmp_path)
    problems = {problem["key"]: problem for problem in json.loads(done.stdout)["problems"]}
    assert problems.keys() == {"vehicle.speed", "vehicle.sped", "time.tolerance"}
    unknown = problems["vehicle.sped"]
    assert lines[unknown["line"] - 1].startswith("sped = 20.0") and unknown["value"] == 20.0
    assert unknown["nearest"] == "speed" and "speed" in unknown["accepted"]
    assert lines[problems["vehicle.speed"]["line"] - 1] == "[vehicle]"
    assert lines[problems["time.tolerance"]["line"] - 1] == 'tolerance = "a"' and problems["time.tolerance"]["value"] == "a"
    for problem in problems.values():
        assert f"line {problem['line']}: {problem['key']}: {problem['message']}" in done.stderr


# ---------------------------------------------------------------- versions


def test_a_scenario_of_an_earlier_format_is_read_as_it_was_meant(tmp_path):
    """Before versions were counted a schedule served the start, whatever the process noise, and plans lasted a number of seconds."""
    text = small_scenario() + "\n[flight]\nevery = 10.0\nduration = 40.0\nhorizon = 40.0\n"
    assert "[process_noise]" in text and "version = 1" in text
    (tmp_path / "old.toml").write_text(text.replace("version = 1", "version = 0"))
    scenario = od.load_scenario(tmp_path / "old.toml")
    assert scenario.schedule_question == "start" and scenario.flight.horizon == "receding"
    said = obsdesign("check", folder=tmp_path).stdout
    assert 'selection.question = "start"' in said and "flight.horizon = 40.0 is left out" in said
    (tmp_path / "old.toml").write_text(text.replace("version = 1", "version = 0").replace("horizon = 40.0", ""))
    assert od.load_scenario(tmp_path / "old.toml").version == 1


@pytest.mark.parametrize("version", [2, -1, "one", True, 1.0])
def test_a_version_that_is_not_known_is_refused_by_name(version, tmp_path):
    file = tmp_path / "new.toml"
    file.write_text(small_scenario().replace("version = 1", f"version = {json.dumps(version)}"))
    with pytest.raises(od.ScenarioError, match=r"line 6: version: is .*must be a whole number from 0 to 1") as refused:
        od.load_scenario(file)
    assert ("a newer obsdesign may read it" in str(refused.value)) == (version == 2)


def test_todays_format_is_left_as_it_is():
    data = tomllib.loads(small_scenario())
    assert upgrade_data(data).data is data
    assert upgrade_data({"title": "x"}).changes == ()
    assert upgrade_data({"version": 0, "selection": {"question": "filter"}}).data["selection"]["question"] == "filter"


# ---------------------------------------------------------------- what loads when

LIGHT = """
import sys
from obsdesign.cli import main
try:
    main([{arguments}])
except SystemExit:
    pass
heavy = {{"casadi", "cvxpy", "scipy", "matplotlib", "numpy", "pydantic", "rich", "shtab"}}
print(sorted(heavy & set(sys.modules)))
"""


@pytest.mark.parametrize(
    ("arguments", "loaded"), [("'--help'", []), ("'--version'", []), ("'check'", ["pydantic"])], ids=["help", "version", "check"]
)
def test_heavy_libraries_load_when_used(arguments, loaded, tmp_path):
    (tmp_path / "mine.toml").write_text(small_scenario())
    code = textwrap.dedent(LIGHT.format(arguments=arguments))
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == str(loaded)


def test_one_answer_is_told_without_loading_what_draws():
    code = "import sys, obsdesign.report.paths_to_document, obsdesign.study.single_answers; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


# ---------------------------------------------------------------- verbs of one question each


def test_doctor_finds_what_is_declared_and_comes_to_the_known_truth(tmp_path):
    done = obsdesign("doctor", "--json", folder=tmp_path)
    document = json.loads(done.stdout)
    seen = {check["what"]: check for check in document["checks"]}
    assert (done.returncode, document["ok"]) == (0, True)
    assert {"casadi", "cvxpy", "solver Clarabel", "solver Highs", "known truth"} <= seen.keys()
    assert "4 of 5 dimensions straight on and 5 turning" in seen["known truth"]["seen"]


@pytest.fixture(scope="module")
def designed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("designed")
    text = small_scenario().replace('suites = [["gps"]]', "").replace("starts = 2", "starts = 1")
    (folder / "mine.toml").write_text(text)
    return folder, obsdesign("design", "--out", "out", "--jobs", "1", "--json", folder=folder)


def test_design_writes_the_path_that_it_tells_of(designed):
    folder, done = designed
    design = json.loads(done.stdout)["designs"]["gps+magnetometer+range+bearing"]
    scenario = od.load_scenario(folder / "mine.toml")
    path = read_trajectory_csv(scenario.system, folder / "out" / "trajectory.csv").path
    assert path.x[:, 0].tolist() == design["trajectory"]["x"]
    W = od.variational_gramian(scenario.system, path).total
    scale = list(scenario.prior.values())
    assert design["value"] == pytest.approx(np.linalg.eigvalsh(W * np.outer(scale, scale))[0], rel=1e-9)


def test_validate_takes_the_path_and_the_schedule_of_files(designed):
    folder, _ = designed
    names = od.load_scenario(folder / "mine.toml").sensor_names
    only_gps = np.tile([True, False, False, False], (8, 1))
    (folder / "gps.csv").write_text(schedule_csv(only_gps, names, np.arange(9) * 5.0))
    np.testing.assert_array_equal(read_schedule_csv(folder / "gps.csv", names).chosen, only_gps)
    both = [
        json.loads(obsdesign("validate", "--along", "out", *schedule, "--jobs", "1", "--json", folder=folder).stdout)
        for schedule in ((), ("--schedule", "gps.csv"))
    ]
    assert both[0]["schedule"] is None and both[1]["schedule"] == "gps.csv"
    for state, bound in both[0]["final_bound"].items():  # what more sensors are on, the less may be unknown
        assert bound <= both[1]["final_bound"][state] * (1 + 1e-9)
    (folder / "short.csv").write_text(schedule_csv(only_gps[:7], names, np.arange(8) * 5.0))
    short = obsdesign("validate", "--along", "out", "--schedule", "short.csv", folder=folder)
    assert short.returncode == 2 and "covers 35 s: must be at least the path's 40 s" in short.stderr


def test_time_left_is_that_of_the_parts_done():
    said, times = [], iter([0.0, 0.0, 3.0, 4.0, 9.0, 10.0])
    progress = ProgressLines(said.append, lambda: next(times))
    for text in ("Does it hold?", "  50 of 200 runs", "  100 of 200 runs", "  200 of 200 runs", "  50 of 200 runs", "Which? 1 of 4 on"):
        progress(text)
    assert said[2] == "  100 of 200 runs (3 s left)"
    assert said[4] == "  50 of 200 runs (15 s left)"  # another count, which began when the last one ended, at 4 s
    assert [text for text in said if "left" in text] == [said[2], said[4]]


def test_a_reader_that_has_seen_enough_is_no_error(tmp_path):
    command = f"{shlex.quote(sys.executable)} -m obsdesign schema scenario | head -1; echo ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", command], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert (done.stdout.split()[-1], done.stderr) == ("0", "")


def test_the_page_of_verbs_is_that_of_their_table():
    spec = importlib.util.spec_from_file_location("command_line_page", ROOT / "docs" / "command_line.py")
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    page = (ROOT / "docs" / "command_line.md").read_text(encoding="utf-8")
    assert page == script.page(), "written by: python docs/command_line.py"
    assert re.findall(r"^## `obsdesign (\S+)`$", page, flags=re.MULTILINE) == [verb.name for verb in VERBS]
