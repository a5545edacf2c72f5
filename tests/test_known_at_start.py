"""States that are known at the instant that is asked about: their unit covectors join what the outputs tell, once."""

from __future__ import annotations

import random

import casadi as ca
import numpy as np
import pytest
from test_general_systems import as_system, random_system
from test_unknown_inputs import hiv

import obsdesign as od

X = ca.SX.sym("x", 3)
V, TURN = ca.SX.sym("v"), ca.SX.sym("turn")
RANGE = {"range": ca.sumsqr(X[:2])}


def vehicle(outputs: dict[str, ca.SX], unknown: str = "") -> od.GeneralSystem:
    groups = [{name: s for name, s in (("v", V), ("turn", TURN)) if (name in unknown) is kind} for kind in (False, True)]
    rates = ca.vertcat(V * ca.cos(X[2]), V * ca.sin(X[2]), TURN)
    return od.GeneralSystem(X, ("x", "y", "heading"), rates=rates, outputs=outputs, inputs=groups[0], unknown=groups[1])


@pytest.mark.parametrize("unknown", ["", "turn"])
@pytest.mark.parametrize("names", [("heading",), ("x",), ("y",), ("x", "y")])
def test_one_state_tells_the_rotation_about_a_beacon(names: tuple[str, ...], unknown: str):
    # hidden: (-y, x, 1); any one entry of it, which is not 0, gives it away
    verdict = od.observability(vehicle(RANGE, unknown), known_at_start=names)
    assert (verdict.dimension, verdict.decided, verdict.stopped_by) == (3, True, "full")
    assert not verdict.null_space.size


@pytest.mark.parametrize(("name", "dimension"), [("x", 2), ("y", 3)])
def test_not_where_that_entry_is_0(name: str, dimension: int):
    verdict = od.observability(vehicle(RANGE), at=[1.0, 0.0, 0.3], known_at_start=(name,))
    assert (verdict.dimension, verdict.decided) == (dimension, True)


def test_a_compass_with_a_known_start_is_dead_reckoning():
    compass = vehicle({"compass": X[2]})
    dimensions = [od.observability(compass, known_at_start=names).dimension for names in ((), ("heading",), ("x",), ("y", "x"))]
    assert dimensions == [1, 1, 2, 3]
    assert od.observability(compass, known_at_start=("x",)).observable_states == ("x", "heading")


def test_what_is_known_at_the_start_is_not_read_later():
    # x' = s, s' = 0: x read tells s, x known at the start does not
    system = od.GeneralSystem(X, ("x", "s", "z"), rates=ca.vertcat(X[1], 0, 0), outputs={"y": X[2]})
    verdict = od.observability(system, known_at_start=("x",))
    assert (verdict.dimension, verdict.unobservable_states, verdict.decided) == (2, ("s",), True)


def test_of_a_sum_of_constants_all_but_one_are_to_be_known():
    system = od.GeneralSystem(X, ("a", "b", "c"), rates=ca.SX.zeros(3), outputs={"sum": ca.sum1(X)})
    assert [od.observability(system, known_at_start=tuple("abc"[:k])).dimension for k in range(4)] == [1, 2, 3, 3]
    assert np.allclose(abs(od.observability(system, known_at_start=("a",)).null_space.ravel()), [0, 0.5**0.5, 0.5**0.5])


def test_where_the_output_is_flat():
    x = ca.SX.sym("x")
    system = od.GeneralSystem(x, ("x",), rates=0 * x, outputs={"y": x**2})
    assert [od.observability(system, at=[0.0], known_at_start=names).dimension for names in ((), ("x",))] == [0, 1]


def test_the_one_that_the_virus_hides():
    # of TU, TI, del, N one direction is hidden (7 of 8): each of them, known at the start, tells the others
    for name in ("TU", "TI", "del", "N"):
        assert od.observability(hiv(unknown=True), known_at_start=(name,)).dimension == 8
    for name in ("V", "lam", "rho", "c"):
        assert od.observability(hiv(unknown=True), known_at_start=(name,)).dimension == 7


@pytest.mark.parametrize("is_map", [False, True])
@pytest.mark.parametrize("seed", range(40, 45))
def test_against_unit_rows_among_jets_counted_anew(seed: int, is_map: bool):
    draw = random.Random(seed)
    by_hand = random_system(draw)
    places = sorted(draw.sample(range(by_hand.n), draw.randint(1, 2)))
    verdict = od.observability(as_system(by_hand, is_map=is_map), known_at_start=tuple(f"x{i}" for i in places))
    orders, count = (by_hand.n + 3 if is_map else 2 * by_hand.n + 3), 8 if by_hand.m else 1
    assert verdict.decided
    assert verdict.dimension == by_hand.dimension(orders, count, is_map=is_map, known=places)


def test_a_name_that_is_no_state():
    with pytest.raises(od.InputError, match=r"known_at_start has no 'z' \(accepted: x, y, heading\)"):
        od.observability(vehicle(RANGE), known_at_start=("z",))


def test_time_is_a_state_known_at_the_start():
    # y = a cos t + b sin t with t' = 1: the phase of a, b is hidden until time is known
    t, a, b = ca.SX.sym("t"), ca.SX.sym("a"), ca.SX.sym("b")
    x = ca.vertcat(t, a, b)
    system = od.GeneralSystem(x, ("t", "a", "b"), rates=ca.vertcat(1, 0, 0), outputs={"y": a * ca.cos(t) + b * ca.sin(t)})
    assert [od.observability(system, known_at_start=names).dimension for names in ((), ("t",))] == [2, 3]
