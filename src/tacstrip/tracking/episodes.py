"""Which contact of one scan is which of the next: stretches of scans that show one contact."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray


@dataclass(eq=False)
class Episode:
    """A contact from when it appears until it is lifted or comes together with another.

    Attributes
    ----------
    scans, runs
        Numbers of the scans that show it by itself, and its strips in each.
    joint, joint_runs
        Scans in which it shares its run of strips with another contact, and that run.
    group
        All that share strips with it at some time, and those that came out of it, itself included.
    """

    scans: list[int] = field(default_factory=list)
    runs: list[slice] = field(default_factory=list)
    joint: list[int] = field(default_factory=list)
    joint_runs: list[slice] = field(default_factory=list)
    group: list[Episode] = field(default_factory=list, repr=False)

    def __post_init__(self) -> None:
        self.group = [self]

    def readings(self, k: FloatArray) -> FloatArray:
        """Return its readings (T, S, n), of all readings k (all scans, S, n); NaN where others touch."""
        found = np.full((len(self.scans), *k.shape[1:]), np.nan)
        for row, scan, run in zip(found, self.scans, self.runs, strict=True):
            row[:, run] = k[scan][:, run]
        return found


@dataclass(eq=False)
class _Party:
    """Contacts that share a run of strips, mostly one alone."""

    members: list[Episode]
    last: slice


def episodes(k: FloatArray) -> list[Episode]:
    """Return the stretches of scans k (T, S, n) that show one contact each.

    A contact keeps on while its strips overlap those of the scan before. Contacts that come together share a run until
    they part; which is which then, only their shapes and ways can tell, so that new stretches begin. Strips that never
    read anything split none.
    """
    touched = np.asarray(np.isfinite(k).any(axis=1))
    silent = np.asarray(~touched.any(axis=0))
    found: list[Episode] = []
    going: list[_Party] = []
    for scan, row in enumerate(touched):
        going = [p for runs, before in _groups(_runs(row, silent), going) for p in _continued(runs, before)]
        for party in going:
            for one in party.members:
                alone = len(party.members) == 1
                (one.scans if alone else one.joint).append(scan)
                (one.runs if alone else one.joint_runs).append(party.last)
                if not any(one is other for other in found):
                    found.append(one)
    return found


def _continued(runs: list[slice], before: list[_Party]) -> list[_Party]:
    """Return who has which of some runs, of those that were there before, both from left to right."""
    if len(runs) > len(before):
        new = [_Party([Episode()], run) for run in runs]
        if any(len(party.members) > 1 for party in before):
            _join([e for party in (*before, *new) for e in party.members])
        return new
    if len(runs) == len(before):
        return [_Party(party.members, run) for party, run in zip(before, runs, strict=True)]
    found = [_Party([], run) for run in runs]
    for party in before:
        nearest = max(found, key=lambda new: _common(new.last, party.last))
        nearest.members += party.members
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


def _groups(runs: list[slice], going: list[_Party]) -> list[tuple[list[slice], list[_Party]]]:
    """Return runs and the parties that they overlap, those together that hang together, both from left to right."""
    found: list[tuple[list[slice], list[_Party]]] = []
    for run in runs:
        own = [p for p in going if _overlap(p.last, run)]
        if found and any(p is o for p in found[-1][1] for o in own):
            found[-1][0].append(run)
            found[-1][1].extend(o for o in own if not any(o is p for p in found[-1][1]))
        else:
            found.append(([run], own))
    for _, own in found:
        own.sort(key=lambda p: p.last.start)
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


def _common(a: slice, b: slice) -> int:
    return int(min(a.stop, b.stop) - max(a.start, b.start))
