"""Whether the units of a formula fit together: which term is in another unit than it must be in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction

from obsdesign.formulas.exact_values import rational_value
from obsdesign.formulas.functions import FUNCTIONS, PI, Units
from obsdesign.formulas.tree import AbstractTree, Call, FormulaProblem, Name, Power, Product, Sum, is_number
from obsdesign.formulas.unit_algebra import NUMBER, RADIAN, Unit, difference_text
from obsdesign.formulas.writing import write_formula

_HALF = Fraction(1, 2)


@dataclass(frozen=True)
class Wanted:
    """The unit that a term must have, and whose it is, in words."""

    unit: Unit
    whose: str


@dataclass(frozen=True)
class Measure:
    """The unit of a formula, None where it is not known or whatever is wanted; and what is wrong with the units in it."""

    unit: Unit | None
    problems: tuple[FormulaProblem, ...] = ()


def measure(tree: AbstractTree, units: Mapping[str, Unit | None], wanted: Wanted | None = None) -> Measure:
    """Return the unit of a formula, and the terms of it whose units do not fit.

    units: of each name, None where it is not known, which fits everywhere. A number that is added takes the unit of what it is added to;
    one that multiplies is a number.
    """
    if is_number(tree):
        return Measure(None if wanted is None else wanted.unit)
    match tree:
        case Sum():
            return _measure_alike(tree.terms, units, wanted)
        case Call() if FUNCTIONS[tree.function].units is Units.SAME:
            return _measure_alike(tree.arguments, units, wanted)
        case Call():
            judged = _measure_call(tree, units)
        case Product():
            judged = _measure_product(tree, units)
        case Power():
            judged = _measure_power(tree, units)
        case Name():
            judged = Measure(NUMBER if tree.name == PI else units.get(tree.name))
        case _:
            judged = Measure(None)
    return _compare(tree, judged, wanted)


def _compare(tree: AbstractTree, judged: Measure, wanted: Wanted | None) -> Measure:
    """The measure, with a problem more where it is in another unit than is wanted."""
    if wanted is None or judged.unit is None or judged.unit.agrees(wanted.unit):
        return judged
    has = f"is in {judged.unit}" if judged.unit.powers else "has no unit"
    accepted = f"in {wanted.unit}" if wanted.unit.powers else "a number without a unit, or radians"
    hint = "" if judged.unit.powers else "; a number that has a unit is a parameter"
    message = f"the term {_short(tree)} {has}: must be {accepted}, {wanted.whose}{difference_text(judged.unit, wanted.unit)}{hint}"
    return Measure(wanted.unit, (*judged.problems, FormulaProblem(tree.column, message, (str(wanted.unit),))))


def _measure_alike(terms: tuple[AbstractTree, ...], units: Mapping[str, Unit | None], wanted: Wanted | None) -> Measure:
    """The measure of terms that must be in one unit: the one that is wanted, or that of the first that has one."""
    problems: list[FormulaProblem] = []
    for term in terms:
        judged = measure(term, units, wanted)
        problems += judged.problems
        if wanted is None and judged.unit is not None:
            wanted = Wanted(judged.unit, f"as {_short(term)} is")
    return Measure(None if wanted is None else wanted.unit, tuple(problems))


def _measure_call(tree: Call, units: Mapping[str, Unit | None]) -> Measure:
    rule, taken = FUNCTIONS[tree.function].units, Wanted(NUMBER, f"which {tree.function} takes")
    if rule is Units.ROOT:
        inside = measure(tree.arguments[0], units)
        return Measure(None if inside.unit is None else inside.unit**_HALF, inside.problems)
    if rule is Units.RATIO_TO_ANGLE:
        return Measure(RADIAN, _measure_alike(tree.arguments, units, None).problems)
    unit = RADIAN if rule is Units.TO_ANGLE else NUMBER
    return Measure(unit, tuple(problem for argument in tree.arguments for problem in measure(argument, units, taken).problems))


def _measure_product(tree: Product, units: Mapping[str, Unit | None]) -> Measure:
    unit: Unit | None = NUMBER
    problems: list[FormulaProblem] = []
    for factor, divides in zip(tree.factors, tree.is_divisor, strict=True):
        judged = Measure(NUMBER) if is_number(factor) else measure(factor, units)
        problems += judged.problems
        if unit is not None:
            unit = None if judged.unit is None else unit / judged.unit if divides else unit * judged.unit
    return Measure(unit, tuple(problems))


def _measure_power(tree: Power, units: Mapping[str, Unit | None]) -> Measure:
    base = Measure(NUMBER) if is_number(tree.base) else measure(tree.base, units)
    above = measure(tree.exponent, units, Wanted(NUMBER, "which an exponent is"))
    problems = (*base.problems, *above.problems)
    if base.unit is None or base.unit.agrees(NUMBER):
        return Measure(base.unit, problems)
    exponent = rational_value(tree.exponent)
    if exponent is None:
        message = f"{_short(tree.base)} is in {base.unit}: its exponent must be a number, not {_short(tree.exponent)}"
        return Measure(None, (*problems, FormulaProblem(tree.column, message)))
    return Measure(base.unit**exponent, problems)


def _short(tree: AbstractTree) -> str:
    text = write_formula(tree)
    return text if len(text) <= 40 else f"{text[:37]}..."
