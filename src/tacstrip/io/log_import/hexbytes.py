"""Hex dumps of frames: bytes that make readings as a description in the log says, and never as single bytes."""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Sequence
from typing import Literal

from tacstrip.io.log_import.fields import STAMP
from tacstrip.io.log_import.hexframes import WORD, Frame, frames_of
from tacstrip.io.log_import.hexlayout import (
    SOUND,
    STRIPS,
    TELL,
    XOR,
    Part,
    is_channel,
    layout_of,
    says_two_bytes,
)
from tacstrip.io.log_import.strays import numbered
from tacstrip.io.log_import.table import ContradictionError, Table

Order = Literal["big", "little"]
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
_BASED = re.compile(
    r"\b(?:0x([\dA-Fa-f]{2,8})|([\dA-Fa-f]{3,8}))\s*\+\s*(?:the )?(?:strip|streifen|taxel|pad|index|number|[nisk]\b)",
    re.IGNORECASE,
)
_SIGN = re.compile(
    r"(?<![\w])(?:0x)?((?:[\dA-Fa-f]{2}\s?){2,4})(?=\s*(?:=|:|->|means|is|stands|if|where|when|bedeutet)\s)",
    re.IGNORECASE,
)
_FEW = 3  # frames
_MOST_BELOW = 0.2  # of the pairs: no sensor reads so


def of_hex_bytes(text: str) -> Table | None:
    """Return frames of bytes in hex as a table of a line per strip; None where the log is of none.

    Raises
    ------
    ContradictionError
        The log is of such frames, and does not say (or says in two ways) how bytes make readings.
    """
    frames, around, dump = frames_of(text)
    if len(frames) < (1 if dump else _FEW):
        return None
    said = "\n".join(around)
    senders = {f.sender for f in frames}
    if not (dump or senders != {""} or says_two_bytes(said)):
        return None  # bytes of which each may be a reading
    big, little = bool(_BIG.search(said)), bool(_LITTLE.search(said))
    if big == little:
        why = "which of two bytes is the higher one" if not big else "one order of the bytes, but two"
        raise ContradictionError(f"the log is of bytes in hex, and does not say {why}: {TELL}")
    plain = _LITTLE.sub(" ", _BIG.sub(" ", said))
    parts, sync = layout_of(plain, frames, dump)
    frames, damaged = _cut(frames, parts, sync, dump)
    frames, unsound = _sound(frames, parts, sync)
    if not frames:
        raise ContradictionError(
            f"the log is of bytes in hex, and no frame is as its description says: {TELL}"
        )
    return _table(
        frames, parts, plain, around, "big" if big else "little", sorted({*damaged, *unsound}), numbered(text)
    )


def _cut(
    frames: Sequence[Frame], parts: Sequence[Part], sync: bytes, dump: bool
) -> tuple[list[Frame], list[int]]:
    """Return frames of the length that the parts take, and lines of others that hold readings, which are damaged."""
    size = max(p.start + p.width for p in parts)
    if not dump:
        of_readings = _senders(frames, parts)
        mine = [f for f in frames if f.sender in of_readings]
        usual = Counter(len(f.data) for f in mine).most_common(1)[0][0]
        whole = [f for f in mine if len(f.data) == usual >= size and f.data.startswith(sync)]
        there = {f.line for f in whole}
        return whole, [f.line for f in mine if f.line not in there]
    streams: list[list[Frame]] = []
    for f in frames:
        if not streams or f.head == "0":
            streams.append([])
        streams[-1].append(f)
    made, damaged = [], []
    for stream in streams:
        data = b"".join(f.data for f in stream)
        starts = list(itertools.accumulate((len(f.data) for f in stream), initial=0))
        if len(streams) > 1 and not sync:
            made.append(Frame(stream[0].line, data, "", ""))
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
                made.append(Frame(line, data[at : at + size], "", ""))
                at += size
                continue
            damaged.append(line)
            next_ = data.find(sync, at + 1) if sync else -1
            at = next_ if next_ > 0 else len(data)
    return made, damaged


def _senders(frames: Sequence[Frame], parts: Sequence[Part]) -> set[str]:
    """Return who sends frames long enough to hold the parts, all of one length."""
    size = max(p.start + p.width for p in parts)
    lengths: dict[str, Counter[int]] = {}
    for f in frames:
        lengths.setdefault(f.sender, Counter())[len(f.data)] += 1
    usual = {sender: c.most_common(1)[0][0] for sender, c in lengths.items()}
    long = Counter(n for n in usual.values() if n >= size).most_common(1)
    return {s for s, n in usual.items() if long and n == long[0][0]}


def _sound(frames: list[Frame], parts: Sequence[Part], sync: bytes) -> tuple[list[Frame], list[int]]:
    """Return the frames whose XOR at the end is right, if it is so in nearly all, and the lines of others."""
    check = [p for p in parts if p.role == "check" and XOR.search(p.said) and p.width == 1]
    for p in check:
        for skipped in (len(sync), 0):
            right = []
            for f in frames:
                value = 0
                for byte in f.data[skipped : p.start]:
                    value ^= byte
                right.append(value == f.data[p.start])
            if sum(right) >= SOUND * len(right):
                kept = [f for f, ok in zip(frames, right, strict=True) if ok]
                return kept, [f.line for f, ok in zip(frames, right, strict=True) if not ok]
        raise ContradictionError(f"the XOR that the frames end with is not that of their bytes: {TELL}")
    return frames, []


def _table(
    frames: Sequence[Frame], parts: Sequence[Part], said: str, around: Sequence[str], order: Order,
    damaged: Sequence[int], texts: Sequence[tuple[int, str]],
) -> Table:  # fmt: skip
    ends = list(dict.fromkeys(p.role for p in parts if is_channel(p.role)))
    voids = {bytes.fromhex(re.sub(r"\s", "", m[1])) for m in _SIGN.finditer(said)}
    voids = {v[n : n + WORD] for v in voids for n in range(0, len(v), WORD)}
    voids |= {v[::-1] for v in voids}
    signed = bool(re.search(r"\bsigned\b|(?<!u)\bint16", said, re.IGNORECASE)) and "unsigned" not in said
    senders = _strips_of_senders(frames, said) if any(f.sender for f in frames) else {}
    strips_in_turn: dict[str, int] = Counter()
    time = next((p for p in parts if p.role == "time"), None)
    count = next((p for p in parts if p.role == "scan"), None)
    own = next((p for p in parts if p.role == "strip"), None)
    rows, lines = [], []
    scan, last, counted = -1, 10**9, None
    readings = [p for p in parts if is_channel(p.role)]
    unnamed = any(p.strip is None for p in readings) and own is None and not senders
    if unnamed and len(readings) > len(ends):
        raise ContradictionError(
            f"the log is of bytes in hex, and does not say of which strips they are: {TELL}"
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
            if is_channel(p.role):
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
                f"the order of bytes and of readings so? Then {TELL}"
            )
    unit = _unit(said)
    told = dict(texts)
    other = sorted({f.sender for f in frames} - {*senders}) if senders else []
    return Table(
        (*names, "scan", "strip", *(f"{e}{unit}" for e in ends)), rows, lines, ".", True,
        (f"frames of bytes in hex: {WORD} bytes a reading, {order} endian, as the log says",
         *([f"frames of {', '.join(other)}: of others, passed over"] if other else [])),
        tuple(damaged), tuple(around), quotes={n: told[n].strip() for n in damaged},
    )  # fmt: skip


def _stamp(frame: Frame, time: Part | None, order: Order) -> dict[str, str]:
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


def _strips_of_senders(frames: Sequence[Frame], said: str) -> dict[str, int]:
    """Return the strips that senders' numbers stand for, as "0x200 + strip" says."""
    told = {int(a or b, 16) for a, b in _BASED.findall(said)}
    strips = STRIPS.search(said)
    if len(told) == 1 and not strips:  # all from there on, if none is missing
        there = {f.sender: n for f in frames if (n := int(f.sender, 16) - min(told)) >= 0}
        numbers = sorted({*there.values()})
        if numbers and numbers[0] < 2 and len(numbers) == numbers[-1] - numbers[0] + 1:
            return there
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
