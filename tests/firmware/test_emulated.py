"""The firmware in simavr, from a shape that touches the sensor to the polygon on the host."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import tacstrip as ts
from emulated import (
    FIRMWARE,
    STARTED_S,
    VREF_VOLT,
    command_line,
    heard,
    make,
    memory_line,
    needs_compiler,
    needs_simavr,
    run,
    scan_line,
    scans_per_second,
    start_line,
    volts_line,
)
from tacstrip.arrays import FloatArray
from tacstrip.stream import Drag, decode
from tacstrip.stream.device.protocol.frames import Kind
from tacstrip.stream.device.protocol.messages import Command, Hello, SelfTest

pytestmark = [needs_compiler, needs_simavr]
_DOCS = FIRMWARE.parent / "docs"
BUILD_PAGE = (_DOCS / "guide/build.md").read_text(encoding="utf-8")
ERROR_PAGE = (_DOCS / "science/electronics.md").read_text(encoding="utf-8")
STRIPS = 10
TOP = 2**10 - 1
SHAPE = ts.Contact.polygon([(14.0, 45.0), (38.0, 18.0), (82.0, 40.0), (52.0, 80.0)])
CONSTRUCTIONS = {"crs-crs": 2, "crs-m": 1, "cyl-crs-m": 1, "crs-crp": 2}  # lines


def sensor(construction: str = "crs-crs") -> ts.Sensor:
    return ts.Sensor(
        construction=construction,
        strips=STRIPS,
        pitch_mm=10.0,
        length_mm=100.0,
        adc_bits=10,
        radius_mm=40.0 if construction == "cyl-crs-m" else None,
        contact_lambda_mm=5.0 if construction == "crs-crp" else 0.0,
    )


@pytest.fixture(scope="module")
def units(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A folder with firmware for each construction."""
    folders = {}
    for construction in CONSTRUCTIONS:
        folders[construction] = tmp_path_factory.mktemp(construction)
        make("uno", folders[construction], CONSTRUCTION=construction, STRIPS=STRIPS)
    return folders


def lines(construction: str, random: np.random.Generator) -> list[FloatArray]:
    """Volts anywhere from 0 to Vref on every strip."""
    return [random.uniform(0.0, VREF_VOLT, STRIPS) for _ in range(CONSTRUCTIONS[construction])]


@pytest.mark.parametrize("construction", CONSTRUCTIONS)
def test_says_who_it_is(units: dict[str, Path], construction: str) -> None:
    data = run(units[construction], [], 0.02, STRIPS, CONSTRUCTIONS[construction])
    (hello,), scans, _ = heard(data)
    assert isinstance(hello, Hello)
    assert (hello.construction, hello.strips, hello.adc_bits) == (construction, STRIPS, 10)
    assert hello.signatures == sensor(construction).signatures
    assert hello.supply_mv == pytest.approx(5000, rel=0.01)
    assert scans == []


@pytest.mark.parametrize("construction", ["crs-crs", "crs-m"])
def test_injected_volts_come_back_within_one_and_a_half_codes(
    units: dict[str, Path], construction: str
) -> None:
    random = np.random.default_rng(4)
    steps = [(0.06 + 0.02 * i, lines(construction, random)) for i in range(30)]
    scenario = [start_line(0), *(volts_line(at, volts) for at, volts in steps)]
    _, scans, decoder = heard(run(units[construction], scenario, 0.66, STRIPS, len(steps[0][1])))
    assert decoder.counts.corrupt == decoder.counts.lost == 0
    errors = []
    for at, volts in steps:
        inside = [s for s in scans if at + 0.003 < s.time_s < at + 0.015]
        assert len(inside) >= 4
        for scan in inside:
            assert scan.touched.all()
            for codes, wanted in zip(scan.codes.values(), volts, strict=True):
                errors.append(codes - wanted / VREF_VOLT * TOP)
    assert np.abs(errors).max() < 1.5


def test_the_strips_times_are_those_of_their_readings(units: dict[str, Path]) -> None:
    """All strips jump at once in mid-scan: those read later by their own time show it, the others do not."""
    jump = 0.2 + 0.00131
    scenario = [
        volts_line(0.0, [np.full(STRIPS, 1.0)] * 2),
        start_line(2500),
        volts_line(jump, [np.full(STRIPS, 4.0)] * 2),
    ]
    _, scans, _ = heard(run(units["crs-crs"], scenario, 0.25, STRIPS))
    (scan,) = (s for s in scans if s.codes["kh"].min() < 300 and s.codes["kh"].max() > 700)
    assert scan.strip_time_s is not None
    after = scan.time_s + scan.strip_time_s - jump
    # The device's clock starts up to 0.1 ms after it is switched on, and a line takes a moment to settle.
    clear = (after < -150e-6) | (after > 60e-6)
    assert clear.sum() >= STRIPS - 2
    assert np.array_equal(scan.codes["kh"][clear] > 512, after[clear] > 0.0)


@pytest.mark.parametrize("source_ohm", [100.0, 5e3, 2e4])
@pytest.mark.parametrize("node_pf", [50.0, 200.0])
def test_touch_is_told_whatever_the_line(units: dict[str, Path], source_ohm: float, node_pf: float) -> None:
    random = np.random.default_rng(5)
    steps = []
    for i in range(8):
        volts = random.choice([0.0, VREF_VOLT, 2.0], STRIPS)
        volts[random.random(STRIPS) < 0.5] = np.nan
        steps.append((0.06 + 0.02 * i, volts))
    scenario = [start_line(0), *(volts_line(at, [v, v]) for at, v in steps)]
    _, scans, _ = heard(run(units["crs-crs"], scenario, 0.22, STRIPS, 2, 16, source_ohm, node_pf))
    for at, volts in steps:
        inside = [s for s in scans if at + 0.003 < s.time_s < at + 0.015]
        assert inside
        for scan in inside:
            assert np.array_equal(scan.touched, ~np.isnan(volts))


@pytest.mark.parametrize("construction", ["crs-crs", "crs-m"])
def test_from_a_shape_to_its_polygon(units: dict[str, Path], construction: str) -> None:
    """Shape, network of resistors, volts, converter, firmware, line, decoder, scan, polygon."""
    ideal = ts.Sensor(construction=construction, strips=STRIPS, pitch_mm=10.0, length_mm=100.0)
    corners = [(6.0, 30.0), (94.0, 40.0), (48.0, 85.0)]
    truth = ts.simulate(ideal, ts.Contact.polygon(corners), model="network")
    scenario = [scan_line(0.0, truth), start_line(2500)]
    _, scans, _ = heard(run(units[construction], scenario, 0.1, STRIPS, CONSTRUCTIONS[construction]))
    spec = sensor(construction)
    scan = decode(scans[-1], spec)
    assert np.array_equal(scan.touched, truth.touched)
    for name in truth.signatures:
        assert np.nanmax(np.abs(scan[name] - truth[name])) < 1.5 / TOP
    (shape,) = ts.vertex_reconstruction(scan, spec, transitions=[6.0, 48.0, 94.0]).objects
    assert shape.status == "ok"
    assert ts.mismatch(corners, shape.vertices).iou > 0.98
    if len(scan.signatures) == 2:
        (whole,) = ts.profile_reconstruction(scan, spec).objects
        assert whole.profile is not None
        wanted = ts.footprint(ideal, ts.Contact.polygon(corners))
        for found, end in zip(whole.profile[1:], wanted, strict=True):
            assert np.nanmax(np.abs(found - end[whole.strips])) < 0.5


def steady(folder: Path, seconds: float) -> None:
    """Ten strips, double measurement, 400 scans/s, under a moving contact: no bad frame, none lost, none late."""
    spec = sensor()
    drag = Drag(SHAPE, [(40, 45), (60, 50)], 1.0, turn_rad_s=0.5)
    volts = [scan_line(0.02 * i, ts.simulate(spec, drag(0.02 * i))) for i in range(int(seconds * 50))]
    scenario = [
        *volts[:3],
        start_line(2500),
        *volts[3:],
        command_line(seconds + 0.06, Command(Kind.IDENTIFY)),
    ]
    messages, scans, decoder = heard(run(folder, scenario, seconds + 0.07, STRIPS))
    counts = decoder.counts
    assert (counts.corrupt, counts.lost, counts.out_of_order, counts.unknown) == (0, 0, 0, 0)
    scans = [s for s in scans if s.time_s < seconds + 0.055]  # before the last command
    assert len(scans) >= 400 * seconds
    assert scans_per_second(scans) == pytest.approx(400, rel=1e-4)
    assert np.abs(np.diff([s.time_s for s in scans[20:]]) - 2.5e-3).max() < 30e-6
    (last,) = (m for m in messages[1:] if isinstance(m, Hello))
    assert last.late == 0
    moved = np.array([s.codes["kh"] for s in scans])
    assert (np.ptp(moved, axis=0) > 50).any()


def test_two_seconds_at_400_scans_a_second(units: dict[str, Path]) -> None:
    steady(units["crs-crs"], 2.0)


@pytest.mark.parametrize("wrap", [2**16, 2**17], ids=["31 bits", "32 bits"])
def test_time_goes_on_where_the_clock_begins_anew(units: dict[str, Path], wrap: int) -> None:
    """The timer's overflows, 32.768 ms each, are set to a few before their count has 17 bits, or 18."""
    folder = units["crs-crs"]
    scenario = [memory_line(folder, STARTED_S - 0.01, "overflows", wrap - 5), start_line(2500)]
    messages, scans, decoder = heard(
        run(folder, [*scenario, command_line(0.45, Command(Kind.IDENTIFY))], 0.46, STRIPS)
    )
    assert decoder.counts.corrupt == decoder.counts.lost == 0
    times = np.array([scan.time_s for scan in scans])
    assert times[20] < wrap * 2**15 / 1e6 < times[149]
    assert np.abs(np.diff(times[20:150]) - 2.5e-3).max() < 30e-6
    hello = messages[-1]
    assert isinstance(hello, Hello)
    assert hello.late == 0


@pytest.mark.slow
def test_a_minute_at_400_scans_a_second(units: dict[str, Path]) -> None:
    steady(units["crs-crs"], 60.0)


def test_starts_and_stops_and_tests_itself(units: dict[str, Path]) -> None:
    open_lines = np.full(STRIPS, np.nan)
    held = open_lines.copy()
    held[3] = 1.0
    scenario = [
        volts_line(0.0, [held, open_lines]),
        start_line(2500),
        command_line(0.10, Command(Kind.STOP, 3)),
        command_line(0.12, Command(Kind.TEST, 4)),
    ]
    messages, scans, _ = heard(run(units["crs-crs"], scenario, 0.3, STRIPS))
    assert 0.05 < scans[0].time_s < 0.06
    assert 0.095 < scans[-1].time_s < 0.105
    found = messages[-1]
    assert isinstance(found, SelfTest)
    assert np.flatnonzero(found.held["kh"]).tolist() == [3]
    assert not found.held["kl"].any()


def test_multiplexers_of_eight_ways(tmp_path: Path) -> None:
    """Twenty strips on three enabled chips a line, and single measurement on line 1."""
    make("uno", tmp_path, STRIPS=20, WAYS=8, MEASURE="kl")
    volts = np.random.default_rng(6).uniform(0.0, VREF_VOLT, 20)
    scenario = [volts_line(0.0, [np.full(20, np.nan), volts]), start_line(0)]
    _, scans, _ = heard(run(tmp_path, scenario, 0.08, 20, 2, 8))
    assert list(scans[0].codes) == ["kl"]
    assert np.abs(scans[-1].codes["kl"] - volts / VREF_VOLT * TOP).max() < 1.5


def test_the_build_prints_what_it_takes(tmp_path: Path) -> None:
    said = make("uno", tmp_path)
    found = re.search(r"flash (\d+) of 32256 bytes .*RAM (\d+) of 2048 bytes", said)
    assert found
    (printed,) = re.findall(r"^flash (\d+) of .* RAM (\d+) of", BUILD_PAGE, re.MULTILINE)
    for now, page in zip(found.groups(), printed, strict=True):
        assert int(now) == pytest.approx(int(page), rel=0.05)


RATES = re.findall(r"^\| (\d+) \| (double|single|CRS-M) \|(.*)\|$", ERROR_PAGE, re.MULTILINE)
BAUDS = (115_200, 250_000, 500_000)


@pytest.mark.parametrize(
    ("strips", "measure", "baud"),
    [(5, "double", 500_000), (10, "double", 500_000), (10, "single", 115_200), (32, "double", 250_000),
     (64, "CRS-M", 500_000)],
)  # fmt: skip
def test_the_pages_table_of_rates(tmp_path: Path, strips: int, measure: str, baud: int) -> None:
    (cells,) = (row[2].split("|") for row in RATES if row[:2] == (str(strips), measure))
    metal = measure == "CRS-M"
    construction = {"CONSTRUCTION": "crs-m" if metal else "crs-crs"}
    make(
        "uno",
        tmp_path,
        STRIPS=strips,
        BAUD=baud,
        MEASURE="kh" if measure == "single" else "double",
        **construction,
    )
    volts = [np.full(strips, 2.5)] * (1 if metal else 2)
    _, scans, decoder = heard(run(tmp_path, [volts_line(0.0, volts), start_line(0)], 0.2 + 0.006 * strips, strips,
                                  len(volts)))  # fmt: skip
    assert decoder.counts.corrupt == decoder.counts.lost == 0
    assert scans_per_second(scans) == pytest.approx(float(cells[BAUDS.index(baud)]), rel=0.02)


def test_a_speed_that_the_clock_cannot_make_is_refused(tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match="16 MHz cannot make this BAUD"):
        make("uno", tmp_path, BAUD=230_400)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"CONSTRUCTION": "crs"}, "CONSTRUCTION=crs does not exist: take"),
        ({"MEASURE": "k"}, "take double, kh or kl"),
    ],
)
def test_a_setting_that_does_not_exist_is_refused(
    tmp_path: Path, settings: dict[str, str], message: str
) -> None:
    with pytest.raises(AssertionError, match=message):
        make("uno", tmp_path, **settings)


def test_the_pages_example_gives_the_pages_figures(capsys: pytest.CaptureFixture[str]) -> None:
    (code,) = re.findall(r"```python\n(.*?)```", ERROR_PAGE, re.DOTALL)
    exec(compile(code, "build.md", "exec"), {})
    printed = [line.split() for line in capsys.readouterr().out.splitlines()]
    table = re.findall(r"^\| ([^|]*%[^|]*) \| ([\d.]+) mm \| ([\d.]+) mm \|$", ERROR_PAGE, re.MULTILINE)
    assert len(printed) == len(table) == 4
    for numbers, (_, ten, twelve) in zip(printed, table, strict=True):
        assert [float(numbers[1]), float(numbers[2])] == pytest.approx([float(ten), float(twelve)], rel=0.02)
