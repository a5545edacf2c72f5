"""A posterior of the samples that a schedule has: its value, its derivatives, its designs, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_filter_schedules import _covariances, _random_system
from test_posterior import JUDGED, SMALL, SMALL_SENSORS
from test_posterior_over_instants import COST, EACH_CRITERION, EACH_OVER, EACH_SYSTEM, asked, differences, gradient, inputs, value_of_costs

import obsdesign as od
from obsdesign.criteria.abstract import AbstractCriterion
from obsdesign.design.nlp.criterion_objective import matrix_objective_of
from obsdesign.design.nlp.program import Program
from obsdesign.design.sqp.matrix_objective import evaluate_objective

POINT = np.array([0.31, -0.22, 0.17, 0.43])


def schedule_of(problem: od.DesignProblem) -> np.ndarray:
    """A schedule of four segments (4, S): the first sensor in two, or where winds are unknown in all, the others in three."""
    chosen = np.zeros((4, len(problem.system.model.channels)))
    chosen[: 4 if problem.criterion.unknown_inputs else 2, 0] = chosen[1:, 1:] = 1.0
    return chosen


@EACH_OVER
@EACH_CRITERION
@pytest.mark.parametrize("seed", range(4))
def test_the_value_is_that_of_a_kalman_filter_that_has_the_scheduled_samples(seed: int, inner: AbstractCriterion, over: object):
    """Random linear systems and schedules, the covariances by Joseph's form."""
    random = np.random.default_rng(seed)
    system, psd, prior = _random_system(random, 3, 3), np.exp(random.normal(size=3)), od.Prior(np.zeros(3), std=(1.0, 2.0, 0.5))
    steered = od.ControlAffineSystem(
        system.model.x, system.model.state_names, drift=system.model.drift, known={"u": system.model.x * 0 + 1.0},
        outputs={f"y{s}": system.model.h[s] for s in range(3)},
    )  # fmt: skip
    chosen = random.random((4, 3)) < 0.5
    problem = od.DesignProblem(
        steered, np.zeros(3), 1.6, 0.1, od.PiecewiseConstant(2), {"u": (-1.0, 1.0)}, scale=(1.0, 3.0, 2.0), weights=chosen,
        criterion=od.Posterior(prior, tuple(psd.tolist()), (), inner, over),  # pyright: ignore[reportArgumentType]
    )  # fmt: skip
    P = _covariances(steered, prior, psd, 0.1, np.repeat(chosen, 4, axis=0)) / np.outer(problem.scale, problem.scale)
    expected = value_of_costs(problem, np.array([COST[type(inner)](matrix) for matrix in P]))
    assert problem.value(problem.path_of(np.array([0.5, -0.5]))) == pytest.approx(expected, rel=1e-9)


@EACH_OVER
@EACH_CRITERION
def test_a_sensor_that_is_never_on_is_not_there(inner: AbstractCriterion, over: object):
    problem = asked("noise", inner, over, weights=np.tile([0, 1], (2, 1)))
    without = replace(problem, system=od.System(SMALL.vehicle, SMALL_SENSORS[1:]), weights=None)
    path = problem.path_of(inputs(3))
    assert problem.value(path) == pytest.approx(without.value(path), rel=1e-12)
    assert problem.value(path) < asked("noise", inner, over).value(path)


def test_all_on_is_no_schedule():
    plain, weighed = (asked("noise", od.TraceInverse(), "mean", weights=weights) for weights in (None, np.ones((4, 2))))
    assert plain == weighed
    assert plain.value(plain.path_of(POINT)) == weighed.value(plain.path_of(POINT))


@EACH_SYSTEM
@EACH_OVER
@EACH_CRITERION
def test_the_program_has_the_value_of_the_scheduled_samples_and_its_slope(name: str, inner: AbstractCriterion, over: object):
    """Against central differences of the value that is recomputed with square roots, errors that last and unknown inputs among them."""
    problem = asked(name, inner, over, weights=schedule_of(JUDGED[name]))
    evaluated = evaluate_objective(matrix_objective_of(problem), Program(problem).evaluate(POINT).matrices)
    assert evaluated == pytest.approx(problem.value(problem.path_of(POINT)), rel=1e-8)
    expected = differences(lambda q: problem.value(problem.path_of(q)), POINT, 1e-4)
    np.testing.assert_allclose(gradient(problem, POINT), expected, rtol=1e-4, atol=1e-6 * max(1.0, abs(evaluated)))


@EACH_OVER
def test_a_design_for_a_schedule_is_better_for_it_than_paths_nearby_and_the_design_for_all(over: object):
    problem = asked("correlated noise", od.TraceInverse(), over, weights=schedule_of(JUDGED["noise"]))
    design, free = od.design_trajectory(problem, starts=2), od.design_trajectory(replace(problem, weights=None), starts=2)
    assert design.status is od.Status.LOCALLY_OPTIMAL
    assert design.value == problem.value(design.trajectory)
    assert (
        problem.value(free.trajectory) <= design.value * (1 - 1e-9) or over == "worst"
    )  # that of the first instant, which no path changes
    random = np.random.default_rng(0)
    for size in (1e-3, 0.05):
        for _ in range(10):
            near = np.clip(design.p + size * random.standard_normal(4), -0.5, 0.5)
            assert problem.value(problem.path_of(near)) <= design.value + 2e-6 * abs(design.value)


def test_a_posterior_has_a_sample_or_has_it_not():
    with pytest.raises(od.InputError, match=r"weights has the entry 0.5: a posterior criterion .* must be 0 or 1"):
        asked("noise", od.TraceInverse(), "mean", weights=[[1.0, 0.5]])
