"""The switch times whose level is nearest to given means over steps: `_switches` backwards."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from obsdesign.paths._switches import mean_jacobian, switched_means
from obsdesign.paths.abstract import Grid

if TYPE_CHECKING:
    import numpy as np

_LATTICE = 200  # times at most within the duration
_RESTARTS, _STARTS, _MAX_REFINED, _ROUNDS, _SWEEPS = 3, 10, 4, 100, 20
_EXACT_SHARE = 1e-13  # share of the largest value that counts as no misfit


@dataclass(frozen=True, eq=False)
class _Level:
    """The level values_1 + sum_i jumps_i S((t - s_i) / tau) and what it is to be: means `target` (N,)."""

    target: np.ndarray
    values: np.ndarray
    tau: float
    grid: Grid

    @property
    def jumps(self) -> np.ndarray:
        """By how much the level changes at each switch: values_i+1 - values_i."""
        import numpy as np

        return np.diff(self.values)

    def misfit(self, durations: np.ndarray) -> np.ndarray:
        """Means less those wanted (N,)."""
        return self.values[0] + switched_means(durations, self.jumps, self.tau, self.grid) - self.target


def fit_durations(target: np.ndarray, values: np.ndarray, tau: float, grid: Grid) -> np.ndarray:
    """Return durations (values - 1,) in [0, N step] of all but the last value, the means of whose level are near to those wanted (N,).

    Squares have many local minima in the switch times. So from switches at nodes and from a few random ones (always the same), on a
    lattice of times, two switches after the other are put where squares are least; the best ends are refined by Gauss-Newton steps;
    again, with the times so found in the lattice. A least squares fit, not proven to be the best.
    """
    import numpy as np

    level, random = _Level(target, values, tau, grid), np.random.default_rng(0)
    if len(values) == 1:
        return np.zeros(0)
    spacing = max(grid.step / 3, tau / 3, grid.duration / _LATTICE)
    # what is switched 15 tau behind the end, or later, is not seen
    lattice = np.append(np.arange(0, grid.duration + 15 * tau, spacing), [grid.duration, grid.duration + 20 * tau])
    best, switch_times = np.zeros(len(values) - 1), _switches_at_nodes(target, values) * grid.step
    for _ in range(_RESTARTS):
        times = np.unique(np.concatenate([lattice, switch_times]))
        starts = [
            np.searchsorted(times, switch_times),
            *(np.sort(random.integers(0, len(times), len(switch_times))) for _ in range(_STARTS)),
        ]
        for indices in _coordinate_descent(level, times, starts)[:_MAX_REFINED]:
            refined = _gauss_newton(level, np.diff(times[indices], prepend=0.0))
            if _squared_misfit(level, refined) < _squared_misfit(level, best):
                best = refined
            if np.abs(level.misfit(best)).max() <= _EXACT_SHARE * np.abs(values).max():
                return best
        switch_times = np.cumsum(best)
    return best


def _squared_misfit(level: _Level, durations: np.ndarray) -> float:
    residual = level.misfit(durations)
    return float(residual @ residual)


def _switches_at_nodes(target: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Switches at nodes 0 <= k_1 <= k_2 <= ... <= N without blending: the least squares of all, by dynamic programming."""
    import numpy as np

    squares = np.vstack([np.zeros(len(values)), np.cumsum((target[:, None] - values) ** 2, axis=0)])
    best, origins = squares[:, 0], []
    for column in squares.T[1:]:
        difference = best - column
        running_minimum = np.minimum.accumulate(difference)
        origins.append(np.maximum.accumulate(np.where(difference <= running_minimum, np.arange(len(difference)), 0)))
        best = running_minimum + column
    nodes = [len(target)]
    for origin in reversed(origins):
        nodes.append(origin[nodes[-1]])
    return np.array(nodes[:0:-1])


def _coordinate_descent(level: _Level, times: np.ndarray, starts: list[np.ndarray]) -> list[list[int]]:
    """Return where the starts, indices of times, settle: without duplicates, least squares first.

    With a_k (N,) the means of S((t - times_k) / tau) and r = wanted - values_1, the squares are
    |r|^2 - 2 sum_i jumps_i a_i r + sum_ij jumps_i jumps_j a_i a_j: products of the a, known for all pairs of times.
    """
    import numpy as np

    a = np.stack([switched_means(np.array([time]), np.ones(1), level.tau, level.grid) for time in times])
    products, along, jumps = a @ a.T, a @ (level.target - level.values[0]), level.jumps

    def squares(at: list[int]) -> float:
        """Return the sum of squares for switches at nodes `at`, but for a constant."""
        return float(jumps @ products[np.ix_(at, at)] @ jumps - 2 * jumps @ along[at])

    def descend(at: list[int]) -> list[int]:
        """Return nodes from which moving one switch, or a pair, is no gain."""
        for _ in range(_SWEEPS):
            before = list(at)
            for i in range(max(len(at) - 1, 1)):
                at = _optimise_pair(at, i, products, along, jumps)
            if at == before:
                break
        return at

    ends = {tuple(descend([int(k) for k in start])) for start in starts}
    return sorted((list(end) for end in ends), key=squares)


def _optimise_pair(indices: list[int], i: int, products: np.ndarray, along: np.ndarray, jumps: np.ndarray) -> list[int]:
    """Put switches i and i + 1 where squares are least, the others held; the only switch where there is but one."""
    import numpy as np

    pair = indices[i : i + 2]
    low = indices[i - 1] if i else 0
    high = indices[i + 2] if i + 2 < len(indices) else len(along) - 1
    among, rest = slice(low, high + 1), [k for k in range(len(indices)) if k not in (i, i + 1)]
    remaining = along[among] - jumps[rest] @ products[np.array(indices, dtype=int)[rest], among]
    single_costs = [jump**2 * np.diag(products)[among] - 2 * jump * remaining for jump in jumps[i : i + 2]]
    if len(pair) == 1:
        return [low + int(np.argmin(single_costs[0]))]
    pair_costs = single_costs[0][:, None] + single_costs[1] + 2 * jumps[i] * jumps[i + 1] * products[among, among]
    pair_costs[np.tril_indices(len(pair_costs), -1)] = np.inf
    first, second = np.unravel_index(np.argmin(pair_costs), pair_costs.shape)
    return [*indices[:i], low + int(first), low + int(second), *indices[i + 2 :]]


def _gauss_newton(level: _Level, durations: np.ndarray) -> np.ndarray:
    """Damped Gauss-Newton (Levenberg-Marquardt), each step a linear least squares problem within the bounds."""
    import numpy as np
    from scipy.optimize import lsq_linear

    longest, damping = level.grid.duration, 1e-3
    durations = np.clip(durations, 0, longest)
    residual = level.misfit(durations)
    for _ in range(_ROUNDS):
        J = mean_jacobian(durations, level.jumps, level.tau, level.grid)
        A = np.vstack([J, np.diag(np.sqrt(damping) * (np.linalg.norm(J, axis=0) + 1e-12))])
        b = np.concatenate([-residual, np.zeros(len(durations))])
        step = lsq_linear(A, b, (-durations, longest - durations), method="bvls").x
        trial = np.clip(_apply_step(level, durations, step), 0, longest)
        trial_residual = level.misfit(trial)
        is_better = trial_residual @ trial_residual < residual @ residual
        durations, residual, damping = (trial, trial_residual, damping / 10) if is_better else (durations, residual, damping * 4)
        if damping > 1e8 or np.abs(residual).max() <= _EXACT_SHARE * np.abs(level.values).max():
            break
    return durations


def _apply_step(level: _Level, durations: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Durations after a step; of switches behind the end, with which means fall as exp(-s / tau), a linear step in that."""
    import numpy as np

    switches, shifts = np.cumsum(durations), np.cumsum(step)
    fading = -level.tau * np.log1p(-np.minimum(shifts / level.tau, 0.99))
    return np.diff(switches + np.where(switches > level.grid.duration, fading, shifts), prepend=0.0)
