"""What is known of the state before the first measurement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.arguments import validate_arguments
from obsdesign.checks import as_array
from obsdesign.display import AbstractDisplay, Summary, number
from obsdesign.errors import InputError


@validate_arguments
@dataclass(frozen=True, eq=False, init=False)
class Prior(AbstractDisplay):
    """What is known of the state before the first sample: x(t_0) ~ N(mean, covariance).

    Arguments:
        mean (n,): expected state, each in the unit of the state.
        std (n,): standard deviation of each state, > 0, in the unit of the state; give this or the covariance.
        covariance (n, n): symmetric positive definite, in the units of the states.
    Raises InputError for other values, and unless one of std and covariance is given.
    """

    mean: np.ndarray
    """Expected state (n,), in the units of the states."""
    covariance: np.ndarray
    """Covariance (n, n) of its errors, in the units of the states."""

    def __init__(self, mean: ArrayLike, std: ArrayLike | None = None, covariance: ArrayLike | None = None) -> None:
        centre = as_array("prior: mean", mean)
        if (std is None) == (covariance is None):
            raise InputError("prior: give either std or covariance")
        spread = as_array("prior: covariance", covariance) if std is None else as_array("prior: std", std)
        if centre.ndim != 1 or not centre.size:
            raise InputError(f"prior: mean has shape {centre.shape}: mean and covariance must be finite, (n,) and (n, n)")
        if std is not None:
            if spread.shape != centre.shape or not (np.isfinite(spread).all() and (spread > 0).all()):
                raise InputError(f"prior: std is {spread.tolist()}: must be {centre.size} finite numbers above 0")
            spread = np.diag(spread**2)
        _require_covariance(spread, centre)
        for name, value in (("mean", centre), ("covariance", spread)):
            value.setflags(write=False)
            object.__setattr__(self, name, value)

    def _summary(self) -> Summary:
        rows = [(f"state {i}", f"{number(mean)} +- {number(std)}") for i, (mean, std) in enumerate(zip(self.mean, self.std, strict=True))]
        return Summary(f"prior of {len(rows)} states", tuple(rows))

    def __eq__(self, value: object) -> bool:
        return isinstance(value, Prior) and self._key == value._key

    def __hash__(self) -> int:
        return hash(self._key)

    @property
    def _key(self) -> tuple[bytes, bytes]:
        return self.mean.tobytes(), self.covariance.tobytes()

    @property
    def std(self) -> np.ndarray:
        """Standard deviation (n,) of each state."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def information(self) -> np.ndarray:
        """P_0^-1 (n, n)."""
        return np.linalg.inv(self.covariance)


def _require_covariance(covariance: np.ndarray, mean: np.ndarray) -> None:
    n = mean.size
    if mean.ndim != 1 or covariance.shape != (n, n):
        raise InputError(f"prior: mean {mean.shape} and covariance {covariance.shape} must be finite, (n,) and (n, n)")
    for what, values in (("mean", mean), ("covariance", covariance)):
        for index in np.argwhere(~np.isfinite(values)):
            raise InputError(f"prior: {what}[{', '.join(map(str, index))}] is {values[tuple(index)]}: must be finite")
    for i in np.flatnonzero(np.diag(covariance) <= 0):
        raise InputError(f"prior: covariance[{i}, {i}] is {covariance[i, i]:g}: must be above 0, the variance of a state")
    scale = np.sqrt(np.diag(covariance))
    lowest = np.linalg.eigvalsh(covariance / np.outer(scale, scale))[0]
    skew = np.abs(covariance - covariance.T) - 1e-12 * np.outer(scale, scale)
    if skew.max(initial=0.0) > 0:
        i, j = (int(index) for index in np.unravel_index(int(skew.argmax()), skew.shape))
        pair = f"[{i}, {j}] is {covariance[i, j]:.17g} and [{j}, {i}] is {covariance[j, i]:.17g}"
        raise InputError(f"prior: covariance{pair}: must be symmetric to 1e-12 of the standard deviations of both states")
    if lowest <= 1e-13:
        raise InputError(
            f"prior: the covariance, each state in its own standard deviation, has the eigenvalue {lowest:.3g}: must be positive definite"
        )
