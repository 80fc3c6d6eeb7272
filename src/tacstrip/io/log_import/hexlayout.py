"""What a description says of the bytes of a frame: which are which readings."""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from tacstrip.io.log_import.hexframes import WORD, Frame
from tacstrip.io.log_import.names import meaning
from tacstrip.io.log_import.records import END_WORDS
from tacstrip.io.log_import.statements import in_blocks_said, order_said
from tacstrip.io.log_import.table import ContradictionError

_BYTE = r"(?:0[xX])?[\dA-Fa-f]{2}"
_NUMBERS = {"one": 1, "two": 2, "three": 3, "four": 4, "a": 1, "zwei": 2, "deux": 2, "ein": 1}
_WIDTH = re.compile(
    rf"\b(?:(?P<bytes>\d+|{'|'.join(_NUMBERS)})[ -]?(?:bytes?|octets?|b)\b|u?int(?P<bits>8|16|32)(?:_t)?"
    r"|[ui](?P<short>8|16|32)\b|(?P<bit>8|16|32)[ -]?bits?\b)",
    re.IGNORECASE,
)
_PLACE = re.compile(
    r"\b(?:(?:bytes?|octets?)\s+|(?:data|bytes?|payload|d|b)\[)(\d+)"
    r"(?:\s*(?:-|\u2013|\.\.+|to|and|,|/|\+|&|bis|und|et)\s*(\d+))?",
    re.IGNORECASE,
)
STRIPS = re.compile(
    r"\b(?:strips?|streifen|bandes?|taxels?|pads?)\s*#?(\d+)\s*(?:-|\u2013|\.\.+|\u2026|to|bis|through|\u00e0)\s*(?:strips?\s*)?#?(\d+)",
    re.IGNORECASE,
)
_NOT_STRIP = re.compile(
    r"count|seq|check|xor|crc|sum|sync|head|magic|status|flag|reserved|unused|pad\w*\b(?=\s*byte)|length",
    re.IGNORECASE,
)
XOR = re.compile(r"\bxor\b", re.IGNORECASE)
_SUM = re.compile(r"\b(?:crc|checksum|pr(?:\u00fc|ue)fsumme)\b", re.IGNORECASE)
CHANNELS = 2  # of a strip
SOUND = 0.8  # of the checksums
TELL = (
    "say above the frames, behind #, how bytes make readings, such as '# bytes 0-1: time in ms, bytes 2-3: V_H of "
    "strip 0 in mV, bytes 4-5: V_L of strip 0 in mV, ...; big endian; FFFF = not touched', or '# 2 bytes big "
    "endian each, H then L of strips 0 to 7, in mV'"
)


@dataclass(frozen=True)
class Part:
    """A value of a frame: where it stands, what it is ("h" and the like, "time", "strip", "scan", "check", "")."""

    start: int
    width: int
    role: str
    strip: int | None
    said: str


def _bytes_of(width: re.Match[str]) -> int:
    if width["bytes"]:
        word = width["bytes"].casefold()
        return int(word) if word.isdecimal() else _NUMBERS[word]
    return int(width["bits"] or width["short"] or width["bit"]) // 8


def says_two_bytes(said: str) -> bool:
    """Return whether a description says of something that it has two bytes."""
    return any(_bytes_of(m) == WORD for m in _WIDTH.finditer(said)) or any(
        m[2] and int(m[2]) - int(m[1]) == 1 for m in _PLACE.finditer(said)
    )


def layout_of(said: str, frames: Sequence[Frame], dump: bool) -> tuple[list[Part], bytes]:
    """Return the parts of a frame and the bytes that each begins with, by what the log says."""
    sync = b""
    if m := re.search(
        r"(?<![\w.])(?:0x)?([\dA-Fa-f]{2})[ ,]+(?:0x)?([\dA-Fa-f]{2})(?=\s*(?:[|:;,]|then|and|$))",
        said,
        re.MULTILINE,
    ):
        begin = bytes.fromhex(m[1] + m[2])
        first = [f.data.startswith(begin) for f in frames]
        sync = (
            begin if (dump and frames[0].data.startswith(begin)) or sum(first) >= SOUND * len(first) else b""
        )
    length = Counter(len(f.data) for f in frames).most_common(1)[0][0]
    places = [*_PLACE.finditer(said)]
    made = _placed(said, places) if places else _in_turn(said, sync)
    if not made:
        made = _all_alike(said, sync, length)
    readings = [p for p in made if is_channel(p.role)]
    ends = {p.role for p in readings}
    taken = [(p.start, p.start + p.width) for p in made]
    if (
        not readings
        or len(ends) > CHANNELS
        or len(readings) % len(ends)
        or any(p.width != WORD for p in readings)
        or any(b[0] < a[1] for a, b in itertools.pairwise(sorted(taken)))
        or (not dump and max(b for _, b in taken) > length)
        or (not dump and not places and max(b for _, b in taken) != length)
    ):
        raise ContradictionError(
            f"the log is of bytes in hex, and does not say which bytes are which readings: {TELL}"
        )
    return made, sync


def is_channel(role: str) -> bool:
    """Return whether a part of that role is a reading."""
    return role not in ("", "time", "strip", "scan", "check")


def _role(text: str) -> str:
    """Return what a part of a frame is, by the words that describe it."""
    if XOR.search(text) or _SUM.search(text):
        return "check"
    words = re.findall(r"[^\W\d]+(?:_[^\W\d]+)*", text)
    found = [meaning(w) for w in words]
    channels = list(dict.fromkeys(m.channel for m in found if m.role == "reading" and m.channel))
    channels = [c for c in channels if c not in END_WORDS] or channels
    if len(channels) == 1:
        return channels[0]
    if channels:
        return ""
    if re.search(r"\b(?:count|counter|seq|sequence|scan|frame|cycle)\b", text, re.IGNORECASE):
        return "scan"
    if any(m.role == "time" for m in found):
        return "time"
    return "strip" if any(m.role == "strip" for m in found) and not _NOT_STRIP.search(text) else ""


def _placed(said: str, places: Sequence[re.Match[str]]) -> list[Part]:
    """Return the parts of which the log says at which bytes they stand."""
    ends = [*(m.start() for m in places[1:]), len(said)]
    parts = []
    least = min(int(m[1]) for m in places)
    for m, end in zip(places, ends, strict=True):
        words = re.split(r"[;\n]", said[m.end() : end])[0]
        words = words if re.search(r"\w", words) else said[: m.start()].splitlines()[-1:][0]
        start, last = int(m[1]), int(m[2] or m[1])
        strip = re.search(r"\bstrips?\s*#?(\d+)", words, re.IGNORECASE)
        parts.append(
            Part(
                start,
                last - start + 1,
                _role(re.split(r",\s*both\b", words)[0]),
                int(strip[1]) if strip else None,
                words,
            )
        )
    if least > 1 or (least == 1 and not re.search(r"\bbytes? 0\b|from 0", said)):
        return [] if least == 1 else parts
    return parts


def _in_turn(said: str, sync: bytes) -> list[Part]:
    """Return the parts of a line that names them one after the other with `|`, ";" or commas, and their widths."""
    line = max(said.splitlines(), key=lambda x: len(_WIDTH.findall(x)), default="")
    mark = "|" if line.count("|") > 1 else ";" if line.count(";") > 1 else ""
    if not mark:
        return []
    parts: list[Part] = []
    at = 0
    for item in line.lstrip("#%/ ").split(mark):
        literal = re.fullmatch(r"\s*((?:(?:0x)?[\dA-Fa-f]{2}[\s,]*)+)", item)
        if literal:
            at += len(re.findall(_BYTE, literal[1]))
            continue
        several = STRIPS.search(item)
        inner = (
            [
                p
                for p in re.split(r",(?![^()]*\))|\bthen\b|\band\b", item[several.end() :])
                if is_channel(_role(p))
            ]
            if several
            else []
        )
        if several and inner:
            widths = [_bytes_of(m) for p in inner if (m := _WIDTH.search(p))]
            widths = widths * len(inner) if len(widths) == 1 and "each" in item else widths
            if len(widths) != len(inner):
                return []
            for number in range(int(several[1]), int(several[2]) + 1):
                for p, wide in zip(inner, widths, strict=True):
                    parts.append(Part(at, wide, _role(p), number, p))
                    at += wide
            continue
        width = _WIDTH.search(item)
        role = _role(item)
        many = _bytes_of(width) if width else 1 if role == "check" else 0
        if not many:
            return []
        strip = re.search(r"\bstrips?\s*#?(\d+)", item, re.IGNORECASE)
        parts.append(Part(at, many, role, int(strip[1]) if strip else None, item))
        at += many
    return parts


def _all_alike(said: str, sync: bytes, length: int) -> list[Part]:
    """Return readings of two bytes each that fill a frame, behind what each begins with, if their order is said."""
    order = order_said(said.splitlines()) or _bare_order(said)
    widths = {_bytes_of(m) for m in _WIDTH.finditer(said)} - {1, 4}
    if not order or widths != {WORD} or (length - len(sync)) % (CHANNELS * WORD):
        return []
    if re.search(r"\b(?:time|zeit|counter|xor|crc|checksum)\b", said, re.IGNORECASE):
        return []  # of which nothing says where they stand
    strips = (length - len(sync)) // (CHANNELS * WORD)
    told = STRIPS.search(said)
    first = int(told[1]) if told else 0
    if told and int(told[2]) - first + 1 != strips:
        return []
    pairs = [(s, end) for s in range(strips) for end in order]
    every = len(re.findall(r"\b(?:all|alle|tous|todos|tutti)\b", said, re.IGNORECASE))
    if every == 1 and not in_blocks_said(said.splitlines()):
        return []  # "all H then L" may be in turn or in blocks
    if every:
        pairs = [(s, end) for end in order for s in range(strips)]
    return [
        Part(len(sync) + WORD * n, WORD, end, first + s if told else s, "")
        for n, (s, end) in enumerate(pairs)
    ]


def _bare_order(said: str) -> str:
    """Return the order of "H then L", "all H ..., then all L" and the like, whatever else the line says."""
    end = r"(?:V_?)?([HLhl])(?![A-Za-z])"
    pairs = re.findall(
        rf"(?<![A-Za-z]){end}\s*(?:,|/|then|and|before)\s*{end}|\ball {end}.{{1,40}}\ball {end}", said
    )
    found = {"".join(pair).casefold() for pair in pairs}
    return found.pop() if len(found) == 1 and found & {"hl", "lh"} else ""
