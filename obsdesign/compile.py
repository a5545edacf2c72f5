"""The numerical functions of a system, each built once: step, sensitivity, outputs, information of one sample."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca

from obsdesign.calculus import rk4
from obsdesign.checks import whole_multiple
from obsdesign.errors import InputError
from obsdesign.model import AbstractSystem, Model

_CACHED = 64


@lru_cache(_CACHED)
def transition(system: AbstractSystem, step: float) -> ca.Function:
    """Return (x, u, w) -> (x_next, F = dx_next/dx, B_w = dx_next/dw): one RK4 step with inputs held, step [s]."""
    model = system.model
    u = ca.SX.sym("u", len(model.inputs))
    w = ca.SX.sym("w", len(model.unknown_inputs))
    rate = ca.Function("rate", [model.x, u, w], [model.drift + model.B @ u + model.G @ w])
    x_next = rk4(lambda x: ca.SX(rate(x, u, w)), model.x, step)
    sensitivities = [ca.densify(ca.jacobian(x_next, symbol)) for symbol in (model.x, w)]
    return ca.Function("transition", [model.x, u, w], [ca.densify(x_next), *sensitivities], ["x", "u", "w"], ["x_next", "F", "B_w"])


@lru_cache(_CACHED)
def advance(system: AbstractSystem, step: float) -> ca.Function:
    """Return (x, u, w) -> x_next, the first output of `transition` alone."""
    full = transition(system, step)
    arguments = full.sx_in()
    return ca.Function("advance", arguments, [full.call(arguments)[0]])


@lru_cache(_CACHED)
def output(system: AbstractSystem) -> ca.Function:
    """Return x -> (y (q, 1), C = dy/dx (q, n)) over all sensors."""
    model = system.model
    return ca.Function("output", [model.x], [ca.densify(model.h), ca.densify(ca.jacobian(model.h, model.x))], ["x"], ["y", "C"])


@lru_cache(_CACHED)
def sample_information(system: AbstractSystem, weighted: bool = True) -> ca.Function:
    """Return (x, Phi) -> (n, n S): [Phi' C_s' R_s^-1 C_s Phi] of one sample of each sensor s; R = I if not weighted."""
    model = system.model
    n = len(model.states)
    Phi = ca.SX.sym("Phi", n, n)
    blocks = [_block(model, i, Phi, weighted) for i in range(len(model.channels))]
    return ca.Function("sample_information", [model.x, Phi], [ca.densify(ca.horzcat(*blocks))], ["x", "Phi"], ["blocks"])


def _block(model: Model, sensor: int, Phi: ca.SX, weighted: bool) -> ca.SX:
    channel = model.channels[sensor]
    scale = [1 / sigma if weighted else 1.0 for sigma in channel.sigmas]
    C = ca.diag(ca.SX(scale)) @ ca.jacobian(channel.h, model.x) @ Phi
    return C.T @ C


@lru_cache(_CACHED)
def transported_information(system: AbstractSystem, step: float, weighted: bool = True) -> ca.Function:
    """Return (Phi, x, u) -> (F(x, u) Phi, blocks): the step of the Gramian recursion, ready for mapaccum."""
    model = system.model
    u = ca.SX.sym("u", len(model.inputs))
    n = len(model.states)
    Phi = ca.SX.sym("Phi", n, n)
    _, F, _ = transition(system, step).call([model.x, u, ca.SX.zeros(len(model.unknown_inputs))])
    blocks = sample_information(system, weighted)(model.x, Phi)
    return ca.Function("transported", [Phi, model.x, u], [F @ Phi, blocks])


@lru_cache(_CACHED)
def transported_along(system: AbstractSystem, step: float, steps: int, weighted: bool = True) -> ca.Function:
    """Return (Phi_0, x (n, N), u (m, N)) -> (Phi_1 .. Phi_N side by side, blocks side by side): `transported_information` over N steps."""
    return transported_information(system, step, weighted).mapaccum(steps)


@lru_cache(_CACHED)
def advanced_along(system: AbstractSystem, step: float, steps: int) -> ca.Function:
    """Return (x_0, u (m, N), w (p, N)) -> (x_1 .. x_N) (n, N): `advance` over N steps."""
    return advance(system, step).mapaccum(steps)


@lru_cache(_CACHED)
def steps_per_sample(system: AbstractSystem, step: float) -> tuple[int, ...]:
    """Return for each sensor the number of steps between samples; raise InputError where that is not whole."""
    counts = []
    for channel in system.model.channels:
        count = 1 if channel.rate is None else whole_multiple(1 / channel.rate, step)
        if count is None:
            raise InputError(
                f"{channel.name}: rate {channel.rate} Hz is a period of {1 / (channel.rate or 1):g} s,"
                f" which is no whole multiple of the step {step:g} s"
            )
        counts.append(count)
    return tuple(counts)
