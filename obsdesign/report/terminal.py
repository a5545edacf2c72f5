"""A study on a terminal of 80 columns: four short tables."""

from __future__ import annotations

from rich.box import SIMPLE
from rich.console import Group
from rich.markup import escape
from rich.table import Table

from obsdesign.report.document import DesignPart, Result, SelectionPart, ValidationPart
from obsdesign.status import Status


def summary_of(result: Result) -> Group:
    """Return what a terminal shows of a result: what is hidden, the paths, the schedules, the filter."""
    several = len(result.selections) > 1
    schedules = [_schedule(name if several else "", selection) for name, selection in result.selections.items()]
    return Group(_hidden(result), _paths(result), *schedules, _filter(result))


def schedule_of(result: Result) -> Group:
    """Return what a terminal shows of a schedule alone: its value, when each sensor is on, what losing one costs."""
    return Group(_schedule("", result.selection, "Which?"), _sensors(result.selection))


def _table(title: str, *columns: str) -> Table:
    return Table(*map(escape, columns), title=f"\n{title}", title_justify="left", caption_justify="left", box=SIMPLE, pad_edge=False)


def _hidden(result: Result) -> Table:
    table = _table("1 Can it?", "sensors", "manoeuvre", "seen", "hidden")
    everything = "+".join(result.scenario.sensors)
    for suite in result.designs or ("all",):
        for manoeuvre, verdicts in result.analyses.items():
            verdict = verdicts[everything if suite == "all" else suite]
            table.add_row(suite, manoeuvre, f"{verdict.dimension} of {verdict.states}", verdict.hidden)
    return table


def _paths(result: Result) -> Table:
    suites = list(next(iter(result.paths.values())).quality)
    title = "2 How? (value: more is better; no unit, scaled by the prior)"
    table = _table(title, "path", "meets constraints", *(f"value ({suite})" for suite in suites))
    for name, path in result.paths.items():
        table.add_row(name, "yes" if path.feasible else "no", *(_number(path.quality[suite].value) for suite in suites))
    table.caption = "\n".join(filter(None, (_cap(suite, design) for suite, design in result.designs.items()))) or None
    return table


def _number(value: float | None) -> str:
    return "-inf" if value is None else f"{0.0 if abs(value) < 1e-6 else value:,.5g}"


def _cap(suite: str, design: DesignPart) -> str:
    if design.cap is None or design.value is None:
        return ""
    block = ", ".join(design.cap.states)
    reached = "reached" if design.cap.reached else f"the value stays {1 - design.value / design.cap.value:.1%} below"
    return f"designed for {suite}: no path is above {design.cap.value:,.5g} ({block}); {reached}"


def _schedule(path: str, selection: SelectionPart, title: str = "3 Which?") -> Table:
    of = f" {path}:" if path else ""
    table = _table(f"{title}{of} ({selection.criterion_label} of S W S: more is better; no unit)", "schedule", "value")
    table.add_row("chosen", _number(selection.value))
    if selection.exact_value is not None:
        table.add_row("chosen, all its samples together (the others: counted from below)", _number(selection.exact_value))
    gap = "none" if selection.gap is None else f"{selection.gap:.3g}" if selection.gap_kind == "absolute" else f"{selection.gap:.2%}"
    table.add_row("no schedule is above", f"{_number(selection.bound)} (gap {gap})")
    for naive_name, value in selection.naive.items():
        table.add_row(naive_name + (" (breaks the rules)" if selection.broken[naive_name] else ""), _number(value))
    if selection.random_count:
        table.add_row(f"best of {selection.random_count} random", _number(selection.random_best))
    about = "maximised: information about the state at the start, without process noise and prior"
    rules = [f"rule: {rule}" for rule in selection.rules]
    table.caption = escape("\n".join([f"status: {Status[selection.status].value}", about, *rules, *selection.notes]))
    return table


def _sensors(selection: SelectionPart) -> Table:
    table = _table("Sensors, and what is left when one is lost", "sensor", "on [s]", "kept", "chosen anew", "bound")
    for name, seconds in selection.seconds.items():
        loss = selection.losses.get(name)
        left = ("", "", "") if loss is None else (_number(loss.kept), _number(loss.rechosen), _number(loss.bound))
        table.add_row(name, f"{seconds:g}", *left)
    return table


def _filter(result: Result) -> Table:
    cases = {(path, name): check for path, checks in result.validation.items() for name, check in checks.items()}
    title = "4 Does it hold? (RMSE at the end, in brackets its bound; less is better)"
    table = _table(title, "", *(f"{path}\n{name}" for path, name in cases))
    for state, unit in zip(result.scenario.states, result.scenario.state_units, strict=True):
        table.add_row(escape(f"{state} [{unit}]"), *(_error(check, state) for check in cases.values()))
    table.add_row("NEES in band", *(f"{check.in_band:.0%}" for check in cases.values()))
    table.add_row("filter", *(check.verdict for check in cases.values()))
    return table


def _error(check: ValidationPart, state: str) -> str:
    bound = check.final_bound[state]
    return f"{check.final_rmse[state]:.3g} ({'hidden' if bound is None else format(bound, '.3g')})"
