"""Schedules for the filter against all schedules of small problems, with a Kalman filter of the test's own."""

from __future__ import annotations

from itertools import combinations, product

import casadi as ca
import numpy as np
import pytest
from conftest import seeds

import obsdesign as od

_OVER = ("mean", "worst", "end")
_CRITERIA = (od.TraceInverse(), od.MinEigenvalue(), od.LogDet())


def _random_system(random: np.random.Generator, n: int, sensors: int) -> od.ControlAffineSystem:
    """Return a linear system x' = A x with sensors of one row each."""
    x = ca.SX.sym("x", n)
    A, C = random.normal(size=(n, n)) - 0.5 * np.eye(n), random.normal(size=(sensors, n))
    outputs = {f"y{s}": ca.mtimes(ca.DM(C[s : s + 1]), x) for s in range(sensors)}
    return od.ControlAffineSystem(x, tuple(f"s{i}" for i in range(n)), drift=ca.mtimes(ca.DM(A), x), outputs=outputs)


def _covariances(system: od.ControlAffineSystem, prior: od.Prior, psd: np.ndarray, step: float, active: np.ndarray) -> np.ndarray:
    """Return P_k (N, n, n) after the samples at t_k, by Joseph's form; all outputs have sigma 1."""
    from scipy.linalg import expm

    model = system.model
    A = ca.DM(ca.jacobian(model.drift, model.x)).full()
    C = ca.DM(ca.jacobian(model.h, model.x)).full()
    F, P, result = expm(A * step), prior.covariance, []
    for on in active:
        for row in C[on > 0]:
            K = P @ row / (1 + row @ P @ row)
            I_KC = np.eye(len(P)) - np.outer(K, row)
            P = I_KC @ P @ I_KC.T + np.outer(K, K)
        result.append(P)
        P = F @ P @ F.T + np.diag(psd) * step
    return np.array(result)


def _cost(P: np.ndarray, scale: np.ndarray, about: list[int], over: str, criterion: object) -> float:
    block = (P / scale[:, None] / scale)[:, about][:, :, about]
    if isinstance(criterion, od.TraceInverse):
        costs = np.trace(block, axis1=1, axis2=2)
    else:
        costs = np.linalg.eigvalsh(block)[:, -1] if isinstance(criterion, od.MinEigenvalue) else np.linalg.slogdet(block)[1]
    return float({"mean": costs.mean(), "worst": costs.max(), "end": costs[-1]}[over])


def _keeps(rules: tuple, chosen: np.ndarray) -> bool:
    """Whether a schedule keeps the rules that these tests use, written anew."""
    for rule in rules:
        if isinstance(rule, od.MaxUses) and chosen[:, rule.sensor].sum() > rule.most:
            return False
        if isinstance(rule, od.Exclusive) and (chosen[:, list(rule.sensors)].sum(axis=1) > 1).any():
            return False
        if isinstance(rule, od.Requires) and (chosen[:, rule.sensor] & ~chosen[:, rule.other]).any():
            return False
        if isinstance(rule, od.MinimumDwell):
            for column in chosen.T:
                edges = np.flatnonzero(np.diff(np.concatenate([[0], column.astype(int), [0]])))
                if any(b - a < rule.least and b < len(column) for a, b in zip(edges[::2], edges[1::2], strict=True)):
                    return False
    return True


def _switching(rules: tuple, chosen: np.ndarray) -> float:
    starts = (chosen & ~np.vstack([np.zeros((1, chosen.shape[1]), dtype=bool), chosen[:-1]])).sum()
    return sum(rule.cost * float(starts) for rule in rules if isinstance(rule, od.SwitchingCost))


def _rules(random: np.random.Generator, K: int, S: int) -> tuple:
    pool = [
        (),
        (od.MaxUses(0, int(random.integers(0, K))),),
        (od.MinimumDwell(2),),
        (od.SwitchingCost(float(random.uniform(0.0, 0.3))),),
        (od.Exclusive((0, 1)),) if S > 1 else (),
        (od.Requires(0, 1),) if S > 1 else (),
        (od.MaxUses(0, int(random.integers(0, K))), od.MinimumDwell(2)),
    ]
    return pool[int(random.integers(len(pool)))]


def random_instance(seed: int) -> dict:
    """Return a random question of at most 16 decisions."""
    random = np.random.default_rng(seed)
    S = int(random.integers(1, 5))
    K = int(random.integers(1, 12 // S + 1))
    n, per_segment, steps = int(random.integers(1, 5)), int(random.integers(1, min(S, 2) + 1)), int(random.integers(1, 4))
    system, step = _random_system(random, n, S), float(random.uniform(0.05, 0.5))
    N = K * steps
    path = od.simulate(system, np.zeros(n), np.zeros((N, 0)), step)
    prior = od.Prior(mean=np.zeros(n), std=np.exp(random.normal(size=n)))
    psd = np.exp(random.normal(size=n)) * (random.random() < 0.8)
    arrivals = (random.random((N, S)) < random.choice([0.6, 1.0])).astype(float)
    about = sorted(random.choice(n, size=int(random.integers(1, n + 1)), replace=False).tolist())
    return {
        "system": system,
        "path": path,
        "prior": prior,
        "per_segment": per_segment,
        "segment": steps * step,
        "disturbance_psd": psd,
        "about": tuple(f"s{i}" for i in about),
        "over": str(random.choice(_OVER)),
        "criterion": _CRITERIA[int(random.integers(3))],
        "scale": np.exp(random.normal(size=n)),
        "active": arrivals,
        "rules": _rules(random, K, S),
    }


def brute_force(question: dict) -> float:
    """Return the least cost of all schedules that keep the rules; inf where there is none."""
    S = question["active"].shape[1]
    steps = round(question["segment"] / question["path"].step)
    K = len(question["active"]) // steps
    about = [int(name[1:]) for name in question["about"]]
    rows = [np.isin(np.arange(S), on) for size in range(question["per_segment"] + 1) for on in combinations(range(S), size)]
    best = np.inf
    for combination in product(rows, repeat=K):
        chosen = np.array(combination)
        if _keeps(question["rules"], chosen):
            active = np.repeat(chosen, steps, axis=0) * question["active"]
            P = _covariances(question["system"], question["prior"], question["disturbance_psd"], question["path"].step, active)
            cost = _cost(P, question["scale"], about, question["over"], question["criterion"])
            best = min(best, cost + _switching(question["rules"], chosen))
    return best


@pytest.mark.parametrize("seed", seeds(25, 12))
def test_the_schedule_is_the_best_of_all(seed: int) -> None:
    """Of up to 2^16 schedules none is better, and the bound is below all of them, whatever is asked and whatever rules are kept."""
    question = random_instance(seed)
    best = brute_force(question)
    schedule = od.select_for_filter(**question, gap=1e-7)
    size = max(abs(best), 1.0)
    assert schedule.value == pytest.approx(best, abs=1e-6 * size)
    assert schedule.bound <= best + 1e-12 * size
    assert schedule.status is od.Status.OPTIMAL


def test_coasting_through_unstable_motion_costs_what_a_filter_says():
    """What grows is known from roots to all digits that there are, while J^-1 would lose half of them: P+ = F P F' + Q in closed form."""
    x = ca.SX.sym("x", 2)
    system = od.ControlAffineSystem(x, ("a", "b"), drift=ca.vertcat(4 * x[0] + x[1], -3 * x[1]), outputs={"y": x[1]})
    path, step = od.simulate(system, np.zeros(2), np.zeros((16, 0)), 0.25), 0.25
    prior = od.Prior(mean=np.zeros(2), std=(1.0, 1e-3))
    schedule = od.select_for_filter(
        system, path, prior, segment=1.0, disturbance_psd=(1e-4, 1e-6), active=np.zeros((16, 1)), over="end", throw=False
    )
    from scipy.linalg import expm

    F, P = expm(np.array([[4.0, 1.0], [0.0, -3.0]]) * step), prior.covariance
    for _ in range(15):
        P = F @ P @ F.T + np.diag([1e-4, 1e-6]) * step
    assert schedule.value == pytest.approx(np.trace(P), rel=1e-9)


def test_nothing_on_with_an_unknown_input_costs_infinitely_much():
    """Between samples an unknown input moves a state anywhere: what is compared then is infinite, and no error."""
    x = ca.SX.sym("x", 1)
    system = od.ControlAffineSystem(x, ("a",), drift=-x, unknown={"w": ca.SX(1)}, outputs={"y": x, "z": 2 * x})
    path = od.simulate(system, np.zeros(1), np.zeros((6, 0)), 0.5)
    prior = od.Prior(mean=np.zeros(1), std=(1.0,))
    schedule = od.select_for_filter(system, path, prior, segment=1.0, unknown_inputs=("w",), gap=1e-5)
    assert schedule.chosen.tolist() == [[False, True]] * 3
    # t_0: prior and z, 1 + 4; later z alone, 4
    assert schedule.value == pytest.approx((1 / 5 + 5 / 4) / 6, rel=1e-9)
    assert schedule.status is od.Status.OPTIMAL
    assert {other.name: other.value for other in schedule.compared}["nothing on"] == np.inf


def test_a_rule_may_forbid_that_nothing_is_on():
    """Where the empty pattern is no pattern of the rules, schedules are those of one sensor in each segment."""
    question = random_instance(0) | {"per_segment": 2, "over": "mean", "criterion": od.TraceInverse()}
    S = question["active"].shape[1]
    from obsdesign.rules.abstract import AbstractRule, Segments, Terms

    class SomethingOn(AbstractRule):
        def terms(self, segments: Segments) -> Terms:
            return Terms(sensors=tuple(range(len(segments.names))), admissible=lambda patterns: patterns.any(axis=1))

    free = od.select_for_filter(**question | {"rules": ()}, gap=1e-6)
    bound = od.select_for_filter(**question | {"rules": (SomethingOn(), od.MinimumDwell(1))}, gap=1e-6)
    assert bound.chosen.any(axis=1).all()
    assert bound.chosen.shape[1] == S
    assert bound.value == pytest.approx(free.value, rel=1e-6)  # information never costs


def test_no_schedule_that_is_compared_and_keeps_the_rules_is_better():
    """Greedy ones and the best of a hundred random ones are beginnings of the search, so that it is never below them."""
    for seed in range(20):
        schedule = od.select_for_filter(**random_instance(seed), gap=0.5, throw=False)
        kept = [other.value for other in schedule.compared if other.name in {"greedy", "best of random ones", "median of random ones"}]
        assert all(schedule.value <= value + 1e-9 * max(1.0, abs(value)) for value in kept)


@pytest.mark.parametrize(("std", "sigma"), [(1.0, 1e-6), (1e3, 1e-3), (1e3, 1e-5), (1e3, 1e-6), (1e6, 1e-5)])
def test_a_log_det_is_right_where_its_covariance_is_all_but_singular(std: float, sigma: float) -> None:
    """Two static states and one sample of both: det P = det P_0 sigma^2 / (sigma^2 + c P_0 c'), to eps times the condition of a root."""
    x = ca.SX.sym("x", 2)
    system = od.ControlAffineSystem(x, ("a", "b"), drift=ca.SX.zeros(2), outputs={"y": 0.7 * x[0] + 0.2 * x[1]}, sigmas={"y": sigma})
    path = od.simulate(system, np.zeros(2), np.zeros((1, 0)), 1.0)
    schedule = od.select_for_filter(system, path, od.Prior(np.zeros(2), std=(std, 2 * std)), segment=1.0, criterion=od.LogDet())
    spread = 0.49 * std**2 + 0.04 * 4 * std**2
    right = np.log(4 * std**4) + np.log(sigma**2) - np.log(sigma**2 + spread)
    assert schedule.value == pytest.approx(right, abs=1e-9 + 16 * np.finfo(float).eps * std / sigma)
    assert schedule.bound <= right + 1e-9


def test_noise_of_one_direction_in_units_far_apart_is_what_it_is_in_others() -> None:
    """psd = g g' with states in units of 1e12 and 1e-6: deviations in these units are those in ordinary ones."""
    g, A = np.array([0.3, 1.0, 0.7]), np.array([[-0.2, 1.0, 0.0], [0.0, -0.1, 0.5], [0.3, 0.0, -0.4]])
    predicted = []
    for unit in (np.ones(3), np.array([2.0**-40, 2.0**-40, 2.0**20])):
        x = ca.SX.sym("x", 3)
        drift = ca.DM(unit[:, None] * A / unit) @ x
        system = od.ControlAffineSystem(x, ("a", "b", "c"), drift=drift, outputs={"y": x[0] / unit[0], "z": x[2] / unit[2]})
        path = od.simulate(system, np.zeros(3), np.zeros((6, 0)), 0.5)
        prior = od.Prior(np.zeros(3), std=unit * (2.0, 1.0, 3.0))
        schedule = od.select_for_filter(system, path, prior, 2, segment=1.5, disturbance_psd=np.outer(unit * g, unit * g), scale=unit)
        predicted.append(schedule.predicted / unit)
    np.testing.assert_allclose(predicted[1], predicted[0], rtol=1e-9)


def test_limits_that_no_walk_was_met_to_keep_are_not_called_impossible() -> None:
    """Two budgets kept only by one sensor first and two others in equal parts later: choices one by one run into a dead end."""
    from obsdesign.rules.abstract import AbstractRule, Segments, Terms

    class OneOn(AbstractRule):
        def terms(self, segments: Segments) -> Terms:
            return Terms(admissible=lambda patterns: patterns.any(axis=1))

    first, last, more = 14, 6, 0.0005
    x = ca.SX.sym("x", 2)
    outputs = {"X": 10 * x[0], "Y": x[0], "A": x[0] * 1.0, "B": x[0] * 1.0}
    system = od.ControlAffineSystem(x, ("s0", "s1"), drift=ca.vertcat(x[1], -0.1 * x[0]), outputs=outputs)
    path = od.simulate(system, np.array([0.0, 1.0]), np.zeros((first + last, 0)), 1.0)
    begin, end = tuple(range(first)), tuple(range(first, first + last))
    limit = first / 2 + last / 2 + 1e-6
    rules = (
        OneOn(),
        *(od.Unavailable(name, end) for name in "XY"),
        *(od.Unavailable(name, begin) for name in "AB"),
        od.EnergyBudget(limit, cost={"X": 0.5 + more, "Y": 0.5, "A": 1.0, "B": 0.0}),
        od.EnergyBudget(limit, cost={"X": 0.5 + more, "Y": 0.5, "A": 0.0, "B": 1.0}),
    )
    prior = od.Prior([0.0, 1.0], [3.0, 2.0])
    for over in ("worst", "mean"):
        schedule = od.select_for_filter(system, path, prior, segment=1.0, disturbance_psd=(0.1, 0.1), rules=rules, over=over, throw=False)
        assert schedule.status is not od.Status.INFEASIBLE


def test_a_sensor_that_never_answers_is_in_no_schedule_for_the_start() -> None:
    x = ca.SX.sym("x", 1)
    system = od.ControlAffineSystem(x, ("a",), drift=-0.1 * x, outputs={"y": 10 * x, "z": x})
    path = od.simulate(system, np.zeros(1), np.zeros((10, 0)), 1.0)
    active = np.column_stack([np.zeros(10), np.ones(10)])
    schedule = od.select_for_filter(system, path, od.Prior([0.0], [3.0]), segment=1.0, disturbance_psd=(0.1,), active=active)
    rivals = {other.name: other.value for other in schedule.compared}
    assert rivals["the schedule for the start"] == pytest.approx(rivals["z always"], rel=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_a_price_is_what_the_sensor_saves_also_where_the_prior_knew_little(seed: int):
    """Differences of mean log det P, P by NumPy: most of a change of the first segments is gone at once, and what is left of it counts."""
    random, N = np.random.default_rng(seed), 12
    x = ca.SX.sym("x", 2)
    system = od.ControlAffineSystem(x, ("a", "b"), ca.vertcat(x[1], 0), outputs={"y": x[0]}, sigmas={"y": 1.0})
    path, prior = od.simulate(system, np.zeros(2), np.zeros((N, 0)), 1.0), od.Prior(np.zeros(2), std=(1e4, 1e3))
    psd, F = 10.0 ** random.uniform(-6, -3, 2), np.array([[1.0, 1.0], [0.0, 1.0]])
    schedule = od.select_for_filter(system, path, prior, segment=2.0, disturbance_psd=psd, criterion=od.LogDet())

    def cost(chosen: np.ndarray) -> float:
        P, costs = prior.covariance, []
        for k in range(N):
            if chosen[k // 2, 0]:
                P = P - np.outer(P[:, 0], P[0]) / (P[0, 0] + 1)
            costs.append(np.linalg.slogdet(P)[1])
            P = F @ P @ F.T + np.diag(psd)
        return float(np.mean(costs))

    for k in range(6):
        without = schedule.chosen.copy()
        without[k] = False
        assert schedule.prices[k, 0] == pytest.approx(cost(without) - cost(schedule.chosen), rel=1e-2)
