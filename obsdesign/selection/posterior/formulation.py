"""From a question to the problem that methods work on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from obsdesign.selection.posterior.bounded_search import first_walk
from obsdesign.selection.posterior.options import Options
from obsdesign.selection.posterior.problem import PosteriorProblem
from obsdesign.selection.posterior.questions import UNKNOWN_SPREADS, FilterQuestion
from obsdesign.selection.posterior.segment_maps import segment_maps


def problem_of(question: FilterQuestion, options: Options) -> PosteriorProblem:
    """Return the problem that methods work on."""
    model = question.linear_model
    maps = segment_maps(model, question.nodes, options.patterns, question.costs)
    return PosteriorProblem(maps, options, model.initial_covariance, question.costs.is_worst)


def settle_unknown_inputs(question: FilterQuestion, options: Options) -> FilterQuestion:
    """Return the question with that variance of unknown inputs with which a schedule costs most nearly what it does in truth.

    With a finite variance every schedule costs less than in truth, by a share that falls with the variance; what rounding adds grows.
    """
    if not question.disturbance.unknown:
        return question
    candidates = [replace(question, unknown_spread=spread) for spread in UNKNOWN_SPREADS]
    walk = first_walk(problem_of(question, options))
    if walk is None:
        return question
    exact = question.schedule_cost(options.chosen(walk.nodes))
    errors = [problem_of(candidate, options).walk(walk.nodes).value - exact for candidate in candidates]
    return candidates[int(np.argmin(np.abs(errors)))] if np.isfinite(exact) else question
