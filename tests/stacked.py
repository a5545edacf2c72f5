"""All samples at once: the reference for what is known of a state, by Gaussian conditioning with 4,000 bits."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import casadi as ca
import numpy as np
from flint import arb, arb_mat, ctx

import obsdesign as od
from obsdesign.dynamics.simulation import all_inputs_along, substeps_along
from obsdesign.dynamics.step import step_of

_BITS = 4000
_UNKNOWN = 10**40  # variance of an input of which nothing is known: its limit is reached to 1e-30


@dataclass(frozen=True)
class Output:
    """One output along a path: spread (N,), inflated; extra (N,), variance of what is white beside it; steps between samples."""

    spread: np.ndarray
    extra: np.ndarray
    correlation: float
    bias: float
    period: int


@contextmanager
def long_numbers(bits: int = _BITS) -> Iterator[None]:
    before, ctx.prec = ctx.prec, bits
    try:
        yield
    finally:
        ctx.prec = before


def exact(values: np.ndarray) -> arb_mat:
    """Numbers as they stand."""
    return arb_mat([[arb(float(value)) for value in row] for row in values])


def doubles(A: arb_mat) -> np.ndarray:
    return np.array([[float(A[i, j]) for j in range(A.ncols())] for i in range(A.nrows())])


@dataclass(frozen=True)
class Stacked:
    """x_(k+1) = F_k x_k + kicks_k e_k; x_0 ~ N(., prior); e ~ N(0, 1), the first `unknown` of each step anything.

    Sample i at t_k is C_k[i] x_k plus an error; R (q, q): correlation of the outputs' first-order errors at one instant.
    """

    F: Sequence[np.ndarray]
    kicks: Sequence[np.ndarray]
    unknown: int
    prior: np.ndarray
    C: np.ndarray
    outputs: Sequence[Output]
    R: np.ndarray

    def information(self, k: int, on: np.ndarray) -> np.ndarray:
        """J (n, n) about x_k of the samples of on (N, q) up to t_k; at k = N of all."""
        with long_numbers():
            states, Sigma = self._states()
            return doubles(self._covariance_of(states[k], k, on, states, Sigma).inv())

    def input_information(self, k: int, on: np.ndarray) -> np.ndarray:
        """About the unknown part of e_k, of all samples of on (N, q), other inputs and the state being unknown too."""
        (n, r), N = self.kicks[0].shape, len(self.F)
        with long_numbers():
            states, Sigma = self._states()
            picked = exact(np.eye(n + N * r)[n + k * r : n + k * r + self.unknown])
            return doubles(self._covariance_of(picked, N, on, states, Sigma).inv())

    def _covariance_of(self, wanted: arb_mat, k: int, on: np.ndarray, states: Sequence[arb_mat], Sigma: arb_mat) -> arb_mat:
        """Of `wanted` times what everything is made of, given the samples up to t_k."""
        used = [(j, i) for j in range(min(k + 1, len(self.F))) for i in range(len(self.outputs)) if on[j, i]]
        P = wanted * Sigma * wanted.transpose()
        if not used:
            return P
        G = arb_mat([(exact(self.C[j][i : i + 1]) * states[j]).entries() for j, i in used])
        errors = arb_mat([[self._covariance(one, other) for other in used] for one in used])
        both = wanted * Sigma * G.transpose()
        return P - both * (G * Sigma * G.transpose() + errors).solve(both.transpose())

    def _states(self) -> tuple[list[arb_mat], arb_mat]:
        """All x_k (n, n + N r) in terms of (x_0, e_0, ...), and the covariance of these."""
        n, r = self.kicks[0].shape
        size = n + len(self.F) * r
        Sigma = exact(np.zeros((size, size)))
        for i in range(size):
            Sigma[i, i] = arb(_UNKNOWN) if i >= n and (i - n) % r < self.unknown else arb(1)
        for i, j in np.ndindex(n, n):
            Sigma[i, j] = arb(float(self.prior[i, j]))
        found = [exact(np.eye(n, size))]
        for k, (F, kicks) in enumerate(zip(self.F, self.kicks, strict=True)):
            step = np.zeros((n, size))
            step[:, n + k * r : n + (k + 1) * r] = kicks
            found.append(exact(F) * found[-1] + exact(step))
        return found, Sigma

    def _covariance(self, one: tuple[int, int], other: tuple[int, int]) -> arb:
        (k, i), (j, h) = one, other
        a, b = self.outputs[i], self.outputs[h]
        later = a if k >= j else b
        lasting = arb(float(self.R[i, h])) * arb(float(a.spread[k])) * arb(float(b.spread[j]))
        if k != j:
            lasting *= arb(later.correlation) ** (abs(k - j) // later.period) if i == h else 0  # joint noise is new at each instant
        if i == h:
            lasting += arb(a.bias) ** 2
            lasting += arb(float(a.extra[k])) if k == j else 0
        return lasting


def stacked(
    system: od.System, path: od.Trajectory, prior: od.Prior, psd: np.ndarray | None, unknown: Sequence[str]
) -> tuple[Stacked, np.ndarray]:
    """Of a system along a path, its steps and its noise at each place as they are; due (N, q): which output has a sample when."""
    one, model = step_of(system.model, path.step, substeps_along(system, path)), system.model
    move = ca.Function("move", [one.x, one.all_inputs], [ca.densify(one.F), ca.densify(one.B_w)])
    moves = [[each.full() for each in move(x, held)] for x, held in zip(path.x[:-1], all_inputs_along(system, path), strict=True)]
    names = [signal.name for signal in model.unknown_inputs]
    noise = np.zeros((path.x.shape[1], 0)) if psd is None else np.diag(np.sqrt(psd * path.step))
    kicks = [np.hstack([B[:, [names.index(name) for name in unknown]], noise]) for _, B in moves]
    slope = ca.Function("slope", [model.x], [ca.densify(ca.jacobian(model.h, model.x))])
    C = np.array([slope(x).full() for x in path.x[:-1]])
    outputs = [output for s in range(len(system.sensors)) for output in _outputs_of(system, path, s)]
    due = np.array([[k % output.period == 0 for output in outputs] for k in range(path.steps)])
    return Stacked([F for F, _ in moves], kicks, len(unknown), prior.covariance, C, outputs, _correlation(system)), due


def _outputs_of(system: od.System, path: od.Trajectory, s: int) -> Iterator[Output]:
    """e has inflation times the spread, of joint noise the root of its diagonal; a gate g stands for white (S^2 + b^2)(1 - g)/g."""
    sensor, x = system.sensors[s], path.x[:-1]
    own = np.full((path.steps, len(sensor.outputs)), sensor.sigma)
    if getattr(sensor, "sigma_per_metre", 0.0):
        r = np.hypot(*(np.array(sensor.beacon) - x[:, :2]).T)
        own = np.hypot(own, sensor.sigma_per_metre * r[:, None])
    for names, R in system.joint_noise.items():
        owner = [name for name in names for _ in system.sensors[system.sensor_names.index(name)].outputs]
        here = [i for i, name in enumerate(owner) if name == system.sensor_names[s]]
        if here:
            own = np.tile(np.sqrt(np.diag(R))[here], (path.steps, 1))
    channel = system.model.channels[s]
    gates = ca.Function("gate", [system.model.x], [channel.noise.gate])
    g = np.array([float(gates(state)) for state in x])
    period = 1 if sensor.rate is None else round(1 / (sensor.rate * path.step))
    for column in own.T:
        spread = sensor.inflation * column
        yield Output(spread, (spread**2 + sensor.bias_floor**2) * (1 - g) / g, sensor.correlation, sensor.bias_floor, period)


def _correlation(system: od.System) -> np.ndarray:
    owner = [name for name, sensor in zip(system.sensor_names, system.sensors, strict=True) for _ in sensor.outputs]
    found = np.eye(len(owner))
    for names, R in system.joint_noise.items():
        place = [i for name in names for i, other in enumerate(owner) if other == name]
        size = np.sqrt(np.diag(R))
        found[np.ix_(place, place)] = np.asarray(R) / np.outer(size, size)
    np.fill_diagonal(found, 1.0)
    return found
