"""Inputs of a path of which only the states are known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.calculus import wrap_columns
from obsdesign.dynamics.model import AbstractSystem
from obsdesign.dynamics.simulation import substeps_along
from obsdesign.dynamics.step import step_of
from obsdesign.trajectory import Trajectory

_MAX_ITERATIONS = 30  # Gauss-Newton steps at most; rates are affine in the inputs, steps nearly so, so that few are needed


@dataclass(frozen=True, eq=False)
class RecoveredInputs:
    """u (N, m), held over each step, and by how much (N, n) each step that they make misses the next state."""

    u: np.ndarray
    mismatch: np.ndarray


def recover_inputs(system: AbstractSystem, x: np.ndarray, dt: float) -> RecoveredInputs:
    """Return the inputs that lead from each state of x (N+1, n) to the next one in dt [s].

    argmin over u_k of |x_k+1 - step(x_k, u_k)|^2 by Gauss and Newton, unknown inputs taken as 0; of steps made of as many
    sub-steps as those inputs need.
    """
    recovered = _gauss_newton(system, x, dt, 1)
    substeps = substeps_along(system, Trajectory(np.arange(len(x)) * dt, x, recovered.u)) if np.isfinite(recovered.u).all() else 1
    return recovered if substeps == 1 else _gauss_newton(system, x, dt, substeps)


def _gauss_newton(system: AbstractSystem, x: np.ndarray, dt: float, substeps: int) -> RecoveredInputs:
    import casadi as ca

    model = system.model
    step = step_of(model, dt, substeps).without_disturbance()
    step_function = ca.Function("one", [step.x, step.u], [step.x_next, ca.densify(ca.jacobian(step.x_next, step.u))])
    n, m, steps = x.shape[1], len(model.inputs), len(x) - 1
    angles = np.array([signal.is_angle for signal in model.states])
    all_steps, u = step_function.map(steps), np.zeros((steps, m))

    def evaluate() -> tuple[np.ndarray, np.ndarray]:
        """Return by how much each next state is missed (N, n), and its derivatives (n, N, m)."""
        after, slopes = (np.array(value) for value in all_steps(x[:-1].T, u.T))
        return wrap_columns(x[1:] - after.T, angles), slopes.reshape(n, steps, m).transpose(1, 0, 2)

    residual, slopes = evaluate()
    for _ in range(_MAX_ITERATIONS if m else 0):
        change = np.einsum("kmn,kn->km", np.linalg.pinv(slopes), residual)
        u = u + change
        residual, slopes = evaluate()
        if np.abs(change).max() <= 1e-13 * max(1.0, float(np.abs(u).max())):
            break
    return RecoveredInputs(u, residual)
