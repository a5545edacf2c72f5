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

from obsdesign import native_code as native
from obsdesign.common_subexpressions import without_repeats
from obsdesign.dynamics.inner_loop import InnerLoop, function_with_loop
from obsdesign.errors import InputError

_STEPS_BEFORE_LOAD = 2_000  # steps after which the cache folder is asked for machine code
# a compiler is asked when the virtual machine has done as much as it would take: about 0.3 s and 0.6 ms an operation, at 6 ns each
_STEPS_BEFORE_COMPILE, _OPERATIONS_BEFORE_COMPILE = 100_000, 50_000_000
_NAME = "obsdesign_step"  # a name that no library has: "step" is one of the C library, and would be called instead
_MAX_ENTRIES = 1 << 18  # numbers that one stretch may hold: 2 MB of doubles
_MAX_EXACT_LENGTHS = 8  # lengths, beside the powers of two, for which the repeated function is kept
_MAX_LENGTH = 1024  # steps of the longest stretch that CasADi repeats in one call; a power of two

# one loop at a time: CasADi's are not safe to run from several threads. A fork waits for its turn too, so that no child begins
# in the middle of what another thread was doing
_LOOP_LOCK = Lock()
if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_LOOP_LOCK.acquire, after_in_parent=_LOOP_LOCK.release, after_in_child=_LOOP_LOCK.release)

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
class ScanResult:
    """What M paths of N steps gave: carry (M, c) after the last step, carries (M, N, c) after each, results (M, N, b) each."""

    carry: np.ndarray
    carries: np.ndarray
    results: tuple[np.ndarray, ...]


@dataclass(frozen=True, eq=False)
class ExpandedColumn:
    """A result that repeats its entries: what is wanted is column[index] (B,), what is computed the column (b, 1)."""

    column: ca.SX
    index: np.ndarray


class _RepeatedFunction:
    """A function repeated by CasADi over so many rows, into arrays of its own that are used again and again."""

    def __init__(self, function: ca.Function, length: int, indices: Sequence[np.ndarray | None]) -> None:
        self._buffer, self._evaluate = _dense(function.mapaccum(length)).buffer()
        self._indices = indices
        self._carry, self._carries = np.empty(function.size1_in(0)), np.empty((length, function.size1_in(0)))
        self._results = [np.empty((length, function.size1_out(j + 1))) for j in range(len(indices))]
        self._buffer.set_arg(0, memoryview(self._carry))  # pyright: ignore
        for j, values in enumerate([self._carries, *self._results]):
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
        for target, values, index in zip(results, self._results, self._indices, strict=True):
            if index is None:
                target[:] = values
            else:
                np.take(values, index, axis=1, out=target, mode="clip")  # clip: without a copy


class Scan:
    """(carry, row_1, ...) -> (carry', result_1, ...), all SX columns, applied to every row of arrays in turn.

    Runs in CasADi's virtual machine, or as machine code once it has run long enough for that to pay: the same numbers bit for
    bit, so that nothing depends on when. May be called from several threads.
    """

    def __init__(
        self,
        carry: ca.SX,
        rows: Sequence[ca.SX],
        carry_next: ca.SX,
        results: Sequence[ca.SX | ExpandedColumn] = (),
        share: bool = True,
        loop: InnerLoop | None = None,
    ) -> None:
        """Shared: look for what is computed twice; for a graph of hundreds of thousands of operations that takes seconds.

        loop: on whose end carry_next and the results depend, each row anew.
        """
        columns = [result.column if isinstance(result, ExpandedColumn) else result for result in results]
        dense = [ca.densify(carry_next), *map(ca.densify, columns)]
        outputs = without_repeats(dense) if share else dense
        looped = None if loop is None else function_with_loop(_NAME, [carry, *rows], outputs, loop)
        self._function = ca.Function(_NAME, [carry, *rows], outputs) if looped is None else looped.function
        self._has_loop = looped is not None
        self._operations = self._function.n_instructions() if looped is None else looped.operations
        self._source_operations = self._function.n_instructions() if looped is None else looped.source_operations
        self._indices = tuple(result.index if isinstance(result, ExpandedColumn) else None for result in results)
        self.widths = tuple(
            len(index) if index is not None else column.numel() for index, column in zip(self._indices, columns, strict=True)
        )
        self._widths_in = tuple(self._function.size1_in(i) for i in range(self._function.n_in()))
        self._addresses, self._places = (ctypes.c_void_p * count for count in (len(rows), len(results)))
        self._axes = ctypes.c_longlong * len(rows)
        self._width_out = sum(self._function.size1_out(j) for j in range(self._function.n_out()))
        self._repeated: dict[tuple[int, bool], _RepeatedFunction] = {}
        self._exact_lengths: set[int] = set()
        self._steps_done = 0
        self._compiled: native.NativeFunction | None = None
        self._policy = native.compile_policy()

    @property
    def instructions(self) -> int:
        """Number of operations of one step."""
        return self._operations

    @property
    def backend(self) -> str:
        """Say what runs the loop, and why it is not machine code if it is not."""
        if self._compiled is None:
            return f"CasADi's virtual machine ({'switched off' if self._policy == 'never' else 'not run long enough'})"
        return "machine code" if self._compiled.entry else f"CasADi's virtual machine ({self._compiled.reason})"

    def along(self, carry: np.ndarray, *rows: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return carries (N, c) after each step and each result (N, b), for carry (c,) and rows (N, a)."""
        run = self.run(carry[None], rows, len(rows[0]))
        return run.carries[0], *(result[0] for result in run.results)

    def last(self, carry: np.ndarray, *rows: np.ndarray) -> np.ndarray:
        """Return the carry (c,) after the last step."""
        return self.run(carry[None], rows, len(rows[0]), carries=False, results=False).carry[0]

    def run(self, carry: np.ndarray, rows: Sequence[np.ndarray], steps: int, carries: bool = True, results: bool = True) -> ScanResult:
        """Run M paths from carry (M, c). A row array is (N, a) for all paths, (M, N, a) for each its own, or (a,) for every step."""
        state = np.array(carry, dtype=float, order="C")
        inputs = [np.ascontiguousarray(row, dtype=float) for row in rows]
        paths = len(state)
        all_carries = np.empty((paths, steps, state.shape[1])) if carries else None
        outputs = tuple(np.empty((paths, steps, width)) for width in self.widths) if results else ()
        self._require_shapes(state, inputs, paths, steps)
        if paths and steps:
            with _LOOP_LOCK:
                entry = self._entry(paths * steps)
                loop = self._run_virtual if entry is None else self._run_native
                loop(state, inputs, steps, all_carries, outputs)
        return ScanResult(state, np.empty((paths, 0, state.shape[1])) if all_carries is None else all_carries, outputs)

    def _require_shapes(self, carry: np.ndarray, rows: list[np.ndarray], paths: int, steps: int) -> None:
        """Raise InputError for arrays that do not fit: a compiled loop would read beyond their ends."""
        for i, (values, width) in enumerate(zip([carry, *rows], self._widths_in, strict=True)):
            whole = paths, steps, width
            accepted = (whole[1:], whole, (width,)) if i else ((paths, width),)
            if values.shape not in accepted:
                raise InputError(f"array {i} of a loop has shape {values.shape}: must be {' or '.join(map(str, accepted))}")

    # ---------------------------------------------------------------- virtual machine

    def _run_virtual(
        self, carry: np.ndarray, rows: list[np.ndarray], steps: int, all_carries: np.ndarray | None, outputs: tuple[np.ndarray, ...]
    ) -> None:
        pieces = self._lengths(steps)
        tiled = [np.tile(row, (max(pieces), 1)) if row.ndim == 1 else row for row in rows]
        for m, state in enumerate(carry):
            first = 0
            for length in pieces:
                part = slice(first, first + length)
                rows_of_piece = [
                    row[:length] if rows[i].ndim == 1 else (row[m] if row.ndim == 3 else row)[part] for i, row in enumerate(tiled)
                ]
                self._function_of_length(length, bool(outputs))(
                    state, rows_of_piece, None if all_carries is None else all_carries[m, part], [output[m, part] for output in outputs]
                )
                first += length

    def _lengths(self, steps: int) -> list[int]:
        """Cut the steps into lengths for which the repeated function is kept: some exact ones, else powers of two."""
        longest = min(_MAX_LENGTH, 1 << max(0, (_MAX_ENTRIES // max(1, self._width_out)).bit_length() - 1))
        n_longest, remainder = divmod(steps, longest)
        lengths = [longest] * n_longest
        if remainder in self._exact_lengths or (remainder and len(self._exact_lengths) < _MAX_EXACT_LENGTHS):
            self._exact_lengths.add(remainder)
            return [*lengths, remainder]
        return [*lengths, *(1 << bit for bit in reversed(range(remainder.bit_length())) if remainder >> bit & 1)]

    def _function_of_length(self, length: int, has_results: bool) -> _RepeatedFunction:
        if (length, has_results) not in self._repeated:
            self._repeated[length, has_results] = _RepeatedFunction(self._function, length, self._indices if has_results else ())
        return self._repeated[length, has_results]

    # ---------------------------------------------------------------- machine code

    def _entry(self, steps: int) -> Any:  # noqa: ANN401  # a C function
        """Return the compiled loop if there is one, or if it is time for one."""
        if self._policy == "never":
            return None
        steps_before, self._steps_done = self._steps_done, self._steps_done + steps
        if self._compiled is None:
            is_worthwhile = self._policy == "at once" or self._steps_done >= _STEPS_BEFORE_COMPILE + _OPERATIONS_BEFORE_COMPILE / max(
                1, self.instructions
            )
            if is_worthwhile or steps_before < _STEPS_BEFORE_LOAD <= self._steps_done:
                self._compiled = self._load(only_cached=not is_worthwhile)
        return None if self._compiled is None else self._compiled.entry

    def _load(self, only_cached: bool) -> native.NativeFunction | None:
        function = self._function_with_full_results()
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
        return native.load(native.source_of(function, driver), f"{_NAME}_scan", self._source_operations, only_cached=only_cached)

    def _function_with_full_results(self) -> ca.Function:
        """The same step with every entry of its results written where it is wanted: cheap for a compiler, not for CasADi."""
        symbols: list[Any] = self._function.mx_in() if self._has_loop else self._function.sx_in()
        carry_next, *results = self._function.call(symbols)
        expanded = [result if index is None else result[index.tolist()] for result, index in zip(results, self._indices, strict=True)]
        return ca.Function(_NAME, symbols, [carry_next, *expanded])

    def _run_native(
        self, carry: np.ndarray, rows: list[np.ndarray], steps: int, all_carries: np.ndarray | None, outputs: tuple[np.ndarray, ...]
    ) -> None:
        has_failed = self._compiled.entry(  # pyright: ignore[reportOptionalMemberAccess]
            len(carry),
            steps,
            carry.ctypes.data,
            None if all_carries is None else all_carries.ctypes.data,
            self._addresses(*[row.ctypes.data for row in rows]),
            self._axes(*[row.ndim for row in rows]),
            self._places(*[values.ctypes.data for values in outputs]),
        )
        if has_failed:
            raise RuntimeError("a compiled loop stopped before its end")


def _dense(repeated: ca.Function) -> ca.Function:
    """Return a function that writes all of its results: CasADi leaves out those that are 0 for every row, and a buffer as it was."""
    if all(repeated.sparsity_out(j).is_dense() for j in range(repeated.n_out())):
        return repeated
    symbols = repeated.mx_in()
    return ca.Function(repeated.name(), symbols, [ca.densify(result) for result in repeated.call(symbols)])
