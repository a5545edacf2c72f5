"""What depends on how the numbers given are read: a verdict that does is not decided, or says so."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

from obsdesign.analysis.engine_result import NEARLY_SINGULAR_PIVOT, EngineResult
from obsdesign.analysis.equations import Equations
from obsdesign.analysis.evaluation_point import EvaluationPoint
from obsdesign.analysis.experiments import Experiments
from obsdesign.analysis.model_equations import likely_value, literal_value
from obsdesign.analysis.rank_within_rounding import constants_within_rounding, neighbour_within_rounding, states_within_rounding
from obsdesign.analysis.verdict import Verdict
from obsdesign.rank.exact_numbers import ExactNumber, Irrational, Number


@dataclass(frozen=True, eq=False)
class QueryResult:
    """What was found about the equations at a place, which is none where generic states were asked about; and nearby."""

    equations: Equations
    point: EvaluationPoint | None
    result: EngineResult
    nearby: EngineResult | None


class AbstractQuery(ABC):
    """What is asked, but for the point and for how the model's numbers are read."""

    @property
    @abstractmethod
    def is_smooth(self) -> bool:
        """Whether the known inputs are one smooth signal."""

    @abstractmethod
    def analyse(self, point: EvaluationPoint | None, reading: Callable[[float], ExactNumber]) -> QueryResult:
        """Return what is found at the place, or at generic states; reading: what a constant of the model stands for."""

    @abstractmethod
    def verdict(self, query_result: QueryResult) -> Verdict:
        """Return the verdict."""


def verdict_over_readings(query: AbstractQuery, point: EvaluationPoint | None, at: Sequence[float], seed: int) -> Verdict:
    """Return the verdict; what it says holds however the constants of the model are read, or is not decided.

    at (n,): the place as it was given, if one was. A constant of more than 12 digits may be the rounded product of shorter ones. Where
    the rank is n with what was meant, by pivots that no rounding reaches, it is n. Otherwise the constants are taken as they stand, too;
    and where the rank is another at a point within rounding, that is said of the states, and not decided for constants.
    """
    query_result = query.analyse(point, likely_value)
    verdict, doubtful = (
        query.verdict(query_result),
        [(value, number) for value, number in query_result.equations.readings if literal_value(value) != number],
    )
    if doubtful and not (verdict.observable and query_result.result.rank.smallest_pivot > NEARLY_SINGULAR_PIVOT):
        verdict = _common_verdict(verdict, query.verdict(query.analyse(point, literal_value)), doubtful)
    return verdict if verdict.stopped_by == "precision" else _check_neighbours(query, query_result, verdict, at, seed)


def _check_neighbours(query: AbstractQuery, query_result: QueryResult, verdict: Verdict, at: Sequence[float], seed: int) -> Verdict:
    """Return the verdict with what is seen at a point within rounding, where that is another dimension."""
    first = query_result.equations.n_added
    numbers = [*constants_within_rounding(query_result.equations), *(number.behind(first) for number in states_within_rounding(at))]
    if not numbers:
        return verdict
    result, n = query_result.result, verdict.null_space.shape[0]
    place, order = query_result.point or result.point, len(result.ranks) - 1
    count = 2 if query_result.equations.known_fields and not query.is_smooth else 1
    experiments = Experiments(query_result.equations, place, order, count, seed)
    neighbour = neighbour_within_rounding(experiments, numbers, result.dimension)
    if neighbour is None:
        return verdict
    where, what = "within the rounding of the numbers given it", f"{neighbour.rank.rank} of {n}"
    if not neighbour.moves_constants:
        return replace(verdict, proof=f"{verdict.proof}; {where} is {what}")
    lower = min(result.rank, neighbour.rank, key=lambda rank: rank.rank)
    undecided = replace(
        result, rank=lower, stopped_by="precision", reason=f"not decided: as they stand it is {result.dimension}, {where} may be {what}"
    )
    return query.verdict(replace(query_result, result=undecided))


def _common_verdict(first: Verdict, second: Verdict, doubtful: Iterable[tuple[float, ExactNumber]]) -> Verdict:
    """Return what two readings of the doubtful numbers have in common; first: as they were meant, second: as they stand."""
    if first.dimension == second.dimension:
        return first
    lower = min(first, second, key=lambda verdict: verdict.dimension)
    n = lower.null_space.shape[0]
    readings = ", ".join(f"{value!r} as {number}" for value, number in doubtful)
    difference = (
        f"the dimension depends on how numbers are read that may be rounded: with {readings} it is {first.dimension} of {n}, "
        f"as they stand {second.dimension}"
    )
    return replace(
        lower,
        decided=False,
        stopped_by="precision",
        hidden=f"not decided, not seen so far: {lower.hidden.removeprefix('not decided, not seen so far: ')}",
        proof=f"not decided: {difference}",
    )


def readings_text(numbers: Iterable[tuple[float | str, Number]]) -> str:
    """Say which numbers, constants or states by name, were taken for multiples of pi and roots."""
    texts = [f"{name} as {number}" for name, number in numbers if isinstance(number, Irrational)]
    return f"; exact values: {', '.join(texts)}" if texts else ""
