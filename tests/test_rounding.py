"""What is nearly singular within the rounding of the numbers given: the exact rank, and the rank of a point within rounding."""

import time
from fractions import Fraction

import casadi as ca
import numpy as np
import pytest
from flint import arb, arb_mat

import obsdesign as od
from obsdesign.analysis.evaluation_point import random_points
from obsdesign.analysis.experiments import Experiments
from obsdesign.analysis.model_equations import equations_of
from obsdesign.analysis.modular_points import random_modular_point
from obsdesign.rank.pivoting import complement_of, holds_rank
from obsdesign.rank.symbols import PRIME

STRAIGHT = {"turn_rate": 0.0}
WITHIN = "within the rounding of the numbers given it is"
MAY_BE = "within the rounding of the numbers given it may be"


def flight(beacon=(0.0, 0.0)):
    return od.System(od.Dubins(speed=10.0), (od.Range(beacon, sigma=1.0),))


def constants(**outputs):
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    return od.observability(od.ControlAffineSystem(ca.vertcat(x, y), ("x", "y"), outputs={k: f(x, y) for k, f in outputs.items()}))


@pytest.mark.parametrize("seed", range(40))
def test_a_radial_leg_at_any_heading_is_singular_within_rounding(seed):
    # towards the beacon the range falls by 10 m/s whatever heading and lateral offset do to first order: 1 of 3 on the leg, 2 beside it.
    # In doubles no heading but a few is exactly on the leg: the distance from it is some 1e-16
    generator = np.random.default_rng(seed)
    heading, distance = generator.uniform(-np.pi, np.pi), generator.uniform(10, 3000)
    at = [-distance * np.cos(heading), -distance * np.sin(heading), heading]
    found = od.observability(flight(), at=at, held=STRAIGHT)
    assert (found.dimension, found.decided) in {(1, True), (2, True)}
    assert found.dimension == 1 or f"{WITHIN} 1 of 3" in found.proof
    beside = od.observability(flight(), at=[at[0], at[1], heading + 1e-9], held=STRAIGHT)
    assert (beside.dimension, beside.decided) == (2, True)
    assert WITHIN not in beside.proof


@pytest.mark.parametrize("seed", range(20))
def test_the_same_with_the_beacon_placed_is_not_decided(seed):
    # what the model says may have been rounded on the way, so neither 1 nor 2 is claimed
    generator = np.random.default_rng(seed)
    heading, distance = round(generator.uniform(-3, 3), 2), generator.uniform(10, 3000)
    found = od.observability(flight((distance * np.cos(heading), distance * np.sin(heading))), at=[0, 0, heading], held=STRAIGHT)
    assert (found.dimension, found.decided, found.stopped_by) == (1, False, "precision")
    assert f"as they stand it is 2, {MAY_BE} 1 of 3" in found.proof
    assert found.null_space.shape == (3, 2)
    along = np.array([np.cos(heading), np.sin(heading), 0])  # what is seen is the distance, along the leg
    assert np.abs(along @ found.null_space).max() < 1e-12


def test_residues_of_decimals_and_of_cosines_are_reported():
    for heading in (0.1 + 0.2 - 0.3, 0.3 - 0.1 - 0.2, np.cos(np.pi / 2), -np.sin(np.pi)):
        found = od.observability(flight((2000.0, 0.0)), at=[0, 0, heading], held=STRAIGHT)
        assert (found.dimension, found.decided) == (2, True)
        assert f"{WITHIN} 1 of 3" in found.proof
    assert od.observability(flight((2000.0, 0.0)), at=[0, 0, 0], held=STRAIGHT).dimension == 1
    short = od.observability(flight((2000.0, 0.0)), at=[0, 0, 1e-16], held=STRAIGHT)
    assert (short.dimension, WITHIN in short.proof) == (2, False)  # typed so


@pytest.mark.parametrize("heading", [0.3, -1.7, 2.5])
def test_two_headings_half_a_turn_apart_are_reported(heading):
    # z sin(a - b) shows z unless a and b are half a turn apart: as doubles 0.3 and 0.3 + pi are not quite
    a, b, z = ca.SX.sym("a"), ca.SX.sym("b"), ca.SX.sym("z")
    system = od.ControlAffineSystem(ca.vertcat(a, b, z), ("a", "b", "z"), outputs={"first": a, "second": b, "both": z * ca.sin(a - b)})
    found = od.observability(system, at=[heading, heading + np.pi, 1.0])
    assert (found.dimension, found.decided) == (3, True)
    assert f"{WITHIN} 2 of 3" in found.proof
    assert WITHIN not in od.observability(system, at=[heading, heading + 3.1415, 1.0]).proof


@pytest.mark.parametrize("factor", [0.7234567890123457, 1.3717421123456789, 123.45678901234567])
def test_long_constants_decide_nothing_in_their_last_digits(factor):
    near = np.nextafter(factor, 200)
    found = constants(first=lambda x, y: factor * x + y, second=lambda x, y: near * x + y)
    assert (found.dimension, found.decided, found.stopped_by) == (1, False, "precision")
    assert f"as they stand it is 2, {MAY_BE} 1 of 2" in found.proof
    apart = constants(first=lambda x, y: factor * x + y, second=lambda x, y: factor * (1 + 1e-9) * x + y)
    assert (apart.dimension, apart.decided) == (2, True)


def test_what_cancels_to_the_size_of_rounding_decides_nothing():
    tiny = (0.1 + 0.2 - 0.3) * 1.123456789012345
    assert (
        constants(a=lambda x, y: x, b=lambda x, y: x + tiny * y).decided,
        constants(a=lambda x, y: x, b=lambda x, y: tiny * y).decided,
    ) == (
        False,
        False,
    )
    assert constants(a=lambda x, y: x, b=lambda x, y: 6.2e-17 * y).decided  # typed so: a unit, perhaps


def test_long_numbers_that_do_not_matter_change_nothing():
    found = od.observability(
        flight((123.45678901234567, 0.1234567890123456)), at=[0.1234567890123456, 7.123456789012345, 0.5], held=STRAIGHT
    )
    assert (found.dimension, found.decided) == (2, True)
    assert WITHIN not in found.proof


def linear(drift, unknown, outputs):
    x = ca.SX.sym("x", len(drift))
    system = od.ControlAffineSystem(
        x, tuple(f"x{i}" for i in range(len(drift))), drift=ca.SX(drift) @ x, unknown={"w": unknown}, outputs={"y": ca.SX(outputs).T @ x}
    )
    return od.observability(system)


def test_an_unknown_input_that_cancels_within_rounding_decides_nothing():
    # y' = c + (.0072 * 5/9e-12 - 4e-15) w = c exactly, with 0.4 / 7.2e11 as a fraction: 2 of 3. As doubles w has a part in y'
    drift = [[0, 0, 0], [0, 0, 1], [0, 0, 0]]
    found = linear(drift, ca.vertcat(ca.SX(0.4) / 7.2e11, -4e-15, 0), [0.0072, 1, 0])
    assert (found.dimension, found.decided, found.stopped_by) == (1, False, "precision")
    assert f"as they stand it is 1, {MAY_BE} 2 of 3" in found.proof
    exact = linear(drift, ca.vertcat(1, -0.0072, 0), [0.0072, 1, 0])
    assert (exact.dimension, exact.decided) == (2, True)
    apart = linear(drift, ca.vertcat(1, -0.0072 - 1e-9, 0), [0.0072, 1, 0])  # w is in y', and as free as c
    assert (apart.dimension, apart.decided) == (1, True)


@pytest.mark.parametrize("seed", range(30))
def test_products_of_typed_numbers_that_cancel_an_input_are_never_decided_wrongly(seed):
    # y = p a + q b and the field (q, -p): w is in no derivative of y + drift (0, c): 2 of 3, y and c, whatever p and q. Typed as products
    # and quotients of decimals, the doubles need not cancel
    generator = np.random.default_rng(seed)
    p, q, scale = (int(each) / 1000 for each in generator.integers(1, 10**6, 3))
    size = 10.0 ** int(generator.integers(-12, 13))
    field = ca.vertcat(ca.SX(q * scale) / scale * size, -(ca.SX(p) * size), 0)
    found = linear([[0, 0, 0], [0, 0, 1], [0, 0, 0]], field, [p, q, 0])
    assert not found.decided or found.dimension == 2
    assert found.dimension <= 2


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("at", [None, [1.0, 2.0]])
def test_an_input_that_comes_one_order_later_is_never_decided_wrongly(seed, at):
    # y = p a + q b, a' = q w, b' = a - p w: y' = q a holds no w, and (p, q), (q, 0) are independent: 2 of 2. Unless p q - q p is 0 as
    # typed w is in y', too: then J_w is triangular, (-q^2) w in y'' beside what rounding leaves of 0, and its last pivot a high power
    generator = np.random.default_rng(seed)
    p, q, scale, divisor = (int(each) / 1000 for each in generator.integers(1, 10**6, 4))
    factor = ca.SX(np.pi) if seed % 4 == 0 else ca.SX(1) / divisor
    x = ca.SX.sym("x", 2)
    field = ca.vertcat(ca.SX(q * scale) * factor, -(ca.SX(p * scale) * factor))
    system = od.ControlAffineSystem(x, ("a", "b"), ca.vertcat(0, x[0]), unknown={"w": field}, outputs={"y": p * x[0] + q * x[1]})
    found = od.observability(system, at=at)
    assert not found.decided or found.dimension == 2
    assert found.dimension <= 2


def test_an_input_that_does_not_reach_an_output_tells_no_other_state():
    # a' = 2 a, b' = g w, d' = h w with 944 h = 5 g: z = -b / 2 + 94.4 d is constant, y' = -10 a + 6 h w tells w if a is known, and no more:
    # 2 of 3, y and z. As doubles z' = e w with e of the size of rounding, and y' less 6 h / e z' would show a: 3
    g, h = ca.SX(-1.3216e-8) * np.pi, ca.SX(-7e-11) * np.pi
    x = ca.SX.sym("x", 3)
    outputs = {"y": -5 * x[0] + 6 * x[2], "z": -0.5 * x[1] + 94.4 * x[2]}
    field = ca.vertcat(0, g, h)
    system = od.ControlAffineSystem(x, ("a", "b", "d"), ca.vertcat(2 * x[0], 0, 0), unknown={"w": field}, outputs=outputs)
    found = od.observability(system)
    assert not found.decided or found.dimension == 2
    assert found.dimension <= 2


@pytest.mark.parametrize("near_one", [1 - 2**-53, 1 + 2**-52, 0.1 + 0.2 - 0.3])
def test_what_is_read_as_zero_or_one_is_no_reason_to_fail(near_one):
    # one output of three states that stand still: 1 of 3, whatever its coefficients
    x = ca.SX.sym("x", 3)
    found = od.observability(od.ControlAffineSystem(x, ("a", "b", "c"), outputs={"y": x[0] + near_one * x[1]}))
    assert (found.dimension, found.decided) == (1, True)


@pytest.mark.parametrize("seed", range(6))
def test_long_numbers_under_several_known_inputs_are_decided(seed):
    # bilinear systems x' = (A_0 + A_1 u_1 + A_2 u_2) x with an unknown input in the last state alone, which no other state hears of and the
    # output does not either: generic matrices of the other states show these, n - 1 of n. No rounding changes that
    generator = np.random.default_rng(seed)
    n = 4
    x = ca.SX.sym("x", n)
    mixing = [np.pad(generator.uniform(-1, 1, (n - 1, n - 1)), (0, 1)) for _ in range(3)]
    drift, first, second = (ca.SX(ca.DM(A)) @ x for A in mixing)
    output = ca.SX(ca.DM(np.append(generator.uniform(0.5, 1, n - 1), 0))).T @ x
    unknown = {"w": ca.vertcat(ca.SX.zeros(n - 1), generator.uniform(0.5, 1))}
    system = od.ControlAffineSystem(x, tuple(f"x{i}" for i in range(n)), drift, {"u": first, "v": second}, unknown, {"y": output})
    found = od.observability(system)
    assert (found.dimension, found.decided) == (n - 1, True)


# ---------------------------------------------------------------- the parts


def random_rows(seed, m, n, rank, radius=0.0):
    """Rows of rank `rank` as balls, products of whole numbers: the same as fractions."""
    generator = np.random.default_rng(seed)
    exact = generator.integers(-5, 6, (m, rank)) @ generator.integers(-5, 6, (rank, n))
    return exact, [[arb(int(entry), radius) for entry in row] for row in exact]


def remainder_of_fractions(J, K, t, pivots):
    """What is left of J + t K when the pivots' columns are cleared, one after another."""
    rows = [[int(a) + t * int(b) for a, b in zip(*pair, strict=True)] for pair in zip(J, K, strict=True)]
    for i, j in pivots:
        rows = [row if k == i else [a - row[j] / rows[i][j] * b for a, b in zip(row, rows[i], strict=True)] for k, row in enumerate(rows)]
    above, across = ({pivot[k] for pivot in pivots} for k in (0, 1))
    return [entry for i, row in enumerate(rows) if i not in above for j, entry in enumerate(row) if j not in across]


@pytest.mark.parametrize("seed", range(30))
def test_what_pivots_leave_and_its_slope_are_those_of_fractions(seed):
    # S(t) = J_22 - J_21 J_11^-1 J_12 of J + t K by elimination of fractions; its slope at 0 by a difference, to t^2 = 1e-30
    generator = np.random.default_rng(seed)
    m, n, count = (int(k) for k in generator.integers([4, 4, 1], [7, 7, 4]))
    J, K = generator.integers(-9, 10, (m, n)), generator.integers(-9, 10, (m, n))
    pivots = [(int(i), int(j)) for i, j in zip(generator.permutation(m)[:count], generator.permutation(n)[:count], strict=True)]
    t = Fraction(1, 10**15)
    try:
        before, at, after = (remainder_of_fractions(J, K, step, pivots) for step in (-t, Fraction(0), t))
    except ZeroDivisionError:
        return
    found = complement_of([[arb(int(entry)) for entry in row] for row in J], pivots)
    fewer = complement_of([[arb(int(entry)) for entry in row] for row in J], pivots[:-1])
    assert found and fewer
    assert [float(entry) for entry in found.value] == pytest.approx([float(entry) for entry in at], abs=1e-9)
    wanted = [float((b - a) / (2 * t)) for a, b in zip(before, after, strict=True)]
    for first in (found, fewer):
        change = arb_mat([[arb(int(entry)) for entry in row] for row in K]) * first.right
        assert [float(entry) for entry in found.slope(change, first)] == pytest.approx(wanted, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("seed", range(30))
def test_a_rank_that_holds_is_one_that_all_matrices_have(seed):
    generator = np.random.default_rng(seed)
    m, n = (int(k) for k in generator.integers(3, 8, 2))
    rank = int(generator.integers(1, min(m, n) + 1))
    exact, rows = random_rows(seed, m, n, rank)
    true = int(np.linalg.matrix_rank(exact))
    assert holds_rank(rows, true)
    assert not holds_rank(rows, true + 1)
    # balls that hold a matrix of lower rank: one that is moved by less than the radius
    narrow, wide = ([[arb(int(entry), size) for entry in row] for row in exact] for size in (1e-12, float(np.abs(exact).max()) + 1))
    assert holds_rank(narrow, true)
    assert not holds_rank(wide, 1)


@pytest.mark.parametrize("seed", range(3))
def test_derivatives_along_directions_are_those_of_the_jacobian(seed):
    x = ca.SX.sym("x", 3)
    system = od.ControlAffineSystem(
        x,
        ("a", "b", "c"),
        ca.vertcat(x[1], ca.sin(x[2]), x[0] * x[1]),
        {"u": ca.vertcat(0, x[0], 1)},
        {"w": ca.vertcat(1, 0, x[2])},
        outputs={"y": x[0], "z": ca.exp(x[1])},
    )
    equations = equations_of(system.model)
    experiments = Experiments(equations, next(random_points(3, seed)), 4, 2, seed)
    generator = np.random.default_rng(seed)
    directions = arb_mat([[arb(int(entry)) for entry in row] for row in generator.integers(-3, 4, (experiments.n_columns, 2))])
    assert (experiments.along(directions) - arb_mat(experiments.rows()) * directions).contains(arb_mat(len(experiments.row_labels), 2))


def test_roots_exist_together_where_each_has_entries_of_its_own():
    # fifteen ranges among as many points: 1 of 32,768 random states has all roots, but each point can be drawn until its own exists
    x = ca.SX.sym("x", 32)
    lengths = [ca.norm_2(x[:2] - x[2 + 2 * i : 4 + 2 * i]) for i in range(15)]
    equations = equations_of(od.ControlAffineSystem(x, tuple(f"x{i}" for i in range(32)), outputs=dict(enumerate_names(lengths))).model)
    for seed in range(5):
        place = random_modular_point(equations, seed)
        assert place.symbols is not None
        assert not place.symbols.has_free_roots
        for i in range(15):
            square = sum((place.state[k] - place.state[2 + 2 * i + k]) ** 2 for k in (0, 1)) % PRIME
            assert pow(square, (PRIME - 1) // 2, PRIME) == 1


def enumerate_names(expressions):
    return ((f"y{i}", expression) for i, expression in enumerate(expressions))


def test_a_large_map_at_a_point_takes_seconds():
    """33 states, bearings and ranges to 15 points of the map, one known and one unknown input: shifts and rotation are hidden."""
    n = 33
    x = ca.SX.sym("x", n)
    away = [(x[3 + 2 * i] - x[0], x[4 + 2 * i] - x[1]) for i in range(15)]
    outputs = {f"bearing{i}": ca.atan2(north, east) - x[2] for i, (east, north) in enumerate(away)}
    outputs |= {f"range{i}": ca.sqrt(east**2 + north**2) for i, (east, north) in enumerate(away)}
    still = ca.SX.zeros(n - 3)
    turn, forward = ca.vertcat(0, 0, 1, still), ca.vertcat(ca.cos(x[2]), ca.sin(x[2]), 0, still)
    system = od.ControlAffineSystem(x, tuple(f"x{i}" for i in range(n)), known={"u": turn}, unknown={"w": forward}, outputs=outputs)
    before = time.process_time()
    found = od.observability(system, at=np.random.default_rng(0).uniform(0.3, 2, n))
    assert (found.dimension, found.decided) == (30, True)
    assert time.process_time() - before < 10
