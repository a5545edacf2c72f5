"""How much of what a stretch of samples says may be counted when it is added to that of others, whose errors it shares."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.information.correlated_noise import Colour

_SMALLEST = 1e-300  # where samples at one time stand in different stretches: each amount is next to nothing


@dataclass(frozen=True, eq=False)
class AdditiveFactors:
    """factor (N, q) <= 1: what each sample's information is multiplied by; bias_factor (q,) >= 1: what the variance of
    its constant is."""

    factor: np.ndarray
    bias_factor: np.ndarray

    def rows(self, firsts: np.ndarray) -> list[np.ndarray]:
        """Return fresh (N, 1), factor and spread (N, q) for the recursion over stretches that begin at steps `firsts`."""
        is_first = np.zeros((len(self.factor), 1))
        is_first[firsts[firsts < len(is_first)]] = 1.0
        return [is_first, self.factor, np.tile(self.bias_factor, (len(self.factor), 1))]


def additive_factors(colour: Colour, sampling: np.ndarray, firsts: np.ndarray, decay: np.ndarray | None = None) -> AdditiveFactors:
    """Return what makes amounts of K stretches, which begin at steps `firsts`, a bound from below for every choice of them.

    With R_k the covariance of a stretch's errors alone, R <= diag(c R_k) makes sum A_k' (c R_k)^-1 A_k <= A' R^-1 A, for any part of
    the stretches as well (a part of R is a part of the right side).

    - correlation phi: c = (1 + phi) / (1 - phi^L), L the number of samples of the shortest stretch (the first and the last are
      parts of longer ones). Whitened, the last error of a stretch and the first of the d-th one after it have the correlation
      phi^(1 + (d - 1) L), those two of one stretch phi^(L - 1), and all others none, so that what stretches have in common has
      the norm (phi + phi^L) / (1 - phi^L), that of its row sums. L = 1: the well-known (1 + phi) / (1 - phi). Two stretches: 1 + phi.
      With decays (N, q) from each instant to the next: c = (1 + r) / (1 - s r), r the largest correlation of the last sample of a
      stretch with the first of the next, s that of the first and the last sample of an inner stretch.
    - constant: 1 1' <= diag(K 1_k 1_k'), as (sum of K numbers)^2 <= K times the sum of their squares.
    - joint noise: c is the largest eigenvalue of R with the parts of its sensors made units, of the sensors with a sample at that
      instant.
    """
    owner = np.array(colour.owner)
    ends = np.append(firsts[1:], len(sampling))
    factor, bias_factor = np.ones(sampling.shape), np.ones(colour.q)
    for s in range(len(colour.sensors)):
        outputs = np.flatnonzero(owner == s)
        clock = np.concatenate([[0], np.cumsum(sampling[:, outputs[0]])])
        counts = clock[ends] - clock[firsts]
        counts = counts[counts > 0]
        bias_factor[outputs] = max(1, len(counts))
        for j in outputs:
            if decay is None or not colour.correlation[j]:
                factor[:, j] = 1 / _time_factor(colour.correlation[j], counts)
            else:
                factor[:, j] = 1 / _uneven_time_factor(decay[:, j], np.flatnonzero(sampling[:, j]), firsts)
    for members, correlation in colour.groups:
        factor[:, members] /= _joint_factor(np.array(correlation), owner[list(members)], sampling[:, members])[:, None]
    return AdditiveFactors(factor, bias_factor)


def _time_factor(phi: float, counts: np.ndarray) -> float:
    """c for stretches of so many samples."""
    if not phi or len(counts) < 2:
        return 1.0
    if len(counts) == 2:
        return 1 + phi
    return (1 + phi) / (1 - phi ** int(counts[1:-1].min()))


def _uneven_time_factor(decay: np.ndarray, sampled: np.ndarray, firsts: np.ndarray) -> float:
    """c for samples at instants, decay (N,) from each instant to the next."""
    stretch = np.searchsorted(firsts, sampled, side="right")
    is_first = np.append(True, np.diff(stretch) != 0)
    begins, ends = sampled[is_first], sampled[np.append(is_first[1:], True)]
    if len(begins) < 2:
        return 1.0
    ages = np.append(0.0, -np.cumsum(np.log(decay)))  # what is left between a and b is exp(ages[a] - ages[b])
    r = float(np.exp(ages[ends[:-1]] - ages[begins[1:]]).max())
    if len(begins) == 2:
        return 1 + r
    return (1 + r) / max(1 - r * float(np.exp(ages[begins[1:-1]] - ages[ends[1:-1]]).max()), _SMALLEST)


def _joint_factor(correlation: np.ndarray, owner: np.ndarray, sampling: np.ndarray) -> np.ndarray:
    """c (N,) of a group at each instant, by who of it has a sample then."""
    patterns, pattern_index = np.unique(sampling, axis=0, return_inverse=True)
    factors = np.ones(len(patterns))
    for i, pattern in enumerate(patterns):
        members = np.flatnonzero(pattern)
        if len(members):
            R, member_owner = correlation[np.ix_(members, members)], owner[members]
            root = np.linalg.cholesky(np.where(member_owner[:, None] == member_owner, R, 0.0))
            whitened_correlation = np.linalg.solve(root, np.linalg.solve(root, R).T)
            factors[i] = max(1.0, np.linalg.eigvalsh((whitened_correlation + whitened_correlation.T) / 2)[-1])
    return factors[pattern_index.ravel()]
