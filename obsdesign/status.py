"""One vocabulary for how local solves, convex solves and the proof of a schedule ended."""

from __future__ import annotations

from enum import Enum


class Status(Enum):
    """How a solve ended; the value is the message."""

    OPTIMAL = "optimal, proven"
    """The answer is the best there is, within the gap asked for."""
    LOCALLY_OPTIMAL = "locally optimal"
    """No answer nearby is better; another one elsewhere may be."""
    INFEASIBLE = "infeasible, proven"
    """No answer can keep all limits."""
    LOCALLY_INFEASIBLE = "no feasible point found nearby"
    """The search ended without an answer that keeps all limits; there may be one elsewhere."""
    GAP_OPEN = "feasible, gap to the bound still open"
    """The answer keeps all rules; that none is much better is not proven."""
    ITERATION_LIMIT = "stopped at the iteration limit"
    """The search had no more iterations."""
    TIME_LIMIT = "stopped at the time limit"
    """The search had no more time."""
    ABANDONED = "abandoned, as it crept below what another start had come to"
    """The search was no longer worth its time."""
    NUMERICAL_ERROR = "stopped by a numerical error"
    """The arithmetic gave no number to go on with."""

    @property
    def has_answer(self) -> bool:
        """Whether a result with this status may be used as an answer."""
        return self in (Status.OPTIMAL, Status.LOCALLY_OPTIMAL, Status.GAP_OPEN)

    @property
    def is_infeasible(self) -> bool:
        """Whether the study, not the solver, is what said no."""
        return self in (Status.INFEASIBLE, Status.LOCALLY_INFEASIBLE)
