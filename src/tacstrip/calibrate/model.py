"""What a calibration may fit: the parts of a model, its parameters, and the raw readings that follow from them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any, NamedTuple

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.sensor.calibration import Calibration
from tacstrip.sensor.channel import Channel, fading, piecewise_map
from tacstrip.sensor.closed_form import k_h, k_l, transfer_length
from tacstrip.sensor.input_load import MOST_LOAD, lost_to_load
from tacstrip.sensor.ratio_profile import under_contact
from tacstrip.sensor.resistance import electrical_ends
from tacstrip.sensor.spec import Sensor


class Part(NamedTuple):
    """A part of a model, and what is known of its parameters before and after a fit.

    Attributes
    ----------
    words
        What it is.
    prior, most
        Standard deviation of a parameter before any contact, and the largest of one that is determined: log ratios,
        lambda / L, ends over the strip's resistance, resistivity over its mean, the rest over Vref.
    remedy
        What to do where the runs do not determine it.
    pooled
        Whether strips are alike in it: each one's own is drawn about what all share, with a spread of at most `prior`
        that the fit finds.
    """

    words: str
    prior: float
    most: float
    remedy: str
    pooled: bool = False


_DIFFERENT = "press contacts of different lengths w"
PARTS = {
    "offset": Part("an offset per strip and signature", 0.1, 0.02, "press every strip"),
    "gain": Part("a gain per strip and signature", 0.1, 0.05, "press contacts further apart along every strip"),
    "fade": Part("offsets that fade towards both ends of the scale", 0.3, 0.1, "press contacts nearer to both ends"),
    "ratio": Part("the ratio of resistivities, one for all strips", 0.5, 0.2, _DIFFERENT),
    "ratios": Part("each strip's own ratio of resistivities", 0.5, 0.2, f"{_DIFFERENT} on every strip", True),
    "profile": Part("a ratio that varies along y, strip by strip", 0.1, 0.2, f"{_DIFFERENT} along every strip", True),
    "lambda": Part("contact resistance", 0.05, 0.01, _DIFFERENT),
    "load": Part("what the converter's inputs draw", 0.005, 0.002, f"{_DIFFERENT} along every strip"),
    "points": Part("what they take from contacts without length", 0.01, 0.002, "press contacts without length too"),
    "ends": Part(
        "resistances at both ends of every strip, clamps and leads", 0.05, 0.02,
        f"{_DIFFERENT} along every strip", True,
    ),
    "warp": Part(
        "resistivity that varies along y, strip by strip", 0.5, 0.02, "press more contacts along every strip", True
    ),
    "curve": Part(
        "a monotone curve per strip and signature, in place of offset and gain", 0.1, 0.05,
        "press more contacts along every strip, near both ends too",
    ),
}  # fmt: skip
# Parts that act on a reading, wherever the contact is.
CHANNEL = frozenset(("offset", "gain", "fade", "curve"))
_LEAST_RATIO, _MOST_RATIO = 1e-3, 1e3
_LEAST_FADE, _MOST_FADE = 0.01, 0.5
_LEAST_GAIN = 0.5
_ANY = (-1.0, 1.0)  # of Vref or L: no reading and no place is further off
_NO_LENGTH = 1e-3  # of L: shorter contacts have none
_MOST_END = 0.2  # of a strip's resistance
_COSINES = 4  # of a ratio's profile
_CORRELATED = 0.2  # of L: resistivities of places so far apart correlate with 1 / e


@dataclass(frozen=True)
class Model:
    """The parts of `PARTS` that are fitted, and how many straight pieces a warp or a curve has."""

    parts: frozenset[str]
    pieces: int = 0

    @property
    def name(self) -> str:
        """The parts in their order, joined by +."""
        sized = {"warp", "curve"}
        return "+".join(f"{p}{self.pieces}" if p in sized else p for p in PARTS if p in self.parts)

    def has(self, part: str) -> bool:
        """Whether a part is fitted."""
        return part in self.parts

    @cached_property
    def knots(self) -> FloatArray:
        """Places of the knots of a warp or a curve, from 0 to 1 (knots,)."""
        return np.linspace(0.0, 1.0, self.pieces + 1)

    @cached_property
    def shared(self) -> tuple[str, ...]:
        """Names of the parameters that all strips share."""
        ratio = self.has("ratio") or self.has("ratios")  # strips' own ratios are drawn about the shared one
        return tuple(
            p
            for p in ("ratio", "lambda", "load", "points", "fade")
            if self.has(p) or (p == "ratio" and ratio)
        )

    @cache  # noqa: B019 - a handful of models, asked for in every step of a fit
    def own(self, signatures: tuple[str, ...]) -> tuple[str, ...]:
        """Names of the parameters that each strip has of its own."""
        each = [f"{part} {s}" for part in ("offset", "gain") if self.has(part) for s in signatures]
        each += ["ratios"] if self.has("ratios") else []
        each += [f"profile {i}" for i in range(1, _COSINES + 1)] if self.has("profile") else []
        each += ["ends 0", "ends 1"] if self.has("ends") else []
        each += [f"warp {i}" for i in range(1, self.pieces)] if self.has("warp") else []
        if self.has("curve"):
            each += [f"curve {s} {i}" for s in signatures for i in range(self.pieces + 1)]
        return tuple(each)


@dataclass(frozen=True, eq=False)
class Constants:
    """Values of a model's parameters.

    Attributes
    ----------
    shared
        By name: log ratio and lambda / L against the spec's, load, points, fade.
    own
        By name, (strips,): offsets, gain - 1, log of a strip's ratio over the spec's, resistances at its ends over its
        own, a warp's or a curve's knots less the straight line.
    """

    model: Model
    signatures: tuple[str, ...]
    shared: FloatArray  # (shared,)
    own: FloatArray  # (strips, own)

    def value(self, name: str) -> Any:
        """Return a parameter, shared or (strips,); 0 where the model does not have it."""
        if name in self.model.shared:
            return self.shared[self.model.shared.index(name)]
        return self.own[:, self.names.index(name)] if name in self.names else 0.0

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters that each strip has of its own."""
        return self.model.own(self.signatures)

    @property
    def size(self) -> int:
        """How many parameters there are, those of all strips counted."""
        return self.shared.size + self.own.size

    def knots(self, name: str, numbers: range) -> FloatArray:
        """Return the knots' values (strips, knots) of a warp or a curve, ends of a warp included."""
        straight = np.broadcast_to(self.model.knots, (len(self.own), self.model.pieces + 1)).copy()
        first = self.names.index(f"{name} {numbers[0]}")
        straight[:, numbers[0] : numbers[-1] + 1] += self.own[:, first : first + len(numbers)]
        return straight

    @property
    def profile(self) -> FloatArray:
        """Coefficients of the ratio's profile (strips, cosines)."""
        return np.stack([self.value(f"profile {i}") for i in range(1, _COSINES + 1)], axis=-1)

    @property
    def warp_at(self) -> FloatArray:
        """Places of the knots of `warp`, from 0 to 1 (knots,): the two ends where no warp is fitted."""
        return self.model.knots if self.model.has("warp") else np.array([0.0, 1.0])

    @property
    def warp(self) -> FloatArray:
        """Electrical place of the knots along y (strips, knots), resistances at the ends included."""
        between = np.broadcast_to(self.warp_at, (len(self.own), len(self.warp_at)))
        if self.model.has("warp"):
            between = self.knots("warp", range(1, self.model.pieces))
        if not self.model.has("ends"):
            return between
        low, high = (self.value(f"ends {i}")[:, None] for i in (0, 1))
        return np.asarray(low + (1.0 - low - high) * between)

    def curve(self, signature: str) -> FloatArray:
        """Raw readings at the knots of a signature's curve (strips, knots)."""
        return self.knots(f"curve {signature}", range(self.model.pieces + 1))


def initial_constants(
    model: Model, sensor: Sensor, signatures: tuple[str, ...], old: Constants | None = None
) -> Constants:
    """Return the parameters that a fit starts from: those of a smaller model, else the spec's."""
    first = {"lambda": sensor.contact_lambda_mm / sensor.length_mm, "fade": 0.1}
    shared = np.array([first.get(p, 0.0) for p in model.shared])
    own = np.zeros((sensor.strips, len(model.own(signatures))))
    new = Constants(model, signatures, shared, own)
    if old is not None:
        for i, name in enumerate(model.shared):
            shared[i] = old.value(name) if name in old.model.shared else shared[i]
        for i, name in enumerate(model.own(signatures)):
            if old.model.pieces == model.pieces or not name.startswith(("warp", "curve")):
                own[:, i] = old.value("ratio" if name == "ratios" and not old.model.has("ratios") else name)
    return new


def pooled_precision(model: Model, part: str) -> FloatArray:
    """Return the root R (rows, own parameters) of a pooled part's precision R'R, for a spread of 1.

    A warp's knots follow from the resistivities of its pieces, correlated with their neighbours', which add to 1.
    """
    if part != "warp":
        return np.eye({"ratios": 1, "ends": 2, "profile": _COSINES}[part])
    piece = np.arange(model.pieces) / model.pieces
    resistivity = np.exp(-np.abs(piece[:, None] - piece) / _CORRELATED)
    sums = (np.tri(model.pieces)[:-1] - model.knots[1:-1, None]) / model.pieces
    return np.asarray(np.linalg.inv(np.linalg.cholesky(sums @ resistivity @ sums.T)))


def within_bounds(constants: Constants) -> Constants:
    """Return the constants clipped to their bounds."""
    model, signatures = constants.model, constants.signatures
    gains = [np.maximum(1.0 + constants.value(f"gain {s}"), _LEAST_GAIN) for s in signatures]
    offsets = [np.abs(constants.value(f"offset {s}")) for s in signatures]
    # An offset that fades over less than itself would make readings fall where k rises.
    least = 1.05 * max(float(np.max(o / g)) for o, g in zip(offsets, gains, strict=True))
    bounds = {
        "ratio": (np.log(_LEAST_RATIO), np.log(_MOST_RATIO)),
        "ratios": (np.log(_LEAST_RATIO), np.log(_MOST_RATIO)),
        "lambda": (0.0, 1.0),
        "load": (0.0, MOST_LOAD),
        "points": (0.0, 1.0),
        "fade": (min(max(_LEAST_FADE, least), _MOST_FADE), _MOST_FADE),
        "gain": (_LEAST_GAIN - 1.0, 1.0),
        "ends": (-_MOST_END, _MOST_END),
    }
    limits = np.array([bounds.get(n.split()[0], _ANY) for n in (*model.shared, *model.own(signatures))])
    low, high = limits.reshape(-1, 2).T
    n = len(model.shared)
    shared, own = np.clip(constants.shared, low[:n], high[:n]), np.clip(constants.own, low[n:], high[n:])
    return replace(constants, shared=shared, own=own)


def predict(
    constants: Constants, sensor: Sensor, l_mm: FloatArray, w_mm: FloatArray
) -> dict[str, FloatArray]:
    """Return the raw readings of contacts (contacts, strips) over Vref, by signature.

    The forward model of what `Calibration.correct_pair` inverts.
    """
    return through_channels(constants, strip_readings(constants, sensor, l_mm, w_mm))


@np.errstate(all="ignore")  # too long a step makes knots that do not rise; the line search rejects it
def strip_readings(
    constants: Constants, sensor: Sensor, l_mm: FloatArray, w_mm: FloatArray
) -> dict[str, FloatArray]:
    """Return what arrives at the channels: readings without the errors of `CHANNEL`'s parts, by signature."""
    model, length = constants.model, sensor.length_mm
    lam = constants.value("lambda") * length if model.has("lambda") else sensor.contact_lambda_mm
    ratio: Any = sensor.sensing_ratio * np.exp(constants.value("ratios" if model.has("ratios") else "ratio"))
    if sensor.surface is None:
        t = transfer_length(w_mm, lam)
        low, high = (l_mm + t) / length, (l_mm + w_mm - t) / length
    else:
        touching = replace(sensor, contact_lambda_mm=float(lam), calibration=None)
        low, high = (v / length for v in electrical_ends(touching, l_mm, l_mm + w_mm)[:2])
    if model.has("warp") or model.has("ends"):
        start, end = constants.warp_at, constants.warp
        low, high = (piecewise_map(v, start, end) for v in (low, high))
    if model.has("profile"):
        ratio = ratio * under_contact(constants.profile, low, high - low)
    found = {
        name: (k_h if name == "kh" else k_l)(low, high - low, 1.0, ratio) for name in constants.signatures
    }
    if model.has("load"):
        drop = np.where(w_mm < _NO_LENGTH * length, constants.value("points"), 0.0)
        less = lost_to_load(low, high - low, ratio, constants.value("load"), drop)
        found = {name: found[name] - lost for name, lost in zip(("kh", "kl"), less, strict=True)}
    return found


@np.errstate(all="ignore")
def through_channels(constants: Constants, readings: dict[str, FloatArray]) -> dict[str, FloatArray]:
    """Return the raw readings of `strip_readings`."""
    model, found = constants.model, dict[str, FloatArray]()
    for name, k in readings.items():
        if model.has("curve"):
            found[name] = piecewise_map(k, model.knots, constants.curve(name))
        else:
            fade = float(constants.value("fade"))
            gain = 1.0 + constants.value(f"gain {name}")
            found[name] = np.asarray(gain * k + constants.value(f"offset {name}") * fading(k, fade))
    return found


def apply(constants: Constants, sensor: Sensor) -> Sensor:
    """Return the sensor with these constants in its keys and in its calibration.

    Raises
    ------
    SpecError
        They make no calibration: a curve or warp that does not rise.
    """
    model = constants.model
    channels = []
    for name in constants.signatures:
        keys: dict[str, Any] = {"fade": float(constants.value("fade"))}
        if model.has("curve"):
            keys = {"curve_at": tuple(model.knots), "curve": _rows(constants.curve(name))}
        if model.has("offset"):
            keys["offset"] = tuple(constants.value(f"offset {name}"))
        if model.has("gain"):
            keys["gain"] = tuple(1.0 + constants.value(f"gain {name}"))
        channels.append(Channel(signature=name, **keys))
    # The mean of the ratios goes into the spec's key, the deviation from it stays with the strip.
    ratios = constants.value("ratios" if model.has("ratios") else "ratio")
    mean = float(np.mean(ratios))
    warped = model.has("warp") or model.has("ends")
    calibration = Calibration(
        channels=tuple(channels),
        ratio=tuple(np.exp(ratios - np.mean(ratios))) if model.has("ratios") else (),
        profile=_rows(constants.profile) if model.has("profile") else (),
        warp_at=tuple(constants.warp_at) if warped else (),
        warp=_rows(constants.warp) if warped else (),
        load=float(constants.value("load")),
        model=model.name,
        sensor=sensor.fingerprint,
    )
    keys = {"calibration": calibration}
    if model.has("ratio") or model.has("ratios"):
        keys["resistivity_ratio"] = float(sensor.resistivity_ratio * np.exp(mean))
    if model.has("lambda"):
        keys["contact_lambda_mm"] = float(constants.value("lambda") * sensor.length_mm)
    return replace(sensor, **keys)


def _rows(values: FloatArray) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(float(v) for v in row) for row in values)
