"""Recordings: what goes in comes out, for us and for readers that know only MCAP and ROS 2."""

from __future__ import annotations

import errno
import io
import json
import os
import shutil
import stat
import time
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

import tacstrip as ts
from recordings import ORIGIN, make, sensor, source
from tacstrip.sensor import Channel
from tacstrip.sensor.constructions import CONSTRUCTIONS
from tacstrip.stream import Drag
from tacstrip.stream.codes import decode
from tacstrip.stream.export import json_line, write_npz
from tacstrip.stream.recording import mcap_file as mcapfile
from tacstrip.stream.recording.messages import FRAME
from tacstrip.stream.recording.recorder import Recorder, record
from tacstrip.stream.recording.recover import recover
from tacstrip.stream.recording.summary import summary
from tacstrip.stream.replay import Recording
from tacstrip.stream.source import RawScan, Shape, TrackedShape


def _same(read: RawScan, made: RawScan) -> None:
    assert read.time_s == pytest.approx(made.time_s, abs=1e-9)
    assert read.sequence == made.sequence
    assert list(read.codes) == list(made.codes)
    np.testing.assert_array_equal(read.touched, made.touched)
    for name, codes in made.codes.items():
        np.testing.assert_array_equal(read.codes[name], codes)
    assert [s.status for s in (read.shapes or ())] == [
        "ok" if s.status == "ok" else "doubtful" for s in (made.shapes or ())
    ]
    for got, want in zip((read.shapes or ()), (made.shapes or ()), strict=True):
        np.testing.assert_allclose(got.vertices, want.vertices, atol=1e-3)  # a thousandth of a millimetre


@pytest.mark.parametrize("construction", CONSTRUCTIONS)
def test_every_construction_comes_back(tmp_path: Path, construction: str) -> None:
    spec = sensor(construction, 12 if construction == "crs-crp" else 30)
    method = "profile" if CONSTRUCTIONS[construction].closed_form and "kh" in spec.signatures else None
    made = make(tmp_path / "a.mcap", spec, 12, method)
    file = Recording(tmp_path / "a.mcap")
    read = list(file)
    assert file.sensor == spec
    assert file.names == spec.signatures
    assert file.origin_ns == ORIGIN
    assert file.about["source"] == "test"
    assert file.condition.whole
    assert len(read) == len(made)
    for got, want in zip(read, made, strict=True):
        _same(got, want)
    assert any(raw.touched.any() and not raw.touched.all() for raw in read)


def test_all_electrodes_of_a_sheet(tmp_path: Path) -> None:
    spec = sensor("crs-crp", 8)
    made = source(spec, 3, electrodes="all")
    raws = list(made)
    with Recorder(tmp_path / "a.mcap", spec, made.names, ORIGIN) as recorder:
        for raw in raws:
            recorder.add(raw)
    for got, want in zip(Recording(tmp_path / "a.mcap"), raws, strict=True):
        _same(got, want)
        np.testing.assert_array_equal(decode(got, spec).electrodes, decode(want, spec).electrodes)


@pytest.mark.parametrize("bits", [1, 10, 16, 17, 32])
def test_codes_of_any_converter(tmp_path: Path, bits: int) -> None:
    spec = replace(sensor("crs-m", 5), adc_bits=bits)
    top = 2**bits - 1
    kind = "<u2" if bits <= 16 else "<u4"
    rows = np.array([[0, top, 0, top, 1], [top, 0, top, 0, 1]], dtype=kind)  # changes that wrap
    touched = np.array([True, True, False, True, True])
    times = np.array([0.0, 1e-5, 2e-5, 3e-5, 4e-5])
    raws = [RawScan(i * 1e-3, {"k": row}, touched, 7 + i, times) for i, row in enumerate(rows)]
    with Recorder(tmp_path / "a.mcap", spec, ("k",), ORIGIN) as recorder:
        for raw in raws:
            recorder.add(raw)
    for got, want in zip(Recording(tmp_path / "a.mcap"), raws, strict=True):
        _same(got, want)
        assert got.strip_time_s is not None
        np.testing.assert_allclose(got.strip_time_s, times, rtol=1e-6)


def test_mcap_and_rosbags_alone_read_every_polygon_and_code(tmp_path: Path) -> None:
    """Nothing of tacstrip is used to read: types come from the schemas in the file."""
    spec = sensor()
    made = make(tmp_path / "a.mcap", spec, 100)
    store = get_typestore(Stores.EMPTY)
    polygons: list[Any] = []
    scans: list[Any] = []
    with (tmp_path / "a.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        (attachment,) = reader.iter_attachments()
        assert tomllib.loads(attachment.data.decode())["strips"] == spec.strips
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")
            if schema.name not in store.types:
                types = get_types_from_msg(schema.data.decode(), schema.name)
                store.register({k: v for k, v in types.items() if k not in store.types})
            decoded: Any = store.deserialize_cdr(message.data, schema.name)
            (polygons if channel.topic == "/tacstrip/polygon" else scans).append((message.log_time, decoded))
    wanted = [(raw, shape) for raw in made for shape in raw.shapes or ()]
    assert len(polygons) == len(wanted) > 90
    assert len(scans) == len(made)
    for (log_time, polygon), (raw, shape) in zip(polygons, wanted, strict=True):
        assert polygon.header.frame_id == FRAME
        stamp = polygon.header.stamp
        assert stamp.sec * 10**9 + stamp.nanosec == log_time == ORIGIN + round(raw.time_s * 1e9)
        xyz = np.array([(p.x, p.y, p.z) for p in polygon.polygon.points])  # metres, as ROS counts
        np.testing.assert_allclose(xyz[:, :2] * 1e3, shape.vertices, atol=1e-3)
        assert not xyz[:, 2].any()
    for (_, scan), raw in zip(scans, made, strict=True):
        np.testing.assert_array_equal(scan.kl_reference + scan.kl_change.astype("<u2"), raw.codes["kl"])
        np.testing.assert_array_equal(scan.touched, raw.touched)


def test_rosbags_opens_the_file_as_a_bag(tmp_path: Path) -> None:
    made = make(tmp_path / "a.mcap", sensor(), 40)
    with AnyReader([tmp_path / "a.mcap"]) as bag:
        counts = {c.topic: c.msgcount for c in bag.connections}
        assert counts["/tacstrip/scan"] == 40
        assert counts["/tacstrip/polygon"] == sum(s.status == "ok" for raw in made for s in raw.shapes or ())
        corners = [
            len(bag.deserialize(data, c.msgtype).polygon.points)  # type: ignore[attr-defined]
            for c, _, data in bag.messages()
            if c.topic == "/tacstrip/polygon"
        ]
    assert corners == [len(s.vertices) for raw in made for s in raw.shapes or () if s.status == "ok"]


def test_objects_that_were_not_known_yet_are_not_those_that_are_not_there(tmp_path: Path) -> None:
    spec, path = sensor(), tmp_path / "a.mcap"
    known = TrackedShape(1, "ok", np.array([(0.0, 0.0), (9.0, 0.0), (0.0, 9.0)]), np.zeros(3), 7)
    tracks: list[tuple[tuple[TrackedShape, ...] | None, int]] = [((), 0), (None, 0), (None, 2), ((known,), 1)]
    with Recorder(path, spec, spec.signatures, ORIGIN) as recorder:
        pairs = zip(source(spec, 4), tracks, strict=True)
        record([replace(raw, tracks=some, searching=more) for raw, (some, more) in pairs], recorder)
    raws = list(Recording(path))
    got = [(None if raw.tracks is None else len(raw.tracks), raw.searching) for raw in raws]
    assert got == [(0, 0), (None, 0), (None, 2), (1, 1)]
    write_npz(tmp_path / "a.npz", Recording(path))
    with np.load(tmp_path / "a.npz") as arrays:
        assert arrays["track_searching"].tolist() == [0, -1, 2, 1]
        assert arrays["track_scan"].tolist() == [3]
    scan = decode(raws[0], spec)
    lines = [json.loads(json_line(i, raw, scan)) for i, raw in enumerate(raws)]
    assert "tracks" not in lines[0]
    assert [(line["tracks"], line["searching"]) for line in lines[1:3]] == [(None, 0), (None, 2)]
    assert (len(lines[3]["tracks"]), lines[3]["searching"]) == (1, 1)
    recording, said = Recording(path), "objects over time were not known yet in 2 scan(s): `tacstrip track"
    assert any(said in line for line in summary(recording, recording))


@pytest.mark.parametrize("method", ["polygon", ""])
def test_shapes_that_were_not_known_are_not_those_that_are_not_there(tmp_path: Path, method: str) -> None:
    spec, path = sensor(), tmp_path / "a.mcap"
    known = Shape("ok", np.array([(0.0, 0.0), (9.0, 0.0), (0.0, 9.0)]))
    shapes: list[tuple[Shape, ...] | None] = [(), None, (known,)]
    with Recorder(path, spec, spec.signatures, ORIGIN, {"method": method}) as recorder:
        record(
            [replace(raw, shapes=some) for raw, some in zip(source(spec, 3), shapes, strict=True)], recorder
        )
    raws = list(Recording(path))
    assert [raw.shapes if not raw.shapes else len(raw.shapes) for raw in raws] == [(), None, 1]
    write_npz(tmp_path / "a.npz", Recording(path))
    with np.load(tmp_path / "a.npz") as arrays:
        assert arrays["polygon_known"].tolist() == [True, False, True]
        assert arrays["polygon_scan"].tolist() == [2]
    lines = [json.loads(json_line(i, raw, decode(raw, spec)))["shapes"] for i, raw in enumerate(raws)]
    assert lines[:2] == [[], None]
    recording = Recording(path)
    assert any("shapes are not known of 1 scan(s): " in line for line in summary(recording, recording))


def test_without_a_method_no_shapes_are_known(tmp_path: Path) -> None:
    spec, path = sensor(), tmp_path / "a.mcap"
    with Recorder(path, spec, spec.signatures, ORIGIN, {"method": ""}) as recorder:
        record(source(spec, 2), recorder)
    raws = list(Recording(path))
    assert [raw.shapes for raw in raws] == [None, None]
    write_npz(tmp_path / "a.npz", Recording(path))
    with np.load(tmp_path / "a.npz") as arrays:
        assert not arrays["polygon_known"].any()
    assert json.loads(json_line(0, raws[0], decode(raws[0], spec)))["shapes"] is None
    recording = Recording(path)
    assert any("of 2 scan(s): nothing was reconstructed; `" in line for line in summary(recording, recording))
    with path.open("rb") as file:
        topics = {channel.topic for _, channel, _ in make_reader(file).iter_messages()}
    assert topics == {"/tacstrip/scan"}  # nothing is added to each scan


def test_objects_over_time_come_back_also_without_tacstrip(tmp_path: Path) -> None:
    spec, own = sensor(), np.array([(-8.0, -6.0), (9.0, -5.0), (0.0, 11.0)])
    pose = np.array([20.0, 50.0, 0.5])
    spread = np.eye(6) * 0.01
    tracks = [
        (TrackedShape(1, "ok", own, pose, 7, "", spread, 0.1 * np.eye(3)),),
        (TrackedShape(1, "ok", own, pose + 1.0, 8), TrackedShape(2, "doubtful", own, 0.0 * pose, 9, "why")),
        (TrackedShape(1, "ok", own, np.full(3, np.nan), 8), TrackedShape(3, "doubtful", own[:0], pose)),
    ]
    made = [replace(raw, tracks=some) for raw, some in zip(source(spec, 3), tracks, strict=True)]
    with Recorder(tmp_path / "a.mcap", spec, spec.signatures, ORIGIN) as recorder:
        record(made, recorder)
    assert (recorder.scans, recorder.tracks) == (3, 5)
    recover(tmp_path / "a.mcap", tmp_path / "b.mcap")
    for name in ("a.mcap", "b.mcap"):
        for got, want in zip(Recording(tmp_path / name), made, strict=True):
            _same(got, want)
            assert got.tracks is not None
            assert want.tracks is not None
            for a, b in zip(got.tracks, want.tracks, strict=True):
                assert (a.id, a.status, a.scans, a.advice) == (b.id, b.status, b.scans, b.advice)
                np.testing.assert_allclose(a.outline, b.outline, atol=1e-9)
                np.testing.assert_allclose(a.pose, b.pose, atol=1e-9)
                for one, other in ((a.covariance, b.covariance), (a.pose_covariance, b.pose_covariance)):
                    assert (one is None) == (other is None)
                    if one is not None and other is not None:
                        np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-12)
    with AnyReader([tmp_path / "a.mcap"]) as bag:
        messages = [(c.topic, bag.deserialize(data, c.msgtype)) for c, _, data in bag.messages()]
    found: list[tuple[str, Any]] = [*messages]
    polygons = [(t, m.polygon.points) for t, m in found if t.startswith("/tacstrip/track_polygon")]
    assert [t for t, _ in polygons] == [f"/tacstrip/track_polygon{s}" for s in ("", "", "_doubtful")]
    corners = np.array([(p.x, p.y) for p in polygons[0][1]]) * 1e3
    np.testing.assert_allclose(corners, tracks[0][0].placed, atol=1e-3)
    (first, *_) = [m for t, m in found if t == "/tacstrip/track"]
    np.testing.assert_allclose(first.pose, (0.02, 0.05, 0.5))
    np.testing.assert_allclose(first.covariance.reshape(6, 6), 1e-8 * np.eye(6), rtol=1e-6)


def test_doubtful_shapes_keep_to_themselves(tmp_path: Path) -> None:
    spec = sensor()
    corners = np.array([(1.0, 2.0), (9.0, 3.0), (5.0, 8.0)])
    raw = next(iter(source(spec)))
    with Recorder(tmp_path / "a.mcap", spec, raw_names := tuple(raw.codes), ORIGIN) as recorder:
        recorder.add(replace(raw, shapes=(Shape("doubtful", corners), Shape("ok", corners + 10.0))))
    assert raw_names == ("kh", "kl")
    (read,) = Recording(tmp_path / "a.mcap")
    assert [s.status for s in (read.shapes or ())] == ["doubtful", "ok"]
    np.testing.assert_allclose((read.shapes or ())[0].vertices, corners, atol=1e-3)


def test_a_rest_level_is_looked_at_when_reading(tmp_path: Path) -> None:
    """Codes of untouched strips stay in the file; the spec says which those are, and a later spec may say other."""
    spec = replace(sensor("crs-m", 4), rest_volt=0.0, touch_volt=0.5)
    raw = RawScan(0.0, {"k": np.array([0, 100, 900, 4095], "<u2")}, np.ones(4, bool))
    with Recorder(tmp_path / "a.mcap", spec, ("k",), ORIGIN) as recorder:
        recorder.add(raw)
    (read,) = Recording(tmp_path / "a.mcap")
    np.testing.assert_array_equal(read.codes["k"], raw.codes["k"])
    assert decode(read, spec).touched.tolist() == [False, False, True, True]
    other = Recording(tmp_path / "a.mcap", replace(spec, touch_volt=0.05))
    assert decode(next(iter(other)), other.sensor).touched.tolist() == [False, True, True, True]


def test_codes_are_raw_and_the_calibration_is_inside(tmp_path: Path) -> None:
    """The file holds what the unit's converter read; whoever reads it gets corrected readings."""
    plain = sensor()
    offset = Channel(signature="kh", offset=tuple(np.linspace(-0.05, 0.05, plain.strips)))
    spec = replace(plain, calibration=ts.Calibration(channels=(offset,)))
    still = Drag(ts.Contact.polygon([(0, 0), (16, 4), (6, 30)]), [(15, 50)], 1.0)
    for ahead in (1, 8):
        made = ts.SimulatedSource(spec, still, scans=8, ahead=ahead)
        with Recorder(tmp_path / "a.mcap", spec, made.names, ORIGIN, force=True) as recorder:
            record(made, recorder)
        file = Recording(tmp_path / "a.mcap")
        assert file.sensor == spec
        ideal = ts.simulate(replace(plain, adc_bits=None), still(0.0))
        for raw in file:
            read = raw.codes["kh"] / 4095.0 - ideal["kh"]
            np.testing.assert_allclose(
                read, np.where(raw.touched, offset.offset, np.nan), atol=0.5 / 4095 + 1e-4
            )
            for name in ("kh", "kl"):
                np.testing.assert_allclose(decode(raw, spec)[name], ideal[name], atol=1.0 / 4095)


def test_waiting_scans_are_written_before_they_are_old(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    spec = sensor()
    raws = list(source(spec, 40, 1000.0))
    recorder = Recorder(tmp_path / "a.mcap", spec, ("kh", "kl"), ORIGIN)
    recorder.add(raws[0])
    assert recorder.saved_scans == 1  # the first goes at once
    recorder.add(raws[1])
    recorder.add(raws[2])
    assert recorder.saved_scans == 1
    recorder.idle(0.01)  # the next scan comes soon
    assert recorder.saved_scans == 1
    recorder.idle(0.5)
    assert recorder.saved_scans == 3
    recorder.add(raws[3])
    now[0] += 0.09
    recorder.add(raws[4])  # the fourth was there for 90 ms by our clock
    assert recorder.saved_scans == 5
    recorder.add(raws[5])
    recorder.add(replace(raws[6], time_s=raws[5].time_s + 0.09))  # and by its own
    assert recorder.saved_scans == 7
    recorder.close()
    assert len(list(Recording(tmp_path / "a.mcap"))) == 7


def test_a_power_cut_loses_a_second_of_a_durable_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the disk was told to save is what is left, whether scans come or not."""
    now, file, saved = [0.0], tmp_path / "a.mcap", tmp_path / "saved.mcap"
    synced: list[bool] = []

    def fsync(number: int) -> None:
        synced.append(stat.S_ISDIR(os.fstat(number).st_mode))
        shutil.copy(file, saved)

    monkeypatch.setattr(os, "fsync", fsync)
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    spec = sensor()
    raws = list(source(spec, 600, 100.0))
    with Recorder(file, spec, ("kh", "kl"), ORIGIN, durable=True) as recorder:
        assert synced == [False, True]  # the file, and its name in the folder
        for number, raw in enumerate(raws[:550]):
            now[0] = raw.time_s
            recorder.add(raw)
            if number % 50 == 49:
                assert len(list(Recording(saved))) >= number - 110
        for _ in range(12):  # nothing comes
            now[0] += 0.1
            recorder.idle(0.1)
        assert len(list(Recording(saved))) == 550
        assert len(synced) <= 10
    assert saved.read_bytes() == file.read_bytes()
    synced.clear()
    make(tmp_path / "b.mcap", spec)
    assert not synced


@pytest.mark.parametrize("room", [9_000, 0])  # 0: none but for the index
def test_a_failed_write_leaves_a_whole_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, room: int
) -> None:
    spec = sensor()
    raws = list(source(spec, 200, 1000.0))

    class Disk(io.FileIO):
        """A disk with room for so much."""

        def write(self, data: Any) -> int | None:  # type: ignore[override]
            if (free := (room or 10**9) - self.tell()) <= 0:
                raise OSError(errno.ENOSPC, "No space left on device")
            return super().write(data[:free])

    monkeypatch.setattr(mcapfile, "FileIO", Disk)
    recorder = Recorder(tmp_path / "a.mcap", spec, ("kh", "kl"), ORIGIN)

    def fill() -> None:
        nonlocal room
        record(raws, recorder)
        recorder.flush()
        room = (tmp_path / "a.mcap").stat().st_size
        recorder.close()

    with pytest.raises(OSError, match="No space left") as caught:
        fill()
    assert caught.value.filename == str(tmp_path / "a.mcap")
    recorder.close()
    monkeypatch.undo()
    file = Recording(tmp_path / "a.mcap")
    read = list(file)
    assert file.condition.whole
    assert len(read) == recorder.saved_scans > 0
    for got, want in zip(read, raws, strict=False):
        _same(got, want)
    with (tmp_path / "a.mcap").open("rb") as stream:
        assert len(list(make_reader(stream).iter_messages())) == len(read)
    with AnyReader([tmp_path / "a.mcap"]) as bag:
        assert bag.message_count == len(read)


def test_recover_every_cut(tmp_path: Path) -> None:
    """Wherever a file is cut, all whole chunks come back, and other readers read the new file."""
    made = make(tmp_path / "a.mcap", sensor(), 60)
    data = (tmp_path / "a.mcap").read_bytes()
    before = 0
    for size in np.linspace(5000, len(data) - 1, 25).astype(int).tolist():
        (tmp_path / "cut.mcap").write_bytes(data[:size])
        saved = recover(tmp_path / "cut.mcap", tmp_path / "new.mcap", force=True)
        count = saved.messages["/tacstrip/scan"]
        assert count >= before
        before = count
        assert not saved.condition.whole
        for got, want in zip(Recording(tmp_path / "new.mcap"), made[:count], strict=True):
            _same(got, want)
        assert saved.condition.lost_bytes == size - saved.condition.good_bytes
        with (tmp_path / "new.mcap").open("rb") as stream:
            assert len(list(make_reader(stream, validate_crcs=True).iter_messages())) == sum(
                saved.messages.values()
            )
    assert before == len(made)


def test_recover_leaves_a_damaged_chunk_out(tmp_path: Path) -> None:
    made = make(tmp_path / "a.mcap", sensor(), 60)
    data = bytearray((tmp_path / "a.mcap").read_bytes())
    with (tmp_path / "a.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    for index in summary.chunk_indexes[0], summary.chunk_indexes[2]:  # the first holds the schemas
        data[index.chunk_start_offset + index.chunk_length // 2] ^= 0x10
    (tmp_path / "bad.mcap").write_bytes(data)
    with pytest.raises(
        ts.RecordingError, match=r"bad\.mcap: the record at byte \d+ is damaged .*tacstrip recover"
    ):
        list(Recording(tmp_path / "bad.mcap"))
    saved = recover(tmp_path / "bad.mcap", tmp_path / "new.mcap")
    assert len(saved.condition.damage) == 2
    read = list(Recording(tmp_path / "new.mcap"))
    assert 0 < len(read) < len(made)
    by_number = {raw.sequence: raw for raw in made}
    for got in read:
        _same(got, by_number[got.sequence])


def test_what_cannot_be_recorded(tmp_path: Path) -> None:
    spec = sensor()
    raw = next(iter(source(spec)))
    with pytest.raises(ts.RecordingError, match="set adc_bits in the spec"):
        Recorder(tmp_path / "a.mcap", replace(spec, adc_bits=None), ("kh",), ORIGIN)
    with Recorder(tmp_path / "a.mcap", spec, ("kh", "kl"), ORIGIN) as recorder:
        for time_s in (float("nan"), 1e300, 1e10, -1e12):
            with pytest.raises(ts.RecordingError, match="time"):
                recorder.add(replace(raw, time_s=time_s))
    with pytest.raises(ts.RecordingError, match=r"a\.mcap exists already"):
        Recorder(tmp_path / "a.mcap", spec, ("kh", "kl"), ORIGIN)
    with pytest.raises(ts.RecordingError, match="nothing to recover"):
        recover(tmp_path / "a.mcap", tmp_path / "b.mcap")
    assert not (tmp_path / "b.mcap").exists()


def test_another_spec_must_fit_the_codes(tmp_path: Path) -> None:
    spec = sensor()
    make(tmp_path / "a.mcap", spec, 3, None)
    file = Recording(tmp_path / "a.mcap", replace(spec, length_mm=90.0))
    assert file.sensor.length_mm == 90.0
    file.close()
    for other, told in (
        (replace(spec, strips=29), "strips = 30, and the spec given has 29"),
        (replace(spec, adc_bits=10), "adc_bits = 12, and the spec given has 10"),
        (sensor("crs-m"), "construction = crs-crs, and the spec given has crs-m"),
    ):
        with pytest.raises(ts.RecordingError, match=told):
            Recording(tmp_path / "a.mcap", other)
