"""Reconstructions as a table."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.io.geojson import feature_collection
from verbs import run

SENSOR = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0)
CONTACT = ts.Contact.polygon([(22, 18), (70, 34), (62, 72), (30, 66)])
NOISE = ts.Noise(positional=0.005)


def test_a_record_says_what_geojson_says() -> None:
    two = CONTACT.moved(-15.0, 0.0) + ts.Contact.polygon([(72, 20), (92, 40), (76, 70)])
    scans = [ts.simulate(SENSOR, contact, NOISE, rng=1, time_s=0.5) for contact in (CONTACT, two)]
    scans.append(ts.Scan(kh=np.full(20, np.nan), kl=np.full(20, np.nan)))
    results = [ts.fit_polygon(scan, SENSOR, NOISE) for scan in scans]
    records = ts.object_records(results)
    assert [(r["scan"], r["object"]) for r in records] == [(0, 1), (1, 1), (1, 2), (2, None)]
    for record, feature in zip(records, feature_collection(results)["features"], strict=True):
        about = feature["properties"]
        for key in ("time_s", "status", "confidence"):
            assert record[key] == about.get(key)
        assert record["area_mm2"] == pytest.approx(about.get("area_mm2"))
        assert record["area_sigma_mm2"] == pytest.approx(about.get("area_sigma_mm2"))
        centroid = [record["centroid_x_mm"], record["centroid_y_mm"]]
        assert centroid == pytest.approx(about.get("centroid_mm", [None, None]))
    assert records[0]["corners"] == len(results[0].objects[0].vertices)
    assert records[-1]["status"] == "no contact"
    assert records[-1]["area_mm2"] is None


def test_truth_is_the_nearest_polygon_and_what_was_not_found_overlaps_by_0() -> None:
    found = ts.fit_polygon(ts.simulate(SENSOR, CONTACT), SENSOR)
    nothing = ts.fit_polygon(ts.Scan(kh=np.full(20, np.nan), kl=np.full(20, np.nan)), SENSOR)
    far = ts.Contact.polygon([(0, 0), (5, 0), (0, 5)])
    ious = [r["iou"] for r in ts.object_records([found, nothing], far + CONTACT)]
    assert ious == pytest.approx([1.0, 0.0], abs=0.02)
    with pytest.raises(ts.ContactError, match="holds no polygon"):
        ts.object_records([found], ts.Contact.line([(0, 0), (5, 5)]))


def test_a_known_object_has_its_angle() -> None:
    scan = ts.simulate(SENSOR, CONTACT.turned(0.3))
    (record,) = ts.object_records([ts.fit_object(scan, SENSOR, CONTACT, NOISE)])
    assert record["angle_rad"] == pytest.approx(0.3, abs=0.01)
    assert 0.0 < record["angle_sigma_rad"] < 0.1


def test_reconstruct_and_track_write_tables(tmp_path: Path) -> None:
    SENSOR.save(tmp_path / "sensor.toml")
    contact = [CONTACT.moved(0.5 * i, 0.3 * i).turned(0.02 * i) for i in range(6)]
    scans = [ts.simulate(SENSOR, c, NOISE, rng=i, time_s=0.1 * i) for i, c in enumerate(contact)]
    ts.write_readings(tmp_path / "r.csv", SENSOR, scans)
    ring = ", ".join(f"{x} {y}" for x, y in (*CONTACT.vertices, CONTACT.vertices[0]))
    (tmp_path / "c.wkt").write_text(f"POLYGON (({ring}))")
    words = ("sensor.toml", "r.csv", "--positional", 0.005)
    done = run(tmp_path, "reconstruct", *words, "-o", "objects.csv", "--truth", "c.wkt")
    assert done.returncode == 0, done.stderr
    with (tmp_path / "objects.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["scan"] for row in rows] == [str(i) for i in range(6)]
    assert float(rows[0]["iou"]) > float(rows[5]["iou"]) > 0.5
    assert float(rows[3]["time_s"]) == pytest.approx(0.3)
    area = CONTACT.shapes[0].area
    assert abs(float(rows[0]["area_mm2"]) - area) < 4.0 * float(rows[0]["area_sigma_mm2"])

    done = run(tmp_path, "track", *words, "-o", "tracks.csv")
    assert done.returncode == 0, done.stderr
    with (tmp_path / "tracks.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    done = run(tmp_path, "track", *words, "-o", "tracks.geojson")
    (feature,) = json.loads((tmp_path / "tracks.geojson").read_text())["features"]
    poses = feature["properties"]["poses"]
    assert [int(row["scan"]) for row in rows] == [pose["scan"] for pose in poses]
    for row, pose in zip(rows, poses, strict=True):
        assert float(row["angle_rad"]) == pytest.approx(pose["angle_rad"])
        assert float(row["angle_sigma_rad"]) == pytest.approx(pose["sigma"]["angle_rad"])
        assert float(row["centroid_y_mm"]) == pytest.approx(pose["centroid_mm"][1])
    assert rows[0]["status"] == feature["properties"]["status"]
