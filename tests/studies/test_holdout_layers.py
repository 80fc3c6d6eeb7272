import numpy as np

import tacstrip as ts
from studies.holdout.layers import read, report, scene, scores


def test_readings_made_apart_are_those_of_the_simulation_and_a_scene_is_scored() -> None:
    random = np.random.default_rng(3)
    outlines = scene("both", random)
    sensor, scan = read(outlines, 24, 0.0, random)
    contact = ts.Contact(tuple(shape for o in outlines for shape in ts.Contact.polygon(o).shapes))
    for name in ("kh", "kl"):
        np.testing.assert_allclose(ts.simulate(sensor, contact)[name], scan[name], atol=1e-12)
    rows, corners = scores("alone", 24, 0.002, 0, range(1))
    assert rows[0]["right"] == 1.0
    assert rows[0]["iou"] > 0.9
    assert "count right 1.000" in report("alone", 24, 0.002, rows, corners)
