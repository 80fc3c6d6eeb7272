"""What a log leaves open to doubt: refused or asked by name, warned of, or read as the spec states."""

from __future__ import annotations

import gzip
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import tacstrip as ts
from tacstrip.cli import cli
from tacstrip.io.log_import.containers import read_table
from tacstrip.io.log_import.guess import Proposal, propose
from tacstrip.io.log_import.questions import Unanswered
from tacstrip.io.log_import.scans import scans
from tacstrip.io.log_import.text import of_text

ONE = ts.Sensor(construction="crs-m", strips=4, pitch_mm=6.0, length_mm=80.0, vref_volt=3.3)
TWO = replace(ONE, construction="crs-crs", strips=6)
ALL = frozenset({"strip_base", "vref_volt"})
# Scans of six strips, of which 2, 3 and 4 are touched: v_h, v_l [V].
HIGH = np.zeros((6, 6))
HIGH[:, 2:5] = 1.5 + 0.05 * np.arange(6)[:, None] + 0.1 * np.arange(3)
LOW = 0.8 * HIGH
NOISE = 0.001 * (np.arange(72).reshape(2, 6, 6) * 7 % 4)


def named(form: str) -> str:
    return ",".join(form.format(i) for i in range(6))


def wide(head: str, *columns: np.ndarray, form: str = "{:.3f}", mark: str = ",") -> str:
    values = np.concatenate(columns, axis=1)
    lines = [mark.join([str(50 * i), *(form.format(v) for v in row)]) for i, row in enumerate(values)]
    return "\n".join([*([head] if head else []), *lines]) + "\n"


def touched_only(first: int, factor: float = 1.0) -> str:
    lines = [
        f"{0.05 * i:.2f},{s + first},{factor * HIGH[i, s]:.3f},{factor * LOW[i, s]:.3f}"
        for i in range(6)
        for s in (2, 3, 4)
    ]
    return "\n".join(["time_s,strip,v_h,v_l", *lines]) + "\n"


def array(found: Proposal) -> np.ndarray:
    return np.nan_to_num(np.stack([scan.values for scan in found.scans]))


@pytest.mark.parametrize("name", ["T{} [degF]", "s{}_kPa", "f{} [N]", "r{} (kOhm)", "i{} [mA]"])
def test_a_unit_that_is_none_of_readings_is_refused_by_its_name(name: str) -> None:
    head = "t_ms," + ",".join(map(name.format, range(4)))
    unit = name.replace("_", " ").split(" ")[-1].strip("[]()")
    with pytest.raises(ts.ReadingError, match=f"'{unit}' is no unit"):
        propose(of_text(wide(head, 1.0 + HIGH[:, :4])), ONE)


@pytest.mark.parametrize(("unit", "scale"), [("cV", 100.0), ("dV", 10.0), ("uV", 1e6)])
def test_unusual_volts_are_read(unit: str, scale: float) -> None:
    head = "t_ms," + ",".join(f"s{i}_{unit}" for i in range(4))
    found = propose(of_text(wide(head, scale * (0.5 + HIGH[:, 1:5]))), ONE)
    assert found.mapping.unit == unit
    np.testing.assert_allclose(array(found)[:, :, 0] / scale, 0.5 + HIGH[:, 1:5], rtol=1e-3)


def test_an_offset_at_rest_is_no_reading_outside_0_to_vref(tmp_path: Path) -> None:
    sensor = replace(ONE, rest_volt=0.0, touch_volt=0.05)
    sensor.save(tmp_path / "s.toml")
    rest = np.where(HIGH[:, :4] > 0.0, HIGH[:, :4], -0.03 * (np.arange(24).reshape(6, 4) % 2))
    rest[0] = -0.03
    (tmp_path / "a.csv").write_text(wide("t_ms,v0,v1,v2,v3", rest))
    words = [str(tmp_path / n) for n in ("a.csv", "s.toml")]
    done = CliRunner().invoke(cli, ["import", *words, "-o", str(tmp_path / "b.csv")])
    assert done.exit_code == 0, done.output
    assert "5 of 6 scans touched; readings (least, median, greatest): 1.55," in done.output
    read = ts.read_readings(tmp_path / "b.csv", sensor)
    np.testing.assert_allclose(
        np.nan_to_num([3.3 * s["k"][3] for s in read]), HIGH[:, 3] * (np.arange(6) > 0), atol=1e-9
    )


def test_readings_above_vref_ask_for_vref_by_name() -> None:
    with pytest.raises(Unanswered, match=r"above vref_volt = 3.3 .* vref_volt=4.096 or --answer vref_volt=5"):
        propose(of_text(touched_only(0, 2.0)), TWO, {}, ALL)
    found = propose(of_text(touched_only(0, 2.0)), TWO, {"vref_volt": "5", "strip_base": "0"}, ALL)
    assert found.mapping.vref_volt == 5.0
    assert any("Vref = 5 are written as such of vref_volt = 3.3" in doubt for doubt in found.doubts)
    with pytest.raises(ts.OptionError, match=r"unit=mV: no reading is above .* of 3300 mV.*unit=V"):
        propose(of_text(touched_only(0)), TWO, {"unit": "mV", "strip_base": "0"}, ALL)


def test_what_the_spec_does_not_state_is_asked_and_what_it_states_is_taken() -> None:
    with pytest.raises(Unanswered, match="does not state vref_volt"):
        propose(of_text(touched_only(0)), TWO, {}, frozenset({"strip_base"}))
    with pytest.raises(Unanswered, match="strip_base=0 or"):  # 0 is the default, and proves nothing
        propose(of_text(touched_only(0)), TWO, {}, ALL)
    found = propose(of_text(touched_only(1)), replace(TWO, strip_base=1), {}, ALL)
    np.testing.assert_allclose(array(found)[:, :, 0], HIGH, atol=1e-3)
    assert any("strip_base = 1, as the spec says" in reason for reason in found.reasons)
    assert not any("numbered" in doubt for doubt in found.doubts)
    last = propose(of_text(touched_only(1)), replace(TWO, strips=5), {}, ALL)
    assert any("strip_base = 0 in the spec" in doubt for doubt in last.doubts)
    said = propose(of_text("# strips are numbered 1 to 6\n" + touched_only(1)), TWO, {}, ALL)
    np.testing.assert_allclose(array(said)[:, :, 0], HIGH, atol=1e-3)
    assert not said.doubts
    with pytest.raises(Unanswered, match="strip_base="):  # strip 1 is the lowest: it may be the first
        propose(of_text(touched_only(-1)), TWO, {}, ALL)
    with pytest.raises(Unanswered, match=r"(?s)v_mid=h.*strip_base="):  # all that is open at once
        propose(of_text(touched_only(-1).replace("v_h,v_l", "v_mid,v_sigma")), TWO, {}, ALL)


def test_names_and_packing_of_many_hands(tmp_path: Path) -> None:
    noisy = (HIGH + NOISE[0] * (HIGH == 0.0), LOW + NOISE[1] * (LOW == 0.0))
    numbers = range(6)
    forms = {
        "oben": wide(f"t_ms,{named('U_oben{}')},{named('U_unten{}')}", *noisy),
        "order": wide("# h0..h5 then l0..l5, volts", *noisy, mark="\t"),
        "lines": "\n".join(
            f"{50 * i} {c}: " + " ".join(f"{v:.3f}" for v in rows[i])
            for i in numbers
            for c, rows in zip("HL", noisy, strict=True)
        ),
        "names": "% bench\n%  scan strip    v_h      v_l\n"
        + "".join(f"{i:6d}{s:6d}{HIGH[i, s]:9.5f}{LOW[i, s]:9.5f}\n" for i in numbers for s in numbers),
    }  # fmt: skip
    for name, text in forms.items():
        found = array(propose(of_text(text), TWO, {"rate_hz": "20"} if name == "names" else {}, ALL))
        np.testing.assert_allclose(np.where(found < 0.1, 0.0, found)[:, :, 0], HIGH, atol=1e-3, err_msg=name)
        np.testing.assert_allclose(np.where(found < 0.1, 0.0, found)[:, :, 1], LOW, atol=1e-3, err_msg=name)
    labview = wide("X_Value,Voltage,Voltage_1,Voltage_2,Voltage_3", HIGH[:, 1:5] + 0.5)
    np.testing.assert_allclose(
        array(propose(of_text(labview), ONE, {"time_unit": "ms"}, ALL))[:, :, 0], HIGH[:, 1:5] + 0.5
    )
    packed = tmp_path / "a.csv.gz"
    packed.write_bytes(gzip.compress(labview.encode()))
    assert read_table(packed).names[1] == "Voltage"
    packed.write_bytes(gzip.compress(labview.encode())[:-20])
    with pytest.raises(ts.ReadingError, match="damaged"):
        read_table(packed)


def test_two_sheets_of_the_channels_are_one_table(tmp_path: Path) -> None:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    for title, values in (("V_h", HIGH), ("V_l", LOW)):
        sheet = book.active if title == "V_h" else book.create_sheet()
        sheet.title = title
        sheet.append(["t [s]", *(f"Strip {i}" for i in range(6))])
        for i, row in enumerate(values):
            sheet.append([0.05 * i, *map(float, row)])
    book.save(tmp_path / "a.xlsx")
    found = array(propose(read_table(tmp_path / "a.xlsx"), TWO, {}, ALL))
    np.testing.assert_allclose(found, np.stack([HIGH, LOW], axis=2))


def test_what_is_left_out_is_a_doubt_and_a_third_is_never_offered() -> None:
    text = wide("t_ms,v0,v1,v2,v3", HIGH[:, 1:5] + 0.5).splitlines()
    cut = "\n".join([*text[:4], text[4][:12], *text[5:]])
    found = propose(of_text(cut), ONE, {}, ALL)  # and with a mapping: `left_out`
    assert any("left out: line 5" in doubt for doubt in found.doubts)
    rows = [f"{25 * i},{0.5 + 0.01 * i},0.6,0.7,0.8" if i % 3 else f"{25 * i},0.5" for i in range(18)]
    with pytest.raises(ts.ReadingError, match="6 beside 12 that are"):
        propose(of_text("\n".join([text[0], *rows[1:], "450,0.5"])), ONE, {"broken_lines": "skip"}, ALL)


def test_log_lines_of_another_tag_are_messages() -> None:
    colour, plain = "\x1b[0;32m", "\x1b[0m"
    rows = [
        f"{colour}I ({1000 + 50 * i}) TACT: strip={s} v_h={HIGH[i, s]:.3f} v_l={LOW[i, s]:.3f}{plain}"
        for i in range(6)
        for s in range(6)
    ]
    rows.insert(
        9, f"{colour}W (1063) wifi: <ba-add>idx:0 (ifx:0, 3c:84:6a:11:22:33), tid:0, winSize:64{plain}"
    )
    found = propose(of_text("\n".join(rows)), TWO, {}, ALL)
    np.testing.assert_allclose(array(found)[:, :, 0], HIGH, atol=1e-3)
    assert not any("\x1b" in said for said in (*found.reasons, *found.doubts))


def test_names_that_do_not_fit_their_columns_are_said() -> None:
    head = "ms," + ",".join(f"{c}{i}" for i in range(6) for c in "hl" if (i, c) != (3, "l"))
    both = np.stack([HIGH, LOW], axis=2).reshape(6, 12)
    found = propose(of_text(wide(head, both)), TWO, {}, ALL)
    assert any("12 names, and the lines below it 13 fields" in doubt for doubt in found.doubts)
    commas = touched_only(0).replace(".", ",")
    with pytest.raises(ts.ReadingError, match="decimal commas, and commas between fields"):
        propose(of_text(commas), TWO, {}, ALL)
    again = "time_s,strip,v_h [V],v_l [V]\n" + touched_only(0).partition("\n")[2]
    again += again.replace("[V]", "[mV]")
    with pytest.raises(
        ts.ReadingError, match=r"line 20 names .* v_h \[mV\], .* and the first names are .* v_h \[V\]"
    ):
        propose(of_text(again), TWO, {}, ALL)
    reversed_ = wide("# columns: strip 5 first ... strip 0 last (h l each)", both)
    found = propose(of_text(reversed_), TWO, {"time_unit": "ms"}, ALL)
    np.testing.assert_allclose(array(found)[:, ::-1, 0], HIGH, atol=1e-3)
    vague = wide("# columns of strips in reversed order", both)
    with pytest.raises(Unanswered, match="strip_order=ascending or --answer strip_order=descending"):
        propose(of_text(vague), TWO, {"time_unit": "ms"}, ALL)


@pytest.mark.parametrize("odd", [".260", "1.26", " .260"])
def test_a_number_that_has_lost_a_digit_is_doubted(odd: str) -> None:
    rows = [[f"{n / 50:.2f}", *(f"{1.2 + s / 10 + n / 100:.3f}" for s in range(4))] for n in range(12)]
    whole = "\n".join(["t [s],s0,s1,s2,s3", *map(",".join, rows)])
    assert not propose(of_text(whole), ONE, {}).doubts
    rows[6][1] = odd
    (doubt,) = propose(of_text("\n".join(["t [s],s0,s1,s2,s3", *map(",".join, rows)])), ONE, {}).doubts
    assert doubt.startswith(f"line 8, s0: {odd.strip()} is not written as the other numbers")


@pytest.mark.parametrize(("column", "odd"), [(1, "\u0663"), (2, "\u0966.\u096b")])
def test_a_number_in_other_digits_than_its_column_is_refused(column: int, odd: str) -> None:
    rows = [[f"{n / 50:.2f}", *(repr(1.25 + s / 8 + n / 128) for s in range(4))] for n in range(12)]
    mapping = propose(of_text("\n".join(["t [s],s0,s1,s2,s3", *map(",".join, rows)])), ONE, {}).mapping
    rows[6][column] = odd
    table = of_text("\n".join(["t [s],s0,s1,s2,s3", *map(",".join, rows)]))
    with pytest.raises(
        ts.ReadingError, match=f"line 8, .*: '{odd}' is in other digits than the other numbers"
    ):
        propose(table, ONE, {})
    with pytest.raises(ts.ReadingError, match="is in other digits"):
        scans(table, mapping)
    rows[6][column], rows[6][0] = rows[5][column], "0x3C"
    table = of_text("\n".join(["t [s],s0,s1,s2,s3", *map(",".join, rows)]))
    with pytest.raises(Unanswered, match=r"line\(s\) 8 .* are not like the others"):
        propose(table, ONE, {})


def test_numbers_that_are_shortened_are_not_doubted() -> None:
    rows = [
        [f"{n / 50:.2f}", *(repr(round(1.21 + s / 10 + n / 1000, 3)) for s in range(4))] for n in range(9)
    ]
    assert not propose(of_text("\n".join(["t [s],s0,s1,s2,s3", *map(",".join, rows)])), ONE, {}).doubts


@pytest.mark.parametrize("form", ["significant digits", "no leading 0"])
def test_numbers_to_significant_digits_or_without_a_leading_0_are_not_damaged(form: str) -> None:
    values = [0.9120, 0.9871, 0.9900, 1.004, 0.9540, 0.9230, 0.9410, 0.9660, 0.9780, 0.9120]
    texts = [f"{v:#.4g}" if form == "significant digits" else f"{v + 0.03:.3f}".lstrip("0") for v in values]
    if form != "significant digits":
        texts[1:] = [f"{v + 0.5:.3f}" for v in values[1:]]
    lines = ["time_s,strip,v_out", *(f"{0.1 * i:.1f},{i % 2},{t}" for i, t in enumerate(texts))]
    found = propose(of_text("\n".join(lines) + "\n"), replace(ONE, strips=2), {})
    assert not [d for d in found.doubts if "digit" in d]


def test_a_column_like_a_strips_beside_all_of_them_is_doubted() -> None:
    rng = np.random.default_rng(0)
    rows = [f"{0.02 * i:.2f}," + ",".join(f"{x:.3f}" for x in 1.2 + rng.random(3)) for i in range(12)]
    found = propose(of_text("\n".join(["time_s,v,v1,v2", *rows]) + "\n"), replace(ONE, strips=2), {})
    assert any("one too few" in d for d in found.doubts)


SHORT = [f"{i // 3 / 10},{i % 3},{2 + i / 100:.2f},{1 + i / 100:.2f}" for i in range(24)]


@pytest.mark.parametrize(
    ("comment", "doubts"), [("x10 probe", 1), ("gain: 1.0", 0), ("6 strips, bench 2", 0)]
)
def test_a_probe_that_attenuates_is_quoted(comment: str, doubts: int) -> None:
    text = "\n".join([f"# {comment}", "time_s,strip,v_h,v_l", *SHORT])
    assert [comment in doubt for doubt in propose(of_text(text), TWO).doubts] == [True] * doubts


def test_two_clocks_that_contradict_are_named() -> None:
    rows = [f"2024-01-01T12:00:0{i // 3}.000,{i // 3 * 1000},{i % 3},2.5{i % 3},1.5" for i in range(24)]
    for unit, contradict in (("s", True), ("ms", False)):
        found = propose(of_text("\n".join([f"date,time_{unit},strip,v_h,v_l", *rows])), TWO)
        assert any("'date' rises by 7 s" in d and f"'time_{unit}'" in d for d in found.doubts) == contradict


def test_strip_numbers_in_exponent_form() -> None:
    rows = [f"{i // 3 / 10:.18e} {i % 3:.18e} {2 + i / 100:.18e} {1 + i / 100:.18e}" for i in range(24)]
    found = propose(of_text("\n".join(["# time_s strip v_h v_l", *rows])), TWO).scans
    assert len(found) == 8
    assert found[7].values[2, 0] == pytest.approx(2.23)
