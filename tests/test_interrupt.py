"""Ctrl-C, a request to end and a terminal that is closed: all end work alike, and at once."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import BrokenExecutor, CancelledError
from multiprocessing import active_children, get_all_start_methods
from pathlib import Path

import pytest

from recordings import make, sensor
from tacstrip.cli import main
from tacstrip.interrupt import _end_with, all_as_ctrl_c, deferred_interrupt, worker_processes
from tacstrip.stream import RawScan
from tacstrip.stream.replay import Recording
from waiting import wait_until

SIGNALS = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]
HOUR_S = 3600.0  # of work that must be given up: none of it can end by itself meanwhile
LONG_S = 30.0  # none of the tests waits so long, unless it fails
AT_FORK: list[signal.Signals] = []  # come in this process when the next one has been forked


def _fork() -> None:
    if AT_FORK:
        signal.raise_signal(AT_FORK.pop())


os.register_at_fork(after_in_parent=_fork)


def _end(number: signal.Signals) -> None:
    """End this process, as from outside; the time is what an interrupt must cut short."""
    os.kill(os.getpid(), number)
    time.sleep(LONG_S)


@pytest.mark.parametrize("number", SIGNALS)
def test_all_that_ends_a_program_is_ctrl_c(number: signal.Signals) -> None:
    before = signal.getsignal(number)
    with all_as_ctrl_c(), pytest.raises(KeyboardInterrupt):
        _end(number)
    assert signal.getsignal(number) == before


def test_what_nohup_ignores_stays_ignored() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with all_as_ctrl_c(), deferred_interrupt() as stop:
            os.kill(os.getpid(), signal.SIGHUP)
            assert not stop()
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_worker_ends_itself_once_its_parent_is_gone(monkeypatch: pytest.MonkeyPatch) -> None:
    """One that was killed could not end it; while there is a parent it stays."""
    parents, ended = iter([7, 7, 1]), list[object]()
    monkeypatch.setattr(os, "getppid", lambda: next(parents))
    monkeypatch.setattr(os, "kill", lambda pid, number: ended.append((pid, number)))
    monkeypatch.setattr(os, "_exit", ended.append)
    monkeypatch.setattr("tacstrip.interrupt.time.sleep", lambda _: None)
    _end_with(7)
    assert ended == [(os.getpid(), signal.SIGTERM), 1]
    assert next(parents, None) is None


@pytest.mark.parametrize("number", SIGNALS)
def test_an_interrupt_ends_what_is_waited_for_and_disturbs_nothing_else(number: signal.Signals) -> None:
    def slow() -> Iterator[int]:
        yield 0
        yield 1
        _end(number)
        yield 2

    with deferred_interrupt() as stop:
        assert list(stop.until(slow())) == [0, 1]
        assert stop()
    with deferred_interrupt() as stop:
        taken = []
        for item in stop.until(range(9)):
            os.kill(os.getpid(), number)
            taken.append(item)  # a write, which goes on to its end
        assert taken == [0]
    with deferred_interrupt() as stop:
        assert list(stop.until(range(3))) == [0, 1, 2]
        assert not stop()


def test_work_in_other_processes_is_given_up_with_its_block() -> None:
    others = set(active_children())  # a test before this one may have left some
    with worker_processes(1, nice=1) as pool:
        assert pool.submit(os.getpid).result() != os.getpid()
        running, waiting = pool.submit(time.sleep, HOUR_S), pool.submit(time.sleep, HOUR_S)
        wait_until(running.running)
    # the pool's own thread may be the one that took its end, and about to note it
    wait_until(lambda: set(active_children()) <= others)
    for future in (running, waiting):
        with pytest.raises((BrokenExecutor, CancelledError, SystemExit)):
            future.result()


@pytest.mark.parametrize("number", SIGNALS)
def test_an_end_asked_for_while_a_process_is_forked_is_not_lost(number: signal.Signals) -> None:
    """Python prints what is raised in a hook of a fork, and goes on."""
    with all_as_ctrl_c(), worker_processes(1, start_method="fork") as pool:
        AT_FORK.append(number)
        with pytest.raises(KeyboardInterrupt):
            pool.submit(os.getpid)
        assert not AT_FORK
        assert pool.submit(os.getpid).result() != os.getpid()  # it was begun nevertheless
    with deferred_interrupt() as stop, worker_processes(1, start_method="fork") as pool:
        AT_FORK.append(number)
        pool.submit(os.getpid)
        assert stop()


def test_a_terminal_closed_on_all_processes_says_nothing_of_them() -> None:
    program = (
        "import time\nfrom tacstrip.interrupt import all_as_ctrl_c, worker_processes\n"
        "try:\n with all_as_ctrl_c(), worker_processes(1, start_method='spawn') as pool:\n"
        f"  pool.submit(int).result()\n  print('on', flush=True)\n  time.sleep({HOUR_S})\n"
        "except KeyboardInterrupt:\n print('ended')\n"
    )
    pipe = subprocess.PIPE
    command = [sys.executable, "-c", program]
    with subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, start_new_session=True) as began:
        assert began.stdout is not None
        assert began.stdout.readline() == "on\n"
        os.killpg(began.pid, signal.SIGHUP)
        assert began.communicate() == ("ended\n", "")
    assert began.returncode == 0


@pytest.mark.parametrize("number", SIGNALS)
def test_a_summary_that_is_interrupted_ends_at_once(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    number: signal.Signals,
) -> None:
    file = tmp_path / "a.mcap"
    make(file, sensor(), 3, None)

    def slow(*_: object) -> Iterator[RawScan]:
        _end(number)
        yield from ()

    monkeypatch.setattr("tacstrip.cli.replay.with_shapes", slow)
    monkeypatch.setattr(
        "sys.argv", ["tacstrip", "replay", str(file), "--summary", "--reconstruct", "profile"]
    )
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 1
    assert capsys.readouterr() == ("", "\nAborted!\n")


def test_a_recording_that_is_interrupted_holds_what_was_recorded_and_calls_nothing_cut(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    raws = make(tmp_path / "a.mcap", sensor(), 30, None)

    def slow(*_: object) -> Iterator[RawScan]:
        yield from raws[:5]
        _end(signal.SIGHUP)

    monkeypatch.setattr("tacstrip.cli.record.with_shapes", slow)
    monkeypatch.setattr(
        "sys.argv", ["tacstrip", "record", "a.mcap", "-o", "b.mcap", "--reconstruct", "profile"]
    )
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 0
    out, said = capsys.readouterr()
    assert "b.mcap: stopped: 5 scan(s)" in out
    assert said == ""
    assert [raw.sequence for raw in Recording("b.mcap")] == [0, 1, 2, 3, 4]


@pytest.mark.parametrize("method", get_all_start_methods())
def test_processes_work_however_they_are_begun(method: str) -> None:
    with worker_processes(1, start_method=method) as pool:
        assert pool.submit(sum, range(30)).result() == 435
