"""CPU seconds of designs, beside those of an earlier build, OBSDESIGN_BEFORE=folder of its sources, in processes that take turns."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from cProfile import Profile
from dataclasses import fields, replace
from functools import cache
from pathlib import Path
from pstats import Stats
from subprocess import run
from time import process_time
from typing import Any

import numpy as np

import obsdesign as od
from benchmarks.design import random_starts
from benchmarks.in_flight import circuit
from benchmarks.missions import beacon_mission, mission, plateau
from benchmarks.optimisers import _climbed
from benchmarks.tables import machine, table, write
from obsdesign.design.initial_guesses import start_inputs
from obsdesign.design.local_solve import LocalSolve, families_of, solve_locally
from obsdesign.design.upper_bound import cap_of

BEFORE = "OBSDESIGN_BEFORE"
ROUNDS, STEPS, STARTS = 2, 150, 10
PARTS = {
    ("sqp/conic_qp.py", "minimise"): "convex programs",
    ("nlp/program.py", "derivatives"): "first derivatives along the path",
    ("nlp/program.py", "lagrangian_hessian"): "second derivatives",
    ("nlp/program.py", "evaluate"): "values",
    ("sqp/active_set_step.py", "newton_step"): "linear equations of what is active",
    ("sqp/trust_region_sqp.py", "_take_step"): "all iterations",
}


def main() -> None:
    """Write benchmarks/design_speed.md."""
    parts = [
        "# How long designs take, beside an earlier build",
        "",
        machine(),
        "CPU seconds of one core, all warm, the least of two processes that take turns with those of the other build.",
        "Each start below is solved alone; a design abandons starts that creep below others.",
        "",
        table(("", "before", "now", "now / before", "bar", "value before", "value now"), [_row(*case) for case in BARS]),
        "",
        "## One start",
        "",
        "The mission of 40 pieces, starts one by one, scipy's SLSQP with the same gradients from the same start. Bar: no more CPU, and no",
        "lower value, in 9 of 10. SLSQP asks for limits at the nodes to 1e-5; here paths keep them between the nodes, too, to 1e-6.",
        "",
        table(
            ("start", "s", "value", "SLSQP s", "SLSQP value"),
            [(i, *map("{:.6g}".format, row)) for i, row in enumerate(_child("one start", "")["rows"])],
        ),
        "",
        "## Where the time of the mission goes",
        "",
        "By the profiler, which counts calls for more than they are. The rest of the iterations is NumPy on arrays of 5 to 40 numbers.",
        "Where a bar is missed, this is why: no part is a half any more, the compiled method takes 0.2 ms of the 4 ms of an iteration,",
        "and calls of NumPy on small arrays most of them; what would help is fewer iterations, or several starts as one array.",
        "",
        table(("", "calls", "share"), _profile()),
    ]
    write("design_speed", "\n".join(parts))


def _row(name: str, title: str, key: str, unit: float, bar: str) -> tuple[object, ...]:
    """Run a case in turn with the earlier build; return its row."""
    folder = os.environ.get(BEFORE, "")
    rounds: list[tuple[dict[str, Any], ...]] = [
        tuple(_child(name, where, turn) for where in ((folder, "") if folder else ("",)))
        for turn in range(1 if name in ("study", "many") else ROUNDS)
    ]
    now = min((each[-1] for each in rounds), key=lambda found: found[key])
    before = min((each[0] for each in rounds), key=lambda found: found[key]) if folder else {key: np.nan, "value": np.nan}
    values = ("" if np.isnan(each["value"]) else f"{each['value']:.7g}" for each in (before, now))
    return title, unit * before[key], unit * now[key], f"{now[key] / before[key]:.2f}", bar, *values


@cache
def _child(name: str, folder: str, turn: int = 0) -> dict[str, Any]:  # each turn anew
    """Run a case in a process of its own, with the sources of a folder, "" = these."""
    root = folder or str(Path(__file__).parents[1])
    environment = os.environ | {"PYTHONPATH": root}
    done = run([sys.executable, __file__, name], capture_output=True, text=True, check=True, env=environment, cwd=root)
    return json.loads(done.stdout.splitlines()[-1])


def _profile() -> list[tuple[str, int, str]]:
    problem, profile = mission(), Profile()
    od.design_trajectory(problem, starts=8)
    profile.runcall(od.design_trajectory, problem, starts=8)
    stats, rows = Stats(profile), []
    for (file, function), what in PARTS.items():
        hits = [value for key, value in stats.stats.items() if key[0].endswith(f"design/{file}") and key[2] == function]  # pyright: ignore
        rows.append((what, sum(hit[0] for hit in hits), f"{sum(hit[3] for hit in hits) / stats.total_tt:.0%}"))  # pyright: ignore
    return rows


# ---------------------------------------------------------------- the cases


def _timed(call: Callable[[], Any]) -> tuple[float, Any]:
    began = process_time()
    found = call()
    return process_time() - began, found


def _design(problem: od.DesignProblem, starts: int) -> dict[str, Any]:
    od.design_trajectory(problem, starts=1)
    seconds, found = _timed(lambda: od.design_trajectory(problem, starts=starts))
    return {"seconds": seconds, "value": found.value}


def _saturated() -> dict[str, Any]:
    """Median of 20 random starts."""
    problem = plateau()
    inputs = [np.array(problem.path.inputs(p, problem.grid)).reshape(problem.steps, -1) for p in random_starts(problem, 21)]  # pyright: ignore
    tasks = [_task(problem, u) for u in inputs]
    solve_locally(tasks[0])
    found = [_timed(lambda task=task: solve_locally(task)) for task in tasks[1:]]
    return {"seconds": float(np.median([each[0] for each in found])), "value": float(np.median([each[1].objective for each in found]))}


def _task(problem: od.DesignProblem, u: np.ndarray) -> LocalSolve:
    """A climb as `design_trajectory` has it: it ends at the cap, which earlier builds did not know of."""
    task, cap = LocalSolve(problem, "random", u, (problem.path,), True), cap_of(problem)
    has_ceiling = cap is not None and "ceiling" in {field.name for field in fields(LocalSolve)}
    return replace(task, ceiling=cap.value) if has_ceiling else task


def _in_flight() -> dict[str, Any]:
    """Steps of a planner that goes on from its last plan, without noise."""
    problem = replace(circuit(), start=(0.0, 0.0, 0.0, 0.1, -0.05))
    planner = od.Planner(problem, every=problem.step)
    plan, seconds, values = planner.step(problem.x0), [], []
    for _ in range(STEPS):
        x, previous = plan.trajectory.x[1], plan
        taken, plan = _timed(lambda x=x, previous=previous: planner.step(x, previous))
        seconds.append(taken)
        values.append(plan.value)
    return {"seconds": float(np.median(seconds)), "late": float(np.percentile(seconds, 99)), "value": float(np.mean(values))}


def _one_start() -> dict[str, Any]:
    """Several starts, here and by SLSQP."""
    problem, rows = mission(), []
    inputs = [u for _, (_, u) in zip(range(STARTS), start_inputs(problem, 0), strict=False)]
    solve_locally(LocalSolve(problem, "", inputs[0], families_of(problem.path), True))
    for u in inputs:
        seconds, ours = _timed(lambda u=u: solve_locally(LocalSolve(problem, "", u, families_of(problem.path), True)))
        peer_seconds, peer = _timed(lambda u=u: _climbed(problem, "SLSQP", True, problem.path.fit(u, problem.grid)))
        rows.append([seconds, ours.objective if ours.status.has_answer else np.nan, peer_seconds, peer.value])
    return {"rows": rows}


def _study() -> dict[str, Any]:
    """The whole study of the Aerosonde."""
    return {"seconds": _timed(lambda: od.run(od.load_scenario("scenarios/aerosonde_wind.toml")))[0], "value": np.nan}


CASES: dict[str, Callable[[], dict[str, Any]]] = {
    "mission": lambda: _design(mission(), 8),
    "four": lambda: _design(mission(4), 8),
    "beacon": lambda: _design(beacon_mission(), 8),
    "many": lambda: _design(mission(200, 0.05), 4),
    "saturated": _saturated,
    "in flight": _in_flight,
    "one start": _one_start,
    "study": _study,
}
BARS = (
    ("mission", "40-piece mission, 8 starts, s", "seconds", 1.0, "1/5"),
    ("four", "the same of 4 pieces, s", "seconds", 1.0, ""),
    ("beacon", "beacon mission, 8 starts, s", "seconds", 1.0, "1/4"),
    ("many", "200 pieces, 4 starts, s", "seconds", 1.0, "1/4"),
    ("saturated", "20 pieces saturated, median ms", "seconds", 1e3, "15 ms"),
    ("in flight", "Planner.step, 40 pieces, median ms", "seconds", 1e3, "8 ms"),
    ("in flight", "Planner.step, 99th percentile ms", "late", 1e3, "15 ms"),
    ("study", "Aerosonde study, whole, s", "seconds", 1.0, "1/2"),
)

if __name__ == "__main__":
    sys.stdout.write(json.dumps(CASES[sys.argv[1]]()) + "\n")
