"""Missions that have a path: a random control flies one first, limits are drawn closely round it, and a design must be found."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
import pytest
from test_missions import FINEST, Flown, chord, distance, missed_at, ring, steepest_rates, turned_from

import obsdesign as od
from obsdesign.constraints.abstract import AbstractConstraint
from obsdesign.design.feasibility import is_feasible, violations
from obsdesign.design.feasible_search import search_feasible_path
from obsdesign.design.infeasibility import why_unreachable
from obsdesign.design.local_solve import LocalSolution, LocalSolve, solve_locally
from obsdesign.design.path_costs import total_costs

SHARE = 1e-6  # of a limit's own size by which it may be missed
Random = np.random.Generator


@dataclass(frozen=True)
class Known:
    """A problem, and inputs (N, m) that keep all its limits."""

    problem: od.DesignProblem
    u: np.ndarray
    margin: float


def flown(problem: od.DesignProblem, u: np.ndarray, finer: int) -> Flown:
    """Arcs in the moving air, in closed form."""
    step, names = problem.step, problem.system.model.input_names
    air = u[:, names.index("speed")] if "speed" in names else np.full(len(u), problem.system.vehicle.speed)
    turn, x = u[:, names.index("turn_rate")], problem.x0
    wind = x[3:5] if len(x) > 3 else np.zeros(2)
    heading = x[2] + np.append(0.0, np.cumsum(turn)) * step
    nodes = x[0] + 1j * x[1] + np.append(0.0, np.cumsum(chord(air, turn, step) * np.exp(1j * (heading[:-1] + turn * step / 2))))
    s = np.arange(finer + 1) / finer * step
    w = turn[:, None] * s
    z = (nodes[:-1, None] + chord(air[:, None], turn[:, None], s) * np.exp(1j * (heading[:-1, None] + w / 2))).ravel()
    headings, t = (heading[:-1, None] + w).ravel(), (np.arange(len(u))[:, None] * step + s).ravel()
    velocity = np.repeat(air, finer + 1)[:, None] * np.column_stack([np.cos(headings), np.sin(headings)]) + wind
    return Flown(t, np.column_stack([z.real, z.imag]) + t[:, None] * wind, headings, velocity)


# ---------------------------------------------------------------- limits round a path, with a margin that is a share of their size


def beside(path: Flown, k: int, room: float, margin: float, random: Random) -> tuple[float, float]:
    """A point whose distance from the path's place k is `room` less a margin."""
    angle, away = random.uniform(-np.pi, np.pi), room * (1 - margin)
    return float(path.place[k, 0] + away * math.cos(angle)), float(path.place[k, 1] + away * math.sin(angle))


def window(path: Flown, first: float, last: float) -> tuple[float, float]:
    """A time about an interval, in tenths of a second: seldom at nodes, but at instants at which answers are looked at."""
    return max(0.0, math.floor(10 * first) / 10), min(float(path.t[-1]), math.ceil(10 * last) / 10)


def off_the_path(path: Flown, size: float, random: Random) -> tuple[tuple[float, float], float]:
    k = int(random.integers(len(path.t) // 5, len(path.t)))
    side = size * random.uniform(0.3, 2.0) * random.choice([-1, 1])
    centre = path.place[k] + side * np.array([-math.sin(path.heading[k]), math.cos(path.heading[k])])
    point = (float(centre[0]), float(centre[1]))
    return point, float(distance(path, point).min())


def goal(path: Flown, size: float, margin: float, random: Random) -> AbstractConstraint:
    room = size * random.uniform(0.1, 0.5)
    return od.Goal(beside(path, -1, room, margin, random), room)


def goal_pose(path: Flown, size: float, margin: float, random: Random) -> AbstractConstraint:
    room, angle = size * random.uniform(0.1, 0.5), random.uniform(0.1, 0.6)
    aim = path.heading[-1] + random.choice([-1, 1]) * angle * (1 - margin)
    return od.GoalPose(beside(path, -1, room, margin, random), float(aim), room, angle)


def via(path: Flown, size: float, margin: float, random: Random) -> AbstractConstraint:
    k, room = int(random.integers(len(path.t) // 6, len(path.t))), size * random.uniform(0.1, 0.5)
    first, last = window(path, path.t[k] - random.uniform(0.0, 0.2) * path.t[-1], path.t[k] + random.uniform(0.0, 0.2) * path.t[-1])
    return od.Via(beside(path, k, room, margin, random), room, first, last)


def keep_out(path: Flown, size: float, margin: float, random: Random) -> AbstractConstraint | None:
    centre, way = off_the_path(path, size, random)
    return od.KeepOut(centre, way * (1 - margin)) if way > 0.05 * size else None


def keep_out_polygon(path: Flown, size: float, margin: float, random: Random) -> AbstractConstraint | None:
    centre, way = off_the_path(path, size, random)
    return od.KeepOutPolygon(ring(np.array(centre), 0.95 * way * (1 - margin), 4, random)) if way > 0.05 * size else None


def keep_in(path: Flown, size: float, margin: float, random: Random) -> AbstractConstraint:
    low, high = path.place.min(axis=0), path.place.max(axis=0)
    room = margin * float((high - low).max()) + 1e-3 * size
    (left, bottom), (right, top) = (low - room).tolist(), (high + room).tolist()
    return od.KeepIn(((left, bottom), (right, bottom), (right, top), (left, top)))


def stand_off(path: Flown, size: float, margin: float, random: Random) -> AbstractConstraint | None:
    centre, way = off_the_path(path, size, random)
    return od.StandOff(way * (1 - margin), (centre,)) if way > 0.05 * size else None


def max_range(path: Flown, size: float, margin: float, random: Random) -> AbstractConstraint:
    point = tuple((path.place.mean(axis=0) + random.uniform(-1, 1, 2) * size).tolist())
    return od.MaxRange(float(distance(path, point).max()) * (1 + margin), (point,))


def sector(path: Flown, size: float, margin: float, random: Random) -> AbstractConstraint | None:
    first, last = window(path, *np.sort(random.uniform(0.1, 1.0, 2)) * path.t[-1])
    seen = path.heading[(path.t >= first) & (path.t <= last)]
    width = np.ptp(seen) if len(seen) else 7.0
    room = margin * width + 0.02
    return od.HeadingSector(float(seen.min() - room), float(seen.max() + room), first, last) if width < 5 else None


def loiter(path: Flown, size: float, margin: float, random: Random) -> AbstractConstraint:
    first = random.uniform(0.2, 0.8) * path.t[-1]
    first, last = window(path, first, first + 0.2 * path.t[-1])
    stay = path.place[(path.t >= first) & (path.t <= last)]
    centre = stay.mean(axis=0)
    return od.Loiter(tuple(centre.tolist()), float(np.hypot(*(stay - centre).T).max()) * (1 + margin), first, last)


def ground_speed(path: Flown, size: float, margin: float, random: Random) -> AbstractConstraint:
    speed = np.hypot(*path.velocity.T)
    return od.GroundSpeed(float(speed.min() * (1 - margin)), float(speed.max() * (1 + margin)))


LIMITS: tuple[Callable[[Flown, float, float, Random], AbstractConstraint | None], ...] = (
    goal, goal_pose, via, keep_out, keep_out_polygon, keep_in, stand_off, max_range, sector, loiter, ground_speed,
)  # fmt: skip


def mission(seed: int) -> Known:
    """A random vehicle, family and control of it; one to four limits whose margin is 1 to 10 % of their size."""
    random = np.random.default_rng([seed, 13])
    speed, step = float(random.choice([1.0, 15.0])), float(random.choice([0.5, 1.0]))
    steps = int(random.integers(16, 50))
    sharpest = random.uniform(0.2, 0.6) if random.random() < 0.8 else random.uniform(0.6, 1.0)
    bounds, vehicle = {"turn_rate": (-sharpest, sharpest * random.uniform(0.7, 1.0))}, od.Dubins(speed)
    wind = [] if random.random() < 0.5 else random.uniform(-0.3, 0.3, 2).tolist()
    if wind:
        vehicle, wind = od.Dubins(speed, wind="constant"), [each * speed for each in wind]
    if random.random() < 0.2:
        vehicle, bounds = od.Unicycle(wind="constant" if wind else None), {"speed": (0.4 * speed, 1.3 * speed), **bounds}
    size = speed * sharpest**-1
    system = od.System(vehicle, (od.GPS(2.0), od.Magnetometer(0.2)))
    start = [*random.uniform(-1, 1, 2), random.uniform(-np.pi, np.pi), *wind]
    path = od.BSpline(int(random.integers(5, 12))) if random.random() < 0.4 else od.PiecewiseConstant(int(random.integers(4, 16)))
    problem = od.DesignProblem(system, start, steps * step, step, path, bounds, scale=[size, size, 0.3, *([0.1 * speed] * len(wind))])
    u = control(problem, random)
    margin = random.uniform(0.01, 0.1)
    seen = flown(problem, u, 200)
    drawn = random.choice(len(LIMITS), random.choice([1, 2, 3, 4]), replace=False)
    limits = tuple(limit for i in drawn if (limit := LIMITS[i](seen, size, margin, random)) is not None)
    changes: dict[str, Any] = {"constraints": limits}
    if random.random() < 0.2:
        each = steepest_rates(problem, u) * (1 + margin)
        changes["rates"] = dict(zip(problem.system.model.input_names, (each + 1e-3).tolist(), strict=True))
    if random.random() < 0.2:
        changes["budgets"] = (od.Budget(od.Effort({"turn_rate": 1.0}), float((u[:, -1] ** 2).sum() * step) * (1 + margin) + 1e-9),)
    if random.random() < 0.15:
        changes["duration"] = (max(1, steps - 4) * step, (steps + 4) * step)
        ends = [each.span.last for each in limits if each.span.last is not None] + [each.span.first or 0.0 for each in limits]
        if max(ends, default=0.0) > changes["duration"][0]:
            del changes["duration"]
    return Known(dataclasses.replace(problem, **changes), u, margin)


def control(problem: od.DesignProblem, random: Random) -> np.ndarray:
    """Inputs (N, m) of the problem's family: parameters anywhere in their box, or a few levels."""
    lower, upper = problem.path.box(problem.grid)
    share = random.random(len(lower)) if random.random() < 0.5 else np.repeat(random.random(-(-len(lower) // 3)), 3)[: len(lower)]
    return np.asarray(problem.path.inputs(lower + share * (upper - lower), problem.grid), dtype=float).reshape(problem.steps, -1)


def require_kept(problem: od.DesignProblem, found: od.Trajectory) -> None:
    """Every limit of the path that is returned, seen 1,000 times a step."""
    u = found.u
    path = flown(problem, u, FINEST)
    assert np.all(u >= problem.lower - 1e-9) and np.all(u <= problem.upper + 1e-9)
    for limit in problem.constraints:
        share = missed_at(limit, path)
        assert share <= SHARE, f"{limit} is missed by {share:.2e}"
    for name, change in zip(problem.system.model.input_names, steepest_rates(problem, u), strict=True):
        assert change <= problem.rates.get(name, np.inf) * (1 + SHARE)
    for budget in problem.budgets:
        assert float((u[:, -1] ** 2).sum() * problem.step) <= budget.at_most * (1 + SHARE)


def answered(seed: int) -> bool:
    """Whether a mission has an answer, which must keep every limit; it has a path, so nothing may prove that it has none."""
    known = mission(seed)
    design = od.design_trajectory(known.problem, starts=1, seed=0, throw=False)
    assert design.status is not od.Status.INFEASIBLE, design.reason
    if not design.status.has_answer:
        assert "none found in" in design.reason
        return False
    require_kept(design.problem, design.trajectory)
    return True


def kept(seed: int) -> bool:
    """Whether a path that keeps all limits is found before anything climbs: such a one is returned whatever the climbs do."""
    known = mission(seed)
    assert why_unreachable(known.problem) == ""
    problem = known.problem.with_duration(len(known.u) * known.problem.step)
    found = search_feasible_path(problem, 0)
    if found.is_feasible:
        require_kept(problem, found.path)
    return found.is_feasible


def test_the_control_that_a_mission_is_drawn_round_keeps_its_limits():
    for known in map(mission, range(60)):
        path = flown(known.problem, known.u, FINEST)
        if known.problem.shortest == known.problem.longest:
            assert max((missed_at(limit, path) for limit in known.problem.constraints), default=0.0) <= 0


def test_missions_that_have_a_path_are_answered():
    assert all(map(answered, range(3)))
    assert all(map(kept, range(3, 28)))


@pytest.mark.slow
def test_of_a_thousand_missions_that_have_a_path_all_but_five_are_answered():
    """The bar: 99.5 %; what is answered keeps every limit to 1e-6 of its size."""
    assert sum(map(kept, range(1000))) >= 995
    assert sum(map(answered, range(100))) >= 99


def test_a_path_that_keeps_all_limits_is_returned_where_no_climb_comes_to_an_end(monkeypatch: pytest.MonkeyPatch):
    def given_up(task: LocalSolve) -> LocalSolution:
        return dataclasses.replace(
            solve_locally(task), status=od.Status.NUMERICAL_ERROR, path=od.simulate(RANGES, [0, 0, 3.0], task.u, 0.5)
        )

    for module in ("multistart", "climbs"):
        monkeypatch.setattr(f"obsdesign.design.{module}.solve_locally", given_up)
    problem = asked(constraints=(od.Goal((150.0, 40.0), 5.0),))
    design = od.design_trajectory(problem, starts=1)
    assert design.status is od.Status.GAP_OPEN
    assert "no climb came to an end" in design.reason
    assert design.value == problem.value(design.trajectory)
    require_kept(problem, design.trajectory)


# ---------------------------------------------------------------- a constant turn, a straight line, and limits between the nodes

RANGES = od.System(od.Dubins(15.0), (od.Range((150.0, 80.0), 1.0), od.Range((0.0, 200.0), 1.0)))


def asked(system: od.System = RANGES, **changes: Any) -> od.DesignProblem:
    base: dict[str, Any] = {
        "system": system,
        "start": [0.0, 0.0, 0.0, *([2.0, -1.0] if len(system.model.states) > 3 else [])],
        "duration": 20.0,
        "step": 0.5,
        "path": od.BSpline(8),
        "bounds": {"turn_rate": (-0.35, 0.35)},
    }
    return od.DesignProblem(**{**base, **changes})


def test_where_a_constant_turn_keeps_all_limits_there_is_a_design():
    """0.35 rad/s at 15 m/s is a circle of 42.9 m about a point 42.9 m abeam: within 85.8 m of the start, inside a square of 95 m."""
    corners = ((-95.0, -95.0), (95.0, -95.0), (95.0, 95.0), (-95.0, 95.0))
    problem = asked(start=[0.0, 0.0, -2.26], duration=40.0, scale=[50.0, 50.0, 0.3], constraints=(od.KeepIn(corners),))
    design = od.design_trajectory(problem, starts=1)
    require_kept(problem, design.trajectory)


def test_a_budget_that_leaves_room_for_a_straight_line_alone_is_met_by_one():
    """15 m/s for 10 s are 150 m, 10 m short of the goal; every longer duration is over the budget of 150.01 m."""
    budget = od.Budget(od.PathLength(), 150.01)
    problem = asked(duration=(10.0, 12.0), constraints=(od.Goal((160.0, 0.0), 10.0),), budgets=(budget,))
    design = od.design_trajectory(problem, starts=1)
    assert design.problem.duration == 10.0
    assert np.abs(np.cumsum(design.trajectory.u)).max() * 0.5 < 1e-2
    path = flown(problem, design.trajectory.u, FINEST)
    assert missed_at(problem.constraints[0], path) <= SHARE


@pytest.mark.parametrize("share", [0.5, 0.8])
def test_a_budget_of_length_is_kept_by_the_path_itself_however_coarse_the_steps(share: float):
    """Speed and heading change within steps of 1.5 s, and so does ground speed in wind: its sum at their beginnings is off by 1e-2."""
    system = od.System(od.Unicycle(wind="constant"), (od.GPS(2.0), od.Magnetometer(0.2)))
    bounds = {"speed": (1.0, 2.0), "turn_rate": (-0.6, 0.6)}
    longest = 24 * 2.0
    budget = od.Budget(od.PathLength(), share * longest)
    given: dict[str, Any] = {"system": system, "start": [0.0, 0.0, 0.3, 0.5, -0.4], "duration": 24.0, "step": 1.5, "bounds": bounds}
    problem = od.DesignProblem(**given, path=od.PiecewiseConstant(8), scale=[5.0, 5.0, 0.3, 0.2, 0.2], budgets=(budget,))
    path = od.design_trajectory(problem, starts=1).trajectory
    assert path is not None
    speed, turn, seconds = path.u[:, :1], path.u[:, 1:], 1.5 * (np.arange(2000) + 0.5) / 2000
    heading = 0.3 + 1.5 * np.append(0.0, np.cumsum(turn)[:-1])[:, None] + turn * seconds
    length = float(np.hypot(speed * np.cos(heading) + 0.5, speed * np.sin(heading) - 0.4).mean(axis=1).sum() * 1.5)
    assert length <= budget.at_most * (1 + SHARE)
    left = float(np.hypot(speed[:, 0] * np.cos(path.x[:-1, 2]) + 0.5, speed[:, 0] * np.sin(path.x[:-1, 2]) - 0.4).sum() * 1.5)
    assert abs(left / length - 1) > 1e-4  # so that a left sum would not do
    np.testing.assert_allclose(total_costs(problem.system, path, [budget.cost]), length, rtol=1e-7)


@pytest.mark.parametrize("speed", [1e-3, 1e4])
def test_a_budget_of_length_is_exact_at_any_speed(speed: float):
    """At constant speed the length is speed times duration whatever the turns: room of 1e-6 of it is room."""
    system = od.System(od.Dubins(speed), (od.Range((50 * speed, 40 * speed), speed), od.GPS(speed)))
    budget = od.Budget(od.PathLength(), 10 * speed * (1 + 1e-6))
    path = od.PiecewiseConstant(5)
    problem = asked(system, duration=10.0, step=1.0, path=path, scale=[5 * speed, 5 * speed, 0.3], budgets=(budget,))
    assert od.design_trajectory(problem, starts=1).ended is od.Status.LOCALLY_OPTIMAL


@pytest.mark.parametrize("family", [od.PiecewiseConstant(4), od.BSpline(6)], ids=["pieces", "spline"])
def test_a_path_that_changes_too_fast_keeps_not_all_limits(family: Any):
    """What no climb has made, such as a path to fall back on, is judged as well: by its family, or from step to step."""
    problem = asked(path=family, rates={"turn_rate": 0.05})
    within = np.asarray(family.inputs(np.linspace(-0.1, 0.1, len(family.box(problem.grid)[0])), problem.grid), dtype=float).reshape(-1, 1)
    abrupt = np.where(np.arange(problem.steps) < 11, -0.1, 0.1)[:, None]
    assert is_feasible(problem, od.simulate(problem.system, problem.x0, within, problem.step))
    (short,) = violations(problem, od.simulate(problem.system, problem.x0, abrupt, problem.step))
    assert (short.what, short.time, short.unit) == ("turn_rate changing by at most 0.05 rad/s/s", 5.5, "rad/s/s")
    assert short.by == pytest.approx(0.2 / 0.5 - 0.05)


def test_what_is_not_proven_says_in_how_many_starts_none_was_found_and_what_would_do():
    """A half circle of radius 15 / 0.2 m takes 15.7 s; the pose 160 m behind, heading back, needs more than 20 s and less than 28.5 s."""
    pose = od.GoalPose((-160.0, 60.0), 3.1, 10.0, 0.3)
    problem = asked(constraints=(pose,), bounds={"turn_rate": (-0.2, 0.2)})
    design = od.design_trajectory(problem, starts=1, throw=False)
    assert design.status is od.Status.LOCALLY_INFEASIBLE
    assert "-" not in design.reason.replace("(-160, 60)", "").replace("+-", "")
    assert design.reason.startswith("none found in ")
    radius, reach = 15 / 0.2, 10.0
    # the shortest way to any point and heading that will do, by Dubins' words
    shortest = min(
        od.shortest_curve((0, 0, 0), (-160 + r * math.cos(a), 60 + r * math.sin(a), 3.1 + b), radius).length
        for r in (reach, 0.99 * reach)
        for a in np.linspace(-np.pi, np.pi, 73)
        for b in np.linspace(-0.3, 0.3, 13)
    )
    assert shortest / 15 > 20.0
    seconds = float(design.reason.rsplit("feasible from ", 1)[1].split(" s")[0])
    assert shortest / 15 - 0.5 < seconds <= shortest / 15 + 2.0
    require_kept(problem.with_duration(seconds), od.design_trajectory(problem.with_duration(seconds), starts=1).trajectory)


def test_nothing_is_proven_of_a_heading_that_is_no_angle():
    """A state that is called heading but is a speed may grow without limit: no geometry forbids a goal far away."""
    x = ca.SX.sym("x", 3)
    system = od.ControlAffineSystem(
        state=x, names=("x", "y", "heading"), drift=ca.vertcat(x[2], 0, 0), known={"turn_rate": ca.vertcat(0, 0, 1)},
        outputs={"east": x[0], "north": x[1]}, sigmas={"east": 1.0, "north": 1.0},
    )  # fmt: skip
    problem = asked(system, start=[0.0, 0.0, 0.0], bounds={"turn_rate": (-5.0, 5.0)}, constraints=(od.Goal((900.0, 0.0), 1.0),))
    assert why_unreachable(problem) == ""


@pytest.mark.parametrize("wind", [None, "constant"])
@pytest.mark.parametrize("radius", [3.0, 10.0])
def test_a_distance_holds_along_the_arcs_between_the_nodes(radius: float, wind: Any):
    """Of steps of 7.5 m past a landmark of 3 m one may go right through it; between two instants of a tenth of a step, 1.5e-2 m."""
    landmark = (60.0, 5.0)
    system = od.System(od.Dubins(15.0, wind=wind), (od.GPS(2.0), od.Range(landmark, 1.0)))
    around = (od.StandOff(radius), od.Via(landmark, 1.5 * radius, 2.03, 7.71))
    problem = asked(system, path=od.PiecewiseConstant(20), constraints=around, scale=[5, 5, 0.5, *([0.3] * (2 if wind else 0))])
    design = od.design_trajectory(problem, starts=1)
    path = flown(problem, design.trajectory.u, 10_000)
    assert distance(path, landmark).min() >= radius * (1 - SHARE)
    within = (path.t >= 2.03 - 1e-4) & (path.t <= 7.71 + 1e-4)
    assert distance(path, landmark)[within].min() <= 1.5 * radius * (1 + SHARE)


def test_limits_begin_and_end_between_the_nodes():
    """From 2.2 s to 6.3 s within a sector and a disc, with steps of 1 s: instants that no node and no tenth of a step is at."""
    limits = (od.HeadingSector(0.4, 0.6, 2.2003, 6.3007), od.Loiter((57.0, 22.0), 33.0, 2.2003, 6.3007))
    problem = asked(step=1.0, duration=12.0, path=od.PiecewiseConstant(12), constraints=limits)
    design = od.design_trajectory(problem, starts=2)
    path = flown(problem, design.trajectory.u, 10_000)
    seen = (path.t >= 2.2003 - 1e-9) & (path.t <= 6.3007 + 1e-9)
    assert turned_from(path.heading[seen], 0.5).max() <= 0.1 * (1 + SHARE)
    assert distance(path, (57.0, 22.0))[seen].max() <= 33.0 * (1 + SHARE)


def test_a_plan_that_is_called_feasible_keeps_its_limits_between_the_nodes():
    landmark = (60.0, 5.0)
    system = od.System(od.Dubins(15.0, wind="constant"), (od.GPS(2.0), od.Range(landmark, 1.0)))
    problem = asked(system, path=od.PiecewiseConstant(20), constraints=(od.StandOff(10.0),), scale=[5, 5, 0.5, 0.3, 0.3])
    planner = od.Planner(problem, every=1.0, starts=1)
    plan, x, feasible = None, problem.x0, 0
    for _ in range(6):
        plan = planner.step(x, plan)
        if plan.feasible:
            feasible += 1
            path = flown(dataclasses.replace(problem, start=plan.x0), plan.trajectory.u, FINEST)
            assert distance(path, landmark).min() >= 10.0 * (1 - SHARE)
        x = plan.trajectory.x[2]
    assert feasible >= 4
