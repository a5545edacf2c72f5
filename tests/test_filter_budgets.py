"""Budgets of schedules for the filter: prices that bound, against all schedules of small problems."""

from __future__ import annotations

import numpy as np
import pytest
from all_schedules import SmallProblem, keeps_dwell, random_problem, switch_ons

import obsdesign as od


def _budget(random: np.random.Generator, schedules: np.ndarray) -> tuple[od.EnergyBudget | od.MaxUses, np.ndarray]:
    """Return a limit of a sum, and which schedules (B,) keep it."""
    _, K, S = schedules.shape
    if random.random() < 0.4:
        sensor, most = int(random.integers(S)), int(random.integers(0, K + 1))
        return od.MaxUses(sensor, most), schedules[:, :, sensor].sum(axis=1) <= most
    cost, start = random.uniform(0, 2, S), random.uniform(0, 1, S) * (random.random() < 0.5)
    limit = float(random.uniform(0.3, 0.8) * K * (cost + start).max())
    rule = od.EnergyBudget(limit, cost=dict(enumerate(cost.tolist())), start=dict(enumerate(start.tolist())))
    return rule, schedules.sum(axis=1) @ cost + switch_ons(schedules) @ start <= limit


def _costs(problem: SmallProblem, schedules: np.ndarray, over: str) -> np.ndarray:
    costs = np.trace(problem.covariances(schedules), axis1=2, axis2=3)
    return {"mean": costs.mean(axis=1), "worst": costs.max(axis=1), "end": costs[:, -1]}[over]


@pytest.mark.parametrize("over", ["mean", "worst", "end"])
@pytest.mark.parametrize("seed", range(8))
def test_within_one_and_two_budgets_the_schedule_is_the_best_of_all(seed: int, over: str) -> None:
    """Tried on 400 such problems: none is better, and no bound is above the best."""
    random = np.random.default_rng([seed, 31])
    problem = random_problem(random, 1000)
    schedules = problem.schedules
    budgets = [_budget(random, schedules) for _ in range(1 + seed % 2)]
    rules, keeps = [rule for rule, _ in budgets], np.logical_and.reduce([kept for _, kept in budgets])
    if seed % 4 == 3:
        rules.append(od.MinimumDwell(2))
        keeps &= keeps_dwell(schedules, 2)
    best = _costs(problem, schedules[keeps], over).min()
    schedule = od.select_for_filter(**problem.question, over=over, rules=rules, gap=1e-6)
    assert schedule.value == pytest.approx(best, rel=2e-6)
    assert schedule.bound <= best * (1 + 1e-12)
    assert schedule.status is od.Status.OPTIMAL
    assert keeps[(schedules == schedule.chosen).all(axis=(1, 2))].all()


@pytest.mark.parametrize("prices", [0.0, 0.3, 3.0, 300.0])
def test_every_price_bounds(prices: float) -> None:
    """L(mu) is below the best schedule within the budget for every mu >= 0, and the prices that are taken bound no less."""
    from obsdesign.criteria.trace_inverse import TraceInverse
    from obsdesign.selection.posterior.formulation import problem_of
    from obsdesign.selection.posterior.options import build_options
    from obsdesign.selection.posterior.questions import FilterSettings, build_question
    from obsdesign.selection.posterior.resource_prices import best_prices, priced_chain
    from obsdesign.selection.posterior.windows import single_layers

    random = np.random.default_rng(5)
    small = random_problem(random, 3000)
    rules = (od.EnergyBudget(0.3 * small.segments, cost=1.0),)
    given = small.question
    per_segment = given.pop("per_segment")
    along = [given.pop(name) for name in ("system", "path", "prior")]
    settings = FilterSettings(**given, unknown_inputs=(), about=None, over="mean", criterion=TraceInverse(), scale=None, floor=None)
    question = build_question(*along, settings)
    problem = problem_of(question, build_options(rules, per_segment, question.segments, question.answers))
    layers, limits = single_layers(problem), problem.options.limits

    def dual(mu: np.ndarray) -> float:
        return priced_chain(layers, mu)[0] - float(mu @ limits)

    schedules = small.schedules
    best = _costs(small, schedules[schedules.sum(axis=(1, 2)) <= limits[0]], "mean").min()
    assert dual(np.array([prices])) <= best * (1 + 1e-9)
    assert dual(best_prices(problem, layers)) >= dual(np.array([prices])) - 1e-3 * abs(best)


@pytest.mark.parametrize("psd", [1e-4, 1.0])
def test_one_use_goes_where_it_is_worth_the_most(psd: float) -> None:
    """A float that drifts may look once at its position: the best of all 60 times for it is known by trying all of them."""
    system, scale = od.System(od.Dubins(1.0, wind="constant"), (od.GPS(2.0), od.Magnetometer(0.2))), np.array([5.0, 5.0, 0.1, 0.3, 0.3])
    turns = np.repeat(np.random.default_rng(0).uniform(-0.1, 0.1, 60), 5)[:, None]
    path = od.simulate(system, [0.0, 0.0, 0.0, 0.2, 0.1], turns, 1.0)
    prior, noise = od.Prior([0.0, 0.0, 0.0, 0.2, 0.1], std=scale), [psd, psd, 1e-4, 1e-4, 1e-4]
    tried = []
    for k in range(60):
        on = np.repeat(np.arange(60) == k, 5)
        J = od.posterior_information(system, path, prior, noise, active=np.column_stack([on, ~on]))[:-1]
        tried.append(np.trace(np.linalg.inv(scale[:, None] * J * scale), axis1=1, axis2=2).mean())
    once = od.MaxUses("gps", 1)
    schedule = od.select_for_filter(system, path, prior, segment=5.0, disturbance_psd=noise, scale=scale, rules=[once], gap=0.99)
    assert schedule.chosen[:, 0].sum() <= 1
    assert schedule.value <= min(tried) * (1 + 1e-9)
