"""Gramians against matrix equations and exact ranks: what must come out, whoever computes it."""

from __future__ import annotations

import math
from itertools import combinations

import casadi as ca
import numpy as np
import pytest
from by_hand import NAMES, SENSORS, START, assert_close, numerical_rank
from scipy.linalg import expm, solve_continuous_lyapunov, solve_discrete_lyapunov

import obsdesign as od

# ---------------------------------------------------------------- linear systems and Lyapunov equations

A = np.array([[-0.9, 1.2, 0.1], [-0.9, -1.1, 0.4], [0.0, 0.3, -0.8]])
C = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, -1.0]])


def linear_system() -> od.ControlAffineSystem:
    x = ca.SX.sym("x", 3)
    outputs = {"first": C[:1] @ x, "second": C[1:] @ x}
    return od.ControlAffineSystem(x, ("a", "b", "c"), ca.DM(A) @ x, outputs=outputs, sigmas={"first": 0.5, "second": 2.0})


LINEAR = linear_system()


def unforced(step: float, duration: float, tolerance: float = 1e-6) -> od.Trajectory:
    steps = round(duration / step)
    return od.simulate(LINEAR, (1.0, -1.0, 0.5), np.zeros((steps, 0)), step, tolerance=tolerance)


@pytest.mark.parametrize("tolerance", [1e-6, 0.5], ids=["exact steps", "one step of order 4"])
@pytest.mark.parametrize("step", [0.1, 0.5])
def test_over_a_long_time_the_gramian_solves_the_discrete_lyapunov_equation(step: float, tolerance: float):
    """W = sum (F^k)' C'R^-1 C F^k, so W - F'W F = C'R^-1 C; F is the exponential, of one Runge-Kutta step it is cut after h^4."""
    F = expm(step * A) if tolerance < 0.1 else sum(np.linalg.matrix_power(step * A, i) / math.factorial(i) for i in range(5))
    weighted = C / np.array([[0.5], [2.0]])
    expected = solve_discrete_lyapunov(F.T, weighted.T @ weighted)
    path = unforced(step, 60.0, tolerance)
    assert np.abs(np.linalg.matrix_power(F, path.steps)).max() < 1e-12
    assert_close(od.variational_gramian(LINEAR, path).total, expected, 1e-11)
    assert_close(od.segment_information(LINEAR, path, 1).sum(axis=(0, 1)), expected, 1e-11)


def test_over_a_long_time_the_integral_solves_the_continuous_lyapunov_equation_at_order_4():
    """A'W + W A = -C'C, whatever the noise."""
    expected = solve_continuous_lyapunov(A.T, -C.T @ C)
    assert np.abs(expm(60.0 * A)).max() < 1e-12
    errors = []
    for step in (0.4, 0.2, 0.1):
        W = od.variational_gramian(LINEAR, unforced(step, 60.0, tolerance=0.9), weighted=False).total
        errors.append(np.abs(W - expected).max())
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 4.0, atol=0.3)
    assert errors[-1] < 1e-5


@pytest.mark.parametrize("eps", [1e-3, 1.0])
def test_on_a_linear_system_the_empirical_gramian_is_exact_for_every_eps(eps: float):
    path = unforced(0.1, 5.0)
    assert_close(od.empirical_gramian(LINEAR, path, eps).total, od.variational_gramian(LINEAR, path).total, 1e-9)


# ---------------------------------------------------------------- rank

SUBSETS = [subset for size in range(1, 5) for subset in combinations(range(4), size)]


def dimension_by_symmetry(subset: tuple[int, ...], n: int) -> int:
    """What moves no output under free inputs: shifts and winds if only the compass is there, turns about the beacon if only it is."""
    names = {NAMES[i] for i in subset}
    return 1 if names == {"magnetometer"} else n - 1 if names <= {"range", "bearing"} else n


@pytest.mark.parametrize("wind", [None, "constant"], ids=["no wind", "wind"])
@pytest.mark.parametrize("subset", SUBSETS, ids=lambda subset: "+".join(NAMES[i] for i in subset))
def test_the_dimension_that_sensors_see_is_the_rank_of_the_gramian(subset: tuple[int, ...], wind: str | None):
    sensors, random = tuple(SENSORS[i] for i in subset), np.random.default_rng(0)
    turns, speeds = random.uniform(-0.5, 0.5, 40), random.uniform(5.0, 20.0, 40)
    straight = np.zeros(40)
    arrow, unicycle = (od.System(vehicle, sensors) for vehicle in (od.Dubins(15.0, wind=wind), od.Unicycle(wind=wind)))
    cases = [
        (unicycle, np.column_stack([speeds, turns]), None),
        (unicycle, np.column_stack([speeds, straight]), {"turn_rate": 0.0}),
        (arrow, turns, None),
        (arrow, straight, {"turn_rate": 0.0}),
    ]
    for system, u, held in cases:
        path = od.simulate(system, START[: len(system.model.states)], u, 0.25)
        rank = numerical_rank(od.variational_gramian(system, path).total)
        assert od.observability(system, held=held).dimension == rank
        if held is None:
            assert rank == dimension_by_symmetry(subset, len(system.model.states))
