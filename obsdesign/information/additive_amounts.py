"""How much of what a stretch of samples says may be counted when it is added to that of others, whose errors it shares."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.information.correlated_noise import Colour


@dataclass(frozen=True, eq=False)
class Counting:
    """factor (N, q) <= 1: what each sample's information is multiplied by; spread (q,) >= 1: what the variance of
    its constant is."""

    factor: np.ndarray
    spread: np.ndarray

    def rows(self, firsts: np.ndarray) -> list[np.ndarray]:
        """Return fresh (N, 1), factor and spread (N, q) for the recursion over stretches that begin at steps `firsts`."""
        fresh = np.zeros((len(self.factor), 1))
        fresh[firsts] = 1.0
        return [fresh, self.factor, np.tile(self.spread, (len(self.factor), 1))]


def counting(colour: Colour, due: np.ndarray, firsts: np.ndarray) -> Counting:
    """Return what makes amounts of K stretches, which begin at steps `firsts`, a bound from below for every choice of them.

    With R_k the covariance of a stretch's errors alone, R <= diag(c R_k) makes sum A_k' (c R_k)^-1 A_k <= A' R^-1 A, for any part of
    the stretches as well (a part of R is a part of the right side).

    - correlation phi: c = (1 + phi) / (1 - phi^L), L the number of samples of the shortest stretch (the first and the last are
      parts of longer ones). Whitened, the last error of a stretch and the first of the d-th one after it have the correlation
      phi^(1 + (d - 1) L), those two of one stretch phi^(L - 1), and all others none, so that what stretches have in common has
      the norm (phi + phi^L) / (1 - phi^L), that of its row sums. L = 1: the well-known (1 + phi) / (1 - phi). Two stretches: 1 + phi.
    - constant: 1 1' <= diag(K 1_k 1_k'), as (sum of K numbers)^2 <= K times the sum of their squares.
    - joint noise: c is the largest eigenvalue of R with the parts of its sensors made units, of the sensors with a sample at that
      instant.
    """
    owner = np.array(colour.owner)
    ends = np.append(firsts[1:], len(due))
    factor, spread = np.ones(due.shape), np.ones(colour.q)
    for s in range(len(colour.sensors)):
        outputs = np.flatnonzero(owner == s)
        clock = np.concatenate([[0], np.cumsum(due[:, outputs[0]])])
        counts = clock[ends] - clock[firsts]
        counts = counts[counts > 0]
        spread[outputs] = max(1, len(counts))
        for j in outputs:
            factor[:, j] = 1 / _in_time(colour.correlation[j], counts)
    for members, correlation in colour.groups:
        factor[:, members] /= _at_once(np.array(correlation), owner[list(members)], due[:, members])[:, None]
    return Counting(factor, spread)


def _in_time(phi: float, counts: np.ndarray) -> float:
    """c for stretches of so many samples."""
    if not phi or len(counts) < 2:
        return 1.0
    if len(counts) == 2:
        return 1 + phi
    return (1 + phi) / (1 - phi ** int(counts[1:-1].min()))


def _at_once(correlation: np.ndarray, owner: np.ndarray, due: np.ndarray) -> np.ndarray:
    """c (N,) of a group at each instant, by who of it has a sample then."""
    patterns, which = np.unique(due, axis=0, return_inverse=True)
    found = np.ones(len(patterns))
    for i, pattern in enumerate(patterns):
        kept = np.flatnonzero(pattern)
        if len(kept):
            R, mine = correlation[np.ix_(kept, kept)], owner[kept]
            own = np.linalg.cholesky(np.where(mine[:, None] == mine, R, 0.0))
            unit = np.linalg.solve(own, np.linalg.solve(own, R).T)
            found[i] = max(1.0, np.linalg.eigvalsh((unit + unit.T) / 2)[-1])
    return found[which.ravel()]
