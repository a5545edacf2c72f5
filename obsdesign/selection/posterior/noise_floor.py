"""The floor of an overconfident sensor: by how much its error is the same for as long as a segment lasts."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.arguments import validate_arguments
from obsdesign.checks import as_array, require_positive
from obsdesign.errors import InputError

_MESH = 0.02  # steps of log(v_j + b^2), in units of which every term of the likelihood is smooth
_LEAST_VARIANCE = 1e-300  # of a mean, in units of the largest mean: its logarithm is finite


@validate_arguments
def fit_floor(residuals: Sequence[ArrayLike], sigma: float) -> float:
    """Return b >= 0: each residual is an error of its own, of standard deviation sigma, and one of b that its segment shares.

    A segment's mean m_j of n_j residuals is then N(0, v_j + b^2), v_j = sigma^2 / n_j, and b^2 = tau the most likely:

        maximise over tau >= 0   -1/2 sum_j [log(v_j + tau) + m_j^2 / (v_j + tau)]

    With equal n_j that is mean(m_j^2) - v, or 0: the moment estimator. With unequal ones it weighs each segment by what its mean can tell,
    where the mean of m_j^2 - v_j weighs a segment of one residual like one of a hundred. By simulation (12 segments of 1, 2, 5, 20 or 100
    residuals, sigma = 1), root mean square error of the most likely b / by that mean / by the mean weighted by n_j: 0.075 / 0.27 / 0.087
    at b = 0, 0.14 / 0.27 / 0.14 at 0.3, 0.26 / 0.30 / 0.34 at 1, 0.63 / 0.63 / 1.03 at 3. Few segments say little: three of equal length
    leave an error of 0.4 b at b = 3 sigma. Where there is no floor it is 0 for about half of all sets of residuals, else small.

    Arguments:
        residuals: of one sensor, one array (n_j,) for each segment, in the sensor's unit; segments without residuals may be empty.
        sigma: the standard deviation that the sensor states, in the same unit, above 0.
    Raises InputError for a sigma that is none, entries that are not finite, arrays that are not (n_j,), and where there is no residual.
    Source: Searle, Casella, McCulloch (1992), Variance Components, section 3.7, with a known variance within classes and the mean 0.
    """
    require_positive("fit_floor: sigma", sigma)
    segments = [_as_segment(j, segment) for j, segment in enumerate(residuals)]
    segments = [segment for segment in segments if segment.size]
    if not segments:
        raise InputError(f"fit_floor: residuals has {len(residuals)} segments and no residual: one at least is needed")
    size = max(float(sigma), *(float(np.abs(segment).max()) for segment in segments))  # what is squared is at most 1
    counts = np.array([segment.size for segment in segments])
    squares = np.array([float(np.mean(segment / size)) for segment in segments]) ** 2
    variances = np.maximum((sigma / size) ** 2 / counts, _LEAST_VARIANCE)
    return size * float(np.sqrt(_most_likely_variance(squares, variances)))


def _as_segment(j: int, segment: ArrayLike) -> np.ndarray:
    """Residuals (n_j,) of a segment; raise InputError for what is none."""
    values = as_array(f"fit_floor: residuals[{j}]", segment)
    if values.ndim != 1:
        raise InputError(f"fit_floor: residuals[{j}] has shape {values.shape}: must be an array (n,), the residuals of one segment")
    wrong = np.flatnonzero(~np.isfinite(values))
    if wrong.size:
        raise InputError(f"fit_floor: residuals[{j}][{wrong[0]}] is {values[wrong[0]]:g}: must be finite")
    return values


def _most_likely_variance(squares: np.ndarray, variances: np.ndarray) -> float:
    """Return tau >= 0 that is most likely where m_j is N(0, v_j + tau), given m_j^2 and v_j (K,).

    Segments of one length count together. The best point of a mesh that is fine for every term (log(v_j + tau) moves by `_MESH` at most,
    as none moves faster than that of the least v_j), then the root of the slope beside it. No tau beyond every m_j^2 - v_j is better.
    """
    v, group = np.unique(variances, return_inverse=True)
    counts, sums = np.bincount(group).astype(float), np.bincount(group, weights=squares)
    highest = float((squares - variances).max())
    if highest <= 0:
        return 0.0
    if len(v) == 1:
        return max(0.0, float(np.mean(squares)) - float(v[0]))
    mesh = v[0] * np.expm1(np.linspace(0.0, np.log1p(highest / v[0]), 2 + int(np.log1p(highest / v[0]) / _MESH)))
    likelihood = sum(-count * np.log(v_g + mesh) - total / (v_g + mesh) for count, total, v_g in zip(counts, sums, v, strict=True))
    best = int(np.argmax(likelihood))

    def slope(tau: float) -> float:
        """Return the slope of the likelihood, times 2 (v_0 + tau)^2: of numbers that do not overflow."""
        share = (v[0] + tau) / (v + tau)
        return float(np.sum((sums * share - counts * (v[0] + tau)) * share))

    return _root(slope, float(mesh[max(best - 1, 0)]), float(mesh[min(best + 1, len(mesh) - 1)]))


def _root(slope: Callable[[float], float], low: float, high: float) -> float:
    """Return where a slope falls through 0 from low to high; the end that is higher where it does not."""
    from scipy.optimize import brentq

    if slope(low) <= 0:
        return low
    if slope(high) >= 0:
        return high
    return float(brentq(slope, low, high, xtol=1e-300, rtol=4 * np.finfo(float).eps))  # pyright: ignore[reportArgumentType]
