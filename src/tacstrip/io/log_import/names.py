"""What a column's name says: time, scan, strip, or a reading of a channel, of which strip, in which unit."""

from __future__ import annotations

import itertools
import re
import unicodedata
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

from tacstrip.io.log_import.words import names_of, translated


def seconds_of(unit: str) -> float:
    """Return the seconds of a unit of time, or of a timer's tick; NaN where it is none.

    Examples
    --------
    >>> seconds_of("ms"), seconds_of("2.5ms"), seconds_of("1/1024s"), seconds_of("2.5")
    (0.001, 0.0025, 0.0009765625, nan)
    """
    tick = _TICKS.fullmatch(unit)
    if not tick:
        return TIME_UNITS.get(unit, float("nan"))
    return float(tick[1]) / float(tick[2] or 1.0) * TIME_UNITS[tick[3]]


def _words(kind: str) -> frozenset[str]:
    return frozenset(names_of(kind))


_QUANTITY = ("", "v", "u", "k", "code", "adc", "raw", "val", "volt", "s", "sig")
_HIGH = _words("high") | {q + e for q in _QUANTITY for e in ("h", "hi", "high")}
_LOW = _words("low") | {q + e for q in _QUANTITY for e in ("l", "lo", "low")}
_OUT = _words("output")
# Pairs of channels whose names do not say which end they are of; the readings do (k_h >= k_l).
_PAIRS = tuple((a, b) for a, _, b in (pair.partition("/") for pair in names_of("pairs")))
SIDES = tuple(pair for pair in _PAIRS if pair[0] in names_of("left"))
_ONE_OF_PAIR = frozenset(name for pair in _PAIRS for name in pair)
_VOLTS = _words("voltage") | {q + e for q in "vu" for e in ("h", "hi", "high", "l", "lo", "low")}
_VALUE = _VOLTS | _words("value")
_STRIP = _words("strip")
_INPUTS = _words("inputs")
_ABBREVIATED = 3  # letters of a word that may be anything in prose
_TIME = _words("time")
_SCAN = _words("scan")
_WHICH = _words("channel")
_BESIDE = _words("number")  # beside another word, they say nothing more
_FILLER = _words("beside_a_reading")
# Of what is said beside a mean, and is none.
_SPREAD = _words("spread")
_MEAN, _EXTREMES = _words("mean"), _words("extremes")
_STATISTICS = _MEAN | _EXTREMES
_DERIVED = _words("derived")
# Of other scripts, the words that logs have.
_TRANSLATED = {word: f" {english} " for english, alike in translated().items() for word in alike}
OTHER_SCRIPT = re.compile("|".join(sorted(_TRANSLATED, key=len, reverse=True)))
_CYRILLIC = {
    "\u043c\u043a\u0412": "uV", "\u043c\u0412": "mV", "\u0412": "V", "\u043c\u043a\u0441": "us", "\u043c\u0441": "ms",
    "\u0441": "s", "\u043c\u0438\u043d": "min",
}  # fmt: skip
# In brackets, or behind a number, a comma or a slash: elsewhere two of them are words.
_CYRILLIC_UNIT = re.compile(
    rf"([\[(,/\d]\s*)({'|'.join(sorted(_CYRILLIC, key=len, reverse=True))})(?=\s*(?:[\])]|\Z))"
)
_UNCOMBINED = str.maketrans(
    "\u0142\u0141\u00f8\u00d8\u0111\u0131", "lLoOdi"
)  # letters that are none with a mark
UNITS = {
    word: unit
    for unit, alike in {
        "s": "s sec secs seconds second sekunden sekunde seg segundos secondes secondi seconden sek",
        "ms": "ms msec msecs millis milliseconds",
        "us": "us µs usec usecs micros microseconds",
        "min": "min minutes", "ns": "ns nsec nsecs nanoseconds", "V": "v volt volts vdc dcv",
        "mV": "mv millivolt millivolts mvdc",
        "uV": "uv µv microvolt microvolts", "cV": "cv centivolt centivolts", "dV": "dv decivolt decivolts",
        "percent": "% percent pct prozent", "permille": "‰ permille permil promille",
        "code": "code codes adc raw counts count cnt lsb digits digit dig bit bits dn",
        "fraction": "ratio fraction frac ratiometric norm normalised normalized", "mm": "mm", "cm": "cm", "m": "m",
    }.items()
    for word in alike.split()
}  # fmt: skip
_LAST = frozenset(UNITS) - {
    "count",
    "counts",
    "bit",
    "bits",
    "dig",
    "second",
    "norm",
    "ratio",
    "fraction",
    "frac",
    "ratiometric",
    "raw",
    "adc",
    "code",
    "codes",
}
_ANY = _HIGH | _LOW | _OUT | _ONE_OF_PAIR | _VALUE | _STRIP | _BESIDE | frozenset(UNITS)
_KNOWN = _ANY | _TIME | _SCAN | _WHICH
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0, "days": 86400.0}
_TICKS = re.compile(rf"(\d+(?:\.\d+)?)(?:/([1-9]\d*))?\s?({'|'.join(TIME_UNITS)})")
CLOCKS = ("clock", "hh:mm", "mm:ss")  # of times of day and dates; of 14:05, which of both it is
READING_UNITS = ("V", "mV", "uV", "code", "fraction", "percent", "permille", "cV", "dV")
CHANNELS = ("h", "l", "out")
_LONG_TIMES = {
    "h": "h",
    "hr": "h",
    "hrs": "h",
    "hour": "h",
    "hours": "h",
    "d": "days",
    "day": "days",
    "days": "days",
}
_IN_NAMES = (
    UNITS | {"vref": "fraction"} | {w: u for w, u in _LONG_TIMES.items() if w != "h"}
)  # in brackets or after /
# As in "VH_over_Vref_1" and "Uh/Uref 1".
_OVER_REFERENCE = re.compile(
    r"(?:(?:[\s_.-]+|(?<=[a-z\d]))(?:[Oo]ver|[Pp]er|[Oo]f|[Bb]y|durch|sur|rel(?:ative)?[\s_]+to)[\s_.-]*|\s*/\s*)"
    r"(?i:[vua]_?ref|v_?(?:cc|dd)|avdd|supply)(?![A-Za-z])"
)
# In brackets, what is a unit of something else, or a factor.
_FOREIGN = re.compile(
    r"(?:[pnu\u00b5mkMh]?(?:[Oo]hms?|\u03a9|\u2126|Amps?|Hz|Pa|F|W|N|A|S)|kV|[mkn]?g|[mckn]m|psi|m?bar|[mk]?gf|lbf?|oz|atm|Torr|mmHg"
    r"|dBm?|(?:\u00b0|deg\.? ?)[CFK]?|deg(?:rees?)?|Celsius|Fahrenheit|Kelvin|[KCJT]|cd|lu?x|rpm|%RH|N/\S+"
    r"|a\.?u\.?|[a-z]?ticks?)\Z"
    r"|\d+(?:\.\d+)?(?:e[+-]?\d+)?\s*[A-Za-z\u00b5%]+\Z|(?=.*(?:[A-Za-z]|10)).*[/*x\u00d7\u00f7]\s*\d+"
)
_FACTOR = re.compile(r"(?<![A-Za-z\d])[x*\u00d7/\u00f7]\s?10+(?!\d)")
# Behind an underscore, a space or a number, what no word of a name is.
_FOREIGN_LAST = re.compile(
    r"(?:[_ ]|(?<=\d))((?:deg_?|\u00b0)[CFK]|[um\u00b5]A|[kMhm]?Pa|m?bar|psi|[km]?[Oo]hms?|m?N|[mk]?gf|[pnu]F"
    r"|k?Hz|kV)\Z"
)
IN_VOLTS = {"V": 1.0, "mV": 1e-3, "uV": 1e-6, "cV": 1e-2, "dV": 1e-1}
OF_VREF = {"fraction": 1.0, "percent": 1e-2, "permille": 1e-3}
LENGTHS_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0}


_NUMBER_OF = frozenset({"n", "id", "no", "nr", "num", "number", "index", "idx", "i", "name", "label"})
_MOST_STRIPS = 99999  # a larger number in a name is none of a strip
_CALLED_K = re.compile(r"(?:strip|s)?[\W\d_]*k[\W\d_]*(?:h|l|hi|lo|high|low)?[\W\d_]*", re.IGNORECASE)
_PLACE = re.compile(r" \(column \d+\)\Z")  # of one of several columns of a name
_LABELLED = re.compile(r"\d+ <([^<>]+)> (\([^()]*\))")  # as instruments write an input, its label and unit
_NAMELESS = re.compile(r"column \d+")  # what a log without names is given


@dataclass(frozen=True)
class Meaning:
    """What a column probably is.

    Attributes
    ----------
    role
        "time", "scan", "strip", "reading", "which" (a column that says of which channel a line is), "position", or ""
        where the name says nothing.
    channel
        Of a reading: "h", "l", "out", a name or number of one of two channels, or "" where the name does not say.
    strip
        Number in the name, of a reading; None where there is none.
    unit
        "" where the name does not say.
    volts
        Whether a reading is called a voltage.
    """

    role: str
    channel: str = ""
    strip: int | None = None
    unit: str = ""
    volts: bool = False


@lru_cache(maxsize=2**12)
def is_strip_word(word: str) -> bool:
    """Whether a word of prose is one of strips, and not one that instruments have for their inputs, too."""
    low = word.casefold()
    return len(low) > _ABBREVIATED and low in _STRIP and low not in _INPUTS


@lru_cache(maxsize=2**12)
def meaning(name: str) -> Meaning:
    """Interpret a column's name.

    Examples
    --------
    >>> meaning("U_h03 [mV]")
    Meaning(role='reading', channel='h', strip=3, unit='mV', volts=True)
    >>> meaning("Zeit (ms)").role, meaning("x_cm").unit, meaning("remark").role
    ('time', 'cm', '')
    """
    return Meaning("") if _NAMELESS.fullmatch(name) else _of_tokens(*_tokens(name))


def meanings(names: Sequence[str]) -> dict[str, Meaning]:
    """Interpret the names of a table together: what all share says nothing, nor a number that is always the same.

    Where a mean stands beside the extremes of the same quantity, only the mean is a reading.

    Examples
    --------
    >>> [m.strip for m in meanings(["t", "Dev1/ai0", "Dev1/ai1"]).values()]
    [None, 0, 1]
    >>> [(m.strip, m.channel) for m in meanings(["S1_1", "S1_2", "S2_1", "S2_2", "S3_1", "S3_2"]).values()][2:4]
    [(2, '1'), (2, '2')]
    >>> [m.role for m in meanings(["h_mean", "h_min", "h_max"]).values()]
    ['reading', '', '']
    """
    return dict(_meanings(tuple(names)))


@lru_cache(maxsize=2**6)  # of one table they are asked for at every step
def _meanings(names: tuple[str, ...]) -> dict[str, Meaning]:
    alike: dict[tuple[str, ...], list[str]] = {}
    for name in names:
        alike.setdefault(tuple(t for t in _tokens(name)[0] if t not in _STATISTICS), []).append(name)
    means = [(group, [n for n in group if _MEAN & {*_tokens(n)[0]}]) for group in alike.values()]
    others = [n for group, mean in means if len(mean) == 1 for n in group if n not in mean and _is_extreme(n)]
    found = _together([n for n in names if n not in others])
    return {n: found.get(n, Meaning("")) for n in names}


def _parts_of_records(names: Sequence[str]) -> dict[str, str]:
    """Return the last part of names of one record, such as "readings.strip" and "readings.vHigh", if that tells all."""
    records: dict[str, list[str]] = {}
    for name in names:
        records.setdefault(name.rpartition(".")[0], []).append(name)
    last = {n: n.rpartition(".")[2] for record, found in records.items() if record for n in found}
    last |= {  # as in "strip.n"
        n: "strip"
        for n, part in last.items()
        if part.casefold() in _NUMBER_OF and meaning(n.split(".")[-2]).role == "strip"
    }
    return {
        n: last[n]
        for record, found in records.items()
        if record and {"strip", "reading"} <= {meaning(last[n]).role for n in found}
        for n in found
    }


def _labelled_inputs(names: Sequence[str]) -> dict[str, str]:
    """Return the labels of names such as "101 <Strip A hi> (VDC)", without the inputs' numbers, if they have none."""
    found = {n: m for n in names if (m := _LABELLED.fullmatch(n))}
    labels = {n: f"{m[1]} {m[2]}" for n, m in found.items() if not re.search(r"\d", m[1])}
    return labels if len({*labels.values()}) == len(labels) > 1 else {}


def _is_extreme(name: str) -> bool:
    return bool(_EXTREMES & {*re.findall(r"[a-z]+", name.casefold())})


def _together(names: Sequence[str]) -> dict[str, Meaning]:
    """Return what names mean, of which none is of an extreme."""
    parts = _parts_of_records(names) | _labelled_inputs(names)
    split = {name: _tokens(parts.get(name, name)) for name in names}
    split |= _with_first(split)
    alike = Counter(
        t for tokens, _ in split.values() for t in set(tokens) if not t.isdecimal() and t not in _ANY
    )
    shared = {t for t, many in alike.items() if many > 1 and 2 * many >= len(names)} - _SPREAD
    shared |= _end_of_both(split)
    split = {name: ([t for t in ts if t not in shared] or ts, u) for name, (ts, u) in split.items()}
    split = _with_letters(split)
    found = {n: meaning(n) if _NAMELESS.fullmatch(n) else _of_tokens(*tokens) for n, tokens in split.items()}
    roles = {m.role for m in found.values()}
    last = {
        n: meaning(n.rpartition(".")[2])
        for n, m in found.items()
        if not m.role and re.search(r"\.[^\W\d]\w*\Z", n)
    }
    found |= {n: m for n, m in last.items() if m.role and m.role not in roles}  # as in "tags.strip"
    if any(
        m.channel == "b" and m.strip is not None for m in found.values()
    ):  # then a1, a2, ... are no analog pins
        found |= {
            n: replace(m, channel="a") for n, m in found.items() if "a" in split[n][0] and m.strip is not None
        }
    slots = {n: [int(t) for t in ts if t.isdecimal()] for n, (ts, _) in split.items()}
    most = Counter(len(numbers) for numbers in slots.values() if len(numbers) > 1)
    several = [n for n, numbers in slots.items() if most and len(numbers) == most.most_common(1)[0][0]]
    if len(several) < 2:
        return found
    kinds = [{*place} for place in zip(*(slots[n] for n in several), strict=True)]
    varying = [place for place, values in enumerate(kinds) if len(values) > 1]
    grids = [_in_a_grid(several, split, slots, place) for place in varying]
    if len(varying) > 1 and sum(map(bool, grids)) == 1:  # as in "101 <VH1>", "Mod2/strip3_hi"
        return found | next(filter(None, grids))
    pairs = {tuple(slots[n][place] for place in varying) for n in several}
    if len(varying) == 2 and len(kinds[varying[0]]) == len(kinds[varying[1]]) == len(
        pairs
    ):  # as in "101 <strip 1>"
        varying = [max(varying, key=lambda place: (min(kinds[place]) < 2, place))]
    if len(varying) == 1 or (len(varying) == 2 and len(kinds[varying[1]]) == 2 < len(kinds[varying[0]])):
        for name in several:
            tokens = [t for t in split[name][0] if not t.isdecimal()]
            read = _of_tokens([*tokens, str(slots[name][varying[0]])], split[name][1])
            if read.role == "reading" and len(varying) == 2 and not read.channel:
                read = replace(read, channel=str(slots[name][varying[1]]))
            found[name] = read
    return found


def _in_a_grid(
    names: Sequence[str],
    split: Mapping[str, tuple[list[str], str]],
    slots: Mapping[str, list[int]],
    place: int,
) -> dict[str, Meaning]:
    """Return readings if with the number in that place each strip has the same channels, one of each; else none."""
    read = {
        n: _of_tokens([*(t for t in split[n][0] if not t.isdecimal()), str(slots[n][place])], split[n][1])
        for n in names
    }
    strips: dict[int | None, list[str]] = {}
    for m in read.values():
        strips.setdefault(m.strip if m.role == "reading" else None, []).append(m.channel)
    full = {tuple(sorted(channels)) for channels in strips.values()}
    channels = full.pop()
    numbers = sorted(s for s in strips if s is not None)
    counted = numbers == list(range(numbers[0], numbers[0] + len(strips))) if numbers else False
    return read if not full and counted and len(set(channels)) == len(channels) and len(strips) > 1 else {}


def _end_of_both(split: Mapping[str, tuple[list[str], str]]) -> set[str]:
    """Return words of an end, as French "haut", that stand in all names with a number, which name both ends besides."""
    words = [{*tokens} for tokens, _ in split.values() if any(t.isdecimal() for t in tokens)]
    common = set.intersection(*words) & (_HIGH | _LOW) if len(words) > 1 else set()
    rest = set().union(*words) - common
    return common if rest & _HIGH and rest & _LOW else set()


def _with_first(split: Mapping[str, tuple[list[str], str]]) -> dict[str, tuple[list[str], str]]:
    """Return the tokens of a name without a number, which others have from 1 on, with 0, as LabVIEW's."""
    numbers: dict[tuple[tuple[str, ...], str], set[int]] = {}
    for tokens, unit in split.values():
        if tokens and tokens[-1].isdecimal():
            numbers.setdefault((tuple(tokens[:-1]), unit), set()).add(int(tokens[-1]))
    counted = {
        key for key, there in numbers.items() if there == set(range(1, len(there) + 1)) and len(there) > 1
    }
    first = {n: found for n, found in split.items() if (tuple(found[0]), found[1]) in counted}
    first = {n: found for n, found in first.items() if _of_tokens(*found).role == "reading"}
    return {n: ([*tokens, "0"], unit) for n, (tokens, unit) in first.items()}


def _with_letters(split: dict[str, tuple[list[str], str]]) -> dict[str, tuple[list[str], str]]:
    """Return tokens with numbers in place of letters that count, as in "A", "B", "C" or "AH", "AL", "BH", ..."""
    apart = {
        n: [p for t in ts for p in (t if re.fullmatch("[a-z][hl]", t) else [t])]
        for n, (ts, _) in split.items()
    }
    for tokens in ({n: ts for n, (ts, _) in split.items()}, apart):
        groups: dict[tuple[int, tuple[str, ...]], dict[str, str]] = {}
        for name, ts in tokens.items():
            for place, token in enumerate(ts):
                if re.fullmatch("[a-z]", token) and not any(t.isdecimal() for t in ts):
                    groups.setdefault((place, (*ts[:place], *ts[place + 1 :])), {})[token] = name
        runs = {k: dict(_from_a(group)) for k, group in groups.items()}
        if counted := {k: run for k, run in runs.items() if len(run) > 2}:
            numbers = {n: (k[0], at) for k, g in counted.items() for at, n in enumerate(g.values())}
            return split | {
                n: ([*tokens[n][:place], str(at), *tokens[n][place + 1 :]], split[n][1])
                for n, (place, at) in numbers.items()
            }
    # Letters of three strips or more, each with the same two numbers, as in "A1", "A2", "B1", ...
    lettered = {
        n: (ts[-2], ts[-1]) for n, (ts, _) in split.items() if re.fullmatch(r".*\b[a-z] \d+", " ".join(ts))
    }
    first, second = ({pair[k] for pair in lettered.values()} for k in (0, 1))
    run = len(dict(_from_a(dict.fromkeys(first, "x"))))
    if len(first) == run > 2 == len(second) and len(lettered) == len({*lettered.values()}) == 2 * run:
        return split | {
            n: ([*split[n][0][:-2], str(sorted(first).index(pair[0])), pair[1]], split[n][1])
            for n, pair in lettered.items()
        }
    return split


def _from_a(group: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    """Return the letters from A on without a gap, but for I, J, O and Q, which many leave out."""
    letters = [c for c in "abcdefghijklmnopqrstuvwxyz" if c in group or c not in "ijoq"]
    return itertools.takewhile(lambda item: item[1], ((c, group.get(c, "")) for c in letters))


def numbered_groups(names: Sequence[str]) -> list[dict[int, str]]:
    """Return columns whose names are the same but for one number, by that number.

    Examples
    --------
    >>> numbered_groups(["t", "pad 1 near", "pad 1 far", "pad 2 near", "pad 2 far"])
    [{1: 'pad 1 near', 2: 'pad 2 near'}, {1: 'pad 1 far', 2: 'pad 2 far'}]
    """
    groups: dict[tuple[str, ...], dict[int, str]] = {}
    for name in names:
        tokens, unit = _tokens(name)
        numbers = [int(t) for t in tokens if t.isdecimal()]
        if len(numbers) == 1:
            groups.setdefault((unit, *(t for t in tokens if not t.isdecimal())), {})[numbers[0]] = name
    return [group for group in groups.values() if len(group) > 1]


def _of_tokens(tokens: list[str], unit: str) -> Meaning:
    numbers = [int(t) for t in tokens if t.isdecimal()]
    words = [t for t in tokens if not t.isdecimal()]
    words = [w for w in words if w not in _FILLER] or words
    if any(n > _MOST_STRIPS for n in numbers):
        return Meaning("")
    named = set(words)
    if not numbers:
        unit = unit or next((UNITS[w] for w in words if w in UNITS and w != "v"), "")
        if named == {"x", "value"} or (
            "x" in named and named <= {"x", "axis"} and unit in TIME_UNITS
        ):  # as LabVIEW and scopes write
            return Meaning("time", unit=unit or "s")
        if named & {"x", "pos", "position"} and unit in (*LENGTHS_MM, "") and not named & _VALUE:
            return Meaning("position", unit=unit)
        core = [w for w in words if w not in _BESIDE] or words
        if any(w in _TIME for w in core) and not named & (_HIGH | _LOW) - {"h", "l"}:
            long = next((_LONG_TIMES[w] for w in words if w in _LONG_TIMES), "")
            return Meaning("time", unit=unit if unit in TIME_UNITS else long)
        if core and all(w in _STRIP for w in core) and core != ["line"]:
            return Meaning("strip")
        if core and all(w in _SCAN for w in core) and unit not in READING_UNITS:
            return Meaning("scan")
    volts = bool(named & _VOLTS)
    read = Meaning("reading", unit=unit if unit in READING_UNITS else "", volts=volts)
    if not words and len(numbers) == 1:
        return replace(read, strip=numbers[0])
    if not read.unit:
        told = [UNITS[w] for w in words if w in UNITS and UNITS[w] in READING_UNITS and w not in ("v",)]
        read = replace(read, unit="fraction" if named & {"k", "kh", "kl"} else (told or [""])[0])
    if len(numbers) > 1 or not words or not named <= _ANY:
        role = "which" if named & _WHICH and not numbers else ""
        return Meaning(role, unit=read.unit if unit else "")  # a unit that stands apart says what is held
    strip = numbers[0] if numbers else None
    ends = ["h"] * bool(named & _HIGH) + ["l"] * bool(named & _LOW) + ["out"] * bool(named & _OUT)
    if len(ends) == 1:
        return replace(read, channel=ends[0], strip=strip)
    if ends:
        return Meaning("")
    pair = named & _ONE_OF_PAIR
    pair = pair - {"u"} if len(pair) > 1 else pair  # a voltage, as in U_oben
    if len(pair) == 1 and not (words == ["a"] and strip is not None):  # A3 is an analog pin
        return replace(read, channel=pair.pop(), strip=strip)
    of_unit = all(w in _LAST and UNITS[w] in READING_UNITS for w in words)  # as a column "mv"
    if strip is not None or named & _VALUE or of_unit:
        return replace(read, strip=strip)
    return Meaning("which") if named & _WHICH else Meaning("")


def unit_in(name: str) -> str:
    """Return the unit that a name says, in brackets, after a slash, or last; "" where it says none that is known."""
    return _tokens(name)[1]


def unknown_unit(name: str) -> str:
    """Return what stands as a unit in a name and is none of a reading or a time, or a factor; "" where nothing does.

    Examples
    --------
    >>> unknown_unit("h0 [mA]"), unknown_unit("t [10 ms]"), unknown_unit("vh[3] (V)"), unknown_unit("S1 (left)")
    ('mA', '10 ms', '', '')
    >>> unknown_unit("T0 [degF]"), unknown_unit("s0_kPa"), unknown_unit("s0_cV")
    ('degF', 'kPa', '')
    """
    for square, round_ in re.findall(r"\[\s*([^\]]*?)\s*\]|\(\s*([^)]*?)\s*\)", name):
        inner = square or round_
        known = _IN_NAMES.get(inner.lower(), "")
        if known in READING_UNITS or known in TIME_UNITS:
            continue
        if (
            (square or len(inner) > 1)
            and not inner.lower().endswith(("bit", "bits"))
            and _FOREIGN.match(inner)
        ):
            return str(inner)
    bare = re.sub(r"[\[(].*?[\])]", " ", name)
    last = _FOREIGN_LAST.search(bare.strip())
    factor = _FACTOR.search(bare)
    return last[1] if last else factor.group() if factor else ""


def is_other_unit(unit: str) -> bool:
    """Return whether a text is the unit of a quantity that is neither a reading nor a time, as temperatures are in.

    Examples
    --------
    >>> is_other_unit("degC"), is_other_unit("m/s2"), is_other_unit("mV"), is_other_unit("raw")
    (True, True, False, False)
    """
    known = _IN_NAMES.get(unit.lower(), "") or UNITS.get(unit, "")
    return (
        known not in READING_UNITS
        and known not in TIME_UNITS
        and bool(
            _FOREIGN.match(unit)
            or re.fullmatch(r"[nmk]?[A-Za-z]{1,3}[/\u00b7][A-Za-z]{1,3}[\d\u00b2\u00b3^]*", unit)
        )
    )


def with_latin_units(text: str) -> str:
    """Return a text with units of Cyrillic letters as others write them.

    Examples
    --------
    >>> with_latin_units("U, \u043c\u0412"), with_latin_units("t [\u0441]"), with_latin_units("1497 \u043c\u0412")
    ('U, mV', 't [s]', '1497 mV')
    """
    return _CYRILLIC_UNIT.sub(lambda m: m[1] + _CYRILLIC[m[2]], text)


def is_called_k(name: str) -> bool:
    """Return whether the letter k is all that makes a column one of fractions, as in "k0" or "k_h 3".

    Examples
    --------
    >>> is_called_k("k3_h"), is_called_k("k0 [fraction]")
    (True, False)
    """
    return bool(_CALLED_K.fullmatch(name))


def derived_words(name: str) -> frozenset[str]:
    """Return the words of a name by which it holds something made of readings, or measured beside them.

    Examples
    --------
    >>> derived_words("index diff [V]"), derived_words("index high [V]")
    (frozenset({'diff'}), frozenset())
    """
    return _DERIVED & {*re.findall(r"[a-z]+", name.lower())}


def pair_of(channels: set[str]) -> tuple[str, str] | None:
    """Return two channels whose names do not say which is which, if these are just a pair."""
    numbers = sorted(int(c) for c in channels if c.isdecimal())
    if len(channels) == 2 and len(numbers) == 2 and numbers[1] == numbers[0] + 1:
        return str(numbers[0]), str(numbers[1])
    return next((pair for pair in _PAIRS if channels == set(pair)), None)


def end_beside(channels: set[str]) -> str:
    """Return which end a word of a pair is of, beside h or l; "" where it is of none, or of the same.

    Examples
    --------
    >>> end_beside({"upper", "l"}), end_beside({"lower", "l"}), end_beside({"x", "h"})
    ('h', '', '')
    """
    lack = "h" if "l" in channels else "l"
    words = {pair[lack == "l"] for pair in _PAIRS if len(pair[0]) > 1}
    return lack if channels - {"h", "l"} <= words and channels & {"h", "l"} else ""


def _singular(word: str) -> str:
    return (
        word[:-1]
        if len(word) > 2 and word.endswith("s") and word not in _KNOWN and word[:-1] in _KNOWN
        else word
    )


@lru_cache(maxsize=2**16)
def _tokens(name: str) -> tuple[list[str], str]:
    """Return a name's words and numbers in lower case, and the unit in brackets, after a slash, or last."""
    name = with_latin_units(_PLACE.sub("", name))
    name = OTHER_SCRIPT.sub(lambda m: _TRANSLATED[m[0]], name).translate(_UNCOMBINED)
    plain = "".join(c for c in unicodedata.normalize("NFKD", name) if not unicodedata.combining(c))
    plain = re.sub(r"\u00b1|\+/-", " plusminus ", plain.replace("\u03bc", "\u00b5"))
    unit = ""
    for bracket in re.finditer(r"[\[(]\s*([^\])]*?)\s*[\])]", plain):
        inner = bracket.group(1).lower()
        unit = unit or _IN_NAMES.get(inner, "") or _IN_NAMES.get(inner.rpartition(" in ")[2], "")
        if (
            not re.search(r"\d", inner) and inner not in _HIGH | _LOW | _OUT | _ONE_OF_PAIR
        ):  # as in analogRead(H)
            plain = plain.replace(bracket.group(0), " ")
    slash = re.search(r"[/,]\s*(\w+|%)\s*$", plain)
    if slash and slash.group(1).lower() in _IN_NAMES:
        unit, plain = unit or _IN_NAMES[slash.group(1).lower()], plain[: slash.start()]
    plain, ratios = _OVER_REFERENCE.subn(" ", plain)
    unit = unit or ("fraction" if ratios else "")
    plain = re.sub("[mcdu\u00b5]V", lambda unit: unit[0].lower(), plain).replace(
        "mSec", "msec"
    )  # no two words
    plain = re.sub(r"(?<=\w)([+-])\s*$", lambda sign: " plus" if sign[1] == "+" else " minus", plain)
    plain = re.sub(r"([a-z])([A-Z])", r"\1 \2", plain).lower()
    tokens = [_singular(t) for t in re.findall(r"[a-zµ]+|\d+|%", plain)]
    if not unit and len(tokens) > 1 and tokens[-1] in _LAST:
        unit = UNITS[tokens.pop()]
    return tokens, unit
