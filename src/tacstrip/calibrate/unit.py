"""Calibrate one unit: fit, judge, and write down where it comes from."""

from __future__ import annotations

import datetime as dt
from dataclasses import dataclass, replace

import numpy as np

from tacstrip.arguments import takes
from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.calibrate.choose import Trial, choose, named, told
from tacstrip.calibrate.fit import Fit, at_rail
from tacstrip.calibrate.goodness import Goodness, judge, judge_fit
from tacstrip.calibrate.interpretation import misread, other_order
from tacstrip.calibrate.model import apply
from tacstrip.calibrate.offsets import mean_offsets, offset_sigma
from tacstrip.calibrate.residuals import residuals, rms_percent
from tacstrip.errors import OptionError, ReadingError
from tacstrip.io.runs import Runs
from tacstrip.sensor.calibration import Calibration
from tacstrip.sensor.spec import Sensor

MEAN = "mean"


@dataclass(frozen=True)
class Parameter:
    """A fitted parameter: its strip, from 0, or None where all strips share it; value and standard deviation."""

    name: str
    strip: int | None
    value: float
    sigma: float
    unit: str


@dataclass(frozen=True)
class BadRow:
    """A row of the runs that does not count: its line, strip from 0, contact [mm], and why."""

    line: int
    strip: int
    l_mm: float
    w_mm: float
    why: str


@dataclass(frozen=True, eq=False)
class Calibrated:
    """A calibrated unit and what the calibration leaves.

    Attributes
    ----------
    sensor, plain
        The sensor with its calibration, and as it was before, without any.
    runs, model
        What was fitted, by what.
    before, mean, after
        Corrected less expected readings by signature (contacts, strips) over Vref: of raw readings, of the thesis'
        mean offsets, and of this calibration.
    counted
        Rows that count (contacts, strips).
    parameters, bad, trials
        Values with their uncertainty, rows that do not count, models that were tried.
    goodness
        What is left beside the noise.
    """

    sensor: Sensor
    plain: Sensor
    runs: Runs
    model: str
    before: dict[str, FloatArray]
    mean: dict[str, FloatArray]
    after: dict[str, FloatArray]
    counted: BoolArray
    parameters: tuple[Parameter, ...]
    bad: tuple[BadRow, ...]
    trials: tuple[Trial, ...]
    goodness: Goodness

    @property
    def status(self) -> str:
        """Whether these constants describe the unit, "ok", or not, "doubtful"; `advice` says why and what to do."""
        return "doubtful" if self.goodness.doubt or self.goodness.ill_strips() else "ok"

    @property
    def advice(self) -> str:
        """What to do about a fit that is doubtful, or leaves more than noise; "" where all is well."""
        good = self.goodness
        if good.doubt:
            return (
                f"{good.doubt}: the runs do not describe this sensor. Are they of this unit, in the order of their "
                "rows, and the places in millimetres from the grounded end? The report draws each strip's readings"
            )
        if ill := good.ill_strips():
            names = ", ".join(str(i + self.plain.strip_base) for i in ill)
            worst = 100.0 * float(good.strips[ill].max())
            return (
                f"strip {names} is off by {worst:.2g} % of Vref, the median strip by {100.0 * good.left:.2g} %: "
                "look at its wires (`tacstrip doctor`) and at its rows, and press it again"
            )
        if good.repeated and good.left > max(3.0 * good.noise, 0.001):
            return (
                f"{100.0 * good.left:.2g} % of Vref is left, and by its repeats the readings' noise is "
                f"{100.0 * good.noise:.2g} %: is the rubber not uniform, or are places not exact? Press more places"
            )
        return ""

    def rms_percent(self, off: dict[str, FloatArray]) -> float:
        """Return the root mean square over the rows that count [% of Vref]."""
        return rms_percent({name: np.where(self.counted, v, np.nan) for name, v in off.items()})


@takes(sensor=Sensor, runs=Runs)
def calibrate_unit(
    sensor: Sensor, runs: Runs, model: str = "auto", unit: str = "", *, force: bool = False
) -> Calibrated:
    """Calibrate a unit from contacts of known place.

    Parameters
    ----------
    sensor, runs
        The sensor, and what it read; a calibration that it has already is replaced.
    model
        "auto": what cross-validation bears out; "mean": the thesis' mean offsets; or parts, "offset+ratio+lambda".
    unit
        Name of this very unit, to be kept.
    force
        Take runs that look misread: in other units, with columns exchanged, from the other end.

    Returns
    -------
    Calibrated
        Look at its `status`: "doubtful" where what is left is far above the noise, or a constant is one that no sound
        unit has.

    Raises
    ------
    OptionError
        There is no such model, or the construction has no closed form.
    ReadingError
        The runs cannot tell a part of the model that was asked for, a strip reads 0 or Vref throughout, or read in
        another way the runs fit far better; the message says which.
    """
    check(sensor)
    dead = np.flatnonzero(~(np.isfinite(runs.l_mm) & ~at_rail(runs)).any(axis=0))
    if len(dead):
        raise ReadingError(
            f"strip {dead[0] + sensor.strip_base} reads 0 or Vref in every contact: is it connected, and pressed?"
        )
    plain = replace(sensor, calibration=None)
    if not force:
        as_read = judge_fit(plain, told(plain, runs), runs)
        if why := misread(plain, runs, as_read) or other_order(sensor, runs):
            raise ReadingError(f"{why}. Put it right; if the runs are right as they are, give --force")
    thesis = replace(plain, calibration=mean_offsets(plain, runs))
    found: Fit | None = None
    trials: tuple[Trial, ...] = ()
    if model == MEAN:
        done = thesis
    elif model == "auto":
        found, trials = choose(plain, runs)
        done = apply(found.constants, plain)
    else:
        found = named(model, plain, runs)
        done = apply(found.constants, plain)
    counted = np.isfinite(runs.l_mm) if found is None else found.weight > 0.0
    after = residuals(done, runs)
    before = residuals(plain, runs)
    assert done.calibration is not None
    kept = replace(
        done.calibration,
        made=now(),
        source=one_line(runs.source),
        unit=one_line(unit or runs.unit or (sensor.calibration.unit if sensor.calibration else "")),
        before_percent=_counted_rms(before, counted),
        after_percent=_counted_rms(after, counted),
    )
    return Calibrated(
        replace(done, calibration=_with_rest(kept, sensor.calibration)), plain, runs, kept.model, before,
        residuals(thesis, runs), after, counted, _parameters(done, found, runs), _bad(runs, counted, after), trials,
        judge(plain, done, runs, found),
    )  # fmt: skip


def check(sensor: Sensor) -> None:
    """Refuse a construction whose readings constants per strip do not describe: `OptionError`."""
    if not sensor.kind.closed_form:
        raise OptionError(
            f"a {sensor.construction} sensor cannot be calibrated strip by strip: its strips shift each other's "
            "readings (3.3), so what a contact should read depends on what touches the neighbours. Measure "
            "resistivity_ratio and contact_lambda_mm and put them into the spec"
        )


def now() -> str:
    """Return the present time, for provenance."""
    return dt.datetime.now(dt.UTC).isoformat(timespec="seconds")


def one_line(text: str) -> str:
    """Return a text that a spec file can hold on one line."""
    return "".join(c if c.isprintable() else "?" for c in text)


def _counted_rms(off: dict[str, FloatArray], counted: BoolArray) -> float:
    return rms_percent({name: np.where(counted, v, np.nan) for name, v in off.items()})


def _with_rest(new: Calibration, old: Calibration | None) -> Calibration:
    """Keep the untouched strips' learned levels: another fit does not change them."""
    if old is None:
        return new
    levels = {c.signature: c for c in old.channels}
    channels = tuple(
        replace(c, rest=levels[c.signature].rest, noise=levels[c.signature].noise)
        if c.signature in levels
        else c
        for c in new.channels
    )
    return replace(new, channels=channels, touch=old.touch)


def _parameters(done: Sensor, found: Fit | None, runs: Runs) -> tuple[Parameter, ...]:
    if found is None:
        return tuple(
            Parameter(
                f"offset {channel.signature}", strip, value * done.vref_volt, sigma * done.vref_volt, "V"
            )
            for channel in (done.calibration.channels if done.calibration else ())
            for strip, (value, sigma) in enumerate(
                zip(channel.offset, offset_sigma(done, runs, channel.signature), strict=True)
            )
        )
    constants, model = found.constants, found.constants.model
    made = [
        _natural(done, name, None, float(value), float(sigma))
        for name, value, sigma in zip(model.shared, constants.shared, found.shared_sigma, strict=True)
    ]
    for i, name in enumerate(model.own(runs.signatures)):
        made += [
            _natural(
                done,
                name,
                strip,
                float(constants.own[strip, i]),
                float(found.own_sigma[strip, i]),
                model.pieces,
            )
            for strip in range(done.strips)
        ]
    return tuple(made)


def _natural(
    done: Sensor, name: str, strip: int | None, value: float, sigma: float, pieces: int = 0
) -> Parameter:
    """Return a parameter as a person reads it."""
    part, *rest = name.split()
    length, vref = done.length_mm, done.vref_volt
    if part in ("ratio", "ratios"):
        own = done.calibration.ratio[strip] if strip is not None and done.calibration else 1.0
        ratio = done.resistivity_ratio * own
        return Parameter("resistivity ratio", strip, ratio, ratio * sigma, "")
    if part == "lambda":
        return Parameter("contact lambda", strip, value * length, sigma * length, "mm")
    if part == "fade":
        return Parameter("fade", strip, value, sigma, "Vref")
    if part == "gain":
        return Parameter(name, strip, 1.0 + value, sigma, "")
    if part == "offset":
        return Parameter(name, strip, value * vref, sigma * vref, "V")
    at = int(rest[-1]) / pieces
    if part == "warp":
        return Parameter(
            f"place that has the share {at:.4g} of L",
            strip,
            (at + value) * length,
            sigma * length,
            "mm, electrical",
        )
    return Parameter(f"curve {rest[0]} at {at:.4g} Vref", strip, (at + value) * vref, sigma * vref, "V")


def _bad(runs: Runs, counted: BoolArray, after: dict[str, FloatArray]) -> tuple[BadRow, ...]:
    rail = at_rail(runs)
    rows = []
    for contact, strip in np.argwhere(np.isfinite(runs.l_mm) & ~counted):
        off = ", ".join(f"{name} {100.0 * v[contact, strip]:+.2f} %" for name, v in after.items())
        why = (
            "reads 0 or Vref: nothing exact"
            if rail[contact, strip]
            else f"off by {off} of Vref from all other rows"
        )
        place = (float(runs.l_mm[contact, strip]), float(runs.w_mm[contact, strip]))
        rows.append(BadRow(int(runs.line[contact, strip]), int(strip), *place, why))
    return tuple(sorted(rows, key=lambda r: r.line))
