"""Which samples a filter takes in, and how it notices that it is itself what is wrong."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from obsdesign.arguments import validate_arguments
from obsdesign.checks import require_count
from obsdesign.dynamics.model import Model
from obsdesign.errors import InputError
from obsdesign.estimation._samples import SampleInnovations

_SMALLEST = 1e-300  # a variance below which no factor makes anything of it


@validate_arguments
@dataclass(frozen=True)
class Gate:
    """Takes in a sensor's sample only where e' S^-1 e is below a chi-square quantile, e its residual and S what is expected of e e'.

    A filter that is wrong and sure of it would take in nothing any more: the gate has locked it out. So rejected samples of a sensor count
    1 each, and samples taken in -1, down to 0; once `alarm` is reached, P is multiplied by the smallest factor for which the residual of
    each output is what is expected of it, the sample is taken in, and the count starts anew. A sensor that is wrong itself would call
    the alarm again and again: each alarm doubles the count that the next takes, and each sample taken in lowers it by 1, down to `alarm`.
    Raises InputError for values outside the ranges below.
    """

    probability: float = 0.999
    """Share of the samples of a filter and sensors that are right which are taken in, in (0, 1)."""
    alarm: int = 10
    """How many more samples of a sensor have to be rejected than taken in for the filter to be what is wrong; >= 1."""

    def __post_init__(self) -> None:
        require_count("gate: alarm", self.alarm)
        if not 0 < self.probability < 1:
            raise InputError(f"gate: probability is {self.probability!r}: must be above 0 and below 1")

    def thresholds(self, outputs: int) -> tuple[float, ...]:
        """Return the quantiles for 1, 2, ... outputs."""
        from scipy.special import gammaincinv

        return tuple(2 * float(gammaincinv(count / 2, self.probability)) for count in range(1, outputs + 1))


@dataclass(frozen=True, eq=False)
class Gating:
    """What a gate makes of the samples of an instant, as a graph, S sensors and q outputs.

    is_taken (q, 1): which outputs are taken in; factor: on P, before that; is_alarm (S, 1); counters_next (2 S, 1).
    """

    is_taken: ca.SX
    factor: ca.SX
    is_alarm: ca.SX
    counters_next: ca.SX


def counter_values(gate: Gate | None, sensors: int) -> np.ndarray:
    """Return the counters (2 S,) before the first sample: rejected samples, and how many call an alarm; (0,) without a gate."""
    return np.zeros(0) if gate is None else np.concatenate([np.zeros(sensors), np.full(sensors, float(gate.alarm))])


def apply_gate(gate: Gate, model: Model, innovations: SampleInnovations, counters: ca.SX) -> Gating:
    """Return what the gate makes of the innovations of usable outputs."""
    count, patience = ca.vertsplit(counters, len(model.channels)) if model.channels else (counters, counters)
    is_taken, factor, alarms, counts, patiences = ca.SX.zeros(len(model.outputs)), ca.SX(1), [], [], []
    for s, outputs in enumerate(model.outputs_of.values()):
        is_there, is_within = innovations.is_there(outputs), _is_within(gate, innovations, outputs)
        change = ca.if_else(is_there, ca.if_else(is_within, -1, 1), 0)
        total = ca.fmax(count[s] + change, 0)
        is_alarm = ca.logic_and(is_there, ca.logic_and(ca.logic_not(is_within), total >= patience[s]))
        relaxed = ca.fmax(patience[s] - ca.if_else(change < 0, 1, 0), gate.alarm)
        alarms.append(is_alarm)
        counts.append(ca.if_else(is_alarm, 0, total))
        patiences.append(ca.if_else(is_alarm, 2 * patience[s], relaxed))
        for i in outputs:
            is_taken[i] = ca.logic_and(innovations.is_usable[i], ca.logic_or(is_within, is_alarm))
            factor = ca.fmax(factor, ca.if_else(is_alarm, innovations.sufficient_factor(i, _SMALLEST), 1))
    return Gating(is_taken, factor, ca.vertcat(*alarms), ca.vertcat(*counts, *patiences))


def _is_within(gate: Gate, innovations: SampleInnovations, outputs: tuple[int, ...]) -> ca.SX:
    """Whether a sensor's sample is below the quantile for as many outputs as it has."""
    thresholds, usable = gate.thresholds(len(outputs)), sum((innovations.is_usable[i] for i in outputs), ca.SX(0))
    threshold = ca.SX(thresholds[-1])
    for count, value in enumerate(thresholds[:-1], 1):
        threshold = ca.if_else(usable == count, value, threshold)
    return innovations.normalised_square(outputs) <= threshold
