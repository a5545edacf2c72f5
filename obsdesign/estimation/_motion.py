"""One step of the state with its nuisance states, as filters take it: along the estimate, or along points about it."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from obsdesign.dynamics.inner_loop import InnerLoop
from obsdesign.dynamics.model import Model
from obsdesign.dynamics.nuisance_states import NuisanceStates, nuisance_of
from obsdesign.dynamics.step import Step, chain_steps, exact_step, looped_step, step_of


@dataclass(frozen=True, eq=False)
class Motion:
    """X+ = (f(x, u), decay z, b): one step of a model, made of so many sub-steps, unknown inputs being 0.

    The last `noisy_inputs` of the model's unknown inputs stand for the noise of known ones.
    """

    model: Model
    step: float
    substeps: int
    noisy_inputs: int = 0

    @property
    def u(self) -> ca.SX:
        """The known inputs (m, 1)."""
        return self.model.u

    @property
    def nuisance(self) -> NuisanceStates:
        """The errors of samples that last."""
        return nuisance_of(self.model, self.step)

    @property
    def size(self) -> int:
        """The number of states, nuisance states among them."""
        return self.model.x.numel() + self.nuisance.size

    @property
    def nuisance_noise(self) -> ca.SX:
        """The root of the covariance of what drives the nuisance states (e, e)."""
        constant = len(self.nuisance.constant)
        return ca.diagcat(self.nuisance.driving_root(self.model), ca.SX(constant, constant))

    @property
    def _nuisance_transition(self) -> ca.SX:
        """What a step leaves of each of (z, b) (e, 1)."""
        return ca.vertcat(self.nuisance.decay_graph(self.model), ca.SX.ones(len(self.nuisance.constant)))

    def linearise(self, X: ca.SX) -> LinearMotion:
        """Return the step from X (n + e, 1), an expression, with its derivative there."""
        n, decay = self.model.x.numel(), self._nuisance_transition
        step_graph = looped_step(self.model, self.step, self.substeps).without_disturbance().starting_at(X[:n, :])
        F = ca.diagcat(step_graph.F, ca.diag(decay)) if self.nuisance.size else step_graph.F
        return LinearMotion(ca.vertcat(step_graph.x_next, decay * X[n:, :]), F, self._noisy(step_graph), step_graph.loop)

    def input_columns(self, X: ca.SX) -> ca.SX:
        """Return dx_next/dv (n, r) to the noise v of known inputs at X (n + e, 1)."""
        graph = step_of(self.model, self.step, self.substeps).without_disturbance().starting_at(X[: self.model.x.numel(), :])
        return self._noisy(graph)

    def _noisy(self, step_graph: Step) -> ca.SX:
        return step_graph.B_w[:, self.model.w.numel() - self.noisy_inputs :]

    def move(self, points: list[ca.SX]) -> PointMotion:
        """Return where points (n + e, 1) move."""
        n, decay = self.model.x.numel(), self._nuisance_transition
        moved, loop = self._move_states([point[:n, :] for point in points])
        return PointMotion([ca.vertcat(x, decay * point[n:, :]) for x, point in zip(moved, points, strict=True)], loop)

    def _move_states(self, points: list[ca.SX]) -> tuple[list[ca.SX], InnerLoop | None]:
        """Move states, sub-steps of RK4 as a loop over all of them at once."""
        model, count = self.model, self.substeps
        if count == 1 or exact_step(model, self.step) is not None:
            advance = _advance(looped_step(model, self.step, count))
            return [ca.SX(advance(point, model.u)) for point in points], None
        advance, n = _advance(chain_steps(model, (self.step / count,))), model.x.numel()
        z, end = (ca.SX.sym(name, n * len(points) + model.u.numel()) for name in ("points", "end"))
        u = z[n * len(points) :]
        moved = [ca.SX(advance(part, u)) for part in ca.vertsplit(z[: n * len(points)], n)]
        loop = InnerLoop(count, z, ca.vertcat(*moved, u), ca.vertcat(*points, model.u), end)
        return ca.vertsplit(end[: n * len(points)], n), loop


@dataclass(frozen=True, eq=False)
class LinearMotion:
    """X_next (n + e, 1), F = dX_next/dX and B = dx_next/dv (n, r), and the loop of sub-steps of which they are the end, if there is one.

    v is the noise of known inputs.
    """

    X_next: ca.SX
    F: ca.SX
    B: ca.SX
    loop: InnerLoop | None


@dataclass(frozen=True, eq=False)
class PointMotion:
    """Points moved by one step, and the loop of sub-steps of which they are the end, if there is one."""

    points: list[ca.SX]
    loop: InnerLoop | None


def _advance(step_graph: Step) -> ca.Function:
    graph = step_graph.without_disturbance()
    return ca.Function("advance", [graph.x, graph.u], [graph.x_next])
