"""Identifiability: which parameters the runs do not determine, and what would."""

from __future__ import annotations

import numpy as np

from tacstrip.calibrate.fit import ModelFit
from tacstrip.calibrate.model import PARTS, Model, apply
from tacstrip.errors import SpecError
from tacstrip.io.runs import Runs
from tacstrip.sensor.spec import Sensor

_POINT_MM = 5e-7  # contacts no longer than this have no length
# The largest standard deviation of a parameter that is determined: log ratios, lambda / L, fade, the rest over Vref.
_MOST_SIGMA = {
    "ratio": 0.2,
    "ratios": 0.2,
    "lambda": 0.01,
    "fade": 0.1,
    "gain": 0.05,
    "offset": 0.02,
    "warp": 0.02,
    "curve": 0.05,
}
_REMEDY = {
    "ratio": "press contacts of different lengths w",
    "ratios": "press contacts of different lengths w on every strip",
    "lambda": "press contacts of different lengths w",
    "fade": "press contacts nearer to both ends",
    "gain": "press contacts further apart along every strip",
    "offset": "press every strip",
    "warp": "press more contacts along every strip",
    "curve": "press more contacts along every strip, near both ends too",
}


def needs_lengths(model: Model, runs: Runs) -> str:
    """Say which part of the model needs contacts with a length, if all are points; "" otherwise. Needs no fit."""
    if np.nanmax(runs.w_mm, initial=0.0) > _POINT_MM:
        return ""
    for part in ("ratio", "ratios", "lambda"):
        if model.has(part):
            what = "contact resistance" if part == "lambda" else "ratio of resistivities"
            return (
                f"all contacts have w = 0, and such a contact reads the same with any {what}; {_REMEDY[part]}"
            )
    return ""


def unidentifiable(fit: ModelFit, sensor: Sensor, runs: Runs) -> str:
    """Say which part of the model the runs do not determine and what would; "" where they determine all."""
    model = fit.constants.model
    if why := needs_lengths(model, runs):
        return why
    spread = dict(zip(model.shared, fit.shared_sigma, strict=True))
    spread |= dict(zip(model.own(runs.signatures), fit.own_sigma.max(axis=0), strict=True))
    # Where an offset and another part cannot be separated, name the other part.
    for name, sigma in sorted(spread.items(), key=lambda item: item[0].startswith("offset")):
        part = name.split()[0]
        if not sigma <= _MOST_SIGMA[part]:
            if not 2.0 * sigma < 1.0:  # wider than the value itself, or than the whole scale
                return f"the runs do not determine {PARTS[part]}; {_REMEDY[part]}"
            unit = {"lambda": "L", "ratio": "of it", "ratios": "of it"}.get(part, "Vref")
            return f"the runs determine {PARTS[part]} only to +-{2.0 * sigma:.2g} {unit}; {_REMEDY[part]}"
    try:
        apply(fit.constants, sensor)
    except SpecError as error:
        return f"{error}; {_REMEDY['curve' if model.has('curve') else 'offset']}"
    return ""
