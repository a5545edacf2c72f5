"""The noise of simulated samples: joint, correlated from sample to sample, and constant, made of independent standard normal numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.dynamics.model import Model
from obsdesign.dynamics.simulation import Readings

_GATE_THRESHOLD = 0.5  # a simulated sample may arrive where the sensor's gate is wider than this at the true state


@dataclass(frozen=True, eq=False)
class MeasurementNoise:
    """Errors of the outputs: varying (..., N, q), in standard deviations of a sample, and constant (..., q), in the outputs' units."""

    varying: np.ndarray
    constant: np.ndarray

    def at(self, k: int) -> MeasurementNoise:
        """Return that of the k-th instant alone."""
        return MeasurementNoise(self.varying[..., k : k + 1, :], self.constant)

    def added_to(self, readings: Readings) -> np.ndarray:
        """Return samples y + spread e + b (M, N, q)."""
        return readings.y + readings.spread * self.varying + self.constant[..., None, :]


def measurement_noise(
    model: Model,
    white: np.ndarray,
    white_constant: np.ndarray,
    is_sampled: np.ndarray,
    white_before: np.ndarray | None = None,
    times: np.ndarray | None = None,
) -> MeasurementNoise:
    """Return the noise of a path of N instants that independent standard normal numbers make.

    Arguments:
        white (N, q): one for each output and instant.
        white_constant (q,): one for each constant error.
        is_sampled (N, q): which outputs are sampled when; the errors of one are correlated from each of its samples to the next.
        white_before (q,): one for the error before the first sample; None: white[0] is that of the first sample itself.
        times (N,): of the instants [s], where they are not equally far apart: then errors go on in time, correlation^(dt / period).
    """
    channels = [model.channels[sensor].noise for sensor in model.output_owner]
    varying = white if white_before is None else np.vstack([white_before, white])
    varying = varying @ model.correlation_root.T if model.joint else varying.copy()
    before, varying = (None, varying) if white_before is None else (varying[0], varying[1:])
    for column, noise in enumerate(channels):
        if noise.correlation:
            samples = is_sampled[:, column]
            if times is not None and noise.period is not None:
                varying[:, column] = _correlate_in_time(varying[:, column], noise.correlation ** (np.diff(times) / noise.period))
                continue
            previous = None if before is None else float(before[column])
            varying[samples, column] = _correlate(varying[samples, column], noise.correlation, previous)
    return MeasurementNoise(varying, np.array(model.output_bias) * white_constant)


def _correlate(white: np.ndarray, correlation: float, previous: float | None) -> np.ndarray:
    """e_j = c e_(j-1) + (1 - c^2)^1/2 white_j, e_(-1) the previous one, or e_0 = white_0 where there is none: variance 1 throughout."""
    from scipy.signal import lfilter  # a second to load, and few sensors need it

    gain = np.sqrt(1 - correlation**2)
    innovations = np.concatenate([white[:1] / gain, white[1:]]) if previous is None else white
    errors, _ = lfilter([gain], [1.0, -correlation], innovations, zi=[correlation * (previous or 0.0)])
    return np.asarray(errors)


def _correlate_in_time(white: np.ndarray, correlations: np.ndarray) -> np.ndarray:
    """e_0 = white_0, e_k = c_k e_(k-1) + (1 - c_k^2)^1/2 white_k: variance 1 throughout, whichever instants have samples."""
    errors, gains = white.copy(), np.sqrt(1 - correlations**2)
    for k, correlation in enumerate(correlations.tolist(), 1):
        errors[k] = correlation * errors[k - 1] + gains[k - 1] * white[k]
    return errors


def detections(model: Model, random: np.random.Generator, steps: int) -> np.ndarray:
    """Draw which outputs (N, q) are detected, those of a sensor together; nothing is drawn where all sensors detect always."""
    shares = np.array([channel.noise.detection for channel in model.channels])
    is_detected = random.random((steps, len(shares))) < shares if (shares < 1).any() else np.ones((steps, len(shares)), dtype=bool)
    return is_detected[:, list(model.output_owner)]


def is_in_sight(model: Model, gate: np.ndarray) -> np.ndarray:
    """Return where a gate (..., q), the share of samples that arrive, has nothing in the way but chance."""
    return gate > _GATE_THRESHOLD * np.array([model.channels[sensor].noise.detection for sensor in model.output_owner])
