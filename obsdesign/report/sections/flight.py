"""In flight? What a flight with the filter in the loop came to."""

from __future__ import annotations

from collections import Counter

import numpy as np

from obsdesign.calculus import wrap_columns
from obsdesign.constraints.abstract import ALWAYS, AT_END, AbstractConstraint
from obsdesign.design.feasibility import LeastMargin, least_margins_at_nodes
from obsdesign.design.violation import Violation
from obsdesign.planning.closed_loop import Flight
from obsdesign.report import derived_quantities as facts
from obsdesign.report.figures import flight_estimates, flight_map
from obsdesign.report.names import violations_in_words
from obsdesign.report.number_format import NARROW, display_unit, join, numeral, plain, signal_label, with_unit
from obsdesign.report.section import Section
from obsdesign.report.table import Table, TableColumn, tabulate
from obsdesign.scenario.tables import FlightTable
from obsdesign.study.record import Study

_FAR_MARGIN = 1.0  # margin by which a limit is broken that is not met at all: a whole tolerance or radius
_BETTER_SHARE = 0.8  # share of the other flight's standard deviation that counts as better


def section(study: Study, flight: Flight, settings: FlightTable) -> Section:
    """Return the answer to "In flight?"."""
    pictures = tuple(picture for figure in (flight_map, flight_estimates) if (picture := figure.picture(study)) is not None)
    tables = (errors_table(study, flight), plans_table(flight))
    return Section("flight", "In flight?", answer(study, flight, settings), pictures, tables)


def flight_violations(study: Study, flight: Flight) -> tuple[Violation, ...]:
    """Return the limits that the true states broke, worst first; those of certain times where they are the flight's own.

    Judged at the instants of the flight alone: between them disturbances move the truth, of which no states are kept.
    """
    broken = [least.violation() for least in _least_margins(study, flight) if least.value < 0]
    return tuple(sorted(broken, key=lambda violation: violation.margin))


def smallest_margin(study: Study, flight: Flight) -> float:
    """Return the least margin of these limits, of order 1; inf without any."""
    return min((least.value for least in _least_margins(study, flight)), default=np.inf)


def _least_margins(study: Study, flight: Flight) -> tuple[LeastMargin, ...]:
    """Where each limit that counts is nearest to being broken."""
    limits = tuple(constraint for constraint in study.scenario.design.constraints if _is_checked(study, constraint))
    return least_margins_at_nodes(study.problem.system.model, limits, flight.truth, flight.u, study.scenario.time.step)


def _is_checked(study: Study, limit: AbstractConstraint) -> bool:
    return limit.span == ALWAYS or ends_with_plans(study)


def ends_with_plans(study: Study) -> bool:
    """Whether the flight ends when its plans do, so that what is asked of their end and of certain times is asked of the flight."""
    settings = study.scenario.flight
    return settings is not None and settings.horizon == "shrinking" and settings.duration == study.scenario.time.duration


def final_errors(study: Study, flight: Flight) -> np.ndarray:
    """Return |estimate - truth| (n,) at the end."""
    is_angle = np.array([signal.is_angle for signal in facts.states_of(study)])
    return np.abs(wrap_columns(flight.mean[-1:] - flight.truth[-1:], is_angle))[0]


def answer(study: Study, flight: Flight, settings: FlightTable) -> str:
    """Answer "In flight?": limits, and how well the states are known at the end against inputs in the middle of their ranges."""
    violations, count = flight_violations(study, flight), len(flight.statuses)
    goal = any(constraint.span == AT_END for constraint in study.scenario.design.constraints) and ends_with_plans(study)
    is_far = any(violation.margin < -_FAR_MARGIN for violation in violations)
    yes = "No" if is_far else "Not quite" if violations else "Yes"
    limits = (
        f"the true path {violations_in_words(violations)}"
        if violations
        else f"the true path {'arrives and ' if goal else ''}keeps every limit at the steps, where it is looked at"
    )
    feasible_plans = sum(flight.feasible)
    every = f"with a new plan every {plain(settings.every)}{NARROW}s, {count} in all, {limits}"
    return f"{yes}: {every}; {feasible_plans} of the plans keep every limit from where the filter believes to be{_gains(study, flight)}."


def _gains(study: Study, flight: Flight) -> str:
    if flight.straight is None:
        return ""
    trio = zip(facts.states_of(study), flight.std[-1], flight.straight.std[-1], strict=True)
    better = [(signal, ours, theirs) for signal, ours, theirs in trio if ours <= _BETTER_SHARE * theirs]
    if not better:
        return "; at the end nothing is known better than with all inputs in the middle of their ranges"
    gains = join([f"{signal.name} to {with_unit(ours, signal)}" for signal, ours, _ in better])
    others_text = join([with_unit(theirs, signal) for signal, _, theirs in better])
    return f"; at the end it knows {gains} (1σ), where inputs in the middle of their ranges leave {others_text}"


def errors_table(study: Study, flight: Flight) -> Table:
    """Final errors and standard deviations, flown and with idle inputs."""
    flights = [flight] if flight.straight is None else [flight, flight.straight]
    columns = [(final_errors(study, case), case.std[-1]) for case in flights]
    rows = (
        (signal_label(signal), *(values[i] * display_unit(signal)[0] for pair in columns for values in pair))
        for i, signal in enumerate(facts.states_of(study))
    )
    names = ("planned on the way", "inputs mid-range")[: len(flights)]
    n = len(study.scenario.state_names)
    nees = [f"{name}: {numeral(float(case.nees.mean()))}" for name, case in zip(names, flights, strict=True)]
    return tabulate(
        "What is known at the end of the flight",
        f"Good: small standard deviations (1σ) of the filter, and errors of that size. One flight is one draw: an honest filter's NEES "
        f"is {n} on average over many. Mean over this flight: {'; '.join(nees)}.",
        (TableColumn("state"), *(TableColumn(f"{name}, {what} [as the state]") for name in names for what in ("error", "1σ"))),
        rows,
    )


def plans_table(flight: Flight) -> Table:
    """How the plans ended."""
    counts = Counter((status.value, age == 0) for status, age in zip(flight.statuses, flight.ages, strict=True))
    rows = (
        (status, "the new plan" if is_new else "the plan before", count)
        for (status, is_new), count in sorted(counts.items(), key=lambda item: -item[1])
    )
    valid = sum(flight.feasible)
    return tabulate(
        "Plans on the way",
        f"Good: plans that keep every limit, here {valid} of {len(flight.statuses)}. A plan goes on where the one before stopped and takes "
        "few iterations: stopping at their limit is usual.",
        (TableColumn("how the climb ended"), TableColumn("what was flown"), TableColumn("plans [–]", plain)),
        rows,
    )
