"""What proves a bound on every path with every schedule, and what it is a bound of, in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from obsdesign.arguments import validate_arguments
from obsdesign.design.path_bound.certificate import PathCertificate
from obsdesign.display import AbstractDisplay, Summary, number


@validate_arguments
@dataclass(frozen=True)
class JointCertificate:
    """Numbers from which `check_joint_bound` proves a bound without a solver: a tree of cases, and what proves each of its ends.

    Every schedule is in one of the ends: where the tree branches, either one option is taken in a segment or one of the others.
    """

    branches: Sequence[tuple[int, int]] = ((-1, -1),)
    """The tree: (segment, option) of a node, what follows where that is taken, then where it is not; (-1, -1) at an end."""
    ends: Sequence[PathCertificate] = ()
    """What proves a bound at each end, in the order of the tree."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "branches", tuple((int(segment), int(option)) for segment, option in self.branches))
        object.__setattr__(self, "ends", tuple(self.ends))


@dataclass(frozen=True)
class JointBound(AbstractDisplay):
    """An upper bound on the value of every path of a class with every schedule, inf without one."""

    bound: float
    """No path of the class has a value above this with any schedule, in the unit of the criterion."""
    certificate: JointCertificate | None
    """What proves it; None without a bound."""
    class_of_paths: str
    """Which paths and schedules the bound holds for, in words."""
    left_out: tuple[str, ...] = ()
    """What the bound does not make use of, so that it may be larger than it need be."""
    reason: str = ""
    """Why there is no bound; "" where there is one."""

    def _summary(self) -> Summary:
        rows = [("holds for", self.class_of_paths), ("leaves out", ", ".join(self.left_out) or "nothing")]
        rows += [] if self.certificate is None else [("cases", str(len(self.certificate.ends)))]
        rows += [("reason", self.reason)] if self.reason else []
        return Summary(f"bound on every path and schedule: {number(self.bound)}", tuple(rows))
