"""How many sub-steps the steps along a path need for a tolerance in state and sensitivity."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import ceil, floor, inf, isfinite, log10

import casadi as ca
import numpy as np

from obsdesign.dynamics.model import Model
from obsdesign.dynamics.quadrature import quadrature_of
from obsdesign.dynamics.step import CACHE_SIZE, chain_steps, exact_step
from obsdesign.dynamics.step_comparison import (
    ALIKE,
    ROUNDING_ALLOWANCE,
    PathBatch,
    StepErrors,
    compare_steps,
    comparison_operations,
    grow_alike,
)
from obsdesign.errors import InputError

MAX_SUBSTEPS = 1024  # sub-steps of one step
_MAX_OPERATIONS = 600_000  # operations that a step and its check may have together
_MAX_TRIAL_OPERATIONS = 400_000_000  # operations, about, that it may take to try a step that would do
_MAX_PARTS = 1 << 22  # parts of a step
_FIRST_STEPS = 16  # steps that are looked at first: most motions that run away do so at once
_CALM = 10.0  # growth of a sensitivity, at most, where a stretch of a path speaks for all of it
_SAFETY, _MAX_GROWTH = 1.5, 8.0  # on an error where the number of sub-steps is chosen for it; most by which that grows at a time


class CoarseStepError(InputError):
    """A step is too coarse for the dynamics, with as many sub-steps as can be made: by a factor of `error` tolerances.

    sufficient_step: a step that would do, None where none was found; is_verified: over how many seconds of the path it was tried out, inf
    for all of it, 0 for an estimate.
    """

    def __init__(
        self, step: float, count: int, error: float, tolerance: float, sufficient_step: float | None = None, is_verified: float = np.inf
    ) -> None:
        self.arguments, self.sufficient_step = (step, count, error, tolerance, sufficient_step, is_verified), sufficient_step
        message = f"a step of {step:g} s is too coarse for these dynamics: even {count} sub-steps "
        message += f"miss the tolerance of {tolerance:g} by a factor of {error:.2g}" if isfinite(error) else "leave the finite numbers"
        if sufficient_step is None:
            advice = "the motion runs away, or it needs a step much smaller"
        elif is_verified:
            advice = f"a step of {sufficient_step:.12g} s would do" + (
                f", tried over the first {is_verified:.3g} s" if isfinite(is_verified) else ""
            )
        else:
            advice = f"it is estimated that a step of {sufficient_step:.2g} s would do"
        super().__init__(f"{message}; {advice}")

    def __reduce__(self) -> tuple[type, tuple[object, ...]]:
        return type(self), self.arguments


class RoundingError(InputError):
    """The rounding of doubles moves states or sensitivities by more than the tolerance, however small the steps are."""

    def __init__(self, step: float, error: float, tolerance: float) -> None:
        self.arguments = step, error, tolerance
        required = 2 * error * tolerance
        digits = 10.0 ** floor(log10(required))
        sufficient = ceil(required / digits) * digits
        advice = f"a tolerance of {sufficient:g} is met, or a shorter path" if sufficient < 0.1 else "only a shorter path would do"
        super().__init__(
            f"the motion amplifies the rounding of doubles to {error:.2g} tolerances of {tolerance:g} along this path,"
            f" however small its steps of {step:g} s are made: {advice}"
        )

    def __reduce__(self) -> tuple[type, tuple[object, ...]]:
        return type(self), self.arguments


def substeps_for(paths: PathBatch, tolerance: float) -> np.ndarray:
    """Return for each path the fewest sub-steps (M,) that meet the tolerance, of those tried.

    By comparing steps with finer ones and taking more as order 4 has it: for what `substeps_from` leaves open.
    Raises InputError where more sub-steps than can be made would be needed, with a step that would do, tried out; and where
    rounding alone is above the tolerance.
    """
    model, step = paths.model, paths.step
    upper, exact = max_substeps(model), exact_step(model, step) is not None
    counts = np.ones(len(paths.x), dtype=int)
    queue = [(np.arange(len(counts)), 1, _TrialErrors(np.full(len(counts), inf), np.zeros(len(counts), dtype=bool), np.zeros(len(counts))))]
    while queue:
        rows, count, previous_error = queue.pop()
        counts[rows] = count
        if exact and count > 1:
            continue
        batch = paths.subset(rows)
        current_errors = _substep_errors(batch, count, tolerance, previous_error)
        is_missed, next_counts = (
            current_errors.error > 1,
            np.array([2 if exact else min(upper, _increase(count, path_error)) for path_error in current_errors.error]),
        )
        if is_missed.any() and count >= upper:
            raise _coarse_step_error(
                batch.subset(np.flatnonzero(is_missed)[:1]), count, float(current_errors.error[is_missed][0]), tolerance
            )
        for next_count in np.unique(next_counts[is_missed]):
            is_selected = is_missed & (next_counts == next_count)
            queue.append((rows[is_selected], int(next_count), current_errors.subset(is_selected)))
    return counts


@dataclass(frozen=True, eq=False)
class _TrialErrors:
    """What was found with some number of sub-steps (M,): the error in tolerances; whether rounding explains it; how much Phi grows.

    growth: 0 where it is not above what rounding is excused for, by far, or where steps are unstable.
    """

    error: np.ndarray
    rounded: np.ndarray
    growth: np.ndarray

    def subset(self, rows: np.ndarray) -> _TrialErrors:
        """Return those of some of the paths."""
        return _TrialErrors(self.error[rows], self.rounded[rows], self.growth[rows])


def _substep_errors(paths: PathBatch, count: int, tolerance: float, previous_error: _TrialErrors) -> _TrialErrors:
    """Return the errors, with what was found with fewer sub-steps; inf where steps are unstable.

    Rounding is excused for up to two tolerances. Raises RoundingError where it explains the whole error twice in a row, and where Phi
    makes more of it, by far, twice in a row and alike.
    """
    if count > _MAX_GROWTH and paths.is_simulated and _runs_away(paths, count, tolerance):
        return _TrialErrors(np.full(len(paths.x), inf), np.zeros(len(paths.x), dtype=bool), np.zeros(len(paths.x)))
    comparison = compare_steps(paths, count, tolerance)
    error = np.where(comparison.is_amplified & comparison.is_unstable, inf, comparison.error)
    is_rounding = np.zeros(len(error), dtype=bool)
    slow = np.flatnonzero((error > 1) & ((count == 1) | (error > previous_error.error / 2)) & np.isfinite(error))
    if len(slow):
        comparison_with_rounding = compare_steps(paths.subset(slow), count, tolerance, with_rounding=True)
        error[slow], is_rounding[slow] = (
            comparison_with_rounding.error,
            (comparison_with_rounding.beyond_rounding <= 1) & (comparison_with_rounding.error > 1),
        )
        lost_paths = np.flatnonzero(is_rounding & previous_error.rounded)
        if count > 1 and len(lost_paths):
            raise RoundingError(paths.step, float(error[lost_paths[0]]), tolerance)
    growth = _large_growth(comparison)
    lost_paths = (error <= 1) & comparison.is_amplified | (np.minimum(growth, previous_error.growth) > 0) & grow_alike(
        growth, previous_error.growth
    )
    if lost_paths.any():
        raise RoundingError(paths.step, float(comparison.amplification[lost_paths].max()), tolerance)
    return _TrialErrors(error, is_rounding & (count > 1), growth)


def _large_growth(comparison: StepErrors) -> np.ndarray:
    """Return how much Phi grows (M,) where that is above what rounding is excused for by more than growths that are alike differ."""
    growth = comparison.growth.min(axis=1)
    far = comparison.amplification > (ROUNDING_ALLOWANCE + 1) * np.maximum(growth, 1.0) ** ALIKE
    return np.where(far & ~comparison.is_unstable, growth, 0.0)


def _runs_away(paths: PathBatch, count: int, tolerance: float) -> bool:
    """Tell whether all paths leave the finite numbers within their first steps."""
    short = PathBatch(paths.model, paths.step, paths.all_inputs[..., :_FIRST_STEPS, :], paths.x)
    return paths.all_inputs.shape[-2] > _FIRST_STEPS and bool(np.isinf(compare_steps(short, count, tolerance).error).all())


def _coarse_step_error(paths: PathBatch, count: int, error: float, tolerance: float) -> CoarseStepError:
    """Return the refusal of a path, with parts of the step that were found to do, with as many sub-steps as they may have.

    They are tried along the whole path. Where that takes too long: along its beginning, if longer steps failed within that and
    sensitivities do not grow; else it is an estimate by order 4, as where states are given.
    """
    parts, current_error, estimate, failed = (
        1,
        error,
        _estimate_step(paths.step, error, tolerance),
        0.0,
    )  # seconds within which longer steps failed
    operations_per_step = comparison_operations(paths.model) * count
    affordable = 2 * _MAX_TRIAL_OPERATIONS // (operations_per_step * paths.all_inputs.shape[-2])
    while paths.is_simulated and parts < _MAX_PARTS:
        parts = _increase(parts, current_error) if failed else min(_increase(parts, current_error), max(parts + 1, affordable))
        split = paths.beginning(max(_MAX_TRIAL_OPERATIONS // operations_per_step, ceil(failed * parts / paths.step)), parts)
        if _runs_away(split, count, tolerance):
            current_error, failed = inf, split.step * _FIRST_STEPS
            continue
        steps = split.all_inputs.shape[-2]
        whole = steps == parts * paths.all_inputs.shape[-2]
        if steps * operations_per_step > 2 * _MAX_TRIAL_OPERATIONS or not (whole or failed):
            estimate = estimate or _step_from_beginning(split, count, current_error, tolerance, parts * paths.all_inputs.shape[-2])
            break
        previous_error, comparison = current_error, compare_steps(split, count, tolerance)
        current_error = float(comparison.error[0])
        estimate = _estimate_step(split.step, current_error, tolerance) or estimate
        if current_error <= 1 and (whole or comparison.growth.max() <= _CALM):
            return CoarseStepError(paths.step, count, error, tolerance, split.step, inf if whole else steps * split.step)
        if current_error <= 1:  # it may not do later on
            break
        if current_error > previous_error / 2 and current_error * tolerance < 1:  # finer ones do not help
            estimate = None
            break
    return CoarseStepError(paths.step, count, error, tolerance, estimate, 0.0)


def _step_from_beginning(paths: PathBatch, count: int, previous_error: float, tolerance: float, steps: int) -> float | None:
    """Return a step that would do if so many steps add errors as the first do, None where a longer one left the finite numbers."""
    if not isfinite(previous_error):
        return None
    error = float(compare_steps(paths.beginning(_FIRST_STEPS, 1), count, tolerance).error[0]) * max(1.0, steps / _FIRST_STEPS)
    return paths.step if error <= 1 else _estimate_step(paths.step, error, tolerance)


def _estimate_step(step: float, error: float, tolerance: float) -> float | None:
    """Return a step that would do by order 4, None where the error is as large as what it is an error of."""
    return step / (_SAFETY * error) ** 0.25 if error * tolerance < 1 else None


def substeps_from(
    model: Model, starts: np.ndarray, u: np.ndarray, w: np.ndarray | None, step: float, tolerance: float
) -> np.ndarray | None:
    """Return sub-steps (M,) that are enough by the graph alone, None if that is open.

    starts (M, n); inputs u (N, m), or (M, N, m), each path its own, and w likewise, None = 0. Raises InputError as `substeps_for`.
    """
    if model.period is not None:
        return np.ones(len(starts), dtype=int)
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
        path_sizes = [np.broadcast_to(size, (len(starts), size.shape[-1])) for size in sizes]
        error = np.array([bound.error(*sizes_of_path) for sizes_of_path in zip(*path_sizes, strict=True)])
    counts = np.broadcast_to(step * (np.asarray(error) / tolerance) ** 0.25, len(starts)) * (1 - 1e-12)
    if not np.isfinite(counts).all():
        return None
    if (max_count := float(counts.max())) > MAX_SUBSTEPS:
        raise CoarseStepError(step, MAX_SUBSTEPS, (max_count / MAX_SUBSTEPS) ** 4, tolerance, step / ceil(max_count / MAX_SUBSTEPS))
    return np.maximum(1, np.ceil(counts)).astype(int)


def _largest(inputs: np.ndarray) -> np.ndarray:
    """Return the largest magnitude of each input, (m,) or (M, m)."""
    return np.maximum.reduce(np.abs(inputs), axis=-2)


def _increase(count: int, error: float) -> int:
    """Return more sub-steps, of the numbers 2^i and 3 2^i: as many as an error of so many tolerances asks for at order 4."""
    factor = min(_MAX_GROWTH, (_SAFETY * error) ** 0.25) if isfinite(error) else _MAX_GROWTH
    target = max(count + 1, ceil(count * factor))
    power = 1 << (target - 1).bit_length()
    return power // 4 * 3 if power >= 4 and power // 4 * 3 >= target else power


@lru_cache(CACHE_SIZE)
def max_substeps(model: Model) -> int:
    """Return how many sub-steps a step of this model may have: at most 1024, and no graph of more than 600,000 operations."""
    two_steps = chain_steps(model, (0.5, 0.5))
    operations = ca.Function("two", [two_steps.x, two_steps.u, two_steps.w], [two_steps.x_next, two_steps.F]).n_instructions() / 2
    return max(1, min(MAX_SUBSTEPS, int(_MAX_OPERATIONS / (3 * operations))))
