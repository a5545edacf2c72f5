"""How states along a path, and what is gained, answer to parameters: the walk forwards, by compiled code where there is some."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from obsdesign import native_code

_ENTRY = "obsdesign_sensitivity"


@dataclass(frozen=True, eq=False)
class Linearisation:
    """dz_k+1 = A dz_k + B du_k, d gain_k = D dz_k: A (M, N, c, c), B (M, N, c, m), D (M, N, b, c)."""

    A: np.ndarray
    B: np.ndarray
    D: np.ndarray


@dataclass(frozen=True, eq=False)
class PathSensitivity:
    """G (M, N+1, c, q), dz_k/dp, and gains (M, b, q), the derivatives of what all steps gain."""

    G: np.ndarray
    gains: np.ndarray


def propagate_sensitivity(linearisation: Linearisation, initial: np.ndarray, M: np.ndarray) -> PathSensitivity:
    """Walk from dz_0 = initial (M, c, q) with inputs du_k = M_k dp, M (N, m, q) or (M, N, m, q).

    Compiled, sums leave out what is 0; without a compiler they are those of matrices, the same but for rounding.
    """
    runs, steps, c, _ = linearisation.A.shape
    G = np.zeros((runs, steps + 1, c, initial.shape[-1]))
    G[:, 0] = initial
    entry = native_code.entry_of(_text(), _ENTRY)
    if entry is None:
        return PathSensitivity(G, _walk_by_matrices(linearisation, G, M))
    return PathSensitivity(G, _walk_compiled(entry, linearisation, G, M))


def _walk_compiled(entry: Any, linearisation: Linearisation, G: np.ndarray, M: np.ndarray) -> np.ndarray:  # noqa: ANN401  # a C function
    """Fill G (M, N+1, c, q) beyond its first nodes; return the derivatives of the gains."""
    (runs, steps, c, m), b, q = linearisation.B.shape, linearisation.D.shape[2], G.shape[-1]
    gains = np.zeros((runs, b, q))
    given = [np.ascontiguousarray(values) for values in (linearisation.A, linearisation.B, linearisation.D, M)]
    data = (ctypes.c_void_p * 4)(*(values.ctypes.data for values in given))
    results = (ctypes.c_void_p * 2)(G.ctypes.data, gains.ctypes.data)
    sizes = (ctypes.c_longlong * 5)(c, m, b, q, M.ndim == 4)
    entry(runs, steps, ctypes.addressof(sizes), ctypes.addressof(data), None, ctypes.addressof(results), None)
    return gains


def _walk_by_matrices(linearisation: Linearisation, G: np.ndarray, M: np.ndarray) -> np.ndarray:
    """Do the same by NumPy."""
    runs, steps, b, c = linearisation.D.shape
    forcing = linearisation.B @ M
    for k in range(steps):
        np.matmul(linearisation.A[:, k], G[:, k], out=G[:, k + 1])
        G[:, k + 1] += forcing[:, k]
    D = linearisation.D.transpose(0, 2, 1, 3).reshape(runs, b, steps * c)
    return D @ G[:, :-1].reshape(runs, steps * c, -1)


@cache
def _text() -> str:
    return Path(__file__).with_suffix(".c").read_text(encoding="utf-8")
