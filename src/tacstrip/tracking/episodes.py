"""Which contact of one scan is which of the next: stretches of scans that show one contact."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray


@dataclass
class Episode:
    """A contact from when it appears until it is lifted.

    Attributes
    ----------
    scans, runs
        Numbers of the scans that show it by itself, and its strips in each. Round a closed tube they are counted on,
        below 0 and beyond the last one: modulo their number they are strips of the scan.
    joint
        Scans in which it shares its run of strips with another contact.
    """

    scans: list[int] = field(default_factory=list)
    runs: list[slice] = field(default_factory=list)
    joint: list[int] = field(default_factory=list)
    last: slice = field(default_factory=lambda: slice(0))

    def readings(self, k: FloatArray, span: slice) -> FloatArray:
        """Return its readings (T, S, strips of the span), of all k (all scans, S, n); NaN where others touch."""
        found = np.full((len(self.scans), k.shape[1], span.stop - span.start), np.nan)
        for row, scan, run in zip(found, self.scans, self.runs, strict=True):
            own = np.arange(run.start, run.stop)
            row[:, own - span.start] = k[scan][:, own % k.shape[2]]
        return found


def spanned(found: list[Episode], strips: int) -> slice:
    """Return the strips that all contacts lie on: those of the sensor, and round a closed tube as far as they go on."""
    runs = [run for one in found for run in one.runs]
    return slice(min([0, *(r.start for r in runs)]), max([strips, *(r.stop for r in runs)]))


def episodes(k: FloatArray, closed: bool = False) -> list[Episode]:
    """Return the stretches of scans k (T, S, n) that show one contact each.

    A contact keeps on while its strips overlap those of the scan before. Contacts that come together share a run until
    they part, in the order in which they were. Strips that never read anything split none. Round a closed tube the
    last strip is beside the first.
    """
    touched = np.asarray(np.isfinite(k).any(axis=1))
    silent = np.asarray(~touched.any(axis=0))
    turn = k.shape[2] if closed else 0
    ended: list[Episode] = []
    going: list[Episode] = []
    for scan, row in enumerate(touched):
        seen = followed(going, scan, row, silent, turn)
        ended += [e for e in going if not any(e is s for s in seen)]
        going = seen
    return [*ended, *going]


def followed(
    going: list[Episode], scan: int, touched: BoolArray, silent: BoolArray, turn: int = 0
) -> list[Episode]:
    """Return the contacts of the next scan, which are told of it: those that keep on, and new ones.

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


def _groups(runs: list[slice], going: list[Episode], turn: int) -> list[tuple[list[slice], list[Episode]]]:
    """Return runs and the contacts that they overlap, those together that hang together, both from left to right."""
    found: list[tuple[list[slice], list[Episode]]] = []
    for run in runs:
        own = [e for e in going if _overlap(e.last, _nearest(run, e.last, turn))]
        if found and any(e is o for e in found[-1][1] for o in own):
            found[-1][0].append(run)
            found[-1][1].extend(o for o in own if not any(o is e for e in found[-1][1]))
        else:
            found.append(([run], own))
    if len(found) > 1 and any(e is o for e in found[0][1] for o in found[-1][1]):  # round the seam
        runs_last, own_last = found.pop()
        found[0] = (
            runs_last + found[0][0],
            [*own_last, *(e for e in found[0][1] if not any(e is o for o in own_last))],
        )
    for group, own in found:
        own.sort(key=lambda e: _nearest(e.runs[-1], group[0], turn).start if e.runs else 0)
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
    breaks = [i for i in range(len(on) - 1) if not silent[on[i] + 1 : on[i + 1]].all()]
    firsts, lasts = [on[0], *(on[i + 1] for i in breaks)], [*(on[i] for i in breaks), on[-1]]
    if turn and breaks and silent[on[-1] + 1 :].all() and silent[: on[0]].all():
        firsts, lasts = firsts[1:], [*lasts[1:-1], lasts[0] + turn]
    return [slice(int(a), int(b) + 1) for a, b in zip(firsts, lasts, strict=True)]


def _overlap(a: slice, b: slice) -> bool:
    return bool(a.start <= b.stop and b.start <= a.stop)  # neighbouring strips count
