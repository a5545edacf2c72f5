"""The information blocks that design, selection and validation share."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.checks import as_array, require_divisor
from obsdesign.display import AbstractDisplay, Summary, number
from obsdesign.errors import InputError
from obsdesign.information.correlated_samples import CorrelatedSamples
from obsdesign.information.provenance import Origin
from obsdesign.round_off import Visibility, reweigh, square_root_rows, visibility_of_sum


@dataclass(frozen=True, eq=False)
class Information(AbstractDisplay):
    """What the samples along a path say about its initial state x(t_0), by step and sensor.

    Weighted blocks are Fisher information, in 1/(unit_i unit_j). Where the errors of samples are independent, information adds up
    over steps and sensors, and so do the blocks. The samples of sensors whose errors are not (correlated in time, constant, joint)
    are in `samples` as well: `total`, `std`, `final` and `under` are exact for them, their blocks and those of `by_segment` are
    amounts from below: whichever of them are added up are no more than what those samples say together.
    """

    blocks: np.ndarray
    """Block [k, s] of (N, S, n, n) is what sensor s, sampled at t_k, says about x(t_0)."""
    names: tuple[str, ...]
    """Names of the S sensors."""
    transition: np.ndarray | None = None
    """Phi = dx(t_N)/dx(t_0) (n, n), which carries information to the end of the path; None = not known."""
    samples: CorrelatedSamples | None = None
    """The samples whose errors are not independent; None = there are none."""
    origin: Origin | None = None
    """The system and path that it comes from, so that round-off can be told from information; None: by the blocks alone."""

    def __post_init__(self) -> None:
        blocks = self.blocks if isinstance(self.blocks, np.ndarray) and self.blocks.dtype == float else as_array("blocks", self.blocks)
        if not isinstance(self.names, tuple) or any(not isinstance(name, str) for name in self.names):
            raise InputError(f"information: names are {self.names!r}: must be a tuple of texts, one for each sensor")
        if blocks.ndim != 4 or blocks.shape[1] != len(self.names) or blocks.shape[2] != blocks.shape[3]:
            raise InputError(f"information: blocks {blocks.shape} do not fit (N, {len(self.names)}, n, n)")
        if self.transition is not None:
            transition = as_array("transition", self.transition)
            if transition.shape != blocks.shape[2:]:
                raise InputError(f"information: transition has shape {transition.shape}: must be {blocks.shape[2:]}")
            object.__setattr__(self, "transition", transition)
        for what, value, kind in (("samples", self.samples, CorrelatedSamples), ("origin", self.origin, Origin)):
            if value is not None and not isinstance(value, kind):
                raise InputError(f"information: {what} is {value!r}: must be made by a Gramian, or None")
        if blocks.flags.writeable:  # someone else may still write to it
            blocks = blocks.copy()
            blocks.setflags(write=False)
        object.__setattr__(self, "blocks", blocks)

    def _summary(self) -> Summary:
        steps, sensors, n = self.blocks.shape[:3]
        rows = [(f"std of state {i}", number(value) if np.isfinite(value) else "hidden") for i, value in enumerate(self.std)]
        title = f"information of {steps} steps and {sensors} sensors ({', '.join(self.names)}) about {n} states at the start"
        return Summary(title, tuple(rows))

    @property
    def total(self) -> np.ndarray:
        """W (n, n) = A' R^-1 A of all samples, R the covariance of their errors: the sum of all blocks where those are independent."""
        n = self.blocks.shape[2]
        if self.samples is None:
            return self.blocks.reshape(-1, n * n).sum(axis=0).reshape(n, n)
        return self.blocks[:, self._white_sensors].sum(axis=(0, 1)) + self.samples.information()

    def under(self, active: ArrayLike) -> np.ndarray:
        """W (n, n) of the samples of the sensors that are on, active (N, S): true or false, or the share of the samples that count."""
        weights = as_array("active", active)
        if weights.shape != self.blocks.shape[:2] or not ((weights >= 0) & (weights <= 1)).all():
            raise InputError(f"active has shape {weights.shape}: must be {self.blocks.shape[:2]}, every entry from 0 to 1")
        if self.samples is None:
            return np.einsum("ks,ksij->ij", weights, self.blocks)
        white = np.einsum("ks,ksij->ij", weights[:, self._white_sensors], self.blocks[:, self._white_sensors])
        return white + self.samples.information(weights[:, list(self.samples.colour.sensor_indices)])

    def along(self, v: np.ndarray) -> np.ndarray:
        """Return (N, S) >= 0, summing to v'W v: what each sample says beyond those before it and, in joint noise, beside it."""
        if self.origin is not None and self.origin.is_of_samples:
            amounts = self.origin.along(v)
        else:
            amounts = np.einsum("i,ksij,j->ks", v, self.blocks, v)
        if self.samples is not None:
            amounts[:, list(self.samples.colour.sensor_indices)] = self.samples.along(v)
        return amounts

    @property
    def std(self) -> np.ndarray:
        """Cramer-Rao bound (n,) of each component of x(t_0) in its unit: sqrt(diag(W^-1)); inf for what stays hidden."""
        return self.visibility.std

    @cached_property
    def visibility(self) -> Visibility:
        """The directions that are seen and those that stay hidden, where what is seen of them is round-off."""
        if self.origin is None:
            return visibility_of_sum(self.total)
        if self.origin.is_of_samples and self.samples is None:
            return self.origin.visibility
        return reweigh(self.origin.visibility, self._independent_rows)

    @property
    def _independent_rows(self) -> np.ndarray:
        """Independent rows (m, n) of variance 1 about x(t_0), whose squares add up to `total`."""
        if self.origin is None or not self.origin.is_of_samples or self.samples is None:
            return square_root_rows(self.total)
        return np.concatenate([self.origin.rows_of(self._white_sensors), self.samples.independent_rows])

    @property
    def final(self) -> np.ndarray:
        """Phi^-T W Phi^-1 (n, n), what all samples say about x(t_N); raises InputError where Phi is not known or is singular."""
        try:
            inverse = np.linalg.inv(self._require_transition())
        except np.linalg.LinAlgError:
            raise InputError("information: the transition dx(t_N)/dx(t_0) is singular: the path forgets its start") from None
        return inverse.T @ self.total @ inverse

    def then(self, later: Information) -> Information:
        """Return the information of this path followed by another, about the start of this one: blocks Phi' W_k Phi.

        Errors go on: constants stay what they are, and the first sample of the later path is to the last one of this path as the
        next sample of that sensor.

        Raises InputError unless both are about the same sensors and states and this one's transition is known.
        """
        Phi = self._require_transition()
        if later.names != self.names or later.blocks.shape[2] != len(Phi):
            raise InputError(f"information of {', '.join(later.names)} does not follow that of {', '.join(self.names)}: another system")
        if (self.samples and self.samples.colour) != (later.samples and later.samples.colour):
            raise InputError("information of other noise does not follow: both need the same correlation, constant and joint errors")
        blocks = np.concatenate([self.blocks, Phi.T @ later.blocks @ Phi])
        samples = None if self.samples is None or later.samples is None else self.samples.then(later.samples, Phi)
        origin = later.origin.after(self.origin) if self.origin and later.origin else None
        return with_samples(blocks, self.names, None if later.transition is None else later.transition @ Phi, samples, origin)

    def by_segment(self, segments: int) -> np.ndarray:
        """Return (K, S, n, n): what counts for each sensor in each of K equal groups of steps.

        The blocks summed; where errors are not independent, amounts from below for every schedule, `under` the exact value.

        Arguments:
            segments: number K of groups, which divides the N steps.
        Raises InputError where it does not.
        """
        steps = len(self.blocks)
        require_divisor("segments", segments, "steps", steps)
        summed = self.blocks.reshape(segments, steps // segments, *self.blocks.shape[1:]).sum(axis=1)
        return self._with_correlated_amounts(summed, np.arange(0, steps, steps // segments))

    def by_stretch(self, firsts: np.ndarray) -> np.ndarray:
        """Return the same (K, S, n, n) for stretches of any length that begin at steps `firsts` (K,), the first at 0."""
        return self._with_correlated_amounts(np.add.reduceat(self.blocks, firsts, axis=0), firsts)

    def _with_correlated_amounts(self, summed: np.ndarray, firsts: np.ndarray) -> np.ndarray:
        if self.samples is not None:
            summed[:, list(self.samples.colour.sensor_indices)] = self.samples.amounts(firsts)
        return summed

    @property
    def _white_sensors(self) -> list[int]:
        """Places of the sensors whose errors are independent."""
        coloured = () if self.samples is None else self.samples.colour.sensor_indices
        return [s for s in range(len(self.names)) if s not in coloured]

    def _require_transition(self) -> np.ndarray:
        if self.transition is None:
            raise InputError("information: the transition dx(t_N)/dx(t_0) is not known, so nothing can be said about the end of the path")
        return self.transition

    def only(self, *sensors: str) -> Information:
        """Return the information of the named sensors alone."""
        unknown = [name for name in sensors if name not in self.names]
        if unknown:
            raise InputError(f"no sensor {unknown[0]!r} (there are {', '.join(self.names)})")
        places = [self.names.index(name) for name in sensors]
        samples = None if self.samples is None else self.samples.only(places)
        origin = None if self.origin is None else self.origin.only(places)
        return with_samples(self.blocks[:, places], sensors, self.transition, samples, origin)


def with_samples(
    blocks: np.ndarray, names: tuple[str, ...], transition: np.ndarray | None, samples: CorrelatedSamples | None, origin: Origin | None
) -> Information:
    """Return information whose blocks of coloured sensors are the amounts that each single sample may be counted for.

    blocks that nobody else writes to, and all else as a Gramian makes them: none is checked.
    """
    if samples is not None:
        blocks = blocks.copy()
        blocks[:, list(samples.colour.sensor_indices)] = samples.amounts(np.arange(len(blocks)))
    blocks.setflags(write=False)
    information = object.__new__(Information)
    vars(information).update(blocks=blocks, names=names, transition=transition, samples=samples, origin=origin)
    return information
