"""Channels that do not follow the contact: open strips, dead and stuck channels, saturation, strips never touched."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray, IntArray
from tacstrip.diagnose.neighbour_prediction import (
    Suspect,
    WorkingCopy,
    neighbour_residuals,
    predict_from_neighbours,
)
from tacstrip.diagnose.regression import correlation, most_of, passes
from tacstrip.robust import shortest_half

_INSIDE = 0.15  # over Vref: predictions this far from both rails do not agree with a reading on a rail
_RAIL = 0.012  # over Vref
_NEAR_RAIL = 0.08  # over Vref: largest offset of a channel that lies on a rail
_ALWAYS = 0.9  # of those places: an open end shows wherever the contact is
# Of those places, and of those on both rails: elsewhere the contact bridges the break.
_SHARE, _SHARE_OF_BOTH = 0.4, 0.2
_OTHER_FITS = 0.5  # of a dead channel's misfit: what the strip's other channel has at most
_SPREAD = 0.05  # over Vref: what the neighbours must move for a reading that does not
_STAYS = 0.01  # over Vref: neighbours that move less in half of the places are covered wholly, too
_MOVES = 0.2  # over Vref: what the neighbours must move for a reading that should, and does not
_MOVES_OFTEN, _PASSES = 0.12, 4  # the same of contacts that came so often
_BELOW = 0.05  # over Vref, of a contact above a cut, and of readings that no limit cuts off
_STRAYS = 2  # places
_FAR_APART = 0.3  # over Vref, of heights: a palm over the ends of some strips does not move so far
_SIDE = 0.93  # of pairs of a height on a rail and one off it, in the same order: a cut lies between
_ALL_THE_TIME, _VISITS = 0.9, 3  # of the places: an object that lies still does not come and go; visits
_RESTING = 2  # strips, beside the one in question
_ALIKE = 0.7  # correlation of a strip's neighbours that are under one object
_FEW, _SOME = 3, 8  # places
_ONE_VISIT = 0.1  # of the places: a contact that goes beyond a limit only then does so once
_ACROSS = 3  # strips, twice what the middle of a contact moves across
_FAR_FROM_REST = 2.5  # times what counts as touched
_ONE_CONTACT = 0.2  # over Vref: strips under one contact do not differ by more
_ONE_OBJECT = 0.1  # over Vref: nor do two at its rim


def on_rails(work: WorkingCopy) -> Iterator[Suspect]:
    """Find strips whose readings lie on ground or Vref where their neighbours expect something between.

    A strip cut below the contact floats up to Vref, one cut above it stays on ground; a contact across the cut reads
    as usual. A cut sensing strip loses only the reading beyond the cut, a dead wire all of them.
    """
    near = max(_RAIL, 4.0 * work.sigma)
    names = list(work.k)
    values = np.stack([work.k[n] for n in names])  # (signatures, places, strips)
    e, r = (np.stack(a) for a in zip(*(neighbour_residuals(work, n) for n in names), strict=True))
    # Beside one strip on a rail there may be another; not between two that are off it.
    gap = np.stack([work.prediction(n)[2] for n in names]) / 2.0
    inside = (e - gap > _INSIDE / 2.0) & (e + gap < 1.0 - _INSIDE / 2.0) & (np.abs(e - 0.5) < 0.5 - _INSIDE)
    # With an offset, a channel that lies on a rail reads one value next to it, its lowest or highest.
    rest, floor = _rest(work), _ground(work)
    low = values <= np.maximum(floor, np.minimum(_extreme(values), floor + _NEAR_RAIL)) + near
    high = values >= np.minimum(1.0, np.maximum(-_extreme(-values), 1.0 - _NEAR_RAIL)) - near
    silent, level = _silent(work)
    off_rails = np.asarray((inside & ~low & ~high).any(axis=0))
    ground, vref = (np.asarray(side.all(axis=0) & inside.any(axis=0)) for side in (low, high))
    if work.sensor.rest_volt is not None:
        # At a contact's rim, noise of a strip that rests makes it count as touched.
        sides = np.pad(work.there, ((0, 0), (1, 1)), constant_values=True)
        ground &= sides[:, :-2] & sides[:, 2:]
    # One channel on ground where the other is not: its wire is dead.
    off_rail = values.max(axis=0) > max(2.0 * near, floor + _NEAR_RAIL)
    single = inside & low & ~low.all(axis=0) & off_rail
    if rest > floor:  # a free wire is pulled up, then
        free = np.abs(values - rest) <= max(near, _touch(work))
        single |= inside & free & ~free.all(axis=0) & (np.abs(e - rest) - gap > _INSIDE)
    # Of exchanged wires the other channel is as far off its neighbours.
    single &= ~(np.abs(r[::-1]) >= _OTHER_FITS * np.abs(r))
    beside, known_beside = _beside_rim(values)
    at_rim = known_beside & low & ~low.all(axis=0) & off_rail
    single, e = single | at_rim, np.where(at_rim, beside, e)
    known_places = inside.any(axis=0).sum(axis=0)
    sound = (np.isfinite(values).all(axis=0) & ~low.all(axis=0) & ~high.all(axis=0)).sum(axis=0)
    reads_well = sound > (1.0 - _ALWAYS) * np.maximum(work.there.sum(axis=0), 1)
    ground[:, work.touched_without_contact()] = vref[:, work.touched_without_contact()] = False
    for strip in range(work.strips):
        # Of all channels together: one strip on a rail is more likely than two stuck channels.
        known = np.isfinite(r[:, :, strip]).any(axis=0).sum()
        gain = float(np.nansum(np.abs(r[:, :, strip])) / max(known, 1))
        channels = dict(zip(names, single[:, :, strip], strict=True))
        levels = {name: e[i, single[i, :, strip], strip] for i, name in enumerate(names)}
        of = (inside | known_beside)[:, :, strip].sum(axis=1)
        yield from _open_strip(
            work, strip, ground[:, strip], vref[:, strip], int(known_places[strip]), e[0, :, strip], gain,
            level[silent[:, strip], strip], e[0, off_rails[:, strip], strip], bool(reads_well[strip]),
        )  # fmt: skip
        yield from _one_channel(work, strip, channels, levels, of, gain)


def _beside_rim(values: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return what the one touched neighbour of a strip at a contact's rim reads, and where that is to be expected.

    Both (signatures, places, strips). The strip's other channel reads as its neighbour's does there.
    """
    there = np.pad(np.isfinite(values), ((0, 0), (0, 0), (1, 1)), constant_values=True)
    sides = np.pad(values, ((0, 0), (0, 0), (1, 1)), constant_values=np.nan)
    beside = np.where(there[:, :, 2:], sides[:, :, 2:], sides[:, :, :-2])
    alike = np.abs(values - beside) < _ONE_OBJECT
    far = (beside > 2.0 * _INSIDE) & (beside < 1.0 - _INSIDE)
    return beside, (there[:, :, 2:] ^ there[:, :, :-2]) & far & alike[::-1] & np.isfinite(values)


def _extreme(values: FloatArray) -> FloatArray:
    """Return what channels read at the least, but for strays, wherever they are touched (signatures, 1, strips)."""
    last = min(_STRAYS, values.shape[1] - 1)
    return np.partition(np.where(np.isfinite(values), values, np.inf), last, axis=1)[:, last, None]


def _silent(work: WorkingCopy) -> tuple[BoolArray, FloatArray]:
    """Return where a strip counts as untouched between two under one contact, and at what level these are.

    Both (places, strips). So does one that is cut above the contact, where what a free wire reads is near ground, and
    one that is cut below it, where that is near Vref.
    """
    sides = np.pad(work.there, ((0, 0), (1, 1)))
    gap = ~work.there & sides[:, :-2] & sides[:, 2:]
    if not gap.any():
        return gap, np.zeros(gap.shape)
    e, both, apart = predict_from_neighbours(next(iter(work.k.values())), work.there | gap)
    with np.errstate(invalid="ignore"):
        return gap & both & (apart < _ONE_CONTACT) & (np.abs(e - 0.5) < 0.5 - _INSIDE), e


def _rest(work: WorkingCopy) -> float:
    """Return what an unconnected wire reads, over Vref."""
    return (work.sensor.rest_volt or 0.0) / work.sensor.vref_volt


def _touch(work: WorkingCopy) -> float:
    """Return how far from rest counts as touched, over Vref."""
    return (work.sensor.touch_volt or 0.0) / work.sensor.vref_volt


def _ground(work: WorkingCopy) -> float:
    """Return what a strip reads that hangs on ground, over Vref: rest, unless a free wire is pulled up from there."""
    rest = _rest(work)
    return rest if rest <= _NEAR_RAIL else 0.0


def _open_strip(
    work: WorkingCopy,
    strip: int,
    ground: BoolArray,
    vref: BoolArray,
    places: int,
    level: FloatArray,
    gain: float,
    silent: FloatArray,
    sound: FloatArray,
    reads_well: bool,
) -> Iterator[Suspect]:
    # A gap between two objects is at any height; one above a cut is below all contacts that read Vref, and one below
    # it, of a strip that is pulled up, above all that read ground.
    pulled_up = _rest(work) > 0.5
    sign, far = (-1.0, ground) if pulled_up else (1.0, vref)
    if abs(_rest(work) - pulled_up) > _NEAR_RAIL or far.sum() < _FEW or not len(silent):
        silent = silent[:0]
    else:
        beyond = np.quantile(sign * level[far], 0.1)
        silent = silent[(sign * silent < beyond) & (np.median(sign * silent) < beyond - _BELOW)]
    on_ground, on_vref = (int(at.sum()) + len(silent) * (at is not far) for at in (ground, vref))
    places += len(silent)
    count = on_ground + on_vref
    # Readings without neighbours tell, too, that no end is open.
    always = count >= _ALWAYS * places and not reads_well
    # An object over the strip's end does not put two channels on one rail at every place.
    enough = _FEW if always and len(work.k) == 2 else _SOME
    # An object that reaches over the end of one strip does so at one height, or once.
    rows = np.flatnonzero((ground | vref) & np.isfinite(level))
    levels = np.concatenate([level[rows], silent])
    share = _SHARE if min(on_ground, on_vref) < _FEW else _SHARE_OF_BOTH
    if count < max(enough, share * places) or len(levels) < _FEW:
        return
    if _spread(levels) < (_MOVES_OFTEN if passes(rows) >= _PASSES else _MOVES):
        return
    where = ""
    if on_ground and on_vref:
        below, above = (np.append(level[at], silent if at is not far else []) for at in (ground, vref))
        y = sorted(float(v) * work.sensor.length_mm for v in (below.max(), above.min()))
        where = f"; the cut lies near y = {y[0]:.4g} to {y[1]:.4g} mm"
    elif always:
        where = f"; {_open_end(on_vref > 0)}"
    grounded, vrefs = (" or untouched" * bool(len(silent) and at is not far) for at in (ground, vref))
    evidence = (
        f"on ground{grounded} in {on_ground} and on Vref{vrefs} in {on_vref} of {places} "
        f"places where its neighbours expect 0.15 to 0.85 of Vref{where}"
    )
    numbers = {"places": float(places), "at_ground": float(on_ground), "at_vref": float(on_vref)}
    suspect = work.suspect("open-strip", [strip], evidence, numbers, gain)
    # A palm over the ends of some strips is on one rail at some places, too.
    one_rail = not always and not (on_ground and on_vref)
    doubtful = one_rail and not (_spread(levels) > _FAR_APART and _apart(levels, sound))
    # So is an object that lies still over the strip's end, beside one that moves.
    yield replace(suspect, doubtful=doubtful or (always and _stays_at_rim(work, strip)))


def _apart(levels: FloatArray, sound: FloatArray) -> bool:
    """Whether a strip is on its rail at heights (places,) that are all on one side of those where it reads well."""
    sound = np.sort(sound[np.isfinite(sound)])
    levels = levels[np.isfinite(levels)]
    if not len(sound) or not len(levels):
        return False
    below = float(np.searchsorted(sound, levels).mean()) / len(sound)
    return max(below, 1.0 - below) > _SIDE


def _one_channel(
    work: WorkingCopy,
    strip: int,
    single: dict[str, BoolArray],
    levels: dict[str, FloatArray],
    places: IntArray,
    gain: float,
) -> Iterator[Suspect]:
    counts = {name: int(at.sum()) for name, at in single.items()}
    often = {n: of for n, of in zip(counts, places, strict=True) if counts[n] and counts[n] >= 0.25 * of}
    # The corner of a contact reaches an end on one strip at one height; a dead channel is dead at all.
    often = {n: of for n, of in often.items() if _at_many_heights(levels[n], np.flatnonzero(single[n]))}
    numbers = {f"{n}_at_ground": float(c) for n, c in counts.items()}
    free = "on ground" if _ground(work) == _rest(work) else "as at rest"
    if len(often) == 2 or (len(often) == 1 and min(counts.values()) >= _FEW):
        evidence = (
            f"v_h is {free} in {counts['kh']} places and v_l in {counts['kl']} others, while the other of the two "
            "moves: v_h for contacts below the cut, v_l above it"
        )
        yield work.suspect("open-sensing", [strip], evidence, numbers, gain)
        return
    for name, of in often.items():
        if counts[name] >= _SHARE * of:
            # A wire that nothing holds rests as an untouched strip does, and counts as one.
            level = float(np.median(work.k[name][single[name], strip]))
            off = min(abs(level - _rest(work)), abs(level - _ground(work)))
            fault, where = "dead", free
            if off > max(_touch(work), _NEAR_RAIL / 2.0):
                fault, where = "stuck", f"at {level:.4g} Vref"
            evidence = (
                f"{where} in {counts[name]} of {int(of)} places where its neighbours expect 0.15 to 0.85 of Vref, "
                "while the strip's other channel moves"
            )
            yield work.suspect(fault, [strip], evidence, numbers, gain, name)
            return


def _at_many_heights(levels: FloatArray, rows: IntArray) -> bool:
    """Whether contacts came to places (rows,) at enough heights, expected there over Vref (rows,)."""
    if len(rows) < _SOME:
        return False
    return _spread(levels) >= (_MOVES_OFTEN if passes(rows) >= _PASSES else _MOVES)


def _open_end(at_vref: bool) -> str:
    """Say which end is open of a strip that lies on one rail wherever it is touched."""
    end, wire = ("grounded end", "ground") if at_vref else ("end at Vref", "Vref")
    return f"open at its {end}: look at that clamp and its wire to {wire}"


def _followed(work: WorkingCopy) -> list[tuple[str, int, FloatArray, FloatArray, IntArray]]:
    """Return the channels whose neighbours move together: signature, strip, readings, predictions, rows (places,)."""
    return work.once("followed", lambda: list(_followed_channels(work)))


def _followed_channels(work: WorkingCopy) -> Iterator[tuple[str, int, FloatArray, FloatArray, IntArray]]:
    for name, values in work.k.items():
        e, _ = neighbour_residuals(work, name)
        known = np.isfinite(e)
        together = known.astype(float).T @ np.isfinite(
            values
        )  # places with a strip's prediction and another's reading
        for strip in np.flatnonzero(known.sum(axis=0) >= _SOME).tolist():
            rows = np.flatnonzero(known[:, strip])
            if _alike(values, rows, np.flatnonzero(together[strip] >= _SOME), strip):
                yield name, strip, values[rows, strip], e[rows, strip], rows


def not_moving(work: WorkingCopy) -> Iterator[Suspect]:
    """Find channels that keep one value while their neighbours move."""
    still = max(0.004, 4.0 * work.sigma)  # 3.3 are the middle 90 % of white noise
    without_contact = work.touched_without_contact()
    sides = np.pad(work.there, ((0, 0), (1, 1)), constant_values=True)
    between = sides[:, :-2] & sides[:, 2:]
    for name, strip, values, expected, rows in _followed(work):
        own, predicted = _spread(values), _spread(expected)
        if own <= still and np.ptp(values) <= 3.0 * still and predicted > max(_MOVES, 5.0 * own):
            rests = _rests(work, strip, still)
            if rests and not without_contact[strip]:
                continue
            at_rim = np.count_nonzero(between[rows, strip]) < _SOME
            if at_rim and _others_rest(work.k[name][rows], strip, still):
                continue
            level = float(np.median(values))
            # At a contact's rim, noise of a strip that rests makes it count as touched.
            if _like_rest(work, level) and at_rim:
                continue
            near = max(_RAIL, 4.0 * work.sigma)
            fault = "dead" if abs(level - _rest(work)) < near else "stuck"
            end = ""
            if (
                len(work.k) == 1
                and min(abs(level), abs(level - 1.0)) < _NEAR_RAIL
                and not without_contact[strip]
            ):
                # Strips over metal have no wire of their own that could be dead: the strip hangs on one rail.
                fault, end = "open-strip", f"; {_open_end(at_vref=level > 0.5)}"
            evidence = (
                f"stays within {100 * own:.2g} % of Vref of {level:.4g} Vref over {len(values)} places, while its "
                f"neighbours move by {100 * predicted:.3g} %{end}"
            )
            numbers = {"level": level, "own_spread": own, "neighbours_spread": predicted}
            misfit = float(np.abs(values - expected).mean())
            suspect = work.suspect(fault, [strip], evidence, numbers, misfit, name if not end else None)
            yield replace(suspect, doubtful=rests)


def _others_rest(values: FloatArray, strip: int, still: float) -> bool:
    """Whether two strips or more, no neighbours of this one, keep their readings (places, strips): an object rests."""
    beside = np.abs(np.arange(values.shape[1]) - strip) <= 1
    often = (np.isfinite(values).mean(axis=0) >= _ALL_THE_TIME) & ~beside
    return sum(_spread(v[np.isfinite(v)]) <= still for v in values[:, often].T) >= _RESTING


def _rests(work: WorkingCopy, strip: int, still: float) -> bool:
    """Whether both channels of a strip at the rim keep their values: an object of its own may lie still there."""
    if not _stays_at_rim(work, strip):
        return False
    own = [values[np.isfinite(values[:, strip]), strip] for values in work.k.values()]
    return len(own) > 1 and all(len(values) and _spread(values) <= still for values in own)


def _stays_at_rim(work: WorkingCopy, strip: int) -> bool:
    """Whether a strip is touched all the time, or seldom anew, and the next one on either side never with it."""
    there = work.there[:, strip]
    beside = np.pad(work.there, ((0, 0), (1, 1)))[:, [strip, strip + 2]] & there[:, None]
    if beside.any(axis=0).all():
        return False
    return bool(there.mean() >= _ALL_THE_TIME or passes(np.flatnonzero(there)) < _VISITS)


def _alike(values: FloatArray, rows: IntArray, used: IntArray, strip: int) -> bool:
    """Whether the two nearest strips used, one on each side where there are, move together at some places (rows,)."""
    left, right = used[used < strip][::-1], used[used > strip]
    two = [left[0], right[0]] if len(left) and len(right) else [*left[:2], *right[:2]]
    if len(two) < 2:
        return False
    a, b = values[rows, two[0]], values[rows, two[1]]
    known = np.isfinite(a) & np.isfinite(b)
    if known.sum() < _SOME or min(np.std(a[known]), np.std(b[known])) < 1e-6:
        return False
    return correlation(a[known], b[known]) > _ALIKE


def clipped(work: WorkingCopy) -> Iterator[Suspect]:
    """Find channels that follow their neighbours up (or down) to a level, and no further."""
    for name, strip, own, predicted, rows in _followed(work):
        for sign, side in ((1.0, "above"), (-1.0, "below")):
            stop = _saturation_level(sign * own, sign * predicted, work.sigma)
            if stop is None:
                continue
            level, at, misfit = stop
            beyond = int(at.sum())
            evidence = (
                f"never {side} {sign * level:.4g} Vref, {beyond} times just there while its neighbours went further, "
                f"by {100 * misfit:.3g} % of Vref in the mean"
            )
            numbers = {"level": sign * level, "places": float(beyond), "misfit": misfit}
            drop = partial(_drop_end, strip=strip, name=name, level=sign * level, sign=sign)
            suspect = work.suspect("saturation", [strip], evidence, numbers, misfit, name, drop)
            # A block's corner passes over a strip while its straight edge stays at one height.
            once = bool(np.ptp(rows[at]) < _ONE_VISIT * len(work.there))
            # Part of an object may stay over the strip's end, which reads its rail but for joints and offsets.
            at_end = min(sign * level, 1.0 - sign * level) < _NEAR_RAIL
            yield replace(suspect, doubtful=once or at_end)


def _saturation_level(
    own: FloatArray, predicted: FloatArray, sigma: float
) -> tuple[float, BoolArray, float] | None:
    """Return the level that readings stop at, where, and the mean misfit there; None where they do not stop."""
    if _spread(own) < _SPREAD:
        return None
    level = float(own.max())
    lower = own < level - _BELOW
    if np.count_nonzero(lower) >= _SOME:  # beside the channel's own offset
        predicted = predicted + float(np.median((own - predicted)[lower]))
    beyond = predicted > level + max(0.03, 5.0 * sigma)
    at = own >= level - 0.003
    if (
        abs(level) < 0.015
        or abs(level - 1.0) < 0.015
        or beyond.sum() < _SOME
        or at[beyond].mean() < 0.8
        or _spread(predicted[beyond]) < _SPREAD
        or shortest_half(predicted[beyond]) < _STAYS
    ):
        return None
    return level, beyond, float((predicted - own)[beyond].mean())


def _drop_end(work: WorkingCopy, strip: int, name: str, level: float, sign: float) -> None:
    values = work.k[name][:, strip]
    values[sign * (values - level) >= -0.003] = np.nan


def never_touched(work: WorkingCopy) -> Iterator[Suspect]:
    """Find strips that are never touched, or on a rail only, while a contact moves across them."""
    away, near = _away_from_rest(work), max(_RAIL, 4.0 * work.sigma)
    with np.errstate(invalid="ignore"):
        reads = np.any([np.abs(values - 0.5) < 0.5 - near for values in work.k.values()], axis=0) & work.there
    for strip in np.flatnonzero(~reads.any(axis=0) & ~work.there.all(axis=0)).tolist():
        if strip in (0, work.strips - 1):
            continue
        over = away[:, strip - 1] & away[:, strip + 1]
        for values in work.k.values():  # one contact, not two with a gap between them
            over &= ~(np.abs(values[:, strip + 1] - values[:, strip - 1]) > _ONE_CONTACT)
        over &= ~work.there[:, strip]
        first = work.there[over].argmax(axis=1)
        last = work.strips - 1 - work.there[over][:, ::-1].argmax(axis=1)
        count = int(over.sum())
        if count >= _FEW and np.ptp(first) + np.ptp(last) >= 1:
            fault = "dead"
            evidence = f"reads no contact in {count} places where both its neighbours do, though the contact moves on"
            seldom = work.there[:, strip].any()  # then it is on a rail, as no free wire is
            on_rail, at_vref = bool(seldom or work.on_rail[work.order[strip]]), _rest(work) > 0.5
            if on_rail or len(work.k) == 1:  # one open clamp, rather than all wires dead
                fault = "open-strip"
                rail = f", and is on {'Vref' if at_vref else 'ground'} throughout" * on_rail
                evidence += f"{rail}; {_open_end(at_vref)}, then at the sensing wires"
            suspect = work.suspect(fault, [strip], evidence, {"places": float(count)}, 1.0)
            # Two objects that stay side by side have a gap between them, whatever their rims do.
            yield replace(suspect, doubtful=bool(np.ptp(first + last) < _ACROSS))


def _away_from_rest(work: WorkingCopy) -> BoolArray:
    """Return which strips (places, strips) are touched where a strip beside them cannot read as rest does."""
    with np.errstate(invalid="ignore"):
        near = np.all([_like_rest(work, v) for v in work.k.values()], axis=0)
    return np.asarray(work.there & ~near)


def _like_rest(work: WorkingCopy, level: float | FloatArray) -> BoolArray:
    """Return whether readings over Vref are those of an untouched strip, but for noise and offsets."""
    known = work.sensor.rest_volt is not None
    return np.asarray(known & (np.abs(level - _rest(work)) < _FAR_FROM_REST * _touch(work)))


def _spread(values: FloatArray) -> float:
    low, high = most_of(values)
    return high - low
