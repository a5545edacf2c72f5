"""Any system in discrete time: a map from one instant to the next, from CasADi expressions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from obsdesign.arguments import validate_arguments
from obsdesign.checks import require_positive
from obsdesign.dynamics.expression_system import AbstractExpressionSystem, arguments_from
from obsdesign.dynamics.expressions import as_expression
from obsdesign.dynamics.motion import MapMotion

if TYPE_CHECKING:
    import casadi as ca


@validate_arguments
@dataclass(frozen=True, eq=False, kw_only=True)
class DiscreteSystem(AbstractExpressionSystem):
    """A system of one's own in discrete time: x(t + period) = next_state(x, u, w), y = outputs(x, u), in CasADi SX expressions.

    Along a path its steps are the period, or whole multiples of it with inputs held. An output may bear the name of the state that it
    measures.
    Raises InputError for wrong shapes, repeated names and symbols, free symbols, unknown inputs in outputs, outputs that do not depend on
    the state, and a period that is no number above 0.
    """

    next_state: ca.SX
    """The state a period later (n, 1), an expression of states and inputs, in the units of the states."""
    period: float
    """Length of a step [s]."""

    def __post_init__(self) -> None:
        require_positive("period", self.period)
        object.__setattr__(self, "next_state", as_expression("next_state", self.next_state))
        self._normalise()

    @property
    def _motion(self) -> tuple[str, ca.SX]:
        return "next_state", self.next_state

    def _motion_of(self, u: ca.SX, w: ca.SX, expression: ca.SX) -> MapMotion:
        return MapMotion(u, w, expression, self.period)

    def __eq__(self, value: object) -> bool:
        return isinstance(value, DiscreteSystem) and (self.period, self._key) == (value.period, value._key)

    def __hash__(self) -> int:
        return hash((self.period, self._key))

    def __reduce__(self) -> tuple[object, tuple[object, ...]]:
        return _restore, (self.period, self._key)

    def __dask_tokenize__(self) -> tuple[object, ...]:
        """What a dask executor knows an argument by; it cannot make that out of CasADi expressions."""
        return (self.period, *self._key)


def _restore(period: float, key: tuple[object, ...]) -> DiscreteSystem:
    next_state, arguments = arguments_from(key)
    system = DiscreteSystem(next_state=next_state, period=period, **arguments)
    # the restored graph may be written in another order: its key stays the one it was made from
    object.__setattr__(system, "_key", key)
    return system
