"""How errors depend on time: Allan deviation, variogram, and the processes that explain one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tacstrip.arrays import FloatArray, IntArray

_LAGS = 28  # at most, evenly spread on a logarithmic scale
_STEP = 2.0  # from one time constant that is tried to the next
_LEAST = 0.02  # of all variance: a process with less is none
_NEAR = 6.0  # times: processes with time constants nearer than that are told apart by nobody


def allan_deviation(values: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return numbers of scans averaged (A,) and the Allan deviation of each channel over so many (A, channels).

    Parameters
    ----------
    values
        Readings at even times (scans, channels), NaN where there is none.

    Examples
    --------
    >>> import numpy as np
    >>> count, deviation = allan_deviation(np.random.default_rng(0).normal(0.0, 1.0, (20_000, 1)))
    >>> count[:3].tolist(), deviation[:3, 0].round(1).tolist()
    ([1, 2, 4], [1.0, 0.7, 0.5])
    """
    known = np.isfinite(values)
    total, there = (
        np.cumsum(np.insert(v, 0, 0.0, axis=0), axis=0) for v in (np.where(known, values, 0.0), known)
    )
    counts = 2 ** np.arange(max(int(np.log2(max(len(values) // 4, 1))) + 1, 1))
    found = []
    for m in counts:
        number = there[m:] - there[:-m]
        with np.errstate(invalid="ignore", divide="ignore"):
            means = np.where(number > 0.5 * m, (total[m:] - total[:-m]) / number, np.nan)
        step = means[m:] - means[:-m]
        pairs = np.maximum(np.isfinite(step).sum(axis=0), 1)
        found.append(np.sqrt(0.5 * np.nansum(step**2, axis=0) / pairs))
    return counts, np.array(found)


def variogram(values: FloatArray, signatures: Sequence[str] = ()) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return lags (A,) in scans, half the mean square change of a channel over them, and that which channels share.

    The second (A, 2) is half the mean product of two channels' changes, 0 for independent ones: of channels of any two
    signatures, and of one signature. Values as for `allan_deviation`; `signatures`: of each channel, none for one.
    """
    of = np.array(signatures or [""] * values.shape[1])
    each = [of == name for name in sorted(set(of))]
    lags = np.unique(np.geomspace(1, max(len(values) // 2, 1), _LAGS).astype(int))
    own, shared = [], []
    for lag in lags:
        step = values[lag:] - values[:-lag]
        count = np.isfinite(step).sum(axis=1)
        squares, together = np.nansum(step**2, axis=1), np.nansum(step, axis=1) ** 2
        own.append(0.5 * squares.sum() / max(int(count.sum()), 1))
        alike = sum(np.nansum(step[:, at], axis=1) ** 2 for at in each)
        many = sum(np.isfinite(step[:, at]).sum(axis=1) ** 2 for at in each)
        same = 0.5 * (alike - squares).sum() / max(int((many - count).sum()), 1)
        pairs = int((count**2 - many).sum())
        shared.append([0.5 * (together - alike).sum() / pairs if pairs else same, same])
    return lags, np.array(own), np.array(shared)


def processes(
    lags_s: FloatArray, own: FloatArray, shared: FloatArray, lasts_s: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return variances of white noise, first, and of Ornstein-Uhlenbeck processes that explain a variogram.

    Parameters
    ----------
    lags_s
        Lags (A,) [s].
    own, shared
        The variogram (A,), and what channels share of it (A, C).
    lasts_s
        Duration of what it was made from [s].

    Returns
    -------
    tuple
        Variances (P,), how much of each channels share (P, C), time constants (P,) [s], 0 for white noise.
    """
    from scipy.optimize import nnls  # late: it takes its time

    shortest, longest = 2.0 * lags_s[0], max(lasts_s, 4.0 * lags_s[0])
    many = max(int(np.log(longest / shortest) / np.log(_STEP)), 2)
    tried = np.array([0.0, *np.geomspace(shortest, longest, many)])
    weight = 1.0 / (np.maximum(own, 1e-18) * np.sqrt(lags_s))  # long lags have few independent pairs
    variance = nnls(_shapes(lags_s, tried) * weight[:, None], own * weight)[0]
    groups: list[list[int]] = []
    for i in np.flatnonzero(variance > 0.0):
        if i and groups and tried[i] < _NEAR * tried[groups[-1][0]]:
            groups[-1].append(int(i))
        elif i:
            groups.append([int(i)])
    times, sizes = [0.0], [variance[0]]
    for group in groups:
        size = variance[group].sum()
        if size > _LEAST * variance.sum():
            times.append(float(np.exp(variance[group] @ np.log(tried[group]) / size)))
            sizes.append(size)
        else:
            sizes[0] += size * (tried[group][0] < 4.0 * lags_s[0])
    shapes = _shapes(lags_s, np.array(times)) * weight[:, None]
    together = [nnls(shapes, np.maximum(of, 0.0) * weight)[0] for of in shared.T]
    return np.array(sizes), np.minimum(together, sizes).T, np.array(times)


def _shapes(lags_s: FloatArray, times_s: FloatArray) -> FloatArray:
    """Return the variograms (A, P) of processes with these time constants and variance 1."""
    with np.errstate(divide="ignore"):
        return np.asarray(1.0 - np.exp(-lags_s[:, None] / times_s))
