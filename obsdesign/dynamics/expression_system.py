"""What systems of one's own share that are written as one expression of the state and of symbols for the inputs."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

from obsdesign.dynamics.expressions import abbreviate, as_expression, require_dependence
from obsdesign.dynamics.model import AbstractSystem, Model
from obsdesign.dynamics.motion import AbstractMotion
from obsdesign.dynamics.named_outputs import NamedOutputs
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
        self._named_outputs.require_names(self.state, self.names, (*self.inputs, *self.unknown))
        self._check_expressions()
        self._named_outputs.require_noises(partial(self._require_symbols, inputs={}))

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

    @property
    def _named_outputs(self) -> NamedOutputs:
        return NamedOutputs(self.outputs, self.sigmas, self.angles, self.noises)

    def _build(self) -> Model:
        import casadi as ca

        u, w = (ca.vertcat(ca.SX(0, 1), *group.values()) for group in (self.inputs, self.unknown))
        return Model(
            x=self.state,
            states=tuple(Signal(name, is_angle=name in self.angles) for name in self.names),
            motion=self._motion_of(u, w, self._motion[1]),
            inputs=tuple(Signal(name) for name in self.inputs),
            unknown_inputs=tuple(Signal(name) for name in self.unknown),
            channels=self._named_outputs.channels,
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
