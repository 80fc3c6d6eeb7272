"""What a column's name says: time, scan, strip, or a reading of a channel, of which strip, in which unit."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass, replace


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


_HIGH = _words("h hi high vh uh kh vhi vhigh uhigh hoch haut haute alto alta codeh adch rawh")
_LOW = _words("l lo low vl ul kl vlo vlow ulow tief niedrig bas basse bassa basso bajo baja codel adcl rawl")
_OUT = _words("out vout uout codeout")
# Pairs of channels whose names do not say which end they are of; the readings do (k_h >= k_l).
_PAIRS = (
    ("a", "b"), ("top", "bottom"), ("upper", "lower"), ("oben", "unten"), ("left", "right"), ("end", "start"),
    ("first", "second"), ("x", "y"), ("p", "q"), ("e1", "e2"),
)  # fmt: skip
_ONE_OF_PAIR = frozenset(name for pair in _PAIRS for name in pair)
_VALUE = _words(
    "v u value val reading voltage volt volts spannung wert messwert signal output level tension ain an analog in k "
    "data kanal ratio adc raw code codes count counts"
)
_STRIP = _words(
    "strip strips stripe streifen ch channel kanal sensor taxel line element row track bande electrode s col column "
    "pin tira striscia fascia stripid stripno sid"
)
_TIME = _words(
    "t time times zeit zeitstempel tempo heure hora ora timestamp millis "
    "micros elapsed seconds sec secs uhrzeit datetime temps tiempo clock stamp ts "
    "timems timeus ms"
)
_SCAN = _words(
    "scan frame sample samples n nr no index idx i messung cycle seq sequence scanno messnr count sweep id frameno "
    "scanid unnamed"
)
_WHICH = _words("signature kind end type which side seite level measurement meas signal phase")
_BESIDE = _words("no nr number nummer id idx index")  # beside another word, they say nothing more
UNITS = {
    word: unit
    for unit, alike in {
        "s": "s sec secs seconds second sekunden", "ms": "ms msec millis milliseconds",
        "us": "us µs usec micros microseconds",
        "min": "min minutes", "ns": "ns", "V": "v volt volts", "mV": "mv millivolt millivolts",
        "percent": "% percent pct prozent", "code": "code codes adc raw counts count lsb digits digit dn",
        "fraction": "ratio fraction norm normalised normalized", "mm": "mm", "cm": "cm", "m": "m",
    }.items()
    for word in alike.split()
}  # fmt: skip
_ANY = _HIGH | _LOW | _OUT | _ONE_OF_PAIR | _VALUE | _STRIP | _BESIDE | frozenset(UNITS)
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0}
READING_UNITS = ("V", "mV", "code", "fraction", "percent")


@dataclass(frozen=True)
class Meaning:
    """What a column probably is.

    Attributes
    ----------
    role
        "time", "scan", "strip", "reading", "which" (a column that says of which channel a line is), "position", or ""
        where the name says nothing.
    channel
        Of a reading: "h", "l", "out", a name of one of two channels, or "" where the name does not say.
    strip
        Number in the name, of a reading; None where there is none.
    unit
        "" where the name does not say.
    """

    role: str
    channel: str = ""
    strip: int | None = None
    unit: str = ""


def meaning(name: str) -> Meaning:
    """Interpret a column's name.

    Examples
    --------
    >>> meaning("U_h03 [mV]")
    Meaning(role='reading', channel='h', strip=3, unit='mV')
    >>> meaning("Zeit (ms)").role, meaning("remark").role
    ('time', '')
    """
    tokens, unit = _tokens(name)
    numbers = [int(t) for t in tokens if t.isdigit()]
    words = [t for t in tokens if not t.isdigit()]
    named = set(words)
    if not numbers:
        unit = unit or next((UNITS[w] for w in words if w in UNITS and w != "v"), "")
        if named & {"x", "pos", "position"} and unit in ("mm", "cm", "m", "") and not named & _VALUE:
            return Meaning("position", unit=unit)
        core = [w for w in words if w not in _BESIDE] or words
        if any(w in _TIME for w in core) and not named & (_HIGH | _LOW) - {"h", "l"}:
            return Meaning("time", unit=unit if unit in TIME_UNITS else "")
        if core and all(w in _STRIP for w in core) and core != ["line"]:
            return Meaning("strip")
        if core and all(w in _SCAN for w in core):
            return Meaning("scan")
    if not words and len(numbers) == 1:
        return Meaning("reading", strip=numbers[0])
    read = Meaning("reading", unit=unit if unit in READING_UNITS else "")
    if not read.unit:
        told = [UNITS[w] for w in words if w in UNITS and UNITS[w] in READING_UNITS and w not in ("v",)]
        read = replace(read, unit="fraction" if named & {"k", "kh", "kl"} else (told or [""])[0])
    if len(numbers) > 1 or not words or not named <= _ANY:
        return Meaning("which") if named & _WHICH and not numbers else Meaning("")
    strip = numbers[0] if numbers else None
    ends = ["h"] * bool(named & _HIGH) + ["l"] * bool(named & _LOW) + ["out"] * bool(named & _OUT)
    if len(ends) == 1:
        return replace(read, channel=ends[0], strip=strip)
    if ends:
        return Meaning("")
    if (pair := named & _ONE_OF_PAIR) and len(pair) == 1:
        return replace(read, channel=pair.pop(), strip=strip)
    if strip is not None or named & _VALUE:
        return replace(read, strip=strip)
    return Meaning("which") if named & _WHICH else Meaning("")


def pair_of(channels: set[str]) -> tuple[str, str] | None:
    """Return two channels whose names do not say which is which, if these are just a pair."""
    return next((pair for pair in _PAIRS if channels == set(pair)), None)


def _tokens(name: str) -> tuple[list[str], str]:
    """Return a name's words and numbers in lower case, and the unit in brackets or after a slash."""
    plain = "".join(c for c in unicodedata.normalize("NFKD", name) if not unicodedata.combining(c))
    bracket = re.search(r"[\[(]\s*([^\])]*?)\s*[\])]", plain)
    unit = UNITS.get(bracket.group(1).casefold().replace("μ", "µ"), "") if bracket else ""
    if bracket:
        plain = plain.replace(bracket.group(0), " ") if not bracket.group(1).isdigit() else plain
    slash = re.search(r"/\s*(\w+|%)\s*$", plain)
    if slash and slash.group(1).casefold() in UNITS:
        unit, plain = unit or UNITS[slash.group(1).casefold()], plain[: slash.start()]
    plain = plain.replace("mV", "mv")  # no two words
    plain = re.sub(r"([a-z])([A-Z])", r"\1 \2", plain).casefold()
    tokens = re.findall(r"[a-zµ]+|\d+|%", plain)
    if not unit and len(tokens) > 1 and tokens[-1] in ("mv", "ms", "us", "pct", "%"):
        unit = UNITS[tokens.pop()]
    return tokens, unit
