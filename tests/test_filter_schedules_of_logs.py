"""Schedules for the filter along steps of any length and on a log: brute force, and equal steps seen as any."""

from itertools import product

import numpy as np
import pytest

import obsdesign as od
from obsdesign.trajectory import uneven_path_of

SYSTEM = od.System(
    od.Unicycle(),
    (od.Range((20.0, 0.0), 0.3, name="a", max_range=15.0), od.Range((0.0, 20.0), 0.5, name="b"), od.Range((-15.0, -5.0), 0.4, name="c")),
)
LENGTHS = np.random.default_rng(1).uniform(0.1, 0.6, 36)
PATH = od.simulate(SYSTEM, [0.0, 0.0, 0.2], np.tile([1.5, 0.15], (36, 1)), LENGTHS)
PRIOR = od.Prior(PATH.x[0], std=(1.0, 1.0, 0.2))
PSDS = {"disturbance_psd": (0.02, 0.02, 0.0), "input_psd": {"turn_rate": 0.01}}
TIMES = np.sort(np.random.default_rng(2).uniform(PATH.t[0], PATH.t[-1], 60))
LOG = od.Log(
    od.LogInputs(("speed", "turn_rate"), PATH.t[:-1], PATH.u),
    od.LogSamples(("a", "b", "c"), TIMES, np.arange(60) % 3, np.ones(60), np.where(np.arange(60) % 5, np.nan, 0.2)),
)


def segment_of_step(count: int) -> np.ndarray:
    """Segments of five seconds: which one each step of the path begins in."""
    return np.minimum(((PATH.t[:-1] - PATH.t[0]) / 5.0).astype(int), count - 1)


def test_along_steps_of_any_length_the_schedule_is_the_best_of_all():
    active = np.random.default_rng(3).random((36, 3)) < 0.6
    schedule = od.select_for_filter(SYSTEM, PATH, PRIOR, segment=5.0, active=active, about=("x", "y"), gap=1e-6, **PSDS)  # pyright: ignore
    segment = segment_of_step(len(schedule.chosen))
    costs = {}
    for picks in product(range(3), repeat=len(schedule.chosen)):
        mask = active & (np.arange(3) == np.array(picks)[segment][:, None])
        P = np.linalg.inv(od.posterior_information(SYSTEM, PATH, PRIOR, active=mask, **PSDS))[:-1]  # pyright: ignore
        costs[picks] = (P[:, 0, 0] + P[:, 1, 1]) @ PATH.lengths / PATH.lengths.sum()
    assert schedule.value == pytest.approx(min(costs.values()), rel=1e-6)
    assert schedule.bound <= schedule.value * (1 + 1e-12) and schedule.gap < 1e-3


def test_with_samples_of_a_log_the_schedule_is_the_best_of_all():
    boundaries = [float(PATH.t[k]) for k in (0, 12, 24, 36)]
    weights = np.linspace(0.0, 1.0, 36)  # of what is known at the instants of the path
    schedule = od.select_for_filter(SYSTEM, PATH, PRIOR, segment=boundaries, samples=LOG, over=weights, gap=1e-6, **PSDS)  # pyright: ignore
    costs, deviations = {}, {}
    for picks in product(range(3), repeat=3):
        mask = np.arange(3) == np.repeat(picks, 12)[:, None]
        J = od.posterior_information(SYSTEM, PATH, PRIOR, active=mask, samples=LOG, **PSDS)  # pyright: ignore
        costs[picks] = np.trace(np.linalg.inv(J)[:-1], axis1=1, axis2=2) @ weights
        deviations[picks] = od.standard_deviations(J)[:-1]
    best = min(costs, key=costs.__getitem__)
    assert tuple(int(np.argmax(row)) for row in schedule.chosen) == best
    assert schedule.value == pytest.approx(costs[best], rel=1e-6)
    np.testing.assert_allclose(schedule.predicted, deviations[best], rtol=1e-6)
    assert schedule.bound <= schedule.value * (1 + 1e-12) and schedule.gap < 1e-3


def test_equal_steps_seen_as_steps_of_any_length_have_the_same_schedule():
    path = od.simulate(SYSTEM, [0.0, 0.0, 0.2], np.tile([1.5, 0.15], (24, 1)), 0.5)
    seen = uneven_path_of(path, path.t, path.x, path.u, None)
    schedules = [od.select_for_filter(SYSTEM, each, PRIOR, segment=3.0, **PSDS) for each in (path, seen)]  # pyright: ignore
    assert schedules[0].value == pytest.approx(schedules[1].value, rel=1e-9)
    np.testing.assert_array_equal(schedules[0].chosen, schedules[1].chosen)
    require = (od.Requirement(about=("x", "y"), at_most=0.8, after=6.0),)
    cheap = [od.cheapest_schedule(SYSTEM, each, PRIOR, require=require, segment=3.0, **PSDS) for each in (path, seen)]  # pyright: ignore
    assert cheap[0].value == cheap[1].value


def test_boundaries_that_do_not_begin_with_the_path_are_refused():
    with pytest.raises(od.InputError, match="segment has times"):
        od.select_for_filter(SYSTEM, PATH, PRIOR, segment=[1.0, 2.0, 3.0], **PSDS)  # pyright: ignore
