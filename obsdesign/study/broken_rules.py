"""Which rules a schedule breaks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from obsdesign.rules.abstract import AbstractRule, Segments
from obsdesign.selection.problem import switch_ons


def rule_violations(rules: Sequence[AbstractRule], segments: Segments, chosen: np.ndarray) -> tuple[str, ...]:
    """Names of the rules that a schedule (K, S) breaks."""
    return tuple(str(rule) for rule in rules if not _is_kept(rule, segments, chosen))


def _is_kept(rule: AbstractRule, segments: Segments, chosen: np.ndarray) -> bool:
    terms = rule.terms(segments)
    if terms.available is not None and (chosen & ~terms.available).any():
        return False
    if terms.admissible is not None and not np.all(terms.admissible(chosen)):
        return False
    if terms.resource is not None:
        used = float(terms.resource.usage[chosen].sum() + terms.resource.start @ switch_ons(chosen).sum(axis=0))
        if used > terms.resource.limit + 1e-9 * max(1.0, terms.resource.limit):
            return False
    return terms.dwell is None or all(_keeps_dwell(chosen[:, s], int(minimum)) for s, minimum in enumerate(terms.dwell))


def _keeps_dwell(on: np.ndarray, minimum: int) -> bool:
    """Whether every stretch of a sensor (K,) is long enough, or ends with the path."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], on.astype(int), [0]])))
    return all(last - first >= minimum or last == len(on) for first, last in zip(edges[::2], edges[1::2], strict=True))
