"""The integer program of eigenvector cuts against all schedules, and when it takes over."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from time import perf_counter

import numpy as np
import pytest

import obsdesign as od
from obsdesign.rules.abstract import AbstractRule
from obsdesign.selection import solver as selecting
from obsdesign.selection.build import build_problem
from obsdesign.selection.integer import eigenvector_cuts as cuts
from obsdesign.selection.integer.eigenvector_cuts import CutResult, is_integer_program, solve_by_cuts
from obsdesign.selection.integer.search import Clock
from obsdesign.selection.problem import SelectionProblem
from obsdesign.selection.relaxation.column_generation import solve_relaxation


@dataclass(frozen=True)
class Case:
    """A problem of one sensor per segment, small enough for all schedules."""

    blocks: np.ndarray
    rules: tuple[AbstractRule, ...] = ()
    known: np.ndarray | None = None
    about: tuple[int, ...] | None = None

    def posed(self) -> SelectionProblem:
        return build_problem(self.blocks, 1, self.rules, od.MinEigenvalue(), 0, None, known_information=self.known, about=self.about)

    def best(self) -> float:
        """Of all (S + 1)^K schedules: 1 / lambda_max of the judged part of W^-1."""
        K, S, n, _ = self.blocks.shape
        options = np.concatenate([self.blocks, np.zeros((K, 1, n, n))], axis=1)
        about = list(range(n) if self.about is None else self.about)
        found = 0.0
        for picks in product(range(S + 1), repeat=K):
            if not all(self._affordable(rule, picks) for rule in self.rules):
                continue
            W = options[np.arange(K), list(picks)].sum(axis=0) + (0.0 if self.known is None else self.known)
            d = np.sqrt(np.maximum(np.diag(W), 1e-300))
            B = W / np.outer(d, d)
            if np.linalg.eigvalsh(B)[0] > 1e-10:
                C = (np.linalg.inv(B) / np.outer(d, d))[np.ix_(about, about)]
                found = max(found, 1 / np.linalg.eigvalsh(C)[-1])
        return found

    @staticmethod
    def _affordable(rule: AbstractRule, picks: tuple[int, ...]) -> bool:
        assert isinstance(rule, od.EnergyBudget)
        assert isinstance(rule.cost, dict)
        costs = [*(rule.cost[s] for s in range(2)), 0.0]
        return sum(costs[s] for s in picks) <= rule.limit * (1 + 1e-9)


def drawn(seed: int, K: int = 7, S: int = 2, n: int = 3) -> np.ndarray:
    factors = np.random.default_rng(seed).standard_normal((K, S, n, 1))
    return factors @ factors.swapaxes(2, 3)


UNITS = np.array([1e6, 1.0, 1e-4])
CASES = {
    "rank 1": Case(drawn(0)),
    "a budget": Case(drawn(1), (od.EnergyBudget(9.0, {0: 2.0, 1: 1.0}),)),
    "something known": Case(drawn(2), known=np.diag([0.0, 3.0, 0.1])),
    "some judged": Case(drawn(3), about=(0, 2)),
    "units ten decades apart": Case(drawn(4) * np.outer(UNITS, UNITS)),
    "all at once": Case(drawn(5) * np.outer(UNITS, UNITS), (od.EnergyBudget(8.0, {0: 1.0, 1: 2.0}),), np.diag(0.1 * UNITS**2), (1, 2)),
}


@pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())
def test_its_bound_is_above_all_schedules_and_meets_the_best_one(case: Case):
    """From nothing on: programs and cuts alone find the best schedule, to what tolerances leave."""
    instance = case.posed()
    found = solve_relaxation(instance, 1e-9)
    assert found is not None
    assert is_integer_program(instance)
    nothing, best = np.zeros(instance.shape, dtype=bool), case.best()
    result = solve_by_cuts(instance, found, (nothing, instance.value(nothing)), 1e-7, lambda: 60.0)
    assert instance.is_within_limits(result.chosen)
    assert result.value == instance.value(result.chosen) <= best * (1 + 1e-9)
    assert best <= result.bound <= found.bound * (1 + 1e-12)
    assert result.value >= best * (1 - 1e-9)
    assert result.bound <= best * (1 + 1e-4)


def test_it_is_the_same_program_every_time():
    instance = CASES["rank 1"].posed()
    found = solve_relaxation(instance, 1e-9)
    assert found is not None
    nothing = np.zeros(instance.shape, dtype=bool)
    one, two = (solve_by_cuts(instance, found, (nothing, 0.0), 1e-7, lambda: 60.0) for _ in range(2))
    assert (one.value, one.bound, one.cuts) == (two.value, two.bound, two.cuts)


def test_what_is_no_integer_program_is_left_alone():
    blocks = drawn(0)
    criterion, segments = od.MinEigenvalue(), None
    assert not is_integer_program(build_problem(blocks, 1, (), od.LogDet(), 0, segments))
    assert not is_integer_program(build_problem(blocks, 1, (), criterion, 1, segments))
    assert not is_integer_program(build_problem(blocks, 1, (od.MinimumDwell(2),), criterion, 0, segments))
    assert not is_integer_program(build_problem(drawn(0, 1001), 1, (), criterion, 0, segments))


def test_time_that_is_up_leaves_what_is_known():
    instance = CASES["rank 1"].posed()
    found = solve_relaxation(instance, 1e-9)
    assert found is not None
    nothing = np.zeros(instance.shape, dtype=bool)
    result = solve_by_cuts(instance, found, (nothing, 0.0), 1e-9, lambda: 0.0)
    assert (result.value, result.bound) == (0.0, found.bound)


def test_branch_and_bound_goes_on_where_it_gets_done_in_time():
    now = perf_counter()
    clock = Clock(now - 50.0, now + 50.0, has_finisher=True)  # half of the time is gone
    assert clock.is_search_over()
    assert not clock.is_up()
    assert clock.stalls(now - 40.0, 0.3)  # 0.3 in 40 s: 0.675 in 90 s
    assert not clock.stalls(now - 40.0, 0.6)
    assert not Clock(now - 50.0, now + 50.0).stalls(now - 40.0, 0.0)  # nothing else would go on
    assert not Clock(now - 5.0, now + 95.0, has_finisher=True).is_search_over()
    assert not Clock(now, np.inf).is_search_over()


def test_it_takes_over_within_a_time_limit_and_says_so(monkeypatch: pytest.MonkeyPatch):
    """What it returns is joined with what is there: the better schedule, the lower bound; without a time limit it is not asked."""
    asked = []

    def finished(
        instance: SelectionProblem, found: object, incumbent: tuple[np.ndarray, float], gap: float, left: Callable[[], float]
    ) -> CutResult:
        asked.append(incumbent[1])
        return CutResult(*incumbent, 0.5 * (incumbent[1] + found.bound), 17)  # pyright: ignore[reportAttributeAccessIssue]

    monkeypatch.setattr(selecting, "solve_by_cuts", finished)
    blocks = drawn(0, 40, 4, 5)
    schedule = od.select_sensors(blocks, time_limit=0.2)
    assert asked == [schedule.value]
    assert schedule.bound == pytest.approx(0.5 * (schedule.value + schedule.root_bound), rel=1e-6)
    assert "an integer program of 17 cuts, by HiGHS" in schedule.notes[-1]
    assert od.select_sensors(drawn(0, 6, 3, 3), time_limit=5.0).notes == ()


def test_what_tolerances_may_take_is_given_back():
    """Prices off by 1e-9 for each of 2000 choices, and what counts as whole: a few 1e-6 at most."""
    assert 1e-6 <= cuts._tolerance_margin(1) <= cuts._tolerance_margin(2000) <= 6e-6
