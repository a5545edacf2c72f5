"""Planning in flight: nothing raises, nothing is lost from one step to the next, and the filter in the loop learns the wind."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.stats import chi2

import obsdesign as od
import obsdesign.planning.closed_loop as flying
from obsdesign.design import tightening
from obsdesign.design.feasibility import is_feasible, violations
from obsdesign.design.sqp.trust_region_sqp import Solution
from obsdesign.dynamics.measurement_noise import measurement_noise
from obsdesign.planning.closed_loop import Flight, fly
from obsdesign.planning.plan import Plan
from obsdesign.planning.planner import Planner

SYSTEM = od.System(od.Dubins(1.0, wind="constant"), (od.GPS(2.0),))
START = np.array([0.0, 0.0, 0.1, 0.2, -0.1])
SCALE = (5.0, 5.0, 0.5, 0.3, 0.3)
OBSTACLE = od.KeepOut((6.0, 1.0), 1.5)
AREA = od.KeepIn(((-6.0, -7.0), (14.0, -7.0), (14.0, 7.0), (-6.0, 7.0)))
PROBLEM = od.DesignProblem(
    system=SYSTEM,
    start=START,
    duration=12.0,
    step=0.25,
    path=od.PiecewiseConstant(12),
    bounds={"turn_rate": (-0.8, 0.8)},
    scale=SCALE,
    constraints=(OBSTACLE, AREA),
)
STD = (2.0, 2.0, 0.3, 0.3, 0.3)
REAL_CLIMB = tightening.solve


@pytest.fixture(scope="module")
def planner() -> Planner:
    """A new plan every second, a piece of the path."""
    return Planner(PROBLEM, every=1.0, starts=1)


@pytest.fixture(scope="module")
def often() -> Planner:
    """A new plan every step, a quarter of a piece."""
    return Planner(PROBLEM, starts=1)


@pytest.fixture(scope="module")
def first(planner: Planner) -> Plan:
    return planner.step(START)


def test_a_plan_prints_on_a_screen(first: Plan):
    lines = str(first).splitlines()
    assert lines[0] == f"plan at 0 s: {first.status.value}"
    assert len(lines) <= 15
    assert f"{first.value:.4g}" in lines[1]


def flown(x: np.ndarray, plan: Plan, seconds: float) -> np.ndarray:
    """Where the vehicle is after so many seconds along a plan, without noise."""
    u = plan.trajectory.u[: round(seconds / PROBLEM.step)]
    return od.simulate(SYSTEM, x, u, PROBLEM.step).x[-1]


def rest(plan: Plan, steps: int) -> np.ndarray:
    """What is left of a plan's inputs, the last ones held."""
    return np.vstack([plan.trajectory.u[steps:], np.tile(plan.trajectory.u[-1], (steps, 1))])


def require_honest(plan: Plan, x: Any, problem: od.DesignProblem = PROBLEM) -> None:
    """A plan is a path, and what it claims holds: seen from x_now by the checks of the design."""
    assert isinstance(plan, Plan)
    path = plan.trajectory
    assert np.isfinite(path.x).all() and path.steps == problem.steps
    np.testing.assert_allclose(path.x, od.simulate(SYSTEM, path.x[0], path.u, problem.step).x, atol=1e-12)
    if plan.feasible:
        np.testing.assert_array_equal(path.x[0], np.asarray(x, dtype=float))
        # rates are those of the family, of which a path from the middle of a piece on is none: levels of pieces, each so many seconds
        assert is_feasible(replace(problem, rates={}), path)
        piece = problem.longest / problem.path.pieces if isinstance(problem.path, od.PiecewiseConstant) else problem.step
        for name, limit in problem.rates.items():
            change = np.abs(np.diff(path.u[:, problem.system.model.input_names.index(name)]))
            assert change.max(initial=0.0) <= limit * piece * (1 + 1e-6)
    else:
        assert plan.reason


def same_bytes(a: Plan, b: Plan) -> bool:
    told = [(p.value, p.status, p.feasible, p.reason, p.age, p.time, p.memory.p.tobytes(), p.memory.shift) for p in (a, b)]
    paths = [(p.trajectory.t.tobytes(), p.trajectory.x.tobytes(), p.trajectory.u.tobytes()) for p in (a, b)]
    return repr(told[0]) == repr(told[1]) and paths[0] == paths[1]


# ---------------------------------------------------------------- the first plan


def test_the_first_plan_is_that_of_a_design_from_the_same_start(first: Plan):
    require_honest(first, START)
    assert first.feasible and first.age == 0 and first.time == 0.0 and not first.reason
    design = od.design_trajectory(PROBLEM, starts=1)
    assert first.value == pytest.approx(PROBLEM.value(first.trajectory), rel=1e-12)
    assert first.value == pytest.approx(design.value, rel=0.05)


def test_the_same_arguments_give_the_same_plan(planner: Planner, first: Plan):
    assert same_bytes(planner.step(START), first)
    x = flown(START, first, 1.0) + 0.01
    prior = np.diag(1 / np.square(STD))
    assert same_bytes(planner.step(x, first, prior), replace(planner).step(x, first, prior))


# ---------------------------------------------------------------- from one step to the next


def no_climb(*_: Any, **__: Any) -> Solution:
    raise RuntimeError("the engine is out")


def test_after_an_interval_without_noise_the_plan_that_is_kept_is_the_rest_of_the_path(
    planner: Planner, first: Plan, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(tightening, "solve", no_climb)
    plan, x = first, START
    for k in range(1, 4):
        x = flown(x, plan, 1.0)
        plan = planner.step(x, plan)
        left = PROBLEM.steps - 4 * k
        np.testing.assert_array_equal(plan.trajectory.u[:left], first.trajectory.u[4 * k :])
        np.testing.assert_allclose(plan.trajectory.x[: left + 1], first.trajectory.x[4 * k :], atol=1e-12)
        np.testing.assert_array_equal(plan.trajectory.u[left:], np.tile(first.trajectory.u[-1], (4 * k, 1)))
        assert (plan.age, plan.time, plan.status) == (k, float(k), od.Status.NUMERICAL_ERROR)
        assert plan.reason.startswith("the engine is out")
    later = planner.step(flown(x, plan, 2.0), plan, elapsed=2.0)
    np.testing.assert_allclose(later.trajectory.x[:29], first.trajectory.x[20:], atol=1e-12)


@pytest.mark.parametrize("times", [(0.0, 1.0), (0.25, 0.25, 0.25, 0.25, 0.5), (0.75, 0.75, 1.0), (1.75, 0.5), (4.25,)])
def test_a_climb_begins_with_the_rest_of_the_path_wherever_in_a_piece_the_vehicle_is(
    often: Planner, first: Plan, times: tuple[float, ...], monkeypatch: pytest.MonkeyPatch
):
    """The inputs are the same step by step, although the pieces of the horizon begin at other times."""
    begun: list[np.ndarray] = []

    def idle_climb(program: Any, aim: Any, p: np.ndarray, *rest: Any, **limits: Any) -> Solution:
        begun.append(program.inputs(p))
        return replace(REAL_CLIMB(program, aim, p, *rest, **limits), p=p)

    monkeypatch.setattr(tightening, "solve", idle_climb)
    plan, x = first, START
    for k, elapsed in enumerate(times):
        x = flown(x, plan, elapsed) if elapsed else x
        plan = often.step(x, plan, elapsed=elapsed)
        np.testing.assert_allclose(begun[-1], rest(first, round(sum(times[: k + 1]) / 0.25)), atol=1e-12)
        assert plan.time == sum(times[: k + 1])


def test_multipliers_of_limits_stay_with_their_instants(planner: Planner, first: Plan, monkeypatch: pytest.MonkeyPatch):
    """A limit that holds the path up at 5 s holds it up at 4 s a second later."""
    seen: list[Any] = []

    def looked_at(program: Any, aim: Any, p: np.ndarray, warm: Any, *rest: Any, **limits: Any) -> Solution:
        seen.append((program.rows, warm.multipliers))
        return REAL_CLIMB(program, aim, p, warm, *rest, **limits)

    monkeypatch.setattr(tightening, "solve", looked_at)
    rows, before = first.memory.rows, first.memory.warm_start.multipliers
    planner.step(flown(START, first, 1.0), first)
    later, after = seen[0]
    old = dict(zip(zip(rows.node - 4, rows.margin, rows.delay, strict=True), before.rows, strict=False))
    found = dict(zip(zip(later.node, later.margin, later.delay, strict=True), after.rows, strict=False))
    assert max(before.rows) > 0 and len(found) == len(later.node)
    assert all(found[place] == old.get(place, 0.0) for place in found)
    np.testing.assert_array_equal(after.matrices, before.matrices)
    # climbs keep a little away from every limit, so that one that is stopped early keeps it
    assert np.all((later.allowance > 0) & (later.allowance <= 2e-3))


@pytest.mark.parametrize("seed", range(3))
def test_a_plan_is_never_worse_than_the_rest_of_the_one_before(planner: Planner, first: Plan, seed: int):
    random, plan, x = np.random.default_rng(seed), first, START
    for _ in range(5):
        known = rest(plan, 4)
        x = flown(x, plan, 1.0) + random.normal(0, (0.05, 0.05, 0.02, 0.01, 0.01))
        plan = planner.step(x, plan)
        require_honest(plan, x)
        path = od.simulate(SYSTEM, x, known, PROBLEM.step)
        if is_feasible(PROBLEM, path):
            assert plan.feasible
            assert plan.value >= PROBLEM.value(path)


def test_elapsed_counts_from_the_previous_plan(planner: Planner, first: Plan):
    x = flown(START, first, 1.0)
    assert same_bytes(planner.step(x, first), planner.step(x, first, elapsed=1.0))
    again = planner.step(START, first, elapsed=0.0)
    assert again.time == 0.0 and again.value >= first.value
    late = planner.step(flown(START, first, 3.0), first, elapsed=3.0)
    assert late.time == 3.0 and late.feasible


# ---------------------------------------------------------------- nothing raises


def solution_of(status: od.Status, p: Callable[[np.ndarray], np.ndarray]) -> Callable[..., Solution]:
    def climbed(program: Any, aim: Any, start: np.ndarray, *rest: Any, **limits: Any) -> Solution:
        return replace(REAL_CLIMB(program, aim, start, *rest, **limits), status=status, p=p(start))

    return climbed


FAILURES: dict[str, Callable[..., Any]] = {
    "raises": no_climb,
    "not a number": solution_of(od.Status.NUMERICAL_ERROR, lambda p: p * np.nan),
    "out of bounds": solution_of(od.Status.LOCALLY_OPTIMAL, lambda p: p + 3.0),
    "straight into the obstacle": solution_of(od.Status.LOCALLY_OPTIMAL, lambda p: p * 0),
    "too few parameters": solution_of(od.Status.LOCALLY_OPTIMAL, lambda p: p[:3]),
    "nothing at all": lambda *_, **__: None,
    **{status.name: solution_of(status, lambda p: p) for status in od.Status},
}


@pytest.mark.parametrize("failure", FAILURES)
def test_a_climb_that_fails_leaves_the_path_that_was_known(planner: Planner, first: Plan, failure: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(tightening, "solve", FAILURES[failure])
    x = flown(START, first, 1.0)
    plan = planner.step(x, first)
    require_honest(plan, x)
    assert plan.feasible and plan.age <= 1
    np.testing.assert_array_equal(plan.trajectory.u, rest(first, 4))
    if failure in ("raises", "not a number", "nothing at all"):  # the same without anything known
        require_honest(planner.step(START), START)
    monkeypatch.undo()  # and the next step recovers
    x = flown(x, plan, 1.0)
    recovered, held = planner.step(x, plan), od.simulate(SYSTEM, x, rest(plan, 4), PROBLEM.step)
    assert recovered.feasible
    assert recovered.value >= PROBLEM.value(held) * (1 - 1e-9) or not is_feasible(replace(PROBLEM, start=x), held)


def test_a_better_path_that_breaks_a_limit_is_not_taken(monkeypatch: pytest.MonkeyPatch):
    weave = np.repeat([0.6, -0.6, 0.6, -0.6], 3)
    swinging, straight = (od.simulate(SYSTEM, START, np.repeat(p, 4)[:, None], 0.25) for p in (weave, 0 * weave))
    furthest = int(np.hypot(*(swinging.x - straight.x)[:, :2].T).argmax())
    problem = replace(PROBLEM, constraints=(od.KeepOut(tuple(swinging.x[furthest, :2]), 0.3),))
    assert problem.value(swinging) > problem.value(straight) and not is_feasible(problem, swinging) and is_feasible(problem, straight)
    planner = Planner(problem, every=1.0, starts=1)
    known = planner.step(START, deadline=0.0)
    monkeypatch.setattr(tightening, "solve", solution_of(od.Status.LOCALLY_OPTIMAL, lambda _: weave))
    plan = planner.step(START, known, elapsed=0.0)
    assert plan.feasible and plan.age == 1 and not plan.trajectory.u.any()


def test_after_a_climb_that_failed_the_next_begins_with_the_path(planner: Planner, first: Plan, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(tightening, "solve", solution_of(od.Status.LOCALLY_INFEASIBLE, lambda p: 0 * p))
    plan = planner.step(flown(START, first, 1.0), first)
    np.testing.assert_allclose(np.repeat(plan.p, 4), rest(first, 4)[:, 0], atol=1e-12)


def test_where_the_held_end_of_a_path_breaks_a_limit_it_ends_otherwise(monkeypatch: pytest.MonkeyPatch):
    """Straight on for 15 s there is a wall; turning in the last 3 s leads past it."""
    wall = od.KeepIn(((-6.0, -7.0), (16.4, -7.0), (16.4, 9.0), (-6.0, 9.0)))
    problem = replace(PROBLEM, constraints=(wall,))
    planner = Planner(problem, every=3.0, starts=1)
    monkeypatch.setattr(tightening, "solve", solution_of(od.Status.ITERATION_LIMIT, lambda p: 0 * p))
    straight = od.simulate(SYSTEM, START, np.zeros((48, 1)), 0.25)
    before = replace(planner.step(START, deadline=0.0), trajectory=straight)
    x = straight.x[12]
    assert not is_feasible(problem, od.simulate(SYSTEM, x, np.zeros((48, 1)), 0.25))
    plan = planner.step(x, before)
    require_honest(plan, x, problem)
    assert plan.feasible and plan.age == 1
    assert not plan.trajectory.u[:36].any() and np.all(np.abs(plan.trajectory.u[36:]) == 0.8)


NO_STATES: dict[str, Any] = {
    "not a number": np.full(5, np.nan),
    "infinite": np.array([np.inf, 0, 0, 0, 0]),
    "too short": START[:3],
    "a word": "north",
    "nothing": None,
}


@pytest.mark.parametrize("name", NO_STATES)
def test_where_the_state_is_none_the_path_goes_on_as_it_was_planned(planner: Planner, first: Plan, name: str):
    plan = planner.step(NO_STATES[name], first)
    require_honest(plan, NO_STATES[name])
    assert not plan.feasible and plan.status is od.Status.NUMERICAL_ERROR and plan.reason
    np.testing.assert_allclose(plan.x0, first.trajectory.x[4], atol=1e-12)
    np.testing.assert_array_equal(plan.trajectory.u, rest(first, 4))
    alone = planner.step(NO_STATES[name])
    require_honest(alone, NO_STATES[name])
    # and from the next state on all is well
    x = flown(START, first, 2.0)
    assert planner.step(x, plan).feasible


def test_a_state_that_is_absurd_is_none_the_less_planned_from(planner: Planner, first: Plan):
    there = np.full(5, 1e300)
    plan = planner.step(there, first)
    np.testing.assert_array_equal(plan.x0, there)
    assert not plan.feasible and "KeepIn" in plan.reason
    assert planner.step(flown(START, first, 2.0), plan).feasible


BAD: dict[str, dict[str, Any]] = {
    "prior of another size": {"prior": np.eye(3)},
    "prior not symmetric": {"prior": np.triu(np.ones((5, 5)))},
    "prior not positive": {"prior": -np.eye(5)},
    "prior not a number": {"prior": np.full((5, 5), np.nan)},
    "prior of words": {"prior": "much"},
    "deadline not a number": {"deadline": float("nan")},
    "deadline a word": {"deadline": "soon"},
    "elapsed not a number": {"elapsed": float("nan")},
    "elapsed before": {"elapsed": -1.0},
}


@pytest.mark.parametrize("name", BAD)
def test_arguments_that_mean_nothing_leave_the_path_that_was_known(planner: Planner, first: Plan, name: str):
    x = flown(START, first, 1.0)
    plan = planner.step(x, first, **BAD[name])
    require_honest(plan, x)
    assert plan.feasible and plan.status is od.Status.NUMERICAL_ERROR
    assert plan.reason.startswith(("prior", "known", "deadline", "elapsed"))
    np.testing.assert_array_equal(plan.trajectory.u, rest(first, 4))


def test_a_previous_plan_that_is_none_is_forgotten(planner: Planner):
    plan = planner.step(START, "the plan of yesterday")  # pyright: ignore[reportArgumentType]
    require_honest(plan, START)
    assert plan.status is od.Status.NUMERICAL_ERROR


@pytest.mark.parametrize("deadline", [0.0, -1.0, 1e-9])
def test_at_the_deadline_the_path_that_is_known_goes_on(planner: Planner, first: Plan, deadline: float):
    x = flown(START, first, 1.0)
    plan = planner.step(x, first, deadline=deadline)
    require_honest(plan, x)
    assert plan.feasible and plan.age == 1 and plan.status is od.Status.TIME_LIMIT
    np.testing.assert_array_equal(plan.trajectory.u, rest(first, 4))
    assert plan.value == pytest.approx(PROBLEM.value(plan.trajectory), rel=1e-12)
    # without a plan there is no more than to leave the controls alone
    alone = planner.step(START, deadline=deadline)
    require_honest(alone, START)
    assert alone.status is od.Status.TIME_LIMIT and not alone.trajectory.u.any()


def test_a_time_that_is_long_enough_changes_nothing(planner: Planner, first: Plan):
    x = flown(START, first, 1.0)
    assert same_bytes(planner.step(x, first), planner.step(x, first, deadline=60.0))


def test_from_beyond_a_limit_the_plan_leads_back_and_says_so(planner: Planner, first: Plan):
    inside = np.array([4.7, 1.0, 2.5, 0.2, -0.1])  # 1.3 m from the centre, heading out
    for plan in (planner.step(inside, first), planner.step(inside)):
        require_honest(plan, inside)
        assert not plan.feasible and "missed by 0.2 m" in plan.reason
        beyond = np.hypot(*(plan.trajectory.x[:, :2] - OBSTACLE.centre).T) - OBSTACLE.radius
        back = int(np.argmax(beyond >= 0))
        assert 0 < back <= 8 and beyond[back:].min() >= -1e-5
        assert plan.status is not od.Status.NUMERICAL_ERROR


def test_on_a_landmark_the_path_that_is_known_goes_on():
    system = od.System(od.Dubins(1.0, wind="constant"), (od.GPS(2.0), od.Range((3.0, 4.0), 0.5)))
    planner = Planner(replace(PROBLEM, system=system, constraints=(AREA,)), every=1.0, starts=1)
    first, there = planner.step(START), np.array([3.0, 4.0, 0.0, 0.2, -0.1])
    plan = planner.step(there, first)
    np.testing.assert_array_equal(plan.trajectory.u, rest(first, 4))
    np.testing.assert_array_equal(plan.x0, there)
    assert "landmark" in plan.reason and plan.feasible == is_feasible(planner.problem, plan.trajectory)


# ---------------------------------------------------------------- what is known so far


def test_what_is_known_so_far_is_added_to_the_information(planner: Planner, first: Plan):
    x, prior = flown(START, first, 1.0), od.Prior(START, std=STD)
    plan = planner.step(x, first, prior)
    W = od.variational_gramian(SYSTEM, plan.trajectory).total + np.diag(1 / np.square(STD))
    assert plan.value == pytest.approx(np.linalg.eigvalsh(W * np.outer(SCALE, SCALE))[0], rel=1e-9)
    assert same_bytes(plan, planner.step(x, first, prior.information))
    assert plan.value > planner.step(x, first).value
    # who knows the wind already plans another path than who does not
    knows_wind = planner.step(x, first, np.diag([0.0, 0.0, 0.0, 1e6, 1e6]))
    assert np.abs(knows_wind.trajectory.u - planner.step(x, first).trajectory.u).max() > 1e-3


def test_what_is_known_so_far_takes_the_place_of_the_prior_of_draws(planner: Planner):
    problem = replace(PROBLEM, constraints=(), robust=od.Robust(od.Prior(START, std=STD), samples=4))
    far, x = Planner(problem, starts=1), START + 1.0
    information = np.diag(1 / np.square(np.array(STD) / 3))
    plan = far.step(x, prior=information)
    draws = od.Robust(od.Prior(x, covariance=np.linalg.inv(information)), samples=4).draws(4, 0)
    every = od.batch_information(SYSTEM, draws, plan.trajectory.u, PROBLEM.step).sum(axis=1) + information
    assert plan.value == pytest.approx(min(np.linalg.eigvalsh(W * np.outer(SCALE, SCALE))[0] for W in every), rel=1e-9)


def test_what_is_known_so_far_takes_the_place_of_the_prior_of_a_posterior():
    psd, information = (1e-4, 1e-4, 1e-5, 1e-6, 1e-6), np.diag(1 / np.square(np.array(STD) / 3))
    problem = replace(
        PROBLEM, duration=6.0, path=od.PiecewiseConstant(4), constraints=(), criterion=od.Posterior(od.Prior(START, std=STD), psd)
    )
    plan = Planner(problem, starts=1).step(START, prior=information)
    J = od.posterior_information(SYSTEM, plan.trajectory, od.Prior(START, covariance=np.linalg.inv(information)), psd)[-2]
    assert plan.value == pytest.approx(np.linalg.eigvalsh(J * np.outer(SCALE, SCALE))[0], rel=1e-9)


@pytest.mark.parametrize(
    "asked",
    [
        {"robust": od.Robust(od.Prior(START, std=STD), samples=3)},
        {"path": od.BSpline(8)},
        {"path": od.DubinsPath("LSR", 1.0)},
        {"floor": od.Floor(6.0, 1e-4), "criterion": od.LogDet()},
        {"prices": (od.Price(od.Effort({"turn_rate": 1.0}), 0.1),), "rates": {"turn_rate": 0.4}},
    ],
    ids=["robust", "spline", "dubins", "floor", "price"],
)
def test_whatever_can_be_designed_can_be_planned(asked: dict[str, Any]):
    problem = replace(PROBLEM, duration=6.0, step=0.5, path=od.PiecewiseConstant(6), constraints=(AREA,))
    problem = replace(problem, **asked)
    planner = Planner(problem, starts=1)
    plan, x = planner.step(START, prior=od.Prior(START, std=STD)), START
    for _ in range(2):
        known = rest(plan, 1)
        x = od.simulate(SYSTEM, x, plan.trajectory.u[:1], 0.5).x[-1]
        plan = planner.step(x, plan, od.Prior(x, std=STD))
        require_honest(plan, x, problem)
        assert plan.status is not od.Status.NUMERICAL_ERROR, plan.reason
        np.testing.assert_array_less(np.abs(plan.trajectory.u), 0.8 + 1e-9)
        if plan.age:
            np.testing.assert_array_equal(plan.trajectory.u, known)


# ---------------------------------------------------------------- a mission that ends


def test_in_a_mission_the_horizon_shrinks_the_goal_is_reached_and_budgets_are_kept():
    goal, via = od.Goal((6.0, -3.0), 0.5), od.Via((3.0, 3.0), 0.7, 0.0, 8.0)
    budget = od.Budget(od.PathLength(), 13.0)
    problem = replace(PROBLEM, constraints=(goal, via, AREA), budgets=(budget,))
    planner = Planner(problem, every=1.0, horizon="shrinking", starts=2)
    plan, x, states = None, START, [START]
    for k in range(12):
        plan = planner.step(x, plan)
        assert plan.feasible and plan.trajectory.steps == 48 - 4 * k and plan.time == k, plan.reason
        path = od.simulate(SYSTEM, x, plan.trajectory.u[:4], 0.25).x
        states, x = [*states, *path[1:]], path[-1]
    way = np.array(states)[:, :2]
    assert np.hypot(*(way[-1] - goal.point)) <= 0.5 * (1 + 1e-5)
    assert np.hypot(*(way[:33] - via.point).T).min() <= 0.7 + 0.15  # at a node; between two of them it is nearer
    assert np.hypot(*np.diff(way, axis=0).T).sum() <= 13.0 * (1 + 1e-5)
    after = planner.step(x, plan)
    assert after.trajectory.steps == 1 and after.time == 12.0


def test_in_a_mission_limits_keep_their_times():
    loiter = od.Loiter((4.0, 0.5), 1.2, 5.0, 7.0)
    planner = Planner(replace(PROBLEM, constraints=(loiter, AREA)), every=1.0, horizon="shrinking", starts=2)
    plan, x, states = None, START, [START]
    for k in range(9):
        plan = planner.step(x, plan)
        assert plan.feasible, plan.reason
        path = od.simulate(SYSTEM, x, plan.trajectory.u[:4], 0.25).x
        states, x = [*states, *path[1:]], path[-1]
        assert len(plan.memory.constraint_indices) == (2 if k <= 7 else 1)
    away = np.hypot(*(np.array(states)[:, :2] - loiter.centre).T)
    assert away[20:29].max() <= 1.2 * (1 + 1e-5)


# ---------------------------------------------------------------- refusals, at construction only


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"every": 0.3}, "every is 0.3"),
        ({"every": 0.0}, "every is 0.0"),
        ({"every": float("nan")}, "every is nan"),
        ({"horizon": "far"}, "horizon is 'far'"),
        ({"iterations": 0}, "iterations is 0"),
        ({"enough": 0.0}, "enough is 0.0"),
        ({"starts": 0}, "starts is 0"),
        ({"seed": -1}, "seed is -1"),
        ({"problem": replace(PROBLEM, duration=(8.0, 12.0))}, "duration is"),
    ],
)
def test_a_planner_is_refused_before_take_off(changes: dict[str, Any], message: str):
    with pytest.raises(od.InputError, match=message):
        Planner(**{"problem": PROBLEM, **changes})


def test_what_no_path_shows_is_refused_before_take_off():
    blind = replace(PROBLEM, system=od.System(od.Dubins(1.0, wind="constant"), (od.Magnetometer(0.1),)))
    with pytest.raises(od.UnobservableError):
        Planner(blind)


# ---------------------------------------------------------------- closed loop


def loop(planner: Planner, steps: int, seconds: float, start: np.ndarray = START) -> list[Plan]:
    """Plans along a flight without noise."""
    plan, x, plans = None, start, []
    for _ in range(steps):
        plan = planner.step(x, plan)
        plans.append(plan)
        x = flown(x, plan, seconds)
    return plans


def shares_of_the_end(planner: Planner, flights: int, steps: int) -> np.ndarray:
    """Value of each plan (flights, steps) over that of 60 iterations from the same plan at the same place; flights begin at several places.

    Loops of their own come to different optima, whose values say nothing of the iterations.
    """
    thorough, shares = replace(planner, iterations=60, enough=1e-9), []
    for seed in range(flights):
        moved = np.random.default_rng(seed).normal(size=5) * (1.0, 1.0, 0.2, 0.05, 0.05) if seed else np.zeros(5)
        plans = loop(planner, steps + 1, 1.0, START + moved)
        for plan in plans[1:]:
            require_honest(plan, plan.x0)
            assert plan.feasible, plan.reason
        shares.append([plan.value / thorough.step(plan.x0, before).value for before, plan in pairwise(plans)])
    return np.array(shares)


def test_a_few_iterations_a_step_achieve_what_solving_each_step_to_the_end_does(planner: Planner):
    assert shares_of_the_end(planner, 3, 9).mean() >= 0.95


@pytest.mark.slow
def test_a_few_iterations_a_step_do_so_over_whole_flights(planner: Planner):
    """The mean of all plans, also of those few in a stretch where a better way opens that takes the few iterations several steps."""
    assert shares_of_the_end(planner, 6, 30).mean() >= 0.95


def test_more_iterations_climb_higher(planner: Planner):
    """From a straight path one iteration does not find what many do."""
    straight = planner.step(START, deadline=0.0)
    once, often, to_the_end = (
        replace(planner, iterations=count, enough=enough).step(START, straight, elapsed=0.0)
        for count, enough in ((1, 1e-9), (4, 0.05), (60, 1e-9))
    )
    assert once.value < 0.9 * often.value and often.value <= to_the_end.value * (1 + 1e-3)


@pytest.mark.slow
def test_five_hundred_steps_with_a_deadline_neither_raise_nor_stall(often: Planner):
    random, plan, x, plans = np.random.default_rng(0), None, START, []
    for _ in range(500):
        plan = often.step(x, plan, deadline=None if plan is None else 0.1)
        plans.append(plan)
        x = flown(x, plan, 0.25) + random.normal(0, (0.01, 0.01, 0.005, 0.0, 0.0))
    assert all(plan.status is not od.Status.NUMERICAL_ERROR for plan in plans)
    assert np.mean([plan.feasible for plan in plans]) >= 0.9
    assert np.mean([plan.seconds <= 0.1 for plan in plans[1:]]) >= 0.95


# ---------------------------------------------------------------- the filter in the loop

PSD = (1e-3, 1e-3, 1e-4, 1e-5, 1e-5)
PRIOR = od.Prior(START, std=(1.0, 1.0, 0.2, 0.3, 0.3))


@pytest.fixture(scope="module")
def flights() -> list[Flight]:
    problem = replace(PROBLEM, constraints=(), step=0.5, path=od.PiecewiseConstant(8))
    return [fly(problem, PRIOR, every=3.0, duration=24.0, disturbance_psd=PSD, seed=seed) for seed in range(4)]


def test_the_filter_in_the_loop_is_honest(flights: list[Flight]):
    """The NEES averaged over flights and the later half, in a generous band, as its instants are not independent."""
    low, high = chi2.ppf([1e-3, 1 - 1e-3], 5 * len(flights)) / len(flights)
    assert low <= np.mean([flight.nees[24:] for flight in flights]) <= high


def test_the_wind_is_estimated_better_than_on_the_straight_flight(flights: list[Flight]):
    planned, straight = (np.array([f.std[-1, 3:] for f in each]) for each in (flights, [f.straight for f in flights]))
    assert np.all(planned < 0.12)
    # flown straight, the wind across and the heading cannot be told apart
    assert np.all(planned.max(axis=1) < 0.6 * straight.max(axis=1))
    errors = [np.sqrt(np.mean([(f.mean - f.truth)[-1, 3:] ** 2 for f in each])) for each in (flights, [f.straight for f in flights])]
    assert errors[0] < errors[1]


def test_both_flights_are_of_the_same_world(flights: list[Flight]):
    for flight in flights:
        straight = flight.straight
        np.testing.assert_array_equal(flight.truth[0], straight.truth[0])
        assert not straight.u.any() and straight.straight is None and straight.statuses == ()
        # constant wind moves by the process noise alone, which is the same
        np.testing.assert_allclose(flight.truth[:, 3:], straight.truth[:, 3:], atol=1e-12)
        assert len(flight.statuses) == len(flight.values) == len(flight.ages) == len(flight.seconds) == len(flight.feasible) == 8
        assert flight.t.shape == (49,) and flight.u.shape == (48, 1) and flight.margin == np.inf
    assert len({flight.truth.tobytes() for flight in flights}) == len(flights)


def test_the_same_seed_gives_the_same_flight(flights: list[Flight]):
    problem = replace(PROBLEM, constraints=(), step=0.5, path=od.PiecewiseConstant(8))
    again = fly(problem, PRIOR, every=3.0, duration=24.0, disturbance_psd=PSD, seed=2)
    for name in ("t", "truth", "mean", "std", "u", "nees", "values", "ages", "statuses", "feasible"):
        assert np.asarray(getattr(again, name)).tobytes() == np.asarray(getattr(flights[2], name)).tobytes() or name == "statuses"
    assert again.statuses == flights[2].statuses


def test_the_first_plan_of_a_flight_counts_the_prior_once(flights: list[Flight]):
    problem = replace(PROBLEM, constraints=(), step=0.5, path=od.PiecewiseConstant(8))
    flight = flights[0]
    plan = Planner(problem, every=3.0).step(flight.mean[0], prior=PRIOR.information)
    assert flight.values[0] == pytest.approx(plan.value, rel=1e-6)
    np.testing.assert_allclose(flight.u[:6], plan.trajectory.u[:6], atol=1e-6)


@pytest.fixture(scope="module")
def cart() -> od.DesignProblem:
    """Place and speed of a cart that is pushed; its place is measured: Kalman's filter, whose covariance no path changes."""
    x = ca.SX.sym("x", 2)
    known: dict[str, ca.SX] = {"push": ca.vertcat(0.0, 1.0)}
    system = od.ControlAffineSystem(
        state=x,
        names=("place", "speed"),
        drift=ca.vertcat(x[1], 0.0),
        known=known,
        unknown={},
        outputs={"place": x[0]},
        sigmas={"place": 0.5},
    )
    bounds = {"push": (-1.0, 1.0)}
    return od.DesignProblem(system=system, start=(0.0, 1.0), duration=4.0, step=0.5, path=od.PiecewiseConstant(4), bounds=bounds)


CART_PRIOR, CART_PSD = od.Prior(np.zeros(2), std=(2.0, 2.0)), (0.01, 0.02)


def test_where_all_is_linear_the_filter_in_the_loop_knows_what_the_bound_allows(cart: od.DesignProblem):
    flight = fly(cart, CART_PRIOR, every=1.0, duration=6.0, disturbance_psd=CART_PSD, seed=3)
    path = od.simulate(cart.system, np.zeros(2), np.zeros((12, 1)), 0.5)
    J = od.posterior_information(cart.system, path, CART_PRIOR, CART_PSD)
    for each in (flight, flight.straight):
        np.testing.assert_allclose(each.std, np.sqrt(np.diagonal(np.linalg.inv(J), axis1=1, axis2=2)), rtol=1e-9)


def test_where_all_is_linear_errors_are_as_the_filter_says(cart: od.DesignProblem):
    """At every instant the NEES of 100 flights averages to n = 2, to within what chance allows once in a thousand times."""
    noise = flying.noise_of(cart.system.model, CART_PSD, None, cart.step)
    estimator = flying.FilterBank(cart.system, cart.step, noise)
    worlds = [flying._draw_realisation(cart, CART_PRIOR, None, noise, 12, seed) for seed in range(100)]
    flights = [flying._simulate_flight(flying._Simulation(cart, CART_PRIOR, estimator, world), lambda *_: np.ones(1)) for world in worlds]
    average = np.mean([flight.nees for flight in flights], axis=0)
    low, high = chi2.ppf([5e-4 / 13, 1 - 5e-4 / 13], 200) / 100
    assert np.all((low < average) & (average < high))


def test_correlated_noise_and_constant_errors_are_those_of_the_sensors():
    gps = od.GPS(2.0, correlation=0.8, bias_floor=1.5)
    problem = replace(PROBLEM, system=od.System(od.Dubins(1.0, wind="constant"), (gps,)), constraints=())
    before, white_constant, *white = np.random.default_rng(0).standard_normal((20002, 2))
    due = np.ones((20000, 2), dtype=bool)
    due[1::2] = False  # a sample every other step
    noise = measurement_noise(problem.system.model, np.array(white), white_constant, due, before)
    sampled = noise.varying[::2]
    np.testing.assert_allclose(sampled.std(axis=0), 1.0, atol=0.05)
    np.testing.assert_allclose((sampled[1:] * sampled[:-1]).mean(axis=0), 0.8, atol=0.06)
    np.testing.assert_array_equal(noise.constant, 1.5 * white_constant)
    assert sampled[0] == pytest.approx(0.8 * before + 0.6 * white[0])  # the first follows the one before


def test_a_flight_tells_how_near_the_truth_came_to_its_limits():
    problem = replace(PROBLEM, step=0.5, path=od.PiecewiseConstant(8))
    flight = fly(problem, od.Prior(START, std=np.array(STD) / 20), every=2.0, duration=8.0, truth=START, seed=1)
    np.testing.assert_array_equal(flight.truth[0], START)
    away = np.hypot(*(flight.truth[:, :2] - OBSTACLE.centre).T).min() / OBSTACLE.radius - 1
    size = AREA.size[0]
    x, y = flight.truth[:, 0], flight.truth[:, 1]
    inside = min((x + 6).min(), (14 - x).min(), (y + 7).min(), (7 - y).min()) / size
    assert flight.margin == pytest.approx(min(away, inside), abs=1e-5)
    # without process noise the truth is where the inputs lead
    np.testing.assert_allclose(flight.truth, od.simulate(SYSTEM, START, flight.u, 0.5).x, atol=1e-12)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"duration": 0.9}, "duration is 0.9"),
        ({"duration": -1.0}, "duration is -1.0"),
        ({"every": 0.9}, "every is 0.9"),
        ({"seed": -1}, "seed is -1"),
        ({"deadline": 0.0}, "deadline is 0.0"),
        ({"truth": np.zeros(3)}, "truth has shape"),
        ({"prior": od.Prior(np.zeros(2), std=(1.0, 1.0))}, "prior has 2 states"),
        ({"disturbance_psd": np.full(5, -1.0)}, "disturbance_psd"),
    ],
)
def test_a_flight_is_refused_before_take_off(changes: dict[str, Any], message: str):
    asked: dict[str, Any] = {"prior": PRIOR, "every": 1.0, "duration": 4.0, **changes}
    with pytest.raises(od.InputError, match=message):
        fly(PROBLEM, asked.pop("prior"), **asked)


def test_shortfalls_of_a_plan_that_breaks_a_limit_are_told_in_words(planner: Planner, first: Plan):
    """Boxed in: no path keeps out of a wall that is a metre ahead of a vehicle that turns in 1.25 m."""
    wall = replace(PROBLEM, constraints=(od.KeepOut((3.0, 0.0), 2.2),))
    plan = Planner(wall, every=1.0, starts=1).step(START)
    short = violations(wall, plan.trajectory)
    assert not plan.feasible and str(short[0]) in plan.reason
