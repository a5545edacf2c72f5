"""Small matrices on one thread: several threads of BLAS cost more than they gain there, and fight each other in a pool of workers."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from threading import Lock

from threadpoolctl import ThreadpoolController

_LOCK = Lock()


@contextmanager
def one_thread() -> Iterator[None]:
    """Run linear algebra on one thread, in the whole process, unless somebody has seen to that already.

    Who sets the limit takes it back: of contexts that overlap in several threads, each saving and restoring by itself, the last
    to leave would restore what the first had set. It is for speed alone, so it does not matter if the first leaves before others.
    """
    if not _LOCK.acquire(blocking=False):
        yield
        return
    try:
        with _controller().limit(limits=1):
            yield
    finally:
        _LOCK.release()


@cache
def _controller() -> ThreadpoolController:
    import_module("scipy.linalg")  # SciPy has a BLAS of its own, which is found only once it is loaded
    return ThreadpoolController()
