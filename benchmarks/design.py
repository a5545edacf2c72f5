"""Trajectory design: time to an answer, how good it is, against scipy, and how it grows."""

from __future__ import annotations

import multiprocessing
import sys
from collections.abc import Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from cProfile import Profile
from functools import partial
from pstats import Stats
from subprocess import run
from time import perf_counter

import numpy as np

import obsdesign as od
from benchmarks.in_flight import in_flight
from benchmarks.missions import beacon_mission, mission, plateau
from benchmarks.optimisers import Answer, answers
from benchmarks.tables import exponent, machine, table, write
from obsdesign.design.initial_guesses import start_inputs
from obsdesign.design.local_solve import LocalSolution, LocalSolve, families_of, solve_locally

BEACON_STARTS, MANY, WORKERS = 40, 200, 2


def main() -> None:
    """Write benchmarks/design.md."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(WORKERS, mp_context=context) as pool:
        parts = [
            "# Trajectory design: time, quality and growth",
            "",
            machine(),
            f"Medians in one process, machine code and functions warm; designs of several starts on {WORKERS} worker processes.",
            "",
            *_section("Building", building()),
            *_section("A saturated problem", saturated()),
            *_section("A goal and an obstacle", goal_and_obstacle(pool)),
            *_section("Range, bearing and compass", range_and_bearing(pool)),
            *_section("Against scipy", against_scipy()),
            *_section("Where the time goes", where_time_goes()),
            *_section("Growth", growth(pool)),
            *_section("In flight", in_flight()),
        ]
    write("design", "\n".join(parts))


def _section(title: str, lines: list[str]) -> list[str]:
    return [f"## {title}", "", *lines, ""]


def random_starts(problem: od.DesignProblem, count: int, seed: int = 0) -> list[np.ndarray]:
    """Parameters anywhere within 60 % of the bounds, nothing smooth about them."""
    lower, upper = problem.path.box(problem.grid)
    centre, half = (lower + upper) / 2, (upper - lower) / 2
    random = np.random.default_rng(seed)
    return [centre + 0.6 * half * random.uniform(-1, 1, len(lower)) for _ in range(count)]


def _timed(problem: od.DesignProblem, p: np.ndarray, coarse: bool = False) -> tuple[float, LocalSolution]:
    """Climb from parameters; coarse: through coarser families, as designs do."""
    u = np.array(problem.path.inputs(p, problem.grid)).reshape(problem.steps, -1)  # pyright: ignore[reportArgumentType]
    families = families_of(problem.path) if coarse else (problem.path,)
    began = perf_counter()
    found = solve_locally(LocalSolve(problem, "random", u, families, True))
    return perf_counter() - began, found


def _all(problem: od.DesignProblem, starts: Sequence[np.ndarray], pool: Executor | None = None) -> list[tuple[float, LocalSolution]]:
    return list((map if pool is None else pool.map)(partial(_timed, problem), starts))


def _value(found: LocalSolution) -> float:
    return found.objective if found.status.has_answer else float("nan")


# ---------------------------------------------------------------- parts


def building() -> list[str]:
    """From an empty process: the first program of 40 pieces, and the next."""
    code = (
        "import time, obsdesign as od\n"
        "from benchmarks.missions import mission\n"
        "from obsdesign.design.feasibility import initial_rows\n"
        "from obsdesign.design.nlp.program import Program\n"
        "import numpy as np\n"
        "for pieces in (40, 40, 20):\n"
        "    problem = mission(pieces); began = time.perf_counter()\n"
        "    program = Program(problem, initial_rows(problem)); values = program.evaluate((program.lower + program.upper) / 2)\n"
        "    program.derivatives(values); print(time.perf_counter() - began)\n"
    )
    seconds = [float(line) for line in run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()]
    rows = [("first in a process, 40 pieces", seconds[0]), ("again", seconds[1]), ("another number of pieces", seconds[2])]
    return ["The program of the mission below, to its first values and slopes. Bar: 40 pieces under 1 s.", "", table(("", "s"), rows)]


def saturated() -> list[str]:
    """20 pieces, where the cap is reached."""
    problem = plateau()
    cap = od.design_trajectory(problem, starts=1).cap
    if cap is None:
        raise AssertionError("the saturated problem has a cap")
    starts = random_starts(problem, 21)
    _timed(problem, starts[0])
    found = _all(problem, starts[1:])
    seconds = [each[0] for each in found]
    reached = sum(_value(each) >= cap.value * (1 - 1e-6) for _, each in found)
    design = od.design_trajectory(problem, starts=8)
    before = max((_log_det(problem, each) for _, each in found if _value(each) >= cap.value * (1 - 1e-6)), default=float("nan"))
    rows = [
        ("median ms of a start", 1e3 * float(np.median(seconds))),
        ("best ms", 1e3 * min(seconds)),
        ("median iterations", float(np.median([each.iterations for _, each in found]))),
        ("starts of 20 that reach the cap to 1e-6", reached),
        ("cap", f"{cap.value:.10f}"),
        ("value of the design, 8 starts", f"{design.value:.10f}"),
        ("log det of S W S, best of the 20", before),
        ("log det of S W S, design: the tie is broken by it", _log_det_of(problem, design)),
    ]
    return [
        "20 turn rates, 100 samples, GPS. Bars: median under 25 ms, the cap reached from at least 19 of 20 starts.",
        "",
        table(("", ""), rows),
    ]


def _log_det(problem: od.DesignProblem, found: LocalSolution) -> float:
    return od.LogDet().value(problem.scaled(problem.information_matrix(found.path)))


def _log_det_of(problem: od.DesignProblem, design: od.Design) -> float:
    if design.trajectory is None:
        return float("nan")
    return od.LogDet().value(problem.scaled(problem.information_matrix(design.trajectory)))


def goal_and_obstacle(pool: Executor) -> list[str]:
    """The best of 200 random starts, against the designs of 8 starts."""
    problem = mission()
    _all(problem, random_starts(problem, 2 * WORKERS, seed=1), pool)  # warm
    found = _all(problem, random_starts(problem, MANY), pool)
    values = np.array([_value(each) for _, each in found])
    best = float(np.nanmax(values))
    seconds, designs = [], []
    for _ in range(5):
        began = perf_counter()
        designs.append(od.design_trajectory(problem, starts=8, executor=pool))
        seconds.append(perf_counter() - began)
    rows = [
        ("best of 200 random starts", best),
        ("share of them within 0.2 %", f"{np.mean(values >= best * (1 - 2e-3)):.1%}"),
        ("without an answer", int(np.isnan(values).sum())),
        ("median ms of a random start", 1e3 * float(np.median([each[0] for each in found]))),
        ("value of the design, 8 starts", designs[0].value),
        ("below the best", f"{max(0.0, 1 - designs[0].value / best):.3%}"),
        ("median s of a design", float(np.median(seconds))),
        ("best s", min(seconds)),
    ]
    return ["40 turn rates, 160 samples, GPS. Bars: a design within 0.2 % of the best, in under 1 s.", "", table(("", ""), rows)]


def range_and_bearing(pool: Executor) -> list[str]:
    """40 random starts where nothing saturates."""
    problem = beacon_mission()
    found = _all(problem, random_starts(problem, BEACON_STARTS), pool)
    values, seconds = np.array([_value(each) for _, each in found]), [each[0] for each in found]
    best = float(np.nanmax(values))
    rows = [
        ("best value", best),
        ("share within 0.1 % of it", f"{np.mean(values >= best * (1 - 1e-3)):.1%}"),
        ("without an answer", int(np.isnan(values).sum())),
        ("median ms of a start", 1e3 * float(np.median(seconds))),
        ("value of the design, 8 starts", od.design_trajectory(problem, starts=8, executor=pool).value),
    ]
    return ["The same mission, 40 random starts.", "", table(("", ""), rows)]


def against_scipy() -> list[str]:
    """The same starts for all, one after the other in one process."""
    problem = mission()
    inputs = [u for _, (_, u) in zip(range(2), start_inputs(problem, 0), strict=False)]
    starts = [problem.path.fit(u, problem.grid) for u in inputs]
    began = perf_counter()
    ours = [solve_locally(LocalSolve(problem, "", u, families_of(problem.path), True)) for u in inputs]
    mine = Answer("obsdesign", max(_value(each) for each in ours), perf_counter() - began, 0, "2 of 2 starts end within the limits")
    theirs = list(answers(problem, starts))
    rows = [(mine.name, mine.value, mine.seconds, "", mine.said)]
    rows += [(each.name, each.value, each.seconds, f"{each.seconds / mine.seconds:.1f}", each.said) for each in theirs]
    return [
        "The mission above from the same 2 starts, in one process; scipy gets lambda_min and its gradient from the same program. Bars: at",
        "least 20 times faster than the best of them, never a lower value.",
        "",
        table(("optimiser", "best value", "s", "times ours", ""), rows),
    ]


# what is told apart in a profile: file and function, and what it is
_PARTS = {
    ("sqp/local_model.py", "build_model"): "slopes, second derivatives and convex part of a model",
    ("sqp/conic_qp.py", "minimise"): "convex programs, Clarabel and its matrices",
    ("sqp/local_model.py", "active_set_step"): "Newton's step on what is active",
    ("nlp/program.py", "evaluate"): "values and merits",
}


def where_time_goes() -> list[str]:
    """Shares of one start of the mission, coarse to fine, by the profiler."""
    problem = mission()
    start = random_starts(problem, 1)[0]
    _timed(problem, start, coarse=True)
    profile = Profile()
    found = profile.runcall(_timed, problem, start, coarse=True)[1]
    stats = Stats(profile)
    rows = []
    for (file, function), what in _PARTS.items():
        hits = [value for key, value in stats.stats.items() if key[0].endswith(f"design/{file}") and key[2] == function]  # pyright: ignore
        if not hits:
            raise RuntimeError(f"the profile has no {function} of design/{file}")
        rows.append((what, sum(hit[0] for hit in hits), f"{sum(hit[3] for hit in hits) / stats.total_tt:.0%}"))  # pyright: ignore
    text = (
        f"One start of the mission, {found.iterations} iterations through 10 and 40 pieces. The rest is choosing, and the profiler itself."
    )
    return [text, "", table(("", "calls", "share"), rows)]


def growth(pool: Executor) -> list[str]:
    """Pieces and steps together: four steps to a piece."""
    rows, pieces = [], (10, 20, 40, 80, 200)
    for count in pieces:
        problem = mission(count, 10.0 / count)
        began = perf_counter()
        design = od.design_trajectory(problem, starts=4, executor=pool)
        rows.append((count, 4 * count, perf_counter() - began, design.value))
    grown = exponent([row[0] for row in rows[1:]], [row[2] for row in rows[1:]])
    return [
        "The mission with more and more pieces of four steps, 4 starts on two workers, building included. Bar: 200 pieces under 20 s.",
        "",
        table(("pieces", "steps", "s", "value"), rows),
        "",
        f"Seconds grow as pieces^{grown:.2f} from 20 to 200.",
    ]
