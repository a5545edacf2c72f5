"""The grammar of formulas: text to a tree, by descent, without evaluating anything.

    sum      = [sign] product {sign product}          sign = "+" | "-"
    product  = factor {("*" | "/") factor}
    factor   = sign factor | atom [("^" | "**") factor]
    atom     = number | name | name "[" index "]" | name "." axis | name "(" sum {"," sum} ")" | "(" sum ")"

So -x^2 is -(x^2), and a^b^c is a^(b^c). Words of Python's own, such as lambda, are names like others.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache

from obsdesign.formulas.functions import ALIASES, FUNCTIONS
from obsdesign.formulas.tree import AbstractTree, Call, FormulaError, FormulaProblem, Name, Number, Power, Product, Sum

LONGEST = 20_000
"""Characters of a formula."""
DEEPEST = 40
"""Brackets, exponents and signs within one another."""
LARGEST = 10**100
"""Of a number, in size: squares and their products must stay below 1.8e308."""
AXES = ("x", "y", "z")
"""What the entries of a landmark are called."""
_TOKEN = re.compile(
    r"(?P<space>\s+)|(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)|(?P<sign>\*\*|[-+*/^(),.\[\]])|(?P<wrong>.)",
    re.ASCII | re.DOTALL,
)
_WORD = re.compile(r"[^\W\d]\w*")
_LONGEST_NUMBER = 60  # characters


@dataclass(frozen=True)
class _Token:
    kind: str
    text: str
    column: int


@lru_cache(2**12)
def parse_formula(text: str) -> AbstractTree:
    """Return the formula that a text is. Raises FormulaError, which says at which character it is none, and why."""
    if len(text) > LONGEST:
        raise FormulaError(FormulaProblem(LONGEST, f"goes on for {len(text)} characters: must be at most {LONGEST}"))
    reader = _Reader(tuple(_tokens(text)))
    tree = reader.read_sum(0)
    reader.require_end()
    return tree


def is_name(text: str) -> bool:
    """Return whether a text can be the name of something in formulas."""
    return text.isidentifier()


def _tokens(text: str) -> Iterator[_Token]:
    position = 0
    while position < len(text):
        word = _WORD.match(text, position)
        match = word or _TOKEN.match(text, position)
        kind = "name" if word else match.lastgroup if match else None
        if word and not word.group().isidentifier():  # x², which is a word to regular expressions
            position += next(i for i in range(1, len(word.group()) + 1) if not word.group()[:i].isidentifier()) - 1
            raise FormulaError(_problem_of(text[position], position + 1))
        if match is None or kind is None or kind == "wrong":
            raise FormulaError(_problem_of(text[position], position + 1))
        if kind != "space":
            yield _Token(kind, match.group(), position + 1)
        position = match.end()
    yield _Token("end", "", len(text.rstrip()) + 1)


_MEANT = {"·": "*", "×": "*", "÷": "/", "−": "-", "–": "-", "²": "^2", "³": "^3", "{": "(", "}": ")", "π": "pi", "√": "sqrt(...)"}


def _problem_of(character: str, column: int) -> FormulaProblem:
    meant = f"; write {_MEANT[character]}" if character in _MEANT else ""
    hint = "; a formula has one value, and says nothing of cases" if character in "<>=?:!&|" else ""
    return FormulaProblem(column, f"unexpected {character!r}{meant}{hint}")


class _Reader:
    """Reads tokens from left to right."""

    def __init__(self, tokens: tuple[_Token, ...]) -> None:
        self._tokens = iter(tokens)
        self._ahead = [next(self._tokens)]

    @property
    def _next(self) -> _Token:
        return self._ahead[0]

    def _take(self) -> _Token:
        token = self._ahead.pop()
        self._ahead.append(next(self._tokens, token))
        return token

    def _is_next(self, *signs: str) -> bool:
        return self._next.kind == "sign" and self._next.text in signs

    def require_end(self) -> None:
        """Raise FormulaError unless all was read."""
        if self._next.kind == "end":
            return
        token = self._next
        if token.kind in ("name", "number") or token.text == "(":
            raise FormulaError(FormulaProblem(token.column, f"an operator is missing before {token.text!r}; products are written with *"))
        raise FormulaError(FormulaProblem(token.column, f"unexpected {token.text!r}"))

    def _require(self, sign: str, opened: _Token) -> None:
        if self._is_next(sign):
            self._take()
            return
        if self._next.kind == "end":
            raise FormulaError(FormulaProblem(opened.column, f"{opened.text!r} is not closed by {sign!r}"))
        self.require_end()

    def read_sum(self, depth: int) -> AbstractTree:
        """Return the sum that begins at the next token."""
        if depth > DEEPEST:
            raise FormulaError(FormulaProblem(self._next.column, f"more than {DEEPEST} brackets, exponents or signs within one another"))
        column, terms, signs = self._next.column, [], []
        while not terms or self._is_next("+", "-"):
            signs.append(self._is_next("-"))
            if self._is_next("+", "-"):
                self._take()
            terms.append(self._read_product(depth))
        return terms[0] if len(terms) == 1 and not signs[0] else Sum(tuple(terms), tuple(signs), column=column)

    def _read_product(self, depth: int) -> AbstractTree:
        column, factors, divides = self._next.column, [self._read_factor(depth)], [False]
        while self._is_next("*", "/"):
            divides.append(self._take().text == "/")
            factors.append(self._read_factor(depth))
        return factors[0] if len(factors) == 1 else Product(tuple(factors), tuple(divides), column=column)

    def _read_factor(self, depth: int) -> AbstractTree:
        column = self._next.column
        if depth > DEEPEST:
            raise FormulaError(FormulaProblem(column, f"more than {DEEPEST} brackets, exponents or signs within one another"))
        if self._is_next("+", "-"):
            sign = self._take().text
            factor = self._read_factor(depth + 1)
            return Sum((factor,), (True,), column=column) if sign == "-" else factor
        base = self._read_atom(depth)
        if not self._is_next("^", "**"):
            return base
        self._take()
        return Power(base, self._read_factor(depth + 1), column=column)

    def _read_atom(self, depth: int) -> AbstractTree:
        token = self._take()
        if token.kind == "number":
            return Number(_value_of(token), column=token.column)
        if token.kind == "name":
            return self._read_named(token, depth)
        if token.text == "(":
            inside = self.read_sum(depth + 1)
            self._require(")", token)
            return inside
        message = "the formula ends where a value is missing" if token.kind == "end" else f"a value is missing before {token.text!r}"
        raise FormulaError(FormulaProblem(token.column, message))

    def _read_named(self, token: _Token, depth: int) -> AbstractTree:
        """Return what begins with a name: the name alone, an entry, or a function with its arguments."""
        if self._is_next("("):
            return self._read_call(token, depth)
        if self._is_next("["):
            bracket = self._take()
            index = self._take()
            if not index.text.isdecimal() or len(index.text) > 3:
                raise FormulaError(FormulaProblem(index.column, f"is {index.text!r}: must be the number of an entry, from 0"))
            self._require("]", bracket)
            return Name(token.text, int(index.text), column=token.column)
        if self._is_next("."):
            self._take()
            axis = self._take()
            if axis.text not in AXES:
                raise FormulaError(FormulaProblem(axis.column, f"is {axis.text!r}: must be {', '.join(AXES)}", AXES))
            return Name(token.text, AXES.index(axis.text), column=token.column)
        return Name(token.text, column=token.column)

    def _read_call(self, token: _Token, depth: int) -> AbstractTree:
        name, bracket = ALIASES.get(token.text, token.text), self._take()
        if name not in FUNCTIONS:
            raise FormulaError(_unknown_function(token))
        arguments = [] if self._is_next(")") else [self.read_sum(depth + 1)]
        while self._is_next(","):
            self._take()
            arguments.append(self.read_sum(depth + 1))
        self._require(")", bracket)
        function = FUNCTIONS[name]
        if not function.fewest <= len(arguments) <= function.largest:
            message = f"{token.text} has {len(arguments) or 'no'} argument{'s' * (len(arguments) != 1)}: takes {function.count}"
            raise FormulaError(FormulaProblem(token.column, message))
        return Call(name, tuple(arguments), column=token.column)


def _unknown_function(token: _Token) -> FormulaProblem:
    near = difflib.get_close_matches(token.text, FUNCTIONS, n=1)
    hint = f"; did you mean {near[0]!r}?" if near else "; products are written with *"
    accepted = tuple(FUNCTIONS)
    return FormulaProblem(
        token.column, f"there is no function {token.text!r}{hint} (accepted: {', '.join(accepted)})", accepted, near[0] if near else None
    )


def _value_of(token: _Token) -> Fraction:
    """The decimal that was typed."""
    power = token.text.lower().partition("e")[2]
    if len(token.text) > _LONGEST_NUMBER or len(power) > 4:
        raise FormulaError(FormulaProblem(token.column, f"the number {token.text[:20]}... has more characters than any that is meant"))
    value = Fraction(token.text)
    if value > LARGEST:
        raise FormulaError(FormulaProblem(token.column, f"is {token.text}: must be at most 1e100"))
    return value
