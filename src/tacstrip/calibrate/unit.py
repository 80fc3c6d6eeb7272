"""Calibrate one unit: fit its constants, assess them and their accuracy, and record where they come from."""

from __future__ import annotations

import datetime as dt
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tacstrip.arguments import takes
from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.calibrate.changes import changed
from tacstrip.calibrate.fit import ModelFit, offsets_at_median, usable_rows
from tacstrip.calibrate.goodness import Goodness, assess, assess_fit, repeat_noise, spoilt
from tacstrip.calibrate.interpretation import (
    Assignment,
    exchanged_places,
    exchanged_strips,
    likelier_assignment,
    misread,
    other_assignment,
    reversed_order,
)
from tacstrip.calibrate.linearised import jacobian
from tacstrip.calibrate.model import Constants, apply, predict
from tacstrip.calibrate.model_selection import Search, Trial, fit_named, select_model
from tacstrip.calibrate.offsets import mean_offset_sigma, mean_offsets
from tacstrip.calibrate.residuals import residuals, rms_percent
from tacstrip.errors import OptionError, ReadingError
from tacstrip.io.runs import Runs
from tacstrip.sensor.calibration import Calibration
from tacstrip.sensor.left_out import leave_out, left_out
from tacstrip.sensor.raw import with_equal_codes
from tacstrip.sensor.spec import Sensor

_PLACES = 24  # along a strip
_LENGTHS = (0.0, 0.15, 0.3, 0.45)  # of a strip
_SIGMAS, _ONE_SIDE = 2.0, 1.64  # that hold 95 %: of an error about 0, of one about something large
_MOST = 0.95  # of the readings
_UNLIKELY = 1e-4  # a model's share of the evidence that is not counted


def accuracy_percent(
    sensor: Sensor, calibrated: Sensor, runs: Runs, fit: ModelFit, others: Sequence[ModelFit] = ()
) -> float:
    """Return what 95 % of corrected readings of other contacts keep, with 95 % [% of Vref].

    The readings' own noise is not counted. To the parameters' deviations comes what the correction leaves were they
    exact: one signature does not tell a contact's length, and what uneven rubber does to it depends on that. And what
    presses of uneven rubber leave beyond the noise of repeats, others leave too; where none were repeated, all of it.

    Parameters
    ----------
    sensor, calibrated
        Without and with the fit's constants.
    runs, fit
        What was fitted; the fit's covariance counts.
    others
        Fits of other models: how far their readings lie from these, and how sure they are, counts as far as the
        evidence does not rule them out (Hoeting et al. 1999, Bayesian model averaging).
    """
    l, w = (np.broadcast_to(v[:, None], (len(v), sensor.strips)) for v in _contacts(sensor.length_mm))
    raw = predict(fit.constants, sensor, l, w)
    pressed = Runs(l, w, raw, line=np.zeros(l.shape, int), rest={})
    bias = np.abs(np.stack(list(residuals(calibrated, pressed).values())))  # (signatures, contacts, strips)
    gain = np.stack([np.broadcast_to(1.0 + fit.constants.value(f"gain {s}"), sensor.strips) for s in raw])
    noise = repeat_noise(runs) or 0.0
    share = np.exp([min(f.evidence - fit.evidence, 0.0) for f in (fit, *others)])
    variance = np.zeros_like(bias)
    for f, weight in zip((fit, *others), share / share.sum(), strict=True):
        if weight < _UNLIKELY:
            continue
        # Own before shared parameters, as in the covariance.
        by = np.roll(jacobian(sensor, f.constants, l, w), -len(f.constants.shared), axis=-1)
        spread = np.einsum("scnp,npq,scnq->scn", by, f.covariance, by)
        if f.constants.model.has("warp"):
            unexplained = [s**2 - noise**2 for s in f.sigma.values()]
            spread += np.maximum(unexplained, 0.0)[:, None, None]
        off = np.stack(list(predict(f.constants, sensor, l, w).values())) - np.stack(list(raw.values()))
        variance += weight * (spread + np.nan_to_num(off) ** 2)
    sigma = np.sqrt(np.maximum(variance, 0.0)) / gain[:, None, :]
    off = np.maximum(_SIGMAS * sigma, bias + _ONE_SIDE * sigma)
    read = np.stack([(v > 0.0) & (v < 1.0) for v in raw.values()]) & (fit.weight > 0.0).any(axis=0)
    return float(100.0 * np.quantile(off[read], _MOST)) if read.any() else np.nan


def _contacts(length_mm: float) -> tuple[FloatArray, FloatArray]:
    """Return contacts of all places and of lengths up to half a strip's: l and w [mm] (contacts,)."""
    shares = np.linspace(0.02, 0.98, _PLACES)
    l, w = (v.ravel() for v in np.meshgrid(shares, _LENGTHS))
    inside = l + w <= shares[-1]
    return l[inside] * length_mm, w[inside] * length_mm


_ACCURATE = 0.3  # % of Vref: a calibration that leaves more says so
_SCALED = 0.05  # a gain that all strips share: converters and clamps make a tenth of it
_DROPS = 0.001  # of k_h + k_l: half the accuracy at most
DROP = "drop on contacts without length"
# Of L: what all bars are longer than written; less leaves less than calibrations are asked for.
_LONGER = 0.002
_CHANGED = 0.5  # % of Vref: a unit in use stays within, but for its drift


@dataclass(frozen=True)
class Parameter:
    """A fitted parameter: its strip, from 0, or None where all strips share it; value and standard deviation."""

    name: str
    strip: int | None
    value: float
    sigma: float
    unit: str


@dataclass(frozen=True)
class ExcludedRow:
    """A row of the runs that does not count: its line, strip from 0, contact [mm], and why."""

    line: int
    strip: int
    l_mm: float
    w_mm: float
    why: str


@dataclass(frozen=True, eq=False)
class Calibrated:
    """A calibrated unit and its residuals, as `calibrate_unit` returns it.

    Attributes
    ----------
    sensor, uncalibrated
        The sensor with its calibration, and as it was before, without any.
    runs, model
        What was fitted, by what.
    before, mean, after
        Corrected less expected readings by signature (contacts, strips) over Vref: of raw readings, of the thesis'
        mean offsets, and of this calibration.
    counted
        Rows that count (contacts, strips).
    parameters, excluded, trials
        Values with their uncertainty, rows that do not count, models that were tried.
    goodness
        Residual and noise.
    accuracy_percent
        What 95 % of corrected readings of other contacts keep, with 95 % [% of Vref], their own noise not counted; NaN
        for mean offsets, which have no model.
    changed
        That readings are far from the calibration that the sensor had, in words; "" where it had none, or they agree.
    longer_mm
        By how much all contacts with a length seem longer than the runs say; 0 where they do not. The constants count
        it.

    Examples
    --------
    >>> import numpy as np
    >>> import tacstrip as ts
    >>> sensor = ts.Sensor(construction="crs-m", strips=2, pitch_mm=6.5, length_mm=325.0)
    >>> l_mm = np.repeat([[50.0], [150.0], [250.0]], 2, axis=1)  # (contacts, strips)
    >>> raw = {"k": ts.signatures(sensor, l_mm, l_mm)["k"] + np.array([0.02, -0.01])}
    >>> runs = ts.Runs(l_mm, 0.0 * l_mm, raw, line=np.arange(2, 8).reshape(3, 2), rest={})
    >>> result = ts.calibrate_unit(sensor, runs, model="offset")
    >>> if result.status == "ok":
    ...     result.sensor.save("calibrated.toml")
    """

    sensor: Sensor
    uncalibrated: Sensor
    runs: Runs
    model: str
    before: dict[str, FloatArray]
    mean: dict[str, FloatArray]
    after: dict[str, FloatArray]
    counted: BoolArray
    parameters: tuple[Parameter, ...]
    excluded: tuple[ExcludedRow, ...]
    trials: tuple[Trial, ...]
    goodness: Goodness
    accuracy_percent: float
    changed: str = ""
    longer_mm: float = 0.0

    @property
    def status(self) -> str:
        """Whether these constants describe the unit, "ok", or not, "doubtful"; `advice` says why and what to do."""
        good = self.goodness
        return "doubtful" if good.doubt or good.changed or good.poor_strips else "ok"

    @property
    def advice(self) -> str:
        """What to do about a fit that is doubtful or inaccurate, or leaves more than noise; "" where all is well."""
        good = self.goodness
        if good.doubt:
            return (
                f"{good.doubt}: the runs do not describe this sensor. Are they of this unit, in the order of their "
                "rows, and the places in millimetres from the grounded end, and are vref_volt and adc_bits "
                "right? The report draws each strip's readings"
            )
        if good.changed:
            return good.changed
        if good.poor_strips:
            names = ", ".join(str(i + self.uncalibrated.strip_base) for i in good.poor_strips)
            worst = 100.0 * float(good.strips[good.poor_strips].max())
            return (
                f"strip {names} is off by {worst:.2g} % of Vref, the median strip by {100.0 * good.residual:.2g} %: "
                "look at its wires (`tacstrip doctor`) and at its rows, and press it again"
            )
        if abs(self.longer_mm) > _LONGER * self.sensor.length_mm:
            ruler = ""
            if len(self.after) == 1:  # which alone tells these apart by nothing
                ruler = "; or a ruler whose zero lies off moves all contacts alike"
            return (
                f"contacts with a length read as if all of them were {self.longer_mm:+.2g} mm longer than written, "
                "their lower ends right, against those without length, and the constants count that: measure the "
                f"bars{ruler}. Put the runs right and calibrate again"
            )
        if good.repeated and good.residual > max(3.0 * good.noise, 0.001):
            return (
                f"the residual is {100.0 * good.residual:.2g} % of Vref, and by its repeats the readings' noise is "
                f"{100.0 * good.noise:.2g} %: is the rubber not uniform, or are places not exact? Press more places, "
                "those of --plan --uneven; state errors of places as l_sd_mm and w_sd_mm"
            )
        return self.changed or self._scaled or self._inaccurate

    @property
    def _scaled(self) -> str:
        """Ask whether readings that are all too small or too large alike are so in use too; "" where they are not."""
        gains = [p.value for p in self.parameters if p.name.startswith("gain ")]
        gain = float(np.median(gains)) if gains else 1.0
        if abs(gain - 1.0) < _SCALED:
            return ""
        return (
            f"all strips read {gain:.3g} times what the spec's give, which runs alone cannot explain: resistance in "
            "the supply, or volts by another reference than vref_volt. If only these runs were read so, all later "
            "readings will be wrong by as much"
        )

    @property
    def _inaccurate(self) -> str:
        """Say that other readings are corrected less well than plans are made for; "" where they are not."""
        if not self.accuracy_percent > _ACCURATE:
            return ""
        cure = "press more places, or the same ones again, and measure them more exactly"
        drop = max((p.value for p in self.parameters if p.name == DROP), default=0.0)
        if drop > _DROPS:
            cure = (
                "the converter's inputs draw a current, which the resistance of a short contact passes badly: k_h and "
                f"k_l of contacts without length read up to {200.0 * drop:.2g} % of Vref too low. Buffer "
                "the inputs, or choose a converter that draws less"
            )
        if "warp" in self.model:
            cure = "the rubber is uneven: press the places of --plan --uneven"
            if len(self.after) == 1:
                cure += ", though one signature cannot correct that for long contacts"
        return f"other corrected readings are right to +-{self.accuracy_percent:.2g} % of Vref (95 %) only: {cure}"

    def rms_percent(self, off: dict[str, FloatArray]) -> float:
        """Return the root mean square over the rows that count [% of Vref]."""
        return rms_percent(off, self.counted)


@takes(sensor=Sensor, runs=Runs)
def calibrate_unit(
    sensor: Sensor, runs: Runs, *, model: str = "auto", unit: str = "", force: bool = False
) -> Calibrated:
    """Calibrate a unit from contacts of known place.

    Parameters
    ----------
    sensor, runs
        The sensor, and what it read; a calibration that it has already is replaced.
    model
        "auto": chosen by evidence; "mean": the thesis' mean offsets; or parts, "offset+ratio+lambda".
    unit
        Name of this very unit, kept with its calibration.
    force
        Take runs that look misread: in other units, with columns exchanged, from the other end.

    Returns
    -------
    Calibrated
        Look at its `status`: "doubtful" where the residual is far above the noise, or a constant has a value that no
        sound unit has.

    Raises
    ------
    OptionError
        There is no such model, or the construction has no closed form.
    ReadingError
        The runs do not determine a part of the model that was asked for, a strip reads 0 or Vref throughout, a reading
        is no number where something touches, or read in another way the runs fit far better; the message says which.

    References
    ----------
    The thesis' mean offsets: (6.1)-(6.5).

    Examples
    --------
    >>> import numpy as np
    >>> import tacstrip as ts
    >>> sensor = ts.Sensor(construction="crs-m", strips=2, pitch_mm=6.5, length_mm=325.0)
    >>> l_mm = np.repeat([[50.0], [150.0], [250.0]], 2, axis=1)  # (contacts, strips)
    >>> w_mm = np.zeros((3, 2))
    >>> raw = {"k": ts.signatures(sensor, l_mm, l_mm + w_mm)["k"] + np.array([0.02, -0.01])}
    >>> runs = ts.Runs(l_mm, w_mm, raw, line=np.arange(2, 8).reshape(3, 2), rest={})
    >>> result = ts.calibrate_unit(sensor, runs, model="offset")
    >>> result.status, np.round(result.sensor.calibration.channel("k").offset, 3)
    ('ok', array([ 0.02, -0.01]))
    """
    require_closed_form(sensor)
    out = np.any([np.zeros(sensor.strips, bool), *left_out(sensor).values()], axis=0)
    _refuse_unusable(sensor, runs, out)
    given, whole = runs, _fitted(runs, sensor, np.zeros_like(out))
    halves = replace(whole, raw=leave_out(sensor, whole.raw))
    runs, wide, sensor = _fitted(runs, sensor, out), sensor.converter, replace(sensor, converter=None)
    plain = replace(sensor, calibration=None)
    search = Search(plain, runs)
    other = None if force else _refuse_misread(sensor, plain, runs, search)
    with_means = replace(plain, calibration=mean_offsets(plain, halves))
    fit: ModelFit | None = None
    trials: tuple[Trial, ...] = ()
    others: list[ModelFit] = []
    if model == "auto":
        fit, trials = select_model(plain, runs, search)
        if other and (why := likelier_assignment(plain, fit, other)):
            raise ReadingError(_put_right(why))
        others = [
            f
            for f in search.tried.values()
            if isinstance(f, ModelFit) and f.constants.model != fit.constants.model
        ]
    elif model != "mean":
        fit = fit_named(model, plain, runs)
    done = with_means if fit is None else apply(_with_halves(fit.constants, plain, halves, out), plain)
    counted = np.isfinite(runs.l_mm) if fit is None else fit.weight > 0.0
    before, after = residuals(plain, runs), residuals(done, runs)
    assert done.calibration is not None
    calibration = replace(
        done.calibration,
        made=timestamp(),
        source=one_line(runs.source),
        unit=one_line(unit or runs.unit or (sensor.calibration.unit if sensor.calibration else "")),
        before_percent=rms_percent(before, counted),
        after_percent=rms_percent(after, counted),
    )
    return Calibrated(
        sensor=replace(done, calibration=_with_rest_levels(calibration, sensor.calibration), converter=wide),
        uncalibrated=replace(plain, converter=wide),
        runs=given,
        model=calibration.model,
        before=before,
        mean=residuals(with_means, runs),
        after=after,
        counted=counted,
        parameters=tuple(
            p
            for p in (_mean_parameters(done, runs) if fit is None else _parameters(done, fit))
            if p.strip is None or not out[p.strip]
        ),
        excluded=_excluded(runs, counted, after),
        trials=trials,
        goodness=replace(
            assess(plain, done, runs, fit), spoilt=spoilt(runs, fit), changed=changed(plain, runs, fit)
        ),
        accuracy_percent=np.nan
        if fit is None
        else accuracy_percent(plain, replace(done, converter=None), runs, fit, others),
        changed=_changed(sensor, runs),
        longer_mm=0.0 if fit is None or fit.places is None else fit.places.longer_mm(fit.errors),
    )


def _refuse_unusable(sensor: Sensor, runs: Runs, out: BoolArray) -> None:
    """Refuse runs with a reading that is no number, or without any of use; `out`: strips with a channel left out."""
    for name, raw in runs.raw.items():
        if len(blank := np.argwhere(np.isfinite(runs.l_mm) & ~np.isfinite(raw))):
            contact, strip = blank[0]
            raise ReadingError(
                f"contact {contact}: {name} of strip {strip + sensor.strip_base} is no number, though l_mm says it is "
                "touched: leave that place out (NaN in l_mm and w_mm, too)"
            )
    dead = np.flatnonzero(~usable_rows(runs).any(axis=0) & ~out)
    if len(dead):
        raise ReadingError(
            f"strip {dead[0] + sensor.strip_base} reads 0 or Vref in every contact: is it connected, and pressed?"
        )
    if out.all():
        raise ReadingError(
            "every strip has a channel that the spec leaves out (without): nothing can be fitted"
        )


def _refuse_misread(sensor: Sensor, plain: Sensor, runs: Runs, search: Search) -> Assignment | None:
    """Refuse runs that another reading explains far better; return the best other order of strips, if there is one.

    `plain` is the sensor without its calibration.
    """
    first = search.first()
    as_read = assess_fit(plain, first, runs)
    other = other_assignment(plain, runs, as_read.noise)
    if why := (
        misread(plain, runs, as_read)
        or reversed_order(sensor, runs)
        or exchanged_strips(plain, runs, first)
        or (other and exchanged_places(plain, as_read, other))
    ):
        raise ReadingError(_put_right(why))
    return other


def _put_right(why: str) -> str:
    return f"{why}{'' if why.endswith('?') else '.'} Put it right; if the runs are right as they are, give --force"


def _fitted(runs: Runs, sensor: Sensor, out: BoolArray) -> Runs:
    """Return what is fitted: readings by equal codes of the converter, none of strips with a channel left out."""
    raw = with_equal_codes(sensor, runs.raw)
    if not out.any():
        return replace(runs, raw=raw)
    l, w = (np.where(out, np.nan, v) for v in (runs.l_mm, runs.w_mm))
    return replace(runs, l_mm=l, w_mm=w, raw={name: np.where(out, np.nan, v) for name, v in raw.items()})


def _with_halves(constants: Constants, sensor: Sensor, halves: Runs, out: BoolArray) -> Constants:
    """Return the constants with offsets of the other channel of strips that have one left out."""
    if not out.any():
        return constants
    own = np.where(out[:, None], offsets_at_median(sensor, halves, constants).own, constants.own)
    return replace(constants, own=own)


def _changed(sensor: Sensor, runs: Runs) -> str:
    """Say that the runs are far from the calibration that the sensor had: another unit's, or drift."""
    if sensor.calibration is None or sensor.calibration.after_percent is None:
        return ""
    off = float(100.0 * np.nanmedian(np.abs(np.stack(list(residuals(sensor, runs).values())))))
    if off < max(_CHANGED, 5.0 * sensor.calibration.after_percent):
        return ""
    return (
        f"by the calibration that the spec had, the readings are off by {off:.2g} % of Vref (median): are the runs of "
        "another unit? Name units with --unit. Has this one drifted or been mended, all is well"
    )


def require_closed_form(sensor: Sensor) -> None:
    """Refuse a construction whose readings constants per strip do not describe: `OptionError`."""
    if not sensor.kind.closed_form:
        raise OptionError(
            f"a {sensor.construction} sensor cannot be calibrated strip by strip: its strips shift each other's "
            "readings (3.3), so what a contact should read depends on what touches the neighbours. Measure "
            "resistivity_ratio and contact_lambda_mm and put them into the spec"
        )


def timestamp() -> str:
    """Return the present time, for provenance."""
    return dt.datetime.now(dt.UTC).isoformat(timespec="seconds")


def one_line(text: str) -> str:
    """Return a text that a spec file can hold on one line."""
    return "".join(c if c.isprintable() else "?" for c in text)


def _with_rest_levels(new: Calibration, old: Calibration | None) -> Calibration:
    """Keep the untouched strips' learned levels: another fit does not change them."""
    if old is None:
        return new
    levels = ((c, old.channel(c.signature)) for c in new.channels)
    channels = tuple(replace(c, rest=o.rest, noise=o.noise) for c, o in levels)
    return replace(new, channels=channels, touch=old.touch)


def _mean_parameters(done: Sensor, runs: Runs) -> tuple[Parameter, ...]:
    return tuple(
        Parameter(f"offset {channel.signature}", strip, value * done.vref_volt, sigma * done.vref_volt, "V")
        for channel in (done.calibration.channels if done.calibration else ())
        for strip, (value, sigma) in enumerate(
            zip(channel.offset, mean_offset_sigma(done, runs, channel.signature), strict=True)
        )
    )


def _parameters(done: Sensor, fit: ModelFit) -> tuple[Parameter, ...]:
    constants, model = fit.constants, fit.constants.model
    shared = zip(model.shared, constants.shared, fit.shared_sigma, strict=True)
    each: list[tuple[str, int | None, float, float]] = [(name, None, *pair) for name, *pair in shared]
    own = zip(model.own(constants.signatures), constants.own.T, fit.own_sigma.T, strict=True)
    for name, values, sigmas in own:
        each += [(name, strip, *pair) for strip, pair in enumerate(zip(values, sigmas, strict=True))]
    return tuple(_physical(done, n, strip, float(v), float(s), model.pieces) for n, strip, v, s in each)


def _physical(
    done: Sensor, name: str, strip: int | None, value: float, sigma: float, pieces: int
) -> Parameter:
    """Return a parameter in physical units; `pieces` of the model's warp or curve."""
    part, *rest = name.split()
    if part in ("ratio", "ratios"):
        own = done.calibration.ratio[strip] if strip is not None and done.calibration else 1.0
        ratio = done.resistivity_ratio * own
        return Parameter("resistivity ratio", strip, ratio, ratio * sigma, "")
    at = int(rest[-1]) / pieces if part in ("warp", "curve") else 0.0
    words, base, scale, unit = {
        "profile": (f"cosine {(rest or [''])[0]} of the ratio along y", 0.0, 1.0, "of its log"),
        "lambda": ("contact lambda", 0.0, done.length_mm, "mm"),
        "load": ("input load", 0.0, 1.0, "of a strip's resistance over the input's"),
        "points": (DROP, 0.0, 1.0, "of k_h + k_l"),
        "fade": ("fade", 0.0, 1.0, "Vref"),
        "gain": (name, 1.0, 1.0, ""),
        "offset": (name, 0.0, done.vref_volt, "V"),
        "ends": (f"resistance at y = {'L' if rest == ['1'] else '0'}", 0.0, 1.0, "of the strip's"),
        "warp": (f"place that has the share {at:.4g} of L", at, done.length_mm, "mm, electrical"),
        "curve": (f"curve {(rest or [''])[0]} at {at:.4g} Vref", at, done.vref_volt, "V"),
    }[part]
    return Parameter(words, strip, (base + value) * scale, sigma * scale, unit)


def _excluded(runs: Runs, counted: BoolArray, after: dict[str, FloatArray]) -> tuple[ExcludedRow, ...]:
    usable = usable_rows(runs)
    rows = []
    for contact, strip in np.argwhere(np.isfinite(runs.l_mm) & ~counted):
        off = ", ".join(f"{name} {100.0 * v[contact, strip]:+.2f} %" for name, v in after.items())
        why = (
            f"off by {off} of Vref from all other rows" if usable[contact, strip]
            else "reads 0 or Vref, where the converter clips"
        )  # fmt: skip
        place = (float(runs.l_mm[contact, strip]), float(runs.w_mm[contact, strip]))
        rows.append(ExcludedRow(int(runs.line[contact, strip]), int(strip), *place, why))
    return tuple(sorted(rows, key=lambda r: r.line))
