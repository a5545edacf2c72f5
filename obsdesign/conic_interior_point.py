"""Conic programs of few variables with dense data, solved by compiled code: an interior-point method of primal and dual."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from obsdesign import native_code

_ENTRY = "obsdesign_conic"
_FUNCTIONS = (("blas", "dsyrk"), ("blas", "dgemm"), ("blas", "dgemv"), ("lapack", "dpotrf"), ("lapack", "dpotrs"))


@dataclass(frozen=True, eq=False)
class DenseConicProgram:
    """minimise y'P y / 2 + c'y over |y_i| <= 1, i < q, with X y + h in r half-lines and in cones of positive semidefinite matrices.

    P (q, q), q the number of bounded variables; c (N,), N >= q; X (r + m, N), h (r + m,): m entries of matrices as `svec` has them;
    sides: n of every cone. All arrays in C order.
    """

    P: np.ndarray
    c: np.ndarray
    X: np.ndarray
    h: np.ndarray
    sides: tuple[int, ...]

    @property
    def half_lines(self) -> int:
        """r, the number of rows that are no cone's."""
        return len(self.h) - sum(n * (n + 1) // 2 for n in self.sides)


@dataclass(frozen=True, eq=False)
class InteriorPoint:
    """Variables y (N,) and multipliers: of y_i >= -1 (q,), of y_i <= 1 (q,), of the rows z (r + m,), of cones as `svec` has them.

    y is feasible, multipliers are >= 0. gap: slack times multiplier, and what is left of the gradient of the Lagrangian times 2, or times
    the size of an unbounded variable, or 1. The value at y exceeds the least by no more, unless a minimiser's unbounded variables
    are further away than that.
    """

    y: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    z: np.ndarray
    gap: float
    iterations: int


def has_machine_code() -> bool:
    """Whether there is compiled code, which needs a C compiler once; compiles it if it is not there yet, which takes about a second."""
    return native_entry("", _ENTRY) is not None


def follow_central_path(
    program: DenseConicProgram, y: np.ndarray, multipliers: np.ndarray, aim: float, max_iterations: int
) -> InteriorPoint | None:
    """Return the best point of the central path from y (N,), strictly feasible, and multipliers (2 q + r + m,), strictly positive.

    Ends once the gap is at most `aim`, or falls no further. None without machine code.
    Source: Mehrotra, On the implementation of a primal-dual interior point method (1992); Nesterov and Todd, Self-scaled barriers
    and interior-point methods for convex programming (1997).
    """
    entry = native_entry("", _ENTRY)
    if entry is None:
        return None
    N, q, r = len(program.c), len(program.P), program.half_lines
    sizes = np.array([N, q, r, len(program.sides), *program.sides], dtype=np.int64)
    data = (ctypes.c_void_p * 4)(*(values.ctypes.data for values in (program.P, program.c, program.X, program.h)))
    result, goal = np.concatenate([y, multipliers, [np.inf, 0.0]]), np.array([aim])
    has_failed = entry(
        max_iterations, len(program.h), sizes.ctypes.data, ctypes.addressof(data), linear_algebra(), result.ctypes.data, goal.ctypes.data
    )
    if has_failed:
        return None
    y, lower, upper, z, measured = np.split(result, np.cumsum([N, q, q, len(program.h)]))
    return InteriorPoint(y, lower, upper, z, float(measured[0]), int(measured[1]))


def native_entry(text: str, entry: str) -> Any:  # noqa: ANN401  # a C function, or None
    """Return a function of C that stands in a text which uses this method, and follows it in one source; None without machine code."""
    return None if native_code.compile_policy() == "never" else _load(text, entry)


@cache
def _load(text: str, entry: str) -> Any:  # noqa: ANN401  # a C function, or None
    if linear_algebra() is None:
        return None
    method = Path(__file__).with_suffix(".c").read_text(encoding="utf-8")
    loaded = native_code.load(f"{method}\n{text}", entry, 0)
    return None if loaded is None else loaded.entry


@cache
def linear_algebra() -> Any:  # noqa: ANN401  # an array of addresses, or None
    """Return the functions of SciPy's BLAS and LAPACK that the code calls; None where their integers are no ints."""
    table = (ctypes.c_void_p * len(_FUNCTIONS))()
    name_of = ctypes.pythonapi.PyCapsule_GetName
    name_of.restype, name_of.argtypes = ctypes.c_char_p, [ctypes.py_object]
    address_of = ctypes.pythonapi.PyCapsule_GetPointer
    address_of.restype, address_of.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    for i, (library, function) in enumerate(_FUNCTIONS):
        capsule = import_module(f"scipy.linalg.cython_{library}").__pyx_capi__.get(function)
        signature = b"" if capsule is None else name_of(capsule)
        if not signature.startswith(b"void (char *, ") or b" int *" not in signature:
            return None
        table[i] = address_of(capsule, signature)
    return table
