"""What several test files compare with: a vehicle whose steps do not commute, its law in plain NumPy, and derivatives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np

import obsdesign as od
from obsdesign.vehicles.abstract import HEADING, TURN_RATE, AbstractVehicle, Fields, X, Y

BEACON = (40.0, 25.0)
SENSORS = (od.GPS(2.0), od.Magnetometer(0.21), od.Range(BEACON, 1.0), od.Bearing(BEACON, 0.087))
NAMES = ("gps", "magnetometer", "range", "bearing")
SLOW = (od.GPS(2.0, rate=1.0), od.Magnetometer(0.21, rate=2.0), od.Range(BEACON, 1.0), od.Bearing(BEACON, 0.087, rate=0.5))
START = np.array([3.0, -1.0, 0.4, 2.0, -1.0])
SCALE = np.array([5.0, 4.0, 0.3, 1.0, 1.5])
STEP, STEPS = 0.25, 24
ONE_STEP = 1e-2  # relative error for which one step of Runge and Kutta is enough, as they are made by hand


@dataclass(frozen=True)
class Swinging(AbstractVehicle):
    """Everything acts on everything: steps dx_k+1/dx_k of this vehicle do not commute, unlike those of ready-made ones."""

    speed: float = 6.0

    @property
    def states(self) -> tuple[od.Signal, ...]:
        return X, Y, HEADING, od.Signal("drag", "m/s")

    @property
    def inputs(self) -> tuple[od.Signal, ...]:
        return (TURN_RATE,)

    @property
    def disturbances(self) -> tuple[od.Signal, ...]:
        return od.Signal("gust"), od.Signal("push")

    def fields(self, x: ca.SX) -> Fields:
        drift = ca.vertcat(
            self.speed * ca.cos(x[2]) + x[3],
            self.speed * ca.sin(x[2]) + 0.05 * x[0] * x[3],
            0.1 * x[3] + 0.1 * ca.sin(x[0] / 10),
            0.3 * ca.cos(x[1] / 8) - 0.4 * x[3],
        )
        return Fields(drift, (ca.SX([0, 0, 1, 0]),), (ca.SX([0, 0, 0, 1]), ca.vertcat(0, 1, 0, 0.1 * x[2])))


Law = Callable[[np.ndarray, float, np.ndarray], np.ndarray]  # x, u, w -> xdot


def rate(x: np.ndarray, u: float, w: np.ndarray) -> np.ndarray:
    """The same law at a speed of 6 m/s, also for complex numbers."""
    return np.array(
        [
            6.0 * np.cos(x[2]) + x[3],
            6.0 * np.sin(x[2]) + 0.05 * x[0] * x[3] + w[1],
            u + 0.1 * x[3] + 0.1 * np.sin(x[0] / 10),
            0.3 * np.cos(x[1] / 8) - 0.4 * x[3] + w[0] + 0.1 * x[2] * w[1],
        ]
    )


def stepped(x: np.ndarray, u: float, w: np.ndarray, step: float, law: Law = rate) -> np.ndarray:
    """One step of the classical Runge-Kutta method."""
    k1 = law(x, u, w)
    k2 = law(x + step / 2 * k1, u, w)
    k3 = law(x + step / 2 * k2, u, w)
    k4 = law(x + step * k3, u, w)
    return x + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def derivative(function: Callable[[np.ndarray], np.ndarray], at: np.ndarray) -> np.ndarray:
    """Columns by the complex step: exact to rounding."""
    tiny = 1e-30
    return np.column_stack([np.imag(function(at + 1j * tiny * unit)) / tiny for unit in np.eye(len(at))])


def slopes(value: Callable[[np.ndarray], float], at: np.ndarray, eps: float = 1e-3) -> np.ndarray:
    """The gradient by central differences over four points, each entry: errors of eps^4, and rounding over eps."""
    found = np.empty(at.shape)
    for place in np.ndindex(*at.shape):
        kick = np.zeros(at.shape)
        kick[place] = eps
        near, far = (value(at + reach * kick) - value(at - reach * kick) for reach in (1, 2))
        found[place] = (8 * near - far) / (12 * eps)
    return found


def flown(system: od.System, steps: int = STEPS, seed: int = 3, step: float = STEP) -> od.Trajectory:
    """A path under inputs drawn anew for each step."""
    random = np.random.default_rng(seed)
    u = random.uniform(-0.6, 0.6, (steps, len(system.model.inputs)))
    if len(system.model.inputs) == 2:
        u[:, 0] = random.uniform(5.0, 15.0, steps)
    return od.simulate(system, START[: len(system.model.states)], u, step, tolerance=ONE_STEP)


def part(path: od.Trajectory, first: int, last: int) -> od.Trajectory:
    """The path from one step to another, put together anew."""
    w = None if path.w is None else path.w[first:last]
    return od.Trajectory(path.t[first : last + 1], path.x[first : last + 1], path.u[first:last], w, path.tolerance)


def correlated_prior(n: int) -> od.Prior:
    """A prior whose errors depend on each other."""
    factor = np.random.default_rng(5).standard_normal((n, n)) + 2 * np.eye(n)
    return od.Prior(START[:n], covariance=factor @ factor.T)


def assert_close(found: np.ndarray, expected: np.ndarray, relative: float, size: np.ndarray | None = None) -> None:
    """Entries agree to `relative` of sqrt(W_ii W_jj) of size, or of what is expected, so that no unit hides an error."""
    assert found.shape == expected.shape
    root = np.sqrt(np.abs(np.diagonal(expected if size is None else size, axis1=-2, axis2=-1)))
    allowed = relative * root[..., :, None] * root[..., None, :] + 1e-300
    np.testing.assert_array_less(np.abs(found - expected), np.broadcast_to(allowed, found.shape))


def numerical_rank(W: np.ndarray) -> int:
    """Rank after scaling to unit diagonal; there must be a wide gap between what counts and what does not."""
    diagonal = np.diag(W)
    scale = np.where(diagonal > 0, 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0)), 1.0)
    values = np.linalg.eigvalsh(W * np.outer(scale, scale))
    assert not np.any((values > 1e-12) & (values < 1e-7)), f"no clear rank: {values}"
    return int(np.sum(values > 1e-9))
