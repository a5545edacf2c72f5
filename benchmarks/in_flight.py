"""The planner, again and again: time of a step, and what a closed loop achieves against solving each step to the end."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import obsdesign as od
from benchmarks.missions import DUBINS, SCALE, START
from benchmarks.tables import table
from obsdesign.design.sqp.trust_region_sqp import MAX_ITERATIONS as SOLVER_ITERATIONS
from obsdesign.planning.planner import Planner

STEPS, DEADLINE, COMPARED = 500, 0.1, 120


def circuit() -> od.DesignProblem:
    """40 turn rates over 40 s within a fence, around an obstacle, GPS of 2 m: what is planned anew at every step."""
    return od.DesignProblem(
        system=od.System(DUBINS, (od.GPS(2.0),)),
        start=START,
        duration=40.0,
        step=0.25,
        path=od.PiecewiseConstant(40),
        bounds={"turn_rate": (-0.5, 0.5)},
        scale=SCALE,
        constraints=(od.KeepOut((12.0, 2.0), 3.0), od.KeepIn(((-60.0, -60.0), (60.0, -60.0), (60.0, 60.0), (-60.0, 60.0)))),
    )


def in_flight() -> list[str]:
    """A closed loop of 500 steps, replanned at each of them, without noise; the same to the end at each of the first."""
    problem = replace(circuit(), start=(0.0, 0.0, 0.0, 0.1, -0.05))
    quick = _looped(problem, Planner(problem, every=problem.step), STEPS, DEADLINE)
    thorough = _looped(problem, Planner(problem, every=problem.step, iterations=SOLVER_ITERATIONS, enough=1e-9), COMPARED, None)
    free = _looped(problem, Planner(problem, every=problem.step), COMPARED, None)
    seconds = 1e3 * np.array([plan.seconds for plan in quick[1:]])
    values, best = np.array([plan.value for plan in free[1:]]), np.array([plan.value for plan in thorough[1:]])
    ages = np.array([plan.age for plan in quick])
    rows = [
        ("median ms of a step", float(np.median(seconds))),
        ("99th percentile ms, deadline 100 ms", float(np.percentile(seconds, 99))),
        ("steps without an exception", len(quick)),
        ("plans that keep every limit", sum(plan.feasible for plan in quick)),
        ("plans older than their step", int((ages > 0).sum())),
        (f"mean value over {COMPARED} steps, share of solving each step to the end", f"{float(np.mean(values) / np.mean(best)):.2%}"),
        ("median ms of solving a step to the end", float(np.median([1e3 * plan.seconds for plan in thorough[1:]]))),
    ]
    return [
        "Bars: median under 40 ms, 99th percentile under 100 ms, 500 steps without an exception, at least 95 %.",
        "",
        table(("", ""), rows),
    ]


def _looped(problem: od.DesignProblem, planner: Planner, steps: int, deadline: float | None) -> list[od.Plan]:
    plans, x = [planner.step(problem.x0)], problem.x0
    for _ in range(steps):
        x = plans[-1].trajectory.x[1]
        plans.append(planner.step(x, plans[-1], deadline=deadline))
    return plans
