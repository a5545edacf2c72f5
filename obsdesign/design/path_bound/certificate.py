"""What proves a bound on every path, and what it is a bound of, in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from obsdesign.arguments import validate_arguments
from obsdesign.display import AbstractDisplay, Summary, number


@validate_arguments
@dataclass(frozen=True)
class PathCertificate:
    """Numbers from which `check_path_bound` proves a bound without a solver; all of them plain, so that a file can hold them.

    Without multipliers the bound is the cap, what no path changes; with lengths that of sensors as good as the relaxation takes them for.
    """

    level: float = 0.0
    """Where the quadratic form of every path ends, in units S."""
    share: float = 0.0
    """What of it is given to Young's inequality for what pieces leave out, in (0, 1)."""
    lengths: Sequence[int] = ()
    """Lengths (K,) of the pieces of the Gram matrix [steps]."""
    multipliers: Sequence[float] = ()
    """Of the constraints on that matrix, in their order (m,)."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "lengths", tuple(self.lengths))
        object.__setattr__(self, "multipliers", tuple(self.multipliers))


@dataclass(frozen=True)
class PathBound(AbstractDisplay):
    """An upper bound on the value of every path of a class, inf without one."""

    bound: float
    """No path of the class has a value above this, in the unit of the criterion."""
    certificate: PathCertificate | None
    """What proves it; None without a bound."""
    class_of_paths: str
    """Which paths the bound holds for, in words."""
    left_out: tuple[str, ...] = ()
    """What the bound does not make use of, so that it may be larger than it need be."""
    reason: str = ""
    """Why there is no bound, or none but the cap; "" where the relaxation gave it."""

    def _summary(self) -> Summary:
        rows = [("holds for", self.class_of_paths), ("leaves out", ", ".join(self.left_out) or "nothing")]
        if self.reason:
            rows.append(("reason", self.reason))
        return Summary(f"bound on every path: {number(self.bound)}", tuple(rows))
