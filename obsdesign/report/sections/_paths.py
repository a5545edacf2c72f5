"""Tables of paths: what is known along each, and by whom. Shared by the sections on designed and on given paths."""

from __future__ import annotations

import numpy as np

from obsdesign.information.contribution_shares import shortest_bulk
from obsdesign.report import derived_quantities as facts
from obsdesign.report.names import criterion_name, path_in_words, violations_in_words
from obsdesign.report.number_format import NARROW, NOTHING, display_unit, numeral, plain, signal_label
from obsdesign.report.table import Entry, Table, TableColumn, Toned, deviation, hundredths, signal_column, tabulate, whole_hundredths
from obsdesign.signals import Signal
from obsdesign.study.record import Candidate, Quality, Study


def path_value(study: Study, path: str) -> float:
    """Return the criterion of a path, all sensors on."""
    return facts.value_of(study, study.candidate(path).qualities[0])


def paths_table(study: Study) -> Table:
    """Value, smallest eigenvalues, Cramér-Rao bounds, feasibility and cap of every path for every suite."""
    name = criterion_name(study)
    columns = (
        TableColumn("path"),
        *((TableColumn("sensors"),) if len(study.suites) > 1 else ()),
        *((TableColumn("duration [s]", plain),) if _durations_differ(study) else ()),
        TableColumn(f"{name} [–]"),
        *(() if _value_is_eigenvalue(study) else (TableColumn("λmin [–]"),)),
        TableColumn("second [–]"),
        *map(signal_column, facts.states_of(study)),
        *((TableColumn("meets the limits"),) if _has_limits(study) else ()),
        *((TableColumn("below its cap [%]", hundredths),) if _has_cap(study) else ()),
    )
    return tabulate(
        "Paths",
        f"Good: large {name}, small standard deviations. Eigenvalues are of S W S, S the prior's standard deviations: λmin has no unit. "
        "Standard deviations are the Cramér-Rao bound on the start state from all measurements, without prior and process noise; "
        "hidden: no bound at all.",
        columns,
        (_path_row(study, candidate, quality) for candidate in study.candidates for quality in candidate.qualities),
    )


def contributions_table(study: Study) -> Table:
    """Which sensor says how much about each state along the designed path, and where most of it comes from."""
    contributions = study.main.contributions
    rows = [
        (
            signal_label(signal),
            _known_to(contributions.std[i], signal),
            *contributions.shares[i].sum(axis=0),
            _bulk_text(study, contributions.shares[i]),
        )
        for i, signal in enumerate(facts.states_of(study))
    ]
    weakest = ("weakest combination", NOTHING, *contributions.weakest_shares.sum(axis=0), _bulk_text(study, contributions.weakest_shares))
    return tabulate(
        f"Who says what on {path_in_words(study.about)}, all sensors on",
        "Good: small standard deviations that do not hang on one sensor. Known to: the Cramér-Rao bound on the start state; the shares of "
        "the sensors in what is known add up to 100; most of it: the shortest stretch that holds 70 % of the largest share.",
        (
            TableColumn("state"),
            TableColumn("known to"),
            *(TableColumn(f"{name} [%]", whole_hundredths) for name in contributions.sensors),
            TableColumn("most of it"),
        ),
        (*rows, weakest),
    )


def _known_to(value: float, signal: Signal) -> Entry:
    """A standard deviation in the unit of its row."""
    return deviation(value) if np.isinf(value) else numeral(value * display_unit(signal)[0])


def _bulk_text(study: Study, shares: np.ndarray) -> str:
    if np.isnan(shares).any():
        return "nothing says anything"
    sensor, first, last = shortest_bulk(shares)
    times = facts.segment_nodes(study)
    share, name = shares[first : last + 1, sensor].sum(), study.scenario.sensor_names[sensor]
    return f"{plain(round(100 * share))}{NARROW}% by {name} at {plain(times[first])}–{plain(times[last + 1])}{NARROW}s"


def _path_row(study: Study, candidate: Candidate, quality: Quality) -> tuple[Entry, ...]:
    values, value = facts.clean_eigenvalues(quality), facts.value_of(study, quality)
    shown = values[1:2] if _value_is_eigenvalue(study) else values[:2]
    return (
        candidate.name,
        *((facts.sensors_in_words(study, quality.sensors),) if len(study.suites) > 1 else ()),
        *((candidate.duration,) if _durations_differ(study) else ()),
        Toned(value, "bad" if value in (0.0, float("-inf")) else ""),
        *shown,
        *map(deviation, quality.std),
        *((_limits_entry(candidate),) if _has_limits(study) else ()),
        *((_cap_entry(study, candidate, quality),) if _has_cap(study) else ()),
    )


def _limits_entry(candidate: Candidate) -> Toned:
    return Toned(f"no: {violations_in_words(candidate.violations)}", "bad") if candidate.violations else Toned("yes", "good")


def _cap_entry(study: Study, candidate: Candidate, quality: Quality) -> Entry:
    cap, design = facts.cap_for(study, quality.sensors), study.designs[study.suites.index(quality.sensors)]
    if cap is None:
        return "no cap"
    if candidate.duration != design.problem.longest:
        return NOTHING
    short = 1 - facts.value_of(study, quality) / cap.value
    return Toned("cap reached", "good") if short <= 1e-6 else short


def _value_is_eigenvalue(study: Study) -> bool:
    """Whether the value of a path is the first of the eigenvalues that its row shows."""
    return facts.judged_by_eigenvalue(study) and facts.is_about_all_states(study)


def _has_limits(study: Study) -> bool:
    return bool(study.designs or study.scenario.design.constraints) and bool(study.checks)


def _has_cap(study: Study) -> bool:
    return any(design.cap is not None for design in study.designs)


def _durations_differ(study: Study) -> bool:
    return len({candidate.duration for candidate in study.candidates}) > 1
