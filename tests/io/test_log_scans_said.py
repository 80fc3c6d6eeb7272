"""Lines that number or delimit scans, records of touched strips only, and what stands before or between values."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.io.log_import.guess import Proposal, propose
from tacstrip.io.log_import.questions import Unanswered
from tacstrip.io.log_import.text import of_text

TWO = ts.Sensor(construction="crs-crs", strips=9, pitch_mm=6.0, length_mm=80.0, vref_volt=5.0)
STATED = frozenset({"strip_base", "vref_volt"})
TOUCHED = ((3, 4, 5), (3, 4, 5, 6), (4, 5, 6), (4, 5, 6, 7), (5, 6, 7))
HIGH = np.full((5, 9), np.nan)
for n, strips in enumerate(TOUCHED):
    HIGH[n, list(strips)] = 2.5 + 0.05 * n + 0.01 * np.arange(len(strips))
LOW = HIGH - 0.6


def each(form: str, between: str = "\n") -> list[str]:
    """Return each scan's strips in a form of s, h, l, n, t [s]."""
    return [
        between.join(form.format(s=s, h=HIGH[n, s], l=LOW[n, s], n=n, t=n / 10) for s in strips)
        for n, strips in enumerate(TOUCHED)
    ]


def read(text: str, **answers: str) -> Proposal:
    return propose(of_text(text), TWO, {"strip_base": "0"} | answers, STATED)


def check(found: Proposal, scans: slice | list[int] = slice(None), rows: bool = True) -> None:
    values = np.stack([s.values for s in found.scans])
    np.testing.assert_allclose(values, np.stack([HIGH, LOW], axis=2)[scans], atol=1e-3)
    if rows and scans == slice(None):
        np.testing.assert_allclose([s.time_s for s in found.scans], 0.1 * np.arange(5), atol=1e-9)


def test_records_name_only_touched_strips() -> None:
    lines = [f"t={n / 10} {scan}" for n, scan in enumerate(each("s{s}.h={h:.3f}V s{s}.l={l:.3f}V", " "))]
    check(read("\n".join(lines)))
    records = [
        f'{{"t": {n / 10}, {r}}}' for n, r in enumerate(each('"h{s}": {h:.3f}, "l{s}": {l:.3f}', ", "))
    ]
    check(read("\n".join(records), unit="V"))
    lost = "\n".join(lines).replace("s5.h=2.580V s5.l=1.980V ", "")  # within a scan: it may be lost
    if lost == "\n".join(lines):
        lost = "\n".join(lines).replace(f"s5.h={HIGH[1, 5]:.3f}V s5.l={LOW[1, 5]:.3f}V ", "")
    with pytest.raises(Unanswered, match="missing=untouched"):
        read(lost)


def test_a_scan_below_its_number_is_left_out_whole_and_by_name() -> None:
    scans = [f"--- scan {n} ---\n{rows}" for n, rows in enumerate(each("S{s}: {h:.3f} {l:.3f} V"))]
    text = "\n".join(["logger ready", *scans])
    check(read(text, rate_hz="10"))
    broken = text.replace(f"S5: {HIGH[2, 5]:.3f}", "S5: 2.?3")
    found = read(broken, rate_hz="10", broken_lines="skip", missing="untouched")
    check(found, [0, 1, 3, 4])
    said = " ".join(doubt for doubt in found.doubts if "left out" in doubt)
    assert "line 13 (" in said
    assert "from line(s) 12" in said


def test_topics_and_dumps_number_strips() -> None:
    topics = each('{t:.3f} lab/skin/strip/{s} {{"vh":{h:.3f},"vl":{l:.3f},"unit":"V"}}')
    check(read("\n".join(topics)))
    head = 'CREATE TABLE "r" (id INTEGER PRIMARY KEY, t_s DECIMAL(6,3), strip INT, h_V REAL, l_V REAL, UNIQUE (id));\n'
    count = itertools.count()
    rows = "\n".join(each('INSERT INTO "r" VALUES(@,{t},{s},{h:.3f},{l:.3f});')).split("@")
    check(read(head + "".join(f"{part}{next(count)}" for part in rows[:-1]) + rows[-1] + "\nCOMMIT;\n"))
    copied = "COPY public.r (t_s, strip, h_v, l_v) FROM stdin;\n" + "\n".join(
        each("{t}\t{s}\t{h:.3f}\t{l:.3f}")
    )
    check(read(copied + "\n\\.\n"))


def test_lines_of_a_channel_each_are_of_touched_strips() -> None:
    check(read("\n".join(["t_s,channel,V", *each("{t},CH{s}_H,{h:.3f}\n{t},CH{s}_L,{l:.3f}")])))


def test_nanoseconds_since_1970_keep_their_digits() -> None:
    found = read("\n".join(["t_ns,strip,h[V],l[V]", *each("17726123450{n}0000000,{s},{h:.3f},{l:.3f}")]))
    np.testing.assert_allclose([s.time_s for s in found.scans], [0.0, 0.01, 0.02, 0.03, 0.04], atol=1e-12)
