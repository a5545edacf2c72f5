"""A system reduced to one symbolic record."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

from obsdesign.checks import require_known, whole_multiple
from obsdesign.display import AbstractDisplay, Summary
from obsdesign.dynamics.channel import Channel, JointNoise
from obsdesign.dynamics.motion import AbstractMotion, AffineMotion
from obsdesign.errors import InputError
from obsdesign.signals import Point, Signal

if TYPE_CHECKING:
    import casadi as ca
    import numpy as np


@dataclass(frozen=True, eq=False)
class Model:
    """xdot = rate(x, u, w), or x(t + period) = F(x, u, w), and y = h(x), as CasADi expressions of the state symbol x (n, 1).

    motion: affine in the inputs, xdot = drift + B u + G w, any rate, or a map; S channels; u (m, 1), w (p, 1) symbols of the known and
    unknown inputs.
    joint: groups of channels whose errors are correlated with each other, no channel in two of them. is_per_step: whether time is
    counted in steps, the first known input being their length [s]; see `PerStepSystem`. u_of_outputs (m, 1): symbols that stand for u in
    the channels' h, None where no output contains inputs; those of a sample at t_k are held from then on.
    """

    x: ca.SX
    states: tuple[Signal, ...]
    motion: AbstractMotion
    inputs: tuple[Signal, ...]
    unknown_inputs: tuple[Signal, ...]
    channels: tuple[Channel, ...]
    joint: tuple[JointNoise, ...] = ()
    is_per_step: bool = False
    u_of_outputs: ca.SX | None = None
    u: ca.SX = field(init=False)
    w: ca.SX = field(init=False)

    def __post_init__(self) -> None:
        import casadi as ca

        # made once with the model: graphs of it that were built at different times fit together
        object.__setattr__(self, "u", ca.SX.sym("u", len(self.inputs)))
        object.__setattr__(self, "w", ca.SX.sym("w", len(self.unknown_inputs)))
        object.__setattr__(self, "motion", self.motion.with_symbols(self.u, self.w))
        if self.u_of_outputs is not None:
            h = [ca.substitute(channel.h, self.u_of_outputs, self.u) for channel in self.channels]
            object.__setattr__(self, "channels", tuple(replace(each, h=value) for each, value in zip(self.channels, h, strict=True)))
            object.__setattr__(self, "u_of_outputs", self.u)

    @property
    def period(self) -> float | None:
        """Length of a step [s] of a model that is a map from one instant to the next; None where time is continuous."""
        return self.motion.period

    def periods_in(self, step: float) -> int:
        """Return how many periods of a map a step [s] is made of; raise InputError where that is no whole number."""
        count = None if self.period is None else whole_multiple(step, self.period)
        if count is None:
            raise InputError(f"step is {step!r}: the system is a map over {self.period:g} s, a step must be that or a whole multiple of it")
        return count

    @cached_property
    def rate(self) -> ca.SX:
        """xdot (n, 1), an expression of x, u, w. Raises InputError for a map."""
        if self.period is not None:
            raise InputError(f"the system is a map from one instant to the next, {self.period:g} s later: one in continuous time is needed")
        return self.motion.at(self.u, self.w)

    @cached_property
    def undisturbed_rate(self) -> ca.SX:
        """The rate with w = 0."""
        import casadi as ca

        if isinstance(self.motion, AffineMotion):
            return self.motion.drift + self.motion.B @ self.u
        return ca.substitute(self.rate, self.w, ca.SX.zeros(self.w.numel())) if self.unknown_inputs else self.rate

    @property
    def is_affine(self) -> bool:
        """Whether the motion is written as fields, xdot = drift + B u + G w."""
        return isinstance(self.motion, AffineMotion)

    @cached_property
    def fields(self) -> AffineMotion:
        """drift, B and G. Raises InputError, which names the input, where the rate is not affine in the inputs."""
        return self.motion.affine(self.state_names, (*self.input_names, *(signal.name for signal in self.unknown_inputs)))

    @property
    def drift(self) -> ca.SX:
        """The rate (n, 1) without inputs, of rates that are affine in these."""
        return self.fields.drift

    @property
    def B(self) -> ca.SX:
        """The fields (n, m) of the known inputs, of rates that are affine in inputs."""
        return self.fields.B

    @property
    def G(self) -> ca.SX:
        """The fields (n, p) of the unknown inputs, of rates that are affine in inputs."""
        return self.fields.G

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
    def output_owner(self) -> tuple[int, ...]:
        """For each output the index of its sensor."""
        return tuple(i for i, channel in enumerate(self.channels) for _ in channel.outputs)

    @property
    def output_bias(self) -> tuple[float, ...]:
        """For each output the standard deviation of its constant error."""
        return tuple(bias for channel in self.channels for bias in channel.noise.biases(len(channel.outputs)))

    @property
    def h(self) -> ca.SX:
        """All outputs stacked (q, 1)."""
        import casadi as ca

        return ca.vertcat(*(channel.h for channel in self.channels))

    @property
    def landmarks(self) -> tuple[Point, ...]:
        """Distinct points that sensors look at."""
        return tuple(dict.fromkeys(point for channel in self.channels for point in channel.landmarks))

    @cached_property
    def inputs_in_outputs(self) -> tuple[int, ...]:
        """Places of the known inputs that outputs contain."""
        import casadi as ca

        if self.u_of_outputs is None or not self.outputs:
            return ()
        return tuple(i for i, is_there in enumerate(ca.which_depends(self.h, self.u, 1, False)) if is_there)

    @property
    def noise_scale(self) -> ca.SX | float:
        """What multiplies the root of a power spectral density [unit^2/s] of a step: dt^1/2 where time is counted in steps, else 1."""
        import casadi as ca

        return ca.sqrt(self.u[0]) if self.is_per_step else 1.0

    @property
    def speed(self) -> ca.SX:
        """|v| of the states x and y, as they move without disturbance [m/s]; the way of a step [m] where time is counted in steps."""
        import casadi as ca

        rate = self.undisturbed_rate
        # not 0: the root keeps a derivative there
        return ca.sqrt(ca.sumsqr(rate[[self.state_names.index(name) for name in ("x", "y")]]) + 1e-300)

    @property
    def outputs_of(self) -> dict[str, tuple[int, ...]]:
        """For each sensor where its outputs stand among all."""
        return {channel.name: tuple(j for j, i in enumerate(self.output_owner) if i == s) for s, channel in enumerate(self.channels)}

    @property
    def instant_covariance(self) -> ca.SX:
        """Covariance (q, q) of the first-order parts of all outputs at one instant, sparse: diagonal but for joint noise."""
        import casadi as ca

        R = ca.diag(ca.vertcat(*[ca.SX.ones(len(sensor.outputs)) * sensor.noise.stationary_variance for sensor in self.channels]))
        inflation = {channel.name: channel.noise.inflation for channel in self.channels}
        for group in self.joint:
            indices = [j for name in group.sensors for j in self.outputs_of[name]]
            factor = [inflation[name] for name in group.sensors for _ in self.outputs_of[name]]
            for a, row in enumerate(group.covariance):
                for b, value in enumerate(row):
                    if value:
                        R[indices[a], indices[b]] = factor[a] * factor[b] * value
        return R

    @property
    def correlation_root(self) -> np.ndarray:
        """Lower triangular L (q, q), L L' the correlation of all outputs' first-order parts at one instant: errors are spread (L white)."""
        import numpy as np

        correlation = np.eye(len(self.outputs))
        for group in self.joint:
            indices = [j for name in group.sensors for j in self.outputs_of[name]]
            R = np.array(group.covariance)
            correlation[np.ix_(indices, indices)] = R / np.sqrt(np.outer(np.diag(R), np.diag(R)))
        return np.linalg.cholesky(correlation)

    def only(self, sensors: Sequence[str]) -> Model:
        """Return the model with the named sensors alone; of joint noise what is theirs."""
        require_known("the system", sensors, self.sensor_names)
        channels = tuple(channel for channel in self.channels if channel.name in sensors)
        return replace(
            self, channels=channels, joint=tuple(_subset(self, group, sensors) for group in self.joint if set(group.sensors) & set(sensors))
        )


def _subset(model: Model, group: JointNoise, sensors: Sequence[str]) -> JointNoise:
    """The group without the sensors that are not named."""
    names = [name for name in group.sensors if name in sensors]
    owner = [name for name in group.sensors for _ in model.outputs_of[name]]
    indices = [i for i, name in enumerate(owner) if name in names]
    return JointNoise(tuple(names), tuple(tuple(group.covariance[i][j] for j in indices) for i in indices))


class AbstractSystem(AbstractDisplay):
    """Anything that can be analysed, designed for and filtered."""

    @cached_property
    def model(self) -> Model:
        """The symbolic record, built once; equal systems share it, and with it all that is made of its symbols."""
        return _model_of(self)

    @abstractmethod
    def _build(self) -> Model:
        """Return the symbolic record."""

    def _summary(self) -> Summary:
        model = self.model
        rows = [
            ("states", ", ".join(f"{state.name} [{state.unit}]" if state.unit else state.name for state in model.states)),
            ("inputs", ", ".join(signal.name for signal in model.inputs) or "none"),
            ("unknown inputs", ", ".join(signal.name for signal in model.unknown_inputs) or "none"),
            ("sensors", ", ".join(channel.name for channel in model.channels) or "none"),
            *_formula_rows(model),
        ]
        return Summary(f"system of {len(model.states)} states", tuple(rows))


def _formula_rows(model: Model) -> Iterator[tuple[str, str]]:
    """Rates, or next values, and outputs as formulas, where all of them are short."""
    import casadi as ca

    from obsdesign.formulas.casadi_text import formulas_of

    symbols = ca.vertcat(model.x, model.u, model.w)
    names = (*model.state_names, *model.input_names, *(signal.name for signal in model.unknown_inputs))
    moved, seen = (formulas_of(expression, symbols, names) for expression in (model.motion.at(model.u, model.w), model.h))
    mark = "'" if model.period is None else "+"
    yield from ((f"{name}{mark}", formula) for name, formula in zip(model.state_names, moved or (), strict=False))
    yield from ((signal.name, formula) for signal, formula in zip(model.outputs, seen or (), strict=False))


@lru_cache(256)
def _model_of(system: AbstractSystem) -> Model:
    return system._build()


def columns(fields: list[ca.SX], n: int) -> ca.SX:
    """Return the fields (n, 1) side by side; (n, 0) without any."""
    import casadi as ca

    return ca.horzcat(*fields) if fields else ca.SX(n, 0)
