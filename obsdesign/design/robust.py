"""Judging a path from draws of a prior rather than from one start."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.checks import require_count
from obsdesign.prior import Prior


@dataclass(frozen=True)
class Robust:
    """Judge the path from draws of the prior of x(t_0), with the same inputs: by the worst of them, or by their mean.

    The same seed, the same draws. Limits hold on the path from the problem's own start.
    """

    prior: Prior
    """Where x(t_0) may be."""
    samples: int = 16
    """Number of draws."""
    worst: bool = True
    """Whether the worst of the draws counts; False: their mean."""
    seed: int = 0
    """Seed of the draws."""

    def __post_init__(self) -> None:
        require_count("robust: samples", self.samples)
        require_count("robust: seed", self.seed, minimum=0)

    def draws(self, count: int, seed: int) -> np.ndarray:
        """Return `count` starts (count, n) from the prior, in the units of the states; other draws for another seed."""
        normal = np.random.default_rng([self.seed, seed]).standard_normal((count, self.prior.mean.size))
        return self.prior.mean + normal @ np.linalg.cholesky(self.prior.covariance).T
