"""Runs files and the verb: every fault named, plans filled in and read back, one unit's runs refused for another."""

from __future__ import annotations

import re
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import tacstrip as ts
from strategies import texts
from tacstrip.cli import cli
from tacstrip.io.runs import read_runs, write_plan
from tacstrip.sensor import Channel
from tacstrip.sensor.raw import invert_calibration

CRS = ts.Sensor(
    construction="crs-crs", strips=2, pitch_mm=6.5, length_mm=325.0, vref_volt=6.05, adc_bits=12, strip_base=1
)
METAL = ts.Sensor(construction="crs-m", strips=2, pitch_mm=4.5, length_mm=250.0)
HEAD = "strip,l_mm,w_mm,v_h,v_l\n"
ROWS = "1,10,0,1,1\n2,10,0,1,1\n"
OFFSETS = ts.Calibration(
    channels=tuple(Channel(signature=s, offset=(0.05, 0.01), drift=(0.0, 0.0)) for s in ("kh", "kl"))
)


def read(folder: Path, text: str, sensor: ts.Sensor = CRS, unit: str = "", force: bool = False) -> ts.Runs:
    file = folder / "runs.csv"
    file.write_text(text, encoding="utf-8")
    return read_runs(file, sensor, unit, force)


def test_every_form(tmp_path: Path) -> None:
    runs = read(
        tmp_path, HEAD + "2,10,0,0.605,1.21\n1,20,50,6.05,0\n1,20,50,3.025,0\n,,,,\n1,,,0.0605,0\n1,30,0,,\n"
    )
    np.testing.assert_array_equal(runs.l_mm, [[20.0, 10.0], [20.0, np.nan]])
    np.testing.assert_array_equal(runs.w_mm, [[50.0, 0.0], [50.0, np.nan]])
    np.testing.assert_allclose(runs.raw["kh"], [[1.0, 0.1], [0.5, np.nan]])
    np.testing.assert_array_equal(runs.line, [[3, 2], [4, 0]])
    np.testing.assert_allclose(runs.rest["kh"], [[0.01, np.nan]])
    assert (runs.count, runs.open, runs.source, runs.signatures) == (3, 1, "runs.csv", ("kh", "kl"))
    codes = read(tmp_path, "code_h,note,strip,l_mm,w_mm\n4095,a,1,1,0\n0,b,2,1,0\n")
    np.testing.assert_allclose(codes.raw["kh"], [[1.0, 0.0]])
    assert codes.signatures == ("kh",)


FAULTS = {
    "empty": ("", "the file is empty; runs need a header line"),
    "no l": ("strip,w_mm,v_h,v_l\n", "column 'l_mm' is missing; the header has: strip, w_mm, v_h, v_l"),
    "no readings column": ("strip,l_mm,w_mm\n", "a column of readings is missing: v_h, v_l"),
    "metal's": ("strip,l_mm,w_mm,v_out\n", "column 'v_out' does not belong to a crs-crs sensor"),
    "header only": (HEAD, "there are no readings: it has a header and nothing else"),
    "a plan": (HEAD + "1,10,0,,\n2,10,0,,\n", "there are no readings: all 2 rows have empty readings"),
    "one of two": (HEAD + "1,10,0,1,\n", "line 2: v_h is there but no v_l; give both or neither"),
    "the other of two": (HEAD + "1,10,0,,1\n", "line 2: v_l is there but no v_h; give both or neither"),
    "strip": (HEAD + "0,10,0,1,1\n", "line 2: strip 0 is out of range 1 to 2; check strips and strip_base"),
    "no strip": (HEAD + ",10,0,1,1\n", "line 2: strip is '', not a whole number"),
    "no w": (HEAD + "1,10,,1,1\n", "line 2: w_mm is empty; a point contact has w_mm = 0"),
    "no l there": (HEAD + "1,,5,1,1\n", "line 2: l_mm is empty"),
    "off the strip": (HEAD + "1,300,50,1,1\n", "line 2: a contact from l_mm = 300 over w_mm = 50 is not on a strip"),
    "below": (HEAD + "1,-1,5,1,1\n", "is not on a strip of 325 mm"),
    "w below 0": (HEAD + "1,10,-5,1,1\n", "is not on a strip of 325 mm"),
    "infinite l": (HEAD + "1,inf,0,1,1\n", "line 2: l_mm is 'inf', not a finite number"),
    "millivolts": (HEAD + "1,10,0,3025,1\n", "line 2: v_h = 3025 V is outside 0 to 6.05 V; is it in millivolts"),
    "one strip only": (HEAD + "1,10,0,1,1\n", "no contact on strip 2 has readings"),
    "cut off": (HEAD + ROWS + "1,10,0", "line 4 has 3 fields and the header 5: is the file cut off"),
    "semicolons": ("strip;l_mm;w_mm;v_h\n", "columns are separated by ';'"),
    "another sensor": (
        HEAD.replace("\n", ",sensor\n") + '1,10,0,1,1,"crs-m, 9 strips"\n',
        "line 2: the runs are of sensor 'crs-m, 9 strips' and this sensor is 'crs-crs, 2 strips",
    ),
}  # fmt: skip


def test_uncertain_places(tmp_path: Path) -> None:
    head = "strip,l_mm,w_mm,v_h,v_l,l_sd_mm,w_sd_mm\n"
    runs = read(tmp_path, head + "1,50,10,1,0.9,0.5,\n2,60,0,1,1,,0.2\n")
    assert runs.l_sd_mm is not None
    assert runs.w_sd_mm is not None
    assert (runs.l_sd_mm.tolist(), runs.w_sd_mm.tolist()) == ([[0.5, 0.0]], [[0.0, 0.2]])
    with pytest.raises(ts.ReadingError, match="line 2: l_sd_mm = -1: the standard deviation of a place"):
        read(tmp_path, head + "1,50,10,1,0.9,-1,\n2,60,0,1,1,,\n")
    with pytest.raises(ts.ReadingError, match="column 'l_sdmm' is not known"):
        read(tmp_path, head.replace("l_sd_mm", "l_sdmm") + "1,50,10,1,0.9,1,\n2,60,0,1,1,,\n")


@pytest.mark.parametrize("name", FAULTS)
def test_faults_are_named(tmp_path: Path, name: str) -> None:
    text, message = FAULTS[name]
    with pytest.raises(ts.ReadingError) as caught:
        read(tmp_path, text)
    assert message in str(caught.value)
    assert str(tmp_path / "runs.csv") in str(caught.value)


def test_metal_from_end_to_end_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ts.ReadingError, match="line 2: the contact ties both ends of the strip to the metal"):
        read(tmp_path, "strip,l_mm,w_mm,v_out\n0,0,250,1\n", METAL)


def test_runs_of_another_unit_are_refused_unless_forced(tmp_path: Path) -> None:
    text = "strip,l_mm,w_mm,v_h,v_l,unit\n1,10,0,1,1,left\n2,10,0,1,1,left\n"
    assert read(tmp_path, text).unit == "left"
    assert read(tmp_path, text, unit="left").unit == "left"
    for sensor, unit in ((CRS, "right"), (replace(CRS, calibration=ts.Calibration(unit="right")), "")):
        with pytest.raises(ts.ReadingError, match="the runs are of unit 'left' and this unit is 'right'"):
            read(tmp_path, text, sensor, unit)
        assert read(tmp_path, text, sensor, unit, force=True).count == 2
    with pytest.raises(ts.ReadingError, match="line 3: the runs are of unit 'right' and this unit is 'left'"):
        read(tmp_path, text.replace("1,left\n2,10,0,1,1,left", "1,left\n2,10,0,1,1,right"))


FIELD = st.sampled_from(
    ["", "1", "2", "0", "10", "50", "-1", "1e9", "nan", "x", "3.5", "left", '"', "\0", "1e999"]
)
_CALIBRATED: set[tuple[object, ...]] = set()  # different files hold the same runs
LINES = st.lists(st.lists(FIELD, min_size=4, max_size=7).map(",".join), max_size=6).map("\n".join)


@settings(
    derandomize=True,
    max_examples=80,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(
    st.one_of(LINES.map(lambda t: HEAD + ROWS + t), LINES, texts(max_size=80), st.integers(0, 400)),
    st.booleans(),
)
def test_any_file_gives_runs_or_a_clear_error(tmp_path: Path, text: str | int, metal: bool) -> None:
    sensor = METAL if metal else CRS
    if isinstance(text, int):
        text = (HEAD + ROWS * 9)[:text]
    (tmp_path / "runs.csv").write_bytes(text.encode("utf-8", "surrogatepass"))
    try:
        runs = read_runs(tmp_path / "runs.csv", sensor)
        if (
            contents := (metal, *(v.tobytes() for v in (runs.l_mm, runs.w_mm, *runs.raw.values())))
        ) in _CALIBRATED:
            return
        _CALIBRATED.add(contents)
        done = ts.calibrate_unit(sensor, runs, model="offset")
    except ts.TacstripError:  # and nothing else
        return
    assert ts.Sensor.from_dict(tomllib.loads(done.sensor.to_toml())) == done.sensor


# The verb.


class Done(NamedTuple):
    code: int
    text: str  # both streams


def run(*words: object) -> Done:
    """Run the verb as `main` does: known errors become their message and exit code 2."""
    result = CliRunner().invoke(cli, ["calibrate", *map(str, words)])
    if isinstance(result.exception, ts.TacstripError):
        return Done(2, str(result.exception))
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return Done(result.exit_code, result.output)


def filled(plan: Path, sensor: ts.Sensor, calibration: ts.Calibration, seed: int = 0) -> None:
    """Fill in what a unit with that calibration reads, with +-0.1 % noise."""
    rng = np.random.default_rng(seed)
    unit = replace(sensor, calibration=calibration)
    head, *rows = plan.read_text(encoding="utf-8").splitlines()
    out = [head]
    for row in rows:
        number, l, w, tail = re.match(r"(\d+),([\d.]+),([\d.]+),+(.*)", row).groups()  # type: ignore[union-attr]
        low = np.full(sensor.strips, float(l))
        raw = invert_calibration(unit, ts.signatures(sensor, low, low + float(w)))
        i = int(number) - sensor.strip_base
        volts = [f"{(v[i] + rng.uniform(-0.001, 0.001)) * sensor.vref_volt:.5f}" for v in raw.values()]
        out.append(",".join([number, l, w, *volts, tail]))
    plan.write_text("\n".join(out) + "\n", encoding="utf-8")


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    CRS.save(tmp_path / "sensor.toml")
    return tmp_path


def test_from_plan_to_calibrated_spec(bench: Path) -> None:
    spec, runs, out = bench / "sensor.toml", bench / "runs.csv", bench / "calibrated.toml"
    planned = run("--plan", spec, "-o", runs, "--wanted", 0.2, "--noise", 0.1, "--unit", "left")
    assert planned.code == 0
    count = int(re.search(r"(\d+) contacts on each of 2 strips", planned.text)[1])  # type: ignore[index]
    assert len(runs.read_text().splitlines()) == 1 + 2 * count
    assert "there are no readings" in run(spec, runs, "-o", out).text
    filled(runs, CRS, OFFSETS)
    with runs.open("a") as file:  # untouched strips in the same runs
        for i in range(24):
            file.write(f"{1 + i % 2},,,{0.2 + 0.001 * (i % 3)},0.1,,\n")
    done = run(spec, runs, "-o", out, "--report", bench / "report", "--plot", bench / "strips.svg")
    assert done.code == 0
    assert "every strip has a reading" not in done.text
    assert "learned" in done.text
    lines = [line for line in done.text.splitlines() if "furthest off" in line or "residuals, after" in line]
    before, after = (re.findall(r"strip (\d) \(([\d.]+) %\)", line) for line in lines)
    assert {strip for strip, _ in before} == {strip for strip, _ in after} == {"1", "2"}
    assert all(
        float(old) > 0.3 > 0.1 > float(new) > 0.02 for (_, old), (_, new) in zip(before, after, strict=True)
    )
    assert [float(new) for _, new in after] == sorted((float(new) for _, new in after), reverse=True)
    assert "<svg" in (bench / "strips.svg").read_text(encoding="utf-8")
    sensor = ts.Sensor.load(out)
    assert sensor.calibration is not None
    assert (sensor.calibration.unit, sensor.calibration.source) == ("left", "runs.csv")
    assert sensor.calibration.made
    assert sensor.calibration.after_percent is not None
    assert sensor.calibration.after_percent < 0.1 < 1.0 < (sensor.calibration.before_percent or 0.0)
    np.testing.assert_allclose(sensor.calibration.channel("kh").offset, (0.05, 0.01), atol=1e-3)
    assert sensor.rest_volt == pytest.approx(0.15, abs=0.06)
    page = (bench / "report" / "report.html").read_text(encoding="utf-8")
    assert page.count("data:image/png;base64,") == 5  # three of all strips, one a strip
    assert page.index("the worst strips first") < page.index("<details>")  # what is looked at is not folded
    for words in ("unit left", "mean offsets (6.1)-(6.5)", "P.U. profile", "offset kh", "Models on trial"):
        assert words in page
    assert (bench / "report" / "figures" / "strip-2.png").exists()
    refused = run(out, runs, "-o", bench / "x.toml", "--unit", "right")
    assert refused.code == 2
    assert "give --force" in refused.text
    assert run(out, runs, "-o", bench / "x.toml", "--unit", "right", "--force", "--model", "mean").code == 0


def test_a_plan_that_does_not_reach_what_is_wanted_is_written_and_ends_with_1(bench: Path) -> None:
    planned = run("--plan", bench / "sensor.toml", "-o", bench / "runs.csv", "--wanted", 0.01)
    assert planned.code == 1
    assert "+-0.01 % is not reached" in planned.text
    assert (bench / "runs.csv").exists()


def test_runs_that_do_not_fit_make_no_spec(bench: Path) -> None:
    spec, runs, out = bench / "sensor.toml", bench / "runs.csv", bench / "calibrated.toml"
    run("--plan", spec, "-o", runs)
    filled(runs, CRS, OFFSETS)
    good = runs.read_text(encoding="utf-8")
    runs.write_text(good.replace("v_h,v_l", "v_l,v_h"), encoding="utf-8")
    exchanged = run(spec, runs, "-o", out)
    assert exchanged.code == 2
    assert "the columns of v_h and v_l are exchanged" in exchanged.text
    head, *rows = [line.split(",") for line in good.splitlines()]
    for i, row in enumerate(rows):  # the readings of other rows
        row[3:5] = good.splitlines()[1 + (i + 5) % len(rows)].split(",")[3:5]
    runs.write_text("\n".join(",".join(row) for row in (head, *rows)) + "\n", encoding="utf-8")
    other = run(spec, runs, "-o", out, "--model", "mean", "--report", bench / "report")
    assert other.code == 1
    assert "the runs do not describe this sensor" in other.text
    assert "use it" not in other.text
    assert not out.exists()
    assert "Doubtful:" in (bench / "report" / "report.html").read_text(encoding="utf-8")
    forced = run(spec, runs, "-o", out, "--model", "mean", "--force")
    assert forced.code == 0
    assert "written, but its constants are doubtful" in forced.text
    assert out.exists()


def test_touch_and_rezero_on_the_command_line(bench: Path) -> None:
    rows = "".join(f"{i},{0.01 * i},{s},{0.1 + 0.001 * (i % 2)},0.05\n" for i in range(20) for s in (1, 2))
    head = "scan,time_s,strip,v_h,v_l\n"
    (bench / "rest.csv").write_text(head + rows)
    (bench / "later.csv").write_text(head + rows.replace(",0.1", ",0.15").replace(",0.05\n", ",0.1\n"))
    learned = run(bench / "sensor.toml", "--touch", bench / "rest.csv", "-o", bench / "a.toml")
    assert learned.code == 0
    assert re.search(r"rest_volt = 0\.07\d+, touch_volt = 0\.003\d+ learned", learned.text)
    done = run("--rezero", bench / "a.toml", bench / "later.csv", "-o", bench / "b.toml")
    assert done.code == 0
    assert "2 of 2 strips re-zeroed" in done.text
    calibration = ts.Sensor.load(bench / "b.toml").calibration
    assert calibration is not None
    np.testing.assert_allclose(calibration.channel("kl").drift, 0.05 / 6.05, atol=1e-6)
    assert calibration.zeroed.endswith(", later.csv")
    (quiet,) = ts.read_readings(bench / "later.csv", ts.Sensor.load(bench / "b.toml"))[:1]
    assert not quiet.touched.any()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["sensor.toml"], "give RUNS to calibrate from"),
        (["sensor.toml", "runs.csv"], "name the spec to write with -o"),
        (["sensor.toml", "-o", "x.toml"], "give RUNS to calibrate from, or one of --touch, --plan, --rezero"),
        (["--plan", "sensor.toml", "runs.csv"], "--plan takes no RUNS"),
        (["--plan", "--rezero", "sensor.toml"], "--plan and --rezero are two jobs"),
        (["--rezero", "sensor.toml", "-o", "x.toml"], "--rezero needs readings"),
        (["sensor.toml", "runs.csv", "-o", "x.toml", "--wanted", "1"], "--wanted is for --plan"),
        (["sensor.toml", "runs.csv", "-o", "x.toml", "--reference", "1", "1"], "--reference is for --rezero"),
        (["sensor.toml", "--report", "r", "-o", "x.toml"], "--report is of a calibration: give RUNS"),
        (
            ["--rezero", "sensor.toml", "runs.csv", "-o", "x.toml", "--unit", "b"],
            "--unit is of a calibration",
        ),
        (["--rezero", "sensor.toml", "runs.csv", "-o", "x.toml", "--force"], "--force is of a calibration"),
        (
            ["--rezero", "sensor.toml", "runs.csv", "-o", "x.toml", "--touch", "r"],
            "--touch is a job of its own",
        ),
        (["--plan", "sensor.toml", "--touch", "runs.csv"], "--touch is a job of its own"),
        (["sensor.toml", "--touch", "r", "-o", "x.toml", "--model", "mean"], "--model is of a calibration"),
        (
            ["sensor.toml", "--plan", "--plot", "p.gif"],
            "p.gif: a picture is a file that ends in .png, .svg, .pdf",
        ),
        (["sensor.toml", "runs.csv", "-o", "runs.csv"], "runs.csv is read here and would be written over"),
        (["sheet.toml", "runs.csv", "-o", "x.toml"], "a crs-crp sensor cannot be calibrated strip by strip"),
        (["--plan", "sheet.toml"], "a crs-crp sensor cannot be calibrated strip by strip"),
    ],
)
def test_options_that_do_not_go_together(
    bench: Path, monkeypatch: pytest.MonkeyPatch, words: list[str], message: str
) -> None:
    monkeypatch.chdir(bench)
    Path("runs.csv").write_text(HEAD + ROWS)
    ts.Sensor(construction="crs-crp", strips=2, pitch_mm=6.5, length_mm=325.0, contact_lambda_mm=2.0).save(
        "sheet.toml"
    )
    result = run(*words)
    assert result.code == 2
    assert message in result.text


def test_a_plan_can_be_read_back(tmp_path: Path) -> None:
    write_plan(tmp_path / "p.csv", METAL, [(0, 10.0, 0.0), (1, 20.0, 50.0)], "left")
    text = (tmp_path / "p.csv").read_text().replace(",,", ",1.5,")
    runs = read(tmp_path, text, METAL)
    np.testing.assert_array_equal(runs.l_mm, [[10.0, 20.0]])
    assert runs.unit == "left"
