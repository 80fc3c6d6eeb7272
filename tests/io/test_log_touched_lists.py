"""Logs that list what is touched, in groups, blocks, rows or records, written without a look at the readers."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.io.log_import.guess import Proposal, propose
from tacstrip.io.log_import.text import of_text

PAD = ts.Sensor(construction="crs-crs", strips=7, pitch_mm=6.0, length_mm=100.0, vref_volt=5.0)
SCANS, STRIPS = range(14), range(7)
STATED = frozenset({"vref_volt"})


def _volts() -> np.ndarray:
    """Return readings (scans, strips, 2) [V] of a contact that comes, moves over the strips and goes."""
    n, s = np.ogrid[:14, :7]
    there = (abs(s - 1.5 - 0.25 * n) < 1.6) & (n > 1) & (n < 13)
    low = np.where(there, 1.2 + 0.06 * n + 0.05 * s, np.nan)
    return np.stack([low + 0.7 + 0.03 * s, low], axis=2)


V = _volts()


def _text(n: int, s: int) -> tuple[str, str]:
    return f"{V[n, s, 0]:.3f}", f"{V[n, s, 1]:.3f}"


def _touched(n: int) -> list[int]:
    return [s for s in STRIPS if np.isfinite(V[n, s, 0])]


def _tuples(n: int) -> str:
    return f"({20 * n + 500}, [{', '.join(f'({s}, {_text(n, s)[0]}, {_text(n, s)[1]})' for s in _touched(n))}])\n"


def _sentence(n: int) -> str:
    said = "; ".join("strip {} upper {} lower {}".format(s, *_text(n, s)) for s in _touched(n))
    return f"{0.02 * n:.2f} s  " + (f"touched {len(_touched(n))}:  {said}" if said else "nothing") + "\n"


def _block(n: int) -> str:
    rows = "".join("   {}   VH = {}   VL = {}\n".format(s, *_text(n, s)) for s in _touched(n))
    return f"SCAN {n:4}  T = {0.02 * n:.3f} s   CONTACTS  {len(_touched(n))}\n{rows}\n"


def _rows(n: int) -> str:
    rows = [f"{n},{0.02 * n:.2f},{s},{','.join(_text(n, s))}\n" for s in _touched(n)]
    return "".join(rows or [f"{n},{0.02 * n:.2f},none,,\n"])


def _influx(n: int) -> str:
    stamp = 1778580843120000000 + 20000000 * n
    rows = "".join("pad,strip={} vh={},vl={} {}\n".format(s, *_text(n, s), stamp) for s in _touched(n))
    return f"board temp=41.{n},vbat=3.9 {stamp}\n{rows}"


def _xml(n: int) -> str:
    rows = "".join('    <strip n="{}" hi="{}" lo="{}"/>\n'.format(s, *_text(n, s)) for s in _touched(n))
    return f'  <scan t="{0.02 * n:.2f}">\n{rows}  </scan>\n'


def _at(n: int) -> str:
    return "".join(
        "Strip #{}: high={} V low={} V @ {} ms\n".format(s, *_text(n, s), 20 * n) for s in _touched(n)
    )


def _nested(n: int) -> dict[str, object]:
    rows = [
        {"strip": s, "vHigh": None if np.isnan(V[n, s, 0]) else float(_text(n, s)[0]),
         "vLow": None if np.isnan(V[n, s, 1]) else float(_text(n, s)[1])}
        for s in STRIPS
    ]  # fmt: skip
    return {
        "_id": {"$oid": f"{n:024x}"},
        "at": {"$date": f"2026-05-12T10:14:03.{20 * n:03d}Z"},
        "readings": rows,
    }


def _all(head: str, line: object, tail: str = "") -> str:
    return head + "".join(line(n) for n in SCANS) + tail  # type: ignore[operator]


FORMS = {
    "tuples in lines": _all("strips are numbered 0 to 6\n", _tuples),
    "sentences": _all("strips are numbered from 0\n", _sentence),
    "blocks": _all("PAD REPORT\nSTRIPS 7 (0-6)\n\n", _block, "END OF DATA\n"),
    "none for a strip": _all("# strips are numbered from 0\nscan,time_s,strip,v_h,v_l\n", _rows),
    "a board's lines between": _all("# strips are numbered from 0\n", _influx),
    "XML": _all("<log>\n<!-- strips are numbered from 0 -->\n", _xml, "</log>\n"),
    "at a time": _all("Pad has 7 strips (0 to 6)\n", _at),
    "records of a database": json.dumps([_nested(n) for n in SCANS]),
}


def _read(text: str, **answers: str) -> Proposal:
    return propose(of_text(text), PAD, answers, STATED)


@pytest.mark.parametrize("form", FORMS)
def test_what_is_touched_is_read_without_a_question(form: str) -> None:
    found = _read(FORMS[form])
    read = np.stack([scan.values for scan in found.scans])
    touched = np.isfinite(V).any(axis=(1, 2))
    np.testing.assert_allclose(read[np.isfinite(read).any(axis=(1, 2))], V[touched], atol=6e-4)
    times = [scan.time_s for scan in found.scans if np.isfinite(scan.values).any()]
    np.testing.assert_allclose(np.diff(times), 0.02, atol=1e-6)


def test_a_line_of_groups_that_is_cut_is_no_scan_without_a_contact() -> None:
    lines = FORMS["sentences"].splitlines()
    cut = [line if n != 7 else line[:8] for n, line in enumerate(lines)]
    found = _read("\n".join(cut) + "\n")
    whole = _read(FORMS["sentences"])
    assert [s.line for s in found.scans] == [s.line for s in whole.scans if s.line != 8]
    assert any("left out: line 8" in doubt for doubt in found.doubts)


@pytest.mark.parametrize("alone", [True, False])
def test_an_end_just_below_0_is_a_reading_and_both_ends_are_no_contact(alone: bool) -> None:
    h, low = (np.where(np.isfinite(v), np.nan_to_num(v) * 200, 0.0).round() for v in np.moveaxis(V, 2, 0))
    pad = replace(PAD, adc_bits=10, rest_volt=0.0, touch_volt=0.05)
    if alone:  # one end alone
        low[6, np.flatnonzero(h[6])[0]] = -1
    else:
        h, low = np.where(h > 0, h, -1), np.where(h > 0, low, -1)
    names = ",".join(f"h{s},l{s}" for s in STRIPS)
    rows = [",".join(f"{a:.0f},{b:.0f}" for a, b in zip(h[n], low[n], strict=True)) for n in SCANS]
    text = f"t_ms,{names}\n" + "".join(f"{20 * n},{row}\n" for n, row in enumerate(rows))
    found = propose(of_text(text), pad, {"unit": "code"}, STATED)
    assert ("-1" in found.mapping.untouched) == (not alone)


def test_decimal_commas_in_quotes_under_a_name_in_volts_are_no_thousands() -> None:
    lines = [
        f'"{0.02 * n:.2f}","{s}",'
        + ",".join('"' + t.replace("nan", "").replace(".", ",") + '"' for t in _text(n, s))
        for n in SCANS
        for s in STRIPS
    ]
    text = (
        '"Temps (s)","Bande","Haut (V)","Bas (V)"\n'
        + "\n".join(x.replace('"0.', '"0,') for x in lines)
        + "\n"
    )
    read = np.stack([scan.values for scan in _read(text).scans])
    np.testing.assert_allclose(read, V, atol=6e-4)
