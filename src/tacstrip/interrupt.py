"""How work is ended from outside: Ctrl-C, SIGTERM and a closed terminal (SIGHUP) all do the same."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from contextlib import AbstractContextManager, contextmanager, suppress
from multiprocessing import active_children, get_context, resource_tracker
from types import FrameType
from typing import ParamSpec, TypeVar

_Item = TypeVar("_Item")
_P = ParamSpec("_P")
# Windows has no SIGHUP.
_SIGNALS = [s for name in ("SIGINT", "SIGTERM", "SIGHUP") if (s := getattr(signal, name, None)) is not None]
_ORPHAN_S = 0.5  # between two checks of a worker that its parent still runs
_LAST_S = 0.5  # for a process to remove the unfinished file that it writes


@contextmanager
def _handled(handler: Callable[[int, FrameType | None], object]) -> Iterator[None]:
    """Handle these signals; only the end of a terminal that `nohup` has ignored stays ignored."""
    before = {s: signal.getsignal(s) for s in _SIGNALS}
    try:
        for number, old in before.items():
            if old != signal.SIG_IGN or number in (signal.SIGINT, signal.SIGTERM):
                signal.signal(number, handler)
        yield
    finally:
        for number, old in before.items():
            signal.signal(number, signal.SIG_DFL if old is None else old)


def all_as_ctrl_c() -> AbstractContextManager[None]:
    """While entered, all that ends a program raises `KeyboardInterrupt`, so that no part of a file is left."""
    return _handled(signal.default_int_handler)


@contextmanager
def _held_back() -> Iterator[None]:
    """Delay these signals until the block has ended: an exception raised in the hooks of a fork would be lost."""
    if threading.current_thread() is not threading.main_thread():
        yield  # signals are handled in the main thread alone
        return
    held: list[int] = []
    try:
        with _handled(lambda number, _: held.append(number)):
            yield
    finally:
        for number in held[:1]:
            signal.raise_signal(number)


class Stop:
    """Whether an end was asked for: call it."""

    def __init__(self) -> None:
        self._asked = self._waiting = False

    def __call__(self) -> bool:
        """Return whether an end was asked for."""
        return self._asked

    def ask(self, *_: object) -> None:
        """Ask for the end: a wait ends at once, other work where its loop checks next."""
        self._asked = True
        if self._waiting:
            raise KeyboardInterrupt

    def until(self, items: Iterable[_Item]) -> Iterator[_Item]:
        """Yield items until an end is asked for, also while one is made; what is done with it is not disturbed."""
        steps = iter(items)
        while not self._asked:
            try:
                self._waiting = True
                item = next(steps)
            except (StopIteration, KeyboardInterrupt):
                return
            finally:
                self._waiting = False
            yield item


@contextmanager
def deferred_interrupt() -> Iterator[Stop]:
    """While entered, what ends a program only sets a flag, so that it interrupts no write."""
    stop = Stop()
    with _handled(stop.ask):
        yield stop


@contextmanager
def worker_processes(
    count: int | None = None, nice: int = 0, start_method: str | None = None
) -> Iterator[Executor]:
    """Give processes, by default one a core, for work that is given up when the block ends; `nice` is theirs."""
    with children_end():
        pool = worker_pool(count, nice, start_method)
        try:
            yield pool
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def worker_pool(
    count: int | None = None, nice: int = 0, start_method: str | None = None
) -> ProcessPoolExecutor:
    """Return processes that leave it to the first one what ends work; use it within `children_end`."""
    context = get_context(start_method)
    if context.get_start_method() != "fork":
        _begin_tracker()
    # A fork server's processes are its children, not this one's.
    parent = None if context.get_start_method() == "forkserver" else os.getpid()
    return _Pool(count, context, _begin, (nice, parent))


def _begin_tracker() -> None:
    """Begin the process that tracks what processes share, deaf to a closed terminal: without it their end is loud."""
    if not hasattr(signal, "pthread_sigmask"):
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGHUP})  # which its program inherits
    try:
        resource_tracker.ensure_running()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class _Pool(ProcessPoolExecutor):
    """Processes that are begun without being disturbed."""

    def submit(self, work: Callable[_P, _Item], /, *args: _P.args, **options: _P.kwargs) -> Future[_Item]:
        with _held_back():
            return super().submit(work, *args, **options)


@contextmanager
def children_end() -> Iterator[None]:
    """End the processes that were begun in the block when it ends."""
    before = set(active_children())
    try:
        yield
    finally:
        for child in (made := set(active_children()) - before):
            child.terminate()
        end_s = time.monotonic() + _LAST_S
        for child in made:
            child.join(max(0.0, end_s - time.monotonic()))
            child.kill()
            child.join()


def _begin(nice: int, parent: int | None) -> None:
    """Leave Ctrl-C, which a terminal sends to all processes, to the first one, and let it run first."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(
        target=_end_with, args=(os.getppid() if parent is None else parent,), daemon=True
    ).start()
    with suppress(AttributeError, OSError):
        os.nice(nice)
    for number in set(_SIGNALS) - {signal.SIGINT}:
        signal.signal(number, lambda *_: sys.exit(1))


def _end_with(parent: int) -> None:
    """End this process once its parent is gone: one that was killed could not end its children."""
    while os.getppid() == parent:
        time.sleep(_ORPHAN_S)
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(_LAST_S)
    os._exit(1)
