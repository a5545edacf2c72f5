"""What a verb of the command line is: its arguments, its action, and what the action answers."""

from __future__ import annotations

import os
from argparse import ArgumentTypeError, Namespace
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from obsdesign.errors import ExitCode


@dataclass(frozen=True)
class Outcome:
    """The answer of a verb, to a machine, to a person and to a script; the command prints it.

    document: the one JSON object of --json; shown: lines of text and rich's tables, for stdout; complaints: lines for stderr, whatever
    the options; code: the exit code.
    """

    document: Mapping[str, object]
    shown: tuple[object, ...] = ()
    complaints: tuple[str, ...] = ()
    code: ExitCode = ExitCode.DONE


@dataclass(frozen=True)
class Argument:
    """One argument of a verb: a positional one without dashes in its name, an option with them.

    read: turns the text into a value. completes: what a shell offers. may_miss: whether a positional one may be left out.
    is_flag: an option without a value. may_repeat: whether an option's values are a list. variable: how help writes an option's value.
    """

    name: str
    what: str
    read: Callable[[str], object] = str
    default: object = None
    choices: tuple[str, ...] = ()
    completes: Literal["files", "folders"] | None = None
    may_miss: bool = False
    is_required: bool = False
    is_flag: bool = False
    may_repeat: bool = False
    variable: str | None = None


@dataclass(frozen=True)
class Verb:
    """One verb: help, completion, documentation and exit codes follow from it.

    what: one sentence for the list of verbs; example: a command line without the program's name; exits: the exit codes that it may have,
    beside 2, 3 (a fault of ours) and 130.
    """

    name: str
    what: str
    action: Callable[[Namespace], Outcome]
    example: str
    arguments: tuple[Argument, ...] = ()
    exits: tuple[ExitCode, ...] = field(default=(ExitCode.DONE,))


def whole_number_type(minimum: int) -> Callable[[str], int]:
    """Return what reads a whole number of at least `minimum`."""

    def whole_number(text: str) -> int:
        """Return the number, or raise ArgumentTypeError."""
        if not text.isdecimal() or int(text) < minimum:
            raise ArgumentTypeError(f"{text!r} must be a whole number of at least {minimum}")
        return int(text)

    return whole_number


JSON = Argument("--json", "print one JSON object on stdout", is_flag=True)
QUIET = Argument("--quiet", "print nothing when all is well", is_flag=True)
SEED = Argument("--seed", "overrides the scenario's seed", read=whole_number_type(0), variable="NUMBER")
SCENARIO = Argument("scenario", "TOML file (default: the scenario in this folder)", read=Path, completes="files", may_miss=True)
LANDMARKS = Argument(
    "--landmarks", "CSV table of name, x, y: each sensor without a beacon stands for one at each", Path, completes="files", variable="FILE"
)
JOBS = Argument(
    "--jobs",
    "processes (default: %(default)s); the answer does not depend on it",
    read=whole_number_type(1),
    default=os.cpu_count() or 1,
    variable="NUMBER",
)
RESULT = Argument("result", "result.json of a run, or its folder", read=Path, completes="files")


def out_argument(what: str) -> Argument:
    """Return --out, and what goes into the folder."""
    return Argument("--out", what, read=Path, completes="folders", variable="FOLDER")
