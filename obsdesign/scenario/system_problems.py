"""What is wrong with the table [system]: its names, its formulas, their units."""

from __future__ import annotations

from collections.abc import Iterator

from obsdesign.formulas.functions import PI, RESERVED
from obsdesign.formulas.grammar import is_name
from obsdesign.formulas.named_units import BASES
from obsdesign.formulas.tree import FormulaError
from obsdesign.formulas.unit_algebra import Unit, define_unit, read_unit
from obsdesign.scenario.formula_problems import NAMED, QUANTITIES, SYSTEM, FormulaCheck, problem_at
from obsdesign.scenario.problem_text import Location, Problem, nearest_word, unknown_key
from obsdesign.scenario.system_tables import SystemTable

_SECONDS = read_unit("s")
_FIXED = (*BASES, "rad")  # units that keep their meaning: newtons are made of metres, and what is in rad wraps


def find_system_problems(table: SystemTable) -> Iterator[Problem]:
    """Yield all that is wrong with a system's names, formulas and units."""
    names = list(_name_problems(table))
    yield from (*names, *_unit_problems(table), *_rate_problems(table), *_output_problems(table))
    if not names:
        yield from FormulaCheck(table).problems()


def _name_problems(table: SystemTable) -> Iterator[Problem]:
    """Names that are none, that mean something else, or that stand twice."""
    seen: dict[str, str] = {}
    for key in NAMED:
        for name in getattr(table, key):
            location = (SYSTEM, key, name)
            if not is_name(name):
                yield Problem(location, f"is called {name!r}: a name must be letters, digits and _, and not begin with a digit")
            elif name in RESERVED:
                yield Problem(location, f"is called {name!r}: that is {'a number' if name == PI else 'a function'} in formulas")
            elif name in seen:
                yield Problem(location, f"is called {name!r}, as one of {seen[name]} is: every name must have one meaning")
            seen.setdefault(name, key)
    for name in table.outputs:
        if not is_name(name):
            yield Problem(
                (SYSTEM, "outputs", name), f"is called {name!r}: a name must be letters, digits and _, and not begin with a digit"
            )


def _unit_problems(table: SystemTable) -> Iterator[Problem]:
    """Units that are none."""
    user_units: dict[str, Unit] = {}
    for name, text in table.units.items():
        if name in _FIXED:
            yield Problem((SYSTEM, "units", name), f"is {text!r}: {name} is a unit that others are made of; give yours another name")
            continue
        try:
            user_units[name] = define_unit(name, text, user_units)
        except FormulaError as error:
            yield problem_at(("units", name), text, error.problem)
    for location, text in _unit_texts(table):
        try:
            read_unit(text, user_units)
        except FormulaError as error:
            yield problem_at(location, text, error.problem)
    try:
        is_time = read_unit(table.time, user_units).dimension == _SECONDS.dimension
    except FormulaError:
        is_time = True  # told above
    if not is_time:
        yield Problem((SYSTEM, "time"), f"is {table.time!r}: must be a unit of time, such as s, min, h, day")


def _unit_texts(table: SystemTable) -> Iterator[tuple[Location, str]]:
    """Where units stand, and which."""
    for key in QUANTITIES:
        yield from (((key, name), text) for name, text in getattr(table, key).items() if text)
    for key in ("parameters", "landmarks", "outputs"):
        yield from (((key, name, "unit"), item.unit) for name, item in getattr(table, key).items() if item.unit)
    yield ("time",), table.time


def _rate_problems(table: SystemTable) -> Iterator[Problem]:
    """Rates of what is no state, states without a rate; the same of next values."""
    if table.rates and table.next_state:
        yield Problem((SYSTEM, "next_state"), "does not go with rates: a system is continuous, or a map from one instant to the next")
        return
    if (table.period is None) != (not table.next_state):
        needs = "needs next_state" if table.period is not None else "missing key: next_state needs it"
        yield Problem((SYSTEM, "period"), needs)
    key = "next_state" if table.next_state else "rates"
    for name in table.motion:
        if name in table.constants:
            message = f"{name} is one of constants, which do not change: name it under states, or leave this out"
            yield Problem((SYSTEM, key, name), message)
        elif name not in table.states:
            yield unknown_key((SYSTEM, key, name), name, tuple(table.states))
    for name in table.states:
        if name not in table.motion:
            yield Problem((SYSTEM, key, name), "missing key: how a state moves; those that do not may stand under constants")


def _output_problems(table: SystemTable) -> Iterator[Problem]:
    """Outputs whose parts do not fit together, names of entries that are taken, angles that are none."""
    states = (*table.states, *table.constants)
    taken = {name: key for key in QUANTITIES for name in getattr(table, key)}
    entries: list[str] = []
    for name, output in table.outputs.items():
        count = len(output.of)
        if isinstance(output.sigma, tuple) and len(output.sigma) != count:
            yield Problem((SYSTEM, "outputs", name, "sigma"), f"has {len(output.sigma)} numbers: must be {count}, one for each formula")
        own_entries = [name] if count == 1 else [f"{name}_{i + 1}" for i in range(count)]
        entries += own_entries
        for entry in own_entries:
            measures_it = count == 1 and entry in states and output.of[0].strip() == entry
            if entry in taken and not measures_it:
                message = (
                    f"has the entry {entry!r}, as one of {taken[entry]} is called: an output may bear the name of a state that it is, alone"
                )
                yield Problem((SYSTEM, "outputs", name), message)
    accepted = tuple(dict.fromkeys((*states, *table.outputs, *entries)))
    for name in table.angles or ():
        if name not in accepted:
            hint, nearest = nearest_word(name, accepted)
            yield Problem((SYSTEM, "angles"), f"names {name!r}{hint} (accepted: {', '.join(accepted)})", accepted, nearest)
