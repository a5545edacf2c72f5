"""A system that was written as text, as CasADi expressions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from obsdesign.display import Summary
from obsdesign.dynamics.channel import Channel
from obsdesign.dynamics.control_affine import ControlAffineSystem
from obsdesign.dynamics.discrete_system import DiscreteSystem
from obsdesign.dynamics.general_system import GeneralSystem
from obsdesign.dynamics.model import AbstractSystem, Model
from obsdesign.dynamics.motion import non_affine
from obsdesign.dynamics.output_noise import OutputNoise
from obsdesign.dynamics.system_text import SystemText, TextOutput
from obsdesign.errors import InputError
from obsdesign.formulas.casadi_value import Values, casadi_value, value_of
from obsdesign.formulas.grammar import parse_formula
from obsdesign.formulas.tree import FormulaError

if TYPE_CHECKING:
    import casadi as ca


@dataclass(frozen=True)
class TextSystem(AbstractSystem):
    """The system of a text, whose inputs stand in any place, in continuous time or as a map from one instant to the next."""

    text: SystemText
    """What somebody typed."""

    def only(self, sensors: tuple[str, ...]) -> TextSystem:
        """Return the system with the named sensors alone."""
        return TextSystem(self.text.only(sensors))

    def _build(self) -> Model:
        model, text = _system_of(self.text).model, self.text
        pairs = zip(model.channels, text.outputs, strict=True)
        return replace(
            model,
            states=text.state_signals,
            inputs=text.input_signals,
            unknown_inputs=text.unknown_signals,
            channels=tuple(_with_units(channel, text, output) for channel, output in pairs),
        )

    def __reduce__(self) -> tuple[type[TextSystem], tuple[SystemText]]:
        # without the cached model: CasADi expressions do not travel between processes
        return TextSystem, (self.text,)

    def _summary(self) -> Summary:
        text, mark = self.text, "'" if self.text.period is None else "+"
        rows = [
            ("states", ", ".join(map(str, text.states))),
            ("inputs", ", ".join(map(str, text.inputs)) or "none"),
            ("unknown inputs", ", ".join(map(str, text.unknown)) or "none"),
            *((name, formula) for name, formula in text.definitions),
            *((f"{state.name}{mark}", formula) for state, formula in zip(text.states, text.rates, strict=True)),
            *((output.name, str(output)) for output in text.outputs),
        ]
        return Summary(f"system of {len(text.states)} states", tuple(rows))


def _system_of(text: SystemText) -> AbstractSystem:
    """The system of CasADi expressions, signals without units: affine in its inputs where it is, a map where it has a period."""
    import casadi as ca

    groups = [
        {quantity.name: ca.SX.sym(quantity.name) for quantity in quantities} for quantities in (text.states, text.inputs, text.unknown)
    ]
    states, inputs, unknown_inputs = groups
    values = {**text.constants, **states, **inputs, **unknown_inputs}
    definitions = dict(text.definitions)
    for name, tree in text.formulas.items():
        with _quoting(definitions[name]):
            values[name] = value_of(tree, values)
    outputs = {output.name: _column(output.formulas, values) for output in text.outputs}
    noises = {output.name: _noise(text, output, values) for output in text.outputs}
    x, names, angles = ca.vertcat(*states.values()), tuple(states), text.angle_names
    moved, seconds = _column(text.rates, values), float(text.seconds)
    if text.period is not None:
        period = text.period * seconds
        return DiscreteSystem(
            x,
            names,
            inputs=inputs,
            unknown=unknown_inputs,
            outputs=outputs,
            angles=angles,
            noises=noises,
            next_state=moved,
            period=period,
        )
    rate = moved if seconds == 1 else moved / seconds
    u, w = (ca.vertcat(ca.SX(0, 1), *group.values()) for group in (inputs, unknown_inputs))
    if non_affine(rate, u, w):
        return GeneralSystem(x, names, inputs=inputs, unknown=unknown_inputs, outputs=outputs, angles=angles, noises=noises, rates=rate)
    return ControlAffineSystem.from_rate(x, names, rate, inputs, unknown_inputs, outputs=outputs, angles=angles, noises=noises)


def _noise(text: SystemText, output: TextOutput, values: Values) -> OutputNoise:
    sigma = _expression(output.sigma, values) if isinstance(output.sigma, str) else output.sigma
    errors = (output.inflation, output.bias_floor, output.correlation, output.detection)
    return OutputNoise(sigma, None, output.rate, *errors, text.points_of(output))


def _with_units(channel: Channel, text: SystemText, output: TextOutput) -> Channel:
    """The channel with the unit of each entry."""
    units = [text.unit_of(output, formula) for formula in output.formulas]
    return replace(channel, outputs=tuple(replace(signal, unit=unit) for signal, unit in zip(channel.outputs, units, strict=True)))


def _column(formulas: tuple[str, ...], values: Mapping[str, object]) -> ca.SX:
    """The formulas as a column (q, 1)."""
    import casadi as ca

    return ca.vertcat(*(_expression(text, values) for text in formulas))


def _expression(formula: str, values: Values) -> ca.SX:
    with _quoting(formula):
        return casadi_value(parse_formula(formula), values)


@contextmanager
def _quoting(formula: str) -> Iterator[None]:
    """Raise InputError with the formula where it has no finite value whatever the state."""
    try:
        yield
    except FormulaError as error:
        raise InputError(error.problem.told(formula)) from None
