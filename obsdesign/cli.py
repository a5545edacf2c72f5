"""The command line: verbs, exit codes, and the only place that prints."""

from __future__ import annotations

import argparse
import json
import os
import sys
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from obsdesign import __version__
from obsdesign.errors import ExitCode, InputError, ObsdesignError
from obsdesign.interrupts import Interrupts, process_pool

if TYPE_CHECKING:
    from obsdesign.report.document import Result

_EXAMPLES = """examples:
  obsdesign check scenarios/aerosonde_wind.toml
  obsdesign run scenarios/aerosonde_wind.toml --out reports/aerosonde_wind
  obsdesign select path.csv --scenario scenarios/aerosonde_wind.toml
  obsdesign schema result > result.schema.json

exit codes: 0 done, 1 the study says no (unobservable, infeasible, an expected value missed),
            2 bad input, 3 a solver or obsdesign itself failed, 130 interrupted"""


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run one verb and exit."""
    # pydantic would read the metadata of every installed package in search of plugins: a tenth of the start of `check`
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    options = _parser().parse_args(arguments)
    interrupts = Interrupts(lambda: _print_error(options, "interrupted: nothing was written", ExitCode.INTERRUPTED))
    interrupts.listen()
    try:
        code = options.verb(options)
    except (Exception, KeyboardInterrupt) as error:  # noqa: BLE001  # whatever it is, it has an exit code
        if interrupts.count or isinstance(error, KeyboardInterrupt):
            interrupts.report_once()
            code = ExitCode.INTERRUPTED
        elif isinstance(error, ObsdesignError):
            code = error.exit_code
            _print_error(options, str(error), code)
        else:  # a fault of ours: never exit code 1, which is an answer of the study
            code = ExitCode.SOLVER_FAILED
            traceback.print_exc()
            _print_error(options, f"internal error, please report it: {type(error).__name__}: {error}", code)
    sys.exit(code)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="obsdesign",
        description="Can my sensors see the whole state, how should I move, which sensors need to be on, and does it hold in a filter?",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"obsdesign {__version__}")
    verbs = parser.add_subparsers(title="verbs", required=True, metavar="VERB")
    run = _verb(verbs, "run", _run, "answer the four questions of a scenario and write a page to look at")
    run.add_argument("scenario", type=Path, help="TOML file")
    run.add_argument("--out", type=Path, help="folder for report.html, result.json, trajectory.csv, schedule.csv (default: reports/NAME)")
    run.add_argument("--seed", type=_whole_number_type(0), help="overrides the scenario's seed")
    run.add_argument(
        "--jobs",
        type=_whole_number_type(1),
        default=os.cpu_count() or 1,
        help="processes (default: %(default)s); the answer does not depend on it",
    )
    run.add_argument("--quiet", action="store_true", help="no progress, no summary")
    select = _verb(verbs, "select", _select, "choose the sensors along a path from a file, or along that of an earlier run")
    select.add_argument("path", type=Path, help="CSV file with t, the states and perhaps the inputs, or a folder with a trajectory.csv")
    select.add_argument("--scenario", type=Path, required=True, help="TOML file: vehicle, sensors, prior, time, selection; no design")
    select.add_argument("--out", type=Path, help="folder for report.html, result.json, trajectory.csv, schedule.csv (default: none)")
    select.add_argument("--seed", type=_whole_number_type(0), help="overrides the scenario's seed")
    select.add_argument("--quiet", action="store_true", help="no table")
    check = _verb(verbs, "check", _check, "read a scenario and say what is wrong with it; starts no solver")
    check.add_argument("scenario", type=Path, help="TOML file")
    check.add_argument("--quiet", action="store_true", help="say nothing when all is well")
    for verb in (run, select, check):
        verb.add_argument("--json", action="store_true", help="print one JSON object on stdout")
    schema = _verb(verbs, "schema", _schema, "print the JSON Schema of scenarios or of result.json")
    schema.add_argument("document", choices=("scenario", "result"))
    schema.set_defaults(json=False)
    return parser


def _verb(
    verbs: argparse._SubParsersAction, name: str, action: Callable[[argparse.Namespace], ExitCode], what: str
) -> argparse.ArgumentParser:
    parser = verbs.add_parser(name, help=what, description=what)
    parser.set_defaults(verb=action)
    return parser


def _whole_number_type(minimum: int) -> Callable[[str], int]:
    def whole_number(text: str) -> int:
        """Return the number, or raise ArgumentTypeError."""
        if not text.isdecimal() or int(text) < minimum:
            raise argparse.ArgumentTypeError(f"{text!r} must be a whole number of at least {minimum}")
        return int(text)

    return whole_number


def _run(options: argparse.Namespace) -> ExitCode:
    from obsdesign.scenario.loading import load_scenario

    scenario = load_scenario(options.scenario)
    folder = options.out or Path("reports") / options.scenario.stem
    _require_writable(folder)

    from rich.console import Console

    from obsdesign.report.folder import as_json, write_report
    from obsdesign.study.runner import run

    errors = Console(stderr=True, highlight=False)
    silent = options.quiet or not sys.stderr.isatty()
    with process_pool(options.jobs) as executor:
        study = run(scenario, options.seed, executor, None if silent else errors.print)
    result = write_report(folder, study)
    if options.json:
        print(as_json(result), end="")
    elif not options.quiet:
        from obsdesign.report.terminal import summary_of

        Console(highlight=False, soft_wrap=True).print(summary_of(result), f"\nWritten to {folder}/: open report.html")
    return _expectations_exit(result)


def _select(options: argparse.Namespace) -> ExitCode:
    from obsdesign.scenario.loading import load_scenario_of_path

    scenario = load_scenario_of_path(options.scenario)
    if options.out is not None:
        _require_writable(options.out)

    from rich.console import Console

    from obsdesign.exchange.trajectory_csv import read_trajectory_csv
    from obsdesign.report.folder import as_json, write_report
    from obsdesign.report.to_document import document_of
    from obsdesign.study.runner import select_along

    file = options.path / "trajectory.csv" if options.path.is_dir() else options.path
    path_file = read_trajectory_csv(scenario.system, file)
    # what is known of a scenario's own results is not asked of another path
    study = select_along(scenario.model_copy(update={"expected": ()}), path_file.path, options.seed, path_file.notes)
    result = document_of(study) if options.out is None else write_report(options.out, study)
    if options.json:
        print(as_json(result), end="")
    elif not options.quiet:
        from obsdesign.report.terminal import schedule_of

        written = () if options.out is None else (f"\nWritten to {options.out}/: open report.html",)
        console = Console(highlight=False, soft_wrap=True)
        console.print(schedule_of(result))
        for line in (*path_file.notes, *written):
            console.print(line, markup=False)
    return ExitCode.DONE


def _check(options: argparse.Namespace) -> ExitCode:
    from obsdesign.scenario.loading import load_scenario

    scenario = load_scenario(options.scenario)
    if options.json:
        print(json.dumps({"file": str(options.scenario), "title": scenario.title, "ok": True}))
    elif not options.quiet:
        sensors = ", ".join(scenario.sensor_names)
        what = f"{scenario.title}: {len(scenario.state_names)} states, sensors {sensors}, {scenario.segments} segments"
        print(f"{options.scenario}: fine ({what})")
    return ExitCode.DONE


def _schema(options: argparse.Namespace) -> ExitCode:
    if options.document == "scenario":
        from obsdesign.scenario.schema import Scenario as Document
    else:
        from obsdesign.report.document import Result as Document
    print(json.dumps(Document.model_json_schema(), indent=1))
    return ExitCode.DONE


def _expectations_exit(result: Result) -> ExitCode:
    missed = [expectation for expectation in result.expected if not expectation.met]
    for expectation in missed:
        outcome = "no such key in result.json" if expectation.found is None else f"found {expectation.found}"
        print(
            f"expected {expectation.key} = {expectation.value} within {expectation.tolerance} ({expectation.source}): {outcome}",
            file=sys.stderr,
        )
    return ExitCode.NO if missed else ExitCode.DONE


def _print_error(options: argparse.Namespace, message: str, code: ExitCode) -> None:
    print(f"obsdesign: {message}", file=sys.stderr)
    if options.json:
        print(json.dumps({"error": message, "exit_code": int(code)}))


def _require_writable(folder: Path) -> None:
    """Refuse an unusable folder before a minute of work, without making it."""
    existing = next(folder_or_parent for folder_or_parent in (folder.absolute(), *folder.absolute().parents) if folder_or_parent.exists())
    if not existing.is_dir() or not os.access(existing, os.W_OK):
        raise InputError(f"--out {folder}: {existing} is no folder that can be written to")
