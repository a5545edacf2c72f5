"""A ready-made vehicle with its sensors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from obsdesign.arguments import validate_arguments
from obsdesign.checks import require_known
from obsdesign.dynamics.channel import Channel, JointNoise, Noise
from obsdesign.dynamics.model import AbstractSystem, Model, columns
from obsdesign.dynamics.motion import AffineMotion
from obsdesign.errors import InputError
from obsdesign.sensors._corrections import corrections_of, system_states
from obsdesign.sensors._group import SensorGroup, distinct_names, sensor_groups
from obsdesign.sensors._joint import as_joint_noise
from obsdesign.sensors.abstract import AbstractSensor
from obsdesign.signals import Signal
from obsdesign.vehicles.abstract import AbstractVehicle, Fields

if TYPE_CHECKING:
    import casadi as ca
    from numpy.typing import ArrayLike

_DEPTH = 100  # of the operations of two gates that are compared


@validate_arguments
@dataclass(frozen=True)
class System(AbstractSystem):
    """A ready-made vehicle with sensors: xdot = drift + sum_i known_i u_i + sum_j unknown_j w_j, y = outputs of the sensors.

    Two sensors of one name are told apart by a number; sensors of one group are one of the S sensors, under the group's name. States
    that are scales and biases of sensors follow those of the vehicle: constants, but for process noise of their own.
    Raises InputError for unknown names, a sensor in two groups, an R that is no covariance of that size, and joint noise of a
    sensor whose noise is correlated in time or depends on the state, sensors of a group that differ in what belongs to the whole, and
    scales and biases whose names are taken.
    """

    vehicle: AbstractVehicle
    """What moves: states, inputs and disturbances."""
    sensors: tuple[AbstractSensor, ...] = ()
    """What measures, in the order in which blocks and schedules count them."""
    unknown_inputs: tuple[str, ...] = ()
    """Names of inputs of the vehicle that nobody knows, beside the vehicle's own disturbances."""
    joint_noise: Mapping[tuple[str, ...], ArrayLike] = field(default_factory=dict)
    """Names of two or more sensors -> R (q, q), the covariance of their stacked outputs at one instant, in the order of the names and the
    units of the outputs. It takes the place of their own sigma, and inflation multiplies it. At instants where some of them have a
    sample, those count with their part of R.
    """
    suite: tuple[str, ...] | None = None
    """Names of the sensors that are read, scales and biases of the others staying states; None = all."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "sensors", tuple(self.sensors))
        object.__setattr__(self, "unknown_inputs", tuple(self.unknown_inputs))
        require_known("unknown_inputs", self.unknown_inputs, tuple(signal.name for signal in self.vehicle.inputs))
        object.__setattr__(self, "joint_noise", MappingProxyType(as_joint_noise(self.joint_noise, self._groups_by_name)))
        if self.suite is not None:
            object.__setattr__(self, "suite", tuple(self.suite))
            require_known("suite: the system", self.suite, distinct_names(self.sensors))
        _ = self.states  # refuses names that are taken

    @property
    def groups(self) -> tuple[SensorGroup, ...]:
        """The S things that are on or off, of the suite: each a sensor, or the sensors of one group."""
        groups = sensor_groups(self.sensors)
        return groups if self.suite is None else tuple(group for group in groups if group.name in self.suite)

    @property
    def _groups_by_name(self) -> dict[str, SensorGroup]:
        return {group.name: group for group in sensor_groups(self.sensors)}

    @property
    def states(self) -> tuple[Signal, ...]:
        """The n states, without the symbolic model: those of the vehicle, then scales and biases of sensors."""
        vehicle = self.vehicle
        return system_states(vehicle.states, (*vehicle.inputs, *vehicle.disturbances), self.sensors)

    @property
    def sensor_names(self) -> tuple[str, ...]:
        """Names of the S sensors, without the symbolic model."""
        return tuple(group.name for group in self.groups)

    def __hash__(self) -> int:
        return self._hash

    @cached_property
    def _hash(self) -> int:
        # once: every look-up of a compiled function asks for it
        return hash((self.vehicle, self.sensors, self.unknown_inputs, frozenset(self.joint_noise.items()), self.suite))

    def __reduce__(self) -> tuple[type[System], tuple[object, ...]]:
        # without the cached model: CasADi expressions do not travel between processes
        return System, (self.vehicle, self.sensors, self.unknown_inputs, dict(self.joint_noise), self.suite)

    def _build(self) -> Model:
        import casadi as ca

        vehicle, states = self.vehicle, self.states
        x = ca.vertcat(*(ca.SX.sym(state.name) for state in states))
        fields = _fields(vehicle, x)
        signals_and_columns = list(zip(vehicle.inputs, fields.inputs, strict=True))
        known_pairs = [pair for pair in signals_and_columns if pair[0].name not in self.unknown_inputs]
        unknown_pairs = [pair for pair in signals_and_columns if pair[0].name in self.unknown_inputs]
        unknown_pairs += list(zip(vehicle.disturbances, fields.disturbances, strict=True))
        u = ca.vertcat(*(ca.SX.sym(signal.name) for signal, _ in known_pairs))
        known = {signal.name: u[i] for i, (signal, _) in enumerate(known_pairs)}
        model = Model(
            x=x,
            states=states,
            motion=AffineMotion(
                fields.drift, *(columns([column for _, column in pairs], len(states)) for pairs in (known_pairs, unknown_pairs))
            ),
            inputs=tuple(signal for signal, _ in known_pairs),
            unknown_inputs=tuple(signal for signal, _ in unknown_pairs),
            channels=tuple(_channels(self, x, {**fields.derived, **_rates(self, fields, known)})),
            u_of_outputs=u if known_pairs else None,
            joint=tuple(JointNoise(names, R) for names, R in self.joint_noise.items()),  # pyright: ignore[reportArgumentType]
        )
        return model if self.suite is None else model.only(self.suite)


def _fields(vehicle: AbstractVehicle, x: ca.SX) -> Fields:
    """The vehicle's fields, 0 for states that are not its own."""
    import casadi as ca

    n = len(vehicle.states)
    fields, below = vehicle.fields(x[:n]), ca.SX.zeros(x.numel() - n)
    if not below.numel():
        return fields
    inputs, disturbances = (tuple(ca.vertcat(field, below) for field in group) for group in (fields.inputs, fields.disturbances))
    return Fields(ca.vertcat(fields.drift, below), inputs, disturbances, fields.derived)


def _channels(system: System, x: ca.SX, derived: Mapping[str, ca.SX]) -> Iterator[Channel]:
    """The channels; derived: what sensors read that is no state, rates among it."""
    import casadi as ca

    state = {signal.name: x[i] for i, signal in enumerate(system.states)} | dict(derived)
    for group in sensor_groups(system.sensors):
        readings = [_reading(sensor, sensor.name if sensor.group else group.name, state) for sensor in group.sensors]
        h = ca.vertcat(*(reading.h for reading in readings))
        spread = _spread_of(system, group.name, _spreads(readings, h.numel()))
        first = group.sensors[0]
        gate = _product([reading.gate for reading in readings])
        noise = Noise(
            spread,
            first.detection * gate if first.detection < 1 else gate,
            first.inflation,
            group.bias_floor,
            first.correlation,
            first.detection,
        )
        yield Channel(group.name, group.outputs, h, noise, first.rate, group.landmarks)


@dataclass(frozen=True)
class _SensorGraphs:
    """What one sensor reads at a state: outputs (q, 1), spread (1, 1) or (q, 1), gate (1, 1)."""

    h: ca.SX
    spread: ca.SX
    gate: ca.SX


def _reading(sensor: AbstractSensor, name: str, state: Mapping[str, ca.SX]) -> _SensorGraphs:
    import casadi as ca

    try:
        h, spread, gate = sensor.measure(state), sensor.spread(state), sensor.gate(state)
    except KeyError as missing:
        raise InputError(f"sensor {name!r} needs the state {missing}, which the vehicle does not have{_about(missing)}") from None
    if gate.shape != (1, 1):
        raise InputError(f"sensor {name!r}: gate has shape {gate.shape}: must be one number for all its outputs")
    if spread.shape not in {(1, 1), (len(sensor.outputs), 1)}:
        raise InputError(f"sensor {name!r}: spread has shape {spread.shape}: must be one number, or one for each of its outputs")
    states = corrections_of(sensor)
    corrected = []
    for signal, value, bias in zip(sensor.outputs, h, states.biases, strict=True):
        scaled = value if states.scale is None or signal.is_angle else state[states.scale] * value
        corrected.append(scaled if bias is None else scaled + state[bias])
    return _SensorGraphs(ca.vertcat(*corrected), spread, gate)


def _spreads(readings: Sequence[_SensorGraphs], q: int) -> ca.SX:
    """The spreads (1, 1) of a lone sensor with one number for all outputs, else (q, 1)."""
    import casadi as ca

    if len(readings) == 1:
        return readings[0].spread
    return ca.vertcat(*(reading.spread * ca.SX.ones(reading.h.numel()) for reading in readings))


def _product(gates: Sequence[ca.SX]) -> ca.SX:
    """The product of gates, each once: sensors behind one limit see or miss a thing together."""
    import casadi as ca

    share, counted = gates[0], [gates[0]]
    for gate in gates[1:]:
        if not any(ca.is_equal(gate, earlier, _DEPTH) for earlier in counted):
            share, counted = share * gate, [*counted, gate]
    return share


def _rates(system: System, fields: Fields, known: Mapping[str, ca.SX]) -> dict[str, ca.SX]:
    """Return how fast the vehicle's states change, as x_rate, ...: of those in whose rate nothing unknown has a part."""
    unknown = [
        *(column for signal, column in zip(system.vehicle.inputs, fields.inputs, strict=True) if signal.name in system.unknown_inputs),
        *fields.disturbances,
    ]
    names = [signal.name for signal in system.vehicle.inputs]
    moved = sum((known[name] * column for name, column in zip(names, fields.inputs, strict=True) if name in known), fields.drift)
    return {
        f"{state.name}_rate": moved[i] for i, state in enumerate(system.vehicle.states) if all(column[i].is_zero() for column in unknown)
    }


def _about(missing: KeyError) -> str:
    """What to do about a state that is missing, if it is a rate."""
    if not str(missing.args[0]).endswith("_rate"):
        return ""
    return ": a rate is one of the state and of known inputs, nothing unknown in it (a constant wind, a known speed)"


def _spread_of(system: System, name: str, spread: ca.SX) -> ca.SX:
    """Return the sensor's own standard deviation (1, 1), or those (q, 1) of its outputs in joint noise."""
    import casadi as ca

    for names, R in system.joint_noise.items():
        if name in names:
            if not spread.is_constant():
                raise InputError(f"joint_noise: the noise of {name!r} depends on the state, so that no R can be its covariance everywhere")
            owner = [sensor_name for sensor_name in names for _ in system._groups_by_name[sensor_name].outputs]
            return ca.vertcat(*[ca.sqrt(np.asarray(R)[i, i]) for i, sensor_name in enumerate(owner) if sensor_name == name])
    return spread
