"""A file of text, whatever its encoding."""

from __future__ import annotations

import contextlib
import re
from pathlib import Path

from tacstrip.errors import ReadingError
from tacstrip.io.log_import.names import OTHER_SCRIPT
from tacstrip.io.log_import.table import GARBLED

_MOST_BYTES = 2**30
_ENCODINGS = ("gb18030", "big5", "cp932", "cp949", "cp1251", "koi8-r")
# In which rows of their tables, by the first byte, the standards have the characters in daily use.
_DAILY = {"euc_kr": range(0xB0, 0xC9), "gb18030": range(0xB0, 0xD8), "big5": range(0xA4, 0xC7)}
_KANA = re.compile("[\u3041-\u30fe]")
_FEW_LETTERS = 6  # distinct ones, of which a script is told
_NEARLY_ALL, _SOME = 0.9, 0.2  # of the letters; kana stand among Chinese characters
_APART = 0.3  # of a Latin text's letters with marks or more stand beside none other
# Words of central Europe whose letters are other ones in Western Europe's encoding.
_EASTERN = re.compile(
    r"\b(?:kana\u0142\w*|d\u00f3\u0142|napi\u0119cie|warto\u015b\u0107|\u015bcie\u017cka|\u010das|nap\u011bt\u00ed|\u0159\u00e1dek|k\u00e1b\u011bl|fesz\u00fclts\u00e9g|id\u0151"
    r"|als\u00f3|fels\u0151|u\u0142amek|wy\u0142\u0105cz\w*|pomiar\u00f3w|pr\u00f3bka)\b",
    re.IGNORECASE,
)
_WITHIN = re.compile(  # a mark in a word
    r"(?<=[^\W\d_])[^\w\s\0-\x7f\u2019\u00b7\xad](?=[^\W\d_])|(?<=[^\W\d_])[\xb2\xb3\xb9](?=[^\W\d_])"
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
    fewer = len(_WITHIN.findall(eastern)) < len(_WITHIN.findall(western))
    western = eastern if fewer or (_EASTERN.search(eastern) and not _EASTERN.search(western)) else western
    return best if known.get(best) else _of_one_script(text, western) or western


def _of_one_script(raw: bytes, western: str) -> str:
    """Return a text of an East Asian script, where a Latin reading is rows of marks; "" where it is not one's.

    Examples
    --------
    >>> _of_one_script("측정 결과 바닥 센서".encode("euc_kr"), "측정 결과 바닥 센서".encode("euc_kr").decode("cp1252"))
    '측정 결과 바닥 센서'
    >>> _of_one_script("Größe, Länge".encode("cp1252"), "Größe, Länge")
    ''
    """
    runs = [len(run) for run in re.findall(r"[^\0-\x7f]+", western)]
    apart = runs.count(1) >= _APART * sum(runs)
    for name in ("cp932", *(_DAILY if not apart else ())):  # second bytes of cp932 may be ASCII
        with contextlib.suppress(UnicodeDecodeError):
            text = raw.decode(name)
            letters = [c for c in text if c > "\x7f" and c.isalpha()]
            kana = name == "cp932"
            own = [c for c in letters if (_KANA.match(c) if kana else c.encode(name)[0] in _DAILY[name])]
            if len({*letters}) >= _FEW_LETTERS and len(own) >= (_SOME if kana else _NEARLY_ALL) * len(
                letters
            ):
                return text
    return ""


def _in_utf16(raw: bytes, file: Path, name: str) -> str:
    try:
        return raw.decode(name)
    except UnicodeDecodeError:
        raise ReadingError(f"{file}: its marks say {name}, and it is not; save it as UTF-8") from None
