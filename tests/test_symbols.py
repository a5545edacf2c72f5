"""Functions as symbols modulo a prime: their differential equations, their relations, what is exact."""

from fractions import Fraction

import casadi as ca
import flint
import pytest
from flint import fmpz, nmod, nmod_poly

from obsdesign.rank.exact_numbers import as_residue
from obsdesign.rank.formal_series import ResidueOperations, product, quotient
from obsdesign.rank.symbols import PI, PRIME, ROOT_OF_PI, NoSquareError, Symbols, as_small_fraction, as_small_integer

TERMS = 13
A = nmod_poly([5, 3, 7, 1, 2, 9, 4], PRIME)
B = nmod_poly([9, 1, 4, 4], PRIME)
FORMAL = ResidueOperations(Symbols(has_free_roots=True))


@pytest.fixture(autouse=True)
def terms():
    before = flint.ctx.cap
    flint.ctx.cap = TERMS
    yield
    flint.ctx.cap = before


def rate(a):
    return a.derivative().truncate(TERMS - 1)


def cut(a):
    return a.truncate(TERMS - 1)


def of(code, *arguments):
    return FORMAL.operations()[getattr(ca, f"OP_{code}")](*arguments)


HALF = pow(2, -1, PRIME)
# name: (arguments, its derivative from the values of itself and of others)
EQUATIONS = {
    "EXP": lambda y: product(y, rate(A)),
    "LOG": lambda _: quotient(rate(A), A),
    "SQRT": lambda y: quotient(rate(A), 2 * y),
    "SIN": lambda _: product(of("COS", A), rate(A)),
    "COS": lambda _: -product(of("SIN", A), rate(A)),
    "TAN": lambda y: product(1 + product(y, y), rate(A)),
    "SINH": lambda _: product(of("COSH", A), rate(A)),
    "COSH": lambda _: product(of("SINH", A), rate(A)),
    "TANH": lambda y: product(1 - product(y, y), rate(A)),
    "ASIN": lambda _: quotient(rate(A), of("SQRT", 1 - product(A, A))),
    "ACOS": lambda _: -quotient(rate(A), of("SQRT", 1 - product(A, A))),
    "ATAN": lambda _: quotient(rate(A), 1 + product(A, A)),
    "ASINH": lambda _: quotient(rate(A), of("SQRT", 1 + product(A, A))),
    "ATANH": lambda _: quotient(rate(A), 1 - product(A, A)),
    "ACOSH": lambda _: quotient(rate(A), product(of("SQRT", A - 1), of("SQRT", A + 1))),
    "EXPM1": lambda y: product(y + 1, rate(A)),
    "LOG1P": lambda _: quotient(rate(A), 1 + A),
    "ERF": lambda _: product(of("EXP", -product(A, A)), rate(A)) * (nmod(2, PRIME) / ROOT_OF_PI),
    "ERFINV": lambda y: product(of("EXP", product(y, y)), rate(A)) * (nmod(ROOT_OF_PI, PRIME) * HALF),
}


@pytest.mark.parametrize("name", EQUATIONS)
def test_series_obey_the_equation_of_their_function(name):
    y = of(name, A)
    assert rate(y) == cut(EQUATIONS[name](y))


def test_functions_of_two_arguments_obey_theirs():
    power, angle = of("POW", A, B), of("ATAN2", A, B)
    assert rate(power) == cut(product(power, rate(product(B, of("LOG", A)))))
    assert product(of("POW", A, B - 1), A) == power
    assert cut(product(rate(angle), product(A, A) + product(B, B))) == cut(product(rate(A), B) - product(A, rate(B)))
    length = nmod_poly([25, 3, 1], PRIME)
    assert product(of("HYPOT", length, 0 * B), of("HYPOT", length, 0 * B)) == product(length, length)


def test_relations_of_one_argument():
    c, s, z = of("COS", A), of("SIN", A), of("EXP", A)
    assert product(c, c) + product(s, s) == 1
    assert (of("COS", -A), of("SIN", -A)) == (c, -s)
    assert product(z, of("EXP", -A)) == 1
    assert of("LOG", quotient(nmod_poly([1], PRIME), A)) == -of("LOG", A)
    assert of("POW", A, nmod(3, PRIME)) == product(A, product(A, A))
    assert of("POW", A, nmod(-2, PRIME)) == quotient(nmod_poly([1], PRIME), product(A, A))


def residue(numerator, denominator=1):
    return int(as_residue(Fraction(numerator, denominator)))


def test_relations_of_sums_are_kept_where_they_are_given():
    a, b = 12345, 987654321
    symbols = Symbols(sums={(2 * a - 3 * b) % PRIME: ((a, 2), (b, -3))}, logarithms={777: 5}, angles={778: (residue(3, 5), residue(4, 5))})
    exp = symbols.exp
    assert exp((2 * a - 3 * b) % PRIME) * exp(b) ** 3 % PRIME == exp(a) ** 2 % PRIME
    assert exp(777) == 5
    assert symbols.circle(778) == (residue(3, 5), residue(4, 5))
    c, s = symbols.circle((2 * a - 3 * b) % PRIME)
    (d, t), (e, u) = symbols.circle(a), symbols.circle(b)
    turned = fmpz(PRIME)  # (d + i t)^2 (e - i u)^3 by whole numbers
    re, im = d * d - t * t, 2 * d * t
    for _ in range(3):
        re, im = re * e + im * u, im * e - re * u
    assert (c, s) == (re % turned, im % turned)


def test_what_is_exact():
    symbols = Symbols()
    assert symbols.exp(0) == 1
    assert symbols.log(1) == 0
    assert symbols.circle(PI) == (PRIME - 1, 0)
    assert symbols.circle(PI * HALF % PRIME) == (0, 1)
    third = symbols.circle(PI * pow(3, -1, PRIME) % PRIME)
    assert third == (HALF, symbols.sqrt(3) * HALF % PRIME)
    assert [symbols.sqrt(k * k) for k in range(1, 300)] == list(range(1, 300))
    assert symbols.sqrt(residue(9, 16)) == residue(3, 4)
    assert symbols.sqrt(6) == symbols.sqrt(2) * symbols.sqrt(3) % PRIME


def test_numbers_without_a_root_are_named_or_get_a_symbol():
    odd = next(k for k in range(2, 1000) if pow(k, (PRIME - 1) // 2, PRIME) != 1)
    with pytest.raises(NoSquareError):
        Symbols().sqrt(odd)
    assert Symbols(has_free_roots=True).sqrt(odd) == Symbols(has_free_roots=True).sqrt(odd)
    assert fmpz(PRIME).is_prime()


@pytest.mark.parametrize("fraction", [(3, 7), (-22, 7), (1, 1000003), (999999, 2), (0, 1)])
def test_small_rationals_are_told_from_their_residue(fraction):
    found = as_small_fraction(residue(*fraction))
    assert found == fraction if abs(fraction[0]) < 2**20 and fraction[1] < 2**20 else found is None


def test_whole_numbers_are_told_from_their_residue():
    assert [as_small_integer(k % PRIME) for k in (0, 5, -5, 2**15)] == [0, 5, -5, 2**15]
    assert as_small_integer(residue(1, 2)) is None
