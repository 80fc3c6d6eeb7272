"""A bounded queue between two threads that either waits or lets the oldest go, and counts what went."""

from __future__ import annotations

import threading
import time
from collections import deque
from typing import Generic, TypeVar

T = TypeVar("T")


class Mailbox(Generic[T]):
    """What one thread leaves for another.

    Parameters
    ----------
    size
        How many wait at most.
    keep
        True: `put` waits until there is room, and nothing is lost; False: the oldest goes.

    Attributes
    ----------
    dropped
        How many went before they were fetched.
    """

    def __init__(self, size: int, keep: bool = False) -> None:
        self.dropped = 0
        self._size, self._keep = size, keep
        self._items: deque[T] = deque()
        self._change = threading.Condition()
        self._closed = False

    def __len__(self) -> int:
        return len(self._items)

    @property
    def closed(self) -> bool:
        """Whether nothing will come any more; what waits can still be fetched."""
        return self._closed

    def put(self, item: T) -> bool:
        """Leave an item; return False where the box is closed."""
        with self._change:
            while len(self._items) >= self._size and not self._closed:
                if self._keep:
                    self._change.wait()
                else:
                    self._items.popleft()
                    self.dropped += 1
            if self._closed:
                return False
            self._items.append(item)
            self._change.notify_all()
            return True

    def get(self, wait_s: float = 0.0) -> T | None:
        """Fetch the oldest item, waiting for one so long [s] at most; None where there is none."""
        with self._change:
            if not self._items and not self._closed and wait_s > 0.0:
                end = time.monotonic() + wait_s
                while not self._items and not self._closed and (left := end - time.monotonic()) > 0.0:
                    self._change.wait(left)
            if not self._items:
                return None
            item = self._items.popleft()
            self._change.notify_all()
            return item

    def get_all(self) -> list[T]:
        """Fetch everything that is there, the oldest first."""
        with self._change:
            items = list(self._items)
            self._items.clear()
            self._change.notify_all()
            return items

    def close(self) -> None:
        """Take nothing more, and let go of whoever waits."""
        with self._change:
            self._closed = True
            self._change.notify_all()
