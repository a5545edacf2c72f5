"""White noise that drives a system: of its states, and of its known inputs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.checks import as_array, require_known, require_within
from obsdesign.dynamics.model import AbstractSystem, Model
from obsdesign.dynamics.motion import AbstractMotion, AffineMotion, moved_with
from obsdesign.errors import InputError
from obsdesign.noise_density import DisturbancePsd, InputPsd, PerSpeed
from obsdesign.signals import Signal

if TYPE_CHECKING:
    import casadi as ca

CACHE_SIZE = 64


@dataclass(frozen=True)
class InputNoise:
    """White noise of a known input over one step: variance (steady s)^2 + per_speed^2 |v|, see `ProcessNoise`."""

    name: str
    steady: float
    per_speed: float


@dataclass(frozen=True)
class ProcessNoise:
    """What a step adds by chance: L e + |v|^1/2 L_v e + sum_i B_i d_i e, e ~ N(0, I), d_i^2 = (steady_i s)^2 + per_speed_i^2 |v|.

    steady: L (n, r), per_speed: L_v (n, r'), as rows, L L' = psd * step; inputs: of the means of those inputs over a step, psd / step.
    Where time is counted in steps, step is 1 here, s^2 and |v| are the step's length [s] and way [m], and B_i belongs to integrals of
    inputs: see `Model.noise_scale` and `Model.speed`.
    """

    steady: tuple[tuple[float, ...], ...]
    per_speed: tuple[tuple[float, ...], ...] = ()
    inputs: tuple[InputNoise, ...] = ()

    @property
    def L(self) -> np.ndarray:
        """L (n, r)."""
        return np.array(self.steady)

    @property
    def L_per_speed(self) -> np.ndarray:
        """L_v (n, r')."""
        return np.array(self.per_speed) if self.per_speed else np.zeros((len(self.steady), 0))

    @property
    def input_names(self) -> tuple[str, ...]:
        """Names of the inputs that have noise."""
        return tuple(noise.name for noise in self.inputs)

    @property
    def state_columns(self) -> int:
        """r + r'."""
        return self.L.shape[1] + self.L_per_speed.shape[1]

    @property
    def is_any(self) -> bool:
        """Whether there is noise at all."""
        return bool(self.L.size or self.L_per_speed.size or self.inputs)


@dataclass(frozen=True)
class NoisyInputs(AbstractSystem):
    """A system with the noise of some of its known inputs as unknown inputs behind its own: xdot = drift + B (u + v) + G w."""

    system: AbstractSystem
    """The system with known inputs."""
    names: tuple[str, ...]
    """Those with noise."""

    def _build(self) -> Model:
        return model_with_noisy_inputs(self.system.model, self.names)


@lru_cache(CACHE_SIZE)
def model_with_noisy_inputs(model: Model, names: tuple[str, ...]) -> Model:
    """Return the model with the noise of known inputs as unknown inputs behind its own; itself without any."""

    if not names:
        return model
    places = [model.input_names.index(name) for name in names]
    signals = tuple(Signal(f"noise of {model.inputs[i].name}", model.inputs[i].unit) for i in places)
    return replace(model, unknown_inputs=(*model.unknown_inputs, *signals), motion=_with_noise(model, places))


def _with_noise(model: Model, places: list[int]) -> AbstractMotion:
    """The motion with u + v for the inputs at these places, v further unknown inputs."""
    import casadi as ca

    if model.is_affine:
        return AffineMotion(model.drift, model.B, ca.horzcat(model.G, *[model.B[:, i] for i in places]))
    own, u = ca.SX.sym("w", model.w.numel()), ca.SX(model.u)  # a copy, of the same symbols
    noise = ca.SX.sym("noise", len(places))
    for k, i in enumerate(places):
        u[i] += noise[k]
    return moved_with(model.motion, inputs=(model.u, ca.vertcat(own, noise)), values=(u, own), below=ca.SX(0, 1))


def noise_of(model: Model, disturbance_psd: DisturbancePsd, input_psd: InputPsd, step: float) -> ProcessNoise:
    """Return what steps of `step` seconds add by chance, step = 1 where time is counted in steps.

    Raises InputError unless psd's of states are (n,) >= 0 or (n, n) positive semidefinite, those of inputs >= 0 and of known inputs,
    and the states x and y are there for one per speed.
    """
    n, given = len(model.states), disturbance_psd
    growing = given.psd if isinstance(given, PerSpeed) else None
    steady = given.at_rest if isinstance(given, PerSpeed) else given
    per_input = dict(input_psd or {})
    require_known("input_psd: the system's known inputs", tuple(per_input), _own_inputs(model))
    for i in model.inputs_in_outputs:
        if (name := model.input_names[i]) in per_input:
            raise InputError(f"input_psd: outputs contain the input {name!r}: noise is possible of inputs that they do not contain")
    inputs = tuple(_input_noise(name, psd, step) for name, psd in per_input.items())
    if growing is not None or any(isinstance(psd, PerSpeed) for psd in per_input.values()):
        _require_speed(model)
    rows = [noise_factor(psd, n, step) for psd in (steady, growing)]
    return ProcessNoise(*(tuple(map(tuple, L.tolist())) for L in rows), inputs=tuple(noise for noise in inputs if noise is not None))


def noise_factor(disturbance_psd: ArrayLike | None, n: int, step: float) -> np.ndarray:
    """Return L (n, r) with L L' = psd * step; raise InputError unless the psd is (n,) >= 0 or (n, n) positive semidefinite."""
    if disturbance_psd is None:
        return np.zeros((n, 0))
    psd = as_array("disturbance_psd", disturbance_psd)
    if psd.shape not in {(n,), (n, n)}:
        raise InputError(f"disturbance_psd has shape {psd.shape}: must be finite, ({n},) or symmetric ({n}, {n})")
    if not np.isfinite(psd).all():
        index = np.argwhere(~np.isfinite(psd))[0]
        raise InputError(f"disturbance_psd[{', '.join(map(str, index))}] is {psd[tuple(index)]}: must be finite")
    is_matrix = psd.ndim == 2
    psd = psd if is_matrix else np.diag(psd)
    skew = np.abs(psd - psd.T).max(initial=0.0)
    if skew > 1e-9 * np.abs(psd).max(initial=0.0):
        raise InputError(f"disturbance_psd differs from its transpose by {skew:.3g}: must be symmetric")
    unit = np.sqrt(np.maximum(np.diag(psd), 0.0)) if is_matrix else np.ones(n)  # units of states may be far apart
    unit = np.where(unit > 0, unit, 1.0)
    values, vectors = np.linalg.eigh(psd / unit[:, None] / unit)
    if values[0] < -1e-12 * max(values[-1], 0.0):
        raise InputError(f"disturbance_psd has the eigenvalue {values[0]:g}: must be positive semidefinite")
    is_positive = values > 0
    return unit[:, None] * vectors[:, is_positive] * np.sqrt(values[is_positive] * step)


def input_deviation(model: Model, steady: ca.SX | float, per_speed: ca.SX | float) -> ca.SX:
    """Return d = ((steady s)^2 + per_speed^2 |v|)^1/2 of an input's noise over a step, an expression of the model's x and u."""
    import casadi as ca

    variance = ca.SX((steady * model.noise_scale) ** 2)
    if isinstance(per_speed, ca.SX) or per_speed:
        variance += per_speed**2 * model.speed
    return ca.sqrt(variance)


def _own_inputs(model: Model) -> tuple[str, ...]:
    """The known inputs, without the length of a step where time is counted in steps."""
    return model.input_names[1:] if model.is_per_step else model.input_names


def _input_noise(name: str, psd: float | PerSpeed, step: float) -> InputNoise | None:
    given = (0.0 if psd.at_rest is None else psd.at_rest, psd.psd) if isinstance(psd, PerSpeed) else (psd, 0.0)
    parts = []
    for value in given:
        if not isinstance(value, (int, float)):
            raise InputError(f"input_psd: {name} is per speed {value!r}: must be one number")
        require_within(f"input_psd: {name}", value)
        parts.append((value / step) ** 0.5)
    return InputNoise(name, *parts) if any(parts) else None


def _require_speed(model: Model) -> None:
    missing = [name for name in ("x", "y") if name not in model.state_names]
    if missing:
        raise InputError(
            f"a psd is given per speed, that of the states x and y: the system has {', '.join(model.state_names)}, no {missing[0]!r}"
        )
