"""The unit of the readings, and what that needs: the bits of codes, Vref, a sign."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.errors import OptionError, ReadingError
from tacstrip.io.log_import import conversion
from tacstrip.io.log_import.columns import Columns
from tacstrip.io.log_import.fields import says_nothing
from tacstrip.io.log_import.mapping import ColumnMapping
from tacstrip.io.log_import.names import (
    IN_VOLTS,
    LENGTHS_MM,
    OF_VREF,
    READING_UNITS,
    UNITS,
    is_called_k,
)
from tacstrip.io.log_import.questions import Clues
from tacstrip.io.log_import.scans import LogScan

_NEAR_0 = 0.01  # of the largest reading; and of the most that there can be
_FAINT = 0.005  # of what there can be: a log that stays below was hardly made so
# Of Vref: so far above is no offset, and so far may another Vref let readings go; and fewer that do are slips.
_OFF_VREF, _MOST_OVER, _FEW_OVER = 0.01, 2.0, 2
_VREFS = (1.1, 1.8, 2.048, 2.5, 3.0, 3.3, 4.096, 5.0, 10.0, 12.0, 24.0, 48.0)
_MANY = 0.05  # of the readings: more that are exactly 0 are no chance
# Of what there can be: a unit in which a log uses less is out where it uses as much in another.
_LITTLE, _MUCH = 0.21, 0.5
BITS = (8, 10, 12, 14, 16, 24)
_SELDOM = (13,)  # as of a Teensy's converter: offered where no fewer do
# Codes that are full scale and no power of two: of the analog inputs of a PLC, which go on for a part beyond.
_OTHER_FULL_SCALES, _OVER_FULL = (27648,), 1.176
_USUAL_MV = (0.125, 0.1875)  # of a code of converters with a reference of their own, such as the ADS1115
_FEW_CODES = 6  # distinct readings that lie on a converter's steps: no chance
_CODES_SAID = re.compile(r"\b(?:adc|raw|codes?|counts?|lsbs?|digits?)\b", re.IGNORECASE)
_PERCENT = (20.0, 100.0)  # between which the largest reading of a sensor in percent lies as a rule
_ANALOG_READ = re.compile(r"\banalogRead\b")  # of Arduino: it returns the converter's codes
# What says that readings are codes as they come, and what, that these became something else.
_ARE_CODES = re.compile(
    r"\banalogRead\b|\b(?:raw|direct|plain|unscaled|unconverted)\b[^.;]{0,20}?\b(?:adc|codes?|counts?|readings?|values?)\b"
    r"|\badc[ _-](?:codes?|counts?|values?|readings?)\b|\b(?:adc|wandler)-?(?:rohwerte?|werte?|codes?)\b|\brohwerte?\b"
    r"|\b(?:valeurs?|valores?|valori)\s+(?:brut\w*|crud\w*|grezz\w*|en bruto|brutos?)\b",
    re.IGNORECASE,
)
_CONVERTED = re.compile(
    r"convert|calib|scaled|umgerechnet|kalibr|conversion|\*|\bm?V\b|milli|volt|->|\bto\b|\binto\b|\bnot\b",
    re.IGNORECASE,
)
_BITS_TOLD = re.compile(r"\b(\d{1,2})[\s_-]?bits?\b", re.IGNORECASE)
_UNIT_TOLD = re.compile(
    r"\b(?:units?|readings?|values?|voltages?|signals?|channels?|data|in|all|normali[sz]ed|ratiometric"
    r"|einheit(?:en)?|unit[\u00e9\u00e0]s?|unidad(?:es)?|jednostk\w|\u5355\u4f4d|\u55ae\u4f4d|\u5358\u4f4d|\ub2e8\uc704)"
    r"\b[^\n,;]{0,16}?"
    r"(?<![\w])(mV|[uµ]V|V|volts?|millivolts?|microvolts?|counts?|codes?|percent|%|‰"
    r"|to Vref|of Vref|over Vref|/ ?Vref)(?!\w)|\b(counts|codes|LSBs?)\b",
    re.IGNORECASE,
)
# What is said in prose: "ratios to Vref", "RATIO_OF_VREF", "permille of the supply", "these are *millivolts*".
_UNIT_IN_PROSE = (
    (
        re.compile(
            r"(?:ratios?|fractions?|ratiometric)[\s_]+(?:to|of|over)[\s_]+(?:the[\s_]+)?(?:v_?ref|vcc|vdd|supply|ref)",
            re.I,
        ),
        "fraction",
    ),
    (
        re.compile(r"\bper ?mille?\b[\s_]+of[\s_]+(?:the[\s_]+)?(?:v_?ref|vcc|vdd|supply|ref|full)", re.I),
        "permille",
    ),
    (
        re.compile(r"(?:\bpercent|%)[\s_]+of[\s_]+(?:the[\s_]+)?(?:v_?ref|vcc|vdd|supply|ref|full)", re.I),
        "percent",
    ),
    (
        re.compile(
            r"(?<![\w.])0(?: ?\.\. ?| to | ?- ?)1 of (?:the )?(?:v_?ref|vcc|vdd|supply|\d+V\d*)\b", re.I
        ),
        "fraction",
    ),
    (re.compile(r"(?<![\w\d])(?<!\d )millivolts\b", re.I), "mV"),
)
_OF_OTHERS = re.compile(r"batter|supply|vbat|temp|v_?ref|aref|vcc|vdd|\btime\b|\bbaud\b", re.IGNORECASE)
_OVER_VREF = re.compile(r"=\s*\w+\s*\.?/\s*V_?ref\b", re.IGNORECASE)  # as in "Vh = raw/Vref"


def with_unit(clues: Clues, mapping: ColumnMapping, found: Columns, rough: list[LogScan]) -> ColumnMapping:
    """Return the mapping with the unit of its readings, and what that needs."""
    sensor = clues.sensor
    values = np.concatenate([s.values.ravel() for s in rough])
    values = values[np.isfinite(values)]
    answer = clues.choice("unit", (*READING_UNITS, *LENGTHS_MM))
    vref = clues.number("vref_volt") or (sensor.vref_volt if sensor else 0.0)
    bits = _stated_bits(clues)
    if not len(values):
        return replace(mapping, unit=answer or "V")
    if values.max() < 0.0 < mapping.zero:
        raise OptionError(
            f"codes reach {values.max() + mapping.zero:g}, below {mapping.zero:g}, which would be 0 V: they are not "
            "offset by half; say --answer coding=signed or coding=unsigned"
        )
    told = [found.meanings[n] for n in mapping.columns]
    named = _named_units(clues, mapping, {m.unit for m in told} - {""}, values, bits, vref, answer)
    unit = answer or (
        named.pop()
        if len(named) == 1
        else _unit_by_size(clues, values, vref / mapping.scale, bits, any(m.volts for m in told))
    )
    mapping, unit, bits, how = _with_codes(clues, mapping, values, unit, bits, vref)
    if mapping.scale != 1.0:
        clues.because(f"readings are multiplied by {mapping.scale:g}")
    if sensor is None and (unit in ("fraction", "percent") or how != "unsigned") and not vref:
        clues.ask(
            "vref_volt",
            "the readings are parts of Vref: how many volts is that? Or name the SENSOR",
            "5",
            "3.3",
        )
    if other := _above_vref(clues, values, unit, vref / mapping.scale, answer):
        return replace(mapping, unit=unit, vref_volt=other)
    full = (2.0**bits - 1.0) / min(mapping.scale, 1.0)
    top = (_largest_possible(vref, mapping.scale) | {"code": full}).get(unit, 0.0)
    _check_size(clues, values, unit, top, vref, answer)
    plain = how == "unsigned" and mapping.scale == 1.0
    own = sensor is None or bits == sensor.adc_bits
    other_bits = 0 if unit != "code" or (plain and own) else bits
    if sensor and (vref == sensor.vref_volt or unit not in IN_VOLTS):
        vref = 0.0
    if sensor and vref:
        clues.doubt(
            f"volts of Vref = {vref:g} are written as such of vref_volt = {sensor.vref_volt:g} of the spec, with the "
            f"same ratios; better put vref_volt = {vref:g} into the spec and import again"
        )
    return replace(mapping, unit=unit or "V", vref_volt=vref, adc_bits=other_bits)


def _named_units(
    clues: Clues, mapping: ColumnMapping, named: set[str], values: FloatArray, bits: int, vref: float,
    answer: str,
) -> set[str]:  # fmt: skip
    """Return the units that columns' names say, if the readings can be in them; codes where fields say these."""
    whole = bool((values == np.round(values)).all())
    if named == {"fraction"} and not whole and 1.0 + _OFF_VREF < values.max() <= 1.0 / OF_VREF["percent"]:
        named = set()  # a ratio in percent, say
    if named == {"code"} and not (whole or answer) and values.max() <= max(vref, 1.0):
        named = set()  # "raw" volts, say, for no converter has so few codes
    if named == {"fraction"} and values.max() > 1.0 and all(map(is_called_k, mapping.columns)):
        named = {"code"} if bits and whole else set()
        if named and values.max() <= 1.0 / OF_VREF["permille"] and not answer:
            clues.doubt(
                f"{next(iter(mapping.columns))}, ...: whole numbers up to {values.max():g} are taken as codes of "
                f"{bits} bits; if they are thousandths of Vref, --answer unit=permille"
            )
    filled = [f for n in mapping.columns for f in clues.table.column(n) if not says_nothing(f)]
    if not named and ("coding" in clues.answers or all(f[:2].casefold() == "0x" for f in filled)):
        named = {"code"}
    contrary = len(named) == 1 and named <= {*IN_VOLTS} and _may_be_codes(values, bits) and not answer
    if contrary and (said := _line_of_codes(clues)):
        clues.ask(
            "unit",
            f"the columns are named as of {min(named)}, and the log says {said!r}, which are codes: in which unit are "
            "the readings?",
            min(named), "code",
        )  # fmt: skip
    return named


def _with_codes(
    clues: Clues, mapping: ColumnMapping, values: FloatArray, unit: str, bits: int, vref: float
) -> tuple[ColumnMapping, str, int, str]:
    """Return the mapping, the unit, the bits of codes without a sign, and how codes are taken ("" if not known)."""
    open_unit = next((q for q in clues.questions if q.key == "unit"), None)
    step = 0.0 if bits or mapping.scale != 1.0 else conversion.step_told(clues)
    if unit == "code" and not open_unit and 0.0 < step * values.max() <= (1.0 + _OFF_VREF) * (vref or np.inf):
        clues.because(f"codes of {step:g} V each, as the log says")
        mapping, unit = replace(mapping, scale=step), "V"
    elif unit == "code" or (open_unit and clues.sensor and "code" in open_unit.choices and not step):
        bits = _bits(clues, values, bits, mapping.scale)
    if unit == "code":
        conversion.ask_for_half(clues, values, bits)
    how = conversion.coding(clues, bits) if unit == "code" else "unsigned"
    if not how:
        conversion.ask_for_coding(clues)
    bits -= how in ("signed", "offset") and bits > 0
    if unit == "code" and how and "adc_bits" not in {q.key for q in clues.questions}:
        conversion.ask_for_step(clues, bits, vref)
    return mapping, unit, bits, how


def _above_vref(clues: Clues, values: FloatArray, unit: str, vref: float, answer: str) -> float:
    """Ask for Vref where readings in volts reach above the spec's, or it states none; in the first case return it.

    `vref` is that of readings as they stand, before they are multiplied.
    """
    if (
        unit not in IN_VOLTS or not clues.sensor or "vref_volt" in clues.answers
        or "unit" in {q.key for q in clues.questions}
    ):  # fmt: skip
        return 0.0
    own, top = clues.sensor.vref_volt, _largest_possible(vref)[unit]
    over = values > (1.0 + _OFF_VREF) * top
    if over.sum() > _FEW_OVER and over.mean() > _MANY and values.max() <= _MOST_OVER * top and not answer:
        fits = [f"{v:g}" for v in _VREFS if v >= 0.99 * values.max() * IN_VOLTS[unit]][:2]
        clues.ask(
            "vref_volt",
            f"readings reach {values.max():g} {unit}, above vref_volt = {own:g} of the spec: with which Vref was "
            "the log made (then put it into the spec, too)? If they were amplified, scale=0.5 (by what to "
            "multiply them); if they are no volts, --answer unit=code (mV, ...)",
            *fits,
        )  # fmt: skip
        return float(fits[0])
    if clues.stated is not None and "vref_volt" not in clues.stated:
        clues.ask(
            "vref_volt",
            f"readings are in {unit}, and the spec does not state vref_volt (unset, it is {own:g} V): how "
            "many volts is Vref? Or write it into the spec",
            f"{own:g}", "3.3",
        )  # fmt: skip
    return 0.0


def _check_size(clues: Clues, values: FloatArray, unit: str, top: float, vref: float, answer: str) -> None:
    """Refuse readings above `top`, the most that there can be; ask for the unit, or doubt it, far below that."""
    if unit and top and values.max() > 1.01 * top and "unit" not in {q.key for q in clues.questions}:
        raise ReadingError(
            f"a reading of {values.max():g} is above {top:g}, the most that there can be in {unit}; check the unit "
            f"(--answer unit=...) and {'adc_bits' if unit == 'code' else 'vref_volt'} in the spec"
        )
    if unit and top and values.max() < _NEAR_0 * top and not answer:
        most = _largest_possible(vref)
        others = [u for u in ("V", "mV", "fraction", "percent") if u != unit and most[u] >= values.max()]
        others = [u for u in others if values.max() > _LITTLE * most[u]] or others[:2]
        own = not (
            unit in IN_VOLTS and "V" in others and _LITTLE * vref < values.max()
        )  # which would be refused
        clues.ask(
            "unit",
            f"the log says {unit}, of which there can be {top:g}, and no reading is above {values.max():g}: is the "
            "mark in them one of thousands (then save them without), or are they in another unit?",
            *others, *([unit] if own else []),
        )  # fmt: skip
    if answer and top and values.max() < _FAINT * top:
        if answer in IN_VOLTS and answer != "V" and _LITTLE * vref < values.max() <= vref:
            raise OptionError(
                f"--answer unit={answer}: no reading is above {values.max():g} of {top:g} {answer} then; they fit V: "
                "--answer unit=V (if they are of an untouched sensor, write unit into a --mapping)"
            )
        clues.doubt(f"in {answer}, no reading is above {values.max():g} of {top:g}: is that the unit?")
    whole = answer == "mV" and bool((values == np.round(values)).all())
    bits = clues.sensor.adc_bits if clues.sensor else 0
    if whole and bits and _lies_off_steps(values, vref, bits):
        clues.doubt(f"in mV, readings do not lie on the steps of the spec's {bits} bits: are they codes?")


def _stated_bits(clues: Clues) -> int:
    """Return the bits of codes by the answer or the spec; 0 where neither says them."""
    return int(clues.number("adc_bits") or (clues.sensor.adc_bits or 0 if clues.sensor else 0))


def with_zero(clues: Clues, mapping: ColumnMapping) -> ColumnMapping:
    """Return the mapping with the code of 0 V, where the log or the answer says that codes are offset by half."""
    bits = _stated_bits(clues)
    zero, _ = conversion.told_codes(clues.table)
    told = clues.answers.get("coding", "" if zero is None or zero != 2.0 ** (bits - 1) else "offset")
    return replace(mapping, zero=2.0 ** (bits - 1)) if told == "offset" and bits else mapping


def _bits(clues: Clues, values: FloatArray, bits: int, scale: float) -> int:
    """Return the bits of codes, 0 where nobody says them; ask where these are none, or are above the spec's."""
    broken = values[values != np.round(values)]
    if len(broken):
        clues.ask(
            "unit", f"the readings are called codes, and {broken[0]:g} is none: which unit?", "V", "fraction"
        )
        return 0
    told = {int(b) for b in _BITS_TOLD.findall("\n".join((*clues.table.preamble, *clues.table.names)))} & {
        *BITS
    }
    told |= conversion.bits_told(clues.table, clues.sensor.vref_volt if clues.sensor else 0.0)
    if "adc_bits" not in clues.answers and conversion.changes_below(clues.table):
        said = clues.table.resolutions
        line, _, other = next(r for r in said if r[1] != said[0][1])
        raise ReadingError(
            f"line {said[0][0]} says {said[0][2]!r}, and line {line} {other!r}: save what is of each as a log of its "
            "own, or, if all codes are of one, --answer adc_bits=..."
        )
    if not bits and len(told) == 1 and values.max() <= 2.0 ** min(told) - 1.0:
        bits = told.pop()
        clues.because(f"codes of {bits} bits, as the log says")
        return bits
    if bits and told and bits not in told and "adc_bits" not in clues.answers:
        clues.ask(
            "adc_bits", f"the log says {min(told)} bit, and the spec adc_bits = {bits}: which is it?",
            *(str(b) for b in (*sorted(told), bits)),
        )  # fmt: skip
    over = bits and min(scale, 1.0) * values.max() > 2.0**bits - 1.0  # or a sum of several
    if (over or not bits) and clues.sensor is not None:
        fits = _bits_that_fit(float(values.max()))
        why = f"and adc_bits = {bits}" if bits else "and the spec has no adc_bits"
        beside = "(If its range is not Vref, say the volts of a code: unit=0.125mV)" if not bits else ""
        ways = [f"{b}bit" for b in fits]
        ways += _other_steps(float(values.max()), clues.sensor.vref_volt) * (not bits)
        if _asked_with_bits(clues, ways, beside):
            return 0
        text = f"codes reach {values.max():g}, {why}: how many bits has the converter? {beside}".rstrip()
        if len(ways) > len(fits):
            clues.ask("unit", f"{text} Or which code is Vref (unit=1/27648)?", *ways)
            return 0
        clues.ask("adc_bits", text, *fits)
        return 0
    return bits


def _bits_that_fit(top: float) -> list[str]:
    """Return the usual resolutions of which a log that reaches `top` uses more than a faint part.

    Examples
    --------
    >>> _bits_that_fit(661.0), _bits_that_fit(22142.0), _bits_that_fit(9.0)
    (['10', '12', '14'], ['16'], ['8', '10'])
    """
    fits = [b for b in (*BITS[:3], *_SELDOM, *BITS[3:]) if top <= 2.0**b - 1.0]
    fits = [b for b in fits if b not in _SELDOM or b == fits[0]]
    return [str(b) for b in [b for b in fits if top > _FAINT * 2.0**b][:3] or fits[:1]]


def _other_steps(top: float, vref: float) -> list[str]:
    """Return what a code may be but Vref over a power of two, of those in use: parts of Vref, or volts."""
    parts = [f"1/{n}" for n in _OTHER_FULL_SCALES if _MUCH * n < top <= _OVER_FULL * n]
    return parts + [
        f"{mv:g}mV" for mv in _USUAL_MV if _LITTLE * vref < 1e-3 * mv * top <= (1.0 + _OFF_VREF) * vref
    ]


def _asked_with_bits(clues: Clues, ways: list[str], beside: str) -> bool:
    """Return whether the unit is asked, in the question of which codes now stand with their bits: one is enough."""
    at = next((n for n, q in enumerate(clues.questions) if q.key == "unit" and "code" in q.choices), None)
    if at is None:
        return False
    asked = clues.questions[at]
    choices = [c for u in asked.choices for c in (ways or [u] if u == "code" else [u])]
    clues.questions[at] = replace(asked, text=f"{asked.text} {beside}".rstrip(), choices=tuple(choices))
    return True


def _unit_by_size(clues: Clues, values: FloatArray, vref: float, bits: int, volts: bool) -> str:
    """Return the unit that the readings' size and steps leave, and a question where there are several."""
    whole, top = bool((values == np.round(values)).all()), float(values.max())
    fits = _used(values, vref, bits)
    if top > 1.0 and not whole:
        if "V" not in fits and top <= _MOST_OVER * vref:
            return "V"  # of another Vref, which is asked
        fits = {"V": fits["V"]} if "V" in fits else fits
    likely = _likely_units(clues, values, vref, bits, volts, fits)
    if len(likely) > 1 and vref and bits and (steps := _on_steps(values, vref, bits)) in likely:
        clues.because(f"readings are in {steps}: all lie on the steps of {bits} bits, which is no chance")
        return steps
    if len(likely) > 1 and (said := _unit_said(clues, likely, bits, volts, top)):
        return said
    if len(likely) == 1:
        of = f", and Vref is {vref * (clues.number('scale') or 1.0):g} V" if vref else ""
        clues.because(f"readings are in {likely[0]}: they reach {top:g}{of}")
        return likely[0]
    if whole and likely and top <= _PERCENT[1]:
        likely = [*likely, "percent"]
    clues.ask(
        "unit", f"readings reach {top:g}{' in whole numbers' if whole else ''}: in which unit?",
        *(u for u in READING_UNITS if u in (likely or READING_UNITS)),
    )  # fmt: skip
    return likely[0] if likely else "V"


def _used(values: FloatArray, vref: float, bits: int) -> dict[str, float]:
    """Return the units that readings may be in, by their size, and which part of what there can be they use."""
    whole, top = bool((values == np.round(values)).all()), float(values.max())
    most = _largest_possible(vref or 24.0)
    rare = {u: most.pop(u) for u in ("permille", "uV", "cV", "dV")}
    if whole and top > 1.0:
        few = len(set(values.tolist())) < 4
        fitting = [b for b in BITS if vref and top <= 2.0**b - 1.0]
        width = bits or (fitting or BITS[-1:])[0]
        most = {"code": 2.0**width - 1.0, "mV": most["mV"]} | ({"V": most["V"]} if few else {})
    fits = {u: top / m for u, m in most.items() if top <= m}
    if bits and whole and top > most.get("code", top):
        fits["code"] = 1.0  # of another converter than the spec's, which would be asked
    if top > most["mV"]:
        fits["uV"] = top / rare["uV"]
    return {u: used for u, used in fits.items() if 0.0 < used <= 1.0}


def _likely_units(
    clues: Clues, values: FloatArray, vref: float, bits: int, volts: bool, fits: dict[str, float]
) -> list[str]:
    """Return the units that are left of those that fit, by how much of them is used, and by the converter's steps."""
    whole, top = bool((values == np.round(values)).all()), float(values.max())
    best = max(fits.values(), default=0.0)
    in_mv = fits.get("mV", 0.0)
    if (
        whole
        and bits
        and {*fits} == {"code", "mV"}
        and in_mv < _LITTLE
        and _lies_off_steps(values, vref, bits)
    ):
        if best < _MUCH and not _codes_said(clues, vref):
            clues.doubt(
                f"readings reach {top:g}: taken as codes of {bits} bits, of which adc_bits speaks, for they do not lie "
                "on the steps of these in mV; else --answer unit=mV"
            )
        best = max(best, _MUCH)  # so few of the millivolts, and not on the converter's steps of them
    if whole and {*fits} == {"code", "mV"} and _stay_at_full_scale(values, vref, bits):
        clues.doubt(
            f"readings are {top:g} again and again: taken as codes of {bits} bits, of which adc_bits speaks, for that "
            "is their full scale, and they do not lie on the steps of these in mV; else --answer unit=mV"
        )
        return ["code"]
    likely = [u for u, part in fits.items() if part >= _LITTLE or best < _MUCH]
    likely = [u for u in likely if not vref or fits[u] >= _FAINT] or likely
    if not likely and {*fits} == {"code", "mV"}:
        likely = ["code"]  # not those millivolts, however few codes they are
    if volts and ((not whole and "V" in fits) or (whole and len(fits) > 1)):
        likely = list(fits)
    spec_bits = clues.sensor.adc_bits if clues.sensor else 0
    if likely == ["code"] and "mV" in fits and not spec_bits and not _tells_bits(clues, vref):
        if "adc_bits" in clues.answers:
            clues.doubt(
                f"readings reach {top:g}: taken as codes, of which adc_bits speaks; else --answer unit=mV"
            )
        else:  # nothing says that there are codes
            likely.insert(0, "mV")
    if (
        whole and bits and likely == ["code"] and _PERCENT[0] < top <= _PERCENT[1] and not volts
        and not _codes_said(clues, vref)
    ):  # fmt: skip
        likely.append("percent")  # codes of touched strips seldom stay below that
    if likely == ["fraction"] and vref:
        likely.append("V")  # a light touch reads as little
    if likely == ["mV"] and vref and in_mv < _LITTLE and top <= 1.0 / OF_VREF["permille"]:
        likely.append("permille")
    return likely


def _unit_said(clues: Clues, likely: list[str], bits: int, volts: bool, top: float) -> str:
    """Return the one of several likely units that lines above the readings say; "" where they say none."""
    clauses = re.split(r"[,;\n]", "\n".join(clues.table.preamble))
    clauses = [clause for clause in clauses if not _OF_OTHERS.search(clause)]
    said = {w.casefold() for w in _UNIT_TOLD.findall("\n".join(clauses)) for w in w if w}
    named = {"fraction" if w.endswith("vref") else UNITS.get(w, "") for w in said}
    prose = (*clues.table.preamble, *_fixed_fields(clues))
    named |= {unit for words, unit in _UNIT_IN_PROSE if any(map(words.search, prose))}
    named |= {"fraction"} if any(map(_OVER_VREF.search, clues.table.preamble)) else set()
    if len(named) == 1 and named <= set(likely):
        clues.because(f"readings are in {min(named)}, as the log says")
        return named.pop()
    if "code" not in likely or said or volts:
        return ""
    if _ANALOG_READ.search("\n".join(clues.table.preamble)):
        clues.because("readings are codes, for analogRead returns these")
        return "code"
    told = {int(b) for b in _BITS_TOLD.findall("\n".join(clues.table.preamble))}
    if bits in told:
        clues.because(f"codes of {bits} bits, as the log says above them")
        return "code"
    if bits and top <= 2.0**bits - 1.0 and (raw := _raw_said(clues)):
        clues.because(f"codes of {bits} bits: they fit these, and {raw!r} says raw")
        return "code"
    return ""


def _tells_bits(clues: Clues, vref: float) -> bool:
    return bool(_BITS_TOLD.search(_above(clues)) or conversion.bits_told(clues.table, vref))


def _codes_said(clues: Clues, vref: float) -> bool:
    """Return whether the log or an answer says that readings are codes."""
    said = _ANALOG_READ.search(_above(clues)) or _CODES_SAID.search(_above(clues)) or _raw_said(clues)
    return bool(said or _tells_bits(clues, vref) or {"adc_bits", "coding"} & {*clues.answers})


def _above(clues: Clues) -> str:
    return "\n".join((*clues.table.preamble, *clues.table.names))


def _line_of_codes(clues: Clues) -> str:
    """Return the line above the readings that says them to be a converter's codes, and of no conversion; else ""."""
    return next(
        (
            " ".join(line.split()).lstrip("#%/! ")
            for line in clues.table.preamble
            if _ARE_CODES.search(line) and not _CONVERTED.search(line)
        ),
        "",
    )


def _may_be_codes(values: FloatArray, bits: int) -> bool:
    return bool((values == np.round(values)).all() and values.max() <= 2.0 ** (bits or BITS[-1]) - 1.0)


def _raw_said(clues: Clues) -> str:
    """Return what says "raw": a column's name, a field that stays as a topic does, a line of no conversion; or ""."""
    said = [" ".join(line.split()) for line in clues.table.preamble if not _CONVERTED.search(line)]
    texts = (*clues.table.names, *_fixed_fields(clues), *said)
    return next((t for t in texts if re.search(r"(?<![a-z])raw(?![a-z])", t, re.I)), "")


def _fixed_fields(clues: Clues) -> list[str]:
    """Return the fields of columns that say the same on all lines, as a topic or a unit does."""
    return [fields[0] for n in clues.table.names if len({*(fields := clues.table.column(n))}) == 1]


def _largest_possible(vref: float, scale: float = 1.0) -> dict[str, float]:
    """Return the most that there can be in each unit but codes, of readings that are to be multiplied by `scale`."""
    most = {u: vref / volts for u, volts in IN_VOLTS.items()} | {u: 1.0 / part for u, part in OF_VREF.items()}
    return {u: value / scale for u, value in most.items()}


def _lies_off_steps(values: FloatArray, vref: float, bits: int) -> bool:
    """Return whether several whole numbers lie between the steps in millivolts of a converter, rounded."""
    step = 1000.0 * vref / 2.0**bits
    distinct = np.unique(values)
    off = np.abs(distinct - step * np.round(distinct / step))
    return step > 2.0 and int((off > 1.0).sum()) >= _FEW_CODES


def _stay_at_full_scale(values: FloatArray, vref: float, bits: int) -> bool:
    """Return whether several readings are a converter's full scale, and readings are none of its millivolts.

    Without its bits that tells nothing: other converters stay at 1023, 2047 or 4095 mV, in ranges of their own.
    """
    top = values.max()
    often = int((values == top).sum()) >= _FEW_CODES
    return bool(bits and top == 2.0**bits - 1.0 and often and _lies_off_steps(values, vref, bits))


def _on_steps(values: FloatArray, vref: float, bits: int) -> str:
    """Return "V" or "mV" where all readings are rounded images of a converter's codes, which others would not be."""
    texts = {f"{v:.9g}" for v in values.tolist()}
    places = max(len(t.partition(".")[2]) for t in texts)
    quantum = 10.0**-places
    for unit, full in (("V", vref), ("mV", 1000.0 * vref)):
        for codes in (2.0**bits - 1.0, 2.0**bits):
            step = full / codes
            chance = min(1.0, 1.01 * quantum / step) ** len(texts)  # that numbers at random lie so near
            off = np.abs(values - step * np.round(values / step))
            if len(texts) >= _FEW_CODES and chance < 1e-4 and (off <= 0.501 * quantum).all():
                return unit
    return ""
