"""Shortest curves against theorems and brute force, and what each path family says of itself.

The contracts that all families share stand in test_families.py.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

import obsdesign as od
from obsdesign.curves import WORDS, Curve, curves, intercept, shortest_curve, shortest_through
from obsdesign.paths._switches import softplus
from obsdesign.paths.abstract import Grid
from obsdesign.paths.b_spline import BSpline
from obsdesign.paths.dubins_path import DubinsPath

some = settings(deadline=None, max_examples=40, database=None, derandomize=True)
few = settings(deadline=None, max_examples=12, database=None, derandomize=True)
seeds = st.integers(0, 10**6)
EPS = np.finfo(float).eps
SIDE = {"L": 1.0, "S": 0.0, "R": -1.0}
NAMES = {side: letter for letter, side in SIDE.items()}
TURN = 2 * np.pi


def flown(curve: Curve, start: Sequence[float]) -> np.ndarray:
    """The pose at the end of a curve, by the closed form of a circle for each arc."""
    x, y, heading = start
    for letter, length in zip(curve.word, curve.lengths, strict=True):
        curvature = SIDE[letter] / curve.radius
        after = heading + curvature * length
        if curvature:
            x, y = x + (np.sin(after) - np.sin(heading)) / curvature, y - (np.cos(after) - np.cos(heading)) / curvature
        else:
            x, y = x + length * np.cos(heading), y + length * np.sin(heading)
        heading = after
    return np.array([x, y, heading])


def miss(found: np.ndarray, end: np.ndarray) -> float:
    """Largest difference in position [m] or heading [rad], of those the end has."""
    difference = found[: len(end)] - end
    difference[2:] = (difference[2:] + np.pi) % TURN - np.pi
    return float(np.abs(difference).max())


def random_pose(random: np.random.Generator, size: float) -> np.ndarray:
    return random.uniform(-1, 1, 3) * np.array([size, size, np.pi])


def length(start: Sequence[float], end: Sequence[float], radius: float = 1.0) -> float:
    return shortest_curve(start, end, radius).length


# ---------------------------------------------------------------- curves between poses

PLACES = [  # near and far, on the circles and their edges
    *((x, y) for x in (-5.0, -2.0, -1e-3, 0.0, 1e-9, 0.5, 2.0, 4.0) for y in (-4.0, -1.0, 0.0, 1e-6, 2.0, 6.0)),
    *((np.sin(angle), 1 - np.cos(angle)) for angle in (0.1, 1.0, 3.0)),
]
HEADINGS = (-np.pi, -1.0, 0.0, 1e-9, np.pi / 2, 3.0)


@pytest.mark.parametrize("heading", HEADINGS)
def test_every_word_flown_ends_at_the_pose(heading: float):
    """At 51 places for each of six headings."""
    for start in ((0.0, 0.0, 0.0), (3.0, -7.0, 2.2)):
        c, s = np.cos(start[2]), np.sin(start[2])
        for x, y in PLACES:
            end = np.array([start[0] + c * x - s * y, start[1] + s * x + c * y, start[2] + heading])
            found = curves(start, end, 1.0)
            assert {"LSL", "RSR"} <= {curve.word for curve in found} <= set(WORDS)
            assert max(miss(flown(curve, start), end) for curve in found) < 1e-9
            assert all(part >= 0 for curve in found for part in curve.lengths)


@some
@given(seed=seeds)
def test_every_word_flown_ends_at_random_poses_and_points(seed: int):
    random = np.random.default_rng(seed)
    start, radius = random_pose(random, 5), random.uniform(0.3, 3)
    for distance in (1e-9, 1e-4, 1.0, 8.0):
        end = start + random_pose(random, distance)
        for goal in (end, end[:2]):
            found = curves(start, goal, radius)
            assert all(curve.radius == radius for curve in found)
            assert max(miss(flown(curve, start), goal) for curve in found) < 1e-9


def test_all_words_are_among_the_shortest():
    random = np.random.default_rng(0)
    assert {shortest_curve(np.zeros(3), random_pose(random, size), 1.0).word for size in (1, 4) for _ in range(60)} == set(WORDS)


def by_roots(start: np.ndarray, end: np.ndarray, radius: float) -> float:
    """Shortest of the six words by numerical roots: the first arc varies, the rest of the curve closes up to one equation.

    Straight in the middle: its offset from the start of the last arc. Arc in the middle: the distance of its centre from that of
    the last arc, less two radii.
    """

    def centre(pose: np.ndarray, side: float) -> np.ndarray:
        return pose[:2] + side * radius * np.array([-np.sin(pose[2]), np.cos(pose[2])])

    def after(t: float, side: float) -> np.ndarray:
        return flown(Curve("L" if side > 0 else "R", (t * radius,), radius), start)

    def to_last(t: float, first: float, last: float) -> tuple[np.ndarray, float]:
        """From the end of the first arc to the begin of the last, along and across the heading there; angle of the last arc."""
        pose = after(t, first)
        begin = centre(end, last) - last * radius * np.array([-np.sin(pose[2]), np.cos(pose[2])])
        c, s = np.cos(pose[2]), np.sin(pose[2])
        return np.array([[c, s], [-s, c]]) @ (begin - pose[:2]), (last * (end[2] - pose[2])) % TURN

    def gap(t: float, side: float) -> float:
        return float(np.linalg.norm(centre(after(t, side), -side) - centre(end, side)) - 2 * radius)

    def middle(t: float, side: float) -> tuple[float, float]:
        """Angles of the middle and the last arc."""
        pose = after(t, side)
        touch = (centre(pose, -side) + centre(end, side)) / 2
        radial = (touch - centre(pose, -side)) * side
        heading = np.arctan2(-radial[0], radial[1])
        return (side * (pose[2] - heading)) % TURN, (side * (end[2] - heading)) % TURN

    grid, totals = np.linspace(0, TURN, 361), [np.inf]

    def add(word: str, *parts: float) -> None:
        curve = Curve(word, tuple(parts), radius)
        assert miss(flown(curve, start), end) < 1e-6, "brute force closes up"
        totals.append(curve.length)

    for first, last in itertools.product((1.0, -1.0), repeat=2):
        across = [to_last(t, first, last)[0][1] for t in grid]
        for i in np.flatnonzero(np.diff(np.sign(across))):
            t = brentq(lambda t, first=first, last=last: to_last(t, first, last)[0][1], grid[i], grid[i + 1], xtol=1e-14)
            (along, _), angle = to_last(t, first, last)
            if along >= 0:
                add(NAMES[first] + "S" + NAMES[last], radius * t, along, radius * angle)
    for side in (1.0, -1.0):
        gaps = [gap(t, side) for t in grid]
        for i in np.flatnonzero(np.diff(np.sign(gaps))):
            t = brentq(gap, grid[i], grid[i + 1], (side,), xtol=1e-14)
            add(NAMES[side] + NAMES[-side] + NAMES[side], radius * t, *(radius * angle for angle in middle(t, side)))
    return min(totals)


@pytest.mark.parametrize("size", [0.5, 2.0, 5.0])
def test_the_shortest_curve_is_that_of_brute_force(size: float):
    random = np.random.default_rng(3)
    for _ in range(12):
        start, end = random_pose(random, size), random_pose(random, size)
        np.testing.assert_allclose(length(start, end, 0.8), by_roots(start, end, 0.8), atol=1e-8)


@some
@given(seed=seeds)
def test_no_flight_of_bounded_curvature_is_shorter(seed: int):
    """Dubins (1957): whatever is flown with radii of at least 1, the shortest curve to where it ended is no longer."""
    random = np.random.default_rng(seed)
    for parts in (1, 2, 3, 6):
        start = pose = random_pose(random, 3)
        total = 0.0
        for _ in range(parts):
            part = Curve(random.choice(list("LSR")), (random.choice([1e-6, 0.3, 3.0]) * random.uniform(),), random.choice([1.0, 1.0, 2.5]))
            pose, total = flown(part, pose), total + part.length
        assert length(start, pose) <= total + 1e-9
        assert length(start, pose[:2]) <= total + 1e-9


@some
@given(seed=seeds)
def test_the_shortest_length_has_the_symmetries_and_bounds_of_the_problem(seed: int):
    random = np.random.default_rng(seed)
    size = random.choice([0.1, 1.0, 10.0])
    start, end, via = random_pose(random, size), random_pose(random, size), random_pose(random, size)
    shortest = length(start, end)
    mirror, back = np.array([1, -1, -1]), np.array([0, 0, np.pi])
    c, s, shift = np.cos(1.1), np.sin(1.1), np.array([40.0, -7.0, 1.1])
    turned = [np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ pose + shift for pose in (start, end)]
    scaled = [pose * np.array([3, 3, 1]) for pose in (start, end)]
    for other in (length(start * mirror, end * mirror), length(end + back, start + back), length(*turned), length(*scaled, 3.0) / 3):
        np.testing.assert_allclose(other, shortest, rtol=1e-11, atol=1e-9)
    distance = np.hypot(*(end - start)[:2])
    assert distance - 1e-12 <= length(start, end[:2]) <= shortest + 1e-9
    assert shortest <= distance + 2.658 * np.pi  # Savla, Frazzoli and Bullo (2008)
    assert shortest <= length(start, via) + length(via, end) + 1e-9
    assert shortest <= length(start, end, 1.2) + 1e-9  # what turns wider may fly it


@some
@given(seed=seeds)
def test_far_away_the_shortest_length_is_continuous(seed: int):
    """From distances of four radii on; nearer it jumps, as at a point right behind."""
    random = np.random.default_rng(seed)
    start, angle, step = random_pose(random, 1), random.uniform(0, TURN), 1e-6
    end = start + random.uniform(4.1, 20) * np.array([np.cos(angle), np.sin(angle), 0])
    end[2] = random.choice([random.uniform(0, TURN), start[2], angle, angle + np.pi])
    change = length(start, end + step * random.uniform(-1, 1, 3)) - length(start, end)
    assert abs(change) <= 5 * step


DEGENERATE = {
    "nowhere": ((0.0, 0.0, 0.0), 0.0),
    "nowhere, a turn later": ((0.0, 0.0, TURN), 0.0),
    "rounding ahead": ((1e-17, 0.0, 0.0), 0.0),
    "rounding behind": ((-1e-17, 0.0, 1e-17), 0.0),
    "straight ahead": ((3.0, 0.0, 0.0), 3.0),
    "next to nothing ahead": ((1e-7, 0.0, 0.0), 1e-7),
    "half a circle": ((0.0, 2.0, np.pi), np.pi),
    "half a circle to the right": ((0.0, -2.0, -np.pi), np.pi),
    "two half circles": ((0.0, 4.0, 0.0), None),
    "turned on the spot": ((0.0, 0.0, np.pi), 7 * np.pi / 3),
    "back in line": ((-2.0, 0.0, 0.0), None),
}


@pytest.mark.parametrize("name", DEGENERATE)
def test_degenerate_poses(name: str):
    end, expected = DEGENERATE[name]
    for heading in (0.0, 0.7, -2.5, 40.0):
        c, s = np.cos(heading), np.sin(heading)
        start = np.array([2.0, -1.0, heading])
        goal = start + np.array([c * end[0] - s * end[1], s * end[0] + c * end[1], end[2]])
        found = curves(start, goal, 1.0)
        assert max(miss(flown(curve, start), goal) for curve in found) < 1e-9
        if expected is not None:
            np.testing.assert_allclose(shortest_curve(start, goal, 1.0).length, expected, atol=1e-9)


@some
@given(seed=seeds)
def test_what_lies_on_one_arc_or_one_straight_needs_no_more(seed: int):
    """Rounding of the coordinates, here those of a map, adds no full turns. Below half a turn the arc is shortest: so far one must turn."""
    random = np.random.default_rng(seed)
    radius, start = random.choice([0.5, 80.0]), np.array([5e5, 4.6e6, random.uniform(-4, 4)])
    word, most = ("S", 1e3) if random.uniform() < 0.3 else (random.choice(["L", "R"]), np.pi * radius)
    part = Curve(word, (most * 10 ** random.uniform(-4, 0),), radius)
    end = flown(part, start)
    tolerance = 1e-5 * radius
    np.testing.assert_allclose(length(start, end, radius), part.length, atol=tolerance)
    np.testing.assert_allclose(length(start, end[:2], radius), part.length, atol=tolerance)


@some
@given(seed=seeds)
def test_a_scrap_of_straight_before_or_behind_an_arc_adds_no_turn(seed: int):
    """The direction of the straight is lost in rounding then, its end and the heading there are not."""
    random = np.random.default_rng(seed)
    start, letter = random_pose(random, 3), random.choice(["L", "R"])
    arc, scrap = random.uniform(0.01, 2.5), 10 ** random.uniform(-9, -4)
    for word, parts in (("S" + letter, (scrap, arc)), (letter + "S", (arc, scrap))):
        assert length(start, flown(Curve(word, parts, 1.0), start)) <= arc + scrap + 1e-9


@some
@given(seed=seeds)
def test_on_an_arc_the_word_that_begins_and_ends_with_it_is_the_arc(seed: int):
    """LSL and RSR alike, with no straight of some direction between two arcs, and nothing at all where start and end agree."""
    random = np.random.default_rng(seed)
    start, angle = random_pose(random, 3), random.uniform(0.01, 6.2)
    for letter in "LR":
        end = flown(Curve(letter, (angle,), 1.0), start)
        for goal, expected in (
            (end, angle),
            (start, 0.0),
            (start + np.array([0, 0, 4 * EPS]), 0.0),
            (start - np.array([0, 0, 4 * EPS]), 0.0),
        ):
            (same,) = (curve for curve in curves(start, goal, 1.0) if curve.word == letter + "S" + letter)
            np.testing.assert_allclose(same.length, expected, atol=1e-9)


@few
@given(seed=seeds)
def test_a_free_heading_is_the_best_of_all_headings(seed: int):
    random = np.random.default_rng(seed)
    start, point = random_pose(random, 1), random.uniform(-1, 1, 2) * random.choice([1.0, 2.0, 5.0])
    free = shortest_curve(start, point, 1.0)
    tried = [length(start, (*point, heading)) for heading in np.linspace(0, TURN, 180)]
    assert free.length <= min(tried) + 1e-9
    np.testing.assert_allclose(length(start, (*point, flown(free, start)[2])), free.length, atol=1e-7)


@some
@given(seed=seeds)
def test_turn_rates_fly_the_curve(seed: int):
    """With a node wherever a part ends, exactly; on any other grid the heading is right at every node."""
    random = np.random.default_rng(seed)
    start, speed, radius = random_pose(random, 4), random.uniform(1, 20), random.uniform(0.5, 2)
    curve = shortest_curve(start, random_pose(random, 4), radius)
    ends = np.cumsum(curve.lengths) / speed
    any_times = np.sort(random.uniform(0, 1.5 * ends[-1], 9))
    times = np.unique(np.concatenate([[0.0], any_times, ends]))
    times = times[np.append(True, np.diff(times) > 1e-9)]
    rates = curve.turn_rates(speed, times)
    assert np.all(np.abs(rates) <= speed / radius * (1 + 1e-6))
    poses, pose = [start], start
    for rate, step in zip(rates, np.diff(times), strict=True):
        arc = Curve("S", (speed * step,), 1.0) if abs(rate) < 1e-9 else Curve("L" if rate > 0 else "R", (speed * step,), speed / abs(rate))
        pose = flown(arc, pose)
        poses.append(pose)
    poses, before = np.array(poses), speed * times <= curve.length
    np.testing.assert_allclose(curve.poses(start, speed * times)[before], poses[before], atol=1e-7)
    np.testing.assert_allclose(curve.poses(start, [-1.0, curve.length + 1]), [start, flown(curve, start)], atol=1e-9)
    whole = np.append(0.0, any_times)
    turned = np.cumsum(curve.turn_rates(speed, whole) * np.diff(whole))
    np.testing.assert_allclose(turned, np.interp(any_times, times, poses[:, 2]) - start[2], atol=1e-7)


POSE, NAN = (0.0, 0.0, 0.0), float("nan")


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: curves(POSE, (1.0, 0.0, 0.0), 0.0), r"radius is 0\.0: must be a finite number above 0"),
        (lambda: shortest_curve((0.0, 0.0), (1.0, 0.0, 0.0), 1.0), r"start is \(0\.0, 0\.0\): must be a pose \(x, y, heading\) of finite"),
        (lambda: shortest_curve(POSE, (1.0,), 1.0), r"end is \(1\.0,\): must be a point \(x, y\) or a pose \(x, y, heading\)"),
        (lambda: shortest_curve(POSE, (1.0, NAN), 1.0), r"end is \(1\.0, nan\): .* of finite numbers"),
        (lambda: shortest_curve(POSE, ("a", "b"), 1.0), r"end is \('a', 'b'\): must be an array of real numbers"),
        (lambda: shortest_through(POSE, [], radius=1.0), "points: must be at least one"),
        (
            lambda: shortest_through(POSE, [(1.0, 2.0, 3.0)], (0.0, 0.0), radius=1.0),
            r"points\[0\] is \(1\.0, 2\.0, 3\.0\): must be two numbers",
        ),
        (lambda: intercept(POSE, (5.0, 0.0), (1.0, 0.0), -1.0, 1.0), r"speed is -1\.0: must be a finite number above 0"),
        (lambda: intercept(POSE, (5.0, 0.0), (1.0,), 1.0, 1.0), r"wind is \(1\.0,\): must be two numbers"),
        (lambda: Curve("S", (1.0,), 1.0).turn_rates(0.0, [0.0, 1.0]), r"speed is 0\.0: must be"),
        (lambda: Curve("S", (1.0,), 1.0).turn_rates(1.0, [0.0, 0.0]), "times: must be a row of increasing numbers"),
    ],
)
def test_bad_places_are_refused(call, message: str):
    with pytest.raises(od.InputError, match=message):
        call()


# ---------------------------------------------------------------- chains through points


def chain_misses(chain: tuple[Curve, ...], start: np.ndarray, goals: list[np.ndarray]) -> float:
    """Largest distance of the curves, flown one after the other, from the places to pass."""
    pose, misses = start, []
    for curve, goal in zip(chain, goals, strict=True):
        pose = flown(curve, pose)
        misses.append(miss(pose, goal))
    return max(misses)


@pytest.mark.parametrize(("vias", "headings"), [(1, 72), (2, 18)])
@pytest.mark.parametrize("size", [1.5, 5.0])
def test_a_chain_passes_the_points_and_is_no_longer_than_brute_force(vias: int, headings: int, size: float):
    """Over headings that are all among those that the first round tries."""
    random = np.random.default_rng(int(size) + vias)
    grid = np.arange(headings) * TURN / headings
    for end_size in (2, 3):
        start, points, end = random_pose(random, size), random.uniform(-size, size, (vias, 2)), random_pose(random, size)[:end_size]
        chain = shortest_through(start, points, end, radius=1.0)
        assert chain_misses(chain, start, [*points, end]) < 1e-9
        through = {0.0: 0.0}
        at = {0.0: start}
        for point in points:
            here = {heading: np.append(point, heading) for heading in grid}
            through = {h: min(through[g] + length(at[g], pose) for g in at) for h, pose in here.items()}
            at = here
        brute = min(through[g] + length(at[g], end) for g in at)
        total = sum(curve.length for curve in chain)
        assert total <= brute + 1e-9
        # headings within half a grid step of the best: lengths change by a few radii per radian
        assert total >= brute - 4 * vias * TURN / headings


@few
@given(seed=seeds)
def test_a_chain_is_no_longer_with_headings_nearby_nor_on_a_fine_grid(seed: int):
    """All of 5-degree steps were tried; finer ones may find valleys between them, which are shallow."""
    random = np.random.default_rng(seed)
    start, via, end = random_pose(random, 1), random.uniform(-2, 2, 2), random_pose(random, 2)
    chain = shortest_through(start, [via], end, radius=1.0)
    total, heading = sum(curve.length for curve in chain), flown(chain[0], start)[2]

    def through(angle: float) -> float:
        return length(start, (*via, angle)) + length((*via, angle), end)

    assert all(total <= through(heading + change) + 1e-8 for change in (-1e-3, -1e-5, 1e-5, 1e-3))
    assert total <= min(through(angle) for angle in np.linspace(0, TURN, 240)) + 0.02


def test_a_chain_through_points_in_line_is_straight_and_without_points_is_one_curve():
    start = np.array([1.0, 2.0, 0.3])
    line = [start[:2] + d * np.array([np.cos(0.3), np.sin(0.3)]) for d in (2.0, 2.5, 9.0)]
    chain = shortest_through(start, line, radius=3.0)
    np.testing.assert_allclose([curve.length for curve in chain], [2.0, 0.5, 6.5], atol=1e-9)
    for end in ((4.0, -3.0), (4.0, -3.0, 1.0)):
        assert shortest_through(start, [], end, radius=1.0) == (shortest_curve(start, end, 1.0),)
    assert shortest_through(start, [line[0], (4.0, -3.0)], radius=1.0) == shortest_through(start, line[:1], (4.0, -3.0), radius=1.0)


def test_of_two_mirrored_best_chains_one_is_taken_whole():
    """Points straight behind: turning left or right costs the same, half of each would cost more."""
    points = [(-6.0, 0.0), (-3.0, 0.0), (-12.0, 0.0)]
    chain = shortest_through(POSE, points, radius=1.0)
    assert chain_misses(chain, np.zeros(3), [np.array(point) for point in points]) < 1e-9
    tilted = shortest_through((0.0, 0.0, 1e-7), points, radius=1.0)
    np.testing.assert_allclose(sum(c.length for c in chain), sum(c.length for c in tilted), atol=1e-6)


# ---------------------------------------------------------------- intercepts in wind


@few
@given(seed=seeds)
def test_an_intercept_flown_in_wind_arrives_first_of_the_shortest_curves(seed: int):
    random = np.random.default_rng(seed)
    start, size, radius, speed = random_pose(random, 5), random.choice([0.5, 5.0, 50.0]), random.uniform(0.3, 2), random.uniform(0.5, 3)
    goal = (start + random_pose(random, size))[: random.choice([2, 3])]
    angle = random.uniform(0, TURN)
    wind = speed * random.choice([0.0, 0.3, 0.9, 0.999]) * np.array([np.cos(angle), np.sin(angle)])
    curve = intercept(start, goal, tuple(wind), speed, radius)
    time = curve.length / speed
    arrived = flown(curve, start)
    arrived[:2] += wind * time
    assert miss(arrived, goal) < 1e-8 * (1 + speed * time)

    def slower(t: float) -> float:
        there = goal.copy()
        there[:2] -= wind * t
        return length(start, there, radius) - speed * t

    # shortest curves that are shorter than speed t at some t before were so from a jump on: none had just that length
    earlier = np.linspace(0, time, 100, endpoint=False)
    early = [i for i, t in enumerate(earlier) if slower(t) < -1e-9 * (1 + time)]
    if early:
        low, high = earlier[early[0] - 1], earlier[early[0]]
        for _ in range(60):
            middle = (low + high) / 2
            low, high = (low, middle) if slower(middle) < 0 else (middle, high)
        assert slower(low) - slower(high) > 1e-3
    else:
        np.testing.assert_allclose(slower(time), 0, atol=1e-6 * (1 + time))


@few
@given(seed=seeds)
def test_in_calm_air_the_intercept_is_the_shortest_curve(seed: int):
    random = np.random.default_rng(seed)
    start, goal = random_pose(random, 3), random_pose(random, 3)
    for end in (goal, goal[:2]):
        np.testing.assert_allclose(intercept(start, end, (0.0, 0.0), 2.0, 0.7).length, length(start, end, 0.7), rtol=1e-9)


@pytest.mark.parametrize(("wind", "speed"), [(-3.0, 5.0), (3.0, 5.0), (7.0, 5.0), (5.0, 5.0)])
def test_straight_along_the_wind_the_time_is_distance_over_ground_speed(wind: float, speed: float):
    curve = intercept(POSE, (100.0, 0.0), (wind, 0.0), speed, 10.0)
    np.testing.assert_allclose(curve.length / speed, 100.0 / (wind + speed), rtol=1e-9)


def test_across_the_wind_the_time_is_that_of_the_wind_triangle():
    """Heading along the triangle from the start: T = d / sqrt(V^2 - w^2), straight."""
    speed, wind, distance = 5.0, 3.0, 200.0
    curve = intercept((0.0, 0.0, np.arctan2(-3, 4)), (distance, 0.0), (0.0, wind), speed, 10.0)
    np.testing.assert_allclose(curve.length / speed, distance / 4.0, rtol=1e-9)


def test_a_goal_is_reached_in_wind_above_the_speed_only_where_it_carries_there():
    assert intercept(POSE, (100.0, 5.0, 1.0), (6.0, 0.0), 5.0, 3.0).length > 0
    behind, aside, near = (-100.0, 0.0), (10.0, 300.0), (0.0, 0.5, np.pi)
    for goal, wind in ((behind, 6.0), (behind, 5.0), (aside, 6.0), (near, 50.0)):
        said = rf"wind is \({wind}, 0\.0\): {wind:g} m/s against a speed of 5 m/s carry .* must be below the speed"
        with pytest.raises(od.InputError, match=said):
            intercept(POSE, goal, (wind, 0.0), 5.0, 3.0)


# ---------------------------------------------------------------- piecewise constant


def turning(steps: int, step: float = 0.25, lower: float = -0.4, upper: float = 0.6) -> Grid:
    return Grid(("turn_rate",), (lower,), (upper,), steps, step)


TWO = Grid(("speed", "turn_rate"), (2.0, -0.5), (9.0, 0.5), 11, 0.5)


@some
@given(pieces=st.integers(1, 40), more=st.integers(0, 60))
def test_pieces_fill_the_steps_and_differ_by_one_at_most(pieces: int, more: int):
    steps = pieces + more
    u = od.PiecewiseConstant(pieces).inputs(np.arange(float(pieces)), turning(steps))[:, 0]
    lengths = np.bincount(u.astype(int), minlength=pieces)
    assert np.all(np.diff(u) >= 0)
    assert lengths.sum() == steps
    assert np.ptp(lengths) <= 1
    begins = np.cumsum(lengths) - lengths
    assert np.all(np.abs(begins - np.arange(pieces) * steps / pieces) <= 0.5)


def test_the_columns_of_parameters_are_the_inputs_one_after_the_other():
    u = od.PiecewiseConstant(3).inputs(np.array([3.0, 4, 5, -0.1, 0.2, 0.3]), TWO)
    assert u[[0, 5, 10]].tolist() == [[3.0, -0.1], [4.0, 0.2], [5.0, 0.3]]
    p = np.concatenate([np.linspace(3, 8, 4), np.linspace(-0.4, 0.3, 4)])
    for path in (od.PiecewiseConstant(4), BSpline(4)):
        np.testing.assert_allclose(path.inputs(p, TWO)[[0, -1]], [[3, -0.4], [8, 0.3]], atol=0.5)


@few
@given(seed=seeds)
def test_rates_of_pieces_are_the_slopes_between_their_middles(seed: int):
    """So that a bound on them bounds what the inputs change by from middle to middle, over any number of pieces."""
    random = np.random.default_rng(seed)
    path, grid = od.PiecewiseConstant(4), turning(int(random.integers(4, 30)), 0.3)
    p = random.uniform(-0.4, 0.6, 4)
    u = path.inputs(p, grid)[:, 0]
    middles = np.array([grid.step * (np.flatnonzero(u == value).mean() + 0.5) for value in p])
    np.testing.assert_allclose(path.rates(p, grid)[:, 0], np.diff(p) / np.diff(middles))
    greatest = np.abs(path.rates(p, grid)).max()
    for i, j in itertools.combinations(range(4), 2):
        assert abs(p[i] - p[j]) <= greatest * (middles[j] - middles[i]) + 1e-12
    assert od.PiecewiseConstant(1).rates(p[:1], grid).shape == (0, 1)


# ---------------------------------------------------------------- splines


def cox_de_boor(j: int, degree: int, knots: np.ndarray, t: float) -> float:
    """B_j of a degree at t."""
    if degree == 0:
        return float(knots[j] <= t < knots[j + 1])
    total = 0.0
    for k, rising in ((j, True), (j + 1, False)):
        span = knots[k + degree] - knots[k]
        share = 0.0 if span == 0 else (t - knots[k]) / span
        total += (share if rising else (1 - share) * (span > 0)) * cox_de_boor(k, degree - 1, knots, t)
    return total


@pytest.mark.parametrize(("points", "degree", "steps"), [(4, 3, 5), (6, 3, 9), (5, 2, 12), (2, 1, 3), (9, 4, 9)])
def test_inputs_are_the_means_of_the_spline(points: int, degree: int, steps: int):
    """By the recursion of Cox and de Boor, Gauss quadrature between knots and nodes; the basis adds up to 1 and is not negative."""
    grid = turning(steps)
    knots = np.concatenate([np.zeros(degree), np.linspace(0, grid.duration, points - degree + 1), np.full(degree, grid.duration)])
    nodes, weights = np.polynomial.legendre.leggauss(4)
    M = np.column_stack([BSpline(points, degree).inputs(unit, grid) for unit in np.eye(points)])
    by_hand = np.zeros((steps, points))
    for k, j in np.ndindex(steps, points):
        edges = np.unique(np.concatenate([[k * grid.step, (k + 1) * grid.step], knots]))
        edges = edges[(edges >= k * grid.step) & (edges <= (k + 1) * grid.step)]
        for low, high in itertools.pairwise(edges):
            times = (low + high) / 2 + nodes * (high - low) / 2
            by_hand[k, j] += weights @ [cox_de_boor(j, degree, knots, t) for t in times] * (high - low) / 2 / grid.step
    np.testing.assert_allclose(M, by_hand, atol=1e-12)
    assert M.min() >= 0
    np.testing.assert_allclose(M.sum(axis=1), 1, rtol=1e-14)


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_control_points_on_a_line_give_the_line(degree: int):
    """At the means of `degree` knots in a row (Greville's abscissae) a spline repeats a straight line; its rate is the slope."""
    points, grid = 7, turning(13)
    knots = np.concatenate([np.zeros(degree), np.linspace(0, grid.duration, points - degree + 1), np.full(degree, grid.duration)])
    abscissae = np.array([knots[j + 1 : j + degree + 1].mean() for j in range(points)])
    path, p = BSpline(points, degree), 0.1 - 0.03 * abscissae
    np.testing.assert_allclose(path.inputs(p, grid)[:, 0], 0.1 - 0.03 * (np.arange(13) + 0.5) * grid.step)
    np.testing.assert_allclose(path.rates(p, grid), np.full((points - 1, 1), -0.03))


@some
@given(seed=seeds)
def test_no_step_of_a_spline_is_steeper_than_its_rates(seed: int):
    random = np.random.default_rng(seed)
    points, degree = int(random.integers(4, 12)), int(random.integers(1, 4))
    path, grid, p = BSpline(points, degree), turning(40), random.uniform(-0.4, 0.6, points)
    slopes, rates = np.diff(path.inputs(p, grid), axis=0) / grid.step, path.rates(p, grid)
    assert rates.min() - 1e-12 <= slopes.min()
    assert slopes.max() <= rates.max() + 1e-12


@some
@given(seed=seeds)
def test_a_spline_is_fitted_exactly_up_to_as_many_points_as_steps(seed: int):
    random = np.random.default_rng(seed)
    steps = int(random.integers(4, 40))
    path, grid = BSpline(int(random.integers(4, steps + 1))), turning(steps)
    p = np.clip(random.uniform(-0.8, 1.2, path.points), -0.4, 0.6)
    u = path.inputs(p, grid)
    np.testing.assert_allclose(path.inputs(path.fit(u, grid), grid), u, atol=1e-9)


def test_an_input_with_one_value_is_fitted_by_it():
    grid = Grid(("turn_rate", "speed"), (-0.4, 5.0), (0.6, 5.0), 9, 0.5)
    for path in (BSpline(4), od.PiecewiseConstant(4)):
        assert np.all(path.inputs(path.fit(np.ones((9, 2)), grid), grid)[:, 1].round(12) == 5.0)


# ---------------------------------------------------------------- arcs switched at free times


def durations_of(random: np.random.Generator, count: int, least: float, most: float) -> np.ndarray:
    return np.clip(random.uniform(-0.2, 1.2, count) * random.choice([0.2, 0.5, 1.0]) * most, least, most)


@some
@given(seed=seeds, word=st.sampled_from(["LSR", "LRL", "SRSLS", "LRLRLR"]), blend=st.sampled_from([1e-3, 0.25, 2.0, 50.0]))
def test_a_switched_turn_rate_stays_within_bounds_whatever_the_durations(seed: int, word: str, blend: float):
    """Its own box and beyond it: sums of switch times in order are all that counts."""
    random, grid = np.random.default_rng(seed), turning(40)
    for most in (grid.duration, 1e-9, 1e6):
        u = DubinsPath(word, blend).inputs(durations_of(random, len(word) - 1, 0.0, most), grid)
        assert np.all((u >= -0.4 - 1e-12) & (u <= 0.6 + 1e-12))


def test_means_of_switches_are_those_by_quadrature():
    path, grid, d = DubinsPath("LSRS", 1.2), turning(12), np.array([0.7, 0.5, 0.9])
    nodes, weights = np.polynomial.legendre.leggauss(20)
    times = (np.arange(12)[:, None] + (nodes + 1) / 2) * grid.step
    switched = 1 / (1 + np.exp(-(times[..., None] - np.cumsum(d)) / 0.3))
    by_hand = (0.6 + switched @ np.array([-0.6, -0.4, 0.4])) @ weights / 2
    np.testing.assert_allclose(path.inputs(d, grid)[:, 0], by_hand, rtol=1e-12)


@some
@given(seed=seeds)
def test_without_blending_each_step_has_its_shares_of_the_arcs(seed: int):
    """And what is due after the end does not happen."""
    random, grid, values = np.random.default_rng(seed), turning(20), np.array([0.6, 0.0, -0.4, 0.6])
    d = durations_of(random, 3, 0.1, grid.duration)
    edges = np.concatenate([[0.0], np.cumsum(d), [np.inf]])
    nodes = np.arange(21) * grid.step
    shares = np.diff(np.clip(nodes[:, None], edges[:-1], edges[1:]) - edges[:-1], axis=0) / grid.step
    # the last tau of log(2) around a switch is what 1e-9 s of blending may change
    np.testing.assert_allclose(DubinsPath("LSRL", 1e-9).inputs(d, grid)[:, 0], shares @ values, atol=1e-8)


def test_a_path_of_the_shortest_curves_word_and_lengths_turns_as_the_curve():
    """Lengths over speed are durations; the other inputs are constant."""
    start, end, speed = (0.0, 0.0, 0.5), (30.0, 40.0, -1.0), 8.0
    curve = shortest_curve(start, end, speed / 0.5)
    grid = Grid(("speed", "turn_rate"), (2.0, -0.5), (9.0, 0.5), 60, 0.2)
    u = DubinsPath(curve.word, 1e-6).inputs(np.append(np.array(curve.lengths[:-1]) / speed, speed), grid)
    nodes = np.arange(61) * grid.step
    before = nodes[1:] <= curve.length / speed
    np.testing.assert_allclose(u[before, 1], curve.turn_rates(speed, nodes)[before], atol=1e-5)
    assert np.all(u[:, 0] == speed)


@pytest.mark.parametrize("z", [0.0, 1e-300, -1e-9, 0.3, -5.0, 40.0, 800.0, -800.0])
def test_softplus_and_its_derivatives_are_right_everywhere(z: float):
    """log(1 + exp(z)), S(z), S(1 - S), S(1 - S)(1 - 2 S): at 0 as well, and where exp would overflow."""
    x = ca.SX.sym("x")
    derivatives = [softplus(x)]
    for _ in range(3):
        derivatives.append(ca.gradient(derivatives[-1], x))
    S, rest = (np.exp(-np.logaddexp(0, -side * z)) for side in (1, -1))
    found = [float(value) for value in ca.Function("f", [x], derivatives)(z)]
    np.testing.assert_allclose(found, [np.logaddexp(0, z), S, S * rest, S * rest * (rest - S)], rtol=1e-12, atol=1e-16)
    np.testing.assert_allclose(softplus(np.array([z])), np.logaddexp(0, z), rtol=1e-14)


def test_first_and_second_derivatives_of_the_inputs_where_a_switch_meets_a_node():
    path, grid, eps = DubinsPath("LSR", 0.4), turning(8), 1e-5
    p = ca.SX.sym("p", 2)
    u = path.inputs(p, grid)
    slopes = ca.jacobian(u, p)
    both = ca.Function("slopes", [p], [slopes, ca.jacobian(ca.vec(slopes), p)])
    at = np.array([0.5, 0.75])  # switches at nodes 2 and 5
    first, second = (value.full() for value in both(at))
    for i, unit in enumerate(eps * np.eye(2)):
        np.testing.assert_allclose(first[:, i], (path.inputs(at + unit, grid) - path.inputs(at - unit, grid))[:, 0] / (2 * eps), atol=1e-7)
        change = (both(at + unit)[0] - both(at - unit)[0]).full().ravel(order="F")
        np.testing.assert_allclose(second[:, i], change / (2 * eps), atol=1e-6)


@some
@given(seed=seeds, word=st.sampled_from(["L", "LS", "LSR", "SRSLS", "LRLRLR"]), blend=st.sampled_from([0.1, 0.25, 2.0]))
def test_no_step_of_switched_arcs_is_steeper_than_the_rate(seed: int, word: str, blend: float):
    random, grid, path = np.random.default_rng(seed), turning(40), DubinsPath(word, blend)
    d = durations_of(random, len(word) - 1, 0.0, random.choice([1.0, grid.duration]))
    assert np.abs(np.diff(path.inputs(d, grid), axis=0)).max() / grid.step <= path.rates(d, grid).max() + 1e-12


@pytest.mark.parametrize(("word", "d"), [("LS", [5.0]), ("RSL", [5.0, 0.0]), ("SRSLS", [1.0, 4.0, 0.0, 4.0])])
def test_the_rate_is_no_larger_than_it_must_be(word: str, d: list[float]):
    """It is reached where the switches between the two outermost values of the word coincide."""
    path, grid = DubinsPath(word, 0.5), turning(1000, 0.01)
    steepest = np.abs(np.diff(path.inputs(np.array(d), grid), axis=0)).max() / grid.step
    np.testing.assert_allclose(path.rates(np.array(d), grid), [[steepest]], rtol=1e-3)


@pytest.mark.parametrize(("word", "blend"), [("LR", 0.25), ("LSR", 0.3), ("LSR", 3.0), ("RSLSR", 0.5), ("RLRL", 1.0)])
@few
@given(seed=seeds)
def test_switch_times_are_found_where_arcs_last(word: str, blend: float, seed: int):
    """As long as a blend and a step at least; those due after the end may be anywhere there."""
    path, grid = DubinsPath(word, blend), turning(40)
    d = durations_of(np.random.default_rng(seed), len(word) - 1, max(blend, grid.step), grid.duration)
    u = path.inputs(d, grid)
    p = path.fit(u, grid)
    np.testing.assert_allclose(path.inputs(p, grid), u, atol=1e-6)
    seen = np.cumsum(d) < grid.duration - 3 * blend
    np.testing.assert_allclose(np.cumsum(p)[seen], np.cumsum(d)[seen], atol=1e-4)


def test_a_fit_turns_where_a_smooth_weave_turns():
    """One period of a sine: left in the first half, right in the second, in equal parts where the bounds are."""
    grid = turning(40, 0.25, -0.5, 0.5)
    u = 0.3 * np.sin(TURN * (np.arange(40) + 0.5) / 40)[:, None]
    switches = np.cumsum(DubinsPath("SLSRS", 0.25).fit(u, grid))
    np.testing.assert_allclose(switches + switches[::-1], grid.duration, atol=1e-3)
    # least squares: the switch is where the sine is half the bound
    np.testing.assert_allclose(switches[0], grid.duration * np.arcsin(0.25 / 0.3) / TURN, atol=0.05)


# ---------------------------------------------------------------- bad families


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: BSpline(3), "points is 3: must be more than the degree, 3"),
        (lambda: BSpline(4, 0), "degree is 0: must be a whole number of at least 1"),
        (lambda: BSpline(4.0), r"points is 4\.0: must be a whole number of at least 1"),
        (lambda: DubinsPath("", 1.0), "word is '': must be letters L, S and R, no two equal ones in a row"),
        (lambda: DubinsPath("LSX", 1.0), "word is 'LSX': must be letters"),
        (lambda: DubinsPath("LSSR", 1.0), "word is 'LSSR': must be letters"),
        (lambda: DubinsPath(3, 1.0), "word is 3: must be letters"),
        (lambda: DubinsPath("LSR", 0.0), r"blend is 0\.0: must be a finite number above 0"),
        (lambda: DubinsPath("LSR", 1.0).box(TWO), None),
        (lambda: DubinsPath("LSR", 1.0).inputs(np.ones(2), turning(9, lower=0.0)), r"bounds of turn_rate are \(0\.0, 0\.6\): must allow"),
        (lambda: DubinsPath("LSR", 1.0).fit(np.ones((9, 1)), turning(9, upper=-0.1)), r"bounds of turn_rate are \(-0\.4, -0\.1\): must"),
        (lambda: BSpline(10).rates(np.ones(10), turning(9)), None),
        (lambda: BSpline(10).inputs(np.ones(10), turning(9)), "points is 10: must be at most the number of steps, 9"),
        (lambda: od.PiecewiseConstant(10).inputs(np.ones(10), turning(9)), "pieces is 10: must be at most the number of steps, 9"),
    ],
)
def test_bad_families_are_refused(call, message: str | None):
    if message is None:
        call()
    else:
        with pytest.raises(od.InputError, match=message):
            call()
