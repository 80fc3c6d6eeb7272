"""Identifiability: which parameters the runs do not determine, and what would."""

from __future__ import annotations

import numpy as np

from tacstrip.calibrate.fit import ModelFit, usable_rows
from tacstrip.calibrate.model import PARTS, Model, apply
from tacstrip.errors import SpecError
from tacstrip.io.runs import Runs
from tacstrip.sensor.spec import Sensor

_ONE_PLACE = 0.01  # of the length: contacts nearer than this to each other are at one place
_POINT_MM = 5e-7  # contacts no longer than this have no length


def needs_lengths(model: Model, runs: Runs) -> str:
    """Say which part of the model needs contacts with a length, if all are points; "" otherwise. Needs no fit."""
    if np.nanmax(runs.w_mm, initial=0.0) > _POINT_MM:
        return ""
    for part in ("ratio", "ratios", "lambda"):
        if model.has(part):
            what = "contact resistance" if part == "lambda" else "ratio of resistivities"
            remedy = PARTS[part].remedy
            return f"all contacts have w = 0, and such a contact reads the same with any {what}; {remedy}"
    return ""


def needs_places(model: Model, sensor: Sensor, runs: Runs) -> str:
    """Say which part of the model needs more places on a strip than there are; "" otherwise. Needs no fit.

    Repeats are not places, nor are contacts that differ by a hair: a curve with as many knots as there are places
    passes through each, and anywhere between. A warp's pieces are alike: half as many places tell them.
    """
    if not (model.has("curve") or model.has("warp")):
        return ""
    part, least = ("curve", model.pieces + 2) if model.has("curve") else ("warp", (model.pieces + 1) // 2)
    usable = usable_rows(runs)
    for strip in np.flatnonzero(np.isfinite(runs.l_mm).any(axis=0)):
        place = np.stack([runs.l_mm[usable[:, strip], strip], runs.w_mm[usable[:, strip], strip]], axis=1)
        apart = 0
        while len(place):
            far = (np.abs(place - place[0]) > _ONE_PLACE * sensor.length_mm).any(axis=1)
            place, apart = place[far], apart + 1
        if apart < least:
            return (
                f"the runs do not determine {PARTS[part].words}: strip {strip + sensor.strip_base} has {apart} "
                f"distinct places and needs {least}; {PARTS[part].remedy}"
            )
    return ""


def unidentifiable(fit: ModelFit, sensor: Sensor, runs: Runs) -> str:
    """Say which part of the model the runs do not determine and what would; "" where they determine all."""
    model = fit.constants.model
    if why := needs_lengths(model, runs) or needs_places(model, sensor, runs):
        return why
    there = np.isfinite(runs.l_mm).any(axis=0)  # strips that are not left out
    spread = dict(zip(model.shared, fit.shared_sigma, strict=True))
    spread |= dict(zip(model.own(runs.signatures), fit.own_sigma[there].max(axis=0), strict=True))
    # Where an offset and another part cannot be separated, name the other part.
    for name, sigma in sorted(spread.items(), key=lambda item: item[0].startswith("offset")):
        part = PARTS[kind := name.split()[0]]
        if not sigma <= part.most:
            if not 2.0 * sigma < 1.0:  # wider than the value itself, or than the whole scale
                return f"the runs do not determine {part.words}; {part.remedy}"
            unit = {"lambda": "L", "ratio": "of it", "ratios": "of it"}.get(kind, "Vref")
            return f"the runs determine {part.words} only to +-{2.0 * sigma:.2g} {unit}; {part.remedy}"
    try:
        apply(fit.constants, sensor)
    except SpecError as error:
        return f"{error}; {PARTS['curve' if model.has('curve') else 'offset'].remedy}"
    return ""
