"""The observability rank condition for known inputs (Hermann and Krener), decided in ball arithmetic."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from numbers import Real
from typing import Literal

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from obsdesign.analysis.hidden import hidden_in_words
from obsdesign.analysis.verdict import Verdict
from obsdesign.calculus import lie_derivative
from obsdesign.checks import require_count
from obsdesign.errors import InputError
from obsdesign.rank import PRECISIONS, NoValueError, Rank, as_rational, rank_at, symbolise
from obsdesign.system import AbstractSystem, Model

ORDERS, NODES = 12, 4_000
"""At a point: no order of Lie derivatives is begun above this, or once the graph of all words has more nodes than this."""
NEARLY_SINGULAR = 1e-8
"""A pivot below this, relative to the scale of its row and column, is called nearly singular."""

Exact = tuple[Fraction, ...]

# Where random points are looked for: inside the domain of sqrt, log, acos and acosh first. Corners are whole numbers.
_BOXES = ((0, 1), (-1, 1), (1, 3), (-3, -1), (-100, 100), (0, 1000))
_DRAWS_PER_BOX = 3
_NEARNESS = (Fraction(1, 2**10), Fraction(1, 2**20), Fraction(1, 2**30))


def observability(  # the public contract
    system: AbstractSystem,
    at: ArrayLike | None = None,
    held: Mapping[str, float] | None = None,
    disturbance: Literal["arbitrary"] = "arbitrary",
    known_inputs: Literal["any"] = "any",
    seed: int = 0,
) -> Verdict:
    """Return what the outputs of the system, all their derivatives and the known inputs tell about the state.

    at: None = at a generic point (drawn from seed), or a state (n,); held: known inputs kept at a value.
    Raises InputError for a system without sensors or with unknown inputs, and for points outside a function's domain.
    """
    if disturbance != "arbitrary":
        raise InputError(f"disturbance is {disturbance!r}: must be 'arbitrary' in this version")
    if known_inputs != "any":
        raise InputError(f"known_inputs is {known_inputs!r}: must be 'any' in this version")
    return observability_of(system.model, at, held, seed)


def observability_of(model: Model, at: ArrayLike | None = None, held: Mapping[str, float] | None = None, seed: int = 0) -> Verdict:
    """Return the verdict for a model, such as some of a system's sensors: `system.model.only(names)`.

    Generically: the outputs and their Lie derivatives along the drift and every known input, of which those are kept that
    raise the rank of the gradients, until a sweep adds none. At a point this may say too little: there the rank of the
    functions kept nearby is taken where it is as large as nearby, else that of all Lie derivatives as far as `ORDERS` and `NODES` go.
    Source: Hermann and Krener 1977; Martinelli, IROS 2017, Algorithm 1.
    """
    _require_answerable(model)
    require_count("seed", seed, least=0)
    model = model.holding(_as_held(held or {}))
    outputs = _outputs(model)
    if at is None:
        return _verdict(model, _generic(outputs, _draws(len(model.states), seed)))
    point = _as_point(model, at)
    outputs.require_value(point)
    outputs.rank(point)
    nearby = _generic(outputs, _draws_near(point, seed))
    return _verdict(model, _at_point(outputs, nearby, point))


@dataclass(frozen=True, eq=False)
class _Words:
    """Lie derivatives of a model's outputs: functions (k, 1), for each its output and how often it was derived.

    fields: (n, 1) each, those that vanish left out; constants (c, 1): symbols for the numbers in all of these, with their values.
    """

    x: ca.SX
    names: tuple[str, ...]
    constants: ca.SX
    values: Exact
    fields: tuple[ca.SX, ...]
    functions: ca.SX
    origins: tuple[str, ...]
    orders: tuple[int, ...]

    def rank(self, point: Exact) -> Rank:
        """Return the rank of the gradients at the point; raise NoValueError, naming the function that has none."""
        gradients = ca.cse(ca.jacobian(self.functions, self.x))
        labels = [
            f"the gradient of output {origin!r}" if order == 0 else f"the gradient of Lie derivative {order} of output {origin!r}"
            for origin, order in zip(self.origins, self.orders, strict=True)
        ]
        return self._rank_of(gradients, point, labels, self.orders)

    def require_value(self, point: Exact) -> None:
        """Raise NoValueError unless the words and the fields have a value at the point: then a column of them has a rank."""
        rates = [f"the rate of {name}" for _ in self.fields for name in self.names]
        outputs = [f"output {origin!r}" for origin in self.origins]
        self._rank_of(ca.vertcat(self.functions, *self.fields), point, outputs + rates)

    def _rank_of(self, matrix: ca.SX, point: Exact, labels: Sequence[str], stages: Sequence[int] | None = None) -> Rank:
        function = ca.Function("matrix", [self.x, self.constants], [matrix])
        try:
            return rank_at(function, (point, self.values), stages)
        except NoValueError as error:
            where = ", ".join(f"{name} = {float(value):g}" for name, value in zip(self.names, point, strict=True))
            raise NoValueError(error.row, f"{labels[error.row]} at {where}") from None

    def picked(self, rows: Sequence[int]) -> _Words:
        """Return some of the words, in the order of rows."""
        return replace(
            self,
            functions=self.functions[list(rows), 0],
            origins=tuple(self.origins[i] for i in rows),
            orders=tuple(self.orders[i] for i in rows),
        )

    def extended(self, rows: Sequence[int]) -> _Words:
        """Return the words and the Lie derivatives of some of them along every field, without repetitions and constants."""
        derived = [lie_derivative(self.functions[list(rows), 0], self.x, field) for field in self.fields]
        every = ca.cse(ca.vertcat(self.functions, *derived))
        first = {every[i].element_hash(): i for i in reversed(range(every.numel()))}
        variable = set(ca.jacobian_sparsity(every, self.x).row())
        words = replace(
            self,
            functions=every,
            origins=self.origins + tuple(self.origins[i] for _ in self.fields for i in rows),
            orders=self.orders + tuple(self.orders[i] + 1 for _ in self.fields for i in rows),
        )
        return words.picked(sorted(variable & set(first.values())))


@dataclass(frozen=True, eq=False)
class _Finding:
    """Words and the rank of their gradients at a point; nearby: the generic rank, where the point was asked for."""

    words: _Words
    rank: Rank
    point: Exact
    stopped_by: str
    nearby: int | None = None

    @property
    def decided(self) -> bool:
        return self.stopped_by not in ("stalled", "precision")

    @property
    def kept(self) -> _Words:
        """The words whose gradients carry the rank."""
        return self.words.picked(sorted(self.rank.rows))

    @property
    def pivot_orders(self) -> tuple[int, ...]:
        return tuple(sorted(self.words.orders[row] for row in self.rank.rows))


def _outputs(model: Model) -> _Words:
    """Return the outputs as words of order 0, with the fields along which they are derived."""
    n, q = model.x.numel(), len(model.outputs)
    graph = symbolise(model.x, ca.vertcat(model.h, ca.vec(ca.horzcat(model.drift, model.B))))
    fields = ca.horzsplit(ca.reshape(graph.expression[q:], n, -1))
    return _Words(
        x=model.x,
        names=model.state_names,
        constants=graph.constants,
        values=graph.values,
        fields=tuple(field for field in fields if not field.is_zero()),
        functions=graph.expression[:q],
        origins=tuple(signal.name for signal in model.outputs),
        orders=(0,) * q,
    )


def _generic(outputs: _Words, draws: Iterator[Exact]) -> _Finding:
    """Return what is found at the first of the points where everything has a value."""
    failure: NoValueError | None = None
    for point in draws:
        try:
            outputs.require_value(point)
            return _closed(outputs, point)
        except NoValueError as error:
            failure = error
    raise InputError(f"no random point was found in the domain of every function ({failure}): give a point")


def _closed(words: _Words, point: Exact) -> _Finding:
    """Add Lie derivatives until a sweep adds nothing, keeping what raises the rank at the generic point."""
    order = 0
    while True:
        rank = words.rank(point)
        finding = _Finding(words, rank, point, "")
        if rank.rank == words.x.numel():
            return replace(finding, stopped_by="full")
        if not rank.decided:
            return replace(finding, stopped_by="precision")
        kept = finding.kept
        if order not in kept.orders:
            return replace(finding, stopped_by="criterion")
        words = kept.extended([row for row, found in enumerate(kept.orders) if found == order])
        order += 1


def _at_point(outputs: _Words, nearby: _Finding, point: Exact) -> _Finding:
    """Return what is found at the point: with the words kept nearby, or with all words where those say too little here."""
    goal = nearby.rank.rank
    finding = _Finding(nearby.kept, nearby.kept.rank(point), point, "cap" if nearby.decided else "precision", goal)
    if finding.rank.rank < goal:
        finding = _all_words(outputs, goal, point)
    if finding.rank.rank == outputs.x.numel():
        return replace(finding, stopped_by="full")
    return finding if finding.rank.decided else replace(finding, stopped_by="precision")


def _all_words(words: _Words, goal: int, point: Exact) -> _Finding:
    """Add all Lie derivatives, order by order, until the rank at the point is the goal, or none are left, or a limit is reached."""
    rank, order = words.rank(point), 0
    while rank.rank < goal:
        last = [row for row, found in enumerate(words.orders) if found == order]
        if not last or order == ORDERS or ca.n_nodes(words.functions) > NODES:
            return _Finding(words, rank, point, "stalled" if last else "criterion", goal)
        words, order = words.extended(last), order + 1
        rank = words.rank(point)
    return _Finding(words, rank, point, "cap", goal)


def _draws(n: int, seed: int) -> Iterator[Exact]:
    """Yield random states (n,) with entries k / 2^20, exact in double precision, from one box after another."""
    generator = np.random.default_rng(seed)
    for low, high in _BOXES:
        for _ in range(_DRAWS_PER_BOX):
            yield tuple(low + (high - low) * Fraction(int(k), 2**20) for k in generator.integers(1, 2**20, n))


def _draws_near(point: Exact, seed: int) -> Iterator[Exact]:
    """Yield random states nearer and nearer to the point: in the same piece of functions that have pieces."""
    generator = np.random.default_rng(seed)
    for radius in _NEARNESS:
        steps = [Fraction(int(k), 2**20) for k in generator.integers(-(2**20), 2**20, len(point))]
        yield tuple(value + (1 + abs(value)) * radius * step for value, step in zip(point, steps, strict=True))


def _verdict(model: Model, finding: _Finding) -> Verdict:
    rank, at = finding.rank, np.array([float(value) for value in finding.point])
    found, n = finding.pivot_orders, len(model.states)
    hidden = hidden_in_words(model, rank.null_space, at)
    seen = [not row.any() for row in rank.null_space]
    return Verdict(
        dimension=rank.rank,
        observable=rank.rank == n,
        observable_states=tuple(name for name, is_seen in zip(model.state_names, seen, strict=True) if is_seen),
        unobservable_states=tuple(name for name, is_seen in zip(model.state_names, seen, strict=True) if not is_seen),
        null_space=rank.null_space,
        hidden=hidden if finding.decided else f"not decided, not seen so far: {hidden}",
        ranks=tuple(sum(order <= step for order in found) for step in range(max(found, default=0) + 1)),
        disturbance="none",
        known_inputs="any",
        at=at,
        stopped_by=finding.stopped_by,
        decided=finding.decided,
        proof=_proof(finding, n),
    )


def _proof(finding: _Finding, n: int) -> str:
    rank, order = finding.rank, max(finding.words.orders, default=0)
    caution = ", nearly singular or badly scaled" * (rank.smallest_pivot < NEARLY_SINGULAR)
    pivot = f"a minor of the gradients excludes 0 in {rank.bits}-bit ball arithmetic (pivots down to {rank.smallest_pivot:.1e}{caution})"
    remainder = f"only balls around 0, up to {rank.largest_remainder:.1e}"
    most = {
        "full": "no more is possible",
        "criterion": f"no more: another sweep of Lie derivatives adds {remainder}",
        "cap": "no more is possible: the generic rank is the same",
        "stalled": f"not decided: Lie derivatives up to order {order} add {remainder} here, but the generic rank is {finding.nearby}",
        "precision": f"not decided: {PRECISIONS[-1]} bits do not tell the rest from 0",
    }
    return f"at least {rank.rank} of {n}{f': {pivot}' if rank.rank else ''}; {most[finding.stopped_by]}"


def _require_answerable(model: Model) -> None:
    if model.unknown_inputs:
        names = ", ".join(signal.name for signal in model.unknown_inputs)
        raise InputError(f"the system has unknown inputs ({names}): systems with unknown inputs are not answered by this version")
    if not model.channels:
        raise InputError("the system has no sensors: nothing can be seen without one")


def _as_held(held: Mapping[str, float]) -> dict[str, float]:
    for name, value in held.items():
        if not (isinstance(value, Real) and math.isfinite(value)):
            raise InputError(f"held: {name} is {value!r}: must be a finite number")
    return {name: float(value) for name, value in held.items()}


def _as_point(model: Model, at: ArrayLike) -> Exact:
    """Return the point as the rationals that were meant, like the constants of the model; raise InputError unless (n,) and finite."""
    try:
        values = np.array(at, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"at is {at!r}: must be {len(model.states)} numbers for {', '.join(model.state_names)}") from None
    if values.shape != (len(model.states),):
        raise InputError(f"at has shape {values.shape}: must be ({len(model.states)},) for {', '.join(model.state_names)}")
    for name, value in zip(model.state_names, values, strict=True):
        if not math.isfinite(value):
            raise InputError(f"at: {name} is {value}: must be finite")
    return tuple(as_rational(float(value)) for value in values)
