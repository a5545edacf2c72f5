"""A study on a terminal of 80 columns: four short tables."""

from __future__ import annotations

from rich import table as rich
from rich.box import SIMPLE
from rich.console import Group
from rich.markup import escape

from obsdesign.report.document import DesignPart, Result, SelectionPart, ValidationPart
from obsdesign.report.table import Entry, Table, TableColumn, tabulate
from obsdesign.status import Status


def summary_of(result: Result) -> Group:
    """Return what a terminal shows of a result: what is hidden, the paths, the schedules, the filter."""
    several = len(result.selections) > 1
    schedules = [_schedule(name if several else "", selection) for name, selection in result.selections.items()]
    return Group(*map(_render, (_hidden(result), _paths(result), *schedules, _filter(result))))


def schedule_of(result: Result) -> Group:
    """Return what a terminal shows of a schedule alone: its value, when each sensor is on, what losing one costs."""
    return Group(_render(_schedule("", result.selection, "Which?")), _render(_sensors(result.selection)))


def _render(table: Table) -> rich.Table:
    """Lay a table out: its title with what is good, its notes below."""
    title = f"{table.title} ({table.good})" if table.good else table.title
    layout = {"title_justify": "left", "caption_justify": "left", "box": SIMPLE, "pad_edge": False}
    drawn = rich.Table(*map(escape, table.head), title=f"\n{title}", caption=escape("\n".join(table.notes)) or None, **layout)
    for row in table.rows:
        drawn.add_row(*(escape(cell.text) for cell in row))
    return drawn


def _hidden(result: Result) -> Table:
    everything = "+".join(result.scenario.sensors)
    suites = [(suite, everything if suite == "all" else suite) for suite in result.designs or ("all",)]
    verdicts = [(suite, manoeuvre, seen[key]) for suite, key in suites for manoeuvre, seen in result.analyses.items()]
    rows = [(suite, manoeuvre, f"{seen.dimension} of {seen.states}", seen.hidden) for suite, manoeuvre, seen in verdicts]
    return tabulate("1 Can it?", "", tuple(map(TableColumn, ("sensors", "manoeuvre", "seen", "hidden"))), rows)


def _paths(result: Result) -> Table:
    suites = list(next(iter(result.paths.values())).quality)
    rows = [
        (name, "yes" if path.feasible else "no", *(_value(path.quality[suite].value) for suite in suites))
        for name, path in result.paths.items()
    ]
    columns = (TableColumn("path"), TableColumn("meets constraints"), *(TableColumn(f"value ({suite})", _number) for suite in suites))
    caps = tuple(filter(None, (_cap(suite, design) for suite, design in result.designs.items())))
    return tabulate("2 How?", "value: more is better; no unit, scaled by the prior", columns, rows, caps)


def _value(value: float | None) -> float:
    """A number of the document, in which null is minus infinity."""
    return float("-inf") if value is None else value


def _number(value: float) -> str:
    return f"{0.0 if abs(value) < 1e-6 else value:,.5g}"


def _cap(suite: str, design: DesignPart) -> str:
    if design.cap is None or design.value is None:
        return ""
    block = ", ".join(design.cap.states)
    reached = "reached" if design.cap.reached else f"the value stays {1 - design.value / design.cap.value:.1%} below"
    return f"designed for {suite}: no path is above {design.cap.value:,.5g} ({block}); {reached}"


def _schedule(path: str, selection: SelectionPart, title: str = "3 Which?") -> Table:
    of = f" {path}:" if path else ""
    rows: list[tuple[Entry, Entry]] = [("chosen", _value(selection.value))]
    if selection.exact_value is not None:
        rows.append(("chosen, all its samples together (the others: counted from below)", selection.exact_value))
    rows.append(("no schedule is above", f"{_number(_value(selection.bound))} (gap {_gap(selection)})"))
    rows += [(name + (" (breaks the rules)" if selection.broken[name] else ""), _value(value)) for name, value in selection.naive.items()]
    if selection.random_count:
        rows.append((f"best of {selection.random_count} random", _value(selection.random_best)))
    about = "maximised: information about the state at the start, without process noise and prior"
    rules = [f"rule: {rule}" for rule in selection.rules]
    notes = [f"status: {Status[selection.status].value}", about, *rules, *selection.notes]
    good = f"{selection.criterion_label} of S W S: more is better; no unit"
    return tabulate(f"{title}{of}", good, (TableColumn("schedule"), TableColumn("value", _number)), rows, notes)


def _gap(selection: SelectionPart) -> str:
    if selection.gap is None:
        return "none"
    return f"{selection.gap:.3g}" if selection.gap_kind == "absolute" else f"{selection.gap:.2%}"


def _sensors(selection: SelectionPart) -> Table:
    rows = []
    for name, seconds in selection.seconds.items():
        loss = selection.losses.get(name)
        left = ("", "", "") if loss is None else tuple(map(_value, (loss.kept, loss.rechosen, loss.bound)))
        rows.append((name, seconds, *left))
    values = (TableColumn(head, _number) for head in ("kept", "chosen anew", "bound"))
    return tabulate(
        "Sensors, and what is left when one is lost", "", (TableColumn("sensor"), TableColumn("on [s]", _general), *values), rows
    )


def _general(value: float) -> str:
    return f"{value:g}"


def _filter(result: Result) -> Table:
    cases = {(path, name): check for path, checks in result.validation.items() for name, check in checks.items()}
    states = zip(result.scenario.states, result.scenario.state_units, strict=True)
    rows = [
        *((f"{state} [{unit}]", *(_error(check, state) for check in cases.values())) for state, unit in states),
        ("NEES in band", *(f"{check.in_band:.0%}" for check in cases.values())),
        ("filter", *(check.verdict for check in cases.values())),
    ]
    columns = (TableColumn(""), *(TableColumn(f"{path}\n{name}") for path, name in cases))
    return tabulate("4 Does it hold?", "RMSE at the end, in brackets its bound; less is better", columns, rows)


def _error(check: ValidationPart, state: str) -> str:
    bound = check.final_bound[state]
    return f"{check.final_rmse[state]:.3g} ({'hidden' if bound is None else format(bound, '.3g')})"
