"""Where along a path the motion hides the state: closed forms of Belo, Salaris and Bicchi 2010 and of Brace and Morgansen."""

import casadi as ca
import numpy as np
import pytest
from matplotlib.collections import QuadMesh

import obsdesign as od

RADIUS, SPEED, STEP, PHASE = 2.0, 0.6, 0.05, 20
LANDMARKS = ((2.0, 0.0), (-1.0, 3**0.5), (-1.0, -(3**0.5)))  # on the circle of radius 2 about the origin: TRUTHS D
SLIPS = np.array([0.1, -0.05, 0.02])
BEARINGS = tuple(od.Bearing(beacon=landmark, sigma=0.01) for landmark in LANDMARKS)
SYSTEM = od.System(od.Omnidirectional("constant"), BEARINGS)


def through_the_circle(angle, turn_sign=1.0):
    """In along a radius, round the circle counter-clockwise, out along a tangent: 1 s each; turn_sign -1: turning against it."""
    inward, tangent = -np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    start = -inward * (RADIUS + SPEED * STEP * PHASE)
    heading = np.arctan2(tangent[1], tangent[0])  # left of the tangent lies the centre
    velocities = np.repeat([[0.0, SPEED, 0.0], [SPEED, 0.0, turn_sign * SPEED / RADIUS], [SPEED, 0.0, 0.0]], PHASE, axis=0)
    return od.simulate(SYSTEM, (*start, heading, *SLIPS), velocities - SLIPS, STEP)


@pytest.mark.parametrize("angle", [0.7, -1.2])
def test_a_path_that_enters_follows_and_leaves_the_circle_is_hidden_while_it_follows(angle):
    # crossing radially, and leaving along the tangent, hide nothing; along C all bearings stay if the heading turns half as fast
    path = through_the_circle(angle)
    found = od.singularities(SYSTEM, path)
    (interval,) = found.hidden
    assert (interval.start, interval.end) == pytest.approx((1.0, 2.0))
    assert (interval.rank, interval.null_space.shape) == (5, (6, 1))
    assert list(found.rank) == [6] * PHASE + [5] * PHASE + [6] * PHASE
    x, y = path.x[PHASE + PHASE // 2, :2]
    slide = np.array([-y, x, 0.5, 0.0, SPEED / 2, 0.0])  # the velocity over ground is forward: turned by half the angle
    assert abs(interval.null_space[:, 0] @ slide) == pytest.approx(np.linalg.norm(slide))
    assert found.circle is not None
    assert np.abs(found.circle.residuals[PHASE : 2 * PHASE]).max() < 1e-9
    assert np.abs(found.circle.residuals[PHASE + PHASE + 1 :, 1]).min() > 1e-3
    # Belo's relation (8), velocity over turn rate, is the radius here, and 0/0 for its derivatives
    assert np.allclose(found.circle.paper_relation[PHASE : 2 * PHASE, 0], RADIUS)


@pytest.mark.parametrize("orders", [2, 5])
def test_more_derivatives_see_no_more_on_the_circle(orders):
    assert [each.rank for each in od.singularities(SYSTEM, through_the_circle(0.7), orders).hidden] == [5]


def test_one_derivative_is_too_few_where_the_path_crosses_the_circle():
    # TRUTHS D: on C radially 4 or 5 with one derivative, 6 with two
    path = through_the_circle(0.7)
    assert od.singularities(SYSTEM, path, 1).rank[PHASE] < 6
    assert (
        od.singularities(
            SYSTEM, od.Trajectory(path.t[PHASE - 1 : PHASE + 1], path.x[PHASE - 1 : PHASE + 1], path.u[PHASE - 1 : PHASE])
        ).hidden
        == ()
    )


def test_turning_the_other_way_on_the_circle_hides_nothing():
    # omega = -v / r: relation (8) holds, and the state is seen
    path = through_the_circle(0.7, turn_sign=-1.0)
    found = od.singularities(SYSTEM, path)
    assert found.hidden == ()
    assert found.circle is not None
    assert found.circle.paper_relation[PHASE, 0] == pytest.approx(-RADIUS)


def test_every_rank_along_a_path_is_the_exact_one():
    # where the verdict is asked at the state itself, with the inputs held
    path = through_the_circle(0.5)
    found = od.singularities(SYSTEM, path)
    for k in (0, 7, 2 * PHASE + 9):
        held = dict(zip(SYSTEM.model.input_names, path.u[k].round(9), strict=True))
        assert found.rank[k] == od.observability(SYSTEM, at=path.x[k], held=held).dimension


def test_straight_legs_hide_the_wind_behind_the_heading():
    # TRUTHS E: GPS alone, straight: (0, 0, 1, v sin theta, -v cos theta)
    system = od.System(od.Dubins(speed=15.0, wind="constant"), (od.GPS(sigma=2.0),))
    turn_rates = np.repeat([0.0, 0.3, 0.0], 20)[:, None]
    path = od.simulate(system, (0.0, 0.0, 0.4, 3.0, -2.0), turn_rates, 0.25)
    found = od.singularities(system, path)
    assert [(each.start, each.end) for each in found.hidden] == [(0.0, 5.0), (10.0, 15.0)]
    for each, heading in zip(found.hidden, (0.4, 0.4 + 0.3 * 5), strict=True):
        direction = np.array([0, 0, 1, 15 * np.sin(heading), -15 * np.cos(heading)])
        assert abs(each.null_space[:, 0] @ direction) == pytest.approx(np.linalg.norm(direction))


def test_unknown_inputs_are_projected_out():
    # x' = w, v' = 0, outputs x and x + v: the second is told whatever w is; x' = v + w, output x alone: v is not
    x = ca.SX.sym("x", 2)
    field = {"w": ca.SX(ca.vertcat(1, 0))}
    path = od.Trajectory(np.arange(5.0), np.ones((5, 2)), np.zeros((4, 0)))
    both = od.ControlAffineSystem(x, ("x", "v"), unknown=field, outputs={"a": x[0], "b": x[0] + x[1]})
    assert list(od.singularities(both, path).rank) == [2] * 4
    alone = od.ControlAffineSystem(x, ("x", "v"), ca.vertcat(x[1], 0), unknown=field, outputs={"a": x[0]})
    found = od.singularities(alone, path)
    assert list(found.rank) == [1] * 4
    assert np.allclose(np.abs(found.hidden[0].null_space[:, 0]), [0, 1])
    assert np.allclose(found.sigma_min, 0)


def test_the_smallest_singular_value_of_a_linear_system_in_closed_form():
    # x' = v, y = x / sigma, T = 3: rows (1, 0) and (0, 3) over sigma
    x = ca.SX.sym("x", 2)
    system = od.ControlAffineSystem(x, ("x", "v"), ca.vertcat(x[1], 0), outputs={"y": x[0]}, sigmas={"y": 0.5})
    path = od.Trajectory(np.arange(3.0), np.ones((3, 2)), np.zeros((2, 0)))
    found = od.singularities(system, path, 1, unit_time=3.0, scale=(1.0, 10.0))
    assert np.allclose(found.sigma_min, 2.0)
    assert np.allclose(od.singularities(system, path, 1, unit_time=3.0, scale=(1.0, 0.1)).sigma_min, 0.6)


def test_a_map_has_no_derivatives():
    x = ca.SX.sym("x", 1)
    system = od.DiscreteSystem(x, ("x",), next_state=x, period=1.0, outputs={"y": x[0]})
    path = od.Trajectory(np.arange(3.0), np.ones((3, 1)), np.zeros((2, 0)))
    with pytest.raises(od.InputError, match="no derivatives"):
        od.singularities(system, path)


# ---------------------------------------------------------------- positions


def test_the_singular_set_is_where_the_circle_is_followed():
    # Belo, figure 2: heading and velocities as they are; two points of C have the motion for tangent, and at one of them it follows C
    heading, omega = 0.3, SPEED / RADIUS
    place = RADIUS * np.array([np.sin(heading), -np.cos(heading)])  # the centre lies to the left
    for sign in (1.0, -1.0):
        positions = od.singular_set(
            SYSTEM,
            (0.0, 0.0, heading, *SLIPS),
            np.array([SPEED, 0.0, omega]) - SLIPS,
            east=(sign * place[0] - 0.5, sign * place[0] + 0.5),
            north=(sign * place[1] - 0.5, sign * place[1] + 0.5),
            points=11,
        )
        row, column = np.unravel_index(positions.nearness.argmin(), positions.nearness.shape)
        is_at_place = np.allclose([positions.x[column], positions.y[row]], sign * place)
        assert (is_at_place and positions.nearness.min() < 1e-12) == (sign == 1.0)
    assert positions.circle is not None
    assert positions.circle.radius == pytest.approx(RADIUS)
    (mesh,) = (each for each in od.figures.singular(positions).axes[0].collections if isinstance(each, QuadMesh))
    values = mesh.get_array()
    assert values is not None
    assert values.size == positions.nearness.size


RANGE_AND_HEADING = (od.Range(beacon=(2.0, 0.0), sigma=1.0), od.Magnetometer(sigma=0.1))


@pytest.mark.parametrize(
    ("system", "at"),
    [
        (SYSTEM, (0.0, 0.0, 0.3, *SLIPS)),
        (od.System(od.Unicycle(), RANGE_AND_HEADING, unknown_inputs=("speed",)), (0.0, 0.0, 0.3)),
    ],
)
def test_positions_without_an_output_have_no_value(system, at):
    positions = od.singular_set(system, at, east=(1.0, 3.0), north=(-1.0, 1.0), points=3)
    assert np.isnan(positions.nearness[1, 1])
    assert np.isfinite(positions.nearness).sum() == 8


@pytest.mark.parametrize("unknown", [(), ("speed",)])
def test_a_path_through_a_landmark_is_refused_at_the_step_where_it_meets_it(unknown):
    # 5 m/s from 20 m ahead of the beacon: there after 4 s, where |beacon - position| has no derivative
    system = od.System(od.Unicycle(), RANGE_AND_HEADING, unknown_inputs=unknown)
    speeds, turn_rates = np.full((40, 1), 5.0), np.zeros((40, 1))
    u, w = (turn_rates, speeds) if unknown else (np.hstack([speeds, turn_rates]), None)
    path = od.simulate(system, (-18.0, 0.0, 0.0), u, 0.25, w)
    with pytest.raises(od.InputError, match=r"no derivatives at step 16 \(t = 4 s\)"):
        od.singularities(system, path)


def test_straight_at_a_beacon_the_sideways_place_is_hidden_until_the_vehicle_turns():
    # beside the line by e the range is sqrt(s^2 + e^2), of first order 0 in e; off it, range, its rate and the heading tell three states
    system = od.System(od.Unicycle(), (od.Range(beacon=(100.0, 0.0), sigma=1.0), od.Magnetometer(sigma=0.1)))
    path = od.simulate(system, (0.0, 0.0, 0.0), np.repeat([[5.0, 0.0], [5.0, 0.3]], 20, axis=0), 0.25)
    found = od.singularities(system, path)
    (interval,) = found.hidden
    assert (interval.start, interval.end, interval.rank) == (0.0, 5.0, 2)
    assert np.abs(interval.null_space[:, 0]) == pytest.approx([0.0, 1.0, 0.0], abs=1e-9)
