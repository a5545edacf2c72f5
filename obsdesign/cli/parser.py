"""The parser of the command line, made from the table of verbs."""

from __future__ import annotations

import argparse
import difflib
import re
from collections.abc import Iterator, Sequence
from typing import NoReturn

from obsdesign import __version__
from obsdesign.cli.verb import JSON, Argument, Verb
from obsdesign.errors import InputError

_DESCRIPTION = "Can my sensors see the whole state, how should I move, which sensors need to be on, and does it hold in a filter?"
EXIT_CODES = """exit codes: 0 done, 1 the study says no (unobservable, infeasible, an expected value missed),
            2 bad input, 3 a solver or obsdesign itself failed, 130 interrupted"""
# how shtab names what completes files and folders, without loading it
_COMPLETERS = {
    "files": {"bash": "_shtab_compgen_files", "zsh": "_files", "tcsh": "f"},
    "folders": {"bash": "_shtab_compgen_dirs", "zsh": "_files -/", "tcsh": "d"},
}


class UsageError(InputError):
    """A command line that cannot be meant."""


class CommandParser(argparse.ArgumentParser):
    """An argument parser whose errors are exceptions, so that they are told as all others are, and that knows what was nearly right."""

    def error(self, message: str) -> NoReturn:
        """Raise UsageError with the usage, the reason and the nearest word."""
        raise UsageError(f"{message}{_nearest_word(message, self)}\n{self.format_usage().rstrip()}")


def build_parser(verbs: Sequence[Verb]) -> CommandParser:
    """Return the parser of a table of verbs."""
    parser = CommandParser(
        prog="obsdesign",
        description=_DESCRIPTION,
        epilog="\n".join(("examples:", *(f"  obsdesign {verb.example}" for verb in verbs), "", EXIT_CODES)),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"obsdesign {__version__}")
    parser.add_argument("--print-completion", action=_Completion, choices=("bash", "zsh", "tcsh"), help="print a shell's completion script")
    rows = parser.add_subparsers(title="verbs", required=True, metavar="VERB")
    for verb in verbs:
        _add_verb(rows, verb)
    return parser


def _add_verb(rows: argparse._SubParsersAction, verb: Verb) -> None:
    parser = rows.add_parser(verb.name, help=verb.what, description=verb.what, epilog=f"example: obsdesign {verb.example}")
    parser.set_defaults(verb=verb, quiet=False)
    for argument in (*verb.arguments, JSON):
        _add_argument(parser, argument)


def _add_argument(parser: argparse.ArgumentParser, argument: Argument) -> None:
    if argument.is_flag:
        parser.add_argument(argument.name, action="store_true", help=argument.what)
        return
    is_option = argument.name.startswith("-")
    action = parser.add_argument(
        argument.name,
        action="append" if argument.may_repeat else "store",
        help=argument.what,
        type=argument.read,
        default=argument.default,
        choices=argument.choices or None,
        metavar=argument.variable if is_option else None,
        **({"required": argument.is_required} if is_option else {"nargs": "?"} if argument.may_miss else {}),  # pyright: ignore[reportArgumentType]
    )
    if argument.completes is not None:
        action.complete = _COMPLETERS[argument.completes]  # pyright: ignore[reportAttributeAccessIssue]


class _Completion(argparse.Action):
    """Print a completion script, and end."""

    def __call__(self, parser: argparse.ArgumentParser, *values: object) -> NoReturn:
        import shtab

        print(shtab.complete(parser, shell=str(values[1])))
        parser.exit()


def _nearest_word(message: str, parser: argparse.ArgumentParser) -> str:
    """Return "; did you mean ...?" where the message quotes a word that is nearly one of those that are accepted."""
    quoted = re.search(r"invalid choice: '([^']*)'|unrecognized arguments: (\S+)", message)
    near = () if quoted is None else difflib.get_close_matches(quoted[1] or quoted[2], _words(parser), n=1)
    return f"; did you mean {near[0]!r}?" if near else ""


def _words(parser: argparse.ArgumentParser) -> Iterator[str]:
    """Yield all options and choices of a parser, those of its verbs included."""
    for action in parser._actions:
        yield from action.option_strings
        yield from map(str, action.choices or ())
        if isinstance(action, argparse._SubParsersAction):
            for verb in action.choices.values():
                yield from _words(verb)
