"""Shaped paths: every claim recomputed, caps in closed form, symmetries of the scene, refusals."""

from __future__ import annotations

import dataclasses
import itertools
import multiprocessing
import pickle
import re
from concurrent.futures import ProcessPoolExecutor
from itertools import islice, pairwise, product
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import obsdesign as od
from obsdesign.design.feasibility import is_feasible, node_margins, violations
from obsdesign.design.initial_guesses import start_inputs
from obsdesign.design.local_solve import LocalSolve, families_of, solve_locally
from obsdesign.design.nlp.information_recursion import gramian_recursion
from obsdesign.design.upper_bound import cap_of
from obsdesign.design.weave import Weave, best_weave
from obsdesign.dynamics.simulation import states_from

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
    return od.design_trajectory(problem_with(**COURSE), starts=4, seed=0)


@pytest.fixture(scope="module")
def plateau() -> od.Design:
    """A saturated problem of 20 pieces: GPS alone at 1 m/s, unit scales."""
    bounds = {"turn_rate": (-1.0, 1.0)}
    problem = problem_with(step=0.2, path=od.PiecewiseConstant(20), bounds=bounds)
    return od.design_trajectory(problem, starts=1)


def random_inputs(problem: od.DesignProblem, seed: int) -> np.ndarray:
    """Inputs of the problem's family, anywhere within its bounds."""
    return inputs_of(problem, np.random.default_rng(seed).uniform(*problem.path.box(problem.grid)))


def inputs_of(problem: od.DesignProblem, p: np.ndarray) -> np.ndarray:
    return np.asarray(problem.path.inputs(p, problem.grid), dtype=float).reshape(problem.steps, -1)


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
    assert course.ended is od.Status.LOCALLY_OPTIMAL
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
    assert is_feasible(course.problem, course.trajectory)


def test_the_best_of_the_starts_is_returned(course: od.Design):
    assert len(course.starts) == 4
    values = [start.value for start in course.starts if start.status.has_answer]
    assert course.value == pytest.approx(max(values), rel=1e-6)
    for start in course.starts:
        assert start.status.has_answer == np.isfinite(start.value)


def test_no_feasible_path_nearby_is_better(course: od.Design):
    """Local optimality, by trying: pieces moved by up to 0.003 rad/s within bounds and constraints.

    What a path is asked for beyond a limit, so that it holds between the nodes too, may cost 1e-5.
    """
    problem, random = course.problem, np.random.default_rng(0)
    best = problem.path.fit(course.trajectory.u, problem.grid)
    tried = 0
    for _ in range(80):
        p = np.clip(best + 10 ** random.uniform(-5, -2.5) * random.standard_normal(best.shape), problem.lower, problem.upper)
        path, value = flown(problem, inputs_of(problem, p))
        if is_feasible(problem, path):
            tried += 1
            assert value <= course.value * (1 + 2e-5)
    assert tried >= 5


@pytest.mark.parametrize("criterion", [od.MinEigenvalue(), od.LogDet(), od.TraceInverse()], ids=lambda criterion: type(criterion).__name__)
def test_the_value_is_the_criterion_of_the_path_and_better_than_where_the_start_began(criterion: object):
    problem = problem_with(scale=SCALE, criterion=criterion, duration=8.0, path=od.PiecewiseConstant(5))
    design = od.design_trajectory(problem, starts=1)
    W = od.variational_gramian(problem.system, flown(problem, design.trajectory.u)[0]).total * np.outer(SCALE, SCALE)
    assert design.value == pytest.approx(criterion.value(W), rel=1e-9)
    assert design.objective == design.value
    _, guess = next(start_inputs(problem, seed=0))
    first, _ = flown(problem, inputs_of(problem, problem.path.fit(guess, problem.grid)))
    assert design.value > problem.value(first)


def test_a_design_says_what_it_came_to(course: od.Design):
    """Its eigenvalues, its parameters, how well it settled, and every optimum that its starts came to."""
    problem, path = course.problem, course.trajectory
    S = np.diag(SCALE)
    expected = np.linalg.eigvalsh(S @ od.variational_gramian(problem.system, path).total @ S)[:2]
    np.testing.assert_allclose(course.eigenvalues, expected, rtol=1e-8)
    assert course.value == pytest.approx(expected[0], rel=1e-8)
    np.testing.assert_allclose(inputs_of(problem, course.p), path.u, rtol=1e-12)
    assert course.residual < 1e-3
    assert course.seconds > 0
    assert course.objective == course.value
    (winner,) = [start for start in course.starts if start.value == course.value]
    assert (course.iterations, course.residual, course.ended) == (winner.iterations, winner.residual, winner.status)
    values = [optimum.value for optimum in course.optima]
    assert values == sorted(values, reverse=True)
    assert values[0] == pytest.approx(course.value, rel=1e-6)
    assert all(abs(a - b) > 1e-4 * a for a, b in pairwise(values))
    named = [name for optimum in course.optima for name in optimum.starts]
    assert sorted(named) == sorted(start.name for start in course.starts if start.status.has_answer and start.refined)
    by_name = {start.name: start.value for start in course.starts}
    for optimum in course.optima:
        assert [by_name[name] for name in optimum.starts] == pytest.approx([optimum.value] * len(optimum.starts), rel=2e-4)


def test_information_that_is_there_already_is_judged_with_the_samples():
    known = np.diag([0.0, 0.0, 3.0, 0.0, 0.0]) + 0.5
    problem = problem_with(duration=8.0, path=od.PiecewiseConstant(5), scale=SCALE, known=known)
    design = od.design_trajectory(problem, starts=1)
    S = np.diag(SCALE)
    W = S @ (od.variational_gramian(problem.system, design.trajectory).total + known) @ S
    np.testing.assert_allclose(design.eigenvalues, np.linalg.eigvalsh(W)[:2], rtol=1e-8)
    assert design.value == pytest.approx(design.eigenvalues[0], rel=1e-8)


def test_about_some_states_the_others_are_found_as_well():
    """Judged is the inverse of their block of the inverse; a design about heading and wind knows them better than one about all."""
    problem = problem_with(**{**COURSE, "constraints": (od.StandOff(2.0),)}, duration=8.0, path=od.PiecewiseConstant(5))
    partial = dataclasses.replace(problem, about=("wind_y", "heading"))
    design, of_all = od.design_trajectory(partial, starts=3), od.design_trajectory(problem, starts=3)

    def known_of(path: od.Trajectory) -> float:
        W = od.variational_gramian(problem.system, path).total * np.outer(SCALE, SCALE)
        return float(np.linalg.eigvalsh(np.linalg.inv(np.linalg.inv(W)[np.ix_([4, 2], [4, 2])]))[0])

    assert design.value == pytest.approx(known_of(design.trajectory), rel=1e-8)
    assert design.value >= known_of(of_all.trajectory) * (1 - 1e-6)
    assert of_all.value >= flown(problem, design.trajectory.u)[1] * (1 - 1e-6)
    assert design.cap is None


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


def test_among_paths_at_the_cap_the_design_has_the_largest_volume(plateau: od.Design):
    """The cap leaves many paths: of those that the starts come to, none has a larger log det."""
    problem = plateau.problem
    volumes = []
    for name, u in islice(start_inputs(problem, seed=0), 4):
        found = solve_locally(LocalSolve(problem, name, u, families_of(problem.path), True))
        if problem.value(found.path) >= plateau.cap.value * (1 - 1e-6):
            volumes.append(od.LogDet().value(od.variational_gramian(problem.system, found.path).total))
    assert volumes
    own = od.LogDet().value(od.variational_gramian(problem.system, plateau.trajectory).total)
    assert own >= max(volumes) - 1e-6
    assert own > min(volumes) + 1e-3  # the first start alone would have stopped somewhere on the plateau


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
    np.testing.assert_allclose(node_margins(turned, other.x, u), node_margins(original, path.x, u), rtol=1e-9, atol=1e-9)


def test_turning_the_whole_scene_changes_no_design(course: od.Design):
    turned = od.design_trajectory(rotated_course(2.0), starts=4, seed=0)
    assert turned.value == pytest.approx(course.value, rel=1e-6)


# an obstacle on one side, and bounds that differ
LOPSIDED: dict[str, Any] = {
    "duration": 12.0,
    "path": od.PiecewiseConstant(6),
    "bounds": {"turn_rate": (-0.5, 0.35)},
    "scale": SCALE,
    "constraints": (od.KeepOut((5.0, 0.5), 1.5), od.KeepIn(((-3.0, -4.0), (15.0, -4.0), (15.0, 6.0), (-3.0, 6.0)))),
}


@pytest.fixture(scope="module")
def lopsided() -> od.Design:
    return od.design_trajectory(problem_with(**LOPSIDED), starts=4)


def test_a_turned_and_shifted_scene_has_the_turned_and_shifted_design(lopsided: od.Design):
    angle, (east, north) = 2.5, (300.0, -70.0)

    def moved(x: float, y: float) -> tuple[float, float]:
        turned = rotated(angle, (x, y))
        return turned[0] + east, turned[1] + north

    first, area = LOPSIDED["constraints"]
    changes = {
        "start": (*moved(0.0, 0.0), angle, *rotated(angle, (0.3, -0.2))),
        "constraints": (od.KeepOut(moved(*first.centre), first.radius), od.KeepIn(tuple(moved(*corner) for corner in area.corners))),
    }
    other = od.design_trajectory(problem_with(**{**LOPSIDED, **changes}), starts=4)
    assert other.value == pytest.approx(lopsided.value, rel=1e-6)
    expected = [moved(x, y) for x, y in lopsided.trajectory.x[:, :2]]
    np.testing.assert_allclose(other.trajectory.x[:, :2], expected, atol=1e-2)


def test_the_mirror_image_of_a_scene_has_the_mirror_image_of_the_design(lopsided: od.Design):
    """y, heading, wind_y and the turn rate change sign; every start to the left has its like to the right."""
    first, area = LOPSIDED["constraints"]
    changes = {
        "start": (0.0, 0.0, 0.0, 0.3, 0.2),
        "bounds": {"turn_rate": (-0.35, 0.5)},
        "constraints": (od.KeepOut((5.0, -0.5), first.radius), od.KeepIn(tuple((x, -y) for x, y in area.corners))),
    }
    mirrored = od.design_trajectory(problem_with(**{**LOPSIDED, **changes}), starts=4)
    assert mirrored.value == pytest.approx(lopsided.value, rel=1e-6)
    np.testing.assert_allclose(mirrored.trajectory.u, -lopsided.trajectory.u, atol=1e-3)
    np.testing.assert_allclose(mirrored.trajectory.x, lopsided.trajectory.x * (1, -1, -1, 1, -1), atol=1e-2)
    swap = {"left": "right", "right": "left"}
    others = {start.name: start.value for start in mirrored.starts}
    for start in lopsided.starts:
        twin = " ".join(swap.get(word.strip(","), word.strip(",")) + "," * word.endswith(",") for word in start.name.split())
        assert twin in others


def test_shaped_starts_come_in_pairs_that_mirror_each_other():
    left, right = ([u for _, u in islice(start_inputs(problem_with(), seed=0), first, 8, 2)] for first in (0, 1))
    np.testing.assert_allclose(left, -np.array(right), atol=1e-12)


def test_noise_three_times_as_large_makes_a_ninth_of_the_value_and_leaves_the_path(course: od.Design):
    """W scales as 1 / sigma^2, and the climb is the same in units of W."""
    noisy = problem_with(**{**COURSE, "system": landmark_system(3.0)})
    _, same_path = flown(noisy, course.trajectory.u)
    assert same_path == pytest.approx(course.value / 9, rel=1e-10)
    design = od.design_trajectory(noisy, starts=4, seed=0)
    assert design.value == pytest.approx(course.value / 9, rel=1e-6)
    np.testing.assert_allclose(design.trajectory.x, course.trajectory.x, atol=1e-2)


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
        other = od.design_trajectory(problem_with(**COURSE), starts=4, seed=0, executor=executor)
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
    """So that what is compiled for one is found again for the other."""
    problem = make()
    for other in (make(), pickle.loads(pickle.dumps(problem))):
        assert other == problem
        assert hash(other) == hash(problem)
    assert gramian_recursion(make().system.model, problem.step) is gramian_recursion(problem.system.model, problem.step)


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
        {"rates": {"turn_rate": 0.1}},
        {"about": ("x",)},
        {"prices": (od.Price(od.PathLength(), 1.0),)},
        {"budgets": (od.Budget(od.PathLength(), 30.0),)},
        {"floor": od.Floor(4.0, 1.0)},
        {"robust": od.Robust(od.Prior(BASE["start"], std=SCALE))},
        {"known": np.eye(5)},
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
    for module in ("multistart", "climbs"):
        monkeypatch.setattr(f"obsdesign.design.{module}.solve_locally", None)
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


def test_a_goal_out_of_reach_is_an_error_that_says_so(monkeypatch: pytest.MonkeyPatch):
    """By geometry, before any solver starts: 99 m at 1 m/s through the air and 0.36 m/s of wind."""
    for module in ("multistart", "climbs"):
        monkeypatch.setattr(f"obsdesign.design.{module}.solve_locally", None)
    message = (
        r"trajectory design: infeasible, proven: Goal: within 1 m of \(100, 0\): 99 m away; at 1\.361 m/s .* in 8 s, not before 72\.8 s"
    )
    with pytest.raises(od.SolveError, match=message) as caught:
        od.design_trajectory(problem_with(**FAR_AWAY), starts=2)
    assert caught.value.status is od.Status.INFEASIBLE
    assert caught.value.status.is_infeasible
    copy = pickle.loads(pickle.dumps(caught.value))
    assert (str(copy), copy.status, copy.reason) == (str(caught.value), caught.value.status, caught.value.reason)


# to turn round takes longer than there is: no geometry tells before, the climbs do
BEHIND = {
    "constraints": (od.Goal((1.0, 3.0), 0.5),),
    "duration": 8.0,
    "path": od.PiecewiseConstant(4),
    "bounds": {"turn_rate": (-0.2, 0.2)},
}


@pytest.fixture(scope="module")
def failed() -> od.Design:
    return od.design_trajectory(problem_with(**BEHIND), starts=2, throw=False)


def test_a_failed_design_leaves_no_number_that_looks_like_an_answer(failed: od.Design):
    assert failed.status is od.Status.LOCALLY_INFEASIBLE
    assert [np.isnan(start.value) for start in failed.starts] == [True, True]
    for design in (failed, od.design_trajectory(problem_with(**FAR_AWAY), starts=2, throw=False)):
        assert np.isnan(design.value)
        assert np.isnan(design.objective)
        assert np.isnan(design.eigenvalues).all()
        assert design.trajectory is None
        assert design.information is None
        assert not design.status.has_answer
        assert not design.reaches_cap
        assert design.optima == ()


def test_a_failed_design_says_what_stood_in_the_way_and_by_how_much(failed: od.Design):
    """No path within bounds comes as near as asked, whichever way it turns; one of wider bounds, or of more time, does."""
    (short,) = failed.violations
    assert short.what == "Goal: within 0.5 m of (1, 3)"
    assert (short.time, short.unit) == (8.0, "m")
    problem = failed.problem
    inputs = np.repeat(np.array(list(itertools.product(np.linspace(-0.2, 0.2, 9), repeat=4))), 5, axis=1)[:, :, None]
    ends = states_from(problem.system, np.tile(problem.x0, (len(inputs), 1)), inputs, problem.step)[:, -1, :2]
    assert 0 < short.by <= np.linalg.norm(ends - (1.0, 3.0), axis=1).min() - 0.5 + 1e-3
    assert str(short) in failed.reason
    assert "feasible with turn rate at" in failed.reason
    assert "feasible from" in failed.reason
    seconds = float(re.search(r"feasible from ([\d.]+) s", failed.reason)[1])
    assert seconds > 8.0
    assert od.design_trajectory(problem.with_duration(seconds), starts=2).status.has_answer


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
        ({"start": (0.0, 0.0, np.nan, 0.3, -0.2)}, "start: heading is nan: must be finite"),
        ({"start": (0.0, 0.0, 0.0)}, r"start has shape \(3,\): must be \(5,\) for x, y, heading, wind_x, wind_y"),
        ({"start": (*BEACON, 0.0, 0.3, -0.2)}, r"start lies on the landmark \(6.0, 4.0\)"),
        ({"start": (7.5, -1.0, 0.0, 0.3, -0.2)}, r"start \(x = 7.5, y = -1\) violates KeepOut: at least 1.5 m from \(7, -1\)"),
        ({"start": (5.0, 3.0, 0.0, 0.3, -0.2)}, r"start \(x = 5, y = 3\) violates StandOff"),
        ({"scale": (1.0, 1.0, 0.0, 1.0, 1.0)}, "scale of heading is 0.0: must be a finite number above 0"),
        ({"scale": (1.0, 1.0, -2.0, 1.0, 1.0)}, "scale of heading is -2.0"),
        ({"scale": (1.0, 1.0, 1.0, 1.0, np.nan)}, "scale: wind_y is nan"),
        ({"scale": (1.0, 1.0)}, r"scale has shape \(2,\): must be \(5,\)"),
        ({"path": od.PiecewiseConstant(60)}, "pieces is 60: must be at most the number of steps, 50"),
        ({"path": od.BSpline(51)}, "points is 51: must be at most the number of steps, 50"),
        ({"path": od.DubinsPath("LSR", 1.0), "bounds": {"turn_rate": (0.0, 0.5)}}, "must allow turns to both sides"),
        ({"duration": (20.0, 16.0)}, r"duration is \(20, 16\): the first must not be above the second"),
        ({"duration": (16.0, 20.3)}, "duration 20.3 s is no whole multiple of the step 0.4 s"),
        ({"duration": (0.0, 20.0)}, "duration is 0.0: must be a finite number above 0"),
        ({"rates": {"turnrate": 1.0}}, r"rates has no 'turnrate'; did you mean 'turn_rate'"),
        ({"rates": {"turn_rate": 0.0}}, "rates: turn_rate is 0.0: must be a finite number above 0"),
        ({"about": ("x", "z")}, r"about has no 'z'.*accepted: x, y, heading, wind_x, wind_y"),
        ({"about": ("x", "x")}, r"about is \('x', 'x'\): names a state twice"),
        ({"known": np.eye(4)}, r"known has shape \(4, 4\): must be \(5, 5\), finite, symmetric and positive semidefinite"),
        ({"known": -np.eye(5)}, r"known\[0, 0\] is -1 .* positive semidefinite"),
        ({"known": np.triu(np.ones((5, 5)))}, r"known\[0, 1\] is 1 and known\[1, 0\] 0: must be symmetric"),
        ({"known": np.full((5, 5), np.nan)}, "known has shape .* finite"),
        ({"floor": od.Floor(0.5, 1.0)}, "floor: seconds is 0.5: must be a whole multiple of the step 0.4 s and at most the duration 20 s"),
        ({"floor": od.Floor(24.0, 1.0)}, "floor: seconds is 24"),
        ({"prices": (od.Price(od.Effort({"speed": 1.0}), 1.0),)}, "effort: the vehicle has no 'speed'"),
        ({"robust": od.Robust(od.Prior((0.0, 0.0), std=(1.0, 1.0)))}, r"robust: the prior has 2 states: the system has 5"),
        ({"constraints": (od.Loiter((0.0, 0.0), 1.0, 5.0, 21.0),)}, r"Loiter: .*: the time 21 s is not within the path, 0 to 20 s"),
    ],
)
def test_a_problem_that_does_not_fit_together_is_refused(changes: dict[str, object], message: str):
    with pytest.raises(od.InputError, match=message):
        problem_with(**{**COURSE, **changes})


def test_constraints_need_a_position():
    problem = oscillator_problem()
    with pytest.raises(od.InputError, match=r"Goal: within 0.5 m of \(1, 0\): the state has no 'x' \(accepted: a, b\)"):
        dataclasses.replace(problem, constraints=(od.Goal((1.0, 0.0), 0.5),))


@pytest.mark.parametrize(
    ("changes", "message"), [({"starts": 0}, "starts is 0"), ({"starts": 1.5}, "starts is 1.5"), ({"seed": -1}, "seed is -1")]
)
def test_starts_and_seed_are_counted(changes: dict[str, object], message: str):
    with pytest.raises(od.InputError, match=f"{message}: must be a whole number"):
        od.design_trajectory(problem_with(), **changes)


# ---------------------------------------------------------------- costs, rates, floors, draws, durations

BRIEF: dict[str, Any] = {"duration": 8.0, "path": od.PiecewiseConstant(5), "scale": SCALE}
BRISK: dict[str, Any] = {
    "system": od.System(od.Unicycle(wind="constant"), (od.GPS(1.0),)),
    "bounds": {"speed": (0.5, 1.5), "turn_rate": (-0.5, 0.5)},
}


def length_of(design: od.Design) -> float:
    """Length over ground, by the midpoints of 1,000 parts of every step with the heading where it is in each."""
    path, step = design.trajectory, design.problem.step
    speed, wind = path.u[:, :1], path.x[:-1, 3:]
    heading = path.x[:-1, 2:3] + path.u[:, 1:2] * step * (np.arange(1000) + 0.5) / 1000
    velocity = speed * np.cos(heading) + wind[:, :1], speed * np.sin(heading) + wind[:, 1:]
    return float(np.hypot(*velocity).mean(axis=1).sum() * step)


def effort_of(design: od.Design) -> float:
    return float((design.trajectory.u[:, -1] ** 2).sum() * design.problem.step)


@pytest.fixture(scope="module")
def brisk() -> od.Design:
    return od.design_trajectory(problem_with(**BRIEF, **BRISK), starts=3)


@pytest.mark.parametrize(
    ("cost", "total"), [(od.PathLength(), length_of), (od.Effort({"turn_rate": 1.0}), effort_of)], ids=["length", "effort"]
)
def test_what_has_a_price_is_used_less_and_what_has_a_budget_no_more_than_that(brisk: od.Design, cost: Any, total: Any):
    """V(2) - c C(2) >= V(1) - c C(1) for the best path at a price of c, so that V falls, and C falls by more than that."""
    price = 0.3 * brisk.value / total(brisk)
    priced = od.design_trajectory(problem_with(**BRIEF, **BRISK, prices=(od.Price(cost, price),)), starts=3)
    assert priced.objective == pytest.approx(priced.value - price * total(priced), rel=1e-6)
    assert priced.objective >= (brisk.value - price * total(brisk)) * (1 - 1e-6)
    assert total(priced) <= total(brisk) * (1 + 1e-6)
    assert priced.value <= brisk.value * (1 + 1e-6)
    assert priced.cap is None
    budget = od.Budget(cost, 0.8 * total(brisk))
    bound = od.design_trajectory(problem_with(**BRIEF, **BRISK, budgets=(budget,)), starts=3)
    assert total(bound) == pytest.approx(0.8 * total(brisk), rel=2e-6)
    assert bound.objective == bound.value <= brisk.value * (1 + 1e-6)


def test_inputs_change_no_faster_than_their_rates(brisk: od.Design):
    """Between the middles of neighbouring pieces, of 1.6 s."""
    rates = {"turn_rate": 0.1, "speed": 0.15}
    design = od.design_trajectory(problem_with(**BRIEF, **BRISK, rates=rates), starts=3)
    changes = np.abs(np.diff(design.trajectory.u[::4], axis=0)).max(axis=0) / 1.6
    assert np.all(changes <= np.array([0.15, 0.1]) * (1 + 1e-6))
    assert np.any(changes >= np.array([0.15, 0.1]) * (1 - 1e-4))
    assert np.any(np.abs(np.diff(brisk.trajectory.u[::4], axis=0)).max(axis=0) / 1.6 > np.array([0.15, 0.1]))
    assert design.value <= brisk.value * (1 + 1e-6)


def lowest_window(problem: od.DesignProblem, path: od.Trajectory, seconds: float) -> float:
    """The least lambda_min(S W S) over stretches that begin every half of their length, and the last one."""
    length = round(seconds / problem.step)
    windows = od.sliding_information(problem.system, path, length).sum(axis=1) * np.outer(problem.units, problem.units)
    lowest = np.linalg.eigvalsh(windows)[:, 0]
    return float(lowest[sorted({*range(0, len(lowest), length // 2), len(lowest) - 1})].min())


def test_every_stretch_of_a_path_keeps_its_floor():
    """Asked for 1.2 times as much as the best path has in its weakest stretch."""
    problem = problem_with(system=LANDMARK, constraints=(od.StandOff(2.0),), duration=10.0, path=od.PiecewiseConstant(5), scale=SCALE)
    free = od.design_trajectory(problem, starts=3)
    asked = 1.2 * lowest_window(problem, free.trajectory, 6.0)
    design = od.design_trajectory(dataclasses.replace(problem, floor=od.Floor(6.0, asked)), starts=3)
    assert lowest_window(problem, design.trajectory, 6.0) >= asked * (1 - 1e-6)
    assert design.value == pytest.approx(flown(problem, design.trajectory.u)[1], rel=1e-8)
    assert design.value <= free.value * (1 + 1e-6)


@pytest.mark.parametrize("worst", [True, False], ids=["worst", "mean"])
def test_a_path_for_many_starts_is_judged_by_its_worst_or_their_mean(worst: bool):
    """Draws of the prior with the path's inputs: those that the path was made for, and a thousand that it was not."""
    prior = od.Prior(BASE["start"], std=(1.0, 1.0, 0.3, 0.2, 0.2))
    problem = problem_with(**{**BRIEF, "system": LANDMARK}, robust=od.Robust(prior, samples=5, worst=worst, seed=3))
    design = od.design_trajectory(problem, starts=3)

    def values(draws: np.ndarray) -> np.ndarray:
        return od.batch_information(problem.system, draws, design.trajectory.u, problem.step).sum(axis=1) * np.outer(SCALE, SCALE)

    made_for = np.linalg.eigvalsh(values(problem.robust.draws(5, 0)))[:, 0]
    assert design.objective == pytest.approx(made_for.min() if worst else made_for.mean(), rel=1e-8)
    assert design.value == pytest.approx(flown(problem, design.trajectory.u)[1], rel=1e-8)
    fresh = np.sort(np.linalg.eigvalsh(values(problem.robust.draws(1000, 1)))[:, 0])
    found = design.robustness
    assert found.draws == 1000
    np.testing.assert_allclose([found.worst, found.five_percent, found.mean], [fresh[0], fresh[50], fresh.mean()], rtol=1e-8)
    # no path nearby is better for the same draws
    random = np.random.default_rng(0)
    for size in (1e-3, 3e-2):
        for _ in range(10):
            near = np.clip(design.p + size * random.standard_normal(len(design.p)), -0.5, 0.5)
            u = inputs_of(problem, near)
            every = od.batch_information(problem.system, problem.robust.draws(5, 0), u, problem.step).sum(axis=1) * np.outer(SCALE, SCALE)
            lowest = np.linalg.eigvalsh(every)[:, 0]
            assert (lowest.min() if worst else lowest.mean()) <= design.objective * (1 + 1e-6)


def test_draws_are_those_of_the_prior():
    """Means and covariances of many, within four standard errors; the same seed, the same draws; others for another number."""
    prior = od.Prior(BASE["start"], covariance=np.diag([1.0, 2.0, 0.1, 0.3, 0.3]) + 0.05)
    robust = od.Robust(prior, seed=1)
    draws = robust.draws(4000, 0)
    error = np.sqrt(np.diag(prior.covariance) / 4000)
    assert np.all(np.abs(draws.mean(axis=0) - prior.mean) < 4 * error)
    spread = np.cov(draws.T)
    variances = np.diag(prior.covariance)
    assert np.all(np.abs(spread - prior.covariance) < 4 * np.sqrt(2 * np.outer(variances, variances) / 4000))
    np.testing.assert_array_equal(robust.draws(4000, 0), draws)
    assert not np.any(robust.draws(4, 1) == draws[:4])
    assert not np.any(od.Robust(prior, seed=2).draws(4, 0) == draws[:4])


@pytest.mark.parametrize(("per_second", "expected"), [(0.0, "longest"), (1.5, "between"), (30.0, "shortest")])
def test_a_free_duration_is_a_whole_number_of_steps_and_no_worse_than_the_ends_of_its_range(per_second: float, expected: str):
    """Information grows with time, log det ever more slowly: what a second costs decides."""
    prices = (od.Price(od.FlightTime(), per_second),) if per_second else ()
    changes = {"criterion": od.LogDet(), "path": od.PiecewiseConstant(4), "scale": SCALE, "prices": prices}
    design = od.design_trajectory(problem_with(**changes, duration=(4.0, 12.0)), starts=2)
    seconds = design.problem.duration
    assert seconds / 0.4 == pytest.approx(round(seconds / 0.4))
    assert len(design.trajectory.u) == round(seconds / 0.4)
    assert {"longest": seconds == 12.0, "between": 4.0 < seconds < 12.0, "shortest": seconds == 4.0}[expected]
    assert design.objective == pytest.approx(design.value - per_second * seconds, rel=1e-9)
    for end in (4.0, 12.0):
        assert design.objective >= od.design_trajectory(problem_with(**changes, duration=end), starts=2).objective - 1e-9


# ---------------------------------------------------------------- other families, and evidence

FAMILIES = {"arcs": od.DubinsPath("LSRS", 0.8), "splines": od.BSpline(7), "uneven pieces": od.PiecewiseConstant(11)}


@pytest.mark.parametrize("path", FAMILIES.values(), ids=FAMILIES.keys())
def test_designs_of_every_family_are_of_that_family_and_no_neighbour_is_better(path: Any):
    problem = problem_with(**{**COURSE, "constraints": (od.Goal((15.0, -3.0), 1.0), od.StandOff(1.0))}, path=path)
    design = od.design_trajectory(problem, starts=2)
    lower, upper = path.box(problem.grid)
    assert np.all((lower <= design.p) & (design.p <= upper))
    np.testing.assert_allclose(inputs_of(problem, design.p), design.trajectory.u, rtol=1e-9, atol=1e-12)
    assert np.all(np.abs(design.trajectory.u) <= 0.5 * (1 + 1e-12))
    assert is_feasible(problem, design.trajectory)
    found, value = flown(problem, design.trajectory.u)
    assert design.value == pytest.approx(value, rel=1e-9)
    assert design.residual < 1e-3
    random, tried = np.random.default_rng(0), 0
    for _ in range(60):
        step = 10 ** random.uniform(-5, -2) * (upper - lower) * random.standard_normal(len(lower))
        found, value = flown(problem, inputs_of(problem, np.clip(design.p + step, lower, upper)))
        if is_feasible(problem, found):
            tried += 1
            assert value <= design.value * (1 + 1e-6)
    assert tried >= 3


@pytest.fixture(scope="module")
def fine() -> od.Design:
    """Every piece one step: coarser paths come first."""
    return od.design_trajectory(problem_with(**COURSE, path=od.PiecewiseConstant(50)), starts=4)


def test_a_finer_family_that_contains_a_coarser_one_is_no_worse(fine: od.Design, course: od.Design):
    """50 pieces can fly what 10 can."""
    assert fine.value >= course.value * (1 - 1e-6)


def test_only_the_best_of_the_coarse_paths_are_refined_and_each_says_whether_it_was(fine: od.Design):
    refined = [start for start in fine.starts if start.refined]
    assert 1 <= len(refined) <= 3 < len(fine.starts) == 4
    assert max(start.value for start in refined) == pytest.approx(fine.value, rel=1e-6)
    assert sum(len(optimum.starts) for optimum in fine.optima) == len([start for start in refined if start.status.has_answer])


@pytest.fixture(scope="module")
def supported() -> od.Design:
    problem = problem_with(**{**COURSE, "constraints": (od.StandOff(2.0),)}, duration=8.0, path=od.PiecewiseConstant(5))
    return od.design_trajectory(problem, starts=2, evidence=2)


def test_evidence_is_an_upper_bound_for_every_path_that_was_met(supported: od.Design):
    """lambda_min(A) <= <Z, A> for Z >= 0 of trace 1: its estimate is no less than <Z, S W S> of the design's own path."""
    evidence, problem = supported.evidence, supported.problem
    Z = evidence.Z
    assert np.linalg.eigvalsh(Z)[0] >= -1e-12
    assert np.trace(Z) == pytest.approx(1.0, rel=1e-9)
    W = od.variational_gramian(problem.system, supported.trajectory).total * np.outer(SCALE, SCALE)
    assert evidence.estimate >= np.sum(Z * W) * (1 - 1e-9) >= supported.value * (1 - 2e-9)
    assert evidence.remaining == pytest.approx(1 - supported.value / evidence.estimate, rel=1e-6, abs=1e-9)
    assert 0 <= evidence.remaining < 1
    assert evidence.climbs >= 3
    assert f"{evidence.climbs} climbs" in evidence.in_words
    assert "Evidence, not proof" in evidence.in_words


def test_a_better_path_met_on_the_way_takes_the_designs_place(supported: od.Design):
    plain = od.design_trajectory(supported.problem, starts=2)
    assert plain.evidence is None
    assert supported.value >= plain.value * (1 - 1e-9)
    assert [start.name for start in supported.starts][:2] == [start.name for start in plain.starts]


def test_evidence_at_a_cap_says_that_nothing_is_left():
    """The cap is an upper bound, and here it is reached."""
    problem = problem_with(step=0.4, path=od.PiecewiseConstant(10), bounds={"turn_rate": (-1.0, 1.0)})
    design = od.design_trajectory(problem, starts=2, evidence=2)
    assert design.reaches_cap
    assert design.evidence.estimate >= design.cap.value * (1 - 1e-6)
    assert design.evidence.remaining < 1e-3


@pytest.mark.parametrize("changes", [{"criterion": od.LogDet()}, {"prices": (od.Price(od.PathLength(), 0.1),)}], ids=["log_det", "price"])
def test_evidence_is_for_the_smallest_eigenvalue_alone(changes: dict[str, Any]):
    assert od.design_trajectory(problem_with(**BRIEF, **changes), starts=1, evidence=2).evidence is None


# ---------------------------------------------------------------- the weave a pilot would fly

COARSE = {"step": 1.0, "bounds": {"turn_rate": (-0.06, 0.06)}}


def test_a_weave_meets_bounds_and_constraints_and_turns_as_it_says():
    """Its heading is start + course (turned to in 5 s) + side * swing * sin(2 pi t / period) at every node."""
    problem = problem_with(**COARSE, system=LANDMARK, scale=SCALE, constraints=(od.StandOff(2.0), od.Goal((24.0, -4.0), 2.0)))
    weave, path = best_weave(problem)
    assert np.all(np.abs(path.u) <= 0.06)
    assert node_margins(problem, path.x, path.u).min() >= 0
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


def judged_by_hand(problem: od.DesignProblem, path: od.Trajectory) -> float:
    """1 / (largest variance of the judged states in their units), of samples and what is known: the inverse of a whole matrix."""
    W = (od.variational_gramian(problem.system, path).total + problem.known) * np.outer(SCALE, SCALE)
    kept = [problem.system.model.state_names.index(name) for name in problem.about]
    return 1 / float(np.linalg.eigvalsh(np.linalg.inv(W)[np.ix_(kept, kept)])[-1])


@pytest.mark.parametrize("known", [None, np.diag([0.0, 0.0, 3.0, 40.0, 0.0])], ids=["samples", "known"])
def test_the_weave_is_the_best_by_what_the_problem_is_about_and_knows(known: np.ndarray | None):
    """No other weave of the first grid that keeps all limits has more; judged by all states, another one would be the best."""
    problem = problem_with(step=1.0, system=LANDMARK, scale=SCALE, about=("wind_x", "wind_y"), known=known)
    _, path = best_weave(problem)
    every = [
        od.simulate(LANDMARK, problem.x0, u, 1.0)
        for course, swing, share, side in product(
            np.linspace(-0.6, 0.6, 11), np.linspace(0.18, 1.8, 10), np.linspace(0.05, 0.95, 11), (1, -1)
        )
        if share * 20 > 4 and np.abs(u := Weave(course, swing, share * 20, side).turn_rates(np.arange(20.0), 1.0)[:, None]).max() <= 0.5
    ]
    best = max(judged_by_hand(problem, each) for each in every)
    assert problem.value(path) == pytest.approx(judged_by_hand(problem, path), rel=1e-6)
    assert problem.value(path) >= best * (1 - 1e-9)
    of_all = max(every, key=dataclasses.replace(problem, about=(), known=None).value)
    assert judged_by_hand(problem, of_all) < 0.99 * best


def test_the_weave_keeps_what_is_between_the_nodes_and_budgets_and_rates():
    problem = problem_with(
        step=2.0,
        constraints=(od.StandOff(4.0, ((8.0, 1.0),)),),
        rates={"turn_rate": 0.15},
        budgets=(od.Budget(od.Effort({"turn_rate": 1.0}), 0.3),),
    )
    _, path = best_weave(problem)
    assert not violations(problem, path)
    assert np.abs(np.diff(path.u, axis=0)).max() <= 0.15 * 2.0
    assert float((path.u**2).sum()) * 2.0 <= 0.3


@pytest.mark.parametrize("changes", [{}, {"weights": np.array([[1.0, 0.0, 1.0], [0.0, 2.0, 1.0]])}, {"known": np.eye(5)}], ids=str)
def test_many_paths_are_rated_as_each_is(changes: dict[str, Any]):
    problem = problem_with(system=LANDMARK, scale=SCALE, **changes)
    random = np.random.default_rng(5)
    starts, u = problem.x0 + 0.1 * random.standard_normal((4, 5)), random.uniform(-0.5, 0.5, (4, problem.steps, 1))
    one_by_one = [problem.value(od.simulate(LANDMARK, x, each, problem.step)) for x, each in zip(starts, u, strict=True)]
    np.testing.assert_allclose(problem.values(starts, u), one_by_one, rtol=1e-9)
    same = [problem.value(od.simulate(LANDMARK, x, u[0], problem.step)) for x in starts]
    np.testing.assert_allclose(problem.values(starts, u[0]), same, rtol=1e-9)


def test_a_weave_needs_a_turn_rate():
    with pytest.raises(od.InputError, match="a weave needs a vehicle with a turn_rate"):
        best_weave(oscillator_problem())


def test_a_path_too_coarse_for_a_weave_starts_elsewhere_where_a_straight_line_has_no_value():
    """Two periods averaged over four pieces are a straight line, of which log det does not exist: such starts are passed over."""
    problem = problem_with(duration=8.0, path=od.PiecewiseConstant(4), criterion=od.LogDet())
    design = od.design_trajectory(problem, starts=4, seed=0)
    assert not any("2 periods" in start.name for start in design.starts)
    assert all(start.status is od.Status.LOCALLY_OPTIMAL for start in design.starts)


def test_a_start_that_shows_nothing_is_left_behind():
    """lambda_min = 0 along the same straight line is no optimum, though its slope is 0."""
    design = od.design_trajectory(problem_with(duration=8.0, path=od.PiecewiseConstant(4)), starts=4, seed=0)
    assert any("2 periods" in start.name for start in design.starts)
    assert all(start.status is od.Status.LOCALLY_OPTIMAL for start in design.starts)
    assert min(start.value for start in design.starts) > 0.3 * design.value
