"""From inputs to a path."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.checks import require_positive
from obsdesign.compile import advanced_along
from obsdesign.errors import InputError
from obsdesign.model import AbstractSystem
from obsdesign.trajectory import Trajectory


def simulate(system: AbstractSystem, x0: ArrayLike, u: ArrayLike, dt: float, w: ArrayLike | None = None) -> Trajectory:
    """Integrate xdot = g0 + f u + g w by RK4 with inputs held over each step of dt [s].

    x0 (n,), u (N, m) for the known inputs, w (N, p) for the unknown ones (None = 0). Headings stay continuous.
    Raises InputError for wrong shapes and values that are not finite.
    """
    model = system.model
    require_positive("dt", dt)
    start = as_state(system, x0, "x0")
    known = as_inputs(u, len(model.inputs), "u")
    steps = len(known)
    unknown = np.zeros((steps, len(model.unknown_inputs))) if w is None else as_inputs(w, len(model.unknown_inputs), "w")
    if steps < 1 or len(unknown) != steps:
        raise InputError(f"u has {steps} steps and w {len(unknown)}: both need the same number, at least 1")
    states = advanced_along(system, dt, steps)(start, known.T, unknown.T).full().T
    return Trajectory(np.arange(steps + 1) * dt, np.vstack([start, states]), known)


def as_state(system: AbstractSystem, value: ArrayLike, what: str) -> np.ndarray:
    """Return value as a finite (n,) array or raise InputError naming the first entry that is wrong."""
    names = system.model.state_names
    state = np.array(value, dtype=float)
    if state.shape != (len(names),):
        raise InputError(f"{what} has shape {state.shape}: must be ({len(names)},) for {', '.join(names)}")
    for name, entry in zip(names, state, strict=True):
        if not np.isfinite(entry):
            raise InputError(f"{what}: {name} is {entry}: must be finite")
    return state


def as_inputs(value: ArrayLike, width: int, what: str) -> np.ndarray:
    """Return value as a finite (N, width) array; (N,) is accepted where width is 1."""
    inputs = np.array(value, dtype=float)
    if inputs.ndim == 1 and width == 1:
        inputs = inputs[:, None]
    if inputs.ndim != 2 or inputs.shape[1] != width:
        raise InputError(f"{what} has shape {inputs.shape}: must be (N, {width})")
    if not np.isfinite(inputs).all():
        row, column = np.argwhere(~np.isfinite(inputs))[0]
        raise InputError(f"{what}[{row}, {column}] is {inputs[row, column]}: must be finite")
    return inputs
