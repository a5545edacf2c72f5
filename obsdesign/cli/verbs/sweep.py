"""`obsdesign sweep`: many runs of one scenario."""

from __future__ import annotations

import re
from argparse import ArgumentTypeError, Namespace
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from obsdesign.cli.folders import require_writable, scenario_file
from obsdesign.cli.progress import progress_teller
from obsdesign.cli.verb import JOBS, QUIET, SCENARIO, Argument, Outcome, Verb, out_argument
from obsdesign.errors import ExitCode, InputError
from obsdesign.interrupts import process_pool

if TYPE_CHECKING:
    from concurrent.futures import Executor


def sweep_scenario(options: Namespace) -> Outcome:
    """Run a scenario with every combination of values of some of its keys."""
    from obsdesign.scenario.loading import load_scenario

    file = scenario_file(options.scenario)
    scenario = load_scenario(file)
    folder = options.out or Path("reports") / f"{file.stem}_sweep"
    require_writable(folder)
    vary = dict(options.vary or ()) or (dict(scenario.sweep.vary) if scenario.sweep is not None else {})
    if not vary:
        raise InputError(f"{file}: nothing is varied: give --vary KEY=VALUES, or a table [sweep.vary] in the scenario")

    from obsdesign.sweeps.execution import sweep
    from obsdesign.sweeps.page import FILES, write_sweep

    with _executor(options) as executor, progress_teller(options.quiet) as progress:
        done = sweep(scenario, vary, executor=executor, out=folder, progress=progress)
    write_sweep(folder, scenario, done)
    document = {"folder": str(folder), "files": list(FILES), "keys": list(done.keys), "runs": [_run_document(run) for run in done.runs]}
    failed = tuple(f"run {run.name[:8]} failed: {run.error}" for run in done.failures)
    return Outcome(document, (str(done), f"\nWritten to {folder}/: open {FILES[0]}"), failed, ExitCode.NO if failed else ExitCode.DONE)


def _run_document(run: Any) -> dict[str, Any]:  # noqa: ANN401  # a SweepRun, whose module loads the package
    return {"run": run.name, "varied": dict(run.varied), "numbers": dict(run.numbers), "error": run.error or None}


@contextmanager
def _executor(options: Namespace) -> Iterator[Executor | None]:
    """Yield processes here, or workers of a dask cluster."""
    if options.scheduler is None:
        with process_pool(options.jobs) as pool:
            yield pool
        return
    try:
        from distributed import Client
    except ImportError:
        raise InputError("--scheduler needs dask.distributed, which is not installed: pip install 'obsdesign[dask]'") from None
    try:
        client = Client(options.scheduler, timeout="10s")
    except (OSError, ValueError) as error:
        raise InputError(f"--scheduler {options.scheduler}: no scheduler of dask answers there: {error}") from None
    with client:
        yield client.get_executor(pure=False)


def _vary(text: str) -> tuple[str, list[Any]]:
    """Return key and values of KEY=VALUES, or raise ArgumentTypeError."""
    key, sign, values = text.partition("=")
    whole = re.fullmatch(r"(\d+):(\d+)", values.strip())
    if not sign or not key.strip() or not values.strip():
        raise ArgumentTypeError(f"{text!r} must be KEY=VALUES, such as sensors.gps.sigma=1,2,4 or seed=0:100")
    if whole:
        return key.strip(), list(range(int(whole[1]), int(whole[2])))
    return key.strip(), _values(values)


def _values(text: str) -> list[Any]:
    """Return values as TOML writes them, parted by commas; a word that is none is a text."""
    import tomllib

    try:
        return tomllib.loads(f"values = [{text}]")["values"]
    except tomllib.TOMLDecodeError:
        words = text.split(",")
        return [text.strip()] if len(words) == 1 else [value for word in words for value in _values(word)]


VARY = Argument(
    "--vary",
    'values of one key, such as sensors.gps.sigma=1,2,4 or seed=0:100 or \'sensors=["gps"],["gps","compass"]\'; may be given again '
    "for another key (default: [sweep.vary] of the scenario)",
    _vary,
    variable="KEY=VALUES",
    may_repeat=True,
)
SCHEDULER = Argument("--scheduler", "address of a dask scheduler whose workers do the runs, instead of --jobs", variable="ADDRESS")
VERB = Verb(
    name="sweep",
    what="run a scenario with every combination of values of some keys; started again, it goes on where it ended",
    action=sweep_scenario,
    example="sweep my.toml --vary sensors.gps.sigma=1,2,4 --vary seed=0:10",
    arguments=(
        SCENARIO,
        VARY,
        out_argument("folder for sweep.html, sweep.csv and a file for each run (default: reports/NAME_sweep)"),
        JOBS,
        SCHEDULER,
        QUIET,
    ),
    exits=(ExitCode.DONE, ExitCode.NO),
)
