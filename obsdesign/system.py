"""A vehicle with its sensors, or any control-affine system, reduced to one symbolic record."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

from obsdesign.checks import require_known, require_positive
from obsdesign.errors import InputError
from obsdesign.sensors.abstract import AbstractSensor, distinct_names
from obsdesign.signals import Point, Signal
from obsdesign.vehicles.abstract import AbstractVehicle

if TYPE_CHECKING:
    import casadi as ca


@dataclass(frozen=True)
class Channel:
    """One sensor of a model: outputs h (q, 1) of the state, their standard deviations, rate [Hz] and landmark [m]."""

    name: str
    outputs: tuple[Signal, ...]
    h: ca.SX
    sigmas: tuple[float, ...]
    rate: float | None = None
    landmark: Point | None = None


@dataclass(frozen=True, eq=False)
class Model:
    """xdot = drift + B u + G w, y = h(x), as CasADi expressions of the state symbol x (n, 1).

    B (n, m) holds the fields of the known inputs, G (n, p) those of the unknown ones; S channels.
    """

    x: ca.SX
    states: tuple[Signal, ...]
    drift: ca.SX
    inputs: tuple[Signal, ...]
    B: ca.SX
    unknown_inputs: tuple[Signal, ...]
    G: ca.SX
    channels: tuple[Channel, ...]

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the n states."""
        return tuple(state.name for state in self.states)

    @property
    def input_names(self) -> tuple[str, ...]:
        """Names of the m known inputs, the columns of a trajectory's u."""
        return tuple(signal.name for signal in self.inputs)

    @property
    def sensor_names(self) -> tuple[str, ...]:
        """Names of the S sensors."""
        return tuple(channel.name for channel in self.channels)

    @property
    def outputs(self) -> tuple[Signal, ...]:
        """All outputs of all sensors, in order."""
        return tuple(signal for channel in self.channels for signal in channel.outputs)

    @property
    def sigmas(self) -> tuple[float, ...]:
        """Standard deviation of one sample of each output."""
        return tuple(sigma for channel in self.channels for sigma in channel.sigmas)

    @property
    def output_owner(self) -> tuple[int, ...]:
        """For each output the index of its sensor."""
        return tuple(i for i, channel in enumerate(self.channels) for _ in channel.outputs)

    @property
    def h(self) -> ca.SX:
        """All outputs stacked (q, 1)."""
        import casadi as ca

        return ca.vertcat(*(channel.h for channel in self.channels))

    @property
    def landmarks(self) -> tuple[Point, ...]:
        """Distinct points that sensors look at."""
        return tuple(dict.fromkeys(channel.landmark for channel in self.channels if channel.landmark is not None))

    def only(self, sensors: Sequence[str]) -> Model:
        """Return the model with the named sensors alone."""
        require_known("the system", sensors, self.sensor_names)
        return replace(self, channels=tuple(channel for channel in self.channels if channel.name in sensors))

    def holding(self, held: Mapping[str, float]) -> Model:
        """Return the model with known inputs kept at a value: they move into the drift."""
        import casadi as ca

        require_known("held", tuple(held), self.input_names)
        drift = self.drift
        for name, value in held.items():
            drift = drift + self.B[:, self.input_names.index(name)] * value
        free = [i for i, name in enumerate(self.input_names) if name not in held]
        B = self.B[:, free] if free else ca.SX(self.x.numel(), 0)
        return replace(self, drift=drift, inputs=tuple(self.inputs[i] for i in free), B=B)


class AbstractSystem(ABC):
    """Anything that can be analysed, designed for and filtered."""

    @cached_property
    def model(self) -> Model:
        """The symbolic record, built once."""
        return self._build()

    @abstractmethod
    def _build(self) -> Model:
        """Return the symbolic record."""


@dataclass(frozen=True)
class System(AbstractSystem):
    """A ready-made vehicle with sensors.

    unknown_inputs names inputs of the vehicle that nobody knows, beside the vehicle's own disturbances.
    Two sensors of one name are told apart by a number. Raises InputError for unknown names.
    """

    vehicle: AbstractVehicle
    sensors: tuple[AbstractSensor, ...] = ()
    unknown_inputs: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "sensors", tuple(self.sensors))
        object.__setattr__(self, "unknown_inputs", tuple(self.unknown_inputs))
        require_known("unknown_inputs", self.unknown_inputs, tuple(signal.name for signal in self.vehicle.inputs))

    @property
    def sensor_names(self) -> tuple[str, ...]:
        """Names of the sensors, without the symbolic model."""
        return distinct_names(self.sensors)

    def __reduce__(self) -> tuple[type[System], tuple[object, ...]]:
        # without the cached model: CasADi expressions do not travel between processes
        return System, (self.vehicle, self.sensors, self.unknown_inputs)

    def _build(self) -> Model:
        import casadi as ca

        vehicle = self.vehicle
        x = ca.vertcat(*(ca.SX.sym(state.name) for state in vehicle.states))
        fields = vehicle.fields(x)
        every = list(zip(vehicle.inputs, fields.inputs, strict=True))
        known = [pair for pair in every if pair[0].name not in self.unknown_inputs]
        unknown = [pair for pair in every if pair[0].name in self.unknown_inputs]
        unknown += list(zip(vehicle.disturbances, fields.disturbances, strict=True))
        return Model(
            x=x,
            states=vehicle.states,
            drift=fields.drift,
            inputs=tuple(signal for signal, _ in known),
            B=_columns([column for _, column in known], len(vehicle.states)),
            unknown_inputs=tuple(signal for signal, _ in unknown),
            G=_columns([column for _, column in unknown], len(vehicle.states)),
            channels=tuple(_channels(self, x)),
        )


@dataclass(frozen=True, eq=False)
class ControlAffineSystem(AbstractSystem):
    """xdot = drift + sum_i known_i u_i + sum_j unknown_j w_j, y = outputs, from CasADi SX expressions.

    state: SX (n, 1) of symbols; names: n names; drift: SX (n, 1) or None; known, unknown: name -> SX (n, 1);
    outputs: name -> scalar SX, each one a sensor; sigmas: name -> standard deviation (default 1);
    angles: names of states and outputs that wrap.
    An output may bear the name of the state that it measures.
    Raises InputError for wrong shapes, repeated names, free symbols, outputs that do not depend on the state.
    """

    state: ca.SX
    names: tuple[str, ...]
    drift: ca.SX | None = None
    known: Mapping[str, ca.SX] = field(default_factory=dict)
    unknown: Mapping[str, ca.SX] = field(default_factory=dict)
    outputs: Mapping[str, ca.SX] = field(default_factory=dict)
    sigmas: Mapping[str, float] = field(default_factory=dict)
    angles: tuple[str, ...] = ()

    @classmethod
    def from_rate(  # noqa: PLR0917  # the fields of the record, in their order
        cls,
        state: ca.SX,
        names: Sequence[str],
        rate: ca.SX,
        known: Mapping[str, ca.SX] | None = None,
        unknown: Mapping[str, ca.SX] | None = None,
        outputs: Mapping[str, ca.SX] | None = None,
        sigmas: Mapping[str, float] | None = None,
        angles: Sequence[str] = (),
    ) -> ControlAffineSystem:
        """Return the system with xdot = rate (n, 1), an expression of the state and of the inputs' symbols (name -> symbol).

        Raises InputError where the rate is not affine in an input, and as the record itself does.
        """
        import casadi as ca

        known, unknown = dict(known or {}), dict(unknown or {})
        inputs = {**known, **unknown}
        symbols = ca.vertcat(*inputs.values()) if inputs else ca.SX(0, 1)
        fields = ca.jacobian(rate, symbols)
        for j, name in enumerate(inputs):
            for i in range(rate.numel()):
                if ca.depends_on(fields[i, j], symbols):
                    raise InputError(f"the rate of {names[i]} = {_shortened(rate[i])} is not affine in {name!r}")
        drift = ca.substitute(rate, symbols, ca.SX.zeros(symbols.numel())) if inputs else rate
        column = {name: ca.densify(fields[:, j]) for j, name in enumerate(inputs)}
        groups = [{name: column[name] for name in group} for group in (known, unknown)]
        return cls(state, tuple(names), drift, groups[0], groups[1], dict(outputs or {}), dict(sigmas or {}), tuple(angles))

    def __post_init__(self) -> None:
        import casadi as ca

        n = self.state.numel()
        object.__setattr__(self, "names", tuple(self.names))
        object.__setattr__(self, "drift", ca.SX.zeros(n) if self.drift is None else ca.SX(self.drift))
        for group in ("known", "unknown", "outputs"):
            object.__setattr__(self, group, {name: ca.SX(value) for name, value in getattr(self, group).items()})
        object.__setattr__(self, "sigmas", dict(self.sigmas))
        object.__setattr__(self, "angles", tuple(self.angles))
        self._check()

    def _check(self) -> None:
        import casadi as ca

        n = self.state.numel()
        if not self.state.is_valid_input():
            raise InputError(f"state is {self.state}: must be a column of distinct SX symbols")
        if len(self.names) != n:
            raise InputError(f"names has {len(self.names)} entries: the state has {n}")
        measured = {name for i, name in enumerate(self.names) if name in self.outputs and ca.is_equal(self.outputs[name], self.state[i])}
        every = [*self.names, *self.known, *self.unknown, *(name for name in self.outputs if name not in measured)]
        repeated = sorted({name for name in every if every.count(name) > 1})
        if repeated:
            raise InputError(f"the name {repeated[0]!r} is used twice: states, inputs and outputs need names of their own")
        inputs = {**dict.fromkeys(self.known, "known input"), **dict.fromkeys(self.unknown, "unknown input")}
        for name, expression in {"drift": self.drift, **self.known, **self.unknown}.items():
            _require_expression(f"field {name!r}" if name in inputs else name, expression, self.state, (n, 1), inputs)
        for name, expression in self.outputs.items():
            _require_expression(f"output {name!r}", expression, self.state, (1, 1), inputs)
            _require_dependence(name, expression, self.state)
        require_known("sigmas", tuple(self.sigmas), tuple(self.outputs))
        require_known("angles", self.angles, (*self.names, *self.outputs))
        for name, sigma in self.sigmas.items():
            require_positive(f"{name}: sigma", sigma)

    def _build(self) -> Model:
        n = self.state.numel()
        signals = {name: Signal(name, is_angle=name in self.angles) for name in (*self.names, *self.outputs)}
        channels = tuple(
            Channel(name, (signals[name],), expression, (self.sigmas.get(name, 1.0),)) for name, expression in self.outputs.items()
        )
        return Model(
            x=self.state,
            states=tuple(signals[name] for name in self.names),
            drift=self.drift,  # pyright: ignore[reportArgumentType]  # __post_init__ replaced None by zeros
            inputs=tuple(Signal(name) for name in self.known),
            B=_columns(list(self.known.values()), n),
            unknown_inputs=tuple(Signal(name) for name in self.unknown),
            G=_columns(list(self.unknown.values()), n),
            channels=channels,
        )

    @cached_property
    def _key(self) -> tuple[object, ...]:
        """What two equal systems share, in a form that travels between processes."""
        import casadi as ca

        expressions = [self.drift, *self.known.values(), *self.unknown.values(), *self.outputs.values()]
        graph = ca.Function("system", [self.state], expressions).serialize()
        names = (self.names, tuple(self.known), tuple(self.unknown), tuple(self.outputs))
        return graph, names, tuple(sorted(self.sigmas.items())), self.angles

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ControlAffineSystem) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)

    def __reduce__(self) -> tuple[object, tuple[object, ...]]:
        return _restore, self._key

    def __dask_tokenize__(self) -> tuple[object, ...]:
        """What a dask executor knows an argument by; it cannot make that out of CasADi expressions."""
        return self._key


def _restore(
    graph: str, names: tuple[tuple[str, ...], ...], sigmas: tuple[tuple[str, float], ...], angles: tuple[str, ...]
) -> ControlAffineSystem:
    import casadi as ca

    state_names, known, unknown, outputs = names
    x = ca.vertcat(*(ca.SX.sym(name) for name in state_names))
    values = iter(ca.Function.deserialize(graph).call([x]))
    drift = next(values)
    groups = [{name: next(values) for name in group} for group in (known, unknown, outputs)]
    system = ControlAffineSystem(x, state_names, drift, groups[0], groups[1], groups[2], dict(sigmas), angles)
    # the restored graph may be written in another order: its key stays the one it was made from
    object.__setattr__(system, "_key", (graph, names, sigmas, angles))
    return system


def _columns(fields: list[ca.SX], n: int) -> ca.SX:
    import casadi as ca

    return ca.horzcat(*fields) if fields else ca.SX(n, 0)


def _channels(system: System, x: ca.SX) -> Iterator[Channel]:
    import casadi as ca

    state = {signal.name: x[i] for i, signal in enumerate(system.vehicle.states)}
    for name, sensor in zip(system.sensor_names, system.sensors, strict=True):
        try:
            h = ca.vertcat(*sensor.measure(state))
        except KeyError as missing:
            raise InputError(f"sensor {name!r} needs the state {missing}, which the vehicle does not have") from None
        outputs = tuple(replace(signal, name=signal.name.replace(sensor.name, name, 1)) for signal in sensor.outputs)
        yield Channel(name, outputs, h, (sensor.sigma,) * len(outputs), sensor.rate, sensor.landmark)


def _require_expression(what: str, expression: ca.SX, state: ca.SX, shape: tuple[int, int], inputs: Mapping[str, str]) -> None:
    """Raise InputError unless the expression has the shape and contains no symbols but the state; inputs: name -> what it is."""
    import casadi as ca

    if expression.shape != shape:
        raise InputError(f"{what} has shape {expression.shape}: must be {shape}")
    free = [symbol for symbol in ca.symvar(expression) if not ca.depends_on(symbol, state)]
    if free:
        name = free[0].name()
        found = (
            f"the {inputs[name]} {name!r}: the rate must be affine in inputs, and outputs free of them"
            if name in inputs
            else f"the free symbol {name}"
        )
        own = ", ".join(sorted(symbol.name() for symbol in ca.symvar(state)))
        raise InputError(f"{what} = {_shortened(expression)} contains {found}; only the state may appear ({own})")


def _shortened(expression: ca.SX) -> str:
    text = str(expression)
    return text if len(text) <= 80 else f"{text[:77]}..."


def _require_dependence(name: str, expression: ca.SX, state: ca.SX) -> None:
    import casadi as ca

    if not ca.depends_on(expression, state):
        raise InputError(f"output {name} does not depend on the state: {expression}")
