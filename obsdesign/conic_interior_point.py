"""The compiled interior-point method of primal and dual for conic programs of few variables with dense data, and what it calls.

Source: Mehrotra, On the implementation of a primal-dual interior point method (1992); Nesterov and Todd, Self-scaled barriers and
interior-point methods for convex programming (1997).
"""

from __future__ import annotations

import ctypes
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

from obsdesign import native_code

_FUNCTIONS = (("blas", "dsyrk"), ("blas", "dgemm"), ("blas", "dgemv"), ("lapack", "dpotrf"), ("lapack", "dpotrs"))


def native_entry(text: str, entry: str) -> Any:  # noqa: ANN401  # a C function, or None
    """Return a function of C that stands in a text which uses this method, and follows it in one source; None without machine code."""
    return None if linear_algebra() is None else native_code.entry_of(_source(text), entry)


@cache
def _source(text: str) -> str:
    return f"{Path(__file__).with_suffix('.c').read_text(encoding='utf-8')}\n{text}"


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
