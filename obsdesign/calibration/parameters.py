"""The numbers that a log is to tell, and what a system is with them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import Enum

import numpy as np

from obsdesign.dynamics.calibrated_system import CalibratedSystem, InputFit, OutputFit, SensorFit
from obsdesign.dynamics.channel import Channel
from obsdesign.dynamics.model import AbstractSystem, Model


class Quantity(Enum):
    """What a parameter is; the value is its name in words."""

    SIGMA = "sigma"
    BIAS = "bias"
    SCALE = "scale"
    INFLATION = "inflation"
    INPUT_BIAS = "bias of the input"
    INPUT_SCALE = "scale of the input"
    STATE_PSD = "disturbance_psd"
    INPUT_PSD = "input_psd"

    @property
    def is_positive(self) -> bool:
        """Whether it is a size, whose logarithm is fitted."""
        return self in (Quantity.SIGMA, Quantity.INFLATION, Quantity.STATE_PSD, Quantity.INPUT_PSD)

    @property
    def may_be_nothing(self) -> bool:
        """Whether it is a psd, which may be 0."""
        return self in (Quantity.STATE_PSD, Quantity.INPUT_PSD)

    @property
    def is_correction(self) -> bool:
        """Whether there is none as long as the data do not say so."""
        return self in (Quantity.BIAS, Quantity.SCALE, Quantity.INPUT_BIAS, Quantity.INPUT_SCALE)


@dataclass(frozen=True)
class Parameter:
    """One number: of which quantity, of what (a sensor, an input, states), at which places among outputs, inputs or states.

    value = start exp(spread z) of what is positive, start + spread z else, with z ~ N(0, 1) before the data are looked at.
    """

    quantity: Quantity
    owner: str
    places: tuple[int, ...]
    start: float
    spread: float
    unit: str = ""

    @property
    def name(self) -> str:
        """What it is called: sigma of beacon_1."""
        return f"{self.quantity.value} of {self.owner}"

    def value(self, z: np.ndarray | float) -> np.ndarray:
        """Return the value at z."""
        return self.start * np.exp(self.spread * np.asarray(z)) if self.quantity.is_positive else self.start + self.spread * np.asarray(z)


@dataclass(frozen=True, eq=False)
class Values:
    """A value for each parameter, arrays (P,) or (R, P) of several runs."""

    parameters: tuple[Parameter, ...]
    values: np.ndarray

    def over(self, quantity: Quantity, count: int, default: float) -> np.ndarray:
        """Return the quantity at all places (..., count), the default where no parameter is."""
        result = np.full((*self.values.shape[:-1], count), default)
        for i, parameter in enumerate(self.parameters):
            if parameter.quantity is quantity:
                result[..., list(parameter.places)] = self.values[..., i, None]
        return result

    def has(self, *quantities: Quantity) -> bool:
        """Return whether any parameter is one of these."""
        return any(parameter.quantity in quantities for parameter in self.parameters)

    def psds(self, model: Model) -> tuple[np.ndarray, dict[str, float]]:
        """Return disturbance_psd (n,) and input_psd, of one run."""
        of_inputs = self.over(Quantity.INPUT_PSD, len(model.inputs), 0.0)
        by_name = {name: float(psd) for name, psd in zip(model.input_names, of_inputs, strict=True) if psd > 0}
        return self.over(Quantity.STATE_PSD, len(model.states), 0.0), by_name

    def system(self, system: AbstractSystem) -> AbstractSystem:
        """Return the system with these values, of one run; itself where they change nothing of it."""
        model = system.model
        q, m = len(model.outputs), len(model.inputs)
        bias, scale, sigma = (
            self.over(quantity, q, start) for quantity, start in ((Quantity.BIAS, 0.0), (Quantity.SCALE, 1.0), (Quantity.SIGMA, 1.0))
        )
        inflation = self.over(Quantity.INFLATION, q, 1.0)
        input_bias, input_scale = self.over(Quantity.INPUT_BIAS, m, 0.0), self.over(Quantity.INPUT_SCALE, m, 1.0)
        sensors = tuple(
            SensorFit(
                name, tuple(OutputFit(float(bias[j]), float(scale[j]), float(sigma[j])) for j in outputs), float(inflation[outputs[0]])
            )
            for name, outputs in model.outputs_of.items()
            if any(bias[j] or scale[j] != 1 or sigma[j] != 1 or inflation[j] != 1 for j in outputs)
        )
        inputs = tuple(
            InputFit(name, float(input_bias[i]), float(input_scale[i]))
            for i, name in enumerate(model.input_names)
            if input_bias[i] or input_scale[i] != 1
        )
        return CalibratedSystem(system, sensors, inputs) if sensors or inputs else system


def _together(names: list[str]) -> str:
    """What things are called that are one."""
    return ", ".join(names) if len(names) <= _NAMED else f"{names[0]} and {len(names) - 1} of its kind"


def _states_of_its_own(model: Model, output: int) -> tuple[bool, bool]:
    """Return whether a state that nothing moves is an output's bias, h = s + ..., and whether one is its scale, h = s g + ..."""
    import casadi as ca

    h, has_bias, has_scale = model.h[output], False, False
    rate = ca.horzcat(model.drift, model.B, model.G) if model.is_affine else model.rate
    for i in range(len(model.states)):
        slope = ca.jacobian(h, model.x[i])
        if not rate[i, :].is_zero() or slope.is_zero() or ca.depends_on(slope, model.x[i]):
            continue
        has_bias, has_scale = (True, has_scale) if slope.is_constant() else (has_bias, True)
    return has_bias, has_scale


_SIGMA_SPREAD = float(np.log(10.0))
_BIAS_SPREAD = 20.0  # stated standard deviations of a sample
_SCALE_SPREAD = 0.1
_PSD_SPREAD = 4.0  # of the logarithm: most anything
_FEW = 50  # samples of a sensor, below which sensors of one kind are one
_NAMED = 4  # things that are one, up to which each of them is named
_MANY = 8  # sensors of one kind, beyond which they are one: landmarks of one camera


def sensor_parameters(
    model: Model, spreads: Mapping[str, np.ndarray], own: Mapping[str, bool], counts: Mapping[str, int]
) -> Iterator[Parameter]:
    """Yield bias, scale and sigma of sensors that have samples, spreads (q_s,) being their stated standard deviations.

    sigma is the factor on what is stated, one for outputs of one standard deviation; where samples have sigmas of their own (own) it is
    the sensor's inflation. Sensors of one kind, with outputs of the same units and standard deviations, share all of it where one of
    them has few samples (counts) or there are many. Errors that last or belong together stay as stated.
    """
    kinds: dict[object, list[Channel]] = {}
    for channel in model.channels:
        if channel.name in spreads:
            kinds.setdefault(_kind_of(model, channel, spreads[channel.name], own[channel.name]), []).append(channel)
    for kind in kinds.values():
        is_one = min(counts[channel.name] for channel in kind) < _FEW or len(kind) > _MANY
        for group in [kind] if is_one else [[channel] for channel in kind]:
            yield from _parameters_of_group(model, group, spreads[group[0].name], own[group[0].name])


def _kind_of(model: Model, channel: Channel, spread: np.ndarray, own: bool) -> object:
    """What channels that may be one have in common."""
    is_joint = any(channel.name in group.sensors for group in model.joint)
    signals = tuple((signal.unit, signal.is_angle) for signal in channel.outputs)
    return signals, tuple(spread.tolist()), channel.noise.spread.numel(), channel.noise.is_white and not is_joint, own


def _parameters_of_group(model: Model, group: list[Channel], spread: np.ndarray, own: bool) -> Iterator[Parameter]:
    first, places = group[0], [model.outputs_of[channel.name] for channel in group]
    columns = list(zip(*places, strict=True))
    for i, signal in enumerate(first.outputs):
        owner = _together([channel.outputs[i].name for channel in group])
        has_bias, has_scale = _states_of_its_own(model, columns[i][0])
        if not has_bias:
            yield Parameter(Quantity.BIAS, owner, columns[i], 0.0, _BIAS_SPREAD * float(spread[i]), signal.unit)
        if not (signal.is_angle or has_scale):
            yield Parameter(Quantity.SCALE, owner, columns[i], 1.0, _SCALE_SPREAD)
    if not first.noise.is_white or any(first.name in joint.sensors for joint in model.joint):
        return
    quantity = Quantity.INFLATION if own else Quantity.SIGMA
    if own or first.noise.spread.numel() == 1:
        yield Parameter(
            quantity, _together([channel.name for channel in group]), tuple(j for outputs in places for j in outputs), 1.0, _SIGMA_SPREAD
        )
        return
    for i in range(len(first.outputs)):
        yield Parameter(quantity, _together([channel.outputs[i].name for channel in group]), columns[i], 1.0, _SIGMA_SPREAD)


def motion_parameters(model: Model, sizes: np.ndarray, prior_std: np.ndarray, duration: float) -> Iterator[Parameter]:
    """Yield bias, scale and noise of known inputs, sizes (m,) being their root mean squares, and noise of states that are driven by it."""
    for i, (signal, size) in enumerate(zip(model.inputs, sizes, strict=True)):
        reference = float(size) or 1.0
        yield Parameter(Quantity.INPUT_BIAS, signal.name, (i,), 0.0, reference, signal.unit)
        if size > 0:
            yield Parameter(Quantity.INPUT_SCALE, signal.name, (i,), 1.0, _SCALE_SPREAD)
        yield Parameter(Quantity.INPUT_PSD, signal.name, (i,), (0.1 * reference) ** 2, _PSD_SPREAD, f"{_square(signal.unit)} s")
    for places in driven_states(model):
        names = " and ".join(model.state_names[i] for i in places)
        start = float((0.1 * prior_std[list(places)]) ** 2 @ np.ones(len(places))) / len(places) / duration
        yield Parameter(Quantity.STATE_PSD, names, places, start, _PSD_SPREAD, f"{_square(model.states[places[0]].unit)}/s")


def _square(unit: str) -> str:
    """Return the square of a unit: m^2, (m/s)^2, 1."""
    return f"({unit})^2" if "/" in unit or " " in unit else f"{unit}^2" if unit else "1"


def driven_states(model: Model) -> tuple[tuple[int, ...], ...]:
    """Return the states that have noise of their own: those that nothing moves and those that no noise would reach; x and y slip alike."""
    import casadi as ca

    n, names = len(model.states), model.state_names
    drift = model.drift if model.is_affine else ca.substitute(model.undisturbed_rate, model.u, ca.SX.zeros(model.u.numel()))
    B = model.B if model.is_affine else ca.jacobian(model.undisturbed_rate, model.u)
    moves = np.array(ca.DM(ca.jacobian(drift, model.x).sparsity(), 1).full()) != 0
    is_fed = np.array(ca.DM(ca.sum2(ca.DM(ca.sparsify(B).sparsity(), 1))).full()).ravel() != 0 if B.shape[1] else np.zeros(n, bool)
    is_constant = np.array([drift[i].is_zero() for i in range(n)]) & ~is_fed
    slip = tuple(names.index(name) for name in ("x", "y") if name in names)
    reached = is_fed | is_constant
    groups: list[tuple[int, ...]] = [(int(i),) for i in np.flatnonzero(is_constant)]
    while True:
        spreading = reached | (moves @ reached)
        if (spreading == reached).all():
            missing = np.flatnonzero(~reached)
            if not len(missing):
                break
            groups.append((int(missing[0]),))
            spreading[missing[0]] = True
        reached = spreading
    if len(slip) == 2 and not any(set(group) & set(slip) for group in groups):
        groups.append(slip)
    return tuple(groups)
