"""The cheapest schedules that keep a requirement: a part of `filter_schedules`."""

from __future__ import annotations

from dataclasses import replace
from time import process_time

import numpy as np

import obsdesign as od
from benchmarks.cheapest_reference import Limit, least_cost
from benchmarks.filter_instances import PROVEN, judged, spread
from benchmarks.flights import PSD, Flight
from benchmarks.kalman_reference import LinearRun, amounts, covariances, patterns
from benchmarks.tables import table

POSITION_LIMIT, SETTLED = 8.0, 20.0  # m, s
_SEEDS = range(5)


def cheapest() -> list[str]:
    """Fewest segments on that keep the position."""
    rows = []
    require = (od.Requirement(about=("x", "y"), at_most=POSITION_LIMIT, share=1.0, after=SETTLED),)
    for K, seeds in ((6, _SEEDS), (8, _SEEDS), (24, _SEEDS)):
        seconds, gaps, equal = [], [], 0
        for seed in seeds:
            flight = Flight(K, seed)
            began = process_time()
            found = od.cheapest_schedule(
                flight.system,
                flight.path,
                flight.prior,
                require=require,
                segment=flight.length,
                disturbance_psd=PSD,
                gap=PROVEN,
                throw=False,
            )
            seconds.append(process_time() - began)
            gaps.append(found.value - found.bound)
            reference = replace(flight.reference, selection=np.eye(5)[:2])
            counts = flight.path.t[:-1] > SETTLED
            _require_within(reference, found.chosen, counts)
            if K <= 8:
                best = least_cost(reference, patterns(4, 1), np.ones(4), np.zeros(4), Limit(POSITION_LIMIT, counts))
                equal += abs(best - found.value) < 1e-9
        proven = sum(gap <= PROVEN for gap in gaps)
        reached = judged(proven == len(seconds) and max(seconds) <= 5 and (K > 8 or equal == len(seconds)))
        rows.append((K, len(seconds), spread(seconds), proven, equal if K <= 8 else "", reached))
    header = ("K", "flights", "s", "proven", "equal to trying all", "reached")
    return [
        f"Fewest segments on, one sensor at a time, the position within {POSITION_LIMIT:g} m at all instants later than {SETTLED:g} s.",
        "Bars: proven in 5 s; equal to trying all for K <= 8.",
        "",
        table(header, rows),
    ]


def _require_within(reference: LinearRun, chosen: np.ndarray, counts: np.ndarray) -> None:
    spread = np.sqrt(amounts(reference, covariances(reference, chosen[None]))[0])
    if spread[counts].max() > POSITION_LIMIT * (1 + 1e-9):
        raise AssertionError(f"a schedule that should keep {POSITION_LIMIT} m has {spread[counts].max()} m")
