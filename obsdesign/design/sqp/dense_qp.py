"""The convex program of one step, handed to the compiled method for dense data."""

from __future__ import annotations

import ctypes
from functools import cache
from pathlib import Path

import numpy as np

from obsdesign.conic_interior_point import linear_algebra, native_entry
from obsdesign.design.sqp.conic_model import ConicQP, ConicSolution

_MAX_ITERATIONS = 60  # models take 8 to 20
_ENTRY = "obsdesign_dense_qp"


def minimise_densely(qp: ConicQP, tolerance: float) -> ConicSolution | None:
    """Return the minimiser, or None without machine code, or where the gap that its multipliers prove is not within the tolerance.

    tolerance: of the objective's value where that is reached, or of what the objective changes by within the bounds, as far as its
    multipliers pay for that change: limits that are not active count for nothing.
    """
    entry = native_entry(_text(), _ENTRY)
    if entry is None:
        return None
    q, r, hard = len(qp.g), len(qp.rows), len(qp.epigraph_rows)
    sides = [len(cone.A) for cone in qp.cones]
    sizes = [q, len(qp.weights), r, hard]
    for cone in qp.cones:
        sizes += [len(cone.A), -1 if cone.epigraph_index is None else cone.epigraph_index]
    numbers = np.array([qp.penalty, tolerance, *(cone.slack_factor for cone in qp.cones)])
    arrays, result = _arrays(qp), np.empty(2 * q + 1 + r + hard + sum(n * n for n in sides))
    counts, places = (ctypes.c_longlong * len(sizes))(*sizes), (ctypes.c_void_p * len(arrays))(*(values.ctypes.data for values in arrays))
    has_failed = entry(
        _MAX_ITERATIONS,
        len(sides),
        ctypes.addressof(counts),
        ctypes.addressof(places),
        linear_algebra(),
        result.ctypes.data,
        numbers.ctypes.data,
    )
    return None if has_failed else _solution(result, (q, r, hard), sides)


def _arrays(qp: ConicQP) -> list[np.ndarray]:
    """What the code reads, in its order, without gaps in memory."""
    given = [qp.B, qp.g, qp.weights, qp.lower, qp.upper, qp.rows, qp.jacobian, qp.epigraph_rows, qp.epigraph_jacobian]
    for cone in qp.cones:
        given += [cone.A, cone.D, cone.E]
    return [np.ascontiguousarray(values, dtype=float) for values in given]


def _solution(result: np.ndarray, counts: tuple[int, int, int], sides: list[int]) -> ConicSolution:
    """Take apart what the code has written."""
    (q, r, hard), Z, first = counts, [], counts[0] + 1
    for n in sides:
        Z.append(result[first : first + n * n].reshape(n, n))
        first += n * n
    rows, epigraphs, bounds = result[first : first + r], result[first + r : first + r + hard], result[first + r + hard :]
    return ConicSolution(result[:q], float(result[q]), tuple(Z), rows, epigraphs, bounds)


@cache
def _text() -> str:
    return Path(__file__).with_suffix(".c").read_text(encoding="utf-8")
