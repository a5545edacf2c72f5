"""`obsdesign replay`: what a recorded run says, and a page."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from obsdesign.cli.folders import require_writable
from obsdesign.cli.progress import progress_teller
from obsdesign.cli.verb import LANDMARKS, QUIET, Argument, Outcome, Verb, out_argument, whole_number_type
from obsdesign.errors import ExitCode

if TYPE_CHECKING:
    from obsdesign.study.log_setup import LogSetup


def replay_log(options: Namespace) -> Outcome:
    """Calibrate on the first part of a log, replay all of it, and write its report."""
    setup = log_setup(options.log, options)
    folder = options.out
    if folder is not None:
        require_writable(folder)

    from obsdesign.report.replay_document import document_of_log
    from obsdesign.report.replay_terminal import replay_summary
    from obsdesign.study.log_study import study_log

    with progress_teller(options.quiet) as progress:
        study = study_log(setup, options.seed, progress)
    document = document_of_log(study)
    written = ()
    if folder is not None:
        from obsdesign.report.replay_folder import write_replay

        write_replay(folder, study, document)
        written = (f"\nWritten to {folder}/: open report.html",)
    return Outcome(document.model_dump(mode="json"), (replay_summary(document), *written))


def log_setup(file: Path, options: Namespace) -> LogSetup:
    """Return a log with what it is replayed with; raise InputError for what cannot be read or meant."""
    if options.scenario is None:
        from obsdesign.study.log_setup import file_setup

        return file_setup(file)
    return setup_of(file, options.scenario, options)


def setup_of(file: Path, scenario_file: Path, options: Namespace) -> LogSetup:
    """Return a log with the scenario that it is replayed with."""
    from obsdesign.scenario.loading import load_scenario_of_log
    from obsdesign.scenario.log_defaults import read_landmarks

    landmarks = {} if options.landmarks is None else read_landmarks(options.landmarks)
    scenario = load_scenario_of_log(scenario_file, landmarks)

    from obsdesign.study.log_setup import scenario_setup

    return scenario_setup(file, scenario, options.topics)


TOPICS = Argument("--topics", "TOML file that says which topics of the log are what", Path, completes="files", variable="FILE")
VERB = Verb(
    name="replay",
    what="say what a recorded run could see and how well, calibrate it, judge a filter on it, and write a page to look at",
    action=replay_log,
    example="replay drive.csv --scenario my.toml --out reports/drive",
    arguments=(
        Argument("log", "the recorded run: CSV, NPZ, ULog, dataflash, a ROS bag", Path, completes="files"),
        Argument(
            "--scenario",
            "TOML file: vehicle, sensors, prior; an NPZ that holds its beacons needs none",
            Path,
            completes="files",
            variable="FILE",
        ),
        LANDMARKS,
        TOPICS,
        out_argument("folder for report.html and replay.json (default: none)"),
        Argument("--seed", "of draws and random schedules", whole_number_type(0), 0, variable="NUMBER"),
        QUIET,
    ),
    exits=(ExitCode.DONE, ExitCode.SOLVER_FAILED),
)
