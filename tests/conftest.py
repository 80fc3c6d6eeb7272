"""One thread a process, for on a busy machine the threads of linear algebra wait for each other;
the longest files first; signals as programs have them by default."""

from __future__ import annotations

import os
import signal

import pytest

from one_clock import Clock

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")

if hasattr(
    signal, "SIGHUP"
):  # a suite begun under nohup hangs up like any other, and so do the programs that it starts
    signal.signal(signal.SIGHUP, signal.SIG_DFL)

LONGEST = ("thesis/test_reproduce.py", "network/test_crp.py")  # begun last, one process would wait for them


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: not str(item.path).endswith(LONGEST))


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    """The computer's clock, the device's and the line's, all one."""
    made = Clock()
    monkeypatch.setattr("tacstrip.stream.device.source.HostClock", lambda: made)
    monkeypatch.setattr("tacstrip.stream.device.handshake.time.monotonic", made)
    return made
