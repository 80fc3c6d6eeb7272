"""Contacts from files, reconstructions to GeoJSON."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import shapely

import tacstrip as ts

SQUARE = [(10.0, 10.0), (30.0, 10.0), (30.0, 30.0), (10.0, 30.0)]
SENSOR = ts.Sensor(construction="crs-crs", strips=40, pitch_mm=1.0, length_mm=40.0)


def test_read_contact_by_ending(tmp_path: Path) -> None:
    polygon = shapely.Polygon(SQUARE)
    (tmp_path / "a.wkt").write_text(polygon.wkt)
    (tmp_path / "a.GeoJSON").write_text(
        json.dumps({"type": "Feature", "geometry": polygon.__geo_interface__, "properties": {}})
    )
    for name in ("a.wkt", "a.GeoJSON"):
        np.testing.assert_allclose(ts.read_contact(tmp_path / name).vertices, SQUARE)


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("a.shp", b"", r"a contact is a file that ends in .wkt, .geojson, .json"),
        ("a.wkt", b"", "a.wkt: the file is empty"),
        ("a.wkt", b"\x00\xff\xfe", "a.wkt: not a text file"),
        ("a.wkt", b"POLYGON((0 0, 1 1", "a.wkt: not well-known text"),
        (
            "a.geojson",
            b'{"type": "Polygon", "coordinates": [[[0, 0], [1',
            "a.geojson: not JSON: .* Is the file complete",
        ),
        ("a.geojson", b'{"type": "Circle"}', """its "type" is 'Circle'; the types are: Point, """),
        ("a.geojson", b"[1]", "this is a list"),
        ("a.geojson", b"{}", 'it has no "type"'),
        ("a.geojson", b'{"type": "Polygon"}', 'a Polygon needs "coordinates"'),
        (
            "a.geojson",
            b'{"type": "Polygon", "coordinates": [[0, 0]]}',
            r"numbers nested as in \[\[\[20, 30\]",
        ),
        ("a.geojson", b'{"type": "Polygon", "coordinates": [[["0", 0]]]}', "are numbers nested as in"),
        (
            "a.geojson",
            b'{"type": "Polygon", "coordinates": [[[0, 0], [9, 0], [9, 9]]]}',
            "must end with its first point again",
        ),
        ("a.geojson", b'{"type": "Feature", "geometry": null}', "this is null"),
        (
            "a.geojson",
            b'{"type": "FeatureCollection", "features": [{"type": "Point"}]}',
            "must hold Features",
        ),
        ("a.geojson", b'{"type": "Point", "coordinates": ' + 5000 * b"9" + b"}", "not GeoJSON"),
        ("a.wkt", b"POLYGON ((0 0, 9 0, 9 9))", "must end with its first point again. A right one: POLYGON"),
        ("a.wkt", b"LINESTRING (1 1)", "a line needs two points or more"),
        ("a.wkt", b"CIRCLE (0 0)", "begins with 'CIRCLE', and must with one of POINT, LINESTRING"),
        ("a.wkt", b"POLYGON ((0 0, 9 0", "2 brackets open and 0 close, so it is not complete"),
        ("a.wkt", b"POLYGON ((0,0, 9,0, 9,9, 0,0))", "two numbers with a space between"),
        ("a.wkt", b"POLYGON (0 0, 9 0, 9 9, 0 0)", "two pairs of brackets"),
        ("a.wkt", b"POLYGON ((0 0, nan 0, 9 9, 0 0))", "a coordinate that is not a finite number"),
        ("a.wkt", b"POLYGON((0 0, 2 2, 2 0, 0 2, 0 0))", "crosses itself at"),
    ],
)
def test_faults_are_named(tmp_path: Path, name: str, data: bytes, message: str) -> None:
    (tmp_path / name).write_bytes(data)
    with pytest.raises(ts.ContactError, match=message) as caught:
        ts.read_contact(tmp_path / name)
    assert "xception" not in str(caught.value)  # a library's own words


def test_missing_contact(tmp_path: Path) -> None:
    with pytest.raises(ts.ContactError, match="no such file"):
        ts.read_contact(tmp_path / "none.wkt")


def test_geojson_out(tmp_path: Path) -> None:
    corners = [(5.5, 20.0), (20.5, 8.0), (33.5, 22.0), (18.5, 31.0)]
    scan = ts.simulate(SENSOR, ts.Contact.polygon(corners), time_s=1.5)
    good = ts.profile_reconstruction(scan, SENSOR)
    failed = ts.vertex_reconstruction(scan, SENSOR, signature="kh", transitions=[5.5, 33.5])
    empty = ts.profile_reconstruction(ts.Scan(kh=np.full(40, np.nan), kl=np.full(40, np.nan)), SENSOR)
    path = tmp_path / "out.geojson"
    ts.write_geojson(path, [good, failed, empty])
    features = json.loads(path.read_text())["features"]
    assert [f["properties"]["scan"] for f in features] == [0, 1, 2]
    assert [f["properties"]["status"] for f in features] == ["ok", "too few transitions", "no contact"]
    assert [f["properties"]["method"] for f in features] == ["profile", "vertex", "profile"]
    assert features[0]["properties"]["time_s"] == 1.5
    shape = shapely.from_geojson(json.dumps(features[0]["geometry"]))
    assert shape.is_valid
    assert shapely.is_ccw(shape.exterior)
    assert shape.area == pytest.approx(features[0]["properties"]["area_mm2"])
    assert shape.symmetric_difference(shapely.Polygon(corners)).area < 0.02 * shape.area
    assert features[1]["geometry"] is None
    assert features[1]["properties"]["advice"]
    np.testing.assert_allclose(
        ts.Contact.from_geojson(json.dumps(features[0])).vertices, good.objects[0].vertices
    )
