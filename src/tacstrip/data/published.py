"""The printed figures of the thesis, from `data/published.toml`."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.data import data_path

METRICS = ("mc", "aoe", "ape")


@dataclass(frozen=True)
class Row:
    """A row of tables 5.2-5.14: five positions of one shape under one noise.

    Attributes
    ----------
    figure
        Number of the figure that shows it, "5.5" to "5.60".
    printed
        Metric to its five printed values (5,); NaN where the source prints "-", and all five where it is not readable.
    """

    table: str
    figure: str
    construction: str
    algorithm: str
    signature: str | None
    shape: str
    noise: str
    printed: dict[str, FloatArray]


@dataclass(frozen=True)
class Experiment:
    """An entry of tables 6.2-6.4 or 6.6: one recovery of the rectangle.

    Attributes
    ----------
    signature
        None for Profile Reconstruction.
    region
        Where on the sensor it was pressed: "lower", "middle" or "upper".
    calibrated
        Whether the offsets of table 6.1 or 6.5 were subtracted.
    printed
        M.C. [rad cm], A.O.E. [rad], A.P.E. [cm].
    """

    table: str
    figure: str
    sensor: str
    algorithm: str
    signature: str | None
    region: str
    calibrated: bool
    printed: dict[str, float]


@cache
def published() -> dict[str, Any]:
    """Return the whole file, as read."""
    return tomllib.loads(data_path("published.toml").read_text(encoding="utf-8"))


@cache
def rows() -> tuple[Row, ...]:
    """Return the 52 rows of tables 5.2-5.14 in their order."""
    # Figures 5.9, 5.14, 5.19 and 5.32 stand between those of the rows.
    between = (9, 14, 19, 32)
    numbers = [n for n in range(5, 61) if n not in between]
    return tuple(
        _row(raw, f"5.{number}") for raw, number in zip(published()["simulation"], numbers, strict=True)
    )


@cache
def experiments() -> tuple[Experiment, ...]:
    """Return the 16 entries of tables 6.2-6.4 and 6.6 in their order."""
    return tuple(
        Experiment(
            raw["table"], raw["figure"], raw["sensor"], raw["algorithm"], raw["signature"] or None, raw["region"],
            raw["calibrated"], {m: float(raw[m]) for m in METRICS},
        )
        for raw in published()["experiment"]
    )  # fmt: skip


def offsets_volt(sensor: str, signature: str) -> FloatArray:
    """Return the calibration factors of tables 6.1, 6.5 and 6.7 [V], one per strip."""
    found = [c for c in published()["calibration"] if (c["sensor"], c["signature"]) == (sensor, signature)]
    return np.array(found[0]["offset_volt"])


def residuals(figure: str) -> FloatArray:
    """Return the errors left after calibration in a figure's experiment (tables 6.8-6.11), over Vref."""
    found = [r for r in published()["residual"] if r["figure"] == figure]
    return np.array(found[0]["percent_of_vref"]) / 100.0


def region_residuals(sensor: str, signature: str, region: str) -> FloatArray:
    """Return the errors (strips,) of a signature in the experiments in a region, over Vref.

    The tables name figures; that of a calibrated experiment with this signature, in this region, is the one.
    Its readings served Profile Reconstruction and the uncalibrated figures too (6.1.2-6.1.4).
    """
    wanted = (sensor, signature, region, True)
    figures = [e.figure for e in experiments() if (e.sensor, e.signature, e.region, e.calibrated) == wanted]
    return residuals(figures[0])


def _row(raw: dict[str, Any], figure: str) -> Row:
    printed = {m: np.array(raw.get(m, [np.nan] * 5)) for m in METRICS}
    return Row(
        raw["table"], figure, raw["sensor"].lower(), raw["algorithm"], raw["signature"] or None, raw["shape"],
        raw["noise"], printed,
    )  # fmt: skip
