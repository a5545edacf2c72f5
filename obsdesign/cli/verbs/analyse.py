"""`obsdesign analyse`: what the sensors of a scenario can see, and what stays hidden."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

from obsdesign.cli.folders import require_writable, scenario_file
from obsdesign.cli.progress import progress_teller
from obsdesign.cli.verb import QUIET, SCENARIO, SEED, Outcome, Verb, out_argument
from obsdesign.errors import ExitCode


def analyse(options: Namespace) -> Outcome:
    """Say what every suite of sensors sees, under every class of disturbances, in every manoeuvre."""
    from obsdesign.scenario.loading import load_scenario_to_analyse

    file = scenario_file(options.scenario)
    scenario = load_scenario_to_analyse(file)
    folder = options.out or Path("reports") / file.stem
    require_writable(folder)

    from obsdesign.report.analysis_document import analysis_document
    from obsdesign.report.analysis_folder import FILES, analysis_summary, write_analysis
    from obsdesign.report.expectations import unmet_lines
    from obsdesign.study.analysis_study import analyse_scenario

    with progress_teller(options.quiet) as progress:
        study = analyse_scenario(scenario, options.seed, progress)
    document = analysis_document(study)
    write_analysis(folder, study, document)
    missed = unmet_lines(document.expected, FILES[1])
    sees_nothing_whole = not document.expected and not any(analysis.verdict.observable for analysis in study.of_all_sensors)
    shown = (analysis_summary(study), f"\nWritten to {folder}/: open {FILES[0]}")
    code = ExitCode.NO if missed or sees_nothing_whole else ExitCode.DONE
    return Outcome(document.model_dump(mode="json"), shown, missed, code)


VERB = Verb(
    name="analyse",
    what="say what every suite of sensors can see, under every class of disturbances, and what stays hidden, with a proof",
    action=analyse,
    example="analyse my.toml",
    arguments=(SCENARIO, out_argument("folder for analysis.html and analysis.json (default: reports/NAME)"), SEED, QUIET),
    exits=(ExitCode.DONE, ExitCode.NO),
)
