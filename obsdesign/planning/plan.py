"""What a step of the planner returns, and what it hands on to the next."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.design.nlp.evaluation import ConstraintRows
from obsdesign.design.sqp.solver_state import WarmStart
from obsdesign.display import AbstractDisplay, Summary, number, state_picture
from obsdesign.status import Status
from obsdesign.trajectory import Trajectory

_ITERATION_SECONDS = 0.05  # an iteration is taken to last so long before one was timed


@dataclass(frozen=True, eq=False)
class Memory:
    """What a step hands on to the next.

    elapsed_steps: steps since the first plan; p (q,): parameters of the problem's family on its own grid, the first `shift` steps of which
    have been flown; rows, warm_start: of the last solve, constraint_indices: indices of its constraints; met: indices of those that must
    hold once and have; spent: of each budget; iteration_seconds: what one iteration took.
    """

    elapsed_steps: int
    p: np.ndarray
    shift: int
    rows: ConstraintRows | None = None
    warm_start: WarmStart | None = None
    constraint_indices: tuple[int, ...] = ()
    met: frozenset[int] = frozenset()
    spent: tuple[float, ...] = ()
    iteration_seconds: float = _ITERATION_SECONDS


@dataclass(frozen=True, eq=False)
class Plan(AbstractDisplay):
    """A path from where the vehicle is."""

    trajectory: Trajectory
    """The path, from x_now at its t = 0 on."""
    value: float
    """What is maximised, recomputed: criterion(S (W + prior) S) minus prices; NaN where that was not done."""
    status: Status
    """How this step's solve ended, ITERATION_LIMIT being usual."""
    feasible: bool
    """Whether the path begins at x_now and breaks no limit, looked at ten times as often as the steps."""
    reason: str
    """What went wrong or is broken, in words; "" = nothing."""
    age: int
    """How many plans ago the inputs were found, 0 = in this one."""
    time: float
    """Time since the first plan [s]."""
    seconds: float
    """Wall time that the step took [s]."""
    memory: Memory
    """What the next step goes on from."""

    def _summary(self) -> Summary:
        path = self.trajectory
        rows = [
            ("value", number(self.value)),
            ("limits", "all kept" if self.feasible else self.reason),
            ("path", f"{path.steps} steps of {number(path.step, 's')}"),
            ("inputs found", f"{self.age} steps ago" if self.age else "now"),
            ("took", number(self.seconds, "s")),
        ]
        return Summary(f"plan at {number(self.time, 's')}: {self.status.value}", tuple(rows), state_picture(path.x))

    @property
    def x0(self) -> np.ndarray:
        """Where the path begins (n,)."""
        return self.trajectory.x[0]

    @property
    def p(self) -> np.ndarray:
        """Parameters (q,) that the next solve begins from: those of the path, or of one that did not keep all limits yet."""
        return self.memory.p
