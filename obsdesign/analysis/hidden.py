"""The hidden directions in words."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from obsdesign.model import Model
from obsdesign.sensors.abstract import Point
from obsdesign.signals import Signal

_ROUND_OFF = 1e-9


def hidden_in_words(model: Model, null_space: np.ndarray, at: np.ndarray) -> str:
    """Say which changes of the state change no output: of states alone, rotations about a landmark, combinations.

    null_space (n, d): basis of the hidden directions at the state `at` (n,), with a row of zeros for every state that is seen.
    """
    basis = _sparse_basis(null_space, model.states)
    alone = [model.states[pivot].name for pivot, v in basis.items() if np.count_nonzero(v) == 1]
    combined = {pivot: v for pivot, v in basis.items() if np.count_nonzero(v) > 1}
    sentences = [f"{', '.join(alone)} {'is' if len(alone) == 1 else 'are'} not seen at all"] if alone else []
    for landmark in model.landmarks:
        rotation = _rotation(landmark, model.state_names, at)
        turning = [pivot for pivot in combined if rotation[pivot]] if _spans(basis, rotation) else []
        if turning:
            del combined[turning[0]]
            moved = ", ".join(name for name, entry in zip(model.state_names, rotation, strict=True) if entry)
            sentences.append(f"rotation of everything about the beacon at ({landmark[0]:g}, {landmark[1]:g}) m: {moved} turn together")
    sentences += [_trade_off(pivot, v, model.states) for pivot, v in combined.items()]
    return "; ".join(sentences) or "nothing is hidden"


def _sparse_basis(null_space: np.ndarray, states: tuple[Signal, ...]) -> dict[int, np.ndarray]:
    """Return {pivot: v (n,)}, the reduced row echelon form of null_space' with v[pivot] = 1; angles are pivots first."""
    largest = np.abs(null_space).max(axis=1, initial=0.0)
    scale = np.where(largest > 0, largest, 1.0)
    rows = list((null_space / scale[:, None]).T)
    basis: dict[int, np.ndarray] = {}
    for column in sorted(range(len(states)), key=lambda i: not states[i].is_angle):
        best = max(range(len(rows)), key=lambda k: abs(rows[k][column]), default=None)
        if best is None or abs(rows[best][column]) < _ROUND_OFF:
            continue
        unit = rows[best] / rows[best][column]
        rows = [row - row[column] * unit for k, row in enumerate(rows) if k != best]
        basis = {pivot: v - v[column] * unit for pivot, v in basis.items()} | {column: unit}
    return {pivot: np.where(np.abs(v) > _ROUND_OFF, v, 0.0) * scale / scale[pivot] for pivot, v in basis.items()}


def _rotation(landmark: Point, names: tuple[str, ...], at: np.ndarray) -> np.ndarray:
    """Return (-(y - b_y), x - b_x, 1, -wind_y, wind_x), by name (n,): the state's rate while all turns about b at 1 rad/s."""
    value = dict(zip(names, at, strict=True))
    rates = {"heading": 1.0}
    for first, second, centre in (("x", "y", landmark), ("wind_x", "wind_y", (0.0, 0.0))):
        if first in value and second in value:
            rates |= {first: centre[1] - value[second], second: value[first] - centre[0]}
    return np.array([rates.get(name, 0.0) for name in names])


def _spans(basis: Mapping[int, np.ndarray], direction: np.ndarray) -> bool:
    """Return whether the direction (n,) is a combination of the basis, which has v[pivot] = 1."""
    parts = np.array([direction[pivot] * v for pivot, v in basis.items()]).reshape(-1, len(direction))
    return bool(np.all(np.abs(parts.sum(axis=0) - direction) <= _ROUND_OFF * (np.abs(parts).sum(axis=0) + np.abs(direction))))


def _trade_off(pivot: int, v: np.ndarray, states: tuple[Signal, ...]) -> str:
    """Say what the others must do so that a change of state `pivot` stays unseen along v (n,), v[pivot] = 1."""
    others = [i for i in np.flatnonzero(v) if i != pivot]
    step = 1.0 / _shown(states[pivot])[0]
    amounts = " and ".join(_amount(v[i] * step, states[i]) for i in others)
    names = ", ".join(states[i].name for i in others)
    change = f"{_amount(step, states[pivot])} with {amounts}"
    return f"{states[pivot].name} cannot be told from {names}: {change} changes no output (to first order)"


def _amount(value: float, signal: Signal) -> str:
    factor, unit = _shown(signal)
    return f"{value * factor:+.3g} {unit} of {signal.name}".replace("  ", " ")


def _shown(signal: Signal) -> tuple[float, str]:
    """Return (factor, unit) in which people read the signal: angles in degrees."""
    return (180 / np.pi, "deg") if signal.is_angle else (1.0, signal.unit)
