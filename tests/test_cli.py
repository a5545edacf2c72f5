"""The command line: exit codes, what is written where, and that nothing is written when something is wrong."""

from __future__ import annotations

import csv
import json
import os
import re
import select
import signal
import subprocess
import sys
import time
from pathlib import Path

import jsonschema
import pytest
from conftest import ROOT, obsdesign, small_scenario

import obsdesign as od

WRITTEN = ["question.toml", "report.html", "result.json", "schedule.csv", "trajectory.csv"]


def write(folder: Path, *changes: tuple[str, str]) -> Path:
    """Write the small scenario with changes."""
    text = small_scenario()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    file = folder / "scenario.toml"
    file.write_text(text)
    return file


EXPECTED = """
[[expected]]
key = "{}"
value = {}
source = "Brace and Morgansen"
"""
DIMENSION = "analyses.straight.gps.dimension"
FLIGHT = """
[flight]
every = 10.0
duration = 40.0
horizon = "shrinking"
"""


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """One run of the small scenario in two processes, as JSON; one expected value is met, one missed, one does not exist."""
    folder = tmp_path_factory.mktemp("finished")
    expected = EXPECTED.format(DIMENSION, 4) + EXPECTED.format(DIMENSION, 5) + EXPECTED.format("designs.all.valu", 1)
    (folder / "scenario.toml").write_text(small_scenario() + FLIGHT + expected)
    return folder, obsdesign("run", "scenario.toml", "--out", "out", "--jobs", "2", "--json", folder=folder)


@pytest.fixture(scope="module")
def again(finished):
    """The same run in one process, with the summary for people."""
    folder, _ = finished
    return obsdesign("run", "scenario.toml", "--jobs", "1", folder=folder)


def test_run_writes_four_files_and_json_is_one_object_on_stdout(finished):
    folder, done = finished
    assert sorted(path.name for path in (folder / "out").iterdir()) == WRITTEN
    assert json.loads(done.stdout) == json.loads((folder / "out" / "result.json").read_text())


def test_a_missed_expectation_is_exit_code_1_and_the_report_is_written(finished):
    folder, done = finished
    assert done.returncode == 1
    assert done.stderr.splitlines() == [
        f"expected {DIMENSION} = 5 within 0.0 (Brace and Morgansen): found 4",
        "expected designs.all.valu = 1 within 0.0 (Brace and Morgansen): no such key in result.json",
    ]
    result = json.loads((folder / "out" / "result.json").read_text())
    assert [each["met"] for each in result["expected"]] == [True, False, False]


def test_result_satisfies_the_published_schema(finished):
    folder, _ = finished
    published = json.loads((ROOT / "docs" / "result.schema.json").read_text())
    printed = obsdesign("schema", "result", folder=folder)
    assert json.loads(printed.stdout) == published
    jsonschema.Draft202012Validator(published).validate(json.loads((folder / "out" / "result.json").read_text()))


def test_the_same_seed_gives_the_same_bytes_for_any_number_of_processes(finished, again):
    folder, _ = finished
    assert again.returncode == 1
    other = folder / "reports" / "scenario"
    for name in ("trajectory.csv", "schedule.csv"):
        assert (other / name).read_bytes() == (folder / "out" / name).read_bytes()
    first, second = (json.loads((place / "result.json").read_text()) for place in (folder / "out", other))
    assert first.pop("timings").keys() == second.pop("timings").keys()
    assert json.dumps(first) == json.dumps(second)


def test_the_page_is_built_again_from_the_result_alone_to_the_same_bytes(finished, tmp_path):
    folder, _ = finished
    (tmp_path / "result.json").write_bytes((folder / "out" / "result.json").read_bytes())
    done = obsdesign("report", "result.json", "--json", folder=tmp_path)
    assert (done.returncode, json.loads(done.stdout)["page"]) == (0, "report.html")
    assert (tmp_path / "report.html").read_bytes() == (folder / "out" / "report.html").read_bytes()


def test_comparing_tells_what_changed_in_the_question_and_in_the_answer(finished, again, tmp_path):
    folder, _ = finished
    result = json.loads((folder / "out" / "result.json").read_text())
    result["scenario"]["source"] = result["scenario"]["source"].replace("sigma = 2.0 # m", "sigma = 3.0 # m").replace("starts = 2", "")
    result["designs"]["all"]["value"] *= 2
    result["selection"]["filter"]["cost"] = None  # a key that is not there
    (tmp_path / "other.json").write_text(json.dumps(result))
    assert "selection.filter.cost" in obsdesign("compare", folder / "out", "other.json", folder=tmp_path).stderr
    del result["selection"]["filter"]["cost"]
    (tmp_path / "other.json").write_text(json.dumps(result))
    done = obsdesign("compare", folder / "out", "other.json", "--json", folder=tmp_path)
    document = json.loads(done.stdout)
    assert document["changes"] == [
        {"key": "sensors[0].sigma", "first": 2.0, "second": 3.0},
        {"key": "design.starts", "first": 2, "second": None},
    ]
    values = {pair["what"]: pair for pair in document["numbers"]}
    assert {what for what, pair in values.items() if pair["first"] != pair["second"]} == {"value, path for all"}
    assert values["value, path for all"]["second"] == 2 * values["value, path for all"]["first"]
    same = obsdesign("compare", "out", "reports/scenario", "--out", "page", "--json", folder=folder)
    assert json.loads(same.stdout)["notes"] == ["the question, the seed and the versions are the same"]
    page = (folder / "page" / "comparison.html").read_text()
    ids = re.findall(r' id="([^"]+)"', page)
    assert len(ids) == len(set(ids)) and set(re.findall(r'(?:href="#|url\(#)([^")]+)', page)) <= set(ids)
    assert page.count("<svg") == 6 and "http" not in page.replace("http-equiv", "")


@pytest.mark.parametrize(
    "name",
    [
        "os:system",
        "obsdesign.cli.command:main",
        "obsdesign.interrupts:os",
        "obsdesign.nowhere:Study",
        "obsdesign.study.record:Study.main",
        "",
    ],
)
def test_a_record_names_records_of_obsdesign_and_nothing_else(name, finished, tmp_path):
    folder, _ = finished
    result = json.loads((folder / "out" / "result.json").read_text())
    next(written for written in result["record"] if "record" in written)["record"] = name
    (tmp_path / "result.json").write_text(json.dumps(result))
    with pytest.raises(od.InputError, match="its record is not one that obsdesign"):
        od.load_study(tmp_path)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"record": []}, "holds no record of the study"),
        ({"record": [{"array": "AAAA", "type": "|O8", "shape": [1]}, 0]}, "no array of '|O8' is read"),
        ({"record": [{"array": "AAAAAAAAAAA=", "type": "<f8", "shape": [10**12]}, 0]}, "cannot reshape"),
        ({"record": [{"at": 0}]}, "IndexError"),
        ({"record": [1.0]}, "its record is of float: must be of a Study"),
        ({"schema_version": None}, "is no result of this version of obsdesign"),
    ],
    ids=["left out", "objects", "too large", "circle", "no study", "no result"],
)
def test_a_result_that_holds_no_study_is_refused_by_name(change, said, finished, tmp_path):
    folder, _ = finished
    result = json.loads((folder / "out" / "result.json").read_text()) | change
    (tmp_path / "result.json").write_text(json.dumps(result))
    with pytest.raises(od.InputError, match=re.escape(said)):
        od.load_study(tmp_path / "result.json")


def test_csv_files_have_units_in_the_header_and_a_row_per_node(finished):
    folder, _ = finished
    with (folder / "out" / "trajectory.csv").open() as table:
        header, *rows = csv.reader(table)
    assert header == ["t [s]", "x [m]", "y [m]", "heading [rad]", "wind_x [m/s]", "wind_y [m/s]", "turn_rate [rad/s]"]
    assert [float(row[0]) for row in rows] == list(range(41))
    assert all(abs(float(row[6])) <= 0.25 for row in rows[:-1])
    assert rows[-1][6] == ""
    with (folder / "out" / "schedule.csv").open() as table:
        header, *rows = csv.reader(table)
    assert header == ["segment", "from [s]", "to [s]", "gps", "magnetometer", "range", "bearing"]
    assert all(sum(map(int, row[3:])) == 1 for row in rows)
    assert len(rows) == 8


def test_summary_names_units_and_what_is_good(finished, again):
    folder, _ = finished
    for part in ("wind_x [m/s]", "more is better", "less is better", "heading cannot be told from wind_x, wind_y", "reports/scenario/"):
        assert part in again.stdout
    assert sorted(path.name for path in (folder / "reports" / "scenario").iterdir()) == WRITTEN


@pytest.mark.parametrize("verb", ["run", "check"])
@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ([("speed = 20.0", "sped = 20.0")], "vehicle.sped"),
        ([("sigma = 2.0", "sigma = -2.0")], "sigma is -2.0"),
        ([("[time]", "[time")], "at line"),
    ],
)
def test_bad_input_is_exit_code_2_one_message_no_traceback_nothing_written(verb, changes, named, tmp_path):
    file = write(tmp_path, *changes)
    done = obsdesign(verb, file, folder=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("obsdesign: ")
    assert named in done.stderr
    assert "Traceback" not in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["scenario.toml"]


def test_a_file_that_is_not_there_is_bad_input(tmp_path):
    done = obsdesign("check", "nowhere.toml", "--json", folder=tmp_path)
    assert done.returncode == 2
    assert json.loads(done.stdout)["exit_code"] == 2
    assert "nowhere.toml: cannot be read" in done.stderr


def test_a_folder_that_cannot_be_written_is_refused_before_any_work(tmp_path):
    file = write(tmp_path)
    before = file.read_bytes()
    done = obsdesign("run", file, "--out", file, folder=tmp_path)
    assert done.returncode == 2
    assert "--out" in done.stderr
    assert (done.stdout, len(done.stderr.splitlines())) == ("", 1)
    assert (list(tmp_path.iterdir()), file.read_bytes()) == ([file], before)


def test_check_says_fine(tmp_path):
    done = obsdesign("check", write(tmp_path), folder=tmp_path)
    assert done.returncode == 0
    assert "fine" in done.stdout


def test_unobservable_is_exit_code_1_with_the_direction_and_nothing_written(tmp_path):
    text = small_scenario()
    gps, magnetometer = (text.index(f'[[sensors]]\nkind = "{kind}"') for kind in ("gps", "magnetometer"))
    beacon = text.index('[[sensors]]\nkind = "range"')
    assert gps < magnetometer < beacon
    text = (text[:gps] + text[beacon:]).replace('suites = [["gps"]]', "suites = []").replace('naive = "gps"', 'naive = "range"')
    (tmp_path / "scenario.toml").write_text(text)
    done = obsdesign("run", "scenario.toml", folder=tmp_path)
    assert (done.returncode, done.stdout) == (1, "")
    assert "rotation of everything about the beacon" in done.stderr
    assert "Traceback" not in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["scenario.toml"]


def test_an_unreachable_goal_is_exit_code_1_and_named(tmp_path):
    file = write(tmp_path, ("point = [600.0, 400.0]", "point = [6000.0, 400.0]"))
    done = obsdesign("run", file, folder=tmp_path)
    assert (done.returncode, done.stdout) == (1, "")
    assert "infeasible, proven: Goal: within 100 m of (6000, 400)" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["scenario.toml"]


def test_limits_that_contradict_each_other_are_exit_code_1_and_both_named(tmp_path):
    around = '[[design.constraints]]\nkind = "keep_out"\ncentre = [600.0, 400.0]\nradius = 150.0\n\n[selection]'
    file = write(tmp_path, ("[selection]", around), ("starts = 2", "starts = 1"), ('suites = [["gps"]]', "suites = []"))
    done = obsdesign("run", file, folder=tmp_path)
    assert (done.returncode, done.stdout) == (1, "")
    for part in ("no feasible point", "KeepOut: at least 150 m from (600, 400): missed by", "Goal: within 100 m of (600, 400): missed by"):
        assert part in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["scenario.toml"]


def test_a_failed_solver_is_exit_code_3_with_its_status_and_no_number(tmp_path):
    code = (
        "import obsdesign.study.runner as running\n"
        "from obsdesign.errors import SolveError\n"
        "from obsdesign.status import Status\n"
        "def failed(*_, **__): raise SolveError('trajectory design', Status.ITERATION_LIMIT)\n"
        "running.design_trajectory = failed\n"
        "from obsdesign.cli import main\n"
        "main(['run', 'scenario.toml', '--jobs', '1'])\n"
    )
    write(tmp_path)
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (3, "")
    assert "stopped at the iteration limit" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["scenario.toml"]


def test_a_fault_of_our_own_is_exit_code_3_with_its_traceback(tmp_path):
    # 1 is an answer of the study
    code = (
        "import obsdesign.scenario.loading as loading\n"
        "loading.load_scenario = lambda file: 1 / 0\n"
        "from obsdesign.cli import main\n"
        "main(['check', 'scenario.toml', '--json'])\n"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 3
    assert "Traceback" in done.stderr and "obsdesign: internal error, please report it: ZeroDivisionError" in done.stderr
    assert json.loads(done.stdout)["exit_code"] == 3


# ---------------------------------------------------------------- Ctrl-C

# where the tests themselves run in the background, SIGINT is ignored and children inherit that
LISTEN = "import signal, sys, time\nsignal.signal(signal.SIGINT, signal.default_int_handler)\n"
SAID = "obsdesign: interrupted: nothing was written"


def interrupted(code: str, folder: Path, began: str, delay: float = 0.0) -> list[str]:
    """Press Ctrl-C when the terminal shows that work has begun; return the lines that it shows from then on.

    Nothing is on stdout, the exit code is 130, and of all processes of the command none is left.
    """
    import pty  # not on Windows, where there are no process groups either

    ours, terminal = pty.openpty()
    command = [sys.executable, "-c", LISTEN + code]
    with subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=terminal, text=True, start_new_session=True) as process:
        os.close(terminal)
        try:
            before = shown_until(ours, began)
            time.sleep(delay)
            assert process.poll() is None
            os.killpg(process.pid, signal.SIGINT)
            output, _ = process.communicate(timeout=30)
            after = shown_until(ours, None)
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
            os.close(ours)
    assert (process.returncode, output) == (130, "")
    patience = time.monotonic() + 10
    while left := running(process.pid):
        assert time.monotonic() < patience, left
        time.sleep(0.1)
    return (before.partition(began)[2] + after).strip().splitlines()


def shown_until(terminal: int, text: str | None) -> str:
    """Read a terminal until it shows the text, or to its end."""
    shown = ""
    while text is None or text not in shown:
        assert select.select([terminal], [], [], 120)[0], shown
        try:
            more = os.read(terminal, 4096)
        except OSError:  # how Linux says that nobody is at the other side any more
            more = b""
        if not more:
            assert text is None, shown
            break
        shown += more.decode()
    return shown


def running(group: int) -> list[str]:
    """What runs in a process group; the dead that nobody has asked after do not count."""
    listed = subprocess.run(["ps", "-A", "-o", "pgid=,stat=,args="], capture_output=True, text=True, check=True).stdout
    columns = [line.split(None, 2) for line in listed.splitlines()]
    return [row[-1] for row in columns if int(row[0]) == group and not row[1].startswith("Z")]


@pytest.mark.parametrize("jobs", ["1", "2"])
def test_ctrl_c_leaves_no_file_and_no_process(jobs, tmp_path):
    """While paths are designed, here or by workers."""
    write(tmp_path, ("starts = 2", "starts = 60"), ("pieces = 8", "pieces = 40"))
    code = f"from obsdesign.cli import main\nmain(['run', 'scenario.toml', '--jobs', '{jobs}'])"
    *others, last = interrupted(code, tmp_path, "How?", 2.0)
    assert last == SAID
    assert "Traceback" not in "\n".join(others)
    assert [path.name for path in tmp_path.iterdir()] == ["scenario.toml"]


SWALLOWED = {
    "not": "time.sleep(60)",
    "once": """
try: time.sleep(60)
except KeyboardInterrupt: time.sleep(60)""",
    "always": """
while True:
    try: time.sleep(60)
    except KeyboardInterrupt: pass""",
    "by a finalizer": """
class Slow:
    def __del__(self): time.sleep(60)
Slow()
time.sleep(60)""",
    "as another error": """
try: time.sleep(60)
except KeyboardInterrupt: raise ImportError('initialization failed')""",
    "as one of ours": """
from obsdesign.errors import InputError
try: time.sleep(60)
except KeyboardInterrupt: raise InputError('no such thing')""",
    "and a thread that does not end": """
import threading
interrupts._PATIENCE = 0.5
threading.Thread(target=time.sleep, args=(60,)).start()
time.sleep(60)""",
}


def instead_of_check(work: str) -> str:
    """The command with other work to do, which says that it begins."""
    lines = "\n".join(f"    {line}" for line in f"print('began', file=sys.stderr)\n{work}".splitlines())
    modules = (
        "import dataclasses, obsdesign.interrupts as interrupts\n"
        "from obsdesign.cli import main\nfrom obsdesign.cli.verb import Outcome\nfrom obsdesign.cli.verbs.check import VERB"
    )
    return f"{modules}\ndef work(options):\n{lines}\nmain(['check', 'scenario.toml'], [dataclasses.replace(VERB, action=work)])"


@pytest.mark.parametrize("work", SWALLOWED.values(), ids=SWALLOWED.keys())
def test_ctrl_c_ends_the_command_whatever_swallows_it(work, tmp_path):
    assert interrupted(instead_of_check(work), tmp_path, "began", 0.1) == [SAID]


TASKS = "with interrupts.process_pool(3) as pool:\n    "
POOLS = {
    "long tasks": TASKS + "list(pool.map(time.sleep, [60] * 9))",
    "short tasks": TASKS + "list(pool.map(time.sleep, [0.01] * 20000))",
    "large answers": TASKS + "list(pool.map(bytes, [10**7] * 2000))",
    "always swallowed": TASKS + SWALLOWED["always"].replace("\n", "\n    "),
}


@pytest.mark.parametrize("delay", [0.0, 0.03, 0.1, 0.6])
@pytest.mark.parametrize("work", POOLS.values(), ids=POOLS.keys())
def test_ctrl_c_ends_workers_that_start_and_workers_that_work(work, delay, tmp_path):
    last = interrupted(instead_of_check(work), tmp_path, "began", delay)
    assert last[0] == SAID
    assert len(last) == 1 or "resource_tracker" in last[1]  # which clears up after a process that ended by force


def test_ctrl_c_during_the_last_work_comes_before_files_are_written(tmp_path):
    """Swallowed, but not forgotten."""
    work = "with interrupts.process_pool(1):\n    try: time.sleep(60)\n    except KeyboardInterrupt: pass\nprint('files', file=sys.stderr)"
    assert interrupted(instead_of_check(work), tmp_path, "began", 0.1) == [SAID]


def test_a_command_in_the_background_ignores_ctrl_c(tmp_path):
    code = LISTEN + "signal.signal(signal.SIGINT, signal.SIG_IGN)\n" + instead_of_check("time.sleep(1)\nreturn Outcome({})")
    with subprocess.Popen([sys.executable, "-c", code], cwd=tmp_path, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr.readline() == "began\n"
        process.send_signal(signal.SIGINT)
        assert process.wait(60) == 0


def test_help_names_every_verb_and_exit_code(tmp_path):
    done = obsdesign("--help", folder=tmp_path)
    assert done.returncode == 0
    for part in ("run", "select", "check", "schema", "exit codes"):
        assert part in done.stdout


def test_wrong_options_are_exit_code_2(tmp_path):
    done = obsdesign("run", write(tmp_path), "--jobs", "0", folder=tmp_path)
    assert done.returncode == 2
    assert "whole number of at least 1" in done.stderr
