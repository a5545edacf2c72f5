"""Schedules as the columns of a restricted master, and the mixture of them that solves it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from obsdesign.selection.dual import Dual
from obsdesign.selection.problem import SelectionProblem


@dataclass(frozen=True, eq=False)
class Column:
    """A schedule as a mixture sees it: W (R, n, n), usage (resources,), what switching takes off.

    chosen (K, S), or the steps of a walk through what is undecided.
    """

    chosen: np.ndarray
    W: np.ndarray
    usage: np.ndarray
    penalty: float


@dataclass(frozen=True, eq=False)
class Mixture:
    """Shares (J,) of the columns, the value of the mixture, and the dual it leads to."""

    shares: np.ndarray
    value: float
    dual: Dual
    multipliers: np.ndarray = field(repr=False)


def column_of(instance: SelectionProblem, chosen: np.ndarray) -> Column:
    """Return a schedule as a column."""
    return Column(chosen, instance.information(chosen), instance.usage(chosen), instance.penalty(chosen))
