"""Formulas: their grammar against values that are computed beside it, their units, what CasADi makes of them."""

from __future__ import annotations

import math
import pickle
from fractions import Fraction

import casadi as ca
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import obsdesign as od
from obsdesign.dynamics.system_text import SystemText, TextLandmark, TextOutput, TextParameter, TextQuantity
from obsdesign.dynamics.text_system import TextSystem
from obsdesign.formulas.casadi_text import formulas_of
from obsdesign.formulas.casadi_value import _EXPRESSIONS, casadi_value, value_of
from obsdesign.formulas.constants import dependence_order, entry_problems, problems_of_constants
from obsdesign.formulas.exact_values import rational_value
from obsdesign.formulas.functions import FUNCTIONS
from obsdesign.formulas.grammar import DEEPEST, parse_formula
from obsdesign.formulas.tree import FormulaError, names_of
from obsdesign.formulas.unit_algebra import NUMBER, define_unit, read_unit
from obsdesign.formulas.unit_check import Wanted, measure
from obsdesign.formulas.writing import write_formula

NAMES = {"x": Fraction(3, 2), "lambda": Fraction(-2), "heading_2": Fraction(1, 3)}


@st.composite
def written(draw: st.DrawFn, depth: int = 4) -> tuple[str, Fraction]:
    """A formula with as many brackets as it needs, or some more, and its value: made side by side, by the laws of fractions."""
    kind = draw(st.sampled_from(["number", "name"] if depth == 0 else ["number", "name", "sum", "product", "power", "minus", "brackets"]))
    if kind == "number":
        text = draw(st.sampled_from(["0", "1", "2.50", ".5", "3e-2", "1.E1", "007"]))
        return text, Fraction(text)
    if kind == "name":
        name = draw(st.sampled_from(sorted(NAMES)))
        return name, NAMES[name]
    inner, value = draw(written(depth - 1))
    if kind == "brackets":
        return f"( {inner})", value
    if kind == "minus":
        return f"-({inner})", -value
    if kind == "power":
        exponent = draw(st.integers(0, 3))
        return f"({inner}){draw(st.sampled_from(['^', '**']))}{exponent}", value**exponent
    other, second = draw(written(depth - 1))
    sign = draw(st.sampled_from("+-" if kind == "sum" else "*/" if second else "*"))
    combined = {"+": value + second, "-": value - second, "*": value * second, "/": value / second if second else 0}[sign]
    return (f"{inner}{sign}({other})" if kind == "sum" else f"({inner}) {sign} ({other})"), Fraction(combined)


@given(written())
def test_a_formula_has_the_value_of_its_parts(pair):
    text, value = pair
    tree = parse_formula(text)
    assert rational_value(tree, NAMES) == value
    assert value_of(tree, NAMES) == value
    symbols = {name: ca.SX.sym(name) for name in NAMES}
    graph = ca.Function("f", list(symbols.values()), [casadi_value(tree, symbols)])
    assert math.isclose(float(graph(*map(float, NAMES.values()))), value, rel_tol=1e-9, abs_tol=1e-6 * max(1, abs(value)))
    assert parse_formula(write_formula(tree)) == tree


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("-2^2", -4),  # a sign binds less strongly than a power
        ("2^3^2", 512),  # powers from the right
        ("2^-1", Fraction(1, 2)),
        ("8/4/2", 1),  # quotients from the left
        ("8/4*2", 4),
        ("1 - 2 - 3", -4),
        ("2*-3", -6),
        ("- - 2", 2),
        ("+2", 2),
        ("0.1 + 0.2", Fraction(3, 10)),  # decimals as they were typed
        ("2**0.5*2**0.5", pytest.approx(2)),
        ("max(1, 2.5, 2) + min(3, -1) + abs(-2)", Fraction(7, 2)),
        ("hypot(3, 4, 12)", pytest.approx(13)),
        ("atan2(1, -1)", pytest.approx(3 * math.pi / 4)),
        ("4*arctan(1) - pi", pytest.approx(0)),
        ("ln(exp(2)) + log10(1000)", pytest.approx(5)),
    ],
)
def test_operators_bind_as_in_mathematics(text, value):
    assert value_of(parse_formula(text), {}) == value
    x = ca.SX.sym("x")  # the same through expressions: every number is x times it, at x = 1
    tree = parse_formula(text)
    assert float(ca.Function("f", [x], [casadi_value(tree, {})])(1.0)) == pytest.approx(float(value_of(tree, {})))


@pytest.mark.parametrize(
    ("text", "column", "words"),
    [
        ("", 1, "a value is missing"),
        ("  x + ", 6, "a value is missing"),
        ("2 x", 3, "an operator is missing before 'x'"),
        ("v*cs(h)", 3, "did you mean 'cos'?"),
        ("x(2)", 1, "products are written with *"),
        ("sin(x, y)", 1, "sin has 2 arguments: takes 1 argument"),
        ("atan2(x)", 1, "atan2 has 1 argument: takes 2 arguments"),
        ("min(x)", 1, "takes 2 or more arguments"),
        ("v*(x + 2", 3, "'(' is not closed by ')'"),
        ("x)", 2, "unexpected ')'"),
        ("x²", 2, "write ^2"),
        ("a·b", 2, "write *"),
        ("x > 2", 3, "says nothing of cases"),
        ("x; y", 2, "unexpected ';'"),
        ("__import__('os')", 12, "unexpected"),
        ("x.real", 3, "must be x, y, z"),
        ("b[-1]", 3, "must be the number of an entry"),
        ("1e200", 1, "must be at most 1e100"),
        ("1" * 61, 1, "more characters"),
        ("(" * (DEEPEST + 2) + "x" + ")" * (DEEPEST + 2), DEEPEST + 2, "within one another"),
        ("-" * 100_000 + "x", 20_000, "must be at most 20000"),
        ("2^" * 5000 + "x", DEEPEST * 2 + 3, "within one another"),
        ("1/(2 - 2)", 1, "has no finite value"),
        ("log(0)", 1, "has no finite value"),
        ("9^9^9^9", 1, "has no finite value"),
        ("(-8)^0.5", 1, "has no finite value"),
    ],
)
def test_what_is_no_formula_is_refused_at_its_character(text, column, words):
    with pytest.raises(FormulaError, match="column") as error:
        value_of(parse_formula(text), {})
    assert error.value.problem.column == column
    assert words in str(error.value)
    assert pickle.loads(pickle.dumps(error.value)).problem == error.value.problem


@given(st.text(st.sampled_from("x1.e^*/+-(),[]sin² \n\t_<λ\x00"), max_size=40))
@settings(max_examples=300)
def test_any_text_is_a_formula_or_is_refused(text):
    try:
        tree = parse_formula(text)
    except FormulaError as error:
        assert 1 <= error.problem.column <= len(text) + 1
    else:
        assert parse_formula(write_formula(tree)) == tree


def test_a_long_sum_is_no_deep_one():
    tree = parse_formula("+".join(["x*2"] * 4000))
    assert value_of(tree, {"x": Fraction(1)}) == 8000
    assert names_of(tree) == ("x",)


def test_every_function_is_one_of_casadi():
    assert set(_EXPRESSIONS) == set(FUNCTIONS)
    x, y = 0.3, 0.7
    for name, function in FUNCTIONS.items():
        arguments = ["x", "y"][: function.fewest]
        tree = parse_formula(f"{name}({', '.join(arguments)})")
        symbols = {"x": ca.SX.sym("x"), "y": ca.SX.sym("y")}
        value = float(ca.Function("f", list(symbols.values()), [casadi_value(tree, symbols)])(x, y))
        assert value == pytest.approx(float(value_of(tree, {"x": x, "y": y})))


# ---------------------------------------------------------------- units


def units_of(**texts: str) -> dict:
    return {name: read_unit(text) if text else None for name, text in texts.items()}


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("N", "kg*m/s^2"),
        ("J", "N*m"),
        ("W", "V*A"),
        ("Hz", "1/s"),
        ("rad/s", "1/s"),
        ("Ohm", "V/A"),
        ("F", "C/V"),
        ("T", "Wb/m^2"),
        ("H", "Wb/A"),
        ("km/h", "m/s"),
        ("l", "dm^3"),
        ("M", "mol/L"),
        ("mm^(1/2)*m^(1/2)", "km"),
        ("min", "s"),
        ("bar", "hPa"),
        ("-", "1"),
    ],
)
def test_units_of_one_dimension(one, other):
    assert read_unit(one).dimension == read_unit(other).dimension


@pytest.mark.parametrize(
    ("unit", "size", "base"),
    [
        ("km/h", 1 / 3.6, "m/s"),
        ("kn", 1852 / 3600, "m/s"),
        ("deg", math.pi / 180, "1"),
        ("rpm", math.pi / 30, "1/s"),
        ("uM/day", 1e-3 / 86400, "mol/m^3/s"),
        ("mmHg", 133.322387415, "Pa"),
        ("g", 1e-3, "kg"),
        ("µm^2", 1e-12, "m^2"),
        ("kHz", 1e3, "1/s"),
        ("ms^-2", 1e6, "1/s^2"),
    ],
)
def test_units_have_their_size(unit, size, base):
    one, other = read_unit(unit), read_unit(base)
    assert one.dimension == other.dimension
    assert math.exp(one.log_size - other.log_size) == pytest.approx(size)


NAMED = st.sampled_from(["m", "s", "km", "h", "kg", "N", "mol", "deg"])
WRITTEN_UNITS = st.lists(st.tuples(NAMED, st.integers(-3, 3)), max_size=4).map(
    lambda pairs: "*".join(["1", *(f"{n}^{p}" for n, p in pairs)])
)


@given(WRITTEN_UNITS, WRITTEN_UNITS, st.fractions(-3, 3, max_denominator=4))
def test_units_form_a_group_with_powers(one, other, exponent):
    a, b = read_unit(one), read_unit(other)
    assert (a * b).agrees(b * a)
    assert (a * b / b).agrees(a)
    assert ((a * b) ** exponent).agrees(a**exponent * b**exponent)
    assert (a / a).powers == ()
    assert read_unit(str(a)).agrees(a)


def test_units_of_ones_own():
    own = {"cell": define_unit("cell", "", {})}
    own["knot"] = define_unit("knot", "0.5144444444444445 m/s", own)
    own["dozen"] = define_unit("dozen", "12 cell", own)
    assert read_unit("knot", own).agrees(read_unit("kn"))
    assert not read_unit("cell/s", own).agrees(read_unit("1/s"))
    assert read_unit("dozen", own).log_size == pytest.approx(math.log(12))
    assert read_unit("yard").agrees(define_unit("step", "0.9144 m", {}))  # of pint
    for text in ("degC", "sone", "m+s", "2*m", "m^x", "m^50", "0 m", ""):
        with pytest.raises(FormulaError):
            define_unit("new", text, own) if text.startswith("0") else read_unit(text, own)


UNITS = units_of(x="m", y="m", v="m/s", heading="rad", w="rad/s", T="K", h="km", d="deg", n="1", free="")


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("v*cos(heading)", "m/s"),
        ("w + v/x", "rad/s"),  # a radian is a number
        ("sqrt((x - 500)^2 + (y - 2)^2)", "m"),  # what is added takes the unit of the others
        ("hypot(x, y, 3)", "m"),
        ("x^3/y^(3/2)", "m^(3/2)"),
        ("max(v, 0)*x", "m^2/s"),
        ("atan2(y, x) - heading", "rad"),
        ("free + x", "m"),
        ("free*x", "s"),  # of what has no unit nothing is known
        ("exp(-x/y)*v", "m/s"),
        ("n^n*T", "K"),
        ("1", "kg"),
        ("pi*x", "m"),
        ("v*x/x", "m/s"),
    ],
)
def test_units_that_fit(text, wanted):
    judged = measure(parse_formula(text), UNITS, Wanted(read_unit(wanted), "here"))
    assert judged.problems == ()


@pytest.mark.parametrize(
    ("text", "wanted", "column", "words"),
    [
        ("v*cos(heading) + x", "m/s", 18, "the term x is in m: must be in m/s, the unit of x per s"),
        ("h/2 + x", "m", 1, "the term h/2 is in km: must be in m, the unit of x per s (1 km is 1000 m)"),
        ("sin(d)", "1", 5, "the term d is in deg: must be a number without a unit, or radians, which sin takes"),
        ("v*exp(x)", "m/s", 7, "the term x is in m: must be a number"),
        ("x^T", "m", 3, "the term T is in K"),
        ("x^n", "m", 1, "x is in m: its exponent must be a number, not n"),
        ("9.81*sin(heading)", "m/s^2", 1, "has no unit: must be in m/s^2, the unit of x per s; a number that has a unit is a parameter"),
        ("x*atan2(y, v)", "m", 12, "the term v is in m/s: must be in m, as y is"),
        ("max(x, v)*n", "m", 8, "the term v is in m/s: must be in m, as x is"),
        ("n*(x + v)", "m", 8, "the term v is in m/s: must be in m, as x is"),
    ],
)
def test_a_term_in_another_unit_is_named(text, wanted, column, words):
    problems = measure(parse_formula(text), UNITS, Wanted(read_unit(wanted), "the unit of x per s")).problems
    assert problems[0].column == column
    assert words in problems[0].message


@given(st.sampled_from([0.1, 7.0]), WRITTEN_UNITS)
def test_a_formula_whose_units_fit_changes_with_its_units_as_its_own_unit_does(scale, unit):
    """Buckingham: x in another unit changes the value by the factor of the formula's unit; here for a unit u of x and 1/u of r."""
    tree, u = parse_formula("sqrt(x^2 + (2*x)^2)/r + x*max(x, 3*x)*x^-1/r"), read_unit(unit)
    judged = measure(tree, {"x": u, "r": NUMBER / u})
    assert judged.problems == () and judged.unit is not None and judged.unit.agrees(u * u)
    before, after = (float(value_of(tree, {"x": 1.3 * s, "r": 0.7 / s})) for s in (1.0, scale))
    assert after == pytest.approx(before * scale**2)


# ---------------------------------------------------------------- expressions as text


@given(written(), st.lists(st.floats(0.5, 2.0), min_size=3, max_size=3))
def test_expressions_are_shown_as_formulas_of_the_same_value(pair, point):
    tree = parse_formula(f"sin({pair[0]}) - x^3/2 + min(x, lambda)*{pair[0]}")
    symbols = {name: ca.SX.sym(name) for name in NAMES}
    column = ca.vertcat(*symbols.values())
    expression = casadi_value(tree, symbols)
    shown = formulas_of(expression, column, list(NAMES))
    if shown is not None:
        value = float(ca.Function("f", [column], [expression])(point))
        again = float(value_of(parse_formula(shown[0]), dict(zip(NAMES, point, strict=True))))
        assert math.isclose(again, value, rel_tol=1e-9, abs_tol=1e-9)


def test_systems_show_their_rates_and_outputs():
    system = od.System(od.Dubins(speed=15.0, wind="constant"), (od.GPS(sigma=2.0), od.Bearing((500.0, 200.0), 0.1)))
    for line in ("x'              15*cos(heading) + wind_x", "heading'        turn_rate", "atan2(200 - y, 500 - x) - heading"):
        assert line in str(system)
    x = ca.SX.sym("x", 2)
    rate = ca.vertcat(x[0] ** 3, ca.if_else(x[0] > 0, 1, 2))  # formulas have no cases: none is shown
    shown = str(od.ControlAffineSystem(x, ("a", "b"), rate, outputs={"y": x[0] - 1}))
    assert "a'" not in shown and "a - 1" in shown


# ---------------------------------------------------------------- names, constants, definitions


def test_constants_without_a_value_are_named_where_they_stand():
    constants = {"a": Fraction(1, 10), "b": Fraction(1, 10)}
    (problem,) = problems_of_constants(parse_formula("x + 1/(a - b)*x"), constants)
    assert (problem.column, problem.message) == (8, "divides, and is 0")
    (problem,) = problems_of_constants(parse_formula("x + log(a - b)*x"), constants)
    assert (problem.column, problem.message) == (5, "has no finite value, whatever the state")
    assert list(problems_of_constants(parse_formula("x/(x - x) + a/3"), constants)) == []
    assert list(problems_of_constants(parse_formula("2*pi*x"), constants)) == []


def test_entries_are_those_of_landmarks():
    assert list(entry_problems(parse_formula("hypot(x - beacon.x, y - beacon[1])"), {"beacon": 2})) == []
    messages = [problem.message for problem in entry_problems(parse_formula("beacon + beacon.z + x.y"), {"beacon": 2})]
    assert messages == [
        "beacon is a landmark: write beacon.x, beacon.y",
        "beacon has 2 entries: there is no entry 2, counted from 0",
        "x has no entries: it is no landmark",
    ]


def test_definitions_come_behind_what_they_need():
    trees = {name: parse_formula(text) for name, text in {"a": "b + c", "b": "c^2", "c": "x"}.items()}
    assert dependence_order(trees) == ("c", "b", "a")
    with pytest.raises(FormulaError, match="goes round in a circle"):
        dependence_order({**trees, "c": parse_formula("a")})


# ---------------------------------------------------------------- the record


def glider(**changes: object) -> TextSystem:
    """Constant airspeed in constant wind, typed as text; beside `od.System(od.Dubins(...), ...)`."""
    record = {
        "states": (
            TextQuantity("x", "m"),
            TextQuantity("y", "m"),
            TextQuantity("heading", "rad"),
            TextQuantity("wind_x", "m/s"),
            TextQuantity("wind_y", "m/s"),
        ),
        "rates": ("v*cos(heading) + wind_x", "v*sin(heading) + wind_y", "turn_rate", "0", "0"),
        "inputs": (TextQuantity("turn_rate", "rad/s"),),
        "parameters": (TextParameter("v", 15.0, "m/s"),),
        "landmarks": (TextLandmark("beacon", (500.0, 200.0)),),
        "definitions": (("east", "beacon.x - x"), ("north", "beacon.y - y")),
        "outputs": (
            TextOutput("gps", ("x", "y"), sigma=2.0),
            TextOutput("range", ("hypot(east, north)",), sigma=1.0, rate=2.0),
            TextOutput("bearing", ("atan2(north, east) - heading",), sigma=0.087),
        ),
        "angles": ("heading", "bearing"),
    }
    return TextSystem(SystemText(**{**record, **changes}))  # pyright: ignore[reportArgumentType]


def test_a_system_of_text_is_the_ready_made_one():
    text = glider()
    sensors = (od.GPS(sigma=2.0), od.Range(beacon=(500.0, 200.0), sigma=1.0, rate=2.0), od.Bearing(beacon=(500.0, 200.0), sigma=0.087))
    ready = od.System(od.Dubins(speed=15.0, wind="constant"), sensors)
    assert text.model.states == ready.model.states
    assert [signal.name for signal in text.model.inputs] == ["turn_rate"]
    assert [(s.unit, s.is_angle) for s in text.model.outputs] == [(s.unit, s.is_angle) for s in ready.model.outputs]
    assert text.model.landmarks == ready.model.landmarks == ((500.0, 200.0),)
    x0 = [3.0, -40.0, 0.4, 2.0, -1.0]
    u = [[0.1], [-0.2], [0.05], [0.3]]
    paths = [od.simulate(system, x0, u, 0.5) for system in (text, ready)]
    assert paths[0].x == pytest.approx(paths[1].x, rel=1e-12)
    gramians = [od.variational_gramian(system, path).total for system, path in zip((text, ready), paths, strict=True)]
    assert gramians[0] == pytest.approx(gramians[1], rel=1e-9, abs=1e-12)
    assert pickle.loads(pickle.dumps(text)) == text and hash(text) == hash(glider())


def test_rates_may_be_told_in_other_units_of_time():
    hourly = glider(
        states=(
            TextQuantity("x", "km"),
            TextQuantity("y", "km"),
            TextQuantity("heading", "rad"),
            TextQuantity("wind_x", "km/h"),
            TextQuantity("wind_y", "km/h"),
        ),
        inputs=(TextQuantity("turn_rate", "rad/h"),),
        parameters=(TextParameter("v", 54.0, "km/h"),),
        landmarks=(TextLandmark("beacon", (0.5, 0.2), "km"),),
        time="h",
    )
    metres = od.simulate(glider(), [3.0, -40.0, 0.4, 2.0, -1.0], [[0.1], [-0.2]], 0.5)
    kilometres = od.simulate(hourly, [0.003, -0.04, 0.4, 7.2, -3.6], [[360.0], [-720.0]], 0.5)
    assert kilometres.x[:, :2] * 1000 == pytest.approx(metres.x[:, :2], rel=1e-9)


def test_a_system_shows_the_text_that_it_was_typed_as():
    shown = str(glider())
    for text in ("v*cos(heading) + wind_x", "hypot(east, north) (sigma 1, 2 Hz)", "beacon.x - x", "turn_rate [rad/s]"):
        assert text in shown


def test_noise_may_be_a_formula():
    system = glider(outputs=(TextOutput("range", ("hypot(east, north)",), sigma="0.5 + 0.01*hypot(east, north)"),))
    model = system.model
    spread = ca.Function("s", [model.x], [model.channels[0].noise.spread])
    assert float(spread([500.0, 100.0, 0.0, 0.0, 0.0])) == pytest.approx(1.5)  # 100 m away
