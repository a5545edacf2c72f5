"""Times of things that are compared: called in turn, so that a slow moment of the machine falls on all of them."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from functools import partial
from time import perf_counter

import numpy as np

MODES = {"machine code": "1", "virtual machine": "0"}
_SWITCH = "OBSDESIGN_COMPILE"


@dataclass(frozen=True)
class Times:
    """Seconds of one call: the best, and the median of all rounds."""

    best: float
    median: float

    @property
    def milliseconds(self) -> tuple[float, float]:
        """Median and best."""
        return 1e3 * self.median, 1e3 * self.best


@dataclass(frozen=True)
class Subject:
    """What is timed, and what is in force while it runs but not timed."""

    call: Callable[[], object]
    around: Callable[[], AbstractContextManager[object]] = nullcontext


@contextmanager
def mode(name: str) -> Iterator[None]:
    """Run obsdesign's loops as MODES says."""
    before = os.environ.get(_SWITCH)
    os.environ[_SWITCH] = MODES[name]
    try:
        yield
    finally:
        if before is None:
            del os.environ[_SWITCH]
        else:
            os.environ[_SWITCH] = before


def in_modes(make: Callable[[str], Callable[[], object]]) -> dict[str, Subject]:
    """Return a call for each of the MODES: each needs systems of its own, as how a system's loops run is settled when they are built."""
    return {name: Subject(make(name), partial(mode, name)) for name in MODES}


def timed(subjects: Mapping[str, Subject], rounds: int = 5, budget: float = 0.1) -> dict[str, Times]:
    """Call each in turn, once to warm up and then in every round at least once and for `budget` seconds."""
    for subject in subjects.values():
        with subject.around():
            subject.call()
    seconds: dict[str, list[float]] = {name: [] for name in subjects}
    for _ in range(rounds):
        for name, subject in subjects.items():
            with subject.around():
                seconds[name] += _calls(subject.call, budget)
    return {name: Times(min(values), float(np.median(values))) for name, values in seconds.items()}


def once(call: Callable[[], object]) -> tuple[float, object]:
    """Return the seconds of one call, and its result."""
    start = perf_counter()
    result = call()
    return perf_counter() - start, result


def _calls(call: Callable[[], object], budget: float) -> list[float]:
    seconds, spent = [], 0.0
    while not seconds or spent < budget:
        seconds.append(once(call)[0])
        spent += seconds[-1]
    return seconds


def ratios(slow: Times, fast: Times) -> tuple[float, float]:
    """Return slow / fast of the medians and of the best times."""
    return slow.median / fast.median, slow.best / fast.best


def apart(found: np.ndarray, expected: np.ndarray, whole: np.ndarray | None = None) -> float:
    """Return the largest difference of Gramians (..., n, n), entry by entry in units of sqrt(W_ii W_jj), W the whole, else the expected."""
    root = np.sqrt(np.diagonal(expected if whole is None else whole, axis1=-2, axis2=-1))
    scale = root[..., :, None] * root[..., None, :]
    difference = np.abs(found - expected)
    return float(np.max(np.where(difference > 0, difference / np.where(scale > 0, scale, np.finfo(float).tiny), 0.0)))


def judged(difference: float, limit: float) -> str:
    """Return a difference as text that says so when it is larger than it may be."""
    return f"{difference:.1e}" if difference <= limit else f"{difference:.1e} TOO LARGE"
