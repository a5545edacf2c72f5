"""The convex program of one step in units of its own, as the compiled method for dense data takes it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.conic import smat, svec
from obsdesign.conic_interior_point import DenseConicProgram, InteriorPoint, follow_central_path, has_machine_code
from obsdesign.design.sqp.conic_model import Cone, ConicQP, ConicSolution

_MAX_ITERATIONS = 60  # models take 8 to 20
_ACCEPTED = 10.0  # tolerances at which rounding may end the method
_AIM = 1e-2  # share of the tolerance that is aimed at: where the objective is flat, a gap says little of how far the minimiser is
_NEAR_BOUND = 0.9  # share of the way to a bound at which a start is still inside
_TURNS = 4  # with ever smaller gaps, where what is active is small next to what is not
_FIRST_PRODUCT = 0.02  # of slacks and their multipliers where the method begins, in units of the objective


@dataclass(frozen=True, eq=False)
class _Coordinates:
    """d = middle + half y (q,), t = t_unit y (T,), e = slack_unit y; unit: what the objective changes by where all y change by 1.

    t and slack: strictly feasible values where the method begins.
    """

    middle: np.ndarray
    half: np.ndarray
    t: np.ndarray
    t_unit: np.ndarray
    slack: float
    slack_unit: float
    unit: float


@dataclass(frozen=True, eq=False)
class _Margins:
    """What is left of rows, hard rows and cones in the middle of the bounds, slack and t 0, and their slopes to y."""

    rows: np.ndarray
    row_slopes: np.ndarray
    epigraph_rows: np.ndarray
    epigraph_slopes: np.ndarray
    matrices: tuple[np.ndarray, ...]
    matrix_slopes: tuple[np.ndarray, ...]


def minimise_densely(qp: ConicQP, tolerance: float) -> ConicSolution | None:
    """Return the minimiser, or None without machine code, or where the gap that its multipliers prove is not within the tolerance.

    tolerance: of the objective's value where that is reached, or of what the objective changes by within the bounds, as far as its
    multipliers pay for that change: `_size_at`.
    """
    if not has_machine_code() or not (qp.upper >= qp.lower).all() or _is_unbounded(qp):
        return None
    middle, half = (qp.upper + qp.lower) / 2, (qp.upper - qp.lower) / 2
    margins = _margins(qp, middle, half)
    if not all(np.isfinite(values).all() for values in (middle, half, margins.rows, *margins.matrices)):
        return None
    nearest = np.clip(-middle / np.where(half > 0, half, np.inf), -_NEAR_BOUND, _NEAR_BOUND)  # to d = 0
    for begin in (np.zeros(len(half)), nearest):
        coordinates = _coordinates(qp, margins, (middle, half), begin)
        program, y = _program(qp, margins, coordinates, begin)
        multipliers = _first_multipliers(program, y)
        if multipliers is not None:
            return _solve(qp, (program, coordinates), (y, multipliers), tolerance)
    return None


def _solve(
    qp: ConicQP, model: tuple[DenseConicProgram, _Coordinates], begin: tuple[np.ndarray, np.ndarray], tolerance: float
) -> ConicSolution | None:
    program, coordinates = model
    value = float(np.abs(qp.weights @ coordinates.t)) + qp.penalty * (coordinates.slack - coordinates.slack_unit)
    aim = _AIM * tolerance * min(1.0, (value or coordinates.unit) / coordinates.unit)
    point = follow_central_path(program, *begin, aim, _MAX_ITERATIONS)
    for _ in range(_TURNS):
        if point is None or not np.isfinite(point.gap):
            return None
        wanted = tolerance * min(1 + program.c[-1] * point.y[-1], _size_at(program, point))
        if point.gap <= _ACCEPTED * wanted:
            return _solution(qp, coordinates, point)
        multipliers, before = np.concatenate([point.lower, point.upper, point.z]), point.gap
        point = follow_central_path(program, point.y, multipliers, _AIM * wanted, _MAX_ITERATIONS)
        if point is not None and not point.gap < before:
            return None
    return None


def _size_at(program: DenseConicProgram, point: InteriorPoint) -> float:
    """Return what the objective is made of at a point, and changes by within the bounds as its multipliers have it: t and slack, d, limits.

    Limits that are not active count for nothing, whatever they are next to the others.
    """
    q, r = len(program.P), program.half_lines
    size = np.abs(program.c[:q]).sum() + 0.5 * np.trace(program.P) + np.abs(program.c[q:] * point.y[q:]).sum()
    paid = [np.abs(program.X[:r, :q]).T @ point.z[:r]]
    for n in program.sides:
        rows = slice(r, r + n * (n + 1) // 2)
        paid.append(np.abs(point.z[rows] @ program.X[rows, :q]))
        r = rows.stop
    return float(size + np.sum(paid))


def _is_unbounded(qp: ConicQP) -> bool:
    """Whether there is a t that nothing bounds."""
    bounded = {cone.epigraph_index for cone in qp.cones} | ({0} if len(qp.epigraph_rows) else set())
    return not bounded.issuperset(range(len(qp.weights)))


def _margins(qp: ConicQP, middle: np.ndarray, half: np.ndarray) -> _Margins:
    return _Margins(
        qp.rows + qp.jacobian @ middle,
        qp.jacobian * half,
        qp.epigraph_rows + qp.epigraph_jacobian @ middle,
        qp.epigraph_jacobian * half,
        tuple(cone.A + np.tensordot(middle, cone.D, 1) for cone in qp.cones),
        tuple(svec(cone.D).T * half for cone in qp.cones),
    )


def _coordinates(qp: ConicQP, margins: _Margins, box: tuple[np.ndarray, np.ndarray], begin: np.ndarray) -> _Coordinates:
    """Choose units in which margins change by about 1 within the bounds, and the penalty no more than the rest of the objective."""
    (middle, half), rows, hard = box, margins.rows + margins.row_slopes @ begin, margins.epigraph_rows + margins.epigraph_slopes @ begin
    matrices = [A + smat(slopes @ begin, len(A)) for A, slopes in zip(margins.matrices, margins.matrix_slopes, strict=True)]
    lowest = [float(np.linalg.eigvalsh(A)[0]) for A in matrices]
    change = [float(np.linalg.norm(slopes)) for slopes in margins.matrix_slopes]
    t, t_unit = np.empty(len(qp.weights)), np.empty(len(qp.weights))
    for j in range(len(qp.weights)):
        bounding = [(lowest[k], change[k]) for k, cone in enumerate(qp.cones) if cone.epigraph_index == j]
        if j == 0 and len(hard):
            bounding.append((float(hard.min()), _largest_norm(margins.epigraph_slopes)))
        least = min(low for low, _ in bounding)
        t_unit[j] = max(size for _, size in bounding) or abs(least) or 1.0
        t[j] = least - t_unit[j]
    g = qp.g + qp.B @ middle
    unit = float(np.abs(half * g).sum() + qp.weights @ t_unit + 0.5 * (np.diag(qp.B) * half**2).sum())
    shared = [(lowest[k] / cone.slack_factor, change[k] / cone.slack_factor) for k, cone in enumerate(qp.cones) if cone.slack_factor]
    missing = max(0.0, -float(rows.min(initial=0.0)), *(-low for low, _ in shared))
    slack_unit = max(_largest_norm(margins.row_slopes), *(size for _, size in shared), 0.0) or 1.0
    unit = unit or qp.penalty * slack_unit or 1.0
    slack_unit = min(slack_unit, unit / qp.penalty) if qp.penalty > 0 else slack_unit
    return _Coordinates(middle, half, t, t_unit, missing + slack_unit, slack_unit, unit)


def _largest_norm(rows: np.ndarray) -> float:
    return float(np.sqrt((rows**2).sum(axis=1).max(initial=0.0)))


def _program(qp: ConicQP, margins: _Margins, coordinates: _Coordinates, begin: np.ndarray) -> tuple[DenseConicProgram, np.ndarray]:
    """Return the program in these coordinates, and where it begins: slack first, rows, hard rows, cones."""
    q, T, r, hard = len(qp.g), len(qp.weights), len(qp.rows), len(qp.epigraph_rows)
    sides = tuple(len(A) for A in margins.matrices)
    count = 1 + r + hard + sum(n * (n + 1) // 2 for n in sides)
    X, h = np.zeros((count, q + T + 1)), np.zeros(count)
    X[: 1 + r, -1] = coordinates.slack_unit
    X[1 : 1 + r, :q], h[1 : 1 + r] = margins.row_slopes, margins.rows
    first = 1 + r + hard
    if hard:
        X[1 + r : first, :q], X[1 + r : first, q], h[1 + r : first] = margins.epigraph_slopes, -coordinates.t_unit[0], margins.epigraph_rows
    for cone, A, slopes in zip(qp.cones, margins.matrices, margins.matrix_slopes, strict=True):
        rows = slice(first, first + len(slopes))
        X[rows, :q], h[rows], first = slopes, svec(A), rows.stop
        _add_unbounded(X[rows, q:], cone, coordinates)
    half, unit = coordinates.half, coordinates.unit
    g = half * (qp.g + qp.B @ coordinates.middle)
    c = np.concatenate([g, -qp.weights * coordinates.t_unit, [qp.penalty * coordinates.slack_unit]]) / unit
    y = np.concatenate([begin, coordinates.t / coordinates.t_unit, [coordinates.slack / coordinates.slack_unit]])
    return DenseConicProgram(half[:, None] * qp.B * half / unit, c, X, h, sides), y


def _add_unbounded(columns: np.ndarray, cone: Cone, coordinates: _Coordinates) -> None:
    """Write the columns (m, T + 1) of a cone to t and slack."""
    if cone.epigraph_index is not None:
        columns[:, cone.epigraph_index] = -coordinates.t_unit[cone.epigraph_index] * svec(cone.E)
    if cone.slack_factor:
        columns[:, -1] = cone.slack_factor * coordinates.slack_unit * svec(np.eye(len(cone.A)))


def _first_multipliers(program: DenseConicProgram, y: np.ndarray) -> np.ndarray | None:
    """Return multipliers that are alike times their slacks, but those of cones that bound a t and of slack >= 0, set by what these cost.

    None where y is outside of the cones.
    """
    q, r, T = len(program.P), program.half_lines, len(program.c) - len(program.P) - 1
    slack, z = program.h + program.X @ y, np.empty(len(program.h))
    if not (slack[:r] > 0).all():
        return None
    z[:r], firsts = _FIRST_PRODUCT / slack[:r], [*range(r)]
    for n in program.sides:
        rows = slice(r, r + n * (n + 1) // 2)
        firsts.append(r)
        try:
            L = np.linalg.cholesky(smat(slack[rows], n))
        except np.linalg.LinAlgError:
            return None
        inverse = np.linalg.inv(L)
        z[rows], r = _FIRST_PRODUCT * svec(inverse.T @ inverse), rows.stop
    for j in range(q, q + T):
        bounding = np.repeat(np.logical_or.reduceat(program.X[:, j] != 0, firsts), np.diff([*firsts, len(z)]))
        z[bounding] *= program.c[j] / (program.X[bounding, j] @ z[bounding])
    z[0] = max(z[0], (program.c[-1] - program.X[1:, -1] @ z[1:]) / program.X[0, -1])
    return np.concatenate([np.full(2 * q, _FIRST_PRODUCT), z])


def _solution(qp: ConicQP, coordinates: _Coordinates, point: InteriorPoint) -> ConicSolution:
    """Return a point in the program's own units."""
    q, r, hard, half = len(qp.g), len(qp.rows), len(qp.epigraph_rows), coordinates.half
    d, z = np.clip(coordinates.middle + half * point.y[:q], qp.lower, qp.upper), coordinates.unit * point.z
    Z, first = [], 1 + r + hard
    for n in (len(cone.A) for cone in qp.cones):
        last = first + n * (n + 1) // 2
        Z.append(smat(z[first:last], n))
        first = last
    bounds = coordinates.unit * np.maximum(point.lower, point.upper) / np.where(half > 0, half, np.inf)
    slack = float(coordinates.slack_unit * point.y[-1])
    return ConicSolution(d, slack, tuple(Z), z[1 : 1 + r], z[1 + r : 1 + r + hard], bounds)
