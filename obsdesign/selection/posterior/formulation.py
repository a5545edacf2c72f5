"""From a question to the problem that methods work on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

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
    """Return the question with that variance of unknown inputs with which schedules cost most nearly what they do in truth.

    With a finite variance every schedule costs less than in truth, by a share that falls with the variance; what rounding adds grows
    with it. Judged by the worst of a few schedules, as a share of their costs, so that no chance agreement counts.
    """
    if not question.disturbance.unknown:
        return question
    trials = _trial_walks(options)
    exact = np.array([question.schedule_cost(options.chosen(nodes)) for nodes in trials])
    is_finite = np.isfinite(exact) & (exact != 0)
    candidates = [replace(question, unknown_spread=spread) for spread in UNKNOWN_SPREADS]
    errors = []
    for candidate in candidates:
        problem = problem_of(candidate, options)
        costs = np.array([problem.walk(nodes).value - problem.switching(nodes) for nodes in trials])
        errors.append(float(np.abs(costs[is_finite] / exact[is_finite] - 1).max(initial=0.0)))
    best = int(np.argmin(errors))
    return replace(candidates[best], unknown_error=errors[best])


def _trial_walks(options: Options) -> np.ndarray:
    """Return a few walks (B, K), drawn with a seed of their own; what follows what does not matter for what they cost."""
    random = np.random.default_rng(0)
    return np.array([[random.choice(np.flatnonzero(allowed)) for allowed in options.allowed] for _ in range(_TRIALS)])
