"""What has to be known along the way: how large a standard deviation may be, and how often."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from obsdesign.arguments import validate_arguments
from obsdesign.checks import require_known, require_positive, require_within
from obsdesign.dynamics.model import Model
from obsdesign.errors import InputError
from obsdesign.selection.posterior.instant_costs import AboveLimit, InstantCosts

_ROUNDING = 1e-9  # of a standard deviation: what it may be above the limit
_WHOLE = 1e-9  # of an instant: a share of instants that is so near to a whole number is that


@validate_arguments
@dataclass(frozen=True)
class Requirement:
    """The standard deviation of a state, or the root of the summed variances of several, is at most so much along the way.

    sqrt(sum over `about` of (P_k)_ii) <= at_most, P_k the covariance after the samples at t_k, at this share at least of the instants
    k = 0..N-1 with t_k - t_0 > after. Raises InputError for other values.
    """

    about: tuple[str, ...]
    """Names of the states; several must have one unit."""
    at_most: float
    """The largest standard deviation, in the unit of the states, > 0."""
    share: float = 1.0
    """The share of those instants at which it holds, in (0, 1]; 1 = all."""
    after: float = 0.0
    """Instants count that are strictly later than so many seconds from the path's beginning: 0 leaves only the first one out [s]."""

    def __post_init__(self) -> None:
        names = (self.about,) if isinstance(self.about, str) else tuple(self.about) if isinstance(self.about, Sequence) else self.about
        if not isinstance(names, tuple) or not names or len(set(names)) < len(names):
            raise InputError(f"requirement: about is {self.about!r}: must be different names of states, at least one")
        object.__setattr__(self, "about", names)
        require_positive("requirement: at_most", self.at_most)
        require_positive("requirement: share", self.share)
        if self.share > 1:
            raise InputError(f"requirement: share is {self.share!r}: must be above 0 and at most 1")
        require_within("requirement: after", self.after)

    def __str__(self) -> str:
        some = "" if self.share == 1 else f" at {100 * self.share:g} % of the instants"
        return f"{' and '.join(self.about)} within {self.at_most:g}{some} after {self.after:g} s"


@dataclass(frozen=True, eq=False)
class RequiredKnowledge:
    """A requirement along a run: places (q,) of its states, counted (N,) bool, misses: at how many of those instants it may fail."""

    requirement: Requirement
    places: np.ndarray
    unit: str
    counted: np.ndarray
    misses: int

    @property
    def limit(self) -> float:
        """What the standard deviation may be, with what rounding may add to it."""
        return self.requirement.at_most * (1 + _ROUNDING)

    def costs(self, variance_error: float) -> InstantCosts:
        """Return the count of the instants at which it fails for sure where variances may be off by a share of them."""
        return InstantCosts(
            AboveLimit(self.limit**2 * (1 + variance_error)),
            self.places,
            np.ones(len(self.places)),
            self.counted.astype(float),
            is_worst=False,
        )

    def deviations(self, predicted: np.ndarray) -> np.ndarray:
        """Return the root of the summed variances (N,) of standard deviations (N, n)."""
        return np.sqrt((predicted[:, self.places] ** 2).sum(axis=1))

    def failures(self, predicted: np.ndarray) -> int:
        """Return at how many of the instants that count standard deviations (N, n) are above the limit."""
        return int((self.deviations(predicted)[self.counted] > self.limit).sum())

    def holds(self, predicted: np.ndarray) -> bool:
        """Whether standard deviations (N, n) keep it."""
        return self.failures(predicted) <= self.misses

    def worst(self, predicted: np.ndarray) -> tuple[float, int]:
        """Return the size on which it depends whether it is kept, and at which instant that is: the largest but those that may fail."""
        deviations = np.where(self.counted, self.deviations(predicted), -np.inf)
        k = int(np.argsort(-deviations, kind="stable")[self.misses])
        return float(deviations[k]), k

    def excess(self, predicted: np.ndarray, t: np.ndarray) -> str:
        """Return where standard deviations (N, n) at times (N,) break it, in words: x is 7.1 m at 83 s."""
        deviations = np.where(self.counted, self.deviations(predicted), -np.inf)
        worst, required = int(deviations.argmax()), self.requirement
        name, unit = " and ".join(required.about), f" {self.unit}" if self.unit else ""
        at_worst = f"{deviations[worst]:.3g}{unit} at {t[worst]:g} s"
        if required.share == 1:
            verb = "are" if len(required.about) > 1 else "is"
            return f"{name} {verb} {at_worst}"
        above, count = int((deviations > self.limit).sum()), int(self.counted.sum())
        return f"{name} above {required.at_most:g}{unit} at {above} of {count} instants ({self.misses} may be), {at_worst}"


def require_requirements(require: Sequence[Requirement] | Requirement, model: Model, t: np.ndarray) -> tuple[RequiredKnowledge, ...]:
    """Return requirements along a run with instants at times (N,), or raise InputError for what does not fit."""
    given = (require,) if isinstance(require, Requirement) else tuple(require)
    if not given:
        raise InputError("require is empty: must be one Requirement at least")
    return tuple(_along(requirement, model, t) for requirement in given)


def _along(requirement: Requirement, model: Model, t: np.ndarray) -> RequiredKnowledge:
    require_known("requirement: about", requirement.about, model.state_names)
    places = np.array([model.state_names.index(name) for name in requirement.about])
    units = ["rad" if model.states[i].is_angle else model.states[i].unit for i in places]
    if len(set(units)) > 1:
        shown = ", ".join(f"{name} in {unit or 'no unit'}" for name, unit in zip(requirement.about, units, strict=True))
        raise InputError(f"requirement: about has {shown}: states that are summed must have one unit; give a Requirement for each")
    counted = t - t[0] > requirement.after
    if not counted.any():
        raise InputError(f"requirement: after is {requirement.after:g} s: no instant with samples is later (the last is at {t[-1]:g} s)")
    misses = math.floor((1 - requirement.share) * int(counted.sum()) + _WHOLE)
    return RequiredKnowledge(requirement, places, units[0], counted, misses)
