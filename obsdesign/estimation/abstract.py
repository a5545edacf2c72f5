"""What an estimator is, and what a filter is made of: graphs of its prediction and of its update."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import casadi as ca

from obsdesign.dynamics.inner_loop import InnerLoop
from obsdesign.estimation._motion import Motion
from obsdesign.estimation._noise import NoiseGraph
from obsdesign.estimation._samples import SampleInnovations, Samples
from obsdesign.estimation._spread import AbstractSpread, root_graph, root_of_columns
from obsdesign.estimation.gate import Gate


@dataclass(frozen=True, eq=False)
class BeliefGraph:
    """X ~ N(mean, spread) as a graph, X = (x, z, b) the state and the nuisance states of errors that last."""

    mean: ca.SX
    spread: AbstractSpread


@dataclass(frozen=True, eq=False)
class Prediction:
    """Where a belief moves: mean (n, 1), and columns (n, r) before and after of which the covariances are the sums of squares.

    Between them is the covariance of before with after, before @ after'; process noise is not in them. B (n, r): of the noise of inputs,
    at the mean. loop: of sub-steps, whose end is in the graph.
    """

    mean: ca.SX
    before: ca.SX
    after: ca.SX
    B: ca.SX
    loop: InnerLoop | None

    def with_noise(self, noise: AbstractSpread) -> Moved:
        """Return the belief one step later, with process noise that is a root too."""
        return Moved(BeliefGraph(self.mean, root_of_columns(self.after, root_graph(noise))), self.loop)


@dataclass(frozen=True, eq=False)
class Moved:
    """A belief one step later, and the loop of sub-steps whose end is in its graph."""

    belief: BeliefGraph
    loop: InnerLoop | None


class AbstractEstimator(ABC):
    """Anything that estimates states from samples. Leaves are final frozen dataclasses of options, one file each."""

    @property
    @abstractmethod
    def filter(self) -> AbstractFilter:
        """The filter that goes forward through the samples."""

    @property
    @abstractmethod
    def is_smoother(self) -> bool:
        """Whether estimates know the samples after them too."""


@dataclass(frozen=True, kw_only=True)
class AbstractFilter(AbstractEstimator, ABC):
    """An estimator that knows the samples so far: a prediction, then an update, over and over."""

    gate: Gate | None = None
    """Which samples are taken in, by what the predicted state expects of them; None = all."""

    @property
    def filter(self) -> AbstractFilter:
        """Itself."""
        return self

    @property
    def is_smoother(self) -> bool:
        """False."""
        return False

    @property
    @abstractmethod
    def needs_roots(self) -> bool:
        """Whether it can carry nothing but roots of covariances."""

    @abstractmethod
    def innovations(self, samples: Samples, belief: BeliefGraph) -> SampleInnovations:
        """Return what is new in the samples, beside what the belief expects of them."""

    @abstractmethod
    def update(self, samples: Samples, belief: BeliefGraph, is_taken: ca.SX) -> BeliefGraph:
        """Return the belief after the samples that are taken in (q, 1)."""

    @abstractmethod
    def predict(self, motion: Motion, belief: BeliefGraph) -> Prediction:
        """Return where a belief that is carried as a root moves."""

    @abstractmethod
    def move(self, motion: Motion, belief: BeliefGraph, noise: NoiseGraph) -> Moved:
        """Return the belief one step later, with that process noise."""
