"""What it costs to lose a sensor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.arguments import validate_arguments
from obsdesign.criteria.abstract import AbstractCriterion
from obsdesign.criteria.min_eigenvalue import MinEigenvalue
from obsdesign.rules.abstract import AbstractRule, Segments
from obsdesign.selection.build import build_problem
from obsdesign.selection.integer.search import SelectionOptions
from obsdesign.selection.schedule import Schedule, require_blocks
from obsdesign.selection.solver import solve_selection, without_sensors

_MAX_BATCHES = 60  # of the branch and bound for each sensor: a second or so


@dataclass(frozen=True)
class Loss:
    """What losing one sensor costs a schedule: kept <= rechosen <= bound, but for rounding and rules that the lost sensor was part of.

    All in the criterion's unit, less what switching costs; -inf where the rest sees too little for the criterion.
    """

    sensor: int
    """Index of the lost sensor."""
    kept: float
    """What the schedule is worth without it."""
    rechosen: float
    """What a schedule chosen anew from the others is worth."""
    bound: float
    """What no schedule of the others is above, in the criterion's unit."""


@validate_arguments
def sensor_losses(
    blocks: ArrayLike,
    schedule: Schedule,
    per_segment: int = 1,
    *,
    rules: Sequence[AbstractRule] = (),
    criterion: AbstractCriterion | None = None,
    segments: Segments | None = None,
    known: ArrayLike | None = None,
    about: Sequence[int] | None = None,
    gap: float = 1e-4,
) -> tuple[Loss, ...]:
    """Return for each sensor what losing it costs the schedule, and what is left when the others are chosen anew.

    kept <= rechosen <= bound, but for rounding and rules that the lost sensor was part of. The arguments are those of select_sensors.

    Arguments:
        blocks (K, S, n, n): information of each segment and sensor, scaled.
        schedule: the schedule that loses its sensors.
        per_segment: how many sensors may be on at a time.
        rules: what schedules have to keep.
        criterion: what is asked of the sum; None = MinEigenvalue().
        segments: the names, times and places that rules speak of.
        known (n, n): information that is there without a sensor, scaled; None = none.
        about: indices of the states that are judged; None = all.
        gap: how near to the best each new schedule is to be proven.
    Raises InputError for the same reasons as select_sensors.
    """
    array = require_blocks(np.asarray(blocks), per_segment)
    instance = build_problem(
        array, per_segment, tuple(rules), criterion or MinEigenvalue(), 0, segments, known_information=known, about=about
    )
    losses = []
    for sensor in range(array.shape[1]):
        without_sensor = without_sensors(instance, (sensor,))
        remaining = schedule.chosen.copy()
        remaining[:, sensor] = False
        reselected = solve_selection(without_sensor, tuple(rules), SelectionOptions("auto", gap, None, 0, _MAX_BATCHES), throw=False)
        kept_value = without_sensor.value(remaining)
        rechosen, bound = (reselected.value, reselected.bound) if reselected.status.has_answer else (-np.inf, -np.inf)
        losses.append(Loss(sensor, kept_value, max(rechosen, kept_value), max(bound, kept_value)))
    return tuple(losses)
