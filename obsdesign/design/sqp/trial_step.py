"""Which of the points that a model leads to is tried: its minimiser, corrected, continued or sharpened."""

from __future__ import annotations

import numpy as np

from obsdesign.design.sqp.local_model import LocalModel, ModelSolution, active_set_step, second_order_correction
from obsdesign.design.sqp.merit import Iterate, MeritScaling


def best_trial(model: LocalModel, solution: ModelSolution, scaling: MeritScaling, radius: float, predicted_reduction: float) -> Iterate:
    """Return the best place of the step, its correction for curved limits, its continuation, and Newton's step near the end."""
    merit_function, iterate = model.merit_function, model.iterate
    p = iterate.evaluation.p
    best = merit_function.evaluate(p + solution.d, scaling)
    if iterate.merit - best.merit < 0.25 * predicted_reduction and np.isfinite(best.merit):
        d = second_order_correction(model, solution, best, scaling, radius)
        best = best if d is None else min(best, merit_function.evaluate(p + d, scaling), key=_merit)
    factor = 2.0
    while iterate.merit - best.merit > 1.3 * predicted_reduction and factor <= 16:
        extrapolated = merit_function.evaluate(p + factor * solution.d, scaling)
        if not extrapolated.merit < best.merit:
            break
        best, factor = extrapolated, 2 * factor
    if np.max(np.abs(solution.d) / merit_function.width) < 0.5 * radius and predicted_reduction < 1e-2 * max(1.0, abs(iterate.merit)):
        d = active_set_step(model, solution, scaling, radius)
        best = best if d is None else min(best, merit_function.evaluate(p + d, scaling), key=_merit)
    return best


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
