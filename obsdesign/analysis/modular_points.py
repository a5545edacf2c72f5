"""Where ranks are bounded from above: states modulo the prime, with symbols for the functions that are not rational."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from obsdesign.analysis.equations import Equations
from obsdesign.analysis.evaluation_point import EvaluationPoint, random_residues
from obsdesign.rank.exact_numbers import Number, as_residue
from obsdesign.rank.graph import Instruction, evaluate, instructions, supports_of
from obsdesign.rank.residues import modular_arithmetic
from obsdesign.rank.symbol_relations import symbols_at
from obsdesign.rank.symbols import NoSquareError, Symbols

_DRAWS = 4096
"""So many states are tried until every root exists: half of all numbers have one."""


def random_modular_point(equations: Equations, seed: int | str) -> EvaluationPoint:
    """Return a random state modulo the prime.

    Roots are taken in turn: where one does not exist, an entry that it depends on is drawn anew, and kept if the roots before still
    exist. Where some root never exists, roots become symbols of which only the derivative is known: a rank may come out larger.
    """
    n = equations.n
    if equations.is_rational:
        return EvaluationPoint(tuple(random_residues(n, seed)), Symbols())
    steps, constants = instructions(equations.all_expressions), [as_residue(value) for value in equations.values]
    supports = supports_of(steps)
    state = best = random_residues(n, f"{seed}")
    furthest = -1
    for attempt in range(_DRAWS):
        try:
            nonresidues = _first_root_missing(steps, [[as_residue(value) for value in state], constants])
        except ZeroDivisionError:
            state, furthest = random_residues(n, f"{seed} {attempt}"), -1
            best = state
            continue
        if nonresidues is None:
            return EvaluationPoint(tuple(state), symbols_at(equations.symbols_used, state, equations.values, has_free_roots=False))
        if not supports[nonresidues]:  # a constant: no state changes it
            break
        if nonresidues >= furthest:
            best, furthest = state, nonresidues
        state = _redraw_entry(best, sorted(supports[furthest]), f"{seed} {attempt}")
    return _point_with_free_roots(equations, random_residues(n, f"{seed}"))


def _first_root_missing(steps: Sequence[Instruction], arguments: Sequence[Sequence[Any]]) -> int | None:
    """Return the first step that asks for a root that does not exist; None where all do. Raises ZeroDivisionError at a pole."""
    passed: list[Instruction] = []

    def record_steps() -> Iterator[Instruction]:
        """Yield the steps, and keep those that were begun."""
        for step in steps:
            passed.append(step)
            yield step

    try:
        evaluate(record_steps(), arguments, modular_arithmetic(Symbols()))
    except NoSquareError:
        return len(passed) - 1
    return None


def _redraw_entry(state: Sequence[int], entries: Sequence[int], seed: str) -> list[int]:
    """Return the state with one of the entries drawn anew."""
    value, choice = random_residues(2, seed)
    chosen = entries[choice % len(entries)]
    return [value if i == chosen else entry for i, entry in enumerate(state)]


def modular_point(equations: Equations, state: Sequence[Number]) -> EvaluationPoint:
    """Return a state (n,) of exact numbers modulo the prime."""
    numbers = [int(as_residue(value)) for value in state]
    if equations.is_rational:
        return EvaluationPoint(tuple(numbers), Symbols())
    try:
        symbols = symbols_at(equations.symbols_used, numbers, equations.values, has_free_roots=False)
        evaluate(instructions(equations.all_expressions), _arguments(equations, numbers), modular_arithmetic(symbols))
    except NoSquareError:
        return _point_with_free_roots(equations, numbers)
    return EvaluationPoint(tuple(numbers), symbols)


def _arguments(equations: Equations, state: Sequence[int]) -> list[list]:
    return [[as_residue(value) for value in group] for group in (state, equations.values)]


def _point_with_free_roots(equations: Equations, state: Sequence[int]) -> EvaluationPoint:
    return EvaluationPoint(tuple(state), symbols_at(equations.symbols_used, state, equations.values, has_free_roots=True))
