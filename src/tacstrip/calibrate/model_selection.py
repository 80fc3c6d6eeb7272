"""Model selection: the planned model, what the evidence of the runs adds, and which parts they leave open."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from tacstrip.calibrate.fit import ModelFit, average, fit_model, usable_rows
from tacstrip.calibrate.model import PARTS, Model, apply
from tacstrip.calibrate.place_errors import PlaceErrors, one_for_all_bars, possible_errors
from tacstrip.errors import OptionError, ReadingError, SpecError, one_of
from tacstrip.io.runs import Runs
from tacstrip.sensor.spec import Sensor

_ONE_PLACE = 0.01  # of the length: contacts nearer than this to each other are at one place
_POINT_MM = 5e-7  # contacts no longer than this have no length
_SHOW_WARP = 5  # places: offset and gain follow two of them


def needs_lengths(model: Model, runs: Runs) -> str:
    """Say which part of the model needs contacts with a length, if all are points; "" otherwise. Needs no fit."""
    if np.nanmax(runs.w_mm, initial=0.0) > _POINT_MM:
        return ""
    for part in ("ratio", "ratios", "lambda"):
        if model.has(part):
            what = "contact resistance" if part == "lambda" else "ratio of resistivities"
            remedy = PARTS[part].remedy
            return f"all contacts have w = 0, and such a contact reads the same with any {what}; {remedy}"
    return ""


def needs_places(model: Model, sensor: Sensor, runs: Runs) -> str:
    """Say which part of the model needs more places on a strip than there are; "" otherwise. Needs no fit.

    Repeats are not places, nor are contacts that differ by a hair: a curve with as many knots as there are places
    passes through each, and anywhere between. A warp's pieces are alike, and their spread is found: where a few places
    show that there is one, its deviations say how little more is known.
    """
    if not (model.has("curve") or model.has("warp")):
        return ""
    part, least = "warp", min((model.pieces + 1) // 2, _SHOW_WARP)
    if model.has("curve"):
        part, least = "curve", model.pieces + 2
    usable = usable_rows(runs)
    for strip in np.flatnonzero(np.isfinite(runs.l_mm).any(axis=0)):
        place = np.stack([runs.l_mm[usable[:, strip], strip], runs.w_mm[usable[:, strip], strip]], axis=1)
        apart = 0
        while len(place):
            far = (np.abs(place - place[0]) > _ONE_PLACE * sensor.length_mm).any(axis=1)
            place, apart = place[far], apart + 1
        if apart < least:
            return (
                f"the runs do not determine {PARTS[part].words}: strip {strip + sensor.strip_base} has {apart} "
                f"distinct places and needs {least}; {PARTS[part].remedy}"
            )
    return ""


def unidentifiable(fit: ModelFit, sensor: Sensor, runs: Runs) -> str:
    """Say which part of the model the runs do not determine and what would; "" where they determine all."""
    model = fit.constants.model
    if why := needs_lengths(model, runs) or needs_places(model, sensor, runs):
        return why
    there = np.isfinite(runs.l_mm).any(axis=0)  # strips that are not left out
    spread = dict(zip(model.shared, fit.shared_sigma, strict=True))
    spread |= dict(zip(model.own(runs.signatures), fit.own_sigma[there].max(axis=0), strict=True))
    # Where an offset and another part cannot be separated, name the other part.
    for name, sigma in sorted(spread.items(), key=lambda item: item[0].startswith("offset")):
        part = PARTS[kind := name.split()[0]]
        if not sigma <= part.most:
            if not 2.0 * sigma < 1.0:  # wider than the value itself, or than the whole scale
                return f"the runs do not determine {part.words}; {part.remedy}"
            unit = {"lambda": "L", "ratio": "of it", "ratios": "of it"}.get(kind, "Vref")
            return f"the runs determine {part.words} only to +-{2.0 * sigma:.2g} {unit}; {part.remedy}"
    try:
        apply(fit.constants, sensor)
    except SpecError as error:
        return f"{error}; {PARTS['curve' if model.has('curve') else 'offset'].remedy}"
    return ""


_WARP, _FEWEST = 16, 4  # pieces that are tried, and that a name without a number has
_SIZED = {"warp", "curve"}
_SURE = 3.0  # the logarithm of how many times likelier a part must make the readings


@dataclass(frozen=True, eq=False)
class Trial:
    """A model on trial.

    Attributes
    ----------
    name
        The model's parts.
    evidence
        Logarithm of how many times likelier it makes the readings than the chosen model; None where it was refused.
    verdict
        "chosen", "tried", or why it was refused.
    """

    name: str
    evidence: float | None
    verdict: str


def planned_model(sensor: Sensor, uneven: bool = False) -> Model:
    """Return the model that a plan is made for: what any unit has; `uneven`: and rubber that varies along y."""
    parts = {"offset", "gain", "lambda"} | ({"ratio"} if "resistivity_ratio" in sensor.kind.keys else set())
    return Model(frozenset(parts | {"warp"}), _WARP) if uneven else Model(frozenset(parts))


def fit_planned(sensor: Sensor, runs: Runs) -> ModelFit:
    """Return the fit of the planned model, or of the largest part of it that the runs determine."""
    return Search(sensor, runs).first()


def select_model(
    sensor: Sensor, runs: Runs, search: Search | None = None
) -> tuple[ModelFit, tuple[Trial, ...]]:
    """Return the fit of the model that the runs make likeliest, and all trials.

    The search starts from the planned model, as far as the runs determine it: what any unit has stays, even where it
    is small, for else the others' uncertainties would not count it. Then it finds what errors of places have in common,
    and adds the part that raises the evidence most, while one does. Where bars that are all as much longer than written
    make the runs likelier than all of that, it starts again from these. A search that has begun is gone on with.
    """
    search = search or Search(sensor, runs)
    first = search.first()
    now = search.grown(search.place_errors(first))
    bars = search.with_longer_bars(first)
    if bars and bars.evidence > now.evidence + _SURE:
        search.tried = {first.constants.model.name: bars}
        now = search.grown(bars)
    chosen = now.constants.model
    return search.averaged(now), tuple(
        Trial(name, None, t) if isinstance(t, str)
        else Trial(name, t.evidence - now.evidence, "chosen" if t.constants.model == chosen else "tried")
        for name, t in search.tried.items()
    )  # fmt: skip


class Search:
    """Models tried so far, each once."""

    def __init__(self, sensor: Sensor, runs: Runs) -> None:
        self.sensor, self.runs = sensor, runs
        self.tried: dict[str, ModelFit | str] = {}  # by name; why where it was refused

    def first(self) -> ModelFit:
        """Return the largest part of the planned model that the runs determine, offsets at least."""
        rest = planned_model(self.sensor).parts - {"offset"}
        for size in range(len(rest), 0, -1):
            models = [Model(frozenset({"offset", *parts})) for parts in combinations(sorted(rest), size)]
            possible = [m for m in models if _applicable(m, self.sensor, self.runs.signatures)]
            if found := [f for m in possible if (f := self.attempt(m, None))]:
                return max(found, key=lambda f: f.evidence)
        offsets = Model(frozenset({"offset"}))
        if not isinstance(fit := self.tried.get(offsets.name), ModelFit):
            fit = self.tried[offsets.name] = fit_model(offsets, self.sensor, self.runs)
        return fit

    def place_errors(self, fit: ModelFit) -> ModelFit:
        """Return the fit with the errors of places that the runs make likeliest; without any where none are stated."""
        model, start = fit.constants.model, fit.constants
        errors = possible_errors(self.runs, self.sensor.length_mm)
        fits = [fit_model(model, self.sensor, self.runs, start, e) for e in errors]
        stated = self.runs.l_sd_mm is not None or self.runs.w_sd_mm is not None
        likeliest = max(fits, key=lambda f: f.evidence, default=fit)
        if stated or likeliest.evidence > fit.evidence + _SURE:
            self.tried[model.name] = fit = likeliest
        return fit

    def with_longer_bars(self, fit: ModelFit) -> ModelFit | None:
        """Return the fit with bars that are all as much longer than written; None where errors of places are stated."""
        if self.runs.l_sd_mm is not None or self.runs.w_sd_mm is not None:
            return None
        bars = one_for_all_bars(self.runs, self.sensor.length_mm)
        return fit_model(fit.constants.model, self.sensor, self.runs, fit.constants, bars)

    def grown(self, fit: ModelFit) -> ModelFit:
        """Return the fit of the model with the parts that raise the evidence."""
        while True:
            found = [self.attempt(m, fit) for m in _larger(fit.constants.model, self.sensor, self.runs)]
            better = [f for f in found if f and f.evidence > fit.evidence + _SURE]
            if not better:
                return fit
            fit = max(better, key=lambda f: f.evidence)

    def averaged(self, fit: ModelFit) -> ModelFit:
        """Return the fit averaged over what the errors of its places may be, exact places too where none are stated.

        A few presses seldom tell which: deviations of the likeliest one alone would not count that.
        """
        errors: list[PlaceErrors | None] = list(possible_errors(self.runs, self.sensor.length_mm))
        if self.runs.l_sd_mm is None and self.runs.w_sd_mm is None:
            errors.append(None)
        start, now = fit.constants, fit.places
        others = [e for e in errors if not (e is now or (e and now and e.same(now)))]
        fits = [fit, *(fit_model(start.model, self.sensor, self.runs, start, e) for e in others)]
        return average(fits)

    def attempt(self, model: Model, old: ModelFit | None) -> ModelFit | None:
        """Return the fitted model, None where the runs do not determine it."""
        if model.name not in self.tried:
            self.tried[model.name] = self._try(model, old)
        result = self.tried[model.name]
        return None if isinstance(result, str) else result

    def _try(self, model: Model, old: ModelFit | None) -> ModelFit | str:
        why = needs_lengths(model, self.runs) or needs_places(model, self.sensor, self.runs)
        if not why:
            places = old.places if old else None
            fit = fit_model(model, self.sensor, self.runs, old.constants if old else None, places)
            why = unidentifiable(fit, self.sensor, self.runs)
        return f"refused: {why}" if why else fit


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
    search = Search(sensor, runs)
    return search.averaged(search.place_errors(fit))


def parse_model(text: str, sensor: Sensor, signatures: tuple[str, ...]) -> Model:
    """Return the model of a name, such as "offset+ratio+lambda" or "offset+warp8"; `OptionError` where it cannot be."""
    parts, pieces = set(), 0
    for word in text.split("+"):
        part = word.strip().rstrip("0123456789")
        if part not in PARTS:
            names = [p + str(8) if p in _SIZED else p for p in PARTS]
            raise OptionError(one_of("model part", word.strip(), ["auto", "mean", *names]))
        if number := word.strip()[len(part) :]:
            pieces = int(number[:4])
        parts.add(part)
    sized = bool(parts & _SIZED)
    model = Model(frozenset(parts), (pieces or _FEWEST) if sized else 0)
    if (pieces and not sized) or not model.pieces <= 64 or (sized and model.pieces < 2):
        raise OptionError(f"model {text!r}: only a warp or a curve has pieces, 2 to 64 of them, as in warp8")
    if not _consistent(model) or not _applicable(model, sensor, signatures):
        raise OptionError(
            f"model {text!r}: these parts do not go together on this sensor. A curve stands in place of offset, gain, "
            "fade and warp; ratio and ratios are for two layers of rubber, one of them, and ratios need k_h and k_l; "
            "a load too, and points need a load, a profile ratios; a fade needs an offset"
        )
    return model


def _consistent(model: Model) -> bool:
    """Whether parts go together: at least one, and none that describes what another does."""
    has = model.has
    twice = has("curve") and any(has(p) for p in ("offset", "gain", "fade", "warp", "ends"))
    twice |= has("ratio") and has("ratios")
    needed = (("fade", "offset"), ("points", "load"), ("profile", "ratios"))
    alone = any(has(part) and not has(other) for part, other in needed)
    return not twice and not alone and bool(model.parts)


def _applicable(model: Model, sensor: Sensor, signatures: tuple[str, ...]) -> bool:
    """Whether the model suits the sensor's construction and the signatures that were read."""
    if model.has("load") and len(signatures) < 2:
        return False
    if not (model.has("ratio") or model.has("ratios")):
        return True
    return "resistivity_ratio" in sensor.kind.keys and (model.has("ratio") or len(signatures) == 2)


def _larger(model: Model, sensor: Sensor, runs: Runs) -> list[Model]:
    """Return the models with one part more; no curve, which corrects only contacts like those that were pressed."""
    parts = model.parts
    pair = len(runs.signatures) == 2  # one signature cannot tell a resistance at an end from offset and gain
    found = [replace(model, parts=parts | {p}) for p in ("fade", *["ends"] * pair) if p not in parts]
    found += [replace(model, parts=parts | p) for p in ({"load"}, {"load", "points"}) if pair]
    found.append(replace(model, parts=parts - {"ratio"} | {"ratios"}))
    if model.has("warp"):  # rubber that is even in one layer is in both
        found.append(replace(model, parts=parts - {"ratio"} | {"ratios", "profile"}))
    else:
        found.append(Model(parts | {"warp"}, _WARP))
    return [m for m in found if m != model and _consistent(m) and _applicable(m, sensor, runs.signatures)]
