"""Damaged recordings: what lies behind the damage is found again, whatever was hit."""

from __future__ import annotations

import struct
import time
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.records import ChunkIndex

import tacstrip as ts
from recordings import make, sensor
from tacstrip.stream.recording.records import MAGIC, Records
from tacstrip.stream.recording.recover import Recovered, recover
from tacstrip.stream.replay import Recording

SCANS = 300


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("damage") / "good.mcap"
    make(path, sensor(strips=20), SCANS, None)
    return path


def _chunks(path: Path) -> list[ChunkIndex]:
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    return summary.chunk_indexes


def _saved(data: bytes, folder: Path) -> tuple[Recovered, list[int]]:
    (folder / "bad.mcap").write_bytes(data)
    saved = recover(folder / "bad.mcap", folder / "new.mcap", force=True)
    return saved, [raw.sequence for raw in Recording(folder / "new.mcap")]


def _hit(data: bytes, at: int, length: int = 50) -> bytes:
    return data[:at] + bytes(b ^ 0xFF for b in data[at : at + length]) + data[at + length :]


def test_fifty_bytes_anywhere_lose_two_chunks_at_most(good: Path, tmp_path: Path) -> None:
    data, chunks = good.read_bytes(), _chunks(good)
    scans = [c.message_index_length // 16 for c in chunks]  # 16 bytes a message and a few more
    for at in range(chunks[1].chunk_start_offset, len(data) - 100, 611):
        saved, numbers = _saved(_hit(data, at), tmp_path)
        assert len(numbers) >= SCANS - 2 * max(scans)
        assert saved.condition.damage or len(numbers) == SCANS  # an index is not needed
        assert saved.condition.whole
        assert numbers == sorted(set(numbers))
        if saved.lost and saved.held is not None:
            assert saved.lost[0] == f"{SCANS - len(numbers)} of {SCANS} messages"


def test_bytes_gone_and_bytes_put_in(good: Path, tmp_path: Path) -> None:
    data, chunks = good.read_bytes(), _chunks(good)
    for chunk in chunks[3:6]:
        at = chunk.chunk_start_offset
        for bad in (
            data[: at + 3] + data[at + 40 :],
            data[:at] + bytes(5000) + data[at:],
            data[: at + 9] + data[at:],
        ):
            saved, numbers = _saved(bad, tmp_path)
            assert len(numbers) > SCANS - 40
            assert max(numbers) == SCANS - 1
            assert len(saved.condition.damage) == 1


def test_a_length_that_swallows_the_next_chunk(good: Path, tmp_path: Path) -> None:
    data, chunks = bytearray(good.read_bytes()), _chunks(good)
    at = chunks[3].chunk_start_offset
    data[at + 1 : at + 9] = struct.pack("<Q", chunks[3].chunk_length - 9 + 1000)
    _, numbers = _saved(bytes(data), tmp_path)
    assert len(numbers) == SCANS  # the chunk says itself how long it is


def test_an_opcode_alone(good: Path, tmp_path: Path) -> None:
    for opcode in (0, 7, 14, 0x90):
        data = bytearray(good.read_bytes())
        data[_chunks(good)[3].chunk_start_offset] = opcode
        saved, numbers = _saved(bytes(data), tmp_path)
        assert len(numbers) == SCANS or saved.condition.damage


def test_damaged_and_cut(good: Path, tmp_path: Path) -> None:
    data, chunks = good.read_bytes(), _chunks(good)
    at = chunks[2].chunk_start_offset
    saved, numbers = _saved(_hit(data, at)[: chunks[-1].chunk_start_offset + 100], tmp_path)
    assert max(numbers) > SCANS - 60
    assert not saved.condition.whole
    assert saved.held is None
    assert [saved.lost[0], len(saved.lost)] == [
        "an unknown number of messages, as their index is lost too",
        3,
    ]
    assert saved.lost[2].startswith("what was cut off the end, and of the ")
    assert "bytes that are left the last 100" in saved.lost[2]


def test_a_damaged_recording_is_an_error_where_it_is_read(good: Path, tmp_path: Path) -> None:
    at = _chunks(good)[4].chunk_start_offset
    (tmp_path / "bad.mcap").write_bytes(_hit(good.read_bytes(), at))
    with pytest.raises(
        ts.RecordingError, match=r"\d+ bytes from byte \d+ on are damaged; `tacstrip recover`"
    ):
        list(Recording(tmp_path / "bad.mcap"))


@pytest.mark.parametrize("kind", ["zeros", "noise", "heads", "nested"])
def test_a_file_of_rubbish_is_read_in_linear_time(tmp_path: Path, kind: str) -> None:
    size = 2**23
    head = struct.pack(
        "<BQQQQIIQ", 6, 2**20 + 40, 0, 0, 10, 0, 0, 2**20
    )  # a chunk of 1 MB, begun every 49 bytes
    rubbish = {
        "zeros": lambda: bytes(size),
        "noise": lambda: np.random.default_rng(1).bytes(size),
        "heads": lambda: b"\x06\x10\0\0\0\0\0\0\0" * (size // 9),
        "nested": lambda: head * (size // len(head)),
    }[kind]()
    (tmp_path / "a.mcap").write_bytes(MAGIC + rubbish)
    start = time.process_time()
    records = Records(tmp_path / "a.mcap")
    assert not list(records)
    assert time.process_time() - start < 10.0
    assert not records.condition.whole
