"""Where along a path the motion hides the state, and how near it comes to that."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.arguments import validate_arguments
from obsdesign.checks import require_count, require_positive, require_tolerance
from obsdesign.display import AbstractDisplay, Summary, number, numbers
from obsdesign.dynamics.model import AbstractSystem, Model
from obsdesign.dynamics.simulation import as_scale, inputs_along
from obsdesign.errors import InputError
from obsdesign.information.gramian import require_fit
from obsdesign.information.landmark_circle import CircleResiduals, circle_residuals
from obsdesign.information.output_jets import default_orders, output_jets
from obsdesign.trajectory import Trajectory

_SMALL = 0.05  # of a direction's largest entry: less is not named
_LISTED = 8  # intervals that are shown


@dataclass(frozen=True, eq=False)
class HiddenInterval:
    """A stretch of a path on which outputs and their derivatives do not tell the state."""

    start: float
    """When it begins [s]."""
    end: float
    """When it ends [s]."""
    rank: int
    """How many directions are seen on it, at least."""
    null_space: np.ndarray
    """Orthonormal basis (n, d) of the directions that are hidden at the step of that rank in its middle."""


@dataclass(frozen=True, eq=False)
class Singularities(AbstractDisplay):
    """How well outputs and their derivatives up to an order tell the state x(t_k), at each of the N steps of a path."""

    t: np.ndarray
    """Instants (N,) [s]."""
    orders: int
    """Up to which order derivatives were taken."""
    unit_time: float
    """T [s], the unit of time: derivative k counts with T^k / k!."""
    sigma_min: np.ndarray
    """Smallest singular value (N,) of M S, rows of M the gradients of R^-1/2 T^k y_k, k = 0 .. orders, y_k = d^k y/dt^k / k!."""
    nearness: np.ndarray
    """The same over the largest (N,), the columns of M divided by their root mean square along the path: 0 where the state is hidden."""
    rank: np.ndarray
    """Number of those singular values (N,) above `tolerance` of the largest."""
    tolerance: float
    """Below which share of the largest a singular value counts as 0."""
    hidden: tuple[HiddenInterval, ...]
    """The stretches where the rank is less than n."""
    names: tuple[str, ...]
    """Names of the n states."""
    circle: CircleResiduals | None
    """For three landmarks not on a line and states x and y: the circle through them, how far the path is from it and from
    staying on it, and Belo's relation (8) beside it; else None.
    """

    def _summary(self) -> Summary:
        weakest = int(self.nearness.argmin())
        rows = [
            ("seen", f"{self.rank.min()} to {self.rank.max()} of {len(self.names)} directions, by derivatives up to order {self.orders}"),
            ("nearest", f"{number(float(self.nearness[weakest]))} of the largest at {number(float(self.t[weakest]), 's')}"),
            *((f"{number(each.start)} to {number(each.end, 's')}", _in_words(each, self.names)) for each in self.hidden[:_LISTED]),
        ]
        if self.circle is not None:
            place = int(self.circle.distance.argmin())
            distance, when = number(float(self.circle.distance[place]), "m"), number(float(self.t[place]), "s")
            rows.append(("circle", f"the path comes within {distance} of the circle through the landmarks, at {when}"))
        title = "the motion hides the state" if self.hidden else "the motion hides nothing of the state"
        return Summary(title, tuple(rows))


def _in_words(interval: HiddenInterval, names: tuple[str, ...]) -> str:
    """Say which combinations of states are hidden."""
    vectors = []
    for vector in interval.null_space.T:
        largest = vector[np.abs(vector).argmax()]
        places = [i for i in range(len(names)) if abs(vector[i]) > _SMALL * abs(largest)]
        vectors.append(numbers([names[i] for i in places], vector[places] / largest))
    return "hidden: " + "; ".join(vectors)


@validate_arguments
def singularities(
    system: AbstractSystem,
    path: Trajectory,
    orders: int | None = None,
    *,
    unit_time: float | None = None,
    scale: ArrayLike | None = None,
    tolerance: float = 1e-6,
) -> Singularities:
    """Return where along a path the motion hides the state, and how near it comes to that, step by step.

    At x(t_k), inputs held, the gradients of y, y', ..., y^(orders) with respect to the state; what unknown inputs change is projected out.
    With as many orders as it takes, what is hidden at an instant is hidden on the whole step: the flow carries the rank along.

    Arguments:
        system: vehicle and sensors.
        path: the path that is looked at.
        orders: up to which order derivatives are taken; None = as many as outputs can need to tell n states, and one.
        unit_time: T [s], in which derivatives are counted; None = a tenth of the path's duration.
        scale (n,): the diagonal of S, what counts as one unit of each state in sigma_min; None = ones.
        tolerance: share of the largest singular value below which one counts as 0, in (0, 1).
    Raises InputError for a path of another system, a map, outputs without derivatives on the path, and values that are not accepted.
    Source: Hermann and Krener 1977; Belo, Salaris and Bicchi 2010, section IV-B, whose relation (8) is in `circle`.
    """
    require_fit(system, path)
    require_tolerance(tolerance)
    model = system.model
    if model.period is not None:
        raise InputError("singularities: the system is a map from one instant to the next, whose outputs have no derivatives")
    orders = default_orders(model) if orders is None else orders
    require_count("orders", orders, minimum=0)
    unit_time = float(path.t[-1] - path.t[0]) / 10 if unit_time is None else unit_time
    require_positive("unit_time", unit_time)
    u, w = inputs_along(system, path)
    M = output_jets(system, path.x[:-1], u, w, orders, unit_time)
    _require_finite(M, path)
    columns = np.sqrt((M**2).sum(axis=1).mean(axis=0))
    columns = np.where(columns > 0, columns, 1.0)
    _, sizes, directions = np.linalg.svd(M / columns)
    sizes = np.pad(sizes, ((0, 0), (0, M.shape[2] - sizes.shape[1])))
    rank = (sizes > tolerance * sizes[:, :1]).sum(axis=1)
    return Singularities(
        t=path.t[:-1],
        orders=orders,
        unit_time=unit_time,
        sigma_min=smallest_singular_value(M * as_scale(system, scale)),
        nearness=sizes[:, -1] / np.maximum(sizes[:, 0], 1e-300),
        rank=rank,
        tolerance=tolerance,
        hidden=_intervals(path, rank, directions, columns),
        names=model.state_names,
        circle=circle_residuals(system, path) if has_circle(model) else None,
    )


def _require_finite(M: np.ndarray, path: Trajectory) -> None:
    """Raise InputError with the first step at which outputs have no derivatives."""
    missing = np.flatnonzero(~np.isfinite(M).all(axis=(1, 2)))
    if len(missing):
        k = int(missing[0])
        raise InputError(f"singularities: an output has no derivatives at step {k} (t = {path.t[k]:g} s), as where a path meets a landmark")


def smallest_singular_value(M: np.ndarray) -> np.ndarray:
    """Return the smallest singular value (N,) of matrices (N, r, n), 0 where r < n."""
    return np.linalg.svd(M, compute_uv=False)[:, -1] if M.shape[1] >= M.shape[2] else np.zeros(len(M))


def has_circle(model: Model) -> bool:
    """Return whether the system looks at three landmarks, not on a line, from states x and y."""
    if len(model.landmarks) != 3 or not {"x", "y"} <= set(model.state_names):
        return False
    a, b, c = (np.array(point) for point in model.landmarks)
    first, second = b - a, c - a
    return abs(first[0] * second[1] - first[1] * second[0]) > 1e-9 * float(np.linalg.norm(first) * np.linalg.norm(second))


def _intervals(path: Trajectory, rank: np.ndarray, directions: np.ndarray, columns: np.ndarray) -> tuple[HiddenInterval, ...]:
    """Return the stretches of steps with a rank below n."""
    n = directions.shape[2]
    is_hidden = np.concatenate([[False], rank < n, [False]])
    starts, ends = np.flatnonzero(~is_hidden[:-1] & is_hidden[1:]), np.flatnonzero(is_hidden[:-1] & ~is_hidden[1:])
    intervals: list[HiddenInterval] = []
    for start, end in zip(starts, ends, strict=True):
        lowest = start + np.flatnonzero(rank[start:end] == rank[start:end].min())
        middle = int(lowest[len(lowest) // 2])
        basis, _ = np.linalg.qr(directions[middle, rank[middle] :].T / columns[:, None])
        intervals.append(HiddenInterval(float(path.t[start]), float(path.t[end]), int(rank[middle]), basis))
    return tuple(intervals)
