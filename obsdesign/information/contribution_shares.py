"""Who says what: the share of each sensor and stretch of a path in what is known of each state."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.arguments import validate_arguments
from obsdesign.checks import require_divisor
from obsdesign.display import AbstractDisplay, Summary, data_frame
from obsdesign.dynamics.model import AbstractSystem
from obsdesign.dynamics.simulation import as_scale
from obsdesign.errors import InputError
from obsdesign.information.blocks import Information
from obsdesign.round_off import Visibility
from obsdesign.signals import Signal

if TYPE_CHECKING:
    from pandas import DataFrame

_BULK_SHARE = 0.7  # what a sentence calls most of what is known


@dataclass(frozen=True, eq=False)
class Contributions(AbstractDisplay):
    """What K stretches of a path and S sensors add to what is known of n states.

    1/std_i^2 = 1/(W^-1)_ii is a sum over blocks: `contributions` has the equation.
    """

    states: tuple[Signal, ...]
    """The n states: names, units, which of them wrap."""
    sensors: tuple[str, ...]
    """Names of the S sensors."""
    std: np.ndarray
    """Cramer-Rao bound (n,) of each state, in the unit of the state; inf where hidden."""
    shares: np.ndarray
    """The part of 1/std^2 that each block brings (n, K, S), summing to 1 for each state; NaN for a hidden one."""
    weakest: np.ndarray
    """Unit vector (n,), in scaled states, of the direction known least."""
    weakest_value: float
    """Information along it, the smallest eigenvalue of S W S."""
    weakest_shares: np.ndarray
    """The part of that value that each block brings (K, S), summing to 1; NaN where there is none."""

    def to_dataframe(self) -> DataFrame:
        """Return a row for each state and a column for each sensor: its share of what is known of the state, over all stretches.

        Raises MissingPackageError where pandas is not installed.
        """
        shares = self.shares.sum(axis=1)
        return data_frame(dict(zip(self.sensors, shares.T, strict=True)), {"state": np.array([state.name for state in self.states])})

    def _summary(self) -> Summary:
        stretches = self.shares.shape[1]
        rows = zip((state.name for state in self.states), self.sentences, strict=True)
        return Summary(f"who says what, over {stretches} stretches of the path", tuple(rows))

    @property
    def sentences(self) -> tuple[str, ...]:
        """One sentence for each state: "wind_x is known to 0.49 m/s; 71 % of that knowledge comes from gps in segments 3-7"."""
        return tuple(self._sentence(i) for i in range(len(self.states)))

    def _sentence(self, i: int) -> str:
        state = self.states[i]
        if not np.isfinite(self.std[i]):
            return f"{state.name} stays hidden"
        sensor, first, last = shortest_bulk(self.shares[i])
        share = self.shares[i, first : last + 1, sensor].sum()
        segments = f"segment {first + 1}" if first == last else f"segments {first + 1}-{last + 1}"
        unit = f" {state.unit}" if state.unit else ""
        bulk = f"{100 * share:.0f} % of that knowledge comes from {self.sensors[sensor]} in {segments}"
        return f"{state.name} is known to {self.std[i]:.3g}{unit}; {bulk}"


@validate_arguments
def contributions(
    system: AbstractSystem, information: Information, segments: int | None = None, scale: ArrayLike | None = None
) -> Contributions:
    """Return who says what about x(t_0): the part of each segment and sensor in the knowledge of each state.

    What is known of state i is 1/(W^-1)_ii = v'W v, v = W^-1 e_i / (W^-1)_ii: a sum over blocks, v'W_ks v >= 0 each. It is also
    how much the knowledge would grow with the weight of that block. Where errors are not independent, a sample is credited with what
    it says beyond those before it (and, in joint noise, beside it): the sum is the exact one.

    Arguments:
        system: vehicle and sensors.
        information: what the samples of a path say, as variational_gramian returns it.
        segments: number K of equal segments, which divides the steps; None = every step.
        scale (n,): what counts as one unit of each state in the weakest direction; None = ones.
    Raises InputError for segments that do not divide the steps.
    """
    states = system.model.states
    if information.blocks.shape[1:3] != (len(system.model.channels), len(states)):
        raise InputError(
            f"information {information.blocks.shape} is not of this system: {len(system.model.channels)} sensors, {len(states)} states"
        )
    S = as_scale(system, scale)
    segment_information = _SegmentInformation(information, len(information.blocks) if segments is None else segments)
    require_divisor("segments", segment_information.segments, "steps", len(information.blocks))
    visibility = information.visibility
    shares = np.stack([_shares(segment_information, v) for v in _profiles(visibility)])
    values, vectors = visibility.principal_axes(S)
    weakest_shares = (
        _shares(segment_information, S * vectors[:, 0])
        if values[0]
        else np.full((segment_information.segments, len(information.names)), np.nan)
    )
    return Contributions(states, information.names, visibility.std, shares, vectors[:, 0], float(values[0]), weakest_shares)


def _profiles(visibility: Visibility) -> np.ndarray:
    """Rows v = W^-1 e_i / (W^-1)_ii: along v state i changes by 1 and the others so that the samples notice least; NaN if hidden."""
    inverse, is_visible = visibility.covariance, np.isfinite(visibility.std)
    rows = np.full_like(inverse, np.nan)
    rows[is_visible] = inverse[is_visible] / np.diag(inverse)[is_visible, None]
    return rows


@dataclass(frozen=True, eq=False)
class _SegmentInformation:
    """Information of K equal segments."""

    information: Information
    segments: int

    @cached_property
    def blocks(self) -> np.ndarray:
        """(K, S, n, n)."""
        return self.information.by_segment(self.segments)

    def along(self, v: np.ndarray) -> np.ndarray:
        """Return (K, S), summing to v'W v."""
        if self.information.samples is None and self.information.origin is None:
            return np.einsum("i,ksij,j->ks", v, self.blocks, v)
        amounts = self.information.along(v)
        return amounts.reshape(self.segments, -1, amounts.shape[1]).sum(axis=1)


def _shares(segment_information: _SegmentInformation, v: np.ndarray) -> np.ndarray:
    amounts = segment_information.along(v)
    total = amounts.sum()
    return np.maximum(amounts, 0.0) / total if total > 0 else np.full(amounts.shape, np.nan)


def shortest_bulk(shares: np.ndarray) -> tuple[int, int, int]:
    """Return (sensor, first, last segment): the shortest stretch of one sensor that holds most of its share.

    The sensor is the one of the largest share; most is 70 % of what it brings.
    """
    sensor = int(shares.sum(axis=0).argmax())
    column = shares[:, sensor]
    cumulative = np.concatenate([[0.0], np.cumsum(column)])
    target = _BULK_SHARE * cumulative[-1]
    ends = np.searchsorted(cumulative, cumulative[:-1] + target * (1 - 1e-12))  # for each first segment, one past the last
    lengths = np.where(ends < len(cumulative), ends - np.arange(len(column)), len(column) + 1)
    first = int(lengths.argmin())
    return sensor, first, int(ends[first]) - 1
