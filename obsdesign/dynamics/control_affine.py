"""Any control-affine system, from CasADi expressions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

from obsdesign.arguments import validate_arguments
from obsdesign.checks import require_known, require_positive
from obsdesign.dynamics.model import AbstractSystem, Channel, Model, Noise, columns
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
    """Name -> scalar expression of the state, each one a sensor."""
    sigmas: Mapping[str, float] = field(default_factory=dict)
    """Name of an output -> standard deviation of one sample, in the output's unit; 1 where it is not named."""
    angles: tuple[str, ...] = ()
    """Names of states and outputs that wrap to (-pi, pi] [rad]."""

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
    ) -> ControlAffineSystem:
        """Return the system whose rate of change is one expression of the state and the inputs: xdot = rate.

        Arguments:
            state (n, 1): symbols of the states.
            names: names of the n states.
            rate (n, 1): expression of the symbols of states and inputs, affine in the inputs, in the unit of the state per second.
            known, unknown: name of an input -> its symbol.
            outputs, sigmas, angles: as the fields of those names.
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
                    raise InputError(f"the rate of {names[i]} = {_abbreviate(rate[i])} is not affine in {name!r}")
        # values, not slopes: a derivative would round products of constants
        drift = ca.substitute(rate, symbols, ca.SX.zeros(symbols.numel())) if inputs else rate
        column = {}
        for j, name in enumerate(inputs):
            unit = ca.SX([float(k == j) for k in range(len(inputs))])
            is_driven = ca.densify(ca.SX([float(slopes[i, j].nnz() > 0) for i in range(rate.numel())]))
            column[name] = is_driven * (ca.substitute(rate, symbols, unit) - drift)
        groups = [{name: column[name] for name in group} for group in (known, unknown)]
        return cls(state, tuple(names), drift, groups[0], groups[1], dict(outputs or {}), dict(sigmas or {}), tuple(angles))

    def __post_init__(self) -> None:
        import casadi as ca

        if not isinstance(self.state, ca.SX):
            raise InputError(f"state is {self.state!r}: must be a column of distinct SX symbols")
        n = self.state.numel()
        object.__setattr__(self, "names", tuple(self.names))
        object.__setattr__(self, "drift", ca.SX.zeros(n) if self.drift is None else _as_expression("drift", self.drift))
        for group in ("known", "unknown", "outputs"):
            expressions = {name: _as_expression(f"{group}[{name!r}]", value) for name, value in getattr(self, group).items()}
            object.__setattr__(self, group, expressions)
        object.__setattr__(self, "sigmas", dict(self.sigmas))
        object.__setattr__(self, "angles", tuple(self.angles))
        self._check()

    def _check(self) -> None:
        import casadi as ca

        n = self.state.numel()
        if not self.state.is_valid_input():
            raise InputError(f"state is {self.state}: must be a column of distinct SX symbols")
        if len(self.names) != n:
            raise InputError(f"names has {len(self.names)} entries: the state has {n}")
        measured_states = {
            name for i, name in enumerate(self.names) if name in self.outputs and ca.is_equal(self.outputs[name], self.state[i])
        }
        all_names = [*self.names, *self.known, *self.unknown, *(name for name in self.outputs if name not in measured_states)]
        repeated = sorted({name for name in all_names if all_names.count(name) > 1})
        if repeated:
            raise InputError(f"the name {repeated[0]!r} is used twice: states, inputs and outputs need names of their own")
        inputs = {**dict.fromkeys(self.known, "known input"), **dict.fromkeys(self.unknown, "unknown input")}
        for name, expression in {"drift": self.drift, **self.known, **self.unknown}.items():
            _require_expression(f"field {name!r}" if name in inputs else name, expression, self.state, (n, 1), inputs)
        for name, expression in self.outputs.items():
            _require_expression(f"output {name!r}", expression, self.state, (1, 1), inputs)
            _require_dependence(name, expression, self.state)
        require_known("sigmas", tuple(self.sigmas), tuple(self.outputs))
        require_known("angles", self.angles, (*self.names, *self.outputs))
        for name, sigma in self.sigmas.items():
            require_positive(f"{name}: sigma", sigma)

    def _build(self) -> Model:
        import casadi as ca

        n = self.state.numel()
        signals = {name: Signal(name, is_angle=name in self.angles) for name in (*self.names, *self.outputs)}
        channels = tuple(
            Channel(name, (signals[name],), expression, Noise(ca.SX(self.sigmas.get(name, 1.0)), ca.SX(1)))
            for name, expression in self.outputs.items()
        )
        return Model(
            x=self.state,
            states=tuple(signals[name] for name in self.names),
            drift=self.drift,  # pyright: ignore[reportArgumentType]  # __post_init__ replaced None by zeros
            inputs=tuple(Signal(name) for name in self.known),
            B=columns(list(self.known.values()), n),
            unknown_inputs=tuple(Signal(name) for name in self.unknown),
            G=columns(list(self.unknown.values()), n),
            channels=channels,
        )

    @cached_property
    def _key(self) -> tuple[object, ...]:
        """What two equal systems share, in a form that travels between processes."""
        import casadi as ca

        expressions = [self.drift, *self.known.values(), *self.unknown.values(), *self.outputs.values()]
        graph = ca.Function("system", [self.state], expressions).serialize()
        names = (self.names, tuple(self.known), tuple(self.unknown), tuple(self.outputs))
        return graph, names, tuple(sorted(self.sigmas.items())), self.angles

    def __eq__(self, value: object) -> bool:
        return isinstance(value, ControlAffineSystem) and self._key == value._key

    def __hash__(self) -> int:
        return hash(self._key)

    def __reduce__(self) -> tuple[object, tuple[object, ...]]:
        return _restore, self._key

    def __dask_tokenize__(self) -> tuple[object, ...]:
        """What a dask executor knows an argument by; it cannot make that out of CasADi expressions."""
        return self._key


def _restore(
    graph: str, names: tuple[tuple[str, ...], ...], sigmas: tuple[tuple[str, float], ...], angles: tuple[str, ...]
) -> ControlAffineSystem:
    import casadi as ca

    state_names, known_names, unknown_names, output_names = names
    x = ca.vertcat(*(ca.SX.sym(name) for name in state_names))
    values = iter(ca.Function.deserialize(graph).call([x]))
    drift = next(values)
    groups = [{name: next(values) for name in group} for group in (known_names, unknown_names, output_names)]
    system = ControlAffineSystem(x, state_names, drift, groups[0], groups[1], groups[2], dict(sigmas), angles)
    # the restored graph may be written in another order: its key stays the one it was made from
    object.__setattr__(system, "_key", (graph, names, sigmas, angles))
    return system


def _as_expression(what: str, value: object) -> ca.SX:
    import casadi as ca

    try:
        return ca.SX(value)  # pyright: ignore[reportArgumentType, reportCallIssue]
    except NotImplementedError:
        raise InputError(f"{what} is {_abbreviate(value)}: must be a CasADi SX expression, such as casadi.vertcat(...) of some") from None


def _require_expression(what: str, expression: ca.SX, state: ca.SX, shape: tuple[int, int], inputs: Mapping[str, str]) -> None:
    """Raise InputError unless the expression has the shape and contains no symbols but the state; inputs: name -> what it is."""
    import casadi as ca

    if expression.shape != shape:
        raise InputError(f"{what} has shape {expression.shape}: must be {shape}")
    free = [symbol for symbol in ca.symvar(expression) if not ca.depends_on(symbol, state)]
    if free:
        name = free[0].name()
        cause = (
            f"the {inputs[name]} {name!r}: the rate must be affine in inputs, and outputs free of them"
            if name in inputs
            else f"the free symbol {name}"
        )
        state_names = ", ".join(sorted(symbol.name() for symbol in ca.symvar(state)))
        raise InputError(f"{what} = {_abbreviate(expression)} contains {cause}; only the state may appear ({state_names})")


def _abbreviate(expression: object) -> str:
    text = str(expression)
    return text if len(text) <= 80 else f"{text[:77]}..."


def _require_dependence(name: str, expression: ca.SX, state: ca.SX) -> None:
    import casadi as ca

    if not ca.depends_on(expression, state):
        raise InputError(f"output {name} does not depend on the state: {expression}")
