"""Ball arithmetic: numbers and power series with a midpoint and a proven radius.

Source: F. Johansson, "Arb: efficient arbitrary-precision midpoint-radius interval arithmetic", 2017.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from fractions import Fraction

import casadi as ca
import flint
from flint import arb, arb_mat, arb_series

from obsdesign.rank.exact_numbers import as_ball
from obsdesign.rank.graph import Arithmetic, NotExactError, require_short

PRECISIONS = (256, 512, 1024, 2048, 4096)
"""Working precisions [bits], tried in turn."""

CONFIRMING_BITS = 2048
"""What counts as 0 must be so at this many bits: half of them reach below the smallest double."""

Ball = arb | arb_series


def constant_term(a: Ball) -> arb:
    """Return the value at t = 0: what decides the branch of a function with pieces."""
    return a[0] if isinstance(a, arb_series) else a


def is_finite(a: Ball) -> bool:
    """Return whether every coefficient is a finite ball."""
    return all(entry.is_finite() for entry in a.coeffs()) if isinstance(a, arb_series) else a.is_finite()


def _truth(is_true: bool, is_false: bool) -> arb:
    return arb(1) if is_true else arb(0) if is_false else arb.nan()


def _differs(a: Ball, b: Ball | int = 0) -> bool:
    difference = constant_term(a) - (b if isinstance(b, int) else constant_term(b))
    return difference < 0 or difference > 0


def _less(a: Ball, b: Ball) -> bool:
    return bool(constant_term(a) < constant_term(b))


def _sign(a: Ball) -> arb:
    value = constant_term(a)
    return arb(1) if value > 0 else arb(-1) if value < 0 else arb.nan()


def _floor(a: Ball) -> arb:
    value = constant_term(a)
    return arb.nan() if value.contains_integer() else value.floor()


def _truncate(a: Ball) -> arb:
    value = constant_term(a)
    return arb(0) if abs(value) < 1 else _floor(value) if value > 0 else -_floor(-value)


def _quotient(a: Ball, b: Ball) -> Ball:
    return a / b if _differs(b) else arb.nan()


def _power(a: Ball, b: Ball) -> Ball:
    if isinstance(a, arb) and isinstance(b, arb):
        return a**b
    whole = b.unique_fmpz() if isinstance(b, arb) else None
    if whole is not None:
        return _whole_power(a, int(whole))
    return _exp(b * _log(a)) if constant_term(a) > 0 else arb.nan()


def _whole_power(a: Ball, exponent: int) -> Ball:
    if exponent < 0:
        return _quotient(arb(1), _whole_power(a, -exponent))
    if isinstance(a, arb):
        return a**exponent
    power, square = arb_series([1]), a  # flint takes logarithms, which balls around 0 have none of
    while exponent:
        power, square, exponent = (power * square if exponent % 2 else power), square * square, exponent // 2
    return power


def _by_method(name: str) -> Callable[[Ball], Ball]:
    """Return the function of that name, nan where its value or its derivative is not finite: a series of such has no meaning."""
    scalar, series = getattr(arb, name), getattr(arb_series, name, None)

    def function(a: Ball) -> Ball:
        """Return the function of a ball, or of a series of balls."""
        if isinstance(a, arb):
            return scalar(a)
        if series is None:
            raise NotExactError(f"the function {name} cannot be evaluated on power series: write it with others")
        return series(a) if scalar(constant_term(a)).is_finite() else arb.nan()

    return function


_exp, _log, _sqrt = _by_method("exp"), _by_method("log"), _by_method("sqrt")


def _inverse_error_function(a: arb_series) -> Ball:
    """Return y with y' = sqrt(pi) / 2 exp(y^2) a': every pass gives one more coefficient."""
    start, y = constant_term(a).erfinv(), arb_series([constant_term(a).erfinv()])
    for _ in range(len(a.coeffs()) and flint.ctx.cap):
        rate = _exp(y * y) * a.derivative()
        if not isinstance(rate, arb_series):
            return rate
        y = start + rate.integral() * (arb.pi().sqrt() / 2)
    return y


_SERIES_FUNCTIONS: Mapping[str, Callable[[arb_series], Ball]] = {
    "expm1": lambda a: _exp(a) - 1,
    "log1p": lambda a: _log(1 + a),
    "sinh": lambda a: (_exp(a) - _exp(-a)) / 2,
    "cosh": lambda a: (_exp(a) + _exp(-a)) / 2,
    "tanh": lambda a: 1 - 2 / (_exp(2 * a) + 1),
    "asinh": lambda a: constant_term(a).asinh() + _integral(a, _sqrt(1 + a * a)),
    "acosh": lambda a: _log(a + _sqrt(a - 1) * _sqrt(a + 1)),
    "atanh": lambda a: (_log(1 + a) - _log(1 - a)) / 2,
    "erfinv": _inverse_error_function,
}


def _integral(a: arb_series, divisor: Ball) -> Ball:
    """Return int a' / divisor dt, 0 at t = 0."""
    quotient = _quotient(a.derivative(), divisor)
    return quotient.integral() if isinstance(quotient, arb_series) else quotient


def _function(name: str) -> Callable[[Ball], Ball]:
    by_method, form = _by_method(name), _SERIES_FUNCTIONS.get(name)
    return (lambda a: form(a) if isinstance(a, arb_series) else by_method(a)) if form else by_method


def _angle(a: Ball, b: Ball) -> Ball:
    """Return atan2(a, b)."""
    start = arb.atan2(constant_term(a), constant_term(b)) if _differs(a) or _differs(b) else arb.nan()
    if isinstance(a, arb) and isinstance(b, arb):
        return start
    rise, run = (c if isinstance(c, arb_series) else arb_series([c]) for c in (a, b))
    rate = _quotient(rise.derivative() * run - rise * run.derivative(), rise * rise + run * run)
    return start + (rate.integral() if isinstance(rate, arb_series) else rate)


_FUNCTION_NAMES = (
    *("sqrt", "exp", "expm1", "log", "log1p", "erf", "erfinv", "sin", "cos", "tan"),
    *("asin", "acos", "atan", "sinh", "cosh", "tanh", "asinh", "acosh", "atanh"),
)
# What has no smooth value (a comparison of equals, the kink of a norm, a pole) is nan, and nan spreads to the result.
OPERATIONS: Mapping[int, Callable[..., Ball]] = {
    ca.OP_ADD: lambda a, b: a + b,
    ca.OP_SUB: lambda a, b: a - b,
    ca.OP_MUL: lambda a, b: a * b,
    ca.OP_DIV: _quotient,
    ca.OP_NEG: lambda a: -a,
    ca.OP_INV: lambda a: _quotient(arb(1), a),
    ca.OP_SQ: lambda a: a * a,
    ca.OP_TWICE: lambda a: a + a,
    ca.OP_POW: _power,
    ca.OP_CONSTPOW: _power,
    **{getattr(ca, f"OP_{name.upper()}"): _function(name) for name in _FUNCTION_NAMES},
    ca.OP_ATAN2: _angle,
    ca.OP_HYPOT: lambda a, b: _sqrt(a * a + b * b),
    ca.OP_FABS: lambda a: a * _sign(a),
    ca.OP_SIGN: _sign,
    ca.OP_COPYSIGN: lambda a, b: a * _sign(a) * _sign(b),
    ca.OP_FMIN: lambda a, b: a if _less(a, b) else b if _less(b, a) else arb.nan(),
    ca.OP_FMAX: lambda a, b: a if _less(b, a) else b if _less(a, b) else arb.nan(),
    ca.OP_FLOOR: _floor,
    ca.OP_CEIL: lambda a: -_floor(-a),
    ca.OP_FMOD: lambda a, b: a - b * _truncate(_quotient(a, b)),
    ca.OP_REMAINDER: lambda a, b: a - b * _floor(_quotient(a, b) + arb(0.5)),
    ca.OP_LT: lambda a, b: _truth(_less(a, b), _less(b, a)),
    ca.OP_LE: lambda a, b: _truth(_less(a, b), _less(b, a)),
    ca.OP_EQ: lambda a, b: _truth(False, _differs(a, b)),
    ca.OP_NE: lambda a, b: _truth(_differs(a, b), False),
    ca.OP_NOT: lambda a: _truth(a.is_zero(), _differs(a)),
    ca.OP_AND: lambda a, b: _truth(_differs(a) and _differs(b), a.is_zero() or b.is_zero()),
    ca.OP_OR: lambda a, b: _truth(_differs(a) or _differs(b), a.is_zero() and b.is_zero()),
    ca.OP_IF_ELSE_ZERO: lambda a, b: arb(0) if a.is_zero() else b if _differs(a) else arb.nan(),
    ca.OP_PRINTME: lambda a, _: a,
}
# The two irrational numbers that CasADi writes into derivatives, of erf and erfinv.
IRRATIONAL = {2 / math.sqrt(math.pi): lambda: 2 / arb.pi().sqrt(), math.sqrt(math.pi) / 2: lambda: arb.pi().sqrt() / 2}


def irrational_part(value: float) -> tuple[Fraction, float] | None:
    """Return a short factor and the irrational number of which a constant that CasADi made is the product, if it is one."""
    for number in IRRATIONAL:
        factor = Fraction(value / number).limit_denominator(64) if math.isfinite(value) else Fraction(0)
        if factor and abs(factor.numerator) <= 1024 and float(factor) * number == value:
            return factor, number
    return None


def _constant(value: float) -> arb:
    if part := irrational_part(value):
        return IRRATIONAL[part[1]]() * part[0].numerator / part[0].denominator
    if math.isfinite(value):
        require_short(value)
    return arb(value)


BALLS = Arithmetic(
    constant=_constant,
    operations=OPERATIONS,
    number=as_ball,
    series=arb_series,
    coefficients=lambda a: a.coeffs() if isinstance(a, arb_series) else [a],
    matrix=arb_mat,
)
"""Midpoint-radius numbers and series in t at the working precision `flint.ctx.prec`; series have `flint.ctx.cap` terms."""
