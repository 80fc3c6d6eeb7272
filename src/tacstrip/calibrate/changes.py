"""What changed while runs were made: a strip that reads otherwise from some press on, a ruler that slipped, drift.

Score tests (Rao 1948): a step before each contact is one more parameter of the linearised fit, an offset of one strip
or a shift of all contacts. All are read off the same factorisation, so a test costs as much as one step of a fit.
"""

from __future__ import annotations

import numpy as np
from scipy.special import fdtrc

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.calibrate.fit import ModelFit, usable_rows
from tacstrip.calibrate.linearised import Linear, jacobian_of_places
from tacstrip.calibrate.model import predict
from tacstrip.io.runs import Runs
from tacstrip.sensor.spec import Sensor

_SURE = 5.5  # standard deviations of a step: over all places and strips, 1 in 10,000 sound runs by chance
_MATTERS = 0.002  # of Vref, or of the length: a smaller step leaves less than calibrations are asked for
_OWN, _FEWEST = 0.125, 2  # of a strip's rows, excluded where other strips' agree: no slip any more; rows
# Probability of a strip's squares beside the others'; how many times as far off.
_UNLIKELY, _TIMES = 1e-5, 2.0
_HALF = 0.5  # of a press's strips; of a strip's squares, which a step explains
_KNOWN = 1e-6  # of a step's square, what the fit's parameters leave of it
_NAMED = 4  # strips and lines


def changed(sensor: Sensor, runs: Runs, fit: ModelFit | None) -> str:
    """Say which strips, or that all, do not agree with themselves over the runs; "" where they do.

    Parameters
    ----------
    sensor, runs
        What was fitted, the sensor without a calibration.
    fit
        None for mean offsets, which tell nothing.
    """
    if fit is None or len(runs.l_mm) < _FEWEST:
        return ""
    usable = usable_rows(runs)
    out = usable & ~(fit.weight > 0.0)
    own = out & ~(out.sum(axis=1) > _HALF * usable.sum(axis=1))[:, None]
    many = own.sum(axis=0) >= np.maximum(_FEWEST, _OWN * usable.sum(axis=0))
    # Single slips stay out, and presses that no strip agrees with; a strip's contradictions speak of itself only.
    steps = whole = _Steps(sensor, runs, fit, usable & ~out)
    if many.any():
        whole = _Steps(sensor, runs, fit, usable & (~out | (own & many)))
    z, size, share = (
        np.where(many, *pair) for pair in zip(whole.of_strips(), steps.of_strips(), strict=True)
    )
    at = np.abs(z).argmax(axis=0)  # (strips,)
    strip = np.arange(sensor.strips)
    sure = _SURE * np.sqrt(max(fit.excess, 1.0))  # repeats share what the model leaves there
    stepped = (np.abs(z[at, strip]) > sure) & (np.abs(size[at, strip]) > _MATTERS)
    unlikely, off = steps.misfit()
    apart = (unlikely < _UNLIKELY) & (off > _TIMES * np.median(off)) & (off > _MATTERS)
    found = np.flatnonzero(stepped | many | apart)
    if not 0 < len(found) <= _HALF * sensor.strips and (of_all := _of_all(sensor, runs, fit, whole)):
        return of_all
    words = []
    for i in found[:_NAMED]:
        name, lines = i + sensor.strip_base, runs.line[own[:, i], i]
        if stepped[i] and (share[at[i], i] > _HALF or not many[i]):
            begin, by = runs.line[at[i] + 1, i], 100.0 * size[at[i], i]
            words.append(f"strip {name} reads otherwise from line {begin} on, by {by:+.2g} % of Vref")
        elif not many[i]:
            words.append(
                f"strip {name} is off by {100.0 * off[i]:.2g} % of Vref, the others by {100.0 * np.median(off):.2g} %"
            )
        else:
            rows = f"{len(lines)} of {usable[:, i].sum()} rows of strip {name}"
            some = ", ".join(map(str, lines[:_NAMED])) + (" ..." if len(lines) > _NAMED else "")
            words.append(f"{rows} contradict its others (lines {some})")
    if not words:
        return ""
    more = f"; and {len(found) - _NAMED} strips more" if len(found) > _NAMED else ""
    # With a warp, and a ratio that varies, in the model, uneven rubber contradicts nothing.
    uneven = (
        "cut" if fit.constants.model.has("warp") else "cut, or uneven (then press what --plan --uneven says)"
    )
    return (
        f"{'; '.join(words)}{more}: has a joint come loose on the way, were rows mixed up, or is the rubber {uneven}? "
        "Look at the wires (`tacstrip doctor`) and at these rows, and press again"
    )


def _of_all(sensor: Sensor, runs: Runs, fit: ModelFit, steps: _Steps) -> str:
    """Say how all strips read from some row on, against before: places that moved, or voltages; "" where alike."""
    by = {"place": steps.by_l, "supply": steps.predicted, "ground": 1.0 - steps.predicted}
    found = {}
    for name, readings in by.items():
        z, size, share = steps.of_all(readings)
        t = int(np.abs(z).argmax())
        # Uneven rubber bends the readings of all strips, too, but a step explains little of it.
        sure = _SURE if name == "place" else _SURE * np.sqrt(max(fit.excess, 1.0))
        matters = _MATTERS * sensor.length_mm if name == "place" else _MATTERS
        if abs(z[t]) > sure and abs(size[t]) > matters and (name == "place" or share[t] > _HALF):
            found[name] = abs(z[t]), size[t], t
    if not found:
        return ""
    surest = max(found, key=lambda name: found[name][0])
    _, size, t = found[surest]
    first = runs.line[t + 1][runs.line[t + 1] > 0].min()
    if surest == "place":
        return (
            f"from line {first} on all strips read as if contacts lay {size:+.2g} mm from where "
            "the runs say, against those before: has the ruler or its zero moved, is a bar of another width, or do "
            "readings drift? Measure the places anew, let the device warm up, and press again"
        )
    end = {"supply": "supply had changed", "ground": "ground had been lifted"}[surest]
    return (
        f"from line {first} on all strips read as if their {end} by {100.0 * size:+.2g} % of Vref, against "
        "those before: look at the wires to supply and ground, take the A/D converter's reference from the strips' own "
        "supply, and press again"
    )


class _Steps:
    """Residuals of the linearised fit, all rows that count weighed alike, and steps in the order of the contacts."""

    def __init__(self, sensor: Sensor, runs: Runs, fit: ModelFit, counts: BoolArray) -> None:
        self.sigma = np.array([fit.sigma[name] for name in runs.signatures])
        self.here = here = Linear(sensor, runs, fit.constants, self.sigma, fit.pooled, fit.places)
        self.counts = counts
        predicted = predict(fit.constants, sensor, runs.l_mm, runs.w_mm)
        self.predicted = np.stack([predicted[n] for n in runs.signatures])
        off = np.where(counts, np.stack([runs.raw[n] for n in runs.signatures]) - self.predicted, 0.0)
        system = here.eliminate(counts.astype(float))
        shared, own, errors = system.solve(here.whiten(off))
        off = off - here.by[..., : len(shared)] @ shared - here.columns @ errors
        off = off - np.einsum("scnp,np->scn", here.by[..., len(shared) :], own)
        spans = system.leverages(off.shape).reshape(sensor.strips, len(off) * len(counts), -1)
        self.own, self.common = np.split(spans, [system.q.shape[2]], axis=2)
        self.off = self._rows(here.whiten(off)[..., None])
        self.by_l = jacobian_of_places(sensor, fit.constants, runs.l_mm, runs.w_mm)[..., 0]
        self.later = np.tri(len(counts))[:, None, 1:]  # (contacts, strips, from the second on)

    def _rows(self, columns: FloatArray) -> FloatArray:
        """Return columns (signatures, contacts, strips, n) as (strips, rows, n), 0 where rows do not count."""
        columns = np.moveaxis(columns * self.counts[..., None], 2, 0)
        return columns.reshape(len(columns), -1, columns.shape[3])

    def of_strips(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return steps of a strip's offset where they are surest of all signatures, each (contacts - 1, strips).

        How many deviations, how much over Vref, and which share of the strip's squares a step explains.
        """
        z, size = [], []
        for which in range(self.here.white.shape[2]):
            step = self._rows(np.moveaxis(self.here.white[..., which], 2, 0)[..., None] * self.later)
            whole = (step**2).sum(axis=1)
            left = whole - sum(
                ((np.swapaxes(q, 1, 2) @ step) ** 2).sum(axis=1) for q in (self.own, self.common)
            )
            left = np.where(left > _KNOWN * whole, left, np.inf)
            score = (step * self.off).sum(axis=1)
            z.append((score / np.sqrt(left)).T)
            size.append((score / left).T)
        best = np.abs(z).argmax(axis=0)[None]
        surest, by = (np.take_along_axis(np.stack(v), best, axis=0)[0] for v in (z, size))
        squares = (self.off**2).sum(axis=(1, 2))
        return surest, by, (np.stack(z) ** 2).sum(axis=0) / np.maximum(squares, 1e-12)

    def misfit(self) -> tuple[FloatArray, FloatArray]:
        """Return how probable each strip's squares are beside the others', and what it is off by [Vref] (strips,)."""
        squares = (self.off**2).sum(axis=(1, 2))
        spanned = sum((q**2).sum(axis=(1, 2)) for q in (self.own, self.common))
        free = np.maximum(len(self.sigma) * self.counts.sum(axis=0) - spanned, 1.0)
        others = free.sum() - free
        rest = (squares.sum() - squares) / np.maximum(others, 1.0)
        times = np.divide(squares / free, rest, out=np.where(squares > 0.0, np.inf, 0.0), where=rest > 1e-30)
        return fdtrc(free, np.maximum(others, 1.0), times), self.sigma.max() * np.sqrt(squares / free)

    def of_all(self, by: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return steps of all rows by one number, of which readings change `by` (signatures, contacts, strips).

        Each (contacts - 1,): how many deviations, how far, and which share of all squares a step explains.
        """
        step = self._rows(self.here.whiten(np.nan_to_num(by))[..., None] * self.later)
        whole = (step**2).sum(axis=(0, 1))
        left = whole - ((np.swapaxes(self.own, 1, 2) @ step) ** 2).sum(axis=(0, 1))
        left = left - (np.einsum("srk,srn->kn", self.common, step) ** 2).sum(axis=0)
        left = np.where(left > _KNOWN * whole, left, np.inf)
        score = (step * self.off).sum(axis=(0, 1))
        return score / np.sqrt(left), score / left, score**2 / left / max((self.off**2).sum(), 1e-12)
