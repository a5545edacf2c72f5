"""`obsdesign export`: a result's path and schedule in the formats of autopilots and planners."""

from __future__ import annotations

import re
from argparse import ArgumentTypeError, Namespace
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from obsdesign.cli.verb import QUIET, Argument, Outcome, Verb
from obsdesign.exchange.words import AUTOPILOTS, FORMAT_WORDS

if TYPE_CHECKING:
    from obsdesign.exchange.export_result import Export


def export_result(options: Namespace) -> Outcome:
    """Write a result's path and schedule in another format, and tell what leaving points out costs."""
    from obsdesign.exchange.export_result import export

    done = export(
        options.result,
        options.to,
        options.out,
        tolerance=options.tolerance,
        every=options.every,
        autopilot=options.autopilot,
        switches=dict(options.switches),
    )
    return Outcome(export_document(done), export_lines(done))


def export_document(done: Export) -> dict[str, object]:
    """Return what was written as JSON has it."""
    from obsdesign.report.paths_to_document import way_points_part

    costs = None if done.thinned is None else way_points_part(done.thinned).model_dump(mode="json")
    return {"files": list(map(str, done.files)), "points": done.points, "thinned": costs, "notes": list(done.notes)}


def export_lines(done: Export) -> tuple[str, ...]:
    """Return what was written, and what it costs, in words."""
    from obsdesign.report.number_format import plain

    costs = () if done.thinned is None else (done.thinned.in_words,)
    return (f"Written: {', '.join(map(str, done.files))} ({plain(done.points)} points)", *costs, *done.notes)


def length_type(unit: str) -> Callable[[str], float]:
    """Return what reads a number above 0 with its unit or without."""

    def length(text: str) -> float:
        """Return the number, or raise ArgumentTypeError."""
        number = re.fullmatch(rf"(\d+(?:\.\d+)?|\.\d+)\s*{unit}?", text)
        if number is None or float(number[1]) <= 0:
            raise ArgumentTypeError(f"{text!r} must be a number above 0, in {unit}, such as 5{unit}")
        return float(number[1])

    return length


def formats_type(text: str) -> tuple[str, ...]:
    """Return the formats of a list with commas, or raise ArgumentTypeError."""
    words = tuple(text.split(","))
    wrong = [word for word in words if word not in FORMAT_WORDS]
    if wrong:
        raise ArgumentTypeError(f"{wrong[0]!r} must be one of {', '.join(FORMAT_WORDS)}")
    return words


def _switches_type(text: str) -> tuple[tuple[str, int], ...]:
    pairs = [pair.rpartition("=") for pair in text.split(",")]
    if not all(name and number.isdecimal() for name, _, number in pairs):
        raise ArgumentTypeError(f"{text!r} must be sensors and numbers, such as gps=1,range=2")
    return tuple((name, int(number)) for name, _, number in pairs)


TOLERANCE = Argument(
    "--tolerance", "leave out points that the path stays so near without (default: 2m for missions)", length_type("m"), variable="2m"
)
EVERY = Argument("--every", "keep the first point of every so many seconds instead", length_type("s"), variable="5s")
AUTOPILOT = Argument(
    "--autopilot", "whose items, and whose guidance (default: %(default)s)", default="px4", choices=AUTOPILOTS, variable="NAME"
)
VERB = Verb(
    name="export",
    what="write a result's path and schedule as autopilots and planners load them",
    action=export_result,
    example="export reports/my --to plan --autopilot ardupilot",
    arguments=(
        Argument("result", "folder that run or select wrote", Path, completes="folders"),
        Argument("--to", f"one of {', '.join(FORMAT_WORDS)}", choices=FORMAT_WORDS, is_required=True, variable="FORMAT"),
        Argument("--out", "file to write, a folder for a bag (default: path.* in the result)", Path, completes="files", variable="FILE"),
        TOLERANCE,
        EVERY,
        AUTOPILOT,
        Argument("--switches", "relays or actuators that switch sensors, such as gps=1", _switches_type, (), variable="LIST"),
        QUIET,
    ),
)
