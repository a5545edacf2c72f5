"""The convex model of a program about one of its points, and its solution."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from obsdesign.design.nlp.evaluation import Multipliers, Slopes
from obsdesign.design.sqp.active_set_step import Active, Face, newton
from obsdesign.design.sqp.conic_qp import Cone, Model, Step, minimised
from obsdesign.design.sqp.matrix_objective import AbstractAim, value_of, weights_of
from obsdesign.design.sqp.merit import Place, Scene, Terms, shortfall

FEASIBLE = 1e-7  # by how much a margin, of order 1, may fall short
_NEAR = 0.3  # margins below this are in every model; others when a model's solution would break them
_ACTIVE = 1e-6  # multipliers above this are of something active
_TIGHT = 10.0  # weight of active normals in what is made convex, in units of the largest curvature
_ACCURACY = 1e-9  # of Clarabel
_BENT = 1e-6  # share of the largest curvature below which one is not negative


@dataclass(frozen=True, eq=False)
class Local:
    """A place with its slopes, the Hessian H (q, q) of the Lagrangian, and B, what of it is convex.

    hard + hard_slopes d - t >= 0: the numbers of several matrices, the least of which counts. downhill (q,): where curvature is most
    negative, one width of the box long; None where it nowhere is.
    """

    scene: Scene
    place: Place
    slopes: Slopes
    floor_slopes: np.ndarray
    H: np.ndarray
    B: np.ndarray
    g: np.ndarray
    hard: np.ndarray
    hard_slopes: np.ndarray
    downhill: np.ndarray | None


@dataclass(frozen=True, eq=False)
class Solved:
    """A model's minimiser, the rows that it knew of, and what the model says the merit is there."""

    step: Step
    rows: np.ndarray
    promised: float

    @property
    def d(self) -> np.ndarray:
        """The step (q,)."""
        return self.step.d


def local_at(scene: Scene, place: Place, slopes: Slopes, multipliers: Multipliers, held: np.ndarray, terms: Terms) -> Local:
    """Return the model's data; multipliers weigh the curvatures, held (q,) says which parameters lie on their bounds."""
    values, aim = place.values, scene.aim
    H, g = scene.program.curvature(values, slopes, multipliers), slopes.price / terms.unit
    hard, hard_slopes = np.zeros(0), np.zeros((0, len(g)))
    if not aim.is_cone:
        weights = weights_of(aim, values.matrices)
        towards = np.einsum("bij,bqij->bq", aim.slopes(values.matrices), slopes.matrices) / terms.unit
        H = H + np.einsum("b,bij->ij", weights, aim.curvatures(values.matrices, slopes.matrices)) / terms.unit
        if aim.worst and len(values.matrices) > 1:
            hard, hard_slopes = aim.each(values.matrices) / terms.unit, towards
        else:
            g = g - weights @ towards
    width = scene.width
    B, downhill = _convex(H * np.outer(width, width), _normals(aim, slopes, multipliers, held, width))
    downhill = None if downhill is None else downhill * width
    return Local(scene, place, slopes, scene.floor_slopes(slopes), H, B / np.outer(width, width), g, hard, hard_slopes, downhill)


def solved(local: Local, terms: Terms, radius: float) -> Solved | None:
    """Minimise the model in the trust region, with the margins that are near and those that its solution would break."""
    values = local.place.values
    rows = np.flatnonzero(values.rows < _NEAR)
    while True:
        step = minimised(_model(local, _begin(local), rows, terms, radius), _ACCURACY)
        if step is None:
            return None
        after = values.rows + local.slopes.rows @ step.d + step.e
        broken = after < -FEASIBLE / 10
        broken[rows] = False
        if not broken.any():
            return Solved(step, rows, _promise(local, step.d, terms))
        rows = np.union1d(rows, np.flatnonzero(broken))


def slack_if_lighter(local: Local, found: Solved, terms: Terms, radius: float, share: float) -> float:
    """Return the slack that the model would need if its aim counted for a share only."""
    model = _model(local, _begin(local), found.rows, terms, radius)
    step = minimised(replace(model, g=share * model.g, weights=share * model.weights), _ACCURACY)
    return np.inf if step is None else step.e


def corrected(local: Local, found: Solved, moved: Place, terms: Terms, radius: float) -> np.ndarray | None:
    """Return the step again, with limits and matrices as they turned out at its end (second-order correction)."""
    values, slopes, d = moved.values, local.slopes, found.d
    turned = _Ends(
        values.matrices - np.tensordot(d, slopes.matrices, (0, 1)),
        moved.floors - np.tensordot(d, local.floor_slopes, (0, 1)),
        values.rows - slopes.rows @ d,
        local.scene.aim.each(values.matrices) / terms.unit - local.hard_slopes @ d if len(local.hard) else local.hard,
    )
    step = minimised(_model(local, turned, found.rows, terms, radius), _ACCURACY)
    return None if step is None else step.d


def sharpened(local: Local, found: Solved, terms: Terms, radius: float) -> np.ndarray | None:
    """Return Newton's step on what the model's solution holds active, with all of the curvature; None where it leaves the region."""
    values, step, width = local.place.values, found.step, local.scene.width
    kept, chosen = step.rows > _ACTIVE, step.hard > _ACTIVE
    cones = _cones(local, _begin(local), terms)
    faces = [Face(cone.A, cone.D, cone.E, cone.j, Z) for cone, Z in zip(cones, step.Z, strict=True) if np.trace(Z) > _ACTIVE]
    active = Active(
        local.H,
        local.g,
        _weights(local.scene.aim, len(values.matrices)),
        faces,
        values.rows[found.rows][kept],
        local.slopes.rows[found.rows][kept],
        local.hard[chosen],
        local.hard_slopes[chosen],
        step.bounds > _ACTIVE,
        step.d,
    )
    d = newton(active)
    return None if d is None or float(np.max(np.abs(d) / width)) > radius else d


def priced(local: Local, found: Solved, terms: Terms) -> Multipliers:
    """Return the multipliers of a model's solution."""
    scene, values, step = local.scene, local.place.values, found.step
    aim, count, floor = scene.aim, len(values.matrices), scene.program.problem.floor
    own = count if aim.is_cone else 0
    windows = len(values.floors)
    Z = np.array(step.Z).reshape(-1, *values.matrices.shape[1:])
    if aim.is_cone:
        matrices = Z[:own] / terms.unit
    else:
        weights = step.hard if len(step.hard) else weights_of(aim, values.matrices)
        matrices = aim.slopes(values.matrices) * (weights / terms.unit)[:, None, None]
    if scene.least:
        matrices = matrices + Z[own + windows :] / scene.least
    rows = np.zeros(len(values.rows))
    rows[found.rows] = step.rows
    return Multipliers(matrices, Z[own : own + windows] / (1.0 if floor is None else floor.value), rows, 1 / terms.unit)


# ---------------------------------------------------------------- the model


@dataclass(frozen=True, eq=False)
class _Ends:
    """What limits and matrices are where the model begins: those of its place, or as a step turned out."""

    matrices: np.ndarray
    floors: np.ndarray
    rows: np.ndarray
    hard: np.ndarray


def _begin(local: Local) -> _Ends:
    values = local.place.values
    return _Ends(values.matrices, local.place.floors, values.rows, local.hard)


def _model(local: Local, ends: _Ends, rows: np.ndarray, terms: Terms, radius: float) -> Model:
    program, p, width = local.scene.program, local.place.values.p, local.scene.width
    return Model(
        local.B,
        local.g,
        _weights(local.scene.aim, len(ends.matrices)),
        terms.penalty,
        np.maximum(program.lower - p, -radius * width),
        np.minimum(program.upper - p, radius * width),
        _cones(local, ends, terms),
        ends.rows[rows],
        local.slopes.rows[rows],
        ends.hard,
        local.hard_slopes,
    )


def _cones(local: Local, ends: _Ends, terms: Terms) -> tuple[Cone, ...]:
    aim, n, found = local.scene.aim, ends.matrices.shape[-1], []
    if aim.is_cone:
        E = aim.edge(n)
        for i, (A, D) in enumerate(zip(ends.matrices, local.slopes.matrices, strict=True)):
            found.append(Cone(A / terms.unit, D / terms.unit, E, 0 if aim.worst else i, 0.0))
    identity = np.eye(n)
    found += [Cone(F - identity, D, identity, None, 1.0) for F, D in zip(ends.floors, local.floor_slopes, strict=True)]
    return tuple(found)


def _weights(aim: AbstractAim, count: int) -> np.ndarray:
    """Weights of the t in the model: one t for the worst of several, one each for a mean, none where the aim has a slope."""
    if aim.is_cone and not aim.worst:
        return np.full(count, 1 / count)
    return np.ones(1) if aim.is_cone or (aim.worst and count > 1) else np.zeros(0)


def _promise(local: Local, d: np.ndarray, terms: Terms) -> float:
    """The model's merit after a step, recomputed: a solver's objective is a claim."""
    values, aim = local.place.values, local.scene.aim
    if aim.is_cone:
        value = value_of(aim, values.matrices + np.tensordot(d, local.slopes.matrices, (0, 1))) / terms.unit
    else:
        value = float((local.hard + local.hard_slopes @ d).min()) if len(local.hard) else local.place.aim / terms.unit
    rows = values.rows + local.slopes.rows @ d
    floors = local.place.floors + np.tensordot(d, local.floor_slopes, (0, 1))
    bent = local.g @ d + 0.5 * d @ local.B @ d + values.price / terms.unit
    return float(bent - value + terms.penalty * shortfall(rows, floors))


# ---------------------------------------------------------------- curvature that may stay


def _normals(aim: AbstractAim, slopes: Slopes, multipliers: Multipliers, held: np.ndarray, width: np.ndarray) -> np.ndarray:
    """Directions (k, q), in widths of the box, along which a step is settled by what is active: there H need not be convex."""
    found = [slopes.rows[multipliers.rows > _ACTIVE] * width, np.eye(len(width))[held]]
    if aim.is_cone:
        found += [_equal_eigenvalues(Z, D) * width for Z, D in zip(multipliers.matrices, slopes.matrices, strict=True)]
    return np.vstack(found)


def _equal_eigenvalues(Z: np.ndarray, D: np.ndarray) -> np.ndarray:
    """Return the slopes (k, q) of the differences that stay 0 where eigenvalues coincide, their vectors being those of Z."""
    values, vectors = np.linalg.eigh(Z)
    U = vectors[:, values > 1e-3 * max(values[-1], np.finfo(float).tiny)]
    k = U.shape[1]
    if k < 2:
        return np.zeros((0, len(D)))
    R = U.T @ D @ U
    upper = np.triu_indices(k, 1)
    return np.vstack([R[:, upper[0], upper[1]].T, (R[:, np.arange(1, k), np.arange(1, k)] - R[:, :1, 0]).T])


def _convex(H: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
    """Return H without the negative curvature that is not along the normals (k, q), and the direction (q,) of most of that, if any."""
    size = float(np.abs(H).max(initial=0.0))
    if not size > 0:
        return 1e-8 * np.eye(len(H)), None
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    along = normals / np.where(lengths > 0, lengths, 1.0)
    values, vectors = np.linalg.eigh(H + _TIGHT * size * along.T @ along)
    downhill = vectors[:, 0] if values[0] < -_BENT * size else None
    return (vectors * np.maximum(values, 1e-7 * size)) @ vectors.T, downhill
