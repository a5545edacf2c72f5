"""Scenarios to start from: those that come with the package."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path

import obsdesign
from obsdesign.errors import InputError
from obsdesign.scenario.problem_text import nearest_word

SCHEMA_FILE = "scenario.schema.json"
_EXPECTED = "[[expected]]"
_END = """
# What you know to be true of the result can stand here; `obsdesign run` compares, and ends with exit code 1 where it is missed.
# [[expected]]
# key = "paths.designed.feasible"   # a path in result.json
# value = true
# source = "who says so"
"""


@dataclass(frozen=True)
class Starter:
    """A scenario that comes with the package: its name, what it is called, what it asks, and its text."""

    name: str
    title: str
    question: str
    text: str


def starters() -> tuple[Starter, ...]:
    """Return the scenarios that come with the package, by name."""
    return tuple(map(_starter, sorted(_folder().glob("*.toml"))))


def starter_of(name: str) -> Starter:
    """Return the starter of a name. Raises InputError for one that is not there."""
    every = {starter.name: starter for starter in starters()}
    if name not in every:
        hint, _ = nearest_word(name, list(every))
        raise InputError(f"template is {name!r}: must be one of {', '.join(every)}{hint}")
    return every[name]


def text_to_edit(starter: Starter) -> str:
    """Return a starter's text for somebody to change: editors find its schema, its known truths are left out as they hold for it alone."""
    body = starter.text.split(_EXPECTED)[0]
    lines = body.rstrip().split("\n")
    while lines[-1].startswith("#") or not lines[-1]:  # what was said of the known truths
        lines.pop()
    return f"#:schema ./{SCHEMA_FILE}\n" + "\n".join(lines) + "\n" + _END


def _folder() -> Path:
    """Where the starters are: in the package as it is installed, beside it in a checkout."""
    package = Path(obsdesign.__file__).parent
    installed = package / "starters"
    return installed if installed.is_dir() else package.parent / "scenarios"


def _starter(file: Path) -> Starter:
    text = file.read_text(encoding="utf-8")
    data = tomllib.loads(text)
    return Starter(file.stem, data["title"], data["question"], text)
