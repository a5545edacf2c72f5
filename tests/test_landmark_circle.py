"""Three landmarks and unknown slips: what is hidden on their circle, and what tells how near a path comes to staying there.

Source of the singular set: Belo, Salaris and Bicchi 2010, section IV-B. Figures for points of the circle follow from the theorem of the
inscribed angle: along the circle by an angle, with half of it in heading, every bearing stays.
"""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest
from by_hand import part
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import obsdesign as od
from obsdesign.constraints.circle_clearance import CircleClearance
from obsdesign.information.landmark_circle import Circle, circle_residuals, landmark_circle
from obsdesign.moment import Moment
from obsdesign.vehicles.omnidirectional import Omnidirectional

few = settings(deadline=None, max_examples=25, database=None, derandomize=True)
RADIUS = 2.0
LANDMARKS = ((-2.0, 0.0), (0.0, 2.0), (-1.6, -1.2))
PLACE, TANGENT = np.array([1.2, -1.6]), np.array([0.8, 0.6])  # on the circle; counter-clockwise
SLIPS = (0.1, -0.05, 0.02)
INPUTS = ("forward", "sideways", "turn_rate")


def looking(vehicle, landmarks=LANDMARKS, rate=None):
    return od.System(vehicle, tuple(od.Bearing(point, 0.01, rate=rate) for point in landmarks))


SLIPPING = looking(Omnidirectional("constant"))


def verdict(place, velocity, turn_rate, landmarks=LANDMARKS):
    """The exact verdict with inputs held so that inputs and slips together are what is asked for; heading 0."""
    total = (*velocity, turn_rate)
    # decimals, which the verdict reads as the rationals they are
    held = {name: round(value - slip, 9) for name, value, slip in zip(INPUTS, total, SLIPS, strict=True)}
    return od.observability(looking(Omnidirectional("constant"), landmarks), at=(*place, 0.0, *SLIPS), held=held)


def slide(x, velocity):
    """(n,): along the circle about the origin at 1 rad/s with all bearings kept; velocity: along the vehicle's axes, slips included."""
    return np.array([-x[1], x[0], 0.5, -velocity[1] / 2, velocity[0] / 2, 0.0])


def hides(found, direction):
    basis = found.null_space
    return np.allclose(basis @ (basis.T @ direction), direction, rtol=0, atol=1e-9)


def driven(velocity, turn_rate, steps=40, place=PLACE, system=SLIPPING):
    """A path under constant velocity along the vehicle's axes and constant turn rate, slips included."""
    u = np.tile(np.array([*velocity, turn_rate]) - SLIPS, (steps, 1))
    return od.simulate(system, (*place, 0.0, *SLIPS), u, 0.1)


# ---------------------------------------------------------------- the exact verdict


def test_away_from_the_circle_all_six_are_seen():
    generic = od.observability(SLIPPING)
    assert (generic.dimension, generic.ranks, generic.decided) == (6, (3, 6), True)
    for velocity, turn_rate in (((0.5, 0.0), 0.1), ((0.0, 0.0), 0.0)):
        found = verdict((0.3, 0.4), velocity, turn_rate)
        assert (found.dimension, found.ranks, found.decided) == (6, (3, 6), True)


@pytest.mark.parametrize("speed", [0.5, -0.5])
def test_staying_on_the_circle_hides_the_way_along_it(speed):
    velocity = speed * TANGENT
    found = verdict(PLACE, velocity, speed / RADIUS)
    assert (found.dimension, found.ranks, found.decided, found.generic.dimension) == (5, (2, 4, 5), True, 6)
    assert hides(found, slide(PLACE, velocity))
    assert found.observable_states == ("turn_slip",)
    assert "heading cannot be told from x, y, forward_slip, side_slip" in found.hidden


@pytest.mark.parametrize(("speed", "turn_rate"), [(0.5, -0.25), (-0.5, 0.25), (0.5, 0.3), (0.5, 0.0)])
def test_leaving_the_circle_along_its_tangent_shows_all(speed, turn_rate):
    found = verdict(PLACE, speed * TANGENT, turn_rate)
    assert (found.dimension, found.ranks, found.decided) == (6, (2, 4, 6), True)


def test_leaving_the_circle_along_its_radius_shows_all():
    found = verdict(PLACE, (0.3, -0.4), 0.3)
    assert (found.dimension, found.ranks, found.decided) == (6, (2, 5, 6), True)


def test_turning_on_the_spot_and_rest_on_the_circle():
    """At rest, derivatives of order k are homogeneous of degree k in the total velocities: only the first has a gradient there."""
    turning, resting = verdict(PLACE, (0.0, 0.0), 0.5), verdict(PLACE, (0.0, 0.0), 0.0)
    assert (turning.dimension, turning.decided) == (5, True)
    assert hides(turning, slide(PLACE, (0.0, 0.0)))
    assert (resting.dimension, resting.ranks, resting.decided) == (4, (2, 4), True)
    assert hides(resting, slide(PLACE, (0.0, 0.0)))
    assert hides(resting, np.array([0, 0, 0, *(2 * TANGENT), 0.5]))


def test_inputs_at_will_show_all_even_on_the_circle():
    found = od.observability(SLIPPING, at=(*PLACE, 0.0, *SLIPS))
    assert (found.dimension, found.decided) == (6, True)


def test_unknown_slips_that_stay_constant_are_the_constant_ones():
    found = od.observability(looking(Omnidirectional("unknown")), disturbance=od.Polynomial(0))
    assert (found.dimension, found.ranks, found.decided) == (6, (3, 6), True)
    assert od.observability(looking(Omnidirectional("unknown"))).observable_states == ("x", "y", "heading")


def test_landmarks_of_seven_digits_are_nearly_singular():
    found = verdict((0.0, 2.0), (-0.5, 0.0), 0.25, ((2.0, 0.0), (-1.0, 1.7320508), (-1.0, -1.7320508)))
    assert (found.dimension, found.decided) == (6, True)
    assert "nearly singular" in found.proof


# ---------------------------------------------------------------- the same along paths


@few
@given(angle=st.floats(-0.5, 0.5))
def test_on_the_circle_whole_paths_cannot_be_told_apart(angle):
    """Not only to first order: start further along, turned by half as much, slips turned with it, and every bearing is the same."""
    speed, turn_rate = 0.5, 0.25
    path = driven((speed, 0.0), turn_rate, place=(0.0, -2.0))
    half = np.array([[math.cos(angle / 2), -math.sin(angle / 2)], [math.sin(angle / 2), math.cos(angle / 2)]])
    moved = half @ [speed, 0.0] - path.u[0, :2]
    other = od.simulate(SLIPPING, (*(half @ half @ [0.0, -2.0]), angle / 2, *moved, SLIPS[2]), path.u, path.step)
    bearings = ca.Function("h", [SLIPPING.model.x], [SLIPPING.model.h])
    difference = (bearings(path.x.T) - bearings(other.x.T)).full()
    np.testing.assert_allclose(np.sin(difference / 2), 0.0, atol=1e-8)  # whole turns aside; RK4 at steps of 0.025 rad leaves 1e-9


def test_the_information_of_a_path_on_the_circle_is_blind_to_the_way_along_it_and_that_of_a_weave_is_not():
    scale = np.array([1.0, 1.0, 0.1, 0.1, 0.1, 0.01])
    naive = driven((0.5, 0.0), 0.25, place=(0.0, -2.0), steps=50)

    def spectrum(path):
        return np.linalg.eigh(od.variational_gramian(SLIPPING, path).total * np.outer(scale, scale))

    values, vectors = spectrum(naive)
    assert abs(values[0]) < 1e-13 * values[-1] < 1e-3 * values[1]
    expected = slide(naive.x[0], (0.5, 0.0)) / scale
    assert abs(vectors[:, 0] @ expected) == pytest.approx(np.linalg.norm(expected), rel=1e-9)
    u = naive.u.copy()
    u[:, 1] += 0.3 * np.sin(2 * np.pi * naive.t[:-1] / 2.5)
    woven = od.simulate(SLIPPING, naive.x[0], u, naive.step)
    assert spectrum(woven)[0][0] > 1e-6 * values[-1]


# ---------------------------------------------------------------- the circle


@few
@given(
    centre=st.tuples(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3)),
    radius=st.floats(0.1, 1e3),
    angles=st.lists(st.floats(0, 2 * math.pi), min_size=3, max_size=3),
)
def test_the_circle_goes_through_the_landmarks_it_was_made_of(centre, radius, angles):
    chords = [abs(math.sin((angles[i] - angles[j]) / 2)) for i, j in ((0, 1), (1, 2), (0, 2))]
    assume(min(chords) > 0.05)
    points = [(centre[0] + radius * math.cos(angle), centre[1] + radius * math.sin(angle)) for angle in angles]
    found = landmark_circle(points)
    # points are rounded to 1e-16 of the larger of centre and radius; short chords lever that
    allowed = 1e-11 * (1 + max(map(abs, centre)) + radius) / min(chords) ** 2
    assert found.radius == pytest.approx(radius, abs=allowed)
    assert found.centre == pytest.approx(centre, abs=allowed)


@pytest.mark.parametrize(
    ("landmarks", "message"),
    [
        (LANDMARKS[:2], "needs exactly 3 of them, there are 2"),
        ((*LANDMARKS, (1.0, 1.0)), "needs exactly 3 of them, there are 4"),
        (((0.0, 0.0), (1.0, 2.0), (2.0, 4.0)), "lie on one line"),
        (((0.0, 0.0), (1.0, 2.0), (1.0, 2.0)), "lie on one line"),
        (((0.0, 0.0), (1.0, math.nan), (2.0, 4.0)), "landmark"),
    ],
)
def test_three_landmarks_that_are_not_on_one_line(landmarks, message):
    with pytest.raises(od.InputError, match=message):
        landmark_circle(landmarks)
    with pytest.raises(od.InputError, match=message):
        circle_residuals(SLIPPING, driven((0.5, 0.0), 0.1), landmarks)
    with pytest.raises(od.InputError, match=message):
        CircleClearance(1.0, 1.0, landmarks)


def test_the_sensors_landmarks_are_those_that_count_unless_others_are_named():
    path = driven((0.5, 0.1), 0.1)
    own = circle_residuals(SLIPPING, path).circle
    assert (*own.centre, own.radius) == pytest.approx((0.0, 0.0, RADIUS), abs=1e-15)
    assert circle_residuals(SLIPPING, path, ((5.0, 1.0), (3.0, 3.0), (1.0, 1.0))).circle == Circle((3.0, 1.0), 2.0)
    two = looking(Omnidirectional("constant"), LANDMARKS[:2])
    with pytest.raises(od.InputError, match="there are 2"):
        circle_residuals(two, path)


# ---------------------------------------------------------------- residuals


UNREMARKABLE = {
    "slipping": (SLIPPING, (1.0, -0.5, 0.3, *SLIPS), (0.6, 0.2, 0.4), None),
    "constant wind": (looking(od.Dubins(0.8, wind="constant")), (1.0, -0.5, 0.3, 0.2, -0.1), (-0.5,), None),
    "unknown wind": (looking(od.Dubins(0.8, wind="unknown")), (1.0, -0.5, 0.3), (-0.5,), (0.2, -0.1)),
}


@pytest.mark.parametrize(("system", "start", "u", "w"), UNREMARKABLE.values(), ids=UNREMARKABLE)
def test_residuals_are_the_derivatives_along_the_simulated_path(system, start, u, w):
    """Those of the polynomial through |P - c|^2 - r^2 at the middle of a short path."""
    steps, step, orders = 40, 0.02, 4
    u, w = (None if values is None else np.tile(values, (steps, 1)) for values in (u, w))
    path = od.simulate(system, start, u, step, w)
    found = circle_residuals(system, path, ((3.0, 1.0), (1.0, 3.0), (-1.0, 1.0)), orders)
    value = np.hypot(path.x[:, 0] - 1.0, path.x[:, 1] - 1.0) ** 2 - 4.0
    middle = steps // 2
    fit = np.polynomial.Polynomial.fit(path.t - path.t[middle], value, 10)
    expected = [fit.deriv(k)(0.0) if k else fit(0.0) for k in range(orders)]
    np.testing.assert_allclose(found.residuals[middle], expected, rtol=1e-5, atol=1e-6)
    assert min(map(abs, expected)) > 1e-3
    np.testing.assert_allclose(found.distance, np.abs(np.hypot(*(path.x[:-1, :2] - 1.0).T) - 2.0), rtol=1e-12)
    np.testing.assert_array_equal(found.t, path.t[:-1])
    assert found.residuals.shape == found.paper_relation.shape == (steps, orders)


@pytest.mark.parametrize("speed", [0.5, -0.5])
def test_all_residuals_vanish_on_a_path_along_the_circle(speed):
    found = circle_residuals(SLIPPING, driven(speed * TANGENT, speed / RADIUS), orders=6)
    assert np.abs(found.residuals).max() < 1e-8  # RK4 leaves the circle by 1e-9
    assert np.abs(found.residuals[0]).max() < 1e-14
    assert found.distance.max() < 1e-8


@pytest.mark.parametrize(
    ("velocity", "turn_rate", "expected"),
    [
        # F = |P - c|^2 - r^2: F' = 2 (P - c).v, F'' = 2 |v|^2 + 2 (P - c).a, and a = omega x v under constant inputs
        (0.5 * TANGENT, -0.25, (0.0, 0.0, 4 * 0.25)),
        (-0.5 * TANGENT, 0.25, (0.0, 0.0, 4 * 0.25)),
        (0.5 * TANGENT, 0.0, (0.0, 0.0, 2 * 0.25)),
        (0.5 * PLACE / 2, 0.0, (0.0, 2.0, 2 * 0.25)),
        ((0.0, 0.0), 0.5, (0.0, 0.0, 0.0)),
    ],
    ids=["turning the other way", "backwards", "straight on", "radially", "on the spot"],
)
def test_residuals_at_a_point_of_the_circle(velocity, turn_rate, expected):
    found = circle_residuals(SLIPPING, driven(velocity, turn_rate, steps=5))
    np.testing.assert_allclose(found.residuals[0], expected, atol=1e-14)


# ---------------------------------------------------------------- the paper's relation (8)


def test_the_relation_is_the_radius_and_then_0_over_0_for_constant_inputs_along_the_circle():
    found = circle_residuals(SLIPPING, driven(0.5 * TANGENT, 0.25))
    np.testing.assert_allclose(found.paper_relation[:, 0], RADIUS, rtol=1e-12)
    assert np.isnan(found.paper_relation[:, 1:]).all()


@pytest.mark.parametrize(("speed", "turn_rate", "stays"), [(-0.5, -0.25, True), (0.5, -0.25, False), (-0.5, 0.25, False)])
def test_the_relation_does_not_know_the_sign_of_the_motion(speed, turn_rate, stays):
    """|v| / omega: the same for the clockwise path that stays on the circle as for the other that leaves it."""
    found = circle_residuals(SLIPPING, driven(speed * TANGENT, turn_rate, steps=5))
    assert found.paper_relation[0, 0] == pytest.approx(math.copysign(RADIUS, turn_rate))
    assert (np.abs(found.residuals[0]).max() < 1e-12) == stays
    assert (verdict(PLACE, speed * TANGENT, turn_rate).dimension < 6) == stays


def affine(names, drift):
    """A vehicle on its own that measures the three bearings; drift of (x, y, heading, ...)."""
    state = ca.vertcat(*map(ca.SX.sym, names))
    outputs = {f"bearing_{i}": ca.atan2(b - state[1], a - state[0]) - state[2] for i, (a, b) in enumerate(LANDMARKS)}
    rates = ca.vertcat(*drift(*ca.vertsplit(state)))
    return od.ControlAffineSystem(state=state, names=names, drift=rates, outputs=outputs, sigmas=dict.fromkeys(outputs, 0.01))


def body_motion(heading, f, s):
    return f * ca.cos(heading) - s * ca.sin(heading), f * ca.sin(heading) + s * ca.cos(heading)


def at_will(system, start, steps=20, step=0.1):
    return od.simulate(system, start, np.empty((steps, 0)), step)


def test_the_relation_misses_motion_along_the_circle_without_turning():
    """Velocity turns at |v| / r in the vehicle's axes, which do not turn: the way along the circle stays hidden, (8) is x/0."""
    system = affine(("x", "y", "heading", "f", "s"), lambda _, __, heading, f, s: (*body_motion(heading, f, s), 0, -s / 4, f / 4))
    start = (*PLACE, 0.0, *(0.5 * TANGENT))
    found = circle_residuals(system, at_will(system, start), LANDMARKS, 5)
    assert np.abs(found.residuals).max() < 1e-7
    assert np.isposinf(found.paper_relation).all()
    assert od.observability(system, at=start).dimension == 4
    assert found.sigma_min[0] < 1e-10  # of eigenvalues up to 1e5


def test_the_relation_holds_on_the_circle_where_speed_and_turn_rate_grow_together():
    def drift(_, __, heading, f, o):
        return (*body_motion(heading, f, 0), o, 0.1, 0.05)

    system = affine(("x", "y", "heading", "f", "o"), drift)
    found = circle_residuals(system, at_will(system, (0.0, -2.0, 0.0, 0.5, 0.25)), LANDMARKS)
    np.testing.assert_allclose(found.paper_relation[:, :2], RADIUS, rtol=1e-9)
    assert np.isnan(found.paper_relation[:, 2]).all()
    assert np.abs(found.residuals).max() < 1e-7


def test_the_relation_of_a_vehicle_in_wind_has_the_wind_turn_in_its_axes():
    """v_f + i v_h = V + (w_x + i w_y) exp(-i heading): its derivative has the size |omega| |w|, that of omega is 0."""
    system = looking(od.Dubins(0.8, wind="constant"))
    path = od.simulate(system, (1.0, -0.5, 0.3, 0.2, -0.1), np.full(10, -0.5), 0.1)
    found = circle_residuals(system, path).paper_relation
    ground = np.abs(0.8 + (0.2 - 0.1j) * np.exp(-1j * path.x[:-1, 2]))
    np.testing.assert_allclose(found[:, 0], ground / -0.5, rtol=1e-12)
    assert np.isposinf(found[:, 1:]).all()


def test_a_system_without_a_heading_has_residuals_but_no_relation():
    x = ca.SX.sym("x", 2)
    outputs = {"range": (ca.sumsqr(x - ca.SX((3, 0)))) ** 0.5, "x": x[0]}
    system = od.ControlAffineSystem(
        state=x, names=("x", "y"), known={"a": ca.SX([1, 0]), "b": ca.SX([0, 1])}, outputs=outputs, sigmas={"range": 1.0, "x": 1.0}
    )
    found = circle_residuals(system, od.simulate(system, (0.0, 1.0), np.ones((4, 2)), 0.5), LANDMARKS)
    np.testing.assert_allclose(found.residuals[0], (1.0 - 4.0, 2.0, 4.0))
    assert np.isnan(found.paper_relation).all()


def test_a_system_without_coordinates_is_refused():
    x = ca.SX.sym("x", 1)
    system = od.ControlAffineSystem(state=x, names=("depth",), drift=-x, outputs={"depth": x}, sigmas={"depth": 1.0})
    with pytest.raises(od.InputError, match="circle_residuals: the state has no 'x'"):
        circle_residuals(system, at_will(system, (1.0,)), LANDMARKS)
    with pytest.raises(od.InputError, match="orders is 0"):
        circle_residuals(SLIPPING, driven((0.5, 0.0), 0.1), orders=0)


# ---------------------------------------------------------------- sigma_min


@pytest.mark.parametrize(("rate", "window", "length"), [(None, None, 3), (5.0, None, 6), (None, 7, 7), (0.4, None, 40)])
def test_sigma_min_is_the_smallest_eigenvalue_of_the_window_that_begins_there(rate, window, length):
    system, scale = looking(Omnidirectional("constant"), rate=rate), np.array([1.0, 2.0, 0.1, 0.3, 0.2, 0.05])
    path = driven((0.5, 0.2), 0.3, place=(0.5, 0.2), system=system)
    found = circle_residuals(system, path, window=window, scale=scale).sigma_min
    assert np.isfinite(found).sum() == 40 - length + 1
    assert np.isnan(found[40 - length + 1 :]).all()
    steps_per_sample = 1 if rate is None else round(10 / rate)
    for first in range(0, 40 - length + 1, steps_per_sample):  # windows that begin with a sample, as paths do
        W = od.variational_gramian(system, part(path, first, first + length)).total * np.outer(scale, scale)
        assert found[first] == pytest.approx(np.linalg.eigvalsh(W)[0], rel=1e-6, abs=1e-13 * np.trace(W))


def test_sigma_min_is_0_along_the_circle_and_tells_leaving_it_from_staying():
    path = driven((0.5, 0.0), 0.25, place=(0.0, -2.0))
    staying = circle_residuals(SLIPPING, path).sigma_min
    leaving = circle_residuals(SLIPPING, driven((0.5, 0.0), -0.25, place=(0.0, -2.0))).sigma_min
    largest = np.linalg.eigvalsh(od.variational_gramian(SLIPPING, part(path, 0, 3)).total)[-1]
    assert np.nanmax(staying) < 1e-13 * largest
    assert np.nanmin(leaving) > 1e4 * np.nanmax(staying)


# ---------------------------------------------------------------- keeping clear of it


def moment(x, y, east, north):
    return Moment({"x": x, "y": y}, {"x": east, "y": north}, {}, LANDMARKS)


positions, speeds = st.floats(-5, 5), st.floats(-3, 3)


@few
@given(x=positions, y=positions, east=speeds, north=speeds, clearance=st.floats(0.1, 2), time_scale=st.floats(0.1, 10))
def test_clearance_is_the_root_of_distance_and_radial_speed(x, y, east, north, clearance, time_scale):
    out = math.hypot(x, y)
    assume(out > 0.5)  # rounded at the centre
    (found,) = CircleClearance(clearance, time_scale).margins(moment(x, y, east, north))
    by_definition = math.hypot(out - RADIUS, time_scale * (x * east + y * north) / out)
    assert found == pytest.approx(by_definition / clearance - 1, abs=2e-3 if by_definition < clearance / 2 else 1e-4, rel=1e-4)
    assert abs(by_definition - clearance) < 1e-4 * clearance * (1 + by_definition) or (found > 0) == (by_definition > clearance)


@few
@given(angle=st.floats(-math.pi, math.pi), along=speeds, time_scale=st.floats(0.1, 10))
def test_the_circle_may_be_crossed_at_speed_but_not_followed(angle, along, time_scale):
    constraint, speed = CircleClearance(0.5, time_scale), 0.5 / time_scale
    outwards, tangent = np.array([math.cos(angle), math.sin(angle)]), np.array([-math.sin(angle), math.cos(angle)])

    def margin(out):
        return constraint.margins(moment(*(RADIUS * outwards), *(along * tangent + out * outwards)))[0]

    assert margin(0.0) == pytest.approx(-1, abs=2e-3)
    assert margin(speed) == pytest.approx(0, abs=1e-9)
    assert margin(-speed) == pytest.approx(0, abs=1e-9)
    assert margin(1.01 * speed) > 0 > margin(0.99 * speed)


def test_derivatives_of_the_clearance_are_finite_everywhere():
    """Also where roots are taken of 0: at the centre, and on the circle without radial speed."""
    v = ca.SX.sym("v", 4)
    constraint = CircleClearance(0.5, 4.0, ((2.0, 0.0), (-2.0, 0.0), (0.0, -2.0)))  # their centre is 0 exactly
    hessian, gradient = ca.hessian(constraint.margins(moment(*ca.vertsplit(v)))[0], v)
    value = ca.Function("value", [v], [gradient, hessian, ca.jacobian(hessian, v)])
    for at in ((0, 0, 0, 0), (0, 0, 1, 1), (2, 0, 0, 0), (0, 2, 1, 0), (1.2, 1.6, -0.8, 0.6), (2.5, 0, 0, 0), (1e4, 0, 1, 0)):
        assert all(np.isfinite(each.full()).all() for each in value(at)), at
    # a saddle where the constraint is violated most: no hint to which side to go
    assert np.abs(value((0, 2, 1, 0))[0].full()).max() < 1e-9


def test_the_sensors_landmarks_make_the_circle_to_keep_clear_of_unless_others_are_named():
    elsewhere = CircleClearance(0.5, 4.0, ((5.0, 1.0), (3.0, 3.0), (1.0, 1.0)))
    assert elsewhere.margins(moment(3.0, -1.0, 1.0, 0.0))[0] < 0 < elsewhere.margins(moment(0.0, -2.0, 1.0, 0.0))[0]
    assert CircleClearance(0.5, 4.0).margins(moment(0.0, -2.0, 1.0, 0.0))[0] < 0


@pytest.mark.parametrize("field", ["clearance", "time_scale"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_clearance_and_time_scale_are_positive(field, value):
    with pytest.raises(od.InputError, match=rf"^circle_clearance: {field} is {value!r}: must be a finite number above 0$"):
        CircleClearance(**{"clearance": 1.0, "time_scale": 1.0, field: value})
