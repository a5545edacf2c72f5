"""The rows C Phi of the samples along a path about its start, and what rounding does to them."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from obsdesign.dynamics.model import AbstractSystem
from obsdesign.dynamics.simulation import held_along, states_from, substeps_along
from obsdesign.information.row_rounding import DRAWS, Rounded, rounded, typed_sizes
from obsdesign.information.sample_information import sampled
from obsdesign.round_off import EPS, triangular
from obsdesign.trajectory import Trajectory

_PIECE = 4096  # instants that are taken at a time: their errors take several times the memory of the rows
_UNIT = EPS / np.sqrt(DRAWS)


@dataclass(frozen=True, eq=False)
class Stretch:
    """rows (N, q, n), weighted; errors (k, n), what rounding does to them; Phi (n, n) at its end, with DRAWS errors (d, n, n)."""

    rows: np.ndarray
    errors: np.ndarray
    Phi: np.ndarray
    Phi_errors: np.ndarray

    def following(self, earlier: Stretch) -> Stretch:
        """Return this about the start of another that leads to its own; to first order in the errors."""
        n = len(self.Phi)
        led = (triangular(self.rows.reshape(-1, n)) @ earlier.Phi_errors).reshape(-1, n)
        errors = np.concatenate([self.errors @ earlier.Phi, led])
        Phi_errors = self.Phi_errors @ earlier.Phi + self.Phi @ earlier.Phi_errors
        return Stretch(self.rows @ earlier.Phi, errors, self.Phi @ earlier.Phi, Phi_errors)


def stretch_of(system: AbstractSystem, path: Trajectory, kept: tuple[int, ...], weighted: bool) -> Stretch:
    """Return the rows of the sensors `kept` (indices): a sample's by its noise, 0 where there is none, or of an integral over time.

    The integral is by Simpson's rule, its nodes at the start, in the middle and at the end of each step: what it does not see is hidden.
    """
    owner = np.array(system.model.output_owner)
    walk = rounded(system.model, path.step if weighted else path.step / 2, substeps_along(system, path))
    if weighted:
        x, held = path.x[:-1], held_along(system, path)
        counts = sampled(system, path.steps, path.step)[:, owner].astype(float)
        firsts = [*range(0, len(x), _PIECE), len(x)]
    else:
        x, held = _half_steps(system, path)
        counts = np.tile(np.sqrt(_simpson(path))[:, None], len(owner))
        firsts = [*range(0, len(x) - 1, _PIECE), len(x) - 1]
    outputs = np.isin(owner, kept)
    carry, rows, errors = walk.first(typed_sizes(system.model, path.x[0])), [], []
    for first, last in pairwise(firsts):
        carry, *found = _piece(walk, carry, (x[first:last], held[first:last], counts[first:last]), outputs, weighted)
        rows.append(found[0])
        errors.append(found[1])
    if not weighted:  # the node at the end of the last step
        _, *found = _piece(walk, carry, (x[-1:], held[-1:], counts[-1:]), outputs, weighted)
        rows.append(found[0])
        errors.append(found[1])
    return Stretch(np.concatenate(rows), np.concatenate(errors), *_end(walk, carry[0], path.x.shape[1]))


def _half_steps(system: AbstractSystem, path: Trajectory) -> tuple[np.ndarray, np.ndarray]:
    """Return states (2 N + 1, n) and (u, w) at the nodes and in the middle of each step, for Simpson's rule."""
    held, m = held_along(system, path), len(system.model.inputs)
    substeps = substeps_along(system, path)
    middle = states_from(system, path.x[:-1], held[:, None, :m], path.step / 2, held[:, None, m:], substeps=substeps)[:, 1]
    fine = np.empty((2 * path.steps + 1, path.x.shape[1]))
    fine[::2], fine[1::2] = path.x, middle
    return fine, np.vstack([np.repeat(held, 2, axis=0), held[-1:]])


def _simpson(path: Trajectory) -> np.ndarray:
    weight = np.where(np.arange(2 * path.steps + 1) % 2, 4.0, 2.0)
    weight[[0, -1]] = 1.0
    return weight * path.step / 6


def _piece(
    walk: Rounded, carry: np.ndarray, along: tuple[np.ndarray, np.ndarray, np.ndarray], outputs: np.ndarray, weighted: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the next carry, rows (N, q, n) and the triangular factor of their errors; along: states, (u, w), counts (N, all q)."""
    x, held, counts = along
    run = walk.scan.run(carry, [x, held], len(x), carries=False)
    seen, errors, weight = (values[0] for values in run.results)
    size = (np.where(counts > 0, counts * weight, 0.0) if weighted else counts)[:, outputs, None]
    n, q = x.shape[1], len(outputs)
    seen = seen.reshape(len(x), n, q).swapaxes(1, 2)[:, outputs]
    errors = errors.reshape(len(x), DRAWS, n, q).transpose(1, 0, 3, 2)[:, :, outputs]
    # what has no sample may have no derivative; where there is no second one the row is taken for exact
    rows = np.where(size > 0, seen, 0.0) * size
    errors = np.where(np.isfinite(errors), errors * _UNIT, 0.0) * size
    return run.carry, rows, triangular(errors.reshape(-1, n))


def _end(walk: Rounded, carry: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    free = len(walk.shape.index)
    values, errors = carry[n * DRAWS : n * DRAWS + free], carry[n * DRAWS + free :].reshape(DRAWS, free) * _UNIT
    matrices = np.zeros((DRAWS, n * n))
    matrices[:, walk.shape.index] = np.where(np.isfinite(errors), errors, 0.0)
    return walk.shape.full(values), matrices.reshape(DRAWS, n, n)
