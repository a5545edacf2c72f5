"""The truth as samples of sensors that read states, some time apart: what inputs and noise do between them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from obsdesign.dynamics.channel import Channel, Noise
from obsdesign.dynamics.model import AbstractSystem, Model
from obsdesign.logs.log import Log
from obsdesign.logs.samples import LogSamples
from obsdesign.signals import Signal


@dataclass(frozen=True)
class TruthSensors(AbstractSystem):
    """A system with sensors that read some of its states, and no others: truth of x, ..."""

    system: AbstractSystem
    """The system."""
    states: tuple[str, ...]
    """What is read."""
    sigmas: tuple[float, ...]
    """How well it is known, in the states' units."""

    def _build(self) -> Model:
        import casadi as ca

        model = self.system.model
        channels = []
        for name, sigma in zip(self.states, self.sigmas, strict=True):
            i = model.state_names.index(name)
            signal = Signal(f"truth of {name}", model.states[i].unit, model.states[i].is_angle)
            channels.append(Channel(signal.name, (signal,), model.x[i], Noise(ca.SX(sigma), ca.SX(1))))
        return replace(model, channels=tuple(channels), joint=())


def log_of_truth(model: Model, log: Log, spacing: float) -> Log | None:
    """Return a log whose samples are true states, as far apart in time as that [s], or None where there are fewer than three."""
    truth = log.truth
    if truth is None:
        return None
    names = tuple(name for name in truth.names if name in model.state_names)
    first, last = max(truth.t[0], log.span[0]), min(truth.t[-1], log.span[1])
    # at times of the truth itself: nothing between them is known
    wanted = np.arange(first, last + 1e-9, spacing)
    places = np.unique(np.clip(np.searchsorted(truth.t, wanted - 1e-9), 0, len(truth.t) - 1))
    rows = truth.x[places][:, [truth.names.index(name) for name in names]]
    k, column = np.nonzero(np.isfinite(rows))
    if len(np.unique(k)) < 3:
        return None
    samples = LogSamples(tuple(f"truth of {name}" for name in names), truth.t[places][k], column, rows[k, column])
    return Log(log.inputs, samples)
