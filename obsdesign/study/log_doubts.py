"""Numbers of a calibration that are far from what was stated: rather a wrong place or a wrong unit than noise."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from obsdesign.calibration.calibration_record import Calibration
from obsdesign.display import number
from obsdesign.dynamics.model import AbstractSystem
from obsdesign.dynamics.simulation import readings
from obsdesign.prior import Prior

_FAR = 10.0  # how many times as large as was stated
_WORDS = ("bias", "sigma")


def calibration_doubts(system: AbstractSystem, prior: Prior, calibration: Calibration) -> Iterator[str]:
    """Yield a sentence for each bias and standard deviation that is ten times the standard deviation which the system states, or more."""
    model = system.model
    spread = readings(system, prior.mean[None, None], np.zeros((1, len(model.inputs)))).spread[0, 0]
    stated = {signal.name: spread[i] for i, signal in enumerate(model.outputs)}
    stated |= {name: spread[places[0]] for name, places in model.outputs_of.items()}
    for entry in calibration.numbers:
        what, _, names = entry.name.partition(" of ")
        first = names.partition(", ")[0]
        if entry.is_told and what in _WORDS and abs(entry.value) > _FAR * stated.get(first, np.inf):
            yield (
                f"{entry.name} comes to {number(entry.value, entry.unit)}, where a standard deviation of"
                f" {number(stated[first], entry.unit)} was stated: is it in that unit, and does its landmark stand there?"
            )
