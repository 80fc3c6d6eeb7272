"""How a strip's ratio of resistivities varies along it, where the two layers of rubber are uneven in different ways.

The log of the ratio over the strip's own is a sum of cosines, c_1 cos(pi y) + c_2 cos(2 pi y) + ..., y the electrical
place over L. A contact reads by the mean under it, to first order in c.
"""

from __future__ import annotations

import numpy as np

from tacstrip.arrays import FloatArray


def under_contact(profile: FloatArray, l: FloatArray, w: FloatArray) -> FloatArray:
    """Return the strips' ratio under contacts over their own (..., strips); NaN stays NaN.

    Parameters
    ----------
    profile
        The cosines' coefficients (strips, cosines).
    l, w
        Electrical lower end and length of the contact over L (..., strips).
    """
    wave = np.arange(1, profile.shape[1] + 1)
    middle = wave * np.asarray(l + w / 2.0)[..., None]
    mean = np.cos(np.pi * middle) * np.sinc(wave * np.asarray(w)[..., None] / 2.0)
    return np.asarray(np.exp((mean * profile).sum(axis=-1)))
