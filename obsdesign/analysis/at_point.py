"""The observable space at a state that was asked for: there it may be less than nearby.

With known inputs alone the rank of all derivatives is the same at all states that can be reached from one (the flow carries
them over). At least so much is proven from the state itself, or from a state on the way; at most so much by the generic rank, or
by that on a set that the state cannot leave. Unknown inputs are first replaced by what the outputs give away of them, where that
is regular at the state.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from obsdesign.analysis.engine_result import EngineResult, cut_after_growth, precision_text, zero_test_text
from obsdesign.analysis.equations import Equations, with_input_states
from obsdesign.analysis.evaluation_point import EvaluationPoint, random_fractions
from obsdesign.analysis.experiments import Experiments
from obsdesign.analysis.field_rescaling import RescaledSystem, rescale
from obsdesign.analysis.generic_rank import MAX_INPUT_DERIVATIVES, cap_if_known, without_idle_inputs, witness_point
from obsdesign.analysis.invariant_set import growth_on_invariant
from obsdesign.analysis.lie_expressions import IndependenceTest, TooLargeError
from obsdesign.analysis.modular_points import modular_point, random_modular_point
from obsdesign.analysis.orbit import rank_along_orbit
from obsdesign.analysis.rank_growth import ModularGrowth, modular_growth
from obsdesign.errors import InputError
from obsdesign.rank.balls import PRECISIONS
from obsdesign.rank.elimination import Rank, RankBound
from obsdesign.rank.graph import NoValueError

MAX_ORDER = 40
"""No higher derivatives than this, or than 2 n + 12, are taken at a state."""
_FINER_PRECISIONS = (8192, 16384, 32768, 65536)
"""Precisions beyond the usual ones, tried where that is cheap."""
_MAX_BIT_OPERATIONS = 4e9
"""Bits times operations."""


def analyse_at(equations: Equations, smooth: bool, point: EvaluationPoint, nearby: EngineResult, seed: int) -> EngineResult:
    """Return what is observable at the place; nearby: what is at generic states. Raises NoValueError where derivatives have no value."""
    if equations.known_fields and equations.unknown_fields and not smooth:
        equations = without_idle_inputs(equations, equations.region(seed, point))
    if not equations.unknown_fields:
        return _analyse_known_inputs(equations, point, seed)
    cap = _cap_if_known(equations, point, seed)
    result = _analyse_by_rescaling(equations, smooth, point, cap, seed)
    if result is None and (smooth or not equations.known_fields):
        result = _analyse_by_regularity(equations, point, cap, seed)
    if result is None or result.dimension > min(cap, nearby.dimension if nearby.is_decided else cap):
        return _analyse_by_jets(equations, smooth, point, cap, seed)
    # the steps are those of the recursion, where it comes to the same end
    return replace(result, ranks=nearby.ranks) if result.dimension == nearby.dimension else result


def analyse_jets_at(equations: Equations, smooth: bool, point: EvaluationPoint, seed: int, orders: int | None = None) -> EngineResult:
    """Return the lower bound by derivatives at the place, up to `orders`."""
    return _analyse_by_jets(equations, smooth, point, _cap_if_known(equations, point, seed), seed, orders)


def _cap_if_known(equations: Equations, point: EvaluationPoint, seed: int) -> int:
    """Return the dimension at the place for somebody who knows the unknown inputs; n where that is not decided."""
    cap = _analyse_known_inputs(equations.with_all_inputs_known(), point, seed)
    return cap.dimension if cap.is_decided else min(equations.n_queried, cap_if_known(equations, equations.region(seed)))


def _analyse_known_inputs(equations: Equations, point: EvaluationPoint, seed: int) -> EngineResult:
    """Return what is observable at the place with known inputs alone."""
    n = equations.n_queried
    nearby = modular_growth(equations, seed)
    lower_bound = _lower_bound(equations, False, point, nearby.total_dimension, seed)
    rank, ranks = lower_bound.rank, lower_bound.dimensions
    if rank.rank == n:
        return EngineResult(rank, point, ranks, "full", "no more is possible")
    if rank.is_decided and lower_bound.total_dimension == nearby.total_dimension:
        return EngineResult(rank, point, ranks, "cap", "no more is possible: the generic rank is the same")
    if not rank.is_decided and lower_bound.upper > rank.rank:
        why = f"{precision_text(rank)}, and at most {lower_bound.upper} {zero_test_text(equations.is_rational)}"
        return EngineResult(rank, point, ranks, "precision", why)
    invariant_growth = growth_on_invariant(equations, point, seed)
    if invariant_growth and rank.is_decided and invariant_growth.total_dimension == lower_bound.total_dimension:
        return EngineResult(rank, point, ranks, "criterion", f"no more: {_invariance_reason(equations)}; nearby it is {nearby.dimension}")
    return _analyse_orbit(equations, point, lower_bound, nearby, invariant_growth, seed)


def _invariance_reason(equations: Equations) -> str:
    return f"no solution leaves a set at whose random states no more is seen {zero_test_text(equations.is_rational)}"


def _analyse_orbit(
    equations: Equations,
    point: EvaluationPoint,
    lower_bound: _LowerBound,
    nearby: ModularGrowth,
    invariant_growth: ModularGrowth | None,
    seed: int,
) -> EngineResult:
    """Return what a state on the way shows, where that is as much as there can be."""
    orders = max(_doubling_orders(equations.n))
    reason_here = f"derivatives up to order {orders} add nothing here"
    why = f"not decided: {reason_here}; on a set that no solution leaves it is at most {(invariant_growth or nearby).dimension}"
    stalled = EngineResult(lower_bound.rank, point, lower_bound.dimensions, "stalled", why)
    if equations.n_added:
        return stalled
    target = invariant_growth or nearby
    target_bound = RankBound(target.dimension, 0, None)
    rank = rank_along_orbit(equations, point, len(target.dimensions), lower_bound.count, target_bound, seed)
    if rank is None or rank.rank < lower_bound.rank.rank:
        return stalled
    shown_states_agree = rank.is_exact or all(
        is_shown for is_seen, is_shown in zip(rank.is_determined, lower_bound.rank.is_determined, strict=True) if is_seen
    )
    if not rank.is_decided or not shown_states_agree:  # what seems to be seen by itself is to be proven to be
        return replace(stalled, rank=rank)
    ranks = (*lower_bound.dimensions, *[rank.rank] * (lower_bound.dimensions[-1] < rank.rank))
    text = "shown by a state on the way, and the flow carries it over"
    if rank.rank == equations.n:
        return EngineResult(rank, point, ranks, "full", f"{text}; no more is possible")
    if rank.rank == nearby.dimension:
        return EngineResult(rank, point, ranks, "cap", f"{text}; no more is possible: the generic rank is the same")
    return EngineResult(
        rank, point, ranks, "criterion", f"{text}; no more: {_invariance_reason(equations)}; nearby it is {nearby.dimension}"
    )


def _analyse_by_rescaling(equations: Equations, smooth: bool, point: EvaluationPoint, cap: int, seed: int) -> EngineResult | None:
    """Return what is observable where the outputs give all unknown inputs away at the place itself; None where they do not.

    As at generic states, unknown inputs become states where the outputs give only their derivatives away.
    """
    for level in range(MAX_INPUT_DERIVATIVES + 1):
        extended = with_input_states(equations, level) if level else equations
        extended_point = EvaluationPoint((*random_fractions(extended.n_added - equations.n_added, f"{seed} unknown inputs"), *point.state))
        try:
            rescaled = _regular_rescaling(extended, smooth, extended_point, seed)
            result = _analyse_rescaled(rescaled, smooth, extended_point, cap, seed) if rescaled else None
        except InputError:
            continue
        if result:
            return replace(result, point=point)
    return None


def _analyse_rescaled(rescaled: RescaledSystem, smooth: bool, point: EvaluationPoint, cap: int, seed: int) -> EngineResult | None:
    """Return what is observable at the place by the question with known inputs that the rescaled system asks; None if undecided."""
    if smooth or not rescaled.equations.known_fields:
        result = _analyse_known_inputs(rescaled.equations_under_smooth_input(), point, seed)
        return _with_cap_reason(_explain_rescaling(result), cap) if result.is_decided else None
    inner = _analyse_known_inputs(rescaled.equations_with_known_inputs(rescaled.rate_changes_by_known_fields), point, seed)
    if inner.is_decided and inner.dimension < cap:
        outer = _analyse_known_inputs(
            rescaled.equations_with_known_inputs(rescaled.rate_changes_by_known_fields, rescaled.tensor), point, seed
        )
        if not outer.is_decided or outer.dimension > inner.dimension:
            return None
    return _with_cap_reason(_explain_rescaling(inner), cap) if inner.is_decided else None


def _explain_rescaling(result: EngineResult) -> EngineResult:
    return replace(result, reason=f"with the unknown inputs replaced by rates of outputs {result.reason}")


def _with_cap_reason(result: EngineResult, cap: int) -> EngineResult:
    """Return the finding with the reason that holds for the system with its unknown inputs."""
    if result.stopped_by == "full":
        return result
    if result.dimension == cap:
        return replace(result, stopped_by="cap", reason="no more is possible: it is as much if the inputs are known")
    return result


def _regular_rescaling(equations: Equations, smooth: bool, point: EvaluationPoint, seed: int) -> RescaledSystem | None:
    """Return the rescaled system if it is regular at the place.

    Under one smooth known input outputs are not redefined: of a derivative along u and drift only the sum is known.
    """
    if smooth and equations.known_fields:
        return RescaledSystem(equations, equations.outputs, equations.outputs).rescale_at(IndependenceTest(equations, point))
    try:
        region = equations.region(seed, point)
        independence = IndependenceTest(equations, random_modular_point(equations, seed), witness_point(equations, region))
        rescaled = rescale(independence, everywhere=True)
        return rescaled.rescale_at(IndependenceTest(equations, point)) if rescaled else None
    except (TooLargeError, NoValueError, ZeroDivisionError):
        return None


def _analyse_by_regularity(equations: Equations, point: EvaluationPoint, cap: int, seed: int) -> EngineResult | None:
    """Return what is observable under one smooth input where the ranks of J and J_w are, order by order, those of states nearby.

    The spaces P_k then have the same dimensions at the place as around it, so they end where they do. None where they differ.
    """
    nearby = modular_growth(equations, seed)
    growth_order = len(nearby.dimensions) - 1
    orders = min(growth_order + 1 + equations.n, MAX_ORDER)
    at_point = Experiments(equations, point, orders, seed=seed)
    at_neighbour = replace(at_point, point=nearby.point)
    for order in range(orders + 1):
        if not all(at_point.reaches(order, at_neighbour.bound(order, columns)) for columns in (0, at_point.n_input_columns)):
            return None
    rank = at_point.rank(orders, upper_bound=replace(at_point, point=modular_point(equations, point.state)).bound(orders))
    if not rank.is_decided or rank.rank != nearby.dimension:
        return None
    why = f"no more: derivatives up to order {orders} have the same ranks here as nearby, where those of order {growth_order} add nothing"
    return _with_cap_reason(EngineResult(rank, point, cut_after_growth(nearby.dimensions), "cap", why), cap)


def _analyse_by_jets(
    equations: Equations, smooth: bool, point: EvaluationPoint, cap: int, seed: int, orders: int | None = None
) -> EngineResult:
    """Return the lower bound by derivatives at the place, decided where it is as much as with the inputs known."""
    lower_bound = _lower_bound(equations, smooth, point, cap, seed, orders)
    rank, ranks = lower_bound.rank, lower_bound.dimensions
    if rank.rank == equations.n:
        return EngineResult(rank, point, ranks, "full", "no more is possible")
    if rank.rank == cap:
        return EngineResult(rank, point, ranks, "cap", "no more is possible: it is as much if the inputs are known")
    order = orders or max(_doubling_orders(equations.n))
    why = f"a lower bound: derivatives were followed to order {order}, and a higher order may add more"
    return EngineResult(rank, point, ranks, "stalled", f"not decided: {why}")


@dataclass(frozen=True, eq=False)
class _LowerBound:
    """The rank at a place, the dimensions by order, and the rank with the added states; count: of experiments.

    upper: what the rank of these derivatives is at most.
    """

    rank: Rank
    dimensions: tuple[int, ...]
    total_dimension: int
    upper: int
    count: int


def _lower_bound(
    equations: Equations, smooth: bool, point: EvaluationPoint, target: int, seed: int, orders: int | None = None
) -> _LowerBound:
    """Return what derivatives at the place show, up to the first order that reaches the goal, or else adds nothing."""
    experiments, dimensions = _follow_orders(equations, smooth, point, target, seed, orders)
    order = len(dimensions) - 1
    real_experiments = replace(experiments, point=_with_finer_precisions(equations, point, order), orders=order)
    modular_experiments = replace(experiments, orders=order)
    bound = modular_experiments.bound(order)
    rank = real_experiments.rank(order, upper_bound=bound)
    total = (
        real_experiments.rank(
            order,
            upper_bound=modular_experiments.bound(order, modular_experiments.n_input_columns),
            n_eliminated=modular_experiments.n_input_columns,
        ).rank
        if equations.n_added
        else rank.rank
    )
    ranks = cut_after_growth([min(dimension, rank.rank) for dimension in dimensions])
    return _LowerBound(rank, ranks, total, bound.rank, experiments.count)


def _follow_orders(
    equations: Equations, smooth: bool, point: EvaluationPoint, target: int, seed: int, orders: int | None
) -> tuple[Experiments, tuple[int, ...]]:
    """Return experiments at the place modulo the prime, and the dimensions that they show by order, to the last that adds something."""
    modular = modular_point(equations, point.state)
    dimensions: list[int] = []
    total_dimensions: list[int] = []
    experiments = Experiments(equations, modular, 0, seed=seed)
    for highest in (orders,) if orders else tuple(_doubling_orders(equations.n)):
        experiments = Experiments(equations, modular, highest, seed=seed)
        if equations.known_fields and not smooth:
            experiments = experiments.complete()
        for order in range(len(dimensions), highest + 1):
            dimensions.append(experiments.dimension(order))
            total_dimensions.append(experiments.total_dimension(order))
            if total_dimensions[-1] >= target or dimensions[-1] == equations.n_queried:
                return experiments, tuple(dimensions)
    last = max(sequence.index(sequence[-1]) for sequence in (dimensions, total_dimensions))
    return experiments, tuple(dimensions[: last + 1])


def _with_finer_precisions(equations: Equations, point: EvaluationPoint, order: int) -> EvaluationPoint:
    """Return the place with finer precisions, as far as they are cheap."""
    n = equations.n
    operations = (order + 1) ** 2 * (len(equations.flow.steps) + n * n * (n + len(equations.unknown_fields) * order))
    return replace(point, precisions=(*PRECISIONS, *(bits for bits in _FINER_PRECISIONS if bits * operations <= _MAX_BIT_OPERATIONS)))


def _doubling_orders(n: int) -> Iterator[int]:
    """Yield 2, 4, 8, ... up to the highest order of derivatives that is taken at a state."""
    limit = min(2 * n + 12, MAX_ORDER)
    orders = 2
    while orders < limit:
        yield orders
        orders *= 2
    yield limit
