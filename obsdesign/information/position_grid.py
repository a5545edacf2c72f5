"""Which positions hide the state of a vehicle with a given heading and given inputs: the singular set of a planar configuration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.arguments import validate_arguments
from obsdesign.checks import as_array, as_pair, require_count, require_known, require_positive
from obsdesign.display import AbstractDisplay, Summary, number
from obsdesign.dynamics.model import AbstractSystem
from obsdesign.dynamics.simulation import as_input_arrays, as_state
from obsdesign.errors import InputError
from obsdesign.information.landmark_circle import Circle, landmark_circle
from obsdesign.information.output_jets import default_orders, output_jets
from obsdesign.information.singular_motion import has_circle
from obsdesign.signals import Point


@dataclass(frozen=True, eq=False)
class SingularSet(AbstractDisplay):
    """How near a vehicle is to hiding its state, at every position of a grid, all else being equal."""

    x: np.ndarray
    """East of the grid's columns (K,) [m]."""
    y: np.ndarray
    """North of its rows (L,) [m]."""
    nearness: np.ndarray
    """Smallest singular value (L, K) of the gradients of outputs and derivatives, over the median of the largest; columns are divided by
    the median of their lengths over the grid. 0 where the state is hidden; NaN where an output has no value, as on a landmark.
    """
    orders: int
    """Up to which order derivatives were taken."""
    landmarks: tuple[Point, ...]
    """What the sensors look at (x, y) [m]."""
    circle: Circle | None
    """The circle through three landmarks."""

    def _summary(self) -> Summary:
        row, column = np.unravel_index(np.nanargmin(self.nearness), self.nearness.shape)
        place = f"({number(float(self.x[column]), 'm')}, {number(float(self.y[row]), 'm')})"
        rows = [("nearest", f"{number(float(self.nearness[row, column]))} at {place}")]
        if self.circle:
            x, y = self.circle.centre
            rows.append(("circle", f"centre ({number(x, 'm')}, {number(y, 'm')}), radius {number(self.circle.radius, 'm')}"))
        return Summary(f"{len(self.x)} by {len(self.y)} positions, derivatives up to order {self.orders}", tuple(rows))


@validate_arguments
def singular_set(
    system: AbstractSystem,
    at: ArrayLike,
    inputs: ArrayLike | None = None,
    *,
    east: tuple[float, float],
    north: tuple[float, float],
    points: int = 81,
    orders: int | None = None,
    unit_time: float = 1.0,
) -> SingularSet:
    """Return how near every position of a rectangle is to hiding the state, with the rest of the state and the inputs as they are.

    Arguments:
        system: vehicle and sensors, with states x and y [m].
        at (n,): a state, of which all but x and y counts.
        inputs (m,): known inputs, held; None = 0. Unknown ones are 0, and not known.
        east, north: from where to where [m].
        points: positions along each side.
        orders: up to which order derivatives are taken; None = as many as outputs can need to tell n states, and one.
        unit_time: T [s], in which derivatives are counted.
    Raises InputError for a system without states x and y, a map, and values that are not accepted.
    Source: Belo, Salaris and Bicchi 2010, figure 2.
    """
    model = system.model
    require_known("singular_set: the state", ("x", "y"), model.state_names)
    require_count("points", points, minimum=2)
    require_positive("unit_time", unit_time)
    if model.period is not None:
        raise InputError("singular_set: the system is a map from one instant to the next, whose outputs have no derivatives")
    orders = default_orders(model) if orders is None else orders
    columns, rows = (np.linspace(*as_pair(name, side), points) for name, side in (("east", east), ("north", north)))
    grid = np.array([[x, y] for y in rows for x in columns])
    states = np.tile(as_state(system, at, "at"), (len(grid), 1))
    states[:, [model.state_names.index("x"), model.state_names.index("y")]] = grid
    held = np.zeros(len(model.inputs)) if inputs is None else as_array("inputs", inputs)
    u, w = as_input_arrays(system, held.reshape(1, -1), None)
    M = output_jets(system, states, np.tile(u, (len(grid), 1)), np.tile(w, (len(grid), 1)), orders, unit_time)
    return SingularSet(
        x=columns,
        y=rows,
        nearness=_nearness(M).reshape(points, points),
        orders=orders,
        landmarks=model.landmarks,
        circle=landmark_circle(model.landmarks) if has_circle(model) else None,
    )


def _nearness(M: np.ndarray) -> np.ndarray:
    """Return the smallest singular value (N,) of (N, r, n), columns of median length 1, over the median largest; NaN without a value."""
    has_value = np.asarray(np.isfinite(M).all(axis=(1, 2)))
    if not has_value.any():
        return np.full(len(M), np.nan)
    # medians: beside a landmark gradients have no limit
    columns = np.sqrt(np.median((M[has_value] ** 2).sum(axis=1), axis=0))
    sizes = np.linalg.svd(np.where(has_value[:, None, None], M, 0.0) / np.where(columns > 0, columns, 1.0), compute_uv=False)
    smallest = sizes[:, -1] if M.shape[1] >= M.shape[2] else np.zeros(len(M))
    return np.where(has_value, smallest / max(float(np.median(sizes[has_value, 0])), 1e-300), np.nan)
