"""What a contributed unit's folder must hold (data-contributed/README.md)."""

from __future__ import annotations

from pathlib import Path

import pytest

import tacstrip as ts
from recordings import make, sensor
from tacstrip.stream.codes import decode
from tacstrip.stream.replay import open_source

FOLDER = Path(__file__).parents[2] / "data-contributed"
TOLD = ("measured by", "date", "material", "wiring", "instrument", "licence")
LICENCES = ("CC-BY 4.0", "CC0")
SMALL = 20_000_000  # bytes a file; larger ones belong elsewhere, with a link


def check(unit: Path) -> int:
    """Hold a unit's folder to the contract; return how many scans it has."""
    readme = (unit / "README.md").read_text(encoding="utf-8")
    for word in TOLD:
        assert f"\n- {word}: " in readme.lower(), f"{unit.name}/README.md does not say: {word}"
    assert any(name in readme for name in LICENCES), f"{unit.name}/README.md names none of {LICENCES}"
    spec = ts.Sensor.load(unit / "sensor.toml")
    recordings = [f for f in sorted(unit.iterdir()) if f.suffix in (".csv", ".mcap")]
    assert recordings, f"{unit.name} has no recording"
    scans = 0
    for file in recordings:
        assert file.stat().st_size < SMALL, f"{file.name} is larger than {SMALL} bytes"
        source = open_source(file, spec)
        for raw in source:
            decode(raw, source.sensor).check(spec)
            scans += 1
    names = {f.stem for f in recordings}
    for truth in (f for f in unit.iterdir() if f.suffix in (".wkt", ".geojson")):
        assert truth.stem in names, f"{truth.name} is the truth of no recording"
        ts.footprint(spec, ts.read_contact(truth))
    return scans


UNITS = [f for f in sorted(FOLDER.iterdir()) if f.is_dir()]


@pytest.mark.parametrize("unit", UNITS, ids=lambda f: f.name)
def test_contributed_units_keep_the_contract(unit: Path) -> None:
    assert check(unit) > 0


@pytest.fixture
def unit(tmp_path: Path) -> Path:
    """Return a folder that keeps the contract."""
    sensor().save(tmp_path / "sensor.toml")
    make(tmp_path / "kite.mcap", sensor(), 5, None)
    (tmp_path / "kite.wkt").write_text("POLYGON ((5 25, 15 40, 25 25, 15 55, 5 25))")
    told = dict.fromkeys(TOLD, "something") | {"licence": "CC0"}
    (tmp_path / "README.md").write_text(
        "# My sensor\n\n" + "".join(f"- {k.capitalize()}: {v}\n" for k, v in told.items())
    )
    return tmp_path


def test_a_good_folder_passes(unit: Path) -> None:
    assert check(unit) == 5


def test_the_page_asks_for_what_is_checked() -> None:
    text = (FOLDER / "README.md").read_text(encoding="utf-8").lower()
    for word in (*TOLD, *(name.lower() for name in LICENCES), "sensor.toml", ".mcap"):
        assert word in text


@pytest.mark.parametrize(
    "fault", ["no wiring", "no licence", "no recording", "lone truth", "other strips", "cut code"]
)
def test_a_bad_folder_does_not(unit: Path, fault: str) -> None:
    readme = unit / "README.md"
    match fault:
        case "no wiring":
            readme.write_text(readme.read_text().replace("- Wiring", "- Wires"))
        case "no licence":
            readme.write_text(readme.read_text().replace("CC0", "all rights reserved"))
        case "no recording":
            (unit / "kite.mcap").unlink()
        case "lone truth":
            (unit / "kite.wkt").rename(unit / "other.wkt")
        case "other strips":
            sensor(strips=29).save(unit / "sensor.toml")
        case _:
            (unit / "more.csv").write_text("scan,time_s,strip,code_h\n0,0,0,4\n")
    with pytest.raises((AssertionError, ts.TacstripError)):
        check(unit)
