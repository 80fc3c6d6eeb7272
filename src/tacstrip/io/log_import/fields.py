"""What one field of a log says: a number, perhaps with its unit, a time, an array, or that nothing touches."""

from __future__ import annotations

import itertools
import json
import re
from datetime import date
from functools import lru_cache
from typing import Any

from tacstrip.io.log_import.names import UNITS, with_latin_units
from tacstrip.io.log_import.words import words_of

# What stands for an untouched strip in anybody's log.
NOTHING = frozenset({"", *words_of("nothing")})
_NO_NUMBER = re.compile(r"(?:-?nan|n/?a|-[-.]*|\.nan|\.{2,}|\u2026)\s?(?:m?V|ms|s|%|LSB)?", re.IGNORECASE)
_PLAIN = re.compile(r"[+-]?\d+(?:\.\d+)?\Z")
_NUMBER = re.compile(r"([+-]?)\s*(0x[\da-f]+|[\d.,' ]*\d[.,]?)(e[+-]?\d+)?\s*([a-zµ%‰]*)\Z", re.IGNORECASE)
_MEASURED = re.compile(
    rf"\d\s?(?:{'|'.join(u for u in UNITS if len(u) < 3 and u.isalpha())})\b", re.IGNORECASE
)
_OVER = re.compile(
    r"[+-]?\d(?:\.\d*)?[eE]\+?(?:[3-9]\d|\d{3})(?:\s?V)?"
)  # what instruments send above their range
_DAY_S = 86400.0
_GARBLED_RUN = 2.5  # letters beyond ASCII next to each other, in the mean
_GROUPED = re.compile(r"(?<=\d)[ '\u2009\u202f\xa0\u2019](?=\d{3}(?!\d))")
_OF_DAY = r"(?P<h>\d{1,2}):(?P<m>\d\d):(?P<s>\d\d(?:[.,]\d+|::?\d{3,6})?)\s*(?P<half>[AaPp]\.?[Mm]\.?)?"
_DATE = (
    r"(?:(?P<Y>\d{4})[-/.](?P<M>\d\d?)[-/.](?P<D>\d\d?)"
    r"|(?P<a>\d\d?)(?P<mark>[-/. ])(?P<b>\d\d?|[A-Za-z]{3,9}\.?)[-/. ](?P<y>\d{4}|\d\d))"
)
_ZONE = r"(?:\s*(?:Z|UTC|[+-]\d\d:?\d\d)|[+-]\d\d(?![\d.,:]))?"
_OFFSET = re.compile(r"([+-])(\d\d):?(\d\d)?\Z")
STAMP = rf"(?:{_DATE}(?:[T_]|,? +))?{_OF_DAY}{_ZONE}"  # a date, if any, and a time of day
_CLOCK = re.compile(rf"(?:{_DATE}[T ,_/]+)?{_OF_DAY}{_ZONE}")
_COMPACT = re.compile(r"(\d{4})(\d\d)(\d\d)[T_ -](\d\d)(\d\d)(\d\d(?:\.\d+)?)")
_MINUTES = re.compile(r"(\d{1,3}):(\d\d(?:[.,]\d+)?)")
_HALF = r"\s*[AaPp]\.?[Mm]\.?"
_SHORT = re.compile(rf"(?P<date>{_DATE}[T ,_]+)(\d\d?):(\d\d?):(\d\d?)(?![\d:])")  # as of a clock's chip
_WITHOUT_SECONDS = re.compile(
    rf"(?:{_DATE}[T ,_]+\d{{1,2}}:\d\d(?=(?:{_HALF})?(?:{_ZONE})\Z)|(?<![\d:])\d{{1,2}}:\d\d(?={_HALF}\Z))"
)
_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")


@lru_cache(maxsize=2**16)
def says_nothing(text: str) -> bool:
    """Return whether a field says that nothing touches: empty, or a word such as "n/a" or "nan V".

    Examples
    --------
    >>> says_nothing("---"), says_nothing("nanV"), says_nothing("9.9E+37"), says_nothing("0"), says_nothing("OL")
    (True, True, True, False, False)
    """
    return text.casefold() in NOTHING or bool(_NO_NUMBER.fullmatch(text) or _OVER.fullmatch(text))


def is_prose(line: str, names: frozenset[str] | set[str] = frozenset()) -> bool:
    """Return whether a line is a message between the readings: words, and none of those that name or stand for these.

    Examples
    --------
    >>> is_prose("heap=214339, stack ok", {"h", "l"}), is_prose("strip 3 h=5?2", {"strip", "h"}), is_prose("2.5 open 1")
    (True, False, False)
    >>> is_prose("min 0.312 V, max 2.950 V over 14 scans", {"time", "v"})  # a unit behind a number is no name
    True
    """
    line = re.sub(STAMP, "", line, count=1)
    words = [w.casefold() for w in re.findall(r"[^\W\d_]+", _MEASURED.sub("0", line))]
    long = [w for w in words if len(w) > 2 and not says_nothing(w)]
    digits = sum(c.isdigit() for c in line)
    worded = len(long) > 1 and sum(map(len, long)) >= 1.5 * digits
    short = (
        bool(long) and re.match(r"\W*[^\W\d]", line) and len(re.findall(r"[\d.]+", line)) <= 2
    )  # "heap 1984"
    return bool(worded or short) and not names.intersection(words)


@lru_cache(maxsize=2**16)
def quantity(text: str, decimal: str = ".") -> tuple[float, str] | None:
    """Return a field's number and unit ("" where it has none); None where it is no number.

    Examples
    --------
    >>> quantity("2,50 V", ","), quantity("0x1FF"), quantity("12 34"), quantity("1.234,5", ",")
    ((2.5, 'V'), (511.0, ''), None, (1234.5, ''))
    """
    if _PLAIN.match(text) and (decimal == "." or "." not in text):
        return float(text), ""
    text = (
        text.strip()
        .replace("\u202f", " ")
        .replace("\xa0", " ")
        .replace("\u2212", "-")
        .replace("\u2019", "'")
        .replace("\u03bc", "\u00b5")
    )
    text = text if text.isascii() else with_latin_units(text)
    found = _NUMBER.match(text) if text.isascii() or "µ" in text or "‰" in text else None
    if not found:
        return None
    sign, digits, power, word = found.groups()
    digits = digits.strip()
    unit = UNITS.get(word) or UNITS.get(word.lower(), "")
    if word and not unit:
        return None
    if digits[:2].casefold() == "0x":
        return (float(int(digits, 16)), unit) if not (sign or power) else None
    whole, _, rest = digits.partition(decimal)
    other = r"\." if decimal == "," else ","
    if not re.fullmatch(rf"\d*|\d{{1,3}}(?:[{other}' ]\d{{3}})+", whole) or not re.fullmatch(r"\d*", rest):
        return None
    value = float(f"{sign}{re.sub('[^0-9]', '', whole) or 0}.{rest or 0}{power or ''}")
    return (value, unit) if abs(value) < float("inf") else None


def ungrouped(text: str) -> str:
    """Return a field without the spaces or apostrophes that mark thousands.

    Examples
    --------
    >>> ungrouped("2 756,6"), ungrouped("12 34")
    ('2756,6', '12 34')
    """
    return (
        _GROUPED.sub("", text)
        if re.match(r"[+-]?\d{1,3}(?:[ '\u2009\u202f\xa0\u2019]\d{3})+(?!\d)", text)
        else text
    )


def number_of(text: str, decimal: str = ".") -> float | None:
    """Return a field's number, without its unit; None where it is none.

    Examples
    --------
    >>> number_of("2,50 V", ","), number_of("512"), number_of("n/a")
    (2.5, 512.0, None)
    """
    found = quantity(text, decimal)
    return found[0] if found else None


def clock_seconds(text: str, day_first: bool = False) -> float | None:
    """Return a time of day, a date with time, or minutes and seconds in seconds; None where it is none of these.

    Of 3/4/2026 the month comes first, unless it cannot be or `day_first`.

    Examples
    --------
    >>> clock_seconds("3:04:05,5 PM"), clock_seconds("01:02.5"), clock_seconds("2.5")
    (54245.5, 62.5, None)
    >>> clock_seconds("2026/3/14 9:0:7") % 86400.0, clock_seconds("'26-03-14 09:00:07") % 86400.0
    (32407.0, 32407.0)
    >>> clock_seconds("2026/03/14/ 09:00:07::125") % 86400.0  # of Serial Studio
    32407.125
    >>> clock_seconds("2026-03-14 14:05") % 86400.0, clock_seconds("2:05 PM"), clock_seconds("2:05:00 PM")
    (50700.0, 50700.0, 50700.0)
    """
    text = _WITHOUT_SECONDS.sub(r"\g<0>:00", re.sub(r"\A'(?=\d\d[-/.]\d)", "20", text.strip()), count=1)
    text = _SHORT.sub(
        lambda m: m["date"] + ":".join(part.zfill(2) for part in m.groups()[-3:]), text, count=1
    )
    if found := _MINUTES.fullmatch(text):
        return int(found[1]) * 60.0 + float(found[2].replace(",", "."))
    if found := _COMPACT.fullmatch(text):
        year, month, day, hour, minute, second = found.groups()
        part = int(hour) * 3600.0 + int(minute) * 60.0 + float(second)
        days = _days(int(year), month, int(day))
        return None if days is None else days * _DAY_S + part
    found = _CLOCK.fullmatch(text)
    if not found:
        return None
    hour, half = int(found["h"]), (found["half"] or "").casefold()[:1]
    if half and not 1 <= hour <= 12:
        return None
    hour = hour % 12 + 12 * (half == "p") if half else hour
    seconds = float(re.sub("[,:]+", ".", found["s"]))
    if hour > 24 or int(found["m"]) > 59 or seconds > 61.0:
        return None
    of_day = hour * 3600.0 + int(found["m"]) * 60.0 + seconds
    if (zone := _OFFSET.search(text)) and (found["Y"] or found["a"]):  # of summer or winter, so it may change
        of_day -= (1.0 if zone[1] == "+" else -1.0) * (int(zone[2]) * 3600.0 + int(zone[3] or 0) * 60.0)
    if found["Y"]:
        days = _days(int(found["Y"]), found["M"], int(found["D"]))
    elif found["a"]:
        days = _of_other_order(found, day_first)
    else:
        return of_day
    return None if days is None else days * _DAY_S + of_day


def clock_times(texts: list[str]) -> list[float | None]:
    """Return times as of `clock_seconds`, in that order of day and month in which no day is left out.

    Examples
    --------
    >>> b, a = clock_times(["11/12/2026 23:59:59", "12/12/2026 00:00:01"])
    >>> a - b
    2.0
    """
    ways = [[clock_seconds(t, day_first) for t in texts] for day_first in (False, True)]
    if ways[0] == ways[1] or any(None in way for way in ways):
        return ways[0] if None not in ways[0] else ways[1]
    far = [
        max((abs(b - a) for a, b in itertools.pairwise(way) if a is not None and b is not None), default=0.0)
        for way in ways
    ]
    return ways[far[1] < far[0]]


def is_of_two(text: str) -> bool:
    """Return whether a field is of two whole numbers and a colon, as 14:05: hours and minutes, or minutes and s."""
    return re.fullmatch(r"\d{1,3}:[0-5]\d", text.strip()) is not None


def is_date(text: str) -> bool:
    """Return whether a field is a date without a time of day."""
    return re.fullmatch(_DATE, text.strip()) is not None


def is_value(cell: str, decimal: str) -> bool:
    """Return whether a field is a number, a time or a date."""
    return (
        number_of(cell, decimal) is not None
        or clock_seconds(cell) is not None
        or bool(re.fullmatch(_DATE, cell) or re.fullmatch(r"\d[\d:.\-T ]+Z?", cell))
    )


def array_of(text: str) -> list[Any] | None:
    """Return a field such as "[1, 2, null]" or "[1. 2. nan]" as a list, perhaps of lists; None where it is none."""
    if not (text.startswith(("[", "(")) and text.endswith(("]", ")"))):
        return None
    plain = text.replace("(", "[").replace(")", "]")
    plain = re.sub(r"\b(?:nan|none|null)\b", "null", plain, flags=re.IGNORECASE)
    plain = re.sub(r"(?<=[\d.l\]])\s+(?=[-+\d.n\[])", ", ", plain)  # as NumPy writes it
    plain = re.sub(r"(?<=\d)\.(?=\D)", ".0", re.sub(r"(?<=[\[\s,])\.(?=\d)", "0.", plain))
    try:
        found = json.loads(re.sub(r"[,;]\s*\]", "]", plain.replace(";", ",")))
    except (ValueError, RecursionError):
        return None
    return found if isinstance(found, list) and found else None


def _of_other_order(found: re.Match[str], day_first: bool) -> float | None:
    """Return the day of 4.3.2026, 04-Mar-26 or 3/4/2026 (of America, unless it cannot be)."""
    first, second = int(found["a"]), found["b"]
    year = int(found["y"]) + 2000 * (len(found["y"]) == 2)
    if found["mark"] == "/" and second.isdigit() and first <= 12 and not day_first:
        return _days(year, str(first), int(second)) or _days(year, second, first)
    return _days(year, second, first)


def _days(year: int, month: str, day: int) -> float | None:
    """Return days since 1970; None where there is no such day."""
    name = month.casefold()[:3]
    try:
        number = int(month) if month.isdigit() else _MONTHS.index(name) + 1
        return float(date(year, number, day).toordinal() - date(1970, 1, 1).toordinal())
    except ValueError:
        return None


def is_garbled(text: str) -> bool:
    """Return whether a text is one of another script that was decoded as Western: its letters stand in runs.

    Examples
    --------
    >>> is_garbled("\u00b8\u00df\u00b6\u00cb\u00b5\u00e7(V)"), is_garbled("Spannung \u00fcber R\u00f6hre [\u00b5V]")
    (True, False)
    """
    runs = re.findall("[\x80-\xff\u0152-\u02dc\u2013-\u20ac\u2122\ufffd]+", text)
    return any(len(r) > 2 for r in runs) and sum(map(len, runs)) >= _GARBLED_RUN * len(runs)
