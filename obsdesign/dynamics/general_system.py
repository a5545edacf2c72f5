"""Any system in continuous time, its inputs in any place, from CasADi expressions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from obsdesign.arguments import validate_arguments
from obsdesign.dynamics.expression_system import AbstractExpressionSystem, arguments_from
from obsdesign.dynamics.expressions import as_expression
from obsdesign.dynamics.motion import GeneralMotion

if TYPE_CHECKING:
    import casadi as ca


@validate_arguments
@dataclass(frozen=True, eq=False, kw_only=True)
class GeneralSystem(AbstractExpressionSystem):
    """A system of one's own whose inputs stand in any place: xdot = rates(x, u, w), y = outputs(x, u), in CasADi SX expressions.

    Such as a vehicle whose input is an angle, an accelerometer, which reads inputs, a battery whose terminal voltage falls with the
    current. Time itself is a state whose rate is 1, known at the start (`observability(..., known_at_start=...)`). An output may bear
    the name of the state that it measures.
    Raises InputError for wrong shapes, repeated names and symbols, free symbols, unknown inputs in outputs, outputs that do not depend on
    the state.
    """

    rates: ca.SX
    """How the state moves (n, 1), an expression of states and inputs, in the unit of the state per second."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "rates", as_expression("rates", self.rates))
        self._normalise()

    @property
    def _motion(self) -> tuple[str, ca.SX]:
        return "rates", self.rates

    def _motion_of(self, u: ca.SX, w: ca.SX, expression: ca.SX) -> GeneralMotion:
        return GeneralMotion(u, w, expression)

    def __eq__(self, value: object) -> bool:
        return isinstance(value, GeneralSystem) and self._key == value._key

    def __hash__(self) -> int:
        return hash(self._key)

    def __reduce__(self) -> tuple[object, tuple[object, ...]]:
        return _restore, (self._key,)

    def __dask_tokenize__(self) -> tuple[object, ...]:
        """What a dask executor knows an argument by; it cannot make that out of CasADi expressions."""
        return self._key


def _restore(key: tuple[object, ...]) -> GeneralSystem:
    rates, arguments = arguments_from(key)
    system = GeneralSystem(rates=rates, **arguments)
    # the restored graph may be written in another order: its key stays the one it was made from
    object.__setattr__(system, "_key", key)
    return system
