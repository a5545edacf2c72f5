"""How exact the steps along a path are, in state and sensitivity, and how many sub-steps they need for a tolerance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from math import ceil, floor, inf, isfinite, log10

import casadi as ca
import numpy as np

from obsdesign.errors import InputError
from obsdesign.model import Model
from obsdesign.quadrature import quadrature_of
from obsdesign.scan import Scan
from obsdesign.step import CACHED, Step, chained, exact_step, step_of

MOST = 1024  # sub-steps of one step
_WORK = 600_000  # operations that a step and its check may have together
_PART = (3 - 5**0.5) / 2  # of a sub-step, the first of the two it is checked against: no period of a motion divides both
_SHARE = 1 / (1 - _PART**5 - (1 - _PART) ** 5)  # error of a sub-step over its difference from those two, at order 4
_ROUNDING = 2.0**-46  # relative, by which state and inputs are moved to see what rounding does: 64 units of it
_LOST = 1e-2  # share of a state that rounding may take from it
_TINY, _HUGE = 1e-300, 1e300
_SAFETY, _LEAP = 1.5, 8.0  # on an error where the number of sub-steps is chosen for it; most by which that grows at a time

# (indices of paths, sub-steps) -> their states (., N+1, n)
Walked = Callable[[np.ndarray, int], np.ndarray]


class CoarseError(InputError):
    """A step is too coarse for the dynamics, with as many sub-steps as can be made: by a factor of `error` tolerances."""

    def __init__(self, step: float, count: int, error: float, tolerance: float, enough: float | None = None) -> None:
        self.arguments = (step, count, error, tolerance, enough)
        self.enough = enough
        said = f"a step of {step:g} s is too coarse for these dynamics: even {count} sub-steps "
        if isfinite(error):
            least = step / (_SAFETY * error) ** 0.25
            digits = 10.0 ** floor(log10(least))
            self.enough = floor(least / digits) * digits
            said += f"miss the tolerance of {tolerance:g} by a factor of {error:.2g}"
        else:
            said += "leave the finite numbers"
        would = "the motion runs away, or it needs a step much smaller" if self.enough is None else f"a step of {self.enough:g} s would do"
        super().__init__(f"{said}; {would}")

    def __reduce__(self) -> tuple[type, tuple[float, int, float, float, float | None]]:
        return type(self), self.arguments


@dataclass(frozen=True, eq=False)
class Walks:
    """M paths: their steps' model and length [s], inputs held (N, m + p) or (M, N, m + p), and whether each state follows the last.

    simulated: an error of one state is in all that follow; otherwise states are given, and each step begins at one of them.
    """

    model: Model
    step: float
    held: np.ndarray
    paths: int
    walked: Walked
    simulated: bool

    def inputs(self, rows: np.ndarray) -> np.ndarray:
        """Return the inputs of some of the paths."""
        return self.held[rows] if self.held.ndim == 3 else self.held


def substeps_for(walks: Walks, tolerance: float) -> np.ndarray:
    """Return for each path the fewest sub-steps (M,) that meet the tolerance, of those tried.

    From the graph alone where that has a bound; otherwise by comparing steps with finer ones and taking more as order 4 has it.
    Raises InputError where more sub-steps than can be made would be needed, with the step that would do.
    """
    model, step = walks.model, walks.step
    found, most, exact = np.ones(walks.paths, dtype=int), most_substeps(model, step), exact_step(model, step) is not None
    waiting = [(np.arange(walks.paths), 1, np.full(walks.paths, inf))]
    while waiting:
        rows, count, before = waiting.pop()
        found[rows] = count
        if exact and count > 1:
            continue
        x, held = walks.walked(rows, count), walks.inputs(rows)
        if count == 1:
            by_structure = _by_structure(model, np.abs(x).max(axis=1), held, step, tolerance)
            if by_structure is not None:
                return by_structure
        error = _error_beyond_rounding(walks, (x, held), count, tolerance, before)
        missed, later = error > 1, np.array([2 if exact else min(most, _more(count, each)) for each in error])
        if missed.any() and count >= most:
            raise CoarseError(step, count, float(error.max()), tolerance)
        waiting += [(rows[own], int(each), error[own]) for each in np.unique(later[missed]) for own in [missed & (later == each)]]
    return found


def _error_beyond_rounding(
    walks: Walks, along: tuple[np.ndarray, np.ndarray], count: int, tolerance: float, before: np.ndarray
) -> np.ndarray:
    """Return the error (M,) in tolerances, of states and inputs; less what rounding does where more sub-steps do not help."""
    (x, held), each = (
        along,
        partial(step_error, walks.model, step=walks.step, substeps=count, tolerance=tolerance, simulated=walks.simulated),
    )
    error = each(x, held)
    stuck = (error > 1) & ((count == 1) | (error > before / 2)) & np.isfinite(error)
    if stuck.any():
        error[stuck] = each(x[stuck], held[stuck] if held.ndim == 3 else held, rounding=True)
    return error


def substeps_from(model: Model, starts: np.ndarray, held: np.ndarray, step: float, tolerance: float) -> np.ndarray | None:
    """Return sub-steps (M,) that are enough by the graph alone, None if that is open.

    starts (M, n); held: inputs (N, m + p), or (M, N, m + p), each path its own.
    """
    bound = quadrature_of(model)
    return None if bound is None else _by_structure(model, bound.reach(starts), held, step, tolerance)


def _by_structure(model: Model, x: np.ndarray, held: np.ndarray, step: float, tolerance: float) -> np.ndarray | None:
    """The same for magnitudes x (M, n) of the states."""
    bound, m = quadrature_of(model), len(model.inputs)
    if bound is None:
        return None
    largest = np.abs(held).max(axis=-2)
    error = bound.error(x.max(axis=0), *np.split(np.atleast_2d(largest).max(axis=0), [m]))
    if error * step**4 > tolerance:  # not all with one: each on its own
        each = np.broadcast_to(largest, (len(x), largest.shape[-1]))
        error = np.array([bound.error(one, *np.split(inputs, [m])) for one, inputs in zip(x, each, strict=True)])
    counts = np.broadcast_to(step * (np.asarray(error) / tolerance) ** 0.25, len(x))
    if not np.isfinite(counts).all():
        return None
    if counts.max() > MOST:
        raise CoarseError(step, MOST, float((counts.max() / MOST) ** 4), tolerance)
    return np.maximum(1, np.ceil(counts * (1 - 1e-12))).astype(int)


def _more(count: int, error: float) -> int:
    """Return more sub-steps, of the numbers 2^i and 3 2^i: as many as an error of so many tolerances asks for at order 4."""
    factor = min(_LEAP, (_SAFETY * error) ** 0.25) if isfinite(error) else _LEAP
    wanted = max(count + 1, ceil(count * factor))
    power = 1 << (wanted - 1).bit_length()
    return power // 4 * 3 if power >= 4 and power // 4 * 3 >= wanted else power


@lru_cache(CACHED)
def most_substeps(model: Model, step: float) -> int:
    """Return how many sub-steps a step of this model may have: at most 1024, and no graph of more than 600,000 operations."""
    two = chained(model, (step / 2, step / 2))
    each = ca.Function("two", [two.x, two.u, two.w], [two.x_next, two.F]).n_instructions() / 2
    return max(1, min(MOST, int(_WORK / (3 * each))))


# ---------------------------------------------------------------- the error of a number of sub-steps


def step_error(
    model: Model,
    x: np.ndarray,
    held: np.ndarray,
    step: float,
    substeps: int,
    tolerance: float,
    *,
    simulated: bool,
    rounding: bool = False,
) -> np.ndarray:
    """Return the largest error (M,) along states x (M, N+1, n), in tolerances, inf where the states are not finite.

    Of the state and of each entry of Phi, relative to its size: the largest along the path, unless the motion has contracted it.
    rounding: what a rounding unit in state and inputs does is no error. From where Phi overflows on nothing is judged.
    """
    whole = np.isfinite(x).all(axis=(1, 2))
    if not whole.all():
        found = np.full(len(x), inf)
        if whole.any():
            inputs = held[whole] if held.ndim == 3 else held
            found[whole] = step_error(model, x[whole], inputs, step, substeps, tolerance, simulated=simulated, rounding=rounding)
        return found
    n, steps = x.shape[-1], x.shape[1] - 1
    identity, rows = np.eye(n).ravel(), [x[:, :-1], held]
    tops = _tops(model, step, substeps).run(_tiled(len(x), identity, identity), rows, steps, carries=False, results=False).carry
    top_Phi = tops[:, n * n :]
    top = np.minimum(np.abs(x), np.abs(x - x[:, :1])).max(axis=1)
    rest = [np.zeros(n), identity, identity, *([np.zeros(n), identity] if rounding else ())]
    first = np.hstack([top, top_Phi, top, top_Phi, _tiled(len(x), *rest)])
    check = _check(model, step, substeps, rounding)
    ratio, finite = (value[..., 0] for value in check.run(first, [*rows, np.array([tolerance, simulated])], steps, carries=False).results)
    judged = np.logical_and.accumulate(np.isfinite(finite), axis=1)
    return np.where(judged[:, 0], np.max(ratio, axis=1, where=judged, initial=0.0), inf)


def _tiled(paths: int, *parts: np.ndarray) -> np.ndarray:
    return np.tile(np.concatenate(parts), (paths, 1))


@lru_cache(CACHED)
def _tops(model: Model, step: float, substeps: int) -> Scan:
    """Carry Phi of the finer steps and the largest of each entry so far, as long as it is finite."""
    finer, n = _finer(model, step, substeps), model.x.numel()
    Phi, top = ca.SX.sym("Phi", n, n), ca.SX.sym("top", n, n)
    Phi_next = finer.F @ Phi
    size = ca.fabs(Phi_next)
    top_next = ca.fmax(top, ca.if_else(size < _HUGE, size, 0))
    return Scan(_column(Phi, top), [finer.x, finer.held], _column(Phi_next, top_next))


@lru_cache(CACHED)
def _check(model: Model, step: float, substeps: int, rounding: bool) -> Scan:
    """Carry the largest of x and Phi along the path, their sizes, error, Phi, finer Phi, and beside them what rounding does.

    error+ = F error + (f_finer - f); size+ = max(min(|.|, top), min(top, |F| size)), column by column of Phi. Results: the largest
    error over its size, in tolerances; a sum that tells whether all is finite.
    """
    one, finer = step_of(model, step, substeps), _finer(model, step, substeps)
    n, settings = one.x.numel(), ca.SX.sym("settings", 2)
    tolerance, kept = settings[0], settings[1]
    top, size, error = (ca.SX.sym(name, n) for name in ("top", "size", "error"))
    top_Phi, size_Phi, Phi, finer_Phi = (ca.SX.sym(name, n, n) for name in ("top", "size", "Phi", "finer"))
    absolute = ca.fabs(one.F)
    error_next = kept * (one.F @ error) + _SHARE * (finer.x_next - one.x_next)
    Phi_next, finer_next = one.F @ Phi, finer.F @ finer_Phi
    size_next, size_Phi_next = _sized(one.x_next, top, absolute @ size), _sized(Phi_next, top_Phi, absolute @ size_Phi)
    allowed = tolerance * size_next + _ROUNDING * (ca.fabs(one.x) + ca.fabs(one.x_next)) + _TINY
    allowed_Phi = tolerance * size_Phi_next + _ROUNDING * (absolute @ ca.fabs(Phi)) + _TINY
    carry = [top, top_Phi, size, size_Phi, error, Phi, finer_Phi]
    carry_next = [top, top_Phi, size_next, size_Phi_next, error_next, Phi_next, finer_next]
    if rounding:
        moved, Phi_moved = ca.SX.sym("moved", n), ca.SX.sym("Phi_moved", n, n)
        near = [value * (1 + _ROUNDING) for value in (one.x, one.u, one.w)]
        x_near, F_near = ca.Function("near", [one.x, one.u, one.w], [one.x_next, one.F])(*near)
        moved_next, Phi_moved_next = kept * (one.F @ moved) + x_near - one.x_next, F_near @ Phi_moved
        # no more than this share: of states that have run away all is rounding
        allowed += ca.fmin(ca.fabs(moved_next), _LOST * size_next)
        allowed_Phi += ca.fabs(Phi_moved_next - Phi_next)
        carry, carry_next = [*carry, moved, Phi_moved], [*carry_next, moved_next, Phi_moved_next]
    off = ca.mmax(ca.fabs(error_next) / allowed)
    off_Phi = ca.mmax(_SHARE * ca.fabs(finer_next - Phi_next) / allowed_Phi)
    return Scan(_column(*carry), [one.x, one.held, settings], _column(*carry_next), [ca.fmax(off, off_Phi), ca.sum1(_column(*carry_next))])


def _sized(value: ca.SX, top: ca.SX, contracted: ca.SX) -> ca.SX:
    return ca.fmin(top, ca.fmax(ca.fabs(value), contracted))


def _column(*parts: ca.SX) -> ca.SX:
    return ca.vertcat(*[ca.vec(ca.densify(part)) for part in parts])


@lru_cache(CACHED)
def _finer(model: Model, step: float, substeps: int) -> Step:
    """Return what `substeps` are checked against: the exact step, or each of them in two unequal parts."""
    exact = exact_step(model, step)
    if exact is not None:
        return exact
    each = step / substeps
    return chained(model, (_PART * each, (1 - _PART) * each) * substeps)
