"""Frames on the wire: COBS between zero bytes, CRC-16, header (docs/reference/protocol.md)."""

from __future__ import annotations

import enum
import struct
from binascii import crc_hqx
from typing import NamedTuple

VERSION = 1
HEADER = struct.Struct("<BBII")  # version, kind, sequence, device time [us]
CRC_BYTES = 2
_CRC_START = 0xFFFF  # CRC-16/IBM-3740
_BLOCK = 254  # most bytes that one length byte of COBS covers


class Kind(enum.IntEnum):
    """Kind of a frame's message; commands to the device are 0x81 and above."""

    SCAN = 0x01
    HELLO = 0x02
    REPLY = 0x03
    TESTED = 0x04
    IDENTIFY = 0x81
    START = 0x82
    STOP = 0x83
    RATE = 0x84
    TEST = 0x85


class WireFrame(NamedTuple):
    """An intact frame.

    Attributes
    ----------
    version, kind
        Version of the protocol; kind of the message.
    sequence
        The sender's count of its frames, modulo 2^32.
    time_us
        The sender's clock [us], modulo 2^32.
    body
        The encoded message.
    """

    version: int
    kind: int
    sequence: int
    time_us: int
    body: bytes


def encode_frame(kind: int, body: bytes, sequence: int = 0, time_us: int = 0) -> bytes:
    """Return a frame's bytes on the line, from zero byte to zero byte; sequence and time are taken modulo 2^32."""
    plain = HEADER.pack(VERSION, kind, sequence & 0xFFFFFFFF, time_us & 0xFFFFFFFF) + body
    plain += crc_hqx(plain, _CRC_START).to_bytes(CRC_BYTES, "big")
    return b"\0" + cobs_encode(plain) + b"\0"


def check_frame(encoded: bytes) -> bytes | None:
    """Return header and body of the bytes between two zeros; None where they are not an intact frame."""
    plain = cobs_decode(encoded)
    if plain is None or len(plain) < HEADER.size + CRC_BYTES or crc_hqx(plain, _CRC_START):
        return None
    return plain[:-CRC_BYTES]


def parse_frame(plain: bytes) -> WireFrame:
    """Return a frame from its header and body."""
    version, kind, sequence, time_us = HEADER.unpack_from(plain)
    return WireFrame(version, kind, sequence, time_us, plain[HEADER.size :])


def cobs_encode(plain: bytes) -> bytes:
    """Return bytes in COBS encoding: one more for every 254, none of them 0."""
    out = bytearray()
    *_, last = pieces = plain.split(b"\0")
    for piece in pieces:
        # Full blocks imply no zero after them; the last piece is followed by none, and may end with a full block.
        whole = (len(piece) - (piece is last and len(piece) > 0)) // _BLOCK * _BLOCK
        for at in range(0, whole, _BLOCK):
            out.append(_BLOCK + 1)
            out += piece[at : at + _BLOCK]
        out.append(len(piece) - whole + 1)
        out += piece[whole:]
    return bytes(out)


def cobs_decode(encoded: bytes) -> bytes | None:
    """Return the bytes that `cobs_encode` encoded; None where the bytes, none of them 0, are not COBS.

    A length byte becomes the zero that it stands for, in place; the lengths of full blocks stand for none and are
    removed.
    """
    out = bytearray(encoded)
    end = len(out)
    at, full = 0, []
    while at < end:
        length = out[at]
        out[at] = 0
        at += length
        if length == _BLOCK + 1:
            full.append(at)
    if at != end:
        return None
    for place in reversed(full):
        del out[place : place + 1]
    return bytes(out[1:])
