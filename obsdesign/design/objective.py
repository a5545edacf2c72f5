"""What a design maximises of a path: one definition, for one path or many."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.costs._price_budget import Price
from obsdesign.criteria._factor import schur_complement
from obsdesign.criteria.abstract import AbstractCriterion, Knowledge
from obsdesign.design.instants import instants_of
from obsdesign.design.path_costs import total_costs
from obsdesign.design.robust import Robust
from obsdesign.dynamics.model import AbstractSystem
from obsdesign.dynamics.simulation import simulate
from obsdesign.information.accumulation import path_information
from obsdesign.information.batches import batch_information
from obsdesign.information.gramian import variational_gramian
from obsdesign.information.posterior import posterior_information
from obsdesign.round_off import may_be_singular
from obsdesign.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class PathObjective:
    """criterion(S (W + known) S) minus prices, W from the samples along a path, S = diag(units).

    units (n,): what counts as one unit of each state; known (n, n): information that is already there [1/(unit_i unit_j)]; judged:
    indices of the states whose Schur complement the criterion sees; weights (K, S): how much samples count, None = once; robust: judge
    by draws of a prior instead. step [s] and tolerance: how many paths at once are simulated.
    """

    system: AbstractSystem
    step: float
    tolerance: float
    criterion: AbstractCriterion
    units: np.ndarray
    known: np.ndarray
    judged: np.ndarray
    weights: np.ndarray | None
    prices: tuple[Price, ...]
    robust: Robust | None

    # ---------------------------------------------------------------- of information

    def scaled(self, W: np.ndarray) -> np.ndarray:
        """S W S (..., n, n), without unit."""
        return W * (self.units[:, None] * self.units)  # in this order what is symmetric stays so, to the last bit

    def criterion_matrix(self, W: np.ndarray) -> np.ndarray:
        """S (W + known) S (..., n, n), without unit: what of the samples' information W (..., n, n) and of `known` the criterion sees."""
        return self.scaled(W + self.known)

    def criterion_value(self, W: np.ndarray) -> float:
        """Return the criterion of information W (n, n): of S (W + known) S, about the judged states."""
        return self.criterion.value(schur_complement(self.criterion_matrix(W), self.judged))

    # ---------------------------------------------------------------- of paths

    def information_matrix(self, path: Trajectory) -> np.ndarray:
        """Return the matrix (n, n) that the criterion judges of a path: W about x(t_0), or J after the last samples.

        Of a posterior over several instants it is the last that is judged, if any.
        """
        knowledge = self.criterion.knowledge
        if knowledge is None:
            W = path_information(self.system, path, self.weights)
            residues = self.weights is None and may_be_singular(self.scaled(W))
            return variational_gramian(self.system, path).visibility.information if residues else W
        return self._posterior(path, knowledge)[-2]

    def _posterior(self, path: Trajectory, knowledge: Knowledge) -> np.ndarray:
        """J (N+1, n, n) about x(t_k), of the samples that have a weight."""
        active = None if self.weights is None else np.repeat(self.weights > 0, path.steps // len(self.weights), axis=0)
        return posterior_information(
            self.system,
            path,
            knowledge.prior,
            knowledge.disturbance_psd,
            knowledge.unknown_inputs,
            active,
            input_psd=knowledge.input_psd,
        )

    def matrix(self, path: Trajectory) -> np.ndarray:
        """S (W + known) S (n, n) of a path."""
        return self.criterion_matrix(self.information_matrix(path))

    def value(self, path: Trajectory) -> float:
        """criterion(S (W + known) S) of a path, or what its numbers at several instants make; prices are not in it."""
        instants, knowledge = instants_of(self.criterion, path.steps), self.criterion.knowledge
        if instants is None or knowledge is None:
            return self.criterion_value(self.information_matrix(path))
        return instants.combination.total(np.array([self.criterion_value(J) for J in self._posterior(path, knowledge)[instants.steps]]))

    def values(self, starts: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Return the value (R,) of the path from each of the starts (R, n), with inputs u (N, m), or (R, N, m) for each its own.

        The same numbers as `value`; at once where all samples count once.
        """
        if self.criterion.knowledge is None and self.weights is None:
            sums = batch_information(self.system, starts, u, self.step, tolerance=self.tolerance).sum(axis=1)
        else:
            sums = np.zeros((len(starts), self.units.size, self.units.size))
        inputs = np.broadcast_to(u, (len(starts), *u.shape[-2:]))
        return np.array(
            [
                self.value(simulate(self.system, x, own_inputs, self.step, tolerance=self.tolerance))
                if may_be_singular(self.scaled(W))
                else self.criterion_value(W)
                for W, x, own_inputs in zip(sums, starts, inputs, strict=True)
            ]
        )

    def price(self, path: Trajectory) -> float:
        """Return what the criterion loses to prices along a path."""
        if not self.prices:
            return 0.0
        totals = total_costs(self.system, path, [price.cost for price in self.prices])
        return float(np.array([price.per_unit for price in self.prices]) @ totals)

    def objective(self, path: Trajectory) -> float:
        """Return what is maximised: the criterion of a path, or of the prior's draws along its inputs, minus prices."""
        if self.robust is None:
            return self.value(path) - self.price(path)
        values = self.values(self.robust.draws(self.robust.samples, 0), path.u)
        return float(values.min() if self.robust.worst else values.mean()) - self.price(path)
