"""What is told while a verb works: stages in their order, to whoever asks and to the loggers, and nothing else."""

from __future__ import annotations

import logging
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import obsdesign as od
from obsdesign.cli.progress import ProgressLines
from obsdesign.progress import Progress, StageReport

SYSTEM = od.System(od.Unicycle(), (od.GPS(1.0), od.Range((6.0, 9.0), 0.5)))
START, STD = (0.0, 0.0, 0.3), (1.0, 1.0, 0.1)
PROBLEM = od.DesignProblem(
    SYSTEM, START, 4.0, 0.5, od.PiecewiseConstant(4), {"speed": (1.0, 2.0), "turn_rate": (-0.5, 0.5)}, criterion=od.LogDet(), scale=STD
)
PRIOR = od.Prior(mean=START, std=STD)
BLOCKS = np.einsum("ksi,ksj->ksij", *2 * [np.random.default_rng(3).normal(size=(8, 3, 4))])


def _validated(progress: Progress | None) -> od.Validation:
    path = od.simulate(SYSTEM, START, np.tile([1.0, 0.2], (10, 1)), 0.5)
    return od.validate(SYSTEM, path, prior=PRIOR, runs=120, progress=progress)


# verb with a progress callback -> numbers of its result, and beginnings of what it tells, in order
VERBS: dict[str, tuple[Callable[[Progress | None], Any], Callable[[Any], Any], tuple[str, ...]]] = {
    "design_trajectory": (
        lambda progress: od.design_trajectory(PROBLEM, 2, progress=progress),
        lambda design: design.trajectory.u,
        ("what the sensors can see", "4 s: 2 local solves", "1 of 2 local solves done", "2 of 2 local solves done"),
    ),
    "select_sensors": (
        lambda progress: od.select_sensors(BLOCKS, progress=progress),
        lambda schedule: np.append(schedule.chosen, schedule.bound),
        ("the relaxation", "rounding and exchange"),
    ),
    "pareto": (
        lambda progress: od.pareto(
            BLOCKS, od.EnergyBudget(12.0, {"sensor 0": 1.0, "sensor 1": 2.0, "sensor 2": 3.0}), points=3, progress=progress
        ),
        lambda front: np.stack([front.values, front.bounds]),
        ("the best schedule without a limit", "0 of 3 limits done", "1 of 3 limits done"),
    ),
    "codesign": (
        lambda progress: od.codesign(PROBLEM, 4, starts=1, rounds=2, progress=progress),
        lambda joint: joint.design.trajectory.u,
        ("path first, and sensors first", "path and schedule in turn", "path and schedule at once", "the best of all"),
    ),
    "validate": (
        _validated,
        lambda validation: validation.nees,
        ("the posterior bound", "50 of 120", "100 of 120", "120 of 120"),
    ),
    "fly": (
        lambda progress: od.fly(PROBLEM, PRIOR, every=2.0, duration=4.0, iterations=2, progress=progress),
        lambda flight: flight.truth,
        ("the flight with inputs in the middle", "0 of 2 plans made, the next at 0 s", "1 of 2 plans made, the next at 2 s"),
    ),
}


@pytest.mark.parametrize("verb", VERBS)
def test_stages_arrive_in_order_and_change_nothing(verb: str, caplog: pytest.LogCaptureFixture, capfd: pytest.CaptureFixture[str]):
    """The callback and the logger of the verb's module hear the same, and whoever does not ask gets the same numbers."""
    call, numbers, expected = VERBS[verb]
    stages: list[str] = []
    caplog.set_level(logging.INFO, "obsdesign")
    told = call(stages.append)
    logged = [record.getMessage() for record in caplog.records if record.levelno == logging.INFO]
    remaining = iter(stages)
    for beginning in expected:
        assert any(stage.startswith(beginning) for stage in remaining), (beginning, stages)
    places = [logged.index(stage) for stage in dict.fromkeys(stages)]
    assert places == sorted(places)
    np.testing.assert_array_equal(numbers(told), numbers(call(None)))
    assert capfd.readouterr() == ("", "")


def test_iterations_are_told_at_level_debug(caplog: pytest.LogCaptureFixture):
    caplog.set_level(logging.DEBUG, "obsdesign")
    od.design_trajectory(PROBLEM, 1)
    iterations = [record for record in caplog.records if record.name == "obsdesign.design.sqp.trust_region_sqp"]
    assert iterations
    assert all(record.levelno == logging.DEBUG and record.getMessage().startswith("iteration ") for record in iterations)


def test_a_part_of_a_stage_is_told_with_an_indent_and_not_logged_twice(caplog: pytest.LogCaptureFixture):
    caplog.set_level(logging.INFO)
    told: list[str] = []
    report = StageReport(logging.getLogger("obsdesign.test"), told.append)
    report("a stage")
    report.within("a part")
    assert told == ["a stage", "  a part"]
    assert [record.getMessage() for record in caplog.records] == ["a stage"]
    StageReport(logging.getLogger("obsdesign.test")).within("nobody asks")


def test_what_is_counted_comes_as_it_is_done_with_the_time_that_is_left():
    shown: list[str] = []
    moments = iter((0.0, 3.0, 6.0, 9.0))
    report = StageReport(logging.getLogger("obsdesign.test"), ProgressLines(shown.append, lambda: next(moments)))
    report("a stage")
    results = report.count("abc", 4, "parts done")
    assert (next(results), len(shown)) == ("a", 2)
    assert list(results) == ["b", "c"]
    # what is left takes as long as what was done, 3 s each
    assert shown[1:] == ["1 of 4 parts done (9 s left)", "2 of 4 parts done (6 s left)", "3 of 4 parts done (3 s left)"]
    assert list(report.count("a", 1, "parts done")) == ["a"]
    assert len(shown) == 4


def test_the_library_installs_no_handler():
    """A process that imports all of it and runs a verb has as many handlers as before, and prints nothing."""
    code = (
        "import logging, numpy as np, obsdesign as od, obsdesign.study.runner\n"
        "od.select_sensors(np.tile(np.eye(2), (4, 2, 1, 1)))\n"
        "loggers = [logging.getLogger(), *map(logging.getLogger, logging.root.manager.loggerDict)]\n"
        "assert not [each for each in loggers if each.name.startswith(('root', 'obsdesign')) and each.handlers], loggers\n"
    )
    finished = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert (finished.stdout, finished.stderr) == ("", "")
