"""`obsdesign select`: the sensors along a path that is there."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

from obsdesign.cli.folders import path_file, require_writable
from obsdesign.cli.verb import QUIET, SEED, Argument, Outcome, Verb, out_argument
from obsdesign.errors import ExitCode


def select(options: Namespace) -> Outcome:
    """Choose the sensors along a path from a file, or along that of an earlier run."""
    from obsdesign.scenario.loading import load_scenario_of_path

    scenario = load_scenario_of_path(options.scenario)
    if options.out is not None:
        require_writable(options.out)

    from obsdesign.exchange.trajectory_csv import read_trajectory_csv
    from obsdesign.report.folder import write_report
    from obsdesign.report.terminal import schedule_of
    from obsdesign.report.to_document import document_of
    from obsdesign.study.runner import select_along

    given = read_trajectory_csv(scenario.system, path_file(options.path))
    # what is known of a scenario's own results is not asked of another path
    study = select_along(scenario.model_copy(update={"expected": ()}), given.path, options.seed, given.notes)
    result = document_of(study) if options.out is None else write_report(options.out, study)
    written = () if options.out is None else (f"\nWritten to {options.out}/: open report.html",)
    return Outcome(result.model_dump(mode="json"), (schedule_of(result), *given.notes, *written))


VERB = Verb(
    name="select",
    what="choose the sensors along a path from a file, or along that of an earlier run",
    action=select,
    example="select path.csv --scenario my.toml",
    arguments=(
        Argument("path", "CSV file with t, the states and perhaps the inputs, or a folder with a trajectory.csv", Path, completes="files"),
        Argument(
            "--scenario",
            "TOML file: vehicle, sensors, prior, time, selection; no design",
            Path,
            completes="files",
            is_required=True,
            variable="FILE",
        ),
        out_argument("folder for report.html, result.json, trajectory.csv, schedule.csv (default: none)"),
        SEED,
        QUIET,
    ),
    exits=(ExitCode.DONE, ExitCode.NO, ExitCode.SOLVER_FAILED),
)
