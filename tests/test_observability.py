"""Verdicts with known inputs: published tables, singular points, linear algebra done a second way, invariance, words."""

import itertools
from fractions import Fraction

import casadi as ca
import flint
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from obsdesign.analysis.query import observability, observability_of
from obsdesign.analysis.verdict import UnobservableError
from obsdesign.calculus import lie_derivative
from obsdesign.dynamics.control_affine import ControlAffineSystem
from obsdesign.dynamics.system import System
from obsdesign.errors import InputError
from obsdesign.sensors.bearing import Bearing
from obsdesign.sensors.gps import GPS
from obsdesign.sensors.magnetometer import Magnetometer
from obsdesign.sensors.range import Range
from obsdesign.vehicles.dubins import Dubins
from obsdesign.vehicles.unicycle import Unicycle

BEACON = (500.0, 200.0)
SPEED = 20.0
SENSORS = (GPS(sigma=2.0), Magnetometer(sigma=0.21), Range(beacon=BEACON, sigma=1.0), Bearing(beacon=BEACON, sigma=0.087))
UNICYCLE = System(Unicycle(wind="constant"), sensors=SENSORS)
DUBINS = System(Dubins(speed=SPEED, wind="constant"), sensors=SENSORS)
STRAIGHT = {"turn_rate": 0.0}
POINT = (100.0, -300.0, 0.7, 3.0, -2.0)

# Brace and Morgansen, recomputed exactly: dimensions for Sigma_U, Sigma_D turning, Sigma_D straight
BRACE = {
    **{"g": (5, 5, 4), "m": (1, 1, 1), "r": (4, 4, 3), "b": (4, 4, 3), "gm": (5, 5, 5), "gr": (5, 5, 4), "gb": (5, 5, 5)},
    **{"mr": (5, 5, 4), "mb": (5, 5, 4), "rb": (4, 4, 4), "gmr": (5, 5, 5), "gmb": (5, 5, 5), "grb": (5, 5, 5), "mrb": (5, 5, 5)},
    "gmrb": (5, 5, 5),
}
LETTERS = dict(zip("gmrb", ("gps", "magnetometer", "range", "bearing"), strict=True))


def model_with(system, letters):
    return system.model.only([LETTERS[letter] for letter in letters])


def states(count, prefix="x"):
    return ca.vertcat(*(ca.SX.sym(f"{prefix}{i}") for i in range(count)))


def affine(x, outputs, drift=None, known=None):
    """A control-affine system whose states are x0, x1, ... and whose outputs and inputs carry numbers."""
    return ControlAffineSystem(
        state=x,
        names=tuple(f"x{i}" for i in range(x.numel())),
        drift=drift,
        known={f"u{i}": field for i, field in enumerate(known or [])},
        outputs={f"y{i}": output for i, output in enumerate(outputs)},
    )


def span_projector(basis):
    return basis @ basis.T


# ---------------------------------------------------------------- published results


def test_the_table_is_complete():
    assert len(BRACE) == 15


@pytest.mark.parametrize("letters", BRACE)
@pytest.mark.parametrize("at", [None, POINT], ids=["generic", "at a point"])
def test_brace_table(letters, at):
    unicycle, dubins = model_with(UNICYCLE, letters), model_with(DUBINS, letters)
    verdicts = [observability_of(unicycle, at), observability_of(dubins, at), observability_of(dubins, at, STRAIGHT)]
    assert tuple(verdict.dimension for verdict in verdicts) == BRACE[letters]
    for verdict in verdicts:
        assert verdict.decided
        assert verdict.observable == (verdict.dimension == 5)
        assert verdict.ranks[-1] == verdict.dimension
        assert all(np.diff(verdict.ranks) >= 0)
        assert len(verdict.ranks) == 1 or verdict.ranks[-1] > verdict.ranks[-2]
        assert verdict.null_space.shape == (5, 5 - verdict.dimension)
        assert set(verdict.observable_states) | set(verdict.unobservable_states) == set(unicycle.state_names)


def test_ranks_per_step():
    assert observability_of(model_with(DUBINS, "g")).ranks == (2, 4, 5)
    assert observability_of(model_with(DUBINS, "g"), held=STRAIGHT).ranks == (2, 4)


def test_gps_on_a_straight_line_hides_heading_against_wind():
    verdict = observability_of(model_with(DUBINS, "g"), at=POINT, held=STRAIGHT)
    theta = POINT[2]
    expected = np.array([0, 0, 1, SPEED * np.sin(theta), -SPEED * np.cos(theta)])  # Brace eq. 8, its alpha_5 with the sign put right
    expected /= np.linalg.norm(expected)
    assert abs(verdict.null_space[:, 0] @ expected) == pytest.approx(1, abs=1e-14)
    assert verdict.observable_states == ("x", "y")
    assert verdict.unobservable_states == ("heading", "wind_x", "wind_y")
    assert not verdict.null_space[:2].any()


def rotation(at):
    x, y, _, wind_x, wind_y = at
    return np.array([-(y - BEACON[1]), x - BEACON[0], 1, -wind_y, wind_x])


@pytest.mark.parametrize("letters", ["r", "b", "rb"])
@pytest.mark.parametrize("system", [UNICYCLE, DUBINS])
def test_one_beacon_hides_the_rotation_about_it(system, letters):
    verdict = observability_of(model_with(system, letters), at=POINT)
    direction = rotation(POINT) / np.linalg.norm(rotation(POINT))
    assert abs(verdict.null_space[:, 0] @ direction) == pytest.approx(1, abs=1e-13)
    assert verdict.observable_states == ()
    assert verdict.hidden == "rotation of everything about the beacon at (500, 200) m: x, y, heading, wind_x, wind_y turn together"


HIV_NAMES = ("TU", "TI", "V", "lam", "rho", "N", "del", "c")
HIV_POINT = (600.0, 30.0, 100000.0, 36.0, 0.108, 1000.0, 0.5, 3.0)


def hiv():
    x = ca.vertcat(*(ca.SX.sym(name) for name in HIV_NAMES))
    TU, TI, V, lam, rho, N, delta, c = ca.vertsplit(x)
    drift = ca.vertcat(lam - rho * TU - TU * V, TU * V - delta * TI, N * delta * TI - c * V, ca.SX.zeros(5))
    return ControlAffineSystem(state=x, names=HIV_NAMES, drift=drift, outputs={"virus": V, "cells": TU + TI})


def test_hiv_with_known_rate_is_observable_where_doubles_say_otherwise():
    # HIV at published parameter values, rank 8 recomputed exactly
    system = hiv()
    verdict = observability(system, at=HIV_POINT)
    assert (verdict.dimension, verdict.decided) == (8, True)
    model = system.model
    words = [model.h]
    for _ in range(7):
        words.append(lie_derivative(words[-1], model.x, model.drift))
    rows = ca.Function("rows", [model.x], [ca.jacobian(ca.vertcat(*words), model.x)])(HIV_POINT)
    assert np.linalg.matrix_rank(np.array(rows)) < 8


# ---------------------------------------------------------------- singular points


@pytest.mark.parametrize(("power", "order"), [(2, 1), (3, 2), (6, 5)])
def test_singular_point_is_seen_through_a_higher_derivative(power, order):
    x = states(1)
    system = affine(x, [x**power], drift=ca.SX([1.0]))
    generic, there = observability(system), observability(system, at=[0.0])
    assert (generic.dimension, generic.ranks) == (1, (1,))
    assert (there.dimension, there.observable, there.decided) == (1, True, True)
    assert there.ranks == (0,) * order + (1,)


def test_an_equilibrium_sees_less_than_its_surroundings_and_that_is_decided():
    # x' = x, y = x^2 at the equilibrium: every Lie derivative is a multiple of x^2
    x = states(1)
    verdict = observability(affine(x, [x**2], drift=x), at=[0.0])
    assert (verdict.dimension, verdict.observable, verdict.decided, verdict.stopped_by) == (0, False, True, "criterion")
    assert verdict.generic is not None
    assert verdict.generic.dimension == 1


def test_what_a_derivative_beyond_those_taken_would_show_is_shown_on_the_way():
    # x' = 1, y = x^60 at 0: derivative 60 tells, more than are taken; so does y' at any state that is reached
    x = states(1)
    verdict = observability(affine(x, [x**60], drift=ca.SX([1.0])), at=[0.0])
    assert (verdict.dimension, verdict.observable, verdict.decided, verdict.stopped_by) == (1, True, True, "full")
    assert "on the way" in verdict.proof


def test_a_stall_at_the_point_alone_is_undecided():
    # from (0, 0, 1, 1) a = t and b = t^2: (b - a^2) c is 0 for ever and shows no change of c. Off the parabola it does, and nobody
    # looks for parabolas: the smallest affine set that holds this one is the whole plane
    x = states(4)
    a, b, c, _ = ca.vertsplit(x)
    verdict = observability(affine(x, [a, b, (b - a**2) * c], drift=ca.vertcat(1, 2 * a, 0, 0)), at=[0.0, 0.0, 1.0, 1.0])
    assert (verdict.dimension, verdict.decided, verdict.stopped_by) == (2, False, "stalled")
    assert verdict.hidden.startswith("not decided")
    assert "at most 3" in verdict.proof


def test_at_the_precision_limit_only_the_lower_bound_is_claimed():
    # exp(exp(20)) has 700 million bits before the point: its sine is any number in [-1, 1]
    x = states(2)
    verdict = observability(affine(x, [x[0], x[1] * ca.sin(ca.exp(ca.exp(x[0])))]), at=[20.0, 1.0])
    assert (verdict.dimension, verdict.observable, verdict.decided, verdict.stopped_by) == (1, False, False, "precision")
    assert "bits do not tell the rest from 0, and at most 2 modulo" in verdict.proof


def test_a_finite_list_of_words_is_decided_at_a_singular_point():
    x = states(1)
    verdict = observability(affine(x, [x**2]), at=[0.0])
    assert (verdict.dimension, verdict.decided, verdict.stopped_by) == (0, True, "criterion")
    assert verdict.hidden == "x0 is not seen at all (to first order, at x0 = 0)"  # x^2 changes with x, but not at 0


def test_the_cap_is_the_generic_rank_nearby():
    x = states(2)
    verdict = observability(affine(x, [x[0] ** 2], drift=ca.SX([1.0, 0.0])), at=[0.0, 0.5])
    assert (verdict.dimension, verdict.decided, verdict.stopped_by, verdict.ranks) == (1, True, "cap", (0, 1))


@pytest.mark.parametrize(("at", "dimension"), [(-1.0, 0), (1.0, 1)])
def test_functions_in_pieces_are_judged_in_the_piece_asked_for(at, dimension):
    x = states(1)
    verdict = observability(affine(x, [ca.fmax(x, 0)], drift=x**2 + 1), at=[at])
    assert (verdict.dimension, verdict.decided) == (dimension, True)


def test_landmarks_of_seven_digits_are_nearly_singular():
    # x + y and x + (1 + 1e-9) y: told apart, and said how narrowly
    x = states(2)
    verdict = observability(affine(x, [x[0] + x[1], x[0] + 1.000000001 * x[1]]))
    assert verdict.observable
    assert "nearly singular" in verdict.proof


# ---------------------------------------------------------------- constants that CasADi would fold


def test_quotients_are_not_rounded():
    # d(x0 / 3 / 49) / dx0 is folded to the double 1 / 3 * (1 / 49), which is not the one next to 1 / 147
    assert 1 / 3 * (1 / 49) != 1 / 147
    x = states(2)
    drift = ca.vertcat(x[0] / 3 / 49, x[1] * (1 / 147))
    assert observability(affine(x, [x[0] + x[1]], drift=drift)).dimension == 1


def test_sums_are_not_rounded():
    # 3^33 + 1/4 is no double: rounded, the third state would grow like the others
    x = states(3)
    large = 3.0**33
    assert large + 0.25 == large
    drift = ca.vertcat(large * x[0], large * x[1], large * x[2] + x[2] / 4)
    assert observability(affine(x, [x[0] + x[1]], drift=drift)).dimension == 1
    assert observability(affine(x, [x[0] + x[1] + x[2]], drift=drift)).dimension == 2


def test_products_over_several_derivatives_are_not_rounded():
    # x0'' = 3^34 x0, which is no double, and x1'' = the double next to it times x1: told apart as they stand, but that double may
    # well stand for 3^34, and then they are one
    neighbour = float(3**34)
    assert int(neighbour) != 3**34
    x = states(3)
    tripled = x[0]
    for _ in range(17):
        tripled = 2 * tripled + tripled
    drift = ca.vertcat(tripled, x[2], neighbour * x[1])
    verdict = observability(affine(x, [x[0] + x[1]], drift=drift))
    assert (verdict.dimension, verdict.decided) == (2, False)
    assert "as they stand it is 3, within the rounding of the numbers given it may be 2 of 3" in verdict.proof


# ---------------------------------------------------------------- a second way: exact linear and polynomial algebra

entry = st.integers(-2, 2)


def matrices(rows, columns):
    return st.lists(st.lists(entry, min_size=columns, max_size=columns), min_size=rows, max_size=rows)


@st.composite
def linear_systems(draw):
    n, q = draw(st.integers(1, 6)), draw(st.integers(1, 2))
    A = draw(matrices(n, n))
    if draw(st.booleans()):  # a block that the outputs cannot see, behind a change of basis
        hidden = draw(st.integers(0, n - 1))
        A = [[0 if i < n - hidden <= j else value for j, value in enumerate(row)] for i, row in enumerate(A)]
    return A, draw(matrices(q, n).filter(lambda C: all(any(row) for row in C)))


def kalman_rank(A, C):
    block, blocks = flint.fmpz_mat(C), []
    for _ in A:
        blocks += block.tolist()
        block = block * flint.fmpz_mat(A)
    return flint.fmpz_mat(blocks).rank()


def linear(A, C):
    x = states(len(A))
    return affine(x, ca.vertsplit(ca.SX(ca.DM(C)) @ x), drift=ca.SX(ca.DM(A)) @ x)


@settings(max_examples=60, deadline=None)
@given(linear_systems())
def test_linear_systems_have_the_rank_of_kalman(matrices):
    A, C = matrices
    verdict = observability(linear(A, C))
    assert verdict.decided
    assert verdict.dimension == kalman_rank(A, C)


@settings(max_examples=25, deadline=None)
@given(linear_systems(), st.integers(0, 2**32 - 1))
def test_dimension_does_not_depend_on_the_coordinates(matrices, seed):
    A, C = matrices
    n = len(A)
    generator = np.random.default_rng(seed)
    T = np.eye(n, dtype=int)
    for _ in range(2 * n):
        i, j = generator.integers(0, n, 2)
        if i != j:
            T[i] += generator.integers(-2, 3) * T[j]
    x, z = states(n), states(n, "z")
    inverse = ca.SX(ca.DM(np.round(np.linalg.inv(T))))
    # a nonlinear system: A x plus a square, in x and in z with x = T z
    field = ca.SX(ca.DM(A)) @ x + 2 * ca.vertcat(x[n - 1] ** 2, ca.SX.zeros(n - 1))
    outputs = [output + x[0] ** 2 for output in ca.vertsplit(ca.SX(ca.DM(C)) @ x)]
    moved = ca.substitute([field, *outputs], [x], [ca.SX(ca.DM(T)) @ z])
    first = observability(affine(x, outputs, drift=field))
    second = observability(affine(z, moved[1:], drift=inverse @ moved[0]))
    assert first.decided
    assert second.decided
    assert first.dimension == second.dimension


@st.composite
def polynomial_systems(draw):
    n = draw(st.integers(2, 3))
    exponents = st.tuples(*[st.integers(0, 2)] * n).filter(lambda powers: sum(powers) <= 2)
    polynomial = st.dictionaries(exponents, st.sampled_from([-3, -1, 1, 2, Fraction(1, 3)]), min_size=1, max_size=2)
    fields = draw(st.lists(st.lists(polynomial, min_size=n, max_size=n), min_size=1, max_size=2))
    output = draw(polynomial.filter(lambda terms: any(sum(powers) for powers in terms)))
    return n, fields, output


def as_casadi(x, terms):
    total = ca.SX(0)
    for powers, factor in terms.items():
        term = ca.SX(float(factor))
        for i, power in enumerate(powers):
            term = term * x[i] ** power
        total = total + term
    return total


def exact_rank(n, fields, output):
    """All Lie derivatives up to order n - 1, nothing dropped, in exact polynomial arithmetic; rank at a random rational point."""
    context = flint.fmpq_mpoly_ctx.get([f"x{i}" for i in range(n)], "lex")

    def as_exact(terms):
        return context.from_dict({powers: flint.fmpq(Fraction(f).numerator, Fraction(f).denominator) for powers, f in terms.items()})

    words = layer = [as_exact(output)]
    vectors = [[as_exact(terms) for terms in field] for field in fields]
    for _ in range(n - 1):
        layer = [sum((s.derivative(i) * v[i] for i in range(n)), context.constant(0)) for s in layer for v in vectors]
        words = words + layer
    point = [flint.fmpq(101, 37), flint.fmpq(-57, 91), flint.fmpq(23, 71)][:n]
    return flint.fmpq_mat([[word.derivative(i)(*point) for i in range(n)] for word in words]).rank()


@settings(max_examples=60, deadline=None)
@given(polynomial_systems())
def test_polynomial_systems_have_the_rank_of_all_words(system):
    n, fields, output = system
    x = states(n)
    known = [ca.vertcat(*(as_casadi(x, terms) for terms in field)) for field in fields]
    verdict = observability(affine(x, [as_casadi(x, output)], drift=known[0], known=known[1:]))
    assert verdict.decided
    assert verdict.dimension == exact_rank(n, fields, output)


# ---------------------------------------------------------------- identities


@pytest.mark.parametrize("letters", [letters for letters, dimensions in BRACE.items() if min(dimensions) < 5])
def test_hidden_directions_change_no_derivative(letters):
    model = model_with(DUBINS, letters)
    verdict = observability_of(model, held=STRAIGHT)
    words = [model.h]
    for _ in range(4):
        words.append(lie_derivative(words[-1], model.x, model.drift))
    rows = np.array(ca.Function("rows", [model.x], [ca.jacobian(ca.vertcat(*words), model.x)])(verdict.at))
    assert np.abs(rows @ verdict.null_space).max() < 1e-12 * np.abs(rows).max()
    assert np.allclose(verdict.null_space.T @ verdict.null_space, np.eye(5 - verdict.dimension), atol=1e-13)


@pytest.mark.parametrize("letters", BRACE)
def test_more_sensors_and_more_freedom_never_see_less(letters):
    unicycle, turning, straight = BRACE[letters]
    assert unicycle >= turning >= straight
    for fewer in itertools.combinations(letters, len(letters) - 1):
        if fewer:
            lost = observability_of(model_with(DUBINS, fewer)).dimension
            assert lost <= observability_of(model_with(DUBINS, letters)).dimension


def test_null_space_does_not_depend_on_the_form_of_the_outputs():
    x = states(3)
    drift = ca.vertcat(x[1] * x[2], ca.sin(x[0]), 0)
    first = observability(affine(x, [x[0], x[1]], drift=drift), at=[0.3, 0.0, 0.7])
    second = observability(affine(x, [ca.exp(x[0] + x[1]), x[1] ** 3 - x[0]], drift=drift), at=[0.3, 0.0, 0.7])
    assert first.dimension == second.dimension
    assert np.allclose(span_projector(first.null_space), span_projector(second.null_space), atol=1e-13)


def test_the_same_seed_gives_the_same_bytes_and_any_seed_the_same_dimension():
    model = model_with(DUBINS, "mr")
    verdicts = [observability_of(model, held=STRAIGHT, seed=seed) for seed in (0, 0, 1, 2, 3)]
    assert verdicts[0].at.tobytes() == verdicts[1].at.tobytes()
    assert verdicts[0].null_space.tobytes() == verdicts[1].null_space.tobytes()
    assert verdicts[0].at.tobytes() != verdicts[2].at.tobytes()
    assert {verdict.dimension for verdict in verdicts} == {4}


@pytest.mark.parametrize("shift", [0.0, 1.0, -2.0, 50.0])
@pytest.mark.parametrize("function", [ca.sqrt, ca.log, ca.acos, ca.acosh, lambda x: ca.log(-x)])
def test_a_generic_point_is_found_in_the_domain(function, shift):
    x = states(2)
    system = affine(x, [function(x[0] - shift)], drift=ca.vertcat(0, x[1]))
    if function is ca.acos and shift == 50.0:  # a domain of width 2 far from everything is left to the caller
        with pytest.raises(InputError, match=r"no random point .* give a point"):
            observability(system)
        assert observability(system, at=(50.5, 0.0)).dimension == 1
        return
    verdict = observability(system)
    assert (verdict.dimension, verdict.decided) == (1, True)
    assert np.isfinite(float(ca.Function("y", [x], [function(x[0] - shift)])(verdict.at)))


def test_a_point_outside_the_domain_of_an_output_is_refused_though_its_gradient_exists():
    x = states(2)
    with pytest.raises(InputError, match=r"output 'y1' at x0 = 0.5, x1 = -1 has no finite smooth value"):
        observability(affine(x, [x[0], ca.log(x[1])]), at=(0.5, -1.0))


def test_a_point_outside_the_domain_of_the_drift_is_refused():
    x = states(2)
    with pytest.raises(InputError, match="the rate of x1 at x0 = -3, x1 = 0 has no finite smooth value"):
        observability(affine(x, [x[0]], drift=ca.vertcat(x[1], ca.sqrt(x[0]))), at=(-3.0, 0.0))


def test_verdict_names_what_was_answered():
    verdict = observability(DUBINS)
    assert (verdict.disturbance, verdict.known_inputs, verdict.stopped_by) == ("none", "any", "full")
    assert verdict.hidden == "nothing is hidden"
    assert "5 of 5" in verdict.proof


# ---------------------------------------------------------------- words


def test_words_for_a_combination_have_the_right_signs():
    # heading + 1 deg turns the velocity left: at 30 deg of heading 20 m/s lose 0.175 m/s to the east and gain 0.302 m/s to the north
    verdict = observability_of(model_with(DUBINS, "g"), at=(0, 0, np.pi / 6, 3, -2), held=STRAIGHT)
    assert verdict.hidden == (
        "heading cannot be told from wind_x, wind_y: in the rates of all states wind_x, wind_y can make up for it, such as"
        " +1 deg of heading with +0.175 m/s of wind_x and -0.302 m/s of wind_y, and no output changes"
    )


def test_words_for_states_that_are_not_seen():
    verdict = observability_of(model_with(DUBINS, "m"))
    assert verdict.hidden == "x, y, wind_x, wind_y are not seen at all"


def test_words_for_several_directions():
    verdict = observability_of(model_with(DUBINS, "r"), at=POINT, held=STRAIGHT)
    first, second = verdict.hidden.split("; ")
    assert first.startswith("rotation of everything about the beacon at (500, 200) m")
    assert second.startswith("heading cannot be told from wind_x, wind_y: ")


def test_words_for_plain_systems_have_no_units():
    x = states(2)
    verdict = observability(affine(x, [x[0] - 2 * x[1]]))
    assert verdict.hidden == "x0 cannot be told from x1: +1 of x0 with +0.5 of x1 changes no output, only x0 - 2 x1 shows"


def test_error_for_an_unobservable_study_carries_the_words():
    verdict = observability_of(model_with(DUBINS, "g"), held=STRAIGHT)
    assert "4 of 5" in str(UnobservableError(verdict))


# ---------------------------------------------------------------- bad input


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"at": (1.0, 2.0)}, r"at has shape \(2,\): must be \(5,\) for x, y, heading"),
        ({"at": (1.0, 2.0, np.nan, 0.0, 0.0)}, "at: heading is nan: must be finite"),
        ({"at": "north"}, "at is 'north': must be an array of real numbers"),
        ({"held": {"turnrate": 0.0}}, "held has no 'turnrate'; did you mean 'turn_rate'"),
        ({"held": {"turn_rate": np.inf}}, "held: turn_rate is inf: must be a finite number"),
        ({"held": {"turn_rate": "fast"}}, "turn_rate'?.* is 'fast': must be a"),
        ({"seed": -1}, "seed is -1"),
        ({"disturbance": "constant"}, "disturbance is 'constant': must be one of 'arbitrary' or"),
        ({"known_inputs": "some"}, "known_inputs is 'some': must be one of 'any', 'smooth'"),
        ({"method": "guess"}, "method is 'guess': must be one of 'recursion', 'jets'"),
        ({"orders": 3}, "orders is 3: goes with method='jets' alone"),
        ({"method": "jets", "orders": 0}, "orders is 0: must be a whole number of at least 1"),
        ({"at": (*BEACON, 0.0, 0.0, 0.0)}, r"output 'bearing' at x = 500, y = 200, .* has no finite smooth value"),
    ],
)
def test_bad_input_is_refused_by_name(options, message):
    with pytest.raises(InputError, match=message):
        observability(DUBINS, **options)


def test_numpy_numbers_are_numbers():
    at, held = np.array(POINT, dtype=np.float32), {"turn_rate": np.float32(0)}
    assert observability_of(model_with(DUBINS, "g"), at, held, seed=np.int64(3)).dimension == 4


def test_a_range_from_the_beacon_itself_is_refused():
    with pytest.raises(InputError, match=r"the gradient of output 'range' at x = 500, y = 200, .* has no finite smooth value"):
        observability_of(model_with(DUBINS, "gr"), at=(*BEACON, 0.0, 0.0, 0.0))


@pytest.mark.parametrize("seed", range(6))
def test_an_output_without_gradient_is_refused_though_others_suffice(seed):
    x = states(2)
    system = affine(x, [0.999 * x[0], 0.999 * x[1], ca.hypot(x[0], x[1])])
    with pytest.raises(InputError, match="the gradient of output 'y2' at x0 = 0, x1 = 0"):
        observability(system, at=(0.0, 0.0), seed=seed)


def test_a_derivative_without_value_is_named():
    x = states(1)
    with pytest.raises(InputError, match="derivative 1 of output 'y0' at x0 = 0"):
        observability(affine(x, [x**2], drift=ca.sqrt(x + 0) * 1), at=[0.0])


def test_a_function_without_domain_is_refused():
    x = states(1)
    with pytest.raises(InputError, match="no random point"):
        observability(affine(x, [ca.sqrt(-1 - x**2)]))


def test_no_sensors_is_refused():
    with pytest.raises(InputError, match="no sensors"):
        observability(System(Dubins(speed=SPEED)))
