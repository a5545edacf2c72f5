"""What is asked of a log: the system that it is of, what is known beforehand, and the states that count."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.dynamics.model import AbstractSystem
from obsdesign.estimation.abstract import AbstractEstimator
from obsdesign.logs.log import Log
from obsdesign.noise_density import DisturbancePsd, InputPsd
from obsdesign.prior import Prior
from obsdesign.signals import Signal


@dataclass(frozen=True, eq=False)
class ReplayQuestion:
    """A log of a system, the prior at its beginning, the noise that moves it, the filter that runs on it, and the states that count."""

    system: AbstractSystem
    """Vehicle and sensors."""
    log: Log
    """The recorded run, of the samples that count."""
    prior: Prior
    """What is known of the state before the first sample, and again at the beginning of each window that is restarted."""
    disturbance_psd: DisturbancePsd
    """Power spectral density of the process noise [unit^2/s]."""
    input_psd: InputPsd
    """Power spectral density of the noise of known inputs [unit^2 s]."""
    estimator: AbstractEstimator
    """What runs on the log."""
    about: tuple[str, ...]
    """Names of the states that count."""

    @property
    def places(self) -> list[int]:
        """Where the states that count stand among all."""
        return [self.system.model.state_names.index(name) for name in self.about]

    @property
    def signal(self) -> Signal:
        """The first of the states that count: errors and predictions are in its unit."""
        return self.system.model.states[self.places[0]]

    @property
    def angles(self) -> tuple[str, ...]:
        """Names of the states that wrap."""
        return tuple(signal.name for signal in self.system.model.states if signal.is_angle)

    def size_of(self, covariances: np.ndarray) -> np.ndarray:
        """Return the root (...) of the summed variances of the states that count, of covariances (..., n, n)."""
        return np.sqrt(np.diagonal(covariances, axis1=-2, axis2=-1)[..., self.places].sum(axis=-1))

    def rms_of(self, covariances: np.ndarray) -> float:
        """Return the root mean square of these sizes over the instants of covariances (N, n, n)."""
        return float(np.sqrt(np.mean(self.size_of(covariances) ** 2)))
