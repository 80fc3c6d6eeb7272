"""Hex dumps of frames: bytes that make readings as a description in the log says, and never as single bytes."""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from tacstrip.io.log_import.fields import STAMP
from tacstrip.io.log_import.names import meaning
from tacstrip.io.log_import.statements import in_blocks_said, order_said
from tacstrip.io.log_import.strays import numbered
from tacstrip.io.log_import.table import ContradictionError, Table

Order = Literal["big", "little"]
_BYTE = r"(?:0[xX])?[\dA-Fa-f]{2}"
_RUN = re.compile(
    rf"(?<![\w.:#]){_BYTE}(?:(?:\s*,\s*|\s+){_BYTE})*[\s,;\])}}]*\Z|(?<![\w.:])(?:[\dA-Fa-f]{{2}}){{6,}}\s*\Z"
)
_DUMPED = re.compile(
    r"(?P<at>[\dA-Fa-f]{2,8}):?(?P<bytes>(?:\s+(?:[\dA-Fa-f]{2}|[\dA-Fa-f]{4}))+)(?:\s{2,}.*)?\s*\Z"
)
_CAN = re.compile(
    r"(?P<head>.*?)\b(?P<id>[\dA-Fa-f]{3,8})(?:\s+\[(?P<n>\d+)\]\s*(?P<apart>[\dA-Fa-f\s]*)|#(?P<solid>[\dA-Fa-f]*))(?:\s+'.*')?\s*\Z"
)
_TIME = re.compile(rf"(?P<clock>{STAMP})|(?<![\w.])(?P<count>\d+(?:\.\d+)?)(?:\s?(?P<unit>ms|us|s)\b)?")
_BIG = re.compile(
    r"big[ -]?endian|(?:high|upper|most significant|ms)[ -]?byte (?:first|before)|\bmsb(?: first)?\b"
    r"|network (?:byte )?order|h(?:\u00f6|oe)herwertig\w* byte zuerst|poids fort (?:d'abord|en premier)"
    r"|\bu?int16[ _]?be\b",
    re.IGNORECASE,
)
_LITTLE = re.compile(
    r"little[ -]?endian|(?:low|lower|least significant|ls)[ -]?byte (?:first|before)|\blsb(?: first)?\b"
    r"|niederwertig\w* byte zuerst|poids faible (?:d'abord|en premier)|\bu?int16[ _]?le\b",
    re.IGNORECASE,
)
_NUMBERS = {"one": 1, "two": 2, "three": 3, "four": 4, "a": 1, "zwei": 2, "deux": 2, "ein": 1}
_WIDTH = re.compile(
    rf"\b(?:(?P<bytes>\d+|{'|'.join(_NUMBERS)})[ -]?(?:bytes?|octets?|b)\b|u?int(?P<bits>8|16|32)(?:_t)?"
    r"|[ui](?P<short>8|16|32)\b|(?P<bit>8|16|32)[ -]?bits?\b)",
    re.IGNORECASE,
)
_PLACE = re.compile(
    r"\b(?:bytes?|octets?)\s+(\d+)(?:\s*(?:-|\u2013|\.\.+|to|and|,|/|\+|&|bis|und|et)\s*(\d+))?",
    re.IGNORECASE,
)
_STRIPS = re.compile(
    r"\b(?:strips?|streifen|bandes?|taxels?|pads?)\s*#?(\d+)\s*(?:-|\u2013|\.\.+|\u2026|to|bis|through|\u00e0)\s*(?:strips?\s*)?#?(\d+)",
    re.IGNORECASE,
)
_BASED = re.compile(
    r"\b(?:0x([\dA-Fa-f]{2,8})|([\dA-Fa-f]{3,8}))\s*\+\s*(?:the )?(?:strip|streifen|taxel|pad|index|number|[nisk]\b)",
    re.IGNORECASE,
)
_SIGN = re.compile(
    r"(?<![\w])(?:0x)?((?:[\dA-Fa-f]{2}\s?){2,4})(?=\s*(?:=|:|->|means|is|stands|if|where|when|bedeutet)\s)",
    re.IGNORECASE,
)
_NOT_STRIP = re.compile(
    r"count|seq|check|xor|crc|sum|sync|head|magic|status|flag|reserved|unused|pad\w*\b(?=\s*byte)|length",
    re.IGNORECASE,
)
_XOR = re.compile(r"\bxor\b", re.IGNORECASE)
_SUM = re.compile(r"\b(?:crc|checksum|pr(?:\u00fc|ue)fsumme)\b", re.IGNORECASE)
_FEW = 3  # frames
_MOST = 0.6  # of the lines
_WORD, _READING = 2, 2  # bytes
_MOST_BELOW = 0.2  # of the pairs: no sensor reads so
_SOUND = 0.8  # of the checksums
_TELL = (
    "say above the frames, behind #, how bytes make readings, such as '# bytes 0-1: time in ms, bytes 2-3: V_H of "
    "strip 0 in mV, bytes 4-5: V_L of strip 0 in mV, ...; big endian; FFFF = not touched', or '# 2 bytes big "
    "endian each, H then L of strips 0 to 7, in mV'"
)


@dataclass(frozen=True)
class _Frame:
    """Bytes of a frame, the line where it begins, who sent it ("" where no line says) and what stands before it."""

    line: int
    data: bytes
    sender: str
    head: str


@dataclass(frozen=True)
class _Part:
    """A value of a frame: where it stands, what it is ("h" and the like, "time", "strip", "scan", "check", "")."""

    start: int
    width: int
    role: str
    strip: int | None
    said: str


def of_hex_bytes(text: str) -> Table | None:
    """Return frames of bytes in hex as a table of a line per strip; None where the log is of none.

    Raises
    ------
    ContradictionError
        The log is of such frames, and does not say (or says in two ways) how bytes make readings.
    """
    frames, around, dump = _frames(text)
    if len(frames) < (1 if dump else _FEW):
        return None
    said = "\n".join(around)
    senders = {f.sender for f in frames}
    two = any(int(_bytes_of(m)) == _WORD for m in _WIDTH.finditer(said)) or any(
        m[2] and int(m[2]) - int(m[1]) == 1 for m in _PLACE.finditer(said)
    )
    if not (dump or senders != {""} or two):
        return None  # bytes of which each may be a reading
    big, little = bool(_BIG.search(said)), bool(_LITTLE.search(said))
    if big == little:
        why = "which of two bytes is the higher one" if not big else "one order of the bytes, but two"
        raise ContradictionError(f"the log is of bytes in hex, and does not say {why}: {_TELL}")
    plain = _LITTLE.sub(" ", _BIG.sub(" ", said))
    parts, sync = _layout(plain, frames, dump)
    frames, damaged = _cut(frames, parts, sync, dump)
    frames, unsound = _sound(frames, parts, sync)
    if not frames:
        raise ContradictionError(
            f"the log is of bytes in hex, and no frame is as its description says: {_TELL}"
        )
    return _table(
        frames, parts, plain, around, "big" if big else "little", sorted({*damaged, *unsound}), numbered(text)
    )


def _bytes_of(width: re.Match[str]) -> int:
    if width["bytes"]:
        word = width["bytes"].casefold()
        return int(word) if word.isdecimal() else _NUMBERS[word]
    return int(width["bits"] or width["short"] or width["bit"]) // 8


def _frames(text: str) -> tuple[list[_Frame], list[str], bool]:
    """Return the frames of a text, its other lines, and whether it is one stream of bytes, dumped by lines."""
    lines = [(n, line) for n, line in numbered(text) if line.strip()]
    plain = [(n, line) for n, line in lines if not line.lstrip().startswith(("#", "//", "%"))]
    for read in (_of_can, _of_dump, _of_lines):
        frames = read(plain)
        if frames and len(frames) >= _MOST * len(plain) - _FEW:
            digits = "".join(f.data.hex() for f in frames)
            if read is _of_lines and not re.search("[a-f]", digits):
                continue
            there = {f.line for f in frames}
            return frames, [line for n, line in lines if n not in there], read is _of_dump
    return [], [], False


def _of_can(lines: Sequence[tuple[int, str]]) -> list[_Frame]:
    found = [(n, m) for n, line in lines if (m := _CAN.fullmatch(line))]
    frames = []
    for n, m in found:
        digits = re.sub(r"\s", "", m["apart"] or m["solid"] or "")
        whole = len(digits) % 2 == 0 and (not m["n"] or len(digits) == 2 * int(m["n"]))
        frames.append(_Frame(n, bytes.fromhex(digits) if whole else b"", m["id"].upper(), m["head"]))
    return frames


def _of_dump(lines: Sequence[tuple[int, str]]) -> list[_Frame]:
    """Return the lines of xxd, hexdump -C or i2cdump, of which the numbers before them count the bytes."""
    found = []
    for n, line in lines:
        if (m := _DUMPED.fullmatch(re.sub(r"\s+\|.*\|\s*\Z", "", line))) is not None:
            found.append((n, int(m["at"], 16), bytes.fromhex(re.sub(r"\s", "", m["bytes"]))))
    counted = [b[1] - a[1] == len(a[2]) or b[1] == 0 for a, b in itertools.pairwise(found)]
    if len(found) < 2 or not all(counted[:-1]) or (sum(counted) < 2 and len(found) > 2):
        return []
    if any(re.fullmatch(r"\s*[\dA-Fa-f]{7}(?:\s+[\dA-Fa-f]{4})+\s*", line) for _, line in lines):
        raise ContradictionError(
            "a dump of words of two bytes, whose order hexdump turns around: save it with xxd or hexdump -C"
        )
    return [_Frame(n, data, "", f"{at:x}") for n, at, data in found]


def _of_lines(lines: Sequence[tuple[int, str]]) -> list[_Frame]:
    frames = []
    for n, line in lines:
        if (m := _RUN.search(line)) is not None:
            digits = re.sub(r"0[xX]|[^\dA-Fa-f]", "", m.group())
            frames.append(_Frame(n, bytes.fromhex(digits), "", line[: m.start()]))
    usual, many = Counter(len(f.data) for f in frames).most_common(1)[0] if frames else (0, 0)
    return frames if usual >= 2 * _WORD and many >= _MOST * len(frames) else []


def _layout(said: str, frames: Sequence[_Frame], dump: bool) -> tuple[list[_Part], bytes]:
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
            begin if (dump and frames[0].data.startswith(begin)) or sum(first) >= _SOUND * len(first) else b""
        )
    length = Counter(len(f.data) for f in frames).most_common(1)[0][0]
    places = [*_PLACE.finditer(said)]
    made = _placed(said, places) if places else _in_turn(said, sync)
    if not made:
        made = _all_alike(said, sync, length)
    readings = [p for p in made if _is_channel(p.role)]
    ends = {p.role for p in readings}
    taken = [(p.start, p.start + p.width) for p in made]
    if (
        not readings
        or len(ends) > _READING
        or len(readings) % len(ends)
        or any(p.width != _WORD for p in readings)
        or any(b[0] < a[1] for a, b in itertools.pairwise(sorted(taken)))
        or (not dump and max(b for _, b in taken) > length)
        or (not dump and not places and max(b for _, b in taken) != length)
    ):
        raise ContradictionError(
            f"the log is of bytes in hex, and does not say which bytes are which readings: {_TELL}"
        )
    return made, sync


def _is_channel(role: str) -> bool:
    return role not in ("", "time", "strip", "scan", "check")


def _role(text: str) -> str:
    """Return what a part of a frame is, by the words that describe it."""
    if _XOR.search(text) or _SUM.search(text):
        return "check"
    words = re.findall(r"[^\W\d]+(?:_[^\W\d]+)*", text)
    found = [meaning(w) for w in words]
    channels = list(dict.fromkeys(m.channel for m in found if m.role == "reading" and m.channel))
    if len(channels) == 1:
        return channels[0]
    if channels:
        return ""
    if re.search(r"\b(?:count|counter|seq|sequence|scan|frame|cycle)\b", text, re.IGNORECASE):
        return "scan"
    if any(m.role == "time" for m in found):
        return "time"
    return "strip" if any(m.role == "strip" for m in found) and not _NOT_STRIP.search(text) else ""


def _placed(said: str, places: Sequence[re.Match[str]]) -> list[_Part]:
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
            _Part(
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


def _in_turn(said: str, sync: bytes) -> list[_Part]:
    """Return the parts of a line that names them one after the other with `|`, ";" or commas, and their widths."""
    line = max(said.splitlines(), key=lambda x: len(_WIDTH.findall(x)), default="")
    mark = "|" if line.count("|") > 1 else ";" if line.count(";") > 1 else ""
    if not mark:
        return []
    parts: list[_Part] = []
    at = 0
    for item in line.lstrip("#%/ ").split(mark):
        literal = re.fullmatch(r"\s*((?:(?:0x)?[\dA-Fa-f]{2}[\s,]*)+)", item)
        if literal:
            at += len(re.findall(_BYTE, literal[1]))
            continue
        several = _STRIPS.search(item)
        inner = (
            [
                p
                for p in re.split(r",(?![^()]*\))|\bthen\b|\band\b", item[several.end() :])
                if _is_channel(_role(p))
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
                    parts.append(_Part(at, wide, _role(p), number, p))
                    at += wide
            continue
        width = _WIDTH.search(item)
        role = _role(item)
        many = _bytes_of(width) if width else 1 if role == "check" else 0
        if not many:
            return []
        strip = re.search(r"\bstrips?\s*#?(\d+)", item, re.IGNORECASE)
        parts.append(_Part(at, many, role, int(strip[1]) if strip else None, item))
        at += many
    return parts


def _all_alike(said: str, sync: bytes, length: int) -> list[_Part]:
    """Return readings of two bytes each that fill a frame, behind what each begins with, if their order is said."""
    order = order_said(said.splitlines()) or _bare_order(said)
    widths = {_bytes_of(m) for m in _WIDTH.finditer(said)} - {1, 4}
    if not order or widths != {_WORD} or (length - len(sync)) % (_READING * _WORD):
        return []
    if re.search(r"\b(?:time|zeit|counter|xor|crc|checksum)\b", said, re.IGNORECASE):
        return []  # of which nothing says where they stand
    strips = (length - len(sync)) // (_READING * _WORD)
    told = _STRIPS.search(said)
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
        _Part(len(sync) + _WORD * n, _WORD, end, first + s if told else s, "")
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


def _cut(
    frames: Sequence[_Frame], parts: Sequence[_Part], sync: bytes, dump: bool
) -> tuple[list[_Frame], list[int]]:
    """Return frames of the length that the parts take, and lines of others that hold readings, which are damaged."""
    size = max(p.start + p.width for p in parts)
    if not dump:
        of_readings = _senders(frames, parts)
        mine = [f for f in frames if f.sender in of_readings]
        usual = Counter(len(f.data) for f in mine).most_common(1)[0][0]
        whole = [f for f in mine if len(f.data) == usual >= size and f.data.startswith(sync)]
        there = {f.line for f in whole}
        return whole, [f.line for f in mine if f.line not in there]
    streams: list[list[_Frame]] = []
    for f in frames:
        if not streams or f.head == "0":
            streams.append([])
        streams[-1].append(f)
    made, damaged = [], []
    for stream in streams:
        data = b"".join(f.data for f in stream)
        starts = list(itertools.accumulate((len(f.data) for f in stream), initial=0))
        if len(streams) > 1 and not sync:
            made.append(_Frame(stream[0].line, data, "", ""))
            continue
        if len(data) % size and not sync:
            raise ContradictionError(
                f"the dump has {len(data)} bytes, and frames of {size} as it describes do not fill it: is it cut?"
            )
        at = 0
        while at < len(data):
            line = next(
                f.line for f, s in zip(reversed(stream), reversed(starts[:-1]), strict=True) if s <= at
            )
            if data.startswith(sync, at) and at + size <= len(data):
                made.append(_Frame(line, data[at : at + size], "", ""))
                at += size
                continue
            damaged.append(line)
            next_ = data.find(sync, at + 1) if sync else -1
            at = next_ if next_ > 0 else len(data)
    return made, damaged


def _senders(frames: Sequence[_Frame], parts: Sequence[_Part]) -> set[str]:
    """Return who sends frames long enough to hold the parts, all of one length."""
    size = max(p.start + p.width for p in parts)
    lengths: dict[str, Counter[int]] = {}
    for f in frames:
        lengths.setdefault(f.sender, Counter())[len(f.data)] += 1
    usual = {sender: c.most_common(1)[0][0] for sender, c in lengths.items()}
    long = Counter(n for n in usual.values() if n >= size).most_common(1)
    return {s for s, n in usual.items() if long and n == long[0][0]}


def _sound(frames: list[_Frame], parts: Sequence[_Part], sync: bytes) -> tuple[list[_Frame], list[int]]:
    """Return the frames whose XOR at the end is right, if it is so in nearly all, and the lines of others."""
    check = [p for p in parts if p.role == "check" and _XOR.search(p.said) and p.width == 1]
    for p in check:
        for skipped in (len(sync), 0):
            right = []
            for f in frames:
                value = 0
                for byte in f.data[skipped : p.start]:
                    value ^= byte
                right.append(value == f.data[p.start])
            if sum(right) >= _SOUND * len(right):
                kept = [f for f, ok in zip(frames, right, strict=True) if ok]
                return kept, [f.line for f, ok in zip(frames, right, strict=True) if not ok]
        raise ContradictionError(f"the XOR that the frames end with is not that of their bytes: {_TELL}")
    return frames, []


def _table(
    frames: Sequence[_Frame], parts: Sequence[_Part], said: str, around: Sequence[str], order: Order,
    damaged: Sequence[int], texts: Sequence[tuple[int, str]],
) -> Table:  # fmt: skip
    ends = list(dict.fromkeys(p.role for p in parts if _is_channel(p.role)))
    voids = {bytes.fromhex(re.sub(r"\s", "", m[1])) for m in _SIGN.finditer(said)}
    voids = {v[n : n + _WORD] for v in voids for n in range(0, len(v), _WORD)}
    voids |= {v[::-1] for v in voids}
    signed = bool(re.search(r"\bsigned\b|(?<!u)\bint16", said, re.IGNORECASE)) and "unsigned" not in said
    senders = _strips_of_senders(frames, said) if any(f.sender for f in frames) else {}
    strips_in_turn: dict[str, int] = Counter()
    time = next((p for p in parts if p.role == "time"), None)
    count = next((p for p in parts if p.role == "scan"), None)
    own = next((p for p in parts if p.role == "strip"), None)
    rows, lines = [], []
    scan, last, counted = -1, 10**9, None
    readings = [p for p in parts if _is_channel(p.role)]
    unnamed = any(p.strip is None for p in readings) and own is None and not senders
    if unnamed and len(readings) > len(ends):
        raise ContradictionError(
            f"the log is of bytes in hex, and does not say of which strips they are: {_TELL}"
        )
    for f in frames:
        if f.sender and f.sender not in senders:
            continue
        values: dict[int, dict[str, str]] = {}
        base = senders.get(f.sender, 0)
        if own is not None:
            base = int.from_bytes(f.data[own.start : own.start + own.width], order)
        strips_in_turn.clear()
        for p in parts:
            if _is_channel(p.role):
                raw = f.data[p.start : p.start + p.width]
                strip = p.strip if p.strip is not None and own is None and not senders else base
                value = int.from_bytes(raw, order, signed=signed)
                values.setdefault(strip, {})[p.role] = "" if raw in voids else str(value)
        number = (
            None if count is None else int.from_bytes(f.data[count.start : count.start + count.width], order)
        )
        first = min(values)
        if number != counted or first <= last or len(values) > 1:
            scan, stamp = scan + 1, _stamp(f, time, order)
        last, counted = first, number
        for strip, pair in values.items():
            rows.append([*stamp.values(), str(scan), str(strip), *(pair.get(e, "") for e in ends)])
            lines.append(f.line)
            names = [*stamp]
    if {*ends} == {"h", "l"}:
        both = [(int(row[-2]), int(row[-1])) for row in rows if row[-1] and row[-2]]
        below = sum(a < b for a, b in both) if ends[0] == "h" else sum(a > b for a, b in both)
        if below > _MOST_BELOW * len(both):
            raise ContradictionError(
                f"read as the log says, v_h is below v_l {below} time(s) of {len(both)} in frames of bytes in hex: are "
                f"the order of bytes and of readings so? Then {_TELL}"
            )
    unit = _unit(said)
    told = dict(texts)
    other = sorted({f.sender for f in frames} - {*senders}) if senders else []
    return Table(
        (*names, "scan", "strip", *(f"{e}{unit}" for e in ends)), rows, lines, ".", True,
        (f"frames of bytes in hex: {_READING} bytes a reading, {order} endian, as the log says",
         *([f"frames of {', '.join(other)}: of others, passed over"] if other else [])),
        tuple(damaged), tuple(around), quotes={n: told[n].strip() for n in damaged},
    )  # fmt: skip


def _stamp(frame: _Frame, time: _Part | None, order: Order) -> dict[str, str]:
    """Return the time of a frame, named with its unit: of its bytes, or of what stands before them."""
    if time is not None:
        unit = re.search(r"\b(ms|us|\u00b5s|milliseconds|microseconds|s)\b", time.said)
        value = int.from_bytes(frame.data[time.start : time.start + time.width], order)
        return {f"time [{unit[1]}]" if unit else "time": str(value)}
    found = (
        _TIME.search(frame.head) if not re.fullmatch(r"[\da-f]*", frame.head) or "." in frame.head else None
    )
    if found is None:
        return {}
    if found["clock"]:
        return {"time stamp": found["clock"]}
    unit_said = found["unit"] or ("s" if re.match(r"\s*\(\d+\.\d{6}\)", frame.head) else "")
    return {f"time [{unit_said}]" if unit_said else "time": found["count"]}


def _strips_of_senders(frames: Sequence[_Frame], said: str) -> dict[str, int]:
    """Return the strips that senders' numbers stand for, as "0x200 + strip" says."""
    told = {int(a or b, 16) for a, b in _BASED.findall(said)}
    strips = _STRIPS.search(said)
    if len(told) != 1 or not strips:
        raise ContradictionError(
            "the log is of frames with identifiers, and does not say of which strips they are: write above them a line "
            "such as '# ID 0x200 + strip (strips 0 to 4)'"
        )
    base = told.pop()
    first, last = sorted((int(strips[1]), int(strips[2])))
    found = {f.sender: int(f.sender, 16) - base for f in frames}
    return {sender: strip for sender, strip in found.items() if first <= strip <= last}


def _unit(said: str) -> str:
    units = {
        u.casefold()
        for u in re.findall(r"(?<![\w])(mV|millivolts?|codes?|counts?|LSB|raw)(?!\w)", said, re.IGNORECASE)
    }
    milli = {u for u in units if u.startswith(("mv", "milli"))}
    if milli and milli != units:
        return ""
    return " [mV]" if milli else " [code]" if units or re.search(r"\bADC\b", said) else ""
