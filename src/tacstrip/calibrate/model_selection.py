"""Model selection: the planned model, and what cross-validation over left-out places adds to it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import numpy as np
from scipy.special import chdtri, stdtrit

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.calibrate.fit import ModelFit, fit_model, usable_rows
from tacstrip.calibrate.identifiability import needs_lengths, unidentifiable
from tacstrip.calibrate.model import PARTS, Model, apply
from tacstrip.calibrate.residuals import residuals
from tacstrip.errors import OptionError, ReadingError, one_of
from tacstrip.io.runs import Runs
from tacstrip.sensor.spec import Sensor

PIECES = (4, 8, 16)
_SIZED = {"warp", "curve"}
_FOLDS = 5
_SURE = 0.975  # of Student's distribution: by so many standard errors a part must lower the error
_WORTH = 0.01  # and by this share of it
_CHANCE = 0.05  # that a constant of the planned model, truly 0, is kept
_ONE_PLACE = 0.01  # of the length: contacts nearer than this to each other are at one place


@dataclass(frozen=True, eq=False)
class Trial:
    """A model on trial.

    Attributes
    ----------
    name
        The model's parts.
    error_percent
        Mean error on contacts that were left out [% of Vref]; None where the model could not be tried.
    verdict
        "chosen", "tried", or why it was refused or cannot be compared.
    """

    name: str
    error_percent: float | None
    verdict: str


def planned_model(sensor: Sensor) -> Model:
    """Return the model that a plan is made for, by default: what any unit has."""
    rubber = "resistivity_ratio" in sensor.kind.keys
    return Model(frozenset(("offset", "gain", "lambda", *(("ratio",) if rubber else ()))))


def fit_planned(sensor: Sensor, runs: Runs) -> ModelFit:
    """Return the fit of the planned model, or of the largest part of it that the runs determine."""
    return _Search(sensor, runs).first().fit


def select_model(sensor: Sensor, runs: Runs) -> tuple[ModelFit, tuple[Trial, ...]]:
    """Return the fit of the simplest model that has no larger error than others, and all trials.

    The search starts from the planned model, as far as the runs determine it. It adds the part that lowers the
    cross-validated error most (places are left out in turn), while one does. Then it removes parts that do not lower
    that error significantly, and planned parts whose effect the readings' noise alone explains: cross-validation over
    a few places cannot show that a gain is needed.
    """
    search = _Search(sensor, runs)
    now = search.first()
    while now.errors is not None:
        found = [search.attempt(m, now.fit) for m in _larger(now.model, sensor, runs)]
        lower = [r for r in found if r and r.mean < (1.0 - _WORTH) * now.mean]
        if not lower:
            break
        now = min(lower, key=lambda r: r.mean)
    shrinking = True
    while shrinking:
        found = [search.attempt(m, now.fit) for m in _smaller(now.model)]
        as_good = [r for r in found if r and search.as_good(r, now)]
        if shrinking := bool(as_good):
            now = min(as_good, key=lambda r: (r.size, r.mean))
    tried = search.tried.values()
    return now.fit, tuple(t if isinstance(t, Trial) else t.trial(now.model) for t in tried)


@dataclass(frozen=True, eq=False)
class _Result:
    """A fitted model."""

    fit: ModelFit
    sensor: Sensor
    runs: Runs
    places: IntArray

    @property
    def model(self) -> Model:
        return self.fit.constants.model

    @cached_property
    def errors(self) -> FloatArray | None:
        """Its errors on left-out places (places,) over Vref; None where it cannot be compared."""
        return _left_out_errors(self.fit, self.sensor, self.runs, self.places)

    @property
    def mean(self) -> float:
        return float("inf") if self.errors is None else float(self.errors.mean())

    @property
    def size(self) -> int:
        return self.fit.constants.size

    def trial(self, chosen: Model) -> Trial:
        percent = None if self.errors is None else 100.0 * self.mean
        why = "tried" if self.errors is not None else "cannot be compared: too few places"
        return Trial(self.model.name, percent, "chosen" if self.model == chosen else why)


class _Search:
    """Models tried so far, each once."""

    def __init__(self, sensor: Sensor, runs: Runs) -> None:
        self.sensor, self.runs, self.places = sensor, runs, _place_numbers(sensor, runs)
        self.planned = planned_model(sensor).parts
        self.tried: dict[str, _Result | Trial] = {}  # by name; a trial where it was refused

    def first(self) -> _Result:
        """Return the largest part of the planned model that the runs determine, offsets at least."""
        rest = self.planned - {"offset"}
        for size in range(len(rest), 0, -1):
            models = [Model(frozenset({"offset", *parts})) for parts in combinations(sorted(rest), size)]
            possible = [m for m in models if _applicable(m, self.sensor, self.runs.signatures)]
            if found := [r for m in possible if (r := self.attempt(m, None))]:
                return min(found, key=lambda r: r.fit.cost)
        offsets = Model(frozenset({"offset"}))
        fit = fit_model(offsets, self.sensor, self.runs)
        result = self.tried[offsets.name] = _Result(fit, self.sensor, self.runs, self.places)
        return result

    def attempt(self, model: Model, old: ModelFit | None) -> _Result | None:
        """Return the fitted model, None where the runs do not determine it or cannot compare it."""
        if model.name not in self.tried:
            self.tried[model.name] = self._try(model, old)
        result = self.tried[model.name]
        if isinstance(result, Trial) or (not model.parts <= self.planned and result.errors is None):
            return None
        return result

    def _try(self, model: Model, old: ModelFit | None) -> _Result | Trial:
        why = needs_lengths(model, self.runs)
        if not model.parts <= self.planned and not _enough_places(model, self.runs, self.places):
            why = "a constant of a strip needs a place of its own; press more places"
        if not why:
            fit = fit_model(model, self.sensor, self.runs, old.constants if old else None)
            why = unidentifiable(fit, self.sensor, self.runs)
        if why:
            return Trial(model.name, None, f"refused: {why}")
        return _Result(fit, self.sensor, self.runs, self.places)

    def as_good(self, small: _Result, large: _Result) -> bool:
        """Whether a smaller model does as well.

        By the readings' noise where only planned parts go, else by the errors on left-out places.
        """
        if large.model.parts - small.model.parts <= self.planned and small.model.parts <= large.model.parts:
            return _noise_explains(small.fit, large.fit, self.runs)
        return not _significantly_lower(large.errors, small.errors)


def fit_named(text: str, sensor: Sensor, runs: Runs) -> ModelFit:
    """Return the fit of a model by name, such as "offset+ratio+lambda" or "warp4+offset".

    Raises
    ------
    OptionError
        There is no such part, or these do not go together.
    ReadingError
        The runs do not determine one of its parameters; the message says what would.
    """
    model = parse_model(text, sensor, runs.signatures)
    fit = fit_model(model, sensor, runs)
    if why := unidentifiable(fit, sensor, runs):
        raise ReadingError(f"the runs do not determine a model {model.name}: {why}")
    return fit


def parse_model(text: str, sensor: Sensor, signatures: tuple[str, ...]) -> Model:
    """Return the model of a name, such as "offset+ratio+lambda" or "offset+warp8"; `OptionError` where it cannot be."""
    parts, pieces = set(), 0
    for word in text.split("+"):
        part = word.strip().rstrip("0123456789")
        if part not in PARTS:
            names = [p + str(PIECES[1]) if p in _SIZED else p for p in PARTS]
            raise OptionError(one_of("model part", word.strip(), ["auto", "mean", *names]))
        if number := word.strip()[len(part) :]:
            pieces = int(number[:4])
        parts.add(part)
    sized = bool(parts & _SIZED)
    model = Model(frozenset(parts), (pieces or PIECES[0]) if sized else 0)
    if (pieces and not sized) or not model.pieces <= 64 or (sized and model.pieces < 2):
        raise OptionError(f"model {text!r}: only a warp or a curve has pieces, 2 to 64 of them, as in warp8")
    if not _consistent(model) or not _applicable(model, sensor, signatures):
        raise OptionError(
            f"model {text!r}: these parts do not go together on this sensor. A curve stands in place of offset, gain, "
            "fade and warp; ratio and ratios are for two layers of rubber, one of them, and ratios need k_h and k_l; "
            "a fade needs an offset"
        )
    return model


def _consistent(model: Model) -> bool:
    """Whether parts go together: at least one, and none that describes what another does."""
    has = model.has
    twice = has("curve") and any(has(p) for p in ("offset", "gain", "fade", "warp"))
    twice |= has("ratio") and has("ratios")
    return not twice and (has("offset") or not has("fade")) and bool(model.parts)


def _applicable(model: Model, sensor: Sensor, signatures: tuple[str, ...]) -> bool:
    """Whether the model suits the sensor's construction and the signatures that were read."""
    if not (model.has("ratio") or model.has("ratios")):
        return True
    return "resistivity_ratio" in sensor.kind.keys and (model.has("ratio") or len(signatures) == 2)


def _larger(model: Model, sensor: Sensor, runs: Runs) -> list[Model]:
    """Return the models with one part more, or with finer pieces."""
    parts = model.parts
    found = [replace(model, parts=parts | {p}) for p in ("ratio", "lambda", "gain", "fade") if p not in parts]
    found.append(replace(model, parts=parts - {"ratio"} | {"ratios"}))
    stiff = parts - {"offset", "gain", "fade", "warp"}
    if model.pieces:
        found += [replace(model, pieces=n) for n in PIECES if n > model.pieces]
    else:
        found += [Model(parts | {"warp"}, PIECES[0]), Model(stiff | {"curve"}, PIECES[0])]
    return [m for m in found if m != model and _consistent(m) and _applicable(m, sensor, runs.signatures)]


def _smaller(model: Model) -> list[Model]:
    """Return the models with one part less, or a simpler one."""
    found = []
    for part in model.parts:
        parts = model.parts - {part}
        found.append(Model(parts, model.pieces if parts & _SIZED else 0))
    if model.has("ratios"):
        found.append(replace(model, parts=model.parts - {"ratios"} | {"ratio"}))
    found += [replace(model, pieces=n) for n in PIECES if n < model.pieces]
    return [m for m in found if _consistent(m)]


def _place_numbers(sensor: Sensor, runs: Runs) -> IntArray:
    """Return the number of each contact's place (contacts, strips): repeats, on any strip, have one number."""
    step = _ONE_PLACE * sensor.length_mm
    place = np.stack([np.nan_to_num(v, nan=-1e9).ravel() for v in (runs.l_mm, runs.w_mm)], axis=1)
    each, back = np.unique(place, axis=0, return_inverse=True)
    number = np.full(len(each), -1)
    for i in range(len(each)):
        if number[i] < 0:
            near = (np.abs(each - each[i]) <= step).all(axis=1) & (number < 0)
            number[near] = i
    return np.asarray(number[back].reshape(runs.l_mm.shape))


def _folds(runs: Runs, places: IntArray) -> Iterator[BoolArray]:
    """Yield which contacts (contacts, strips) are left out together: all of some places."""
    every = np.unique(places[np.isfinite(runs.l_mm)])
    fold = np.random.default_rng(0).permutation(np.arange(len(every)) % min(_FOLDS, len(every)))
    for number in range(int(fold.max()) + 1):
        yield np.isin(places, every[fold == number])


def _enough_places(model: Model, runs: Runs, places: IntArray) -> bool:
    """Whether every strip has more places, without those left out, than own parameters of one signature.

    Repeats are not places: a curve with as many knots as there are places passes through each, and anywhere between.
    """
    numbers = len(model.own(runs.signatures[:1]))
    usable = usable_rows(runs)
    return all(
        len(np.unique(places[usable[:, strip] & ~out[:, strip], strip])) > numbers
        for out in _folds(runs, places)
        for strip in range(usable.shape[1])
    )


def _left_out_errors(fit: ModelFit, sensor: Sensor, runs: Runs, places: IntArray) -> FloatArray | None:
    """Return the mean error of each place (places,) over Vref, fitted without it; None where that cannot be."""
    every = np.unique(places[np.isfinite(runs.l_mm)])
    if len(every) < 3:
        return None
    model, usable = fit.constants.model, usable_rows(runs)
    error = np.full(runs.l_mm.shape, np.nan)
    for out in _folds(runs, places):
        if not (usable & ~out).any(axis=0).all():
            return None
        rest = replace(runs, l_mm=np.where(out, np.nan, runs.l_mm), w_mm=np.where(out, np.nan, runs.w_mm))
        refit = fit_model(model, sensor, rest, fit.constants)
        if model.parts != {"offset"} and unidentifiable(refit, sensor, rest):
            return None
        off = np.mean([np.abs(r) for r in residuals(apply(refit.constants, sensor), runs).values()], axis=0)
        error[out] = off[out]
    error[~usable] = np.nan
    return np.array([np.nanmean(e) for p in every if np.isfinite(e := error[places == p]).any()])


def _noise_explains(small: ModelFit, large: ModelFit, runs: Runs) -> bool:
    """Whether noise alone explains the larger residual of a model that is part of another: a chi-square test."""
    more, fewer = large.constants.size, small.constants.size
    readings = len(runs.signatures) * np.count_nonzero(large.weight)
    if readings - more < more:  # the noise is not known well enough
        return False
    rise = sum(
        float((large.weight * ((s / sigma) ** 2 - (b / sigma) ** 2)).sum())
        for s, b, sigma in zip(small.residual, large.residual, large.sigma.values(), strict=True)
    )
    return bool(rise < chdtri(more - fewer, _CHANCE))


def _significantly_lower(new: FloatArray | None, old: FloatArray | None) -> bool:
    """Whether errors fell, place by place, by more than chance and by an amount that matters (paired t-test)."""
    if new is None or old is None or len(new) != len(old):
        return False
    gain = old - new
    error = gain.std(ddof=1) / np.sqrt(len(gain))
    return bool(gain.mean() > max(stdtrit(len(gain) - 1, _SURE) * error, _WORTH * old.mean(), 1e-7))
