"""One clock for a test and all that it watches: nothing waits."""

from __future__ import annotations


class Clock:
    """The one clock of a test [s]; it stands until the test moves it."""

    now_s = 1000.0

    def __call__(self) -> float:
        return self.now_s
