"""The quadratic form of a path whose values bound a criterion: rows of the heading less what position and wind explain of them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from obsdesign.criteria.log_det import LogDet
from obsdesign.criteria.min_eigenvalue import MinEigenvalue
from obsdesign.criteria.trace_inverse import TraceInverse
from obsdesign.design.path_bound.motion import AllowedMotion
from obsdesign.design.path_bound.sample_bounds import SampleBounds
from obsdesign.design.problem import DesignProblem
from obsdesign.design.upper_bound import rounding_of_sum
from obsdesign.errors import InputError
from obsdesign.round_off import EPS


@dataclass(frozen=True, eq=False)
class InformationForm:
    """F_K(z) - level |K z|^2_E < level - heading says that no path z has the criterion value that belongs to the level.

    F_K(z) = sum_k |rows_k z - X_k K z|^2 + |K z|^2_prior for any K (c, d): rows (N, d) is the heading's share of the samples as a
    linear function of the d vectors, X (N, c) that of position and wind, both over the samples' standard deviations and in units S.
    prior (c,), judged (c,): diagonals; heading: what compass and knowledge say of the heading; residual: root of sum of squares of what
    `rows` leaves out; residual_moments (c,): largest part of X' rows that it leaves out.
    """

    rows: np.ndarray
    X: np.ndarray
    prior: np.ndarray
    judged: np.ndarray
    heading: float
    residual: float
    residual_moments: np.ndarray
    kind: type

    @cached_property
    def M(self) -> np.ndarray:
        """X'X + prior (c, c): what the samples say of position and wind along one axis."""
        return self.X.T @ self.X + np.diag(self.prior)

    @cached_property
    def moment_rounding(self) -> float:
        """How far eigenvalues of M, and the logarithm and the inverse of them, may be from exact, relative."""
        return rounding_of_sum(self.M, len(self.rows)) + 1e-12

    @cached_property
    def moments(self) -> np.ndarray:
        """X' rows (c, d)."""
        return self.X.T @ self.rows

    def gain(self, level: float) -> np.ndarray:
        """Return the K (c, d) that makes the form least at a level: (M - level E)^-1 X' rows."""
        return np.linalg.solve(self.M - level * np.diag(self.judged), self.moments)

    def explained(self, K: np.ndarray) -> np.ndarray:
        """Return the matrix of |K z|^2_E."""
        return K.T @ (self.judged[:, None] * K)

    def matrix(self, K: np.ndarray) -> np.ndarray:
        """Return the matrix (d, d) of F_K."""
        rest = self.rows - self.X @ K
        return rest.T @ rest + K.T @ (self.prior[:, None] * K)

    def rounding(self, K: np.ndarray, level: float) -> float:
        """Return how far, in norm, matrix(K) - level explained(K) as computed is from exact at most."""
        size = np.abs(self.rows) + np.abs(self.X) @ np.abs(K)
        terms = size.T @ size + np.abs(K).T @ ((self.prior + level * self.judged)[:, None] * np.abs(K))
        return 4 * (len(self.rows) + 20) * EPS * float(np.linalg.norm(terms))

    @property
    def largest_level(self) -> float:
        """Below which M - level E > 0: what samples say of position and wind alone, as no path changes it; inf where E = 0."""
        roots = np.sqrt(self.judged)
        if not roots.any():
            return np.inf
        inverse = np.linalg.inv(self.M)
        return float(1 / np.linalg.eigvalsh(roots[:, None] * inverse * roots)[-1])


def information_form(problem: DesignProblem, motion: AllowedMotion, samples: SampleBounds) -> InformationForm:
    """Return the form; raises InputError for a criterion without one."""
    kind = type(problem.criterion)
    if kind not in (MinEigenvalue, LogDet, TraceInverse):
        raise InputError(f"the criterion {kind.__name__} has no such bound")
    names, has_wind = problem.system.model.state_names, len(problem.x0) > 3
    judged = np.isin(names, problem.about or names).astype(float)
    if not judged[2] or (kind is not MinEigenvalue and not judged.all()):
        raise InputError("the heading is not judged" if not judged[2] else f"{kind.__name__} of some of the states only")
    S = problem.units
    size, heading_size = np.array([S[:2].max(), *([S[3:5].max()] if has_wind else [])]), S[2]
    t = np.arange(motion.steps) * motion.step
    X = samples.weigh(np.stack([np.ones_like(t), t], axis=1)[:, : len(size)] * size)
    rows, errors = _heading_rows(motion)
    prior = np.array([samples.known_position, samples.known_wind])[: len(size)] * size**2
    pairs = np.array([judged[:2].min(), *([judged[3:5].min()] if has_wind else [])])
    scaled_errors = heading_size * samples.weigh_errors(errors)
    form = InformationForm(
        rows=heading_size * samples.weigh(rows),
        X=X,
        prior=prior,
        judged=pairs if kind is MinEigenvalue else np.ones(len(size)) * (kind is TraceInverse),
        heading=samples.heading * heading_size**2,
        residual=float(np.linalg.norm(scaled_errors)) * (1 + 1e-12),
        residual_moments=(np.abs(X).T @ scaled_errors) * (1 + 1e-12),
        kind=kind,
    )
    if not np.isfinite(form.moment_rounding):
        raise InputError("samples and knowledge leave a position or the wind unknown, whatever the path")
    return form


def _heading_rows(motion: AllowedMotion) -> tuple[np.ndarray, np.ndarray]:
    """The places at the N samples [m] as combinations of e_x, e_y, chords and sagittas (N, 2 + 2 K), and how far off they may be (N,)."""
    K = len(motion.lengths)
    rows, errors, k = np.zeros((motion.steps, 2 + 2 * K)), np.zeros(motion.steps), 0
    for j, steps in enumerate(motion.lengths):
        arc, size = motion.arcs(steps), motion.speed * motion.step * steps
        for (first, second), error in zip(arc.places, arc.errors, strict=True):
            rows[k, 2 : 2 + j] = motion.speed * motion.step * np.array(motion.lengths[:j])
            rows[k, 2 + j], rows[k, 2 + K + j] = first * size, -second * size * arc.sagitta
            errors[k] = error * size + 1e-13 * motion.speed * motion.step * (k + 1)
            k += 1
    return rows, errors
