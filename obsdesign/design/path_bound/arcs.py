"""What holds for every arc of a bounded turn: chord, sagitta, headings, samples, each with a margin that covers rounding."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

_NODES = 4000  # of half turns at which a function is looked at
_ROUNDING = 1e-13  # relative; of a few elementary functions of numbers of order 1
_LEAST_HALF_TURN = 1e-3  # [rad]: a smaller bound is raised to it, which only adds paths
LARGEST_HALF_TURN = np.pi / 2  # [rad]: an arc is never more than half a circle


@dataclass(frozen=True, eq=False)
class Arcs:
    """Arcs of length 1, of q equal steps each, that turn by 2 d in all, |d| <= half_turn: bounds that hold for all of them.

    With E the heading in the middle and E' its left normal, the chord is D = sin d / d E and the sagitta S = (1 - cos d) / (2 d) E', both
    times 1 + shift, |shift| <= `shift`: what Simpson's rule, that is RK4 of a heading that turns evenly, makes of an integral, for any
    number of sub-steps.
    """

    half_turn: float
    """The largest |d| [rad]."""
    shift: float
    """How much longer or shorter than the exact arc's the displacements may be, relative."""
    sagitta: float
    """|S| is at most this."""
    ratio: float
    """a of |D|^2 + a |S|^2, chosen so that it hardly changes with d."""
    lengths: tuple[float, float]
    """|D|^2 + a |S|^2 lies between these."""
    shortest: float
    """|D| is at least this."""
    along: float
    """The heading at the end is nearly along D + across S, at the beginning along D - across S."""
    across: float
    """See `along`."""
    heading_error: float
    """How far from a heading these may be."""
    places: tuple[tuple[float, float], ...]
    """After i of q steps, i < q, the place is nearly first D - second S."""
    errors: tuple[float, ...]
    """How far from the place after i steps these may be."""


@lru_cache(64)
def arcs_of(half_turn: float, steps: int) -> Arcs:
    """Return the bounds of arcs of so many steps that turn by at most 2 half_turn [rad], half_turn <= pi / 2.

    Functions of d that are not monotone are bounded by their values at nodes h apart and h^2 / 8 times a bound on their second derivative:
    |(sin d / d)''| <= 1/3, |(sin^2 d / d^2)''| <= 2/3, and with s = (1 - cos d) / (2 d), |s''| <= 1/6, |(s^2)''| <= 0.3, as these are means
    of cosines and sines.
    """
    top = max(half_turn, _LEAST_HALF_TURN)
    d = np.linspace(0.0, top, _NODES + 1)
    error = (top / _NODES) ** 2 / 8
    chord, sagitta = np.sinc(d / np.pi), np.sinc(d / (2 * np.pi)) ** 2 * d / 4
    step_turn = 2 * top / steps
    shift = (step_turn**4 / 2880) / np.sinc(step_turn / (2 * np.pi)) * (1 + 1e-9) + _ROUNDING
    largest_sagitta = (sagitta.max() + error / 6) * (1 + shift) + _ROUNDING
    ratio = float((1 - chord[-1] ** 2) / sagitta[-1] ** 2)
    squares = chord**2 + ratio * sagitta**2
    margin = (2 / 3 + 0.3 * ratio) * error + _ROUNDING * ratio
    lengths = (squares.min() - margin) * (1 - shift) ** 2, (squares.max() + margin) * (1 + shift) ** 2
    along = float((1 + np.cos(top) / chord[-1]) / 2)
    across = float((4 + np.sin(top) / sagitta[-1]) / 2)
    deviation = np.hypot(np.cos(d) - along * chord, np.sin(d) - across * sagitta).max() + (2 + along / 3 + across / 6) * error
    heading_error = deviation + shift * (along + across * largest_sagitta) + _ROUNDING * across
    places, errors = _places(top, steps, float(largest_sagitta), shift)
    return Arcs(
        half_turn=half_turn,
        shift=float(shift),
        sagitta=float(largest_sagitta),
        ratio=ratio,
        lengths=(float(lengths[0]), float(lengths[1])),
        shortest=float(chord[-1] * (1 - shift) - _ROUNDING),
        along=along,
        across=across,
        heading_error=float(heading_error),
        places=places,
        errors=errors,
    )


def _places(top: float, steps: int, sagitta: float, shift: float) -> tuple[tuple[tuple[float, float], ...], tuple[float, ...]]:
    """Return what of D and -S the place after i of so many steps is, and how far off that may be.

    At the share k of the arc, x = 2 k - 1: along E it is (1 + sin(d x) / sin d) / 2 of D, across 1 - (sin(d x / 2) / sin(d / 2))^2 of -S,
    both monotone in d as sin(d x) / sin d grows with d in (0, pi) for 0 < x < 1: the middle of the two ends, and half their distance.
    """
    x = 2 * np.arange(steps) / steps - 1
    first = np.array([(1 + x) / 2, (1 + np.sin(top * x) / np.sin(top)) / 2])
    second = np.array([1 - x**2, 1 - (np.sin(top * x / 2) / np.sin(top / 2)) ** 2])
    spread = np.hypot(abs(first[0] - first[1]) / 2, abs(second[0] - second[1]) / 2 * sagitta) * (1 + shift) + 4 * _ROUNDING
    middles = first.mean(axis=0), second.mean(axis=0)
    return tuple(zip(middles[0].tolist(), middles[1].tolist(), strict=True)), tuple(spread.tolist())
