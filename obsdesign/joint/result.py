"""What came out of choosing a path and a schedule together."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Generic, TypeAlias, TypeVar

import numpy as np

from obsdesign.design.record import Design, gap_between
from obsdesign.display import AbstractDisplay, Summary, number, raster_picture, raster_text
from obsdesign.joint.joint_certificate import JointBound
from obsdesign.rules.abstract import AbstractRule
from obsdesign.selection.posterior.filter_schedule import FilterSchedule
from obsdesign.selection.schedule import Schedule
from obsdesign.status import Status

AnySchedule = TypeVar("AnySchedule", Schedule, FilterSchedule)
"""A schedule for what is told of the start, or for what a filter knows."""


@dataclass(frozen=True, eq=False)
class OneSided(Generic[AnySchedule]):
    """A path and a schedule, one chosen for the other."""

    design: Design
    """The path, and the problem it answers."""
    schedule: AnySchedule
    """Certified for `design`'s path where that came first, else for the path that it was chosen on."""
    value: float
    """Criterion of the two minus what switching takes; NaN without an answer."""
    objective: float
    """The value minus the path's prices."""


@dataclass(frozen=True, eq=False)
class Joint(AbstractDisplay, Generic[AnySchedule]):
    """The best path and schedule found together.

    For what is told of the start, value = schedule.value, recomputed, of what is counted (design.value of what samples say together, where
    errors are not independent), and `schedule` a `Schedule`. For what a filter knows it is a `FilterSchedule`, whose value is a cost C, and
    value = -C, or 1 / C of a smallest eigenvalue: that of the criterion `Posterior` with the samples of the schedule.
    Status LOCALLY_OPTIMAL: neither the path alone nor the schedule alone was found to be improved; GAP_OPEN: the rounds ran out before.
    """

    design: Design
    """The path, designed for that schedule (`design.problem.weights`)."""
    schedule: AnySchedule
    """The schedule, certified for that path."""
    value: float
    """Criterion of the two minus what switching takes; NaN without an answer."""
    objective: float
    """What was maximised: the value minus the path's prices; NaN without an answer."""
    path_first: OneSided[AnySchedule]
    """The path designed for all sensors, then the best schedule for it."""
    sensors_first: OneSided[AnySchedule]
    """The best schedule on the shortest path, or the straight one, then the path designed for it."""
    alternation: tuple[float, ...]
    """The objective at the beginning and after every half step of the alternation that led to the answer, never decreasing."""
    origin: str
    """Where that alternation began."""
    alternated: float
    """The best objective that alternation reached from the two one-sided answers, without relaxed weights."""
    status: Status
    """How the search ended."""
    seconds: float
    """Wall time [s]."""
    per_segment: int = 0
    """How many sensors may be on at a time."""
    gap_limit: float | None = None
    """The gap to which `proof` branches; None: without branches."""
    rules: tuple[AbstractRule, ...] = ()
    """What the schedule keeps; `proof` is about schedules that keep them or not."""

    @cached_property
    def proof(self) -> JointBound:
        """What proves `bound`, computed when first asked for: a second, with a `gap_limit` up to a minute."""
        from obsdesign.joint.joint_proof import joint_bound_of

        if isinstance(self.schedule, FilterSchedule):
            return JointBound(np.inf, None, "", (), "what a filter knows has no such bound")
        if not self.status.has_answer or not self.per_segment:
            return JointBound(np.inf, None, "", (), "there is no path and schedule")
        problem = replace(self.design.problem, weights=None)
        proof = joint_bound_of(problem, len(self.schedule.chosen), self.per_segment, self.value, self.gap_limit)
        return replace(proof, left_out=tuple(dict.fromkeys((*proof.left_out, *(type(rule).__name__ for rule in self.rules)))))

    @property
    def bound(self) -> float:
        """No path of `proof.class_of_paths` has a value above this with any schedule; inf where nothing is proven."""
        return self.proof.bound

    @property
    def gap(self) -> float:
        """How far the value may be below the best there is: 1 - value / bound, or value / bound - 1 below 0; NaN without a bound."""
        return gap_between(self.value, self.bound)

    def _summary(self) -> Summary:
        rows = [
            ("value", number(self.value)),
            ("objective", number(self.objective)),
            ("bound of every path and schedule", f"{number(self.bound)}, gap {self.gap:.2%}" if np.isfinite(self.bound) else "none"),
            ("path first", number(self.path_first.objective)),
            ("sensors first", number(self.sensors_first.objective)),
            ("began from", self.origin),
            *((f"sensor {s}", marks) for s, marks in enumerate(raster_text(self.schedule.chosen))),
        ]
        return Summary(f"path and schedule together: {self.status.value}", tuple(rows), raster_picture(self.schedule.chosen))


AnyJoint: TypeAlias = Joint[Schedule] | Joint[FilterSchedule]
"""An answer to either question."""
