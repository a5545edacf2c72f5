"""What is still undecided, as layers of steps: every walk through them is a schedule."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from obsdesign.conic import smat, svec
from obsdesign.selection.dual import Dual
from obsdesign.selection.pricing.abstract import AbstractSeparateSchedules
from obsdesign.selection.pricing.dwell_chain import DwellChain
from obsdesign.selection.problem import SelectionProblem

_MAX_LAYERS = 1500  # undecided segments, and ...
_MARGIN_FACTOR = 1.0 + 1e-9  # times the largest regret that is allowed: rounding does not shut out the segment that sets it
_MAX_STEPS = 60_000  # ... choices in them, beyond which walking through them is hopeless


@dataclass(frozen=True, eq=False)
class Layer:
    """The steps of a segment, sorted by source: from state source (A,) to target (A,), with what each adds (A, c).

    offsets (states+1,): where the steps of each source begin; patterns (A, S) bool: which sensors a step has on.
    """

    source: np.ndarray
    target: np.ndarray
    increments: np.ndarray
    offsets: np.ndarray
    segment: int
    patterns: np.ndarray


@dataclass(frozen=True, eq=False)
class ReducedProblem:
    """base (c,): what the decided segments add up to; chosen (K, S): their schedule; the layers of the others; the first of the states.

    What is added up (c entries): W as vectors, one for each scenario of loss (R d), usage of resources, and what switching takes off.
    is_linked: the layers have to be taken in their order, from state to state; else all states are 0 and any order will do.
    layers_taken, completion_cache: how many layers have been taken, and what lies ahead of each under the duals met so far, where they are
    linked.
    """

    base: np.ndarray
    chosen: np.ndarray
    layers: tuple[Layer, ...]
    initial_state: int
    state_count: int
    is_linked: bool
    layers_taken: int = 0
    completion_cache: dict[Dual, list[np.ndarray]] = field(default_factory=dict, repr=False)

    def without(self, index: int) -> ReducedProblem:
        """Return the problem that is left when a layer has been decided."""
        layers = self.layers[:index] + self.layers[index + 1 :]
        return ReducedProblem(
            self.base,
            self.chosen,
            layers,
            self.initial_state,
            self.state_count,
            self.is_linked,
            self.layers_taken + 1,
            self.completion_cache,
        )

    def completion_bounds(self, duals: tuple[Dual, ...], Y: np.ndarray) -> np.ndarray:
        """Return the best sum over the layers (states, J) under each of the duals, as prices Y (c, J)."""
        if not self.is_linked:
            return self.layer_maxima(Y).sum(axis=0, keepdims=True)
        for dual, y in zip(duals, Y.T, strict=True):
            if dual not in self.completion_cache:  # from here to the end, for all that begins here
                self.completion_cache[dual] = [np.empty(0)] * self.layers_taken + self.backward_sums(y[:, None])
        return np.concatenate([self.completion_cache[dual][self.layers_taken] for dual in duals], axis=1)

    def layer_maxima(self, Y: np.ndarray) -> np.ndarray:
        """Return the best step of each layer (layers, J) where any order will do."""
        if not self.layers:
            return np.zeros((0, Y.shape[1]))
        return np.maximum.reduceat(self._step_increments @ Y, self._layer_offsets, axis=0)

    def best_path(self, y: np.ndarray, state: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the steps (layers,) of the best walk from a state under prices y (c,), and what they add (c,)."""
        if not self.layers:
            return np.zeros(0, dtype=int), np.zeros(len(self.base))
        if not self.is_linked:
            padded = np.where(self._step_table >= 0, (self._step_increments @ y)[self._step_table], -np.inf)
            steps = padded.argmax(axis=1)
            return steps, self._step_increments[self._layer_offsets + steps].sum(axis=0)
        completion = self.backward_sums(y[:, None])
        steps = np.empty(len(self.layers), dtype=int)
        for i, layer in enumerate(self.layers):
            step_range = slice(layer.offsets[state], layer.offsets[state + 1])
            steps[i] = step_range.start + (layer.increments[step_range] @ y + completion[i + 1][layer.target[step_range], 0]).argmax()
            state = int(layer.target[steps[i]])
        return steps, np.sum([layer.increments[step] for layer, step in zip(self.layers, steps, strict=True)], axis=0)

    def backward_sums(self, Y: np.ndarray) -> list[np.ndarray]:
        """Return the best sum from every layer on (states, J) under prices Y (c, J), layer by layer, 0 after the last."""
        sums_by_layer = [np.zeros((self.state_count, Y.shape[1]))]
        for layer in reversed(self.layers):
            total = layer.increments @ Y + sums_by_layer[-1][layer.target]
            best = np.full((self.state_count, Y.shape[1]), -np.inf)
            has_steps = layer.offsets[1:] > layer.offsets[:-1]  # a state without steps leads nowhere
            if has_steps.any():
                best[has_steps] = np.maximum.reduceat(total, layer.offsets[:-1][has_steps], axis=0)
            sums_by_layer.append(best)
        return sums_by_layer[::-1]

    @cached_property
    def _step_increments(self) -> np.ndarray:
        return np.concatenate([layer.increments for layer in self.layers])

    @cached_property
    def _layer_offsets(self) -> np.ndarray:
        return np.cumsum([0, *(len(layer.increments) for layer in self.layers[:-1])])

    @cached_property
    def _step_table(self) -> np.ndarray:
        """Where the steps of each layer are, (layers, most), -1 = nowhere."""
        counts = np.array([len(layer.increments) for layer in self.layers])
        positions = np.arange(counts.max())
        return np.where(positions < counts[:, None], self._layer_offsets[:, None] + positions, -1)


def reduce_problem(instance: SelectionProblem, duals: list[tuple[Dual, float]], cutoff_value: float) -> ReducedProblem | None:
    """Return the schedules whose bounds under all of the duals are above `cutoff_value`; None where there are too many to list.

    Reduced-cost fixing: forcing a choice lowers UB(dual) by its regret; where that falls to `cutoff_value`, no better schedule has it.
    """
    if isinstance(instance.schedules, AbstractSeparateSchedules):
        return _reduce_separate(instance, instance.schedules, duals, cutoff_value)
    if isinstance(instance.schedules, DwellChain):
        return _reduce_linked(instance, instance.schedules, duals, cutoff_value)
    raise TypeError(f"schedules are {type(instance.schedules).__name__}: must be separate segments or a chain of them")


def neighbourhood_problem(
    instance: SelectionProblem, dual: Dual, bound: float, segment_count: int, cutoff_value: float
) -> ReducedProblem | None:
    """Return the schedules that differ from the best one for a dual where that costs least: in about `segment_count` segments."""
    price, start = instance.prices(dual)
    best, _ = instance.schedules.maximise(price, start)
    on, off = instance.schedules.forcing_costs(price, start)
    margin = np.where(best, off, on).min(axis=1)
    radius = float(np.partition(margin, segment_count - 1)[segment_count - 1]) if len(margin) > segment_count else float(margin.max())
    return reduce_problem(instance, [(dual, bound)], max(bound - _MARGIN_FACTOR * radius, cutoff_value))


def _reduce_separate(
    instance: SelectionProblem, schedules: AbstractSeparateSchedules, duals: list[tuple[Dual, float]], cutoff_value: float
) -> ReducedProblem | None:
    can_be_on, can_be_off = np.ones((2, *instance.shape), dtype=bool)
    price_tests = []
    for dual, upper_bound in duals:
        price, start = instance.prices(dual)
        on, off = schedules.forcing_costs(price, start)
        can_be_on &= upper_bound - on > cutoff_value
        can_be_off &= upper_bound - off > cutoff_value
        price_tests.append((price, (price * schedules.maximise(price, start)[0]).sum(axis=1), upper_bound))
    undecided = np.flatnonzero((can_be_on == can_be_off).any(axis=1))
    if len(undecided) > _MAX_LAYERS:
        return None
    chosen = can_be_on & ~can_be_off
    chosen[undecided] = False
    layers = []
    for k in undecided.tolist():
        patterns = schedules.feasible_patterns(k, can_be_on[k], can_be_off[k], idle=bool(instance.resources))
        if patterns is None:
            return None
        for price, best, upper_bound in price_tests:
            patterns = patterns[upper_bound - (best[k] - patterns @ price[k]) > cutoff_value]
        layers.append(make_layer(instance, k, patterns))
    if sum(len(layer.source) for layer in layers) > _MAX_STEPS:
        return None
    base = np.concatenate([svec(instance.information(chosen)).ravel(), instance.usage(chosen), [0.0]])
    return ReducedProblem(base, chosen, tuple(layers), 0, 1, is_linked=False)


def make_layer(instance: SelectionProblem, k: int, patterns: np.ndarray) -> Layer:
    """Return the patterns (A, S) of a segment that does not depend on others."""
    no_state = np.zeros(len(patterns), dtype=int)
    return Layer(no_state, no_state, _increments_of(instance, k, patterns), np.array([0, len(patterns)]), k, patterns)


def _increments_of(instance: SelectionProblem, k: int, patterns: np.ndarray) -> np.ndarray:
    """What the patterns (A, S) of a segment add (A, c), save for what switching on takes."""
    W = [(patterns * working) @ instance.block_vectors[k] for working in instance.working_sensors]
    usage = [patterns @ resource.usage[k] for resource in instance.resources]
    return np.column_stack([*W, *usage, np.zeros(len(patterns))])


def _reduce_linked(
    instance: SelectionProblem, chain: DwellChain, duals: list[tuple[Dual, float]], cutoff_value: float
) -> ReducedProblem | None:
    allowed = np.ones((instance.shape[0], *chain.transitions.shape), dtype=bool)
    for dual, _ in duals:
        allowed &= instance.base_bound(dual) + chain.best_through(*instance.prices(dual)) > cutoff_value
    if allowed.sum() > _MAX_STEPS:
        return None
    starts = np.stack(
        [chain.switch_ons @ start for start in [*(resource.start for resource in instance.resources), instance.switching]], axis=-1
    )
    layers = []
    for k in range(len(allowed)):
        source, pattern = np.nonzero(allowed[k])
        increments = _increments_of(instance, k, chain.patterns)[pattern]
        increments[:, increments.shape[1] - starts.shape[2] :] += starts[source, pattern]
        begin = np.searchsorted(source, np.arange(chain.state_count + 2))
        layers.append(Layer(source, chain.transitions[source, pattern], increments, begin, k, chain.patterns[pattern]))
    chosen = np.zeros(instance.shape, dtype=bool)
    base = np.zeros(layers[0].increments.shape[1])
    base[: svec(instance.known_information).size * len(instance.working_sensors)] = np.tile(
        svec(instance.known_information), len(instance.working_sensors)
    )
    return _merge_single_steps(ReducedProblem(base, chosen, tuple(layers), 0, chain.state_count + 1, is_linked=True))


def _merge_single_steps(reduced: ReducedProblem) -> ReducedProblem:
    """Take what has only one step for decided."""
    base, chosen, first, layers = reduced.base.copy(), reduced.chosen.copy(), reduced.initial_state, []
    for layer in reduced.layers:
        if len(layer.source) != 1:
            layers.append(layer)
            continue
        base += layer.increments[0]
        chosen[layer.segment] = layer.patterns[0]
        if layers:
            layers[-1] = _redirect(layers[-1], int(layer.source[0]), int(layer.target[0]))
        else:
            first = int(layer.target[0])
    return ReducedProblem(base, chosen, tuple(layers), first, reduced.state_count, is_linked=True)


def _redirect(layer: Layer, gate: int, target: int) -> Layer:
    """Keep the steps that lead to the gate, and let them lead beyond it."""
    leads_to_gate = layer.target == gate
    source = layer.source[leads_to_gate]
    begin = np.searchsorted(source, np.arange(len(layer.offsets)))
    return Layer(source, np.full(len(source), target), layer.increments[leads_to_gate], begin, layer.segment, layer.patterns[leads_to_gate])


def information_of_sums(instance: SelectionProblem, sums: np.ndarray) -> np.ndarray:
    """Return W (..., R, n, n) of what is added up (..., c)."""
    R, d = len(instance.working_sensors), instance.block_vectors.shape[2]
    return smat(sums[..., : R * d].reshape(*sums.shape[:-1], R, d), instance.n)


def price_vector(dual: Dual) -> np.ndarray:
    """Return the prices (c,) of what is added up."""
    return np.concatenate([svec(dual.Z).ravel(), -dual.mu, [-1.0]])
