"""Finishing by an integer program: lambda_min(V) >= t is v'V v >= t for every v; as many v as are needed, by HiGHS."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from obsdesign.conic import svec
from obsdesign.selection.integer.local_search import improve_by_exchange
from obsdesign.selection.pricing.cardinality import CardinalitySchedules, top_of
from obsdesign.selection.problem import SelectionProblem
from obsdesign.selection.relaxation.column_generation import RelaxedSolution, is_gap_closed

if TYPE_CHECKING:
    import highspy

_MAX_CHOICES = 2000  # choices K S, beyond which an integer program gets nowhere
_RELAXATION_GAP = 1e-4  # of the bound: how far the linear program is cut down before choices have to be whole
_ROUNDS = 18  # of cuts to a linear program
_TIME_SHARES = (0.03, 0.12, *[1.0] * 40)  # of the time that is left, at most, for each integer program
_MIN_SECONDS = 0.2  # s: what is not worth another program
_TOLERANCE = 1e-9  # of HiGHS: how far a price may be off in a linear program
_INTEGRALITY_MARGIN = 1e-6  # of its bound: ten times what HiGHS calls whole, and better
_ZERO_COEFFICIENT = 1e-9  # entries that HiGHS takes for 0


@dataclass(frozen=True, eq=False)
class CutResult:
    """The best schedule met, its value, what no schedule is above, and how many cuts say so."""

    chosen: np.ndarray
    value: float
    bound: float
    cuts: int


@dataclass(frozen=True, eq=False)
class _ProgramSolution:
    """Choices (K, S), None without any, and what no schedule is above."""

    shares: np.ndarray | None
    bound: float


def is_integer_program(instance: SelectionProblem) -> bool:
    """Whether the problem is an integer program: a smallest eigenvalue, limits per segment and for resources, no losses."""
    plain = (
        isinstance(instance.schedules, CardinalitySchedules)
        and len(instance.working_sensors) == 1
        and instance.criterion.is_smallest_eigenvalue
    )
    return plain and 2 <= instance.block_vectors[..., 0].size <= _MAX_CHOICES


def solve_by_cuts(
    instance: SelectionProblem, relaxation: RelaxedSolution, incumbent: tuple[np.ndarray, float], gap: float, time_left: Callable[[], float]
) -> CutResult:
    """max t over t <= v'(known + sum_ks s_ks V_ks) v, s whole, within the limits, for the v of what was found so far, until time is up.

    time_left: seconds that are left. First the linear program is cut until its bound is that of the relaxation; its cuts then serve the
    integer program, each of whose schedules gives the next ones. Fewer demands, more schedules: every bound is valid.
    """
    program = _CutProgram(instance, relaxation.bound)
    program.add_cuts(np.tensordot(relaxation.shares, np.stack([column.W[0] for column in relaxation.columns]), 1))
    for _ in range(_ROUNDS):
        solution = program.solve(time_left())
        if solution.shares is None or time_left() < _MIN_SECONDS:
            break
        V = instance.information(solution.shares)
        program.add_cuts(V[0])
        if instance.mixture_value(V) >= solution.bound * (1 - _RELAXATION_GAP):
            break
    (chosen, value), bound = incumbent, relaxation.bound
    program.add_cuts(instance.information(chosen)[0])
    for time_share in _TIME_SHARES:
        if time_left() < _MIN_SECONDS or is_gap_closed(value, bound, gap, instance):
            break
        solution = program.solve(time_share * time_left(), (chosen, value), gap)
        bound = min(bound, solution.bound)
        if solution.shares is None:
            break
        rounded = solution.shares > 0.5
        program.add_cuts(instance.information(rounded)[0])
        if instance.is_within_limits(rounded):
            improved, improved_value = improve_by_exchange(instance, rounded, relaxation.dual, relaxation.bound)
            chosen, value = (improved, improved_value) if improved_value > value else (chosen, value)
    return CutResult(chosen, value, max(bound, value), len(program.rows))


class _CutProgram:
    """An integer program that grows by cuts; t is measured in units of a bound, so that it is at most 1."""

    def __init__(self, instance: SelectionProblem, unit: float) -> None:
        self.instance, self.unit = instance, unit
        self.rows: list[np.ndarray] = []  # (K S + 1,): <V_ks, v v'> and <known, v v'>, where v'diag(metric) v = 1

    def add_cuts(self, V: np.ndarray) -> None:
        """Demand t <= v'V' v of every V' for the eigenvectors v of V (n, n), the nuisance states following the judged ones."""
        judge = self.instance.scaled_criterion
        lift = judge.lift(V) / judge.D[judge.about]
        _, eigenvectors = np.linalg.eigh(lift.T @ V @ lift)
        for v in (lift @ eigenvectors).T:
            block_values = self.instance.block_vectors @ svec(np.outer(v, v))
            row = np.maximum(np.append(block_values.ravel(), v @ self.instance.known_information @ v), 0.0) / self.unit
            # one that is worth more than the bound lets t be what it may; small entries would be taken for 0
            self.rows.append(np.where(row > 0, np.clip(row, 2 * _ZERO_COEFFICIENT, 1.0), 0.0))

    def solve(self, seconds: float, incumbent: tuple[np.ndarray, float] | None = None, gap: float = 0.0) -> _ProgramSolution:
        """Solve the program, of whole choices from an incumbent on, or else of relaxed ones."""
        import highspy  # half a second, which most problems can do without

        # a new one every time: what a time limit counts from differs between versions
        highs = highspy.Highs()
        relative_gap = min(max(0.5 * gap, 1e-9), 0.5)
        for option, setting in _options(max(seconds, 0.1), relative_gap):
            highs.setOptionValue(option, setting)
        count = self.instance.block_vectors[..., 0].size
        lower_bound = -1.0 if incumbent is None else max(incumbent[1], 0.0) / self.unit * (1 - _INTEGRALITY_MARGIN)
        self._build(highs, lower_bound)
        if incumbent is not None:
            integer_types = np.full(count, highspy.HighsVarType.kInteger)
            highs.changeColsIntegrality(count, np.arange(count, dtype=np.int32), integer_types)
            start = highspy.HighsSolution()
            start.col_value = [*incumbent[0].ravel().astype(float).tolist(), lower_bound]
            highs.setSolution(start)
        highs.run()
        info, values = highs.getInfo(), np.array(highs.getSolution().col_value)
        optimal = highs.getModelStatus() == highspy.HighsModelStatus.kOptimal
        has_values = len(values) > 0 and (optimal or incumbent is not None)
        bound = np.inf
        if incumbent is None and optimal:
            bound = -info.objective_function_value
        elif incumbent is not None and has_values and np.isfinite(info.mip_dual_bound):
            # branches that are better than its schedule by less than the gap asked for are cut off
            bound = max(-info.mip_dual_bound, values[-1] / (1 - relative_gap))
        shares = np.clip(values[:-1], 0.0, 1.0).reshape(self.instance.shape) if has_values else None
        return _ProgramSolution(shares, float(bound) * self.unit * (1 + _tolerance_margin(count)))

    def _build(self, highs: highspy.Highs, lower_bound: float) -> None:
        instance, schedules = self.instance, top_of(self.instance.schedules)
        K, S = instance.shape
        upper_bounds = np.append(schedules.available.ravel().astype(float), 1.0 + _INTEGRALITY_MARGIN)
        highs.addVars(K * S + 1, np.append(np.zeros(K * S), lower_bound), upper_bounds)
        highs.changeColCost(K * S, -1.0)
        for k in range(K):
            _add_row(highs, -np.inf, float(schedules.per_segment), np.arange(k * S, (k + 1) * S), np.ones(S))
        for resource in instance.resources:
            capacity = resource.limit + 1e-9 * max(1.0, resource.limit)  # as everywhere
            usage = np.minimum(resource.usage.ravel() / capacity, 2.0)
            users = np.flatnonzero(usage)
            _add_row(highs, -np.inf, 1.0, users, usage[users])
        for row in self.rows:
            _add_row(highs, -row[-1], np.inf, np.arange(K * S + 1), np.append(row[:-1], -1.0))


def _add_row(highs: highspy.Highs, low: float, high: float, columns: np.ndarray, coefficients: np.ndarray) -> None:
    highs.addRow(low, high, len(columns), columns.astype(np.int32), coefficients)


def _tolerance_margin(count: int) -> float:
    """What HiGHS's tolerances may take off a bound, in units of it: choices (count,) between 0 and 1 at prices that are a little off."""
    return _INTEGRALITY_MARGIN + 2 * _TOLERANCE * count


def _options(seconds: float, relative_gap: float) -> tuple[tuple[str, float | int | bool], ...]:
    return (
        ("output_flag", False),
        ("threads", 1),
        ("random_seed", 0),
        ("time_limit", float(seconds)),
        ("mip_rel_gap", relative_gap),
        ("mip_abs_gap", 1e-9),
        ("mip_heuristic_effort", 0.0),  # schedules are found by exchange; what is wanted is the bound
        ("mip_feasibility_tolerance", 1e-7),
        ("primal_feasibility_tolerance", _TOLERANCE),
        ("dual_feasibility_tolerance", _TOLERANCE),
    )


def cut_note(solution: CutResult) -> str:
    """Say whose bound it is."""
    margin = _tolerance_margin(solution.chosen.size)
    return f"bound by an integer program of {solution.cuts} cuts, by HiGHS, widened by {margin:.1e} of itself for its tolerances"
