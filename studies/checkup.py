"""Does the doctor name the right fault? Random units, recordings and defects, and a table of what was said of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from studies import doctor_limit
from studies.faults import Defect, faulty_log
from tacstrip.arrays import FloatArray
from tacstrip.contact.noise import Noise
from tacstrip.contact.shape import Contact
from tacstrip.diagnose.doctor import diagnose
from tacstrip.diagnose.faults import FAULTS, Report
from tacstrip.diagnose.log import Log
from tacstrip.sensor.constructions import CONSTRUCTIONS
from tacstrip.sensor.spec import Sensor

RATE_HERTZ = 220.0
_REST_VOLT, _TOUCH_VOLT = 0.25, 0.2
_OFFSETS = 0.06  # over Vref: as large as in tables 6.1 and 6.5

# Outlines on a unit square; the last three are concave, a ring open to one side among them.
_OUTLINES = {
    "rectangle": [(0, 0), (1, 0), (1, 1), (0, 1)],
    "triangle": [(0, 0), (1, 0.2), (0.4, 1)],
    "tetragon": [(0, 0.3), (0.5, 0), (1, 0.5), (0.4, 1)],
    "hexagon": [(0, 0.5), (0.25, 0), (0.75, 0), (1, 0.5), (0.75, 1), (0.25, 1)],
    "arrow": [(0, 0), (0.5, 0.3), (1, 0), (0.5, 1)],
    "angle": [(0, 0), (1, 0), (1, 0.4), (0.4, 0.4), (0.4, 1), (0, 1)],
    "fork": [(0, 0), (1, 0), (1, 1), (0.66, 1), (0.66, 0.4), (0.33, 0.4), (0.33, 1), (0, 1)],
}
_CONVEX = ("rectangle", "triangle", "tetragon", "hexagon")
# Faults that `Defect` does not make, but `studies/workshop.py`, or for all strips tests/diagnose/test_common_supply.py.
_ELSEWHERE = ("intermittent", "pressure", "wander", "loose-ground", "loose-supply")
HEALTHY = ("exercise", "still", "taps", "steps", "two objects", "edge", "slide", "turn", "narrow")


@dataclass(frozen=True)
class Case:
    """A unit with defects, what touches it, and how it is read."""

    sensor: Sensor
    contacts: Sequence[Contact]
    defects: tuple[Defect, ...]
    noise: Noise
    offsets: FloatArray | None
    seed: int

    def log(self) -> Log:
        """Record the unit."""
        return faulty_log(
            self.sensor, self.contacts, self.defects, self.noise, self.seed, RATE_HERTZ, self.offsets
        )

    def report(self) -> Report:
        """Record the unit and examine it."""
        return diagnose(self.log())

    def shows(self, fault: str, strips: tuple[int, ...]) -> bool:
        """Whether the readings hold a drift or a short at all (`doctor_limit.shows`); other faults do."""
        if fault not in ("drift", "short") or not strips:
            return True
        others = tuple(d for d in self.defects if (d.fault, d.strips()) != (fault, strips))
        return doctor_limit.shows(self.log(), replace(self, defects=others).log(), strips)


def unit(random: np.random.Generator, strips: int | None = None) -> Sensor:
    """Draw a sensor of 8 to 24 strips, or of so many."""
    construction = str(random.choice(["crs-crs", "crs-crs", "crs-m", "cyl-crs-m"]))
    count = int(random.integers(8, 25)) if strips is None else strips
    rest = random.random() < 0.4
    pitch = float(random.uniform(1.0, 7.0))
    length = float(random.uniform(1.0, 6.0)) * count * pitch
    kind = CONSTRUCTIONS[construction]
    rubber = "resistivity_ratio" in kind.keys
    return Sensor(
        construction=construction,
        strips=count,
        pitch_mm=pitch,
        length_mm=length,
        radius_mm=count * pitch / 5.0 if kind.cylindrical else None,
        resistivity_ratio=float(random.uniform(0.5, 2.0)) if rubber else 1.0,
        contact_lambda_mm=float(random.choice([0.0, 0.006])) * length,
        adc_bits=int(random.choice([10, 12, 14])),
        rest_volt=_REST_VOLT if rest else None,
        touch_volt=_TOUCH_VOLT if rest else None,
    )


def shape(sensor: Sensor, random: np.random.Generator, names: Sequence[str], wide: float) -> Contact:
    """Draw a contact, so many strips wide before it is turned."""
    outline = np.array(_OUTLINES[str(random.choice(list(names)))], dtype=float)
    size = np.array([wide * sensor.pitch_mm, random.uniform(0.12, 0.35) * sensor.length_mm])
    return Contact.polygon(outline * size)


def exercise(
    sensor: Sensor, random: np.random.Generator, scans: int, names: Sequence[str] = _CONVEX
) -> list[Contact]:
    """Return what docs/guide/doctor.md asks for: a wide contact that goes along and across all strips, and turns."""
    wide = max(5.0, random.uniform(0.4, 0.7) * sensor.strips)
    contact = shape(sensor, random, names, wide)
    share = np.linspace(0.0, 1.0, scans)
    across, along, back = (
        np.abs(2.0 * ((cycles * share + random.uniform(0.0, 1.0)) % 1.0) - 1.0) for cycles in (3.0, 5.0, 8.0)
    )
    tilt = random.uniform(0.35, 0.6) * (2.0 * back - 1.0)
    placed = [
        contact.turned(float(a)).placed(float(x) * sensor.width_mm, float(y) * sensor.length_mm)
        for a, x, y in zip(tilt, across, along, strict=True)
    ]
    return [_on(sensor, c) for c in placed]


def healthy(seed: int, scans: int = 360) -> Case:
    """Draw a unit without defects and a recording of any kind, the doctor's own exercise or not."""
    random = np.random.default_rng([seed, 1])
    sensor = unit(random, strips=int(random.choice([10, 10, 16, 24, 100])))
    kind = HEALTHY[seed % len(HEALTHY)]
    contacts = _recording(sensor, random, kind, scans if sensor.strips < 100 else 120)
    offsets = random.uniform(0.0, _OFFSETS, sensor.strips) if random.random() < 0.4 else None
    noise = Noise(positional=float(random.choice([0.001, 0.005, 0.01])))
    return Case(sensor, contacts, (), noise, offsets, seed)


def _recording(sensor: Sensor, random: np.random.Generator, kind: str, scans: int) -> list[Contact]:
    every = list(_OUTLINES)
    if kind == "exercise":
        return exercise(sensor, random, scans, every)
    wide = 2.0 if kind == "narrow" else random.uniform(0.3, 0.8) * sensor.strips
    contact = shape(sensor, random, every, wide)
    start, end = random.uniform(0.15, 0.85, (2, 2)) * (sensor.width_mm, sensor.length_mm)
    if kind == "edge":
        end = np.array([start[0], float(random.choice([0.0, 1.0])) * sensor.length_mm])
    if kind == "two objects":
        contact = contact.placed(*start) + shape(sensor, random, every, 4.0).placed(*end)
        sway = 0.1 * np.sin(np.linspace(0.0, 9.0, scans))
        return [_on(sensor, contact.moved(s * sensor.width_mm, s * sensor.length_mm)) for s in sway]
    contact = contact.turned(float(random.uniform(-0.6, 0.6)))
    if kind == "still":
        return [_on(sensor, contact.placed(*start))] * scans
    if kind == "taps":
        spots = random.uniform(0.0, 1.0, (scans // 20, 2)) * (sensor.width_mm, sensor.length_mm)
        return [_on(sensor, contact.placed(x, y)) for x, y in spots for _ in range(20)]
    if kind == "steps":
        return [_on(sensor, c) for c in contact.dragged([start, end], 5, 0.6)]
    turn = 1.5 / scans if kind == "turn" else 0.0
    return [_on(sensor, c) for c in contact.dragged([start, end], scans, turn)]


def _on(sensor: Sensor, contact: Contact) -> Contact:
    """Bring a contact back onto the sensor if it lies beside it; keep metal strips from being shorted end to end."""
    low, high = 0.04 * sensor.length_mm, 0.96 * sensor.length_mm
    x, y = contact.centroid
    contact = contact.placed(
        float(np.clip(x, 0.0, sensor.width_mm)), float(np.clip(y, 0.0, sensor.length_mm))
    )
    bounds = np.array([s.bounds for s in contact.shapes])
    if bounds[:, 1].min() < low and bounds[:, 3].max() > high:
        contact = contact.placed(float(contact.centroid[0]), sensor.length_mm / 2.0)
        contact = contact.clipped(sensor.width_mm, high, "sensor")
    return contact


def faulty(seed: int, many: int = 1, scans: int = 600, faults: Sequence[str] = ()) -> Case:
    """Draw a unit with so many defects of different kinds on strips of their own, and the doctor's exercise."""
    random = np.random.default_rng([seed, 2, many])
    sensor = replace(unit(random), adc_bits=12)
    kinds = [
        k
        for k in faults or [f for f, row in FAULTS.items() if row.severity != "note" and f not in _ELSEWHERE]
        if _possible(k, sensor)
    ]
    first = kinds[seed % len(kinds)]
    others = [k for k in kinds if k != first]
    chosen = [first, *map(str, random.choice(others, many - 1, replace=False))]
    places = list(random.permutation(sensor.strips - 1))
    taken: set[int] = set()
    defects = []
    for kind in chosen:
        strip = next(int(p) for p in places if not {int(p) + d for d in (-1, 0, 1, 2)} & taken)
        taken |= {strip, strip + 1}
        defects.append(defect(kind, strip, sensor, random))
    noise = Noise(positional=float(random.choice([0.001, 0.002, 0.005])))
    offsets = random.uniform(0.0, _OFFSETS, sensor.strips) if random.random() < 0.25 else None
    return Case(sensor, exercise(sensor, random, scans), tuple(defects), noise, offsets, seed)


def _possible(fault: str, sensor: Sensor) -> bool:
    """Whether a sensor can have a fault: strips over metal are read through one sheet, without wires of their own."""
    return (
        fault not in ("open-sensing", "swapped-wires", "tied-wires", "dead", "stuck")
        or len(sensor.signatures) == 2
    )


def defect(fault: str, strip: int, sensor: Sensor, random: np.random.Generator) -> Defect:
    """Draw a defect's size, and whether all strips have it where they can: one time of four."""
    together = (
        ("saturation", "hum", "noise")
        if sensor.rest_volt is None
        else ("saturation", "drift", "hum", "noise")
    )
    alone = None if fault in together and random.random() < 0.25 else strip
    one_of_two = str(random.choice(list(sensor.signatures)))
    size = {
        "open-strip": random.uniform(0.1, 0.9),
        "open-sensing": random.uniform(0.35, 0.65),
        "short": random.uniform(0.05, 0.95),
        "dead": (sensor.rest_volt or 0.0) / sensor.vref_volt,
        "stuck": random.uniform(0.1, 0.9),
        "saturation": random.uniform(0.5, 0.75),
        "wrong-vref": random.choice([0.8, 0.9, 1.1, 1.25]),
        "drift": random.choice([-1.0, 1.0]) * random.uniform(0.025, 0.035 if sensor.rest_volt else 0.06),
        "hum": random.uniform(0.01, 0.03),
        "noise": random.uniform(0.012, 0.02) if alone is None else random.uniform(0.02, 0.04),
        "bits": float(random.integers(2, 5)),
        "swapped-ends": float(random.integers(0, 2)),
    }.get(fault, 0.0)
    signature = one_of_two if fault in ("dead", "stuck", "saturation") and alone is not None else None
    if fault == "short" and len(sensor.signatures) == 2:
        signature = (
            one_of_two  # of the sensing strips: between energised strips a bridge does next to nothing
        )
    hertz = float(random.choice([50.0, 60.0]))
    return Defect(fault, alone, float(size), signature, hertz)


def said(report: Report) -> list[tuple[str, tuple[int, ...]]]:
    """Return what a report names, fault and strips, each once."""
    return sorted({(f.fault, f.strips) for f in report.findings})


ASKED, NOT_SHOWN = "asked", "not in the readings"


def confusion(cases: Iterable[Case]) -> tuple[Counter[tuple[str, str]], list[Case]]:
    """Count what was injected against what was named, "-" for nothing, and return the cases that went wrong.

    A drift of all strips together is named by its note; a question with the strips and at most two causes counts as
    `ASKED`, a fault that is missed and that the readings do not hold as `NOT_SHOWN`.
    """
    table: Counter[tuple[str, str]] = Counter()
    wrong = []
    for case in cases:
        wanted = {(d.fault, d.strips()) for d in case.defects}
        report = case.report()
        found = set(said(report)) | {("drift", n.strips) for n in report.notes if n.fault == "common-drift"}
        asked = {(cause, q.strips) for q in report.questions for cause in q.causes}
        extra = sorted(f for f, _ in found - wanted)
        for fault, strips in wanted:
            verdict = (extra or ["-"])[0]
            if (fault, strips) in found:
                verdict = fault
            elif (fault, strips) in asked:
                verdict = ASKED
            elif not case.shows(fault, strips):
                verdict = NOT_SHOWN
            table[fault, verdict] += 1
        if not wanted:
            table["-", (extra or ["-"])[0]] += 1
        if found - wanted or not wanted <= found | asked:
            wrong.append(case)
    return table, wrong


def share_told(table: Counter[tuple[str, str]]) -> float:
    """Return the share of faults named or asked about, of those that the readings hold."""
    told = sum(n for (put, verdict), n in table.items() if verdict in (put, ASKED))
    return told / (table.total() - sum(n for (_, verdict), n in table.items() if verdict == NOT_SHOWN))


def table_text(table: Counter[tuple[str, str]]) -> str:
    """Write a table of `confusion`, a line per fault put in: how often it was named, and what was instead."""
    lines = []
    for put in dict.fromkeys(["-", *FAULTS]):
        named = {n: count for (given, n), count in sorted(table.items()) if given == put}
        if named:
            other = ", ".join(f"{n} {count}" for n, count in named.items() if n != put)
            lines.append(f"{put:16}{named.get(put, 0):4} of {sum(named.values()):4}   {other}".rstrip())
    right = sum(count for (put, n), count in table.items() if put == n)
    told = f"{100.0 * share_told(table):.1f} % named or asked about of those that the readings hold"
    return "\n".join([*lines, f"{'all':16}{right:4} of {table.total():4}   {told}", ""])
