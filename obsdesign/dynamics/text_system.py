"""A system that is written as text: states, inputs, rates and outputs as formulas, with their units."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace
from fractions import Fraction
from functools import cached_property
from typing import TYPE_CHECKING

from obsdesign.display import Summary
from obsdesign.dynamics.control_affine import ControlAffineSystem
from obsdesign.dynamics.model import AbstractSystem, Model
from obsdesign.dynamics.output_noise import OutputNoise
from obsdesign.formulas.casadi_value import Value, casadi_value, value_of
from obsdesign.formulas.constants import dependence_order
from obsdesign.formulas.grammar import parse_formula
from obsdesign.formulas.tree import AbstractTree, names_of
from obsdesign.formulas.unit_algebra import Unit, define_unit, read_unit
from obsdesign.formulas.unit_check import measure
from obsdesign.signals import Signal

if TYPE_CHECKING:
    import casadi as ca

_SECOND = "s"


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
    bias_floor: float | tuple[float, ...] = 0.0
    correlation: float = 0.0
    detection: float = 1.0

    @property
    def entries(self) -> tuple[str, ...]:
        """Names of the numbers that it measures."""
        return (self.name,) if len(self.formulas) == 1 else tuple(f"{self.name}_{i + 1}" for i in range(len(self.formulas)))

    def __str__(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        spread = self.sigma if isinstance(self.sigma, str) else " ".join(f"{sigma:g}" for sigma in _as_tuple(self.sigma))
        rate = f", {self.rate:g} Hz" if self.rate is not None else ""
        return f"{', '.join(self.formulas)} (sigma {spread}{unit}{rate})"


def _as_tuple(value: float | tuple[float, ...]) -> tuple[float, ...]:
    return value if isinstance(value, tuple) else (value,)


@dataclass(frozen=True)
class TextSystem(AbstractSystem):
    """A system whose rates and outputs are formulas: xdot_i = rates_i, y = outputs.

    Formulas contain states, inputs, parameters, entries of landmarks and definitions; `find_system_problems` says what is wrong with them
    and with their units. Raises InputError for rates that are not affine in an input.
    """

    states: tuple[TextQuantity, ...]
    """The n states."""
    rates: tuple[str, ...]
    """The formula of each state's rate, in its unit per `time`."""
    inputs: tuple[TextQuantity, ...] = ()
    unknown: tuple[TextQuantity, ...] = ()
    parameters: tuple[TextParameter, ...] = ()
    landmarks: tuple[TextLandmark, ...] = ()
    definitions: tuple[tuple[str, str], ...] = ()
    """Names of formulas that others contain."""
    outputs: tuple[TextOutput, ...] = ()
    angles: tuple[str, ...] = ()
    """Names of states and outputs that wrap to (-pi, pi] [rad]."""
    user_units: tuple[tuple[str, str], ...] = ()
    """Names of units that are in no table, and what they are in others; "" = a thing that is counted."""
    time: str = _SECOND
    """The unit of time of the rates."""

    def only(self, sensors: tuple[str, ...]) -> TextSystem:
        """Return the system with the named sensors alone."""
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
    def constants(self) -> dict[str, Value]:
        """What names stand for that do not change: parameters as they were typed, landmarks entry by entry."""
        points = {landmark.name: tuple(exact_number(value) for value in landmark.at) for landmark in self.landmarks}
        return {**{parameter.name: exact_number(parameter.value) for parameter in self.parameters}, **points}

    @property
    def _seconds(self) -> Fraction:
        """How many seconds the unit of time is."""
        return Fraction(f"{math.exp(read_unit(self.time, self.units_by_name).log_size):.12g}")

    def _build(self) -> Model:
        model = self._affine().model
        angles = frozenset(self.angles)

        def signals(quantities: tuple[TextQuantity, ...]) -> tuple[Signal, ...]:
            """Return the quantities as signals."""
            return tuple(Signal(quantity.name, quantity.unit, quantity.name in angles) for quantity in quantities)

        pairs = zip(model.channels, self.outputs, strict=True)
        channels = tuple(replace(channel, outputs=self._with_units(channel.outputs, output)) for channel, output in pairs)
        return replace(
            model,
            states=signals(self.states),
            inputs=signals(self.inputs),
            unknown_inputs=signals(self.unknown),
            channels=channels,
        )

    def _affine(self) -> ControlAffineSystem:
        """The system of CasADi expressions."""
        import casadi as ca

        values, groups = dict(self.constants), []
        for quantities in (self.states, self.inputs, self.unknown):
            groups.append({quantity.name: ca.SX.sym(quantity.name) for quantity in quantities})
            values |= groups[-1]
        for name, tree in self.formulas.items():
            values[name] = value_of(tree, values)
        states, inputs, unknown_inputs = groups
        rate = _column(self.rates, values)
        return ControlAffineSystem.from_rate(
            ca.vertcat(*states.values()),
            tuple(states),
            rate if self._seconds == 1 else rate / float(self._seconds),
            inputs,
            unknown_inputs,
            outputs={output.name: _column(output.formulas, values) for output in self.outputs},
            angles=[
                name for name in self.angles if name in states or any(name in (output.name, *output.entries) for output in self.outputs)
            ],
            noises={output.name: self._noise(output, values) for output in self.outputs},
        )

    def _noise(self, output: TextOutput, values: Mapping[str, Value]) -> OutputNoise:
        sigma = casadi_value(parse_formula(output.sigma), values) if isinstance(output.sigma, str) else output.sigma
        seen = {name for text in output.formulas for name in self._names_in(text)}
        points = tuple((float(point.at[0]), float(point.at[1])) for point in self.landmarks if point.name in seen and len(point.at) == 2)
        return OutputNoise(
            sigma, None, output.rate, output.inflation, output.bias_floor, output.correlation, output.detection, landmarks=points
        )

    def _names_in(self, text: str) -> Iterator[str]:
        """Names that a formula contains, itself or in a definition."""
        stack, seen = list(names_of(parse_formula(text))), set()
        while stack:
            name = stack.pop()
            if name not in seen:
                seen.add(name)
                yield name
                stack += names_of(self.formulas[name]) if name in self.formulas else ()

    def _with_units(self, signals: tuple[Signal, ...], output: TextOutput) -> tuple[Signal, ...]:
        """The signals of an output with the unit that was given, else with that of each formula."""
        return tuple(
            replace(signal, unit=output.unit or self._unit_of(text)) for signal, text in zip(signals, output.formulas, strict=True)
        )

    def _unit_of(self, text: str) -> str:
        unit = measure(parse_formula(text), self.units).unit
        return str(unit) if unit is not None and unit.powers else ""

    def __reduce__(self) -> tuple[type[TextSystem], tuple[object, ...]]:
        # without the cached model: CasADi expressions do not travel between processes
        return TextSystem, tuple(getattr(self, item.name) for item in fields(self))

    def _summary(self) -> Summary:
        rows = [
            ("states", ", ".join(map(str, self.states))),
            ("inputs", ", ".join(map(str, self.inputs)) or "none"),
            ("unknown inputs", ", ".join(map(str, self.unknown)) or "none"),
            *((name, text) for name, text in self.definitions),
            *((f"{state.name}'", text) for state, text in zip(self.states, self.rates, strict=True)),
            *((output.name, str(output)) for output in self.outputs),
        ]
        return Summary(f"system of {len(self.states)} states", tuple(rows))


def exact_number(value: float) -> Fraction:
    """Return the decimal that a number was typed as."""
    return Fraction(repr(float(value)))


def _column(formulas: tuple[str, ...], values: Mapping[str, Value]) -> ca.SX:
    """The formulas as a column (q, 1)."""
    import casadi as ca

    return ca.vertcat(*(casadi_value(parse_formula(text), values) for text in formulas))
