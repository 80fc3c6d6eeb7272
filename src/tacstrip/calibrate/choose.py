"""Which model the runs bear: what a plan is made for, and what errors on left-out places show to be needed beyond."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.special import chdtri, stdtrit

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.calibrate.fit import Fit, at_rail, fit
from tacstrip.calibrate.model import PARTS, Model, apply, predict
from tacstrip.calibrate.residuals import residuals
from tacstrip.calibrate.told import untold
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


def planned(sensor: Sensor) -> Model:
    """Return the model that a plan is made for, by default: what any unit has."""
    rubber = "resistivity_ratio" in sensor.kind.keys
    return Model(frozenset(("offset", "gain", "lambda", *(("ratio",) if rubber else ()))))


def told(sensor: Sensor, runs: Runs) -> Fit:
    """Return the fit of the planned model, or of the largest part of it that the runs tell."""
    return _Search(sensor, runs).first().fit


def choose(sensor: Sensor, runs: Runs) -> tuple[Fit, tuple[Trial, ...]]:
    """Return the fit of the simplest model that leaves no more error than larger ones, and all trials.

    The planned model comes first, as far as the runs tell it: presses by a plan bear it out. The part that lowers the
    error on left-out places most is added, while one does. Then goes again what left-out places do not surely need,
    and of the planned model, what the readings' noise alone explains: a few places are too few to show by being left
    out that they need a gain.
    """
    search = _Search(sensor, runs)
    now = search.first()
    while now.loss is not None:
        found = [search.attempt(m, now.fit) for m in _larger(now.model, sensor, runs)]
        lower = [r for r in found if r and r.mean < (1.0 - _WORTH) * now.mean]
        if not lower:
            break
        now = min(lower, key=lambda r: r.mean)
    shrinking = True
    while shrinking:
        found = [search.attempt(m, now.fit) for m in _smaller(now.model)]
        enough = [r for r in found if r and search.as_good(r, now)]
        if shrinking := bool(enough):
            now = min(enough, key=lambda r: (r.size, r.mean))
    chosen = now.model.name
    trials = [replace(t, verdict="chosen") if t.name == chosen else t for t in search.trials.values()]
    return now.fit, tuple(trials)


@dataclass(frozen=True, eq=False)
class _Result:
    """A fitted model and its errors on left-out places (places,) over Vref."""

    fit: Fit
    loss: FloatArray | None

    @property
    def model(self) -> Model:
        return self.fit.constants.model

    @property
    def mean(self) -> float:
        return float("inf") if self.loss is None else float(self.loss.mean())

    @property
    def size(self) -> int:
        return self.fit.constants.own.size + self.fit.constants.shared.size


class _Search:
    """Models tried so far, each once."""

    def __init__(self, sensor: Sensor, runs: Runs) -> None:
        self.sensor, self.runs, self.groups = sensor, runs, _groups(sensor, runs)
        self.planned = planned(sensor).parts
        self.trials: dict[str, Trial] = {}
        self.done: dict[str, _Result | None] = {}

    def first(self) -> _Result:
        """Return the largest part of the planned model that the runs tell, offsets at least."""
        rest = self.planned - {"offset"}
        for size in range(len(rest), 0, -1):
            models = [Model(frozenset({"offset", *parts})) for parts in combinations(sorted(rest), size)]
            sound = [m for m in models if _fits(m, self.sensor, self.runs.signatures)]
            if found := [r for m in sound if (r := self.attempt(m, None))]:
                return min(found, key=lambda r: r.fit.cost)
        only = Model(frozenset({"offset"}))
        new = fit(only, self.sensor, self.runs)
        loss = _left_out(new, self.sensor, self.runs, self.groups)
        self.trials[only.name] = _trial(only, loss)
        return _Result(new, loss)

    def attempt(self, model: Model, old: Fit | None) -> _Result | None:
        """Return the model's fit and errors, None where the runs cannot tell it or cannot compare it."""
        if model.name not in self.done:
            self.done[model.name] = self._try(model, old)
        return self.done[model.name]

    def _try(self, model: Model, old: Fit | None) -> _Result | None:
        extra = not model.parts <= self.planned
        if extra and not _enough_places(model, self.runs, self.groups):
            why = "a constant of a strip needs a place of its own; press more places"
            self.trials[model.name] = Trial(model.name, None, f"refused: {why}")
            return None
        new = fit(model, self.sensor, self.runs, old.constants if old else None)
        if why := untold(new, self.sensor, self.runs):
            self.trials[model.name] = Trial(model.name, None, f"refused: {why}")
            return None
        loss = _left_out(new, self.sensor, self.runs, self.groups)
        self.trials[model.name] = _trial(model, loss)
        return None if extra and loss is None else _Result(new, loss)

    def as_good(self, small: _Result, large: _Result) -> bool:
        """Whether a smaller model does as well: by its noise where only planned parts go, else on left-out places."""
        if large.model.parts - small.model.parts <= self.planned and small.model.parts <= large.model.parts:
            return _by_chance(small.fit, large.fit, self.sensor, self.runs)
        return not _better(large.loss, small.loss)


def _trial(model: Model, loss: FloatArray | None) -> Trial:
    if loss is None:
        return Trial(model.name, None, "cannot be compared: too few places")
    return Trial(model.name, float(100.0 * loss.mean()), "tried")


def named(text: str, sensor: Sensor, runs: Runs) -> Fit:
    """Return the fit of a model by name, such as "offset+ratio+lambda" or "warp4+offset".

    Raises
    ------
    OptionError
        There is no such part, or these do not go together.
    ReadingError
        The runs cannot tell one of its parameters; the message says what would.
    """
    model = parts_of(text, sensor, runs.signatures)
    found = fit(model, sensor, runs)
    if why := untold(found, sensor, runs):
        raise ReadingError(f"the runs cannot tell a model {model.name}: {why}")
    return found


def parts_of(text: str, sensor: Sensor, signatures: tuple[str, ...]) -> Model:
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
    if not _sound(model) or not _fits(model, sensor, signatures):
        raise OptionError(
            f"model {text!r}: these parts do not go together on this sensor. A curve stands in place of offset, gain, "
            "fade and warp; ratio and ratios are for two layers of rubber, one of them, and ratios need k_h and k_l; "
            "a fade needs an offset"
        )
    return model


def _sound(model: Model) -> bool:
    """Whether parts go together: every reading has an offset or a curve, and nothing is said twice."""
    has = model.has
    twice = has("curve") and any(has(p) for p in ("offset", "gain", "fade", "warp"))
    return (
        not twice
        and not (has("ratio") and has("ratios"))
        and not (has("fade") and not has("offset"))
        and bool(model.parts)
    )


def _fits(model: Model, sensor: Sensor, signatures: tuple[str, ...]) -> bool:
    """Whether the sensor and its readings have what the model is about."""
    rubber = "resistivity_ratio" in sensor.kind.keys
    return not (model.has("ratio") or model.has("ratios")) or (
        rubber and (model.has("ratio") or len(signatures) == 2)
    )


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
    return [m for m in found if m != model and _sound(m) and _fits(m, sensor, runs.signatures)]


def _smaller(model: Model) -> list[Model]:
    """Return the models with one part less, or a simpler one."""
    found = []
    for part in model.parts:
        parts = model.parts - {part}
        found.append(Model(parts, model.pieces if parts & _SIZED else 0))
    if model.has("ratios"):
        found.append(replace(model, parts=model.parts - {"ratios"} | {"ratio"}))
    found += [replace(model, pieces=n) for n in PIECES if n < model.pieces]
    return [m for m in found if _sound(m)]


def _groups(sensor: Sensor, runs: Runs) -> IntArray:
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


def _folds(runs: Runs, groups: IntArray) -> Iterator[BoolArray]:
    """Give the contacts (contacts, strips) of the places that are left out together."""
    places = np.unique(groups[np.isfinite(runs.l_mm)])
    fold = np.random.default_rng(0).permutation(np.arange(len(places)) % min(_FOLDS, len(places)))
    for number in range(int(fold.max()) + 1):
        yield np.isin(groups, places[fold == number])


def _enough_places(model: Model, runs: Runs, groups: IntArray) -> bool:
    """Whether every strip has more places, without those left out, than numbers of its own that a signature tells.

    Repeats are no places: a curve through as many places as it has knots goes through each, and anywhere between.
    """
    numbers = len(model.own(runs.signatures[:1]))
    usable = np.isfinite(runs.l_mm) & ~at_rail(runs)
    return all(
        len(np.unique(groups[usable[:, strip] & ~out[:, strip], strip])) > numbers
        for out in _folds(runs, groups)
        for strip in range(usable.shape[1])
    )


def _left_out(found: Fit, sensor: Sensor, runs: Runs, groups: IntArray) -> FloatArray | None:
    """Return the mean error of each place (places,) over Vref, fitted without it; None where that cannot be."""
    places = np.unique(groups[np.isfinite(runs.l_mm)])
    if len(places) < 3:
        return None
    error, rail = np.full(runs.l_mm.shape, np.nan), at_rail(runs)
    for out in _folds(runs, groups):
        rest = replace(runs, l_mm=np.where(out, np.nan, runs.l_mm), w_mm=np.where(out, np.nan, runs.w_mm))
        if not (np.isfinite(rest.l_mm) & ~rail).any(axis=0).all():
            return None
        less = fit(found.constants.model, sensor, rest, found.constants)
        if found.constants.model.parts != {"offset"} and untold(less, sensor, rest):
            return None
        off = np.mean([np.abs(r) for r in residuals(apply(less.constants, sensor), runs).values()], axis=0)
        error[out] = off[out]
    error[rail] = np.nan
    return np.array([np.nanmean(e) for g in places if np.isfinite(e := error[groups == g]).any()])


def _by_chance(small: Fit, large: Fit, sensor: Sensor, runs: Runs) -> bool:
    """Whether noise alone explains what a model leaves that is part of another: a chi-square test."""
    more = sum(v.size for v in (large.constants.own, large.constants.shared))
    fewer = sum(v.size for v in (small.constants.own, small.constants.shared))
    readings = len(runs.signatures) * np.count_nonzero(large.weight)
    if readings - more < more:  # the noise is not known well enough
        return False
    rise = 0.0
    for found, sign in ((small, 1.0), (large, -1.0)):
        told = predict(found.constants, sensor, runs.l_mm, runs.w_mm)
        for name, sigma in large.sigma.items():
            gap = np.where(large.weight > 0.0, runs.raw[name] - told[name], 0.0)
            rise += sign * float((large.weight * (gap / sigma) ** 2).sum())
    return bool(rise < chdtri(more - fewer, _CHANCE))


def _better(new: FloatArray | None, old: FloatArray | None) -> bool:
    """Whether errors fell, place by place, by more than chance and by an amount that matters."""
    if new is None or old is None or len(new) != len(old):
        return False
    less = old - new
    doubt = less.std(ddof=1) / np.sqrt(len(less))
    return bool(less.mean() > max(stdtrit(len(less) - 1, _SURE) * doubt, _WORTH * old.mean(), 1e-7))
