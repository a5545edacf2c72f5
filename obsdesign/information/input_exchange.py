"""How unknown inputs hide a step: which changes of the state they can undo, without the inverse of the step's transition."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from obsdesign.information.householder import solve


@dataclass(frozen=True, eq=False)
class InputExchange:
    """x = X y + Q t: all x, with t anything, from which y = F x + B w is reached by some w. X (n, n), Q (n, p), X B = 0.

    magnitudes (n, n): of what was added up in each entry of X; A (n, n): F with the inputs' columns in place of those of t, and its
    inverse, of which X is a part.
    """

    X: ca.SX
    Q: ca.SX
    magnitudes: ca.SX
    A: ca.SX
    inverse: ca.SX


def exchange_inputs(F: ca.SX, B: ca.SX, weights: ca.SX) -> InputExchange:
    """Return x for y: each w takes the place of the state that moves along with it most, counted by weights (n, 1); that state is t.

    F^-1 would enlarge what the inputs hide anyway by as much as the step has shrunk it; the exchanged basis is not singular even
    where F is. Units of the states should be comparable.
    """
    n, states = F.shape[0], _exchanged_states(ca.fabs(weights), solve(F, B))
    is_solved = ca.diag(1 - ca.sum2(states))
    A = F @ is_solved + B @ states.T
    solved = solve(A, ca.horzcat(ca.SX.eye(n), F @ states))
    X, magnitudes = _with_null_columns(is_solved @ solved[:, :n], B)
    return InputExchange(X, states - is_solved @ solved[:, n:], magnitudes, A, solved[:, :n])


def _exchanged_states(weights: ca.SX, columns: ca.SX) -> ca.SX:
    """Return E (n, p), 1 where the state stands that is exchanged for the input: the largest of F^-1 b, less those before it."""
    states = ca.SX(columns.shape[0], 0)
    for j in range(columns.shape[1]):
        column = columns[:, j]
        state = largest_entry(ca.sparsify(ca.fabs(column) * weights * (1 - ca.sum2(states))))
        states = ca.horzcat(states, state)
        columns = columns - column @ (state.T @ columns) / _pivot(state, column)
    return states


def _with_null_columns(X: ca.SX, B: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return X with X B = 0 to the last digit, which was so but for rounding, and the magnitudes of what is added up in each entry."""
    magnitudes = ca.fabs(X)
    for j in range(B.shape[1]):
        b = B[:, j]
        row = largest_entry(ca.fabs(b))
        pivot, others = _pivot(row, b), ca.diag(1 - row)
        X, magnitudes = ca.sparsify(X @ others), ca.sparsify(magnitudes @ others)
        X, magnitudes = X - (X @ b) @ row.T / pivot, magnitudes + (magnitudes @ ca.fabs(b)) @ row.T / ca.fabs(pivot)
        B = ca.sparsify(others @ (B - b @ (row.T @ B) / pivot))
    return ca.sparsify(X), ca.sparsify(magnitudes)


def deflate(F: ca.SX, B: ca.SX, weights: ca.SX) -> ca.SX:
    """Return F less what the inputs' columns B (n, p) can undo: the row of the largest entry of each, by weights (n, 1), is 0."""
    for j in range(B.shape[1]):
        b = B[:, j]
        row = largest_entry(ca.fabs(b) * weights)
        share = b / _pivot(row, b)
        F, B = (ca.diag(1 - row) @ (matrix - share @ (row.T @ matrix)) for matrix in (F, B))
    return F


def _pivot(entry: ca.SX, column: ca.SX) -> ca.SX:
    """Return the entry of the column, 1 where there is none."""
    return ca.dot(entry, column) + (1 - ca.sum1(entry))


def largest_entry(sizes: ca.SX) -> ca.SX:
    """Return 1 where the first of the largest sizes (n, 1) stands and 0 elsewhere; 0 everywhere if none is above 0."""
    rows, result = sizes.sparsity().row(), ca.SX(sizes.sparsity())
    largest = ca.SX(0)
    for i in rows:
        largest = ca.fmax(largest, sizes[i])
    is_free = largest > 0
    for i in rows:
        result[i] = ca.logic_and(is_free, sizes[i] >= largest)
        is_free = ca.logic_and(is_free, ca.logic_not(result[i]))
    return result
