"""How exact a step of RK4 is where only inputs turn what moves the state: from the graph and the size of the inputs alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from threading import Lock
from typing import Any

import casadi as ca
import numpy as np

from obsdesign.dynamics.model import Model
from obsdesign.rank.graph import NotExactError, Ring, evaluate, instructions

_CACHE_SIZE = 64  # models that are remembered: trades memory for building a bound anew


@dataclass(frozen=True, eq=False)
class Quadrature:
    """Rates that within a step are functions of time, x'_i = g_i(z_0 + t z'), as z' is made of held inputs: RK4 is Simpson's rule.

    bound: magnitudes of (x, u, w), the larger ones inf, -> c of `error`, with g all rates and their slopes to z and w.
    """

    bound: ca.Function
    reach: np.ndarray  # (n,): how far a state gets at least from a start at 0, 0 for those that nothing moves, inf for others

    def error(self, x: np.ndarray, u: np.ndarray, w: np.ndarray) -> float:
        """Return c in |x_RK4 - x| <= c step^4 |x'| step, and the same for dx/dz and dx/dw, NaN where the graph gives no bound.

        c = max_i sup |d4 g_i / dt4| / (2880 sup |g_i|), the error of Simpson's rule; x (n,) at the start, u (m,), w (p,): the largest
        magnitudes.
        """
        (x_given, u_given, w_given), result, evaluate, lock = self._evaluation
        with lock:  # one at a time: the arrays are those of this function
            np.maximum(x, self.reach, out=x_given)
            u_given[:], w_given[:] = u, w
            evaluate()
            return float(result[0])

    @cached_property
    def _evaluation(self) -> tuple[list[np.ndarray], np.ndarray, Callable[[], None], Lock]:
        """Arrays that `bound` reads and writes, and what evaluates it: a call with arrays would take ten times as long."""
        buffer, evaluate = self.bound.buffer()
        arguments, result = [np.zeros(self.bound.numel_in(i)) for i in range(self.bound.n_in())], np.zeros(1)
        for i, values in enumerate(arguments):
            buffer.set_arg(i, memoryview(values))  # pyright: ignore
        buffer.set_res(0, memoryview(result))  # pyright: ignore
        return arguments, result, partial(_call, buffer, evaluate), Lock()


def _call(_: object, evaluate: Callable[[], None]) -> None:
    """Evaluate; the buffer has to be there for as long as what evaluates it."""
    evaluate()


@lru_cache(_CACHE_SIZE)
def quadrature_of(model: Model) -> Quadrature | None:
    """Return the bound of models whose rates depend on no state but those that held inputs alone move; None for others."""
    x = model.x
    rate = ca.densify(model.rate)
    by_inputs = [not ca.depends_on(rate[i], x) for i in range(x.numel())]
    input_driven = [i for i, is_by_inputs in enumerate(by_inputs) if is_by_inputs]
    others = [i for i, is_by_inputs in enumerate(by_inputs) if not is_by_inputs]
    if others and ca.depends_on(rate, x[others]):
        return None
    z, g = x[input_driven], rate[others]
    slopes = [ca.vec(ca.densify(ca.jacobian(g, value))) for value in (z, model.w)]
    functions = ca.vertcat(g, *slopes) if others else ca.SX(0, 1)
    fourth = functions
    for _ in range(4):
        fourth = ca.jtimes(fourth, z, rate[input_driven]) if others else fourth
    sizes = [ca.SX.sym(name, symbol.numel()) for name, symbol in (("x", x), ("u", model.u), ("w", model.w))]
    try:
        bounds = [_magnitude(value, [x, model.u, model.w], sizes) for value in (fourth, functions)]
    except NotExactError:
        return None
    reach = np.array([0.0 if rate[i].is_constant() and float(rate[i]) == 0 else np.inf for i in range(x.numel())])
    return Quadrature(ca.Function("bound", sizes, [_ratio(*bounds) / 2880]), reach)


def _ratio(fourth: ca.SX, size: ca.SX) -> ca.SX:
    """Return the largest of fourth_i / size_i, 0 where size_i = 0, NaN where any of them is not finite."""
    if not size.numel():
        return ca.SX(0)
    return ca.mmax(ca.if_else(size > 0, fourth / size, 0)) + 0 * ca.sum1(ca.vertcat(fourth, size))


def _magnitude(values: ca.SX, symbols: list[ca.SX], sizes: list[ca.SX]) -> ca.SX:
    """Return upper bounds of |values| (r, 1), made of the sizes of the symbols."""
    if not values.numel():
        return ca.SX(0, 1)
    steps = instructions(ca.Function("values", symbols, [ca.densify(values)]))
    return ca.vertcat(*evaluate(steps, [ca.vertsplit(size) if size.numel() else [] for size in sizes], _MAGNITUDES))


def _sum(a: Any, b: Any) -> Any:  # noqa: ANN401  # symbols
    return a + b


_MAGNITUDES = Ring(
    constant=lambda value: ca.SX(abs(value)),
    operations={
        ca.OP_ADD: _sum,
        ca.OP_SUB: _sum,
        ca.OP_MUL: lambda a, b: a * b,
        ca.OP_NEG: lambda a: a,
        ca.OP_SQ: lambda a: a * a,
        ca.OP_TWICE: lambda a: 2 * a,
        ca.OP_SIN: lambda _: ca.SX(1),
        ca.OP_COS: lambda _: ca.SX(1),
    },
)
