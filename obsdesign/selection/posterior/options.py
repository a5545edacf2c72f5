"""What may be on in each segment, and what may follow it: the rules as nodes of a chain."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from obsdesign.rules.abstract import AbstractRule, Resource, Segments
from obsdesign.selection.build import patterns_up_to
from obsdesign.selection.pricing.dwell_chain import DwellChain
from obsdesign.selection.problem import switch_ons, switching_prices


@dataclass(frozen=True, eq=False)
class Options:
    """A schedule is a walk through A nodes, one per segment: a pattern of sensors and how long each still has to stay on.

    patterns (P, S) bool; pattern_of_node (A,); allowed (K, A) bool; follows (A, A) bool, from row to column; may_start (A,) bool;
    on_before (S,) bool: what was on before the first segment; switching (S,): what each switching-on costs; resources: what is
    limited in sum.
    """

    patterns: np.ndarray
    pattern_of_node: np.ndarray
    allowed: np.ndarray
    follows: np.ndarray
    may_start: np.ndarray
    on_before: np.ndarray
    switching: np.ndarray
    resources: tuple[Resource, ...]

    @property
    def segments(self) -> int:
        """K."""
        return len(self.allowed)

    @cached_property
    def switching_costs(self) -> np.ndarray:
        """What a step from node to node costs (A + 1, A), the first step in the last row."""
        return self._of_switch_ons(self.switching)

    @cached_property
    def usage(self) -> np.ndarray:
        """How much a node takes of each resource in each segment (R, K, A), its switching-ons left out."""
        on = self._is_on.astype(float)
        return np.array([resource.usage @ on.T for resource in self.resources]).reshape(-1, *self.allowed.shape)

    def switching_of(self, chosen: np.ndarray) -> float:
        """Return what the switching-ons of a schedule (K, S) cost, whether it keeps the rules or not."""
        return float(switch_ons(chosen, self.on_before).sum(axis=0) @ self.switching)

    @property
    def _is_on(self) -> np.ndarray:
        return self.patterns[self.pattern_of_node]

    def _of_switch_ons(self, cost: np.ndarray) -> np.ndarray:
        """Return what steps (A + 1, A) take that take so much (S,) for each sensor that they switch on."""
        return (~np.vstack([self._is_on, self.on_before]) * cost) @ self._is_on.T

    @cached_property
    def start_usage(self) -> np.ndarray:
        """How much a step takes of each resource for what it switches on (R, A + 1, A)."""
        return np.array([self._of_switch_ons(resource.start) for resource in self.resources]).reshape(-1, *self.switching_costs.shape)

    @cached_property
    def limits(self) -> np.ndarray:
        """Limits of the resources (R,), with what rounding may add to a sum."""
        limits = np.array([resource.limit for resource in self.resources])
        return limits + 1e-9 * np.maximum(1.0, np.abs(limits))

    @property
    def is_linked(self) -> bool:
        """Whether a segment's choice bears on others but for what the filter knows."""
        return bool(len(self.resources) or self.switching.any() or not self.follows.all())

    @property
    def may_be_on(self) -> np.ndarray:
        """Which sensors are on under any choice (K, S)."""
        return (self.allowed.astype(float) @ self._is_on) > 0

    def chosen(self, nodes: np.ndarray) -> np.ndarray:
        """Return the schedule (K, S) of a walk (K,)."""
        return self.patterns[self.pattern_of_node[nodes]]

    def nodes_of(self, chosen: np.ndarray) -> np.ndarray | None:
        """Return a walk (K,) that is a schedule (K, S), whether its sensors are allowed or not; None where none follows the chain."""
        fits = (self._is_on[None] == chosen[:, None, :]).all(axis=2)
        reached = [fits[0] & self.may_start]
        for fit in fits[1:]:
            reached.append(fit & self.follows[reached[-1]].any(axis=0))
        if not reached[-1].any():
            return None
        nodes = [int(np.flatnonzero(reached[-1])[0])]
        for before in reached[-2::-1]:
            nodes.append(int(np.flatnonzero(before & self.follows[:, nodes[-1]])[0]))
        return np.array(nodes[::-1])


def build_options(
    rules: tuple[AbstractRule, ...], per_segment: int, segments: Segments, answers: np.ndarray | None, on_before: np.ndarray | None = None
) -> Options:
    """Return the options of rules; answers (K, S) bool: which sensors have a sample at all in a segment; on_before (S,): what was on.

    answers None: being on costs something, so that no option is left out.

    Where segments are free of each other, an option that has fewer samples than another allowed one is left out: it is never better.
    Raises InputError for rules that do not fit the segments.
    """
    terms = [rule.terms(segments) for rule in rules]
    S = len(segments.names)
    masks = [term.available for term in terms if term.available is not None]
    available = np.logical_and.reduce(masks) if masks else np.ones((segments.count, S), dtype=bool)
    patterns = patterns_up_to(S, per_segment)
    for term in terms:
        if term.admissible is not None:
            patterns = patterns[term.admissible(patterns)]
    dwell = np.max([np.ones(S, dtype=int), *(term.dwell for term in terms if term.dwell is not None)], axis=0)
    switching = switching_prices(terms, S)
    resources = tuple(term.resource for term in terms if term.resource is not None)
    chain = DwellChain(available, patterns, dwell)
    is_free = not (resources or switching.any() or (dwell > 1).any())
    return _options_of(chain, switching, resources, answers if is_free else None, on_before)


def _options_of(
    chain: DwellChain, switching: np.ndarray, resources: tuple[Resource, ...], answers: np.ndarray | None, on_before: np.ndarray | None
) -> Options:
    patterns, transitions, count = chain.patterns, chain.transitions, len(chain.states)
    follows = np.zeros((count, count + 1), dtype=bool)
    follows[np.arange(count)[:, None], transitions] = True
    pattern_of_node = _index_of_rows(chain.states >= 0, patterns)
    nodes = np.flatnonzero(pattern_of_node >= 0)  # nothing on may be no pattern of the rules
    states, pattern_of_node, follows = chain.states[nodes], pattern_of_node[nodes], follows[np.ix_(nodes, nodes)]
    is_on, before = states >= 0, np.zeros(states.shape[1], dtype=bool) if on_before is None else on_before
    may_start = (np.where(before, 0, chain.dwell - 1) == states).astype(bool) | ~is_on  # what was on before has been on for long enough
    allowed_patterns = np.asarray(~(patterns[None] & ~chain.available[:, None, :]).any(axis=2))
    if answers is not None:
        allowed_patterns = _undominated(patterns, allowed_patterns, answers)
    return Options(
        patterns, pattern_of_node, allowed_patterns[:, pattern_of_node], follows, may_start.all(axis=1), before, switching, resources
    )


def _index_of_rows(rows: np.ndarray, table: np.ndarray) -> np.ndarray:
    """Return the place of each of some rows in a table, -1 for those that it does not have."""
    index = {row.tobytes(): i for i, row in enumerate(table)}
    return np.array([index.get(row.tobytes(), -1) for row in np.ascontiguousarray(rows)])


def _undominated(patterns: np.ndarray, allowed: np.ndarray, answers: np.ndarray) -> np.ndarray:
    """Return allowed (K, P) without patterns whose samples are all among another one's; of equals, the one with fewest sensors stays."""
    kept = np.zeros_like(allowed)
    cache: dict[bytes, np.ndarray] = {}
    for k, (is_allowed, is_answering) in enumerate(zip(allowed, answers, strict=True)):
        key = is_allowed.tobytes() + is_answering.tobytes()
        if key not in cache:
            cache[key] = _undominated_in_segment(patterns, is_allowed, is_answering)
        kept[k] = cache[key]
    return kept


def _undominated_in_segment(patterns: np.ndarray, is_allowed: np.ndarray, is_answering: np.ndarray) -> np.ndarray:
    candidates = np.flatnonzero(is_allowed)
    effective = (patterns[candidates] & is_answering).astype(float)
    is_subset = effective @ (1 - effective).T == 0  # row's samples are all among column's
    size = patterns[candidates].sum(axis=1)
    order = np.arange(len(candidates))
    is_equal = is_subset & is_subset.T
    is_preferred = (size[None] < size[:, None]) | ((size[None] == size[:, None]) & (order[None] < order[:, None]))
    is_dominated = ((is_subset & ~is_equal) | (is_equal & is_preferred)).any(axis=1)
    kept = np.zeros(len(patterns), dtype=bool)
    kept[candidates[~is_dominated]] = True
    return kept
