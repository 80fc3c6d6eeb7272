"""Lines that name their values, gathered to records, below labels that hold for several of them."""

from __future__ import annotations

import contextlib
import itertools
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

from tacstrip.errors import ReadingError
from tacstrip.io.log_import.fields import STAMP, is_prose, number_of, says_nothing
from tacstrip.io.log_import.names import meaning
from tacstrip.io.log_import.records import LABELS, STEADY, Item, is_label, items
from tacstrip.io.log_import.scans import are_of_one_time
from tacstrip.io.log_import.table import NoTableError, Table, of_records
from tacstrip.io.log_import.tokens import TIME, VALUE, parted
from tacstrip.io.log_import.untouched import with_names_of_nothing

_FEW_KINDS = 0.5  # of the records: as many name the same values, or all do as they like
_COMMA = re.compile(r"(?<![\d,.:])\d+,\d+(?![\d,.])")
_STRIP_NAMED = re.compile(r"(\D*?)(\d+)(.*)\Z")  # a name with a strip's number in it
_NAMELESS = "column 1"  # the first value of a line without a name
_FEW_ALIKE = 3  # messages of the same form as the readings' lines
_SAMPLE = 200  # lines that tell whether all are of a kind


def named_values(lines: list[tuple[int, str]], stamps: Mapping[int, str]) -> Table | None:
    """Return lines that name their values as a table; None where the log is none of that kind.

    `stamps` are the times that stood before lines, by their number: where lines of one scan share one, another begins
    the next scan.
    """
    with contextlib.suppress(ReadingError):  # raised below where the log is of this kind
        lines = _with_points(lines)
    lines, unknown = with_names_of_nothing(lines)
    if len(lines) > _SAMPLE and named_values(lines[:_SAMPLE], stamps) is None:
        return None
    parsed = [(i, items(line)) for i, line in lines]
    said = [p for (_, p), (_, line) in zip(parsed, lines, strict=True) if re.search(r"\d", line)]
    told = [p for p in said if is_label(p) or any(i.told for i in p) or _pairs(p)]
    if len(told) < max(STEADY * len(said), 1) or all(is_label(p) for p in told):
        return None
    pointed = _with_points(lines)
    parsed = parsed if pointed is lines else [(i, items(line)) for i, line in pointed]
    parsed = _with_first_as_time(_of_both_ends(_without_counts(parsed)))
    table = _gathered(parsed, dict(pointed), _shared(parsed, stamps))
    doubts = [
        f"line {i} says {w!r} in place of readings: does nothing touch the strip, or is it a fault?"
        for w, i in unknown.items()
    ]
    return table and replace(table, doubts=(*table.doubts, *doubts))


def _without_counts(parsed: list[tuple[int, list[Item]]]) -> list[tuple[int, list[Item]]]:
    """Return what lines name without how many lines follow, as "touched=3" of a scan, if that is so of each."""
    forms = [tuple(item.name for item in found) for _, found in parsed]
    ends = {f for f, (_, found) in zip(forms, parsed, strict=True) if len(found) > 1 and is_label(found[:-1])}
    for form in [form for form in ends if not meaning(form[-1]).role]:
        at = [n for n, f in enumerate(forms) if f == form]
        told = [number_of(parsed[n][1][-1].values[0]) for n in at]
        below = {f for n, f in enumerate(forms[: at[-1]]) if n not in {*at} and n > at[0]}
        many = [b - a - 1 for a, b in itertools.pairwise(at)]
        if len(at) > _FEW_ALIKE and told == [*many, sum(f in below for f in forms[at[-1] + 1 :])]:
            return [(i, found[:-1] if n in {*at} else found) for n, (i, found) in enumerate(parsed)]
    return parsed


def _of_both_ends(parsed: list[tuple[int, list[Item]]]) -> list[tuple[int, list[Item]]]:
    """Return what lines name with one mark for nothing of a strip, as "strip 2: ---", as of each of its readings."""
    names = dict.fromkeys(item.name for _, found in parsed for item in found)
    inner = list(dict.fromkeys(m[1] for n in names if (m := re.fullmatch(r"strip \d+( .+)", n))))

    def parts(item: Item) -> list[Item]:
        bare = re.fullmatch(r"strip \d+", item.name) and [*map(says_nothing, item.values)] == [True]
        return [replace(item, name=item.name + end) for end in inner] if bare and inner else [item]

    return [(i, [part for item in found for part in parts(item)]) for i, found in parsed]


def _with_first_as_time(parsed: list[tuple[int, list[Item]]]) -> list[tuple[int, list[Item]]]:
    """Return what lines name with a number that they begin with, which never falls, as the time."""
    first = [found[0] for _, found in parsed if len(found) > 1]
    counts = [number_of(item.values[0]) for item in first if not item.name and len(item.values) == 1]
    rises = all(a is not None and b is not None and a <= b for a, b in itertools.pairwise(counts))
    named = any(meaning(item.name).role == "time" for _, found in parsed for item in found)
    if named or not rises or len({*counts}) < _FEW_ALIKE or len(counts) < STEADY * len(parsed):
        return parsed
    return [
        (i, [replace(found[0], name="time"), *found[1:]] if len(found) > 1 and not found[0].name else found)
        for i, found in parsed
    ]


def _shared(parsed: list[tuple[int, list[Item]]], stamps: Mapping[int, str]) -> Mapping[int, str]:
    """Return the stamps before lines if those of one scan have one; else none."""
    of_strips = [
        (stamps[i], (numbers[-1], item.name))
        for i, found in parsed
        if i in stamps
        for item in found
        if (numbers := re.findall(r"\d+", item.name))
    ]
    times, keys = [t for t, _ in of_strips], [key for _, key in of_strips]
    return stamps if are_of_one_time(times, keys) else {}


def _cut_labels(parsed: list[tuple[int, list[Item]]]) -> frozenset[int]:
    """Return the few lines that only name a strip, where nearly all that name one hold its values, too."""
    roles = {i: [meaning(name).role for name in _fields(found)] for i, found in parsed}
    alone = frozenset(i for i, said in roles.items() if said == ["strip"])
    whole = sum("strip" in said and len(said) > 1 for said in roles.values())
    return alone if len(alone) < (1.0 - STEADY) * whole else frozenset()


def _says_no_contact(line: str) -> bool:
    """Return whether a line says in words that nothing touches, as in `t=3 msg="no contact"`."""
    words = re.findall(r"\"([^\"]+)\"|[=:]\s*([A-Za-z][A-Za-z _/-]*)|((?:[A-Za-z_/-]+\s*)+)\Z", line)
    said = [part.split() for found in words for part in found if part]
    return any(says_nothing(" ".join(part[n:])) for part in said for n in range(len(part)))


def _pairs(found: Sequence[Item]) -> bool:
    """Return whether a line is of words and numbers in turn, such as "S3 H 512 L 300" or "S1 512/300 | S2 480/270"."""
    strips = sum(i.name.startswith("strip ") for i in found)
    return strips > 1 or (all(i.name for i in found) and any(meaning(i.name).channel for i in found))


def _with_points(lines: list[tuple[int, str]]) -> list[tuple[int, str]]:
    """Return lines with decimal points where they have decimal commas; `ReadingError` where these may be lists."""
    pairs = [p for _, line in lines for p in _COMMA.findall(line)]
    if not pairs or any(
        re.search(r"\d\.\d|\d,\d+,\d|[,;][A-Za-z]", re.sub(STAMP, "", line)) for _, line in lines
    ):
        return lines
    sizes: dict[str, set[int]] = {}  # with how many values each name stands
    for _, line in lines:
        for item in items(line):
            sizes.setdefault(item.name, set()).add(len(item.values))
    places = {len(p.partition(",")[2]) for p in pairs}
    alike = len(places) == 1 and (max(places) <= 2 or all(p.find(",") <= 2 for p in pairs))
    single = alike and any(found == {1, 2} for found in sizes.values())
    if not (single or any(re.search(r"\A0,|,0\d", p) for p in pairs)):
        raise ReadingError(
            f"{pairs[0]!r}: a decimal comma, or two values? Write such numbers with a decimal point"
        )
    return [(i, re.sub(r"(?<=\d),(?=\d)", ".", line)) for i, line in lines]


def _fields(found: Sequence[Item]) -> dict[str, str]:
    """Return a line's values by name; those without a name are counted."""
    fields: dict[str, str] = {}
    unnamed = 0
    for item in found:
        name = item.name
        if not name:
            unnamed += 1
            name = f"column {unnamed}"
        if len(item.values) == 1:
            fields[name] = item.values[0]
        else:
            fields |= {f"{name}[{n}]": value for n, value in enumerate(item.values)}
    return fields


def _gathered(
    parsed: list[tuple[int, list[Item]]], texts: Mapping[int, str], stamps: Mapping[int, str]
) -> Table | None:
    """Gather lines to records: labels hold for the lines below, and a name that comes again begins the next record.

    So does another stamp.
    """
    records: list[dict[str, str]] = []
    above: list[int] = []
    lines: list[int] = []
    labels: dict[str, str] = {}
    record: dict[str, str] = {}
    start = begin = 0
    begins: list[int] = []  # of each record: its first line, or that of its label
    strange = []
    parts: list[tuple[int, set[str]]] = []  # of the record: its lines, and what they name
    pieces: list[list[tuple[int, set[str]]]] = []
    heading: dict[str, int] = {}  # labels of a scan below which no record has come yet, and their lines
    void: list[
        tuple[int, int, dict[str, str]]
    ] = []  # scans without a line: before which record, line, labels
    timed: list[
        tuple[int, int, dict[str, str]]
    ] = []  # the same, of lines that only have a time, as a cut one may

    def flush() -> None:
        nonlocal record, parts
        if record:
            records.append(labels | record)
            lines.append(start)
            begins.append(begin)
            pieces.append(parts)
        record, parts = {}, []

    # What a line that is cut before its first number could hold.
    words = {m.group() for text in texts.values() if (m := re.match(r"[A-Za-z]{2,}", text.strip()))}
    starts = {
        word[:n]
        for word in words
        if sum(t.strip().startswith(word) for t in texts.values()) > 2
        for n in range(2, len(word) + 1)
    }
    torn = _cut_labels(parsed)
    for number, found in parsed:
        if number in torn:
            strange.append(number)
            continue
        if not any(i.told or i.name for i in found):
            if not records and not record:
                above.append(number)
            elif found or re.search(r"\d", texts[number]) or texts[number].strip() in starts:
                strange.append(number)
            continue
        fields = _fields(found)
        told = {name: f for name, f in fields.items() if meaning(name).role in LABELS}
        later = bool(record) and stamps.get(number, "") != stamps.get(parts[-1][0], "")
        if later or any(labels.get(n) != f for n, f in told.items()) or any(n in record for n in fields):
            flush()
        alone = len(told) == len(fields)  # a line that only says which scan the next ones are of
        if heading and not alone and {*heading} <= {*told} and any(told[n] != labels[n] for n in heading):
            # The lines below have a time of their own, another one.
            at = min(heading.values())
            (void if _says_no_contact(texts[at]) else timed).append((len(records), at, dict(labels)))
            heading = {}
        if anew := [n for n in told if n in heading and alone]:
            void.append((len(records), heading[anew[0]], dict(labels)))
            heading = {}
        labels = labels | told
        heading |= {n: number for n in told if alone and meaning(n).role in ("scan", "time")}
        if rest := {name: f for name, f in fields.items() if name not in told}:
            start, begin = (start, begin) if record else (number, min([number, *heading.values()]))
            record |= rest
            parts.append((number, {*rest}))
            heading = {}
    flush()
    if not records:
        return None
    kinds = Counter(frozenset(r) for r in records)
    usual, many = kinds.most_common(1)[0]
    forms = {parted(i, texts[i]).form for i in lines if i in texts}
    values = [form.count(VALUE) + form.count(TIME) for form in forms]
    # As where a mark that is no number was passed over.
    if len(kinds) > 1 and len(forms) == 1 and len(lines) > _FEW_ALIKE and values[0] >= max(map(len, records)):
        raise NoTableError(f"lines from {lines[0]} on are of one form, and give different numbers of values")
    strange += [i for i in above if any(re.search(rf"\b{re.escape(n)}\s*[:=]", texts[i]) for n in usual)]
    varied = touched_vary(records)
    for n, (r, lines_of) in enumerate(zip(records, pieces, strict=True)):
        # A line of other names behind those of a record, as of a debugging message, is none of it.
        other = [(i, named) for i, named in lines_of if not (varied or named & usual)]
        if frozenset(r) > usual and other and {*r} - set().union(*(named for _, named in other)) == usual:
            strange += [i for i, _ in other]
            records[n] = {name: f for name, f in r.items() if name in usual}
    empty: set[int] = set()
    listed: list[str] = []  # strips that every scan lists
    strips = [n for n in usual if meaning(n).role == "strip"]
    if strips and _NAMELESS in usual and len({r.get(strips[0]) for r in records}) == 1:
        # It only says how many there are, and a number without a name which one a line is of.
        once = strips.pop()
        above += [i for i, found in parsed if once in _fields(found)]
        records = [{n: f for n, f in r.items() if n != once} for r in records]
        usual = usual - {once}
        void = [(place, line, {n: f for n, f in told.items() if n != once}) for place, line, told in void]
        timed = [(place, line, {n: f for n, f in told.items() if n != once}) for place, line, told in timed]
    strips = strips or [n for n in usual if n == _NAMELESS]
    doubts: list[str] = []
    if heading:
        last = (len(records), min(heading.values()), dict(labels))
        ended = parsed[-1][0] > max(heading.values()) or (void and void[-1][0] == len(records))
        ended = ended or _says_no_contact(texts[last[1]])
        if ended:
            void.append(last)
        else:  # it may be cut
            doubts.append(
                f"line {last[1]} ({texts[last[1]].strip()!r}), the last, says nothing of a strip: left out"
            )
    worded = [one for one in void if _says_no_contact(texts[one[1]])]
    if len(void) < 2 * len(worded):  # others, that say nothing, are cut
        strange += [line for _, line, _ in void if line not in {at for _, at, _ in worded}]
        void = worded
    if len(timed) > 1:
        void = sorted([*void, *timed], key=lambda one: one[1])
    else:
        strange += [line for _, line, _ in timed]
    if void and varied:
        for place, line, told in reversed(void):
            records.insert(place, dict(told))
            lines.insert(place, line)
            begins.insert(place, line)
            pieces.insert(place, [])
    elif void and not strips:
        strange += [line for _, line, _ in void]
    elif void:
        inner = next(list(r) for r in records if frozenset(r) == usual)
        shown = next(r[strips[0]] for r in records if strips[0] in r)
        often = Counter(r.get(strips[0], "") for r in records)
        listed = (
            [*often][::-1] if len({*often.values()}) == 1 and len(often) > 1 else []
        )  # each in every scan
        for place, line, told in reversed(void):
            if {*told} <= usual:
                for strip in listed or [shown]:
                    records.insert(place, dict.fromkeys(inner, "") | told | {strips[0]: strip})
                    lines.insert(place, line)
                    pieces.insert(place, [])
                empty.add(line)
            else:
                strange.append(line)
    if varied:  # what a line that is not understood says of its scan is not known
        spans = list(zip(begins, [*begins[1:], parsed[-1][0] + 1], strict=True))
        words = {w.casefold() for n in usual for w in re.findall(r"[A-Za-z]+", n)}
        lost = [i for i in strange if not is_prose(texts[i], words)]
        hit = [any(a <= i < b for i in lost) for a, b in spans]
        strange += [i for out, lines_of in zip(hit, pieces, strict=True) for i, _ in lines_of if out]
        records = [r for r, out in zip(records, hit, strict=True) if not out]
        lines = [i for i, out in zip(lines, hit, strict=True) if not out]
        if not records:
            return None
    elif many >= _FEW_KINDS * len(records):
        named = {i: [n for n, _ in lines_of] for i, lines_of in zip(lines, pieces, strict=True)}
        odd = [(i, r) for i, r in zip(lines, records, strict=True) if frozenset(r) != usual]
        kept = [(i, r) for i, r in zip(lines, records, strict=True) if frozenset(r) == usual]
        lines, records = [i for i, _ in kept], [r for _, r in kept]
        names = list(records[0])
        # Of other names altogether, or the end of a line in the middle of which the log begins.
        above += [i for i, r in odd if i < lines[0] and (not usual & {*r} or list(r) == names[-len(r) :])]
        strange += [n for i, _ in odd if i not in above for n in named[i] or [i]]
    above = [i for i in above if i not in strange]
    words = {w.casefold() for n in usual for w in re.findall(r"[A-Za-z]+", n)}
    prose = [i for i in strange if is_prose(texts[i], words)]
    alike = [i for i in prose if parted(i, texts[i]).form in forms]
    if len(alike) > _FEW_ALIKE:  # as the other end of each strip, in lines of its own
        raise NoTableError(
            f"line(s) {', '.join(map(str, alike[:_FEW_ALIKE]))}, ... have the form of those that name "
            f"{', '.join(sorted(usual))}, and other names: what do they hold?"
        )
    strange = [i for i in strange if i not in prose]
    said = [f"{len(above)} line(s) above passed over"] if above else []
    said += [f"line(s) {', '.join(map(str, prose))}: messages, passed over"] if prose else []
    table = of_records(records, lines, ".", "each line names its values", *said)
    quotes = {i: texts[i].strip() for i in strange}
    if empty:
        table = replace(
            table, remarks=(*table.remarks, f"{len(empty)} scan(s) without a line: nothing touches in them")
        )
    return replace(
        table,
        broken=tuple(sorted({*strange})),
        preamble=tuple(texts[i] for i in above),
        quotes=quotes,
        empty=frozenset() if listed else frozenset(empty),
        doubts=tuple(doubts),
        varied=varied > 1,
    )


def touched_vary(records: Sequence[Mapping[str, str]]) -> int:
    """Return whether records name other strips from one to the next, each with all of its channels.

    2 if so because others are touched; 1 if strips are missing as where lines are cut, too; 0 if not, or if one record
    is cut.

    Examples
    --------
    >>> touched_vary([{"h1": "5", "l1": "4", "h2": "3", "l2": "2"}, {"h2": "5", "l2": "4", "h3": "3", "l3": "2"}])
    2
    >>> touched_vary([{"h1": "5", "l1": "4", "h2": "3", "l2": "2"}, {"h1": "5", "l1": "4", "h2": "3"}])
    0
    """
    if len({frozenset(r) for r in records}) < 2:
        return 0
    split = {n: m.groups() for n in {*itertools.chain(*records)} if (m := _STRIP_NAMED.match(n))}
    vary = {(a, c) for n, (a, _, c) in split.items() if not all(n in r for r in records)}
    split = {n: (a, number, c) for n, (a, number, c) in split.items() if (a, c) in vary}
    common = [n for n in {*itertools.chain(*records)} if n not in split]
    ends = {(a, c) for a, _, c in split.values()}
    sets: list[frozenset[int]] = []
    for record in records:
        if any(n not in record for n in common):
            return 0
        many_of = Counter(int(split[n][1]) for n in record if n in split)
        if any(many != len(ends) for many in many_of.values()):
            return 0
        sets.append(frozenset(many_of))
    usual = Counter(sets).most_common(1)[0][0]
    if not usual:
        return 0
    cut = []
    for n, there in enumerate(sets):
        if there == usual:
            continue
        run = bool(there) and max(there) - min(there) == len(there) - 1
        cut.append(not run or (there < usual and (n == 0 or max(there) < max(usual))))
    return 0 if len(cut) == sum(cut) == 1 else 1 + (not all(cut))
