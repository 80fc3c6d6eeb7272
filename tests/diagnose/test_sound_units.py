"""The doctor on sound units of every sort: each of these recordings had a finding once, and none has one now."""

from __future__ import annotations

import numpy as np
import pytest

from studies.sound_units import recording
from tacstrip.diagnose import Log, diagnose
from tacstrip.diagnose.exchanged import _sign_reversed
from tacstrip.diagnose.neighbour_prediction import places, working_copy
from tacstrip.diagnose.regression import repeats
from tacstrip.diagnose.shorts import _odds_of_flat
from tacstrip.sensor.spec import Sensor


@pytest.mark.parametrize(
    "seed",
    [
        6,  # slow presses: a corner on the ground end of one strip was a dead channel
        10,  # held: so was one scan with a stray
        17,  # over the ground end: strips that read as rest does
        21,  # untouched: a stray was a pair of exchanged wires
        60,  # a bar that is lifted at one height had a Vref of its own
        139,  # a palm over the ground end felt pressure
        143,  # two places in turn, each time a little off: drift
        176,  # taps of three scans were noise
        2107,  # a palm over the ground end of two strips was two open strips
        50028,  # a slanted bar that is lifted at one height had a Vref of its own
        50076,  # noise of few untouched readings was drift
        50080,  # a corner at the far end comes to one strip alone: a loose joint
        50136,  # a pair that is flat for contacts on one side of a bridge, and not on the other, was a short
        50178,  # the same corner, of four strips
        51031,  # taps with strays had a Vref of their own
        51076,  # an offset under contacts of one length was a pair of tied wires
        51083,  # noise beside a rolling bar's rim was an open strip
        72066,  # over the far end, where the neighbours' line runs beyond the rail: a loose joint
        74016,  # so was, at the edge, noise of a strip that rests beside a contact's rim
        80039,  # two places in turn, flat on a pair: a short that hung on one quarter of the recording
        82119,  # three fingers, of which one rests on two strips: both were stuck
        73371,  # at the edge, a strip that reads well wherever its neighbours do not: an open one
    ],
)
def test_no_finding_on_a_sound_unit(seed: int) -> None:
    log, _ = recording(seed)
    assert diagnose(log).findings == ()


def test_a_rim_that_comes_and_goes_at_the_level_of_rest_is_no_loose_joint() -> None:
    assert diagnose(recording(602, "drag")[0]).findings == ()


def test_an_outermost_strip_that_reads_one_level_in_every_visit_is_stuck() -> None:
    """An object of its own might lie still there; it would not come and go with the contact."""
    log, _ = recording(600, "exercise")
    raw = {name: values.copy() for name, values in log.raw.items()}
    for level, values in zip((0.4, 0.6), raw.values(), strict=True):
        values[np.isfinite(values[:, 5]), 5] = level
    found = diagnose(Log.of(log.sensor, log.time_s, raw)).findings
    assert {(f.fault, f.strips) for f in found} == {("stuck", (5,))}


def test_what_flat_pairs_look_like_is_asked_and_not_said() -> None:
    """A round contact is flat on two strips where it is round; few passes cannot tell that from a bridge."""
    report = diagnose(recording(196)[0])
    assert report.healthy
    assert [q.causes for q in report.questions] == [("short",)]


def _pair(follows: float) -> float:
    """Return the odds that strips 3 and 4 of 8 are tied, which follow the slope around by this much."""
    rng, steps = np.random.default_rng(1), np.linspace(0.0, 40.0, 400)
    slope = 0.02 * np.sin(steps * 1.7)[:, None] * (np.arange(8) - 3.5)
    slope[:, [3, 4]] *= follows
    kl = 0.45 + 0.3 * np.sin(steps)[:, None] + slope
    k = {name: v + 0.001 * rng.normal(size=v.shape) for name, v in (("kl", kl), ("kh", kl + 0.1))}
    sensor = Sensor(construction="crs-crs", strips=8, pitch_mm=5.0, length_mm=100.0)
    return _odds_of_flat(places(working_copy(Log.of(sensor, steps, k), 0.001)), 3)


def test_a_tied_pair_is_flat_and_a_sound_one_follows_the_slope() -> None:
    assert _pair(0.0) > 10.0
    assert _pair(1.0) == 0.0


def test_offsets_and_exchanged_wires_are_weighed_where_a_contact_stays() -> None:
    """One difference and one prediction: offsets of some per cent do it too, and then it is asked."""

    def told(difference: float, predicted: float) -> bool | None:
        return _sign_reversed(np.array([difference]), np.array([predicted]), difference, (0.08, 0.03), 0.001)

    assert told(0.05, 0.05) is None
    assert told(-0.03, 0.05) is None
    assert told(-0.042, 0.04) is False
    assert told(-0.1, 0.1) is True


def test_a_movement_that_is_repeated_is_told_from_ways_that_cross() -> None:
    steps = np.linspace(0.0, 40.0, 400)
    to_and_fro = 0.5 + 0.3 * np.sin(steps)
    other = 0.05 * np.sin(1.7 * steps)
    rows = np.arange(len(steps))
    strips = np.arange(8.0)
    assert repeats(to_and_fro[:, None] + 0.01 * strips, rows, 0.001)
    assert not repeats(to_and_fro[:, None] + other[:, None] * strips, rows, 0.001)
