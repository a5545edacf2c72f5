"""What the samples of one instant say about the start of a path, as graphs, whatever their errors are."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from obsdesign.dynamics.model import Model
from obsdesign.dynamics.step import blocks_of
from obsdesign.information.correlated_noise import colour_of
from obsdesign.information.whitening import Taken, seen_of, whitened


@dataclass(frozen=True, eq=False)
class Instant:
    """Blocks (n, n) of each sensor, the rows `taken` that say who samples, and what is remembered of errors that are not independent.

    taken: nothing; or due (S,); or due and share (S,) where errors are not independent, and where amounts are counted besides
    fresh (1,), factor and spread (q,): see `whitening.Taken`. carry -> carry_next, `start` before the first instant.
    """

    taken: list[ca.SX]
    blocks: list[ca.SX]
    carry: ca.SX
    carry_next: ca.SX
    start: np.ndarray


def instant_of(model: Model, Phi: ca.SX, masked: bool, counted: bool = False) -> Instant:
    """Return what the samples at x say, Phi = dx/dx(t_0): blocks of independent errors, or what sensors add to samples before and beside.

    masked: whether some sensors have no sample at some instants; counted: amounts from below, of each sensor alone.
    """
    blocks, colour, taken = blocks_of(model, Phi), colour_of(model), []
    if colour is not None or masked:
        taken = [ca.SX.sym("due", len(blocks))]
        # not a product: where a sensor has no derivative and no sample, nothing is lost
        blocks = [ca.if_else(taken[0][s], block, ca.SX(*block.shape)) for s, block in enumerate(blocks)]
    if colour is None:
        return Instant(taken, blocks, ca.SX(0, 1), ca.SX(0, 1), np.zeros(0))
    taken += [ca.SX.sym("share", len(blocks))]
    taken += [ca.SX.sym(name, count) for name, count in (("fresh", 1), ("factor", colour.q), ("spread", colour.q)) if counted]
    # by hand: a column of one entry, indexed by a list, would become a row
    due, share = (ca.vertcat(*[each[s] for s in colour.sensor_of]) for each in taken[:2])
    samples = Taken(due, ca.SX.ones(colour.q) if counted else share, *taken[2:])
    found = whitened(colour.apart if counted else colour, seen_of(model, colour, Phi), samples)
    for s, place in enumerate(colour.places):
        block = sum((found.information[j] for j in colour.outputs_of(s)), ca.SX(*blocks[place].shape))
        blocks[place] = taken[1][place] * block if counted else block
    for place in set(range(len(blocks))) - set(colour.places):
        blocks[place] = taken[1][place] * blocks[place]
    return Instant(taken, blocks, found.carry, found.carry_next, found.start)
