"""A model that was read from a file of another tool, and the scenario that it becomes."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from obsdesign.formulas.functions import RESERVED

_BARE = re.compile(r"[A-Za-z0-9_-]+")


@dataclass(frozen=True)
class ImportedModel:
    """States, constants, inputs, rates and outputs as another tool's file says them, as formulas of ours.

    parameters: numbers by name; start: initial values where the file has some; period: of next values in place of rates; notes: what
    was changed or left out.
    """

    title: str
    states: tuple[str, ...]
    rates: Mapping[str, str]
    outputs: Mapping[str, str]
    constants: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()
    parameters: Mapping[str, float] | None = None
    definitions: Mapping[str, str] | None = None
    start: Mapping[str, float] | None = None
    period: float | None = None
    notes: tuple[str, ...] = ()

    def scenario(self, source: str) -> str:
        """Return the text of a scenario of which `obsdesign analyse` says what can be seen; source: where the model comes from."""
        return "\n".join([*self._head(source), *self._system(), *self._tail(), ""])

    def _head(self, source: str) -> Iterator[str]:
        yield f"# Made from {source} by `obsdesign import`: units, noises and what is known are for you to add."
        yield from (f"# {note}" for note in self.notes)
        yield from ("", "version = 1 # of the format of this file", f"title = {_toml_string(self.title)}")
        yield 'question = "What do the outputs tell of states and constants?"'

    def _system(self) -> Iterator[str]:
        yield from ("", "[system]", f"states = {_names(self.states)}")
        if self.constants:
            yield f"constants = {_names(self.constants)} # states that do not change, and that nobody knows"
        if self.inputs:
            yield f"inputs = {_names(self.inputs)} # known; name them under `unknown` where they are not"
        if self.period is not None:
            yield f"period = {self.period!r}"
        for key, table in (("parameters", self.parameters or {}), ("definitions", self.definitions or {})):
            yield from _table(f"system.{key}", table)
        yield from _table("system.rates" if self.period is None else "system.next_state", self.rates)
        yield from _table("system.outputs", self.outputs)

    def _tail(self) -> Iterator[str]:
        yield from ("", "# Asked at almost every state; with [start], at that one.", "[analysis]")
        if self.start:
            yield from (f"# {line}" if line else "" for line in _table("start", self.start))


def usable_names(names: Sequence[str]) -> dict[str, str]:
    """Return what names are called in formulas: themselves, with _ behind those that mean something else there."""
    taken = set(names)
    usable: dict[str, str] = {}
    for name in names:
        new = name
        while new in RESERVED or (new != name and new in taken):
            new += "_"
        usable[name] = new
        taken.add(new)
    return usable


def with_names(formula: str, names: Mapping[str, str]) -> str:
    """Return a formula in which names are called as they are in formulas of ours, but for those of functions that are called."""
    changed = {name: new for name, new in names.items() if name != new}
    if not changed:
        return formula
    words = "|".join(sorted(map(re.escape, changed), key=len, reverse=True))
    return re.sub(rf"\b({words})\b(?!\s*\()", lambda match: changed[match.group()], formula)


def _table(name: str, values: Mapping[str, str | float]) -> Iterator[str]:
    if values:
        yield from ("", f"[{name}]")
        yield from (
            f"{_key(key)} = {_toml_string(value) if isinstance(value, str) else repr(float(value))}" for key, value in values.items()
        )


def _names(names: Sequence[str]) -> str:
    return f"[{', '.join(map(_toml_string, names))}]"


def _key(name: str) -> str:
    return name if _BARE.fullmatch(name) else _toml_string(name)


def _toml_string(text: str) -> str:
    """A TOML string of a text; its escapes are those of JSON, but for one character."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
