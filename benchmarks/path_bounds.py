"""Bounds on every path: how near they are, what they cost, how that grows."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from time import process_time

import numpy as np

import obsdesign as od
from benchmarks.missions import BEACON, DUBINS, LIMITS, mission, plateau
from benchmarks.tables import exponent, machine, table, write
from obsdesign.design.gap_search import LIMIT
from obsdesign.design.path_bound.certificate import PathBound
from obsdesign.design.path_bound.proof import path_bound_of
from obsdesign.design.record import gap_between

MISSIONS, STARTS, CLOSED = 200, 8, 0.004


def main() -> None:
    """Write benchmarks/path_bounds.md; an argument: how many random missions."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else MISSIONS
    parts = [
        "# Bounds on every path",
        "",
        machine(),
        "CPU seconds of one process, its linear algebra on one thread; a bound is computed from the problem and the value of the design.",
        "",
        *_section("Missions with a known best", known_missions()),
        *_section("Random missions", random_missions(count)),
        *_section("Range and bearing", beacons()),
        *_section("Growth", growth()),
    ]
    write("path_bounds", "\n".join(parts))


def _section(title: str, lines: list[str]) -> list[str]:
    return [f"## {title}", "", *lines, ""]


def _timed(bound: Callable[[], PathBound]) -> tuple[float, PathBound]:
    began = process_time()
    proof = bound()
    return process_time() - began, proof


def aerosonde() -> od.DesignProblem:
    """Two minutes of an aircraft at 20 m/s with GPS of 2 m at 1 Hz, heading scale 0.05, 24 turn rates, to a goal."""
    return od.DesignProblem(
        system=od.System(od.Dubins(20.0, wind="constant"), (od.GPS(2.0, rate=1.0),)),
        start=(0.0, 0.0, np.radians(30.0), 2.5, 3.5),
        duration=120.0,
        step=1.0,
        path=od.PiecewiseConstant(24),
        bounds={"turn_rate": (-0.24, 0.24)},
        scale=(50.0, 50.0, 0.05, 5.0, 5.0),
        constraints=(od.Goal((1400.0, 800.0), tolerance=50.0),),
    )


def known_missions() -> list[str]:
    """The saturated problem, the mission of docs/design.md, an aircraft."""
    rows = []
    for name, problem, finer in (
        ("20 pieces, saturated", plateau(), None),
        ("40 pieces, goal, keep-out", mission(), None),
        ("the same, 80 pieces of the Gram matrix", mission(), (2,) * 80),
        ("aircraft, GPS alone", aerosonde(), None),
    ):
        design = od.design_trajectory(problem, starts=STARTS)
        path_bound_of(problem, design.value, finer)  # warm
        seconds, proof = _timed(lambda problem=problem, design=design, finer=finer: path_bound_of(problem, design.value, finer))
        certificate = proof.certificate
        check = np.nan if certificate is None else _timed(lambda p=problem, c=certificate: PathBound(od.check_path_bound(p, c), c, ""))[0]
        cap = np.nan if design.cap is None else design.cap.value
        rows.append(
            (name, f"{design.value:.7g}", f"{proof.bound:.7g}", f"{cap:.7g}", f"{1 - design.value / proof.bound:.3%}", seconds, 1e3 * check)
        )
    header = ("", f"value, {STARTS} starts", "bound", "cap", "gap", "bound s", "check ms")
    return [
        "Bars: the cap in 0.2 s; at most 152.6 in 1 s and 152.3 in 10 s; within 0.5 % in 3 s.",
        "",
        table(header, rows),
    ]


def random_mission(seed: int) -> od.DesignProblem:
    """15 to 60 pieces of 1 to 4 steps, goal (4 of 5) and keep-out (1 of 2), wind to half the speed, speeds and scales over decades."""
    random = np.random.default_rng(seed)
    pieces, per_piece, step = int(random.integers(15, 61)), int(random.choice([1, 2, 3, 4])), float(random.uniform(0.15, 0.5))
    duration, speed = pieces * per_piece * step, float(np.exp(random.uniform(-1, 3)))
    wind = random.uniform(0, 0.5) * speed * _direction(random)
    turn = float(random.uniform(0.2, 1.2) / (per_piece * step) * random.choice([0.3, 1.0]))
    position, heading, drift = np.exp(random.uniform(-1.5, 1.5, 3)) * (5 * speed, 0.3, 0.3 * speed)
    way = speed * duration
    goal = wind * duration + random.uniform(0.2, 0.8) * way * _direction(random)
    limits: list[od.Goal | od.KeepOut] = [od.Goal(tuple(goal), tolerance=0.03 * way)] if random.uniform() < 0.8 else []
    has_obstacle = random.uniform() < 0.5 and float(np.linalg.norm(goal)) / 2 > 0.05 * way  # the start is outside of it
    limits += [od.KeepOut(tuple(goal / 2), radius=0.05 * way)] if has_obstacle else []
    return od.DesignProblem(
        system=od.System(od.Dubins(speed, wind="constant"), (od.GPS(float(np.exp(random.uniform(-1, 1)) * speed)),)),
        start=(0.0, 0.0, float(random.uniform(-3, 3)), *wind),
        duration=duration,
        step=step,
        path=od.PiecewiseConstant(pieces),
        bounds={"turn_rate": (-turn, turn)},
        scale=(position, position, heading, drift, drift),
        constraints=tuple(limits),
    )


def _direction(random: np.random.Generator) -> np.ndarray:
    angle = random.uniform(0, 2 * np.pi)
    return np.array([np.cos(angle), np.sin(angle)])


def random_missions(count: int) -> list[str]:
    """How near the bound is to the best path of some starts, over missions that have one."""
    gaps, seconds, starts, saturated, without, broken = [], [], [], 0, 0, 0
    for seed in range(count):
        problem = random_mission(seed)
        design = od.design_trajectory(problem, starts=STARTS, throw=False, gap=CLOSED)
        if not design.ended.has_answer:
            without += 1
            continue
        spent, _ = _timed(lambda design=design: path_bound_of(design.problem, design.value))
        starts.append(len(design.starts))
        broken += any(start.value > design.bound for start in design.starts if start.refined)  # pieces of coarse ones begin elsewhere
        saturated += design.reaches_cap
        gaps.append(design.gap)
        seconds.append(spent)
    rows = [
        ("missions with a path, without one", f"{len(gaps)}, {without}"),
        ("bounds below a path that was found", broken),
        ("missions whose cap is reached", saturated),
        ("median and largest number of starts", f"{np.median(starts):.0f}, {max(starts)}"),
        ("median gap", f"{np.median(gaps):.3%}"),
        ("median gap of those whose cap is not reached", f"{np.median([gap for gap in gaps if gap > 2e-6]):.3%}"),
        ("90 % of gaps below", f"{np.quantile(gaps, 0.9):.3%}"),
        ("95 % of gaps below", f"{np.quantile(gaps, 0.95):.3%}"),
        ("largest gap", f"{max(gaps):.3%}"),
        ("median s of the bound", float(np.median(seconds))),
        ("largest s of the bound", max(seconds)),
    ]
    return [
        f"Of {count} missions, designs with gap={CLOSED}: from 2 to {LIMIT * STARTS} starts. Bars: never below a path; median gap 0.6 %,",
        "95 % below 2 %.",
        "",
        table(("", ""), rows),
    ]


def beacons() -> list[str]:
    """How near the bound is where ranges and bearings to one beacon are counted as positions."""
    gps, far = od.GPS(2.0), (40.0, 30.0)
    suites = {
        "GPS 2 m": (gps,),
        "GPS 2 m, range 2 m": (gps, od.Range(BEACON, 2.0)),
        "GPS 2 m, range 2 m, beacon farther away": (gps, od.Range(far, 2.0)),
        "GPS 2 m, bearing 0.2 rad": (gps, od.Bearing(BEACON, 0.2)),
        "range 1 m, compass 0.2 rad": (od.Range(BEACON, 1.0), od.Magnetometer(0.2)),
        "range 1 m, bearing 0.09 rad, compass 0.2 rad": (od.Range(BEACON, 1.0), od.Bearing(BEACON, 0.09), od.Magnetometer(0.2)),
    }
    rows = []
    for name, sensors in suites.items():
        limits = (LIMITS[0], od.StandOff(5.0))
        problem = replace(mission(), system=od.System(DUBINS, sensors), constraints=limits if len(sensors) > 1 else LIMITS[:1])
        design = od.design_trajectory(problem, starts=STARTS)
        proof = path_bound_of(problem, design.value)
        rows.append((name, f"{design.value:.5g}", f"{proof.bound:.5g}", f"{gap_between(design.value, proof.bound):.1%}"))
    return [
        "The 40-piece mission without its obstacle, 5 m from the beacon at least.",
        "",
        table(("sensors", f"value, {STARTS} starts", "bound", "gap"), rows),
        "",
        "A beacon's samples are counted as positions of both axes: r r' <= I for a range, (e / d, -1)(e / d, -1)' for a bearing",
        "at the least distance that the way from the start and to the goal leaves. What stands in the way of more: what a range",
        "says of the heading is (r'J z)^2, r the line of sight: of fourth order in the path, while the Gram matrix has its second",
        "order alone. Directions of sight that are known up to a sector (by branching on where the path is at some times) are of",
        "second order, but tie the two axes, which the form keeps apart: M (x) I would have to become a matrix of both. Neither",
        "was built; dynamic programs bound a mixture of paths, which here is what no path changes.",
    ]


def growth() -> list[str]:
    """Time of the bound of the mission cut into more pieces."""
    counts, rows, times = (40, 80, 160), [], []
    for pieces in counts:
        spent, proof = _timed(lambda pieces=pieces: path_bound_of(mission(pieces), 149.0))
        rows.append((pieces, f"{proof.bound:.7g}", spent))
        times.append(spent)
    return [table(("pieces", "bound", "s"), rows), "", f"Time grows with the power {exponent(counts, times):.1f} of the number of pieces."]


if __name__ == "__main__":
    main()
