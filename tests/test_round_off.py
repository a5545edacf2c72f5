"""Round-off of information, against exact arithmetic (rational numbers) and closed forms."""

from __future__ import annotations

import flint
import numpy as np
import pytest

import obsdesign as od
from obsdesign.criteria._factor import shadow
from obsdesign.round_off import hidden_directions, smallest_eigenvalue, standard_deviations


def _rank(rows: np.ndarray) -> int:
    return flint.fmpq_mat(*rows.shape, [int(value) for value in rows.ravel()]).rank()


def _instances(count: int, seed: int):
    """Integer rows (3 n, n) of known rank, some of them a thousand times as exact as others, and units 1e-12..1e12 of the states."""
    rng = np.random.default_rng(seed)
    for trial in range(count):
        n = int(rng.integers(1, 8))
        k = int(rng.integers(0, n + 1))
        rows = rng.integers(-5, 6, size=(3 * n, k)) @ rng.integers(-3, 4, size=(k, n))
        if trial % 3 == 0:
            rows = rows * 10 ** rng.integers(0, 4, size=(3 * n, 1))
        yield rows, 10.0 ** rng.uniform(-12, 12, n)


def test_what_is_hidden_is_what_exact_arithmetic_says_in_any_units():
    # state i is seen when e_i is a combination of the rows: adding it to them does not raise their rank
    for rows, unit in _instances(300, seed=5):
        n, rank = rows.shape[1], _rank(rows)
        seen = [_rank(np.vstack([rows, np.eye(n, dtype=int)[i]])) == rank for i in range(n)]
        W = np.einsum("ki,kj->ij", rows * unit, rows * unit)
        assert hidden_directions(W).shape == (n, n - rank)
        assert np.isfinite(standard_deviations(W)).tolist() == seen
        assert (od.MinEigenvalue().value(W) > 0) == (rank == n)
        assert np.isfinite(od.LogDet().value(W)) == np.isfinite(od.TraceInverse().value(W)) == (rank == n)


def test_the_hidden_directions_are_those_of_the_null_space():
    for rows, unit in _instances(200, seed=6):
        directions = hidden_directions(np.einsum("ki,kj->ij", rows * unit, rows * unit)) * unit[:, None]
        sizes = np.linalg.norm(rows, axis=0)[:, None] * directions  # what each state adds to what is read along a direction
        assert np.all(np.linalg.norm(rows @ directions, axis=0) <= 1e-9 * np.linalg.norm(sizes, axis=0))


def test_the_smallest_eigenvalue_of_states_in_units_decades_apart():
    # diagonal: 1e-3 beside 1e12; [[a, b], [b, d]] with a >> d: d - b^2/a to the relative size d/a of the next term
    assert smallest_eigenvalue(np.diag([1e12, 1e-3])) == pytest.approx(1e-3, rel=1e-12)
    assert smallest_eigenvalue(np.array([[1e24, 3e11], [3e11, 1.0]])) == pytest.approx(1 - 9e22 / 1e24, rel=1e-12)
    assert smallest_eigenvalue(np.zeros((3, 3))) == 0.0
    assert smallest_eigenvalue(np.diag([4.0, 0.0, 1e-30])) == 0.0


def test_what_is_left_beside_the_other_states_is_judged_by_what_it_was_taken_from():
    # one row (1, 1): with the second state free nothing is left of the first, however 1 - 1 is rounded
    row = np.array([[0.1 + 0.2, 0.7]])
    W = row.T @ row / 0.3
    assert shadow(W, np.array([0])) == 0.0


def test_information_a_hair_above_round_off_is_kept():
    # correlation 1 - 2^-40: the determinant is 2^-39, and 1/(W^-1)_ii = 2^-39 to the relative size 2^-41 of the next term
    W = np.array([[1.0, 1 - 2.0**-40], [1 - 2.0**-40, 1.0]])
    assert standard_deviations(W) == pytest.approx([2**19.5, 2**19.5], rel=1e-3)
    assert standard_deviations(W * np.outer([1e-9, 1e9], [1e-9, 1e9])) == pytest.approx([2**19.5 * 1e9, 2**19.5 * 1e-9], rel=1e-3)


@pytest.mark.parametrize("seed", range(4))
def test_one_range_does_not_see_a_turn_about_its_beacon(seed):
    # 2 of 3: turning the whole path about the beacon changes no distance
    rng = np.random.default_rng(seed)
    system = od.System(od.Unicycle(), (od.Range(tuple(rng.normal(size=2) * 300), sigma=0.3),))
    u = np.column_stack([rng.uniform(1, 20, 200), rng.uniform(-1, 1, 200)])
    found = od.variational_gramian(system, od.simulate(system, [*rng.normal(size=2) * 100, 0.7], u, 0.1))
    assert od.MinEigenvalue().value(found.total) == 0.0
    assert od.LogDet().value(found.total) == od.TraceInverse().value(found.total) == -np.inf
    assert np.isinf(found.std).all()
