"""Known inputs that outputs contain, or that enter a rate other than by a factor: states that are read as well, moved by their rates.

What they tell is what inputs that switch tell, where the equations are analytic: the gradients of L_f(., u1) L_f(., u2) ... h at any values
u1, u2, ... of the inputs span what their derivatives by these span at one value, and such are the Lie derivatives along the rate and along
the states that stand for inputs. Where the unknown inputs are the same under all known inputs, they are so here, too.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import casadi as ca

from obsdesign.dynamics.channel import Channel, Noise
from obsdesign.dynamics.model import Model
from obsdesign.dynamics.motion import AffineMotion, moved_with, non_affine


def with_signal_states(model: Model, held: Mapping[str, float]) -> tuple[Model, tuple[str, ...]]:
    """Return the model with the state (x, s), s those of the inputs, and their names; those that are held by their values.

    sdot is the known input in their place, s an output of its own: a smooth known signal is one with all of its derivatives, and what
    it tells of x is told whatever it is. The model itself, and no names, where there are no such inputs.
    """
    if not model.is_affine:
        return _general_with_signal_states(model, held)
    places = [i for i in model.inputs_in_outputs if model.input_names[i] not in held]
    fixed = [i for i in model.inputs_in_outputs if model.input_names[i] in held]
    if not (places or fixed):
        return model, ()
    names = tuple(model.input_names[i] for i in places)
    s, n, r = ca.vertcat(*(ca.SX.sym(name) for name in names)), model.x.numel(), len(places)
    values = ca.vertcat(s, *(held[model.input_names[i]] for i in fixed))
    symbols = model.u[[*places, *fixed]]
    channels = tuple(replace(channel, h=ca.substitute(channel.h, symbols, values)) for channel in model.channels)
    moved = model.drift + sum((model.B[:, i] * s[k] for k, i in enumerate(places)), ca.SX(n, 1))
    columns = [
        ca.SX([float(row == n + places.index(i)) for row in range(n + r)]) if i in places else ca.vertcat(model.B[:, i], ca.SX(r, 1))
        for i in range(len(model.inputs))
    ]
    extended = replace(
        model,
        x=ca.vertcat(model.x, s),
        states=(*model.states, *(model.inputs[i] for i in places)),
        motion=AffineMotion(ca.vertcat(moved, ca.SX.zeros(r)), ca.horzcat(*columns), ca.vertcat(model.G, ca.SX(r, model.G.shape[1]))),
        channels=(*channels, *_readings(model, places, s)),
        u_of_outputs=None,
    )
    return extended, names


def _general_with_signal_states(model: Model, held: Mapping[str, float]) -> tuple[Model, tuple[str, ...]]:
    free = [i for i, name in enumerate(model.input_names) if name not in held]
    in_rate = non_affine(model.rate, ca.vertcat(ca.SX(0, 1), *(model.u[i] for i in free)), model.w)
    places = [i for k, i in enumerate(free) if i in model.inputs_in_outputs or k in in_rate]
    if not places:
        return model, ()
    names = tuple(model.input_names[i] for i in places)
    s, u = ca.vertcat(*(ca.SX.sym(name) for name in names)), ca.SX.sym("u", len(model.inputs))
    values = ca.vertcat(*(s[places.index(i)] if i in places else u[i] for i in range(len(model.inputs))))
    channels = tuple(replace(channel, h=ca.substitute(channel.h, model.u, values)) for channel in model.channels)
    extended = replace(
        model,
        x=ca.vertcat(model.x, s),
        states=(*model.states, *(model.inputs[i] for i in places)),
        motion=moved_with(model.motion, inputs=(u, model.w), values=(values, model.w), below=u[places]),
        channels=(*channels, *_readings(model, places, s)),
        u_of_outputs=u,
    )
    return extended, names


def _readings(model: Model, places: list[int], s: ca.SX) -> tuple[Channel, ...]:
    """A channel for each of the inputs, which reads it."""
    one = Noise(ca.SX(1), ca.SX(1))
    return tuple(Channel(f"the input {model.input_names[i]}", (model.inputs[i],), s[k], one) for k, i in enumerate(places))
