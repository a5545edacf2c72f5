"""From parameters that break limits to near ones that keep them: least squares of what is missed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.design.nlp.program import Program

_ITERATIONS = 60  # damped steps at most; the search ends before where it is idle
_INSIDE = 1e-4  # by how much more than 0 margins are wanted, so that the last step is not one of many
_DAMPED, _LESS, _MORE, _MOST = 1e-2, 0.2, 5.0, 1e6
_STUCK = 1e-3  # relative gain below which an iteration has come to nothing, so many times in a row
_PATIENCE = 5  # idle iterations in a row: fewer would end where only the damping changes, more cost time where nothing can be repaired


@dataclass(frozen=True, eq=False)
class Repaired:
    """Parameters p (q,), the largest shortfall of a row there, and how many iterations it took."""

    p: np.ndarray
    violation: float
    iterations: int


def repaired(program: Program, p: np.ndarray, enough: float) -> Repaired:
    """Minimise |max(0, d - rows)|^2 over the box from p (q,), until no row falls short by more than `enough`; d = 1e-4.

    Levenberg-Marquardt with the rows that are missed now or would be after a step, the parameters that a step would push out of
    the box held at its sides. A stationary point of what is missed ends it: others may be reached from elsewhere.
    """
    values = program.at(np.clip(p, program.lower, program.upper))
    damping, done, idle, width = _DAMPED, 0, 0, program.upper - program.lower
    while done < _ITERATIONS and idle < _PATIENCE and _violation(values.rows) > enough and damping < _MOST:
        done += 1
        J, before = program.slopes(values).rows * width, _missed(values.rows)
        while damping < _MOST:
            step = _step(J, values.rows, (values.p - program.lower) / width, (program.upper - values.p) / width, damping)
            tried = program.at(np.clip(values.p + step * width, program.lower, program.upper))
            after = _missed(tried.rows)
            if after < before:
                break
            damping *= _MORE
        else:
            break
        idle = idle + 1 if after > (1 - _STUCK) * before else 0
        values, damping = tried, max(damping * _LESS, 1e-9)
    return Repaired(values.p, _violation(values.rows), done)


def _violation(rows: np.ndarray) -> float:
    return max(0.0, -float(rows.min(initial=0.0))) if np.isfinite(rows).all() else np.inf


def _missed(rows: np.ndarray) -> float:
    missed = np.maximum(_INSIDE - rows, 0.0)
    return float(missed @ missed) if np.isfinite(missed).all() else np.inf


def _step(J: np.ndarray, rows: np.ndarray, below: np.ndarray, above: np.ndarray, damping: float) -> np.ndarray:
    """Return d (q,) in [-below, above]: least |max(0, d - rows - J d)|^2 + damping |J| |d|^2, by active sets."""
    active, free, step = rows < _INSIDE, np.ones(len(below), dtype=bool), np.zeros(len(below))
    size = damping * max(float(np.einsum("rq,rq->q", J[active], J[active]).max(initial=0.0)), 1e-12)
    for _ in range(6):
        A, b = J[active], _INSIDE - rows[active] - J[active][:, ~free] @ step[~free]
        step[free] = np.linalg.solve(A[:, free].T @ A[:, free] + size * np.eye(int(free.sum())), A[:, free].T @ b)
        outside = free & ((step < -below) | (step > above))
        step = np.clip(step, -below, above)
        broken = ~active & (rows + J @ step < 0)
        if not outside.any() and not broken.any():
            break
        free, active = free & ~outside, active | broken
        if not free.any():
            break
    return step
