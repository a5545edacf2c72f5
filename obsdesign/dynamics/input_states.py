"""Unknown inputs as states, for filters that have to say something of them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from obsdesign.arguments import validate_arguments
from obsdesign.checks import as_array, require_count, require_known, require_within
from obsdesign.dynamics.model import AbstractSystem, Model, columns
from obsdesign.dynamics.motion import AbstractMotion, AffineMotion, moved_with
from obsdesign.errors import InputError
from obsdesign.signals import Signal

if TYPE_CHECKING:
    import casadi as ca
    from numpy.typing import ArrayLike


@validate_arguments
@dataclass(frozen=True)
class InputStates(AbstractSystem):
    """A system some of whose unknown inputs are states: w alone, a random walk, or (w, w'), w' a random walk, and so on.

    xdot = drift + B u + G w, wdot = w', w'dot = white noise of the psd that a filter is given. States that stand for inputs follow
    those of the system, named wind_x, wind_x_rate, wind_x_rate_2, ...; without noise of their own they are constants.
    Raises InputError for names that are no unknown inputs, or those of states, and for orders below 1.
    Source: Martinelli (2017), whose filter has (w, w') in the state.
    """

    system: AbstractSystem
    """The system with the unknown inputs."""
    orders: Mapping[str, int]
    """Name of an unknown input -> how many states stand for it: 1 for w, 2 for (w, w')."""

    def __post_init__(self) -> None:
        model = self.system.model
        require_known("orders: the unknown inputs", tuple(self.orders), [signal.name for signal in model.unknown_inputs])
        for name, order in self.orders.items():
            require_count(f"orders: {name}", order)
        object.__setattr__(self, "orders", MappingProxyType(dict(self.orders)))
        for signal in self._signals:
            if signal.name in (*model.state_names, *model.input_names):
                raise InputError(f"orders: the state {signal.name!r} would have the name of a state or input of the system")

    def __hash__(self) -> int:
        return hash((self.system, tuple(self.orders.items())))

    def __reduce__(self) -> tuple[type[InputStates], tuple[object, ...]]:
        return InputStates, (self.system, dict(self.orders))

    def process_psd(self, input_psd: Mapping[str, float], disturbance_psd: ArrayLike | None = None) -> np.ndarray:
        """Return the disturbance_psd (n + r, n + r) for verbs: that of the system's states, and of the last state of each input.

        Arguments:
            input_psd: name of an input that is a state -> power spectral density of what drives the last of its states, >= 0
                [(unit/s^(order - 1))^2 / s]; 0 where it is not named.
            disturbance_psd: (n,) or (n, n), of the system's own states; None = none.
        Raises InputError for other names, shapes and negative values.
        """
        require_known("input_psd: the inputs that are states", tuple(input_psd), tuple(self.orders))
        n = len(self.system.model.states)
        psd = np.zeros((n + len(self._signals),) * 2)
        if disturbance_psd is not None:
            values = as_array("disturbance_psd", disturbance_psd)
            if values.shape not in {(n,), (n, n)}:
                raise InputError(f"disturbance_psd has shape {values.shape}: must be ({n},) or ({n}, {n})")
            psd[:n, :n] = np.diag(values) if values.ndim == 1 else values
        last = n - 1
        for name, order in self.orders.items():
            last += order
            require_within(f"input_psd: {name}", input_psd.get(name, 0.0))
            psd[last, last] = input_psd.get(name, 0.0)
        return psd

    @property
    def _signals(self) -> tuple[Signal, ...]:
        units = {signal.name: signal.unit for signal in self.system.model.unknown_inputs}
        return tuple(
            signal for name, order in self.orders.items() for signal in (_derivative(name, units[name], place) for place in range(order))
        )

    def _build(self) -> Model:
        import casadi as ca

        model = self.system.model
        w = [ca.SX.sym(signal.name) for signal in self._signals]
        return replace(
            model,
            x=ca.vertcat(model.x, *w),
            states=(*model.states, *self._signals),
            motion=self._affine_motion(model, w) if model.is_affine else self._general_motion(model, w),
            unknown_inputs=tuple(signal for signal in model.unknown_inputs if signal.name not in self.orders),
        )

    def _affine_motion(self, model: Model, w: list[ca.SX]) -> AffineMotion:
        import casadi as ca

        first = _first_states(self.orders)
        names = [signal.name for signal in model.unknown_inputs]
        effect = sum((model.G[:, names.index(name)] * w[place] for name, place in first.items()), ca.SX.zeros(model.x.numel()))
        is_last = [place + order - 1 for place, order in zip(first.values(), self.orders.values(), strict=True)]
        rates = [ca.SX(0) if i in is_last else w[i + 1] for i in range(len(w))]
        rest = [i for i, name in enumerate(names) if name not in self.orders]
        below = ca.SX(len(w), 1)
        G = columns([ca.vertcat(model.G[:, i], below) for i in rest], model.x.numel() + len(w))
        return AffineMotion(ca.vertcat(model.drift + effect, *rates), _padded(model.B, len(w)), G)

    def _general_motion(self, model: Model, w: list[ca.SX]) -> AbstractMotion:
        """The motion with w for the inputs that are states; of a map w(t + T) = sum_k w^(k) T^k / k!."""
        import casadi as ca

        first, names = _first_states(self.orders), [signal.name for signal in model.unknown_inputs]
        chains = [w[place : place + order] for place, order in zip(first.values(), self.orders.values(), strict=True)]
        T = model.period
        below = [
            (chain[i + 1] if i + 1 < len(chain) else ca.SX(0))
            if T is None
            else sum((value * T**k / math.factorial(k) for k, value in enumerate(chain[i:])), ca.SX(0))
            for chain in chains
            for i in range(len(chain))
        ]
        rest = ca.SX.sym("w", len(names) - len(first))
        free = iter(ca.vertsplit(rest) if rest.numel() else [])
        values = ca.vertcat(ca.SX(0, 1), *(w[first[name]] if name in first else next(free) for name in names))
        return moved_with(model.motion, inputs=(model.u, rest), values=(model.u, values), below=ca.vertcat(ca.SX(0, 1), *below))


def _first_states(orders: Mapping[str, int]) -> dict[str, int]:
    """Return where the states of each input begin."""
    starts = np.cumsum([0, *orders.values()])
    return {name: int(start) for name, start in zip(orders, starts, strict=False)}


def _derivative(name: str, unit: str, place: int) -> Signal:
    if place == 0:
        return Signal(name, unit)
    suffix = "_rate" if place == 1 else f"_rate_{place}"
    return Signal(name + suffix, f"{unit}/s" if place == 1 else f"{unit}/s^{place}")


def _padded(B: ca.SX, rows: int) -> ca.SX:
    import casadi as ca

    return ca.vertcat(B, ca.SX(rows, B.shape[1])) if B.shape[1] else ca.SX(B.shape[0] + rows, 0)
