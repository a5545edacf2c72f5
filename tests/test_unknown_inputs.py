"""Verdicts with unknown inputs: published tables and formulas, exact words as a second way, invariance, bad input."""

from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import pairwise, product

import casadi as ca
import flint
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from published.classics import (
    CIRCLE,
    HIV_POINT,
    clock,
    folded,
    half_canonic,
    hiv,
    late,
    not_canonic,
    polar_unicycle,
    stalling,
    switched,
    three_landmarks,
    toggle_switch,
    vehicle_in_wind,
)

import obsdesign as od
from obsdesign.analysis.autobracket_recursion import codistribution_sequence
from obsdesign.analysis.evaluation_point import random_points
from obsdesign.analysis.field_rescaling import rescale
from obsdesign.analysis.lie_expressions import IndependenceTest
from obsdesign.analysis.model_equations import equations_of
from obsdesign.calculus import lie_derivative


def projector(*vectors):
    """The orthogonal projector on the span of independent vectors."""
    basis = np.linalg.qr(np.array(vectors, dtype=float).T)[0] if vectors else np.zeros((3, 0))
    return basis @ basis.T


def hides(verdict, *vectors):
    """Whether the hidden directions are exactly the span of these independent vectors."""
    found = verdict.null_space
    return found.shape[1] == len(vectors) and np.allclose(found @ found.T, projector(*vectors), atol=1e-12)


# ---------------------------------------------------------------- unicycle, one input unknown (Martinelli, SIAM CT15 2015, section 4)

UNICYCLE = {
    # case: output, known inputs, dimension, ranks, stopped by, observable states
    "4.1": ("range", ("omega",), 2, (1, 1, 2), "cap", ("r",)),
    "4.2": ("range", ("v",), 2, (2,), "cap", ("r",)),
    "4.3": ("bearing", ("omega",), 1, (1,), "criterion", ()),
    "4.4": ("bearing", ("v",), 2, (1, 2), "cap", ("r",)),
    "4.5": ("azimuth", ("omega",), 2, (1, 1, 2), "criterion", ("phi", "theta")),
    "4.6": ("azimuth", ("v",), 3, (2, 3), "full", ("r", "phi", "theta")),
    "range, both known": ("range", ("v", "omega"), 2, (1, 2), "criterion", ("r",)),
    "bearing, both known": ("bearing", ("v", "omega"), 2, (1, 2), "criterion", ("r",)),
    "azimuth, both known": ("azimuth", ("v", "omega"), 3, (1, 2, 3), "full", ("r", "phi", "theta")),
    "range, both unknown": ("range", (), 1, (1,), "criterion", ("r",)),
    "bearing, both unknown": ("bearing", (), 1, (1,), "criterion", ()),
    "azimuth, both unknown": ("azimuth", (), 1, (1,), "criterion", ("phi",)),
}
SMOOTH = {"4.1": 1, "4.2": 2, "4.3": 1, "4.4": 1, "4.5": 1, "4.6": 2}
POLAR_POINT = (1.2, 0.3, 0.9)


def hidden_in_polar_coordinates(case, at):
    """What a rotation of everything, a change of scale, a turn on the spot do to (r, phi, theta), as far as the output hides them."""
    rotation, scale, turn, nothing = (0, 1, 1), (at[0], 0, 0), (0, 0, 1), ()
    return {
        "4.3": (rotation, scale),
        "4.5": (scale,),
        "4.6": nothing,
        "azimuth, both known": nothing,
        "range, both unknown": (rotation, turn),
        "bearing, both unknown": (rotation, scale),
        "azimuth, both unknown": (scale, turn),
    }.get(case, (rotation,))


@pytest.mark.parametrize("at", [None, POLAR_POINT], ids=["generic", "at a point"])
@pytest.mark.parametrize("case", UNICYCLE)
def test_unicycle_table(case, at):
    output, known, dimension, ranks, stopped_by, states = UNICYCLE[case]
    verdict = od.observability(polar_unicycle(output, known), at)
    assert (verdict.dimension, verdict.observable_states) == (dimension, states)
    assert hides(verdict, *hidden_in_polar_coordinates(case, verdict.at))
    assert verdict.decided
    assert verdict.disturbance == ("none" if len(known) == 2 else "arbitrary")
    if at is None:
        assert (verdict.ranks, verdict.stopped_by) == (ranks, stopped_by)


@pytest.mark.parametrize("case", SMOOTH)
def test_unicycle_table_for_one_smooth_known_input(case):
    output, known, *_ = UNICYCLE[case]
    verdict = od.observability(polar_unicycle(output, known), known_inputs="smooth")
    assert (verdict.dimension, verdict.decided, verdict.known_inputs) == (SMOOTH[case], True, "smooth")
    assert verdict.stopped_by == ("cap" if case == "4.2" else "criterion")


@pytest.mark.parametrize("case", UNICYCLE)
def test_unicycle_table_by_jets(case):
    output, known, dimension, *_, states = UNICYCLE[case]
    system = polar_unicycle(output, known)
    verdict = od.observability(system, method="jets")
    assert (verdict.dimension, verdict.observable_states) == (dimension, states)
    if case in SMOOTH:
        assert od.observability(system, known_inputs="smooth", method="jets").dimension == SMOOTH[case]


def rescaled_at(system):
    """The rescaled system, and what evaluates its expressions at a state."""
    equations = equations_of(system.model)
    rescaled = rescale(IndependenceTest(equations, next(random_points(equations.n, 0))))

    def value(expression, at):
        return np.array(equations.function(ca.densify(expression))(at, [float(constant) for constant in equations.values]))

    return rescaled, value


def sine(r, phi, theta):
    return np.sin(theta - phi)


def cosine(r, phi, theta):
    return np.cos(theta - phi)


def tangent(r, phi, theta):
    return np.tan(theta - phi)


PRINTED = {
    # case: L_g h, rho, d rho, phi_1, d(L_phi_1 h), each of (r, phi, theta); None where the paper prints nothing
    "4.1": (
        cosine,
        lambda *x: tangent(*x) ** 2 / x[0],
        lambda *x: tangent(*x) / x[0] * np.array([-tangent(*x) / x[0], -2 / cosine(*x) ** 2, 2 / cosine(*x) ** 2]),
        lambda *x: (-tangent(*x), 1 / x[0], 0),
        lambda *x: (0, 1 / cosine(*x) ** 2, -1 / cosine(*x) ** 2),
    ),
    "4.2": (lambda *x: -sine(*x), lambda *x: -cosine(*x) / sine(*x) ** 2, None, None, None),
    "4.3": (lambda *x: -sine(*x) / x[0], lambda *x: 2 / tangent(*x), lambda *x: 2 / sine(*x) ** 2 * np.array([0, 1, -1]), None, None),
    "4.4": (lambda *x: 1, lambda *x: 0, lambda *x: (0, 0, 0), None, None),
    "4.5": (
        lambda *x: sine(*x) / x[0],
        lambda *x: -2 / tangent(*x),
        lambda *x: 2 / sine(*x) ** 2 * np.array([0, -1, 1]),
        lambda *x: (-x[0], 1 / tangent(*x), 0),
        lambda *x: np.array([0, 1, -1]) / sine(*x) ** 2,
    ),
    # x2' = sin / r, x3' = cos / r: the paper prints rho = -x2' / x3', which lacks a square
    "4.6": (lambda *x: cosine(*x) / x[0], lambda *x: -x[0] * sine(*x) / cosine(*x) ** 2, None, None, None),
}


@pytest.mark.parametrize("case", PRINTED)
def test_intermediate_results_are_those_printed(case):
    L_g_h, rho, d_rho, phi_1, d_of_phi_1 = PRINTED[case]
    output, known, *_ = UNICYCLE[case]
    rescaled, value = rescaled_at(polar_unicycle(output, known))
    x = rescaled.equations.x
    zero_bracket, bracket = rescaled.autobrackets(rescaled.equations.known_fields)
    for at in np.random.default_rng(1).uniform(0.2, 1.4, (5, 3)):
        assert np.allclose(value(rescaled.rates, at), [[0, L_g_h(*at)]], rtol=1e-12, atol=0)
        assert np.allclose(value(rescaled.tensor, at).ravel(), [0, 0, 0, rho(*at)], rtol=1e-12, atol=1e-14)
        assert not value(zero_bracket, at).any()  # no drift
        if d_rho:
            assert np.allclose(value(ca.jacobian(rescaled.tensor[3], x), at), d_rho(*at), rtol=1e-12, atol=1e-13)
        if phi_1:
            assert np.allclose(value(bracket, at).ravel(), phi_1(*at), rtol=1e-12, atol=1e-13)
            gained = ca.jacobian(lie_derivative(rescaled.selected_functions, x, bracket), x)
            assert np.allclose(value(gained, at), d_of_phi_1(*at), rtol=1e-12, atol=1e-13)


# ---------------------------------------------------------------- stopping too early, systems that are not canonic

SMALL = {
    # system: builder, dimension, ranks (None where nothing says in which step), stopped by, observable states (None: all or none)
    "switched": (switched, 2, (1, 1, 2), "full", ("x1", "x2")),
    "stalling": (stalling, 3, (1, 1, 3), "full", ("x0", "x1", "x2")),
    "late": (late, 5, (1, 1, 1, 1, 1, 2, 3, 4, 5), "full", ("y", "l", "a", "b", "c")),
    "not canonic": (not_canonic, 3, (2, 3), "full", ("x1", "x2", "x3")),
    "half canonic": (half_canonic, 4, None, "criterion", ("x1", "x2", "x3")),
    "folded": (folded, 1, (1,), "criterion", ()),
    "clock": (clock, 1, (1,), "full", ("x",)),
}


@pytest.mark.parametrize("name", SMALL)
def test_small_systems(name):
    build, dimension, ranks, stopped_by, states = SMALL[name]
    verdict = od.observability(build())
    assert (verdict.dimension, verdict.decided, verdict.stopped_by, verdict.observable_states) == (dimension, True, stopped_by, states)
    assert ranks is None or verdict.ranks == ranks


@pytest.mark.parametrize("name", SMALL)
def test_small_systems_by_jets_of_rising_order(name):
    build, dimension, *_ = SMALL[name]
    found = {orders: od.observability(build(), method="jets", orders=orders).dimension for orders in (1, 2, 4, 8, 12)}
    assert all(first <= second for first, second in pairwise(found.values()))
    assert found[12] == dimension
    if name == "half canonic":
        assert found[4] == 4


def test_a_vanishing_tensor_and_a_step_without_growth_are_not_the_end():
    # x1' = u, x2' = x1 w, y = x2: tau = 0 and Omega_1 = Omega_0, Omega_2 is larger
    equations = equations_of(switched().model)
    space = IndependenceTest(equations, next(random_points(2, 0)))
    rescaled = rescale(space)
    assert space.vanishes(rescaled.tensor)
    steps = codistribution_sequence(space, rescaled)
    assert [next(steps).numel() for _ in range(4)] == [1, 1, 2, 2]


def test_what_a_system_that_is_half_canonic_shows_of_its_last_two_states():
    # beside x1, x2, x3 it is x4 (v - x5) with v = d x2 / dt, which is known: the hidden direction is (x4, v - x5), v unknown beforehand
    verdict = od.observability(half_canonic())
    assert not verdict.null_space[:3].any()
    assert verdict.null_space[3:].all()


def test_a_singular_point_is_seen_through_the_second_derivative():
    there = od.observability(clock(), at=[0.0])
    assert (there.dimension, there.decided, there.ranks) == (1, True, (0, 1))


def small(known, unknown, outputs):
    """A system of a, b, c without drift; fields and outputs are functions of these."""
    x = ca.SX.sym("x", 3)
    a, b, c = ca.vertsplit(x)
    groups = [{name: ca.vertcat(*field(a, b, c)) for name, field in group.items()} for group in (known, unknown)]
    return od.ControlAffineSystem(x, ("a", "b", "c"), None, *groups, {name: output(a, b, c) for name, output in outputs.items()})


@pytest.mark.parametrize("method", ["recursion", "jets"])
def test_a_singular_point_is_seen_through_the_fourth_derivative_by_both_methods(method):
    # a' = u with y = a^4: at a = 0 only derivative 3 has a gradient; w is seen beside it, and hides nothing of a and b
    system = small({"u": lambda a, b, c: (1, 0, 0)}, {"w": lambda a, b, c: (0, 1, 0)}, {"y": lambda a, b, c: a**4, "z": lambda a, b, c: b})
    verdict = od.observability(system, at=(0.0, 0.0, 0.0), method=method)
    assert (verdict.dimension, verdict.observable_states) == (2, ("a", "b"))


def test_halves_that_differentiating_makes_are_exact():
    # c' = -3 u + 2 c w gives w away, b' = -2 u + a c w then a: d(a c / (2 c)) / da is written with the constant 1/2
    known, unknown = {"u": lambda a, b, c: (0, -2, -3)}, {"w": lambda a, b, c: (0, a * c, 2 * c)}
    verdict = od.observability(small(known, unknown, {"y": lambda a, b, c: c, "z": lambda a, b, c: b}))
    assert (verdict.dimension, verdict.decided, verdict.ranks) == (3, True, (2, 3))


@pytest.mark.parametrize(
    ("unknown", "output", "dimension"),
    [
        (lambda a, b, c: (0, a, 0), lambda a, b, c: b, 2),  # b' = a w: its gradient at a = 0 is w da
        (lambda a, b, c: (0, b, c), lambda a, b, c: b, 1),  # all derivatives are multiples of b
        (lambda a, b, c: (0, b, a * c), lambda a, b, c: b * c, 0),  # all derivatives are multiples of b c
    ],
    ids=["2", "1", "0"],
)
def test_a_point_where_the_unknown_input_has_no_effect(unknown, output, dimension):
    # L_g h is 0 there, so that nothing can be rescaled at the point
    verdict = od.observability(small({"u": lambda a, b, c: (1, 0, 0)}, {"w": unknown}, {"y": output}), at=(0.0, 0.0, 0.0))
    assert verdict.dimension == dimension


# ---------------------------------------------------------------- vehicle in wind of known direction (Martinelli, IROS 2017, section III)


def turned_about(axis, at):
    """How (r, q) changes when everything turns about an axis of the global frame: r' = e x r, q' = e q / 2."""
    position, (qt, *vector) = np.array(at[:3]), at[3:]
    unit = np.eye(3)["xyz".index(axis)]
    return np.array([*np.cross(unit, position), -unit @ vector / 2, *(qt * unit + np.cross(unit, vector)) / 2])


@pytest.mark.parametrize("at", [None, (0.5, 0.5, 0.5, 1.0, 0.0, 0.0, 0.0), (0.5, -1.0, 2.0, 0.5, 0.5, -0.5, 0.5)])
def test_vehicle_in_calm_air_hides_three_rotations(at):
    verdict = od.observability(vehicle_in_wind(False), at)
    assert (verdict.dimension, verdict.ranks, verdict.decided) == (4, (3, 4), True)
    assert hides(verdict, *(turned_about(axis, verdict.at) for axis in "xyz"))


@pytest.mark.parametrize("at", [None, (0.5, 0.5, 0.5, 1.0, 0.0, 0.0, 0.0)])
def test_vehicle_in_wind_hides_the_yaw_about_its_direction(at):
    verdict = od.observability(vehicle_in_wind(True), at)
    assert (verdict.dimension, verdict.decided, verdict.stopped_by) == (6, True, "cap")
    assert at or verdict.ranks == (3, 5, 6)
    x, y, _z, qt, qx, qy, qz = verdict.at
    assert hides(verdict, (-y, x, 0, -qz / 2, -qy / 2, qx / 2, qt / 2))
    assert verdict.observable_states == (("z",) if at is None else ("z", "qt", "qx", "qy"))


def test_vehicle_in_wind_by_jets():
    verdict = od.observability(vehicle_in_wind(True), method="jets")
    assert (verdict.dimension, verdict.ranks, verdict.stopped_by) == (6, (3, 5, 6), "cap")


def test_vehicle_in_wind_has_no_autobrackets():
    rescaled, value = rescaled_at(vehicle_in_wind(True))
    brackets = rescaled.autobrackets(rescaled.equations.known_fields)
    assert len(brackets) == 12  # six known inputs, along the drift (none) and along the wind
    for at in np.random.default_rng(1).uniform(-1, 1, (3, 7)):
        assert np.abs(value(ca.horzcat(*brackets), at)).max() < 1e-12


# ---------------------------------------------------------------- three landmarks, constant unknown inputs (Belo, Salaris and Bicchi 2010)

CONSTANT = od.Polynomial(0)
INPUTS = ("d_f", "d_h", "d_omega")


def square_root_of_three(x):
    """3^(1/2) as an expression: CasADi would fold that of a number into a double."""
    return ca.sqrt((3 + (x + 1)) - x - 1)


def landmarks_of_the_paper():
    """Three landmarks on the circle of radius 2, (2, 0), (-1, 3^(1/2)), (-1, -3^(1/2)), not rounded."""
    rough = three_landmarks(((2, 0), (-1, 7), (-1, -7)))
    x, z, theta = ca.vertsplit(rough.state)
    height = square_root_of_three(x)
    places = ((2, 0), (-1, height), (-1, -height))
    return replace(rough, outputs={f"bearing_{i}": ca.atan2(b - z, a - x) - theta for i, (a, b) in enumerate(places)})


def sliding(at):
    """Along the circle about the origin with every bearing kept: by the inscribed angle theorem the heading turns half as much."""
    x, z, _, d_f, d_h, _ = at
    return (-z, x, 0.5, -d_h / 2, d_f / 2, 0)


def test_three_landmarks_generic():
    verdict = od.observability(three_landmarks(CIRCLE), disturbance=CONSTANT)
    assert (verdict.dimension, verdict.ranks, verdict.stopped_by, verdict.decided) == (6, (3, 6), "full", True)
    assert verdict.observable_states == ("x", "z", "theta", *INPUTS)
    assert verdict.disturbance == "polynomial of degree 0"
    assert verdict.proof.endswith("adds 3 for 3 unknown inputs: the induction step holds")
    assert od.observability(three_landmarks(CIRCLE)).observable_states == ("x", "z", "theta")


@pytest.mark.parametrize(
    ("system", "place", "tangent"),
    [(three_landmarks(CIRCLE), (1.2, 1.6), (-0.8, 0.6)), (landmarks_of_the_paper(), (0.0, 2.0), (-1.0, 0.0))],
    ids=["rational landmarks", "landmarks of the paper"],
)
class TestOnTheCircle:
    def verdict(self, system, place, velocity, turn_rate):
        return od.observability(system, at=(*place, 0.0, *velocity, turn_rate), disturbance=CONSTANT)

    @pytest.mark.parametrize("speed", [0.5, -0.5])
    def test_staying_on_it(self, system, place, tangent, speed):
        # v / omega = radius: the vehicle never leaves the circle
        verdict = self.verdict(system, place, speed * np.array(tangent), speed / 2)
        assert (verdict.dimension, verdict.ranks, verdict.decided, verdict.stopped_by) == (5, (2, 4, 5), True, "criterion")
        assert hides(verdict, sliding(verdict.at))
        assert "d_omega" in verdict.observable_states
        assert (verdict.generic.dimension, verdict.generic.decided) == (6, True)

    @pytest.mark.parametrize(("speed", "turn_rate"), [(0.5, -0.25), (-0.5, 0.25), (0.5, 0.3), (0.5, 0.0)])
    def test_leaving_it_along_the_tangent(self, system, place, tangent, speed, turn_rate):
        verdict = self.verdict(system, place, speed * np.array(tangent), turn_rate)
        assert (verdict.dimension, verdict.ranks, verdict.decided) == (6, (2, 4, 6), True)

    def test_leaving_it_along_the_radius(self, system, place, tangent):
        verdict = self.verdict(system, place, (0.5 * tangent[1], -0.5 * tangent[0]), 0.3)
        assert (verdict.dimension, verdict.ranks, verdict.decided) == (6, (2, 5, 6), True)

    def test_turning_on_the_spot(self, system, place, tangent):
        # with no velocity, derivatives of order 2 and 3 still turn with the vehicle and tell its velocity, 0
        verdict = self.verdict(system, place, (0.0, 0.0), 0.5)
        assert (verdict.dimension, verdict.decided, verdict.stopped_by) == (5, True, "criterion")
        assert hides(verdict, sliding(verdict.at))
        assert verdict.observable_states[-3:] == INPUTS

    def test_at_rest(self, system, place, tangent):
        # derivatives of order k are homogeneous of degree k in the inputs: with all of them 0, none but the first has a gradient
        verdict = self.verdict(system, place, (0.0, 0.0), 0.0)
        assert (verdict.dimension, verdict.decided, verdict.ranks) == (4, True, (2, 4))
        along_the_circle = (0, 0, 0, 2 * tangent[0], 2 * tangent[1], 0.5)
        assert hides(verdict, sliding(verdict.at), along_the_circle)


@pytest.mark.parametrize("inputs", [(0.5, 0.0, 0.1), (0.0, 0.0, 0.0)])
def test_three_landmarks_off_the_circle(inputs):
    verdict = od.observability(three_landmarks(CIRCLE), at=(0.3, 0.4, 0.2, *inputs), disturbance=CONSTANT)
    assert (verdict.dimension, verdict.ranks, verdict.decided) == (6, (3, 6), True)


def test_landmarks_of_seven_digits_are_nearly_singular():
    height = 1.7320508
    verdict = od.observability(three_landmarks(((2, 0), (-1, height), (-1, -height))), at=(0, 2, 0, -0.5, 0, 0.25), disturbance=CONSTANT)
    assert (verdict.dimension, verdict.decided) == (6, True)
    assert "nearly singular" in verdict.proof
    apart = od.observability(three_landmarks(((2, 0), (-1, 1.5), (-1, -1.5))), at=(0, 2, 0, -0.5, 0, 0.25), disturbance=CONSTANT)
    assert "nearly singular" not in apart.proof


# ---------------------------------------------------------------- unknown is not polynomial; doubles decide wrongly

HIV_STATES = ("TU", "TI", "V", "lam", "rho", "N", "del", "c")


@pytest.mark.parametrize("options", [{}, {"at": HIV_POINT}, {"method": "jets"}])
def test_hiv_with_an_arbitrary_infection_rate(options):
    verdict = od.observability(hiv(True), **options)
    assert (verdict.dimension, verdict.observable_states) == (7, ("V", "lam", "rho", "c"))
    assert verdict.disturbance == "arbitrary"
    assert verdict.decided == ("method" not in options)
    assert options or verdict.stopped_by == "criterion"


@pytest.mark.parametrize("degree", [0, 1, 2, 3, 5])
def test_hiv_with_a_polynomial_infection_rate_is_observable(degree):
    verdict = od.observability(hiv(True), disturbance=od.Polynomial(degree))
    inputs = ("eta", "eta'", "eta''", "eta'''", "eta^(4)", "eta^(5)")[: degree + 1]
    assert (verdict.dimension, verdict.observable, verdict.decided, verdict.stopped_by) == (9 + degree, True, True, "full")
    assert verdict.observable_states == (*HIV_STATES, *inputs)
    assert verdict.disturbance == f"polynomial of degree {degree}"
    assert verdict.proof.endswith("adds 1 for 1 unknown input: the induction step holds")


def test_toggle_switch():
    arbitrary = od.observability(toggle_switch())
    assert (arbitrary.dimension, arbitrary.decided, arbitrary.stopped_by) == (4, True, "criterion")
    assert arbitrary.observable_states == ("x1", "x2")
    for degree in (0, 1):
        verdict = od.observability(toggle_switch(), disturbance=od.Polynomial(degree))
        assert (verdict.dimension, verdict.observable, verdict.decided) == (12 + 2 * degree, True, True)
        assert verdict.observable_states[10:] == ("w1", "w2", "w1'", "w2'")[: 2 + 2 * degree]
        assert "adds 2 for 2 unknown inputs: the induction step holds" in verdict.proof


def lie_rows(system, at):
    """The gradients of h, L_f h, ..., L_f^(n-1) h in double precision."""
    model = system.model
    words = [model.h]
    for _ in system.names[1:]:
        words.append(lie_derivative(words[-1], model.x, model.drift))
    return np.array(ca.Function("rows", [model.x], [ca.jacobian(ca.vertcat(*words), model.x)])(at))


def test_doubles_find_three_dimensions_where_there_are_eight():
    verdict = od.observability(hiv(False), at=HIV_POINT)
    assert (verdict.dimension, verdict.decided) == (8, True)
    assert np.linalg.matrix_rank(lie_rows(hiv(False), HIV_POINT)) == 3


def drifting(varying):
    """x2' = x3 + s w with w seen: while w is constant, x3 and s act alike."""
    x = ca.vertcat(*(ca.SX.sym(name) for name in ("x1", "x2", "x3", "s")))
    unknown = {"w": ca.vertcat(1, x[3] if varying else 0, 0, 0)}
    return od.ControlAffineSystem(x, ("x1", "x2", "x3", "s"), ca.vertcat(0, x[2], 0, 0), {}, unknown, {"y1": x[0], "y2": x[1]})


def test_a_disturbance_of_low_degree_can_hide_what_an_arbitrary_one_shows():
    arbitrary = od.observability(drifting(True))
    assert (arbitrary.dimension, arbitrary.observable, arbitrary.decided) == (4, True, True)
    constant = od.observability(drifting(True), disturbance=CONSTANT)
    assert (constant.dimension, constant.decided, constant.observable_states) == (4, True, ("x1", "x2", "w"))
    assert constant.proof.endswith("adds 2 for 1 unknown input: the induction step does not hold")
    assert od.observability(drifting(True), disturbance=od.Polynomial(1)).observable


def test_without_unknown_inputs_their_class_does_not_matter():
    verdict = od.observability(hiv(False), disturbance=od.Polynomial(3))
    assert (verdict.dimension, verdict.disturbance, len(verdict.at)) == (8, "none", 8)


# ---------------------------------------------------------------- random polynomial systems


@dataclass(frozen=True)
class Exact:
    """A control-affine system in exact polynomials of x0, x1, ...: fields of n entries each, and outputs."""

    drift: tuple
    known: tuple
    unknown: tuple
    outputs: tuple

    @property
    def n(self):
        return len(self.drift)

    @property
    def ring(self):
        return ring(f"x{i}" for i in range(self.n))

    def system(self):
        x = ca.vertcat(*(ca.SX.sym(f"x{i}") for i in range(self.n)))

        def column(field):
            return ca.vertcat(*(as_casadi(x, entry) for entry in field))

        return od.ControlAffineSystem(
            state=x,
            names=tuple(f"x{i}" for i in range(self.n)),
            drift=column(self.drift),
            known={f"u{i}": column(field) for i, field in enumerate(self.known)},
            unknown={f"w{i}": column(field) for i, field in enumerate(self.unknown)},
            outputs={f"y{i}": as_casadi(x, output) for i, output in enumerate(self.outputs)},
        )

    def moved(self, i, shift):
        """The same system in z, x_i = z_i + shift(z), x_j = z_j for all others; shift free of z_i."""
        images = list(self.ring.gens())
        images[i] = images[i] + shift

        def composed(entry):
            return entry.compose(*images, ctx=self.ring)

        def field_of(field):
            entries = [composed(entry) for entry in field]
            entries[i] = entries[i] - along(shift, entries)
            return tuple(entries)

        return Exact(
            field_of(self.drift),
            tuple(field_of(field) for field in self.known),
            tuple(field_of(field) for field in self.unknown),
            tuple(composed(output) for output in self.outputs),
        )


def ring(names):
    return flint.fmpq_mpoly_ctx.get(list(names), "lex")


def along(function, field):
    """The Lie derivative of a polynomial along a field."""
    return sum((function.derivative(i) * entry for i, entry in enumerate(field)), function.context().constant(0))


def combined(first, second, factor):
    """first + factor second, fields both."""
    return tuple(a + factor * b for a, b in zip(first, second, strict=True))


def as_casadi(x, polynomial):
    total = ca.SX(0)
    for powers, factor in polynomial.to_dict().items():
        term = ca.SX(int(factor))
        for i, power in enumerate(powers):
            for _ in range(power):
                term = term * x[i]
        total = total + term
    return total


def polynomials(context, variables, most=2, least=0):
    """Up to two terms c x_i x_j ... of the variables, of degree `least` to `most`, small whole c."""
    factors = st.lists(st.sampled_from(variables), min_size=least, max_size=most)
    term = st.tuples(st.sampled_from([-3, -2, -1, 1, 2, 3]), factors)

    def total(terms):
        value = context.constant(0)
        for factor, indices in terms:
            product = context.constant(factor)
            for i in indices:
                product = product * context.gen(i)
            value = value + product
        return value

    return st.lists(term, max_size=2).map(total)


@st.composite
def systems(draw, sizes=(3, 5), known=2, unknown=2, mixed=True):
    """Systems of degree 2, some with a state that no other state and no output depends on, hidden behind a change of the state."""
    n = draw(st.integers(*sizes))
    context = ring(f"x{i}" for i in range(n))
    everything = range(n)
    visible = range(n - 1) if draw(st.booleans()) else everything
    fields = st.tuples(*(polynomials(context, visible if i in visible else everything) for i in everything))
    none = (context.constant(0),) * n
    exact = Exact(
        draw(st.one_of(fields, st.just(none))),
        tuple(draw(st.lists(fields, max_size=known))),
        tuple(draw(st.lists(fields, min_size=1, max_size=unknown))),
        tuple(draw(st.lists(polynomials(context, visible, least=1).filter(bool), min_size=1, max_size=2))),
    )
    return draw(in_other_coordinates(exact)) if mixed else exact


@st.composite
def in_other_coordinates(draw, exact, least=0):
    """The system after some steps x_i = z_i + c z_j, and perhaps one x_i = z_i + c z_j z_k: invertible, and polynomial so."""
    for step in range(draw(st.integers(least, 3))):
        i = draw(st.integers(0, exact.n - 1))
        others = [j for j in range(exact.n) if j != i]
        shift = exact.ring.constant(draw(st.sampled_from([-2, -1, 1, 2])))
        for _ in range(draw(st.integers(1, 2)) if step == 0 else 1):
            shift = shift * exact.ring.gen(draw(st.sampled_from(others)))
        exact = exact.moved(i, shift)
    return exact


def for_all(strategy, examples):
    """Run the check below on so many examples."""
    return lambda check: settings(max_examples=examples, deadline=None)(given(strategy)(check))()


def examples(count):
    """So many in every run, 20 times as many in a slow one."""
    return pytest.mark.parametrize("count", [count, pytest.param(20 * count, marks=pytest.mark.slow)])


@pytest.mark.parametrize(("count", "largest"), [(12, 4), pytest.param(150, 5, marks=pytest.mark.slow)])
def test_recursion_and_jets_agree(count, largest):
    @for_all(systems(sizes=(3, largest)), count)
    def agree_on(exact):
        system = exact.system()
        verdict, jets = od.observability(system), od.observability(system, method="jets")
        if jets.dimension < verdict.dimension:  # a lower bound, which has stood still for n orders: it is followed further
            jets = od.observability(system, method="jets", orders=3 * exact.n + 3)
        assert jets.dimension >= verdict.dimension
        if verdict.decided:
            assert jets.dimension == verdict.dimension
            assert jets.observable_states == verdict.observable_states


def agree(first, second):
    """Whether two verdicts on the same space may both be right."""
    if first.decided and second.decided:
        return first.dimension == second.dimension
    least, most = sorted([first, second], key=lambda verdict: verdict.decided)
    return least.dimension <= most.dimension or not most.decided


@st.composite
def changes_of_state(draw):
    exact = draw(systems(sizes=(3, 3), known=1, mixed=False))
    return exact.system(), draw(in_other_coordinates(exact, least=1)).system(), "any"


@st.composite
def changes_of_outputs(draw):
    system = draw(systems(sizes=(3, 3), known=1)).system()
    (name, first), *others = system.outputs.items()
    total = first + sum(draw(st.sampled_from([-2, 1, 3])) * other for _, other in others)
    function = draw(st.sampled_from([ca.exp, lambda y: 2 * y - 1, lambda y: y / 7 + 3]))
    return system, replace(system, outputs={**dict(others), name: function(total)}), "any"


@st.composite
def changes_of_known_inputs(draw):
    exact = draw(systems(sizes=(2, 3), known=2, unknown=1).filter(lambda exact: exact.known))
    factor = draw(st.sampled_from([-2, 1, 3]))
    first, *others = exact.known
    drift = combined(exact.drift, first, factor)
    turned = [combined(other, first, draw(st.sampled_from([-1, 0, 2]))) for other in others]
    return exact.system(), replace(exact, drift=drift, known=(*turned, tuple(factor * entry for entry in first))).system(), "any"


def regular(draw, exact, *, constant):
    """The unknown fields in another basis: combined with factors that are constants or functions of the state, none vanishing."""
    n, first = exact.n, exact.unknown[0]
    number = exact.ring.constant
    square = exact.ring.gen(draw(st.integers(0, n - 1)))
    scale = number(draw(st.sampled_from([-2, 1, 3]))) if constant else 1 + square * square
    added = number(draw(st.sampled_from([-1, 1, 2]))) if constant else exact.ring.gen(draw(st.integers(0, n - 1)))
    others = [combined(field, first, added) for field in exact.unknown[1:]]
    return (*others, tuple(scale * entry for entry in first)), added


@st.composite
def constant_changes_of_unknown_inputs(draw):
    exact = draw(systems(sizes=(3, 3), known=1))
    fields, factor = regular(draw, exact, constant=True)
    drift = combined(exact.drift, exact.unknown[0], factor)  # w counted from another value
    return exact.system(), replace(exact, drift=drift, unknown=fields).system(), "any"


@st.composite
def changes_of_unknown_inputs_with_the_state(draw):
    # w = a(x) + C(x) w~ is as arbitrary as w~; with several known inputs under one w it would not be the same w
    exact = draw(systems(sizes=(3, 4), known=0))
    fields, factor = regular(draw, exact, constant=False)
    drift = combined(exact.drift, exact.unknown[-1], factor)
    return exact.system(), replace(exact, drift=drift, unknown=fields).system(), "any"


@st.composite
def changes_of_unknown_inputs_that_react(draw):
    # w = a(x) + b(x) u + C(x) w~ under one smooth known input
    exact = draw(systems(sizes=(3, 4), known=1))
    fields, factor = regular(draw, exact, constant=False)
    drift = combined(exact.drift, exact.unknown[-1], factor)
    known = tuple(combined(field, exact.unknown[0], exact.ring.gen(i)) for i, field in enumerate(exact.known))
    return exact.system(), replace(exact, drift=drift, known=known, unknown=fields).system(), "smooth"


CHANGES = {
    "state": changes_of_state(),
    "outputs": changes_of_outputs(),
    "known inputs": changes_of_known_inputs(),
    "unknown inputs, constant": constant_changes_of_unknown_inputs(),
    "unknown inputs, with the state": changes_of_unknown_inputs_with_the_state(),
    "unknown inputs that react to the known": changes_of_unknown_inputs_that_react(),
}


@examples(6)
@pytest.mark.parametrize("what", CHANGES)
def test_dimension_does_not_depend_on_the_form(what, count):
    @for_all(CHANGES[what], count)
    def is_unchanged(change):
        first, second, known_inputs = change
        assert agree(od.observability(first, known_inputs=known_inputs), od.observability(second, known_inputs=known_inputs))


@examples(6)
def test_who_knows_less_never_sees_more(count):
    @for_all(systems(sizes=(3, 4), known=1), count)
    def is_ordered(exact):
        everything = replace(exact, known=(*exact.known, *exact.unknown), unknown=())
        smooth = od.observability(exact.system(), known_inputs="smooth")
        verdict = od.observability(exact.system())
        known = od.observability(everything.system())
        assert smooth.decided
        assert known.decided
        assert verdict.dimension <= known.dimension
        assert set(smooth.observable_states) <= set(known.observable_states)
        if verdict.decided:
            assert smooth.dimension <= verdict.dimension
            assert set(smooth.observable_states) <= set(verdict.observable_states) <= set(known.observable_states)
            assert exact.known or smooth.dimension == verdict.dimension


def seen_by_words(exact, at, order, seed):
    """What Lie words up to the order tell about x, in exact arithmetic at the state and a random jet (w, w', ...): rows (r, n).

    No word is dropped, no function rescaled: x and the jet are the state, and what has a part in the jet is eliminated.
    """
    n, p = exact.n, len(exact.unknown)
    jets = p * order
    context = ring([*(f"w{k}" for k in range(jets)), *(f"x{i}" for i in range(n))])
    w, x, zero = context.gens()[:jets], context.gens()[jets:], context.constant(0)

    def lifted(entries):
        return [entry.compose(*x, ctx=context) for entry in entries]

    rate = lifted(exact.drift)
    for symbol, field in zip(w, exact.unknown, strict=False):
        rate = combined(rate, lifted(field), symbol)
    fields = [(*w[p:], *[zero] * min(p, jets), *rate), *((*[zero] * jets, *lifted(field)) for field in exact.known)]
    words = layer = lifted(exact.outputs)
    for _ in range(order):
        layer = [word for word in (along(s, field) for s, field in product(layer, fields)) if word.total_degree() > 0]
        words = words + layer
    generator = np.random.default_rng(seed)
    jet = [flint.fmpq(int(a), int(b)) for a, b in generator.integers(5, 40, (jets, 2))]
    point = [*jet, *(flint.fmpq(value.numerator, value.denominator) for value in map(Fraction, map(float, at)))]
    reduced, rank = flint.fmpq_mat([[word.derivative(i)(*point) for i in range(jets + n)] for word in words]).rref()
    rows = [[reduced[i, j] for j in range(jets + n)] for i in range(rank)]
    return [row[jets:] for row in rows if not any(row[:jets])]


def normalised(rows):
    values = np.array([[float(Fraction(int(entry.p), int(entry.q))) for entry in row] for row in rows])
    return values / np.abs(values).max(axis=1, keepdims=True)


def order_that_shows(exact, at, verdict, limit):
    """An order of words that shows as much as the verdict, or the limit."""
    steps = len(verdict.ranks) - 1
    return next(k for k in range(steps, limit + 1) if k == limit or len(seen_by_words(exact, at, k, seed=1)) >= verdict.dimension)


@examples(12)
def test_exact_words_see_as_much_and_never_change_along_null_vectors(count):
    @for_all(systems(sizes=(2, 3), known=1), count)
    def words_agree(exact):
        verdict = od.observability(exact.system())
        order = order_that_shows(exact, verdict.at, verdict, 2 * exact.n + 2)
        rows, others = (seen_by_words(exact, verdict.at, order + 1, seed) for seed in (1, 2))
        assert len(rows) >= verdict.dimension
        if not verdict.decided:
            return
        assert len(rows) == verdict.dimension
        basis = verdict.null_space
        assert np.allclose(basis.T @ basis, np.eye(exact.n - verdict.dimension), atol=1e-13)
        if rows and flint.fmpq_mat(rows + others).rank() == len(rows):  # else what is seen depends on the unknown inputs
            assert np.abs(normalised(rows) @ basis).max(initial=0) < 1e-9


@examples(8)
def test_exact_words_see_as_much_at_singular_points(count):
    @for_all(st.tuples(systems(sizes=(2, 3), known=1), st.lists(st.sampled_from([0, 0, 1, -1, 2]), min_size=3, max_size=3)), count)
    def words_agree(drawn):
        exact, entries = drawn
        at = entries[: exact.n]
        verdict = od.observability(exact.system(), at=at)
        order = order_that_shows(exact, at, verdict, max(2 * exact.n + 1, len(verdict.ranks)))
        rows = seen_by_words(exact, at, order + 1, seed=1)
        assert len(rows) == verdict.dimension if verdict.decided else len(rows) >= verdict.dimension


@examples(6)
def test_what_an_arbitrary_disturbance_shows_a_polynomial_one_of_enough_degree_shows_too(count):
    # derivatives of order k contain w, ..., w^(k-1): any such jet belongs to a polynomial of degree k - 1
    @for_all(systems(sizes=(2, 3), known=1), count)
    def is_shown(exact):
        arbitrary = od.observability(exact.system(), method="jets")
        polynomial = od.observability(exact.system(), disturbance=od.Polynomial(max(len(arbitrary.ranks) - 2, 0)))
        assert polynomial.decided
        assert set(arbitrary.observable_states) <= set(polynomial.observable_states)
        hidden_in_x = np.linalg.svd(polynomial.null_space[: exact.n], compute_uv=False)
        assert np.sum(hidden_in_x > 1e-9) <= exact.n - arbitrary.dimension


# ---------------------------------------------------------------- points with polynomial disturbances, bad input


def test_a_point_without_input_states_draws_these():
    system = three_landmarks(CIRCLE)
    short = od.observability(system, at=(0.3, 0.4, 0.2), disturbance=od.Polynomial(1))
    assert (short.dimension, len(short.at)) == (9, 9)
    assert np.allclose(short.at[:3], (0.3, 0.4, 0.2), atol=1e-15)
    assert short.at[3:].all()
    long = od.observability(system, at=short.at, disturbance=od.Polynomial(1))
    assert (long.dimension, long.observable_states) == (short.dimension, short.observable_states)


@pytest.mark.parametrize("length", [0, 1, 2, 4, 5, 7, 9])
def test_a_point_of_another_length_is_refused(length):
    # n = 3 and n + p (degree + 1) = 6 are accepted
    with pytest.raises(od.InputError, match=rf"at has shape \({length},\): must be \(6,\) for x, z, theta, d_f, d_h, d_omega"):
        od.observability(three_landmarks(CIRCLE), at=[0.1] * length, disturbance=CONSTANT)


@pytest.mark.parametrize("degree", [-1, 1.5, True, "2", None])
def test_a_degree_that_is_no_count_is_refused(degree):
    with pytest.raises(od.InputError, match=r"degree is .*: must be a whole number of at least 0"):
        od.Polynomial(degree)


def test_an_unknown_name_among_the_unknown_inputs_is_refused():
    with pytest.raises(od.InputError, match=r"has no 'sped'; did you mean 'speed'\?"):
        _ = od.System(od.Unicycle(), sensors=(od.GPS(sigma=1.0),), unknown_inputs=("sped",)).model


@pytest.mark.parametrize("group", ["known", "unknown"])
def test_an_input_in_an_output_is_refused(group):
    x, w = ca.SX.sym("x", 2), ca.SX.sym("w")
    with pytest.raises(od.InputError, match=r"y.* contains the .*w.*only the state may appear"):
        od.ControlAffineSystem(x, ("a", "b"), None, outputs={"y": x[0] + w}, **{group: {"w": ca.vertcat(1, 0)}})


@pytest.mark.parametrize("disturbance", ["arbitrary", CONSTANT])
def test_a_landmark_on_the_vehicle_is_refused(disturbance):
    with pytest.raises(od.InputError, match=r"output 'bearing_0' at x = 2, z = 0, theta = 0.* has no finite smooth value"):
        od.observability(three_landmarks(CIRCLE), at=(2.0, 0.0, 0.0), disturbance=disturbance)


@pytest.mark.parametrize("method", ["recursion", "jets"])
def test_a_logarithm_of_a_negative_state_is_refused(method):
    x = ca.SX.sym("x", 2)
    system = od.ControlAffineSystem(x, ("a", "b"), None, {}, {"w": ca.vertcat(1, x[0])}, {"y": ca.log(x[0]) + x[1]})
    with pytest.raises(od.InputError, match=r"output 'y' at a = -1, b = 0\.5 has no finite smooth value"):
        od.observability(system, at=(-1.0, 0.5), method=method)
    assert od.observability(system, at=(1.0, 0.5), method=method).dimension == 1


def test_a_pole_of_the_unknown_field_at_the_point_is_refused():
    with pytest.raises(od.InputError, match=r"the rate of phi at r = 0, phi = 0.3, theta = 0.9 has no finite smooth value"):
        od.observability(polar_unicycle("range", ("omega",)), at=(0.0, 0.3, 0.9))


@pytest.mark.parametrize("disturbance", [0, "polynomial", None, od.Polynomial])
def test_another_class_of_disturbances_is_refused(disturbance):
    with pytest.raises(od.InputError, match=r"disturbance is .*: must be one of 'arbitrary' or a Polynomial"):
        od.observability(switched(), disturbance=disturbance)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("known_inputs", ["any", "smooth"])
@pytest.mark.parametrize(("sign", "right"), [(1, 2), (-1, 3)])
def test_a_root_of_a_square_has_the_sign_that_it_has(sign, right, known_inputs, seed):
    """((1 + c^2)^2)^(1/2) is 1 + c^2, modulo a prime 1 + c^2 or -1 - c^2: with sign +1 w enters b' and hides c; with -1 nothing enters.

    What is not decided is no more than that.
    """
    x = ca.SX.sym("x", 4)
    a, b, c, _ = ca.vertsplit(x)
    field = ca.sqrt(c**4 + 2 * c * c + 1) + sign * (c * c + 1)
    system = od.ControlAffineSystem(
        state=x,
        names=("a", "b", "c", "d"),
        drift=ca.vertcat(b, c, 0, 0),
        known={"u": ca.vertcat(0, b, 0, 0)},
        unknown={"w": ca.vertcat(0, field, 0, 0)},
        outputs={"y": a},
    )
    verdict = od.observability(system, seed=seed, known_inputs=known_inputs)
    assert verdict.dimension == right if verdict.decided else verdict.dimension <= right


_ZEROS = {
    "power": lambda c: (c * c + 1) ** c - ca.exp(c * ca.log(c * c + 1)),
    "logarithms": lambda c: ca.log((c * c + 1) * (c * c + 3)) - ca.log(c * c + 1) - ca.log(c * c + 3),
    "asinh": lambda c: ca.asinh(c) - ca.log(c + ca.sqrt(c * c + 1)),
    "erfinv": lambda c: ca.erfinv(ca.erf(c)) - c,
}


@pytest.mark.parametrize("zero", _ZEROS)
@pytest.mark.parametrize(("more", "right"), [(0, 3), (1, 2)])
def test_a_field_that_vanishes_by_a_relation_that_is_not_known(zero, more, right):
    """A' = b, b' = c + b u + field w: where the field is 0 y'' shows c; where it is 1 + c^2, w hides c. Less is said, never more."""
    x = ca.SX.sym("x", 4)
    a, b, c, _ = ca.vertsplit(x)
    system = od.ControlAffineSystem(
        state=x,
        names=("a", "b", "c", "d"),
        drift=ca.vertcat(b, c, 0, 0),
        known={"u": ca.vertcat(0, b, 0, 0)},
        unknown={"w": ca.vertcat(0, _ZEROS[zero](c) + more * (1 + c * c), 0, 0)},
        outputs={"y": a},
    )
    verdict = od.observability(system)
    assert verdict.dimension == right if verdict.decided else verdict.dimension <= right
