"""Logs in the dialects of tools and languages give the same readings, or say what is wrong with them."""
# ruff: noqa: E501 (a line is a form)

from __future__ import annotations

import json
import re

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.io.log_import.guess import Proposal, propose
from tacstrip.io.log_import.questions import Unanswered
from tacstrip.io.log_import.text import of_text

SKIN = ts.Sensor(construction="crs-crs", strips=3, pitch_mm=10.0, length_mm=50.0, vref_volt=5.0, adc_bits=10)
NAN = float("nan")
H = np.array([[NAN, NAN, NAN], [2.513, 2.701, NAN], [2.488, 2.655, 2.902], [NAN, 2.61, 2.877]])
L = np.array([[NAN, NAN, NAN], [1.204, 1.377, NAN], [1.262, 1.391, 1.618], [NAN, 1.355, 1.604]])
T, N = (0.0, 0.05, 0.1, 0.15), range(3)


def f(x: float, nothing: str = "nan") -> str:
    return nothing if np.isnan(x) else f"{x:.3f}"


def pairs(by: str, form: str, nothing: str = "--") -> list[str]:
    return [
        by.join(
            form.format(i=i, h=f(h, nothing), l=f(low, nothing))
            for i, h, low in zip(N, H[s], L[s], strict=True)
        )
        for s in range(4)
    ]


def rows(form: str, nothing: str = "nan") -> str:
    return (
        "\n".join(
            form.format(t=T[s], i=i, h=f(H[s, i], nothing), l=f(L[s, i], nothing), ms=round(1000 * T[s]))
            for s in range(4)
            for i in N
        )
        + "\n"
    )


def wide(nothing: str = "") -> list[str]:
    return [f"{t}," + ",".join(f(x, nothing) for i in N for x in (H[s, i], L[s, i])) for s, t in enumerate(T)]


HEAD = "t [s],h0,l0,h1,l1,h2,l2\n"
FORMS = {
    "teleplot": ">boot:ok|t\n" + rows(">H{i}:{ms}:{h}§V\n>L{i}:{ms}:{l}§V"),
    "influx": "".join(f"skin,rig=B2,strip={i} vh={f(H[s, i], '0')},vl={f(L[s, i], '0')} {1763820000000000000 + round(1e9 * t)}\n" for s, t in enumerate(T) for i in N),
    "yaml of ROS": "---\n".join(f"header:\n  stamp:\n    sec: 1763820000\n    nanosec: {round(1e9 * t)}\nvh:\n" + "".join(f"- {f(x, '.nan')}\n" for x in H[s]) + "vl:\n" + "".join(f"- {f(x, '.nan')}\n" for x in L[s]) for s, t in enumerate(T)),
    "yaml of records": "".join(f"- time: {t}\n  strips:\n" + "".join(f"    - {{id: {i}, high: {f(H[s, i], 'null')}, low: {f(L[s, i], 'null')}}}\n" for i in N) for s, t in enumerate(T)),
    "html": "<table><tr>" + "".join(f"<th>{n}</th>" for n in HEAD.split(",")) + "</tr>" + "".join("<tr>" + "".join(f"<td>{c or '&nbsp;'}</td>" for c in row.split(",")) + "</tr>\n" for row in wide()) + "</table>",
    "latex": "\\begin{tabular}{rrrr}\n\\toprule\n$t$/s & strip & $v_h$/V & $v_l$/V \\\\\n\\midrule\n" + rows("{t} & {i} & {h} & {l} \\\\", "--") + "\\bottomrule\n\\end{tabular}",
    "sql": rows("INSERT INTO readings (t, strip, high, low) VALUES ({t}, {i}, {h}, {l});", "NULL"),
    "topics": rows("14:03:21.{ms:03d} lab/skin/{i}/high {h}\n14:03:21.{ms:03d} lab/skin/{i}/low {l}"),
    "pairs by strips": "".join(f"{t} s | #{s:03d} | {row}\n" for s, (t, row) in enumerate(zip(T, pairs(" | ", "S{i} {h}/{l}"), strict=True))),
    "a journal": "".join(f"Nov 22 14:03:21.{round(1000 * t):03d} pi skin[81]: scan {s}: {row}\n" for s, (t, row) in enumerate(zip(T, pairs(" ", "{h}/{l}"), strict=True))),
    "side by side": "HIGH SIDE (U in V),,,,LOW SIDE (U in V),,,\nt [ms],S1,S2,S3,t [ms],S1,S2,S3\n" + "".join(f"{round(1000 * t)},{','.join(f(x, '') for x in H[s])},{round(1000 * t)},{','.join(f(x, '') for x in L[s])}\n" for s, t in enumerate(T)),
    "arrays below their names": "# shear test 3, fs = 20 Hz\n" + "\n\n".join(f"# {name} [V], rows: scans, columns: strips 0..2\n" + "".join(f"{' '.join(f(x) for x in row)}\n" for row in a) for name, a in (("v_h", H), ("v_l", L))),
    "names behind another word": "10:00:00.000 -> boot 3\n10:00:00.000 -> strip:\tS0H\tS0L\tS1H\tS1L\tS2H\tS2L\n" + "".join(f"10:00:01.{round(1000 * t):03d} -> data:\t" + "\t".join(f(x, "0.000") for i in N for x in (H[s, i], L[s, i])) + "\n" for s, t in enumerate(T)),
    "records under keys": json.dumps({"device": {"fw": "1.2"}, "log": {f"-Nr4kJ{'abcd'[s]}": {"time": t, "hi": [-1 if np.isnan(x) else float(x) for x in H[s]], "lo": [-1 if np.isnan(x) else float(x) for x in L[s]]} for s, t in enumerate(T)}}),
    "a module's inputs": "time,cDAQ1Mod1/strip0_hi,cDAQ1Mod1/strip0_lo,cDAQ1Mod2/strip1_hi,cDAQ1Mod2/strip1_lo,cDAQ1Mod2/strip2_hi,cDAQ1Mod2/strip2_lo\n" + "\n".join(wide()) + "\n",
    "another script": "\u65f6\u95f4(s)," + ",".join(f"\u901a\u9053{i}\u9ad8(V),\u901a\u9053{i}\u4f4e(V)" for i in N) + "\n" + "\n".join(wide()).translate({ord(c): ord(c) + 0xFEE0 for c in "0123456789."}) + "\n",
    "a message between": "\n".join([HEAD.strip(), *wide()[:2], "heap 19984", "E (301) i2c: timeout, retry 3", *wide()[2:]]) + "\n",
    "a word at both ends": HEAD + "\n".join(wide("OL")) + "\n",
    "rows of the ends": "".join(f"# scan {s} t={t}\n{' '.join(f(x, '0') for x in H[s])}\n{' '.join(f(x, '0') for x in L[s])}\n\n" for s, t in enumerate(T)),
    "melted, end by end": "t,strip,end,volts\n" + "".join(f"{t},{i},{e},{f(a[s, i])}\n" for e, a in (("H", H), ("L", L)) for s, t in enumerate(T) for i in N),
}  # fmt: skip


def read(text: str) -> Proposal:
    return propose(of_text(text), SKIN)


@pytest.mark.parametrize("form", FORMS)
def test_a_dialect_gives_its_readings_without_a_question(form: str) -> None:
    found = read(FORMS[form])
    values = np.stack([scan.values for scan in found.scans])
    np.testing.assert_array_equal(values, np.stack([H, L], axis=2))
    np.testing.assert_allclose([scan.time_s for scan in found.scans], T, atol=1e-6)


def test_a_last_message_that_lacks_what_others_in_it_have_is_left_out() -> None:
    strips = "".join(f"- {{index: {i}, v_high: {H[2, i]}, v_low: {L[2, i]}}}\n" for i in N)
    text = "".join(f"t: {t}\nstrips:\n{strips}---\n" for t in (*T, 0.2))
    assert len(read(text.removesuffix(f", v_low: {L[2, 2]}}}\n---\n") + "}\n").scans) == len(T)


def test_a_field_that_stays_says_the_unit() -> None:
    scans = [
        [{"id": i, "high": float(h) / 5.0, "low": float(h) / 9.0} for i, h in enumerate(H[2])] for _ in T
    ]
    rows = [{"t": t, "unit": "ratio_of_vref", "strips": of} for t, of in zip(T, scans, strict=True)]
    assert read("\n".join(map(json.dumps, rows))).mapping.unit == "fraction"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (FORMS["a word at both ends"].replace("OL", "sat"), "untouched=sat"),
        (FORMS["a word at both ends"].replace("OL", "2.2", 1), "untouched=OL"),  # of one end alone
        (HEAD + "\n".join(wide()).replace("1.262", "1262"), "1262"),
        (FORMS["topics"].replace("14:03:21.150", "14:03"), "of another form"),
        ("t=0 h: 2.5, q, 2.7 l: 1.2, q, 1.3\nt=1 h: 2.5, 2.6, 2.7 l: 1.2, 1.1, 1.3\n" * 2, "no names"),
    ],
)
def test_a_damaged_dialect_is_asked_or_refused(text: str, said: str) -> None:
    with pytest.raises((Unanswered, ts.ReadingError), match=re.escape(said)):
        read(text)


def test_a_line_between_even_scans_that_cannot_be_one_is_set_aside_with_a_warning() -> None:
    found = read("\n".join([HEAD.strip(), *wide()[:2], "h0 low 1.9", *wide()[2:]]))
    assert len(found.scans) == len(wide())
    assert "line 4 ('h0 low 1.9')" in found.doubts[0]
