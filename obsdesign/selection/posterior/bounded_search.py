"""A schedule and its bound: trellis, deepening, and blocks for long runs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from obsdesign.selection.posterior.aggregation import Relaxation, refine, relaxation_of_ceilings, relaxation_of_windows
from obsdesign.selection.posterior.blocks import BlockLengths, bound_by_blocks
from obsdesign.selection.posterior.cost_slopes import cost_slopes
from obsdesign.selection.posterior.deepening import MAX_ENTRIES, Proof, WorkLimits, better_walk, build_chain, prove, windows_of
from obsdesign.selection.posterior.exchanges import exchange
from obsdesign.selection.posterior.problem import PosteriorProblem, Walk
from obsdesign.selection.posterior.resource_prices import best_prices
from obsdesign.selection.posterior.trellis import follow_trellis, trellis_width
from obsdesign.selection.posterior.windows import single_layers

_MAX_TRELLIS = 4096  # partial schedules of a trellis
_QUICK = 4000  # times that a sample is taken in a segment by a trellis: those of more partial schedules are left to what follows
_PRICE_FACTORS = (0.0, 0.5, 1.0, 1.5)  # times the best prices of limits: with which partial schedules are compared
_EFFORT = WorkLimits(max_windows=60_000, max_simulated=1_500_000)
_EFFORT_OF_BLOCK = WorkLimits(max_windows=20_000, max_simulated=600_000)
_LONG = 300  # segments: longer runs go by blocks
_BLOCKS = BlockLengths(length=70, before=4, ramp=3)
_ROUNDING = 8 * float(np.finfo(float).eps)
_OF_BLOCKS = 0.55  # share of the gap that blocks may leave open
_WIDTHS = (300, 1000, 3000, 10_000, 30_000, 100_000)  # states after each segment, pass by pass
_SCHEDULES = 100  # states where only a schedule is looked for
_FAR = 0.02  # of the cost: a gap that is left open, from which on states that cut across windows are tried
_MAX_JOINED = 2000  # such states after each segment
_GROWTH = 2  # times the work of a pass that the next one takes, about
_OF_TRELLISES = 0.3  # of the time left: what they may take
_ALL_ON = "all sensors that may be on, on all the time"
_TOLERANCE = 0.1  # of what the ceiling is worth: states are split that are so near to the best


@dataclass(frozen=True, eq=False)
class Answer:
    """The best schedule known and a bound that no schedule is below, and what proved it; walk None: no schedule keeps the limits.

    is_exact: all schedules were tried, and none is better.
    """

    walk: Walk | None
    bound: float
    bound_by: str
    is_exact: bool = False


def search(
    problem: PosteriorProblem, gap: float, is_relative: bool, starts: Sequence[np.ndarray], least_costs: np.ndarray, share: float = 1.0
) -> Answer:
    """Return the schedule and bound of a problem.

    gap: how near they are wanted, as a share of the cost where is_relative; starts: walks (K,) that keep the limits, beside those of
    trellises; least_costs (K,): what no schedule is below in each segment; share: of the work that one search may take.
    """
    walk = _first_of(problem, starts, share)
    if walk is None:
        return Answer(None, np.inf, "no schedule keeps the limits")
    if len(problem.options.limits):
        walk = exchange(problem, walk)
    try:
        answer = _search_from(problem, walk, gap, is_relative, least_costs, share)
    except np.linalg.LinAlgError:  # covariances that overflow, or have lost all digits
        answer = Answer(walk, -np.inf, "nothing: covariances along the run are beyond what numbers hold")
    bound = problem.total(least_costs)
    return replace(answer, bound=bound, bound_by=_ALL_ON) if answer.bound < bound < np.inf else answer


def _first_of(problem: PosteriorProblem, starts: Sequence[np.ndarray], share: float) -> Walk | None:
    """Return the best of walks (K,) that are given and those of trellises, which are left out where it is late."""
    walks = problem.walks(starts)
    trellis = None if walks and problem.deadline.is_over else first_walk(problem, share)
    return min([*walks, *([] if trellis is None else [trellis])], key=lambda walk: walk.value, default=None)


def _search_from(problem: PosteriorProblem, walk: Walk, gap: float, is_relative: bool, least_costs: np.ndarray, share: float) -> Answer:
    """Return what is reached from a first schedule."""
    lost = _rounding(problem, walk) * abs(walk.value) if is_relative else _rounding_of_log_det(problem, walk)

    def gap_at(value: float) -> float:
        """Return what may stay open at a cost, less what rounding takes."""
        return max(0.0, (gap * abs(value) if is_relative else gap) - lost)

    if len(problem.ceilings) and problem.deadline.is_over:  # ceilings are computed first: they take time
        return Answer(walk, -np.inf, "nothing")
    share *= problem.step_share
    if problem.segments <= _LONG:
        answer = prove_best(problem, walk, gap_at, _EFFORT.share(share))
    else:
        answer = _search_blocks(problem, walk, gap_at, least_costs, _EFFORT_OF_BLOCK.share(share))
    return replace(answer, bound=answer.bound - lost)


def _rounding(problem: PosteriorProblem, walk: Walk) -> float:
    """Return what rounding may have changed in covariances, as a share: a sample leaves 1 / (1 + r'P r) of the variance along r."""
    segment = np.arange(problem.maps.rows.shape[-1]) // problem.maps.options
    rows = problem.maps.rows
    known = np.einsum("trim,mij,trjm->trm", rows, walk.covariances[segment], rows, optimize=True)
    return _ROUNDING * (1 + float(known.max(initial=0.0)))


def _rounding_of_log_det(problem: PosteriorProblem, walk: Walk) -> float:
    """Return what rounding may have changed in a log det: that in units of the smallest eigenvalue of covariances of unit diagonal."""
    deviation = np.sqrt(np.maximum(np.diagonal(walk.covariances, axis1=1, axis2=2), 0.0))
    if not (np.isfinite(walk.covariances).all() and (deviation > 0).all()):
        return float("inf")
    smallest = np.linalg.eigvalsh(walk.covariances / deviation[:, :, None] / deviation[:, None, :])[:, 0].min()
    return _rounding(problem, walk) * max(1.0, abs(walk.value)) + _ROUNDING * len(problem.P0) / max(float(smallest), _ROUNDING)


def _search_blocks(
    problem: PosteriorProblem, walk: Walk, gap_at: Callable[[float], float], least_costs: np.ndarray, effort: WorkLimits
) -> Answer:
    """Return what blocks come to; least_costs (K,) bound those that there is no time for."""

    def bound_of(part: PosteriorProblem, weights: np.ndarray, own: Walk) -> tuple[Walk, float]:
        """Return the best schedule of a block and the bound on all."""
        if problem.deadline.is_over:
            return own, problem.total((weights * least_costs[part.maps.first :][: part.segments])[weights > 0])
        share = weights.sum() / problem.segments
        answer = prove_best(part, own, lambda _: _OF_BLOCKS * share * gap_at(walk.value), effort)
        return answer.walk or own, answer.bound

    best, bound = bound_by_blocks(problem, walk, _BLOCKS, bound_of)
    by = f"blocks of {_BLOCKS.length} segments, each with {_BLOCKS.before} before it that cost nothing"
    return Answer(best, min(bound, best.value), by)


def prove_best(problem: PosteriorProblem, walk: Walk, gap_at: Callable[[float], float], effort: WorkLimits) -> Answer:
    """Return what windows and then refined states come to from a first schedule; gap_at: how near, by the best cost known."""
    proof = prove(problem, walk, gap_at(walk.value), effort)
    answer = Answer(proof.walk, proof.bound, windows_of(proof.depth))
    is_closed = proof.bound >= proof.walk.value - gap_at(proof.walk.value)
    if is_closed or problem.deadline.is_over or proof.depth == 1:  # pairs of choices are too many already
        return answer
    answer = _refine_states(problem, proof, gap_at, effort)
    is_near = answer.walk is None or answer.bound >= answer.walk.value - _FAR * abs(answer.walk.value)
    is_free = not problem.options.is_linked and not len(problem.limits)
    return _join_all(problem, answer, gap_at, effort) if is_free and not is_near and not problem.deadline.is_over else answer


def _join_all(problem: PosteriorProblem, answer: Answer, gap_at: Callable[[float], float], effort: WorkLimits) -> Answer:
    """Return the better of a bound and one pass whose states cut across windows: better where memory is long against a segment."""
    walk = answer.walk
    if walk is None:
        return answer
    layers = single_layers(problem)
    chain, slopes = build_chain(problem, layers, np.zeros((1, 0))), cost_slopes(problem, walk)
    steps = sum(len(layer.node) for layer in layers)
    held = MAX_ENTRIES // (len(problem.P0) ** 2 * max(len(layer.node) for layer in layers))
    width = min(_MAX_JOINED, effort.max_simulated // steps, held)
    if width < 1:
        return answer
    limit, tolerance = walk.value - gap_at(walk.value), _TOLERANCE * _worth(problem, walk, slopes)
    result = refine(problem, relaxation_of_ceilings(chain), slopes, limit, width, tolerance)
    if result.is_stopped:
        return answer
    bound = limit if result.relaxation is None else result.relaxation.bound
    if result.nodes is not None:
        walk = better_walk(problem, walk, [result.nodes])
    by = f"partial schedules in {width} states after each segment, whatever came last" if bound > answer.bound else answer.bound_by
    return Answer(walk, min(max(bound, answer.bound), walk.value), by)


def _refine_states(problem: PosteriorProblem, proof: Proof, gap_at: Callable[[float], float], effort: WorkLimits) -> Answer:
    """Return what passes with more and more states after each segment come to, from the windows of a proof on."""
    walk, bound, rest = proof.walk, proof.bound, effort.max_simulated - proof.simulated
    by = windows_of(proof.depth)
    slopes = cost_slopes(problem, walk)
    relaxation = relaxation_of_windows(proof.chain, walk.value - gap_at(walk.value))
    tolerance = _TOLERANCE * _worth(problem, walk, slopes)
    simulated_before = _WIDTHS[0] * problem.segments
    for width in _WIDTHS:
        is_closed = bound >= walk.value - gap_at(walk.value)
        if is_closed or _GROWTH * simulated_before > rest or problem.deadline.is_over or not _can_hold(problem, relaxation, width):
            break
        simulated_before = 0
        if width > _WIDTHS[0]:
            found = refine(problem, relaxation, slopes, walk.value - gap_at(walk.value), _SCHEDULES, tolerance, is_bound=False)
            walk = walk if found.nodes is None else better_walk(problem, walk, [found.nodes])
            simulated_before = found.simulated
        limit = walk.value - gap_at(walk.value)
        result = refine(problem, relaxation, slopes, limit, width, tolerance)
        simulated_before += result.simulated
        rest -= simulated_before
        if result.is_stopped:
            break
        by = f"partial schedules in {width} states after each segment"
        if result.relaxation is None or result.nodes is None:
            bound = max(bound, limit)
            break
        relaxation, bound = result.relaxation, max(bound, result.relaxation.bound)
        walk = better_walk(problem, walk, [result.nodes])
    return Answer(walk, min(bound, walk.value), by)


def _can_hold(problem: PosteriorProblem, relaxation: Relaxation, width: int) -> bool:
    """Whether what goes on from so many states at once, by as many steps as from the states of a relaxation, can be held."""
    steps = max((len(layer.node) / max(1, before.P.shape[2]) for before, layer in pairwise(relaxation.layers)), default=0.0)
    return width * steps * len(problem.P0) ** 2 <= MAX_ENTRIES


def _worth(problem: PosteriorProblem, walk: Walk, slopes: np.ndarray) -> float:
    """Return what knowing as much as the ceiling instead would save at the beginning of a segment, to first order: the median."""
    return float(np.median(np.einsum("kij,kij->k", slopes[:-1], walk.covariances - problem.ceilings)[1:])) if problem.segments > 1 else 0.0


def first_walk(problem: PosteriorProblem, share: float = 1.0) -> Walk | None:
    """Return the best walk of trellises of growing depth, with several prices where something is limited in sum.

    share: of the work that they may take.
    """
    nodes = len(problem.options.pattern_of_node)
    prices, hasty = trellis_prices(problem), replace(problem, deadline=problem.deadline.share(_OF_TRELLISES))
    width = trellis_width(problem, share / len(prices))
    updates = nodes * max(1, problem.maps.rows.shape[0] * problem.maps.rows.shape[1])
    # without limits windows and refined states find better ones in the time
    is_quick = [depth == 1 or nodes**depth <= (_MAX_TRELLIS if len(problem.limits) else _QUICK / updates) for depth in (1, 2, 3)]
    tried: list[np.ndarray] = []
    for depth in (depth for depth, is_tried in enumerate(is_quick, 1) if is_tried):
        for price in prices:
            if tried and hasty.deadline.is_over:
                break
            walk = follow_trellis(hasty, depth, price, width)
            tried += [] if walk is None else [walk]
    return min(problem.walks(tried), key=lambda walk: walk.value, default=None)


def trellis_prices(problem: PosteriorProblem) -> list[np.ndarray]:
    """Return the prices (R,) that partial schedules are compared with."""
    limits = problem.options.limits
    if not len(limits) or problem.deadline.is_over:
        return [np.zeros(len(limits))]
    layers = single_layers(problem)
    if problem.is_worst:
        level = float(np.median(np.concatenate([layer.cost for layer in layers])))
        unit = np.full(len(limits), level) / np.maximum(limits, problem.options.usage.max(initial=1e-9, axis=(1, 2)))
    else:
        unit = best_prices(problem, layers)
    is_priced = unit.any() and np.isfinite(unit).all()
    return [factor * unit for factor in _PRICE_FACTORS] if is_priced else [np.zeros(len(limits))]
