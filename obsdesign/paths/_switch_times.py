"""The switch times whose level is nearest to given means over steps: `_switches` backwards."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from obsdesign.paths._switches import means, slopes
from obsdesign.paths.abstract import Grid

if TYPE_CHECKING:
    import numpy as np

_LATTICE = 200  # times at most within the duration
_AGAIN, _STARTS, _REFINED, _ROUNDS, _SWEEPS = 3, 10, 4, 100, 20
_NONE = 1e-13  # share of the largest value that counts as no misfit


@dataclass(frozen=True, eq=False)
class _Level:
    """The level values_1 + sum_i jumps_i S((t - s_i) / tau) and what it is to be: means `wanted` (N,)."""

    wanted: np.ndarray
    values: np.ndarray
    tau: float
    grid: Grid

    @property
    def jumps(self) -> np.ndarray:
        import numpy as np

        return np.diff(self.values)

    def misfit(self, durations: np.ndarray) -> np.ndarray:
        """Means less those wanted (N,)."""
        return self.values[0] + means(durations, self.jumps, self.tau, self.grid) - self.wanted


def fitted(wanted: np.ndarray, values: np.ndarray, tau: float, grid: Grid) -> np.ndarray:
    """Return durations (values - 1,) in [0, N step] of all but the last value, the means of whose level are near to those wanted (N,).

    Squares have many local minima in the switch times. So from switches at nodes and from a few random ones (always the same), on a
    lattice of times, two switches after the other are put where squares are least; the best ends are refined by Gauss-Newton steps;
    again, with the times so found in the lattice. A least squares fit, not proven to be the best.
    """
    import numpy as np

    level, random = _Level(wanted, values, tau, grid), np.random.default_rng(0)
    if len(values) == 1:
        return np.zeros(0)
    spacing = max(grid.step / 3, tau / 3, grid.duration / _LATTICE)
    # what is switched 15 tau behind the end, or later, is not seen
    lattice = np.append(np.arange(0, grid.duration + 15 * tau, spacing), [grid.duration, grid.duration + 20 * tau])
    best, known = np.zeros(len(values) - 1), _at_nodes(wanted, values) * grid.step
    for _ in range(_AGAIN):
        times = np.unique(np.concatenate([lattice, known]))
        starts = [np.searchsorted(times, known), *(np.sort(random.integers(0, len(times), len(known))) for _ in range(_STARTS))]
        for end in _settled(level, times, starts)[:_REFINED]:
            tried = _refined(level, np.diff(times[end], prepend=0.0))
            if _squares(level, tried) < _squares(level, best):
                best = tried
            if np.abs(level.misfit(best)).max() <= _NONE * np.abs(values).max():
                return best
        known = np.cumsum(best)
    return best


def _squares(level: _Level, durations: np.ndarray) -> float:
    missed = level.misfit(durations)
    return float(missed @ missed)


def _at_nodes(wanted: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Switches at nodes 0 <= k_1 <= k_2 <= ... <= N without blending: the least squares of all, by dynamic programming."""
    import numpy as np

    squares = np.vstack([np.zeros(len(values)), np.cumsum((wanted[:, None] - values) ** 2, axis=0)])
    best, origins = squares[:, 0], []
    for column in squares.T[1:]:
        ahead = best - column
        least = np.minimum.accumulate(ahead)
        origins.append(np.maximum.accumulate(np.where(ahead <= least, np.arange(len(ahead)), 0)))
        best = least + column
    nodes = [len(wanted)]
    for origin in reversed(origins):
        nodes.append(origin[nodes[-1]])
    return np.array(nodes[:0:-1])


def _settled(level: _Level, times: np.ndarray, starts: list[np.ndarray]) -> list[list[int]]:
    """Return where the starts, indices of times, settle: without duplicates, least squares first.

    With a_k (N,) the means of S((t - times_k) / tau) and r = wanted - values_1, the squares are
    |r|^2 - 2 sum_i jumps_i a_i r + sum_ij jumps_i jumps_j a_i a_j: products of the a, known for all pairs of times.
    """
    import numpy as np

    a = np.stack([means(np.array([time]), np.ones(1), level.tau, level.grid) for time in times])
    products, along, jumps = a @ a.T, a @ (level.wanted - level.values[0]), level.jumps

    def squares(at: list[int]) -> float:
        return float(jumps @ products[np.ix_(at, at)] @ jumps - 2 * jumps @ along[at])

    def settle(at: list[int]) -> list[int]:
        for _ in range(_SWEEPS):
            before = list(at)
            for i in range(max(len(at) - 1, 1)):
                at = _pair_moved(at, i, products, along, jumps)
            if at == before:
                break
        return at

    ends = {tuple(settle([int(k) for k in start])) for start in starts}
    return sorted((list(end) for end in ends), key=squares)


def _pair_moved(at: list[int], i: int, products: np.ndarray, along: np.ndarray, jumps: np.ndarray) -> list[int]:
    """Put switches i and i + 1 where squares are least, the others held; the only switch where there is but one."""
    import numpy as np

    pair = at[i : i + 2]
    low = at[i - 1] if i else 0
    high = at[i + 2] if i + 2 < len(at) else len(along) - 1
    among, rest = slice(low, high + 1), [k for k in range(len(at)) if k not in (i, i + 1)]
    left = along[among] - jumps[rest] @ products[np.array(at, dtype=int)[rest], among]
    alone = [jump**2 * np.diag(products)[among] - 2 * jump * left for jump in jumps[i : i + 2]]
    if len(pair) == 1:
        return [low + int(np.argmin(alone[0]))]
    both = alone[0][:, None] + alone[1] + 2 * jumps[i] * jumps[i + 1] * products[among, among]
    both[np.tril_indices(len(both), -1)] = np.inf
    first, second = np.unravel_index(np.argmin(both), both.shape)
    return [*at[:i], low + int(first), low + int(second), *at[i + 2 :]]


def _refined(level: _Level, durations: np.ndarray) -> np.ndarray:
    """Damped Gauss-Newton (Levenberg-Marquardt), each step a linear least squares problem within the bounds."""
    import numpy as np
    from scipy.optimize import lsq_linear

    longest, damping = level.grid.duration, 1e-3
    durations = np.clip(durations, 0, longest)
    missed = level.misfit(durations)
    for _ in range(_ROUNDS):
        J = slopes(durations, level.jumps, level.tau, level.grid)
        A = np.vstack([J, np.diag(np.sqrt(damping) * (np.linalg.norm(J, axis=0) + 1e-12))])
        b = np.concatenate([-missed, np.zeros(len(durations))])
        step = lsq_linear(A, b, (-durations, longest - durations), method="bvls").x
        tried = np.clip(_moved(level, durations, step), 0, longest)
        then = level.misfit(tried)
        better = then @ then < missed @ missed
        durations, missed, damping = (tried, then, damping / 10) if better else (durations, missed, damping * 4)
        if damping > 1e8 or np.abs(missed).max() <= _NONE * np.abs(level.values).max():
            break
    return durations


def _moved(level: _Level, durations: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Durations after a step; of switches behind the end, with which means fall as exp(-s / tau), a linear step in that."""
    import numpy as np

    switches, moves = np.cumsum(durations), np.cumsum(step)
    fading = -level.tau * np.log1p(-np.minimum(moves / level.tau, 0.99))
    return np.diff(switches + np.where(switches > level.grid.duration, fading, moves), prepend=0.0)
