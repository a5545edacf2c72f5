"""The recursion for unknown inputs, step by step: Omega_0, Omega_1, ... with the autobrackets.

  Omega_(m+1) = Omega_m + sum_i L_{f_i} Omega_m + sum_j L_{gh_j} Omega_m + sum_i sum_k L_{phi_i of length m} hh_k
Source: Martinelli, IROS 2017, Algorithm 2.
"""

from __future__ import annotations

from collections.abc import Iterator

import casadi as ca

from obsdesign.analysis.field_rescaling import Rescaled
from obsdesign.analysis.lie_expressions import NODES, Space, TooLargeError


def recursion(space: Space, rescaled: Rescaled) -> Iterator[ca.SX]:
    """Yield functions whose gradients are a basis of Omega_0, Omega_1, ..., without end. Raises TooLargeError, NoValueError."""
    kept = rescaled.functions
    latest = kept
    levels = autobrackets(space, rescaled)
    next(levels)  # those of length 0 are fields: Omega_0 is derived along them anyway
    level: list[ca.SX] = []
    while True:
        yield kept
        found = ca.vertcat(space.derived(latest, rescaled.moving_fields), space.derived(rescaled.chosen, level))
        level = next(levels)
        every = ca.vertcat(kept, found)
        chosen = space.telling(every) if found.numel() else tuple(range(kept.numel()))
        latest = every[[i for i in chosen if i >= kept.numel()]] if len(chosen) > kept.numel() else ca.SX(0, 1)
        kept = ca.vertcat(kept, latest)


def autobrackets(space: Space, rescaled: Rescaled) -> Iterator[list[ca.SX]]:
    """Yield the autobrackets of length 0, 1, 2, ... that do not vanish. Raises TooLargeError."""
    level = [field for field in rescaled.equations.known if not space.vanishes(field)]
    while True:
        yield level
        longer = rescaled.brackets(level)
        if longer and ca.n_nodes(ca.horzcat(*longer)) > NODES:
            raise TooLargeError
        level = [field for field in longer if not space.vanishes(field)]


def brackets_leave_rates_alone(space: Space, rescaled: Rescaled) -> bool:
    """Return whether no autobracket of any length changes the rates N (Lemma 1 of the IROS paper): then none adds anything.

    What the autobrackets of length 0..m span has ceased to grow for good once it does not grow with m.
    """
    span, rank = ca.SX(rescaled.equations.n, 0), 0
    try:
        for level in autobrackets(space, rescaled):
            if not all(space.vanishes(rescaled.change_of_rates(field)) for field in level):
                return False
            span = ca.horzcat(span, *level)
            grown = len(space.independent(ca.densify(span))) if span.shape[1] else 0
            if grown == rank:
                return True
            rank = grown
    except TooLargeError:
        pass
    return False
