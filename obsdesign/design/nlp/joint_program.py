"""A path and the weights of its sensors as one program: bilinear in the two."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from obsdesign.design.nlp.evaluation import Derivatives, Evaluation
from obsdesign.design.nlp.program import Program
from obsdesign.design.sqp.evaluation import Multipliers
from obsdesign.design.sqp.nonlinear_program import AbstractProgram
from obsdesign.information.accumulation import segment_information
from obsdesign.trajectory import Trajectory


class JointProgram(AbstractProgram[Evaluation, Derivatives]):
    """W(p, s) = sum_ks s_ks W_ks(p) over v = (p, s): weights s (K, S) in [0, 1], at most `per_segment` in sum for each segment.

    The Hessian of <Z, W> is that of the path at fixed weights, <Z, dW_ks/dp> beside it, and 0 for the weights alone.
    The problem has no weights of its own, no floor, and one path to judge. Nothing changes after construction.
    """

    def __init__(self, program: Program, segments: int, per_segment: int) -> None:
        self.problem, self._path_program = program.problem, program
        self._shape = segments, len(program.problem.system.model.channels)
        self._per_segment, count = per_segment, segments * self._shape[1]
        self.lower = np.concatenate([program.lower, np.zeros(count)])
        self.upper = np.concatenate([program.upper, np.ones(count)])
        self._segment_sums = np.kron(np.eye(segments), np.ones(self._shape[1]))

    @property
    def floor_level(self) -> float:
        """There are no floors."""
        return 1.0

    def join(self, p: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Return v of parameters p (q,) and weights (K, S)."""
        return np.concatenate([p, weights.ravel()])

    def split(self, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return p (q,) and weights (K, S)."""
        q = self._path_program.q
        return v[:q], v[q:].reshape(self._shape)

    def evaluate(self, p: np.ndarray) -> Evaluation:
        """Return the path's evaluation under the weights, with the rows per_segment - sum_s s_ks beside its own."""
        path, weights = self.split(p)
        evaluation = self._path_program.evaluate(path, self._path_program.due(weights))
        return replace(evaluation, p=p, rows=np.concatenate([evaluation.rows, self._per_segment - weights.sum(axis=1)]))

    def derivatives(self, evaluation: Evaluation) -> Derivatives:
        """Return the path's derivatives, and beside them dW/ds_ks = W_ks and the constant slopes of the sums of weights."""
        derivatives = self._path_program.derivatives(self._path_evaluation(evaluation))
        count = self._segment_sums.shape[1]
        rows = np.block(
            [
                [derivatives.rows, np.zeros((len(derivatives.rows), count))],
                [np.zeros((len(self._segment_sums), self._path_program.q)), -self._segment_sums],
            ]
        )
        matrices = np.concatenate([derivatives.matrices, self._blocks(evaluation)[None]], axis=1)
        floors = np.zeros((0, len(self.lower), *derivatives.matrices.shape[2:]))
        return replace(derivatives, matrices=matrices, floors=floors, rows=rows, price=np.concatenate([derivatives.price, np.zeros(count)]))

    def lagrangian_hessian(self, evaluation: Evaluation, derivatives: Derivatives, multipliers: Multipliers) -> np.ndarray:
        """Return [[H_path, C'], [C, 0]] with C = <Z, dW_ks/dp>, summed over the steps of each segment."""
        inner, (K, S), q = self._path_evaluation(evaluation), self._shape, self._path_program.q
        H = np.zeros((len(self.lower),) * 2)
        H[:q, :q] = self._path_program.lagrangian_hessian(inner, derivatives, multipliers)
        cross = self._path_program.cross_derivatives(inner, derivatives, multipliers.matrices[0])
        H[q:, :q] = cross.reshape(K, -1, S, q).sum(axis=1).reshape(K * S, q)
        H[:q, q:] = H[q:, :q].T
        return H

    def _path_evaluation(self, evaluation: Evaluation) -> Evaluation:
        return replace(evaluation, p=self.split(evaluation.p)[0])

    def _blocks(self, evaluation: Evaluation) -> np.ndarray:
        """S W_ks S (K S, n, n): what the matrix gains with each weight."""
        problem, rollout = self.problem, evaluation.rollout
        x = rollout.z[0, :, : len(problem.x0)]
        path = Trajectory(np.arange(len(x)) * problem.step, x, np.ascontiguousarray(rollout.u[0]))
        blocks = problem.scaled(segment_information(problem.system, path, self._shape[0]))
        return blocks.reshape(-1, *blocks.shape[2:])
