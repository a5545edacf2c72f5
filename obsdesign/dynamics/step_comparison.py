"""Sub-steps beside finer ones, carried along paths: the errors of states and sensitivities, in tolerances."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from obsdesign.dynamics.model import Model
from obsdesign.dynamics.scan import Scan
from obsdesign.dynamics.step import CACHE_SIZE, Step, exact_step, runge_kutta

_FIRST_PART = (3 - 5**0.5) / 2  # of a sub-step, the first of the two it is checked against: no period of a motion divides both
_ERROR_RATIO = 1 / (1 - _FIRST_PART**5 - (1 - _FIRST_PART) ** 5)  # error of a sub-step over its difference from those two, at order 4
_ROUNDING = 2.0**-46  # relative, by which state and inputs are moved to see what rounding does: 64 units of it
ALIKE = 0.1  # part of a logarithm by which growths may differ that are those of the motion
ROUNDING_ALLOWANCE = 2.0  # tolerances that rounding may take beside the one that is stated
_RESIDUE = 2.0**-40  # of the largest effect that a state has on any other: less than that is none
_TINY, _HUGE = 1e-300, 1e300


@dataclass(frozen=True, eq=False)
class PathBatch:
    """M paths of N steps of `step` [s], inputs held (N, m + p) or (M, N, m + p).

    x: starts (M, n) of simulated paths, where an error of one state is in all that follow; or states (M, N, n) that are given,
    of which each step begins at one.
    """

    model: Model
    step: float
    all_inputs: np.ndarray
    x: np.ndarray

    @property
    def is_simulated(self) -> bool:
        """Whether each state follows the last."""
        return self.x.ndim == 2

    def subset(self, rows: np.ndarray) -> PathBatch:
        """Return some of the paths."""
        return PathBatch(self.model, self.step, self.all_inputs[rows] if self.all_inputs.ndim == 3 else self.all_inputs, self.x[rows])

    def beginning(self, steps: int, parts: int) -> PathBatch:
        """Return the first steps, so many at most, of simulated paths of the same motion with each step cut into parts."""
        held = self.all_inputs[..., : -(-steps // parts), :]
        return PathBatch(self.model, self.step / parts, np.repeat(held, parts, axis=-2)[..., :steps, :], self.x)


@dataclass(frozen=True, eq=False)
class StepErrors:
    """Errors (M,) in tolerances, inf where states are not finite; beyond what rounding is excused for, and beyond all it does.

    amplification (M,): what Phi makes of half a rounding unit of a state at the start of a simulated path, in that state. growth (M, 2):
    the largest entry of the diagonal of Phi of either path: where those differ, it is the steps that are unstable and not the motion.
    """

    error: np.ndarray
    beyond_rounding: np.ndarray
    amplification: np.ndarray
    growth: np.ndarray

    @property
    def is_amplified(self) -> np.ndarray:
        """Whether rounding alone makes more than what it is excused for (M,), unless the steps are unstable."""
        return self.amplification > ROUNDING_ALLOWANCE + 1

    @property
    def is_unstable(self) -> np.ndarray:
        """Whether Phi grows by steps and not by the motion (M,): ln of both growths differ by more than a tenth."""
        return ~grow_alike(*self.growth.T)

    def subset(self, rows: np.ndarray) -> StepErrors:
        """Return those of some of the paths."""
        return StepErrors(self.error[rows], self.beyond_rounding[rows], self.amplification[rows], self.growth[rows])


def grow_alike(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return whether the logarithms of two growths (M,) are within a tenth, as far as they grow at all."""
    a, b = (np.log(np.maximum(growth, 1.0)) for growth in (first, second))
    return np.abs(a - b) <= ALIKE * np.maximum(np.maximum(a, b), 1.0)


def compare_steps(paths: PathBatch, substeps: int, tolerance: float, *, with_rounding: bool = False) -> StepErrors:
    """Compare every step of so many sub-steps with finer ones, or with the exact one; with_rounding: see also what rounding does.

    Of the state, of each entry of Phi, and of dx/dw for a w that is held for good as if it were a state, relative to its size: the
    largest along the path, unless the motion has contracted it. From where Phi overflows on it is not judged.
    """
    model, M, n, p = paths.model, len(paths.x), len(paths.model.states), len(paths.model.unknown_inputs)
    exact_length = paths.step if substeps == 1 and exact_step(model, paths.step) is not None else None
    rows, steps = _rows(paths, substeps, tolerance), paths.all_inputs.shape[-2] * substeps
    starts = paths.x if paths.is_simulated else paths.x[:, 0]
    identity, zero = np.eye(n, n + p).T.ravel(), np.zeros(n)
    carry = np.hstack([starts, starts, _tile(M, identity, zero, zero, 0 * identity)])
    maxima = _peak_scan(model, exact_length).run(carry, rows, steps, carries=False).carry[:, 2 * n + identity.size :]
    size, peak, peak_Phi = np.split(maxima, [n, 2 * n], axis=1)
    rounding_carry = (zero, identity) if with_rounding else ()
    initial = [np.eye(n).ravel(), np.zeros(n * p), identity, identity, *rounding_carry, np.zeros(2), np.array([1.0, 0.0, 0.0, 0.0])]
    limits = [_rounding_allowance(size, peak_Phi, tolerance), peak, peak_Phi, _rounding_residues(size, peak_Phi)]
    carry = np.hstack([starts, starts, *limits, peak, peak_Phi, _tile(M, *initial)])
    end = _comparison_scan(model, exact_length, with_rounding).run(carry, rows, steps, carries=False).carry
    is_finite = np.isfinite(end[:, -1])
    error, beyond_rounding = (np.where(is_finite, end[:, i], np.inf) for i in (-3, -2))
    return StepErrors(error, beyond_rounding, _amplification(paths, size, peak_Phi) / tolerance, end[:, -6:-4])


def _rows(paths: PathBatch, substeps: int, tolerance: float) -> list[np.ndarray]:
    """States that are given, inputs, whether a sub-step is the first or the last of its step, and what holds for all of them."""
    N = paths.all_inputs.shape[-2]
    states = np.zeros(paths.x.shape[1]) if paths.is_simulated else np.repeat(paths.x, substeps, axis=1)
    position = np.zeros((substeps, 2))
    position[0, 0] = position[-1, 1] = 1.0
    settings = np.array([tolerance, float(paths.is_simulated), paths.step / substeps, 0.0])
    return [states, np.repeat(paths.all_inputs, substeps, axis=-2), np.tile(position, (N, 1)), settings]


def comparison_operations(model: Model) -> int:
    """Return how many operations it takes to compare a sub-step."""
    return _peak_scan(model, None).instructions + _comparison_scan(model, None, False).instructions


def _amplification(paths: PathBatch, size: np.ndarray, peak_Phi: np.ndarray) -> np.ndarray:
    """Return 2^-53 max Phi_ii (M,), of states that are not 0: no comparison sees what all steps lose alike."""
    n = size.shape[1]
    if not paths.is_simulated:
        return np.zeros(len(size))
    diagonal = np.diagonal(peak_Phi.reshape(len(size), -1, n)[:, :n], axis1=1, axis2=2)
    return 2.0**-53 * np.max(diagonal, axis=1, initial=0.0, where=size > 0)


def _rounding_allowance(size: np.ndarray, peak_Phi: np.ndarray, tolerance: float) -> np.ndarray:
    """Return how much rounding may be excused for in states (M, n): two tolerances of them, and what it may leave of 0.

    The latter is 2^-46 of what all states do to one, sum_j Phi_ij size_j.
    """
    n = size.shape[1]
    with np.errstate(over="ignore", invalid="ignore"):
        effect = np.einsum("mji,mj->mi", peak_Phi.reshape(len(size), -1, n)[:, :n], size)
    return np.maximum(ROUNDING_ALLOWANCE * tolerance * size, _ROUNDING * np.minimum(effect, _HUGE))


def _tile(paths: int, *parts: np.ndarray) -> np.ndarray:
    return np.tile(np.concatenate(parts), (paths, 1))


def _rounding_residues(size: np.ndarray, peak_Phi: np.ndarray) -> np.ndarray:
    """Return for each entry (M, (n+p) n) of Phi, by columns, how much of it may be what rounding left of 0.

    2^-40 size_i max_k Phi_kj / size_k: a part of what j does at most to any state, in sizes of the states.
    """
    n = size.shape[1]
    effect = peak_Phi.reshape(len(size), -1, n)
    with np.errstate(over="ignore", invalid="ignore"):
        relative = np.divide(effect, size[:, None], out=np.zeros_like(effect), where=size[:, None] > 0)
        return np.minimum(_RESIDUE * size[:, None] * relative.max(axis=2, keepdims=True), _HUGE).reshape(len(size), -1)


# ---------------------------------------------------------------- graphs


@dataclass(frozen=True, eq=False)
class _StepPair:
    """A sub-step of length h and what it is compared with, from the states of both: x_next, F and [0 B_w] of each; and of x nearby.

    start_and_fresh: where they start from, the states themselves or what is given.
    """

    rows: list[ca.SX]
    x: ca.SX
    x_finer: ca.SX
    start_and_fresh: tuple[ca.SX, ca.SX]
    coarse: tuple[ca.SX, ca.SX, ca.SX]
    finer: tuple[ca.SX, ca.SX, ca.SX]
    perturbed: tuple[ca.SX, ca.SX, ca.SX]


@lru_cache(CACHE_SIZE)
def _pair(model: Model, exact_length: float | None) -> _StepPair:
    """Return both as graphs of the rows; exact_length: length of a whole step that is compared with the exact one."""
    h, n = ca.SX.sym("h"), len(model.states)
    rk4_step = _function(runge_kutta(model, h), h)
    x, x_finer, given_state = (ca.SX.sym(name, n) for name in ("x", "finer", "given"))
    position, settings = ca.SX.sym("place", 2), ca.SX.sym("settings", 4)
    u, w = ca.SX.sym("u", model.u.numel()), ca.SX.sym("w", model.w.numel())
    is_given, length = position[0] * (1 - settings[1]), settings[2]
    start, finer_start = (ca.if_else(is_given, given_state, state) for state in (x, x_finer))

    def augment_step(function: ca.Function, *arguments: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Return the next state, its Jacobian, and the effect of unknown inputs as columns beside n of zeros."""
        x_next, F, B_w = function(*arguments)
        return x_next, F, ca.horzcat(ca.SX(n, n), B_w)

    exact = None if exact_length is None else exact_step(model, exact_length)
    if exact is not None:
        finer = augment_step(_function(exact, h), finer_start, u, w, length)
    else:
        middle, F_1, B_1 = augment_step(rk4_step, finer_start, u, w, _FIRST_PART * length)
        end, F_2, B_2 = augment_step(rk4_step, middle, u, w, (1 - _FIRST_PART) * length)
        finer = end, F_2 @ F_1, F_2 @ B_1 + B_2
    perturbed = augment_step(rk4_step, *((1 + _ROUNDING) * value for value in (start, u, w)), length)
    rows = [given_state, ca.vertcat(u, w), position, settings]
    return _StepPair(rows, x, x_finer, (start, is_given), augment_step(rk4_step, start, u, w, length), finer, perturbed)


def _function(step: Step, h: ca.SX) -> ca.Function:
    return ca.Function("each", [step.x, step.u, step.w, h], [step.x_next, step.F, step.B_w])


@lru_cache(CACHE_SIZE)
def _peak_scan(model: Model, exact_length: float | None) -> Scan:
    """Carry finer x, the start, finer Phi, and the largest so far of x, of its way from the start, and of Phi as long as it is finite."""
    pair, n = _pair(model, exact_length), len(model.states)
    start, size, peak = (ca.SX.sym(name, n) for name in ("start", "size", "top"))
    Phi, peak_Phi = (ca.SX.sym(name, n, n + model.w.numel()) for name in ("Phi", "top_Phi"))
    x_next, F, input_part = pair.finer
    Phi_next = F @ Phi + input_part
    size_next = ca.fmax(size, ca.fmax(ca.fabs(pair.x_finer), ca.fabs(x_next)))
    peak_next = ca.fmax(peak, ca.fmin(ca.fabs(x_next), ca.fabs(x_next - start)))
    peak_Phi_next = ca.fmax(peak_Phi, ca.if_else(ca.fabs(Phi_next) < _HUGE, ca.fabs(Phi_next), 0))
    carry = _column(pair.x_finer, start, Phi, size, peak, peak_Phi)
    return Scan(carry, pair.rows, _column(x_next, start, Phi_next, size_next, peak_next, peak_Phi_next))


@lru_cache(CACHE_SIZE)
def _comparison_scan(model: Model, exact_length: float | None, with_rounding: bool) -> Scan:
    """Carry x of both, what is largest along the path, sizes, Phi of both, the worst error so far, and beside them what rounding does.

    At the end of a step size+ = max(min(|.|, top), min(top, |F| size)), F of the whole step.
    """
    pair, n, n_columns = _pair(model, exact_length), len(model.states), len(model.states) + model.w.numel()
    allowance, peak, size = (ca.SX.sym(name, n) for name in ("excused", "top", "size"))
    peak_Phi, residue, size_Phi, Phi, finer_Phi = (
        ca.SX.sym(name, n, n_columns) for name in ("top_Phi", "residue", "size_Phi", "Phi", "finer_Phi")
    )
    F_step, B_step, growth, worst_errors = (
        ca.SX.sym("F", n, n),
        ca.SX.sym("B", n, n_columns - n),
        ca.SX.sym("growth", 2),
        ca.SX.sym("seen", 4),
    )
    (x_next, F, input_part), (x_finer, F_finer, input_part_finer) = pair.coarse, pair.finer
    (_, _, position, settings), is_alive = pair.rows, worst_errors[0]
    tolerance, is_first, is_last = settings[0], position[0], position[1]
    F_whole = F @ ca.if_else(is_first, ca.SX.eye(n), F_step)
    B_whole = F @ ca.if_else(is_first, 0 * B_step, B_step) + input_part[:, n:]
    start, is_given = pair.start_and_fresh
    Phi_next, finer_next = F @ Phi + input_part, F_finer @ finer_Phi + input_part_finer
    contracted = ca.fabs(F_whole) @ size_Phi + ca.horzcat(ca.SX(n, n), ca.fabs(B_whole))
    size_next = ca.if_else(is_last, _size_of(x_next, peak, ca.fabs(F_whole) @ size), size)
    size_Phi_next = ca.if_else(is_last, _size_of(Phi_next, peak_Phi, contracted), size_Phi)
    allowance_Phi = ca.fmax(residue, ROUNDING_ALLOWANCE * tolerance * size_Phi_next)
    rounding_x, rounding_Phi = _ROUNDING * (ca.fabs(start) + ca.fabs(x_next)), _ROUNDING * (ca.fabs(F) @ ca.fabs(Phi) + ca.fabs(input_part))
    error, error_Phi = (ca.densify(ca.fabs(value)) for value in (_ERROR_RATIO * (x_finer - x_next), _ERROR_RATIO * (finer_next - Phi_next)))
    rounding_effect, rounding_effect_Phi, rounding_carry, rounding_carry_next = ca.SX(n, 1), rounding_Phi, [], []
    if with_rounding:
        x_deviation, Phi_perturbed = ca.SX.sym("astray", n), ca.SX.sym("near_Phi", n, n_columns)
        x_perturbed, F_perturbed, input_part_perturbed = pair.perturbed
        rounding_carry, rounding_carry_next = (
            [x_deviation, Phi_perturbed],
            [F @ ca.if_else(is_given, 0 * x_deviation, x_deviation) + x_perturbed - x_next],
        )
        rounding_carry_next.append(F_perturbed @ Phi_perturbed + input_part_perturbed)
        rounding_effect, rounding_effect_Phi = ca.fabs(rounding_carry_next[0]), rounding_Phi + ca.fabs(rounding_carry_next[1] - Phi_next)
    allowed, allowed_Phi = tolerance * size_next + rounding_x + _TINY, tolerance * size_Phi_next + _TINY
    is_alive_next = is_alive * (ca.fabs(ca.sum1(_column(Phi_next, finer_next, *rounding_carry_next[1:]))) < _HUGE)
    grown = ca.vertcat(*[ca.mmax(ca.fabs(ca.diag(transition[:, :n]))) for transition in (Phi_next, finer_next)])
    growth_next = ca.fmax(growth, ca.if_else(is_alive_next, grown, 0))

    def worst_error(previous: ca.SX, allowed: ca.SX, allowed_Phi: ca.SX) -> ca.SX:
        """Return the largest error so far, in allowances, counted at the last sub-step."""
        current = ca.fmax(ca.mmax(error / allowed), ca.if_else(is_alive_next, ca.mmax(error_Phi / allowed_Phi), 0))
        return ca.fmax(previous, ca.if_else(is_last, current, 0))

    error_beyond_allowance = worst_error(
        worst_errors[1], allowed + ca.fmin(rounding_effect, allowance), allowed_Phi + ca.fmin(rounding_effect_Phi, allowance_Phi)
    )
    error_beyond_rounding = (
        worst_error(worst_errors[2], allowed + rounding_effect, allowed_Phi + rounding_effect_Phi)
        if with_rounding
        else error_beyond_allowance
    )
    is_not_finite = worst_errors[3] + settings[3] * ca.sum1(
        _column(x_next, x_finer)
    )  # NaN as soon as anything is not finite: settings[3] = 0
    carry = _column(pair.x, pair.x_finer, allowance, peak, peak_Phi, residue, size, size_Phi, F_step, B_step, Phi, finer_Phi)
    carry_next = _column(
        x_next, x_finer, allowance, peak, peak_Phi, residue, size_next, size_Phi_next, F_whole, B_whole, Phi_next, finer_next
    )
    seen_next = ca.vertcat(growth_next, is_alive_next, error_beyond_allowance, error_beyond_rounding, is_not_finite)
    return Scan(_column(carry, *rounding_carry, growth, worst_errors), pair.rows, _column(carry_next, *rounding_carry_next, seen_next))


def _size_of(value: ca.SX, peak: ca.SX, contracted: ca.SX) -> ca.SX:
    return ca.fmin(peak, ca.fmax(ca.fabs(value), contracted))


def _column(*parts: ca.SX) -> ca.SX:
    return ca.vertcat(*[ca.vec(ca.densify(part)) for part in parts])
