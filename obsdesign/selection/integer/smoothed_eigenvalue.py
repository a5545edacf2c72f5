"""The smallest eigenvalue with its corner rounded off, so that searches have central prices to go by."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from obsdesign.criteria.abstract import AbstractCriterion

if TYPE_CHECKING:
    import cvxpy as cp

_NEWTON_STEPS = 60  # steps at most: they rise to the root from below and double its right digits near it


@dataclass(frozen=True)
class SmoothedEigenvalue(AbstractCriterion):
    """max over t of t + tau log det(W - t I); lambda_min(W) as tau falls to 0. Slope Z = tau (W - t I)^-1, of trace 1.

    Its prices lie well inside of Z >= 0, as those of an analytic centre; the prices at a corner of the mixtures jump about, and
    with n = 15 they take ten times as many rounds.
    """

    tau: float

    @property
    def label(self) -> str:
        """smoothed λmin."""
        return "smoothed λmin"

    @property
    def symbol(self) -> str:
        """The label."""
        return self.label

    @property
    def knowledge(self) -> None:
        """None: W is the samples' information about x(t_0)."""
        return None

    def value(self, W: np.ndarray) -> float:
        """Return max over t of t + tau log det(W - t I)."""
        return float(self.values(np.linalg.eigvalsh(W)[None], self.tau)[0])

    def value_from_root(self, R: np.ndarray) -> np.ndarray:
        """Raise NotImplementedError: a step of a search, never a criterion of its own."""
        raise NotImplementedError("a step of a search, never a criterion of its own")

    def slope(self, W: np.ndarray) -> np.ndarray:
        """Return Z = tau (W - t I)^-1, of trace 1."""
        shifted, bases = self.spectrum(W[None], self.tau)
        return (bases[0] * (self.tau / shifted[0])) @ bases[0].T

    @property
    def resolution(self) -> float:
        """0: it is compared as the smallest eigenvalue is."""
        return 0.0

    @property
    def scales_with_information(self) -> bool:
        """True: with tau in its unit."""
        return True

    @property
    def is_smallest_eigenvalue(self) -> bool:
        """False: it has derivatives."""
        return False

    def curvature(self, W: np.ndarray, D: np.ndarray) -> np.ndarray:
        """Return tau (<T_i, T_j> - h_i h_j / sum s^-2), T_i = M^-1/2 D_i M^-1/2, M = W - t I of eigenvalues s, h_i = sum diag(T_i) / s."""
        shifted, bases = self.spectrum(W[None], self.tau)
        inverse_root = 1 / np.sqrt(shifted[0])
        transformed = (bases[0].T @ D @ bases[0]) * np.outer(inverse_root, inverse_root)
        flat = transformed.reshape(len(D), -1)
        shift_response = np.einsum("iaa,a->i", transformed, 1 / shifted[0])
        return self.tau * (flat @ flat.T - np.outer(shift_response, shift_response) / np.sum(shifted**-2.0))

    def atom(self, W: cp.Expression) -> cp.Expression:
        """Raise NotImplementedError: a step of a search, never a criterion of its own."""
        raise NotImplementedError("a step of a search, never a criterion of its own")

    @staticmethod
    def spectrum(W: np.ndarray, tau: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the eigenvalues (R, n) of W_r - t I, with one t for all, and the eigenvectors (R, n, n)."""
        values, bases = np.linalg.eigh(W)
        return (values - values.min()) + float(_shift(values.reshape(1, -1), tau)[0]), bases

    @staticmethod
    def values(eigenvalues: np.ndarray, tau: float) -> np.ndarray:
        """Return t + tau sum log(eigenvalue - t) for rows of eigenvalues."""
        shift = _shift(eigenvalues, tau)
        lowest = eigenvalues.min(axis=1)
        shifted = eigenvalues - lowest[:, None] + shift[:, None]
        return lowest - shift + tau * np.log(shifted).sum(axis=1)


def _shift(eigenvalues: np.ndarray, tau: float) -> np.ndarray:
    """lowest eigenvalue - t > 0 for each row, where tau sum 1 / (eigenvalue - t) = 1."""
    distances = eigenvalues - eigenvalues.min(axis=1, keepdims=True)
    shift = np.full(len(distances), tau)  # too small or just right: Newton's method rises from here
    for _ in range(_NEWTON_STEPS):
        shifted = distances + shift[:, None]
        step = (tau * np.sum(1 / shifted, axis=1) - 1) / (tau * np.sum(shifted**-2.0, axis=1))
        shift = shift + step
        if (np.abs(step) <= 1e-14 * shift).all():
            break
    return shift
