"""The polygon fit on voltages from networks: what holds on real strips, what raises the alarm, and what does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import tacstrip as ts
from studies import estimation_figures
from studies.estimation import SENSOR, UNITS, RealContact, outcome, real_contacts


@pytest.fixture(scope="module")
def contacts() -> list[RealContact]:
    return real_contacts(10, seed=1, wide=False)


def noise(half_width: float) -> ts.Noise:
    return ts.Noise(positional=half_width)


# What the units read


def test_what_each_imperfection_does_to_the_readings() -> None:
    """The network alone is the closed form; unevenness and width cost some tenths of a percent of Vref each."""
    (contact,) = real_contacts(1, seed=4)
    lines = replace(SENSOR, adc_bits=None, strip_width_mm=None)
    ideal = ts.simulate(lines, ts.Contact.polygon(contact.truth))
    for name in ("kh", "kl"):
        off = {
            unit: float(np.sqrt(np.nanmean((read[name] - ideal[name]) ** 2)))
            for unit, read in contact.readings.items()
        }
        assert off["lambda"] < 1e-6
        assert 0.001 < off["uneven"] < 0.01
        assert 0.0003 < off["width"] < 0.01
        assert max(off["uneven"], off["width"]) / 2.0 < off["all"] < off["uneven"] + off["width"]
    assert set(contact.readings) == {readings for readings, *_ in UNITS.values()}


# What the fit makes of them


@pytest.mark.parametrize("half_width", [0.001, 0.005])
@pytest.mark.parametrize("known", [True, False])
def test_with_lambda_known_a_network_is_as_good_as_the_closed_form(
    contacts: list[RealContact], half_width: float, known: bool
) -> None:
    o = outcome(contacts, "lambda", noise(half_width), known)
    assert o.right >= 0.9
    assert 0.75 < o.of_bound < 1.25
    assert o.inside > 0.9
    assert o.doubtful < 0.15


def test_the_bound_of_the_noise_still_pays(contacts: list[RealContact]) -> None:
    o = outcome(contacts, "lambda", noise(0.005), bounded=True)
    assert o.of_bound < 0.8
    assert o.inside > 0.9
    assert o.silent == 0.0
    assert o.empty < 0.1


def test_a_lambda_that_is_unknown_costs_lambda_and_hardly_shows(contacts: list[RealContact]) -> None:
    """The contact shrunk by lambda at both ends is a polygon too, so nothing in the readings contradicts it."""
    o = outcome(contacts, "lambda, given 0", noise(0.002))
    assert 0.5 * SENSOR.contact_lambda_mm < o.rms_mm < 2.0 * SENSOR.contact_lambda_mm
    assert o.inside < 0.2
    assert o.doubtful < 0.6


def test_uneven_strips_raise_the_alarm_where_the_noise_is_known(contacts: list[RealContact]) -> None:
    by_squares = outcome(contacts, "uneven", noise(0.001), draws=1)
    by_bound = outcome(contacts, "uneven", noise(0.001), bounded=True, draws=1)
    assert by_squares.doubtful == 1.0
    assert by_bound.empty == by_bound.doubtful == 1.0
    assert by_squares.silent == by_bound.silent == 0.0


def test_uneven_strips_pass_for_noise_where_it_is_estimated(contacts: list[RealContact]) -> None:
    o = outcome(contacts, "uneven", noise(0.001), known=False)
    assert o.right >= 0.8
    assert o.inside > 0.8
    assert o.rms_mm < 0.005 * SENSOR.length_mm
    assert o.doubtful < 0.3


# Pictures


@pytest.mark.slow
def test_the_fit_beats_the_gradient_rule_and_stays_at_the_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(estimation_figures, "_LEVELS", (0.01,))
    monkeypatch.setattr(estimation_figures, "_DRAWS", 40)
    axes = estimation_figures.noise_figure().axes[0]
    drawn = {line.get_label(): np.asarray(line.get_ydata()) for line in axes.lines}
    bound = next(y for label, y in drawn.items() if str(label).startswith("Cramer"))
    assert np.all(drawn["fit, least squares"] < 1.3 * bound)
    assert np.all(drawn["fit, bound of the noise used"] < bound)
    assert np.all(drawn["V.R., gradient rule"] > 2.0 * bound)


@pytest.mark.parametrize("name", ["estimation_fit", "estimation_bounded"])
def test_pictures_show_regions(name: str) -> None:
    figure = estimation_figures.FIGURES[name]()
    labels = {str(label) for axes in figure.axes for label in axes.get_legend_handles_labels()[1]}
    assert "guaranteed region" in labels
