"""The firmware for the RP2040, run in rp2040js on voltages of ours with the wide codes of its converter."""

from __future__ import annotations

import importlib.util
import re
import shutil
import struct
import subprocess
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import tacstrip as ts
from emulated import FIRMWARE, command_line, heard, make, scans_per_second, volts_line
from tacstrip.arrays import FloatArray
from tacstrip.sensor import Converter
from tacstrip.stream import Drag, decode
from tacstrip.stream.device.protocol.frames import Kind
from tacstrip.stream.device.protocol.messages import Command, Hello, SelfTest

MISSING = [tool for tool in ("arm-none-eabi-gcc", "node", "npm", "make") if shutil.which(tool) is None]
pytestmark = pytest.mark.skipif(
    bool(MISSING), reason=f"needs {', '.join(MISSING)}: apt-get install gcc-arm-none-eabi nodejs npm"
)

STRIPS, VREF_VOLT, TOP = 10, 3.3, 4095
STARTED_S = 0.01  # by then it has said hello
ADC = Converter(wide_codes=(512, 1536, 2560, 3584), widths_lsb=(9.5, 9.0, 10.0, 8.5))
WIDE = "widths 0 512=9.5 1536=9 2560=10 3584=8.5\n"
PAGE = (FIRMWARE.parent / "docs" / "guide" / "rp2040.md").read_text(encoding="utf-8")


def sensor(construction: str = "crs-crs") -> ts.Sensor:
    return ts.Sensor(
        construction=construction, strips=STRIPS, pitch_mm=10.0, length_mm=100.0, vref_volt=VREF_VOLT, adc_bits=12,
        converter=ADC,
    )  # fmt: skip


@pytest.fixture(scope="module")
def emulator(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("rp2040")
    try:
        make("rp2040js", folder)
    except AssertionError as error:
        pytest.skip(f"npm cannot fetch rp2040js: {str(error).strip()[-200:]}")
    return folder


@pytest.fixture(scope="module")
def unit(emulator: Path) -> Path:
    make("rp2040", emulator, BAUD=1_000_000, UNIT_NAME="pico", PERIOD_US=1000)
    return emulator


def scan_line(at_s: float, scan: ts.Scan) -> str:
    return volts_line(at_s, [scan[name] * VREF_VOLT for name in scan.signatures])


def start_line(period_us: int) -> str:
    return command_line(STARTED_S, Command(Kind.RATE, 1, period_us), Command(Kind.START, 2))


def run(folder: Path, scenario: Iterable[str], seconds: float, lines: int = 2, strips: int = STRIPS) -> bytes:
    command = ["node", "run.mjs", "rp2040.bin", *map(str, (seconds, strips, lines, 16, 5e3, 100.0))]
    done = subprocess.run(
        command, input="".join(scenario).encode(), capture_output=True, check=False, cwd=folder
    )
    assert done.returncode == 0, done.stderr.decode()
    return done.stdout


def test_voltages_come_back_within_two_codes_and_a_shape_as_its_polygon(unit: Path) -> None:
    """Volts all over the range and next to the wide codes; then a shape through a network of resistors."""
    random = np.random.default_rng(4)
    steps: list[tuple[float, list[FloatArray]]] = []
    for i in range(12):
        parts = random.uniform(0.0, 1.0, (2, STRIPS))
        parts[:, :4] = (np.array(ADC.wide_codes) + random.uniform(-12.0, 12.0, (2, 4))) / 4096
        steps.append((0.014 + 0.003 * i, list(parts * VREF_VOLT)))
    ideal = replace(sensor(), converter=None, adc_bits=None)
    corners = [(6.0, 30.0), (94.0, 40.0), (48.0, 85.0)]
    truth = ts.simulate(ideal, ts.Contact.polygon(corners), model="network")
    scenario = [WIDE, start_line(0), *(volts_line(at, volts) for at, volts in steps), scan_line(0.050, truth)]
    messages, scans, decoder = heard(run(unit, scenario, 0.054))
    hello = messages[0]
    assert isinstance(hello, Hello)
    assert (hello.construction, hello.unit_name, hello.adc_bits, hello.baud) == (
        "crs-crs",
        "pico",
        12,
        1_000_000,
    )
    assert decoder.counts.corrupt == decoder.counts.lost == 0

    narrow, wide = [], []
    for at, volts in steps:
        scan = next(s for s in scans if s.time_s > at + 1e-4)
        assert scan.touched.all()
        read = decode(scan, sensor())
        for name, wanted in zip(("kh", "kl"), volts, strict=True):
            off = np.abs(read[name] * TOP - wanted / VREF_VOLT * TOP)
            at_wide = np.isin(scan.codes[name], ADC.wide_codes)
            narrow += list(off[~at_wide])
            wide += list(off[at_wide] / (0.5 * max(ADC.widths_lsb)))
    assert len(narrow) > 150
    assert max(narrow) < 2.0
    assert len(wide) > 20
    assert max(wide) < 1.2

    spec = sensor()
    found = decode(scans[-1], spec)
    assert np.array_equal(found.touched, truth.touched)
    (shape,) = ts.vertex_reconstruction(found, spec, transitions=[6.0, 48.0, 94.0]).objects
    assert shape.status == "ok"
    assert ts.mismatch(corners, shape.vertices).iou > 0.98
    (fitted,) = ts.fit_polygon(found, spec).objects
    assert ts.mismatch(corners, fitted.vertices).iou > 0.98


def test_a_hung_program_is_reset_and_tests_itself(unit: Path) -> None:
    held = np.full(STRIPS, np.nan)
    held[3] = 1.0
    nothing = np.full(STRIPS, np.nan)
    scenario = [
        volts_line(0.0, [held, nothing]),
        start_line(1000),
        "hang 15000\n",
        command_line(0.285, Command(Kind.TEST, 4)),
    ]
    messages, scans, _ = heard(run(unit, scenario, 0.290))
    hellos = [m for m in messages if isinstance(m, Hello)]
    assert len(hellos) == 2
    assert scans[-1].time_s < 0.016
    assert all(np.array_equal(s.touched, np.isfinite(held)) for s in scans)
    tested = messages[-1]
    assert isinstance(tested, SelfTest)
    assert np.flatnonzero(tested.held["kh"]).tolist() == [3]
    assert not tested.held["kl"].any()


def test_metal_and_a_second_bank_of_multiplexers(emulator: Path, tmp_path: Path) -> None:
    for name in ("run.mjs", "package.json"):
        shutil.copy(emulator / name, tmp_path)
    (tmp_path / "node_modules").symlink_to(emulator / "node_modules")
    make("rp2040", tmp_path, CONSTRUCTION="crs-m", STRIPS=20)
    volts = np.random.default_rng(6).uniform(0.0, VREF_VOLT, 20)
    _, scans, decoder = heard(run(tmp_path, [volts_line(0.0, [volts]), start_line(0)], 0.016, 1, 20))
    assert decoder.counts.corrupt == 0
    assert list(scans[-1].codes) == ["k"]
    assert np.abs(scans[-1].codes["k"] - volts / VREF_VOLT * 4096).max() < 1.5


def test_the_build_prints_what_it_takes_and_the_boot_rom_takes_the_image(tmp_path: Path) -> None:
    said = make("rp2040", tmp_path, UNIT_NAME="left-hand")
    found = re.search(r"flash (\d+) of 2097152 bytes .*RAM (\d+) of 262144 bytes", said)
    assert found
    (printed,) = re.findall(r"^flash (\d+) of .* RAM (\d+) of", PAGE, re.MULTILINE)
    for now, page in zip(found.groups(), printed, strict=True):
        assert int(now) == pytest.approx(int(page), rel=0.05)
    spec = importlib.util.spec_from_file_location("image", FIRMWARE / "boards" / "rp2040" / "image.py")
    assert spec is not None
    assert spec.loader is not None
    tool = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tool)
    assert tool.crc32(b"123456789") == 0x0376E6E7  # the catalogue's check value of CRC-32/MPEG-2
    image = (tmp_path / "rp2040.bin").read_bytes()
    assert tool.crc32(image[:252]) == struct.unpack_from("<I", image, 252)[0]
    stack, entry = struct.unpack_from("<2I", image, 256)
    assert stack == 0x20040000
    assert entry & 1
    assert 0x10000100 < entry < 0x10000000 + len(image)
    blocks = (tmp_path / "rp2040.uf2").read_bytes()
    assert len(blocks) % 512 == 0
    parts = []
    for i in range(len(blocks) // 512):
        block = blocks[512 * i : 512 * i + 512]
        head = struct.unpack_from("<8I", block)
        assert head == (
            0x0A324655,
            0x9E5D5157,
            0x2000,
            0x10000000 + 256 * i,
            256,
            i,
            len(blocks) // 512,
            0xE48BFF56,
        )
        assert struct.unpack_from("<I", block, 508)[0] == 0x0AB16F30
        parts.append(block[32:288])
    assert b"".join(parts)[: len(image)] == image


def test_a_speed_that_cannot_be_is_refused(tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match="BAUD is 57600 to 3000000"):
        make("rp2040", tmp_path, BAUD=4_000_000)


@pytest.mark.slow
def test_ten_seconds_at_a_thousand_scans_a_second(unit: Path) -> None:
    spec = replace(sensor(), converter=None)
    drag = Drag(
        ts.Contact.polygon([(20, 38), (60, 20), (78, 56), (42, 76)]),
        [(40, 45), (60, 50)],
        1.0,
        turn_rad_s=0.5,
    )
    volts = [scan_line(0.02 * i, ts.simulate(spec, drag(0.02 * i))) for i in range(500)]
    scenario = [WIDE, volts[0], start_line(1000), *volts[1:], command_line(10.02, Command(Kind.IDENTIFY))]
    messages, scans, decoder = heard(run(unit, scenario, 10.03))
    counts = decoder.counts
    assert (counts.corrupt, counts.lost, counts.out_of_order, counts.unknown) == (0, 0, 0, 0)
    assert len(scans) >= 10_000
    assert scans_per_second(scans) == pytest.approx(1000, rel=1e-4)
    last = messages[-1]
    assert isinstance(last, Hello)
    assert last.late == 0
    assert (np.ptp([s.codes["kh"] for s in scans], axis=0) > 200).any()
