"""What is still undecided, as layers of steps: every walk through them is a schedule."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from obsdesign.selection.pricing.abstract import AbstractSeparate
from obsdesign.selection.pricing.dwell_chain import Chain
from obsdesign.selection.problem import Instance, matrices, vectors
from obsdesign.selection.relaxation.dual import Dual

_MOST_LAYERS = 1500  # undecided segments, and ...
_REACH = 1.0 + 1e-9  # times the largest regret that is allowed: rounding does not shut out the segment that sets it
_MOST_STEPS = 60_000  # ... choices in them, beyond which walking through them is hopeless


@dataclass(frozen=True, eq=False)
class Layer:
    """The steps of a segment, sorted by source: from state source (A,) to target (A,), with what each adds (A, c).

    begin (states+1,): where the steps of each source begin; patterns (A, S) bool: which sensors a step has on.
    """

    source: np.ndarray
    target: np.ndarray
    adds: np.ndarray
    begin: np.ndarray
    segment: int
    patterns: np.ndarray


@dataclass(frozen=True, eq=False)
class Walks:
    """base (c,): what the decided segments add up to; chosen (K, S): their schedule; the layers of the others; the first of the states.

    What is added up (c entries): W as vectors, one for each scenario of loss (R d), usage of resources, and what switching takes off.
    linked: the layers have to be taken in their order, from state to state; else all states are 0 and any order will do.
    past, known: how many layers have been taken, and what lies ahead of each under the duals met so far, where they are linked.
    """

    base: np.ndarray
    chosen: np.ndarray
    layers: tuple[Layer, ...]
    first: int
    states: int
    linked: bool
    past: int = 0
    known: dict[Dual, list[np.ndarray]] = field(default_factory=dict, repr=False)

    def without(self, index: int) -> Walks:
        """Return the walks that are left when a layer has been taken."""
        layers = self.layers[:index] + self.layers[index + 1 :]
        return Walks(self.base, self.chosen, layers, self.first, self.states, self.linked, self.past + 1, self.known)

    def ahead(self, duals: tuple[Dual, ...], Y: np.ndarray) -> np.ndarray:
        """Return the best sum over the layers (states, J) under each of the duals, as prices Y (c, J)."""
        if not self.linked:
            return self.tops(Y).sum(axis=0, keepdims=True)
        for dual, y in zip(duals, Y.T, strict=True):
            if dual not in self.known:  # from here to the end, for all that begins here
                self.known[dual] = [np.empty(0)] * self.past + self.backward(y[:, None])
        return np.concatenate([self.known[dual][self.past] for dual in duals], axis=1)

    def tops(self, Y: np.ndarray) -> np.ndarray:
        """Return the best step of each layer (layers, J) where any order will do."""
        if not self.layers:
            return np.zeros((0, Y.shape[1]))
        return np.maximum.reduceat(self._steps @ Y, self._ends, axis=0)

    def best(self, y: np.ndarray, state: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the steps (layers,) of the best walk from a state under prices y (c,), and what they add (c,)."""
        if not self.layers:
            return np.zeros(0, dtype=int), np.zeros(len(self.base))
        if not self.linked:
            padded = np.where(self._padding >= 0, (self._steps @ y)[self._padding], -np.inf)
            steps = padded.argmax(axis=1)
            return steps, self._steps[self._ends + steps].sum(axis=0)
        ahead = self.backward(y[:, None])
        steps = np.empty(len(self.layers), dtype=int)
        for i, layer in enumerate(self.layers):
            part = slice(layer.begin[state], layer.begin[state + 1])
            steps[i] = part.start + (layer.adds[part] @ y + ahead[i + 1][layer.target[part], 0]).argmax()
            state = int(layer.target[steps[i]])
        return steps, np.sum([layer.adds[step] for layer, step in zip(self.layers, steps, strict=True)], axis=0)

    def backward(self, Y: np.ndarray) -> list[np.ndarray]:
        """Return the best sum from every layer on (states, J) under prices Y (c, J), layer by layer, 0 after the last."""
        found = [np.zeros((self.states, Y.shape[1]))]
        for layer in reversed(self.layers):
            total = layer.adds @ Y + found[-1][layer.target]
            best = np.full((self.states, Y.shape[1]), -np.inf)
            filled = layer.begin[1:] > layer.begin[:-1]  # a state without steps leads nowhere
            if filled.any():
                best[filled] = np.maximum.reduceat(total, layer.begin[:-1][filled], axis=0)
            found.append(best)
        return found[::-1]

    @cached_property
    def _steps(self) -> np.ndarray:
        return np.concatenate([layer.adds for layer in self.layers])

    @cached_property
    def _ends(self) -> np.ndarray:
        return np.cumsum([0, *(len(layer.adds) for layer in self.layers[:-1])])

    @cached_property
    def _padding(self) -> np.ndarray:
        """Where the steps of each layer are, (layers, most), -1 = nowhere."""
        counts = np.array([len(layer.adds) for layer in self.layers])
        places = np.arange(counts.max())
        return np.where(places < counts[:, None], self._ends[:, None] + places, -1)


def walks_of(instance: Instance, duals: list[tuple[Dual, float]], least: float) -> Walks | None:
    """Return the schedules whose bounds under all of the duals are above `least`; None where there are too many to list.

    Reduced-cost fixing: forcing a choice lowers UB(dual) by its regret; where that falls to `least`, no better schedule has it.
    """
    if isinstance(instance.schedules, AbstractSeparate):
        return _separate(instance, instance.schedules, duals, least)
    if isinstance(instance.schedules, Chain):
        return _linked(instance, instance.schedules, duals, least)
    raise TypeError(f"schedules are {type(instance.schedules).__name__}: must be separate segments or a chain of them")


def nearby(instance: Instance, dual: Dual, bound: float, count: int, least: float) -> Walks | None:
    """Return the schedules that differ from the best one for a dual where that costs least: in about `count` segments."""
    price, start = instance.prices(dual)
    best, _ = instance.schedules.best(price, start)
    on, off = instance.schedules.regrets(price, start)
    margin = np.where(best, off, on).min(axis=1)
    reach = float(np.partition(margin, count - 1)[count - 1]) if len(margin) > count else float(margin.max())
    return walks_of(instance, [(dual, bound)], max(bound - _REACH * reach, least))


def _separate(instance: Instance, schedules: AbstractSeparate, duals: list[tuple[Dual, float]], least: float) -> Walks | None:
    can_be_on, can_be_off = np.ones((2, *instance.shape), dtype=bool)
    priced = []
    for dual, above in duals:
        price, start = instance.prices(dual)
        on, off = schedules.regrets(price, start)
        can_be_on &= above - on > least
        can_be_off &= above - off > least
        priced.append((price, (price * schedules.best(price, start)[0]).sum(axis=1), above))
    undecided = np.flatnonzero((can_be_on == can_be_off).any(axis=1))
    if len(undecided) > _MOST_LAYERS:
        return None
    chosen = can_be_on & ~can_be_off
    chosen[undecided] = False
    layers = []
    for k in undecided.tolist():
        patterns = schedules.options(k, can_be_on[k], can_be_off[k], idle=bool(instance.resources))
        if patterns is None:
            return None
        for price, best, above in priced:
            patterns = patterns[above - (best[k] - patterns @ price[k]) > least]
        layers.append(layer_of(instance, k, patterns))
    if sum(len(layer.source) for layer in layers) > _MOST_STEPS:
        return None
    base = np.concatenate([vectors(instance.information(chosen)).ravel(), instance.usage(chosen), [0.0]])
    return Walks(base, chosen, tuple(layers), 0, 1, linked=False)


def layer_of(instance: Instance, k: int, patterns: np.ndarray) -> Layer:
    """Return the patterns (A, S) of a segment that does not depend on others."""
    nowhere = np.zeros(len(patterns), dtype=int)
    return Layer(nowhere, nowhere, _adds(instance, k, patterns), np.array([0, len(patterns)]), k, patterns)


def _adds(instance: Instance, k: int, patterns: np.ndarray) -> np.ndarray:
    """What the patterns (A, S) of a segment add (A, c), save for what switching on takes."""
    W = [(patterns * kept) @ instance.rows[k] for kept in instance.kept]
    usage = [patterns @ resource.usage[k] for resource in instance.resources]
    return np.column_stack([*W, *usage, np.zeros(len(patterns))])


def _linked(instance: Instance, chain: Chain, duals: list[tuple[Dual, float]], least: float) -> Walks | None:
    allowed = np.ones((instance.shape[0], *chain.following.shape), dtype=bool)
    for dual, _ in duals:
        allowed &= instance.ground(dual) + chain.through(*instance.prices(dual)) > least
    if allowed.sum() > _MOST_STEPS:
        return None
    starts = np.stack([chain.starts @ start for start in [*(each.start for each in instance.resources), instance.switching]], axis=-1)
    layers = []
    for k in range(len(allowed)):
        source, pattern = np.nonzero(allowed[k])
        adds = _adds(instance, k, chain.patterns)[pattern]
        adds[:, adds.shape[1] - starts.shape[2] :] += starts[source, pattern]
        begin = np.searchsorted(source, np.arange(chain.count + 2))
        layers.append(Layer(source, chain.following[source, pattern], adds, begin, k, chain.patterns[pattern]))
    chosen = np.zeros(instance.shape, dtype=bool)
    base = np.zeros(layers[0].adds.shape[1])
    base[: vectors(instance.known).size * len(instance.kept)] = np.tile(vectors(instance.known), len(instance.kept))
    return _merged(Walks(base, chosen, tuple(layers), 0, chain.count + 1, linked=True))


def _merged(walks: Walks) -> Walks:
    """Take what has only one step for decided."""
    base, chosen, first, layers = walks.base.copy(), walks.chosen.copy(), walks.first, []
    for layer in walks.layers:
        if len(layer.source) != 1:
            layers.append(layer)
            continue
        base += layer.adds[0]
        chosen[layer.segment] = layer.patterns[0]
        if layers:
            layers[-1] = _redirected(layers[-1], int(layer.source[0]), int(layer.target[0]))
        else:
            first = int(layer.target[0])
    return Walks(base, chosen, tuple(layers), first, walks.states, linked=True)


def _redirected(layer: Layer, gate: int, target: int) -> Layer:
    """Keep the steps that lead to the gate, and let them lead beyond it."""
    stays = layer.target == gate
    source = layer.source[stays]
    begin = np.searchsorted(source, np.arange(len(layer.begin)))
    return Layer(source, np.full(len(source), target), layer.adds[stays], begin, layer.segment, layer.patterns[stays])


def information_in(instance: Instance, sums: np.ndarray) -> np.ndarray:
    """Return W (..., R, n, n) of what is added up (..., c)."""
    R, d = len(instance.kept), instance.rows.shape[2]
    return matrices(sums[..., : R * d].reshape(*sums.shape[:-1], R, d), instance.n)


def price_vector(dual: Dual) -> np.ndarray:
    """Return the prices (c,) of what is added up."""
    return np.concatenate([vectors(dual.Z).ravel(), -dual.mu, [-1.0]])
