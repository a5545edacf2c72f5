"""Improving a schedule by changing one segment, or two at a time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.selection.integer.branch_and_bound import bar
from obsdesign.selection.integer.smoothed_eigenvalue import Soft
from obsdesign.selection.pricing.abstract import AbstractSeparate
from obsdesign.selection.problem import Instance, matrices, vectors
from obsdesign.selection.relaxation.dual import Dual

_NEAR = 600  # changes considered: those that cost least in the prices of the dual; no scan of all segments
_TRIED = 64  # of the pairs, and of the single changes, that a second-order model likes best are worth computing
_ROUNDING = (1.0, 0.1, 0.01)  # of the gap to the bound: how much the corner of the smallest eigenvalue is rounded off, in turn
_STEPS = 200  # exchanges at most; the search ends before at a schedule that no change improves


@dataclass(frozen=True, eq=False)
class _Model:
    """To second order, change i gains g_i - |F_i|^2 / 2 and a pair less F_i'F_j: g (N,), F (N, .)."""

    g: np.ndarray
    F: np.ndarray


def polished(instance: Instance, chosen: np.ndarray, dual: Dual, bound: float) -> tuple[np.ndarray, float]:
    """Return a schedule at least as good, and its value; a schedule of linked segments as it is.

    Climbs on a rounded-off criterion, then on less and less rounded ones: at its corner, one change alone rarely helps.
    """
    value = instance.value(chosen)
    if not isinstance(instance.schedules, AbstractSeparate):
        return chosen, value
    best = chosen, value
    for share in _ROUNDING if instance.criterion.is_smallest_eigenvalue else (1.0,):
        tau = share * max(bound - best[1], 1e-12 * abs(bound)) / instance.n
        chosen = _climbed(instance, instance.schedules, best[0], dual, tau)
        value = instance.value(chosen)
        if value > best[1]:
            best = chosen, value
    return best


def _climbed(instance: Instance, schedules: AbstractSeparate, chosen: np.ndarray, dual: Dual, tau: float) -> np.ndarray:
    price, start = instance.prices(dual)
    within = _close(schedules, chosen, price, start)
    W, usage = instance.information(chosen), instance.usage(chosen)
    now = float(_potential(instance, W[None], tau)[0])
    for _ in range(_STEPS):
        changes = schedules.changes(chosen, price, within, _NEAR)
        difference = changes.patterns.astype(float) - chosen[changes.segments]
        if not len(difference):
            break
        rows = instance.rows[changes.segments]
        D = matrices(np.stack([np.einsum("is,isd->id", difference * kept, rows) for kept in instance.kept], axis=1), instance.n)
        taken = np.zeros((len(D), len(instance.resources)))
        for i, resource in enumerate(instance.resources):
            taken[:, i] = np.sum(difference * resource.usage[changes.segments], axis=1)
        pairs = _promising(instance, _model(instance, W, D, tau), changes.segments, usage, taken)
        if not len(pairs):
            break
        together = W + D[pairs[:, 0]] + np.where((pairs[:, 1] >= 0)[:, None, None, None], D[pairs[:, 1]], 0.0)
        values = _potential(instance, together, tau)
        index = int(values.argmax())
        if not values[index] > bar(now, 2e-12, instance):
            break
        chosen = chosen.copy()
        for change in pairs[index][pairs[index] >= 0]:
            chosen[changes.segments[change]] = changes.patterns[change]
            usage = usage + taken[change]
        W, now = together[index], float(values[index])
    return chosen


def _close(schedules: AbstractSeparate, chosen: np.ndarray, price: np.ndarray, start: np.ndarray) -> np.ndarray:
    """The segments in which the best choice for the prices is so by the least margin, and those in which another one is made."""
    best, _ = schedules.best(price, start)
    on, off = schedules.regrets(price, start)
    margin = np.where((best == chosen).all(axis=1), np.where(best, off, on).min(axis=1), 0.0)
    return np.argpartition(margin, _NEAR)[:_NEAR] if len(margin) > _NEAR else np.arange(len(margin))


def _promising(instance: Instance, model: _Model, segments: np.ndarray, usage: np.ndarray, taken: np.ndarray) -> np.ndarray:
    """The single changes (i, -1) and pairs (i, j) that gain most by the model and keep the limits, (., 2)."""
    limits = instance.limits + 1e-9 * np.maximum(1.0, instance.limits) - usage if instance.resources else np.zeros(0)
    alone = model.g - np.sum(model.F**2, axis=1) / 2
    pair = alone[:, None] + alone[None] - model.F @ model.F.T
    alone = np.where((taken <= limits).all(axis=1), alone, -np.inf)
    pair[segments[:, None] == segments[None]] = -np.inf
    for used, room in zip(taken.T, limits, strict=True):
        pair[used[:, None] + used[None] > room] = -np.inf
    pair[np.tril_indices(len(pair))] = -np.inf
    singles = np.argsort(-alone, kind="stable")[:_TRIED]
    flat = pair.ravel()
    near = np.argpartition(-flat, min(_TRIED, len(flat) - 1))[:_TRIED]
    first, second = np.divmod(near[np.isfinite(flat[near])], len(pair))
    singles = singles[np.isfinite(alone[singles])]
    return np.concatenate([np.stack([first, second], axis=1), np.stack([singles, np.full(len(singles), -1)], axis=1)])


def _model(instance: Instance, W: np.ndarray, D: np.ndarray, tau: float) -> _Model:
    """The potential about V (R, n, n) along D (N, R, n, n)."""
    if instance.criterion.is_smallest_eigenvalue:
        return _soft_model(*_lifted(instance, W, D), tau)
    values = instance.judge.values(W)
    worst = int(values.argmin())
    if not np.isfinite(values[worst]):
        size = float(np.trace(W[worst])) + float(np.abs(D).max())
        return _soft_model(W, D, 1e-3 * max(size, np.finfo(float).tiny))
    g = np.sum(D[:, worst] * instance.judge.tangent(W[worst])[0], axis=(1, 2))
    H = instance.judge.curvature(W[worst], matrices(np.eye(instance.rows.shape[2]), instance.n))
    values, turned = np.linalg.eigh((H + H.T) / 2)
    return _Model(g, vectors(D[:, worst]) @ (turned * np.sqrt(np.maximum(values, 0.0))))


def _lifted(instance: Instance, V: np.ndarray, D: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What V (R, n, n) and changes of it (N, R, n, n) say about the judged states, to first order, in units of a search."""
    lifts = np.stack([instance.judge.lift(each) for each in V]) * instance.judge.stiff
    return instance.judge.softened(V), lifts.swapaxes(1, 2) @ D @ lifts


def _soft_model(W: np.ndarray, D: np.ndarray, tau: float) -> _Model:
    """Of the rounded-off smallest eigenvalue over all scenarios of loss together."""
    above, bases = Soft.spectrum(W, tau)
    root = 1 / np.sqrt(above)
    turned = (bases.swapaxes(1, 2) @ D @ bases) * (root[:, :, None] * root[:, None, :])
    diagonal = np.diagonal(turned, axis1=2, axis2=3).reshape(len(D), -1)
    flat = vectors(turned).reshape(len(D), -1)
    weights = (1 / above).ravel()
    shift = diagonal @ weights / np.sqrt(np.sum(weights**2))
    # what raising t takes back: a negative square, so the model is a little too cautious without it
    return _Model(tau * diagonal.sum(axis=1) + tau * shift**2 / 2, np.sqrt(tau) * flat)


def _potential(instance: Instance, W: np.ndarray, tau: float) -> np.ndarray:
    """What is climbed on, for V (., R, n, n)."""
    if instance.criterion.is_smallest_eigenvalue:
        return Soft.values(np.linalg.eigvalsh(instance.judge.softened(W)).reshape(len(W), -1), tau)
    return instance.judge.values(W.reshape(-1, *W.shape[2:])).reshape(W.shape[:2]).min(axis=1)
