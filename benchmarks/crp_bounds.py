"""The Cramer-Rao bound of l and u for CRS-CRP, by contact, build and wiring: tables of docs/science/physics.md.

Run: python benchmarks/crp_bounds.py [mesh | places | builds | wirings ...]
"""

from __future__ import annotations

import numpy as np
from _tables import head, print_asked, row

import tacstrip as ts
from studies import crp_spans
from studies.crp import SHAPES, SIGMA, a_sensor, end_bounds
from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.network.crp.cramer_rao import Electrodes
from tacstrip.network.crp.mesh import Wiring

LENGTH = a_sensor().length_mm
SCHEMES: tuple[Electrodes, ...] = ("own", "all")
SHORT = 0.05  # of L: shorter contacts do not count


def span(sensor: ts.Sensor, shape: str) -> tuple[FloatArray, FloatArray]:
    """Return l and u of one of the three shapes."""
    l, u = ts.footprint(sensor, SHAPES[shape])
    return l, u


def wide(l: FloatArray, u: FloatArray) -> BoolArray:
    """Return on which strips a contact is not short (strips,)."""
    return np.asarray(u - l >= SHORT * LENGTH)


def mesh_table() -> None:
    """Compare readings with those of a mesh of 1,600 rows."""
    sensor = a_sensor()
    l, u = span(sensor, "hexagon")
    fine = np.stack(crp_spans.own_electrodes(sensor, l, u, 1600))
    head("rows", "largest difference [Vref]", "order")
    before = np.nan
    for rows in (50, 100, 200, 400):
        off = float(np.nanmax(np.abs(crp_spans.own_electrodes(sensor, l, u, rows) - fine)))
        row(rows, f"{off:.2g}", "" if np.isnan(before) else f"{np.log2(before / off):.2f}")
        before = off


def places_table() -> None:
    """Show the bound of a level band over 14 strips, by its width and place."""
    sensor, places = a_sensor(), (12.5, 25.0, 50.0)
    head("w", *(f"middle at {y:g} % of L" for y in places))
    for w in (2.0, 5.0, 10.0, 20.0, 40.0):
        cells = []
        for y in places:
            l, u = np.full((2, sensor.strips), np.nan)
            l[3:17], u[3:17] = y - w / 2, y + w / 2
            if y < w / 2:
                cells.append("-")
                continue
            own, every = (np.nanmedian(end_bounds(sensor, l, u, e), axis=1) for e in SCHEMES)
            cells.append(f"{own[0]:.2f}, {own[1]:.2f} / {every[0]:.2f}, {every[1]:.2f}")
        row(f"{w:g} %", *cells)


def builds_table() -> None:
    """Show the bound for other numbers of strips, ratios and lambdas."""
    level = ts.Contact.polygon([(15, 35), (85, 35), (85, 65), (15, 65)])
    head("sensor", "hexagon, own / all", "level band of 30 mm, own / all")
    builds: list[tuple[str, dict[str, float]]] = [
        *((f"{n} strips", {"strips": n, "pitch_mm": 100.0 / n}) for n in (20, 40, 80)),
        *(
            (f"ratio {r:g}, lambda 1", {"resistivity_ratio": r, "contact_lambda_mm": 1.0})
            for r in (1.0, 10.0, 100.0, 1000.0)
        ),
        *((f"lambda {lam:g}", {"contact_lambda_mm": lam}) for lam in (0.5, 1.0, 2.0, 4.0)),
    ]
    for name, changed in builds:
        sensor = a_sensor(**changed)
        cells = []
        for contact in (SHAPES["hexagon"], level):
            l, u = ts.footprint(sensor, contact)
            bound = [np.median(end_bounds(sensor, l, u, e)[:, wide(l, u)]) for e in SCHEMES]
            cells.append(f"{bound[0]:.3f} / {bound[1]:.3f}")
        row(name, *cells)


def wirings_table() -> None:
    """Show the bound for what other strips and edges are joined to."""
    sensor = a_sensor()
    wirings = {
        "others float, edges free": Wiring(),
        "common edge bars": Wiring(common_bars=True),
        "tied grounds": Wiring("tied grounds"),
        "other strips grounded": Wiring("grounded"),
    }
    head("median / worst", *(f"{shape}, {e}" for shape in SHAPES for e in SCHEMES))
    for name, wiring in wirings.items():
        cells = []
        for shape in SHAPES:
            l, u = span(sensor, shape)
            for e in SCHEMES:
                covariance = crp_spans.covariance(sensor, l, u, SIGMA, e, wiring=wiring)
                bound = 100.0 * np.sqrt(np.diag(covariance))[np.tile(wide(l, u), 2)] / LENGTH
                cells.append(f"{np.median(bound):.2g} / {bound.max():.2g}")
        row(name, *cells)


if __name__ == "__main__":
    print_asked(
        {"mesh": mesh_table, "places": places_table, "builds": builds_table, "wirings": wirings_table}
    )
