"""Rows of fields as a table: where its names stand, and which rows are of readings."""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Sequence, Set
from dataclasses import replace

from tacstrip.errors import ReadingError
from tacstrip.io.log_import.fields import (
    clock_seconds,
    is_prose,
    is_value,
    number_of,
    says_nothing,
    ungrouped,
)
from tacstrip.io.log_import.names import READING_UNITS, UNITS, is_called_k, meaning, meanings, unknown_unit
from tacstrip.io.log_import.table import GARBLED, ContradictionError, NoTableError, Table

_TALLEST_HEADER = 5
_STATISTICS = frozenset(
    {"mean", "average", "avg", "mittel", "mittelwert", "moyenne", "media", "promedio", "mw", "min", "minimum", "max"}
    | {"maximum", "std", "stdev", "stddev", "stabw"}
    | {"sd", "sigma", "sum", "summe", "total"}
    | {"somme", "median", "count"}
    | {"anzahl", "rms", "var", "variance", "range", "25%", "50%", "75%"}
    | {"std dev", "std. dev", "st. dev", "standard deviation", "stdev.s"}
    | {"stdev.p", "standardabweichung", "varianz", "\u00f8"}
    | {"durchschnitt", "gesamt", "\u00e9cart-type", "\u00e9cart type", "ecart-type", "m\u00e9diane", "moy"}
    | {"m\u00e9dia", "desvio padr\u00e3o", "desvio", "mediana", "m\u00edn"}
    | {"m\u00e1x", "m\u00ednimo", "m\u00e1ximo", "soma", "vari\u00e2ncia"}
    | {"desviaci\u00f3n", "desviaci\u00f3n est\u00e1ndar", "desv. est", "suma", "varianza"}
    | {"deviazione standard", "dev. st", "somma"}
    | {"minimo", "massimo", "gemiddelde", "gemiddeld", "standaardafwijking", "\u015brednia", "srednia", "odchylenie"}
    | {"mediaan", "skew", "kurtosis", "\u03c3", "\u03bc"}
    | {"\u5e73\u5747", "\u6807\u51c6\u5dee", "\u6a19\u6e96\u504f\u5dee"}
)  # fmt: skip
# Of Campbell's loggers (TOA5), below the units; and "TS" and "RN" among these.
_PROCESSING = _STATISTICS | {"smp", "tot", "wvc", "smm", "cov"}
_UNIT_WORDS = frozenset({"unit", "units", "einheit", "einheiten"})
_LONG = 40  # characters of a line that are quoted
# As "Upper end (Vref side), mV", "Lower end, % of Vref".
_OF_AN_END = re.compile(
    r"(?P<end>[^,(\[\d]+?)\s*(?:\([^)]*\))?(?:,\s*\[?(?P<unit>[^\s\]]+)\]?(?:\s+(?:of|von)\s.+)?)?"
)
_FEW = 2  # fields that may look like units by chance


def headed(
    split: list[tuple[int, list[str]]],
    width: int,
    decimal: str,
    remarks: tuple[str, ...] = (),
    comments: Sequence[tuple[int, list[str]]] = (),
    preamble: Sequence[str] = (),
) -> Table:
    """Return rows of fields as a table: find the names above the numbers, in one line or in several.

    Parameters
    ----------
    split
        Line number and fields of each row, also of those that have not `width` fields.
    width, decimal
        Number of fields of the table's rows, and their decimal mark.
    remarks, preamble
        Of the table.
    comments
        Line number and fields of comments that could hold the names.
    """
    numeric = _numeric_columns(split, width, decimal)
    above, first, below = _parts(split, width, decimal, numeric, comments)
    _check_names(split, above, width, decimal)
    again = {i for i, row in below if len(row) == width and row in above}
    # What a board says as it starts stands above the table, and again where it was reset.
    banner = [row for _, row in split[:first] if row not in above]
    boots = {i for i, row in split[first:] if len(row) != width and row in banner}
    below = [(i, row) for i, row in below if i not in boots]
    garbled = {i for i, row in below if GARBLED in "".join(row)}
    rows = [(i, row) for i, row in below if len(row) == width and i not in {*again, *garbled}]
    sums = {i: word for i, row in rows if (word := _statistic(row, numeric, decimal))}
    sums = sums if 2 * len(sums) < len(rows) else {}  # else these are labels
    rows = [(i, row) for i, row in rows if i not in sums]
    timed = [
        numeric[n] or any(clock_seconds(row[n]) is not None for _, row in rows[:1]) for n in range(width)
    ]
    notes = {i for i, row in rows if _is_note(row, timed, decimal)}
    rows = [(i, row) for i, row in rows if i not in notes]
    odd = [(i, " ".join(row)) for i, row in below if len(row) != width or i in garbled]
    broken = _broken(odd, garbled, above, rows)
    words = len(odd) - len(broken) + len(notes)
    if not rows:
        raise ReadingError("the log has no line of readings" + (", only names" if above else ""))
    names, rows = _without_twins(_names(above, width), rows)
    told = [
        _passed_over(split, first - len(above), decimal) if above else "",
        f"{words} line(s) without a reading passed over" if words else "",
        f"line {min(again)}: the names again; passed over" if again else "",
        f"line(s) {', '.join(map(str, sorted(boots)))}: as above the table; passed over" if boots else "",
        f"line(s) {', '.join(map(str, sums))}: {', '.join(dict.fromkeys(sums.values()))}; passed over"
        if sums
        else "",
    ]
    return Table(
        tuple(_distinct(names)), [row for _, row in rows], [i for i, _ in rows], decimal, bool(above),
        (*remarks, *filter(None, told)), broken, (*preamble, *("\t".join(row) for _, row in split[:first])),
        quotes={i: " ".join(row) for i, row in below if i in broken},
        doubts=(
            *_fewer_names(split[:first], above, width),
            *_other_units(above),
            *(f"line {i} holds bytes of 0, as of a reset: what stood there is lost" for i in sorted(garbled)),
        ),
    )  # fmt: skip


def _numeric_columns(split: list[tuple[int, list[str]]], width: int, decimal: str) -> list[bool]:
    """Return which columns hold numbers; `ReadingError` where none does."""
    full = [row for _, row in split if len(row) == width]
    numeric = [
        any(is_value(c, decimal) for c in column)
        and 2 * sum(is_value(c, decimal) for c in column) >= sum(not says_nothing(c) for c in column)
        for column in zip(*full[len(full) // 3 :], strict=True)
    ]
    if any(numeric):
        return numeric
    units = (re.fullmatch(r"[-+]?\d[\d.,]*\s?([^\W\d]{1,6})", cell) for row in full for cell in row)
    strange = next((m for m in units if m and unknown_unit(f"x [{m[1]}]")), None)
    said = f": {strange[1]!r}, as in {strange[0]!r}, is no unit of readings that is known" if strange else ""
    raise (ReadingError if said else NoTableError)(f"the log has no column of numbers{said}")


def _parts(
    split: list[tuple[int, list[str]]],
    width: int,
    decimal: str,
    numeric: Sequence[bool],
    comments: Sequence[tuple[int, list[str]]],
) -> tuple[list[list[str]], int, list[tuple[int, list[str]]]]:
    """Return the lines of names, where what is below these begins, and the rows there, with torn ones above it."""
    full = [row for _, row in split if len(row) == width]
    # Words that stand for no contact come again in the lines below the names.
    lower = [
        row
        for row in full[len(full) // 2 :]
        if any(n and is_value(cell, decimal) for cell, n in zip(row, numeric, strict=True))
    ]
    usual = {cell for row in lower for cell in row if not is_value(cell, decimal)}
    headers = [
        len(row) != width or not any(row) or _named(row, numeric, decimal, usual) > 0 for _, row in split
    ]
    # A heading above a few columns may stand above none that has numbers.
    for n, (_, row) in enumerate(split[:_TALLEST_HEADER]):
        headers[n] |= headers[n + 1 : n + 2] == [True] and not any(is_value(c, decimal) for c in row)
    first = headers.index(False) if False in headers else len(split)
    above = _last_block([row for _, row in split[:first]])
    above = [row for row in above if len(row) == width and any(row) and not _says_one_number(row)]
    above = above[-_TALLEST_HEADER:]
    if first < len(split) and _numbers_columns(split[first][1]):
        above, first = [*above, split[first][1]], first + 1
    # What is below the names, and has numbers, is no heading, however short.
    names_at = max((n for n, (_, row) in enumerate(split[:first]) if row in above), default=first)
    cut = [
        (i, row) for i, row in split[names_at + 1 : first]
        if row not in above and len(row) > 1 and sum(is_value(c, decimal) for c in row) > 0.5 * len(row)
    ]  # fmt: skip
    if names_at == first:  # no names: what holds as many readings as the others is none either
        cut = [
            (i, row) for i, row in split[:first]
            if len(row) > width > _FEW and all(c and (is_value(c, decimal) or says_nothing(c)) for c in row[:width])
        ]  # fmt: skip
    below = cut + [(i, row) for i, row in split[first:] if any(row)]
    if not above and below:
        above = [row for i, row in comments if i < below[0][0] and len(row) == width][-1:]
        above = [
            r for r in above if _named(r, numeric, decimal) and not any(number_of(c) is not None for c in r)
        ]
    return above, first, below


def _broken(
    odd: list[tuple[int, str]],
    garbled: Set[int],
    above: list[list[str]],
    rows: list[tuple[int, list[str]]],
) -> tuple[int, ...]:
    """Return which lines that are no rows may hold a reading: not those without a digit, and no messages."""
    told_names = {w.casefold() for row in above for w in re.findall(r"[^\W\d_]+", " ".join(row))}
    told_names |= {w.casefold() for _, row in rows for cell in row for w in re.findall(r"[^\W\d_]{3,}", cell)}
    return tuple(
        i for i, text in odd
        if (re.search(r"\d", text) and (i in garbled or not is_prose(text, told_names)))
        or all(map(says_nothing, re.split(r"[\s/|:]+", text.strip("()[]{}<> "))))  # a scan without a contact
    )  # fmt: skip


def _without_twins(
    names: list[str], rows: list[tuple[int, list[str]]]
) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """Return names and rows without columns that another one with the same name and fields repeats."""
    columns = list(zip(*(row for _, row in rows), strict=True))
    first_at: dict[tuple[str, tuple[str, ...]], int] = {}
    for n, key in enumerate(zip(names, columns, strict=True)):
        first_at.setdefault(key, n)
    kept = {*first_at.values()} | {
        n for n, c in enumerate(columns) if all(not f or says_nothing(f) for f in c)
    }
    if len(kept) == len(names):
        return names, rows
    return (
        [x for n, x in enumerate(names) if n in kept],
        [(i, [c for n, c in enumerate(row) if n in kept]) for i, row in rows],
    )


def _passed_over(split: list[tuple[int, list[str]]], many: int, decimal: str) -> str:
    """Return a remark on the lines above a table's names, which quotes those of numbers."""
    numbers = [
        f"{i} ({' '.join(row)[:_LONG]!r})" for i, row in split[: max(many, 0)]
        if len(row) > 1 and all(is_value(c, decimal) for c in row)
    ]  # fmt: skip
    said = f", with numbers: line(s) {', '.join(numbers)}" if numbers else ""
    return f"{many} line(s) above the table passed over{said}" if many > 0 else ""


def _last_block(rows: list[list[str]]) -> list[list[str]]:
    """Return the rows below the last empty one, with a row of two fields or more; with those above it if of units."""
    blocks = [[*block] for filled, block in itertools.groupby(rows, lambda row: any(row)) if filled]
    blocks = [block for n, block in enumerate(blocks) if n or any(_filled_fields(row) > 1 for row in block)]
    if len(blocks) < 2 or all(_are_units(row) for row in blocks[-1]):
        return rows
    return blocks[-1]


def _filled_fields(row: list[str]) -> int:
    return sum(map(bool, row))


def _check_names(
    split: list[tuple[int, list[str]]], above: list[list[str]], width: int, decimal: str
) -> None:
    """Refuse names that come again with other units."""
    if not above:
        return
    said = [meaning(c) for c in above[-1]]
    for i, row in split:
        if row in above or len(row) != width or any(is_value(c, decimal) for c in row):
            continue
        now = [meaning(c) for c in row]
        alike = all(replace(a, unit=b.unit, volts=b.volts) == b for a, b in zip(said, now, strict=True))
        other = [n for n, (a, b) in enumerate(zip(said, now, strict=True)) if a.unit != b.unit]
        if alike and other and any(m.role for m in said):
            old, new = above[-1][other[0]], row[other[0]]
            raise ContradictionError(
                f"line {i}: the names come again, and {old!r} is {new!r} from there on; save each part "
                "as a log of its own"
            )


def _fewer_names(head: list[tuple[int, list[str]]], above: list[list[str]], width: int) -> tuple[str, ...]:
    """Return a doubt where a line above the numbers names other columns than there are; none where names are known."""
    for i, row in head if not above else ():
        names = [m for m in meanings(row).values() if m.role in ("time", "reading", "strip")]
        if 1 < len(row) != width and 2 * len(names) > width and len(names) > _FEW:
            return (
                f"line {i} has {len(row)} names, and the lines below it {width} fields: its names are passed "
                "over; if one is missing there, write it in",
            )
    return ()


def _names(above: list[list[str]], width: int) -> list[str]:
    """Return the names of columns from the lines above them: those lines with which the most columns say something."""
    if not above:
        return [f"column {n + 1}" for n in range(width)]
    if any(_tells_apart(row) for row in above):
        above = [row for row in above if not (_says_processing(row) or _says_one(row))]
    units = next((row for row in reversed(above) if _are_units(row)), None)
    above = [row for row in above if row is not units] or above
    best, most = above[-1], -1
    for tall in range(1, len(above) + 1):
        names = _joined(above[-tall:])
        said = Counter(meanings(names).values())
        useful = sum(m.role != "" for m in said) + sum(m.role == "reading" for m in said)
        if useful > most:
            best, most = names, useful
    best = _labelled(above, best)
    if units is None:
        return best
    given = [u.strip("[]() ") for u in units]
    known = [UNITS.get(u) or UNITS.get(u.lower(), "") for u in given]
    if units[0].casefold() in _UNIT_WORDS:  # so the words of that column are of the lines above, and no name
        best = ["", *best[1:]]
    elif meaning(units[0]).role and not known[0]:  # a name beside units, as in "time [s], V, V"
        best = [units[0], *best[1:]]
    return [f"{n} [{u}]" if u and n and not meaning(n).unit else n for n, u in zip(best, known, strict=True)]


def _tells_apart(row: list[str]) -> bool:
    """Return whether a row has another word for each column."""
    return all(row) and len({*row}) == len(row)


def _says_one(row: list[str]) -> bool:
    """Return whether a row says the same words of each column but the first, and no unit, as a remark on the table."""
    others = {*row[1:]}
    return len(row) > _FEW + 1 and len(others) == 1 and not _are_units(row) and not meaning(others.pop()).role


def _says_processing(row: list[str]) -> bool:
    """Return whether a row says how a data logger processed each column, as "Smp" below its unit."""
    said = {cell.casefold() for cell in row if cell}
    return _filled_fields(row) > _FEW and said <= _PROCESSING


def _other_units(above: list[list[str]]) -> tuple[str, ...]:
    """Return a doubt where a line of units says another unit of a column than its name does."""
    units = next((row for row in reversed(above) if _are_units(row)), None)
    for row in above if units else ():
        for name, cell in zip(row, units or (), strict=True):
            said, own = (
                UNITS.get(bare := cell.strip("[]() ")) or UNITS.get(bare.lower(), ""),
                meaning(name).unit,
            )
            if row is not units and said and own and said != own and not is_called_k(name):
                return (
                    f"{name!r} stands above the unit {bare!r}: taken in {own}, as the name says; is it so?",
                )
    return ()


def _labelled(above: list[list[str]], names: list[str]) -> list[str]:
    """Return names, or instead those of a line of labels above them that tell the ends of strips, which these do not.

    As an oscilloscope's "Label,S1_H,S1_L" above "TIME,CH1,CH2".
    """
    if any(m.channel in ("h", "l") for m in meanings(names).values()):
        return names
    for row in above[:-1]:
        labels = [names[0] if meaning(names[0]).role == "time" else row[0], *row[1:]]
        labels = [label or name for label, name in zip(labels, names, strict=True)]
        said = list(meanings(labels).values())
        ends = Counter((m.strip, m.channel) for m in said if m.channel in ("h", "l"))
        if (
            len(ends) > 1 and {end for _, end in ends} == {"h", "l"} and set(ends.values()) == {1}
            and None not in {strip for strip, _ in ends}
            and sum(m.role == "reading" and not m.channel for m in said) == 0
        ):  # fmt: skip
            return labels
    return names


def _joined(rows: list[list[str]]) -> list[str]:
    """Return names of several lines: one that stands over several columns holds for all of them."""
    filled = []
    for row in rows[:-1]:
        spread, last = [], ""
        for n, cell in enumerate(row):
            last = cell or (last if n else "")
            spread.append(last)
        filled.append(spread if any(row[1:]) else [""] * len(row))
    columns = zip(*filled, rows[-1], strict=True)
    names = []
    for parts in columns:
        told = list(dict.fromkeys(p for p in parts if p))
        joined = " ".join(told)
        own = len(told) < 2 or (meaning(joined).role and meaning(told[-1]).role != "time")
        names.append(joined if own else _below_an_end(told))
    return names


def _below_an_end(told: list[str]) -> str:
    """Return the last of a column's names, with the end and the unit that a heading above it says: "Upper end, mV"."""
    for heading in told[:-1] if meaning(told[-1]).role != "time" else ():
        if found := _OF_AN_END.fullmatch(heading):
            unit = UNITS.get((found["unit"] or "").lower(), "")
            if meaning(found["end"]).channel and (unit or not found["unit"]):
                return f"{found['end']} {told[-1]}" + (
                    f" [{unit}]" if unit and not meaning(told[-1]).unit else ""
                )
    return told[-1]


def _distinct(names: Sequence[str]) -> list[str]:
    names = [name or f"column {n + 1}" for n, name in enumerate(names)]
    twice = {name for name, many in Counter(names).items() if many > 1}
    # The place must not be taken for a strip's number, where there is one.
    word = {name: "column " if re.search(r"\d", name) else "" for name in twice}
    return [f"{name} ({word[name]}{n + 1})" if name in twice else name for n, name in enumerate(names)]


def _named(row: Sequence[str], numeric: Sequence[bool], decimal: str, usual: Set[str] = frozenset()) -> int:
    """Return in how many columns of numbers a row has a word, but signs of an untouched strip and what is usual."""
    return sum(
        n and bool(cell) and cell not in usual and not (is_value(cell, decimal) or says_nothing(cell))
        for cell, n in zip(row, numeric, strict=False)
    )


def _statistic(row: Sequence[str], numeric: Sequence[bool], decimal: str) -> str:
    """Return the word that says that a row sums up the others, in a column of numbers or in front."""
    at = next((n for n, cell in enumerate(row) if cell), 0)
    words = [
        cell.strip(" :.=")
        if n == at or (numeric[n] and not is_value(cell, decimal))
        else ""  # 75% is a reading, too
        for n, cell in enumerate(row)
    ]
    found = [w for n, w in enumerate(words) if w.casefold() in _STATISTICS and (numeric[n] or n == 0)]
    return (found or [""])[0]


def _is_note(row: Sequence[str], numeric: Sequence[bool], decimal: str) -> bool:
    """Return whether a row holds a few words only, some in a column of numbers, as below the table of a sheet."""
    filled = [n for n, cell in enumerate(row) if cell]
    return 3 * len(filled) <= len(row) and any(numeric[n] for n in filled) and not any(
        is_value(row[n], decimal) or says_nothing(row[n]) or (re.search(r"\d", row[n]) and not is_prose(row[n]))
        for n in filled
    )  # fmt: skip


def _says_one_number(row: Sequence[str]) -> bool:
    """Return whether a row says the same number of each column, as "Samples, 14, 14, 14"."""
    numbers = [cell for cell in row[1:] if cell]
    counted = meaning(row[0]).role in ("scan", "") and len(numbers) > _FEW
    return counted and len(set(numbers)) == 1 and numbers[0].isdecimal()


def _numbers_columns(row: Sequence[str]) -> bool:
    """Return whether a row only numbers its columns: 0, 1, 2, ... or 1, 2, 3, ..."""
    row = [cell for cell in row if cell]
    return len(row) > _FEW + 1 and any(row == [str(n + base) for n in range(len(row))] for base in (0, 1))


def _are_units(row: list[str]) -> bool:
    """Return whether a header line names units: each of its fields, or of all but the first the same of a reading."""
    if all(
        (cell.strip("[]() ").lower() in {"", "-", "n", "nr", "ts", "rn", "-/-", "1", *UNITS}) for cell in row
    ) and any(row):
        return True
    rest = {UNITS.get(cell.strip("[]() ").lower(), "?") for cell in row[1:] if cell}
    if row[0].casefold() in _UNIT_WORDS and len(rest) <= _FEW and "?" not in rest:
        return True
    return len(rest) == 1 and rest <= set(READING_UNITS) and bool(row[0]) and sum(map(bool, row)) > _FEW


def decimal_mark(rows: Sequence[Sequence[str]]) -> str:
    """Return the decimal mark of fields: a comma where no field has a point, and where it is no thousand's.

    Raises
    ------
    ReadingError
        Both occur, or a comma could be either.
    """
    comma, point = (re.compile(rf"[+-]?\d*\{mark}\d+(?:[eE][+-]?\d+)?(?:\s*[A-Za-z%]+)?") for mark in ",.")
    rows = [[ungrouped(f) for f in row] for row in rows]
    columns = [
        [f for f in column if number_of(f) is not None or comma.fullmatch(f)]
        for column in zip(*rows, strict=True)
    ]
    commas = [f for column in columns for f in column if comma.fullmatch(f)]
    points = [f for column in columns for f in column if point.fullmatch(f)]
    if any(re.fullmatch(r"[+-]?\d{1,3}(\.\d{3})+,\d+", f) for row in rows for f in row):
        return ","
    if commas:  # points of thousands, beside smaller numbers of three digits without
        whole = [c for c in columns if any("." in f for f in c) and any(re.fullmatch(r"\d{3}", f) for f in c)]
        whole = [c for c in whole if all(re.fullmatch(r"\d{1,3}|[1-9]\d{0,2}(\.\d{3})+", f) for f in c)]
        points = [f for c in columns if c not in whole for f in c if point.fullmatch(f)]
    if commas and points:
        raise ReadingError(
            f"decimal points ({points[0]!r}) and decimal commas ({commas[0]!r}) in one log; save "
            f"it with one of them"
        )
    # Of thousands, a column has smaller numbers without a mark, too, or none that begins with 0.
    thousands = [
        column
        for column in columns
        if any(comma.fullmatch(f) for f in column)
        and all(re.fullmatch(r"[+-]?[1-9]\d{0,2}(,\d{3})?", f) for f in column)
        and any("," not in f and not f.startswith("-") for f in column)  # -1 is no reading
    ]
    if thousands:
        shown = next(f for f in thousands[0] if "," in f)
        raise ReadingError(
            f"{shown!r}: a decimal comma, or thousands? Write such numbers with a decimal point, "
            f"without marks in between"
        )
    return "," if commas else "."
