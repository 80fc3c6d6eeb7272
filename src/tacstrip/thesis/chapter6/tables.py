"""Tables 6.2-6.4 and 6.6: the errors of each method on the twins' readings, compared with the printed values.

The printed errors are fixed; the thesis does not print where the rectangle lay. So a row is run at places drawn from
those that its text allows (`chapter6/twin.py`), the same ones in every row of a sensor and region.
Vertex Reconstruction gets the strips nearest to the true vertices, as "the transition at the seventh sensing element"
says, and reads them; profiles are compared at the original's vertex columns. `VARIANTS` changes one thing at a time.
M.C. is un-normalised by the mean perimeter, `mc` [rad cm], and as defined in 5.3, `mc_rad` [rad]: which of them, if
either, is the "Radian-cm" of chapter 6 is not said.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.contact.noise import Noise, add_reading_errors
from tacstrip.contact.shape import Contact
from tacstrip.data.published import Experiment, experiments
from tacstrip.geometry.metrics import mismatch
from tacstrip.reconstruction.profile import profile_at, profile_reconstruction
from tacstrip.reconstruction.vertex.estimate import vertex_reconstruction
from tacstrip.scan import Scan
from tacstrip.sensor.spec import Sensor
from tacstrip.thesis.chapter6.twin import (
    PLACINGS,
    PROTOTYPES,
    REGIONS,
    Placing,
    calibrated,
    nearest_strips,
    raw_scan,
    region_errors,
    twin,
)
from tacstrip.thesis.ranges import is_inside, ranges

# Ours: the printed measure it is compared with.
MEASURES = {"mc": "mc", "mc_rad": "mc", "aoe": "aoe", "ape": "ape"}
_PROFILES = {"profile I": Noise(positional=0.005), "profile II": Noise(positional=0.01)}
PROFILE_II = _PROFILES["profile II"]


@dataclass(frozen=True)
class Variant:
    """What differs from the thesis' experiment.

    Attributes
    ----------
    errors
        "printed", "reversed" (of the other sign), "none", "quantised" (C.Q.E. of 1 mm on top), a profile of P.U.
    method
        "thesis"; "section": the true transitions, sections fitted; "gradient": transitions found;
        "one strip off": each inner transition taken a strip to the left or right; "polygon": `fit_polygon`.
    raw
        Whether the offsets stay in the readings.
    placing
        Another placing than the sensor's first.
    """

    errors: str = "printed"
    method: str = "thesis"
    raw: bool = False
    placing: str = ""


VARIANTS = {
    "true transitions": Variant(method="section"),
    "found transitions": Variant(method="gradient"),
    "one strip off": Variant(errors="none", method="one strip off"),
    "polygon": Variant(method="polygon"),
    "overhanging": Variant(placing="overhanging"),
    "overhanging, found transitions": Variant(placing="overhanging", method="gradient"),
    "not calibrated": Variant(raw=True),
    "no errors": Variant(errors="none"),
    "errors reversed": Variant(errors="reversed"),
    "quantised": Variant(errors="quantised"),
    "profile I": Variant(errors="profile I"),
    "profile II": Variant(errors="profile II"),
}


def applies(variant: Variant, experiment: Experiment) -> bool:
    """Tell whether a variant can be run on an experiment and is not the experiment itself."""
    if experiment.algorithm == "profile" and variant.method not in ("thesis", "polygon"):
        return False
    if variant.placing and variant.placing not in PLACINGS[experiment.sensor]:
        return False
    return experiment.calibrated or (variant.errors == "printed" and not variant.raw)


def run_experiment(number: int, seeds: int) -> dict[str, Any]:
    """Return the `ours` of entry `number` of `experiments()`, over as many places as seeds.

    Per measure its median, 5 % and 95 % points; the share of failures; which printed values lie inside; the same
    at the nominal place; how often each vertex, left to right, has the largest error; and the variants.
    """
    e = experiments()[number]
    own = Variant(raw=not e.calibrated)
    ours = _over_places(e, own, seeds)
    values = ((m, e.printed[printed], ours[m]) for m, printed in MEASURES.items())
    ours["inside"] = {m: is_inside(printed, own["p05"], own["p95"]) for m, printed, own in values}
    contact, _, vertices = at_nominal(e, own)
    ours["nominal"] = _measured(contact, vertices)
    run = {name: replace(v, raw=v.raw or own.raw) for name, v in VARIANTS.items() if applies(v, e)}
    ours["variants"] = {name: _over_places(e, variant, seeds) for name, variant in run.items()}
    return ours


def at_nominal(e: Experiment, variant: Variant) -> tuple[Contact, Scan, FloatArray]:
    """Return the rectangle at the nominal place, the twin's scan of it, and what is recovered (N, 2) [mm]."""
    sensor = twin(e.sensor)
    contact = _placing(e.sensor, variant.placing).contact(sensor, e.region)
    scan = _scan(sensor, e, variant, contact, np.random.default_rng(0))
    return contact, scan, _recover(sensor, e, variant, contact, scan, np.random.default_rng(0))


def _placing(sensor: str, name: str) -> Placing:
    placings = PLACINGS[sensor]
    return placings[name or next(iter(placings))]


def _key(sensor: str, region: str) -> list[int]:
    return [list(PROTOTYPES).index(sensor), REGIONS.index(region)]


@cache
def _drawn_place(sensor: str, region: str, placing: str, seed: int) -> Contact:
    random = np.random.default_rng([*_key(sensor, region), seed, 0])
    return _placing(sensor, placing).drawn(twin(sensor), region, random)


def _over_places(e: Experiment, variant: Variant, seeds: int) -> dict[str, Any]:
    sensor, values, worst = twin(e.sensor), [], np.zeros(4)
    for seed in range(seeds):
        contact = _drawn_place(e.sensor, e.region, variant.placing, seed)
        errors = np.random.default_rng([*_key(e.sensor, e.region), seed, 1])
        scan = _scan(sensor, e, variant, contact, errors)
        vertices = _recover(sensor, e, variant, contact, scan, errors)
        if (found := _measured(contact, vertices)) is None:
            continue
        values.append(list(found.values()))
        if len(vertices) == 4:
            apart = np.linalg.norm(_left_to_right(vertices) - _left_to_right(contact.vertices), axis=1)
            worst[apart.argmax()] += 1.0 / seeds
    counts = {"failed": 1.0 - len(values) / seeds, "worst_vertex": worst.tolist()}
    return ranges(np.array(values), list(MEASURES)) | counts


def _scan(
    sensor: Sensor, e: Experiment, variant: Variant, contact: Contact, random: np.random.Generator
) -> Scan:
    """Return the readings that a variant hands to its method; of the row's own signature, both for P.R."""
    printed = region_errors(e.sensor, e.region)
    if variant.errors == "reversed":
        printed = {name: -errors for name, errors in printed.items()}
    elif variant.errors == "quantised":
        step = Noise(quantisation=1.0 / sensor.length_mm)
        printed = {name: errors + _drawn(step, sensor, random) for name, errors in printed.items()}
    elif variant.errors == "none":
        printed = {name: 0.0 * errors for name, errors in printed.items()}
    elif variant.errors != "printed":
        printed = {name: _drawn(_PROFILES[variant.errors], sensor, random) for name in printed}
    raw = raw_scan(sensor, contact, printed)
    scan = raw if variant.raw else calibrated(sensor, raw)
    return scan if e.signature is None else Scan(time_s=0.0, **{e.signature: scan[e.signature]})


def _drawn(noise: Noise, sensor: Sensor, random: np.random.Generator) -> FloatArray:
    """Return errors (strips,) over Vref: readings at half scale, which nothing clips, less one half."""
    return add_reading_errors(np.full(sensor.strips, 0.5), noise, random) - 0.5


def _recover(
    sensor: Sensor, e: Experiment, variant: Variant, contact: Contact, scan: Scan, random: np.random.Generator
) -> FloatArray:
    """Return the recovered corners (N, 2) [mm]; empty where there is no shape, or transitions found are not 4."""
    if variant.method == "polygon":
        from tacstrip.reconstruction.polygon.estimate import fit_polygon  # in the workers only

        lines = replace(sensor, strip_width_mm=None)  # as the twin makes them
        return fit_polygon(scan, lines, PROFILE_II, assessment="none").objects[0].vertices
    if e.algorithm == "profile":
        return profile_at(profile_reconstruction(scan, sensor).objects[0], contact.vertices)
    options: dict[str, Any] = {"transitions": "gradient"}
    if variant.method == "section":
        options = {"transitions": np.clip(np.sort(contact.vertices[:, 0]), 0.0, sensor.width_mm)}
    elif variant.method != "gradient":
        strips = nearest_strips(sensor, contact.vertices)
        if variant.method == "one strip off":
            strips[1:-1] = np.clip(strips[1:-1] + random.choice([-1, 1], 2), 1, sensor.strips - 2)
        options = {"transitions": sensor.x_mm[strips], "reading": "strip"}
    found = vertex_reconstruction(scan, sensor, signature=e.signature, **options).objects[0].vertices
    return found[:0] if variant.method == "gradient" and len(found) != 4 else found


def _measured(contact: Contact, vertices: FloatArray) -> dict[str, float] | None:
    """Return the measures in the units of chapter 6: [rad cm], [rad], [rad], [cm]; None without a shape."""
    if not len(vertices):
        return None
    m = mismatch(contact.vertices, vertices)
    return {"mc": m.mc_length / 10.0, "mc_rad": m.mc, "aoe": m.aoe, "ape": m.ape / 10.0}


def _left_to_right(corners: FloatArray) -> FloatArray:
    return np.asarray(corners[np.argsort(corners[:, 0])])
