"""A time limit ends the whole call: whenever it is over, what is returned is true, and what was left out is said.

The clock is one that jumps by a day after so many looks at it, so that a call is cut at every place where it looks.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from test_cheapest_schedules import random_question
from test_filter_losses import random_losses
from test_filter_schedules import brute_force, random_instance

import obsdesign as od
from benchmarks.flights import PSD, UNITS, Flight
from obsdesign.selection.posterior import deadline
from obsdesign.selection.posterior.segment_maps import SegmentMaps

_DAY = 86_400.0


@dataclass
class _JumpingClock:
    """Stands still, and is a day on from the n-th look."""

    looks: int

    def __call__(self) -> float:
        self.looks -= 1
        return 0.0 if self.looks >= 0 else _DAY


@pytest.fixture
def cut_after(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], None]:
    """Return what makes any time limit be over after so many looks at the clock."""
    return lambda looks: monkeypatch.setattr(deadline, "monotonic", _JumpingClock(looks + 1))


@pytest.mark.parametrize("seed", [1, 3, 6, 20, 33])
def test_wherever_it_is_cut_bounds_hold_and_schedules_cost_what_is_said(seed: int, cut_after: Callable[[int], None]) -> None:
    """Bound <= best of all <= value; cut at once the gap is open and the notes say why, never cut it is closed and nothing is said."""
    question = random_instance(seed)
    best = brute_force(question)
    tolerance = 1e-9 * max(1.0, abs(best))
    for looks in (0, 1, 2, 3, 5, 8, 13, 21, 34, 55, 10**9):
        cut_after(looks)
        schedule = od.select_for_filter(**question, gap=1e-7, time_limit=1.0, throw=False)
        if not np.isfinite(best):
            assert not schedule.status.has_answer
            continue
        assert schedule.bound <= best + tolerance
        assert schedule.value >= best - tolerance
        is_cut = any("time was up" in note for note in schedule.notes)
        assert schedule.status is od.Status.OPTIMAL or is_cut
        assert not np.isnan(schedule.prices).any() or is_cut
        if looks == 0:
            assert [other.name for other in schedule.compared] == []
            assert is_cut
        if looks == 10**9:
            assert not is_cut
            assert schedule.value == pytest.approx(best, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_with_losses_too(seed: int, cut_after: Callable[[int], None]) -> None:
    """The value is the worst loss of the schedule, whether that loss was searched for or not."""
    small, costs = random_losses(seed)
    for looks in (0, 2, 5, 10, 20, 40):
        cut_after(looks)
        schedule = od.select_for_filter(**small.question, robust_to=1, gap=1e-6, time_limit=1.0)
        assert schedule.bound <= costs.min() * (1 + 1e-12)
        assert schedule.value == pytest.approx(costs[(small.schedules == schedule.chosen).all(axis=(1, 2))].min(), rel=1e-7)


@pytest.mark.parametrize("seed", range(3))
def test_with_requirements_too(seed: int, cut_after: Callable[[int], None]) -> None:
    """Bound <= least cost of all that keep them <= value; impossible only where it is; stopped for time only where it was."""
    question, _, schedules, costs = random_question(seed)
    least = costs.min(initial=np.inf)
    for looks in (0, 2, 4, 6, 10, 20, 10**9):
        cut_after(looks)
        schedule = od.cheapest_schedule(**question, time_limit=1.0, gap=1e-9, throw=False)
        if schedule.status.has_answer:
            assert schedule.bound <= least * (1 + 1e-9) <= schedule.value * (1 + 2e-9)
            assert (schedules == schedule.chosen).all(axis=(1, 2)).any()
        assert schedule.status is not od.Status.INFEASIBLE or not len(schedules)
        assert schedule.status is not od.Status.TIME_LIMIT or looks < 10**9


def test_cut_at_once_nothing_but_the_greedy_schedule_is_simulated(
    monkeypatch: pytest.MonkeyPatch, cut_after: Callable[[int], None]
) -> None:
    """K segments under A options each, no more: the rest of the call's work is under the limit too."""
    flight, steps, advance = Flight(30, 0), [], SegmentMaps.advance

    def counted(maps: SegmentMaps, segment: np.ndarray, option: np.ndarray, P: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        steps.append(len(option))
        return advance(maps, segment, option, P)

    monkeypatch.setattr(SegmentMaps, "advance", counted)
    cut_after(0)
    schedule = od.select_for_filter(
        flight.system, flight.path, flight.prior, segment=flight.length, disturbance_psd=PSD, scale=UNITS, time_limit=1.0
    )
    options = 1 + len(flight.system.model.channels)
    assert sum(steps) <= 30 * (options + 1)  # and the schedule's own walk
    assert 0 < schedule.bound < schedule.value
    assert schedule.bound_by.startswith("all sensors")
