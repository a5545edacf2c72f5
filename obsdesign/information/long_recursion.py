"""What is known of a state with as many digits as it takes, where unknown inputs take nearly all that doubles hold."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from flint import arb, arb_mat, ctx

from obsdesign.dynamics.nuisance_states import NuisanceStates
from obsdesign.errors import InputError
from obsdesign.information.linearisation import PathLinearisation
from obsdesign.rank.flint_lock import exclusive_flint

_BITS = (512, 1024, 2048, 4096, 8192, 16384)
"""Working precisions, tried in turn until two of them agree."""

_AGREEMENT = 1e-9  # relative difference of two roots that agree
_NOTHING = 1e-30  # share of a column below which entries need not agree


@dataclass(frozen=True, eq=False)
class LinearProblem:
    """Errors (b, x) of the linearisation along a path; counts (N, q): how often a sample counts; P (n, n) before the samples at t_0.

    paces (N,): of the steps, as `Trajectory.paces`; unknown: columns of its B.
    """

    linearisation: PathLinearisation
    nuisance: NuisanceStates
    paces: np.ndarray
    counts: np.ndarray
    P: np.ndarray
    unknown: tuple[int, ...]

    @property
    def n_constants(self) -> int:
        """c."""
        return len(self.nuisance.constant)

    @property
    def size(self) -> int:
        """c + n."""
        return self.n_constants + len(self.P)

    @cached_property
    def noise(self) -> np.ndarray:
        """Columns of noise of each step (N, c + n, r), about (b, x)."""
        return np.pad(self.linearisation.noise, ((0, 0), (self.n_constants, 0), (0, 0)))


@dataclass(frozen=True, eq=False)
class _Knowledge:
    """Information J about (b, x) and z | (b, x) ~ N(M (b, x), V), as in `ErrorDistribution`."""

    J: arb_mat
    M: arb_mat
    V: arb_mat

    def transform(self, X: arb_mat) -> _Knowledge:
        """Return the same about y where this is about X y."""
        return _Knowledge((X.transpose() * (self.J * X).mid()).mid(), (self.M * X).mid(), self.V)

    def move_along(self, b: arb_mat, information: int) -> _Knowledge:
        """Return the same once the state has moved along b (s, 1) by a number of which so much is known, 0 or 1.

        Unchanged where it is unseen: b'J b is then what rounding left of its terms, less than half of the digits.
        """
        u = (self.J * b).mid()
        seen = (b.transpose() * u)[0, 0].mid()
        largest = max(abs(b[i, 0] * b[i, 0] * self.J[i, i]) for i in range(b.nrows()))
        if not information and not seen > largest * _threshold():
            return self
        size, along = (seen + information).mid(), (self.M * b).mid()
        J = (self.J - (u * u.transpose()).mid() * (1 / size)).mid()
        M = (self.M - (along * u.transpose()).mid() * (1 / size)).mid()
        return _Knowledge(J, M, (self.V + (along * along.transpose()).mid() * (1 / size)).mid())


def long_roots(problem: LinearProblem) -> np.ndarray:
    """Return R (N+1, n, n): R'R is what is known of x(t_k) after its samples, at t_N before them.

    The recursion J+ = X'(J - J q (q'J q)^# q'J) X as it is written, with so many bits that with twice as many nothing changes.
    Raises InputError for a step after which something is known without end.
    """
    with exclusive_flint():
        roots = _roots_with(problem, _BITS[0])
        for bits in _BITS[1:]:
            previous, roots = roots, _roots_with(problem, bits)
            if _agree(previous, roots):
                break
    return roots


def _agree(A: np.ndarray, B: np.ndarray) -> bool:
    allowance = _AGREEMENT * np.abs(B) + _NOTHING * np.abs(B).max(axis=1, keepdims=True)
    with np.errstate(invalid="ignore"):  # inf - inf
        return bool(((A == B) | (np.abs(A - B) <= allowance)).all())


def _roots_with(problem: LinearProblem, bits: int) -> np.ndarray:
    ctx.prec = bits
    return np.array([_root_about_state(J, problem.n_constants) for J in _informations(problem)])


def _informations(problem: LinearProblem) -> Iterator[arb_mat]:
    """Yield J about (b, x_k) after the samples at t_k, at t_N before them."""
    nuisance, F, B = problem.nuisance, *_steps_of(problem)
    decays, drivings = nuisance.decays(problem.paces), nuisance.driving_covariances(problem.paces)
    knowledge, exchange = _before_samples(problem), _exchange(F[0], B[0])
    for k in range(len(F)):
        knowledge = _after_samples(problem, knowledge, k)
        yield knowledge.J
        if k and not (np.array_equal(F[k], F[k - 1]) and np.array_equal(B[k], B[k - 1])):
            exchange = _exchange(F[k], B[k])
        decay, driving = _matrix(np.diag(decays[k])), _matrix(drivings[k])
        knowledge = _Knowledge(knowledge.J, (decay * knowledge.M).mid(), (decay * knowledge.V * decay + driving).mid())
        for q in exchange.Q:
            knowledge = knowledge.move_along(q, 0)
        knowledge = knowledge.transform(exchange.X)
        for column in problem.noise[k].T:
            knowledge = knowledge.move_along(_matrix(column[:, None]), 1)
    yield knowledge.J


def _before_samples(problem: LinearProblem) -> _Knowledge:
    a, c, s = len(problem.nuisance.coloured), problem.n_constants, problem.size
    covariance = np.eye(s)
    covariance[c:, c:] = problem.P
    return _Knowledge(_matrix(covariance).inv().mid(), arb_mat(a, s), _matrix(problem.nuisance.R))


def _steps_of(problem: LinearProblem) -> tuple[np.ndarray, np.ndarray]:
    """Return F (N, s, s) and the columns of the unknown inputs (N, s, p), about (b, x)."""
    c, lines = problem.n_constants, problem.linearisation
    F = np.tile(np.eye(problem.size), (len(lines.F), 1, 1))
    F[:, c:, c:] = lines.F
    return F, np.pad(lines.B[:, :, list(problem.unknown)], ((0, 0), (c, 0), (0, 0)))


def _after_samples(problem: LinearProblem, knowledge: _Knowledge, k: int) -> _Knowledge:
    """Return what is known after the samples at t_k, one output after the other as in `update_with_samples`."""
    lines, J, M, V = problem.linearisation, knowledge.J, knowledge.M, knowledge.V
    for i in map(int, np.flatnonzero((problem.counts[k] > 0) & np.isfinite(lines.missing[k]))):
        row = _matrix(np.concatenate([lines.bias_loads[k, i], lines.state_rows[k, i]])[None])
        z = problem.nuisance.coloured.index(i) if i in problem.nuisance.coloured else None
        row = row if z is None else row + _column(M.transpose(), z).transpose()
        count = float(problem.counts[k, i]) if z is None and not problem.nuisance.loads(i) else 1.0
        w = arb(count) / ((arb(1) if z is None else V[z, z]) + arb(float(lines.missing[k, i])))
        J = (J + row.transpose() * row * w).mid()
        if z is not None:
            v = _column(V, z)
            M, V = (M - v * row * w).mid(), (V - v * v.transpose() * w).mid()
    return _Knowledge(J, M, V)


@dataclass(frozen=True, eq=False)
class _Exchange:
    """x = X y + Q t, as `InputExchange`; Q column by column."""

    X: arb_mat
    Q: list[arb_mat]


def _exchange(F: np.ndarray, B: np.ndarray) -> _Exchange:
    """Solve F x + B w = y for w and for as many of x as it takes, the others are t: Gauss and Jordan, the largest pivots.

    An input that moves nothing that those before it do not is passed over.
    """
    s, p = B.shape
    rows = [[arb(float(value)) for value in row] for row in np.hstack([B, F, np.eye(s)])]
    free_rows, state_of_row = set(range(s)), {}
    for j in range(p):
        row = max(free_rows, key=lambda i: abs(rows[i][j]))
        if abs(rows[row][j]) > _threshold() * arb(float(np.abs(B[:, j]).max())):
            free_rows.remove(row)
            _clear_column(rows, row, j)
    while free_rows:
        places = [(i, j) for i in free_rows for j in set(range(s)) - set(state_of_row.values())]
        row, state = max(places, key=lambda place: abs(rows[place[0]][p + place[1]]))
        if rows[row][p + state].is_zero():
            raise InputError("a step ties states together whatever its unknown inputs are: what is known of them is not finite")
        free_rows.remove(row)
        state_of_row[row] = state
        _clear_column(rows, row, p + state)
    return _exchange_of([row[p:] for row in rows], state_of_row)


def _exchange_of(rows: list[list[arb]], state_of_row: dict[int, int]) -> _Exchange:
    """Read the solution from rows of (x, y) in which each of the states given has the entry 1 of a column of the identity."""
    s = len(rows)
    free = [j for j in range(s) if j not in state_of_row.values()]
    X, Q = arb_mat(s, s), [arb_mat(s, 1, [int(i == t) for i in range(s)]) for t in free]
    for row, state in state_of_row.items():
        for j in range(s):
            X[state, j] = rows[row][s + j]
        for q, t in zip(Q, free, strict=True):
            q[state, 0] = -rows[row][t]
    return _Exchange(X, Q)


def _clear_column(rows: list[list[arb]], pivot_row: int, column: int) -> None:
    """Make the column that of the identity, 1 in the pivot's row; in place."""
    pivot = rows[pivot_row][column]
    rows[pivot_row] = [(value / pivot).mid() for value in rows[pivot_row]]
    for i, row in enumerate(rows):
        factor = row[column]
        if i != pivot_row and not factor.is_zero():
            rows[i] = [(value - factor * other).mid() for value, other in zip(row, rows[pivot_row], strict=True)]
            rows[i][column] = arb(0)


def _root_about_state(J: arb_mat, c: int) -> np.ndarray:
    """Return R (n, n), upper triangular, of the Schur complement of the first c: a row is 0 where half of the digits are gone."""
    s = J.nrows()
    rows, R = [[J[i, j] for j in range(s)] for i in range(s)], np.zeros((s, s))
    for i in range(s):
        pivot = rows[i][i]
        if not pivot > J[i, i] * _threshold():
            continue
        root = pivot.sqrt()
        R[i, i:] = [float((value / root).mid()) for value in rows[i][i:]]
        for j in range(i + 1, s):
            factor = (rows[i][j] / pivot).mid()
            rows[j][j:] = [(value - factor * other).mid() for value, other in zip(rows[j][j:], rows[i][j:], strict=True)]
    return R[c:, c:]


def _threshold() -> arb:
    """Half of the digits: what is less beside what it is made of is nothing."""
    return arb(2) ** (-ctx.prec // 2)


def _column(A: arb_mat, j: int) -> arb_mat:
    return arb_mat(A.nrows(), 1, [A[i, j] for i in range(A.nrows())])


def _matrix(values: np.ndarray) -> arb_mat:
    rows, columns = values.shape
    return arb_mat(rows, columns, [arb(float(value)) for value in values.ravel()])
