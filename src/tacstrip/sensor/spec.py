"""The sensor as data: `Sensor`, and its TOML file in and out."""

from __future__ import annotations

import json
import math
import operator
import re
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self, cast

import numpy as np

from tacstrip.arguments import refuse_positional
from tacstrip.arrays import FloatArray
from tacstrip.data import spec_names, spec_path
from tacstrip.errors import SpecError
from tacstrip.files import other_kind, read_text, why_unreadable, write_text
from tacstrip.notebook import Drawn, SvgPath, strip_paths
from tacstrip.sensor.calibration import Calibration
from tacstrip.sensor.constructions import CONSTRUCTIONS, Construction, check_signature, construction
from tacstrip.sensor.converter import Converter
from tacstrip.sensor.left_out import checked_names
from tacstrip.sensor.noise import Noise
from tacstrip.sensor.surface import Surface

FORMAT = 1
UNKNOWN = "?"  # the value of a key that somebody still has to fill in
_SEAM = 0.1  # pitches: no wider a gap between the last strip and the first is one, but rounding of a radius
_MOST_STRIPS = 1_000_000
_FAR = 1e9  # mm, V or a ratio: beyond it, or below 1 / it, sums and squares of them are no numbers any more
_HUGE = 10**18  # a message with more digits helps nobody

# Every key of the file, in its order, with the comment that `tacstrip init` writes beside it.
KEYS: dict[str, tuple[str, str]] = {  # key: (an example where nothing is set, comment)
    "format": ("", "version of this file's format"),
    "construction": ("", "one of: " + ", ".join(CONSTRUCTIONS)),
    "strips": ("", "number of strips, n"),
    "pitch_mm": ("", "from centre line to centre line; along the arc on a tube"),
    "length_mm": ("", "strip length L, from the grounded end (y = 0) to the end at Vref"),
    "strip_width_mm": ("3.0", "width of the rubber; unset: strips without gaps, as wide as the pitch"),
    "radius_mm": ("9.0", "radius of the tube that the strips lie on"),
    "resistivity_ratio": ("", "resistivity of the second layer over that of the energised strip"),
    "contact_lambda_mm": ("", "decay length of the contact resistance; 0: ideal contact"),
    "vref_volt": ("", "reference voltage"),
    "adc_bits": ("12", "resolution of the A/D converter; unset: not simulated, and codes cannot be read"),
    "rest_volt": ("0.0", "for logs that give volts for untouched strips: the level they rest at; set both"),
    "touch_volt": (
        "0.05",
        "a strip counts as touched when a reading is further than this from rest_volt; set both",
    ),
    "strip_base": ("0", "number of the first strip in readings files, 0 or 1; unset: 0"),
    "without": ('["2"]', 'channels left out: "7:v_h" one of a strip, "2" all of it'),
}
CALIBRATION = "calibration"  # the table that `tacstrip calibrate` adds to a spec file
NOISE = "noise"  # the table that `tacstrip noise` adds
LAYER = "layer"  # the tables of a sensor of two layers, of which `sensor.layers` knows
SURFACE = "surface"  # the table of a curved skin
ADC = "adc"  # the table of a converter with wide codes
# Keys that belong to some constructions only.
OWN_KEYS = frozenset().union(*(c.keys for c in CONSTRUCTIONS.values()))


@dataclass(frozen=True, kw_only=True)
class Sensor(Drawn):
    """A resistive hybrid tactile sensor; the keys of the spec file, in [mm] and [V].

    `calibration` turns this unit's raw readings into corrected ones where they enter (`sensor.raw`): a `Scan` is
    always a corrected one, and so is what `simulate` makes. `noise` is what errors its readings have, where that was
    measured (`tacstrip noise`): reconstructions and limits take it where they are given none. `converter` has the wide
    codes of its A/D converter, where it has some.

    Raises
    ------
    SpecError
        A value is impossible or does not belong to the construction; the message names the key.

    Examples
    --------
    >>> sensor = Sensor(construction="crs-crs", strips=10, pitch_mm=8.0, length_mm=100.0)
    >>> sensor.width_mm
    80.0
    """

    construction: str
    strips: int
    pitch_mm: float
    length_mm: float
    strip_width_mm: float | None = None
    radius_mm: float | None = None
    resistivity_ratio: float = 1.0
    contact_lambda_mm: float = 0.0
    vref_volt: float = 5.0
    adc_bits: int | None = None
    rest_volt: float | None = None
    touch_volt: float | None = None
    strip_base: int = 0
    without: tuple[str, ...] = ()
    format: int = FORMAT
    calibration: Calibration | None = None
    noise: Noise | None = None
    surface: Surface | None = None
    converter: Converter | None = None

    def __new__(cls, *values: object, **named: object) -> Self:
        """Refuse values without a name: `ArgumentError`."""
        right = 'ts.Sensor.load("sensor.toml"), or ts.Sensor(construction="crs-crs", strips=10, ...)'
        refuse_positional("ts.Sensor", values, right)
        return super().__new__(cls)

    def __repr__(self) -> str:
        bits = f", {self.adc_bits} bits" if self.adc_bits else ""
        known = (", calibrated" if self.calibration else "") + (", noise known" if self.noise else "")
        return f"<Sensor {self.fingerprint}{bits}{known}>"

    def _paths(self) -> list[SvgPath]:
        return strip_paths(self.strips, self.pitch_mm, self.strip_width, self.length_mm)

    def __post_init__(self) -> None:
        """Bring numbers to their type and refuse what cannot be."""
        for name, kind in self.__annotations__.items():
            value, optional = getattr(self, name), "None" in str(kind)
            if name not in ("construction", "without", CALIBRATION, NOISE, SURFACE, "converter") and not (
                optional and value is None
            ):
                object.__setattr__(self, name, _number(name, value, whole="int" in str(kind)))
        _check(self)
        object.__setattr__(self, "without", checked_names(self))
        if self.noise is not None and not isinstance(self.noise, Noise):
            raise SpecError(f"noise = {self.noise!r}: must be a Noise, such as ts.Noise(white=0.005)")
        if self.converter is not None:
            if not isinstance(self.converter, Converter):
                raise SpecError(f"converter = {self.converter!r}: must be a tacstrip.sensor.Converter")
            self.converter.check(self.adc_bits)
        if self.surface is not None:
            _check_surface(self, self.surface)
        if self.calibration is not None:
            _check_calibration(self, self.calibration)

    @property
    def kind(self) -> Construction:
        """The construction's row in the table."""
        return construction(self.construction)

    @property
    def signatures(self) -> tuple[str, ...]:
        """Names of the signatures that this construction measures."""
        return self.kind.signatures

    @property
    def sensing_ratio(self) -> float:
        """Resistivity of the second layer over the energised strip's; 0 for metal."""
        fixed = self.kind.sensing_ratio
        return self.resistivity_ratio if fixed is None else fixed

    @property
    def strip_width(self) -> float:
        """Width of a strip [mm]: the pitch where the spec gives none."""
        return self.pitch_mm if self.strip_width_mm is None else self.strip_width_mm

    @property
    def width_mm(self) -> float:
        """Extent of the digital dimension, n pitches [mm]."""
        return self.strips * self.pitch_mm

    @property
    def closed(self) -> bool:
        """Whether the strips go all round a tube, so that the last one lies beside the first."""
        if self.surface is not None:
            return self.surface.closed
        around = 2.0 * math.pi * (self.radius_mm or math.inf)
        return around - self.width_mm <= _SEAM * self.pitch_mm

    @property
    def adc_step(self) -> float:
        """Step of the A/D converter over Vref, 1 / (2^bits - 1); 0 where the spec gives no `adc_bits`."""
        return 0.0 if self.adc_bits is None else 1.0 / (2.0**self.adc_bits - 1.0)

    @property
    def adc_variance(self) -> float:
        """Variance of the A/D converter's rounding [Vref^2], for voltages all over the range; its wide codes count."""
        even = self.adc_step**2 / 12.0
        if self.converter is None or self.adc_bits is None:
            return even
        return self.converter.mean_square(self.adc_bits) * even

    @property
    def adc_bound(self) -> float:
        """Largest error of the A/D converter's rounding over Vref: half of its widest code."""
        return 0.5 * self.adc_step * (1.0 if self.converter is None else self.converter.widest_lsb)

    @property
    def x_mm(self) -> FloatArray:
        """Centre lines of the strips (strips,) [mm]."""
        return np.asarray((np.arange(self.strips) + 0.5) * self.pitch_mm, dtype=np.float64)

    @property
    def fingerprint(self) -> str:
        """What a calibration must agree with: construction, strips, pitch and length, and the kind of a curved skin."""
        across = f"{self.strips} strips, pitch {self.pitch_mm:.6g} mm"
        on = "" if self.surface is None else f", on a {self.surface.kind}"
        return f"{self.construction}, {across}, length {self.length_mm:.6g} mm{on}"

    def where(self, strip: int) -> str:
        """Return the name in files of a strip that is counted from 0."""
        return f"strip {strip + self.strip_base}"

    def check_signature(self, signature: str) -> str:
        """Return the name if this sensor has such a signature, else raise `SignatureError`."""
        return check_signature(self.kind, signature).name

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a spec file, or one of the shipped specs by its name (`prototype-crs-crs`, ...).

        One with two `[[layer]]` tables gives a `LayeredSensor`, which what knows one layer only refuses.

        Raises
        ------
        SpecError
            The file is missing, is not TOML, has an unknown key or an impossible value.
        """
        file = Path(path)
        try:
            if not file.exists() and str(path) in spec_names():
                file = spec_path(str(path))
            if why := why_unreadable(file):
                raise SpecError(why)
            return cls.from_dict(tomllib.loads(read_text(file)))
        except FileNotFoundError:
            shipped = ", ".join(spec_names())
            raise SpecError(
                f"{path}: no such file. Write one with `tacstrip init`, or name a shipped spec: {shipped}"
            ) from None
        except SpecError as error:
            raise SpecError(f"{path}: {error}") from None
        except (OSError, ValueError, RecursionError) as error:
            kind = other_kind(path, ".toml")
            what = f"is {kind}, not a spec (TOML)" if kind else f"not a readable TOML spec ({error})"
            raise SpecError(f"{path}: {what}. See `tacstrip init`") from None

    @classmethod
    def from_dict(cls, raw: dict[str, Any]) -> Self:
        """Make a sensor from a spec file's keys and values; errors as for `load`."""
        if LAYER in raw:
            from tacstrip.sensor.layers import LayeredSensor  # late: it is made of sensors

            return cast(Self, LayeredSensor.from_dict(raw))
        known = [*KEYS, ADC, SURFACE, NOISE, CALIBRATION]
        if unknown := [key for key in raw if key not in known]:
            raise SpecError(f"unknown key {unknown[0]!r}; the keys are: {', '.join(known)}")
        if ADC in raw:
            raw = {**raw, "converter": Converter.from_dict(raw[ADC])}
            del raw[ADC]
        if SURFACE in raw:
            raw = _with_surface(raw)
        needed = ("format", "construction", "strips", "pitch_mm", "length_mm")
        if missing := [key for key in needed if key not in raw]:
            raise SpecError(f"key {missing[0]!r} is missing; a spec needs: {', '.join(needed)}")
        if open_keys := [key for key, value in raw.items() if value == UNKNOWN]:
            raise SpecError(f"{', '.join(open_keys)}: still to be filled in, where {UNKNOWN!r} stands")
        kinds: dict[str, type[Calibration | Noise]] = {CALIBRATION: Calibration, NOISE: Noise}
        return cls(**raw | {key: kind.from_dict(raw[key]) for key, kind in kinds.items() if key in raw})

    def to_toml(self, *, strip_base: bool = False) -> str:
        """Return the spec file's text, with a comment per key; what is unset stands commented out.

        So does `strip_base = 0`, which is as if it was unset, unless `strip_base` says that it is known.
        """
        lines = ["# A resistive hybrid tactile sensor, for tacstrip. Millimetres and volts."]
        for key, (example, comment) in KEYS.items():
            value = getattr(self, key)
            if key in OWN_KEYS and key not in self.kind.keys:
                continue
            text = repr(value) if isinstance(value, int | float) else json.dumps(value, ensure_ascii=False)
            unset = value in (None, ()) or ((key, value) == ("strip_base", 0) and not strip_base)
            line = f"# {key} = {example}" if unset else f"{key} = {text}"
            lines.append(f"{line:<32} # {comment}")
        known = (self.converter, self.surface, self.noise, self.calibration)
        tables = [table.to_toml() for table in known if table is not None]
        return "\n".join(["\n".join(lines) + "\n", *tables])

    def save(self, path: str | Path) -> None:
        """Write the spec file."""
        write_text(path, self.to_toml())


def with_noise(text: str, noise: Noise) -> str:
    """Return a spec file's text with this `[noise]` table in place of its own; all else stays as it stands.

    Raises
    ------
    SpecError
        The text is no spec, or its tables are written so that one cannot be exchanged.
    """
    bare = re.sub(r"(?ms)^\[noise\][^\n]*\n?.*?(?=^\[|\Z)", "", text)
    new = bare.rstrip() + "\n\n" + noise.to_toml()
    try:
        before = tomllib.loads(text)
    except ValueError as error:
        raise SpecError(f"not a readable TOML spec ({error}). See `tacstrip init`") from None
    try:
        after = tomllib.loads(new)
        kept = Sensor.from_dict(after).noise == noise and before | {NOISE: None} == after | {NOISE: None}
    except ValueError:
        kept = False
    if not kept:
        raise SpecError(
            "its [noise] table cannot be exchanged: take it out by hand, and write the new one again"
        )
    return new


def _number(name: str, value: Any, whole: bool) -> int | float:
    try:
        if isinstance(value, bool | str):
            raise TypeError
        number = operator.index(value) if whole else float(value)
    except OverflowError:
        raise SpecError(f"{name}: the number is too large") from None
    except (TypeError, ValueError):
        wanted = "a whole number" if whole else "a number"
        raise SpecError(f"{name} = {value!r}: must be {wanted}") from None
    if whole and abs(number) > _HUGE:
        raise SpecError(f"{name}: the number is too large")
    if not abs(number) < math.inf:
        raise SpecError(f"{name} = {value!r}: must be finite")
    return number


def _check(s: Sensor) -> None:
    kind = s.kind
    for key in ("pitch_mm", "length_mm", "strip_width_mm", "radius_mm", "resistivity_ratio", "vref_volt"):
        value = getattr(s, key)
        if value is not None and value <= 0.0:
            raise SpecError(f"{key} = {value}: must be above 0")
        if value is not None and not 1.0 / _FAR <= value <= _FAR:
            raise SpecError(f"{key} = {value}: must be {1.0 / _FAR:g} to {_FAR:g}")
    given_keys = {
        "radius_mm": s.radius_mm is not None,
        "resistivity_ratio": s.resistivity_ratio != 1.0,
        "contact_lambda_mm": s.contact_lambda_mm != 0.0,
    }
    for key, given in given_keys.items():
        if given and key in OWN_KEYS and key not in kind.keys:
            owners = ", ".join(c.name for c in CONSTRUCTIONS.values() if key in c.keys)
            raise SpecError(f"{key} does not belong to a {kind.name} sensor, only to: {owners}")
        if key in kind.required and not given:
            raise SpecError(f"{key} is missing: a {kind.name} sensor needs it")
    if (s.touch_volt is None) != (s.rest_volt is None):
        here, missing = ("touch_volt", "rest_volt") if s.rest_volt is None else ("rest_volt", "touch_volt")
        raise SpecError(f"{here} is set and {missing} is not: give both or neither")
    longer = f"must not exceed length_mm = {s.length_mm}; both are millimetres"
    furthest = s.vref_volt if s.rest_volt is None else max(s.rest_volt, s.vref_volt - s.rest_volt)
    never = f"no reading is so far from rest_volt = {s.rest_volt}, so nothing would count as touched; both are volts"
    vanishing = 0.0 < s.contact_lambda_mm < 1e-200
    limits: tuple[tuple[str, bool, str], ...] = (
        ("format", s.format == FORMAT, f"this tacstrip reads format {FORMAT}"),
        ("strips", 1 <= s.strips <= _MOST_STRIPS, "must be 1 to 1000000"),
        ("strip_width_mm", s.strip_width <= s.pitch_mm, f"must not exceed pitch_mm = {s.pitch_mm}"),
        ("contact_lambda_mm", s.contact_lambda_mm >= 0.0, "must be 0 (ideal) or more"),
        ("contact_lambda_mm", not vanishing, "nothing is so short: 0 is ideal contact"),
        ("contact_lambda_mm", s.contact_lambda_mm <= s.length_mm, longer),
        ("adc_bits", s.adc_bits is None or 1 <= s.adc_bits <= 32, "must be 1 to 32"),
        ("strip_base", s.strip_base in (0, 1), "must be 0 or 1"),
        ("rest_volt", s.rest_volt is None or 0 <= s.rest_volt <= s.vref_volt, "must be 0 to vref_volt"),
        ("touch_volt", s.touch_volt is None or s.touch_volt > 0.0, "must be above 0"),
        ("touch_volt", s.rest_volt is None or (s.touch_volt or 0.0) <= furthest, never),
    )
    for key, good, advice in limits:
        if not good:
            raise SpecError(f"{key} = {getattr(s, key)}: {advice}")
    if s.radius_mm is not None and s.width_mm > 2.0 * math.pi * s.radius_mm * (1.0 + 1e-9):
        around = 2.0 * math.pi * s.radius_mm
        raise SpecError(
            f"radius_mm = {s.radius_mm}: {s.strips} strips of pitch_mm = {s.pitch_mm:.6g} do not fit round "
            f"{around:.6g} mm; that is pitch_mm = {math.floor(1e4 * around / s.strips) / 1e4:g} at most"
        )


def _with_surface(raw: dict[str, Any]) -> dict[str, Any]:
    """Return a spec's keys with the surface made, and pitch and length as it has them where they are left out."""
    surface = Surface.from_dict(raw[SURFACE])
    strips = raw.get("strips")
    known: dict[str, Any] = {SURFACE: surface}
    if isinstance(strips, int) and 1 <= strips <= _MOST_STRIPS:
        known = {"pitch_mm": surface.pitch_mm(strips), "length_mm": surface.length_mm(strips)} | known
    return known | {key: value for key, value in raw.items() if key != SURFACE}


def _check_surface(s: Sensor, surface: Any) -> None:
    if not isinstance(surface, Surface):
        raise SpecError(
            f'surface = {surface!r}: must be a Surface, such as Surface(kind="sphere", radius_mm=10.0)'
        )
    if s.kind.cylindrical or not s.kind.closed_form:
        why = "has a radius_mm of its own" if s.kind.cylindrical else "has no closed form, and is flat"
        raise SpecError(f"[surface] is not for a {s.construction} sensor, which {why}")
    surface.check_strips(s.strips, s.pitch_mm, s.length_mm, s.strip_width)


def _check_calibration(s: Sensor, calibration: Any) -> None:
    if not isinstance(calibration, Calibration):
        raise SpecError(f"calibration = {calibration!r}: must be a Calibration")
    if not s.kind.closed_form:
        raise SpecError(
            f"a {s.construction} sensor takes no calibration: its strips shift each other's readings (3.3), so "
            "constants per strip do not describe it"
        )
    calibration.check(s.strips, s.signatures, s.fingerprint)
