"""A function repeated along the rows of arrays, each result carried into the next: no Python in the loop."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Sequence
from dataclasses import dataclass
from threading import Lock
from typing import Any

import casadi as ca
import numpy as np

from obsdesign.common_subexpressions import without_repeats
from obsdesign.dynamics import native_code as machine
from obsdesign.errors import InputError

_LOAD = 2_000  # steps after which the cache folder is asked for machine code
# a compiler is asked when the virtual machine has done as much as it would take: about 0.3 s and 0.6 ms an operation, at 6 ns each
_WORTH, _WORTH_EACH = 100_000, 50_000_000
_NAME = "obsdesign_step"  # a name that no library has: "step" is one of the C library, and would be called instead
_ENTRIES = 1 << 18  # numbers that one stretch may hold: 2 MB of doubles
_EXACT = 8  # lengths, beside the powers of two, for which the repeated function is kept
_LONGEST = 1024  # steps of the longest stretch that CasADi repeats in one call; a power of two

# one loop at a time: CasADi's are not safe to run from several threads. A fork waits for its turn too, so that no child begins
# in the middle of what another thread was doing
_TURN = Lock()
if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_TURN.acquire, after_in_parent=_TURN.release, after_in_child=_TURN.release)

# carries are those after each step, as CasADi's mapaccum has them
_DRIVER = """
#include <string.h>
int {name}_scan(long long paths, long long steps, double* carry, double* carries,
                const double* const* rows, const long long* axes, double* const* results) {{
  const long long widths[] = {{{widths}}}, taken[] = {{{widths_in}}};
  const double* arg[{sz_arg}]; double* res[{sz_res}]; casadi_int iw[{sz_iw}]; double w[{sz_w}]; double next[{carried}];
  for (long long m = 0; m < paths; ++m) {{
    double* now = carry + m * {c};
    for (long long k = 0; k < steps; ++k) {{
      arg[0] = now;
      for (int i = 0; i < {rows}; ++i) arg[1 + i] = rows[i] + ((axes[i] > 2 ? m * steps : 0) + (axes[i] > 1 ? k : 0)) * taken[i];
      res[0] = next;
      for (int j = 0; j < {results}; ++j) res[1 + j] = results[j] ? results[j] + (m * steps + k) * widths[j] : 0;
      if ({name}(arg, res, iw, w, 0)) return 1;
      memcpy(now, next, {c} * sizeof(double));
      if (carries) memcpy(carries + (m * steps + k) * {c}, next, {c} * sizeof(double));
    }}
  }}
  return 0;
}}
"""


@dataclass(frozen=True, eq=False)
class Run:
    """What M paths of N steps gave: carry (M, c) after the last step, carries (M, N, c) after each, results (M, N, b) each."""

    carry: np.ndarray
    carries: np.ndarray
    results: tuple[np.ndarray, ...]


@dataclass(frozen=True, eq=False)
class Spread:
    """A result that repeats its entries: what is wanted is column[index] (B,), what is computed the column (b, 1)."""

    column: ca.SX
    index: np.ndarray


class _Stretch:
    """A function repeated by CasADi over so many rows, into arrays of its own that are used again and again."""

    def __init__(self, function: ca.Function, length: int, indices: Sequence[np.ndarray | None]) -> None:
        self._buffer, self._evaluate = _dense(function.mapaccum(length)).buffer()
        self._indices = indices
        self._carry, self._carries = np.empty(function.size1_in(0)), np.empty((length, function.size1_in(0)))
        self._made = [np.empty((length, function.size1_out(j + 1))) for j in range(len(indices))]
        self._buffer.set_arg(0, memoryview(self._carry))  # pyright: ignore
        for j, values in enumerate([self._carries, *self._made]):
            self._buffer.set_res(j, memoryview(values))  # pyright: ignore

    def __call__(self, carry: np.ndarray, rows: list[np.ndarray], carries: np.ndarray | None, results: list[np.ndarray]) -> None:
        """Move carry (c,) on, in place; write carries (N, c) and results (N, B)."""
        self._carry[:] = carry
        for i, values in enumerate(rows):
            self._buffer.set_arg(i + 1, memoryview(values))  # pyright: ignore
        self._evaluate()
        carry[:] = self._carries[-1]
        if carries is not None:
            carries[:] = self._carries
        for into, values, index in zip(results, self._made, self._indices, strict=True):
            if index is None:
                into[:] = values
            else:
                np.take(values, index, axis=1, out=into, mode="clip")  # clip: without a copy


class Scan:
    """(carry, row_1, ...) -> (carry', result_1, ...), all SX columns, applied to every row of arrays in turn.

    Runs in CasADi's virtual machine, or as machine code once it has run long enough for that to pay: the same numbers bit for
    bit, so that nothing depends on when. May be called from several threads.
    """

    def __init__(
        self, carry: ca.SX, rows: Sequence[ca.SX], carry_next: ca.SX, results: Sequence[ca.SX | Spread] = (), shared: bool = True
    ) -> None:
        """Shared: look for what is computed twice; for a graph of hundreds of thousands of operations that takes seconds."""
        plain = [each.column if isinstance(each, Spread) else each for each in results]
        dense = [ca.densify(carry_next), *map(ca.densify, plain)]
        outputs = without_repeats(dense) if shared else dense
        self._function = ca.Function(_NAME, [carry, *rows], outputs)
        self._indices = tuple(each.index if isinstance(each, Spread) else None for each in results)
        self.widths = tuple(len(index) if index is not None else each.numel() for index, each in zip(self._indices, plain, strict=True))
        self._widths_in = tuple(self._function.size1_in(i) for i in range(self._function.n_in()))
        self._addresses, self._places = (ctypes.c_void_p * count for count in (len(rows), len(results)))
        self._axes = ctypes.c_longlong * len(rows)
        self._width_out = sum(self._function.size1_out(j) for j in range(self._function.n_out()))
        self._stretches: dict[tuple[int, bool], _Stretch] = {}
        self._exact: set[int] = set()
        self._done = 0
        self._compiled: machine.Compiled | None = None
        self._wish = machine.wish()

    @property
    def instructions(self) -> int:
        """Number of operations of one step."""
        return self._function.n_instructions()

    @property
    def backend(self) -> str:
        """Say what runs the loop, and why it is not machine code if it is not."""
        if self._compiled is None:
            return f"CasADi's virtual machine ({'switched off' if self._wish == 'never' else 'not run long enough'})"
        return "machine code" if self._compiled.entry else f"CasADi's virtual machine ({self._compiled.reason})"

    def along(self, carry: np.ndarray, *rows: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return carries (N, c) after each step and each result (N, b), for carry (c,) and rows (N, a)."""
        run = self.run(carry[None], rows, len(rows[0]))
        return run.carries[0], *(result[0] for result in run.results)

    def last(self, carry: np.ndarray, *rows: np.ndarray) -> np.ndarray:
        """Return the carry (c,) after the last step."""
        return self.run(carry[None], rows, len(rows[0]), carries=False, results=False).carry[0]

    def run(self, carry: np.ndarray, rows: Sequence[np.ndarray], steps: int, carries: bool = True, results: bool = True) -> Run:
        """Run M paths from carry (M, c). A row array is (N, a) for all paths, (M, N, a) for each its own, or (a,) for every step."""
        now = np.array(carry, dtype=float, order="C")
        inputs = [np.ascontiguousarray(row, dtype=float) for row in rows]
        paths = len(now)
        every = np.empty((paths, steps, now.shape[1])) if carries else None
        found = tuple(np.empty((paths, steps, width)) for width in self.widths) if results else ()
        self._require_shapes(now, inputs, paths, steps)
        if paths and steps:
            with _TURN:
                entry = self._entry(paths * steps)
                walk = self._walk if entry is None else self._walk_compiled
                walk(now, inputs, steps, every, found)
        return Run(now, np.empty((paths, 0, now.shape[1])) if every is None else every, found)

    def _require_shapes(self, carry: np.ndarray, rows: list[np.ndarray], paths: int, steps: int) -> None:
        """Raise InputError for arrays that do not fit: a compiled loop would read beyond their ends."""
        for i, (values, width) in enumerate(zip([carry, *rows], self._widths_in, strict=True)):
            whole = paths, steps, width
            accepted = (whole[1:], whole, (width,)) if i else ((paths, width),)
            if values.shape not in accepted:
                raise InputError(f"array {i} of a loop has shape {values.shape}: must be {' or '.join(map(str, accepted))}")

    # ---------------------------------------------------------------- virtual machine

    def _walk(self, carry: np.ndarray, rows: list[np.ndarray], steps: int, every: np.ndarray | None, found: tuple[np.ndarray, ...]) -> None:
        pieces = self._pieces(steps)
        tiled = [np.tile(row, (max(pieces), 1)) if row.ndim == 1 else row for row in rows]
        for m, now in enumerate(carry):
            first = 0
            for length in pieces:
                part = slice(first, first + length)
                own = [row[:length] if rows[i].ndim == 1 else (row[m] if row.ndim == 3 else row)[part] for i, row in enumerate(tiled)]
                self._stretch(length, bool(found))(now, own, None if every is None else every[m, part], [each[m, part] for each in found])
                first += length

    def _pieces(self, steps: int) -> list[int]:
        """Cut the steps into lengths for which the repeated function is kept: some exact ones, else powers of two."""
        longest = min(_LONGEST, 1 << max(0, (_ENTRIES // max(1, self._width_out)).bit_length() - 1))
        whole, rest = divmod(steps, longest)
        lengths = [longest] * whole
        if rest in self._exact or (rest and len(self._exact) < _EXACT):
            self._exact.add(rest)
            return [*lengths, rest]
        return [*lengths, *(1 << bit for bit in reversed(range(rest.bit_length())) if rest >> bit & 1)]

    def _stretch(self, length: int, wanted: bool) -> _Stretch:
        if (length, wanted) not in self._stretches:
            self._stretches[length, wanted] = _Stretch(self._function, length, self._indices if wanted else ())
        return self._stretches[length, wanted]

    # ---------------------------------------------------------------- machine code

    def _entry(self, steps: int) -> Any:  # noqa: ANN401  # a C function
        """Return the compiled loop if there is one, or if it is time for one."""
        if self._wish == "never":
            return None
        before, self._done = self._done, self._done + steps
        if self._compiled is None:
            worth = self._wish == "at once" or self._done >= _WORTH + _WORTH_EACH / max(1, self.instructions)
            if worth or before < _LOAD <= self._done:
                self._compiled = self._load(only_kept=not worth)
        return None if self._compiled is None else self._compiled.entry

    def _load(self, only_kept: bool) -> machine.Compiled | None:
        function = self._wide()
        driver = _DRIVER.format(
            name=_NAME,
            widths=", ".join(map(str, self.widths)) or "0",
            widths_in=", ".join(map(str, self._widths_in[1:])) or "0",
            rows=function.n_in() - 1,
            results=len(self.widths),
            c=function.size1_in(0),
            carried=max(1, function.size1_in(0)),
            **{size: max(1, getattr(function, size)()) for size in ("sz_arg", "sz_res", "sz_iw", "sz_w")},
        )
        return machine.load(machine.source_of(function, driver), f"{_NAME}_scan", self.instructions, only_kept=only_kept)

    def _wide(self) -> ca.Function:
        """The same step with every entry of its results written where it is wanted: cheap for a compiler, not for CasADi."""
        symbols = self._function.sx_in()
        carry_next, *results = self._function.call(symbols)
        wide = [each if index is None else each[index.tolist()] for each, index in zip(results, self._indices, strict=True)]
        return ca.Function(_NAME, symbols, [carry_next, *wide])

    def _walk_compiled(
        self, carry: np.ndarray, rows: list[np.ndarray], steps: int, every: np.ndarray | None, found: tuple[np.ndarray, ...]
    ) -> None:
        failed = self._compiled.entry(  # pyright: ignore[reportOptionalMemberAccess]
            len(carry),
            steps,
            carry.ctypes.data,
            None if every is None else every.ctypes.data,
            self._addresses(*[row.ctypes.data for row in rows]),
            self._axes(*[row.ndim for row in rows]),
            self._places(*[values.ctypes.data for values in found]),
        )
        if failed:
            raise RuntimeError("a compiled loop stopped before its end")


def _dense(repeated: ca.Function) -> ca.Function:
    """Return a function that writes all of its results: CasADi leaves out those that are 0 for every row, and a buffer as it was."""
    if all(repeated.sparsity_out(j).is_dense() for j in range(repeated.n_out())):
        return repeated
    symbols = repeated.mx_in()
    return ca.Function(repeated.name(), symbols, [ca.densify(each) for each in repeated.call(symbols)])
