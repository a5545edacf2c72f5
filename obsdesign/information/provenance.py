"""Where information comes from: system and path, whose rows tell what is round-off. Found out when somebody asks."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from obsdesign.dynamics.model import AbstractSystem
from obsdesign.information.sensitivity_rows import Stretch, stretch_of
from obsdesign.round_off import Sight, sight_of_rows
from obsdesign.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class Origin:
    """A system's sensors `kept` (indices) along a path; weighted by their noise, or integrated over time.

    differences: whether the information is made of differences of outputs, with errors of their own, and not of the rows; before:
    the origin of the path that leads to the start of this one, where information is about the start of that.
    """

    system: AbstractSystem
    path: Trajectory
    kept: tuple[int, ...]
    weighted: bool = True
    differences: bool = False
    before: Origin | None = None

    def only(self, indices: list[int]) -> Origin:
        """Return the origin of what some of the kept sensors say."""
        before = None if self.before is None else self.before.only(indices)
        return replace(self, kept=tuple(self.kept[i] for i in indices), before=before)

    def after(self, earlier: Origin) -> Origin:
        """Return the origin of information about the start of an earlier path that leads to this one."""
        return replace(self, before=earlier if self.before is None else self.before.after(earlier))

    @property
    def sight(self) -> Sight:
        """What the rows see of the state at the start, and what of it is round-off."""
        return self._found[0]

    def along(self, v: np.ndarray) -> np.ndarray:
        """Return (N, S) >= 0, the squares of the rows along v (n,) of each sample of each kept sensor; nothing cancels."""
        _, rows = self._found
        squares = np.concatenate([(each @ v) ** 2 for each in rows])
        owner = [s for s in self.system.model.output_owner if s in self.kept]
        return np.stack([squares[:, [j for j, s in enumerate(owner) if s == kept]].sum(axis=1) for kept in self.kept], axis=1)

    def rows_of(self, sensors: list[int]) -> np.ndarray:
        """Return the rows (m, n) of all samples of some of the kept sensors, by their places among those."""
        wanted = [self.kept[s] for s in sensors]
        owner = [s for s in self.system.model.output_owner if s in self.kept]
        columns = [j for j, s in enumerate(owner) if s in wanted]
        return np.concatenate([each[:, columns].reshape(-1, each.shape[2]) for each in self._found[1]])

    @property
    def is_of_samples(self) -> bool:
        """Whether each row is of one sample, and information the sum of their squares where errors are independent."""
        return self.weighted and not self.differences and (self.before is None or self.before.is_of_samples)

    @cached_property
    def _found(self) -> tuple[Sight, list[np.ndarray]]:
        """What the rows see, and those of each stretch (N, q, n)."""
        stretches = self._stretches
        R = np.concatenate([each.rows.reshape(-1, self.path.x.shape[1]) for each in stretches])
        return sight_of_rows(R, np.concatenate([each.errors for each in stretches])), [each.rows for each in stretches]

    @property
    def _stretches(self) -> list[Stretch]:
        """From the first to the last, all about the start of the first."""
        own = stretch_of(self.system, self.path, self.kept, self.weighted)
        if self.before is None:
            return [own]
        earlier = self.before._stretches
        return [*earlier, own.following(earlier[-1])]

    def __reduce__(self) -> tuple[object, ...]:
        # without what was found out
        return Origin, (self.system, self.path, self.kept, self.weighted, self.differences, self.before)


def origin_of(system: AbstractSystem, path: Trajectory, weighted: bool = True, differences: bool = False) -> Origin:
    """Return the origin of what all sensors say along a path."""
    return Origin(system, path, tuple(range(len(system.model.channels))), weighted, differences)
