"""Which model the runs bear: every part on trial, by errors on contacts that were left out of the fit."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.calibrate.fit import Fit, at_rail, fit
from tacstrip.calibrate.model import PARTS, Model, apply
from tacstrip.calibrate.residuals import residuals
from tacstrip.calibrate.told import untold
from tacstrip.errors import OptionError, ReadingError, SpecError, one_of
from tacstrip.io.runs import Runs
from tacstrip.sensor.spec import Sensor

PIECES = (4, 8, 16)
_SIZED = {"warp", "curve"}
_FOLDS = 5
_SURE = 2.0  # standard errors by which a part must lower the error
_WORTH = 0.01  # and the share of it


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


def choose(sensor: Sensor, runs: Runs) -> tuple[Fit, tuple[Trial, ...]]:
    """Return the fit of the simplest model that leaves no more error than larger ones, and all trials.

    From offsets alone, the part that lowers the error on left-out contacts most is added, while one does; then
    what the error does not surely need is dropped again. Parts may help only together, so doubt waits until the end.
    """
    search = _Search(sensor, runs, _groups(runs))
    now = search.attempt(Model(frozenset({"offset"})), None)
    assert now is not None
    while now.loss is not None:
        found = [search.attempt(m, now.fit) for m in _larger(now.model, sensor, runs)]
        lower = [r for r in found if r and r.mean < (1.0 - _WORTH) * now.mean]
        if not lower:
            break
        now = min(lower, key=lambda r: r.mean)
    shrinking = now.loss is not None
    while shrinking:
        found = [search.attempt(m, now.fit) for m in _smaller(now.model)]
        enough = [r for r in found if r and not _better(now.loss, r.loss)]
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

    def __init__(self, sensor: Sensor, runs: Runs, groups: IntArray) -> None:
        self.sensor, self.runs, self.groups = sensor, runs, groups
        self.trials: dict[str, Trial] = {}
        self.done: dict[str, _Result | None] = {}

    def attempt(self, model: Model, old: Fit | None) -> _Result | None:
        """Return the model's fit and errors, None where the runs cannot tell it."""
        if model.name not in self.done:
            self.done[model.name] = self._try(model, old)
        return self.done[model.name]

    def _try(self, model: Model, old: Fit | None) -> _Result | None:
        new = fit(model, self.sensor, self.runs, old.constants if old else None)
        why = untold(new, self.sensor, self.runs) if old else ""
        loss = None if why else _left_out(new, self.sensor, self.runs, self.groups)
        percent = None if loss is None else float(100.0 * loss.mean())
        few = "cannot be compared: too few places" if loss is None else "tried"
        self.trials[model.name] = Trial(model.name, percent, f"refused: {why}" if why else few)
        return None if old and loss is None else _Result(new, loss)


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


def _groups(runs: Runs) -> IntArray:
    """Return the number of each contact's place (contacts, strips): repeats, on any strip, have one number."""
    place = np.stack(
        [np.round(np.nan_to_num(v, nan=-1.0), 6).ravel() for v in (runs.l_mm, runs.w_mm)], axis=1
    )
    return np.asarray(np.unique(place, axis=0, return_inverse=True)[1].reshape(runs.l_mm.shape))


def _left_out(found: Fit, sensor: Sensor, runs: Runs, groups: IntArray) -> FloatArray | None:
    """Return the mean error of each place (places,) over Vref, fitted without it; None where that cannot be."""
    places = np.unique(groups[np.isfinite(runs.l_mm)])
    if len(places) < 3:
        return None
    fold = np.random.default_rng(0).permutation(np.arange(len(places)) % min(_FOLDS, len(places)))
    error, rail = np.full(runs.l_mm.shape, np.nan), at_rail(runs)
    model = found.constants.model
    for number in range(int(fold.max()) + 1):
        out = np.isin(groups, places[fold == number])
        rest = replace(runs, l_mm=np.where(out, np.nan, runs.l_mm), w_mm=np.where(out, np.nan, runs.w_mm))
        if not (np.isfinite(rest.l_mm) & ~rail).any(axis=0).all():
            return None
        try:
            other = apply(fit(model, sensor, rest, found.constants).constants, sensor)
        except SpecError:
            return None
        off = np.mean([np.abs(r) for r in residuals(other, runs).values()], axis=0)
        error[out] = off[out]
    error[rail] = np.nan
    return np.array([np.nanmean(e) for g in places if np.isfinite(e := error[groups == g]).any()])


def _better(new: FloatArray | None, old: FloatArray | None) -> bool:
    """Whether errors fell, place by place, by more than chance and by an amount that matters."""
    if new is None or old is None or len(new) != len(old):
        return False
    less = old - new
    doubt = less.std(ddof=1) / np.sqrt(len(less))
    return bool(less.mean() > max(_SURE * doubt, _WORTH * old.mean(), 1e-7))
