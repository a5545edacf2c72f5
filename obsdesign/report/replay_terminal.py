"""A replayed log on a terminal."""

from __future__ import annotations

from rich.console import Group
from rich.markup import escape

from obsdesign.report.number_format import NOTHING, plain
from obsdesign.report.replay_document import ReplayDocument
from obsdesign.report.table import Entry, Table, TableColumn, finite, tabulate
from obsdesign.report.terminal import render


def replay_summary(document: ReplayDocument) -> Group:
    """Return what a terminal shows: errors and rank correlations, then what hung on which sensor."""
    tables = map(render, (_numbers_table(document), _sensors_table(document)))
    return Group(*tables, *_schedule_lines(document), *map(_note, document.notes))


def _numbers_table(document: ReplayDocument) -> Table:
    about, unit = ", ".join(document.about), f" [{document.unit or NOTHING}]"
    rows: list[tuple[Entry, Entry]] = [
        (f"RMSE of {about}, second half{unit}", _value(document.position_rmse)),
        (f"RMSE of {about}{unit}", _value(document.position_rmse_all)),
        ("rank correlation of errors with the posterior", _value(document.spearman_posterior)),
        ("... with the filter's own covariance", _value(document.spearman_own)),
        ("... with the window's samples alone", _value(document.spearman_plain)),
        ("error over prediction, median", _value(document.ratio)),
        ("windows that do not see all of the state", f"{document.hidden_windows} of {len(document.windows)}"),
    ]
    return tabulate(document.title, "", (TableColumn(""), TableColumn("value", finite)), rows)


def _sensors_table(document: ReplayDocument) -> Table:
    rows = []
    most = [max(window.growth, key=window.growth.__getitem__) for window in document.windows if sum(window.samples.values())]
    for name, count in document.samples.items():
        rows.append((name, count, document.rejected_by_sensor[name], document.growth_by_sensor[name], most.count(name)))
    columns = (
        TableColumn("sensor"),
        TableColumn("samples", plain),
        TableColumn("rejected", plain),
        TableColumn("error without it, times", finite),
        TableColumn("windows that hang on it most", plain),
    )
    return tabulate("Sensors", "", columns, rows)


def _schedule_lines(document: ReplayDocument) -> tuple[str, ...]:
    if document.schedule is None:
        return ()
    errors = ", ".join(f"{name} {finite(_value(value))}" for name, value in document.schedule.rmse.items())
    gap = "none" if document.schedule.gap is None else f"{100 * document.schedule.gap:.2g} %"
    lines = (f"\nschedule, {document.schedule.per_segment} on at a time: proven to within {gap}",)
    return (*lines, f"RMSE: {errors}") if errors else lines


def _note(note: str) -> str:
    return escape(f"note: {note}")


def _value(value: float | None) -> float:
    return float("nan") if value is None else value
