"""Shaped paths: every claim recomputed, caps in closed form, symmetries of the scene, refusals."""

from __future__ import annotations

import dataclasses
import multiprocessing
import pickle
from concurrent.futures import ProcessPoolExecutor
from itertools import islice
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import obsdesign as od
from obsdesign.design.caps import cap_of
from obsdesign.design.starts import start_inputs
from obsdesign.design.transcription import solve, transcribe
from obsdesign.design.weave import best_weave

few = settings(deadline=None, max_examples=8, database=None, derandomize=True)
seeds = st.integers(0, 10**6)

BEACON = (6.0, 4.0)
DUBINS = od.Dubins(1.0, wind="constant")
GPS = od.System(DUBINS, (od.GPS(1.0),))
SIGMAS = (2.0, 1.0, 0.1)


def landmark_system(factor: float = 1.0, beacon: tuple[float, float] = BEACON) -> od.System:
    gps, distance, direction = (factor * sigma for sigma in SIGMAS)
    return od.System(DUBINS, (od.GPS(gps), od.Range(beacon, distance), od.Bearing(beacon, direction)))


LANDMARK = landmark_system()
SCALE = (5.0, 5.0, 0.5, 0.3, 0.3)
BASE: dict[str, Any] = {
    "system": GPS,
    "start": (0.0, 0.0, 0.0, 0.3, -0.2),
    "duration": 20.0,
    "step": 0.4,
    "path": od.PiecewiseConstant(10),
    "bounds": {"turn_rate": (-0.5, 0.5)},
}
# a goal, an obstacle and a landmark to keep away from
COURSE: dict[str, Any] = {
    "system": LANDMARK,
    "scale": SCALE,
    "constraints": (od.StandOff(2.0), od.Goal((15.0, -3.0), 1.0), od.KeepOut((7.0, -1.0), 1.5)),
}


def problem_with(**changes: object) -> od.DesignProblem:
    return od.DesignProblem(**{**BASE, **changes})


@pytest.fixture(scope="module")
def course() -> od.Design:
    return od.design_trajectory(problem_with(**COURSE), starts=2, seed=0)


@pytest.fixture(scope="module")
def plateau() -> od.Design:
    """A saturated problem of 20 pieces: GPS alone at 1 m/s, unit scales."""
    bounds = {"turn_rate": (-1.0, 1.0)}
    problem = problem_with(step=0.2, path=od.PiecewiseConstant(20), bounds=bounds)
    return od.design_trajectory(problem, starts=1)


def random_inputs(problem: od.DesignProblem, seed: int) -> np.ndarray:
    """Inputs of the problem's family, anywhere within its bounds."""
    p = np.random.default_rng(seed).uniform(problem.lower, problem.upper, (problem.path.rows(problem.steps), len(problem.lower)))
    return np.array(problem.path.inputs(p, problem.steps))


def flown(problem: od.DesignProblem, u: np.ndarray) -> tuple[od.Trajectory, float]:
    """The path of some inputs and its value, S W S and lambda_min written out."""
    path = od.simulate(problem.system, problem.x0, u, problem.step)
    S = np.diag(problem.units)
    W = S @ od.variational_gramian(problem.system, path).total @ S
    return path, float(np.linalg.eigvalsh(W)[0])


# ---------------------------------------------------------------- what is claimed holds


def test_the_value_is_that_of_the_path_that_is_returned(course: od.Design):
    problem = course.problem
    path, value = flown(problem, course.trajectory.u)
    assert course.status is od.Status.LOCALLY_OPTIMAL
    np.testing.assert_allclose(path.x, course.trajectory.x, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(course.trajectory.t, 0.4 * np.arange(51), rtol=1e-12)
    assert course.value == pytest.approx(value, rel=1e-10)
    blocks = od.variational_gramian(problem.system, path).blocks
    np.testing.assert_allclose(course.information.blocks, blocks, rtol=1e-9, atol=1e-9)


def test_inputs_keep_their_bounds_and_their_pieces_and_every_constraint_holds(course: od.Design):
    u, position = course.trajectory.u, course.trajectory.x[:, :2]
    assert np.all(np.abs(u) <= 0.5)
    np.testing.assert_array_equal(u, np.repeat(u[::5], 5, axis=0))
    # margins of order 1 may fall short by 1e-6: half of that in relative distance
    assert np.linalg.norm(position - BEACON, axis=1).min() >= 2.0 * (1 - 1e-6)
    assert np.linalg.norm(position - (7.0, -1.0), axis=1).min() >= 1.5 * (1 - 1e-6)
    assert np.linalg.norm(position[-1] - (15.0, -3.0)) <= 1.0 * (1 + 1e-6)
    assert course.problem.is_feasible(course.trajectory.x)


def test_the_best_of_the_starts_is_returned(course: od.Design):
    assert len(course.starts) == 2
    values = [start.value for start in course.starts if start.status.has_answer]
    assert course.value == pytest.approx(max(values), rel=1e-6)
    for start in course.starts:
        assert start.status.has_answer == np.isfinite(start.value)


def test_no_feasible_path_nearby_is_better(course: od.Design):
    """Local optimality, by trying: pieces moved by up to 0.003 rad/s within bounds and constraints."""
    problem, random = course.problem, np.random.default_rng(0)
    best = problem.path.fit(course.trajectory.u)
    tried = 0
    for _ in range(80):
        p = np.clip(best + 10 ** random.uniform(-5, -2.5) * random.standard_normal(best.shape), problem.lower, problem.upper)
        path, value = flown(problem, np.array(problem.path.inputs(p, problem.steps)))
        if problem.margins(path.x).min() >= 0:
            tried += 1
            assert value <= course.value * (1 + 1e-6)
    assert tried >= 5


@pytest.mark.parametrize("criterion", [od.MinEigenvalue(), od.LogDet(), od.TraceInverse()], ids=lambda criterion: type(criterion).__name__)
def test_the_solvers_objective_is_the_criterion_of_the_path_it_returns(criterion: object):
    problem = problem_with(scale=SCALE, criterion=criterion, duration=8.0, path=od.PiecewiseConstant(5))
    _, guess = next(start_inputs(problem, seed=0))
    solution = solve(problem, problem.path.fit(guess))
    assert solution.status is od.Status.LOCALLY_OPTIMAL
    path = od.simulate(problem.system, problem.x0, np.array(problem.path.inputs(solution.p, problem.steps)), problem.step)
    W = od.variational_gramian(problem.system, path).total * np.outer(SCALE, SCALE)
    assert solution.objective == pytest.approx(criterion.value(W), rel=1e-6)
    # and optimising has helped
    first = od.simulate(problem.system, problem.x0, np.array(problem.path.inputs(problem.path.fit(guess), problem.steps)), problem.step)
    assert solution.objective > problem.value(first)


@few
@given(seed=seeds)
def test_the_program_and_the_analysis_have_the_same_information_and_margins(seed: int):
    """One definition, two uses, sensors that are not read at every step included."""
    sensors = (od.GPS(2.0, rate=1.25), od.Range(BEACON, 1.0, rate=0.5), od.Bearing(BEACON, 0.1))
    problem = problem_with(**{**COURSE, "system": od.System(DUBINS, sensors)}, duration=8.0, path=od.PiecewiseConstant(5))
    u = random_inputs(problem, seed)
    path = od.simulate(problem.system, problem.x0, u, problem.step)
    W = od.variational_gramian(problem.system, path).total * np.outer(SCALE, SCALE)
    found = transcribe(problem).information(problem.path.fit(u)).full()
    np.testing.assert_allclose(found, W, rtol=1e-10, atol=1e-10 * np.abs(W).max())
    assert transcribe(problem).margins == len(problem.margins(path.x)) == 2 * 21 + 1


# ---------------------------------------------------------------- caps


def gps_block(steps: int, step: float, sigma: float, units: tuple[float, float]) -> float:
    """Smallest eigenvalue of S M S, M = sum_k (1, t_k)(1, t_k)' / sigma^2: GPS on one axis, (position, wind)."""
    rows = np.vstack([np.ones(steps), step * np.arange(steps)]) * np.array(units)[:, None] / sigma
    return float(np.linalg.eigvalsh(rows @ rows.T)[0])


@pytest.mark.parametrize(
    ("sigma", "scale", "rate"),
    [(1.0, None, None), (3.0, (5.0, 5.0, 0.5, 0.3, 0.3), None), (1.0, (1.0, 7.0, 1.0, 0.2, 2.0), None), (1.0, None, 0.5)],
)
def test_the_cap_of_gps_is_that_of_m_kron_identity(sigma: float, scale: tuple[float, ...] | None, rate: float | None):
    """(x, y, wind_x, wind_y) = M (x) I_2 whatever the path: two 2 x 2 blocks, one per axis."""
    problem = problem_with(system=od.System(DUBINS, (od.GPS(sigma, rate=rate),)), scale=scale, duration=8.0, path=od.PiecewiseConstant(4))
    x, y, _, wind_x, wind_y = scale or (1.0,) * 5
    steps, step = (20, 0.4) if rate is None else (4, 2.0)
    cap = cap_of(problem)
    assert cap.value == pytest.approx(min(gps_block(steps, step, sigma, units) for units in ((x, wind_x), (y, wind_y))), rel=1e-10)
    assert cap.states == ("x", "y", "wind_x", "wind_y")


@few
@given(seed=seeds)
def test_no_path_exceeds_the_cap(seed: int):
    """Interlacing: lambda_min of a matrix is at most that of any principal block."""
    problem = problem_with(scale=SCALE)
    _, value = flown(problem, random_inputs(problem, seed))
    assert value <= gps_block(50, 0.4, 1.0, (5.0, 0.3)) * (1 + 1e-12)


def test_the_20_piece_problem_reaches_its_cap(plateau: od.Design):
    assert gps_block(100, 0.2, 1.0, (1.0, 1.0)) == pytest.approx(25.2332413836, abs=5e-11)
    assert plateau.cap.value == pytest.approx(25.2332413836, abs=1e-8)
    assert plateau.value == pytest.approx(plateau.cap.value, rel=1e-6)
    assert plateau.value <= plateau.cap.value * (1 + 1e-9)
    assert plateau.reaches_cap


def test_the_40_piece_problem_has_the_cap_176_08():
    """GPS of 2 m, 40 s in 160 steps, units (5, 5, 0.5, 0.3, 0.3)."""
    system = od.System(DUBINS, (od.GPS(2.0),))
    cap = cap_of(problem_with(system=system, scale=SCALE, duration=40.0, step=0.25, path=od.PiecewiseConstant(40)))
    assert cap.value == pytest.approx(176.08, abs=0.005)
    assert cap.value == pytest.approx(gps_block(160, 0.25, 2.0, (5.0, 0.3)), rel=1e-10)


def test_a_design_below_its_cap_does_not_claim_to_reach_it(plateau: od.Design):
    assert not dataclasses.replace(plateau, value=plateau.cap.value * (1 - 1e-5)).reaches_cap
    assert not dataclasses.replace(plateau, value=np.nan).reaches_cap


def test_where_everything_depends_on_the_path_or_the_criterion_is_another_there_is_no_cap():
    bearings = od.System(DUBINS, (od.Range(BEACON, 1.0), od.Bearing(BEACON, 0.1)))
    short = {"duration": 4.0, "path": od.PiecewiseConstant(2)}
    assert cap_of(problem_with(system=bearings, **short)) is None
    assert cap_of(problem_with(criterion=od.LogDet(), **short)) is None


def test_the_cap_is_zero_where_a_state_is_seen_on_no_path():
    """A compass says nothing about the position."""
    system = od.System(od.Dubins(1.0), (od.Magnetometer(0.5),))
    cap = cap_of(problem_with(system=system, start=(0.0, 0.0, 0.0), duration=4.0, path=od.PiecewiseConstant(2)))
    assert cap.value == 0.0


# ---------------------------------------------------------------- symmetries


def rotated(angle: float, points: tuple[float, float]) -> tuple[float, float]:
    c, s = np.cos(angle), np.sin(angle)
    return (float(c * points[0] - s * points[1]), float(s * points[0] + c * points[1]))


def rotated_course(angle: float) -> od.DesignProblem:
    """The whole scene turned about the origin: start, wind, beacon, goal and obstacle. The units treat both axes alike."""
    x, y, heading, *wind = BASE["start"]
    start = (*rotated(angle, (x, y)), heading + angle, *rotated(angle, tuple(wind)))
    constraints = (od.StandOff(2.0), od.Goal(rotated(angle, (15.0, -3.0)), 1.0), od.KeepOut(rotated(angle, (7.0, -1.0)), 1.5))
    system = landmark_system(beacon=rotated(angle, BEACON))
    return problem_with(system=system, start=start, scale=SCALE, constraints=constraints)


@few
@given(angle=st.floats(-3.0, 3.0), seed=seeds)
def test_turning_the_whole_scene_changes_no_value_and_no_margin(angle: float, seed: int):
    original, turned = problem_with(**COURSE), rotated_course(angle)
    u = random_inputs(original, seed)
    (path, value), (other, same) = flown(original, u), flown(turned, u)
    assert same == pytest.approx(value, rel=1e-8)
    np.testing.assert_allclose(turned.margins(other.x), original.margins(path.x), rtol=1e-9, atol=1e-9)


def test_turning_the_whole_scene_changes_no_design(course: od.Design):
    turned = od.design_trajectory(rotated_course(2.0), starts=1, seed=0)
    assert turned.value == pytest.approx(course.starts[0].value, rel=1e-6)


def test_noise_three_times_as_large_makes_a_ninth_of_the_value(course: od.Design):
    """W scales as 1 / sigma^2, and the program is the same in units of W."""
    noisy = problem_with(**{**COURSE, "system": landmark_system(3.0)})
    _, same_path = flown(noisy, course.trajectory.u)
    assert same_path == pytest.approx(course.value / 9, rel=1e-10)
    assert od.design_trajectory(noisy, starts=1, seed=0).value == pytest.approx(course.starts[0].value / 9, rel=1e-6)


def test_a_log_det_of_zero_is_an_answer_like_any_other():
    """Units k times as large add 10 log k to log det S W S of five states: choose k so that the best value is 0."""

    def best(unit: float) -> float:
        changes = {"criterion": od.LogDet(), "duration": 8.0, "path": od.PiecewiseConstant(5)}
        return od.design_trajectory(problem_with(scale=(unit,) * 5, **changes), starts=1).value

    unit = 1.0
    for _ in range(3):
        unit *= float(np.exp(-best(unit) / 10))
    assert abs(best(unit)) < 1e-6


# ---------------------------------------------------------------- the same seed, the same answer


def test_processes_give_the_same_design_as_none(course: od.Design):
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as executor:
        other = od.design_trajectory(problem_with(**COURSE), starts=2, seed=0, executor=executor)
    assert other.value == course.value
    assert other.starts == course.starts
    assert other.trajectory.x.tobytes() == course.trajectory.x.tobytes()
    assert other.trajectory.u.tobytes() == course.trajectory.u.tobytes()


def test_starts_are_the_same_for_the_same_seed_and_within_bounds():
    """More starts begin with the same ones; another seed changes the random ones only."""
    problem = problem_with(bounds={"turn_rate": (-0.3, 0.2)})
    ten, twelve, other = (list(islice(start_inputs(problem, seed), count)) for count, seed in ((10, 4), (12, 4), (10, 5)))
    assert len({name for name, _ in twelve}) == 12
    for (name, u), (same_name, same_u), (_, other_u) in zip(ten, twelve, other, strict=False):
        assert name == same_name
        np.testing.assert_array_equal(u, same_u)
        assert np.array_equal(u, other_u) == (not name.startswith("random"))
    for _, u in twelve:
        assert u.shape == (50, 1)
        assert np.all((u >= -0.3) & (u <= 0.2))


def test_shaped_starts_weave_by_63_degrees_or_turn_once():
    """Weaves swing 1.1 rad to both sides and come back, orbits turn 2 pi in the first third and fly straight on."""
    problem = problem_with(step=0.1, bounds={"turn_rate": (-9.0, 9.0)})
    headings = {name: np.cumsum(u[:, 0]) * 0.1 for name, u in islice(start_inputs(problem, seed=0), 6)}
    for name, heading in headings.items():
        side = -1 if "right" in name else 1
        if name.startswith("weave"):
            assert side * heading[10] > 0.3
            np.testing.assert_allclose([heading.max(), heading.min(), heading[-1]], [1.1, -1.1, 0.0], atol=0.01)
        else:
            np.testing.assert_allclose(heading[70:], side * 2 * np.pi, atol=0.1)


def oscillator() -> od.ControlAffineSystem:
    x = ca.SX.sym("x", 2)
    return od.ControlAffineSystem(x, ("a", "b"), ca.vertcat(x[1], -x[0]), {"u": ca.vertcat(0, x[0])}, outputs={"y": x[0]})


def oscillator_problem() -> od.DesignProblem:
    path = od.PiecewiseConstant(2)
    return od.DesignProblem(system=oscillator(), start=(1.0, 0.0), duration=2.0, step=0.2, path=path, bounds={"u": (-1.0, 1.0)})


@pytest.mark.parametrize("make", [lambda: problem_with(**COURSE), oscillator_problem], ids=["vehicle", "control-affine"])
def test_equal_problems_are_equal_here_and_in_another_process(make: Any):
    """So that the compiled program of one is found again for the other."""
    problem = make()
    for other in (make(), pickle.loads(pickle.dumps(problem))):
        assert other == problem
        assert hash(other) == hash(problem)
    assert transcribe(make()) is transcribe(problem)


@pytest.mark.parametrize(
    "changes",
    [
        {"start": (0.0, 0.0, 0.1, 0.3, -0.2)},
        {"duration": 16.0},
        {"step": 0.2},
        {"path": od.PiecewiseConstant(5)},
        {"bounds": {"turn_rate": (-0.5, 0.4)}},
        {"criterion": od.LogDet()},
        {"scale": (1.0, 1.0, 1.0, 1.0, 2.0)},
        {"constraints": ()},
        {"system": GPS},
    ],
    ids=lambda changes: next(iter(changes)),
)
def test_problems_that_differ_in_anything_are_not_equal(changes: dict[str, object]):
    assert problem_with(**{**COURSE, **changes}) != problem_with(**COURSE)


def test_bounds_and_constraints_may_be_lists():
    lists = problem_with(bounds={"turn_rate": [-0.5, 0.5]}, constraints=[od.KeepOut((7.0, -1.0), 1.5)])
    tuples = problem_with(constraints=(od.KeepOut((7.0, -1.0), 1.5),))
    assert lists == tuples
    assert hash(lists) == hash(tuples)


# ---------------------------------------------------------------- refusals


def test_one_range_beacon_is_refused_before_any_solver_starts(monkeypatch: pytest.MonkeyPatch):
    """Rotation about the beacon stays hidden on every path."""
    monkeypatch.setattr("obsdesign.design.shaping.solve", None)
    problem = problem_with(system=od.System(DUBINS, (od.Range(BEACON, 1.0),)))
    with pytest.raises(
        od.UnobservableError, match=r"see 4 of 5 dimensions; rotation of everything about the beacon at \(6, 4\) m"
    ) as caught:
        od.design_trajectory(problem)
    assert caught.value.verdict.dimension == 4
    assert "rotation" in caught.value.verdict.hidden
    copy = pickle.loads(pickle.dumps(caught.value))
    assert str(copy) == str(caught.value)


FAR_AWAY = {"constraints": (od.Goal((100.0, 0.0), 1.0),), "duration": 8.0, "path": od.PiecewiseConstant(4)}


def test_a_goal_out_of_reach_is_an_error_that_says_so():
    with pytest.raises(od.SolveError, match="trajectory design, all 2 starts: no feasible point found nearby") as caught:
        od.design_trajectory(problem_with(**FAR_AWAY), starts=2)
    assert caught.value.status is od.Status.LOCALLY_INFEASIBLE
    assert caught.value.status.is_infeasible
    copy = pickle.loads(pickle.dumps(caught.value))
    assert (str(copy), copy.status) == (str(caught.value), caught.value.status)


def test_a_failed_design_leaves_no_number_that_looks_like_an_answer():
    design = od.design_trajectory(problem_with(**FAR_AWAY), starts=2, throw=False)
    assert np.isnan(design.value)
    assert design.trajectory is None
    assert design.information is None
    assert not design.status.has_answer
    assert not design.reaches_cap
    assert [np.isnan(start.value) for start in design.starts] == [True, True]


NO_TURN_RATE = "bounds of turn_rate"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"bounds": {"turnrate": (-1.0, 1.0)}}, r"bounds has no 'turnrate'; did you mean 'turn_rate'\? \(accepted: turn_rate\)"),
        ({"bounds": {"turn_rate": (-1.0, 1.0), "thrust": (0.0, 1.0)}}, r"bounds has no 'thrust'.*accepted: turn_rate"),
        ({"bounds": {}}, r"bounds of turn_rate are missing: every known input needs \(low, high\)"),
        ({"bounds": {"turn_rate": (0.5, -0.5)}}, r"bounds of turn_rate are \(0.5, -0.5\): low must be below high"),
        ({"bounds": {"turn_rate": (0.5, 0.5)}}, r"bounds of turn_rate are \(0.5, 0.5\): low must be below high"),
        ({"bounds": {"turn_rate": (np.nan, 0.5)}}, r"bounds of turn_rate is \(nan, 0.5\): every entry must be finite"),
        ({"bounds": {"turn_rate": (-np.inf, 0.5)}}, "bounds of turn_rate is .* must be finite"),
        ({"bounds": {"turn_rate": (-1.0, 0.0, 1.0)}}, NO_TURN_RATE),
        ({"bounds": {"turn_rate": 1.0}}, NO_TURN_RATE),
        ({"duration": 20.3}, "duration 20.3 s is no whole multiple of the step 0.4 s"),
        ({"duration": 0.1}, "duration 0.1 s is no whole multiple of the step 0.4 s"),
        ({"duration": -20.0}, "duration is -20.0: must be a finite number above 0"),
        ({"duration": np.nan}, "duration is nan"),
        ({"step": 0.0}, "step is 0.0: must be a finite number above 0"),
        ({"path": od.PiecewiseConstant(7)}, "pieces is 7: must divide the number of steps, 50"),
        ({"start": (0.0, 0.0, np.nan, 0.3, -0.2)}, "start: heading is nan: must be finite"),
        ({"start": (0.0, 0.0, 0.0)}, r"start has shape \(3,\): must be \(5,\) for x, y, heading, wind_x, wind_y"),
        ({"start": (*BEACON, 0.0, 0.3, -0.2)}, r"start lies on the landmark \(6.0, 4.0\)"),
        ({"start": (7.5, -1.0, 0.0, 0.3, -0.2)}, r"start \(7.5, -1\) violates KeepOut"),
        ({"start": (5.0, 3.0, 0.0, 0.3, -0.2)}, r"start \(5, 3\) violates StandOff"),
        ({"scale": (1.0, 1.0, 0.0, 1.0, 1.0)}, "scale of heading is 0.0: must be a finite number above 0"),
        ({"scale": (1.0, 1.0, -2.0, 1.0, 1.0)}, "scale of heading is -2.0"),
        ({"scale": (1.0, 1.0, 1.0, 1.0, np.nan)}, "scale: wind_y is nan"),
        ({"scale": (1.0, 1.0)}, r"scale has shape \(2,\): must be \(5,\)"),
    ],
)
def test_a_problem_that_does_not_fit_together_is_refused(changes: dict[str, object], message: str):
    with pytest.raises(od.InputError, match=message):
        problem_with(**{**COURSE, **changes})


def test_constraints_need_a_position():
    problem = oscillator_problem()
    with pytest.raises(od.InputError, match=r"constraints: the state has no 'x' \(accepted: a, b\)"):
        dataclasses.replace(problem, constraints=(od.Goal((1.0, 0.0), 0.5),))


@pytest.mark.parametrize(
    ("changes", "message"), [({"starts": 0}, "starts is 0"), ({"starts": 1.5}, "starts is 1.5"), ({"seed": -1}, "seed is -1")]
)
def test_starts_and_seed_are_counted(changes: dict[str, object], message: str):
    with pytest.raises(od.InputError, match=f"{message}: must be a whole number"):
        od.design_trajectory(problem_with(), **changes)


# ---------------------------------------------------------------- the weave a pilot would fly

COARSE = {"step": 1.0, "bounds": {"turn_rate": (-0.06, 0.06)}}


def test_a_weave_meets_bounds_and_constraints_and_turns_as_it_says():
    """Its heading is start + course (turned to in 5 s) + side * swing * sin(2 pi t / period) at every node."""
    problem = problem_with(**COARSE, system=LANDMARK, scale=SCALE, constraints=(od.StandOff(2.0), od.Goal((24.0, -4.0), 2.0)))
    weave, path = best_weave(problem)
    assert np.all(np.abs(path.u) <= 0.06)
    assert problem.margins(path.x).min() >= 0
    t = np.arange(21.0)
    heading = weave.course * np.minimum(t / 5, 1) + weave.side * weave.swing * np.sin(2 * np.pi * t / weave.period)
    np.testing.assert_allclose(path.x[:, 2], heading, atol=1e-12)
    np.testing.assert_allclose(path.x, flown(problem, path.u)[0].x, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(
    "changes",
    [{**FAR_AWAY, "step": 1.0}, {**COARSE, "bounds": {"turn_rate": (-1e-3, 1e-3)}}],
    ids=["goal out of reach", "bounds too narrow"],
)
def test_where_no_weave_fits_there_is_none(changes: dict[str, object]):
    assert best_weave(problem_with(**changes)) is None


def test_a_weave_needs_a_turn_rate():
    with pytest.raises(od.InputError, match="a weave needs a vehicle with a turn_rate"):
        best_weave(oscillator_problem())


@pytest.mark.parametrize("criterion", [od.MinEigenvalue(), od.LogDet()], ids=["lambda_min", "log_det"])
def test_a_path_too_coarse_for_a_weave_starts_elsewhere(criterion: object):
    """Two periods averaged over four pieces are a straight line, where lambda_min = 0 is stationary: such starts are passed over."""
    problem = problem_with(duration=8.0, path=od.PiecewiseConstant(4), criterion=criterion)
    design = od.design_trajectory(problem, starts=4, seed=0)
    assert not any("2 periods" in start.name for start in design.starts)
    assert all(start.status is od.Status.LOCALLY_OPTIMAL for start in design.starts)
