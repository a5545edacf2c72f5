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
from obsdesign.analysis.lie_expressions import IndependenceTest
from obsdesign.calculus import bracket, lie_derivative
from obsdesign.common_subexpressions import without_repeats


@dataclass(frozen=True, eq=False)
class RescaledSystem:
    """A canonic system. functions (k, 1): outputs and what they were redefined to; selected_functions (p, 1): hh, some of them."""

    equations: Equations
    functions: ca.SX
    selected_functions: ca.SX

    @cached_property
    def rates(self) -> ca.SX:
        """N = [a M], (p, p + 1): Lie derivatives of hh along g_0, g_1, ..., g_p."""
        x = self.equations.x
        return ca.horzcat(
            *(lie_derivative(self.selected_functions, x, field) for field in (self.equations.drift, *self.equations.unknown_fields))
        )

    @cached_property
    def inverse(self) -> ca.SX:
        """B = [1 0; a M]^-1, (p + 1, p + 1)."""
        p = self.selected_functions.numel()
        nu = ca.inv_minor(self.rates[:, 1:])
        below = ca.horzcat(-nu @ self.rates[:, 0], nu)
        return ca.vertcat(ca.horzcat(ca.SX.ones(1), ca.SX.zeros(1, p)), below)

    @cached_property
    def fields(self) -> tuple[ca.SX, ...]:
        """gh_0, gh_1, ..., gh_p, each (n, 1)."""
        all_fields = ca.horzcat(self.equations.drift, *self.equations.unknown_fields)
        return tuple(_without_repeats(all_fields @ self.inverse[:, j]) for j in range(self.inverse.shape[1]))

    @property
    def nonzero_fields(self) -> tuple[ca.SX, ...]:
        """The known fields and the rescaled ones, those that vanish left out."""
        return tuple(field for field in (*self.equations.known_fields, *self.fields) if not ca.simplify(field).is_zero())

    def rate_change(self, field: ca.SX) -> ca.SX:
        """rate(field) = (L_field N) B as a column."""
        shape = self.rates.shape
        derivative = ca.reshape(lie_derivative(ca.vec(self.rates), self.equations.x, field), *shape)
        return ca.vec(_without_repeats(derivative @ self.inverse))

    @cached_property
    def rate_changes_by_known_fields(self) -> ca.SX:
        """rate(f_i) of every known field: what switching known inputs tells at once."""
        return ca.vertcat(ca.SX(0, 1), *(self.rate_change(field) for field in self.equations.known_fields))

    @cached_property
    def tensor(self) -> ca.SX:
        """T = rate(gh_j) for j = 0..p (one w without drift: L_g^2 h / (L_g h)^2, the papers' rho and tau)."""
        return ca.vertcat(*(self.rate_change(field) for field in self.fields))

    def autobrackets(self, fields: Sequence[ca.SX]) -> list[ca.SX]:
        """Return the autobrackets phi^(alpha, j) = sum_k B_kj [phi^alpha, g_k], j = 0..p, of every field phi^alpha."""
        x = self.equations.x
        brackets: list[ca.SX] = []
        for field in fields:
            lie_brackets = ca.horzcat(*(bracket(field, g, x) for g in (self.equations.drift, *self.equations.unknown_fields)))
            brackets += [_without_repeats(lie_brackets @ self.inverse[:, j]) for j in range(self.inverse.shape[1])]
        return brackets

    def equations_with_known_inputs(self, *extra_outputs: ca.SX) -> Equations:
        """Return the system as one with known inputs (v, u) whose outputs are those it has, and whatever else is told."""
        outputs = ca.vertcat(self.equations.outputs, self.functions, *extra_outputs)
        variable = sorted(set(ca.jacobian_sparsity(outputs, self.equations.x).row()))
        return replace(
            self.equations,
            drift=self.fields[0],
            known_fields=(*self.fields[1:], *self.equations.known_fields),
            unknown_fields=(),
            outputs=outputs[variable],
            output_names=tuple(f"function {i}" for i in range(len(variable))),
        )

    def equations_under_smooth_input(self) -> Equations:
        """Return the system with v = d hh / dt under the known input u, to which the unknown inputs may react."""
        rescaled_fields = ca.horzcat(*self.fields[1:])
        rates = [ca.jacobian(self.selected_functions, self.equations.x) @ field for field in self.equations.known_fields]
        fields = [field - rescaled_fields @ rate for field, rate in zip(self.equations.known_fields, rates, strict=True)]
        return replace(self.equations_with_known_inputs(), known_fields=(*self.fields[1:], *fields))

    def rescale_at(self, independence: IndependenceTest) -> RescaledSystem | None:
        """Return the system rescaled by functions whose M is invertible at the place, if there are such."""
        input_derivatives = _derivatives_along_unknown_inputs(self.equations, self.functions)
        independent = independence.independent_rows(ca.densify(input_derivatives))
        return (
            replace(self, selected_functions=self.functions[list(independent)]) if len(independent) == input_derivatives.shape[1] else None
        )


def rescale(independence: IndependenceTest, *, everywhere: bool = False) -> RescaledSystem | None:
    """Return the rescaled system, or None where no functions with an invertible M are found.

    Functions are derived along the known fields, and along the drift if their rate can be told without knowing the inputs;
    everywhere: not at generic states alone. Raises TooLargeError.
    """
    equations = independence.equations
    functions = equations.outputs[list(independence.independent_functions(equations.outputs))]
    latest, pending = functions, functions
    while True:
        input_derivatives = _derivatives_along_unknown_inputs(equations, functions)
        invertible = independence.independent_rows(ca.densify(input_derivatives))
        if len(invertible) == input_derivatives.shape[1]:
            return RescaledSystem(equations, functions, functions[list(invertible)])
        rates, pending = _computable_rates(independence, functions, functions[list(invertible)], pending, everywhere)
        candidates = ca.vertcat(independence.lie_derivatives(latest, equations.known_fields), rates)
        stacked = ca.vertcat(functions, candidates)
        independent = independence.independent_functions(stacked)
        if len(independent) == functions.numel():
            return None
        latest = stacked[[i for i in independent if i >= functions.numel()]]
        functions, pending = ca.vertcat(functions, latest), ca.vertcat(pending, latest)


def _without_repeats(expression: ca.SX) -> ca.SX:
    return without_repeats([expression])[0]


def _derivatives_along_unknown_inputs(equations: Equations, functions: ca.SX) -> ca.SX:
    """Return the Lie derivatives of the functions (k, 1) along the unknown inputs (k, p)."""
    return ca.horzcat(*(lie_derivative(functions, equations.x, g) for g in equations.unknown_fields))


def _computable_rates(
    independence: IndependenceTest, functions: ca.SX, selected_functions: ca.SX, pending: ca.SX, everywhere: bool
) -> tuple[ca.SX, ca.SX]:
    """Return the rates of those of the waiting functions whose rates can be told, and the functions that go on waiting.

    Let L_g s = lam M, with M of the chosen functions hh. The rate of s less lam times that of hh is L_{g_0} s - lam a: free of
    the unknown inputs; and known, if lam is a function of what is known (at generic states), or constant (everywhere).
    """
    equations, drift = independence.equations, independence.equations.drift
    M = _derivatives_along_unknown_inputs(equations, selected_functions)
    pivot_columns = list(independence.independent_rows(ca.densify(M.T))) if selected_functions.numel() else []
    rates, still_pending = ca.SX(0, 1), ca.SX(0, 1)
    for s in ca.vertsplit(pending) if pending.numel() else []:
        rate = lie_derivative(s, equations.x, drift)
        if pivot_columns:
            lam = _without_repeats(_derivatives_along_unknown_inputs(equations, s)[:, pivot_columns] @ ca.inv_minor(M[:, pivot_columns]))
            known_functions = ca.SX(0, 1) if everywhere else functions
            is_computable = len(independence.independent_functions(ca.vertcat(known_functions, lam.T))) == known_functions.numel()
            rate = rate - lam @ lie_derivative(selected_functions, equations.x, drift)
        else:
            is_computable = True
        rates, still_pending = (ca.vertcat(rates, rate), still_pending) if is_computable else (rates, ca.vertcat(still_pending, s))
    return rates, still_pending
