"""The compiled method for the convex program of a step: proven by its own multipliers, at any scale, and against Clarabel."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from obsdesign.conic_interior_point import native_entry
from obsdesign.design.sqp import conic_qp
from obsdesign.design.sqp.conic_model import Cone, ConicQP, ConicSolution
from obsdesign.design.sqp.dense_qp import minimise_densely

pytestmark = pytest.mark.skipif(native_entry("", "obsdesign_conic") is None, reason="needs a C compiler")


def random_program(seed: int) -> ConicQP:
    """Anything that can be asked: singular cones, the same twice, rank one, of part of the states; rows that say nothing or the same."""
    random = np.random.default_rng(seed)
    q, n, T = int(random.integers(1, 13)), int(random.integers(1, 7)), int(random.choice([0, 1, 1, 1, 2, 3]))

    def symmetric(*shape: int) -> np.ndarray:
        factor = random.standard_normal((*shape, n, n))
        return factor + factor.swapaxes(-1, -2)

    is_partial = n > 1 and random.random() < 0.3
    E = np.diag([0.0, *np.ones(n - 1)]) if is_partial else np.eye(n)
    cones = []
    for j in range(T):
        factor = random.standard_normal((n, n if is_partial or random.random() < 0.6 else int(random.integers(0, n))))
        D = symmetric(q)
        if random.random() < 0.3:
            D[random.integers(q)] = 0
        elif random.random() < 0.3:
            u = random.standard_normal(n)
            D = random.standard_normal(q)[:, None, None] * np.outer(u, u)
        cones.append(Cone(10 ** random.uniform(-1, 1) * factor @ factor.T + 0.1 * is_partial * np.eye(n), D, E, j, 0.0))
    cones += cones[: random.integers(0, 2)]
    for share in (1.0, 0.4)[: random.integers(0, 3)]:
        cones.append(Cone(symmetric() + random.choice([-2.0, 3.0, 8.0]) * np.eye(n), symmetric(q), np.eye(n), None, share))
    rows, J = random.standard_normal(4) + random.choice([-1.0, 1.0]), random.standard_normal((4, q))
    J[0] *= random.choice([0.0, 1.0])
    hard = int(random.integers(0, 4)) if T else 0
    factor = random.standard_normal((q, int(random.integers(0, q + 1))))
    return ConicQP(
        B=factor @ factor.T + 10 ** random.uniform(-9, 0) * np.eye(q),
        g=random.choice([0.0, 1.0, 3.0]) * random.standard_normal(q),
        weights=random.uniform(0.1, 2.0, T),
        penalty=float(10 ** random.uniform(-1, 6)),
        lower=-random.uniform(0, 1, q),
        upper=random.uniform(0, 1, q),
        cones=tuple(cones),
        rows=np.concatenate([rows, rows[:1], 2 * rows[1:2]]),
        jacobian=np.vstack([J, J[:1], 2 * J[1:2]]),
        epigraph_rows=random.standard_normal(hard),
        epigraph_jacobian=random.standard_normal((hard, q)),
    )


def in_units(qp: ConicQP, seed: int, decades: float) -> ConicQP:
    """The same program with d, t, e and the objective counted in units of up to so many decades."""
    random = np.random.default_rng([seed, 9])
    s = 10 ** random.uniform(-decades / 2, decades / 2, len(qp.g))
    value, tau, rho = 10.0 ** random.uniform(-decades, decades, 3)
    cones = []
    for cone in qp.cones:
        unit = rho if cone.epigraph_index is None else tau
        cones.append(replace(cone, A=unit * cone.A, D=unit * cone.D / s[:, None, None]))
    return ConicQP(
        value * qp.B / np.outer(s, s),
        value * qp.g / s,
        value * qp.weights / tau,
        value * qp.penalty / rho,
        qp.lower * s,
        qp.upper * s,
        tuple(cones),
        rho * qp.rows,
        rho * qp.jacobian / s,
        tau * qp.epigraph_rows,
        tau * qp.epigraph_jacobian / s,
    )


def largest_t(S: np.ndarray, E: np.ndarray) -> float:
    """The largest t with S - t E >= 0, E = diag(1 or 0): of the Schur complement."""
    a, b = np.flatnonzero(np.diag(E)), np.flatnonzero(np.diag(E) == 0)
    return float(np.linalg.eigvalsh(S[np.ix_(a, a)] - S[np.ix_(a, b)] @ np.linalg.solve(S[np.ix_(b, b)], S[np.ix_(b, a)]))[0])


def value_at(qp: ConicQP, d: np.ndarray) -> tuple[float, float]:
    """The objective at d with the best t and e, and the sizes of its parts."""
    slacks, t = [0.0, *-(qp.rows + qp.jacobian @ d)], []
    moved = [cone.A + np.tensordot(d, cone.D, 1) for cone in qp.cones]
    slacks += [-np.linalg.eigvalsh(S)[0] / cone.slack_factor for cone, S in zip(qp.cones, moved, strict=True) if cone.slack_factor]
    for j in range(len(qp.weights)):
        bounds = [largest_t(S, cone.E) for cone, S in zip(qp.cones, moved, strict=True) if cone.epigraph_index == j]
        t.append(min([*bounds, *(qp.epigraph_rows + qp.epigraph_jacobian @ d if j == 0 else ())]))
    parts = [0.5 * d @ qp.B @ d, qp.g @ d, -qp.weights @ np.array(t), qp.penalty * max(slacks)]
    half = (qp.upper - qp.lower) / 2
    return float(sum(parts)), float(np.abs(parts).sum() + half @ np.abs(qp.g) + half @ np.abs(qp.B) @ half)


def proven_bound(qp: ConicQP, found: ConicSolution) -> float:
    """What no d within the bounds falls below, by weak duality alone: multipliers are scaled to what t and e cost, d is minimised out."""
    Z, z, hard = list(found.Z), found.row_multipliers, found.epigraph_multipliers
    for j, weight in enumerate(qp.weights):
        own = [k for k, cone in enumerate(qp.cones) if cone.epigraph_index == j]
        share = weight / (sum(np.sum(qp.cones[k].E * Z[k]) for k in own) + (hard.sum() if j == 0 else 0.0))
        for k in own:
            Z[k] = share * Z[k]
        hard = share * hard if j == 0 else hard
    paid = z.sum() + sum(cone.slack_factor * np.trace(S) for cone, S in zip(qp.cones, Z, strict=True))
    share = min(1.0, qp.penalty / paid) if paid > 0 else 1.0
    z, Z = share * z, [share * S if cone.slack_factor else S for cone, S in zip(qp.cones, Z, strict=True)]
    for S in Z:
        assert np.linalg.eigvalsh(S)[0] >= -1e-12 * np.trace(S)
    assert min(z.min(initial=0.0), hard.min(initial=0.0)) >= 0
    slope = qp.g + qp.B @ found.d - z @ qp.jacobian - hard @ qp.epigraph_jacobian
    slope = slope - sum((np.tensordot(cone.D, S, 2) for cone, S in zip(qp.cones, Z, strict=True)), np.zeros(len(slope)))
    constant = -z @ qp.rows - hard @ qp.epigraph_rows - sum(np.sum(S * cone.A) for cone, S in zip(qp.cones, Z, strict=True))
    return float(constant - 0.5 * found.d @ qp.B @ found.d + np.minimum(slope * qp.lower, slope * qp.upper).sum())


@pytest.mark.parametrize("decades", [0, 12])
def test_a_minimiser_is_proven_by_weak_duality_at_any_scale(decades: float):
    solved = 0
    for seed in range(120):
        qp = in_units(random_program(seed), seed, decades)
        found = minimise_densely(qp, 1e-9)
        if found is not None:
            solved += 1
            assert ((found.d >= qp.lower) & (found.d <= qp.upper)).all()
            value, size = value_at(qp, found.d)
            assert 0 <= (value - proven_bound(qp, found)) / size + 1e-12 < 1e-8, seed
    assert solved >= 115


def test_clarabel_finds_the_same():
    for seed in range(40):
        qp = random_program(seed)
        found = minimise_densely(qp, 1e-9)
        second = conic_qp._solve(qp, replace(conic_qp._ATTEMPTS[1], tolerance=1e-10))
        if found is not None and second is not None:
            value, size = value_at(qp, found.d)
            assert value <= value_at(qp, np.clip(second.d, qp.lower, qp.upper))[0] + 1e-7 * size


def test_a_cone_in_other_units_leaves_the_minimiser():
    """A + sum d_i D_i - t E >= 0 is the same times any factor; one cone's factor must not settle how near the others' t has to come."""
    compared = 0
    for seed in range(80):
        qp, random = random_program(seed), np.random.default_rng([seed, 3])
        scaled = []
        for cone in qp.cones:
            factor = 10 ** random.uniform(-12, 12)
            slack_factor = factor * cone.slack_factor if cone.slack_factor else 0.0
            scaled.append(Cone(factor * cone.A, factor * cone.D, factor * cone.E, cone.epigraph_index, slack_factor))
        first, second = minimise_densely(qp, 1e-9), minimise_densely(replace(qp, cones=tuple(scaled)), 1e-9)
        if first is not None and second is not None:
            compared += 1
            value, size = value_at(qp, second.d)
            assert value - proven_bound(qp, first) <= 1e-7 * size, seed
    assert compared >= 60


@pytest.mark.parametrize("factor", [1e3, 1e6, 1e9, 1e12])
def test_a_cone_that_is_never_near_its_edge_changes_nothing(factor: float):
    asked = compared = 0
    for seed in range(40):
        qp = random_program(seed)
        if not qp.cones or not len(qp.weights):
            continue
        asked += 1
        n = len(qp.cones[0].A)
        change = np.zeros((len(qp.g), n, n))
        change[0] = np.eye(n)  # at most 1 of 10, times the factor
        far = Cone(factor * 10 * np.eye(n), factor * change, np.eye(n), 0, 0.0)
        with_far, without = minimise_densely(replace(qp, cones=(*qp.cones, far)), 1e-9), minimise_densely(qp, 1e-9)
        if with_far is not None and without is not None:  # where rounding leaves no proof there is no answer
            compared += 1
            value, size = value_at(qp, with_far.d)
            assert value - proven_bound(qp, without) <= 1e-7 * size, seed
    assert compared >= (0.9 if factor <= 1e9 else 0.5) * asked


def test_the_largest_smallest_eigenvalue_on_a_circle():
    """A = I, D = (diag(1, -1), offdiagonal): lambda_min = 1 - |d|, and 1 - |d| - d'B d / 2 is largest at 0, where the two meet."""
    D = np.array([[[1.0, 0.0], [0.0, -1.0]], [[0.0, 1.0], [1.0, 0.0]]])
    cone, none = Cone(np.eye(2), D, np.eye(2), 0, 0.0), np.zeros((0, 2))
    qp = ConicQP(np.eye(2), np.array([0.3, 0.4]), np.ones(1), 1.0, -np.ones(2), np.ones(2), (cone,), np.zeros(0), none, np.zeros(0), none)
    found = minimise_densely(qp, 1e-9)
    assert found is not None
    np.testing.assert_allclose(found.d, 0.0, atol=1e-7)
    # the gradient g = <Z, D> settles Z, of trace 1
    np.testing.assert_allclose(found.Z[0], [[0.65, 0.2], [0.2, 0.35]], atol=1e-7)
    steep = minimise_densely(replace(qp, g=np.array([1.2, 1.6])), 1e-9)  # |g| = 2: d = -0.6, -0.8 times 2 - 1
    assert steep is not None
    np.testing.assert_allclose(steep.d, [-0.6, -0.8], atol=1e-6)


def test_what_has_no_solution_has_none():
    qp = random_program(1)
    assert minimise_densely(replace(qp, lower=qp.upper + 1.0), 1e-9) is None
    assert minimise_densely(replace(qp, cones=(), epigraph_rows=qp.epigraph_rows[:0], weights=np.ones(1)), 1e-9) is None  # t has no bound
    assert minimise_densely(replace(qp, rows=np.full_like(qp.rows, np.nan)), 1e-9) is None


def test_two_limits_that_say_the_same_share_their_price():
    """max x with x <= 1 and [[1, x], [x, 1]] >= 0: both say 1; 1 = mu - 2 Z_12 of multipliers mu and Z, Z in the direction (1, -1)."""
    cone, none = Cone(np.eye(2), np.array([[[0.0, 1.0], [1.0, 0.0]]]), np.eye(2), None, 0.0), np.zeros((0, 1))
    qp = ConicQP(np.zeros((1, 1)), -np.ones(1), np.zeros(0), 1.0, -np.ones(1), np.ones(1), (cone,), np.zeros(0), none, np.zeros(0), none)
    found = minimise_densely(qp, 1e-9)
    assert found is not None
    assert found.d[0] == pytest.approx(1.0, abs=1e-9)
    assert proven_bound(qp, found) == pytest.approx(-1.0, abs=1e-9)
    assert found.bound_multipliers[0] - 2 * found.Z[0][0, 1] == pytest.approx(1.0, abs=1e-9)
    np.testing.assert_allclose(found.Z[0] @ [1.0, 1.0], 0.0, atol=1e-8)
