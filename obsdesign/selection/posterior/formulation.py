"""From a question to the problem that methods work on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from obsdesign.selection.posterior.bounded_search import first_walk
from obsdesign.selection.posterior.options import Options
from obsdesign.selection.posterior.problem import PosteriorProblem
from obsdesign.selection.posterior.questions import UNKNOWN_SPREADS, FilterQuestion
from obsdesign.selection.posterior.segment_maps import segment_maps

_TRIALS = 6  # schedules with which a variance for unknown inputs is judged


def problem_of(question: FilterQuestion, options: Options) -> PosteriorProblem:
    """Return the problem that methods work on."""
    model = question.linear_model
    maps = segment_maps(model, question.nodes, options.patterns, question.costs)
    return PosteriorProblem(maps, options, model.initial_covariance, question.costs.is_worst)


def settle_unknown_inputs(question: FilterQuestion, options: Options) -> FilterQuestion:
    """Return the question with that variance of unknown inputs with which the filter's variances are most nearly what they are in truth.

    With a finite variance all of them are smaller than in truth, by a share that falls with it; what rounding does grows with it. Judged
    by the largest relative error at any instant that counts, of a few schedules and a good one, without floors.
    """
    if not question.disturbance.unknown:
        return question
    plain = replace(question, floors=np.zeros_like(question.floors))
    walk = first_walk(problem_of(plain, options))
    trials = [options.chosen(nodes) for nodes in (*_trial_walks(options), *([] if walk is None else [walk.nodes]))]
    exact = [plain.deviations(chosen)[question.costs.weights > 0][:, question.costs.about] ** 2 for chosen in trials]
    candidates = [replace(plain, unknown_spread=spread) for spread in UNKNOWN_SPREADS]
    errors = [max(_variance_error(candidate, *trial) for trial in zip(trials, exact, strict=True)) for candidate in candidates]
    best = int(np.argmin(errors))
    return replace(question, unknown_spread=UNKNOWN_SPREADS[best], unknown_error=errors[best])


def _variance_error(question: FilterQuestion, chosen: np.ndarray, exact: np.ndarray) -> float:
    """Return the largest relative error of the model's variances of a schedule (K, S), of those that are finite in truth (k, q)."""
    covariances = question.linear_model.covariances(question.active(chosen))[question.costs.weights > 0]
    variances = np.diagonal(covariances, axis1=1, axis2=2)[:, question.costs.about]
    is_finite = np.isfinite(exact)
    return float(np.abs(variances[is_finite] / exact[is_finite] - 1).max(initial=0.0))


def _trial_walks(options: Options) -> np.ndarray:
    """Return a few walks (B, K), drawn with a seed of their own; what follows what does not matter for what they cost."""
    random = np.random.default_rng(0)
    return np.array([[random.choice(np.flatnonzero(allowed)) for allowed in options.allowed] for _ in range(_TRIALS)])
