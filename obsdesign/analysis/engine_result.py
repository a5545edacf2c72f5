"""What an engine found, before it is put into a verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from obsdesign.analysis.evaluation_point import EvaluationPoint
from obsdesign.analysis.rank_growth import RankGrowth
from obsdesign.rank.elimination import Rank
from obsdesign.rank.symbols import PRIME

StoppedBy = Literal["full", "criterion", "cap", "bound", "stalled", "precision"]
NEARLY_SINGULAR_PIVOT = 1e-8
"""A pivot below this, relative to the scale of its row and column, is called nearly singular."""


@dataclass(frozen=True, eq=False)
class EngineResult:
    """The rank in balls at a place, the dimensions step by step, and why it is no more (in words)."""

    rank: Rank
    point: EvaluationPoint
    ranks: tuple[int, ...]
    stopped_by: StoppedBy
    reason: str

    @property
    def dimension(self) -> int:
        """Dimension of the observable space, or what is proven of it."""
        return self.rank.rank

    @property
    def is_decided(self) -> bool:
        """Whether nothing is left open."""
        return self.stopped_by not in ("stalled", "precision")

    def proof(self, n: int) -> str:
        """Say what was proven and how."""
        caution = ", nearly singular or badly scaled" * (self.rank.smallest_pivot < NEARLY_SINGULAR_PIVOT)
        smallest = f"{self.rank.smallest_pivot:.1e}" if self.rank.smallest_pivot else "below 1e-307"
        pivots = f"pivots down to {smallest}{caution}"
        minor = f": a minor of the gradients excludes 0 in {self.rank.bits}-bit ball arithmetic ({pivots})" if self.dimension else ""
        return f"at least {self.dimension} of {n}{minor}; {self.reason}"


def with_start(result: EngineResult, names: Sequence[str]) -> EngineResult:
    """Return the finding for somebody who knows those states at the start: their unit covectors join what the outputs tell, once."""
    if not names or result.dimension == len(result.rank.is_determined):
        return result
    joint, what = result.rank.with_start, f"with {', '.join(names)} known at the start"
    if joint is None:
        reason = f"not decided: {what} it was not counted; without, {result.reason}"
        return replace(result, stopped_by="stalled", reason=reason)
    ranks = (*result.ranks, joint.rank) if joint.rank > result.ranks[-1] else result.ranks
    reason = f"{result.reason}; {what} {joint.rank - result.dimension} more"
    if joint.rank == len(joint.is_determined):
        return replace(result, rank=joint, ranks=ranks, stopped_by="full", reason=f"no more is possible, {what}")
    if result.is_decided and not joint.is_decided:
        return replace(result, rank=joint, ranks=ranks, stopped_by="precision", reason=f"{precision_text(joint)}, {what}")
    return replace(result, rank=joint, ranks=ranks, reason=reason)


def growth_result(growth: RankGrowth, cap: int | None = None) -> EngineResult:
    """Return what a growth to its end says; cap: the most it can be, the dimension for somebody who knows the unknown inputs."""
    lower, n = growth.rank.rank, growth.rank.null_space.shape[0]
    if lower == n:
        stopped_by, why = "full", "no more is possible"
    elif lower == cap:
        stopped_by, why = "cap", "no more is possible: it is as much if the inputs are known"
    elif not growth.is_decided:
        stopped_by, why = "precision", f"{precision_text(growth.rank)}, and at most {growth.dimension} {zero_test_text(growth.is_rational)}"
    else:
        stopped_by, why = "criterion", f"no more: derivatives of order {growth.order} add nothing {zero_test_text(growth.is_rational)}"
    ranks = (
        growth.dimensions if growth.dimension == lower else (*(dimension for dimension in growth.dimensions if dimension < lower), lower)
    )
    return EngineResult(growth.rank, growth.point, cut_after_growth(ranks), stopped_by, why)


def zero_test_text(is_rational: bool) -> str:
    """Say how nothing was found to be nothing."""
    symbols = "" if is_rational else ", with symbols for all functions that are not rational"
    return f"modulo {PRIME} at a random point{symbols}"


def precision_text(rank: Rank) -> str:
    """Say that the precision limit was reached."""
    return f"not decided: {rank.bits} bits do not tell the rest from 0"


def cut_after_growth(ranks: Sequence[int]) -> tuple[int, ...]:
    """Return the ranks up to the last growth."""
    return tuple(ranks[: list(ranks).index(ranks[-1]) + 1])
