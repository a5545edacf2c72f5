"""The hidden directions in words."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from obsdesign.analysis.sparse_directions import Direction, Hidden
from obsdesign.dynamics.model import Model
from obsdesign.signals import Signal

_TO_FIRST_ORDER = " (to first order)"


def hidden_in_words(model: Model, null_space: np.ndarray, at: np.ndarray, *, chosen: bool = True, singular: bool = False) -> str:
    """Say which changes of the state change no output: of states alone, common shifts, rotations, scales, combinations.

    null_space (n, d): basis of the hidden directions at the state `at` (n,), every entry to double precision relative to itself, with
    a row of zeros for every state that is seen;
    chosen: that state was asked for, so that proportions which hold there are given; singular: more is seen around it, so that
    nothing is hidden but to first order.
    """
    basis = Hidden(null_space, model.states, at, model.landmarks).basis()
    alone = [model.states[int(np.flatnonzero(each.vector)[0])].name for each in basis if each.kind == "alone"]
    order = sorted(alone, key=model.state_names.index)
    tail = _TO_FIRST_ORDER if singular else ""
    sentences = [f"{', '.join(order)} {'is' if len(order) == 1 else 'are'} not seen at all{tail}"] if order else []
    sentences += [_sentence(each, model.states, tail, chosen=chosen) for each in basis if each.kind != "alone"]
    return "; ".join(sentences) or "nothing is hidden"


def _sentence(direction: Direction, states: tuple[Signal, ...], tail: str, *, chosen: bool) -> str:
    moved = ", ".join(states[i].name for i in direction.moved)
    about = f"the beacon at ({direction.centre[0]:g}, {direction.centre[1]:g}) m" if direction.centre else "the origin"
    if direction.kind == "rotation":
        return f"rotation of everything about {about}: {moved} turn together{tail}"
    if direction.kind == "scale":
        return f"scale of everything about {about}: {moved} grow together in proportion{tail}"
    if direction.kind == "shift":
        return f"a common shift of {moved}: the same change of all of them changes no output{tail}"
    return _trade_off(direction.vector, states, chosen=chosen)


def _trade_off(vector: np.ndarray, states: tuple[Signal, ...], *, chosen: bool) -> str:
    """Say what the others must do so that a change of one state stays unseen along the vector (n,)."""
    moved = [int(i) for i in np.flatnonzero(vector)]
    pivot = min(moved, key=lambda i: (not states[i].is_angle, i))
    v = vector / vector[pivot]
    others = [i for i in moved if i != pivot]
    names = ", ".join(states[i].name for i in others)
    if not chosen and not all(_is_short(v[i]) for i in others):
        change = "together, in proportions that may differ from state to state, they change without a change of any output"
        return f"{states[pivot].name} cannot be told from {names}: {change}{_TO_FIRST_ORDER}"
    step = 1.0 / _shown(states[pivot])[0]
    amounts = " and ".join(_amount(v[i] * step, states[i]) for i in others)
    change = f"{_amount(step, states[pivot])} with {amounts}"
    return f"{states[pivot].name} cannot be told from {names}: {change} changes no output{_TO_FIRST_ORDER}"


def _is_short(value: float) -> bool:
    """Return whether a proportion is a short fraction: one that depends on a random state is none."""
    near = Fraction(value).limit_denominator(1000)
    return abs(near.numerator) < 10**5 and abs(float(near) - value) <= 1e-11 * abs(value)


def _amount(value: float, signal: Signal) -> str:
    factor, unit = _shown(signal)
    return f"{value * factor:+.3g} {unit} of {signal.name}".replace("  ", " ")


def _shown(signal: Signal) -> tuple[float, str]:
    """Return (factor, unit) in which people read the signal: angles in degrees."""
    return (180 / np.pi, "deg") if signal.is_angle else (1.0, signal.unit)
