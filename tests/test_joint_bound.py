"""No path with any schedule is above the bound of both, all schedules are in its cases, and wrong certificates are refused."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from itertools import product

import numpy as np
import pytest
from test_path_bound import parameters, short_mission

import obsdesign as od
from obsdesign.design.path_bound.proof import path_bound_of
from obsdesign.design.record import gap_between
from obsdesign.information.accumulation import segment_information
from obsdesign.joint.joint_proof import joint_bound_of
from obsdesign.joint.schedule_relaxation import matrix_above, matrix_root

SENSORS = (od.GPS(1.5), od.GPS(1.0, rate=1.0, name="fine"), od.Magnetometer(0.15))
GOAL = od.Goal((30.0, 5.0), tolerance=2.0)


def asked(sensors=SENSORS, **changes) -> od.DesignProblem:
    """The short mission of the bounds on paths, with two GPS and a compass."""
    return short_mission(system=od.System(od.Dubins(2.0, wind="constant"), sensors), **changes)


def best_of_all(problem: od.DesignProblem, segments: int, per_segment: int, paths: int, seed: int) -> float:
    """The best value of random, bang-bang and wavy paths with every schedule there is."""
    random, S = np.random.default_rng(seed), len(problem.system.model.channels)
    rows = [row for row in product((0.0, 1.0), repeat=S) if sum(row) <= per_segment]
    schedules = np.array(list(product(rows, repeat=segments)))
    best = -np.inf
    for _ in range(paths):
        path = problem.path_of(parameters(problem, random))
        W = np.einsum("cks,ksij->cij", schedules, segment_information(problem.system, path, segments))
        scaled = W * np.outer(problem.units, problem.units)
        judged = scaled[[np.argmax(np.linalg.eigvalsh(scaled)[:, 0]), np.argmax(np.linalg.slogdet(scaled)[1])]]
        best = max(best, *(problem.criterion_value(each / np.outer(problem.units, problem.units)) for each in judged))
    return best


# ---------------------------------------------------------------- nothing is above it


@pytest.mark.parametrize(
    ("problem", "segments", "per_segment"),
    [
        (asked(), 4, 1),
        (asked(), 3, 2),
        (asked(constraints=(GOAL,)), 4, 1),
        (asked((od.GPS(1.5), od.Magnetometer(0.1)), about=("heading", "wind_x", "wind_y")), 6, 1),
        (asked((od.GPS(1.5), od.GPS(1.2, name="other"), od.Range((60.0, 20.0), 1.0))), 3, 1),
        (asked(criterion=od.LogDet()), 3, 1),
        (asked(criterion=od.TraceInverse()), 3, 1),
    ],
)
def test_no_path_with_any_schedule_is_above_the_bound(problem, segments, per_segment):
    loose = replace(problem, constraints=())  # of paths that miss the goal the bound without it is asked
    best = best_of_all(loose, segments, per_segment, 25, 1)
    bound = joint_bound_of(loose, segments, per_segment, best, gap=0.0, nodes=5)
    assert best <= bound.bound < np.inf
    assert od.check_joint_bound(loose, segments, per_segment, bound.certificate) == bound.bound
    root = joint_bound_of(loose, segments, per_segment).bound
    assert joint_bound_of(problem, segments, per_segment).bound <= root + 1e-3 * abs(root)


@pytest.mark.slow
def test_codesigns_come_near_the_bound_and_branching_brings_it_nearer():
    problem = asked(constraints=(GOAL,))
    joint = od.codesign(problem, 6, 1, starts=1)
    assert joint.value <= joint.bound < path_bound_of(problem).bound  # which counts all sensors
    branching = joint_bound_of(problem, 6, 1, joint.value, gap=0.03)
    assert joint.value <= branching.bound < joint.bound
    assert gap_between(joint.value, branching.bound) <= 0.03
    assert len(branching.certificate.ends) > 1
    written = json.loads(json.dumps(asdict(branching.certificate)))
    certificate = od.JointCertificate(written["branches"], tuple(od.PathCertificate(**end) for end in written["ends"]))
    assert od.check_joint_bound(problem, 6, 1, certificate) == branching.bound


def test_with_all_sensors_on_it_is_the_bound_on_paths():
    problem = asked(constraints=(GOAL,))
    assert joint_bound_of(problem, 6, 3).bound == pytest.approx(path_bound_of(problem).bound, rel=1e-3)


def test_of_two_sensors_of_which_one_is_better_everywhere_that_one_counts():
    # O = diag of the larger weights is above both: nothing is lost
    better, choice = asked((od.GPS(1.5),)), asked((od.GPS(4.0, name="worse"), od.GPS(1.5)))
    assert joint_bound_of(choice, 6, 1).bound == pytest.approx(path_bound_of(better).bound, rel=1e-3)


@pytest.mark.parametrize("n", [1, 2, 7, 30])
def test_a_matrix_above_all_options_is_above_them_and_near_for_what_is_smooth(n):
    random = np.random.default_rng(n)
    weights = random.uniform(0, 4, (4, n)) * (random.uniform(size=(4, n)) < 0.5)
    O = matrix_above(weights)  # noqa: E741
    for row in weights:
        assert np.linalg.eigvalsh(O - np.diag(row))[0] > 0
    B = matrix_root(O)
    assert pytest.approx(O, abs=1e-12 * np.abs(O).max()) == B.T @ B
    # a constant r sees sum of weights, which no option has more of than the largest: one above that by little
    assert weights.sum(axis=1).max() <= O.sum() <= 1.25 * weights.sum(axis=1).max() + 1e-6


def test_two_sensors_that_take_turns_are_not_counted_twice():
    # the same variance at even and at odd times: one at a time has half the samples of both
    turns = matrix_above(np.array([[1.0, 0.0] * 5, [0.0, 1.0] * 5]))
    assert turns.sum() == pytest.approx(5.0, rel=0.02)


# ---------------------------------------------------------------- what is refused

PROBLEM = asked(constraints=(GOAL,))
PROOF = joint_bound_of(PROBLEM, 4, 1, 40.0, gap=0.0, nodes=5).certificate
LAST = PROOF.ends[-1]
WRONG = {
    "a case left out": replace(PROOF, branches=PROOF.branches[:-1], ends=PROOF.ends[:-1]),
    "a case too many": replace(PROOF, branches=(*PROOF.branches, (-1, -1)), ends=(*PROOF.ends, LAST)),
    "an end without proof": replace(PROOF, ends=PROOF.ends[:-1]),
    "only one case": replace(PROOF, branches=((-1, -1),), ends=(LAST,)),
    "a lower level": replace(PROOF, ends=(*PROOF.ends[:-1], replace(LAST, level=LAST.level * 0.99))),
    "proofs in another order": replace(PROOF, ends=tuple(reversed(PROOF.ends))),
    "a segment that is not there": replace(PROOF, branches=((9, 0), *PROOF.branches[1:])),
    "an option that is not there": replace(PROOF, branches=((0, 7), *PROOF.branches[1:])),
    "no ends": replace(PROOF, branches=(), ends=()),
    "other pieces": replace(PROOF, ends=(*PROOF.ends[:-1], replace(LAST, lengths=(1,) * 36))),
}


def test_the_certificate_that_is_changed_below_is_right():
    assert len(PROOF.ends) == 3
    assert LAST.multipliers
    assert np.isfinite(od.check_joint_bound(PROBLEM, 4, 1, PROOF))


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_certificate_is_refused(name):
    with pytest.raises(od.InputError):
        od.check_joint_bound(PROBLEM, 4, 1, WRONG[name])


@pytest.mark.parametrize(("segments", "per_segment"), [(6, 1), (4, 2)])
def test_the_certificate_of_another_question_is_refused_or_proves_what_it_says(segments, per_segment):
    with pytest.raises(od.InputError):
        od.check_joint_bound(replace(PROBLEM, scale=(5.0, 5.0, 0.4, 1.0, 1.0)), segments, per_segment, PROOF)


def test_without_a_bound_there_is_a_reason():
    proof = joint_bound_of(replace(PROBLEM, prices=(od.Price(od.PathLength(), 0.1),)), 4, 1)
    assert proof.bound == np.inf
    assert "more than the information" in proof.reason
    with pytest.raises(od.InputError, match="kinds of pieces"):
        od.check_joint_bound(PROBLEM, 4, 1, od.JointCertificate())


@pytest.mark.slow
def test_rules_are_named_among_what_the_bound_leaves_out():
    problem, rules = asked(duration=6.0, path=od.PiecewiseConstant(3)), (od.MinimumDwell(2), od.SwitchingCost(0.01))
    joint = od.codesign(problem, 3, 1, rules, starts=1, rounds=1)
    free = joint_bound_of(problem, 3, 1, joint.value)
    assert joint.bound == free.bound >= joint.value  # rules only take schedules and value away
    assert joint.proof.left_out == (*free.left_out, "MinimumDwell", "SwitchingCost")


@pytest.mark.slow
def test_a_schedule_keeps_its_segments_where_a_longer_duration_is_looked_for():
    # a goal behind the start, as far as there is time for: 36 steps in 12 segments, so that durations come in steps of 6 s
    goal = np.array([3.0, -2.0]) + 18 * np.array([0.5, -0.3]) - 33 * np.array([np.cos(0.4), np.sin(0.4)])
    problem = short_mission(weights=np.tile([1.0, 0.0], (12, 1)), constraints=(od.Goal(tuple(goal), tolerance=0.5),))
    design = od.design_trajectory(problem, starts=1, throw=False)
    assert "feasible from 30 s" in design.reason  # 26 s without a schedule
