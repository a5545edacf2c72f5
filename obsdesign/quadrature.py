"""How exact a step of RK4 is where only inputs turn what moves the state: from the graph and the size of the inputs alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from threading import Lock
from typing import Any

import casadi as ca
import numpy as np

from obsdesign.model import Model
from obsdesign.rank.graph import NotExactError, Ring, evaluate, instructions

_CACHED = 64


@dataclass(frozen=True, eq=False)
class Quadrature:
    """Rates that within a step are functions of time, x'_i = g_i(z_0 + t z'), as z' is made of held inputs: RK4 is Simpson's rule.

    bound: magnitudes of (x, u, w), the larger ones inf, -> sup |d4 g / dt4| and sup |g| (r,), g all rates and their slopes to z and w.
    """

    bound: ca.Function
    still: np.ndarray  # (n,) bool: states that nothing moves

    def reach(self, starts: np.ndarray) -> np.ndarray:
        """Return the largest magnitudes (M, n) that the states get to from starts (M, n): inf for those that anything moves."""
        return np.where(self.still, np.abs(starts), np.inf)

    def error(self, x: np.ndarray, u: np.ndarray, w: np.ndarray) -> float:
        """Return c in |x_RK4 - x| <= c step^4 |x'| step, and the same for dx/dz and dx/dw, NaN where the graph gives no bound.

        c = sup |d4 g / dt4| / (2880 sup |g|), the error of Simpson's rule; x (n,), u (m,), w (p,): the largest magnitudes.
        """
        fourth, size = self._bounds(x, u, w)
        if not (np.isfinite(fourth).all() and np.isfinite(size).all()):
            return float("nan")
        return float(np.max(np.divide(fourth, size, out=np.zeros_like(size), where=size > 0), initial=0.0)) / 2880

    def _bounds(self, *sizes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        given, results, evaluate, turn = self._evaluation
        with turn:  # one at a time: the arrays are those of this function
            for into, values in zip(given, sizes, strict=True):
                into[:] = values
            evaluate()
            return results[0].copy(), results[1].copy()

    @cached_property
    def _evaluation(self) -> tuple[list[np.ndarray], list[np.ndarray], Callable[[], None], Lock]:
        """Arrays that `bound` reads and writes, and what evaluates it: a call with arrays would take ten times as long."""
        buffer, evaluate = self.bound.buffer()
        given = [np.zeros(self.bound.numel_in(i)) for i in range(self.bound.n_in())]
        results = [np.zeros(self.bound.numel_out(j)) for j in range(self.bound.n_out())]
        for i, values in enumerate(given):
            buffer.set_arg(i, memoryview(values))  # pyright: ignore
        for j, values in enumerate(results):
            buffer.set_res(j, memoryview(values))  # pyright: ignore
        return given, results, partial(_evaluated, buffer, evaluate), Lock()


def _evaluated(_: object, evaluate: Callable[[], None]) -> None:
    """Evaluate; the buffer has to be there for as long as what evaluates it."""
    evaluate()


@lru_cache(_CACHED)
def quadrature_of(model: Model) -> Quadrature | None:
    """Return the bound of models whose rates depend on no state but those that held inputs alone move; None for others."""
    x = model.x
    rate = ca.densify(model.drift + model.B @ model.u + model.G @ model.w)
    by_inputs = [not ca.depends_on(rate[i], x) for i in range(x.numel())]
    turning = [i for i, alone in enumerate(by_inputs) if alone]
    others = [i for i, alone in enumerate(by_inputs) if not alone]
    if others and ca.depends_on(rate, x[others]):
        return None
    z, g = x[turning], rate[others]
    slopes = [ca.vec(ca.densify(ca.jacobian(g, value))) for value in (z, model.w)]
    functions = ca.vertcat(g, *slopes) if others else ca.SX(0, 1)
    fourth = functions
    for _ in range(4):
        fourth = ca.jtimes(fourth, z, rate[turning]) if others else fourth
    sizes = [ca.SX.sym(name, symbol.numel()) for name, symbol in (("x", x), ("u", model.u), ("w", model.w))]
    try:
        bounds = [_magnitude(value, [x, model.u, model.w], sizes) for value in (fourth, functions)]
    except NotExactError:
        return None
    still = np.array([rate[i].is_constant() and float(rate[i]) == 0 for i in range(x.numel())], dtype=bool)
    return Quadrature(ca.Function("bound", sizes, [ca.densify(each) for each in bounds]), still)


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
