"""The outputs of a system of one's own: what they are called, how well they are measured, and what is refused of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from obsdesign.checks import require_known, require_positive
from obsdesign.dynamics.channel import Channel
from obsdesign.dynamics.output_noise import OutputNoise
from obsdesign.errors import InputError
from obsdesign.signals import Signal

if TYPE_CHECKING:
    import casadi as ca


class SymbolCheck(Protocol):
    """Raises InputError unless an expression has a shape and contains no symbols but those that it may."""

    def __call__(self, what: str, expression: ca.SX, shape: tuple[int, int]) -> None: ...


@dataclass(frozen=True, eq=False)
class NamedOutputs:
    """Name -> expression (q, 1) of each output, a sensor, with the fields of the system that tell of outputs."""

    outputs: Mapping[str, ca.SX]
    sigmas: Mapping[str, float]
    angles: tuple[str, ...]
    noises: Mapping[str, OutputNoise]

    @property
    def entries(self) -> tuple[str, ...]:
        """Names of all entries of all outputs."""
        return tuple(entry for name in self.outputs for entry in self._entries_of(name))

    @property
    def channels(self) -> tuple[Channel, ...]:
        """The sensors of the model."""
        return tuple(self._channel(name) for name in self.outputs)

    def require_names(self, state: ca.SX, names: Sequence[str], inputs: Sequence[str]) -> None:
        """Raise InputError unless each state, input and output has a name of its own; an output may bear that of the state it measures."""
        import casadi as ca

        if len(names) != state.numel():
            raise InputError(f"names has {len(names)} entries: the state has {state.numel()}")
        measured = {
            name
            for i, name in enumerate(names)
            if name in self.outputs and self.outputs[name].numel() == 1 and ca.is_equal(self.outputs[name], state[i])
        }
        all_names = [*names, *inputs, *(name for name in self.entries if name not in measured)]
        repeated = sorted({name for name in all_names if all_names.count(name) > 1})
        if repeated:
            raise InputError(f"the name {repeated[0]!r} is used twice: states, inputs and outputs need names of their own")
        require_known("angles", self.angles, (*names, *self.outputs, *self.entries))

    def require_noises(self, require: SymbolCheck) -> None:
        """Raise InputError for what sigmas and noises cannot say; require: what their expressions may be."""
        for group, names in (("sigmas", self.sigmas), ("noises", self.noises)):
            require_known(group, tuple(names), tuple(self.outputs))
        for name, sigma in self.sigmas.items():
            require_positive(f"{name}: sigma", sigma)
        for name, noise in self.noises.items():
            q = self.outputs[name].numel()
            if name in self.sigmas:
                raise InputError(f"noises: {name!r} is in sigmas, too: one of the two says how well it is measured")
            if isinstance(noise.bias_floor, tuple) and len(noise.bias_floor) != q:
                raise InputError(f"noises: bias_floor of {name!r} has {len(noise.bias_floor)} entries: the output has {q}")
            for what, expression, shapes in (("sigma", noise.noise.spread, ((1, 1), (q, 1))), ("gate", noise.noise.gate, ((1, 1),))):
                shape = expression.shape if expression.shape in shapes else shapes[-1]
                require(f"noises: {what} of {name!r}", expression, shape)

    def _entries_of(self, name: str) -> tuple[str, ...]:
        q = self.outputs[name].numel()
        return (name,) if q == 1 else tuple(f"{name}_{i + 1}" for i in range(q))

    def _channel(self, name: str) -> Channel:
        signals = tuple(Signal(entry, is_angle=entry in self.angles or name in self.angles) for entry in self._entries_of(name))
        noise = self.noises.get(name, OutputNoise(self.sigmas.get(name, 1.0)))
        return Channel(name, signals, self.outputs[name], noise.noise, noise.rate, noise.landmarks)
