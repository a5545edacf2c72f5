"""The hidden directions in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from obsdesign.analysis.sparse_directions import spanning_directions
from obsdesign.analysis.symmetry import Symmetry, SymmetryKind
from obsdesign.analysis.symmetry_text import symmetry_sentences, trade_off
from obsdesign.dynamics.model import Model
from obsdesign.signals import Signal

_NAMED_STATES = 5  # so many states of a point are named in a sentence


def hidden_in_words(
    model: Model,
    null_space: np.ndarray,
    at: np.ndarray,
    symmetries: Sequence[Symmetry] = (),
    *,
    is_given_point: bool = True,
    is_singular: bool = False,
) -> str:
    """Say which changes of the state change no output: those of the symmetries, however large, and what is left to first order.

    null_space (n, d): basis of the hidden directions at the state `at` (n,), every entry to double precision relative to itself, with
    a row of zeros for every state that is seen; symmetries: as far as there are any, with independent vectors there.
    is_given_point: that state was asked for, so that proportions which hold there are given; is_singular: more is seen around it, so that
    what is left is hidden to first order alone.
    """
    left = spanning_directions(null_space, [symmetry.vector for symmetry in symmetries])
    alone = [symmetry.states[0] for symmetry in symmetries if symmetry.kind is SymmetryKind.UNSEEN]
    alone_here = [model.state_names[int(np.flatnonzero(vector)[0])] for vector in left if np.count_nonzero(vector) == 1]
    suffix = _to_first_order(model.states, at, is_given_point=is_given_point)
    sentences = [_states_alone(model, alone), _states_alone(model, alone_here, suffix if is_singular else "")]
    sentences += symmetry_sentences(symmetries, model, at, is_given_point=is_given_point)
    sentences += [_trade_off(vector, model.states, at, is_given_point=is_given_point) for vector in left if np.count_nonzero(vector) > 1]
    return "; ".join(filter(None, sentences)) or "nothing is hidden"


def _states_alone(model: Model, names: Sequence[str], suffix: str = "") -> str:
    verb = "is" if len(names) == 1 else "are"
    return f"{', '.join(sorted(names, key=model.state_names.index))} {verb} not seen at all{suffix}" if names else ""


def _trade_off(vector: np.ndarray, states: tuple[Signal, ...], at: np.ndarray, *, is_given_point: bool) -> str:
    """Say what the others must do so that a change of one state stays unseen along the vector (n,)."""
    return f"{trade_off(vector, states, is_given_point=is_given_point)}{_to_first_order(states, at, is_given_point=is_given_point)}"


def _to_first_order(states: tuple[Signal, ...], at: np.ndarray, *, is_given_point: bool) -> str:
    """Say that a sentence holds for small changes, and where."""
    if not is_given_point:
        return " (to first order)"
    values = ", ".join(f"{state.name} = {value:.4g}" for state, value in zip(states, at, strict=True))
    return f" (to first order, at {values if len(states) <= _NAMED_STATES else 'this state'})"
