"""The relaxation of a problem: a form, constraints, and what a level and multipliers prove together."""

from __future__ import annotations

from dataclasses import dataclass
from math import fsum

import numpy as np

from obsdesign.criteria.log_det import LogDet
from obsdesign.criteria.trace_inverse import TraceInverse
from obsdesign.design.path_bound.gram_constraints import GramConstraints, gram_constraints
from obsdesign.design.path_bound.information_form import InformationForm, information_form
from obsdesign.design.path_bound.motion import AllowedMotion, motion_of
from obsdesign.design.path_bound.sample_bounds import SampleBounds, sample_bounds_of
from obsdesign.design.problem import DesignProblem
from obsdesign.round_off import EPS

_SUM_UP = 1 + 1e-12  # what the roundings of a sum's terms make of it at most
_TRIES = 60  # doublings of the shift at which a matrix is positive definite


@dataclass(frozen=True, eq=False)
class Threshold:
    """slope level - offset: the form of a path that has the criterion value of the level is at least that."""

    slope: float
    offset: float

    def at(self, level: float) -> float:
        """Return the threshold of a level."""
        return self.slope * level - self.offset


@dataclass(frozen=True, eq=False)
class GramRelaxation:
    """Which motions there are, what they tell at most, and the constraints on their Gram matrices."""

    motion: AllowedMotion
    samples: SampleBounds
    form: InformationForm
    constraints: GramConstraints

    # ---------------------------------------------------------------- what is left out along the pieces

    def share(self, level: float) -> float:
        """Return the share e of Young's inequality |a + r|^2 <= (1 + e) |a|^2 + (1 + 1 / e) |r|^2 that costs least at about a level."""
        form = self.form
        return float(max(np.sqrt(form.residual**2 / level + self._residual_gain**2), 1e-12))

    @property
    def _residual_gain(self) -> float:
        """Largest |M^-1 X' r| of what the rows leave out, where the criterion asks for it."""
        form = self.form
        if form.kind is not TraceInverse:
            return 0.0
        return float(np.linalg.norm(np.abs(np.linalg.inv(form.M)) @ form.residual_moments)) * (1 + 1e-9)

    def threshold(self, share: float) -> Threshold:
        """Return the threshold for what is left of a path without its remainder r, at a share e of Young's inequality.

        MinEigenvalue, LogDet: |a + r|^2 + heading < (1 + e) level if |a|^2 < level - heading / (1 + e) - |r|^2 / e.
        TraceInverse: the explained part loses as well, |K (z + r)|^2 >= (1 - e) |K z|^2 - (1 / e - 1) |K r|^2.
        """
        form, slope = self.form, 1.0
        if form.kind is TraceInverse:
            slope = (1 - (1 / share - 1) * self._residual_gain**2) / (1 - share) * (1 - 1e-14)
        return Threshold(slope, (form.heading / (1 + share) + form.residual**2 / share) * _SUM_UP)

    def gain(self, level: float) -> np.ndarray:
        """Return K (c, d) for a level; any would do for MinEigenvalue and LogDet."""
        return self.form.gain(0.0 if self.form.kind is TraceInverse else level)

    # ---------------------------------------------------------------- what is proven

    def value_of(self, level: float, share: float) -> float:
        """Return the criterion value that no path exceeds once the level is proven."""
        form = self.form
        if form.kind is TraceInverse:
            level = level * (1 + share) / (1 - share)
            return (self.value_of_positions - 1 / (level * _SUM_UP)) * (1 - 1e-14)
        level = level * (1 + share) * _SUM_UP
        if form.kind is LogDet:
            return 2 * float(np.linalg.slogdet(form.M)[1]) + float(np.log(level)) + 2 * len(form.M) * form.moment_rounding
        return level

    @property
    def value_of_positions(self) -> float:
        """The criterion value that no path exceeds as none changes what samples say of position and wind; inf where it has no limit."""
        form = self.form
        if form.kind is not TraceInverse:
            return form.largest_level * (1 + form.moment_rounding)
        return -2 * float(np.trace(np.linalg.inv(form.M))) * max(0.0, 1 - form.moment_rounding)

    def proves(self, level: float, share: float, multipliers: np.ndarray) -> bool:
        """Whether these multipliers (m,) prove that no path has the level's value: max of the form < threshold, rounding included.

        For y >= 0 on what is one-sided, R = sum y_i A_i - F + level E and e a lower bound of its smallest eigenvalue,
        max <F - level E, G> <= sum y_i b_i + sum |y_i| spread_i + max(-e, 0) trace G.
        """
        set_up, form = self.constraints, self.form
        if not (0 < level < form.largest_level * (1 - 1e-9) and 0 < share < 1 and np.isfinite(multipliers).all()):
            return False
        y, K, R = set_up.admissible(multipliers), self.gain(level), self.slack_matrix(level, multipliers)
        combined = set_up.coefficients.T @ y
        size = np.abs(set_up.coefficients).T @ np.abs(y)
        absolute = np.linalg.norm((np.abs(set_up.U) * size) @ np.abs(set_up.U).T)
        margin = form.rounding(K, level) + 4 * (len(y) + len(combined)) * EPS * float(absolute) + self._gain_error(K) * level
        deficit = _eigenvalue_deficit((R + R.T) / 2) + margin
        terms = [*(y * set_up.limits).tolist(), *(np.abs(y) * set_up.spread).tolist(), deficit * set_up.largest_trace]
        if not np.isfinite(np.sum(np.abs(terms))):
            return False
        bound = fsum(terms) + 4 * EPS * fsum(map(abs, terms))
        limit = self.threshold(share)
        return bool(bound < limit.at(level) - 8 * EPS * (abs(limit.slope * level) + abs(limit.offset)))

    def slack_matrix(self, level: float, multipliers: np.ndarray) -> np.ndarray:
        """Return R = sum y_i A_i - F + level E (d, d)."""
        set_up, form, K = self.constraints, self.form, self.gain(level)
        combined = set_up.coefficients.T @ set_up.admissible(multipliers)
        return (set_up.U * combined) @ set_up.U.T - form.matrix(K) + level * form.explained(K)

    def _gain_error(self, K: np.ndarray) -> float:
        """How far |K z|^2 may be from exact in norm where it has to be that of the exact K: by the rest of M K = X' rows."""
        form = self.form
        if form.kind is not TraceInverse:
            return 0.0
        rest = np.linalg.norm(form.M @ K - form.moments) + 1e-14 * len(form.rows) * np.linalg.norm(np.abs(form.X).T @ np.abs(form.rows))
        error = float(rest / max(np.linalg.eigvalsh(form.M)[0], 1e-300))
        return 2 * error * float(np.linalg.norm(K)) + error**2


def _eigenvalue_deficit(R: np.ndarray) -> float:
    """Return d >= 0 with R + d I >= 0, whatever rounding does: a Cholesky factor that runs through proves it.

    Source: Rump, Verification of positive definiteness (2006): of R + d I less c I, c = (n + 1) eps / (1 - (n + 1) eps) times the trace.
    """
    n = len(R)
    if not np.isfinite(R).all():
        return np.inf
    deficit = max(0.0, -float(np.linalg.eigvalsh(R)[0]))
    step = 8 * n * EPS * float(np.abs(np.diag(R)).sum()) + 1e-300
    for k in range(_TRIES):
        shift = (step * 2.0**k if k else 0.0) + deficit
        reserve = 2 * (n + 2) * EPS * float(np.abs(np.diag(R)).sum() + n * shift)
        try:
            np.linalg.cholesky(R + (shift - reserve) * np.eye(n))
        except np.linalg.LinAlgError:
            continue
        return shift
    return np.inf


def relaxation_of(problem: DesignProblem, lengths: tuple[int, ...] | None = None) -> GramRelaxation:
    """Return the relaxation; lengths: steps of the pieces of its Gram matrix, None = those in which inputs are held.

    Raises InputError with the reason where there is none.
    """
    motion = motion_of(problem, lengths)
    samples = sample_bounds_of(problem, motion)
    return GramRelaxation(motion, samples, information_form(problem, motion, samples), gram_constraints(motion))
