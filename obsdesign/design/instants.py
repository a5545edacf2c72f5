"""At which instants a posterior is judged along a path, and how their numbers make one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.criteria.abstract import AbstractCriterion
from obsdesign.design.sqp.combination import AbstractCombination, ReciprocalSum, Smallest, WeightedSum


@dataclass(frozen=True, eq=False)
class Instants:
    """steps (b,): the k at which what is known of x(t_k) after its samples is judged; combination: of the b numbers."""

    steps: np.ndarray
    combination: AbstractCombination


def instants_of(criterion: AbstractCriterion, steps: int) -> Instants | None:
    """Return at which of so many steps a posterior is judged; None: what is judged is one matrix, at the end or about the start.

    The cost of an instant is tr P, -log det J or lambda_max(P), P = J^-1: minus the number of the criterion or, of a smallest eigenvalue,
    its reciprocal. The total is the number of the weighted sum of the costs, of the mean or of the largest: concave in the numbers.
    """
    knowledge = criterion.knowledge
    if knowledge is None or knowledge.over == "end":
        return None
    if knowledge.over == "worst":
        return Instants(np.arange(steps), Smallest())
    weights = np.full(steps, 1 / steps) if knowledge.over == "mean" else np.array(knowledge.over)
    asked = np.flatnonzero(weights)
    return Instants(asked, (ReciprocalSum if criterion.is_smallest_eigenvalue else WeightedSum)(weights[asked]))
