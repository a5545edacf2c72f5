"""Starts until a gap is closed: where they begin, when they are abandoned, how the search ends."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from itertools import islice

import numpy as np
import pytest
from gram_vectors import gram_vectors
from test_path_bound import short_mission

import obsdesign as od
from benchmarks.missions import mission
from obsdesign.design.local_solve import LocalSolve, solve_locally
from obsdesign.design.path_bound.motion import motion_of
from obsdesign.design.path_bound.proof import path_bound_of
from obsdesign.design.path_bound.relaxation import relaxation_of
from obsdesign.design.path_bound.rounding import chord_distribution, follow_chords, rounded_inputs
from obsdesign.design.record import gap_between

NEAR = short_mission(constraints=(od.Goal((30.0, 5.0), tolerance=2.0),))

# ---------------------------------------------------------------- where starts begin


def test_chords_of_a_circle_lead_back_to_its_turn_rate():
    # where a chord meets the next of a circle, the heading is in the middle of theirs
    problem = short_mission(start=(0.0, 0.0, 0.2, 0.0, 0.0))
    motion = motion_of(problem)
    heading = 0.2 + 0.3 * 0.5 * np.arange(36)
    places = np.vstack([[0.0, 0.0], np.cumsum(np.stack([np.cos(heading + 0.075), np.sin(heading + 0.075)], axis=1), axis=0)])
    marks = np.concatenate([[0], np.cumsum(motion.lengths)])
    u = follow_chords(problem, motion, np.diff(places[marks], axis=0))
    assert u[: marks[-2], 0] == pytest.approx(0.3, rel=1e-9)


def test_a_vehicle_that_goes_where_it_likes_goes_along_the_chords():
    drifter = od.System(od.Omnidirectional(), (od.GPS(1.5),))
    speeds = {"turn_rate": (-0.3, 0.3), "forward": (-1.0, 1.0), "sideways": (-1.0, 1.0)}
    problem = short_mission(system=drifter, start=(3.0, -2.0, 0.4), scale=(5.0, 5.0, 0.2), bounds=speeds)
    motion = motion_of(problem)
    names, asked = problem.system.model.input_names, np.zeros((len(motion.lengths), 3))
    moving = [names.index("forward"), names.index("sideways")]
    asked[:, moving] = np.random.default_rng(2).uniform(-1, 1, (len(motion.lengths), 2))
    path = problem.path_along(np.repeat(asked, motion.lengths, axis=0))
    marks = np.concatenate([[0], np.cumsum(motion.lengths)])
    chords = np.diff(path.x[marks, :2], axis=0) / (motion.speed * problem.step * np.array(motion.lengths)[:, None])
    assert follow_chords(problem, motion, chords) == pytest.approx(path.u, abs=1e-9)


def test_the_matrix_of_a_path_is_rounded_to_its_own_chords():
    relaxation = relaxation_of(NEAR)
    vectors = gram_vectors(NEAR, relaxation, NEAR.path_of(np.linspace(-0.4, 0.3, 12)))
    mean, root = chord_distribution(vectors @ vectors.T, 12)
    assert mean == pytest.approx(vectors[2:14], abs=1e-12)
    assert np.abs(root).max() <= 1e-7  # nothing is left to draw, to the root of rounding


def test_rounded_inputs_keep_the_box_and_the_first_leads_to_the_best_path():
    rounded = list(islice(rounded_inputs(NEAR, path_bound_of(NEAR).certificate, 0), 3))
    assert all((u >= NEAR.lower).all() and (u <= NEAR.upper).all() for _, u in rounded)
    assert any(not np.array_equal(u, rounded[0][1]) for _, u in rounded[1:])
    first = solve_locally(LocalSolve(NEAR, *rounded[0], (NEAR.path,), True))
    assert gap_between(NEAR.value(first.path), path_bound_of(NEAR).bound) <= 0.01


# ---------------------------------------------------------------- when they are abandoned


def test_a_climb_that_cannot_come_to_what_is_asked_is_abandoned_and_no_other_is():
    u = np.full((NEAR.steps, 1), 0.1)
    best = solve_locally(LocalSolve(NEAR, "", u, (NEAR.path,), True))
    hopeless = solve_locally(LocalSolve(NEAR, "", u, (NEAR.path,), True, target=path_bound_of(NEAR).bound * 1.5))
    assert best.status is od.Status.LOCALLY_OPTIMAL
    assert hopeless.status is od.Status.ABANDONED
    assert hopeless.iterations < best.iterations
    assert solve_locally(LocalSolve(NEAR, "", u, (NEAR.path,), True, target=best.objective * 0.99)).objective == best.objective


# ---------------------------------------------------------------- how it ends


def test_a_gap_that_can_be_closed_is_closed_whoever_climbs():
    design = od.design_trajectory(NEAR, gap=0.01)
    assert 0 <= design.gap <= 0.01
    assert len(design.starts) <= 8
    assert f"reached after {len(design.starts)} starts" in design.search.in_words(design)
    assert design.bound == od.check_path_bound(NEAR, design.proof.certificate)
    with ThreadPoolExecutor(2) as executor:
        again = od.design_trajectory(NEAR, gap=0.01, executor=executor)
    assert np.array_equal(design.trajectory.u, again.trajectory.u)
    assert design.starts == again.starts


def test_a_gap_that_stays_open_ends_at_the_limit_of_work_with_the_best_of_its_starts():
    design = od.design_trajectory(NEAR, starts=1, gap=0.0)
    assert design.search.limit == len(design.starts) == 8
    assert "limit of work" in design.search.in_words(design)
    assert design.status is od.Status.GAP_OPEN
    values = [start.value for start in design.starts if start.status.has_answer]
    # of paths within 1e-6 of the best the one is taken whose determinant is largest
    assert design.value in values
    assert design.value >= max(values) * (1 - 1e-6)
    assert max(values) <= design.bound


def test_without_a_bound_it_is_the_usual_design_and_says_so():
    sighted = od.System(od.Dubins(2.0), (od.Bearing((30.0, 20.0), 0.1), od.GPS(3.0)))
    problem = short_mission(system=sighted, start=(3.0, -2.0, 0.4), scale=(5.0, 5.0, 0.2), path=od.PiecewiseConstant(3))
    design = od.design_trajectory(problem, starts=1, gap=0.01)
    assert np.array_equal(design.trajectory.u, od.design_trajectory(problem, starts=1).trajectory.u)
    assert "without a bound" in design.search.in_words(design)


@pytest.mark.slow
def test_of_a_free_duration_the_best_one_is_searched():
    free = short_mission(duration=(17.5, 18.0))
    design = od.design_trajectory(free, starts=1, gap=0.0)
    assert 17.5 <= design.problem.longest == design.problem.shortest <= 18.0
    assert len(design.starts) == 8
    assert design.value >= od.design_trajectory(free, starts=1).value


def test_a_gap_of_rounding_is_none():
    assert gap_between(25.0 * (1 + 1e-12), 25.0) == gap_between(-25.0 * (1 - 1e-12), -25.0) == 0.0
    assert gap_between(24.0, 25.0) == pytest.approx(0.04)
    assert gap_between(26.0, 25.0) < 0  # a bound that is broken is no rounding
    assert np.isnan(gap_between(1.0, np.inf))


def test_a_gap_that_means_nothing_is_refused():
    with pytest.raises(od.InputError, match=r"gap: is 1"):
        od.design_trajectory(NEAR, gap=1.0)


def test_limits_that_no_path_keeps_are_told_of_the_relaxation():
    # 36 m of way in still air, a goal at 50 m: no Gram matrix is left
    problem = short_mission(start=(0.0, 0.0, 0.0, 0.0, 0.0), constraints=(od.Goal((50.0, 0.0), tolerance=1.0),))
    assert "no path keeps the limits" in path_bound_of(problem).reason


@pytest.mark.slow
def test_the_mission_is_brought_to_the_best_of_200_starts():
    assert od.design_trajectory(mission(), gap=0.0172).value >= 149.815
