"""`obsdesign analyse`: what the sensors of a scenario can see, and what stays hidden."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from obsdesign.cli.folders import is_log, path_file, require_writable, scenario_file
from obsdesign.cli.progress import progress_teller
from obsdesign.cli.verb import LANDMARKS, QUIET, SCENARIO, SEED, Argument, Outcome, Verb, out_argument
from obsdesign.cli.verbs.replay import TOPICS, setup_of
from obsdesign.errors import ExitCode

if TYPE_CHECKING:
    from obsdesign.scenario.schema import Scenario
    from obsdesign.study.analysis_along import AlongPath


def analyse(options: Namespace) -> Outcome:
    """Say what every suite of sensors sees, under every class of disturbances, in every manoeuvre."""
    from obsdesign.scenario.loading import load_scenario_to_analyse
    from obsdesign.scenario.log_defaults import read_landmarks

    file = scenario_file(options.scenario)
    scenario = load_scenario_to_analyse(file, None if options.landmarks is None else read_landmarks(options.landmarks))
    folder = options.out or Path("reports") / file.stem
    require_writable(folder)

    from obsdesign.report.analysis_document import analysis_document
    from obsdesign.report.analysis_folder import FILES, analysis_summary, write_analysis
    from obsdesign.report.expectations import unmet_lines
    from obsdesign.study.analysis_study import analyse_scenario

    with progress_teller(options.quiet) as progress:
        study = analyse_scenario(scenario, options.seed, progress)
    study = replace(study, along=_along(options, scenario))
    document = analysis_document(study)
    write_analysis(folder, study, document)
    missed = unmet_lines(document.expected, FILES[1])
    sees_nothing_whole = not document.expected and not any(analysis.verdict.observable for analysis in study.of_all_sensors)
    moved = () if study.along is None else (str(study.along.motion),)
    shown = (analysis_summary(study), *moved, f"\nWritten to {folder}/: open {FILES[0]}")
    code = ExitCode.NO if missed or sees_nothing_whole else ExitCode.DONE
    return Outcome(document.model_dump(mode="json"), shown, missed, code)


def _along(options: Namespace, scenario: Scenario) -> AlongPath | None:
    """Return what the motion hides along the path, the run or the log that is given."""
    if options.along is None:
        return None
    from obsdesign.study.analysis_along import along_log, along_path

    if is_log(options.along):
        return along_log(setup_of(options.along, Path(scenario.file), options))
    from obsdesign.exchange.trajectory_csv import read_trajectory_csv

    given = read_trajectory_csv(scenario.system, path_file(options.along))
    return along_path(scenario.system, given.path, options.along.name, given.notes)


VERB = Verb(
    name="analyse",
    what="say what every suite of sensors can see, under every class of disturbances, and what stays hidden, with a proof",
    action=analyse,
    example="analyse my.toml",
    arguments=(
        SCENARIO,
        Argument(
            "--along",
            "a path (CSV), a run's folder, or a log: where does its motion hide the state?",
            Path,
            completes="files",
            variable="FILE",
        ),
        LANDMARKS,
        TOPICS,
        out_argument("folder for analysis.html and analysis.json (default: reports/NAME)"),
        SEED,
        QUIET,
    ),
    exits=(ExitCode.DONE, ExitCode.NO),
)
