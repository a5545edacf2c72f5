"""A loop inside a step: what is computed again and again before the rest of the step, such as sub-steps, without a copy for each round."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from obsdesign.common_subexpressions import without_repeats


@dataclass(frozen=True, eq=False)
class InnerLoop:
    """z_0 = start, z_j+1 = z_next(z_j) for `rounds` rounds; what a step is made of then depends on z_rounds.

    z, z_next and start (r, 1): the last an expression of the step's own symbols. end (r, 1): the symbols that stand for z_rounds.
    """

    rounds: int
    z: ca.SX
    z_next: ca.SX
    start: ca.SX
    end: ca.SX

    def substitute(self, old: ca.SX, new: ca.SX) -> InnerLoop:
        """Return the loop that starts with `new` in place of the step's symbols `old`."""
        return replace(self, start=ca.substitute(self.start, old, new))

    def restricted_to(self, outputs: Sequence[ca.SX]) -> InnerLoop:
        """Return the loop of those entries alone on which the outputs depend, if only through the entries of earlier rounds."""
        is_needed = np.array(ca.which_depends(ca.vertcat(*map(ca.vec, outputs)), self.end, 1, False), dtype=bool)
        depends_on = np.array(ca.DM(ca.jacobian_sparsity(self.z_next, self.z), 1)).astype(bool)
        while True:
            is_wanted = is_needed | depends_on[is_needed].any(axis=0)
            if (is_wanted == is_needed).all():
                break
            is_needed = is_wanted
        entries = np.flatnonzero(is_needed).tolist()
        z, z_next, start, end = (column[entries] for column in (self.z, self.z_next, self.start, self.end))
        return InnerLoop(self.rounds, z, z_next, start, end)


@dataclass(frozen=True, eq=False)
class LoopedFunction:
    """A function with a loop inside; operations: how many one call takes; source_operations: how many its source has."""

    function: ca.Function
    operations: int
    source_operations: int


def function_with_loop(name: str, symbols: Sequence[ca.SX], outputs: Sequence[ca.SX], loop: InnerLoop) -> LoopedFunction:
    """Return symbols -> outputs, which depend on the end of the loop as well."""
    loop = loop.restricted_to(outputs)
    first = ca.Function("first", [*symbols], [ca.densify(loop.start)])
    body = ca.Function("body", [loop.z], without_repeats([ca.densify(loop.z_next)]))
    rest = ca.Function("rest", [*symbols, loop.end], [*outputs])
    arguments = [ca.MX.sym(f"argument_{i}", *symbol.shape) for i, symbol in enumerate(symbols)]
    end = body.fold(loop.rounds)(first(*arguments))
    function = ca.Function(name, arguments, rest.call([*arguments, end]))
    once = first.n_instructions() + rest.n_instructions()
    return LoopedFunction(function, once + loop.rounds * body.n_instructions(), once + body.n_instructions())
