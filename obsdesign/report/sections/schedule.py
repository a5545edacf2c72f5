"""The schedule in sentences and tables: when each sensor is on and where, how good that is, what rules and losses cost."""

from __future__ import annotations

import math

import numpy as np

from obsdesign.report import derived_quantities as facts
from obsdesign.report.figures.rivals import rival_values
from obsdesign.report.names import gap_in_words, has_relative_gap, path_in_words, schedule_criterion
from obsdesign.report.number_format import NARROW, join, numeral, percent, plain, typeset
from obsdesign.report.sections.whereabouts import segment_traits, usage_in_words
from obsdesign.report.tables import DASH, Cell, Table
from obsdesign.report.wording import schedule_in_words
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
from obsdesign.status import Status
from obsdesign.study.record import RivalSchedule, Study

_SUPERSCRIPT = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")


def schedule_answer(study: Study) -> str:
    """Answer "Which?": when and where each sensor is on, how far that is from the best, what the others reach."""
    schedule, name = study.selection.schedule, schedule_criterion(study)
    others = join(
        [
            f"{rival.name} reaches {numeral(facts.zero_round_off(study, rival.value))}{_violation_clause(study, rival)}"
            for rival in study.selection.rivals
        ]
    )
    words = schedule_in_words(study)
    return f"{words[:1].upper()}{words[1:]}: {usage_in_words(study)}. {name} is {numeral(schedule.value)}, {certificate(study)}; {others}."


def certificate(study: Study) -> str:
    """Say how near to the best the schedule is: certified within 0.02 % of the best of 4^24 schedules."""
    schedule, is_difference = study.selection.schedule, not has_relative_gap(study)
    if schedule.status is Status.OPTIMAL:
        return f"proven to be the best of {_schedule_count(study)} but for a gap of {gap_in_words(study)}"
    return f"certified within {gap_in_words(study)} {'below' if is_difference else 'of'} the best of {_schedule_count(study)}"


def dependent_sensors(study: Study) -> list[str]:
    """Names of the sensors whose errors are not independent from sample to sample, or from each other."""
    samples = study.main.information.samples
    return [] if samples is None else [study.main.information.names[place] for place in samples.colour.sensor_indices]


def _schedule_count(study: Study) -> str:
    settings, sensors, segments = study.scenario.selection, len(study.scenario.sensors), len(study.selection.schedule.chosen)
    if settings.rules:
        return "all schedules that keep the rules"
    return f"{plain(math.comb(sensors, settings.per_segment))}{str(segments).translate(_SUPERSCRIPT)} schedules"


def _violation_clause(study: Study, rival: RivalSchedule) -> str:
    total = len(study.scenario.selection.rules)
    count = "the rule" if total == 1 else f"{plain(len(rival.breaks))} of the {plain(total)} rules"
    return f" but breaks {count}" if rival.breaks else ""


def method_notes(study: Study) -> tuple[str, ...]:
    """Say how the schedule was found, within which rules, and what went otherwise than planned."""
    schedule, settings = study.selection.schedule, study.scenario.selection
    undecided, segments = schedule.fractional, len(schedule.chosen)
    left = f"leaves {undecided} of {segments} segments undecided; these are rounded" if undecided else "decides every segment"
    looked = f" Branch and bound then looked at {plain(schedule.nodes)} partial schedules." if schedule.nodes else ""
    parts = [
        "What is maximised is information about the state at the start, from the samples alone: without process noise and without "
        "the prior. A filter lives on what is known now; where either matters, look at what the filter makes of the schedule.",
        f"The schedule comes from a convex relaxation that {left}; exchanges of single sensors then improve it where they can.{looked} "
        "The bound follows from the relaxation's dual alone, so it holds whatever the solver did.",
    ]
    if study.selection.exact is not None:
        lasting = join(dependent_sensors(study))
        parts.append(
            f"The errors of {lasting} last or belong together, so that no amounts for single segments add up to what samples say together: "
            f"the schedule is chosen, and the bound proven, for amounts from below, which no schedule falls short of. All samples of the "
            f"chosen schedule together have a {schedule_criterion(study)} of {numeral(facts.zero_round_off(study, study.selection.exact))}."
        )
    if settings.rules:
        parts.append(f"Rules: {'; '.join(rule_in_words(rule) for rule in settings.rules)}.")
    if settings.robust_to:
        lost = "any one sensor" if settings.robust_to == 1 else f"any {plain(settings.robust_to)} sensors"
        parts.append(f"The schedule is chosen for the worst loss of {lost}: its value is what is then left.")
    parts += [
        f"{typeset(note[:1].upper() + note[1:])}." for note in (note_text.rstrip(".") for note_text in (*schedule.notes, *study.notes))
    ]
    return tuple(parts)


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


def usage_table(study: Study) -> Table:
    """When and where each sensor is on."""
    traits, times = segment_traits(study), facts.segment_nodes(study)
    everything, on = np.ones(len(traits.seconds), dtype=bool), study.selection.schedule.chosen
    turns, beacons = ("in turns [%]",) * traits.is_mixed, ("near its beacon [%]",) * any(traits.has_beacon)

    def row(name: str, active: np.ndarray, near: np.ndarray | None) -> tuple[Cell, ...]:
        total = float(traits.seconds @ active)
        return (
            Cell(name),
            Cell(plain(round(total, 9))),
            Cell(numeral(100 * total / (times[-1] - times[0]))),
            *((_share(traits.share(active, traits.is_turning)),) if turns else ()),
            *((Cell(DASH) if near is None else _share(traits.share(active, near)),) if beacons else ()),
        )

    shares = " Shares are of a sensor's own time." if turns or beacons else ""
    near = " Near its beacon is nearer than half of the path." if beacons else ""
    rows = [
        row(name, on[:, s], traits.is_near[:, s] if traits.has_beacon[s] else None) for s, name in enumerate(study.scenario.sensor_names)
    ]
    return Table(
        f"Where the sensors are on, {path_in_words(study.about).removeprefix('the ')}",
        f"Good: only what is needed.{shares}{near}",
        ("sensor", "on [s]", "of the path [%]", *turns, *beacons),
        (*rows, row("the path itself", everything, None)),
    )


def _share(share: float) -> Cell:
    return Cell(DASH if math.isnan(share) else numeral(100 * share))


def losses_table(study: Study) -> Table:
    """What is left when a sensor is lost."""
    name, value = schedule_criterion(study), study.selection.schedule.value
    rows = tuple(
        (
            Cell(study.scenario.sensor_names[loss.sensor]),
            _loss_cell(study, loss.kept, value),
            Cell(_number(study, loss.kept)),
            Cell(_number(study, loss.rechosen)),
            Cell(_number(study, loss.bound)),
        )
        for loss in study.selection.losses
    )
    share = "kept" if _compares_differences(study) else "kept [%]"
    return Table(
        "When a sensor is lost",
        f"Good: a schedule that keeps most of its {name}, {numeral(value)}, whichever sensor fails. Kept: by this schedule without the "
        "sensor; chosen anew: by a schedule of the other sensors, none of which is above the bound.",
        ("lost sensor", share, f"{name} kept [–]", f"{name}, chosen anew [–]", "bound [–]"),
        rows,
    )


def _compares_differences(study: Study) -> bool:
    """Whether differences of the criterion count, not shares, which no value below 0 has."""
    return not study.scenario.schedule_criterion.scales_with_information or study.selection.schedule.value < 0


def _loss_cell(study: Study, kept_value: float, value: float) -> Cell:
    if not math.isfinite(kept_value) or (not _compares_differences(study) and facts.zero_round_off(study, kept_value) <= 0):
        return Cell("nothing", "bad")
    if _compares_differences(study):
        return Cell("all" if kept_value >= value - 1e-9 * abs(value) else "less")
    return Cell(numeral(100 * kept_value / value) if value > 0 else DASH, "good" if kept_value > 0.8 * value else "")


def _number(study: Study, value: float) -> str:
    return numeral(facts.zero_round_off(study, value)) if math.isfinite(value) else DASH


def schedules_table(study: Study) -> Table:
    """The criterion of the bound, the chosen schedule, the naive ones, and all sensors on throughout."""
    schedule, name = study.selection.schedule, schedule_criterion(study)
    values = {"no schedule is above": schedule.bound} | rival_values(study)
    if study.selection.exact is not None:
        values = {"chosen, all its samples together": facts.zero_round_off(study, study.selection.exact)} | values
    total = study.problem.scaled(study.main.information.total)
    values["all sensors on, for comparison"] = study.scenario.schedule_criterion.value(total)
    bound = schedule.bound
    share = study.scenario.schedule_criterion.scales_with_information and bound > 0
    rows = tuple(
        (
            Cell(label),
            Cell(numeral(value) if math.isfinite(value) else DASH, "good" if label == facts.CHOSEN else ""),
            *((Cell(numeral(100 * value / bound)),) if share else ()),
        )
        for label, value in values.items()
    )
    per_segment = study.scenario.selection.per_segment
    notes = tuple(
        f"* {rival.name} breaks: {'; '.join(rule_in_words(rule) for rule in study.scenario.selection.rules if str(rule) in rival.breaks)}."
        for rival in study.selection.rivals
        if rival.breaks
    )
    if study.selection.exact is not None:
        notes = (
            *notes,
            f"The errors of {join(dependent_sensors(study))} last: all but the first and the last row count amounts from below.",
        )
    return Table(
        f"Schedules on {path_in_words(study.about)}",
        f"Good: large {name} of S W S, near the bound that no schedule with {per_segment} on at a time exceeds.",
        ("schedule", f"{name} [–]", *(("of the bound [%]",) if share else ())),
        rows,
        notes,
    )


def raster_caption(study: Study) -> str:
    """Say how the raster is read."""
    seconds = plain(study.scenario.time.segment)
    return f"Blue is on, for {seconds}{NARROW}s each; a sensor without blue is not needed on this path when the others may be used."


def regret_caption(study: Study) -> str:
    """Say what the colours mean, and how many of the decisions are proven."""
    sure, total = count_proven_decisions(study)
    return (
        "What deciding otherwise costs: by how much the bound falls when a sensor that is off (a dot: on) is forced on (off) in that "
        f"segment. Dark costs much, white nothing. Where it costs more than what lies between the schedule and the bound, here "
        f"{sure} of {total} decisions, every schedule that is better decides the same."
    )


def count_proven_decisions(study: Study) -> tuple[int, int]:
    """How many of the decisions no better schedule takes otherwise, and how many there are."""
    schedule = study.selection.schedule
    cost = deviation_costs(study)
    return int((cost > schedule.root_bound - schedule.value).sum()), cost.size


def deviation_costs(study: Study) -> np.ndarray:
    """Return (K, S): how much the bound falls when a sensor is forced off where it is on, on where it is off."""
    schedule = study.selection.schedule
    return np.where(schedule.chosen, schedule.forced_off, schedule.forced_on)


def rivals_caption(study: Study) -> str:
    """Say what the bars compare."""
    best = max([value for name, value in list(rival_values(study).items())[1:] if not name.endswith("*")], default=0.0)
    value, rules = study.selection.schedule.value, any(rival.breaks for rival in study.selection.rivals)
    starred = " Schedules with * break the rules." if rules else ""
    if not study.scenario.schedule_criterion.is_smallest_eigenvalue:
        return f"What is known of the state under each schedule, by {schedule_criterion(study)}.{starred}"
    others = "the best of the others that keep the rules" if rules else "the best of the others"
    than = f"{numeral(value / best)} times as much as {others}" if best > 0 else "the others see nothing of one direction"
    return f"What is known of the weakest combination of states under each schedule: the chosen one gives {than}.{starred}"


def front_caption(study: Study) -> str:
    """Say what the front shows, and what half of the spending would buy."""
    front = study.selection.pareto
    if front is None:
        return ""
    value, top = study.selection.schedule.value, float(np.max(front.values))
    half = front.values[front.spent <= 0.5 * front.spent.max()]
    words = (
        f" Half of the largest spending buys {percent(float(half.max()) / top)} of the most."
        if len(half) and top > 0 and study.scenario.schedule_criterion.scales_with_information
        else ""
    )
    return (
        f"Each dot is a schedule; no schedule that spends as little lies above the dashed line, which is certified.{words} The chosen "
        f"schedule, {numeral(value)}, is the ring."
    )
