"""How far the observable space grows with the order of derivatives, at a generic state: exact, because it ends where it stalls.

Along a generic solution the derivatives of what is known about the state give more, or will never give more: let P_k be the
combinations of (dy, ..., dy^(k)) without a part in the unknown inputs. P_(k+1) contains P_k and the derivatives of those of
its elements that no unknown input enters; if it equals P_k, that is invariant, and P_k is all there ever is. The same space
as the weakly unobservable subspace of the linear time-varying system along the solution leaves over.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import casadi as ca

from obsdesign.analysis.equations import Equations
from obsdesign.analysis.experiments import Experiments
from obsdesign.analysis.places import Place, Surroundings, modular_place
from obsdesign.errors import InputError
from obsdesign.rank.elimination import Rank, first_without_value
from obsdesign.rank.graph import NoValueError

_SEEDS = 5
_Found = tuple[tuple[int, ...], int]  # dimensions by order, the last total


@dataclass(frozen=True, eq=False)
class Growth:
    """dimensions[k]: of the observable space with derivatives up to order k; rank: of the last, in balls, at `place`.

    total: the last dimension with the added states
    decided: False where the precision limit was reached; modular: whether the dimensions were found modulo the prime.
    """

    dimensions: tuple[int, ...]
    total: int
    rank: Rank
    place: Place
    decided: bool
    modular: bool

    @property
    def dimension(self) -> int:
        """Dimension of the observable space."""
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


def generic_growth(equations: Equations, around: Surroundings) -> Growth:
    """Return the growth at the first of the random places where everything has a value."""
    seed = around.seed
    found = _modular_growth(equations, seed) if equations.is_rational and not around.alone else None
    failure: NoValueError | None = None
    undecided: Growth | None = None
    for place in around.places(equations.extra):
        try:
            require_value(equations, place)
            require_one_piece(equations, around, place)
            growth = growth_at(equations, place, seed) if found is None else _confirmed(equations, place, seed, found)
        except NoValueError as error:
            failure = error
            continue
        if growth.decided or found is None:
            return growth
        undecided = undecided or growth
    if undecided:
        return undecided
    raise InputError(f"no random point was found in the domain of every function ({failure}): give a point")


def require_one_piece(equations: Equations, around: Surroundings, place: Place) -> None:
    """Raise NoValueError where a kink may lie between the place and the centre of its surroundings.

    A function with pieces has no value in a box that holds one of its kinks.
    """
    if around.centre is not None and not around.alone and equations.has_pieces:
        require_value(equations, around.box(place))


def growth_at(equations: Equations, place: Place, seed: int) -> Growth:
    """Return the growth at a place that is generic (on its orbit), in balls."""
    dimensions: list[int] = []
    last = -1
    for orders in _orders(equations):
        experiments = Experiments(equations, place, orders, seed=seed)
        for order in range(len(dimensions), orders + 1):
            rank, total = ranks_at(experiments, order, confirmed=False)
            if total.rank == last or rank.rank == equations.asked or not total.decided:
                rank, total = ranks_at(experiments, order, confirmed=True)
            dimensions.append(rank.rank)
            if total.rank == last or rank.rank == equations.asked or not total.decided:
                return Growth(tuple(dimensions), total.rank, rank, place, rank.decided and total.decided, modular=False)
            last = total.rank
    raise AssertionError("the observable space grew more often than it has dimensions")


def ranks_at(experiments: Experiments, order: int, *, confirmed: bool) -> tuple[Rank, Rank]:
    """Return the rank of what is known about the state that is asked for, and about that with the added states."""
    rank = experiments.rank(order, confirmed=confirmed)
    return rank, experiments.total_rank(order, confirmed=confirmed) if experiments.equations.extra else rank


def _modular_growth(equations: Equations, seed: int) -> _Found:
    """Return the dimensions by order, and the last total, at a random place modulo the prime."""
    for attempt in range(_SEEDS):
        try:
            return _dimensions_modulo(equations, modular_place(equations.n, seed + attempt), seed + attempt)
        except ZeroDivisionError:
            continue
    raise InputError("no random point was found that is no pole of some function: give a point")


def _dimensions_modulo(equations: Equations, place: Place, seed: int) -> _Found:
    dimensions: list[int] = []
    last = 0
    for orders in _orders(equations):
        experiments = Experiments(equations, place, orders, seed=seed)
        for order in range(len(dimensions), orders + 1):
            dimensions.append(experiments.dimension(order))
            total = experiments.total(order)
            if dimensions[-1] == equations.asked or (order > 0 and total == last):
                return tuple(dimensions), total
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


def _confirmed(equations: Equations, place: Place, seed: int, found: _Found) -> Growth:
    """Return the growth with its null space at a real place; not decided where balls show another rank there."""
    dimensions, total = found
    order = len(dimensions) - 1
    rank = Experiments(equations, place, order, seed=seed).rank(order, at_least=dimensions[-1])
    return Growth(dimensions, total, rank, place, decided=rank.decided and rank.rank == dimensions[-1], modular=True)
