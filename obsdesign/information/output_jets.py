"""What outputs and their derivatives at one instant tell about the state there, along paths: unknown inputs and their derivatives free."""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise

import casadi as ca
import numpy as np

from obsdesign.calculus import lie_derivative
from obsdesign.dynamics.model import AbstractSystem, Model
from obsdesign.dynamics.step import CACHE_SIZE

_DEPENDENCE = 1e-10  # of the largest singular value of what unknown inputs do: less counts as 0


def default_orders(model: Model) -> int:
    """Return orders of derivatives that show n states by q outputs, p of which tell of unknown inputs, and two more."""
    n, q, p = len(model.states), len(model.outputs), len(model.unknown_inputs)
    return min(-(-n // max(q - p, 1)) + 1, 2 * n)


def output_jets(system: AbstractSystem, x: np.ndarray, u: np.ndarray, w: np.ndarray, orders: int, unit_time: float) -> np.ndarray:
    """Return the gradients (N, q (orders + 1), n) of what the outputs tell about the state at N states.

    Rows: R^-1/2 unit_time^k y_k, y_k the Taylor coefficient k of an output along the motion under inputs that are held. Of unknown inputs w
    and their derivatives nothing is known: rows are projected to what is at right angles to all that these change. NaN at a state where
    an output has no derivatives, such as on a landmark.

    x (N, n), u (N, m), w (N, p): where, in the units of states and inputs; unit_time [s].
    """
    model = system.model
    n, q, count = len(model.states), len(model.outputs), len(x)
    values = np.array(_jet_function(model, orders)(x.T, u.T, w.T))
    J = values.reshape(q * (orders + 1), count, -1).transpose(1, 0, 2) * (unit_time ** np.repeat(np.arange(orders + 1), q))[:, None]
    return _without(J[:, :, n:], J[:, :, :n])


def _without(J_w: np.ndarray, J_x: np.ndarray) -> np.ndarray:
    """Return J_x (N, r, n) projected to what is at right angles to the columns of J_w (N, r, c)."""
    if not J_w.shape[2]:
        return J_x
    has_value = np.isfinite(J_w).all(axis=(1, 2), keepdims=True)
    J_w = np.where(has_value, J_w, 0.0)
    U, sizes, _ = np.linalg.svd(J_w / np.maximum(np.linalg.norm(J_w, axis=1, keepdims=True), 1e-300), full_matrices=False)
    U = U * (sizes > _DEPENDENCE * sizes[:, :1])[:, None, :]
    return np.where(has_value, J_x - U @ (U.transpose(0, 2, 1) @ J_x), np.nan)


@lru_cache(CACHE_SIZE)
def _jet_function(model: Model, orders: int) -> ca.Function:
    """(x, u, w) -> Jacobian of the Taylor coefficients of the outputs by (x, w, w', ...), rows over the standard deviations."""
    p = len(model.unknown_inputs)
    jets = [model.w, *(ca.SX.sym(f"w{k}", p) for k in range(1, orders + 1))]
    coefficients = [model.h]
    for k in range(1, orders + 1):
        derivative = lie_derivative(coefficients[-1], model.x, model.rate)
        for jet, rate in pairwise(jets[: k + 1]) if p else ():
            derivative += lie_derivative(coefficients[-1], jet, rate)
        coefficients.append(derivative / k)
    arguments = ca.vertcat(model.x, *jets[:-1]) if p else model.x
    J = ca.jacobian(ca.vertcat(*coefficients), arguments)
    higher = ca.vertcat(*jets[1:])
    J = ca.substitute(J, higher, ca.SX.zeros(higher.numel())) if p else J
    deviations = ca.sqrt(ca.diag(model.instant_covariance))
    weighted = ca.densify(J / ca.repmat(deviations, orders + 1, J.shape[1]))
    return ca.Function("output_jets", [model.x, model.u, model.w], [weighted], {"cse": True})
