"""Which states a path teaches, and which it does not: posterior against prior, and what it would help to measure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from obsdesign.arguments import validate_arguments
from obsdesign.display import AbstractDisplay, Summary
from obsdesign.dynamics.model import AbstractSystem
from obsdesign.information.posterior import posterior_information
from obsdesign.noise_density import DisturbancePsd
from obsdesign.prior import Prior
from obsdesign.round_off import standard_deviations
from obsdesign.trajectory import Trajectory

_LISTED = 12  # states that are shown


@dataclass(frozen=True, eq=False)
class Estimability(AbstractDisplay):
    """How much better every state is known at the end of a path than before, by the Cramer-Rao bound."""

    names: tuple[str, ...]
    """Names of the n states."""
    prior_std: np.ndarray
    """Standard deviations (n,) before the first sample, in the units of the states."""
    std: np.ndarray
    """Posterior standard deviations (N+1, n) along the path, in the units of the states; inf: hidden."""
    gain: np.ndarray
    """Share (n,) of the other states' variances, each over its prior's, that a perfect measurement of this state at the end takes away.

    sum_(j != i) P_ij^2 / (P_ii s_j^2) over sum_(j != i) P_jj / s_j^2, s the prior's standard deviations; NaN where something is hidden.
    """

    @property
    def ratio(self) -> np.ndarray:
        """Posterior over prior standard deviation (n,) at the end: 1 where nothing was learned."""
        return self.std[-1] / self.prior_std

    @property
    def ranking(self) -> tuple[str, ...]:
        """Names of the states, the one that is learned best first."""
        return tuple(self.names[i] for i in np.argsort(self.ratio, kind="stable"))

    @property
    def to_drop(self) -> str:
        """The state that is learned least: nothing is lost where it is held at its prior mean."""
        return self.ranking[-1]

    @property
    def to_measure(self) -> str:
        """The state whose measurement helps the others most; the one that is learned least where something is hidden."""
        return self.to_drop if np.isnan(self.gain).any() else self.names[int(self.gain.argmax())]

    def _summary(self) -> Summary:
        order = np.argsort(self.ratio, kind="stable")
        rows = [(self.names[i], _row(float(self.std[-1, i]), float(self.prior_std[i]), float(self.gain[i]))) for i in order[:_LISTED]]
        rows.append(("drop first", self.to_drop))
        rows.append(("measure first", self.to_measure))
        return Summary(f"{len(self.names)} states, the one that is learned best first", tuple(rows))


def _row(std: float, prior_std: float, gain: float) -> str:
    if np.isinf(std):
        return f"hidden; {prior_std:.3g} before"
    helps = "" if np.isnan(gain) else f"; measured, it takes {100 * gain:.0f} % off the others' variance"
    return f"{std:.3g}, {std / prior_std:.2f} of the {prior_std:.3g} before{helps}"


@validate_arguments
def estimability(
    system: AbstractSystem,
    path: Trajectory,
    prior: Prior,
    disturbance_psd: DisturbancePsd = None,
    unknown_inputs: Sequence[str] = (),
    active: np.ndarray | None = None,
) -> Estimability:
    """Return how much better every state is known at the end of a path than before: which to drop, and which to measure first.

    P_N = J_N^-1, the posterior Cramer-Rao bound of x(t_N), against the prior's covariance.

    Arguments:
        system: vehicle and sensors.
        path: the path that is looked at.
        prior: what is known of x(t_0); its standard deviations are what counts as nothing learned.
        disturbance_psd: power spectral density (n,) or (n, n) of the process noise [unit^2/s], or a PerSpeed of it; None = none.
        unknown_inputs: names of inputs that nobody knows, as in `posterior_information`.
        active (N, S): bool, which sensors are on; None = all.
    Raises InputError as `posterior_information` does.
    """
    J = posterior_information(system, path, prior, disturbance_psd, unknown_inputs, active)
    prior_std = np.sqrt(np.diag(prior.covariance))
    std = standard_deviations(J)
    return Estimability(system.model.state_names, prior_std, std, _gain(J[-1], std[-1], prior_std))


def _gain(J: np.ndarray, std: np.ndarray, prior_std: np.ndarray) -> np.ndarray:
    """Return what a perfect measurement of each state takes off the others (n,)."""
    if not np.isfinite(std).all():
        return np.full(len(std), np.nan)
    P = np.linalg.inv(J * prior_std[:, None] * prior_std)
    variances = np.diag(P)
    taken = P**2 / variances[:, None]
    total = variances.sum() - variances
    return (taken.sum(axis=1) - variances) / np.where(total > 0, total, 1.0)
