"""`obsdesign design`: how to move, and nothing else."""

from __future__ import annotations

from argparse import Namespace
from typing import TYPE_CHECKING, Any

from obsdesign.cli.folders import require_writable, scenario_file
from obsdesign.cli.progress import progress_teller
from obsdesign.cli.verb import JOBS, QUIET, SCENARIO, SEED, Outcome, Verb, out_argument
from obsdesign.errors import ExitCode
from obsdesign.interrupts import process_pool

if TYPE_CHECKING:
    from obsdesign.design.record import Design


def design(options: Namespace) -> Outcome:
    """Design the path of a scenario for each of its suites of sensors."""
    from obsdesign.scenario.loading import load_scenario

    file = scenario_file(options.scenario)
    scenario = load_scenario(file)
    if options.out is not None:
        require_writable(options.out)

    from obsdesign.exchange.trajectory_csv import trajectory_csv
    from obsdesign.files import write_files
    from obsdesign.study.single_answers import design_paths

    seed = scenario.seed if options.seed is None else options.seed
    with process_pool(options.jobs) as executor, progress_teller(options.quiet) as progress:
        designs = design_paths(scenario, seed, executor, progress)
    names = scenario.sensor_names
    document = {"scenario": str(file), "seed": seed, "designs": {"+".join(suite): _document(each) for suite, each in designs.items()}}
    shown = [f"for {', '.join(suite)}: {each}" for suite, each in designs.items()]
    if options.out is not None:
        paths = {"trajectory.csv" if suite == names else f"trajectory_{'_'.join(suite)}.csv": each for suite, each in designs.items()}
        written = {name: trajectory_csv(scenario.system, each.trajectory) for name, each in paths.items() if each.trajectory is not None}
        write_files(options.out, written)
        shown.append(f"\nWritten to {options.out}/: {', '.join(written)}")
    return Outcome(document, tuple(shown))


def _document(answer: Design) -> dict[str, Any]:
    """What a machine reads of a design: that of result.json, and the path."""
    from obsdesign.report.paths_to_document import design_part

    path, signals = answer.trajectory, answer.problem.system.model
    histories: dict[str, Any] = {}
    if path is not None:
        histories = {"t": path.t.tolist()}
        histories |= dict(zip(signals.state_names, path.x.T.tolist(), strict=True))
        histories |= dict(zip(signals.input_names, path.u.T.tolist(), strict=True))
    return {**design_part(answer).model_dump(mode="json"), "trajectory": histories}


VERB = Verb(
    name="design",
    what="find the path that makes a scenario's state visible, and nothing else",
    action=design,
    example="design my.toml --out paths",
    arguments=(SCENARIO, out_argument("folder for trajectory.csv (default: none)"), SEED, JOBS, QUIET),
    exits=(ExitCode.DONE, ExitCode.NO, ExitCode.SOLVER_FAILED),
)
