"""The recursion for unknown inputs, step by step: Omega_0, Omega_1, ... with the autobrackets.

  Omega_(m+1) = Omega_m + sum_i L_{f_i} Omega_m + sum_j L_{gh_j} Omega_m + sum_i sum_k L_{phi_i of length m} hh_k
Source: Martinelli, IROS 2017, Algorithm 2.
"""

from __future__ import annotations

from collections.abc import Iterator

import casadi as ca

from obsdesign.analysis.field_rescaling import RescaledSystem
from obsdesign.analysis.lie_expressions import MAX_NODES, IndependenceTest, TooLargeError


def codistribution_sequence(independence: IndependenceTest, rescaled: RescaledSystem) -> Iterator[ca.SX]:
    """Yield functions whose gradients are a basis of Omega_0, Omega_1, ..., without end. Raises TooLargeError, NoValueError."""
    basis = rescaled.functions
    latest = basis
    levels = autobrackets(independence, rescaled)
    next(levels)  # those of length 0 are fields: Omega_0 is derived along them anyway
    level: list[ca.SX] = []
    while True:
        yield basis
        candidates = ca.vertcat(
            independence.lie_derivatives(latest, rescaled.nonzero_fields), independence.lie_derivatives(rescaled.selected_functions, level)
        )
        level = next(levels)
        stacked = ca.vertcat(basis, candidates)
        independent = independence.independent_functions(stacked) if candidates.numel() else tuple(range(basis.numel()))
        latest = stacked[[i for i in independent if i >= basis.numel()]] if len(independent) > basis.numel() else ca.SX(0, 1)
        basis = ca.vertcat(basis, latest)


def autobrackets(independence: IndependenceTest, rescaled: RescaledSystem) -> Iterator[list[ca.SX]]:
    """Yield the autobrackets of length 0, 1, 2, ... that do not vanish. Raises TooLargeError."""
    level = [field for field in rescaled.equations.known_fields if not independence.vanishes(field)]
    while True:
        yield level
        longer = rescaled.autobrackets(level)
        if longer and ca.n_nodes(ca.horzcat(*longer)) > MAX_NODES:
            raise TooLargeError
        level = [field for field in longer if not independence.vanishes(field)]


def brackets_preserve_rates(independence: IndependenceTest, rescaled: RescaledSystem) -> bool:
    """Return whether no autobracket of any length changes the rates N (Lemma 1 of the IROS paper): then none adds anything.

    What the autobrackets of length 0..m span has ceased to grow for good once it does not grow with m.
    """
    spanning_fields, rank = ca.SX(rescaled.equations.n, 0), 0
    try:
        for level in autobrackets(independence, rescaled):
            if not all(independence.vanishes(rescaled.rate_change(field)) for field in level):
                return False
            spanning_fields = ca.horzcat(spanning_fields, *level)
            new_rank = len(independence.independent_rows(ca.densify(spanning_fields))) if spanning_fields.shape[1] else 0
            if new_rank == rank:
                return True
            rank = new_rank
    except TooLargeError:
        pass
    return False
