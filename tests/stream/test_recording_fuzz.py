"""Broken files of every kind: a clear error or a reading, never a traceback, a hang or a full memory."""

from __future__ import annotations

import contextlib
import resource
import struct
import time
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import zstandard
from mcap.records import Attachment, Channel, Message, Metadata, Schema

import tacstrip as ts
from recordings import make, sensor
from tacstrip.stream.codes import decode
from tacstrip.stream.recording.mcap_file import McapFile
from tacstrip.stream.recording.records import MAGIC, Records
from tacstrip.stream.recording.recover import recover
from tacstrip.stream.recording.summary import summary
from tacstrip.stream.replay import Recording

HUGE = [0, 1, 0x7F, 2**15, 2**31 - 1, 2**31, 2**32 - 1, 2**40, 2**62, 2**63 - 1, 2**64 - 1]


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("fuzz") / "good.mcap"
    make(path, sensor(strips=8), 25)
    return path


def _went(job: Callable[[], object]) -> bool:
    """Return whether a job went well; no other error than ours may come of it."""
    try:
        job()
    except ts.TacstripError:
        return False
    return True


def _read(path: Path) -> bool:
    """Read a file in every way there is; return whether the first went well."""
    new = path.with_name("recovered.mcap")
    if _went(lambda: recover(path, new, force=True)):
        _went(lambda: _drain(new))
    _went(lambda: _told(path))
    return _went(lambda: _drain(path))


def _drain(path: Path) -> None:
    with contextlib.closing(Recording(path)) as file:
        for raw in file:
            decode(raw, file.sensor)


def _told(path: Path) -> None:
    with contextlib.closing(Recording(path)) as file:
        assert summary(file, file)


def _bytes_changed(data: bytes, random: np.random.Generator) -> bytes:
    """Flip, overwrite, cut, repeat or leave out bytes, or put a wild number somewhere."""
    changed = bytearray(data)
    for _ in range(random.integers(1, 4)):
        at = int(random.integers(0, len(changed)))
        length = int(random.integers(1, 200))
        match random.integers(0, 6):
            case 0:
                changed[at] ^= 1 << int(random.integers(0, 8))
            case 1:
                changed[at : at + length] = random.bytes(length)
            case 2:
                del changed[at:]
            case 3:
                del changed[at : at + length]
            case 4:
                changed[at:at] = changed[at : at + length]
            case _:
                changed[at : at + 8] = struct.pack("<Q", HUGE[int(random.integers(0, len(HUGE)))])
        if not changed:
            break
    return bytes(changed)


def _content_changed(good: Path, path: Path, random: np.random.Generator) -> None:
    """Write the good file anew with right checksums and a message, attachment or text in it that was changed."""
    records = [r for r in Records(good) if isinstance(r, Attachment | Channel | Message | Metadata | Schema)]
    messages = [i for i, r in enumerate(records) if isinstance(r, Message)]
    victim = int(random.choice([0, 1, 2, 3, int(random.choice(messages)), int(random.choice(messages))]))
    file = McapFile(path, force=True)
    writer = file.writer
    seen: set[tuple[type, int]] = set()
    for number, record in enumerate(records):
        hit = number == victim
        match record:
            case Attachment():
                data = _bytes_changed(record.data, random) if hit else record.data
                writer.add_attachment(0, 0, record.name, record.media_type, data)
            case Metadata():
                told = {k: _text_changed(v, random) if hit else v for k, v in record.metadata.items()}
                writer.add_metadata(record.name, told)
            case Schema() if (Schema, record.id) not in seen:
                seen.add((Schema, record.id))
                name = _text_changed(record.name, random) if hit else record.name
                writer.register_schema(name, record.encoding, record.data)
            case Channel() if (Channel, record.id) not in seen:
                seen.add((Channel, record.id))
                topic = _text_changed(record.topic, random) if hit else record.topic
                writer.register_channel(topic, record.message_encoding, record.schema_id, record.metadata)
            case Message():
                data = _bytes_changed(record.data, random) if hit else record.data
                at = (
                    HUGE[int(random.integers(0, len(HUGE)))]
                    if hit and random.random() < 0.2
                    else record.log_time
                )
                writer.add_message(record.channel_id, at, data, at)
            case _:
                pass
    file.close()


def _text_changed(text: str, random: np.random.Generator) -> str:
    if random.random() < 0.3:
        return str(HUGE[int(random.integers(0, len(HUGE)))])
    return _bytes_changed(text.encode() or b"x", random).decode(errors="replace")


def _run(good: Path, folder: Path, count: int) -> None:
    random = np.random.default_rng(11)
    data = good.read_bytes()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    read = 0
    for number in range(count):
        path = folder / "mutant.mcap"
        if number % 2:
            path.write_bytes(_bytes_changed(data, random))
        else:
            _content_changed(good, path, random)
        start = time.process_time()
        read += _read(path)
        assert time.process_time() - start < 5.0
    assert count / 50 < read < count - count / 50  # both happen
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 300_000  # kB


def test_mutated_recordings(good: Path, tmp_path: Path) -> None:
    _run(good, tmp_path, 150)


@pytest.mark.slow
def test_ten_thousand_mutated_recordings(good: Path, tmp_path: Path) -> None:
    _run(good, tmp_path, 10_000)


def _record(opcode: int, body: bytes, length: int | None = None) -> bytes:
    return struct.pack("<BQ", opcode, len(body) if length is None else length) + body


def _chunk(data: bytes, size: int, crc: int = 0, compression: bytes = b"zstd") -> bytes:
    head = struct.pack("<QQQII", 0, 0, size, crc, len(compression)) + compression
    return _record(6, head + struct.pack("<Q", len(data)) + data)


BOMB = zstandard.compress(bytes(2**28))  # 256 MB of zeros in a few kB
LIES = {
    "a record of 8 exabytes": _record(6, b"abc", 2**63 - 1),
    "a chunk that says it is huge": _chunk(zstandard.compress(b"abc"), 2**62),
    "a zstd bomb": _chunk(BOMB, 2**62),
    "a zstd bomb that owns up to less": _chunk(BOMB, 100, zlib.crc32(bytes(100))),
    "data that is no zstd": _chunk(b"nonsense", 8),
    "an unknown compression": _chunk(b"abc", 3, compression=b"brotli"),
    "a chunk in a chunk": _chunk(_chunk(b"", 0, compression=b""), 50, compression=b""),
    "metadata longer than its record": _record(
        12, struct.pack("<I", 1) + b"x" + struct.pack("<I", 2**32 - 1)
    ),
    "a text of 4 GB": _record(3, struct.pack("<HI", 1, 2**32 - 1) + b"x"),
    "a message without its head": _record(5, b"\0" * 5),
    "an empty attachment": _record(9, b""),
    "opcode 0": _record(0, b""),
    "nothing at all": b"",
}


@pytest.mark.parametrize("lie", LIES)
def test_lengths_that_lie(good: Path, tmp_path: Path, lie: str) -> None:
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for start in MAGIC, good.read_bytes()[:6000]:
        (tmp_path / "lie.mcap").write_bytes(start + LIES[lie])
        _read(tmp_path / "lie.mcap")
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 200_000  # kB


@pytest.mark.parametrize(
    ("data", "told"),
    [
        (b"", "the file is empty"),
        (b"scan,time_s\n", "it does not begin as an MCAP file"),
        (MAGIC, "it has no attachment sensor.toml"),
    ],
)
def test_no_recording(tmp_path: Path, data: bytes, told: str) -> None:
    (tmp_path / "a.mcap").write_bytes(data)
    with pytest.raises(ts.RecordingError, match=told):
        Recording(tmp_path / "a.mcap")


def test_no_file(tmp_path: Path) -> None:
    with pytest.raises(ts.RecordingError, match="no such file"):
        Recording(tmp_path / "a.mcap")
    with pytest.raises(ts.RecordingError, match="cannot be read"):
        Recording(tmp_path)
