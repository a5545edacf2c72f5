"""The rows C Phi of the samples along a path about its start, and what rounding does to them."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from obsdesign.dynamics.model import AbstractSystem
from obsdesign.dynamics.simulation import all_inputs_along, states_from, substeps_along
from obsdesign.information.row_rounding import DRAWS, RoundingScan, decimal_sizes, rounding_scan
from obsdesign.information.sample_information import sampling_mask
from obsdesign.round_off import EPS, triangular
from obsdesign.trajectory import Trajectory

_CHUNK = 4096  # instants that are taken at a time: their errors take several times the memory of the rows
_UNIT = EPS / np.sqrt(DRAWS)


@dataclass(frozen=True, eq=False)
class SensitivityRows:
    """rows (N, q, n), weighted; errors (k, n), what rounding does to them; Phi (n, n) at its end, with DRAWS errors (d, n, n)."""

    rows: np.ndarray
    errors: np.ndarray
    Phi: np.ndarray
    Phi_errors: np.ndarray

    def from_start_of(self, earlier: SensitivityRows) -> SensitivityRows:
        """Return this about the start of another that leads to its own; to first order in the errors."""
        n = len(self.Phi)
        transported_errors = (triangular(self.rows.reshape(-1, n)) @ earlier.Phi_errors).reshape(-1, n)
        errors = np.concatenate([self.errors @ earlier.Phi, transported_errors])
        Phi_errors = self.Phi_errors @ earlier.Phi + self.Phi @ earlier.Phi_errors
        return SensitivityRows(self.rows @ earlier.Phi, errors, self.Phi @ earlier.Phi, Phi_errors)


def sensitivity_rows_of(system: AbstractSystem, path: Trajectory, sensor_indices: tuple[int, ...], weighted: bool) -> SensitivityRows:
    """Return the rows of the sensors `sensor_indices` (indices): a sample's by its noise, 0 where there is none, or of an integral over
    time.

    The integral is by Simpson's rule, its nodes at the start, in the middle and at the end of each step: what it does not see is hidden.
    """
    owner = np.array(system.model.output_owner)
    rounding = rounding_scan(system.model, path.pace if weighted else path.pace / 2, substeps_along(system, path))
    if weighted:
        x, all_inputs = path.x[:-1], all_inputs_along(system, path)
        counts = sampling_mask(system, path.steps, path.pace)[:, owner].astype(float)
        firsts = [*range(0, len(x), _CHUNK), len(x)]
    else:
        x, all_inputs = _half_steps(system, path)
        counts = np.tile(np.sqrt(_simpson(path))[:, None], len(owner))
        firsts = [*range(0, len(x) - 1, _CHUNK), len(x) - 1]
    outputs = np.isin(owner, sensor_indices)
    carry, rows, errors = rounding.initial_carry(decimal_sizes(system.model, path.x[0])), [], []
    for first, last in pairwise(firsts):
        carry, *chunk = _rows_of_chunk(rounding, carry, (x[first:last], all_inputs[first:last], counts[first:last]), outputs, weighted)
        rows.append(chunk[0])
        errors.append(chunk[1])
    if not weighted:  # the node at the end of the last step
        _, *chunk = _rows_of_chunk(rounding, carry, (x[-1:], all_inputs[-1:], counts[-1:]), outputs, weighted)
        rows.append(chunk[0])
        errors.append(chunk[1])
    return SensitivityRows(np.concatenate(rows), np.concatenate(errors), *_final_sensitivity(rounding, carry[0], path.x.shape[1]))


def _half_steps(system: AbstractSystem, path: Trajectory) -> tuple[np.ndarray, np.ndarray]:
    """Return states (2 N + 1, n) and (u, w) at the nodes and in the middle of each step, for Simpson's rule."""
    all_inputs, m = all_inputs_along(system, path), len(system.model.inputs)
    substeps = substeps_along(system, path)
    middle = states_from(system, path.x[:-1], all_inputs[:, None, :m], path.pace / 2, all_inputs[:, None, m:], substeps=substeps)[:, 1]
    states = np.empty((2 * path.steps + 1, path.x.shape[1]))
    states[::2], states[1::2] = path.x, middle
    return states, np.vstack([np.repeat(all_inputs, 2, axis=0), all_inputs[-1:]])


def _simpson(path: Trajectory) -> np.ndarray:
    weight, sixth = np.zeros(2 * path.steps + 1), path.lengths / 6
    weight[1::2] = 4 * sixth
    weight[:-2:2] += sixth
    weight[2::2] += sixth
    return weight


def _rows_of_chunk(
    rounding: RoundingScan, carry: np.ndarray, rows_along: tuple[np.ndarray, np.ndarray, np.ndarray], outputs: np.ndarray, weighted: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the next carry, rows (N, q, n) and the triangular factor of their errors; rows_along: states, (u, w), counts (N, all q)."""
    x, all_inputs, counts = rows_along
    run = rounding.scan.run(carry, [x, all_inputs], len(x), carries=False)
    output_rows, errors, weight = (values[0] for values in run.results)
    size = (np.where(counts > 0, counts * weight, 0.0) if weighted else counts)[:, outputs, None]
    n, q = x.shape[1], len(outputs)
    output_rows = output_rows.reshape(len(x), n, q).swapaxes(1, 2)[:, outputs]
    errors = errors.reshape(len(x), DRAWS, n, q).transpose(1, 0, 3, 2)[:, :, outputs]
    # what has no sample may have no derivative; where there is no second one the row is taken for exact
    rows = np.where(size > 0, output_rows, 0.0) * size
    errors = np.where(np.isfinite(errors), errors * _UNIT, 0.0) * size
    return run.carry, rows, triangular(errors.reshape(-1, n))


def _final_sensitivity(rounding: RoundingScan, carry: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    free = len(rounding.sensitivity.index)
    values, errors = carry[n * DRAWS : n * DRAWS + free], carry[n * DRAWS + free :].reshape(DRAWS, free) * _UNIT
    matrices = np.zeros((DRAWS, n * n))
    matrices[:, rounding.sensitivity.index] = np.where(np.isfinite(errors), errors, 0.0)
    return rounding.sensitivity.full(values), matrices.reshape(DRAWS, n, n)
