"""A sensor schedule with its certificate."""

from __future__ import annotations

from dataclasses import dataclass
from math import fsum, inf, ldexp, nextafter
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.arguments import validate_arguments
from obsdesign.checks import as_array, require_count
from obsdesign.criteria.abstract import AbstractCriterion
from obsdesign.display import AbstractDisplay, Summary, data_frame, number, raster_picture, raster_text
from obsdesign.errors import InputError
from obsdesign.round_off import EPS
from obsdesign.selection.directed_bound import prices_above, semidefinite_root, squares_below
from obsdesign.status import Status

if TYPE_CHECKING:
    from pandas import DataFrame

_ROUNDING_TOLERANCE = 1e-9  # of its largest entry: what rounding may do to the symmetry and the eigenvalues of a block


@dataclass(frozen=True, eq=False)
class Schedule(AbstractDisplay):
    """Which sensors are on in which segment, how good that is, and a proof that no schedule is much better.

    value = criterion(W), W the sum of what is known and the chosen blocks (the worst W where sensors may be lost), less what switching
    costs; exactly 0 (-inf) where no block sees a direction, which `notes` then call hidden. gap = 1 - value / bound (bound - value for a
    criterion like log det, whose differences count; relative to |bound| where that is negative; 0 where both are one number).
    Status OPTIMAL: the gap is closed; GAP_OPEN: it is not.

    root_bound = UB(dual) >= bound, in closed form: criterion(W) <= <W, dual> + offset for every W, hence
    UB = offset + <known, dual> + prices'limits + max over schedules of (sum <W_ks, dual> - prices'usage - switching). For a smallest
    eigenvalue dual is any Z >= 0 with trace 1 (of the judged states) and offset is 0: <W, Z> >= lambda_min(W).
    All values are recomputed with NumPy; NaN where there is no answer.
    """

    chosen: np.ndarray
    """True where a sensor is on (K, S), one row per segment."""
    value: float
    """What the schedule is worth, in the criterion's unit."""
    bound: float
    """What no schedule that keeps the rules is above, in the criterion's unit."""
    root_bound: float
    """The bound before branch and bound, which `dual` proves by itself."""
    gap: float
    """How far the value may be from the best."""
    dual: np.ndarray
    """What the last bit of information is worth, by direction (n, n); (R, n, n), one for each set of lost sensors, with robust_to."""
    offset: float
    """Constant of the linear bound criterion(W) <= <W, dual> + offset."""
    prices: np.ndarray
    """What one more unit of each budget is worth (resources,)."""
    forced_on: np.ndarray
    """How much the root bound falls when a sensor is forced on in a segment (K, S); inf: impossible."""
    forced_off: np.ndarray
    """The same when it is forced off (K, S)."""
    fractional: int
    """Number of segments that the relaxation leaves undecided."""
    nodes: int
    """Number of partial schedules that the proof looked at."""
    status: Status
    """How the search ended."""
    notes: tuple[str, ...] = ()
    """What went otherwise than planned, in words."""

    def to_dataframe(self) -> DataFrame:
        """Return a row for each segment and a column for each sensor, true where it is on.

        Raises MissingPackageError where pandas is not installed.
        """
        return data_frame({f"sensor {s}": column for s, column in enumerate(self.chosen.T)}, {"segment": np.arange(len(self.chosen))})

    def _summary(self) -> Summary:
        rows = [("value", number(self.value)), ("no schedule is above", f"{number(self.bound)} (gap {number(self.gap)})")]
        rows += [(f"sensor {s}", marks) for s, marks in enumerate(raster_text(self.chosen))]
        if self.notes:
            rows.append(("notes", "; ".join(self.notes)))
        segments, sensors = self.chosen.shape
        title = f"schedule of {sensors} sensors in {segments} segments: {self.status.value}"
        return Summary(title, tuple(rows), raster_picture(self.chosen))


def gap_of(value: float, bound: float, criterion: AbstractCriterion) -> float:
    """Return the gap: 1 - value / bound, (bound - value) / |bound| where that is negative, bound - value where differences count.

    0 where both are the same number, be it 0 or -inf; inf where a bound of 0 is not reached.
    """
    if value == bound:
        return 0.0
    if criterion.resolution:
        return bound - value
    if bound == 0:
        return float("inf")
    return 1 - value / bound if bound > 0 else value / bound - 1


def schedule_information(blocks: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """W (n, n) = sum of the blocks (K, S, n, n) that a schedule (K, S) has on."""
    return np.einsum("ks,ksij->ij", np.asarray(chosen, dtype=float), blocks)


def block_values(blocks: np.ndarray, Z: np.ndarray) -> np.ndarray:
    """<W_ks, Z> (K, S): what each block adds in the direction of the dual Z."""
    return np.einsum("ksij,ij->ks", blocks, Z)


@validate_arguments
def upper_bound(blocks: ArrayLike, Z: ArrayLike, per_segment: int = 1) -> float:
    """Return UB(Z) >= lambda_min of every schedule of up to per_segment sensors a segment: the certificate's check, without a solver.

    UB(Z) = sum_k (sum of the per_segment largest max(<W_ks, Z>, 0)) / tr Z, as lambda_min(W) <= <W, Z> / tr Z for every Z >= 0. Of Z the
    part that is >= 0 beyond round-off is taken, and every rounding is rounded up, so the bound is one of the sums of the blocks as they
    are, in exact arithmetic. With the `dual` of a Schedule it is its `root_bound`, or the schedule's value where that is above it by its
    own rounding, for the smallest eigenvalue of all states without anything `known`, without `robust_to` and without rules: these only
    lower it, to the accuracy of the solver.

    Arguments:
        blocks (K, S, n, n): information of each sensor in each segment, as given to select_sensors, in any unit.
        Z (n, n): what information is worth by direction, symmetric, >= 0 and not 0; its scale does not matter.
        per_segment: number of sensors that may be on in a segment.
    Raises InputError for shapes that do not fit, blocks that are not symmetric and >= 0, and a Z that is none.
    """
    array, dual = require_blocks(np.asarray(blocks, dtype=float), per_segment), as_array("Z", Z)
    if dual.shape != array.shape[2:]:
        raise InputError(f"Z has shape {dual.shape}: must be {array.shape[2:]}, as each of the blocks")
    F = semidefinite_root(_require_dual(dual))
    exponent = _exponents(np.diagonal(array, axis1=2, axis2=3).max(axis=(0, 1)))
    G, unit = _normalise(np.ldexp(F, exponent[:, None]))
    F, user_unit = _normalise(F)
    prices = prices_above(array.reshape(-1, *dual.shape), np.ldexp(1.0, -exponent), G).reshape(array.shape[:2])
    total = fsum(np.maximum(np.sort(prices, axis=1)[:, -per_segment:], 0.0).ravel().tolist())
    return _scale_up(total / squares_below(F) * (1 + 4 * EPS), 2 * (unit - user_unit))


def _require_dual(Z: np.ndarray) -> np.ndarray:
    """Return Z with entries of at most 1, or raise InputError for what is no dual."""
    if not np.isfinite(Z).all():
        raise InputError("Z is not finite")
    size = float(np.abs(Z).max())
    unit = np.ldexp(Z, -np.frexp(size)[1])
    if not size or np.abs(unit - unit.T).max() > _ROUNDING_TOLERANCE * np.abs(unit).max():
        raise InputError("Z must be symmetric, and not 0")
    unit = (unit + unit.T) / 2
    if (lowest := float(np.linalg.eigvalsh(unit)[0])) < -_ROUNDING_TOLERANCE * np.abs(unit).max():
        lowest *= size / float(np.abs(unit).max())
        raise InputError(f"Z is not positive semidefinite: its eigenvalue is {lowest:.3g} (largest entry {size:.3g})")
    return unit


def _exponents(squares: np.ndarray) -> np.ndarray:
    """Exponents (n,) of the powers of two next to the square roots; 0 for 0."""
    return np.round(np.log2(np.where(squares > 0, squares, 1.0)) / 2).astype(int)


def _normalise(F: np.ndarray) -> tuple[np.ndarray, int]:
    """F with entries of at most 1, and the power of two that was taken out."""
    exponent = int(np.frexp(np.abs(F).max())[1])
    return np.ldexp(F, -exponent), exponent


def _scale_up(number: float, exponent: int) -> float:
    """A number that number 2^exponent is not above; inf where that is none."""
    try:
        return nextafter(ldexp(number, exponent), inf) if number else 0.0
    except OverflowError:
        return inf


def require_blocks(blocks: np.ndarray, per_segment: int, name: str = "blocks") -> np.ndarray:
    """Return blocks as a symmetric float array (K, S, n, n) or raise InputError saying which block is wrong and by how much."""
    array = np.array(blocks, dtype=float)
    if array.ndim != 4 or array.shape[2] != array.shape[3] or 0 in array.shape:
        raise InputError(f"{name} has shape {array.shape}: must be (K, S, n, n)")
    require_count("per_segment", per_segment, minimum=1, maximum=array.shape[1])
    if not np.isfinite(array).all():
        k, s, i, j = (int(index) for index in np.argwhere(~np.isfinite(array))[0])
        raise InputError(f"{_block_name(name, k, s)} is not finite: its entry [{i}, {j}] is {array[k, s, i, j]}")
    size = np.maximum(array.max(axis=(2, 3)), -array.min(axis=(2, 3)))
    transposed = array.swapaxes(2, 3)
    symmetric = array
    if not np.array_equal(array, transposed):
        asymmetry = np.abs(array - transposed).max(axis=(2, 3))
        _require_small(name, asymmetry, asymmetry, size, "symmetric: it differs from its transpose by")
        symmetric = array / 2 + transposed / 2
    try:  # a factor takes a fifth of the time of eigenvalues, which only a message needs
        allowed = _ROUNDING_TOLERANCE * np.maximum(size, np.finfo(float).tiny)
        np.linalg.cholesky(symmetric + allowed[:, :, None, None] * np.eye(array.shape[2]))
    except np.linalg.LinAlgError:
        lowest = np.linalg.eigvalsh(symmetric)[..., 0]
        _require_small(name, -lowest, lowest, size, "positive semidefinite: its eigenvalue is")
    return _clear_unseen_states(symmetric)


def _clear_unseen_states(blocks: np.ndarray) -> np.ndarray:
    """Blocks without the entries of states that they have no information about: what is there are rounding errors."""
    unseen = np.diagonal(blocks, axis1=2, axis2=3) <= 0
    return np.where(unseen[:, :, :, None] | unseen[:, :, None, :], 0.0, blocks) if unseen.any() else blocks


def _block_name(name: str, k: int, s: int) -> str:
    return f"{name}[{k}, {s}]" if name == "blocks" else name


def _require_small(name: str, excess: np.ndarray, reported: np.ndarray, size: np.ndarray, what: str) -> None:
    is_wrong = excess > _ROUNDING_TOLERANCE * np.maximum(size, np.finfo(float).tiny)
    if is_wrong.any():
        k, s = (int(index) for index in np.argwhere(is_wrong)[0])
        raise InputError(f"{_block_name(name, k, s)} is not {what} {reported[k, s]:.3g} (largest entry {size[k, s]:.3g})")
