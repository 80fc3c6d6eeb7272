"""construction = "crs-crp" from spec to shape: simulate, files, Profile Reconstruction, command line."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import tacstrip as ts
from studies.crp_spans import own_electrodes
from tacstrip.cli import cli
from tacstrip.network import Imperfections
from tacstrip.network.crp.inversion import invert

SHEET = ts.Sensor(
    construction="crs-crp", strips=20, pitch_mm=5, length_mm=100, resistivity_ratio=100, contact_lambda_mm=2
)
HEXAGON = ts.Contact.polygon([(12, 40), (30, 15), (70, 12), (88, 45), (60, 85), (25, 75)])


def test_a_scan_is_what_the_network_reads() -> None:
    scan = ts.simulate(SHEET, HEXAGON, time_s=0.5)
    kh, kl = own_electrodes(SHEET, *ts.footprint(SHEET, HEXAGON))
    np.testing.assert_allclose(scan["kh"], kh, atol=1e-12)
    np.testing.assert_allclose(scan["kl"], kl, atol=1e-12)
    assert scan.time_s == 0.5
    assert scan.electrodes is None


def test_all_electrodes_hold_the_strips_own_two() -> None:
    own, whole = ts.simulate(SHEET, HEXAGON), ts.simulate(SHEET, HEXAGON, electrodes="all")
    assert whole.electrodes is not None
    assert whole.electrodes.shape == (20, 40)
    np.testing.assert_array_equal(whole["kh"], own["kh"])
    np.testing.assert_array_equal(whole["kl"], own["kl"])


def test_a_contact_between_strips_reads_nothing() -> None:
    between = ts.Contact.polygon([(5.1, 10), (6.9, 10), (6, 20)])
    scan = ts.simulate(SHEET, between)
    assert not scan.touched.any()
    assert ts.profile_reconstruction(scan, SHEET).status == "no contact"


@pytest.mark.parametrize("electrodes", ["own", "all"])
def test_the_profile_comes_back(electrodes: str) -> None:
    scan = ts.simulate(SHEET, HEXAGON, electrodes=electrodes)  # type: ignore[arg-type]
    (found,) = ts.profile_reconstruction(scan, SHEET).objects
    l, u = ts.footprint(SHEET, HEXAGON)
    assert found.profile is not None
    assert found.status == "ok"
    long = (u - l)[found.strips] >= 5.0
    np.testing.assert_allclose(found.profile[1][long], l[found.strips][long], atol=1e-7)
    np.testing.assert_allclose(found.profile[2][long], u[found.strips][long], atol=1e-7)
    assert set(found.strip_status) <= {"ok", "short contact"}
    assert (np.array(found.strip_status) == "ok").tolist() == long.tolist()


def test_the_covariance_of_vertices_is_that_of_the_inverted_ends() -> None:
    """Which is the spread of many scans: tests/network/test_crp.py."""
    sheet = replace(SHEET, contact_lambda_mm=5.0)  # two columns a pitch, 100 rows: the quickest
    noise = ts.Noise(positional=0.001)
    band = ts.Contact.polygon([(10, 20), (60, 30), (60, 70), (10, 50)])
    scan = ts.simulate(sheet, band, noise, rng=1)
    (found,) = ts.profile_reconstruction(scan, sheet, noise).objects
    inverted = invert(sheet, scan["kh"], scan["kl"], sigma=0.001 / np.sqrt(3.0))
    assert found.covariance is not None
    assert np.all(np.diag(found.covariance)[0::2] == 0.0)
    ends = np.concatenate([inverted.l, inverted.u])
    order = [int(np.nanargmin(np.abs(ends - y))) for y in found.vertices[:, 1]]
    np.testing.assert_allclose(ends[order], found.vertices[:, 1], rtol=1e-9)
    np.testing.assert_allclose(
        found.covariance[1::2, 1::2], inverted.covariance[np.ix_(order, order)], rtol=1e-9
    )


def test_short_contacts_have_a_status() -> None:
    thin = ts.Contact.polygon([(10, 50), (90, 52), (90, 55), (10, 53)])
    (found,) = ts.profile_reconstruction(ts.simulate(SHEET, thin), SHEET).objects
    assert found.status == "short contact"
    assert set(found.strip_status) == {"short contact"}
    assert "5 %" in found.advice


def test_what_needs_a_closed_form_is_refused() -> None:
    scan = ts.simulate(SHEET, HEXAGON)
    for call in (
        lambda: ts.vertex_reconstruction(scan, SHEET),
        lambda: ts.signatures(SHEET, *ts.footprint(SHEET, HEXAGON)),
        lambda: ts.simulate(SHEET, HEXAGON, model="closed"),
        lambda: ts.simulate(SHEET, HEXAGON, imperfections=Imperfections()),
    ):
        with pytest.raises(ts.OptionError, match="crs-crp"):
            call()


def test_other_constructions_have_no_sheet_electrodes() -> None:
    rubber = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5, length_mm=100)
    with pytest.raises(ts.OptionError, match="no sheet electrodes"):
        ts.simulate(rubber, HEXAGON, electrodes="all")
    with pytest.raises(ts.OptionError, match="convex and wiring"):
        ts.profile_reconstruction(ts.simulate(rubber, HEXAGON), rubber, convex=True)


def test_a_spec_without_lambda_is_refused() -> None:
    with pytest.raises(ts.SpecError, match="contact_lambda_mm is missing"):
        ts.Sensor(construction="crs-crp", strips=20, pitch_mm=5, length_mm=100)


@pytest.mark.parametrize(
    ("electrodes", "message"),
    [
        (np.zeros((3, 5)), "electrodes have shape (3, 5)"),
        (np.full((3, 6), 1.5), "kh of strip 0 is 1.5"),
        (np.where(np.arange(18).reshape(3, 6) == 1, np.nan, 0.5), "electrode 1 read nan while strip 0"),
    ],
)
def test_electrodes_that_cannot_be(electrodes: np.ndarray, message: str) -> None:
    with pytest.raises(ts.ReadingError) as caught:
        ts.Scan.of_electrodes(electrodes)
    assert str(caught.value).startswith(message)


# Files and the command line.


@pytest.mark.parametrize("electrodes", ["own", "all"])
@pytest.mark.parametrize("base", [0, 1])
def test_readings_come_back_from_a_file(tmp_path: Path, electrodes: str, base: int) -> None:
    sensor = ts.Sensor.from_dict({**_spec(), "strip_base": base})
    scan = ts.simulate(sensor, HEXAGON, electrodes=electrodes)  # type: ignore[arg-type]
    ts.write_readings(tmp_path / "r.csv", sensor, [scan, scan])
    again = ts.read_readings(tmp_path / "r.csv", sensor)
    assert len(again) == 2
    np.testing.assert_allclose(again[1]["kh"], scan["kh"], atol=1e-9)
    assert (again[1].electrodes is None) == (scan.electrodes is None)
    if scan.electrodes is not None:
        assert again[1].electrodes is not None
        np.testing.assert_allclose(again[1].electrodes, scan.electrodes, atol=1e-9)


def test_a_missing_electrode_is_named(tmp_path: Path) -> None:
    scan = ts.simulate(SHEET, HEXAGON, electrodes="all")
    file = tmp_path / "r.csv"
    ts.write_readings(file, SHEET, [scan])
    file.write_text(file.read_text().replace("v_h_3,", "other,"))
    with pytest.raises(ts.ReadingError, match=r"column 'v_h_3' is missing: give all 40 electrodes"):
        ts.read_readings(file, SHEET)


def _words(line: str) -> list[str]:
    return line.split()


def _spec() -> dict[str, object]:
    return {
        "format": 1,
        "construction": "crs-crp",
        "strips": 20,
        "pitch_mm": 5,
        "length_mm": 100,
        "resistivity_ratio": 100,
        "contact_lambda_mm": 2,
    }


def test_from_init_to_shape(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("object.wkt").write_text(HEXAGON.shapes[0].wkt)
    run = CliRunner().invoke
    made = run(
        cli, _words("init s.toml --construction crs-crp --strips 20 --pitch 5 --length 100 --lambda 5")
    )
    assert made.exit_code == 0
    assert ts.Sensor.load("s.toml") == replace(SHEET, contact_lambda_mm=5.0)  # the quickest
    assert (
        run(
            cli,
            [
                "simulate",
                "s.toml",
                "object.wkt",
                "-o",
                "r.csv",
                "--electrodes",
                "all",
                "--quantisation",
                "0.0005",
            ],
        ).exit_code
        == 0
    )
    done = run(cli, _words("reconstruct s.toml r.csv -o s.json --plot p.png --truth object.wkt --convex"))
    assert done.exit_code == 0, done.output
    (feature,) = json.loads(Path("s.json").read_text())["features"]
    assert feature["properties"]["method"] == "profile"
    assert abs(feature["properties"]["area_mm2"] / HEXAGON.shapes[0].area - 1.0) < 0.2
    assert Path("p.png").stat().st_size > 10_000
    assert run(cli, ["spice", "s.toml", "object.wkt", "-o", "d.cir", "--cells", "10"]).exit_code == 0
    assert "print vh_5" in Path("d.cir").read_text()


def test_init_guesses_lambda_and_says_so(tmp_path: Path) -> None:
    file = tmp_path / "s.toml"
    made = CliRunner().invoke(cli, ["init", str(file), "--construction", "crs-crp"])
    assert made.exit_code == 0
    assert "a guess" in made.output
    sensor = ts.Sensor.load(file)
    assert sensor.contact_lambda_mm == pytest.approx(0.01 * sensor.length_mm)
