"""The hidden directions in words."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from obsdesign.analysis.sparse_directions import Direction, HiddenSpace
from obsdesign.dynamics.model import Model
from obsdesign.signals import Signal

_TO_FIRST_ORDER = " (to first order)"


def hidden_in_words(model: Model, null_space: np.ndarray, at: np.ndarray, *, is_given_point: bool = True, is_singular: bool = False) -> str:
    """Say which changes of the state change no output: of states alone, common shifts, rotations, scales, combinations.

    null_space (n, d): basis of the hidden directions at the state `at` (n,), every entry to double precision relative to itself, with
    a row of zeros for every state that is seen;
    is_given_point: that state was asked for, so that proportions which hold there are given; is_singular: more is seen around it, so that
    nothing is hidden but to first order.
    """
    basis = HiddenSpace(null_space, model.states, at, model.landmarks).spanning_directions()
    alone = [model.states[int(np.flatnonzero(direction.vector)[0])].name for direction in basis if direction.kind == "alone"]
    names = sorted(alone, key=model.state_names.index)
    suffix = _TO_FIRST_ORDER if is_singular else ""
    sentences = [f"{', '.join(names)} {'is' if len(names) == 1 else 'are'} not seen at all{suffix}"] if names else []
    sentences += [
        _sentence(direction, model.states, suffix, is_given_point=is_given_point) for direction in basis if direction.kind != "alone"
    ]
    return "; ".join(sentences) or "nothing is hidden"


def _sentence(direction: Direction, states: tuple[Signal, ...], suffix: str, *, is_given_point: bool) -> str:
    changed = ", ".join(states[i].name for i in direction.states_that_change)
    about = f"the beacon at ({direction.centre[0]:g}, {direction.centre[1]:g}) m" if direction.centre else "the origin"
    if direction.kind == "rotation":
        return f"rotation of everything about {about}: {changed} turn together{suffix}"
    if direction.kind == "scale":
        return f"scale of everything about {about}: {changed} grow together in proportion{suffix}"
    if direction.kind == "shift":
        return f"a common shift of {changed}: the same change of all of them changes no output{suffix}"
    return _trade_off(direction.vector, states, is_given_point=is_given_point)


def _trade_off(vector: np.ndarray, states: tuple[Signal, ...], *, is_given_point: bool) -> str:
    """Say what the others must do so that a change of one state stays unseen along the vector (n,)."""
    changed = [int(i) for i in np.flatnonzero(vector)]
    pivot = min(changed, key=lambda i: (not states[i].is_angle, i))
    v = vector / vector[pivot]
    others = [i for i in changed if i != pivot]
    names = ", ".join(states[i].name for i in others)
    if not is_given_point and not all(_is_short_fraction(v[i]) for i in others):
        change = "together, in proportions that may differ from state to state, they change without a change of any output"
        return f"{states[pivot].name} cannot be told from {names}: {change}{_TO_FIRST_ORDER}"
    step = 1.0 / _display_unit(states[pivot])[0]
    amounts = " and ".join(_amount(v[i] * step, states[i]) for i in others)
    change = f"{_amount(step, states[pivot])} with {amounts}"
    return f"{states[pivot].name} cannot be told from {names}: {change} changes no output{_TO_FIRST_ORDER}"


def _is_short_fraction(value: float) -> bool:
    """Return whether a proportion is a short fraction: one that depends on a random state is none."""
    fraction = Fraction(value).limit_denominator(1000)
    return abs(fraction.numerator) < 10**5 and abs(float(fraction) - value) <= 1e-11 * abs(value)


def _amount(value: float, signal: Signal) -> str:
    factor, unit = _display_unit(signal)
    return f"{value * factor:+.3g} {unit} of {signal.name}".replace("  ", " ")


def _display_unit(signal: Signal) -> tuple[float, str]:
    """Return (factor, unit) in which people read the signal: angles in degrees."""
    return signal.display_unit if signal.is_angle else (1.0, signal.unit)
