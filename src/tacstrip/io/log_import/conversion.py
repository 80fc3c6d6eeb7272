"""What the lines around a log's readings say of how these become volts: a factor, signs, full scale, resolution."""

from __future__ import annotations

import bisect
import math
import re
from collections.abc import Collection, Sequence

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.errors import OptionError
from tacstrip.io.log_import.names import LENGTHS_MM, unit_in
from tacstrip.io.log_import.questions import Clues
from tacstrip.io.log_import.table import Table

CODINGS = ("unsigned", "signed", "offset")
_SCALED = re.compile(
    r"\b(?:multipl(?:y|ied|ier|ies|ying)|divided?|dividers?|gains?|amplif\w+|scaled? (?:by|with)"
    r"|scal(?:e|ing) factor)\b"
    # In other languages, which join words and bend them.
    r"|teiler\b|\bgeteilt|multiplizi|verst\u00e4rk|skalier|\bfaktor|diviseur|multiplicat|multiplicad|multipli\u00e9|facteur"
    r"|partitore|moltiplica|amplific|guadagno|fattore|divisor\b|ganancia|ganho|dzielnik|wzmocni|pomno\u017c|mno\u017cn"
    r"|wsp\u00f3\u0142czynnik|d\u011bli\u010d|zes\u00edl|spanningsdeler|versterk|vermenigvuldig|b\u00f6l\u00fcc\u00fc|kazan\u00e7|f\u00f6rst\u00e4rk"
    r"|sp\u00e4nningsdel|\u0434\u0435\u043b\u0438\u0442\u0435\u043b|\u0443\u0441\u0438\u043b\u0435\u043d|\u0443\u043c\u043d\u043e\u0436|\u5206\u5727|\u5206\u538b|\u5206\u58d3|\u5897\u5e45|\u653e\u5927|\u500d"
    r"|\ubd84\uc555|\uc99d\ud3ed",
    re.IGNORECASE,
)
# What no known word explains: 1:2, 1/3, or a factor behind its sign; unless it counts pages, parts, trials.
_RATIO_ALONE = re.compile(
    r"(?<![\w.,:/=[])(?:1 ?[:/] ?(?!1\b)\d{1,3}|(?!1\b)\d{1,3} ?: ?1)(?![\w.,:/]*\d)|(?<![\d\s])\s?[\u00d7\u00f7] ?\d"
)
_COUNTED = re.compile(
    r"\busing\b|page|seite|pagina|p\u00e1gina|strona|teil|part\b|partie|parte|cz\u0119\u015b|run\b|versuch|essai|prova|prueba|pr\u00f3ba|pokus"
    r"|test|file|datei|fichier|plik|blatt|sheet|slot|chunk|block|batch|trial|take|mesure|messung|probe|\bfw|version|\bs/n"
    r"|every|jede|\u7b2c|\u9875|\u30da\u30fc\u30b8|downsampl|decimat|octave|gear|ratio of|ms\b|\bs\b|Hz",
    re.IGNORECASE,
)
_AMPLIFIED = re.compile(
    r"\bgain|amplif|verst\u00e4rk|guadagno|gananc|ganho|wzmocn|zes\u00edl|versterk|f\u00f6rst\u00e4rk|\u0443\u0441\u0438\u043b|\u5897\u5e45|\u653e\u5927|\uc99d\ud3ed",
    re.IGNORECASE,
)
# An offset taken away or added, as "minus 0.1 V offset", or what counts down, as "5 V - pin voltage, inverted".
_SHIFTED = re.compile(
    r"(?=.*\b(?:offset|bias|baseline)\b)(?=.*\b\d+(?:[.,]\d+)?\s?m?V\b)"
    r".*\b(?:minus|plus|less|added|subtract\w*|remov\w*|abgezogen|addiert|soustrait|restad[oa]|sottratt[oa])\b"
    r"|(?<!not )(?<!non-)(?<!non )\b(?:inverted|invertiert|invertid[oa]|invertit[oa]|invers\u00e9e?s?)\b"
    r".*(?:\d\s?m?V\b|\bv_?(?:ref|cc|dd)\b|\b(?:volt|pin|reading|signal|output|value|adc|code)s?\b)"
    r"|(?:\d\s?m?V|\bv_?(?:ref|cc|dd)) (?:minus|-|less) (?:\w+ ){0,3}?"
    r"(?:volt\w*|pin|reading|signal|value|adc)\b",
    re.IGNORECASE,
)
_SUM = re.compile(
    r"\bsums? (?:of|over) (\d+) (?:\S+ ){0,2}?(?:conversions?|samples?|readings?|values?|measurements?|codes)\b",
    re.IGNORECASE,
)
_DIVIDED = re.compile(r"[/\u00f7]|>>|divid|mean\b|averag", re.IGNORECASE)
_UNITY = re.compile(r"\bgain(?: of| is)?[\s:=x\u00d7]{0,4}1(?:\.0+)?(?![\d.,/:]*\d)", re.IGNORECASE)
_OVER_VREF = re.compile(r"\bdivided? by v_?ref", re.IGNORECASE)
_NUMBER = r"\d+(?:\.\d+)?"
_ALONE = re.compile(rf"(?<![\w.])(?:[x\u00d7] ?)?({_NUMBER})(?![\w.]*\d)")
_RATIO = re.compile(rf"(?<![\w.])({_NUMBER}) ?[:/] ?({_NUMBER})(?![\w.])")
_OHMS = re.compile(rf"(?<![\w.])({_NUMBER}) ?[kKM]?(?:[Oo]hms?\b|\u03a9|\u2126|(?<=[kM])\b)")  # of a divider
_NO_FACTOR = frozenset({"", "1", "1.0", "1.00", "no", "off", "none", "false", "-"})
_FEW_SETTINGS = 3  # of a channel
_LONGEST = 100  # characters of a line that are quoted
_RESOLUTION = re.compile(r"analogReadResolution\((\d+)\)|\b(\d{1,2})[\s_-]?bits?\b", re.IGNORECASE)
_OF_TIME = re.compile(r"time|clock|count(?:er|ing)|tick|baud|float", re.IGNORECASE)
_POSSIBLE = range(6, 25)  # bits of converters
_SIGNED = re.compile(r"\b(?:two|2)'?s?[ -]complement|(?<!un)(?<!non-)\bsigned\b|\bbipolar\b", re.IGNORECASE)
_OFFSET = re.compile(r"\boffset[ -]?binary\b|\bmid-?scale\b", re.IGNORECASE)
_CODE = r"(?<![\w.])(0x[\dA-Fa-f]+|\d{3,8})(?![\w.])"
_IS = r"\s*(?:counts?|codes?|lsbs?)?\s*(?:=+>?|\bis\b|\u2259|->|\bmeans\b|\bfor\b|\bcorresponds to\b)\s*"
_CODE_IS = re.compile(
    rf"{_CODE}{_IS}(?:(v_?ref\b|full[ -]?scale\b)|[+]?({_NUMBER})\s*(m?)V\b)", re.IGNORECASE
)
_FULL_IS = re.compile(rf"\bfull[ -]?scale(?: code)?\s*(?:=|is|:)?\s*{_CODE}(?!\s*m?V\b)", re.IGNORECASE)
_STEP = re.compile(
    rf"({_NUMBER})\s*([mu\u00b5]?)V\s*(?:/|per)\s*(?:bit|lsb|count|code|digit)s?\b"
    rf"|\blsb(?: size)?\s*(?:=|:|is)\s*({_NUMBER})\s*([mu\u00b5]?)V\b",
    re.IGNORECASE,
)
_PREFIXES = {"": 1.0, "m": 1e-3, "u": 1e-6, "\u00b5": 1e-6}
_LENGTHS = (
    r"(?:length|l\u00e4nge|longueur|longitud|largo|lunghezza|comprimento|lengte|d\u0142ugo\u015b\u0107)"
)
_BY = r"\s*[*\u00b7\u00d7x]\s*"
_SIZE = r"\d+(?:[.,]\d+)?\s*(?:mm|cm|m)\b"
_PARTS = r"\(?\s*[a-z]\w*\s*/\s*[a-z]\w*\s*\)?"
# A place as a part of the length, as "y = U / Uref * L", "cm = V / Vref * stripLength".
_PLACE = re.compile(
    rf"=\s*(?:{_PARTS}{_BY}(?:L\b|(?:\w+ )?\w*{_LENGTHS}|{_SIZE})|(?:L|\w*{_LENGTHS}|{_SIZE}){_BY}{_PARTS})",
    re.IGNORECASE,
)
_LENGTH_SAID = (  # there or in a setting of its own
    re.compile(
        rf"\b(?:L|\w*{_LENGTHS})\s*[=:]\s*(?P<length>\d+(?:[.,]\d+)?)\s*(?P<unit>mm|cm|m)\b", re.IGNORECASE
    ),
    re.compile(
        rf"{_LENGTHS}[ _]?[\[(]?(?P<unit>mm|cm|m)[\])]?[\"']?\s*[:=]\s*(?P<length>\d+(?:[.,]\d+)?)",
        re.IGNORECASE,
    ),
    # As "U/Uref * strip length (32.5 cm)", "U / Uref x 30 cm".
    re.compile(
        rf"(?:{_LENGTHS}\b[^\d\n(]{{0,30}}\(|{_PARTS}{_BY})\s*(?P<length>\d+(?:[.,]\d+)?)\s*(?P<unit>mm|cm|m)\b",
        re.IGNORECASE,
    ),
)
_NEAR = 0.02  # relative
_USUAL = (8, 10, 12, 14, 16, 18, 20, 24)  # bits
_NOISE = 2e-3  # of half of full scale
_OFTEN, _SELDOM = 0.1, 0.01  # of the readings


def summed(lines: Sequence[str]) -> int:
    """Return of how many conversions each reading is the sum, as lines say; 0 where none or several do.

    Examples
    --------
    >>> summed(["every number is the SUM of 8 conversions"]), summed(["sum of 8 samples / 8"])
    (8, 0)
    """
    found = {int(m[1]) for line in lines if not _DIVIDED.search(line) for m in _SUM.finditer(line)}
    return found.pop() if len(found) == 1 else 0


def factor(clues: Clues) -> float:
    """Return by what readings are to be multiplied; asked where a line speaks of a divider, a gain or a factor."""
    answer = clues.number("scale")
    if answer is not None:
        return answer or 1.0
    if many := summed(clues.table.preamble):
        clues.because(f"readings are sums of {many}, as the log says above them: divided by that")
        return 1.0 / many
    for line in clues.table.preamble:
        text = _bare(_UNITY.sub(" ", line))
        if _SHIFTED.search(text):
            clues.ask(
                "scale",
                f"the log says {text!r}: no factor takes that back. Take it back in the log; or, if its readings stand "
                "as they are,",
                "1",
            )
            continue
        if not (_SCALED.search(text) or _ratio_alone(line)) or _OVER_VREF.search(text) or _STEP.search(text):
            continue
        if _set_to_one(line, clues.table.preamble):
            continue
        ratios = [float(a) / float(b) for a, b in _RATIO.findall(text) if float(a) and float(b)]
        ohms = [float(n) for n in _OHMS.findall(text) if float(n)]
        ratios += [sum(ohms) / r for r in ohms] if len(ohms) == 2 else []
        numbers = [float(n) for n in _ALONE.findall(_OHMS.sub(" ", _RATIO.sub(" ", text))) if float(n)]
        if (ratios or numbers) and {*ratios, *numbers} == {1.0}:
            continue
        likely = [max(r, 1.0 / r) for r in ratios] or numbers
        if _AMPLIFIED.search(text):
            likely = [1.0 / n for n in likely]
        shown = [f"{n:.6g}" for n in dict.fromkeys(likely) if n != 1.0][:2] or ["2"]
        clues.ask(
            "scale",
            f"the log says {text!r}: by what must its readings be multiplied (1: they stand as they are)?",
            "1", *shown,
        )  # fmt: skip
    return 1.0


def _set_to_one(line: str, lines: Sequence[str]) -> bool:
    """Return whether a line names the columns of a logger's settings, and all factors below are 1, off or empty."""
    names = line.split("\t")
    at = [n for n, name in enumerate(names) if _SCALED.search(name)]
    rows = [text.split("\t") for text in lines[lines.index(line) + 1 :]]
    rows = [row for row in rows if len(row) == len(names) > _FEW_SETTINGS]
    forms = [re.sub(r"\d+", "0", row[0]) for row in rows]  # of channels; names may follow
    rows = [row for row, form in zip(rows, forms, strict=True) if form == forms[0]]
    told = {row[n].strip().casefold() for row in rows for n in at}
    return bool(told) and told <= _NO_FACTOR and not re.search(r"\d", line)


def _ratio_alone(line: str) -> bool:
    """Return whether a comment names a ratio that no word of it explains, in whichever language."""
    clauses = re.split(r"[,;]\s", line) if re.match(r"\s*[#%!/;]", line) else []
    return any(_RATIO_ALONE.search(clause) and not _COUNTED.search(clause) for clause in clauses)


def of_lengths(clues: Clues, columns: list[str]) -> float:
    """Return by what readings that are places along the strip, U / Vref * L, are multiplied to be over Vref; else 1.

    That a column in centimetres is one, a line says with its formula, or the answer. Where no column says its unit, a
    title above them may: "Upper edge (cm)".
    """
    units = {unit for name in columns if (unit := length_in(name))}
    titles = [line.strip("#%/ ;,\t\r") for line in clues.table.preamble]
    above = {unit for title in titles if not re.search(r"\d", title) and (unit := length_in(title))}
    unsaid = len(above) == 1 and not any(unit_in(name) for name in columns)
    units = units or (above if unsaid else set())
    answer = clues.answers.get("unit", "")
    if answer not in LENGTHS_MM and (
        answer or len(units) != 1 or not (unsaid or all(map(length_in, columns)))
    ):
        return 1.0
    unit = answer if answer in LENGTHS_MM else units.pop()
    length = clues.sensor.length_mm / LENGTHS_MM[unit] if clues.sensor else 0.0
    text = "\n".join(clues.table.preamble)
    told = next(filter(None, (form.search(text) for form in _LENGTH_SAID if _PLACE.search(text))), None)
    said = 0.0
    if told:
        said = float(told["length"].replace(",", ".")) * LENGTHS_MM[told["unit"].lower()] / LENGTHS_MM[unit]
    if not answer and not (length and abs(said - length) < _NEAR * length):
        clues.ask(
            "unit",
            f"{columns[0]!r} is in {unit}: is it the place along the strip, from the grounded end? (By the spec it is "
            f"{length:g} {unit} long{f', by the log {said:g}' if said else ''}.) Else in which unit is it",
            *([unit] if length else []), "V", "mV", "code",
        )  # fmt: skip
        return 1.0
    if not length:
        raise OptionError(f"--answer unit={unit}: name the SENSOR, whose length tells what that is of Vref")
    clues.because(
        f"readings are places along the strip of {length:g} {unit}, so over that they are over Vref"
    )
    clues.answers = clues.answers | {"unit": "fraction"}
    return 1.0 / length


def length_in(name: str) -> str:
    """Return the unit of a length that a column's name says; "" where it says none.

    Examples
    --------
    >>> length_in("y_high (cm)"), length_in("h [mm]"), length_in("v_h [mV]")
    ('cm', 'mm', '')
    """
    found = re.search(r"[\[(]\s*(mm|cm|m)\s*[\])]\s*\Z|_(mm|cm)\Z", name)
    return (found[1] or found[2]) if found else ""


def coding(clues: Clues, bits: int) -> str:
    """Return how codes of so many bits (0: not known) are to be taken, or "" where that must be asked.

    "unsigned" is from 0 to Vref, "signed" from -Vref to Vref about 0, "offset" so about half of full scale.
    """
    if answer := clues.choice("coding", CODINGS):
        return answer
    text = "\n".join((*clues.table.preamble, *clues.table.names))
    zero, full = told_codes(clues.table)
    half = 2.0 ** (bits - 1) if bits else math.nan
    if zero == half:
        clues.because(f"offset binary: code {zero:g} is 0 V, as the log says")
        return "offset"
    signed, offset = bool(_SIGNED.search(text)), bool(_OFFSET.search(text))
    if signed and not offset and full and full in (half, half - 1.0):
        clues.because(f"signed codes: {full:.9g} is full scale, as the log says")
        return "signed"
    return "" if signed or offset else "unsigned"


def ask_for_coding(clues: Clues) -> None:
    """Ask how codes are to be taken, with the line that leaves it open."""
    said = next(
        (
            line
            for line in (*clues.table.preamble, *clues.table.names)
            if _SIGNED.search(line) or _OFFSET.search(line)
        ),
        "",
    )
    clues.ask(
        "coding",
        f"the log says {_bare(said)!r}: do codes run from 0 to Vref (unsigned), from -Vref to Vref "
        "about 0 (signed), or so about half of full scale (offset)?",
        *(CODINGS[:0:-1] if _OFFSET.search(said) else CODINGS[1:]), CODINGS[0],
    )  # fmt: skip


def _bare(line: str) -> str:
    return " ".join(line.split()).lstrip("#%/! ")[:_LONGEST]


def told_codes(table: Table) -> tuple[float | None, float | None]:
    """Return the codes that the lines above say to be 0 V and to be Vref, or full scale; None where they do not.

    Examples
    --------
    >>> told_codes(Table((), [], [], preamble=("0x8000 = 0 V", "0xFFFF = Vref")))
    (32768.0, 65535.0)
    """
    text = "\n".join(table.preamble)
    zero, full = None, None
    for code, top, volts, _ in _CODE_IS.findall(text):
        if top:
            full = float(int(code, 0))
        elif volts and not float(volts):
            zero = float(int(code, 0))
    for code in _FULL_IS.findall(text):
        full = float(int(code, 0))
    return zero, full


def volts_of_codes(table: Table) -> dict[float, float]:
    """Return code -> volts, as the lines above the table say it, but for 0 V.

    Examples
    --------
    >>> volts_of_codes(Table((), [], [], preamble=("# 1023 = 3.3 V",)))
    {1023.0: 3.3}
    """
    found = _CODE_IS.findall("\n".join(table.preamble))
    return {
        float(int(code, 0)): float(volts) * (1e-3 if milli else 1.0)
        for code, _, volts, milli in found
        if volts and float(volts)
    }


def ask_for_step(clues: Clues, bits: int, vref: float) -> None:
    """Ask by what codes are to be multiplied, where the log says volts of a code that are not those of the spec."""
    if "scale" in clues.answers or not (bits and vref):
        return
    own = vref / (2.0**bits - 1.0)
    for text, step in _steps_told(clues.table):
        if abs(step - own) > _NEAR * own:
            clues.ask(
                "scale",
                f"the log says {text!r}, so that a code is {step:.4g} V, and by the spec it is {own:.4g} V: by what "
                "must readings be multiplied (1: as the spec says)?",
                f"{step / own:.6g}", "1",
            )  # fmt: skip


def step_told(clues: Clues) -> float:
    """Return the volts of one code, where the log says them, and nobody the converter's resolution; else 0."""
    steps = {round(volts, 12) for _, volts in _steps_told(clues.table)}
    return steps.pop() if len(steps) == 1 and "scale" not in clues.answers else 0.0


def ask_for_half(clues: Clues, values: FloatArray, bits: int) -> None:
    """Ask how codes are to be taken where many stay at half of full scale and none below, so that this may be 0 V."""
    if "coding" in clues.answers or clues.sensor is None:
        return
    for half in [2.0 ** (b - 1) for b in ((bits,) if bits else _USUAL)]:
        noise = max(2.0, _NOISE * half)
        at, below = np.abs(values - half) <= noise, values < half - noise
        if at.mean() > _OFTEN and below.mean() < _SELDOM and not at.all():
            clues.ask(
                "coding",
                f"{100.0 * at.mean():.0f} % of the codes are {half:g} or near it, half of full scale of "
                f"{math.log2(half) + 1.0:g} bits, and none is below: is that 0 V (offset), or are codes from 0 to Vref "
                "(unsigned)?",
                "offset", "unsigned",
            )  # fmt: skip
            return


def _steps_told(table: Table) -> list[tuple[str, float]]:
    """Return what a log says of the volts of one code, or of some, and those of one."""
    text = "\n".join((*table.preamble, *table.names))
    found = [
        (m.group(), float(m[1] or m[3]) * _PREFIXES[(m[2] or m[4] or "").casefold()])
        for m in _STEP.finditer(text)
    ]
    return [(said, volts) for said, volts in found if volts] + [
        (f"{code:.9g} is {volts:g} V", volts / code) for code, volts in volts_of_codes(table).items()
    ]


def bits_told(table: Table, vref: float) -> set[int]:
    """Return the bits of converters that a log names, or of which a code that it names is full scale."""
    _, full = told_codes(table)
    codes = [full] if full else []
    codes += [c for c, volts in volts_of_codes(table).items() if vref and abs(volts - vref) < _NEAR * vref]
    powers = {math.log2(c + more) for c in codes for more in (0.0, 1.0)}
    told = {int(p) for p in powers if p == int(p)}
    return {b for b in told | {bits for _, bits, _ in table.resolutions} if b in _POSSIBLE}


def resolutions(text: str, rows: Collection[int]) -> tuple[tuple[int, int, str], ...]:
    r"""Return what lines of a text that are no rows say of the codes' resolution: line, bits, what it says.

    Examples
    --------
    >>> resolutions("# 12 bit\n0,5,6\n", {2}), resolutions("# 16 bit timer\n", ())
    (((1, 12, '12 bit'),), ())
    """
    found = []
    number, at = 1, 0
    for m in _RESOLUTION.finditer(text):
        number, at = number + text.count("\n", at, m.start()), m.start()
        line = text[text.rfind("\n", 0, at) + 1 : (text.find("\n", at) + 1 or len(text) + 1) - 1]
        if number not in rows and (m[1] or not _OF_TIME.search(line)):
            found.append((number, int(m[1] or m[2]), _bare(line)))
    return tuple(found)


def changes_below(table: Table) -> bool:
    """Return whether rows stand between lines that say another resolution each."""
    said = [line for line, _, _ in table.resolutions]
    above = {max(bisect.bisect_left(said, line) - 1, 0) for line in table.lines if said}
    return len({table.resolutions[n][1] for n in above}) > 1
