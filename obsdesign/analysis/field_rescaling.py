"""Unknown inputs that the outputs give away: fields rescaled so that their place is taken by derivatives of outputs.

For functions hh (p, 1) of the outputs with M_kj = L_{g_j} hh_k invertible, a_k = L_{g_0} hh_k and nu = M^-1,
  gh_j = sum_k nu_kj g_k (j = 1..p),   gh_0 = g_0 - sum_k (nu a)_k g_k:
xdot = gh_0 + sum_j gh_j v_j + sum_i f_i u_i with v = d hh / dt at u = 0, which is known. With N = [a M] and
B = [1 0; a M]^-1, what a field changes in these rates is rate(f) = (L_f N) B, (p, p + 1).
Source: Martinelli, IROS 2017, Algorithms 2 and 3; for several unknown inputs and drift, Martinelli, arXiv 1704.03252.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca

from obsdesign.analysis.equations import Equations
from obsdesign.analysis.lie_expressions import Space
from obsdesign.calculus import bracket, lie_derivative
from obsdesign.common_subexpressions import without_repeats


@dataclass(frozen=True, eq=False)
class Rescaled:
    """A canonic system. functions (k, 1): outputs and what they were redefined to; chosen (p, 1): hh, some of them."""

    equations: Equations
    functions: ca.SX
    chosen: ca.SX

    @cached_property
    def rates(self) -> ca.SX:
        """N = [a M], (p, p + 1): Lie derivatives of hh along g_0, g_1, ..., g_p."""
        x = self.equations.x
        return ca.horzcat(*(lie_derivative(self.chosen, x, field) for field in (self.equations.drift, *self.equations.unknown)))

    @cached_property
    def inverse(self) -> ca.SX:
        """B = [1 0; a M]^-1, (p + 1, p + 1)."""
        p = self.chosen.numel()
        nu = ca.inv_minor(self.rates[:, 1:])
        below = ca.horzcat(-nu @ self.rates[:, 0], nu)
        return ca.vertcat(ca.horzcat(ca.SX.ones(1), ca.SX.zeros(1, p)), below)

    @cached_property
    def fields(self) -> tuple[ca.SX, ...]:
        """gh_0, gh_1, ..., gh_p, each (n, 1)."""
        every = ca.horzcat(self.equations.drift, *self.equations.unknown)
        return tuple(_shared(every @ self.inverse[:, j]) for j in range(self.inverse.shape[1]))

    @property
    def moving_fields(self) -> tuple[ca.SX, ...]:
        """The known fields and the rescaled ones, those that vanish left out."""
        return tuple(field for field in (*self.equations.known, *self.fields) if not ca.simplify(field).is_zero())

    def change_of_rates(self, field: ca.SX) -> ca.SX:
        """rate(field) = (L_field N) B as a column."""
        shape = self.rates.shape
        derived = ca.reshape(lie_derivative(ca.vec(self.rates), self.equations.x, field), *shape)
        return ca.vec(_shared(derived @ self.inverse))

    @cached_property
    def switched_rates(self) -> ca.SX:
        """rate(f_i) of every known field: what switching known inputs tells at once."""
        return ca.vertcat(ca.SX(0, 1), *(self.change_of_rates(field) for field in self.equations.known))

    @cached_property
    def tensor(self) -> ca.SX:
        """T = rate(gh_j) for j = 0..p (one w without drift: L_g^2 h / (L_g h)^2, the papers' rho and tau)."""
        return ca.vertcat(*(self.change_of_rates(field) for field in self.fields))

    def brackets(self, fields: Sequence[ca.SX]) -> list[ca.SX]:
        """Return the autobrackets phi^(alpha, j) = sum_k B_kj [phi^alpha, g_k], j = 0..p, of every field phi^alpha."""
        x = self.equations.x
        found: list[ca.SX] = []
        for field in fields:
            every = ca.horzcat(*(bracket(field, g, x) for g in (self.equations.drift, *self.equations.unknown)))
            found += [_shared(every @ self.inverse[:, j]) for j in range(self.inverse.shape[1])]
        return found

    def known_equations(self, *told: ca.SX) -> Equations:
        """Return the system as one with known inputs (v, u) whose outputs are those it has, and whatever else is told."""
        outputs = ca.vertcat(self.equations.outputs, self.functions, *told)
        variable = sorted(set(ca.jacobian_sparsity(outputs, self.equations.x).row()))
        return replace(
            self.equations,
            drift=self.fields[0],
            known=(*self.fields[1:], *self.equations.known),
            unknown=(),
            outputs=outputs[variable],
            output_names=tuple(f"function {i}" for i in range(len(variable))),
        )

    def smooth_equations(self) -> Equations:
        """Return the system with v = d hh / dt under the known input u, to which the unknown inputs may react."""
        every = ca.horzcat(*self.fields[1:])
        moved = [ca.jacobian(self.chosen, self.equations.x) @ field for field in self.equations.known]
        fields = [field - every @ rate for field, rate in zip(self.equations.known, moved, strict=True)]
        return replace(self.known_equations(), known=(*self.fields[1:], *fields))

    def regular_at(self, space: Space) -> Rescaled | None:
        """Return the system rescaled by functions whose M is invertible at the place, if there are such."""
        entered = _entered(self.equations, self.functions)
        chosen = space.independent(ca.densify(entered))
        return replace(self, chosen=self.functions[list(chosen)]) if len(chosen) == entered.shape[1] else None


def rescale(space: Space, *, everywhere: bool = False) -> Rescaled | None:
    """Return the rescaled system, or None where no functions with an invertible M are found.

    Functions are derived along the known fields, and along the drift if their rate can be told without knowing the inputs;
    everywhere: not at generic states alone. Raises TooLargeError.
    """
    equations = space.equations
    functions = equations.outputs[list(space.telling(equations.outputs))]
    latest, waiting = functions, functions
    while True:
        entered = _entered(equations, functions)
        chosen = space.independent(ca.densify(entered))
        if len(chosen) == entered.shape[1]:
            return Rescaled(equations, functions, functions[list(chosen)])
        rates, waiting = _told_rates(space, functions, functions[list(chosen)], waiting, everywhere)
        found = ca.vertcat(space.derived(latest, equations.known), rates)
        every = ca.vertcat(functions, found)
        kept = space.telling(every)
        if len(kept) == functions.numel():
            return None
        latest = every[[i for i in kept if i >= functions.numel()]]
        functions, waiting = ca.vertcat(functions, latest), ca.vertcat(waiting, latest)


def _shared(expression: ca.SX) -> ca.SX:
    return without_repeats([expression])[0]


def _entered(equations: Equations, functions: ca.SX) -> ca.SX:
    """Return the Lie derivatives of the functions (k, 1) along the unknown inputs (k, p)."""
    return ca.horzcat(*(lie_derivative(functions, equations.x, g) for g in equations.unknown))


def _told_rates(space: Space, functions: ca.SX, chosen: ca.SX, waiting: ca.SX, everywhere: bool) -> tuple[ca.SX, ca.SX]:
    """Return the rates of those of the waiting functions whose rates can be told, and the functions that go on waiting.

    Let L_g s = lam M, with M of the chosen functions hh. The rate of s less lam times that of hh is L_{g_0} s - lam a: free of
    the unknown inputs; and known, if lam is a function of what is known (at generic states), or constant (everywhere).
    """
    equations, drift = space.equations, space.equations.drift
    M = _entered(equations, chosen)
    columns = list(space.independent(ca.densify(M.T))) if chosen.numel() else []
    rates, still = ca.SX(0, 1), ca.SX(0, 1)
    for s in ca.vertsplit(waiting) if waiting.numel() else []:
        rate = lie_derivative(s, equations.x, drift)
        if columns:
            lam = _shared(_entered(equations, s)[:, columns] @ ca.inv_minor(M[:, columns]))
            known = ca.SX(0, 1) if everywhere else functions
            told = len(space.telling(ca.vertcat(known, lam.T))) == known.numel()
            rate = rate - lam @ lie_derivative(chosen, equations.x, drift)
        else:
            told = True
        rates, still = (ca.vertcat(rates, rate), still) if told else (rates, ca.vertcat(still, s))
    return rates, still
