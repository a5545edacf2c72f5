"""What a mission imposes on a path: margins against plain geometry, their derivatives, and what is refused."""

from __future__ import annotations

import itertools
import math
import re
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import obsdesign as od
from obsdesign.constraints.abstract import ALWAYS, AT_END, AbstractConstraint, Span
from obsdesign.constraints.goal import Goal
from obsdesign.constraints.goal_pose import GoalPose
from obsdesign.constraints.goal_region import GoalRegion
from obsdesign.constraints.ground_speed import GroundSpeed
from obsdesign.constraints.heading_sector import HeadingSector
from obsdesign.constraints.keep_in import KeepIn
from obsdesign.constraints.keep_out import KeepOut
from obsdesign.constraints.keep_out_polygon import KeepOutPolygon
from obsdesign.constraints.loiter import Loiter
from obsdesign.constraints.max_range import MaxRange
from obsdesign.constraints.stand_off import StandOff
from obsdesign.constraints.via import Via
from obsdesign.costs._price_budget import Budget, Price
from obsdesign.costs.effort import Effort
from obsdesign.costs.flight_time import FlightTime
from obsdesign.costs.path_length import PathLength
from obsdesign.geometry import circle_through, convex_corners, half_planes, is_inside, polygon_size
from obsdesign.moment import Moment

some = settings(deadline=None, max_examples=40, database=None, derandomize=True)
few = settings(deadline=None, max_examples=10, database=None, derandomize=True)
seeds = st.integers(0, 10**6)
TURN = 2 * math.pi
Points = tuple[tuple[float, float], ...]


# ---------------------------------------------------------------- plain geometry, written another way


def winding(corners: Sequence[Sequence[float]], point: Sequence[float]) -> int:
    """How often the outline runs around a point: the angles under which its edges are seen, added up."""
    offsets = [complex(x, y) - complex(*point) for x, y in corners]
    seen = [np.angle(after / before) for before, after in zip(offsets, offsets[1:] + offsets[:1], strict=True)]
    return round(sum(seen) / TURN)


def to_segment(a: Sequence[float], b: Sequence[float], point: Sequence[float]) -> float:
    """Distance from a point to a segment."""
    along, to = np.subtract(b, a), np.subtract(point, a)
    return float(np.linalg.norm(to - np.clip(to @ along / (along @ along), 0, 1) * along))


def to_outline(corners: Sequence[Sequence[float]], point: Sequence[float]) -> float:
    return min(to_segment(a, b, point) for a, b in zip(corners, [*corners[1:], corners[0]], strict=True))


def to_lines(corners: Sequence[Sequence[float]], point: Sequence[float]) -> np.ndarray:
    """Distance from the line of every edge, positive on the side away from the middle of the corners."""
    middle = np.mean(corners, axis=0)
    found = []
    for a, b in zip(corners, [*corners[1:], corners[0]], strict=True):
        across = np.array([[0, -1], [1, 0]]) @ np.subtract(b, a)
        across = across / np.linalg.norm(across)
        across = across if across @ (middle - a) < 0 else -across
        found.append(across @ np.subtract(point, a))
    return np.array(found)


def convex_polygon(seed: int) -> Points:
    """Three to nine corners on an ellipse of some size, shape and place, counter-clockwise."""
    random = np.random.default_rng(seed)
    m = random.integers(3, 10)
    angles = (np.arange(m) + random.uniform(-0.4, 0.4, m)) * TURN / m
    size, tilt = 10.0 ** random.uniform(-2, 4), random.uniform(0, TURN)
    ellipse = size * np.exp(1j * tilt) * (np.cos(angles) + 1j * random.uniform(0.2, 1) * np.sin(angles))
    corners = ellipse + size * complex(*random.uniform(-5, 5, 2))
    return tuple((float(corner.real), float(corner.imag)) for corner in corners)


def near(corners: Points, random: np.random.Generator) -> tuple[float, float]:
    """A point somewhere about the polygon, inside it about as often as outside."""
    x, y = np.mean(corners, axis=0) + 1.5 * (np.array(corners[random.integers(len(corners))]) - np.mean(corners, axis=0)) * random.uniform()
    spread = polygon_size(corners) * random.normal(size=2) * random.choice([0.05, 1.0])
    return float(x + spread[0]), float(y + spread[1])


def angle_between(a: float, b: float) -> float:
    """Smallest angle from a to b to whole turns, in [0, pi]."""
    return abs((a - b + math.pi) % TURN - math.pi)


# ---------------------------------------------------------------- constraints at an instant: x, y, heading, rates of x and y


def moment(instant: Any, landmarks: Points = ()) -> Moment:
    x, y, heading, east, north = instant
    return Moment({"x": x, "y": y, "heading": heading}, {"x": east, "y": north}, {}, landmarks)


def margins_at(constraint: AbstractConstraint, point: Sequence[float], landmarks: Points = ()) -> list[float]:
    return constraint.margins(moment((*point, 0.0, 0.0, 0.0), landmarks))


def margin_at(constraint: AbstractConstraint, point: Sequence[float], landmarks: Points = ()) -> float:
    return min(margins_at(constraint, point, landmarks))


HEXAGON = tuple((5 + 40 * math.cos(k * math.pi / 3), -3 + 40 * math.sin(k * math.pi / 3)) for k in range(6))
SQUARE = ((0.0, 0.0), (100.0, 0.0), (100.0, 100.0), (0.0, 100.0))
WEDGE = ((0.0, 0.0), (80.0, -5.0), (80.0, 5.0))
POSTS = ((10.0, 0.0), (-10.0, 5.0))
EXAMPLES: list[AbstractConstraint] = [
    Goal((3.0, 4.0), 2.0),
    GoalPose((3.0, 4.0), 3.0, 2.0, 0.5),
    GoalPose((3.0, 4.0), 0.0, 2.0, 2.5),
    GoalRegion(WEDGE),
    Via((3.0, 4.0), 2.0, 1.0, 5.0),
    Loiter((3.0, 4.0), 200.0, 1.0, 5.0),
    KeepOut((3.0, 4.0), 2.0),
    KeepOutPolygon(SQUARE),
    KeepOutPolygon(HEXAGON),
    KeepOutPolygon(WEDGE),
    KeepIn(HEXAGON),
    StandOff(2.0),
    StandOff(2.0, ((3.0, 4.0), (0.0, 0.0))),
    MaxRange(30.0),
    MaxRange(30.0, ((3.0, 4.0),)),
    HeadingSector(0.4, 1.2),
    HeadingSector(5.5, 0.7, 2.0, 9.0),
    HeadingSector(1.0, 0.2),
    GroundSpeed(2.0, 30.0),
    GroundSpeed(least=2.0),
    GroundSpeed(most=30.0),
]
each = pytest.mark.parametrize("constraint", EXAMPLES, ids=str)


def special_instants(constraint: AbstractConstraint) -> np.ndarray:
    """Where a distance, a maximum or an angle could have no derivative: centres, corners, ties between edges, opposite, at rest."""
    centres = [(3.0, 4.0), (0.0, 0.0), *POSTS, (50.0, 50.0), (5.0, -3.0), *SQUARE, *HEXAGON, *WEDGE]
    centres += [(-30.0, -30.0), (130.0, 130.0), (50.0, 0.0), (60.0, 60.0), (1e6, 1e6), (-1e5, 3.0)]
    headings = [0.0, 3.0, math.pi, 0.8, 0.8 + math.pi, 3.0 - math.pi, 0.5, -20.0]
    speeds = [(0.0, 0.0), (2.0, 0.0), (-30.0, 0.0), (1e-9, 0.0)]
    return np.array([(*next(places), heading, *speed) for places in [itertools.cycle(centres)] for heading in headings for speed in speeds])


def random_instants(count: int = 40) -> np.ndarray:
    random = np.random.default_rng(3)
    place = random.normal(size=(count, 2)) * 10.0 ** random.uniform(-1, 4, (count, 1))
    return np.column_stack(
        [place, random.uniform(-9, 9, count), random.normal(size=(count, 2)) * 10.0 ** random.uniform(-2, 2, (count, 1))]
    )


def gradients(constraint: AbstractConstraint, instant: np.ndarray) -> np.ndarray:
    """Derivatives (margins, 5) by complex steps through the NumPy definition: no differences of near-equal numbers."""
    step = 1e-200
    columns = [constraint.margins(moment([np.array([value]) for value in instant + 1j * step * row], POSTS)) for row in np.eye(5)]
    return np.array([[np.ravel(margin)[0].imag / step for margin in column] for column in columns]).T


def lengthscales(constraint: AbstractConstraint) -> np.ndarray:
    """What a change of each coordinate is small against."""
    size, unit = constraint.size
    return np.array([size if unit == "m" else 2.0] * 2 + [0.4] + [size if unit == "m/s" else 1.0] * 2)


def symbolic(constraint: AbstractConstraint) -> ca.Function:
    """Margins (k,), their derivatives (k, 5) and second derivatives (5k, 5) as the design has them."""
    symbols = ca.SX.sym("instant", 5)
    values = ca.vertcat(*constraint.margins(moment(ca.vertsplit(symbols), POSTS)))
    first = ca.jacobian(values, symbols)
    return ca.Function("margins", [symbols], [values, first, ca.jacobian(ca.vec(first.T), symbols)])


@each
def test_symbols_give_the_numbers_of_floats_and_arrays(constraint: AbstractConstraint):
    instants = np.concatenate([special_instants(constraint), random_instants()])
    evaluate = symbolic(constraint)
    at_once = np.stack(constraint.margins(moment(instants.T, POSTS)), axis=1)
    for instant, together in zip(instants, at_once, strict=True):
        alone = constraint.margins(moment([float(value) for value in instant], POSTS))
        assert all(type(margin) is float for margin in alone)
        np.testing.assert_allclose(together, alone, rtol=1e-13, atol=1e-13)
        np.testing.assert_allclose(evaluate(instant)[0].full().ravel(), alone, rtol=1e-13, atol=1e-13)


@each
def test_derivatives_are_finite_everywhere_and_those_of_the_function(constraint: AbstractConstraint):
    """First against complex steps, to rounding; second against central differences of those, with steps of a millionth."""
    evaluate, scales = symbolic(constraint), lengthscales(constraint)
    for instant in np.concatenate([special_instants(constraint), random_instants(6)]):
        _, first, second = (value.full() for value in evaluate(instant))
        assert np.isfinite(first).all()
        assert np.isfinite(second).all()
        np.testing.assert_allclose(first * scales, gradients(constraint, instant) * scales, rtol=1e-9, atol=1e-9)
        steps = np.maximum(1e-6 * scales, 1e-9 * np.abs(instant))
        sides = [(gradients(constraint, instant + step), gradients(constraint, instant - step)) for step in np.diag(steps)]
        differences = np.stack([(ahead - behind) / (2 * step) for (ahead, behind), step in zip(sides, steps, strict=True)], axis=-1)
        second = second.reshape(-1, 5, 5) * scales * scales[:, None]
        np.testing.assert_allclose(second, differences * scales * scales[:, None], rtol=1e-4, atol=1e-4 * max(1.0, np.abs(second).max()))


@pytest.mark.parametrize("reach", [1e3, 1e5, 1e7])
@each
def test_far_away_margins_grow_in_proportion_to_the_distance(constraint: AbstractConstraint, reach: float):
    """Ten times as far is ten times the margin, whichever way; nothing overflows."""
    if constraint.states == ("heading",):
        return
    size, _ = constraint.size
    for angle in np.linspace(0.1, 6.1, 7):
        far = reach * max(size, 60.0) * np.array([math.cos(angle), math.sin(angle)])
        instants = [(*(far * ten), 0.0, *(far * ten)) for ten in (1.0, 10.0)]
        here, there = (np.array(constraint.margins(moment(instant, POSTS))) for instant in instants)
        which = slice(1) if isinstance(constraint, GoalPose) else slice(None)
        # an edge's line may run the same way: then its distance stays
        grown = np.abs(here[which]) > 0.02 * reach
        assert grown.any()
        np.testing.assert_allclose(there[which][grown], 10 * here[which][grown], rtol=0.05)


@each
@few
@given(seed=seeds)
def test_a_scene_that_is_turned_and_moved_as_a_whole_keeps_its_margins(constraint: AbstractConstraint, seed: int):
    random = np.random.default_rng(seed)
    angle, (away_x, away_y) = random.uniform(-7, 7), random.uniform(-1e4, 1e4, 2)

    def turned(point: Sequence[float]) -> tuple[float, float]:
        x, y = point
        return x * math.cos(angle) - y * math.sin(angle), x * math.sin(angle) + y * math.cos(angle)

    def moved(value: Any) -> Any:
        if value is None:
            return None
        if isinstance(value[0], tuple):
            return tuple(moved(point) for point in value)
        x, y = turned(value)
        return x + away_x, y + away_y

    fields = vars(constraint)
    changed = {name: moved(value) for name, value in fields.items() if name in ("point", "centre", "corners", "landmarks")}
    changed |= {name: value + angle for name, value in fields.items() if name in ("heading", "low", "high")}
    other = type(constraint)(**{**fields, **changed})
    x, y, heading, *rates = random.uniform(-1, 1, 5) * (60, 60, 4, 40, 40)
    here = constraint.margins(moment((x, y, heading, *rates), POSTS))
    there = other.margins(moment((*moved((x, y)), heading + angle, *turned(rates)), moved(POSTS)))
    np.testing.assert_allclose(there, here, rtol=1e-8, atol=1e-8)


def test_spans_and_sizes():
    assert [each.span for each in (Goal((0, 0), 1), GoalPose((0, 0), 0, 1, 1), GoalRegion(SQUARE))] == [AT_END] * 3
    always = (KeepOut((0, 0), 1), KeepOutPolygon(SQUARE), KeepIn(SQUARE), StandOff(1), MaxRange(1), GroundSpeed(1))
    assert [each.span for each in always] == [ALWAYS] * 6
    assert Via((0, 0), 1).span == Span(0.0, None, anywhere=True)
    assert Via((0, 0), 1, 2, 5).span == Span(2.0, 5.0, anywhere=True)
    assert Loiter((0, 0), 1, 2, 5).span == HeadingSector(0, 1, 2, 5).span == Span(2.0, 5.0)
    assert Loiter((0, 0), 1, 2).span == Span(2.0, None)
    assert GroundSpeed(2, 10).size == (4.0, "m/s")
    assert GroundSpeed(2).size == (2.0, "m/s")
    assert GroundSpeed(None, 7).size == (7.0, "m/s")
    assert KeepIn(SQUARE).size == GoalRegion(SQUARE).size == KeepOutPolygon(SQUARE).size == (50.0, "m")
    assert HeadingSector(6, 0.5).size == (pytest.approx((TURN - 5.5) / 2), "rad")


# ---------------------------------------------------------------- discs

DISCS: dict[str, tuple[Callable[[Any, float], AbstractConstraint], int]] = {
    "goal": (Goal, 1),
    "goal_pose": (lambda point, radius: GoalPose(point, 0.0, radius, 1.0), 1),
    "via": (Via, 1),
    "loiter": (lambda point, radius: Loiter(point, radius, 0.0), 1),
    "max_range": (lambda point, radius: MaxRange(radius, (point,)), 1),
    "keep_out": (KeepOut, -1),
    "stand_off": (lambda point, radius: StandOff(radius, (point,)), -1),
}


@pytest.mark.parametrize("kind", DISCS)
@some
@given(seed=seeds, radius=st.floats(1e-3, 1e5))
def test_a_disc_has_the_sign_of_membership_and_the_size_of_the_distance(kind: str, seed: int, radius: float):
    make, inside = DISCS[kind]
    random = np.random.default_rng(seed)
    x, y = random.uniform(-10, 10, 2) * radius
    out = random.choice([1e-9, 0.01, 0.5, 1 - 1e-9, 1 + 1e-9, 1.5, 1e3]) * radius
    angle = random.uniform(0, TURN)
    point = x + out * math.cos(angle), y + out * math.sin(angle)
    margin = margins_at(make((x, y), radius), point)[0]
    distance = math.hypot(point[0] - x, point[1] - y) - radius
    assert math.copysign(1, margin) == math.copysign(1, -inside * distance)
    assert abs(margin * radius + inside * distance) <= (1e-6 if out >= radius / 2 else 1e-3) * radius


@pytest.mark.parametrize("make", [StandOff, MaxRange])
def test_landmarks_of_the_sensors_count_unless_others_are_given(make: Callable[..., AbstractConstraint]):
    point, own = (3.0, -2.0), ((1.0, 1.0), (4.0, 0.0), (9.0, 9.0))
    assert margins_at(make(2.0), point, own) == margins_at(make(2.0, own), point, POSTS)
    assert margins_at(make(2.0), point, POSTS) != margins_at(make(2.0, own), point, POSTS)
    assert [len(margins_at(make(2.0), point, own[:count])) for count in range(4)] == [0, 1, 2, 3]


@some
@given(seed=seeds, least=st.floats(0.01, 30), wider=st.floats(1.1, 50))
def test_ground_speed_is_the_length_of_the_rates_and_nothing_else(seed: int, least: float, wider: float):
    random = np.random.default_rng(seed)
    most = least * wider
    speed, angle = random.choice([least * 0.6, least, (least + most) / 2, most, most * 3]), random.uniform(0, TURN)
    instant = (*random.normal(size=3), speed * math.cos(angle), speed * math.sin(angle))
    limits = GroundSpeed(least, most)
    found = np.array(limits.margins(moment(instant))) * limits.size[0]
    np.testing.assert_allclose(found, [speed - least, most - speed], rtol=1e-9, atol=1e-6 * most * most / speed)
    for only, expected in ((GroundSpeed(least), speed / least - 1), (GroundSpeed(most=most), 1 - speed / most)):
        np.testing.assert_allclose(only.margins(moment(instant)), [expected], rtol=1e-9, atol=1e-6 * max(1.0, most / speed))


# ---------------------------------------------------------------- headings


@some
@given(centre=st.floats(-10, 10), half=st.floats(0.01, 3.1), away=st.floats(-3.14, 3.14), turns=st.integers(-3, 3))
def test_a_heading_counts_to_whole_turns_and_has_the_sign_of_membership(centre: float, half: float, away: float, turns: int):
    """The sector and the goal are the same margin; it falls from the middle to the opposite, by 1 / half a radian at the edge."""
    assume(abs(abs(away) - half) > 1e-9)
    sector, goal = HeadingSector(centre - half, centre + half), GoalPose((0.0, 0.0), centre, 1.0, half)
    heading = centre + away
    margin, same = (each.margins(moment((0.0, 0.0, heading, 0.0, 0.0)))[-1] for each in (sector, goal))
    around, mirrored, farther = (
        sector.margins(moment((0.0, 0.0, other, 0.0, 0.0)))[0] for other in (heading + turns * TURN, centre - away, centre + 0.99 * away)
    )
    tolerance = 1e-9 / half / math.cos(half / 2)
    assert (margin > 0) == (angle_between(heading, centre) < half)
    assert same == pytest.approx(margin, abs=tolerance)
    assert around == pytest.approx(margin, abs=tolerance)
    assert mirrored == pytest.approx(margin, abs=tolerance)
    assert farther >= margin - tolerance


@some
@given(low=st.floats(-7, 7), width=st.floats(0.02, 6.2))
def test_a_sector_runs_counter_clockwise_and_its_margin_leaves_the_edges_at_one_per_size(low: float, width: float):
    high = low + width
    for other in (high, high - TURN):
        sector = HeadingSector(low, other)
        size, _ = sector.size
        assert size == pytest.approx(width / 2, rel=1e-9)
        for edge, inwards in ((low, 1), (high, -1)):
            slope = gradients(sector, np.array([0.0, 0.0, edge, 0.0, 0.0]))[0, 2]
            assert slope * size == pytest.approx(inwards, rel=1e-5)
            assert sector.margins(moment((0.0, 0.0, edge, 0.0, 0.0)))[0] == pytest.approx(0, abs=1e-9 / math.cos(width / 4))
        assert sector.margins(moment((0.0, 0.0, low + width / 2, 0.0, 0.0)))[0] > 0.9


@given(half=st.floats(0.001, 1.0), off=st.floats(0.0, 1.0))
@some
def test_a_heading_error_counts_in_proportion_not_squared(half: float, off: float):
    """Between 2 / pi and 1 / cos(half / 2) tolerances of margin for one of heading, as far as the opposite direction."""
    away = half + off * (math.pi - half)
    margin = HeadingSector(-half, half).margins(moment((0.0, 0.0, away, 0.0, 0.0)))[0]
    steps = (away - half) / half
    assert 2 / math.pi * 0.85 * steps - 1e-6 <= -margin <= steps / math.cos(half / 2) + 1e-6


# ---------------------------------------------------------------- polygons


@some
@given(seed=seeds)
def test_the_inside_of_a_polygon_is_where_its_outline_runs_around(seed: int):
    corners = convex_polygon(seed)
    random, size = np.random.default_rng(seed), polygon_size(corners)
    for _ in range(10):
        point = near(corners, random)
        if to_outline(corners, point) < 1e-9 * size:
            continue
        inside = winding(corners, point) == 1
        assert (margin_at(KeepIn(corners), point) > 0) == inside
        assert (margin_at(GoalRegion(corners), point) > 0) == inside
        assert is_inside(corners, point) == inside


@some
@given(seed=seeds)
def test_margins_of_a_polygon_are_the_distances_from_its_edges(seed: int):
    corners = convex_polygon(seed)
    random = np.random.default_rng(seed)
    for make in (KeepIn, GoalRegion):
        size, unit = make(corners).size
        for _ in range(5):
            point = near(corners, random)
            found = np.array(margins_at(make(corners), point)) * size
            np.testing.assert_allclose(found, -to_lines(corners, point), rtol=1e-9, atol=1e-9 * size)
            if winding(corners, point) == 1:
                assert found.min() == pytest.approx(to_outline(corners, point), rel=1e-9, abs=1e-9 * size)
        assert unit == "m"


@some
@given(seed=seeds)
def test_no_point_lies_deeper_inside_than_the_size_which_is_the_inscribed_circle_where_there_is_one(seed: int):
    corners, random = convex_polygon(seed), np.random.default_rng(seed)
    deepest = max(margin_at(KeepIn(corners), near(corners, random)) for _ in range(50))
    assert deepest <= 1 + 1e-9
    m, radius = random.integers(3, 12), random.uniform(0.1, 100)
    around = [(radius * math.cos(TURN * k / m), radius * math.sin(TURN * k / m)) for k in range(m)]
    assert margins_at(KeepIn(around), (0.0, 0.0)) == pytest.approx([1.0] * m)


@some
@given(seed=seeds)
def test_what_a_polygon_to_keep_out_of_allows_lies_outside_and_it_forbids_no_more_than_its_widening(seed: int):
    corners = convex_polygon(seed)
    keep_out, random = KeepOutPolygon(corners), np.random.default_rng(seed)
    size, _ = keep_out.size
    assert keep_out.widening == pytest.approx(0.02 * size * math.log(len(corners)))
    for _ in range(20):
        point = near(corners, random)
        margin, beyond = margin_at(keep_out, point), to_lines(corners, point).max()
        assert margin * size <= beyond + 1e-9 * size
        assert margin * size >= beyond - keep_out.widening - 1e-9 * size
        if winding(corners, point) == 1 and to_outline(corners, point) > 1e-9 * size:
            assert margin < 0
        if beyond > keep_out.widening * (1 + 1e-9) + 1e-9 * size:
            assert margin > 0


def test_the_widening_is_whole_beside_an_edge_and_less_at_a_corner():
    """Beside an edge the other edges do not count: s - e log 4; on the bisector of a corner two count alike: s - e log 2."""
    keep_out, e = KeepOutPolygon(SQUARE), 0.02 * 50
    for s in (-0.5, 0.0, 1.0, 30.0, 1e5):
        assert margin_at(keep_out, (50.0, -s)) * 50 == pytest.approx(s - e * math.log(4), rel=1e-12, abs=1e-12)
        assert margin_at(keep_out, (100 + s, 100 + s)) * 50 == pytest.approx(s - e * math.log(2), rel=1e-12, abs=1e-12)
    assert margin_at(keep_out, (50.0, 50.0)) * 50 == pytest.approx(-50.0, rel=1e-12)


@pytest.mark.parametrize("make", [KeepIn, GoalRegion, KeepOutPolygon])
@some
@given(seed=seeds)
def test_the_sense_of_the_corners_and_the_first_of_them_do_not_matter(make: Callable[..., AbstractConstraint], seed: int):
    corners, random = convex_polygon(seed), np.random.default_rng(seed)
    start = int(random.integers(len(corners)))
    others = [corners[::-1], corners[start:] + corners[:start], np.array(corners), [list(corner) for corner in corners[::-1]]]
    for _ in range(3):
        point = near(corners, random)
        expected = np.sort(margins_at(make(corners), point))
        for other in others:
            np.testing.assert_allclose(np.sort(margins_at(make(other), point)), expected, rtol=1e-9, atol=1e-9)


# ---------------------------------------------------------------- geometry


@some
@given(seed=seeds)
def test_half_planes_are_normal_to_the_edges_and_touch_the_corners(seed: int):
    corners = convex_polygon(seed)
    size = np.ptp(np.array(corners))
    normals, offsets = (np.array(each) for each in half_planes(convex_corners("area", corners)))
    distances = normals @ np.array(corners).T - offsets[:, None]
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, rtol=1e-12)
    assert (distances <= 1e-9 * size).all()
    for i in range(len(corners)):
        on_line = {int(j) for j in np.flatnonzero(np.abs(distances[i]) < 1e-9 * size)}
        assert {i, (i + 1) % len(corners)} <= on_line


@some
@given(seed=seeds)
def test_a_polygon_out_of_order_is_refused_and_one_in_order_is_not(seed: int):
    """Of all orders of corners in convex position, the two around are accepted; each is told by an edge that crosses."""
    corners = convex_polygon(seed)
    random = np.random.default_rng(seed)
    order = random.permutation(len(corners))
    mixed = [corners[i] for i in order]
    steps = {int(step) % len(corners) for step in np.diff([*order, order[0]])}
    if steps in ({1}, {len(corners) - 1}):
        assert set(convex_corners("area", mixed)) == set(corners)
    else:
        with pytest.raises(od.InputError, match=r"^area: the edge from corner \d, .* meets the edge from corner \d, "):
            convex_corners("area", mixed)


@some
@given(seed=seeds, depth=st.floats(1e-6, 0.9))
def test_a_corner_pushed_in_is_named(seed: int, depth: float):
    corners, random = list(convex_polygon(seed)), np.random.default_rng(seed)
    i = int(random.integers(len(corners)))
    (ax, ay), (bx, by) = corners[i], corners[(i + 1) % len(corners)]
    middle = np.mean(corners, axis=0)
    x, y = (1 - depth) * np.array([(ax + bx) / 2, (ay + by) / 2]) + depth * middle
    dented = [*corners[: i + 1], (float(x), float(y)), *corners[i + 1 :]]
    for outline, place in ((dented, i + 1), (dented[::-1], len(corners) - i - 1)):
        with pytest.raises(od.InputError, match=rf"^area\[{place}\] is .*: points inwards"):
            convex_corners("area", outline)


def test_a_corner_on_a_straight_edge_changes_nothing():
    with_one = ((0.0, 0.0), (0.1, 0.1), (0.3, 0.3), (0.0, 0.7))
    without = ((0.0, 0.0), (0.3, 0.3), (0.0, 0.7))
    assert convex_corners("area", with_one) == with_one
    for point in ((0.1, 0.3), (0.2, 0.1), (5.0, 5.0)):
        assert margin_at(KeepIn(with_one), point) == pytest.approx(margin_at(KeepIn(without), point), abs=1e-12)


@pytest.mark.parametrize("away", [0.0, 5e6])
def test_far_from_the_origin_polygons_are_as_good(away: float):
    corners = [(away + x, away + y) for x, y in HEXAGON]
    assert margin_at(KeepIn(corners), (away + 5, away - 3)) == pytest.approx(margin_at(KeepIn(HEXAGON), (5.0, -3.0)), abs=1e-8)
    assert polygon_size(corners) == pytest.approx(polygon_size(HEXAGON), rel=1e-8)


STAR = [(math.cos(2 * TURN * k / 5), math.sin(2 * TURN * k / 5)) for k in range(5)]
BAD_CORNERS = {
    "no points": (5, r"^area is 5: must be at least three points \(x, y\)$"),
    "two": ([(0, 0), (1, 0)], r"^area is \(\(0\.0, 0\.0\), \(1\.0, 0\.0\)\): must be at least three points"),
    "numbers": ([1, 2, 3], r"^area\[0\] is 1: must be two numbers$"),
    "words": ("abc", r"^area\[0\] is 'a': must be two numbers$"),
    "three coordinates": ([(0, 0), (1, 0), (1, 1, 1)], r"^area\[2\] is \(1, 1, 1\): must be two numbers$"),
    "not finite": ([(0, 0), (1, 0), (0, math.nan)], r"^area\[2\] is \(0\.0, nan\): every entry must be finite$"),
    "repeated": ([(0, 0), (1, 0), (1, 0), (0, 1)], r"^area\[2\] is \(1\.0, 0\.0\): must differ from corner 1$"),
    "closed": (
        [(0, 0), (1, 0), (1, 1), (0, 0)],
        r"^area\[3\] is \(0\.0, 0\.0\): must differ from corner 0 \(the outline closes by itself\)$",
    ),
    "on a line": ([(0, 0), (1, 1), (3, 3), (2, 2)], r"^area is .*: all corners lie on one line, must enclose an area$"),
    "on a line, rounded": ([(0.1, 0.1), (0.2, 0.2), (0.3, 0.3)], r"all corners lie on one line"),
    "bow-tie": (
        [(0, 0), (1, 1), (1, 0), (0, 1)],
        r"^area: the edge from corner 0, \(0\.0, 0\.0\), to \(1\.0, 1\.0\) meets the edge from corner 2, \(1\.0, 0\.0\), to \(0\.0, 1\.0\)",
    ),
    "star": (STAR, r"^area: the edge from corner 0, .* meets the edge from corner 2, "),
    "there and back": ([(0, 0), (2, 0), (1, 0), (1, 1)], r"^area: the edge from corner 0, .* meets the edge from corner 2, "),
    "touching itself": ([(0, 0), (4, 0), (4, 4), (2, 0), (0, 4)], r"^area: the edge from corner 0, .* meets the edge from corner 2, "),
    "concave": ([(0, 0), (2, 0), (2, 2), (1, 0.5)], r"^area\[3\] is \(1\.0, 0\.5\): points inwards, must be a corner of a convex area$"),
}


@pytest.mark.parametrize("case", BAD_CORNERS)
def test_corners_that_enclose_no_convex_area_are_refused(case: str):
    corners, message = BAD_CORNERS[case]
    with pytest.raises(od.InputError, match=message):
        convex_corners("area", corners)


@some
@given(seed=seeds)
def test_a_circle_runs_through_its_points(seed: int):
    random = np.random.default_rng(seed)
    radius = 10.0 ** random.uniform(-2, 4)
    x, y = random.uniform(-100, 100, 2) * radius
    angles = random.uniform(0, TURN) + np.cumsum(random.uniform(0.3, 2.0, 3))
    (found_x, found_y), found = circle_through([(x + radius * math.cos(angle), y + radius * math.sin(angle)) for angle in angles])
    assert (found_x, found_y, found) == pytest.approx((x, y, radius), rel=1e-9, abs=1e-9 * radius)


@pytest.mark.parametrize(
    "points", [((0, 0), (1, 1), (3, 3)), ((0, 0), (1, 1), (0, 0)), ((2, 2), (2, 2), (5, 1)), ((0, 0), (1, 0), (2, 1e-12))]
)
def test_no_circle_runs_through_points_on_a_line(points: Points):
    with pytest.raises(od.InputError, match=re.escape(f"the points {list(points)} lie on one line")):
        circle_through(points)


def test_a_circle_needs_three_points():
    with pytest.raises(od.InputError, match="exactly 3 of them, there are 2"):
        circle_through(((0.0, 0.0), (1.0, 0.0)))


# ---------------------------------------------------------------- what is refused

REFUSED: list[tuple[Callable[[], object], str]] = [
    (lambda: Goal((1.0,), 1.0), r"^goal: point is \(1\.0,\): must be two numbers$"),
    (lambda: Goal((0, 0), 0), r"^goal: tolerance is 0: must be a finite number above 0$"),
    (lambda: GoalPose((0, math.inf), 0, 1, 1), r"^goal_pose: point is \(0\.0, inf\): every entry must be finite$"),
    (lambda: GoalPose((0, 0), math.nan, 1, 1), r"^goal_pose: heading is nan: must be a finite number$"),
    (lambda: GoalPose((0, 0), "north", 1, 1), r"^goal_pose: heading is 'north': must be a finite number$"),
    (lambda: GoalPose((0, 0), 0, -1, 1), r"^goal_pose: tolerance is -1: must be a finite number above 0$"),
    (lambda: GoalPose((0, 0), 0, 1, 0.0), r"^goal_pose: heading_tolerance is 0\.0: must be a finite number above 0$"),
    (lambda: GoalPose((0, 0), 0, 1, math.pi), r"^goal_pose: heading_tolerance is 3\.14\d*: must be below pi rad"),
    (lambda: GoalRegion(SQUARE[:2]), r"^goal_region: corners is .*: must be at least three points"),
    (lambda: Via((0, 0), "1"), r"^via: tolerance is '1': must be a finite number above 0$"),
    (lambda: Via(3.0, 1.0), r"^via: point is 3\.0: must be two numbers$"),
    (lambda: Via((0, 0), 1, -1), r"^via: first is -1: must be a finite number of at least 0$"),
    (lambda: Via((0, 0), 1, None), r"^via: first is None: must be a finite number of at least 0$"),
    (lambda: Via((0, 0), 1, 5, math.inf), r"^via: last is inf: must be a finite number of at least 0$"),
    (lambda: Via((0, 0), 1, 5, 3), r"^via: last is 3: must not be before first, 5 \(None = the end of the path\)$"),
    (lambda: Loiter((0, 0), math.nan, 0, 1), r"^loiter: radius is nan: must be a finite number above 0$"),
    (lambda: Loiter((0, "a"), 1, 0, 1), r"^loiter: centre is \(0, 'a'\): must be two numbers$"),
    (lambda: Loiter((0, 0), 1, 5, 3), r"^loiter: last is 3: must not be before first, 5"),
    (lambda: KeepOut((0, 0), True), r"^keep_out: radius is True: must be a finite number above 0$"),
    (lambda: KeepOut(None, 1), r"^keep_out: centre is None: must be two numbers$"),
    (lambda: KeepOutPolygon(STAR), r"^keep_out_polygon: corners: the edge from corner 0, .* meets"),
    (lambda: KeepIn([*SQUARE, (50, 50)]), r"^keep_in: corners\[4\] is \(50\.0, 50\.0\): points inwards"),
    (lambda: StandOff(0.0), r"^stand_off: distance is 0\.0: must be a finite number above 0$"),
    (lambda: StandOff(1, ()), r"^stand_off: landmarks is \(\): must be at least one point \(None = "),
    (lambda: StandOff(1, 7), r"^stand_off: landmarks is 7: must be points \(x, y\), or None"),
    (lambda: StandOff(1, ((0, 0), (1, 2, 3))), r"^stand_off: landmarks\[1\] is \(1, 2, 3\): must be two numbers$"),
    (lambda: MaxRange(math.inf), r"^max_range: distance is inf: must be a finite number above 0$"),
    (lambda: MaxRange(1, (0, 0)), r"^max_range: landmarks\[0\] is 0: must be two numbers$"),
    (lambda: HeadingSector(None, 1), r"^heading_sector: low is None: must be a finite number$"),
    (lambda: HeadingSector(0, math.inf), r"^heading_sector: high is inf: must be a finite number$"),
    (lambda: HeadingSector(1, 1), r"^heading_sector: high is 1\.0: must differ from low, 1\.0, by more than 0 and less than 2 pi rad$"),
    (lambda: HeadingSector(0, TURN), r"^heading_sector: high is 6\.28\d*: must differ from low, 0\.0"),
    (lambda: HeadingSector(-0.1, 6.5), r"^heading_sector: high is 6\.5: must differ from low, -0\.1"),
    (lambda: HeadingSector(0, -1e-17), r"^heading_sector: high is -1e-17: must differ from low"),
    (lambda: HeadingSector(0, 1, 9, 8), r"^heading_sector: last is 8: must not be before first, 9"),
    (GroundSpeed, r"^ground_speed: least and most are None: must have at least one of them$"),
    (lambda: GroundSpeed(0), r"^ground_speed: least is 0: must be a finite number above 0$"),
    (lambda: GroundSpeed(most=-3), r"^ground_speed: most is -3: must be a finite number above 0$"),
    (lambda: GroundSpeed(5, 5), r"^ground_speed: most is 5\.0: must be above least, 5\.0$"),
    (lambda: Effort({}), r"^effort: weights are empty: must name at least one input$"),
    (lambda: Effort({"turn_rate": 0}), r"^effort: weight of turn_rate is 0: must be a finite number above 0$"),
    (lambda: Effort(3), r"^effort: weights is 3: must map names of inputs to weights$"),
    (lambda: Effort(((1, "speed"),)), r"^effort: weights is .*: must map names of inputs to weights$"),
    (lambda: Effort((("a", 1), ("a", 2))), r"^effort: weights name 'a' 2 times: must name an input once$"),
    (lambda: Effort({"sped": 1}).rate(Moment({}, {}, {"speed": 1.0})), r"^effort: the vehicle has no 'sped'; did you mean 'speed'"),
    (lambda: Budget(FlightTime(), 0), r"^budget: at_most is 0: must be a finite number above 0$"),
    (lambda: Budget("time", 1), r"^budget: cost is 'time': must be a cost, such as PathLength\(\)$"),
    (lambda: Price(PathLength(), math.nan), r"^price: per_unit is nan: must be a finite number above 0$"),
    (lambda: Price(PathLength, 1.0), r"^price: cost is <class .*>: must be a cost"),
]


@pytest.mark.parametrize(("make", "message"), REFUSED, ids=[message[:50] for _, message in REFUSED])
def test_bad_values_are_refused_by_name_and_value(make: Callable[[], object], message: str):
    with pytest.raises(od.InputError, match=message):
        make()


def test_lists_and_arrays_make_the_same_constraint_as_tuples():
    for make in (KeepIn, KeepOutPolygon, GoalRegion):
        assert {make(SQUARE), make([list(corner) for corner in SQUARE]), make(np.array(SQUARE))} == {make(SQUARE)}
    assert {StandOff(1, [[0, 1]]), MaxRange(np.int64(2), np.array([[0, 1]]))} == {
        StandOff(1.0, ((0.0, 1.0),)),
        MaxRange(2.0, ((0.0, 1.0),)),
    }
    assert {Via([1, 2], np.float32(3)), Loiter(np.array([1, 2]), 3, 0, 4)} == {Via((1.0, 2.0), 3.0), Loiter((1.0, 2.0), 3.0, 0.0, 4.0)}
    assert Effort({"speed": 1, "turn_rate": 2}) == Effort([["turn_rate", 2.0], ("speed", np.float64(1.0))])
    assert hash(Budget(Effort({"a": 1}), 3)) == hash(Budget(Effort((("a", 1.0),)), 3.0))
    assert [str(each) for each in (FlightTime(), PathLength(), Effort({"a": 2}))] == ["flight time", "path length", "effort (2 a^2)"]
    assert str(KeepOut((np.float64(500000.25), 2), np.float32(3))) == "KeepOut: at least 3 m from (500000.25, 2)"


def test_costs_along_a_path_add_up_to_its_time_and_length():
    """A circle of radius 5 m in 20 s at constant rate, wind none: 10 pi m long; the sum over steps of constant rates is exact."""
    t, step = np.arange(200) * 0.1, 0.1
    speed, turn = 10 * math.pi / 20, 2 * math.pi / 20
    along = Moment(
        {"x": 5 * np.cos(turn * t)}, {"x": -speed * np.sin(turn * t), "y": speed * np.cos(turn * t)}, {"turn_rate": 0 * t + turn}
    )
    assert np.sum(FlightTime().rate(along)) * step == pytest.approx(20.0, rel=1e-12)
    assert np.sum(PathLength().rate(along)) * step == pytest.approx(10 * math.pi, rel=1e-7)
    assert np.sum(Effort({"turn_rate": 3.0}).rate(along)) * step == pytest.approx(3 * turn**2 * 20, rel=1e-12)
    at_rest = Moment({"x": 0 * t}, {"x": 0 * t, "y": 0 * t}, {})
    assert 0 <= np.sum(PathLength().rate(at_rest)) * step <= 20 * 1.001e-6


def test_a_check_with_plain_numbers_loads_no_heavy_library():
    names = sorted({(type(each).__module__, type(each).__name__) for each in EXAMPLES})
    imports = "\n".join(f"from {module} import {name}" for module, name in names)
    instant = "Moment({'x': 1.0, 'y': 2.0, 'heading': 0.3}, {'x': 1.0, 'y': 0.0}, {}, ((5.0, 5.0),))"
    code = f"import sys\n{imports}\nfrom obsdesign.moment import Moment\nfor each in {EXAMPLES!r}:\n    each.margins({instant})\n"
    code += "sys.exit(', '.join({'casadi', 'numpy', 'scipy'} & set(sys.modules)) or 0)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


# ---------------------------------------------------------------- in a scenario

AEROSONDE = Path(__file__).parent.parent / "scenarios" / "aerosonde_wind.toml"
TABLES = {
    'kind = "goal_pose"\npoint = [1.0, 2.0]\nheading_deg = 90.0\ntolerance = 50\nheading_tolerance_deg = 10.0': GoalPose(
        (1.0, 2.0), math.radians(90), 50.0, math.radians(10)
    ),
    'kind = "goal_region"\ncorners = [[0, 0], [9, 0], [9, 9]]': GoalRegion(((0.0, 0.0), (9.0, 0.0), (9.0, 9.0))),
    'kind = "via"\npoint = [500.0, 0.0]\ntolerance = 50.0\nfirst = 10.0\nlast = 60.0': Via((500.0, 0.0), 50.0, 10.0, 60.0),
    'kind = "via"\npoint = [500.0, 0.0]\ntolerance = 50.0': Via((500.0, 0.0), 50.0),
    'kind = "loiter"\ncentre = [500.0, 0.0]\nradius = 50.0\nfirst = 10.0': Loiter((500.0, 0.0), 50.0, 10.0),
    'kind = "keep_out_polygon"\ncorners = [[10.0, 0.0], [20.0, 0.0], [20.0, 9.0]]': KeepOutPolygon(((10.0, 0.0), (20.0, 0.0), (20.0, 9.0))),
    'kind = "keep_in"\ncorners = [[-9e3, -9e3], [-9e3, 9e3], [9e3, 0.0]]': KeepIn(((-9e3, -9e3), (-9e3, 9e3), (9e3, 0.0))),
    'kind = "max_range"\ndistance = 5000.0': MaxRange(5000.0),
    'kind = "stand_off"\ndistance = 5.0\nlandmarks = [[7.0, 8.0], [50.0, 0.0]]': StandOff(5.0, ((7.0, 8.0), (50.0, 0.0))),
    'kind = "heading_sector"\nlow_deg = 350.0\nhigh_deg = 80.0\nlast = 20.0': HeadingSector(math.radians(350), math.radians(80), 0.0, 20.0),
    'kind = "ground_speed"\nleast = 10.0': GroundSpeed(10.0),
}


def written(table: str, folder: Path) -> Path:
    """The aerosonde's scenario with one more constraint; it starts at the origin with heading 30 degrees and takes 120 s."""
    file = folder / "scenario.toml"
    file.write_text(
        AEROSONDE.read_text().replace("[[design.constraints]]", f"[[design.constraints]]\n{table}\n\n[[design.constraints]]", 1)
    )
    return file


@pytest.mark.parametrize("table", TABLES)
def test_a_table_of_a_scenario_is_the_constraint_it_says(table: str, tmp_path: Path):
    assert od.load_scenario(written(table, tmp_path)).design.constraints[0] == TABLES[table]


WRONG_TABLES = {
    'kind = "keep_out"\ncentre = [1.0, 0.0]\nradius = 3.0': "is violated by the start (x = 0, y = 0) by 2 m (KeepOut: at least 3 m from",
    'kind = "keep_out_polygon"\ncorners = [[-1, -1], [3, -1], [3, 3]]': "is violated by the start (x = 0, y = 0) by",
    'kind = "keep_in"\ncorners = [[10, 0], [20, 0], [20, 9]]': "is violated by the start (x = 0, y = 0) by 6.69 m",
    'kind = "max_range"\ndistance = 1000.0': "is violated by the start (x = 0, y = 0) by 972 m",
    'kind = "heading_sector"\nlow_deg = 40.0\nhigh_deg = 50.0': "is violated by the start (heading = 0.523599) by 0.17",
    'kind = "loiter"\ncentre = [100.0, 0.0]\nradius = 50.0\nfirst = 0.0\nlast = 5.0': "is violated by the start (x = 0, y = 0) by 50 m",
    'kind = "loiter"\ncentre = [1.0, 0.0]\nradius = 5.0\nfirst = 130.0': ".first: is 130 s: must be at most the duration, 120 s",
    'kind = "via"\npoint = [1.0, 0.0]\ntolerance = 5.0\nlast = 121.0': ".last: is 121 s: must be at most the duration, 120 s",
    'kind = "keep_in"\ncorners = [[0, 0], [1, 1], [1, 0], [0, 1]]': "keep_in: corners: the edge from corner 0, (0.0, 0.0), to (1.0, 1.0)",
    'kind = "keep_in"\ncorner = [[0, 0], [1, 1], [1, 0]]': ".corner: unknown key; did you mean 'corners'",
    'kind = "keep_inn"\ncorners = []': "did you mean 'keep_in'",
    'kind = "heading_sector"\nlow_deg = 10.0\nhigh_deg = 10.0': "must differ from low, 0.17453292519943295, by more than 0",
    'kind = "goal_pose"\npoint = [1.0, 2.0]\nheading_deg = 90.0\ntolerance = 50.0\nheading_tolerance_deg = 180.0': (
        "heading_tolerance is 3.141592653589793: must be below pi rad, where any heading will do (given as "
    ),
}


@pytest.mark.parametrize("table", WRONG_TABLES)
def test_a_wrong_table_is_named_with_what_is_wrong(table: str, tmp_path: Path):
    with pytest.raises(od.ScenarioError, match=r"design\.constraints\[0\]" + f".*{re.escape(WRONG_TABLES[table])}"):
        od.load_scenario(written(table, tmp_path))


@pytest.mark.parametrize(
    "table",
    [
        'kind = "via"\npoint = [1000.0, 0.0]\ntolerance = 5.0',
        'kind = "loiter"\ncentre = [100.0, 0.0]\nradius = 50.0\nfirst = 1.0',
        'kind = "keep_in"\ncorners = [[0, 0], [3, 1], [2, 7]]',
        'kind = "keep_out"\ncentre = [3.0, 4.0]\nradius = 5.0',
        'kind = "keep_in"\ncorners = [[-0.7, -0.9], [1.4, 1.8], [-5.4, 4.2]]',
    ],
    ids=["passed by later", "stayed at later", "on a corner", "on the circle", "on an edge but for rounding"],
)
def test_a_start_that_is_not_asked_about_or_lies_on_an_edge_is_accepted(table: str, tmp_path: Path):
    assert len(od.load_scenario(written(table, tmp_path)).design.constraints) == 3
