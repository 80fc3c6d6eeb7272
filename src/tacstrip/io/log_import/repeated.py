"""Lines of one form, whatever it is: what changes from one to the next are values, what stays says which."""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Sequence

import numpy as np

from tacstrip.io.log_import.fields import STAMP, is_prose, number_of, says_nothing
from tacstrip.io.log_import.names import TIME_UNITS, UNITS, meaning, unknown_unit
from tacstrip.io.log_import.strays import filled_lines
from tacstrip.io.log_import.table import CLOCK, REPEATED, Table

_HEX = r"[\dA-Fa-f]{2,8}"
_LABELS = re.compile(r"\s*[:=]|.*[A-Za-z]", re.DOTALL)  # behind a number that is a label's
_UNIT = re.compile(r"\s?([^\W\d_]+|%)(?!\w)")
_UNTOUCHED = re.compile(r"(?:touch\w*|contact|press\w*|active)\W{1,3}(?:false|no|none|off)\b", re.IGNORECASE)
_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
# Of what stands for no contact, an "x" may stand between letters, as in "HxLx".
_NOTHING = (
    r"(?<![^\s,;|/:=(\[{<>])(?:(?<!<)-{1,2}(?!>)|-{3,5}|\*{1,5}|_{1,5}|\.{1,5}|[nN]/[aA]|(?![A-Z]x)[A-Za-z]+)"
    r"(?![^\s,;|/:)\]}>])|(?<=[A-Z])x(?=[A-Z\s,;|]|\Z)"
)
_TOKEN = re.compile(
    rf"(?P<clock>(?<![\w.]){STAMP}(?![\w]))|(?P<hex>(?<![\w.])(?:0[xX][\dA-Fa-f]+|(?:(?=[A-Fa-f]*\d){_HEX}|[A-F]{{3,8}}))(?![\w.]))"
    rf"|(?P<number>{_NUMBER})|(?P<nothing>{_NOTHING})"
)
_SAYS = re.compile(r"[:=]")
_WORD = re.compile(r"[^\W\d_]{2,}")
_LABELS_OF_ALL = ("time", "scan", "strip")  # which have one value
_FEW = 3  # lines of one form
_MOST = 0.8  # of the lines with numbers
_LETTERED = 0.1  # of the fields of a column of hexadecimal numbers, at least, have a letter
_FEW_DIGITS = 5  # hexadecimal numbers, of which none has a letter by chance
_LABELLED = 2  # places that a line of no contact has in common with others, such as a time and a strip
_BEFORE = 3  # lines of a record before that of its readings

Line = tuple[int, tuple[str, ...], tuple[str, ...]]  # its number, what stands between its values, and these


def of_repeated(text: str, *, named_only: bool = False) -> Table | None:
    r"""Return the lines of the commonest form as a table of what changes in them; None where too few are of one.

    Lines that stand before each of these, such as a question before its answer, are of the same record. What never
    changes in a place is part of the name of the values behind it. `named_only`: only if lines have a colon or an
    equals sign in them.

    Examples
    --------
    >>> log = "> READ? 0.{0} s\n< ch1=2.{0}/1.{0} ch2=2.5/*\n"
    >>> table = of_repeated("".join(log.format(n) for n in range(1, 5)))
    >>> table.names, table.rows[0]
    (('READ [s]', 'ch1[0]', 'ch1[1]', 'ch2[0]', 'ch2[1]'), ['0.1', '2.1', '1.1', '2.5', '*'])
    """
    split = [(n, *_parted(line)) for n, line in filled_lines(text)]
    main = _main([form for _, form, _ in split])
    if main is None:
        return None
    split = [_filled(line, main) for line in split]
    at = [k for k, (_, form, _) in enumerate(split) if form == main]
    before = _before(split, at)
    records = [split[k - len(before) : k + 1] for k in at]
    records = [r for r in records if [form for _, form, _ in r[:-1]] == before]
    taken = {n for record in records for n, *_ in record}
    values = [[v for _, _, vs in record for v in vs] for record in records]
    if len(records) < _FEW:
        return None
    columns = _in_decimals([list(column) for column in zip(*values, strict=True)])
    ahead = sum(len(form) - 1 for form in before)
    if columns is None:
        return None
    names = _names(_joined([*before, main]), columns, ahead)
    texts = dict(filled_lines(text))
    words = {*_words(main)}
    if named_only and not any(map(_SAYS.search, main)):
        return None
    others = [line for line in split if line[0] not in taken]
    again = Counter(form for _, form, values in others if values)
    if any(many >= _FEW and words & {*_words(form)} for form, many in again.items()):
        return None  # which may be readings of another form
    others.sort(key=lambda line: line[1])
    constant = {
        n for _, group in itertools.groupby(others, key=lambda line: line[1]) for n in _unchanging([*group])
    }
    first = min(taken)
    # Of records that lack a line, or as long as one.
    parts = {n for n, form, vs in others if form in (*before, main) or 2 * len(vs) >= len(main)}
    odd = [n for n in texts if n > first and n not in taken | constant and re.search(r"\d", texts[n])]
    broken = tuple(sorted({*parts, *(n for n in odd if not is_prose(texts[n]))}))
    if len(taken) < _MOST * (len(taken) + len(broken)):
        return None
    kept = [k for k, name in enumerate(names) if name]
    titles = [names[k] for k in kept]
    if not kept or len({*titles}) < len(titles):
        return None
    return Table(
        tuple(titles), [[column[r] for column in (columns[k] for k in kept)] for r in range(len(records))],
        [record[-1][0] for record in records],
        named=not all(re.fullmatch(r"column \d+", t) for t in titles if t != CLOCK),
        remarks=(REPEATED,),
        broken=broken, quotes={n: texts[n] for n in broken},
        preamble=tuple(texts[n] for n in texts if n < first),
    )  # fmt: skip


def _words(form: tuple[str, ...]) -> list[str]:
    return [word for between in form for word in _WORD.findall(between)]


def _parted(line: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return what stands between the values of a line, with blanks of one length, and the values."""
    between, values, last = [], [], 0
    for token in _TOKEN.finditer(line):
        if (
            token.lastgroup == "nothing"
            and token[0].isalpha()
            and not (says_nothing(token[0]) or token[0] == "x")
        ):
            continue
        between.append(line[last : token.start()])
        values.append(token[0].strip())
        last = token.end()
    return tuple(re.sub(r"\s+", " ", b) for b in (*between, line[last:])), tuple(values)


def with_values_of_nothing(lines: list[tuple[int, str]]) -> list[tuple[int, str]]:
    """Return lines with values for those that begin as the others do and say instead that nothing touches.

    Examples
    --------
    >>> lines = [(n, f"t={n} strip=1 h=2.{n}V l=1V") for n in range(3)] + [(4, "t=3 strip=1 state=open")]
    >>> with_values_of_nothing(lines)[3]
    (4, 't=3 strip=1 h=nanV l=nanV')
    """
    split = [(n, *_parted(line)) for n, line in lines]
    main = _main([form for _, form, _ in split])
    if main is None:
        return lines
    filled = [_filled(line, main) for line in split]
    return [
        old if new is one else (new[0], _line(new))
        for old, one, new in zip(lines, split, filled, strict=True)
    ]


def _line(line: Line) -> str:
    return "".join(itertools.chain(*itertools.zip_longest(line[1], line[2], fillvalue="")))


def _main(forms: Sequence[tuple[str, ...]]) -> tuple[str, ...] | None:
    """Return the form in which the most values stand; None where no lines are of one."""
    worth = {
        f: many * (len(f) - 1) for f, many in Counter(forms).items() if many >= _FEW and len(f) > _LABELLED
    }
    return max(worth, key=lambda form: worth[form], default=None)


def _filled(line: Line, main: tuple[str, ...]) -> Line:
    """Return a line that begins as those of the commonest form and says that nothing touches as one of that form."""
    n, form, values = line
    same = next((k for k, (a, b) in enumerate(zip(form, main, strict=False)) if a != b), 0)
    rest = _line((n, form[same:], values[same:]))
    said = _WORD.findall(rest)
    void = _UNTOUCHED.search(rest) or any(map(says_nothing, said))
    # With as many values, or a word of an end, it is of a reading that others have, too.
    short = len(form) < len(main) and not any(meaning(w).channel for w in re.findall(r"[^\W\d_]+", rest))
    if len(said) > 1 and all(map(says_nothing, said)):
        return line  # a row of marks
    if same < _LABELLED or re.search(r"\d", rest) or not (void and short):
        return line
    return n, main, (*values[:same], *["nan"] * (len(main) - 1 - same))


def _joined(forms: Sequence[tuple[str, ...]]) -> list[str]:
    """Return what stands between the values of several lines as of one."""
    made = [""]
    for form in forms:
        made[-1] += f"\n{form[0]}"
        made += form[1:]
    return made


def _before(split: Sequence[Line], at: Sequence[int]) -> list[tuple[str, ...]]:
    """Return the forms of the lines that stand before nearly each of those lines."""
    usual: list[tuple[str, ...]] = []
    for back in range(1, _BEFORE + 1):
        there = Counter(split[k - back][1] for k in at if k >= back)
        form, many = there.most_common(1)[0] if there else ((), 0)
        if many < _MOST * len(at) or form == split[at[0]][1] or len(form) < 2:
            break
        usual.insert(0, form)
    return usual


def _unchanging(lines: Sequence[Line]) -> list[int]:
    """Return lines of one form that say the same each time, but for a time of day before it."""
    said = {tuple(v for v in values if not re.fullmatch(STAMP, v)) for _, _, values in lines}
    return [n for n, *_ in lines] if len(lines) >= _FEW and len(said) == 1 else []


def _in_decimals(columns: list[list[str]]) -> list[list[str]] | None:
    """Return columns with a mark before hexadecimal numbers: all that have as many digits as some with letters.

    None where one may be decimal or hexadecimal.
    """
    there = [[f for f in column if re.fullmatch(_HEX, f)] for column in columns]
    bare = [len(fields) > 0 and len({*map(len, fields)}) == 1 for fields in there]
    lettered = [
        b and sum(not f.isdigit() for f in fields) > _LETTERED * len(fields)
        for b, fields in zip(bare, there, strict=True)
    ]
    widths = {len(fields[0]) for fields, so in zip(there, lettered, strict=True) if so}
    made = []
    for column, fields, is_bare in zip(columns, there, bare, strict=True):
        hexadecimal = is_bare and len(fields[0]) in widths and len({*column}) > 1
        if hexadecimal and all(f.isdigit() for f in fields):
            rises = [
                len({*np.diff([int(f, base) for f in fields]).tolist()}) == 1 < len(fields)
                for base in (10, 16)
            ]
            if rises[0] == rises[1] and len(fields) > _FEW_DIGITS:
                return None
            hexadecimal = not rises[0]
        made.append([f"0x{f}" if hexadecimal and re.fullmatch(_HEX, f) else f for f in column])
    return made


def _names(between: Sequence[str], columns: Sequence[Sequence[str]], main: int) -> list[str]:
    """Return names of columns by what stands before them; "" of those that are none.

    These are numbers which never change, on lines before that of the readings (from place `main` on), or before a word
    or a colon.
    """
    names: list[str] = []
    label, inherited, clocks = "", "", 0
    behind = [_UNIT.match(b) for b in between[1:]]
    units = [UNITS.get(m[1], "") or unknown_unit(f"x [{m[1]}]") if m else "" for m in behind]
    between = [
        between[0],
        *(b[m.end() :] if m and u else b for b, m, u in zip(between[1:], behind, units, strict=True)),
    ]
    for n, column in enumerate(columns):
        label = (label + between[n]).rpartition("\n")[2]
        lettered = re.fullmatch("[A-F]{3,8}", column[0])  # a word, such as ADC
        still = len({*column}) == 1 and (lettered or number_of(column[0]) is not None)
        if still and (lettered or n < main or _LABELS.match(_behind(between, columns, n))):
            label += column[0]
            names.append("")
            continue
        name = ""
        if all(re.fullmatch(STAMP, f) for f in column):
            clocks += 1
            names = ["" if len({*columns[k]}) == 1 else name for k, name in enumerate(names)]
            name = CLOCK if clocks == 1 else ""
            names.append(name)
            label = ""
            continue
        words = re.findall(r"[^\W\d_]+\d*|\d+", label)
        if words:
            numbered = [w for w in words[-2:] if w[-1:].isdecimal()]
            own = " ".join(words[-2:] if numbered else words[-1:])
            number = re.search(r"\d+", own)
            name = own if number or not meaning(own).channel else f"{inherited} {own}".strip()
            inherited = number[0] if number else inherited if meaning(own).channel else ""
        if meaning(name).role in _LABELS_OF_ALL and re.search(r"[\[({]\s*\Z", label):
            name = ""  # a list
        label = ""
        if known := units[n]:
            name = f"{name} [{known}]" if name else f"time [{known}]" if known in TIME_UNITS else ""
        names.append(name or "?")
    return _with_places(names)


def _behind(between: Sequence[str], columns: Sequence[Sequence[str]], at: int) -> str:
    """Return what stands between a value and the next one that changes."""
    text = ""
    for n in range(at, len(columns)):
        text += between[n + 1]
        if n + 1 == len(columns) or len({*columns[n + 1]}) > 1 or number_of(columns[n + 1][0]) is None:
            break
        text += columns[n + 1][0]
    return text


def _with_places(names: list[str]) -> list[str]:
    """Return names with places for those that follow one, as in a list; "column n" where none says what it is."""
    made: list[str] = []
    runs: list[list[int]] = []  # each a name, and those without one behind it
    for n, name in enumerate(names):
        if (
            name == "?"
            and runs
            and (names[runs[-1][0]] == "?" or meaning(names[runs[-1][0]]).role not in _LABELS_OF_ALL)
        ):
            runs[-1].append(n)
        elif name:
            runs.append([n])
    made = list(names)
    many = Counter(names[run[0]] for run in runs if names[run[0]] not in ("?", CLOCK))
    seen: Counter[str] = Counter()
    for run in runs:
        head = names[run[0]]
        if head == CLOCK:
            continue
        said = meaning(head)
        if head == "?" or (
            len(run) > 1 and not (said.role == "reading" and (said.channel or said.strip is not None))
        ):
            made = [f"column {n + 1}" if n in run else name for n, name in enumerate(made)]
        elif len(run) > 1 or many[head] > 1:
            for place, n in enumerate(run):
                made[n] = f"{head}[{seen[head] if many[head] > 1 else place}]"
            seen[head] += 1
    return made
