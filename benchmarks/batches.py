"""Information for many starts at once, in one process and in two."""

from __future__ import annotations

import os
from concurrent.futures import Executor, ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context

import numpy as np

import obsdesign as od
from benchmarks.scene import START, STEP, controls, unicycle
from benchmarks.tables import table
from benchmarks.timing import MODES, Subject, mode, ratios, timed

BATCH = 10_000
BURN = 20_000_000


def burn(count: int) -> int:
    """Keep one core busy."""
    total = 0
    for i in range(count):
        total += i & 7
    return total


def batches() -> list[str]:
    """Many starts, in one process and in two."""
    starts = START + np.random.default_rng(0).normal(size=(BATCH, 5)) * (20.0, 20.0, 0.5, 2.0, 2.0)
    rows = [_batch_row(name, starts) for name in MODES]
    return [
        f"{BATCH:,} starts, 100 steps, blocks added up over the steps; two processes, warm. The last two columns say what two processes",
        f"are worth on this machine ({os.cpu_count()} cores) in the same minutes: a loop of plain Python without any data.",
        "",
        table(("loops", "gain of two", "best", "per second, one", "per second, two", "gain of a plain loop", "best"), rows),
    ]


def _batch_row(name: str, starts: np.ndarray) -> tuple:
    system, around = unicycle(name), partial(mode, name)
    with mode(name), ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        times = timed(
            {
                "one": Subject(lambda: od.batch_information(system, starts, controls(100), STEP), around),
                "two": Subject(lambda: od.batch_information(system, starts, controls(100), STEP, executor=pool), around),
                "burn one": Subject(lambda: [burn(BURN // 2), burn(BURN // 2)]),
                "burn two": Subject(partial(_burn_both, pool)),
            },
            rounds=5,
        )
    per_second = [len(starts) / times[each].median for each in ("one", "two")]
    return (name, *ratios(times["one"], times["two"]), *per_second, *ratios(times["burn one"], times["burn two"]))


def _burn_both(pool: Executor) -> list[int]:
    return list(pool.map(burn, [BURN // 2] * 2))
