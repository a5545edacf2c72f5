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
from obsdesign.design.nlp.program import Program
from obsdesign.design.upper_bound import cap_of

BEFORE = "OBSDESIGN_BEFORE"
ROUNDS, STEPS, STARTS = 2, 150, 10
MANY, BEACON_STARTS, TOGETHER = 200, 40, 8
SAME = 1e-4  # share by which values differ as limits hold at the nodes or everywhere
PARTS = {
    ("sqp/conic_qp.py", "minimise"): "convex programs",
    ("sqp/active_set_step.py", "newton_step"): "linear equations of what is active",
    ("nlp/program.py", "evaluate"): "values",
    ("nlp/program.py", "derivatives"): "first derivatives along the path",
    ("nlp/program.py", "lagrangian_hessian"): "second derivatives",
    ("sqp/convexification.py", "convexify"): "eigenvalues of the Hessian",
    ("sqp/trust_region_sqp.py", "_take_step"): "all iterations",
    ("design/feasible_search.py", "search_feasible_path"): "a path within the limits, before them",
}
STAGES = {
    ("study/runner.py", "analyse"): "verdicts for every subset of the sensors",
    ("design/multistart.py", "design_trajectory"): "designs",
    ("study/candidate_paths.py", "candidates_of"): "weave and baselines",
    ("study/schedules.py", "select"): "schedules",
    ("selection/sensor_loss.py", "sensor_losses"): "of that: what is lost without each sensor",
    ("study/filter_answer.py", "answer_for_filter"): "of that: for the filter",
    ("estimation/validation.py", "validate"): "runs of the filter",
}


def main() -> None:
    """Write benchmarks/design_speed.md."""
    starts = _child("one start", "")["rows"]
    parts = [
        "# How long designs take, beside an earlier build",
        "",
        machine(),
        "CPU seconds of one core, all warm, loops as machine code (OBSDESIGN_COMPILE=1), the least of two processes that take turns with",
        "those of the other build, the last one before bounds on every path. Each start below is solved alone; a design abandons starts",
        "that creep below others.",
        "",
        table(("", "before", "now", "now / before", "bar", "value before", "value now"), [_row(*case) for case in BARS]),
        "",
        "## Is anything better missed?",
        "",
        "Bars: no random start of 200 is better than the mission's design of 8 starts by 0.2 %; the best of 40 is found with beacons.",
        "Where 8 starts miss that, they end in other optima than those random ones do; designs of 16 starts stand beside.",
        "",
        table(
            ("", "8 starts", "best of random starts", "better by", "starts within 0.2 % of it", "16 starts"),
            [_rivals(name) for name in RIVALS],
        ),
        "",
        "## One start",
        "",
        "The mission of 40 pieces, starts one by one, scipy's SLSQP with the same gradients from the same start. Bar: no more CPU, and no",
        "lower value, in 9 of 10. SLSQP asks for limits at the nodes to 1e-5; here paths keep them between the nodes, too, to 1e-6.",
        _bars_of(starts),
        "No lower value: but for 1e-4, what the limits between the nodes cost. The values are",
        "those of local optima, of which the mission has a dozen: which of them a start leads to is luck for both.",
        "",
        table(("start", "s", "value", "SLSQP s", "SLSQP value"), [(i, *map("{:.6g}".format, row)) for i, row in enumerate(starts)]),
        "",
        "## Where the time goes",
        "",
        "By the profiler, which counts calls for more than they are; shares of the whole, calls in brackets.",
        "",
        _profiles(),
        "",
        "An iteration of the mission solves two convex programs and evaluates three to four paths; each of these calls takes 0.1 to",
        "0.3 ms, most of it what Python and NumPy take to hand on arrays of 5 to 40 numbers. No part is more than a third: to be twice as",
        "fast, all of an iteration would have to be compiled. Several starts as one array would save the following of the mission, if all",
        "eight went on to the end together; what is less than 0 no longer fits the cache:",
        "",
        table(("", "one path, ms", "eight together, ms each", "calls", "s saved"), _lockstep()),
        "",
        "Convex programs, Newton's equations and the choice of steps stay one by one, and starts end after 8 to 60 iterations:",
        "lockstep is not built.",
        "",
        "The Aerosonde study:",
        "",
        table(("", "calls", "share"), _shares(lambda: od.run(od.load_scenario("scenarios/aerosonde_wind.toml")), STAGES)),
        "",
        "Designs are the smaller part of it: what is above the bar is schedules, above all what is lost without each sensor.",
    ]
    write("design_speed", "\n".join(parts))


def _bars_of(starts: list[list[float]]) -> str:
    quick, good = [row[0] <= row[2] for row in starts], [_is_no_worse(row) for row in starts]
    both = sum(a and b for a, b in zip(quick, good, strict=True))
    return f"No more CPU: {sum(quick)} of {STARTS}; no lower value: {sum(good)}; both: {both}."


def _is_no_worse(row: list[float]) -> bool:
    return row[1] >= row[3] * (1 - SAME) if np.isfinite(row[3]) else bool(np.isfinite(row[1]))


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
    environment = os.environ | {"PYTHONPATH": root, "OBSDESIGN_COMPILE": "1"}
    done = run([sys.executable, __file__, name], capture_output=True, text=True, check=True, env=environment, cwd=root)
    return json.loads(done.stdout.splitlines()[-1])


def _rivals(name: str) -> tuple[object, ...]:
    """Compare a design with random starts."""
    found = _child(name, "")
    best, values = found["best"], np.array(found["values"])
    better, near = f"{best / found['value'] - 1:.3%}", f"{np.count_nonzero(values >= 0.998 * best)} of {found['count']}"
    return RIVALS[name], f"{found['value']:.7g}", f"{best:.7g}", better, near, f"{found['of 16']:.7g}"


def _profiles() -> str:
    """Table of the shares of parts, a column for each problem."""
    columns = {
        "mission": _shares(lambda: od.design_trajectory(mission(), starts=8), PARTS),
        "beacon": _shares(lambda: od.design_trajectory(beacon_mission(), starts=8), PARTS),
        "200 pieces": _shares(lambda: od.design_trajectory(mission(200, 0.05), starts=4), PARTS),
        "saturated": _shares(lambda: [solve_locally(task) for task in _saturated_tasks()], PARTS),
    }
    rows = [(what, *(f"{column[i][2]} ({column[i][1]})" for column in columns.values())) for i, what in enumerate(PARTS.values())]
    return table(("", *columns), rows)


def _shares(call: Callable[[], object], parts: dict[tuple[str, str], str]) -> list[tuple[str, int, str]]:
    """Profile a call, once it is warm: each part with its calls and its share."""
    profile = Profile()
    call()
    profile.runcall(call)
    stats, rows = Stats(profile), []
    for (file, function), what in parts.items():
        hits = [value for key, value in stats.stats.items() if key[0].endswith(file) and key[2] == function]  # pyright: ignore
        rows.append((what, sum(hit[0] for hit in hits), f"{sum(hit[3] for hit in hits) / stats.total_tt:.0%}"))  # pyright: ignore
    return rows


def _lockstep() -> list[tuple[object, ...]]:
    """What calls along the path cost for one path, and for several at once, and how often the mission makes them."""
    from obsdesign.design.nlp.sensitivity import propagate_sensitivity  # earlier builds have none

    problem = mission()
    program, random = Program(problem), np.random.default_rng(0)
    functions = program._variation
    due = np.ones((problem.steps, functions._recursion.due.numel()))
    u = random.uniform(-0.5, 0.5, (TOGETHER, problem.steps, 1))
    x, weights = np.tile(problem.x0, (TOGETHER, 1)), random.standard_normal((TOGETHER, 1, functions.b))
    M = program._input_jacobian(program.lower)
    rows = []
    for name, (file, function) in LOOPS.items():
        spent = []
        for count in (1, TOGETHER):
            rollout, _ = functions.roll_out(x[:count], u[:count], due)
            linearisation, initial = functions.linearise(rollout), np.zeros((count, functions.c, program.q))
            calls: dict[str, Callable[[], object]] = {
                "roll_out": lambda count=count: functions.roll_out(x[:count], u[:count], due),
                "linearise": lambda rollout=rollout: functions.linearise(rollout),
                "propagate_sensitivity": lambda part=linearisation, initial=initial: propagate_sensitivity(part, initial, M),
                "second_derivatives": lambda rollout=rollout, count=count: functions.second_derivatives(rollout, weights[:count], None),
            }
            spent.append(_timed(lambda call=calls[function]: [call() for _ in range(200)])[0] / 200 / count)
        hits = _shares(lambda: od.design_trajectory(mission(), starts=8), {(file, function): name})[0][1]
        rows.append((name, 1e3 * spent[0], 1e3 * spent[1], hits, hits * (spent[0] - spent[1])))
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


def _saturated_tasks() -> list[LocalSolve]:
    problem = plateau()
    inputs = [np.array(problem.path.inputs(p, problem.grid)).reshape(problem.steps, -1) for p in random_starts(problem, 21)]  # pyright: ignore
    return [_task(problem, u) for u in inputs]


def _saturated() -> dict[str, Any]:
    """Median of 20 random starts."""
    tasks = _saturated_tasks()
    solve_locally(tasks[0])
    found = [_timed(lambda task=task: solve_locally(task)) for task in tasks[1:]]
    return {"seconds": float(np.median([each[0] for each in found])), "value": float(np.median([each[1].objective for each in found]))}


def _task(problem: od.DesignProblem, u: np.ndarray) -> LocalSolve:
    """A climb as `design_trajectory` has it: it ends at the cap, which earlier builds did not know of."""
    task, cap = LocalSolve(problem, "random", u, (problem.path,), True), cap_of(problem)
    has_ceiling = "ceiling" in {field.name for field in fields(LocalSolve)}
    return replace(task, ceiling=cap.value) if cap is not None and has_ceiling else task


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


def _from_random(problem: od.DesignProblem, count: int) -> dict[str, Any]:
    """A design of 8 starts, and the values that random ones lead to."""
    design = od.design_trajectory(problem, starts=8)
    inputs = [np.array(problem.path.inputs(p, problem.grid)).reshape(problem.steps, -1) for p in random_starts(problem, count)]  # pyright: ignore
    found = [solve_locally(LocalSolve(problem, "random", u, families_of(problem.path), True)) for u in inputs]
    values = [each.objective for each in found if each.status.has_answer]
    more = od.design_trajectory(problem, starts=16)
    return {"value": design.value, "best": max(values), "values": values, "count": count, "of 16": more.value}


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
    "random mission": lambda: _from_random(mission(), MANY),
    "random beacon": lambda: _from_random(beacon_mission(), BEACON_STARTS),
}
RIVALS = {"random mission": f"40-piece mission, {MANY} random starts", "random beacon": f"beacon mission, {BEACON_STARTS} random starts"}
LOOPS = {
    "walks": ("nlp/rollout.py", "roll_out"),
    "their slopes": ("nlp/rollout.py", "linearise"),
    "sensitivities": ("nlp/sensitivity.py", "propagate_sensitivity"),
    "second derivatives": ("nlp/rollout.py", "second_derivatives"),
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
