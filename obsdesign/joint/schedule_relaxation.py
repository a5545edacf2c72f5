"""What any schedule's samples tell at most: one matrix for each segment that is above those of all options."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from math import comb

import numpy as np

from obsdesign.design.path_bound.gram_constraints import GramConstraints, gram_constraints
from obsdesign.design.path_bound.information_form import information_form
from obsdesign.design.path_bound.motion import AllowedMotion, motion_of
from obsdesign.design.path_bound.relaxation import GramRelaxation
from obsdesign.design.path_bound.sample_bounds import bounds_with_knowledge, outer_weights, readings_of
from obsdesign.design.problem import DesignProblem
from obsdesign.errors import InputError

_MOST_OPTIONS = 64  # choices of sensors in a segment; where there are more, all sensors count
_MODES, _RATIO, _FLOOR = 5, 0.15, 1e-5  # Legendre polynomials of a segment's metric, how fast their weights fall, and that of all else
_MARGIN = 1e-9  # relative, by which a segment's matrix is raised: far above rounding

Node = tuple[tuple[int, ...], ...]
"""Which options are left in each segment."""


@dataclass(frozen=True, eq=False)
class ScheduleRelaxation:
    """Samples of every schedule with at most so many sensors on in each of K equal segments, of what the path's relaxation takes.

    In segment j an option a has weights w_a (n,) of its positions and h_a of the heading. With O_j >= diag(w_a) for all options that are
    left, and the largest h_a, no schedule's information is above that of sum_j of r' O_j r, r the rows of the segment's samples.
    """

    problem: DesignProblem
    segments: int
    motion: AllowedMotion
    constraints: GramConstraints
    positions: np.ndarray
    """Weights (options, N) of positions."""
    headings: np.ndarray
    """Weights (options, K) of the heading."""
    winds: np.ndarray
    """Weights (options, K) of the wind."""
    left_out: tuple[str, ...]

    @property
    def root(self) -> Node:
        """All options in all segments."""
        return (tuple(range(len(self.positions))),) * self.segments

    @property
    def length(self) -> int:
        """Samples of a segment."""
        return self.problem.steps // self.segments

    def weights(self, segment: int, options: tuple[int, ...]) -> np.ndarray:
        """Return the weights (options, n) of a segment's positions."""
        return self.positions[list(options), segment * self.length : (segment + 1) * self.length]

    def at(self, node: Node) -> GramRelaxation:
        """Return the relaxation of what is left at a node."""
        blocks = np.array([_root_above(self.weights(j, options).tobytes(), self.length) for j, options in enumerate(node)])
        heading, wind = (sum(float(of[list(options), j].max()) for j, options in enumerate(node)) for of in (self.headings, self.winds))
        samples = bounds_with_knowledge(self.problem, np.ones(self.problem.steps), (heading, wind), self.left_out, blocks)
        return GramRelaxation(self.motion, samples, information_form(self.problem, self.motion, samples), self.constraints)


def schedule_relaxation(
    problem: DesignProblem, segments: int, per_segment: int, lengths: tuple[int, ...] | None = None
) -> ScheduleRelaxation:
    """Return the relaxation; lengths: steps of the pieces of its Gram matrix. Raises InputError with the reason where there is none."""
    motion = motion_of(problem, lengths)
    readings, left_out = readings_of(problem, motion)
    options = list(combinations(range(len(readings)), per_segment))
    if len(options) > _MOST_OPTIONS:
        choices = comb(len(readings), per_segment)
        left_out = (*left_out, f"that only {per_segment} of {len(readings)} sensors are on at a time, as there are {choices} choices")
        options = [tuple(range(len(readings)))]
    weights = [outer_weights([readings[s] for s in option]) for option in options]
    headings, winds = (
        np.array([amounts.reshape(segments, -1).sum(axis=1) for amounts in column])
        for column in ([weight.heading for weight in weights], [weight.wind for weight in weights])
    )
    positions = np.array([weight.positions for weight in weights])
    return ScheduleRelaxation(problem, segments, motion, gram_constraints(motion), positions, headings, winds, left_out)


def matrix_above(weights: np.ndarray) -> np.ndarray:
    """Return a matrix (n, n) that is above diag of each row of weights (options, n), nearly the least for what is smooth in time.

    O + L'^-1 (L' (D - O) L)_+ L^-1 is the matrix above O and D with the least trace in the metric L L' (n, n).
    """
    L, inverse = _metric(weights.shape[1])
    O = np.diag(weights[0])  # noqa: E741
    for row in weights[1:]:
        values, vectors = np.linalg.eigh(L.T @ (np.diag(row) - O) @ L)
        O = O + inverse.T @ ((vectors * np.maximum(values, 0.0)) @ vectors.T) @ inverse  # noqa: E741
    O = (O + O.T) / 2  # noqa: E741
    lowest = min(float(np.linalg.eigvalsh(O - np.diag(row))[0]) for row in weights)
    raise_by = max(0.0, -lowest) + _MARGIN * float(np.abs(O).sum()) / len(O)
    return O * (1 + _MARGIN) + raise_by * np.eye(len(O))


@lru_cache(256)
def _root_above(weights: bytes, length: int) -> np.ndarray:
    return matrix_root(matrix_above(np.frombuffer(weights).reshape(-1, length)))


def matrix_root(matrix: np.ndarray) -> np.ndarray:
    """Return B (n, n) with B'B the matrix (n, n)."""
    values, vectors = np.linalg.eigh(matrix)
    return np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T


@lru_cache(32)
def _metric(n: int) -> tuple[np.ndarray, np.ndarray]:
    """A Cholesky factor (n, n) of what smooth functions are like at n even times, and its inverse; any other gives a valid matrix too."""
    t = np.linspace(-1.0, 1.0, n) if n > 1 else np.zeros(1)
    modes = np.polynomial.legendre.legvander(t, min(n, _MODES) - 1)
    L = np.linalg.cholesky((modes * _RATIO ** (2 * np.arange(modes.shape[1]))) @ modes.T + _FLOOR * np.eye(n))
    return L, np.linalg.inv(L)


def branch(node: Node, segment: int, option: int) -> tuple[Node, Node]:
    """Return the two nodes that a node branches into: an option is taken in a segment, or one of the others that are left there."""
    if not (0 <= segment < len(node) and option in node[segment] and len(node[segment]) > 1):
        raise InputError(f"certificate: branches at segment {segment} on option {option}: must be one of several that are left there")
    others = tuple(left for left in node[segment] if left != option)
    before, after = node[:segment], node[segment + 1 :]
    return (*before, (option,), *after), (*before, others, *after)
