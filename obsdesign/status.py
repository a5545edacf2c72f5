"""One vocabulary for how IPOPT, Clarabel and the proof of a schedule ended."""

from __future__ import annotations

from enum import Enum


class Status(Enum):
    """How a solve ended; the value is the message."""

    OPTIMAL = "optimal, proven"
    LOCALLY_OPTIMAL = "locally optimal"
    INFEASIBLE = "infeasible, proven"
    LOCALLY_INFEASIBLE = "no feasible point found nearby"
    GAP_OPEN = "feasible, gap to the bound still open"
    ITERATION_LIMIT = "stopped at the iteration limit"
    TIME_LIMIT = "stopped at the time limit"
    NUMERICAL_ERROR = "stopped by a numerical error"

    @property
    def has_answer(self) -> bool:
        """Whether a result with this status may be used as an answer."""
        return self in (Status.OPTIMAL, Status.LOCALLY_OPTIMAL, Status.GAP_OPEN)

    @property
    def is_infeasible(self) -> bool:
        """Whether the study, not the solver, is what said no."""
        return self in (Status.INFEASIBLE, Status.LOCALLY_INFEASIBLE)
