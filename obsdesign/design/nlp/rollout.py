"""First and second derivatives of a recursion along a path, step by step: cost linear in the number of steps."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from obsdesign.design.nlp.information_recursion import InformationRecursion
from obsdesign.design.nlp.sensitivity import Linearisation
from obsdesign.dynamics.scan import ExpandedColumn, Scan
from obsdesign.packing import lower_indices, pack, symmetric

_LARGE = 36  # entries of z above which products of matrices take less time than the graph that they would make


@dataclass(frozen=True, eq=False)
class Rollout:
    """M runs of N steps: z (M, N+1, c) with the state first, u (M, N, m), due (N, s) or (M, N, s)."""

    z: np.ndarray
    u: np.ndarray
    due: np.ndarray


@dataclass(frozen=True, eq=False)
class NodeCosts:
    """Costs of single nodes beside the recursion's: gradient g (M, N+1, v) and Hessian H (M, N+1, v, v) to v = (x, u) there."""

    g: np.ndarray
    H: np.ndarray


@dataclass(frozen=True, eq=False)
class SecondDerivatives:
    """Second derivatives of a sum over the path: K (M, N, m, c), R (M, N, m, m), input_gradient (M, N, m) to the inputs.

    d2 = sum_k du_k' (R_k du_k + 2 K_k dz_k) where dz_k is what earlier inputs did. initial_gradient (M, c), initial_hessian (M, c, c):
    gradient and Hessian to z_0 with all inputs kept.
    """

    K: np.ndarray
    R: np.ndarray
    input_gradient: np.ndarray
    initial_gradient: np.ndarray
    initial_hessian: np.ndarray


class RolloutFunctions:
    """The compiled walks of one recursion."""

    def __init__(self, recursion: InformationRecursion, n: int) -> None:
        step = self._recursion = recursion
        self.n, self.c, self.m = n, step.z.numel(), step.u.numel()
        self.b = step.gain.numel()
        self._is_large = self.c > _LARGE
        self._forward = Scan(step.z, [step.u, step.due], step.z_next, [step.gain])
        parts = (ca.jacobian(step.z_next, step.z), ca.jacobian(step.z_next, step.u), ca.jacobian(step.gain, step.z))
        empty = ca.SX(0, 1)
        self._linear = Scan(empty, [step.z, step.u, step.due], empty, [_spread(part) for part in parts], share=not self._is_large)
        self._backward = self._hessian_scan() if self._is_large else self._second_order_scan()

    def roll_out(self, starts: np.ndarray, u: np.ndarray, due: np.ndarray) -> tuple[Rollout, np.ndarray]:
        """Walk from states (M, n) with inputs (N, m) or (M, N, m); return the walk and the gains (M, N, b)."""
        runs, steps = len(starts), u.shape[-2]
        initial = np.hstack([starts, np.tile(self._recursion.start, (runs, 1))])
        run = self._forward.run(initial, [u, due], steps)
        z = np.concatenate([initial[:, None], run.carries], axis=1)
        return Rollout(z, np.broadcast_to(u, (runs, steps, self.m)), due), run.results[0]

    def linearise(self, rollout: Rollout) -> Linearisation:
        """Return the derivatives of every step."""
        runs, steps = rollout.u.shape[:2]
        due = np.broadcast_to(rollout.due, (runs, steps, rollout.due.shape[-1]))
        rows = [_flat(rollout.z[:, :-1]), _flat(rollout.u), _flat(due)]
        A, B, D = self._linear.run(np.empty((1, 0)), rows, runs * steps, carries=False).results
        shape = (runs, steps)
        return Linearisation(A.reshape(*shape, self.c, self.c), B.reshape(*shape, self.c, self.m), D.reshape(*shape, self.b, self.c))

    def second_derivatives(self, rollout: Rollout, weights: np.ndarray, node_costs: NodeCosts | None) -> SecondDerivatives:
        """Return second derivatives of sum_k weights_k' gain_k, weights (M, N, b) or (M, 1, b), plus what is injected at the nodes."""
        runs, steps, n, v = *rollout.u.shape[:2], self.n, self.n + self.m
        g, H = (np.zeros((runs, steps + 1, v)), np.zeros((runs, steps + 1, v, v))) if node_costs is None else (node_costs.g, node_costs.H)
        rows = [
            rollout.z[:, -2::-1],
            rollout.u[:, ::-1],
            rollout.due[..., ::-1, :],
            np.ascontiguousarray(np.broadcast_to(weights, (runs, steps, self.b))[:, ::-1]),
            g[:, -2::-1],
        ]
        costate = np.hstack([g[:, -1, :n], np.zeros((runs, self.c - n))])
        K, R, gradient, initial_gradient, initial_hessian = (
            self._backward_by_matrices(rollout, rows, costate, H) if self._is_large else self._backward_by_graph(rows, costate, H)
        )
        if g[:, -1, n:].any() or H[:, -1, n:].any():
            self._add_last(rollout, g[:, -1], H[:, -1], (K[:, -1], R[:, -1], gradient[:, -1]))
        return SecondDerivatives(K, R, gradient, initial_gradient, initial_hessian)

    def _backward_by_graph(self, rows: list[np.ndarray], costate: np.ndarray, H: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return K, R, slope, first and start of `SecondDerivatives`, all in one loop."""
        (row, column), (inner_row, inner_column) = lower_indices(self.n + self.m), lower_indices(self.c)
        runs, steps = len(H), H.shape[1] - 1
        end = np.hstack([costate, self._last(H)[:, inner_row, inner_column]])
        run = self._backward.run(end, [*rows, H[:, -2::-1, row, column]], steps, carries=False)
        K, R, gradient = (values[:, ::-1].copy() for values in run.results)
        initial_hessian = np.zeros((runs, self.c, self.c))
        initial_hessian[:, inner_row, inner_column] = initial_hessian[:, inner_column, inner_row] = run.carry[:, self.c :]
        shape = (runs, steps, self.m)
        return K.reshape(*shape, self.c), R.reshape(*shape, self.m), gradient, run.carry[:, : self.c], initial_hessian

    def _backward_by_matrices(self, rollout: Rollout, rows: list[np.ndarray], costate: np.ndarray, H: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return the same, the products with P as those of matrices."""
        (runs, steps), c, size = rollout.u.shape[:2], self.c, self.c + self.m
        run = self._backward.run(costate, rows, steps, carries=False)
        hessians, gradient = (values[:, ::-1].copy() for values in run.results)
        hessians = hessians.reshape(runs, steps, size, size)
        positions, linearisation, P = np.array([*range(self.n), *range(c, size)]), self.linearise(rollout), self._last(H)
        hessians[:, :, positions[:, None], positions] += H[:, :-1]
        for k in reversed(range(steps)):
            jacobian = np.concatenate([linearisation.A[:, k], linearisation.B[:, k]], axis=2)
            hessians[:, k] += jacobian.swapaxes(1, 2) @ P @ jacobian
            P = hessians[:, k, :c, :c]
        return hessians[:, :, c:, :c], hessians[:, :, c:, c:], gradient, run.carry, P

    def _last(self, H: np.ndarray) -> np.ndarray:
        """P (M, c, c) at the last node."""
        P = np.zeros((len(H), self.c, self.c))
        P[:, : self.n, : self.n] = H[:, -1, : self.n, : self.n]
        return P

    def _add_last(self, rollout: Rollout, g: np.ndarray, H: np.ndarray, into: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
        """Add what depends on the last inputs at the last node, where dx_N = A dz_N-1 + B du_N-1, to K, R and slope of the last step."""
        n, (K, R, gradient) = self.n, into
        last = self.linearise(Rollout(rollout.z[:, -2:], rollout.u[:, -1:], rollout.due[..., -1:, :]))
        A, B, cross = last.A[:, 0, :n], last.B[:, 0, :n], H[:, n:, :n]
        K += cross @ A
        R += H[:, n:, n:] + cross @ B + (cross @ B).swapaxes(1, 2)
        gradient += g[:, n:]

    def _second_order_scan(self) -> Scan:
        """(lambda, P)_k+1 -> (lambda, P)_k with h = weights' gain + lambda' z_next + what is injected.

        P = h_zz + A'P A, K = h_uz + B'P A, R = h_uu + B'P B.
        """
        step, n, v = self._recursion, self.n, self.n + self.m
        costate, (P, entries) = ca.SX.sym("lambda", self.c), symmetric("P", self.c)
        weights, g, (H, node_entries) = ca.SX.sym("weights", self.b), ca.SX.sym("g", v), symmetric("H", v)
        variables = ca.vertcat(step.z, step.u)
        potential = ca.dot(weights, step.gain) + ca.dot(costate, step.z_next)
        hessian, gradient = ca.hessian(potential, variables)
        A, B = ca.jacobian(step.z_next, step.z), ca.jacobian(step.z_next, step.u)
        c = self.c
        positions = [*range(n), *range(c, c + self.m)]
        gradient, hessian = ca.densify(gradient), ca.densify(hessian)
        gradient[positions] += g
        for i, row in enumerate(positions):
            for j, column in enumerate(positions):
                hessian[row, column] += H[i, j]
        K = hessian[c:, :c] + B.T @ P @ A
        R = hessian[c:, c:] + B.T @ P @ B
        P_now = hessian[:c, :c] + A.T @ P @ A
        carry_next = ca.vertcat(gradient[:c], pack(P_now))
        results = [ca.vec(K.T), ca.vec(R), gradient[c:]]
        return Scan(ca.vertcat(costate, entries), [step.z, step.u, step.due, weights, g, node_entries], carry_next, results)

    def _hessian_scan(self) -> Scan:
        """lambda_k+1 -> lambda_k; results: the Hessian of weights' gain + lambda' z_next to (z, u), without the products with P."""
        step, n = self._recursion, self.n
        costate, weights, g = ca.SX.sym("lambda", self.c), ca.SX.sym("weights", self.b), ca.SX.sym("g", n + self.m)
        hessian, gradient = ca.hessian(ca.dot(weights, step.gain) + ca.dot(costate, step.z_next), ca.vertcat(step.z, step.u))
        gradient = ca.densify(gradient)
        gradient[[*range(n), *range(self.c, self.c + self.m)]] += g
        return Scan(
            costate, [step.z, step.u, step.due, weights, g], gradient[: self.c], [_spread(hessian), gradient[self.c :]], share=False
        )


def _spread(matrix: ca.SX) -> ExpandedColumn:
    """Return a matrix for an array, row by row, each entry computed once and zeros not at all."""
    rows, columns = matrix.shape
    positions = np.full((rows, columns), matrix.nnz())
    positions[np.array(matrix.sparsity().row(), dtype=int), np.array(matrix.sparsity().get_triplet()[1], dtype=int)] = np.arange(
        matrix.nnz()
    )
    return ExpandedColumn(ca.vertcat(matrix.nz[:], 0), positions.ravel())


def _flat(values: np.ndarray) -> np.ndarray:
    return values.reshape(-1, values.shape[-1])
