"""Triangular factors of graphs by Givens's rotations, solutions by Householder's reflections: what is 0 by structure stays so."""

from __future__ import annotations

import casadi as ca
import numpy as np


def triangular_factor(rows: ca.SX) -> ca.SX:
    """Return upper triangular R (n, n) with R'R = A'A for rows A (m, n), m >= n, by Givens's rotations.

    A rotation mixes two rows in the shares of their entries in one column, so that a row of small numbers keeps its digits beside one
    of large numbers; a reflection would take its first row for the difference of larger ones.
    """
    m, n = rows.shape
    A = [[rows[i, j] for j in range(n)] for i in range(m)]
    for j in range(n):
        for i in range(j + 1, m):
            if not A[i][j].is_zero():
                _rotate(A, j, i)
    return ca.vertcat(*[ca.horzcat(*[A[i][j] if j >= i else ca.SX(1, 1) for j in range(n)]) for i in range(n)])


def _rotate(A: list[list[ca.SX]], column: int, row: int) -> None:
    """Turn the given row and that of the column's number so that the given one has no entry in the column; in place."""
    first, second = A[column], A[row]
    if first[column].is_zero():
        A[column], A[row] = second, first
        return
    size = first[column] ** 2 + second[column] ** 2
    is_nonzero = size != 0  # true for nan, which must not be lost
    norm = ca.sqrt(ca.if_else(is_nonzero, size, 1))
    cosine, sine = ca.if_else(is_nonzero, first[column] / norm, 1), second[column] / norm
    A[column] = [cosine * x + sine * y for x, y in zip(first, second, strict=True)]
    A[row] = [cosine * y - sine * x for x, y in zip(first, second, strict=True)]
    A[column][column], A[row][column] = ca.if_else(is_nonzero, norm, 0), ca.SX(1, 1)


def _triangulate(A: list[list[ca.SX]], columns: int) -> None:
    """Make the first columns of rows A upper triangular; in place."""
    for j in range(columns):
        below = [i for i in range(j, len(A)) if not A[i][j].is_zero()]
        if below and below != [j]:
            _reflect(A, sorted({j, *below}), j)


def _reflect(A: list[list[ca.SX]], rows: list[int], column: int) -> None:
    """Turn the given rows so that only the first of them has an entry in the column; in place."""
    x = [A[i][column] for i in rows]
    size = ca.sumsqr(ca.vertcat(*x))
    is_nonzero = size != 0  # true for nan, which must not be lost
    norm = ca.if_else(is_nonzero, ca.sqrt(ca.if_else(is_nonzero, size, 1)), 0)
    signed = ca.if_else(x[0] >= 0, norm, -norm)
    v = [x[0] + signed, *x[1:]]
    factor = is_nonzero / ca.if_else(is_nonzero, norm * (norm + ca.fabs(x[0])), 1)
    for j in range(column + 1, len(A[0])):
        if all(A[i][j].is_zero() for i in rows):
            continue
        projection = factor * sum((v[k] * A[i][j] for k, i in enumerate(rows)), ca.SX(0))
        for k, i in enumerate(rows):
            A[i][j] -= projection * v[k]
    A[rows[0]][column] = -signed
    for i in rows[1:]:
        A[i][column] = ca.SX(0)


def solve(A: ca.SX, Y: ca.SX) -> ca.SX:
    """Return A^-1 Y, one block of A's block triangular form after the other."""
    count, row_order, column_order, ends, _, _, _ = A.sparsity().btf()
    A, Y = A[row_order, column_order], Y[row_order, :]
    X = ca.SX(*Y.shape)
    for block in range(count):
        part = slice(ends[block], ends[block + 1])
        X[part, :] = _solve_block(A[part, part], ca.sparsify(Y[part, :] - A[part, : part.start] @ X[: part.start, :]))
    return ca.sparsify(X[np.argsort(column_order).tolist(), :])


def _solve_block(A: ca.SX, Y: ca.SX) -> ca.SX:
    """Return A^-1 Y for A that has no structure.

    Rows are first brought to sizes from 1 to 2: reflections keep only what is not small beside the largest row.
    """
    if A.numel() == 1:
        return Y / A
    n, joint = A.shape[0], ca.horzcat(A, Y)
    rows = [[unit * entry for entry in ca.horzsplit(joint[i, :])] for i, unit in enumerate(_units_of_rows(A))]
    _triangulate(rows, n)
    for i in reversed(range(n)):
        for j in range(n, len(rows[i])):
            rows[i][j] = (rows[i][j] - sum((rows[i][k] * rows[k][j] for k in range(i + 1, n)), ca.SX(0))) / rows[i][i]
    return ca.sparsify(ca.vertcat(*[ca.horzcat(*row[n:]) for row in rows]))


def _units_of_rows(A: ca.SX) -> list[ca.SX]:
    """Return a power of two for each row that brings its largest entry to between 1 and 2: nothing is rounded, and its derivative is 0."""
    sizes = [ca.mmax(ca.fabs(ca.densify(A[i, :]))) for i in range(A.shape[0])]
    exponents = [ca.floor(ca.log(ca.if_else(size > 0, size, 1)) / np.log(2.0)) for size in sizes]
    return [ca.power(2, -exponent) for exponent in exponents]
