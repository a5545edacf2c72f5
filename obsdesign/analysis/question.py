"""What is asked of a model, to be asked again of others: with more sensors, with inputs that are no longer held, or are known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from numpy.typing import ArrayLike

from obsdesign.analysis.query import Disturbance, KnownInputs, observability_of
from obsdesign.analysis.verdict import Verdict
from obsdesign.dynamics.model import Model


@dataclass(frozen=True, eq=False)
class Question:
    """The arguments of `observability` but for the system."""

    at: ArrayLike | None
    held: Mapping[str, float]
    disturbance: Disturbance
    known_inputs: KnownInputs
    seed: int

    def verdict(self, model: Model, released: Sequence[str] = ()) -> Verdict:
        """Return the verdict about a model, with some inputs no longer held."""
        held = {name: value for name, value in self.held.items() if name not in released}
        return observability_of(model, self.at, held, self.disturbance, self.known_inputs, self.seed)
