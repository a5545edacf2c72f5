"""Why something is hidden: the lemmas of Brace and Morgansen where their hypotheses hold, and nowhere else."""

import casadi as ca
import pytest

import obsdesign as od

BEACON = (500.0, 200.0)
SENSORS = {
    "g": od.GPS(sigma=2.0),
    "m": od.Magnetometer(sigma=0.21),
    "r": od.Range(beacon=BEACON, sigma=1.0),
    "b": od.Bearing(beacon=BEACON, sigma=0.087),
}
STRAIGHT = {"turn_rate": 0.0}


def suite(letters):
    return od.System(od.Dubins(speed=15.0, wind="constant"), tuple(SENSORS[letter] for letter in letters))


def kinds(explanation):
    return [reason.kind.name for reason in explanation.reasons]


def test_lemma_1_position_that_is_not_measured():
    # Corollary 2: positions are in no rate; without them in an output they are hidden, and the wind moves nothing but them
    found = od.explain(suite("m"))
    assert kinds(found) == ["MOVES_NOTHING"]
    assert found.reasons[0].states == ("x", "y", "wind_x", "wind_y")


def test_lemmas_3_and_4_gps_on_a_straight_line():
    # four functions x, y and their constant rates for five states; heading behind the wind; a turn mends it
    found = od.explain(suite("g"), held=STRAIGHT)
    assert kinds(found) == ["TOO_FEW_FUNCTIONS", "FORCING", "HELD_INPUTS"]
    functions, forcing, held = found.reasons
    assert functions.count == 4
    assert forcing.states == ("heading", "wind_x", "wind_y")
    assert (held.inputs, held.count) == (("turn_rate",), 5)
    assert "because (2)" in str(found)


def test_one_beacon_is_a_symmetry_and_nothing_else():
    found = od.explain(suite("r"))
    assert kinds(found) == ["SYMMETRY"]
    assert found.reasons[0].states == ("x", "y", "heading", "wind_x", "wind_y")


@pytest.mark.parametrize("letters", ["g", "gm", "mr", "gb", "grb", "gmrb"])
def test_what_is_seen_needs_no_reason(letters):
    assert od.explain(suite(letters)).reasons == ()


def test_a_magnetometer_and_a_linear_position_straight():
    # Lemma 4, case 2: h_1 linear in positions, h_2 = heading: h_1, its rate and heading are 3 functions
    x = ca.SX.sym("x", 5)
    drift = ca.vertcat(x[3] + 15 * ca.cos(x[2]), x[4] + 15 * ca.sin(x[2]), 0, 0, 0)
    outputs = {"along": x[0] + 2 * x[1], "compass": x[2]}
    names = ("p1", "p2", "theta", "c1", "c2")
    found = od.explain(od.ControlAffineSystem(x, names, drift, outputs=outputs))
    assert (kinds(found)[0], found.reasons[0].count) == ("TOO_FEW_FUNCTIONS", 3)
    assert found.verdict.dimension <= 3


def test_the_count_of_functions_bounds_every_dimension():
    # Lemma 2: one output whose derivative of order k < n - 1 vanishes; chains of k integrators in n states
    for n in range(2, 6):
        for k in range(1, n):
            x = ca.SX.sym("x", n)
            drift = ca.vertcat(*(x[i + 1] if i + 1 < k else 0 for i in range(n)))
            found = od.explain(od.ControlAffineSystem(x, tuple(f"s{i}" for i in range(n)), drift, outputs={"y": x[0]}))
            count = next(reason.count for reason in found.reasons if reason.kind.name == "TOO_FEW_FUNCTIONS")
            assert count == found.verdict.dimension == k


def test_unknown_inputs_take_what_they_explain():
    # unicycle, range and known turn rate (TRUTHS A, 4.1): with the speed known as many; straight in unknown wind fewer
    speed = od.System(od.Unicycle(), (od.Range(beacon=BEACON, sigma=1.0),), unknown_inputs=("speed",))
    assert "UNKNOWN_INPUTS" not in kinds(od.explain(speed))
    wind = od.System(od.Dubins(speed=15.0, wind="unknown"), (od.GPS(sigma=2.0),))
    found = od.explain(wind, held=STRAIGHT)
    (reason,) = (reason for reason in found.reasons if reason.kind.name == "UNKNOWN_INPUTS")
    assert (reason.inputs, found.verdict.dimension, reason.count) == (("wind_x", "wind_y"), 2, 3)


@pytest.mark.parametrize("is_map", [False, True])
def test_an_unknown_input_inside_a_sine_takes_what_it_explains(is_map):
    # x moves by sin(w) a, a constant: of x alone a is told where w is known, and not otherwise
    x, w = ca.SX.sym("x", 2), ca.SX.sym("w")
    shared = {"state": x, "names": ("x", "a"), "unknown": {"w": w}, "outputs": {"y": x[0]}}
    change = ca.vertcat(ca.sin(w) * x[1], 0)
    system = od.DiscreteSystem(next_state=x + change, period=1.0, **shared) if is_map else od.GeneralSystem(rates=change, **shared)
    found = od.explain(system)
    (reason,) = (reason for reason in found.reasons if reason.kind.name == "UNKNOWN_INPUTS")
    assert (reason.inputs, found.verdict.dimension, reason.count) == (("w",), 1, 2)


def test_a_singular_point_says_what_is_seen_nearby():
    x = ca.SX.sym("x", 2)
    system = od.ControlAffineSystem(x, ("x", "y"), ca.SX([-1, 0]), outputs={"square": x[0] ** 2 + x[1] ** 2})
    found = od.explain(system, at=[3, 0])
    assert (kinds(found), found.reasons[-1].count) == (["SINGULAR_POINT"], 2)


def test_maps_have_reasons_too():
    x = ca.SX.sym("x", 3)
    step = ca.vertcat(x[0] + x[1], x[1], x[2] * x[0])
    found = od.explain(od.DiscreteSystem(x, ("a", "b", "c"), next_state=step, period=1.0, outputs={"y": x[0]}))
    assert (kinds(found), found.reasons[0].states) == (["MOVES_NOTHING"], ("c",))
