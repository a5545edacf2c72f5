"""Bounds that hold whatever rounding does: duals that are >= 0 by construction, and prices that are rounded up."""

from __future__ import annotations

from math import fsum

import numpy as np

from obsdesign.round_off import EPS, resolution
from obsdesign.selection.double_double import DoubleDouble, add, multiply, two_product

_NEGLIGIBLE = 1e-13  # of the mean price: a margin that is not worth more digits
_CHUNK = 1_000_000  # entries of blocks that are held at a time
_SMALLEST = 2.0**-1074  # what an underflow takes off at most


def semidefinite_root(Z: np.ndarray) -> np.ndarray:
    """Return F (..., n, n) with F F' = Z (..., n, n) but for eigenvalues that are negative or round-off: F F' >= 0, exactly.

    The eigenvalues are those of Z_ij / (d_i d_j), d_i the power of two next to sqrt(Z_ii): in units that are powers of two F has the
    same digits. What Z has off the diagonal of a state without a positive Z_ii, or more than twice sqrt(Z_ii Z_jj), is round-off.
    """
    size = np.diagonal(Z, axis1=-2, axis2=-1)
    is_positive = size > 0
    exponent = np.where(is_positive, np.round(np.log2(np.where(is_positive, size, 1.0)) / 2), 0.0).astype(int)
    with np.errstate(over="ignore"):
        scaled = np.clip(np.ldexp(np.ldexp(Z, -exponent[..., :, None]), -exponent[..., None, :]), -2.0, 2.0)
    scaled = np.where(is_positive[..., :, None] & is_positive[..., None, :], (scaled + np.swapaxes(scaled, -1, -2)) / 2, 0.0)
    values, V = np.linalg.eigh(scaled)
    roots = np.sqrt(np.where(values > resolution(Z.shape[-1]), values, 0.0))
    return np.ldexp(V * roots[..., None, :], exponent[..., :, None])


def squares_below(F: np.ndarray) -> float:
    """Return a number that the sum of the squares of F, not above 1 in size, is not below, and next to it."""
    return fsum((F**2).ravel().tolist()) * (1 - 4 * EPS)


def prices_above(blocks: np.ndarray, D: np.ndarray, G: np.ndarray) -> np.ndarray:
    """Return numbers (M,) that are at least <D W D, G G'> of blocks W (M, n, n), and next to it; D (n,) powers of two, G (n, r).

    A sum of products in any order is off by at most m eps / 2 of its terms' sizes, m their number with the roundings of each; where twice
    that counts beside the mean price, products and sums are made of two doubles, with eps^2 in place of eps.
    """
    n, r = G.shape
    product, size_product = _product(G), np.abs(G) @ np.abs(G).T
    price, size = np.empty(len(blocks)), np.empty(len(blocks))
    for part in _parts(np.arange(len(blocks)), n * n):
        V = blocks[part] * D[:, None] * D
        price[part], size[part] = V.reshape(-1, n * n) @ product[0].ravel(), np.abs(V).reshape(-1, n * n) @ size_product.ravel()
    margin = (n * n + r + 4) * EPS * size
    rough = np.flatnonzero(margin > _NEGLIGIBLE * np.maximum(price, 0.0).mean())
    for part in _parts(rough, n * n):
        hi, lo = _sum_of_products(blocks[part] * D[:, None] * D, product)
        margin[part] = 2 * (n * n + r + 2) * EPS**2 * size[part] + EPS * np.abs(hi)
        price[part] = hi + lo
    is_seen = (np.diagonal(blocks, axis1=1, axis2=2) > 0) @ G.any(axis=1)
    return price + np.where(is_seen, margin + EPS * np.abs(price) + 16 * n * n * _SMALLEST, 0.0)


def _parts(indices: np.ndarray, entries: int) -> list[np.ndarray]:
    return np.array_split(indices, -(-len(indices) * entries // _CHUNK)) if len(indices) else []


def _product(G: np.ndarray) -> DoubleDouble:
    """G G' (n, n) in two doubles."""
    total = np.zeros((len(G), len(G))), np.zeros((len(G), len(G)))
    for column in G.T:
        total = add(total, two_product(np.broadcast_to(column[:, None], total[0].shape), np.broadcast_to(column, total[0].shape)))
    return total


def _sum_of_products(V: np.ndarray, P: DoubleDouble) -> DoubleDouble:
    """<V, P> (M,) of symmetric V (M, n, n), in two doubles."""
    total = np.zeros(len(V)), np.zeros(len(V))
    zero = np.zeros(len(V))
    for i, j in zip(*np.tril_indices(V.shape[1]), strict=True):
        entry = V[:, i, j] * (1.0 if i == j else 2.0)
        total = add(total, multiply((entry, zero), (np.full(len(V), P[0][i, j]), np.full(len(V), P[1][i, j]))))
    return total
