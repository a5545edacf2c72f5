"""What is computed twice becomes one node, and stays the function that it was, whatever symbols are called."""

from __future__ import annotations

import casadi as ca
import pytest

import obsdesign as od
from obsdesign.common_subexpressions import without_repeats


def test_symbols_of_one_name_stay_apart():
    """(k_1 + k_2) / (k_1 a / a) = 1 + k_2 / k_1 = 7/2 for k = (2, 5); with k_2 in the place of k_1 it is 7/5."""
    a = [1 - ca.tanh(ca.SX.sym("x")) ** 2 for _ in range(2)]
    x, k = ca.symvar(ca.vertcat(*a)), [ca.SX.sym("k") for _ in range(2)]
    again = ca.substitute(a[1], x[1], x[0])
    (found,) = without_repeats([(k[0] + k[1]) / (k[0] * (a[0] / again))])
    assert float(ca.Function("found", [x[0], *k], [found])(0.3, 2, 5)) == pytest.approx(3.5)


def test_repeats_become_one_node():
    x = ca.SX.sym("x")
    found = without_repeats([ca.sin(x * x) + ca.cos(x), ca.sin(x * x)])
    assert ca.n_nodes(ca.vertcat(*found)) < ca.n_nodes(ca.vertcat(ca.sin(x * x) + ca.cos(x), ca.sin(x * x)))


@pytest.mark.parametrize(
    ("function", "slope"),
    [(ca.tanh, lambda a: 1 - ca.tanh(a) ** 2), (ca.atan, lambda a: 1 / (1 + a * a)), (ca.exp, ca.exp)],
)
@pytest.mark.parametrize("at", [None, [0.5, 1.0, -2.0]])
def test_an_input_that_masks_the_only_output(function, slope, at):
    """With z = (f(a), b, c) it is the linear system z' = A z + b u + e w, y = c z with c e != 0.

    y = c z alone is known: w cancels whatever else y' holds, and under two known inputs y' differs by c b (u_1 - u_2): 1 of 3,
    for any f.
    """
    x = ca.SX.sym("x", 3)
    a, b, c = ca.vertsplit(x)
    system = od.ControlAffineSystem(
        state=x,
        names=("a", "b", "c"),
        drift=ca.vertcat(c / slope(a), 1.5 * b - c, -1.5 * function(a) - 0.2 * b + c),
        known={"u": ca.vertcat(0.5 / slope(a), 0, -0.6)},
        unknown={"w": ca.vertcat(1 / slope(a), 0, 0)},
        outputs={"y": -3 * function(a) - b + 5 * c},
    )
    assert od.observability(system, at=at).dimension == 1
