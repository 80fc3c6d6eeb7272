"""Make the pictures of the README and the docs again, by the package's own code.

Run: make pictures, or python tools/docs_pictures.py NAME ... (writes docs/pictures/). Those of the live page:
TACSTRIP_PICTURES=docs/pictures pytest tests/view/test_page.py.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from opening_picture import opening_figure

import tacstrip as ts
from studies.budget import budget_figure
from studies.crp import FIGURES as CRP
from studies.estimation_figures import FIGURES as ESTIMATION
from studies.layers import FIGURES as LAYERS
from studies.phantoms import figure_phantoms
from studies.physics import FIGURES as PHYSICS
from studies.pieces import FIGURES as PIECES
from studies.tracks import FIGURES as TRACKS
from studies.width import FIGURES as WIDTH
from tacstrip.plot.skins import press_figure
from tacstrip.plot.theme import save
from tacstrip.thesis.chapter2 import FIGURES as CHAPTER_2
from tacstrip.thesis.chapter3 import FIGURES as CHAPTER_3
from tacstrip.thesis.chapter4 import FIGURES as CHAPTER_4
from tacstrip.thesis.chapter5.figures import ambiguity, noisy_signature
from tacstrip.thesis.demo import picture, run

PICTURES = Path(__file__).parents[1] / "docs" / "pictures"


DRAW: dict[str, Callable[[], Figure]] = {
    "opening": opening_figure,
    "demo": lambda: picture(run()),
    "touching_a_tube": CHAPTER_3["3.10"],
    "same_signature": CHAPTER_4["4.5"],
    "blocks": CHAPTER_4["4.9"],
    "hidden_kink": lambda: noisy_signature("5.9"),
    "concave": lambda: ambiguity("5.19"),
    "three_sensors": CHAPTER_2["2.3"],
    "parallel_path": CHAPTER_2["2.4"],
    "budget": budget_figure,
    "phantoms": figure_phantoms,
    "press_fingertip": lambda: _pressed(
        "fingertip", ts.Solid.cylinder(4.0), ((20, 0, 20), (-1, 0, -1), 0.5), 1.5
    ),
    "press_forearm": lambda: _pressed("forearm", ts.Solid.box((40, 20, 10)), ((0, 80, 90), (0, -1, 0)), 2.0),
    **(PHYSICS | CRP | WIDTH | ESTIMATION | TRACKS | PIECES | LAYERS),
}


def main(*names: str) -> None:
    """Write those that are named, or all of them."""
    for name in names or DRAW:
        print(save(DRAW[name](), PICTURES / f"{name}.png", dpi=90), flush=True)


def _pressed(sensor: str, solid: ts.Solid, pose: Any, depth_mm: float) -> Figure:
    """Return the picture of a solid pressed into a skin."""
    spec = ts.Sensor.load(sensor)
    return press_figure(spec, ts.press(spec, solid.at(*pose), depth_mm=depth_mm))


if __name__ == "__main__":
    main(*sys.argv[1:])
