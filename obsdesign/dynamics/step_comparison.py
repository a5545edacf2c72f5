"""Sub-steps beside finer ones, carried along paths: the errors of states and sensitivities, in tolerances."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from obsdesign.dynamics.model import Model
from obsdesign.dynamics.scan import Scan
from obsdesign.dynamics.step import CACHED, Step, exact_step, runge_kutta

_PART = (3 - 5**0.5) / 2  # of a sub-step, the first of the two it is checked against: no period of a motion divides both
_SHARE = 1 / (1 - _PART**5 - (1 - _PART) ** 5)  # error of a sub-step over its difference from those two, at order 4
_ROUNDING = 2.0**-46  # relative, by which state and inputs are moved to see what rounding does: 64 units of it
ALIKE = 0.1  # part of a logarithm by which growths may differ that are those of the motion
EXCUSED = 2.0  # tolerances that rounding may take beside the one that is stated
_RESIDUE = 2.0**-40  # of the largest effect that a state has on any other: less than that is none
_TINY, _HUGE = 1e-300, 1e300


@dataclass(frozen=True, eq=False)
class Walks:
    """M paths of N steps of `step` [s], inputs held (N, m + p) or (M, N, m + p).

    x: starts (M, n) of simulated paths, where an error of one state is in all that follow; or states (M, N, n) that are given,
    of which each step begins at one.
    """

    model: Model
    step: float
    held: np.ndarray
    x: np.ndarray

    @property
    def simulated(self) -> bool:
        """Whether each state follows the last."""
        return self.x.ndim == 2

    def some(self, rows: np.ndarray) -> Walks:
        """Return some of the paths."""
        return Walks(self.model, self.step, self.held[rows] if self.held.ndim == 3 else self.held, self.x[rows])

    def beginning(self, steps: int, parts: int) -> Walks:
        """Return the first steps, so many at most, of simulated paths of the same motion with each step cut into parts."""
        held = self.held[..., : -(-steps // parts), :]
        return Walks(self.model, self.step / parts, np.repeat(held, parts, axis=-2)[..., :steps, :], self.x)


@dataclass(frozen=True, eq=False)
class Compared:
    """Errors (M,) in tolerances, inf where states are not finite; beyond what rounding is excused for, and beyond all it does.

    amplified (M,): what Phi makes of half a rounding unit of a state at the start of a simulated path, in that state. growth (M, 2):
    the largest entry of the diagonal of Phi of either path: where those differ, it is the steps that are unstable and not the motion.
    """

    error: np.ndarray
    beyond_rounding: np.ndarray
    amplified: np.ndarray
    growth: np.ndarray

    @property
    def is_amplified(self) -> np.ndarray:
        """Whether rounding alone makes more than what it is excused for (M,), unless the steps are unstable."""
        return self.amplified > EXCUSED + 1

    @property
    def is_unstable(self) -> np.ndarray:
        """Whether Phi grows by steps and not by the motion (M,): ln of both growths differ by more than a tenth."""
        return ~alike(*self.growth.T)

    def some(self, rows: np.ndarray) -> Compared:
        """Return those of some of the paths."""
        return Compared(self.error[rows], self.beyond_rounding[rows], self.amplified[rows], self.growth[rows])


def alike(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return whether the logarithms of two growths (M,) are within a tenth, as far as they grow at all."""
    a, b = (np.log(np.maximum(each, 1.0)) for each in (first, second))
    return np.abs(a - b) <= ALIKE * np.maximum(np.maximum(a, b), 1.0)


def compared(walks: Walks, substeps: int, tolerance: float, *, rounding: bool = False) -> Compared:
    """Compare every step of so many sub-steps with finer ones, or with the exact one; rounding: see also what rounding does.

    Of the state, of each entry of Phi, and of dx/dw for a w that is held for good as if it were a state, relative to its size: the
    largest along the path, unless the motion has contracted it. From where Phi overflows on it is not judged.
    """
    model, M, n, p = walks.model, len(walks.x), len(walks.model.states), len(walks.model.unknown_inputs)
    pace = walks.step if substeps == 1 and exact_step(model, walks.step) is not None else None
    rows, steps = _rows(walks, substeps, tolerance), walks.held.shape[-2] * substeps
    starts = walks.x if walks.simulated else walks.x[:, 0]
    identity, zero = np.eye(n, n + p).T.ravel(), np.zeros(n)
    carry = np.hstack([starts, starts, _tiled(M, identity, zero, zero, 0 * identity)])
    found = _tops(model, pace).run(carry, rows, steps, carries=False).carry[:, 2 * n + identity.size :]
    size, top, top_Phi = np.split(found, [n, 2 * n], axis=1)
    moved = (zero, identity) if rounding else ()
    last = [np.eye(n).ravel(), np.zeros(n * p), identity, identity, *moved, np.zeros(2), np.array([1.0, 0.0, 0.0, 0.0])]
    shares = [_excused(size, top_Phi, tolerance), top, top_Phi, _residues(size, top_Phi)]
    carry = np.hstack([starts, starts, *shares, top, top_Phi, _tiled(M, *last)])
    end = _comparison(model, pace, rounding).run(carry, rows, steps, carries=False).carry
    whole = np.isfinite(end[:, -1])
    error, beyond = (np.where(whole, end[:, i], np.inf) for i in (-3, -2))
    return Compared(error, beyond, _amplified(walks, size, top_Phi) / tolerance, end[:, -6:-4])


def _rows(walks: Walks, substeps: int, tolerance: float) -> list[np.ndarray]:
    """States that are given, inputs, whether a sub-step is the first or the last of its step, and what holds for all of them."""
    N = walks.held.shape[-2]
    given = np.zeros(walks.x.shape[1]) if walks.simulated else np.repeat(walks.x, substeps, axis=1)
    place = np.zeros((substeps, 2))
    place[0, 0] = place[-1, 1] = 1.0
    settings = np.array([tolerance, float(walks.simulated), walks.step / substeps, 0.0])
    return [given, np.repeat(walks.held, substeps, axis=-2), np.tile(place, (N, 1)), settings]


def operations(model: Model) -> int:
    """Return how many operations it takes to compare a sub-step."""
    return _tops(model, None).instructions + _comparison(model, None, False).instructions


def _amplified(walks: Walks, size: np.ndarray, top_Phi: np.ndarray) -> np.ndarray:
    """Return 2^-53 max Phi_ii (M,), of states that are not 0: no comparison sees what all steps lose alike."""
    n = size.shape[1]
    if not walks.simulated:
        return np.zeros(len(size))
    diagonal = np.diagonal(top_Phi.reshape(len(size), -1, n)[:, :n], axis1=1, axis2=2)
    return 2.0**-53 * np.max(diagonal, axis=1, initial=0.0, where=size > 0)


def _excused(size: np.ndarray, top_Phi: np.ndarray, tolerance: float) -> np.ndarray:
    """Return how much rounding may be excused for in states (M, n): two tolerances of them, and what it may leave of 0.

    The latter is 2^-46 of what all states do to one, sum_j Phi_ij size_j.
    """
    n = size.shape[1]
    with np.errstate(over="ignore", invalid="ignore"):
        effect = np.einsum("mji,mj->mi", top_Phi.reshape(len(size), -1, n)[:, :n], size)
    return np.maximum(EXCUSED * tolerance * size, _ROUNDING * np.minimum(effect, _HUGE))


def _tiled(paths: int, *parts: np.ndarray) -> np.ndarray:
    return np.tile(np.concatenate(parts), (paths, 1))


def _residues(size: np.ndarray, top_Phi: np.ndarray) -> np.ndarray:
    """Return for each entry (M, (n+p) n) of Phi, by columns, how much of it may be what rounding left of 0.

    2^-40 size_i max_k Phi_kj / size_k: a part of what j does at most to any state, in sizes of the states.
    """
    n = size.shape[1]
    effect = top_Phi.reshape(len(size), -1, n)
    with np.errstate(over="ignore", invalid="ignore"):
        relative = np.divide(effect, size[:, None], out=np.zeros_like(effect), where=size[:, None] > 0)
        return np.minimum(_RESIDUE * size[:, None] * relative.max(axis=2, keepdims=True), _HUGE).reshape(len(size), -1)


# ---------------------------------------------------------------- graphs


@dataclass(frozen=True, eq=False)
class _Pair:
    """A sub-step of length h and what it is compared with, from the states of both: x_next, F and [0 B_w] of each; and of x nearby.

    begins: where they start from, the states themselves or what is given.
    """

    rows: list[ca.SX]
    x: ca.SX
    x_finer: ca.SX
    begins: tuple[ca.SX, ca.SX]
    one: tuple[ca.SX, ca.SX, ca.SX]
    finer: tuple[ca.SX, ca.SX, ca.SX]
    near: tuple[ca.SX, ca.SX, ca.SX]


@lru_cache(CACHED)
def _pair(model: Model, pace: float | None) -> _Pair:
    """Return both as graphs of the rows; pace: length of a whole step that is compared with the exact one."""
    h, n = ca.SX.sym("h"), len(model.states)
    each = _function(runge_kutta(model, h), h)
    x, x_finer, given = (ca.SX.sym(name, n) for name in ("x", "finer", "given"))
    place, settings = ca.SX.sym("place", 2), ca.SX.sym("settings", 4)
    u, w = ca.SX.sym("u", model.u.numel()), ca.SX.sym("w", model.w.numel())
    fresh, length = place[0] * (1 - settings[1]), settings[2]
    start, finer_start = (ca.if_else(fresh, given, each) for each in (x, x_finer))

    def taken(function: ca.Function, *arguments: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        x_next, F, B_w = function(*arguments)
        return x_next, F, ca.horzcat(ca.SX(n, n), B_w)

    exact = None if pace is None else exact_step(model, pace)
    if exact is not None:
        finer = taken(_function(exact, h), finer_start, u, w, length)
    else:
        middle, F_1, B_1 = taken(each, finer_start, u, w, _PART * length)
        end, F_2, B_2 = taken(each, middle, u, w, (1 - _PART) * length)
        finer = end, F_2 @ F_1, F_2 @ B_1 + B_2
    near = taken(each, *((1 + _ROUNDING) * value for value in (start, u, w)), length)
    rows = [given, ca.vertcat(u, w), place, settings]
    return _Pair(rows, x, x_finer, (start, fresh), taken(each, start, u, w, length), finer, near)


def _function(step: Step, h: ca.SX) -> ca.Function:
    return ca.Function("each", [step.x, step.u, step.w, h], [step.x_next, step.F, step.B_w])


@lru_cache(CACHED)
def _tops(model: Model, pace: float | None) -> Scan:
    """Carry finer x, the start, finer Phi, and the largest so far of x, of its way from the start, and of Phi as long as it is finite."""
    pair, n = _pair(model, pace), len(model.states)
    start, size, top = (ca.SX.sym(name, n) for name in ("start", "size", "top"))
    Phi, top_Phi = (ca.SX.sym(name, n, n + model.w.numel()) for name in ("Phi", "top_Phi"))
    x_next, F, forced = pair.finer
    Phi_next = F @ Phi + forced
    size_next = ca.fmax(size, ca.fmax(ca.fabs(pair.x_finer), ca.fabs(x_next)))
    top_next = ca.fmax(top, ca.fmin(ca.fabs(x_next), ca.fabs(x_next - start)))
    top_Phi_next = ca.fmax(top_Phi, ca.if_else(ca.fabs(Phi_next) < _HUGE, ca.fabs(Phi_next), 0))
    carry = _column(pair.x_finer, start, Phi, size, top, top_Phi)
    return Scan(carry, pair.rows, _column(x_next, start, Phi_next, size_next, top_next, top_Phi_next))


@lru_cache(CACHED)
def _comparison(model: Model, pace: float | None, rounding: bool) -> Scan:
    """Carry x of both, what is largest along the path, sizes, Phi of both, the worst error so far, and beside them what rounding does.

    At the end of a step size+ = max(min(|.|, top), min(top, |F| size)), F of the whole step.
    """
    pair, n, wide = _pair(model, pace), len(model.states), len(model.states) + model.w.numel()
    excused, top, size = (ca.SX.sym(name, n) for name in ("excused", "top", "size"))
    top_Phi, residue, size_Phi, Phi, finer_Phi = (
        ca.SX.sym(name, n, wide) for name in ("top_Phi", "residue", "size_Phi", "Phi", "finer_Phi")
    )
    F_step, B_step, growth, seen = ca.SX.sym("F", n, n), ca.SX.sym("B", n, wide - n), ca.SX.sym("growth", 2), ca.SX.sym("seen", 4)
    (x_next, F, forced), (x_finer, F_finer, forced_finer) = pair.one, pair.finer
    (_, _, place, settings), alive = pair.rows, seen[0]
    tolerance, begins, ends = settings[0], place[0], place[1]
    F_whole = F @ ca.if_else(begins, ca.SX.eye(n), F_step)
    B_whole = F @ ca.if_else(begins, 0 * B_step, B_step) + forced[:, n:]
    start, fresh = pair.begins
    Phi_next, finer_next = F @ Phi + forced, F_finer @ finer_Phi + forced_finer
    contracted = ca.fabs(F_whole) @ size_Phi + ca.horzcat(ca.SX(n, n), ca.fabs(B_whole))
    size_next = ca.if_else(ends, _sized(x_next, top, ca.fabs(F_whole) @ size), size)
    size_Phi_next = ca.if_else(ends, _sized(Phi_next, top_Phi, contracted), size_Phi)
    excused_Phi = ca.fmax(residue, EXCUSED * tolerance * size_Phi_next)
    stored, added = _ROUNDING * (ca.fabs(start) + ca.fabs(x_next)), _ROUNDING * (ca.fabs(F) @ ca.fabs(Phi) + ca.fabs(forced))
    off, off_Phi = (ca.densify(ca.fabs(value)) for value in (_SHARE * (x_finer - x_next), _SHARE * (finer_next - Phi_next)))
    lost, lost_Phi, moved, moved_next = ca.SX(n, 1), added, [], []
    if rounding:
        astray, Phi_near = ca.SX.sym("astray", n), ca.SX.sym("near_Phi", n, wide)
        x_near, F_near, forced_near = pair.near
        moved, moved_next = [astray, Phi_near], [F @ ca.if_else(fresh, 0 * astray, astray) + x_near - x_next]
        moved_next.append(F_near @ Phi_near + forced_near)
        lost, lost_Phi = ca.fabs(moved_next[0]), added + ca.fabs(moved_next[1] - Phi_next)
    allowed, allowed_Phi = tolerance * size_next + stored + _TINY, tolerance * size_Phi_next + _TINY
    alive_next = alive * (ca.fabs(ca.sum1(_column(Phi_next, finer_next, *moved_next[1:]))) < _HUGE)
    grown = ca.vertcat(*[ca.mmax(ca.fabs(ca.diag(each[:, :n]))) for each in (Phi_next, finer_next)])
    growth_next = ca.fmax(growth, ca.if_else(alive_next, grown, 0))

    def worst(before: ca.SX, allowed: ca.SX, allowed_Phi: ca.SX) -> ca.SX:
        now = ca.fmax(ca.mmax(off / allowed), ca.if_else(alive_next, ca.mmax(off_Phi / allowed_Phi), 0))
        return ca.fmax(before, ca.if_else(ends, now, 0))

    capped = worst(seen[1], allowed + ca.fmin(lost, excused), allowed_Phi + ca.fmin(lost_Phi, excused_Phi))
    beyond = worst(seen[2], allowed + lost, allowed_Phi + lost_Phi) if rounding else capped
    spoiled = seen[3] + settings[3] * ca.sum1(_column(x_next, x_finer))  # NaN as soon as anything is not finite: settings[3] = 0
    carry = _column(pair.x, pair.x_finer, excused, top, top_Phi, residue, size, size_Phi, F_step, B_step, Phi, finer_Phi)
    carry_next = _column(x_next, x_finer, excused, top, top_Phi, residue, size_next, size_Phi_next, F_whole, B_whole, Phi_next, finer_next)
    seen_next = ca.vertcat(growth_next, alive_next, capped, beyond, spoiled)
    return Scan(_column(carry, *moved, growth, seen), pair.rows, _column(carry_next, *moved_next, seen_next))


def _sized(value: ca.SX, top: ca.SX, contracted: ca.SX) -> ca.SX:
    return ca.fmin(top, ca.fmax(ca.fabs(value), contracted))


def _column(*parts: ca.SX) -> ca.SX:
    return ca.vertcat(*[ca.vec(ca.densify(part)) for part in parts])
