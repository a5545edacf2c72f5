"""A formula as a tree of frozen nodes; each knows where in the text it stands, which two equal trees need not share."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, field
from fractions import Fraction

from obsdesign.errors import InputError


@dataclass(frozen=True)
class FormulaProblem:
    """One thing that is wrong with a formula: at which character, from 1, and why; the names that are accepted, and the nearest."""

    column: int
    message: str
    accepted: tuple[str, ...] = ()
    nearest: str | None = None

    def told(self, text: str) -> str:
        """Return the problem with the text that it is about, and where in it."""
        before = text[: self.column - 1]
        line, column = before.count("\n") + 1, len(before) - (before.rfind("\n") + 1) + 1
        place = f"line {line}, column {column}" if "\n" in text.strip() else f"column {self.column}"
        shown = text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."
        return f"is {shown!r}: {place}: {self.message}"


_SHOWN = 60  # characters of a formula in a message


class FormulaError(InputError):
    """A text that is no formula, or one that has no value."""

    def __init__(self, problem: FormulaProblem) -> None:
        super().__init__(f"column {problem.column}: {problem.message}")
        self.problem = problem

    def __reduce__(self) -> tuple[type, tuple[FormulaProblem]]:
        return type(self), (self.problem,)


@dataclass(frozen=True)
class AbstractTree(ABC):
    """A formula, or a part of one."""

    column: int = field(default=1, compare=False, kw_only=True)
    """At which character of the text it begins, from 1."""

    @property
    @abstractmethod
    def parts(self) -> tuple[AbstractTree, ...]:
        """The formulas that it is made of."""


@dataclass(frozen=True)
class Number(AbstractTree):
    """A number as it was typed."""

    value: Fraction

    @property
    def parts(self) -> tuple[AbstractTree, ...]:
        """None."""
        return ()


@dataclass(frozen=True)
class Name(AbstractTree):
    """A state, an input, a parameter; or an entry of a landmark, from 0."""

    name: str
    entry: int | None = None

    @property
    def parts(self) -> tuple[AbstractTree, ...]:
        """None."""
        return ()


@dataclass(frozen=True)
class Sum(AbstractTree):
    """Terms that are added, or taken off; one that is taken off is a sign alone."""

    terms: tuple[AbstractTree, ...]
    is_negative: tuple[bool, ...]

    @property
    def parts(self) -> tuple[AbstractTree, ...]:
        """The terms."""
        return self.terms


@dataclass(frozen=True)
class Product(AbstractTree):
    """Factors, the first of which is no divisor."""

    factors: tuple[AbstractTree, ...]
    is_divisor: tuple[bool, ...]

    @property
    def parts(self) -> tuple[AbstractTree, ...]:
        """The factors."""
        return self.factors


@dataclass(frozen=True)
class Power(AbstractTree):
    """base^exponent."""

    base: AbstractTree
    exponent: AbstractTree

    @property
    def parts(self) -> tuple[AbstractTree, ...]:
        """Base and exponent."""
        return (self.base, self.exponent)


@dataclass(frozen=True)
class Call(AbstractTree):
    """A function of its arguments."""

    function: str
    arguments: tuple[AbstractTree, ...]

    @property
    def parts(self) -> tuple[AbstractTree, ...]:
        """The arguments."""
        return self.arguments


def nodes_of(tree: AbstractTree) -> Iterator[AbstractTree]:
    """Yield the tree and all that it is made of, from left to right."""
    stack = [tree]
    while stack:
        node = stack.pop()
        yield node
        stack.extend(reversed(node.parts))


def names_of(tree: AbstractTree) -> tuple[str, ...]:
    """Return the distinct names in a formula, in the order in which they come."""
    return tuple(dict.fromkeys(node.name for node in nodes_of(tree) if isinstance(node, Name)))


def is_number(tree: AbstractTree) -> bool:
    """Return whether there are numbers in it alone."""
    return not any(isinstance(node, Name) for node in nodes_of(tree))
