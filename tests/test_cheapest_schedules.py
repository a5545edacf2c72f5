"""The cheapest schedules that keep requirements, against all schedules of small problems, with a Kalman filter of the tests' own."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from all_schedules import SmallProblem, keeps_dwell, random_problem, switch_ons

import obsdesign as od
from obsdesign.selection.posterior.cheapest_selection import common_unit


def _requirement(random: np.random.Generator, small: SmallProblem, schedules: np.ndarray) -> od.Requirement:
    """Return a requirement between what all sensors together and no sensor give, mostly."""
    n, N = len(small.A), len(small.arrivals)
    about = sorted(random.choice(n, size=int(random.integers(1, n + 1)), replace=False).tolist())
    after = float(random.choice([0.0, small.step * random.integers(0, max(1, N - 1)) * 0.99]))
    if N == 1:
        after = 0.0
    deviations = np.sqrt(np.diagonal(small.covariances(schedules), axis1=2, axis2=3)[:, :, about].sum(axis=2))
    level = float(np.quantile(deviations[random.integers(len(schedules))], random.uniform(0.3, 1.0)))
    share = float(random.choice([1.0, random.uniform(0.3, 1.0)]))
    return od.Requirement(tuple(f"s{i}" for i in about), level * 1.0001, share=share, after=after)


def _keeps(small: SmallProblem, requirement: od.Requirement, P: np.ndarray) -> np.ndarray:
    """Return which of B schedules with covariances (B, N, n, n) keep a requirement, written anew."""
    about = [int(name[1:]) for name in requirement.about]
    is_counted = np.arange(P.shape[1]) * small.step > requirement.after
    deviations = np.sqrt(np.diagonal(P, axis1=2, axis2=3)[:, :, about].sum(axis=2))[:, is_counted]
    return (deviations <= requirement.at_most).sum(axis=1) >= requirement.share * is_counted.sum() - 1e-9


def random_question(seed: int) -> tuple[dict, SmallProblem, np.ndarray, np.ndarray]:
    """Return a question, its problem, all schedules within its rules and requirements, and what they cost."""
    random = np.random.default_rng([seed, 77])
    small = random_problem(random, 1500)
    while len(small.arrivals) < 2:
        small = random_problem(random, 1500)
    schedules, S = small.schedules, len(small.C)
    require = tuple(_requirement(random, small, schedules) for _ in range(int(random.integers(1, 3))))
    cost = random.integers(0, 4, S).astype(float) if random.random() < 0.5 else random.uniform(0.0, 2.0, S)
    start = [np.zeros(S), random.integers(0, 3, S) / 2, random.uniform(0.0, 1.0, S)][int(random.integers(3))]
    rules, keeps = [], np.ones(len(schedules), dtype=bool)
    if random.random() < 0.3:
        rules.append(od.MinimumDwell(2))
        keeps &= keeps_dwell(schedules, 2)
    if random.random() < 0.3:
        most = int(random.integers(0, small.segments + 1))
        rules.append(od.MaxUses(0, most))
        keeps &= schedules[:, :, 0].sum(axis=1) <= most
    schedules = schedules[keeps]
    P = small.covariances(schedules)
    schedules = schedules[np.logical_and.reduce([_keeps(small, requirement, P) for requirement in require])]
    question = {**small.question, "require": require, "rules": rules}
    question["cost"], question["start"] = (dict(zip((f"y{s}" for s in range(S)), values.tolist(), strict=True)) for values in (cost, start))
    return question, small, schedules, schedules.sum(axis=1) @ cost + switch_ons(schedules) @ start


@pytest.mark.parametrize("seed", range(24))
def test_the_schedule_is_the_cheapest_of_all_that_keep_the_requirements(seed: int) -> None:
    """Of up to 1,500 schedules none that keeps them is cheaper; where none does the answer is no, without an error."""
    question, _, schedules, costs = random_question(seed)
    schedule = od.cheapest_schedule(**question, gap=1e-7)
    if not len(schedules):
        assert schedule.status is od.Status.INFEASIBLE
        assert "impossible" in schedule.notes[0]
        return
    assert schedule.status is od.Status.OPTIMAL
    assert schedule.value == pytest.approx(costs.min(), abs=1e-6)
    assert schedule.bound <= costs.min() + 1e-9
    assert (schedules == schedule.chosen).all(axis=(1, 2)).any()


def _straight() -> dict:
    """A vehicle of constant velocity [m, m/s] seen by two sensors of its position, one better."""
    import casadi as ca

    x = ca.SX.sym("x", 2)
    system = od.ControlAffineSystem(
        x, ("p", "v"), drift=ca.vertcat(x[1], 0), outputs={"good": x[0], "poor": x[0]}, sigmas={"good": 1.0, "poor": 3.0}
    )
    path = od.simulate(system, [0.0, 1.0], np.zeros((20, 0)), 1.0)
    return {"system": system, "path": path, "prior": od.Prior([0.0, 1.0], [5.0, 1.0]), "segment": 5.0, "disturbance_psd": [0.1, 0.1]}


def test_what_all_sensors_together_cannot_keep_is_answered_with_where() -> None:
    """The worst standard deviation with all on is the one of the posterior, at its time, whatever the rules and throw."""
    given = _straight()
    all_on = od.standard_deviations(od.posterior_information(given["system"], given["path"], given["prior"], given["disturbance_psd"]))
    worst = int(all_on[1:-1, 0].argmax()) + 1
    schedule = od.cheapest_schedule(**given, require=od.Requirement(("p",), 0.1))
    assert schedule.status is od.Status.INFEASIBLE
    assert schedule.notes == (f"impossible: with all on, p is {all_on[worst, 0]:.3g} at {worst} s",)


def test_what_the_rules_do_not_allow_is_told_apart_from_what_nothing_can_do() -> None:
    """With the good sensor alone p stays within 1.2 m; a rule that forbids it leaves no schedule, and that is proven."""
    given, require = _straight(), od.Requirement(("p",), 1.2)
    assert od.cheapest_schedule(**given, require=require).status is od.Status.OPTIMAL
    schedule = od.cheapest_schedule(**given, require=require, rules=(od.Unavailable("good", (0, 1)),))
    assert schedule.status is od.Status.INFEASIBLE
    assert "within the rules" in schedule.notes[0]


def test_instants_count_that_are_strictly_later() -> None:
    """t_k - t_0 > after: the last of 20 instants is at 19 s, so it counts after 18 s and nothing does after 19 s."""
    given = _straight()
    schedule = od.cheapest_schedule(**given, require=od.Requirement(("p",), 2.0, after=18.0))
    assert schedule.predicted[19, 0] <= 2.0
    assert schedule.value == 1.0
    with pytest.raises(od.InputError, match="no instant with samples is later"):
        od.cheapest_schedule(**given, require=od.Requirement(("p",), 2.0, after=19.0))


@pytest.mark.parametrize("seed", [4, 5])
def test_a_gap_of_zero_is_proven_with_and_without_a_unit_of_costs(seed: int) -> None:
    question, _, _, costs = random_question(seed)
    schedule = od.cheapest_schedule(**question, gap=0.0)
    assert schedule.status is od.Status.OPTIMAL
    assert schedule.value == pytest.approx(costs.min(), rel=1e-12)


def test_the_unit_of_costs_changes_nothing() -> None:
    """Costs a hundred times as large: a hundred times the value."""
    question, *_ = random_question(4)
    schedule = od.cheapest_schedule(**question, gap=1e-7)
    scaled = {name: {sensor: 100 * value for sensor, value in question[name].items()} for name in ("cost", "start")}
    assert od.cheapest_schedule(**{**question, **scaled}, gap=1e-7).value == pytest.approx(100 * schedule.value, rel=1e-9)


@pytest.mark.parametrize(
    ("values", "unit"),
    [((1.0, 1.0), 1.0), ((2.0, 0.0, 6.0), 2.0), ((0.5, 0.75), 0.25), ((0.1, 0.3), 0.1), ((0.0, 0.0), 0.0), ((1.0, 2**0.5), 0.0)],
)
def test_the_unit_of_costs_is_their_greatest_common_divisor(values: tuple[float, ...], unit: float) -> None:
    assert common_unit(np.array(values)) == pytest.approx(unit, rel=1e-12)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"at_most": 0.0}, "at_most is 0.0"),
        ({"share": 1.5}, "share is 1.5"),
        ({"share": 0.0}, "share is 0.0"),
        ({"after": -1.0}, "after is -1.0"),
        ({"about": ()}, "about is"),
        ({"about": ("x", "x")}, "about is"),
    ],
)
def test_requirements_that_mean_nothing_are_refused(wrong: dict, message: str) -> None:
    with pytest.raises(od.InputError, match=message):
        od.Requirement(**{"about": ("x",), "at_most": 1.0, **wrong})


def test_questions_that_do_not_fit_are_refused_by_name() -> None:
    given = _straight()
    system = od.System(od.Dubins(5.0), (od.GPS(1.0),))
    path = od.simulate(system, [0.0, 0.0, 0.1], np.zeros((20, 1)), 1.0)
    dubins = {"system": system, "path": path, "prior": od.Prior(path.x[0], [1.0, 1.0, 0.1])}
    with pytest.raises(od.InputError, match="must have one unit"):
        od.cheapest_schedule(**dubins, require=od.Requirement(("x", "heading"), 1.0))
    for wrong, message in (
        ({"require": od.Requirement(("q",), 1.0)}, "about has no 'q'"),
        ({"require": ()}, "require is empty"),
        ({"cost": {"bad": 1.0}}, "cost has no 'bad'"),
        ({"cost": {"good": -1.0}}, "cost of good is -1.0"),
        ({"start": {"good": np.inf}}, "start of good is inf"),
        ({"segment": 3.3}, "segment is 3.3"),
    ):
        with pytest.raises(od.InputError, match=message):
            od.cheapest_schedule(**{**given, "require": od.Requirement(("p",), 2.0), **wrong})


@pytest.mark.parametrize("slack", [1e-8, 1e-7])
@pytest.mark.parametrize(("name", "state"), [("p", 0), ("v", 1)])
def test_what_one_schedule_keeps_with_an_unknown_input_is_not_called_impossible(name: str, state: int, slack: float) -> None:
    """The limit is what the only admissible schedule reaches, and a little: a variance in place of an infinite one is no proof."""
    x = ca.SX.sym("x", 2)
    outputs = {"y": x[0], "z": x[0] + 0.3 * x[1]}
    system = od.ControlAffineSystem(x, ("p", "v"), drift=ca.vertcat(x[1], 0), unknown={"w": ca.vertcat(0, 1)}, outputs=outputs)
    path, prior = od.simulate(system, [0.0, 1.0], np.zeros((20, 0)), 1.0), od.Prior([0, 1.0], [3.0, 2.0])
    active = np.column_stack([np.ones(20), np.zeros(20)])
    J = od.posterior_information(system, path, prior, (0.1, 0.1), unknown_inputs=("w",), active=active)
    limit = float(od.standard_deviations(J)[1:20, state].max()) * (1 + slack)
    required, rules = od.Requirement((name,), limit), (od.Unavailable("z", tuple(range(10))),)
    cheapest = od.cheapest_schedule(
        system, path, prior, required, segment=2.0, disturbance_psd=(0.1, 0.1), unknown_inputs=("w",), rules=rules, throw=False
    )
    assert cheapest.status is not od.Status.INFEASIBLE
