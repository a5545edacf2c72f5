"""How the parameters of a path family become inputs, with derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from obsdesign.dynamics.step import CACHE_SIZE
from obsdesign.paths.abstract import AbstractPath, Grid


@dataclass(frozen=True, eq=False)
class InputMap:
    """How parameters become inputs: u (N, m), du/dp (N, m, q), and the Hessian of weights'u; margins of the rates of change."""

    value: ca.Function
    jacobian: ca.Function
    hessian: ca.Function
    rates: ca.Function
    is_linear: bool

    @cached_property
    def line(self) -> tuple[np.ndarray, np.ndarray]:
        """Offset (N m,) and slope (N m, q) of inputs that are linear in their parameters."""
        nowhere = np.zeros(self.value.size1_in(0))
        offset_and_slope = self.value(nowhere).full().ravel(), self.jacobian(nowhere).full()
        for values in offset_and_slope:
            values.flags.writeable = False  # they are shared
        return offset_and_slope


@lru_cache(CACHE_SIZE)
def input_map_of(path: AbstractPath, grid: Grid) -> InputMap:
    """Return the functions of a path family on a grid; inputs row by row, all of a step side by side."""
    p = ca.SX.sym("p", len(path.box(grid)[0]))
    u = ca.vec(ca.SX(path.inputs(p, grid)).T)
    weights, jacobian = ca.SX.sym("weights", u.numel()), ca.jacobian(u, p)
    rates = ca.SX(path.rates(p, grid))
    is_linear = not ca.depends_on(jacobian, p)
    hessian = ca.SX(p.numel(), p.numel()) if is_linear else ca.hessian(ca.dot(weights, u), p)[0]
    return InputMap(
        ca.Function("u", [p], [ca.densify(u)]),
        ca.Function("slope", [p], [ca.densify(jacobian)]),
        ca.Function("bend", [p, weights], [ca.densify(hessian)]),
        ca.Function("rates", [p], [ca.densify(ca.vec(rates)), ca.densify(ca.jacobian(ca.vec(rates), p))]),
        is_linear,
    )
