"""Unknown inputs that are polynomials in time: they and their derivatives become states, and nothing is unknown any more.

Source: Belo, Salaris and Bicchi, 2010.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca

from obsdesign.checks import require_count
from obsdesign.dynamics.model import Model
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
    """Return the model with state (x, w, w', ..., w^(degree)), where w^(degree + 1) = 0, and without unknown inputs."""
    p = len(model.unknown_inputs)
    levels = [[ca.SX.sym(_name(signal, level)) for signal in model.unknown_inputs] for level in range(degree + 1)]
    symbols = [ca.vertcat(*level) for level in levels]
    n_added = p * (degree + 1)
    return replace(
        model,
        x=ca.vertcat(model.x, *symbols),
        states=model.states + tuple(Signal(_name(signal, level)) for level in range(degree + 1) for signal in model.unknown_inputs),
        drift=ca.vertcat(model.drift + model.G @ symbols[0], *symbols[1:], ca.SX.zeros(p)),
        B=ca.vertcat(model.B, ca.SX(n_added, model.B.shape[1])),
        unknown_inputs=(),
        G=ca.SX(model.x.numel() + n_added, 0),
    )


def _name(signal: Signal, level: int) -> str:
    return signal.name + "'" * level if level < 4 else f"{signal.name}^({level})"
