"""What outputs tell about a state, counted anew: polynomial systems, power series with gradients modulo a prime, plain elimination."""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

P = 2**61 - 1
Polynomial = Mapping[tuple[int, ...], int]  # exponents of (x, u, w) -> coefficient


def as_casadi(polynomial: Polynomial, symbols: Sequence[ca.SX]) -> ca.SX:
    return ca.SX(evaluate(polynomial, list(symbols), ca.SX(0), ca.SX))


def evaluate(polynomial: Polynomial, values: Sequence[Any], zero: Any, constant: Callable[[int], Any]) -> Any:
    total = zero
    for exponents, coefficient in polynomial.items():
        term = constant(coefficient)
        for value, exponent in zip(values, exponents, strict=True):
            for _ in range(exponent):
                term = term * value
        total = total + term
    return total


@dataclass(frozen=True)
class Jet:
    """A power series in t with the gradient of every coefficient, as long as it is known."""

    terms: tuple[tuple[int, tuple[int, ...]], ...]

    def __add__(self, other: Jet) -> Jet:
        pairs = zip(self.terms, other.terms, strict=False)
        return Jet(tuple(((a + b) % P, tuple((x + y) % P for x, y in zip(da, db, strict=True))) for (a, da), (b, db) in pairs))

    def __mul__(self, other: Jet) -> Jet:
        terms = []
        for k in range(min(len(self.terms), len(other.terms))):
            value, gradient = 0, [0] * len(self.terms[0][1])
            for j in range(k + 1):
                (a, da), (b, db) = self.terms[j], other.terms[k - j]
                value += a * b
                gradient = [(g + x * b + y * a) % P for g, x, y in zip(gradient, da, db, strict=True)]
            terms.append((value % P, tuple(gradient)))
        return Jet(tuple(terms))


def unit(width: int, column: int) -> tuple[int, ...]:
    return tuple(int(i == column) for i in range(width))


def rank_by_hand(rows: Sequence[Sequence[int]]) -> int:
    rows, rank = [list(row) for row in rows], 0
    for column in range(len(rows[0]) if rows else 0):
        pivot = next((i for i in range(rank, len(rows)) if rows[i][column] % P), None)
        if pivot is None:
            continue
        rows[rank], rows[pivot] = rows[pivot], rows[rank]
        inverse = pow(rows[rank][column], -1, P)
        for i in range(rank + 1, len(rows)):
            if factor := rows[i][column] * inverse % P:
                rows[i] = [(a - factor * b) % P for a, b in zip(rows[i], rows[rank], strict=True)]
        rank += 1
    return rank


@dataclass(frozen=True)
class ByHand:
    """Polynomials of (x, u, w): rates, or the next state, and outputs."""

    n: int
    m: int
    p: int
    motion: Sequence[Polynomial]
    outputs: Sequence[Polynomial]

    def dimension(self, orders: int, count: int, *, is_map: bool = False, seed: int = 0, known: Sequence[int] = ()) -> int:
        """rank J - rank J_w for `count` known inputs under one w, from a random state; columns w_0, ..., w_orders, x; known: unit rows."""
        draw, columns = random.Random(seed), self.p * (orders + 1)
        width = columns + self.n
        x = [(draw.randrange(P), unit(width, columns + i)) for i in range(self.n)]
        w = [[(draw.randrange(P), unit(width, self.p * k + j)) for k in range(orders + 1)] for j in range(self.p)]
        rows: list[tuple[int, ...]] = []
        for _ in range(count):
            u = [[(draw.randrange(P), (0,) * width) for _ in range(orders + 1)] for _ in range(self.m)]
            rows += (self._samples if is_map else self._derivatives)(x, [*u, *w], orders)
        rows += [unit(width, columns + i) for i in known]
        return rank_by_hand(rows) - rank_by_hand([row[:columns] for row in rows])

    def _derivatives(self, x: list, inputs: list, orders: int) -> list[tuple[int, ...]]:
        states = [Jet((start,)) for start in x]
        for k in range(orders + 1):
            values = [*states, *(Jet(tuple(series[: k + 1])) for series in inputs)]
            if k == orders:
                return [gradient for y in self._values(self.outputs, values, k + 1) for _, gradient in y.terms]
            rates = self._values(self.motion, values, k + 1)
            terms = [tuple(_divided(term, j + 1) for j, term in enumerate(rate.terms)) for rate in rates]
            states = [Jet((start, *rest)) for start, rest in zip(x, terms, strict=True)]
        raise AssertionError

    def _samples(self, x: list, inputs: list, orders: int) -> list[tuple[int, ...]]:
        rows, states = [], [Jet((start,)) for start in x]
        for k in range(orders + 1):
            values = [*states, *(Jet((series[k],)) for series in inputs)]
            rows += [y.terms[0][1] for y in self._values(self.outputs, values, 1)]
            states = self._values(self.motion, values, 1)
        return rows

    def _values(self, polynomials: Sequence[Polynomial], values: list[Jet], length: int) -> list[Jet]:
        width = len(values[0].terms[0][1])
        flat = lambda value: Jet(((value % P, (0,) * width), *[(0, (0,) * width)] * (length - 1)))  # noqa: E731
        return [evaluate(polynomial, values, flat(0), flat) for polynomial in polynomials]


def _divided(term: tuple[int, tuple[int, ...]], by: int) -> tuple[int, tuple[int, ...]]:
    inverse = pow(by, -1, P)
    return term[0] * inverse % P, tuple(entry * inverse % P for entry in term[1])


def random_polynomial(draw: random.Random, places: Sequence[int], width: int, terms: int, degree: int) -> Polynomial:
    """A few monomials of small degree in some of the variables."""
    polynomial: dict[tuple[int, ...], int] = {}
    for _ in range(terms):
        chosen = [draw.choice(places) for _ in range(draw.randint(1, degree))]
        polynomial[tuple(chosen.count(i) for i in range(width))] = draw.choice((-3, -2, -1, 1, 2, 3))
    return polynomial
