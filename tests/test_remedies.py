"""What mends an unobservable suite: the figures of Brace and Morgansen (TRUTHS E), by brute force over what is offered."""

from itertools import combinations

import casadi as ca
import pytest

import obsdesign as od

BEACON = (500.0, 200.0)
SENSORS = (od.GPS(sigma=2.0), od.Magnetometer(sigma=0.21), od.Range(beacon=BEACON, sigma=1.0), od.Bearing(beacon=BEACON, sigma=0.087))
SYSTEM = od.System(od.Dubins(speed=15.0, wind="constant"), SENSORS)
NAMES = ("gps", "magnetometer", "range", "bearing")
STRAIGHT = {"turn_rate": 0.0}
SEES_STRAIGHT = [  # TRUTHS E, column D straight: the suites that see all 5
    {"gps", "magnetometer"},
    {"gps", "bearing"},
    {"gps", "magnetometer", "range"},
    {"gps", "magnetometer", "bearing"},
    {"gps", "range", "bearing"},
    {"magnetometer", "range", "bearing"},
    set(NAMES),
]
SEES_TURNING = [{"gps"}, {"magnetometer", "range"}, {"magnetometer", "bearing"}]


def sees(suite, is_turning):
    """TRUTHS E: whether a suite sees all, as the smallest that do are part of it."""
    return any(smaller <= suite for smaller in (SEES_TURNING if is_turning else []) + SEES_STRAIGHT)


@pytest.mark.parametrize(
    "suite", [set(suite) for count in (1, 2) for suite in combinations(NAMES, count)], ids=lambda suite: "+".join(sorted(suite))
)
def test_remedies_are_the_smallest_sets_of_the_paper(suite):
    # straight: any set of other sensors and of the manoeuvre that mends it and holds no smaller one
    found = od.remedies(SYSTEM, held=STRAIGHT, sensors=sorted(suite), at_once=3)
    options = [*(name for name in NAMES if name not in suite), "turn_rate"]
    every = [set(chosen) for count in range(1, 4) for chosen in combinations(options, count)]
    mends = [chosen for chosen in every if sees(suite | (chosen - {"turn_rate"}), "turn_rate" in chosen)]
    smallest = [chosen for chosen in mends if not any(smaller < chosen for smaller in mends)]
    if sees(suite, False):
        smallest = []
    assert sorted(map(sorted, ({*each.sensors, *each.released} for each in found.cheapest))) == sorted(map(sorted, smallest))
    assert all(each.verdict.observable and each.verdict.decided for each in found.cheapest)
    assert [each.cost for each in found.cheapest] == sorted(each.cost for each in found.cheapest)


def test_what_costs_more_comes_later():
    found = od.remedies(SYSTEM, held=STRAIGHT, sensors=["gps"], costs={"turn_rate": 0.5, "bearing": 3.0})
    assert [(each.in_words, each.cost) for each in found.cheapest] == [
        ("let turn_rate vary", 0.5),
        ("add magnetometer", 1.0),
        ("add bearing", 3.0),
    ]


def test_ready_made_sensors_are_offered_where_nothing_else_is():
    # one beacon turns about itself: whatever tells a direction of the map mends it
    found = od.remedies(od.System(od.Dubins(speed=15.0, wind="constant"), (SENSORS[2],)), at_once=1)
    assert set(found.offered) == {"gps", "magnetometer", "speed_over_ground", "course", "bearing"}
    assert {each.sensors for each in found.cheapest} == {("gps",), ("magnetometer",), ("course",)}


def test_of_a_ready_made_sensor_is_said_to_which_beacon_it_looks():
    """Directions to two beacons leave the vehicle anywhere on a circle through both; the distance to either tells where on it."""
    beacons = ((2.0, 0.0), (-1.0, 3.0))
    system = od.System(
        od.Omnidirectional(),
        tuple(od.Bearing(beacon=place, sigma=0.02) for place in beacons),
        unknown_inputs=("forward", "sideways", "turn_rate"),
    )
    words = [each.in_words for each in od.remedies(system, at_once=1).cheapest]
    assert {"add range to the beacon at (2, 0) m", "add range_2 to the beacon at (-1, 3) m"} <= set(words)
    assert all("beacon" in each for each in words if "range" in each)


def test_a_system_of_ones_own_is_offered_measurements_of_its_states():
    # only the product of two constants shows: either of them mends it
    x = ca.SX.sym("x", 3)
    system = od.ControlAffineSystem(x, ("s", "a", "b"), ca.vertcat(x[1] * x[2] * x[0], 0, 0), outputs={"y": x[0]})
    found = od.remedies(system)
    assert [each.sensors for each in found.cheapest] == [("measure a",), ("measure b",)]
    assert "add measure a" in str(found)


def test_only_what_is_asked_about_has_to_be_seen():
    found = od.remedies(SYSTEM, held=STRAIGHT, sensors=["magnetometer"], about=["x", "y"], at_once=1)
    assert {each.sensors for each in found.cheapest} == {("gps",)}
    assert od.remedies(SYSTEM, sensors=["magnetometer"], about=["heading"]).cheapest == ()
    assert "all of it is seen" in str(od.remedies(SYSTEM))


def test_nothing_mends_what_no_offer_reaches():
    x = ca.SX.sym("x", 2)
    system = od.ControlAffineSystem(x, ("a", "b"), outputs={"y": x[0], "z": x[0] ** 2})
    found = od.remedies(system, sensors=["y"])
    assert found.cheapest == ()
    assert "none mends it" in str(found)


def test_bad_input_names_what_is_wrong():
    with pytest.raises(od.InputError, match="sonar"):
        od.remedies(SYSTEM, sensors=["sonar"])
    with pytest.raises(od.InputError, match="costs"):
        od.remedies(SYSTEM, sensors=["gps"], costs={"bearing": -1.0})
    x = ca.SX.sym("x", 2)
    with pytest.raises(od.InputError, match="ready-made"):
        od.remedies(od.ControlAffineSystem(x, ("a", "b"), outputs={"y": x[0]}), offered=SENSORS)


def test_a_sensor_that_reads_nothing_at_the_point_mends_nothing():
    """At rest there is no course over ground; GPS and a compass still tell all."""
    system = od.System(od.Unicycle(), (od.Range((3.0, 4.0), 1.0),))
    answer = od.remedies(
        system, at=[0.0, 0.0, 0.2], held={"speed": 0.0, "turn_rate": 0.0}, offered=(od.Course(0.1), od.GPS(2.0), od.Magnetometer(0.1))
    )
    assert [remedy.sensors for remedy in answer.cheapest if not remedy.released] == [("gps", "magnetometer")]
