"""What systems of one's own share that are written as one expression of the state and of symbols for the inputs."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

from obsdesign.checks import require_known, require_positive
from obsdesign.dynamics.channel import Channel
from obsdesign.dynamics.expressions import abbreviate, as_expression, require_dependence
from obsdesign.dynamics.model import AbstractSystem, Model
from obsdesign.dynamics.motion import AbstractMotion
from obsdesign.dynamics.output_noise import OutputNoise, noise_from
from obsdesign.errors import InputError
from obsdesign.signals import Signal

if TYPE_CHECKING:
    import casadi as ca


@dataclass(frozen=True, eq=False)
class AbstractExpressionSystem(AbstractSystem):
    """A system whose motion and outputs are expressions of the symbols of its states and inputs."""

    state: ca.SX
    """Symbols (n, 1) of the states."""
    names: tuple[str, ...]
    """Names of the n states."""
    _: KW_ONLY
    inputs: Mapping[str, ca.SX] = field(default_factory=dict)
    """Name of a known input -> its symbol."""
    unknown: Mapping[str, ca.SX] = field(default_factory=dict)
    """Name of an unknown input (a disturbance) -> its symbol."""
    outputs: Mapping[str, ca.SX] = field(default_factory=dict)
    """Name -> expression of states and known inputs, each one a sensor: a scalar, or a column (q, 1) of name_1, ..., name_q, which come
    together. A sample at t_k sees the inputs as they are held from then on."""
    sigmas: Mapping[str, float] = field(default_factory=dict)
    """Name of an output -> standard deviation of one sample, in the output's unit; 1 where it is not named."""
    angles: tuple[str, ...] = ()
    """Names of states, outputs and entries of outputs that wrap to (-pi, pi] [rad]."""
    noises: Mapping[str, OutputNoise] = field(default_factory=dict)
    """Name of an output -> all that is to be said of its errors and of when its samples come; in place of a number in `sigmas`."""

    @property
    @abstractmethod
    def _motion(self) -> tuple[str, ca.SX]:
        """What the expression (n, 1) that moves the state is called, and that expression."""

    @abstractmethod
    def _motion_of(self, u: ca.SX, w: ca.SX, expression: ca.SX) -> AbstractMotion:
        """Return the motion by an expression of the symbols u and w."""

    def _normalise(self) -> None:
        """Make plain tuples and expressions of what was given, and check it."""
        import casadi as ca

        if not (isinstance(self.state, ca.SX) and self.state.is_valid_input()):
            raise InputError(f"state is {abbreviate(self.state)}: must be a column of distinct SX symbols")
        for group in ("inputs", "unknown"):
            for name, symbol in getattr(self, group).items():
                if not (isinstance(symbol, ca.SX) and symbol.is_scalar() and symbol.is_valid_input()):
                    raise InputError(f"{group}[{name!r}] is {abbreviate(symbol)}: must be an SX symbol, one number")
        object.__setattr__(self, "names", tuple(self.names))
        object.__setattr__(self, "angles", tuple(self.angles))
        for group in ("inputs", "unknown", "sigmas", "noises"):
            object.__setattr__(self, group, dict(getattr(self, group)))
        object.__setattr__(self, "outputs", {name: as_expression(f"outputs[{name!r}]", value) for name, value in self.outputs.items()})
        self._check_names()
        self._check_expressions()
        self._check_noises()

    def _check_names(self) -> None:
        import casadi as ca

        if len(self.names) != self.state.numel():
            raise InputError(f"names has {len(self.names)} entries: the state has {self.state.numel()}")
        measured = {
            name
            for i, name in enumerate(self.names)
            if name in self.outputs and self.outputs[name].numel() == 1 and ca.is_equal(self.outputs[name], self.state[i])
        }
        all_names = [*self.names, *self.inputs, *self.unknown, *(name for name in self._entries if name not in measured)]
        repeated = sorted({name for name in all_names if all_names.count(name) > 1})
        if repeated:
            raise InputError(f"the name {repeated[0]!r} is used twice: states, inputs and outputs need names of their own")
        require_known("angles", self.angles, (*self.names, *self.outputs, *self._entries))

    def _check_expressions(self) -> None:
        import casadi as ca

        symbols = ca.vertcat(self.state, *self.inputs.values(), *self.unknown.values())
        if len(ca.symvar(symbols)) != symbols.numel():
            raise InputError("state, inputs and unknown share a symbol: each state and each input needs a symbol of its own")
        what, motion = self._motion
        self._require_symbols(what, motion, (self.state.numel(), 1), {**self.inputs, **self.unknown})
        for name, expression in self.outputs.items():
            self._require_symbols(f"output {name!r}", expression, (max(expression.shape[0], 1), 1), self.inputs)
            require_dependence(name, expression, self.state)

    def _require_symbols(self, what: str, expression: ca.SX, shape: tuple[int, int], inputs: Mapping[str, ca.SX]) -> None:
        """Raise InputError unless the expression has the shape and contains no symbols but the state and those inputs."""
        import casadi as ca

        if expression.shape != shape:
            raise InputError(f"{what} has shape {expression.shape}: must be {shape}")
        accepted = ca.vertcat(self.state, *inputs.values())
        for symbol in ca.symvar(expression):
            if not ca.depends_on(symbol, accepted):
                unknown = [name for name, value in self.unknown.items() if ca.depends_on(symbol, value)]
                cause = (
                    f"the unknown input {unknown[0]!r}: make it a state, whose rate is unknown" if unknown else f"the free symbol {symbol}"
                )
                allowed = ", ".join((*self.names, *inputs))
                raise InputError(f"{what} = {abbreviate(expression)} contains {cause} (accepted: {allowed})")

    def _check_noises(self) -> None:
        for group in ("sigmas", "noises"):
            require_known(group, tuple(getattr(self, group)), tuple(self.outputs))
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
                self._require_symbols(f"noises: {what} of {name!r}", expression, shape, {})

    @property
    def _entries(self) -> tuple[str, ...]:
        """Names of all entries of all outputs."""
        return tuple(entry for name in self.outputs for entry in self._entries_of(name))

    def _entries_of(self, name: str) -> tuple[str, ...]:
        q = self.outputs[name].numel()
        return (name,) if q == 1 else tuple(f"{name}_{i + 1}" for i in range(q))

    def _channel(self, name: str) -> Channel:
        signals = tuple(Signal(entry, is_angle=entry in self.angles or name in self.angles) for entry in self._entries_of(name))
        noise = self.noises.get(name, OutputNoise(self.sigmas.get(name, 1.0)))
        return Channel(name, signals, self.outputs[name], noise.noise, noise.rate, noise.landmarks)

    def _build(self) -> Model:
        import casadi as ca

        u, w = (ca.vertcat(ca.SX(0, 1), *group.values()) for group in (self.inputs, self.unknown))
        return Model(
            x=self.state,
            states=tuple(Signal(name, is_angle=name in self.angles) for name in self.names),
            motion=self._motion_of(u, w, self._motion[1]),
            inputs=tuple(Signal(name) for name in self.inputs),
            unknown_inputs=tuple(Signal(name) for name in self.unknown),
            channels=tuple(self._channel(name) for name in self.outputs),
            u_of_outputs=u if self.inputs else None,
        )

    @cached_property
    def _key(self) -> tuple[object, ...]:
        """What two equal systems share, in a form that travels between processes."""
        import casadi as ca

        expressions = [self._motion[1], *self.outputs.values()]
        expressions += [expression for noise in self.noises.values() for expression in noise.expressions]
        symbols = [self.state, *(ca.vertcat(ca.SX(0, 1), *group.values()) for group in (self.inputs, self.unknown))]
        graph = ca.Function("system", symbols, expressions).serialize()
        names = (self.names, tuple(self.inputs), tuple(self.unknown), tuple(self.outputs))
        noises = tuple((name, noise.numbers) for name, noise in self.noises.items())
        return graph, names, tuple(sorted(self.sigmas.items())), self.angles, noises


def arguments_from(key: tuple[Any, ...]) -> tuple[ca.SX, dict[str, Any]]:
    """Return the expression that moves the state, and the other arguments, of the system with that key."""
    import casadi as ca

    graph, (state_names, input_names, unknown_names, output_names), sigmas, angles, noises = key
    x, u, w = (ca.vertcat(ca.SX(0, 1), *(ca.SX.sym(name) for name in group)) for group in (state_names, input_names, unknown_names))
    values = iter(ca.Function.deserialize(graph).call([x, u, w]))
    motion = next(values)
    arguments = {
        "state": x,
        "names": state_names,
        "inputs": {name: u[i] for i, name in enumerate(input_names)},
        "unknown": {name: w[i] for i, name in enumerate(unknown_names)},
        "outputs": {name: next(values) for name in output_names},
        "sigmas": dict(sigmas),
        "angles": angles,
        "noises": {name: noise_from(numbers, values) for name, numbers in noises},
    }
    return motion, arguments
