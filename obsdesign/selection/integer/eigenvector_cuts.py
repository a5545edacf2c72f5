"""Finishing by an integer program: lambda_min(V) >= t is v'V v >= t for every v; as many v as are needed, by HiGHS."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from obsdesign.selection.integer.local_search import polished
from obsdesign.selection.pricing.cardinality import Top, top_of
from obsdesign.selection.problem import Instance, vectors
from obsdesign.selection.relaxation.column_generation import Relaxed, closed

if TYPE_CHECKING:
    import highspy

_MOST_CHOICES = 2000  # choices K S, beyond which an integer program gets nowhere
_CLOSED = 1e-4  # of the bound: how far the linear program is cut down before choices have to be whole
_ROUNDS = 18  # of cuts to a linear program
_SHARES = (0.03, 0.12, *[1.0] * 40)  # of the time that is left, at most, for each integer program
_LEAST = 0.2  # s: what is not worth another program
_TOLERANCE = 1e-9  # of HiGHS: how far a price may be off in a linear program
_WIDENED = 1e-6  # of its bound: ten times what HiGHS calls whole, and better
_SMALL = 1e-9  # entries that HiGHS takes for 0


@dataclass(frozen=True, eq=False)
class Cut:
    """The best schedule met, its value, what no schedule is above, and how many cuts say so."""

    chosen: np.ndarray
    value: float
    bound: float
    count: int


@dataclass(frozen=True, eq=False)
class _Answer:
    """Choices (K, S), None without any, and what no schedule is above."""

    shares: np.ndarray | None
    bound: float


def cuttable(instance: Instance) -> bool:
    """Whether the problem is an integer program: a smallest eigenvalue, limits per segment and for resources, no losses."""
    plain = isinstance(instance.schedules, Top) and len(instance.kept) == 1 and instance.criterion.is_smallest_eigenvalue
    return plain and 2 <= instance.rows[..., 0].size <= _MOST_CHOICES


def cut(instance: Instance, found: Relaxed, incumbent: tuple[np.ndarray, float], gap: float, left: Callable[[], float]) -> Cut:
    """max t over t <= v'(known + sum_ks s_ks V_ks) v, s whole, within the limits, for the v of what was found so far, until time is up.

    left: seconds that are left. First the linear program is cut until its bound is that of the relaxation; its cuts then serve the
    integer program, each of whose schedules gives the next ones. Fewer demands, more schedules: every bound is valid.
    """
    program = _Program(instance, found.bound)
    program.cut(np.tensordot(found.shares, np.stack([each.W[0] for each in found.columns]), 1))
    for _ in range(_ROUNDS):
        answer = program.solved(left())
        if answer.shares is None or left() < _LEAST:
            break
        V = instance.information(answer.shares)
        program.cut(V[0])
        if instance.judged(V) >= answer.bound * (1 - _CLOSED):
            break
    (chosen, value), bound = incumbent, found.bound
    program.cut(instance.information(chosen)[0])
    for share in _SHARES:
        if left() < _LEAST or closed(value, bound, gap, instance):
            break
        answer = program.solved(share * left(), (chosen, value), gap)
        bound = min(bound, answer.bound)
        if answer.shares is None:
            break
        whole = answer.shares > 0.5
        program.cut(instance.information(whole)[0])
        if instance.keeps_limits(whole):
            better, worth = polished(instance, whole, found.dual, found.bound)
            chosen, value = (better, worth) if worth > value else (chosen, value)
    return Cut(chosen, value, max(bound, value), len(program.rows))


class _Program:
    """An integer program that grows by cuts; t is measured in units of a bound, so that it is at most 1."""

    def __init__(self, instance: Instance, unit: float) -> None:
        self.instance, self.unit = instance, unit
        self.rows: list[np.ndarray] = []  # (K S + 1,): <V_ks, v v'> and <known, v v'>, where v'diag(metric) v = 1

    def cut(self, V: np.ndarray) -> None:
        """Demand t <= v'V' v of every V' for the eigenvectors v of V (n, n), the nuisance states following the judged ones."""
        judge = self.instance.judge
        lift = judge.lift(V) / judge.D[judge.about]
        _, turned = np.linalg.eigh(lift.T @ V @ lift)
        for v in (lift @ turned).T:
            seen = self.instance.rows @ vectors(np.outer(v, v))
            row = np.maximum(np.append(seen.ravel(), v @ self.instance.known @ v), 0.0) / self.unit
            # one that is worth more than the bound lets t be what it may; small entries would be taken for 0
            self.rows.append(np.where(row > 0, np.clip(row, 2 * _SMALL, 1.0), 0.0))

    def solved(self, seconds: float, incumbent: tuple[np.ndarray, float] | None = None, gap: float = 0.0) -> _Answer:
        """Solve the program, of whole choices from an incumbent on, or else of relaxed ones."""
        import highspy  # half a second, which most problems can do without

        # a new one every time: what a time limit counts from differs between versions
        highs = highspy.Highs()
        within = min(max(0.5 * gap, 1e-9), 0.5)
        for option, setting in _options(max(seconds, 0.1), within):
            highs.setOptionValue(option, setting)
        count = self.instance.rows[..., 0].size
        least = -1.0 if incumbent is None else max(incumbent[1], 0.0) / self.unit * (1 - _WIDENED)
        self._pose(highs, least)
        if incumbent is not None:
            whole = np.full(count, highspy.HighsVarType.kInteger)
            highs.changeColsIntegrality(count, np.arange(count, dtype=np.int32), whole)
            begin = highspy.HighsSolution()
            begin.col_value = [*incumbent[0].ravel().astype(float).tolist(), least]
            highs.setSolution(begin)
        highs.run()
        info, values = highs.getInfo(), np.array(highs.getSolution().col_value)
        optimal = highs.getModelStatus() == highspy.HighsModelStatus.kOptimal
        seen = len(values) > 0 and (optimal or incumbent is not None)
        bound = np.inf
        if incumbent is None and optimal:
            bound = -info.objective_function_value
        elif incumbent is not None and seen and np.isfinite(info.mip_dual_bound):
            # branches that are better than its schedule by less than the gap asked for are cut off
            bound = max(-info.mip_dual_bound, values[-1] / (1 - within))
        shares = np.clip(values[:-1], 0.0, 1.0).reshape(self.instance.shape) if seen else None
        return _Answer(shares, float(bound) * self.unit * (1 + _widened(count)))

    def _pose(self, highs: highspy.Highs, least: float) -> None:
        instance, schedules = self.instance, top_of(self.instance.schedules)
        K, S = instance.shape
        most = np.append(schedules.available.ravel().astype(float), 1.0 + _WIDENED)
        highs.addVars(K * S + 1, np.append(np.zeros(K * S), least), most)
        highs.changeColCost(K * S, -1.0)
        for k in range(K):
            _add(highs, -np.inf, float(schedules.per_segment), np.arange(k * S, (k + 1) * S), np.ones(S))
        for resource in instance.resources:
            room = resource.limit + 1e-9 * max(1.0, resource.limit)  # as everywhere
            usage = np.minimum(resource.usage.ravel() / room, 2.0)
            used = np.flatnonzero(usage)
            _add(highs, -np.inf, 1.0, used, usage[used])
        for row in self.rows:
            _add(highs, -row[-1], np.inf, np.arange(K * S + 1), np.append(row[:-1], -1.0))


def _add(highs: highspy.Highs, low: float, high: float, where: np.ndarray, what: np.ndarray) -> None:
    highs.addRow(low, high, len(where), where.astype(np.int32), what)


def _widened(count: int) -> float:
    """What HiGHS's tolerances may take off a bound, in units of it: choices (count,) between 0 and 1 at prices that are a little off."""
    return _WIDENED + 2 * _TOLERANCE * count


def _options(seconds: float, within: float) -> tuple[tuple[str, float | int | bool], ...]:
    return (
        ("output_flag", False),
        ("threads", 1),
        ("random_seed", 0),
        ("time_limit", float(seconds)),
        ("mip_rel_gap", within),
        ("mip_abs_gap", 1e-9),
        ("mip_heuristic_effort", 0.0),  # schedules are found by exchange; what is wanted is the bound
        ("mip_feasibility_tolerance", 1e-7),
        ("primal_feasibility_tolerance", _TOLERANCE),
        ("dual_feasibility_tolerance", _TOLERANCE),
    )


def note_of(result: Cut) -> str:
    """Say whose bound it is."""
    widened = _widened(result.chosen.size)
    return f"bound by an integer program of {result.count} cuts, by HiGHS, widened by {widened:.1e} of itself for its tolerances"
