"""The demonstration: the default method leads, and the picture shows all of it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from matplotlib.text import Text

from drawn import check_above, draw
from polygons import DRAWN
from tacstrip.cli import cli
from tacstrip.thesis.demo import FIT, Demo, picture, run, table
from tacstrip.thesis.reproduce import _draw

AFTER = "ok" if DRAWN else "doubtful"  # of the readings after calibration; without the core nothing is drawn


@pytest.fixture(scope="module")
def demo() -> Demo:
    return run()


def test_the_demo_shows_the_default_method_first(demo: Demo) -> None:
    fits = {t.readings: t for t in demo.trials if t.method == FIT}
    assert fits["after"].recovered.status == AFTER
    assert fits["before"].recovered.status == "doubtful"
    errors = {(t.readings, t.method): t.mismatch.ape for t in demo.trials if t.mismatch is not None}
    assert min(errors, key=errors.__getitem__) == ("after", FIT)
    lines = table(demo).splitlines()[2:]
    assert [line.split()[:2] for line in lines].count(["after", "Polygon"]) == 1
    assert len(lines) == len(demo.trials)


def test_nothing_of_the_demo_is_cut_off(demo: Demo) -> None:
    figure = picture(demo)
    draw(figure)
    _, read, key, recovered = figure.axes
    legend = key.get_legend()
    assert legend is not None
    drawn = recovered.get_tightbbox()
    assert drawn is not None
    assert not legend.get_window_extent().overlaps(drawn)
    texts = legend.get_texts()
    shown = [
        "true shape",
        "before calibration:\ndoubtful",
        f"after calibration:\n{AFTER}",
        "95 % region\nof a corner",
    ]
    assert [t.get_text() for t in texts] == shown
    assert not {"P.R.", "V.R."} & {text.get_text() for text in figure.findobj(Text)}
    for axes in figure.axes:
        (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
        for line in axes.lines:
            x, y = np.asarray(line.get_xydata()).T
            assert x0 <= np.nanmin(x) <= np.nanmax(x) <= x1
            assert y0 <= np.nanmin(y) <= np.nanmax(y) <= y1
    check_above(figure, read)


def test_the_demo_tells_and_writes_what_it_recovered(tmp_path: Path) -> None:
    out = tmp_path / "made" / "here"
    done = CliRunner().invoke(cli, ["demo", "--out", str(out), "--format", "svg"])
    assert done.exit_code == 0, done.output
    assert "Synthetic readings" in done.output
    assert "after     Polygon fit" in done.output
    assert "<svg" in (out / "demo.svg").read_text(encoding="utf-8")
    (shape,) = json.loads((out / "shape.geojson").read_text())["features"]
    assert len(shape["geometry"]["coordinates"][0]) == 5  # the rectangle's corners, the first again


@pytest.mark.parametrize("verb", ["demo", "reproduce"])
def test_a_format_that_is_none(verb: str, tmp_path: Path) -> None:
    done = CliRunner().invoke(cli, [verb, "--out", str(tmp_path / "new"), "--format", "gif"])
    assert str(done.exception) == "--format 'gif' does not exist; choose one of: png, svg, pdf"
    assert not (tmp_path / "new").exists()


def test_figures_of_the_thesis_as_the_kind_that_was_asked_for(tmp_path: Path) -> None:
    for kind in ("svg", "pdf"):
        _draw("2.4", tmp_path, kind)
    assert sorted(f.name for f in tmp_path.iterdir()) == [
        f"figure_2_04.{kind}" for kind in ("pdf", "png", "svg")
    ]
