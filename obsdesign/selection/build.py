"""From blocks and rules to a problem that methods work on; what cannot be meant is refused here."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import combinations
from math import comb
from numbers import Integral

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.checks import require_count
from obsdesign.criteria.abstract import AbstractCriterion
from obsdesign.errors import InputError
from obsdesign.rules.abstract import AbstractRule, Segments, Terms
from obsdesign.selection.pricing.cardinality import Top
from obsdesign.selection.pricing.dwell_chain import Chain
from obsdesign.selection.pricing.patterns import Groups
from obsdesign.selection.problem import Instance, vectors
from obsdesign.selection.scaled_criterion import Judge
from obsdesign.selection.schedule import require_blocks

_MOST_PATTERNS = 50_000  # they are listed, with a byte for each sensor: trades the problems that are accepted for memory and time
_LEAST, _MOST = 1e-152, 1e154  # what all sensors may know of a state: squares of it, and of 1 over it, are numbers
_BESIDE = 1e-26  # of what all sensors know of a state: what is less, two doubles do not tell from nothing


def posed(
    blocks: np.ndarray,
    per_segment: int,
    rules: tuple[AbstractRule, ...],
    criterion: AbstractCriterion,
    robust_to: int,
    segments: Segments | None,
    *,
    known: ArrayLike | None = None,
    about: Sequence[int] | None = None,
) -> Instance:
    """Return the problem of checked blocks (K, S, n, n), or raise InputError for rules that leave no choice."""
    K, S, n, _ = blocks.shape
    there = segments or Segments(tuple(f"sensor {s}" for s in range(S)), K)
    if (there.count, len(there.names)) != (K, S):
        raise InputError(f"segments has {there.count} segments of {len(there.names)} sensors: the blocks have {K} of {S}")
    base, judged = require_known_information(known, n), require_about(about, n)
    if criterion.knowledge is not None:
        raise InputError(f"criterion is {type(criterion).__name__}: its information is no sum over sensors, so no schedule is best for it")
    require_count("robust_to", robust_to, least=0, most=S - 1)
    terms = [rule.terms(there) for rule in rules]
    schedules = _schedules(terms, rules, per_segment, there)
    resources = tuple(each.resource for each in terms if each.resource is not None)
    _require_room(terms, rules, schedules.available)
    switching = np.sum([np.zeros(S), *(each.switching for each in terms if each.switching is not None)], axis=0)
    lost = list(combinations(range(S), robust_to))
    kept = np.ones((len(lost), S))
    for row, each in zip(kept, lost, strict=True):
        row[list(each)] = 0.0
    D = _units(blocks, schedules.available, base)
    scale = D[:, None] * D
    rows = vectors(blocks)
    rows *= scale[np.tril_indices(n)]
    judge = Judge(criterion, D, judged)
    return Instance(np.ascontiguousarray(rows), blocks, n, judge, schedules, resources, switching, kept, base * scale)


def _units(blocks: np.ndarray, available: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Powers of two D (n,) with D_i^2 (known + all blocks)_ii about 1, so that scaling by them rounds nothing; 1 for what is unseen."""
    by_sensors = np.einsum("ks,ksi->i", available, np.diagonal(blocks, axis1=2, axis2=3))
    total = np.diag(known) + by_sensors
    for i in np.flatnonzero((total > 0) & ~((total >= _LEAST) & (total <= _MOST))):
        raise InputError(
            f"blocks: all sensors together know {total[i]:.3g} of state {i}: must be 0, or from {_LEAST:g} to {_MOST:g}; scale them"
        )
    for i in np.flatnonzero((np.diag(known) > 0) & (np.diag(known) < _BESIDE * by_sensors)):
        raise InputError(
            f"known: its entry [{i}, {i}] is {known[i, i]:.3g}, beside {by_sensors[i]:.3g} of all sensors together: "
            f"must be 0, or at least {_BESIDE:g} of that"
        )
    return np.exp2(-np.round(np.log2(np.where(total > 0, total, 1.0)) / 2))


def require_about(about: Sequence[int] | None, n: int) -> np.ndarray:
    """Return the indices of the judged states (k,), ascending, None = all of them, or raise InputError."""
    if about is None:
        return np.arange(n)
    given = (about,) if isinstance(about, str) or not isinstance(about, Iterable) else tuple(about)
    whole = all(isinstance(each, Integral) and not isinstance(each, bool) and 0 <= int(each) < n for each in given)
    if not given or not whole or len(set(given)) < len(given):
        raise InputError(f"about is {about!r}: must be different indices of states, whole numbers from 0 to {n - 1}")
    return np.sort(np.array(given, dtype=int))


def require_known_information(known: ArrayLike | None, n: int) -> np.ndarray:
    """Return what is known already (n, n), None = nothing, or raise InputError for what is no information matrix."""
    if known is None:
        return np.zeros((n, n))
    given = np.asarray(known, dtype=float)
    if given.shape != (n, n):
        raise InputError(f"known has shape {given.shape}: must be ({n}, {n}), as the blocks")
    return require_blocks(given[None, None], 1, "known")[0, 0]


def _schedules(terms: list[Terms], rules: tuple[AbstractRule, ...], per_segment: int, known: Segments) -> Top | Groups | Chain:
    K, S = known.count, len(known.names)
    masks = [each.available for each in terms if each.available is not None]
    available = np.logical_and.reduce(masks) if masks else np.ones((K, S), dtype=bool)
    dwell = np.max([np.ones(S, dtype=int), *(each.dwell for each in terms if each.dwell is not None)], axis=0)
    linked = (dwell > 1).any() or any(_links(each) for each in terms)
    allowed = [each.allowed for each in terms if each.allowed is not None]
    if not linked and not allowed:
        _require_someone(available, rules, known)
        return Top(available, per_segment)
    patterns = _patterns(S, per_segment)
    for each in allowed:
        patterns = patterns[each(patterns)]
    _require_use(patterns, rules, per_segment, known)
    possible = (~available).astype(float) @ patterns.T == 0
    _require_someone((possible & patterns.any(axis=1))[:, :, None].any(axis=1), rules, known)
    _require_use(patterns[possible.any(axis=0)] | ~available.any(axis=0), rules, per_segment, known)
    if not linked:
        return Groups(available, patterns)
    chain = Chain(available, patterns, dwell)
    _require_time(chain, rules, known)
    return chain


def _links(terms: Terms) -> bool:
    return (terms.switching is not None and bool(terms.switching.any())) or (
        terms.resource is not None and bool(terms.resource.start.any())
    )


def _patterns(S: int, per_segment: int) -> np.ndarray:
    """All sets of at most per_segment sensors (P, S), the fullest first: of equals, the first is taken."""
    count = sum(comb(S, size) for size in range(per_segment + 1))
    if count > _MOST_PATTERNS:
        raise InputError(
            f"{per_segment} of {S} sensors make {count} patterns: with rules on which sensors go together, or follow each other, "
            f"at most {_MOST_PATTERNS} are accepted"
        )
    sets = [subset for size in range(per_segment, -1, -1) for subset in combinations(range(S), size)]
    patterns = np.zeros((len(sets), S), dtype=bool)
    for pattern, subset in zip(patterns, sets, strict=True):
        pattern[list(subset)] = True
    return patterns


def _require_someone(somebody: np.ndarray, rules: tuple[AbstractRule, ...], known: Segments) -> None:
    empty = np.flatnonzero(~somebody.any(axis=1))
    if len(empty):
        more = f" (and {len(empty) - 1} more)" if len(empty) > 1 else ""
        raise InputError(f"segment {empty[0]}{more}: the rules leave no sensor that may be on: {_spelled(rules)}")


def _require_use(patterns: np.ndarray, rules: tuple[AbstractRule, ...], per_segment: int, known: Segments) -> None:
    never = np.flatnonzero(~patterns.any(axis=0))
    if len(never):
        raise InputError(
            f"{known.names[never[0]]} can never be on, with {per_segment} per segment: {_spelled(rules)} contradict each other"
        )


def _require_time(chain: Chain, rules: tuple[AbstractRule, ...], known: Segments) -> None:
    nothing = np.zeros(chain.available.shape), np.zeros(chain.available.shape[1])
    on, _ = chain.regrets(*nothing)
    never = np.flatnonzero(~np.isfinite(on).any(axis=0) & chain.available.any(axis=0))
    if len(never):
        raise InputError(f"{known.names[never[0]]} can never be on for long enough: {_spelled(rules)} contradict each other")


def _require_room(terms: list[Terms], rules: tuple[AbstractRule, ...], available: np.ndarray) -> None:
    for rule, each in zip(rules, terms, strict=True):
        if each.resource is None:
            continue
        need = np.where(available, each.resource.usage + each.resource.start, np.inf).min()
        if need > each.resource.limit:
            raise InputError(f"{rule}: too small for any schedule: the cheapest sensor in the cheapest segment takes {need:g}")


def _spelled(rules: tuple[AbstractRule, ...]) -> str:
    return "; ".join(str(rule) for rule in rules)
