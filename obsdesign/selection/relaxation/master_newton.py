"""The best mixture for a criterion with derivatives: Newton's method on the shares."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from obsdesign.conic import ConicSettings, nonnegative_cone, solve_conic_program, svec, zero_cone
from obsdesign.selection.dual import Dual
from obsdesign.selection.problem import SelectionProblem
from obsdesign.selection.relaxation.column import Column, Mixture

MASTER_SETTINGS = ConicSettings(tolerance=1e-10, max_iterations=100)  # of every restricted master
_MAX_STEPS = 40  # of Newton's method at most; it ends before when a step promises less than _ENOUGH
_MIN_INCREASE = 1e-11  # of the value: what a step must promise
_MAX_HALVINGS = 30  # of a step: where 1e-9 of it does not help, it is given up


def maximise_by_newton(instance: SelectionProblem, columns: list[Column], previous: Mixture | None) -> Mixture | None:
    """max min_r criterion(W_r(a)) - penalty'a over usage'a <= limits, sum a = 1, a >= 0; None where no mixture sees everything."""
    W = np.stack([column.W for column in columns])
    usage = np.stack([column.usage for column in columns]).T
    penalty = np.array([column.penalty for column in columns])
    shares = _initial_shares(instance, usage, len(columns), previous)
    if shares is None or not np.isfinite(_value(instance, W, penalty, shares)):
        return None
    weights = np.ones(len(instance.working_sensors)) / len(instance.working_sensors) if previous is None else previous.multipliers
    mu = np.zeros(len(instance.resources))
    for _ in range(_MAX_STEPS):
        current = _value(instance, W, penalty, shares)
        step = _newton_step(instance, W, usage, penalty, shares, weights)
        if step is None:
            break
        target, weights, mu, predicted_increase = step
        length, has_moved = 1.0, False
        for _ in range(_MAX_HALVINGS):
            trial = shares + length * (target - shares)
            if _value(instance, W, penalty, trial) > current + 1e-4 * length * max(predicted_increase, 0.0):
                shares, has_moved = trial, True
                break
            length /= 2
        if not has_moved or predicted_increase <= _MIN_INCREASE * max(abs(current), 1.0 if instance.criterion.resolution else 0.0):
            break
    return _mixture(instance, W, penalty, shares, weights, mu)


def _initial_shares(instance: SelectionProblem, usage: np.ndarray, count: int, previous: Mixture | None) -> np.ndarray | None:
    """The mixture before with a little of the new columns; at first the fullest even mixture with the idle column that keeps limits."""
    if previous is not None:
        shares = np.zeros(count)
        shares[: len(previous.shares)] = previous.shares
        return shares
    even = np.full(count, 1 / count)
    if not len(usage):
        return even
    idle = np.zeros(count)
    idle[usage.sum(axis=0).argmin()] = 1.0
    slack = instance.limits - usage @ idle
    extra_usage = usage @ (even - idle)
    if (slack < 0).any():
        return None
    fraction = min(1.0, *(float(r / w) for r, w in zip(slack, extra_usage, strict=True) if w > 0), 1.0)
    return idle + fraction * (even - idle)


def _value(instance: SelectionProblem, W: np.ndarray, penalty: np.ndarray, shares: np.ndarray) -> float:
    return instance.mixture_value(np.tensordot(shares, W, 1)) - float(shares @ penalty)


def _newton_step(
    instance: SelectionProblem, W: np.ndarray, usage: np.ndarray, penalty: np.ndarray, shares: np.ndarray, weights: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float] | None:
    """The maximiser of the quadratic model about the shares, multipliers of scenarios and resources, and the rise it promises."""
    J, R, m = len(shares), W.shape[1], len(usage)
    mean = np.tensordot(shares, W, 1)
    values = instance.scaled_criterion.values(mean)
    slopes = np.stack([svec(W[:, r]) @ svec(instance.scaled_criterion.tangent(mean[r])[0]) for r in range(R)])
    H = np.einsum("r,rij->ij", weights, np.stack([instance.scaled_criterion.curvature(mean[r], W[:, r]) for r in range(R)]))
    unit = max(abs(float(values.min())), float(np.abs(slopes @ shares).max()), 1e-300)
    # x = (target, t): minimise (x - a)'H(x - a)/2 - t + penalty'x over t <= value_r + slope_r'(x - a)
    P = np.zeros((J + 1, J + 1))
    P[:J, :J] = H / unit
    objective = np.append(penalty / unit - H @ shares / unit, -1.0)
    scale = np.maximum(instance.limits, 1e-9 + np.abs(usage).max(axis=1, initial=0.0)) if m else np.zeros(0)
    rows = np.zeros((1 + J + m + R, J + 1))
    rows[0, :J] = 1.0
    rows[1 : 1 + J, :J] = -np.eye(J)
    if m:
        rows[1 + J : 1 + J + m, :J] = usage / scale[:, None]
    rows[1 + J + m :, :J], rows[1 + J + m :, J] = -slopes / unit, 1.0
    right_hand_side = np.concatenate([[1.0], np.zeros(J), instance.limits / scale, (values - slopes @ shares) / unit])
    solution = solve_conic_program(
        sparse.csc_matrix(np.triu(P)),
        objective,
        sparse.csc_matrix(rows),
        right_hand_side,
        [zero_cone(1), nonnegative_cone(J + m + R)],
        MASTER_SETTINGS,
    )
    if solution is None:
        return None
    x, z = solution
    target = np.maximum(x[:J], 0.0)
    target /= target.sum()
    mu = np.maximum(z[1 + J : 1 + J + m], 0.0) / scale * unit if m else np.zeros(0)
    scenario_multipliers = np.maximum(z[1 + J + m :], 0.0)
    current = float(values.min()) - float(penalty @ shares)
    predicted_increase = float((values + slopes @ (target - shares)).min()) - float(penalty @ target) - current
    return target, scenario_multipliers / scenario_multipliers.sum(), mu, predicted_increase


def _mixture(
    instance: SelectionProblem, W: np.ndarray, penalty: np.ndarray, shares: np.ndarray, weights: np.ndarray, mu: np.ndarray
) -> Mixture:
    """The tangent at the mixture is above the criterion everywhere: value(V') <= <V', Z> + offset."""
    mean = np.tensordot(shares, W, 1)
    tangents = [instance.scaled_criterion.tangent(scenario_information) for scenario_information in mean]
    slopes, offsets = np.stack([Z for Z, _ in tangents]), np.array([offset for _, offset in tangents])
    dual = Dual(weights[:, None, None] * slopes, mu, float(weights @ offsets))
    return Mixture(shares, _value(instance, W, penalty, shares), dual, weights)
