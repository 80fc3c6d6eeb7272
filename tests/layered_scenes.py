"""Two layers and what touches them, for tests of several rooms."""

from __future__ import annotations

import tacstrip as ts
from tacstrip.core.scene import Scene, SceneProblem
from tacstrip.reconstruction.layered.estimate import scene_problem

TRIANGLES = ([(20.0, 20.0), (45.0, 25.0), (30.0, 50.0)], [(35.0, 60.0), (70.0, 55.0), (60.0, 80.0)])
NOISE = ts.Noise(positional=0.005)


def square(
    strips: int = 32, construction: str = "crs-crs", lam: float = 0.0, angle_deg: float = 90.0
) -> ts.LayeredSensor:
    """Return two crossed layers of a square of 100 mm."""
    one = ts.Sensor(
        construction=construction,
        strips=strips,
        pitch_mm=100.0 / strips,
        length_mm=100.0,
        contact_lambda_mm=lam,
    )
    return ts.LayeredSensor.crossed(one, angle_deg)


def contact_of(*outlines: object) -> ts.Contact:
    """Return several polygons as one contact."""
    first, *rest = (ts.Contact.polygon(outline) for outline in outlines)  # type: ignore[arg-type]
    for other in rest:
        first = first + other
    return first


def two_triangles(construction: str = "crs-crs", lam: float = 0.0) -> tuple[SceneProblem, Scene]:
    """Return noisy readings of two triangles under layers that cross by 70 degrees, and a scene that is off."""
    sensor = square(24, construction, lam, 70.0)
    scan = ts.simulate(sensor, contact_of(*TRIANGLES), NOISE, rng=1)
    off = Scene.of([ts.Contact.polygon(t).moved(1.0, -0.7).vertices for t in TRIANGLES])
    return scene_problem(scan, sensor, 0.003), off
