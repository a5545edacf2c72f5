"""Systems whose inputs stand in any place, and maps from one instant to the next."""

from __future__ import annotations

import pickle
import random

import casadi as ca
import numpy as np
import pytest
from jets_by_hand import ByHand, as_casadi, random_polynomial

import obsdesign as od

X = ca.SX.sym("x", 3)
V, TURN, W = (ca.SX.sym(name) for name in ("v", "turn", "w"))
NAMES = ("x", "y", "heading")


def general(rates: ca.SX, outputs: dict[str, ca.SX], inputs: dict[str, ca.SX] | None = None, unknown: dict[str, ca.SX] | None = None):
    """A planar vehicle."""
    return od.GeneralSystem(X, NAMES, rates=rates, outputs=outputs, inputs=inputs or {}, unknown=unknown or {})


def rates(v: ca.SX | float, heading: ca.SX, turn: ca.SX | float) -> ca.SX:
    return ca.vertcat(v * ca.cos(heading), v * ca.sin(heading), turn)


@pytest.mark.parametrize("output", [ca.sumsqr(X[:2]), ca.atan2(X[1], X[0]) - X[2], ca.atan2(X[1], X[0])])
@pytest.mark.parametrize(
    ("unknown", "known_inputs"), [("v", "any"), ("turn", "any"), ("v", "smooth"), ("turn", "smooth"), ("", "any"), ("v turn", "any")]
)
def test_an_affine_rate_has_the_verdict_of_the_affine_system(output: ca.SX, unknown: str, known_inputs):
    symbols = {"v": V, "turn": TURN}
    groups = [{name: symbol for name, symbol in symbols.items() if (name in unknown.split()) is is_unknown} for is_unknown in (False, True)]
    fields = {"v": ca.vertcat(ca.cos(X[2]), ca.sin(X[2]), 0), "turn": ca.vertcat(0, 0, 1)}
    known_fields, unknown_fields = ({name: fields[name] for name in group} for group in groups)
    affine = od.ControlAffineSystem(X, NAMES, None, known_fields, unknown_fields, {"z": output})
    verdicts = [
        od.observability(system, known_inputs=known_inputs)
        for system in (affine, general(rates(V, X[2], TURN), {"z": output}, groups[0], groups[1]))
    ]
    first, second = ((v.dimension, v.observable_states, v.ranks, v.decided, v.stopped_by) for v in verdicts)
    assert first == second


def test_the_input_that_is_an_angle_is_no_field_and_changes_no_verdict():
    # z = (heading + u) is no state: a rotation of everything about the beacon stays hidden whatever the inputs do
    system = general(rates(V**2, X[2] + TURN, V * ca.sin(TURN)), {"range": ca.norm_2(X[:2])}, {"v": V, "turn": TURN})
    verdict = od.observability(system)
    assert (verdict.dimension, verdict.decided) == (2, True)
    assert "known signals v, turn" in verdict.proof
    assert od.observability(system, held={"v": 1.0, "turn": np.pi / 2}).dimension == 2  # straight ahead, sideways


def test_inputs_at_multiples_of_pi_are_those_multiples():
    # x' = sin(u) a: nothing of a is seen where u is a multiple of pi, to the last digit
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    system = od.GeneralSystem(x, ("x", "a"), rates=ca.vertcat(ca.sin(u) * x[1], 0), inputs={"u": u}, outputs={"y": x[0]})
    dimensions = {k: od.observability(system, held={"u": k * np.pi / 12}).dimension for k in (-24, -12, -7, 0, 1, 6, 11, 12, 36)}
    assert dimensions == {k: 1 if k % 12 == 0 else 2 for k in dimensions}


def test_a_product_of_a_known_and_an_unknown_input():
    # y = x, x' = u w a, a constant: u w a is all that is seen, a is free; with y2 = w + ..., that is with w as z' and z read, a is seen
    x, u, w = ca.SX.sym("x", 3), ca.SX.sym("u"), ca.SX.sym("w")
    shared = {"inputs": {"u": u}, "unknown": {"w": w}, "rates": ca.vertcat(u * w * x[1], 0, w)}
    assert od.observability(od.GeneralSystem(x, ("x", "a", "z"), outputs={"x": x[0]}, **shared)).dimension == 1
    assert od.observability(od.GeneralSystem(x, ("x", "a", "z"), outputs={"x": x[0], "z": x[2]}, **shared)).observable


def test_systems_travel_and_are_equal_by_what_they_say():
    first = general(rates(V**2, X[2], TURN), {"z": X[0] * V}, {"v": V}, {"turn": TURN})
    again = pickle.loads(pickle.dumps(first))
    assert again == first
    assert hash(again) == hash(first)
    assert first != general(rates(V**3, X[2], TURN), {"z": X[0] * V}, {"v": V}, {"turn": TURN})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rates": ca.vertcat(X[0], X[1])}, r"rates has shape \(2, 1\): must be \(3, 1\)"),
        ({"rates": ca.vertcat(X[0], X[1], W)}, "contains the free symbol w"),
        ({"unknown": {"w": W}, "outputs": {"z": X[0] + W}}, "contains the unknown input 'w': make it a state"),
        ({"inputs": {"x": V}}, "the name 'x' is used twice"),
        ({"inputs": {"v": X[0]}}, "share a symbol"),
        ({"inputs": {"v": 2 * V}}, r"inputs\['v'\] is .*must be an SX symbol"),
        ({"outputs": {"z": V + 1}}, "does not depend on the state"),
        ({"sigmas": {"b": 1.0}}, "sigmas has no 'b'"),
    ],
)
def test_what_a_system_is_not_made_of(change: dict[str, object], message: str):
    arguments = {"rates": rates(V, X[2], 0.1), "inputs": {"v": V}, "outputs": {"z": X[0]}} | change
    with pytest.raises(od.InputError, match=message):
        od.GeneralSystem(X, NAMES, **arguments)


def random_system(draw: random.Random) -> ByHand:
    """Few states and inputs, monomials in any of them; outputs of states and known inputs."""
    n, m, p = draw.randint(2, 4), draw.randint(0, 2), draw.randint(0, 1)
    width, motion, outputs = n + m + p, [], []
    for _ in range(n):
        motion.append(random_polynomial(draw, range(width), width, draw.randint(0, 2), 3))
    while len(outputs) < 1 + draw.randint(0, 1):
        output = random_polynomial(draw, range(n + m), width, draw.randint(1, 2), 2)
        outputs += [output] if any(any(exponents[:n]) for exponents in output) else []
    return ByHand(n, m, p, motion, outputs)


def as_system(by_hand: ByHand, *, is_map: bool) -> od.GeneralSystem | od.DiscreteSystem:
    x, u, w = (ca.SX.sym(name, size) for name, size in zip("xuw", (by_hand.n, by_hand.m, by_hand.p), strict=True))
    symbols = [symbol for group in (x, u, w) if group.numel() for symbol in ca.vertsplit(group)]
    motion = ca.vertcat(*(as_casadi(polynomial, symbols) for polynomial in by_hand.motion))
    names = tuple(f"x{i}" for i in range(by_hand.n))
    inputs, unknown = ({f"{name}{i}": group[i] for i in range(group.numel())} for name, group in (("u", u), ("w", w)))
    outputs = {f"y{i}": as_casadi(polynomial, symbols) for i, polynomial in enumerate(by_hand.outputs)}
    if is_map:
        return od.DiscreteSystem(x, names, next_state=motion, period=0.5, inputs=inputs, unknown=unknown, outputs=outputs)
    return od.GeneralSystem(x, names, rates=motion, inputs=inputs, unknown=unknown, outputs=outputs)


@pytest.mark.parametrize("is_map", [False, True])
@pytest.mark.parametrize("seed", [pytest.param(seed, marks=[pytest.mark.slow] * (seed >= 5)) for seed in range(60)])
def test_dimensions_are_those_of_jets_counted_anew(seed: int, is_map: bool):
    by_hand = random_system(random.Random(seed))
    orders = by_hand.n + 3 if is_map else 2 * by_hand.n + 3
    for known_inputs, count in (("any", 8 if by_hand.m else 1), ("smooth", 1)):
        verdict = od.observability(as_system(by_hand, is_map=is_map), known_inputs=known_inputs)
        # several runs of a map that is not onto, under one unknown input: no end is proven
        assert verdict.decided or (is_map and by_hand.p and count > 1)
        assert verdict.dimension == by_hand.dimension(orders, count, is_map=is_map)


A, B, C, D = ca.vertsplit(ca.SX.sym("s", 4))
U = ca.SX.sym("u")


def discrete(next_state: list[ca.SX | float], outputs: list[ca.SX], inputs: str = "", unknown: str = "") -> od.DiscreteSystem:
    names, named = tuple("abcd"[: len(next_state)]), {f"y{i}": output for i, output in enumerate(outputs)}
    groups, x = [dict.fromkeys(group, U) for group in (inputs, unknown)], ca.vertcat(A, B, C, D)[: len(next_state)]
    return od.DiscreteSystem(x, names, next_state=ca.vertcat(*next_state), period=1.0, outputs=named, inputs=groups[0], unknown=groups[1])


@pytest.mark.parametrize(
    ("system", "ranks"),
    [
        # c+ = b shows b once more, a+ = 0 then leaves of the second output nothing, and b+ = d shows d at last: a stall is no end
        (discrete([0, D, B, A], [A, A * B, C]), (3, 3, 4)),
        # a chain of delays, read at its end: x_k = (v(k), v(k-1), v(k-2), v(k-3)), one more with every sample
        (discrete([U, A, B, C], [D], "u"), (1, 2, 3, 4)),
        # the same read at its beginning: what was is gone
        (discrete([U, A, B, C], [A], "u"), (1,)),
        # an unknown input into the chain hides nothing of what is on the way
        (discrete([U, A, B, C], [D], unknown="u"), (1, 2, 3, 4)),
        # logistic map with its parameter as a state
        (discrete([B * A * (1 - A), B], [A]), (1, 2)),
        # range to a beacon at the origin of a vehicle that turns: rotation of everything stays hidden
        (discrete([A + ca.cos(C), B + ca.sin(C), C + U], [A**2 + B**2], "u"), (1, 2)),
    ],
)
def test_maps_with_a_dimension_known_by_hand(system: od.DiscreteSystem, ranks: tuple[int, ...]):
    verdict = od.observability(system)
    assert (verdict.ranks, verdict.decided) == (ranks, True)


def test_several_runs_from_one_state_tell_more_than_one_where_all_is_forgotten():
    # y_0 = u a + b, and nothing is left afterwards: two runs under other inputs give both, one run their sum
    system = discrete([0, 0], [U * A + B], "u")
    assert od.observability(system).observable
    assert od.observability(system, known_inputs="smooth").dimension == 1


@pytest.mark.parametrize(("next_state", "dimension"), [(A, 0), (A + 1, 1)])
def test_a_map_at_a_point_where_the_output_is_flat(next_state: ca.SX, dimension: int):
    # y = a^2 at a = 0: seen from the next sample on, if there the state is another
    verdict = od.observability(discrete([next_state], [A**2]), at=[0.0])
    assert (verdict.dimension, verdict.decided) == (dimension, True)


@pytest.mark.parametrize("period", [1.0, 0.1])
@pytest.mark.parametrize("seed", range(4))
def test_linear_systems_sampled_exactly_have_the_rank_of_kalman(seed: int, period: float):
    # z_i' = -r_i z_i and y = z_1 + z_2 without z_3, in mixed coordinates: rank 2 of 3 for every period, 3 with z_3 in y.
    # r_i T = log 2, log 4, log 8: the sampled matrix is dyadic; T = 0.1: its entries are rounded, so that 3 may not be claimed of it
    random_numbers = np.random.default_rng(seed)
    lower, upper = (np.eye(3, dtype=int) + np.tril(random_numbers.integers(-2, 3, (3, 3)), -1) for _ in range(2))
    vectors = lower @ upper.T  # unimodular
    inverse = np.rint(np.linalg.inv(vectors))
    decay = np.diag(0.5 ** (np.arange(1, 4) * period))
    x = ca.SX.sym("x", 3)
    blind, seeing = (
        od.DiscreteSystem(x, ("a", "b", "c"), next_state=ca.DM(inverse @ decay @ vectors) @ x, period=period, outputs={"y": row @ x})
        for row in (ca.DM(vectors[:2].sum(axis=0)).T, ca.DM(vectors.sum(axis=0)).T)
    )
    assert od.observability(seeing).observable
    verdict = od.observability(blind)
    assert (verdict.dimension, verdict.decided) == (2, period == 1.0)


def test_constants_of_a_rate_are_not_rounded_together():
    # a' = (0.1 + 0.2 u) c and b' = 0.2 u c + 0.1 c are one rate: of a - b alone nothing but a - b is seen, and that is decided
    x, u = ca.SX.sym("x", 3), ca.SX.sym("u")
    rate = ca.vertcat((0.1 + 0.2 * u) * x[2], 0.2 * u * x[2] + 0.1 * x[2], 0)
    general = od.GeneralSystem(x, ("a", "b", "c"), rates=rate, inputs={"u": u}, outputs={"y": x[0] - x[1]})
    affine = od.ControlAffineSystem.from_rate(x, ("a", "b", "c"), rate, {"u": u}, outputs={"y": x[0] - x[1]})
    for system in (general, affine):
        verdict = od.observability(system)
        assert (verdict.dimension, verdict.decided) == (1, True)


V1, V2 = ca.SX.sym("v1"), ca.SX.sym("v2")


@pytest.mark.parametrize(
    ("next_state", "output", "p", "dimension"),
    [
        # one run tells b, two tell a by their third sample, though up to the second they tell nothing more than one, of w neither
        ((-3 * A - 3 * B**2 + U * B, 3 * A + 3 * V1 * B), B, 1, 2),
        # two runs tell no more of the state than one, but something of two unknown inputs: four tell the state
        ((3 * A - 2 * A * B - 2 * V1 * B, 3 * A * C + A * B + 3 * V1 * A, U * B**2 + V2 * B), B * C, 2, 3),
    ],
)
def test_as_many_runs_as_it_takes(next_state: tuple[ca.SX, ...], output: ca.SX, p: int, dimension: int):
    unknown = {"v1": V1, "v2": V2} if p == 2 else {"v1": V1}
    x, names = ca.vertcat(A, B, C)[: len(next_state)], tuple("abc"[: len(next_state)])
    system = od.DiscreteSystem(
        x, names, next_state=ca.vertcat(*next_state), period=1.0, inputs={"u": U}, unknown=unknown, outputs={"y": output}
    )
    verdict = od.observability(system)
    assert (verdict.dimension, verdict.decided) == (dimension, True)


def test_a_map_at_a_point_that_rests_without_inputs():
    # a_k = sum of u, b constant, y = a b: at (0, 0) every y_k changes with b alone, from the second sample on; nearby both are seen
    system = discrete([A + U, B], [A * B], "u")
    verdict = od.observability(system, at=[0.0, 0.0])
    assert (verdict.dimension, verdict.ranks, verdict.observable_states, verdict.decided) == (1, (0, 1), ("b",), True)
    assert od.observability(system).dimension == 2


def test_a_map_at_a_point_where_no_more_is_seen_than_elsewhere():
    # c is seen nowhere, and where the solution goes from (1, 2, 3) is not asked: no point shows more than random ones
    verdict = od.observability(discrete([A + B, A * B, C * A], [A]), at=[1.0, 2.0, 3.0])
    assert (verdict.dimension, verdict.stopped_by, verdict.decided) == (2, "cap", True)
