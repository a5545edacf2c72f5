"""What depends on how the numbers given are read: a verdict that does is not decided, or says so."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

from obsdesign.analysis.engine_result import NEARLY_SINGULAR, Finding
from obsdesign.analysis.equations import Equations, meant, typed
from obsdesign.analysis.evaluation_point import Place
from obsdesign.analysis.rank_within_rounding import neighbour_within, rounded_constants, rounded_states
from obsdesign.analysis.verdict import Verdict
from obsdesign.rank.exact_numbers import Irrational, Meaning, Number


@dataclass(frozen=True, eq=False)
class Answer:
    """What was found about the equations at a place, which is none where generic states were asked about; and nearby."""

    equations: Equations
    place: Place | None
    finding: Finding
    nearby: Finding | None


class AbstractQuestion(ABC):
    """What is asked, but for the point and for how the model's numbers are read."""

    @abstractmethod
    def answer(self, place: Place | None, meaning: Callable[[float], Meaning]) -> Answer:
        """Return what is found at the place, or at generic states; meaning: what a constant of the model stands for."""

    @abstractmethod
    def worded(self, answer: Answer) -> Verdict:
        """Return the verdict."""


def with_doubts(question: AbstractQuestion, place: Place | None, at: Sequence[float], seed: int) -> Verdict:
    """Return the verdict; what it says holds however the constants of the model are read, or is not decided.

    at (n,): the place as it was given, if one was. A constant of more than 12 digits may be the rounded product of shorter ones. Where
    the rank is n with what was meant, by pivots that no rounding reaches, it is n. Otherwise the constants are taken as they stand, too;
    and where the rank is another at a point within rounding, that is said of the states, and not decided for constants.
    """
    found = question.answer(place, meant)
    verdict, doubtful = question.worded(found), [(value, number) for value, number in found.equations.read if typed(value) != number]
    if doubtful and not (verdict.observable and found.finding.rank.smallest_pivot > NEARLY_SINGULAR):
        verdict = _agreed(verdict, question.worded(question.answer(place, typed)), doubtful)
    return verdict if verdict.stopped_by == "precision" else _within_rounding(question, found, verdict, at, seed)


def _within_rounding(question: AbstractQuestion, found: Answer, verdict: Verdict, at: Sequence[float], seed: int) -> Verdict:
    """Return the verdict with what is seen at a point within rounding, where that is another dimension."""
    numbers = [*rounded_constants(found.equations), *rounded_states(at)]
    if not numbers:
        return verdict
    finding, n = found.finding, verdict.null_space.shape[0]
    neighbour = neighbour_within(found.equations, found.place or finding.place, numbers, finding.dimension, len(finding.ranks) - 1, seed)
    if neighbour is None:
        return verdict
    words = f"within the rounding of the numbers given it is {neighbour.rank.rank} of {n}"
    if not neighbour.by_constants:
        return replace(verdict, proof=f"{verdict.proof}; {words}")
    lower = min(finding.rank, neighbour.rank, key=lambda rank: rank.rank)
    undecided = replace(
        finding, rank=lower, stopped_by="precision", at_most=f"not decided: as they stand it is {finding.dimension}, {words}"
    )
    return question.worded(replace(found, finding=undecided))


def _agreed(first: Verdict, second: Verdict, doubtful: Iterable[tuple[float, Meaning]]) -> Verdict:
    """Return what two readings of the doubtful numbers have in common; first: as they were meant, second: as they stand."""
    if first.dimension == second.dimension:
        return first
    lower = min(first, second, key=lambda verdict: verdict.dimension)
    n = lower.null_space.shape[0]
    readings = ", ".join(f"{value!r} as {number}" for value, number in doubtful)
    which = (
        f"the dimension depends on how numbers are read that may be rounded: with {readings} it is {first.dimension} of {n}, "
        f"as they stand {second.dimension}"
    )
    return replace(
        lower,
        decided=False,
        stopped_by="precision",
        hidden=f"not decided, not seen so far: {lower.hidden.removeprefix('not decided, not seen so far: ')}",
        proof=f"at least {lower.dimension} of {n}; not decided: {which}",
    )


def as_read(numbers: Iterable[tuple[float | str, Number]]) -> str:
    """Say which numbers, constants or states by name, were taken for multiples of pi and roots."""
    said = [f"{what} as {number}" for what, number in numbers if isinstance(number, Irrational)]
    return f"; exact values: {', '.join(said)}" if said else ""
