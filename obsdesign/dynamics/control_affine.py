"""Any control-affine system, from CasADi expressions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

from obsdesign.arguments import validate_arguments
from obsdesign.dynamics.expressions import abbreviate, as_expression, require_dependence, require_expression
from obsdesign.dynamics.model import AbstractSystem, Model, columns
from obsdesign.dynamics.motion import AffineMotion
from obsdesign.dynamics.named_outputs import NamedOutputs
from obsdesign.dynamics.output_noise import OutputNoise, noise_from
from obsdesign.errors import InputError
from obsdesign.signals import Signal

if TYPE_CHECKING:
    import casadi as ca


@validate_arguments
@dataclass(frozen=True, eq=False)
class ControlAffineSystem(AbstractSystem):
    """A system of one's own, from CasADi SX expressions: xdot = drift + sum_i known_i u_i + sum_j unknown_j w_j, y = outputs.

    An output may bear the name of the state that it measures.
    Raises InputError for wrong shapes, repeated names, free symbols, outputs that do not depend on the state.
    """

    state: ca.SX
    """Symbols (n, 1) of the states."""
    names: tuple[str, ...]
    """Names of the n states."""
    drift: ca.SX | None = None
    """How the state moves without inputs (n, 1), in the unit of the state per second; None = not at all."""
    known: Mapping[str, ca.SX] = field(default_factory=dict)
    """Name of a known input -> the vector field (n, 1) that it multiplies."""
    unknown: Mapping[str, ca.SX] = field(default_factory=dict)
    """Name of an unknown input (a disturbance) -> the vector field (n, 1) that it multiplies."""
    outputs: Mapping[str, ca.SX] = field(default_factory=dict)
    """Name -> expression of the state, each one a sensor: a scalar, or a column (q, 1) of name_1, ..., name_q, which come together."""
    sigmas: Mapping[str, float] = field(default_factory=dict)
    """Name of an output -> standard deviation of one sample, in the output's unit; 1 where it is not named."""
    angles: tuple[str, ...] = ()
    """Names of states, outputs and entries of outputs that wrap to (-pi, pi] [rad]."""
    noises: Mapping[str, OutputNoise] = field(default_factory=dict)
    """Name of an output -> all that is to be said of its errors and of when its samples come; in place of a number in `sigmas`."""
    signals: Mapping[str, ca.SX] = field(default_factory=dict)
    """Name of a known input that outputs contain -> its symbol in them, such as a measured airspeed; an input that moves nothing need not
    be among `known`. A sample at t_k sees it as it is held from then on."""

    @classmethod
    def from_rate(  # noqa: PLR0917  # the fields of the record, in their order
        cls,
        state: ca.SX,
        names: Sequence[str],
        rate: ca.SX,
        known: Mapping[str, ca.SX] | None = None,
        unknown: Mapping[str, ca.SX] | None = None,
        outputs: Mapping[str, ca.SX] | None = None,
        sigmas: Mapping[str, float] | None = None,
        angles: Sequence[str] = (),
        noises: Mapping[str, OutputNoise] | None = None,
    ) -> ControlAffineSystem:
        """Return the system whose rate of change is one expression of the state and the inputs: xdot = rate.

        Arguments:
            state (n, 1): symbols of the states.
            names: names of the n states.
            rate (n, 1): expression of the symbols of states and inputs, affine in the inputs, in the unit of the state per second.
            known, unknown: name of an input -> its symbol.
            outputs, sigmas, angles, noises: as the fields of those names.
        Raises InputError where the rate is not affine in an input, and as the record itself does.
        """
        import casadi as ca

        known, unknown = dict(known or {}), dict(unknown or {})
        inputs = {**known, **unknown}
        symbols = ca.vertcat(*inputs.values()) if inputs else ca.SX(0, 1)
        slopes = ca.jacobian(rate, symbols)
        for j, name in enumerate(inputs):
            for i in range(rate.numel()):
                if ca.depends_on(slopes[i, j], symbols):
                    raise InputError(f"the rate of {names[i]} = {abbreviate(rate[i])} is not affine in {name!r}")
        drift = ca.substitute(rate, symbols, ca.SX.zeros(symbols.numel())) if inputs else rate
        column = {}
        for j, name in enumerate(inputs):
            unit = ca.SX([float(k == j) for k in range(len(inputs))])
            is_driven = ca.densify(ca.SX([float(slopes[i, j].nnz() > 0) for i in range(rate.numel())]))
            value = is_driven * (ca.substitute(rate, symbols, unit) - drift)
            # either may have rounded what constants make together
            column[name] = ca.densify(slopes[:, j]) if _constants_of(slopes[:, j]) <= _constants_of(rate) | {0.0, 1.0, -1.0} else value
        groups = [{name: column[name] for name in group} for group in (known, unknown)]
        seen = ca.vertcat(*(outputs or {}).values()) if outputs else ca.SX(0, 1)
        signals = {name: symbol for name, symbol in known.items() if ca.depends_on(seen, symbol)}
        rest = (dict(outputs or {}), dict(sigmas or {}), tuple(angles), dict(noises or {}), signals)
        return cls(state, tuple(names), drift, groups[0], groups[1], *rest)

    def __post_init__(self) -> None:
        import casadi as ca

        if not isinstance(self.state, ca.SX):
            raise InputError(f"state is {self.state!r}: must be a column of distinct SX symbols")
        n = self.state.numel()
        object.__setattr__(self, "names", tuple(self.names))
        object.__setattr__(self, "drift", ca.SX.zeros(n) if self.drift is None else as_expression("drift", self.drift))
        for group in ("known", "unknown", "outputs"):
            expressions = {name: as_expression(f"{group}[{name!r}]", value) for name, value in getattr(self, group).items()}
            object.__setattr__(self, group, expressions)
        object.__setattr__(self, "sigmas", dict(self.sigmas))
        object.__setattr__(self, "angles", tuple(self.angles))
        object.__setattr__(self, "noises", dict(self.noises))
        object.__setattr__(self, "signals", dict(self.signals))
        for name, symbol in self.signals.items():
            if not (isinstance(symbol, ca.SX) and symbol.is_scalar() and symbol.is_valid_input()):
                raise InputError(f"signals[{name!r}] is {symbol}: must be an SX symbol, one number")
        self._check()

    def _check(self) -> None:
        import casadi as ca

        n = self.state.numel()
        if not self.state.is_valid_input():
            raise InputError(f"state is {self.state}: must be a column of distinct SX symbols")
        self._named_outputs.require_names(self.state, self.names, (*self._inputs, *self.unknown))
        inputs = {**dict.fromkeys(self.known, "known input"), **dict.fromkeys(self.unknown, "unknown input")}
        for name, expression in {"drift": self.drift, **self.known, **self.unknown}.items():
            require_expression(f"field {name!r}" if name in inputs else name, expression, self.state, (n, 1), inputs)
        for name, expression in self.outputs.items():
            seen = ca.vertcat(self.state, *self.signals.values())
            require_expression(f"output {name!r}", expression, seen, (max(expression.shape[0], 1), 1), inputs)
            require_dependence(name, expression, self.state)
        self._named_outputs.require_noises(lambda what, expression, shape: require_expression(what, expression, self.state, shape, inputs))

    @property
    def _inputs(self) -> dict[str, ca.SX]:
        """Name of each known input -> its field, 0 of those that outputs alone contain."""
        import casadi as ca

        return {**self.known, **{name: ca.SX(self.state.numel(), 1) for name in self.signals if name not in self.known}}

    @property
    def _named_outputs(self) -> NamedOutputs:
        return NamedOutputs(self.outputs, self.sigmas, self.angles, self.noises)

    def _build(self) -> Model:
        import casadi as ca

        n = self.state.numel()
        return Model(
            x=self.state,
            states=tuple(Signal(name, is_angle=name in self.angles) for name in self.names),
            # __post_init__ replaced None by zeros
            motion=AffineMotion(self.drift, columns(list(self._inputs.values()), n), columns(list(self.unknown.values()), n)),  # pyright: ignore[reportArgumentType]
            inputs=tuple(Signal(name) for name in self._inputs),
            unknown_inputs=tuple(Signal(name) for name in self.unknown),
            channels=self._named_outputs.channels,
            u_of_outputs=ca.vertcat(*(self.signals.get(name, ca.SX.sym("unused")) for name in self._inputs)) if self.signals else None,
        )

    @cached_property
    def _key(self) -> tuple[object, ...]:
        """What two equal systems share, in a form that travels between processes."""
        import casadi as ca

        expressions = [self.drift, *self.known.values(), *self.unknown.values(), *self.outputs.values()]
        expressions += [expression for noise in self.noises.values() for expression in noise.expressions]
        graph = ca.Function("system", [self.state, ca.vertcat(*self.signals.values())], expressions).serialize()
        names = (self.names, tuple(self.known), tuple(self.unknown), tuple(self.outputs), tuple(self.signals))
        noises = tuple((name, noise.numbers) for name, noise in self.noises.items())
        return graph, names, tuple(sorted(self.sigmas.items())), self.angles, noises

    def __eq__(self, value: object) -> bool:
        return isinstance(value, ControlAffineSystem) and self._key == value._key

    def __hash__(self) -> int:
        return hash(self._key)

    def __reduce__(self) -> tuple[object, tuple[object, ...]]:
        return _restore, self._key

    def __dask_tokenize__(self) -> tuple[object, ...]:
        """What a dask executor knows an argument by; it cannot make that out of CasADi expressions."""
        return self._key


def _constants_of(expression: ca.SX) -> set[float]:
    import casadi as ca

    function = ca.Function("expression", ca.symvar(expression), [ca.densify(expression)])
    constants = (k for k in range(function.n_instructions()) if function.instruction_id(k) == ca.OP_CONST)
    return {function.instruction_constant(k) for k in constants}


def _restore(
    graph: str,
    names: tuple[tuple[str, ...], ...],
    sigmas: tuple[tuple[str, float], ...],
    angles: tuple[str, ...],
    noises: tuple[tuple[str, tuple[object, ...]], ...],
) -> ControlAffineSystem:
    import casadi as ca

    state_names, known_names, unknown_names, output_names, signal_names = names
    x = ca.vertcat(*(ca.SX.sym(name) for name in state_names))
    signals = {name: ca.SX.sym(name) for name in signal_names}
    values = iter(ca.Function.deserialize(graph).call([x, ca.vertcat(*signals.values())]))
    drift = next(values)
    groups = [{name: next(values) for name in group} for group in (known_names, unknown_names, output_names)]
    noise_of = {name: noise_from(numbers, values) for name, numbers in noises}
    system = ControlAffineSystem(x, state_names, drift, groups[0], groups[1], groups[2], dict(sigmas), angles, noise_of, signals)
    # the restored graph may be written in another order: its key stays the one it was made from
    object.__setattr__(system, "_key", (graph, names, sigmas, angles, noises))
    return system
