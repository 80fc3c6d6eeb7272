"""Which contact of one scan is which of the next: stretches of scans that show one contact."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray


@dataclass(eq=False)
class Episode:
    """A contact from when it appears until it is lifted or comes together with another.

    Attributes
    ----------
    scans, runs
        Numbers of the scans that show it by itself, and its strips in each. Round a closed tube they are counted on,
        below 0 and beyond the last one: modulo their number they are strips of the scan.
    joint, joint_runs
        Scans in which it shares its run of strips with another contact, and that run.
    group
        All that share strips with it at some time, and those that came out of it, itself included.
    last
        Its strips in the last scan, or those that it shared there.
    """

    scans: list[int] = field(default_factory=list)
    runs: list[slice] = field(default_factory=list)
    joint: list[int] = field(default_factory=list)
    joint_runs: list[slice] = field(default_factory=list)
    group: list[Episode] = field(default_factory=list, repr=False)
    last: slice = field(default_factory=lambda: slice(0))

    def __post_init__(self) -> None:
        self.group = [self]

    @property
    def place(self) -> slice:
        """Its strips where it was last by itself."""
        return self.runs[-1] if self.runs else self.last

    def readings(self, k: FloatArray, span: slice) -> FloatArray:
        """Return its readings (T, S, strips of the span), of all k (all scans, S, n); NaN where others touch."""
        return np.stack([only(k[scan], run, span) for scan, run in zip(self.scans, self.runs, strict=True)])


def only(k: FloatArray, run: slice, span: slice) -> FloatArray:
    """Return the readings (S, strips of the span) of a run of strips, of those of a scan (S, n); NaN elsewhere."""
    found = np.full((len(k), span.stop - span.start), np.nan)
    own = np.arange(run.start, run.stop)
    found[:, own - span.start] = k[:, own % k.shape[1]]
    return found


def spanned(found: list[Episode], strips: int) -> slice:
    """Return the strips that all contacts lie on: those of the sensor, and round a closed tube as far as they go on."""
    runs = [run for one in found for run in (*one.runs, *one.joint_runs)]
    return slice(min([0, *(r.start for r in runs)]), max([strips, *(r.stop for r in runs)]))


@dataclass(eq=False)
class _Party:
    """Contacts that share a run of strips, mostly one alone."""

    members: list[Episode]
    last: slice

    @property
    def place(self) -> slice:
        return self.last


_Placed = TypeVar("_Placed", bound=Episode | _Party)


def episodes(k: FloatArray, closed: bool = False, silent: BoolArray | None = None) -> list[Episode]:
    """Return the stretches of scans k (T, S, n) that show one contact each.

    A contact keeps on while its strips overlap those of the scan before. Contacts that come together share a run until
    they part; which is which then, only their shapes and ways can tell, so that new stretches begin. Strips that are
    `silent` (n,), of which nothing is known, split none. Round a closed tube the last strip is beside the first.
    """
    touched = np.asarray(np.isfinite(k).any(axis=1))
    silent = np.zeros(k.shape[2], dtype=bool) if silent is None else silent
    turn = k.shape[2] if closed else 0
    found: list[Episode] = []
    going: list[_Party] = []
    for scan, row in enumerate(touched):
        groups = _groups(_runs(row, silent, turn), going, turn)
        going = [party for runs, before in groups for party in _continued(runs, before, turn)]
        for party in going:
            for one in party.members:
                alone = len(party.members) == 1
                (one.scans if alone else one.joint).append(scan)
                (one.runs if alone else one.joint_runs).append(party.last)
                if not any(one is other for other in found):
                    found.append(one)
    return found


def _continued(runs: list[slice], before: list[_Party], turn: int) -> list[_Party]:
    """Return who has which of some runs, of those that were there before, both from left to right."""
    if len(runs) > len(before):
        near = [_nearest(run, before[0].last, turn) if before else run for run in runs]
        new = [_Party([Episode()], run) for run in near]
        if before:  # what parts were several, also where one was put down on the strips of another
            _join([e for party in (*before, *new) for e in party.members])
        return new
    if len(runs) == len(before):
        return [
            _Party(party.members, _nearest(run, party.last, turn))
            for party, run in zip(before, runs, strict=True)
        ]
    found = [_Party([], run) for run in runs]
    for party in before:
        nearest = max(found, key=lambda new: _common(_nearest(new.last, party.last, turn), party.last))
        if not nearest.members:
            nearest.last = _nearest(nearest.last, party.last, turn)
        nearest.members = [*nearest.members, *party.members]
    for party in found:
        _join(party.members)
    return found


def _join(episodes: list[Episode]) -> None:
    """Put contacts, and all of their groups, into one group."""
    together: list[Episode] = []
    for one in episodes:
        together += [e for e in one.group if not any(e is t for t in together)]
    for one in together:
        one.group = together


def followed(
    going: list[Episode], scan: int, touched: BoolArray, silent: BoolArray, turn: int = 0
) -> list[Episode]:
    """Return the contacts of the next scan, which are told of it: those that keep on, and new ones.

    For scans that come one by one: contacts that come together keep on until they part, in the order in which they
    were.

    Parameters
    ----------
    going
        Contacts of the scan before.
    scan
        Its number.
    touched, silent
        Whether each strip is touched (n,), and whether it never reads anything.
    turn
        Strips round a closed tube; 0: it is none.
    """
    seen: list[Episode] = []
    for runs, before in _groups(_runs(touched, silent, turn), going, turn):
        if len(runs) < len(before):
            for one in before:
                one.joint.append(scan)
                one.last = _nearest(slice(runs[0].start, runs[-1].stop), one.last, turn)
            seen += before
            continue
        keep_on = before if len(runs) == len(before) else [Episode() for _ in runs]
        for one, run in zip(keep_on, runs, strict=True):
            run = _nearest(run, one.last, turn) if one.scans else run
            one.scans.append(scan)
            one.runs.append(run)
            one.last = run
        seen += keep_on
    return seen


def _groups(runs: list[slice], going: list[_Placed], turn: int) -> list[tuple[list[slice], list[_Placed]]]:
    """Return runs and the contacts that they overlap, those together that hang together, both from left to right."""
    found: list[tuple[list[slice], list[_Placed]]] = []
    for run in runs:
        own = [e for e in going if _overlap(e.last, _nearest(run, e.last, turn))]
        if found and any(e is o for e in found[-1][1] for o in own):
            found[-1][0].append(run)
            found[-1][1].extend(o for o in own if not any(o is p for p in found[-1][1]))
        else:
            found.append(([run], own))
    if len(found) > 1 and any(e is o for e in found[0][1] for o in found[-1][1]):  # round the seam
        last, seam = found.pop()
        seam += [e for e in found[0][1] if not any(e is o for o in seam)]
        found[0] = (last + found[0][0], seam)
    for group, own in found:
        own.sort(key=lambda e: _nearest(e.place, group[0], turn).start)
    return found


def _nearest(run: slice, to: slice, turn: int) -> slice:
    """Return a run as many turns round a closed tube away that it is nearest to another; with no turn, itself."""
    if not turn:
        return run
    away = (to.start + to.stop - run.start - run.stop) / (2 * turn)
    on = turn * round(away)
    return slice(run.start + on, run.stop + on)


def _runs(touched: BoolArray, silent: BoolArray, turn: int) -> list[slice]:
    """Return the runs of touched strips (n,), silent ones no gap; round a tube of `turn` strips, across the seam."""
    on = np.flatnonzero(touched)
    if not len(on):
        return []
    gaps = np.flatnonzero(np.diff(on) > 1).tolist()
    breaks = [i for i in gaps if not silent[on[i] + 1 : on[i + 1]].all()]
    firsts, lasts = [on[0], *(on[i + 1] for i in breaks)], [*(on[i] for i in breaks), on[-1]]
    if turn and breaks and silent[on[-1] + 1 :].all() and silent[: on[0]].all():
        firsts, lasts = firsts[1:], [*lasts[1:-1], lasts[0] + turn]
    return [slice(int(a), int(b) + 1) for a, b in zip(firsts, lasts, strict=True)]


def _overlap(a: slice, b: slice) -> bool:
    return bool(a.start <= b.stop and b.start <= a.stop)  # neighbouring strips count


def _common(a: slice, b: slice) -> int:
    return int(min(a.stop, b.stop) - max(a.start, b.start))
