"""How many sub-steps the steps along a path need for a tolerance in state and sensitivity."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import ceil, floor, inf, isfinite, log10

import casadi as ca
import numpy as np

from obsdesign.dynamics.model import Model
from obsdesign.dynamics.quadrature import quadrature_of
from obsdesign.dynamics.step import CACHED, chained, exact_step
from obsdesign.dynamics.step_comparison import ALIKE, EXCUSED, Compared, Walks, alike, compared, operations
from obsdesign.errors import InputError

MOST = 1024  # sub-steps of one step
_WORK = 600_000  # operations that a step and its check may have together
_TRIED = 400_000_000  # operations, about, that it may take to try a step that would do
_FINEST = 1 << 22  # parts of a step
_PREFIX = 16  # steps that are looked at first: most motions that run away do so at once
_CALM = 10.0  # growth of a sensitivity, at most, where a stretch of a path speaks for all of it
_SAFETY, _LEAP = 1.5, 8.0  # on an error where the number of sub-steps is chosen for it; most by which that grows at a time


class CoarseError(InputError):
    """A step is too coarse for the dynamics, with as many sub-steps as can be made: by a factor of `error` tolerances.

    enough: a step that would do, None where none was found; tried: over how many seconds of the path it was tried out, inf for all
    of it, 0 for an estimate.
    """

    def __init__(self, step: float, count: int, error: float, tolerance: float, enough: float | None = None, tried: float = np.inf) -> None:
        self.arguments, self.enough = (step, count, error, tolerance, enough, tried), enough
        said = f"a step of {step:g} s is too coarse for these dynamics: even {count} sub-steps "
        said += f"miss the tolerance of {tolerance:g} by a factor of {error:.2g}" if isfinite(error) else "leave the finite numbers"
        if enough is None:
            would = "the motion runs away, or it needs a step much smaller"
        elif tried:
            would = f"a step of {enough:.12g} s would do" + (f", tried over the first {tried:.3g} s" if isfinite(tried) else "")
        else:
            would = f"it is estimated that a step of {enough:.2g} s would do"
        super().__init__(f"{said}; {would}")

    def __reduce__(self) -> tuple[type, tuple[object, ...]]:
        return type(self), self.arguments


class RoundedError(InputError):
    """The rounding of doubles moves states or sensitivities by more than the tolerance, however small the steps are."""

    def __init__(self, step: float, error: float, tolerance: float) -> None:
        self.arguments = step, error, tolerance
        wanted = 2 * error * tolerance
        digits = 10.0 ** floor(log10(wanted))
        met = ceil(wanted / digits) * digits
        would = f"a tolerance of {met:g} is met, or a shorter path" if met < 0.1 else "only a shorter path would do"
        super().__init__(
            f"the motion amplifies the rounding of doubles to {error:.2g} tolerances of {tolerance:g} along this path,"
            f" however small its steps of {step:g} s are made: {would}"
        )

    def __reduce__(self) -> tuple[type, tuple[object, ...]]:
        return type(self), self.arguments


def substeps_for(walks: Walks, tolerance: float) -> np.ndarray:
    """Return for each path the fewest sub-steps (M,) that meet the tolerance, of those tried.

    By comparing steps with finer ones and taking more as order 4 has it: for what `substeps_from` leaves open.
    Raises InputError where more sub-steps than can be made would be needed, with a step that would do, tried out; and where
    rounding alone is above the tolerance.
    """
    model, step = walks.model, walks.step
    most, exact = most_substeps(model), exact_step(model, step) is not None
    found = np.ones(len(walks.x), dtype=int)
    waiting = [(np.arange(len(found)), 1, _Tried(np.full(len(found), inf), np.zeros(len(found), dtype=bool), np.zeros(len(found))))]
    while waiting:
        rows, count, before = waiting.pop()
        found[rows] = count
        if exact and count > 1:
            continue
        some = walks.some(rows)
        now = _judged(some, count, tolerance, before)
        missed, later = now.error > 1, np.array([2 if exact else min(most, _more(count, each)) for each in now.error])
        if missed.any() and count >= most:
            raise _coarse(some.some(np.flatnonzero(missed)[:1]), count, float(now.error[missed][0]), tolerance)
        for each in np.unique(later[missed]):
            own = missed & (later == each)
            waiting.append((rows[own], int(each), now.some(own)))
    return found


@dataclass(frozen=True, eq=False)
class _Tried:
    """What was found with some number of sub-steps (M,): the error in tolerances; whether rounding explains it; how much Phi grows.

    growth: 0 where it is not above what rounding is excused for, by far, or where steps are unstable.
    """

    error: np.ndarray
    rounded: np.ndarray
    growth: np.ndarray

    def some(self, rows: np.ndarray) -> _Tried:
        """Return those of some of the paths."""
        return _Tried(self.error[rows], self.rounded[rows], self.growth[rows])


def _judged(walks: Walks, count: int, tolerance: float, before: _Tried) -> _Tried:
    """Return the errors, with what was found with fewer sub-steps; inf where steps are unstable.

    Rounding is excused for up to two tolerances. Raises RoundedError where it explains the whole error twice in a row, and where Phi
    makes more of it, by far, twice in a row and alike.
    """
    if count > _LEAP and walks.simulated and _runs_away(walks, count, tolerance):
        return _Tried(np.full(len(walks.x), inf), np.zeros(len(walks.x), dtype=bool), np.zeros(len(walks.x)))
    plain = compared(walks, count, tolerance)
    error = np.where(plain.is_amplified & plain.is_unstable, inf, plain.error)
    rounded = np.zeros(len(error), dtype=bool)
    slow = np.flatnonzero((error > 1) & ((count == 1) | (error > before.error / 2)) & np.isfinite(error))
    if len(slow):
        told = compared(walks.some(slow), count, tolerance, rounding=True)
        error[slow], rounded[slow] = told.error, (told.beyond_rounding <= 1) & (told.error > 1)
        lost = np.flatnonzero(rounded & before.rounded)
        if count > 1 and len(lost):
            raise RoundedError(walks.step, float(error[lost[0]]), tolerance)
    growth = _far_grown(plain)
    lost = (error <= 1) & plain.is_amplified | (np.minimum(growth, before.growth) > 0) & alike(growth, before.growth)
    if lost.any():
        raise RoundedError(walks.step, float(plain.amplified[lost].max()), tolerance)
    return _Tried(error, rounded & (count > 1), growth)


def _far_grown(found: Compared) -> np.ndarray:
    """Return how much Phi grows (M,) where that is above what rounding is excused for by more than growths that are alike differ."""
    growth = found.growth.min(axis=1)
    far = found.amplified > (EXCUSED + 1) * np.maximum(growth, 1.0) ** ALIKE
    return np.where(far & ~found.is_unstable, growth, 0.0)


def _runs_away(walks: Walks, count: int, tolerance: float) -> bool:
    """Tell whether all paths leave the finite numbers within their first steps."""
    short = Walks(walks.model, walks.step, walks.held[..., :_PREFIX, :], walks.x)
    return walks.held.shape[-2] > _PREFIX and bool(np.isinf(compared(short, count, tolerance).error).all())


def _coarse(walks: Walks, count: int, error: float, tolerance: float) -> CoarseError:
    """Return the refusal of a path, with parts of the step that were found to do, with as many sub-steps as they may have.

    They are tried along the whole path. Where that takes too long: along its beginning, if longer steps failed within that and
    sensitivities do not grow; else it is an estimate by order 4, as where states are given.
    """
    parts, now, estimate, failed = 1, error, _estimated(walks.step, error, tolerance), 0.0  # seconds within which longer steps failed
    each = operations(walks.model) * count
    affordable = 2 * _TRIED // (each * walks.held.shape[-2])
    while walks.simulated and parts < _FINEST:
        parts = _more(parts, now) if failed else min(_more(parts, now), max(parts + 1, affordable))
        finer = walks.beginning(max(_TRIED // each, ceil(failed * parts / walks.step)), parts)
        if _runs_away(finer, count, tolerance):
            now, failed = inf, finer.step * _PREFIX
            continue
        steps = finer.held.shape[-2]
        whole = steps == parts * walks.held.shape[-2]
        if steps * each > 2 * _TRIED or not (whole or failed):
            estimate = estimate or _at_first(finer, count, now, tolerance, parts * walks.held.shape[-2])
            break
        before, found = now, compared(finer, count, tolerance)
        now = float(found.error[0])
        estimate = _estimated(finer.step, now, tolerance) or estimate
        if now <= 1 and (whole or found.growth.max() <= _CALM):
            return CoarseError(walks.step, count, error, tolerance, finer.step, inf if whole else steps * finer.step)
        if now <= 1:  # it may not do later on
            break
        if now > before / 2 and now * tolerance < 1:  # finer ones do not help
            estimate = None
            break
    return CoarseError(walks.step, count, error, tolerance, estimate, 0.0)


def _at_first(walks: Walks, count: int, before: float, tolerance: float, steps: int) -> float | None:
    """Return a step that would do if so many steps add errors as the first do, None where a longer one left the finite numbers."""
    if not isfinite(before):
        return None
    error = float(compared(walks.beginning(_PREFIX, 1), count, tolerance).error[0]) * max(1.0, steps / _PREFIX)
    return walks.step if error <= 1 else _estimated(walks.step, error, tolerance)


def _estimated(step: float, error: float, tolerance: float) -> float | None:
    """Return a step that would do by order 4, None where the error is as large as what it is an error of."""
    return step / (_SAFETY * error) ** 0.25 if error * tolerance < 1 else None


def substeps_from(
    model: Model, starts: np.ndarray, u: np.ndarray, w: np.ndarray | None, step: float, tolerance: float
) -> np.ndarray | None:
    """Return sub-steps (M,) that are enough by the graph alone, None if that is open.

    starts (M, n); inputs u (N, m), or (M, N, m), each path its own, and w likewise, None = 0. Raises InputError as `substeps_for`.
    """
    bound = quadrature_of(model)
    if bound is None:
        return None
    idle = np.zeros(len(model.unknown_inputs))
    sizes = [np.abs(starts), _largest(u), idle if w is None or not idle.size else _largest(w)]
    error = bound.error(*[size if size.ndim == 1 else size[0] if len(size) == 1 else np.maximum.reduce(size) for size in sizes])
    count = step * (error / tolerance) ** 0.25
    if count <= 1:
        return np.ones(len(starts), dtype=int)
    if count > 1:  # not all with one: each on its own
        each = [np.broadcast_to(size, (len(starts), size.shape[-1])) for size in sizes]
        error = np.array([bound.error(*own) for own in zip(*each, strict=True)])
    counts = np.broadcast_to(step * (np.asarray(error) / tolerance) ** 0.25, len(starts)) * (1 - 1e-12)
    if not np.isfinite(counts).all():
        return None
    if (most := float(counts.max())) > MOST:
        raise CoarseError(step, MOST, (most / MOST) ** 4, tolerance, step / ceil(most / MOST))
    return np.maximum(1, np.ceil(counts)).astype(int)


def _largest(inputs: np.ndarray) -> np.ndarray:
    """Return the largest magnitude of each input, (m,) or (M, m)."""
    return np.maximum.reduce(np.abs(inputs), axis=-2)


def _more(count: int, error: float) -> int:
    """Return more sub-steps, of the numbers 2^i and 3 2^i: as many as an error of so many tolerances asks for at order 4."""
    factor = min(_LEAP, (_SAFETY * error) ** 0.25) if isfinite(error) else _LEAP
    wanted = max(count + 1, ceil(count * factor))
    power = 1 << (wanted - 1).bit_length()
    return power // 4 * 3 if power >= 4 and power // 4 * 3 >= wanted else power


@lru_cache(CACHED)
def most_substeps(model: Model) -> int:
    """Return how many sub-steps a step of this model may have: at most 1024, and no graph of more than 600,000 operations."""
    two = chained(model, (0.5, 0.5))
    each = ca.Function("two", [two.x, two.u, two.w], [two.x_next, two.F]).n_instructions() / 2
    return max(1, min(MOST, int(_WORK / (3 * each))))
