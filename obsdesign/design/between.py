"""What the limits of a path are between the nodes: least margins, with the error of finding them far below what is claimed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from obsdesign.constraints.abstract import Span
from obsdesign.design.instants import Instants, Intervals, best_instant, instants_of, stretches
from obsdesign.design.nodes import Nodes, nodes_of
from obsdesign.design.problem import DesignProblem
from obsdesign.simulation import states_from, substeps_along
from obsdesign.trajectory import Trajectory

FINER, _FINEST = 10, 160  # steps of the check for one step of the path: at first, and at most
_EXACT = 1e-8  # what integration may add to a margin of order 1
_CLOSE = 1e-5  # a path whose margins differ by less from those of steps a tenth as long, 10^4 times as exact, needs no finer ones
_ROUGH = 1e-6  # by how much polynomials of third and fifth degree may differ before an interval is halved
_NEAR = 1e-2  # lower bounds of margins below this are looked into
_HALVINGS = 12


@dataclass(frozen=True, eq=False)
class Low:
    """A local minimum of a margin in time: of which, when [s], and what it is; before: just before that time, the inputs held until it."""

    margin: int
    time: float
    value: float
    before: bool = False


@dataclass(frozen=True, eq=False)
class Fine:
    """A path integrated finely: t (F+1,), x (F+1, n), u (F, m) held from each instant to the next."""

    instants: Instants
    nodes: Nodes
    t: np.ndarray
    x: np.ndarray
    u: np.ndarray

    @property
    def h(self) -> float:
        """Seconds between two instants."""
        return float(self.t[1] - self.t[0])

    @cached_property
    def owner(self) -> np.ndarray:
        """Index of the constraint of every margin (r,)."""
        return np.array(self.nodes.owner, dtype=int)

    @property
    def margins(self) -> np.ndarray:
        """Margins (F+1, r) at the instants."""
        begin, end = self.ends
        return np.vstack([begin[0], end[0, -1:]])

    @cached_property
    def ends(self) -> tuple[np.ndarray, np.ndarray]:
        """Margins, first and second derivatives in time where each interval begins and where it ends: (3, F, r) each."""
        begin = np.array(self.instants.in_time(self.x[:-1], self.u))
        end = np.concatenate([begin[:, 1:], np.empty_like(begin[:, :1])], axis=1)
        jumps = np.append(np.flatnonzero(np.any(self.u[1:] != self.u[:-1], axis=1)), len(self.u) - 1)
        end[:, jumps] = np.array(self.instants.in_time(self.x[jumps + 1], self.u[jumps]))
        return begin, end

    def lows(self, mine: np.ndarray, span: Span) -> list[Low]:
        """Return the local minima of each of the margins `mine` that are near 0 or below within a span, and always its least one.

        On each interval a margin is the polynomial of fifth degree through values, slopes and curvatures at its ends, which differs
        from that of third degree by far more than from the margin itself: intervals are halved until these two agree to 1e-6.
        """
        within, low, high = stretches(self.t[:-1], self.h, *self._window(span))
        begin, end = (side[:2, within][:, :, mine] for side in self.ends)
        bound = np.minimum(begin[0], end[0]) - self.h * np.maximum(np.abs(begin[1]), np.abs(end[1]))
        which, at = np.nonzero((bound < np.maximum(_NEAR, bound.min(axis=0) + 1e-12)).T)
        chosen, margin = within[at], mine[which]
        tau, value = self._least(chosen, margin, low[at], high[at])
        at_end = tau >= self.h * (1 - 1e-9)
        return [
            Low(int(margin[k]), float(self.t[chosen[k]] + tau[k]), float(value[k]), bool(at_end[k]))
            for k in _local(chosen + which * (len(self.t) + 1), value)
        ]

    def best(self, mine: np.ndarray, span: Span) -> Low:
        """Return when, within a span, the least of the margins `mine` is largest."""
        within, low, high = stretches(self.t[:-1], self.h, *self._window(span))
        i, tau, value = best_instant(self.instants, Intervals(self.x[within], self.u[within], low, high), mine)
        return Low(int(mine[0]), float(self.t[within[i]] + tau), value)

    def _window(self, span: Span) -> tuple[float, float]:
        first, last = (self.t[-1] if time is None else min(time, self.t[-1]) for time in (span.first, span.last))
        return float(first), float(last)

    def _least(self, which: np.ndarray, margin: np.ndarray, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """When (seconds after they begin) margins (K,) are least in intervals (K,), each from low to high, and what they are then."""
        begin, end = (side[:, which, margin] for side in self.ends)
        share, value, error = _minimum(begin, end, np.full(len(which), self.h), low / self.h, high / self.h)
        tau = share * self.h
        for k in np.flatnonzero((error > _ROUGH) & (value - error < _NEAR)):
            tau[k], value[k] = self._halved(int(which[k]), int(margin[k]), float(low[k]), float(high[k]))
        return tau, value

    def _halved(self, i: int, j: int, low: float, high: float) -> tuple[float, float]:
        """The same for one interval, cut into ever shorter ones."""
        for halvings in range(1, _HALVINGS + 1):
            tau, value, settled = self._parted(i, j, np.linspace(low, high, 2**halvings + 1))
            if settled:
                break
        return tau, value  # pyright: ignore[reportPossiblyUnboundVariable]  # there is a halving

    def _parted(self, i: int, j: int, taus: np.ndarray) -> tuple[float, float, bool]:
        """When a margin is least between instants taus after interval i begins, what it is, and whether finer ones say the same."""
        x, u = np.repeat(self.x[[i]], len(taus), axis=0), np.repeat(self.u[[i]], len(taus), axis=0)
        sides = np.array(self.instants.in_time(self.instants.states(x, u, taus), u))[:, :, j]
        width = float(taus[1] - taus[0])
        count = len(taus) - 1
        share, value, error = _minimum(sides[:, :-1], sides[:, 1:], np.full(count, width), np.zeros(count), np.ones(count))
        k = int(value.argmin())
        return float(taus[k] + share[k] * width), float(value[k]), not ((error > _ROUGH) & (value - error < value[k])).any()


def fine_margins(problem: DesignProblem, path: Trajectory) -> Fine:
    """Return a path integrated ten times as finely, or finer, until its margins at the nodes are exact to 1e-8 by Richardson's rule."""
    model = problem.system.model
    nodes = nodes_of(model, problem.constraints)
    instants, finer = instants_of(model, problem.constraints), FINER
    _, fine, u = refined(problem, path, finer)
    near = _differ(instants, path, path.x, fine[::finer]) <= _CLOSE
    coarse = fine if near else refined(problem, path, finer // 2)[1]
    while not near and finer < _FINEST and _differ(instants, path, coarse[:: finer // 2], fine[::finer]) > 15 * _EXACT:
        coarse, finer = fine, 2 * finer
        _, fine, u = refined(problem, path, finer)
    return Fine(instants, nodes, np.arange(len(fine)) * (path.step / finer), fine, u)


def _differ(instants: Instants, path: Trajectory, one: np.ndarray, other: np.ndarray) -> float:
    """By how much the margins at the nodes differ between two sets of states (N+1, n), where they are near 0."""
    u = np.vstack([path.u, path.u[-1:]])
    rest = np.zeros(len(u))
    first, second = instants.values(one, u, rest), instants.values(other, u, rest)
    return float(np.abs(first - second)[first < 1.0].max(initial=0.0))


def refined(problem: DesignProblem, path: Trajectory, finer: int) -> tuple[float, np.ndarray, np.ndarray]:
    """Return shorter steps [s] along a path, so many for each of its own: states (finer N + 1, n), inputs (finer N, m).

    They are made of at least as many sub-steps as the path itself.
    """
    substeps = -(-substeps_along(problem.system, path) // finer)
    u = np.repeat(path.u, finer, axis=0)
    return path.step / finer, states_from(problem.system, path.x[:1], u, path.step / finer, substeps=substeps)[0], u


def _minimum(
    begin: np.ndarray, end: np.ndarray, h: np.ndarray, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return share (K,) of intervals of h (K,) seconds, within [low, high], at which a quintic is least, its value, and an error.

    begin, end (3, K): value and derivatives. The quintic is that of Hermite; error: by how much the cubic differs from it there.
    """
    (a, b, c), (d, e, f) = ((side[0], side[1] * h, side[2] * h * h / 2) for side in (begin, end))
    rise = d - a
    quintic = np.stack(
        [
            a,
            b,
            c,
            10 * rise - 6 * b - 4 * e - 3 * c + f,
            -15 * rise + 8 * b + 7 * e + 3 * c - 2 * f,
            6 * rise - 3 * b - 3 * e - c + f,
        ]
    )
    cubic = np.stack([a, b, 3 * rise - 2 * b - e, b + e - 2 * rise])
    shares = low + (high - low) * np.linspace(0, 1, 9)[:, None]
    values = _polynomial(quintic, shares)
    k, columns = values.argmin(axis=0), np.arange(len(h))
    share = shares[k, columns]
    for _ in range(4):
        slope, bend = _polynomial(_derived(quintic), share), _polynomial(_derived(_derived(quintic)), share)
        moved = np.where(bend > 0, -slope / np.where(bend > 0, bend, 1.0), 0.0)
        share = np.clip(share + np.clip(moved, -0.125, 0.125), low, high)
    value, at_first = _polynomial(quintic, share), values[k, columns]
    share, value = np.where(value <= at_first, share, shares[k, columns]), np.minimum(value, at_first)
    return share, value, np.abs(_polynomial(cubic, shares) - values).max(axis=0)


def _polynomial(coefficients: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Values of polynomials, coefficients (degree + 1, K) in rising order."""
    value = coefficients[-1] + 0 * at
    for each in coefficients[-2::-1]:
        value = value * at + each
    return value


def _derived(coefficients: np.ndarray) -> np.ndarray:
    return coefficients[1:] * np.arange(1, len(coefficients))[:, None]


def _local(which: np.ndarray, value: np.ndarray) -> np.ndarray:
    """Return where the least values (K,) of intervals, which (K,) are their numbers in rising order, have local minima."""
    before, after = np.full(len(which), np.inf), np.full(len(which), np.inf)
    follows = np.flatnonzero(np.diff(which) == 1)
    before[follows + 1], after[follows] = value[follows], value[follows + 1]
    return np.flatnonzero((value <= before) & (value < after) | (value < before) & (value <= after))
