"""Where ranks are taken: random states, a state that was asked for, and states that can be reached from it."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property

import numpy as np
from flint import arb
from numpy.typing import ArrayLike

from obsdesign.errors import InputError
from obsdesign.rank.balls import BALLS, PRECISIONS
from obsdesign.rank.decimal_reading import read_double
from obsdesign.rank.exact_numbers import Irrational, Number, as_ball, pi_times
from obsdesign.rank.graph import Arithmetic
from obsdesign.rank.residues import modular_arithmetic
from obsdesign.rank.symbols import PRIME, Symbols

# Where random points are looked for: inside the domain of sqrt, log, acos and acosh first. Corners are whole numbers.
_BOXES = ((0, 1), (-1, 1), (1, 3), (-3, -1), (-100, 100), (0, 1000))
_DRAWS_PER_BOX = 3  # more of them find thinner domains, and take longer where there is none
# _NEARNESS: how far from a point its neighbours are drawn: nearer and nearer, for points close to the edge of a domain
_RADII = tuple(Fraction(1, 2**k) for k in (10, 20, 30, 50, 80, 120))


@dataclass(frozen=True)
class EvaluationPoint:
    """A state (n,): rationals, balls, or (with symbols for functions) numbers modulo the prime.

    precisions: bits that make sense there, tried in turn.
    """

    state: tuple[Number, ...]
    symbols: Symbols | None = None
    precisions: tuple[int, ...] = PRECISIONS

    @property
    def is_modular(self) -> bool:
        """Whether it is one modulo the prime."""
        return self.symbols is not None

    @cached_property
    def arithmetic(self) -> Arithmetic:
        """What to calculate with here."""
        return modular_arithmetic(self.symbols) if self.symbols is not None else BALLS

    @property
    def midpoint(self) -> np.ndarray:
        """The state in doubles (n,)."""
        return np.array([float(value) for value in self.state])

    def relative_to(self, origin: Sequence[Fraction]) -> EvaluationPoint:
        """Return the state less origin pi (n,)."""
        return replace(
            self, state=tuple(_subtract_turns(value, multiple_of_pi) for value, multiple_of_pi in zip(self.state, origin, strict=True))
        )

    def in_words(self, names: Sequence[str]) -> str:
        """Say where it is."""
        return ", ".join(f"{name} = {float(value):g}" for name, value in zip(names, self.state, strict=True))


def random_residues(count: int, seed: int | str) -> list[int]:
    """Return random whole numbers in [1, prime)."""
    generator = random.Random(f"residues {seed}")
    return [generator.randrange(1, PRIME) for _ in range(count)]


def origin_of(point: EvaluationPoint) -> tuple[Fraction, ...]:
    """Return, for every entry that is a multiple of pi, the multiple of 1/12 at or below that multiple; 0 for the others."""
    multiples_of_pi = [value.multiple_of_pi if isinstance(value, Irrational) else None for value in point.state]
    return tuple(Fraction(math.floor(12 * multiple), 12) if multiple else Fraction(0) for multiple in multiples_of_pi)


def _subtract_turns(value: Number, multiple_of_pi: Fraction) -> Number:
    if not multiple_of_pi:
        return value
    shift = pi_times(-multiple_of_pi)
    return value + as_ball(shift) if isinstance(value, arb) else shift + value


def random_fractions(count: int, seed: int | str) -> list[Fraction]:
    """Return random rationals k / 2^20 with 1/4 <= |value| <= 1: of one size, none near 0."""
    generator = random.Random(f"fractions {seed}")
    return [Fraction(generator.choice((-1, 1)) * generator.randrange(2**18, 2**20), 2**20) for _ in range(count)]


def random_points(n: int, seed: int) -> Iterator[EvaluationPoint]:
    """Yield random states (n,) with entries k / 2^20, exact in double precision, from one box after another."""
    generator = np.random.default_rng(seed)
    for low, high in _BOXES:
        for _ in range(_DRAWS_PER_BOX):
            yield EvaluationPoint(tuple(low + (high - low) * Fraction(int(k), 2**20) for k in generator.integers(1, 2**20, n)))


@dataclass(frozen=True)
class SamplingRegion:
    """Where generic states are looked for: anywhere, or (`centre`) nearer and nearer to a state."""

    n: int
    seed: int
    centre: EvaluationPoint | None = None

    def centre_behind(self, extra: int) -> EvaluationPoint:
        """Return the centre (extra + n,) behind random entries. Raises ValueError where there is no centre."""
        if self.centre is None:
            raise ValueError("the region has no centre")
        return replace(self.centre, state=(*random_fractions(extra, f"{self.seed} extra"), *self.centre.state))

    def points(self, extra: int = 0) -> Iterator[EvaluationPoint]:
        """Yield random states (extra + n,)."""
        if self.centre is None:
            yield from random_points(extra + self.n, self.seed)
            return
        for attempt, radius in enumerate(_RADII):
            steps = random_fractions(self.n, f"{self.seed} step {attempt}")
            state = [_perturb(value, radius * step) for value, step in zip(self.centre.state, steps, strict=True)]
            yield EvaluationPoint((*random_fractions(extra, f"{self.seed} extra {attempt}"), *state))


def _perturb(value: Number, step: Fraction) -> Number:
    if step == 0 or isinstance(value, arb):
        return value
    return value + (1 + abs(value if isinstance(value, Fraction | int) else Fraction(float(value)))) * step


def point_from(names: Sequence[str], at: ArrayLike) -> EvaluationPoint:
    """Return the point as the rationals that were meant, like the constants of the model; raise InputError unless (n,) and finite."""
    try:
        values = np.array(at, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"at is {at!r}: must be {len(names)} numbers for {', '.join(names)}") from None
    if values.shape != (len(names),):
        raise InputError(f"at has shape {values.shape}: must be ({len(names)},) for {', '.join(names)}")
    for name, value in zip(names, values, strict=True):
        if not math.isfinite(value):
            raise InputError(f"at: {name} is {value}: must be finite")
    return EvaluationPoint(tuple(read_double(float(value)).literal for value in values))
