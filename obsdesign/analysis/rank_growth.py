"""How far the observable space grows with the order of derivatives, at a generic state: exact, because it ends where it stalls.

Along a generic solution the derivatives of what is known about the state give more, or will never give more: let P_k be the
combinations of (dy, ..., dy^(k)) without a part in the unknown inputs. P_(k+1) contains P_k and the derivatives of those of
its elements that no unknown input enters; if it equals P_k, that is invariant, and P_k is all there ever is. The same space
as the weakly unobservable subspace of the linear time-varying system along the solution leaves over.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import casadi as ca

from obsdesign.analysis.equations import Equations
from obsdesign.analysis.evaluation_point import EvaluationPoint, SamplingRegion
from obsdesign.analysis.experiments import Experiments
from obsdesign.analysis.modular_points import random_modular_point
from obsdesign.analysis.unsaturated_points import desaturate
from obsdesign.errors import InputError
from obsdesign.rank.balls import PRECISIONS
from obsdesign.rank.elimination import Rank, RankBound, first_without_value
from obsdesign.rank.graph import NoValueError

_ATTEMPTS = 5  # random places tried: another one is needed only where something has no value, such as 1 / 0
_N_POINTS = 3
"""At so many real places the rank is looked for that it has modulo the prime."""


@dataclass(frozen=True, eq=False)
class RankGrowth:
    """dimensions[k]: of the observable space with derivatives up to order k, at most.

    total_dimension: the last dimension with the added states, at most
    rank: in balls, at `point`: what is proven of the last; is_rational: whether no function is a symbol.
    """

    dimensions: tuple[int, ...]
    total_dimension: int
    rank: Rank
    point: EvaluationPoint
    is_rational: bool

    @property
    def is_decided(self) -> bool:
        """Whether as much is proven as there is at most."""
        return self.rank.is_decided

    @property
    def dimension(self) -> int:
        """Dimension of the observable space, at most."""
        return self.dimensions[-1]

    @property
    def order(self) -> int:
        """Highest order of derivative taken."""
        return len(self.dimensions) - 1


def require_value(equations: Equations, point: EvaluationPoint) -> None:
    """Raise NoValueError, with what is to blame, unless outputs, their gradients and the fields have a value at the place."""
    gradient = ca.jacobian(equations.outputs, equations.x)
    fields = [equations.drift, *equations.known_fields, *equations.unknown_fields]
    outputs = [f"output {name!r}" for name in equations.output_names]
    rates = [f"the rate of {name}" for _ in fields for name in equations.names]
    checks = [(ca.vertcat(equations.outputs, *fields), outputs + rates), (gradient, [f"the gradient of {output}" for output in outputs])]
    for expression, labels in checks:
        row = first_without_value(equations.function(expression), (point.state, equations.values))
        if row is not None:
            raise NoValueError(row, f"{labels[row]} at {equations.describe(point)}")
    if equations.piece and not equations.piece.contains(point.state):
        raise NoValueError(0, f"this piece of the functions at {equations.describe(point)}")


def restrict_to_piece(equations: Equations, region: SamplingRegion) -> Equations:
    """Return the equations of one piece, where functions have pieces: that of the centre, or of the first random place."""
    if not equations.has_pieces:
        return equations
    failure: NoValueError | None = None
    for point in [region.centre_behind(equations.n_added)] if region.centre else region.points(equations.n_added):
        try:
            require_value(equations, point)
            return equations.smooth_near(point.state)
        except NoValueError as error:
            failure = error
    raise InputError(f"no random point was found in the domain of every function ({failure}): give a point")


def generic_growth(equations: Equations, region: SamplingRegion) -> RankGrowth:
    """Return the growth: its end modulo the prime, and what of it is proven at random places where everything has a value."""
    bounds = modular_growth(equations, region.seed)
    best: RankGrowth | None = None
    for point in _in_two_passes(usable_points(equations, region)):
        growth = bounds.verify_at(equations, point, region.seed)
        if growth and growth.is_decided:
            return growth
        best = growth if growth and (best is None or growth.rank.rank > best.rank.rank) else best
    if best is None:
        raise InputError("no random point was found where all derivatives have a value: give a point")
    return best


def _in_two_passes(points: Iterator[EvaluationPoint]) -> Iterator[EvaluationPoint]:
    """Yield the places with the cheaper precisions, then all of them with the finer ones."""
    cheap_points: list[EvaluationPoint] = []
    for point in points:
        cheap_points.append(point)
        yield replace(point, precisions=PRECISIONS[:3])
    yield from (replace(point, precisions=PRECISIONS[3:]) for point in cheap_points)


def usable_points(equations: Equations, region: SamplingRegion) -> Iterator[EvaluationPoint]:
    """Yield some of the places around where everything has a value, moved to where no function is saturated; at least one."""
    failure: NoValueError | None = None
    count = 0
    for candidate in region.points(equations.n_added):
        point = desaturate(equations, candidate) if region.centre is None else candidate
        try:
            require_value(equations, point)
        except NoValueError as error:
            failure = error
            continue
        yield point
        count += 1
        if count == _N_POINTS:
            return
    if not count:
        raise InputError(f"no random point was found in the domain of every function ({failure}): give a point")


@dataclass(frozen=True, eq=False)
class ModularGrowth:
    """The growth modulo the prime, at `point`: dimensions by order up to the first that adds nothing, the last total and bound.

    All of them are what there is at most. previous_bound: the bound of the last order but one, where it is to be reached, too.
    """

    dimensions: tuple[int, ...]
    total_dimension: int
    last_bound: RankBound
    previous_bound: RankBound | None
    point: EvaluationPoint

    @property
    def dimension(self) -> int:
        """Dimension of the observable space, at most."""
        return self.dimensions[-1]

    def verify_at(self, equations: Equations, point: EvaluationPoint, seed: int) -> RankGrowth | None:
        """Return the growth with what is proven of it at a real place; None where derivatives have no value there."""
        order = len(self.dimensions) - 1
        experiments = Experiments(equations, point, order, seed=seed)
        try:
            rank = experiments.rank(order, upper_bound=self.last_bound)
            if rank.is_decided and self.previous_bound and rank.null_space.shape[1]:
                # that the last order adds nothing is proven of the true space if the one before is as large
                rank = replace(rank, is_decided=experiments.rank(order - 1, upper_bound=self.previous_bound).is_decided)
        except NoValueError:
            return None
        return RankGrowth(self.dimensions, self.total_dimension, rank, point, equations.is_rational)


def modular_growth(equations: Equations, seed: int, point_of_attempt: Callable[[int], EvaluationPoint] | None = None) -> ModularGrowth:
    """Return the growth at a random place modulo the prime; point_of_attempt: those to take by attempt (None: anywhere)."""
    for attempt in range(_ATTEMPTS):
        point = point_of_attempt(seed + attempt) if point_of_attempt else random_modular_point(equations, seed + attempt)
        try:
            return _growth_at(equations, point, seed + attempt)
        except ZeroDivisionError:
            continue
    raise InputError("no random point was found that is no pole of some function: give a point")


def _growth_at(equations: Equations, point: EvaluationPoint, seed: int) -> ModularGrowth:
    dimensions: list[int] = []
    previous = 0
    for orders in _doubling_orders(equations):
        experiments = Experiments(equations, point, orders, seed=seed)
        for order in range(len(dimensions), orders + 1):
            dimensions.append(experiments.dimension(order))
            total_dimension = experiments.total_dimension(order)
            if dimensions[-1] == equations.n_queried or (order > 0 and total_dimension == previous):
                needs_previous = bool(equations.unknown_fields) and not equations.is_rational and order > 0
                previous_bound = experiments.bound(order - 1) if needs_previous else None
                return ModularGrowth(tuple(dimensions), total_dimension, experiments.bound(order), previous_bound, point)
            previous = total_dimension
    raise AssertionError("the observable space grew more often than it has dimensions")


def _doubling_orders(equations: Equations) -> Iterator[int]:
    """Yield 2, 4, 8, ..., n + 1: by then the growth has ended."""
    limit = equations.n + 1
    orders = 2
    while orders < limit:
        yield orders
        orders *= 2
    yield limit
