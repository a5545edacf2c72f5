"""Inputs rounded from the relaxation's Gram matrix: where to begin, as every path's own matrix is one of those."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count

import numpy as np

from obsdesign.blas_threads import one_thread
from obsdesign.design.path_bound.certificate import PathCertificate
from obsdesign.design.path_bound.motion import AllowedMotion
from obsdesign.design.path_bound.relaxation import GramRelaxation, relaxation_of
from obsdesign.design.problem import DesignProblem

_FORWARD, _SIDEWAYS, _SPEED, _TURN_RATE = "forward", "sideways", "speed", "turn_rate"


def rounded_inputs(problem: DesignProblem, certificate: PathCertificate, seed: int) -> Iterator[tuple[str, np.ndarray]]:
    """Yield pairs (name, u (N, m)) without end, rounded from the Gram matrix that the multipliers of a bound belong to.

    A chord is its part along e_x and e_y, and a normal draw of what the matrix has beside these, which only two dimensions have to hold;
    the first is without a draw. Source: Goemans and Williamson (1995) for rounding by random directions.
    """
    with one_thread():
        relaxation = relaxation_of(problem, tuple(certificate.lengths))
        mean, root = chord_distribution(gram_matrix(relaxation, certificate), len(relaxation.motion.lengths))
    for i in count(1):
        draw = np.zeros(mean.shape) if i == 1 else np.random.default_rng([seed, i]).standard_normal(mean.shape)
        yield f"rounded {i}", follow_chords(problem, relaxation.motion, mean + root @ draw)


def gram_matrix(relaxation: GramRelaxation, certificate: PathCertificate) -> np.ndarray:
    """Return the Gram matrix (d, d) that no path of the relaxation beats: near the end of a barrier R^-1 but for a factor, as |e_x| = 1."""
    R = relaxation.slack_matrix(certificate.level, np.array(certificate.multipliers))
    G = np.linalg.inv((R + R.T) / 2)
    return G / G[0, 0]


def chord_distribution(G: np.ndarray, K: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the chords' parts along e_x and e_y (K, 2), and a root (K, K) of half of the rest of their Gram matrix."""
    frame, cross, chords = G[:2, :2], G[2 : 2 + K, :2], G[2 : 2 + K, 2 : 2 + K]
    mean = np.linalg.solve(frame, cross.T).T
    values, vectors = np.linalg.eigh(chords - mean @ cross.T)
    return mean, vectors * np.sqrt(np.maximum(values, 0.0) / 2)


def follow_chords(problem: DesignProblem, motion: AllowedMotion, chords: np.ndarray) -> np.ndarray:
    """Return inputs (N, m) that lead along chords (K, 2) as nearly as their limits allow; a chord of length 1 is the largest speed's."""
    names = problem.system.model.input_names
    is_free = _FORWARD in names  # to go where it likes without a turn
    turn_rates = np.zeros(len(chords)) if is_free else _turn_rates(problem, motion, chords)
    heading = float(problem.x0[2])
    along, across = chords @ [np.cos(heading), np.sin(heading)], chords @ [-np.sin(heading), np.cos(heading)]
    amounts = {_TURN_RATE: turn_rates, _SPEED: np.hypot(*chords.T) * motion.speed}
    amounts |= {_FORWARD: along * motion.speed, _SIDEWAYS: across * motion.speed}
    u = np.array([amounts.get(name, np.zeros(len(chords))) for name in names]).T
    return np.repeat(np.clip(u, problem.lower, problem.upper), motion.lengths, axis=0)


def _turn_rates(problem: DesignProblem, motion: AllowedMotion, chords: np.ndarray) -> np.ndarray:
    """Turn rates (K,) [rad/s] that end each piece with the mean direction of its chord and the next one's, as far as they may."""
    column = problem.system.model.input_names.index(_TURN_RATE)
    between = chords + np.vstack([chords[1:], chords[-1:]])
    heading, rates = float(problem.x0[2]), np.zeros(len(chords))
    for j, steps in enumerate(motion.lengths):
        turn = np.remainder(np.arctan2(between[j, 1], between[j, 0]) - heading + np.pi, 2 * np.pi) - np.pi
        rates[j] = np.clip(turn / (steps * motion.step), problem.lower[column], problem.upper[column])
        heading += rates[j] * steps * motion.step
    return rates
