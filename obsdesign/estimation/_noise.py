"""Process noise of a step as a graph whose numbers are rows, so that filters with other noise are the same graph."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from obsdesign.dynamics.model import Model
from obsdesign.dynamics.process_noise import ProcessNoise, input_deviation
from obsdesign.estimation._spread import (
    AbstractSpread,
    RootSpread,
    root_graph,
    spread_symbols,
    spread_values,
)


@dataclass(frozen=True)
class NoiseForm:
    """What noise there is, whatever its size: of which inputs, and whether any of it grows with the speed."""

    inputs: tuple[str, ...] = ()
    is_per_speed: bool = False


@dataclass(frozen=True, eq=False)
class NoiseGraph:
    """L e + |v|^1/2 L_v e + B diag(d) e as `ProcessNoise` has it: spreads and numbers as symbols, which stand in a row.

    model: the one in which the noise of inputs is unknown inputs; nuisance_noise (e, e): the root of what drives errors that last.
    """

    form: NoiseForm
    model: Model
    steady: AbstractSpread
    per_speed: AbstractSpread
    deviations: ca.SX
    row: ca.SX
    nuisance_noise: ca.SX | None

    def at(self, x: ca.SX, B: ca.SX) -> AbstractSpread:
        """Return the noise of a step that begins at x (n, 1), an expression; B (n, r): its derivative to the noise of inputs."""
        noise = self.steady.inflate(self.model.noise_scale**2) if self.model.is_per_step else self.steady
        if self.form.is_per_speed:
            noise = noise.plus(self.per_speed.inflate(ca.substitute(self.model.speed, self.model.x, x)))
        if self.form.inputs:
            noise = noise.plus(noise.of_columns(B @ ca.diag(self._input_deviations(x))))
        if self.nuisance_noise is None:
            return noise
        return RootSpread(ca.diagcat(root_graph(noise), self.nuisance_noise))

    def _input_deviations(self, x: ca.SX) -> ca.SX:
        steady, per_speed = self.deviations[: len(self.form.inputs)], self.deviations[len(self.form.inputs) :]
        values = [
            input_deviation(self.model, steady[i], per_speed[i] if self.form.is_per_speed else 0.0) for i in range(len(self.form.inputs))
        ]
        return ca.substitute(ca.vertcat(*values), self.model.x, x)


def noise_graph(form: NoiseForm, model: Model, has_roots: bool, nuisance_noise: ca.SX | None) -> NoiseGraph:
    """Return the noise of a form with symbols for its numbers."""
    n, count = model.x.numel(), 1 + form.is_per_speed
    steady, steady_row = spread_symbols("noise", n, has_roots)
    per_speed, per_speed_row = spread_symbols("noise_per_speed", n, has_roots)
    deviations = ca.SX.sym("input_noise", len(form.inputs) * count)
    row = ca.vertcat(steady_row, *([per_speed_row] if form.is_per_speed else []), deviations)
    return NoiseGraph(form, model, steady, per_speed, deviations, row, nuisance_noise)


def form_of(noise: ProcessNoise) -> NoiseForm:
    """Return what noise there is."""
    is_per_speed = bool(noise.L_per_speed.size) or any(entry.per_speed for entry in noise.inputs)
    return NoiseForm(noise.input_names, is_per_speed)


def noise_row(noise: ProcessNoise, has_roots: bool, form: NoiseForm | None = None) -> np.ndarray:
    """Return the numbers for the row of `noise_graph`; form: its own, or one that has more."""
    form = form or form_of(noise)
    by_name = {entry.name: (entry.steady, entry.per_speed) for entry in noise.inputs}
    steady, growing = zip(*(by_name.get(name, (0.0, 0.0)) for name in form.inputs), strict=True) if form.inputs else ((), ())
    parts = [noise.L, noise.L_per_speed] if form.is_per_speed else [noise.L]
    spreads = [spread_values(L @ L.T, has_roots) for L in parts]
    return np.concatenate([*spreads, steady, growing if form.is_per_speed else ()])
