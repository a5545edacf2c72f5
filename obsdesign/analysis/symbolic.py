"""Where ranks are bounded from above: states modulo the prime, with symbols for the functions that are not rational."""

from __future__ import annotations

from collections.abc import Sequence

from obsdesign.analysis.equations import Equations
from obsdesign.analysis.places import Place, random_residues
from obsdesign.rank.graph import evaluate, instructions
from obsdesign.rank.numbers import Number, as_residue
from obsdesign.rank.relations import symbols_at
from obsdesign.rank.residues import residues
from obsdesign.rank.symbols import NoSquareError, Symbols

_DRAWS = 4096
"""States are drawn until every root exists: half of all numbers have one, so this serves for a dozen roots."""


def residue_place(equations: Equations, seed: int | str) -> Place:
    """Return a random state modulo the prime.

    Where some root never exists, roots become symbols of which only the derivative is known: a rank may come out larger.
    """
    n = equations.n
    if equations.is_rational:
        return Place(tuple(random_residues(n, seed)), Symbols())
    steps, constants = instructions(equations.everything), [as_residue(value) for value in equations.values]
    failed: set[int] = set()
    for attempt in range(_DRAWS):
        state = random_residues(n, f"{seed} {attempt}")
        try:
            evaluate(steps, [[as_residue(value) for value in state], constants], residues(Symbols()))
        except NoSquareError as error:
            if error.number in failed:  # a constant: no state changes it
                break
            failed.add(error.number)
        except ZeroDivisionError:
            continue
        else:
            return Place(tuple(state), symbols_at(equations.symbols_used, state, equations.values, free=False))
    return _with_free_roots(equations, random_residues(n, f"{seed}"))


def residues_of(equations: Equations, state: Sequence[Number]) -> Place:
    """Return a state (n,) of exact numbers modulo the prime."""
    numbers = [int(as_residue(value)) for value in state]
    if equations.is_rational:
        return Place(tuple(numbers), Symbols())
    try:
        symbols = symbols_at(equations.symbols_used, numbers, equations.values, free=False)
        evaluate(instructions(equations.everything), _arguments(equations, numbers), residues(symbols))
    except NoSquareError:
        return _with_free_roots(equations, numbers)
    return Place(tuple(numbers), symbols)


def _arguments(equations: Equations, state: Sequence[int]) -> list[list]:
    return [[as_residue(value) for value in group] for group in (state, equations.values)]


def _with_free_roots(equations: Equations, state: Sequence[int]) -> Place:
    return Place(tuple(state), symbols_at(equations.symbols_used, state, equations.values, free=True))
