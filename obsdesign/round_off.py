"""What of a sum of information is there, and what is only the rounding of the numbers that were added."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.arguments import validate_arguments
from obsdesign.checks import as_array
from obsdesign.errors import InputError

EPS = float(np.finfo(float).eps)
_ROUNDINGS = 8  # of one entry of a sum: its products and its additions, each at most eps of the sizes added
_ERROR_MARGIN = 16  # how many times the error that rounding makes in rows, to first order and on average, counts as round-off
_HIDDEN_SHARE = (2 / _ERROR_MARGIN) ** 2  # squared share of a hidden direction in a state, up to which rounding may have put it there
_ROWS_PER_FACTOR = 32  # rows of a triangular factor that are taken together: its rounding grows with their number
_REGULAR_RATIO = 1e-6  # a matrix whose eigenvalues are within this ratio is nowhere near singular, in whatever units


@dataclass(frozen=True, eq=False)
class Spectrum:
    """W = D V diag(values) V' D, all with leading axes of their own: eigenvalues freed from the units of the states.

    unit_sizes (..., n): the diagonal of D, in 1/unit of each state; values (..., n) ascending and V (..., n, n): of W with D taken out;
    is_hidden (..., n): which of them are round-off.
    """

    unit_sizes: np.ndarray
    values: np.ndarray
    V: np.ndarray
    is_hidden: np.ndarray

    @property
    def is_singular(self) -> np.ndarray:
        """Whether a direction is hidden (...)."""
        return np.asarray(self.is_hidden.any(axis=-1))


def resolution(n: int) -> float:
    """Return 8 n eps: what rounding makes of an eigenvalue 0 of a sum W (n, n), its sizes scaled to 1; see docs/information.md."""
    return _ROUNDINGS * n * EPS


def spectrum(W: np.ndarray, sizes: np.ndarray | None = None) -> Spectrum:
    """Return the eigenvalues of W (..., n, n) >= 0 with unit sizes, and which of them are round-off.

    An entry W_ij is known to 8 eps sqrt(s_i s_j), with sizes s (..., n) of what was added for each diagonal entry; None: the diagonal
    itself, for a sum of positive blocks, by Cauchy and Schwarz. So, in any units, what is hidden is what is below 8 n eps of
    W_ij / sqrt(s_i s_j).
    """
    W = np.asarray(W, dtype=float)
    diagonal = np.diagonal(W, axis1=-2, axis2=-1) if sizes is None else np.asarray(sizes, dtype=float)
    d = np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    values, V = np.linalg.eigh(W / d[..., :, None] / d[..., None, :])
    return Spectrum(d, values, V, values <= resolution(W.shape[-1]))


def hidden_directions(W: np.ndarray, sizes: np.ndarray | None = None) -> np.ndarray:
    """Return the directions of the state (n, p), columns in the units of the states, that a sum W (n, n) does not see."""
    decomposition = spectrum(W, sizes)
    return decomposition.V[:, decomposition.is_hidden] / decomposition.unit_sizes[:, None]


@validate_arguments
def standard_deviations(J: ArrayLike, sizes: np.ndarray | None = None) -> np.ndarray:
    """Return sqrt(diag(J^-1)) (..., n) in the units of the states; inf for a state that a hidden direction of J moves.

    Arguments:
        J (..., n, n): information, in 1/(unit_i unit_j).
        sizes (..., n): of what was added for each diagonal entry, against which round-off is told; None = the diagonal itself; see
            `spectrum`.
    Raises InputError for shapes that do not fit.
    """
    matrices = as_array("J", J)
    if matrices.ndim < 2 or matrices.shape[-1] != matrices.shape[-2]:
        raise InputError(f"J has shape {matrices.shape}: must be (..., n, n)")
    sum_sizes = None if sizes is None else as_array("sizes", sizes)
    if sum_sizes is not None and sum_sizes.shape != matrices.shape[:-1]:
        raise InputError(f"sizes has shape {sum_sizes.shape}: must be {matrices.shape[:-1]}, one for each diagonal entry")
    decomposition = spectrum(matrices, sum_sizes)
    squares = decomposition.V**2
    inverse_values = np.where(decomposition.is_hidden, 0.0, 1 / np.where(decomposition.is_hidden, 1.0, decomposition.values))
    variances = np.einsum("...ij,...j->...i", squares, inverse_values)
    hidden_shares = np.einsum("...ij,...j->...i", squares, decomposition.is_hidden.astype(float)) / resolution(
        squares.shape[-1]
    )  # as in _parted
    return np.where(hidden_shares > _HIDDEN_SHARE * variances, np.inf, np.sqrt(variances)) / decomposition.unit_sizes


def without_round_off(W: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Return W (n, n) with its hidden directions at 0, W itself where there are none; sizes (n,) as for `spectrum`."""
    decomposition = spectrum(W, sizes)
    if not decomposition.is_singular:
        return W
    root = decomposition.V * np.sqrt(np.where(decomposition.is_hidden, 0.0, decomposition.values)) * decomposition.unit_sizes[:, None]
    return root @ root.T


def may_be_singular(W: np.ndarray) -> bool:
    """Return whether W (n, n), in units that make its directions comparable, sees one so little that it may be round-off of a path.

    A sum cannot tell: a residue has a diagonal entry of its own. Where this is so, the rows of the path have to be asked.
    """
    values = np.linalg.eigvalsh(W)
    return bool(values[0] <= _REGULAR_RATIO**2 * values[-1])


@dataclass(frozen=True, eq=False)
class Visibility:
    """What rows R (m, n) see of a state: R v for the columns v of `visible` (n, r) are orthonormal; of `hidden` (n, p) it is round-off.

    Together they span all directions, in the units of the states; a state that no hidden direction moves has zeros in all of them.
    """

    visible: np.ndarray
    hidden: np.ndarray

    @property
    def std(self) -> np.ndarray:
        """sqrt(diag((R'R)^-1)) (n,); inf for a state that a hidden direction moves."""
        return np.where(self.hidden.any(axis=1), np.inf, np.sqrt((self.visible**2).sum(axis=1)))

    @property
    def covariance(self) -> np.ndarray:
        """(R'R)^-1 (n, n) of the states that are determined, 0 along what is hidden."""
        return self.visible @ self.visible.T

    @property
    def information(self) -> np.ndarray:
        """R'R (n, n), exactly 0 along what is hidden."""
        rows = np.linalg.inv(np.hstack([self.visible, self.hidden]))[: self.visible.shape[1]]
        return rows.T @ rows

    def principal_axes(self, scale: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Eigenvalues (n,), ascending, and unit vectors (n, n) of S R'R S with S = diag(scale), by those of its inverse.

        What is hidden has the eigenvalue 0, and vectors in which a state that is not moved has no part.
        """
        hidden = np.linalg.qr(_unit_columns(self.hidden / scale[:, None]))[0]
        hidden = np.where((self.hidden != 0).any(axis=1, keepdims=True), hidden, 0.0)
        visible = self.visible / scale[:, None]
        axes, lengths, _ = np.linalg.svd(visible - hidden @ (hidden.T @ visible), full_matrices=False)
        n_visible = visible.shape[1]
        values = np.concatenate([np.zeros(hidden.shape[1]), lengths[:n_visible] ** -2.0])
        return values, np.hstack([hidden, axes[:, :n_visible]])


def visibility_of_sum(W: np.ndarray, sizes: np.ndarray | None = None) -> Visibility:
    """Return what a sum W (n, n) of information sees; sizes as for `spectrum`."""
    decomposition = spectrum(W, sizes)
    roots = np.sqrt(np.where(decomposition.is_hidden, resolution(len(W)), decomposition.values))
    directions = decomposition.V / roots / decomposition.unit_sizes[:, None]
    return _split_directions(directions, ~decomposition.is_hidden)


def visibility_of_rows(rows: np.ndarray, errors: np.ndarray) -> Visibility:
    """Return what rows (m, n) see that have errors (k, n): v is hidden where |rows v| <= 16 |errors v|, for any units of the states.

    errors: what rounding does to the rows, |errors v| its size in a direction, to first order. The triangular factors are themselves
    rounded, 8 n eps of each column. With [R; E] = [Q_1; Q_2] T the singular values of Q_1 are the cosines of the angles between
    what is seen and what is round-off (a generalised singular value decomposition): hidden is what has more of the latter.
    """
    n = rows.shape[1]
    R, E = triangular(rows), _ERROR_MARGIN * triangular(errors)
    sizes = np.sqrt((R**2).sum(axis=0) + (E**2).sum(axis=0))
    sizes = np.where(sizes > 0, sizes, 1.0)
    stack = np.vstack([R / sizes, E / sizes, resolution(n) * np.eye(n)])
    Q, T = np.linalg.qr(stack)
    _, cosines, Z = np.linalg.svd(np.vstack([Q[: len(R)], np.zeros((n, n))]), full_matrices=False)
    directions = np.linalg.solve(T, Z.T) / sizes[:, None]
    is_visible = cosines**2 > 0.5
    split = _split_directions(np.where(is_visible, directions / np.where(is_visible, cosines, 1.0), directions), is_visible)
    # the same hidden directions, well apart from each other: across the rows that are seen
    orthogonal = np.linalg.qr((Z[is_visible] @ T).T, mode="complete")[0][:, int(is_visible.sum()) :] / sizes[:, None]
    return Visibility(split.visible, np.where((split.hidden != 0).any(axis=1, keepdims=True), orthogonal, 0.0))


def _unit_columns(columns: np.ndarray) -> np.ndarray:
    return columns / np.linalg.norm(columns, axis=0)


def _split_directions(directions: np.ndarray, is_visible: np.ndarray) -> Visibility:
    """Part directions, columns as in `Visibility`, into those that are seen and those that are not.

    A hidden direction is computed with what rounding mixes into it of the directions that are seen, at most a small share of
    what these leave unknown: a state it moves by less than that is not moved.
    """
    visible, hidden = directions[:, is_visible], directions[:, ~is_visible]
    is_moved = (hidden**2).sum(axis=1) > _HIDDEN_SHARE * (visible**2).sum(axis=1)
    return Visibility(visible, np.where(is_moved[:, None], hidden, 0.0))


def reweigh(visibility: Visibility, rows: np.ndarray) -> Visibility:
    """Return the sight of the same samples with other errors, whose independent rows (m, n) of variance 1 are given.

    What no sample sees stays hidden whatever the errors are. On the rest the rows themselves are taken, not their squares: a constant
    error leaves of some directions a millionth of what others are known to, and of its square nothing.
    """
    if not visibility.visible.shape[1]:
        return visibility
    R = triangular(rows @ visibility.visible)
    sizes = np.linalg.norm(R, axis=0)
    unit = np.where(sizes > 0, sizes, 1.0)
    _, values, Z = np.linalg.svd(np.vstack([R / unit, np.zeros((len(unit), len(unit)))]), full_matrices=False)
    is_visible = values > resolution(len(visibility.visible))
    directions = (visibility.visible / unit) @ Z.T
    return Visibility(directions[:, is_visible] / values[is_visible], np.hstack([visibility.hidden, directions[:, ~is_visible]]))


def square_root_rows(W: np.ndarray) -> np.ndarray:
    """Return rows A (n, n), A'A = W (n, n) >= 0."""
    decomposition = spectrum(W)
    return (decomposition.V * np.sqrt(np.maximum(decomposition.values, 0.0)) * decomposition.unit_sizes[:, None]).T


def triangular(rows: np.ndarray) -> np.ndarray:
    """Return R (k, n), k <= n, with R'R = rows'rows: of a few rows at a time, whose factors are then taken together."""
    n = rows.shape[1]
    n_rows = max(_ROWS_PER_FACTOR, 4 * n)
    while len(rows) > n_rows:
        rows = np.concatenate([rows, np.zeros((-len(rows) % n_rows, n))])
        rows = np.asarray(np.linalg.qr(rows.reshape(-1, n_rows, n), mode="r")).reshape(-1, n)
    return np.asarray(np.linalg.qr(rows, mode="r"))


def rotated_triangles(rows: np.ndarray) -> np.ndarray:
    """Return upper triangular R (..., n, n) with R'R = A'A for rows A (..., m, n), m >= n, by Givens's rotations.

    Rows of small numbers keep their digits beside rows of large ones, which a reflection would take for the difference of larger rows.
    """
    A, (m, n) = rows.astype(float), rows.shape[-2:]
    for j in range(n):
        for i in range(j + 1, m):
            x, y = A[..., j, j, None], A[..., i, j, None]
            size = np.hypot(x, y)
            unit = np.where(size == 0, 1.0, size)
            cosine, sine = np.where(size == 0, 1.0, x / unit), y / unit
            A[..., j, :], A[..., i, :] = cosine * A[..., j, :] + sine * A[..., i, :], cosine * A[..., i, :] - sine * A[..., j, :]
    return np.triu(A[..., :n, :])


def smallest_eigenvalue(W: np.ndarray) -> float:
    """Return lambda_min of W (n, n) >= 0: 0 where a direction is hidden, otherwise right to the digits that W has of it.

    Where the units of the states are decades apart it is found as 1 / lambda_max(W^-1), by the eigenvalues with unit sizes.
    """
    values = np.linalg.eigvalsh(W)
    smallest, largest = float(values[0]), float(values[-1])
    if smallest > _REGULAR_RATIO * largest or smallest < -resolution(len(W)) * largest:
        return smallest
    decomposition = spectrum(W)
    if decomposition.is_singular:
        return 0.0
    smallest_size = float(decomposition.unit_sizes.min())
    root = decomposition.V / np.sqrt(decomposition.values) * (smallest_size / decomposition.unit_sizes)[:, None]
    return smallest_size**2 / float(np.linalg.norm(root, 2)) ** 2
