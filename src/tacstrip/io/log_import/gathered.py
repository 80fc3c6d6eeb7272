"""Lines that name their values, gathered to records, below labels that hold for several of them."""

from __future__ import annotations

import contextlib
import itertools
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

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
_ENDS = 2  # of a strip's contact
_FEW_ALIKE = 3  # messages of the same form as the readings' lines
# Of a strip, by its number: both ends, or what stands for no contact.
_GROUP = re.compile(
    r"(?<!\S)(\d{1,3})\s?[:=](?=\s?(?:[\d.]+[,/|][\d.]+|[-xX*_]{1,5}|nan|null|none|n/a)[,;|]?(?:\s|\Z))", re.I
)
_SAMPLE = 200  # lines that tell whether all are of a kind


def named_values(lines: list[tuple[int, str]], stamps: Mapping[int, str]) -> Table | None:
    """Return lines that name their values as a table; None where the log is none of that kind.

    `stamps` are the times that stood before lines, by their number: where lines of one scan share one, another begins
    the next scan.
    """
    with contextlib.suppress(ReadingError):  # raised below where the log is of this kind
        lines = _with_points(lines)
    lines, unknown = with_names_of_nothing(_with_numbered_groups(lines))
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
    table = _Gathering(parsed, dict(pointed), _shared(parsed, stamps)).table()
    doubts = [
        f"line {i} says {w!r} in place of readings: does nothing touch the strip, or is it a fault?"
        for w, i in unknown.items()
    ]
    return table and replace(table, doubts=(*table.doubts, *doubts))


def _with_numbered_groups(lines: list[tuple[int, str]]) -> list[tuple[int, str]]:
    """Return lines that list strips' ends by number, as "1:2.5,1.8 2:-- 3:2.4,1.7", with "S" before each number."""
    there = [_GROUP.findall(line) for _, line in lines]
    held = sum(bool(re.search(r"\d", line)) for _, line in lines)
    counted = [[*map(int, found)] for found in there if len(found) > 1]
    counted = [found for found in counted if found == [*range(found[0], found[0] + len(found))]]
    if len(counted) <= STEADY * held:
        return lines
    return [(i, _GROUP.sub(r"S\g<0>", line)) for i, line in lines]


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
    sizes: dict[str, int] = {}  # of "S2: --" beside "S1: 2.5,1.8"
    for item in itertools.chain.from_iterable(found for _, found in parsed):
        key = re.sub(r"\d+", "0", item.name)
        sizes[key] = max(sizes.get(key, 0), len(item.values) if meaning(item.name).strip is not None else 0)

    def both(item: Item) -> Item:
        alone = len(item.values) == 1 and says_nothing(item.values[0])
        pair = alone and sizes[re.sub(r"\d+", "0", item.name)] == _ENDS
        return replace(item, values=item.values * _ENDS) if pair else item

    parsed = [(i, [*map(both, found)]) for i, found in parsed]
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


def _names_values(fields: Mapping[str, str]) -> bool:
    """Return whether a line names something else than which scan and strip it is of."""
    return any(name != _NAMELESS and meaning(name).role not in LABELS for name in fields)


def _cut_labels(parsed: list[tuple[int, list[Item]]]) -> frozenset[int]:
    """Return the few lines that only name a strip, where nearly all that name one hold its values, too."""
    roles = {i: [meaning(name).role for name in _fields(found)] for i, found in parsed}
    alone = frozenset(i for i, said in roles.items() if said == ["strip"])
    whole = sum("strip" in said and len(said) > 1 for said in roles.values())
    return alone if len(alone) < (1.0 - STEADY) * whole else frozenset()


def _of_messages(parsed: list[tuple[int, list[Item]]]) -> frozenset[int]:
    """Return the few lines among the readings whose labels stand nowhere else, as "idx=0 tid=0": no scan is theirs."""
    named = {i: {*_fields(found)} for i, found in parsed}
    first = next((i for i, names in named.items() if any(meaning(n).role not in LABELS for n in names)), 0)
    many = Counter(itertools.chain.from_iterable(named.values()))
    early = set[str]().union(*(names for i, names in named.items() if i <= first))
    most = (1.0 - STEADY) / _FEW_ALIKE * max(many.values(), default=0)
    few = {n for n in {*many} - early if many[n] <= most and meaning(n).strip is None}
    labelled = {n for n in few if meaning(n).role in LABELS}
    return frozenset(i for i, names in named.items() if names & labelled and names <= few)


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


@dataclass
class _Record:
    """What lines name together: values by name, its first line, that of its label, and each line with its names."""

    values: dict[str, str]
    line: int
    begin: int
    parts: list[tuple[int, set[str]]]


@dataclass(frozen=True)
class _Void:
    """A scan without a record: before which one it stands, the line that says it, and its labels."""

    place: int
    line: int
    labels: dict[str, str]


class _Gathering:
    """Lines gathered to records: labels hold for the lines below, and a name that comes again begins the next record.

    So does another stamp.
    """

    def __init__(
        self, parsed: list[tuple[int, list[Item]]], texts: Mapping[int, str], stamps: Mapping[int, str]
    ) -> None:
        self.parsed, self.texts, self.stamps = parsed, texts, stamps
        self.records: list[_Record] = []
        self.above: list[int] = []
        self.strange: list[int] = []
        self.doubts: list[str] = []
        self.void: list[_Void] = []
        self.timed: list[_Void] = []  # of lines that only have a time, as a cut one may
        # Labels of a scan below which no record has come yet, and their lines.
        self.heading: dict[str, int] = {}
        self.labels: dict[str, str] = {}
        self.empty: set[int] = set()
        self.listed: list[str] = []  # strips that every scan lists
        self._record: _Record | None = None
        self._read()

    def _read(self) -> None:
        torn, starts = _cut_labels(self.parsed) | _of_messages(self.parsed), _first_letters(self.texts)
        numbered = any(
            _names_values(_fields(found)) and _NAMELESS in _fields(found) for _, found in self.parsed
        )
        for number, found in self.parsed:
            text = self.texts[number]
            if number in torn:
                self.strange.append(number)
            elif any(i.told or i.name for i in found):
                fields = _fields(found)
                if (
                    numbered and not _names_values(fields) and len(fields) > 1
                ):  # how many, as "scan 5: 4 touched"
                    fields.pop(_NAMELESS, None)
                self._take(number, fields)
            elif not self.records and not self._record:
                self.above.append(number)
            elif found or re.search(r"\d", text) or text.strip() in starts:
                self.strange.append(number)
        self._flush()

    def _flush(self) -> None:
        if self._record:
            self.records.append(replace(self._record, values=self.labels | self._record.values))
        self._record = None

    def _take(self, number: int, fields: dict[str, str]) -> None:
        """Take what a line names."""
        told = {name: f for name, f in fields.items() if meaning(name).role in LABELS}
        record, stamps = self._record, self.stamps
        later = record is not None and stamps.get(number, "") != stamps.get(record.parts[-1][0], "")
        again = record is not None and any(n in record.values for n in fields)
        if later or again or any(self.labels.get(n) != f for n, f in told.items()):
            self._flush()
        alone = len(told) == len(fields)  # a line that only says which scan the next ones are of
        heading = self.heading
        if (
            heading
            and not alone
            and {*heading} <= {*told}
            and any(told[n] != self.labels[n] for n in heading)
        ):
            # The lines below have a time of their own, another one.
            at = min(heading.values())
            (self.void if _says_no_contact(self.texts[at]) else self.timed).append(self._void(at))
            self.heading = {}
        if anew := [n for n in told if n in self.heading and alone]:
            self.void.append(self._void(self.heading[anew[0]]))
            self.heading = {}
        self.labels = self.labels | told
        self.heading |= {n: number for n in told if alone and meaning(n).role in ("scan", "time")}
        if rest := {name: f for name, f in fields.items() if name not in told}:
            if self._record is None:
                self._record = _Record({}, number, min([number, *self.heading.values()]), [])
            self._record.values |= rest
            self._record.parts.append((number, {*rest}))
            self.heading = {}

    def _void(self, line: int) -> _Void:
        return _Void(len(self.records), line, dict(self.labels))

    def table(self) -> Table | None:
        """Return the records as a table; None where there is none."""
        if not self.records:
            return None
        kinds = Counter(frozenset(r.values) for r in self.records)
        usual, many = kinds.most_common(1)[0]
        forms = {parted(r.line, self.texts[r.line]).form for r in self.records if r.line in self.texts}
        self._check_forms(len(kinds), forms)
        self.strange += [
            i for i in self.above if any(re.search(rf"\b{re.escape(n)}\s*[:=]", self.texts[i]) for n in usual)
        ]
        varied = touched_vary([r.values for r in self.records])
        for record in () if varied else self.records:
            self._drop_others(record, usual)
        usual, strips = self._without_count(usual)
        self._end()
        self._insert_voids(varied, usual, strips)
        words = {w.casefold() for n in usual for w in re.findall(r"[A-Za-z]+", n)}
        if varied:
            self._drop_hit(words)
        elif many >= _FEW_KINDS * len(self.records):
            self._drop_odd(usual)
        if not self.records:
            return None
        return self._made(self._messages(usual, words, forms), varied)

    def _check_forms(self, kinds: int, forms: set[str]) -> None:
        """Refuse lines of one form that give different numbers of values, as where a mark was passed over."""
        values = [form.count(VALUE) + form.count(TIME) for form in forms]
        most = max(len(r.values) for r in self.records)
        if kinds > 1 and len(forms) == 1 and len(self.records) > _FEW_ALIKE and values[0] >= most:
            raise NoTableError(
                f"lines from {self.records[0].line} on are of one form, and give different numbers of values"
            )

    def _drop_others(self, record: _Record, usual: frozenset[str]) -> None:
        """Take lines of other names, as of a debugging message, out of a record that has the usual ones, too."""
        other = [(i, named) for i, named in record.parts if not named & usual]
        there = {*record.values}
        if there > usual and other and there - set().union(*(named for _, named in other)) == usual:
            self.strange += [i for i, _ in other]
            record.values = {name: f for name, f in record.values.items() if name in usual}
            record.line = next(i for i, named in record.parts if named & usual)

    def _without_count(self, usual: frozenset[str]) -> tuple[frozenset[str], list[str]]:
        """Return the usual names and those of strips, without one that only says how many there are.

        Another name, or a number without one, then says which one a line is of.
        """
        first = next(r for r in self.records if usual <= {*r.values})
        strips = [n for n in first.values if n in usual and meaning(n).role == "strip"]
        lines = {n: [i for i, found in self.parsed if n in _fields(found)] for n in strips}
        same = [n for n in strips if len({r.values.get(n) for r in self.records}) == 1]
        once = [n for n in same if len(strips) > 1 and len(lines[n]) == 1]
        once = once or (strips[-1:] if len(same) == len(strips) and _NAMELESS in usual else [])
        for name in once:
            strips.remove(name)
            self.above += lines[name]
            voids = (v.labels for v in (*self.void, *self.timed))
            for one in (self.labels, *(r.values for r in self.records), *voids):
                one.pop(name, None)
            usual = usual - {name}
        return usual, strips or [n for n in usual if n == _NAMELESS]

    def _end(self) -> None:
        """Decide which scans without a record are such: the last may be cut, and so may be others that say nothing."""
        if self.heading:
            last = self._void(min(self.heading.values()))
            ended = self.parsed[-1][0] > max(self.heading.values())
            ended = ended or bool(self.void and self.void[-1].place == len(self.records))
            if ended or _says_no_contact(self.texts[last.line]):
                self.void.append(last)
            else:
                text = self.texts[last.line].strip()
                self.doubts.append(
                    f"line {last.line} ({text!r}), the last, says nothing of a strip: left out"
                )
        worded = [one for one in self.void if _says_no_contact(self.texts[one.line])]
        if len(self.void) < 2 * len(worded):
            self.strange += [one.line for one in self.void if one not in worded]
            self.void = worded
        if len(self.timed) > 1:
            self.void = sorted([*self.void, *self.timed], key=lambda one: one.line)
        else:
            self.strange += [one.line for one in self.timed]

    def _insert_voids(self, varied: int, usual: frozenset[str], strips: list[str]) -> None:
        """Insert records for scans in which nothing touches: of labels only, or of one strip, or of each listed one."""
        if not (varied or strips):
            self.strange += [one.line for one in self.void]
            return
        shown: list[str] = []
        inner: list[str] = []
        if self.void and not varied:
            inner = next(list(r.values) for r in self.records if frozenset(r.values) == usual)
            there = [r.values[strips[0]] for r in self.records if strips[0] in r.values]
            often = Counter(there)
            if len({*often.values()}) == 1 and len(often) > 1 and len(there) == len(self.records):
                self.listed = [*often]
            shown = self.listed or there[:1]
        for one in reversed(self.void):
            if varied:
                made = [dict(one.labels)]
            elif {*one.labels} <= usual:
                made = [dict.fromkeys(inner, "") | one.labels | {strips[0]: strip} for strip in shown]
                self.empty.add(one.line)
            else:
                self.strange.append(one.line)
                continue
            self.records[one.place : one.place] = [_Record(values, one.line, one.line, []) for values in made]

    def _drop_hit(self, words: set[str]) -> None:
        """Leave out scans of touched strips within which a line is not understood: what it says is not known.

        Where each line holds several strips, all of a scan, the line is another scan.
        """
        whole = all(len(r.parts) == 1 for r in self.records if r.parts)
        numbers = [{m[2] for n in r.values if (m := _STRIP_NAMED.match(n))} for r in self.records]
        if whole and any(len(strips) > 1 for strips in numbers):
            return
        ends = [*(r.begin for r in self.records[1:]), self.parsed[-1][0] + 1]
        lost = [i for i in self.strange if not is_prose(self.texts[i], words)]
        hit = [any(r.begin <= i < end for i in lost) for r, end in zip(self.records, ends, strict=True)]
        both = [*zip(self.records, hit, strict=True)]
        self.strange += [i for r, out in both for i, _ in r.parts if out]
        self.records = [r for r, out in both if not out]

    def _drop_odd(self, usual: frozenset[str]) -> None:
        """Leave out records of other names than the usual ones."""
        odd = [r for r in self.records if frozenset(r.values) != usual]
        self.records = [r for r in self.records if frozenset(r.values) == usual]
        first, names = self.records[0].line, list(self.records[0].values)
        for r in odd:
            # Of other names altogether, or the end of a line in the middle of which the log begins.
            ends = not usual & {*r.values} or list(r.values) == names[-len(r.values) :]
            if r.line < first and ends:
                self.above.append(r.line)
            else:
                self.strange += [i for i, _ in r.parts] or [r.line]

    def _messages(self, usual: frozenset[str], words: set[str], forms: set[str]) -> list[int]:
        """Return the lines not understood that are messages; refuse those of the form of the readings' own lines."""
        prose = [i for i in self.strange if is_prose(self.texts[i], words)]
        alike = [i for i in prose if parted(i, self.texts[i]).form in forms]
        if len(alike) > _FEW_ALIKE:  # as the other end of each strip, in lines of its own
            raise NoTableError(
                f"line(s) {', '.join(map(str, alike[:_FEW_ALIKE]))}, ... have the form of those that name "
                f"{', '.join(sorted(usual))}, and other names: what do they hold?"
            )
        return prose

    def _made(self, prose: list[int], varied: int) -> Table:
        above = [i for i in self.above if i not in self.strange]
        strange = {*self.strange} - {*prose}
        said = [f"{len(above)} line(s) above passed over"] if above else []
        said += [f"line(s) {', '.join(map(str, prose))}: messages, passed over"] if prose else []
        said += [f"{len(self.empty)} scan(s) without a line: nothing touches in them"] if self.empty else []
        values, lines = [r.values for r in self.records], [r.line for r in self.records]
        return replace(
            of_records(values, lines, ".", "each line names its values", *said),
            broken=tuple(sorted(strange)),
            preamble=tuple(self.texts[i] for i in above),
            quotes={i: self.texts[i].strip() for i in strange},
            empty=frozenset() if self.listed else frozenset(self.empty),
            doubts=tuple(self.doubts),
            varied=varied > 1,
        )


def _first_letters(texts: Mapping[int, str]) -> set[str]:
    """Return what a line that is cut before its first number could hold: how words begin that several lines do."""
    words = {m.group() for text in texts.values() if (m := re.match(r"[A-Za-z]{2,}", text.strip()))}
    often = [w for w in words if sum(t.strip().startswith(w) for t in texts.values()) > 2]
    return {word[:n] for word in often for n in range(2, len(word) + 1)}


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
