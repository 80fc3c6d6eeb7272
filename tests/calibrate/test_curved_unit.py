"""A fingertip is calibrated as a flat sensor is: its constants are electrical."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.calibrate.plan import plan
from tacstrip.calibrate.residuals import residuals

TIP = ts.Sensor.load("fingertip")


def test_rings_round_a_fingertip_calibrate_it() -> None:
    random = np.random.default_rng(4)
    unit = replace(TIP, resistivity_ratio=1.2, contact_lambda_mm=0.3)
    offset, gain = random.normal(0.0, 0.01, (2, 16)), 1.0 + random.normal(0.0, 0.01, (2, 16))

    def runs(places: np.ndarray, noise: float) -> ts.Runs:
        l, w = (np.repeat(v[:, None], 16, axis=1) for v in places.T)
        ideal = ts.signatures(unit, l, l + w)
        raw = {
            name: gain[i] * ideal[name] + offset[i] + noise * random.standard_normal(l.shape)
            for i, name in enumerate(("kh", "kl"))
        }
        return ts.Runs(l, w, raw, line=np.arange(2, 2 + l.size).reshape(l.shape), rest={})

    made = plan(TIP, 0.5, ts.Noise(positional=0.002))
    places = np.array([(l, w) for l, w, times in made.contacts for _ in range(times)])
    done = ts.calibrate_unit(TIP, runs(places, 0.001))
    assert done.status == "ok", done.advice
    others = runs(np.stack([random.uniform(0.5, 6.0, 30), random.uniform(0.5, 6.0, 30)], axis=1), 0.0)
    for before, after in zip(
        residuals(TIP, others).values(), residuals(done.sensor, others).values(), strict=True
    ):
        assert np.quantile(np.abs(before), 0.95) > 0.02
        assert np.quantile(np.abs(after), 0.95) < 0.002
    assert done.sensor.resistivity_ratio == pytest.approx(1.2, rel=0.03)
    assert done.sensor.contact_lambda_mm == pytest.approx(0.3, abs=0.05)


def test_of_rings_along_parallels_no_plan_is_made() -> None:
    surface = {"kind": "sphere", "radius_mm": 10.0, "along": "parallels", "around_deg": 350.0}
    rings = ts.Sensor.from_dict({"format": 1, "construction": "crs-crs", "strips": 16, "surface": surface})
    with pytest.raises(ts.OptionError, match="no contact lies alike on all of them"):
        plan(rings, 0.5, ts.Noise(positional=0.002))
