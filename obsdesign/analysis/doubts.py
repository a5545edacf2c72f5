"""What depends on how the numbers given are read: a verdict that does is not decided, or says so."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

from obsdesign.analysis.equations import Equations, meant, typed
from obsdesign.analysis.finding import NEARLY_SINGULAR
from obsdesign.analysis.places import Place
from obsdesign.analysis.verdict import Verdict
from obsdesign.rank.numbers import Irrational, Meaning, Number


@dataclass(frozen=True, eq=False)
class Answer:
    """A verdict, the equations that it is about, and the smallest pivot that it rests on, in units of its row and column."""

    verdict: Verdict
    equations: Equations
    smallest_pivot: float


Ask = Callable[[Place | None, Callable[[float], Meaning]], Answer]


def with_doubts(ask: Ask, place: Place | None) -> Verdict:
    """Return the verdict; what it says holds however the constants of the model are read, or is not decided.

    A constant of more than 12 digits may be the rounded product of shorter ones. Where the rank is n with what was meant, by pivots
    that no rounding reaches, it is n. Otherwise the constants are taken as they stand, too.
    """
    found = ask(place, meant)
    verdict, doubtful = found.verdict, [(value, number) for value, number in found.equations.read if typed(value) != number]
    if doubtful and not (verdict.observable and found.smallest_pivot > NEARLY_SINGULAR):
        verdict = _agreed(verdict, ask(place, typed).verdict, doubtful)
    return verdict


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
