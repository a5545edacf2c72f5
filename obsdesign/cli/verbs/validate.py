"""`obsdesign validate`: what a filter makes of a path and a schedule, over many simulated runs."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from obsdesign.cli.folders import path_file, scenario_file
from obsdesign.cli.progress import progress_teller
from obsdesign.cli.verb import JOBS, QUIET, SCENARIO, SEED, Argument, Outcome, Verb
from obsdesign.errors import ExitCode
from obsdesign.interrupts import process_pool

if TYPE_CHECKING:
    from obsdesign.estimation.validation import Validation
    from obsdesign.scenario.schema import Scenario


def validate(options: Namespace) -> Outcome:
    """Run the filter along a path: one from a file, the first that the scenario gives, or the one that is designed first."""
    from obsdesign.scenario.loading import load_scenario, load_scenario_of_path

    file = scenario_file(options.scenario)
    scenario = (load_scenario if options.along is None else load_scenario_of_path)(file)

    from obsdesign.exchange.schedule_csv import read_schedule_csv
    from obsdesign.exchange.trajectory_csv import read_trajectory_csv
    from obsdesign.report.paths_to_document import validation_part
    from obsdesign.study.single_answers import path_to_validate, validate_scenario

    schedule_file = _schedule_file(options.along, options.schedule)
    segments = None if schedule_file is None else read_schedule_csv(schedule_file, scenario.sensor_names).chosen
    seed = scenario.seed if options.seed is None else options.seed
    with process_pool(options.jobs) as executor, progress_teller(options.quiet) as progress:
        if options.along is None:
            name, path = path_to_validate(scenario, seed, executor, progress)
        else:
            along = path_file(options.along)
            name, path = str(along), read_trajectory_csv(scenario.system, along).path
        validation = validate_scenario(scenario, path, segments, seed, executor, progress)
    sensors = "all sensors on" if schedule_file is None else f"schedule {schedule_file}"
    document = {"scenario": str(file), "seed": seed, "path": name, "schedule": str(schedule_file) if schedule_file else None}
    document |= validation_part(scenario.state_names, validation).model_dump(mode="json")
    return Outcome(document, (f"path: {name}; {sensors}", *_lines(scenario, validation)))


def _schedule_file(along: Path | None, schedule: Path | None) -> Path | None:
    """The schedule that is named, or the one in the folder of the path."""
    if schedule is None and along is not None and along.is_dir() and (along / "schedule.csv").exists():
        return along / "schedule.csv"
    return schedule


def _lines(scenario: Scenario, validation: Validation) -> tuple[str, ...]:
    """What a person reads: the error of each state at the end and its bound, and whether the filter tells the truth."""
    low, high = validation.nees_interval
    rows = zip(scenario.states, validation.rmse[-1].tolist(), validation.bound[-1].tolist(), strict=True)
    band = f"NEES within {low:.3g} to {high:.3g} at {validation.in_band:.0%} of the instants"
    return (
        f"filter over {validation.runs} runs: {validation.verdict} ({band})",
        *(f"  {state.name:12} RMSE at the end {rmse:.4g} {state.unit}, no filter below {bound:.4g}" for state, rmse, bound in rows),
    )


VERB = Verb(
    name="validate",
    what="run a filter along a path many times: its errors, their bounds, and whether it tells the truth about them",
    action=validate,
    example="validate my.toml --along reports/my",
    arguments=(
        SCENARIO,
        Argument(
            "--along", "CSV file of a path, or a run's folder (default: the scenario's own path)", Path, completes="files", variable="PATH"
        ),
        Argument("--schedule", "schedule.csv (default: the folder's, or all sensors on)", Path, completes="files", variable="FILE"),
        SEED,
        JOBS,
        QUIET,
    ),
    exits=(ExitCode.DONE, ExitCode.NO, ExitCode.SOLVER_FAILED),
)
