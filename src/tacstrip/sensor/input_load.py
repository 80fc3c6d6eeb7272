"""What k_h and k_l lose to converter inputs that draw current, and back: the network of one contact, in closed form.

A contact joins the energised strip to the sensing strip between two nodes, its ends. From each node a piece of the
sensing strip leads to a channel, and the channel's input leads to ground. All resistances are over the energised
strip's own; `load` is that strip's over the input's, .002 for 20 kohm read by 10 Mohm.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.sensor.closed_form import sensing_share

MOST_LOAD = 0.05  # above it readings are no longer nearly those of a contact


def lost_to_load(
    l: FloatArray, w: FloatArray, ratio: Any, load: float, drop: float | FloatArray = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Return what k_h and k_l lose, over Vref, where both inputs draw; NaN stays NaN.

    Parameters
    ----------
    l, w
        Electrical lower end and length of the contact over L, any shapes that broadcast; what lies beyond the strip
        is cut off.
    ratio
        Resistivity of the sensing strip over that of the energised one; above 0.
    load
        The energised strip's resistance over an input's.
    drop
        `load` times the contact's own resistance, which both currents cross: (1 + ratio) lambda / sinh(w / lambda)
        over L, nothing for contacts longer than lambda. Broadcasts with l.
    """
    below = np.clip(l, 0.0, 1.0)
    over = np.clip(w, 0.0, 1.0 - below)
    above, over = 1.0 - below - over, sensing_share(ratio) * over
    whole = below + over + above
    high, low = (below + over) / whole, below / whole
    # The resistances that the two inputs see, times the load: k = ideal - (...) k for both at once.
    both = load * below * above / whole + drop
    of_high = load * ((below + over) * above / whole + ratio * above) + drop
    of_low = load * (below * (over + above) / whole + ratio * below) + drop
    root = (1.0 + of_high) * (1.0 + of_low) - both**2
    return high - ((1.0 + of_low) * high - both * low) / root, low - (
        (1.0 + of_high) * low - both * high
    ) / root


def without_load(kh: FloatArray, kl: FloatArray, ratio: Any, load: float) -> tuple[FloatArray, FloatArray]:
    """Return k_h and k_l, not clipped, as inputs that draw nothing would read them; NaN where one of them is.

    The inverse of `lost_to_load` of contacts with a length. The readings tell what their inputs draw, and with the
    contact's ends the currents' balance there gives the energised strip's current below, beside and above the contact.

    Parameters
    ----------
    kh, kl
        As read, over Vref; shapes that broadcast.
    ratio, load
        As of `lost_to_load`.

    Examples
    --------
    >>> high, low = without_load(np.array(0.7), np.array(0.2), 1.0, 0.002)  # 20 kohm read by 10 Mohm
    >>> print(f"{high:.4f} {low:.4f}")
    0.7005 0.2002
    """
    if not load:
        return kh, kl
    drawn = (1.0 + ratio) * load
    # The current beside the contact, of both strips: by the readings, and were the contact without length.
    along = 1.0 + (kh - kl) / ratio
    half = 0.5 * (1.0 - (kh - kl) * (1.0 + drawn))
    least = half + np.sqrt(np.maximum(half**2 + drawn * (kh * (kl + drawn * kl) - kl * (1.0 - kh)), 0.0))
    short = sensing_share(ratio) * np.maximum(
        least - along, 0.0
    )  # noise of such contacts, which stays as it is
    along = np.maximum(along, least)
    below, above = kl / (along - drawn * kl), (1.0 - kh) / (along + drawn * kh)
    whole = (below + sensing_share(ratio) * (1.0 - below - above) + above) / (1.0 + short)
    return 1.0 - above / whole, below / whole
