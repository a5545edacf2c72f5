"""Ever more starts, until a path is as near to its bound as was asked for, or a limit of work is reached."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from itertools import chain, islice

import numpy as np

from obsdesign.design.best_design import choose_best, distinct_optima
from obsdesign.design.climbs import climb, usable_starts
from obsdesign.design.path_bound.certificate import PathBound
from obsdesign.design.path_bound.proof import path_bound_of
from obsdesign.design.path_bound.rounding import rounded_inputs
from obsdesign.design.problem import DesignProblem
from obsdesign.design.record import Design, GapSearch
from obsdesign.progress import StageReport
from obsdesign.status import Status

LIMIT = 8  # times the starts that were asked for: so many are climbed from at most
_LEAST_BATCH, _LARGEST_BATCH = 2, 8  # starts between two looks at the gap: as many as there were before, whatever the number of workers


@dataclass(frozen=True, eq=False)
class GapSettings:
    """What gap is asked for, from how many starts a search without one would climb, and who climbs."""

    gap: float
    starts: int
    seed: int
    executor: Executor | None

    @property
    def limit(self) -> int:
        """How many starts are climbed from at most."""
        return LIMIT * self.starts


def search_to_gap(problem: DesignProblem, settings: GapSettings, report: StageReport, design: Design | None = None) -> Design | None:
    """Return the best of the climbs from so many starts that the gap is small enough, or as many as are allowed.

    The bound comes first. Starts rounded from its Gram matrix and those of every design take turns; climbs that creep below the best of
    the batches before are abandoned. design: what other climbs have come to, from the usual starts. None without a bound, and where
    the first few climbs have no answer, if there is no such design.
    """
    report(f"{problem.duration:g} s: a bound on every path")
    proof = path_bound_of(problem)
    search = GapSearch(settings.gap, settings.limit, proof)
    if design is not None:
        design = replace(design, search=search)
    if not np.isfinite(proof.bound):
        return design
    pairs = _starts(problem, proof, settings.seed, 0 if design is None else settings.starts)
    while design is None or (design.gap > settings.gap and len(design.starts) < settings.limit):
        count = 0 if design is None else len(design.starts)
        size = min(max(_LEAST_BATCH, count), _LARGEST_BATCH, settings.limit - count)
        batch = list(islice(pairs, size))
        climbs = climb(problem, batch, settings.executor, report, -np.inf if design is None else design.objective)
        candidate = replace(choose_best(problem, climbs.coarse, climbs.refined), search=search)
        if design is None and candidate.ended is not Status.LOCALLY_OPTIMAL:
            return None
        design = candidate if design is None else _better(design, candidate)
        report(f"{problem.duration:g} s: a gap of {design.gap:.2%} after {len(design.starts)} starts")
    return design


def _starts(problem: DesignProblem, proof: PathBound, seed: int, skipped: int) -> Iterator[tuple[str, np.ndarray]]:
    """Yield names and inputs (N, m), rounded ones and usual ones in turn; so many of these are left out."""
    usual = islice(usable_starts(problem, seed), skipped, None)
    if proof.certificate is None or not proof.certificate.multipliers:
        return usual
    return chain.from_iterable(zip(rounded_inputs(problem, proof.certificate, seed), usual, strict=False))


def _better(design: Design, candidate: Design) -> Design:
    """The better of two designs, the first of equals, with the starts of both."""
    best = candidate if candidate.ended.has_answer and candidate.objective > design.objective else design
    starts = (*design.starts, *candidate.starts)
    return replace(best, starts=starts, optima=distinct_optima(starts))
