"""What one strip does with time, against one rigid outline under all."""

from __future__ import annotations

import numpy as np
import pytest

import tacstrip as ts
from studies.checkup import exercise
from studies.faults import Defect, faulty_log
from tacstrip.diagnose.neighbour_prediction import places, working_copy
from tacstrip.diagnose.rigid_contact import RigidContact
from tacstrip.diagnose.shorts import tied_under_outline

_SIGMA = 0.002 / np.sqrt(3.0)
_STRIP, _CHANGE = 4, 0.012  # over Vref, from start to end


def test_a_drift_stands_out_of_what_an_outline_its_places_and_constant_errors_explain() -> None:
    unit = ts.Sensor(construction="crs-crs", strips=10, pitch_mm=5.0, length_mm=120.0)
    random = np.random.default_rng(3)
    offsets = random.uniform(-0.01, 0.01, unit.strips)
    contacts = exercise(unit, random, 300)
    drifts = [Defect("drift", _STRIP, _CHANGE)]
    log = faulty_log(unit, contacts, drifts, ts.Noise(positional=0.002), 3, 20.0, offsets)
    work = places(working_copy(log, _SIGMA))
    half = RigidContact.fit(work)
    assert half is not None
    assert half.moves()
    model = half.joined()
    assert model.sigma < 2.0 * _SIGMA
    line = np.sqrt(12.0) * (work.time_s / log.time_s[-1] - 0.5)
    found = model.explain(line[model.place, None, None], trusted=_STRIP)
    power = found.power_of_groups(1).ravel()
    gain = found.score**2 / power / model.sigma**2
    assert int(np.argmax(gain)) == _STRIP
    assert gain[_STRIP] > 2.0 * np.sort(gain)[-2]
    assert np.sqrt(12.0) * found.score[_STRIP] / power[_STRIP] == pytest.approx(_CHANGE, rel=0.5)


def test_tied_sensing_strips_stand_out_of_what_an_outline_expects() -> None:
    unit = ts.Sensor(construction="crs-crs", strips=10, pitch_mm=5.0, length_mm=120.0)
    contacts = exercise(unit, np.random.default_rng(3), 300)
    tied = [Defect("short", _STRIP, 0.5, "kh")]
    log = faulty_log(unit, contacts, tied, ts.Noise(positional=0.002), 3, 20.0)
    found = tied_under_outline(places(working_copy(log, _SIGMA)))
    assert found is not None
    assert (found.finding.strips, found.doubtful) == ((_STRIP, _STRIP + 1), False)


def test_a_contact_that_is_held_shows_no_outline() -> None:
    unit = ts.Sensor(construction="crs-crs", strips=10, pitch_mm=5.0, length_mm=120.0)
    shape = ts.Contact.polygon([(0, 0), (24, 2), (22, 30), (3, 26)])
    taps = [shape.placed(x, y) for x, y in ((12, 30), (30, 60), (20, 90), (35, 40)) for _ in range(40)]
    log = faulty_log(unit, taps, (), ts.Noise(positional=0.004), 3, 20.0)
    assert RigidContact.fit(working_copy(log, 2.0 * _SIGMA)) is None
