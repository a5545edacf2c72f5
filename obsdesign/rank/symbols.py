"""What exp, sin, log, sqrt, ... stand for modulo a prime: symbols, with those relations among them that are known to hold.

A function such as exp has no value modulo a prime. But what a verdict needs of it is its derivative, exp(a)' = exp(a) a', and its
relations with others, exp(a + b) = exp(a) exp(b). Let z stand for the values of all such functions. Ranks are those of matrices
whose entries are quotients of polynomials in (x, z), with z in the variety V of the relations that are kept. The true values are a
point of V, so what vanishes on V vanishes there: a rank at a random point of V is, but for a chance of degree / prime, at least the
true one. A relation that is not kept makes V larger and can only raise the rank: never is something small taken for nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from hashlib import blake2b

PRIME = 2305843009213057079
"""The largest prime below 2^61 modulo which -1 is no square but 2, 3, 5, ..., 47 are, so their roots exist.

What is not 0 modulo it is not 0; what is 0 modulo it at a random point is 0 but for a chance of degree / 2^61.
"""

_BLOCK_BITS = 20
"""Exponents of one block of 2^20 differ by whole numbers: a^(b - 1) a = a^b holds."""
_SMALL_LIMIT = 2**20
"""Rationals with numerator and denominator below this are told from their residue."""


class NoSquareError(ZeroDivisionError):
    """A root is asked for of a number that has none modulo the prime."""

    def __init__(self, number: int) -> None:
        super().__init__(f"{number} has no square root modulo the prime")
        self.number = number

    def __reduce__(self) -> tuple[type, tuple[int]]:
        return type(self), (self.number,)


def pseudorandom(what: str, *key: int) -> int:
    """Return a number in [1, prime), the same for the same arguments, otherwise as if drawn at random."""
    digest = blake2b(f"{what} {key}".encode(), digest_size=16).digest()
    return int.from_bytes(digest, "big") % (PRIME - 1) + 1


ROOT_OF_PI = pseudorandom("root of pi")
PI = ROOT_OF_PI**2 % PRIME
TWELFTH = PI * pow(12, -1, PRIME) % PRIME
"""pi / 12: sine and cosine of its multiples are exact."""

CosineSine = tuple[int, int]  # cosine and sine
Decomposition = tuple[tuple[int, int], ...]  # (argument, multiple): what an argument is the sum of


@dataclass(frozen=True, eq=False)
class Symbols:
    """Values of functions modulo the prime; arguments are whole numbers in [0, prime).

    sums: for an argument of exp, sin, cos the arguments whose whole multiples it is the sum of; logarithms: for the value of a
    logarithm its argument; angles: for an angle its cosine and sine; has_free_roots: numbers without a square root get a symbol for one
    (a relation less).
    """

    sums: Mapping[int, Decomposition] = field(default_factory=dict[int, Decomposition])
    logarithms: Mapping[int, int] = field(default_factory=dict[int, int])
    angles: Mapping[int, CosineSine] = field(default_factory=dict[int, CosineSine])
    has_free_roots: bool = False

    def exp(self, a: int) -> int:
        """exp(a): exp(0) = 1, exp(-a) exp(a) = 1, exp(log b) = b, exp of a sum."""
        if a == 0:
            return 1
        if a in self.logarithms:
            return self.logarithms[a]
        if PRIME - a in self.logarithms:
            return pow(self.logarithms[PRIME - a], -1, PRIME)
        if a in self.sums:
            value = 1
            for part, multiple in self.sums[a]:
                value = value * pow(self.exp(part), multiple, PRIME) % PRIME
            return value
        key = min(a, PRIME - a)
        value = pseudorandom("exp", key)
        return value if key == a else pow(value, -1, PRIME)

    def circle(self, a: int) -> CosineSine:
        """(cos a, sin a): exact at multiples of pi / 12, on the unit circle, of -a and of a sum."""
        if a in _exact_angles():
            return _exact_angles()[a]
        if a in self.angles:
            return self.angles[a]
        if PRIME - a in self.angles:
            cosine, sine = self.angles[PRIME - a]
            return cosine, -sine % PRIME
        if a in self.sums:
            value = (1, 0)
            for part, multiple in self.sums[a]:
                value = _add_angles(value, _multiply_angle(self.circle(part), multiple))
            return value
        key = min(a, PRIME - a)
        half = pseudorandom("circle", key)
        scale = pow(1 + half * half, -1, PRIME)
        cosine, sine = (1 - half * half) * scale % PRIME, 2 * half * scale % PRIME
        return (cosine, sine if key == a else -sine % PRIME)

    @staticmethod
    def log(a: int) -> int:
        """log(a): log(1) = 0, log(1 / a) = -log(a). Raises ZeroDivisionError at 0."""
        if a == 0:
            raise ZeroDivisionError("the logarithm of 0")
        if a == 1:
            return 0
        key = min(a, pow(a, -1, PRIME))
        value = pseudorandom("log", key)
        return value if key == a else PRIME - value

    def sqrt(self, a: int) -> int:
        """The root that is a square itself, which takes the place of being positive: sqrt(a b) = sqrt(a) sqrt(b).

        Raises NoSquareError where there is none, ZeroDivisionError at 0 (where the root is not smooth).
        """
        if a == 0:
            raise ZeroDivisionError("the square root of 0")
        root = pow(a, (PRIME + 1) // 4, PRIME)
        if root * root % PRIME == a:
            return PRIME - root if not _is_small(root) and _is_small(PRIME - root) else root
        if self.has_free_roots:
            return pseudorandom("sqrt", a)
        raise NoSquareError(a)

    def power(self, a: int, b: int) -> int:
        """a^b: exact for whole and half-whole b, a^(b - k) a^k = a^b for whole k. Raises ZeroDivisionError at a = 0."""
        if a == 0:
            raise ZeroDivisionError("a power of 0")
        integer = as_small_integer(b)
        if integer is not None:
            return pow(a, integer, PRIME)
        doubled_integer = as_small_integer(2 * b % PRIME)
        if doubled_integer is not None:
            return pow(self.sqrt(a), doubled_integer, PRIME)
        return pseudorandom("power", a, b >> _BLOCK_BITS) * pow(a, b % 2**_BLOCK_BITS, PRIME) % PRIME


def odd_symbol(what: str, a: int) -> int:
    """The value of an odd function, a symbol."""
    if a == 0:
        return 0
    key = min(a, PRIME - a)
    value = pseudorandom(what, key)
    return value if key == a else PRIME - value


def direction_symbol(a: int, b: int) -> int:
    """The value of atan2(a, b), a symbol: atan2(-a, b) = -atan2(a, b)."""
    key = min(a, -a % PRIME)
    value = pseudorandom("atan2", key, b)
    return value if key == a else PRIME - value


def as_small_integer(b: int) -> int | None:
    """Return the whole number of at most 16 bits that b is the residue of."""
    return b if b < 2**16 else b - PRIME if b > PRIME - 2**16 else None


def as_small_fraction(a: int) -> tuple[int, int] | None:
    """Return numerator and denominator, both below 2^20, of the rational that a is the residue of, if there is one.

    Source: P. Wang, "A p-adic algorithm for univariate partial fractions", 1981 (the extended Euclidean algorithm, stopped half way).
    """
    first, second = (PRIME, 0), (a, 1)
    while second[0] >= _SMALL_LIMIT:
        quotient = first[0] // second[0]
        first, second = second, (first[0] - quotient * second[0], first[1] - quotient * second[1])
    numerator, denominator = second if second[1] > 0 else (-second[0], -second[1])
    return (numerator, denominator) if 0 < denominator < _SMALL_LIMIT else None


def _is_small(a: int) -> bool:
    """Return whether a is the residue of a small positive rational."""
    fraction = as_small_fraction(a)
    return fraction is not None and fraction[0] > 0


def _add_angles(first: CosineSine, second: CosineSine) -> CosineSine:
    """Return cosine and sine of the sum of two angles."""
    (c, s), (d, t) = first, second
    return (c * d - s * t) % PRIME, (c * t + s * d) % PRIME


def _multiply_angle(angle: CosineSine, multiple: int) -> CosineSine:
    """Return cosine and sine of a whole multiple of an angle."""
    if multiple < 0:
        angle, multiple = (angle[0], -angle[1] % PRIME), -multiple
    value = (1, 0)
    while multiple:
        value = _add_angles(value, angle) if multiple % 2 else value
        angle, multiple = _add_angles(angle, angle), multiple // 2
    return value


@cache
def _exact_angles() -> dict[int, CosineSine]:
    """Cosine and sine of the multiples of pi / 12 within two turns: (6^(1/2) + 2^(1/2)) / 4 and (6^(1/2) - 2^(1/2)) / 4 of the first."""
    root_2, root_6, quarter = (*(pow(a, (PRIME + 1) // 4, PRIME) for a in (2, 6)), pow(4, -1, PRIME))
    first = ((root_6 + root_2) * quarter % PRIME, (root_6 - root_2) * quarter % PRIME)
    return {k * TWELFTH % PRIME: _multiply_angle(first, k) for k in range(-48, 49)}
