"""Expressions in which what is computed twice is one node."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import casadi as ca


def without_repeats(expressions: Sequence[ca.SX]) -> list[ca.SX]:
    """Return the expressions with one node for what is computed twice: the same functions of the same symbols.

    CasADi 3.8.2 takes symbols of one name for one symbol there: with two symbols k, (k_1 + k_2) / (k_1 (a / a)) becomes
    (k_1 + k_2) / k_2. So symbols have names of their own meanwhile.
    """
    import casadi as ca

    symbols = ca.symvar(ca.veccat(*expressions))
    if len({symbol.name() for symbol in symbols}) == len(symbols):
        return ca.cse(list(expressions))
    unique_symbols = [ca.SX.sym(f"symbol {i}") for i in range(len(symbols))]
    renamed = ca.substitute(list(expressions), symbols, unique_symbols)
    return ca.substitute(ca.cse(renamed), unique_symbols, symbols)
