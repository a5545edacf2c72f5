"""The information blocks that design, selection and validation share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.checks import require_divisor
from obsdesign.errors import InputError
from obsdesign.round_off import standard_deviations


@dataclass(frozen=True, eq=False)
class Information:
    """blocks (N, S, n, n): block [k, s] is what sensor s, sampled at t_k, says about x(t_0); names: the S sensors.

    Weighted blocks are Fisher information, in 1/(unit_i unit_j). Information adds up over steps and sensors.
    transition (n, n): Phi = dx(t_N)/dx(t_0), which carries information to the end of the path; None = not known.
    """

    blocks: np.ndarray
    names: tuple[str, ...]
    transition: np.ndarray | None = None

    def __post_init__(self) -> None:
        blocks = np.asarray(self.blocks, dtype=float)
        if blocks.ndim != 4 or blocks.shape[1] != len(self.names) or blocks.shape[2] != blocks.shape[3]:
            raise InputError(f"information: blocks {blocks.shape} do not fit (N, {len(self.names)}, n, n)")
        if blocks.flags.writeable:  # someone else may still write to it
            blocks = blocks.copy()
            blocks.setflags(write=False)
        object.__setattr__(self, "blocks", blocks)

    @property
    def total(self) -> np.ndarray:
        """W (n, n) = sum of all blocks."""
        n = self.blocks.shape[2]
        return self.blocks.reshape(-1, n * n).sum(axis=0).reshape(n, n)

    @property
    def std(self) -> np.ndarray:
        """Cramer-Rao bound (n,) of each component of x(t_0) in its unit: sqrt(diag(W^-1)); inf for what stays hidden."""
        return standard_deviations(self.total)

    @property
    def final(self) -> np.ndarray:
        """Phi^-T W Phi^-1 (n, n), what all samples say about x(t_N); raises InputError where Phi is not known or is singular."""
        try:
            inverse = np.linalg.inv(self._carried())
        except np.linalg.LinAlgError:
            raise InputError("information: the transition dx(t_N)/dx(t_0) is singular: the path forgets its start") from None
        return inverse.T @ self.total @ inverse

    def then(self, later: Information) -> Information:
        """Return the information of this path followed by another, about the start of this one: blocks Phi' W_k Phi.

        Raises InputError unless both are about the same sensors and states and this one's transition is known.
        """
        Phi = self._carried()
        if later.names != self.names or later.blocks.shape[2] != len(Phi):
            raise InputError(f"information of {', '.join(later.names)} does not follow that of {', '.join(self.names)}: another system")
        blocks = np.concatenate([self.blocks, Phi.T @ later.blocks @ Phi])
        return Information(blocks, self.names, None if later.transition is None else later.transition @ Phi)

    def by_segment(self, segments: int) -> np.ndarray:
        """Return (K, S, n, n): the blocks of K equal groups of steps, summed. K must divide N."""
        steps = len(self.blocks)
        require_divisor("segments", segments, "steps", steps)
        shape = (segments, steps // segments, *self.blocks.shape[1:])
        return self.blocks.reshape(shape).sum(axis=1)

    def _carried(self) -> np.ndarray:
        if self.transition is None:
            raise InputError("information: the transition dx(t_N)/dx(t_0) is not known, so nothing can be said about the end of the path")
        return self.transition

    def only(self, *sensors: str) -> Information:
        """Return the information of the named sensors alone."""
        unknown = [name for name in sensors if name not in self.names]
        if unknown:
            raise InputError(f"no sensor {unknown[0]!r} (there are {', '.join(self.names)})")
        return Information(self.blocks[:, [self.names.index(name) for name in sensors]], sensors, self.transition)
