"""Errors of samples that are not white: what they are made of."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from obsdesign.dynamics.model import Model
from obsdesign.dynamics.step import CACHE_SIZE


@dataclass(frozen=True)
class Colour:
    """The outputs (q,) whose errors are not white, sensor by sensor; all in units of their standard deviation.

    sensors: names; owner (q,): to which of them each output belongs; sensor_indices: where those sensors stand among all of a model;
    correlation, bias (q,): of the first-order part, and standard deviation of the constant in the output's own unit;
    groups: outputs that are correlated at one instant, with their correlation matrix.
    """

    sensors: tuple[str, ...]
    sensor_indices: tuple[int, ...]
    owner: tuple[int, ...]
    correlation: tuple[float, ...]
    bias: tuple[float, ...]
    groups: tuple[tuple[tuple[int, ...], tuple[tuple[float, ...], ...]], ...] = ()

    @property
    def q(self) -> int:
        """Number of outputs."""
        return len(self.owner)

    @cached_property
    def sensor_of_output(self) -> list[int]:
        """For each output where its sensor stands among all of a model."""
        return [self.sensor_indices[s] for s in self.owner]

    @cached_property
    def error_groups(self) -> tuple[tuple[int, ...], ...]:
        """Outputs whose errors belong together: the groups, then every other output alone."""
        grouped = {j for members, _ in self.groups for j in members}
        return (*(members for members, _ in self.groups), *((j,) for j in range(self.q) if j not in grouped))

    def outputs_of(self, sensor: int) -> tuple[int, ...]:
        """Outputs of one of the sensors."""
        return tuple(j for j, owner in enumerate(self.owner) if owner == sensor)

    def only(self, indices: tuple[int, ...], sensor_indices: tuple[int, ...]) -> Colour:
        """Return the colour of some of the sensors, given as indices, alone, with their new places; of groups what is theirs."""
        outputs = [j for s in indices for j in self.outputs_of(s)]
        groups: list[tuple[tuple[int, ...], tuple[tuple[float, ...], ...]]] = []
        for group_outputs, correlation in self.groups:
            retained = [i for i, j in enumerate(group_outputs) if j in outputs]
            if retained:
                rows = tuple(tuple(correlation[a][b] for b in retained) for a in retained)
                groups.append((tuple(outputs.index(group_outputs[i]) for i in retained), rows))
        return Colour(
            tuple(self.sensors[s] for s in indices),
            sensor_indices,
            tuple(indices.index(self.owner[j]) for j in outputs),
            tuple(self.correlation[j] for j in outputs),
            tuple(self.bias[j] for j in outputs),
            tuple(groups),
        )

    @cached_property
    def without_cross_correlation(self) -> Colour:
        """The same without what sensors have in common with other sensors."""
        groups = []
        for members, correlation in self.groups:
            for s in dict.fromkeys(self.owner[j] for j in members):
                member_indices = [i for i, j in enumerate(members) if self.owner[j] == s]
                groups.append(
                    (
                        tuple(members[i] for i in member_indices),
                        tuple(tuple(correlation[a][b] for b in member_indices) for a in member_indices),
                    )
                )
        return Colour(self.sensors, self.sensor_indices, self.owner, self.correlation, self.bias, tuple(groups))


@lru_cache(CACHE_SIZE)
def colour_of(model: Model) -> Colour | None:
    """Return what is not white in a model's noise, None where all is."""
    joint = {name for group in model.joint for name in group.sensors}
    sensor_indices = tuple(s for s, channel in enumerate(model.channels) if channel.name in joint or not channel.noise.is_white)
    if not sensor_indices:
        return None
    channels = [model.channels[s] for s in sensor_indices]
    names = tuple(channel.name for channel in channels)
    owner = tuple(i for i, channel in enumerate(channels) for _ in channel.outputs)
    groups = []
    for group in model.joint:
        members = tuple(j for name in group.sensors for j, i in enumerate(owner) if names[i] == name)
        R = np.array(group.covariance)
        groups.append((members, tuple(map(tuple, (R / np.sqrt(np.outer(np.diag(R), np.diag(R)))).tolist()))))
    noises = [channels[i].noise for i in owner]
    bias = tuple(bias for channel in channels for bias in channel.noise.biases(len(channel.outputs)))
    return Colour(names, sensor_indices, owner, tuple(noise.correlation for noise in noises), bias, tuple(groups))


def require_coloured(model: Model) -> Colour:
    """Return what is not white in a model of which that is known; raise ValueError where all is white."""
    colour = colour_of(model)
    if colour is None:
        raise ValueError("the noise of every sensor is white")
    return colour
