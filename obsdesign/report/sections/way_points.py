"""As way points? What it costs to fly through few points of the path, as an autopilot does."""

from __future__ import annotations

from obsdesign.report.derived_quantities import states_of
from obsdesign.report.number_format import join, numeral, plain
from obsdesign.report.section import Section
from obsdesign.report.table import Entry, Table, TableColumn, Toned, signal_column, tabulate
from obsdesign.study.record import Study
from obsdesign.study.thinned_path import ThinnedPath

_NOTE = (
    "Flown: the legs between the way points are followed by the autopilot's own guidance (L1, with its default settings), which cuts "
    "corners, within the turn rates of the design; schedule by time. λmin: of S W S, all sensors on; standard deviations: of the filter "
    "at the end, with the schedule."
)


def section(study: Study) -> Section:
    """Return the answer to "As way points?"."""
    limits = tuple(
        f"Flown through {plain(len(each.points))} points the path breaks {join(each.broken)}." for each in study.way_points if each.broken
    )
    return Section("way-points", "As way points?", _answer(study.way_points[0]), (), (costs_table(study),), (*limits, _NOTE))


def _answer(thinned: ThinnedPath) -> str:
    """Answer in one sentence."""
    given, flown = thinned.smallest_eigenvalue
    end = "" if thinned.reached else " The last way point is not reached."
    return (
        f"{plain(len(thinned.points))} of {plain(thinned.of)} points are enough for {numeral(flown / given) if given > 0 else 'none'} of "
        f"λmin; the flight stays within {numeral(thinned.deviation)} m of the path.{end}"
    )


def costs_table(study: Study) -> Table:
    """Return information and deviations along the path and along each flight."""
    signals = states_of(study)
    head = ("path", "points", "farthest [m]", "duration [s]", "λmin")
    columns = (*map(TableColumn, head), *map(signal_column, signals))
    first = study.way_points[0]
    rows: list[tuple[Entry, ...]] = [
        ("as designed", plain(first.of), 0.0, first.durations[0], first.smallest_eigenvalue[0], *first.std[0].tolist())
    ]
    rows += [_row(thinned) for thinned in study.way_points]
    return tabulate("Flown through way points", "λmin: more is better; standard deviations: less is better", columns, rows)


def _row(thinned: ThinnedPath) -> tuple[Entry, ...]:
    taken = f"within {thinned.tolerance:g} m" if thinned.every is None else f"every {thinned.every:g} s"
    name = f"{taken}, {thinned.autopilot}"
    label = (
        name if thinned.reached and not thinned.broken else Toned(f"{name}: {'breaks limits' if thinned.broken else 'not ended'}", "bad")
    )
    figures = (plain(len(thinned.points)), thinned.deviation, thinned.durations[1], thinned.smallest_eigenvalue[1])
    return (label, *figures, *thinned.std[1].tolist())
