"""Missions at random: what is answered is flown again by hand and breaks nothing; what is not is said to fail, and why."""

from __future__ import annotations

import dataclasses
import math
import re
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from itertools import islice
from typing import Any

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from scipy.interpolate import BSpline as Spline

import obsdesign as od
from obsdesign.constraints.abstract import AbstractConstraint
from obsdesign.design.feasibility import is_feasible, violations
from obsdesign.design.infeasibility import why_hidden, why_unreachable
from obsdesign.design.initial_guesses import start_inputs
from obsdesign.design.local_solve import LocalSolution, LocalSolve, families_of, solve_locally

STEP, FINER, FINEST = 0.5, 10, 1000  # instants of a step at which missions are drawn, and answers are judged
BEACON = (4.0, 6.0)
SCALE = (5.0, 5.0, 0.5, 0.3, 0.3)
REFUSED = 2  # missions without an answer that are asked for their reason, which takes seconds
SHARE = 1e-6  # of a limit's own size by which it may be missed
Random = np.random.Generator

# ---------------------------------------------------------------- flown by hand


@dataclass(frozen=True)
class Flown:
    """A path by hand: t (F,), x, y, heading (F,) and velocity over ground (F, 2), so many instants a step and the end."""

    t: np.ndarray
    place: np.ndarray
    heading: np.ndarray
    velocity: np.ndarray


def flown(start: np.ndarray, air: np.ndarray, turn: np.ndarray, finer: int = FINER) -> Flown:
    """Arcs in the moving air, in closed form: airspeed and turn rate (N,) are held over each step."""
    heading = start[2] + np.append(0.0, np.cumsum(turn)) * STEP
    chords = chord(air, turn, STEP) * np.exp(1j * (heading[:-1] + turn * STEP / 2))
    nodes = start[0] + 1j * start[1] + np.append(0.0, np.cumsum(chords))
    s = np.arange(finer) / finer * STEP
    w = turn[:, None] * s
    inner = nodes[:-1, None] + chord(air[:, None], turn[:, None], s) * np.exp(1j * (heading[:-1, None] + w / 2))
    z, headings = np.append(inner, nodes[-1]), np.append(heading[:-1, None] + w, heading[-1])
    t = np.arange(len(air) * finer + 1) * STEP / finer
    place = np.column_stack([z.real, z.imag]) + t[:, None] * start[3:]
    speeds = np.append(np.repeat(air, finer), air[-1])
    velocity = speeds[:, None] * np.column_stack([np.cos(headings), np.sin(headings)]) + start[3:]
    return Flown(t, place, headings, velocity)


def chord(v: Any, w: Any, s: Any) -> Any:
    """2 v / w sin(w s / 2): how far an arc leads in s seconds, along the mean heading."""
    return v * s * np.sinc(w * s / 2 / np.pi)


def flown_with(problem: od.DesignProblem, u: np.ndarray, finer: int = FINER) -> Flown:
    air = u[:, 0] if u.shape[1] == 2 else np.full(len(u), problem.system.vehicle.speed)
    return flown(problem.x0, air, u[:, -1], finer)


def distance(path: Flown, point: tuple[float, float]) -> np.ndarray:
    return np.hypot(path.place[:, 0] - point[0], path.place[:, 1] - point[1])


def during(path: Flown, first: float, last: float | None) -> np.ndarray:
    return (path.t >= first - 1e-9) & (path.t <= (path.t[-1] if last is None else last) + 1e-9)


def depth(corners: Any, path: Flown) -> tuple[np.ndarray, float]:
    """How far inside a convex polygon each place lies [m], < 0 outside; and twice its area over its perimeter."""
    points = np.array(corners)
    edges = np.roll(points, -1, axis=0) - points
    twice_area = float(np.sum(points[:, 0] * np.roll(points[:, 1], -1) - np.roll(points[:, 0], -1) * points[:, 1]))
    lengths = np.hypot(edges[:, 0], edges[:, 1])
    away = path.place[:, None, :] - points
    left = (edges[:, 0] * away[:, :, 1] - edges[:, 1] * away[:, :, 0]) / lengths * math.copysign(1.0, twice_area)
    return left.min(axis=1), abs(twice_area) / float(lengths.sum())


def turned_from(heading: np.ndarray, aim: float) -> np.ndarray:
    """The angle between two headings, in [0, pi]."""
    return np.abs((heading - aim + np.pi) % (2 * np.pi) - np.pi)


def missed(limit: AbstractConstraint, path: Flown) -> float:
    """By which share of its size a path misses a limit; <= 0 where it holds."""
    return missed_at(dataclasses.replace(limit, landmarks=(BEACON,)) if isinstance(limit, (od.StandOff, od.MaxRange)) else limit, path)


def missed_at(limit: AbstractConstraint, path: Flown) -> float:  # noqa: PLR0911  # one for each kind
    """The same for limits that say where they are."""
    speed = np.hypot(path.velocity[:, 0], path.velocity[:, 1])
    match limit:
        case od.Goal():
            return float(distance(path, limit.point)[-1] / limit.tolerance - 1)
        case od.GoalPose():
            off = float(turned_from(path.heading[-1:], limit.heading)[0])
            return max(float(distance(path, limit.point)[-1] / limit.tolerance - 1), off / limit.heading_tolerance - 1)
        case od.GoalRegion():
            inside, size = depth(limit.corners, path)
            return float(-inside[-1] / size)
        case od.Via():
            return float(distance(path, limit.point)[during(path, limit.first, limit.last)].min() / limit.tolerance - 1)
        case od.Loiter():
            return float(distance(path, limit.centre)[during(path, limit.first, limit.last)].max() / limit.radius - 1)
        case od.KeepOut():
            return float(1 - distance(path, limit.centre).min() / limit.radius)
        case od.StandOff():
            return float(1 - distance(path, limit.landmarks[0]).min() / limit.distance)
        case od.MaxRange():
            return float(distance(path, limit.landmarks[0]).max() / limit.distance - 1)
        case od.KeepIn():
            inside, size = depth(limit.corners, path)
            return float(-inside.min() / size)
        case od.KeepOutPolygon():
            inside, size = depth(limit.corners, path)
            return float(inside.max() / size)
        case od.HeadingSector():
            half = (limit.high - limit.low) % (2 * math.pi) / 2
            return float(turned_from(path.heading, limit.low + half)[during(path, limit.first, limit.last)].max() / half - 1)
        case od.GroundSpeed():
            size = limit.least or limit.most if limit.least is None or limit.most is None else (limit.most - limit.least) / 2
            beyond = [] if limit.least is None else [limit.least - speed.min()]
            beyond += [] if limit.most is None else [speed.max() - limit.most]
            return float(max(beyond) / size)
    raise AssertionError(f"{limit} has no geometry here")


def cost_by_hand(cost: Any, path: Flown, u: np.ndarray) -> float:
    """Length over ground as that of the chords between instants, finely enough; effort of the turn rate."""
    if isinstance(cost, od.PathLength):
        return float(np.hypot(*np.diff(path.place, axis=0).T).sum())
    return float((u[:, -1] ** 2).sum() * STEP)


def steepest_rates(problem: od.DesignProblem, u: np.ndarray) -> np.ndarray:
    """The same of inputs (N, m) of the problem's family."""
    return steepest(problem, problem.path.fit(u, problem.grid), u)


def steepest(problem: od.DesignProblem, p: np.ndarray, u: np.ndarray) -> np.ndarray:
    """The largest |du/dt| of each input (m,): slopes between middles of pieces, or of the splines."""
    m, step = u.shape[1], problem.step
    seconds = len(u) * step
    if isinstance(problem.path, od.BSpline):
        degree, points = problem.path.degree, problem.path.points
        knots = np.concatenate([np.zeros(degree), np.linspace(0, seconds, points - degree + 1), np.full(degree, seconds)])
        t = np.linspace(0, seconds, 400)
        return np.array([np.abs(Spline(knots, column, degree).derivative()(t)).max() for column in p.reshape(m, points)])
    edges = np.round(np.arange(problem.path.pieces + 1) * len(u) / problem.path.pieces + 1e-9).astype(int)
    held, middles = u[edges[:-1]], (edges[1:] + edges[:-1]) / 2 * step
    return np.abs(np.diff(held, axis=0) / np.diff(middles)[:, None]).max(axis=0)


# ---------------------------------------------------------------- missions


@dataclass(frozen=True)
class Mission:
    """A problem, and inputs that meet all its limits; None where nobody knows whether there are any."""

    problem: od.DesignProblem
    known: np.ndarray | None


def anywhere(size: float, random: Random) -> np.ndarray:
    """A vector of this length to any side."""
    angle = random.uniform(-np.pi, np.pi)
    return size * np.array([math.cos(angle), math.sin(angle)])


def mission(seed: int) -> Mission:
    """A random problem: limits are put round a path that exists; in one of eight, another goal is as well."""
    random = np.random.default_rng(seed)
    speed, steps = random.uniform(0.8, 1.5), int(random.integers(16, 27))
    sharpest = random.uniform(0.35, 0.8)
    bounds = {"turn_rate": (-sharpest, sharpest * random.uniform(0.8, 1.0))}
    vehicle = od.Dubins(speed, wind="constant")
    if random.random() < 0.25:
        vehicle, bounds = od.Unicycle(wind="constant"), {"speed": (0.5 * speed, 1.2 * speed), **bounds}
    sensors = (od.GPS(2.0), od.Range(BEACON, 1.0), od.Bearing(BEACON, 0.1)) if random.random() < 0.85 else (od.GPS(1.0),)
    wind = anywhere(random.uniform(0, 0.4), random)
    start = np.array([*random.uniform(-3, 3, 2), random.uniform(-np.pi, np.pi), *wind])
    pieces = int(random.integers(8, 13) if random.random() < 0.85 else random.integers(13, 17))
    path = od.BSpline(max(5, pieces // 2)) if random.random() < 0.3 else od.PiecewiseConstant(pieces)
    bare = od.DesignProblem(od.System(vehicle, sensors), start, steps * STEP, STEP, path, bounds, scale=SCALE)
    p = smooth_parameters(bare, random)
    u = np.asarray(path.inputs(p, bare.grid), dtype=float).reshape(steps, -1)
    known = flown(start, u[:, 0] if u.shape[1] == 2 else np.full(steps, speed), u[:, -1])
    limits = [
        LIMITS[i](known, random) for i in random.choice(len(LIMITS), random.choice([1, 2, 3, 4], p=[0.3, 0.3, 0.25, 0.15]), replace=False)
    ]
    exists = random.random() < 0.88
    if not exists:
        place = known.place[0] + wind * known.t[-1] + anywhere(speed * (known.t[-1] - 2.0) * random.random(), random)
        limits = [each for each in limits if not isinstance(each, (od.Goal, od.GoalPose, od.GoalRegion))]
        limits.append(od.Goal(tuple(place.tolist()), random.uniform(0.5, 1.5)))
    changes: dict[str, Any] = {"constraints": tuple(limit for limit in limits if limit is not None)}
    if random.random() < 0.2:
        each = steepest(bare, p, u) * random.uniform(1.1, 2.0)
        changes["rates"] = dict(zip(bare.system.model.input_names, (each + 1e-3).tolist(), strict=True))
    if random.random() < 0.2:
        cost = od.PathLength() if random.random() < 0.5 else od.Effort({"turn_rate": 1.0})
        changes["budgets"] = (od.Budget(cost, cost_by_hand(cost, known, u) * random.uniform(1.05, 1.5)),)
    if random.random() < 0.06:
        seconds = STEP * int(random.integers(8, 13))
        least = lowest_window(bare, od.simulate(bare.system, start, u, STEP), seconds)
        changes["floor"] = od.Floor(seconds, max(least, 1e-6) * random.uniform(0.5, 0.9))
    return Mission(dataclasses.replace(bare, **changes), u if exists else None)


def smooth_parameters(problem: od.DesignProblem, random: Random) -> np.ndarray:
    """Parameters of the family that change slowly: half a wave or two across the range."""
    lower, upper = problem.path.box(problem.grid)
    columns = []
    for low, high in zip(problem.lower, problem.upper, strict=True):
        share = np.linspace(0, 1, len(lower) // len(problem.lower))
        wave = np.sin(2 * np.pi * (random.uniform(0.3, 1.5) * share + random.random()))
        columns.append((low + high) / 2 + random.uniform(0.3, 0.9) * (high - low) / 2 * wave)
    return np.clip(np.concatenate(columns), lower, upper)


def lowest_window(problem: od.DesignProblem, path: od.Trajectory, seconds: float) -> float:
    """The least lambda_min(S W S) over stretches that begin every half of their length, and the last one, each a path of its own."""
    length = round(seconds / STEP)
    first = {*range(0, path.steps - length + 1, length // 2), path.steps - length}
    parts = [od.variational_gramian(problem.system, path.part(k, k + length)).total for k in first]
    return min(float(np.linalg.eigvalsh(W * np.outer(SCALE, SCALE))[0]) for W in parts)


def beside(point: np.ndarray, size: float, random: Random) -> tuple[float, float]:
    """A point at most so far from another."""
    return tuple(float(each) for each in point + random.uniform(-0.7, 0.7, 2) * size)


def via(path: Flown, random: Random) -> od.Via:
    k, size = int(random.integers(len(path.t) // 4, len(path.t))), random.uniform(0.4, 1.2)
    point = beside(path.place[k], size, random)
    if random.random() < 0.5:
        return od.Via(point, size)
    first = max(0.0, round((path.t[k] - random.uniform(0.5, 3)) / STEP) * STEP)
    return od.Via(point, size, first, min(path.t[-1], first + 6.0))


def loiter(path: Flown, random: Random) -> od.Loiter:
    first = round(random.uniform(0.2, 0.8) * path.t[-1] / STEP) * STEP
    last = min(first + 3.0, path.t[-1]) if random.random() < 0.7 else None
    stay = path.place[during(path, first, last)]
    centre = stay.mean(axis=0)
    return od.Loiter(tuple(centre.tolist()), float(np.hypot(*(stay - centre).T).max()) * random.uniform(1.05, 1.5) + 0.1, first, last)


def off_the_path(path: Flown, random: Random) -> tuple[np.ndarray, float]:
    """A point beside the path, and its distance from it."""
    k = int(random.integers(len(path.t) // 4, len(path.t)))
    side = random.uniform(0.8, 3.0) * random.choice([-1, 1])
    centre = path.place[k] + side * np.array([-math.sin(path.heading[k]), math.cos(path.heading[k])])
    return centre, float(distance(path, tuple(centre)).min())


def keep_out(path: Flown, random: Random) -> od.KeepOut | None:
    centre, way = off_the_path(path, random)
    return od.KeepOut(tuple(centre.tolist()), way * random.uniform(0.5, 0.95)) if way > 0.3 else None


def ring(centre: np.ndarray, radius: float, corners: int, random: Random) -> tuple[tuple[float, float], ...]:
    angles = random.uniform(0, 2 * np.pi) + np.arange(corners) * 2 * np.pi / corners
    return tuple((float(centre[0] + radius * math.cos(a)), float(centre[1] + radius * math.sin(a))) for a in angles)


def keep_out_polygon(path: Flown, random: Random) -> od.KeepOutPolygon | None:
    centre, way = off_the_path(path, random)
    # its edges are moved outwards by 0.02 log m of its size, which is below its radius
    return od.KeepOutPolygon(ring(centre, 0.85 * way, int(random.integers(3, 7)), random)) if way > 0.3 else None


def keep_in(path: Flown, random: Random) -> od.KeepIn:
    (left, low), (right, high) = path.place.min(axis=0) - random.uniform(0.2, 2, 2), path.place.max(axis=0) + random.uniform(0.2, 2, 2)
    corners = ((left, low), (right, low), (right, high), (left, high))
    return od.KeepIn(corners if random.random() < 0.5 else corners[::-1])


def goal(path: Flown, random: Random) -> od.Goal:
    size = random.uniform(0.3, 1.5)
    return od.Goal(beside(path.place[-1], size, random), size)


def goal_pose(path: Flown, random: Random) -> od.GoalPose:
    size, angle = random.uniform(0.3, 1.5), random.uniform(0.2, 0.8)
    aim = path.heading[-1] + random.uniform(-0.8, 0.8) * angle
    return od.GoalPose(beside(path.place[-1], size, random), float(aim), size, angle)


def goal_region(path: Flown, random: Random) -> od.GoalRegion:
    size = random.uniform(0.5, 1.5)
    return od.GoalRegion(ring(np.array(beside(path.place[-1], 0.3 * size, random)), size, int(random.integers(3, 7)), random))


def sector(path: Flown, random: Random) -> od.HeadingSector | None:
    first = round(random.uniform(0.2, 0.8) * path.t[-1] / STEP) * STEP
    last = min(first + 4.0, path.t[-1]) if random.random() < 0.7 else None
    seen = path.heading[during(path, first, last)]
    low, high = float(seen.min() - random.uniform(0.1, 0.5)), float(seen.max() + random.uniform(0.1, 0.5))
    return od.HeadingSector(low, high, first, last) if high - low < 6 else None


def stand_off(path: Flown, random: Random) -> od.StandOff:
    return od.StandOff(float(distance(path, BEACON).min()) * random.uniform(0.4, 0.95), (BEACON,))


def max_range(path: Flown, random: Random) -> od.MaxRange:
    return od.MaxRange(float(distance(path, BEACON).max()) * random.uniform(1.02, 1.4), (BEACON,))


def ground_speed(path: Flown, random: Random) -> od.GroundSpeed:
    speed = np.hypot(*path.velocity.T)
    least, most = float(speed.min() * random.uniform(0.6, 0.97)), float(speed.max() * random.uniform(1.03, 1.4))
    return [od.GroundSpeed(least, most), od.GroundSpeed(least=least), od.GroundSpeed(most=most)][int(random.integers(3))]


LIMITS: tuple[Callable[[Flown, Random], AbstractConstraint | None], ...] = (
    goal,
    goal_pose,
    goal_region,
    via,
    keep_out,
    keep_out_polygon,
    keep_in,
    stand_off,
    max_range,
    sector,
    loiter,
    ground_speed,
)


def require_all_kept(problem: od.DesignProblem, found: LocalSolution) -> None:
    """Every limit of an answered mission, by hand; and its value."""
    u, path = found.path.u, flown_with(problem, found.path.u, FINEST)
    np.testing.assert_allclose(found.path.x[:, :2], path.place[::FINEST], atol=1e-3)
    assert len(u) == problem.steps
    width = problem.upper - problem.lower
    assert np.all((u >= problem.lower - SHARE * width) & (u <= problem.upper + SHARE * width))
    for limit in problem.constraints:
        share = missed(limit, path)
        assert share <= SHARE, f"{limit} is missed by {share:.2e}"
    for name, change in zip(problem.system.model.input_names, steepest(problem, found.p, u), strict=True):
        assert change <= problem.rates.get(name, np.inf) * (1 + SHARE)
    for budget in problem.budgets:
        assert cost_by_hand(budget.cost, path, u) <= budget.at_most * (1 + SHARE)
    if problem.floor is not None:
        assert lowest_window(problem, found.path, problem.floor.seconds) >= problem.floor.value * (1 - SHARE)
    W = od.variational_gramian(problem.system, found.path).total * np.outer(SCALE, SCALE)
    assert found.objective == pytest.approx(float(np.linalg.eigvalsh(W)[0]), rel=1e-6, abs=1e-11 * float(np.trace(W)))


def names_of(problem: od.DesignProblem) -> list[str]:
    """How the limits of a mission begin in messages."""
    names = [str(limit).split(":")[0] for limit in problem.constraints] + [str(budget.cost) for budget in problem.budgets]
    return names + ["Floor"] * (problem.floor is not None) + ["rate"] * bool(problem.rates)


def first_answer(problem: od.DesignProblem, seed: int) -> LocalSolution | None:
    """The first of two starts that ends in an answer."""
    for name, u in islice(start_inputs(problem, seed), 2):
        found = solve_locally(LocalSolve(problem, name, u, families_of(problem.path), True))
        if found.status.has_answer:
            return found
    return None


@pytest.mark.parametrize("count", [20, pytest.param(200, marks=pytest.mark.slow)])
def test_missions_are_flown_as_asked_or_refused_with_a_reason(count: int):
    """Most are answered from one of two starts, though one mission in eight may have no path at all."""
    tally: Counter[tuple[str, str]] = Counter()

    @settings(max_examples=count, derandomize=True, deadline=None, database=None, phases=(Phase.generate,))
    @given(seed=st.integers(0, 2**32 - 1))
    def fly(seed: int) -> None:
        drawn = mission(seed)
        found = first_answer(drawn.problem, seed % 7)
        tally["has a path" if drawn.known is not None else "who knows", "no answer" if found is None else "answer"] += 1
        if found is not None:
            require_all_kept(drawn.problem, found)
        elif sum(count for (_, end), count in tally.items() if end == "no answer") <= REFUSED:
            require_a_reason(drawn.problem, seed % 7)

    fly()
    assert sum(tally.values()) >= count
    assert tally["has a path", "answer"] >= 0.8 * (tally["has a path", "answer"] + tally["has a path", "no answer"]), tally
    assert tally["has a path", "answer"] + tally["who knows", "answer"] >= 0.75 * sum(tally.values()), tally


def require_a_reason(problem: od.DesignProblem, seed: int) -> None:
    """A status, no number that looks like an answer, and a limit that is named; or a path after all, which keeps them all."""
    design = od.design_trajectory(problem, starts=1, seed=seed, throw=False)
    if design.status.has_answer:
        path = flown_with(problem, design.trajectory.u, FINEST)
        assert max((missed(limit, path) for limit in problem.constraints), default=0.0) <= SHARE
        return
    assert design.trajectory is None
    assert np.isnan(design.value)
    assert any(name in design.reason for name in names_of(problem)), f"{design.status}: {design.reason!r}"


def test_the_path_that_a_mission_is_built_round_meets_it_by_hand_and_by_the_library():
    """So that a mission that is said to have a path has one; two geometries, one answer."""
    for each in map(mission, range(40)):
        problem = each.problem
        if each.known is not None:
            path = flown_with(problem, each.known)
            assert max(missed(limit, path) for limit in problem.constraints) < 0
            assert is_feasible(problem, od.simulate(problem.system, problem.x0, each.known, STEP))


def test_a_path_at_random_breaks_the_same_limits_by_hand_and_by_the_library():
    broken = 0
    for seed, each in enumerate(map(mission, range(40))):
        problem = each.problem
        p = np.random.default_rng(seed).uniform(*problem.path.box(problem.grid))
        u = np.asarray(problem.path.inputs(p, problem.grid), dtype=float).reshape(problem.steps, -1)
        path = flown_with(problem, u)
        named = {short.what: short for short in violations(problem, od.simulate(problem.system, problem.x0, u, STEP))}
        for limit in problem.constraints:
            share = missed(limit, path)
            if abs(share) > 0.05 or (share > 1e-3 and not isinstance(limit, od.KeepOutPolygon)):  # widened by 0.02 log m of its size
                broken += share > 0
                assert (str(limit) in named) == (share > 0)
            if share > 1e-3 and not isinstance(limit, (od.KeepOutPolygon, od.HeadingSector, od.GoalPose)):  # chords, not angles
                assert -named[str(limit)].margin == pytest.approx(share, rel=2e-2)
    assert broken > 20


# ---------------------------------------------------------------- missions that nothing can fly


def asked(*limits: AbstractConstraint, **changes: Any) -> od.DesignProblem:
    """Ten seconds at 1 m/s from the origin along x, in still air."""
    base: dict[str, Any] = {
        "system": od.System(od.Dubins(1.0), (od.GPS(1.0),)),
        "start": (0.0, 0.0, 0.0),
        "duration": 10.0,
        "step": 1.0,
        "path": od.PiecewiseConstant(5),
        "bounds": {"turn_rate": (-0.5, 0.5)},
        "constraints": limits,
    }
    return od.DesignProblem(**{**base, **changes})


RANGES = od.System(od.Dubins(1.0), tuple(od.Range(point, 1.0) for point in ((5.0, 7.0), (-3.0, 4.0), (2.0, -6.0))))
SLOW_OR_FAST: dict[str, Any] = {
    "system": od.System(od.Unicycle(), (od.GPS(1.0),)),
    "bounds": {"speed": (0.2, 1.0), "turn_rate": (-0.5, 0.5)},
}

# (problem, message): what the geometry of straight lines tells before any solver starts
PROVEN = {
    "goal too far": (
        asked(od.Goal((50.0, 0.0), 1.0)),
        "Goal: within 1 m of (50, 0): 49 m away; at 1 m/s at most it cannot be reached in 10 s, not before 49 s",
    ),
    "goal pose too far": (
        asked(od.GoalPose((0.0, -20.0), 0.0, 2.0, 0.5)),
        "GoalPose: within 2 m of (0, -20), heading 0 +- 0.5 rad: 18 m away; at 1 m/s at most it cannot be reached in 10 s, not before 18 s",
    ),
    "via point too early": (
        asked(od.Via((6.0, 0.0), 0.5, 0.0, 4.0)),
        "Via: within 0.5 m of (6, 0) once from 0 s to 4 s: 5.5 m away; at 1 m/s at most it cannot be reached in 4 s, not before 6 s",
    ),
    "goal with the wind": (
        asked(
            od.Goal((20.0, 0.0), 1.0), system=od.System(od.Dubins(1.0, wind="constant"), (od.GPS(1.0),)), start=(0.0, 0.0, 0.0, 0.3, 0.0)
        ),
        "Goal: within 1 m of (20, 0): 19 m away; at 1.3 m/s at most it cannot be reached in 10 s, not before 15 s",
    ),
    "budget below the way": (
        asked(od.Goal((8.0, 0.0), 1.0), **SLOW_OR_FAST, budgets=(od.Budget(od.PathLength(), 5.0),)),
        "Goal: within 1 m of (8, 0): 7 m away, more than the budget of 5 m of path length",
    ),
}


@pytest.mark.parametrize(("problem", "message"), PROVEN.values(), ids=PROVEN.keys())
def test_what_geometry_forbids_is_said_before_any_solver_starts(problem: od.DesignProblem, message: str, monkeypatch: pytest.MonkeyPatch):
    for module in ("multistart", "climbs"):
        monkeypatch.setattr(f"obsdesign.design.{module}.solve_locally", None)
    with pytest.raises(od.SolveError, match=re.escape(message)) as caught:
        od.design_trajectory(problem, starts=1)
    assert caught.value.status is od.Status.INFEASIBLE
    assert caught.value.reason == message


@pytest.mark.parametrize("longest", [49.0, 50.0])
def test_geometry_forbids_nothing_that_can_be_reached(longest: float):
    """A goal of 1 m about a point 50 m ahead is reached in 49 s, straight on, and not a second earlier."""
    problem = asked(od.Goal((50.0, 0.0), 1.0), duration=longest)
    assert why_unreachable(problem) == ""
    assert why_unreachable(asked(od.Goal((50.0, 0.0), 1.0), duration=48.0)) != ""
    assert is_feasible(problem, od.simulate(problem.system, problem.x0, np.zeros((round(longest), 1)), 1.0))


# (problem, how the limits begin that cannot all hold, what they must fall short by together [m, m/s])
IMPOSSIBLE = {
    "a goal behind a wall": (
        asked(od.KeepIn(((-3.0, -3.0), (5.0, -3.0), (5.0, 3.0), (-3.0, 3.0))), od.Goal((8.0, 0.0), 1.0)),
        ("KeepIn: within", "Goal: within 1 m of (8, 0)"),
        2.0,
    ),
    "two areas to end in": (
        asked(
            od.GoalRegion(((4.0, 0.0), (6.0, 0.0), (6.0, 2.0), (4.0, 2.0))),
            od.GoalRegion(((-1.0, 4.0), (1.0, 4.0), (1.0, 6.0), (-1.0, 6.0))),
        ),
        ("GoalRegion: within (4, 0)", "GoalRegion: within (-1, 4)"),
        3.0,
    ),
    # one cannot fly more slowly than at 1 m/s
    "a budget of length": (asked(budgets=(od.Budget(od.PathLength(), 5.0),)), ("path length at most 5 m",), 5.0),
    "to stay here and to end there": (
        asked(od.Loiter((7.0, 0.0), 1.0, 6.0), od.Goal((1.0, 5.0), 1.0)),
        ("Loiter: within 1 m of (7, 0) from 6 s to the end", "Goal: within 1 m of (1, 5)"),
        math.hypot(6.0, 5.0) - 2.0,
    ),
    "a heading away from the goal": (
        asked(od.HeadingSector(2.6, 3.6, 3.0, 8.0), od.Goal((8.0, 0.0), 1.0)),
        ("HeadingSector: heading from 2.6", "Goal: within 1 m of (8, 0)"),
        0.5,
    ),
    "a goal within an obstacle": (
        asked(od.KeepOut((7.0, 0.0), 2.0), od.Goal((7.0, 0.0), 0.5)),
        ("KeepOut: at least 2 m from (7, 0)", "Goal: within 0.5 m of (7, 0)"),
        1.5,
    ),
    # turning all the time, x is 10 sin(1) in the end; turning less, more
    "no room to turn round": (
        asked(od.Goal((-3.0, 0.0), 1.0), bounds={"turn_rate": (-0.1, 0.1)}),
        ("Goal: within 1 m of (-3, 0)",),
        10 * math.sin(1.0) + 3.0 - 1.0,
    ),
    # what ranges say of a place depends on where it is: no entry of it is the same on all paths, so nothing is proven
    "a floor too high": (asked(system=RANGES, floor=od.Floor(4.0, 1e6)), ("Floor: lambda_min of every 4 s at least 1e+06",), 1e5),
    # 6 s at 1 m/s for 4.24 m less 0.5 and another 6 m less 1; what the first falls short by shortens both
    "two points too far apart": (
        asked(od.Via((3.0, 3.0), 0.5, 0.0, 5.0), od.Via((3.0, -3.0), 0.5, 5.0, 6.0)),
        ("Via: within 0.5 m of (3, 3)", "Via: within 0.5 m of (3, -3)"),
        (math.hypot(3.0, 3.0) - 0.5 + 5.0 - 6.0) / 2,
    ),
    "faster than it can": (asked(od.GroundSpeed(least=2.0)), ("GroundSpeed: at least 2 m/s",), 1.0),
}


@pytest.mark.parametrize(("problem", "names", "least"), IMPOSSIBLE.values(), ids=IMPOSSIBLE.keys())
def test_a_mission_that_nothing_can_fly_names_the_limit_the_amount_and_the_time(
    problem: od.DesignProblem, names: tuple[str, ...], least: float
):
    with pytest.raises(od.SolveError) as caught:
        od.design_trajectory(problem, starts=1)
    error = caught.value
    assert error.status is od.Status.LOCALLY_INFEASIBLE
    assert error.reason in str(error)
    found = re.findall(r"(?:^|; )([^;]*?): missed by ([\d.e+]+) ?(\S*) at ([\d.]+) s", error.reason)
    assert found
    assert all(any(what.startswith(name) for name in names) for what, *_ in found)
    assert sum(float(amount) for _, amount, _, _ in found) >= least * (1 - 1e-2)
    assert all(0 <= float(time) <= problem.longest for *_, time in found)


@pytest.mark.parametrize(("value", "is_possible"), [(4.0 - 1e-3, True), (4.0 + 1e-3, False), (1e6, False)])
def test_a_floor_above_what_any_path_knows_of_a_place_is_refused_with_a_proof(value: float, is_possible: bool):
    """Four samples of 1 m about x: W_xx = 4 whatever is flown, and lambda_min is at most any entry of the diagonal."""
    problem = asked(floor=od.Floor(4.0, value), scale=(1.0, 1.0, 100.0), bounds={"turn_rate": (-0.01, 0.01)})
    why = why_hidden(problem)
    assert (why == "") is is_possible
    if not is_possible:
        assert f"at least {value:g}: no path gets beyond 4, which is known of x, y on all of them" in why
        design = od.design_trajectory(problem, starts=1, throw=False)
        assert (design.status, design.reason) == (od.Status.INFEASIBLE, why)


def test_what_would_have_to_give_is_named_exactly_where_it_is_known():
    """7 m at 0.5 m/s over ground against the wind: 2 m short after 10 s, feasible from 14 s on."""
    system = od.System(od.Dubins(1.0, wind="constant"), (od.GPS(1.0),))
    problem = asked(od.Goal((8.0, 0.0), 1.0), system=system, start=(0.0, 0.0, 0.0, -0.5, 0.0))
    design = od.design_trajectory(problem, starts=1, throw=False)
    assert re.fullmatch(r"none found in \d+ starts; Goal: within 1 m of \(8, 0\): missed by 2 m at 10 s; feasible from 14 s", design.reason)
    (short,) = design.violations
    assert (short.by, short.time, short.unit) == (pytest.approx(2.0, rel=1e-5), 10.0, "m")
