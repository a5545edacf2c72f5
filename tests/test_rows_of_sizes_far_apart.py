"""Rows of information of sizes far apart keep their digits beside each other: a loose prior of one state beside a tight one of another."""

from __future__ import annotations

from fractions import Fraction

import casadi as ca
import numpy as np
import pytest

import obsdesign as od
from obsdesign.information.householder import triangular_factor
from obsdesign.round_off import rotated_triangles


def _exact_variances(rows: np.ndarray) -> np.ndarray:
    """Return the diagonal of (A'A)^-1 by elimination in fractions."""
    n = rows.shape[1]
    exact = [[Fraction(float(value)) for value in row] for row in rows]
    W = [[sum(row[i] * row[j] for row in exact) for j in range(n)] + [Fraction(int(i == j)) for j in range(n)] for i in range(n)]
    for j in range(n):
        pivot = next(i for i in range(j, n) if W[i][j])
        W[j], W[pivot] = W[pivot], W[j]
        W[j] = [value / W[j][j] for value in W[j]]
        for i in range(n):
            if i != j:
                W[i] = [value - W[i][j] * other for value, other in zip(W[i], W[j], strict=True)]
    return np.array([float(W[i][n + i]) for i in range(n)])


def _variances(R: np.ndarray) -> np.ndarray:
    size = np.abs(R).max(axis=0)
    return (np.linalg.inv(R / size) ** 2).sum(axis=1) / size**2


@pytest.mark.parametrize("seed", range(25))
def test_a_factor_of_rows_far_apart_gives_the_variances_of_all_rows(seed: int):
    """Rows D G, D from 1e-12 to 1e12: by rotations, row errors are relative to the row; reflections are wrong by up to 1e13 times here."""
    random = np.random.default_rng(seed)
    n = int(random.integers(2, 6))
    A = random.standard_normal((n + int(random.integers(0, 4)), n))
    A *= 10.0 ** random.uniform(-12, 12, (len(A), 1))
    rows = ca.SX.sym("A", *A.shape)
    of_graph = np.array(ca.Function("R", [rows], [triangular_factor(rows)])(A))
    for R in (of_graph, rotated_triangles(A[None])[0]):
        np.testing.assert_array_equal(np.tril(R, -1), 0)
        np.testing.assert_allclose(_variances(R), _exact_variances(A), rtol=1e-10)


def test_a_factor_of_zeros_is_zero_and_rows_of_zeros_change_nothing():
    A = np.array([[0.0, 0.0], [0.0, 0.0], [3.0, 4.0], [0.0, 0.0]])
    np.testing.assert_array_equal(rotated_triangles(A), [[3.0, 4.0], [0.0, 0.0]])
    np.testing.assert_array_equal(rotated_triangles(np.zeros((1, 1))), [[0.0]])


@pytest.mark.parametrize("decades", [4, 5, 6, 7])
def test_a_loose_and_a_tight_state_that_turn_into_each_other(decades: int):
    """P_k = F P_0 F' with F a rotation by t_k: its eigenvalues, trace and determinant never change, var x = a^2 cos^2 t + b^2 sin^2 t."""
    x, (a, b) = ca.SX.sym("x", 2), (10.0**decades, 10.0**-decades)
    system = od.ControlAffineSystem(x, ("x", "y"), drift=ca.vertcat(x[1], -x[0]), outputs={"r": x[0]}, sigmas={"r": 1.0})
    path = od.simulate(system, [1.0, 0.0], np.zeros((4, 0)), 0.4)
    prior = od.Prior([1.0, 0.0], (a, b))
    costs = {od.TraceInverse(): a**2 + b**2, od.MinEigenvalue(): a**2, od.LogDet(): 2 * np.log(a * b)}
    for criterion, cost in costs.items():
        schedule = od.select_for_filter(system, path, prior, segment=0.8, rules=(od.MaxUses(0, 0),), criterion=criterion)
        assert schedule.value == pytest.approx(cost, rel=1e-12, abs=1e-12)
        assert schedule.bound <= cost + 1e-12 * abs(cost) + 1e-12
        expected = np.hypot(a * np.cos(path.t[:-1]), b * np.sin(path.t[:-1]))
        np.testing.assert_allclose(schedule.predicted[:, 0], expected, rtol=1e-9)
