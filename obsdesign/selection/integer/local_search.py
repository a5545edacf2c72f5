"""Improving a schedule by changing one segment, or two at a time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.conic import smat, svec
from obsdesign.selection.dual import Dual
from obsdesign.selection.integer.branch_and_bound import cutoff
from obsdesign.selection.integer.smoothed_eigenvalue import SmoothedEigenvalue
from obsdesign.selection.pricing.abstract import AbstractSeparateSchedules
from obsdesign.selection.problem import SelectionProblem

_MAX_CHANGES = 600  # changes considered: those that cost least in the prices of the dual; no scan of all segments
_MAX_EXCHANGES = 64  # of the pairs, and of the single changes, that a second-order model likes best are worth computing
_SMOOTHING = (1.0, 0.1, 0.01)  # of the gap to the bound: how much the corner of the smallest eigenvalue is rounded off, in turn
_MAX_STEPS = 200  # exchanges at most; the search ends before at a schedule that no change improves


@dataclass(frozen=True, eq=False)
class _SecondOrderModel:
    """To second order, change i gains g_i - |F_i|^2 / 2 and a pair less F_i'F_j: g (N,), F (N, .)."""

    g: np.ndarray
    F: np.ndarray


def improve_by_exchange(instance: SelectionProblem, chosen: np.ndarray, dual: Dual, bound: float) -> tuple[np.ndarray, float]:
    """Return a schedule at least as good, and its value; a schedule of linked segments as it is.

    Climbs on a rounded-off criterion, then on less and less rounded ones: at its corner, one change alone rarely helps.
    """
    value = instance.value(chosen)
    if not isinstance(instance.schedules, AbstractSeparateSchedules):
        return chosen, value
    best = chosen, value
    for smoothing in _SMOOTHING if instance.criterion.is_smallest_eigenvalue else (1.0,):
        tau = smoothing * max(bound - best[1], 1e-12 * abs(bound)) / instance.n
        chosen = _ascend(instance, instance.schedules, best[0], dual, tau)
        value = instance.value(chosen)
        if value > best[1]:
            best = chosen, value
    return best


def _ascend(instance: SelectionProblem, schedules: AbstractSeparateSchedules, chosen: np.ndarray, dual: Dual, tau: float) -> np.ndarray:
    price, start = instance.prices(dual)
    near_segments = _least_margin_segments(schedules, chosen, price, start)
    W, usage = instance.information(chosen), instance.usage(chosen)
    current = float(_potential(instance, W[None], tau)[0])
    for _ in range(_MAX_STEPS):
        changes = schedules.cheapest_changes(chosen, price, near_segments, _MAX_CHANGES)
        difference = changes.patterns.astype(float) - chosen[changes.segments]
        if not len(difference):
            break
        rows = instance.block_vectors[changes.segments]
        D = smat(
            np.stack([np.einsum("is,isd->id", difference * working, rows) for working in instance.working_sensors], axis=1), instance.n
        )
        extra_usage = np.zeros((len(D), len(instance.resources)))
        for i, resource in enumerate(instance.resources):
            extra_usage[:, i] = np.sum(difference * resource.usage[changes.segments], axis=1)
        pairs = _best_exchanges(instance, _potential_model(instance, W, D, tau), changes.segments, usage, extra_usage)
        if not len(pairs):
            break
        candidates = W + D[pairs[:, 0]] + np.where((pairs[:, 1] >= 0)[:, None, None, None], D[pairs[:, 1]], 0.0)
        values = _potential(instance, candidates, tau)
        index = int(values.argmax())
        if not values[index] > cutoff(current, 2e-12, instance):
            break
        chosen = chosen.copy()
        for change in pairs[index][pairs[index] >= 0]:
            chosen[changes.segments[change]] = changes.patterns[change]
            usage = usage + extra_usage[change]
        W, current = candidates[index], float(values[index])
    return chosen


def _least_margin_segments(schedules: AbstractSeparateSchedules, chosen: np.ndarray, price: np.ndarray, start: np.ndarray) -> np.ndarray:
    """The segments in which the best choice for the prices is so by the least margin, and those in which another one is made."""
    best, _ = schedules.maximise(price, start)
    on, off = schedules.forcing_costs(price, start)
    margin = np.where((best == chosen).all(axis=1), np.where(best, off, on).min(axis=1), 0.0)
    return np.argpartition(margin, _MAX_CHANGES)[:_MAX_CHANGES] if len(margin) > _MAX_CHANGES else np.arange(len(margin))


def _best_exchanges(
    instance: SelectionProblem, model: _SecondOrderModel, segments: np.ndarray, usage: np.ndarray, extra_usage: np.ndarray
) -> np.ndarray:
    """The single changes (i, -1) and pairs (i, j) that gain most by the model and keep the limits, (., 2)."""
    limits = instance.rounded_limits - usage if instance.resources else np.zeros(0)
    single_gain = model.g - np.sum(model.F**2, axis=1) / 2
    pair_gain = single_gain[:, None] + single_gain[None] - model.F @ model.F.T
    single_gain = np.where((extra_usage <= limits).all(axis=1), single_gain, -np.inf)
    pair_gain[segments[:, None] == segments[None]] = -np.inf
    for extra, capacity in zip(extra_usage.T, limits, strict=True):
        pair_gain[extra[:, None] + extra[None] > capacity] = -np.inf
    pair_gain[np.tril_indices(len(pair_gain))] = -np.inf
    singles = np.argsort(-single_gain, kind="stable")[:_MAX_EXCHANGES]
    flat = pair_gain.ravel()
    top_pairs = np.argpartition(-flat, min(_MAX_EXCHANGES, len(flat) - 1))[:_MAX_EXCHANGES]
    first, second = np.divmod(top_pairs[np.isfinite(flat[top_pairs])], len(pair_gain))
    singles = singles[np.isfinite(single_gain[singles])]
    return np.concatenate([np.stack([first, second], axis=1), np.stack([singles, np.full(len(singles), -1)], axis=1)])


def _potential_model(instance: SelectionProblem, W: np.ndarray, D: np.ndarray, tau: float) -> _SecondOrderModel:
    """The potential about V (R, n, n) along D (N, R, n, n)."""
    if instance.criterion.is_smallest_eigenvalue:
        return _smooth_model(*_project(instance, W, D), tau)
    values = instance.scaled_criterion.values(W)
    worst = int(values.argmin())
    if not np.isfinite(values[worst]):
        size = float(np.trace(W[worst])) + float(np.abs(D).max())
        return _smooth_model(W, D, 1e-3 * max(size, np.finfo(float).tiny))
    g = np.sum(D[:, worst] * instance.scaled_criterion.tangent(W[worst])[0], axis=(1, 2))
    H = instance.scaled_criterion.curvature(W[worst], smat(np.eye(instance.block_vectors.shape[2]), instance.n))
    values, eigenvectors = np.linalg.eigh((H + H.T) / 2)
    return _SecondOrderModel(g, svec(D[:, worst]) @ (eigenvectors * np.sqrt(np.maximum(values, 0.0))))


def _project(instance: SelectionProblem, V: np.ndarray, D: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What V (R, n, n) and changes of it (N, R, n, n) say about the judged states, to first order, in units of a search."""
    lifts = (
        np.stack([instance.scaled_criterion.lift(scenario_information) for scenario_information in V])
        * instance.scaled_criterion.search_units
    )
    return instance.scaled_criterion.search_information(V), lifts.swapaxes(1, 2) @ D @ lifts


def _smooth_model(W: np.ndarray, D: np.ndarray, tau: float) -> _SecondOrderModel:
    """Of the rounded-off smallest eigenvalue over all scenarios of loss together."""
    shifted, bases = SmoothedEigenvalue.spectrum(W, tau)
    inverse_root = 1 / np.sqrt(shifted)
    transformed = (bases.swapaxes(1, 2) @ D @ bases) * (inverse_root[:, :, None] * inverse_root[:, None, :])
    diagonal = np.diagonal(transformed, axis1=2, axis2=3).reshape(len(D), -1)
    flat = svec(transformed).reshape(len(D), -1)
    weights = (1 / shifted).ravel()
    shift = diagonal @ weights / np.sqrt(np.sum(weights**2))
    # what raising t takes back: a negative square, so the model is a little too cautious without it
    return _SecondOrderModel(tau * diagonal.sum(axis=1) + tau * shift**2 / 2, np.sqrt(tau) * flat)


def _potential(instance: SelectionProblem, W: np.ndarray, tau: float) -> np.ndarray:
    """What is climbed on, for V (., R, n, n)."""
    if instance.criterion.is_smallest_eigenvalue:
        return SmoothedEigenvalue.values(np.linalg.eigvalsh(instance.scaled_criterion.search_information(W)).reshape(len(W), -1), tau)
    return instance.scaled_criterion.values(W.reshape(-1, *W.shape[2:])).reshape(W.shape[:2]).min(axis=1)
