"""Make the pictures of the README and the docs again, by the package's own code.

Run: make pictures (writes docs/pictures/).
"""

from __future__ import annotations

from pathlib import Path

from studies.budget import budget_figure
from studies.crp import FIGURES as CRP
from studies.estimation_figures import FIGURES as ESTIMATION
from studies.layers import FIGURES as LAYERS
from studies.phantoms import figure_phantoms
from studies.physics import FIGURES as PHYSICS
from studies.pieces import FIGURES as PIECES
from studies.tracks import FIGURES as TRACKS
from studies.width import FIGURES as WIDTH
from tacstrip.plot.style import save
from tacstrip.thesis.chapter2 import FIGURES as CHAPTER_2
from tacstrip.thesis.chapter3 import FIGURES as CHAPTER_3
from tacstrip.thesis.chapter4 import FIGURES as CHAPTER_4
from tacstrip.thesis.chapter5.recovery_figures import ambiguity, noisy_signature
from tacstrip.thesis.demo import picture, run

PICTURES = Path(__file__).parents[1] / "docs" / "pictures"


def main() -> None:
    """Write all of them."""
    drawn = {
        "demo": picture(run()),
        "touching_a_tube": CHAPTER_3["3.10"](),
        "same_signature": CHAPTER_4["4.5"](),
        "blocks": CHAPTER_4["4.9"](),
        "hidden_kink": noisy_signature("5.9"),
        "concave": ambiguity("5.19"),
        "three_sensors": CHAPTER_2["2.3"](),
        "parallel_path": CHAPTER_2["2.4"](),
        "budget": budget_figure(),
        "phantoms": figure_phantoms(),
        **{
            name: draw()
            for name, draw in (PHYSICS | CRP | WIDTH | ESTIMATION | TRACKS | PIECES | LAYERS).items()
        },
    }
    for name, figure in drawn.items():
        print(save(figure, PICTURES / f"{name}.png", dpi=90))


if __name__ == "__main__":
    main()
