"""The best mixture for a criterion with derivatives: Newton's method on the shares."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from obsdesign.selection.problem import Instance, vectors
from obsdesign.selection.relaxation.dual import Dual
from obsdesign.selection.relaxation.restricted_master import Column, Mixture, clarabel, solved

_STEPS = 40  # of Newton's method at most; it ends before when a step promises less than _ENOUGH
_ENOUGH = 1e-11  # of the value: what a step must promise
_HALVINGS = 30  # of a step: where 1e-9 of it does not help, it is given up


def climbed(instance: Instance, columns: list[Column], before: Mixture | None) -> Mixture | None:
    """max min_r criterion(W_r(a)) - penalty'a over usage'a <= limits, sum a = 1, a >= 0; None where no mixture sees everything."""
    W = np.stack([column.W for column in columns])
    usage = np.stack([column.usage for column in columns]).T
    penalty = np.array([column.penalty for column in columns])
    shares = _start(instance, usage, len(columns), before)
    if shares is None or not np.isfinite(_value(instance, W, penalty, shares)):
        return None
    weights = np.ones(len(instance.kept)) / len(instance.kept) if before is None else before.multipliers
    mu = np.zeros(len(instance.resources))
    for _ in range(_STEPS):
        now = _value(instance, W, penalty, shares)
        step = _newton(instance, W, usage, penalty, shares, weights)
        if step is None:
            break
        target, weights, mu, promised = step
        length, moved = 1.0, False
        for _ in range(_HALVINGS):
            trial = shares + length * (target - shares)
            if _value(instance, W, penalty, trial) > now + 1e-4 * length * max(promised, 0.0):
                shares, moved = trial, True
                break
            length /= 2
        if not moved or promised <= _ENOUGH * max(abs(now), 1.0 if instance.criterion.resolution else 0.0):
            break
    return _mixture(instance, W, penalty, shares, weights, mu)


def _start(instance: Instance, usage: np.ndarray, count: int, before: Mixture | None) -> np.ndarray | None:
    """The mixture before with a little of the new columns; at first the fullest even mixture with the idle column that keeps limits."""
    if before is not None:
        shares = np.zeros(count)
        shares[: len(before.shares)] = before.shares
        return shares
    even = np.full(count, 1 / count)
    if not len(usage):
        return even
    idle = np.zeros(count)
    idle[usage.sum(axis=0).argmin()] = 1.0
    room = instance.limits - usage @ idle
    need = usage @ (even - idle)
    if (room < 0).any():
        return None
    part = min(1.0, *(float(r / w) for r, w in zip(room, need, strict=True) if w > 0), 1.0)
    return idle + part * (even - idle)


def _value(instance: Instance, W: np.ndarray, penalty: np.ndarray, shares: np.ndarray) -> float:
    return instance.judged(np.tensordot(shares, W, 1)) - float(shares @ penalty)


def _newton(
    instance: Instance, W: np.ndarray, usage: np.ndarray, penalty: np.ndarray, shares: np.ndarray, weights: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float] | None:
    """The maximiser of the quadratic model about the shares, multipliers of scenarios and resources, and the rise it promises."""
    J, R, m = len(shares), W.shape[1], len(usage)
    mean = np.tensordot(shares, W, 1)
    values = instance.judge.values(mean)
    slopes = np.stack([vectors(W[:, r]) @ vectors(instance.judge.tangent(mean[r])[0]) for r in range(R)])
    H = np.einsum("r,rij->ij", weights, np.stack([instance.judge.curvature(mean[r], W[:, r]) for r in range(R)]))
    unit = max(abs(float(values.min())), float(np.abs(slopes @ shares).max()), 1e-300)
    # x = (target, t): minimise (x - a)'H(x - a)/2 - t + penalty'x over t <= value_r + slope_r'(x - a)
    P = np.zeros((J + 1, J + 1))
    P[:J, :J] = H / unit
    goal = np.append(penalty / unit - H @ shares / unit, -1.0)
    size = np.maximum(instance.limits, 1e-9 + np.abs(usage).max(axis=1, initial=0.0)) if m else np.zeros(0)
    rows = np.zeros((1 + J + m + R, J + 1))
    rows[0, :J] = 1.0
    rows[1 : 1 + J, :J] = -np.eye(J)
    if m:
        rows[1 + J : 1 + J + m, :J] = usage / size[:, None]
    rows[1 + J + m :, :J], rows[1 + J + m :, J] = -slopes / unit, 1.0
    sides = np.concatenate([[1.0], np.zeros(J), instance.limits / size, (values - slopes @ shares) / unit])
    found = solved(sparse.csc_matrix(np.triu(P)), goal, rows, sides, [clarabel.ZeroConeT(1), clarabel.NonnegativeConeT(J + m + R)])
    if found is None:
        return None
    x, z = found
    target = np.maximum(x[:J], 0.0)
    target /= target.sum()
    mu = np.maximum(z[1 + J : 1 + J + m], 0.0) / size * unit if m else np.zeros(0)
    scenario = np.maximum(z[1 + J + m :], 0.0)
    now = float(values.min()) - float(penalty @ shares)
    promised = float((values + slopes @ (target - shares)).min()) - float(penalty @ target) - now
    return target, scenario / scenario.sum(), mu, promised


def _mixture(instance: Instance, W: np.ndarray, penalty: np.ndarray, shares: np.ndarray, weights: np.ndarray, mu: np.ndarray) -> Mixture:
    """The tangent at the mixture is above the criterion everywhere: value(V') <= <V', Z> + offset."""
    mean = np.tensordot(shares, W, 1)
    tangents = [instance.judge.tangent(each) for each in mean]
    slopes, offsets = np.stack([Z for Z, _ in tangents]), np.array([offset for _, offset in tangents])
    dual = Dual(weights[:, None, None] * slopes, mu, float(weights @ offsets))
    return Mixture(shares, _value(instance, W, penalty, shares), dual, weights)
