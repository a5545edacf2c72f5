"""The answer to the first question: what do the sensors see, what stays hidden, and how sure is that."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.analysis.symmetry import Symmetry
from obsdesign.display import AbstractDisplay, Summary
from obsdesign.errors import ExitCode, ObsdesignError


@dataclass(frozen=True, eq=False)
class Verdict(AbstractDisplay):
    """What of the n states can be told from the outputs, their derivatives and the known inputs."""

    dimension: int
    """Dimension of the observable space; where not `decided`, the lower bound that is proven."""
    observable: bool
    """Whether dimension == n."""
    observable_states: tuple[str, ...]
    """Names of the states that are seen by themselves."""
    unobservable_states: tuple[str, ...]
    """Names of the others."""
    null_space: np.ndarray
    """Orthonormal basis (n, n - dimension) of the hidden directions at the point `at`; where these depend on the unknown inputs, for one
    generic choice of them.
    """
    hidden: str
    """The same in words."""
    ranks: tuple[int, ...]
    """Dimension after 0, 1, 2, ... steps, cut after the last growth: Lie derivatives of Omega_0, Omega_1, ... where their expressions stay
    small, else derivatives of the outputs with respect to time.
    """
    disturbance: str
    """The class of unknown inputs for which this holds."""
    known_inputs: str
    """The class of known inputs for which this holds."""
    at: np.ndarray
    """The point (n,) that was looked at, in the units of the states."""
    stopped_by: str
    """"full" (rank n) | "criterion" (a sweep added nothing) | "cap" (as much as if the unknown inputs were known; at a point: as much as
    nearby) | "bound" (2n + 2 steps were made) | "stalled" (no growth for the orders tried, no proof) | "precision" (the precision limit
    was reached, or it depends on how numbers are read that may be rounded).
    """
    decided: bool
    """False where nothing is claimed beyond the lower bound."""
    proof: str
    """What was proven, and how."""
    symmetries: tuple[Symmetry, ...] = ()
    """What hides the state from any state, as vector fields proven to annihilate what is known of it; `null_space` may hold more."""
    generic: Verdict | None = None
    """The verdict at generic points nearby, where a point was asked for and the two differ."""

    def _summary(self) -> Summary:
        n = self.null_space.shape[0]
        rows = [
            ("seen", ", ".join(self.observable_states) or "no state by itself"),
            ("not seen", ", ".join(self.unobservable_states)),
            ("hidden", self.hidden),
            ("unknown inputs", self.disturbance),
            ("known inputs", self.known_inputs),
            ("proof", self.proof),
        ]
        decided = "decided" if self.decided else f"not decided ({self.stopped_by})"
        return Summary(f"{self.dimension} of {n} dimensions seen, {decided}", tuple(row for row in rows if row[1]))


class UnobservableError(ObsdesignError):
    """The sensors cannot see the whole state; `verdict` says which direction stays hidden."""

    def __init__(self, verdict: Verdict) -> None:
        super().__init__(f"unobservable: the sensors see {verdict.dimension} of {verdict.null_space.shape[0]} dimensions; {verdict.hidden}")
        self.verdict = verdict

    def __reduce__(self) -> tuple[type, tuple[Verdict]]:
        return type(self), (self.verdict,)

    @property
    def exit_code(self) -> ExitCode:
        """The study says no."""
        return ExitCode.NO
