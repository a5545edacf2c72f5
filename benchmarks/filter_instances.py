"""Instances of schedules for a filter: what is asked of the library, and whatever is known of them held against every bound."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from time import process_time

import numpy as np

import obsdesign as od
from benchmarks.flights import PSD, UNITS, Flight
from benchmarks.kalman_reference import LinearRun, costs, patterns, random_schedules, round_robin, trellis
from benchmarks.recorded_runs import RecordedRun, position_errors

PROVEN = 1e-6
RANDOM_SCHEDULES = 20


@dataclass(frozen=True)
class Answer:
    """Seconds of the processor, and what was found."""

    seconds: float
    found: od.FilterSchedule


class AbstractInstance(ABC):
    """A problem that can be asked, and looked at without the library's schedules."""

    @abstractmethod
    def ask(self, options: Mapping[str, float]) -> od.FilterSchedule:
        """Return the library's answer."""

    @abstractmethod
    def cost(self, chosen: np.ndarray) -> float:
        """Return the cost of a schedule (K, S), computed another way."""

    @property
    @abstractmethod
    def rivals(self) -> np.ndarray:
        """Costs (B,) of other schedules."""


@dataclass(frozen=True)
class FlightInstance(AbstractInstance):
    """A flight, everything judged, in units."""

    flight: Flight

    @property
    def reference(self) -> LinearRun:
        """The flight for the filter in plain NumPy."""
        return self.flight.reference

    def ask(self, options: Mapping[str, float]) -> od.FilterSchedule:
        """Return the library's answer: one sensor in each segment."""
        flight = self.flight
        return od.select_for_filter(
            flight.system, flight.path, flight.prior, segment=flight.length, disturbance_psd=PSD, scale=UNITS, throw=False, **options
        )

    def cost(self, chosen: np.ndarray) -> float:
        """Return the mean trace, by NumPy."""
        return float(costs(self.reference, chosen[None])[0])

    @cached_property
    def rivals(self) -> np.ndarray:
        """Random schedules, greedy and the best of a trellis."""
        run, options = self.reference, patterns(4, 1, fewer=False)
        return costs(run, np.concatenate([random_schedules(run, 1, 20, 0), [trellis(run, options)], [trellis(run, options, 2)]]))


@dataclass(frozen=True)
class RecordedInstance(AbstractInstance):
    """A recorded run with segments of ten seconds, its position judged, in metres."""

    run: RecordedRun
    length: float = 10.0

    @cached_property
    def segment(self) -> np.ndarray:
        """Segment (N,) of each step."""
        return self.run.segment_of_step(self.length)

    @property
    def shape(self) -> tuple[int, int]:
        """(K, S)."""
        return int(self.segment[-1]) + 1, self.run.active.shape[1]

    def ask(self, options: Mapping[str, float]) -> od.FilterSchedule:
        """Return the library's answer: one sensor in each segment."""
        run = self.run
        return od.select_for_filter(
            run.system,
            run.path,
            run.prior,
            segment=self.length,
            disturbance_psd=run.psd,
            about=("x", "y"),
            active=run.active,
            throw=False,
            **options,
        )

    def cost(self, chosen: np.ndarray) -> float:
        """Return the mean variance of the position, by the posterior information [m^2]."""
        run = self.run
        J = od.posterior_information(run.system, run.path, run.prior, run.psd, active=run.active & chosen[self.segment])
        return float(np.trace(np.linalg.inv(J[:-1])[:, :2, :2], axis1=1, axis2=2).mean())

    @cached_property
    def drawn(self) -> np.ndarray:
        """Random schedules (B, K, S)."""
        K, S = self.shape
        picks = np.random.default_rng(0).integers(0, S, (RANDOM_SCHEDULES, K))
        return np.arange(S) == picks[:, :, None]

    @cached_property
    def rivals(self) -> np.ndarray:
        """Random schedules, greedy and round robin."""
        return np.array([self.cost(chosen) for chosen in (*self.drawn, self.greedy, round_robin(*self.shape))])

    @cached_property
    def greedy(self) -> np.ndarray:
        """Segment after segment the sensor (K, S) with which the mean variance in it is least."""
        K, S = self.shape
        chosen, before = np.zeros((K, S), dtype=bool), self.run.prior
        for j in range(K):
            ends = [self._segment_alone(before, j, s) for s in range(S)]
            best = int(np.argmin([spent for spent, _ in ends]))
            chosen[j, best], before = True, ends[best][1]
        return chosen

    def _segment_alone(self, before: od.Prior, j: int, s: int) -> tuple[float, od.Prior]:
        """Return the sum of variances in segment j with sensor s on, and what is known at its end."""
        steps = np.flatnonzero(self.segment == j)
        first, last = int(steps[0]), int(steps[-1]) + 1
        active = self.run.active[first:last] & (np.arange(self.shape[1]) == s)
        P = np.linalg.inv(od.posterior_information(self.run.system, self.run.path.part(first, last), before, self.run.psd, active=active))
        return float(np.trace(P[:-1, :2, :2], axis1=1, axis2=2).sum()), od.Prior(before.mean, covariance=(P[-1] + P[-1].T) / 2)

    @cached_property
    def for_the_start(self) -> np.ndarray:
        """The schedule (K, S) that says most about x(t_0), without process noise: blocks masked by what arrived."""
        W = od.variational_gramian(self.run.system, self.run.path).blocks * self.run.active[:, :, None, None]
        units = np.outer(self.run.prior.std, self.run.prior.std)
        blocks = np.add.reduceat(W, np.flatnonzero(np.diff(self.segment, prepend=-1)), axis=0) * units
        return od.select_sensors(blocks, gap=1e-4, time_limit=20.0).chosen

    def compared(self, chosen: np.ndarray) -> tuple[object, ...]:
        """Return position errors of the filter with all on, the schedule, greedy, round robin, that for the start, and at random."""
        named = [np.ones(self.shape, dtype=bool), chosen, self.greedy, round_robin(*self.shape), self.for_the_start]
        errors = position_errors(self.run, np.concatenate([named, self.drawn]), self.segment)
        drawn, ours = np.sort(errors[len(named) :]), float(errors[1])
        beaten = float(np.mean(drawn > ours))
        shown = [f"{error:.3f}" for error in (*errors[: len(named)], drawn[0], np.median(drawn))]
        return (self.run.name, *shown, f"{beaten:.0%}", judged(beaten >= 0.95))


def asked(instance: AbstractInstance, check: bool = True, **options: float) -> Answer:
    """Return the answer and its time; raise AssertionError for a cost or a bound that is not true, as far as one can tell."""
    began = process_time()
    found = instance.ask(options)
    seconds = process_time() - began
    if check:
        again = instance.cost(found.chosen)
        if abs(again - found.value) > 1e-6 * again:
            raise AssertionError(f"a cost of {found.value} is {again}")
        if found.bound > min(again, instance.rivals.min()) * (1 + 1e-7):
            raise AssertionError(f"a bound of {found.bound} is above a schedule of {min(again, instance.rivals.min())}")
    return Answer(seconds, found)


def judged(reached: bool) -> str:
    """Return whether a bar is reached, as a word."""
    return "yes" if reached else "NO"


def spread(values: Sequence[float]) -> str:
    """Return median and worst."""
    return f"{np.median(values):.2g}, {max(values):.2g}"
