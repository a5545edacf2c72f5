"""The README's example runs, and its commands and files exist."""

from __future__ import annotations

import re
import subprocess
import sys
import zipfile

import pytest
from conftest import ROOT

README = (ROOT / "README.md").read_text()


def printed_by_example(number):
    example = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)[number]
    done = subprocess.run([sys.executable, "-W", "error", "-c", example], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def test_the_library_example_runs_and_says_what_it_promises():
    first, second, *_ = printed_by_example(0)
    assert first.startswith("heading cannot be told from wind_x, wind_y: ")
    value, bound, gap = map(float, second.split())
    assert 0 < value <= bound
    assert gap == pytest.approx(1 - value / bound)


def test_the_verdict_example_runs_and_says_what_it_promises():
    assert printed_by_example(1) == ["7 ('V', 'lam', 'rho', 'c') True", "11"]


def test_every_file_it_links_to_exists():
    # whole addresses, as a package index shows the text without the files beside it
    links = re.findall(r"\]\(([^)]+)\)", README)
    ours = [
        re.fullmatch(r"https://(?:raw\.githubusercontent|github)\.com/obsdesign/obsdesign/(?:blob/|tree/)?main/(.+)", link)
        for link in links
    ]
    assert links
    assert [link for link in links if "://" not in link] == []
    assert [match[1] for match in ours if match and not (ROOT / match[1]).exists()] == []


def test_a_wheel_brings_the_scenarios_to_start_from(tmp_path):
    subprocess.run([sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", tmp_path], cwd=ROOT, check=True, capture_output=True)
    with zipfile.ZipFile(next(tmp_path.glob("*.whl"))) as wheel:
        names = set(wheel.namelist())
    assert {f"obsdesign/starters/{path.name}" for path in (ROOT / "scenarios").glob("*.toml")} <= names
    assert {"obsdesign/__init__.pyi", "obsdesign/py.typed"} <= names


def test_every_command_is_a_target_of_the_makefile():
    targets = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), flags=re.MULTILINE)
    assert set(re.findall(r"^make (\w+)", README, flags=re.MULTILINE)) <= set(targets)
