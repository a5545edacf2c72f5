"""What a newcomer does: install wheel or sdist into an empty environment outside the checkout, and begin."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT

OURS, ALL = 15e6, 1e9  # [bytes] at most: obsdesign, and it with all that it brings; docs/install.md says which packages weigh what


def call(*words: str | Path, folder: Path) -> str:
    """What a command prints, in an environment that knows nothing of the checkout. Raises CalledProcessError where it fails."""
    clean = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "VIRTUAL_ENV"))}
    done = subprocess.run([str(word) for word in words], cwd=folder, env=clean, check=True, capture_output=True, text=True)
    return done.stdout


def size(folder: Path) -> int:
    """Bytes of the files below a folder."""
    return sum(file.stat().st_size for file in folder.rglob("*") if file.is_file() and not file.is_symlink())


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "ending"), [("wheel", "*.whl"), ("sdist", "*.tar.gz")])
def test_an_empty_environment_gets_all_it_needs_from_what_is_built(kind, ending, tmp_path):
    call(sys.executable, "-m", "hatchling", "build", "-t", kind, "-d", tmp_path / "dist", folder=ROOT)
    call(sys.executable, "-m", "venv", tmp_path / "venv", folder=tmp_path)
    python, obsdesign = tmp_path / "venv/bin/python", tmp_path / "venv/bin/obsdesign"
    (built,) = (tmp_path / "dist").glob(ending)
    before = size(tmp_path / "venv")
    call(python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", built, folder=tmp_path)
    assert size(tmp_path / "venv") - before < ALL
    (package,) = (tmp_path / "venv").glob("lib/python*/site-packages/obsdesign")
    assert size(package) < OURS
    study = tmp_path / "study"
    study.mkdir()
    where = call(python, "-c", "import obsdesign; print(obsdesign.__file__)", folder=study)
    assert Path(where.strip()).is_relative_to(tmp_path / "venv")
    call(obsdesign, "init", folder=study)
    assert call(obsdesign, "check", folder=study).startswith("aerosonde_wind.toml: fine")
    found = json.loads(call(obsdesign, "doctor", "--json", folder=study))
    assert found["ok"]
    assert {"numpy", "casadi", "known truth"} <= {check["what"] for check in found["checks"] if check["ok"]}
