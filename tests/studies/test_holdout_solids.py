"""The hold-out's own skin, solids and strips are those of the package where strips are lines."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import tacstrip as ts
from studies.holdout import solids
from tacstrip.contact.press.patch import patch_at


@pytest.mark.parametrize("kind", solids.KINDS)
def test_two_ways_to_press_agree(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(solids, "WIDTH_MM", 1e-6)
    monkeypatch.setattr(solids, "LINES", 1)
    pressed = solids.draw(kind, 0, np.random.default_rng(5))
    family = solids.FAMILIES[kind]
    size = (pressed.radius,) if kind in ("cylinder", "sphere") else family.size
    tip = ts.Sensor.load("fingertip")
    patch = patch_at(tip, replace(family, position_mm=pressed.at, axes=pressed.axes, size=size))
    low, high = solids.ends(pressed)
    np.testing.assert_allclose(low, patch.l, atol=2.0 * solids.LENGTH / solids.CELLS)
    np.testing.assert_allclose(high, patch.u, atol=2.0 * solids.LENGTH / solids.CELLS)
    area, force = solids.load(pressed)
    assert patch.area_mm2 == pytest.approx(area, rel=5e-3)
    assert patch.force_n == pytest.approx(force, rel=5e-3)
    read = solids.UNIT.read(*(solids.share(v) * solids.LENGTH for v in (patch.l, patch.u)))
    np.testing.assert_allclose(read, [ts.simulate(tip, patch)[name] for name in ("kh", "kl")], atol=1e-12)
