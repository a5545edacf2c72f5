"""The README's example runs, and its commands and files exist."""

from __future__ import annotations

import re
import subprocess
import sys

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
    assert second.startswith("locally optimal")


def test_the_verdict_example_runs_and_says_what_it_promises():
    assert printed_by_example(1) == ["7 ('V', 'lam', 'rho', 'c') True", "11"]


def test_every_file_it_links_to_exists():
    links = [link for link in re.findall(r"\]\(([^)]+)\)", README) if "://" not in link]
    assert links
    assert [link for link in links if not (ROOT / link).exists()] == []


def test_every_command_is_a_target_of_the_makefile():
    targets = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), flags=re.MULTILINE)
    assert set(re.findall(r"^make (\w+)", README, flags=re.MULTILINE)) <= set(targets)
