"""What several test files share: a small scenario, and the main job run once."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
AEROSONDE = ROOT / "scenarios" / "aerosonde_wind.toml"

_SMALLER = {
    "duration = 120.0": "duration = 40.0",
    "pieces = 24": "pieces = 8",
    "starts = 8": "starts = 2",
    "point = [1400.0, 800.0]": "point = [600.0, 400.0]",
    "beacon = [-1000.0, 1700.0]": "beacon = [100.0, 500.0]",
    "runs = 200": "runs = 20",
}


def small_scenario() -> str:
    """The main job's scenario, cut down to a few seconds; without its list of expected values."""
    text = AEROSONDE.read_text().split("[[expected]]")[0]
    for old, new in _SMALLER.items():
        if old not in text:
            raise ValueError(f"the scenario has no {old!r} any more")
        text = text.replace(old, new)
    return text


def obsdesign(*arguments: str | Path, folder: Path, timeout: float = 300) -> subprocess.CompletedProcess[str]:
    """Run the command line in a folder."""
    unless = [f"-W{rule}" for rule in os.environ.get("TOLERATED_WARNINGS", "").split(",") if rule]  # of the oldest packages
    command = [sys.executable, "-W", "error", *unless, "-m", "obsdesign", *map(str, arguments)]
    environment = os.environ | {"COLUMNS": "200"}
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=timeout, check=False)


def seeds(count: int, quick: int) -> list[object]:
    """So many seeds, of which the first are looked at in `make test`, all in `make test-slow`."""
    return [seed if seed < quick else pytest.param(seed, marks=pytest.mark.slow) for seed in range(count)]


@pytest.fixture
def small_file(tmp_path: Path) -> Path:
    """The small scenario as a file."""
    file = tmp_path / "small.toml"
    file.write_text(small_scenario())
    return file
