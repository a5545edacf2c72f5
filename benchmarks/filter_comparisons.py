"""Schedules for a filter on recorded runs, and Stone Soup's: parts of `filter_schedules`."""

from __future__ import annotations

from time import process_time

import obsdesign as od
from benchmarks.filter_instances import PROVEN, RecordedInstance, asked, judged
from benchmarks.kalman_reference import costs
from benchmarks.recorded_runs import FOLDER, described, recorded_runs
from benchmarks.sensor_managers import managed, managed_at_once
from benchmarks.straight_flight import PSD as STRAIGHT_PSD
from benchmarks.straight_flight import SAMPLES, STEP, StraightFlight
from benchmarks.tables import table


def recorded() -> list[str]:
    """Where files are given."""
    runs = recorded_runs()
    if not runs:
        return [f"Not run: {FOLDER} names no folder with plaza1.npz, plaza2.npz and lias_uwb_planar_fast.npz."]
    bars, proofs, filters = {"Plaza 1": (2e-2, 15.0), "Plaza 2": (1e-5, 2.0), "LIAS": (1e-5, 2.0)}, [], []
    for each in runs:
        instance, (bar, most) = RecordedInstance(each), bars[each.name]
        asked(instance, gap=0.5)  # warm
        answer = asked(instance, gap=bar)
        K, S = answer.found.chosen.shape
        reached = judged(answer.found.gap <= bar and answer.seconds <= 1.05 * most)
        proofs.append((each.name, K, S, f"{answer.seconds:.2f}", f"{answer.found.gap:.1e}", f"{bar:.2g} in {most:g} s", reached))
        filters.append(instance.compared(answer.found.chosen))
    text = [
        "One sensor on in segments of 10 s, along the true path, with the samples that arrived: cost is the position's mean variance.",
        "Below, an EKF on the log with only the chosen sensors: root mean square position error [m]. 20 random schedules.",
        *(f"- {line}" for line in described(runs)),
    ]
    header = ("", "all on", "chosen", "greedy", "round robin", "for the start", "random, best", "median", "beaten", "bar 95 %")
    return [*text, "", table(("", "K", "S", "s", "gap", "bar", "reached"), proofs), "", table(header, filters)]


def stone_soup() -> list[str]:
    """The same reward for all."""
    rows = []
    for K in (5, 12):
        flight = StraightFlight(K)
        options = {"segment": SAMPLES * STEP, "disturbance_psd": STRAIGHT_PSD, "about": ("x", "y"), "gap": PROVEN}
        od.select_for_filter(flight.system, flight.path, flight.prior, **options)  # warm
        began = process_time()
        found = od.select_for_filter(flight.system, flight.path, flight.prior, **options)
        seconds = process_time() - began
        rows.append((K, "obsdesign", "all segments, proven", f"{found.value:.6f}", "", f"{seconds:.3f}", f"{found.gap:.0e}"))
        others = [*managed(flight), *([managed_at_once(flight)] if K == 5 else [])]
        for other in others:
            value = float(costs(flight.reference, other.chosen[None])[0])
            if value < found.bound * (1 - 1e-9):
                raise AssertionError(f"{other.name} has {value}, below the bound {found.bound}")
            above = max(0.0, value / found.value - 1)
            rows.append((K, other.name, other.horizon, f"{value:.6f}", f"{above:.2%}", f"{other.seconds:.3f}", ""))
    return [
        "A vehicle of nearly constant velocity flies straight past four beacons and ranges to one of them for 5 s at a time. Reward: minus",
        "the trace of the posterior position covariance, summed over the samples; value: its mean [m^2]. Stone Soup's managers decide for",
        "the next segment only: brute force tries every action, which is the greedy choice; the optimising ones search the same reward by",
        "scipy's brute and basinhopping; the tree search looks three segments ahead, 100 rounds each. Last, brute force is given a radio",
        "for each segment, so that it decides on all at once: trying all schedules, by its own filter. Nothing bounds what is left.",
        "",
        table(("K", "", "looks at", "value", "above ours", "s", "gap"), rows),
    ]
