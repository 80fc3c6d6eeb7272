"""Lines among a log's readings that are none: they count scans, name sensors, or say what changes."""

from __future__ import annotations

from dataclasses import replace

import pytest

import tacstrip as ts
from tacstrip.io.log_import.guess import propose
from tacstrip.io.log_import.questions import Unanswered
from tacstrip.io.log_import.text import of_text

SENSOR = ts.Sensor(
    construction="crs-crs", strips=6, pitch_mm=8.0, length_mm=60.0, vref_volt=5.0, strip_base=1
)
FIRST = "strip 1: nothing\nstrip 2: top 1.97, bottom 1.68\nstrip 3: top 2.90, bottom 1.48\n" + "".join(
    f"strip {n}: nothing\n" for n in (4, 5, 6)
)
LAST = FIRST.replace("1.97", "2.07").replace("2.90", "2.81")
VOID = "".join(f"strip {n}: nothing\n" for n in range(1, 7))


@pytest.mark.parametrize("place", [0, 1, 2])
@pytest.mark.parametrize("word", ["PRESS", "Versuch", "## Toque"])
@pytest.mark.parametrize(
    "void", [VOID, VOID.replace("nothing", "no contact"), VOID.replace("nothing", "-"), ""]
)
def test_a_counted_scan_in_which_nothing_is_touched_keeps_its_place(place: int, word: str, void: str) -> None:
    blocks = [FIRST, LAST]
    blocks.insert(place, void)
    text = "".join(f"{word} {n} (on the pad)\n{block}\n" for n, block in enumerate(blocks, 1))
    found = propose(of_text(text), SENSOR, {"rate_hz": "50", "strip_base": "1"})
    touched = [bool((scan.values > 0.0).any()) for scan in found.scans]
    assert touched == [n != place for n in range(3)] or any("no reading follows" in d for d in found.doubts)
    assert void == "" or len(touched) == 3


@pytest.mark.parametrize("said", ["(t = {} s)", "at {} s", "- {} s", "nach {} s"])
def test_headings_that_count_scans_tell_their_times(said: str) -> None:
    table = "| strip | upper end | lower end |\n|--|--|--|\n| 1 | untouched | untouched |\n| 2 | 1.97 V | 1.68 V |\n"
    text = "".join(
        f"## Press {n} {said.format(t)}\n\n{table}\n" for n, t in enumerate(("0", "1.5", "9.0"), 1)
    )
    found = propose(of_text(text), replace(SENSOR, strips=2))
    assert [scan.time_s for scan in found.scans] == [0.0, 1.5, 9.0]


def test_a_duration_in_such_headings_is_no_time() -> None:
    text = "".join(f"PRESS {n} - 2 s\n{block}\n" for n, block in enumerate((FIRST, LAST), 1))
    with pytest.raises(Unanswered, match="rate_hz"):
        propose(of_text(text), SENSOR)
