"""The equations of StructuralIdentifiability.jl: @ODEmodel(x'(t) = ..., y(t) = ...), and @DDSmodel(x(t + 1) = ..., ...).

What stands as name(t) is a function of time: a state where it has an equation with ' or (t + 1), an output where it has one without, an
input elsewhere. All other names are parameters that do not change.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from obsdesign.errors import InputError
from obsdesign.formulas.functions import ALIASES, FUNCTIONS, PI
from obsdesign.formulas.grammar import parse_formula
from obsdesign.formulas.tree import FormulaError, names_of
from obsdesign.model_import.imported_model import ImportedModel, usable_names, with_names

_MACRO = re.compile(r"@(ODEmodel|DDSmodel)\s*\(")
_LEFT = re.compile(r"\s*([^\W\d]\w*)\s*('?)\s*\(\s*t\s*(\+\s*1\s*)?\)\s*")
_OF_TIME = re.compile(r"([^\W\d]\w*)\s*\(\s*t\s*\)")
_LARGEST = 10**6  # characters


@dataclass(frozen=True)
class _Equation:
    """One equation: its line, what it is of, whether that moves, its right side, the functions of time in it."""

    line: int
    name: str
    moves: bool
    formula: str
    functions: tuple[str, ...]


def read_ode_model(text: str, file: str) -> ImportedModel:
    """Return the model of a text. Raises InputError that names the file, the line and what is accepted."""
    if len(text) > _LARGEST:
        raise InputError(f"{file}: has {len(text)} characters: must be at most {_LARGEST}")
    text = re.sub(r"#[^\n]*", lambda match: " " * len(match.group()), text)
    macro = _MACRO.search(text)
    if macro is None:
        raise InputError(f"{file}: has no model: must hold @ODEmodel(x'(t) = ..., y(t) = ...) or @DDSmodel(x(t + 1) = ..., y(t) = ...)")
    is_map = macro.group(1) == "DDSmodel"
    equations = [_equation(part, line, file, is_map) for part, line in _parts(text, macro.end(), file)]
    names = [equation.name for equation in equations]
    for i, equation in enumerate(equations):
        if equation.name in names[:i]:
            raise InputError(f"{file}, line {equation.line}: {equation.name} has two equations: must have one")
    return _model(equations, is_map, file)


def _parts(text: str, position: int, file: str) -> Iterator[tuple[str, int]]:
    """What stands between the commas of a call that begins at a position, and on which line."""
    begin, depth = position, 0
    for i in range(position, len(text)):
        if text[i] in "([{":
            depth += 1
        elif text[i] in ")]}":
            depth -= 1
        if depth < 0 or (depth == 0 and text[i] == ","):
            part = text[begin:i]
            if part.strip():
                yield part, text.count("\n", 0, begin + len(part) - len(part.lstrip())) + 1
            begin = i + 1
        if depth < 0:
            return
    raise InputError(f"{file}, line {text.count(chr(10), 0, position) + 1}: the model's bracket is not closed")


def _equation(part: str, line: int, file: str, is_map: bool) -> _Equation:
    left, equals, right = part.partition("=")
    match = _LEFT.fullmatch(left)
    mark = "x(t + 1)" if is_map else "x'(t)"
    if not equals or match is None or (bool(match.group(3)) and not is_map) or (bool(match.group(2)) and is_map):
        accepted = f"{mark} = ... of a state, y(t) = ... of an output"
        raise InputError(f"{file}, line {line}: {part.strip()[:60]!r} is no equation: must be {accepted}")
    formula = " ".join(_OF_TIME.sub(r"\1", right).replace("//", "/").split())
    return _Equation(line, match.group(1), bool(match.group(2) or match.group(3)), formula, tuple(_OF_TIME.findall(right)))


def _model(equations: list[_Equation], is_map: bool, file: str) -> ImportedModel:
    states = [equation.name for equation in equations if equation.moves]
    outputs = [equation.name for equation in equations if not equation.moves]
    if not states or not outputs:
        raise InputError(f"{file}: has {len(states)} states and {len(outputs)} outputs: must have one of each at least")
    functions = dict.fromkeys(name for equation in equations for name in equation.functions)
    for equation in equations:
        _require_no_time(equation, states, file)
    inputs = [name for name in functions if name not in states and name not in outputs]
    names = dict.fromkeys(name for equation in equations for name in _names_in(equation, file))
    parameters = [name for name in names if name not in (*states, *outputs, *inputs)]
    for equation in equations:
        if used := [name for name in outputs if name in _names_in(equation, file)]:
            raise InputError(f"{file}, line {equation.line}: contains the output {used[0]}: must be made of states, inputs and parameters")
    called = usable_names([*states, *inputs, *parameters])
    renamed = [f"{name} is called {new}: formulas know another {name}." for name, new in called.items() if new != name]
    formulas = {equation.name: with_names(equation.formula, called) for equation in equations}
    return ImportedModel(
        title=f"The model of {file}",
        states=tuple(called[name] for name in states),
        rates={called[name]: formulas[name] for name in states},
        outputs={name: formulas[name] for name in outputs},
        constants=tuple(called[name] for name in parameters),
        inputs=tuple(called[name] for name in inputs),
        period=1.0 if is_map else None,
        notes=tuple(renamed),
    )


def _require_no_time(equation: _Equation, states: list[str], file: str) -> None:
    """Raise InputError where time stands in an equation by itself: it is no parameter, and sin(t) is no input."""
    of_time = [f"{name}(t)" for name in equation.functions if name in {*FUNCTIONS, *ALIASES} and name not in states]
    if of_time or "t" in _names_in(equation, file):
        message = f"contains {[*of_time, 't'][0]}: time by itself is a state that is measured, c'(t) = 1 and y_c(t) = c(t)"
        raise InputError(f"{file}, line {equation.line}: {equation.name} {message}")


def _names_in(equation: _Equation, file: str) -> tuple[str, ...]:
    """The names in a formula but pi. Raises InputError where it is none."""
    try:
        return tuple(name for name in names_of(parse_formula(equation.formula)) if name != PI)
    except FormulaError as error:
        raise InputError(f"{file}, line {equation.line}: {equation.name} {error.problem.told(equation.formula)}") from None
