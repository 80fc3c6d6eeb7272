"""Frames and messages: the test vectors of docs/reference/protocol.md, and there and back."""

from __future__ import annotations

import json
import re
from binascii import crc_hqx
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tacstrip.arrays import FloatArray
from tacstrip.errors import OptionError
from tacstrip.stream.device.protocol.decoder import Decoder, Received
from tacstrip.stream.device.protocol.frames import (
    Kind,
    WireFrame,
    check_frame,
    cobs_decode,
    cobs_encode,
    encode_frame,
    parse_frame,
)
from tacstrip.stream.device.protocol.messages import Command, Hello, Reply, SelfTest, Status, parse_message
from tacstrip.stream.device.protocol.scans import MAX_STRIPS, ScanBatch, encode_scan
from tacstrip.stream.source import RawScan

_REFERENCE = Path(__file__).parents[2] / "docs" / "reference"
PAGE = "".join((_REFERENCE / f"{n}.md").read_text(encoding="utf-8") for n in ("protocol", "protocol-vectors"))
VECTORS: list[dict[str, Any]] = [json.loads(t) for t in re.findall(r"```json\n(.*?)```", PAGE, re.DOTALL)]
NAMES = [f"{v['what']} {i}" for i, v in enumerate(VECTORS)]
FIXED = settings(derandomize=True, deadline=None, max_examples=40)


def raw_scan(vector: dict[str, Any]) -> RawScan:
    return RawScan(
        vector["time_us"] / 1e6,
        {name: np.array(codes, "<u2") for name, codes in vector["codes"].items()},
        np.array(vector["touched"]),
        vector["sequence"],
        np.linspace(0.0, vector["span_us"] / 1e6, vector["strips"]),
    )


def offsets(scan: RawScan) -> FloatArray:
    assert scan.strip_time_s is not None
    return scan.strip_time_s


def encoded(vector: dict[str, Any]) -> bytes:
    """Return the frame that our encoder makes of a vector's fields."""
    fields: dict[str, Any] = {k: v for k, v in vector.items() if k not in ("what", "hex")}
    for name in ("signatures", "version"):
        if name in fields:
            fields[name] = tuple(fields[name])
    match vector["what"]:
        case "scan":
            return encode_scan(raw_scan(vector), vector["adc_bits"])
        case "command":
            return Command(**fields).encode()
        case "tested":
            fields["held"] = {name: np.array(v) for name, v in fields["held"].items()}
    sequence, time_us = fields.pop("sequence"), fields.pop("time_us")
    kinds: dict[str, type[Hello | Reply | SelfTest]] = {"hello": Hello, "reply": Reply, "tested": SelfTest}
    return kinds[vector["what"]](**fields).encode(sequence, time_us)


def only(data: bytes) -> Received:
    (message,) = Decoder().feed(data)
    return message


@pytest.mark.parametrize("vector", VECTORS, ids=NAMES)
def test_the_pages_fields_make_the_pages_bytes(vector: dict[str, Any]) -> None:
    assert encoded(vector).hex(" ") == vector["hex"]


@pytest.mark.parametrize("vector", VECTORS, ids=NAMES)
def test_the_pages_bytes_say_the_pages_fields(vector: dict[str, Any]) -> None:
    message = only(bytes.fromhex(vector["hex"]))
    if isinstance(message, ScanBatch):
        (scan,) = message.scans()
        assert message.adc_bits == vector["adc_bits"]
        assert message.time_us.tolist() == [vector["time_us"]]
        assert scan.time_s == vector["time_us"] / 1e6
        assert scan.sequence == vector["sequence"]
        assert scan.touched.tolist() == vector["touched"]
        assert {name: codes.tolist() for name, codes in scan.codes.items()} == vector["codes"]
        assert np.allclose(offsets(scan), offsets(raw_scan(vector)), rtol=0, atol=1e-12)
    elif isinstance(message, SelfTest):
        assert {name: v.tolist() for name, v in message.held.items()} == vector["held"]
        assert (message.supply_mv, message.late) == (vector["supply_mv"], vector["late"])
    else:
        for name, value in vector.items():
            if hasattr(message, name) and name not in ("time_us",):
                assert getattr(message, name) == (tuple(value) if isinstance(value, list) else value), name


def test_the_pages_bytes_lie_where_its_tables_say() -> None:
    """Written from the tables alone, without our encoder: the first vector before COBS."""
    (text,) = re.findall(r"before COBS.*?```\n(.*?)\n```", PAGE, re.DOTALL)
    plain = bytes.fromhex(text.replace("|", ""))
    assert cobs_decode(bytes.fromhex(VECTORS[0]["hex"])[1:-1]) == plain
    assert plain[:2] == b"\x01\x01"

    def number(at: int, count: int) -> int:
        return int.from_bytes(plain[at : at + count], "little")

    want = VECTORS[0]
    assert (number(2, 4), number(6, 4)) == (want["sequence"], want["time_us"])
    assert (number(10, 2), number(12, 1), number(13, 1), number(14, 4)) == (3, 3, 10, want["span_us"])
    assert number(18, 1) == 0b101
    assert [number(19 + 2 * i, 2) for i in range(6)] == want["codes"]["kh"] + want["codes"]["kl"]
    assert len(plain) == 19 + 12 + 2
    assert crc_hqx(plain, 0xFFFF) == 0


def test_the_page_gives_the_crcs_check_value() -> None:
    assert f"{crc_hqx(b'123456789', 0xFFFF):04X}" == "29B1"
    assert '"123456789" gives 29 B1' in PAGE


def test_the_page_lists_every_kind_and_status() -> None:
    for kind in Kind:
        lines = (f"### {kind:02x} {kind.name.lower()}", f"| {kind:02x} | {kind.name} |")
        assert any(line in PAGE for line in lines), kind
    assert len(Status) == 4


def slow_stuffed(plain: bytes) -> bytes:
    """COBS as its inventors describe it: byte by byte."""
    out, block = bytearray(), bytearray()
    for i, byte in enumerate(plain):
        if byte:
            block.append(byte)
        if not byte or (len(block) == 254 and i + 1 < len(plain)):
            out += bytes([len(block) + 1]) + block
            block.clear()
    return bytes(out + bytes([len(block) + 1]) + block)


lengths = st.one_of(st.integers(0, 20), st.integers(250, 260), st.integers(505, 512))


@FIXED
@given(lengths, st.sampled_from([1, 2, 50, 1000]), st.integers(0, 2**32 - 1))
def test_stuffing_and_back(length: int, rarity: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    plain = random.integers(1, 256, length, np.uint8)
    plain[random.integers(0, rarity, length) == rarity - 1] = 0
    stuff = cobs_encode(plain.tobytes())
    assert stuff == slow_stuffed(plain.tobytes())
    assert 0 not in stuff
    assert cobs_decode(stuff) == plain.tobytes()


@pytest.mark.parametrize("stuff", [b"\x05\x01", b"\xff\x01\x02", b"\x02"])
def test_what_is_no_stuffing_is_told(stuff: bytes) -> None:
    assert cobs_decode(stuff) is None
    assert check_frame(stuff) is None


@st.composite
def scans(draw: st.DrawFn) -> tuple[RawScan, int]:
    strips = draw(st.sampled_from([1, 2, 8, 9, 10, 100, 200]))
    bits = draw(st.integers(1, 16))
    names = draw(st.sampled_from([("kh",), ("kl",), ("k",), ("kh", "kl")]))
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    codes = {name: random.integers(0, 2**bits, strips).astype("<u2") for name in names}
    span = draw(st.integers(0, 2**32 - 1)) * 1e-6 if strips > 1 else 0.0
    time_us = draw(st.integers(0, 2**32 - 1))
    times = np.linspace(0.0, span, strips)
    number = draw(st.integers(0, 2**32 - 1))
    return RawScan(time_us * 1e-6, codes, random.random(strips) < 0.5, number, times), bits


@FIXED
@given(scans())
def test_scans_there_and_back(made: tuple[RawScan, int]) -> None:
    sent, bits = made
    batch = only(encode_scan(sent, bits))
    assert isinstance(batch, ScanBatch)
    assert batch.adc_bits == bits
    (got,) = batch.scans()
    assert got.sequence == sent.sequence
    assert got.time_s == pytest.approx(sent.time_s, abs=1e-9)
    assert np.array_equal(got.touched, sent.touched)
    assert {k: v.tolist() for k, v in got.codes.items()} == {k: v.tolist() for k, v in sent.codes.items()}
    assert np.allclose(offsets(got), offsets(sent), rtol=0, atol=1e-6)


def test_the_time_is_the_first_strips() -> None:
    codes = {"k": np.zeros(3, "<u2")}
    batch = only(encode_scan(RawScan(1.0, codes, np.ones(3, bool), 0, np.array([1e-3, 2e-3, 3e-3])), 10))
    assert isinstance(batch, ScanBatch)
    assert (batch.time_us.tolist(), batch.span_us.tolist()) == ([1_001_000], [2000])


def _scan(strips: int = 3, code: int = 5, name: str = "k") -> RawScan:
    return RawScan(0.0, {name: np.full(strips, code, "<u2")}, np.ones(strips, bool))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: encode_scan(_scan(code=1024), 10), "enough for the code 1024"),
        (lambda: encode_scan(_scan(), 17), "adc_bits = 17: must be 1 to 16"),
        (lambda: encode_scan(_scan(MAX_STRIPS + 1), 10), "has 1 to 4096"),
        (lambda: encode_scan(_scan(name="electrodes"), 10), "'electrodes' does not go over the wire"),
        (lambda: Command(Kind.HELLO).encode(), "is no command; commands are 0x81 to 0x85"),
        (lambda: Command(Kind.RATE).encode(), "period_us belongs to the command RATE"),
        (lambda: Command(Kind.START, period_us=1).encode(), "period_us belongs to the command RATE"),
        (lambda: Command(Kind.RATE, period_us=-1).encode(), "must be 0 to 60000000"),
        (lambda: Reply(0x82, 0, 0, -1).encode(), "does not fit its field of a reply frame"),
        (lambda: SelfTest(-1, 0, {"k": np.ones(1, bool)}).encode(), "does not fit its field of a test frame"),
        (lambda: Hello(construction="x" * 17, strips=1, signatures=("k",), adc_bits=10).encode(), "construction = "),
        (lambda: Hello(construction="é", strips=1, signatures=("k",), adc_bits=10).encode(), "printable ASCII"),
        (lambda: Hello(construction="x", strips=-1, signatures=("k",), adc_bits=10).encode(), "a hello frame"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused(make: Any, message: str) -> None:
    with pytest.raises(OptionError, match=message):
        make()


@pytest.mark.parametrize("kind", [Kind.HELLO, Kind.REPLY, Kind.TESTED, *range(0x81, 0x86)])
def test_bodies_of_another_length_say_nothing(kind: int) -> None:
    for length in (1, 3, 5, 9, 57, 59):
        assert parse_message(WireFrame(1, kind, 0, 0, b"\x07" * length)) is None


def test_header_fields_wrap() -> None:
    stuff = encode_frame(Kind.START, b"", 2**32 + 5, 2**32 + 6)[1:-1]
    plain = check_frame(stuff)
    assert plain is not None
    assert parse_frame(plain)[:4] == (1, Kind.START, 5, 6)
