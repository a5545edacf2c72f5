"""How the time of information blocks grows with steps, sensors and states, and the memory of a long path."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterable
from functools import partial
from itertools import pairwise
from pathlib import Path

import casadi as ca
import numpy as np

import obsdesign as od
from benchmarks.scene import START, STEP, flown, unicycle
from benchmarks.tables import exponent, peak_memory, table
from benchmarks.timing import MODES, Times, in_modes, mode, timed
from obsdesign.dynamics.model import AbstractSystem
from obsdesign.information.gramian import sensitivity_scan

STEPS = (1_000, 10_000, 100_000, 1_000_000)
SENSORS = (1, 4, 16, 64)
STATES = (3, 5, 7, 15)
SEGMENT = 1_000
SPEED = 10.0


def growth() -> list[str]:
    """Time over steps, sensors and states, in both ways to run a loop."""
    rows = [
        *_series("steps", STEPS, lambda _, loops: unicycle(loops), flown),
        *_series("sensors", SENSORS, with_ranges, lambda count: _turning(with_ranges(count))),
        *_series("states", STATES, with_states, lambda n: _turning(with_states(n))),
    ]
    header = ("what grows", "loops", "sizes", "p", "p, best", "ms", "best ms", "operations per step")
    peaks = ", ".join(_memory(name) for name in MODES)
    return [
        "Time = c size^p; p fitted over the sizes shown, to the medians and to the best times. Steps: the unicycle above, from 10,000 on",
        f"by `segment_information` in segments of {SEGMENT:,}, below by `variational_gramian`. Sensors: ranges to beacons, 5 states, 1,000",
        "steps. States: a Dubins vehicle without wind (3), with wind (5), with trailers, the ranges taken on the last of them (7, 15); 4",
        "ranges, 1,000 steps.",
        "",
        table(header, rows),
        "",
        f"Peak memory of a process of its own with {STEPS[-1]:,} steps by segment, bar < 1 GB: {peaks}.",
    ]


# ---------------------------------------------------------------- systems


def beacons(count: int) -> list[tuple[float, float]]:
    """Return places on a circle around the start."""
    angles = 2 * np.pi * np.arange(count) / count + 0.3
    return [(float(300 * np.cos(angle)), float(300 * np.sin(angle))) for angle in angles]


def with_ranges(count: int, loops: str = "", wind: bool = True) -> AbstractSystem:
    """Return a Dubins vehicle with `count` ranges; `loops` as in `scene.sensors`."""
    ranges = tuple(od.Range(place, 1.0, name=f"range {loops}".strip()) for place in beacons(count))
    return od.System(od.Dubins(SPEED, wind="constant" if wind else None), ranges)


def with_states(n: int, loops: str = "") -> AbstractSystem:
    """Return a system of n states with four ranges."""
    return trailers(n - 3, loops) if n > 5 else with_ranges(4, loops, wind=n == 5)


def trailers(count: int, loops: str = "", length: float = 5.0) -> AbstractSystem:
    """Return a tractor with trailers, each one's heading a state; the last one's axle has four ranges to beacons."""
    x = ca.SX.sym("x", 3 + count)
    headings = ca.vertsplit(x)[2:]
    speed, rates, place = ca.SX(SPEED), [], ca.vertcat(x[0], x[1])
    for ahead, heading in pairwise(headings):
        rates.append(speed / length * ca.sin(ahead - heading))
        speed = speed * ca.cos(ahead - heading)
        place = place - length * ca.vertcat(ca.cos(heading), ca.sin(heading))
    drift = ca.vertcat(SPEED * ca.cos(x[2]), SPEED * ca.sin(x[2]), 0, *rates)
    names = ("x", "y", "heading", *(f"trailer_{i}" for i in range(count)))
    outputs = {f"range {i} {loops}": ca.norm_2(ca.vertcat(*beacon) - place) for i, beacon in enumerate(beacons(4))}
    turn = ca.SX([0, 0, 1, *[0] * count])
    return od.ControlAffineSystem(x, names, drift, {"turn_rate": turn}, outputs=outputs, angles=names[2:])


# ---------------------------------------------------------------- series


def _turning(system: AbstractSystem, steps: int = SEGMENT) -> od.Trajectory:
    n = len(system.model.states)
    start = START if n == 5 else np.array([3.0, -1.0, *[0.4] * (n - 2)])
    return od.simulate(system, start, 0.3 * np.cos(0.07 * np.arange(steps)), STEP)


def _along(system: AbstractSystem, path: od.Trajectory) -> Callable[[], object]:
    if path.steps >= 10_000:
        return partial(od.segment_information, system, path, path.steps // SEGMENT)
    return partial(od.variational_gramian, system, path)


def _series(
    what: str, sizes: tuple[int, ...], system_of: Callable[[int, str], AbstractSystem], path_of: Callable[[int], od.Trajectory]
) -> list[tuple]:
    times: dict[str, list[Times]] = {name: [] for name in MODES}
    operations = []
    for size in sizes:
        path = path_of(size)
        for name, each in timed(in_modes(lambda loops, size=size, path=path: _along(system_of(size, loops), path)), rounds=3).items():
            times[name].append(each)
        operations.append(sensitivity_scan(system_of(size, "").model, STEP, True).instructions)
    return [_row(what, name, sizes, times[name], operations) for name in MODES]


def _row(what: str, name: str, sizes: tuple[int, ...], times: list[Times], operations: list[int]) -> tuple:
    seconds = [[each.median for each in times], [each.best for each in times]]
    shown = [", ".join(f"{1e3 * value:.3g}" for value in values) for values in seconds]
    return what, name, _listed(sizes), *(exponent(sizes, values) for values in seconds), *shown, _listed(operations)


def _listed(numbers: Iterable[int]) -> str:
    return ", ".join(map(str, numbers))


# ---------------------------------------------------------------- memory


def _memory(name: str) -> str:
    """Peak memory of a new process, and of another that stops before the information."""
    whole, before = (_peak(name, verb) for verb in ("segments", "path"))
    return f"{name} {whole} MB ({before} MB without the information)"


def _peak(name: str, verb: str) -> str:
    command = [sys.executable, "-m", "benchmarks.growth", verb]
    with mode(name):
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


def main(verb: str) -> None:
    """Print the peak memory [MB] of this process after a path of 10^6 steps, or after its information by segment."""
    path = flown(STEPS[-1])
    if verb == "segments":
        od.segment_information(unicycle(), path, path.steps // SEGMENT)
    sys.stdout.write(f"{_own_peak():.0f}\n")


def _own_peak() -> float:
    """Peak resident memory [MB] since this program began: where Linux tells it, as getrusage counts what started it as well."""
    status = Path("/proc/self/status")
    lines = status.read_text(encoding="utf-8").splitlines() if status.exists() else []
    peak = next((int(line.split()[1]) / 2**10 for line in lines if line.startswith("VmHWM:")), None)
    return peak_memory() if peak is None else peak


if __name__ == "__main__":
    main(sys.argv[1])
