"""Label setting on aggregated states: partial schedules go on from the first segment, and those that are alike are joined.

What the filter knows after a partial schedule is a covariance P, and what it has cost a number c. Several partial schedules after which
the same may follow are joined into one with a covariance below all theirs and the least of their costs: as later costs are monotone in
covariances, whatever follows costs no less after any of them. The least cost at the end is then below that of every schedule, and exact
where nothing was joined. The joined schedules of all segments with the steps between them are themselves a relaxation, whose cost-to-go
bounds that of every schedule that passes: another pass follows its steps, joins only what lies in one of its states, and leaves out what
cannot be below the limit. So states are refined pass by pass where it matters. Windows are such a relaxation too.

The field's names: dynamic programming with state aggregation (decremental state-space relaxation), label setting with bounds.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from obsdesign.selection.posterior.ceiling import meet_of_groups
from obsdesign.selection.posterior.clusters import cluster
from obsdesign.selection.posterior.deepening import Chain, open_pairs, priced_cost, total_cost
from obsdesign.selection.posterior.problem import PosteriorProblem
from obsdesign.selection.posterior.trellis import backtrack, first_by_key
from obsdesign.selection.posterior.windows import smallest_by_key


@dataclass(frozen=True, eq=False)
class StateLayer:
    """The W aggregated states after a segment, and the E steps that lead to them, sorted by the state they come from.

    parent, node, state (E,): from, with which choice, to; cost (E,) and amounts (R + 1, E): what a step costs at least, what it switches on
    and takes of each resource. P (n, n, W): below every covariance there. cost_after (M, W), amounts_after (R + 1, W): what is needed on to
    the end at least, at each of M prices.
    """

    parent: np.ndarray
    node: np.ndarray
    state: np.ndarray
    cost: np.ndarray
    amounts: np.ndarray
    P: np.ndarray
    cost_after: np.ndarray
    amounts_after: np.ndarray

    def only(self, steps: np.ndarray) -> StateLayer:
        """Return the layer with some of the steps."""
        parts = {name: getattr(self, name)[..., steps] for name in ("parent", "node", "state", "cost", "amounts")}
        return replace(self, **parts)


@dataclass(frozen=True, eq=False)
class Labels:
    """Partial schedules: the last node (B,), cost (M, B) at each of the prices, amounts (R + 1, B) so far, P (n, n, B), state (B,)."""

    node: np.ndarray
    cost: np.ndarray
    amounts: np.ndarray
    P: np.ndarray
    state: np.ndarray


@dataclass(frozen=True, eq=False)
class Relaxation:
    """Aggregated states after each segment; prices (M, R) of the resources; bound: no schedule below `limit` costs less."""

    layers: list[StateLayer]
    prices: np.ndarray
    bound: float


@dataclass(frozen=True, eq=False)
class Refinement:
    """What one pass came to: the finer relaxation, None where nothing below the limit is left; a schedule (K,); how many were simulated.

    Without both where is_stopped: the deadline was over before the pass was.
    """

    relaxation: Relaxation | None
    nodes: np.ndarray | None
    simulated: int
    is_stopped: bool = False


def relaxation_of_windows(chain: Chain, limit: float) -> Relaxation:
    """Return windows as aggregated states: a window is the state of all schedules with its choices."""
    layers = []
    for k, layer in enumerate(chain.layers):
        before, window = open_pairs(chain, k, limit) if k else (np.zeros(len(layer.node), dtype=int), np.arange(len(layer.node)))
        order = np.argsort(before, kind="stable")
        before, window = before[order], window[order]
        cost, amounts = layer.cost[window], layer.amounts[:, window]
        layers.append(StateLayer(before, layer.node[window], window, cost, amounts, layer.P, chain.cost_after[k], chain.amounts_after[k]))
    return Relaxation(layers, chain.prices, chain.bound)


def relaxation_of_ceilings(chain: Chain) -> Relaxation:
    """Return one state after each segment, the ceiling: schedules are then joined by what they know and cost alone.

    chain: of windows of one choice, in a problem in which what is chosen in one segment leaves open all choices in others.
    """
    layers = []
    for k, layer in enumerate(chain.layers):
        nothing, following = np.zeros(len(layer.node), dtype=int), k + 1 < len(chain.layers)
        P = chain.problem.ceilings[k + 1][:, :, None] if following else np.zeros((*chain.problem.P0.shape, 1))
        after = [values.min(axis=1, keepdims=True) for values in (chain.cost_after[k], chain.amounts_after[k])]
        layers.append(StateLayer(nothing, layer.node, nothing, layer.cost, layer.amounts, P, *after))
    return Relaxation(layers, chain.prices, chain.bound)


def refine(
    problem: PosteriorProblem,
    relaxation: Relaxation,
    slopes: np.ndarray,
    limit: float,
    width: int,
    tolerance: float,
    *,
    is_bound: bool = True,
) -> Refinement:
    """Return the relaxation of one pass with about `width` states after each segment; slopes: `cost_slopes`, tolerance: see `cluster`.

    Schedules that cost at least the limit are left out. Without is_bound the best schedule of each state stays as it is instead of
    a join: good schedules, no relaxation.
    """
    labels = _start(problem, len(relaxation.prices))
    layers, stages, simulated = [], [], 0
    for k, old in enumerate(relaxation.layers):
        if problem.deadline.is_over:
            return Refinement(None, None, simulated, is_stopped=True)
        label, step = _steps(labels, old)
        is_open = _total(problem, relaxation.prices, labels, label, old.only(step)) < limit
        label, steps = label[is_open], old.only(step[is_open])
        cost, amounts, P = problem.advance(k, labels.node[label], steps.node, labels.P[:, :, label])
        simulated += len(cost)
        # never less, but for rounding
        steps = replace(steps, cost=np.maximum(cost, steps.cost), amounts=np.maximum(amounts, steps.amounts))
        is_open = _total(problem, relaxation.prices, labels, label, steps) < limit
        if not is_open.any():
            return Refinement(None, None, simulated)
        label, steps = label[is_open], steps.only(is_open)
        longer = _next_labels(problem, relaxation.prices, labels, label, steps, P[:, :, is_open])
        state, count = _states(problem, longer, old, slopes[k + 1], width if k + 1 < problem.segments else len(label), tolerance)
        best = _best(problem, relaxation.prices, longer, old, slopes[k + 1], state)
        labels = _join_states(longer, state, count, best) if is_bound else _selection(longer, best)
        layers.append(replace(steps, parent=label, state=state, P=labels.P))
        stages.append((label[best], steps.node[best]))
    bound = min(limit, float(total_cost(problem, relaxation.prices, labels.cost, labels.amounts).min()))
    nodes = backtrack(stages, int(total_cost(problem, relaxation.prices, labels.cost, labels.amounts).argmin()))
    return Refinement(_with_costs_after(problem, layers, relaxation.prices, bound) if is_bound else None, nodes, simulated)


def _start(problem: PosteriorProblem, prices: int) -> Labels:
    R = len(problem.limits)
    cost = np.full((prices, 1), -np.inf if problem.is_worst else 0.0)
    return Labels(np.array([-1]), cost, np.zeros((R + 1, 1)), problem.P0[:, :, None], np.zeros(1, dtype=int))


def _steps(labels: Labels, layer: StateLayer) -> tuple[np.ndarray, np.ndarray]:
    """Return which label takes which step of a layer, as indices (B,) each, by label."""
    first = np.searchsorted(layer.parent, labels.state, side="left")
    count = np.searchsorted(layer.parent, labels.state, side="right") - first
    label = np.repeat(np.arange(len(count)), count)
    return label, np.arange(len(label)) - np.repeat(np.cumsum(count) - count - first, count)


def _total(problem: PosteriorProblem, prices: np.ndarray, labels: Labels, label: np.ndarray, steps: StateLayer) -> np.ndarray:
    """Return what every schedule (B,) that goes on from a label with a step costs at least; inf where it takes more than there is."""
    own = problem.combine(priced_cost(problem, steps, prices), steps.cost_after[:, steps.state])
    amounts = labels.amounts[:, label] + steps.amounts + steps.amounts_after[:, steps.state]
    return total_cost(problem, prices, problem.combine(labels.cost[:, label], own), amounts)


def _next_labels(
    problem: PosteriorProblem, prices: np.ndarray, labels: Labels, label: np.ndarray, steps: StateLayer, P: np.ndarray
) -> Labels:
    cost = problem.combine(labels.cost[:, label], priced_cost(problem, steps, prices))
    return Labels(steps.node, cost, labels.amounts[:, label] + steps.amounts, P, steps.state)


def _expected_cost(problem: PosteriorProblem, prices: np.ndarray, labels: Labels, layer: StateLayer, slope: np.ndarray) -> np.ndarray:
    """Return what is expected of labels (B,) to the end: their state's cost-to-go, and to first order what they know less."""
    cost = problem.combine(labels.cost, layer.cost_after[:, labels.state])
    amounts = np.zeros_like(labels.amounts)
    amounts[0] = labels.amounts[0] + layer.amounts_after[0, labels.state]
    return total_cost(problem, prices, cost, amounts) + np.einsum("ij,ijb->b", slope, labels.P - layer.P[:, :, labels.state])


def _states(
    problem: PosteriorProblem, labels: Labels, layer: StateLayer, slope: np.ndarray, width: int, tolerance: float
) -> tuple[np.ndarray, int]:
    """Return the aggregated state of each label (B,) and their number."""
    B = len(labels.state)
    if width >= B:
        return np.arange(B), B
    known = np.einsum("ij,ijb->b", slope, labels.P)
    prices = np.zeros((len(labels.cost), len(labels.amounts) - 1))
    expected = _expected_cost(problem, prices, labels, layer, slope) - known
    state = cluster(labels.state, expected, labels.P, slope, width, tolerance)
    return state, int(state.max()) + 1


def _best(
    problem: PosteriorProblem, prices: np.ndarray, labels: Labels, layer: StateLayer, slope: np.ndarray, state: np.ndarray
) -> np.ndarray:
    """Return the label of each state of which most is expected."""
    return first_by_key(state, _expected_cost(problem, prices, labels, layer, slope))


def _join_states(labels: Labels, state: np.ndarray, count: int, best: np.ndarray) -> Labels:
    if count == len(state):
        return _selection(labels, best)
    cost, amounts = smallest_by_key(labels.cost, state, count), smallest_by_key(labels.amounts, state, count)
    return replace(_selection(labels, best), cost=cost, amounts=amounts, P=meet_of_groups(labels.P, state, count))


def _selection(labels: Labels, index: np.ndarray) -> Labels:
    return Labels(labels.node[index], labels.cost[:, index], labels.amounts[:, index], labels.P[:, :, index], labels.state[index])


def _with_costs_after(problem: PosteriorProblem, layers: list[StateLayer], prices: np.ndarray, bound: float) -> Relaxation:
    """Return the relaxation with what is needed after each state at least, backwards."""
    last = layers[-1].P.shape[2]
    cost = np.full((len(prices), last), -np.inf if problem.is_worst else 0.0)
    amounts = np.zeros((len(layers[-1].amounts), last))
    done = []
    for k in range(len(layers) - 1, -1, -1):
        layer = replace(layers[k], cost_after=cost, amounts_after=amounts)
        done.append(layer)
        before = layers[k - 1].P.shape[2] if k else 1
        own = problem.combine(priced_cost(problem, layer, prices), cost[:, layer.state])
        cost = smallest_by_key(own, layer.parent, before)
        amounts = smallest_by_key(layer.amounts + amounts[:, layer.state], layer.parent, before)
    return Relaxation(done[::-1], prices, bound)
