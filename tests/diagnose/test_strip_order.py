"""Two strips in each other's places, in recordings too short for the doctor's other signs: asked about, or said."""

from __future__ import annotations

import pytest

from studies.exchanged_strips import exchanged, said, sound_log
from tacstrip.diagnose.doctor import diagnose
from tacstrip.diagnose.exchanged import told_by_slope
from tacstrip.diagnose.neighbour_prediction import places, working_copy
from tacstrip.diagnose.strip_order import compared_orders

SLIDES, HARDLY = 105, 103  # a contact that slides over ten places, and one that changes its strips once


@pytest.mark.parametrize("pair", [(11, 12), (13, 18)])
def test_strips_exchanged_are_asked_about(pair: tuple[int, int]) -> None:
    report = diagnose(exchanged(sound_log(SLIDES)[0], *pair))
    (question,) = report.questions
    assert question.strips == pair
    assert question.causes[0] == "swapped-strips"
    assert not report.findings  # no other fault is made of them


def test_of_sound_strips_nothing_is_asked_and_what_would_go_unnoticed_is_said() -> None:
    log = sound_log(SLIDES)[0]
    report = diagnose(log)
    assert not report.findings
    assert not report.questions
    (reason,) = (text for text in report.unchecked if text.startswith("strips exchanged, of strips"))
    assert "an exchange would go unnoticed" in reason
    assert "11-12" not in reason  # of which an exchange is asked about, see above


def test_an_exchange_that_is_not_seen_is_not_passed_over() -> None:
    assert said(diagnose(exchanged(sound_log(HARDLY)[0], 11, 12)), (11, 12)) == "not checked"


def test_every_two_orders_are_compared_alike_from_both_sides() -> None:
    """What makes an order the better one makes the other one the worse, once the two are exchanged."""
    log = sound_log(SLIDES)[0]
    straight, turned = (
        compared_orders(places(working_copy(one, 0.004))) for one in (log, exchanged(log, 11, 12))
    )
    at = {tuple(pair): n for n, pair in enumerate(straight.pairs.tolist())}[11, 12]
    assert straight.worse[at]
    assert turned.better[at]
    assert turned.gain[at] == pytest.approx(-straight.gain[at])
    assert not straight.better.any()
    assert told_by_slope(places(working_copy(log, 0.004))) == set()
