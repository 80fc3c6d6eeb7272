"""A stream that breaks off hands the error on: to its consumer, to the command line, and its recording is whole."""

from __future__ import annotations

import io
import logging
import math
import socket
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

import tacstrip as ts
from live_devices import SENSOR, still
from tacstrip.cli.live import command
from tacstrip.stream import RawScan
from tacstrip.stream.live.pipeline import Live
from tacstrip.stream.live.service import Service
from tacstrip.stream.live.sinks import Sink, json_sink
from tacstrip.stream.recording.recorder import Recorder
from tacstrip.tracking import Tracker
from waiting import HANG_S, wait_until

SCANS = 40


class _OddError(Exception):
    """An error that nobody here knows."""


class _Breaks(ts.SimulatedSource):
    """Gives so many scans, and raises; or raises as it is closed."""

    def __init__(self, error: BaseException, after: int = SCANS, at_close: bool = False) -> None:
        super().__init__(SENSOR, still, 1000.0, SCANS, ts.Noise(positional=0.002))
        self.error, self.after, self.at_close = error, after, at_close

    def __iter__(self) -> Iterator[RawScan]:
        for raw in super().__iter__():
            if raw.sequence == self.after:
                raise self.error
            yield raw
        if not self.at_close:
            raise self.error

    def close(self) -> None:
        if self.at_close:
            raise self.error


ERRORS = [_OddError("the bench is on fire"), OSError(5, "Input/output error"), ts.PortError("gone"), SystemExit(3),
          ZeroDivisionError()]  # fmt: skip


def _own_threads() -> set[str]:
    return {t.name for t in threading.enumerate() if t.name.startswith("tacstrip")}


@pytest.mark.parametrize("error", ERRORS, ids=lambda e: type(e).__name__)
@pytest.mark.parametrize(("after", "at_close"), [(0, False), (25, False), (SCANS, False), (SCANS, True)])
def test_what_a_source_raises_reaches_the_consumer(
    error: BaseException, after: int, at_close: bool, tmp_path: Path
) -> None:
    file, seen, said = tmp_path / "a.mcap", list[ts.Frame](), list[str]()
    stream = ts.live(
        source=_Breaks(error, after, at_close), record=file, speed=math.inf, on_message=said.append
    )
    with pytest.raises(type(error)) as caught:
        seen.extend(stream)
    assert caught.value is error
    assert stream.error is error
    assert not stream.running
    assert stream.frames == after
    if after:  # the newest frame that there was is handed on before
        assert seen[-1].number == after - 1
    recording = ts.Recording(file)
    assert [raw.sequence for raw in recording] == list(range(after))
    assert recording.condition.whole
    assert _own_threads() == set()
    broke = [text for text in said if ".mcap" not in text]
    assert len(broke) == 1
    assert str(error) in broke[0] or "Input/output error" in broke[0]


def test_the_last_frame_comes_before_the_error() -> None:
    for _ in range(20):
        stream = Live(_Breaks(_OddError("x"), 1), speed=math.inf)
        seen: list[ts.Frame] = []
        with pytest.raises(_OddError):
            seen.extend(stream)
        assert [frame.number for frame in seen] == [0]


def test_a_consumer_that_stops_early_leaves_no_thread_and_a_whole_recording(tmp_path: Path) -> None:
    stream = ts.live(source=_Breaks(_OddError("late"), at_close=True), record=tmp_path / "a.mcap")
    for frame in stream:
        if frame.number >= 5:
            break
    assert isinstance(stream.error, _OddError)  # raised as it was closed
    assert _own_threads() == set()
    assert [raw.sequence for raw in ts.Recording(tmp_path / "a.mcap")] == list(range(stream.frames))


def test_an_error_in_the_recovery_is_handed_on_and_its_scan_recorded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stream = ts.live(source=_Breaks(_OddError("never")), record=tmp_path / "a.mcap", speed=math.inf)
    update, calls = Tracker.update, iter(range(100))

    def broken(self: Tracker, scan: ts.Scan, detail: bool = False) -> object:
        if next(calls) == 10:
            raise ZeroDivisionError("in the fit")
        return update(self, scan, detail)

    monkeypatch.setattr(Tracker, "update", broken)
    with pytest.raises(ZeroDivisionError, match="in the fit"):
        list(stream)
    assert len(list(ts.Recording(tmp_path / "a.mcap"))) == stream.frames >= 11


def test_whoever_is_told_may_raise_too() -> None:
    def tell(text: str) -> None:
        raise BrokenPipeError(32, "Broken pipe")

    stream = Live(_Breaks(ts.PortError("gone"), 5), speed=math.inf, on_message=tell)
    with pytest.raises(ts.PortError, match="gone"):
        list(stream)
    assert _own_threads() == set()


def test_a_recorder_that_cannot_go_on_holds_nobody_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not only a full disk; the queue to it is small, so that a writer who died would stop the stream."""
    monkeypatch.setattr("tacstrip.stream.live.background_recorder._QUEUE_SCANS", 4)
    add = Recorder.add

    def broken(self: Recorder, raw: RawScan) -> None:
        if self.scans >= 10:
            raise _OddError("no such code")
        add(self, raw)

    monkeypatch.setattr(Recorder, "add", broken)
    said: list[str] = []
    source = ts.SimulatedSource(SENSOR, still, 1000.0, SCANS)
    stream = ts.live(source=source, record=tmp_path / "a.mcap", speed=math.inf, on_message=said.append)
    assert list(stream)[-1].number == SCANS - 1
    assert stream.error is None
    assert stream.recording_failed
    assert said == [
        f"recording to {tmp_path / 'a.mcap'} ended: _OddError: no such code. 10 scan(s) are saved in it"
    ]
    assert [raw.sequence for raw in ts.Recording(tmp_path / "a.mcap")] == list(range(10))


def test_a_sink_that_raises_ends_alone() -> None:
    def take(frame: ts.Frame, dropped: int) -> None:
        raise _OddError("full")

    released = threading.Event()
    said: list[str] = []
    stream = Live(ts.SimulatedSource(SENSOR, still, 1000.0, SCANS), speed=math.inf, on_message=said.append)
    sink = Sink(stream, take, 10, "the plotter", released.set)
    other = json_sink(stream, file := io.StringIO())
    with stream:
        assert released.wait(HANG_S)
    other.close()
    assert stream.error is None
    assert isinstance(sink.error, _OddError)
    assert other.error is None
    assert said == ["the plotter ended: _OddError: full"]
    assert file.getvalue().count("\n") > 0
    wait_until(lambda: not _own_threads())  # the sink's says that it has ended before it does


def test_sinks_end_with_the_stream() -> None:
    stream = Live(_Breaks(_OddError("x"), 3), speed=math.inf)
    sinks = [json_sink(stream, io.StringIO()) for _ in range(2)]
    with pytest.raises(_OddError):
        list(stream)
    late = json_sink(stream, io.StringIO())
    for sink in (*sinks, late):
        sink._thread.join(HANG_S)
        assert sink.ended


@pytest.mark.parametrize("error", ERRORS, ids=lambda e: type(e).__name__)
def test_the_command_says_it_in_a_sentence_and_exits_1(
    error: BaseException, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "a.mcap"
    (tmp_path / "readings.mcap").touch()
    monkeypatch.setattr("tacstrip.cli.live.open_source", lambda path, sensor: _Breaks(error, 30))
    done = CliRunner().invoke(
        command, [str(tmp_path / "readings.mcap"), "--no-view", "--speed", "1000", "-o", str(file)]
    )
    assert done.exit_code == 1
    broke, saved = done.stderr.splitlines()
    assert broke.startswith("gone" if isinstance(error, ts.PortError) else "the stream broke off: ")
    assert "30 scan(s)" in saved
    assert [raw.sequence for raw in ts.Recording(file)] == list(range(30))


@pytest.mark.parametrize(
    ("error", "code"), [(OSError(28, "No space left on device"), 1), (BrokenPipeError(32, "Broken pipe"), 0)]
)
def test_lines_that_cannot_be_written_are_a_failure_unless_the_reader_went(
    error: OSError, code: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def sinks(live: Live, given: object) -> Iterator[Sink]:
        yield Sink(live, _raiser(error), 10, "the output of JSON lines")

    monkeypatch.setattr("tacstrip.cli.live._sinks", sinks)
    done = CliRunner().invoke(command, ["--simulate", "--sensor", "prototype-crs-m", "--no-view", "--json"])
    assert done.exit_code == code
    assert f"the output of JSON lines ended: {error.strerror}" in done.stderr


def _raiser(error: Exception) -> Callable[[ts.Frame, int], None]:
    def take(frame: ts.Frame, dropped: int) -> None:
        raise error

    return take


def test_messages_go_to_the_logger_by_default(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    file = tmp_path / "a.mcap"
    with caplog.at_level(logging.INFO, "tacstrip"), pytest.raises(ts.PortError, match="gone"):
        list(ts.live(source=_Breaks(ts.PortError("gone"), 5), record=file, speed=math.inf))
    said = [(r.name, r.levelname, r.getMessage().partition(" scan(s)")[0]) for r in caplog.records]
    assert said == [("tacstrip", "WARNING", "gone"), ("tacstrip", "INFO", f"{file}: 5")]


class _Dead(Executor):
    """A pool whose process was killed."""

    def submit(self, function: Any, /, *words: Any, **_: Any) -> Future[Any]:
        future: Future[Any] = Future()
        future.set_exception(BrokenProcessPool("a process was terminated abruptly"))
        return future


def test_searches_go_on_when_their_process_is_killed(monkeypatch: pytest.MonkeyPatch) -> None:
    searched: list[ts.Scan] = []

    def search(scan: ts.Scan, *_: object) -> tuple[ts.Reconstruction, None]:
        searched.append(scan)
        return ts.Reconstruction("polygon", ()), None

    monkeypatch.setattr("tacstrip.tracking.layered._searched", search)
    layers = ts.LayeredSensor.crossed(
        ts.Sensor(construction="crs-crs", strips=8, pitch_mm=5.0, length_mm=40.0, adc_bits=12)
    )
    contact = ts.Contact.polygon([(8, 8), (30, 10), (20, 32)])
    source = ts.SimulatedSource(layers, lambda time_s: contact, 10.0, 20)
    stream = Live(source, speed=math.inf, searches=_Dead())
    with stream:
        assert stream.wait(HANG_S)
    assert stream.error is None
    assert sum("the process that searches for objects is gone" in text for _, text in stream.messages) == 1
    assert searched


def test_a_reader_that_hangs_is_known(monkeypatch: pytest.MonkeyPatch) -> None:
    """The watchdog's question: how long the scan in hand has been worked on."""
    hang, hangs = threading.Event(), threading.Event()

    def update(*_: object) -> tuple[()]:
        hangs.set()
        assert hang.wait(HANG_S)
        return ()

    monkeypatch.setattr(Tracker, "update", update)
    stream = Live(ts.SimulatedSource(SENSOR, still, 1000.0, 2), speed=math.inf, tracks=False)
    assert stream.stuck_s == 0.0
    with stream:
        assert hangs.wait(HANG_S)
        before_s = stream.stuck_s
        wait_until(lambda: stream.stuck_s > before_s + 0.01)
        hang.set()
        assert stream.wait(HANG_S)
    assert stream.stuck_s == 0.0


def test_what_hangs_is_not_told_to_live(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    address = str(tmp_path / "notify")
    monkeypatch.setenv("NOTIFY_SOCKET", address)
    monkeypatch.setenv("WATCHDOG_USEC", "2000")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(address)
        service = Service()
        service.alive("fine", stuck_s=0.002)
        service.alive("fine", stuck_s=0.0)
        said = manager.recv(4096).decode().splitlines() + manager.recv(4096).decode().splitlines()
    assert said == ["STATUS=fine", "WATCHDOG=1"]
