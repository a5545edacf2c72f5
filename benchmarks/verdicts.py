"""Time of every verdict on published models, and how it grows with states, orders and inputs."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
from time import perf_counter

import casadi as ca

import obsdesign as od
from benchmarks.tables import exponent, machine, peak_memory, table, write

TESTS = Path(__file__).parents[1] / "tests"


def main() -> None:
    """Write benchmarks/verdicts.md."""
    sys.path.insert(0, str(TESTS))
    modules = ("classics", "robotics", "tracking", "visual_inertial", "biology")
    timed = {module: [_timed(case) for case in import_module(f"published.{module}").CASES] for module in modules}
    parts = [
        "# Verdicts: time and growth",
        "",
        machine(),
        "",
        _bars(timed),
        "",
        "## Growth",
        "",
        "Time = c size^p; p fitted over the sizes shown.",
        "",
        _growth(),
        "",
        "## Every case",
        "",
        "ku, uu: known and unknown inputs; orders: derivatives or steps until the last growth.",
    ]
    header = ("case", "n", "ku", "uu", "dimension", "orders", "stopped by", "right", "s")
    for module, rows in timed.items():
        parts += ["", f"### {module}: {len(rows)} cases, {sum(row[-1] for row in rows):.1f} s", "", table(header, rows)]
    write("verdicts", "\n".join(parts))


def _timed(case) -> tuple:  # noqa: ANN001  # a Case of tests/published
    system = case.build()
    disturbance = "arbitrary" if case.disturbance == "arbitrary" else od.Polynomial(case.disturbance)
    start = perf_counter()
    verdict = od.observability(system, case.at, case.held, disturbance, case.known_inputs)
    seconds = perf_counter() - start
    right = "yes" if verdict.decided and verdict.dimension == case.dimension else "WRONG" if verdict.decided else "undecided"
    counts = (len(system.names), len(system.known), len(system.unknown), verdict.dimension, len(verdict.ranks) - 1)
    return (case.name, *counts, verdict.stopped_by, right, seconds)


def _bars(timed: dict[str, list[tuple]]) -> str:
    classics = {row[0]: row[-1] for row in timed["classics"]}
    every = [row for rows in timed.values() for row in rows]
    inertial = [row for row in timed["visual_inertial"] if row[1] >= 15]
    large = [row for row in timed["biology"] if row[1] >= 35]
    rows = [
        ("the cases of the four papers (classics), all", f"{sum(classics.values()):.2f} s", "10 s"),
        ("HIV with arbitrary eta", f"{classics['HIV, arbitrary eta']:.3f} s", "0.3 s"),
        (f"visual-inertial with 15 to 18 states, slowest of {len(inertial)}", f"{max(row[-1] for row in inertial):.2f} s", "20 s"),
        (f"35 states, slowest of {len(large)}", f"{max(row[-1] for row in large):.2f} s", "60 s"),
        ("peak memory of this whole run", f"{peak_memory():.0f} MB", "2 GB"),
        ("right, undecided, wrong", _score(every), "0 wrong"),
    ]
    return table(("what", "measured", "bar"), rows)


def _score(rows: list[tuple]) -> str:
    return ", ".join(str(sum(row[-2] == label for row in rows)) for label in ("yes", "undecided", "WRONG"))


# ---------------------------------------------------------------- growth


def chain(n: int, known: int = 1, unknown: int = 0) -> od.ControlAffineSystem:
    """Return n/2 coupled saturating compartments and as many unknown rates; the first is measured, inputs enter at the end."""
    half = n // 2
    x = ca.SX.sym("x", n)
    flows = [x[half + i] * x[i] / (1 + x[i]) for i in range(half)]
    rates = [(flows[i + 1] if i + 1 < half else 0) - flows[i] for i in range(half)] + [0] * (n - half)
    unit = [ca.SX([float(row == half - 1 - k) for row in range(n)]) for k in range(known + unknown)]
    return od.ControlAffineSystem(
        state=x,
        names=tuple(f"x{i}" for i in range(n)),
        drift=ca.vertcat(*rates),
        known={f"u{k}": unit[k] for k in range(known)},
        unknown={f"w{k}": unit[known + k] for k in range(unknown)},
        outputs={"first": x[0], **{f"mid{k}": x[half - 1 - known - k] for k in range(unknown)}},
    )


def _growth() -> str:
    rows = [
        _series("states n (chain, known input)", (8, 12, 16, 24, 32), lambda n: partial(od.observability, chain(n))),
        _series("states n (chain, unknown input)", (8, 12, 16, 24, 32), lambda n: partial(od.observability, chain(n, 0, 1))),
        _series("states n (chain, both)", (8, 12, 16, 24, 32), lambda n: partial(od.observability, chain(n, 1, 1))),
        _series(
            "orders (jets, n = 12, both)", (8, 16, 32, 64), lambda k: partial(od.observability, chain(12, 1, 1), method="jets", orders=k)
        ),
        _series("known inputs (chain, n = 16)", (1, 2, 4, 6), lambda m: partial(od.observability, chain(16, m))),
        _series("unknown inputs (chain, n = 16)", (1, 2, 3, 4), lambda p: partial(od.observability, chain(16, 0, p))),
    ]
    return table(("what grows", "sizes", "s", "p"), rows)


def _series(what: str, sizes: Sequence[int], question) -> tuple[str, str, str, float]:  # noqa: ANN001
    seconds = []
    for size in sizes:
        ask = question(size)
        start = perf_counter()
        ask()
        seconds.append(perf_counter() - start)
    return what, ", ".join(map(str, sizes)), ", ".join(f"{value:.2g}" for value in seconds), exponent(sizes, seconds)
