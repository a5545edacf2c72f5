"""Three landmarks and unknown inputs: the circle that hides where one is, and how near a path comes to staying on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from obsdesign.arguments import validate_arguments
from obsdesign.calculus import lie_derivative
from obsdesign.checks import as_pair, require_count, require_known
from obsdesign.display import AbstractDisplay, Summary, number
from obsdesign.dynamics.model import AbstractSystem, Model
from obsdesign.dynamics.scan import Scan
from obsdesign.dynamics.simulation import all_inputs_along, as_scale
from obsdesign.dynamics.step import CACHE_SIZE, steps_per_sample
from obsdesign.geometry import circle_through
from obsdesign.information.gramian import require_fit
from obsdesign.information.windows import sliding_information
from obsdesign.signals import Point
from obsdesign.trajectory import Trajectory

_SAMPLES = 3  # of each bearing: two are 6 numbers, and one of them too few for 6 states where one sample is taken on the circle
_ROUND_OFF = 1e-12  # of the sizes that were added up: some thousand units in the last place of a double; less than that counts as 0


@dataclass(frozen=True)
class Circle:
    """The points at one distance from a centre."""

    centre: Point
    """Middle (x, y) [m]."""
    radius: float
    """Distance [m]."""


@dataclass(frozen=True, eq=False)
class CircleResiduals(AbstractDisplay):
    """How near a path comes to the circle C through three landmarks, and to staying on it, at each of its N steps.

    P is the position, c and r are the centre and radius of C; a path along C has all residuals 0.
    paper_relation is relation (8) of Belo, Salaris and Bicchi 2010, which equates it with r for all k. It is not the condition: constant
    inputs are 0/0 for k > 0; the sign of v is lost (clockwise along C it is r where omega turns the vehicle off C, -r where it keeps it
    on); moving along C without turning, forward and sideways by turns, it is inf.
    """

    circle: Circle
    """The circle C: centre (x, y) [m] and radius [m]."""
    t: np.ndarray
    """Instants (N,) [s]."""
    distance: np.ndarray
    """How far the path is from the circle (N,) [m]: ||P - c| - r|."""
    residuals: np.ndarray
    """d^k/dt^k (|P - c|^2 - r^2), k = 0 .. K-1, (N, K) [m^2/s^k]."""
    sigma_min: np.ndarray
    """Smallest singular value (N,) of S W S, W what the samples of the window that begins here say about x(t_k); NaN in the last steps,
    where no whole window is left.
    """
    paper_relation: np.ndarray
    """|d^k/dt^k (v_f, v_h)| / (d^k/dt^k omega) (N, K) [m], the velocity along the vehicle's axes over the turn rate; inf stands for x/0,
    NaN for 0/0 and for systems without a heading.
    """

    def _summary(self) -> Summary:
        x, y = self.circle.centre
        rows = [
            ("circle", f"centre ({number(x, 'm')}, {number(y, 'm')}), radius {number(self.circle.radius, 'm')}"),
            ("nearest", f"{number(float(self.distance.min()), 'm')} at {number(float(self.t[self.distance.argmin()]), 's')}"),
        ]
        if np.isfinite(self.sigma_min).any():
            weakest = int(np.nanargmin(self.sigma_min))
            rows.append(("known least", f"{number(float(self.sigma_min[weakest]))} from {number(float(self.t[weakest]), 's')} on"))
        return Summary("a path beside the circle through three landmarks", tuple(rows))


@validate_arguments
def landmark_circle(landmarks: Sequence[Point]) -> Circle:
    """Return the circle C through three landmarks.

    With unknown constant inputs three bearings and their first derivatives have dependent gradients on C; all derivatives do
    where the vehicle stays on it.

    Arguments:
        landmarks: three points (x, y) [m], not on one line.
    Raises InputError for others. Source: Belo, Salaris and Bicchi 2010, section IV-B.
    """
    return Circle(*circle_through([as_pair("landmark", point) for point in landmarks]))


@validate_arguments
def circle_residuals(
    system: AbstractSystem,
    path: Trajectory,
    landmarks: Sequence[Point] | None = None,
    orders: int = 3,
    *,
    window: int | None = None,
    scale: ArrayLike | None = None,
) -> CircleResiduals:
    """Return how near a path comes to the circle C through three landmarks, and to staying on it, step by step.

    Residuals d^k/dt^k (|P - c|^2 - r^2) are Lie derivatives along drift + B u + G w at (x_k, u_k, w_k): inputs are held over a step.
    sigma_min takes inputs for known; what nobody knows must be a state, as the slips of Omnidirectional("constant").

    Arguments:
        system: vehicle and sensors, with states x and y [m].
        path: the path that is looked at.
        landmarks: three points (x, y) [m]; None = those of the system's sensors.
        orders: number K >= 1 of residuals, k = 0 .. K-1.
        window: steps of the information behind sigma_min; None = three samples of the slowest sensor, at most the path.
        scale (n,): the diagonal of S, what counts as one unit of each state; None = ones.
    Raises InputError unless there are three landmarks not on one line, and states x and y. Source: Belo, Salaris and Bicchi 2010.
    """
    require_fit(system, path)
    require_count("orders", orders)
    model = system.model
    require_known("circle_residuals: the state", ("x", "y"), model.state_names)
    circle = landmark_circle(model.landmarks if landmarks is None else landmarks)
    results = _circle_scan(model, circle, orders).along(np.empty(0), path.x[:-1], all_inputs_along(system, path))
    residuals, velocity_derivatives, sizes, turn_derivatives = results[1:]
    with np.errstate(divide="ignore", invalid="ignore"):
        relation = np.where(velocity_derivatives <= _ROUND_OFF * sizes, 0.0, velocity_derivatives) / turn_derivatives
    # ||P - c| - r| without the difference of two nearly equal numbers
    distance = np.abs(residuals[:, 0]) / (np.sqrt(np.maximum(residuals[:, 0] + circle.radius**2, 0.0)) + circle.radius)
    return CircleResiduals(circle, path.t[:-1], distance, residuals, _sigma_min(system, path, window, scale), relation)


def _sigma_min(system: AbstractSystem, path: Trajectory, window: int | None, scale: ArrayLike | None) -> np.ndarray:
    units = as_scale(system, scale)
    length = min(path.steps, _SAMPLES * max(steps_per_sample(system.model, path.step))) if window is None else window
    W = sliding_information(system, path, length).sum(axis=1) * units[:, None] * units
    # the singular values of a symmetric matrix are the sizes of its eigenvalues
    smallest = np.abs(np.linalg.eigvalsh(W)).min(axis=1)
    return np.concatenate([smallest, np.full(path.steps - len(smallest), np.nan)])


@lru_cache(CACHE_SIZE)
def _circle_scan(model: Model, circle: Circle, orders: int) -> Scan:
    """At x and (u, w): residuals (K,), then |d^k (v_f, v_h)|, what rounding is measured against, and d^k omega (K,) each."""
    names, field = model.state_names, model.rate
    position = ca.vertcat(*(model.x[names.index(name)] for name in ("x", "y")))
    residual = ca.sumsqr(position - ca.SX(circle.centre)) - circle.radius**2
    results = [ca.vertcat(*_derivatives(residual, model.x, field, orders)), *_paper_terms(model, position, field, orders)]
    return Scan(ca.SX(0, 1), [model.x, ca.vertcat(model.u, model.w)], ca.SX(0, 1), results)


def _paper_terms(model: Model, position: ca.SX, field: ca.SX, orders: int) -> tuple[ca.SX, ca.SX, ca.SX]:
    if "heading" not in model.state_names:
        zeros = ca.SX.zeros(orders)
        return zeros, zeros, zeros
    heading = model.x[model.state_names.index("heading")]
    velocity, turning = (lie_derivative(what, model.x, field) for what in (position, heading))
    to_axes = ca.blockcat([[ca.cos(heading), ca.sin(heading)], [-ca.sin(heading), ca.cos(heading)]])
    along_axes = _derivatives(to_axes @ velocity, model.x, field, orders)
    # what these derivatives are the sums of; constant velocities along the axes leave rounding
    sizes = [ca.SX(0)]
    for change in _derivatives(velocity, model.x, field, orders):
        sizes.append(ca.norm_2(change) + ca.fabs(turning) * sizes[-1])
    turn_derivatives = _derivatives(turning, model.x, field, orders)
    return ca.vertcat(*map(ca.norm_2, along_axes)), ca.vertcat(*sizes[1:]), ca.vertcat(*turn_derivatives)


def _derivatives(functions: ca.SX, x: ca.SX, field: ca.SX, orders: int) -> list[ca.SX]:
    """Return functions (q, 1) and their derivatives of orders 1 .. orders - 1 with respect to time."""
    derivatives = [functions]
    for _ in range(orders - 1):
        derivatives.append(lie_derivative(derivatives[-1], x, field))
    return derivatives
