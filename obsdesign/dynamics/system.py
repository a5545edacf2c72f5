"""A ready-made vehicle with its sensors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from obsdesign.arguments import validate_arguments
from obsdesign.checks import require_known
from obsdesign.dynamics.model import AbstractSystem, Channel, JointNoise, Model, Noise, columns
from obsdesign.errors import InputError
from obsdesign.sensors._joint import as_joint_noise
from obsdesign.sensors.abstract import AbstractSensor, distinct_names
from obsdesign.vehicles.abstract import AbstractVehicle

if TYPE_CHECKING:
    import casadi as ca
    from numpy.typing import ArrayLike


@validate_arguments
@dataclass(frozen=True)
class System(AbstractSystem):
    """A ready-made vehicle with sensors: xdot = drift + sum_i known_i u_i + sum_j unknown_j w_j, y = outputs of the sensors.

    Two sensors of one name are told apart by a number.
    Raises InputError for unknown names, a sensor in two groups, an R that is no covariance of that size, and joint noise of a
    sensor whose noise is correlated in time or depends on the state.
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

    def __post_init__(self) -> None:
        object.__setattr__(self, "sensors", tuple(self.sensors))
        object.__setattr__(self, "unknown_inputs", tuple(self.unknown_inputs))
        require_known("unknown_inputs", self.unknown_inputs, tuple(signal.name for signal in self.vehicle.inputs))
        object.__setattr__(self, "joint_noise", MappingProxyType(as_joint_noise(self.joint_noise, self._sensors_by_name)))

    @property
    def _sensors_by_name(self) -> dict[str, AbstractSensor]:
        return dict(zip(self.sensor_names, self.sensors, strict=True))

    @property
    def sensor_names(self) -> tuple[str, ...]:
        """Names of the sensors, without the symbolic model."""
        return distinct_names(self.sensors)

    def __hash__(self) -> int:
        return self._hash

    @cached_property
    def _hash(self) -> int:
        # once: every look-up of a compiled function asks for it
        return hash((self.vehicle, self.sensors, self.unknown_inputs, frozenset(self.joint_noise.items())))

    def __reduce__(self) -> tuple[type[System], tuple[object, ...]]:
        # without the cached model: CasADi expressions do not travel between processes
        return System, (self.vehicle, self.sensors, self.unknown_inputs, dict(self.joint_noise))

    def _build(self) -> Model:
        import casadi as ca

        vehicle = self.vehicle
        x = ca.vertcat(*(ca.SX.sym(state.name) for state in vehicle.states))
        fields = vehicle.fields(x)
        signals_and_columns = list(zip(vehicle.inputs, fields.inputs, strict=True))
        known_pairs = [pair for pair in signals_and_columns if pair[0].name not in self.unknown_inputs]
        unknown_pairs = [pair for pair in signals_and_columns if pair[0].name in self.unknown_inputs]
        unknown_pairs += list(zip(vehicle.disturbances, fields.disturbances, strict=True))
        return Model(
            x=x,
            states=vehicle.states,
            drift=fields.drift,
            inputs=tuple(signal for signal, _ in known_pairs),
            B=columns([column for _, column in known_pairs], len(vehicle.states)),
            unknown_inputs=tuple(signal for signal, _ in unknown_pairs),
            G=columns([column for _, column in unknown_pairs], len(vehicle.states)),
            channels=tuple(_channels(self, x)),
            joint=tuple(JointNoise(names, R) for names, R in self.joint_noise.items()),  # pyright: ignore[reportArgumentType]
        )


def _channels(system: System, x: ca.SX) -> Iterator[Channel]:
    import casadi as ca

    state = {signal.name: x[i] for i, signal in enumerate(system.vehicle.states)}
    state |= _rates(system.vehicle, x)
    for name, sensor in zip(system.sensor_names, system.sensors, strict=True):
        try:
            h = ca.vertcat(*sensor.measure(state))
            spread, gate = sensor.spread(state), sensor.gate(state)
        except KeyError as missing:
            raise InputError(f"sensor {name!r} needs the state {missing}, which the vehicle does not have{_about(missing)}") from None
        if gate.shape != (1, 1):
            raise InputError(f"sensor {name!r}: gate has shape {gate.shape}: must be one number for all its outputs")
        if spread.shape not in {(1, 1), (len(sensor.outputs), 1)}:
            raise InputError(f"sensor {name!r}: spread has shape {spread.shape}: must be one number, or one for each of its outputs")
        outputs = tuple(replace(signal, name=signal.name.replace(sensor.name, name, 1)) for signal in sensor.outputs)
        spread, gate = _spread_of(system, name, spread), gate if sensor.detection == 1 else sensor.detection * gate
        noise = Noise(spread, gate, sensor.inflation, sensor.bias_floor, sensor.correlation, sensor.detection)
        yield Channel(name, outputs, h, noise, sensor.rate, sensor.landmarks)


def _rates(vehicle: AbstractVehicle, x: ca.SX) -> dict[str, ca.SX]:
    """Return how fast states change, as x_rate, ...: of those in whose rate neither inputs nor disturbances have a part."""
    import casadi as ca

    fields = vehicle.fields(x)
    driven = ca.horzcat(*fields.inputs, *fields.disturbances)
    free = [i for i in range(len(vehicle.states)) if driven.numel() == 0 or ca.sparsify(driven[i, :]).nnz() == 0]
    return {f"{vehicle.states[i].name}_rate": fields.drift[i] for i in free}


def _about(missing: KeyError) -> str:
    """What to do about a state that is missing, if it is a rate."""
    if not str(missing.args[0]).endswith("_rate"):
        return ""
    return ": a rate is one of the state alone, without inputs or unknown ones (a constant wind, a constant speed)"


def _spread_of(system: System, name: str, spread: ca.SX) -> ca.SX:
    """Return the sensor's own standard deviation (1, 1), or those (q, 1) of its outputs in joint noise."""
    import casadi as ca

    for names, R in system.joint_noise.items():
        if name in names:
            if not spread.is_constant():
                raise InputError(f"joint_noise: the noise of {name!r} depends on the state, so that no R can be its covariance everywhere")
            owner = [sensor_name for sensor_name in names for _ in system._sensors_by_name[sensor_name].outputs]
            return ca.vertcat(*[ca.sqrt(np.asarray(R)[i, i]) for i, sensor_name in enumerate(owner) if sensor_name == name])
    return spread
