"""From blocks and rules to a problem that methods work on; what cannot be meant is refused here."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import combinations
from math import comb
from numbers import Integral

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.checks import require_count
from obsdesign.conic import svec
from obsdesign.criteria.abstract import AbstractCriterion
from obsdesign.errors import InputError
from obsdesign.rules.abstract import AbstractRule, Segments, Terms
from obsdesign.selection.pricing.cardinality import CardinalitySchedules
from obsdesign.selection.pricing.dwell_chain import DwellChain
from obsdesign.selection.pricing.patterns import PatternSchedules
from obsdesign.selection.problem import SelectionProblem, switching_prices
from obsdesign.selection.scaled_criterion import ScaledCriterion
from obsdesign.selection.schedule import require_blocks

_MAX_PATTERNS = 50_000  # they are listed, with a byte for each sensor: trades the problems that are accepted for memory and time
_LOWEST, _HIGHEST = 1e-152, 1e154  # what all sensors may know of a state: squares of it, and of 1 over it, are numbers
_NEGLIGIBLE_SHARE = 1e-26  # of what all sensors know of a state: what is less, two doubles do not tell from nothing


def build_problem(
    blocks: np.ndarray,
    per_segment: int,
    rules: tuple[AbstractRule, ...],
    criterion: AbstractCriterion,
    robust_to: int,
    segments: Segments | None,
    *,
    known_information: ArrayLike | None = None,
    about: Sequence[int] | None = None,
) -> SelectionProblem:
    """Return the problem of checked blocks (K, S, n, n), or raise InputError for rules that leave no choice."""
    K, S, n, _ = blocks.shape
    named_segments = segments or Segments(tuple(f"sensor {s}" for s in range(S)), K)
    if (named_segments.count, len(named_segments.names)) != (K, S):
        raise InputError(f"segments has {named_segments.count} segments of {len(named_segments.names)} sensors: the blocks have {K} of {S}")
    known_matrix, judged_states = require_known_information(known_information, n), require_about(about, n)
    if criterion.knowledge is not None:
        raise InputError(f"criterion is {type(criterion).__name__}: its information is no sum over sensors, so no schedule is best for it")
    require_count("robust_to", robust_to, minimum=0, maximum=S - 1)
    terms = [rule.terms(named_segments) for rule in rules]
    schedules = _schedule_set(terms, rules, per_segment, named_segments)
    resources = tuple(term.resource for term in terms if term.resource is not None)
    _require_budget(terms, rules, schedules.available)
    switching = switching_prices(terms, S)
    loss_sets = list(combinations(range(S), robust_to))
    working = np.ones((len(loss_sets), S))
    for mask, lost_sensors in zip(working, loss_sets, strict=True):
        mask[list(lost_sensors)] = 0.0
    D = _units(blocks, schedules.available, known_matrix)
    scale = D[:, None] * D
    rows = svec(blocks)
    rows *= scale[np.tril_indices(n)]
    judge = ScaledCriterion(criterion, D, judged_states)
    return SelectionProblem(np.ascontiguousarray(rows), blocks, n, judge, schedules, resources, switching, working, known_matrix * scale)


def _units(blocks: np.ndarray, available: np.ndarray, known_information: np.ndarray) -> np.ndarray:
    """Powers of two D (n,) with D_i^2 (known + all blocks)_ii about 1, so that scaling by them rounds nothing; 1 for what is unseen."""
    by_sensors = np.einsum("ks,ksi->i", available, np.diagonal(blocks, axis1=2, axis2=3))
    total = np.diag(known_information) + by_sensors
    for i in np.flatnonzero((total > 0) & ~((total >= _LOWEST) & (total <= _HIGHEST))):
        raise InputError(
            f"blocks: all sensors together know {total[i]:.3g} of state {i}: must be 0, or from {_LOWEST:g} to {_HIGHEST:g}; scale them"
        )
    for i in np.flatnonzero((np.diag(known_information) > 0) & (np.diag(known_information) < _NEGLIGIBLE_SHARE * by_sensors)):
        raise InputError(
            f"known: its entry [{i}, {i}] is {known_information[i, i]:.3g}, beside {by_sensors[i]:.3g} of all sensors together: "
            f"must be 0, or at least {_NEGLIGIBLE_SHARE:g} of that"
        )
    return np.exp2(-np.round(np.log2(np.where(total > 0, total, 1.0)) / 2))


def require_about(about: Sequence[int] | None, n: int) -> np.ndarray:
    """Return the indices of the judged states (k,), ascending, None = all of them, or raise InputError."""
    if about is None:
        return np.arange(n)
    given = (about,) if isinstance(about, str) or not isinstance(about, Iterable) else tuple(about)
    whole = all(isinstance(index, Integral) and not isinstance(index, bool) and 0 <= int(index) < n for index in given)
    if not given or not whole or len(set(given)) < len(given):
        raise InputError(f"about is {about!r}: must be different indices of states, whole numbers from 0 to {n - 1}")
    return np.sort(np.array(given, dtype=int))


def require_known_information(information: ArrayLike | None, n: int) -> np.ndarray:
    """Return what is known already (n, n), None = nothing, or raise InputError for what is no information matrix."""
    if information is None:
        return np.zeros((n, n))
    given = np.asarray(information, dtype=float)
    if given.shape != (n, n):
        raise InputError(f"known has shape {given.shape}: must be ({n}, {n}), as the blocks")
    return require_blocks(given[None, None], 1, "known")[0, 0]


def _schedule_set(
    terms: list[Terms], rules: tuple[AbstractRule, ...], per_segment: int, segments: Segments
) -> CardinalitySchedules | PatternSchedules | DwellChain:
    K, S = segments.count, len(segments.names)
    masks = [term.available for term in terms if term.available is not None]
    available = np.logical_and.reduce(masks) if masks else np.ones((K, S), dtype=bool)
    dwell = np.max([np.ones(S, dtype=int), *(term.dwell for term in terms if term.dwell is not None)], axis=0)
    linked = (dwell > 1).any() or any(_couples_segments(term) for term in terms)
    pattern_filters = [term.admissible for term in terms if term.admissible is not None]
    if not linked and not pattern_filters:
        _require_available_sensor(available, rules, segments)
        return CardinalitySchedules(available, per_segment)
    patterns = patterns_up_to(S, per_segment)
    for allows in pattern_filters:
        patterns = patterns[allows(patterns)]
    _require_usable_sensors(patterns, rules, per_segment, segments)
    possible = (~available).astype(float) @ patterns.T == 0
    _require_available_sensor((possible & patterns.any(axis=1))[:, :, None].any(axis=1), rules, segments)
    _require_usable_sensors(patterns[possible.any(axis=0)] | ~available.any(axis=0), rules, per_segment, segments)
    if not linked:
        return PatternSchedules(available, patterns)
    chain = DwellChain(available, patterns, dwell)
    _require_dwell_time(chain, rules, segments)
    return chain


def _couples_segments(terms: Terms) -> bool:
    return (terms.switching is not None and bool(terms.switching.any())) or (
        terms.resource is not None and bool(terms.resource.start.any())
    )


def patterns_up_to(S: int, per_segment: int) -> np.ndarray:
    """All sets of at most per_segment sensors (P, S), the fullest first: of equals, the first is taken."""
    count = sum(comb(S, size) for size in range(per_segment + 1))
    if count > _MAX_PATTERNS:
        raise InputError(
            f"{per_segment} of {S} sensors make {count} patterns: with rules on which sensors go together, or follow each other, "
            f"at most {_MAX_PATTERNS} are accepted"
        )
    sets = [subset for size in range(per_segment, -1, -1) for subset in combinations(range(S), size)]
    patterns = np.zeros((len(sets), S), dtype=bool)
    for pattern, subset in zip(patterns, sets, strict=True):
        pattern[list(subset)] = True
    return patterns


def _require_available_sensor(can_be_on: np.ndarray, rules: tuple[AbstractRule, ...], segments: Segments) -> None:
    empty = np.flatnonzero(~can_be_on.any(axis=1))
    if len(empty):
        suffix = f" (and {len(empty) - 1} more)" if len(empty) > 1 else ""
        raise InputError(f"segment {empty[0]}{suffix}: the rules leave no sensor that may be on: {_rule_list(rules)}")


def _require_usable_sensors(patterns: np.ndarray, rules: tuple[AbstractRule, ...], per_segment: int, segments: Segments) -> None:
    unusable = np.flatnonzero(~patterns.any(axis=0))
    if len(unusable):
        raise InputError(
            f"{segments.names[unusable[0]]} can never be on, with {per_segment} per segment: {_rule_list(rules)} contradict each other"
        )


def _require_dwell_time(chain: DwellChain, rules: tuple[AbstractRule, ...], segments: Segments) -> None:
    no_prices = np.zeros(chain.available.shape), np.zeros(chain.available.shape[1])
    on, _ = chain.forcing_costs(*no_prices)
    unusable = np.flatnonzero(~np.isfinite(on).any(axis=0) & chain.available.any(axis=0))
    if len(unusable):
        raise InputError(f"{segments.names[unusable[0]]} can never be on for long enough: {_rule_list(rules)} contradict each other")


def _require_budget(terms: list[Terms], rules: tuple[AbstractRule, ...], available: np.ndarray) -> None:
    for rule, term in zip(rules, terms, strict=True):
        if term.resource is None:
            continue
        smallest_usage = np.where(available, term.resource.usage + term.resource.start, np.inf).min()
        if smallest_usage > term.resource.limit:
            raise InputError(f"{rule}: too small for any schedule: the cheapest sensor in the cheapest segment takes {smallest_usage:g}")


def _rule_list(rules: tuple[AbstractRule, ...]) -> str:
    return "; ".join(str(rule) for rule in rules)
