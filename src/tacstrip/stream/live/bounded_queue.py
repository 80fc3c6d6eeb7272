"""A bounded queue between threads that either waits for room or discards its oldest item, and counts those."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import suppress
from typing import Generic, TypeVar

T = TypeVar("T")


_WAIT_S = 0.1  # longest single wait for an item


class BoundedQueue(Generic[T]):
    """A first-in, first-out queue of limited length. Iterate it, also by `async for`, until it is closed and empty.

    Parameters
    ----------
    size
        Largest number of items that wait.
    keep
        What `put` does when the queue is full. True: wait for room, so that nothing is lost; False: discard the
        oldest item.

    Attributes
    ----------
    dropped
        Number of items that were discarded.
    """

    def __init__(self, size: int, keep: bool = False) -> None:
        self.dropped = 0
        self._size, self._keep = size, keep
        self._items: deque[T] = deque()
        self._change = threading.Condition()
        self._closed = False
        self._wakers: list[Callable[[], object]] = []

    def __len__(self) -> int:
        return len(self._items)

    @property
    def closed(self) -> bool:
        """Whether no more items will come; those that wait can still be fetched."""
        return self._closed

    def put(self, item: T) -> bool:
        """Append an item; return False where the queue is closed."""
        with self._change:
            if self._keep:
                self._change.wait_for(lambda: self._closed or len(self._items) < self._size)
            if self._closed:
                return False
            if len(self._items) >= self._size:
                self._items.popleft()
                self.dropped += 1
            self._items.append(item)
            self._change.notify_all()
        self._wake()
        return True

    def get(self, wait_s: float = 0.0) -> T | None:
        """Fetch the oldest item, after waiting for one for at most `wait_s` [s]; None where there is none."""
        with self._change:
            self._change.wait_for(lambda: self._closed or len(self._items) > 0, wait_s)
            item = self._items.popleft() if self._items else None
            self._change.notify_all()
            return item

    def get_all(self) -> list[T]:
        """Fetch all items that wait, the oldest first."""
        with self._change:
            items = list(self._items)
            self._items.clear()
            self._change.notify_all()
            return items

    def close(self) -> None:
        """Accept no more items, and release the threads that wait."""
        with self._change:
            self._closed = True
            self._change.notify_all()
        self._wake()

    async def next(self) -> T | None:
        """Fetch the oldest item once there is one, without a thread that waits; None once no more will come."""
        import asyncio

        loop = asyncio.get_running_loop()
        while True:
            came = asyncio.Event()
            with self._change:
                if self._items or self._closed:
                    item = self._items.popleft() if self._items else None
                    self._change.notify_all()
                    return item
                self._wakers.append(lambda: loop.call_soon_threadsafe(came.set))  # noqa: B023
            await came.wait()

    def __iter__(self) -> Iterator[T]:
        while not self._closed or len(self._items):
            if (item := self.get(_WAIT_S)) is not None:
                yield item

    async def __aiter__(self) -> AsyncIterator[T]:
        while (item := await self.next()) is not None:
            yield item

    def _wake(self) -> None:
        """Wake those that await an item."""
        if self._wakers:
            wakers, self._wakers = self._wakers, []
            for wake in wakers:
                with suppress(RuntimeError):  # its loop has ended
                    wake()
