"""Rules: schedules of 1,000 small problems against trying all, what a rule forbids, and what is refused."""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np
import pytest
from conftest import seeds

import obsdesign as od
from obsdesign.criteria.abstract import AbstractCriterion
from obsdesign.rules.abstract import AbstractRule

CRITERIA = (od.MinEigenvalue(), od.LogDet(), od.TraceInverse())
BATCHES, IN_EACH = 20, 50
MOST_SCHEDULES = 3000


# ---------------------------------------------------------------- trying all


def patterns_of(sensors: int, per_segment: int) -> np.ndarray:
    """(P, S): every set of at most per_segment sensors."""
    return np.array([pattern for pattern in product([False, True], repeat=sensors) if sum(pattern) <= per_segment])


def all_schedules(segments: int, sensors: int, per_segment: int) -> np.ndarray:
    """(N, K, S): every schedule."""
    patterns = patterns_of(sensors, per_segment)
    return patterns[np.array(list(product(range(len(patterns)), repeat=segments)))]


def switched_on(chosen: np.ndarray) -> np.ndarray:
    """Where (N, K, S) a sensor is on and was not in the segment before; all are off before the first."""
    before = np.concatenate([np.zeros_like(chosen[:, :1]), chosen[:, :-1]], axis=1)
    return chosen & ~before


def by_sensor(given: float | dict[str | int, float], sensors: int) -> np.ndarray:
    if not isinstance(given, dict):
        return np.full(sensors, given)
    return np.array([given.get(s, 0.0) for s in range(sensors)])


def taken(rule: AbstractRule, chosen: np.ndarray) -> tuple[np.ndarray, float] | None:
    """How much (N,) of what a rule limits the schedules (N, K, S) take, and the limit; None: it limits nothing."""
    if isinstance(rule, od.EnergyBudget):
        cost, start = by_sensor(rule.cost, chosen.shape[2]), by_sensor(rule.start, chosen.shape[2])
        return (chosen * cost).sum(axis=(1, 2)) + (switched_on(chosen) * start).sum(axis=(1, 2)), rule.limit
    if isinstance(rule, od.MaxUses):
        return chosen[:, :, rule.sensor].sum(axis=1), rule.most
    return None


def allowed(rule: AbstractRule, chosen: np.ndarray) -> np.ndarray:
    """Whether (N,) schedules (N, K, S) keep a rule that limits no sum, by its docstring."""
    fine = np.ones(len(chosen), dtype=bool)
    if isinstance(rule, od.Exclusive):
        fine = (chosen[:, :, list(rule.sensors)].sum(axis=2) <= 1).all(axis=1)
    elif isinstance(rule, od.Requires):
        fine = (chosen[:, :, rule.other] | ~chosen[:, :, rule.sensor]).all(axis=1)
    elif isinstance(rule, od.Unavailable):
        fine = ~chosen[:, list(rule.segments), rule.sensor].any(axis=1)
    elif isinstance(rule, od.MinimumDwell):
        for s in range(chosen.shape[2]) if rule.sensors is None else rule.sensors:
            for k in range(chosen.shape[1]):
                stays = chosen[:, k : k + rule.least, s].all(axis=1)
                fine &= stays | ~switched_on(chosen)[:, k, s]
    return fine


def keeps(rule: AbstractRule, chosen: np.ndarray) -> np.ndarray:
    """Whether (N,) schedules (N, K, S) keep a rule."""
    limited = taken(rule, chosen)
    return allowed(rule, chosen) if limited is None else limited[0] <= limited[1] + 1e-9


def penalty(rules: tuple[AbstractRule, ...], chosen: np.ndarray) -> np.ndarray:
    """What switching takes off (N,)."""
    costs = [by_sensor(rule.cost, chosen.shape[2]) for rule in rules if isinstance(rule, od.SwitchingCost)]
    return (switched_on(chosen) * np.sum([np.zeros(chosen.shape[2]), *costs], axis=0)).sum(axis=(1, 2))


def judged(criterion: AbstractCriterion, W: np.ndarray) -> np.ndarray:
    """The criterion of W (N, n, n), -inf where a matrix is singular and the criterion wants its inverse."""
    if isinstance(criterion, od.MinEigenvalue):
        return np.linalg.eigvalsh(W)[:, 0]
    d = np.sqrt(np.maximum(np.diagonal(W, axis1=1, axis2=2), np.finfo(float).tiny))
    regular = np.linalg.eigvalsh(W / (d[:, :, None] * d[:, None, :]))[:, 0] > 1e-11
    W = np.where(regular[:, None, None], W, np.eye(W.shape[1]))
    found = np.linalg.slogdet(W)[1] if isinstance(criterion, od.LogDet) else -np.trace(np.linalg.inv(W), axis1=1, axis2=2)
    return np.where(regular, found, -np.inf)


@dataclass(frozen=True)
class Problem:
    """What select_sensors is asked."""

    blocks: np.ndarray
    per_segment: int
    rules: tuple[AbstractRule, ...]
    criterion: AbstractCriterion
    robust_to: int

    def losses(self) -> list[np.ndarray]:
        """The sensors (S,) that still work, in each case of loss."""
        S = self.blocks.shape[1]
        return [~np.isin(np.arange(S), lost) for lost in combinations(range(S), self.robust_to)]

    def schedules(self) -> np.ndarray:
        """(N, K, S): all that have few enough sensors on."""
        return all_schedules(*self.blocks.shape[:2], self.per_segment)

    def values(self, chosen: np.ndarray) -> np.ndarray:
        """What the schedules (N, K, S) are worth."""
        W = [np.tensordot((chosen & working).astype(float), self.blocks, ([1, 2], [0, 1])) for working in self.losses()]
        return np.min([judged(self.criterion, each) for each in W], axis=0) - penalty(self.rules, chosen)

    def solved(self, **options: object) -> od.Schedule:
        """Ask."""
        given = {"rules": self.rules, "criterion": self.criterion, "robust_to": self.robust_to, **options}
        return od.select_sensors(self.blocks, self.per_segment, **given)


def random_rules(random: np.random.Generator, K: int, S: int) -> tuple[AbstractRule, ...]:
    def some(likely: float) -> bool:
        return bool(random.random() < likely)

    def sensors(least: int) -> tuple[int, ...]:
        return tuple(random.permutation(S)[: random.integers(least, S + 1)].tolist())

    rules: list[AbstractRule] = []
    if some(0.35):
        start = dict(enumerate(random.integers(0, 3, S).tolist())) if some(0.5) else 0.0
        rules.append(od.EnergyBudget(float(random.integers(1, 3 * K + 2)), dict(enumerate(random.integers(0, 4, S).tolist())), start))
    if some(0.25):
        rules.append(od.MaxUses(sensors(1)[0], int(random.integers(0, K + 1))))
    if some(0.25):
        rules.append(od.SwitchingCost(dict(enumerate(random.uniform(0, 0.5, S))) if some(0.5) else float(random.uniform(0, 0.5))))
    if some(0.25):
        rules.append(od.MinimumDwell(int(random.integers(1, 4)), None if some(0.5) else sensors(1)))
    if S > 1 and some(0.2):
        rules.append(od.Exclusive(sensors(2)))
    if S > 1 and some(0.2):
        rules.append(od.Requires(*sensors(2)[:2]))
    if some(0.25):
        rules.append(od.Unavailable(int(random.integers(S)), tuple(random.permutation(K)[: random.integers(1, K + 1)].tolist())))
    return tuple(rules)


def random_problem(seed: int) -> Problem:
    """K 1..5, S 1..4, n 1..4; in one of ten, too few blocks to see everything are no accident."""
    random = np.random.default_rng(seed)
    while True:
        K, S, n = (int(each) for each in random.integers(1, (6, 5, 5)))
        per_segment = int(random.integers(1, S + 1))
        if len(patterns_of(S, per_segment)) ** K <= MOST_SCHEDULES:
            break
    least = 1 if random.random() < 0.1 else min(n, -(-n // (K * per_segment)))
    factors = random.standard_normal((K, S, n, random.integers(least, n + 1)))
    robust_to = int(S > 1 and random.random() < 0.3)
    criterion = CRITERIA[random.integers(3)]
    return Problem(factors @ factors.swapaxes(2, 3), per_segment, random_rules(random, K, S), criterion, robust_to)


def contradiction(problem: Problem) -> bool:
    """Whether a segment has no sensor that may be on, a sensor never may be or never for long enough, or a budget buys nothing."""
    chosen = problem.schedules()

    def within(*kinds: type[AbstractRule]) -> np.ndarray:
        keep = [allowed(rule, chosen) for rule in problem.rules if isinstance(rule, kinds)]
        return chosen[np.logical_and.reduce([np.ones(len(chosen), dtype=bool), *keep])]

    available = within(od.Unavailable).any(axis=(0, 1))
    together, at_a_time = within(od.Exclusive, od.Requires), within(od.Exclusive, od.Requires, od.Unavailable)
    for_long = within(od.Exclusive, od.Requires, od.Unavailable, od.MinimumDwell)
    alone = within(od.Unavailable)
    alone = alone[alone.sum(axis=(1, 2)) == 1]
    return (
        not together.any(axis=(0, 1)).all()
        or not at_a_time.any(axis=(0, 2)).all()
        or bool((available & ~for_long.any(axis=(0, 1))).any())
        or any(not keeps(rule, alone).any() for rule in problem.rules if taken(rule, chosen) is not None)
    )


@pytest.mark.parametrize("batch", seeds(BATCHES, 8))
def test_a_thousand_small_problems_against_trying_all(batch: int):
    """Value, bound, status, rules and the closed form of the bound, or the refusal of rules that leave no choice."""
    for seed in range(batch * IN_EACH, (batch + 1) * IN_EACH):
        problem = random_problem(seed)
        try:
            schedule = problem.solved()
        except od.InputError:
            reason = contradiction(problem) or poor(problem) or not np.isfinite(best(problem))
            assert reason, f"seed {seed}: refused without a reason"
            continue
        except od.SolveError:
            assert not np.isfinite(best(problem)), f"seed {seed}: no answer where there is one"
            continue
        assert not contradiction(problem), f"seed {seed}: rules that leave no choice were accepted"
        assert schedule.status is od.Status.OPTIMAL, f"seed {seed}: as small a problem as this is not proven"
        certified(problem, schedule, f"seed {seed}")
        bounded_by_its_dual(problem, schedule, f"seed {seed}")


def feasible(problem: Problem) -> np.ndarray:
    """(N, K, S): the schedules that keep every rule."""
    chosen = problem.schedules()
    return chosen[np.logical_and.reduce([np.ones(len(chosen), dtype=bool), *(keeps(rule, chosen) for rule in problem.rules)])]


def best(problem: Problem) -> float:
    """The largest value of all schedules that keep the rules."""
    return float(problem.values(feasible(problem)).max())


def poor(problem: Problem) -> bool:
    """Whether no schedule that keeps the rules sees the whole state: that may be refused, for an eigenvalue only within limits."""
    if not isinstance(problem.criterion, od.MinEigenvalue):
        return not np.isfinite(best(problem))
    limits = any(isinstance(rule, od.EnergyBudget | od.MaxUses) for rule in problem.rules)
    return limits and best(problem) <= 1e-9


def certified(problem: Problem, schedule: od.Schedule, where: str) -> None:
    """Assert that the best of all schedules lies between value and bound, and that OPTIMAL means equal."""
    most = best(problem)
    one = schedule.chosen[None]
    assert schedule.chosen.sum(axis=1).max() <= problem.per_segment, where
    for rule in problem.rules:
        assert keeps(rule, one)[0], f"{where}: {rule}"
    if not np.isfinite(most):
        assert not np.isfinite(problem.values(one)[0]), where
        return
    size = 1.0 if problem.criterion.resolution else abs(most)
    near = 1e-8 * size + 1e-12 * float(np.abs(problem.blocks).max())
    assert schedule.value <= most + near, where
    assert schedule.bound >= most - near, where
    assert schedule.root_bound >= schedule.bound - near, where
    if np.isfinite(schedule.value):
        assert abs(schedule.value - problem.values(one)[0]) <= near, where
    if schedule.status is od.Status.OPTIMAL:
        assert abs(schedule.value - most) <= near, where


def bounded_by_its_dual(problem: Problem, schedule: od.Schedule, where: str) -> None:
    """Assert UB = offset + prices'limits + the best sum over schedules, and what forcing each choice takes off it."""
    chosen = problem.schedules()
    chosen = chosen[np.logical_and.reduce([np.ones(len(chosen), dtype=bool), *(allowed(rule, chosen) for rule in problem.rules)])]
    Z = schedule.dual.reshape(-1, *problem.blocks.shape[2:])
    worth = sum(np.einsum("ksij,ij->ks", problem.blocks, each) * working for each, working in zip(Z, problem.losses(), strict=True))
    sums = np.tensordot(chosen.astype(float), worth, 2) - penalty(problem.rules, chosen) + schedule.offset
    limited = [found for rule in problem.rules if (found := taken(rule, chosen)) is not None]
    for price, (used, limit) in zip(schedule.prices, limited, strict=True):
        assert price >= 0, where
        sums += price * (limit - used)
    near = 1e-9 * (abs(float(sums.max())) + abs(schedule.offset) + float(np.abs(worth).max()) + 1e-3)
    assert schedule.root_bound == pytest.approx(max(float(sums.max()), schedule.value), abs=near), where
    for choice, loss in ((chosen, schedule.forced_on), (~chosen, schedule.forced_off)):
        falls = sums.max() - np.where(choice, sums[:, None, None], -np.inf).max(axis=0)
        np.testing.assert_allclose(loss, falls, rtol=1e-9, atol=near, err_msg=where)


# ---------------------------------------------------------------- longer paths


def random_blocks(segments: int, sensors: int, n: int, rank: int, seed: int = 0) -> np.ndarray:
    factors = np.random.default_rng(seed).standard_normal((segments, sensors, n, rank))
    return factors @ factors.swapaxes(2, 3)


LONG = {
    "dwell": (od.MinimumDwell(4),),
    "dwell of one, switching": (od.MinimumDwell(5, (1,)), od.SwitchingCost(0.4)),
    "dwell, starts cost energy": (od.MinimumDwell(3), od.EnergyBudget(40.0, 1.0, {0: 5.0, 2: 1.0})),
    "switching, exclusive, a budget": (od.SwitchingCost({0: 1.0}), od.Exclusive((0, 2)), od.EnergyBudget(25.0, {0: 1.0, 1: 0.5})),
    "requires, uses, a gap": (od.Requires(0, 1), od.MaxUses(1, 20), od.Unavailable(1, range(10, 30)), od.MinimumDwell(2)),
}


@pytest.mark.parametrize("name", LONG)
@pytest.mark.parametrize("criterion", [CRITERIA[0], pytest.param(CRITERIA[1], marks=pytest.mark.slow)])
def test_rules_are_kept_over_sixty_segments(name: str, criterion: AbstractCriterion):
    blocks, rules = random_blocks(60, 3, 3, 1, seed=6), LONG[name]
    problem = Problem(blocks, 2, rules, criterion, 0)
    schedule = problem.solved(gap=1e-3, time_limit=1.0)
    one = schedule.chosen[None]
    assert one.sum(axis=2).max() <= 2
    for rule in rules:
        assert keeps(rule, one)[0], rule
    assert schedule.value == pytest.approx(problem.values(one)[0], rel=1e-9, abs=1e-9)
    assert schedule.value <= schedule.bound <= schedule.root_bound
    # without rules one can only do better, and any schedule that keeps them is below the bound
    free = Problem(blocks, 2, (), criterion, 0).solved(method="columns")
    assert schedule.value <= free.bound
    assert (problem.values(some_that_keep(problem)) <= schedule.bound).all()


def some_that_keep(problem: Problem) -> np.ndarray:
    """Schedules of stretches of six segments, of 1,500 drawn at random those that keep the rules."""
    random = np.random.default_rng(3)
    K, S = problem.blocks.shape[:2]
    chosen = np.repeat(random.random((1500, K // 6, S)) < random.random((1500, 1, 1)), 6, axis=1)
    chosen &= chosen.cumsum(axis=2) <= problem.per_segment
    keep = np.logical_and.reduce([keeps(rule, chosen) for rule in problem.rules])
    assert keep.sum() >= 3
    return chosen[keep]


def test_a_rule_that_forbids_nothing_changes_nothing():
    """A budget for all, dwell times of 1, no cost of switching, as many uses as there are segments."""
    blocks = random_blocks(6, 3, 2, 1)
    plain = od.select_sensors(blocks)
    idle = (od.EnergyBudget(100.0, 1.0), od.MinimumDwell(1), od.SwitchingCost(0.0), od.MaxUses(0, 6), od.Unavailable(0, ()))
    for rules in (*((rule,) for rule in idle), idle):
        found = od.select_sensors(blocks, rules=rules)
        assert found.value == pytest.approx(plain.value, rel=1e-12)
        assert found.root_bound == pytest.approx(plain.root_bound, rel=1e-7)


def test_without_its_budget_a_schedule_is_better_and_the_price_says_by_how_much_at_most():
    """Concave in the limit: value(limit + d) <= root bound(limit) + d price."""
    blocks = random_blocks(8, 3, 2, 2)
    costs = {0: 2.0, 1: 1.0, 2: 3.0}
    tight = od.select_sensors(blocks, rules=(od.EnergyBudget(8.0, costs),))
    assert tight.prices[0] > 0
    for more in (1.0, 3.0, 30.0):
        loose = od.select_sensors(blocks, rules=(od.EnergyBudget(8.0 + more, costs),))
        assert tight.value <= loose.value <= tight.root_bound + more * tight.prices[0] * (1 + 1e-9)


# ---------------------------------------------------------------- times, places and names

NAMED = od.Segments(("gps", "compass", "range"), 4, np.array([10.0, 12.0, 14.0, 16.0, 18.0]))
TRACKS = tuple(np.array([[3.0 * k, 0.0], [3.0 * k + 2.0, 0.0]]) for k in range(4))


@pytest.mark.parametrize(
    ("first", "last", "off"),
    [
        (0.0, 2.0, [0]),  # shares only a moment with the second segment
        (1.9, 2.1, [0, 1]),
        (2.5, 3.0, [1]),
        (2.0, 100.0, [1, 2, 3]),
        (8.0, 9.0, []),
    ],
)
def test_between_two_times_a_sensor_is_off_in_every_segment_that_shares_time(first: float, last: float, off: list[int]):
    available = od.UnavailableBetween("compass", first, last).terms(NAMED).available
    np.testing.assert_array_equal(np.flatnonzero(~available[:, 1]), off)
    assert available[:, [0, 2]].all()


@pytest.mark.parametrize(("radius", "off"), [(5.1, [2, 3]), (4.9, [1, 2, 3]), (100.0, []), (1.0, [0, 1, 2, 3])])
def test_outside_a_circle_a_sensor_is_off_in_every_segment_that_leaves_it(radius: float, off: list[int]):
    segments = od.Segments(NAMED.names, 4, tracks=TRACKS)
    available = od.UnavailableOutside("range", (0.0, 0.0), radius).terms(segments).available
    np.testing.assert_array_equal(np.flatnonzero(~available[:, 2]), off)
    assert available[:, [0, 1]].all()


def test_names_and_numbers_mean_the_same_sensor():
    blocks = random_blocks(4, 3, 2, 1)
    by_name = (od.EnergyBudget(5.0, {"gps": 2.0, "range": 1.0}), od.Requires("compass", "range"), od.MaxUses("range", 2))
    by_number = (od.EnergyBudget(5.0, {0: 2.0, 2: 1.0}), od.Requires(1, 2), od.MaxUses(2, 2))
    one, other = (od.select_sensors(blocks, 2, rules=rules, segments=NAMED) for rules in (by_name, by_number))
    assert one.chosen.tobytes() == other.chosen.tobytes()
    assert one.value == other.value


def test_a_night_is_kept_by_the_schedule():
    blocks = random_blocks(4, 3, 2, 2)
    blocks[:, 1] *= 100.0
    schedule = od.select_sensors(blocks, rules=(od.UnavailableBetween("compass", 2.0, 6.0),), segments=NAMED)
    np.testing.assert_array_equal(schedule.chosen[:, 1], [True, False, False, True])


# ---------------------------------------------------------------- bad input


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: od.EnergyBudget(-1.0, 1.0), "energy_budget: limit is -1.0: must be a finite number of at least 0"),
        (lambda: od.EnergyBudget(np.nan, 1.0), "energy_budget: limit is nan"),
        (lambda: od.EnergyBudget(1.0, -2.0), "energy_budget: cost is -2.0: must be a finite number of at least 0"),
        (lambda: od.EnergyBudget(1.0, {"gps": np.inf}), "energy_budget: cost of gps is inf"),
        (lambda: od.EnergyBudget(1.0, "much"), "energy_budget: cost is 'much'"),
        (lambda: od.EnergyBudget(1.0, 1.0, {0: -1}), "energy_budget: start of 0 is -1: must be a finite number of at least 0"),
        (lambda: od.MaxUses("gps", -1), "max_uses: most is -1: must be a whole number of at least 0"),
        (lambda: od.MaxUses("gps", 1.5), "max_uses: most is 1.5"),
        (lambda: od.SwitchingCost(-0.1), "switching_cost: cost is -0.1: must be a finite number of at least 0"),
        (lambda: od.SwitchingCost({"gps": True}), "switching_cost: cost of gps is True"),
        (lambda: od.MinimumDwell(0), "minimum_dwell: least is 0: must be a whole number of at least 1"),
        (lambda: od.MinimumDwell(2, ()), "minimum_dwell: sensors is (): must be at least 1 different sensor, by name or index"),
        (lambda: od.MinimumDwell(2, (1, 1)), "minimum_dwell: sensors is (1, 1)"),
        (lambda: od.Exclusive(("gps",)), "exclusive: sensors is ('gps',): must be at least 2 different sensors, by name or index"),
        (lambda: od.Exclusive("gps"), "exclusive: sensors is 'gps'"),
        (lambda: od.Exclusive((0, 1.5)), "exclusive: sensors is (0, 1.5)"),
        (lambda: od.Requires("gps", "gps"), "requires: sensor and other are both 'gps': must be two sensors"),
        (lambda: od.Unavailable("gps", (1, -2)), "unavailable: segment is -2: must be a whole number of at least 0"),
        (lambda: od.UnavailableBetween("gps", -1.0, 2.0), "unavailable_between: first is -1.0"),
        (lambda: od.UnavailableBetween("gps", 2.0, 2.0), "unavailable_between: last is 2.0: must be after first, 2.0"),
        (lambda: od.UnavailableOutside("gps", (0.0, 0.0), 0.0), "unavailable_outside: radius is 0.0: must be a finite number above 0"),
        (lambda: od.UnavailableOutside("gps", (0.0,), 1.0), "unavailable_outside: centre is (0.0,): must be two numbers"),
    ],
)
def test_rules_that_mean_nothing_are_refused(make: object, message: str):
    with pytest.raises(od.InputError, match=re.escape(message)):
        make()  # pyright: ignore[reportCallIssue]


@pytest.mark.parametrize(
    ("rule", "message"),
    [
        (
            od.EnergyBudget(9.0, {"gsp": 1.0}),
            "EnergyBudget of 9: sensors has no 'gsp'; did you mean 'gps'? (accepted: gps, compass, range)",
        ),
        (od.MaxUses("rnage", 2), "MaxUses: rnage in at most 2 segments: sensors has no 'rnage'; did you mean 'range'?"),
        (od.SwitchingCost({"compas": 1.0}), "SwitchingCost: sensors has no 'compas'; did you mean 'compass'?"),
        (od.MinimumDwell(2, ("sonar",)), "MinimumDwell: sonar for at least 2 segments: sensors has no 'sonar'"),
        (od.Exclusive(("gps", "compss")), "Exclusive: gps, compss: sensors has no 'compss'; did you mean 'compass'?"),
        (od.Requires("gps", "rang"), "Requires: gps only with rang: sensors has no 'rang'; did you mean 'range'?"),
        (od.Requires("gps", 3), "Requires: gps only with 3: sensor is 3: must be a whole number from 0 to 2"),
        (od.Unavailable("gp", (1,)), "Unavailable: gp in segments 1: sensors has no 'gp'; did you mean 'gps'?"),
        (od.Unavailable("gps", (1, 4)), "Unavailable: gps in segments 1, 4: segment is 4: must be a whole number from 0 to 3"),
        (od.UnavailableBetween("radar", 1.0, 2.0), "UnavailableBetween: radar from 1 s to 2 s: sensors has no 'radar'"),
    ],
)
def test_sensors_and_segments_that_there_are_not_are_named(rule: AbstractRule, message: str):
    with pytest.raises(od.InputError, match=re.escape(message)):
        od.select_sensors(random_blocks(4, 3, 2, 2), rules=(rule,), segments=NAMED)


@pytest.mark.parametrize(
    ("rule", "message"),
    [
        (od.UnavailableBetween(0, 1.0, 2.0), "the times of the segments are not known: give select_sensors segments=Segments(..., t=...)"),
        (od.UnavailableOutside(0, (0.0, 0.0), 2.0), "the positions are not known: give select_sensors segments=Segments(..., tracks=...)"),
        (od.MaxUses("gps", 1), "sensors has no 'gps' (accepted: sensor 0, sensor 1, sensor 2)"),
    ],
)
def test_rules_that_need_times_places_or_names_say_so(rule: AbstractRule, message: str):
    with pytest.raises(od.InputError, match=re.escape(f"{rule}: {message}")):
        od.select_sensors(random_blocks(4, 3, 2, 2), rules=(rule,))


@pytest.mark.parametrize(
    ("rules", "per_segment", "message"),
    [
        (
            [od.Unavailable(s, (2,)) for s in range(3)],
            1,
            "segment 2: the rules leave no sensor that may be on: Unavailable: 0 in segments 2; Unavailable: 1 in segments 2; ",
        ),
        ([od.Unavailable(s, (0, 3)) for s in range(3)], 2, "segment 0 (and 1 more): the rules leave no sensor that may be on"),
        (
            [od.Requires(0, 1), od.Unavailable(1, (1,)), od.Unavailable(2, (1,))],
            2,
            "segment 1: the rules leave no sensor that may be on: Requires: 0 only with 1; ",
        ),
        ([od.Requires(0, 1)], 1, "sensor 0 can never be on, with 1 per segment: Requires: 0 only with 1 contradict each other"),
        ([od.Requires(0, 1), od.Exclusive((0, 1))], 3, "sensor 0 can never be on, with 3 per segment"),
        (
            [od.MinimumDwell(2), od.Unavailable(0, (1, 3))],
            1,
            "sensor 0 can never be on for long enough: MinimumDwell: every sensor for at least 2 segments; Unavailable: 0 in segments 1, 3",
        ),
        (
            [od.EnergyBudget(1.0, 2.0)],
            1,
            "EnergyBudget of 1: too small for any schedule: the cheapest sensor in the cheapest segment takes 2",
        ),
        ([od.EnergyBudget(3.0, {0: 4.0, 1: 2.0, 2: 3.0}, 2.0)], 1, "EnergyBudget of 3: too small for any schedule: the cheapest sensor"),
    ],
)
def test_rules_that_contradict_each_other_are_spelled_out(rules: list[AbstractRule], per_segment: int, message: str):
    with pytest.raises(od.InputError, match=re.escape(message)):
        od.select_sensors(random_blocks(4, 3, 2, 1), per_segment, rules=rules)


def test_a_budget_within_which_a_state_stays_hidden_is_refused():
    """Only sensor 1 sees the second state, and it is too dear."""
    blocks = np.zeros((4, 2, 2, 2))
    blocks[:, 0, 0, 0] = blocks[:, 1, 1, 1] = 1.0
    with pytest.raises(od.InputError, match="EnergyBudget of 4: too small for any schedule that sees the whole state"):
        od.select_sensors(blocks, 2, rules=(od.EnergyBudget(4.0, {0: 1.0, 1: 5.0}),))


def test_too_many_patterns_or_states_are_refused_with_their_number():
    with pytest.raises(od.InputError, match=r"10 of 20 sensors make 616666 patterns: .* at most 50000 are accepted"):
        od.select_sensors(random_blocks(2, 20, 2, 2), 10, rules=(od.Exclusive((0, 1)),))
    with pytest.raises(od.InputError, match="the rules make more than 3000 states of 16 patterns and dwell times 9, 9, 9, 9"):
        od.select_sensors(random_blocks(20, 4, 2, 2), 4, rules=(od.MinimumDwell(9),))


def test_segments_of_another_number_are_refused():
    with pytest.raises(od.InputError, match="segments has 4 segments of 3 sensors: the blocks have 5 of 3"):
        od.select_sensors(random_blocks(5, 3, 2, 2), segments=NAMED)
