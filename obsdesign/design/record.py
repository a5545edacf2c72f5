"""What came out of a design."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from obsdesign.design.problem import DesignProblem
from obsdesign.design.violation import Violation
from obsdesign.display import AbstractDisplay, Summary, number, state_picture
from obsdesign.information.blocks import Information
from obsdesign.status import Status
from obsdesign.trajectory import Trajectory

if TYPE_CHECKING:
    from obsdesign.design.path_bound.certificate import PathBound
    from obsdesign.design.upper_bound import Cap

_CLOSED = 1e-4  # gap at which a path counts as the best there is
_ROUNDING = 1e-9  # relative difference of value and bound that may be rounding: a gap of 0


@dataclass(frozen=True)
class Start:
    """One start of the solver: where it began and how it ended."""

    name: str
    """What the initial guess is called."""
    status: Status
    """How the solve ended."""
    value: float
    """The recomputed objective; NaN without an answer."""
    iterations: int
    """How many steps the solver made."""
    residual: float
    """Projected gradient of the Lagrangian, in units of the objective."""
    refined: bool = True
    """False where the coarse path it came to was left alone, as that of another start was better."""


@dataclass(frozen=True)
class Optimum:
    """A local optimum that one or several starts came to."""

    value: float
    """Its objective."""
    starts: tuple[str, ...]
    """Names of the starts."""


@dataclass(frozen=True)
class Robustness:
    """The criterion over fresh draws of the prior, none of which the design has seen."""

    draws: int
    """Number of draws."""
    worst: float
    """The smallest value."""
    five_percent: float
    """The value below which 5 % of the draws are."""
    mean: float
    """The mean value, in the unit of the criterion."""


@dataclass(frozen=True, eq=False)
class Evidence(AbstractDisplay):
    """How much better another path might be: evidence, not proof.

    For Z >= 0 of trace 1, lambda_min(S W S) <= <Z, S W S>: the largest <Z, S W S> of all paths would be an upper bound for each Z.
    """

    estimate: float
    """The smallest value found, over Z, of the largest <Z, S W S> that any path was found to have (a bound if those were largest)."""
    remaining: float
    """1 - value / estimate."""
    Z: np.ndarray
    """The matrix (n, n) that gave the estimate."""
    climbs: int
    """How many local solves were made."""
    in_words: str
    """The same as a sentence."""

    def _summary(self) -> Summary:
        return Summary(
            "evidence of how much better another path might be", (("estimate", number(self.estimate)), ("in words", self.in_words))
        )


def gap_between(value: float, bound: float) -> float:
    """Return 1 - value / bound, value / bound - 1 of a bound below 0; 0 where they differ by rounding, NaN without a bound."""
    ratio = value / bound if np.isfinite(bound) and bound else float("nan")
    gap = ratio - 1 if bound < 0 else 1 - ratio
    return 0.0 if abs(gap) <= _ROUNDING else gap


@dataclass(frozen=True, eq=False)
class GapSearch:
    """A search that went on from ever more starts until its gap was small enough, or its limit of starts was reached."""

    gap: float
    """The gap that was asked for."""
    limit: int
    """How many starts it was allowed."""
    proof: PathBound
    """The bound that it measured its gap against."""

    def in_words(self, design: Design) -> str:
        """Return how the search for a design ended, as a sentence without a full stop."""
        wanted = f"a gap of {self.gap:.3%} at most was asked for"
        if not np.isfinite(design.bound):
            return f"{wanted}, which nothing proves without a bound"
        if design.gap <= self.gap:
            return f"{wanted} and is reached after {len(design.starts)} starts"
        return f"{wanted}, and {len(design.starts)} starts, the limit of work, came to {design.gap:.3%}"


@dataclass(frozen=True, eq=False)
class Design(AbstractDisplay):
    """The best path found for a problem.

    value = criterion(S W S), recomputed by the analysis code. trajectory and information are None when no start found an answer; `starts`
    tells what each did, `violations` what stood in the way, `reason` the same in words.
    """

    problem: DesignProblem
    """The problem solved, with the duration of the path."""
    trajectory: Trajectory | None
    """The path; None without an answer."""
    information: Information | None
    """What its samples say about x(t_0); None without an answer."""
    value: float
    """The criterion, recomputed from the path; NaN without an answer."""
    ended: Status
    """How the search ended, whatever is known of other paths."""
    starts: tuple[Start, ...]
    """What each initial guess came to."""
    cap: Cap | None = None
    """An upper bound on every path, where one is known."""
    objective: float = float("nan")
    """What was maximised: the value (of the prior's draws where the problem is robust) minus prices."""
    p: np.ndarray | None = None
    """Parameters (q,) of the path within its family, in the inputs' units."""
    eigenvalues: tuple[float, float] = (float("nan"), float("nan"))
    """The two smallest eigenvalues of S W S."""
    residual: float = float("nan")
    """Projected gradient of the Lagrangian at the answer, in units of the objective."""
    iterations: int = 0
    """Steps of the solver that led to the answer."""
    seconds: float = 0.0
    """Wall time [s]."""
    optima: tuple[Optimum, ...] = ()
    """The distinct local optima, each with the starts that came to it."""
    robustness: Robustness | None = None
    """The criterion over fresh draws of the prior, where the problem is robust."""
    evidence: Evidence | None = None
    """How much better another path might be, where it was asked for."""
    violations: tuple[Violation, ...] = ()
    """The limits that stood in the way."""
    reason: str = ""
    """Why there is no answer, in words; "" where there is one."""
    search: GapSearch | None = None
    """How long it was searched, where a gap was asked for."""

    def _summary(self) -> Summary:
        problem, path = self.problem, self.trajectory
        rows = [("value", number(self.value))]
        if self.objective != self.value:
            rows.append(("objective", number(self.objective)))
        if self.ended.has_answer:
            rows.append(("bound of every path", f"{number(self.bound)}, gap {self.gap:.2%}" if np.isfinite(self.bound) else "none"))
        if self.cap is not None:
            rows.append(("cap of every path", f"{number(self.cap.value)}{', reached' * self.reaches_cap}"))
        if self.evidence is not None:
            rows.append(("another path", self.evidence.in_words))
        if path is not None and self.information is not None:
            rows.append(("path", f"{path.steps} steps of {number(path.step, 's')}, {number(path.t[-1] - path.t[0], 's')} in all"))
            deviations = zip(problem.system.model.states, self.information.std, strict=True)
            rows.append(("bound at the start", ", ".join(f"{state.name} {number(std, state.unit)}" for state, std in deviations)))
        rows.append(("starts", f"{len(self.starts)}, {self.iterations} iterations, {number(self.seconds, 's')}"))
        if self.search is not None:
            rows.append(("search", self.search.in_words(self)))
        if self.reason:
            rows.append(("reason", self.reason))
        picture = "" if path is None else state_picture(path.x)
        return Summary(f"design: {self.status.value}", tuple(rows), picture)

    @cached_property
    def proof(self) -> PathBound:
        """What proves `bound`, computed when first asked for: a fraction of a second, seconds for more than 100 pieces."""
        from obsdesign.design.path_bound.proof import path_bound_of

        if self.search is not None:
            return self.search.proof
        return path_bound_of(self.problem, self.value)

    @property
    def bound(self) -> float:
        """No path of `proof.class_of_paths` has a value above this; inf where nothing is proven."""
        return self.proof.bound

    @property
    def gap(self) -> float:
        """How far the value may be below the best there is: 1 - value / bound, or value / bound - 1 below 0; NaN without a bound."""
        return gap_between(self.value, self.bound)

    @property
    def status(self) -> Status:
        """How the solve ended: OPTIMAL with a gap of 1e-4 at most, GAP_OPEN with a larger one, LOCALLY_OPTIMAL where there is no bound."""
        if not self.ended.has_answer or not np.isfinite(self.bound):
            return self.ended
        return Status.OPTIMAL if self.gap <= _CLOSED else Status.GAP_OPEN

    @property
    def reaches_cap(self) -> bool:
        """Whether the value lies within 1e-6 of its cap, so that no path does better."""
        return self.cap is not None and self.value >= self.cap.value * (1 - 1e-6)
