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
        Numbers of the scans that show it by itself, and its strips in each.
    joint
        Scans in which it shares its run of strips with another contact.
    """

    scans: list[int] = field(default_factory=list)
    runs: list[slice] = field(default_factory=list)
    joint: list[int] = field(default_factory=list)
    last: slice = field(default_factory=lambda: slice(0))

    def readings(self, k: FloatArray) -> FloatArray:
        """Return its readings (T, S, n), of all readings k (all scans, S, n); NaN where others touch."""
        found = np.full((len(self.scans), *k.shape[1:]), np.nan)
        for row, scan, run in zip(found, self.scans, self.runs, strict=True):
            row[:, run] = k[scan][:, run]
        return found


def episodes(k: FloatArray) -> list[Episode]:
    """Return the stretches of scans k (T, S, n) that show one contact each.

    A contact keeps on while its strips overlap those of the scan before. Contacts that come together share a run until
    they part, in the order in which they were. Strips that never read anything split none.
    """
    touched = np.asarray(np.isfinite(k).any(axis=1))
    silent = np.asarray(~touched.any(axis=0))
    ended: list[Episode] = []
    going: list[Episode] = []
    for scan, row in enumerate(touched):
        seen = followed(going, scan, row, silent)
        ended += [e for e in going if not any(e is s for s in seen)]
        going = seen
    return [*ended, *going]


def followed(going: list[Episode], scan: int, touched: BoolArray, silent: BoolArray) -> list[Episode]:
    """Return the contacts of the next scan, which are told of it: those that keep on, and new ones.

    Parameters
    ----------
    going
        Contacts of the scan before.
    scan
        Its number.
    touched, silent
        Whether each strip is touched (n,), and whether it never reads anything.
    """
    seen: list[Episode] = []
    for runs, before in _groups(_runs(touched, silent), going):
        if len(runs) < len(before):
            for one in before:
                one.joint.append(scan)
                one.last = slice(runs[0].start, runs[-1].stop)
            seen += before
            continue
        keep_on = before if len(runs) == len(before) else [Episode() for _ in runs]
        for one, run in zip(keep_on, runs, strict=True):
            one.scans.append(scan)
            one.runs.append(run)
            one.last = run
        seen += keep_on
    return seen


def _groups(runs: list[slice], going: list[Episode]) -> list[tuple[list[slice], list[Episode]]]:
    """Return runs and the contacts that they overlap, those together that hang together, both from left to right."""
    found: list[tuple[list[slice], list[Episode]]] = []
    for run in runs:
        own = [e for e in going if _overlap(e.last, run)]
        if found and any(e is o for e in found[-1][1] for o in own):
            found[-1][0].append(run)
            found[-1][1].extend(o for o in own if not any(o is e for e in found[-1][1]))
        else:
            found.append(([run], own))
    for _, own in found:
        own.sort(key=lambda e: e.runs[-1].start)
    return found


def _runs(touched: BoolArray, silent: BoolArray) -> list[slice]:
    """Return the runs of touched strips (n,), silent ones in between no gap."""
    on = np.flatnonzero(touched)
    if not len(on):
        return []
    breaks = [i for i in range(len(on) - 1) if not silent[on[i] + 1 : on[i + 1]].all()]
    firsts, lasts = [on[0], *(on[i + 1] for i in breaks)], [*(on[i] for i in breaks), on[-1]]
    return [slice(int(a), int(b) + 1) for a, b in zip(firsts, lasts, strict=True)]


def _overlap(a: slice, b: slice) -> bool:
    return bool(a.start <= b.stop and b.start <= a.stop)  # neighbouring strips count
