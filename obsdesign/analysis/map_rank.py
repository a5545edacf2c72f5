"""What outputs of a map from one instant to the next tell about its state, from as many samples as it takes.

dimension = rank J - rank J_w of the Jacobian J = [J_w J_x] of (y_0, ..., y_K) with respect to (w_0, ..., w_K-1, x_0) along random
solutions: one, or several from one state under other known inputs and the same unknown ones.
Source: H. Nijmeijer, "Observability of autonomous discrete time non-linear systems", 1982; F. Albertini and D. D'Alessandro, "Observability
and forward-backward observability of discrete-time nonlinear systems", 2002.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import count as count_up

from obsdesign.analysis.engine_result import EngineResult, cut_after_growth, precision_text, zero_test_text
from obsdesign.analysis.equations import Equations
from obsdesign.analysis.evaluation_point import EvaluationPoint, SamplingRegion, random_residues
from obsdesign.analysis.experiments import Experiments
from obsdesign.analysis.map_growth import MapSolutions, solutions_of
from obsdesign.analysis.rank_growth import require_value
from obsdesign.errors import InputError
from obsdesign.rank.elimination import Rank
from obsdesign.rank.exact_numbers import as_residue
from obsdesign.rank.graph import NoValueError
from obsdesign.rank.symbols import Symbols

_MAX_SAMPLES = 96
"""No more samples than this are taken."""
_MAX_COUNT = 16
"""No more solutions from one state than this are compared."""
_ATTEMPTS = 5  # random places tried: another one is needed only where something has no value, such as 1 / 0


@dataclass(frozen=True, eq=False)
class MapGrowth:
    """Dimensions by number of samples less one, at most, as far as they were followed; has_ended: whether more samples add nothing.

    experiments: modulo the prime, those of which these are the dimensions.
    """

    dimensions: tuple[int, ...]
    has_ended: bool
    experiments: Experiments

    @property
    def dimension(self) -> int:
        """The last dimension."""
        return self.dimensions[-1]

    @property
    def order(self) -> int:
        """How many samples, less one, show the last dimension."""
        return self.dimensions.index(self.dimensions[-1])


def analyse_map(equations: Equations, smooth: bool, region: SamplingRegion, point: EvaluationPoint | None = None) -> EngineResult:
    """Return what is observable at random states of the region, or at a place.

    smooth: one sequence of known inputs in place of all.
    """
    growth = _growth(equations, smooth, region.seed, point)
    cap = _cap(equations, smooth, region.seed, point, growth)
    if point:
        rank = _rank_at(equations, growth, point)
        return _finding(equations, growth, rank, point, cap)
    best: EngineResult | None = None
    for place in _usable_points(equations, region):
        try:
            finding = _finding(equations, growth, _rank_at(equations, growth, place), place, cap)
        except NoValueError:
            continue
        if finding.is_decided:
            return finding
        best = finding if best is None or finding.dimension > best.dimension else best
    if best is None:
        raise InputError("no random point was found from which solutions have a value: give a point")
    return best


def _usable_points(equations: Equations, region: SamplingRegion) -> Iterator[EvaluationPoint]:
    failure: NoValueError | None = None
    places = 0
    for place in region.points():
        try:
            require_value(equations, place)
        except NoValueError as error:
            failure = error
            continue
        places += 1
        yield place
    if not places:
        raise InputError(f"no random point was found in the domain of every function ({failure}): give a point")


def _finding(equations: Equations, growth: MapGrowth, rank: Rank, point: EvaluationPoint, cap: _Cap | None) -> EngineResult:
    n, ranks = equations.n, cut_after_growth([min(dimension, rank.rank) for dimension in growth.dimensions])
    samples = f"{growth.order + 1} sample{'s' * (growth.order > 0)}"
    if rank.rank == n:
        return EngineResult(rank, point, ranks, "full", f"no more is possible; by {samples}")
    if cap and rank.rank == cap.dimension:
        return EngineResult(rank, point, ranks, "cap", f"no more is possible: {cap.reason}; by {samples}")
    if not rank.is_decided:
        why = f"{precision_text(rank)}, and at most {growth.dimension} {zero_test_text(equations.is_rational)}"
        return EngineResult(rank, point, ranks, "precision", why)
    if growth.has_ended:
        is_modular = rank.rank == growth.dimension
        how = zero_test_text(equations.is_rational) if is_modular else f"to {rank.bits} bits, for as many as there are states"
        return EngineResult(rank, point, ranks, "criterion", f"no more: samples after {samples} add nothing {how}")
    followed = f"{len(growth.dimensions)} samples were taken, and more may tell more"
    return EngineResult(rank, point, ranks, "stalled", f"not decided: a lower bound: {followed}")


def _rank_at(equations: Equations, growth: MapGrowth, point: EvaluationPoint) -> Rank:
    experiments = growth.experiments
    real = Experiments(equations, point, growth.order, experiments.count, experiments.seed)
    rank = real.rank(growth.order, upper_bound=replace(experiments, orders=growth.order).bound(growth.order))
    if rank.is_decided or equations.is_rational or rank.rank >= growth.dimension:
        return rank
    # functions are symbols modulo the prime, and not all relations are there: numbers that are thin around 0 tell as well
    rank = real.numerical_rank(growth.order)
    later = replace(real, orders=growth.order + equations.n).numerical_rank(growth.order + equations.n)
    return replace(later, is_decided=rank.is_decided and later.is_decided and rank.rank == later.rank)


@dataclass(frozen=True)
class _Cap:
    """What a dimension is at most, and why."""

    dimension: int
    reason: str


def _cap(equations: Equations, smooth: bool, seed: int, point: EvaluationPoint | None, growth: MapGrowth) -> _Cap | None:
    """Return what the dimension is at most, where no end was seen: what is seen with all inputs known, there or at random states."""
    if growth.has_ended or not (equations.unknown_fields or point):
        return None
    caps: list[_Cap] = []
    all_known = equations.with_all_inputs_known()
    inputs = "if the inputs are known" if equations.unknown_fields else ""
    if inputs and (there := _growth(all_known, smooth, seed, point)).has_ended:
        caps.append(_Cap(there.dimension, f"it is as much {inputs}"))
    if point and (nearby := _growth(all_known, smooth, seed, None)).has_ended:
        caps.append(_Cap(nearby.dimension, f"the generic rank is the same {inputs}".strip()))
    return min(caps, key=lambda cap: cap.dimension, default=None)


def _growth(equations: Equations, smooth: bool, seed: int, point: EvaluationPoint | None) -> MapGrowth:
    for attempt in range(1 if point else _ATTEMPTS):
        state = [int(as_residue(value)) for value in point.state] if point else random_residues(equations.n, seed + attempt)
        place = EvaluationPoint(tuple(state), Symbols(has_free_roots=not equations.is_rational))
        first = Experiments(equations, place, 0, 1, seed + attempt)
        try:
            return _with_enough_solutions(first, smooth, is_point=point is not None)
        except ZeroDivisionError:
            continue
    raise InputError("no random solution was found that meets no pole of some function: give a point")


def _with_enough_solutions(first: Experiments, smooth: bool, *, is_point: bool) -> MapGrowth:
    """Return the growth with as many solutions as it takes until more of them tell nothing more, of the unknown inputs neither."""
    growth, flow = _follow(first, is_point=is_point), first.equations.map_flow
    if smooth or flow.is_linear or not flow.u.numel():
        return growth
    while growth.dimension < first.equations.n:
        count, more = growth.experiments.count, replace(first, count=2 * growth.experiments.count)
        # without unknown inputs what several solutions tell is the sum of what each of them tells: it ends with that
        wider = _follow(more, is_point=is_point) if flow.w.numel() else _dimensions(more, len(growth.dimensions) - 1, growth.has_ended)
        order = len(wider.dimensions) - 1 + first.equations.n
        if wider.dimension == growth.dimension and _rank(more, order) == _rank(replace(first, count=count), order):
            return growth
        if 2 * count > _MAX_COUNT:
            return replace(growth, has_ended=False)
        growth = wider
    return growth


def _rank(experiments: Experiments, order: int) -> int:
    """Rank of J: of what so many samples more than one tell of the state and of the unknown inputs."""
    return solutions_of(replace(experiments, orders=order), order + 1, is_point=True).rank(order)


def _dimensions(experiments: Experiments, order: int, has_ended: bool) -> MapGrowth:
    solutions = solutions_of(replace(experiments, orders=order), order + 1, is_point=True)
    return MapGrowth(tuple(solutions.dimension(0, k) for k in range(order + 1)), has_ended, replace(experiments, orders=order))


def _follow(first: Experiments, *, is_point: bool) -> MapGrowth:
    """Return the dimensions up to the end, or up to n samples after the last growth where an end is not seen."""
    n = first.equations.n
    for steps in (min(2 * (n + 2) * 2**k, _MAX_SAMPLES) for k in count_up()):
        experiments = replace(first, orders=steps)
        solutions = solutions_of(experiments, steps + 1, is_point=is_point)
        settled = 0 if first.equations.map_flow.is_linear else solutions.settles_at()
        dimensions = _until_end(solutions, settled, steps, n)
        if dimensions or steps == _MAX_SAMPLES:
            has_ended = bool(dimensions) and (settled is not None or dimensions[-1] == n)
            given = dimensions or [solutions.dimension(0, k) for k in range(steps + 1)]
            return MapGrowth(tuple(given), has_ended, experiments)
    raise AssertionError("unreachable: the number of samples is bounded")


def _until_end(solutions: MapSolutions, settled: int | None, steps: int, n: int) -> list[int]:
    """Return the dimensions from x_0 up to the end; empty where that is beyond so many steps."""
    dimensions: list[int] = []
    starts = range((settled or 0) + 1)
    previous: list[int] = []
    for k in range(steps - (settled or 0)):
        current = [solutions.dimension(start, k) for start in starts]
        dimensions.append(current[0])
        stalls = k - dimensions.index(current[0])
        if current[0] == n or (stalls >= n if settled is None else current == previous):
            return dimensions
        previous = current
    return []
