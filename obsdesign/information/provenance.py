"""Where information comes from: system and path, whose rows tell what is round-off. Found out when somebody asks."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from obsdesign.dynamics.model import AbstractSystem
from obsdesign.information.sensitivity_rows import SensitivityRows, sensitivity_rows_of
from obsdesign.round_off import Visibility, visibility_of_rows
from obsdesign.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class Origin:
    """A system's sensors `sensor_indices` (indices) along a path; weighted by their noise, or integrated over time.

    by_differences: whether the information is made of differences of outputs, with errors of their own, and not of the rows; previous:
    the origin of the path that leads to the start of this one, where information is about the start of that.
    """

    system: AbstractSystem
    path: Trajectory
    sensor_indices: tuple[int, ...]
    weighted: bool = True
    by_differences: bool = False
    previous: Origin | None = None

    def only(self, indices: list[int]) -> Origin:
        """Return the origin of what some of the kept sensors say."""
        previous = None if self.previous is None else self.previous.only(indices)
        return replace(self, sensor_indices=tuple(self.sensor_indices[i] for i in indices), previous=previous)

    def after(self, earlier: Origin) -> Origin:
        """Return the origin of information about the start of an earlier path that leads to this one."""
        return replace(self, previous=earlier if self.previous is None else self.previous.after(earlier))

    @property
    def visibility(self) -> Visibility:
        """What the rows see of the state at the start, and what of it is round-off."""
        return self._visibility_and_rows[0]

    def along(self, v: np.ndarray) -> np.ndarray:
        """Return (N, S) >= 0, the squares of the rows along v (n,) of each sample of each kept sensor; nothing cancels."""
        _, rows = self._visibility_and_rows
        squares = np.concatenate([(rows_of_stretch @ v) ** 2 for rows_of_stretch in rows])
        owner = [s for s in self.system.model.output_owner if s in self.sensor_indices]
        return np.stack([squares[:, [j for j, s in enumerate(owner) if s == sensor]].sum(axis=1) for sensor in self.sensor_indices], axis=1)

    def rows_of(self, sensors: list[int]) -> np.ndarray:
        """Return the rows (m, n) of all samples of some of the kept sensors, by their places among those."""
        selected = [self.sensor_indices[s] for s in sensors]
        owner = [s for s in self.system.model.output_owner if s in self.sensor_indices]
        columns = [j for j, s in enumerate(owner) if s in selected]
        return np.concatenate(
            [rows_of_stretch[:, columns].reshape(-1, rows_of_stretch.shape[2]) for rows_of_stretch in self._visibility_and_rows[1]]
        )

    @property
    def is_of_samples(self) -> bool:
        """Whether each row is of one sample, and information the sum of their squares where errors are independent."""
        return self.weighted and not self.by_differences and (self.previous is None or self.previous.is_of_samples)

    @cached_property
    def _visibility_and_rows(self) -> tuple[Visibility, list[np.ndarray]]:
        """What the rows see, and those of each stretch (N, q, n)."""
        stretches = self._stretches
        R = np.concatenate([stretch.rows.reshape(-1, self.path.x.shape[1]) for stretch in stretches])
        return visibility_of_rows(R, np.concatenate([stretch.errors for stretch in stretches])), [stretch.rows for stretch in stretches]

    @property
    def _stretches(self) -> list[SensitivityRows]:
        """From the first to the last, all about the start of the first."""
        stretch = sensitivity_rows_of(self.system, self.path, self.sensor_indices, self.weighted)
        if self.previous is None:
            return [stretch]
        earlier = self.previous._stretches
        return [*earlier, stretch.from_start_of(earlier[-1])]

    def __reduce__(self) -> tuple[object, ...]:
        # without what was found out
        return Origin, (self.system, self.path, self.sensor_indices, self.weighted, self.by_differences, self.previous)


def origin_of(system: AbstractSystem, path: Trajectory, weighted: bool = True, by_differences: bool = False) -> Origin:
    """Return the origin of what all sensors say along a path."""
    return Origin(system, path, tuple(range(len(system.model.channels))), weighted, by_differences)
