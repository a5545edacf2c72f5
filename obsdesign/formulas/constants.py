"""What a formula comes to before any state is known: parts of it that have no value, definitions in the order in which they are needed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from graphlib import CycleError, TopologicalSorter

from obsdesign.formulas.casadi_value import Values, value_of
from obsdesign.formulas.functions import PI
from obsdesign.formulas.tree import AbstractTree, FormulaError, FormulaProblem, Name, Product, names_of, nodes_of


def problems_of_constants(tree: AbstractTree, constants: Values) -> Iterator[FormulaProblem]:
    """Yield the parts of a formula that have no finite value whatever the state: 1/0, log(0). constants: what names stand for."""
    if _is_constant(tree, constants):
        try:
            value_of(tree, constants)
        except FormulaError as error:
            yield error.problem
        return
    for part in tree.parts:
        yield from problems_of_constants(part, constants)
    if isinstance(tree, Product):
        divisors = (factor for factor, divides in zip(tree.factors, tree.is_divisor, strict=True) if divides)
        yield from (FormulaProblem(divisor.column, "divides, and is 0") for divisor in divisors if _is_zero(divisor, constants))


def _is_constant(tree: AbstractTree, constants: Values) -> bool:
    return all(name in constants or name == PI for name in names_of(tree))


def _is_zero(tree: AbstractTree, constants: Values) -> bool:
    """Whether a part is constant, has a value, and that is 0."""
    try:
        return _is_constant(tree, constants) and value_of(tree, constants) == 0
    except FormulaError:
        return False


def entry_problems(tree: AbstractTree, entries: Mapping[str, int]) -> Iterator[FormulaProblem]:
    """Yield the names in a formula that are used as a landmark is, or the other way round; entries: how many each landmark has."""
    for node in nodes_of(tree):
        if not isinstance(node, Name):
            continue
        count = entries.get(node.name)
        if count is None and node.entry is not None:
            yield FormulaProblem(node.column, f"{node.name} has no entries: it is no landmark")
        elif count is not None and node.entry is None:
            yield FormulaProblem(node.column, f"{node.name} is a landmark: write {node.name}.x, {node.name}.y")
        elif count is not None and node.entry is not None and node.entry >= count:
            yield FormulaProblem(node.column, f"{node.name} has {count} entries: there is no entry {node.entry}, counted from 0")


def dependence_order(definitions: Mapping[str, AbstractTree]) -> tuple[str, ...]:
    """Return the names of definitions, each behind those that it needs. Raises FormulaError where some need one another."""
    needs = {name: [need for need in names_of(tree) if need in definitions] for name, tree in definitions.items()}
    try:
        return tuple(TopologicalSorter(needs).static_order())
    except CycleError as error:
        raise FormulaError(FormulaProblem(1, f"goes round in a circle: {' needs '.join(reversed(error.args[1]))}")) from None
