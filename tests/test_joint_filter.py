"""Path and schedule for what a filter knows: never below a one-sided answer, recomputed from covariances, and what is refused."""

from __future__ import annotations

import itertools
import multiprocessing
import re
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import casadi as ca
import numpy as np
import pytest
from conftest import seeds
from test_joint import tiny

import obsdesign as od
from obsdesign.criteria.abstract import AbstractCriterion
from obsdesign.design.feasibility import is_feasible
from obsdesign.joint.filter_problem import FilterJointProblem
from obsdesign.selection.posterior.options import Options, build_options

TINY_PRIOR = od.Prior((0.0, 0.0, 0.4), std=(10.0, 10.0, 0.3))
TINY_PSD = (0.2, 0.2, 1e-3)
COSTS = {
    od.TraceInverse: lambda P: float(np.trace(P)),
    od.MinEigenvalue: lambda P: float(np.linalg.eigvalsh(P)[-1]),
    od.LogDet: lambda P: float(np.linalg.slogdet(P)[1]),
}
OVERS = ("end", "mean", "worst", tuple(float(k % 3) for k in range(30)))


def judged(inner: AbstractCriterion | None = None, over: Any = "mean", **other: Any) -> od.DesignProblem:
    return tiny(criterion=od.Posterior(TINY_PRIOR, TINY_PSD, (), inner or od.TraceInverse(), over), **other)


def random_problem(seed: int) -> od.DesignProblem:
    """A random system with winds that are none or constant, errors that are independent or last, and a random question."""
    random = np.random.default_rng(seed)
    blown, lasting = seed % 3 == 1, seed % 3 == 2
    east, west = random.uniform(20, 60, 2), random.uniform(-60, -20, 2)
    sensors = (
        od.GPS(float(random.uniform(1, 5)), correlation=0.8 if lasting else 0.0),
        od.Range(tuple(east), 1.0, bias_floor=1.0 if lasting else 0.0),
        od.Bearing(tuple(west), 0.05),
        od.Magnetometer(0.1),
    )
    start, std = [0.0, 0.0, 0.4, 0.1, -0.1][: 5 if blown else 3], np.array([10.0, 10.0, 0.3, 0.3, 0.3])[: 5 if blown else 3]
    psd = random.uniform(0, 0.1, len(std)) * np.array([1, 1, 0.01, 0.01, 0.01])[: len(std)]
    inner, over = list(COSTS)[random.integers(3)](), OVERS[random.integers(4)]
    return tiny(
        system=od.System(od.Dubins(1.0, wind="constant" if blown else None), sensors),
        start=start,
        scale=std,
        about=("x", "y") if random.random() < 0.5 else (),
        criterion=od.Posterior(od.Prior(start, std=std), tuple(psd.tolist()), (), inner, over),
    )


def value_from_scratch(problem: od.DesignProblem, path: od.Trajectory, chosen: np.ndarray, switching: float = 0.0) -> float:
    """-C, or 1 / C of a smallest eigenvalue, of the inverses of `posterior_information` of the samples that a schedule has."""
    known = problem.criterion
    assert isinstance(known, od.Posterior)
    active = np.repeat(chosen, path.steps // len(chosen), axis=0)
    J = od.posterior_information(problem.system, path, known.prior, known.disturbance_psd, known.unknown_inputs, active)[:-1]
    index, S = np.ix_(problem.about_indices, problem.about_indices), np.diag(problem.units)
    c = np.array([COSTS[type(known.criterion)](np.linalg.inv(S @ matrix @ S)[index]) for matrix in J])
    total = {"end": c[-1], "mean": c.mean(), "worst": c.max()}[known.over] if isinstance(known.over, str) else float(known.over @ c)
    return 1 / (total + switching) if isinstance(known.criterion, od.MinEigenvalue) else -(total + switching)


# ---------------------------------------------------------------- the answer


@pytest.mark.parametrize("seed", seeds(6, 3))
def test_never_below_a_one_sided_answer_and_recomputed(seed: int):
    """Whatever is asked, and whatever rules are kept: of path and schedule, values from scratch, and a bound on the schedule's side."""
    problem, random = random_problem(seed), np.random.default_rng(100 + seed)
    rules = ((), (od.MinimumDwell(2),), (od.SwitchingCost(0.01), od.UnavailableOutside("bearing", (0.0, 0.0), 40.0)))[seed % 3]
    joint = od.codesign(problem, 6, int(random.integers(1, 3)), rules, question="filter", starts=1, seed=seed)
    assert joint.objective >= joint.alternated >= max(joint.path_first.objective, joint.sensors_first.objective)
    assert all(after >= before for before, after in itertools.pairwise(joint.alternation))
    assert joint.alternation[-1] == joint.objective == joint.value
    for answer in (joint, joint.path_first, joint.sensors_first):
        path, chosen = answer.design.trajectory, answer.schedule.chosen
        assert path is not None
        assert is_feasible(problem, path)
        switch_ons = int((chosen & ~np.vstack([np.zeros_like(chosen[:1]), chosen[:-1]])).sum())
        penalty = 0.01 * switch_ons if len(rules) == 2 else 0.0
        assert answer.value == pytest.approx(value_from_scratch(problem, path, chosen, penalty), rel=1e-9)
    assert isinstance(joint.schedule, od.FilterSchedule)
    cost = 1 / joint.value if isinstance(problem.criterion.criterion, od.MinEigenvalue) else -joint.value  # pyright: ignore
    assert joint.schedule.value == pytest.approx(cost, rel=1e-8)
    assert joint.schedule.bound <= joint.schedule.value
    assert np.array_equal(joint.schedule.chosen, joint.design.problem.weights if joint.design.problem.weights is not None else 1)


@pytest.mark.parametrize("over", OVERS, ids=("end", "mean", "worst", "weights"))
@pytest.mark.parametrize("inner", [criterion() for criterion in COSTS], ids=("trace", "lambda", "log det"))
def test_neither_half_alone_is_better(inner: AbstractCriterion, over: Any):
    """No schedule of all is better for the path by more than what the certificate leaves open; no path nearby for the schedule."""
    problem = judged(inner, over)
    joint = od.codesign(problem, 3, question="filter", starts=1)
    path = joint.design.trajectory
    assert path is not None
    values = [
        value_from_scratch(problem, path, np.array(rows, dtype=bool)) for rows in itertools.product(((1, 0), (0, 1), (0, 0)), repeat=3)
    ]
    own = value_from_scratch(problem, path, joint.schedule.chosen)
    assert own >= max(values) - 1.1e-3 * max(1.0, abs(own))
    cost = 1 / max(values) if isinstance(inner, od.MinEigenvalue) else -max(values)
    assert joint.schedule.bound <= cost + 1e-12 * abs(cost)
    random, p = np.random.default_rng(0), joint.design.p
    assert p is not None
    for size in (1e-4, 3e-3):
        for _ in range(10):
            near = problem.path_of(np.clip(p + size * random.standard_normal(p.shape), -0.08, 0.08))
            if is_feasible(problem, near):
                assert value_from_scratch(problem, near, joint.schedule.chosen) <= own + 2e-6 * abs(own)


def test_no_point_of_a_grid_is_better():
    problem = judged(od.TraceInverse(), "end")
    joint = od.codesign(problem, 3, question="filter", starts=4)
    best = -np.inf
    schedules = [np.eye(2, dtype=bool)[list(which)] for which in itertools.product((0, 1), repeat=3)]
    for rates in itertools.product(np.linspace(-0.08, 0.08, 4), repeat=3):
        path = od.simulate(problem.system, problem.x0, np.repeat(rates, 10)[:, None], problem.step)
        if is_feasible(problem, path):
            best = max(best, *(value_from_scratch(problem, path, chosen) for chosen in schedules))
    assert joint.value >= best


def test_of_a_linear_system_every_path_has_the_same_best_schedule():
    """Its covariances do not depend on the path: all answers are worth what the best schedule of any path is."""
    x = ca.SX.sym("x", 2)
    system = od.ControlAffineSystem(
        x, ("a", "b"), drift=ca.vertcat(x[1], -0.2 * x[0]), known={"u": ca.vertcat(0, 1)}, outputs={"first": x[0], "second": x[1]}
    )
    criterion = od.Posterior(od.Prior((0.0, 0.0), std=(2.0, 1.0)), (0.1, 0.3), (), od.TraceInverse(), "mean")
    problem = od.DesignProblem(
        system, (0.0, 0.0), 6.0, 0.5, od.PiecewiseConstant(2), {"u": (-1.0, 1.0)}, criterion=criterion
    )  # fmt: skip
    joint = od.codesign(problem, 6, question="filter", starts=1)
    best = max(
        value_from_scratch(problem, problem.path_of(np.array([0.7, -0.3])), np.eye(2, dtype=bool)[list(which)])
        for which in itertools.product((0, 1), repeat=6)
    )
    assert (joint.value, joint.path_first.value, joint.sensors_first.value) == pytest.approx((best,) * 3, rel=1.1e-3)
    assert joint.value <= best + 1e-9


def test_all_sensors_on_is_the_design_for_all():
    joint = od.codesign(judged(), 3, per_segment=2, question="filter", starts=2)
    assert joint.schedule.chosen.all()
    assert joint.value == joint.path_first.design.value


def test_workers_find_the_same():
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as executor:
        there = od.codesign(judged(), 3, question="filter", starts=1, executor=executor)
    here = od.codesign(judged(), 3, question="filter", starts=1)
    assert there.value == here.value
    assert np.array_equal(there.schedule.chosen, here.schedule.chosen)


# ---------------------------------------------------------------- the record of a schedule that was not searched for


@pytest.mark.parametrize("rules", [(), (od.MinimumDwell(2),), (od.SwitchingCost(0.02),)], ids=("free", "dwell", "switching"))
def test_the_record_of_another_schedule_is_that_of_the_search(rules: tuple[Any, ...]):
    """Certified anew, the chosen one has the same record; another has its own cost under the same bound."""
    problem = judged()
    asked = FilterJointProblem(problem, 6, 1, rules, 0, 20)
    path = problem.path_of(np.array([0.05, -0.02, 0.0]))
    best = asked.select_schedule(path, proven=True)
    other = np.tile([True, False], (6, 1))
    record = asked.certify_chosen(path, other, np.nan, best)
    assert np.array_equal(record.chosen, other)
    penalty = 0.02 if any(isinstance(rule, od.SwitchingCost) for rule in rules) else 0.0
    assert record.value == pytest.approx(-value_from_scratch(problem, path, other, penalty), rel=1e-9)
    assert best.bound * (1 - 1e-8) <= record.bound <= best.bound <= record.value
    again = asked.certify_chosen(path, best.chosen.copy(), best.value, record)
    assert again.value == pytest.approx(best.value, rel=1e-12)
    np.testing.assert_allclose(again.prices, best.prices, rtol=1e-9)
    np.testing.assert_array_equal(again.predicted, best.predicted)


@pytest.mark.parametrize("seed", range(10))
def test_a_schedule_is_a_walk_where_it_keeps_the_rules(seed: int):
    """Random walks come back as walks of the same schedule that follow the chain; a dwell that is broken has none."""
    random = np.random.default_rng(seed)
    segments = od.Segments(("a", "b", "c"), 7)
    options = build_options((od.MinimumDwell(int(random.integers(1, 4))),), 2, segments, None)
    chosen = options.chosen(_walk(options, random))
    nodes = options.nodes_of(chosen)
    assert nodes is not None
    assert np.array_equal(options.chosen(nodes), chosen)
    assert options.may_start[nodes[0]]
    assert options.follows[nodes[:-1], nodes[1:]].all()
    blinking = np.zeros((7, 3), dtype=bool)
    blinking[::2, 0] = True
    assert build_options((od.MinimumDwell(2),), 2, segments, None).nodes_of(blinking) is None


def _walk(options: Options, random: np.random.Generator) -> np.ndarray:
    nodes = [random.choice(np.flatnonzero(options.may_start))]
    while len(nodes) < options.segments:
        nodes.append(random.choice(np.flatnonzero(options.follows[nodes[-1]])))
    return np.array(nodes)


# ---------------------------------------------------------------- refusals


@pytest.mark.parametrize(
    ("problem", "question", "message"),
    [
        (
            tiny(),
            "filter",
            "codesign: the question is 'filter' and the criterion MinEigenvalue: must be Posterior, or the question 'start'",
        ),
        (judged(), "start", "codesign: Posterior is not additive over sensors: must be a criterion of the samples' information alone,"),
        (judged(), "end", "question is 'end': must be one of 'start', 'filter'"),
        (judged(over="end", duration=(40.0, 60.0)), "filter", "codesign: the duration is (40, 60): must be one number of seconds"),
        (judged(weights=[[1.0, 0.0]]), "filter", "codesign: the problem has weights"),
    ],
)
def test_what_does_not_go_with_the_question_is_refused(problem: od.DesignProblem, question: Any, message: str):
    with pytest.raises(od.InputError, match=re.escape(message)):
        od.codesign(problem, 3, question=question)


def test_no_path_no_answer():
    far = judged(constraints=(od.Goal((500.0, 0.0), 1.0),))
    with pytest.raises(od.SolveError, match="codesign"):
        od.codesign(far, 3, question="filter", starts=1)
    joint = od.codesign(far, 3, question="filter", starts=1, throw=False)
    assert np.isnan(joint.value)
    assert joint.status.is_infeasible
