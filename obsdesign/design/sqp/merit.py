"""What a point of a program is worth to a climb: aim, price and penalised shortfall in one number."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from obsdesign.design.nlp.abstract import AbstractProgram
from obsdesign.design.nlp.evaluation import Slopes, Values
from obsdesign.design.sqp.matrix_objective import AbstractAim, value_of


@dataclass(frozen=True, eq=False)
class Terms:
    """What merits are counted in: the unit of the aim, and what a shortfall of 1 costs in it."""

    unit: float
    penalty: float


@dataclass(frozen=True, eq=False)
class Place:
    """A point with what it is worth: merit = (price - aim) / unit + penalty * violation, less is better."""

    values: Values
    floors: np.ndarray
    violation: float
    aim: float
    merit: float


@dataclass(frozen=True, eq=False)
class Scene:
    """A program and what is wanted of it; least: lambda_min of every judged matrix must be at or above this, 0 = no such limit."""

    program: AbstractProgram
    aim: AbstractAim
    least: float = 0.0

    @property
    def width(self) -> np.ndarray:
        """Widths (q,) of the box."""
        return self.program.upper - self.program.lower

    def at(self, p: np.ndarray, terms: Terms) -> Place:
        """Return the place of parameters p (q,), moved into their box."""
        return self.place(self.program.at(np.clip(p, self.program.lower, self.program.upper)), terms)

    def place(self, values: Values, terms: Terms) -> Place:
        """Return what values are worth."""
        floors = self.floors(values)
        return self.counted(Place(values, floors, shortfall(values.rows, floors), value_of(self.aim, values.matrices), np.inf), terms)

    def counted(self, place: Place, terms: Terms) -> Place:
        """Return a place counted in other terms."""
        merit = (place.values.price - place.aim) / terms.unit + terms.penalty * place.violation
        return replace(place, merit=float(merit) if np.isfinite(merit) else np.inf)

    def floors(self, values: Values) -> np.ndarray:
        """Matrices (f, n, n) that must be >= I."""
        return self._joined(values.floors, values.matrices)

    def floor_slopes(self, slopes: Slopes) -> np.ndarray:
        """Their derivatives (f, q, n, n)."""
        return self._joined(slopes.floors, slopes.matrices)

    def _joined(self, floors: np.ndarray, matrices: np.ndarray) -> np.ndarray:
        floor = self.program.problem.floor
        scaled = floors if floor is None else floors / floor.value
        return np.concatenate([scaled, matrices / self.least]) if self.least else scaled


def shortfall(rows: np.ndarray, floors: np.ndarray) -> float:
    """Return by how much the worst of the rows (r,) falls short of 0, and of the floors (f, n, n) of 1."""
    lowest = 1 - float(np.linalg.eigvalsh(floors)[:, 0].min()) if len(floors) else 0.0
    return max(0.0, -float(rows.min(initial=0.0)), lowest)
