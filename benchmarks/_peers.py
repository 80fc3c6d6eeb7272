"""What others take for the same work: each peer a function that returns a job, or None where it is not installed."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely
from scipy.optimize import least_squares

import tacstrip as ts
from tacstrip.core.batch import batch_sensor, plain_batch
from tacstrip.core.binding import BatchErrors
from tacstrip.network.spice import deck
from tacstrip.network.strips.measurements import measurements

Job = Callable[[], Any]
Array = npt.NDArray[np.float64]


def module(name: str) -> Any | None:
    """Return a module, None where it is not installed."""
    try:
        return import_module(name)
    except ImportError:
        return None


def numpy_batch(sensor: ts.Sensor, shapes: ts.Shapes, positional: float, scans: int) -> Job:
    """Simulate scans with labels and uniform errors by NumPy, vectorised: what runs where no core is compiled."""
    by, errors = batch_sensor(sensor, single=True), BatchErrors((1, 2), (positional, 0.0))
    return lambda: plain_batch(by, errors, np.arange(scans), shapes.laws(sensor))


def jax_batch(sensor: ts.Sensor, positional: float, scans: int) -> Job | None:
    """Simulate as many polygons of 3 to 8 corners with labels and uniform errors by JAX, compiled, in float32."""
    jax = module("jax")
    if jax is None:
        return None
    jnp, most, length, n = jax.numpy, 8, sensor.length_mm, sensor.strips
    share, top = (
        sensor.resistivity_ratio / (1.0 + sensor.resistivity_ratio),
        2.0 ** (sensor.adc_bits or 12) - 1.0,
    )

    def run(key: Any) -> Any:
        keys = jax.random.split(key, 4)
        u = jax.random.uniform(keys[0], (7, scans))
        corners = jnp.floor(3 + 6 * u[0])[:, None]
        a = 0.5 * length * (0.2 + 0.4 * u[1])
        b, turn = a * (0.5 + 0.5 * u[2]), 2.0 * np.pi * u[3]
        x0, y0 = a + u[4] * (n * sensor.pitch_mm - 2.0 * a), a + u[5] * (length - 2.0 * a)
        i = jnp.arange(most)[None]
        angle = 2.0 * np.pi / corners * (i + 0.6 * (jax.random.uniform(keys[1], (scans, most)) - 0.5))
        angle = jnp.where(i < corners, angle, angle[:, :1])  # missing corners lie on the first
        p, q, c, s = a[:, None] * jnp.cos(angle), b[:, None] * jnp.sin(angle), jnp.cos(turn), jnp.sin(turn)
        x = x0[:, None] + p * c[:, None] - q * s[:, None]
        y = y0[:, None] + p * s[:, None] + q * c[:, None]
        strip = (jnp.arange(n) + 0.5) * sensor.pitch_mm
        l, h = jnp.full((scans, n), jnp.inf), jnp.full((scans, n), -jnp.inf)
        for j in range(most):
            xa, ya = x[:, j, None], y[:, j, None]
            xb, yb = x[:, (j + 1) % most, None], y[:, (j + 1) % most, None]
            at = ya + (strip - xa) / jnp.where(xb == xa, 1.0, xb - xa) * (yb - ya)
            on = (strip >= jnp.minimum(xa, xb)) & (strip <= jnp.maximum(xa, xb))
            l, h = jnp.where(on, jnp.minimum(l, at), l), jnp.where(on, jnp.maximum(h, at), h)
        there = h >= l
        w = jnp.where(there, h - l, 0.0)
        below = length - (1.0 - share) * w
        errors = positional * (2.0 * jax.random.uniform(keys[2], (2, scans, n)) - 1.0)
        k = jnp.stack([l + share * w, l]) / below + errors
        k = jnp.where(there, jnp.round(jnp.clip(k, 0.0, 1.0) * top) / top, jnp.nan)
        return (
            k,
            jnp.where(there, l, jnp.nan),
            jnp.where(there, h, jnp.nan),
            x,
            y,
            x0,
            y0,
            turn,
            a,
            b,
            corners,
        )

    compiled, key = jax.jit(run), jax.random.key(1)
    compiled(key)[0].block_until_ready()
    return lambda: jax.block_until_ready(compiled(key))


def shapely_footprints(sensor: ts.Sensor, contacts: list[ts.Contact]) -> Job:
    """Cut polygons by the centre lines and take the bounds of what is left."""
    lines = shapely.linestrings([[(x, -1.0), (x, sensor.length_mm + 1.0)] for x in sensor.x_mm])

    def run() -> None:
        for contact in contacts:
            shapely.prepare(contact.shapes[0])
            shapely.bounds(shapely.intersection(lines, contact.shapes[0]))

    return run


def scipy_fit(sensor: ts.Sensor, scan: ts.Scan, corners: Array) -> Job:
    """Fit a tetragon, one corner below and one above, by SciPy's least squares from a start 2 % off the truth.

    The polygon fit finds its start for itself.
    """
    touched, share = scan.touched, sensor.resistivity_ratio / (1.0 + sensor.resistivity_ratio)
    x, read = sensor.x_mm[touched], np.concatenate([scan["kh"][touched], scan["kl"][touched]])

    def residuals(v: Array) -> Array:
        left, below, right, above = v.reshape(4, 2)
        l = np.interp(x, [left[0], below[0], right[0]], [left[1], below[1], right[1]])
        u = np.interp(x, [left[0], above[0], right[0]], [left[1], above[1], right[1]])
        length = sensor.length_mm - (1.0 - share) * (u - l)
        errors: Array = np.concatenate([(l + share * (u - l)) / length, l / length]) - read
        return errors

    start = corners.ravel() + 0.02 * sensor.length_mm * np.array([1, -1, -1, 1, -1, 1, 1, -1])
    return lambda: least_squares(residuals, start, x_scale=sensor.length_mm)


def ngspice_scan(sensor: ts.Sensor, contact: ts.Contact, cells: int, folder: Path) -> Job | None:
    """Solve the network of a contact by ngspice, start-up and reading of the netlist included."""
    if shutil.which("ngspice") is None:
        return None
    asked = {str(strip): m for strip, m in measurements(sensor, contact, cells=cells).items()}
    file = folder / "deck.cir"
    file.write_text(deck("bench", asked), encoding="utf-8")

    def run() -> str:  # its exit status is 1 whatever it finds
        return subprocess.run(
            ["ngspice", "-b", str(file)], capture_output=True, text=True, check=False
        ).stdout

    assert run().count("vh_") >= len(asked)
    return run


def pyeit_forward(nodes: int) -> tuple[Job, int] | None:
    """Solve pyEIT's forward problem for one pair of electrodes on a disc of about so many nodes; return them too."""
    if module("pyeit") is None:
        return None
    mesh = import_module("pyeit.mesh").create(16, h0=float(np.sqrt(3.6 / nodes)))
    forward = import_module("pyeit.eit.fem").Forward(mesh)
    return lambda: forward.solve(np.array([0, 8])), len(mesh.node)
