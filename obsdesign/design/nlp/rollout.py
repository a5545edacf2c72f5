"""First and second derivatives of a recursion along a path, step by step: cost linear in the number of steps."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from obsdesign.design.nlp.information_recursion import Recursion
from obsdesign.dynamics.scan import Scan, Spread
from obsdesign.packing import packed, symmetric

_LARGE = 36  # entries of z above which products of matrices take less time than the graph that they would make


@dataclass(frozen=True, eq=False)
class Along:
    """M runs of N steps: z (M, N+1, c) with the state first, u (M, N, m), due (N, s) or (M, N, s)."""

    z: np.ndarray
    u: np.ndarray
    due: np.ndarray


@dataclass(frozen=True, eq=False)
class Linear:
    """dz_k+1 = A dz_k + B du_k, d gain_k = D dz_k: A (M, N, c, c), B (M, N, c, m), D (M, N, b, c)."""

    A: np.ndarray
    B: np.ndarray
    D: np.ndarray


@dataclass(frozen=True, eq=False)
class Injected:
    """Costs of single nodes beside the recursion's: gradient g (M, N+1, v) and Hessian H (M, N+1, v, v) to v = (x, u) there."""

    g: np.ndarray
    H: np.ndarray


@dataclass(frozen=True, eq=False)
class Second:
    """Second derivatives of a sum over the path: K (M, N, m, c), R (M, N, m, m), slope (M, N, m) to the inputs.

    d2 = sum_k du_k' (R_k du_k + 2 K_k dz_k) where dz_k is what earlier inputs did. first (M, c), start (M, c, c): gradient and
    Hessian to z_0 with all inputs kept.
    """

    K: np.ndarray
    R: np.ndarray
    slope: np.ndarray
    first: np.ndarray
    start: np.ndarray


class Variation:
    """The compiled walks of one recursion."""

    def __init__(self, recursion: Recursion, n: int) -> None:
        one = self._one = recursion
        self.n, self.c, self.m = n, one.z.numel(), one.u.numel()
        self.b = one.gain.numel()
        self._is_large = self.c > _LARGE
        self._forward = Scan(one.z, [one.u, one.due], one.z_next, [one.gain])
        parts = (ca.jacobian(one.z_next, one.z), ca.jacobian(one.z_next, one.u), ca.jacobian(one.gain, one.z))
        empty = ca.SX(0, 1)
        self._linear = Scan(empty, [one.z, one.u, one.due], empty, [_spread(part) for part in parts], shared=not self._is_large)
        self._backward = self._bends() if self._is_large else self._second_order()

    def along(self, starts: np.ndarray, u: np.ndarray, due: np.ndarray) -> tuple[Along, np.ndarray]:
        """Walk from states (M, n) with inputs (N, m) or (M, N, m); return the walk and the sums of the gains (M, b)."""
        runs, steps = len(starts), u.shape[-2]
        first = np.hstack([starts, np.tile(self._one.start, (runs, 1))])
        run = self._forward.run(first, [u, due], steps)
        z = np.concatenate([first[:, None], run.carries], axis=1)
        return Along(z, np.broadcast_to(u, (runs, steps, self.m)), due), run.results[0].sum(axis=1)

    def linear(self, along: Along) -> Linear:
        """Return the derivatives of every step."""
        runs, steps = along.u.shape[:2]
        due = np.broadcast_to(along.due, (runs, steps, along.due.shape[-1]))
        rows = [_flat(along.z[:, :-1]), _flat(along.u), _flat(due)]
        A, B, D = self._linear.run(np.empty((1, 0)), rows, runs * steps, carries=False).results
        shape = (runs, steps)
        return Linear(A.reshape(*shape, self.c, self.c), B.reshape(*shape, self.c, self.m), D.reshape(*shape, self.b, self.c))

    def second(self, along: Along, weights: np.ndarray, injected: Injected | None) -> Second:
        """Return second derivatives of sum_k weights' gain_k, weights (M, b), plus what is injected at the nodes."""
        runs, steps, n, v = *along.u.shape[:2], self.n, self.n + self.m
        g, H = (np.zeros((runs, steps + 1, v)), np.zeros((runs, steps + 1, v, v))) if injected is None else (injected.g, injected.H)
        rows = [
            along.z[:, -2::-1],
            along.u[:, ::-1],
            along.due[..., ::-1, :],
            np.repeat(weights[:, None], steps, axis=1),
            g[:, -2::-1],
        ]
        slopes = np.hstack([g[:, -1, :n], np.zeros((runs, self.c - n))])
        K, R, slope, first, start = self._in_matrices(along, rows, slopes, H) if self._is_large else self._as_graph(rows, slopes, H)
        if g[:, -1, n:].any() or H[:, -1, n:].any():
            self._add_last(along, g[:, -1], H[:, -1], (K[:, -1], R[:, -1], slope[:, -1]))
        return Second(K, R, slope, first, start)

    def _as_graph(self, rows: list[np.ndarray], slopes: np.ndarray, H: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return K, R, slope, first and start of `Second`, all in one loop."""
        lower, inner, runs, steps = np.triu_indices(self.n + self.m), np.triu_indices(self.c), len(H), H.shape[1] - 1
        end = np.hstack([slopes, self._last(H)[:, inner[1], inner[0]]])
        run = self._backward.run(end, [*rows, H[:, -2::-1, lower[1], lower[0]]], steps, carries=False)
        K, R, slope = (values[:, ::-1].copy() for values in run.results)
        start = np.zeros((runs, self.c, self.c))
        start[:, inner[1], inner[0]] = start[:, inner[0], inner[1]] = run.carry[:, self.c :]
        shape = (runs, steps, self.m)
        return K.reshape(*shape, self.c), R.reshape(*shape, self.m), slope, run.carry[:, : self.c], start

    def _in_matrices(self, along: Along, rows: list[np.ndarray], slopes: np.ndarray, H: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return the same, the products with P as those of matrices."""
        (runs, steps), c, size = along.u.shape[:2], self.c, self.c + self.m
        run = self._backward.run(slopes, rows, steps, carries=False)
        bends, slope = (values[:, ::-1].copy() for values in run.results)
        bends = bends.reshape(runs, steps, size, size)
        place, linear, P = np.array([*range(self.n), *range(c, size)]), self.linear(along), self._last(H)
        bends[:, :, place[:, None], place] += H[:, :-1]
        for k in reversed(range(steps)):
            moves = np.concatenate([linear.A[:, k], linear.B[:, k]], axis=2)
            bends[:, k] += moves.swapaxes(1, 2) @ P @ moves
            P = bends[:, k, :c, :c]
        return bends[:, :, c:, :c], bends[:, :, c:, c:], slope, run.carry, P

    def _last(self, H: np.ndarray) -> np.ndarray:
        """P (M, c, c) at the last node."""
        P = np.zeros((len(H), self.c, self.c))
        P[:, : self.n, : self.n] = H[:, -1, : self.n, : self.n]
        return P

    def _add_last(self, along: Along, g: np.ndarray, H: np.ndarray, into: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
        """Add what depends on the last inputs at the last node, where dx_N = A dz_N-1 + B du_N-1, to K, R and slope of the last step."""
        n, (K, R, slope) = self.n, into
        last = self.linear(Along(along.z[:, -2:], along.u[:, -1:], along.due[..., -1:, :]))
        A, B, cross = last.A[:, 0, :n], last.B[:, 0, :n], H[:, n:, :n]
        K += cross @ A
        R += H[:, n:, n:] + cross @ B + (cross @ B).swapaxes(1, 2)
        slope += g[:, n:]

    def _second_order(self) -> Scan:
        """(lambda, P)_k+1 -> (lambda, P)_k with h = weights' gain + lambda' z_next + what is injected.

        P = h_zz + A'P A, K = h_uz + B'P A, R = h_uu + B'P B.
        """
        one, n, v = self._one, self.n, self.n + self.m
        later, (P, entries) = ca.SX.sym("lambda", self.c), symmetric("P", self.c)
        weights, g, (H, spots) = ca.SX.sym("weights", self.b), ca.SX.sym("g", v), symmetric("H", v)
        both = ca.vertcat(one.z, one.u)
        potential = ca.dot(weights, one.gain) + ca.dot(later, one.z_next)
        bend, slope = ca.hessian(potential, both)
        A, B = ca.jacobian(one.z_next, one.z), ca.jacobian(one.z_next, one.u)
        c = self.c
        place = [*range(n), *range(c, c + self.m)]
        slope, bend = ca.densify(slope), ca.densify(bend)
        slope[place] += g
        for i, row in enumerate(place):
            for j, column in enumerate(place):
                bend[row, column] += H[i, j]
        K = bend[c:, :c] + B.T @ P @ A
        R = bend[c:, c:] + B.T @ P @ B
        P_now = bend[:c, :c] + A.T @ P @ A
        carry_next = ca.vertcat(slope[:c], packed(P_now))
        results = [ca.vec(K.T), ca.vec(R), slope[c:]]
        return Scan(ca.vertcat(later, entries), [one.z, one.u, one.due, weights, g, spots], carry_next, results)

    def _bends(self) -> Scan:
        """lambda_k+1 -> lambda_k; results: the Hessian of weights' gain + lambda' z_next to (z, u), without the products with P."""
        one, n = self._one, self.n
        later, weights, g = ca.SX.sym("lambda", self.c), ca.SX.sym("weights", self.b), ca.SX.sym("g", n + self.m)
        bend, slope = ca.hessian(ca.dot(weights, one.gain) + ca.dot(later, one.z_next), ca.vertcat(one.z, one.u))
        slope = ca.densify(slope)
        slope[[*range(n), *range(self.c, self.c + self.m)]] += g
        return Scan(later, [one.z, one.u, one.due, weights, g], slope[: self.c], [_spread(bend), slope[self.c :]], shared=False)


def carried(linear: Linear, first: np.ndarray, M: np.ndarray) -> np.ndarray:
    """Return G (M, N+1, c, q), dz_k/dp, from first (M, c, q) with inputs du_k = M_k dp, M (N, m, q) or (M, N, m, q)."""
    runs, steps, c, _ = linear.A.shape
    G = np.empty((runs, steps + 1, c, first.shape[-1]))
    G[:, 0] = first
    pushed = linear.B @ M
    if runs == 1:  # fewer dimensions: half the time
        A, one, push = linear.A[0], G[0], pushed[0]
        for k in range(steps):
            np.dot(A[k], one[k], out=one[k + 1])
            one[k + 1] += push[k]
        return G
    for k in range(steps):
        np.matmul(linear.A[:, k], G[:, k], out=G[:, k + 1])
        G[:, k + 1] += pushed[:, k]
    return G


def _spread(matrix: ca.SX) -> Spread:
    """Return a matrix for an array, row by row, each entry computed once and zeros not at all."""
    rows, columns = matrix.shape
    place = np.full((rows, columns), matrix.nnz())
    place[np.array(matrix.sparsity().row(), dtype=int), np.array(matrix.sparsity().get_triplet()[1], dtype=int)] = np.arange(matrix.nnz())
    return Spread(ca.vertcat(matrix.nz[:], 0), place.ravel())


def _flat(values: np.ndarray) -> np.ndarray:
    return values.reshape(-1, values.shape[-1])
