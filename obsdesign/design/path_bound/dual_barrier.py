"""The least level that multipliers prove: an interior-point method for one matrix inequality of low-rank terms."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve, solve_triangular

from obsdesign.design.path_bound.relaxation import GramRelaxation, Threshold
from obsdesign.errors import InputError

_SHRINK, _NEWTON_STEPS, _STAGES = 0.2, 100, 40  # of the barrier; Newton steps at one size of it; sizes
_CENTRED = 0.3  # Newton decrement at which the barrier shrinks
_TURNS, _ROUGH, _SETTLED = 12, 3e-3, 0.02  # levels in turns; tolerance of those before the last; relative change at which the next is last
_NEARER, _PROMISE = 0.1, 0.5  # share of the way to the top that the next guess keeps; of what a level lies above it, where another is tried
_ABSOLUTE = 1e-5  # times the form's norm: below it |y| is round
_DOMINANT = 100.0  # times the form's norm: where multipliers of headings and ends begin at least; small ones stall


@dataclass(frozen=True, eq=False)
class DualPoint:
    """A level, the share of Young's inequality and multipliers (m,); newton_steps: that it took."""

    level: float
    share: float
    multipliers: np.ndarray
    newton_steps: int


@dataclass(frozen=True, eq=False)
class _Barrier:
    """minimise level / mu - log det R - log(threshold - b'y - spread'|y|) - sum of log y_i over one-sided i, v = (level, y).

    |y| is rounded, (y^2 + rounding^2)^1/2, so that it has derivatives.
    """

    V: np.ndarray
    coefficients: np.ndarray
    F: np.ndarray
    limits: np.ndarray
    spread: np.ndarray
    one_sided: np.ndarray
    threshold: Threshold

    def slack(self, v: np.ndarray) -> float:
        """Threshold - b'y - spread'|y|."""
        return self.threshold.at(v[0]) - float(self.limits @ v[1:] + self.spread @ np.hypot(v[1:], _ABSOLUTE))

    def factor(self, v: np.ndarray) -> np.ndarray | None:
        """Return the Cholesky factor of R, None outside of the domain."""
        if self.slack(v) <= 0 or (v[1:][self.one_sided] <= 0).any():
            return None
        R = (self.V * (self.coefficients.T @ v)) @ self.V.T - self.F
        try:
            return np.linalg.cholesky(R)
        except np.linalg.LinAlgError:
            return None

    def value(self, v: np.ndarray, mu: float, L: np.ndarray) -> float:
        """Return the barrier function."""
        logs = 2 * np.log(np.diag(L)).sum() + np.log(self.slack(v)) + np.log(v[1:][self.one_sided]).sum()
        return float(v[0] / mu - logs)

    def newton(self, v: np.ndarray, mu: float, L: np.ndarray) -> tuple[np.ndarray, float]:
        """Return Newton's step and the decrement."""
        Z = solve_triangular(L, self.V, lower=True, check_finite=False)
        Q = Z.T @ Z
        s = self.slack(v)
        size = np.hypot(v[1:], _ABSOLUTE)
        a = np.concatenate([[self.threshold.slope], -self.limits - self.spread * v[1:] / size]) / s
        inverse = np.zeros(len(v))
        inverse[1:][self.one_sided] = 1 / v[1:][self.one_sided]
        gradient = -(self.coefficients @ np.diag(Q)) - a - inverse
        gradient[0] += 1 / mu
        H = self.coefficients @ (Q * Q) @ self.coefficients.T + np.outer(a, a)
        bend = self.spread * _ABSOLUTE**2 / size**3 / s
        H[np.diag_indices_from(H)] += inverse**2 + np.concatenate([[0.0], bend])
        d = 1 / np.sqrt(np.diag(H))
        H = H * d[:, None] * d
        H[np.diag_indices_from(H)] += 1e-13
        step = -d * cho_solve(cho_factor(H, check_finite=False), d * gradient, check_finite=False)
        return step, float(np.sqrt(max(0.0, -gradient @ step)))


def least_level(relaxation: GramRelaxation, guess: float, tolerance: float) -> DualPoint | None:
    """Return the least level to a relative tolerance, or None where it is not below what no path changes.

    The form is that of a K, and any K gives a bound; the one of the level reached gives the least. So levels are looked for in turns,
    each for the K of the one before: near the end their error is squared from one to the next.
    """
    top, count, best = relaxation.form.largest_level, 0, None
    is_settled, failures = False, list[tuple[float, float]]()
    for _ in range(_TURNS):
        proof = _least_level_for(relaxation, guess, tolerance if is_settled else max(tolerance, _ROUGH))
        if proof is None or proof.level >= top:
            failures.append((guess, np.inf if proof is None else proof.level))
            guess = _other_guess(failures, top)
            if not guess:
                break
            continue
        count += proof.newton_steps
        best = replace(proof, newton_steps=count)
        if is_settled:
            break
        is_settled, guess = abs(proof.level - guess) <= _SETTLED * guess, proof.level
    return best


def _other_guess(failures: list[tuple[float, float]], top: float) -> float:
    """Return where to look after guesses whose levels were none below what no path changes, 0 where nothing is to be hoped for.

    The level is least for the K of its own guess and grows to both sides: a guess nearer to the top comes to less, or the level lies
    below the first.
    """
    first, guess = failures[0], failures[-1][0]
    nearer = top - _NEARER * (top - guess)
    if not np.isfinite(top) or (len(failures) > 1 and guess < first[0]):
        return guess / 2
    if len(failures) == 1:
        return nearer
    before, after = failures[-2][1], failures[-1][1]
    if after < before:
        return nearer if after - top < _PROMISE * (before - top) else 0.0
    return first[0] / 2 if len(failures) == 2 else 0.0


def _least_level_for(relaxation: GramRelaxation, guess: float, tolerance: float) -> DualPoint | None:
    """Return the least level for the K of a guess of it, whatever that level comes to."""
    form = relaxation.form
    K, share = relaxation.gain(guess), relaxation.share(guess)
    size = float(np.linalg.norm(form.matrix(K), 2))
    if not 0 < size < np.inf:
        return None
    barrier = _barrier(relaxation, K, share, size)
    v, mu, count, cones = _first_point(relaxation, barrier), 1.0, 0, len(K.T) + int(barrier.one_sided.sum()) + 1
    for _ in range(_STAGES):
        v, steps = _centre(barrier, v, mu)
        count += steps
        if mu * cones < tolerance * v[0] or barrier.factor(v) is None:
            break
        if v[0] < 0:
            raise InputError("no path keeps the limits, as far as the relaxation tells")  # a sum of squares would be below 0
        mu *= _SHRINK
    return None if barrier.factor(v) is None else DualPoint(float(v[0] * size), share, v[1:] * size, count)


def _barrier(relaxation: GramRelaxation, K: np.ndarray, share: float, size: float) -> _Barrier:
    form, set_up = relaxation.form, relaxation.constraints
    explained = np.sqrt(form.judged)[:, None] * K
    V = np.hstack([set_up.U, explained.T])
    coefficients = np.zeros((1 + len(set_up.limits), V.shape[1]))
    coefficients[1:, : set_up.U.shape[1]] = set_up.coefficients
    coefficients[0, set_up.U.shape[1] :] = 1.0
    threshold = relaxation.threshold(share)
    return _Barrier(
        V,
        coefficients,
        form.matrix(K) / size,
        set_up.limits,
        set_up.spread,
        ~set_up.is_two_sided,
        replace(threshold, offset=threshold.offset / size),
    )


def _first_point(relaxation: GramRelaxation, barrier: _Barrier) -> np.ndarray:
    """A point well inside: frame, lengths and sagittas carry the form, headings and ends are dominant."""
    set_up = relaxation.constraints
    K = len(relaxation.motion.lengths)
    y = np.maximum(_DOMINANT, 1 / np.maximum(set_up.limits, 1e-6))
    y[:2], y[2] = _DOMINANT, 0.0
    y[3 : 3 + 3 * K : 3], y[4 : 3 + 3 * K : 3], y[5 : 3 + 3 * K : 3] = 2.0, 2.0, 0.0
    level = (2 * float((set_up.limits + set_up.spread) @ y) + barrier.threshold.offset + 1.0) / barrier.threshold.slope
    return np.concatenate([[level], y])


def _centre(barrier: _Barrier, v: np.ndarray, mu: float) -> tuple[np.ndarray, int]:
    L = barrier.factor(v)
    for count in range(_NEWTON_STEPS):
        if L is None:
            return v, count
        try:
            step, decrement = barrier.newton(v, mu, L)
        except LinAlgError:
            return v, count
        if decrement < _CENTRED:
            return v, count
        v, L, moved = _line_search(barrier, v, step, decrement, mu, L)
        if not moved:
            return v, count
    return v, _NEWTON_STEPS


def _line_search(
    barrier: _Barrier, v: np.ndarray, step: np.ndarray, decrement: float, mu: float, L: np.ndarray
) -> tuple[np.ndarray, np.ndarray, bool]:
    """Halve from the full step until the barrier falls by a tenth of what its slope promises."""
    before, length = barrier.value(v, mu, L), 1.0
    for _ in range(40):
        candidate = v + length * step
        factor = barrier.factor(candidate)
        if factor is not None and barrier.value(candidate, mu, factor) <= before - 0.1 * length * decrement**2:
            return candidate, factor, True
        length /= 2
    return v, L, False
