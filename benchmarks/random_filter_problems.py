"""Random linear problems, for the library and for the reference, small enough to try all schedules."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np

import obsdesign as od
from benchmarks.kalman_reference import LinearRun, all_schedules, costs, last_weights, mean_weights, patterns, switched_on
from obsdesign.rules.abstract import AbstractRule

OfSchedules = Callable[[np.ndarray], np.ndarray]
CRITERIA = {"trace": od.TraceInverse(), "largest": od.MinEigenvalue(), "log det": od.LogDet()}
STEP = 0.5


def _all(chosen: np.ndarray) -> np.ndarray:
    return np.ones(len(chosen), dtype=bool)


def _nothing(chosen: np.ndarray) -> np.ndarray:
    return np.zeros(len(chosen))


@dataclass(frozen=True)
class Rule:
    """Rules of the library, which of schedules (B, K, S) they allow (B,), and what they add to the cost (B,)."""

    rules: tuple[AbstractRule, ...]
    feasible: OfSchedules = _all
    extra: OfSchedules = _nothing


@dataclass(frozen=True, eq=False)
class RandomProblem:
    """What the library is given, and the same for the reference: boundaries (K+1,) [s], about by name, units (n,), active (N, S)."""

    system: od.ControlAffineSystem
    path: od.Trajectory
    prior: od.Prior
    psd: np.ndarray
    boundaries: np.ndarray
    per_segment: int
    about: tuple[str, ...] | None
    over: str | np.ndarray
    units: np.ndarray
    active: np.ndarray
    reference: LinearRun
    rule: Rule

    def optimum(self) -> float:
        """Return the least cost of all schedules that the rules allow; inf where there is none."""
        run = self.reference
        chosen = all_schedules(run.segments, patterns(run.sensors, self.per_segment))
        chosen = chosen[self.rule.feasible(chosen)]
        return float((costs(run, chosen) + self.rule.extra(chosen)).min(initial=np.inf))

    def cost(self, chosen: np.ndarray) -> float:
        """Return the cost of one schedule (K, S); inf where too many are on or a rule is broken."""
        if not self.rule.feasible(chosen[None])[0] or chosen.sum(axis=1).max() > self.per_segment:
            return np.inf
        return float((costs(self.reference, chosen[None]) + self.rule.extra(chosen[None]))[0])


def random_problem(seed: int, ruled: bool | None = None) -> RandomProblem:
    """Draw one: n 2 to 4, S 2 to 4, K S <= 16, one or two sensors on, outages, unequal segments, with a rule in half of the cases.

    The drift is strictly upper triangular, so that Runge and Kutta's step is the exact one.
    """
    random = np.random.default_rng([seed, 15])
    n, S, per_segment = (int(random.integers(low, high)) for low, high in ((2, 5), (2, 5), (1, 3)))
    lengths = random.integers(1, 4, int(random.integers(2, min(16 // S, 8) + 1)))
    drift = np.triu(random.normal(0, 0.7, (n, n)), 1)
    C, sigmas = random.normal(size=(S, n)) * (random.uniform(size=(S, n)) < 0.7), random.uniform(0.3, 2.0, S)
    C[np.arange(S), random.integers(0, n, S)] += 1.0
    root, spread = random.normal(size=(n, n)) * random.uniform(0, 0.6), random.normal(size=(n, n))
    active = random.uniform(size=(int(lengths.sum()), S)) < random.choice([1.0, 0.8])
    about = tuple(int(i) for i in np.flatnonzero(random.uniform(size=n) < 0.6)) or (0,)
    units = random.uniform(0.5, 3.0, n) if random.uniform() < 0.5 else np.ones(n)
    over, weights = _over(random, len(active))
    criterion = str(random.choice(["trace", "trace", "trace", "largest", "log det"]))
    system = _linear_system(drift, C, sigmas)
    prior = od.Prior(np.ones(n), covariance=spread @ spread.T + 0.3 * np.eye(n))
    reference = LinearRun(
        np.tile(_exponential(drift * STEP), (len(active), 1, 1)),
        root @ root.T * STEP,
        prior.covariance,
        (C / sigmas[:, None])[None, :, None] * active[:, :, None, None],
        np.repeat(np.arange(len(lengths)), lengths),
        np.diag(1 / units)[list(about)],
        weights,
        criterion,
    )
    is_ruled = bool(random.integers(0, 2)) if ruled is None else ruled
    return RandomProblem(
        system,
        od.simulate(system, np.ones(n), np.zeros((len(active), 0)), STEP),
        prior,
        root @ root.T,
        STEP * np.concatenate([[0], np.cumsum(lengths)]),
        per_segment,
        None if len(about) == n else tuple(system.names[i] for i in about),
        over,
        units,
        active,
        reference,
        _random_rule(random, reference, per_segment) if is_ruled else Rule(()),
    )


def _linear_system(drift: np.ndarray, C: np.ndarray, sigmas: np.ndarray) -> od.ControlAffineSystem:
    x = ca.SX.sym("x", len(drift))
    outputs = {f"s{i}": ca.dot(ca.DM(row), x) for i, row in enumerate(C)}
    noise = {f"s{i}": float(sigma) for i, sigma in enumerate(sigmas)}
    return od.ControlAffineSystem(x, tuple(f"x{i}" for i in range(len(drift))), ca.DM(drift) @ x, outputs=outputs, sigmas=noise)


def _exponential(A: np.ndarray) -> np.ndarray:
    """exp(A) of a nilpotent A (n, n), n <= 5: its series ends."""
    return np.eye(len(A)) + A + A @ A / 2 + A @ A @ A / 6 + A @ A @ A @ A / 24


def _over(random: np.random.Generator, N: int) -> tuple[str | np.ndarray, np.ndarray | None]:
    """Return what the library is asked, and the reference's weights, None for the worst instant."""
    kind = str(random.choice(["mean", "worst", "end", "weights"]))
    if kind == "weights":
        weights = random.uniform(0, 1, N) * (random.uniform(size=N) < 0.8)
        weights[-1] += 0.1
        return weights, weights
    return kind, {"mean": mean_weights(N), "worst": None, "end": last_weights(N)}[kind]


def _random_rule(random: np.random.Generator, run: LinearRun, per_segment: int) -> Rule:
    """Draw a rule of the library, and write down what it means in NumPy; switching costs nothing where a cost may be negative."""
    makers = [_unavailable, _dwell, _uses, _budget, _requires]
    makers += [_exclusive] if per_segment > 1 else []
    makers += [_switching] if run.criterion != "log det" else []
    a, b = (int(i) for i in random.permutation(run.sensors)[:2])
    return makers[int(random.integers(0, len(makers)))](random, run, a, b)


def _unavailable(random: np.random.Generator, run: LinearRun, a: int, _: int) -> Rule:
    off = tuple(int(k) for k in np.flatnonzero(random.uniform(size=run.segments) < 0.5))
    return Rule((od.Unavailable(a, off),), lambda chosen: ~chosen[:, list(off), a].any(axis=1))


def _dwell(random: np.random.Generator, *_: object) -> Rule:
    least = int(random.integers(2, 4))
    return Rule((od.MinimumDwell(least),), lambda chosen: _dwells(chosen, least))


def _dwells(chosen: np.ndarray, least: int) -> np.ndarray:
    """Whether everything that is switched on stays on for so many segments, or to the end."""
    fine = np.ones(len(chosen), dtype=bool)
    for k in range(chosen.shape[1]):
        began = chosen[:, k] & ~chosen[:, k - 1] if k else chosen[:, k]
        fine &= (~began | chosen[:, k : k + least].all(axis=1)).all(axis=1)
    return fine


def _uses(random: np.random.Generator, run: LinearRun, a: int, _: int) -> Rule:
    most = int(random.integers(0, run.segments))
    return Rule((od.MaxUses(a, most),), lambda chosen: chosen[:, :, a].sum(axis=1) <= most)


def _budget(random: np.random.Generator, run: LinearRun, *_: int) -> Rule:
    cost, start = random.uniform(0.2, 2.0, run.sensors), random.uniform(0, 1.0, run.sensors)
    limit = float(random.uniform(0.3, 1.0) * run.segments)
    rule = od.EnergyBudget(limit, dict(enumerate(cost.tolist())), dict(enumerate(start.tolist())))
    return Rule((rule,), lambda chosen: chosen.sum(axis=1) @ cost + switched_on(chosen) @ start <= limit + 1e-9)


def _requires(random: np.random.Generator, run: LinearRun, a: int, b: int) -> Rule:
    return Rule((od.Requires(a, b),), lambda chosen: ~(chosen[:, :, a] & ~chosen[:, :, b]).any(axis=1))


def _exclusive(random: np.random.Generator, run: LinearRun, a: int, b: int) -> Rule:
    return Rule((od.Exclusive((a, b)),), lambda chosen: ~(chosen[:, :, a] & chosen[:, :, b]).any(axis=1))


def _switching(random: np.random.Generator, *_: object) -> Rule:
    price = float(random.uniform(0, 0.3))
    return Rule((od.SwitchingCost(price),), extra=lambda chosen: price * switched_on(chosen).sum(axis=1))
