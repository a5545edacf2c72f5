"""A system reduced to one symbolic record."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

from obsdesign.checks import require_known
from obsdesign.signals import Point, Signal

if TYPE_CHECKING:
    import casadi as ca


@dataclass(frozen=True)
class Noise:
    """The errors of one sensor's samples: a first-order sequence of standard deviation `spread` and a constant one.

    spread: SX (1, 1) of the state, standard deviation of one sample of each output, `correlation` from one to the next;
    bias: standard deviation of the constant error; inflation: factor on spread; gate: SX (1, 1), share of samples that arrive.
    """

    spread: ca.SX
    gate: ca.SX
    inflation: float = 1.0
    bias: float = 0.0
    correlation: float = 0.0

    @property
    def variance(self) -> ca.SX:
        """R = inflation^2 spread^2 (1 + correlation) / (1 - correlation) + bias^2, for each sample as if independent."""
        factor = self.inflation**2 * (1 + self.correlation) / (1 - self.correlation)
        return factor * self.spread**2 + self.bias**2


@dataclass(frozen=True)
class Channel:
    """One sensor of a model: outputs h (q, 1) of the state, its noise, rate [Hz] and landmark [m].

    noise is what happens, `variance` what filters and information count for it: see `Noise`.
    """

    name: str
    outputs: tuple[Signal, ...]
    h: ca.SX
    noise: Noise
    rate: float | None = None
    landmark: Point | None = None


@dataclass(frozen=True, eq=False)
class Model:
    """xdot = drift + B u + G w, y = h(x), as CasADi expressions of the state symbol x (n, 1).

    B (n, m) holds the fields of the known inputs, G (n, p) those of the unknown ones; S channels; u (m, 1), w (p, 1) symbols.
    """

    x: ca.SX
    states: tuple[Signal, ...]
    drift: ca.SX
    inputs: tuple[Signal, ...]
    B: ca.SX
    unknown_inputs: tuple[Signal, ...]
    G: ca.SX
    channels: tuple[Channel, ...]
    u: ca.SX = field(init=False)
    w: ca.SX = field(init=False)

    def __post_init__(self) -> None:
        import casadi as ca

        # made once with the model: graphs of it that were built at different times fit together
        object.__setattr__(self, "u", ca.SX.sym("u", len(self.inputs)))
        object.__setattr__(self, "w", ca.SX.sym("w", len(self.unknown_inputs)))

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


class AbstractSystem(ABC):
    """Anything that can be analysed, designed for and filtered."""

    @cached_property
    def model(self) -> Model:
        """The symbolic record, built once; equal systems share it, and with it all that is made of its symbols."""
        return _model_of(self)

    @abstractmethod
    def _build(self) -> Model:
        """Return the symbolic record."""


@lru_cache(256)
def _model_of(system: AbstractSystem) -> Model:
    return system._build()


def columns(fields: list[ca.SX], n: int) -> ca.SX:
    """Return the fields (n, 1) side by side; (n, 0) without any."""
    import casadi as ca

    return ca.horzcat(*fields) if fields else ca.SX(n, 0)
