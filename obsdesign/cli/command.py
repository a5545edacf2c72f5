"""The command: reads the command line, lets the verb work, prints its answer and exits."""

from __future__ import annotations

import os
import sys
from argparse import Namespace
from collections.abc import Mapping, Sequence
from typing import NoReturn

from obsdesign.cli.parser import build_parser
from obsdesign.cli.table import VERBS
from obsdesign.cli.verb import Outcome, Verb
from obsdesign.errors import ExitCode, ObsdesignError, ScenarioError
from obsdesign.interrupts import Interrupts


def main(arguments: Sequence[str] | None = None, verbs: Sequence[Verb] = VERBS) -> NoReturn:
    """Run one verb and exit."""
    # pydantic would read the metadata of every installed package in search of plugins: a tenth of the start of `check`
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    words = sys.argv[1:] if arguments is None else arguments
    as_json = "--json" in words
    interrupts = Interrupts(lambda: _print_error("interrupted: nothing was written", ExitCode.INTERRUPTED, as_json))
    interrupts.listen()
    code = ExitCode.DONE
    try:
        options = build_parser(verbs).parse_args(words)
        outcome = options.verb.action(options)
        code = outcome.code
        _print_outcome(outcome, options)
    except BrokenPipeError:  # whoever reads has seen enough; the interpreter would say so once more when it flushes
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except (Exception, KeyboardInterrupt) as error:  # noqa: BLE001  # whatever it is, it has an exit code
        if interrupts.count or isinstance(error, KeyboardInterrupt):
            interrupts.report_once()
            code = ExitCode.INTERRUPTED
        elif isinstance(error, ObsdesignError):
            code = error.exit_code
            _print_error(str(error), code, as_json, error.problems if isinstance(error, ScenarioError) else ())
        else:  # a fault of ours: never exit code 1, which is an answer of the study
            code = ExitCode.SOLVER_FAILED
            import traceback

            traceback.print_exc()
            _print_error(f"internal error, please report it: {type(error).__name__}: {error}", code, as_json)
    sys.exit(code)


def _print_outcome(outcome: Outcome, options: Namespace) -> None:
    if options.json:
        import json

        print(json.dumps(outcome.document, indent=1, allow_nan=False))
    elif not options.quiet:
        _print_for_people(outcome.shown)
    sys.stdout.flush()
    for line in outcome.complaints:
        print(line, file=sys.stderr)


def _print_for_people(shown: tuple[object, ...]) -> None:
    """Print lines as they are, tables by rich."""
    for part in shown:
        if isinstance(part, str):
            print(part)
        else:
            from rich.console import Console

            Console(highlight=False, soft_wrap=True).print(part)


def _print_error(message: str, code: ExitCode, as_json: bool, problems: Sequence[Mapping[str, object]] = ()) -> None:
    print(f"obsdesign: {message}", file=sys.stderr)
    if as_json:
        import json

        print(json.dumps({"error": message, "exit_code": int(code), "problems": problems}, default=str))
