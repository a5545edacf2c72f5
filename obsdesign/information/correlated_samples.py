"""Samples whose errors are not independent, kept as rows: what any of them say together, and amounts from below that add up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from obsdesign.dynamics.scan import Scan
from obsdesign.dynamics.step import CACHED
from obsdesign.information.additive_amounts import Counting, counting
from obsdesign.information.correlated_noise import Colour
from obsdesign.information.whitening import Seen, Taken, whitened


@dataclass(frozen=True, eq=False)
class Samples:
    """What the coloured outputs read along a path of N steps, about x(t_0).

    rows (N, q, n): dy/dx(t_0) / spread; level (N, q): 1 / spread; gate (N, q): share that arrives; due (N, q): where the clock of
    the output's sensor has a sample.
    """

    colour: Colour
    rows: np.ndarray
    level: np.ndarray
    gate: np.ndarray
    due: np.ndarray

    def only(self, places: Sequence[int]) -> Samples | None:
        """Return the samples of the sensors at those places among all, None where none of them is coloured."""
        found = {new: self.colour.places.index(old) for new, old in enumerate(places) if old in self.colour.places}
        if not found:
            return None
        kept = [j for s in found.values() for j in self.colour.outputs_of(s)]
        return Samples(self.colour.only(tuple(found.values()), tuple(found)), *(values[:, kept] for values in self._values))

    def then(self, later: Samples, Phi: np.ndarray) -> Samples:
        """Return these followed by others, taken where Phi (n, n) leads: errors go on as from one sample to the next."""
        moved = Samples(later.colour, later.rows @ Phi, later.level, later.gate, later.due)
        return Samples(self.colour, *(np.concatenate(pair) for pair in zip(self._values, moved._values, strict=True)))

    def information(self, share: np.ndarray | None = None) -> np.ndarray:
        """W (n, n) = A' R^-1 A, R the covariance of all errors; share (N, s): which sensors are on, or how much their samples count."""
        rows = self.independent if share is None else self._white(self.colour, share[:, list(self.colour.owner)])
        flat = rows.reshape(-1, rows.shape[-1])
        return flat.T @ flat

    def along(self, v: np.ndarray) -> np.ndarray:
        """Return (N, s) summing to v'W v: what each sample says beyond those before it, and beside it in its group."""
        each = (self._plain @ v) ** 2
        return np.stack([each[:, self.colour.outputs_of(s)].sum(axis=1) for s in range(len(self.colour.sensors))], axis=1)

    def amounts(self, firsts: np.ndarray) -> np.ndarray:
        """Return (K, s, n, n): what may be counted for each sensor in each of K stretches, which begin at steps `firsts`.

        However many of them are added up, they are no more than what those samples say together; see `counting`.
        """
        N, q, n = self.rows.shape
        rows = self._white(self.colour.apart, np.ones(self.level.shape), counting(self.colour, self.due, firsts), firsts)
        place = _places(firsts, N)
        rows = np.concatenate([rows, np.zeros((1, q, n))])[place]
        each = [rows[:, :, self.colour.outputs_of(s)].reshape(len(place), -1, n) for s in range(len(self.colour.sensors))]
        return np.stack([A.swapaxes(1, 2) @ A for A in each], axis=1)

    @property
    def independent(self) -> np.ndarray:
        """Rows (m, n) of variance 1: what each output says beyond those before it."""
        return self._plain.reshape(-1, self.rows.shape[-1])

    @property
    def _values(self) -> tuple[np.ndarray, ...]:
        return self.rows, self.level, self.gate, self.due

    @cached_property
    def _plain(self) -> np.ndarray:
        return self._white(self.colour, np.ones(self.level.shape))

    def _white(self, colour: Colour, share: np.ndarray, count: Counting | None = None, firsts: np.ndarray | None = None) -> np.ndarray:
        """Independent rows of variance 1 (N, q, n)."""
        N, q, n = self.rows.shape
        scan, start = _recursion(colour, n, count is not None)
        inputs = [self.rows.reshape(N, -1), self.level, self.gate, self.due.astype(float), share.astype(float)]
        if count is not None and firsts is not None:
            inputs += count.rows(firsts)
        return scan.run(start[None], inputs, N, carries=False).results[0][0].reshape(N, q, n)


def _places(firsts: np.ndarray, steps: int) -> np.ndarray:
    """Return (K, L): the steps of each of K stretches, L that of the longest, `steps` where a shorter one has none."""
    ends = np.append(firsts[1:], steps)
    place = firsts[:, None] + np.arange(int(np.max(ends - firsts)))
    return np.where(place < ends[:, None], place, steps)


@lru_cache(CACHED)
def _recursion(colour: Colour, n: int, counted: bool) -> tuple[Scan, np.ndarray]:
    """(carry, rows (q n), level, gate, due, share (q,)) -> independent rows (q n) of variance 1; counted: fresh, factor, spread as well."""
    q = colour.q
    rows = ca.SX.sym("rows", n, q)
    level, gate, due, share, factor, spread = (ca.SX.sym(name, q) for name in ("level", "gate", "due", "share", "factor", "spread"))
    fresh = ca.SX.sym("fresh")
    taken = Taken(due, share, fresh, factor, spread) if counted else Taken(due, share)
    one = whitened(colour, Seen(rows.T, level, gate), taken)
    found = ca.diag(ca.sqrt(one.weight)) @ one.rows
    inputs = [ca.vec(rows), level, gate, due, share, *((fresh, factor, spread) if counted else ())]
    return Scan(one.carry, inputs, one.carry_next, [ca.vec(ca.densify(found).T)]), one.start
