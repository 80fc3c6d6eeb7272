"""How common phantoms are."""

from __future__ import annotations

from functools import partial
from typing import Any

import pytest

from studies.phantoms import figure_phantoms, phantoms_over_fill
from tacstrip.plot.theme import save


def test_the_figure_has_named_axes(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("studies.phantoms.phantoms_over_fill", partial(phantoms_over_fill, patterns=2))
    figure = figure_phantoms()
    assert save(figure, tmp_path / "figure.png").stat().st_size > 8_000
    assert all(axes.get_xlabel() and axes.get_ylabel() for axes in figure.axes)


def test_phantoms_are_few_below_one_in_n_and_nearly_everywhere_above() -> None:
    n = 16
    below, above = phantoms_over_fill(n, [0.25 / n, 4.0 / n], patterns=20)
    assert below < 0.01
    assert above > 0.9
    assert phantoms_over_fill(n, [0.1], patterns=3)[0] == phantoms_over_fill(n, [0.1], patterns=3)[0]


def test_few_phantoms_come_from_paths_of_three() -> None:
    """At a low fill p the share is (n - 1)^2 p^3: each path of figure 2.4, weighed by its probability."""
    n, p = 12, 0.02
    share = phantoms_over_fill(n, [p], patterns=600)[0]
    assert share == pytest.approx((n - 1) ** 2 * p**3, rel=0.35)
