"""Write docs/command_line.md: every verb, its arguments, an example and its exit codes, from the table of verbs."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from obsdesign.cli.table import VERBS
from obsdesign.cli.verb import JOBS, Argument, Verb
from obsdesign.errors import ExitCode

FILE = Path(__file__).parent / "command_line.md"
_HEAD = """# The command line

Made by `docs/command_line.py` from the table of verbs, which `obsdesign --help` and the completion of shells are made of, too.

Every verb has `--json`: one JSON object on standard output, and nothing else there. What goes wrong stands on standard error.
Beside the exit codes named below there are 2 (the input is refused: the message names the thing, the value and what is accepted), 3 (no
solver found an answer) and 130 (interrupted). A shell completes words after `eval "$(obsdesign --print-completion bash)"`, or `zsh`.
"""
_CODES = {ExitCode.DONE: "0 done", ExitCode.NO: "1 the answer is no"}


def page() -> str:
    """Return the page."""
    return "\n".join([_HEAD, *(line for verb in VERBS for line in _section(verb))])


def _section(verb: Verb) -> Iterator[str]:
    yield from (f"## `obsdesign {verb.name}`", "", f"{verb.what[0].upper()}{verb.what[1:]}.", "", f"    obsdesign {verb.example}", "")
    shown = [argument for argument in verb.arguments if argument.name != "--json"]
    if shown:
        yield from ("| argument | |", "| :-- | :-- |", *map(_row, shown), "")
    codes = [_CODES[code] for code in verb.exits if code in _CODES]
    if codes:
        yield from (f"Exit codes: {', '.join(codes)}.", "")


def _row(argument: Argument) -> str:
    value = f" {argument.variable}" if argument.variable else ""
    default = "the number of processors" if argument is JOBS else str(argument.default)
    what = argument.what.replace("%(default)s", default).replace("|", "\\|")
    choices = f": {', '.join(f'`{choice}`' for choice in argument.choices)}" if argument.choices else ""
    needed = " (needed)" if argument.is_required else ""
    return f"| `{argument.name}{value}` | {what}{choices}{needed} |"


if __name__ == "__main__":
    FILE.write_text(page(), encoding="utf-8")
