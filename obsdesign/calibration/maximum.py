"""The most likely parameters, what the data tell of them, and intervals."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from obsdesign.calibration.likelihood import LikelihoodPoint, LogLikelihood
from obsdesign.calibration.parameters import Parameter
from obsdesign.estimation.gate import Gate

NORMAL_QUANTILE = 1.959963984540054
_LIKELIHOOD_DROP = 1.920729410347062  # chi-square quantile for 95 %, 1 degree of freedom, over 2
_ENOUGH, _ROUGHLY = 1e-4, 0.3  # by which f may still be expected to fall; of a maximum that is only a start
_MOST_STEPS = 40
UNTOLD = 0.5  # of the spread before the data: a standard deviation above it tells of nothing
_RAGGED = 0.7  # standard deviation of a logarithm beyond which its likelihood is looked at, not its curvature
_GATE = Gate(0.99993665751633)  # 4 standard deviations of an innovation
_MOST_ROUNDS = 5  # of leaving out outliers
_LARGEST_TOLD = 1.0  # z at the upper end of an interval: a psd that may be that much larger than what was looked for is not told
_STEP, _MOST_UPDATES = 1e-2, 2e6  # of z, and outputs that the runs for degrees of freedom take in: in longer logs these are many
_LEAST_FREEDOM = 2.0
_FARTHEST, _POINTS = 2.5, 20  # of z, when the end of an interval is looked for


@dataclass(frozen=True, eq=False)
class Maximum:
    """Where -log p of z (P,) is least, Fisher's information there, and whether the search ended."""

    z: np.ndarray
    information: np.ndarray
    has_converged: bool

    @property
    def std(self) -> np.ndarray:
        """Standard deviations (P,) of z."""
        return np.sqrt(np.diag(np.linalg.inv(self.information)))


@dataclass(frozen=True)
class Told:
    """What the data tell of a parameter: its value, its 95 % interval, and whether they tell anything."""

    parameter: Parameter
    value: float
    low: float
    high: float
    is_told: bool

    @property
    def without_effect(self) -> Told:
        """The parameter as it is without the data, in an interval that holds that."""
        return self._with(self.parameter.start, self.is_told)

    def at(self, other: Told) -> Told:
        """Return another value of the parameter, where others are known to be nothing, in an interval that holds it."""
        return self._with(other.value, other.is_told)

    def _with(self, value: float, is_told: bool) -> Told:
        return Told(self.parameter, value, min(self.low, value), max(self.high, value), is_told)


def most_likely(likelihood: LogLikelihood, may_have_outliers: bool = True) -> tuple[LogLikelihood, Maximum]:
    """Return the maximum, and the likelihood without the samples that a filter rejects there.

    Outliers, where there may be many, are told at first by a maximum to which they do not matter: that of errors with long tails. With
    them one would be looked for that calls them errors like any. Without them it is the better of two, from there and from what is stated.
    Where there are none it is noise itself that may have tails, of which once more than 4 standard deviations are left out.
    """
    stated = np.zeros(len(likelihood.free))
    trimmed, start = _without_tails(likelihood, stated) if may_have_outliers else (likelihood, stated)
    peak = maximum(trimmed, start)
    for _ in range(_MOST_ROUNDS if may_have_outliers else 1):
        before, trimmed = trimmed, likelihood.without_outliers(peak.z, _GATE)
        if np.array_equal(before.recording.weights, trimmed.recording.weights):
            break
        peak = maximum(trimmed, peak.z)
    restricted = trimmed.without_chance(peak.z)
    return restricted, maximum(restricted, peak.z)


def _without_tails(likelihood: LogLikelihood, stated: np.ndarray) -> tuple[LogLikelihood, np.ndarray]:
    """Return the likelihood without what is an outlier where errors have long tails, and near which z its maximum is."""
    tails = maximum(replace(likelihood, has_tails=True), stated, _ROUGHLY)
    trimmed = likelihood.without_outliers(tails.z, _GATE)
    nearby = np.array([maximum(trimmed, start, _ROUGHLY).z for start in (tails.z, stated)])
    return trimmed, nearby[np.argmin(trimmed.values_at(nearby))]


def maximum(likelihood: LogLikelihood, start: np.ndarray, enough: float = _ENOUGH) -> Maximum:
    """Return the maximum from a start (P,), by a trust region with Fisher's information in the place of the second derivative.

    It ends where no more than `enough` is expected of a step.
    """
    from scipy.optimize import minimize

    if not len(start):
        return Maximum(start, np.zeros((0, 0)), has_converged=True)
    seen: dict[bytes, LikelihoodPoint] = {}

    def at(z: np.ndarray) -> LikelihoodPoint:
        """Return what there is at z, computed once."""
        key = z.tobytes()
        if key not in seen:
            seen[key] = likelihood.at(z)
        return seen[key]

    def stop(intermediate_result: object) -> None:
        """End where no step would gain anything."""
        if at(np.asarray(intermediate_result.x)).decrement < enough:  # pyright: ignore[reportAttributeAccessIssue]
            raise StopIteration

    result = minimize(
        lambda z: at(z).value,
        start,
        jac=lambda z: at(z).slope,
        hess=lambda z: at(z).information,
        method="trust-exact",
        callback=stop,
        options={"initial_trust_radius": 0.3, "max_trust_radius": 1.0, "maxiter": _MOST_STEPS, "gtol": 1e-9},
    )
    best = at(result.x)
    return Maximum(result.x, best.information, best.decrement < 10 * enough)


def reach_of(likelihood: LogLikelihood, peak: Maximum) -> np.ndarray:
    """Return how many standard deviations the 95 % interval of each parameter reaches to either side (P,).

    The variance V of a bias or a scale is computed with sizes that are estimated: the quantile is Student's with 2 / (g'A g) degrees of
    freedom, g = d log V / dz over the sizes, A their covariance. Of sizes it is the normal one.
    Source: Satterthwaite 1946, Biometrics Bulletin 2, 110-114.
    """
    from scipy.special import stdtrit

    is_size = np.array([parameter.quantity.is_positive for parameter in likelihood.free], dtype=bool)
    sizes, count, normal = np.flatnonzero(is_size), len(is_size), np.full(len(is_size), NORMAL_QUANTILE)
    if is_size.all() or not is_size.any() or len(sizes) * (count + 1) * likelihood.recording.weights.size > _MOST_UPDATES:
        return normal
    beside = [Maximum(z, likelihood.at(z).information, peak.has_converged) for z in peak.z + _STEP * np.eye(count)[sizes]]
    slopes = np.array([2 * np.log(moved.std / peak.std) for moved in beside]) / _STEP
    covariance = np.linalg.inv(peak.information)[np.ix_(sizes, sizes)]
    freedom = 2 / np.maximum(np.einsum("sp,st,tp->p", slopes, covariance, slopes), 1e-12)
    return np.where(is_size, normal, stdtrit(np.maximum(freedom, _LEAST_FREEDOM), 0.975))


def without_what_is_not_there(free: tuple[Parameter, ...], peak: Maximum, reach: np.ndarray | None = None) -> np.ndarray:
    """Return which parameters stay (P,): not biases and scales whose intervals hold what they are without the data.

    reach (P,): of the intervals, in standard deviations; None = the normal quantile.
    One after the other, the least sure first, the others being what they are without those before.
    """
    stays, reach = np.ones(len(free), dtype=bool), np.full(len(free), NORMAL_QUANTILE) if reach is None else reach
    z, information = peak.z, peak.information
    while True:
        kept = np.flatnonzero(stays)
        covariance = np.linalg.inv(information[np.ix_(kept, kept)])
        # of the others being 0: x_k + H_kk^-1 H_kd x_d
        values = z[kept] + covariance @ information[np.ix_(kept, np.flatnonzero(~stays))] @ z[~stays]
        ratios = np.abs(values) / (reach[kept] * np.sqrt(np.diag(covariance)))
        doubtful = np.array([free[i].quantity.is_correction for i in kept], dtype=bool) & (ratios < 1)
        if not doubtful.any():
            return stays
        stays[kept[np.argmin(np.where(doubtful, ratios, np.inf))]] = False


def told_of(likelihood: LogLikelihood, peak: Maximum, reach: np.ndarray) -> tuple[Told, ...]:
    """Return what the data tell of each free parameter, in intervals that reach so many standard deviations (P,) to either side."""
    result = []
    for i, (parameter, z, std) in enumerate(zip(likelihood.free, peak.z, peak.std, strict=True)):
        low, high = z - reach[i] * std, z + reach[i] * std
        is_told = bool(std < UNTOLD)
        if parameter.quantity.is_positive and std * parameter.spread > _RAGGED:
            low, high = _profile(likelihood, peak, i)
            is_told = bool(high < _LARGEST_TOLD and (parameter.quantity.may_be_nothing or np.isfinite(low)))
        result.append(Told(parameter, float(parameter.value(z)), float(parameter.value(low)), float(parameter.value(high)), is_told))
    return tuple(result)


def _profile(likelihood: LogLikelihood, peak: Maximum, i: int) -> tuple[float, float]:
    """Return where -log p of the samples has risen by 1.92 to either side in z_i, the others as they are; -inf and inf where nowhere."""
    offsets = np.linspace(-_FARTHEST, _FARTHEST, 2 * _POINTS + 1)
    points = peak.z + offsets[:, None] * np.eye(len(peak.z))[i]
    values = likelihood.values_at(points) - 0.5 * np.sum(points**2, axis=1)
    is_far = values - values.min() > _LIKELIHOOD_DROP
    best = int(np.argmin(values))
    below, above = np.flatnonzero(is_far[:best]), np.flatnonzero(is_far[best:])
    low = peak.z[i] + offsets[below[-1]] if len(below) else -np.inf
    return low, peak.z[i] + offsets[best + above[0]] if len(above) else np.inf
