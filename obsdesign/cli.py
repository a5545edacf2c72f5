"""The command line: verbs, exit codes, and the only place that prints."""

from __future__ import annotations

import _thread
import argparse
import atexit
import json
import os
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from obsdesign import __version__
from obsdesign.errors import InputError, ObsdesignError, ScenarioError, SolveError, UnobservableError

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from obsdesign.report.document import Result

_EXAMPLES = """examples:
  obsdesign check scenarios/aerosonde_wind.toml
  obsdesign run scenarios/aerosonde_wind.toml --out reports/aerosonde_wind
  obsdesign select path.csv --scenario scenarios/aerosonde_wind.toml
  obsdesign schema result > result.schema.json

exit codes: 0 done, 1 the study says no (unobservable, infeasible, an expected value missed),
            2 bad input, 3 a solver or obsdesign itself failed, 130 interrupted"""


class Exit(IntEnum):
    """What the exit code says."""

    DONE = 0
    NO = 1
    BAD_INPUT = 2
    SOLVER_FAILED = 3
    INTERRUPTED = 130


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run one verb and exit."""
    # pydantic would read the metadata of every installed package in search of plugins: a tenth of the start of `check`
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    options = _parser().parse_args(arguments)
    stop = _Stop(options)
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # a command in the background ignores Ctrl-C
        signal.signal(signal.SIGINT, stop)
    try:
        code = options.verb(options)
    except (Exception, KeyboardInterrupt) as error:  # noqa: BLE001  # whatever it is, it has an exit code
        if stop.pressed or isinstance(error, KeyboardInterrupt):
            code = stop.tell()
        elif isinstance(error, ObsdesignError):
            code = _exit_of(error)
            _complain(options, str(error), code)
        else:  # a fault of ours: never exit code 1, which is an answer of the study
            code = Exit.SOLVER_FAILED
            traceback.print_exc()
            _complain(options, f"internal error, please report it: {type(error).__name__}: {error}", code)
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
    run.add_argument("--seed", type=_count(0), help="overrides the scenario's seed")
    run.add_argument(
        "--jobs", type=_count(1), default=os.cpu_count() or 1, help="processes (default: %(default)s); the answer does not depend on it"
    )
    run.add_argument("--quiet", action="store_true", help="no progress, no summary")
    select = _verb(verbs, "select", _select, "choose the sensors along a path from a file, or along that of an earlier run")
    select.add_argument("path", type=Path, help="CSV file with t, the states and perhaps the inputs, or a folder with a trajectory.csv")
    select.add_argument("--scenario", type=Path, required=True, help="TOML file: vehicle, sensors, prior, time.segment, selection")
    select.add_argument("--out", type=Path, help="folder for report.html, result.json, trajectory.csv, schedule.csv (default: none)")
    select.add_argument("--seed", type=_count(0), help="overrides the scenario's seed")
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


def _verb(verbs: argparse._SubParsersAction, name: str, action: Callable[[argparse.Namespace], Exit], what: str) -> argparse.ArgumentParser:
    parser = verbs.add_parser(name, help=what, description=what)
    parser.set_defaults(verb=action)
    return parser


def _count(least: int) -> Callable[[str], int]:
    def whole_number(text: str) -> int:
        if not text.isdecimal() or int(text) < least:
            raise argparse.ArgumentTypeError(f"{text!r} must be a whole number of at least {least}")
        return int(text)

    return whole_number


def _run(options: argparse.Namespace) -> Exit:
    from obsdesign.scenario.loading import load_scenario

    scenario = load_scenario(options.scenario)
    folder = options.out or Path("reports") / options.scenario.stem
    _require_writable(folder)

    from rich.console import Console

    from obsdesign.report.folder import as_json, write_report
    from obsdesign.study.running import run

    errors = Console(stderr=True, highlight=False)
    silent = options.quiet or not sys.stderr.isatty()
    with _workers(options.jobs) as executor:
        study = run(scenario, options.seed, executor, None if silent else errors.print)
    result = write_report(folder, study)
    if options.json:
        print(as_json(result), end="")
    elif not options.quiet:
        from obsdesign.report.summary import summary_of

        Console(highlight=False, soft_wrap=True).print(summary_of(result), f"\nWritten to {folder}/: open report.html")
    return _judge(result)


def _select(options: argparse.Namespace) -> Exit:
    from obsdesign.scenario.loading import load_scenario

    scenario = load_scenario(options.scenario)
    if options.out is not None:
        _require_writable(options.out)

    from rich.console import Console

    from obsdesign.exchange.trajectory_csv import read_trajectory_csv
    from obsdesign.report.folder import as_json, write_report
    from obsdesign.report.result import result_of
    from obsdesign.study.running import select_along

    file = options.path / "trajectory.csv" if options.path.is_dir() else options.path
    found = read_trajectory_csv(scenario.system, file)
    # what is known of a scenario's own results is not asked of another path
    study = select_along(scenario.model_copy(update={"expected": ()}), found.path, options.seed, found.notes)
    result = result_of(study) if options.out is None else write_report(options.out, study)
    if options.json:
        print(as_json(result), end="")
    elif not options.quiet:
        from obsdesign.report.summary import schedule_of

        written = () if options.out is None else (f"\nWritten to {options.out}/: open report.html",)
        Console(highlight=False, soft_wrap=True).print(schedule_of(result), *found.notes, *written, sep="\n", markup=False)
    return Exit.DONE


def _check(options: argparse.Namespace) -> Exit:
    from obsdesign.scenario.loading import load_scenario

    scenario = load_scenario(options.scenario)
    if options.json:
        print(json.dumps({"file": str(options.scenario), "title": scenario.title, "ok": True}))
    elif not options.quiet:
        sensors = ", ".join(scenario.sensor_names)
        what = f"{scenario.title}: {len(scenario.state_names)} states, sensors {sensors}, {scenario.segments} segments"
        print(f"{options.scenario}: fine ({what})")
    return Exit.DONE


def _schema(options: argparse.Namespace) -> Exit:
    if options.document == "scenario":
        from obsdesign.scenario.schema import Scenario as Document
    else:
        from obsdesign.report.document import Result as Document
    print(json.dumps(Document.model_json_schema(), indent=1))
    return Exit.DONE


def _judge(result: Result) -> Exit:
    missed = [each for each in result.expected if not each.met]
    for each in missed:
        found = "no such key in result.json" if each.found is None else f"found {each.found}"
        print(f"expected {each.key} = {each.value} within {each.tolerance} ({each.source}): {found}", file=sys.stderr)
    return Exit.NO if missed else Exit.DONE


def _exit_of(error: ObsdesignError) -> Exit:
    if isinstance(error, (ScenarioError, InputError)):
        return Exit.BAD_INPUT
    if isinstance(error, UnobservableError) or (isinstance(error, SolveError) and error.status.is_infeasible):
        return Exit.NO
    return Exit.SOLVER_FAILED


def _complain(options: argparse.Namespace, message: str, code: Exit) -> None:
    print(f"obsdesign: {message}", file=sys.stderr)
    if options.json:
        print(json.dumps({"error": message, "exit_code": int(code)}))


def _require_writable(folder: Path) -> None:
    """Refuse an unusable folder before a minute of work, without making it."""
    existing = next(place for place in (folder.absolute(), *folder.absolute().parents) if place.exists())
    if not existing.is_dir() or not os.access(existing, os.W_OK):
        raise InputError(f"--out {folder}: {existing} is no folder that can be written to")


@contextmanager
def _workers(jobs: int) -> Iterator[Executor | None]:
    """Yield a pool of processes, or None where one process is enough; workers end with the command.

    What follows writes files: from then on Ctrl-C is one KeyboardInterrupt, and nothing ends by force.
    """
    with _pool(jobs) as pool:
        yield pool
        stop = signal.getsignal(signal.SIGINT)
        if isinstance(stop, _Stop):
            signal.signal(signal.SIGINT, signal.default_int_handler)
            if stop.pressed:
                raise KeyboardInterrupt


@contextmanager
def _pool(jobs: int) -> Iterator[Executor | None]:
    if jobs == 1:
        yield None
        return
    import multiprocessing
    from concurrent.futures import ProcessPoolExecutor

    ignore = (signal.SIGINT, signal.SIG_IGN)
    pool = ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn"), initializer=signal.signal, initargs=ignore)
    try:
        with _deaf():
            while len(multiprocessing.active_children()) < jobs:  # a task starts a worker if none is idle
                pool.submit(int)
        yield pool
    except BaseException:
        # a pool that finds its workers gone fails at tasks that were cancelled, unless it was shut down before and is still there
        pool.shutdown(wait=False, cancel_futures=True)
        atexit.register(pool.shutdown)
        _end_workers()
        raise
    pool.shutdown(wait=False)


def _end_workers() -> None:
    import multiprocessing

    for worker in multiprocessing.active_children():
        worker.kill()


@contextmanager
def _deaf() -> Iterator[None]:
    """Put Ctrl-C off, and start processes that never hear it: this one alone answers."""
    pressed = []
    answer = signal.signal(signal.SIGINT, lambda *_: pressed.append(True))
    blocked = None if sys.platform == "win32" else signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        if sys.platform != "win32":
            signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
        signal.signal(signal.SIGINT, answer)
    if pressed and callable(answer):
        answer(signal.SIGINT, None)


_PAUSE, _TRIES, _PATIENCE = 0.5, 3, 3.0  # seconds from one KeyboardInterrupt to the next; how many; seconds to leave in


class _Stop:
    """The answer to Ctrl-C: KeyboardInterrupt until one has arrived, after some of them the end by force.

    One is not enough: callbacks of the garbage collector swallow it, some solvers take it for the end of one try, and modules that
    are being loaded make another error of it.
    """

    def __init__(self, options: argparse.Namespace) -> None:
        self._options = options
        self._thread = _thread.get_ident()
        self._told = False
        self.pressed = 0

    def __call__(self, *_: object) -> None:
        self.pressed += 1
        if self._told or self.pressed > _TRIES:
            self._end()
        if self.pressed == 1:
            sys.unraisablehook = _unless_interrupted
            _thread.start_new_thread(self._again, ())  # not by threading: its locks may be held where this comes in
        raise KeyboardInterrupt

    def tell(self) -> Exit:
        """Say, once, that it has arrived."""
        told, self._told = self._told, True
        if not told:
            _complain(self._options, "interrupted: nothing was written", Exit.INTERRUPTED)
        return Exit.INTERRUPTED

    def _again(self) -> None:
        time.sleep(_PAUSE)
        while not self._told:
            # to the main thread itself: while that waits, a signal to another one does not wake it
            _thread.interrupt_main() if sys.platform == "win32" else signal.pthread_kill(self._thread, signal.SIGINT)
            time.sleep(_PAUSE)
        time.sleep(_PATIENCE)  # a pool may wait for ever: for the rest of a killed worker's answer, or a lock that was held just then
        self._end()

    def _end(self) -> NoReturn:
        with suppress(Exception):
            self.tell()
            sys.stdout.flush()
            _end_workers()
        os._exit(Exit.INTERRUPTED)


def _unless_interrupted(unraisable: sys.UnraisableHookArgs) -> None:
    if unraisable.exc_type is not KeyboardInterrupt:
        sys.__unraisablehook__(unraisable)
