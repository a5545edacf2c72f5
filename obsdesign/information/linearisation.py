"""A system linearised along a path: what a step does to a small error, and what samples say of it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from obsdesign.dynamics.driven_step import driven_step
from obsdesign.dynamics.model import AbstractSystem, Model
from obsdesign.dynamics.nuisance_states import nuisance_of
from obsdesign.dynamics.process_noise import ProcessNoise
from obsdesign.dynamics.scan import Scan
from obsdesign.dynamics.simulation import all_inputs_along, substeps_along
from obsdesign.dynamics.step import CACHE_SIZE
from obsdesign.information.nuisance_information import output_spread, sample_row
from obsdesign.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class PathLinearisation:
    """x_k+1 = F_k x_k + B_k w_k; a sample over its spread is state_rows x + bias_loads b + z + e, var(e) = missing.

    F (N, n, n), B (N, n, p) of all unknown inputs, state_rows (N, q, n), bias_loads (N, q, c), missing (N, q), inf behind a closed gate;
    spreads (N, q), in the units of the outputs; noise (N, n, r), columns of noise, N(0, 1) each. Rows of sensors that are off are 0.
    """

    F: np.ndarray
    B: np.ndarray
    state_rows: np.ndarray
    bias_loads: np.ndarray
    missing: np.ndarray
    spreads: np.ndarray
    noise: np.ndarray


def linearise(system: AbstractSystem, path: Trajectory, weights: np.ndarray, noise: ProcessNoise) -> PathLinearisation:
    """Return the system linearised along a path; weights (N, S), not 0 where a sensor is on and has a sample."""
    model, N, n = system.model, path.steps, path.x.shape[1]
    scan = _linearisation_scan(model, path.pace, substeps_along(system, path), noise)
    arrays = scan.along(np.empty(0), path.x[:-1], all_inputs_along(system, path), weights)[1:]
    q, c = len(model.output_owner), len(nuisance_of(model, path.pace).constant)
    widths = ((n, n), (len(model.unknown_inputs), n), (n, q), (c, q))  # column by column
    F, B, state_rows, bias_loads = (values.reshape(N, *shape).swapaxes(1, 2) for values, shape in zip(arrays[:4], widths, strict=True))
    return PathLinearisation(F, B, state_rows, bias_loads, arrays[4], arrays[5], arrays[6].reshape(N, -1, n).swapaxes(1, 2))


@lru_cache(CACHE_SIZE)
def _linearisation_scan(model: Model, step: float, substeps: int, noise: ProcessNoise) -> Scan:
    """Rows x_k, (u, w)_k, active (S,) -> F, B_w, dy / dx and dy / db over spreads, what gates add to variances, spreads, noise."""
    driven, nuisance, weights = (
        driven_step(model, step, substeps, noise),
        nuisance_of(model, step),
        ca.SX.sym("active", len(model.channels)),
    )
    graph, c, rows, missing, spreads = driven.step, len(nuisance.constant), [], [], []
    for i, sensor in enumerate(model.output_owner):
        row, bias_ratio, gate = sample_row(model, nuisance, i)
        spreads.append(output_spread(model, i))
        # not a product: where a sensor that is off has no derivative, nothing is lost
        rows.append(ca.if_else(weights[sensor], row, ca.SX(*row.shape)))
        missing.append(ca.if_else(gate > 0, bias_ratio * (1 - gate) / ca.if_else(gate > 0, gate, 1), np.inf))
    stacked = ca.vertcat(*rows)
    results = [graph.F, graph.B_w, stacked[:, c:], stacked[:, :c], ca.vertcat(*missing), ca.vertcat(*spreads), driven.noise]
    columns = [ca.vec(ca.densify(result)) for result in results]
    return Scan(ca.SX(0, 1), [graph.x, graph.all_inputs, weights], ca.SX(0, 1), columns, loop=graph.loop)
