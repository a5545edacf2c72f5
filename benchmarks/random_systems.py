"""Random systems: the verdict by the recursion against the jets of the unknown inputs, another way to the same number."""

from __future__ import annotations

import random
from collections import Counter
from itertools import product
from time import perf_counter

import casadi as ca

import obsdesign as od
from benchmarks.tables import machine, table, write

COUNT = 300
MARGIN = 6
"""The jets are followed this many orders beyond 2 n + 2."""


def random_system(seed: int) -> od.ControlAffineSystem:
    """Return a system with sparse quadratic fields; every third one hides a coordinate behind a change of state."""
    draw = random.Random(seed)
    n, unknown, known = draw.randint(3, 5), draw.randint(1, 2), draw.randint(0, 2)
    x = ca.SX.sym("x", n)
    hidden = seed % 3 == 0
    seen = n - 1 if hidden else n

    def polynomial(terms: int, among: int) -> ca.SX:
        total = ca.SX(0)
        for _ in range(terms):
            factors = [x[draw.randrange(among)] for _ in range(draw.randint(0, 2))]
            term = ca.SX(draw.choice((-3, -2, -1, 1, 2, 3)))
            for factor in factors:
                term = term * factor
            total = total + term
        return total

    def field() -> ca.SX:
        entries = [polynomial(draw.randint(0, 2), seen) for _ in range(seen)]
        return ca.vertcat(*entries, *[polynomial(2, n) for _ in range(n - seen)])

    def output() -> ca.SX:
        return x[draw.randrange(seen)] + polynomial(draw.randint(0, 1), seen)

    outputs = [output() for _ in range(draw.randint(1, 2))]
    fields = [field() for _ in range(1 + known + unknown)]
    if hidden:
        outputs, fields = _mixed(x, outputs, fields, draw)
    usable = [h for h in outputs if ca.jacobian_sparsity(h, x).nnz()] or [x[0]]
    return od.ControlAffineSystem(
        state=x,
        names=tuple(f"x{i}" for i in range(n)),
        drift=fields[0],
        known={f"u{i}": fields[1 + i] for i in range(known)},
        unknown={f"w{i}": fields[1 + known + i] for i in range(unknown)},
        outputs={f"y{i}": h for i, h in enumerate(usable)},
    )


def _mixed(x: ca.SX, outputs: list[ca.SX], fields: list[ca.SX], draw: random.Random) -> tuple[list[ca.SX], list[ca.SX]]:
    """Return outputs and fields in the state z = x + c x_last^2 (first), x_i + d x_(i+1) (others): the inverse is put in."""
    n = x.numel()
    shifts = [draw.choice((-1, 0, 1, 2)) for _ in range(n - 1)]
    old = [x[n - 1]]
    for i in reversed(range(n - 1)):
        old.insert(0, x[i] - shifts[i] * old[0] ** (2 if i == 0 else 1))
    before = ca.vertcat(*old)
    forward = ca.vertcat(*(x[i] + shifts[i] * x[i + 1] ** (2 if i == 0 else 1) for i in range(n - 1)), x[n - 1])
    jacobian = ca.substitute(ca.jacobian(forward, x), x, before)
    return [ca.substitute(h, x, before) for h in outputs], [jacobian @ ca.substitute(f, x, before) for f in fields]


def main() -> None:
    """Write benchmarks/random_systems.md."""
    tally: Counter[tuple[int, int, str]] = Counter()
    open_seeds, differing = [], []
    start = perf_counter()
    for seed in range(COUNT):
        system = random_system(seed)
        verdict = od.observability(system)
        jets = od.observability(system, method="jets", orders=2 * len(system.names) + 2 + MARGIN, seed=1)
        label = "undecided" if not verdict.decided else "agree" if verdict.dimension == jets.dimension else "DIFFER"
        tally[len(system.known), len(system.unknown), label] += 1
        if label == "undecided":
            open_seeds.append(seed)
        if label == "DIFFER":
            differing.append(seed)
    labels = ("agree", "undecided", "DIFFER")
    rows = [(m, p, *(tally[m, p, label] for label in labels)) for m, p in product(range(3), (1, 2))]
    rows.append(("all", "", *(sum(tally[m, p, label] for m, p in product(range(3), (1, 2))) for label in labels)))
    text = [
        "# Random systems: recursion against jets",
        "",
        f"{COUNT} systems, seeds 0 to {COUNT - 1} of `random_systems.random_system`: 3 to 5 states, sparse quadratic fields with drift,",
        f"every third with a hidden coordinate. Jets up to order 2 n + {2 + MARGIN}. {perf_counter() - start:.0f} s. {machine()}",
        "",
        table(("known", "unknown", *labels), rows),
        "",
        f"Undecided: {open_seeds or 'none'}. Different: {differing or 'none'}.",
    ]
    write("random_systems", "\n".join(text))
