"""A certificate proves nothing that is not true: its bound against lambda_min in rational arithmetic, at any scale and condition."""

from __future__ import annotations

from fractions import Fraction
from itertools import product

import numpy as np
import pytest
from conftest import seeds

import obsdesign as od
from obsdesign.selection.directed_bound import prices_above, semidefinite_root

Rational = list[list[Fraction]]


def rational(W: np.ndarray) -> Rational:
    return [[Fraction(float(entry)) for entry in row] for row in W]


def is_positive_definite(W: Rational) -> bool:
    """By the pivots of elimination, exactly (Sylvester)."""
    rows, n = [row[:] for row in W], len(W)
    for i in range(n):
        if rows[i][i] <= 0:
            return False
        for k in range(i + 1, n):
            factor = rows[k][i] / rows[i][i]
            rows[k] = [entry - factor * pivot for entry, pivot in zip(rows[k], rows[i], strict=True)]
    return True


def exceeds(W: Rational, level: Fraction) -> bool:
    """Whether lambda_min(W) > level: W - level I is positive definite."""
    return is_positive_definite([[entry - (level if i == j else 0) for j, entry in enumerate(row)] for i, row in enumerate(W)])


def total(blocks: np.ndarray, chosen: tuple[int, ...]) -> Rational:
    """The exact sum of one block (0, 1, ...; -1: none) of each segment."""
    n = blocks.shape[2]
    parts = [rational(blocks[k, s]) for k, s in enumerate(chosen) if s >= 0]
    return [[sum((part[i][j] for part in parts), Fraction(0)) for j in range(n)] for i in range(n)]


def random_certificate(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Blocks (K, S, n, n), and a Z: random, of the weakest direction (all terms cancel), or with eigenvalues a little below 0."""
    random = np.random.default_rng([seed, 6])
    K, S, n = (int(each) for each in random.integers(1, (4, 4, 5)))
    factors = random.standard_normal((K, S, n, random.integers(1, n + 1)))
    if seed % 3 == 0:
        factors = np.linalg.qr(random.standard_normal((n, n)))[0] * 10.0 ** random.uniform(-7, 0, n) + np.zeros((K, S, n, n))
    factors = factors * 10.0 ** random.uniform(-6, 6, n if seed % 3 == 1 else 1)[:, None]
    blocks = factors @ factors.swapaxes(2, 3)
    weakest = np.linalg.eigh(blocks.sum(axis=(0, 1)))[1][:, :1]
    root = random.standard_normal((n, random.integers(1, n + 1))) if seed % 2 else weakest
    Z = root @ root.T / np.abs(root @ root.T).max()
    return (blocks + blocks.swapaxes(2, 3)) / 2, Z - (5e-10 * random.random() * np.eye(n) if seed % 5 == 0 else 0.0)


@pytest.mark.parametrize("seed", range(60))
def test_no_schedule_is_above_the_bound_in_exact_arithmetic(seed: int):
    """lambda_min(W) <= <W, Z'> / tr Z' for every Z' >= 0: whatever rounding does to Z, and to the sum."""
    blocks, Z = random_certificate(seed)
    bound = Fraction(od.upper_bound(blocks, Z))
    for chosen in product(range(-1, blocks.shape[1]), repeat=blocks.shape[0]):
        assert not exceeds(total(blocks, chosen), bound)


@pytest.mark.parametrize("seed", range(40))
def test_the_bound_of_the_weakest_direction_is_the_eigenvalue_at_any_condition(seed: int):
    """One block, and Z = v v' of its eigenvector, rounded: v'W v is above lambda_min by eps^2 lambda_max at most."""
    random = np.random.default_rng([seed, 7])
    Q = np.linalg.qr(random.standard_normal((2, 2)))[0]
    W = Q @ np.diag([1.0, 10.0 ** random.uniform(0, 11)]) @ Q.T
    W = (W + W.T) / 2
    v = Q[:, :1]
    for _ in range(2):  # inverse iteration in rational arithmetic: an eigenvector to its last digit
        a, b, c, d = (Fraction(float(entry)) for entry in W.ravel())
        x, y = (Fraction(float(entry)) for entry in v.ravel())
        v = np.array([[float((d * x - b * y) / (a * d - b * c))], [float((a * y - c * x) / (a * d - b * c))]])
        v /= np.linalg.norm(v)
    bound = od.upper_bound(W[None, None], v @ v.T)
    assert not exceeds(rational(W), Fraction(bound))
    assert exceeds(rational(W), Fraction(bound) * (1 - Fraction(1, 10**9)))


@pytest.mark.parametrize("size", [1e9, 1e10, 1e12])
@pytest.mark.parametrize("lowest", [-9e-10, -1e-12, 0.0])
def test_an_eigenvalue_below_zero_takes_nothing_off_a_bound(size: float, lowest: float):
    """lambda_min(diag(1, size)) = 1 = <W, e_1 e_1'>; with Z = diag(1, lowest) the sum would be less."""
    bound = od.upper_bound(np.diag([1.0, size])[None, None], np.diag([1.0, lowest]))
    assert 1.0 <= bound <= 1 + 1e-13


@pytest.mark.parametrize("exponent", [-1074, -1000, -300, -1, 0, 1, 300, 1000, 1023])
def test_no_power_of_two_changes_a_bound(exponent: int):
    """Neither of Z, be the largest entry the smallest number there is, nor of the blocks, whose power it takes on."""
    assert 1.0 <= od.upper_bound(np.eye(2)[None, None], np.ldexp(np.eye(2), exponent)) <= 1 + 1e-13
    blocks = np.ldexp(np.eye(2), exponent)[None, None]
    for Z in (np.eye(2), np.ldexp(np.eye(2), exponent), np.ldexp(np.eye(2), -max(exponent, -1023))):
        bound = od.upper_bound(blocks, Z)
        assert np.ldexp(1.0, exponent) <= bound <= np.ldexp(1.0, exponent) * (1 + 1e-13) + 2 * np.ldexp(1.0, -1074)


def test_a_bound_that_is_no_number_is_infinite():
    """Two blocks of 1e308 add up to more than there are numbers for."""
    assert od.upper_bound(np.full((2, 1, 1, 1), 1e308), np.eye(1)) == np.inf


@pytest.mark.parametrize("seed", range(20))
def test_prices_are_not_below_the_exact_ones_and_next_to_them(seed: int):
    """<W, G G'> of floats, in fractions; off by 1e-13 of the mean price at most, be the terms ever so much larger."""
    blocks, Z = random_certificate(seed)
    G, n = semidefinite_root(Z), blocks.shape[2]
    flat = blocks.reshape(-1, n, n)
    root = rational(G)
    product_ = [[sum(a * b for a, b in zip(first, second, strict=True)) for second in root] for first in root]
    exact = [sum(W[i][j] * product_[i][j] for i in range(n) for j in range(n)) for W in map(rational, flat)]
    prices = prices_above(flat, np.ones(n), G)
    mean = float(sum(exact)) / len(exact)
    assert all(Fraction(float(price)) >= right for price, right in zip(prices, exact, strict=True))
    assert all(float(Fraction(float(price)) - right) <= 2e-13 * mean for price, right in zip(prices, exact, strict=True))


@pytest.mark.parametrize("seed", seeds(30, 10))
def test_a_schedule_says_the_bound_that_its_dual_proves(seed: int):
    """root_bound = upper_bound(dual), blocks of one state up to 24 decades apart; with a budget it is no larger."""
    random = np.random.default_rng([seed, 8])
    K, S, n = (int(each) for each in random.integers(1, (5, 4, 4)))
    factors = random.standard_normal((K, S, n, random.integers(1, 3))) * 10.0 ** random.uniform(-6, 6, (K, S, 1, 1))
    blocks = factors @ factors.swapaxes(2, 3)
    schedule = od.select_sensors(blocks)
    if schedule.value > 0:
        bound = max(od.upper_bound(blocks, schedule.dual), schedule.value)
        assert schedule.root_bound == pytest.approx(bound, rel=1e-12)
    limited = od.select_sensors(blocks, rules=[od.EnergyBudget(1.0 + K / 2, dict.fromkeys(range(S), 1.0))], throw=False, method="columns")
    assert limited.root_bound <= max(od.upper_bound(blocks, limited.dual), limited.value) * (1 + 1e-12)
