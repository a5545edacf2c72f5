"""The units in which states are counted do not change what is known of them: J about x = D y is D J D about y."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import obsdesign as od


def _information(A: np.ndarray, row: np.ndarray, unit: np.ndarray, psd: np.ndarray) -> np.ndarray:
    """Return J (9, n, n) about the states of x' = A x and one output, counted in units (n,) along the way and put back after it."""
    n = len(A)
    x = ca.SX.sym("x", n)
    drift, output = ca.mtimes(ca.DM(A * unit / unit[:, None]), x), ca.mtimes(ca.DM(row[None] * unit), x)
    system = od.ControlAffineSystem(x, tuple(f"s{i}" for i in range(n)), drift=drift, outputs={"y": output})
    path = od.simulate(system, np.zeros(n), np.zeros((8, 0)), 0.3)
    return od.posterior_information(system, path, od.Prior(np.zeros(n), 1 / unit), psd / unit**2) / unit[:, None] / unit


@pytest.mark.parametrize("decades", [3, 6, 12])
@pytest.mark.parametrize("n", [4, 6])
def test_states_that_move_each_other_may_be_counted_in_units_far_apart(n: int, decades: int) -> None:
    """exp(A step) in units 1e-12 to 1e12 has entries 1e48 apart; its inverse is that of the matrix in units of 1, D exp(A step)^-1 D^-1."""
    for seed in range(6):
        random = np.random.default_rng([seed, n])
        A, row, psd = random.normal(size=(n, n)) - 0.5 * np.eye(n), random.normal(size=n), np.exp(random.normal(size=n))
        expected = _information(A, row, np.ones(n), psd)
        size = np.sqrt(np.diagonal(expected, axis1=1, axis2=2))
        J = _information(A, row, 10.0 ** random.uniform(-decades, decades, n), psd)
        assert (np.abs(J - expected) <= 1e-9 * size[:, :, None] * size[:, None]).all()
