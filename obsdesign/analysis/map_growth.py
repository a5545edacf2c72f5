"""How far what outputs of a map tell about its state grows with the number of samples, and where that has ended.

Along a solution x_0, x_1, ... let V_k(x_0) be the changes of the state that no output y_0, ..., y_k shows, for some change of the unknown
inputs: V_k+1(x_0) = ker C_0 and what A_0 takes, but for im B_0, to V_k(x_1). If for k the dimension of V_k+1(x_j) is that of V_k(x_j) at
x_0, x_1, ..., x_J, it is so for all larger k, where the solution's random states after J steps are random ones of the set in which x_J
is: of the images M_j of all states under j steps. With M_1 part of M_0 or M_0 part of M_1 these sets follow upon each other, and the
first that has the dimension of the next is the last: M_0 is part of M_1 where it is a state that rests without inputs, and where the map
is onto and M_0 all states, several times each. No more than a stall at x_0 is no end: x+ = (0, d, b, a), y = (a, a b, c) has
dimension 3, 3, 4.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from obsdesign.analysis.experiments import Experiments
from obsdesign.rank.graph import evaluate
from obsdesign.rank.residues import modular_matrix, modular_rank, row_basis

Rows = list[list[Any]]


@dataclass(frozen=True, eq=False)
class MapSolutions:
    """Solutions from one state under several sequences of known inputs and one of unknown inputs, modulo the prime.

    A, U, B, C: for each solution and each step the derivatives of next state and outputs, as rows. is_point: whether that state is one
    that was asked about, not any; is_at_rest: whether it is the next one, too, where all inputs are 0.
    """

    A: tuple[tuple[Rows, ...], ...]
    U: tuple[tuple[Rows, ...], ...]
    B: tuple[tuple[Rows, ...], ...]
    C: tuple[tuple[Rows, ...], ...]
    is_point: bool
    is_at_rest: bool = False

    @property
    def count(self) -> int:
        """Number of solutions."""
        return len(self.A)

    @property
    def n(self) -> int:
        """Number of states of each."""
        return len(self.A[0][0])

    def dimension(self, start: int, samples: int) -> int:
        """Return how much of what the solutions are at a step their outputs from there on tell: that many, and one."""
        rows, columns = self._rows(start, samples)
        return modular_rank(rows) - modular_rank([row[:columns] for row in rows])

    def rank(self, samples: int) -> int:
        """Return the rank of J, from the first step on."""
        return modular_rank(self._rows(0, samples)[0])

    def _rows(self, start: int, samples: int) -> tuple[Rows, int]:
        """J from a step on, and how many of its columns are those of unknown inputs, which come first."""
        joint, width = (1, self.n) if start == 0 else (self.count, self.count * self.n)
        p = len(self.B[0][0][0])
        rows: Rows = []
        for i in range(self.count):
            first = 0 if joint == 1 else i * self.n
            X = [[int(j == p * samples + first + row) for j in range(p * samples + width)] for row in range(self.n)]
            for k in range(samples + 1):
                rows += _product(self.C[i][start + k], X)
                if k < samples:
                    X = _product(self.A[i][start + k], X)
                    for row, entries in zip(X, self.B[i][start + k], strict=True):
                        for j, entry in enumerate(entries):
                            row[p * k + j] = entry
        return rows, p * samples

    def settles_at(self) -> int | None:
        """Return the step J from which on the solutions' states are random ones of one set; None where that is not seen."""
        size = self.count * self.n
        T: Rows = [] if self.is_point else [[int(i % self.n == j) for i in range(size)] for j in range(self.n)]
        dimensions = [len(T)]
        for k in range(len(self.A[0]) - 1):
            T = self._image(T, k)
            dimensions.append(len(T))
        is_onto = modular_rank(self._image([[int(i == j) for i in range(size)] for j in range(size)], 0)) == size
        if self.is_point and not self.is_at_rest:
            return next((j for j, dimension in enumerate(dimensions) if dimension == size), None) if is_onto else None
        if self.count > 1 and not is_onto and not self.is_point:
            return None
        return next((j for j in range(len(dimensions) - 1) if dimensions[j] == dimensions[j + 1]), None)

    def _image(self, T: Rows, k: int) -> Rows:
        """The tangent space, by rows, of what the states may be a step later, where at step k they may change along the rows of T."""
        n, vectors = self.n, []
        for row in T:
            parts = [_product(self.A[i][k], [[entry] for entry in row[i * n : (i + 1) * n]]) for i in range(self.count)]
            vectors.append([entry for part in parts for (entry,) in part])
        for i in range(self.count):
            for column in zip(*self.U[i][k], strict=True):
                vectors.append([*[0] * (i * n), *column, *[0] * ((self.count - i - 1) * n)])
        vectors += [[entry for i in range(self.count) for entry in columns[i]] for columns in self._disturbances(k)]
        return row_basis(vectors)

    def _disturbances(self, k: int) -> Sequence[Sequence[Sequence[Any]]]:
        p = len(self.B[0][k][0])
        return [[[row[j] for row in self.B[i][k]] for i in range(self.count)] for j in range(p)]


def solutions_of(experiments: Experiments, steps: int, *, is_point: bool) -> MapSolutions:
    """Return the solutions of experiments with a map, modulo the prime, over so many steps. Raises ZeroDivisionError at a pole."""
    flow, arithmetic = experiments.equations.map_flow, experiments.point.arithmetic
    matrices: dict[str, list[tuple[Rows, ...]]] = {name: [] for name in "AUBC"}
    for i in range(experiments.count):
        arguments = experiments.arguments(i)
        x, along = list(arguments.x), {name: [] for name in "AUBC"}
        for k in range(steps):
            at_step = flow.at_step(x, arguments, k)
            for name, values in along.items():
                matrix = flow.matrix(name, arithmetic, at_step)
                values.append(matrix.tolist() if matrix.ncols() else [[] for _ in range(matrix.nrows())])
            x = evaluate(flow.graphs["F"][1], at_step, arithmetic)
        for name, values in along.items():
            matrices[name].append(tuple(values))
    first, zero = experiments.arguments(0), arithmetic.number(0)
    idle = [first.x, [zero] * flow.u.numel(), [zero] * flow.w.numel(), first.constants]
    is_at_rest = is_point and all(a == b for a, b in zip(first.x, evaluate(flow.graphs["F"][1], idle, arithmetic), strict=True))
    return MapSolutions(*(tuple(matrices[name]) for name in "AUBC"), is_point=is_point, is_at_rest=is_at_rest)


def _product(first: Rows, second: Rows) -> Rows:
    if not first or not first[0]:
        return [[0] * len(second[0]) for _ in first]
    a, b = (modular_matrix(rows, len(rows[0])) for rows in (first, second))
    return (a * b).tolist()
