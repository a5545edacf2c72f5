"""Whether what is predicted ranks windows as what happened does."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

_FEWEST = 5  # windows that a rank correlation needs
_DRAWS = 400  # of the bootstrap
_LEVEL = 0.95


@dataclass(frozen=True)
class RankCorrelation:
    """Spearman's correlation of predicted with actual errors, and the 95 % interval of a bootstrap of blocks of windows; nan of too few."""

    value: float
    """From -1 to 1."""
    low: float
    """Lower end of the interval, scaled as the value."""
    high: float
    """Upper end of the interval, scaled as the value."""
    windows: int
    """How many windows were ranked."""


def rank_correlation(predicted: np.ndarray, actual: np.ndarray) -> RankCorrelation:
    """Return the rank correlation of two series (K,), of those pairs that are both numbers (inf is one).

    Neighbouring windows are alike, so blocks of K^1/3 of them are drawn (Kuensch 1989), always the same ones.
    """
    is_there = ~(np.isnan(predicted) | np.isnan(actual))
    first, second = predicted[is_there], actual[is_there]
    count = len(first)
    if count < _FEWEST:
        return RankCorrelation(float("nan"), float("nan"), float("nan"), count)
    length = max(round(count ** (1 / 3)), 1)
    random = np.random.default_rng(0)
    starts = random.integers(0, count - length + 1, (_DRAWS, -(-count // length)))
    places = (starts[:, :, None] + np.arange(length)).reshape(_DRAWS, -1)[:, :count]
    draws = np.array([_spearman(first[chosen], second[chosen]) for chosen in places])
    low, high = np.nanquantile(draws, [(1 - _LEVEL) / 2, (1 + _LEVEL) / 2]) if np.isfinite(draws).any() else (np.nan, np.nan)
    return RankCorrelation(_spearman(first, second), float(low), float(high), count)


def _spearman(first: np.ndarray, second: np.ndarray) -> float:
    from scipy.stats import rankdata

    ranks = rankdata(first), rankdata(second)
    if any(np.ptp(values) == 0 for values in ranks):
        return float("nan")
    return float(np.corrcoef(*ranks)[0, 1])
