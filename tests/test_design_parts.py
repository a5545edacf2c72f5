"""What a design is made of: derivatives, convex models, Newton's step, criteria of some states, and the climb they add up to."""

from __future__ import annotations

import ast
import dataclasses
from collections.abc import Callable
from itertools import islice
from pathlib import Path
from typing import Any

import casadi as ca
import cvxpy as cp
import numpy as np
import pytest
from by_hand import ONE_STEP, Swinging, slopes
from scipy.linalg import null_space, qr
from scipy.optimize import root

import obsdesign as od
from obsdesign.criteria._factor import elimination_matrix, schur_complement
from obsdesign.criteria.abstract import AbstractCriterion
from obsdesign.design.feasibility import fine_path, initial_rows, node_margins
from obsdesign.design.initial_guesses import start_inputs
from obsdesign.design.local_solve import LocalSolution, LocalSolve, solve_locally
from obsdesign.design.nlp.criterion_objective import CriterionObjective, matrix_objective_of
from obsdesign.design.nlp.evaluation import Evaluation
from obsdesign.design.nlp.program import Program
from obsdesign.design.nlp.sensitivity import Linearisation, propagate_sensitivity
from obsdesign.design.sqp.active_set_step import ActiveCone, KKTSystem, newton_step
from obsdesign.design.sqp.combination import Mean, Smallest
from obsdesign.design.sqp.conic_model import Cone, ConicQP, ConicSolution
from obsdesign.design.sqp.conic_qp import minimise
from obsdesign.design.sqp.evaluation import Multipliers
from obsdesign.design.sqp.matrix_objective import LinearObjective, evaluate_objective
from obsdesign.design.upper_bound import cap_of
from obsdesign.dynamics.model import AbstractSystem
from obsdesign.dynamics.step import blocks_of, step_of
from obsdesign.information.sample_information import sampling_mask

BEACON, POSTS = (8.0, 7.0), ((-6.0, 0.0), (-3.0, 5.0), (-3.0, -5.0))
START, SCALE = (0.0, 0.0, 0.2, 0.3, -0.2), (5.0, 4.0, 0.5, 0.3, 0.4)
PRIOR = od.Prior(START, covariance=np.diag([1.0, 1.0, 0.04, 0.09, 0.09]) + 0.01)
DUBINS = od.Dubins(1.0, wind="constant")
LOOKING = od.System(DUBINS, (od.GPS(2.0), od.Range(BEACON, 1.0), od.Bearing(BEACON, 0.1)))


def turning(system: AbstractSystem = LOOKING, **changes: Any) -> od.DesignProblem:
    """A problem of 20 steps and 5 pieces."""
    base: dict[str, Any] = {
        "system": system,
        "start": START,
        "duration": 8.0,
        "step": 0.4,
        "path": od.PiecewiseConstant(5),
        "bounds": {"turn_rate": (-0.5, 0.4)},
        "scale": SCALE,
    }
    return od.DesignProblem(**{**base, "tolerance": ONE_STEP, **changes})


def driving(**changes: Any) -> od.DesignProblem:
    """The same with two inputs, in wind."""
    system = od.System(od.Unicycle(wind="constant"), LOOKING.sensors)
    return turning(system, **{"bounds": {"speed": (0.5, 1.5), "turn_rate": (-0.5, 0.4)}, "path": od.PiecewiseConstant(4), **changes})


def sliding(**changes: Any) -> od.DesignProblem:
    """Three inputs, slips, and bearings to three landmarks."""
    return od.DesignProblem(
        tolerance=ONE_STEP,
        system=od.System(od.Omnidirectional("constant"), tuple(od.Bearing(post, 0.05, rate=0.5) for post in POSTS)),
        start=(0.5, -5.0, 0.3, 0.05, -0.03, 0.005),
        duration=8.0,
        step=0.5,
        path=od.PiecewiseConstant(3),
        bounds={"forward": (0.2, 1.0), "sideways": (-0.3, 0.4), "turn_rate": (-0.2, 0.3)},
        scale=(1.0, 1.0, 0.1, 0.1, 0.1, 0.01),
        **changes,
    )


def swinging_oscillator() -> od.DesignProblem:
    """A system that is no vehicle: its input stiffens its spring, and it is seen through a square."""
    x = ca.SX.sym("x", 2)
    fields = {"u": ca.vertcat(0, x[0] * (1 + 0.2 * x[1]))}
    system = od.ControlAffineSystem(x, ("a", "b"), ca.vertcat(x[1], -x[0]), fields, outputs={"y": x[0] + 0.3 * x[1] ** 2})
    return od.DesignProblem(
        tolerance=ONE_STEP, system=system, start=(1.0, 0.2), duration=4.0, step=0.2, path=od.PiecewiseConstant(4), bounds={"u": (-1.0, 1.2)}
    )


BLOWN = od.System(od.Dubins(1.0, wind="unknown"), (*LOOKING.sensors, od.Magnetometer(0.2)))
COUPLED = od.System(Swinging(1.0), (*LOOKING.sensors, od.Magnetometer(0.3)))
PSD = (0.02, 0.01, 1e-3, 2e-3, 3e-3)
FEEDS = (od.StandOff(1.0), od.KeepOut((5.0, -2.0), 0.5), od.Goal((5.0, 0.0), 2.0), od.Via((3.0, 0.0), 1.0, 1.0, 6.0))
CASES: dict[str, od.DesignProblem] = {
    "gps": turning(od.System(DUBINS, (od.GPS(1.0),))),
    "sensors with rates": turning(od.System(DUBINS, (od.GPS(2.0, rate=1.25), od.Range(BEACON, 1.0, rate=0.5), od.Bearing(BEACON, 0.1)))),
    "two inputs": driving(),
    "three inputs, three landmarks": sliding(),
    "no vehicle": swinging_oscillator(),
    "steps that do not commute": turning(COUPLED, start=(0.0, 0.0, 0.2, 0.5), scale=(1.0, 1.0, 0.2, 0.3)),
    "posterior with noise": turning(criterion=od.Posterior(PRIOR, np.diag(PSD) + 1e-3, (), od.LogDet())),
    "posterior with unknown inputs": turning(
        BLOWN,
        start=START[:3],
        scale=SCALE[:3],
        criterion=od.Posterior(od.Prior(START[:3], covariance=PRIOR.covariance[:3, :3]), PSD[:3], ("wind_x", "wind_y")),
    ),
    "floor": turning(floor=od.Floor(3.2, 0.5)),
    "draws": turning(robust=od.Robust(PRIOR, samples=3)),
    "limits": turning(constraints=FEEDS, known=np.diag([1.0, 2.0, 3.0, 4.0, 5.0])),
    "limits on speed, budgets, prices and rates": driving(
        constraints=(od.GroundSpeed(0.3, 2.0), od.KeepIn(((-5.0, -9.0), (20.0, -9.0), (20.0, 9.0), (-5.0, 9.0)))),
        budgets=(od.Budget(od.PathLength(), 12.0), od.Budget(od.Effort({"turn_rate": 2.0, "speed": 0.1}), 5.0)),
        prices=(od.Price(od.PathLength(), 0.3), od.Price(od.Effort({"turn_rate": 1.0}), 2.0)),
        rates={"turn_rate": 0.2},
    ),
    "clearance of the landmarks' circle, and a floor": sliding(constraints=(od.CircleClearance(0.5, 2.0),), floor=od.Floor(4.0, 0.1)),
    "arcs": driving(path=od.DubinsPath("LSR", 1.5), rates={"turn_rate": 1.0}, constraints=FEEDS),
    "arcs and a floor": driving(path=od.DubinsPath("RSL", 1.5), floor=od.Floor(4.0, 0.1)),
    "splines": driving(path=od.BSpline(6), rates={"turn_rate": 0.3, "speed": 0.5}, robust=od.Robust(PRIOR, samples=2)),
}
EVERY = pytest.mark.parametrize("problem", CASES.values(), ids=CASES.keys())


def program_of(problem: od.DesignProblem) -> Program:
    """The program with its rows, each asked for a little more than 0."""
    rows = initial_rows(problem)
    return Program(problem, dataclasses.replace(rows, allowance=allowances(rows.node)))


def allowances(rows: np.ndarray) -> np.ndarray:
    return 0.01 * np.arange(1.0, len(rows) + 1)


def somewhere(problem: od.DesignProblem, seed: int) -> np.ndarray:
    """Parameters (q,) well inside their box; switches early, so that all of them happen."""
    lower, upper = problem.path.box(problem.grid)
    upmost = 0.4 if isinstance(problem.path, od.DubinsPath) else 0.9
    return lower + (upper - lower) * np.random.default_rng(seed).uniform(0.1, upmost, len(lower))


def flown(problem: od.DesignProblem, p: np.ndarray) -> od.Trajectory:
    u = np.asarray(problem.path.inputs(p, problem.grid), dtype=float).reshape(problem.steps, -1)
    return od.simulate(problem.system, problem.x0, u, problem.step, tolerance=problem.tolerance)


# ---------------------------------------------------------------- values


def by_analysis(problem: od.DesignProblem, path: od.Trajectory) -> np.ndarray:
    """The matrices to be judged, by the functions that analyse a path: S (W + known) S, or S J S."""
    S, criterion = np.diag(problem.units), problem.criterion
    if criterion.knowledge is not None:
        J = od.posterior_information(problem.system, path, criterion.prior, criterion.disturbance_psd, criterion.unknown_inputs)
        return np.array([S @ J[-2] @ S])
    starts = [path.x[0]] if problem.robust is None else problem.robust.draws(problem.robust.samples, 0)
    paths = [od.simulate(problem.system, start, path.u, problem.step, tolerance=problem.tolerance) for start in starts]
    return np.array([S @ (od.variational_gramian(problem.system, each).total + problem.known) @ S for each in paths])


@EVERY
def test_a_program_has_the_matrices_of_the_analysis_and_the_margins_of_the_path(problem: od.DesignProblem):
    """One definition, two uses, down to windows, draws, costs and rates of change."""
    p = somewhere(problem, seed=1)
    path, program = flown(problem, p), program_of(problem)
    values = program.evaluate(p)
    expected = by_analysis(problem, path)
    assert values.matrices.shape == expected.shape
    np.testing.assert_allclose(values.matrices, expected, rtol=1e-8, atol=1e-8 * np.abs(expected).max())
    np.testing.assert_allclose(values.rollout.z[0, :, : len(problem.x0)], path.x, rtol=1e-12, atol=1e-12)
    margins = node_margins(problem, path.x, path.u)
    margins = margins - allowances(margins)
    costs = [1 - cost_of(term.cost, problem, path) / term.at_most for term in problem.budgets]
    rates = [1 - side * change for side in (1, -1) for change in changes_of(problem, p)]
    np.testing.assert_allclose(values.rows, [*margins, *costs, *rates], rtol=1e-9, atol=1e-8)
    assert values.price == pytest.approx(sum(term.per_unit * cost_of(term.cost, problem, path) for term in problem.prices), rel=1e-7)
    if problem.floor is not None:
        length = round(problem.floor.seconds / problem.step)
        windows = od.sliding_information(problem.system, path, length).sum(axis=1) * np.outer(problem.units, problem.units)
        first = sorted({*range(0, problem.steps - length + 1, length // 2), problem.steps - length})
        np.testing.assert_allclose(values.floors, windows[first], rtol=1e-8, atol=1e-8 * np.abs(windows).max())


def cost_of(cost: Any, problem: od.DesignProblem, path: od.Trajectory) -> float:
    """Length over ground, by the midpoints of 2,000 parts of every step with the heading where it is in each; or effort."""
    if isinstance(cost, od.PathLength):
        speed, wind = path.u[:, :1], path.x[:-1, 3:]
        heading = path.x[:-1, 2:3] + path.u[:, 1:2] * problem.step * (np.arange(2000) + 0.5) / 2000
        velocity = speed * np.cos(heading) + wind[:, :1], speed * np.sin(heading) + wind[:, 1:]
        return float(np.hypot(*velocity).mean(axis=1).sum() * problem.step)
    names = problem.system.model.input_names
    return float(sum(weight * (path.u[:, names.index(name)] ** 2).sum() for name, weight in cost.weights) * problem.step)


def changes_of(problem: od.DesignProblem, p: np.ndarray) -> list[float]:
    """What the family calls rates of change, as shares of their limits."""
    found = np.asarray(problem.path.rates(p, problem.grid), dtype=float)
    names = problem.system.model.input_names
    return [float(each / problem.rates[name]) for j, name in enumerate(names) if name in problem.rates for each in found[:, j]]


# ---------------------------------------------------------------- derivatives


def multipliers_for(values: Evaluation, seed: int) -> Multipliers:
    """Random ones, >= 0."""
    random = np.random.default_rng(seed)

    def positive(shape: tuple[int, ...]) -> np.ndarray:
        factor = random.standard_normal(shape)
        return factor @ factor.swapaxes(-1, -2)

    return Multipliers(positive(values.matrices.shape), positive(values.floors.shape), random.uniform(0, 9, len(values.rows)), 0.7)


def differences(function: Callable[[np.ndarray], np.ndarray], p: np.ndarray, width: np.ndarray) -> np.ndarray:
    """Derivatives (q, ...) by central differences over four points a share of the width apart."""
    found = []
    for j in range(len(p)):
        kick = np.zeros(len(p))
        kick[j] = 5e-4 * width[j]
        near, far = (function(p + reach * kick) - function(p - reach * kick) for reach in (1, 2))
        found.append((8 * near - far) / (12 * kick[j]))
    return np.array(found)


def lagrangian_slope(program: Program, multipliers: Multipliers, p: np.ndarray) -> np.ndarray:
    """Gradient (q,) of price - <Z, matrices> - <Z, floors> - z'rows."""
    found = program.derivatives(program.evaluate(p))
    counted = np.einsum("bij,bqij->q", multipliers.matrices, found.matrices) + np.einsum("fij,fqij->q", multipliers.floors, found.floors)
    return multipliers.price * found.price - counted - multipliers.rows @ found.rows


@EVERY
@pytest.mark.parametrize("seed", [2, 3])
def test_first_derivatives_of_a_program_are_central_differences(problem: od.DesignProblem, seed: int):
    p = somewhere(problem, seed)
    program = program_of(problem)
    width, found = program.upper - program.lower, program.derivatives(program.evaluate(p))
    for name, axis in (("matrices", 1), ("floors", 1), ("rows", 1), ("price", 0)):
        values = differences(lambda q, name=name: np.asarray(getattr(program.evaluate(q), name)), p, width)
        expected = np.moveaxis(values, 0, axis)
        assert getattr(found, name).shape == expected.shape
        np.testing.assert_allclose(getattr(found, name), expected, rtol=1e-6, atol=2e-7 * np.abs(expected).max(initial=0.0), err_msg=name)


@EVERY
@pytest.mark.parametrize("seed", [4, 5])
def test_second_derivatives_of_a_program_are_differences_of_the_first(problem: od.DesignProblem, seed: int):
    p = somewhere(problem, seed)
    program = program_of(problem)
    values = program.evaluate(p)
    multipliers, width = multipliers_for(values, seed), program.upper - program.lower
    found = program.lagrangian_hessian(values, program.derivatives(values), multipliers) * np.outer(width, width)
    expected = differences(lambda q: lagrangian_slope(program, multipliers, q), p, width) * np.outer(width, width)
    np.testing.assert_array_equal(found, found.T)
    # differences near a beacon, and of what is left of an unknown input, have few digits
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=2e-5 * np.abs(expected).max())


@pytest.mark.parametrize("part", ["matrices", "floors", "rows", "price"])
def test_each_multiplier_counts_its_own_part_of_the_curvature(part: str):
    """One at a time, so that no part hides behind a larger one."""
    problem = driving(
        constraints=(od.GroundSpeed(0.3, 2.0), od.StandOff(1.0)),
        budgets=(od.Budget(od.PathLength(), 12.0),),
        prices=(od.Price(od.Effort({"turn_rate": 1.0, "speed": 2.0}), 2.0),),
        floor=od.Floor(3.2, 0.5),
    )
    p = somewhere(problem, 6)
    program = program_of(problem)
    values = program.evaluate(p)
    full = multipliers_for(values, 6)
    only = Multipliers(*(getattr(full, name) * (name == part) for name in ("matrices", "floors", "rows")), full.price * (part == "price"))
    found = program.lagrangian_hessian(values, program.derivatives(values), only)
    expected = differences(lambda q: lagrangian_slope(program, only, q), p, program.upper - program.lower)
    assert np.abs(expected).max() > 0
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-6 * np.abs(expected).max())


def test_windows_of_a_floor_begin_every_half_of_their_length_and_the_last_one_ends_with_the_path():
    problem = turning(floor=od.Floor(2.8, 0.5))  # 7 of 20 steps: 0, 3, 6, 9, 12 and 13
    p = somewhere(problem, 0)
    windows = od.sliding_information(problem.system, flown(problem, p), 7).sum(axis=1) * np.outer(SCALE, SCALE)
    np.testing.assert_allclose(program_of(problem).evaluate(p).floors, windows[[0, 3, 6, 9, 12, 13]], rtol=1e-9)


# ---------------------------------------------------------------- the convex model


def random_model(seed: int) -> ConicQP:
    """Three cones of t (the second of another where there are two), one with a share of the slack, rows and bounds; hard rows if asked."""
    random = np.random.default_rng(seed)
    q, kinds = 5, seed % 4  # 0: no t; 1: one t; 2: two; 3: one with hard rows
    T = (0, 1, 2, 1)[kinds]

    def symmetric(*shape: int) -> np.ndarray:
        factor = random.standard_normal((*shape, 3, 3))
        return factor + factor.swapaxes(-1, -2)

    E = np.diag([1.0, 1.0, 0.0]) if seed % 8 < 4 else np.eye(3)
    cones = [Cone(symmetric() + 9 * np.eye(3), symmetric(q), E, j, 0.0) for j in (*range(T), *range(T)[:1])]
    hardness = random.choice([-3.0, 3.0])
    cones += [Cone(symmetric() + hardness * np.eye(3), symmetric(q), np.eye(3), None, share) for share in (1.0, 0.4)]
    factor = random.standard_normal((q, q - 1))
    hard = 2 if kinds == 3 else 0
    return ConicQP(
        B=factor @ factor.T + 0.1 * np.eye(q),
        g=3 * random.standard_normal(q),
        weights=random.uniform(0.5, 2.0, T),
        penalty=float(random.choice([0.5, 20.0])),
        lower=-random.uniform(0.1, 0.6, q),
        upper=random.uniform(0.1, 0.6, q),
        cones=tuple(cones),
        rows=random.standard_normal(4) + hardness / 3,
        jacobian=random.standard_normal((4, q)),
        epigraph_rows=random.standard_normal(hard),
        epigraph_jacobian=random.standard_normal((hard, q)),
    )


def by_cvxpy(model: ConicQP) -> tuple[np.ndarray, float, float]:
    """The minimiser d, its slack, and the least value of the same model, written out."""
    d, e = cp.Variable(len(model.g)), cp.Variable(nonneg=True)
    t = cp.Variable(max(1, len(model.weights)))
    limits: list[Any] = [d >= model.lower, d <= model.upper, model.rows + model.jacobian @ d + e >= 0]
    if len(model.epigraph_rows):
        limits.append(model.epigraph_rows + model.epigraph_jacobian @ d >= t[0])
    for cone in model.cones:
        matrix = cone.A + sum(d[i] * cone.D[i] for i in range(len(model.g))) + cone.slack_factor * e * np.eye(3)
        limits.append(matrix - (0 if cone.epigraph_index is None else t[cone.epigraph_index] * cone.E) >> 0)
    gain = model.weights @ t[: len(model.weights)] if len(model.weights) else 0.0
    least = cp.Minimize(0.5 * cp.quad_form(d, cp.psd_wrap(model.B)) + model.g @ d - gain + model.penalty * e)
    value = cp.Problem(least, limits).solve(solver=cp.CLARABEL, tol_gap_abs=1e-10, tol_gap_rel=1e-10, tol_feas=1e-10)
    return np.asarray(d.value), float(np.asarray(e.value)), float(np.asarray(value))


def moved_by(cone: Cone, step: ConicSolution, t: float) -> np.ndarray:
    return cone.A + np.tensordot(step.d, cone.D, 1) - t * cone.E + cone.slack_factor * step.slack * np.eye(len(cone.A))


def raised(model: ConicQP, step: ConicSolution, j: int) -> float:
    """The largest t_j that cones and hard rows allow at the step."""
    found = []
    for cone in (each for each in model.cones if each.epigraph_index == j):
        kept = np.flatnonzero(np.diag(cone.E))
        found.append(float(np.linalg.eigvalsh(schur_complement(moved_by(cone, step, 0.0), kept))[0]))
    return min([*found, *(model.epigraph_rows + model.epigraph_jacobian @ step.d if j == 0 else ())])


@pytest.mark.parametrize("seed", range(16))
def test_a_step_minimises_its_model_and_its_multipliers_prove_it(seed: int):
    model = random_model(seed)
    step = minimise(model, 1e-10)
    d, e, value = by_cvxpy(model)
    np.testing.assert_allclose(step.d, d, atol=1e-4)
    assert step.slack == pytest.approx(e, abs=1e-4)
    t = [raised(model, step, j) for j in range(len(model.weights))]
    own = 0.5 * step.d @ model.B @ step.d + model.g @ step.d - model.weights @ t + model.penalty * step.slack
    assert own == pytest.approx(value, abs=1e-5)
    # feasible, multipliers >= 0, nothing times something is nothing, and the gradient of the Lagrangian is 0
    close = 2e-5 * model.penalty
    rows = model.rows + model.jacobian @ step.d + step.slack
    hard = model.epigraph_rows + model.epigraph_jacobian @ step.d - (t[0] if len(model.epigraph_rows) else 0.0)
    for margin, price in ((rows, step.row_multipliers), (hard, step.epigraph_multipliers)):
        assert margin.min(initial=0.0) > -1e-6
        assert price.min(initial=0.0) >= 0
        assert np.abs(margin * price).max(initial=0.0) < close
    for cone, Z in zip(model.cones, step.Z, strict=True):
        matrix = moved_by(cone, step, 0.0 if cone.epigraph_index is None else t[cone.epigraph_index])
        assert np.linalg.eigvalsh(matrix)[0] > -1e-6
        assert np.linalg.eigvalsh(Z)[0] >= -1e-9
        assert abs(np.sum(Z * matrix)) < close
    slope = model.B @ step.d + model.g - step.row_multipliers @ model.jacobian - step.epigraph_multipliers @ model.epigraph_jacobian
    slope -= sum(np.einsum("ij,qij->q", Z, cone.D) for cone, Z in zip(model.cones, step.Z, strict=True))
    np.testing.assert_allclose(np.abs(slope), step.bound_multipliers, atol=close)
    pushed = step.bound_multipliers > 1e-3
    np.testing.assert_allclose(step.d[pushed], np.where(slope < 0, model.upper, model.lower)[pushed], atol=1e-5)
    for j, weight in enumerate(model.weights):
        shares = [np.sum(Z * cone.E) for cone, Z in zip(model.cones, step.Z, strict=True) if cone.epigraph_index == j]
        assert sum(shares) + (step.epigraph_multipliers.sum() if j == 0 else 0.0) == pytest.approx(weight, rel=1e-4)
    paid = step.row_multipliers.sum() + sum(cone.slack_factor * np.trace(Z) for cone, Z in zip(model.cones, step.Z, strict=True))
    assert paid <= model.penalty * (1 + 1e-5)
    assert step.slack < 1e-5 or paid == pytest.approx(model.penalty, rel=1e-4)


def test_random_models_have_slack_bounds_and_hard_rows_at_work():
    """The cases above are none of them empty."""
    steps = [minimise(random_model(seed), 1e-10) for seed in range(16)]
    assert sum(step.slack > 1e-3 for step in steps) >= 3
    assert sum(step.slack < 1e-6 for step in steps) >= 3
    assert sum((step.bound_multipliers > 1e-3).any() for step in steps) >= 3
    assert sum((step.row_multipliers > 1e-3).any() for step in steps) >= 3
    assert sum((step.epigraph_multipliers > 1e-3).any() for step in steps) >= 2


def test_a_model_without_a_solution_has_no_step():
    model = random_model(1)
    apart = ConicQP(**{**vars(model), "lower": model.upper + 1.0})
    assert minimise(apart, 1e-9) is None


# ---------------------------------------------------------------- Newton's step

NO_FACE: dict[str, Any] = {"faces": ()}


@pytest.mark.parametrize("T", [0, 1])
@pytest.mark.parametrize("seed", range(4))
def test_newtons_step_solves_the_equations_of_what_is_active(seed: int, T: int):
    """Rows, hard rows and held parameters: by eliminating them, with a basis of what they leave free."""
    random, q, held = np.random.default_rng(seed), 7, np.arange(7) >= 5
    H, rows, S = random.standard_normal((q, q)), random.standard_normal(2), random.standard_normal((2, q))
    H = H + H.T  # of either sign
    hard, hard_slopes = random.standard_normal(2 * T), random.standard_normal((2 * T, q))
    g, given, weights = random.standard_normal(q), random.standard_normal(q), np.ones(T)
    d = newton_step(KKTSystem(H, g, weights, (), rows, S, hard, hard_slopes, held, given))
    # unknowns (d, t): A y = b leaves y = y_0 + N z
    A = np.vstack([np.hstack([S, np.zeros((2, T))]), np.hstack([hard_slopes, -np.ones((2 * T, T))]), np.eye(q + T)[:q][held]])
    b = np.concatenate([-rows, -hard, given[held]])
    y, N = np.linalg.lstsq(A, b, rcond=None)[0], null_space(A)
    full = np.zeros((q + T, q + T))
    full[:q, :q] = H
    z = np.linalg.solve(N.T @ full @ N, -N.T @ (full @ y + np.concatenate([g, -weights])))
    np.testing.assert_allclose(d, (y + N @ z)[:q], rtol=1e-7, atol=1e-9)


def test_newtons_step_does_not_exist_where_its_equations_contradict_each_other():
    row = np.array([[1.0, 0.0]])
    none = np.zeros((0, 2))
    active = KKTSystem(
        np.eye(2), np.ones(2), np.zeros(0), (), np.array([1.0, 2.0]), np.vstack([row, row]), np.zeros(0), none, row[0] < 0, row[0]
    )
    assert newton_step(active) is None


def cone_with(multiplicity: int, seed: int, q: int = 6, n: int = 5) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A (n, n) whose smallest eigenvalue, 1, is so many fold; its vectors U; slopes D (q, n, n)."""
    random = np.random.default_rng(seed)
    Q = np.linalg.qr(random.standard_normal((n, n)))[0]
    D = random.standard_normal((q, n, n))
    values = np.concatenate([np.ones(multiplicity), 1 + np.arange(1.0, n - multiplicity + 1)])
    return (Q * values) @ Q.T, Q[:, :multiplicity], D + D.swapaxes(1, 2)


def curvature_in_newton(A: np.ndarray, D: np.ndarray, Z: np.ndarray, tangent: np.ndarray) -> np.ndarray:
    """The edge's curvature (k, k) along tangents (q, k) that Newton's step counts with, from how its steps answer to gradients."""
    q = len(D)
    H, none = 40 * np.eye(q), np.zeros((0, q))

    def step(g: np.ndarray) -> np.ndarray:
        face = ActiveCone(A, D, np.eye(len(A)), 0, Z)
        held = np.zeros(q, dtype=bool)
        found = newton_step(KKTSystem(H, g, np.array([np.trace(Z)]), (face,), np.zeros(0), none, np.zeros(0), none, held, np.zeros(q)))
        assert found is not None
        return tangent.T @ found

    answers = np.column_stack([step(column) - step(np.zeros(q)) for column in tangent.T])
    return -np.linalg.inv(answers) - 40 * np.eye(tangent.shape[1])


@pytest.mark.parametrize("judged", [5, 3])
@pytest.mark.parametrize("multiplicity", [1, 2])
def test_newtons_step_is_quadratic_where_vectors_are_those_of_where_it_leads(multiplicity: int, judged: int):
    """At a distance s from the optimum of weight t + g'd - d'H d / 2, M(d) >= t E, with its multipliers, the step errs by O(s^2).

    The optimum is built: M(0) - E = A has zeros along U, Z = U Z_u U' with the trace of 1, g = -(<Z, D_i>), M = E + A + sum d_i D_i.
    """
    random = np.random.default_rng(10 * judged + multiplicity)
    A, U, D = cone_with(multiplicity, judged)
    A = A - np.eye(5)
    E = np.diag((np.arange(5) < judged).astype(float))
    Z = U @ np.diag(1.0 + np.arange(multiplicity)) @ U.T
    Z /= np.sum(Z * E)
    q, v, H = len(D), random.standard_normal(len(D)), 50 * np.eye(len(D))
    g, none = np.einsum("ij,qij->q", Z, D), np.zeros((0, len(D)))

    def error(s: float) -> float:
        begin = -s * v  # the optimum is s v away; the objective's slope is g + H d
        cone = ActiveCone(E + A + np.tensordot(begin, D, 1), D, E, 0, Z)
        system = KKTSystem(
            H, g + H @ begin, np.ones(1), (cone,), np.zeros(0), none, np.zeros(0), none, np.zeros(q, dtype=bool), np.zeros(q)
        )
        d = newton_step(system)
        assert d is not None
        return float(np.linalg.norm(d - s * v))

    errors = np.array([error(s) for s in (4e-3, 2e-3, 1e-3)])
    assert (errors[1:] <= errors[:-1] / 3.6 + 1e-12).all()  # halved: a quarter


@pytest.mark.parametrize("seed", range(3))
def test_newtons_step_knows_how_a_simple_smallest_eigenvalue_bends(seed: int):
    """Its curvature is minus the Hessian of lambda_min, here by differences, times the multiplier."""
    A, U, D = cone_with(1, seed)
    Z = 2.5 * U @ U.T

    def smallest(d: np.ndarray) -> float:
        return 2.5 * float(np.linalg.eigvalsh(A + np.tensordot(d, D, 1))[0])

    expected = -differences(lambda d: slopes(smallest, d), np.zeros(len(D)), np.ones(len(D)))
    np.testing.assert_allclose(curvature_in_newton(A, D, Z, np.eye(len(D))), expected, rtol=1e-5, atol=1e-5 * np.abs(expected).max())


@pytest.mark.parametrize("multiplicity", [2, 3])
@pytest.mark.parametrize("seed", range(2))
def test_newtons_step_knows_how_the_edge_of_equal_eigenvalues_bends(seed: int, multiplicity: int):
    """Along curves d(s) that keep the smallest eigenvalues equal, d2/ds2 (lambda_min - <Z, A + sum d_i D_i>) = -curvature, tr Z = 1."""
    A, U, D = cone_with(multiplicity, seed, q=8)
    rows, columns = np.tril_indices(multiplicity)
    split = (U.T @ D @ U)[:, rows, columns].T  # what must move alike on the diagonal and stay 0 beside it
    split = split - np.outer((rows == columns).astype(float), np.trace(U.T @ D @ U, axis1=1, axis2=2) / multiplicity)
    tangent = null_space(split)
    normals = qr(split.T, mode="economic", pivoting=True)[0][:, : len(D) - tangent.shape[1]]
    weights = np.diag(np.arange(1.0, multiplicity + 1)) + 0.3
    Z = U @ weights @ U.T / np.trace(weights)

    def matrix(d: np.ndarray) -> np.ndarray:
        return A + np.tensordot(d, D, 1)

    def unequal(d: np.ndarray) -> np.ndarray:
        vectors = np.linalg.eigh(matrix(d))[1][:, :multiplicity]
        left, _, right = np.linalg.svd(vectors.T @ U)  # the same space with axes that do not jump
        block = (vectors @ left @ right).T @ matrix(d) @ (vectors @ left @ right)
        return (block - np.eye(multiplicity) * np.trace(block) / multiplicity)[rows, columns][: normals.shape[1]]

    def left_over(along: np.ndarray) -> float:
        c = root(lambda c: unequal(tangent @ along + normals @ c), np.zeros(normals.shape[1]), tol=1e-13).x
        d = tangent @ along + normals @ c
        assert np.ptp(np.linalg.eigvalsh(matrix(d))[:multiplicity]) < 1e-9
        return float(np.linalg.eigvalsh(matrix(d))[0] - np.sum(Z * matrix(d)))

    found, eps = curvature_in_newton(A, D, Z, tangent), 2e-3
    for along in np.vstack([np.eye(tangent.shape[1])[:2], np.ones(tangent.shape[1]) / 2]):
        bend = (left_over(eps * along) - 2 * left_over(0 * along) + left_over(-eps * along)) / eps**2
        assert along @ found @ along == pytest.approx(-bend, rel=1e-3, abs=1e-3)


# ---------------------------------------------------------------- some of the states


def information(n: int, seed: int) -> np.ndarray:
    factor = np.random.default_rng(seed).standard_normal((n, n + 2))
    return factor @ factor.T


@pytest.mark.parametrize("kept", [[0], [1, 3], [4, 0, 2], [0, 1, 2, 3, 4]])
def test_the_inverse_of_what_is_left_for_some_states_is_their_block_of_the_inverse(kept: list[int]):
    """Their covariance when the others are found as well; also by the lift, whose slope it has."""
    W, kept_states = information(5, 0), np.array(kept)
    left = schur_complement(W, kept_states)
    np.testing.assert_allclose(np.linalg.inv(left), np.linalg.inv(W)[np.ix_(kept, kept)], rtol=1e-9)
    L = elimination_matrix(W, kept_states)
    np.testing.assert_allclose(L.T @ W @ L, left, rtol=1e-9, atol=1e-9)
    dW = information(5, 1) - information(5, 2)
    eps = 1e-4
    difference = (schur_complement(W + eps * dW, kept_states) - schur_complement(W - eps * dW, kept_states)) / (2 * eps)
    np.testing.assert_allclose(L.T @ dW @ L, difference, rtol=1e-5, atol=1e-5)


def test_what_nothing_is_known_of_takes_nothing_away():
    W = np.zeros((3, 3))
    W[:2, :2] = [[3.0, 1.0], [1.0, 2.0]]
    np.testing.assert_allclose(schur_complement(W, np.array([0, 1])), W[:2, :2])
    np.testing.assert_allclose(schur_complement(W, np.array([0])), [[3.0 - 1.0 / 2.0]])


@pytest.mark.parametrize("units", [1.0, 1e-6, 1e6])
def test_the_units_of_the_others_change_nothing(units: float):
    W, D = information(4, 3), np.diag([1.0, 1.0, units, 1.0])
    np.testing.assert_allclose(schur_complement(D @ W @ D, np.array([0, 1])), schur_complement(W, np.array([0, 1])), rtol=1e-8)


SMOOTH = pytest.mark.parametrize("criterion", [od.LogDet(), od.TraceInverse()], ids=lambda criterion: type(criterion).__name__)
KEPT = pytest.mark.parametrize("kept", [(0, 1, 2, 3, 4), (0, 2), (3,)], ids=str)


@SMOOTH
@KEPT
@pytest.mark.parametrize("seed", range(2))
def test_a_criterion_of_some_states_has_exact_slopes_and_curvatures(criterion: AbstractCriterion, kept: tuple[int, ...], seed: int):
    """Of several matrices at once, each moving by its own slopes: W(d) = W + sum d_i D_i."""
    aim = CriterionObjective(criterion, np.array(kept), Smallest())
    matrices = np.array([information(5, seed), information(5, seed + 10)])
    D = np.random.default_rng(seed).standard_normal((2, 3, 5, 5))
    D = D + D.swapaxes(2, 3)

    def moved(d: np.ndarray) -> np.ndarray:
        return matrices + np.tensordot(d, D, (0, 1))

    def slope(d: np.ndarray) -> np.ndarray:
        return np.einsum("bij,bqij->bq", aim.gradients(moved(d)), D)

    assert aim.values(matrices)[0] == pytest.approx(
        criterion.value(np.linalg.inv(np.linalg.inv(matrices[0])[np.ix_(kept, kept)])), rel=1e-9
    )
    nothing, width = np.zeros(3), np.full(3, 0.1)
    np.testing.assert_allclose(slope(nothing).T, differences(lambda d: aim.values(moved(d)), nothing, width), rtol=1e-6, atol=1e-8)
    found = aim.curvatures(matrices, D)
    expected = -np.moveaxis(differences(slope, nothing, width), 0, 1)
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-6 * np.abs(expected).max())
    assert all(np.linalg.eigvalsh((bent + bent.T) / 2)[0] >= -1e-9 for bent in found)


@KEPT
def test_the_smallest_eigenvalue_of_some_states_is_the_edge_of_its_cone(kept: tuple[int, ...]):
    """The largest t with W - t E >= 0, E = 1 on the diagonal of those states."""
    aim, W = CriterionObjective(od.MinEigenvalue(), np.array(kept), Smallest()), information(5, 7)
    t, E = evaluate_objective(aim, W[None]), aim.cone_matrix(5)
    assert aim.is_cone
    assert np.linalg.eigvalsh(W - t * E)[0] == pytest.approx(0.0, abs=1e-9 * np.abs(W).max())
    assert np.linalg.eigvalsh(W - 1.01 * t * E)[0] < -1e-4 * t
    np.testing.assert_allclose(np.sum(aim.gradients(W[None])[0] * E), 1.0, rtol=1e-9)
    assert np.sum(aim.gradients(W[None])[0] * W) == pytest.approx(t, rel=1e-9)


def test_the_worst_or_the_mean_of_several_matrices_is_judged():
    W = np.array([np.diag([1.0, 4.0]), np.diag([3.0, 2.0])])
    assert evaluate_objective(CriterionObjective(od.MinEigenvalue(), np.arange(2), Smallest()), W) == 1.0
    assert evaluate_objective(CriterionObjective(od.MinEigenvalue(), np.arange(2), Mean()), W) == 1.5
    assert evaluate_objective(LinearObjective(np.diag([1.0, 0.5])), W) == 3.0


# ---------------------------------------------------------------- the climb, against the lifted program


def lifted(problem: od.DesignProblem) -> tuple[ca.Function, ca.Function]:
    """S (W + known) S of parameters, in one graph: its matrix, and IPOPT on max t, S W S / c - t I = L L', L lower, diagonal >= 0."""
    model, grid = problem.system.model, problem.grid
    one, n = step_of(model, problem.step).without_disturbance(), len(model.states)
    Phi_now = ca.SX.sym("Phi", n, n)
    blocks = ca.Function("blocks", [one.x, Phi_now], blocks_of(model, Phi_now))
    following = ca.Function("following", [one.x, one.u, Phi_now], [one.x_next, one.F @ Phi_now])
    p = ca.SX.sym("p", len(problem.path.box(grid)[0]))
    u, due = ca.SX(problem.path.inputs(p, grid)), sampling_mask(problem.system, problem.steps, problem.step)
    x, Phi, W = ca.SX(problem.x0), ca.SX.eye(n), ca.SX(np.asarray(problem.known))
    for k in range(problem.steps):
        found = blocks.call([x, Phi])
        W += sum((found[s] for s in np.flatnonzero(due[k])), ca.SX(n, n))
        x, Phi = following(x, u[k, :].T, Phi)
    W = W * ca.SX(np.outer(problem.units, problem.units))
    c, t, factor = ca.SX.sym("c"), ca.SX.sym("t"), ca.SX.sym("L", ca.Sparsity.lower(n))
    miss = ca.tril(W / c - t * ca.SX.eye(n) - factor @ factor.T)
    options = {
        "print_time": False,
        "ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-9, "max_iter": 300, "bound_push": 1e-8, "mu_init": 1e-6},
    }
    nlp = {"x": ca.vertcat(p, t, factor.nz[:]), "p": c, "f": -t, "g": miss.nz[:]}
    return ca.Function("W", [p], [W]), ca.nlpsol("lifted", "ipopt", nlp, options)


def by_ipopt(problem: od.DesignProblem, functions: tuple[ca.Function, ca.Function], p: np.ndarray) -> tuple[float, float]:
    """The lifted program's value from parameters p, and lambda_min of the matrix at the parameters where it stops."""
    W_of, solver = functions
    W, n, q = W_of(p).full(), len(problem.x0), len(p)
    c, lowest = np.trace(W) / n, np.linalg.eigvalsh(W)[0]
    rows, columns = np.tril_indices(n)
    order = np.lexsort((rows, columns))  # column by column, as the solver has them
    rows, columns = rows[order], columns[order]
    values, vectors = np.linalg.eigh(W / c - lowest / c * np.eye(n))
    R = qr((vectors * np.sqrt(np.maximum(values, 0.0))).T)[1]
    L = (R * np.where(np.diag(R) < 0, -1.0, 1.0)[:, None]).T
    lower, upper = problem.path.box(problem.grid)
    far = np.full(len(rows), np.inf)
    found = solver(
        x0=np.concatenate([p, [lowest / c], L[rows, columns]]),
        p=c,
        lbx=np.concatenate([lower, [-np.inf], np.where(rows == columns, 0.0, -far)]),
        ubx=np.concatenate([upper, [np.inf], far]),
        lbg=0,
        ubg=0,
    )
    x = found["x"].full().ravel()
    return float(c * x[q]), float(np.linalg.eigvalsh(W_of(np.clip(x[:q], lower, upper)).full())[0])


SMALL: dict[str, od.DesignProblem] = {
    "gps": turning(CASES["gps"].system, bounds={"turn_rate": (-0.6, 0.6)}),
    "gps, other units": turning(CASES["gps"].system, scale=(1.0, 1.0, 1.0, 1.0, 1.0), path=od.PiecewiseConstant(7)),
    "looking": turning(path=od.PiecewiseConstant(6)),
    "two inputs": driving(path=od.PiecewiseConstant(5)),
    "no vehicle": CASES["no vehicle"],
}


def climbed_from(problem: od.DesignProblem, u: np.ndarray) -> LocalSolution:
    return solve_locally(LocalSolve(problem, "", u, (problem.path,), True))


@pytest.mark.parametrize("problem", SMALL.values(), ids=SMALL.keys())
def test_an_interior_point_method_on_the_lifted_program_finds_nothing_better(problem: od.DesignProblem):
    """max t subject to S W S / c - t I = L L', from where the climb stops; and near it, it finds the same."""
    functions = lifted(problem)
    for _, u in islice(start_inputs(problem, seed=1), 3):
        found = climbed_from(problem, u)
        assert found.status is od.Status.LOCALLY_OPTIMAL
        value = float(np.linalg.eigvalsh(by_analysis(problem, found.path)[0])[0])
        assert found.objective == pytest.approx(value, rel=1e-7)
        np.testing.assert_allclose(functions[0](found.p).full(), by_analysis(problem, found.path)[0], rtol=1e-8, atol=1e-8)
        claimed, lowest = by_ipopt(problem, functions, found.p)
        assert lowest <= value * (1 + 1e-6)
        lower, upper = problem.path.box(problem.grid)
        beside = np.clip(found.p + 0.01 * (upper - lower) * np.random.default_rng(0).standard_normal(len(found.p)), lower, upper)
        claimed, lowest = by_ipopt(problem, functions, beside)
        assert claimed == pytest.approx(lowest, rel=1e-5)
        assert lowest == pytest.approx(value, rel=1e-4)


@pytest.mark.parametrize("criterion", [od.MinEigenvalue(), od.LogDet(), od.TraceInverse()], ids=lambda criterion: type(criterion).__name__)
def test_a_climb_is_at_least_where_it_began_and_its_objective_is_that_of_its_path(criterion: AbstractCriterion):
    problem = turning(criterion=criterion, constraints=(od.StandOff(1.0),))
    for seed in range(4):
        p = somewhere(problem, seed)
        found = climbed_from(problem, flown(problem, p).u)
        assert found.status is od.Status.LOCALLY_OPTIMAL
        assert found.residual < (1e-3 if criterion.resolution == 0 else 1e-2)  # log det is counted in units of its own
        assert found.objective == pytest.approx(problem.value(found.path), rel=1e-9, abs=1e-9)
        assert found.objective >= problem.value(flown(problem, p))
        np.testing.assert_array_equal(found.u, found.path.u)
        np.testing.assert_allclose(flown(problem, found.p).u, found.u, rtol=1e-12)
        assert matrix_objective_of(problem).criterion is criterion


@pytest.mark.parametrize("samples", [3, 8])
def test_draws_that_are_not_the_worst_hold_nothing_active(samples: int):
    """Their multipliers are the rounding of an interior point: taken for active, they made climbs creep to the iteration limit."""
    design = od.design_trajectory(turning(robust=od.Robust(PRIOR, samples=samples)), starts=3)
    assert all(start.status is od.Status.LOCALLY_OPTIMAL for start in design.starts)
    assert all(start.residual < 1e-3 for start in design.starts)


@pytest.mark.parametrize("problem", [SMALL["gps"], SMALL["two inputs"]], ids=["gps", "two inputs"])
def test_a_climb_leaves_a_path_that_shows_nothing(problem: od.DesignProblem):
    """Straight on, lambda_min = 0, and its slope is 0 in all directions, as it can only grow with the square of a turn."""
    straight = np.tile((problem.lower + problem.upper) / 2, (problem.steps, 1))
    straight[:, -1] = 0.0
    alone = turning(od.System(problem.system.vehicle, (od.GPS(1.0),)), bounds=problem.bounds, path=problem.path)
    W = by_analysis(alone, od.simulate(alone.system, alone.x0, straight, alone.step, tolerance=alone.tolerance))[0]
    assert np.linalg.eigvalsh(W)[0] < 1e-9 * np.linalg.eigvalsh(W)[-1]
    found = climbed_from(alone, straight)
    assert found.status is od.Status.LOCALLY_OPTIMAL
    others = [climbed_from(alone, u).objective for _, u in islice(start_inputs(alone, seed=0), 2)]
    assert found.objective > 0.3 * max(others)


def test_what_falls_short_between_the_nodes_is_asked_for_more():
    """A disc that a straight step would cut: all nodes outside, and all of the path in between as well."""
    limits = (od.KeepOut((3.8, 0.1), 1.0), od.Goal((7.6, 0.0), 0.3))
    start, bounds = (0.0, 0.0, -0.2, 0.0, 0.0), {"turn_rate": (-0.7, 0.7)}
    problem = turning(start=start, constraints=limits, step=1.0, path=od.PiecewiseConstant(4), bounds=bounds)
    _, u = next(start_inputs(problem, seed=0))

    def margins(found: LocalSolution) -> tuple[float, float]:
        fine = fine_path(problem, found.path).margins
        return float(fine[:, 0].min()), float(fine[-1, 1])

    unchecked, checked = solve_locally(LocalSolve(problem, "", u, (problem.path,), False)), climbed_from(problem, u)
    assert node_margins(problem, unchecked.path.x, unchecked.u).min() >= -1e-4
    assert margins(unchecked)[0] < -1e-3
    assert min(margins(checked)) >= -1e-6
    # asked for more, not for much more
    assert 0.99 * problem.value(unchecked.path) <= checked.objective <= 1.01 * problem.value(unchecked.path)
    assert margins(checked)[0] < 0.01


@pytest.mark.parametrize("criterion", [od.LogDet(), od.TraceInverse()])
@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
def test_slopes_where_nothing_is_known_point_there(criterion, unit):
    # W = diag(4, 0) and a rotated one are singular to the last bit: no number, but a finite slope that is largest in the hidden direction
    for hidden in (np.array([0.0, 1.0]), np.array([0.6, -0.8])):
        seen = np.array([hidden[1], -hidden[0]])
        slope = criterion.slope(4.0 * unit * np.outer(seen, seen))
        assert np.isfinite(slope).all()
        assert hidden @ slope @ hidden > 1e6 * abs(seen @ slope @ seen)


@pytest.mark.parametrize("policy", ["", "0"])
@pytest.mark.parametrize("of_each_run", [False, True])
def test_sensitivities_are_sums_over_earlier_inputs(of_each_run: bool, policy: str, monkeypatch: pytest.MonkeyPatch):
    """dz_k/dp = A_k-1 ... A_0 G_0 + sum_j A_k-1 ... A_j+1 B_j M_j, and sum_k D_k dz_k/dp; most entries 0, parameters of later steps too."""
    monkeypatch.setenv("OBSDESIGN_COMPILE", policy)
    random, (runs, steps, c, m, b, q) = np.random.default_rng(0), (2, 6, 4, 2, 3, 5)

    def sparse(*shape: int) -> np.ndarray:
        return random.standard_normal(shape) * (random.uniform(size=shape) < 0.4)

    A, B, D = sparse(runs, steps, c, c), sparse(runs, steps, c, m), sparse(runs, steps, b, c)
    M = sparse(runs, steps, m, q) if of_each_run else sparse(steps, m, q)
    M = M * (np.arange(steps)[:, None, None] >= np.arange(q))  # parameter i works from step i on
    initial = sparse(runs, c, q)
    found = propagate_sensitivity(Linearisation(A, B, D), initial, M)
    for run in range(runs):
        total = np.zeros((b, q))
        for k in range(steps + 1):
            expected = np.linalg.multi_dot([np.eye(c), *A[run, :k][::-1], initial[run]])
            for j in range(k):
                forcing = B[run, j] @ (M[run, j] if of_each_run else M[j])
                expected = expected + np.linalg.multi_dot([np.eye(c), *A[run, j + 1 : k][::-1], forcing])
            np.testing.assert_allclose(found.G[run, k], expected, rtol=1e-12, atol=1e-12)
            total += D[run, k] @ expected if k < steps else 0.0
        np.testing.assert_allclose(found.gains[run], total, rtol=1e-12, atol=1e-12)


def test_a_climb_ends_where_it_is_next_to_what_nothing_exceeds():
    """20 turn rates reach the cap 25.2332... from anywhere: told of it, a climb ends sooner, within 1e-7 of it, and never above."""
    problem = od.DesignProblem(
        od.System(od.Dubins(1.0, wind="constant"), (od.GPS(1.0),)),
        (0.0, 0.0, 0.0, 0.3, -0.2),
        20.0,
        0.2,
        path=od.PiecewiseConstant(20),
        bounds={"turn_rate": (-1.0, 1.0)},
    )
    cap = cap_of(problem)
    assert cap is not None
    for seed in range(3):
        u = np.repeat(np.random.default_rng(seed).uniform(-1, 1, 20), 5)[:, None]
        free = solve_locally(LocalSolve(problem, "", u, (problem.path,), True))
        ended = solve_locally(LocalSolve(problem, "", u, (problem.path,), True, ceiling=cap.value))
        assert ended.status is od.Status.LOCALLY_OPTIMAL
        assert ended.iterations <= free.iterations
        assert cap.value * (1 - 1e-7) <= ended.objective <= cap.value * (1 + 1e-9)
        assert ended.objective <= free.objective * (1 + 1e-9)


def test_the_solver_imports_nothing_but_its_own_modules_conic_programs_and_the_words_of_status():
    room = Path(od.__file__).parent / "design" / "sqp"
    allowed = ("obsdesign.design.sqp.", "obsdesign.conic", "obsdesign.status")
    for file in sorted(room.glob("*.py")):
        statements = [node for node in ast.walk(ast.parse(file.read_text())) if isinstance(node, (ast.Import, ast.ImportFrom))]
        modules = [node.module or "." if isinstance(node, ast.ImportFrom) else node.names[0].name for node in statements]
        assert [m for m in modules if m.startswith(("obsdesign", ".")) and not m.startswith(allowed)] == [], file.name
