"""Branch and bound: whole fronts of partial schedules at a time, bounded by a pool of duals."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from obsdesign.selection.integer.reduced_problem import Layer, Walks, information_in, price_vector
from obsdesign.selection.problem import Instance
from obsdesign.selection.relaxation.column_generation import Relaxed, relaxed, size_of
from obsdesign.selection.relaxation.dual import Dual
from obsdesign.selection.relaxation.restricted_master import Column

_WIDTH = 1024  # partial schedules that are taken further at a time
_PRICES = 24  # duals that bound each of them ...
_NEW = 8  # ... of which so many are made for the front
_ROUNDS = 6  # of column generation for a front
_FEW = 8  # fronts of fewer are not worth new duals
_PRICED = 25  # times on the way through linked segments, where duals take long
_STALLED = 250  # fronts without a better schedule, after which the whole effort is estimated
_EARLY = 10  # fronts that settle what was out of the question anyway: no measure of how it goes on
_HOPELESS = 20.0  # times the allowed effort


@dataclass(frozen=True, eq=False)
class Effort:
    """Limits of a search: fronts that get duals of their own, partial schedules, whether time is up, and whether it stalls.

    stalls: whether to leave off once so much (a share of 1) is settled of what the first fronts left.
    """

    fronts: int
    nodes: int
    out_of_time: Callable[[], bool]
    stalls: Callable[[float], bool]


@dataclass(frozen=True, eq=False)
class Explored:
    """The best schedule met, what no schedule is above, fronts and partial schedules looked at, and whether none is left."""

    chosen: np.ndarray
    value: float
    bound: float
    fronts: int
    nodes: int
    complete: bool


@dataclass(frozen=True, eq=False)
class _Front:
    """Partial schedules that have the same layers left: states (F,), sums (F, c), steps (F, taken) in the layers taken, bounds (F,).

    duals: what bounds them; share: of the whole tree, for estimating its size.
    """

    left: Walks
    taken: tuple[Layer, ...]
    state: np.ndarray
    sums: np.ndarray
    steps: np.ndarray
    bound: np.ndarray
    duals: tuple[Dual, ...]
    share: float

    def only(self, keep: np.ndarray) -> _Front:
        """Return some of them; the share is that of all."""
        return _Front(self.left, self.taken, self.state[keep], self.sums[keep], self.steps[keep], self.bound[keep], self.duals, self.share)


def explored(
    instance: Instance, walks: Walks, duals: list[Dual], incumbent: tuple[np.ndarray, float], gap: float, effort: Effort
) -> Explored:
    """Return the best of the walks and the incumbent, proven to within gap where the effort suffices.

    A front is a set of partial schedules; the relaxation of the best of them gives duals that bound them all, and says on which
    segment to branch: on the one whose undecided share moves the information most. Ends early after the first better schedule:
    the caller decides anew what is decided.
    """
    chosen, value = incumbent
    if any(not len(layer.source) for layer in walks.layers) or not within_limits(instance, walks.base[None])[0]:
        return Explored(chosen, value, bar(value, gap, instance), 0, 0, True)  # what is decided leaves no schedule at all
    state = np.array([walks.first])
    stack = [_Front(walks, (), state, walks.base[None], np.zeros((1, 0), np.int32), np.array([np.inf]), tuple(duals[-_PRICES:]), 1.0)]
    fronts = nodes = 0
    settled = early = 0.0
    stride = max(1, len(walks.layers) // _PRICED) if walks.linked else 1
    while stack and fronts < effort.fronts and nodes < effort.nodes and not effort.out_of_time():
        front = stack.pop()
        least = bar(value, gap, instance)
        if not front.left.layers:
            found, best = _best_of(instance, walks, front)
            settled += front.share
            if best > value:
                return Explored(found, best, np.inf, fronts, nodes, False)
            continue
        shares = None
        if not front.taken or (len(front.bound) >= _FEW and len(front.taken) % stride == 0):
            front, shares = _priced(instance, front)
            fronts += 1
        grown, nodes_of = _grown(instance, front, shares, least)
        nodes += nodes_of
        settled += front.share - sum(each.share for each in grown)
        stack += grown
        early = settled if fronts <= _EARLY else early
        hopeless = fronts >= _STALLED and fronts > _HOPELESS * effort.fronts * max(settled, 1e-300)
        if hopeless or effort.stalls((settled - early) / max(1 - early, 1e-300)):
            break
    left = max((float(front.bound.max()) for front in stack), default=-np.inf)
    return Explored(chosen, value, max(left, bar(value, gap, instance)), fronts, nodes, not stack)


def bar(value: float, gap: float, instance: Instance) -> float:
    """What a bound has to be above to be worth a look: half of the gap is left for rounding."""
    return value + 0.5 * gap * size_of(value, instance) if np.isfinite(value) else value


def constants_of(instance: Instance, duals: Sequence[Dual], level: float) -> np.ndarray:
    """Return what the bounds of duals (J,) have beside what is added up, with what rounding may hide where it counts at a level."""
    return np.array([instance.constant(dual) + instance.slack(dual, level) for dual in duals])


def _priced(instance: Instance, front: _Front) -> tuple[_Front, np.ndarray | None]:
    """Solve the relaxation of what is left for the best of the front: its duals bound all of it; and the shares of the steps."""
    index = int(front.bound.argmax())
    sums, state = front.sums[index], int(front.state[index])

    def oracle(dual: Dual) -> tuple[float, Column]:
        y = price_vector(dual)
        steps, adds = front.left.best(y, state)
        total = sums + adds
        m = len(instance.resources)
        usage = total[len(total) - 1 - m : -1]
        return instance.constant(dual) + float(y @ total), Column(steps, information_in(instance, total), usage, float(total[-1]))

    Y = np.stack([price_vector(dual) for dual in front.duals], axis=1)
    ahead = front.left.ahead(front.duals, Y)[state]
    constants = np.array([instance.constant(dual) for dual in front.duals])
    nearest = front.duals[int((sums @ Y + ahead + constants).argmin())]
    found = relaxed(instance, 1e-6, (nearest,), _ROUNDS, oracle)
    if found is None:
        return front, None
    duals = (*front.duals, *(dual for dual, _ in found.met[-_NEW:]))[-_PRICES:]
    bounded = _Front(front.left, front.taken, front.state, front.sums, front.steps, front.bound, duals, front.share)
    return bounded, None if front.left.linked else _influence(instance, front.left, found)


def _influence(instance: Instance, left: Walks, found: Relaxed) -> np.ndarray:
    """How much of the information each layer (layers,) leaves undecided: the variance of what it adds, as the dual weighs it."""
    picks = np.stack([column.chosen for column in found.columns])
    root = np.linalg.cholesky(found.dual.Z + 1e-12 * np.trace(found.dual.Z.sum(axis=0)) * np.eye(instance.n))
    influence = np.zeros(len(left.layers))
    for i, layer in enumerate(left.layers):
        shares = np.bincount(picks[:, i], weights=found.shares, minlength=len(layer.adds))
        if shares.max() < 1 - 1e-9:
            spread = information_in(instance, layer.adds - shares @ layer.adds)
            influence[i] = shares @ np.sum((root.swapaxes(1, 2) @ spread @ root) ** 2, axis=(1, 2, 3))
    return influence


def _grown(instance: Instance, front: _Front, influence: np.ndarray | None, least: float) -> tuple[list[_Front], int]:
    """Take every partial schedule one step further, in each way that its bound allows: new fronts, the best one last; and how many."""
    Y = np.stack([price_vector(dual) for dual in front.duals], axis=1)
    constants = constants_of(instance, front.duals, least)
    bound = np.minimum(front.bound, (front.sums @ Y + front.left.ahead(front.duals, Y)[front.state] + constants).min(axis=1))
    whole = len(front.bound)
    front = front.only(bound > least)
    bound = bound[bound > least]
    index = 0 if front.left.linked else _branch(front.left, Y, influence)
    layer, rest = front.left.layers[index], front.left.without(index)
    counts = layer.begin[front.state + 1] - layer.begin[front.state]
    parent = np.repeat(np.arange(len(counts)), counts)
    step = np.arange(len(parent)) - np.repeat(np.cumsum(counts) - counts, counts) + np.repeat(layer.begin[front.state], counts)
    sums, state = front.sums[parent] + layer.adds[step], layer.target[step]
    bound = np.minimum(bound[parent], (sums @ Y + rest.ahead(front.duals, Y)[state] + constants).min(axis=1))
    keep = (bound > least) & within_limits(instance, sums)
    share = (front.share / whole / np.maximum(counts, 1)[parent])[keep]
    parent, step, sums, state, bound = parent[keep], step[keep], sums[keep], state[keep], bound[keep]
    order = np.argsort(bound, kind="stable")
    found = []
    for first in range(0, len(order), _WIDTH):
        part = order[first : first + _WIDTH]
        steps = np.column_stack([front.steps[parent[part]], step[part].astype(np.int32)])
        found.append(
            _Front(rest, (*front.taken, layer), state[part], sums[part], steps, bound[part], front.duals, float(share[part].sum()))
        )
    return found, len(order)


def _branch(left: Walks, Y: np.ndarray, influence: np.ndarray | None) -> int:
    """The layer to branch on: the one of most influence, or where it is not known the one whose steps differ most in price."""
    if influence is not None and influence.any():
        return int(influence.argmax())
    return int(np.argmax([np.ptp(layer.adds @ Y, axis=0).max() for layer in left.layers]))


def within_limits(instance: Instance, sums: np.ndarray) -> np.ndarray:
    """Whether no resource is exceeded yet, but for rounding."""
    m = len(instance.resources)
    if not m:
        return np.ones(len(sums), dtype=bool)
    return np.all(sums[:, -1 - m : -1] <= instance.limits + 1e-9 * np.maximum(1.0, instance.limits), axis=1)


def _best_of(instance: Instance, walks: Walks, front: _Front) -> tuple[np.ndarray, float]:
    """The best of whole schedules, recomputed from its sensors."""
    chosen = schedules_of(walks, front.taken, front.steps)
    values = instance.values(chosen, information_in(instance, front.sums)) - front.sums[:, -1]
    best = int(values.argmax())
    return chosen[best], instance.value(chosen[best])


def schedules_of(walks: Walks, taken: tuple[Layer, ...], steps: np.ndarray) -> np.ndarray:
    """Return the schedules (F, K, S) of steps (F, taken) in the layers taken."""
    chosen = np.repeat(walks.chosen[None], len(steps), axis=0)
    for layer, step in zip(taken, steps.T, strict=True):
        chosen[:, layer.segment] = layer.patterns[step]
    return chosen
