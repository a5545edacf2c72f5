"""A file dropped into a family's folder is part of the package: nothing else has to know of it, the report included."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import jsonschema
import numpy as np
import pytest

import obsdesign

DROPPED = Path(__file__).parent / "drop_in"
ROOT = Path(__file__).parent.parent
FAMILIES = ("vehicles", "sensors", "criteria", "paths", "constraints", "costs", "rules")


@pytest.fixture(scope="module")
def study(tmp_path_factory) -> Path:
    """The folder that a study writes which uses a new file of every family."""
    place = tmp_path_factory.mktemp("drop_in")
    package = Path(obsdesign.__file__).parent
    shutil.copytree(package, place / "obsdesign", ignore=shutil.ignore_patterns("__pycache__"))
    for family in FAMILIES:
        shutil.copytree(DROPPED / family, place / "obsdesign" / family, dirs_exist_ok=True)
    command = [sys.executable, "-m", "obsdesign", "run", str(DROPPED / "study.toml"), "--out", "out", "--jobs", "1"]
    done = subprocess.run(command, cwd=place, env=os.environ | {"PYTHONPATH": str(place)}, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "mean eigenvalue of S W S" in done.stdout
    return place / "out"


def test_every_family_has_a_file_that_the_package_does_not_have():
    for family in FAMILIES:
        (dropped,) = (DROPPED / family).glob("*.py")
        assert not (Path(obsdesign.__file__).parent / family / dropped.name).exists()


def test_the_result_of_new_parts_satisfies_the_schema_and_is_right(study):
    """The value of the schedule is the mean eigenvalue of what its sensors say, and no schedule that keeps the rule is above the bound."""
    result = json.loads((study / "result.json").read_text())
    jsonschema.validate(result, json.loads((ROOT / "docs" / "result.schema.json").read_text()))
    selection, quality = result["selection"], result["paths"]["designed"]["quality"]["all"]
    assert (selection["criterion_label"], selection["gap_kind"]) == ("mean eigenvalue", "relative")
    assert quality["value"] == pytest.approx(np.mean(quality["eigenvalues"]))
    assert result["paths"]["designed"]["feasible"]
    gps, second, speedometer, ranging = np.array(selection["chosen"]).T
    assert (speedometer | ranging).all()
    assert not (gps & second).any()
    assert selection["rules"] == ["OneOf: speedometer, range"]
    assert selection["value"] <= selection["bound"] <= selection["value"] * (1 + 1e-6)
    assert selection["value"] <= quality["value"]


def test_the_designed_path_is_of_the_new_family_and_keeps_the_new_limit(study):
    rows = np.genfromtxt(study / "trajectory.csv", delimiter=",", names=True)
    push, x = (rows[next(name for name in rows.dtype.names if name.startswith(start))] for start in ("push_x", "x"))
    np.testing.assert_allclose(np.diff(push[:8], 2), 0.0, atol=1e-9)
    assert x.max() <= 12.0 + 1e-6


def test_the_page_speaks_of_the_new_parts(study):
    page = (study / "report.html").read_text()
    for words in (
        "mean eigenvalue",
        "speedometer",
        "OneOf: speedometer, range",
        "exposure",
        "v_x [m/s]",
        "times that of the straight path",
    ):
        assert words in page.replace('<span class="unit">', "").replace("</span>", ""), words
