"""What one signature says of pieces: separate runs are separate pieces, and a jump of it is a doubt."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.contact.noise import Noise
from tacstrip.core.convex_chain import straight_lines
from tacstrip.reconstruction.noise_covariance import Averaging, fit_sigma
from tacstrip.reconstruction.pieces.estimate import Piece
from tacstrip.reconstruction.pieces.run import noise_level
from tacstrip.reconstruction.polygon.estimate import fit_polygon
from tacstrip.reconstruction.result import RecoveredObject, Status
from tacstrip.reconstruction.seam import BRIDGED, unrolled
from tacstrip.scan import Scan
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.sensor.spec import Sensor

_LEAST = 0.02  # of Vref: a jump
_CLEAR = 4.0  # deviations
_LINE = 3  # strips at either side, that show how the signature goes on


def pieces_of_runs(scan: Scan, sensor: Sensor, noise: Noise | None) -> list[Piece]:
    """Return the fitted polygons as pieces: one signature does not tell l from u, nor pieces of one run."""
    (name,) = scan.signatures
    symbol = SIGNATURES[name].symbol
    laid_out, _ = unrolled(scan, sensor, BRIDGED)
    known = sensor.noise if noise is None else noise
    found = []
    for thing in fit_polygon(scan, sensor, noise, assessment="fast").objects:
        advice = [f"one signature, {symbol}: pieces that share strips cannot be told from one"]
        k = laid_out[name][thing.strips]
        sigma = (
            noise_level(k[None], sensor) if known is None else fit_sigma(known, sensor, Averaging.of(scan))
        )
        if (at := _jump(k, sigma)) is not None:
            strip = (thing.strips.start + at) % sensor.strips + sensor.strip_base
            advice.append(
                f"{symbol} jumps before strip {strip}: at least 2 convex pieces, or a concave object, of which this "
                "is no outline; k_h and k_l tell them"
            )
        doubted = at is not None or thing.status not in ("ok", "likely")
        said = "; ".join(filter(None, (*advice, thing.advice)))
        found.append(_piece(thing, "doubtful" if doubted else "likely", said))
    return found


def _piece(thing: RecoveredObject, status: Status, advice: str) -> Piece:
    outline = thing.vertices
    hidden = np.zeros(len(outline), dtype=np.bool_)
    return Piece(
        outline, hidden, thing.strips, status, advice, thing.covariance, outline, outline, hidden_edges=hidden
    )


def _jump(k: FloatArray, sigma: float) -> int | None:
    """Return the strip to the right of the clearest jump of a signature (n,), None without one."""
    known = np.flatnonzero(np.isfinite(k))
    x, y = known.astype(float), k[known]
    cuts = straight_lines(x, y, np.full(len(x), 1.0 / max(sigma, 1e-5) ** 2))
    best, place = max(_LEAST, _CLEAR * sigma), None
    for (a, c), (_, b) in pairwise(pairwise(cuts)):
        if min(c - a, b - c) >= _LINE:
            left, right = np.polyfit(x[a:c], y[a:c], 1), np.polyfit(x[c:b], y[c:b], 1)
            rises = [
                float(np.polyval(right, at) - np.polyval(left, at)) for at in (x[c - 1] - 1.0, x[c] + 1.0)
            ]
            if rises[0] * rises[1] > 0.0 and min(map(abs, rises)) > best:
                best, place = min(map(abs, rises)), int(known[c])
    return place
