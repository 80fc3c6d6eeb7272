"""The live stream: everything is recorded, slow consumers are left behind."""

from __future__ import annotations

import errno
import io
import json
import math
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from pythonosc.osc_bundle import OscBundle
from pythonosc.osc_message import OscMessage

import tacstrip as ts
from live_devices import SENSOR, SHAPE, Line, Stepped, device, still, with_strips
from tacstrip.core.binding import exported
from tacstrip.sensor import Channel
from tacstrip.stream import RawScan
from tacstrip.stream.bridges.tuio import Tuio, blob
from tacstrip.stream.device.virtual import Loopback
from tacstrip.stream.live.bounded_queue import BoundedQueue
from tacstrip.stream.live.drift import DriftCorrectingDecoder
from tacstrip.stream.live.pipeline import Live
from tacstrip.stream.live.sinks import json_sink, tuio_sink
from tacstrip.stream.recording.recorder import Recorder
from tacstrip.tracking import Tracker, live_contact
from tacstrip.tracking.live_search import Contact, KnownShape, find_shape
from waiting import HANG_S, wait_until

SHAPE_20 = ts.Contact.polygon([(25, 30), (72, 28), (76, 66), (40, 74)])
FINE = ts.Sensor(construction="crs-crs", strips=100, pitch_mm=1.0, length_mm=100.0, adc_bits=12)
NOISE = ts.Noise(positional=0.002)


def test_a_bounded_queue_drops_the_oldest_or_waits() -> None:
    newest: BoundedQueue[int] = BoundedQueue(2)
    for i in range(5):
        assert newest.put(i)
    assert (newest.get(), newest.get(), newest.get(), newest.dropped) == (3, 4, None, 3)
    kept: BoundedQueue[int] = BoundedQueue(2, keep=True)
    thread = threading.Thread(target=lambda: [kept.put(i) for i in range(50)])
    thread.start()
    assert [kept.get(HANG_S) for _ in range(50)] == list(range(50))
    thread.join()
    assert kept.dropped == 0
    kept.close()
    assert not kept.put(1)
    assert kept.get(HANG_S) is None


def _live(rate_hz: float = 500.0, **options: object) -> Live:
    return Live(ts.SerialSource(lambda: Loopback(device(rate_hz=rate_hz)), SENSOR), **options)  # type: ignore[arg-type]


def test_frames_come_and_the_recording_is_complete(tmp_path: Path) -> None:
    file, seen = tmp_path / "a.mcap", []
    stream = ts.live(source=ts.SerialSource(lambda: Stepped(500.0), SENSOR), record=file)
    switch = sys.getswitchinterval()
    for frame in stream:
        seen.append(frame)
        if frame.number > 50 and len(seen) > 20:
            break
    assert not stream.running
    assert sys.getswitchinterval() == switch
    recorded = list(ts.Recording(file))
    assert [raw.sequence for raw in recorded] == list(range(stream.frames))
    assert len(recorded) > 50
    with closing(ts.Recording(file)) as recording:
        assert recording.sensor == SENSOR
    assert all(bool(recorded[frame.number].shapes) == bool(frame.objects) for frame in seen)
    (one,) = seen[-1].objects
    assert ts.mismatch(SHAPE.vertices, one.shape.vertices).iou > 0.95
    assert all(frame.latency_s > 0.0 for frame in seen)
    np.testing.assert_array_equal(recorded[seen[-1].number].codes["kh"], seen[-1].raw.codes["kh"])


def test_a_recording_is_a_source_too(tmp_path: Path) -> None:
    source = ts.SimulatedSource(SENSOR, still, 1000.0, 50, NOISE)
    with ts.Recorder(tmp_path / "a.mcap", SENSOR, source.names, 0) as recorder:
        ts.record(source, recorder)
    stream = ts.live(source=ts.Recording(tmp_path / "a.mcap"), speed=math.inf)
    assert list(stream)[-1].number == 49
    assert stream.frames == 50
    with pytest.raises(ts.OptionError, match="either a port or a source"):
        ts.live()


def test_a_slow_taker_gets_the_newest_and_holds_nobody_up(tmp_path: Path) -> None:
    stream = _live()
    slow = stream.subscribe()
    stream.record(tmp_path / "a.mcap")
    with stream:
        numbers = []
        for _ in range(4):
            frame = slow.get(HANG_S)
            assert frame is not None
            numbers.append(frame.number)
            handed_on = slow.dropped
            wait_until(lambda: slow.dropped > handed_on + 3)  # noqa: B023
    assert min(np.diff(numbers)) > 3
    assert slow.dropped + len(slow) + len(numbers) == stream.frames - stream.late
    assert len(list(ts.Recording(tmp_path / "a.mcap"))) == stream.frames


def test_a_full_disk_ends_the_recording_and_not_the_stream(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    add = Recorder.add

    def full(self: Recorder, raw: RawScan) -> None:
        if self.scans >= 60:
            with self._file.guard():
                raise OSError(errno.ENOSPC, "No space left on device")
        add(self, raw)

    monkeypatch.setattr(Recorder, "add", full)
    said: list[str] = []
    stream = _live(on_message=said.append)
    stream.record(tmp_path / "a.mcap")
    with stream:
        wait_until(lambda: stream.frames >= 150)
        wait_until(lambda: stream.recording is None)
        wait_until(lambda: said)  # and it goes on
        assert stream.running
    (text,) = said
    assert "No space left on device" in text
    saved = int(text.split(". ")[1].split(" scan")[0])
    assert "make room, or record to another disk" in text
    assert [raw.sequence for raw in ts.Recording(tmp_path / "a.mcap")] == list(range(saved))


def test_pulled_out_and_plugged_in_while_recording(tmp_path: Path) -> None:
    lines = iter([Line(device(rate_hz=500.0), cut=5000), Line(device(rate_hz=500.0))])
    said: list[str] = []
    stream = Live(ts.SerialSource(lambda: next(lines), SENSOR), on_message=said.append)
    stream.record(tmp_path / "a.mcap")
    with stream:
        wait_until(lambda: stream.frames >= 100)
    assert [text.partition(" (")[0] for text in said][:2] == ["the device is gone", "the device is back"]
    assert len(list(ts.Recording(tmp_path / "a.mcap"))) == stream.frames


def test_another_device_ends_the_stream_with_its_message(tmp_path: Path) -> None:
    lines = iter([Line(device(), cut=3000), Line(device(with_strips(30)))])
    stream = Live(ts.SerialSource(lambda: next(lines), SENSOR))
    stream.record(tmp_path / "a.mcap")
    with pytest.raises(ts.PortError, match="strips = 30 and the spec 20"):
        list(stream)
    assert len(list(ts.Recording(tmp_path / "a.mcap"))) == stream.frames > 10


class _Spoilt(ts.SimulatedSource):
    def __iter__(self) -> Iterator[RawScan]:
        for raw in super().__iter__():
            if raw.sequence % 2:
                raw.codes["kh"][:] = 60_000
            yield raw


def test_scans_that_are_no_readings_are_counted_named_once_and_recorded(tmp_path: Path) -> None:
    said: list[str] = []
    stream = Live(_Spoilt(SENSOR, still, 1000.0, 40), speed=math.inf, on_message=said.append)
    stream.record(tmp_path / "a.mcap")
    list(stream)
    assert stream.unreadable == 20
    assert (
        said[0]
        == "scan 1 cannot be used: a scan has the code 60000, above 4095: adc_bits = 12 of the spec is wrong"
    )
    raws = list(ts.Recording(tmp_path / "a.mcap"))
    assert len(raws) == 40
    assert all(raw.shapes is None for raw in raws[1::2])  # not known is not none
    assert sum(raw.shapes is None for raw in raws) == 20 + stream.late


def test_a_scan_that_waits_too_long_is_recorded_with_shapes_that_are_not_known(tmp_path: Path) -> None:
    stream = Live(ts.SimulatedSource(SENSOR, still, 1000.0, 2), tracks=False)
    stream.record(tmp_path / "a.mcap")
    (first, second), now_s = stream.source, time.perf_counter()
    stream._take(first, now_s - 1.0, 0)
    stream._take(second, math.inf, 0)
    stream.stop()
    assert stream.late == 1
    late, other = ts.Recording(tmp_path / "a.mcap")
    assert late.shapes is None
    assert other.shapes


def test_drift_is_followed_from_untouched_strips() -> None:
    channels = tuple(_channel(name) for name in ("kh", "kl"))
    calibration = ts.Calibration(sensor=SENSOR.fingerprint, channels=channels)
    sensor = replace(SENSOR, rest_volt=0.1, touch_volt=0.3, calibration=calibration)
    decoder = DriftCorrectingDecoder(sensor)
    assert decoder.drift is not None
    assert DriftCorrectingDecoder(SENSOR).drift is None
    assert DriftCorrectingDecoder(sensor, drift=False).drift is None
    moved = np.full(20, round((0.02 + 0.01) * 4095), dtype="<u2")  # rest is 0.02 of Vref; it went up by 0.01
    for i in range(4000):
        scan = decoder.decode(RawScan(0.05 * i, {"kh": moved, "kl": moved}, np.ones(20, dtype=bool), i))
    assert not scan.touched.any()
    assert decoder.sensor.calibration is not None
    drift = np.array(decoder.sensor.calibration.channel("kh").drift)
    np.testing.assert_allclose(drift, 0.01, atol=5e-4)


def _channel(name: str) -> Channel:
    ones = (1.0,) * 20
    return Channel(signature=name, rest=tuple(0.02 * v for v in ones), noise=tuple(0.001 * v for v in ones))


class _Pipe(io.StringIO):
    """Somebody reads four lines and goes."""

    def write(self, text: str) -> int:
        if self.getvalue().count("\n") >= 4:
            raise BrokenPipeError(errno.EPIPE, "Broken pipe")
        return super().write(text)


def test_json_lines_and_a_reader_that_goes() -> None:
    file = _Pipe()
    said: list[str] = []
    stream = _live(on_message=said.append)
    sink = json_sink(stream, file)
    with stream:
        wait_until(lambda: sink.ended)
    assert said == ["the output of JSON lines ended: Broken pipe"]
    lines = [json.loads(line) for line in file.getvalue().splitlines()]
    assert len(lines) == 4
    assert all(a["scan"] < b["scan"] for a, b in pairwise(lines))  # a busy computer skips some
    (one,) = lines[-1]["objects"]
    assert one["id"] == 1
    assert lines[-1]["status"] == one["status"]
    assert np.abs(np.array(one["vertices_mm"]) - SHAPE.vertices).max() < 5.0


class _Turning:
    """An object that turns to and fro, until it is known."""

    sensor, names, origin_ns = replace(FINE, strips=20, pitch_mm=5.0), ("kh", "kl"), 0

    def __init__(self, known: Callable[[], bool]) -> None:
        self._known = known

    @staticmethod
    def turned(time_s: float) -> ts.Contact:
        """Where it truly is."""
        return SHAPE_20.turned(0.6 * math.sin(3.0 * time_s)).moved(6.0 * math.sin(2.0 * time_s), 0.0)

    def __iter__(self) -> Iterator[RawScan]:
        for raw in ts.SimulatedSource(self.sensor, self.turned, 100.0, None, NOISE, 1):
            if self._known():
                return
            yield raw

    def close(self) -> None:
        """Nothing is open."""


@pytest.mark.skipif(exported("rigid_descend") is None, reason="NumPy takes minutes")
def test_objects_over_time_are_in_frames_lines_and_recordings(tmp_path: Path) -> None:
    file = io.StringIO()
    stream = Live(
        _Turning(lambda: any(o.status == "ok" and o.scans > 50 for o in stream.known.values())), noise=NOISE
    )
    stream.record(tmp_path / "a.mcap")
    sink = json_sink(stream, file)
    with stream:
        wait_until(lambda: sink.ended)
    lines = [json.loads(line) for line in file.getvalue().splitlines()]
    (last,) = lines[-1]["tracks"]
    assert (last["id"], last["status"], len(last["outline_mm"])) == (1, "ok", 4)
    assert last["scans"] > 50
    assert np.max(last["vertex_sigma_mm"]) < 0.2
    truth = _Turning.turned(lines[-1]["time_s"]).vertices  # a single scan, of 20 strips, may be far from it
    assert ts.mismatch(truth, np.array(last["vertices_mm"])).iou > 0.95
    raws = list(ts.Recording(tmp_path / "a.mcap"))
    np.testing.assert_allclose(raws[lines[-1]["sequence"]].tracks[0].placed, last["vertices_mm"], atol=1e-3)
    assert any(one.covariance is not None for raw in raws for one in raw.tracks or ())


class _Replayed(ts.SimulatedSource):
    """A file whose last scan is read before a search ends."""

    clock = "file"

    def __init__(self) -> None:
        spec = replace(FINE, strips=20, pitch_mm=5.0)
        super().__init__(spec, _Turning.turned, 100.0, 60, NOISE, 1)
        self.read = threading.Event()

    def __iter__(self) -> Iterator[RawScan]:
        yield from super().__iter__()
        self.read.set()


@pytest.mark.skipif(exported("rigid_descend") is None, reason="NumPy takes minutes")
def test_objects_that_are_not_known_yet_are_null_and_a_file_ends_with_those_that_its_scans_tell(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source, file = _Replayed(), io.StringIO()

    def found_late(contact: Contact) -> KnownShape | None:
        wait_until(source.read.is_set)
        return find_shape(contact)

    monkeypatch.setattr(live_contact, "find_shape", found_late)
    stream = Live(source, noise=NOISE, speed=math.inf)
    stream.record(tmp_path / "a.mcap")
    sink = json_sink(stream, file)
    with stream:
        wait_until(lambda: sink.ended)
    lines = [json.loads(line) for line in file.getvalue().splitlines()]
    assert [line["tracks"] for line in lines[:-1]] == [[]] * 9 + [None] * 50
    assert [line["searching"] for line in lines] == [0] * 9 + [1] * 50 + [0]
    assert stream.untracked == 50
    (last,) = lines[-1]["tracks"]
    assert last["scans"] == 60
    assert ts.mismatch(_Turning.turned(0.59).vertices, np.array(last["vertices_mm"])).iou > 0.9
    raws = list(ts.Recording(tmp_path / "a.mcap"))
    assert [raw.tracks is None for raw in raws] == [False] * 9 + [True] * 50 + [False]


def _received(listener: socket.socket) -> list[list[object]]:
    bundle = OscBundle(listener.recv(65536))
    messages = [part for part in bundle if isinstance(part, OscMessage)]
    assert {message.address for message in messages} == {"/tuio/2Dblb"}
    return [message.params for message in messages]


def test_tuio_blobs_over_udp() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", 0))
        listener.settimeout(HANG_S)
        stream = _live()
        sink = tuio_sink(stream, f"127.0.0.1:{listener.getsockname()[1]}")
        with stream:
            bundles = [_received(listener) for _ in range(3)]
        sink.close()
    for number, (source, alive, blobs, fseq) in enumerate(bundles, start=1):
        assert str(source[1]).startswith("tacstrip@")
        assert alive == ["alive", 1]
        assert fseq == ["fseq", number]
        name, session, x, y, _, width, height, area, *speeds = blobs
        assert (name, session) == ("set", 1)
        cx, cy = SHAPE.centroid
        assert isinstance(x, float)
        assert x == pytest.approx(cx / 100.0, abs=0.03)
        assert y == pytest.approx(1.0 - cy / 100.0, abs=0.03)
        assert area == pytest.approx(SHAPE.shapes[0].area / 1e4, abs=0.02)
        assert isinstance(width, float)
        assert isinstance(height, float)
        assert width > height > 0.2
        assert len(speeds) == 5


def test_tuio_turns_and_moves() -> None:
    def frame(contact: ts.Contact, number: int) -> ts.Frame:
        scan = ts.simulate(FINE, contact, NOISE)
        (one,) = tracker.update(scan)
        raw = RawScan(0.02 * number, {}, scan.touched)
        return ts.Frame(number, raw, FINE, scan, (one,), 0.0, 0.0)

    tracker = Tracker(FINE, "profile")
    bar = ts.Contact.polygon([(20, 46), (80, 46), (80, 54), (20, 54)])
    flat = blob(frame(bar, 0).objects[0], FINE)
    turned = blob(frame(bar.turned(0.5), 0).objects[0], FINE)
    assert flat is not None
    assert turned is not None
    assert turned.angle == pytest.approx(math.pi - 0.5, abs=0.02)  # y points down, so it turns the other way
    assert (turned.width, turned.height) == pytest.approx((flat.width, flat.height), abs=0.03)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", 0))
        listener.settimeout(HANG_S)
        tuio = Tuio(f"127.0.0.1:{listener.getsockname()[1]}")
        for i in range(30):
            tuio.send(frame(bar.moved(0.2 * i, 0.4 * i), i))  # 10 and 20 mm/s
            set_ = _received(listener)[2]
        tuio.close()
    assert set_[8] == pytest.approx(0.1, abs=0.04)
    assert set_[9] == pytest.approx(-0.2, abs=0.04)


@pytest.mark.parametrize("target", ["3333", "here:", "localhost:0", "localhost:x"])
def test_a_wrong_osc_target_is_refused(target: str) -> None:
    with pytest.raises(ts.OptionError, match=r"must be HOST:PORT, such as 127.0.0.1:3333"):
        Tuio(target)
