"""Schedules for what a filter will know: proofs, gaps, time, recorded runs, and others side by side."""

from __future__ import annotations

import json
import sys
from subprocess import run
from time import monotonic, process_time

import numpy as np

import obsdesign as od
from benchmarks.cheapest_schedules import cheapest
from benchmarks.filter_comparisons import recorded, stone_soup
from benchmarks.filter_instances import PROVEN, FlightInstance, asked, judged, spread
from benchmarks.flights import Flight
from benchmarks.kalman_reference import costs, patterns, trellis
from benchmarks.random_filter_problems import CRITERIA, random_problem
from benchmarks.tables import machine, table, write

RANDOM_PROBLEMS, SEEDS = 300, range(20)


def main() -> None:
    """Write benchmarks/filter_schedules.md."""
    asked(FlightInstance(Flight(4, 99)), gap=1e-3)  # warm
    parts = [
        "# Schedules for what a filter will know",
        "",
        machine(),
        "Seconds are the processor's, of one call on a path that is there. Cost: mean over the instants of the trace of the covariance",
        "after the samples, in units (the prior's standard deviations on flights, metres on recorded runs). Gap: 1 - bound / cost.",
        "After every call the cost is computed again another way (flights: a Kalman filter in plain NumPy; recorded runs: the posterior",
        "information), and the bound is held against random schedules, greedy, round robin and a trellis.",
        "",
        *_section("All schedules tried", tried()),
        *_section("Flights", flights()),
        *_section("Long flights", long_flights()),
        *_section("Segments of one second", short_segments()),
        *_section("Recorded runs", recorded()),
        *_section("Greedy", greedy()),
        *_section("Stone Soup's sensor managers", stone_soup()),
        *_section("Cheapest schedules", cheapest()),
    ]
    write("filter_schedules", "\n".join(parts))


def _section(title: str, lines: list[str]) -> list[str]:
    return [f"## {title}", "", *lines, ""]


# ---------------------------------------------------------------- parts


def tried() -> list[str]:
    """Random problems against all their schedules."""
    rows: dict[str, list[int]] = {}
    for seed in range(RANDOM_PROBLEMS):
        problem = random_problem(seed)
        optimum = problem.optimum()
        found = od.select_for_filter(
            problem.system,
            problem.path,
            problem.prior,
            per_segment=problem.per_segment,
            segment=problem.boundaries,
            disturbance_psd=problem.psd,
            about=problem.about,
            over=problem.over,
            criterion=CRITERIA[problem.reference.criterion],
            scale=problem.units,
            active=problem.active,
            rules=problem.rule.rules,
            gap=1e-7,
            throw=False,
        )
        cost, margin = problem.cost(found.chosen), 1e-8 * max(1.0, abs(optimum))
        kind = type(problem.rule.rules[0]).__name__ if problem.rule.rules else "none"
        for key in (f"over {problem.over if isinstance(problem.over, str) else 'weights'}", problem.reference.criterion, f"rule: {kind}"):
            tally = rows.setdefault(key, [0, 0, 0, 0])
            tally[0] += 1
            tally[1] += cost <= optimum + margin
            tally[2] += found.status is od.Status.OPTIMAL
            tally[3] += found.bound > optimum + margin or abs(cost - found.value) > margin
    header = ("problems with", "", "equal to trying all", "proven", "wrong bound or cost")
    return [
        f"{RANDOM_PROBLEMS} random linear problems, K S <= 16, one or two sensors on, outages, unequal segments; a rule in half of them.",
        "A gap of 1e-7 is asked for. Bars: all equal to trying all, no bound on the wrong side.",
        "",
        table(header, [(key, *tally) for key, tally in sorted(rows.items())]),
    ]


def flights() -> list[str]:
    """Flights to a proof, and what is there early."""
    rows = []
    for K, seeds, most in ((24, SEEDS, 0.3), (48, SEEDS[:5], 1.0), (200, SEEDS[:3], 10.0)):
        answers = [asked(FlightInstance(Flight(K, seed)), gap=PROVEN) for seed in seeds]
        seconds, gaps = [each.seconds for each in answers], [each.found.gap for each in answers]
        proven = sum(gap <= PROVEN for gap in gaps)
        reached = judged(proven == len(answers) and max(seconds) <= most)
        rows.append((K, len(answers), spread(seconds), proven, spread(gaps), f"proven in {most:g} s", reached))
    limit = 1.5 * wall_per_second()
    early = [asked(FlightInstance(Flight(200, seed)), gap=PROVEN, time_limit=limit) for seed in SEEDS[:3]]
    seconds, gaps = [each.seconds for each in early], [each.found.gap for each in early]
    reached = judged(max(gaps) <= 4e-3 and max(seconds) <= 1.65)
    rows.append((200, 3, spread(seconds), "", spread(gaps), "0.4 % after 1.5 s", reached))
    text = "GPS, compass, range and bearing, one on at a time, 5 states, segments of 5 s: median and worst. A gap of 1e-6 is asked for."
    return [text, "", table(("K", "flights", "s", "proven", "gap", "bar", "reached"), rows)]


def long_flights() -> list[str]:
    """Each in a process of its own, for its memory."""
    rows = []
    for K, most, bar in ((1000, 10.0, 3e-3), (10_000, 10.0, 2.5e-2), (10_000, 60.0, 5e-3)):
        seconds, gap, before, peak = _long_flight(K, bar)
        reached = judged(seconds <= 1.05 * most and gap <= bar and peak <= 1024)
        rows.append((K, f"{seconds:.1f}", f"{gap:.2e}", f"{before:.0f}", f"{peak:.0f}", f"{bar:.1%} in {most:g} s, 1 GB", reached))
    return [table(("K", "s", "gap", "MB before", "peak MB", "bar", "reached"), rows)]


def _long_flight(K: int, gap: float) -> tuple[float, float, float, float]:
    """Seconds, gap, memory before and at its peak [MB]."""
    code = (
        "import json\n"
        "from benchmarks.filter_instances import FlightInstance, asked\n"
        "from benchmarks.flights import Flight\n"
        "from benchmarks.tables import peak_memory\n"
        f"asked(FlightInstance(Flight(4, 99)), gap=1e-3); instance = FlightInstance(Flight({K}, 0)); instance.flight.path\n"
        f"before = peak_memory(); answer = asked(instance, check=False, gap={gap})\n"
        "print(json.dumps([answer.seconds, answer.found.gap, before, peak_memory()]))\n"
    )
    done = run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return tuple(json.loads(done.stdout.splitlines()[-1]))


def short_segments() -> list[str]:
    """Where memory is long against the segment."""
    rows = []
    for K, bar in ((24, 1e-2), (120, 3e-2)):
        answers = [asked(FlightInstance(Flight(K, seed, per_segment=1)), gap=0.9 * bar) for seed in SEEDS[:3]]
        seconds, gaps = [each.seconds for each in answers], [each.found.gap for each in answers]
        rows.append((K, spread(seconds), spread(gaps), f"{bar:.0%} in 10 s", judged(max(seconds) <= 10.5 and max(gaps) <= bar)))
    return ["The same flights with segments of one step, 3 of each.", "", table(("K", "s", "gap", "bar", "reached"), rows)]


def wall_per_second() -> float:
    """Return how long a second of the processor takes at present: a time limit is one of the clock, and others may use the machine."""
    clock, processor = monotonic(), process_time()
    while process_time() < processor + 1.0:
        pass
    return monotonic() - clock


def greedy() -> list[str]:
    """Segment after segment the sensor that costs least in it, in NumPy."""
    rows = []
    for K in (24, 200):
        excess, theirs, ours = [], [], []
        for seed in SEEDS if K == 24 else SEEDS[:3]:
            instance = FlightInstance(Flight(K, seed))
            answer = asked(instance, gap=PROVEN if K == 24 else 4e-3)
            began = process_time()
            chosen = trellis(instance.reference, patterns(4, 1, fewer=False))
            theirs.append(process_time() - began)
            ours.append(answer.seconds)
            excess.append(float(costs(instance.reference, chosen[None])[0]) / answer.found.value - 1)
        rows.append(
            (
                K,
                f"{np.median(excess):.2%}",
                f"{max(excess):.2%}",
                f"{min(excess):.2%}",
                spread(theirs),
                spread(ours),
                judged(min(excess) >= -1e-9),
            )
        )
    header = ("K", "above ours, median", "most", "least", "greedy's s", "our s", "never below")
    return ["Flights as above; ours to 1e-6 at K = 24, to 0.4 % at K = 200.", "", table(header, rows)]
