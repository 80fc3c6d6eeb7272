"""What runs cannot tell, said in words: no parameter is handed out that its data leave open."""

from __future__ import annotations

import numpy as np

from tacstrip.calibrate.fit import Fit
from tacstrip.calibrate.model import PARTS, apply
from tacstrip.errors import SpecError
from tacstrip.io.runs import Runs
from tacstrip.sensor.spec import Sensor

# The standard deviation above which a parameter is not told: log ratios, lambda / L, fade, the rest over Vref.
_VAGUE = {
    "ratio": 0.2,
    "ratios": 0.2,
    "lambda": 0.01,
    "fade": 0.1,
    "gain": 0.05,
    "offset": 0.02,
    "warp": 0.02,
    "curve": 0.05,
}
_CURE = {
    "ratio": "press contacts of different lengths w",
    "ratios": "press contacts of different lengths w on every strip",
    "lambda": "press contacts of different lengths w",
    "fade": "press contacts nearer to both ends",
    "gain": "press contacts further apart along every strip",
    "offset": "press every strip",
    "warp": "press more contacts along every strip",
    "curve": "press more contacts along every strip, near both ends too",
}


def untold(found: Fit, sensor: Sensor, runs: Runs) -> str:
    """Say which part the runs cannot tell and what would; nothing where they tell all."""
    model = found.constants.model
    lengths = np.unique(np.round(runs.w_mm[np.isfinite(runs.w_mm)], 6))
    for part in ("ratio", "ratios", "lambda"):
        if model.has(part) and not (lengths > 0.0).any():
            what = "contact resistance" if part == "lambda" else "ratio of resistivities"
            return (
                f"all contacts have w = 0, and such a contact reads the same with any {what}; {_CURE[part]}"
            )
    spread = dict(zip(model.shared, found.shared_sigma, strict=True))
    spread |= dict(zip(model.own(runs.signatures), found.own_sigma.max(axis=0), strict=True))
    # An offset that cannot be told from another part is not the one to blame.
    for name, sigma in sorted(spread.items(), key=lambda item: item[0].startswith("offset")):
        part = name.split()[0]
        if not sigma <= _VAGUE[part]:
            # Wider than the value itself, or than the whole scale, a number would say nothing.
            if not 2.0 * sigma < 1.0:
                return f"the runs do not tell {PARTS[part]}; {_CURE[part]}"
            unit = {"lambda": "L", "ratio": "of it", "ratios": "of it"}.get(part, "Vref")
            return f"the runs tell {PARTS[part]} only to +-{2.0 * sigma:.2g} {unit}; {_CURE[part]}"
    try:
        apply(found.constants, sensor)
    except SpecError as error:
        return f"{error}; {_CURE.get('curve' if model.has('curve') else 'offset')}"
    return ""
