"""Models in the files of other tools: the scenario that is made of them moves and is seen as the model is."""

from __future__ import annotations

import json
import math
from fractions import Fraction

import numpy as np
import pytest
from conftest import obsdesign
from hypothesis import given, settings
from hypothesis import strategies as st

import obsdesign as od
from obsdesign.formulas.casadi_value import value_of
from obsdesign.formulas.grammar import parse_formula
from obsdesign.formulas.writing import write_formula
from obsdesign.model_import.imported_model import ImportedModel
from obsdesign.model_import.ode_model_text import read_ode_model
from obsdesign.model_import.reading import read_model
from obsdesign.scenario.loading import scenario_from_text

TWO_COMPARTMENTS = """
using StructuralIdentifiability # two compartments, one of them measured
ode = @ODEmodel(
    x1'(t) = -(a01 + a21) * x1(t) + a12 * x2(t) + u(t),
    x2'(t) = a21 * x1(t) - a12 * x2(t), # exchange alone
    y(t) = x1(t)
)
println(assess_identifiability(ode))
"""


def system_of(model: ImportedModel) -> object:
    return scenario_from_text(model.scenario("a file"), "a.toml").system


def test_equations_of_another_tool_are_a_system():
    model = read_ode_model(TWO_COMPARTMENTS, "two.jl")
    assert (model.states, model.inputs, model.constants) == (("x1", "x2"), ("u",), ("a01", "a21", "a12"))
    # Bellman and Astrom 1970: with input and output in one compartment and a leak from it all three rates are identifiable
    assert od.observability(system_of(model)).dimension == 5
    leaks = TWO_COMPARTMENTS.replace("- a12 * x2(t),", "- a12 * x2(t) - a02 * x2(t),")  # a second leak, and one is not
    verdict = od.observability(system_of(read_ode_model(leaks, "two.jl")))
    assert verdict.dimension == 5 and set(verdict.unobservable_states) == {"x2", "a01", "a21", "a12", "a02"}


def test_maps_are_read_and_names_of_functions_are_changed():
    text = "@DDSmodel(x(t + 1) = exp * x(t) + 1//2, y(t) = x(t))"
    model = read_ode_model(text, "map.jl")
    assert model.period == 1.0
    assert model.rates == {"x": "exp_ * x + 1/2"}
    assert model.notes == ("exp is called exp_: formulas know another exp.",)
    assert od.observability(system_of(model)).dimension == 2


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x'(t) = 1", "has no model"),
        ("@ODEmodel(x'(t) = 1, y(t) = x(t)", "bracket is not closed"),
        ("@ODEmodel(x'(t) = 1)", "has 1 states and 0 outputs"),
        ("@ODEmodel(\n x'(t) = 1,\n dx = 2, y(t) = x(t))", "line 3: 'dx = 2' is no equation"),
        ("@ODEmodel(x'(t) = 1,\n x'(t) = 2, y(t) = x(t))", "line 2: x has two equations"),
        ("@ODEmodel(x'(t) = a +, y(t) = x(t))", "line 1: x is 'a +': column 4: the formula ends"),
        ("@ODEmodel(x'(t) = 2x(t), y(t) = x(t))", "an operator is missing before 'x'"),
        ("@ODEmodel(x'(t) = y(t), y(t) = x(t))", "contains the output y"),
        ("@DDSmodel(x'(t) = 1, y(t) = x(t))", "must be x(t + 1) = ..."),
        ("@ODEmodel(x'(t) = t*x(t), y(t) = x(t))", "line 1: x contains t: time by itself is a state"),
        ("@ODEmodel(x'(t) = a*sin(t), y(t) = x(t))", "line 1: x contains sin(t): time by itself is a state"),
        ("@ODEmodel(x'(t) = a*sin(w*t), y(t) = x(t))", "line 1: x contains t: time by itself is a state"),
    ],
)
def test_what_is_no_model_is_refused_with_its_line(text, words):
    with pytest.raises(od.InputError) as error:
        read_ode_model(text, "a.jl")
    assert words in str(error.value) and str(error.value).startswith("a.jl")


@given(st.text(st.sampled_from("xyau'(t)=+-*/,@ODEmodel#\n 12"), max_size=60))
@settings(max_examples=200, deadline=None)
def test_any_text_is_a_model_or_is_refused(text):
    try:
        model = read_ode_model(f"@ODEmodel({text})", "a.jl")
    except od.InputError:
        return
    assert model.states and model.outputs


def test_the_verb_writes_a_scenario_and_leaves_files_alone(tmp_path):
    (tmp_path / "two.jl").write_text(TWO_COMPARTMENTS)
    written = json.loads(obsdesign("import", "two.jl", "--json", folder=tmp_path).stdout)
    assert written["scenario"] == "two.toml" and written["constants"] == ["a01", "a21", "a12"]
    assert obsdesign("check", "two.toml", folder=tmp_path).returncode == 0
    again = obsdesign("import", "two.jl", folder=tmp_path)
    assert again.returncode == 2 and "two.toml is there already" in again.stderr
    for name, words in (("no.jl", "cannot be read"), ("two.csv", "must be SBML")):
        refused = obsdesign("import", name, folder=tmp_path)
        assert refused.returncode == 2 and words in refused.stderr
    with pytest.raises(od.InputError, match="are for SBML"):
        read_model(tmp_path / "two.jl", outputs=("y",))


# ---------------------------------------------------------------- SBML

HEAD = '<?xml version="1.0" encoding="UTF-8"?>\n<sbml xmlns="http://www.sbml.org/sbml/level3/version1/core" level="3" version="1">'
MATH = '<math xmlns="http://www.w3.org/1998/Math/MathML">{}</math>'


def apply(operation: str, *parts: str) -> str:
    """MathML of an operation on names, numbers and other operations."""
    shown = "".join(part if part.startswith("<") else f"<ci>{part}</ci>" for part in parts)
    return f"<apply><{operation}/>{shown}</apply>"


def number(value: float) -> str:
    return f"<cn>{value}</cn>"


def parameter(name: str, value: float | None = None, constant: bool = True) -> str:
    shown = "" if value is None else f' value="{value}"'
    return f'<parameter id="{name}"{shown} constant="{str(constant).lower()}"/>'


def species(name: str, amount: float, boundary: bool = False, only_amount: bool = False) -> str:
    flags = f'boundaryCondition="{str(boundary).lower()}" hasOnlySubstanceUnits="{str(only_amount).lower()}" constant="false"'
    return f'<species id="{name}" compartment="cell" initialAmount="{amount}" {flags}/>'


def reaction(name: str, reactants: dict[str, float], products: dict[str, float], law: str) -> str:
    def side(tag: str, amounts: dict[str, float]) -> str:
        rows = "".join(f'<speciesReference species="{s}" stoichiometry="{n}" constant="true"/>' for s, n in amounts.items())
        return f"<{tag}>{rows}</{tag}>" if rows else ""

    inside = f"{side('listOfReactants', reactants)}{side('listOfProducts', products)}<kineticLaw>{MATH.format(law)}</kineticLaw>"
    return f'<reaction id="{name}" reversible="false" fast="false">{inside}</reaction>'


def sbml(species_rows: str, parameters: str, reactions: str = "", rules: str = "", more: str = "", size: float = 2.0) -> str:
    lists = {"Compartments": f'<compartment id="cell" size="{size}" spatialDimensions="3" constant="true"/>', "Species": species_rows}
    lists |= {"Parameters": parameters, "Rules": rules, "Reactions": reactions}
    body = "".join(f"<listOf{name}>{rows}</listOf{name}>" for name, rows in lists.items() if rows)
    return f'{HEAD}<model id="made">{body}{more}</model></sbml>'


LAW = apply("times", "k", "A", "cell")  # per concentration, in amounts per time
DECAY = sbml(species("A", 6.0) + species("B", 0.0), parameter("k", 0.7), reaction("R1", {"A": 1}, {"B": 2}, LAW))


@pytest.fixture
def read_sbml():
    pytest.importorskip("libsbml")
    from obsdesign.model_import.sbml_model import read_sbml as reader

    return lambda text, outputs=(), estimate=(): reader(text, "made.xml", outputs, estimate)


def test_reactions_move_species(read_sbml):
    """A -> 2 B of the law k A cell: A decays as exp(-k t), B grows by twice as much."""
    model = read_sbml(DECAY, ("B",))
    assert model.start == {"A": 3.0, "B": 0.0}  # concentrations in a cell of size 2
    system = system_of(model)
    path = od.simulate(system, [3.0, 0.0], np.zeros((8, 0)), 0.25, tolerance=1e-10)
    t = 0.25 * np.arange(9)
    assert path.x[:, 0] == pytest.approx(3 * np.exp(-0.7 * t), rel=1e-8)
    assert path.x[:, 1] == pytest.approx(6 * (1 - np.exp(-0.7 * t)), rel=1e-8, abs=1e-9)
    assert od.observability(system).dimension == 2
    estimated = read_sbml(DECAY, ("A",), ("k",))
    assert estimated.constants == ("k",)
    assert od.observability(system_of(estimated)).observable_states == ("A", "k")  # nothing tells of B


def test_rules_amounts_boundaries_and_time(read_sbml):
    rules = (
        f'<assignmentRule variable="total">{MATH.format(apply("plus", "A", "B"))}</assignmentRule>'
        f'<rateRule variable="g">{MATH.format(apply("minus", apply("times", "g", TIME)))}</rateRule>'
    )
    parameters = parameter("k", 0.5) + parameter("total", constant=False) + parameter("g", 2.0, constant=False) + parameter("free")
    law = apply("times", "k", "A", apply("exp", apply("minus", "free")))
    text = sbml(
        species("A", 4.0, boundary=True) + species("B", 1.0, only_amount=True), parameters, reaction("R1", {"A": 1}, {"B": 1}, law), rules
    )
    model = read_sbml(text, ("total", "g"))
    assert model.states == ("g", "B", "time")  # A is held from outside
    assert model.rates == {"g": "-g*time", "B": "R1", "time": "1"}
    assert model.definitions == {"total": "A + B", "R1": "k*A*exp(-free)"}
    assert (model.parameters, model.constants) == ({"k": 0.5, "A": 2.0}, ("free",))
    assert od.observability(system_of(model)).dimension == 4  # g tells time; B's growth tells what is free


TIME = '<csymbol encoding="text" definitionURL="http://www.sbml.org/sbml/symbols/time">t</csymbol>'
EVENT = (
    '<listOfEvents><event useValuesFromTriggerTime="true"><trigger initialValue="false" persistent="true">'
    f"{MATH.format('<true/>')}</trigger></event></listOfEvents>"
)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<sbml>", "is no SBML that can be read"),
        ("no xml", "is no SBML that can be read"),
        ('<!DOCTYPE x [<!ENTITY a "b">]><sbml/>', "has a document type of its own"),
        (DECAY.replace("</model>", EVENT + "</model>"), "has 1 events"),
        (sbml(species("A", 1.0), parameter("k", 1.0)), "has nothing that changes"),
        (
            sbml(species("A", 1.0), parameter("k", 1.0), reaction("R", {"A": 1}, {}, apply("floor", "A"))),
            "the reaction R contains 'floor(A)', which formulas do not have",
        ),
        (
            sbml(species("A", 1.0), "", "", f"<algebraicRule>{MATH.format(apply('minus', 'A'))}</algebraicRule>"),
            "has an algebraic rule",
        ),
        (
            sbml(species("A", 1.0), "", "", f'<rateRule variable="cell">{MATH.format(number(1))}</rateRule>'),
            "the compartment cell changes its size",
        ),
    ],
)
def test_what_formulas_do_not_have_is_refused_by_name(read_sbml, text, words):
    with pytest.raises(od.InputError) as error:
        read_sbml(text)
    assert words in str(error.value) and str(error.value).startswith("made.xml: ")


def test_names_that_are_chosen_must_be_there(read_sbml):
    for outputs, estimate, words in ((("C",), (), "--outputs: there is no 'C'"), ((), ("q",), "--estimate: there is no 'q'")):
        with pytest.raises(od.InputError, match=words):
            read_sbml(DECAY, outputs, estimate)


OPERATIONS = {
    "plus": lambda *a: sum(a, Fraction(0)),
    "times": lambda *a: math.prod(a, start=Fraction(1)),
    "minus": lambda a, *b: a - b[0] if b else -a,
    "divide": lambda a, b: a / b,
}


@st.composite
def mathematics(draw: st.DrawFn, depth: int = 4) -> tuple[str, Fraction]:
    """MathML, and its value."""
    if depth == 0 or draw(st.booleans()):
        value = draw(st.sampled_from([2, 5, -3]))
        return number(value), Fraction(value)
    name = draw(st.sampled_from([*OPERATIONS, "power"]))
    if name == "power":
        base, value = draw(mathematics(depth - 1))
        exponent = draw(st.integers(0, 3))
        return apply("power", base, number(exponent)), value**exponent
    count = {"divide": 2, "minus": draw(st.integers(1, 2))}.get(name, draw(st.integers(0, 3)))
    parts = [draw(mathematics(depth - 1)) for _ in range(count)]
    if name == "divide" and parts[1][1] == 0:
        parts[1] = (number(2), Fraction(2))
    value = OPERATIONS[name](*(value for _, value in parts))
    return apply(name, *(text for text, _ in parts)), Fraction(value)


@given(mathematics())
@settings(max_examples=100, deadline=None)
def test_mathematics_has_its_value(pair):
    """Brackets, signs, sums of none and of many: the text that is written has the value of the operations."""
    libsbml = pytest.importorskip("libsbml")
    from obsdesign.model_import.sbml_formula import tree_of

    text, value = pair
    tree = tree_of(libsbml.readMathMLFromString(MATH.format(text)), {})
    assert value_of(parse_formula(write_formula(tree)), {}) == value
