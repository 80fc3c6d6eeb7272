"""Every source of scans keeps the same promises; and the way from a source to a recorder."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import tacstrip as ts
from recordings import ORIGIN, make, sensor, source
from strategies import FIXED
from tacstrip.reconstruction.methods import METHODS, quick_options, reconstruct
from tacstrip.stream import Drag, RawScan, ReadingsSource, Source, paced
from tacstrip.stream.codes import code_shape, code_type, decode, encode, quantisation_error, top_code
from tacstrip.stream.recording.recorder import Recorder, record, with_shapes
from tacstrip.stream.replay import open_source

COUNT = 30
STILL = Drag(ts.Contact.points((0, 0)), [(15, 50)], 1.0)


def _simulated(folder: Path) -> Source:
    return source(sensor(), COUNT)


def _network(folder: Path) -> Source:
    spec = sensor("crs-m", 6)
    still = Drag(ts.Contact.polygon([(0, 20), (6, 30), (3, 60)]), [(3.0, 40.0)], 1.0)
    return ts.SimulatedSource(spec, still, 50.0, COUNT, model="network", origin_ns=ORIGIN)


def _recorded(folder: Path) -> Source:
    if not (folder / "a.mcap").exists():
        make(folder / "a.mcap", sensor(), COUNT)
    return ts.Recording(folder / "a.mcap")


def _readings(folder: Path) -> Source:
    spec = sensor()
    ts.write_readings(folder / "a.csv", spec, [decode(raw, spec) for raw in source(spec, COUNT)])
    return ReadingsSource(folder / "a.csv", spec)


SOURCES: dict[str, Callable[[Path], Source]] = {
    "simulated": _simulated,
    "simulated by a network": _network,
    "recorded": _recorded,
    "readings": _readings,
}


@pytest.mark.parametrize("name", SOURCES)
def test_the_promises_of_a_source(tmp_path: Path, name: str) -> None:
    made = SOURCES[name](tmp_path)
    assert made.sensor.adc_bits is not None
    assert made.origin_ns > 0
    raws = list(made)
    assert len(raws) == COUNT
    assert [raw.sequence for raw in raws] == list(range(COUNT))
    assert np.all(np.diff([raw.time_s for raw in raws]) > 0.0)
    for raw in raws:
        assert tuple(raw.codes) == made.names
        assert raw.touched.dtype == bool
        assert raw.touched.any()
        for code, values in raw.codes.items():
            assert values.dtype == code_type(made.sensor)
            assert values.shape == code_shape(made.sensor, code)
            assert values.max() <= top_code(made.sensor)
        scan = decode(raw, made.sensor)
        scan.check(made.sensor)
        assert scan.time_s == raw.time_s
        np.testing.assert_array_equal(scan.touched, raw.touched)
    made.close()
    made.close()


@pytest.mark.parametrize("name", SOURCES)
def test_every_source_can_be_recorded(tmp_path: Path, name: str) -> None:
    made = SOURCES[name](tmp_path)
    with Recorder(tmp_path / "new.mcap", made.sensor, made.names, made.origin_ns) as recorder:
        record(made, recorder)
    again = ts.Recording(tmp_path / "new.mcap")
    assert again.origin_ns == made.origin_ns
    for got, want in zip(again, SOURCES[name](tmp_path), strict=True):
        for code, values in want.codes.items():
            np.testing.assert_array_equal(got.codes[code], values)


@FIXED
@given(st.integers(1, 32), st.integers(0, 2**31), st.sampled_from(["crs-crs", "crs-m"]))
def test_encode_then_decode_is_exact_on_codes(bits: int, seed: int, construction: str) -> None:
    spec = replace(sensor(construction, 9), adc_bits=bits)
    random = np.random.default_rng(seed)
    there = random.random(9) < 0.7
    there[0] = True
    values = {
        name: np.where(there, random.integers(0, 2**bits, 9) / (2.0**bits - 1.0), np.nan)
        for name in spec.signatures
    }
    scan = ts.Scan(**values, time_s=3.5)
    assert quantisation_error(scan, spec) == pytest.approx(0.0, abs=1e-5)
    back = decode(encode(scan, spec), spec)
    for name in spec.signatures:
        np.testing.assert_allclose(back[name], scan[name], rtol=0.0, atol=1e-15)


def test_without_converter_sixteen_bits() -> None:
    spec = replace(sensor(), adc_bits=None)
    made = source(spec, 2)
    assert made.sensor == replace(spec, adc_bits=16)
    assert next(iter(made)).codes["kh"].max() > 4095


def test_rounding_tells_what_a_converter_cannot_hold() -> None:
    spec = sensor("crs-m", 3)
    assert quantisation_error(ts.Scan(k=np.array([np.nan, 0.3 / 4095, 1.0])), spec) == pytest.approx(0.3)
    assert quantisation_error(ts.Scan(k=np.full(3, np.nan)), spec) == 0.0


def test_a_code_above_the_converter() -> None:
    spec = replace(sensor("crs-m", 2), adc_bits=10)
    raw = RawScan(0.0, {"k": np.array([1, 1024], "<u2")}, np.ones(2, bool))
    with pytest.raises(ts.RecordingError, match="code 1024, above 1023: adc_bits = 10"):
        decode(raw, spec)


def test_blocks_are_what_one_by_one_is() -> None:
    spec, drag = (
        sensor(),
        Drag(ts.Contact.polygon([(-8, -9), (7, -3), (2, 12)]), [(12, 40), (18, 55)], 0.1, 3.0),
    )
    fast = ts.SimulatedSource(spec, drag, 500.0, 150)
    slow = ts.SimulatedSource(spec, drag, 500.0, 150, ahead=1)
    for one, other in zip(fast, slow, strict=True):
        assert (one.time_s, one.sequence) == (other.time_s, other.sequence)
        np.testing.assert_array_equal(one.touched, other.touched)
        for name, values in one.codes.items():
            np.testing.assert_array_equal(values, other.codes[name])


def test_a_contact_that_leaves_or_shorts_the_sensor() -> None:
    away = Drag(ts.Contact.polygon([(0, 0), (4, 0), (2, 5)]), [(15, 50), (15, 200)], 0.1)
    with pytest.raises(ts.ContactError, match="outside the sensor"):
        list(ts.SimulatedSource(sensor(), away, 1000.0, 200))
    tall = Drag(ts.Contact.polygon([(0, 0), (40, 0), (40, 100), (0, 100)]), [(45, 50), (25, 50)], 0.1)
    with pytest.raises(ts.ContactError, match="covers strip"):
        list(ts.SimulatedSource(sensor("crs-m", 30), tall, 1000.0, 200))


def test_a_drag_goes_there_and_back() -> None:
    drag = Drag(ts.Contact.polygon([(0, 0), (2, 0), (1, 3)]), [(10, 10), (20, 10), (20, 20)], 2.0)
    where = [tuple(drag(t).centroid.round(9).tolist()) for t in (0.0, 0.5, 1.0, 2.0, 3.0, 4.0)]
    assert where == [(10, 10), (15, 10), (20, 10), (20, 20), (20, 10), (10, 10)]
    turned = Drag(ts.Contact.polygon([(-2, 0), (2, 0), (2, 1), (-2, 1)]), [(10, 10)], 1.0, math.pi / 2.0)
    box = np.ptp(turned(1.0).vertices, axis=0)
    np.testing.assert_allclose(box, [1.0, 4.0], atol=1e-9)


def test_pace(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [50.0]
    told: list[float] = []
    monkeypatch.setattr(time, "monotonic", lambda: now[0])

    def sleep(seconds: float) -> None:
        assert seconds <= 0.05  # so that a stop is noticed
        now[0] += seconds

    monkeypatch.setattr(time, "sleep", sleep)
    raws = [RawScan(t, {"k": np.zeros(1, "<u2")}, np.ones(1, bool)) for t in (5.0, 5.1, 5.1, 4.0, 5.2, 6.2)]
    came = [now[0] - 50.0 for _ in paced(raws, 2.0, idle=told.append)]
    np.testing.assert_allclose(came, [0.0, 0.05, 0.05, 0.05, 0.1, 0.6])
    np.testing.assert_allclose(told, [0.05, 0.05, 0.5])
    now[0] = 50.0
    assert [now[0] for _ in paced(raws, math.inf)] == [50.0] * 6
    late = paced(raws, 1.0)
    next(late)
    now[0] += 100.0
    assert len(list(late)) == 5  # late scans are not left out
    count = iter(range(100))
    assert len(list(paced(raws, math.inf, stop=lambda: next(count) > 6))) < 6


def test_shapes_beside_the_codes() -> None:
    spec = sensor()
    for method in METHODS:
        scan = next(iter(with_shapes(source(spec, 1), spec, method)))
        wanted = reconstruct(decode(scan, spec), spec, method=method, **quick_options(method))
        assert [s.status for s in scan.shapes or ()] == [o.status for o in wanted.objects if o.found]
    with pytest.raises(ts.OptionError, match="method 'magic' does not exist; choose one of: polygon"):
        next(iter(with_shapes(source(spec, 1), spec, "magic")))


def test_readings_keep_what_untouched_strips_read(tmp_path: Path) -> None:
    """Rest and calibration belong to whoever reads the codes, not to the recording."""
    spec = replace(sensor("crs-m", 3), rest_volt=0.0, touch_volt=0.5)
    (tmp_path / "a.csv").write_text("scan,time_s,strip,code\n0,1.5,0,7\n0,1.5,1,2000\n0,1.5,2,\n")
    made = ReadingsSource(tmp_path / "a.csv", spec)
    (raw,) = made
    assert raw.codes["k"].tolist() == [7, 2000, 0]
    assert raw.touched.tolist() == [True, True, False]
    assert decode(raw, made.sensor).touched.tolist() == [False, True, False]


def test_times_since_1970_stay(tmp_path: Path) -> None:
    spec = sensor("crs-m", 1)
    (tmp_path / "a.csv").write_text("scan,time_s,strip,code\n0,1700000000.5,0,7\n")
    made = ReadingsSource(tmp_path / "a.csv", spec)
    with Recorder(tmp_path / "a.mcap", made.sensor, made.names, made.origin_ns) as recorder:
        record(made, recorder)
    assert made.origin_ns == 0
    assert [raw.time_s for raw in ts.Recording(tmp_path / "a.mcap")] == [1700000000.5]


@pytest.mark.parametrize(
    ("make_it", "told"),
    [
        (lambda: open_source("a.csv"), "does not say what sensor it is of; name its spec"),
        (lambda: open_source("a.txt"), "ends in .mcap or .csv"),
        (lambda: ts.SimulatedSource(sensor(), STILL, scans=0), "scans = 0: must be 1 or more"),
        (lambda: ts.SimulatedSource(sensor(), STILL, ahead=0), "ahead = 0: must be 1 or more"),
        (lambda: ts.SimulatedSource(sensor(), STILL, -1.0), "rate_hz = -1.0: must be above 0"),
        (lambda: Drag(ts.Contact.points((1, 1)), [(0, 0)], 0.0), "seconds = 0.0: must be above 0"),
    ],
)
def test_what_a_source_refuses(make_it: Callable[[], object], told: str) -> None:
    with pytest.raises(ts.TacstripError, match=told):
        make_it()
