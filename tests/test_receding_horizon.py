"""In flight: what to switch on next, sensors that answer now and then, what was on, floors, and the regret afterwards."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import obsdesign as od
from obsdesign.dynamics.answering_system import AnsweringSystem

_SYSTEM = od.System(
    od.Dubins(speed=15.0, wind="constant"),
    sensors=(od.GPS(sigma=5.0), od.Magnetometer(sigma=0.2), od.Range(beacon=(500.0, 200.0), sigma=3.0)),
)
_BELIEF = od.Prior(mean=(0.0, 0.0, 0.0, 2.0, -1.0), std=(50.0, 50.0, 0.5, 5.0, 5.0))
_PSD = (0.25, 0.25, 1e-4, 0.01, 0.01)
_INPUTS = np.repeat(np.random.default_rng(0).uniform(-0.15, 0.15, (6, 1)), 5, axis=0)
_KEYWORDS = {"segment": 5.0, "disturbance_psd": _PSD, "scale": _BELIEF.std}


def _path() -> od.Trajectory:
    return od.simulate(_SYSTEM, _BELIEF.mean, _INPUTS, 1.0)


def test_the_stretch_ahead_is_the_schedule_for_the_mean():
    ahead = od.select_next(_SYSTEM, _BELIEF, _INPUTS, 1.0, gap=1e-6, **_KEYWORDS)
    whole = od.select_for_filter(_SYSTEM, _path(), _BELIEF, gap=1e-6, **_KEYWORDS)
    assert ahead.value == pytest.approx(whole.value, rel=1e-9)
    assert ahead.status is od.Status.OPTIMAL


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"inputs_ahead": np.full((6, 1), np.nan)}, "u"),
        ({"inputs_ahead": np.zeros((6, 2))}, "u"),
        ({"step": -1.0}, "dt"),
        ({"answer_share": {"gps": 2.0}}, "answer_share of gps is 2.0"),
        ({"answer_share": {"sonar": 0.5}}, "sonar"),
        ({"waiting": ("sonar",)}, "sonar"),
        ({"belief": None}, "mean"),
        ({"system": None}, "system is None"),
        ({"per_segment": 9}, "per_segment"),
    ],
)
def test_it_never_raises(change, said):
    arguments = {"system": _SYSTEM, "belief": _BELIEF, "inputs_ahead": _INPUTS, "step": 1.0, **_KEYWORDS} | change
    schedule = od.select_next(**arguments)
    assert not schedule.status.has_answer
    assert said in " ".join(schedule.notes)


def test_a_sensor_that_answers_never_is_not_there():
    """With share 0 of the GPS the cost is that of the suite without it."""
    alone = od.System(_SYSTEM.vehicle, sensors=_SYSTEM.sensors[1:])
    without = od.select_next(alone, _BELIEF, _INPUTS, 1.0, gap=1e-6, **_KEYWORDS)
    never = od.select_next(_SYSTEM, _BELIEF, _INPUTS, 1.0, gap=1e-6, answer_share={"gps": 0.0}, **_KEYWORDS)
    assert never.value == pytest.approx(without.value, rel=1e-9)


def test_information_counts_with_the_share():
    """A share of 1 / 4 is a sigma twice as large: the information of a sample is gate / sigma^2."""
    system = AnsweringSystem(_SYSTEM, (0.25, 1.0, 1.0))
    doubled = od.System(_SYSTEM.vehicle, sensors=(od.GPS(sigma=10.0), *_SYSTEM.sensors[1:]))
    J = [od.posterior_information(one, _path(), _BELIEF, _PSD) for one in (system, doubled)]
    np.testing.assert_allclose(J[0], J[1], rtol=1e-9)


def test_a_sensor_stays_on_until_it_answers():
    free = od.select_next(_SYSTEM, _BELIEF, _INPUTS, 1.0, **_KEYWORDS)
    waiting = od.select_next(_SYSTEM, _BELIEF, _INPUTS, 1.0, waiting=("magnetometer",), **_KEYWORDS)
    assert waiting.chosen[0].tolist() == [False, True, False]
    assert free.chosen[0].tolist() != waiting.chosen[0].tolist()
    assert waiting.value >= free.bound


@pytest.mark.parametrize("rule", [od.MaxUses("magnetometer", 0), od.EnergyBudget(2.0, {"magnetometer": 3.0})], ids=("uses", "energy"))
def test_a_sensor_for_which_a_limit_leaves_nothing_is_not_waited_for(rule: od.MaxUses | od.EnergyBudget):
    """Where no schedule has it on, the answer is that of not waiting."""
    free = od.select_next(_SYSTEM, _BELIEF, _INPUTS, 1.0, rules=(rule,), **_KEYWORDS)
    waiting = od.select_next(_SYSTEM, _BELIEF, _INPUTS, 1.0, rules=(rule,), waiting=("magnetometer",), **_KEYWORDS)
    assert waiting.status.has_answer
    assert waiting.value == free.value


def test_what_is_on_need_not_be_switched_on():
    """With the schedule's own first sensor on before, the cost is less by exactly one switching-on."""
    rules = (od.SwitchingCost(0.01),)
    cold = od.select_next(_SYSTEM, _BELIEF, _INPUTS, 1.0, gap=1e-7, rules=rules, **_KEYWORDS)
    (first,) = np.flatnonzero(cold.chosen[0])
    warm = od.select_next(_SYSTEM, _BELIEF, _INPUTS, 1.0, gap=1e-7, rules=rules, on=(_SYSTEM.sensor_names[first],), **_KEYWORDS)
    assert warm.value == pytest.approx(cold.value - 0.01, rel=1e-6)


def test_what_was_flown_is_rated_by_the_bound():
    """No schedule saves more than 1 - bound / cost of what was flown: the best one saves nearly that, and flown itself nothing."""
    best = od.select_for_filter(_SYSTEM, _path(), _BELIEF, gap=1e-7, **_KEYWORDS)
    other = np.roll(best.chosen, 1, axis=1)
    rated = od.select_for_filter(_SYSTEM, _path(), _BELIEF, gap=1e-7, flown=other, **_KEYWORDS)
    flown = rated.compared[-1]
    assert flown.value > best.value
    J = od.posterior_information(_SYSTEM, _path(), _BELIEF, _PSD, active=np.repeat(other, 5, axis=0).astype(float))[:-1]
    mean = np.mean([np.trace(np.linalg.inv(matrix) / np.outer(_BELIEF.std, _BELIEF.std)) for matrix in J])
    assert flown.value == pytest.approx(mean, rel=1e-9)
    assert f"{100 * (1 - rated.bound / flown.value):.3g} %" in rated.notes[-1]


def test_what_broke_the_rules_when_flown_may_cost_less_than_all_that_keep_them():
    """With all sensors on, where one at a time may be: no share is saved."""
    everything = np.ones((6, 3), dtype=bool)
    rated = od.select_for_filter(_SYSTEM, _path(), _BELIEF, flown=everything, **_KEYWORDS)
    assert rated.compared[-1].value < rated.bound
    assert rated.notes[-1].endswith(f"less than any schedule within the rules: these cost at least {rated.bound:.4g}")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"flown": np.full((6, 3), 2.0)}, "flown has the entry 2: must be true or false"),
        ({"flown": np.zeros((5, 3))}, r"flown has shape \(5, 3\): must be \(6, 3\)"),
        ({"segment": (0.0, 10.0, 5.0, 30.0)}, "segment has the time 5 s after 10 s: must rise"),
        ({"segment": (0.0, 10.0, 10.0, 30.0)}, "segment has the time 10 s after 10 s: must rise"),
        ({"segment": (5.0, 30.0)}, "segment goes from 5 s to 30 s: must rise from 0 s to 30 s"),
        ({"segment": (0.0, 2.5, 30.0)}, "segment has the time 2.5 s: must be at a step of the path"),
        ({"segment": 2.5}, "segment is 2.5 s: must be a whole multiple of the path's step"),
        ({"over": -np.ones(30)}, "over has the entry -1"),
        ({"over": np.zeros(30)}, "over is 0 everywhere"),
        ({"disturbance_psd": (1.0, 1.0, -1.0, 0.0, 0.0)}, "disturbance_psd has the eigenvalue -1"),
    ],
)
def test_what_cannot_be_meant_is_named(change: dict[str, Any], message: str):
    with pytest.raises(od.InputError, match=message):
        od.select_for_filter(_SYSTEM, _path(), _BELIEF, **(_KEYWORDS | change))


def test_doubled_sigmas_with_doubled_floor_double_the_deviations():
    """A state that only noise moves: sigma, floor and prior doubled make every covariance four times as large."""
    costs = []
    for factor in (1.0, 2.0):
        sensors = (od.GPS(sigma=3.0 * factor), od.Range(beacon=(100.0, 0.0), sigma=factor))
        system = od.System(od.Omnidirectional(), sensors=sensors)
        path = od.simulate(system, (0.0, 10.0, 0.3), np.zeros((12, 3)), 1.0)
        prior = od.Prior(mean=(0.0, 10.0, 0.3), std=(20.0 * factor, 20.0 * factor, factor))
        psd = np.array([1.0, 1.0, 0.1]) * factor**2
        schedule = od.select_for_filter(system, path, prior, segment=3.0, disturbance_psd=psd, floor={"gps": 0.5 * factor}, gap=1e-6)
        costs.append(schedule.value)
        assert schedule.notes
    assert costs[1] == pytest.approx(4 * costs[0], rel=1e-9)


def test_a_floor_is_an_error_that_a_segment_has_in_common():
    """Static scalar: n samples of sigma with a common error of deviation b know no more than (sigma^2 / n + b^2)^1/2."""
    import casadi as ca

    x = ca.SX.sym("x", 1)
    system = od.ControlAffineSystem(x, ("x",), drift=ca.SX(0), outputs={"y": x})
    path = od.simulate(system, np.zeros(1), np.zeros((8, 0)), 1.0)
    prior = od.Prior(mean=np.zeros(1), std=(10.0,))
    schedule = od.select_for_filter(system, path, prior, segment=4.0, over="end", floor={"y": 0.7}, gap=1e-6)
    information = 1 / 100 + 2 / (1 / 4 + 0.49)
    assert schedule.value == pytest.approx(1 / information, rel=1e-9)
    assert schedule.predicted[-1, 0] == pytest.approx((1 / 100 + 8) ** -0.5, rel=1e-9)


def test_what_an_unknown_input_moves_is_hidden_however_little_it_moves_it():
    """x+ = x + b w with w anything leaves nothing of any state that b moves, b = (1e-3, 1, 1) beside a prior of (1, 1e-6, 1e-6)."""
    from obsdesign.selection.posterior.questions import deviations_of_roots

    b, T = np.array([1e-3, 1.0, 1.0]), np.diag([1.0, 1e6, 1e6])
    g = T @ b
    roots = (T - np.outer(g, g @ T) / (g @ g))[None]
    assert np.isinf(deviations_of_roots(roots)).all()


def test_deviations_of_roots_are_those_of_the_covariance():
    """P = (R'R)^-1 with units from 1e-9 to 1e9, against exact fractions of a triangular R."""
    from fractions import Fraction

    from obsdesign.selection.posterior.questions import deviations_of_roots

    random = np.random.default_rng(3)
    for _ in range(50):
        n = int(random.integers(1, 5))
        R = np.triu(random.normal(size=(n, n))) * 10.0 ** random.uniform(-9, 9, n)
        exact = [[Fraction(0)] * n for _ in range(n)]
        for j in range(n):
            for i in range(n - 1, -1, -1):
                rest = Fraction(int(i == j)) - sum(Fraction(R[i, k]) * exact[k][j] for k in range(i + 1, n))
                exact[i][j] = rest / Fraction(R[i, i])
        expected = [float(sum(entry**2 for entry in row)) ** 0.5 for row in exact]
        np.testing.assert_allclose(deviations_of_roots(R[None])[0], expected, rtol=1e-7)
