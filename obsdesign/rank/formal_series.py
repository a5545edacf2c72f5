"""Functions on residues and on power series over them: at t = 0 a symbol, from there on by the function's own equation.

exp(a)' = exp(a) a',  log(a)' = a' / a,  (cos a, sin a)' = (-sin a, cos a) a',  (a^b)' = a^b (b log a)',
atan2(a, b)' = (a' b - a b') / (a^2 + b^2).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import casadi as ca
import flint
from flint import nmod, nmod_poly

from obsdesign.rank.symbols import PI, PRIME, ROOT_OF_PI, Symbols, as_small_integer, direction_symbol, odd_symbol

Residue = nmod | nmod_poly
_HALF = pow(2, -1, PRIME)


def product(a: Residue, b: Residue) -> Residue:
    """Return a b, series cut after `flint.ctx.cap` terms."""
    return a.mul_low(b, flint.ctx.cap) if isinstance(a, nmod_poly) and isinstance(b, nmod_poly) else a * b


def inverse(a: Residue) -> Residue:
    """Return 1 / a; raises ZeroDivisionError."""
    if isinstance(a, nmod):
        return 1 / a
    if a[0] == 0:  # flint would end the process
        raise ZeroDivisionError("a series without constant term has no inverse")
    return a.inverse_series_trunc(flint.ctx.cap)


def quotient(a: Residue, b: Residue) -> Residue:
    """Return a / b."""
    return product(a, inverse(b))


def as_series(a: Residue) -> nmod_poly:
    """Return the residue as a series."""
    return a if isinstance(a, nmod_poly) else _constant(int(a))


def _constant_term(a: Residue) -> int:
    return int(a[0]) if isinstance(a, nmod_poly) else int(a)


def _is_constant(a: Residue) -> bool:
    return isinstance(a, nmod) or a.degree() < 1


def _integral(rate: Residue) -> nmod_poly:
    """Return int rate dt, 0 at t = 0, cut."""
    return as_series(rate).integral().truncate(flint.ctx.cap)


def _constant(value: int) -> nmod_poly:
    return nmod_poly([value], PRIME)


def _rate(a: Residue) -> nmod_poly:
    """Return a'."""
    return as_series(a).derivative()


def _integral_quotient(a: Residue, divisor: Residue) -> nmod_poly:
    """Return int a' / divisor dt."""
    return _integral(quotient(_rate(a), divisor))


def _without_constant(a: Residue) -> nmod_poly:
    """Return the series without its constant term."""
    a = as_series(a)
    return a - a[0]


def _exp_without_constant(series: nmod_poly) -> nmod_poly:
    """Return exp of a series without constant term, by Newton's method: z <- z (1 + rest - log z), twice as many terms each time."""
    z, terms, cap = _constant(1), 1, flint.ctx.cap
    while terms < cap:
        terms = min(2 * terms, cap)
        logarithm = z.derivative().mul_low(z.inverse_series_trunc(terms), terms).integral()
        z = z.mul_low(1 + series - logarithm, terms)
    return z


def _cos_sin_without_constant(series: nmod_poly) -> tuple[nmod_poly, nmod_poly]:
    """Return (cos, sin) of a series without constant term, by Newton's method on the angle that is left."""
    c, s, terms, cap = _constant(1), _constant(0), 1, flint.ctx.cap
    while terms < cap:
        terms = min(2 * terms, cap)
        rate = c.mul_low(s.derivative(), terms) - s.mul_low(c.derivative(), terms)
        size = c.mul_low(c, terms) + s.mul_low(s, terms)
        remainder = series.truncate(terms) - rate.mul_low(size.inverse_series_trunc(terms), terms).integral().truncate(terms)
        # the turn by what is left, to second order, back on the unit circle to the terms that count
        c, s = c - s.mul_low(remainder, terms), s + c.mul_low(remainder, terms)
        correction = (3 - c.mul_low(c, terms) - s.mul_low(s, terms)) * _HALF
        c, s = c.mul_low(correction, terms), s.mul_low(correction, terms)
    return c, s


@dataclass(frozen=True)
class ResidueOperations:
    """Operations of a graph on residues and series of them, with the values that `symbols` gives."""

    symbols: Symbols

    def exp(self, a: Residue) -> Residue:
        """exp(a)."""
        start = nmod(self.symbols.exp(_constant_term(a)), PRIME)
        return start if _is_constant(a) else _exp_without_constant(_without_constant(a)) * start

    def log(self, a: Residue) -> Residue:
        """log(a)."""
        start = nmod(self.symbols.log(_constant_term(a)), PRIME)
        return start if _is_constant(a) else start + _integral_quotient(a, a)

    def sqrt(self, a: Residue) -> Residue:
        """a^(1/2)."""
        start = nmod(self.symbols.sqrt(_constant_term(a)), PRIME)
        return start if _is_constant(a) else _exp_without_constant(_integral_quotient(a, a) * _HALF) * start

    def power(self, a: Residue, b: Residue) -> Residue:
        """a^b; whole b need no symbol, and no a other than 0."""
        integer = as_small_integer(_constant_term(b)) if _is_constant(b) else None
        if integer is not None:
            return self.integer_power(a, integer)
        start = nmod(self.symbols.power(_constant_term(a), _constant_term(b)), PRIME)
        if _is_constant(a) and _is_constant(b):
            return start
        a, b = (as_series(a), as_series(b))
        logarithm = product(b, as_series(self.log(a)))
        return _exp_without_constant(_without_constant(logarithm)) * start

    @staticmethod
    def integer_power(a: Residue, exponent: int) -> Residue:
        """a^k for whole k, 1 for k = 0."""
        if exponent < 0:
            a, exponent = inverse(a), -exponent
        return a**exponent if isinstance(a, nmod) else a.pow_trunc(exponent, flint.ctx.cap)

    def circle(self, a: Residue) -> tuple[Residue, Residue]:
        """(cos a, sin a)."""
        c, s = (nmod(value, PRIME) for value in self.symbols.circle(_constant_term(a)))
        if _is_constant(a):
            return c, s
        d, t = _cos_sin_without_constant(_without_constant(a))
        return d * c - t * s, t * c + d * s

    def sin(self, a: Residue) -> Residue:
        """sin(a)."""
        return self.circle(a)[1]

    def cos(self, a: Residue) -> Residue:
        """cos(a)."""
        return self.circle(a)[0]

    def tan(self, a: Residue) -> Residue:
        """tan(a)."""
        c, s = self.circle(a)
        return quotient(s, c)

    def sinh(self, a: Residue) -> Residue:
        """(exp(a) - exp(-a)) / 2."""
        z = self.exp(a)
        return (z - inverse(z)) * _HALF

    def cosh(self, a: Residue) -> Residue:
        """(exp(a) + exp(-a)) / 2."""
        z = self.exp(a)
        return (z + inverse(z)) * _HALF

    def tanh(self, a: Residue) -> Residue:
        """(z - 1) / (z + 1) with z = exp(a)^2."""
        z = self.exp(a)
        z = product(z, z)
        return quotient(z - 1, z + 1)

    def erf(self, a: Residue) -> Residue:
        """erf(a)' = 2 / pi^(1/2) exp(-a^2) a'."""
        start = nmod(odd_symbol("erf", _constant_term(a)), PRIME)
        if _is_constant(a):
            return start
        return start + _integral(product(self.exp(-product(a, a)), _rate(a))) * (nmod(2, PRIME) / ROOT_OF_PI)

    def erfinv(self, a: Residue) -> Residue:
        """Y with y' = pi^(1/2) / 2 exp(y^2) a': every pass gives one more coefficient."""
        start = odd_symbol("erfinv", _constant_term(a))
        if _is_constant(a):
            return nmod(start, PRIME)
        y = _constant(start)
        for _ in range(flint.ctx.cap):
            y = start + _integral(product(self.exp(product(y, y)), _rate(a))) * (nmod(ROOT_OF_PI, PRIME) * _HALF)
        return y

    def hypot(self, a: Residue, b: Residue) -> Residue:
        """(a^2 + b^2)^(1/2)."""
        return self.sqrt(product(a, a) + product(b, b))

    def angle(self, a: Residue, b: Residue) -> Residue:
        """atan2(a, b)."""
        if _constant_term(a) == _constant_term(b) == 0:
            raise ZeroDivisionError("the direction of nothing")
        start = nmod(direction_symbol(_constant_term(a), _constant_term(b)), PRIME)
        if _is_constant(a) and _is_constant(b):
            return start
        a, b = (as_series(a), as_series(b))
        cross_rate = product(_rate(a), b) - product(a, _rate(b))
        return start + _integral(quotient(cross_rate, product(a, a) + product(b, b)))

    def root_rate_function(self, what: str, sign: int, offset: int) -> Callable[[Residue], Residue]:
        """Return the odd function with derivative a' / (sign a^2 + offset)^(1/2)."""
        return self._odd_function(what, lambda a: self.sqrt(product(a, a) * sign + offset))

    def rational_rate_function(self, what: str, sign: int) -> Callable[[Residue], Residue]:
        """Return the odd function with derivative a' / (1 + sign a^2)."""
        return self._odd_function(what, lambda a: 1 + product(a, a) * sign)

    @staticmethod
    def _odd_function(what: str, divisor: Callable[[Residue], Residue]) -> Callable[[Residue], Residue]:
        def function(a: Residue) -> Residue:
            """Return the odd function of a residue, or of a series of residues."""
            start, size = nmod(odd_symbol(what, _constant_term(a)), PRIME), divisor(a)  # raises where there is no smooth value
            return start if _is_constant(a) else start + _integral_quotient(a, size)

        return function

    def acosh(self, a: Residue) -> Residue:
        """log(a + (a - 1)^(1/2) (a + 1)^(1/2))."""
        return self.log(a + product(self.sqrt(a - 1), self.sqrt(a + 1)))

    def operations(self) -> Mapping[int, Callable[..., Residue]]:
        """Return what each operation of a graph does; those with pieces are not among them."""
        asin = self.root_rate_function("asin", -1, 1)
        return {
            ca.OP_ADD: lambda a, b: a + b,
            ca.OP_SUB: lambda a, b: a - b,
            ca.OP_MUL: product,
            ca.OP_DIV: quotient,
            ca.OP_NEG: lambda a: -a,
            ca.OP_INV: inverse,
            ca.OP_SQ: lambda a: product(a, a),
            ca.OP_TWICE: lambda a: a + a,
            ca.OP_POW: self.power,
            ca.OP_CONSTPOW: self.power,
            ca.OP_SQRT: self.sqrt,
            ca.OP_EXP: self.exp,
            ca.OP_EXPM1: lambda a: self.exp(a) - 1,
            ca.OP_LOG: self.log,
            ca.OP_LOG1P: lambda a: self.log(1 + a),
            ca.OP_ERF: self.erf,
            ca.OP_ERFINV: self.erfinv,
            ca.OP_SIN: self.sin,
            ca.OP_COS: self.cos,
            ca.OP_TAN: self.tan,
            ca.OP_ASIN: asin,
            ca.OP_ACOS: lambda a: PI * _HALF - asin(a),
            ca.OP_ATAN: self.rational_rate_function("atan", 1),
            ca.OP_SINH: self.sinh,
            ca.OP_COSH: self.cosh,
            ca.OP_TANH: self.tanh,
            ca.OP_ASINH: self.root_rate_function("asinh", 1, 1),
            ca.OP_ACOSH: self.acosh,
            ca.OP_ATANH: self.rational_rate_function("atanh", -1),
            ca.OP_ATAN2: self.angle,
            ca.OP_HYPOT: self.hypot,
            ca.OP_PRINTME: lambda a, _: a,
        }
