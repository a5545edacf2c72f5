"""A level that is switched at free times: its means over the steps, and the times that fit given means."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from obsdesign.paths._columns import is_array
from obsdesign.paths.abstract import Grid

if TYPE_CHECKING:
    import numpy as np

_ROUNDS, _LATTICE, _AGAIN, _STARTS, _REFINED = 100, 200, 3, 30, 6


def softplus(z: Any) -> Any:  # noqa: ANN401  # symbolic or numerical
    """log(1 + exp(z)), elementwise, without overflow.

    As max(z, 0) + log1p(exp(-|z|)), of which the two halves are one analytic function; the side of z = 0 is chosen once, so that
    derivatives there are those of one half, not a mean of both as with max and | |.
    """
    import casadi as ca
    import numpy as np

    numpy_or_casadi = np if is_array(z) else ca
    above = 1.0 * (z >= 0)
    return above * z + numpy_or_casadi.log1p(numpy_or_casadi.exp((1 - 2 * above) * z))


def means(durations: Any, jumps: np.ndarray, tau: float, grid: Grid) -> Any:  # noqa: ANN401
    """Means (N,) over the steps of sum_i jumps_i S((t - s_i) / tau), s the running sums of the durations, S the logistic function.

    Over the step from a to b the mean of S((t - s) / tau) is tau / (b - a) (softplus((b - s) / tau) - softplus((a - s) / tau)).
    """
    import casadi as ca
    import numpy as np

    numerical = is_array(durations)
    nodes = np.arange(grid.steps + 1) * grid.step
    times = nodes if numerical else ca.DM(nodes)
    total, switch = np.zeros(grid.steps) if numerical else type(durations).zeros(grid.steps, 1), 0.0
    for i, jump in enumerate(jumps):
        switch = switch + durations[i]
        area = softplus((times - switch) / tau)
        total = total + float(jump) * tau / grid.step * (area[1:] - area[:-1])
    return total


def fitted(rate: np.ndarray, values: np.ndarray, tau: float, grid: Grid) -> np.ndarray:
    """Return durations in [0, N step] of all but the last of the values for which the means are near to rate (N,).

    From many random beginnings, two switches at a time to the best of a lattice of times; then the best few by the damped
    Gauss-Newton iteration with bounds; again with the times that this found in the lattice.
    """
    import numpy as np

    if len(values) == 1:
        return np.zeros(0)
    random = np.random.default_rng(0)
    spacing = max(max(grid.step, tau) / 3, grid.duration / _LATTICE)
    lattice = np.append(np.arange(0, grid.duration + 15 * tau, spacing), [grid.duration, grid.duration + 20 * tau])
    best, least, known = None, np.inf, np.zeros(0)
    for _ in range(_AGAIN):
        times = np.unique(np.concatenate([lattice, known]))
        starts = [np.sort(random.integers(0, len(times), len(values) - 1)) for _ in range(_STARTS)]
        first = np.searchsorted(times, known if len(known) else _hard(rate, values) * grid.step)
        starts.append(first)
        for _ in range(_STARTS):
            other = first.copy(); k = random.integers(0, len(first), 2); other[k] = random.integers(0, len(times), 2)
            starts.append(np.sort(other))
        table = _Table(rate, values, tau, grid, times)
        ends = {tuple(table.settled(start)) for start in starts}
        ends = sorted(ends, key=lambda e: table.squares_of(e))
        for end in ends[:_REFINED]:
            durations = _refined(np.diff(times[list(end)], prepend=0.0), rate, values, tau, grid)
            squares = float(np.sum((_level(durations, values, tau, grid) - rate) ** 2))
            if squares < least:
                best, least, known = durations, squares, np.cumsum(durations)
            if least < 1e-20:
                return best
    return best


def _hard(rate: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Switch at nodes k_1 <= k_2 <= ... of 0..N: least squares over all such, by dynamic programming."""
    import numpy as np

    squares = np.vstack([np.zeros(len(values)), np.cumsum((rate[:, None] - values) ** 2, axis=0)])
    best, origins = squares[:, 0], []
    for column in squares.T[1:]:
        ahead = best - column
        least = np.minimum.accumulate(ahead)
        origins.append(np.maximum.accumulate(np.where(ahead <= least, np.arange(len(ahead)), 0)))
        best = least + column
    nodes = [len(rate)]
    for origin in reversed(origins):
        nodes.append(origin[nodes[-1]])
    return np.array(nodes[:0:-1])


class _Table:
    def __init__(self, rate, values, tau, grid, times):
        import numpy as np

        a = np.stack([means(np.array([time]), np.ones(1), tau, grid) for time in times])
        self.G, self.along, self.jumps = a @ a.T, a @ (rate - values[0]), np.diff(values)
        self.own = np.diag(self.G)
        self.order = np.where(np.arange(len(times))[:, None] <= np.arange(len(times)), 0.0, np.inf)

    def squares_of(self, at):
        at = list(at)
        J = self.jumps
        return float(J @ self.G[at][:, at] @ J - 2 * J @ self.along[at])

    def settled(self, at):
        import numpy as np

        at, J, count = at.copy(), self.jumps, len(self.own)
        if len(at) == 1:
            return [int(np.argmin(J[0] ** 2 * self.own - 2 * J[0] * self.along))]
        last = np.inf
        for _ in range(20):
            for i in range(len(at) - 1):
                low = at[i - 1] if i else 0
                high = at[i + 2] if i + 2 < len(at) else count - 1
                among = slice(low, high + 1)
                others = [k for k in range(len(at)) if k not in (i, i + 1)]
                left = self.along[among] - (J[others] @ self.G[at[others], among] if others else 0.0)
                first = J[i] ** 2 * self.own[among] - 2 * J[i] * left
                second = J[i + 1] ** 2 * self.own[among] - 2 * J[i + 1] * left
                both = first[:, None] + second + 2 * J[i] * J[i + 1] * self.G[among, among] + self.order[among, among]
                x, y = np.unravel_index(np.argmin(both), both.shape)
                at[i], at[i + 1] = low + x, low + y
            now = self.squares_of(at)
            if now > last - 1e-12:
                break
            last = now
        return [int(k) for k in at]


def _level(durations: np.ndarray, values: np.ndarray, tau: float, grid: Grid) -> np.ndarray:
    import numpy as np

    return values[0] + means(durations, np.diff(values), tau, grid)


def _refined(durations: np.ndarray, rate: np.ndarray, values: np.ndarray, tau: float, grid: Grid) -> np.ndarray:
    """Levenberg-Marquardt, each step a bounded linear least squares problem."""
    import numpy as np
    from scipy.optimize import lsq_linear

    durations, damping = np.clip(durations, 0, grid.duration), 1e-3
    missed = _level(durations, values, tau, grid) - rate
    for _ in range(_ROUNDS):
        J = _slopes(durations, values, tau, grid)
        A = np.vstack([J, np.diag(np.sqrt(damping) * (np.linalg.norm(J, axis=0) + 1e-12))])
        b = np.concatenate([-missed, np.zeros(len(durations))])
        step = lsq_linear(A, b, (-durations, grid.duration - durations + 1e-300), method="bvls").x
        before = np.cumsum(durations)
        moved = np.cumsum(step)
        # behind the end, means fall with exp(-s / tau): the linear step is taken in that
        moved = np.where(before > grid.duration, -tau * np.log1p(-np.minimum(moved / tau, 0.99)), moved)
        tried = np.clip(np.diff(before + moved, prepend=0.0), 0, grid.duration)
        then = _level(tried, values, tau, grid) - rate
        if then @ then < missed @ missed:
            durations, missed, damping = tried, then, damping / 10
        else:
            damping *= 4
        if damping > 1e8 or np.abs(missed).max() < 1e-13 * np.abs(values).max():
            break
    return durations


def _slopes(durations: np.ndarray, values: np.ndarray, tau: float, grid: Grid) -> np.ndarray:
    """d means / d durations (N, letters - 1): a duration moves all switches behind it."""
    import numpy as np
    from scipy.special import expit

    nodes = np.arange(grid.steps + 1) * grid.step
    each = -np.diff(values) * np.diff(expit((nodes[:, None] - np.cumsum(durations)) / tau), axis=0) / grid.step
    return np.cumsum(each[:, ::-1], axis=1)[:, ::-1]
