"""Unknown inputs that are polynomials in time: they and their derivatives become states, and nothing is unknown any more.

Source: Belo, Salaris and Bicchi, 2010.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import casadi as ca

from obsdesign.checks import require_count
from obsdesign.dynamics.model import Model
from obsdesign.dynamics.motion import AbstractMotion, AffineMotion, moved_with
from obsdesign.signals import Signal


@dataclass(frozen=True)
class Polynomial:
    """A disturbance class: every unknown input is a polynomial in time.

    Verdicts for it are not verdicts for arbitrary inputs, whatever the degree. Raises InputError unless the degree is a count or 0.
    """

    degree: int
    """Degree of the polynomials; 0 = constant."""

    def __post_init__(self) -> None:
        require_count("degree", self.degree, minimum=0)


def augment(model: Model, degree: int) -> Model:
    """Return the model with state (x, w, w', ..., w^(degree)), where w^(degree + 1) = 0, and without unknown inputs.

    In a map from one instant to the next w', w'', ... are forward differences from step to step.
    """
    levels = [[ca.SX.sym(_name(signal, level)) for signal in model.unknown_inputs] for level in range(degree + 1)]
    symbols = [ca.vertcat(*level) for level in levels]
    return replace(
        model,
        x=ca.vertcat(model.x, *symbols),
        states=model.states + tuple(Signal(_name(signal, level)) for level in range(degree + 1) for signal in model.unknown_inputs),
        motion=_polynomial_motion(model, symbols),
        unknown_inputs=(),
    )


def _polynomial_motion(model: Model, symbols: list[ca.SX]) -> AbstractMotion:
    p, n_added = len(model.unknown_inputs), len(model.unknown_inputs) * len(symbols)
    if model.is_affine:
        drift = ca.vertcat(model.drift + model.G @ symbols[0], *symbols[1:], ca.SX.zeros(p))
        return AffineMotion(drift, ca.vertcat(model.B, ca.SX(n_added, model.B.shape[1])), ca.SX(model.x.numel() + n_added, 0))
    differences = [*(low + high for low, high in pairwise(symbols)), symbols[-1]]  # those of a polynomial of the number of the step
    below = [*symbols[1:], ca.SX.zeros(p)] if model.period is None else differences
    return moved_with(model.motion, inputs=(model.u, ca.SX(0, 1)), values=(model.u, symbols[0]), below=ca.vertcat(*below))


def _name(signal: Signal, level: int) -> str:
    return signal.name + "'" * level if level < 4 else f"{signal.name}^({level})"
