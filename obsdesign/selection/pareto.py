"""Information against energy: how much more is known for how much more is spent."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from logging import getLogger
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.arguments import validate_arguments
from obsdesign.checks import require_count, require_within
from obsdesign.criteria.abstract import AbstractCriterion
from obsdesign.criteria.min_eigenvalue import MinEigenvalue
from obsdesign.display import AbstractDisplay, Summary, data_frame, number
from obsdesign.errors import InputError
from obsdesign.progress import Progress, StageReport
from obsdesign.rules.abstract import AbstractRule, Segments
from obsdesign.rules.energy_budget import EnergyBudget
from obsdesign.selection.build import build_problem
from obsdesign.selection.dual import Dual
from obsdesign.selection.integer.search import SelectionOptions
from obsdesign.selection.problem import SelectionProblem
from obsdesign.selection.relaxation.column_generation import dual_bound
from obsdesign.selection.schedule import Schedule, require_blocks
from obsdesign.selection.solver import solve_selection

if TYPE_CHECKING:
    from pandas import DataFrame

_LOGGER = getLogger(__name__)
_MAX_BATCHES = 60  # of the branch and bound for each limit: a second or so
_NO_LIMIT = 1e30  # a budget that nothing exceeds


@dataclass(frozen=True, eq=False)
class Pareto(AbstractDisplay):
    """The front of information against what a budget counts, at P limits.

    Schedules that spend at most E are worth at most min over q of levels_q + slopes_q E.
    """

    limits: np.ndarray
    """The limits (P,) on what may be spent, in the budget's unit."""
    spent: np.ndarray
    """What the best schedule found for each limit spends (P,)."""
    values: np.ndarray
    """What it is worth (P,)."""
    bounds: np.ndarray
    """What no schedule within the limit is above (P,)."""
    schedules: tuple[Schedule, ...]
    """These P schedules."""
    slopes: np.ndarray
    """Slopes (Q,) of the straight lines that no schedule is above, value per unit of the budget."""
    levels: np.ndarray
    """Their values (Q,) where nothing is spent."""

    def to_dataframe(self) -> DataFrame:
        """Return a row for each limit: what the best schedule found spends and is worth, and what none is above.

        Raises MissingPackageError where pandas is not installed.
        """
        return data_frame({"spent": self.spent, "value": self.values, "bound": self.bounds}, {"limit": self.limits})

    def _summary(self) -> Summary:
        rows = [
            (f"at most {number(limit)}", f"value {number(value)}, none above {number(bound)}, spends {number(spent)}")
            for limit, value, bound, spent in zip(self.limits, self.values, self.bounds, self.spent, strict=True)
        ]
        return Summary(f"information against energy, {len(rows)} limits", tuple(rows))

    def above(self, limit: float) -> float:
        """What no schedule that spends at most `limit` is above: concave in the limit, of every dual met on the way."""
        return float(np.min(self.levels + self.slopes * limit))


@validate_arguments
def pareto(
    blocks: ArrayLike,
    budget: EnergyBudget,
    per_segment: int = 1,
    *,
    points: int = 12,
    rules: Sequence[AbstractRule] = (),
    criterion: AbstractCriterion | None = None,
    segments: Segments | None = None,
    known: ArrayLike | None = None,
    about: Sequence[int] | None = None,
    gap: float = 1e-4,
    seed: int = 0,
    progress: Progress | None = None,
) -> Pareto:
    """Return the certified front of information against what a budget counts, from little to all that is of use.

    The limits go from the least with which a schedule sees the whole state to what the best schedule without a limit spends. Each
    begins with the duals of the one before. The other arguments are those of select_sensors.

    Arguments:
        blocks (K, S, n, n): information of each segment and sensor, scaled.
        budget: its costs count; its limit is replaced by those of the front.
        per_segment: how many sensors may be on at a time.
        points: number P of limits.
        rules: what schedules have to keep.
        criterion: what is asked of the sum; None = MinEigenvalue().
        segments: the names, times and places that rules speak of.
        known (n, n): information that is there without a sensor, scaled; None = none.
        about: indices of the states that are judged; None = all.
        gap: how near to the best each schedule is to be proven.
        seed: seed of the search.
        progress: is called with what is being done, as it begins; None = nobody is told.
    Raises InputError for the same reasons as select_sensors.
    """
    array = require_blocks(np.asarray(blocks), per_segment)
    require_count("points", points, minimum=2)
    require_within("gap", gap)
    options = SelectionOptions("auto", gap, None, seed, _MAX_BATCHES)

    def with_limit(limit: float) -> SelectionProblem:
        """Return the problem with another limit."""
        all_rules = (replace(budget, limit=limit), *rules)
        return build_problem(array, per_segment, all_rules, criterion or MinEigenvalue(), 0, segments, known_information=known, about=about)

    report = StageReport(_LOGGER, progress)
    report("the best schedule without a limit")
    unlimited = with_limit(_NO_LIMIT)
    largest_spending = float(unlimited.usage(solve_selection(unlimited, tuple(rules), options, throw=True).chosen)[0])
    front_points: list[_FrontPoint] = []
    for limit in largest_spending * np.arange(points, 0, -1) / points:
        report(f"{len(front_points)} of {points} limits done, the next {limit:.6g}")
        point = _solve_at_limit(with_limit, float(limit), options, front_points)
        if point is None:
            break  # and less is too little, too
        front_points.append(point)
    if not front_points:
        raise InputError(f"gap is {gap:g}: within it no schedule needs a sensor; give a smaller one")
    return _build_front(front_points[::-1])


@dataclass(frozen=True, eq=False)
class _FrontPoint:
    """A limit, the schedule for it, its dual, and its bound less what the limit is worth."""

    limit: float
    spent: float
    schedule: Schedule
    dual: Dual
    level: float


def _solve_at_limit(
    with_limit: Callable[[float], SelectionProblem], limit: float, options: SelectionOptions, previous: list[_FrontPoint]
) -> _FrontPoint | None:
    try:
        instance = with_limit(limit)
        schedule = solve_selection(instance, (), options, throw=False, initial_duals=tuple(point.dual for point in previous[-1:]))
    except InputError:  # too small for anything
        return None
    if not (schedule.status.has_answer and schedule.chosen.any()):
        return None
    dual = Dual(instance.from_user_units(schedule.dual[None]), schedule.prices, schedule.offset)
    spent = float(instance.usage(schedule.chosen)[0])
    return _FrontPoint(limit, spent, schedule, dual, dual_bound(instance, dual)[0] - float(dual.mu[0]) * limit)


def _build_front(points: list[_FrontPoint]) -> Pareto:
    """The best schedule within each limit, be it made for a smaller one; every dual bounds every limit."""
    slopes, levels = np.array([point.dual.mu[0] for point in points]), np.array([point.level for point in points])
    limits = np.array([point.limit for point in points])
    values = np.array([point.schedule.value for point in points])
    best = [int(values[: i + 1].argmax()) for i in range(len(points))]
    dual_bounds = np.min(levels + slopes * limits[:, None], axis=1)
    bounds = np.minimum(dual_bounds, [point.schedule.bound for point in points])
    return Pareto(
        limits,
        np.array([points[i].spent for i in best]),
        values[best],
        np.maximum(np.minimum.accumulate(bounds[::-1])[::-1], values[best]),
        tuple(points[i].schedule for i in best),
        slopes,
        levels,
    )
