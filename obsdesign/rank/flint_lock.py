"""One verdict at a time: flint keeps its precision, and the length of its series, for the process and not for a thread."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from threading import RLock

import flint

_LOCK = RLock()
"""Held by the thread that uses flint; it may take it again. A fork waits for it, so no child is born in the middle of a verdict."""
if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_LOCK.acquire, after_in_parent=_LOCK.release, after_in_child=_LOCK.release)

_DEFAULT_BITS, _DEFAULT_TERMS = 53, 10
"""Flint's own settings."""


@contextmanager
def exclusive_flint() -> Iterator[None]:
    """Have flint to oneself: other threads wait, its settings are its own at the start and restored at the end."""
    with _LOCK:
        bits, terms = flint.ctx.prec, flint.ctx.cap
        flint.ctx.prec, flint.ctx.cap = _DEFAULT_BITS, _DEFAULT_TERMS
        try:
            yield
        finally:
            flint.ctx.prec, flint.ctx.cap = bits, terms
