"""A system as text: names with their units, formulas of rates and outputs; nothing is evaluated here."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property

from obsdesign.formulas.casadi_value import Value
from obsdesign.formulas.constants import dependence_order
from obsdesign.formulas.grammar import parse_formula
from obsdesign.formulas.tree import AbstractTree, names_of
from obsdesign.formulas.unit_algebra import Unit, define_unit, read_unit
from obsdesign.formulas.unit_check import measure
from obsdesign.signals import Point, Signal


@dataclass(frozen=True)
class TextQuantity:
    """A name and the unit of what it stands for, "" where nobody said: then it fits everywhere."""

    name: str
    unit: str = ""

    def __str__(self) -> str:
        return f"{self.name} [{self.unit}]" if self.unit else self.name


@dataclass(frozen=True)
class TextParameter:
    """A number with a name, in its unit."""

    name: str
    value: float
    unit: str = ""


@dataclass(frozen=True)
class TextLandmark:
    """A point with a name, in its unit: two coordinates, or three."""

    name: str
    at: tuple[float, ...]
    unit: str = "m"


@dataclass(frozen=True)
class TextOutput:
    """One sensor: the formulas of what it measures, and of its errors what `OutputNoise` says; sigma may be a formula, too."""

    name: str
    formulas: tuple[str, ...]
    unit: str = ""
    sigma: float | tuple[float, ...] | str = 1.0
    rate: float | None = None
    inflation: float = 1.0
    bias_floor: float = 0.0
    correlation: float = 0.0
    detection: float = 1.0

    @property
    def entries(self) -> tuple[tuple[str, str], ...]:
        """Names of the numbers that it measures, and their formulas."""
        names = (self.name,) if len(self.formulas) == 1 else tuple(f"{self.name}_{i + 1}" for i in range(len(self.formulas)))
        return tuple(zip(names, self.formulas, strict=True))

    def __str__(self) -> str:
        sigmas = self.sigma if isinstance(self.sigma, tuple) else (self.sigma,)
        spread = " ".join(sigma if isinstance(sigma, str) else f"{sigma:g}" for sigma in sigmas)
        rate = f", {self.rate:g} Hz" if self.rate is not None else ""
        return f"{', '.join(self.formulas)} (sigma {spread}{f' {self.unit}' if self.unit else ''}{rate})"


@dataclass(frozen=True)
class SystemText:
    """What a system is, as somebody typed it: xdot_i = rates_i, or x_i a period later, and y = outputs.

    Formulas contain states, inputs, parameters, entries of landmarks and definitions. That they do, and that their units fit, is looked at
    where it is read.
    """

    states: tuple[TextQuantity, ...]
    """The n states."""
    rates: tuple[str, ...]
    """The formula of each state's rate, in its unit per `time`; with a period of its next value."""
    inputs: tuple[TextQuantity, ...] = ()
    unknown: tuple[TextQuantity, ...] = ()
    parameters: tuple[TextParameter, ...] = ()
    landmarks: tuple[TextLandmark, ...] = ()
    definitions: tuple[tuple[str, str], ...] = ()
    """Names of formulas that others contain."""
    outputs: tuple[TextOutput, ...] = ()
    angles: tuple[str, ...] | None = None
    """Names of states and outputs that wrap to (-pi, pi] [rad]; None = those that are in rad."""
    user_units: tuple[tuple[str, str], ...] = ()
    """Names of units that are in no table, and what they are in others; "" = a thing that is counted."""
    time: str = "s"
    """The unit of time of the rates and the period."""
    period: float | None = None
    """Length of a step of a system that is a map from one instant to the next, in `time`; None where time is continuous."""

    def only(self, sensors: tuple[str, ...]) -> SystemText:
        """Return the text with the named outputs alone."""
        return replace(self, outputs=tuple(output for output in self.outputs if output.name in sensors))

    @cached_property
    def formulas(self) -> dict[str, AbstractTree]:
        """The definitions, by name, each behind those that it needs."""
        trees = {name: parse_formula(text) for name, text in self.definitions}
        return {name: trees[name] for name in dependence_order(trees)}

    @cached_property
    def units(self) -> dict[str, Unit | None]:
        """The unit of every name, None where it is not known."""
        user_units = self.units_by_name
        named = [(item.name, item.unit) for item in (*self.states, *self.inputs, *self.unknown, *self.parameters, *self.landmarks)]
        units = {name: read_unit(text, user_units) if text else None for name, text in named}
        for name, tree in self.formulas.items():
            units[name] = measure(tree, units).unit
        return units

    @cached_property
    def units_by_name(self) -> dict[str, Unit]:
        """The units that are in no table."""
        units: dict[str, Unit] = {}
        for name, text in self.user_units:
            units[name] = define_unit(name, text, units)
        return units

    @property
    def constants(self) -> dict[str, Value | tuple[Value, ...]]:
        """What names stand for that do not change: parameters as they were typed, landmarks entry by entry."""
        points = {landmark.name: tuple(exact_number(value) for value in landmark.at) for landmark in self.landmarks}
        return {**{parameter.name: exact_number(parameter.value) for parameter in self.parameters}, **points}

    @property
    def seconds(self) -> Fraction:
        """How many seconds the unit of time is."""
        return Fraction(f"{math.exp(read_unit(self.time, self.units_by_name).log_size):.12g}")

    @cached_property
    def angle_names(self) -> tuple[str, ...]:
        """Names of the states and outputs that wrap."""
        if self.angles is not None:
            names = {*(state.name for state in self.states), *(output.name for output in self.outputs)}
            names |= {entry for output in self.outputs for entry, _ in output.entries}
            return tuple(name for name in self.angles if name in names)  # some outputs may be left out
        outputs = ((entry, self.unit_of(output, text)) for output in self.outputs for entry, text in output.entries)
        pairs = ((state.name, state.unit) for state in self.states)
        return tuple(dict.fromkeys(name for name, unit in (*pairs, *outputs) if unit == "rad"))

    @property
    def state_signals(self) -> tuple[Signal, ...]:
        """The n states."""
        return self._signals(self.states)

    @property
    def input_signals(self) -> tuple[Signal, ...]:
        """The known inputs."""
        return self._signals(self.inputs)

    @property
    def unknown_signals(self) -> tuple[Signal, ...]:
        """The unknown inputs."""
        return self._signals(self.unknown)

    def _signals(self, quantities: tuple[TextQuantity, ...]) -> tuple[Signal, ...]:
        """Signals of states and inputs: no formula is read for them."""
        angles = [quantity.name for quantity in self.states if quantity.unit == "rad"] if self.angles is None else self.angles
        return tuple(Signal(quantity.name, quantity.unit, quantity.name in angles) for quantity in quantities)

    def unit_of(self, output: TextOutput, formula: str) -> str:
        """Return the unit of one formula of an output: the one that was given, else its own, "" where there is none."""
        if output.unit:
            return output.unit
        unit = measure(parse_formula(formula), self.units).unit
        return str(unit) if unit is not None and unit.powers else ""

    def points_of(self, output: TextOutput) -> tuple[Point, ...]:
        """Return the landmarks in the plane that an output contains."""
        names = {name for text in output.formulas for name in self._names_in(text)}
        return tuple((float(point.at[0]), float(point.at[1])) for point in self.landmarks if point.name in names and len(point.at) == 2)

    def _names_in(self, text: str) -> Iterator[str]:
        """Names that a formula contains, itself or in a definition."""
        stack, seen = list(names_of(parse_formula(text))), set()
        while stack:
            name = stack.pop()
            if name not in seen:
                seen.add(name)
                yield name
                stack += names_of(self.formulas[name]) if name in self.formulas else ()


def exact_number(value: float) -> Fraction:
    """Return the decimal that a number was typed as."""
    return Fraction(repr(float(value)))
