"""Every exported name explains its arguments and fields: what each is, its shape where it is an array, its unit where it has one."""

from __future__ import annotations

import ast
import inspect
import re
import textwrap
from dataclasses import fields, is_dataclass
from enum import Enum

import pytest
from pydantic import BaseModel

import obsdesign as od

ENTRY = re.compile(r"^    (?P<names>\w+(?:, \w+)*)(?P<shape> \([^()]*\))?:", re.MULTILINE)  # of the list of arguments
SHAPE = re.compile(r"\((?:\.{1,3}|[A-Za-z0-9_]+(?: ?[+-] ?[A-Za-z0-9_]+)*),[^()]*\)")  # (n,), (N+1, n), (..., n), (N - window + 1, S)
UNIT = re.compile(r"\[[^\]]+\]|\bunits?\b|\bscaled\b")
# what these names mean is physical wherever they stand
PHYSICAL = re.compile(
    r"dt|step|duration|t|time|every|deadline|time_limit|seconds|first|last|time_scale|blend|radius|centre|point|corners|distance"
    r"|landmarks|lengths|clearance|tracks|beacon|max_range|field_of_view|heading|heading_tolerance|low|high|speed|rate|least|most|by"
    r"|sigma|sigma_per_metre|bias_floor|x|x0|u|w|mean|std|covariance|truth|bound|rmse|eps|start|starts|disturbance_psd"
)
# names of the same spelling that count
COUNTS = re.compile(r"(MaxUses|MinimumDwell)\.(most|least)|(Planner|Design|codesign|design_trajectory)\.starts|Scenario\.time")


def attribute_docstrings(owner: type) -> dict[str, str]:
    """Field -> the string literal right below it in the class's source."""
    (tree,) = ast.parse(textwrap.dedent(inspect.getsource(owner))).body
    assert isinstance(tree, ast.ClassDef)
    return {
        field.target.id: ast.literal_eval(text.value)
        for field, text in zip(tree.body, tree.body[1:], strict=False)
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)
        if isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant) and isinstance(text.value.value, str)
    }


def list_of_arguments(text: str) -> dict[str, str]:
    """Argument -> its entry under "Arguments:", continuation lines included."""
    _, _, block = text.partition("\nArguments:\n")
    block = re.split(r"^\S", block, maxsplit=1, flags=re.MULTILINE)[0]
    entries = list(ENTRY.finditer(block))
    ends = [*(entry.start() for entry in entries[1:]), len(block)][: len(entries)]
    return {name: block[entry.start() : end] for entry, end in zip(entries, ends, strict=True) for name in entry.group("names").split(", ")}


def explanations(public: object) -> dict[str, str]:
    """What is said about each argument and field, by the class itself or by the base that brings the field."""
    if not isinstance(public, type):
        return list_of_arguments(inspect.getdoc(public) or "")
    said: dict[str, str] = {}
    for owner in reversed([owner for owner in public.__mro__ if owner.__module__.startswith("obsdesign")]):
        said |= attribute_docstrings(owner)
    if issubclass(public, BaseModel):
        said |= {name: field.description for name, field in public.model_fields.items() if field.description}
    return list_of_arguments(inspect.getdoc(public) or "") | said


def annotations(public: object) -> dict[str, str]:
    """Argument or field -> its annotation."""
    if is_dataclass(public):
        return {field.name: str(field.type) for field in fields(public)}
    if isinstance(public, type) and issubclass(public, BaseModel):
        return {name: str(field.annotation) for name, field in public.model_fields.items()}
    return {name: str(argument.annotation) for name, argument in inspect.signature(public).parameters.items()}


# a figure is told of as a function is
PUBLIC = {name: getattr(od, name) for name in od.__all__ if not name.startswith("_") and name != "figures"}
PUBLIC |= {f"figures.{name}": getattr(od.figures, name) for name in od.figures.__all__}


@pytest.mark.parametrize("name", PUBLIC)
def test_every_argument_and_field_is_explained(name):
    public = PUBLIC[name]
    summary = (public.__doc__ or "").partition("\n")[0]
    assert summary.endswith(".") or summary.endswith(":")  # a sentence, not what dataclasses write where nothing is said
    if isinstance(public, type) and issubclass(public, Enum | BaseException):
        return
    said, annotated = explanations(public), annotations(public)
    assert [argument for argument in annotated if argument not in said] == []
    arrays = [argument for argument, type_ in annotated.items() if "ArrayLike" in type_ or "ndarray" in type_ or "ca.SX" in type_]
    assert [argument for argument in arrays if annotated[argument] != "Mapping[str, ca.SX]" and not SHAPE.search(said[argument])] == []
    physical = [argument for argument in annotated if PHYSICAL.fullmatch(argument) and not COUNTS.fullmatch(f"{name}.{argument}")]
    assert [argument for argument in physical if not UNIT.search(said[argument])] == []


def test_the_list_of_arguments_names_no_others():
    wrong = {}
    for name, public in PUBLIC.items():
        if callable(public) and not (isinstance(public, type) and issubclass(public, Enum | BaseException)):
            accepted = {*inspect.signature(public).parameters, *annotations(public)}
            wrong[name] = sorted(set(list_of_arguments(inspect.getdoc(public) or "")) - accepted)
    assert {name: extra for name, extra in wrong.items() if extra} == {}


def test_explanations_are_found_and_missing_ones_are_seen():
    text = "Sum.\n\nArguments:\n    x (n,), y: first [m],\n        continued.\n    dt: step [s].\nReturns nothing:\n    z: no argument."
    assert list(list_of_arguments(text)) == ["dt"]
    text = text.replace("x (n,), y:", "x, y (n,):")
    assert {name: entry.count("\n") for name, entry in list_of_arguments(text).items()} == {"x": 2, "y": 2, "dt": 1}
    assert SHAPE.search("(n,)") and SHAPE.search("(N - window + 1, S, n, n)") and SHAPE.search("(..., n)")
    assert not SHAPE.search("(first one)") and not SHAPE.search("()") and not UNIT.search("a number") and UNIT.search("[rad/s]")
    assert "beacon" in explanations(od.Range) and "rate" in explanations(od.GPS)
