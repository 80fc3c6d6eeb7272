"""A file of text, whatever its encoding."""

from __future__ import annotations

import contextlib
import re
from pathlib import Path

from tacstrip.errors import ReadingError
from tacstrip.io.log_import.names import OTHER_SCRIPT
from tacstrip.io.log_import.table import GARBLED

_MOST_BYTES = 2**30
_ENCODINGS = ("gb18030", "big5", "shift_jis", "euc_kr", "cp1251", "koi8-r")
# Words of central Europe whose letters are other ones in Western Europe's encoding.
_EASTERN = re.compile(
    r"\b(?:kana\u0142\w*|d\u00f3\u0142|napi\u0119cie|warto\u015b\u0107|\u015bcie\u017cka|\u010das|nap\u011bt\u00ed|\u0159\u00e1dek|k\u00e1b\u011bl|fesz\u00fclts\u00e9g|id\u0151"
    r"|als\u00f3|fels\u0151|u\u0142amek|wy\u0142\u0105cz\w*|pomiar\u00f3w|pr\u00f3bka)\b",
    re.IGNORECASE,
)
_WORDS_KNOWN = 2  # of those that logs have: fewer may be there by chance
_FEW_GARBLED, _GARBLED_LINES = 3, 0.05  # places with zeros, and part of the lines: of more, a file is no text


def decoded(file: Path) -> str:
    """Return a file's text, whatever its encoding; `ReadingError` where it is none."""
    raw = file.read_bytes() if file.stat().st_size <= _MOST_BYTES else b""
    if not raw and file.stat().st_size:
        raise ReadingError(f"{file}: more than a gigabyte of text; cut it into pieces, or use a recording")
    for mark, name in ((b"\xef\xbb\xbf", "utf-8-sig"), (b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16")):
        if raw.startswith(mark):
            return _in_utf16(raw, file, name)
    if raw[:40].count(0) >= len(raw[:40]) // 2 - 1 > 2:
        return _in_utf16(raw, file, "utf-16-le" if raw[1] == 0 else "utf-16-be")
    text, many = re.subn(rb"\0+", GARBLED.encode(), raw.rstrip(b"\0"))  # as where a logger was switched off
    if many > max(_FEW_GARBLED, _GARBLED_LINES * text.count(b"\n")):
        raise ReadingError(f"{file}: not a text file (byte {raw.index(0)} is 0)")
    try:
        return text.decode()
    except UnicodeDecodeError:
        western = text.decode("cp1252", errors="replace")  # of a spreadsheet on Windows
    known: dict[str, int] = {}  # text -> letters of the words in it that logs have
    for name in _ENCODINGS:
        with contextlib.suppress(UnicodeDecodeError):
            other = text.decode(name)
            words = {*OTHER_SCRIPT.findall(other)}
            known[other] = sum(map(len, words)) if len(words) >= _WORDS_KNOWN else 0
    best = max(known, key=lambda other: known[other], default="")
    eastern = text.decode("cp1250", errors="replace")
    western = eastern if _EASTERN.search(eastern) and not _EASTERN.search(western) else western
    return best if known.get(best) else western


def _in_utf16(raw: bytes, file: Path, name: str) -> str:
    try:
        return raw.decode(name)
    except UnicodeDecodeError:
        raise ReadingError(f"{file}: its marks say {name}, and it is not; save it as UTF-8") from None
