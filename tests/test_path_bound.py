"""No path is above the bound, every path's own Gram matrix keeps the relaxation's constraints, and wrong certificates are refused."""

from __future__ import annotations

import json
from dataclasses import asdict, replace

import casadi as ca
import mpmath
import numpy as np
import pytest
from gram_vectors import gram_vectors, shortfalls

import obsdesign as od
from benchmarks.missions import mission, plateau
from obsdesign.design.path_bound.arcs import arcs_of
from obsdesign.design.path_bound.gram_constraints import largest_chord_turn
from obsdesign.design.path_bound.motion import motion_of
from obsdesign.design.path_bound.proof import path_bound_of
from obsdesign.design.path_bound.relaxation import relaxation_of
from obsdesign.design.path_bound.sample_bounds import nearest_distances, readings_of

ROUNDING = 1e-13  # of squares of vectors of length 1


VELOCITIES = (od.VelocityLog(0.8, mounting_angle=0.3), od.SpeedOverGround(0.5), od.Course(0.4, rate=0.5), od.Airspeed(0.3))


def short_mission(**changes) -> od.DesignProblem:
    """12 turn rates of 3 steps each, GPS and compass, in wind."""
    asked = {
        "system": od.System(od.Dubins(2.0, wind="constant"), (od.GPS(1.5), od.Magnetometer(0.5))),
        "start": (3.0, -2.0, 0.4, 0.5, -0.3),
        "duration": 18.0,
        "step": 0.5,
        "path": od.PiecewiseConstant(12),
        "bounds": {"turn_rate": (-0.4, 0.4)},
        "scale": (5.0, 5.0, 0.2, 1.0, 1.0),
    }
    return od.DesignProblem(**(asked | changes))


def parameters(problem: od.DesignProblem, random: np.random.Generator) -> np.ndarray:
    """Random ones, all at their limits, or switching between them."""
    lower, upper = problem.path.box(problem.grid)
    kind = random.integers(3)
    if kind == 0:
        return random.uniform(lower, upper)
    wave = np.sin(np.linspace(0, random.uniform(1, 40), len(lower)) + random.uniform(0, 6))
    return np.where((random.uniform(size=len(lower)) < 0.5) if kind == 1 else wave > 0, lower, upper)


def variants() -> dict[str, od.DesignProblem]:
    """Problems of every kind that the relaxation takes."""
    no_wind = {"start": (3.0, -2.0, 0.4), "scale": (5.0, 5.0, 0.2)}
    beacon = (60.0, 20.0)
    sighted = (od.Range(beacon, 1.0, sigma_per_metre=0.01), od.Bearing((4.0, 6.0), 0.1), od.GPS(3.0, rate=1.0, correlation=0.3))
    known = np.diag([0.02, 0.03, 4.0, 1.0, 2.0]) + 0.01
    return {
        "GPS and compass": short_mission(),
        "velocities": short_mission(system=od.System(od.Dubins(2.0, wind="constant"), (od.GPS(1.5), *VELOCITIES))),
        "velocities at any speed": short_mission(
            system=od.System(od.Unicycle(wind="constant"), (od.GPS(1.5, rate=1.0), *VELOCITIES)),
            bounds={"speed": (1.0, 2.5), "turn_rate": (-0.4, 0.4)},
        ),
        "velocities in still water": short_mission(
            system=od.System(od.Dubins(2.0), (od.GPS(1.5), *VELOCITIES)), start=(3.0, -2.0, 0.4), scale=(5.0, 5.0, 0.2)
        ),
        "one step pieces": short_mission(path=od.PiecewiseConstant(36)),
        "pieces of unequal length": short_mission(path=od.PiecewiseConstant(13)),
        "coarse steps": short_mission(duration=36.0, step=1.0, bounds={"turn_rate": (-0.9, 0.7)}),
        "spline": short_mission(path=od.BSpline(6)),
        "slow and fast": short_mission(
            system=od.System(od.Unicycle(wind="constant"), (od.GPS(1.5),)), bounds={"turn_rate": (-0.4, 0.4), "speed": (1.0, 2.0)}
        ),
        "forth and back": short_mission(
            system=od.System(od.Unicycle(), (od.GPS(1.5),)), bounds={"turn_rate": (-0.4, 0.4), "speed": (-1.0, 2.0)}, **no_wind
        ),
        "sideways": short_mission(
            system=od.System(od.Omnidirectional(), (od.GPS(1.5),)),
            bounds={"turn_rate": (-0.4, 0.4), "forward": (-1.0, 2.0), "sideways": (-1.0, 0.5)},
            **no_wind,
        ),
        "beacons": short_mission(
            system=od.System(od.Dubins(2.0, wind="constant"), sighted), constraints=(od.StandOff(2.0, landmarks=((4.0, 6.0),)),)
        ),
        "joint noise": short_mission(
            system=od.System(
                od.Dubins(2.0, wind="constant"),
                (od.GPS(1.0), od.Magnetometer(0.2, inflation=1.5)),
                joint_noise={("gps", "magnetometer"): [[1.0, 0.3, 0.1], [0.3, 2.0, 0.0], [0.1, 0.0, 0.04]]},
            )
        ),
        "something known": short_mission(known=known),
        "half of it": short_mission(weights=np.array([[1.0, 0.0], [0.3, 1.0]]), scale=(5.0, 4.0, 0.2, 1.0, 1.1)),
        "about some": short_mission(about=("x", "y", "heading")),
        "log det": short_mission(criterion=od.LogDet()),
        "trace inverse": short_mission(criterion=od.TraceInverse(), known=np.diag([0.0, 0.0, 1.0, 0.0, 0.0])),
    }


VARIANTS = variants()


@pytest.mark.parametrize("name", VARIANTS)
def test_every_path_keeps_the_constraints_and_has_at_least_the_form_of_its_value(name):
    problem, random = VARIANTS[name], np.random.default_rng(4)
    relaxation, proof = relaxation_of(problem), path_bound_of(problem)
    assert np.isfinite(proof.bound)
    assert od.check_path_bound(problem, proof.certificate) == proof.bound
    for _ in range(12):
        path = problem.path_of(parameters(problem, random))
        vectors = gram_vectors(problem, relaxation, path)
        assert shortfalls(relaxation, vectors).max() <= ROUNDING
        if all(np.hypot(*(path.x[:, :2] - (4.0, 6.0)).T).min() > limit.distance for limit in problem.constraints):
            assert problem.value(path) <= proof.bound
            assert form_over_threshold(relaxation, vectors, problem.value(path)) > 0


def form_over_threshold(relaxation, vectors, value) -> float:
    """How far the form of a path lies above the threshold of a level just below its value's: what the proof rests on."""
    form = relaxation.form
    if form.kind is od.LogDet:
        level = np.exp(value - 2 * np.linalg.slogdet(form.M)[1])
    elif form.kind is od.TraceInverse:
        level = 1 / (-value - 2 * np.trace(np.linalg.inv(form.M)))
    else:
        level = value
    share = relaxation.share(level)
    level *= (1 - share) / (1 + share) if form.kind is od.TraceInverse else 1 / (1 + share)
    level *= 1 - 1e-9
    K = relaxation.gain(level)
    total = np.sum((form.matrix(K) - level * form.explained(K)) * (vectors @ vectors.T))
    return total - relaxation.threshold(share).at(level)


def test_the_form_is_exact_where_nothing_is_left_out():
    # two steps to a piece: all places are combinations of chords and sagittas, so the Schur complement of S W S is the form itself
    problem = short_mission(duration=12.0, system=od.System(od.Dubins(2.0, wind="constant"), (od.GPS(1.5),)))
    relaxation, random = relaxation_of(problem), np.random.default_rng(0)
    assert relaxation.form.residual < 1e-11
    for _ in range(5):
        path = problem.path_of(parameters(problem, random))
        W, vectors, level = problem.matrix(path), gram_vectors(problem, relaxation, path), 0.5 * relaxation.form.largest_level
        rest = np.delete(np.delete(W, 2, 0), 2, 1) - level * np.eye(4)
        b = np.delete(W[2], 2)
        K = relaxation.gain(level)
        total = np.sum((relaxation.form.matrix(K) - level * relaxation.form.explained(K)) * (vectors @ vectors.T))
        assert total == pytest.approx(W[2, 2] - b @ np.linalg.solve(rest, b), rel=1e-9)


def test_bounds_of_arcs_hold_for_arcs_of_every_turn():
    for half_turn, steps in ((0.05, 1), (0.4, 4), (1.2, 3), (np.pi / 2, 7)):
        arcs = arcs_of(half_turn, steps)
        for d in np.linspace(0, half_turn, 997)[1:]:
            chord, sagitta = np.sin(d) / d, (1 - np.cos(d)) / (2 * d)
            assert arcs.shortest <= chord
            assert sagitta <= arcs.sagitta
            assert arcs.lengths[0] <= chord**2 + arcs.ratio * sagitta**2 <= arcs.lengths[1]
            assert np.hypot(np.cos(d) - arcs.along * chord, np.sin(d) - arcs.across * sagitta) <= arcs.heading_error
            share = np.arange(steps) / steps
            angle = d * (2 * share - 1)
            exact = np.array([np.sin(angle) + np.sin(d), np.cos(d) - np.cos(angle)]) / (2 * d)  # the integral of the heading
            first, second = np.array(arcs.places).T
            assert (np.hypot(exact[0] - first * chord, exact[1] + second * sagitta) <= arcs.errors).all()


@pytest.mark.parametrize(("first", "second"), [(0.1, 0.1), (0.3, 0.05), (1.0, 0.4), (1.5, 1.5), (0.7, 0.0)])
def test_neighbouring_chords_differ_by_no_more_than_the_largest_turn_lets_them(first, second):
    # chords of unit arcs that meet at the heading 0: of half turns d before and e after, sin d / d times a direction
    d, e = np.meshgrid(np.linspace(-first, first, 201), np.linspace(-second, second, 201))
    difference = np.abs(np.sinc(d / np.pi) * np.exp(-1j * d) - np.sinc(e / np.pi) * np.exp(1j * e))
    limit = np.sqrt(largest_chord_turn(first + second, 0.0))
    assert difference.max() <= limit
    if first == second <= 1.0:
        assert difference.max() == pytest.approx(limit, rel=1e-9)  # where both turn as fast as they may


# ---------------------------------------------------------------- how near it is


def test_the_mission_with_a_goal_is_proven_to_two_percent():
    design = od.design_trajectory(mission(), starts=2)
    assert design.value <= design.bound <= 152.6  # 149.815 is the best of 200 starts
    assert design.bound >= 149.815
    assert design.gap == 1 - design.value / design.bound > 0
    assert design.status is od.Status.GAP_OPEN
    assert "KeepOut" in design.proof.left_out
    certificate = od.PathCertificate(**json.loads(json.dumps(asdict(design.proof.certificate))))
    assert od.check_path_bound(design.problem, certificate) == design.bound
    # other local optima, and paths within the limits, are below it as well
    assert all(start.value <= design.bound for start in design.starts if start.status.has_answer)


def test_the_saturated_problem_is_proven_optimal():
    design = od.design_trajectory(plateau(), starts=1)
    assert design.status is od.Status.OPTIMAL
    assert 0 <= design.gap <= 1e-6
    assert od.check_path_bound(design.problem, design.proof.certificate) == design.bound


@pytest.mark.parametrize("criterion", [od.MinEigenvalue(), od.LogDet(), od.TraceInverse()])
def test_designs_come_near_their_bounds(criterion):
    problem = short_mission(criterion=criterion, system=od.System(od.Dubins(2.0, wind="constant"), (od.GPS(1.5),)))
    design = od.design_trajectory(problem, starts=4)
    assert 0 <= design.gap <= 0.02
    assert design.proof.certificate.multipliers


# ---------------------------------------------------------------- what changes it, and what does not

GOAL = od.Goal((30.0, 5.0), tolerance=2.0)
BOUND_WITH_GOAL = path_bound_of(short_mission(constraints=(GOAL,)))


def test_a_limit_taken_away_never_lowers_it():
    without, wider = path_bound_of(short_mission()), path_bound_of(short_mission(constraints=(replace(GOAL, tolerance=4.0),)))
    faster = path_bound_of(short_mission(constraints=(GOAL,), bounds={"turn_rate": (-0.5, 0.5)}))
    for more in (without, wider, faster):
        assert more.bound >= BOUND_WITH_GOAL.bound * (1 - 1e-4)  # to the tolerance of the search for multipliers


@pytest.mark.parametrize("share", [1e-12, 1e-8, 1e-4])
def test_a_goal_of_any_size_never_raises_it(share):
    # nearly an equation between chords: its multiplier is not small
    free, random = short_mission(), np.random.default_rng(5)
    without = path_bound_of(free).bound
    for _ in range(2):
        path = free.path_of(parameters(free, random))
        problem = short_mission(constraints=(od.Goal(tuple(path.x[-1, :2]), tolerance=share * 36.0),))
        proof = path_bound_of(problem)
        assert problem.value(path) <= proof.bound <= without * (1 + 1e-4)
        assert od.check_path_bound(problem, proof.certificate) == proof.bound


def turn(angle: float, mirror: bool = False) -> od.DesignProblem:
    """The mission with its goal, all turned about the origin, or mirrored at the x axis as well."""
    sign = -1.0 if mirror else 1.0
    R = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) @ np.diag([1.0, sign])
    x, y, heading, *wind = short_mission().x0
    start = (*(R @ [x, y]), sign * heading + angle, *(R @ wind))
    return short_mission(start=start, constraints=(od.Goal(tuple(R @ GOAL.point), tolerance=2.0),))


@pytest.mark.parametrize("problem", [turn(2.1), turn(-0.7, mirror=True)])
def test_turned_and_mirrored_it_is_the_same(problem):
    assert path_bound_of(problem).bound == pytest.approx(BOUND_WITH_GOAL.bound, rel=1e-4)


@pytest.mark.parametrize("unit", [1e-6, 1e6])
def test_it_has_no_unit(unit):
    # all lengths in another unit, that of the scales as well: the same matrix S W S
    mission_in_unit = short_mission(
        system=od.System(od.Dubins(2.0 * unit, wind="constant"), (od.GPS(1.5 * unit), od.Magnetometer(0.5))),
        start=short_mission().x0 * (unit, unit, 1.0, unit, unit),
        scale=np.array((5.0, 5.0, 0.2, 1.0, 1.0)) * (unit, unit, 1.0, unit, unit),
        constraints=(od.Goal((30.0 * unit, 5.0 * unit), tolerance=2.0 * unit),),
    )
    assert path_bound_of(mission_in_unit).bound == pytest.approx(BOUND_WITH_GOAL.bound, rel=1e-4)


def test_pieces_may_be_divided_but_not_joined():
    problem = short_mission()
    divided = path_bound_of(problem, lengths=(1, 2) * 12)
    assert od.check_path_bound(problem, divided.certificate) == divided.bound
    with pytest.raises(od.InputError, match="must divide"):
        relaxation_of(problem, (6,) * 6)


# ---------------------------------------------------------------- what is refused

CERTIFICATE = BOUND_WITH_GOAL.certificate
WRONG = {
    "a lower level": replace(CERTIFICATE, level=CERTIFICATE.level * 0.999),
    "no level": replace(CERTIFICATE, level=0.0),
    "a level above what no path changes": replace(CERTIFICATE, level=1e9),
    "half the multipliers": replace(CERTIFICATE, multipliers=tuple(y / 2 for y in CERTIFICATE.multipliers)),
    "the other sign": replace(CERTIFICATE, multipliers=tuple(-y for y in CERTIFICATE.multipliers)),
    "no multipliers that matter": replace(CERTIFICATE, multipliers=(0.0,) * len(CERTIFICATE.multipliers)),
    "one multiplier less": replace(CERTIFICATE, multipliers=CERTIFICATE.multipliers[1:]),
    "multipliers beyond numbers": replace(CERTIFICATE, multipliers=(1e308,) * len(CERTIFICATE.multipliers)),
    "a share below 0": replace(CERTIFICATE, share=-0.1),
    "a share of all": replace(CERTIFICATE, share=1.0),
    "other pieces": replace(CERTIFICATE, lengths=(2,) * 18),
}


def test_what_is_no_number_is_refused_before_it_is_used():
    with pytest.raises(od.InputError, match="level"):
        replace(CERTIFICATE, level=float("nan"))


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_certificate_is_refused(name):
    with pytest.raises(od.InputError):
        od.check_path_bound(short_mission(constraints=(GOAL,)), WRONG[name])


@pytest.mark.parametrize(
    "changes",
    [
        {"constraints": (replace(GOAL, point=(20.0, 5.0)),)},
        {"constraints": ()},
        {"system": od.System(od.Dubins(2.2, wind="constant"), (od.GPS(1.5), od.Magnetometer(0.5)))},
        {"system": od.System(od.Dubins(2.0, wind="constant"), (od.GPS(1.4), od.Magnetometer(0.5)))},
        {"scale": (5.0, 5.0, 0.25, 1.0, 1.0)},
    ],
)
def test_the_certificate_of_another_problem_proves_nothing_it_should_not(changes):
    problem = short_mission(**({"constraints": (GOAL,)} | changes))
    with pytest.raises(od.InputError):
        od.check_path_bound(problem, CERTIFICATE)


def test_without_a_bound_there_is_a_reason_and_the_status_is_local():
    sighted = od.System(od.Dubins(2.0), (od.Bearing((30.0, 20.0), 0.1), od.GPS(3.0)))
    problem = short_mission(system=sighted, start=(3.0, -2.0, 0.4), scale=(5.0, 5.0, 0.2), path=od.PiecewiseConstant(3))
    design = od.design_trajectory(problem, starts=1)
    assert design.bound == np.inf
    assert np.isnan(design.gap)
    assert design.status is od.Status.LOCALLY_OPTIMAL
    assert "StandOff" in design.proof.reason
    with pytest.raises(od.InputError, match="no bound"):
        od.check_path_bound(design.problem, od.PathCertificate())


def test_a_beacon_is_no_nearer_than_one_can_fly_to_it_and_on_to_the_goal():
    beacon = (30.0, 40.0)
    problem = short_mission(
        system=od.System(od.Dubins(2.0, wind="constant"), (od.Bearing(beacon, 0.1), od.GPS(3.0))),
        constraints=(replace(GOAL, tolerance=4.0),),
    )
    nearest = nearest_distances(problem, motion_of(problem), beacon)
    assert nearest.min() > 10  # so that the bearing has a bound without a StandOff
    design = od.design_trajectory(problem, starts=2)
    assert design.value <= design.bound < np.inf
    path = design.trajectory
    assert (np.hypot(*(path.x[:-1, :2] - beacon).T) >= nearest).all()


@pytest.mark.parametrize("sensor", VELOCITIES, ids=lambda sensor: sensor.name)
@pytest.mark.parametrize("seed", range(8))
def test_what_a_velocity_says_of_heading_and_wind_is_below_its_weights(sensor, seed):
    """C'C of the model <= diag of the weights, whatever the heading and the speed; without wind what is left is the weight itself."""
    random = np.random.default_rng(seed)
    wind = random.uniform(0.0, 0.9) * np.exp(1j * random.uniform(0, 2 * np.pi)) if seed else 0j
    system = od.System(od.Unicycle(wind="constant"), (od.GPS(1.5), replace(sensor, sigma=1.0, rate=None)))
    start = (3.0, -2.0, 0.4, wind.real, wind.imag)
    problem = short_mission(system=system, start=start, bounds={"speed": (1.0, 2.5), "turn_rate": (-0.4, 0.4)})
    reading = readings_of(problem, motion_of(problem))[0][1]
    weights = np.diag([reading.heading[0], reading.wind[0], reading.wind[0]])
    assert not reading.position.any()
    model = system.model
    slopes = ca.Function("C", [model.x, model.u], [ca.jacobian(model.channels[1].h, model.x)])
    for _ in range(200):
        heading, speed = random.uniform(-10, 10), random.choice([1.0, 2.5, random.uniform(1.0, 2.5)])
        C = slopes([*random.uniform(-9, 9, 2), heading, wind.real, wind.imag], [speed, 0.1]).full()
        assert not C[:, :2].any()
        assert np.linalg.eigvalsh(weights - C[:, 2:].T @ C[:, 2:])[0] >= -1e-12
    if seed == 0 and isinstance(sensor, od.VelocityLog):
        np.testing.assert_allclose(C[:, 2:].T @ C[:, 2:], weights, rtol=1e-12, atol=1e-15)


def test_a_course_of_a_vehicle_that_may_stand_still_has_no_bound():
    system = od.System(od.Dubins(0.5, wind="constant"), (od.GPS(1.5), od.Course(0.4)))  # in a wind of 0.58 m/s
    proof = path_bound_of(short_mission(system=system))
    assert "may stand still over ground" in proof.reason


def test_where_the_relaxation_proves_no_more_the_bound_is_that_of_positions_alone():
    # a heading that is as good as known, and ranges in still water: positions at best, whatever the path
    swimmer = od.System(od.Dubins(2.0), (od.Range((900.0, 0.0), 1.0), od.Magnetometer(1e-6)))
    problem = short_mission(system=swimmer, start=(3.0, -2.0, 0.4), scale=(1.0, 1.0, 1.0))
    proof = path_bound_of(problem)
    assert proof.certificate.multipliers == ()
    assert proof.bound == pytest.approx(36)  # samples of variance 1, if each saw both coordinates
    assert od.check_path_bound(problem, proof.certificate) == proof.bound
    with pytest.raises(od.InputError, match="no bound"):
        od.check_path_bound(problem, od.PathCertificate())


def test_a_sensor_beside_the_position_sees_the_heading_and_has_no_bound():
    # a range from an arm of 3 km to the left knows the heading to sigma / 3 km at once, far better than any displacement tells
    def asked(arm: tuple[float, float]) -> od.DesignProblem:
        sensors = (od.GPS(1.5), od.Range((9000.0, 0.0), 2.0, lever_arm=arm))
        return short_mission(system=od.System(od.Dubins(2.0), sensors), start=(0.0, 0.0, 0.0), scale=(1.0, 1.0, 1.0), about=("heading",))

    at_the_position, beside = path_bound_of(asked((0.0, 0.0))), path_bound_of(asked((0.0, 3000.0)))
    problem = asked((0.0, 3000.0))
    assert problem.value(problem.path_of(np.zeros(12))) > at_the_position.bound
    assert beside.bound == np.inf
    assert "lever_arm" in beside.reason
    with pytest.raises(od.InputError, match="lever_arm"):
        od.check_path_bound(problem, at_the_position.certificate)


def test_a_free_duration_has_no_bound_but_that_of_what_no_path_changes():
    free = short_mission(duration=(9.0, 18.0))
    proof = path_bound_of(free)
    assert "duration is free" in proof.reason
    assert od.check_path_bound(free, proof.certificate) == proof.bound
    assert free.with_duration(9.0).value(free.with_duration(9.0).path_of(np.zeros(12))) <= proof.bound
    with pytest.raises(od.InputError, match="duration is free"):
        od.check_path_bound(free, CERTIFICATE)


@pytest.mark.parametrize("size", [1e-9, 1e9])
def test_bounds_of_a_negative_criterion_are_negative_without_multipliers_as_well(size):
    # trace W^-1 >= trace of the inverse of its block of positions: 36 samples of variance 1.5^2 on x and y, in units of 5 m
    problem = short_mission(
        system=od.System(od.Unicycle(), (od.GPS(1.5),)),
        start=(3.0, -2.0, 0.4),
        scale=(5.0, 5.0, size),
        bounds={"turn_rate": (-0.4, 0.4), "speed": (0.0, 1.0)},
        criterion=od.TraceInverse(),
    )
    of_positions = od.PathCertificate(lengths=(3,) * 12)
    assert od.check_path_bound(problem, of_positions) == pytest.approx(-2 * 1.5**2 / (36 * 25), rel=1e-9)
    assert problem.value(problem.path_of(np.full(24, 0.4))) <= path_bound_of(problem).bound <= od.check_path_bound(problem, of_positions)


def test_what_no_path_changes_is_no_less_than_it_is_in_sixty_digits():
    # GPS alone along one axis: sum of (1, t)(1, t)' / sigma^2, whose entries and smallest eigenvalue mpmath has
    with mpmath.workdps(60):
        for steps in (30, 700, 1500):
            problem = short_mission(
                system=od.System(od.Dubins(2.0, wind="constant"), (od.GPS(1.3),)),
                duration=0.7 * steps,
                step=0.7,
                scale=(1.0, 1.0, 1.0, 0.1, 0.1),
            )
            t = [k * mpmath.mpf(0.7) for k in range(steps)]
            unit = mpmath.mpf(0.1)
            M = mpmath.matrix([[steps, unit * sum(t)], [unit * sum(t), unit**2 * sum(each**2 for each in t)]]) / mpmath.mpf(1.3) ** 2
            exact = min(mpmath.eigsy(M, eigvals_only=True))
            assert exact <= od.check_path_bound(problem, od.PathCertificate()) <= exact * (1 + mpmath.mpf("1e-9"))


def test_without_samples_of_positions_certificates_are_refused_with_the_reason():
    compass = short_mission(system=od.System(od.Dubins(2.0), (od.Magnetometer(1.0),)), start=(3.0, -2.0, 0.4), scale=(1.0, 1.0, 1.0))
    with pytest.raises(od.InputError, match="unknown, whatever the path"):
        od.check_path_bound(compass, od.PathCertificate(lengths=(3,) * 12))


@pytest.mark.slow
def test_twenty_thousand_paths_stay_below_the_bound():
    problem, random = short_mission(), np.random.default_rng(1)
    bound = path_bound_of(problem).bound
    for _ in range(20):
        u = np.array([problem.inputs_of(parameters(problem, random)) for _ in range(1000)])
        assert problem.values(np.tile(problem.x0, (1000, 1)), u).max() <= bound
