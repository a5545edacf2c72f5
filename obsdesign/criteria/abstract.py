"""What a criterion is: one number with three faces, for analysis, design and selection."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

if TYPE_CHECKING:
    import cvxpy as cp

    from obsdesign.noise_density import PerSpeed
    from obsdesign.prior import Prior

Over: TypeAlias = Literal["end", "mean", "worst"] | Sequence[float] | np.ndarray
"""Of which instants something is asked: the last, the mean of all, the largest, or their sum with weights (N,) >= 0."""


@dataclass(frozen=True)
class Knowledge:
    """What is known beside the samples: the prior of x(t_0), psd's of states and inputs as tuples, unknown inputs.

    over: at which instants it is asked what the samples have added, as in `Posterior`; it is no part of what is known.
    """

    prior: Prior
    disturbance_psd: tuple[float, ...] | tuple[tuple[float, ...], ...] | PerSpeed | None
    unknown_inputs: tuple[str, ...]
    input_psd: tuple[tuple[str, float | PerSpeed], ...] = ()
    over: Over = field(default="end", compare=False)


class AbstractCriterion(ABC):
    """A number that says how good an information matrix W (n, n) is; larger is better. Leaves are final, one file each."""

    @property
    @abstractmethod
    def label(self) -> str:
        """What sentences and tables call the number: λmin, log det."""

    @property
    @abstractmethod
    def symbol(self) -> str:
        """What drawings call it: the label, or Matplotlib's TeX of it."""

    @property
    @abstractmethod
    def knowledge(self) -> Knowledge | None:
        """What a design takes for W: None = the samples' information about x(t_0), else the posterior's about x(t_k)."""

    @abstractmethod
    def value(self, W: np.ndarray) -> float:
        """Return the number for W >= 0 symmetric; -inf where it does not exist."""

    @abstractmethod
    def value_from_root(self, R: np.ndarray) -> np.ndarray:
        """Return the number (...) for each W = (R'R)^-1, R (..., n, n): from a root of the covariance, whatever the states' units."""

    @abstractmethod
    def covariance_cost(self, P: np.ndarray) -> np.ndarray:
        """Return what covariances P (..., n, n) cost (...): smaller is better, and less where P is smaller in Loewner's order."""

    @abstractmethod
    def covariance_cost_of_root(self, B: np.ndarray) -> np.ndarray:
        """Return what P = B B' costs (...), B (..., n, m), m >= n: with all digits of B, whatever the states' units."""

    @property
    @abstractmethod
    def is_trace_of_covariance(self) -> bool:
        """Whether that cost is tr P: sums of it are linear in each covariance."""

    @abstractmethod
    def slope(self, W: np.ndarray) -> np.ndarray:
        """Return Z (n, n), symmetric, with value(W + dW) <= value(W) + <Z, dW>: the gradient where there is one."""

    @property
    @abstractmethod
    def resolution(self) -> float:
        """Two values nearer than this are one: 0 for a number that scales with W, whose differences are judged relatively."""

    @property
    @abstractmethod
    def scales_with_information(self) -> bool:
        """Whether ratios of values mean anything: value(c W) is c value(W) or value(W) / c."""

    @property
    def gap_kind(self) -> Literal["relative", "absolute"]:
        """How a value and its bound are compared: relative, (bound - value) / |bound|, or absolute, bound - value."""
        return "relative" if self.resolution == 0 else "absolute"

    @property
    @abstractmethod
    def is_smallest_eigenvalue(self) -> bool:
        """Whether a design follows it by W - t I >= 0, maximise t: it has no slope where eigenvalues meet, and optima lie there."""

    @abstractmethod
    def curvature(self, W: np.ndarray, D: np.ndarray) -> np.ndarray:
        """Return -d2 value[D_i, D_j] (q, q) >= 0 at W > 0 for directions D (q, n, n); 0 for a smallest eigenvalue."""

    @abstractmethod
    def atom(self, W: cp.Expression) -> cp.Expression:
        """Return the number as a concave CVXPY expression of a symmetric W."""
