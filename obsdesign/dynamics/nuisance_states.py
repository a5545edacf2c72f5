"""Errors of samples that last or hang together, as states of their own: what makes the samples independent given them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from obsdesign.dynamics.model import Model
from obsdesign.dynamics.step import CACHE_SIZE, steps_per_sample

if TYPE_CHECKING:
    import casadi as ca


@dataclass(frozen=True, eq=False)
class NuisanceStates:
    """y_i = h_i(x) + s_i z_i + bias_i b_i for the outputs i of a model, s_i = inflation spread_i: z and b are nuisance states.

    coloured: the outputs (a of them) whose z_i is a state, z_k+1 = decay z_k + w_k from step to step, of covariance R (a, a), 1 on
    its diagonal, at every instant, for as long as w has the covariance `fresh` = R - decay R decay; all others have z_i ~ N(0, 1)
    anew in each sample. decay = exp(-rate length): from sample to sample that is the sensor's own correlation, correlation^m where
    m - 1 samples are missing. rate (a,): per step, or per second where steps have lengths of their own; inf for what is drawn anew.
    constant: the outputs (c of them) whose b_i ~ N(0, 1) lasts.
    """

    coloured: tuple[int, ...]
    constant: tuple[int, ...]
    rate: np.ndarray
    R: np.ndarray
    bias: np.ndarray

    @property
    def size(self) -> int:
        """a + c."""
        return len(self.coloured) + len(self.constant)

    def decays(self, lengths: np.ndarray) -> np.ndarray:
        """Return decay (N, a) over steps of lengths (N,): ones, or in seconds where these count."""
        return np.exp(-_products(lengths, self.rate))

    def driving_covariances(self, lengths: np.ndarray) -> np.ndarray:
        """Return R_ij (1 - decay_i decay_j) (N, a, a), without loss where both are near 1."""
        exponent = _products(lengths, self.rate)
        return -self.R * np.expm1(-exponent[:, :, None] - exponent[:, None])

    def decay_graph(self, model: Model) -> ca.SX:
        """Return decay (a, 1) of a step."""
        import casadi as ca

        if not model.is_per_step:
            return ca.SX(ca.DM(self.decays(np.ones(1))[0]))
        return ca.vertcat(ca.SX(0, 1), *[ca.exp(-rate * model.u[0]) if rate < np.inf else ca.SX(0) for rate in self.rate.tolist()])

    def driving_root(self, model: Model) -> ca.SX:
        """Return a root (a, a) of the covariance of w in a step: Cholesky's factor."""
        import casadi as ca

        if not model.is_per_step:
            return ca.SX(ca.sparsify(ca.DM(np.linalg.cholesky(self.driving_covariances(np.ones(1))[0]))))
        # what is correlated in time is so with nothing beside it
        sizes = [ca.sqrt(-ca.expm1(-2 * rate * model.u[0])) if rate < np.inf else ca.SX(1) for rate in self.rate.tolist()]
        return ca.diag(ca.vertcat(ca.SX(0, 1), *sizes)) @ ca.SX(ca.sparsify(ca.DM(np.linalg.cholesky(self.R))))

    def loads(self, output: int) -> list[tuple[int, float]]:
        """Return where b stands in an error of this output, and its bias there; empty without a constant error."""
        return [(index, self.bias[index]) for index, i in enumerate(self.constant) if i == output]


def _products(lengths: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """Return lengths x rates (N, a), inf for an infinite rate over no time too: what is drawn anew is so at each instant."""
    is_lasting = rate < np.inf
    return np.where(is_lasting, lengths[:, None] * np.where(is_lasting, rate, 0.0), np.inf)


@lru_cache(CACHE_SIZE)
def nuisance_of(model: Model, step: float) -> NuisanceStates:
    """Return the nuisance states of a model's sensors for steps of `step` seconds; raise InputError for rates that do not fit."""
    noises = [model.channels[sensor].noise for sensor in model.output_owner]
    R = model.correlation_root @ model.correlation_root.T
    is_uncorrelated = (R != 0).sum(axis=1) == 1
    coloured = tuple(i for i, noise in enumerate(noises) if noise.correlation or not is_uncorrelated[i])
    constant = tuple(i for i, bias in enumerate(model.output_bias) if bias)
    periods = steps_per_sample(model, step) if coloured else ()
    spans = [noises[i].period or periods[model.output_owner[i]] for i in coloured]
    with np.errstate(divide="ignore"):
        rate = -np.log(np.array([noises[i].correlation for i in coloured])) / np.array(spans)
    return NuisanceStates(coloured, constant, rate, R[np.ix_(coloured, coloured)], np.array([model.output_bias[i] for i in constant]))
