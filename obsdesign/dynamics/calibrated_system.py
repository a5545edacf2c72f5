"""A system with sensors and inputs as they were found to be."""

from __future__ import annotations

from dataclasses import dataclass, replace

from obsdesign.dynamics.channel import Channel
from obsdesign.dynamics.model import AbstractSystem, Model
from obsdesign.dynamics.motion import AbstractMotion, AffineMotion, moved_with


@dataclass(frozen=True)
class OutputFit:
    """y = scale h(x) + bias + factor times the error that was stated."""

    bias: float = 0.0
    scale: float = 1.0
    factor: float = 1.0


@dataclass(frozen=True)
class SensorFit:
    """What was found of a sensor's outputs, and how much more than once its inflation is."""

    name: str
    outputs: tuple[OutputFit, ...]
    inflation: float = 1.0


@dataclass(frozen=True)
class InputFit:
    """A reading of an input is scale u + bias."""

    name: str
    bias: float = 0.0
    scale: float = 1.0


@dataclass(frozen=True)
class CalibratedSystem(AbstractSystem):
    """A system whose sensors read scale h(x) + bias with other errors, and that moves by (u - bias) / scale where u is read.

    xdot = g_0 + sum_i f_i (u_i - b_i) / s_i + sum_j g_j w_j, and so in rates of any form. Sensors and
    inputs that are not named are as they were.
    """

    system: AbstractSystem
    """The system as it was stated."""
    sensors: tuple[SensorFit, ...] = ()
    """What was found of sensors."""
    inputs: tuple[InputFit, ...] = ()
    """What was found of known inputs."""

    def _build(self) -> Model:
        model = self.system.model
        fits = {fit.name: fit for fit in self.sensors}
        channels = tuple(_channel_with(channel, fits[channel.name]) if channel.name in fits else channel for channel in model.channels)
        return replace(model, motion=_moved_by_readings(model, self.inputs), channels=channels)


def _moved_by_readings(model: Model, inputs: tuple[InputFit, ...]) -> AbstractMotion:
    import casadi as ca

    if not model.is_affine:
        u = ca.SX(model.u)  # a copy, of the same symbols
        for fit in inputs:
            place = model.input_names.index(fit.name)
            u[place] = (u[place] - fit.bias) / fit.scale
        return moved_with(model.motion, inputs=(model.u, model.w), values=(u, model.w), below=ca.SX(0, 1))
    drift, fields = model.drift, ca.horzsplit(model.B) if model.B.shape[1] else []
    for fit in inputs:
        place = model.input_names.index(fit.name)
        fields[place] = fields[place] / fit.scale
        drift = drift - fit.bias * fields[place]
    return AffineMotion(drift, ca.horzcat(*fields) if fields else model.B, model.G)


def _channel_with(channel: Channel, fit: SensorFit) -> Channel:
    import casadi as ca

    scales, biases, factors = (ca.DM([getattr(output, name) for output in fit.outputs]) for name in ("scale", "bias", "factor"))
    is_common = len({output.factor for output in fit.outputs}) == 1
    spread = channel.noise.spread * (fit.outputs[0].factor if is_common else factors)
    noise = replace(channel.noise, spread=spread, inflation=fit.inflation * channel.noise.inflation)
    return replace(channel, h=scales * channel.h + biases, noise=noise)
