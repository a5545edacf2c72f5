"""A path and the weights of its sensors as one program: bilinear in the two."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from obsdesign.design.nlp.abstract import AbstractProgram
from obsdesign.design.nlp.evaluation import Multipliers, Slopes, Values
from obsdesign.design.nlp.program import Program
from obsdesign.information.accumulation import segment_information
from obsdesign.trajectory import Trajectory


class Relaxed(AbstractProgram):
    """W(p, s) = sum_ks s_ks W_ks(p) over v = (p, s): weights s (K, S) in [0, 1], at most `per_segment` in sum for each segment.

    The Hessian of <Z, W> is that of the path at fixed weights, <Z, dW_ks/dp> beside it, and 0 for the weights alone.
    The problem has no weights of its own, no floor, and one path to judge. Nothing changes after construction.
    """

    def __init__(self, program: Program, segments: int, per_segment: int) -> None:
        self.problem, self._inner = program.problem, program
        self._shape = segments, len(program.problem.system.model.channels)
        self._most, count = per_segment, segments * self._shape[1]
        self.lower = np.concatenate([program.lower, np.zeros(count)])
        self.upper = np.concatenate([program.upper, np.ones(count)])
        self._sums = np.kron(np.eye(segments), np.ones(self._shape[1]))

    def joined(self, p: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Return v of parameters p (q,) and weights (K, S)."""
        return np.concatenate([p, weights.ravel()])

    def parted(self, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return p (q,) and weights (K, S)."""
        q = self._inner.q
        return v[:q], v[q:].reshape(self._shape)

    def at(self, p: np.ndarray) -> Values:
        path, weights = self.parted(p)
        values = self._inner.at(path, self._inner.due(weights))
        return replace(values, p=p, rows=np.concatenate([values.rows, self._most - weights.sum(axis=1)]))

    def slopes(self, values: Values) -> Slopes:
        inner = self._inner.slopes(self._of_path(values))
        count = self._sums.shape[1]
        rows = np.block([[inner.rows, np.zeros((len(inner.rows), count))], [np.zeros((len(self._sums), self._inner.q)), -self._sums]])
        matrices = np.concatenate([inner.matrices, self._blocks(values)[None]], axis=1)
        floors = np.zeros((0, len(self.lower), *inner.matrices.shape[2:]))
        return replace(inner, matrices=matrices, floors=floors, rows=rows, price=np.concatenate([inner.price, np.zeros(count)]))

    def curvature(self, values: Values, slopes: Slopes, multipliers: Multipliers) -> np.ndarray:
        inner, (K, S), q = self._of_path(values), self._shape, self._inner.q
        H = np.zeros((len(self.lower),) * 2)
        H[:q, :q] = self._inner.curvature(inner, slopes, multipliers)
        mixed = self._inner.mixed(inner, slopes, multipliers.matrices[0])
        H[q:, :q] = mixed.reshape(K, -1, S, q).sum(axis=1).reshape(K * S, q)
        H[:q, q:] = H[q:, :q].T
        return H

    def _of_path(self, values: Values) -> Values:
        return replace(values, p=self.parted(values.p)[0])

    def _blocks(self, values: Values) -> np.ndarray:
        """S W_ks S (K S, n, n): what the matrix gains with each weight."""
        problem, along = self.problem, values.along
        x = along.z[0, :, : len(problem.x0)]
        path = Trajectory(np.arange(len(x)) * problem.step, x, np.ascontiguousarray(along.u[0]))
        blocks = problem.scaled(segment_information(problem.system, path, self._shape[0]))
        return blocks.reshape(-1, *blocks.shape[2:])
