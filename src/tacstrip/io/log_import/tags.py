"""Lines of several sensors of one board, each behind a word that says which: those of strips alone are taken."""

from __future__ import annotations

import re
from collections import Counter

from tacstrip.io.log_import.fields import number_of, says_nothing
from tacstrip.io.log_import.strays import numbered

_TAGGED = re.compile(r"\s*\$?(?P<tag>[A-Za-z][A-Za-z_]*)(?P<by>[,;\t]\s*| +)(?=[-+.\d])(?P<rest>.*?)\s*")
_MOSTLY = 0.8  # of the lines with a digit
_OFTEN = 2  # lines of a tag
_STRIPS = 3  # numbers that come again and again


def without_other_tags(text: str) -> tuple[str, str]:
    r"""Return a text with the lines of only that tag behind which strips are numbered, without it; and a remark.

    Examples
    --------
    >>> lines = [f"IMU,{t},0.1\n" + "".join(f"SKIN,{t},{s},3.{s},2.{t}\n" for s in range(3)) for t in range(4)]
    >>> without_other_tags("".join(lines))[0].split("\n")[:3]
    ['', '0,0,3.0,2.0', '0,1,3.1,2.0']
    """
    lines = numbered(text)
    found = {n: m for n, line in lines if (m := _TAGGED.fullmatch(line))}
    many = Counter(m["tag"] for m in found.values())
    digits = sum(bool(re.search(r"\d", line)) for _, line in lines)
    if len([t for t in many if many[t] >= _OFTEN]) < 2 or sum(many.values()) < _MOSTLY * digits:
        return text, ""
    bodies = {tag: [_fields(m) for m in found.values() if m["tag"] == tag] for tag in many}
    of_strips = [tag for tag, rows in bodies.items() if _numbers_strips(rows)]
    if len(of_strips) != 1:
        return text, ""
    own = of_strips[0]
    # Above the first of them, words may say what they are.
    first = min(n for n, m in found.items() if m["tag"] == own)
    out = {n for n, m in found.items() if m["tag"] != own}
    out |= {n for n, line in lines if n > first and not line.strip()}
    names = re.compile(rf"(?P<mark>\W*?)\$?{own}\s*[,;\t]\s*")  # before names, as before what they name
    kept = [
        found[n]["rest"] if n in found and n not in out
        else "" if n in out
        else names.sub(r"\g<mark>", line) if n < first and names.match(line)
        else line
        for n, line in lines
    ]  # fmt: skip
    others = ", ".join(tag for tag in many if tag != own)
    return "\n".join(kept), f"lines of {own} are taken, for they number strips; passed over: {others}"


def _fields(m: re.Match[str]) -> list[str]:
    return re.split(r"\s*[,;\t]\s*" if m["by"].strip() or "\t" in m["by"] else r"\s+", m["rest"])


def _numbers_strips(rows: list[list[str]]) -> bool:
    """Return whether lines hold a few whole numbers that come in turn, again and again, and other fields."""
    widths = {len(row) for row in rows}
    if len(widths) != 1 or len(rows) < _OFTEN * _STRIPS or min(widths) < _STRIPS:
        return False
    for column in zip(*rows, strict=True):
        turn = len({*column})
        counts = [number_of(f) for f in column]
        again = all(a == b for a, b in zip(column, column[turn:], strict=False))
        if (
            _STRIPS <= turn <= len(rows) // _OFTEN
            and again
            and all(c is not None and c == int(c) for c in counts)
        ):
            return any(says_nothing(f) or "." in f or number_of(f) for f in rows[0])
    return False
