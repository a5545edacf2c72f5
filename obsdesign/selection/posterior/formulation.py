"""From a question to the problem that methods work on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from obsdesign.selection.posterior.bounded_search import first_walk
from obsdesign.selection.posterior.deadline import NEVER, Deadline
from obsdesign.selection.posterior.options import Options
from obsdesign.selection.posterior.problem import PosteriorProblem
from obsdesign.selection.posterior.questions import UNKNOWN_SPREADS, FilterQuestion
from obsdesign.selection.posterior.segment_maps import segment_maps

OF_SEARCH = 0.8
"""Of the time left: what a search may take; the rest is for what is said of its schedule."""
_OF_UNKNOWN_INPUTS = 0.3  # of a time limit: what finding a variance for them may take
_UNTRIED = "time was up: not all variances that may stand for unknown inputs were tried"
_TRIALS = 6  # schedules with which a variance for unknown inputs is judged


def problem_of(question: FilterQuestion, options: Options, deadline: Deadline = NEVER) -> PosteriorProblem:
    """Return the problem that methods work on until a deadline."""
    model = question.linear_model
    maps = segment_maps(model, question.nodes, options.patterns, question.costs)
    return PosteriorProblem(maps, options, model.initial_covariance, question.costs.is_worst, deadline=deadline)


def formulate(question: FilterQuestion, options: Options, deadline: Deadline = NEVER) -> tuple[FilterQuestion, PosteriorProblem]:
    """Return a question with its unknown inputs settled and its problem, for which there is part of the time."""
    question = settle_unknown_inputs(question, options, deadline)
    return question, problem_of(question, options, deadline.share(OF_SEARCH))


def settle_unknown_inputs(question: FilterQuestion, options: Options, deadline: Deadline) -> FilterQuestion:
    """Return the question with that variance of unknown inputs with which the filter's variances are most nearly what they are in truth.

    With a finite variance all of them are smaller than in truth, by a share that falls with it; what rounding does grows with it. Judged
    by the largest relative error at any instant that counts, of a few schedules and a good one, without floors. The smallest variance, with
    which rounding does least, where the deadline is over before all of them are judged.
    """
    if not question.disturbance.unknown:
        return question
    deadline = deadline.share(_OF_UNKNOWN_INPUTS)
    plain = replace(question, floors=np.zeros_like(question.floors))
    walk = first_walk(problem_of(plain, options, deadline))
    trials = np.array([options.chosen(nodes) for nodes in (*_trial_walks(options), *([] if walk is None else [walk.nodes]))])
    if deadline.is_over:
        return replace(question, notes=(_UNTRIED,))
    exact = np.array([plain.deviations(chosen)[question.costs.counted][:, question.costs.about] ** 2 for chosen in trials])
    errors = []
    for spread in UNKNOWN_SPREADS:
        if errors and deadline.is_over:
            return replace(question, unknown_error=errors[0], notes=(_UNTRIED,))
        errors.append(_variance_error(plain, spread, trials, exact))
    best = int(np.argmin(errors))
    return replace(question, unknown_spread=UNKNOWN_SPREADS[best], unknown_error=errors[best])


def _variance_error(question: FilterQuestion, spread: float, trials: np.ndarray, exact: np.ndarray) -> float:
    """Return the largest relative error of the model's variances of schedules (B, K, S), of those that are finite in truth (B, k, q)."""
    active = np.array([question.active(chosen) for chosen in trials])
    covariances = question.model_with(spread).covariances(active)[:, question.costs.counted]
    variances = np.diagonal(covariances, axis1=-2, axis2=-1)[:, :, question.costs.about]
    is_finite = np.isfinite(exact)
    return float(np.abs(variances[is_finite] / exact[is_finite] - 1).max(initial=0.0))


def _trial_walks(options: Options) -> np.ndarray:
    """Return a few walks (B, K), drawn with a seed of their own; what follows what does not matter for what they cost."""
    random = np.random.default_rng(0)
    return np.array([[random.choice(np.flatnonzero(allowed)) for allowed in options.allowed] for _ in range(_TRIALS)])
