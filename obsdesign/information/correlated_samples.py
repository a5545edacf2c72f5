"""Samples whose errors are not independent, kept as rows: what any of them say together, and amounts from below that add up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from obsdesign.dynamics.scan import Scan
from obsdesign.dynamics.step import CACHE_SIZE
from obsdesign.errors import InputError
from obsdesign.information.additive_amounts import AdditiveFactors, additive_factors
from obsdesign.information.correlated_noise import Colour
from obsdesign.information.whitening import ColouredOutputs, SampleSelection, whiten


@dataclass(frozen=True, eq=False)
class CorrelatedSamples:
    """What the coloured outputs read at M instants along a path of N steps, about x(t_0).

    rows (M, q, n): dy/dx(t_0) / spread; level (M, q): 1 / spread; gate (M, q): share that arrives; sampling (M, q): where the clock of
    the output's sensor has a sample; step (M,): in which step each instant is, none before the other; decay (M, q): what is left of
    errors from each instant to the next, None: the sensor's correlation from one instant of its clock to the next.
    """

    colour: Colour
    rows: np.ndarray
    level: np.ndarray
    gate: np.ndarray
    sampling: np.ndarray
    step: np.ndarray
    steps: int
    decay: np.ndarray | None = None

    def only(self, sensor_indices: Sequence[int]) -> CorrelatedSamples | None:
        """Return the samples of the sensors at those places among all, None where none of them is coloured."""
        coloured = {
            new: self.colour.sensor_indices.index(old) for new, old in enumerate(sensor_indices) if old in self.colour.sensor_indices
        }
        if not coloured:
            return None
        outputs = [j for s in coloured.values() for j in self.colour.outputs_of(s)]
        rows, level, gate, sampling = (values[:, outputs] for values in self._arrays)
        colour = self.colour.only(tuple(coloured.values()), tuple(coloured))
        decay = None if self.decay is None else self.decay[:, outputs]
        return CorrelatedSamples(colour, rows, level, gate, sampling, self.step, self.steps, decay)

    def then(self, later: CorrelatedSamples, Phi: np.ndarray) -> CorrelatedSamples:
        """Return these followed by others, taken where Phi (n, n) leads: errors go on as from one sample to the next.

        Raises InputError where one of them has samples of a log and the other those that rates promise.
        """
        if (self.decay is None) != (later.decay is None):
            raise InputError("information of samples of a log and of samples by rates do not follow each other")
        transported = later.rows @ Phi, later.level, later.gate, later.sampling
        rows, level, gate, sampling = (np.concatenate(pair) for pair in zip(self._arrays, transported, strict=True))
        step = np.concatenate([self.step, self.steps + later.step])
        decay = None if self.decay is None or later.decay is None else np.concatenate([self.decay, later.decay])
        return CorrelatedSamples(self.colour, rows, level, gate, sampling, step, self.steps + later.steps, decay)

    def information(self, weights: np.ndarray | None = None) -> np.ndarray:
        """W (n, n) = A' R^-1 A, R the covariance of all errors; weights (N, s): which sensors are on, or how much their samples count."""
        rows = self.independent_rows if weights is None else self._whiten(self.colour, weights[self.step][:, list(self.colour.owner)])
        stacked = rows.reshape(-1, rows.shape[-1])
        return stacked.T @ stacked

    def along(self, v: np.ndarray) -> np.ndarray:
        """Return (N, s) summing to v'W v: what each sample says beyond those before it, and beside it in its group."""
        squares = (self._rows_of_unit_variance @ v) ** 2
        at_instants = np.stack([squares[:, self.colour.outputs_of(s)].sum(axis=1) for s in range(len(self.colour.sensors))], axis=1)
        by_step = np.zeros((self.steps, at_instants.shape[1]))
        np.add.at(by_step, self.step, at_instants)
        return by_step

    def amounts(self, firsts: np.ndarray) -> np.ndarray:
        """Return (K, s, n, n): what may be counted for each sensor in each of K stretches, which begin with steps `firsts`.

        However many of them are added up, they are no more than what those samples say together; see `additive_factors`.
        """
        M, q, n = self.rows.shape
        firsts = np.searchsorted(self.step, firsts)
        factors = additive_factors(self.colour, self.sampling, firsts, self.decay)
        rows = self._whiten(self.colour.without_cross_correlation, np.ones(self.level.shape), factors, firsts)
        step_indices = _step_indices(firsts, M)
        rows = np.concatenate([rows, np.zeros((1, q, n))])[step_indices]
        sensor_rows = [rows[:, :, self.colour.outputs_of(s)].reshape(len(step_indices), -1, n) for s in range(len(self.colour.sensors))]
        return np.stack([A.swapaxes(1, 2) @ A for A in sensor_rows], axis=1)

    @property
    def independent_rows(self) -> np.ndarray:
        """Rows (m, n) of variance 1: what each output says beyond those before it."""
        return self._rows_of_unit_variance.reshape(-1, self.rows.shape[-1])

    @property
    def _arrays(self) -> tuple[np.ndarray, ...]:
        return self.rows, self.level, self.gate, self.sampling

    @cached_property
    def _rows_of_unit_variance(self) -> np.ndarray:
        return self._whiten(self.colour, np.ones(self.level.shape))

    def _whiten(
        self, colour: Colour, weights: np.ndarray, factors: AdditiveFactors | None = None, firsts: np.ndarray | None = None
    ) -> np.ndarray:
        """Independent rows of variance 1 (N, q, n)."""
        N, q, n = self.rows.shape
        scan, start = _whitening_scan(colour, n, factors is not None, self.decay is not None)
        inputs = [self.rows.reshape(N, -1), self.level, self.gate, self.sampling.astype(float), weights.astype(float)]
        inputs += [] if self.decay is None else [self.decay]
        if factors is not None and firsts is not None:
            inputs += factors.rows(firsts)
        return scan.run(start[None], inputs, N, carries=False).results[0][0].reshape(N, q, n)


def _step_indices(firsts: np.ndarray, steps: int) -> np.ndarray:
    """Return (K, L): the steps of each of K stretches, L that of the longest, `steps` where a shorter one has none."""
    ends = np.append(firsts[1:], steps)
    indices = firsts[:, None] + np.arange(int(np.max(ends - firsts)))
    return np.where(indices < ends[:, None], indices, steps)


@lru_cache(CACHE_SIZE)
def _whitening_scan(colour: Colour, n: int, is_additive: bool, has_decay: bool) -> tuple[Scan, np.ndarray]:
    """(carry, rows (q n), level, gate, due, share (q,)) -> independent rows (q n) of variance 1.

    has_decay: decay (q,) too; is_additive: fresh, factor, spread too.
    """
    q = colour.q
    rows = ca.SX.sym("rows", n, q)
    level, gate, sampling, weights, factor, bias_factor, decay = (
        ca.SX.sym(name, q) for name in ("level", "gate", "due", "share", "factor", "spread", "decay")
    )
    is_first = ca.SX.sym("fresh")
    selection = SampleSelection(sampling, weights, is_first, factor, bias_factor) if is_additive else SampleSelection(sampling, weights)
    selection = replace(selection, decay=decay) if has_decay else selection
    innovations = whiten(colour, ColouredOutputs(rows.T, level, gate), selection)
    scaled_rows = ca.diag(ca.sqrt(innovations.weight)) @ innovations.rows
    inputs = [
        ca.vec(rows),
        level,
        gate,
        sampling,
        weights,
        *([decay] if has_decay else []),
        *((is_first, factor, bias_factor) if is_additive else ()),
    ]
    return Scan(innovations.carry, inputs, innovations.carry_next, [ca.vec(ca.densify(scaled_rows).T)]), innovations.start
