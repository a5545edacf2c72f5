"""Systems whose inputs stand in any place, and maps from one instant to the next."""

from __future__ import annotations

import pickle

import casadi as ca
import numpy as np
import pytest

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
@pytest.mark.parametrize("unknown", ["", "v", "turn", "v turn"])
@pytest.mark.parametrize("known_inputs", ["any", "smooth"])
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
