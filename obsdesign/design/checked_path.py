"""A path under the limits of a problem, and which of two such paths is better."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from obsdesign.design.feasibility import violations
from obsdesign.design.problem import DesignProblem
from obsdesign.design.violation import Violation
from obsdesign.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class CheckedPath:
    """A path under the limits of a problem; what is asked of it is computed when it is asked for, and once."""

    problem: DesignProblem
    path: Trajectory

    @cached_property
    def violations(self) -> tuple[Violation, ...]:
        """What it breaks, worst first."""
        return violations(self.problem, self.path)

    @cached_property
    def objective(self) -> float:
        """What is maximised, recomputed."""
        return self.problem.objective(self.path)

    def better_of(self, rival: CheckedPath) -> CheckedPath:
        """Return the better one: feasible rather than not, then of higher objective, or of later and smaller violations."""
        if not self.violations:
            # looking between the nodes takes longer than the rest: only where it matters
            return self if self.objective >= rival.objective or rival.violations else rival
        return self if rival.violations and self._severity > rival._severity else rival

    @property
    def _severity(self) -> tuple[float, float]:
        """When it comes, and how bad it is: what is far ahead will be planned again."""
        return min(violation.time for violation in self.violations), self.violations[0].margin
