"""`obsdesign run`: the four questions of a scenario, and a page."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from obsdesign.cli.folders import require_writable, scenario_file
from obsdesign.cli.progress import progress_teller
from obsdesign.cli.verb import JOBS, QUIET, SCENARIO, SEED, Argument, Outcome, Verb, out_argument
from obsdesign.cli.verbs.export import AUTOPILOT, EVERY, TOLERANCE, export_lines, formats_type
from obsdesign.errors import ExitCode
from obsdesign.interrupts import process_pool

if TYPE_CHECKING:
    from obsdesign.exchange.export_result import Export, ExportSettings
    from obsdesign.scenario.schema import Scenario
    from obsdesign.study.record import Study
    from obsdesign.study.thinned_path import ThinnedPath


def run_scenario(options: Namespace) -> Outcome:
    """Answer the questions of a scenario and write its report."""
    from obsdesign.scenario.loading import load_scenario

    file = scenario_file(options.scenario)
    scenario = load_scenario(file)
    folder = options.out or Path("reports") / file.stem
    require_writable(folder)
    settings = _export_settings(options, scenario)

    from obsdesign.report.expectations import unmet_lines
    from obsdesign.report.folder import write_report
    from obsdesign.report.terminal import summary_of, unkept_requirements
    from obsdesign.study.runner import run

    with process_pool(options.jobs) as executor, progress_teller(options.quiet) as progress:
        study = run(scenario, options.seed, executor, progress)
    exports = _exports(options, settings, study, folder)
    result = write_report(folder, replace(study, way_points=_way_points(exports)))
    lines = dict.fromkeys(line for done in exports for line in export_lines(done))
    shown = (summary_of(result), f"\nWritten to {folder}/: open report.html", *lines)
    missed = (*unkept_requirements(result), *unmet_lines(result.expected, "result.json"))
    return Outcome(result.model_dump(mode="json"), shown, missed, ExitCode.NO if missed else ExitCode.DONE)


def _export_settings(options: Namespace, scenario: Scenario) -> ExportSettings | None:
    """Return how the path is to be written, None where it is not; what cannot be is refused before any work is done."""
    if not options.export:
        return None
    from obsdesign.exchange.export_result import ExportSettings, require_exportable

    require_exportable(scenario, options.export)
    return ExportSettings(options.tolerance, options.every, options.autopilot)


def _exports(options: Namespace, settings: ExportSettings | None, study: Study, folder: Path) -> list[Export]:
    """Write the path in the formats that were asked for."""
    if settings is None:
        return []
    from obsdesign.exchange.export_result import export_study

    return [export_study(study, word, folder, settings) for word in options.export]


def _way_points(exports: list[Export]) -> tuple[ThinnedPath, ...]:
    """Return what each choice of way points costs, once where several formats have the same."""
    thinned = [done.thinned for done in exports if done.thinned is not None]
    return tuple({(each.points, each.tolerance, each.every, each.autopilot): each for each in thinned}.values())


EXPORT = Argument("--export", "also write the path as ..., such as plan,kml; see export", formats_type, (), variable="FORMATS")
FILES = "report.html, result.json, trajectory.csv, schedule.csv"
VERB = Verb(
    name="run",
    what="answer the four questions of a scenario and write a page to look at",
    action=run_scenario,
    example="run my.toml --out reports/my",
    arguments=(
        SCENARIO,
        out_argument(f"folder for {FILES} (default: reports/NAME)"),
        SEED,
        JOBS,
        EXPORT,
        TOLERANCE,
        EVERY,
        AUTOPILOT,
        QUIET,
    ),
    exits=(ExitCode.DONE, ExitCode.NO, ExitCode.SOLVER_FAILED),
)
