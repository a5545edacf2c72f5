"""A study on a terminal of 80 columns: four short tables."""

from __future__ import annotations

from rich import table as rich
from rich.box import SIMPLE
from rich.console import Group
from rich.markup import escape

from obsdesign.report.document import CheapestPart, DesignPart, FilterPart, RequirementPart, Result, SelectionPart, ValidationPart
from obsdesign.report.number_format import NOTHING, rounded_up
from obsdesign.report.table import Entry, Table, TableColumn, tabulate
from obsdesign.signals import Signal
from obsdesign.status import Status
from obsdesign.study.rated_schedules import FOR


def summary_of(result: Result) -> Group:
    """Return what a terminal shows of a result: what is hidden, the paths, the schedules, the filter."""
    several = len(result.selections) > 1
    schedules = [table for name, selection in result.selections.items() for table in _schedules(name if several else "", selection)]
    return Group(*map(render, (_hidden(result), _paths(result), *schedules, _filter(result))))


def schedule_of(result: Result) -> Group:
    """Return what a terminal shows of schedules alone: what was asked, their values, when each sensor is on, what losing one costs."""
    selection = result.selection
    tables = [*_schedules("", selection, "Which?"), _sensors(selection)]
    return Group(*_opening_line(selection), *map(render, tables))


def _opening_line(selection: SelectionPart) -> tuple[str, ...]:
    """Say what was minimised or maximised, and what is proven of it."""
    answer, cheapest = selection.filter, selection.cheapest
    if selection.question == "cheapest" and cheapest is not None:
        return (f"minimised: what is on costs, with what is required kept: {escape(_cheapest_answer(cheapest))}",)
    if selection.question == "start" or answer is None:
        label = escape(selection.criterion_label)
        bound = f"{_number(_value(selection.value))}, no schedule is above {_number(_value(selection.bound))} (gap {_gap(selection)})"
        return (f"maximised: {label} of the information about the state at the start, without process noise and prior: {bound}",)
    bound = f"{_number(_cost(answer.value))}, no schedule is below {_number(_cost(answer.bound))} (gap {_gap(answer)})"
    return (f"minimised: {escape(answer.minimised)}, with process noise and prior: {bound}",)


def _cost(value: float | None) -> float:
    """A number of the document, in which null is plus infinity."""
    return float("inf") if value is None else value


def _schedules(path: str, selection: SelectionPart, title: str = "3 Which?") -> list[Table]:
    """Return the tables of both questions, that of the one that is asked first."""
    answer = selection.filter
    if answer is None:
        return [_schedule(path, selection, title)]
    tables = [_schedule_for_filter(path, answer, title), _schedule(path, selection, title)]
    ordered = tables[::-1] if selection.question == "start" else tables
    return ordered if selection.cheapest is None else [_requirements(path, selection.cheapest, title), *ordered]


def _cheapest_answer(part: CheapestPart) -> str:
    """Say what keeping what is required costs, and what is proven of it; or why nothing keeps it."""
    if part.value is None:
        return part.notes[0]
    gap = "" if not part.gap else f" (gap {part.gap:.2%})"
    return f"{_number(part.value)}, none costs less than {_number(_value(part.bound))}{gap}"


def unkept_requirements(result: Result) -> tuple[str, ...]:
    """Return a line for each path on which it is proven that no schedule keeps what is required, where that is what is asked."""
    several = len(result.selections) > 1
    return tuple(
        f"{f'{name}: ' if several else ''}no schedule keeps what is required: {part.cheapest.notes[0]}"
        for name, part in result.selections.items()
        if part.question == "cheapest" and part.cheapest is not None and part.cheapest.status == Status.INFEASIBLE.name
    )


def _requirements(path: str, part: CheapestPart, title: str) -> Table:
    of = f" {path}," if path else ""
    rows = [
        (_requirement(each), NOTHING if each.size is None else f"{_size(each, each.size)} at {each.at:g} s") for each in part.requirements
    ]
    proof = () if part.value is None else (f"status: {Status[part.status].value}; the bound: by {part.bound_by}",)
    return tabulate(
        f"{title}{of} cheapest", _cheapest_answer(part), (TableColumn("required"), TableColumn("comes to")), rows, (*proof, *part.notes)
    )


def _requirement(part: RequirementPart) -> str:
    some = "" if part.share == 1 else f" at {part.share:.4g} of the instants"
    after = f" after {part.after:g} s" if part.after else ""
    return f"{' and '.join(part.about)} within {_size(part, part.at_most)}{some}{after}"


def _size(part: RequirementPart, size: float) -> str:
    factor, unit = Signal("", part.unit).display_unit
    return f"{factor * size:.4g} {unit}".rstrip()


def render(table: Table) -> rich.Table:
    """Lay a table out: its title with what is good, its notes below."""
    title = f"{table.title} ({table.good})" if table.good else table.title
    layout = {"title_justify": "left", "caption_justify": "left", "box": SIMPLE, "pad_edge": False}
    drawn = rich.Table(*map(escape, table.head), title=f"\n{escape(title)}", caption=escape("\n".join(table.notes)) or None, **layout)
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
    caps = tuple(filter(None, (each(suite, design) for suite, design in result.designs.items() for each in (_cap, _bound))))
    return tabulate("2 How?", "value: more is better; no unit, scaled by the prior", columns, rows, caps)


def _value(value: float | None) -> float:
    """A number of the document, in which null is minus infinity."""
    return float("-inf") if value is None else value


def _number(value: float) -> str:
    return f"{0.0 if abs(value) < 1e-6 else value:,.5g}"


def _bound(suite: str, design: DesignPart) -> str:
    if design.bound is None or design.value is None or design.proof.certificate is None or not design.proof.certificate.multipliers:
        return ""
    gap = "" if design.gap is None else f"; {design.gap:.2%} from the value"
    return f"designed for {suite}: proven, no path is above {rounded_up(design.bound, 5):,.5g}{gap}"


def _cap(suite: str, design: DesignPart) -> str:
    if design.cap is None or design.value is None:
        return ""
    block = ", ".join(design.cap.states)
    reached = "reached" if design.cap.reached else f"the value stays {1 - design.value / design.cap.value:.1%} below"
    return f"designed for {suite}: no path is above {design.cap.value:,.5g} ({block}); {reached}"


def _schedule(path: str, selection: SelectionPart, title: str = "3 Which?") -> Table:
    of = f" {path}," if path else ""
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
    return tabulate(f"{title}{of} for the start", good, (TableColumn("schedule"), TableColumn("value", _number)), rows, notes)


def _schedule_for_filter(path: str, answer: FilterPart, title: str) -> Table:
    of = f" {path}," if path else ""
    rows: list[tuple[Entry, Entry]] = [("chosen", _cost(answer.value))]
    rows.append(("no schedule is below", f"{_number(_cost(answer.bound))} (gap {_gap(answer)})"))
    others = [(name, rated) for name, rated in answer.rated.items() if name != FOR["filter"]]
    rows += [(name + (" (breaks the rules)" if rated.broken else ""), _cost(rated.cost)) for name, rated in others]
    rows += [(name, _cost(value)) for name, value in answer.compared.items() if name in ("best of random ones", "nothing on")]
    memory = "never" if answer.memory is None else f"after {answer.memory:g} segment{'' if answer.memory == 1 else 's'}"
    notes = [
        f"status: {Status[answer.status].value}; the bound: by {answer.bound_by}",
        f"minimised: {answer.minimised}, with process noise and prior",
        f"half of what a choice brings is forgotten: {memory}",
        *answer.notes,
    ]
    good = "cost: less is better; no unit, scaled by the prior"
    return tabulate(f"{title}{of} for the filter", good, (TableColumn("schedule"), TableColumn("cost", _number)), rows, notes)


def _gap(selection: SelectionPart | FilterPart) -> str:
    if selection.gap is None:
        return "none"
    return f"{selection.gap:.3g}" if selection.gap_kind == "absolute" else f"{selection.gap:.2%}"


def _sensors(selection: SelectionPart) -> Table:
    rows = []
    for name, seconds in selection.seconds.items():
        on = () if selection.filter is None else (selection.filter.seconds[name],)
        loss = selection.losses.get(name)
        left = ("", "", "") if loss is None else tuple(map(_value, (loss.kept, loss.rechosen, loss.bound)))
        rows.append((name, *on, seconds, *left))
    heads = ("on for the filter [s]",) * (selection.filter is not None) + ("on for the start [s]",)
    values = (TableColumn(head, _number) for head in ("kept", "chosen anew", "bound"))
    columns = (TableColumn("sensor"), *(TableColumn(head, _general) for head in heads), *values)
    return tabulate("Sensors, and what is left of the information about the start when one is lost", "", columns, rows)


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
