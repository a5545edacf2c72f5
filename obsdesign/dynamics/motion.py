"""How a state moves: rates that are affine in the inputs, rates of any form, and maps from one instant to the next."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from obsdesign.errors import InputError

if TYPE_CHECKING:
    import casadi as ca


class AbstractMotion(ABC):
    """One expression of the state and of the inputs u (m, 1) and w (p, 1): xdot, or the state after a period."""

    @property
    @abstractmethod
    def period(self) -> float | None:
        """Length of a step [s] of a map from one instant to the next; None where time is continuous."""

    @abstractmethod
    def at(self, u: ca.SX, w: ca.SX) -> ca.SX:
        """Return the expression (n, 1) for inputs u (m, 1), w (p, 1)."""

    @abstractmethod
    def with_symbols(self, u: ca.SX, w: ca.SX) -> AbstractMotion:
        """Return the same of other symbols u (m, 1), w (p, 1)."""

    @abstractmethod
    def affine(self, state_names: Sequence[str], input_names: Sequence[str]) -> AffineMotion:
        """Return the fields; raise InputError, which names the input, where the expression is no rate that is affine in the inputs."""


@dataclass(frozen=True, eq=False)
class AffineMotion(AbstractMotion):
    """xdot = drift + B u + G w, with drift (n, 1), B (n, m), G (n, p) of the state alone."""

    drift: ca.SX
    B: ca.SX
    G: ca.SX

    @property
    def period(self) -> None:
        """Time is continuous."""
        return

    def at(self, u: ca.SX, w: ca.SX) -> ca.SX:
        """Return drift + B u + G w."""
        return self.drift + self.B @ u + self.G @ w

    def with_symbols(self, u: ca.SX, w: ca.SX) -> AffineMotion:  # no symbol of an input is part of it
        """Return itself."""
        return self

    def affine(self, state_names: Sequence[str], input_names: Sequence[str]) -> AffineMotion:  # nothing is refused
        """Return itself."""
        return self


@dataclass(frozen=True, eq=False)
class GeneralMotion(AbstractMotion):
    """xdot = rate(x, u, w): an expression (n, 1) of the state and of the symbols u (m, 1), w (p, 1)."""

    u: ca.SX
    w: ca.SX
    rate: ca.SX

    @property
    def period(self) -> None:
        """Time is continuous."""
        return

    def at(self, u: ca.SX, w: ca.SX) -> ca.SX:
        """Return the rate for these inputs."""
        return _substitute(self.rate, self.u, self.w, u, w)

    def with_symbols(self, u: ca.SX, w: ca.SX) -> GeneralMotion:
        """Return the same of other symbols."""
        return GeneralMotion(u, w, self.at(u, w))

    def affine(self, state_names: Sequence[str], input_names: Sequence[str]) -> AffineMotion:
        """Return drift = rate(x, 0, 0) and the slopes by the inputs; raise InputError where these depend on an input."""
        import casadi as ca

        m, inputs = self.u.numel(), ca.vertcat(self.u, self.w)
        for j in non_affine(self.rate, self.u, self.w):
            i = next(i for i in range(self.rate.numel()) if ca.depends_on(ca.jacobian(self.rate[i], inputs[j]), inputs))
            raise InputError(
                f"the input {input_names[j]!r} enters the rate of {state_names[i]!r} other than by a factor: that is asked for here"
            )
        slopes = ca.jacobian(self.rate, inputs)
        zeros = [ca.SX.zeros(group.numel()) for group in (self.u, self.w)]
        return AffineMotion(self.at(zeros[0], zeros[1]), slopes[:, :m], slopes[:, m:])


@dataclass(frozen=True, eq=False)
class MapMotion(AbstractMotion):
    """x(t + length) = next_state(x, u, w): an expression (n, 1) of the state and of the symbols u (m, 1), w (p, 1)."""

    u: ca.SX
    w: ca.SX
    next_state: ca.SX
    length: float

    @property
    def period(self) -> float:
        """Length of a step [s]."""
        return self.length

    def at(self, u: ca.SX, w: ca.SX) -> ca.SX:
        """Return the next state for these inputs."""
        return _substitute(self.next_state, self.u, self.w, u, w)

    def with_symbols(self, u: ca.SX, w: ca.SX) -> MapMotion:
        """Return the same of other symbols."""
        return MapMotion(u, w, self.at(u, w), self.length)

    def affine(self, state_names: Sequence[str], input_names: Sequence[str]) -> AffineMotion:  # always refused
        """Raise InputError: there is no rate."""
        raise InputError(f"the system is a map from one instant to the next, {self.length:g} s later: one in continuous time is needed")


def non_affine(rate: ca.SX, u: ca.SX, w: ca.SX) -> tuple[int, ...]:
    """Return which of the inputs (u, w), by place, enter the rate other than linearly: in whose slope any input is left."""
    import casadi as ca

    inputs = ca.vertcat(u, w)
    slopes = ca.jacobian(rate, inputs) if inputs.numel() else ca.SX(rate.numel(), 0)
    return tuple(j for j in range(inputs.numel()) if ca.depends_on(slopes[:, j], inputs))


def moved_with(motion: AbstractMotion, *, inputs: tuple[ca.SX, ca.SX], values: tuple[ca.SX, ca.SX], below: ca.SX) -> AbstractMotion:
    """Return the motion whose inputs are the symbols `inputs` (u, w), its own inputs being `values` made of these and of states.

    below (r, 1): rates, or next values, of states that are added behind its own.
    """
    import casadi as ca

    expression = ca.vertcat(motion.at(*values), below)
    return GeneralMotion(*inputs, expression) if motion.period is None else MapMotion(*inputs, expression, motion.period)


def _substitute(expression: ca.SX, u: ca.SX, w: ca.SX, u_value: ca.SX, w_value: ca.SX) -> ca.SX:
    import casadi as ca

    old, new = ca.vertcat(u, w), ca.vertcat(u_value, w_value)
    return ca.substitute(expression, old, new) if old.numel() else expression
