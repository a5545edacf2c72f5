"""One published model with the dimension of what its outputs see."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca

import obsdesign as od


@dataclass(frozen=True)
class Case:
    """A model and the dimension of its observable space.

    Without unknown inputs the dimension is the Hermann-Krener rank, at a generic point or at `at`. With "arbitrary" unknown inputs it is
    rank [J_x J_w] - rank J_w of all Lie words of the outputs on the state extended by the jets of w, in the limit of many jets, at generic
    jets; the words run along the known input fields too, that is, known inputs of every kind are set against one and the same w. With an
    integer, the highest degree of polynomial disturbances, it is the rank of the state augmented by w, ..., w^(degree).
    """

    name: str
    source: str  # author, year, venue, where in it
    build: Callable[[], od.ControlAffineSystem]
    dimension: int
    observable_states: tuple[str, ...] | None = None  # the states seen by themselves; None where not asserted
    at: tuple[float, ...] | None = None
    held: dict | None = None
    disturbance: object = "arbitrary"  # or the degree of polynomial disturbances
    known_inputs: str = "any"


def symbols(*names: str) -> tuple[ca.SX, list[ca.SX]]:
    """The column of the named symbols, and the symbols one by one."""
    x = ca.vertcat(*(ca.SX.sym(name) for name in names))
    return x, ca.vertsplit(x)


def column(*entries: ca.SX | float) -> ca.SX:
    """A column of SX."""
    return ca.SX(ca.vertcat(*entries))
