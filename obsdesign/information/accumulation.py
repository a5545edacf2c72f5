"""Information summed while walking: memory does not grow with the number of steps."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from obsdesign.arguments import validate_arguments
from obsdesign.checks import require_divisor
from obsdesign.dynamics.inner_loop import InnerLoop
from obsdesign.dynamics.model import AbstractSystem, Model
from obsdesign.dynamics.per_step import system_along
from obsdesign.dynamics.scan import Scan
from obsdesign.dynamics.simulation import all_inputs_along, substeps_along
from obsdesign.dynamics.step import CACHE_SIZE, looped_step, step_of, steps_per_sample
from obsdesign.information.additive_amounts import additive_factors
from obsdesign.information.correlated_noise import Colour, colour_of
from obsdesign.information.gramian import require_fit, variational_gramian
from obsdesign.information.sample_graph import instant_of
from obsdesign.information.sample_information import sampling_mask
from obsdesign.packing import Packing, packing_of
from obsdesign.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class Accumulator:
    """(x, Phi, errors, W) -> one step later, W the packed sums over the samples of each sensor; rows u, w and those of `taken`.

    start: of Phi and of what is remembered of errors that are not independent, at the beginning of a path; see `InformationStep`.
    """

    scan: Scan
    start: np.ndarray
    packing: Packing
    is_masked: bool
    colour: Colour | None

    def initial_carry(self, x: np.ndarray) -> np.ndarray:
        """Return the carry (M, c) at starts x (M, n)."""
        n, moving = x.shape[1], x.shape[1] + len(self.start)
        carry = np.zeros((len(x), moving + len(self.packing.rows)))
        carry[:, :n], carry[:, n:moving] = x, self.start
        return carry

    def sampling_rows(self, system: AbstractSystem, steps: int, step: float, weights: np.ndarray | None = None) -> list[np.ndarray]:
        """Return the rows that say which samples there are: none where every sensor has one at every step.

        weights (N, S): which of them count, where errors are not independent; None = all.
        """
        if not self.is_masked:
            return []
        sampling = sampling_mask(system, steps, step).astype(float)
        if self.colour is None:
            return [sampling]
        return [sampling, np.ones_like(sampling) if weights is None else weights]

    def sums(self, carry: np.ndarray) -> np.ndarray:
        """Return W (M, S, n, n) of carries (M, c)."""
        return self.packing.full(carry[:, carry.shape[1] - len(self.packing.rows) :])


@dataclass(frozen=True, eq=False)
class InformationStep:
    """One step as SX: state x, carry (Phi's free entries, and what is remembered of errors that are not independent), inputs u, w and
    both, `sampling` = who samples, and the blocks that are sampled, as `Instant` has them; start: of the carry.
    """

    x: ca.SX
    carry: ca.SX
    u: ca.SX
    w: ca.SX
    all_inputs: ca.SX
    sampling: list[ca.SX]
    x_next: ca.SX
    carry_next: ca.SX
    blocks: list[ca.SX]
    start: np.ndarray
    loop: InnerLoop | None


@lru_cache(CACHE_SIZE)
def information_step(
    model: Model, step: float, substeps: int = 1, is_additive: bool = False, has_derivatives: bool = False
) -> InformationStep:
    """Return one step with its samples: the blocks of independent errors, or what each sensor adds to the samples before and beside.

    is_additive: amounts from below instead of the latter, of each sensor alone; has_derivatives: sub-steps as one graph, not as a loop.
    """
    step_graph = (step_of if has_derivatives else looped_step)(model, step, substeps)
    sensitivity = step_graph.sensitivity
    instant = instant_of(model, sensitivity.Phi, any(period > 1 for period in steps_per_sample(model, step)), is_additive)
    carry, carry_next = ca.vertcat(sensitivity.free, instant.carry), ca.vertcat(sensitivity.free_next, instant.carry_next)
    start = np.concatenate([sensitivity.start, instant.start])
    return InformationStep(
        step_graph.x,
        carry,
        step_graph.u,
        step_graph.w,
        step_graph.all_inputs,
        instant.sampling,
        step_graph.x_next,
        carry_next,
        instant.blocks,
        start,
        step_graph.loop,
    )


@lru_cache(CACHE_SIZE)
def simulating_accumulator(model: Model, step: float, substeps: int = 1) -> Accumulator:
    """Return the walk that simulates as it sums."""
    step_graph = information_step(model, step, substeps)
    packing, sums, sums_next = _running_sums(step_graph)
    scan = Scan(
        ca.vertcat(step_graph.x, step_graph.carry, sums),
        [step_graph.u, step_graph.w, *step_graph.sampling],
        ca.vertcat(step_graph.x_next, step_graph.carry_next, sums_next),
        loop=step_graph.loop,
    )
    return Accumulator(scan, step_graph.start, packing, bool(step_graph.sampling), colour_of(model))


@lru_cache(CACHE_SIZE)
def accumulator_along(model: Model, step: float, substeps: int = 1, is_additive: bool = False) -> Accumulator:
    """The same along given states: (Phi, errors, W), rows x, (u, w) and who samples."""
    step_graph = information_step(model, step, substeps, is_additive)
    packing, sums, sums_next = _running_sums(step_graph)
    scan = Scan(
        ca.vertcat(step_graph.carry, sums),
        [step_graph.x, step_graph.all_inputs, *step_graph.sampling],
        ca.vertcat(step_graph.carry_next, sums_next),
        loop=step_graph.loop,
    )
    return Accumulator(scan, step_graph.start, packing, bool(step_graph.sampling), colour_of(model))


def _running_sums(step_graph: InformationStep) -> tuple[Packing, ca.SX, ca.SX]:
    packing = packing_of(step_graph.blocks)
    sums = ca.SX.sym("W", len(packing.rows))
    return packing, sums, sums + packing.column(step_graph.blocks)


@validate_arguments
def segment_information(system: AbstractSystem, path: Trajectory, segments: int) -> np.ndarray:
    """Return (K, S, n, n), the information of each segment and sensor, in memory that does not grow with the steps.

    It is `variational_gramian(system, path).by_segment(K)`: block [k, s] is the information about x(t_0) of the samples of sensor s in
    the k-th of K equal groups of steps; of sensors whose errors are not independent an amount from below for every schedule,
    `path_information` the exact value.

    Arguments:
        system: vehicle and sensors.
        path: the path along which samples are taken.
        segments: number K of segments, which divides the number of steps.
    Raises InputError as variational_gramian, and unless K divides the number of steps.
    """
    require_fit(system, path)
    system = system_along(system, path)
    require_divisor("segments", segments, "steps", path.steps)
    accumulator = accumulator_along(system.model, path.pace, substeps_along(system, path), is_additive=colour_of(system.model) is not None)
    length = path.steps // segments
    rows = [path.x[:-1], all_inputs_along(system, path), *accumulator.sampling_rows(system, path.steps, path.pace)]
    if accumulator.colour is not None:
        firsts = np.arange(0, path.steps, length)
        rows += additive_factors(accumulator.colour, rows[2][:, accumulator.colour.sensor_of_output] > 0, firsts).rows(firsts)
    return accumulator.packing.full(np.array(_sums_by_stretch(accumulator, system, path, rows, length)))


def path_information(system: AbstractSystem, path: Trajectory, weights: np.ndarray | None = None) -> np.ndarray:
    """Return W (n, n), what all samples along a path say about x(t_0), in memory that does not grow with the steps.

    weights (K, S): how much the samples of each sensor count in each of K equal groups of steps, None = all of them, once; where
    errors are not independent the share of them that arrives, 0 to 1.
    Raises InputError as variational_gramian.
    """
    if colour_of(system.model) is None:
        if weights is None:
            return segment_information(system, path, 1)[0].sum(axis=0)
        return np.einsum("ks,ksij->ij", weights, segment_information(system, path, len(weights)))
    require_fit(system, path)
    system = system_along(system, path)
    accumulator = accumulator_along(system.model, path.pace, substeps_along(system, path))
    share = None if weights is None else np.repeat(weights, path.steps // len(weights), axis=0)
    rows = [path.x[:-1], all_inputs_along(system, path), *accumulator.sampling_rows(system, path.steps, path.pace, share)]
    return accumulator.packing.full(np.array(_sums_by_stretch(accumulator, system, path, rows, path.steps)))[0].sum(axis=0)


def _sums_by_stretch(
    accumulator: Accumulator, system: AbstractSystem, path: Trajectory, rows: list[np.ndarray], length: int
) -> list[np.ndarray]:
    """Return the packed sums of each stretch of so many steps."""
    carried, sums = accumulator.start, []
    for first in range(0, path.steps, length):
        rows_of_stretch = [values[first : first + length] for values in rows]
        carry = accumulator.scan.last(np.concatenate([carried, np.zeros(len(accumulator.packing.rows))]), *rows_of_stretch)
        if not np.isfinite(carry).all():
            variational_gramian(system, path.part(0, first + length))
        sums.append(carry[len(carried) :])
        carried = carry[: len(carried)]
    return sums
