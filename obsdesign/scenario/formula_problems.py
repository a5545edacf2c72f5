"""What is wrong with the formulas of the table [system]: what they contain, and their units."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from obsdesign.dynamics.system_text import exact_number
from obsdesign.formulas.casadi_value import value_of
from obsdesign.formulas.constants import dependence_order, entry_problems, problems_of_constants
from obsdesign.formulas.functions import PI, RESERVED
from obsdesign.formulas.grammar import parse_formula
from obsdesign.formulas.tree import AbstractTree, FormulaError, FormulaProblem, Name, names_of, nodes_of
from obsdesign.formulas.unit_algebra import RADIAN, Unit, define_unit, read_unit
from obsdesign.formulas.unit_check import Wanted, measure
from obsdesign.scenario.problem_text import Location, Problem, nearest_word
from obsdesign.scenario.system_tables import SystemTable

SYSTEM = "system"
"""The key of the table."""
QUANTITIES = ("states", "constants", "inputs", "unknown")
"""Keys of names with units."""
NAMED = (*QUANTITIES, "parameters", "landmarks", "definitions")
"""Keys of names that formulas may contain."""
_LISTED = 40  # names that are accepted, in a message
# what people write for things that have no name of their own
_HINTS = {"t": "time is a state whose rate is 1", "time": "time is a state whose rate is 1", "e": "e is exp(1)"}


def problem_at(location: Location, text: str, problem: FormulaProblem) -> Problem:
    """Return a problem of a formula, or of a unit, that stands at a place of the table."""
    return Problem((SYSTEM, *location), problem.told(text), problem.accepted, problem.nearest)


@dataclass(frozen=True)
class FormulaCheck:
    """The formulas of a table whose names are right."""

    table: SystemTable

    def problems(self) -> Iterator[Problem]:
        """Yield what is wrong with the formulas."""
        for location, text in self._formulas():
            yield from (problem_at(location, text, problem) for problem in self._problems_of(text))
        try:
            order = dependence_order(self._definitions)
        except FormulaError as error:
            yield Problem((SYSTEM, "definitions"), error.problem.message)
            return
        yield from self._output_dependence()
        yield from self._spread_problems()
        yield from self._unit_problems(order)

    def _formulas(self) -> Iterator[tuple[Location, str]]:
        """Where formulas stand, and which."""
        table = self.table
        for key in ("definitions", "rates", "next_state"):
            yield from (((key, name), text) for name, text in getattr(table, key).items())
        for name, output in table.outputs.items():
            yield from ((("outputs", name, "of", i), text) for i, text in enumerate(output.of))
            if isinstance(output.sigma, str):
                yield ("outputs", name, "sigma"), output.sigma

    @cached_property
    def _definitions(self) -> dict[str, AbstractTree]:
        """Those that can be read."""
        trees = {name: _tree_of(text) for name, text in self.table.definitions.items()}
        return {name: tree for name, tree in trees.items() if tree is not None}

    @cached_property
    def _names(self) -> dict[str, str]:
        """Every name that formulas may contain, and the table where it stands."""
        return {name: key for key in NAMED for name in getattr(self.table, key)}

    @cached_property
    def _constants(self) -> dict[str, Any]:
        points = {name: tuple(exact_number(value) for value in item.at) for name, item in self.table.landmarks.items()}
        return {**{name: exact_number(item.value) for name, item in self.table.parameters.items()}, **points}

    def _problems_of(self, text: str) -> list[FormulaProblem]:
        try:
            tree = parse_formula(text)
        except FormulaError as error:
            return [error.problem]
        unknown = list(self._unknown_names(tree))
        entries = list(entry_problems(tree, {name: len(item.at) for name, item in self.table.landmarks.items()}))
        return unknown or entries or list(problems_of_constants(tree, self._constants))

    def _unknown_names(self, tree: AbstractTree) -> Iterator[FormulaProblem]:
        for node in nodes_of(tree):
            if isinstance(node, Name) and node.name not in self._names and node.name != PI:
                yield _unknown_name(node, tuple(self._names))

    def _is_right(self, tree: AbstractTree | None) -> bool:
        """Whether a formula can be read, and all its names are known."""
        return tree is not None and all(name in self._names or name == PI for name in names_of(tree))

    def _output_dependence(self) -> Iterator[Problem]:
        """Outputs that no state is part of, or an unknown input is."""
        states = {*self.table.states, *self.table.constants}
        for name, output in self.table.outputs.items():
            trees = [tree for text in output.of if (tree := _tree_of(text)) is not None]
            if len(trees) < len(output.of) or not all(map(self._is_right, trees)):
                continue
            names = self._closure(trees)
            if not states & names:
                yield Problem((SYSTEM, "outputs", name), f"is {', '.join(output.of)}: contains no state, and tells nothing")
            for unknown in (unknown for unknown in self.table.unknown if unknown in names):
                message = f"contains the unknown input {unknown!r}: make it a state, whose rate is unknown"
                yield Problem((SYSTEM, "outputs", name), message)

    def _spread_problems(self) -> Iterator[Problem]:
        """Standard deviations of numbers alone that are not greater than 0."""
        for name, output in self.table.outputs.items():
            if not isinstance(output.sigma, str) or self._problems_of(output.sigma):
                continue
            tree = parse_formula(output.sigma)
            if {PI, *self._constants} >= set(names_of(tree)) and value_of(tree, self._constants) <= 0:
                yield Problem((SYSTEM, "outputs", name, "sigma"), f"is {output.sigma!r}: must be greater than 0")

    def _closure(self, trees: Sequence[AbstractTree]) -> set[str]:
        """The names in formulas, and in the definitions that they contain."""
        stack = [name for tree in trees for name in names_of(tree)]
        seen: set[str] = set()
        while stack:
            name = stack.pop()
            if name not in seen:
                seen.add(name)
                stack += names_of(self._definitions[name]) if name in self._definitions else ()
        return seen

    def _unit_problems(self, order: Sequence[str]) -> Iterator[Problem]:
        units = self._units()
        for name in order:
            yield from self._judge(("definitions", name), self.table.definitions[name], units, None)
            tree = self._definitions[name]
            units[name] = measure(tree, units).unit if self._is_right(tree) else None
        time = self._unit(self.table.time)
        for name, text in self.table.rates.items():
            unit = units.get(name)
            wanted = None if unit is None or time is None else Wanted(unit / time, f"the unit of {name} per {self.table.time}")
            yield from self._judge(("rates", name), text, units, wanted)
        for name, text in self.table.next_state.items():
            unit = units.get(name)
            yield from self._judge(("next_state", name), text, units, None if unit is None else Wanted(unit, f"the unit of {name}"))
        yield from self._output_units(units)

    def _output_units(self, units: Mapping[str, Unit | None]) -> Iterator[Problem]:
        angles = self.table.angles or ()
        for name in {*angles} & {*self.table.states, *self.table.constants}:
            yield from self._judge(("angles",), name, units, Wanted(RADIAN, "as an angle is"))
        for name, output in self.table.outputs.items():
            unit = self._unit(output.unit)
            wanted = (
                Wanted(unit, f"the unit of {name}") if unit is not None else Wanted(RADIAN, "as an angle is") if name in angles else None
            )
            for i, text in enumerate(output.of):
                yield from self._judge(("outputs", name, "of", i), text, units, wanted)
            tree = _tree_of(output.of[0])
            if isinstance(output.sigma, str) and self._is_right(tree) and tree is not None:
                of_output = unit or measure(tree, units).unit
                spread = None if of_output is None else Wanted(of_output, f"the unit of {name}")
                yield from self._judge(("outputs", name, "sigma"), output.sigma, units, spread)

    def _judge(self, location: Location, text: str, units: Mapping[str, Unit | None], wanted: Wanted | None) -> Iterator[Problem]:
        tree = _tree_of(text)
        if self._is_right(tree) and tree is not None:
            yield from (problem_at(location, text, problem) for problem in measure(tree, units, wanted).problems)

    @cached_property
    def _user_units(self) -> dict[str, Unit]:
        units: dict[str, Unit] = {}
        for name, text in self.table.units.items():
            with suppress(FormulaError):  # told where units are looked at
                units[name] = define_unit(name, text, units)
        return units

    def _units(self) -> dict[str, Unit | None]:
        """The units of all names but definitions."""
        texts = {name: text for key in QUANTITIES for name, text in getattr(self.table, key).items()}
        texts |= {name: item.unit for key in ("parameters", "landmarks") for name, item in getattr(self.table, key).items()}
        return {name: self._unit(text) for name, text in texts.items()}

    def _unit(self, text: str) -> Unit | None:
        """The unit of a text; None where there is none, or one that cannot be read."""
        try:
            return read_unit(text, self._user_units) if text else None
        except FormulaError:
            return None


def _tree_of(text: str) -> AbstractTree | None:
    try:
        return parse_formula(text)
    except FormulaError:
        return None


def _unknown_name(node: Name, accepted: tuple[str, ...]) -> FormulaProblem:
    if node.name in RESERVED:
        return FormulaProblem(node.column, f"{node.name} is a function: write {node.name}(...)")
    hint, nearest = nearest_word(node.name, accepted)
    if nearest is None and node.name in _HINTS:
        hint = f"; {_HINTS[node.name]}"
    listed = ", ".join(accepted[:_LISTED]) + (", ..." if len(accepted) > _LISTED else "")
    return FormulaProblem(node.column, f"there is no {node.name!r}{hint} (accepted: {listed})", accepted, nearest)
