"""What Vertex Reconstruction makes of the concave tetragon: figures 5.19, 5.32 and 5.61."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tacstrip.contact.signature import signatures
from tacstrip.geometry.metrics import mismatch
from tacstrip.reconstruction.result import RecoveredObject
from tacstrip.reconstruction.vertex.estimate import vertex_reconstruction
from tacstrip.scan import Scan
from tacstrip.simulation import simulate
from tacstrip.thesis.shapes import POSITIONS, SHAPES, SIMULATED

CONCAVE = SHAPES["concave tetragon"]
# Figure: (construction, signature).
AMBIGUOUS = {"5.19": ("crs-crs", "kh"), "5.32": ("crs-crs", "kl"), "5.61": ("crs-m", "k")}


def recoveries(figure: str) -> Iterator[tuple[Scan, RecoveredObject]]:
    """Yield the ideal scan at each position and what is recovered from one of its signatures."""
    construction, name = AMBIGUOUS[figure]
    sensor = SIMULATED[construction]
    for position in range(POSITIONS):
        scan, x = simulate(sensor, CONCAVE.contact(position)), CONCAVE.transitions(position)
        found = vertex_reconstruction(scan, sensor, signature=name, transitions=x, reading="strip")
        yield scan, found.objects[0]


def ambiguity_facts(figure: str) -> list[dict[str, float]]:
    """Return the errors of each position with a shape.

    M.C. [rad], IoU, and the largest difference [Vref] between the recovered convex polygon's signature and the one
    measured.
    """
    construction, name = AMBIGUOUS[figure]
    facts = []
    for position, (scan, found) in enumerate(recoveries(figure)):
        if found.found and found.profile is not None:
            m = mismatch(CONCAVE.contact(position).vertices, found.vertices)
            again = signatures(SIMULATED[construction], found.profile[1], found.profile[2])[name]
            apart = float(np.abs(again - scan[name][found.strips]).max())
            facts.append({"mc": m.mc, "iou": m.iou, "signature_difference": apart})
    return facts
