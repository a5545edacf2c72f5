"""A study on a terminal: four short tables."""

from __future__ import annotations

from rich.console import Group
from rich.markup import escape
from rich.table import Table

from obsdesign.report.result import DesignPart, PathPart, Result


def summary_of(result: Result) -> Group:
    """Return what a terminal shows of a result: what is hidden, the paths, the schedule, the filter."""
    suites = list(result.designs)
    return Group(_hidden(result, suites), _paths(result, suites), _schedule(result), _filter(result))


def _hidden(result: Result, suites: list[str]) -> Table:
    table = Table("sensors", "manoeuvre", "seen", "hidden", title="1 Can it?", title_justify="left")
    everything = "+".join(result.scenario.sensors)
    for suite in suites:
        for manoeuvre, verdicts in result.analyses.items():
            verdict = verdicts[everything if suite == "all" else suite]
            table.add_row(suite, manoeuvre, f"{verdict.dimension} of {verdict.states}", verdict.hidden)
    return table


def _paths(result: Result, suites: list[str]) -> Table:
    columns = [f"{text} ({suite})" for suite in suites for text in ("value", "weakest two eigenvalues")]
    table = Table(
        "path", "meets constraints", *columns, title="2 How? (more is better; no unit, scaled by the prior)", title_justify="left"
    )
    for name, path in result.paths.items():
        table.add_row(name, "yes" if path.feasible else "no", *_qualities(path, suites))
    for suite, design in result.designs.items():
        table.caption = "\n".join(filter(None, (str(table.caption or ""), _cap(suite, design))))
    return table


def _qualities(path: PathPart, suites: list[str]) -> list[str]:
    cells = []
    for quality in (path.quality[suite] for suite in suites):
        weakest = "  ".join(f"{max(value, 0.0):,.0f}" for value in quality.eigenvalues[:2])
        cells += ["-inf" if quality.value is None else f"{quality.value:,.0f}", weakest]
    return cells


def _cap(suite: str, design: DesignPart) -> str:
    if design.cap is None or design.value is None:
        return ""
    block = ", ".join(design.cap.states)
    reached = "reached" if design.cap.reached else f"{1 - design.value / design.cap.value:.1%} above what was found"
    return f"designed for {suite}: cap {design.cap.value:,.0f} from ({block}), {reached}"


def _schedule(result: Result) -> Table:
    selection = result.selection
    table = Table("schedule", "value", title="3 Which? (more is better; no unit)", title_justify="left")
    table.add_row("chosen", f"{selection.value:,.0f}")
    table.add_row("no schedule is above", f"{selection.bound:,.0f}  (gap {selection.gap:.2%})")
    for name, value in selection.naive.items():
        table.add_row(name, f"{value:,.0f}")
    table.add_row(f"best of {selection.random_count} random", f"{selection.random_best:,.0f}")
    return table


def _filter(result: Result) -> Table:
    states = list(zip(result.scenario.states, result.scenario.state_units, strict=True))
    columns = [escape(f"{name} [{unit}]") for name, unit in states]
    table = Table(
        "path",
        "schedule",
        *columns,
        "NEES in band",
        "filter",
        title="4 Does it hold? (final RMSE / bound; less is better)",
        title_justify="left",
    )
    for path, checks in result.validation.items():
        for schedule, check in checks.items():
            pairs = [(check.final_rmse[name], check.final_bound[name]) for name, _ in states]
            errors = [f"{rmse:.3g} / {'hidden' if bound is None else format(bound, '.3g')}" for rmse, bound in pairs]
            table.add_row(path, schedule, *errors, f"{check.in_band:.0%}", check.verdict)
    return table
