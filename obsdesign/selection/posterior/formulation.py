"""From a question to the problem that methods work on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from obsdesign.information.linear_model import LinearModel
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
_OTHER_UNIT = 1.3  # no power of two: rounding differs
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
    """Return the question with that variance of unknown inputs with which bounds come nearest to what is true.

    With a finite variance all of the filter's variances are smaller than in truth, by a share that falls with it: bounds hold. What
    rounding does grows with it, and has to be taken off bounds, ten times. Both are judged at all instants that count, without floors: the
    share by a good schedule, rounding by that and a few others. The smallest variance where the deadline is over before all are judged.
    """
    if not question.disturbance.unknown:
        return question
    deadline = deadline.share(_OF_UNKNOWN_INPUTS)
    plain = replace(question, floors=np.zeros_like(question.floors))
    walk = first_walk(problem_of(plain, options, deadline))
    trials = [options.chosen(nodes) for nodes in (*([] if walk is None else [walk.nodes]), *_trial_walks(options))]
    if deadline.is_over:
        return replace(question, notes=(_UNTRIED,))
    active = np.array([question.active(chosen) for chosen in trials])
    exact = np.array([plain.deviations(chosen)[question.costs.counted][:, question.costs.about] ** 2 for chosen in trials])
    losses, errors = [], []
    for spread in UNKNOWN_SPREADS:
        if errors and deadline.is_over:
            return replace(question, unknown_error=errors[0], notes=(_UNTRIED,))
        model = plain.model_with(spread)
        variances = _variances(question, model, active)
        errors.append(_largest_difference(variances, _variances(question, model, active, _OTHER_UNIT), exact))
        losses.append(_largest_difference(variances[:1], exact[:1], exact[:1]) + 10 * errors[-1])
    best = int(np.argmin(losses))
    return replace(question, unknown_spread=UNKNOWN_SPREADS[best], unknown_error=errors[best])


def _variances(question: FilterQuestion, model: LinearModel, active: np.ndarray, unit: float = 1.0) -> np.ndarray:
    """Return the variances (B, k, q) of what is asked about with samples (B, N, S), computed with other units of the states.

    unit^(i + 1) is that of state i. But for rounding they make no difference.
    """
    units = unit ** np.arange(1, 1 + len(model.initial_covariance))
    covariances = model.in_units(units).covariances(active)[:, question.costs.counted]
    return np.diagonal(covariances, axis1=-2, axis2=-1)[:, :, question.costs.about] * units[question.costs.about] ** 2


def _largest_difference(variances: np.ndarray, others: np.ndarray, exact: np.ndarray) -> float:
    """Return by which share of the true ones variances differ from others at most, where these are finite."""
    is_known = np.isfinite(exact) & (exact > 0)
    return float((np.abs(variances - others)[is_known] / exact[is_known]).max(initial=0.0))


def _trial_walks(options: Options) -> np.ndarray:
    """Return a few walks (B, K), drawn with a seed of their own; what follows what does not matter for what they cost."""
    random = np.random.default_rng(0)
    return np.array([[random.choice(np.flatnonzero(allowed)) for allowed in options.allowed] for _ in range(_TRIALS)])
