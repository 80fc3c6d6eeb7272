"""The decoder among garbage: what is intact is found, what is not is counted, whatever the bytes are."""

from __future__ import annotations

import tracemalloc
from binascii import crc_hqx
from collections.abc import Callable, Iterable, Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tacstrip.stream.device.protocol.decoder import MAX_FRAME_BYTES, Counts, Decoder, Received
from tacstrip.stream.device.protocol.frames import (
    HEADER,
    VERSION,
    Kind,
    check_frame,
    cobs_encode,
    encode_frame,
)
from tacstrip.stream.device.protocol.messages import Command, Hello, Reply, SelfTest
from tacstrip.stream.device.protocol.order import MAX_AHEAD, MAX_BEHIND, MAX_HELD
from tacstrip.stream.device.protocol.scans import MAX_STRIPS, ScanBatch, encode_scan
from tacstrip.stream.source import RawScan

HELLO = Hello(construction="crs-crs", strips=10, signatures=("kh", "kl"), adc_bits=10)


def frame(number: int, time_us: int | None = None, strips: int = 10) -> bytes:
    """A scan whose codes follow from its number."""
    codes = {"kh": np.full(strips, number % 1024, "<u2"), "kl": np.full(strips, number // 7 % 1024, "<u2")}
    time_s = (number * 2500 if time_us is None else time_us) / 1e6
    return encode_scan(RawScan(time_s, codes, np.arange(strips) % 3 == 0, number), 10)


def numbers(received: list[Received]) -> list[int]:
    return [int(n) for batch in received if isinstance(batch, ScanBatch) for n in batch.sequence]


def test_batches_are_as_the_scans_one_by_one() -> None:
    sent = [frame(i, strips=9 if 40 < i < 60 else 100) for i in range(100)]
    together = Decoder().feed(b"".join(sent))
    assert [len(b) for b in together if isinstance(b, ScanBatch)] == [41, 19, 40]
    decoder = Decoder()
    single = [b for piece in sent for b in decoder.feed(piece)]
    for a, b in zip(_scans(together), _scans(single), strict=True):
        assert (a.sequence, a.time_s, a.touched.tolist()) == (b.sequence, b.time_s, b.touched.tolist())
        assert {k: v.tolist() for k, v in a.codes.items()} == {k: v.tolist() for k, v in b.codes.items()}


def _scans(received: list[Received]) -> Iterator[RawScan]:
    for batch in received:
        assert isinstance(batch, ScanBatch)
        yield from batch.scans()


def test_messages_keep_their_place_among_scans() -> None:
    reply = Reply(Kind.START, 7, 0, 2500)
    out = Decoder().feed(frame(0) + frame(1) + reply.encode(2) + frame(2) + HELLO.encode(3))
    assert [type(x) for x in out] == [ScanBatch, Reply, ScanBatch, Hello]
    assert out[1] == reply
    assert out[3] == HELLO


@pytest.mark.parametrize("size", [1, 2, 7, 64, 65, 66, 1000])
def test_bytes_may_come_in_any_pieces(size: int) -> None:
    data = b"".join(frame(i) for i in range(30))
    decoder = Decoder()
    found = [n for at in range(0, len(data), size) for n in numbers(decoder.feed(data[at : at + size]))]
    assert found == list(range(30))
    assert decoder.counts == Counts(frames=30)


def test_a_stream_that_is_joined_in_the_middle_counts_nothing_as_corrupt() -> None:
    decoder = Decoder()
    assert numbers(decoder.feed(frame(5)[30:] + frame(6) + frame(7))) == [6, 7]
    assert decoder.counts == Counts(frames=2)


def test_gaps_are_lost_scans_and_a_damaged_frame_is_one_too() -> None:
    decoder = Decoder()
    bad = bytearray(frame(1))
    bad[20] ^= 0x40
    assert numbers(decoder.feed(frame(0) + bytes(bad) + frame(2) + frame(6))) == [0]
    assert numbers(decoder.feed(b"")) == [2, 6]  # the missing one might have come late
    assert decoder.counts == Counts(frames=3, corrupt=1, lost=1 + 3)


def test_scans_that_came_before_or_too_late_are_left_out() -> None:
    decoder = Decoder()
    assert numbers(decoder.feed(frame(4) + frame(5) + frame(5) + frame(3) + frame(6))) == [4, 5, 6]
    assert decoder.counts == Counts(frames=3, out_of_order=1, duplicates=1)
    assert numbers(decoder.feed(b"".join(frame(i) for i in (*range(8, 9 + MAX_HELD), 7)))) == list(
        range(8, 9 + MAX_HELD)
    )
    assert decoder.counts.out_of_order == 2
    assert decoder.counts.lost == 1


@pytest.mark.parametrize(
    "order",
    [(0, 2, 1, 3), (0, 3, 2, 1, 4), (0, 4, 1, 2, 5, 3, 6), (0, 1, 3, 3, 2, 2, 4), (0, 16, *range(1, 16), 17)],
)
def test_scans_that_come_late_are_put_in_their_place(order: tuple[int, ...]) -> None:
    decoder = Decoder()
    assert numbers(decoder.feed(b"".join(map(frame, order)))) == sorted(set(order))
    assert decoder.counts.lost == decoder.counts.restarts == decoder.counts.misnumbered == 0
    assert decoder.counts.out_of_order > 0


@pytest.mark.parametrize("wrong", [lambda i: 7, lambda i: 2000 - i, lambda i: i * 2654435761 % 2**32,
                                   lambda i: i * 40_503 % 2**16, lambda i: i % 3])  # fmt: skip
def test_scans_with_wrong_numbers_are_kept_as_they_came(wrong: Callable[[int], int]) -> None:
    decoder = Decoder()
    sent = b"".join(frame(wrong(i), 2500 * i) for i in range(500))
    got = [b for piece in (sent, b"") for b in decoder.feed(piece) if isinstance(b, ScanBatch)]
    assert np.concatenate([b.time_us for b in got]).tolist() == [2500 * i for i in range(500)]
    assert decoder.counts.misnumbered > 100
    assert decoder.counts.restarts <= 1
    assert decoder.counts.duplicates == 0


def test_codes_that_the_converter_cannot_give_leave_their_scan_out() -> None:
    decoder = Decoder()
    bad = RawScan(0.0025, {"kh": np.full(10, 1024, "<u2"), "kl": np.zeros(10, "<u2")}, np.ones(10, bool), 1)
    plain = check_frame(encode_scan(bad, 11)[1:-1])  # eleven bits; below it says ten
    assert plain is not None
    sent = encode_frame(Kind.SCAN, plain[10:13] + b"\x0a" + plain[14:], 1, 2500)
    assert numbers(decoder.feed(frame(0) + sent + frame(2))) == [0, 2]
    assert decoder.counts == Counts(frames=3, out_of_range=1)


def test_numbers_and_clock_go_on_where_32_bits_begin_anew() -> None:
    decoder = Decoder()
    steps = range(-3, 3)
    received = decoder.feed(
        b"".join(frame(2**32 + i if i < 0 else i, (2**32 + 2500 * i) % 2**32) for i in steps)
    )
    (batch,) = received
    assert isinstance(batch, ScanBatch)
    assert batch.time_us.tolist() == [2**32 + 2500 * i for i in steps]
    (later,) = decoder.feed(frame(3, 7500))
    assert isinstance(later, ScanBatch)
    assert later.time_us.tolist() == [2**32 + 7500]
    assert decoder.counts == Counts(frames=7)


@pytest.mark.parametrize("number", [1000 + MAX_AHEAD + 1, 1000 - MAX_BEHIND])
def test_a_number_far_away_is_a_device_that_started_again(number: int) -> None:
    decoder = Decoder()
    before, after = decoder.feed(frame(1000, 4_000_000_000) + frame(number % 2**32, 5000))
    assert isinstance(before, ScanBatch)
    assert isinstance(after, ScanBatch)
    assert (before.restarts, after.restarts) == (0, 1)
    assert after.time_us.tolist() == [5000]
    assert decoder.counts == Counts(frames=2, restarts=1)


def test_the_hello_of_a_reset_begins_the_count_anew() -> None:
    decoder = Decoder()
    decoder.feed(HELLO.encode(0) + frame(0) + frame(1) + frame(2))
    again = HELLO.encode(0) + frame(0, 9_000_000) + frame(1, 9_002_500)
    assert numbers(decoder.feed(again)) == [0, 1]
    assert decoder.counts == Counts(frames=7, restarts=1)


def test_a_hello_that_says_reset_where_scans_go_on_is_none() -> None:
    decoder = Decoder()
    decoder.feed(HELLO.encode(0) + frame(0) + frame(1) + HELLO.encode(0) + frame(2))
    assert decoder.counts == Counts(frames=5)


def test_scans_missing_after_a_hello_are_lost() -> None:
    decoder = Decoder()
    decoder.feed(HELLO.encode(10) + frame(13))
    decoder.feed(b"")
    assert decoder.counts == Counts(frames=2, lost=3)
    decoder.feed(HELLO.encode(20) + frame(14))
    assert decoder.counts == Counts(frames=4, lost=3)


def _other_version() -> bytes:
    plain = HEADER.pack(VERSION + 1, Kind.SCAN, 0, 0)
    return b"\0" + cobs_encode(plain + crc_hqx(plain, 0xFFFF).to_bytes(2, "big")) + b"\0"


SCAN_HEAD = bytes.fromhex("0300 04 0a 00000000 07")  # 3 strips, k, 10 bits


@pytest.mark.parametrize(
    "odd",
    [
        _other_version(),
        encode_frame(0x55, b""),
        encode_frame(Kind.HELLO, b"too short"),
        encode_frame(Kind.SCAN, b""),
        encode_frame(Kind.SCAN, SCAN_HEAD + bytes(5)),
        encode_frame(Kind.SCAN, SCAN_HEAD + bytes(7)),
        encode_frame(Kind.SCAN, b"\0\0" + SCAN_HEAD[2:]),
        encode_frame(Kind.SCAN, b"\3\0\0" + SCAN_HEAD[3:]),
        encode_frame(Kind.SCAN, b"\3\0\x08" + SCAN_HEAD[3:] + bytes(6)),
        encode_frame(Kind.SCAN, b"\3\0\4\0" + SCAN_HEAD[4:] + bytes(6)),
        encode_frame(Kind.SCAN, b"\3\0\4\x11" + SCAN_HEAD[4:] + bytes(6)),
    ],
)
def test_intact_frames_that_say_nothing_we_know_are_counted_apart(odd: bytes) -> None:
    decoder = Decoder()
    assert numbers(decoder.feed(frame(0) + odd + frame(1))) == [0, 1]
    assert decoder.counts == Counts(frames=2, unknown=1)


def test_the_good_neighbour_of_those_is_taken() -> None:
    batch = Decoder().feed(encode_frame(Kind.SCAN, SCAN_HEAD + bytes(6)))
    assert numbers(batch) == [0]


def test_memory_is_bounded_and_the_next_frame_found() -> None:
    decoder = Decoder()
    decoder.feed(frame(0))
    tracemalloc.start()
    for _ in range(200):
        assert decoder.feed(b"\x11" * 10_000) == []
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 4 * MAX_FRAME_BYTES
    assert numbers(decoder.feed(frame(1))) == [1]
    assert decoder.counts == Counts(frames=2, corrupt=1)


def test_the_longest_scan_goes_through() -> None:
    codes = {name: np.full(MAX_STRIPS, 0xFFFF, "<u2") for name in ("kh", "kl", "k")}
    data = encode_scan(RawScan(0.0, codes, np.ones(MAX_STRIPS, bool)), 16)
    assert len(data) < MAX_FRAME_BYTES
    decoder = Decoder()
    assert [n for at in range(0, len(data), 100) for n in numbers(decoder.feed(data[at : at + 100]))] == [0]


MESSAGES = [
    HELLO.encode(),
    Reply(Kind.RATE, 1, 0, 2500).encode(),
    SelfTest(5000, 0, {"kh": np.zeros(10, bool)}).encode(),
    Command(Kind.RATE, 1, 2500).encode(),
]


def mutated(piece: bytes, random: np.random.Generator) -> bytes:
    """Change, drop, double or insert bytes of a frame; never return it whole."""
    data = bytearray(piece)
    for _ in range(random.integers(1, 5)):
        at = int(random.integers(0, len(data)))
        match random.integers(0, 4):
            case 0:
                data[at] ^= int(random.integers(1, 256))
            case 1:
                del data[at : at + int(random.integers(1, 20))]
            case 2:
                data[at:at] = random.bytes(int(random.integers(1, 20)))
            case _:
                data[at:at] = data[: int(random.integers(1, 20))]
        if not data:
            break
    return bytes(data) if piece.strip(b"\0") not in bytes(data) else b""


def battered(size: int, seed: int) -> tuple[bytes, list[int]]:
    """Random and mutated bytes with intact frames between, and the numbers of the intact ones."""
    random = np.random.default_rng(seed)
    parts: list[bytes] = []
    intact: list[int] = []
    length = number = 0
    while length < size:
        match random.integers(0, 4):
            case 0:
                part = random.bytes(int(random.integers(1, 400)))
            case 1:
                part = mutated(frame(number), random)
            case 2:
                part = mutated(MESSAGES[int(random.integers(0, len(MESSAGES)))], random)
            case _:
                part = frame(number)
                intact.append(number)
                number += 1
        parts.append(part)
        length += len(part)
    return b"".join(parts), intact


def survive(size: int, seed: int) -> None:
    """Feed battered bytes in random pieces: every intact frame is found, and nearly nothing else."""
    data, intact = battered(size, seed)
    random = np.random.default_rng(seed + 1)
    decoder, found, at = Decoder(), [], 0
    while at < len(data):
        step = int(random.integers(1, 3000))
        found += numbers(decoder.feed(data[at : at + step]))
        at += step
    assert found == intact
    assert decoder.counts.corrupt > len(intact) / 3


def test_a_million_random_and_mutated_bytes() -> None:
    survive(1_000_000, 1)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(10, 20))
def test_ten_million_random_and_mutated_bytes(seed: int) -> None:
    survive(1_000_000, seed)


@settings(derandomize=True, deadline=None, max_examples=80)
@given(st.lists(st.one_of(st.binary(max_size=80), st.sampled_from([b"\0", *MESSAGES])), max_size=8))
def test_any_bytes_are_taken(pieces: list[bytes]) -> None:
    decoder = Decoder()
    for piece in pieces:
        decoder.feed(piece)
    assert numbers(decoder.feed(frame(9)) + decoder.feed(b"")) == [9]


def anew(numbers: Iterable[int]) -> bytes:
    """Scans of a device that has restarted: numbers and clock began again."""
    return b"".join(frame(i, i * 2500 + 1234) for i in numbers)


@pytest.mark.parametrize("before", [2, 5, 186, MAX_BEHIND])
@pytest.mark.parametrize("pieces", [1, 10_000])
def test_an_old_number_at_another_time_is_a_device_that_started_again(before: int, pieces: int) -> None:
    """Its hello was lost: none of its scans is."""
    decoder = Decoder()
    data = b"".join(frame(i, i * 2500 + 5_000_000) for i in range(before)) + anew(range(300))
    size = len(data) // pieces or 1
    found = [m for at in range(0, len(data), size) for m in decoder.feed(data[at : at + size])]
    assert numbers(found) == [*range(before), *range(300)]
    assert {b.restarts for b in found if isinstance(b, ScanBatch)} == {0, 1}
    assert decoder.counts == Counts(frames=before + 300, restarts=1)


def test_scans_lost_after_an_unheard_restart_are_counted() -> None:
    decoder = Decoder()
    data = b"".join(map(frame, range(50))) + anew((4, 7, 8))
    found = decoder.feed(data) + decoder.feed(b"")
    assert numbers(found) == [*range(50), 4, 7, 8]
    assert decoder.counts == Counts(frames=53, lost=2, restarts=1)


def test_scans_that_come_twice_are_no_restart() -> None:
    decoder = Decoder()
    assert numbers(decoder.feed(b"".join(map(frame, (0, 1, 1, 2, 3, 2, 3, 1, 2, 3, 4))))) == [0, 1, 2, 3, 4]
    assert decoder.counts == Counts(frames=5, duplicates=6)
