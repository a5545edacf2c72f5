"""Information along paths: time against pybounds, against C written by hand, of gradients and of batches, and how it grows."""

from __future__ import annotations

from functools import partial
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import obsdesign as od
from benchmarks import peers
from benchmarks.batches import batches
from benchmarks.gradients import gradients
from benchmarks.growth import growth
from benchmarks.hand_written import against_c
from benchmarks.scene import START, STEP, controls, flown, unicycle
from benchmarks.tables import machine, table, write
from benchmarks.timing import MODES, Times, apart, in_modes, judged, once, ratios, timed

WINDOW = 20


def main() -> None:
    """Write benchmarks/information.md."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        parts = [
            "# Information along paths: time and growth",
            "",
            machine(),
            "Ratios come first: of the medians, then of the best times, of repeated calls in one process and in turn. obsdesign runs its",
            "loops as machine code or in CasADi's virtual machine, both warm. Differences of Gramians are in units of sqrt(W_ii W_jj),",
            "entry by entry.",
            "",
            *_section("Against pybounds", against_pybounds(folder)),
            *_section("Against hand-written C", against_c()),
            *_section("Windows", windows(folder)),
            *_section("Gradients", gradients()),
            *_section("Growth", growth()),
            *_section("Batches", batches()),
        ]
    write("information", "\n".join(parts))


def _section(title: str, lines: list[str]) -> list[str]:
    return [f"## {title}", "", *lines, ""]


# ---------------------------------------------------------------- pybounds


def _total(system: od.System) -> np.ndarray:
    path = od.simulate(system, START, controls(100), STEP)
    return od.variational_gramian(system, path).total


def against_pybounds(folder: Path) -> list[str]:
    """From the start and 100 controls to W: simulation included, in both."""
    theirs, ours = peers.gramians(folder), in_modes(lambda loops: partial(_total, unicycle(loops)))
    times = timed({**theirs, **ours}, rounds=3)
    rows = []
    for name in theirs:
        difference = judged(apart(np.asarray(theirs[name].call()), _total(unicycle())), 1e-3)
        rows.append((name, *_against(times, name), *times[name].milliseconds, difference))
    return [
        f"Unicycle in constant wind, 5 states, 4 sensors, 100 steps of 0.1 s, from the controls to W. pybounds {version('pybounds')}, jax",
        f"{version('jax')}. pybounds makes JAX compile at every call; in the last row JAX finds all of it in a folder. Bars, against",
        "differences: >= 2,500 as machine code, >= 1,000 in the virtual machine.",
        "",
        table(("pybounds", *_ratio_header(), "ms", "best ms", "difference of W"), rows),
        "",
        table(("obsdesign", "ms", "best ms"), [(name, *times[name].milliseconds) for name in ours]),
    ]


def _ratio_header() -> tuple[str, ...]:
    return tuple(f"{what}{name}" for name in MODES for what in ("", "best, "))


def _against(times: dict[str, Times], theirs: str) -> tuple[float, ...]:
    return tuple(value for ours in MODES for value in ratios(times[theirs], times[ours]))


# ---------------------------------------------------------------- windows


def windows(folder: Path) -> list[str]:
    """Every window of 20 samples of 100."""
    path = flown(100)
    theirs = peers.windows(path, WINDOW, folder)
    ours = in_modes(lambda loops: partial(od.sliding_information, unicycle(loops), path, WINDOW))
    times = timed({**theirs, **ours}, rounds=3)
    found = od.sliding_information(unicycle(), path, WINDOW).sum(axis=1)
    seconds, plain = once(partial(peers.plain_windows, path, WINDOW))
    times["differences, IDAS, once"] = Times(seconds, seconds)
    rows = [(name, *_against(times, name), *times[name].milliseconds) for name in times if name not in ours]
    by_jax, by_differences = (judged(apart(found, peers.fisher_of(each)), 1e-3) for each in (theirs["JAX"].call(), plain))
    return [
        f"{len(found)} windows of {WINDOW} samples along a path of 100: obsdesign to the information of every window and sensor, pybounds",
        "to the derivatives of the outputs, not yet multiplied. Bar: >= 100 against JAX.",
        "",
        table(("pybounds", *_ratio_header(), "ms", "best ms"), rows),
        "",
        table(("obsdesign", "ms", "best ms"), [(name, *times[name].milliseconds) for name in ours]),
        "",
        f"Difference of the information of the windows: {by_jax} to JAX, {by_differences} to differences.",
    ]
