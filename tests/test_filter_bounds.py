"""Every bound that a schedule for the filter rests on, against all schedules of small problems."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import eigh
from test_filter_schedules import random_instance

from obsdesign.selection.posterior.aggregation import Relaxation, refine, relaxation_of_ceilings, relaxation_of_windows
from obsdesign.selection.posterior.blocks import BlockLengths, blocks, bound_by_blocks
from obsdesign.selection.posterior.bounded_search import first_walk, prove_best
from obsdesign.selection.posterior.ceiling import meet, meet_of_groups
from obsdesign.selection.posterior.clusters import cluster
from obsdesign.selection.posterior.cost_slopes import cost_slopes
from obsdesign.selection.posterior.deepening import WorkLimits, build_chain, extend_windows, open_pairs, prices_tried, prune
from obsdesign.selection.posterior.formulation import problem_of
from obsdesign.selection.posterior.options import build_options
from obsdesign.selection.posterior.problem import PosteriorProblem, Walk
from obsdesign.selection.posterior.questions import FilterSettings, build_question
from obsdesign.selection.posterior.trellis import smallest_rest, start_of, successors
from obsdesign.selection.posterior.windows import single_layers

_ROUNDING = 1e-9  # of the cost: what the solver takes off its bounds


@dataclass(frozen=True)
class Enumerated:
    """A problem with the cost of its best schedule, and the covariances (n, n, B) of all schedules before each segment."""

    problem: PosteriorProblem
    walk: Walk
    best: float
    covariances: list[np.ndarray]

    def is_below(self, bound: float) -> bool:
        return bound <= self.best + _ROUNDING * max(1.0, abs(self.best))


def _problem(seed: int) -> PosteriorProblem:
    given = random_instance(seed)
    per_segment, rules = given.pop("per_segment"), given.pop("rules")
    parts = given.pop("system"), given.pop("path"), given.pop("prior")
    question = build_question(*parts, FilterSettings(unknown_inputs=(), floor=None, **given))
    return problem_of(question, build_options(rules, per_segment, question.segments, question.answers))


def _enumerate(seed: int) -> Enumerated | None:
    """Return a random problem with all its schedules; None where none keeps the rules."""
    problem = _problem(seed)
    rest, walks, before = smallest_rest(problem), start_of(problem, 1), []
    for k in range(problem.segments):
        before.append(walks.P)
        steps = successors(problem, walks, k, rest)
        cost, P = problem.maps.advance(k, problem.options.pattern_of_node[steps.node], walks.P[:, :, steps.parent])
        switching = problem.options.switching_costs[walks.node[steps.parent], steps.node]
        walks = walks.advance(steps, np.arange(len(cost)), cost, switching, P, problem.is_worst)
    walk = first_walk(problem)
    values = walks.value(problem.is_worst)
    return Enumerated(problem, walk, float(values.min()), before) if walk is not None and len(values) else None


def _covariances(random: np.random.Generator, n: int, count: int, spread: float) -> np.ndarray:
    roots = random.normal(size=(count, n, n)) * np.exp(spread * random.normal(size=(count, 1, n)))
    return roots @ roots.swapaxes(-1, -2)


def _smallest_eigenvalue(matrix: np.ndarray, of: np.ndarray) -> float:
    """Return the smallest eigenvalue of a matrix in units of the deviations of another."""
    deviation = np.sqrt(np.diag(of))
    return float(np.linalg.eigvalsh(matrix / deviation[:, None] / deviation)[0])


@given(st.integers(0, 10**6), st.integers(1, 8), st.sampled_from([0.1, 0.5, 1.0]))
@settings(max_examples=200, deadline=None)
def test_a_meet_is_below_both_and_touches_them(seed: int, n: int, spread: float) -> None:
    """A - C and B - C are positive semidefinite but for rounding of A + B, and singular together in n directions: nothing above C is."""
    random = np.random.default_rng(seed)
    A, B = _covariances(random, n, 2, spread)
    C = meet(A[None], B[None])[0]
    assert _smallest_eigenvalue(A - C, A + B) >= -1e-13
    assert _smallest_eigenvalue(B - C, A + B) >= -1e-13
    shares = [eigh(above - C, A + B, eigvals_only=True) for above in (A, B)]  # of A + B, whatever the units
    assert np.sum(np.array(shares) > 1e-8) <= n


@pytest.mark.parametrize("count", [1, 2, 3, 7, 20])
def test_meets_of_groups_are_below_their_members(count: int) -> None:
    """Whatever the numbers of members are; a group of one stays as it is."""
    random = np.random.default_rng(count)
    P, group = _covariances(random, 4, count, 1.0).transpose(1, 2, 0), random.integers(0, 3, count)
    group = np.unique(group, return_inverse=True)[1]
    meets = meet_of_groups(P, group, int(group.max()) + 1)
    for b, g in enumerate(group):
        assert _smallest_eigenvalue(P[:, :, b] - meets[:, :, g], P[:, :, b]) >= -1e-12
        if (group == g).sum() == 1:
            assert (meets[:, :, g] == P[:, :, b]).all()


def test_what_is_indefinite_meets_in_nothing() -> None:
    """Rounding can leave a covariance indefinite: 0 is then the only one that is surely below."""
    assert (meet(np.diag([1.0, -1.0])[None], np.diag([1.0, 0.5])[None]) == 0).all()


@given(st.integers(0, 10**6))
@settings(max_examples=50, deadline=None)
def test_cells_part_what_is_of_different_groups(seed: int) -> None:
    """Cells are numbered without gaps, never cross a group, and are no more than the width, or the groups."""
    random = np.random.default_rng(seed)
    n, B, width = int(random.integers(1, 5)), int(random.integers(1, 60)), int(random.integers(1, 30))
    P, slope = _covariances(random, n, B, 1.0).transpose(1, 2, 0), _covariances(random, n, 1, 0.3)[0]
    group = random.integers(0, 5, B)
    cell = cluster(group, random.normal(size=B), P, slope, width, 10.0)
    assert set(cell) == set(range(cell.max() + 1))
    assert all(len(set(group[cell == c])) == 1 for c in range(cell.max() + 1))
    assert cell.max() + 1 <= max(width, len(set(group)))


@pytest.mark.parametrize("seed", range(40))
def test_no_bound_is_above_the_best_of_all(seed: int) -> None:
    """Ceilings, windows, refined states and blocks, with little work and loose limits, so that nothing is exact by chance."""
    case = _enumerate(seed)
    if case is None or case.problem.segments == 1:
        return
    problem, walk, random = case.problem, case.walk, np.random.default_rng(seed)
    for ceiling, P in zip(problem.ceilings, case.covariances, strict=True):
        assert min(_smallest_eigenvalue(P[:, :, b] - ceiling, P[:, :, b]) for b in range(P.shape[2])) >= -1e-10
    for margin in (1e-6, 0.3 * abs(walk.value) + 0.1):
        _check_states(case, walk.value + margin)
    alone = prove_best(problem, walk, lambda _: 0.0, WorkLimits(0, 0))
    assert case.is_below(alone.bound) and alone.bound_by == "windows of 1 segment"
    for length, before, ramp in ((1, 0, 0), (2, 1, 1), (3, 4, 1), (4, 1, 2)):
        effort = WorkLimits(int(random.integers(50)), int(random.integers(20_000)))
        lengths = BlockLengths(length, before, ramp)
        better, bound = bound_by_blocks(problem, walk, lengths, lambda part, _, own, e=effort: _answer(part, own, e))
        assert case.is_below(bound)
        assert case.best * (1 - np.sign(case.best) * _ROUNDING) - 1e-12 <= better.value <= walk.value


@given(st.integers(1, 60), st.integers(1, 20), st.integers(0, 5), st.integers(0, 6))
@settings(max_examples=100, deadline=None)
def test_shares_of_blocks_add_up_to_one(segments: int, length: int, before: int, ramp: int) -> None:
    """Each segment of the run counts once in all, however long blocks are and however far they go over into each other."""
    total = np.zeros(segments)
    for first, weights in blocks(segments, BlockLengths(length, before, ramp)):
        assert (weights >= 0).all()
        total[first : first + len(weights)] += weights
    assert total == pytest.approx(np.ones(segments), abs=1e-12)


def _answer(part: PosteriorProblem, own: Walk, effort: WorkLimits) -> tuple[Walk, float]:
    answer = prove_best(part, own, lambda _: 0.0, effort)
    assert answer.walk is not None
    return answer.walk, answer.bound


def _check_states(case: Enumerated, limit: float) -> None:
    """Windows of one choice, of two and of three, then passes with 1, 3, 10 and 30 states after each segment."""
    problem = case.problem
    layers = single_layers(problem)
    for _ in range(3):
        chain = build_chain(problem, layers, prices_tried(problem, layers))
        assert case.is_below(min(chain.bound, limit))
        chain = prune(chain, limit)
        layers = extend_windows(chain, [open_pairs(chain, k, limit) for k in range(1, problem.segments)])
    chain = prune(build_chain(problem, layers, prices_tried(problem, layers)), limit)
    slopes = cost_slopes(problem, case.walk)
    if not problem.options.is_linked and not len(problem.limits):
        singles = single_layers(problem)
        _check_passes(case, relaxation_of_ceilings(build_chain(problem, singles, prices_tried(problem, singles))), slopes, limit)
    _check_passes(case, relaxation_of_windows(chain, limit), slopes, limit)


def _check_passes(case: Enumerated, relaxation: Relaxation, slopes: np.ndarray, limit: float) -> None:
    problem, bound = case.problem, -np.inf
    for width in (1, 3, 10, 30):
        result = refine(problem, relaxation, slopes, limit, width, 0.1 * abs(case.best))
        if result.relaxation is None:
            assert case.is_below(limit)
            return
        relaxation = result.relaxation
        assert case.is_below(relaxation.bound)
        assert relaxation.bound >= bound - _ROUNDING * max(1.0, abs(bound))  # finer states never bound lower
        bound = relaxation.bound


@pytest.mark.parametrize("seed", range(10))
def test_slopes_are_those_of_the_cost(seed: int) -> None:
    """<L_k, D> is the change of the cost of the rest with P_k, by differences along whole schedules, where the cost is their sum."""
    problem = _problem(seed)
    walk = first_walk(problem)
    if walk is None or problem.is_worst:
        return
    slopes, random = cost_slopes(problem, walk), np.random.default_rng(seed)
    for k in range(problem.segments):
        P = walk.covariances[k]
        root = np.linalg.cholesky(P) @ random.normal(size=P.shape)
        D = 1e-4 * root @ root.T
        change = (_rest(problem, walk, k, P + D) - _rest(problem, walk, k, P - D)) / 2
        assert np.sum(slopes[k] * D) == pytest.approx(change, rel=1e-3, abs=1e-9 * abs(walk.value))


def _rest(problem: PosteriorProblem, walk: Walk, first: int, P: np.ndarray) -> float:
    total, P = 0.0, P[:, :, None]
    for k in range(first, problem.segments):
        cost, P = problem.maps.advance(k, problem.options.pattern_of_node[walk.nodes[[k]]], P)
        total += float(cost[0])
    return total
