"""Nested records as a table of a line per strip: keys and places say strip and channel, wherever in a path."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from tacstrip.io.log_import.fields import clock_seconds, number_of, says_nothing
from tacstrip.io.log_import.names import READING_UNITS, UNITS, meaning, pair_of
from tacstrip.io.log_import.table import Table, said_above, text_of

Path = tuple[str | int, ...]
_NUMBERED = re.compile(r"(?:[A-Za-z]+[ _#-]?)?(\d{1,4})")  # a strip's key: "3", "strip3", "S_03"
_WHOLE = re.compile(r"[+-]?\d+(?:\.\d+)?")  # a key that is a number, as a scan's
_NUMBER_OF_STRIP = re.compile(
    r"(?:strips?|sensor|taxel|channel|ch|line|lane|zone|streifen|bande|banda|tira|fita|striscia|s)?[ _]?"
    r"(?:id|idx|index|no?|nr|num|number|nummer|numero|i)?", re.IGNORECASE,
)  # fmt: skip
_TOUCHES = re.compile(r"touch|contact|press|active|ber\u00fchrt|kontakt", re.IGNORECASE)
_UNIT = re.compile(r"units?|einheit(?:en)?|unidad(?:es)?|unit\u00e9s?|eenheid", re.IGNORECASE)
_NO = ("0", "false", "no", "none")
_SECONDS = re.compile(r"(?:tv_)?s(?:ec(?:ond)?s?)?", re.IGNORECASE)
_PARTS = {
    9: re.compile(r"(?:tv_)?n(?:ano)?_?s(?:ec(?:ond)?s?)?|nanos", re.IGNORECASE),
    6: re.compile(r"(?:tv_)?u_?s(?:ec(?:ond)?s?)?|micros?(?:ec(?:ond)?s?)?", re.IGNORECASE),
    3: re.compile(r"m_?s(?:ec(?:ond)?s?)?|millis?(?:ec(?:ond)?s?)?", re.IGNORECASE),
}  # digits that they have
_DEEPEST = 32
_FEW_VALUES = 12  # of a word: senders or units
_SHOWN = 6  # lines that are named


@dataclass(frozen=True)
class _Reading:
    """A leaf that holds, or stands for, what a strip reads."""

    base: Path  # of its scan
    strip: str | int
    channel: str  # "h", "l", or "" where it only says that the strip is there
    key: str  # that names the channel
    form: str
    value: str = ""


def of_tree(documents: Sequence[tuple[int, Any]], said: Sequence[str], told: str) -> Table | None:
    """Return nested records as a table, in which a strip that is there without readings is untouched.

    None where they do not tell strip and channel of each reading in one way, or are flat: a table of another reader.

    Parameters
    ----------
    documents
        Line and value of each.
    said
        What stands around them.
    told
        What they are, for the table's remarks.
    """
    leaves = [(n, path, value) for n, (_, doc) in enumerate(documents) for path, value in _leaves((), doc)]
    leaves, pair = _with_ends(leaves)
    named = any(_channel_key(path) is not None for _, path, _ in leaves)
    found = [(n, path, r) for n, path, v in leaves if (r := _reading(path, v, named)) is not None]
    if not named and any(isinstance(path[-1], int) and path[-1] > 1 for _, path, _ in leaves if path):
        return None  # longer lists are no pairs
    if not any(isinstance(key, str) for _, path, _ in found for key in path):
        return None  # lists of lists: their order says what is what
    kinds = {(r.channel, r.key, r.form, _template(r.base)) for _, _, r in found}
    if len(kinds) != 2 or {channel for channel, *_ in kinds} != {"h", "l"}:
        return None
    (_, _, form, base), (*_, other) = sorted(kinds)
    if base != other or len({f for _, _, f, _ in kinds}) > 1 or (not base and form != "inner"):
        return None
    scans: dict[tuple[int, Path], dict[str, dict[str, str]]] = {}
    places = {path: (r.base, r.strip) for _, path, r in found}
    depth = len(base) + 1
    within = {
        (n, path[:depth])
        for n, path, _ in leaves
        if _template(path[: depth - 1]) == base and len(path) >= depth
    }
    strips_of = {(n, r.base) for n, _, r in found}
    labels = {(n, (*r.base, r.strip)) for n, _, r in found}
    if form == "inner":
        labelled = _kinds_of({label for _, (*_, label) in labels})
        labels |= {(n, p) for n, p in within if _kinds_of({p[-1]}) <= labelled}
    own: dict[tuple[int, Path], dict[str, Any]] = {}
    for n, path, value in leaves:
        if path not in places and (n, path[:depth]) in labels:
            own.setdefault((n, path[:depth]), {})[".".join(map(str, path[depth:]))] = value
    void = _void(leaves, labels, base, depth) if form == "inner" else set()
    order = sorted(
        {(n, p[:-1]) for n, p in labels} | void, key=lambda key: (key[0], _first_place(leaves, key))
    )
    names = {
        end: name.replace(f"v_{end}", pair.get(end, f"v_{end}"))
        for end, name in _names(found, leaves).items()
    }
    numbers = _strip_numbers(labels, own, form)
    if numbers is None:
        return None
    for key in order:
        scans[key] = {}
    for n, label in sorted(labels, key=lambda x: (x[0], str(x[1]))):
        scans[n, label[:-1]].setdefault(numbers[n, label], {})
    for n, _, r in found:
        scans[n, r.base][numbers[n, (*r.base, r.strip)]][r.channel] = r.value
    for (n, label), beside in own.items():
        row = scans[n, label[:-1]][numbers[n, label]]
        bare = beside.get("")
        if bare is not None and not row:
            text = text_of(bare)
            if not says_nothing(text):
                row |= {"h": text, "l": text}
        flags = [v for k, v in beside.items() if _TOUCHES.search(k) and isinstance(v, bool | int | str)]
        if flags and all(str(v).casefold() in _NO or v is False for v in flags):
            row.clear()
    outer, above = _outer(leaves, labels, order, depth)
    units = {text_of(v) for _, p, v in leaves if p and isinstance(p[-1], str) and _UNIT.fullmatch(p[-1])}
    if outer is None or (
        len(units) > 1 and not any(_UNIT.fullmatch(name.rpartition(".")[2]) for name in outer)
    ):
        return None
    rows, lines, empty = [], [], set()
    shown_strip = next(iter(numbers.values()))
    for place, key in enumerate(order, 1):
        line = place if len(documents) == 1 else documents[key[0]][0]
        if key in void:
            scans[key] = {shown_strip: {}}
            empty.add(line)
        ordered = sorted(scans[key].items(), key=lambda item: number_of(item[0]) or 0.0)
        for strip, values in ordered:
            rows.append(
                [*(column[key] for column in outer.values()), strip, values.get("h", ""), values.get("l", "")]
            )
            lines.append(line)
    remarks = [
        told,
        f"{'.'.join(map(str, base))}: a scan each, with a value for each strip below it" if base else "",
    ]
    kept = {n for n, _ in order}
    others = [documents[n][0] for n in range(len(documents)) if n not in kept]
    if others:
        shown = ", ".join(map(str, others[:_SHOWN])) + (", ..." if len(others) > _SHOWN else "")
        remarks.append(f"line(s) {shown}: of another kind, without readings of strips; passed over")
    if len(strips_of) < len(order):
        remarks.append(f"{len(order) - len(strips_of)} scan(s) without a reading: nothing touches in them")
    return Table(
        (*outer, "strip", names["h"], names["l"]), rows, lines, ".", True, tuple(filter(None, remarks)),
        preamble=(*said, *above), empty=frozenset(empty),
    )  # fmt: skip


def _with_ends(
    leaves: list[tuple[int, Path, Any]],
) -> tuple[list[tuple[int, Path, Any]], dict[str, str]]:
    """Return leaves with h and l for two words that name a strip's ends, as "top" and "bottom"; and these words.

    Which of both is which the readings tell, so a column keeps its word.
    """
    keys = {k for _, path, _ in leaves for k in path[-2:] if isinstance(k, str) and not _WHOLE.fullmatch(k)}
    said = {k: m for k in keys if (m := meaning(k)).role == "reading" and m.channel}
    ends = pair_of({m.channel for m in said.values()})
    if ends is None or any(e.isdecimal() for e in ends):
        return leaves, {}
    made = {
        k: "hl"[ends.index(m.channel)]
        + ("" if m.strip is None else str(m.strip))
        + (f"_{m.unit}" if m.unit else "")
        for k, m in said.items()
    }
    renamed = [
        (n, tuple(made.get(k, k) if isinstance(k, str) else k for k in path), v) for n, path, v in leaves
    ]
    return renamed, dict(zip("hl", ends, strict=True))


def _void(
    leaves: Sequence[tuple[int, Path, Any]], labels: set[tuple[int, Path]], base: tuple[str, ...], depth: int
) -> set[tuple[int, Path]]:
    """Return scans that say nothing of any strip: what else they say is of the kind that the others say.

    What is a word that all others share must be the same there, such as the type of a message.
    """
    if not base or base[-1] == "*":
        return set()
    there = {(n, p[:-1]) for n, p in labels}
    parents = {(n, p[:-1]) for n, p in there}
    found: dict[tuple[int, Path], dict[tuple[str, ...], str]] = {}
    key = next(p[-1] for _, p in there)
    for n, path, value in leaves:
        if _template(path[: depth - 2]) == base[:-1] and (n, path[: depth - 1]) not in there:
            said = () if path[depth - 2 :] == (key,) and value is None else _template(path[depth - 2 :])
            found.setdefault((n, path[: depth - 2]), {})[said] = text_of(value)
    usual = {_template(p[depth - 2 :]) for n, p, _ in leaves if (n, p[: depth - 2]) in parents}
    words: dict[tuple[str, ...], set[str]] = {}
    for (n, parent), there_said in found.items():
        for said, text in there_said.items() if (n, parent) in parents else ():
            words.setdefault(said, set()).add(text)
    return {
        (n, (*parent, key)) for (n, parent), said in found.items()
        if (n, parent) not in parents and {*said} - {()} <= usual and (() in said or len(said) > 0)
        and all(
            words.get(k, {v}) == {v} or clock_seconds(v) is not None
            for k, v in said.items() if v and number_of(v) is None
        )
    }  # fmt: skip


def _leaves(path: Path, value: Any) -> Iterator[tuple[Path, Any]]:
    """Yield the paths and values of what holds nothing further; what is empty counts as None."""
    if len(path) > _DEEPEST:
        return
    if isinstance(value, Mapping) and value:
        for key, inner in value.items():
            yield from _leaves((*path, str(key)), inner)
    elif isinstance(value, list | tuple) and value:
        for n, inner in enumerate(value):
            yield from _leaves((*path, n), inner)
    else:
        yield path, None if isinstance(value, Mapping | list | tuple) else value


def _channel_key(path: Path) -> int | None:
    """Return where the key that says the channel stands in a path: the last, or before the number of a strip."""
    for place in range(len(path) - 1, max(len(path) - 3, -1), -1):
        key = path[place]
        if isinstance(key, str) and not _WHOLE.fullmatch(key) and meaning(key).channel in ("h", "l"):
            return place
    return None


def _reading(path: Path, value: Any, named: bool) -> _Reading | None:
    text = text_of(value)
    if text and number_of(text) is None and not says_nothing(text):
        return None
    if isinstance(value, bool):
        return None
    place = _channel_key(path)
    if place is None:
        pair = not named and len(path) > 1 and path[-1] in (0, 1) and _is_label(path[-2])
        return _Reading(path[:-2], path[-2], "hl"[int(path[-1])], "", "inner", text) if pair else None
    key = str(path[place])
    said = meaning(key)
    if said.strip is not None:
        return (
            _Reading(path[:place], said.strip, said.channel, re.sub(r"\d+", "", key), "flat", text)
            if place == len(path) - 1
            else None
        )
    if place == len(path) - 2:
        return (
            _Reading(path[:place], path[-1], said.channel, key, "outer", text)
            if _is_label(path[-1])
            else None
        )
    at = next((n for n in range(place - 1, -1, -1) if _is_label(path[n])), None)
    if at is None:
        return None
    within = ".".join(str(k) for k in path[at + 1 : place + 1])
    return _Reading(path[:at], path[at], said.channel, within, "inner", text)


def _is_label(key: str | int) -> bool:
    return isinstance(key, int) or _NUMBERED.fullmatch(key) is not None


def _kinds_of(keys: set[str | int]) -> set[str]:
    return {"[]" if isinstance(k, int) else re.sub(r"\d+", "0", k) for k in keys}


def _template(path: Path) -> tuple[str, ...]:
    """Return a path with marks in the places of numbers."""
    return tuple("*" if isinstance(k, int) or _WHOLE.fullmatch(k) else re.sub(r"\d+", "*", k) for k in path)


def _first_place(leaves: Sequence[tuple[int, Path, Any]], key: tuple[int, Path]) -> tuple[Any, ...]:
    return tuple(
        k if isinstance(k, int) else number_of(k) or 0.0 for k in key[1] if isinstance(k, int) or number_of(k)
    )


def _names(
    found: Sequence[tuple[int, Path, _Reading]], leaves: Sequence[tuple[int, Path, Any]]
) -> dict[str, str]:
    """Return the names of both channels' columns, with the unit that their keys, or those around them, say."""
    keys = {r.channel: r.key for _, _, r in found}
    path = next(p for _, p, _ in found)
    around = [
        UNITS.get(w.casefold(), "") for k in path if isinstance(k, str) for w in re.findall(r"[^\W\d_]+", k)
    ]
    units = {
        UNITS.get(text_of(v)) or UNITS.get(text_of(v).casefold(), "")
        for _, p, v in leaves if p and isinstance(p[-1], str) and _UNIT.fullmatch(p[-1])
    }  # fmt: skip
    told = [u for u in (*around, *units) if u in READING_UNITS]
    made = {}
    for channel in "hl":
        own = meaning(keys.get(channel, "")).unit
        unit = own if own in READING_UNITS else told[0] if len({*told}) == 1 else ""
        name = (
            f"v_{channel}" if keys.get(channel) else "ab"["hl".index(channel)]
        )  # of a pair the readings tell
        made[channel] = name + (f" [{unit}]" if unit else "")
    return made


def _strip_numbers(
    labels: set[tuple[int, Path]], own: Mapping[tuple[int, Path], Mapping[str, Any]], form: str
) -> dict[tuple[int, Path], str] | None:
    """Return the strip's number of each label: what stands beside its readings, its key's number, or its place."""
    beside = {
        label: [k for k, v in own.get(label, {}).items() if k and _is_number_of_strip(k, v)]
        for label in labels
    }
    keys = Counter(k for ks in beside.values() for k in ks)
    key = max(keys, key=lambda k: keys[k], default="")
    if key and keys[key] == len(labels) and all(isinstance(p[-1], int) for _, p in labels):
        made = {label: text_of(own[label][key]) for label in labels}
        if len({(n, p[:-1], made[n, p]) for n, p in labels}) == len(labels):
            return made
        return None
    if key:
        return None if form == "inner" and any(isinstance(p[-1], int) for _, p in labels) else _by_key(labels)
    return _by_key(labels)


def _by_key(labels: set[tuple[int, Path]]) -> dict[tuple[int, Path], str]:
    return {
        (n, p): str(k) if isinstance(k := p[-1], int) else re.findall(r"\d+", k)[-1].lstrip("0") or "0"
        for n, p in labels
    }


def _is_number_of_strip(key: str, value: Any) -> bool:
    return "." not in key and bool(_NUMBER_OF_STRIP.fullmatch(key)) and bool(re.search(r"\d", text_of(value)))


def _outer(
    leaves: Sequence[tuple[int, Path, Any]], labels: set[tuple[int, Path]], order: Sequence[tuple[int, Path]],
    depth: int,
) -> tuple[dict[str, dict[tuple[int, Path], str]] | None, list[str]]:  # fmt: skip
    """Return the columns of what belongs to whole scans: times, numbers, names of sources; and what belongs to all."""
    columns: dict[str, dict[tuple[int, Path], str]] = {}
    texts: dict[str, list[Any]] = {}
    by_doc: dict[int, list[Path]] = {}
    for n, base in order:
        by_doc.setdefault(n, []).append(base)
    for n, path, value in leaves:
        if (n, path[:depth]) in labels or value is None or n not in by_doc:
            continue
        shared = [b for b in by_doc[n] if not any(isinstance(k, int) for k in path[_common(path, b) :])]
        if not shared:
            continue
        far = max(_common(path, b) for b in shared)
        name = ".".join(map(str, path[far:])) or str(path[-1])
        for b in shared:
            if _common(path, b) == far:
                columns.setdefault(name, {})[n, b] = text_of(value)
        texts.setdefault(name, []).append(value)
    for place in range(depth - 1):  # scans by their keys
        keys = [b[place] for _, b in order if isinstance(b[place], str) and re.search(r"\d", str(b[place]))]
        if len(keys) == len(order) and len({*keys}) > 1:
            numbers = [re.findall(r"[+-]?\d+(?:\.\d+)?", str(k))[-1] for k in keys]
            timed = all(_WHOLE.fullmatch(str(k)) for k in keys) and any("." in n for n in numbers)
            columns["time" if timed else "scan"] = dict(zip(order, numbers, strict=True))
    columns = _with_parts_of_seconds(columns)
    kept: dict[str, dict[tuple[int, Path], str]] = {}
    constants: dict[str, Any] = {}
    for name, there in columns.items():
        role = meaning(name).role or meaning(name.rpartition(".")[2]).role
        values = {*there.values()}
        full = len(there) == len(order)
        worded = not any(number_of(v) is not None for v in values)
        dated = all(
            number_of(v) is None and clock_seconds(v) is not None for v in values
        )  # whatever its name
        clock = dated or role in ("time", "scan")
        if clock and full and (len(values) > 1 or role == "time"):
            kept[name] = there
        elif clock and role == "time" and not full and len(there) > 1:
            return None, []
        elif full and 1 < len(values) <= _FEW_VALUES and worded and 2 * len(values) <= len(order):
            kept[name] = there
        elif len(values) == 1:
            constants[name.rpartition(".")[2]] = texts[name][0]
    return kept, list(said_above(constants))


def _with_parts_of_seconds(columns: dict[str, dict[Any, str]]) -> dict[str, dict[Any, str]]:
    """Return columns with one of seconds in place of two, of whole ones and of their parts.

    Examples
    --------
    >>> _with_parts_of_seconds({"stamp.seconds": {0: "77"}, "stamp.nanos": {0: "20000000"}})
    {'stamp [s]': {0: '77.020000000'}}
    """
    for name in columns:
        parent, _, last = name.rpartition(".")
        digits = next((d for d, words in _PARTS.items() if words.fullmatch(last)), 0)
        whole = [
            n for n in columns if n.rpartition(".")[0] == parent and _SECONDS.fullmatch(n.rpartition(".")[2])
        ]
        if not digits or len(whole) != 1 or columns[whole[0]].keys() != columns[name].keys():
            continue
        parts, seconds = columns[name], columns[whole[0]]
        if not all(v.isdigit() for v in (*parts.values(), *seconds.values())):
            continue
        if any(len(v) > digits for v in parts.values()):
            continue
        joined = {key: f"{seconds[key]}.{parts[key]:0>{digits}}" for key in seconds}
        kept = {n: c for n, c in columns.items() if n not in (name, whole[0])}
        return {f"{parent or 'time'} [s]": joined} | kept
    return columns


def _common(path: Path, base: Path) -> int:
    """Return how many keys a path has in common with that of a scan."""
    return next(
        (n for n, (a, b) in enumerate(zip(path, base, strict=False)) if a != b), min(len(path), len(base))
    )
