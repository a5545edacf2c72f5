"""A system whose sensors answer only now and then."""

from __future__ import annotations

from dataclasses import dataclass, replace

from obsdesign.dynamics.model import AbstractSystem, Model


@dataclass(frozen=True)
class AnsweringSystem(AbstractSystem):
    """A system of which each sensor answers only a share of the times that it is asked.

    The share multiplies the sensor's gate, what part of its samples arrives where the vehicle is: information counts with it.
    """

    system: AbstractSystem
    """The system with sensors that always answer where their gates are open."""
    shares: tuple[float, ...]
    """How often each of the S sensors answers, from 0 to 1."""

    def _build(self) -> Model:
        model = self.system.model
        channels = tuple(
            replace(channel, noise=replace(channel.noise, gate=share * channel.noise.gate))
            for channel, share in zip(model.channels, self.shares, strict=True)
        )
        return replace(model, channels=channels)
