"""The answer to the first question: what do the sensors see, what stays hidden, and how sure is that."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.display import AbstractDisplay, Summary
from obsdesign.errors import ExitCode, ObsdesignError


@dataclass(frozen=True, eq=False)
class Verdict(AbstractDisplay):
    """What of the n states can be told from the outputs, their derivatives and the known inputs.

    dimension: of the observable space; where not `decided`, the lower bound that is proven
    observable: dimension == n
    observable_states, unobservable_states: names of the states that are seen by themselves, and of the others
    null_space (n, n - dimension): orthonormal basis of the hidden directions at the point `at` (n,); where these depend on
        the unknown inputs, for one generic choice of them
    hidden: the same in words
    ranks: dimension after 0, 1, 2, ... steps, cut after the last growth: Lie derivatives of Omega_0, Omega_1, ... where their
        expressions stay small, else derivatives of the outputs with respect to time
    disturbance, known_inputs: the class of unknown and of known inputs for which this holds
    stopped_by: "full" (rank n) | "criterion" (a sweep added nothing) | "cap" (as much as if the unknown
        inputs were known; at a point: as much as nearby)
        | "bound" (2n + 2 steps were made) | "stalled" (no growth for the orders tried, no proof)
        | "precision" (the precision limit was reached, or it depends on how numbers are read that may be rounded)
    generic: the verdict at generic points nearby, where a point was asked for and the two differ
    decided: False where nothing is claimed beyond the lower bound; proof: what was proven, and how
    """

    dimension: int
    observable: bool
    observable_states: tuple[str, ...]
    unobservable_states: tuple[str, ...]
    null_space: np.ndarray
    hidden: str
    ranks: tuple[int, ...]
    disturbance: str
    known_inputs: str
    at: np.ndarray
    stopped_by: str
    decided: bool
    proof: str
    generic: Verdict | None = None

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
