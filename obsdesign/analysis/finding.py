"""What an engine found, before it is put into a verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from obsdesign.analysis.growth import Growth
from obsdesign.analysis.places import Place
from obsdesign.rank.balls import PRECISIONS
from obsdesign.rank.elimination import Rank
from obsdesign.rank.symbols import PRIME

StoppedBy = Literal["full", "criterion", "cap", "bound", "stalled", "precision"]
NEARLY_SINGULAR = 1e-8
"""A pivot below this, relative to the scale of its row and column, is called nearly singular."""


@dataclass(frozen=True, eq=False)
class Finding:
    """The rank in balls at a place, the dimensions step by step, and why it is no more (in words)."""

    rank: Rank
    place: Place
    ranks: tuple[int, ...]
    stopped_by: StoppedBy
    at_most: str

    @property
    def dimension(self) -> int:
        """Dimension of the observable space, or what is proven of it."""
        return self.rank.rank

    @property
    def decided(self) -> bool:
        """Whether nothing is left open."""
        return self.stopped_by not in ("stalled", "precision")

    def proof(self, n: int) -> str:
        """Say what was proven and how."""
        caution = ", nearly singular or badly scaled" * (self.rank.smallest_pivot < NEARLY_SINGULAR)
        pivots = f"pivots down to {self.rank.smallest_pivot:.1e}{caution}"
        minor = f": a minor of the gradients excludes 0 in {self.rank.bits}-bit ball arithmetic ({pivots})" if self.dimension else ""
        return f"at least {self.dimension} of {n}{minor}; {self.at_most}"


def finding_of(growth: Growth, cap: int | None = None) -> Finding:
    """Return what a growth to its end says; cap: the dimension for somebody who knows the unknown inputs."""
    if growth.rank.null_space.shape[1] == 0:
        stopped_by, why = "full", "no more is possible"
    elif not growth.decided:
        stopped_by, why = "precision", precision_reached()
    elif growth.dimension == cap:
        stopped_by, why = "cap", "no more is possible: it is as much if the inputs are known"
    else:
        stopped_by, why = "criterion", f"no more: derivatives of order {growth.order} add nothing {_how(growth)}"
    return Finding(growth.rank, growth.place, cut(growth.dimensions), stopped_by, why)


def _how(growth: Growth) -> str:
    """Say how nothing was found to be nothing."""
    if growth.modular:
        return f"modulo {PRIME} at a random point"
    return thin_balls(growth.rank)


def thin_balls(rank: Rank) -> str:
    """Say what was left that counts as 0."""
    return f"but balls around 0 thinner than 2^-{rank.bits // 2}"


def precision_reached() -> str:
    """Say that the precision limit was reached."""
    return f"not decided: {PRECISIONS[-1]} bits do not tell the rest from 0"


def cut(ranks: Sequence[int]) -> tuple[int, ...]:
    """Return the ranks up to the last growth."""
    return tuple(ranks[: list(ranks).index(ranks[-1]) + 1])
