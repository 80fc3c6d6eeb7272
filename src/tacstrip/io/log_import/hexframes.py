"""Frames of bytes in hex: of a CAN bus, of a dump, of lines."""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from tacstrip.io.log_import.strays import numbered
from tacstrip.io.log_import.table import ContradictionError

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
_FEW = 3  # frames
_MOST = 0.6  # of the lines
WORD = 2  # bytes of a number


@dataclass(frozen=True)
class Frame:
    """Bytes of a frame, the line where it begins, who sent it ("" where no line says) and what stands before it."""

    line: int
    data: bytes
    sender: str
    head: str


def frames_of(text: str) -> tuple[list[Frame], list[str], bool]:
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


def _of_can(lines: Sequence[tuple[int, str]]) -> list[Frame]:
    found = [(n, m) for n, line in lines if (m := _CAN.fullmatch(line))]
    frames = []
    for n, m in found:
        digits = re.sub(r"\s", "", m["apart"] or m["solid"] or "")
        whole = len(digits) % 2 == 0 and (not m["n"] or len(digits) == 2 * int(m["n"]))
        frames.append(Frame(n, bytes.fromhex(digits) if whole else b"", m["id"].upper(), m["head"]))
    return frames


def _of_dump(lines: Sequence[tuple[int, str]]) -> list[Frame]:
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
    return [Frame(n, data, "", f"{at:x}") for n, at, data in found]


def _of_lines(lines: Sequence[tuple[int, str]]) -> list[Frame]:
    frames = []
    for n, line in lines:
        if (m := _RUN.search(line)) is not None:
            digits = re.sub(r"0[xX]|[^\dA-Fa-f]", "", m.group())
            frames.append(Frame(n, bytes.fromhex(digits), "", line[: m.start()]))
    usual, many = Counter(len(f.data) for f in frames).most_common(1)[0] if frames else (0, 0)
    return frames if usual >= 2 * WORD and many >= _MOST * len(frames) else []
