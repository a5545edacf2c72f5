"""Expressions that a caller gives: what they may be, and what they may contain."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from obsdesign.errors import InputError

if TYPE_CHECKING:
    import casadi as ca


def as_expression(what: str, value: object) -> ca.SX:
    """Return value as an SX expression, or raise InputError."""
    import casadi as ca

    try:
        return ca.SX(value)  # pyright: ignore[reportArgumentType, reportCallIssue]
    except NotImplementedError:
        raise InputError(f"{what} is {abbreviate(value)}: must be a CasADi SX expression, such as casadi.vertcat(...) of some") from None


def require_expression(what: str, expression: ca.SX, state: ca.SX, shape: tuple[int, int], inputs: Mapping[str, str]) -> None:
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
        raise InputError(f"{what} = {abbreviate(expression)} contains {cause}; only the state may appear ({state_names})")


def abbreviate(expression: object) -> str:
    """Return the expression as text, its end left out where it is long."""
    text = str(expression)
    return text if len(text) <= 80 else f"{text[:77]}..."


def require_dependence(name: str, expression: ca.SX, state: ca.SX) -> None:
    """Raise InputError where an output does not depend on the state."""
    import casadi as ca

    if not ca.depends_on(expression, state):
        raise InputError(f"output {name} does not depend on the state: {expression}")
