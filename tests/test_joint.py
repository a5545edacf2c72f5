"""Path and schedule together: recomputed, never below a one-sided answer, at least as good as brute force."""

from __future__ import annotations

import dataclasses
import itertools
import multiprocessing
import re
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from typing import Any

import numpy as np
import pytest

import obsdesign as od
from obsdesign.criteria.abstract import AbstractCriterion
from obsdesign.design.feasibility import initial_rows, is_feasible
from obsdesign.design.nlp import information_recursion as recursion
from obsdesign.design.nlp.joint_program import JointProgram
from obsdesign.design.nlp.program import Program
from obsdesign.design.sqp.evaluation import Multipliers
from obsdesign.design.upper_bound import cap_of
from obsdesign.joint.alternation import AlternationStart, Pair, alternate, improve_path, make_pair
from obsdesign.joint.joint_solver import design_for_schedule
from obsdesign.joint.problem import JointProblem
from obsdesign.rules.unavailable_outside import UnavailableOutside

BEACONS = ((60.0, 45.0), (-25.0, 50.0))
# ranges to two beacons, of which one at a time is heard: where to swim, and whom to listen to when, depend on each other
TINY: dict[str, Any] = {
    "system": od.System(od.Dubins(1.0), (od.Range(BEACONS[0], 1.0, name="east"), od.Range(BEACONS[1], 1.0, name="west"))),
    "start": (0.0, 0.0, 0.4),
    "duration": 60.0,
    "step": 2.0,
    "path": od.PiecewiseConstant(3),
    "bounds": {"turn_rate": (-0.08, 0.08)},
    "scale": (10.0, 10.0, 0.3),
    "constraints": (od.StandOff(8.0),),
}
GLIDER: dict[str, Any] = {
    "system": od.System(
        od.Dubins(0.5, wind="constant"),
        (od.GPS(8.0), od.Range((150.0, 120.0), 3.0), od.Bearing((150.0, 120.0), 0.05), od.Magnetometer(0.1)),
    ),
    "start": (0.0, 0.0, 0.3, 0.1, -0.05),
    "duration": 600.0,
    "step": 10.0,
    "path": od.PiecewiseConstant(8),
    "bounds": {"turn_rate": (-0.05, 0.05)},
    "scale": (50.0, 50.0, 0.3, 0.2, 0.2),
    "constraints": (od.StandOff(20.0), od.Goal((220.0, 40.0), 20.0)),
}


def tiny(**other: Any) -> od.DesignProblem:
    return od.DesignProblem(**{**TINY, **other})


def glider(**other: Any) -> od.DesignProblem:
    return od.DesignProblem(**{**GLIDER, **other})


@cache
def answer() -> od.Joint:
    return od.codesign(glider(), 6, starts=2)


def from_scratch(problem: od.DesignProblem, path: od.Trajectory, chosen: np.ndarray) -> float:
    """lambda_min of S W S, W the sum of the samples that the schedule takes, one after the other."""
    blocks, length = od.variational_gramian(problem.system, path).blocks, path.steps // len(chosen)
    W = sum(blocks[k, s] for k in range(path.steps) for s in range(blocks.shape[1]) if chosen[k // length, s])
    return float(np.linalg.eigvalsh(np.outer(problem.units, problem.units) * W)[0])


# ---------------------------------------------------------------- weights of a design


def test_weights_of_one_are_no_weights():
    plain, weighed = (od.design_trajectory(tiny(weights=weights), starts=2) for weights in (None, np.ones((3, 2))))
    assert weighed.problem == plain.problem
    assert weighed.value == plain.value
    assert np.array_equal(weighed.p, plain.p)
    program = Program(tiny())
    p = (program.lower + 2 * program.upper) / 3
    assert np.array_equal(program.evaluate(p).matrices, program.evaluate(p, program.due(np.ones((3, 2)))).matrices)


def test_a_sensor_without_weight_is_not_there():
    both = (od.Range(BEACONS[0], 1.0, name="east"), od.Range(BEACONS[1], 1.0, name="west"), od.GPS(3.0))
    with_gps = tiny(system=od.System(od.Dubins(1.0), both), weights=np.tile([1.0, 1.0, 0.0], (5, 1)))
    off, never = (od.design_trajectory(problem, starts=3) for problem in (with_gps, tiny()))
    assert off.value == pytest.approx(never.value, rel=1e-7)


def test_information_of_a_design_is_linear_in_the_weights():
    weights = np.random.default_rng(0).uniform(0, 2, (6, 4))
    path = answer().design.trajectory
    assert path is not None
    judged = glider(weights=weights).information_matrix(path)
    assert np.allclose(judged, np.einsum("ks,ksij->ij", weights, od.variational_gramian(glider().system, path).by_segment(6)), rtol=1e-12)
    assert glider(weights=3 * weights).value(path) == pytest.approx(3 * glider(weights=weights).value(path), rel=1e-9)


def test_a_program_is_what_the_analysis_says_and_other_weights_build_nothing():
    random = np.random.default_rng(1)
    Program(glider())
    built = recursion.gramian_recursion.cache_info().misses
    for _ in range(3):
        problem = glider(weights=random.uniform(0, 1, (6, 4)))
        program = Program(problem)
        p = random.uniform(program.lower, program.upper)
        path = od.simulate(problem.system, problem.x0, program.inputs(p), problem.step)
        assert np.allclose(program.evaluate(p).matrices[0], problem.scaled(problem.information_matrix(path)), rtol=1e-9)
    assert recursion.gramian_recursion.cache_info().misses == built


def test_a_cap_counts_the_weights():
    system = od.System(od.Dubins(1.0, wind="constant"), (od.GPS(1.0),))
    base: dict[str, Any] = {"system": system, "start": (0.0, 0.0, 0.0, 0.1, 0.1), "scale": None}
    whole, half = cap_of(tiny(**base)), cap_of(tiny(**base, weights=np.array([[0.5]])))
    assert whole is not None
    assert half is not None
    assert half.value == pytest.approx(whole.value / 2, rel=1e-12)


@pytest.mark.parametrize(
    ("other", "message"),
    [
        ({"weights": np.ones((3, 3))}, r"weights has shape \(3, 3\): must be \(K, 2\) for east, west, K a divisor of the 30 steps"),
        ({"weights": np.ones((4, 2))}, r"weights has shape \(4, 2\): must be .* the 30 steps"),
        ({"weights": np.ones(2)}, r"weights has shape \(2,\)"),
        ({"weights": [[1.0, -0.5]]}, "weights go from -0.5 to 1"),
        ({"weights": [[1.0, np.nan]]}, "weights go from nan"),
        ({"weights": [[1.0, 0.0]], "duration": (40.0, 60.0)}, r"weights: the duration is \(40, 60\)"),
        ({"weights": [[1.0, 0.0]], "robust": od.Robust(od.Prior(mean=(0, 0, 0), std=(1, 1, 1)))}, "weights: robust does not know"),
    ],
)
def test_weights_that_do_not_fit_are_refused(other: dict[str, Any], message: str):
    with pytest.raises(od.InputError, match=message):
        tiny(**other)


# ---------------------------------------------------------------- path and weights in one program


def test_derivatives_to_path_and_weights_are_those_of_differences():
    problem, random = glider(), np.random.default_rng(2)
    inner = Program(problem, initial_rows(problem))
    program = JointProgram(inner, 6, 2)
    v = program.join(random.uniform(inner.lower, inner.upper), random.uniform(0.1, 0.9, (6, 4)))
    Z = random.standard_normal((5, 5))
    values = program.evaluate(v)
    multipliers = Multipliers((Z @ Z.T)[None], values.floors, random.uniform(0, 1, len(values.rows)), 1.0)

    def lagrangian(v: np.ndarray) -> float:
        there = program.evaluate(v)
        return float(-np.sum(multipliers.matrices * there.matrices) - multipliers.rows @ there.rows)

    def gradient(v: np.ndarray) -> np.ndarray:
        slopes = program.derivatives(program.evaluate(v))
        return -np.einsum("ij,qij->q", multipliers.matrices[0], slopes.matrices[0]) - multipliers.rows @ slopes.rows

    H = program.lagrangian_hessian(values, program.derivatives(values), multipliers)
    width = program.upper - program.lower
    for i, e in enumerate(np.diag(1e-6 * width)):
        size = 2e-6 * width[i]
        assert (lagrangian(v + e) - lagrangian(v - e)) / size == pytest.approx(gradient(v)[i], rel=1e-6, abs=1e-6)
        bend, largest = (gradient(v + e) - gradient(v - e)) / size * width, np.abs(H[i] * width).max()
        assert np.allclose(bend, H[i] * width, rtol=1e-4, atol=1e-6 * largest)


def test_weights_of_a_segment_are_bounded_in_sum():
    problem, weights = tiny(), np.array([[0.2, 0.3], [1.0, 1.0], [0.0, 1.0]])
    inner = Program(problem, initial_rows(problem))
    program = JointProgram(inner, 3, 1)
    values = program.evaluate(program.join(inner.lower, weights))
    assert values.rows[-3:] == pytest.approx([0.5, -1.0, 0.0])
    assert (program.lower[inner.q :] == 0).all()
    assert (program.upper[inner.q :] == 1).all()


# ---------------------------------------------------------------- in turn


def begun(chosen: np.ndarray) -> tuple[JointProblem, Pair]:
    """A pair of the path designed for all sensors with some schedule."""
    question = JointProblem(tiny(), 3, 1, (), 0, 20)
    design = od.design_trajectory(tiny(), starts=1)
    assert design.trajectory is not None
    schedule = dataclasses.replace(question.select_schedule(design.trajectory), chosen=chosen)
    return question, make_pair(question, design, design.trajectory, schedule, 0.0)


def test_turns_end_where_neither_half_can_be_improved():
    question, pair = begun(np.tile([True, False], (3, 1)))
    end = alternate(AlternationStart(question, "here", pair))
    assert end.is_stationary
    assert end.values[0] == end.values[1] == 0.0  # one range sees no turn about its beacon, whatever the path
    assert end.values[2] > end.values[1]  # the schedule
    assert end.values[3] > end.values[2]  # the path
    again = improve_path(question, end.pair.path.u, end.pair.schedule.chosen)
    assert again.value <= end.pair.objective * (1 + 1e-6)
    assert question.select_schedule(end.pair.path).value <= end.pair.objective * (1 + 1e-9)


def test_a_design_is_recorded_for_its_schedule():
    question, pair = begun(np.array([[True, False], [False, True], [False, True]]))
    design = design_for_schedule(question, pair)
    value = from_scratch(tiny(), pair.path, pair.schedule.chosen)
    assert (design.value, design.objective, design.eigenvalues[0]) == pytest.approx((value,) * 3, rel=1e-9)
    assert np.array_equal(design.problem.weights, pair.schedule.chosen)


def test_only_places_forbid_a_schedule_on_another_path():
    problem = tiny()
    near, far = (od.simulate(problem.system, problem.x0, np.full((30, 1), rate), 2.0) for rate in (0.08, 0.0))
    asked = JointProblem(problem, 3, 1, (UnavailableOutside("east", (0.0, 0.0), 30.0),), 0, 20)
    east, west = np.tile([True, False], (3, 1)), np.tile([False, True], (3, 1))
    assert asked.allows(near, east)
    assert not asked.allows(far, east)
    assert asked.allows(far, west)


# ---------------------------------------------------------------- the joint answer


def test_the_joint_value_from_scratch():
    joint = answer()
    assert joint.design.trajectory is not None
    value = from_scratch(glider(), joint.design.trajectory, joint.schedule.chosen)
    assert (joint.value, joint.design.value, joint.schedule.value) == pytest.approx((value,) * 3, rel=1e-9)
    assert np.array_equal(joint.design.problem.weights, joint.schedule.chosen)
    assert is_feasible(glider(), joint.design.trajectory)
    assert joint.value <= joint.schedule.bound
    assert (joint.schedule.chosen.sum(axis=1) <= 1).all()
    for side in (joint.path_first, joint.sensors_first):
        assert side.design.trajectory is not None
        assert side.value == pytest.approx(from_scratch(glider(), side.design.trajectory, side.schedule.chosen), rel=1e-9)


def test_one_sided_answers_are_one_sided():
    joint = answer()
    assert joint.path_first.design.value == od.design_trajectory(glider(), starts=2).value
    straight = od.design_trajectory(glider(weights=joint.sensors_first.schedule.chosen), starts=2)
    assert joint.sensors_first.design.value == straight.value


@pytest.mark.parametrize("seed", range(4))
def test_never_below_a_one_sided_answer(seed: int):
    random = np.random.default_rng(seed)
    east, west = random.uniform(20, 60, 2), random.uniform(-60, -20, 2)
    sensors = (od.Range(tuple(east), 1.0, name="east"), od.Range(tuple(west), 1.0, name="west"), od.Bearing(tuple(east), 0.05))
    joint = od.codesign(tiny(system=od.System(od.Dubins(1.0), sensors)), 6, starts=1, seed=seed)
    assert joint.value >= joint.alternated >= max(joint.path_first.value, joint.sensors_first.value)
    assert all(after >= before for before, after in itertools.pairwise(joint.alternation))
    assert joint.alternation[-1] == joint.objective == pytest.approx(joint.value, rel=1e-9)


def test_no_point_of_a_grid_is_better():
    problem = tiny()
    joint = od.codesign(problem, 3, starts=4)
    schedules = np.array([np.eye(2)[list(which)] for which in itertools.product((0, 1), repeat=3)])
    best = -np.inf
    for rates in itertools.product(np.linspace(-0.08, 0.08, 9), repeat=3):
        path = od.simulate(problem.system, problem.x0, np.repeat(rates, 10)[:, None], problem.step)
        if is_feasible(problem, path):
            blocks = problem.scaled(od.segment_information(problem.system, path, 3))
            best = max(best, np.linalg.eigvalsh(np.einsum("rks,ksij->rij", schedules, blocks))[:, 0].max())
    assert joint.value >= best


def test_the_mirror_image_is_as_good():
    def seen(side: float) -> od.Joint:
        ranges = (od.Range((x, side * y), 1.0, name=name) for name, (x, y) in zip(("east", "west"), BEACONS, strict=True))
        problem = tiny(system=od.System(od.Dubins(1.0), tuple(ranges)), start=(0.0, 0.0, side * 0.4))
        return od.codesign(problem, 3, starts=4)

    left, right = seen(1.0), seen(-1.0)
    assert left.value == pytest.approx(right.value, rel=1e-6)
    assert np.array_equal(left.schedule.chosen, right.schedule.chosen)


def test_relaxed_weights_leave_a_fixed_point_of_turns():
    joint = answer()
    assert joint.origin.startswith("relaxed")
    assert joint.value > 1.01 * joint.alternated


def test_all_sensors_on_is_the_design_for_all():
    joint = od.codesign(tiny(), 3, per_segment=2, starts=2)
    assert joint.schedule.chosen.all()
    assert joint.value == pytest.approx(joint.path_first.design.value, rel=1e-6)


def test_workers_find_the_same():
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as executor:
        there = od.codesign(tiny(), 3, starts=1, executor=executor)
    here = od.codesign(tiny(), 3, starts=1)
    assert there.value == here.value
    assert np.array_equal(there.design.p, here.design.p)


@pytest.mark.parametrize("criterion", [od.MinEigenvalue(), od.TraceInverse()], ids=["eigenvalue", "trace"])
def test_what_is_known_counts_and_only_what_is_asked_for_is_judged(criterion: AbstractCriterion):
    """By (S (known + W) S)^-1 of the samples one after the other: its block of x and y; no schedule of the path is better."""
    known = np.diag([0.0, 0.0, 2.0])
    joint = od.codesign(tiny(known=known, about=("x", "y"), criterion=criterion), 3, starts=1)
    path = joint.design.trajectory
    assert path is not None
    blocks = od.variational_gramian(tiny().system, path).blocks.reshape(3, 10, 2, 3, 3).sum(axis=1)
    values = {}
    for picks in itertools.product((0, 1), repeat=3):
        W = known + sum(blocks[k, s] for k, s in enumerate(picks))
        C = np.linalg.inv(np.outer(TINY["scale"], TINY["scale"]) * W)[:2, :2]
        values[picks] = 1 / np.linalg.eigvalsh(C)[-1] if isinstance(criterion, od.MinEigenvalue) else -np.trace(C)
    own = values[tuple(joint.schedule.chosen.argmax(axis=1).tolist())]
    assert (joint.value, joint.design.value, joint.schedule.value) == pytest.approx((own,) * 3, rel=1e-8)
    assert max(values.values()) == pytest.approx(own, rel=1e-8)
    assert joint.schedule.bound >= own
    assert joint.objective >= max(joint.path_first.objective, joint.sensors_first.objective)


# ---------------------------------------------------------------- refusals


@pytest.mark.parametrize(
    ("other", "segments", "message"),
    [
        ({"duration": (40.0, 60.0)}, 3, "codesign: the duration is (40, 60): must be one number of seconds"),
        ({}, 7, "segments is 7: must divide the number of steps, 30"),
        ({"robust": od.Robust(od.Prior(mean=(0, 0, 0), std=(1, 1, 0.1)), 2)}, 3, "codesign: the problem has robust"),
        ({"floor": od.Floor(20.0, 0.1)}, 3, "codesign: the problem has floor"),
        ({"weights": [[1.0, 0.0]]}, 3, "codesign: the problem has weights"),
        ({"criterion": od.Posterior(od.Prior(mean=(0, 0, 0), std=(1, 1, 1)))}, 3, "codesign: Posterior is not additive over sensors"),
    ],
)
def test_what_schedules_cannot_answer_is_refused(other: dict[str, Any], segments: int, message: str):
    with pytest.raises(od.InputError, match=re.escape(message)):
        od.codesign(tiny(**other), segments)


def test_counts_are_checked():
    for name, value in (("per_segment", 3), ("per_segment", 0), ("starts", 0), ("rounds", 0), ("seed", -1)):
        options: dict[str, Any] = {name: value}
        with pytest.raises(od.InputError, match=name):
            od.codesign(tiny(), 3, **options)


def test_no_path_no_answer():
    far = tiny(constraints=(od.Goal((500.0, 0.0), 1.0),))
    with pytest.raises(od.SolveError, match="codesign"):
        od.codesign(far, 3, starts=1)
    joint = od.codesign(far, 3, starts=1, throw=False)
    assert np.isnan(joint.value)
    assert joint.status.is_infeasible
