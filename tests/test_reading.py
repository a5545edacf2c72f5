"""What typed numbers mean: multiples of pi, roots, short fractions; and verdicts that depend on it."""

import math
from fractions import Fraction

import casadi as ca
import flint
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import obsdesign as od
from obsdesign.rank.decimal_reading import read_double
from obsdesign.rank.exact_constants import symbolise
from obsdesign.rank.exact_numbers import Irrational, as_ball, as_residue, combination, cosine, pi_times, sine
from obsdesign.rank.graph import evaluate, instructions
from obsdesign.rank.residues import MODULAR_ARITHMETIC
from obsdesign.rank.symbols import PRIME
from obsdesign.scenario.degrees import in_radians

X = ca.SX.sym("x", 2)
STILL = ca.SX.zeros(2)


def static(first, second):
    """Two constant states, seen by two outputs that are functions of them."""
    return od.observability(od.ControlAffineSystem(X, ("x", "y"), drift=STILL, outputs={"a": first, "b": second}))


def towards(heading, beacon, **more):
    """Straight and level, 10 m/s, from the origin; the range to a beacon is all that is seen."""
    system = od.System(od.Dubins(speed=10.0), (od.Range(beacon, sigma=1.0),))
    return od.observability(system, at=[0, 0, heading], held={"turn_rate": 0.0}, **more)


# ---------------------------------------------------------------- numbers


@pytest.mark.parametrize("twelfths", range(-30, 31))
def test_sine_and_cosine_of_twelfths_of_pi_are_exact(twelfths):
    with flint.ctx.workprec(300):
        angle = flint.arb.pi() * twelfths / 12
        for exact, ball in ((sine(twelfths), angle.sin()), (cosine(twelfths), angle.cos())):
            assert abs(as_ball(exact) - ball) < flint.arb(2) ** -280
    assert as_residue(sine(twelfths)) ** 2 + as_residue(cosine(twelfths)) ** 2 == 1  # the roots modulo the prime are roots


def test_residues_keep_the_relations_of_roots():
    parts = [Fraction(k, 7) for k in (3, -2, 5, 1)]
    first, second = combination(*parts), combination(*parts[::-1])
    a, b, c, d = parts
    e, f, g, h = parts[::-1]
    product = combination(
        a * e + 2 * b * f + 3 * c * g + 6 * d * h,
        a * f + b * e + 3 * (c * h + d * g),
        a * g + c * e + 2 * (b * h + d * f),
        a * h + d * e + b * g + c * f,
    )
    assert as_residue(first) * as_residue(second) == as_residue(product)
    with flint.ctx.workprec(200):
        assert (as_ball(first) * as_ball(second) - as_ball(product)).contains(0)
    assert first + combination(-a, -b, -c, -d) == 0


@settings(max_examples=300, deadline=None)
@given(st.integers(-2000, 2000), st.integers(1, 6))
def test_multiples_of_pi_are_read_however_they_were_computed(k, part):
    meant = pi_times(Fraction(k * part, 12))
    for value in (k * part * np.pi / 12, np.deg2rad(15.0 * k * part), math.radians(15 * k * part), k * part * (np.pi / 12)):
        found = read_double(value)
        assert found.literal == meant
        assert not found.is_doubtful


@settings(max_examples=300)
@given(st.integers(-72_000, 72_000))
def test_degrees_of_two_decimals_are_read(hundredths):
    assert read_double(math.radians(hundredths / 100)).literal == pi_times(Fraction(hundredths, 18_000))


@pytest.mark.parametrize("degrees", [15, -165, 180, 90.0, 17.5, 359, -720, 0])
def test_degrees_of_a_scenario_are_multiples_of_pi(degrees):
    data = in_radians({"start": {"heading_deg": degrees}})
    assert read_double(data["start"]["heading"]).literal == pi_times(Fraction(degrees) / 180)


@settings(max_examples=300)
@given(st.integers(1, 10**12), st.integers(0, 20))
def test_a_decimal_of_twelve_digits_stands_for_itself(digits, places):
    value = Fraction(digits, 10**places)
    found = read_double(float(value))
    assert found.literal == value
    assert not found.is_doubtful


@settings(max_examples=200)
@given(st.lists(st.integers(2, 999), min_size=2, max_size=4), st.integers(1, 60))
def test_a_product_of_decimals_in_doubles_may_mean_the_exact_product(numbers, divisor):
    product, exact = 1.0, Fraction(1)
    for number in numbers:
        product, exact = product * (number / 100), exact * Fraction(number, 100)
    product, exact = product / divisor, exact / divisor
    if exact.numerator * exact.denominator < 2**36:
        found = read_double(product)
        assert exact in (found.literal, found.intended)


@pytest.mark.parametrize(
    ("value", "meant"),
    [
        (0.1 * 0.1, Fraction(1, 100)),
        (0.1 * 3, Fraction(3, 10)),
        (1 / 49 * 49, Fraction(1)),
        (0.1 + 0.2 - 0.3, Fraction(0)),
        (math.cos(math.pi / 2), Fraction(0)),
        (2000 * math.cos(math.pi / 2), Fraction(0)),
        (2000 * math.sin(math.pi / 4), combination(Fraction(0), Fraction(1000))),
        (2000 * math.sin(math.radians(165)), combination(Fraction(0), Fraction(-500), Fraction(0), Fraction(500))),
    ],
)
def test_a_rounded_number_is_doubtful(value, meant):
    found = read_double(value)
    assert found.intended == meant
    assert found.literal == Fraction(repr(value))
    assert found.is_doubtful


@pytest.mark.parametrize("value", [6.674e-11, 1e-300, 1.6e-19, 123456.78901234567, 5e-324, 1.7e308])
def test_what_nobody_rounds_stands_for_itself(value):
    assert read_double(value).literal == read_double(value).intended == Fraction(repr(value))


def test_random_numbers_are_hardly_ever_doubtful():
    values = np.random.default_rng(0).uniform(-10, 10, 2000)
    assert sum(read_double(value).is_doubtful for value in values) < 100  # 5 %: and only then a second reading is looked at
    assert not any(isinstance(read_double(value).literal, Irrational) for value in values)


# ---------------------------------------------------------------- sine and cosine in expressions

TURNED = {
    "sum": lambda x, a: ca.sin(x + a),
    "difference": lambda x, a: ca.cos(a - x),
    "twice": lambda x, a: ca.sin(2 * (x + a)),
    "three times": lambda x, a: ca.cos(3 * (x - a)),
    "half": lambda x, a: ca.sin((x + 2 * a) / 2),
    "tangent": lambda x, a: ca.tan(x + a),
    "two": lambda x, a: ca.sin(x + a) * ca.cos(x - a) - ca.exp(x + a),
    "minus": lambda x, a: ca.sin(-(x + a)),
}


@pytest.mark.parametrize("form", TURNED)
@pytest.mark.parametrize("twelfths", [-13, -6, 1, 2, 3, 5, 6, 8, 12, 23])
def test_angles_are_taken_apart_without_changing_the_function(form, twelfths):
    x, a = ca.SX.sym("x"), twelfths * np.pi / 12
    expression = TURNED[form](x, a)
    found = symbolise(x, expression, lambda value: read_double(value).intended)
    again = ca.Function("f", [x, found.constants], [found.expression])
    values = [float(value) for value in found.values]
    for at in (0.3, -1.7):
        assert float(again(at, values)) == pytest.approx(float(ca.Function("f", [x], [expression])(at)), rel=1e-12, abs=1e-12)


def test_what_is_zero_at_multiples_of_pi_is_nothing_else():
    x = ca.SX.sym("x")
    found = symbolise(
        x,
        ca.vertcat(ca.cos(x), ca.sin(2 * x), ca.sin(x) - 1, ca.sin(x - np.pi / 2)),
        lambda value: read_double(value).intended,
        [Fraction(1, 2)],
    )
    residues = evaluate(
        instructions(ca.Function("f", [x, found.constants], [found.expression])),
        [[as_residue(Fraction(0))], [as_residue(value) for value in found.values]],
        MODULAR_ARITHMETIC,
    )
    assert [int(value) % PRIME for value in residues] == [0, 0, 0, 0]


# ---------------------------------------------------------------- verdicts at angles


@pytest.mark.parametrize("twelfths", range(-24, 25, 6))
@pytest.mark.parametrize("how", [lambda k: k * np.pi / 12, lambda k: np.deg2rad(15.0 * k), lambda k: math.radians(15 * k)])
def test_flying_straight_at_a_beacon_shows_its_distance_alone(twelfths, how):
    # r = r_0 - 10 t whatever the lateral offset and the heading do to first order: 1 of 3, for all directions alike
    heading = how(twelfths)
    beacon = 2000 * np.round([np.cos(heading), np.sin(heading)])
    found = towards(heading, beacon)
    assert (found.dimension, found.decided) == (1, True)
    assert found.at[2] == pytest.approx(heading, abs=1e-15 * max(1, abs(heading)))
    if twelfths:
        assert "heading as" in found.proof
        assert "pi" in found.proof


@pytest.mark.parametrize("twelfths", range(-12, 13))
def test_beacons_placed_by_sine_and_cosine_are_never_decided_wrongly(twelfths):
    heading = twelfths * np.pi / 12
    found = towards(heading, (2000 * np.cos(heading), 2000 * np.sin(heading)))
    assert found.dimension == 1
    assert found.decided or "as they stand" in found.proof


def test_an_angle_within_an_ulp_of_a_multiple_is_that_multiple():
    for heading in (np.nextafter(np.pi, 4), np.nextafter(np.pi, 3)):
        assert towards(heading, (-2000.0, 0.0)).dimension == 1
    assert towards(3.1415927, (-2000.0, 0.0)).dimension == 2  # 5e-8 rad off is a direction of its own


def test_a_pendulum_upright_at_rest_hides_its_damping():
    # angle'' = -9 sin(angle) - damping angle': at rest at the equilibrium pi nothing depends on the damping
    state = ca.SX.sym("state", 3)
    rate = ca.vertcat(state[1], -9 * ca.sin(state[0]) - state[2] * state[1], 0)
    system = od.ControlAffineSystem(state, ("angle", "rate", "damping"), drift=rate, outputs={"encoder": state[0]})
    for angle in (0.0, np.pi, -np.pi, 3 * np.pi):
        found = od.observability(system, at=[angle, 0, 0.1])
        assert (found.dimension, found.decided, found.unobservable_states) == (2, True, ("damping",))
    assert od.observability(system, at=[np.pi / 2, 0, 0.1]).dimension == 3


@pytest.mark.parametrize(("offset", "dimension"), [(np.pi / 2, 1), (-np.pi / 2, 1), (np.pi / 3, 2), (np.pi, 2)])
def test_an_offset_of_a_quarter_turn_makes_a_sine_of_a_cosine(offset, dimension):
    # y1 = cos(x - a) + y, y2 = sin(x) + y: equal at a = pi/2; at a = -pi/2, -sin(x) + y and y - sin(x) likewise
    sign = -1 if offset == -np.pi / 2 else 1
    found = static(ca.cos(X[0] - offset) + X[1], sign * ca.sin(X[0]) + X[1])
    assert (found.dimension, found.decided) == (dimension, True)


@pytest.mark.parametrize("seed", range(60))
def test_sums_of_angles_are_one_exactly_where_whole_numbers_say_so(seed):
    # y1 = sin(x + a) + y, y2 = cos(x + b) + y with a, b, x multiples of pi/12: their gradients (cos(x + a), 1), (-sin(x + b), 1) are
    # parallel where sin(a + x + 6) = sin(b + x + 12) in units of pi/12: equal or adding up to 12 modulo 24; everywhere if a = b + 6
    a, b, at = (int(k) for k in np.random.default_rng(seed).integers(-24, 25, 3))
    b = a - 6 if seed % 3 == 0 else b if seed % 3 == 1 else -a - 2 * at - 6
    unit = np.pi / 12
    system = od.ControlAffineSystem(X, ("x", "y"), outputs={"s": ca.sin(X[0] + a * unit) + X[1], "c": ca.cos(X[0] + b * unit) + X[1]})
    everywhere = (a - b - 6) % 24 == 0
    there = everywhere or (a + b + 2 * at + 18 - 12) % 24 == 0
    generic, found = od.observability(system), od.observability(system, at=[at * unit, 0.3])
    assert (generic.dimension, generic.decided) == (1 if everywhere else 2, True)
    assert (found.dimension, found.decided) == (1 if there else 2, True)


# ---------------------------------------------------------------- constants that were multiplied before


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (X[0] * 0.1 * 0.1 + X[1], X[0] + 100 * X[1]),
        (X[0] * 0.1 * 3 + X[1], 3 * X[0] + 10 * X[1]),
        (X[0] * (ca.SX(1) / 49) * 49 + X[1], X[0] + X[1]),
        (X[0] + (ca.SX(0.1) + 0.2 - 0.3) * X[1], X[0]),
        (X[0] + np.cos(np.pi / 2) * X[1], X[0]),
    ],
)
def test_one_sensor_twice_is_not_decided_to_be_two(first, second):
    found = static(first, second)
    assert (found.dimension, found.decided) == (1, False)
    assert "as they stand 2" in found.proof
    assert found.null_space.shape == (2, 1)


def test_a_number_that_may_be_rounded_does_not_matter_where_both_readings_agree():
    assert static(X[0] * 0.1 * 3 + X[1], X[0] - X[1]).decided
    once = X[0] * 0.1 * 3 + X[1]
    again = static(once, ca.exp(once))
    assert (again.dimension, again.decided) == (1, True)


def rank_of(matrix):
    """Rank of rational rows, by elimination in exact arithmetic."""
    return flint.fmpq_mat([[flint.fmpq(value.numerator, value.denominator) for value in row] for row in matrix]).rank()


@pytest.mark.parametrize("seed", range(60))
def test_no_rank_of_decimals_multiplied_by_casadi_is_decided_wrongly(seed):
    # rows are products of decimals, the last a combination of the others, exactly; CasADi folds the products into doubles
    generator = np.random.default_rng(seed)
    n = int(generator.integers(2, 4))
    decimals = [Fraction(int(k), 100) for k in generator.integers(1, 100, 6)]
    states = ca.SX.sym("x", n)
    rows, outputs = [], []
    for _ in range(n - 1):
        exact, terms = [], ca.SX(0)
        for j in range(n):
            picked = generator.choice(len(decimals), 2)
            exact.append(decimals[picked[0]] * decimals[picked[1]])
            terms += states[j] * float(decimals[picked[0]]) * float(decimals[picked[1]])
        rows.append(exact)
        outputs.append(terms)
    shares = [int(k) for k in generator.integers(1, 9, n - 1)]
    rows.append([sum(share * row[j] for share, row in zip(shares, rows, strict=True)) for j in range(n)])
    outputs.append(sum((states[j] * float(rows[-1][j]) for j in range(n)), ca.SX(0)))
    names = tuple(f"x{j}" for j in range(n))
    found = od.observability(od.ControlAffineSystem(states, names, outputs={f"y{i}": y for i, y in enumerate(outputs)}))
    assert not found.decided or found.dimension == rank_of(rows)
    assert found.dimension <= rank_of(rows)


CHAINS = [(1000, 1040), pytest.param((0, 1000), marks=pytest.mark.slow)]


@pytest.mark.parametrize("seeds", CHAINS)
def test_no_rank_of_chains_of_numbers_is_decided_wrongly(seeds):
    # every entry is a state times and over one to three decimals, whole numbers and fractions, as CasADi folds them; four times in five
    # the last output is a combination of the others, its coefficients rounded once. The exact rank is that of the fractions
    for seed in range(*seeds):
        generator = np.random.default_rng(seed)
        n = int(generator.integers(2, 4))
        states = ca.SX.sym("x", n)
        chains = [[_chain(generator, states[j]) for j in range(n)] for _ in range(n)]
        rows = [[exact for _, exact in row] for row in chains]
        outputs = [sum((term for term, _ in row), ca.SX(0)) for row in chains]
        if generator.random() < 0.8:
            shares = [_number(generator) for _ in range(n - 1)]
            rows[-1] = [sum((share * row[j] for share, row in zip(shares, rows, strict=False)), Fraction(0)) for j in range(n)]
            outputs[-1] = sum((states[j] * float(rows[-1][j]) for j in range(n)), ca.SX(0))
        names = tuple(f"x{j}" for j in range(n))
        found = od.observability(od.ControlAffineSystem(states, names, outputs={f"y{i}": y for i, y in enumerate(outputs)}))
        exact = rank_of(rows)
        assert not found.decided or found.dimension == exact, seed
        assert found.dimension <= exact, seed


def _number(generator):
    kind = generator.integers(0, 4)
    if kind < 2:
        return Fraction(int(generator.integers(1, 1000)), 10 ** int(generator.integers(0, 4)))
    return Fraction(int(generator.integers(1, 30)), int(generator.integers(1, 50)) if kind == 2 else 1)


def _chain(generator, term):
    """Return the term times and over some numbers, and the exact factor."""
    exact = Fraction(1)
    for _ in range(int(generator.integers(1, 4))):
        number = _number(generator)
        if generator.random() < 0.5:
            term, exact = term * float(number), exact * number
        else:
            term, exact = term / float(number), exact / number
    return term, exact
