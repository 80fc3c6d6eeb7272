"""The shapes of chapter 5: dragged in 5 steps from lower left to upper right, turned 36 degrees a step.

The thesis does not print its coordinates. These meet what its text says (tests/thesis/test_chapter5.py):
the triangle's k_h runs from 0.05 to 0.12 at position 1 and from 0.86 to 0.87 at position 5; the hexagon's
runs from 0.10 to 0.20 at position 1 and its span stays between 0.1 and 0.2, to a decimal, everywhere.
Among random candidates those were kept whose vertices stay furthest apart in x over all positions, by
more than twice the transition error, so that no error of 5.1.2 swaps two of them. The printed results were
not used in the choice. Every placed vertex's x is snapped to a strip centre, so that ideal rows can be exact.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.contact.shape import Contact
from tacstrip.sensor.spec import Sensor

POSITIONS = 5
TURN_RAD = np.deg2rad(36.0)


@dataclass(frozen=True)
class ThesisShape:
    """A polygon by its corners, and the path of its centroid [mm]."""

    name: str
    corners: tuple[tuple[float, float], ...]
    start: tuple[float, float]
    end: tuple[float, float]

    @cache  # noqa: B019 - there are four shapes, made once
    def contact(self, position: int) -> Contact:
        """Return the shape at position 0 to 4, its vertices' x on strip centres."""
        contact = Contact.polygon(self.corners).dragged([self.start, self.end], POSITIONS, TURN_RAD)[position]
        corners = contact.vertices
        pitch = SIMULATED["crs-crs"].pitch_mm
        corners[:, 0] = (np.floor(corners[:, 0] / pitch) + 0.5) * pitch
        return Contact.polygon(corners)

    def transitions(self, position: int) -> FloatArray:
        """Return the x of all vertices at a position, ascending [mm]."""
        return np.sort(self.contact(position).vertices[:, 0])


_SIZE: dict[str, Any] = {"strips": 1000, "pitch_mm": 1.0, "length_mm": 1000.0}
SIMULATED = {name: Sensor(construction=name, **_SIZE) for name in ("crs-crs", "crs-m")}

SHAPES = {
    s.name: s
    for s in (
        ThesisShape("triangle", ((-48, -60), (62, 2), (-14, 58)), (134, 109), (866, 837)),
        ThesisShape("tetragon", ((-107, 8), (54, -95), (94, 42), (3, 105)), (215, 175), (785, 845)),
        ThesisShape(
            "hexagon",
            ((83, 92), (-6, 141), (-136, -59), (-21, -124), (97, -52), (112, 2)),
            (157, 158),
            (843, 842),
        ),
        ThesisShape(
            "concave tetragon", ((-150, -34), (-36, -20), (84, -34), (50, 54)), (180, 170), (820, 830)
        ),
    )
}
