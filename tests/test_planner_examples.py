"""The examples of docs/planners.md run, and come to what they promise."""

from __future__ import annotations

import importlib.util
import sys
from types import ModuleType

import numpy as np
from conftest import ROOT

FOLDER = ROOT / "examples"


def example(name: str) -> ModuleType:
    """Load an example as a module."""
    spec = importlib.util.spec_from_file_location(f"example_{name}", FOLDER / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def test_all_examples_are_tested_and_told_of():
    names = {path.name for path in FOLDER.glob("*.py")}
    assert names == {"sampling_planner.py", "receding_horizon.py", "node_loop.py"}
    text = (ROOT / "docs" / "planners.md").read_text()
    assert all(f"../examples/{name}" in text for name in names)


def test_a_sampling_planner_finds_a_path_that_tells_more_than_the_straight_one(capsys):
    answer = example("sampling_planner").main(candidates=400)
    assert answer["arrived"] >= 1
    assert answer["best"] > answer["straight"] > 0


def test_a_receding_horizon_learns_the_wind(capsys):
    history = example("receding_horizon").main()
    deviations, errors = history["std of the wind"], history["error of the wind"]
    assert deviations[-1] < 0.5 * deviations[0]
    assert errors[-1] < 4 * deviations[-1]


def test_a_node_switches_sensors_with_a_bound_and_keeps_its_place(capsys):
    *published, end = example("node_loop").main()
    assert len(published) == 5
    assert {message["switch_on"] for message in published} <= {"gps", "magnetometer", "bearing"}
    assert all(message["bound"] <= message["cost"] * (1 + 1e-9) for message in published)
    assert end["error"] < 4 * np.hypot(*end["std"][:2])
