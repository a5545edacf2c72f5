"""A model as the analysis reads it: its equations, with a symbol for every constant."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

import casadi as ca

from obsdesign.analysis.equations import Equations
from obsdesign.analysis.evaluation_point import random_fractions
from obsdesign.checks import require_known
from obsdesign.dynamics.model import Model
from obsdesign.dynamics.motion import non_affine
from obsdesign.rank.decimal_reading import read_double
from obsdesign.rank.exact_constants import SymbolisedExpression, symbolise
from obsdesign.rank.exact_numbers import ExactNumber, Irrational, pi_times
from obsdesign.rank.map_flow import MapFlow

Reading = Callable[[float], ExactNumber]


def likely_value(value: float) -> ExactNumber:
    """Return what was meant by a double."""
    return read_double(value).intended


def literal_value(value: float) -> ExactNumber:
    """Return what a double stands for as it stands, where it may be a rounded one."""
    return read_double(value).literal


def equations_of(
    model: Model,
    held: Mapping[str, float] | None = None,
    origin: Sequence[Fraction] | None = None,
    reading: Reading | None = None,
) -> Equations:
    """Return the model's equations with a symbol for every constant.

    held: known inputs kept at a value, which joins the drift; origin (n,): the equations are those of the state less origin pi,
    multiples of pi / 12, so that sine and cosine there are those of 0; reading: what a double stands for (None: what was meant).
    Unknown inputs that outputs contain, or that enter a rate other than by a factor, are states that come first, of which nothing is
    asked.
    """
    held, reading = held or {}, reading or likely_value
    require_known("held", tuple(held), model.input_names)
    if model.period is not None:
        return _map_equations(model, held, reading)
    return (_affine_equations if model.is_affine else _general_equations)(model, held, tuple(origin or ()), reading)


def _affine_equations(model: Model, held: Mapping[str, float], origin: tuple[Fraction, ...], reading: Reading) -> Equations:
    held_values = ca.SX.sym("held", len(held))
    columns = {name: i for i, name in enumerate(model.input_names)}
    n, q, m = model.x.numel(), len(model.outputs), len(model.inputs)
    graph = symbolise(model.x, ca.vertcat(model.h, ca.vec(ca.horzcat(model.drift, model.B, model.G))), reading, origin)
    fields = ca.horzsplit(ca.reshape(graph.expression[q:], n, -1))
    return Equations(
        x=model.x,
        names=model.state_names,
        constants=ca.vertcat(graph.constants, held_values),
        values=(*graph.values, *(reading(float(value)) for value in held.values())),
        drift=fields[0] + sum((fields[1 + columns[name]] * held_values[i] for i, name in enumerate(held)), ca.SX.zeros(n)),
        known_fields=tuple(fields[1 + i] for name, i in columns.items() if name not in held),
        unknown_fields=tuple(fields[m + 1 :]),
        outputs=graph.expression[:q],
        output_names=tuple(signal.name for signal in model.outputs),
        origin=origin,
        readings=(*graph.readings, *((float(value), reading(float(value))) for value in held.values())),
    )


@dataclass(frozen=True, eq=False)
class HeldInputs:
    """Known inputs kept at values, each turns pi + remainder with turns a multiple of 1/12: sines of the first are exact.

    turns (m,): 0 for inputs that are not held; symbols: for the remainders, numbers where these are 0, 1 or -1; values: of the symbols.
    """

    turns: tuple[Fraction, ...]
    remainders: tuple[ca.SX, ...]
    symbols: tuple[ca.SX, ...]
    values: tuple[ExactNumber, ...]
    readings: tuple[tuple[float, ExactNumber], ...]


def held_inputs(model: Model, held: Mapping[str, float], reading: Reading) -> HeldInputs:
    """Return what the model's inputs are held at."""
    readings = {name: (float(value), reading(float(value))) for name, value in held.items()}
    turns, remainders, symbols, values = {}, [], [], []
    for name, (_, number) in readings.items():
        multiple = number.multiple_of_pi if isinstance(number, Irrational) else None
        turns[name] = Fraction(math.floor(12 * multiple), 12) if multiple else Fraction(0)
        remainder = pi_times(multiple - turns[name]) if multiple else number
        if remainder in (0, 1, -1):
            remainders.append(ca.SX(float(remainder)))
            continue
        symbols.append(ca.SX.sym(f"held {name}"))
        remainders.append(symbols[-1])
        values.append(remainder)
    places = tuple(turns.get(name, Fraction(0)) for name in model.input_names)
    return HeldInputs(places, tuple(remainders), tuple(symbols), tuple(values), tuple(readings.values()))


def _with_held(
    model: Model, motion: ca.SX, held: Mapping[str, float], reading: Reading, origin: Sequence[Fraction]
) -> tuple[SymbolisedExpression, ca.SX]:
    """Return outputs and motion in one column, with a symbol for every constant and held value, and the inputs that are not held."""
    kept = held_inputs(model, held, reading)
    turns = (*(origin or [Fraction(0)] * model.x.numel()), *kept.turns, *[Fraction(0)] * model.w.numel())
    graph = symbolise(ca.vertcat(model.x, model.u, model.w), ca.vertcat(model.h, motion), reading, turns)
    held_symbols = ca.vertcat(ca.SX(0, 1), *(model.u[model.input_names.index(name)] for name in held))
    with_held = SymbolisedExpression(
        expression=ca.substitute(graph.expression, held_symbols, ca.vertcat(*kept.remainders)) if held else graph.expression,
        constants=ca.vertcat(graph.constants, *kept.symbols),
        values=(*graph.values, *kept.values),
        readings=(*graph.readings, *kept.readings),
    )
    return with_held, ca.vertcat(ca.SX(0, 1), *(model.u[i] for i, name in enumerate(model.input_names) if name not in held))


def _general_equations(model: Model, held: Mapping[str, float], origin: tuple[Fraction, ...], reading: Reading) -> Equations:
    """The equations of a rate that is linear in those known inputs that are not held: fields are its derivatives by the inputs."""
    graph, u = _with_held(model, model.rate, held, reading, origin)
    q, n = len(model.outputs), model.x.numel()
    outputs, rate = graph.expression[:q], graph.expression[q:]
    added = _non_linear(rate, outputs, u, model.w)
    w_states, w_rest = (
        ca.vertcat(ca.SX(0, 1), *(model.w[j] for j in range(model.w.numel()) if (j in added) is kind)) for kind in (True, False)
    )
    r, linear = w_states.numel(), ca.vertcat(u, w_rest)
    slopes = ca.horzsplit(ca.densify(ca.jacobian(rate, linear))) if linear.numel() else []
    fields = [ca.vertcat(ca.SX.zeros(r), column) for column in slopes]
    integrators = [ca.SX([float(row == i) for row in range(r + n)]) for i in range(r)]
    return Equations(
        x=ca.vertcat(w_states, model.x),
        names=(*(model.unknown_inputs[j].name for j in added), *model.state_names),
        constants=graph.constants,
        values=graph.values,
        drift=ca.vertcat(ca.SX.zeros(r), ca.substitute(rate, linear, ca.SX.zeros(linear.numel())) if linear.numel() else rate),
        known_fields=tuple(fields[: u.numel()]),
        unknown_fields=(*integrators, *fields[u.numel() :]),
        outputs=outputs,
        output_names=tuple(signal.name for signal in model.outputs),
        n_added=r,
        origin=(*[Fraction(0)] * r, *origin) if origin else (),
        readings=graph.readings,
    )


def _map_equations(model: Model, held: Mapping[str, float], reading: Reading) -> Equations:
    """The equations of a map; drift and outputs are those for some values of the inputs."""
    graph, u = _with_held(model, model.motion.at(model.u, model.w), held, reading, ())
    q, n = len(model.outputs), model.x.numel()
    inputs, some = ca.vertcat(u, model.w), ca.SX.sym("some inputs", u.numel() + model.w.numel())
    constants = ca.vertcat(graph.constants, some)
    with_some = ca.substitute(graph.expression, inputs, some) if some.numel() else graph.expression
    nothing = ca.SX.zeros(n)
    return Equations(
        x=model.x,
        names=model.state_names,
        constants=constants,
        values=(*graph.values, *random_fractions(some.numel(), "some inputs")),
        drift=with_some[q:],
        known_fields=(nothing,) * u.numel(),
        unknown_fields=(nothing,) * model.w.numel(),
        outputs=with_some[:q],
        output_names=tuple(signal.name for signal in model.outputs),
        readings=graph.readings,
        step_map=MapFlow(model.x, u, model.w, constants, graph.expression[q:], graph.expression[:q]),
    )


def _non_linear(rate: ca.SX, outputs: ca.SX, u: ca.SX, w: ca.SX) -> tuple[int, ...]:
    """Return the unknown inputs, by place, that outputs contain or that enter the rate other than by a factor."""
    in_rate = non_affine(rate, u, w)
    return tuple(j for j in range(w.numel()) if u.numel() + j in in_rate or ca.depends_on(outputs, w[j]))
