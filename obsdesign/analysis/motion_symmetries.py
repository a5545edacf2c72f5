"""Candidates for symmetries that no linear equation yields: along the motion itself, and where forcing takes a state's place.

Forcing (Brace and Morgansen, Lemma 3): constant states c that enter the rate by a constant matrix, f = f_d(x) + E c. A state s that
is constant, too, and whose share of the rate E can make up for, d f/ds = E a(x), cannot be told from c: v = e_s - sum_c a_c(x) e_c.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import casadi as ca
import numpy as np

from obsdesign.analysis.equations import Equations
from obsdesign.analysis.vector_fields import ExpressionField


def forcing_fields(equations: Equations, unseen: Sequence[int]) -> Iterator[tuple[int, ExpressionField]]:
    """Yield, for each constant state that forcing may take the place of, the state and the field."""
    drift, *fields = (_without_zeros(equations, field) for field in _all_fields(equations))
    constant = [i for i in range(equations.n) if all(field[i].is_zero() for field in (drift, *fields))]
    slopes = ca.jacobian(drift, equations.x)
    linear = [i for i in constant if i in unseen and slopes[:, i].nnz() and not ca.depends_on(slopes[:, i], equations.x)]
    forcing = _independent(equations, slopes, linear)
    for state in constant if forcing else ():
        if state in unseen and state not in linear and slopes[:, state].nnz():
            E = slopes[:, forcing]
            vector = ca.SX(equations.n, 1)
            vector[state] = 1
            vector[forcing] = -ca.solve(E.T @ E, E.T @ slopes[:, state])
            yield state, ExpressionField(equations, ca.densify(vector))


def _independent(equations: Equations, slopes: ca.SX, columns: Sequence[int]) -> list[int]:
    """Return the first columns of a constant matrix that are independent."""
    constants = [float(value) for value in equations.values]
    matrix = (
        np.array(equations.function(ca.densify(slopes[:, list(columns)]))(np.zeros(equations.n), constants))
        if columns
        else np.zeros((0, 0))
    )
    chosen: list[int] = []
    for k in range(len(columns)):
        if np.linalg.matrix_rank(matrix[:, [*chosen, k]]) > len(chosen):
            chosen.append(k)
    return [columns[k] for k in chosen]


def motion_fields(equations: Equations) -> Iterator[tuple[str, ExpressionField]]:
    """Yield what moves the state: "drift", "known input", "unknown input" in turn."""
    names = ("drift", *["known input"] * len(equations.known_fields), *["unknown input"] * len(equations.unknown_fields))
    for name, field in zip(names, _all_fields(equations), strict=True):
        if not field.is_zero():
            yield name, ExpressionField(equations, ca.densify(field))


def _without_zeros(equations: Equations, expression: ca.SX) -> ca.SX:
    """Return the expression with 0 for constants that are 0, such as an input that is held there."""
    places = [i for i, value in enumerate(equations.values) if value == 0]
    return ca.substitute(expression, equations.constants[places], ca.SX.zeros(len(places))) if places else expression


def _all_fields(equations: Equations) -> tuple[ca.SX, ...]:
    return equations.drift, *equations.known_fields, *equations.unknown_fields
