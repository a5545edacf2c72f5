"""A step with the white noise that drives it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca

from obsdesign.dynamics.model import Model
from obsdesign.dynamics.process_noise import ProcessNoise, input_deviation, model_with_noisy_inputs
from obsdesign.dynamics.step import CACHE_SIZE, Step, looped_step, step_of


@dataclass(frozen=True, eq=False)
class DrivenStep:
    """One step of a model, and the columns (n, r) of what is added to its end by chance, N(0, 1) each, of its x and u.

    model: that of which x and u are the symbols, the one in which the noise of inputs is unknown inputs.
    """

    model: Model
    step: Step
    noise: ca.SX


@lru_cache(CACHE_SIZE)
def driven_step(model: Model, step: float, substeps: int, noise: ProcessNoise, *, is_looped: bool = True) -> DrivenStep:
    """Return the step of `looped_step`, or of `step_of`, with its noise."""
    noisy_model = model_with_noisy_inputs(model, noise.input_names)
    graph = (looped_step if is_looped else step_of)(noisy_model, step, substeps)
    graph, B = graph.split_disturbance(len(model.unknown_inputs))
    columns = [noisy_model.noise_scale * ca.sparsify(ca.SX(ca.DM(noise.L)))]
    if noise.L_per_speed.size:
        columns.append(ca.sqrt(noisy_model.speed) * ca.sparsify(ca.SX(ca.DM(noise.L_per_speed))))
    for i, entry in enumerate(noise.inputs):
        columns.append(B[:, i] * input_deviation(noisy_model, entry.steady, entry.per_speed))
    return DrivenStep(noisy_model, graph, ca.horzcat(*columns))
