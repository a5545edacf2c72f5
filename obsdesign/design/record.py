"""What came out of a design."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.design.limits import Shortfall
from obsdesign.design.problem import DesignProblem
from obsdesign.display import AbstractDisplay, Summary, line_picture, number
from obsdesign.information.record import Information
from obsdesign.status import Status
from obsdesign.trajectory import Trajectory


@dataclass(frozen=True)
class Cap:
    """An upper bound on lambda_min(S W S) of every path: the smallest eigenvalue of a block that no path changes."""

    value: float
    states: tuple[str, ...]


@dataclass(frozen=True)
class Start:
    """One start of the solver: where it began, how it ended, the recomputed objective (NaN without an answer).

    residual: projected gradient of the Lagrangian, in units of the objective; refined: False where the coarse path it came to was
    left alone, as that of another start was better.
    """

    name: str
    status: Status
    value: float
    iterations: int
    residual: float
    refined: bool = True


@dataclass(frozen=True)
class Optimum:
    """A local optimum that one or several starts came to, by its objective."""

    value: float
    starts: tuple[str, ...]


@dataclass(frozen=True)
class Robustness:
    """The criterion over fresh draws of the prior, none of which the design has seen: their number, the worst, 5 %, mean."""

    draws: int
    worst: float
    five_percent: float
    mean: float


@dataclass(frozen=True, eq=False)
class Evidence(AbstractDisplay):
    """How much better another path might be: evidence, not proof.

    estimate: the smallest value found, over matrices Z >= 0 of trace 1, of the largest <Z, S W S> that any path was found to have
    (an upper bound if those were largest); Z (n, n), climbs: how many were made; remaining: 1 - value / estimate.
    """

    estimate: float
    remaining: float
    Z: np.ndarray
    climbs: int
    in_words: str

    def _summary(self) -> Summary:
        return Summary(
            "evidence of how much better another path might be", (("estimate", number(self.estimate)), ("in words", self.in_words))
        )


@dataclass(frozen=True, eq=False)
class Design(AbstractDisplay):
    """The best path found. value = criterion(S W S), recomputed by the analysis code; NaN without an answer.

    objective: what was maximised, the value (of the prior's draws where the problem is robust) minus prices. problem: with the
    duration of the path. trajectory and information are None when no start found an answer; `starts` tells what each did,
    `shortfalls` what stood in the way, `reason` the same in words. eigenvalues (2,): the two smallest of S W S.
    """

    problem: DesignProblem
    trajectory: Trajectory | None
    information: Information | None
    value: float
    status: Status
    starts: tuple[Start, ...]
    cap: Cap | None = None
    objective: float = float("nan")
    p: np.ndarray | None = None
    eigenvalues: tuple[float, float] = (float("nan"), float("nan"))
    residual: float = float("nan")
    iterations: int = 0
    seconds: float = 0.0
    optima: tuple[Optimum, ...] = ()
    robustness: Robustness | None = None
    evidence: Evidence | None = None
    shortfalls: tuple[Shortfall, ...] = ()
    reason: str = ""

    def _summary(self) -> Summary:
        problem, path = self.problem, self.trajectory
        rows = [("value", number(self.value))]
        if self.objective != self.value:
            rows.append(("objective", number(self.objective)))
        if self.cap is not None:
            rows.append(("cap of every path", f"{number(self.cap.value)}{', reached' * self.reaches_cap}"))
        if self.evidence is not None:
            rows.append(("another path", self.evidence.in_words))
        if path is not None and self.information is not None:
            rows.append(("path", f"{path.steps} steps of {number(path.step, 's')}, {number(path.t[-1] - path.t[0], 's')} in all"))
            deviations = zip(problem.system.model.states, self.information.std, strict=True)
            rows.append(("bound at the start", ", ".join(f"{state.name} {number(std, state.unit)}" for state, std in deviations)))
        rows.append(("starts", f"{len(self.starts)}, {self.iterations} iterations, {number(self.seconds, 's')}"))
        if self.reason:
            rows.append(("reason", self.reason))
        picture = line_picture(path.x[:, 0], path.x[:, 1]) if path is not None and path.x.shape[1] > 1 else ""
        return Summary(f"design: {self.status.value}", tuple(rows), picture)

    @property
    def reaches_cap(self) -> bool:
        """Whether the value lies within 1e-6 of its cap, so that no path does better."""
        return self.cap is not None and self.value >= self.cap.value * (1 - 1e-6)
