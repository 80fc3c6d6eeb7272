"""The signs of columns that are exchanged or the same.

No sensor reads k_h below k_l, a contact's upper end below its lower one; only under a line it reads them equal.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tacstrip.arrays import FloatArray

_NOISE = 0.005  # over Vref: P.U. profile I
_FEW = 4  # touched strips: of fewer, noise alone can exchange most
_ALIKE, _OFTEN = 5, 0.9  # readings; their share that is equal to the last digit
_SURE = 3.0  # standard deviations of the mean, by the strips' own scatter: a line's k_h and k_l differ by noise alone


def exchanged(readings: Mapping[str, FloatArray]) -> str:
    """Return a warning where k_h is below k_l, beyond noise, on most strips of most scans.

    Parameters
    ----------
    readings
        Over Vref by signature, (strips,) or (scans, strips), NaN where nothing touches.
    """
    if not {"kh", "kl"} <= set(readings):
        return ""
    apart = readings["kh"] - readings["kl"]
    if np.fmin.reduce(apart, axis=None, initial=0.0) >= -_NOISE:
        return ""
    apart = np.atleast_2d(apart)  # (scans, strips)
    below, touched = (apart < -_NOISE).sum(axis=1), np.isfinite(apart).sum(axis=1)
    counts = touched >= _FEW
    wrong = np.flatnonzero(counts & (2 * below > touched))
    if not len(wrong):
        return ""
    scatter = np.nanstd(apart[wrong], axis=1) / np.sqrt(touched[wrong])
    wrong = wrong[np.nanmean(apart[wrong], axis=1) < -_SURE * scatter]
    if not len(wrong) or 2 * len(wrong) < counts.sum():
        return ""
    first = wrong[0]
    which = f" of scan {first}, and so in {len(wrong) - 1} scan(s) more" if len(wrong) > 1 else ""
    return (
        f"k_h is below k_l on {below[first]} of {touched[first]} strips{which}: are the columns exchanged? "
        "Then exchange their names, or the two wires. Or are all readings measured from Vref down? Then "
        "`tacstrip import` turns them: --answer exchanged=from_vref"
    )


def read_twice(readings: Mapping[str, FloatArray]) -> str:
    """Return a warning where k_h is k_l to the last digit in most readings; argument as of `exchanged`."""
    if not {"kh", "kl"} <= set(readings):
        return ""
    known = np.isfinite(readings["kh"]) & np.isfinite(readings["kl"])
    equal = int((readings["kh"] == readings["kl"])[known].sum())
    if equal < max(_ALIKE, _OFTEN * known.sum()):
        return ""
    return (
        f"v_h is v_l to the last digit in {equal} of {known.sum()} readings, as only a line reads: are both columns of "
        "one channel, or its two wires tied?"
    )
