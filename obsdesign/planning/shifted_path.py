"""A constraint and a family of paths some time later: what is left of them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any, Literal

import casadi as ca
import numpy as np

from obsdesign.constraints.abstract import AbstractConstraint, Coordinate, Span
from obsdesign.moment import Moment
from obsdesign.paths.abstract import AbstractPath, Grid

Horizon = Literal["receding", "shrinking"]


@dataclass(frozen=True)
class ShiftedConstraint(AbstractConstraint):
    """A constraint with another span; equal to others of the same constraint, as the functions of its margins are the same."""

    constraint: AbstractConstraint
    shifted_span: Span = field(compare=False)

    def __str__(self) -> str:
        return str(self.constraint)

    @property
    def span(self) -> Span:
        """What is left of its span."""
        return self.shifted_span

    @property
    def states(self) -> tuple[str, ...]:
        """Those of the constraint."""
        return self.constraint.states

    @property
    def size(self) -> tuple[float, str]:
        """That of the constraint."""
        return self.constraint.size

    @property
    def breach(self) -> str:
        """What a path does that breaks it."""
        return self.constraint.breach

    def margins(self, moment: Moment) -> list[Coordinate]:
        """Return those of the constraint."""
        return self.constraint.margins(moment)


def shift_constraint(constraint: AbstractConstraint, elapsed: float) -> ShiftedConstraint | None:
    """Return a constraint as of `elapsed` [s] later, None where its time is over."""
    span = constraint.span
    first, last = (None if time is None else max(0.0, time - elapsed) for time in (span.first, span.last))
    is_over = span.last is not None and span.last < elapsed - 1e-9
    return None if is_over else ShiftedConstraint(constraint, Span(first, last, span.anywhere))


@dataclass(frozen=True)
class ShiftedPath(AbstractPath):
    """The inputs of a family on a grid of `family_steps` steps from its step `shift` on, the last ones held for as long as they have to be.

    So a path that has been flown in part stays in its family, wherever in a piece the vehicle is. Parameters that only what has
    been flown depended on are constants: `fixed_parameters`, in the order of their indices.
    """

    family: AbstractPath
    family_steps: int
    shift: int
    fixed_parameters: tuple[float, ...] = ()

    def box(self, grid: Grid) -> tuple[np.ndarray, np.ndarray]:
        """Return lower and upper bounds (q,) of the parameters that are free."""
        is_free = self.free_mask(grid)
        lower, upper = self.family.box(self._family_grid(grid))
        return lower[is_free], upper[is_free]

    def inputs(self, p: ca.SX, grid: Grid) -> ca.SX:
        """Return the inputs (N, m) from step `shift` of the family on."""
        family_inputs = self.family.inputs(self.all_parameters(p, grid), self._family_grid(grid))
        return family_inputs[remaining_indices(self.family_steps, self.shift, grid.steps).tolist(), :]

    def fit(self, u: np.ndarray, grid: Grid) -> np.ndarray:
        """Return the free parameters (q,) of inputs u (N, m), the first of which are taken for those flown before."""
        extended = np.vstack([np.repeat(u[:1], self.shift, axis=0), u])[: self.family_steps]
        return self.family.fit(extended, self._family_grid(grid))[self.free_mask(grid)]

    def coarser(self) -> AbstractPath | None:
        """Return None: what has been flown is of this family."""
        return None

    def rates(self, p: ca.SX, grid: Grid) -> ca.SX:
        """Return the rates of change of the whole family."""
        return self.family.rates(self.all_parameters(p, grid), self._family_grid(grid))

    def free_mask(self, grid: Grid) -> np.ndarray:
        """Return which of the family's parameters (q,) what is left of the path depends on."""
        return _free_mask(self.family, self._family_grid(grid), self.shift)

    def all_parameters(self, p: Any, grid: Grid) -> Any:  # noqa: ANN401  # symbolic or numerical
        """Return the family's parameters (q,)."""
        if not self.fixed_parameters:
            return p
        is_free, free, fixed = self.free_mask(grid), iter(p if isinstance(p, np.ndarray) else ca.vertsplit(p)), iter(self.fixed_parameters)
        all_values = [next(free) if is_parameter_free else next(fixed) for is_parameter_free in is_free]
        return np.array(all_values) if isinstance(p, np.ndarray) else ca.vertcat(*all_values)

    def _family_grid(self, grid: Grid) -> Grid:
        return replace(grid, steps=self.family_steps)


@lru_cache(256)
def _free_mask(family: AbstractPath, grid: Grid, shift: int) -> np.ndarray:
    p = ca.SX.sym("p", len(family.box(grid)[0]))
    remaining = ca.vec(ca.SX(family.inputs(p, grid))[shift:, :])
    return np.array(ca.which_depends(remaining, p, 1, False), dtype=bool)


def remaining_indices(count: int, shift: int, steps: int) -> np.ndarray:
    """Return indices (steps,) of what comes from `shift` on, the last of `count` again and again at the end."""
    return np.minimum(np.arange(shift, shift + steps), count - 1)
