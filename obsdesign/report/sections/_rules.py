"""Rules in words."""

from __future__ import annotations

from obsdesign.report.number_format import NARROW, join, plain
from obsdesign.rules.abstract import AbstractRule
from obsdesign.rules.energy_budget import EnergyBudget
from obsdesign.rules.exclusive import Exclusive
from obsdesign.rules.max_uses import MaxUses
from obsdesign.rules.minimum_dwell import MinimumDwell
from obsdesign.rules.requires import Requires
from obsdesign.rules.switching_cost import SwitchingCost
from obsdesign.rules.unavailable import Unavailable
from obsdesign.rules.unavailable_between import UnavailableBetween
from obsdesign.rules.unavailable_outside import UnavailableOutside


def rule_in_words(rule: AbstractRule) -> str:  # noqa: PLR0911  # one for each kind
    """Return what a rule says."""
    match rule:
        case EnergyBudget(limit=limit, cost=cost, start=start):
            switching_clause = f", and each switching-on {_amounts(start)}" if _has_cost(start) else ""
            return f"at most {plain(limit)} is spent, where a segment costs {_amounts(cost)}{switching_clause}"
        case MaxUses(sensor=sensor, most=most):
            return f"{sensor} is on in at most {plain(most)} segments"
        case SwitchingCost(cost=cost):
            return f"each switching-on takes {_amounts(cost)} off the value"
        case MinimumDwell(least=least, sensors=sensors):
            who = "every sensor" if sensors is None else join([str(name) for name in sensors])
            stays = "stays" if sensors is None or len(sensors) == 1 else "stay"
            return f"{who} {stays} on for at least {plain(least)} segments"
        case Exclusive(sensors=sensors):
            return f"of {join([str(name) for name in sensors])} at most one is on at a time"
        case Requires(sensor=sensor, other=other):
            return f"{sensor} is on only where {other} is"
        case Unavailable(sensor=sensor, segments=segments):
            return f"{sensor} is off in segments {join([plain(segment) for segment in segments])}, counted from 0"
        case UnavailableBetween(sensor=sensor, first=first, last=last):
            return f"{sensor} is off from {plain(first)} to {plain(last)}{NARROW}s"
        case UnavailableOutside(sensor=sensor, centre=(x, y), radius=radius):
            return f"{sensor} is off farther than {plain(radius)}{NARROW}m from ({plain(x)}, {plain(y)})"
        case _:
            return str(rule)


def _has_cost(amounts: float | dict[str | int, float]) -> bool:
    return any(amounts.values()) if isinstance(amounts, dict) else amounts > 0


def _amounts(amounts: float | dict[str | int, float]) -> str:
    if isinstance(amounts, dict):
        return join([f"{plain(number)} ({name})" for name, number in amounts.items()])
    return plain(amounts)
