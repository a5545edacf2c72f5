"""Which of the points that a model leads to is tried: its minimiser, corrected, continued or sharpened."""

from __future__ import annotations

import numpy as np

from obsdesign.design.sqp.local_model import LocalModel, ModelSolution, active_set_step, second_order_correction
from obsdesign.design.sqp.merit import Iterate, MeritScaling

_POOR_SHARE = 0.25  # of the reduction that a model predicts, below which its step is corrected


def best_trial(model: LocalModel, solution: ModelSolution, scaling: MeritScaling, radius: float, predicted_reduction: float) -> Iterate:
    """Return the best place of the step, its correction for curved limits, its continuation, and Newton's step near the end."""
    merit_function, iterate = model.merit_function, model.iterate
    best = merit_function.evaluate(iterate.evaluation.p + solution.d, scaling)
    if iterate.merit - best.merit < _POOR_SHARE * predicted_reduction and np.isfinite(best.merit):
        best = _corrected_trial(model, solution, scaling, radius, best, _POOR_SHARE * predicted_reduction)
    factor = 2.0
    while iterate.merit - best.merit > 1.3 * predicted_reduction and factor <= 16:
        extrapolated = merit_function.evaluate(iterate.evaluation.p + factor * solution.d, scaling)
        if not extrapolated.merit < best.merit:
            break
        best, factor = extrapolated, 2 * factor
    if np.max(np.abs(solution.d) / merit_function.width) < 0.5 * radius and predicted_reduction < 1e-2 * max(1.0, abs(iterate.merit)):
        best = _newton_trial(model, solution, scaling, radius, best)
    return best


def _corrected_trial(
    model: LocalModel, solution: ModelSolution, scaling: MeritScaling, radius: float, first: Iterate, reduction: float
) -> Iterate:
    """Return the best of a step's end and its second-order corrections: with what is active kept, then, if that is not enough, anew."""
    earlier, best = (solution.d, first), first
    best = _better(model, scaling, best, active_set_step(model, solution, scaling, radius, uses_all_curvature=False, earlier=earlier))
    if model.iterate.merit - best.merit < reduction:
        best = _better(model, scaling, best, second_order_correction(model, solution, first, scaling, radius))
    return best


def _newton_trial(model: LocalModel, solution: ModelSolution, scaling: MeritScaling, radius: float, best: Iterate) -> Iterate:
    """Return the best of an iterate, Newton's step and that step corrected for what limits turn out at its end."""
    d = active_set_step(model, solution, scaling, radius, uses_all_curvature=True)
    if d is None:
        return best
    trial = model.merit_function.evaluate(model.iterate.evaluation.p + d, scaling)
    best = min(best, trial, key=_merit)
    return _better(model, scaling, best, active_set_step(model, solution, scaling, radius, uses_all_curvature=True, earlier=(d, trial)))


def _better(model: LocalModel, scaling: MeritScaling, best: Iterate, d: np.ndarray | None) -> Iterate:
    """Return the better of an iterate and the end of a step d (q,), if there is one."""
    if d is None:
        return best
    return min(best, model.merit_function.evaluate(model.iterate.evaluation.p + d, scaling), key=_merit)


def escape_saddle(model: LocalModel, scaling: MeritScaling, radius: float, tolerance: float) -> Iterate | None:
    """Return a better iterate along the most negative curvature, where no first-order reduction is predicted: a saddle is no optimum."""
    if model.negative_curvature is None:
        return None
    merit_function, iterate = model.merit_function, model.iterate
    for share in (1.0, 0.25, 0.05):
        trials = [
            merit_function.evaluate(iterate.evaluation.p + sign * share * radius * model.negative_curvature, scaling) for sign in (1, -1)
        ]
        best = min(trials, key=_merit)
        if iterate.merit - best.merit > 10 * tolerance * max(1.0, abs(iterate.merit)):
            return best
    return None


def _merit(iterate: Iterate) -> float:
    return iterate.merit
