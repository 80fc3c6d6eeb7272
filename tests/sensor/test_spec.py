"""The sensor as data: the file in and out, and every message that a wrong file can bring."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from strategies import FIXED, sensors, texts
from tacstrip.data import data_path, spec_names
from tacstrip.errors import SignatureError, SpecError
from tacstrip.sensor.constructions import CONSTRUCTIONS
from tacstrip.sensor.spec import KEYS, Sensor

FLAT: dict[str, Any] = {"construction": "crs-crs", "strips": 10, "pitch_mm": 5.0, "length_mm": 100.0}
TUBE: dict[str, Any] = {**FLAT, "construction": "cyl-crs-m", "radius_mm": 9.0}
METAL: dict[str, Any] = {**FLAT, "construction": "crs-m"}
GOOD = 'format = 1\nconstruction = "crs-crs"\nstrips = 10\npitch_mm = 5.0\nlength_mm = 100.0\n'
ALL_KEYS = (
    "format, construction, strips, pitch_mm, length_mm, strip_width_mm, radius_mm, resistivity_ratio, "
    "contact_lambda_mm, vref_volt, adc_bits, rest_volt, touch_volt, strip_base, without, adc, surface, noise, "
    "calibration"
)
NEEDED = "format, construction, strips, pitch_mm, length_mm"


def message_of(path: Path, content: str | bytes) -> str:
    """Write a spec, load it, and return the error's text after the file's name."""
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    with pytest.raises(SpecError) as caught:
        Sensor.load(path)
    name, _, text = str(caught.value).partition(": ")
    assert name == str(path)
    return text


# In and out.


@FIXED
@given(sensors())
def test_toml_returns_every_sensor(sensor: Sensor) -> None:
    assert Sensor.from_dict(tomllib.loads(sensor.to_toml())) == sensor


@pytest.mark.parametrize("construction", sorted(CONSTRUCTIONS))
def test_saving_and_loading_returns_the_sensor(
    tmp_path_factory: pytest.TempPathFactory, construction: str
) -> None:
    file = tmp_path_factory.mktemp("spec") / "sensor.toml"

    @settings(FIXED, max_examples=25)
    @given(sensors(construction))
    def round_trip(sensor: Sensor) -> None:
        sensor.save(file)
        assert Sensor.load(file) == sensor

    round_trip()


@settings(FIXED, max_examples=25)
@given(sensors())
def test_the_file_has_every_key_that_applies_with_its_comment(sensor: Sensor) -> None:
    others = set().union(*(c.keys for c in CONSTRUCTIONS.values())) - sensor.kind.keys
    lines = sensor.to_toml().splitlines()[1:]
    written = [re.fullmatch(r"(# )?(\w+) = (\S+) +# (\S.*)", line) for line in lines]
    assert [match and match[2] for match in written] == [key for key in KEYS if key not in others]
    for match in written:
        assert match is not None
        assert match[4] == KEYS[match[2]][1]
        unset = [None, (), *([0] if match[2] == "strip_base" else [])]  # for 0 is what nobody said
        assert (match[1] is None) == (getattr(sensor, match[2]) not in unset)


@pytest.mark.parametrize("base", [FLAT, METAL, TUBE], ids=lambda b: b["construction"])
def test_what_stands_commented_out_can_be_used_as_it_is(tmp_path: Path, base: dict[str, Any]) -> None:
    file = tmp_path / "sensor.toml"
    text = Sensor(**base | {"strips": 5}).to_toml()
    file.write_text(re.sub(r"^# (\w+ = )", r"\1", text, flags=re.MULTILINE), encoding="utf-8")
    sensor = Sensor.load(file)
    assert (sensor.strip_width_mm, sensor.adc_bits) == (3.0, 12)
    assert (sensor.rest_volt, sensor.touch_volt) == (0.0, 0.05)


def test_whole_numbers_and_numpy_numbers_become_plain_ones() -> None:
    sensor = Sensor(construction="crs-crs", strips=np.int64(10), pitch_mm=5, length_mm=np.float32(100.0))  # type: ignore[arg-type]
    assert sensor == Sensor(**FLAT)
    assert (type(sensor.strips), type(sensor.pitch_mm), type(sensor.length_mm)) == (int, float, float)


def test_a_sensor_is_frozen() -> None:
    sensor = Sensor(**FLAT)
    with pytest.raises(AttributeError):
        sensor.strips = 11  # type: ignore[misc]
    assert hash(sensor) == hash(Sensor(**FLAT))


def test_what_follows_from_the_keys() -> None:
    sensor = Sensor(**FLAT)
    np.testing.assert_array_equal(sensor.x_mm, [2.5, 7.5, 12.5, 17.5, 22.5, 27.5, 32.5, 37.5, 42.5, 47.5])
    assert (sensor.width_mm, sensor.strip_width) == (50.0, 5.0)
    assert Sensor(**FLAT, strip_width_mm=3.0).strip_width == 3.0
    assert Sensor(**FLAT, resistivity_ratio=2.5).sensing_ratio == 2.5
    assert Sensor(**METAL).sensing_ratio == 0.0
    assert sensor.signatures == ("kh", "kl")
    assert Sensor(**METAL).signatures == Sensor(**TUBE | {"strips": 5}).signatures == ("k",)


def test_connectors_as_the_thesis_counts_them() -> None:
    assert Sensor(**FLAT).kind.connectors(10) == 22
    assert Sensor(**METAL).kind.connectors(9) == 20


def test_signatures_are_checked() -> None:
    assert Sensor(**FLAT).check_signature("kl") == "kl"
    with pytest.raises(SignatureError) as caught:
        Sensor(**METAL).check_signature("kh")
    assert str(caught.value) == "a crs-m sensor has no signature 'kh'; it has: k"
    with pytest.raises(SignatureError) as caught:
        Sensor(**FLAT).check_signature("k_h")
    assert str(caught.value) == "signature 'k_h' does not exist; choose one of: kh, kl, k"


# The specs that ship.


def test_the_shipped_specs() -> None:
    assert spec_names() == [
        "fingertip",
        "forearm",
        "layered-crs-crs",
        "prototype-crs-crs",
        "prototype-crs-m",
        "prototype-cyl-crs-m",
        "simulated-crs-crs",
        "simulated-crs-m",
    ]


@pytest.mark.parametrize("name", spec_names())
def test_a_shipped_spec_loads_by_name_and_says_no_more_than_its_sensor(name: str) -> None:
    sensor = Sensor.load(name)
    assert sensor.construction == (name.partition("-")[2] or "crs-crs")
    text = data_path(f"specs/{name}.toml").read_text(encoding="utf-8")
    assert text.partition("\n")[2] == sensor.to_toml()  # below a first line of its own


def test_a_file_comes_before_a_shipped_spec(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("prototype-crs-m").write_text(GOOD, encoding="utf-8")
    assert Sensor.load("prototype-crs-m").construction == "crs-crs"


PUBLISHED = tomllib.loads(data_path("published.toml").read_text(encoding="utf-8"))


@pytest.mark.parametrize("row", PUBLISHED["prototype"], ids=lambda row: row["sensor"])
def test_prototypes_are_as_published(row: dict[str, Any]) -> None:
    sensor = Sensor.load(f"prototype-{row['sensor'].lower()}")
    assert sensor.strips == row["strips"]
    assert sensor.strip_width_mm == pytest.approx(10.0 * row["strip_width_cm"])
    assert sensor.length_mm == pytest.approx(10.0 * row["strip_length_cm"])
    assert 10.0 / sensor.pitch_mm == pytest.approx(row["elements_per_cm"], abs=0.05)  # printed to .25 at best
    if "digital_extent_cm" in row:
        assert sensor.width_mm == pytest.approx(10.0 * row["digital_extent_cm"])
    radius = 10.0 * row["radius_cm"] if "radius_cm" in row else None
    assert sensor.radius_mm == (None if radius is None else pytest.approx(radius))


@pytest.mark.parametrize("name", ["simulated-crs-crs", "simulated-crs-m"])
def test_simulated_sensors_are_those_of_chapter_5(name: str) -> None:
    sensor = Sensor.load(name)
    assert (sensor.strips, sensor.pitch_mm, sensor.length_mm) == (1000, 1.0, 1000.0)


# Impossible values; the message names the key.


@pytest.mark.parametrize(
    ("base", "change", "message"),
    [
        (FLAT, {"construction": "crs"}, "construction 'crs' does not exist; choose one of: {constructions}"),
        (FLAT, {"construction": None}, "construction None does not exist; choose one of: {constructions}"),
        (FLAT, {"construction": []}, "construction [] does not exist; choose one of: {constructions}"),
        (FLAT, {"strips": 0}, "strips = 0: must be 1 to 1000000"),
        (FLAT, {"strips": 1_000_001}, "strips = 1000001: must be 1 to 1000000"),
        (FLAT, {"strips": 10**400}, "strips: the number is too large"),
        (FLAT, {"strips": 3.0}, "strips = 3.0: must be a whole number"),
        (FLAT, {"strips": True}, "strips = True: must be a whole number"),
        (FLAT, {"strips": "10"}, "strips = '10': must be a whole number"),
        (FLAT, {"strips": None}, "strips = None: must be a whole number"),
        (FLAT, {"pitch_mm": 0}, "pitch_mm = 0.0: must be above 0"),
        (FLAT, {"pitch_mm": "5"}, "pitch_mm = '5': must be a number"),
        (FLAT, {"pitch_mm": None}, "pitch_mm = None: must be a number"),
        (FLAT, {"pitch_mm": [5.0]}, "pitch_mm = [5.0]: must be a number"),
        (FLAT, {"pitch_mm": False}, "pitch_mm = False: must be a number"),
        (FLAT, {"pitch_mm": float("nan")}, "pitch_mm = nan: must be finite"),
        (FLAT, {"pitch_mm": 10**400}, "pitch_mm: the number is too large"),
        (FLAT, {"length_mm": -1.5}, "length_mm = -1.5: must be above 0"),
        (FLAT, {"length_mm": float("inf")}, "length_mm = inf: must be finite"),
        (FLAT, {"strip_width_mm": 0}, "strip_width_mm = 0.0: must be above 0"),
        (FLAT, {"strip_width_mm": 5.1}, "strip_width_mm = 5.1: must not exceed pitch_mm = 5.0"),
        (FLAT, {"radius_mm": 9.0}, "radius_mm does not belong to a crs-crs sensor, only to: cyl-crs-m"),
        (METAL, {"radius_mm": 9.0}, "radius_mm does not belong to a crs-m sensor, only to: cyl-crs-m"),
        (TUBE, {"radius_mm": None}, "radius_mm is missing: a cyl-crs-m sensor needs it"),
        (TUBE, {"radius_mm": -9}, "radius_mm = -9.0: must be above 0"),
        (TUBE, {"radius_mm": 7.9}, "radius_mm = 7.9: 10 strips of pitch_mm = 5 do not fit round 49.6372 mm; "
         "that is pitch_mm = 4.9637 at most"),
        (FLAT, {"resistivity_ratio": 0.0}, "resistivity_ratio = 0.0: must be above 0"),
        (METAL, {"resistivity_ratio": 2}, "resistivity_ratio does not belong to a crs-m sensor, only to: {}"),
        (FLAT, {"contact_lambda_mm": -0.1}, "contact_lambda_mm = -0.1: must be 0 (ideal) or more"),
        (FLAT, {"contact_lambda_mm": 1e-320}, "contact_lambda_mm = 1e-320: nothing is so short: 0 is ideal contact"),
        (FLAT, {"contact_lambda_mm": 1e12},
         "contact_lambda_mm = 1000000000000.0: must not exceed length_mm = 100.0; both are millimetres"),
        (FLAT, {"vref_volt": 0.0}, "vref_volt = 0.0: must be above 0"),
        (FLAT, {"adc_bits": 0}, "adc_bits = 0: must be 1 to 32"),
        (FLAT, {"adc_bits": 33}, "adc_bits = 33: must be 1 to 32"),
        (FLAT, {"adc_bits": 12.5}, "adc_bits = 12.5: must be a whole number"),
        (FLAT, {"rest_volt": 0.1}, "rest_volt is set and touch_volt is not: give both or neither"),
        (FLAT, {"touch_volt": 0.1}, "touch_volt is set and rest_volt is not: give both or neither"),
        (FLAT, {"rest_volt": 5.1, "touch_volt": 0.1}, "rest_volt = 5.1: must be 0 to vref_volt"),
        (FLAT, {"rest_volt": 0.0, "touch_volt": 0.0}, "touch_volt = 0.0: must be above 0"),
        (FLAT, {"pitch_mm": 1e-320}, f"pitch_mm = {1e-320}: must be 1e-09 to 1e+09"),
        (FLAT, {"length_mm": 1e300}, f"length_mm = {1e300}: must be 1e-09 to 1e+09"),
        (FLAT, {"rest_volt": 0.0, "touch_volt": 50.0}, "touch_volt = 50.0: no reading is so far from rest_volt = 0.0, "
         "so nothing would count as touched; both are volts"),
        (FLAT, {"strip_base": 2}, "strip_base = 2: must be 0 or 1"),
        (FLAT, {"format": 2}, "format = 2: this tacstrip reads format 1"),
    ],
)  # fmt: skip
def test_impossible_values(base: dict[str, Any], change: dict[str, Any], message: str) -> None:
    owners = ", ".join(c.name for c in CONSTRUCTIONS.values() if "resistivity_ratio" in c.keys)
    with pytest.raises(SpecError) as caught:
        Sensor(**base | change)
    text = message.replace("{constructions}", ", ".join(CONSTRUCTIONS)).replace("{}", owners)
    assert str(caught.value) == text


def test_a_tube_may_be_covered_to_the_last_bit() -> None:
    strips = 7
    radius = 0.1 * strips / (2.0 * np.pi)
    assert Sensor(construction="cyl-crs-m", strips=strips, pitch_mm=0.1, length_mm=1.0, radius_mm=radius)


# Broken files.


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("strips = 10\n", ""), f"key 'strips' is missing; a spec needs: {NEEDED}"),
        (("format = 1\n", ""), f"key 'format' is missing; a spec needs: {NEEDED}"),
        (("pitch_mm", "pitch"), f"unknown key 'pitch'; the keys are: {ALL_KEYS}"),
        (("format = 1", "format = 1\n[more]"), f"unknown key 'more'; the keys are: {ALL_KEYS}"),
        (("5.0", '"5.0"'), "pitch_mm = '5.0': must be a number"),
        (("5.0", "true"), "pitch_mm = True: must be a number"),
        (("5.0", "nan"), "pitch_mm = nan: must be finite"),
        (("5.0", "-inf"), "pitch_mm = -inf: must be finite"),
        (("5.0", "9" * 400), "pitch_mm: the number is too large"),
        (("= 10\n", "= 10.5\n"), "strips = 10.5: must be a whole number"),
        (("= 10\n", "= 2000-01-01\n"), "strips = datetime.date(2000, 1, 1): must be a whole number"),
        (('"crs-crs"', "1"), f"construction 1 does not exist; choose one of: {', '.join(CONSTRUCTIONS)}"),
        (('"crs-crs"', '"cyl-crs-m"'), "radius_mm is missing: a cyl-crs-m sensor needs it"),
        (("5.0", "-5.0"), "pitch_mm = -5.0: must be above 0"),
    ],
)
def test_wrong_keys_and_values_in_a_file(tmp_path: Path, change: tuple[str, str], message: str) -> None:
    assert GOOD.count(change[0]) == 1
    assert message_of(tmp_path / "sensor.toml", GOOD.replace(*change)) == message


@pytest.mark.parametrize(
    ("content", "why"),
    [
        ("strips 10", "Expected '=' after a key in a key/value pair"),
        ("strips = 1\nstrips = 2\n", "Cannot overwrite a value"),
        (b"\xff\xfe\x00\x01", "codec can't decode byte 0xff in position 0"),
        (b"PK\x03\x04 binary", "Illegal|Expected|Invalid"),
        ("strips = " + "9" * 5000, "Exceeds the limit"),
        ("strips = " + "[" * 5000, "recursion|nested"),
    ],
    ids=["no value", "twice", "not utf-8", "binary", "long number", "deep"],
)
def test_files_that_are_not_toml(tmp_path: Path, content: str | bytes, why: str) -> None:
    text = message_of(tmp_path / "sensor.toml", content)
    assert re.fullmatch(rf"not a readable TOML spec \(.*({why}).*\)\. See `tacstrip init`", text), text


def test_a_huge_whole_number_is_refused(tmp_path: Path) -> None:
    text = message_of(tmp_path / "sensor.toml", GOOD.replace("= 10\n", f"= {'9' * 400}\n"))
    assert text == "strips: the number is too large"
    too_long_to_print = GOOD.replace("= 10\n", f"= 0x{'F' * 5000}\n")
    assert message_of(tmp_path / "sensor.toml", too_long_to_print) == "strips: the number is too large"


def test_a_missing_file_lists_the_shipped_specs() -> None:
    with pytest.raises(SpecError) as caught:
        Sensor.load("no/such.toml")
    assert str(caught.value) == (
        "no/such.toml: no such file. Write one with `tacstrip init`, or name a shipped spec: "
        "fingertip, forearm, layered-crs-crs, prototype-crs-crs, prototype-crs-m, prototype-cyl-crs-m, "
        "simulated-crs-crs, simulated-crs-m"
    )


@pytest.mark.parametrize("path", [".", "a" * 300, "a\0b"], ids=["folder", "long name", "null byte"])
def test_paths_that_cannot_be_files(path: str) -> None:
    with pytest.raises(SpecError, match="not a readable TOML spec"):
        Sensor.load(path)


# Noise in, SpecError out.

VALUES = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.integers(0, 20),
    st.floats(),
    st.sampled_from(sorted(CONSTRUCTIONS)),
    texts(),
    st.lists(st.integers(), max_size=2),
    st.dictionaries(texts(max_size=3), st.integers(), max_size=2),
)


@settings(FIXED, max_examples=100)
@given(st.dictionaries(st.sampled_from(sorted(KEYS)) | texts(), VALUES))
def test_no_dictionary_brings_another_error(raw: dict[str, Any]) -> None:
    try:
        sensor = Sensor.from_dict({"format": 1, "construction": "crs-crs", "strips": 3} | raw)
    except SpecError:
        return
    assert Sensor.from_dict(tomllib.loads(sensor.to_toml())) == sensor


@pytest.fixture(scope="module")
def scratch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fuzz") / "sensor.toml"


LITERALS = st.one_of(
    st.integers().map(str),
    st.floats().map(repr),
    st.sampled_from(
        ['"crs-crs"', '"crs-m"', "true", "[1]", "{a = 1}", "1979-05-27", "nan", "0x_", "''", "1e9999"]
    ),
    texts(max_size=5),
)
LINES = st.builds("{} = {}".format, st.sampled_from(sorted(KEYS)) | texts(max_size=5), LITERALS)


@settings(FIXED, max_examples=50)
@given(
    st.one_of(
        st.binary(),
        st.lists(LINES).map(lambda lines: "\n".join(lines).encode()),
        st.lists(LINES, max_size=3).map(lambda lines: (GOOD + "\n".join(lines)).encode()),
        st.builds(lambda cut: GOOD.encode()[:cut], st.integers(0, len(GOOD))),
    )
)
def test_no_file_brings_another_error(scratch: Path, content: bytes) -> None:
    scratch.write_bytes(content)
    try:
        sensor = Sensor.load(scratch)
    except SpecError as error:
        said = str(error)
    else:
        said = f"{scratch}: "
        assert Sensor.from_dict(tomllib.loads(sensor.to_toml())) == sensor
    assert said.startswith(f"{scratch}: ")
