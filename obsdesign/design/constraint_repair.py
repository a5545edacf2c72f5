"""From parameters that break limits to near ones that keep them: least squares of what is missed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.design.nlp.program import Program

_ITERATIONS = 60  # damped steps at most; the search ends before where it is idle
_TARGET_MARGIN = 1e-4  # by how much more than 0 margins are wanted, so that the last step is not one of many
_INITIAL_DAMPING, _DAMPING_DECREASE, _DAMPING_INCREASE, _MAX_DAMPING = 1e-2, 0.2, 5.0, 1e6
_STALL_SHARE = 1e-3  # relative gain below which an iteration has come to nothing, so many times in a row
_PATIENCE = 5  # idle iterations in a row: fewer would end where only the damping changes, more cost time where nothing can be repaired


@dataclass(frozen=True, eq=False)
class Repair:
    """Parameters p (q,), the largest shortfall of a row there, and how many iterations it took."""

    p: np.ndarray
    violation: float
    iterations: int


def repair(program: Program, p: np.ndarray, tolerance: float) -> Repair:
    """Minimise |max(0, d - rows)|^2 over the box from p (q,), until no row falls short by more than `tolerance`; d = 1e-4.

    Levenberg-Marquardt with the rows that are missed now or would be after a step, the parameters that a step would push out of
    the box held at its sides. A stationary point of what is missed ends it: others may be reached from elsewhere.
    """
    evaluation = program.evaluate(np.clip(p, program.lower, program.upper))
    damping, iterations, stalled, width = _INITIAL_DAMPING, 0, 0, program.upper - program.lower
    while iterations < _ITERATIONS and stalled < _PATIENCE and _largest_violation(evaluation.rows) > tolerance and damping < _MAX_DAMPING:
        iterations += 1
        J, old_cost = program.derivatives(evaluation).rows * width, _squared_violation(evaluation.rows)
        while damping < _MAX_DAMPING:
            step = _step(J, evaluation.rows, (evaluation.p - program.lower) / width, (program.upper - evaluation.p) / width, damping)
            trial = program.evaluate(np.clip(evaluation.p + step * width, program.lower, program.upper))
            new_cost = _squared_violation(trial.rows)
            if new_cost < old_cost:
                break
            damping *= _DAMPING_INCREASE
        else:
            break
        stalled = stalled + 1 if new_cost > (1 - _STALL_SHARE) * old_cost else 0
        evaluation, damping = trial, max(damping * _DAMPING_DECREASE, 1e-9)
    return Repair(evaluation.p, _largest_violation(evaluation.rows), iterations)


def _largest_violation(rows: np.ndarray) -> float:
    return max(0.0, -float(rows.min(initial=0.0))) if np.isfinite(rows).all() else np.inf


def _squared_violation(rows: np.ndarray) -> float:
    violation = np.maximum(_TARGET_MARGIN - rows, 0.0)
    return float(violation @ violation) if np.isfinite(violation).all() else np.inf


def _step(J: np.ndarray, rows: np.ndarray, below: np.ndarray, above: np.ndarray, damping: float) -> np.ndarray:
    """Return d (q,) in [-below, above]: least |max(0, d - rows - J d)|^2 + damping |J| |d|^2, by active sets."""
    active, free, step = rows < _TARGET_MARGIN, np.ones(len(below), dtype=bool), np.zeros(len(below))
    size = damping * max(float(np.einsum("rq,rq->q", J[active], J[active]).max(initial=0.0)), 1e-12)
    for _ in range(6):
        A, b = J[active], _TARGET_MARGIN - rows[active] - J[active][:, ~free] @ step[~free]
        step[free] = np.linalg.solve(A[:, free].T @ A[:, free] + size * np.eye(int(free.sum())), A[:, free].T @ b)
        outside = free & ((step < -below) | (step > above))
        step = np.clip(step, -below, above)
        violated = ~active & (rows + J @ step < 0)
        if not outside.any() and not violated.any():
            break
        free, active = free & ~outside, active | violated
        if not free.any():
            break
    return step
