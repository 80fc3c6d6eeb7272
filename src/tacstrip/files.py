"""Files in and out: what is written takes its name when it is whole, and what has no end is not read."""

from __future__ import annotations

import errno
import os
import secrets
import shutil
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_LONGEST = 2**26  # characters of a spec or a contact: a pipe may go on without end
_HANDED_OVER = ("/dev/stdin", "/dev/fd/", "/proc/self/fd/")  # what the caller opened: its end is the caller's
_DRAWN = (".png", ".svg", ".pdf", ".html")  # pictures and reports: all else may be the only copy
_SHAPES = (b'"FeatureCollection"', b'"status": ', b'"advice": ')
_RESULTS: dict[str, list[tuple[bytes, ...]]] = {  # what ours say, and others do not all of it
    ".geojson": [_SHAPES],
    ".json": [_SHAPES, (b'"vertices_mm": ', b'"limits": ', b'"rms_mm": ')],
    ".cir": [(b"written by tacstrip",)],
}
_FIRST = 2**20  # bytes in which they say it
_KINDS = {
    ".csv": "readings or runs (CSV)",
    ".mcap": "a recording",
    ".toml": "a spec or a study (TOML)",
    ".wkt": "a contact",
    ".geojson": "a contact, or shapes",
}


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Give a temporary name in the folder of `path`; the file written there replaces `path` when the block ends well.

    When the block raises, as on a full disk, `path` is as it was before. A device or a pipe, which has no place to
    take, is given as it is.

    Raises
    ------
    OSError
        It names `path`, not the temporary file.
    """
    target = Path(os.path.realpath(path))  # a link stays a link
    there = target.exists()
    part = target.with_name(f".tacstrip-{secrets.token_hex(4)}.part")
    if there and not target.is_file():
        part = target
    try:
        if there and not os.access(target, os.W_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
        yield part
        if part != target:
            with part.open("rb+") as file:
                os.fsync(file.fileno())  # else a power cut may leave the name and nothing in it
            if there:
                shutil.copymode(target, part)
            part.replace(target)
    except OSError as error:
        if error.errno is None or error.filename not in (None, str(part)):
            raise
        raise OSError(error.errno, error.strerror, str(path)) from error
    finally:
        if part != target:
            with suppress(OSError):
                part.unlink(missing_ok=True)


def write_text(path: str | Path, text: str) -> None:
    """Write a text file in UTF-8, whole or not at all; errors as of `replacing`."""
    with replacing(path) as part:
        part.write_text(text, encoding="utf-8")


def read_text(path: str | Path) -> str:
    """Return a text file's text, in UTF-8 with or without its mark.

    Raises
    ------
    ValueError
        It is not in UTF-8, or so long that it is not what was meant.
    OSError
        It cannot be read.
    """
    with Path(path).open(encoding="utf-8-sig") as file:
        text = file.read(_LONGEST + 1)
    if len(text) > _LONGEST:
        raise ValueError(f"it is longer than {_LONGEST} characters")
    return text


def replaceable(path: str | Path) -> bool:
    """Say whether a file may be written over unasked: there is none, or it is a picture, a report, or a result.

    Results are shapes, tracks, limits and netlists that a verb made of its input and makes again; readings,
    recordings, specs and contacts are not, for they may be the only copy.
    """
    target = Path(path)
    if not target.is_file() or target.suffix.lower() in _DRAWN:
        return True
    kinds = _RESULTS.get(target.suffix.lower())
    if kinds is None:
        return False
    with target.open("rb") as stream:
        begin = stream.read(_FIRST)
    return any(all(mark in begin for mark in marks) for marks in kinds)


def other_kind(path: str | Path, *wanted: str) -> str:
    """Say what a file is by its ending, where that is none of those wanted, such as ".csv"; nothing where it may be."""
    ending = Path(path).suffix.lower()
    return "" if ending in wanted else _KINDS.get(ending, "")


def why_unreadable(path: str | Path) -> str:
    """Say why a path is nothing to read to its end: a device or a pipe; nothing where it may be a file.

    What the caller hands over, standard input or another open pipe, ends where the caller ends it.
    """
    try:
        mode = Path(path).stat().st_mode
    except (OSError, ValueError):
        return ""  # reading it says why
    if stat.S_ISREG(mode) or stat.S_ISDIR(mode):
        return ""
    if stat.S_ISFIFO(mode) and str(path).startswith(_HANDED_OVER):
        return ""
    what = "a pipe" if stat.S_ISFIFO(mode) else "a device" if not stat.S_ISSOCK(mode) else "a socket"
    return f"is {what}, not a file; save what it gives to a file, and name that"
