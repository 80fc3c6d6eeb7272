"""The hold-out unit against closed forms, its device against the protocol page, and that its sets run."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from studies.holdout import calibration_set, device_and_unit, device_set, doctor_set, logs, units
from studies.holdout.readings import Unit
from studies.holdout.units import Bridge, Build

L = 100.0


def sound(construction: str, contact_lambda: float, strips: int = 6, rungs: int = 60) -> Build:
    unit = units.build(
        construction,
        strips,
        5.0,
        L,
        np.random.default_rng(0),
        ohm=1e4,
        ratio=1.3,
        contact_lambda=contact_lambda,
        each=0.0,
        clamp=0.0,
    )
    assert isinstance(unit, Build)
    return replace(unit, switch=1e-3, supply=1e-6, rungs=rungs)


@pytest.mark.parametrize("construction", ["crs-crs", "crs-m"])
@pytest.mark.parametrize("contact_lambda", [0.0, 2.0, 10.0])
def test_a_touched_strip_reads_the_closed_form(construction: str, contact_lambda: float) -> None:
    random, unit = np.random.default_rng(1), sound(construction, contact_lambda)
    low = random.uniform(0.0, 80.0, (40, 6))
    high = low + random.uniform(1.0, 20.0, low.shape)
    ratio = 1.3 if construction == "crs-crs" else 1.0
    ideal = Unit(unit.names, 6, 5.0, L, contact_lambda, ratio).read(low, high)
    np.testing.assert_allclose(unit.read(low, high), ideal, atol=6e-5)
    coarse = np.abs(sound(construction, contact_lambda, rungs=15).read(low, high) - ideal).max()
    assert contact_lambda == 0.0 or coarse > 8.0 * np.abs(unit.read(low, high) - ideal).max()  # order 2


def test_untouched_strips_read_nothing_and_a_gap_reads_as_the_hull_where_contact_is_ideal() -> None:
    unit = sound("crs-crs", 0.0)
    low, high = np.full((1, 6), np.nan), np.full((1, 6), np.nan)
    low[0, :3], high[0, :3] = 20.0, 70.0
    read = unit.read(low, high)
    assert np.isnan(read[:, 0, 3:]).all()
    hole = np.full((1, 6), 35.0), np.full((1, 6), 50.0)
    np.testing.assert_allclose(unit.read(low, high, hole), read, atol=1e-5)


def test_rubber_that_is_uneven_reads_at_its_electrical_places() -> None:
    unit = sound("crs-m", 0.0)
    below = units.rubber(6, 1e4, np.random.default_rng(2), 0.05, 0.2)
    low = np.full((1, 6), 30.0)
    read = replace(unit, below0=below).read(low, low + 25.0)[0, 0]
    at = np.linspace(0.0, L, below.shape[1])
    lower, upper = (np.array([np.interp(y, at, b) for b in below]) / below[:, -1] for y in (30.0, 55.0))
    np.testing.assert_allclose(read, lower / (1.0 - upper + lower), atol=1e-5)


def test_clamps_at_one_end_put_both_channels_on_a_rail_and_a_bridge_is_a_second_path() -> None:
    unit = sound("crs-crs", 1.0)
    low = np.full((1, 6), 30.0)
    for end, rail in ((0, 1.0), (1, 0.0)):
        read = units.unclamped(unit, 2, end).read(low, low + 20.0)
        np.testing.assert_allclose(read[:, 0, 2], rail, atol=1e-4)
        np.testing.assert_allclose(
            np.delete(read, 2, axis=2), np.delete(unit.read(low, low + 20.0), 2, axis=2), atol=1e-9
        )
    cut = units.broken(sound("crs-m", 0.0), 2, 60.0)
    read = cut.read(
        np.array([[30.0] * 6, [70.0] * 6, [55.0] * 6]), np.array([[50.0] * 6, [90.0] * 6, [65.0] * 6])
    )[0]
    np.testing.assert_allclose(read[:, 2], [0.0, 1.0, 0.55 / 0.9], atol=1e-4)
    assert not cut.open_lines(low, low + 20.0).any()
    metal = replace(sound("crs-m", 0.0), bridges=(Bridge(2, 0, 80.0, 500.0),))
    low[0, 3] = 40.0
    high = np.array([[50.0, 50.0, 50.0, 60.0, 50.0, 50.0]])
    second = 500.0 / 1e4 * L + 80.0 - 60.0  # from the bridge along the next strip to the metal [mm of strip]
    loop = 1.0 / (1.0 / 30.0 + 1.0 / second)
    assert metal.read(low, high)[0, 0, 2] == pytest.approx(30.0 / (30.0 + loop + 20.0), abs=1e-4)


def test_a_free_line_follows_the_pull_and_a_touched_one_holds_it() -> None:
    unit = units.unclamped(sound("crs-crs", 1.0), 1, 1, layer=1)
    low = np.full((1, 6), 30.0)
    low[0, 4] = np.nan
    free = unit.open_lines(low, low + 20.0)
    assert free[0].tolist() == [
        False,
        False,
        False,
        False,
        True,
        False,
    ]  # k_l of strip 1 holds, its k_h does not
    assert unit.read(low, low + 20.0)[0, 0, 1] == pytest.approx(0.0, abs=1e-2)


def test_a_sheet_over_strips_is_symmetric_and_between_its_contacts_ends() -> None:
    sheet = units.build("crs-crp", 5, 5.0, L, np.random.default_rng(0), each=0.0, contact_lambda=1.0)
    low, high = np.full((1, 5), np.nan), np.full((1, 5), np.nan)
    low[0, 1:4], high[0, 1:4] = 40.0, 60.0
    read = sheet.read(low, high)
    np.testing.assert_allclose(
        (read[0] + read[1])[0, 1:4], 1.0, atol=1e-9
    )  # in the middle: upside down is the same
    np.testing.assert_allclose(read[:, 0, 1], read[:, 0, 3], atol=1e-9)
    assert (np.diff(read[::-1, 0, 1:4], axis=0) > 0.0).all()


def test_frames_are_those_of_the_protocol_page() -> None:
    page = Path("docs/reference/protocol-vectors.md").read_text()
    vector = re.search(r'"what": "scan", "hex": "(00 05 [^"]*)"', page)
    assert vector is not None
    body = bytes.fromhex("0300 03 0a 90010000 05 0002 0000 ff03 0001 0000 2d00".replace(" ", ""))
    frame = device_set.framed(1, 258, 1_000_000, body)
    assert frame.hex(" ") == vector[1]
    assert device_set.crc16(b"123456789") == 0x29B1
    data = np.random.default_rng(0).bytes(1500).replace(b"\0", b"\1") + b"\0\0" + bytes(range(256)) * 2
    for cut in (1, 253, 254, 255, 508, 1500, len(data)):
        assert 0 not in device_set.stuffed(data[:cut])
        assert device_set.unstuffed(device_set.stuffed(data[:cut])) == data[:cut]


def test_faults_and_uses_make_recordings(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor_set, "_SCANS", 90)
    for kind in ("open sensing strip", "intermittent 10-50 %", "pressure", "short, metal"):
        one, touch, codes, mine = doctor_set.faulty(np.random.default_rng(5), kind)
        assert codes.shape == (len(one.unit.names), len(touch.time_s), one.unit.strips)
        assert all(0 <= i < one.unit.strips for i in mine)
    assert len({doctor_set.healthy(np.random.default_rng(1), i)[3] for i in (6, 9)}) == 2


def test_verdicts_count_strips_and_causes() -> None:
    def said(strips: list[int], fault: str, **more: object) -> str:
        entry = {"fault": fault, "strips": strips, "severity": "fault", **more}
        report = json.dumps({"findings": [entry], "notes": []})
        return str(doctor_set.verdict("short, sensing", (3, 4), False, 1, report, "")["verdict"])

    assert said([3, 4], "short") == "named"
    assert said([3, 5], "short") == said([3, 4], "stuck") == said([], "short") == "missed"
    assert said([4], "open-strip", severity="question", causes=["open-strip", "short"]) == "asked"
    assert said([4], "open", severity="question", causes=["open", "short", "dead"]) == "missed"
    assert (
        doctor_set.verdict("slide", (), True, 0, '{"findings": [], "notes": [{"fault": "calibration"}]}', "")[
            "verdict"
        ]
        == "ok"
    )


def test_wrong_runs_are_refused_and_a_device_is_recorded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(device_set, "_SECONDS", 0.4)
    assert calibration_set.score_wrong(0, len(calibration_set.WRONG) + calibration_set.FILES.index("empty"))[
        "refused"
    ]
    row = device_set.score(0, 0)
    assert row["kind"] == "sound"
    assert row["sent"] > 3
    assert device_set.right(row), row["said"]


def test_final_seeds_are_locked(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        device_and_unit.main(["--seed", "1000"])
    assert "--final" in capsys.readouterr().err


def test_logs_have_the_columns_of_the_page(tmp_path: Path) -> None:
    random = np.random.default_rng(4)
    one = logs.bench(random, "crs-crs", 8, plain=True)
    touch = logs.touching("one press", one.unit, 12, 10.0, random)
    logs.write(tmp_path / "log.csv", one, logs.lines(one, touch, random), touch.time_s)
    lines = (tmp_path / "log.csv").read_text().splitlines()
    assert lines[0] == ("scan,time_s,strip,code_h,code_l" if one.codes else "scan,time_s,strip,v_h,v_l")
    assert len(lines) == 1 + 12 * 8
