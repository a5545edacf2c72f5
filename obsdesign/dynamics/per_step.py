"""A system with time counted in steps, whatever their lengths: what is made of equal steps serves those of any length."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from obsdesign.dynamics.channel import Channel
from obsdesign.dynamics.model import AbstractSystem, Model
from obsdesign.dynamics.motion import AbstractMotion, AffineMotion, GeneralMotion
from obsdesign.errors import InputError
from obsdesign.signals import Signal
from obsdesign.trajectory import Trajectory

LENGTH = Signal("length of a step", "s")
_AT_SAMPLES = " at the samples"
_SHORTEST = 1e-150  # s, of a step: over none at all inputs move nothing


@dataclass(frozen=True)
class PerStepSystem(AbstractSystem):
    """dx/dk = dt g_0 + sum_i f_i (dt u_i) + sum_j g_j (dt w_j): k counts the steps, dt is the length of the step that is made.

    Known inputs (dt, dt u), unknown inputs dt w: control-affine as the system is, each step is one of length 1, also where dt = 0. What
    outputs contain of u follows as inputs that move nothing. Of another rate: dx/dk = dt rate(x, (dt u) / dt, (dt w) / dt).
    Sensors have a sample at every step; who asks says which of them are there.
    """

    system: AbstractSystem
    """The system with time in seconds."""
    has_arrived: bool = False
    """Whether samples that are asked for are there for certain, those of a log: no gate says how likely they are."""

    def _build(self) -> Model:
        import casadi as ca

        model, in_outputs = self.system.model, self.system.model.inputs_in_outputs
        return replace(
            model,
            motion=_affine_per_step(model) if model.is_affine else _general_per_step(model),
            inputs=(LENGTH, *(_integral_of(signal) for signal in model.inputs), *(_held(model.inputs[i]) for i in in_outputs)),
            u_of_outputs=ca.vertcat(ca.SX.sym("unused", 1 + len(model.inputs)), model.u[list(in_outputs)]) if in_outputs else None,
            unknown_inputs=tuple(_integral_of(signal) for signal in model.unknown_inputs),
            channels=tuple(self._channel(channel) for channel in model.channels),
            is_per_step=True,
        )

    def _channel(self, channel: Channel) -> Channel:
        import casadi as ca

        noise = replace(channel.noise, period=None if channel.rate is None else 1 / channel.rate)
        return replace(channel, rate=None, noise=replace(noise, gate=ca.SX(1)) if self.has_arrived else noise)


def _affine_per_step(model: Model) -> AffineMotion:
    import casadi as ca

    B = ca.horzcat(model.drift, model.B, ca.SX(model.x.numel(), len(model.inputs_in_outputs)))
    return AffineMotion(ca.SX(*model.drift.shape), B, model.G)


def _general_per_step(model: Model) -> AbstractMotion:
    """dt rate(x, (dt u) / dt, (dt w) / dt)."""
    import casadi as ca

    if model.period is not None:
        raise InputError(f"the system is a map over {model.period:g} s: it takes equal steps, of that or of whole multiples of it")
    m, held = len(model.inputs), len(model.inputs_in_outputs)
    u, w = ca.SX.sym("u", 1 + m + held), ca.SX.sym("w", len(model.unknown_inputs))
    length = ca.fmax(u[0], _SHORTEST)
    return GeneralMotion(u, w, u[0] * model.motion.at(u[1 : 1 + m] / length, w / length))


def _integral_of(signal: Signal) -> Signal:
    """The signal's integral over a step; of the same name, by which it is asked for."""
    return replace(signal, unit=f"{signal.unit} s".strip(), is_angle=False)


def _held(signal: Signal) -> Signal:
    """The signal as it is when a sample is taken."""
    return replace(signal, name=f"{signal.name}{_AT_SAMPLES}")


def held_columns(model: Model) -> list[int]:
    """Return which of a system's own inputs stand behind (dt, dt u) where time is counted in steps, as outputs contain them."""
    own = [name for name in model.input_names[1:] if not name.endswith(_AT_SAMPLES)] if model.is_per_step else []
    return [own.index(name.removesuffix(_AT_SAMPLES)) for name in model.input_names[1 + len(own) :]] if own else []


def system_along(
    system: AbstractSystem, path: Trajectory, is_sampling_given: bool = False, *, has_timed_errors: bool = False
) -> AbstractSystem:
    """Return the system as it is along equal steps, with time counted in steps along others.

    has_timed_errors: whether errors that are correlated in time may be so over times of any length.
    Raises InputError, along steps that are not equal, for such errors unless they may, and for sensors with a rate, unless it is given
    which samples there are.
    """
    if path.is_even or system.model.is_per_step:
        return system
    (require_timed if has_timed_errors else require_uncorrelated)(system.model)
    for channel in () if is_sampling_given else system.model.channels:
        if channel.rate is not None:
            raise InputError(
                f"sensor {channel.name!r} has a rate of {channel.rate:g} Hz: along steps of different lengths say which samples there are,"
                " by `samples` of a log or by `active`"
            )
    return PerStepSystem(system)


def require_uncorrelated(model: Model) -> None:
    """Raise InputError for a sensor whose errors are correlated from sample to sample."""
    for channel in model.channels:
        if channel.noise.correlation:
            raise InputError(
                f"sensor {channel.name!r} has errors of correlation {channel.noise.correlation:g} from sample to sample: along steps of"
                " different lengths posterior_information, filters, validate and Gramians of a log accept that; here `inflation` and"
                " `bias_floor` are"
            )


def require_timed(model: Model) -> None:
    """Raise InputError for a sensor whose errors are correlated from sample to sample, if it does not say how far those are apart."""
    for channel in model.channels:
        if channel.noise.correlation and channel.rate is None and channel.noise.period is None:
            raise InputError(
                f"sensor {channel.name!r} has errors of correlation {channel.noise.correlation:g} from sample to sample, and no rate:"
                " along steps of different lengths a rate must say over how long that is, 1 / rate"
            )


def scaled_inputs(path: Trajectory, model: Model) -> tuple[np.ndarray, np.ndarray]:
    """Return (dt, dt u) with what outputs contain of u (N, 1 + m + r), and dt w (N, p), w = 0 where the path does not tell it."""
    dt, p = path.lengths[:, None], len(model.unknown_inputs)
    return np.hstack([dt, dt * path.u, path.u[:, held_columns(model)]]), np.zeros((path.steps, p)) if path.w is None else dt * path.w
