"""A posterior judged on the way: its value against covariances from NumPy, its derivatives, its designs, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_posterior import JUDGED, SMALL, judged_by

import obsdesign as od
from obsdesign.design.initial_guesses import start_inputs
from obsdesign.design.nlp.criterion_objective import matrix_objective_of
from obsdesign.design.nlp.program import Program
from obsdesign.design.sqp.combination import ReciprocalSum, Smallest, WeightedSum
from obsdesign.design.sqp.evaluation import Multipliers
from obsdesign.design.sqp.matrix_objective import combination_curvature, evaluate_objective, initial_weights
from obsdesign.planning.remaining_problem import MovingHorizon

few = settings(deadline=None, max_examples=6, database=None, derandomize=True)
STEPS = 16
RISING = tuple(float(k % 5) for k in range(STEPS))  # some of them 0
OVERS = ("end", "mean", "worst", RISING)
EACH_OVER = pytest.mark.parametrize("over", OVERS, ids=("end", "mean", "worst", "weights"))
INNER = {"trace": od.TraceInverse(), "lambda": od.MinEigenvalue(), "log det": od.LogDet()}
EACH_CRITERION = pytest.mark.parametrize("inner", INNER.values(), ids=INNER.keys())
EACH_SYSTEM = pytest.mark.parametrize("name", JUDGED)
COST = {
    od.TraceInverse: lambda P: float(np.trace(P)),
    od.MinEigenvalue: lambda P: float(np.linalg.eigvalsh(P)[-1]),
    od.LogDet: lambda P: float(np.linalg.slogdet(P)[1]),
}


def asked(name: str, inner: od.AbstractCriterion, over: object, **changes: object) -> od.DesignProblem:
    problem = JUDGED[name]
    return replace(problem, criterion=replace(problem.criterion, criterion=inner, over=over), **changes)


def inputs(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-0.5, 0.5, 4)


def costs(problem: od.DesignProblem, path: od.Trajectory) -> np.ndarray:
    """c_k of P_k = J_k^-1 of the states asked about, in units, for k = 0..N-1: by NumPy alone."""
    known, S = problem.criterion, np.diag(problem.scale)
    J = od.posterior_information(problem.system, path, known.prior, known.disturbance_psd, known.unknown_inputs)[:-1]
    index = np.ix_(problem.about_indices, problem.about_indices)
    return np.array([COST[type(known.criterion)](np.linalg.inv(S @ matrix @ S)[index]) for matrix in J])


def value_of_costs(problem: od.DesignProblem, c: np.ndarray) -> float:
    """What the criterion must be of costs c (N,)."""
    over = problem.criterion.over
    total = {"end": c[-1], "mean": c.mean(), "worst": c.max()}[over] if isinstance(over, str) else float(np.array(over) @ c)
    return 1 / total if isinstance(problem.criterion.criterion, od.MinEigenvalue) else -total


@EACH_SYSTEM
@EACH_OVER
@EACH_CRITERION
@few
@given(seed=st.integers(0, 10**6), some=st.booleans())
def test_the_value_is_that_of_the_covariances_of_the_states_asked_about(
    name: str, inner: od.AbstractCriterion, over: object, seed: int, some: bool
):
    """With process noise, unknown inputs and errors that last: from the inverses of `posterior_information`."""
    problem = asked(name, inner, over, about=("x", "heading") if some else ())
    path = problem.path_of(inputs(seed))
    assert problem.value(path) == pytest.approx(value_of_costs(problem, costs(problem, path)), rel=1e-9, abs=1e-9)


@EACH_OVER
@EACH_CRITERION
def test_a_path_costs_what_the_schedule_of_all_its_sensors_costs_a_filter(inner: od.AbstractCriterion, over: object):
    """The same C as that of `select_for_filter`, where all may be on."""
    problem = asked("correlated noise", inner, over, about=("x", "y"))
    path, known = problem.path_of(inputs(5)), problem.criterion
    schedule = od.select_for_filter(
        problem.system,
        path,
        known.prior,
        per_segment=len(problem.system.model.channels),
        segment=4.0,
        disturbance_psd=known.disturbance_psd,
        about=problem.about,
        over=over,  # pyright: ignore[reportArgumentType]
        criterion=inner,
        scale=problem.scale,
    )
    assert schedule.chosen.all()
    expected = 1 / schedule.value if isinstance(inner, od.MinEigenvalue) else -schedule.value
    assert problem.value(path) == pytest.approx(expected, rel=1e-9)


@EACH_CRITERION
def test_weights_on_the_last_instant_are_the_end_and_equal_ones_the_mean(inner: od.AbstractCriterion):
    path = JUDGED["noise"].path_of(inputs(3))
    value = {over: asked("noise", inner, over).value(path) for over in ("end", "mean", "worst")}
    last, equal = (0.0,) * (STEPS - 1) + (1.0,), (1 / STEPS,) * STEPS
    assert asked("noise", inner, last).value(path) == pytest.approx(value["end"], rel=1e-12)
    assert asked("noise", inner, equal).value(path) == pytest.approx(value["mean"], rel=1e-12)
    assert value["worst"] < value["mean"]
    assert value["worst"] <= value["end"]


def test_the_end_is_what_it_was_to_the_last_bit():
    """The number of S J S of the last samples, and one matrix in the program of the solver."""
    problem = asked("noise", od.TraceInverse(), "end")
    path, known = problem.path_of(inputs(1)), problem.criterion
    J = od.posterior_information(problem.system, path, known.prior, known.disturbance_psd, known.unknown_inputs)
    assert problem.value(path) == od.TraceInverse().value(J[-2] * np.outer(problem.scale, problem.scale))
    assert Program(problem).evaluate(inputs(1)).matrices.shape == (1, 5, 5)
    assert replace(known, over="end") == known
    assert replace(known, over="mean") != known


# ---------------------------------------------------------------- derivatives


def gradient(problem: od.DesignProblem, p: np.ndarray) -> np.ndarray:
    program, objective = Program(problem), matrix_objective_of(problem)
    values = program.evaluate(p)
    weights = initial_weights(objective, values.matrices)
    return np.einsum("b,bij,bqij->q", weights, objective.gradients(values.matrices), program.derivatives(values).matrices)


def differences(function, p: np.ndarray, eps: float) -> np.ndarray:
    return np.array([(function(p + eps * unit) - function(p - eps * unit)) / (2 * eps) for unit in np.eye(len(p))])


@EACH_SYSTEM
@EACH_OVER
@EACH_CRITERION
def test_the_program_has_the_value_of_the_analysis_and_its_slope(name: str, inner: od.AbstractCriterion, over: object):
    """Against central differences of the value that is recomputed with square roots."""
    problem = asked(name, inner, over)
    p = np.array([0.31, -0.22, 0.17, 0.43])
    evaluated = evaluate_objective(matrix_objective_of(problem), Program(problem).evaluate(p).matrices)
    assert evaluated == pytest.approx(problem.value(problem.path_of(p)), rel=1e-8)
    expected = differences(lambda q: problem.value(problem.path_of(q)), p, 1e-4)
    np.testing.assert_allclose(gradient(problem, p), expected, rtol=1e-4, atol=1e-6 * max(1.0, abs(evaluated)))


@pytest.mark.parametrize("name", ["noise", "unknown wind"])
@pytest.mark.parametrize("over", ["mean", RISING], ids=["mean", "weights"])
@pytest.mark.parametrize("inner", [od.TraceInverse(), od.LogDet()], ids=["trace", "log det"])
def test_second_derivatives_are_those_of_the_slope(name: str, inner: od.AbstractCriterion, over: object):
    problem, p = asked(name, inner, over), np.array([0.31, -0.22, 0.17, 0.43])
    program, objective = Program(problem), matrix_objective_of(problem)
    values = program.evaluate(p)
    slopes, weights = program.derivatives(values), initial_weights(objective, values.matrices)
    weighted = objective.gradients(values.matrices) * weights[:, None, None]
    H = program.lagrangian_hessian(values, slopes, Multipliers(weighted, np.zeros((0, program.n, program.n)), np.zeros(0), 1.0))
    H = H + np.einsum("b,bij->ij", weights, objective.curvatures(values.matrices, slopes.matrices))
    expected = -differences(lambda q: gradient(problem, q), p, 1e-5)
    np.testing.assert_allclose(H, expected, rtol=1e-5, atol=1e-7 * max(1.0, np.abs(expected).max()))


@given(st.lists(st.tuples(st.floats(0.1, 10.0), st.floats(0.01, 100.0)), min_size=1, max_size=6))
def test_a_reciprocal_sum_is_concave_with_exact_derivatives(pairs: list[tuple[float, float]]):
    """1 / f is the weighted sum of 1 / v; f lies below its tangents."""
    weights, v = map(np.array, zip(*pairs, strict=True))
    combination = ReciprocalSum(weights)
    assert combination.total(v) == pytest.approx(1 / (weights @ (1 / v)), rel=1e-12)
    relative = 1e-5 * v
    steps = np.diag(relative)
    slopes = [(combination.total(v + step) - combination.total(v - step)) / (2 * step.max()) for step in steps]
    np.testing.assert_allclose(combination.slope(v), slopes, rtol=1e-5, atol=1e-9 * combination.total(v) / v.min())
    bends = np.array([(combination.slope(v + step) - combination.slope(v - step)) / (2 * step.max()) for step in steps])
    curvature = combination.curvature(v)
    np.testing.assert_allclose(curvature, -bends, rtol=1e-4, atol=1e-9 * (combination.slope(v) / v).max())
    unit = curvature * np.outer(v, v)
    assert np.linalg.eigvalsh(unit)[0] >= -1e-9 * max(1.0, np.abs(unit).max())
    for moved in (0.5 * v, 2.0 * v, v[::-1]):
        assert combination.total(moved) <= combination.model_total(v, moved) + 1e-9 * abs(combination.total(moved))


def test_combinations_of_nothing_known_are_nothing():
    """Where one number is 0 so is the total; the slope points to that number, finite."""
    combination = ReciprocalSum(np.array([0.5, 2.0]))
    assert combination.total(np.array([1.0, 0.0])) == 0.0
    np.testing.assert_allclose(combination.slope(np.array([1.0, 0.0])), [0.0, 0.5], atol=1e-9)
    assert np.isfinite(combination.curvature(np.zeros(2))).all()
    assert WeightedSum(np.ones(2)).total(np.array([1.0, -np.inf])) == -np.inf
    assert Smallest().total(np.array([2.0, 1.0])) == 1.0


def test_a_combination_that_bends_adds_its_curvature():
    """Of smallest eigenvalues that are simple: -d2 f along the slopes of the eigenvalues."""
    problem, p = asked("noise", od.MinEigenvalue(), "mean"), np.array([0.31, -0.22, 0.17, 0.43])
    program, objective = Program(problem), matrix_objective_of(problem)
    values = program.evaluate(p)
    D = program.derivatives(values).matrices
    found = combination_curvature(objective, values.matrices, D)
    lowest = np.array([np.linalg.eigh(W)[1][:, 0] for W in values.matrices])
    slopes, v = np.einsum("bi,bqij,bj->bq", lowest, D, lowest), objective.values(values.matrices)
    function = ReciprocalSum(np.full(STEPS, 1 / STEPS)).total
    bend = [(function(v + 1e-3 * s) - 2 * function(v) + function(v - 1e-3 * s)) / 1e-6 for s in slopes.T]
    np.testing.assert_allclose(np.diag(found), -np.array(bend), rtol=1e-3, atol=1e-5 * np.abs(bend).max())


# ---------------------------------------------------------------- designs


@EACH_OVER
@EACH_CRITERION
@pytest.mark.parametrize("name", ["correlated noise", "errors that last"])
def test_a_design_has_the_value_of_its_path_and_no_path_nearby_is_better(name: str, inner: od.AbstractCriterion, over: object):
    problem = asked(name, inner, over)
    design = od.design_trajectory(problem, starts=2)
    assert design.status is od.Status.LOCALLY_OPTIMAL
    assert design.value == pytest.approx(value_of_costs(problem, costs(problem, design.trajectory)), rel=1e-9)
    random = np.random.default_rng(0)
    for size in (1e-3, 0.05):
        for _ in range(10):
            near = np.clip(design.p + size * random.standard_normal(4), -0.5, 0.5)
            assert problem.value(problem.path_of(near)) <= design.value + 2e-6 * abs(design.value)
    starts = [problem.value(problem.path_along(u)) for (_, u), _ in zip(start_inputs(problem, 0), range(2), strict=False)]
    assert design.value >= max(starts) - 1e-9 * abs(design.value)


def test_a_design_is_the_best_for_what_it_was_asked():
    """Designs for the end, the mean and the worst, each judged by all three: every one wins its own."""
    overs = ("end", "mean", "worst")
    problems = [asked("correlated noise", od.TraceInverse(), over) for over in overs]
    paths = [od.design_trajectory(problem, starts=4).trajectory for problem in problems]
    values = np.array([[problem.value(path) for path in paths] for problem in problems])
    assert (np.diag(values) >= values.max(axis=1) - 1e-5 * np.abs(np.diag(values))).all()
    assert values[1, 1] > values[1, 0] + 1e-3  # not the same question


# ---------------------------------------------------------------- what is refused, and what is left in flight


@pytest.mark.parametrize(
    ("over", "words"),
    [
        ((1.0, -2.0), r"over\[1\] is -2: must be finite and at least 0"),
        ((1.0, np.nan), r"over\[1\] is nan: must be finite"),
        ((np.inf, 1.0), r"over\[0\] is inf: must be finite"),
        ((0.0, 0.0, 0.0), "over has 3 weights, all 0: one at least must be above 0"),
        ((), r"over has shape \(0,\): must be end, mean, worst or weights"),
        (np.ones((2, 2)), r"over has shape \(2, 2\)"),
        ("median", "over is 'median': must be"),
        (None, "over is None: must be"),
    ],
)
def test_instants_that_are_none_are_refused(over: object, words: str):
    with pytest.raises(od.InputError, match=words):
        od.Posterior(JUDGED["noise"].criterion.prior, over=over)  # pyright: ignore[reportArgumentType]


def test_weights_are_one_for_each_step_of_one_duration():
    criterion = replace(JUDGED["noise"].criterion, over=(1.0,) * 3)
    with pytest.raises(od.InputError, match="over has 3 weights: must be 16, one for each step"):
        judged_by(criterion, SMALL)
    with pytest.raises(od.InputError, match="over has weights: they need one duration"):
        judged_by(criterion, SMALL, duration=(1.5, 8.0))
    weights = np.linspace(0.0, 1.0, STEPS)
    assert judged_by(replace(criterion, over=weights), SMALL).criterion.over == tuple(weights)


def test_what_is_known_of_the_start_belongs_to_the_prior_of_a_posterior():
    with pytest.raises(od.InputError, match="known: a posterior criterion has a prior of its own"):
        judged_by(JUDGED["noise"].criterion, SMALL, known=np.eye(5))


def test_a_shrinking_flight_is_judged_by_the_weights_that_are_left():
    """Of the last steps; by the end once none of these counts."""
    problem = asked("noise", od.TraceInverse(), tuple(float(8 <= k < 12) for k in range(STEPS)))
    flight = MovingHorizon(problem, shrinks=True)
    planner = od.Planner(problem, every=2.0, horizon="shrinking", starts=1)
    plan, lengths = planner.step(problem.x0), []
    for left in ((0.0,) * 4 + (1.0,) * 4 + (0.0,) * 4, (1.0,) * 4 + (0.0,) * 4, "end"):
        x = plan.trajectory.x[4]
        remaining = flight.remaining_problem(x, plan, 4, od.Prior(x, covariance=problem.criterion.prior.covariance)).problem
        assert remaining.criterion.over == left
        assert remaining.criterion.prior.mean == pytest.approx(x)
        plan = planner.step(x, plan)
        lengths.append(plan.trajectory.steps)
        assert plan.value == pytest.approx(flight.remaining_problem(x, plan, 0, None).problem.value(plan.trajectory), rel=1e-9)
    assert lengths == [12, 8, 4]
