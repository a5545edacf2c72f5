"""Bounds on every path with every schedule: how near they come to what codesign finds, at the root and after branching."""

from __future__ import annotations

import sys
from collections.abc import Callable
from time import process_time
from typing import TypeVar

import numpy as np

import obsdesign as od
from benchmarks.tables import machine, table, write
from obsdesign.design.path_bound.proof import path_bound_of
from obsdesign.design.record import gap_between
from obsdesign.joint.joint_proof import joint_bound_of

_Answer = TypeVar("_Answer")
MISSIONS, STARTS, WANTED = 9, 1, 0.02
SUITES = ("two GPS and compass", "two GPS", "GPS and compass")

_TRIED = """## What was tried, and what stands in the way

- One matrix above the weights of all choices of a segment, least for what is smooth in time: nothing is counted twice where
  sensors see the same kind of thing. This is the root.
- Branching on segments where a position stands against the heading: a few per cent for each level of the tree, of which all
  ends count, so some hundred ends for 10 % of 20 segments. What is left is the choice between unlike things: at an open segment
  both are counted.
- A linear decision rule c = K z for a nominal schedule, with (Q - theta)^+ <= Q (1 - theta / Qmax) on open segments: not used.
  K = (M - l)^-1 X' grows without limit where the value is near what a schedule's positions allow (M - l singular), and Qmax
  with it: 190 to 240,000 where Q is 4 to 23 (GPS of 2 m and a compass of 0.5 rad, 20 segments), so that 1 - theta / Qmax is 1:
  both sensors on.
- A matrix above the choices in the samples and the heading together, with the direction of the residual along the best path
  (exact on that path): 31.6 % became 30.9 % in mission 2, and 44 to 71 % where that direction was trusted more: paths that go
  another way are counted up to four times.
- Range and bearing are positions here, as in the bound on every path, which is loose."""


def main() -> None:
    """Write benchmarks/joint_bounds.md; an argument: how many random missions."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else MISSIONS
    header = ("mission", "segments", "sensors", "value", "all sensors on", "gap at the root", "s", "gap, branching", "ends", "s", "check s")
    parts = [
        "# Bounds on every path with every schedule",
        "",
        machine(),
        f"CPU seconds of one process. One sensor at a time; values of `codesign`, starts={STARTS}; `all sensors on`: the gap to the bound",
        f"on every path with all sensors. Branching stops at a gap of {WANTED:.0%} or 200 nodes. Wanted: about 10 % on 20 to 40 segments.",
        "",
        table(header, [row(seed) for seed in range(count)]),
        "",
        _TRIED,
    ]
    write("joint_bounds", "\n".join(parts))


def joint_mission(seed: int) -> tuple[od.DesignProblem, int, str]:
    """20 to 40 segments of 4 steps to a goal, GPS of every step and a finer one of every fourth, a compass of any quality, wind."""
    random = np.random.default_rng([seed, 16])
    segments, step, suite = int(random.choice([20, 24, 30, 40])), 0.25, SUITES[seed % len(SUITES)]
    duration, sigma = segments * 4 * step, float(np.exp(random.uniform(-0.3, 1)))
    wind = random.uniform(0, 0.4) * np.array([np.cos(seed), np.sin(seed)])
    goal = wind * duration + random.uniform(0.2, 0.6) * duration * np.array([np.cos(3 * seed), np.sin(3 * seed)])
    sensors = {
        "coarse": od.GPS(sigma, name="coarse"),
        "fine": od.GPS(sigma * float(random.uniform(0.3, 0.7)), rate=1 / (4 * step), name="fine"),
        "compass": od.Magnetometer(float(np.exp(random.uniform(-2.5, 0)))),
    }
    names = {"two GPS and compass": ("coarse", "fine", "compass"), "two GPS": ("coarse", "fine"), "GPS and compass": ("coarse", "compass")}
    problem = od.DesignProblem(
        system=od.System(od.Dubins(1.0, wind="constant"), tuple(sensors[name] for name in names[suite])),
        start=(0.0, 0.0, float(random.uniform(-3, 3)), *wind),
        duration=duration,
        step=step,
        path=od.PiecewiseConstant(segments),
        bounds={"turn_rate": (-0.5, 0.5)},
        scale=(5.0, 5.0, 0.5, 0.3, 0.3),
        constraints=(od.Goal(tuple(goal), tolerance=0.03 * duration),),
    )
    return problem, segments, suite


def row(seed: int) -> tuple[object, ...]:
    """What one mission comes to."""
    problem, segments, suite = joint_mission(seed)
    joint = od.codesign(problem, segments, starts=STARTS, throw=False)
    if not joint.status.has_answer:
        return (seed, segments, suite, "no path", *["–"] * 7)
    everything = path_bound_of(problem).bound
    root_time, root = _timed(lambda: joint_bound_of(problem, segments, 1, joint.value))
    time, proof = _timed(lambda: joint_bound_of(problem, segments, 1, joint.value, WANTED))
    certificate = proof.certificate
    if certificate is None:
        raise AssertionError(f"mission {seed}: {proof.reason}")
    check_time, bound = _timed(lambda: od.check_joint_bound(problem, segments, 1, certificate))
    if not joint.value <= bound == proof.bound:
        raise AssertionError(f"mission {seed}: {bound} for {proof.bound}, value {joint.value}")
    gaps = [f"{gap_between(joint.value, each):.2%}" for each in (everything, root.bound, bound)]
    return (seed, segments, suite, f"{joint.value:.5g}", gaps[0], gaps[1], root_time, gaps[2], len(certificate.ends), time, check_time)


def _timed(call: Callable[[], _Answer]) -> tuple[float, _Answer]:
    began = process_time()
    answer = call()
    return process_time() - began, answer


if __name__ == "__main__":
    main()
