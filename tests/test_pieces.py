"""Functions with pieces: random polynomial systems whose expressions are others beyond a surface, against Lie derivatives in fractions."""

import random
from fractions import Fraction

import casadi as ca
import pytest

import obsdesign as od

# A polynomial is {exponents: coefficient}.


def random_polynomial(generator, n, terms=2):
    found = {}
    for _ in range(generator.randint(0, terms)):
        powers = [0] * n
        for _ in range(generator.randint(0, 2)):
            powers[generator.randrange(n)] += 1
        found[tuple(powers)] = generator.choice([-3, -2, -1, 1, 2, 3])
    return found


def plus(a, b):
    every = {key: a.get(key, 0) + b.get(key, 0) for key in a.keys() | b.keys()}
    return {key: value for key, value in every.items() if value}


def slope(a, i):
    return {(*key[:i], key[i] - 1, *key[i + 1 :]): value * key[i] for key, value in a.items() if key[i]}


def times(a, b):
    found = {}
    for first, value in a.items():
        for second, other in b.items():
            found = plus(found, {tuple(map(sum, zip(first, second, strict=True))): value * other})
    return found


def value_at(a, x):
    total = Fraction(0)
    for key, value in a.items():
        term = Fraction(value)
        for power, entry in zip(key, x, strict=True):
            term *= entry**power
        total += term
    return total


def rank(rows):
    rows, found = [list(row) for row in rows], 0
    for j in range(len(rows[0])):
        i = next((i for i in range(found, len(rows)) if rows[i][j]), None)
        if i is None:
            continue
        rows[found], rows[i] = rows[i], rows[found]
        for k in range(found + 1, len(rows)):
            factor = rows[k][j] / rows[found][j]
            rows[k] = [a - factor * b for a, b in zip(rows[k], rows[found], strict=True)]
        found += 1
    return found


def lie_rank(output, fields, x):
    """The rank at x of all Lie derivatives along words of up to 5 fields (as many as 150)."""
    latest, every = [output], [output]
    for _ in range(5):
        derived = []
        for h in latest:
            for field in fields:
                total = {}
                for i, rate in enumerate(field):
                    total = plus(total, times(slope(h, i), rate))
                derived += [total] * bool(total)
        latest, every = derived, every + derived
        if len(every) > 150:
            break
    return rank([[value_at(slope(h, i), x) for i in range(len(x))] for h in every])


def expression(a, entries):
    total = ca.SX(0)
    for key, value in a.items():
        term = ca.SX(float(value))
        for power, entry in zip(key, entries, strict=True):
            term = term * entry**power if power else term
        total = total + term
    return total


FORMS = (
    lambda c, a, b: ca.if_else(c > 0, a, b),
    lambda c, a, b: ca.if_else(ca.logic_not(c > 0), b, a),
    lambda c, a, b: a * (1 + ca.sign(c)) / 2 + b * (1 - ca.sign(c)) / 2,
    lambda c, a, b: (a * (ca.fabs(c) + c) + b * (ca.fabs(c) - c)) / (2 * ca.fabs(c)),
    lambda c, a, b: a * (1 + ca.floor(c / (1 + c * c))) - b * ca.floor(c / (1 + c * c)),
    lambda c, a, b: a * (1 + ca.copysign(1, c)) / 2 + b * (1 - ca.copysign(1, c)) / 2,
)
"""What is a where c > 0 and b where c < 0."""


def wrong(seed):
    """What is wrong with the verdicts on the system of a seed, at a point and at generic states."""
    generator = random.Random(seed)
    n = generator.randint(2, 3)
    state = ca.SX.sym("x", n)
    entries = ca.vertsplit(state)
    point = [Fraction(generator.randint(-8, 8), generator.choice([1, 2, 4])) for _ in range(n)]
    border = plus({(1, *[0] * (n - 1)): 1}, random_polynomial(generator, n))
    if generator.random() < 0.15:
        border = plus(border, {(0,) * n: -value_at(border, point)})
    if not any(map(any, border)):
        return []
    pieces = []

    def piecewise(a):
        b = random_polynomial(generator, n) if generator.random() < 0.6 else a
        form = generator.choice(FORMS)
        pieces.append((a, b))
        parts = [expression(part, entries) for part in (a, b)]
        return parts[0] if a is b else form(expression(border, entries), *parts)

    fields = [[piecewise(random_polynomial(generator, n)) for _ in range(n)] for _ in range(generator.randint(1, 2))]
    output = piecewise(plus({tuple(int(i == n - 1) for i in range(n)): 1}, random_polynomial(generator, n)))
    if not ca.jacobian_sparsity(output, state).nnz():
        return []
    system = od.ControlAffineSystem(
        state,
        tuple(f"x{i}" for i in range(n)),
        ca.vertcat(*fields[0]),
        {f"u{k}": ca.vertcat(*field) for k, field in enumerate(fields[1:])},
        outputs={"y": output},
    )
    on_border = value_at(border, point) == 0 and any(a != b for a, b in pieces)
    found = []
    for at in ([float(entry) for entry in point], None):
        try:
            verdict = od.observability(system, at, seed=seed)
        except od.InputError as error:
            refused = on_border and at is not None and "finite smooth value" in str(error)
            found += [] if refused or "depend" in str(error) else [str(error)]
            continue
        x = [Fraction(float(entry)) for entry in verdict.at]
        side = 0 if value_at(border, x) > 0 else 1
        parts = [pair[side] for pair in pieces]
        right = lie_rank(parts[-1], [parts[k * n : (k + 1) * n] for k in range(len(fields))], x)
        agrees = verdict.dimension == right if verdict.decided else verdict.dimension <= right
        found += [] if agrees and not (on_border and at is not None) else [(at, verdict.dimension, verdict.decided, right)]
    return found


@pytest.mark.parametrize("seeds", [range(40), pytest.param(range(40, 700), marks=pytest.mark.slow)])
def test_each_piece_is_judged_by_itself_and_borders_are_refused(seeds):
    assert {seed: found for seed in seeds if (found := wrong(seed))} == {}
