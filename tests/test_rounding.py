"""What is nearly singular within the rounding of the numbers given: the exact rank, and the rank of a point within rounding."""

import casadi as ca
import numpy as np
import pytest

import obsdesign as od

STRAIGHT = {"turn_rate": 0.0}
WITHIN = "within the rounding of the numbers given it is"


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
    assert f"as they stand it is 2, {WITHIN} 1 of 3" in found.proof
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
    assert f"as they stand it is 2, {WITHIN} 1 of 2" in found.proof
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
    assert f"as they stand it is 1, {WITHIN} 2 of 3" in found.proof
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
