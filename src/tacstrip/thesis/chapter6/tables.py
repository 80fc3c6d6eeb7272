"""The tables of chapter 6 from the twins: calibration, errors that are left, errors of each method; the tube's points.

Tables 6.1, 6.5 and 6.7 come from simulated calibration runs. A run touches every strip at the unit marks, a centimetre
each, over w = 0, 5 and 10 units (6.1.1); on the tube with w = 0 only (6.3.1). The twin's reading is the closed form,
plus an error drawn from P.U. profile II, plus the printed offset, clipped at 0 and Vref; the thesis' mean offsets are
then fitted to it.

Tables 6.2-6.4 and 6.6 compare each method with the printed values.
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
from tacstrip.calibrate.offsets import mean_offsets
from tacstrip.contact.noise import Noise, add_reading_errors
from tacstrip.contact.shape import Contact
from tacstrip.contact.signature import signatures
from tacstrip.data.published import Experiment, experiments, offsets_volt, published
from tacstrip.geometry.metrics import mismatch
from tacstrip.io.runs import Runs
from tacstrip.reconstruction.profile import profile_at, profile_reconstruction
from tacstrip.reconstruction.vertex.estimate import vertex_reconstruction
from tacstrip.scan import Scan
from tacstrip.sensor.raw import invert_calibration
from tacstrip.sensor.spec import Sensor
from tacstrip.thesis.chapter6.twin import (
    LINES,
    PLACINGS,
    PROTOTYPES,
    REGIONS,
    Placing,
    calibrated,
    line_errors,
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
_HALF_DIGIT_VOLT = 0.0005
_HALF_DIGIT_PERCENT = 0.05


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


UNIT_MM = 10.0


def widths_mm(sensor: Sensor) -> tuple[float, ...]:
    """Return the lengths w of the thesis' calibration contacts [mm]."""
    return (0.0,) if sensor.kind.cylindrical else (0.0, 5.0 * UNIT_MM, 10.0 * UNIT_MM)


def calibration_runs(sensor: Sensor, random: np.random.Generator) -> Runs:
    """Return the readings of a twin's calibration contacts, all strips at every mark."""
    marks = [
        (l, w) for w in widths_mm(sensor) for l in np.arange(UNIT_MM, sensor.length_mm, UNIT_MM)
        if l + w < sensor.length_mm
    ]  # fmt: skip
    l_mm, w_mm = np.repeat(np.array(marks).T[:, :, None], sensor.strips, axis=2)  # (contacts, strips)
    ideal = signatures(sensor, l_mm, l_mm + w_mm)
    noisy = {name: add_reading_errors(k, PROFILE_II, random) for name, k in ideal.items()}
    raw = invert_calibration(sensor, noisy)
    return Runs(l_mm=l_mm, w_mm=w_mm, raw=raw, line=np.zeros(l_mm.shape, dtype=np.intp), rest={})


def calibration_rows(seeds: int) -> list[dict[str, Any]]:
    """Return, for tables 6.1, 6.5 and 6.7, the offsets [V] that the runs give: median, p05, p95, inside."""
    found = {name: _offsets(name, seeds) for name in PROTOTYPES}
    rows = []
    for printed in published()["calibration"]:
        volt = found[printed["sensor"]][printed["signature"]]  # (seeds, strips)
        median, low, high = np.percentile(volt, [50.0, 5.0, 95.0], axis=0)
        offsets = offsets_volt(printed["sensor"], printed["signature"])
        inside = (low - _HALF_DIGIT_VOLT <= offsets) & (offsets <= high + _HALF_DIGIT_VOLT)
        ours = {"median": median, "p05": low, "p95": high, "inside": inside}
        rows.append({"offset_volt": {name: values.tolist() for name, values in ours.items()}})
    return rows


def residual_rows() -> list[dict[str, Any]]:
    """Return, for tables 6.8-6.11, the errors [% of Vref] of the twins' calibrated readings.

    They are put in as printed; where they differ, a raw reading would have been below 0 or above Vref.
    """
    read = [values for name, placings in PLACINGS.items() for values in _rectangle_errors(name, placings)]
    read += list(_line_errors())
    rows = []
    for printed, ours in zip(published()["residual"], read, strict=True):
        same = np.abs(np.array(printed["percent_of_vref"]) - ours) <= _HALF_DIGIT_PERCENT
        inside = [None if np.isnan(v) else bool(s) for v, s in zip(ours, same, strict=True)]
        rows.append({"percent_of_vref": ours.tolist(), "inside": inside})
    return rows


def prototype_rows() -> list[dict[str, Any]]:
    """Return the geometry of the shipped specs under the keys of the printed one."""
    return [
        {
            "strips": s.strips,
            "strip_width_cm": s.strip_width / 10.0,
            "strip_length_cm": s.length_mm / 10.0,
            "digital_extent_cm": s.width_mm / 10.0,
            "elements_per_cm": 10.0 / s.pitch_mm,
            "radius_cm": None if s.radius_mm is None else s.radius_mm / 10.0,
            "spec": spec,
        }
        for s, spec in ((twin(name), spec) for name, spec in PROTOTYPES.items())
    ]


def recovered_points() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the tube's points: true y, y from raw and from calibrated readings, (4 lines, 2 points) each [mm].

    A point touches with w = 0, where (3.7) is k = l / L: the straight line of figure 6.34.
    """
    sensor = twin("Cyl-CRS-M")
    true, raw, good = (np.empty((len(LINES), 2)) for _ in range(3))
    for i, line in enumerate(LINES):
        strips, true[i] = [strip for strip, _ in line], [y for _, y in line]
        scan = raw_scan(sensor, line_contact(sensor, i), {"k": _on_strips(i)})
        raw[i] = scan["k"][strips] * sensor.length_mm
        good[i] = calibrated(sensor, scan)["k"][strips] * sensor.length_mm
    return true, raw, good


def line_contact(sensor: Sensor, line: int) -> Contact:
    """Return the two points of a line on the tube."""
    return Contact.points([(sensor.x_mm[strip], y) for strip, y in LINES[line]])


def _offsets(name: str, seeds: int) -> dict[str, FloatArray]:
    """Return the mean offsets of simulated runs, (seeds, strips) [V], by signature."""
    sensor = twin(name)
    plain = replace(sensor, calibration=None)
    runs = (calibration_runs(sensor, np.random.default_rng([6, seed])) for seed in range(seeds))
    fits = [mean_offsets(plain, made) for made in runs]
    volt = sensor.vref_volt
    return {s: volt * np.array([fit.channel(s).offset for fit in fits]) for s in sensor.signatures}


def _rectangle_errors(name: str, placings: dict[str, Any]) -> list[FloatArray]:
    """Return the calibrated readings' errors [% of Vref], signature by signature, region by region."""
    sensor, placing = twin(name), next(iter(placings.values()))
    plain = replace(sensor, calibration=None)
    found = []
    for signature in sorted(sensor.signatures):
        for region in REGIONS:
            contact = placing.contact(sensor, region)
            read = calibrated(sensor, raw_scan(sensor, contact, region_errors(name, region)))
            none = {s: np.zeros(sensor.strips) for s in sensor.signatures}
            found.append(100.0 * (read[signature] - raw_scan(plain, contact, none)[signature]))
    return found


def _line_errors() -> FloatArray:
    """Return the calibrated readings' errors on the tube (4 lines, strips) [% of Vref]; NaN untouched."""
    true, _, good = recovered_points()
    sensor = twin("Cyl-CRS-M")
    errors = np.full((len(LINES), sensor.strips), np.nan)
    for i, line in enumerate(LINES):
        errors[i, [strip for strip, _ in line]] = 100.0 * (good[i] - true[i]) / sensor.length_mm
    return errors


def _on_strips(line: int) -> FloatArray:
    errors = np.zeros(twin("Cyl-CRS-M").strips)
    errors[[strip for strip, _ in LINES[line]]] = line_errors()[line]
    return errors
