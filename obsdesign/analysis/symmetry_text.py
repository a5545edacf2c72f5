"""Symmetries in words: what changes together, and what of it shows in the outputs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction

import numpy as np

from obsdesign.analysis.symmetry import Symmetry, SymmetryKind
from obsdesign.dynamics.model import Model
from obsdesign.signals import Signal

_LONGEST_DENOMINATOR = 10_000  # of a component, as they are searched for; their ratios may have longer ones
_ROUND_OFF = 1e-9
_LONGEST_FIELD = 60  # characters of the components of a vector field


def symmetry_sentences(symmetries: Sequence[Symmetry], model: Model, at: np.ndarray, *, is_given_point: bool) -> list[str]:
    """Return a sentence for each symmetry but for states by themselves, which make one together."""
    words: Mapping[SymmetryKind, Callable[[Symmetry], str]] = {
        SymmetryKind.SHIFT: _shift,
        SymmetryKind.ROTATION: lambda symmetry: (
            f"rotation of everything about {_centre(symmetry, model)}: {_names(symmetry)} turn together"
        ),
        SymmetryKind.SCALE: lambda symmetry: (
            f"scale of everything about {_centre(symmetry, model)}: {_names(symmetry)} grow together in proportion"
        ),
        SymmetryKind.SUM: lambda symmetry: _sum(symmetry, model.states),
        SymmetryKind.PRODUCT: _product,
        SymmetryKind.FORCING: lambda symmetry: _forcing(symmetry, model.states, is_given_point=is_given_point),
        SymmetryKind.MOTION: _motion,
        SymmetryKind.LINEAR: lambda symmetry: _linear(symmetry, model.states),
    }
    return [words[symmetry.kind](symmetry) for symmetry in symmetries if symmetry.kind in words]


def _names(symmetry: Symmetry) -> str:
    return ", ".join(symmetry.states)


def _centre(symmetry: Symmetry, model: Model) -> str:
    """Say what stays where it is: the landmark or point (x, y), the origin, or of which states it is made."""
    if symmetry.A is None or symmetry.b is None:
        return "a point that depends on other states"
    rows, fixed = _fixed_point(symmetry.A, symmetry.b)
    constants, values = fixed[:, -1], (0.0, *(symmetry.centre or ()))
    is_plain = not fixed[:, :-1].any() and all(min(abs(constant - value) for value in values) <= _ROUND_OFF for constant in constants)
    if not is_plain:
        names = [state.name for state in model.states]
        return f"the point {', '.join(f'{names[i]} = {_affine_sum(row, names) or 0}' for i, row in zip(rows, fixed, strict=True))}"
    if symmetry.centre is None:
        return "the origin"
    point = f"({symmetry.centre[0]:g}, {symmetry.centre[1]:g}) m"
    is_landmark = any(np.allclose(symmetry.centre, landmark, rtol=1e-9) for landmark in model.landmarks)
    return f"the beacon at {point}" if is_landmark else point


def _fixed_point(A: np.ndarray, b: np.ndarray) -> tuple[list[int], np.ndarray]:
    """Return the r states that A x + b changes in proportion to states, and where it leaves them, C (x, 1) with C (r, n + 1)."""
    rows = [int(i) for i in np.flatnonzero(A.any(axis=1))]
    rest = np.column_stack([A[rows], b[rows]])
    rest[:, rows] = 0.0
    fixed = -np.linalg.pinv(A[np.ix_(rows, rows)]) @ rest
    return rows, np.where(np.abs(fixed) > _ROUND_OFF * (1.0 + np.abs(fixed).max(initial=0.0)), fixed, 0.0)


def _shift(symmetry: Symmetry) -> str:
    return f"a common shift of {_names(symmetry)}: the same change of all of them changes no output"


def _sum(symmetry: Symmetry, states: Sequence[Signal]) -> str:
    """Two constants: what shows of them is the combination that does not change; more: what they do together."""
    sentence = trade_off(symmetry.vector, states, is_given_point=True)
    if len(symmetry.states) != 2:
        return sentence
    first, second = symmetry.states
    weights = [symmetry.vector[[state.name for state in states].index(name)] for name in (first, second)]
    ratio = -_fraction(weights[0]) / _fraction(weights[1])
    sign = "+" if ratio > 0 else "-"
    factor = "" if abs(ratio) == 1 else f"{abs(ratio)} "
    return f"{sentence}, only {first} {sign} {factor}{second} shows"


def _product(symmetry: Symmetry) -> str:
    """What is multiplied by powers of one number; of two factors what shows is the product of powers that does not change."""
    powers = _powers(symmetry)
    first, *others = symmetry.states
    groups = {
        power: ", ".join(name for name in symmetry.states if powers[name] == power)
        for power in dict.fromkeys(powers[name] for name in symmetry.states)
    }
    change = " with ".join(f"{names} times {_power('k', power)}" for power, names in groups.items())
    sentence = f"{first} cannot be told from {', '.join(others)}: {change} changes no output"
    if len(others) > 1:
        return sentence
    ratio = -powers[first] / powers[others[0]]
    operator, exponent = ("*", ratio) if ratio > 0 else ("/", -ratio)
    return f"{sentence}, only {first} {operator} {_power(others[0], exponent)} shows"


def _powers(symmetry: Symmetry) -> dict[str, Fraction]:
    """Return the power of the factor by which each state is multiplied, the first of them once."""
    diagonal = np.diag(symmetry.A) if symmetry.A is not None else np.zeros(0)
    values = [value for value in diagonal if value]
    return {name: _fraction(value) / _fraction(values[0]) for name, value in zip(symmetry.states, values, strict=True)}


def _power(name: str, exponent: Fraction) -> str:
    if exponent == 1:
        return name
    return f"{name}^{exponent}" if exponent.denominator == 1 and exponent > 0 else f"{name}^({exponent})"


def _fraction(value: float) -> Fraction:
    return Fraction(float(value)).limit_denominator(_LONGEST_DENOMINATOR)


def _forcing(symmetry: Symmetry, states: Sequence[Signal], *, is_given_point: bool) -> str:
    first, *forcing = symmetry.states
    names = ", ".join(forcing)
    amounts = f", such as {_amounts(symmetry.vector, states, first)}" if is_given_point else ""
    return f"{first} cannot be told from {names}: in the rates of all states {names} can make up for it{amounts}, and no output changes"


def _motion(symmetry: Symmetry) -> str:
    cause = {"drift": "as without inputs", "known input": "as under a known input", "unknown input": "as under an unknown input"}
    return f"a shift along the motion: {_names(symmetry)} move on together, {cause[symmetry.motion]}, and no output changes"


def _linear(symmetry: Symmetry, states: Sequence[Signal]) -> str:
    """Say along which field the states change, where that is short."""
    first, *others = symmetry.states
    names = [state.name for state in states]
    rates = [_affine(symmetry, names.index(name), names) for name in symmetry.states]
    field = f" along ({', '.join(rates)})" if sum(map(len, rates)) <= _LONGEST_FIELD else ", linearly in the state"
    return f"{first} cannot be told from {', '.join(others)}: they change together{field}, and no output changes"


def _affine(symmetry: Symmetry, i: int, names: Sequence[str]) -> str:
    """Return row i of A x + b in words."""
    if symmetry.A is None or symmetry.b is None:
        return ""
    return _affine_sum(np.append(symmetry.A[i], symmetry.b[i]), names)


def _affine_sum(row: np.ndarray, names: Sequence[str]) -> str:
    """Return row (x, 1) in words, row (n + 1,)."""
    terms = [(float(value), name) for value, name in zip(row, [*names, ""], strict=True) if value]
    text = " ".join(f"{'-' if value < 0 else '+'} {_term(abs(float(value)), name)}" for value, name in terms)
    return text.removeprefix("+ ").replace("- ", "-", 1) if text.startswith("-") else text.removeprefix("+ ")


def _term(value: float, name: str) -> str:
    factor = f"{_fraction(value)}" if _is_short_fraction(value) else f"{value:.4g}"
    return factor if not name else name if factor == "1" else f"{factor} {name}"


# ---------------------------------------------------------------- amounts


def trade_off(vector: np.ndarray, states: Sequence[Signal], *, is_given_point: bool) -> str:
    """Say what the others must do so that a change of one state stays unseen along the vector (n,)."""
    changed = [int(i) for i in np.flatnonzero(vector)]
    pivot = min(changed, key=lambda i: (not states[i].is_angle, i))
    others = [i for i in changed if i != pivot]
    names = ", ".join(states[i].name for i in others)
    if not is_given_point and not all(_is_short_fraction(vector[i] / vector[pivot]) for i in others):
        change = "together, in proportions that may differ from state to state, they change without a change of any output"
        return f"{states[pivot].name} cannot be told from {names}: {change}"
    return f"{states[pivot].name} cannot be told from {names}: {_amounts(vector, states, states[pivot].name)} changes no output"


def _amounts(vector: np.ndarray, states: Sequence[Signal], first: str) -> str:
    """Say how much the others change where the first changes by one."""
    pivot = next(i for i, state in enumerate(states) if state.name == first)
    step = 1.0 / _display_unit(states[pivot])[0]
    amounts = " and ".join(amount(vector[i] / vector[pivot] * step, states[i]) for i in map(int, np.flatnonzero(vector)) if i != pivot)
    return f"{amount(step, states[pivot])} with {amounts}"


def _is_short_fraction(value: float) -> bool:
    """Return whether a proportion is a short fraction: one that depends on a random state is none."""
    fraction = Fraction(float(value)).limit_denominator(1000)
    return abs(fraction.numerator) < 10**5 and abs(float(fraction) - value) <= 1e-11 * abs(value)


def amount(value: float, signal: Signal) -> str:
    """Return a change of a signal in words."""
    factor, unit = _display_unit(signal)
    return f"{value * factor:+.3g} {unit} of {signal.name}".replace("  ", " ")


def _display_unit(signal: Signal) -> tuple[float, str]:
    """Return (factor, unit) in which people read the signal: angles in degrees."""
    return signal.display_unit if signal.is_angle else (1.0, signal.unit)
