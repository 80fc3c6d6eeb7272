"""Vertex Reconstruction (thesis, 4.2): a convex polygon from one signature and its vertices' x.

A polygon is handed out only if it can be what touched the sensor.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt

from tacstrip.arguments import takes
from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.contact.noise import Noise
from tacstrip.contact.signature import signatures
from tacstrip.errors import OptionError, one_of
from tacstrip.geometry.outline import close_chains
from tacstrip.reconstruction.implausible import doubt_implausible
from tacstrip.reconstruction.noise_covariance import signature_advice
from tacstrip.reconstruction.on_surface import refuse_surface
from tacstrip.reconstruction.result import Profile, Reconstruction, RecoveredObject, Status
from tacstrip.reconstruction.seam import unrolled
from tacstrip.reconstruction.sections import Section, fit_sections, noise_level, reading_noise
from tacstrip.reconstruction.vertex.blocks import linear_system
from tacstrip.reconstruction.vertex.transitions import transitions_of_runs
from tacstrip.scan import Scan
from tacstrip.sensor.closed_form import end_weights, transfer_length
from tacstrip.sensor.constructions import SIGNATURES, check_closed_form
from tacstrip.sensor.spec import Sensor

_ROUNDING = 1e-6  # of the strip length: off the sensor by less is rounding, not noise
_SAME_X = 1e-9  # of the strip length
_EROSION_STEPS = 100
_WEAK = 2.0  # standard deviations below which a kink's sign is not to be trusted


def judge(sensor: Sensor, polygon: FloatArray, weak_x: FloatArray) -> tuple[Status, str]:
    """Return a status and advice for an x-monotone polygon, counter-clockwise from its left-most corner.

    Parameters
    ----------
    sensor
        The sensor, whose length bounds y.
    polygon
        Corners (N, 2) [mm].
    weak_x
        x of the vertices whose kinks hide in the noise [mm].

    Returns
    -------
    tuple
        "too noisy": no such polygon can touch the sensor. "doubtful": it can, but is likely wrong. "ok".
    """
    remedy = f"average more scans, recalibrate, or {signature_advice(sensor)}"
    off = np.maximum(-polygon[:, 1], polygon[:, 1] - sensor.length_mm)
    if off.max() > _ROUNDING * sensor.length_mm:
        where = _at(polygon[off.argmax()])
        return "too noisy", f"a vertex falls off the sensor, at {where}; {remedy}"
    if _chains_cross(polygon):
        return "too noisy", f"the vertices found make no polygon: upper and lower sides cross; {remedy}"
    if len(weak_x):
        kink = f"the kink at x = {weak_x[0]:.6g} mm hides in the noise"
        return "doubtful", f"{kink}: its vertex may be on the other side; {remedy}"
    edge = np.roll(polygon, -1, axis=0) - polygon
    turn = edge[:, 0] * np.roll(edge[:, 1], -1) - edge[:, 1] * np.roll(edge[:, 0], -1)
    if turn.min() < 0.0:
        where = _at(np.roll(polygon, -1, axis=0)[turn.argmin()])
        corner = f"the corner at {where} is not convex, which Vertex Reconstruction assumes"
        return "doubtful", f"{corner}; {remedy}"
    return "ok", ""


def judge_fit(
    sensor: Sensor, signature: str, profile: Profile, k: FloatArray, x: FloatArray
) -> tuple[Status, str]:
    """Ask whether a polygon makes the signature that was measured: with a corner too few it does not.

    Parameters
    ----------
    sensor, signature
        What was measured.
    profile
        The polygon on the touched strips: x, l and u (strips,) [mm].
    k
        The readings (strips,).
    x
        The vertices' x [mm].

    Returns
    -------
    tuple
        "doubtful" where an end vertex lies beside the contact, or where the readings are further from the polygon's
        than their noise explains; "ok".
    """
    strips, l, u = profile
    outside = np.maximum(strips[0] - x, x - strips[-1])
    if outside.max() > (1.0 + _ROUNDING) * sensor.pitch_mm:
        far = f"the vertex at x = {x[outside.argmax()]:.6g} mm lies beside the touched strips"
        return "doubtful", f"{far} ({strips[0]:.6g} to {strips[-1]:.6g} mm); give transitions within them"
    off = k - signatures(sensor, l, u)[signature]
    misfit = float(np.sqrt(np.mean(off**2)))
    # The noise is estimated from as many strips, to some 3 / sqrt(n), and a little high on curved signatures.
    if misfit > (1.15 + 3.0 / np.sqrt(len(k))) * reading_noise(k) + _ROUNDING:
        said = f"the polygon's readings are {100.0 * misfit:.2g} % of Vref from the measured ones"
        cause = "a corner may be missing, or the object is not convex"
        return "doubtful", f"{said}: {cause}; give the transitions by hand, or {signature_advice(sensor)}"
    return "ok", ""


def _at(corner: FloatArray) -> str:
    return f"x = {corner[0]:.6g}, y = {corner[1]:.6g} mm"


def _chains_cross(polygon: FloatArray) -> bool:
    """Whether the upper chain falls to the lower one, or below it, between the end corners."""
    right = int(polygon[:, 0].argmax())
    low, high = polygon[: right + 1], np.concatenate([polygon[right:], polygon[:1]])[::-1]
    x = np.delete(polygon[:, 0], [0, right])
    return bool(np.any(np.interp(x, *high.T) <= np.interp(x, *low.T)))


_READINGS = ("section", "strip")


@takes(scan=Scan, sensor=Sensor, noise=Noise)
def vertex_reconstruction(
    scan: Scan,
    sensor: Sensor,
    noise: Noise | None = None,
    *,
    signature: str | None = None,
    transitions: str | npt.ArrayLike = "auto",
    reading: Literal["section", "strip"] = "section",
) -> Reconstruction:
    """Recover a strictly convex polygon from each run of touched strips.

    Parameters
    ----------
    scan, sensor
        What was measured, with what.
    signature
        "kh", "kl" or "k"; by default the last of these that the scan has: k_l before k_h, as 5.6 advises
        (docs/guide/reconstruction.md says where that is wrong).
    transitions
        Ascending x [mm] of all vertices, ends included; or to find them "auto" (those of the polygon
        that fits all strips best) or "gradient" (as simple a rule as the thesis').
    reading
        "section" fits (p x + q) / (r x + s) to each section's strips and evaluates it at the vertex; a
        kink's sign is that of the slopes' difference there. "strip" reads the strip nearest to the vertex
        and takes the slopes of the chords between vertices, as the thesis does.
    noise
        The readings' errors, for "auto"; None: estimated from what the fit leaves over.

    Returns
    -------
    Reconstruction
        Its objects carry a status; a shape that cannot be trusted is "doubtful", one that is wrong for
        certain (sides that cross, corners off the sensor) is not given.

    Raises
    ------
    ReadingError, SignatureError, OptionError
        The scan is not of this sensor, lacks the signature, an option does not exist, or the construction has no
        closed form (CRS-CRP).

    Examples
    --------
    >>> import tacstrip as ts
    >>> sensor = ts.Sensor(construction="crs-crs", strips=100, pitch_mm=1.0, length_mm=100.0)
    >>> contact = ts.Contact.polygon([(20, 40), (55, 20), (80, 50), (45, 75)])
    >>> scan = ts.simulate(sensor, contact)
    >>> found = ts.vertex_reconstruction(scan, sensor, signature="kh", transitions=[20, 45, 55, 80])
    >>> found.objects[0].vertices.round(6).tolist()
    [[20.0, 40.0], [55.0, 20.0], [80.0, 50.0], [45.0, 75.0]]
    """
    scan = scan.checked(sensor)
    check_closed_form(sensor.kind, "Vertex Reconstruction")
    refuse_surface(sensor, "Vertex Reconstruction", 'take the method "polygon" or "profile"')
    name = sensor.check_signature(scan.signatures[-1] if signature is None else signature)
    if reading not in _READINGS:
        raise OptionError(one_of("reading", reading, _READINGS))
    laid_out, surface = unrolled(scan, sensor)
    k = laid_out[name]
    found = transitions_of_runs(laid_out, surface, name, transitions, noise)
    runs = zip(laid_out.runs(), found, strict=True)
    objects = tuple(_recover(surface, name, run, k[run], x, reading) for run, x in runs)
    return doubt_implausible(Reconstruction("vertex", objects, scan.time_s), scan, sensor)


class _Refusal(Exception):  # noqa: N818 - not an error: why one object has no shape
    """A status and advice instead of a shape, its arguments."""


def _recover(
    sensor: Sensor, signature: str, run: slice, k: FloatArray, x: FloatArray, reading: str
) -> RecoveredObject:
    """Recover one object from the readings of its strips and its vertices' x."""
    strips, k = sensor.x_mm[run][np.isfinite(k)], k[np.isfinite(k)]
    try:
        _check_counts(sensor, strips, x)
        sections = fit_sections(strips, k, x, sensor.sensing_ratio)
        k_at, jump, deviation = _by_section(sections, x) if reading == "section" else _by_strip(strips, k, x)
        upper = np.concatenate(([False], jump < 0.0, [False]))  # the slope drops at an upper vertex (4.2.2)
        y = _solve(sensor, signature, x, k_at, upper)
    except _Refusal as refusal:
        status, advice = refusal.args
        return RecoveredObject(run, status=status, advice=advice)
    vertices = np.stack([x, y], axis=1)
    on_low, on_high = _chains(upper)
    polygon = close_chains(vertices[on_low], vertices[on_high])
    # Where nothing was left over the noise is not known, sigma is NaN and no kink counts as weak.
    weak = np.abs(jump) < _WEAK * deviation * noise_level(sections)
    status, advice = judge(sensor, polygon, x[1:-1][weak])
    if status == "too noisy":
        return RecoveredObject(run, status=status, advice=advice)
    np.clip(polygon[:, 1], 0.0, sensor.length_mm, out=polygon[:, 1])
    profile = (strips, np.interp(strips, *vertices[on_low].T), np.interp(strips, *vertices[on_high].T))
    if status == "ok":
        status, advice = judge_fit(sensor, signature, profile, k, x)
    return RecoveredObject(run, polygon, profile, None, status, advice)


def _check_counts(sensor: Sensor, strips: FloatArray, x: FloatArray) -> None:
    """Refuse what holds too little to tell a polygon, or is singular."""
    if len(x) < 3:
        found = f"{len(x)} transitions are a line at most, and a polygon needs 3"
        other = ", or use both signatures" if len(sensor.signatures) > 1 else ""
        raise _Refusal("too few transitions", f"{found}; give them by hand{other}")
    if len(strips) < len(x):
        found = f"{len(strips)} strips are touched, and {len(x)} vertices need as many readings"
        raise _Refusal("too few strips", f"{found}; use finer strips, or a larger object")
    near = np.flatnonzero(np.diff(x) <= _SAME_X * sensor.length_mm)
    if len(near):
        found = f"two vertices share x = {x[near[0]]:.6g} mm, where Vertex Reconstruction is singular"
        raise _Refusal("shared x", f"{found}; turn the object a little")


def _by_section(sections: list[Section | None], x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return k at the vertices (N,), the slope's jumps and their deviations over the noise's (N - 2,)."""
    k_at, variance = np.empty(len(x)), np.empty(len(x))
    for i, at in enumerate(x):
        sides = [s.reading(at) for s in sections[max(i - 1, 0) : i + 1] if s]
        if not sides:
            lack = f"no strip is touched beside the vertex at x = {at:.6g} mm"
            raise _Refusal("too few strips", f"{lack}; give transitions in the contact")
        values, variances = np.array(sides).T
        weights = 1.0 / np.maximum(variances, 1e-12)
        k_at[i], variance[i] = np.average(values, weights=weights), 1.0 / weights.sum()
    slopes = np.empty((len(sections), 2, 2))  # at both ends: slope, variance
    for i, section in enumerate(sections):
        if section and section.strips >= 2:
            slopes[i] = section.slope(x[i]), section.slope(x[i + 1])
        else:  # one strip or none has no slope of its own: the chord's
            run = x[i + 1] - x[i]
            slopes[i] = (k_at[i + 1] - k_at[i]) / run, (variance[i] + variance[i + 1]) / run**2
    left, right = slopes[:-1, 1], slopes[1:, 0]
    return k_at, right[:, 0] - left[:, 0], np.sqrt(right[:, 1] + left[:, 1])


def _by_strip(strips: FloatArray, k: FloatArray, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the same by the thesis' rules: nearest strip, chords between vertices."""
    nearest = np.abs(strips[:, None] - x).argmin(axis=0)
    same = np.flatnonzero(np.diff(nearest) == 0)
    if len(same):
        a, b = x[same[0]], x[same[0] + 1]
        found = f"the vertices at x = {a:.6g} and {b:.6g} mm are nearest to the same strip"
        raise _Refusal("too few strips", f'{found}; use finer strips, or reading="section"')
    k_at, run = k[nearest], np.diff(x)
    a, b = 1.0 / run[:-1], 1.0 / run[1:]
    return k_at, np.diff(np.diff(k_at) / run), np.sqrt(a**2 + (a + b) ** 2 + b**2)


def _chains(upper: BoolArray) -> tuple[BoolArray, BoolArray]:
    """Return which vertices are on the lower and on the upper chain; the ends are on both."""
    low, high = ~upper, upper.copy()
    high[[0, -1]] = True
    return low, high


def _solve(sensor: Sensor, signature: str, x: FloatArray, k: FloatArray, upper: BoolArray) -> FloatArray:
    """Solve for all vertices' y."""
    y = k * sensor.length_mm  # w = 0 at the ends (4.2.2)
    c_l, c_u = end_weights(k, SIGNATURES[signature].at_upper_end, sensor.sensing_ratio)
    on_low, on_high = _chains(upper)
    for _ in range(1 if sensor.contact_lambda_mm == 0.0 else _EROSION_STEPS):
        matrix, right = linear_system(x, k, upper, (y[0], y[-1]), sensor, signature)
        # Contact resistance: the reading is that of [l + T, u - T], so (c_l - c_u) T moves to the right.
        w = np.interp(x, x[on_high], y[on_high]) - np.interp(x, x[on_low], y[on_low])
        right -= ((c_l - c_u) * transfer_length(np.maximum(w, 0.0), sensor.contact_lambda_mm))[1:-1]
        if np.linalg.cond(matrix) > 1e12:
            open_ = "the readings do not determine the vertices"
            raise _Refusal("singular", f"{open_}; turn or move the object a little")
        before = y[1:-1].copy()
        y[1:-1] = np.linalg.solve(matrix, right)
        if np.abs(y[1:-1] - before).max() <= 1e-12 * sensor.length_mm:
            break
    return y
