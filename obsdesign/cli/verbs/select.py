"""`obsdesign select`: the sensors along a path that is there, or of a recorded run."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

from obsdesign.cli.folders import is_log, path_file, require_writable
from obsdesign.cli.progress import progress_teller
from obsdesign.cli.verb import LANDMARKS, QUIET, SEED, Argument, Outcome, Verb, out_argument
from obsdesign.cli.verbs.replay import TOPICS, log_setup
from obsdesign.errors import ExitCode, InputError


def select(options: Namespace) -> Outcome:
    """Choose the sensors along a path from a file, along that of an earlier run, or of those that a log has samples of."""
    return _select_of_log(options) if is_log(options.path) else _select_along(options)


def _select_of_log(options: Namespace) -> Outcome:
    """Choose among the samples that arrived, after a calibration on the first part of the log."""
    setup = log_setup(options.path, options)

    from obsdesign.report.replay_document import schedule_part
    from obsdesign.report.replay_folder import write_log_schedule
    from obsdesign.study.log_study import schedule_study

    if options.out is not None:
        require_writable(options.out)
    with progress_teller(options.quiet) as progress:
        study = schedule_study(setup, options.seed or 0, progress)
    part = schedule_part(study)
    if options.out is not None:
        write_log_schedule(options.out, study, part)
    written = () if options.out is None else (f"\nWritten to {options.out}/: schedule.csv, schedule.json",)
    errors = "".join(f"\n  RMSE with {item.name}: {item.rmse:.3g}" for item in study.schedule_errors)
    document = {} if part is None else part.model_dump(mode="json")
    return Outcome(document, (f"{study.schedule}{errors}", *study.notes, *written))


def _select_along(options: Namespace) -> Outcome:
    if options.scenario is None:
        raise InputError("--scenario is missing: a TOML file with vehicle, sensors, prior, time and selection")
    from obsdesign.scenario.loading import load_scenario_of_path

    scenario = load_scenario_of_path(options.scenario)
    if options.out is not None:
        require_writable(options.out)

    from obsdesign.exchange.trajectory_csv import read_trajectory_csv
    from obsdesign.report.folder import write_report
    from obsdesign.report.terminal import schedule_of, unkept_requirements
    from obsdesign.report.to_document import document_of
    from obsdesign.study.runner import select_along

    given = read_trajectory_csv(scenario.system, path_file(options.path))
    # what is known of a scenario's own results is not asked of another path
    study = select_along(scenario.model_copy(update={"expected": ()}), given.path, options.seed, given.notes)
    result = document_of(study) if options.out is None else write_report(options.out, study)
    written = () if options.out is None else (f"\nWritten to {options.out}/: open report.html",)
    shown, unkept = (schedule_of(result), *given.notes, *written), unkept_requirements(result)
    return Outcome(result.model_dump(mode="json"), shown, unkept, ExitCode.NO if unkept else ExitCode.DONE)


VERB = Verb(
    name="select",
    what="choose the sensors along a path from a file, along that of an earlier run, or of those of a log",
    action=select,
    example="select path.csv --scenario my.toml",
    arguments=(
        Argument(
            "path", "CSV file with t, the states, perhaps the inputs; a folder with a trajectory.csv; or a log", Path, completes="files"
        ),
        Argument(
            "--scenario",
            "TOML file: vehicle, sensors, prior, time, selection; no design; for a log as for replay",
            Path,
            completes="files",
            variable="FILE",
        ),
        LANDMARKS,
        TOPICS,
        out_argument("folder for report.html, result.json, trajectory.csv, schedule.csv; of a log for the schedule (default: none)"),
        SEED,
        QUIET,
    ),
    exits=(ExitCode.DONE, ExitCode.NO, ExitCode.SOLVER_FAILED),
)
