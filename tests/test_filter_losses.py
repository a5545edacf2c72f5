"""Schedules for the filter that may lose a sensor, against all schedules of small problems."""

from __future__ import annotations

import numpy as np
import pytest
from all_schedules import SmallProblem, random_problem

import obsdesign as od


def random_losses(seed: int) -> tuple[SmallProblem, np.ndarray]:
    """Return a problem of two or three sensors, and the cost of each schedule (B,) under its worst loss of one."""
    random = np.random.default_rng([seed, 5])
    small = random_problem(random, 600)
    while len(small.C) < 2:
        small = random_problem(random, 600)
    schedules = small.schedules
    costs = []
    for lost in range(len(small.C)):
        left = schedules.copy()
        left[:, :, lost] = False
        costs.append(np.trace(small.covariances(left), axis1=2, axis2=3).mean(axis=1))
    return small, np.max(costs, axis=0)


@pytest.mark.parametrize("seed", range(10))
def test_the_bound_for_the_worst_loss_holds_for_every_schedule(seed: int) -> None:
    """Tried on 300: no schedule is below the bound; value is the worst loss of the one returned; OPTIMAL is the best of all."""
    small, costs = random_losses(seed)
    schedule = od.select_for_filter(**small.question, robust_to=1, gap=1e-6)
    chosen = (small.schedules == schedule.chosen).all(axis=(1, 2))
    assert schedule.bound <= costs.min() * (1 + 1e-12)
    assert schedule.value == pytest.approx(costs[chosen].min(), rel=1e-7)
    if schedule.status is od.Status.OPTIMAL:
        assert schedule.value == pytest.approx(costs.min(), rel=2e-6)
    assert schedule.value <= min(other.value for other in schedule.compared if other.name.startswith("greedy")) * (1 + 1e-9)


def test_losing_as_many_as_there_are_is_refused() -> None:
    small, _ = random_losses(0)
    with pytest.raises(od.InputError, match="robust_to is 3"):
        od.select_for_filter(**small.question, robust_to=3)
