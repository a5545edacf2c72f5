"""The rank engine: every operation against CasADi's doubles, ranks against exact rational arithmetic, and refusals."""

from fractions import Fraction

import casadi as ca
import flint
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from obsdesign.errors import InputError
from obsdesign.rank.balls import BALLS, CONFIRMING_BITS, PRECISIONS
from obsdesign.rank.balls import OPERATIONS as SUPPORTED
from obsdesign.rank.decimal_reading import read_double
from obsdesign.rank.elimination import rank_at
from obsdesign.rank.exact_constants import symbolise
from obsdesign.rank.graph import NotExactError, NoValueError, evaluate, instructions
from obsdesign.rank.residues import values_modulo

X, Y = ca.SX.sym("x"), ca.SX.sym("y")


def meant(value):
    return read_double(value).intended


# code -> (expression of X and Y that uses it, points in its smooth domain)
EVERYWHERE = [(0.75, -1.25), (-2.5, 0.375)]
INSIDE = [(0.75, 0.5), (-0.375, 0.25)]
POSITIVE = [(0.75, 1.25), (2.5, -0.375)]
OPERATIONS = {
    "ADD": (X + Y, EVERYWHERE),
    "SUB": (X - Y, EVERYWHERE),
    "MUL": (X * Y, EVERYWHERE),
    "DIV": (X / Y, EVERYWHERE),
    "NEG": (-X, EVERYWHERE),
    "INV": (1 / X, EVERYWHERE),
    "SQ": (X**2, EVERYWHERE),
    "TWICE": (2 * X, EVERYWHERE),
    "POW": (X**Y, POSITIVE),
    "CONSTPOW": (X**1.5, POSITIVE),
    "SQRT": (ca.sqrt(X), POSITIVE),
    "EXP": (ca.exp(X), EVERYWHERE),
    "EXPM1": (ca.expm1(X), EVERYWHERE),
    "LOG": (ca.log(X), POSITIVE),
    "LOG1P": (ca.log1p(X), INSIDE),
    "ERF": (ca.erf(X), EVERYWHERE),
    "ERFINV": (ca.erfinv(X), INSIDE),
    "SIN": (ca.sin(X), EVERYWHERE),
    "COS": (ca.cos(X), EVERYWHERE),
    "TAN": (ca.tan(X), EVERYWHERE),
    "ASIN": (ca.asin(X), INSIDE),
    "ACOS": (ca.acos(X), INSIDE),
    "ATAN": (ca.atan(X), EVERYWHERE),
    "SINH": (ca.sinh(X), EVERYWHERE),
    "COSH": (ca.cosh(X), EVERYWHERE),
    "TANH": (ca.tanh(X), EVERYWHERE),
    "ASINH": (ca.asinh(X), EVERYWHERE),
    "ACOSH": (ca.acosh(X), [(1.5, 0.0), (7.25, 0.0)]),
    "ATANH": (ca.atanh(X), INSIDE),
    "ATAN2": (ca.atan2(Y, X), [*EVERYWHERE, (-1.5, -0.25), (1.5, 0.0)]),
    "HYPOT": (ca.hypot(X, Y), EVERYWHERE),
    "FABS": (ca.fabs(X), EVERYWHERE),
    "SIGN": (ca.sign(X), EVERYWHERE),
    "COPYSIGN": (ca.copysign(X, Y), EVERYWHERE),
    "FMIN": (ca.fmin(X, Y), EVERYWHERE),
    "FMAX": (ca.fmax(X, Y), EVERYWHERE),
    "FLOOR": (ca.floor(X), EVERYWHERE),
    "CEIL": (ca.ceil(X), EVERYWHERE),
    "FMOD": (ca.fmod(X, Y), [*EVERYWHERE, (7.5, 2.25), (-7.5, 2.25), (0.0, 2.0)]),
    "REMAINDER": (ca.remainder(X, Y), [*EVERYWHERE, (7.5, 2.25), (-7.5, 2.25), (0.0, 2.0)]),
    "LT": (ca.if_else(X < Y, X, Y), EVERYWHERE),
    "LE": (ca.if_else(X <= Y, X, Y), EVERYWHERE),
    "EQ": (X * (X == Y), EVERYWHERE),
    "NE": (X * (X != Y), EVERYWHERE),
    "NOT": (X * ca.logic_not(X < Y), EVERYWHERE),
    "AND": (X * ca.logic_and(X < Y, Y > 0), EVERYWHERE),
    "OR": (X * ca.logic_or(X < Y, Y > 0), EVERYWHERE),
    "IF_ELSE_ZERO": (ca.if_else(X > 0, ca.exp(X), Y), EVERYWHERE),
    "PRINTME": (X.printme(Y), EVERYWHERE),
}
CASES = [(name, expression, point) for name, (expression, points) in OPERATIONS.items() for point in points]


def codes(expression):
    return {step.operation for step in instructions(ca.Function("f", [X, Y], [expression]))}


def ball_values(expression, point, bits=256):
    function = ca.Function("f", [X, Y], [ca.densify(expression)])
    with flint.ctx.workprec(bits):
        return evaluate(instructions(function), [[flint.arb(value)] for value in point], BALLS)


@pytest.mark.parametrize("name", OPERATIONS)
def test_example_uses_its_operation(name):
    assert getattr(ca, f"OP_{name}") in codes(OPERATIONS[name][0])


def test_every_supported_operation_has_an_example():
    assert {getattr(ca, f"OP_{name}") for name in OPERATIONS} == set(SUPPORTED)


@pytest.mark.parametrize(("name", "expression", "point"), CASES)
def test_operation_agrees_with_doubles(name, expression, point, capfd):
    expected = float(ca.Function("f", [X, Y], [expression])(*point))
    (value,) = ball_values(expression, point)
    assert float(value) == pytest.approx(expected, rel=1e-13, abs=1e-15)
    assert float(value.rad()) <= 1e-70 * max(1.0, abs(expected))


@pytest.mark.parametrize(("name", "expression", "point"), CASES)
def test_derivative_agrees_with_a_central_difference(name, expression, point):
    # a constant rounded by CasADi (2 / sqrt(pi) in erf') would show at 1e-17
    with flint.ctx.workprec(512):
        step = flint.arb(2) ** -100
        for column, symbol in enumerate((X, Y)):
            forward, backward = ([flint.arb(value) + sign * step * (k == column) for k, value in enumerate(point)] for sign in (1, -1))
            difference = (ball_values(expression, forward, 512)[0] - ball_values(expression, backward, 512)[0]) / (2 * step)
            derivative = ball_values(ca.jacobian(expression, symbol), point, 512)[0]
            assert abs(float(derivative - difference)) < 1e-55


OUTSIDE = {
    "pole": (1 / X, (0, 1)),
    "sqrt": (ca.sqrt(X), (-1, 1)),
    "log": (ca.log(X), (0, 1)),
    "log1p": (ca.log1p(X), (-2, 1)),
    "acos": (ca.acos(X), (2, 1)),
    "acosh": (ca.acosh(X), (0.5, 1)),
    "atanh": (ca.atanh(X), (1, 1)),
    "erfinv": (ca.erfinv(X), (1.5, 1)),
    "power of a negative number": (X**1.5, (-1, 1)),
    "kink of fabs": (ca.fabs(X), (0, 1)),
    "kink of sign": (ca.sign(X), (0, 1)),
    "kink of copysign": (ca.copysign(X, Y), (1, 0)),
    "kink of fmin": (ca.fmin(X, Y), (1, 1)),
    "kink of fmax": (ca.fmax(X, Y), (1, 1)),
    "jump of floor": (ca.floor(X), (3, 1)),
    "jump of ceil": (ca.ceil(X), (-3, 1)),
    "jump of fmod": (ca.fmod(X, Y), (-4, 2)),
    "jump of remainder": (ca.remainder(X, Y), (3, 2)),
    "comparison of equals": (ca.if_else(X < Y, X, 2 * Y), (1, 1)),
    "weak comparison of equals": (ca.if_else(X <= Y, X, 2 * Y), (1, 1)),
    "equality of equals": (X * (X == Y), (1, 1)),
    "inequality of equals": (X * (X != Y), (1, 1)),
    "no direction": (ca.atan2(X, Y), (0, 0)),
}


@pytest.mark.parametrize("case", OUTSIDE)
def test_outside_the_domain_is_a_named_error_with_its_row(case):
    expression, point = OUTSIDE[case]
    matrix = ca.Function("f", [X, Y], [ca.densify(ca.vertcat(X + Y, expression, Y))])
    with pytest.raises(NoValueError, match=r"row 1 .*no finite smooth value") as caught:
        rank_at(matrix, [[Fraction(value)] for value in point])
    assert caught.value.row == 1
    assert isinstance(caught.value, InputError)


def test_branch_that_is_not_taken_may_lie_outside_the_domain():
    assert float(ball_values(ca.if_else(X > 0, ca.sqrt(X), -X), (-4, 0))[0]) == 4


def test_unsupported_operation_is_named():
    call = ca.Function("inner", [X], [ca.sin(X)], {"never_inline": True})
    matrix = ca.Function("f", [X, Y], [call(X) * Y])
    with pytest.raises(NotExactError, match="OP_CALL"):
        rank_at(matrix, [[Fraction(1)], [Fraction(2)]])
    with pytest.raises(NotExactError, match="OP_CALL"):
        symbolise(X, call(X) / 3, meant)


# ---------------------------------------------------------------- rank


def constant_matrix(entries):
    """A function without arguments' influence whose result is the matrix of rationals, handed over exactly."""
    flat = ca.SX.sym("entries", len(entries) * len(entries[0]))
    shape = (len(entries), len(entries[0]))
    column_major = [entries[i][j] for j in range(shape[1]) for i in range(shape[0])]
    return ca.Function("matrix", [flat], [ca.reshape(flat, *shape)]), [[Fraction(value) for value in column_major]]


def rank_of(entries, **options):
    return rank_at(*constant_matrix(entries), **options)


small = st.integers(-3, 3)


@st.composite
def low_rank_matrices(draw):
    m, n, r = draw(st.integers(1, 7)), draw(st.integers(1, 6)), draw(st.integers(0, 4))
    left = draw(st.lists(st.lists(small, min_size=r, max_size=r), min_size=m, max_size=m))
    right = draw(st.lists(st.lists(small, min_size=n, max_size=n), min_size=r, max_size=r))
    return [[sum(left[i][k] * right[k][j] for k in range(r)) for j in range(n)] for i in range(m)]


@settings(max_examples=60, deadline=None)
@given(low_rank_matrices(), st.lists(st.integers(-8, 8), min_size=7, max_size=7), st.lists(st.integers(-3, 3), min_size=6, max_size=6))
def test_rank_equals_exact_rank_in_any_units(entries, row_units, column_units):
    scaled = [[Fraction(10) ** (row_units[i] + column_units[j]) * value for j, value in enumerate(row)] for i, row in enumerate(entries)]
    exact = flint.fmpq_mat([[flint.fmpq(value.numerator, value.denominator) for value in row] for row in scaled]).rank()
    found = rank_of(scaled)
    assert found.is_decided
    assert found.rank == exact == len(found.rows) == len(found.columns)
    if exact:
        chosen = flint.fmpq_mat([[flint.fmpq(entries[i][j]) for j in found.columns] for i in found.rows])
        assert chosen.rank() == exact


@settings(max_examples=60, deadline=None)
@given(low_rank_matrices())
def test_null_space_is_orthonormal_and_annihilated(entries):
    found = rank_of(entries)
    A, N = np.array(entries, dtype=float), found.null_space
    assert N.shape == (A.shape[1], A.shape[1] - found.rank)
    assert np.allclose(N.T @ N, np.eye(N.shape[1]), atol=1e-13)
    assert np.abs(A @ N).max(initial=0) < 1e-12 * max(1, np.abs(A).max())


@settings(max_examples=60, deadline=None)
@given(low_rank_matrices())
def test_a_row_of_the_null_space_is_zero_exactly_where_the_unit_covector_is_in_the_row_space(entries):
    found = rank_of(entries)
    for j, row in enumerate(found.null_space):
        unit = [int(k == j) for k in range(len(entries[0]))]
        in_row_space = flint.fmpq_mat([[flint.fmpq(value) for value in line] for line in [*entries, unit]]).rank() == found.rank
        assert in_row_space == (not row.any())


def test_nearly_singular_is_not_singular():
    near = rank_of([[1, 1], [1, 1 + Fraction(1, 10**30)]])
    assert (near.rank, near.is_decided) == (2, True)
    assert near.smallest_pivot == pytest.approx(1e-30, rel=1e-3)
    exact = rank_of([[1, 1], [1, 1]])
    assert (exact.rank, exact.is_decided) == (1, True)
    assert exact.largest_remainder < 1e-70


def test_a_row_that_vanishes_by_an_identity_is_not_blown_up():
    zero = ca.cosh(X) ** 2 - ca.sinh(X) ** 2 - 1
    matrix = ca.Function("f", [X, Y], [ca.vertcat(ca.horzcat(X, Y), ca.horzcat(zero, 1e6 * zero))])
    found = rank_at(matrix, [[Fraction(3, 7)], [Fraction(2)]])
    assert (found.rank, found.is_decided, found.bits) == (1, True, CONFIRMING_BITS)


def test_pivots_come_from_lower_stages_first():
    entries = [[1000, 0, 0], [0, 0, 0], [1, 1, 0], [0, 50, 70]]
    assert set(rank_of(entries, stages=[2, 0, 0, 1]).rows) == {0, 2, 3}
    assert rank_of([*entries[:3], [0, 50, 0]], stages=[2, 0, 0, 1]).rows == (2, 3)


def test_precision_is_doubled_until_it_suffices():
    # the argument has 997 bits before the point: at 512 bits the sine is any number in [-1, 1]
    matrix = ca.Function("f", [X, Y], [ca.sin(X)])
    found = rank_at(matrix, [[Fraction(10**300)], [Fraction(0)]])
    assert (found.rank, found.is_decided) == (1, True)
    assert found.bits > 997


def test_a_fat_ball_around_zero_is_not_zero():
    # (2^120 x + y)^2 without its x^2 and x y: y^2 = 2^-80, at 256 bits lost in a ball of 2^-16
    remainder = (2.0**120 * X + Y) ** 2 - 2.0**240 * X**2 - 2.0**121 * (X * Y)
    found = rank_at(ca.Function("f", [X, Y], [remainder]), [[Fraction(1, 3)], [Fraction(1, 2**40)]])
    assert (found.rank, found.is_decided, found.bits) == (1, True, 512)


def test_undecided_at_the_limit_claims_the_lower_bound_only():
    wild = ca.sin(ca.exp(ca.exp(X)))  # exp(exp(9)) has 11690 bits before the point
    matrix = ca.Function("f", [X, Y], [ca.diag(ca.vertcat(Y, wild))])
    found = rank_at(matrix, [[Fraction(9)], [Fraction(2)]])
    assert (found.rank, found.is_decided, found.bits) == (1, False, PRECISIONS[-1])


def test_precision_of_the_process_is_restored():
    before = flint.ctx.prec
    rank_of([[1, 2]])
    with pytest.raises(NoValueError):
        rank_at(ca.Function("f", [X], [ca.log(X)]), [[Fraction(0)]])
    assert flint.ctx.prec == before


# ---------------------------------------------------------------- constants


@settings(max_examples=300)
@given(st.floats(allow_nan=False, allow_infinity=False))
def test_the_number_that_was_meant_rounds_to_the_double(value):
    typed = read_double(value).literal
    assert float(typed) == value if isinstance(typed, Fraction) else float(typed) == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize(
    ("value", "meant"), [(1 / 3, "1/3"), (0.1, "1/10"), (-0.108, "-27/250"), (6.674e-11, "6.674e-11"), (7.0, "7"), (0.1234567, "0.1234567")]
)
def test_decimals_and_fractions_are_read_as_meant(value, meant):
    assert read_double(value).literal == read_double(value).intended == Fraction(meant)


def test_constants_become_symbols_and_the_value_stays():
    expression = ca.vertcat(0.3 * X / 7 + 2 * Y, ca.sin(X - 0.5) / (1 / 3), X**2.5, ca.erf(Y))
    both = ca.vertcat(X, Y)
    found = symbolise(both, expression, meant)
    assert set(found.values) == {Fraction(3, 10), Fraction(7), Fraction(1, 2), Fraction(1, 3), Fraction(5, 2)}
    original = ca.Function("f", [both], [expression])([0.75, 0.25])
    again = ca.Function("f", [both, found.constants], [found.expression])([0.75, 0.25], [float(value) for value in found.values])
    assert np.allclose(np.array(original), np.array(again), rtol=1e-15)


def test_differentiating_folds_no_constant():
    chain = X
    for divisor in (3, 7, 11, 13, 17):
        chain = ca.sin(chain / divisor)
    found = symbolise(X, chain, meant)
    steps = instructions(ca.Function("f", [X, found.constants], [ca.jacobian(found.expression, X)]))
    assert {step.value for step in steps} <= {0.0, 0.5, 1.0, 2.0, -1.0}
    folded = instructions(ca.Function("f", [X], [ca.jacobian(chain, X)]))
    assert any(0 < step.value < 0.1 for step in folded)  # what CasADi does otherwise: 1 / 3 / 7 as a double


def test_a_constant_that_may_be_rounded_is_refused():
    folded = ca.jacobian(X / 3 / 49, X)
    with pytest.raises(NotExactError, match=r"constant 0\.0068.* may have been rounded"):
        rank_at(ca.Function("f", [X], [folded]), [[Fraction(1)]])
    large = ca.Function("f", [X], [X * 3.0**28])  # 45 bits
    assert rank_at(large, [[Fraction(1)]]).rank == 1


def test_residues_of_constants_are_exact():
    # differentiating (x y) / (2 y) gives the constant 0.5
    half = ca.Function("f", [X, Y], [ca.jacobian(X * Y / (2 * Y), X)])
    (value,) = values_modulo(half, [[3], [5]])[0]
    assert 2 * value == 1
    with pytest.raises(NotExactError, match="may have been rounded"):
        values_modulo(ca.Function("f", [X], [X / 3 * 0.1]), [[3]])


def test_null_vectors_that_are_all_but_parallel():
    """Of (a, b, c) with a = 1e-120 the null vectors (-b / a, 1, 0) and (-c / a, 0, 1) are parallel but for 1e-120: beyond 256 bits.

    Their span is that of (1, 0, 0) and (0, c, -b) to 1e-120.
    """
    x = ca.SX.sym("x", 3)
    row = ca.Function("row", [x], [x.T])
    b, c = Fraction(51, 100), Fraction(52, 100)
    basis = rank_at(row, ([Fraction(999, 1000 * 2**400), b, c],), confirm=False).null_space
    assert np.abs(basis.T @ basis - np.eye(2)).max() < 1e-14
    assert np.abs(np.array([0.0, float(b), float(c)]) @ basis).max() < 1e-14
