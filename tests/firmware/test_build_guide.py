"""The build guide's rubber: resistivity, dimensions and resistance agree, and the electronics can read it."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "guide" / "build.md").read_text(encoding="utf-8")
SCIENCE = (ROOT / "docs" / "science" / "electronics.md").read_text(encoding="utf-8")


def _tool() -> ModuleType:
    spec = importlib.util.spec_from_file_location("strip_resistance", ROOT / "tools" / "strip_resistance.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


TOOL = _tool()


def test_the_pages_table_is_the_tools() -> None:
    lines = re.findall(r"^\| [\d.]+ \([\d.]+\) \|.*\|$", SCIENCE, re.MULTILINE)
    assert lines == [f"| {' | '.join(row)} |" for row in TOOL.rows()]


def test_the_guides_short_table_says_what_can_be_read() -> None:
    short = re.findall(r"^\| [\d.]+ \([\d.]+\) \| [\d.]+ kΩ \| (\w+).* \| (\w+).* \|$", PAGE, re.MULTILINE)
    ohms = [1e3 * float(k) for k in re.findall(r"^\| [\d.]+ \([\d.]+\) \| ([\d.]+) kΩ", PAGE, re.MULTILINE)]
    assert len(short) == len(ohms) == 6
    for ohm, said in zip(ohms, short, strict=True):
        for kind, word in zip(("crs-crs", "crs-m"), said, strict=True):
            assert (word == "no") == TOOL.verdict(kind, ohm).startswith("no")


def test_the_rubber_that_the_page_asks_for_makes_the_strips_that_it_asks_for() -> None:
    (part,) = re.findall(
        r"sheet of carbon-filled silicone rubber, ([\d.]+) mm, ([\d.]+) to ([\d.]+) Ω m", PAGE
    )
    (cut,) = re.findall(r"Cut ten strips, (\d+) mm wide .* and (\d+) mm of each is free: L", PAGE, re.DOTALL)
    thick, low, high = map(float, part)
    width, length = map(float, cut)
    assert (thick, width, length) == (TOOL.THICK_MM, TOOL.WIDTH_MM, TOOL.LENGTH_MM)
    (asked,) = re.findall(
        r"should have (\d+) to (\d+) kΩ from clamp to clamp on CRS-CRS, (\d+) to (\d+) on CRS-M", PAGE
    )
    crs_low, crs_high, metal_low, metal_high = (1e3 * float(kilo) for kilo in asked)
    for resistivity in (low, high):
        assert crs_low <= TOOL.strip_ohm(resistivity) <= crs_high
    assert TOOL.largest_ohm("crs-crs") == pytest.approx(crs_high, rel=0.1)
    assert TOOL.largest_ohm("crs-m") == pytest.approx(metal_high, rel=0.1)
    assert TOOL.switch_error(metal_low) < 0.08
    assert TOOL.STRIPS * TOOL.VREF_VOLT / crs_low <= 0.1  # A, of the 0.5 that USB gives


def test_a_shorted_strip_draws_no_more_than_a_switch_bears_and_the_page_says_how_much() -> None:
    (found,) = re.findall(r"switches, which may carry (\d+); with the 100 Ω it draws (\d+) mA", SCIENCE)
    bears, shown = map(float, found)
    assert TOOL.short_ma("crs-m") == pytest.approx(shown, abs=0.5)
    assert shown < bears
    assert TOOL.SERIES_OHM == 100.0


def test_strips_of_forty_kilohm_cannot_be_read() -> None:
    assert TOOL.verdict("crs-crs", 40e3) == "no: touch is missed"
    assert TOOL.verdict("crs-crs", 25e3).endswith("codes unsettled")
    assert TOOL.verdict("crs-m", 40e3) == "yes"
