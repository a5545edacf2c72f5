"""Outputs that contain known inputs: these become states that are read as well, moved by their rates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import casadi as ca

from obsdesign.dynamics.model import Channel, Model, Noise


def with_signal_states(model: Model, held: Mapping[str, float]) -> tuple[Model, tuple[str, ...]]:
    """Return the model with the state (x, s), s the inputs that outputs contain, and their names; those that are held by their values.

    sdot is the known input in their place, s an output of its own: a smooth known signal is one with all of its derivatives, and what
    it tells of x is told whatever it is. The model itself, and no names, where no output contains an input.
    """
    places = [i for i in model.inputs_in_outputs if model.input_names[i] not in held]
    fixed = [i for i in model.inputs_in_outputs if model.input_names[i] in held]
    if not (places or fixed):
        return model, ()
    names = tuple(model.input_names[i] for i in places)
    s, n, r = ca.vertcat(*(ca.SX.sym(name) for name in names)), model.x.numel(), len(places)
    values = ca.vertcat(s, *(held[model.input_names[i]] for i in fixed))
    symbols = model.u[[*places, *fixed]]
    channels = tuple(replace(channel, h=ca.substitute(channel.h, symbols, values)) for channel in model.channels)
    read = tuple(
        Channel(f"the input {name}", (model.inputs[i],), s[k], Noise(ca.SX(1), ca.SX(1)))
        for k, (i, name) in enumerate(zip(places, names, strict=True))
    )
    moved = model.drift + sum((model.B[:, i] * s[k] for k, i in enumerate(places)), ca.SX(n, 1))
    columns = [
        ca.SX([float(row == n + places.index(i)) for row in range(n + r)]) if i in places else ca.vertcat(model.B[:, i], ca.SX(r, 1))
        for i in range(len(model.inputs))
    ]
    extended = replace(
        model,
        x=ca.vertcat(model.x, s),
        states=(*model.states, *(model.inputs[i] for i in places)),
        drift=ca.vertcat(moved, ca.SX.zeros(r)),
        B=ca.horzcat(*columns),
        G=ca.vertcat(model.G, ca.SX(r, model.G.shape[1])),
        channels=(*channels, *read),
        u_of_outputs=None,
    )
    return extended, names
