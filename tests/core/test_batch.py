"""Batches: the compiled pass against NumPy, and the numbers that it draws."""

from __future__ import annotations

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.core.batch import batch, batch_sensor, philox, plain_batch
from tacstrip.core.binding import BatchErrors, exported

needs_core = pytest.mark.skipif(exported("batch") is None, reason="the core is not compiled here")


@pytest.mark.parametrize(
    ("counter", "key", "words"),
    [
        ((0, 0, 0, 0), (0, 0), (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
        ((2**32 - 1,) * 4, (2**32 - 1,) * 2, (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
        (
            (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
            (0xA4093822, 0x299F31D0),
            (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
        ),
    ],
)
def test_philox_gives_the_known_answers(
    counter: tuple[int, ...], key: tuple[int, int], words: tuple[int, ...]
) -> None:
    """Those of the generator's authors (Random123's kat_vectors)."""
    assert philox(key, counter[0], counter[1], counter[2] + (counter[3] << 32)).tolist() == list(words)


@needs_core
@pytest.mark.parametrize("construction", ["crs-crs", "crs-m"])
@pytest.mark.parametrize("lam", [0.0, 3.0])
@pytest.mark.parametrize("several", [False, True])
def test_the_compiled_pass_is_the_one_of_numpy(construction: str, lam: float, several: bool) -> None:
    sensor = ts.Sensor(
        construction=construction,
        strips=37,
        pitch_mm=3.0,
        length_mm=70.0,
        contact_lambda_mm=lam,
        adc_bits=None if several else 10,
    )
    kinds = {"polygon": 0.4, "circle": 0.2, "ellipse": 0.4} if several else "polygon"
    shapes = ts.Shapes(
        n=1, kinds=kinds, objects=(0, 3) if several else 1, frames=3 if several else 1, spin_rad=0.5
    )
    laws, by = shapes.laws(sensor), batch_sensor(sensor)
    first, scans = 2**33 + 5, 90  # beyond what one word counts
    for errors in (
        BatchErrors((1, 2)),
        BatchErrors((1, 2), (0.01, 0.003)),
        BatchErrors((7, 2), (0.0, 0.002), 0.004),
    ):
        ours, shorted = batch(by, errors, first, scans, laws=laws)
        plain = plain_batch(by, errors, np.arange(first, first + scans), laws)
        assert shorted is None
        for name, values in ours.items():
            scale = {"readings": 1.0}.get(name, 100.0)
            np.testing.assert_allclose(values, plain[name], rtol=0.0, atol=1e-12 * scale, err_msg=name)


@needs_core
def test_strips_that_metal_shorts_are_named() -> None:
    sensor = ts.Sensor(construction="crs-m", strips=5, pitch_mm=3.0, length_mm=70.0)
    l, u = np.full((2, 3, 5), np.nan)
    l[1, 2:4], u[1, 2:4] = 0.0, 70.0
    assert batch(batch_sensor(sensor), BatchErrors(), 0, 3, ends_mm=(l, u))[1] == (1, 2)
    assert np.argwhere(
        plain_batch(batch_sensor(sensor), BatchErrors(), np.arange(3), None, (l, u))["shorted"]
    )[0].tolist() == [1, 2]
