"""One thread a process, for on a busy machine the threads of linear algebra wait for each other;
the longest files first; signals as programs have them by default."""

from __future__ import annotations

import gc
import os
import signal
from pathlib import Path

import pytest

from one_clock import Clock

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")

gc.disable()  # until tests are collected: what that makes stays

if hasattr(
    signal, "SIGHUP"
):  # a suite begun under nohup hangs up like any other, and so do the programs that it starts
    signal.signal(signal.SIGHUP, signal.SIG_DFL)

# Begun last, one process would wait for them; the longest first.
LONGEST = (
    "view/test_page.py",
    "diagnose/test_doctor.py",
    "calibrate/test_unit.py",
    "tracking/test_track.py",
    "thesis/test_reproduce.py",
    "tracking/test_shared_strips.py",
    "reconstruction/test_known_object.py",
    "diagnose/test_learned_noise.py",
    "network/test_crp.py",
    "diagnose/test_workshop.py",
    "studies/test_sound_scenes.py",
    "reconstruction/test_pressed_solid.py",
    "plot/test_public.py",
    "reconstruction/test_polygon.py",
    "test_docs.py",
    "stream/test_live_clock.py",
    "stream/test_rogue_device.py",
    "firmware/test_emulated.py",
    "network/test_resolved.py",
    "reconstruction/test_estimates.py",
    "view/test_server.py",
    "stream/test_recording_kill.py",
    "stream/test_live.py",
)


def pytest_sessionstart(session: pytest.Session) -> None:
    """Say why the tests are slow where nothing is compiled."""
    # Late, for linear algebra counts its threads as it loads.
    from tacstrip.core.library import description, library

    if library() is None and not hasattr(session.config, "workerinput"):
        session.config.get_terminal_writer().line(
            f"core: {description()}. The tests take several times as long; what would take minutes is skipped."
        )


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    at = {str(Path(__file__).parent / name): place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: at.get(str(item.path), len(LONGEST)))


def pytest_collection_finish() -> None:
    """Spare the collector of garbage what stays for the whole run: modules and the tests themselves."""
    gc.freeze()
    gc.enable()


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    """The computer's clock, the device's and the line's, all one."""
    made = Clock()
    monkeypatch.setattr("tacstrip.stream.device.source.HostClock", lambda: made)
    monkeypatch.setattr("tacstrip.stream.device.handshake.time.monotonic", made)
    return made


@pytest.fixture
def no_outline(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fit no outline: it takes most of the time, and knows of drift and wander alone."""
    monkeypatch.setattr("tacstrip.diagnose.rigid_contact._FEWEST_PLACES", 1_000)
