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
from obsdesign.analysis.evaluation_point import Place, Surroundings
from obsdesign.analysis.experiments import Experiments
from obsdesign.analysis.modular_points import residue_place
from obsdesign.analysis.unsaturated_points import moderate
from obsdesign.errors import InputError
from obsdesign.rank.balls import PRECISIONS
from obsdesign.rank.elimination import Bound, Rank, first_without_value
from obsdesign.rank.graph import NoValueError

_SEEDS = 5  # random places tried: another one is needed only where something has no value, such as 1 / 0
_PLACES = 3
"""At so many real places the rank is looked for that it has modulo the prime."""


@dataclass(frozen=True, eq=False)
class Growth:
    """dimensions[k]: of the observable space with derivatives up to order k, at most.

    total: the last dimension with the added states, at most
    rank: in balls, at `place`: what is proven of the last; rational: whether no function is a symbol.
    """

    dimensions: tuple[int, ...]
    total: int
    rank: Rank
    place: Place
    rational: bool

    @property
    def decided(self) -> bool:
        """Whether as much is proven as there is at most."""
        return self.rank.decided

    @property
    def dimension(self) -> int:
        """Dimension of the observable space, at most."""
        return self.dimensions[-1]

    @property
    def order(self) -> int:
        """Highest order of derivative taken."""
        return len(self.dimensions) - 1


def require_value(equations: Equations, place: Place) -> None:
    """Raise NoValueError, with what is to blame, unless outputs, their gradients and the fields have a value at the place."""
    gradient = ca.jacobian(equations.outputs, equations.x)
    fields = [equations.drift, *equations.known, *equations.unknown]
    outputs = [f"output {name!r}" for name in equations.output_names]
    rates = [f"the rate of {name}" for _ in fields for name in equations.names]
    checks = [(ca.vertcat(equations.outputs, *fields), outputs + rates), (gradient, [f"the gradient of {output}" for output in outputs])]
    for expression, labels in checks:
        row = first_without_value(equations.function(expression), (place.state, equations.values))
        if row is not None:
            raise NoValueError(row, f"{labels[row]} at {equations.where(place)}")
    if equations.piece and not equations.piece.holds(place.state):
        raise NoValueError(0, f"this piece of the functions at {equations.where(place)}")


def one_piece(equations: Equations, around: Surroundings) -> Equations:
    """Return the equations of one piece, where functions have pieces: that of the centre, or of the first random place."""
    if not equations.has_pieces:
        return equations
    failure: NoValueError | None = None
    for place in [around.centre] if around.centre else around.places(equations.extra):
        try:
            require_value(equations, place)
            return equations.smooth_near(place.state)
        except NoValueError as error:
            failure = error
    raise InputError(f"no random point was found in the domain of every function ({failure}): give a point")


def generic_growth(equations: Equations, around: Surroundings) -> Growth:
    """Return the growth: its end modulo the prime, and what of it is proven at random places where everything has a value."""
    bounds = growth_modulo(equations, around.seed)
    best: Growth | None = None
    for place in _twice(usable_places(equations, around)):
        growth = bounds.at(equations, place, around.seed)
        if growth and growth.decided:
            return growth
        best = growth if growth and (best is None or growth.rank.rank > best.rank.rank) else best
    if best is None:
        raise InputError("no random point was found where all derivatives have a value: give a point")
    return best


def _twice(places: Iterator[Place]) -> Iterator[Place]:
    """Yield the places with the cheaper precisions, then all of them with the finer ones."""
    met: list[Place] = []
    for place in places:
        met.append(place)
        yield replace(place, precisions=PRECISIONS[:3])
    yield from (replace(place, precisions=PRECISIONS[3:]) for place in met)


def usable_places(equations: Equations, around: Surroundings) -> Iterator[Place]:
    """Yield some of the places around where everything has a value, moved to where no function is saturated; at least one."""
    failure: NoValueError | None = None
    found = 0
    for drawn in around.places(equations.extra):
        place = moderate(equations, drawn) if around.centre is None else drawn
        try:
            require_value(equations, place)
        except NoValueError as error:
            failure = error
            continue
        yield place
        found += 1
        if found == _PLACES:
            return
    if not found:
        raise InputError(f"no random point was found in the domain of every function ({failure}): give a point")


@dataclass(frozen=True, eq=False)
class Bounds:
    """The growth modulo the prime, at `place`: dimensions by order up to the first that adds nothing, the last total and bound.

    All of them are what there is at most. before: the bound of the last order but one, where it is to be reached, too.
    """

    dimensions: tuple[int, ...]
    total: int
    last: Bound
    before: Bound | None
    place: Place

    @property
    def dimension(self) -> int:
        """Dimension of the observable space, at most."""
        return self.dimensions[-1]

    def at(self, equations: Equations, place: Place, seed: int) -> Growth | None:
        """Return the growth with what is proven of it at a real place; None where derivatives have no value there."""
        order = len(self.dimensions) - 1
        experiments = Experiments(equations, place, order, seed=seed)
        try:
            rank = experiments.rank(order, most=self.last)
            if rank.decided and self.before and rank.null_space.shape[1]:
                # that the last order adds nothing is proven of the true space if the one before is as large
                rank = replace(rank, decided=experiments.rank(order - 1, most=self.before).decided)
        except NoValueError:
            return None
        return Growth(self.dimensions, self.total, rank, place, equations.is_rational)


def growth_modulo(equations: Equations, seed: int, places: Callable[[int], Place] | None = None) -> Bounds:
    """Return the growth at a random place modulo the prime; places: those to take by attempt (None: anywhere)."""
    for attempt in range(_SEEDS):
        place = places(seed + attempt) if places else residue_place(equations, seed + attempt)
        try:
            return _grown(equations, place, seed + attempt)
        except ZeroDivisionError:
            continue
    raise InputError("no random point was found that is no pole of some function: give a point")


def _grown(equations: Equations, place: Place, seed: int) -> Bounds:
    dimensions: list[int] = []
    last = 0
    for orders in _orders(equations):
        experiments = Experiments(equations, place, orders, seed=seed)
        for order in range(len(dimensions), orders + 1):
            dimensions.append(experiments.dimension(order))
            total = experiments.total(order)
            if dimensions[-1] == equations.asked or (order > 0 and total == last):
                differences = bool(equations.unknown) and not equations.is_rational and order > 0
                before = experiments.bound(order - 1) if differences else None
                return Bounds(tuple(dimensions), total, experiments.bound(order), before, place)
            last = total
    raise AssertionError("the observable space grew more often than it has dimensions")


def _orders(equations: Equations) -> Iterator[int]:
    """Yield 2, 4, 8, ..., n + 1: by then the growth has ended."""
    limit = equations.n + 1
    orders = 2
    while orders < limit:
        yield orders
        orders *= 2
    yield limit
