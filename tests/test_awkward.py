"""Awkward systems and points: the verdict is right, or undecided; it is never wrong."""

import casadi as ca
import numpy as np
import pytest

import obsdesign as od


def system(n, drift, outputs, known=(), unknown=()):
    """A system of n states from functions of these."""
    x = ca.vertcat(*[ca.SX.sym(f"x{i + 1}") for i in range(n)])
    entries = ca.vertsplit(x)

    def column(function):
        return ca.vertcat(*[ca.SX(entry) for entry in function(*entries)])

    return od.ControlAffineSystem(
        state=x,
        names=tuple(f"x{i + 1}" for i in range(n)),
        drift=column(drift),
        known={f"u{i}": column(field) for i, field in enumerate(known)},
        unknown={f"w{i}": column(field) for i, field in enumerate(unknown)},
        outputs={f"y{i}": ca.SX(h) for i, h in enumerate(outputs(*entries))},
    )


def power(x, exponent):
    product = ca.SX(1)
    for _ in range(exponent):
        product = product * x
    return product


def large(x):
    return ca.exp(4000 + x)


# name: (system, question, dimension); a decided verdict has this dimension
CASES = {
    # x1' = x2 + x3 w: at x3 = 0 the rate of x1 is x2 for every w, nearby w hides it
    "gain vanishes at the point": (
        system(3, lambda a, b, c: [b, 0, 1], lambda a, b, c: [a, c], unknown=[lambda a, b, c: [c, 0, 0]]),
        {"at": [0, 1, 0]},
        3,
    ),
    "gain vanishes for good": (
        system(3, lambda a, b, c: [b, 0, 0], lambda a, b, c: [a, c], unknown=[lambda a, b, c: [c, 0, 0]]),
        {"at": [0, 1, 0]},
        3,
    ),
    "gain vanishes, smooth input": (
        system(3, lambda a, b, c: [b, 0, 1], lambda a, b, c: [a, c], [lambda a, b, c: [0, 1, 0]], [lambda a, b, c: [ca.sin(c), 0, 0]]),
        {"at": [0, 1, 0], "known_inputs": "smooth"},
        3,
    ),
    "gain of higher order": (
        system(
            4,
            lambda a, b, c, d: [b * power(c, 25), 0, 1, 0],
            lambda a, b, c, d: [a, c, d * d],
            unknown=[lambda a, b, c, d: [power(c, 30), 0, 0, 0]],
        ),
        {"at": [0, 1, 0, 0]},
        3,
    ),
    "held inputs are multiplied exactly": (
        system(2, lambda a, b: [-0.3 * b, 0], lambda a, b: [a], [lambda a, b: [0.1 * b, 0]]),
        {"held": {"u0": 3}},
        1,
    ),
    "held input and a constant field": (
        system(3, lambda a, b, c: [b * c, 0, -0.3], lambda a, b, c: [a], [lambda a, b, c: [0, 0, 0.1]]),
        {"held": {"u0": 3.0}},
        2,
    ),
    "saturated sensor": (system(1, lambda a: [0], lambda a: [ca.tanh(a)]), {"at": [100.0]}, 1),
    "saturated actuator": (system(2, lambda a, b: [ca.tanh(b), 0], lambda a, b: [a]), {"at": [0, 95.0]}, 2),
    "tiny coefficient": (system(2, lambda a, b: [0, 0], lambda a, b: [ca.exp(a + b), a + b + 1e-80 * b]), {}, 2),
    "tiny coefficient, rational": (system(2, lambda a, b: [0, 0], lambda a, b: [a + b, a + b + 1e-90 * b]), {}, 2),
    "rates that differ by 1e-10": (
        system(8, lambda *v: [(1 + (i + 1) * 1e-10) * x for i, x in enumerate(v)], lambda *v: [ca.sin(sum(v))]),
        {},
        8,
    ),
    "rates that differ by 1e-10, rational": (
        system(10, lambda *v: [(1 + (i + 1) * 1e-10) * x for i, x in enumerate(v)], lambda *v: [sum(v)]),
        {},
        10,
    ),
    "rates that differ by 1e-10, at a point": (
        system(10, lambda *v: [(1 + (i + 1) * 1e-10) * x for i, x in enumerate(v)], lambda *v: [sum(v)]),
        {"at": [1.0] * 10},
        10,
    ),
    "kink not far away": (system(3, lambda a, b, c: [0, c * ca.fmax(1000.1 - a, 0), 0], lambda a, b, c: [a, b]), {"at": [1000, 1, 1]}, 3),
    "kink nearer": (system(3, lambda a, b, c: [0, ca.if_else(a > 5e-4, 0, c), 0], lambda a, b, c: [a, b]), {"at": [4e-4, 1, 1]}, 3),
    "kink on the way": (system(1, lambda a: [1], lambda a: [ca.if_else(a < 0.3, power(a, 30), 0)]), {"at": [0.0]}, 1),
    "rescaled fields have a pole": (
        system(2, lambda a, b: [b, 0], lambda a, b: [a], [lambda a, b: [0, 1]], [lambda a, b: [a, 0]]),
        {"at": [0.0, 1.0]},
        2,
    ),
    "two ranges, parked": (
        system(
            4,
            lambda x, y, u, v: [u, v, 0, 0],
            lambda x, y, u, v: [ca.sqrt((x - 3) ** 2 + y * y), ca.sqrt(x * x + (y - 4) ** 2)],
            [lambda x, y, u, v: [0, 0, 1, 0]],
            [lambda x, y, u, v: [0, 0, 0, 1]],
        ),
        {"at": [1.0, 0, 0, 0]},
        4,
    ),
    # under one smooth input only L_g0 s + u L_f s is known: outputs must not be redefined along each
    "redefined under a smooth input": (
        system(
            5,
            lambda a, b, c, d, e: [b, d, e, 0, 0],
            lambda a, b, c, d, e: [a],
            [lambda a, b, c, d, e: [c, 0, 0, 0, 0]],
            [lambda a, b, c, d, e: [0, 0, 1, 0, 0]],
        ),
        {"at": [1.0] * 5, "known_inputs": "smooth"},
        2,
    ),
    # c' = d + a w and d a^2 vanishes at a = 0: there d is not known
    "told at generic states alone": (
        system(
            5,
            lambda a, b, c, d, e: [0, 0, d, e, 0],
            lambda a, b, c, d, e: [a * a, b, c],
            unknown=[lambda a, b, c, d, e: [0, 1, a, 0, 0], lambda a, b, c, d, e: [0, 0, 0, 1, 0]],
        ),
        {"at": [0, 1, 1, 1, 1.0]},
        3,
    ),
    "special state at t = 1/2": (
        system(2, lambda a, b: [1, 0], lambda a, b: [a, b * power(a, 30) * power(a - 0.5, 4)]),
        {"at": [0.0, 1]},
        2,
    ),
    "gain lost in rounding": (
        system(
            3, lambda a, b, c: [b, 0, 0], lambda a, b, c: [a, c], unknown=[lambda a, b, c: [large(a) * ca.exp(c) - large(a + c) + 1, 0, 0]]
        ),
        {},
        2,
    ),
    "drift lost in rounding": (
        system(
            3,
            lambda a, b, c: [large(a) * ca.exp(b) - large(a + b) + b, 0, 0],
            lambda a, b, c: [a, c],
            [lambda a, b, c: [1, 0, 0]],
            [lambda a, b, c: [0, 0, 1], lambda a, b, c: [0, 0, a]],
        ),
        {},
        3,
    ),
}
MUST_BE_DECIDED = {
    name for name in CASES if "held" in name or "tiny" in name or "rates" in name or "saturated" in name or "kink n" in name
} | {
    "gain vanishes for good",
    "gain vanishes at the point",
    "rescaled fields have a pole",
    "two ranges, parked",
}


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("name", CASES)
def test_never_wrong(name, seed):
    asked, question, dimension = CASES[name]
    verdict = od.observability(asked, seed=seed, **question)
    assert verdict.decided or name not in MUST_BE_DECIDED
    assert verdict.dimension == dimension or (not verdict.decided and verdict.dimension < dimension)


@pytest.mark.parametrize("name", CASES)
def test_the_definition_itself_is_never_wrong(name):
    asked, question, dimension = CASES[name]
    verdict = od.observability(asked, method="jets", **question)
    assert verdict.dimension == dimension or (not verdict.decided and verdict.dimension < dimension)


HIDDEN = {
    "coefficient 1e-16": (system(2, lambda a, b: [0, 0], lambda a, b: [a + 1e-16 * b]), None, [-1e-16, 1.0]),
    "two gains of 1e-9": (system(3, lambda a, b, c: [0, 0, 0], lambda a, b, c: [a + 1e-9 * b, b + 1e-9 * c]), None, [1e-18, -1e-9, 1.0]),
    "exp(-81)": (system(2, lambda a, b: [0, 0], lambda a, b: [a + ca.exp(-b * b)]), [0.0, 9.0], [18 * np.exp(-81.0), 1.0]),
    "exp(1500)": (system(2, lambda a, b: [0, 0], lambda a, b: [a + ca.exp(1500 + b)]), [0.0, 0.0], [1.0, 0.0]),
}


@pytest.mark.parametrize("name", HIDDEN)
def test_a_state_that_is_hidden_by_a_little_is_hidden(name):
    asked, at, direction = HIDDEN[name]
    verdict = od.observability(asked, at=at)
    assert verdict.observable_states == ()
    assert verdict.null_space.shape[1] == 1
    vector = verdict.null_space[:, 0]
    assert np.allclose(vector / vector[np.argmax(np.abs(vector))], direction, rtol=1e-14, atol=0)
