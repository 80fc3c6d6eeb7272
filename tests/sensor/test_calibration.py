"""A calibration as data: exact in TOML, exact there and back, refused where it cannot be, applied to readings."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import tacstrip as ts
from strategies import FIXED, texts
from tacstrip.data.published import offsets_volt
from tacstrip.network import Imperfections
from tacstrip.sensor import Channel, apply_calibration, invert_calibration
from tacstrip.sensor.raw import touched

N = 3
CRS = ts.Sensor(construction="crs-crs", strips=N, pitch_mm=6.5, length_mm=325.0, vref_volt=6.05)
METAL = ts.Sensor(construction="crs-m", strips=N, pitch_mm=4.5, length_mm=250.0)


NONE: st.SearchStrategy[tuple[float, ...]] = st.just(())


def lists(low: float, high: float) -> st.SearchStrategy[tuple[float, ...]]:
    return st.lists(st.floats(low, high), min_size=N, max_size=N).map(tuple)


@st.composite
def rising(draw: st.DrawFn, pinned: bool) -> tuple[tuple[float, ...], tuple[tuple[float, ...], ...]]:
    """Draw knots and rows that rise; from 0 to 1 if pinned."""
    pieces = draw(st.integers(2, 6))
    at = np.linspace(0.0, 1.0, pieces + 1)
    rows = [at + np.array(draw(st.lists(st.floats(-0.4, 0.4), min_size=pieces + 1, max_size=pieces + 1))) / pieces
            for _ in range(N)]  # fmt: skip
    if pinned:
        for row in rows:
            row[[0, -1]] = 0.0, 1.0
    return tuple(float(a) for a in at), tuple(tuple(float(v) for v in row) for row in rows)


@st.composite
def channels(draw: st.DrawFn, signature: str) -> Channel:
    drift, rest = draw(NONE | lists(-0.05, 0.05)), draw(NONE | lists(-0.05, 0.05))
    if draw(st.booleans()):
        at, rows = draw(rising(pinned=False))
        return Channel(signature=signature, curve_at=at, curve=rows, drift=drift, rest=rest)
    return Channel(
        signature=signature,
        offset=draw(NONE | lists(-0.07, 0.07)),
        gain=draw(NONE | lists(0.8, 1.2)),
        fade=draw(st.just(0.0) | st.floats(0.1, 0.5)),
        noise=draw(NONE | lists(0.0, 0.1)),
        drift=drift,
        rest=rest,
    )


@st.composite
def calibrations(draw: st.DrawFn, sensor: ts.Sensor) -> ts.Calibration:
    at, rows = draw(rising(pinned=True)) if draw(st.booleans()) else ((), ())
    has_ratio = "kh" in sensor.signatures and draw(st.booleans())
    return ts.Calibration(
        channels=tuple(draw(channels(name)) for name in sensor.signatures),
        ratio=draw(lists(0.5, 2.0)) if has_ratio else (),
        profile=tuple(draw(lists(-0.05, 0.05)) for _ in range(N)) if has_ratio else (),
        warp_at=at,
        warp=rows,
        made="2026-01-01",
        source=draw(st.sampled_from(["", 'a "b" \\ c.csv', "Läufe.csv"])),
        sensor=sensor.fingerprint,
        before_percent=draw(st.none() | st.floats(0.0, 9.0)),
    )


@pytest.mark.parametrize("sensor", [CRS, METAL], ids=lambda s: s.construction)
def test_toml_returns_every_calibration(sensor: ts.Sensor, tmp_path: Path) -> None:
    file = tmp_path / "calibrated.toml"

    @settings(FIXED, max_examples=25)
    @given(calibrations(sensor))
    def round_trip(calibration: ts.Calibration) -> None:
        whole = replace(sensor, calibration=calibration)
        whole.save(file)
        assert ts.Sensor.load(file) == whole
        assert hash(ts.Sensor.load(file)) == hash(whole)

    round_trip()


@settings(FIXED, max_examples=25)
@given(calibrations(CRS), st.integers(0, 2**31))
def test_correct_undoes_distort(calibration: ts.Calibration, seed: int) -> None:
    """Inside the scale, one by one, together, one scan and many; NaN stays."""
    rng = np.random.default_rng(seed)
    l = rng.uniform(90.0, 150.0, (5, N))
    l[0, 0] = np.nan
    k = ts.signatures(CRS, l, l + rng.uniform(0.0, 60.0, (5, N)))
    sensor = replace(CRS, calibration=calibration)
    back = apply_calibration(sensor, invert_calibration(sensor, k))
    one = apply_calibration(sensor, invert_calibration(sensor, {n: v[1] for n, v in k.items()}))
    for name, values in k.items():
        np.testing.assert_allclose(back[name], values, atol=1e-12)
        np.testing.assert_allclose(one[name], values[1], atol=1e-12)
        alone = calibration.correct(name, calibration.distort(name, values))
        np.testing.assert_allclose(alone, values, atol=1e-12)


@settings(FIXED, max_examples=25)
@given(calibrations(METAL), st.lists(st.floats(-5.0, 5.0) | st.just(float("nan")), min_size=N, max_size=N))
def test_results_stay_on_the_scale(calibration: ts.Calibration, values: list[float]) -> None:
    for k in (calibration.correct("k", values), calibration.distort("k", values)):
        np.testing.assert_array_equal(np.isnan(k), np.isnan(values))
        assert ts.Scan(k=k).touched.tolist() == [not np.isnan(v) for v in values]


def test_offsets_are_the_thesis_adjustment() -> None:
    """(6.3): the offset is subtracted from the measured voltage."""
    sensor = ts.Sensor.load("prototype-crs-crs")
    volts = offsets_volt("CRS-CRS", "kh")
    calibration = ts.Calibration(channels=(Channel(signature="kh", offset=tuple(volts / 6.05)),))
    np.testing.assert_allclose(calibration.correct("kh", np.full(10, 3.0 / 6.05)) * 6.05, 3.0 - volts)
    assert replace(sensor, calibration=calibration).calibration is calibration


def test_a_fading_offset_is_whole_inside_and_gone_at_both_ends() -> None:
    channel = Channel(signature="k", offset=(0.05,), fade=0.1)
    k = np.array([[0.0], [0.05], [0.1], [0.5], [0.9], [0.95], [1.0]])
    np.testing.assert_allclose(channel.distort(k)[:, 0], [0.0, 0.075, 0.15, 0.55, 0.95, 0.975, 1.0])
    np.testing.assert_allclose(channel.correct(channel.distort(k)), k, atol=1e-15)


def test_a_strips_own_ratio_is_the_closed_form_with_that_ratio() -> None:
    calibration = ts.Calibration(ratio=(0.9, 1.0, 1.2))
    sensor = replace(CRS, contact_lambda_mm=2.0, resistivity_ratio=1.05, calibration=calibration)
    l, w = np.full(N, 100.0), np.full(N, 60.0)
    own = [
        ts.k_h(l[i : i + 1], w[i : i + 1], 325.0, 1.05 * r, 2.0)[0] for i, r in enumerate(calibration.ratio)
    ]
    raw = invert_calibration(sensor, ts.signatures(replace(sensor, calibration=None), l, l + w))
    np.testing.assert_allclose(raw["kh"], own, atol=1e-14)


def test_warp_is_the_network_with_that_rubber() -> None:
    """Both layers with twice the resistance in the upper half: the network agrees, at any length of contact."""
    at, share = (0.0, 0.5, 1.0), (0.0, 1.0 / 3.0, 1.0)
    sensor = replace(CRS, calibration=ts.Calibration(warp_at=at, warp=(share,) * N))
    contact = ts.Contact.polygon([(0, 120), (20, 120), (20, 230), (0, 230)])
    layers = np.array([[1.0, 2.0]] * N)
    scan = ts.simulate(
        CRS, contact, model="network", imperfections=Imperfections(energised=layers, sensing=layers)
    )
    ideal = ts.simulate(CRS, contact)
    back = apply_calibration(sensor, {"kh": scan["kh"], "kl": scan["kl"]})
    for name in ("kh", "kl"):
        assert np.abs(scan[name] - ideal[name]).max() > 0.1
        np.testing.assert_allclose(back[name], ideal[name], atol=1e-9)


def test_files_hold_raw_readings_and_scans_corrected_ones(tmp_path: Path) -> None:
    channel = Channel(signature="k", offset=(0.05, 0.0, -0.02), gain=(0.9, 1.0, 1.1))
    sensor = replace(METAL, calibration=ts.Calibration(channels=(channel,)))
    scan = ts.simulate(sensor, ts.Contact.line([(0.0, 100.0), (8.9, 100.0)]))
    np.testing.assert_allclose(scan["k"], [0.4, 0.4, np.nan])  # simulate is ideal
    ts.write_readings(tmp_path / "r.csv", sensor, [scan])
    (raw,) = ts.read_readings(tmp_path / "r.csv", METAL)
    np.testing.assert_allclose(raw["k"], [0.41, 0.4, np.nan])
    (back,) = ts.read_readings(tmp_path / "r.csv", sensor)
    np.testing.assert_allclose(back["k"], scan["k"], atol=1e-9)


def test_each_strip_rests_at_its_own_learned_level() -> None:
    channel = Channel(
        signature="k", rest=(0.06, 0.01, 0.03), drift=(0.0, 0.002, 0.0), offset=(0.06, 0.01, 0.03)
    )
    calibration = ts.Calibration(channels=(channel,))
    sensor = replace(
        METAL, rest_volt=0.1, touch_volt=0.02, calibration=calibration
    )  # 0.02 V are 0.004 of Vref
    raw = {"k": np.array([[0.062, 0.012, 0.03], [0.07, 0.01, 0.02]])}
    np.testing.assert_array_equal(touched(sensor, raw), [[False, False, False], [True, False, True]])
    np.testing.assert_allclose(apply_calibration(sensor, raw)["k"][1], [0.01, np.nan, 0.0], atol=1e-15)


CURVE = {"curve_at": [0.0, 1.0], "curve": [[0.0, 1.0]] * N}
FAULTS: dict[str, tuple[ts.Sensor, dict[str, Any], str]] = {
    "unknown key": (CRS, {"offsets": [1]}, "unknown key 'calibration.offsets'; its keys are: ratio, profile"),
    "unknown inner key": (CRS, {"kh": {"bias": [1]}}, "unknown key 'kh.bias'; its keys are: offset, gain"),
    "no table": (CRS, {"kh": 3}, "calibration.kh: must be a table"),
    "foreign signature": (CRS, {"k": {"offset": [0.0] * N}}, "calibration.k: this sensor has only kh, kl"),
    "too few": (CRS, {"kh": {"offset": [0.0]}}, "calibration.kh.offset: 1 entries for 3 strips"),
    "texts": (CRS, {"kh": {"offset": ["0"] * N}}, "calibration.kh.offset: must be a list of numbers"),
    "no list": (CRS, {"kh": {"offset": 1.0}}, "calibration.kh.offset: must be a list of numbers"),
    "infinite": (CRS, {"ratio": [float("inf")] * N}, "calibration.ratio: every number must be finite"),
    "gain 0": (CRS, {"kh": {"gain": [1.0, 0.0, 1.0]}}, "calibration.kh.gain: every gain must be above 0"),
    "lengths differ": (CRS, {"kh": {"gain": [1.0] * N, "offset": [0.0]}}, "kh.offset: must have as many entries"),
    "fade": (CRS, {"kh": {"fade": 0.6}}, "calibration.kh.fade: must be 0 to 0.5"),
    "offset over fade": (CRS, {"kh": {"fade": 0.1, "offset": [0.2] * N}}, "an offset that fades must be smaller"),
    "curve and offset": (CRS, {"kh": {**CURVE, "offset": [0.0] * N}}, "a curve stands in place of offset"),
    "curve alone": (CRS, {"kh": {"curve": CURVE["curve"]}}, "kh.curve_at and kh.curve belong together"),
    "curve falls": (CRS, {"kh": {**CURVE, "curve": [[1.0, 0.0]] * N}}, "kh.curve: entry 0 must rise"),
    "curve short": (CRS, {"kh": {**CURVE, "curve": [[1.0]] * N}}, "entry 0 has 1 numbers for the 2 of kh.curve_at"),
    "knots": (CRS, {"kh": {**CURVE, "curve_at": [0.1, 1.0]}}, "kh.curve_at: must rise from 0 to 1"),
    "warp ends": (CRS, {"warp_at": [0.0, 1.0], "warp": [[0.0, 0.7]] * N}, "warp: every entry must rise from 0 to 1"),
    "ratio 0": (CRS, {"ratio": [0.0] * N}, "calibration.ratio: every ratio must be above 0"),
    "ratio of metal": (METAL, {"ratio": [1.0] * N}, "only a second layer of rubber has a ratio"),
    "profile": (CRS, {"profile": [[0.1], [0.1, 0.2], [0.1]]}, "calibration.profile: as many numbers for each strip"),
    "two lines": (CRS, {"model": "a\nb"}, "calibration.model: must be a text of one line"),
    "other sensor": (CRS, {"sensor": "crs-m, 9 strips"}, "the calibration is of another sensor"),
    "noise": (CRS, {"kl": {"noise": [-1.0] * N}}, "calibration.kl.noise: must be 0 or more"),
}  # fmt: skip


@pytest.mark.parametrize("name", FAULTS)
def test_faults_are_named(name: str) -> None:
    sensor, table, message = FAULTS[name]
    with pytest.raises(ts.SpecError) as caught:
        ts.Sensor.from_dict({**tomllib.loads(sensor.to_toml()), "calibration": table})
    assert message in str(caught.value)


def test_what_is_no_calibration_is_refused() -> None:
    with pytest.raises(ts.SpecError, match="calibration = 3: must be a Calibration"):
        replace(CRS, calibration=3)  # type: ignore[arg-type]
    with pytest.raises(ts.SpecError, match="calibration: must be a table"):
        ts.Sensor.from_dict({**tomllib.loads(CRS.to_toml()), "calibration": [1]})
    with pytest.raises(
        ts.SpecError, match="a crs-crp sensor takes no calibration: its strips shift each other"
    ):
        ts.Sensor(construction="crs-crp", strips=2, pitch_mm=1.0, length_mm=9.0, contact_lambda_mm=1.0,
                  calibration=ts.Calibration())  # fmt: skip
    with pytest.raises(ts.SpecError, match="has two channels"):
        ts.Calibration(channels=(Channel(signature="k"), Channel(signature="k")))
    with pytest.raises(ts.SpecError, match="signature 'x' does not exist"):
        Channel(signature="x")
    with pytest.raises(ts.SignatureError, match="signature 'x' does not exist"):
        ts.Calibration().correct("x", [0.5])


JUNK = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | texts(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(texts(max_size=5), inner, max_size=3),
    max_leaves=4,
)
INNER = st.dictionaries(
    st.sampled_from(["offset", "gain", "fade", "curve", "curve_at", "drift", "rest", "noise", "more"]),
    JUNK | lists(-1.0, 1.0) | st.lists(lists(-1.0, 1.0), min_size=N, max_size=N),
    max_size=3,
)
TABLES = st.dictionaries(
    st.sampled_from(
        ["kh", "kl", "k", "ratio", "warp", "warp_at", "made", "sensor", "before_percent", "more"]
    ),
    JUNK | INNER | lists(0.0, 2.0),
    max_size=3,
)


@settings(FIXED, max_examples=50)
@given(JUNK | TABLES)
def test_no_table_brings_another_error(table: Any) -> None:
    raw = {**tomllib.loads(CRS.to_toml()), "calibration": table}
    try:
        sensor = ts.Sensor.from_dict(raw)
    except ts.SpecError:
        return
    assert ts.Sensor.from_dict(tomllib.loads(sensor.to_toml())) == sensor
    apply_calibration(sensor, {"kh": np.full(N, 0.5), "kl": np.full(N, 0.4)})
