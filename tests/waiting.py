"""Waiting for what is to happen, however busy the computer is."""

from __future__ import annotations

import time
from collections.abc import Callable

HANG_S = 300.0  # nothing takes so long: whatever was awaited never comes


def wait_until(ready: Callable[[], object]) -> None:
    """Return as soon as a condition holds; fail where it never does."""
    end = time.monotonic() + HANG_S
    while not ready():
        assert time.monotonic() < end, "what is waited for did not come"
        time.sleep(0.005)
