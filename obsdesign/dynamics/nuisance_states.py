"""Errors of samples that last or hang together, as states of their own: what makes the samples independent given them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from obsdesign.dynamics.model import Model
from obsdesign.dynamics.step import CACHE_SIZE, steps_per_sample


@dataclass(frozen=True, eq=False)
class NuisanceStates:
    """y_i = h_i(x) + s_i z_i + bias_i b_i for the outputs i of a model, s_i = inflation spread_i: z and b are nuisance states.

    coloured: the outputs (a of them) whose z_i is a state, z_k+1 = decay z_k + w_k from step to step, of covariance R (a, a), 1 on
    its diagonal, at every instant, for as long as w has the covariance `fresh` = R - decay R decay; all others have z_i ~ N(0, 1)
    anew in each sample. From sample to sample that is the sensor's own correlation, decay = correlation^(1 / steps between
    samples), and correlation^m where m - 1 samples are missing. constant: the outputs (c of them) whose b_i ~ N(0, 1) lasts.
    """

    coloured: tuple[int, ...]
    constant: tuple[int, ...]
    decay: np.ndarray
    R: np.ndarray
    bias: np.ndarray

    @property
    def size(self) -> int:
        """a + c."""
        return len(self.coloured) + len(self.constant)

    @cached_property
    def driving_covariance(self) -> np.ndarray:
        """R_ij (1 - decay_i decay_j) (a, a), without loss where both are near 1."""
        with np.errstate(divide="ignore"):
            rate = np.log(self.decay)
        return -self.R * np.expm1(rate[:, None] + rate)

    @cached_property
    def transition(self) -> np.ndarray:
        """What one step leaves of each of (z, b) (a + c,)."""
        return np.concatenate([self.decay, np.ones(len(self.constant))])

    def loads(self, output: int) -> list[tuple[int, float]]:
        """Return where b stands in an error of this output, and its bias there; empty without a constant error."""
        return [(index, self.bias[index]) for index, i in enumerate(self.constant) if i == output]


@lru_cache(CACHE_SIZE)
def nuisance_of(model: Model, step: float) -> NuisanceStates:
    """Return the nuisance states of a model's sensors for steps of `step` seconds; raise InputError for rates that do not fit."""
    noises = [model.channels[sensor].noise for sensor in model.output_owner]
    R = model.correlation_root @ model.correlation_root.T
    is_uncorrelated = (R != 0).sum(axis=1) == 1
    coloured = tuple(i for i, noise in enumerate(noises) if noise.correlation or not is_uncorrelated[i])
    constant = tuple(i for i, noise in enumerate(noises) if noise.bias)
    periods = steps_per_sample(model, step) if coloured else ()
    decay = np.array([noises[i].correlation ** (1 / periods[model.output_owner[i]]) for i in coloured])
    return NuisanceStates(coloured, constant, decay, R[np.ix_(coloured, coloured)], np.array([noises[i].bias for i in constant]))
