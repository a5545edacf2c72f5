"""What the samples of one instant say about the start of a path, as graphs, whatever their errors are."""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from obsdesign.dynamics.model import Model
from obsdesign.dynamics.step import blocks_of
from obsdesign.information.correlated_noise import colour_of
from obsdesign.information.whitening import SampleSelection, decay_between, outputs_with_colour, whiten


@dataclass(frozen=True, eq=False)
class Instant:
    """Blocks (n, n) of each sensor, the rows `sampling` that say who samples, and what is remembered of errors that are not independent.

    sampling: nothing; or due (S,); or due and share (S,) where errors are not independent, and where amounts are counted besides
    fresh (1,), factor and spread (q,): see `whitening.SampleSelection`. carry -> carry_next, `start` before the first instant.
    """

    sampling: list[ca.SX]
    blocks: list[ca.SX]
    carry: ca.SX
    carry_next: ca.SX
    start: np.ndarray


def instant_of(model: Model, Phi: ca.SX, is_masked: bool, is_additive: bool = False) -> Instant:
    """Return what the samples at x say, Phi = dx/dx(t_0): blocks of independent errors, or what sensors add to samples before and beside.

    is_masked: whether some sensors have no sample at some instants; is_additive: amounts from below, of each sensor alone.
    """
    blocks, colour, sampling = blocks_of(model, Phi), colour_of(model), []
    if colour is not None or is_masked:
        sampling = [ca.SX.sym("due", len(blocks))]
        # not a product: where a sensor has no derivative and no sample, nothing is lost
        blocks = [ca.if_else(sampling[0][s], block, ca.SX(*block.shape)) for s, block in enumerate(blocks)]
    if colour is None:
        return Instant(sampling, blocks, ca.SX(0, 1), ca.SX(0, 1), np.zeros(0))
    sampling += [ca.SX.sym("share", len(blocks))]
    sampling += [ca.SX.sym(name, count) for name, count in (("fresh", 1), ("factor", colour.q), ("spread", colour.q)) if is_additive]
    # by hand: a column of one entry, indexed by a list, would become a row
    due, share = (ca.vertcat(*[column[s] for s in colour.sensor_of_output]) for column in sampling[:2])
    decay = decay_between(model, colour) if model.is_per_step else None
    samples = replace(SampleSelection(due, ca.SX.ones(colour.q) if is_additive else share, *sampling[2:]), decay=decay)
    innovations = whiten(colour.without_cross_correlation if is_additive else colour, outputs_with_colour(model, colour, Phi), samples)
    for s, sensor in enumerate(colour.sensor_indices):
        block = sum((innovations.information[j] for j in colour.outputs_of(s)), ca.SX(*blocks[sensor].shape))
        blocks[sensor] = sampling[1][sensor] * block if is_additive else block
    for sensor in set(range(len(blocks))) - set(colour.sensor_indices):
        blocks[sensor] = sampling[1][sensor] * blocks[sensor]
    return Instant(sampling, blocks, innovations.carry, innovations.carry_next, innovations.start)
