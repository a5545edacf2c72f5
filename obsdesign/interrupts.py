"""Ctrl-C, and the processes that a command starts."""

from __future__ import annotations

import _thread
import atexit
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NoReturn

from obsdesign.errors import ExitCode

if TYPE_CHECKING:
    from concurrent.futures import Executor


@contextmanager
def process_pool(jobs: int) -> Iterator[Executor | None]:
    """Yield a pool of processes, or None where one process is enough; workers end with the command.

    What follows writes files: from then on Ctrl-C is one KeyboardInterrupt, and nothing ends by force.
    """
    with _pool(jobs) as pool:
        yield pool
        interrupts = signal.getsignal(signal.SIGINT)
        if isinstance(interrupts, Interrupts):
            signal.signal(signal.SIGINT, signal.default_int_handler)
            if interrupts.count:
                raise KeyboardInterrupt


@contextmanager
def _pool(jobs: int) -> Iterator[Executor | None]:
    if jobs == 1:
        yield None
        return
    import multiprocessing
    from concurrent.futures import ProcessPoolExecutor

    ignore = (signal.SIGINT, signal.SIG_IGN)
    pool = ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn"), initializer=signal.signal, initargs=ignore)
    try:
        with _interrupts_deferred():
            while len(multiprocessing.active_children()) < jobs:  # a task starts a worker if none is idle
                pool.submit(int)
        yield pool
    except BaseException:
        # a pool that finds its workers gone fails at tasks that were cancelled, unless it was shut down before and is still there
        pool.shutdown(wait=False, cancel_futures=True)
        atexit.register(pool.shutdown)
        _end_workers()
        raise
    pool.shutdown(wait=False)


def _end_workers() -> None:
    import multiprocessing

    for worker in multiprocessing.active_children():
        worker.kill()


@contextmanager
def _interrupts_deferred() -> Iterator[None]:
    """Put Ctrl-C off, and start processes that never hear it: this one alone answers."""
    pressed = []
    answer = signal.signal(signal.SIGINT, lambda *_: pressed.append(True))
    blocked = None if sys.platform == "win32" else signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        if sys.platform != "win32":
            signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
        signal.signal(signal.SIGINT, answer)
    if pressed and callable(answer):
        answer(signal.SIGINT, None)


_PAUSE, _TRIES, _PATIENCE = 0.5, 3, 3.0  # seconds from one KeyboardInterrupt to the next; how many; seconds to leave in


@dataclass
class Interrupts:
    """The answer to Ctrl-C: KeyboardInterrupt until one has arrived, after some of them the end by force.

    One is not enough: callbacks of the garbage collector swallow it, some solvers take it for the end of one try, and modules that
    are being loaded make another error of it. As a handler of signals it has to remember: this is the one record that changes.

    report: says that the command was interrupted; count: how often Ctrl-C was pressed or repeated; reported: whether that was said.
    """

    report: Callable[[], None]
    count: int = 0
    reported: bool = False
    thread: int = field(default_factory=_thread.get_ident)

    def listen(self) -> None:
        """Answer Ctrl-C from now on, but for a command in the background, which ignores it."""
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            signal.signal(signal.SIGINT, self)

    def __call__(self, *_: object) -> None:
        self.count += 1
        if self.reported or self.count > _TRIES:
            self._end()
        if self.count == 1:
            sys.unraisablehook = _unless_interrupted
            _thread.start_new_thread(self._repeat, ())  # not by threading: its locks may be held where this comes in
        raise KeyboardInterrupt

    def report_once(self) -> None:
        """Say, once, that it has arrived."""
        before, self.reported = self.reported, True
        if not before:
            self.report()

    def _repeat(self) -> None:
        time.sleep(_PAUSE)
        while not self.reported:
            # to the main thread itself: while that waits, a signal to another one does not wake it
            _thread.interrupt_main() if sys.platform == "win32" else signal.pthread_kill(self.thread, signal.SIGINT)
            time.sleep(_PAUSE)
        time.sleep(_PATIENCE)  # a pool may wait for ever: for the rest of a killed worker's answer, or a lock that was held just then
        self._end()

    def _end(self) -> NoReturn:
        with suppress(Exception):
            self.report_once()
            sys.stdout.flush()
            _end_workers()
        os._exit(ExitCode.INTERRUPTED)


def _unless_interrupted(unraisable: sys.UnraisableHookArgs) -> None:
    if unraisable.exc_type is not KeyboardInterrupt:
        sys.__unraisablehook__(unraisable)
